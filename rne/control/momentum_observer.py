"""External torques and contacts from the joints' momentum, without accelerations or force sensors.

The generalised momentum p = M qd changes by p' = tau + C^T qd - g - friction + tau_ext (De Luca and Mattone 2003). What
the model does not explain of its change from sample to sample is the impulse of tau_ext, and the observer's residual

    r' = gain (tau_ext - r)

follows it with the time constant 1 / gain. All of it is linear in the inertial parameters of the model, so that
residuals of robots that bound the real one bound the error of the model's at every instant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import per_joint_array, positive_number, real_array
from ..basics.spatial import Array
from ..basics.text import short, summary
from ..robot import Robot
from ..robot.robot import robot_argument

EXPLAINED = 0.98  # share of the residuals' squares that a payload explains, if it is one
FITTED = 0.2  # [s] after the first contact, over which a payload is fitted
REACH = 0.3  # [m] from the origin of the last link to where point masses stand for a payload


@dataclass(frozen=True, eq=False)
class Residuals:
    """External torques as a `MomentumObserver` sees them, found by its `observe`.

    Attributes
    ----------
    joints : tuple of str
    t : ndarray, shape (T,)
        [s].
    torque : ndarray, shape (T, n)
        Residuals: external torques behind a low-pass filter, and errors of the model [N m or N].
    threshold : ndarray, shape (T, n)
        What the stated errors of model and friction can make of them at most [N m or N].
    payload_mass, payload_share : float
        Mass of the payload that fits the residuals after the first contact best [kg], and the share of their squares
        that it explains; 0 if there is no contact.

    Examples
    --------
    >>> import numpy as np, rne
    >>> arm = rne.load("irb140")
    >>> motion = rne.trajectories.quintic([0] * 6, [1, 0.5, 0, 0, 1, 0], 1.0)
    >>> t = np.linspace(0, 1, 1001)
    >>> tau = arm.inverse_dynamics(*motion(t)) + np.outer(t > 0.5, [0, -30, 0, 0, 0, 0])  # a push of 30 N m
    >>> seen = rne.control.MomentumObserver(arm, floor=5.0).observe(t, *motion(t)[:2], tau)
    >>> seen.kind, bool(0.5 < seen.first_contact < 0.51), seen.torque[-1].round(1)[1].item()
    ('contact', True, 30.0)
    """

    joints: tuple[str, ...]
    t: Array
    torque: Array
    threshold: Array
    payload_mass: float
    payload_share: float

    __repr__ = summary

    @property
    def exceeds(self) -> Array:
        """True where a residual is beyond its threshold, shape (T, n)."""
        return np.asarray(np.abs(self.torque) > self.threshold)

    @property
    def first_contact(self) -> float | None:
        """The first time at which a residual is beyond its threshold [s]; None if there is none."""
        found = np.flatnonzero(self.exceeds.any(1))
        return float(self.t[found[0]]) if len(found) else None

    @property
    def kind(self) -> str | None:
        """What it is: "contact", "payload" if a payload explains 98 % of it, or None.

        In a pose that does not change, a weight at the flange and a push downwards are the same.
        """
        if self.first_contact is None:
            return None
        return "payload" if self.payload_share > EXPLAINED else "contact"

    def __str__(self) -> str:
        if self.first_contact is None:
            share = (np.abs(self.torque) / np.where(self.threshold > 0, self.threshold, np.inf)).max(initial=0)
            return f"No contact; residuals reach {share:.0%} of their thresholds"
        k = int(np.flatnonzero(self.exceeds.any(1))[0])
        names = ", ".join(
            short(name) for name, is_beyond in zip(self.joints, self.exceeds[k], strict=True) if is_beyond
        )
        what = f"a payload of {self.payload_mass:.3g} kg explains {self.payload_share:.0%} of what follows"
        return f"{(self.kind or '').capitalize()} at {self.first_contact:.4g} s, first seen by {names}; {what}"


@dataclass(frozen=True, eq=False)
class MomentumObserver:
    """External torques from positions, velocities and the torques of the drives, by the momentum of the joints.

    Parameters
    ----------
    robot : Robot
        The model, payload included.
    gain : float
        Of the observer; residuals follow external torques with the time constant 1 / gain [1/s].
    friction : Friction, optional
        What the model knows of the friction.
    cases : sequence of Robot, optional
        Robots between which the real one lies; they differ from the model in their bodies' parameters alone.
    friction_error : float
        By which share the friction may differ from the model's.
    floor : float or array_like, shape (n,)
        Added to the thresholds, for noise [N m or N].

    Raises
    ------
    TypeError
        If a robot is none.
    ValueError
        If a case has other joints, or a number is out of its range.

    Notes
    -----
    De Luca and Mattone 2003; Haddadin, De Luca and Albu-Schaeffer 2017, (32). Between samples external torques are the
    change of M qd less the integral of tau + C^T qd - g - friction by the trapezoidal rule; the filter is the bilinear
    one. Thresholds vary with the motion: at each instant the largest difference of a case's residual from the model's,
    and the filtered uncertainty of friction. If the real robot is a mixture of the cases and the model among them, and
    samples are without noise, no residual without a contact exceeds them.

    Examples
    --------
    >>> import numpy as np, rne
    >>> arm = rne.load("irb140")
    >>> light, heavy = (arm.with_parameters(share * arm.parameters) for share in (0.95, 1.05))
    >>> observer = rne.control.MomentumObserver(arm, cases=[light, heavy], floor=0.5)
    >>> motion, t = rne.trajectories.quintic([0] * 6, [1, 0.5, 0, 0, 1, 0], 1.0), np.linspace(0, 1, 1001)
    >>> tau = arm.with_payload(3.0).inverse_dynamics(*motion(t))
    >>> print(observer.observe(t, *motion(t)[:2], tau))  # doctest: +ELLIPSIS
    Payload at 0.00... s, first seen by ...
    >>> law = rne.control.computed_torque(arm, 400, 40, motion)
    >>> scene = rne.Scene(arm, controller=observer.watching(law, law, 1e-3), sample_time=1e-3)
    """

    robot: Robot
    gain: float = 200.0
    friction: Any = None
    cases: Sequence[Robot] = ()
    friction_error: float = 0.0
    floor: ArrayLike = 0.0

    __repr__ = summary

    def __post_init__(self) -> None:
        for case in (self.robot, *self.cases):
            if robot_argument(case).joint_names != self.robot.joint_names:
                raise ValueError("`cases` must have the joints of the robot in its order")
        positive_number("gain", self.gain)
        positive_number("friction_error", self.friction_error, zero_allowed=True)
        object.__setattr__(self, "cases", tuple(self.cases))
        object.__setattr__(self, "floor", per_joint_array("floor", self.floor, self.robot.n, sign="not negative"))

    def observe(self, t: ArrayLike, q: ArrayLike, qd: ArrayLike, tau: ArrayLike, *, held: bool = False) -> Residuals:
        """External torques along samples, such as those of a Record or a Trajectory.

        Parameters
        ----------
        t : array_like, shape (T,)
            Times, at equal intervals [s].
        q, qd, tau : array_like, shape (T, n)
            Positions, velocities and the torques of the drives [rad or m; rad/s or m/s; N m or N].
        held : bool
            True if each torque is held until the next sample, as by a sampled controller.

        Returns
        -------
        Residuals
            With thresholds, the first contact, and whether a payload explains it.

        Raises
        ------
        ValueError
            If the shapes do not match or the intervals are not equal.
        """
        given = (("t", t, "(T,)"), ("q", q, "(T, n)"), ("qd", qd, "(T, n)"), ("tau", tau, "(T, n)"))
        times, positions, rates, torques = (real_array(*x).astype(float) for x in given)
        shape = (len(times), self.robot.n)
        if len(times) < 2 or any(x.shape != shape for x in (positions, rates, torques)):
            raise ValueError(f"`q`, `qd` and `tau` must have shape {shape}, a row for each of at least two times")
        step = (times[-1] - times[0]) / (len(times) - 1)
        if np.abs(np.diff(times) - step).max() > 1e-3 * step:
            raise ValueError("`t` must ascend at equal intervals; rne.identification.Record.prepare resamples")
        found, threshold = self._seen(self._filtered(self._impulses(positions, rates, torques, step, held), step))
        contact = np.flatnonzero((np.abs(found) > threshold).any(1))
        after = slice(contact[0], contact[0] + int(FITTED / step)) if len(contact) else slice(0)
        mass, share = self._payload(positions, rates, found, after, step)
        return Residuals(self.robot.joint_names, times, found, threshold, mass, share)

    def _impulses(self, q: Array, qd: Array, tau: Array, step: float, held: bool) -> Array:
        """What the model, each case and friction's error leave unexplained between samples, (2 + cases, T - 1, n)."""
        impulse, doubt = _between(tau, step, held), np.zeros((len(q) - 1, self.robot.n))
        if self.friction is not None:
            friction = self.friction.torque(self.robot.model, qd)
            impulse = impulse - _between(friction, step, False)
            doubt = self.friction_error * _between(np.abs(friction), step, False)
        unexplained = [_unexplained(robot, q, qd, impulse, step) for robot in (self.robot, *self.cases)]
        return np.stack([*unexplained, doubt])

    def _seen(self, filtered: Array) -> tuple[Array, Array]:
        """Residuals of the model, and their thresholds."""
        found, *cases, doubt = filtered
        spread = np.max([np.abs(case - found) for case in cases], axis=0, initial=0.0)
        return found, spread + doubt + self.floor

    def _filtered(self, impulses: Array, step: float) -> Array:
        """r' = gain (tau_ext - r) from the impulses of tau_ext, by the bilinear rule; r = 0 at the first sample."""
        from scipy.signal import lfilter

        half = self.gain * step / 2
        low_pass = lfilter([self.gain / (1 + half)], [1, (half - 1) / (1 + half)], impulses, axis=-2)
        return np.concatenate([np.zeros_like(low_pass[..., :1, :]), low_pass], axis=-2)

    @cached_property
    def _carrying(self) -> tuple[Robot, ...]:
        """The robot with 1 kg at the last link's origin and on either side of it along each axis."""
        model = self.robot.model
        link = model.link_names[model.link_joints.index(model.moving_joints[-1])]
        places = [np.zeros(3), *(REACH * np.eye(3)), *(-REACH * np.eye(3))]
        return tuple(self.robot.with_payload(1.0, com=place, link=link) for place in places)

    def _payload(self, q: Array, qd: Array, found: Array, after: slice, step: float) -> tuple[float, float]:
        """Mass of the point masses about the last link's origin that fit residuals best, and the share they explain."""
        from scipy.optimize import nnls

        target = found[after].ravel()
        if not target.any():
            return 0.0, 0.0
        own, *others = (_unexplained(robot, q, qd, 0.0, step) for robot in (self.robot, *self._carrying))
        columns = [self._filtered(own - other, step)[after].ravel() for other in others]
        masses, left = nnls(np.stack(columns, axis=1), target)
        return float(masses.sum()), max(1 - left**2 / float(target @ target), 0.0)

    def watching(self, law: Callable[..., Any], reaction: Callable[..., Any], sample_time: float) -> Watched:
        """A control law that is watched in a sampled scene, and replaced by another from the first contact on.

        Parameters
        ----------
        law, reaction : callable
            Functions f(t, q, qd) that return torques, shape (n,): the law, and what follows a contact.
        sample_time : float
            That of the scene [s].

        Returns
        -------
        Watched
            A controller for one simulation of ``rne.Scene(..., sample_time=sample_time)``; its `contact` is the time of
            the first contact, or None.

        Raises
        ------
        ValueError
            If `sample_time` is not positive.
        """
        return Watched(self, law, reaction, positive_number("sample_time", sample_time))


