"""A motion that excites the parameters: the reference that `rne.excitation` returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import positive_number, whole_number
from ...basics.spatial import Array
from ...basics.text import counted, short, wrapped
from ...robot import Robot
from ...simulation.motion_files import write_columns
from ...trajectories import Samples
from ...trajectories.profiles import broadcast_times
from .fourier import FourierBasis

ACTIVE = 0.97  # share of a limit from which it is called active


@dataclass(frozen=True, eq=False)
class Excitation:
    """A periodic motion for the identification of a robot, made by `rne.excitation`.

    q(t) = q0 + sum over k of a_k / (k w) sin(k w t) - b_k / (k w) cos(k w t), with w = 2 pi / duration. It is a
    reference f(t) -> (q, qd, qdd), and repeats itself after `duration`.

    Attributes
    ----------
    robot : Robot
        The robot it is made for.
    duration : float
        The period [s].
    q0 : ndarray, shape (n,)
        Mean positions [rad or m].
    a, b : ndarray, shape (n, H)
        Amplitudes of the rates' cosines and sines [rad/s or m/s].
    criterion : {"condition", "d-optimal"}
        What was minimised.
    condition : float
        Condition number of W, whose rows are the torques of the samples and whose columns are the base parameters, each
        divided by its norm if that was asked for.
    log_det : float
        log det(W^T W), which grows as the confidence ellipsoid of the parameters shrinks.
    random : ndarray
        What the criterion, `condition` or `log_det`, is of random motions within the same limits.
    limit_use : mapping of str to ndarray, shape (n,)
        The largest share of the limits of "position", "rate", "acceleration" and "torque" that the motion uses.
    converged : bool
        False if the optimiser stopped early or found nothing better than a random motion; the motion keeps its limits
        all the same.
    message : str
        What the optimiser said when it found the motion.

    Examples
    --------
    >>> import rne
    >>> motion = rne.excitation(rne.load("irb140").locked({"joint_4": 0, "joint_5": 0, "joint_6": 0}), 4.0, 3)
    >>> q, qd, qdd = motion(0.0)
    >>> q.shape, bool(motion.condition < motion.random.min())
    ((3,), True)
    """

    robot: Robot
    duration: float
    q0: Array
    a: Array
    b: Array
    criterion: str
    condition: float
    log_det: float
    random: Array
    limit_use: Mapping[str, Array]
    converged: bool
    message: str

    @property
    def harmonics(self) -> int:
        """The number H of harmonics."""
        return int(self.a.shape[1])

    @property
    def active(self) -> tuple[str, ...]:
        """Limits of which the motion uses 97 % and more, such as "rate of joint_2"."""
        joints = self.robot.joint_names
        found = [f"{kind} of {joints[k]}" for kind, use in self.limit_use.items() for k in np.flatnonzero(use > ACTIVE)]
        return tuple(found)

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Positions, rates and accelerations at given times.

        Parameters
        ----------
        t : float or array_like, shape (T,) or (..., 1)
            Times [s]. An array whose last axis has length one holds one time per state, as in control laws: it is
            broadcast against joint arrays of shape (..., n). Any other array is an array of times.

        Returns
        -------
        q, qd, qdd : ndarray, shape (n,) for one time, (T, n) for T times, (..., n) for times of shape (..., 1)
            [rad or m], [rad/s or m/s], [rad/s^2 or m/s^2].

        Raises
        ------
        ValueError
            If `t` is not real or not finite.
        """
        w = FourierBasis(self.duration, self.harmonics).frequencies
        phase = broadcast_times(t) * w
        s, c = np.sin(phase), np.cos(phase)
        q = self.q0 + s @ (self.a / w).T - c @ (self.b / w).T
        qd = c @ self.a.T + s @ self.b.T
        qdd = c @ (self.b * w).T - s @ (self.a * w).T
        return q, qd, qdd

    def sample(self, sample_rate: float, periods: int = 1) -> Samples:
        """The motion at equal intervals, as a robot's controller takes it.

        Parameters
        ----------
        sample_rate : float
            Samples per second [Hz].
        periods : int
            How often the motion is repeated.

        Returns
        -------
        Samples
            Times from 0 to the last at or before the end, q, qd and qdd; tau is None. It has no names of joints:
            ``rne.plotting.plot(samples, motion.robot)`` shows those of the robot.

        Raises
        ------
        ValueError
            If an argument is not positive.

        Examples
        --------
        >>> import rne
        >>> motion = rne.excitation(rne.load("irb140").locked({"joint_4": 0, "joint_5": 0, "joint_6": 0}), 4.0, 3)
        >>> motion.sample(100.0).q.shape
        (401, 3)
        """
        step = 1 / positive_number("sample_rate", sample_rate)
        count = int(whole_number("periods", periods) * self.duration / step * (1 + 1e-12)) + 1
        t = np.arange(count) * step
        return Samples(t, *self(t))

    def to_csv(self, path: str | PathLike[str], sample_rate: float, periods: int = 1) -> Path:
        """Write the motion at equal intervals as comma-separated values.

        Parameters
        ----------
        path : str or path-like
            In an existing folder.
        sample_rate : float
            Samples per second [Hz].
        periods : int
            How often the motion is repeated.

        Returns
        -------
        pathlib.Path
            The file written: a heading `t`, `q.<joint>`, `qd.<joint>`, `qdd.<joint>`, then one row per sample in SI
            units, with all digits. `rne.trajectories.read_csv` reads it.

        Raises
        ------
        FileNotFoundError
            If its folder does not exist.

        Examples
        --------
        >>> import rne
        >>> motion = rne.excitation(rne.load("irb140"), 10.0, 5)  # doctest: +SKIP
        >>> file = motion.to_csv("motion.csv", 250.0)  # doctest: +SKIP
        """
        samples, names = self.sample(sample_rate, periods), self.robot.joint_names
        parts = {"q": samples.q, "qd": samples.qd, "qdd": samples.qdd}
        columns = {f"{part}.{name}": np.asarray(x)[:, k] for part, x in parts.items() for k, name in enumerate(names)}
        return write_columns(path, samples.t, columns)

    def __repr__(self) -> str:
        best = self.random.min() if self.criterion == "condition" else self.random.max()
        value = self.condition if self.criterion == "condition" else self.log_det
        kind = "condition number" if self.criterion == "condition" else "log det"
        text = (
            f"Excitation of '{short(self.robot.model.name)}': {self.duration:g} s, "
            f"{counted(self.harmonics, 'harmonic')}, {kind} {value:.4g}; of {len(self.random)} random motions "
            f"{np.median(self.random):.4g} in the median, {best:.4g} at best"
        )
        active = f"; active limits: {', '.join(self.active)}" if self.active else ""
        return wrapped(text + active + ("" if self.converged else f"; not converged: {self.message}"))
