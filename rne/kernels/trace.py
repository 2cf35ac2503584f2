"""From a function of a model to a program: its core run on traced numbers, and when the program's results are sound."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from typing import Any, Protocol

import numpy as np

from ..basics.spatial import Array
from ..dynamics.precision import NEARLY_SINGULAR, velocity_bound
from ..dynamics.quantity import Declared, PrecisionStatus, Quantity
from ..model.fewest_terms import with_fewest_terms
from ..model.model import Model
from .differentiation import differentiate
from .graph import Graph, TooLarge
from .program import Program, lower
from .scalar import inputs, references

LIMIT = 50_000  # operations that are written out at most
# Operations whose result is not finite if an operand is not. So is x / y if y is a pivot of M, which is checked.
PROPAGATING = frozenset({"add", "subtract", "multiply", "negative", "sin", "cos", "sqrt", "abs"})
# What the recursion finds for states begin to end, counted in the whole batch.
Recursion = Callable[[int, int], tuple[Array, PrecisionStatus]]


class NeedsRecursion(Exception):
    """Raised for a state that the recursion must compute, since the program's result is not known to be sound."""


class Conditions(Protocol):
    """How an engine writes the conditions of soundness: on text, on registers of NumPy, in machine code."""

    def finite(self, values: Any) -> Any:
        """Every value is finite."""

    def within(self, values: Any, bound: float) -> Any:
        """No value exceeds the bound in size; an engine may also refuse values up to its n-th part."""

    def above(self, values: Any, factor: float, others: Any) -> Any:
        """Each value exceeds the factor times its partner."""


@dataclass(frozen=True)
class Trace:
    """A quantity traced on one model, as the engines run it.

    Attributes
    ----------
    program : Program
        Its outputs are the entries of the result, then the pivots of M, then M's diagonal, if there are pivots.
    widths : tuple of int
        Number of inputs of each argument.
    shape : tuple of int
        Of the result for one state.
    velocities : range
        Inputs that are joint velocities whose squares may cost digits.
    pivots : int
        Number of pivots of M.
    """

    program: Program
    widths: tuple[int, ...]
    shape: tuple[int, ...]
    velocities: range = range(0)
    pivots: int = 0

    @property
    def entries(self) -> int:
        """Number of entries of the result."""
        return prod(self.shape)

    def unguarded(self) -> Trace:
        """The trace without the condition on joint velocities."""
        return replace(self, velocities=range(0))

    @cached_property
    def unchecked_inputs(self) -> list[int]:
        """Inputs whose NaN or infinity might not reach an output: unused ones, or all if some operation can hide it."""
        hiding = self.program.operations.keys() - PROPAGATING
        if hiding - {"divide"} or (hiding and not self.pivots):
            return list(range(self.program.inputs))
        return self.program.unused_inputs

    def sound_inputs(self, inputs: Any, dtype: Any, write: Conditions) -> list[Any]:
        """What must hold for the inputs of a state, or of several at once; see `sound_results`."""
        unchecked = [inputs[k] for k in self.unchecked_inputs]
        conditions = [write.finite(unchecked)] if unchecked else []
        if self.velocities:
            velocities = inputs[self.velocities.start : self.velocities.stop]
            conditions.append(write.within(velocities, velocity_bound(np.dtype(dtype))))
        return conditions

    def sound_results(self, outputs: Any, dtype: Any, write: Conditions) -> list[Any]:
        """What must hold for the outputs, so that the recursion need not compute the state as well.

        This is the only statement of it; each engine writes it in its own form. A NaN fulfils no condition.
        """
        first, n = self.entries, self.pivots
        conditions = [write.finite(outputs[:first])]
        if n:
            pivots, diagonal = outputs[first : first + n], outputs[first + n : first + 2 * n]
            conditions.append(write.above(pivots, NEARLY_SINGULAR * n * float(np.finfo(dtype).eps), diagonal))
        return conditions


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
