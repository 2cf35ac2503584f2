"""Rodas5P in machine code as a solver of the simulation loop: stiff motions whose law is traced, or sampled.

What the compiled loop cannot decide, a state that must be examined, is one step of the same loop run by the interpreter
around the recursion, which names what is wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError
from ..kernels.loops import compiled
from ..kernels.rosenbrock import TABLEAU, inside, take_steps, workspace
from .compiled import CompiledSolver
from .plant import Plant
from .solver import Steps

METHOD = "Rodas5P"
compiled_steps = compiled(take_steps)
FIRST = 1e-6  # of the time to go: a first step to try, from which they grow tenfold


def is_available(plant: Plant) -> bool:
    """True if the equations of motion and their slopes are machine code and no joint sticks."""
    friction = plant.rhs.friction
    sticks = friction is not None and friction.sticks
    return plant.is_compiled and not sticks and plant.rhs.residual.slopes_in_time.is_unrolled


class RosenbrockSteps(Steps):
    """Steps of Rodas5P, with the vectors of their interpolants."""

    def __init__(self, T: Array, X: Array, vectors: Array) -> None:
        super().__init__(T, X)
        self.vectors = vectors

    def states(self, times: Array, k: Array) -> Array:
        """States at times within the steps k, shape (T, size)."""
        s = ((times - self.T[k]) / (self.T[k + 1] - self.T[k]))[:, None]
        return inside(self.X[k], self.X[k + 1], self.vectors[k], s)


class RosenbrockSolver(CompiledSolver):
    """Rodas5P, many steps per call.

    Parameters
    ----------
    rtol, atol : float
    plant : Plant
        One for which it `is_available`.
    """

    def __init__(self, rtol: float, atol: float, plant: Plant) -> None:
        self.method, self.rtol, self.atol, self.plant = METHOD, rtol, atol, plant
        self.slopes = plant.rhs.residual.slopes_in_time
        self.functions: tuple[Any, Any] = (plant.kernel.address(), self.slopes.address())
        self.h, self.longest = 0.0, np.inf

    def steps(self, most: int) -> Steps:
        """The next steps, at most so many; NotFiniteError if there is none."""
        steps = self._take(most, compiled_steps, self.functions)
        if len(steps.T) == 1:
            with np.errstate(all="ignore"):
                steps = self._take(1, take_steps, (self._rates, self._slopes))
        if len(steps.T) == 1:
            raise NotFiniteError(f"{METHOD} gave up: steps would be shorter than the rounding of times", self.t)
        return steps

    def _take(self, most: int, loop: Callable[..., int], functions: tuple[Any, Any]) -> Steps:
        plant, n, size = self.plant, self.plant.robot.n, len(self.x)
        T, X, H, P = np.empty(most + 1), np.empty((most + 1, size)), np.empty(most + 1), np.empty((most, 3, size))
        T[0], X[0], H[0] = self.t, self.x, self.h or FIRST * (self.end - self.t)
        count, held = np.zeros(2, dtype=np.int64), () if plant.held is None else (np.array(plant.held),)
        limits = float(self.end), float(self.longest), self.rtol, self.atol, *map(float, plant.span)
        time, x = np.empty(1), np.empty(size)
        point = time, x, np.empty(n), *held
        work = workspace(n, size)
        taken = loop(*functions, (time, x, *held), point, limits, TABLEAU, T, X, P, H, count, work)
        plant.evaluations += int(count[0]) + size * int(count[1])
        self.t, self.x, self.h = float(T[taken]), X[taken], float(H[taken])
        return RosenbrockSteps(T[: taken + 1], X[: taken + 1], P[:taken])

    def _rates(self, t: Array, x: Array, *rest: Array) -> bool:
        """dx/dt, under held torques, into the last array."""
        rest[-1][:] = self.plant.rates(float(t[0]), x, rest[0] if len(rest) == 2 else None)
        return True

    def _slopes(self, *arguments: Array) -> bool:
        """The slopes of the equations of motion into the last array."""
        arguments[-1][:] = self.slopes(*arguments[:-1])
        return True
