"""The likely causes of what an identification leaves unexplained: one change of the robot, the log or the drives each.

A cause adds columns X to the equations Y x = tau: derivatives of the predicted torques by a delay, a gear ratio or a
zero, the torques of a payload from some time on, those of a force at the last link for a while. Least squares with
these columns say how much of the residuals the cause takes away; its score is the gain of log likelihood, each joint
with its own noise, less log(N) / 2 per free number (Schwarz 1978). Causes that are no small change, such as torques of
the wrong sign or joints in another order, are tried by fitting anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..model.model import Model
from ..model.parameters import PARAMETERS
from ..model.standard_parameters import StandardParameters
from ..robot import Robot
from .equations import Stacked
from .filtering import low_pass
from .prepared import Prepared

THINNED = 10.0  # samples per period of the cut-off, at which columns of causes are evaluated
DIFFERENCE = 1e-4  # of central differences, relative or [rad or m]
PLACES = 24  # times at which something may begin
RATES = (0.01, 0.02, 0.04, 0.08, 0.16)  # Stribeck velocities that are tried, as parts of the largest rate
POOR = 0.05  # unexplained part of the torques from which joints are tried in another order
EVIDENT = 6.0  # gain of log likelihood above which a cause is named
FACTOR, ALIKE = 2.5, 0.5  # of torques in another unit, and how alike those of the robot given must be
LEAST = 1e-4  # residuals below this part of the torques are none


class Cause(NamedTuple):
    """A change that explains what an identification leaves unexplained, of `Identification.causes`.

    Attributes
    ----------
    kind : str
        Such as "gear ratio", "encoder slip", "payload changed".
    joints : tuple of str
        Those concerned.
    text : str
        In words, with its size.
    score : float
        Gain of log likelihood, less log(N) / 2 per free number.
    removed : float
        Part of the residuals' squares that it takes away, of the joint where that is most.
    value, error : float
        Its size and the standard error of that, where it is one number, otherwise NaN.
    at : float
        The record's number of a delay, or the Stribeck velocity [rad/s or m/s]; otherwise NaN.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
    >>> w = 2 * np.pi * np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    >>> q, qd, qdd = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
    >>> tau = robot.inverse_dynamics(q, qd, qdd) * [1, -1, 1, 1, 1, 1]
    >>> with np.testing.suppress_warnings() as quiet:
    ...     quiet.filter(rne.IdentificationWarning)
    ...     found = rne.identify(robot, rne.identification.Record(t, q, tau), consistent=False)
    >>> found.causes[0].text
    'the torque of joint_2 has the wrong sign'
    """

    kind: str
    joints: tuple[str, ...]
    text: str
    score: float
    removed: float
    value: float = float("nan")
    error: float = float("nan")
    at: float = float("nan")


class Candidate(NamedTuple):
    """Columns of a cause, shape (rows, n, k), and the words for their coefficients."""

    kind: str
    joints: tuple[str, ...]
    columns: Array
    text: Callable[[Array], str]
    at: float = float("nan")


class Residuals:
    """What least squares left of the equations of records.

    Parameters
    ----------
    robot : Robot
    standard : StandardParameters
    records : sequence of Prepared
    rows : sequence of Stacked
        Their equations.
    back : ndarray, shape (P, count)
        From base to standard parameters.
    beta : ndarray, shape (count,)
        Base parameters.
    sigma, repeats : ndarray, shape (n,)
        Noise of the joints, and how many of their equations count as one.
    """

    def __init__(
        self,
        robot: Robot,
        standard: StandardParameters,
        records: Sequence[Prepared],
        rows: Sequence[Stacked],
        back: Array,
        beta: Array,
        sigma: Array,
        repeats: Array,
    ) -> None:
        self.robot, self.standard, self.records, self.rows = robot, standard, records, rows
        self.back, self.x, self.sigma, self.repeats = back, back @ beta, sigma, repeats
        self.used = np.concatenate([r.used for r in rows])
        self.tau = np.concatenate([r.tau for r in rows])
        self.joint = np.nonzero(self.used)[1]
        self.A = self.flat(np.concatenate([r.Y for r in rows]) @ back)
        self.Q = np.linalg.qr(self.A)[0]
        self.r = self.flat((self.tau - np.concatenate([r.Y @ self.x for r in rows]))[..., None])[:, 0]
        self.r = self.r - self.Q @ (self.Q.T @ self.r)
        self.squares = self.by_joint(self.r)
        self.counts = np.bincount(self.joint, minlength=robot.n) / repeats
        floor = LEAST**2 * self.by_joint(self.flat(self.tau[..., None])[:, 0])
        self.floor = np.maximum(floor, np.finfo(float).tiny)

    def flat(self, columns: Array) -> Array:
        """Columns, shape (rows, n, k), of the equations that are fitted, over the noise of their joint."""
        weighted: Array = (columns / self.sigma[:, None])[self.used]
        return weighted

    def by_joint(self, r: Array) -> Array:
        """Sums of squares of each joint's equations."""
        return np.bincount(self.joint, r**2, minlength=self.robot.n)

    def likelihood(self, squares: Array) -> float:
        """The gain of log likelihood of a fit that leaves these squares."""
        return float(0.5 * (self.counts * np.log((self.squares + self.floor) / (squares + self.floor))).sum())

    def fitted(self, columns: Array) -> tuple[Array, Array, float]:
        """Coefficients of additional columns, what the fit leaves, and the standard error of the first."""
        X = self.flat(columns)
        left = X - self.Q @ (self.Q.T @ X)
        lengths = np.linalg.norm(left, axis=0)
        known = lengths > 1e-6 * np.maximum(np.linalg.norm(X, axis=0), np.finfo(float).tiny)
        c = np.zeros(X.shape[1])
        c[known] = np.linalg.lstsq(left[:, known] / lengths[known], self.r, rcond=1e-8)[0] / lengths[known]
        error = float(np.sqrt(self.repeats.max()) / max(lengths[0], np.finfo(float).tiny))
        return c, self.r - left @ c, error

    def judged(self, candidate: Candidate) -> Cause:
        """The cause with its score."""
        c, r, error = self.fitted(candidate.columns)
        squares = self.by_joint(r)
        score = self.likelihood(squares) - 0.5 * len(c) * np.log(max(self.counts.sum(), 2.0))
        removed = float(np.max(1 - squares / np.maximum(self.squares, self.floor), initial=0))
        size = (float(c[0]), error) if len(c) == 1 else ()
        return Cause(candidate.kind, candidate.joints, candidate.text(c), score, removed, *size)._replace(
            at=candidate.at
        )

    def coarse(self, change: Callable[[Array], Array]) -> tuple[Array]:
        """Orthonormal columns of the equations, of which positions, rates and accelerations are changed."""

        def base_columns(g: Grid) -> Array:
            q, qd, qdd = (change(x) for x in (g.q, g.qd, g.qdd))
            drives = self.standard.drive_columns(qd, qdd)
            return np.concatenate([self.robot.regressor(q, qd, qdd), drives], axis=-1) @ self.back

        return (np.linalg.qr(self.flat(self.columns(base_columns)))[0],)

    def squares_of(self, Q: Array, tau: Array) -> Array:
        """What a fit leaves of other torques."""
        b = self.flat(tau[..., None])[:, 0]
        return self.by_joint(b - Q @ (Q.T @ b))

    def anew(self, kind: str, joints: tuple[str, ...], text: str, Q: Array, tau: Array, before: Array) -> Cause:
        """A cause with a fit of its own, whose squares are compared with those of another."""
        squares = self.squares_of(Q, tau)
        gain = 0.5 * (self.counts * np.log((before + self.floor) / (squares + self.floor))).sum()
        removed = float(np.max(1 - squares / np.maximum(before, self.floor), initial=0))
        return Cause(kind, joints, text, float(gain), removed)

    @cached_property
    def grids(self) -> list[Grid]:
        """Of each record, the samples at which columns are evaluated."""
        return [Grid.of(record) for record in self.records]

    def columns(self, torques: Callable[[Grid], Array]) -> Array:
        """Torques on the grids, shape (samples, n) or (samples, n, k), filtered, at the equations' times."""
        found = [grid.reduced(torques(grid)) for grid in self.grids]
        stacked = np.concatenate(found)
        return stacked[..., None] if stacked.ndim == 2 else stacked

    def own_columns(self, j: int, torque: Callable[[Prepared], Array]) -> Array:
        """Torques of one joint along the records, shape (samples,), filtered, at the equations' times, (rows, n, 1)."""
        found = np.concatenate([record.reduce(torque(record)) for record in self.records])
        columns: Array = (found[:, None] * np.eye(self.robot.n)[j])[..., None]
        return columns

    def predicted(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Torques of the parameters found."""
        bodies = PARAMETERS * self.standard.model.nb
        drives = self.standard.drive_columns(qd, qdd) @ self.x[bodies:]
        torques: Array = self.robot.inverse_dynamics(q, qd, qdd, parameters=self.x[:bodies]) + drives
        return torques


class Grid(NamedTuple):
    """Fewer samples of a record, for columns that need no more than a few digits."""

    record: Prepared
    step: int
    t: Array
    q: Array
    qd: Array
    qdd: Array
    segments: tuple[slice, ...]

    @classmethod
    def of(cls, record: Prepared) -> Grid:
        """Every so many samples of each segment."""
        step = max(1, int(record.sample_rate / (THINNED * record.cutoff)))
        rows = [np.arange(s.start, s.stop, step) for s in record.segments]
        ends = np.cumsum([0, *(len(r) for r in rows)]).tolist()
        every = np.concatenate(rows)
        segments = tuple(slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True))
        return cls(record, step, record.t[every], record.q[every], record.qd[every], record.qdd[every], segments)

    def reduced(self, values: Array) -> Array:
        """Values on the grid, filtered as torques are, at the times of the record's equations."""
        from scipy.interpolate import CubicSpline

        rate, parts, start = self.record.sample_rate / self.step, [], 0
        for segment, count in zip(self.segments, self.record.segment_lengths, strict=True):
            smooth = low_pass(values[segment], self.record.cutoff, rate)
            times = self.record.times[start : start + count]
            parts.append(CubicSpline(self.t[segment], smooth, axis=0)(times))
            start += count
        return np.concatenate(parts)


def likely_causes(residuals: Residuals) -> tuple[Cause, ...]:
    """Causes whose score is evident, the likeliest first, of each kind and joints the best."""
    found = [residuals.judged(candidate) for candidate in candidates(residuals)]
    found = sorted((*found, *refitted(residuals)), key=lambda cause: -cause.score)
    best: dict[tuple[str, tuple[str, ...]], Cause] = {}
    for cause in found:
        if cause.score > EVIDENT:
            best.setdefault((cause.kind, cause.joints), cause)
    return tuple(best.values())


def candidates(res: Residuals) -> Iterator[Candidate]:
    """Causes that are columns."""
    names, n = res.robot.joint_names, res.robot.n
    model, joints = res.robot.model, res.robot.model.independent_joints
    unit = ["rad" if model.is_revolute[i] else "m" for i in joints]
    torque = [res.predicted(g.q, g.qd, g.qdd) for g in res.grids]
    slopes = [-rate_of_change(g, f) for g, f in zip(res.grids, torque, strict=True)]
    late = res.columns(lambda g: of(g, res.grids, slopes))
    of_record = np.repeat(np.arange(len(res.rows)), [len(r.tau) for r in res.rows])[:, None, None]
    for k in range(len(res.records)):
        yield Candidate("delay", names, late * (of_record == k), delay_text(""), k)
    for j in range(n if n > 1 else 0):
        yield Candidate("delay", (names[j],), late * np.eye(n)[j][:, None], delay_text(f" of {names[j]}"))
    t = np.concatenate([record.times for record in res.records])
    place = np.concatenate([k + normalised(record) for k, record in enumerate(res.records)])
    starts = np.quantile(place, np.linspace(0, 1, PLACES + 2)[1:-1])
    when = lambda s: f"{t[np.searchsorted(place, s)]:.3g} s"  # noqa: E731
    shifted = []
    for j in range(n):
        name = (names[j],)
        e = np.eye(n)[j]
        zero = res.columns(lambda g, e=e: by_position(res, g, e))
        shifted.append(zero)
        yield Candidate(
            "joint zero", name, zero, lambda c, j=j: f"the zero of {names[j]} is off by {c[0]:.3g} {unit[j]}"
        )
        ratio = res.columns(lambda g, e=e: by_ratio(res, g, e))
        yield Candidate(
            "gear ratio", name, ratio, lambda c, j=j: f"the gear ratio of {names[j]} is {100 * c[0]:.3g} % off"
        )
        own = res.columns(lambda g, e=e: of(g, res.grids, torque) * e)
        yield Candidate(
            "torque factor", name, own, lambda c, j=j: f"the torque of {names[j]} is measured {1 + c[0]:.4g} times"
        )
        friction = res.columns(lambda g, j=j, e=e: friction_columns(res, g, j) * e[:, None])
        ramp = (place - place.mean())[:, None, None]
        yield Candidate(
            "friction changed",
            name,
            np.concatenate([friction * ramp, friction * (ramp**2 - (ramp**2).mean())], -1),
            lambda c, j=j: f"friction of {names[j]} changes during the log",
        )
        offset = np.broadcast_to(e, (len(place), n))[..., None] * ramp
        yield Candidate("offset drifts", name, offset, lambda c, j=j: f"the torque's zero of {names[j]} drifts")
        fastest = max(np.abs(r.qd[:, j]).max() for r in res.records)
        for share in RATES:
            yield stribeck(res, j, share * fastest)
        load = res.columns(
            lambda g, j=j, e=e: (np.abs(of(g, res.grids, torque)[:, j]) * np.sign(g.qd[:, j]))[:, None] * e
        )
        yield Candidate(
            "friction under load",
            name,
            load,
            lambda c, j=j: f"friction of {names[j]} rises by {100 * c[0]:.3g} % of its load",
        )
    body = PARAMETERS * tip_body(model)
    last = np.concatenate([r.Y[..., body : body + PARAMETERS] for r in res.rows])
    tip = res.columns(lambda g: tip_forces(res, g))
    turned = res.columns(lambda g: gravity_columns(res, g))
    yield Candidate("gravity direction", (), turned, lambda c: "gravity has another direction than the model's")
    for s in starts:
        after = (place >= s)[:, None, None]
        yield Candidate(
            "payload changed",
            (names[-1],),
            last * after,
            lambda c, s=s: f"the payload changes by {c[0]:.3g} kg at {when(s)}",
        )
        for j in range(n):
            yield Candidate(
                "encoder slip",
                (names[j],),
                shifted[j] * after,
                lambda c, j=j, s=s: f"the encoder of {names[j]} slips by {c[0]:.3g} {unit[j]} near {when(s)}",
            )
    edges = np.quantile(place, np.linspace(0, 1, 2 * PLACES + 1))
    for a in range(2 * PLACES):
        for width in (1, 2, 4, 6):
            if a + width <= 2 * PLACES:
                on = ((place >= edges[a]) & (place <= edges[a + width]))[:, None, None]
                yield Candidate(
                    "contact",
                    (names[-1],),
                    tip * on,
                    lambda c, a=a, w=width: (
                        f"something pushes the last link with {np.linalg.norm(c):.3g} N from {when(edges[a])} to {when(min(edges[a + w], place[-1]))}"
                    ),
                )


def delay_text(whose: str) -> Callable[[Array], str]:
    """Words for a delay."""
    return lambda c: (
        f"torques{whose} are measured {abs(1000 * c[0]):.3g} ms {'later' if c[0] > 0 else 'earlier'} than positions"
    )


def stribeck(res: Residuals, j: int, vs: float) -> Candidate:
    """The Stribeck effect of a joint, of one velocity vs."""
    name, is_revolute = res.robot.joint_names[j], res.robot.model.is_revolute[res.robot.model.independent_joints[j]]
    torque, rate = ("N m", "rad/s") if is_revolute else ("N", "m/s")

    def effect(record: Prepared) -> Array:
        return np.sign(record.qd[:, j]) * np.exp(-np.abs(record.qd[:, j]) / vs)

    column = res.own_columns(j, effect)
    text = "friction of {} is {:.3g} {} {} at rest than from {:.2g} {} on"

    def words(c: Array) -> str:
        return text.format(name, abs(c[0]), torque, "more" if c[0] > 0 else "less", 2 * vs, rate)

    return Candidate("Stribeck friction", (name,), column, words, vs)


def sharpened(res: Residuals, cause: Cause) -> Cause:
    """The Stribeck effect with the velocity that fits best."""
    from scipy.optimize import minimize_scalar

    j = res.robot.joint_names.index(cause.joints[0])

    def loss(log: float) -> float:
        return -res.judged(stribeck(res, j, float(np.exp(log)))).score

    middle = np.log(cause.at)
    best = minimize_scalar(loss, bounds=(middle - 1, middle + 1), method="bounded", options={"maxiter": 15}).x
    return res.judged(stribeck(res, j, float(np.exp(best))))


def of(grid: Grid, grids: Sequence[Grid], values: Sequence[Array]) -> Array:
    """The values of a grid."""
    return next(v for g, v in zip(grids, values, strict=True) if g is grid)


def normalised(record: Prepared) -> Array:
    """Times of the equations, from 0 to nearly 1."""
    times = record.times
    return (times - times[0]) / (times[-1] - times[0]) * (1 - 1e-9)


def rate_of_change(grid: Grid, values: Array) -> Array:
    """Derivative by time, segment by segment."""
    found = np.empty_like(values)
    for segment in grid.segments:
        found[segment] = np.gradient(values[segment], grid.t[segment], axis=0)
    return found


def by_position(res: Residuals, g: Grid, e: Array) -> Array:
    """Derivative of the torques by the zero of a joint."""
    more, less = (res.predicted(g.q + s * DIFFERENCE * e, g.qd, g.qdd) for s in (1, -1))
    return (more - less) / (2 * DIFFERENCE)


def by_ratio(res: Residuals, g: Grid, e: Array) -> Array:
    """Derivative of the measured torques by the gear ratio of a joint, to which torques are proportional."""
    scale = [1 + s * DIFFERENCE * e for s in (1, -1)]
    more, less = (k * res.predicted(k * g.q, k * g.qd, k * g.qdd) for k in scale)
    return (more - less) / (2 * DIFFERENCE)


def friction_columns(res: Residuals, g: Grid, j: int) -> Array:
    """Torques of viscous and Coulomb friction, shape (samples, n, 2)."""
    qd = g.qd[:, [j], None]
    return np.concatenate([qd, np.sign(qd)], -1) * np.ones((1, res.robot.n, 1))


def tip_body(model: Model) -> int:
    """The last body of the chain."""
    return model.nb - 1


def tip_link(model: Model) -> str:
    """A link of that body."""
    links = zip(model.link_names, model.link_body, strict=True)
    return [name for name, body in links if body == tip_body(model)][-1]


def tip_forces(res: Residuals, g: Grid) -> Array:
    """Torques per unit of a force on the last link along the axes of the base, shape (samples, n, 3)."""
    J = res.robot.jacobian(g.q, tip_link(res.robot.model))
    return np.swapaxes(J[..., 3:, :], -1, -2)


def gravity_columns(res: Residuals, g: Grid) -> Array:
    """Torques per unit of each component of gravity, shape (samples, n, 3)."""
    model, bodies = res.robot.model, res.x[: PARAMETERS * res.robot.model.nb]
    pulled = [Robot(replace(model, gravity=e), "numpy") for e in np.eye(3)]
    return np.stack([robot.gravity_torque(g.q, parameters=bodies) for robot in pulled], axis=-1)


def refitted(res: Residuals) -> Iterator[Cause]:
    """Causes that are no small change, each with a fit of its own."""
    names, n = res.robot.joint_names, res.robot.n
    before = res.squares
    yield from torque_scale(res)
    for j in range(n):
        turned = res.tau * np.where(np.arange(n) == j, -1, 1)
        text = f"the torque of {names[j]} has the wrong sign"
        yield res.anew("torque sign", (names[j],), text, res.Q, turned, before)
    for i, j in combinations(range(n), 2):
        order = swapped(n, i, j)
        text = f"the torques of {names[i]} and {names[j]} are interchanged"
        yield res.anew("torque order", (names[i], names[j]), text, res.Q, res.tau[:, order], before)
    if np.sqrt((res.squares / np.maximum(res.floor / LEAST**2, np.finfo(float).tiny)).max()) < POOR:
        return
    before = res.squares_of(*res.coarse(lambda x: x), res.tau)
    for i, j in combinations(range(n), 2):
        order = swapped(n, i, j)
        text = f"{names[i]} and {names[j]} are interchanged"
        Q = res.coarse(lambda x, order=order: x[..., order])[0]
        yield res.anew("joint order", (names[i], names[j]), text, Q, res.tau[:, order], before)
    for j in range(n):
        signs = np.where(np.arange(n) == j, -1, 1)
        Q = res.coarse(lambda x, signs=signs: x * signs)[0]
        yield res.anew("joint sign", (names[j],), f"{names[j]} turns the other way", Q, res.tau * signs, before)
    yield from gravity_directions(res, before)
    degrees = np.where(res.robot.model.is_revolute[list(res.robot.model.independent_joints)], np.pi / 180, 1.0)
    Q = res.coarse(lambda x: x * degrees)[0]
    yield res.anew("degrees", names, "positions are in degrees", Q, res.tau, before)


def torque_scale(res: Residuals) -> Iterator[Cause]:
    """Torques that are many times, or less than nothing of, what the bodies of the robot given ask for."""
    bodies = PARAMETERS * res.standard.model.nb
    Y = np.concatenate([r.Y[..., :bodies] for r in res.rows])
    found, given = (res.flat((Y @ x[:bodies])[..., None])[:, 0] for x in (res.x, res.standard.values))
    size = float(given @ given)
    factor = float(found @ given) / max(size, np.finfo(float).tiny)
    alike = factor * float(found @ given) / max(float(found @ found), np.finfo(float).tiny)  # squared cosine
    if size == 0 or alike < ALIKE or 1 / FACTOR < factor < FACTOR:
        return
    kind, text = "torque unit", f"torques are {factor:.3g} times those of the robot given: N mm, mA, or at the motors?"
    if factor < 0:
        kind, text = "torque sign", "the torques of all joints have the wrong sign"
    yield Cause(kind, res.robot.joint_names, text, float(res.counts.sum()), alike, factor)


def gravity_directions(res: Residuals, before: Array) -> Iterator[Cause]:
    """Gravity in the direction with which the torques are fitted best, by the angles of a sphere."""
    from scipy.optimize import minimize

    model, width = res.robot.model, PARAMETERS * res.robot.model.nb
    size = float(np.linalg.norm(model.gravity))
    if size == 0:
        return
    alone = [Robot(replace(model, gravity=size * e), "numpy") for e in (np.zeros(3), *np.eye(3))]
    still, *pulled = (res.columns(lambda g, r=r: r.regressor(g.q, g.qd, g.qdd)) for r in alone)
    pulled = [res.flat(y - still) for y in pulled]
    drives = res.flat(np.concatenate([r.Y[..., width:] for r in res.rows]))
    still, b = res.flat(still), res.flat(res.tau[..., None])[:, 0]

    def squares(direction: Array) -> Array:
        turned = still + np.tensordot(direction / np.linalg.norm(direction), pulled, 1)
        Q = np.linalg.qr(np.concatenate([turned, drives], axis=1))[0]
        return res.by_joint(b - Q @ (Q.T @ b))

    def loss(direction: Array) -> float:
        return -res.likelihood(squares(direction))

    given = model.gravity / size
    starts = [given, *(s * e for e in np.eye(3) for s in (1, -1)), *(given + s * e for e in np.eye(3) for s in (1, -1))]
    start = min((x for x in starts if np.linalg.norm(x) > ALIKE), key=loss)
    found = minimize(loss, start, method="Nelder-Mead", options={"maxfev": 120, "xatol": 1e-3, "fatol": 0.1}).x
    g = found / np.linalg.norm(found)
    angle = np.rad2deg(np.arccos(np.clip(g @ given, -1, 1)))
    text = f"gravity acts along ({g[0]:.2f}, {g[1]:.2f}, {g[2]:.2f}), {angle:.0f} degrees from the model's"
    left = squares(found)
    gain = 0.5 * (res.counts * np.log((before + res.floor) / (left + res.floor))).sum()
    more = drives.shape[1] + still.shape[1] - len(res.back.T) + 2
    yield Cause("gravity direction", (), text, float(gain - 0.5 * min(more, 12) * np.log(res.counts.sum())), 0.0, angle)


def swapped(n: int, i: int, j: int) -> Array:
    """The order of joints in which two are interchanged."""
    order = np.arange(n)
    order[[i, j]] = j, i
    return order
