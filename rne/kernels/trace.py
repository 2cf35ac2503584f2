"""Tracing of a function of a model to a program: its core is run on traced numbers.

A function takes wrenches as a mapping of links, and its model has the inertial parameters. A kernel takes only arrays
(`inputs_as_arrays`), so that many loads, or many variants of a robot, are one batch.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ..basics.inertia import PARAMETERS
from ..basics.spatial import Array
from ..dynamics.quantity import JOINT_ARGUMENTS, Declared, MethodQuantity, PrecisionStatus, Quantity, check_arguments
from ..errors import NotFiniteError
from ..graph.differentiation import ORDERS, differentiate
from ..graph.graph import Graph, TooLarge
from ..graph.program import evaluate, lower
from ..graph.scalar import inputs, references
from ..model.model import Model, model_argument
from ..model.parameters import at_parameters, with_fewest_terms
from ..model.topology import where_loops_close
from .soundness import Trace

LIMIT = 50_000  # most operations that are written out
AGREEMENT = 1e-9  # relative tolerance of equal values
TRIALS = 3  # random states in which a user's function or law is compared with its trace
STEP = 1e-30  # length of complex steps: its square vanishes relative to 1, so nothing cancels or is truncated


def declared(function: Any) -> Declared:
    """Function of this package, or a user's own marked by `rne.traceable`, with its declaration; else a TypeError."""
    quantity = getattr(function, "quantity", None)
    if isinstance(quantity, Quantity):
        if not quantity.returns_array:
            name = f"rne.dynamics.{quantity.name}"
            raise TypeError(f"`function` must give an array; {name} gives a record, which is not compiled")
        known: Declared = function
        return known
    if not getattr(function, "traceable", False):
        raise TypeError(
            "`function` must be one of rne's functions of a model, such as rne.dynamics.mass_matrix, or one of joint "
            f"arrays marked by rne.traceable, got {function!r}"
        )
    taken = inspect.signature(function).parameters.values()
    names = [p.name for p in taken if p.name in JOINT_ARGUMENTS or p.default is p.empty]
    if not names or not set(names) <= set(JOINT_ARGUMENTS):
        raise TypeError(f"the arguments of `function` must have names of {list(JOINT_ARGUMENTS)}, got {names}")
    named = function
    while isinstance(named, partial):
        named = named.func
    name = re.sub(r"\W", "", getattr(named, "__name__", type(named).__name__))
    widths: dict[str, int | None] = dict.fromkeys(names)
    core = partial(_one_by_one, function)
    own = Quantity(name=name, core=core, widths=widths, moments=False, base_parameters=False)
    return MethodQuantity(function, own, name)


def _one_by_one(function: Callable[..., Any], model: Model, **arrays: Array) -> Array:
    """Function of one state, applied to a batch."""
    leading = next(iter(arrays.values())).shape[:-1]
    states = [{name: a[k].copy() for name, a in arrays.items()} for k in np.ndindex(leading)]
    found = np.array([function(**state) for state in states])
    return found.reshape(leading + found.shape[1:])


def check_own(function: Declared, model: Model) -> None:
    """Raise a TypeError if a user's function gives other values than its trace, in some random states."""
    quantity = function.quantity
    widths = argument_widths(quantity, model)
    states = np.random.default_rng(0).uniform(-1, 1, (TRIALS, sum(widths.values())))
    arrays = np.split(states, np.cumsum(list(widths.values()))[:-1], axis=-1)
    arrays = [where_loops_close(model, a) if name == "q" else a for name, a in zip(widths, arrays, strict=True)]
    called, _ = function.evaluate(model, *arrays)
    found = trace(quantity, model, {}, is_large=True)
    traced = evaluate(found.program, found.entries, np.concatenate(arrays, axis=-1)).reshape(called.shape)
    worst = float(np.abs(traced - called).max(initial=0.0)) / max(1.0, float(np.abs(called).max(initial=0.0)))
    if not worst <= AGREEMENT:
        raise TypeError(f"`function`, traced, differs by {worst:.3g} from a call: it has memory, noise or a branch")


