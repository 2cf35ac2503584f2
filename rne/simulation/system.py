"""What the simulation loop asks of the equations of motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from ..basics.spatial import Array
from .events import Event
from .solver import Steps


class System(Protocol):
    """Equations of motion that a solver integrates, and what may switch in them.

    `Plant` is that of a scene in which nothing switches by itself, `DryPlant` of one with friction that sticks, and
    `Hamilton` of a free motion in (q, p).

    Attributes
    ----------
    events : sequence of callable
        What ends a segment, beside samples, breaks and stops.
    at_rest : ndarray or None
        Entries of the state that are held at zero.
    has_changed : bool
        True if the equations changed at the beginning of the segment, so that the solver starts anew.
    note : str
        For the message of a run.
    """

    events: Sequence[Event]
    at_rest: Array | None
    has_changed: bool
    note: str

    def start(self, x: Array) -> Array:
        """The solver's state at the start of a run, of (q, qd, z)."""

    def begin(self, t: float, x: Array, span: tuple[float, float]) -> None:
        """Prepare for a segment that begins at t; torques are evaluated within `span`."""

    def after(self, event: Event, x: Array) -> Array:
        """The state with which motion goes on after one of `events`."""

    def longest_step(self, duration: float) -> float:
        """Longest step that the solver may take in a run of this duration [s]."""

    def reported(self, x: Array) -> Array:
        """The state to report of a solver's state."""

    def accelerations_at(self, t: Array, X: Array, same: float) -> Array | None:
        """Accelerations to report, (T, n), at times (T,), where they do not follow from time, state and torques.

        Times up to a relative rounding `same` before a sample count as being there.
        """

    def states(self, X: Array) -> Array:
        """All reported states, shape (T, size), as (q, qd, z)."""


class SmoothSystem:
    """What a System answers in which nothing switches by itself."""

    events: Sequence[Event] = ()
    at_rest: Array | None = None
    has_changed = False
    note = ""

    def start(self, x: Array) -> Array:
        """The solver's state is (q, qd, z)."""
        return x

    def begin(self, t: float, x: Array, span: tuple[float, float]) -> None:
        """Nothing to prepare."""

    def after(self, event: Event, x: Array) -> Array:
        """The motion goes on as it was."""
        return x

    def longest_step(self, duration: float) -> float:
        """Any step."""
        return float("inf")

    def reported(self, x: Array) -> Array:
        """The state itself."""
        return x

    def accelerations_at(self, t: Array, X: Array, same: float) -> Array | None:
        """They follow from time, state and torques."""
        return None

    def states(self, X: Array) -> Array:
        """The states themselves."""
        return X


class Stepper(Protocol):
    """A solver, a few steps at a time."""

    @property
    def is_running(self) -> bool: ...

    def start(self, system: Any, t: float, x: Array, end: float, longest: float) -> None:
        """Begin anew at time t."""

    def resume(self, system: Any, t: float, x: Array, end: float) -> None:
        """Go on after a jump of the torques."""

    def steps(self, most: int) -> Steps:
        """The next steps, at most so many and at least one."""
