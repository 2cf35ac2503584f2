"""From a function of a model to a program: its core, run on traced numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..dynamics.quantity import Declared, Quantity
from ..model.fewest_terms import with_fewest_terms
from ..model.model import Model
from .differentiation import differentiate
from .graph import Graph, TooLarge
from .program import Program, lower
from .scalar import inputs, references

LIMIT = 50_000  # operations that are written out at most


class Trace(NamedTuple):
    """A quantity traced on one model.

    The program's outputs are the entries of the result and, of a judged quantity, pivots and diagonal of M.
    """

    program: Program
    shape: tuple[int, ...]  # of the result, without the batch axis


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
    return Trace(program, shape)


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
