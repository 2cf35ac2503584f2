"""The likely causes of what an identification leaves unexplained: one change of the robot, the log or the drives each.

A cause adds columns X to the equations Y x = tau: derivatives of the predicted torques by a delay, a gear ratio or a
zero, the torques of a payload from some time on, those of a force at the last link for a while. Least squares with
these columns say how much of the residuals the cause takes away; its score is the gain of log likelihood, each joint
with its own noise, less log(N) / 2 per free number (Schwarz 1978) and the logarithm of how many times or velocities
were tried. Causes that are no small change, such as torques of the wrong sign or joints in another order, are tried by
fitting anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from ...basics.spatial import Array
from ...basics.text import listed
from ...model.parameters import PARAMETERS
from ...robot import Robot
from ..log.screening import seconds
from .residuals import TINY, Grid, Residuals, by_joint

STRIBECK, SIZE, DIRECTION, GAIN = "Stribeck friction", "gravity magnitude", "gravity direction", "torque factor"
LOAD = "payload changed"
GEARS = ("friction under load", "friction by direction", "pre-sliding friction", STRIBECK)  # which sound gears have
LATEST = 0.1  # delay [s], above which no logger is late
DRIVES: dict[str, tuple[str, str, Callable[[Array, Array, Array], Array]]] = {  # kind, noun, torque of (q, qd, qdd)
    "Ia": ("rotor", "a rotor", lambda q, qd, qdd: qdd),
    "Fv": ("viscous friction", "viscous friction", lambda q, qd, qdd: qd),
    "Fc": ("Coulomb friction", "Coulomb friction", lambda q, qd, qdd: np.sign(qd)),
    "tau0": ("offset", "an offset", lambda q, qd, qdd: np.ones(len(qd))),
}
EVIDENT = 8.0  # gain of log likelihood above which a cause is named
DIFFERENCE = 1e-4  # of central differences, relative or [rad or m]
PLACES = 20  # times at which something may begin
WIDTHS = (1, 2, 4, 6)  # of a contact, in half of their distance
VELOCITIES = (0.01, 0.02, 0.04, 0.08, 0.16)  # Stribeck velocities that are tried, as parts of the largest velocity
SEEN = 0.02  # unexplained part of the torques from which links before the last are tried with a load
POOR = 0.05  # unexplained part of the torques from which joints are tried in another order
TURNED, SCALED = 3.0, 0.03  # degrees, and part, by which gravity differs
TILT = 0.2  # of gravity, first steps of the search for its direction
KEPT = 10.0  # gain of log likelihood that a change of gravity by its own size has to bring
UNIT = np.log(30.0)  # of the torque of one joint in another unit, against those of most joints
FACTOR, ALIKE = 2.5, 0.5  # of torques in another unit, and how alike those of the robot given must be


class Cause(NamedTuple):
    """One of `Identification.causes`: a change that explains part of the torques left unexplained by `rne.identify`.

    Attributes
    ----------
    kind : str
        Such as "gear ratio", "encoder slip", "payload changed".
    joints : tuple of str
        Those concerned.
    text : str
        In words, with its size.
    score : float
        Gain of log likelihood, less log(N) / 2 per free number and the logarithm of how many were tried.
    removed : ndarray, shape (n,)
        Part of the squares of each joint's residuals that it takes away.
    value, error : float
        Its size and the standard error of that, where it is one number, otherwise NaN: a delay [s], a zero [rad or m],
        a ratio relative to one, friction, an inertia or an offset in the units of its joint.
    at : float
        The record's number of a delay, or the Stribeck velocity [rad/s or m/s]; otherwise NaN.
    """

    kind: str
    joints: tuple[str, ...]
    text: str
    score: float
    removed: Array
    value: float = float("nan")
    error: float = float("nan")
    at: float = float("nan")


class Change(NamedTuple):
    """A possible cause as columns of the equations, shape (rows, n, k), and the words for their coefficients."""

    kind: str
    joints: tuple[str, ...]
    columns: Array
    text: Callable[[Array], str]
    at: float = float("nan")
    alternatives: int = 1  # times or velocities of which this is one

    def judged(self, res: Residuals) -> Cause:
        """The cause with its score."""
        c, error, squares = res.with_columns(self.columns)
        gain, removed = res.gain(squares)
        size = (float(c[0]), float(error[0])) if len(c) == 1 else (float("nan"), float("nan"))
        kind = "pre-sliding friction" if self.kind == STRIBECK and c[0] < 0 else self.kind
        kind = "torque sign" if kind == GAIN and c[0] < -1 else kind
        score = gain - res.penalty(len(c)) - float(np.log(self.alternatives))
        return Cause(kind, self.joints, self.text(c), score, removed, *size, self.at)


def likely_causes(res: Residuals) -> tuple[tuple[Cause, ...], Array | None]:
    """Causes whose score is evident, of each kind and joints the best: first those that explain what friction cannot.

    With the columns of the likeliest of those that have columns.
    """
    drives, rest = Log(res), res.beyond_friction
    log = Log(rest)
    kinds = (log.delays, log.gravity, log.joints, log.changing, log.payloads, log.slips, log.contacts)
    found = [change.judged(res) for changes in (drives.drives, drives.friction) for change in changes()]
    best_score, leading = EVIDENT, None
    for change in (change for changes in kinds for change in changes()):
        found.append(change.judged(rest))
        if found[-1].score > best_score and change.kind != "delay":
            best_score, leading = found[-1].score, change.columns
    found += [*torque_scale(res), *other_torques(rest)]
    if res.share > POOR:
        found += [*gravity_directions(res), *other_joints(rest)]
    best: dict[tuple[str, tuple[str, ...]], Cause] = {}
    for cause in sorted(found, key=lambda cause: (cause.kind in GEARS, -cause.score)):
        if cause.score > EVIDENT:
            best.setdefault((cause.kind, cause.joints), cause)
    return tuple(best.values()), leading


def delays_of(res: Residuals) -> list[Cause]:
    """Delays of records and joints that the residuals show, whatever else they show, with their sizes together."""
    names, options, left = res.robot.joint_names, delay_columns(res), res
    chosen: list[tuple[tuple[str, ...], Array]] = []
    while options:
        fits = [left.with_columns(columns) for _, columns in options]
        gains = [left.gain(squares)[0] - left.penalty(len(c)) for c, _, squares in fits]
        scores = [gain if np.abs(c).max() < LATEST else -np.inf for gain, (c, *_) in zip(gains, fits, strict=True)]
        if max(scores) <= EVIDENT:
            break
        chosen.append(options.pop(int(np.argmax(scores))))
        left = left.with_known(chosen[-1][1])
    if not chosen:
        return []
    c, errors, _ = res.with_columns(np.concatenate([columns for _, columns in chosen], axis=-1))
    places = [(joints, k if joints is names else np.nan) for joints, x in chosen for k in range(x.shape[-1])]
    sizes = zip(places, c.tolist(), errors.tolist(), strict=True)
    return [Cause("delay", joints, "", np.nan, np.zeros(len(names)), x, e, at) for (joints, at), x, e in sizes]


def merged_by_kind(causes: Sequence[Cause]) -> tuple[Cause, ...]:
    """One cause of each kind, with the joints of all."""
    found = []
    for kind in dict.fromkeys(cause.kind for cause in causes):
        first, *others = (cause for cause in causes if cause.kind == kind)
        if kind == LOAD:  # on one link; those beside it look alike
            others = []
        names = tuple(dict.fromkeys(name for cause in others for name in cause.joints if name not in first.joints))
        text = f"{first.text}; likewise of {listed(names)}" if names and len(first.joints) == 1 else first.text
        found.append(first._replace(joints=(*first.joints, *names), text=text))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class Log:
    """Changes of causes that are columns of torques along the log."""

    res: Residuals

    @property
    def names(self) -> tuple[str, ...]:
        """Of the joints."""
        return self.res.robot.joint_names

    def units(self, j: int) -> tuple[str, str]:
        """Of a joint's position and torque."""
        model = self.res.robot.model
        return ("rad", "N m") if model.is_revolute[model.independent_joints[j]] else ("m", "N")

    @cached_property
    def place(self) -> Array:
        """Times of the equations: the number of the record, and the part of it that has passed, shape (rows, 1, 1)."""
        passed = [(r.times - r.times[0]) / (np.ptp(r.times) or 1.0) * (1 - 1e-9) for r in self.res.records]
        return np.concatenate([k + x for k, x in enumerate(passed)])[:, None, None]

    def time(self, place: float) -> str:
        """In words."""
        t = np.concatenate([record.times - record.start for record in self.res.records])
        k = min(int(np.searchsorted(self.place.ravel(), place)), len(t) - 1)
        name = f" of record {int(place) + 1}" if len(self.res.records) > 1 else ""
        return f"{seconds(t[k])} s{name}"

    def delays(self) -> Iterator[Change]:
        """Torques later than positions: in a record, or of one joint."""
        for joints, columns in delay_columns(self.res):
            yield Change("delay", joints, columns, delay_text(() if joints is self.names else joints))

    def gravity(self) -> Iterator[Change]:
        """Gravity of another size, which a clock of another rate is too, and gravity tilted by a small angle."""
        model = self.res.robot.model
        bodies = self.res.x[: PARAMETERS * model.nb]
        column = self.res.columns(lambda g: self.res.robot.gravity_torque(g.q, parameters=bodies))[..., None]
        yield Change(SIZE, (), column, lambda c: size_text(1 + float(c[0])))
        size = float(np.linalg.norm(model.gravity))
        if size:  # the first body's centre may be felt in tilted gravity alone
            given = model.gravity / size
            level = np.linalg.svd(given[None])[2][1:]  # two directions at right angles to gravity
            kept = np.vstack([bodies, np.eye(PARAMETERS * model.nb)[1:4]])
            one, other = (self.res.columns(partial(pulls, self.res.robot, size * e, kept)) for e in level)
            tilted = np.concatenate([one[..., :1], other[..., :1], one[..., 1:], other[..., 1:]], axis=-1)
            yield Change(DIRECTION, (), tilted, lambda c: direction_text(given + c[:2] @ level, given))

    def joints(self) -> Iterator[Change]:
        """Zeros, gear ratios and gains of torques."""
        found = by_joint((self.res.Y @ self.res.x)[..., None])
        for j, name in enumerate(self.names):
            of_joint = (name,)
            ratio = signed("the gear ratio given for {} is {:.3g} % too {}", "large", "small", name, scale=100)
            zero = words("the zero of {} is off by {:.3g} {}", name, self.units(j)[0])
            yield Change("joint zero", of_joint, self.zeros[j], zero)
            yield Change("gear ratio", of_joint, self.ratio_column(j), ratio)
            spring = self.res.column_of(j, lambda q, qd, qdd: q - q.mean())  # slack anywhere, beside an offset
            pull = words("something pulls {} as a spring of {:.3g} {} per {}", name, *self.units(j)[::-1])
            yield Change("spring", of_joint, spring, pull)
            factor = words("the torque of {} is measured {:.4g} times", name, start=1)
            yield Change(GAIN, of_joint, found[..., [j]], factor)

    @cached_property
    def zeros(self) -> list[Array]:
        """Torques per unit of each joint's zero."""
        return [self.res.columns(partial(self._shifted, unit))[..., None] for unit in np.eye(len(self.names))]

    def _shifted(self, unit: Array, g: Grid) -> Array:
        return slope(lambda h: self.res.load(g.q + h * unit, g.qd, g.qdd))

    def ratio_column(self, j: int) -> Array:
        """Measured torques per unit of a joint's gear ratio, to which motions and its torque are proportional."""
        unit = np.eye(len(self.names))[j]  # drives of the joint stay what they are

        def torques(g: Grid, k: Array) -> Array:
            return np.asarray(k * self.res.load(k * g.q, k * g.qd, k * g.qdd))

        return self.res.columns(lambda g: slope(lambda h: torques(g, 1 + h * unit)))[..., None]

    def drives(self) -> Iterator[Change]:
        """Rotors, friction and offsets that were not asked for."""
        for symbol, (kind, noun, torque) in DRIVES.items():
            if symbol in self.res.standard.terms:
                continue
            columns = [self.res.column_of(j, torque) for j in range(len(self.names))]
            for name, column in zip(self.names, columns, strict=True):
                text = words(f"the drive of {{}} has {noun} of {{:.3g}}, which was not asked for", name)
                yield Change(kind, (name,), column, text)
            every = f"the drives have {noun}, which was not asked for"
            yield Change(kind, self.names, np.concatenate(columns, axis=-1), words(every, ""))

    def changing(self) -> Iterator[Change]:
        """Friction that changes during the log; torques whose zero drifts."""
        ramp = self.place - self.place.mean()
        courses = (ramp, ramp**2 - (ramp**2).mean())
        for j, name in enumerate(self.names):
            terms = [self.res.column_of(j, DRIVES[symbol][2]) for symbol in ("Fv", "Fc")]
            columns = np.concatenate([term * course for term in terms for course in courses], axis=-1)
            yield Change("friction changed", (name,), columns, words("friction of {} changes during the log", name))
            drift = np.eye(len(self.names))[j][:, None] * ramp
            yield Change("offset drifts", (name,), drift, words("the zero of the torque of {} drifts", name))

    def friction(self) -> Iterator[Change]:
        """Friction that changes with speed or with the load."""
        loads = by_joint(self.res.curves[..., :1])
        for j, name in enumerate(self.names):
            sides = self.res.column_of(j, lambda q, qd, qdd: np.abs(qd))
            text = words("viscous friction of {} differs by {:.3g} between both directions", name, scale=2)
            yield Change("friction by direction", (name,), sides, text)
            text = words("friction of {} changes by {:.3g} % of its load", name, scale=100)
            yield Change("friction under load", (name,), loads[..., [j]], text)
            for share in VELOCITIES if self.res.fastest[j] > 0 else ():
                yield stribeck(self.res, j, share * self.res.fastest[j])

    @property
    def starts(self) -> Array:
        """Places at which something may begin."""
        return np.quantile(self.place, np.linspace(0, 1, PLACES + 2)[1:-1])

    def payloads(self) -> Iterator[Change]:
        """Another last body from some time on; another of the others, if much is left."""
        joints, nb = self.res.robot.model.moving_joints, self.res.robot.model.nb
        for i in range(nb) if self.res.share > SEEN else (nb - 1,):
            body = self.res.Y[..., PARAMETERS * i : PARAMETERS * (i + 1)]
            text = "the payload changes by {1:.3g} kg near {0}"
            if i < nb - 1:  # whose mass alone need not be felt
                text = f"the load on the link behind {joints[i]} changes near {{0}}"
            for start in self.starts:
                on, at = body * (self.place >= start), words(text, self.time(start))
                yield Change(LOAD, joints[i : i + 1], on, at, alternatives=PLACES * (nb - i))

    def slips(self) -> Iterator[Change]:
        """Another zero of a joint from some time on."""
        for j, name in enumerate(self.names):
            for start in self.starts:
                text = words("the encoder of {} slips by {:.3g} {} near {}", name, self.units(j)[0], self.time(start))
                column = self.zeros[j] * (self.place >= start)
                yield Change("encoder slip", (name,), column, text, alternatives=PLACES)

    def contacts(self) -> Iterator[Change]:
        """A force on the last link for a while."""
        model = self.res.robot.model
        link = [name for name, k in zip(model.link_names, model.link_body, strict=True) if k == model.nb - 1][-1]
        force = self.res.columns(lambda g: np.swapaxes(self.res.robot.jacobian(g.q, link)[..., 3:, :], -1, -2))
        edges = np.quantile(self.place, np.linspace(0, 1, 2 * PLACES + 1))
        for a, width in ((a, w) for a in range(2 * PLACES) for w in WIDTHS if a + w <= 2 * PLACES):
            begin, end = edges[a], edges[a + width]
            during = (self.place >= begin) & (self.place <= end)

            def text(c: Array, begin: float = begin, end: float = end) -> str:
                newtons = float(np.linalg.norm(c))
                return f"something pushes {link} with {newtons:.3g} N from {self.time(begin)} to {self.time(end)}"

            many = 2 * PLACES * len(WIDTHS)
            yield Change("contact", self.names[-1:], force * during, text, alternatives=many)


