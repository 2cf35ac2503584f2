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

from ..basics.arrays import check_function, per_joint_array, positive_number, real_array
from ..basics.spatial import Array
from ..basics.text import InNotebooks, short, summary
from ..robot import Robot, robot_argument
from .sampled_loop import in_periods
from .uncertainty import check_shared

EXPLAINED = 0.98  # share of the residuals' squares that a payload explains, if it is one
FITTED = 0.2  # [s] after the first contact, over which a payload is fitted
REACH = 0.3  # [m] from the origin of the last link to where point masses stand for a payload
SMOOTH = 1 / 6  # of a second difference of torques: twice the error of the trapezoidal rule
IMPULSE_ERROR = 1e-10  # of momenta and impulses: above what rounding, and steps of a solver, leave of them
SAME_STEP = 1e-6  # of the sample time: calls of a guarded law that far apart are as far apart as they should be


@dataclass(frozen=True, eq=False)
class Residuals(InNotebooks):
    """External torques as a `MomentumObserver` sees them, found by its `observe`.

    Attributes
    ----------
    joints : tuple of str
    t : ndarray, shape (T,)
        [s].
    torque : ndarray, shape (T, n)
        Residuals: external torques behind a low-pass filter, and errors of the model [N m or N].
    threshold : ndarray, shape (T, n)
        Largest residuals that the stated errors of model and friction can cause [N m or N].
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
        """Kind of the external torques: "contact", "payload" if a payload explains 98 % of them, or None.

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
        Bandwidth of the observer; residuals follow external torques with the time constant 1 / gain [1/s].
    friction : Friction, optional
        Friction of the model.
    cases : sequence of Robot, optional
        Robots between which the real one lies; they differ from the model in their bodies' parameters alone.
    friction_error : float
        By which share the friction may differ from the model's.
    floor : float or array_like, shape (n,)
        Added to the thresholds, for noise and for the errors of a solver [N m or N].

    Raises
    ------
    TypeError
        If a robot is none, or `friction` is no Friction.
    ValueError
        If a case has other joints or another gravity, or a number is out of its range.

    Notes
    -----
    De Luca and Mattone 2003; Haddadin, De Luca and Albu-Schaeffer 2017, (32). Between samples external torques are the
    change of M qd less the integral of tau + C^T qd - g - friction: by Simpson's rule, halfway on the cubic polynomial
    through both states, and of torques that are not held by the trapezoidal one; the filter is bilinear. Thresholds
    are at each instant the largest difference of a case's residual from the model's, the filtered uncertainty of
    friction and a bound of the rules' errors: how far Simpson's rule is from the trapezoidal one, now or one interval
    ago, and a sixth of the torques' second differences. It is some 0.01 N m at 100 Hz and 0.0001 N m at 1 kHz.

    If the real robot is a mixture of the cases and the model, samples have no noise, and torques are held or smooth
    from sample to sample, no residual without a contact exceeds them. Noise, a solver's errors and torques that jump
    between samples are for `floor`. Under dry friction a joint at rest shows no contact below its static friction.

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
        robot_argument(self.robot)
        if not isinstance(self.cases, Sequence) or not all(isinstance(case, Robot) for case in self.cases):
            raise TypeError("`cases` must be a sequence of Robots")
        for case in self.cases:
            check_shared("`cases` must differ from the robot", self.robot, case)
        if self.friction is not None and not hasattr(type(self.friction), "coulomb_torque"):
            raise TypeError(f"`friction` must be an rne.Friction or None, got {type(self.friction).__name__}")
        if self.friction is not None:
            self.friction.check(self.robot.model)
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
        if not step > 0 or np.abs(np.diff(times) - step).max() > 1e-3 * step:
            raise ValueError("`t` must ascend at equal intervals; rne.identification.Record.prepare resamples")
        impulses, bounds = self._impulses(positions, rates, torques, step, held)
        found, threshold = self._seen(self._filtered(impulses, step), self._filtered(bounds, step, largest=True))
        contact = np.flatnonzero((np.abs(found) > threshold).any(1))
        after = slice(contact[0], contact[0] + int(FITTED / step)) if len(contact) else slice(0)
        mass, share = self._payload(positions, rates, found, after, step)
        return Residuals(self.robot.joint_names, times, found, threshold, mass, share)

    def _impulses(self, q: Array, qd: Array, tau: Array, step: float, held: bool) -> tuple[Array, Array]:
        """Impulses between samples that model and cases do not explain, (1 + cases, T - 1, n), and bounds of errors."""
        middle = _halfway(q, qd, step)
        robots = [_unexplained(robot, q, qd, middle, step) for robot in (self.robot, *self.cases)]
        found, errors = (np.stack(parts) for parts in zip(*robots, strict=True))
        impulse, bound = self._drives(qd, tau, middle[1], step, held)
        bound = bound + errors.max(axis=0)
        bound[1:] = np.maximum(bound[1:], bound[:-1])  # a difference of two rules may pass through zero
        return found - impulse, bound

    def _drives(self, qd: Array, tau: Array, middle: Array, step: float, held: bool) -> tuple[Array, Array]:
        """Impulses of the drives and of friction between samples, and bounds of their error, both (T - 1, n)."""
        f, between = self.friction, tau[:-1] if held else (tau[1:] + tau[:-1]) / 2
        friction, halfway = (self._resisting(x, by) for x, by in ((qd, tau), (middle, between)))
        if held:
            slowed, error = _simpson(friction, halfway, step)
            size, of_size = _simpson(np.abs(friction), np.abs(halfway), step)
            impulse, bound = tau[:-1] * step - slowed, error + self.friction_error * (size + of_size)
        else:
            impulse, bound = _trapezoidal(tau - friction, step), _curvature(tau - friction) * SMOOTH * step
            bound = bound + self.friction_error * _trapezoidal(np.abs(friction), step)
        if getattr(f, "sticks", False):
            slipping = np.maximum(f.coulomb, f.coulomb_back) + np.maximum(f.stribeck_rise, 0)
            largest = slipping if f.static is None else f.static
            rests = qd == 0
            times = 2.0 * (rests[:-1] | rests[1:]) - (rests[:-1] & rests[1:])
            bound = bound + step * (1 + self.friction_error) * largest * times
        return impulse, bound

    def _resisting(self, qd: Array, tau: Array) -> Array:
        """Torques of friction, under load of the drives' torques."""
        f, model = self.friction, self.robot.model
        if f is None or "load" not in getattr(f, "losses", ()):
            return np.zeros_like(qd) if f is None else np.asarray(f.torque(model, qd))
        return np.asarray(tau - f.transmitted(tau - f.torque(model, qd, np.zeros_like(qd)), qd))

    def _seen(self, filtered: Array, bound: Array) -> tuple[Array, Array]:
        """Residuals of the model, and their thresholds."""
        found, *cases = filtered
        spread = np.max([np.abs(case - found) for case in cases], axis=0, initial=0.0)
        return found, spread + bound + self.floor

    def _coefficients(self, step: float) -> tuple[float, float]:
        """Coefficients (a, b) of the filter: r at a sample is a times r at the last one plus b times the impulse."""
        half = self.gain * step / 2
        return (1 - half) / (1 + half), self.gain / (1 + half)

    def _filtered(self, impulses: Array, step: float, *, largest: bool = False) -> Array:
        """r' = gain (tau_ext - r) by the bilinear rule, r = 0 at first; the `largest` |r| of impulses up to these."""
        from scipy.signal import lfilter

        keeps, takes = self._coefficients(step)
        low_pass = lfilter([takes], [1, -abs(keeps) if largest else -keeps], impulses, axis=-2)
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
        middle = _halfway(q, qd, step)
        own, *others = (_unexplained(robot, q, qd, middle, step)[0] for robot in (self.robot, *self._carrying))
        columns = [self._filtered(own - other, step)[after].ravel() for other in others]
        masses, left = nnls(np.stack(columns, axis=1), target)
        return float(masses.sum()), max(1 - left**2 / float(target @ target), 0.0)

    def watching(
        self, law: Callable[..., Any], reaction: Callable[..., Any], sample_time: float, delay: float = 0.0
    ) -> GuardedLaw:
        """A control law for a sampled scene that is replaced by another from the first contact on.

        Parameters
        ----------
        law, reaction : callable
            Functions f(t, q, qd) that return torques, shape (n,): the law, and what follows a contact.
        sample_time, delay : float
            Those of the scene [s]: torques act `delay` after their sample.

        Returns
        -------
        GuardedLaw
            A controller for ``rne.Scene(..., sample_time=sample_time)``; its `contact` is the time of the first contact
            of the last run, or None. The scene calls its `delivered` with the torques that `effort_limit` and
            `torque_rate` let through; a law of your own that calls a guarded one does so too.

        Raises
        ------
        TypeError
            If `law` or `reaction` is no function of (t, q, qd).
        ValueError
            If `sample_time` is not positive, or `delay` is negative.
        """
        late = positive_number("delay", delay, zero_allowed=True)
        for name, given in (("law", law), ("reaction", reaction)):
            check_function(name, given, "(t, q, qd)")
        return GuardedLaw(self, law, reaction, positive_number("sample_time", sample_time), late)


