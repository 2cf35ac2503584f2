"""Exceptions of the package. A plain mistake in an array argument stays a ValueError."""

from __future__ import annotations

from typing import Any

from numpy.linalg import LinAlgError


class RneError(Exception):
    """Base class of every exception that only this package raises.

    Examples
    --------
    >>> import rne
    >>> try:
    ...     rne.load("robots/nothing.urdf")
    ... except (rne.RneError, OSError) as error:
    ...     print(type(error).__name__)
    FileNotFoundError
    """


class ModelError(RneError, ValueError):
    """Raised for a robot model that contradicts itself or that an algorithm does not cover.

    Examples
    --------
    >>> import dataclasses, rne
    >>> try:
    ...     dataclasses.replace(rne.irb140(), mass=[-1.0] * 6)
    ... except rne.ModelError as error:
    ...     print(error)
    body of joint 'joint_1': the mass must be 0 or positive, got -1.0
    """


class UrdfError(ModelError):
    """Raised for an error in a URDF file; the message names the file, the element and the attribute.

    Attributes
    ----------
    finding : Finding or None
        The finding that caused the error, with its line and how to fix it.

    Examples
    --------
    >>> import rne
    >>> try:
    ...     rne.load("pyproject.toml")
    ... except rne.UrdfError as error:
    ...     print(error.finding.cure)
    give a URDF file, which begins with <robot ...> or <?xml ...?>
    """

    def __init__(self, message: str, finding: Any = None) -> None:
        super().__init__(message)
        self.finding = finding


class NotFiniteError(RneError, ValueError):
    """Raised for a result, state or torque that overflowed or is NaN.

    Attributes
    ----------
    time : float or None
        The time in a simulation [s].
    state : tuple of int
        Index of the state in a batch, where it is known; empty for a single one.

    Examples
    --------
    >>> import rne
    >>> try:
    ...     rne.dynamics.inverse_dynamics(rne.irb140(), [0] * 6, [1e200] * 6, [0] * 6)
    ... except rne.NotFiniteError as error:
    ...     print(error)
    inverse_dynamics overflows float64 for these arguments; the result is not finite
    """

    def __init__(self, message: str, time: float | None = None, state: tuple[int, ...] = ()) -> None:
        super().__init__(message, time, state)
        self.time, self.state = time, state

    def __str__(self) -> str:
        return f"{self.args[0]}{f' at state {self.state}' if self.state else ''}"


class SingularMassMatrixError(RneError, LinAlgError):
    """Raised for a singular M: some combination of joint motions moves no inertia, or a negative one.

    Attributes
    ----------
    joints : tuple of str
        The joints of that combination.
    state : tuple of int
        Index of the state in a batch; empty for a single one.

    Examples
    --------
    >>> import rne
    >>> robot = rne.Robot(rne.dh_chain(a=[0.3], alpha=[0], d=[0], theta=[0]))  # massless
    >>> try:
    ...     robot.forward_dynamics([0], [0], [1])
    ... except rne.SingularMassMatrixError as error:
    ...     print(error.joints)
    ('joint_1',)
    """

    def __init__(self, what: str, cause: str = "", joints: tuple[str, ...] = (), state: tuple[int, ...] = ()) -> None:
        super().__init__(what, cause, joints, state)
        self.what, self.cause, self.joints, self.state = what, cause, joints, state

    def __str__(self) -> str:
        return f"{self.what}{f' at state {self.state}' if self.state else ''}{self.cause}"


class PrecisionWarning(UserWarning):
    """Warning of a result in which rounding has left few digits or none; `rne.dynamics.diagnose` gives the reason.

    Examples
    --------
    To get an error instead of a warning:

    >>> import warnings, rne
    >>> warnings.simplefilter("error", rne.PrecisionWarning)
    """


class IdentificationWarning(UserWarning):
    """Warning that the model does not explain the measured torques, or that a fault of the log spoils the fit.

    Examples
    --------
    To get an error instead of a warning:

    >>> import warnings, rne
    >>> warnings.simplefilter("error", rne.IdentificationWarning)
    """


class _WithMotion(BaseException):
    def __init__(self, message: str, time: float, trajectory: Any) -> None:
        super().__init__(message)
        self.time = time
        self.trajectory = trajectory

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.time, self.trajectory)


class SimulationError(_WithMotion, RneError, RuntimeError):
    """Raised for a simulation that did not reach its end time.

    Attributes
    ----------
    time : float
        The time of the failure [s].
    trajectory : Trajectory
        The motion up to the last successful step.

    Examples
    --------
    >>> import numpy as np, rne
    >>> def law(t, q, qd):
    ...     return np.full(6, np.nan if t > 0.05 else 0.0)
    >>> try:
    ...     rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 0.1, torque=law)
    ... except rne.SimulationError as error:
    ...     print(error.time > 0.04, error.trajectory.q.shape[1])
    True 6
    """


class SimulationInterrupted(_WithMotion, KeyboardInterrupt):
    """Raised for a simulation that Ctrl-C ended; as a KeyboardInterrupt it passes `except Exception`.

    Attributes
    ----------
    time : float
        The time that was reached, of an ensemble by all motions [s].
    trajectory : Trajectory or Ensemble
        The motion or motions up to then.

    Examples
    --------
    >>> import rne
    >>> def interrupt(t, duration):
    ...     if t > 0.05:
    ...         raise KeyboardInterrupt
    >>> try:
    ...     rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 1.0, method="RK45", progress=interrupt)
    ... except rne.SimulationInterrupted as error:
    ...     print(0.05 < error.time == error.trajectory.t[-1] < 1)
    True
    """


class IdentificationError(RneError, RuntimeError):
    """Raised for a fit to measured motions that did not succeed.

    Examples
    --------
    >>> import rne
    >>> issubclass(rne.IdentificationError, rne.RneError)
    True
    """
