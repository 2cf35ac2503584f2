"""Common classes of the integrators: steps, systems, solvers and the exceptions that end a run.

A system is dx/dt = f(t, x, u) whose inputs u may be held over a segment; `simulation` makes systems of robots.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError, SingularMassMatrixError
from ..kernels.kernel import Kernel
from .loops import StateUpdate
from .step_control import EPS, Interval

Interpolant = Callable[[Array | float], Array]  # a time gives (size,), times of shape (m,) give (size, m)

IMPLICIT = ("Radau", "BDF", "LSODA")
RODAS = "Rodas5P"  # the method that is not SciPy's
SAME = 8 * EPS  # relative tolerance within which times are equal
FAILURES = (NotFiniteError, SingularMassMatrixError, ArithmeticError)  # exceptions that end a run


class GaveUpError(NotFiniteError):
    """Raised by a method that needs steps shorter than the rounding of times."""


@dataclass(frozen=True)
class IntegrationOptions:
    """Options of an initial value problem: tolerances, step lengths, times to report, breaks."""

    method: str
    rtol: float  # relative and absolute tolerance of the state, per step
    atol: float
    t_eval: Array | None = None  # (S,), times to report, ascending; None for the ends of steps
    breaks: Array = field(default_factory=lambda: np.zeros(0))  # at which f jumps, ascending


class Implicit(NamedTuple):
    """Equations of motion R(t, x, a, u) = 0, linear in a, which are solved for a system's rates.

    The state is x = (q, qd, z, e): n coordinates, their rates, further states, integrals. The first n rows of R are
    M a - forces, with the mass matrix M = dR/da, which is not singular, and a = d(qd)/dt; the others are the rates of
    (z, e), which do not depend on a. `slopes` gives dR/dx, dR/da and dR/dt side by side, (size - n, size + n + 1), of
    (t, x, a) and what the system holds.
    """

    n: int
    slopes: Kernel


class System(Protocol):
    """Initial value problem dx/dt = f(t, x, u, numbers); the contract between systems and solvers:

    1. The first `counted` entries of the state x, (size,), are controlled to the tolerances. The others are integrals,
       such as energies: their rates depend only on the first, and their errors are relative to `integral_scale` plus
       their own size. Where the scale is infinite they do not count.
    2. f is evaluated only within `span`, which the system sets before a solver starts or resumes: it lies on one side
       of each jump of f, except those that the solver takes as `breaks`. A solver whose stage is outside takes the
       closest time of `span`.
    3. `held` is u, or None of an f without inputs. It stays as it is from `start` or `resume` until the solver has
       reached the end that it was given; a solver that samples a law itself changes its own copy.
    4. `kernel` is f for loops: of t, (1,), x, u where there is one, and `Kernel.coefficients` of `numbers`, (p,), which
       stay the same over a run, it gives `width` numbers: dx/dt, then numbers that solvers do not read. Where its
       result is not certain, it returns False, and the solver calls `rates`, which computes it by another method or
       raises an error with the cause.
    5. `evaluations` counts calls of f. Calling the system adds 1, and `jacobian` its own; code that runs `kernel` in a
       loop, or calls `rates`, adds those.
    6. `jacobian` is df/dx at (t, x) under what is held, (size, size); its columns of integrals are 0.
    7. Where `table` has rows, f takes the one that holds at t, begin and end first, as an argument before the numbers:
       pieces of a motion that f follows.
    8. `implicit` has the same motion as equations with a mass matrix, for methods that solve with it instead of M^-1.
    """

    numbers: Array
    table: Array
    span: tuple[float, float]
    evaluations: int
    width: int

    @property
    def counted(self) -> int: ...

    @property
    def integral_scale(self) -> float: ...

    @property
    def held(self) -> Array | None: ...

    @property
    def kernel(self) -> Kernel: ...

    @property
    def implicit(self) -> Implicit: ...

    def __call__(self, t: float, x: Array) -> Array:
        """dx/dt under the inputs that are held, counted."""

    def rates(self, t: float, x: Array, u: Array | None) -> Array:
        """dx/dt under given inputs; errors have the cause."""

    def jacobian(self, t: float, x: Array) -> Array:
        """df/dx under the inputs that are held."""


class Sampler(Protocol):
    """Sampled control law: its commands are held as inputs of the system, each until the next one acts."""

    period: float  # time between two samples
    update: StateUpdate  # of the law's states
    delay: tuple[float, float]  # from a sample until its command acts: a whole number of periods, and a remainder [s]
    count: int  # samples so far
    arrived: int  # commands so far that act or have acted
    pending: Array  # (p, n), the last commands; that of sample k in row k % p
    state: Array  # (m,), of the law, at the last sample
    next_state: Array  # (m,), at the next one
    numbers: Any  # the last argument of `traced`, as `System.numbers`
    law_table: Array  # of the pieces that `traced` takes, as `System.table`
    traced: Any  # the kernel of the law, where it is traced, or None

    @property
    def next(self) -> float:
        """Time of the next sample or the next command, whichever is first."""

    def bounds(self) -> Array:
        """Bounds of the commands, and of their change from one sample to the next, shape (2, n)."""

    def renew(self, t: float, x: Array) -> None:
        """Take the sample, and have the command act, that are due."""

    def note(self, samples: tuple[Array, ...], acting: tuple[Array, ...], states: Array, evaluations: int) -> None:
        """Append samples (t, x, u, z) taken in machine code and, from times on, at states, commands (t, x, u).

        With the law's states at the last and the next sample; `pending` is as the loop has left it.
        """


class Steps:
    """Steps of a solver that follow one another, and the motion inside them.

    T, of shape (k + 1,), has the ends of the steps [s], X, of shape (k + 1, size), the states there.
    """

    U: Array | None = None  # inputs held in each step, where samples were taken between them

    def __init__(self, T: Array, X: Array) -> None:
        self.T, self.X = T, X

    def states(self, times: Array, k: Array) -> Array:
        """States at times within the steps numbered k, shape (m, size)."""
        raise NotImplementedError

    @property
    def jumps(self) -> list[bool]:
        """True for each of k steps if held inputs change where it begins."""
        return [False] * (len(self.T) - 1)

    def inside(self, k: int) -> Interpolant:
        """The states inside one step: (size,) at a time, (size, m) at times of shape (m,)."""

        def interpolant(t: Array | float) -> Array:
            times = np.asarray(t, dtype=np.float64)
            states = self.states(times.reshape(-1), np.full(times.size, k)).T
            return states if times.ndim else states[:, 0]

        return interpolant


class Solver(ABC):
    """Base of methods that step along a system and restart; a new one implements `steps` and extends `resume`."""

    note = ""  # for the message of a run
    tableau: Any = ()
    takes_samples = False  # True if a law is sampled between the steps of one call
    takes_breaks = False  # True if the steps of one call end at the breaks of the options

    def __init__(self, options: IntegrationOptions) -> None:
        self.options, self.h, self.max_step = options, 0.0, np.inf

    def start(self, system: System, t: float, x: Array, end: float, max_step: float = np.inf) -> None:
        """Begin at time t, where no step before says how long the first one is to be."""
        self.resume(system, t, x, end)
        self.h, self.max_step = 0.0, max_step

    def resume(self, system: System, t: float, x: Array, end: float) -> None:
        """Restart after a change of the inputs, with the last step's length, or the whole interval's without one."""
        self.system, self.t, self.x, self.end, self.h = system, t, x, end, self.h or end - t

    @property
    def is_running(self) -> bool:
        """False at the end of the interval."""
        return self.t < self.end

    def interval(self) -> Interval:
        """Remaining interval, as loops take it."""
        (first, last), options, system = map(float, self.system.span), self.options, self.system
        scale = float(system.integral_scale) if len(self.x) > system.counted else np.inf
        tolerances = options.rtol, options.atol, system.counted, float(self.max_step), scale
        whole = Interval(self.tableau, float(self.t), float(self.end), first, last, *tolerances)
        whole = whole._replace(table=system.table) if len(system.table) else whole
        return whole._replace(breaks=self.breaks_within(whole)) if len(options.breaks) else whole

    def breaks_within(self, whole: Interval) -> Array:
        """Breaks in an interval, its start included, each with the neighbouring floats before and after, (k, 3)."""
        t = self.options.breaks
        inner = t[(t >= whole.begin) & (t < whole.end)] if self.takes_breaks else t[:0]
        return np.column_stack([inner, np.nextafter(inner, -np.inf), np.nextafter(inner, np.inf)])

    @abstractmethod
    def steps(self, max_steps: int) -> Steps:
        """Next steps, at most this many; NotFiniteError if there is none."""
