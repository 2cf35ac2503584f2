"""Soundness of a program's results: conditions under which an engine returns them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..dynamics.precision import NEARLY_SINGULAR, pivot_bound, velocity_bound
from ..dynamics.quantity import PrecisionStatus
from ..graph.program import Program, divided

# Operations whose result is not finite if an operand is not. x / y is another if y is a pivot of M, which is checked.
PROPAGATING = frozenset({"add", "subtract", "multiply", "negative", "sin", "cos", "sqrt", "abs"})
# Results of the recursion for states from begin to end, counted in the whole batch.
Recursion = Callable[[int, int], tuple[Array, PrecisionStatus]]


class NeedsRecursion(Exception):
    """Raised for a state that the recursion must compute, since the program's result is not known to be sound."""


class Conditions(NamedTuple):
    """Conditions of soundness as an engine writes them: on text, on registers of NumPy, in machine code."""

    finite: Callable[[Any], Any]  # every one of some values is finite
    within: Callable[[Any, float], Any]  # none exceeds a bound in size, or the root of their sum of squares does not
    above: Callable[[Any, float, Any], Any]  # each value exceeds a factor times its partner


@dataclass(frozen=True)
class Trace:
    """Quantity traced on one model, for the engines to run.

    The program's outputs are the entries of the result, then the pivots of M, then M's diagonal, if there are pivots,
    then further values that must be finite: of couplings.
    """

    program: Program
    widths: tuple[int, ...]  # number of inputs of each argument
    shape: tuple[int, ...]  # of the result for one state
    velocities: range = range(0)  # inputs that are joint velocities whose squares may cost digits
    pivots: int = 0
    of_run: int | None = None  # the argument that is the same over a run; its inputs are what `of_numbers` gives
    of_numbers: Program | None = None

    @property
    def entries(self) -> int:
        """Number of entries of the result."""
        return math.prod(self.shape)

    @cached_property
    def coefficients(self) -> range:
        """Inputs that are constant over a run."""
        if self.of_run is None:
            return range(0)
        first = sum(self.widths[: self.of_run])
        return range(first, first + self.widths[self.of_run])

    def divided(self) -> Trace:
        """Trace whose inputs are the results computed from the argument `of_run`, instead of that argument."""
        assert self.of_run is not None
        given = self.coefficients
        of_numbers, program = divided(self.program, given.start, len(given))
        widths = list(self.widths)
        widths[self.of_run] = len(of_numbers.outputs)
        return replace(self, program=program, widths=tuple(widths), of_numbers=of_numbers)

    def unguarded(self) -> Trace:
        """Trace without the condition on joint velocities."""
        return replace(self, velocities=range(0))

    @cached_property
    def unchecked_inputs(self) -> list[int]:
        """Inputs whose NaN or infinity might not reach an output: unused ones, or all if some operation can hide it."""
        program = self.program
        hiding = program.operations.keys() - PROPAGATING
        read = [arg for instruction in program.instructions for arg in instruction.args] + [*program.outputs]
        passed_on = {arg.value for arg in read if arg.kind == "input"}
        if hiding - {"divide"} or (hiding and not self.pivots):
            passed_on = set()
        passed_on |= set(self.coefficients)  # which are not checked: constants of a kernel are not either
        return [k for k in range(program.inputs) if k not in passed_on]

    def sound_inputs(self, inputs: Any, dtype: Any, write: Conditions) -> list[Any]:
        """Conditions on the inputs of a state, or of several at once; see `sound_results`."""
        unchecked = [inputs[k] for k in self.unchecked_inputs]
        conditions = [write.finite(unchecked)] if unchecked else []
        if self.velocities:
            velocities = inputs[self.velocities.start : self.velocities.stop]
            conditions.append(write.within(velocities, velocity_bound(np.dtype(dtype))))
        return conditions

    def sound_results(self, outputs: Any, dtype: Any, write: Conditions, units: float = NEARLY_SINGULAR) -> list[Any]:
        """Conditions on the outputs; a NaN fulfils none.

        If one fails, the recursion computes the state instead, and finds whether that is an error, to be warned of or
        sound after all. Printed C, which has no recursion, has the bound for singular M in its `units`.
        """
        first, n = self.entries, self.pivots
        conditions = [write.finite(outputs[:first])]
        if n:
            pivots, diagonal = outputs[first : first + n], outputs[first + n : first + 2 * n]
            conditions.append(write.above(pivots, pivot_bound(units, n, dtype), diagonal))
        if (last := len(self.program.outputs)) > first + 2 * n:
            conditions.append(write.finite(outputs[first + 2 * n : last]))
        return conditions