def words(text: str, *parts: Any, scale: float = 1.0, start: float = 0.0) -> Callable[[Array], str]:
    """A text of the first coefficient, which takes the second place."""
    return lambda c: text.format(parts[0], start + scale * c[0], *parts[1:])


def signed(text: str, above: str, below: str, *parts: Any, scale: float = 1.0) -> Callable[[Array], str]:
    """A text of the size of the first coefficient in the second place, with a word for its sign in the third."""
    return lambda c: text.format(parts[0], abs(scale * c[0]), above if c[0] > 0 else below, *parts[1:])


def delay_text(joints: tuple[str, ...]) -> Callable[[Array], str]:
    """Words for a delay, of all joints or of some."""
    whose = f" of {listed(joints)}" if joints else ""
    return signed("torques{} are measured {:.3g} ms {} than positions", "later", "earlier", whose, scale=1000)


def pulls(robot: Robot, gravity: Array, parameters: Array, g: Grid) -> Array:
    """Torques of several sets of bodies in a given gravity, one in each column."""
    alone = Robot(replace(robot.model, gravity=gravity), "numpy")
    return np.stack([alone.gravity_torque(g.q, parameters=pi) for pi in parameters], axis=-1)


def angle_between(a: Array, b: Array) -> float:
    """Angle of two vectors in degrees."""
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def direction_text(gravity: Array, given: Array) -> str:
    """Words for gravity along a vector instead of the vector given."""
    (x, y, z), angle = gravity / np.linalg.norm(gravity), angle_between(gravity, given)
    return f"gravity acts along ({x:.2f}, {y:.2f}, {z:.2f}), {angle:.3g} degrees from the model's"