@dataclass(eq=False)
class GuardedLaw:
    """A control law guarded by an observer, made by `MomentumObserver.watching`: from a contact on, the reaction acts.

    Attributes
    ----------
    observer, law, reaction, sample_time, delay
        Arguments of `MomentumObserver.watching`.
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
    delay: float = 0.0
    contact: float | None = None
    _samples: list[tuple[Array, Array, Array]] = field(default_factory=list, repr=False)  # the last two q, qd, tau
    _commands: list[Array] = field(default_factory=list, repr=False)  # the last ones, some of which do not act yet
    _filters: tuple[Any, Any] = field(default=(0.0, 0.0), repr=False)
    _time: float = field(default=0.0, repr=False)

    @property
    def robot(self) -> Robot:
        """The observer's robot, whose joints are those of the scene."""
        return self.observer.robot

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Torques, shape (n,) [N m or N]; a run begins at t = 0."""
        if t == 0:
            self.contact, self._samples, self._commands, self._filters = None, [], [], (0.0, 0.0)
        elif abs(t - self._time - self.sample_time) > SAME_STEP * self.sample_time:
            raise ValueError(
                f"a guarded law must be called every {self.sample_time:g} s from t = 0 on, got t = {t:.6g} s after "
                f"{self._time:.6g} s; give rne.Scene the same `sample_time`"
            )
        elif self.contact is None:
            self._update(t, q, qd)
        torque = np.asarray((self.law if self.contact is None else self.reaction)(t, q, qd), dtype=float)
        self._time, self._commands = float(t), [*self._commands, torque]
        self._samples = [*self._samples[-1:], (q.copy(), qd.copy(), self._acting())]
        return torque

    def delivered(self, torque: Array) -> None:
        """Replace the torques of the last sample by those within the limits of the scene; they act `delay` later.

        Parameters
        ----------
        torque : ndarray, shape (n,)
            [N m or N].

        Examples
        --------
        >>> import numpy as np, rne
        >>> arm = rne.load("irb140")
        >>> watched = rne.control.MomentumObserver(arm).watching(lambda t, q, qd: -9 * q, print, 0.01)
        >>> watched.delivered(np.clip(watched(0.0, np.ones(6), np.zeros(6)), -5, 5))
        """
        self._commands[-1] = torque
        self._samples[-1] = (*self._samples[-1][:2], self._acting())

    def _acting(self) -> Array:
        """Mean of the torques from the last sample to the next."""
        late, rest = in_periods(self.delay, self.sample_time)
        count, share = int(late), rest / self.sample_time
        self._commands = given = self._commands[-count - 2 :]
        before, then = (given[-k] if k <= len(given) else np.zeros_like(given[-1]) for k in (count + 2, count + 1))
        return np.asarray(share * before + (1 - share) * then)

    def _update(self, t: float, q: Array, qd: Array) -> None:
        """One step of the filters of `MomentumObserver.observe`."""
        samples = [*self._samples, (q, qd, self._samples[-1][2])]
        positions, rates, torques = (np.stack(x) for x in zip(*samples, strict=True))
        keeps, takes = self.observer._coefficients(self.sample_time)
        impulses, bounds = self.observer._impulses(positions, rates, torques, self.sample_time, True)
        old, bound = self._filters
        self._filters = keeps * old + takes * impulses[:, -1], abs(keeps) * bound + takes * bounds[-1]
        found, threshold = self.observer._seen(*self._filters)
        if (np.abs(found) > threshold).any():
            self.contact = float(t)


def _halfway(q: Array, qd: Array, step: float) -> tuple[Array, Array]:
    """Positions and velocities halfway between samples, of the cubic polynomials through both."""
    moved, change = np.diff(q, axis=0), np.diff(qd, axis=0)
    return q[:-1] + moved / 2 - change * (step / 8), 1.5 * moved / step - (qd[:-1] + qd[1:]) / 4


def _trapezoidal(values: Array, step: float) -> Array:
    """Integrals from each sample to the next by the trapezoidal rule."""
    return np.asarray((values[:-1] + values[1:]) * (step / 2))


def _simpson(values: Array, middle: Array, step: float) -> tuple[Array, Array]:
    """Integrals by Simpson's rule, and how far they are from those of the trapezoidal one."""
    correction = (2 * middle - values[:-1] - values[1:]) * (step / 3)
    return _trapezoidal(values, step) + correction, np.abs(correction)


