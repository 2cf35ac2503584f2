"""From a function of a model to a program: its core run on traced numbers.

A function takes wrenches as a mapping of links, and its model has the inertial parameters. A kernel takes arrays alone
(`inputs_as_arrays`), so that many loads, or many variants of a robot, are one batch.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..dynamics.quantity import Declared, PrecisionStatus, Quantity, check_arguments
from ..model.fewest_terms import with_fewest_terms
from ..model.model import Model, model_argument
from ..model.parameters import PARAMETERS, at_parameters
from .differentiation import differentiate
from .graph import Graph, TooLarge
from .program import Trace, lower
from .scalar import inputs, references

LIMIT = 50_000  # operations that are written out at most


def quantity_of(function: Declared) -> Quantity:
    """The declaration of a function that can be traced; a TypeError for anything else."""
    quantity = getattr(function, "quantity", None)
    if not isinstance(quantity, Quantity):
        raise TypeError(f"`function` must be one of rne's functions of a model, got {function!r}")
    if not quantity.returns_array:
        name = f"rne.dynamics.{quantity.name}"
        raise TypeError(f"`function` must give an array; {name} gives a record, which is not compiled")
    return quantity


def trace(
    quantity: Quantity,
    model: Model,
    fixed: Mapping[str, Any],
    wrt: Sequence[str] = (),
    entry: tuple[int, ...] | None = None,
) -> Trace:
    """Run the core on traced numbers, one state in a batch axis of length 1; differentiate by `wrt`.

    Of a single `entry` of the result only the operations that it needs are kept. Raises TooLarge if the program has too
    many operations or a constant that is not finite.
    """
    graph = Graph(limit=8 * LIMIT)
    widths = argument_widths(quantity, model)
    starts = dict(zip(widths, np.cumsum([0, *widths.values()]).tolist(), strict=False))
    arguments = {name: inputs(graph, (1, width), starts[name]) for name, width in widths.items()}
    result, *judged = _parts(quantity, quantity.core(traced_model(quantity, model), **arguments, **fixed))
    shape, outputs = np.shape(result)[1:], references(graph, result)
    if wrt:
        by = [starts[name] + j for name in wrt for j in range(widths[name])]
        shape, outputs = (*shape, len(by)), differentiate(graph, outputs, by)
    if entry is None:
        outputs += [ref for part in judged for ref in references(graph, part)]
    else:
        shape, outputs = (), [outputs[int(np.ravel_multi_index(entry, shape))]]
    program = lower(graph, outputs, sum(widths.values()))
    if len(program.instructions) > LIMIT or not program.is_finite:
        raise TooLarge("operations or constants")  # the recursion runs, and names what is wrong
    velocities = range(0)
    if quantity.velocities is not None:
        name, entries = quantity.velocities
        velocities = range(starts[name], starts[name] + widths[name])[entries]
    pivots = model.n if judged and entry is None else 0
    return Trace(program, tuple(widths.values()), shape, velocities, pivots)


def _parts(quantity: Quantity, core_result: Any) -> tuple[Any, ...]:
    return (core_result,) if quantity.check is None else core_result


def within_a_trace(quantity: Quantity, model: Model, arguments: Sequence[Any], fixed: Mapping[str, Any]) -> Array:
    """The result on traced numbers, of a quantity that another one calls; the core needs a batch axis."""
    arrays = [np.asarray(a) for a in arguments]
    single = all(a.ndim < 2 for a in arrays)
    batch = [np.atleast_2d(a) for a in arrays] if single else arrays
    result = _parts(quantity, quantity.core(traced_model(quantity, model), *batch, **fixed))[0]
    return np.asarray(result[0] if single else result)


def traced_model(quantity: Quantity, model: Model) -> Model:
    """The model a quantity is traced on: with masses moved inwards, where that changes nothing."""
    return with_fewest_terms(model) if quantity.base_parameters else model


def argument_widths(quantity: Quantity, model: Model) -> dict[str, int]:
    """Length of each array argument along its last axis."""
    return {name: model.n if width is None else width for name, width in quantity.widths.items()}


@dataclass(frozen=True)
class OfArrays:
    """A function of a model with wrenches, or the inertial parameters, as arrays behind its joint arrays.

    Attributes
    ----------
    function : Declared
    links : tuple of str
        Links of the wrenches, in the order of their arrays.
    bodies : int or None
        Number of moving bodies if the inertial parameters are the last array; None if they are the model's.
    """

    function: Declared
    links: tuple[str, ...]
    bodies: int | None

    @property
    def quantity(self) -> Quantity:
        """The function's quantity with further arrays: external_k of shape (..., 6), parameters (..., 10 bodies)."""
        declared = self.function.quantity
        wrenches = {f"external_{k}": link for k, link in enumerate(self.links, 1)}
        widths = {**declared.widths, **dict.fromkeys(wrenches, 6)}
        if self.bodies is not None:
            widths["parameters"] = PARAMETERS * self.bodies
        return replace(declared, core=self.core, widths=widths, wrenches=wrenches)

    def core(self, model: Model, *arrays: Any, **named: Any) -> Any:
        """The function's core, with wrenches by link, on the model at the parameters."""
        given = by_link(self.quantity, arrays, named)
        if self.bodies is not None:
            model = at_parameters(model, given.pop("parameters"))
        return self.function.quantity.core(model, **given)

    def evaluate(self, model: Model, *args: Any, **kwargs: Any) -> tuple[Any, PrecisionStatus]:
        """The function itself, with wrenches by link and `parameters`."""
        return self.function.evaluate(model, **by_link(self.quantity, args, kwargs))


def by_link(quantity: Quantity, arrays: Sequence[Any], named: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments by name, the wrenches among them in one mapping `external` by link."""
    given = {**dict(zip(quantity.widths, arrays, strict=False)), **named}
    external = {link: given.pop(name) for name, link in quantity.wrenches.items()}
    return given | {"external": external} if external else given


def inputs_as_arrays(function: Declared, model: Model, fixed: Mapping[str, Any]) -> tuple[Declared, dict[str, Any]]:
    """Turn fixed arguments into arrays of the function: its joint arrays, then wrenches, then inertial parameters.

    `fixed` may have `external`, a sequence of link names, and `parameters`, True or False; it is returned without them.
    A TypeError tells that the function takes no such input, or an argument is of another type, a ValueError that a
    link is unknown or named twice.
    """
    rest = dict(fixed)
    external, parameters = rest.pop("external", None), rest.pop("parameters", False)
    links: tuple[str, ...] = ()
    if external is not None:
        quantity = quantity_of(function)
        if "external" not in inspect.signature(quantity.core).parameters:
            raise TypeError(f"rne.dynamics.{quantity.name} takes no external wrenches")
        links = wrench_links(model_argument(model), external)
    if not isinstance(parameters, bool):
        raise TypeError(
            f"`parameters` of a kernel must be True or False, got {type(parameters).__name__}; the parameters "
            "themselves are an argument of its calls"
        )
    if parameters:
        quantity_of(function).require_moments()
    if not links and not parameters:
        return function, rest
    return OfArrays(function, links, model_argument(model).nb if parameters else None), rest


def wrench_links(model: Model, external: Any) -> tuple[str, ...]:
    """The links on which wrenches of a kernel act: known ones, each named once."""
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
    """The function's own error for these arguments, which names wrenches by their links, or else the kernel's."""
    if not quantity.wrenches:
        return error
    try:
        check_arguments(model, by_link(quantity, arguments, {}))
    except ValueError as same:
        return same
    return error
