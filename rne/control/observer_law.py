"""Control laws that observe contacts: with states, which can be traced, and called ones with memory.

What a law with states remembers from sample to sample is z. It is discrete: f(t, q, qd, z) returns the torques of one
sample, and the z that it is called with at the next.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import per_joint_array, positive_number
from ..basics.docstrings import describe_parameters
from ..basics.spatial import Array
from ..basics.text import summary
from ..elementwise import clip, less, maximum, where
from ..robot import Robot
from .impulses import Bodies, FrictionModel, Sample, bilinear, largest, sampled, unexplained, with_thresholds
from .law_numbers import CONSTANT
from .laws import STATES, traceable
from .sampled_loop import in_periods
from .traced_law import check_sample_time, is_discrete

YES = 0.5  # threshold of flags, which are 0 or 1 among the states
SAME_STEP = 1e-6  # largest deviation of the time between calls of a guarded law, relative to the sample time
States = dict[str, Array]


def bodies_of(observer: Any) -> Bodies:
    """Model and cases of a MomentumObserver."""
    return tuple((robot, None) for robot in (observer.robot, *observer.cases))


def friction_of(observer: Any) -> FrictionModel:
    """Friction of a MomentumObserver's model."""
    return FrictionModel(observer.friction, observer.robot, observer.friction_error)


def remembered(
    robot: Robot, sample_time: float, delay: float, effort_limit: ArrayLike | None
) -> tuple[float, int, float, Array | None]:
    """Sample time, number of earlier commands that act because of a delay, share of the older one, and limits."""
    step = positive_number("sample_time", sample_time)
    whole, rest = in_periods(positive_number("delay", delay, zero_allowed=True), step)
    limit = None if effort_limit is None else per_joint_array("effort_limit", effort_limit, robot.n, sign="positive")
    return step, int(whole) + 1 if delay else 0, rest / step, limit


@traceable
def no_torques(t: float, q: Array, qd: Array) -> Array:
    """Law of drives that are commanded by others."""
    return 0.0 * q