def slope(function: Callable[[float], Array]) -> Array:
    """Derivative at zero by central differences."""
    return np.asarray((function(DIFFERENCE) - function(-DIFFERENCE)) / (2 * DIFFERENCE))


def delay_column(res: Residuals) -> Array:
    """Torques per second of delay."""
    bodies, parts = PARAMETERS * res.standard.model.nb, []
    for grid, load in zip(res.grids, res.loads_on_grids, strict=True):
        drives = res.standard.drive_torques(grid.record.qd, grid.record.qdd, res.x[bodies:])
        parts.append(grid.rate_of_change(grid.at_samples(load) + drives))
    return -np.concatenate(parts)[..., None]


def delay_columns(res: Residuals) -> list[tuple[tuple[str, ...], Array]]:
    """Torques per second of the delay of each record, together, and of each joint."""
    names, late = res.robot.joint_names, delay_column(res)
    records = [late * (res.record == k)[:, None, None] for k in range(len(res.records))]
    of_joints = [((name,), late * unit[:, None]) for name, unit in zip(names, np.eye(len(names)), strict=True)]
    return [(names, np.concatenate(records, axis=-1)), *of_joints[: len(names) * (len(names) > 1)]]


def size_text(factor: float) -> str:
    """Words for gravity of another size."""
    clock = f", or the times are {1 / np.sqrt(factor):.3g} times the true ones" if factor > 0 else ""
    return f"gravity is {factor:.3g} times the model's{clock}"