def _curvature(values: Array) -> Array:
    """The larger second difference at both ends of each interval."""
    if len(values) < 3:
        return np.asarray(3 * np.abs(np.diff(values, axis=0)))  # a jump is within half of it
    bends = np.abs(np.diff(values, 2, axis=0))
    return np.asarray(np.maximum(np.concatenate([bends[:1], bends]), np.concatenate([bends, bends[-1:]])))


def _unexplained(robot: Robot, q: Array, qd: Array, middle: tuple[Array, Array], step: float) -> tuple[Array, Array]:
    """Changes of the momentum between samples that the model's forces do not explain, and a bound of their error."""
    momentum = (robot.mass_matrix(q) @ qd[..., None])[..., 0]
    positions, rates = (np.concatenate(parts) for parts in zip((q, qd), middle, strict=True))
    turning = (robot.coriolis_matrix(positions, rates).swapaxes(-1, -2) @ rates[..., None])[..., 0]
    forces = turning - robot.gravity_torque(positions)
    impulse, error = _simpson(forces[: len(q)], forces[len(q) :], step)
    sizes = np.abs(momentum).max(-1, keepdims=True) + step * np.abs(forces[: len(q)]).max(-1, keepdims=True)
    return np.diff(momentum, axis=0) - impulse, error + IMPULSE_ERROR * (sizes[:-1] + sizes[1:])
