"""Stability of linear loops, continuous or sampled, with delays and with states of the control law.

The plant is x' = A x + B u(t). Without a sample time u(t) is F (x, z) of `delay` ago, and z' = R (x, z). With a sample
time T the command u_k = F (x, z)_k acts from k T + delay on, until the next one does, and z_k+1 = z_k + T R (x, z)_k by
Euler's rule, as in `rne.simulate`; the rates of a discrete law are (z_k+1 - z_k) / T. With delay = (m + r) T, 0 <= r <
1, and S(t) = integral_0^t exp(A s) ds, exactly

    x_k+1 - x_k = S(T) A x_k + S((1 - r) T) B u_k-m + (S(T) - S((1 - r) T)) B u_k-m-1

(Åström and Wittenmark 1997, Computer-Controlled Systems, section 2.3): a linear map of x, z and the past commands.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import ReadOnlyArrays, positive_number, read_only, real_array
from ..basics.spatial import Array
from ..basics.text import InNotebooks, summary
from .sampled_loop import LARGEST_GROWTH, Window

MARGIN = 1e-9  # smallest significant growth rate relative to the fastest pole; smaller ones are rounding
FREE_POLE = 1e-6  # largest magnitude of a zero pole relative to the fastest one: double poles keep half the digits
EXACT = 1e-9  # relative tolerance of the edges of windows
SLOWEST, FASTEST = 1e2, 0.1  # range of sample times examined, relative to the slowest and to the fastest time constant
STEP, DELAY_STEP = 1.04, 1.3  # ratio of neighbouring sample times or gain factors examined; ratio of delays
SAMPLES_LATE = 8  # largest delay for which windows of sample times are searched [samples]
REACH = 4  # end of the search for windows, relative to the end of the first window
# Phases of vibrations between samples [rad], near half turns, where two eigenvalues meet and windows may be narrow
HALF_TURNS = np.add.outer(np.pi * np.arange(1, 81), np.outer([-1, 1], np.geomspace(3e-3, 1, 5))).ravel()
LARGEST_GAIN = 1e4  # largest gain factor examined for the gain margin
LARGE = 100  # number of past commands from which on modes are counted, as eigenvalues take longer
TERMS = 16  # terms of the Taylor series for norm times time below 1/2: remainder 1e-17
ANGLES, TURN, HALVINGS = 1.06, 0.2, 60  # ratio of contour angles; largest phase step [rad]; refinements
Node = tuple[float, float]  # (sample time, gain or delay; growth rate)


@dataclass(frozen=True, eq=False)
class FeedbackLoop(ReadOnlyArrays):
    """A linear loop in continuous time or sampled, made by `closed_loop`; its attributes are the arguments."""

    A: Any
    B: Any
    F: Any
    R: Any = ()
    sample_time: float | None = None
    delay: float = 0.0

    __repr__ = summary

    def __post_init__(self) -> None:
        N, n, p = (len(np.atleast_1d(given)) for given in (self.A, self.F, self.R))
        for name, shape in {"A": (N, N), "B": (N, n), "F": (n, N + p), "R": (p, N + p)}.items():
            given = getattr(self, name)
            given = given if np.size(given) or np.prod(shape) else np.zeros(shape)
            object.__setattr__(self, name, real_array(name, given, str(shape)))
        positive_number("sample_time", 1.0 if self.sample_time is None else self.sample_time)
        positive_number("delay", self.delay, zero_allowed=True)
        super().__post_init__()

    @cached_property
    def poles(self) -> Array:
        """Poles of the loop in continuous time without its delay, shape (N + p,) [1/s]."""
        return np.asarray(read_only(np.linalg.eigvals(self._closed(self.F))))

    @cached_property
    def is_stable(self) -> bool:
        """True if all motions decay."""
        return self._growth(self.sample_time, self.delay) < -MARGIN

    @cached_property
    def gain_margin(self) -> float:
        """The factor above 1 by which all of the feedback F may be multiplied until the loop is unstable.

        Sample time and delay stay. It is infinite if no factor up to 10^4 is found, and 1 if the loop is not stable.
        """
        factors = geometric(1.0, LARGEST_GAIN, STEP)[1 : None if self.is_stable else 2]
        return end_of_stability(windows(lambda k: self._growth(self.sample_time, self.delay, k), factors))

    @cached_property
    def _stable_factor(self) -> float:
        """The largest of the factors 0.9, 0.8, ... 0.1 of the feedback with which the loop is stable; 0 if none is."""
        growth = ((k, self._growth(self.sample_time, self.delay, k)) for k in np.linspace(0.9, 0.1, 9).tolist())
        return next((k for k, rate in growth if rate < -MARGIN), 0.0)

    @cached_property
    def delay_margin(self) -> float:
        """The additional delay that makes the loop unstable [s]; infinite if none is found, 0 if it is not stable."""
        slowest, fastest = self._extremes
        delays = geometric(FASTEST / fastest / 10, SLOWEST / slowest, DELAY_STEP)[: None if self.is_stable else 1]
        return end_of_stability(windows(lambda t: self._growth(self.sample_time, self.delay + t), delays))

    @cached_property
    def windows(self) -> tuple[Window, ...]:
        """Sample times divided into windows of one verdict, with the delay as it is; 0 is continuous time [s].

        They are found by a search, not proven. All is "undecided" if the loop has motions that nothing holds or damps.
        """
        (slowest, fastest), own = self._extremes, self.sample_time or 0.0
        first = max(FASTEST / fastest, self.delay / SAMPLES_LATE)
        s = np.linalg.eigvals(self.A)
        last = max(min(SLOWEST / slowest, LARGEST_GROWTH / s.real.max(initial=1e-300)), 10 * first, own)
        if -MARGIN <= self._growth(None, 0.0) <= FREE_POLE:
            return (Window(0.0, float(last), "undecided"),)
        near = np.concatenate([HALF_TURNS / rate for rate in s.imag[s.imag > np.abs(s.real)]] or [s.real[:0]])
        times = [*geometric(first, last, STEP), *near[(first < near) & (near < last)], own]
        return windows(lambda T: self._growth(T or None, self.delay), np.unique(times), REACH, own)

    @cached_property
    def sample_map(self) -> Array | None:
        """The map from sample to sample of (x, z, u_k-1, u_k-2, ...), with as many past commands as the delay needs.

        None in continuous time.
        """
        change = None if self.sample_time is None else self._change(self.sample_time, self.delay, self.F)
        return None if change is None else np.asarray(read_only(change + np.eye(len(change))))

    @cached_property
    def _extremes(self) -> tuple[float, float]:
        """Sizes of the slowest pole that is not zero and of the fastest [1/s]."""
        sizes = np.abs(self.poles)
        fastest = sizes.max(initial=0.0) or 1.0
        return float(sizes[sizes > FREE_POLE * fastest].min(initial=fastest)), float(fastest)

    @cached_property
    def _open(self) -> Array:
        """Rates of x and z for zero commands."""
        return np.vstack([np.pad(self.A, ((0, 0), (0, len(self.R)))), self.R])

    def _closed(self, F: Array) -> Array:
        """Rates of x and z of the closed loop in continuous time."""
        return np.asarray(self._open + np.vstack([self.B @ F, 0 * self.R]))

    def _integral(self, t: float) -> Array:
        """Integral S(t) of the matrix exponential: Taylor series for a short time, S(2 h) = 2 S(h) + S(h) A S(h)."""
        doublings = max(0, int(np.ceil(np.log2(t * np.abs(self.A).sum(axis=1).max(initial=1e-300)))) + 1)
        h = t * 0.5**doublings
        term = total = h * np.eye(len(self.A))
        for k in range(2, TERMS):
            term = term @ self.A * (h / k)
            total = total + term
        for _ in range(doublings):
            total = 2 * total + total @ self.A @ total
        return total

    def _sampled(self, T: float, delay: float) -> tuple[Array, Array, Array, int]:
        """Changes over a sample: of x and z without commands, of x by the commands u_k-m and u_k-m-1; and m."""
        m, r = divmod(delay / T, 1.0)
        whole = self._integral(T)
        part = self._integral((1 - r) * T) if r else whole
        own = np.vstack([whole @ self._open[: len(whole)], T * self.R])
        return own, part @ self.B, (whole - part) @ self.B, int(m)

    def _change(self, T: float, delay: float, F: Array) -> Array:
        """Map from sample to sample minus the identity, which keeps all digits for short sample times."""
        own, later, earlier, m = self._sampled(T, delay)
        (N, n), size, late = self.B.shape, len(own), int(np.ceil(delay / T))
        commands = np.eye((late + 1) * n, size + late * n, size - n)  # rows of u_k, u_k-1, ...
        commands[:n, :size], change = F, np.zeros((size + late * n, size + late * n))
        change[:size, :size] = own
        change[:N] += later @ commands[m * n : (m + 1) * n] + earlier @ commands[late * n :]
        change[size:] = commands[: late * n] - np.eye(late * n, len(change), size)
        return change

    def _growth(self, T: float | None, delay: float, gain: float = 1.0) -> float:
        """Largest growth rate relative to the fastest pole; of many past commands only its sign, by counting modes."""
        F = gain * self.F
        if (T is None and delay) or (T and len(F) * delay / T > LARGE):
            return 1.0 if self._unstable_modes(T, delay, F) else -1.0
        z = np.linalg.eigvals(self._change(T, delay, F) if T else self._closed(F))
        fastest = float(np.abs(z).max(initial=0.0) or 1.0)
        if T is None:
            return float(z.real.max(initial=-1.0)) / fastest
        square = float((2 * z.real + np.abs(z) ** 2).max(initial=-1.0))  # |1 + z|^2 - 1
        return float(np.log1p(max(square, -1 + EXACT)) / 2 / min(fastest, 1.0))

    def _unstable_modes(self, T: float | None, delay: float, F: Array) -> int:
        """Number of modes that do not decay, by the argument principle, whose cost does not depend on the delay.

        Along half of the circle |z| = 1 (or of the axis) the phase of det(z - map) turns less by pi for each mode
        outside (on its right) than without any. Between neighbours on it the phase turns by less than TURN.
        """
        N, (slowest, fastest), unit = len(self.A), self._extremes, T or 1.0
        own, later, earlier, m = self._sampled(T, delay) if T else (self._open, self.B, 0 * self.B, 0)
        last = np.pi if T else 1e3 * (fastest + np.abs(self._open).sum() + np.abs(self.B @ F).sum())

        def phases(angles: Array) -> Array:
            s = (1j * angles - MARGIN * fastest * unit)[:, None, None]
            matrix = (np.expm1(s) if T else s) * np.eye(len(own)) - own
            matrix[:, :N] -= (later + earlier * np.exp(-s)) * np.exp(-s * (m if T else delay)) @ F
            return np.asarray(np.linalg.slogdet(matrix)[0])

        angles = geometric(min(FASTEST / 10 * slowest * unit, last / 2), last, ANGLES)
        phase = phases(angles)
        for _ in range(HALVINGS):
            turns = np.angle(phase[1:] * phase[:-1].conj())
            coarse = np.flatnonzero(np.abs(turns) > TURN)
            if not len(coarse):
                break
            between = (angles[coarse] + angles[coarse + 1]) / 2
            angles, phase = (np.insert(x, coarse + 1, y) for x, y in ((angles, between), (phase, phases(between))))
        else:
            return 1  # not known to be stable
        return int(np.ceil(len(own) / (1 if T else 2) - turns.sum() / np.pi - 0.25))


@dataclass(frozen=True, eq=False)
class LinearisedLoop(InNotebooks):
    """Stability of a closed loop near a target, as found by `Scene.check_gains`.

    It holds near the target; no theorem says how near.

    Attributes
    ----------
    loop : FeedbackLoop
        The loop in numbers, without states of the law that nothing depends on, such as the integrals of a PID with
        `ki` = 0. Where the loop has a kink at the target, as abs has, it is linearised on the least stable side.
    windows : tuple of Window
        Sample times with the scene's delay, 0 for continuous time: tuples (start, end, verdict), "stable", "unstable"
        or "undecided" [s].
    sample_time_limit : float
        Smallest sample time found at which the loop with held torques is not stable, a law's states by Euler's rule as
        in `rne.simulate`; infinite if none was, 0 if it is in continuous time [s]. At other sample times than the
        scene's, changes of a discrete law's states are taken to be proportional to the sample time.
    sample_time : float or None
        The scene's sample time [s].
    stable : bool or None
        True if the loop is stable near the target, with torques held and late if the scene's are.
    is_rest : bool
        True if the target is an equilibrium: otherwise the motion leaves it, whatever the poles.
    has_smoothed_friction : bool
        True if Coulomb friction counts as damping, by `coulomb` / `smoothing` at rest and less in larger motions.
    is_of_link : bool
        True if the law holds only a link, as `rne.control.impedance` does without `posture`.
    is_discrete : bool
        True if the loop has states of a discrete law.

    Examples
    --------
    >>> import rne
    >>> arm = rne.load("irb140")
    >>> loop = rne.Scene(arm, controller=rne.control.pd_gravity(arm, 50, 20, 0)).check_gains([0] * 6)
    >>> loop.stable, loop.is_rest, loop.gain_margin
    (True, True, inf)
    """

    loop: FeedbackLoop
    windows: tuple[Window, ...]
    sample_time_limit: float
    sample_time: float | None
    stable: bool | None
    is_rest: bool = True
    has_smoothed_friction: bool = False
    is_of_link: bool = False
    is_discrete: bool = False

    __repr__ = summary

    @property
    def poles(self) -> Array:
        """Poles of the loop in continuous time and without delay [1/s]."""
        return self.loop.poles

    @property
    def gain_margin(self) -> float:
        """The factor above 1 of the law's torques at which the loop becomes unstable; infinite if none was found."""
        return self.loop.gain_margin

    @property
    def delay_margin(self) -> float:
        """The further delay at which the loop becomes unstable; infinite if none was found [s]."""
        return self.loop.delay_margin

    def __str__(self) -> str:
        loop, poles = self.loop, self.poles
        held = "" if self.sample_time is None else f" with torques held for {self.sample_time:g} s"
        held += f" and {loop.delay:g} s late" if loop.delay else ""
        rest = f"\ngain margin {loop.gain_margin:.4g}, delay margin {loop.delay_margin:.4g} s" if self.stable else ""
        if not self.stable and loop._stable_factor:
            rest = f"\nstable with {loop._stable_factor:.1g} times the law's torques"
        rest += "" if self.is_rest else "\nthe target is no equilibrium: the motion leaves it"
        free = int((abs(poles) <= FREE_POLE * abs(poles).max(initial=0)).sum())
        if free and not self.sample_time_limit:  # not stable in continuous time: slow integrals are
            rest += f"\nzero poles: {free} of {len(poles)}, of motions that nothing holds or damps"
            rest += ": the law holds a link, not the joints; give it a `posture`" if self.is_of_link else ""
        if self.has_smoothed_friction:
            rest += (
                "\nsmoothed Coulomb friction damps the loop near rest, less in larger motions: check it without, too"
            )
        limit = f"smallest unstable sample time {self.sample_time_limit:.4g} s"
        limit = limit if np.isfinite(self.sample_time_limit) else "no unstable sample time found"
        if not self.sample_time_limit:
            limit = f"{self.windows[0].verdict} at the shortest sample times{', with this delay' * bool(loop.delay)}"
        elif self.is_discrete:
            limit += ", if the law's states then change in proportion to it"
        return (
            f"linearised at the target, which holds near it only: {'' if self.stable else 'NOT '}stable"
            f"{held}\ncontinuous-time poles from {poles.real.max():.6g} to {poles.real.min():.6g} 1/s; "
            f"{limit}{rest}"
        )