def stribeck(res: Residuals, j: int, vs: float) -> Change:
    """The Stribeck effect of a joint, of one velocity vs."""
    name, (unit, torque) = res.robot.joint_names[j], Log(res).units(j)
    column = res.column_of(j, lambda q, qd, qdd: np.sign(qd) * np.exp(-np.abs(qd) / vs))
    size = "friction of {0} is {1:.3g} {3} {2} at rest than above {4:.2g} {5}/s"
    text = signed(size, "more", "less", name, torque, 2 * vs, unit)
    return Change(STRIBECK, (name,), column, text, vs, len(VELOCITIES))


def sharpened(res: Residuals, cause: Cause) -> Cause:
    """The Stribeck effect with the velocity that fits best."""
    from scipy.optimize import minimize_scalar

    j = res.robot.joint_names.index(cause.joints[0])
    middle = np.log(cause.at)

    def loss(log: float) -> float:
        return -stribeck(res, j, float(np.exp(log))).judged(res).score

    best = minimize_scalar(loss, bounds=(middle - 1, middle + 1), method="bounded", options={"maxiter": 15}).x
    return stribeck(res, j, float(np.exp(best))).judged(res)


def derivative_by(res: Residuals, cause: Cause) -> Array:
    """Torques per unit of the delay or the Stribeck velocity of a cause, which the fit takes into account."""
    if cause.kind == "delay":
        late = np.isin(res.robot.joint_names, cause.joints)[:, None]
        of_record = np.isnan(cause.at) | (res.record == cause.at)
        return np.asarray(delay_column(res) * late * of_record[:, None, None])
    j, vs = res.robot.joint_names.index(cause.joints[0]), cause.at
    size = res.x[res.standard.groups["Fs"].start + j]
    return np.asarray(size / vs * slope(lambda h: stribeck(res, j, (1 + h) * vs).columns))