def trace(
    quantity: Quantity,
    model: Model,
    fixed: Mapping[str, Any],
    wrt: Sequence[str] = (),
    entry: tuple[int, ...] | None = None,
    order: str = "jacobian",
    *,
    is_large: bool = False,
) -> Trace:
    """Run the core on traced numbers, as a batch of one state, and differentiate it with respect to `wrt`.

    Of a single `entry` of the result, only the operations that it needs are kept. Raises TooLarge if the program has
    too many operations; where it `is_large`, only if the graph has.
    """
    widths = argument_widths(quantity, model)
    starts = dict(zip(widths, np.cumsum([0, *widths.values()]).tolist(), strict=False))

    def run(by_pivots: Sequence[bool] | None = None) -> tuple[Graph, Any, Any]:
        """Graph, result and checks; of a second run where zeros were folded unsoundly."""
        graph = Graph(8 * LIMIT, by_pivots)
        arrays = [inputs(graph, (1, width), starts[name]) for name, width in widths.items()]
        result, *judged = run_core(quantity, model, arrays, fixed)
        again = graph.divisions_by_pivots(references(graph, judged[0]) if judged else ())
        return (graph, result, judged) if again is None else run(again)

    graph, result, judged = run()
    shape, outputs = np.shape(result)[1:], references(graph, result)
    by = [starts[name] + j for name in wrt for j in range(widths[name])]
    if wrt:
        further = dict(zip(ORDERS[order].inputs, (len(outputs), len(by)), strict=False))
        outputs = differentiate(graph, order, outputs, by, sum(widths.values()))
        shape = (*(() if further else shape), *[len(by)] * ORDERS[order].axes)
        widths |= further
    if entry is None:
        outputs += [ref for part in judged for ref in references(graph, part)]
    else:
        shape, outputs = (), [outputs[int(np.ravel_multi_index(entry, shape))]]
    needed = {*graph.needed(outputs)} if graph.checked else set()
    outputs += [2 * k for k in graph.checked if k in needed]
    program = lower(graph, outputs, sum(widths.values()))
    if len(program.instructions) > LIMIT and not is_large:
        raise TooLarge(f"{len(program.instructions)} operations")
    velocities = range(0)
    if quantity.velocities is not None:
        name, entries = quantity.velocities
        velocities = range(starts[name], starts[name] + widths[name])[entries]
    pivots = np.shape(judged[0])[-1] if judged and entry is None else 0
    found = Trace(program, tuple(widths.values()), shape, velocities, pivots)
    if quantity.of_run not in widths:
        return found
    return replace(found, of_run=[*widths].index(quantity.of_run)).divided()


def run_core(quantity: Quantity, model: Model, arrays: Sequence[Any], fixed: Mapping[str, Any]) -> tuple[Any, ...]:
    """Results of the core at given parameters, or with masses moved inwards where that does not change them."""
    given = by_link(quantity, arrays, fixed)
    model = with_fewest_terms(model) if quantity.base_parameters else model
    if "parameters" in given:
        model = at_parameters(model, given.pop("parameters"))
    results = quantity.core(model, **given)
    return (results,) if quantity.check is None else results


def within_a_trace(quantity: Quantity, model: Model, arguments: Sequence[Any], fixed: Mapping[str, Any]) -> Array:
    """Result on traced numbers, of a quantity that another one calls; the core needs a batch axis."""
    arrays = [np.asarray(a) for a in arguments]
    single = all(a.ndim < 2 for a in arrays)
    result = run_core(quantity, model, [np.atleast_2d(a) for a in arrays] if single else arrays, fixed)[0]
    return result[0] if single else result  # type: ignore[no-any-return]


def argument_widths(quantity: Quantity, model: Model) -> dict[str, int]:
    """Length of each array argument along its last axis."""
    return {name: model.n if width is None else width for name, width in quantity.widths.items()}


