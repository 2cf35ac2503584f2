"""Simulated motion with its torques and its energy account."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import TIME_ROUNDING, positive_number, read_only, real_numbers
from ..basics.piecewise import Piecewise, cubic, monotone, quintic
from ..basics.spatial import Array
from ..basics.text import UNBROKEN, InNotebooks, counted, listed, numbered_joints, short, wrapped
from ..dynamics.limits import Violation, limit_violations
from ..files.motion_files import MOTORS, read_archive, write_archive, write_columns
from ..model.model import Model

LONGEST = 240  # most characters of the solver's message
SUDDEN = 10.0  # growth between two instants above which an error is taken to grow at once
PARTS, MOST = 16, 100_000  # parts per step; parts of a motion at most
MOST_LOADS = 20_000  # most samples at which a recursion is evaluated


class Derived:
    """Field of a motion that its run computes on access, unless it is given.

    `empty` makes the default for a motion without a run; without `empty` such a motion must be given the field.
    """

    def __init__(self, empty: Callable[[], Any] | None = None) -> None:
        self.empty = empty

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, motion: Any, owner: type) -> Any:
        given = self if motion is None else vars(motion)[self.name]  # itself, the default of the field: not given
        return self if motion is None else motion._derived[self.name] if given is self else given

    def __set__(self, motion: Any, value: Any) -> None:
        vars(motion)[self.name] = value


def derived(empty: Callable[[], Any] | None = None) -> Any:
    """Default of a field that a run computes."""
    return Derived(empty)


def trajectory_lines(motion: Trajectory) -> list[str]:
    """Summary lines: scene and method, end, energies, and the joints whose limits are exceeded."""
    of = "" if motion.model is None else f" of '{short(motion.model.name)}'"
    t, message = motion.t, motion.message
    if len(message) > LONGEST:
        message = f"{message[: LONGEST - 3]}..."
    exceeded: dict[str, list[str]] = {}  # quantities by joint
    for violation in motion.check_limits() if motion.model is not None and len(t) else []:
        exceeded.setdefault(short(violation.joint), []).append(violation.quantity)
    beyond = listed([f"{joint} ({'+'.join(dict.fromkeys(kinds))})" for joint, kinds in exceeded.items()])
    span = f", {t[0]:.6g} to {t[-1]:.6g} s" if len(t) else ""
    ends = f"energy {motion.energy[0]:.6g} to {motion.energy[-1]:.6g} J, " if len(t) else ""
    return [
        f"Trajectory{of}: {counted(motion.q.shape[1], 'joint')}{span}, {counted(len(t), 'sample')}, "
        f"{motion.method}, {counted(motion.evaluations, 'evaluation')}",
        f"status {motion.status}: {message}",
        f"{ends}largest energy error {motion.energy_drift:.2g} J",
        *([f"limits exceeded, see check_limits(): {beyond.replace(' (', UNBROKEN + '(')}"] if beyond else []),
    ]


@dataclass(frozen=True, eq=False)
class Trajectory(InNotebooks):
    """A simulated motion.

    Attributes
    ----------
    t : ndarray, shape (T,)
        [s]; exactly `t_eval` if it was given, otherwise the solver's steps.
    q, qd, qdd, tau : ndarray, shape (T, n)
        Positions, velocities, accelerations and drive torques [rad or m; rad/s or m/s; rad/s^2 or m/s^2; N m or N].
    kinetic, potential, energy, work : ndarray, shape (T,)
        Energies, springs and the rotors and torsion of elastic joints included, their sum, and the work the drives have
        done since the start [J].
    energy_drift : float
        Largest magnitude of energy - energy at the start - work + dissipated [J]: energy created or lost by the
        solver's errors.
    evaluations : int
        Calls of the right-hand side, those for Jacobians included.
    method : str
        The solver that ran.
    status : int
        0 if completed, 1 if an event of the scene stopped the run, -1 if it failed.
    message : str
        Why this method, and how the run ended.
    dissipated : mapping of str to ndarray, shape (T,)
        Energy dissipated since the start by "viscous" and "coulomb" friction, friction under "load", the damping of
        "springs" and the "joint_damping" of elastic joints, and the work against the "offset" of drives, where the
        scene has them [J].
    controller_state : ndarray, shape (T, m)
        States of the controller, such as the integral of a PID.
    energy_start : float
        Energy at t = 0, which `t_eval` may leave out [J].
    model : Model or None
        The robot that moved, of a scene with payload and without locked joints; for `check_limits`.
    jumps : ndarray, shape (K,)
        Times among `t` at which accelerations or torques jump [s]; `qdd` and `tau` hold the values after the jump.
        Empty if `t_eval` was given.
    qdd_before, tau_before : ndarray, shape (K, n)
        Accelerations and torques just before each of these times [rad/s^2 or m/s^2; N m or N].
    motor_q, motor_qd : ndarray, shape (T, n)
        Positions and velocities of the motors of elastic joints, reflected through the gears; of shape (0, 0) for rigid
        joints, whose motors move with them [rad or m; rad/s or m/s].
    scene : str
        What was simulated, in words.
    at_steps : bool
        True if the samples are the solver's steps or a controller's samples. Between times of `t_eval` the motion is
        interpolated, the less accurately the farther they are apart.
    run : object or None
        The run from which the other attributes are computed on first access.
    error_estimate : callable or None
        Times and the estimated error of the positions until then, both of shape (K,); see `trusted_horizon`.

    Examples
    --------
    >>> import rne
    >>> motion = rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 0.2)
    >>> motion.t[-1].item(), motion.energy_drift < 1e-6
    (0.2, True)
    >>> motion([0.1, 0.2])[0][:, 2].round(3).tolist()  # joint 3 at two times [rad]
    [0.103, 0.398]
    >>> motion.torques(0.1).tolist(), motion.trusted_horizon()
    ([0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.2)
    >>> motion.to_csv("swing.csv"), motion.to_dataframe()["q.joint_2"].max()  # doctest: +SKIP
    >>> file = motion.save("swing.npz")  # doctest: +SKIP
    >>> rne.Trajectory.load(file).message  # doctest: +SKIP
    """

    t: Array
    q: Array
    qd: Array
    evaluations: int
    method: str
    status: int
    qdd: Array = derived()
    tau: Array = derived()
    kinetic: Array = derived()
    potential: Array = derived()
    energy: Array = derived()
    work: Array = derived()
    energy_drift: float = derived()
    message: str = derived()
    dissipated: Mapping[str, Array] = derived(dict)
    controller_state: Array = derived(lambda: np.zeros((0, 0)))
    energy_start: float = derived(float)
    jumps: Array = derived(lambda: np.zeros(0))
    qdd_before: Array = derived(lambda: np.zeros((0, 0)))
    tau_before: Array = derived(lambda: np.zeros((0, 0)))
    motor_q: Array = derived(lambda: np.zeros((0, 0)))
    motor_qd: Array = derived(lambda: np.zeros((0, 0)))
    scene: str = derived(str)
    error_estimate: Callable[[], tuple[Array, Array]] | None = None
    model: Model | None = None
    at_steps: bool = True
    run: Any = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items() if self.run is None else ():
            if isinstance(value, Derived):
                if value.empty is None:
                    raise TypeError(f"Trajectory needs `{name}`")
                vars(self)[name] = value.empty()
        super().__post_init__()

    @cached_property
    def _derived(self) -> dict[str, Any]:
        return {name: read_only(value) for name, value in self.run.derived().items()}

    def __repr__(self) -> str:
        return wrapped("\n  ".join(trajectory_lines(self))).replace(UNBROKEN, " ")

    def __getstate__(self) -> dict[str, Any]:
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return values | {"error_estimate": None, "run": None}  # they may hold laws that do not pickle

    def __copy__(self) -> Trajectory:
        return replace(self)

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations between the samples, so that the motion can serve as a reference.

        Parameters
        ----------
        t : float or array_like, shape (T,) or (..., 1)
            Times within the motion [s]; an array whose last axis has length one holds one time per state.

        Returns
        -------
        q, qd, qdd : ndarray, shape (n,) for one time, (T, n) for T times, (..., n) for times of shape (..., 1)
            [rad or m; rad/s or m/s; rad/s^2 or m/s^2]. At a jump the values after it.

        Raises
        ------
        ValueError
            If the motion has no samples, or a time is outside the motion or not finite.

        Notes
        -----
        In each step the polynomial of fifth degree through the positions, velocities and accelerations of both samples.
        Between the solver's own steps its error is a few times the tolerance; between distant times of `t_eval` it is
        not bounded.
        """
        q, qd, qdd = self._at(t, "q", "qd", "qdd")
        return q, qd, qdd

    def torques(self, t: ArrayLike) -> Array:
        """Torques of the drives between the samples.

        Parameters
        ----------
        t : float or array_like, shape (T,) or (..., 1)
            Times within the motion [s]; an array whose last axis has length one holds one time per state.

        Returns
        -------
        ndarray, shape (n,) for one time, (T, n) for T times, (..., n) for times of shape (..., 1)
            [N m or N]; at a jump the torques after it.

        Raises
        ------
        ValueError
            If the motion has no samples, or a time is outside the motion or not finite.

        Notes
        -----
        Monotone cubic interpolation, which shows no peak that the samples do not have; torques that are held between
        the samples of a controller stay constant where the motion has these samples, without `t_eval`.
        """
        return self._at(t, "tau")[0]

    def _at(self, t: ArrayLike, *names: str) -> list[Array]:
        """Quantities at times within the motion; a ValueError for other times."""
        if not len(self.t):
            raise ValueError("this motion has no samples")
        times = real_numbers("t", t, "(T,)").astype(np.float64)
        first, last = float(self.t[0]), float(self.t[-1])
        margin = TIME_ROUNDING * abs(last)
        outside = (times < first - margin) | (times > last + margin)
        if outside.any():
            raise ValueError(
                f"`t` must be within the motion, from {first:g} to {last:g} s, got {float(times[outside].flat[0]):g}"
            )
        shape = times.shape[:-1] if times.ndim and times.shape[-1] == 1 else times.shape
        times = np.clip(times, first, last).reshape(-1)
        return [self._curves[name](times).reshape(*shape, self.q.shape[1]) for name in names]

    @cached_property
    def _curves(self) -> dict[str, Piecewise]:
        """Positions, velocities, accelerations and torques as functions of times (T,), piecewise between jumps."""
        keep = np.append(True, np.diff(self.t) > 0)
        t, q, qd, qdd, tau = (x[keep] for x in (self.t, self.q, self.qd, self.qdd, self.tau))
        motor_q, motor_qd = (self.motor_q[keep], self.motor_qd[keep]) if self.motor_q.size else (q, qd)
        names = "q", "qd", "qdd", "tau", "qdd of reports", "motor_q", "motor_qd"
        if len(t) == 1:
            values = q, qd, qdd, tau, qdd, motor_q, motor_qd
            return {name: Piecewise(np.append(t, t + 1), x[None]) for name, x in zip(names, values, strict=True)}
        jumps = np.searchsorted(t, self.jumps)
        positions = quintic(t, q, qd, *_step_ends(qdd, jumps, self.qdd_before))
        velocities = positions.derivative()
        pairs = (tau, self.tau_before), (qdd, self.qdd_before)
        others = (monotone(t, *_step_ends(after, jumps, before), jumps) for after, before in pairs)
        motor = cubic(t, motor_q[:-1], motor_q[1:], motor_qd[:-1], motor_qd[1:]) if self.motor_q.size else positions
        curves = positions, velocities, velocities.derivative(), *others, motor, motor.derivative()
        return dict(zip(names, curves, strict=True))

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times of the jumps, at which a simulation with this motion as its reference ends a step [s]."""
        return tuple(self.jumps.tolist())

    def trusted_horizon(self, accuracy: float = 1e-3) -> float:
        """Time up to which the solver's tolerances keep every joint within `accuracy` [s].

        The run is repeated with a hundredth of the tolerances, from a state changed by one rounding. Chaos, unstable
        equilibria and instants of switching make errors grow; after this time the trajectory is no longer that of the
        given initial state.

        Parameters
        ----------
        accuracy : float
            Largest error of a joint's position [rad or m].

        Returns
        -------
        float
            An estimate, accurate to a few percent where errors grow; the end of the motion if the error stays smaller.

        Raises
        ------
        ValueError
            If `accuracy` is not positive, or after pickling, which forgets the scene.

        Notes
        -----
        A pulse that the solver stepped over, because `breaks` does not name it, may not be seen here either. A law with
        memory must begin anew when it is called with t = 0.
        """
        bound = positive_number("accuracy", accuracy)
        if self.error_estimate is None:
            raise ValueError(
                "this trajectory was pickled or loaded from a file, and has forgotten its scene: repeat the simulation"
            )
        return _horizon(bound, *self.error_estimate())

    def check_limits(self) -> list[Violation]:
        """Times and joints at which the motion exceeds the ranges, speeds and efforts of its robot.

        Returns
        -------
        list of Violation
            One for each limit exceeded, at the solver's steps, between them and on both sides of jumps, or at the
            times of `t_eval`, in the order of the joints; `print(*violations, sep="\\n")` shows them. Joints that mimic
            others are examined too, except for their torques, which are not known.

        Raises
        ------
        ValueError
            If the trajectory was made without a model.

        Examples
        --------
        >>> import rne
        >>> swing = rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 2.0)
        >>> [v.joint for v in swing.check_limits() if v.quantity == "velocity"][:2]
        ['joint_2', 'joint_3']
        """
        if self.model is None:
            raise ValueError("this trajectory has no model: give it one by dataclasses.replace(trajectory, model=...)")
        if not self.at_steps or len(self.t) < 2:
            return limit_violations(self.model, self.t, self.q, self.qd, self.tau)
        parts = int(np.clip(MOST // len(self.t), 1, PARTS))
        fractions = np.linspace(0, 1, parts + 1)  # of each step, both ends included
        (t, q), (_, qd), (_, tau) = (self._curves[name].at_fractions(fractions) for name in ("q", "qd", "tau"))
        return limit_violations(self.model, t, q, qd, tau)

    @property
    def balance(self) -> Array:
        """Energy error over time, energy - initial energy - work + dissipated: the solver's error, shape (T,) [J]."""
        taken = sum(self.dissipated.values(), np.zeros(len(self.t)))
        return self.energy - self.energy_start - self.work + taken

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the motion, its model and its scene's description to a NumPy archive.

        Parameters
        ----------
        path : str or path-like
            Ending in .npz, in an existing folder.

        Returns
        -------
        pathlib.Path
            The file written; `Trajectory.load` reads it. It names no file: to see the meshes of a robot's file with
            the motion that is read, give `rne.view` the robot, and `t` and `q`. Joints that follow others by
            `rne.model.coupled` or a linkage are saved with the functions they follow by, as traced operations.

        Raises
        ------
        ValueError
            If `path` does not end in .npz, or the arrays take more than 512 MiB, the most that is read.
        FileNotFoundError
            If its folder does not exist.
        """
        return write_archive(path, self)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Trajectory:
        """Read a motion that `save` has written; every number is the same.

        Parameters
        ----------
        path : str or path-like
            The file.

        Returns
        -------
        Trajectory
            Without its scene's controller, which `trusted_horizon` needs.

        Raises
        ------
        ValueError
            If the file is no such archive, or a damaged one, or an entry of it is missing, unknown, of the wrong shape
            or type or not finite, or the times do not ascend.
        FileNotFoundError
            If there is no such file.
        """
        if not isinstance(path, str | PathLike):
            raise TypeError(f"`path` must be a str or path-like, got {type(path).__name__}")
        motion: Trajectory = read_archive(path, cls)
        return motion

    def to_csv(self, path: str | PathLike[str]) -> Path:
        """Write times, positions, velocities, accelerations and torques as comma-separated values.

        Parameters
        ----------
        path : str or path-like
            In an existing folder.

        Returns
        -------
        pathlib.Path
            The file written: a heading `"t"`, `q.<joint>`, `qd.<joint>`, `qdd.<joint>`, `tau.<joint>`, then one row per
            sample in SI units, with all digits; with elastic joints `motor_q.<joint>` and `motor_qd.<joint>` follow.
            `rne.trajectories.read_csv` reads what belongs to the joints.

        Raises
        ------
        FileNotFoundError
            If its folder does not exist.
        """
        return write_columns(path, self.t, self._columns())

    def to_dataframe(self) -> Any:
        """Times, positions, velocities, accelerations and torques as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            Indexed by the time `t` [s], with the columns that `to_csv` writes.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        try:
            import pandas
        except ModuleNotFoundError:
            raise ImportError("`to_dataframe` needs pandas, which is not installed: pip install pandas") from None
        return pandas.DataFrame(self._columns(), index=pandas.Index(self.t, name="t"))

    def _columns(self) -> dict[str, Array]:
        names = numbered_joints(self.q.shape[1]) if self.model is None else self.model.joint_names
        parts = ("q", "qd", "qdd", "tau", *(MOTORS if self.motor_q.size else ()))
        return {f"{part}.{name}": getattr(self, part)[:, k] for part in parts for k, name in enumerate(names)}