def swapped(n: int, i: int, j: int) -> Array:
    """The order of joints in which two are interchanged."""
    order = np.arange(n)
    order[[i, j]] = j, i
    return order


def dissipates(res: Residuals) -> Array:
    """True for joints whose friction takes power, as with a torque of the right sign; False where none is modelled."""
    power = np.zeros(res.robot.n)
    for symbol, exponent in (("Fv", 2), ("Fc", 1)):
        if symbol in res.standard.groups:
            size = np.mean([(np.abs(record.qd) ** exponent).mean(0) for record in res.records], axis=0)
            power += res.x[res.standard.groups[symbol]] * size
    return np.asarray(power > 0)


def other_torques(res: Residuals) -> Iterator[Cause]:
    """Torques of other signs and in another order."""
    names, n = res.robot.joint_names, res.robot.n
    for j in np.flatnonzero(~dissipates(res)).tolist():
        signs = np.where(np.arange(n) == j, -1, 1)
        text = f"the torque of {names[j]} has the wrong sign"
        yield Cause("torque sign", (names[j],), text, *res.gain(res.squares_of(res.Q, res.tau * signs)))
    for i, j in combinations(np.flatnonzero(res.counts).tolist(), 2):
        text = f"the torques of {names[i]} and {names[j]} are interchanged"
        squares = res.squares_of(res.Q, res.tau[:, swapped(n, i, j)])
        yield Cause("torque order", (names[i], names[j]), text, *res.gain(squares))