@dataclass(frozen=True, eq=False)
class Observing:
    """A control law that observes joint momenta, with the torques of another law."""

    observer: Any
    law: Callable[..., Any]
    sample_time: float = field(metadata=CONSTANT)
    earlier: int
    share: float = field(metadata=CONSTANT)
    effort_limit: Array | None
    discrete = True

    __repr__ = summary

    def __post_init__(self) -> None:
        for name, law in self._laws.items():
            check_sample_time(law, self.sample_time, name)

    @property
    def robot(self) -> Robot:
        """The observer's robot."""
        robot: Robot = self.observer.robot
        return robot

    @property
    def traceable(self) -> bool:
        """True if the laws that it calls are marked by `rne.traceable`."""
        return all(getattr(law, "traceable", False) for law in self._laws.values())

    @property
    def states(self) -> int:
        """Number of states; they start at zero."""
        return sum(self._sizes.values())

    @cached_property
    def places(self) -> dict[str, slice]:
        """Places of quantities among the states, by name; "torques" are those that act until the next sample."""
        ends = np.cumsum(list(self._sizes.values())).tolist()
        return {name: slice(end - size, end) for (name, size), end in zip(self._sizes.items(), ends, strict=True)}

    @property
    def _laws(self) -> dict[str, Callable[..., Any]]:
        return {"law": self.law}

    @cached_property
    def _bodies(self) -> Bodies:
        """Robots of which momenta are kept, the model first."""
        return bodies_of(self.observer)

    @cached_property
    def _sizes(self) -> dict[str, int]:
        n, every = self.robot.n, self.robot.n * len(self._bodies)
        found = {"started": 1, "q": n, "qd": n, "torques": n, "commands": n * self.earlier}
        found |= {"momenta": every, "forces": every, "filtered": every} | self._own_sizes
        return found | {name: int(getattr(law, "states", 0)) for name, law in self._laws.items()}

    @property
    def _own_sizes(self) -> dict[str, int]:
        raise NotImplementedError

    def _read(self, z: ArrayLike, name: str) -> Array:
        states = np.asarray(z)
        if states.shape[-1:] != (self.states,):
            raise ValueError(f"`z` must have shape (..., {self.states}), got {states.shape}")
        return states[..., self.places[name]]

    def _each(self, x: Array) -> Array:
        """(..., robots n) as (..., robots, n)."""
        return x.reshape(*x.shape[:-1], len(self._bodies), self.robot.n)

    def __call__(self, t: float, q: Array, qd: Array, z: Array) -> tuple[Array, Array]:
        """Torques [N m or N], shape (..., n), and the states of the next sample, shape (..., states)."""
        old = {name: self._read(z, name) for name in self.places}
        first = Sample(old["q"], old["qd"], self._each(old["momenta"]), self._each(old["forces"]))
        last = sampled(self._bodies, np.asarray(q), np.asarray(qd))
        found = unexplained(self._bodies, first, last, self.sample_time)
        drives, bound = friction_of(self.observer).held(found.rates, old["torques"], self.sample_time)
        keeps, takes = bilinear(self.observer.gain, self.sample_time)
        # at the first sample there is none before
        taken, shape = takes * old["started"], old["momenta"].shape
        new = {"started": 0 * taken + 1.0, "q": last.q, "qd": last.qd}
        new |= {"momenta": last.momentum.reshape(shape), "forces": last.force.reshape(shape)}
        new["filtered"] = keeps * old["filtered"] + taken * self._lacking(found.momentum, drives).reshape(shape)
        new |= self._learned(old, self._each(new["filtered"]), old["started"] * (bound + found.error))
        torques = self._commanded(t, q, qd, old, new)
        if self.effort_limit is not None:
            torques = clip(torques, -self.effort_limit, self.effort_limit)
        new |= self._acting(old, torques)
        return torques, np.concatenate([new[name] for name in self.places], axis=-1)

    def _lacking(self, momentum: Array, drives: Array) -> Array:
        """Impulses that are filtered, by changes of momenta (..., robots, n) and impulses of the drives (..., n)."""
        return momentum - drives[..., None, :]

    def _learned(self, old: States, filtered: Array, bounds: Array) -> States:
        """States that follow from the filtered impulses, (..., robots, n)."""
        raise NotImplementedError

    def _acting(self, old: States, torques: Array) -> States:
        """Torques that act until the next sample, by commands and earlier ones."""
        given, n = np.concatenate([old["commands"], torques], axis=-1), self.robot.n
        acting = self.share * given[..., :n] + (1 - self.share) * given[..., n : 2 * n] if self.earlier else torques
        return {"torques": acting, "commands": given[..., n : n * (self.earlier + 1)]}

    def _commanded(self, t: float, q: Array, qd: Array, old: States, new: States) -> Array:
        torques, new["law"] = self._called("law", t, q, qd, old["law"])
        return torques

    def _called(self, name: str, t: float, q: Array, qd: Array, z: Array) -> tuple[Array, Array]:
        """Torques of a law, and its states at the next sample: by Euler's rule, of a discrete law those it gives."""
        law = self._laws[name]
        if not hasattr(law, "states"):
            return np.asarray(law(t, q, qd)), z
        torques, change = law(t, q, qd, z)
        change = np.asarray(change)  # which may be a list
        return np.asarray(torques), change if is_discrete(law) else z + self.sample_time * change


@describe_parameters(STATES)
@dataclass(frozen=True, eq=False)
class ObserverLaw(Observing):
    """A control law that observes contacts, made by `MomentumObserver.law`: from a contact on, the reaction acts.

    The states hold what was seen up to the call that returned them: `Trajectory.controller_state` at a sample is what
    was known before it.

    Attributes
    ----------
    observer, law, sample_time, effort_limit, reaction
        Arguments of `MomentumObserver.law`.
    earlier, share : int, float
        How many earlier commands are remembered, as torques act late, and the part of the older of two that act.

    Examples
    --------
    >>> import numpy as np, rne
    >>> arm = rne.load("irb140")
    >>> hold = rne.control.pd_gravity(arm, 400, 40, 0)
    >>> law = rne.control.MomentumObserver(arm, floor=2.0).law(hold, sample_time=1e-3)
    >>> torques, z = law(0.0, np.zeros(6), np.zeros(6), np.zeros(law.states))
    >>> law.residuals(z).tolist(), law.thresholds(z)[0].item(), bool(law.contact(z))
    ([0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 2.0, False)
    """

    reaction: Callable[..., Any] | None

    @property
    def _laws(self) -> dict[str, Callable[..., Any]]:
        return {"law": self.law} | ({} if self.reaction is None else {"reaction": self.reaction})

    @property
    def _own_sizes(self) -> dict[str, int]:
        return {"bounds": self.robot.n, "last bounds": self.robot.n, "contact": 1}

    def _learned(self, old: States, filtered: Array, bounds: Array) -> States:
        keeps, takes = bilinear(self.observer.gain, self.sample_time)
        within = abs(keeps) * old["bounds"] + takes * maximum(bounds, old["last bounds"])
        found, threshold = with_thresholds(filtered, within, self.observer.floor)
        seen = largest(where(less(threshold, np.abs(found)), 1.0, 0.0), -1)
        return {"bounds": within, "last bounds": bounds, "contact": maximum(old["contact"], seen)}

    def _commanded(self, t: float, q: Array, qd: Array, old: States, new: States) -> Array:
        torques = super()._commanded(t, q, qd, old, new)
        if self.reaction is None:
            return torques
        reacting, states = self._called("reaction", t, q, qd, old["reaction"])
        hit = less(YES, new["contact"])
        new["reaction"] = where(hit, states, old["reaction"])
        return where(hit, reacting, torques)

    def residuals(self, z: ArrayLike) -> Array:
        """Residuals: filtered external torques, and errors of the model.

        Returns
        -------
        ndarray, shape (..., n)
            [N m or N].
        """
        return self._each(self._read(z, "filtered"))[..., 0, :]

    def thresholds(self, z: ArrayLike) -> Array:
        """Largest residuals that the stated errors of model and friction can cause.

        Returns
        -------
        ndarray, shape (..., n)
            [N m or N].
        """
        return with_thresholds(self._each(self._read(z, "filtered")), self._read(z, "bounds"), self.observer.floor)[1]

    def contact(self, z: ArrayLike) -> Array:
        """True from the first contact on.

        Returns
        -------
        ndarray of bool, shape (...)
            A residual was beyond its threshold.
        """
        return np.asarray(self._read(z, "contact")[..., 0] > YES)


