"""What is watched while a run goes on: loops that become stiff, and laws that chatter."""

from __future__ import annotations

from collections import deque

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError, RneError
from .plant import Plant
from .trajectory import Task

# Fastest decay times remaining duration above which an explicit method is held to tiny steps by stability alone:
# DOP853 reaches about 6 time constants a step, so this is some 200 steps that accuracy does not ask for.
STIFF = 1000.0
HELD_BACK = 1.5  # steps of this many time constants of the fastest mode: stability limits them, not accuracy
CHECKED = 100  # steps between two looks
SLOW = 2000  # pace at which a law is suspected to chatter: that many looks' worth of steps for the whole run
SWING = 0.25  # of the range of a torque: a change that counts as a switch
SWITCHES = 1 / 8  # of the steps: a law that switches more often chatters
CLOSE = 1e3  # tolerances: between switches of a chattering law the state moves less
MAX_CHANGES = 1000  # of sticking and slipping, within SAME_SPAN of the duration
SAME_SPAN = 1e-4


class Watch:
    """Looks at a run every so many steps.

    Attributes
    ----------
    method : str
        The method to go on with.
    told : str
        What has been changed, for the run's message.
    """

    def __init__(self, plant: Plant, task: Task) -> None:
        self.plant, self.task, self.method, self.told = plant, task, task.method, ""
        self.recent: deque[tuple[float, Array]] = deque(maxlen=CHECKED + 1)
        self.count = 0
        self.changes: deque[float] = deque(maxlen=MAX_CHANGES)

    def step(self, t: float, x: Array) -> None:
        """A step was taken."""
        self.recent.append((t, x))
        self.count += 1
        if self.count % CHECKED or len(self.recent) <= CHECKED:
            return
        pace = t - self.recent[0][0]  # time covered since the last look
        if self.plant.held is None and pace * SLOW < self.task.duration:
            self._check_chatter()
        if self.task.is_auto and self.method in ("DOP853", "RK45"):
            self._check_stiffness(t, x, pace / CHECKED)

    def change(self, t: float) -> None:
        """A joint stuck or slipped."""
        self.changes.append(t)
        if len(self.changes) == MAX_CHANGES and t - self.changes[0] < SAME_SPAN * self.task.duration:
            raise NotFiniteError(
                f"{MAX_CHANGES} changes between sticking and slipping within {t - self.changes[0]:.3g} s at "
                f"t = {t:.6g} s: the torques chatter; smooth the law or sample it",
                t,
            )

    def _check_stiffness(self, t: float, x: Array, h: float) -> None:
        """Go on with LSODA where stability holds back the steps of an explicit method."""
        decay = fastest_decay(self.plant, t, x)
        remaining = self.task.duration - t if self.plant.held is None else 0.0
        if decay * remaining > STIFF and decay * h > HELD_BACK:
            self.told = (
                f"LSODA from t = {t:.4g} s on, where the fastest mode decays at {decay:.4g} 1/s and {self.method} was "
                "held to short steps"
            )
            self.method = "LSODA"

    def _check_chatter(self) -> None:
        """Refuse a law that switches back and forth while the state stays where it is."""
        t, X = np.array([s for s, _ in self.recent]), np.array([x for _, x in self.recent])
        u = self.plant.drive_torques(t, X)
        if u is None:
            return
        jumps, extent = np.abs(np.diff(u, axis=0)), np.ptp(u, axis=0)
        switches = (jumps > SWING * extent).sum(axis=0)
        close = np.abs(np.diff(X, axis=0)) <= CLOSE * (self.task.atol + self.task.rtol * np.abs(X[1:]))
        k = int(np.argmax(switches))
        if switches[k] > SWITCHES * len(jumps) and extent[k] > 0 and close.all(axis=1).mean() > 0.9:
            raise NotFiniteError(
                f"the torque of {self.plant.robot.joint_names[k]!r} switches {switches[k]} times within "
                f"{t[-1] - t[0]:.3g} s at t = {t[-1]:.6g} s, by up to {extent[k]:.3g}: the law chatters; smooth it, "
                "such as by tanh, or sample it",
                float(t[-1]),
            )


def fastest_decay(plant: Plant, t: float, x: Array) -> float:
    """Fastest decay of the motion linearised in one state [1/s]; NaN where it cannot be linearised."""
    try:
        A = plant.jacobian(t, x)
    except RneError:
        return float("nan")
    if not A.size or not np.isfinite(A).all():
        return float("nan")
    return float(max(-np.linalg.eigvals(A).real.min(), 0.0)) + 0.0  # no negative zero
