"""What integrators share: the steps that they take, what they ask of a system, and what ends a run.

A system is dx/dt = f(t, x, u) whose inputs u may be held over a segment; `simulation` makes systems of robots.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError, SingularMassMatrixError
from ..kernels.kernel import Kernel

Interpolant = Callable[[Array | float], Array]  # a time gives (size,), times of shape (m,) give (size, m)

IMPLICIT = ("Radau", "BDF", "LSODA")
EXPLICIT = ("RK45", "RK23", "DOP853")
RODAS = "Rodas5P"  # the method that is not SciPy's
SAME = 8 * float(np.finfo(np.float64).eps)  # relative: times that are equal up to rounding
FAILURES = (NotFiniteError, SingularMassMatrixError, ArithmeticError)  # that end a run


class System(Protocol):
    """What is integrated.

    Attributes
    ----------
    held : ndarray or None
        The inputs u of f(t, x, u) that are held over the segment, if it has some.
    span : (float, float)
        Times within which f is evaluated: inside the segment, on this side of its breaks.
    evaluations : int
        Calls of f so far.
    jacobian : callable or None
        df/dx at (t, x), where a solver may use it.
    kernel : Kernel
        f in machine code, or traced.
    """

    span: tuple[float, float]
    evaluations: int

    @property
    def held(self) -> Array | None: ...

    @property
    def jacobian(self) -> Callable[[float, Array], Array] | None: ...

    @property
    def kernel(self) -> Kernel: ...

    def __call__(self, t: float, x: Array) -> Array:
        """dx/dt under the inputs that are held, counted."""

    def rates(self, t: float, x: Array, u: Array | None) -> Array:
        """dx/dt under given inputs; errors name what is wrong."""


class Sampler(Protocol):
    """A law that is sampled: its outputs are held as inputs of the system until the next sample.

    Attributes
    ----------
    period : float
        Time between two samples.
    count : int
        Samples so far.
    state, next_state : ndarray, shape (m,)
        Of the law, at the last sample and the next.
    traced : Any
        The law as a kernel, `traced.kernel`, where it is traced; otherwise None.
    """

    period: float
    count: int
    state: Array
    next_state: Array
    traced: Any

    @property
    def next(self) -> float:
        """Time of the next sample."""

    def bounds(self) -> Array:
        """Bounds of the outputs, and of their change from one sample to the next, shape (2, n)."""

    def sample(self, t: float, x: Array) -> None:
        """Renew the inputs that the system holds."""

    def note(self, samples: tuple[Array, ...], states: Array, evaluations: int) -> None:
        """Samples (t, x, u, z) were taken in machine code, with the law's states at the last and the next one."""


class Steps:
    """Steps of a solver that follow one another, and the motion inside them.

    Parameters
    ----------
    T : ndarray, shape (k + 1,)
        The ends of the steps [s].
    X : ndarray, shape (k + 1, size)
        The states there.
    """

    U: Array | None = None  # torques held in each step, where samples were taken between them

    def __init__(self, T: Array, X: Array) -> None:
        self.T, self.X = T, X

    def states(self, times: Array, k: Array) -> Array:
        """States at times within the steps numbered k, shape (m, size)."""
        raise NotImplementedError

    @property
    def jumps(self) -> list[bool]:
        """Whether torques that are held change where a step begins, of k steps."""
        return [False] * (len(self.T) - 1)

    def inside(self, k: int) -> Interpolant:
        """The states inside one step: (size,) at a time, (size, m) at times of shape (m,)."""

        def interpolant(t: Array | float) -> Array:
            times = np.asarray(t, dtype=np.float64)
            states = self.states(times.reshape(-1), np.full(times.size, k)).T
            return states if times.ndim else states[:, 0]

        return interpolant