def geometric(first: float, last: float, ratio: float) -> Array:
    """Zero, followed by a geometric sequence from `first` to `last` with at most this ratio."""
    return np.append(0.0, np.geomspace(first, last, int(np.ceil(np.log(last / first) / np.log(ratio))) + 1))


def verdict(growth: float) -> str:
    """ "stable", "unstable" or "undecided" for a growth rate relative to the fastest pole."""
    return "stable" if growth < -MARGIN else "unstable" if growth > MARGIN else "undecided"


def closed_loop(
    A: ArrayLike,
    B: ArrayLike,
    F: ArrayLike,
    R: ArrayLike = (),
    *,
    sample_time: float | None = None,
    delay: float = 0.0,
    discrete: bool = False,
) -> FeedbackLoop:
    """Stability of a linear loop, x' = A x + B u with u = F (x, z) and z' = R (x, z), continuous or sampled.

    Parameters
    ----------
    A, B : array_like, shapes (N, N) and (N, n)
        The plant: of its N states, and of n commands.
    F : array_like, shape (n, N + p)
        Feedback of the plant's states and of the p states of the law, negative feedback with its sign.
    R : array_like, shape (p, N + p), optional
        Rates of the law's states, where it has some.
    sample_time : float, optional
        Commands are held from one sample to the next, and the law's states follow Euler's rule [s].
    delay : float
        Commands act this long after their sample [s].
    discrete : bool
        True if R gives the states of the law at the next sample, z_k+1 = R (x, z)_k. In continuous time, and at other
        sample times, they are taken to change at the rates (z_k+1 - z_k) / `sample_time`, which the result has as R.

    Returns
    -------
    FeedbackLoop
        Its poles, stability, windows of sample times, and margins of gain and delay.

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, a sample time is not positive, a delay is negative, or
        `discrete` is True without a sample time.

    Examples
    --------
    >>> import rne
    >>> loop = rne.control.closed_loop([[0, 1], [0, 0]], [[0], [1]], [[-4, -2]], sample_time=0.1, delay=0.25)
    >>> loop.is_stable, round(loop.gain_margin, 3), round(loop.delay_margin, 3)
    (True, 1.531, 0.056)
    """
    loop = FeedbackLoop(A, B, F, R, sample_time, delay)
    if not discrete:
        return loop
    if loop.sample_time is None:
        raise ValueError("`discrete` needs a `sample_time`: R gives the states at the next sample")
    rows, columns = loop.R.shape
    return replace(loop, R=(loop.R - np.eye(rows, columns, len(loop.A))) / loop.sample_time)


