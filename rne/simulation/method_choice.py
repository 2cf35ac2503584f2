"""Choice of the solver at the start and during a run: detection of stiff motions and chattering laws."""

from __future__ import annotations

import itertools
from collections import deque
from contextlib import suppress

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError, RneError
from ..integrators.base import RODAS, Steps
from ..integrators.rosenbrock import STAGES
from ..integrators.step_control import MOST_STEPS
from ..integrators.tableaus import EXPLICIT, tableau
from .plant import Plant
from .zero_order_hold import ZeroOrderHold

# Fastest decay times remaining duration above which only stability holds an explicit method to tiny steps:
# DOP853 reaches about 6 time constants a step, so this is about 200 steps that accuracy does not need.
STIFF = 1000.0
STIFF_STICKING = 1e5  # the same with sticking joints and compiled steps, which are 100 times as fast as LSODA's
# The same for the time between two samples: Tsit5 reaches 3.5 time constants a step, and an implicit method that begins
# anew at each sample takes as many evaluations as nine steps.
STIFF_SAMPLE = 30.0
STIFF_MACHINE_CODE = 150.0  # the same with a law sampled in machine code: Rodas5P is not
HELD_BACK = 1.5  # time constants of the fastest mode per step above which stability, not accuracy, limits steps
REACHED = {"DOP853": 4.0, "Tsit5": 2.5}  # smallest number of time constants per step where stability limits it
# Factor of time per work above which a change from Rodas5P is tried. Without changes back, 100 s of free motion after a
# brake that fades within 0.3 s take three to five times as long; without undoing changes, some runs twice as long.
WORTH = 2.0
CHECKED = 100  # steps between two checks, and after a change of the method
IN_MACHINE_CODE, UNDAMPED = 2, 10  # factors of CHECKED: for compiled loops, whose steps are cheap; for free motion
SLOPES = 3  # time of an operation of the Jacobian relative to one of the right-hand side: registers do not hold it
PATIENCE = 4  # factor of CHECKED after a change that did not pay
SLOW = 2000  # number of checks that the whole run would need at a pace that is suspicious
TRIED = 1000  # steps after which a run that would take MOST_STEPS is given up
EXAMINED = 10  # number of last steps examined for a jump of the torques nearby
REACH = 4  # range of the search for a jump [lengths of steps]
BISECTIONS = 40
NOTICED = 1e-3  # smallest jump of a torque, relative
MAX_CHANGES = 1000  # most changes between sticking and slipping within SAME_SPAN of the duration
SAME_SPAN = 1e-4