@dataclass(eq=False)
class GuardedLaw:
    """A control law guarded by an observer, made by `MomentumObserver.watching`: from a contact on, the reaction acts.

    It is called and has memory; `MomentumObserver.law` makes one with states instead.

    Attributes
    ----------
    observer, law, reaction, sample_time, delay
        Arguments of `MomentumObserver.watching`.
    contact : float or None
        The time of the first contact [s].

    Examples
    --------
    >>> import numpy as np, rne
    >>> arm = rne.load("irb140")
    >>> watched = rne.control.MomentumObserver(arm).watching(lambda t, q, qd: -9 * q, print, 0.01)
    >>> watched.delivered(np.clip(watched(0.0, np.ones(6), np.zeros(6)), -5, 5))
    >>> watched.contact is None
    True
    """

    observer: Any
    law: Callable[..., Any]
    reaction: Callable[..., Any]
    sample_time: float = field(metadata=CONSTANT)
    delay: float = field(default=0.0, metadata=CONSTANT)
    contact: float | None = field(default=None, init=False)
    _z: Array = field(default_factory=lambda: np.zeros(0), init=False, repr=False)  # of the observing law, for the next
    _commands: Array = field(default_factory=lambda: np.zeros(0), init=False, repr=False)  # those before the last one
    _time: float = field(default=0.0, init=False, repr=False)

    @property
    def robot(self) -> Robot:
        """The observer's robot, whose joints are those of the scene."""
        robot: Robot = self.observer.robot
        return robot

    @cached_property
    def _observing(self) -> ObserverLaw:
        how = remembered(self.robot, self.sample_time, self.delay, None)
        return ObserverLaw(self.observer, no_torques, *how, None)

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Torques, shape (n,) [N m or N]; a run begins at t = 0."""
        observing = self._observing
        if t == 0:
            self.contact, self._z = None, np.zeros(observing.states)
        elif abs(t - self._time - self.sample_time) > SAME_STEP * self.sample_time:
            raise ValueError(
                f"a guarded law must be called every {self.sample_time:g} s from t = 0 on, got t = {t:.6g} s after "
                f"{self._time:.6g} s; give rne.Scene the same `sample_time`"
            )
        self._time, self._commands = float(t), self._z[observing.places["commands"]]
        if self.contact is None:
            _, self._z = observing(t, q, qd, self._z)
            self.contact = float(t) if observing.contact(self._z) else None
        torque = np.asarray((self.law if self.contact is None else self.reaction)(t, q, qd), dtype=float)
        self.delivered(torque)
        return torque

    def delivered(self, torque: Array) -> None:
        """Replace the torques of the last sample by those within the limits of the scene; they act `delay` later.

        Parameters
        ----------
        torque : ndarray, shape (n,)
            [N m or N].
        """
        for name, values in self._observing._acting({"commands": self._commands}, torque).items():
            self._z[self._observing.places[name]] = values
