"""External torques and contacts from the joints' momentum, without accelerations or force sensors.

The generalised momentum p = M qd changes by p' = tau + C^T qd - g - friction + tau_ext (De Luca and Mattone 2003). What
the model does not explain of its change from sample to sample is the impulse of tau_ext, and the observer's residual

    r' = gain (tau_ext - r)

follows it with the time constant 1 / gain. All of it is linear in the inertial parameters of the model, so that
residuals of robots that bound the real one bound the error of the model's at every instant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import check_function, per_joint_array, positive_number, real_array
from ..basics.spatial import Array
from ..basics.text import InNotebooks, short, summary
from ..robot import Robot, robot_argument
from .impulses import Between, Bodies, FrictionModel, bilinear, sampled, unexplained, with_thresholds
from .observer_law import GuardedLaw, ObserverLaw, bodies_of, friction_of, remembered
from .traced_law import check_law
from .uncertainty import check_shared

EXPLAINED = 0.98  # share of the residuals' squares explained by a payload, if it is one
FITTED = 0.2  # duration after the first contact over which a payload is fitted [s]
REACH = 0.3  # distance of the point masses that stand for a payload from the last link's origin [m]
SMOOTH = 1 / 6  # weight of a second difference of torques: twice the error of the trapezoidal rule


@dataclass(frozen=True, eq=False)
class Residuals(InNotebooks):
    """External torques estimated by a `MomentumObserver`, found by its `observe`.

    Attributes
    ----------
    joints : tuple of str
    t : ndarray, shape (T,)
        [s].
    torque : ndarray, shape (T, n)
        Residuals: torques that act on the robot from outside, positive about (along) the joint's axis, behind a
        low-pass filter, with errors of the model [N m or N].
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
        """Time at which a residual first exceeds its threshold [s]; None if none does."""
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
        what = f"a payload of {self.payload_mass:.3g} kg explains {self.payload_share:.0%} of the following residuals"
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
        Robots between which the real one lies; they differ from the model only in their bodies' parameters.
    friction_error : float
        Largest relative difference of the friction from the model's.
    floor : float or array_like, shape (n,)
        Added to the thresholds, for noise and for the errors of a solver [N m or N].

    Raises
    ------
    TypeError
        If `robot` or a case is no Robot, or `friction` is no Friction.
    ValueError
        If a case has other joints or another gravity, or a number is out of its range.

    Notes
    -----
    De Luca and Mattone 2003; Haddadin, De Luca and Albu-Schaeffer 2017, (32). Between samples external torques are the
    change of M qd minus the integral of tau + C^T qd - g - friction: by Simpson's rule, halfway on the cubic polynomial
    through both states; torques that are not held are integrated by the trapezoidal rule, and the filter is bilinear.
    A threshold is the sum of the largest difference of a case's residual from the model's, the filtered uncertainty of
    friction and a bound of the integration errors: the difference of Simpson's and the trapezoidal rule, now or one
    interval ago, and a sixth of the torques' second differences. This bound is about 0.01 N m at 100 Hz and 0.0001 N m
    at 1 kHz.

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
        """External torques along samples, such as a Record's or a Trajectory's.

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
        largest = self._filtered(bounds, step, absolute=True)
        found, threshold = with_thresholds(self._filtered(impulses, step), largest, self.floor)
        contact = np.flatnonzero((np.abs(found) > threshold).any(1))
        after = slice(contact[0], contact[0] + int(FITTED / step)) if len(contact) else slice(0)
        mass, share = self._payload(positions, rates, found, after, step)
        return Residuals(self.robot.joint_names, times, found, threshold, mass, share)

    def _impulses(self, q: Array, qd: Array, tau: Array, step: float, held: bool) -> tuple[Array, Array]:
        """Impulses between samples that model and cases do not explain, (T - 1, 1 + cases, n), and bounds of errors."""
        found = _between(bodies_of(self), q, qd, step)
        friction = friction_of(self)
        drives, bound = friction.held(found.rates, tau[:-1], step) if held else self._smooth(friction, qd, tau, step)
        bound = bound + found.error
        bound[1:] = np.maximum(bound[1:], bound[:-1])  # a difference of two rules may pass through zero
        return found.momentum - drives[:, None], bound

    def _smooth(self, friction: FrictionModel, qd: Array, tau: Array, step: float) -> tuple[Array, Array]:
        """Impulses of smooth torques and of friction between samples, and bounds of their error, both (T - 1, n)."""
        slowing = friction.torque(qd, tau)
        bound = _curvature(tau - slowing) * SMOOTH * step + friction.sticking(qd[:-1], qd[1:], step)
        bound = bound + self.friction_error * _trapezoidal(np.abs(slowing), step)
        return _trapezoidal(tau - slowing, step), bound

    def _filtered(self, impulses: Array, step: float, *, absolute: bool = False) -> Array:
        """Filter r' = gain (tau_ext - r), bilinear, r = 0 at first; `absolute`: the largest |r| of impulses."""
        from scipy.signal import lfilter

        keeps, takes = bilinear(self.gain, step)
        low_pass = lfilter([takes], [1, -abs(keeps) if absolute else -keeps], impulses, axis=0)
        return np.concatenate([np.zeros_like(low_pass[:1]), low_pass])

    @cached_property
    def _carrying(self) -> tuple[Robot, ...]:
        """The robot with 1 kg at the last link's origin and on either side of it along each axis."""
        model = self.robot.model
        link = model.link_names[model.link_joints.index(model.moving_joints[-1])]
        places = [np.zeros(3), *(REACH * np.eye(3)), *(-REACH * np.eye(3))]
        return tuple(self.robot.with_payload(1.0, com=place, link=link) for place in places)

    def _payload(self, q: Array, qd: Array, found: Array, after: slice, step: float) -> tuple[float, float]:
        """Mass of the point masses about the last link's origin that fit residuals best, and their explained share."""
        from scipy.optimize import nnls

        target = found[after].ravel()
        if not target.any():
            return 0.0, 0.0
        lacking = _between([(robot, None) for robot in (self.robot, *self._carrying)], q, qd, step).momentum
        seen = self._filtered(lacking[:, :1] - lacking[:, 1:], step)[after]
        columns = [seen[:, k].ravel() for k in range(seen.shape[1])]
        masses, left = nnls(np.stack(columns, axis=1), target)
        return float(masses.sum()), max(1 - left**2 / float(target @ target), 0.0)

    def law(
        self,
        law: Callable[..., Any],
        reaction: Callable[..., Any] | None = None,
        *,
        sample_time: float,
        delay: float = 0.0,
        effort_limit: ArrayLike | None = None,
    ) -> ObserverLaw:
        """A discrete control law with states that observes contacts: in scenes, steppers, and on a controller in C.

        It gives the torques of `law` until the first contact, and the torques of `reaction` from then on. Without a
        reaction it only observes. Residuals, thresholds and contacts equal those of `observe` with ``held=True``.

        Parameters
        ----------
        law, reaction : callable
            Functions f(t, q, qd) that return torques, shape (n,), or f(t, q, qd, z) if they have `states`. If both are
            marked by `rne.traceable`, so is the result. The reaction's states advance from the contact on.
        sample_time, delay : float
            From call to call, and from a call until its torques act [s].
        effort_limit : float or array_like, shape (n,), optional
            The drives' limits, to which the torques are clipped [N m or N].

        Returns
        -------
        ObserverLaw
            A law f(t, q, qd, z) -> (torques, z of the next sample), with methods that read z.

        Raises
        ------
        TypeError
            If `law` or `reaction` is no function of (t, q, qd).
        ValueError
            If `sample_time` or a limit is not positive, or `delay` is negative.

        Notes
        -----
        The first call starts the observer; its z is zeros. Torques that act are the commands within `effort_limit`,
        `delay` later. Where they are measured, or limited otherwise, overwrite the entries ``places["torques"]`` of z
        before each call by the mean since the last. Only `watching` takes the `torque_rate` of a scene into account.
        Give a scene the same `delay`, and no lower `effort_limit`: what is not delivered as commanded is a contact.

        Examples
        --------
        >>> import numpy as np, rne
        >>> arm, sample_time = rne.load("irb140"), 1e-3
        >>> hold = rne.control.pd_gravity(arm, 400, 40, 0)
        >>> law = rne.control.MomentumObserver(arm, floor=2.0).law(hold, sample_time=sample_time)
        >>> kernel = rne.control.compiled(law)
        >>> law.states, law.places["torques"]
        (50, slice(13, 19, None))
        """
        check_law("law", law)
        if reaction is not None:
            check_law("reaction", reaction)
        return ObserverLaw(self, law, *remembered(self.robot, sample_time, delay, effort_limit), reaction)

    def watching(
        self, law: Callable[..., Any], reaction: Callable[..., Any], sample_time: float, delay: float = 0.0
    ) -> GuardedLaw:
        """Control law for a sampled scene that is replaced by another from the first contact on.

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


def _between(bodies: Bodies, q: Array, qd: Array, step: float) -> Between:
    at = sampled(bodies, q, qd)
    return unexplained(bodies, at.rows(slice(None, -1)), at.rows(slice(1, None)), step)


def _trapezoidal(values: Array, step: float) -> Array:
    """Integrals from each sample to the next by the trapezoidal rule."""
    return np.asarray((values[:-1] + values[1:]) * (step / 2))


def _curvature(values: Array) -> Array:
    """The larger second difference at both ends of each interval."""
    if len(values) < 3:
        return np.asarray(3 * np.abs(np.diff(values, axis=0)))  # a jump is within half of it
    bends = np.abs(np.diff(values, 2, axis=0))
    return np.asarray(np.maximum(np.concatenate([bends[:1], bends]), np.concatenate([bends, bends[-1:]])))