def other_joints(res: Residuals) -> Iterator[Cause]:
    """Joints in another order, coupled, of other directions, in degrees: joints J q, whose torques are J^-T tau."""
    names, n, unit = res.robot.joint_names, res.robot.n, np.eye(res.robot.n)
    changes: list[tuple[str, tuple[str, ...], str, Array]] = []
    for i, j in combinations(np.flatnonzero(res.counts).tolist(), 2):
        text = f"{names[i]} and {names[j]} are interchanged"
        changes.append(("joint order", (names[i], names[j]), text, unit[swapped(n, i, j)]))
    coupled = (res.standard.motors != 0).astype(int)
    known = coupled.T @ coupled  # pairs of joints that a motor of the drives turns with
    for j, k in ((j, k) for j in range(1, n) for k in (1, -1) if not known[j, j - 1]):
        J = unit.copy()
        J[j, j - 1] = -k  # positions read as those of motors
        text = f"the motor of {names[j]} turns with {names[j - 1]} too: a coupling is missing"
        changes.append(("coupling", (names[j - 1], names[j]), text, J))
    for j, name in enumerate(names):
        changes.append(("joint sign", (name,), f"{name} turns the other way", unit - 2 * np.diag(unit[j])))
    before = res.squares_moved(unit, res.tau)
    for kind, joints, text, J in changes:
        yield Cause(kind, joints, text, *res.gain(res.squares_moved(J, res.tau @ np.linalg.inv(J)), before))
    turns = res.robot.model.is_revolute[list(res.robot.model.independent_joints)]
    if max(np.ptp(record.q[:, turns], axis=0).max(initial=0) for record in res.records) > 1:
        squares = res.squares_moved(np.diag(np.where(turns, np.pi / 180, 1.0)), res.tau)
        yield Cause("degrees", names, "positions are in degrees", *res.gain(squares, before))