def by_link(quantity: Quantity, arrays: Sequence[Any], named: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments by name, the wrenches among them in one mapping `external` by link."""
    given = {**dict(zip(quantity.widths, arrays, strict=False)), **named}
    external = {link: given.pop(name) for name, link in quantity.wrenches.items()}
    return given | {"external": external} if external else given


def inputs_as_arrays(function: Declared, model: Model, fixed: Mapping[str, Any]) -> tuple[Quantity, dict[str, Any]]:
    """Quantity with wrenches and inertial parameters as further arrays after its joint arrays, and the rest of `fixed`.

    `fixed` may have `external`, a sequence of link names, whose wrenches are external_1, ... of shape (..., 6),
    `parameters`, True for an array of shape (..., 10 nb), and values of arrays.
    """
    quantity, rest = declared(function).quantity, dict(fixed)
    given = {name: width for name, width in quantity.widths.items() if name not in rest}  # the others have values
    external, parameters = rest.pop("external", None), rest.pop("parameters", False)
    wrenches: dict[str, str] = {}
    if external is not None:
        if "external" not in inspect.signature(quantity.core).parameters:
            raise TypeError(f"rne.dynamics.{quantity.name} takes no external wrenches")
        links = wrench_links(model_argument(model), external)
        wrenches = {f"external_{k}": link for k, link in enumerate(links, 1)}
    taken = inspect.signature(quantity.core).parameters
    if "link" in taken and taken["link"].default is inspect.Parameter.empty and "link" not in rest:
        last = model_argument(model).link_names[-1]
        raise TypeError(f"rne.dynamics.{quantity.name} needs a link by name: link={last!r}")
    if not isinstance(parameters, bool):
        raise TypeError(
            f"`parameters` of a kernel must be True or False, got {type(parameters).__name__}; the parameters "
            "themselves are an argument of its calls"
        )
    widths = dict.fromkeys(wrenches, 6)
    if parameters:
        quantity.require_moments()
        widths["parameters"] = PARAMETERS * model_argument(model).nb
    return replace(quantity, widths={**given, **widths}, wrenches=wrenches), rest


def by_recursion(
    function: Declared, model: Model, arrays: Sequence[Any], wrt: Sequence[str], fixed: Mapping[str, Any]
) -> tuple[Array, PrecisionStatus]:
    """Results of a kernel by its function itself; derivatives with respect to `wrt` by complex steps."""
    quantity, rest = inputs_as_arrays(function, model, fixed)

    def evaluate(arrays: Sequence[Any]) -> tuple[Array, PrecisionStatus]:
        if len(quantity.widths) == len(function.quantity.widths):
            return function.evaluate(model, *arrays, **rest)
        return function.evaluate(model, **by_link(quantity, arrays, rest))

    result, status = evaluate(arrays)  # also checks the arguments
    if not wrt:
        return result, status
    names, arrays = list(quantity.widths), [np.asarray(a) for a in arrays]
    real = np.result_type(*arrays, np.float32)
    leading = len(np.broadcast_shapes(*(a.shape[:-1] for a in arrays)))
    columns = []
    for name in wrt:
        k = names.index(name)
        perturbed = [a[..., None, :] for a in arrays]
        perturbed[k] = perturbed[k] + 1j * STEP * np.eye(arrays[k].shape[-1])
        try:
            columns.append(np.moveaxis(evaluate(perturbed)[0].imag / STEP, leading, -1))
        except NotFiniteError as error:
            raise NotFiniteError(error.args[0], state=error.state[:leading]) from None
    return np.concatenate(columns, axis=-1).astype(real), status


def takes_complex_steps(function: Declared, model: Model) -> bool:
    """True if complex steps give the derivatives, which functions of couplings may not allow."""
    return function.quantity.analytic and not model.couplings


def wrench_links(model: Model, external: Any) -> tuple[str, ...]:
    """Links on which wrenches of a kernel act: known ones, each named once."""
    if isinstance(external, str) or not isinstance(external, Sequence):
        raise TypeError(
            f"`external` of a kernel must be a sequence of link names, such as ['link_6'], got "
            f"{type(external).__name__}; the wrenches are arguments of its calls"
        )
    for k, link in enumerate(external):
        if link not in model.link_names:
            raise ValueError(f"`external` must name links of {list(model.link_names)}, got {link!r}")
        if link in external[:k]:
            raise ValueError(f"`external` must name each link once, got {link!r} again")
    return tuple(external)


def named_by_function(quantity: Quantity, model: Model, arguments: Sequence[Any], error: ValueError) -> ValueError:
    """Error of the function itself for these arguments, with wrenches by their links, or else the kernel's."""
    if not quantity.wrenches:
        return error
    try:
        check_arguments(model, by_link(quantity, arguments, {}))
    except ValueError as same:
        return same
    return error