def windows(growth: Callable[[float], float], points: Array, reach: float = 0, least: float = 0) -> tuple[Window, ...]:
    """Windows of one verdict between ascending points, up to `reach` times the end of the first, at least to `least`.

    An extremum between points that changes the verdict is searched for.
    """
    nodes, changes = [(float(points[0]), growth(float(points[0])))], list[tuple[Node, Node]]()
    for point in points[1:].tolist():
        nodes.append((point, growth(point)))
        peak = hidden_peak(growth, *nodes[-3:]) if len(nodes) > 2 else None
        pairs = pairwise(nodes[-2:] if peak is None else sorted([*nodes[-3:], peak]))
        changes += [(a, b) for a, b in pairs if verdict(a[1]) != verdict(b[1])]
        if changes and point > max(reach * changes[0][1][0], least):
            break
    edges = [edge(growth, *change) for change in changes]
    names = [verdict(nodes[0][1]), *(verdict(b[1]) for _, b in changes)]
    return tuple(map(Window, [nodes[0][0], *edges], [*edges, nodes[-1][0]], names))


def hidden_peak(growth: Callable[[float], float], *nodes: Node) -> Node | None:
    """Local extremum between three nodes at which the verdict differs from the middle one's, or None."""
    from scipy.optimize import minimize_scalar

    (start, before), (_, value), (end, behind) = nodes
    side = 1.0 if value > 0 else -1.0
    rises = side * (before - value), side * (behind - value)
    if min(rises) <= 0 or sum(rises) < side * value or verdict(value) == "undecided":
        return None
    found = minimize_scalar(lambda x: side * growth(x), bounds=(start, end), method="bounded")
    return (float(found.x), side * float(found.fun)) if verdict(side * float(found.fun)) != verdict(value) else None


def edge(growth: Callable[[float], float], before: Node, behind: Node) -> float:
    """Zero of the growth rate between two nodes; an undecided window begins and ends at a node."""
    from scipy.optimize import brentq

    (start, first), (end, last) = before, behind
    if first * last < 0:
        return float(brentq(growth, start, end, xtol=EXACT * end, rtol=EXACT))
    return start if verdict(last) == "undecided" else end


def end_of_stability(found: tuple[Window, ...]) -> float:
    """End of the first window if stable, infinite if it is the only one; its start if it is not stable."""
    first, *others = found
    return first.start if first.verdict != "stable" else first.end if others else float("inf")
