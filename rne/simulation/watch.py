"""What is watched while a run goes on: loops that become stiff, and laws that chatter."""

from __future__ import annotations

import itertools
from collections import deque

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError, RneError
from .plant import Plant
from .run import Task
from .solver import Steps

# Fastest decay times remaining duration above which an explicit method is held to tiny steps by stability alone:
# DOP853 reaches about 6 time constants a step, so this is some 200 steps that accuracy does not ask for.
STIFF = 1000.0
HELD_BACK = 1.5  # steps of this many time constants of the fastest mode: stability limits them, not accuracy
CHECKED = 100  # steps between two looks
SLOW = 2000  # looks' worth of steps that the whole run would take at a pace that is suspicious
EXAMINED = 10  # of the last steps are examined for a jump of the torques nearby
REACH = 4  # steps' lengths along the motion within which a jump is looked for
BISECTIONS = 40
NOTICED = 1e-3  # of a torque: smaller changes are no jump
MAX_CHANGES = 1000  # of sticking and slipping, within SAME_SPAN of the duration
SAME_SPAN = 1e-4


class Watch:
    """Looks at a run every so many steps.

    Attributes
    ----------
    method : str
        The method to go on with.
    note : str
        What has been changed, for the run's message.
    """

    def __init__(self, plant: Plant, task: Task) -> None:
        self.plant, self.task, self.method, self.note = plant, task, task.method, ""
        self.recent: deque[tuple[float, Array]] = deque(maxlen=CHECKED + 1)
        self.count, self.next_suspicion = 0, CHECKED
        self.changes: deque[float] = deque(maxlen=MAX_CHANGES)

    @property
    def steps_to_look(self) -> int:
        """Steps until the next look."""
        return CHECKED - self.count % CHECKED

    def changes_method(self, steps: Steps) -> bool:
        """Steps were taken, as far as the next look at most: True if the run goes on with another method."""
        self.recent.extend(zip(steps.T[1:].tolist(), steps.X[1:], strict=True))
        self.count += len(steps.T) - 1
        if self.count % CHECKED or len(self.recent) <= CHECKED:
            return False
        before = self.method
        self._look(*self.recent[-1])
        return self.method != before

    def _look(self, t: float, x: Array) -> None:
        pace = t - self.recent[0][0]  # time covered since the last look
        if self.plant.held is None and pace * SLOW < self.task.duration and self.count >= self.next_suspicion:
            self.next_suspicion = 2 * self.count
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
            self.note = (
                f"LSODA from t = {t:.4g} s on, where the fastest mode decays at {decay:.4g} 1/s and {self.method} was "
                "held to short steps"
            )
            self.method = "LSODA"

    def _check_chatter(self) -> None:
        """Refuse torques that jump right beside most of the last states: the motion is held at the jump."""
        chosen = list(self.recent)[-EXAMINED - 1 :]
        found = [self._jump(t, x, end - t) for (t, x), (end, _) in itertools.pairwise(chosen)]
        jumps = np.array([jump for jump in found if jump is not None])
        if len(jumps) < EXAMINED / 2:
            return
        t, k = chosen[-1][0], int(np.argmax(np.abs(jumps).max(axis=0)))
        raise NotFiniteError(
            f"the torque of {self.plant.robot.joint_names[k]!r} jumps by {np.abs(jumps[:, k]).max():.3g} where the "
            f"motion stays at t = {t:.6g} s: the law chatters; smooth it, such as by tanh, or sample it",
            t,
        )

    def _jump(self, t: float, x: Array, h: float) -> Array | None:
        """The jump of the torques between a state and one a few steps ahead, or None if they are continuous."""
        plant, n = self.plant, self.plant.robot.n

        def torques(state: Array) -> Array | None:
            return plant.drive_torques(np.array([t]), state[None])

        u = torques(x)
        if u is None:
            return None
        try:
            ahead = x + REACH * h * plant.rates(t, x, u[0] if plant.rhs.torque_given else None)
            beyond = torques(ahead)
            assert beyond is not None
            change = np.abs(beyond - u).max()
            if not change > NOTICED * np.abs(u).max():
                return None
            for _ in range(BISECTIONS):
                middle = (x + ahead) / 2
                between = torques(middle)
                assert between is not None
                if np.abs(between - u).max() >= np.abs(beyond - between).max():
                    ahead, beyond = middle, between
                else:
                    x, u = middle, between
        except (RneError, ValueError):
            return None
        jump: Array = (beyond - u).reshape(n)
        return jump if np.abs(jump).max() > change / 4 else None


def fastest_decay(plant: Plant, t: float, x: Array) -> float:
    """Fastest decay of the motion linearised in one state [1/s]; NaN where it cannot be linearised."""
    try:
        A = plant.jacobian(t, x)
    except RneError:
        return float("nan")
    if not A.size or not np.isfinite(A).all():
        return float("nan")
    return float(max(-np.linalg.eigvals(A).real.min(), 0.0)) + 0.0  # no negative zero