@dataclass(eq=False)
class Watched:
    """A law that is watched for contacts, made by `MomentumObserver.watching`.

    Attributes
    ----------
    observer, law, reaction, sample_time
        As given.
    contact : float or None
        The time of the first contact [s].

    Examples
    --------
    >>> import rne
    >>> arm = rne.load("irb140")
    >>> law = rne.control.pd_gravity(arm, 400, 40, [0.5] * 6)
    >>> rne.control.MomentumObserver(arm).watching(law, law, 1e-3).sample_time
    0.001
    """

    observer: MomentumObserver
    law: Callable[..., Any]
    reaction: Callable[..., Any]
    sample_time: float
    contact: float | None = None
    _last: tuple[Any, ...] = field(default=(), repr=False)
    _filters: Array | None = field(default=None, repr=False)

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Torques, shape (n,) [N m or N]."""
        if self.contact is None and self._last:
            self._update(t, q, qd)
        torque = np.asarray((self.law if self.contact is None else self.reaction)(t, q, qd), dtype=float)
        self._last = q.copy(), qd.copy(), torque
        return torque

    def _update(self, t: float, q: Array, qd: Array) -> None:
        """One step of the filters of `MomentumObserver.observe`."""
        last_q, last_qd, torque = self._last
        positions, rates, torques = (np.stack(x) for x in ((last_q, q), (last_qd, qd), (torque, torque)))
        new = self.observer._impulses(positions, rates, torques, self.sample_time, True)[:, 0]
        half = self.observer.gain * self.sample_time / 2
        old = np.zeros_like(new) if self._filters is None else self._filters
        self._filters = ((1 - half) * old + self.observer.gain * new) / (1 + half)
        found, threshold = self.observer._seen(self._filters)
        if (np.abs(found) > threshold).any():
            self.contact = float(t)


def _between(values: Array, step: float, held: bool) -> Array:
    """Integrals from each sample to the next: of held values, or by the trapezoidal rule."""
    return values[:-1] * step if held else (values[:-1] + values[1:]) * (step / 2)


def _unexplained(robot: Robot, q: Array, qd: Array, impulse: Array | float, step: float) -> Array:
    """Changes of the momentum from each sample to the next that the model and the drives do not explain."""
    momentum = (robot.mass_matrix(q) @ qd[..., None])[..., 0]
    forces = (robot.coriolis_matrix(q, qd).swapaxes(-1, -2) @ qd[..., None])[..., 0] - robot.gravity_torque(q)
    return np.asarray(np.diff(momentum, axis=0) - _between(forces, step, False) - impulse)