def torque_scale(res: Residuals) -> Iterator[Cause]:
    """Torques many times larger or smaller than the bodies of the robot given ask for, or of the opposite sign.

    Without what drives can explain, as an offset the weight of an arm that hardly moves; the torques of single joints
    also as measured, those of all joints as fitted.
    """
    bodies, names = PARAMETERS * res.standard.model.nb, res.robot.joint_names
    Q, ways = np.linalg.qr(res.weighted(res.Y[..., bodies:]))[0], []
    own = (res.Y[..., :bodies] @ x[:bodies] for x in (res.x, res.standard.values))
    torques = [res.weighted(x) for x in (res.tau, *own)]
    rest = [x - Q @ (Q.T @ x) for x in torques]
    for tau, _, given in (torques, rest):
        both, squares, measured = (res.by_joint(*x) for x in ((tau, given), (given, given), (tau, tau)))
        each = both / np.maximum(squares, TINY)
        ways.append((each, each * np.abs(both) / np.maximum(measured, TINY)))  # factors, squared cosines
    (_, found, given), (factors, cosines) = rest, np.where(ways[0][1] > ways[1][1], *ways)
    alike = cosines > ALIKE
    usual = np.median(factors[alike]) if alike.any() else 1.0
    odd = alike & (np.abs(np.log(np.where(alike, factors, usual) / usual)) > UNIT)
    for j in np.flatnonzero(odd).tolist():
        what = f"{factors[j]:.3g} times that of the robot given"
        text = f"the torque of {names[j]} is {what}: N mm, mA, at the motor, or is a mass given wrong?"
        yield Cause("torque unit", names[j : j + 1], text, float(res.counts.sum()), np.zeros(res.robot.n), factors[j])
    size = float(given @ given)
    factor = float(found @ given) / max(size, TINY)
    whole = factor * float(found @ given) / max(float(found @ found), TINY)  # squared cosine
    if odd.any() or size == 0 or whole < ALIKE or 1 / FACTOR < factor < FACTOR:
        return
    kind, text = "torque unit", f"torques are {factor:.3g} times those of the robot given: N mm, mA, or at the motors?"
    if factor < 0:
        kind, text = "torque sign", "the torques of all joints have the wrong sign"
    score = float(res.counts.sum()) if res.share < POOR else 2 * EVIDENT  # a fit that fails tells of no factor
    yield Cause(kind, names, text, score, np.zeros(res.robot.n), factor)


def gravity_directions(res: Residuals) -> Iterator[Cause]:
    """Gravity, a vector of any length, with which the torques are fitted best (Nelder and Mead 1965)."""
    from scipy.optimize import minimize

    model, width = res.robot.model, PARAMETERS * res.robot.model.nb
    size = float(np.linalg.norm(model.gravity))
    if size == 0:
        return

    def columns(gravity: Array) -> Array:
        alone = Robot(replace(model, gravity=size * gravity), "numpy")
        return res.columns(lambda g: alone.regressor(g.q, g.qd, g.qdd))

    still, *pulled = map(columns, (np.zeros(3), *np.eye(3)))
    pulls = np.array([res.weighted(y - still) for y in pulled])
    drives, still = res.weighted(res.Y[..., width:]), res.weighted(still)

    def squares(gravity: Array) -> Array:
        Q = np.linalg.qr(np.concatenate([still + np.tensordot(gravity, pulls, 1), drives], axis=1))[0]
        return res.squares_of(Q, res.tau)

    given = model.gravity / size

    def loss(gravity: Array) -> float:  # of those that fit equally well, the nearest to the model's
        return KEPT * float(((gravity - given) ** 2).sum()) - res.gain(squares(gravity))[0]

    starts = [given, *(s * e for e in np.eye(3) for s in (1, -1)), *(given + s * e for e in np.eye(3) for s in (1, -1))]
    before = squares(given)
    start = min((x for x in starts if x.any()), key=loss)
    simplex = start + np.vstack([np.zeros(3), TILT * np.eye(3)])
    options = {"maxfev": 100, "xatol": 3e-3, "fatol": 0.3, "initial_simplex": simplex}
    found = minimize(loss, start, method="Nelder-Mead", options=options).x
    length, angle = float(np.linalg.norm(found)), angle_between(found, given)
    gain, removed = res.gain(squares(found), before)
    if angle > TURNED:
        yield Cause(DIRECTION, (), direction_text(found, given), gain - res.penalty(3), removed, angle)
    elif abs(length - 1) > SCALED:
        yield Cause(SIZE, (), size_text(length), gain - res.penalty(3), removed, length)