def _horizon(bound: float, t: Array, error: Array) -> float:
    """Time at which an error first exceeds a bound, interpolated exponentially unless it grows by much."""
    beyond = np.flatnonzero(~(error <= bound))
    if not len(beyond):
        return float(t[-1])
    k = int(beyond[0])
    if k == 0:
        return float(t[0])
    if not (np.isfinite(error[k]) and error[k] < SUDDEN * error[k - 1]):
        return float(t[k - 1])
    part = np.log(bound / error[k - 1]) / np.log(error[k] / error[k - 1])
    return float(t[k - 1] + part * (t[k] - t[k - 1]))


def samples_of(motion: Trajectory, times: Array) -> tuple[Array, ...]:
    """t, q, qd, qdd and tau of a motion for reports: samples, values before jumps and those at further times.

    The time of a jump occurs twice, first with the values before it. Between times of `t_eval` nothing is known and
    nothing added. Accelerations are monotone between the solver's steps as torques are: the second derivative of an
    interpolant shows the solver's errors over the square of its step.
    """
    known = motion.t, motion.q, motion.qd, motion.qdd, motion.tau
    if not motion.at_steps or len(motion.t) < 2:
        return known
    inside = times[motion.t[np.clip(np.searchsorted(motion.t, times), 0, len(motion.t) - 1)] != times]
    k = np.searchsorted(motion.t, motion.jumps)
    before = [x.reshape(len(k), motion.q.shape[1]) for x in (motion.qdd_before, motion.tau_before)]
    added = inside, *motion._at(inside, "q", "qd", "qdd of reports", "tau")
    jumping = motion.jumps, motion.q[k], motion.qd[k], *before
    samples = [np.concatenate(parts) for parts in zip(added, jumping, known, strict=True)]
    order = np.argsort(samples[0], kind="stable")
    return tuple(x[order] for x in samples)


def motors_at(motion: Trajectory, t: Array) -> tuple[Array, Array]:
    """Motor positions and velocities at times of a motion; those of the joints if these are rigid."""
    motor_q, motor_qd = motion._at(t, "motor_q", "motor_qd")
    return motor_q, motor_qd


def between(t: Array, most: int = PARTS, samples: int = MOST) -> Array:
    """Times of samples and between them: up to `most` parts per step, `samples` in all."""
    if len(t) < 2:
        return t
    parts = int(np.clip(samples // len(t), 1, most))
    inside = t[:-1, None] + np.diff(t)[:, None] * (np.arange(parts) / parts)
    return np.append(inside.reshape(-1), t[-1])


def _step_ends(after: Array, jumps: Array, before: Array) -> tuple[Array, Array]:
    """Values at the start and end of each step, the latter before a jump."""
    ends = after[1:].copy()
    if len(jumps):
        ends[jumps - 1] = before
    return after[:-1], ends