class MethodMonitor:
    """Monitor of a run: decides, every 100 steps or more, on a change of method; raises errors for chattering laws.

    It is made with the first method; its `method` is the one to continue with, another one if it `may_change`.
    """

    def __init__(
        self, plant: Plant, hold: ZeroOrderHold | None, method: str, duration: float, *, may_change: bool = False
    ) -> None:
        self.plant, self.hold, self.method, self.duration, self.may_change = plant, hold, method, duration, may_change
        self.recent: deque[tuple[float, Array]] = deque(maxlen=CHECKED + 1)
        self.count, self.next_suspicion = 0, CHECKED
        times = 1 if not plant.is_compiled else UNDAMPED if plant.is_conservative else IN_MACHINE_CODE
        self.next_look = self.interval = times * CHECKED
        self.notes: list[str] = []
        self.before: tuple[str, float] | None = None  # the method before a change, and how fast it was
        self.next_change, self.patience = 0, CHECKED
        self.changes: deque[float] = deque(maxlen=MAX_CHANGES)

    @property
    def note(self) -> str:
        """Changes of method so far, for the run's message."""
        notes, left_out = self.notes, f"{len(self.notes) - 4} more changes"
        return "; ".join(notes if len(notes) <= 5 else [*notes[:3], left_out, notes[-1]])

    @property
    def steps_to_look(self) -> int:
        """Steps until the next check."""
        return self.next_look - self.count

    def changes_method(self, steps: Steps) -> bool:
        """Check steps; True if the run continues with another method."""
        last = slice(max(1, len(steps.T) - CHECKED - 1), None)
        self.recent.extend(zip(steps.T[last].tolist(), steps.X[last], strict=True))
        self.count += len(steps.T) - 1
        if self.count < self.next_look:
            return False
        before = self.method
        if len(self.recent) > CHECKED:
            self._look(*self.recent[-1])
        changed = self.method != before
        if changed:
            self.recent = deque([self.recent[-1]], maxlen=CHECKED + 1)
        self.next_look = self.count + (CHECKED if changed else self.interval)
        return changed

    def _look(self, t: float, x: Array) -> None:
        pace = t - self.recent[0][0]  # time covered by the last steps
        if self.count >= TRIED and self.count * self.duration > MOST_STEPS * t:
            where = fastest_joint(self.plant, x)
            text = f"{self.count} steps came to t = {t:.3g} s, {where}: the run would take more than {MOST_STEPS:g}"
            raise NotFiniteError(text, t)
        if self.plant.sampled is None and pace * SLOW < self.duration and self.count >= self.next_suspicion:
            self.next_suspicion = 2 * self.count
            self.check_chatter()
        h = pace / CHECKED
        if self.hold is not None and 2 * h > self.hold.period and self.method in EXPLICIT:
            return  # the samples cut the steps
        if not self.may_change or self._returns(t, x, h) or self.count < self.next_change:
            return
        if self.method in EXPLICIT:
            self._check_stiffness(t, x, h)
        elif self.method == RODAS:
            self._check_ease(t, x, h)

    def _returns(self, t: float, x: Array, h: float) -> bool:
        """True, after a change, if the method before covered more time per work and is restored."""
        if self.before is None:
            return False
        (method, speed), self.before = self.before, None
        if method != RODAS:
            speed = min(speed, self._stable_speed(method, t, x))
        if not speed > h / work_per_step(self.plant, self.method):
            return False
        self.notes.append(f"{method} from t = {t:.4g} s on, which is faster")
        self.method, self.patience = method, PATIENCE * self.patience
        self.next_change = self.count + self.patience
        return True

    def _change(self, method: str, h: float, note: str) -> None:
        """Change the method; from or to Rodas5P, the next check compares the speeds of both."""
        if RODAS in (method, self.method):
            self.before = self.method, h / work_per_step(self.plant, self.method)
        self.method = method
        self.notes.append(note)

    def _check_stiffness(self, t: float, x: Array, h: float) -> None:
        """Change to an implicit method where stability limits the steps of an explicit one."""
        if self.plant.is_conservative:
            return
        decay = fastest_decay(self.plant, t, x)
        times, bound, _ = stiffness(self.plant, self.hold, decay, self.duration - t)
        if times > bound and decay * h > HELD_BACK:
            method = stiff_method(self.plant)
            mode = f"where the fastest mode decays at {decay:.4g} 1/s"
            self._change(method, h, f"{method} from t = {t:.4g} s on, {mode} and {self.method} was held to short steps")

    def _check_ease(self, t: float, x: Array, h: float) -> None:
        """Change to an explicit method where its stability allows efficient steps."""
        method = explicit_method(self.hold)
        if self._stable_speed(method, t, x) > WORTH * h / work_per_step(self.plant, RODAS):
            self._change(method, h, f"{method} from t = {t:.4g} s on, where stability would allow it longer steps")

    def _stable_speed(self, method: str, t: float, x: Array) -> float:
        """Time per work that the stability of an explicit method allows; NaN if unknown."""
        fastest = float(np.abs(modes(self.plant, t, x)).max(initial=1e-300))
        return REACHED[method] / fastest / work_per_step(self.plant, method)

    def change(self, t: float) -> None:
        """Count a joint's change between sticking and slipping."""
        self.changes.append(t)
        if len(self.changes) == MAX_CHANGES and t - self.changes[0] < SAME_SPAN * self.duration:
            raise NotFiniteError(
                f"{MAX_CHANGES} changes between sticking and slipping within {t - self.changes[0]:.3g} s at "
                f"t = {t:.6g} s: the torques chatter; smooth the law or sample it",
                t,
            )

    def check_chatter(self) -> None:
        """Raise an error if torques jump close to most of the last states: the motion is held at the jump."""
        self._check_repeats(*self.recent[-1])
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

    def _check_repeats(self, t: float, x: Array) -> None:
        """Raise an error if a law does not repeat its torques: an integrator cannot follow noise."""
        if self.plant.law is None:
            return
        first, again = (np.asarray(self.plant.torque(t, x)) for _ in range(2))
        change, n = np.abs(again - first), self.plant.robot.n
        if change.max() > NOTICED * np.abs(first).max():
            k = int(np.argmax(change[:n]))
            raise NotFiniteError(
                f"the torque of {self.plant.robot.joint_names[k]!r} is {first[k]:.6g} and, asked for again at the same "
                f"time and state, {again[k]:.6g} at t = {t:.6g} s: the law has noise or memory; sample it",
                t,
            )

    def _jump(self, t: float, x: Array, h: float) -> Array | None:
        """The jump of the torques between a state and one a few steps ahead, or None if they are continuous."""
        plant, n = self.plant, self.plant.robot.n

        def torques(state: Array) -> Array:
            return plant.drive_torques(np.array([t]), state[None])

        u = torques(x)
        try:
            ahead = x + REACH * h * plant(t, x)
            beyond = torques(ahead)
            change = np.abs(beyond - u).max()
            if not change > NOTICED * np.abs(u).max():
                return None
            for _ in range(BISECTIONS):
                middle = (x + ahead) / 2
                between = torques(middle)
                if np.abs(between - u).max() >= np.abs(beyond - between).max():
                    ahead, beyond = middle, between
                else:
                    x, u = middle, between
        except (RneError, ValueError):
            return None
        jump: Array = (beyond - u).reshape(n)
        return jump if np.abs(jump).max() > change / 4 else None


