"""The search for an exciting motion: sequential quadratic programming from the best of many random motions."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ...basics.spatial import Array
from .criteria import Condition, Determinant, Observation
from .series_limits import SeriesLimits

LOGGER = logging.getLogger("rne")
FTOL = 1e-4  # change of the criterion's log at which the optimiser stops
COARSE = 1e-3  # the same, of stages before the last
BISECTIONS = 20
NOT_BETTER = "no run found a better motion than the best random ones"

Criterion = Condition | Determinant
Progress = Callable[[int, int, float], Any]  # (start, iteration, condition number or log det)


class Found(NamedTuple):
    """A series that keeps its limits, with the exact criterion and what the optimiser said when it found it."""

    x: Array
    value: float
    converged: bool
    message: str


@dataclass(frozen=True, eq=False)
class Search:
    """Series x of least criterion within limits.

    Attributes
    ----------
    within : SeriesLimits
    observation : Observation
    samples : int
        Times of one period at which W is taken.
    exact : Condition or Determinant
        What is to be minimised.
    stages : tuple of Condition or Determinant
        Smooth criteria minimised one after the other.
    iterations : int
        The most of each run.
    progress : callable or None
    """

    within: SeriesLimits
    observation: Observation
    samples: int
    exact: Criterion
    stages: tuple[Criterion, ...]
    iterations: int
    progress: Progress | None

    @cached_property
    def _grid(self) -> tuple[Array, Array, Array]:
        return self.within.basis.grid(self.samples)

    def matrix(self, x: Array) -> Array:
        """W of a series, or of several."""
        return self.observation.matrix(self.within.states(x, self._grid))

    def value(self, x: Array) -> float:
        """The exact criterion."""
        return self.exact.value(self.matrix(x))

    def gradient(self, criterion: Criterion, x: Array) -> Array:
        """Derivatives of a criterion by x, exact: W's by q, qd and qdd, which are linear in x."""
        states = self.within.states(x, self._grid)
        slopes = self.observation.slopes(states, criterion.gradient(self.observation.matrix(states)))
        by_coefficients = sum(h.T @ m for h, m in zip(slopes, self._grid, strict=True))
        return self.within.gradient(np.asarray(by_coefficients))

    def run(self, starts: Array) -> Found:
        """The best of several starts: each through the first stage, the best of them through the further ones."""
        first, *further = self.stages
        runs = [self._minimise(first, Found(x, self.value(x), False, NOT_BETTER), k) for k, x in enumerate(starts)]
        best = min(range(len(runs)), key=lambda k: runs[k].value)
        found = runs[best]
        for criterion in further:
            found = self._minimise(criterion, found, best)
        return found

    def _minimise(self, criterion: Criterion, start: Found, number: int) -> Found:
        """One run of SLSQP; where it ends no better than it started, the start."""
        from scipy.optimize import minimize

        iteration = 0

        def tick(x: Array) -> None:
            nonlocal iteration
            iteration += 1
            if self.progress is not None:
                self.progress(number, iteration, self.exact.measure(self.matrix(x)))

        run = minimize(
            lambda x: criterion.value(self.matrix(x)),
            start.x,
            jac=lambda x: self.gradient(criterion, x),
            constraints=self._constraints(),
            method="SLSQP",
            callback=tick,
            options={"maxiter": self.iterations, "ftol": FTOL if criterion is self.stages[-1] else COARSE},
        )
        x = self._held(start.x, run.x)
        value = self.value(x)
        LOGGER.info("excitation, start %d: %s after %d iterations", number, run.message, run.nit)
        if x is start.x or not value <= start.value:
            return start
        return Found(x, value, bool(run.success), str(run.message))

    def _constraints(self) -> list[dict[str, Any]]:
        A, within = self.within.rows, self.within
        found: list[dict[str, Any]] = [{"type": "ineq", "fun": lambda x: 1 - A @ x, "jac": lambda x: -A}]
        if len(within.driven):
            grid = self._grid
            torques = {
                "fun": lambda x: within.torque_slack(x, grid),
                "jac": lambda x: within.torque_slack_slopes(x, grid),
            }
            found.append({"type": "ineq", **torques})
        return found

    def _held(self, start: Array, end: Array) -> Array:
        """The farthest series on the line from a start, which keeps its limits, to the optimiser's end that does."""
        if not np.isfinite(end).all():
            return start
        if self.within.holds(end):
            return end
        kept, broken = 0.0, 1.0
        for _ in range(BISECTIONS):
            middle = (kept + broken) / 2
            kept, broken = (middle, broken) if self.within.holds(start + middle * (end - start)) else (kept, middle)
        held: Array = start + kept * (end - start)
        return held if kept else start
