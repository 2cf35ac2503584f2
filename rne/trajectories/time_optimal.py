"""Fastest motion along a path, under limits of torques, velocities and accelerations.

Along a path q(s), with u = s'' and x = s'^2 of the motion s(t), velocities and accelerations are

    qd = q'(s) sqrt(x),  qdd = q'(s) u + q''(s) x,  so that  tau = a(s) u + b(s) x + c(s) + friction

(Bobrow, Dubowsky and Gibson 1985, (8)). At each point of a grid every limit is a pair of inequalities, linear in u and
x; the library toppra finds the largest x that keeps them all (Pham and Pham 2018). Coulomb friction belongs to c: its
sign is that of q'(s). Viscous friction grows with sqrt(x), which is replaced by its tangent at the last solution until
they agree; where it saturates, its ratio to sqrt(x) is taken from the last solution too, as is the Stribeck effect.
Friction under load makes of a torque limit one above, of (1 + load) times the torque of inverse dynamics in the
direction of motion, and one below, of (1 - load) times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import cached_array, positive_number
from ..basics.spatial import Array
from ..basics.text import InNotebooks, column, listed, table
from ..dynamics.kinematics import joint_accelerations, joint_positions, joint_velocities
from ..dynamics.limits import limit_shares, share_texts
from ..graph.scalar import is_traced
from ..robot import Robot, robot_argument
from ..simulation.friction import Friction
from ..simulation.scene import Payload, Scene
from ..simulation.springs import JointSpring, Spring
from .profiles import Path, ReferenceMotion, made_by, through

GRID = 100  # initial intervals of a piece
ACCURACY = 5e-4  # largest excess over a limit between grid points before the grid is refined, relative
UNUSED = 0.007  # gap to every limit above which the grid is refined, relative
CLOSER, ROUNDS = 16, 8  # most parts of an interval; most refinements of the grid
NEAR = 0.02  # distance of grid points from the expected meeting of arcs, relative to an interval
WAY = 0.1  # length of each piece in the linear programs whose intervals have separate units
BELOW = 1e-9  # relative distance of x below the largest, so that the next program has a solution
SHORTEST = 1e-5  # shortest interval that is divided, relative to the duration
AGREE = 3e-4  # agreement of viscous friction and its tangent, relative to a limit
TANGENT = 1e-4  # viscous friction below which its tangent is kept, relative to a limit
SLOWEST = 1e-4  # smallest x at which tangents are tried, relative
PASSES = 30  # most iterations of viscous friction, and of the smoothing
NEWTON = 4  # Newton steps for the time at which an averaged motion passes a grid point
BESIDE = 1e-9  # distance of times on both sides of it, relative to the duration: there a joint may turn
AVERAGED = 0.01  # interval over which accelerations are averaged [s]: current controllers of drives can follow
AT_LIMIT = 0.99  # share of a limit from which it counts as used
SLOW, STEP = 1e-30, 1e-40  # speed of friction at rest in the direction of motion; no `smoothing` [rad/s or m/s]
CREEP = 1e-12  # rate s' at a stop [1/s]: Coulomb friction has the sign of the motion that begins or ends there
OUT_OF_RANGE = 1e-9  # tolerance of a joint's range [rad or m]: rounding of splines with points at its end
MILLISECOND = 1e-3  # interval over which steps of torques and accelerations are measured [s]


class MissingLimit(ValueError):
    """Raised for a joint without any limit that would bound its motion."""


class OutOfRange(ValueError):
    """Raised for a path that leaves the range of a joint."""


@dataclass(frozen=True, eq=False)
class _Limits:
    """Limits of a scene's robot: limits of torques and accelerations are rows, limits of velocities are bounds of x."""

    scene: Scene

    @cached_property
    def robot(self) -> Robot:
        return self.scene.resolved.robot

    @cached_property
    def friction(self) -> Friction:
        return self.scene.resolved.friction or Friction()

    @cached_property
    def known(self) -> dict[str, Array]:
        return self.robot.model.coordinate_limits()

    @property
    def changes(self) -> bool:
        """True for friction that is not proportional to speed, where it varies with it."""
        return self.friction.saturation is not None or bool(np.any(self.friction.stribeck_rise))

    def springs(self, q: Array, qd: Array) -> Array:
        """Torques of drives against springs, (T, n)."""
        springs = self.scene.resolved.springs
        return np.zeros_like(q) if springs is None else springs.torque(self.robot, q, qd)

    @cached_property
    def kinds(self) -> tuple[int, ...]:
        """Kinds of limits of each n rows: 0 if they are limited on both sides, 1 above, 2 below."""
        return (1, 2, 1, 2) if np.any(self.friction.load) else (0, 1, 2)

    @cached_property
    def following(self) -> list[int]:
        """Coupled joints, whose velocities and accelerations are limited too."""
        return [i for i, *_ in self.robot.model.coupled_joints]

    @cached_property
    def of_all(self) -> dict[str, Array]:
        """Limits of the coordinates, followed by those of the coupled joints, which have no torques."""
        model, own = self.robot.model, self.following
        other = {"deceleration_limit": model.braking_limit, "effort_limit": np.full(model.nb, np.inf)}
        return {name: np.append(x, other.get(name, getattr(model, name))[own]) for name, x in self.known.items()}

    def rates(self, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
        """Velocities and accelerations of the coordinates, followed by those of the coupled joints."""
        if not self.following:
            return qd, qdd
        pair = joint_velocities(self.robot.model, q, qd), joint_accelerations(self.robot.model, q, qd, qdd)
        rate, change = (np.concatenate([x, y[..., self.following]], -1) for x, y in zip((qd, qdd), pair, strict=True))
        return rate, change

    def padded(self, values: Array, by: float = 0.0) -> Array:
        """Values of the coordinates, followed by a constant for the coupled joints."""
        missing = len(self.of_all["lower"]) - values.shape[-1]
        return np.concatenate([values, np.full((*values.shape[:-1], missing), by)], -1) if missing else values

    def rows(self, torque: Array, acceleration: Array) -> Array:
        """Torques, accelerations and decelerations over their limits, 0 where there is none."""
        turned, moved = self.padded(torque), self.padded(acceleration)
        both = (moved / self.of_all[f"{name}_limit"] for name in ("acceleration", "deceleration"))
        return np.concatenate([turned / self.of_all["effort_limit"]] * (len(self.kinds) - 2) + [*both], axis=-1)

    def under_load(self, sign: Array) -> Array:
        """Factors of the rows of torques of inverse dynamics by friction under load, in the direction of motion."""
        if len(self.kinds) == 3:
            return np.ones(1)
        lost = self.padded(np.asarray(self.friction.load) * sign)
        sign = self.padded(sign)
        return np.concatenate([1 + lost, 1 - lost, np.ones_like(sign), np.ones_like(sign)], axis=-1)

    def shares(self, q: Array, qd: Array, qdd: Array) -> dict[str, Array]:
        """Shares of the limits of torques, accelerations and velocities, shape (..., n) each."""
        return limit_shares(self.known, qd, qdd, self.scene.inverse_dynamics(q, qd, qdd))

    def largest_shares(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Largest share of torques and accelerations, and of velocities, shape (2, ...), coupled joints included."""
        tau = self.padded(self.scene.inverse_dynamics(q, qd, qdd))
        shares = limit_shares(self.of_all, *self.rates(q, qd, qdd), tau)
        torque, acceleration, velocity = (x.max(-1, initial=0) for x in shares.values())
        return np.stack([np.maximum(torque, acceleration), velocity])


@dataclass(frozen=True, eq=False)
class _Piece:
    """Path between two stops, with the limits."""

    limits: _Limits
    path: Path
    index: int

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        """q, q' and q'' at parameters."""
        curve = self.path.pieces[self.index]
        q, d1, d2 = (np.asarray(curve(s, order)) for order in range(3))
        return q, d1, d2

    @cached_property
    def first_grid(self) -> Array:
        """Initial grid: equal times, via points, and points where a joint turns and its friction changes its sign."""
        curve = self.path.pieces[self.index]
        turns = [r[(r > 0) & (r < 1)] for r in curve.derivative().roots(extrapolate=False)]
        grid = np.unique(np.concatenate([(1 - np.cos(np.linspace(0, np.pi, GRID + 1))) / 2, curve.x, *turns]))
        return np.asarray(grid[np.concatenate([[True], np.diff(grid) > 1e-7])])

    def coefficients(self, grid: Array) -> tuple[Array, Array, Array, Array, Array]:
        """a, b, c and viscous friction v over the limits at both ends of each interval (2, N, rows), and the largest x.

        By one call of the inverse dynamics for all: c = ID(q, 0, 0), a = ID(q, 0, q') - c, b = ID(q, q', q'') - c.
        """
        limits, rows = self.limits, self.limits.rows
        q, d1, d2 = self.derivatives(grid)
        zero = np.zeros_like(q)
        states = (np.stack(x) for x in ((q, q, q), (zero, zero, d1), (zero, d1, d2)))
        c, ac, bc = limits.robot.inverse_dynamics(*states)
        middle = self.derivatives((grid[1:] + grid[:-1]) / 2)  # q' does not change its sign between grid points
        inside, (every, _), (rates, changes) = middle[1], limits.rates(*middle), limits.rates(q, d1, d2)
        springs = limits.springs(q, zero)
        ends = [rows(part, by) for part, by in ((ac - c, rates), (bc - c, changes), (c + springs, zero))]
        a, b, c = (np.stack([x[:-1], x[1:]]) for x in ends)
        nothing, sign = np.zeros_like(inside), np.sign(inside)
        loaded = limits.under_load(sign)
        c = c * loaded + rows(limits.friction.coulomb_torque(sign * SLOW) + np.asarray(limits.friction.offset), nothing)
        ways = np.sign(every)  # of accelerations in the direction of motion
        along = [np.ones_like(ways)] * (len(limits.kinds) - 2) + [ways, ways]
        a, b = (x * loaded * np.concatenate(along, axis=1) for x in (a, b))
        v, _ = self.slowing(grid, np.full((2, len(inside)), SLOW**2))
        return a, b, c, v, self._largest(rates, every)

    def _largest(self, rates: Array, every: Array) -> Array:
        """Largest x by limits of velocities at grid points; `every` has the rates between them."""
        with np.errstate(divide="ignore"):
            fastest = self.limits.of_all["velocity_limit"]
            largest, within = (1 / np.max((slope / fastest) ** 2, axis=1) for slope in (rates, every))
        beside = np.minimum(np.append(within[:1], within), np.append(within, within[-1:]))
        # Where all joints turn, x is free, but not close to that point.
        return np.asarray(np.where(largest > 2 * beside, beside / 2, largest))

    def slowing(self, grid: Array, x: Array) -> Array:
        """Viscous friction and damping over sqrt(x), and Coulomb friction beyond that at rest, (2, 2, N, rows).

        For x at both ends of each interval.
        """
        limits, friction, found = self.limits, self.limits.friction, []
        q, d1, _ = self.derivatives(grid)
        damping = limits.springs(q, d1) - limits.springs(q, np.zeros_like(q))
        sign = np.sign(self.derivatives((grid[1:] + grid[:-1]) / 2)[1])
        for root, slope, z in zip(np.sqrt(x)[..., None], (d1[:-1], d1[1:]), (damping[:-1], damping[1:]), strict=True):
            qd = sign * np.abs(slope) * root
            falls = friction.coulomb_torque(qd) - friction.coulomb_torque(sign * SLOW) if limits.changes else 0 * qd
            viscous, fallen, damped = (limits.rows(y, 0 * qd) for y in (friction.viscous_torque(qd) / root, falls, z))
            found.append([viscous + damped * limits.under_load(sign), fallen])
        return np.stack(found, axis=1)


def _largest_x(grid: Array, a: Array, b: Array, c: Array, largest: Array, kinds: Sequence[int]) -> Array | None:
    """Values of x at the grid points of the fastest motion from rest to rest; None if there is none."""
    with np.errstate(divide="ignore"):
        by_each = 1 / np.minimum(largest[1:], largest[:-1]), np.abs(a).max((0, 2)) * 4, np.abs(b).max((0, 2)) * 4
    usual, own = max(map(np.median, by_each)), np.max(by_each, axis=0)  # 1 / x, of all intervals and of each
    own = np.where(own > 0, own, usual or 1.0)
    # toppra has absolute tolerances and may fail on one scale: x of order 100, in one unit or one for each interval.
    tried = [(usual**0.5 / 10**k, np.full(len(own), 10.0 ** (2 * k) / usual)) for k in (1, 2, 0) if usual > 0]
    for way, unit in (*tried, *((WAY, 10.0**k / own) for k in (2, 4, 0))):
        x = _two_passes(grid * way, a * (unit * way)[:, None], b * unit[:, None], c, largest, unit, kinds)
        if x is not None:
            return x
    return None


def _two_passes(
    grid: Array, a: Array, b: Array, c: Array, largest: Array, unit: Array, kinds: Sequence[int]
) -> Array | None:
    """Values of x by the two passes of Pham and Pham 2018, Algorithm 1; toppra solves their linear programs.

    Inequalities hold at both ends of each interval, along which u is constant: |a u + b x + c| <= 1, with u and x in a
    unit of the interval's own. With toppra's own passes the same takes four times as long.
    """
    try:
        from toppra.constraint import LinearConstraint
        from toppra.solverwrapper.cy_seidel_solverwrapper import seidelWrapper
    except ModuleNotFoundError:
        raise ImportError("`fastest` needs toppra, which is not installed: pip install 'rne[fastest]'") from None

    limited, kind = np.any([a, b, c], axis=(0, 1, 2)), np.repeat(kinds, a.shape[-1] // len(kinds))
    a, b, c, kind = (x[..., limited] for x in (a, b, c, kind))
    ones = np.eye(2 * len(kind))
    sides = np.vstack([ones[np.tile(kind != 2, 2)], -ones[np.tile(kind != 1, 2)]])
    h2 = 2 * np.diff(grid)

    class GridConstraint(LinearConstraint):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.identical = True

        def compute_constraint_params(self, *_: Any) -> tuple[Any, ...]:
            by_u = np.hstack([a[0], a[1] + h2[:, None] * b[1]])  # x at the end is x + 2 u (s_end - s)
            parts = (np.vstack([x, x[-1:]]) for x in (by_u, np.hstack([b[0], b[1]]), np.hstack([c[0], c[1]])))
            most = np.minimum(largest / np.append(unit, unit[-1]), 1e8)
            bounds = np.stack([np.zeros_like(most), most], axis=1)
            return (*parts, sides, np.ones(len(sides)), None, bounds)

    program = seidelWrapper([GridConstraint()], SimpleNamespace(duration=grid[-1]), grid, True).solve_stagewise_optim
    slowest, quickest, held = np.array([-1e-9, 1.0]), np.array([1e-9, -1.0]), np.abs(c).max((0, 2), initial=0) <= 1
    low, high, x = np.zeros((3, len(grid))).tolist()
    for i in reversed(range(len(h2))):  # the x from which the motion can come to rest at the end
        size = float(unit[i])
        following = low[i + 1] / size, high[i + 1] / size
        high[i] = program(i, None, quickest, np.nan, np.nan, *following)[1] * (1 - BELOW) * size
        if low[i + 1] or not held[i]:  # elsewhere it can stand still
            low[i] = max(program(i, None, slowest, np.nan, np.nan, *following)[1] * size, 0.0)
    if np.isnan(high).any() or low[0] > BELOW * unit[0]:
        return None
    for i, by in enumerate(np.stack([-h2, -np.ones(len(h2))], axis=1)):  # from the start, each x as large as can be
        size = float(unit[i])
        u = program(i, None, by, x[i] / size, x[i] / size, low[i + 1] / size, high[i + 1] / size)[0]
        x[i + 1] = min(max(x[i] - by[0] * u * size, low[i + 1]), high[i + 1])
    found = np.asarray(x)
    return found if (found[1:-1] > 0).all() else None


@dataclass(frozen=True, eq=False)
class _Profile:
    """Motion s(t) on a piece: constant u between grid points, averaged over the last `window` seconds."""

    grid: Array
    x: Array
    window: float = 0.0
    slowed: float = 1.0  # times that it is driven slower than solved, to keep the limits

    @cached_property
    def u(self) -> Array:
        """Accelerations s'' between the grid points."""
        return np.asarray(np.diff(self.x) / (2 * np.diff(self.grid)))

    @cached_property
    def times(self) -> Array:
        """Times at which the grid points are passed."""
        speed = np.sqrt(self.x)
        return np.concatenate([[0.0], np.cumsum(2 * np.diff(self.grid) / (speed[1:] + speed[:-1]))])

    @property
    def duration(self) -> float:
        return float(self.times[-1]) + self.window

    @cached_property
    def _curves(self) -> tuple[Any, ...]:
        """Integral of s, and s, s', s''."""
        from scipy.interpolate import PPoly

        s = PPoly(np.stack([self.u / 2, np.sqrt(self.x[:-1]), self.grid[:-1]]), self.times)
        return s.antiderivative(), s, s.derivative(), s.derivative(2)

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """s, s' and s'' at times from 0 to the duration."""
        integral, *curves = self._curves
        end = self.times[-1]
        if not self.window:
            s, v, u = (curve(np.minimum(t, end)) for curve in curves)
            return s, np.maximum(v, CREEP), u
        now, then = np.clip(t, 0, end), np.clip(t - self.window, 0, end)
        area = integral(now) - integral(then) + self.grid[-1] * np.maximum(t - end, 0)
        (s1, s0), (v1, v0) = ((curve(now), curve(then)) for curve in curves[:2])
        return area / self.window, np.maximum((s1 - s0) / self.window, CREEP), (v1 - v0) / self.window

    @cached_property
    def instants(self) -> Array:
        """Times of all corners of s'', around those at which grid points are passed, and one between each two."""
        if not self.window:
            return np.sort(np.concatenate([self.times, (self.times[1:] + self.times[:-1]) / 2]))
        corners = np.unique(np.concatenate([self.times, self.times + self.window]))
        s = self.at(corners)[0]
        after = np.clip(np.searchsorted(s, self.grid), 1, len(s) - 1)
        passed = np.interp(self.grid, s, corners)
        for _ in range(NEWTON):
            s, v, _ = self.at(passed)
            passed = np.clip(passed - (s - self.grid) / v, corners[after - 1], corners[after])
        beside = BESIDE * self.duration
        t = np.unique(np.concatenate([corners, passed]))
        around = np.clip(np.concatenate([passed - beside, passed + beside]), 0, self.duration)
        return np.unique(np.concatenate([t, (t[1:] + t[:-1]) / 2, around]))

    def states(self, piece: _Piece, t: Array) -> tuple[Array, Array, Array]:
        """q, qd and qdd at times."""
        s, v, u = (x[..., None] for x in self.at(t))
        q, d1, d2 = piece.derivatives(s[..., 0])
        return q, d1 * v, d1 * u + d2 * v**2


def _solve(piece: _Piece, grid: Array, guess: Array | None, allowed: Array | None = None) -> Array | None:
    """x at grid points, with viscous friction by tangents until they agree; None if the path cannot be driven.

    Only a part of the limits may be `allowed` at each grid point, shape (2, N + 1): of rows and of velocities.
    """
    a, b, c, v, largest = piece.coefficients(grid)
    least = np.ones(c.shape[:2])
    if allowed is not None:
        most = np.maximum(np.stack([allowed[0, :-1], allowed[0, 1:]]), 1.05 * np.abs(c).max(-1, initial=0))
        least = np.minimum(most, 1)
        a, b, c, v = (part / least[..., None] for part in (a, b, c, v))
        largest = largest * allowed[1] ** 2
    kinds, changes = piece.limits.kinds, piece.limits.changes
    if not v.any() and not changes:
        return _largest_x(grid, a, b, c, largest, kinds)
    floor, steady = _slowest_and_steady(c, v, changes=changes)
    x = _largest_x(grid, a, b, c, largest, kinds) if guess is None else guess
    at = steady if x is None else np.stack([x[:-1], x[1:]])
    x, known, scale, last, weight = guess, guess is not None, 1.0, np.inf, 1.0
    for _ in range(PASSES):
        tried = at if known else np.minimum(at, steady)
        near = np.maximum(np.where(np.isfinite(tried), scale * tried, floor), floor)[..., None]
        v, fallen = piece.slowing(grid, near[..., 0]) / least[..., None] if changes else (v, 0.0)
        found = _largest_x(grid, a, b + v / (2 * np.sqrt(near)), c + v * np.sqrt(near) / 2 + fallen, largest, kinds)
        if found is None:  # a tangent at a lower speed adds less to what a joint needs at rest
            known, scale = False, scale if known else scale / 4
            if scale < SLOWEST:
                return None
            continue
        new = np.stack([found[:-1], found[1:]])
        then, low = piece.slowing(grid, np.maximum(new, floor)) / least[..., None] if changes else (v, 0.0)
        gap = np.abs(
            v * (near + new[..., None]) / (2 * np.sqrt(near)) - then * np.sqrt(new[..., None]) + fallen - low
        ).max()
        weight = weight if gap < last / 1.2 else max(weight / 2, 1 / 16)
        at = np.exp((1 - weight) * np.log(near[..., 0]) + weight * np.log(np.maximum(new, floor)))
        x, known, scale, last = found, True, 1.0, gap
        if gap < AGREE:
            break
    return x


def _slowest_and_steady(c: Array, v: Array, *, changes: bool) -> tuple[Array, Array]:
    """Least x at which tangents are taken, and that at which friction uses up the torque, (2, N) each."""
    strongest, sign = np.abs(v).max(-1), np.sign(v)
    floor = np.where(
        strongest > 0, (TANGENT / np.where(strongest > 0, strongest, 1)) ** 2, SLOWEST**2 if changes else 1
    )
    with np.errstate(divide="ignore", invalid="ignore"):  # no faster than friction allows at a constant speed
        steady = np.nanmin(np.where(sign * c < 1, np.where(v == 0, np.inf, ((1 - sign * c) / v) ** 2), np.inf), axis=-1)
    return floor, steady


def _infeasible(piece: _Piece, grid: Array) -> str:
    """Text of the place where a joint needs most of its torque to stand still."""
    at_rest = np.abs(piece.coefficients(grid)[2]).max(0)
    k, row = np.unravel_index(int(at_rest.argmax()), at_rest.shape)  # a torque's: nothing accelerates
    j = int(row) % piece.limits.robot.n
    joint, limit = piece.limits.robot.joint_names[j], piece.limits.known["effort_limit"][j]
    share = at_rest[k, row]
    place = piece.path.via(piece.index, float(grid[k]))
    if share < 1:
        return f"`path`: toppra finds no motion; at rest it needs most {place}, {share:.0%} of joint {joint!r}"
    return (
        f"`path` cannot be driven: {place}, joint {joint!r} needs a torque of {share * limit:.4g} only for gravity "
        f"and Coulomb friction; its limit is {limit:.4g}"
    )


def _finer(piece: _Piece, grid: Array, x: Array) -> Array:
    """Grid with further points where the motion exceeds a limit between two points or uses none."""
    profile, h, inside = _Profile(grid, x), np.diff(grid), np.array([[0.01], [0.25], [0.5], [0.75], [0.99]])
    q, d1, d2 = piece.derivatives(grid[:-1] + inside * h)
    square = (x[:-1] + inside * np.diff(x))[..., None]
    most = piece.limits.largest_shares(q, d1 * np.sqrt(square), d1 * profile.u[:, None] + d2 * square).max(axis=0)
    beyond, unused = np.maximum(most.max(0) - 1, 0), 1 - most.min(0)
    long = np.diff(profile.times) > SHORTEST * profile.times[-1]
    # Where the limit in use changes, u jumps: there the arcs of both neighbours meet, at this share of the interval.
    before, after = np.append(0.0, profile.u[:-1]), np.append(profile.u[1:], 0.0)
    meet = (profile.u - after) / np.where(before == after, np.inf, before - after)
    around = np.maximum(np.append(0.0, unused[:-1]), np.append(unused[1:], 0.0))
    switch = long & (unused > np.maximum(UNUSED, 4 * around)) & (np.abs(meet - 0.5) < 0.5 - NEAR)
    parts = np.maximum(np.sqrt(beyond / ACCURACY), unused / UNUSED)
    parts = np.ceil(np.where(long, np.clip(parts, 1, np.where(switch, 4, CLOSER)), 1)).astype(int)
    step = np.repeat(h / parts, parts)
    number = np.arange(len(step)) - np.repeat(np.cumsum(parts) - parts, parts)
    near = (meet + np.array([[-NEAR], [0], [NEAR]]))[:, switch]
    return np.unique(
        np.concatenate(
            [np.repeat(grid[:-1], parts) + number * step, grid[-1:], (grid[:-1][switch] + near * h[switch]).ravel()]
        )
    )


def _fastest_profile(piece: _Piece) -> _Profile:
    """Time-optimal profile of a piece on a grid that is refined where needed."""
    grid, finer, x = piece.first_grid, piece.first_grid, None
    for _ in range(ROUNDS):
        x, grid = _solve(piece, finer, None if x is None else np.interp(finer, grid, x)), finer
        if x is None:
            raise ValueError(_infeasible(piece, grid))
        finer = _finer(piece, grid, x)
        if len(finer) == len(grid):
            break
    return _averaged(piece, _Profile(grid, np.asarray(x)), 0.0)


def _excess(piece: _Piece, profile: _Profile) -> Array:
    """Largest shares of torques and accelerations, and of velocities, at instants: (2, K)."""
    return piece.limits.largest_shares(*profile.states(piece, profile.instants))


def _slowed(piece: _Piece, profile: _Profile, message: str) -> _Profile:
    """Profile slowed down until it keeps all limits."""
    for _ in range(PASSES):
        excess = float(_excess(piece, profile).max())
        if excess <= 1 + 2 * ACCURACY:
            return profile
        slower = max(2 - excess - ACCURACY, 0.5)
        profile = replace(profile, x=profile.x * slower**2, slowed=profile.slowed / slower)
    raise ValueError(message)


def _averaged(piece: _Piece, fastest: _Profile, window: float) -> _Profile:
    """Profile averaged over a window, if there is one, and slowed down where it would exceed a limit."""
    allowed = np.ones((2, len(fastest.grid)))
    x, points = fastest.x, np.arange(len(fastest.grid))
    for _ in range(PASSES):
        rows = _Profile(fastest.grid, x, window)
        t, excess = rows.instants, _excess(piece, rows)
        if excess.max() <= 1 + 2 * ACCURACY:
            return rows
        first, last = np.searchsorted(rows.times, t - window, "right") - 1, np.searchsorted(rows.times, t)
        # An instant concerns the grid points first to last, so a grid point the instants of a range; the last one is 1.
        ranges = np.stack([np.searchsorted(last, points), np.searchsorted(first, points, "right")], axis=1)
        beyond = np.append(np.where(excess > 1 + ACCURACY, excess, 1.0), [[1.0], [1.0]], axis=1)
        allowed *= 1 / np.maximum.reduceat(beyond, ranges.ravel(), axis=1)[:, ::2]
        found = _solve(piece, fastest.grid, x, allowed)
        if found is None:
            break
        x = found
    message = f"`smoothing` of {window:g} s is too long for this path: averaged motions exceed a limit; give less, or 0"
    message = message if window else "`path`: toppra finds no motion within all limits"
    return _slowed(piece, _Profile(fastest.grid, x, window), message)


@made_by("fastest")
@dataclass(frozen=True, eq=False)
class FastestMotion(ReferenceMotion, InNotebooks):
    """Fastest motion along a path, made by `fastest`; `print` shows which limits it uses and how smooth it is.

    Attributes
    ----------
    path : Path
    smoothing : float
        The time over which the place on the path is averaged [s].
    unsmoothed_duration : float
        Duration of the motion without smoothing [s].

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140").with_limits(effort=[250, 250, 150, 50, 50, 20])
    >>> motion = rne.trajectories.fastest(robot, [[0] * 6, [1, 0.5, 0, 0, 0, 0]])
    >>> round(motion.duration - motion.unsmoothed_duration, 3), motion.torques(0.2).shape
    (0.01, (6,))
    >>> motion.shares()["velocity"].max().round(3).item(), motion.steps()[0][0].round().item()
    (1.0, 25.0)
    """

    path: Path
    smoothing: float
    unsmoothed_duration: float
    _limits: _Limits
    _profiles: tuple[_Profile, ...]

    def __repr__(self) -> str:
        return f"FastestMotion({self.duration:.6g} s along {self.path!r})"

    @property
    def scene(self) -> Scene:
        """Scene of the plan: the robot with payload, friction and springs."""
        return self._limits.scene

    @cached_property
    def _starts(self) -> Array:
        return np.concatenate([[0.0], np.cumsum([profile.duration for profile in self._profiles])])

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return float(self._starts[-1])

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times at which accelerations jump, switches from one limit to another, if the motion is not smoothed [s]."""
        found = [np.asarray(self._starts)]
        for start, profile in zip(self._starts, self._profiles, strict=False):
            if not profile.window:
                jump = np.abs(np.diff(profile.u)) > 0.02 * np.abs(profile.u).max()
                found.append(start + profile.times[1:-1][jump])
        return tuple(np.unique(np.concatenate(found)).tolist())

    def _at(self, t: Array) -> tuple[Array, Array, Array]:
        if is_traced(t):
            raise TypeError("a motion along a path is evaluated with numbers and cannot be traced")
        times = t[..., 0] if t.ndim else t
        flat = np.clip(times, 0.0, self.duration).reshape(-1)
        which = np.clip(np.searchsorted(self._starts, flat, side="right") - 1, 0, len(self._profiles) - 1)
        out = np.zeros((3, len(flat), self.path.points.shape[1]))
        for k, profile in enumerate(self._profiles):
            here = which == k
            out[:, here] = profile.states(_Piece(self._limits, self.path, k), flat[here] - self._starts[k])
        rest = (times.reshape(-1) < 0) | (times.reshape(-1) > self.duration)
        out[1:, rest] = 0.0
        q, qd, qdd = out.reshape(3, *times.shape, out.shape[-1])
        return q, qd, qdd

    def torques(self, t: ArrayLike) -> Array:
        """Torques of the drives at given times, friction included; controllers hold their mean over each sample.

        Parameters
        ----------
        t : float or array_like, shape (T,) or (..., 1)
            Times [s].

        Returns
        -------
        ndarray, shape (n,) for one time, (T, n) for T times
            [N m or N].
        """
        return self.scene.inverse_dynamics(*self(t))

    @cached_array
    def instants(self) -> Array:
        """Times of all corners of the motion, around those at which joints may turn, and one between each two [s]."""
        starts = zip(self._starts, self._profiles, strict=False)
        return np.unique(np.concatenate([start + profile.instants for start, profile in starts]))

    def shares(self) -> dict[str, Array]:
        """Shares of their limits that the joints use.

        Returns
        -------
        dict of str to ndarray, shape (T, n)
            "torque", "acceleration" and "velocity" over their limits at `instants`, 0 where there is no limit.
        """
        return self._limits.shares(*self(self.instants))

    def steps(self) -> tuple[Array, Array]:
        """Largest steps of torques and largest jerks of the joints, over one millisecond.

        Returns
        -------
        torque : ndarray, shape (n,)
            [N m/ms or N/ms].
        jerk : ndarray, shape (n,)
            [rad/s^3 or m/s^3].
        """
        t = np.stack([self.instants, self.instants + MILLISECOND])
        torque, qdd = (
            np.abs(np.diff(x, axis=0)[0]).max(0) for x in (self.torques(t[..., None]), self(t[..., None])[2])
        )
        return torque, qdd / MILLISECOND

    def __str__(self) -> str:
        cost = self.duration - self.unsmoothed_duration
        smooth = f"; {cost:.3g} s of it for smoothing over {1e3 * self.smoothing:g} ms" if self.smoothing else ""
        slowed = max(profile.slowed for profile in self._profiles)
        smooth += f"; driven up to {slowed:.3g} times slower than solved, to keep the limits" if slowed > 1 else ""
        lines = [f"Fastest motion along the path: {self.duration:.6g} s{smooth}"]
        shares, steps, known = self.shares(), self.steps(), self._limits.known
        at_a_limit = (np.stack([*shares.values()]) >= AT_LIMIT).any(axis=0)
        accelerations = np.minimum(known["acceleration_limit"], known["deceleration_limit"])
        limits = known["effort_limit"], accelerations, known["velocity_limit"]
        columns = map(share_texts, shares.values(), limits)
        heads = ("torque", "accel.", "velocity", "at a limit", "torque step", "jerk")
        times = column(np.gradient(self.instants) / self.duration @ at_a_limit, ".0%")
        further = (times, *(column(x, ".3g") for x in steps))
        rows = table("joint", heads, self._limits.robot.joint_names, *columns, *further)
        notes = (
            "largest share of each limit; share of the time at one; steps per ms in N m, jerk in rad/s^3 (N, m/s^3)",
            f"-: no limit; limits hold to {2 * ACCURACY:.1%} throughout",
        )
        return "\n".join([*lines, *rows, *notes])


def fastest(
    robot: Robot,
    path: Path | ArrayLike,
    *,
    friction: Friction | str | None = None,
    payload: Payload | float | None = None,
    smoothing: float | None = None,
    springs: Sequence[Spring | JointSpring] | None = None,
) -> FastestMotion:
    """Fastest motion along a path under the robot's limits of torques, velocities and accelerations.

    Parameters
    ----------
    robot : Robot
        With `effort_limit` or `acceleration_limit`, or both, of every joint; `Robot.with_limits` sets them.
        `deceleration_limit` holds while joints slow down; smoothed motions may exceed it by a few percent for a few ms
        before a joint turns around.
    path : Path or array_like, shape (K, n)
        From `rne.trajectories.through`, or via points for it [rad or m].
    friction : Friction or "urdf", optional
        Friction that the drives must overcome. Coulomb friction counts with its full size from rest.
    payload : Payload, PayloadEstimate or float, optional
        A body on the last link, or its mass [kg], as in a `Scene`.
    smoothing : float, optional
        The place on the path is averaged over this time, so that torques do not jump; 0 for the time-optimal motion
        itself, whose torques do. By default 10 ms, longer if the robot's jerk limits need it [s].
    springs : sequence of Spring, optional
        Springs that help or load the drives, as in a `Scene`.

    Returns
    -------
    FastestMotion
        A function f(t) -> (q, qd, qdd), at rest before its start and after its end; a reference for control laws.

    Raises
    ------
    ValueError
        If a joint has neither a torque nor an acceleration limit, the path leaves a joint's range, or it cannot be
        driven; the message names the place, the joint and the limit.
    ImportError
        Without toppra, the extra `fastest`.

    Notes
    -----
    Pham and Pham 2018 (toppra), with limits at both ends of each interval of the grid, which is set closer until they
    hold in between to 5e-4 and one of them is used to 1 %, but for intervals below 1e-5 of the duration around switches
    from one limit to another. Limits hold to 1e-3 throughout, after an average too, and where a joint with Coulomb
    friction turns around. Limits of joints that follow others are included, except those of torques, and of jerk where
    a coupling moves them. The average of s(t) over a time w stays on the path, takes w longer for every stop, and has
    continuous accelerations; where it would exceed a limit, the motion is slowed there. Where viscous friction is far
    larger than inertia and all joints turn at once, limits were exceeded by up to 2 %, for 1e-5 of the duration. Where
    no solution within limits is found, the whole piece is driven slower until they hold; `print` shows by how much.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140").with_limits(effort=[250, 250, 150, 50, 50, 20])
    >>> motion = rne.trajectories.fastest(robot, [[0] * 6, [1, 0.5, 0, 0, 0, 0]], smoothing=0)
    >>> round(motion.duration, 3)
    0.341
    """
    scene = Scene(robot_argument(robot), friction=friction, payload=payload, springs=springs)
    if (resisting := scene.resolved.friction) is not None:
        scene = replace(scene, friction=replace(resisting, smoothing=STEP if resisting.varying else 0.0))
    given = path if isinstance(path, Path) else through(path)
    limits = _checked_limits(scene, given)
    pieces = [_Piece(limits, given, k) for k in range(len(given.pieces))]
    for piece in pieces:
        _check_range(piece)
    optimal = [_fastest_profile(piece) for piece in pieces]
    duration = sum(profile.duration for profile in optimal)
    window = AVERAGED if smoothing is None else positive_number("smoothing", smoothing, zero_allowed=True)
    jerk = limits.known["jerk_limit"]
    while True:
        profiles = [_averaged(*pair, window) for pair in zip(pieces, optimal, strict=True)] if window else optimal
        motion = FastestMotion(given, window, duration, limits, tuple(profiles))
        if smoothing is not None or (motion.steps()[1] <= jerk).all():
            return motion
        window *= 1.5


def _checked_limits(scene: Scene, path: Path) -> _Limits:
    limits = _Limits(scene)
    robot, known = limits.robot, limits.known
    if path.points.shape[1] != robot.n:
        raise ValueError(f"`path` must have points of shape (K, {robot.n}), got {path.points.shape}")
    free = np.isinf(known["effort_limit"]) & np.isinf(known["acceleration_limit"])
    if free.any():
        missing = [name for name, is_free in zip(robot.joint_names, free, strict=True) if is_free]
        raise MissingLimit(
            f"`robot`: {listed(missing)} {'have' if len(missing) > 1 else 'has'} neither a torque nor an acceleration "
            "limit; give them by `robot.with_limits(effort=...)`"
        )
    for name in ("effort", "acceleration", "deceleration", "velocity"):
        if not (limit := known[f"{name}_limit"]).all():
            kind = name.replace("effort", "torque")
            raise ValueError(f"`robot`: the {kind} limit of joint {robot.joint_names[int(limit.argmin())]!r} is 0")
    return limits


def _check_range(piece: _Piece) -> None:
    """Refuse a path that leaves the range of a joint."""
    model, low, high = piece.limits.robot.model, piece.limits.of_all["lower"], piece.limits.of_all["upper"]
    grid, following = piece.first_grid, piece.limits.following
    parts = np.linspace(grid[:-1], grid[1:], CLOSER, endpoint=False).T.ravel()  # extremes of joints that follow
    grid = np.append(parts, grid[-1]) if model.couplings else grid
    q = piece.derivatives(grid)[0]
    names = [*model.joint_names, *(model.moving_joints[i] for i in following)]
    q = np.concatenate([q, joint_positions(model, q)[:, following]], axis=1)
    beyond = np.nan_to_num(np.maximum(q - high, low - q), nan=2 * OUT_OF_RANGE)  # mostly its driver is farther beyond
    k, j = np.unravel_index(int(beyond.argmax()), q.shape)
    if beyond[k, j] > OUT_OF_RANGE:
        place = piece.path.via(piece.index, float(grid[k]))
        raise OutOfRange(
            f"`path` leaves the range of joint {names[j]!r}, {low[j]:.4g} to {high[j]:.4g}: {q[k, j]:.4g} {place}"
        )