def fastest_joint(plant: Plant, x: Array) -> str:
    """Text on the joint with the largest velocity in a state, for messages."""
    n, names = plant.dynamics.n, plant.robot.joint_names
    rates = np.abs(x[n : n + len(names)])
    k = int(np.argmax(rates))
    return f"where {names[k]!r} moves at {rates[k]:.3g} rad/s or m/s"


def choose_method(plant: Plant, x0: Array, duration: float, hold: ZeroOrderHold | None) -> tuple[str, str]:
    """Solver to begin with and the reason: the fastest decaying mode of the motion linearised at the start."""
    if plant.is_conservative:
        return "DOP853", "DOP853: not stiff, nothing damps the motion"
    method, decay = explicit_method(hold), fastest_decay(plant, 0.0, x0)
    if not np.isfinite(decay):
        return method, f"{method}: the motion cannot be linearised at the start"
    times, bound, over = stiffness(plant, hold, decay, duration)
    verdict, sign = ("stiff", ">") if times > bound else ("not stiff", "<=")
    if times > bound:
        method = stiff_method(plant)
        if method == "LSODA" and hold is not None and times > STIFF:
            method = "Radau"  # LSODA, which begins anew at each sample with short steps, needs more
    rate = f"the largest decay rate at the start, {decay:.4g} 1/s"
    return method, f"{method}: {verdict}, {rate}, times {over} is {times:.3g} ({sign} {bound:g})"


def stiffness(plant: Plant, hold: ZeroOrderHold | None, decay: float, left: float) -> tuple[float, float, str]:
    """Time constants of the fastest mode in the remaining time or a sample, the limit if stiff, the time's name."""
    if hold is not None:
        in_machine_code = plant.is_compiled and hold.traced is not None
        bound = STIFF_MACHINE_CODE if in_machine_code else STIFF_SAMPLE
        return decay * hold.period, bound, "the sample time"
    sticks = plant.is_compiled and plant.sticks
    return decay * left, STIFF_STICKING if sticks else STIFF, "the duration"


def explicit_method(hold: ZeroOrderHold | None) -> str:
    """Explicit method for a motion: between samples of a controller, one of short steps."""
    return "DOP853" if hold is None else "Tsit5"


def stiff_method(plant: Plant) -> str:
    """The implicit method for a plant."""
    return RODAS if has_rodas5p(plant) else "LSODA"


def has_rodas5p(plant: Plant) -> bool:
    """True if the equations of motion and their derivatives are machine code and no joint sticks."""
    return plant.is_compiled and not plant.sticks and plant.implicit.slopes.is_unrolled


def work_per_step(plant: Plant, method: str) -> float:
    """Operations of a step of a compiled loop: evaluations, sums of stages, linear systems."""
    operations, size, n = sum(plant.kernel.operations.values()), plant.counted, plant.dynamics.n
    if method != RODAS:
        stages = len(tableau(method).B)
        return stages * operations + stages * (stages + 1) * size
    slopes, rows = sum(plant.implicit.slopes.operations.values()), size - n
    systems = 2 * rows**2 * (rows + size) + 2 * STAGES * rows * size
    return STAGES * operations + SLOPES * slopes + systems + 2 * STAGES * (STAGES + 3) * size


def modes(plant: Plant, t: float, x: Array) -> Array:
    """Eigenvalues of the motion linearised in one state [1/s]; NaN where it cannot be linearised.

    Those of (q, qd, z): impulses and energies are integrals, whose eigenvalues are zero.
    """
    moving = 2 * plant.dynamics.n + plant.dynamics.states
    with suppress(RneError):
        A = plant.linearised(t, x)[:moving, :moving]
        if np.isfinite(A).all():
            return np.linalg.eigvals(A)
    return np.full(1, np.nan)


def fastest_decay(plant: Plant, t: float, x: Array) -> float:
    """Fastest decay of the motion linearised in one state [1/s]; NaN where it cannot be linearised."""
    decays = modes(plant, t, x).real
    return float(max(-decays.min(), 0.0)) + 0.0 if decays.size else float("nan")  # no negative zero
