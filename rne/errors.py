"""The package's own exceptions. A plain mistake in an array argument stays a ValueError."""

from __future__ import annotations

from typing import Any

from numpy.linalg import LinAlgError


class RneError(Exception):
    """Base class of every exception that only this package raises."""


class ModelError(RneError, ValueError):
    """A robot model that contradicts itself or that an algorithm does not cover."""


class UrdfError(ModelError):
    """An error in a URDF file; the message names the file, the element and the attribute.

    Attributes
    ----------
    finding : rne.urdf.Finding or None
        The finding behind the error, with its line and how to fix it.
    """

    def __init__(self, message: str, finding: Any = None) -> None:
        super().__init__(message)
        self.finding = finding


class NotFiniteError(RneError, ValueError):
    """A result, state or torque that overflowed or is NaN.

    Attributes
    ----------
    time : float or None
        The time in a simulation [s].
    """

    def __init__(self, message: str, time: float | None = None) -> None:
        super().__init__(message)
        self.time = time


class SingularMassMatrixError(RneError, LinAlgError):
    """Forward dynamics of a state in which some combination of joint motions moves no inertia.

    Attributes
    ----------
    joints : tuple of str
        The joints of that combination.
    state : tuple of int
        Which state of a batch; empty for a single one.
    """

    def __init__(self, what: str, cause: str = "", joints: tuple[str, ...] = (), state: tuple[int, ...] = ()) -> None:
        super().__init__(what, cause, joints, state)
        self.what, self.cause, self.joints, self.state = what, cause, joints, state

    def __str__(self) -> str:
        return f"{self.what}{f' at state {self.state}' if self.state else ''}{self.cause}"

    def at(self, state: tuple[int, ...]) -> SingularMassMatrixError:
        """The same error for another state of a batch."""
        return SingularMassMatrixError(self.what, self.cause, self.joints, state)


class PrecisionWarning(UserWarning):
    """A result in which rounding has left few digits or none."""


class SimulationError(RneError, RuntimeError):
    """A simulation that did not reach its end time.

    Attributes
    ----------
    time : float
        The time of the failure [s].
    trajectory : rne.Trajectory
        The motion up to the last successful step.
    """

    def __init__(self, message: str, time: float, trajectory: Any) -> None:
        super().__init__(message)
        self.time = time
        self.trajectory = trajectory

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.time, self.trajectory)
