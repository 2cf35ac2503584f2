"""Hypotheses on torques that a model leaves unexplained, among them the causes of an identification's residuals.

A hypothesis adds columns X to the torques of a model: derivatives with respect to a delay, a gear ratio or a zero, the
torques of a payload from some time on, or of a temporary force on the last link. Least squares with these columns gives
the reduction of the residuals. The score is the gain of log likelihood, each joint with its own noise, minus log(N) / 2
per free number (Schwarz 1978) and the logarithm of the number of alternatives tried. Changes that are not small, such
as torques of the wrong sign or joints in another order, are tried by fitting again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import comb
from typing import Any, Literal, NamedTuple

import numpy as np

from ...basics.inertia import PARAMETERS
from ...basics.spatial import Array
from ...basics.text import listed
from ...dynamics import inverse_dynamics
from ...dynamics.regressors import gravity_torques
from ...model.coupling import with_ratio
from ...robot import Robot
from .. import thresholds
from ..fit.equations import in_space_of_instruments, solve, triangular
from ..log.findings import seconds
from ..log.prepared import Prepared
from .conventions import conventions, turning
from .residuals import Discrepancy, FitResiduals, Torques, by_joint, extended, orthonormal
from .rigid_body_test import noise_shares

LOGGER = logging.getLogger("rne")
STRIBECK, SIZE, DIRECTION, GAIN = "Stribeck friction", "gravity magnitude", "gravity direction", "torque factor"
LOAD = "payload changed"
EVENTS = (LOAD, "encoder slip", "contact", "friction changed", "offset drifts")  # kinds judged by short blocks
GEARS = ("friction under load", "friction by direction", "pre-sliding friction", STRIBECK)  # also in healthy gears
DRIVES = {"Ia": "rotor", "Fv": "viscous friction", "Fc": "Coulomb friction", "tau0": "offset"}  # kinds of symbols
NOT_ASKED = "the drive of {joint} has %s of {size:.3g}, which was not asked for"
OF_JOINTS: dict[str, tuple[str, Torques, float]] = {  # kind: text, torque of each joint, scale of the printed number
    "rotor": (NOT_ASKED % "a rotor", lambda q, qd, qdd: qdd, 1.0),
    "viscous friction": (NOT_ASKED % "viscous friction", lambda q, qd, qdd: qd, 1.0),
    "Coulomb friction": (NOT_ASKED % "Coulomb friction", lambda q, qd, qdd: np.sign(qd), 1.0),
    "offset": (NOT_ASKED % "an offset", lambda q, qd, qdd: np.ones(qd.shape), 1.0),
    "friction by direction": (
        "viscous friction of {joint} differs by {size:.3g} between both directions",
        lambda q, qd, qdd: np.abs(qd),
        2.0,
    ),
    "spring": (  # with any rest position, as an offset is fitted too
        "something pulls {joint} as a spring of {size:.3g} {torque} per {unit}",
        lambda q, qd, qdd: q - q.mean(0),
        1.0,
    ),
}
OF_DRIVES = "%s of rne.DriveModel"
MENDED_BY = {  # kind: option of the fit, or of the log, that accounts for it
    "rotor": OF_DRIVES % "rotor=True",
    "viscous friction": OF_DRIVES % 'friction="viscous"',
    "Coulomb friction": OF_DRIVES % 'friction="coulomb"',
    "offset": OF_DRIVES % "offset=True",
    "friction under load": OF_DRIVES % 'friction="load"',
    "friction by direction": OF_DRIVES % 'friction="viscous+asymmetric"',
    STRIBECK: OF_DRIVES % "stribeck",
    "pre-sliding friction": OF_DRIVES % "stribeck",
    "spring": "springs=[rne.Spring.at_joint(...)]",
    "delay": "delay",
    DIRECTION: "Robot.mounted",
    LOAD: "Record.between, Robot.with_payload",
    "contact": "Record.between",
    "encoder slip": "Record.between",
    "gear ratio": "ratios of Record.from_motors",
    "joint zero": "offsets of Record.from_motors",
    "coupling": "coupling of Record.from_motors",
    "coupling ratio": "multiplier of the URDF's mimic, or the function of rne.model.coupled",
    GAIN: "drive_gains of Record.from_motors",
    "torque sign": "negative drive_gains of Record.from_motors",
    "joint sign": "negative ratios of Record.from_motors",
    "joint order": "joint_names of the Record",
    "degrees": 'unit="deg" of the Record',
}
IN_LOGS = {  # kind of convention: kind of the cause in a log, and its text
    "torque sign": ("torque sign", "the torque of {} has the wrong sign"),
    "torque order": ("torque order", "the torques of {} and {} are interchanged"),
    "joint order": ("joint order", "{} and {} are interchanged"),
    "axis flipped": ("joint sign", "{} turns the other way"),
    "angle unit": ("degrees", "positions are in degrees"),
}


class Cause(NamedTuple):
    """Likely cause of residuals, a change that explains part of the torques left unexplained by `rne.identify`.

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
    effect : str
        Validation error before and after the change, such as "10.2 -> 3.1 % on joint_2"; empty for a unit or sign of
        all torques, which does not change it.
    removed : ndarray, shape (n,)
        Part of the squares of each joint's errors there that it takes away.
    value, error : float
        Its size and the standard error of that, where it is one number, otherwise NaN: a delay [s], a zero [rad or m],
        a ratio relative to one, friction, an inertia or an offset in the units of its joint.
    at : float
        The record's number of a delay, or the Stribeck velocity [rad/s or m/s]; otherwise NaN.
    numbers : int
        Free numbers that were fitted.
    """

    kind: str
    joints: tuple[str, ...]
    text: str
    score: float
    value: float = float("nan")
    error: float = float("nan")
    at: float = float("nan")
    effect: str = ""
    removed: Array = np.zeros(0)
    numbers: int = 0


WITH_GEARS = " with gear friction modelled"  # added to an effect that is judged with friction of gears in the model
Trial = Callable[[FitResiduals], tuple[Array, ...]]  # validation errors without and with a change
LinearCauses = tuple[int, list[tuple[Cause, Array, Trial]]]  # number tried; evident causes with their columns


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Possible cause of torques that a model does not explain: columns of torque, and a text for their numbers.

    `rne.identify` and `rne.compare_models` try many, and also those of their argument `hypotheses`.

    Attributes
    ----------
    kind : str
        Its name, as in `Cause.kind` and `ModelComparison.causes`.
    columns : callable or ndarray
        Torques per unit of k unknown numbers: a function (q, qd, qdd) of arrays of shape (T, n) that returns an array
        of shape (T, n, k), or the values at the rows of the equations.
    text : str or callable
        Words for the numbers: a format such as "a spring of {:.3g} N m/rad", or a function of an array of k numbers. Of
        a family, by "each" or `masks`, a function of its numbers, the joint's index and the mask's index.
    joints : tuple of str
        Joints concerned.
    at : float or ndarray
        Place of the hypothesis among others of its kind, see `Cause.at`; of each joint in a family.
    alternatives : float or ndarray
        How many hypotheses, such as times of a contact, this one is chosen from; of each joint in a family.
    numbers : {"all", "few", "switches", "each"}
        All numbers are fitted; for `rne.compare_models` also only those that are not zero, or each is 0 or 1. "each" is
        a family, of which k / len(joints) numbers of each joint are tried separately.
    masks : ndarray of bool, shape (M, rows), optional
        Rows of the equations in which the columns act: a family, of which that with the best mask is judged.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, unit = rne.load("irb140"), np.eye(6)[:, [3]]
    >>> cable = rne.identification.Hypothesis("cable", lambda q, qd, qdd: np.sin(q)[..., None] * unit, "{:.3g} N m")
    >>> other = lambda q, qd, qdd: robot.inverse_dynamics(q, qd, qdd) + 2 * np.sin(q) * unit[:, 0]
    >>> rne.compare_models(robot, other, hypotheses=[cable])
    ModelComparison(cause: cable; 2 N m)
    """

    kind: str
    columns: Torques | Array
    text: str | Callable[..., str]
    joints: tuple[str, ...] = ()
    at: float | Array = float("nan")
    alternatives: float | Array = 1.0
    numbers: Literal["all", "few", "switches", "each"] = "all"
    masks: Array | None = None


def text_of(h: Hypothesis, c: Array, j: int = 0, m: int = 0) -> str:
    """Text of a hypothesis with its numbers; of a family for joint j and mask m."""
    if isinstance(h.text, str):
        return h.text.format(*c)
    return h.text(c) if h.numbers != "each" and h.masks is None else h.text(c, j, m)


def columns_of(rest: Discrepancy, h: Hypothesis) -> Array:
    """Columns of a hypothesis at the rows of the equations, shape (rows, n, k), checked."""
    columns = h.columns
    if not callable(columns):
        return columns

    def checked(q: Array, qd: Array, qdd: Array) -> Array:
        found = np.asarray(columns(q, qd, qdd), dtype=np.float64)
        if found.ndim != 3 or found.shape[:2] != q.shape or not np.isfinite(found).all():
            shape = f"({len(q)}, {rest.robot.n}, k)"
            raise ValueError(
                f"`columns` of the hypothesis {h.kind!r} must be finite, of shape {shape}, got {found.shape}"
            )
        return found

    return rest.sampled(checked)


def judged(
    rest: Discrepancy, h: Hypothesis, least: float = -np.inf, *, by_rank: bool = False
) -> Iterator[tuple[Cause, Array, Array]]:
    """Causes scored above `least`, with columns and coefficients; for a family one per joint, with its best mask.

    A score counts all numbers, or with `by_rank` only those that are independent of known columns.
    """
    masks = [None] if h.masks is None else h.masks
    for j, (joints, group, at, alternatives) in enumerate(members(rest, h)):
        whole, best, score = rest.weighted(group), -1, least
        for m, mask in enumerate(masks):
            fit = rest.with_numbers(whole if mask is None else whole * mask[rest.row, None], h.numbers)
            numbers = fit[3] if by_rank else group.shape[-1]
            tried = rest.gain(rest.by_joint(fit[2])) - rest.penalty(numbers) - float(np.log(alternatives))
            if h.numbers == "few":
                tried -= float(np.log(comb(group.shape[-1], np.count_nonzero(fit[0]))))
            if tried > score:
                best, score, (c, error, *_), spent = m, tried, fit, numbers
        if best >= 0:
            mask = masks[best]
            size = (float(c[0]), float(error[0])) if len(c) == 1 else (float("nan"), float("nan"))
            cause = Cause(kind_of(h, c), joints, text_of(h, c, j, best), score, *size, at, numbers=spent)
            yield cause, group if mask is None else group * mask[:, None, None], c


def kind_of(h: Hypothesis, c: Array) -> str:
    """Kind of a hypothesis with its numbers."""
    if h.kind == STRIBECK and c[0] < 0:
        return "pre-sliding friction"
    return "torque sign" if h.kind == GAIN and h.numbers != "few" and c[0] < -1 else h.kind


def members(rest: Discrepancy, h: Hypothesis) -> Iterator[tuple[tuple[str, ...], Array, float, float]]:
    """Joints, columns, place and alternatives of each member of a family, or of a single hypothesis."""
    columns, joints = columns_of(rest, h), [(name,) for name in h.joints] if h.numbers == "each" else [h.joints]
    if not joints or columns.shape[-1] % len(joints):
        of = f"{columns.shape[-1]} columns for {len(joints)} joints"
        raise ValueError(f"`columns` of the hypothesis {h.kind!r} must be as many for each of its `joints`, got {of}")
    at, alternatives = (np.broadcast_to(x, len(joints)).tolist() for x in (h.at, h.alternatives))
    yield from zip(joints, np.split(columns, len(joints), axis=-1), at, alternatives, strict=True)


def one_by_one(rest: Discrepancy, given: Sequence[Hypothesis]) -> Iterator[Hypothesis]:
    """Hypotheses with their columns evaluated, families split into their members."""
    for h in given:
        for j, (joints, columns, at, many) in enumerate(members(rest, h)):

            def text(c: Array, _: int = 0, m: int = 0, h: Hypothesis = h, j: int = j) -> str:
                return text_of(h, c, j, m)

            own: dict[str, Any] = {"numbers": "all"} if h.numbers == "each" else {}
            yield replace(h, columns=columns, text=text, joints=joints, at=at, alternatives=many, **own)


def hypotheses_argument(given: Any) -> tuple[Hypothesis, ...]:
    """Argument `hypotheses`, checked."""
    if not isinstance(given, Sequence) or not all(isinstance(x, Hypothesis) for x in given):
        raise TypeError(f"`hypotheses` must be a sequence of rne.identification.Hypothesis, got {given!r}")
    return tuple(given)


def linear_causes(rest: FitResiduals, hypotheses: Sequence[Hypothesis] | None) -> LinearCauses:
    """Evident causes, and the number tried; without `hypotheses`, only gear friction is tried."""
    linear = [(rest, h) for h in friction(rest)]
    if hypotheses is not None:
        beyond = rest.beyond_friction
        kinds = (delays, other_gravity, joints, coupling_ratios, changing, payloads, contacts)
        linear += [(rest, h) for h in declined_drives(rest)] + [(beyond, h) for h in hypotheses]
        linear += [(beyond, h) for kind in kinds for h in kind(beyond)]
    found = [(h, *x) for left, h in linear for x in judged(left, h, thresholds.EVIDENT)]
    return len(linear), [
        (cause, columns, partial(of_columns, columns, h.kind in EVENTS)) for h, cause, columns, _ in found
    ]


def leading_columns(linear: LinearCauses) -> Array | None:
    """Columns of the best cause, other than delays and gear friction; None without one."""
    others = [x for x in linear[1] if x[0].kind not in (*GEARS, "delay")]
    return max(others, key=lambda x: x[0].score)[1] if others else None


def likely_causes(
    rest: FitResiduals, hypotheses: Sequence[Hypothesis] | None = (), linear: LinearCauses | None = None
) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    """Best evident causes by kind and joints that reduce the validation error, and others whose effect is small.

    The likeliest comes first; causes that explain what friction cannot come before friction of gears. Without
    `hypotheses`, only that friction is tried; `linear` causes may be known.
    """
    tried_linear, evident = linear_causes(rest, hypotheses) if linear is None else linear
    found: list[tuple[Cause, Trial | None]] = [(cause, trial) for cause, _, trial in evident]
    if hypotheses is not None:
        conventions = other_conventions(rest, rest.beyond_friction)
        found += [*torque_scale(rest), *powered(rest), *gravity_directions(rest), *conventions]
    best: dict[tuple[str, tuple[str, ...]], tuple[Cause, list[Trial | None]]] = {}
    for cause, trial in sorted(found, key=lambda pair: (pair[0].kind in GEARS, -pair[0].score)):
        if cause.score > thresholds.EVIDENT:
            _, trials = best.setdefault((cause.kind, cause.joints), (cause, []))
            if trials in ([], [None]):  # a cause that is certain without a trial gets the effect of a similar one
                trials.insert(0, trial)
    tried = [
        next((x for trial in trials if (x := with_effect(rest, cause, trial))), None) for cause, trials in best.values()
    ]
    named, small = (tuple(x[0] for x in tried if x is not None and x[1] is named) for named in (True, False))
    LOGGER.info("%d changes tried, %d evident, %d reduce the validation error", tried_linear, len(tried), len(named))
    return named, small


def of_columns(columns: Array, is_event: bool, rest: FitResiduals) -> tuple[Array, ...]:
    """Validation errors without further columns and with them."""
    blocks = rest.short_blocks if is_event else rest.blocks
    Q = extended(rest.Q, rest.weighted(columns))
    return rest.errors[is_event], rest.held_out(Q, rest.weighted(rest.tau), blocks)


def with_effect(rest: FitResiduals, cause: Cause, trial: Trial | None) -> tuple[Cause, bool] | None:
    """Cause with its effect on the validation error, and True if significant; None if no joint improves or one worsens.

    Significant: an error falls by 5 % and by twice its standard error over the blocks. Judged with the friction terms
    of healthy gears in the model; the effect reported is the one without them, if there is one.
    """
    if trial is None:
        return cause._replace(removed=np.zeros(rest.robot.n)), True
    left = rest if cause.kind in GEARS else rest.beyond_friction
    (ratio, scatter), (told, _) = map(held_out_ratio, map(trial, (left, rest)))
    gains, least = -left.counts * np.log(ratio), 1 - thresholds.BETTER
    if ratio.min() > least or gains.sum() < thresholds.EVIDENT or gains.min() < -thresholds.WORSE * gains.sum():
        return None
    shown, factor, words = (rest, told, "") if told.min() < least else (left, ratio, WITH_GEARS)
    errors = 100 * np.sqrt(shown.errors[0].sum(0))
    largest = [j for j in np.argsort(errors**2 * (factor**2 - 1)) if factor[j] < least][: thresholds.EFFECTS]
    effects = [f"{errors[j]:.3g} -> {errors[j] * factor[j]:.3g} % on {rest.names[j]}{words}" for j in largest]
    has_cure = cause.kind not in MENDED_BY or cause.text.endswith(")")
    text = cause.text if has_cure else f"{cause.text} ({MENDED_BY[cause.kind]})"
    return cause._replace(text=text, effect=", ".join(effects), removed=1 - told**2), matters(ratio, scatter)


def matters(ratio: Array, scatter: Array) -> bool:
    """True if a joint's error falls by more than 5 %, and by twice the standard error over the blocks."""
    return bool(((ratio < 1 - thresholds.MATTERS) & (1 - ratio > thresholds.SURELY * scatter)).any())


def held_out_ratio(shares: tuple[Array, ...]) -> tuple[Array, Array]:
    """Ratio of each joint's error with a change to that without, and its standard error between blocks."""
    before, after = shares
    size = np.maximum(before.sum(0), thresholds.LEAST**2)
    ratio = np.sqrt(np.maximum(after.sum(0), thresholds.LEAST**2) / size)
    scatter = np.sqrt(len(before) / max(len(before) - 1, 1) * ((after - ratio**2 * before) ** 2).sum(0)) / size
    return ratio, scatter / (2 * ratio)


def delays_of(rest: FitResiduals) -> list[Cause]:
    """Delays of records and joints visible in the residuals, selected one by one, then estimated together."""
    names, left = rest.names, rest
    options = [(joints, columns) for h in delays(rest) for joints, columns, *_ in members(rest, h)]
    chosen: list[tuple[tuple[str, ...], Array]] = []
    while options:
        fits = [left.with_columns(columns) for _, columns in options]
        gains = [left.gain(left.by_joint(values)) - left.penalty(len(c)) for c, _, values, _ in fits]
        scores = [x if np.abs(c).max() < thresholds.LATEST else -np.inf for x, (c, *_) in zip(gains, fits, strict=True)]
        if max(scores) <= thresholds.EVIDENT:
            break
        chosen.append(options.pop(int(np.argmax(scores))))
        left = left.with_known(chosen[-1][1])
    if not chosen:
        return []
    c, errors, *_ = rest.with_columns(np.concatenate([columns for _, columns in chosen], axis=-1))
    places = [(joints, k if joints is names else np.nan) for joints, x in chosen for k in range(x.shape[-1])]
    sizes = zip(places, c.tolist(), errors.tolist(), strict=True)
    return [Cause("delay", joints, "", np.nan, x, e, at) for (joints, at), x, e in sizes]


def added_delay(cause: Cause, records: int, names: Sequence[str]) -> Array:
    """Increment of the delays by a cause, for a number of records and the named joints, shape (records, n) [s]."""
    of_record = np.isnan(cause.at) | (np.arange(records) == cause.at)
    return np.asarray(cause.value * np.outer(of_record, np.isin(names, cause.joints)))


def delays_by_instruments(rest: FitResiduals, moved: Sequence[Prepared]) -> list[Cause]:
    """Delays of records by instrumental variables, without those that have settled or are out of range."""
    data, names = rest.data, rest.names
    along = FitResiduals(rest.robot, rest.base, replace(data, prepared=tuple(moved)), rest.beta, rest.sigma)
    each = np.equal.outer(rest.record, np.arange(len(data.prepared)))[:, None]
    instruments, columns = (
        np.concatenate([x, residuals.delay_column * each], axis=-1)
        for x, residuals in ((data.Z, along), (rest.Y @ rest.base.back, rest))
    )
    rows = np.concatenate([instruments, columns, rest.tau[..., None]], axis=-1)
    fit = solve(in_space_of_instruments(triangular(rest.weighted(rows)), instruments.shape[-1]))
    errors = np.sqrt(rest.correlation) * np.linalg.norm(fit.inverse, axis=1)
    late = [(k, float(fit.x[p]), float(errors[p])) for k, p in enumerate(range(rest.base.count, len(fit.x)))]
    found = [(k, x, e) for k, x, e in late if thresholds.DELAY_SETTLED * e < abs(x) < thresholds.LATEST]
    return [Cause("delay", names, "", np.nan, x, e, float(k)) for k, x, e in found]


def merged_by_kind(causes: Sequence[Cause]) -> tuple[Cause, ...]:
    """Causes merged by kind, with the joints and numbers of all."""
    found = []
    for kind in dict.fromkeys(cause.kind for cause in causes):
        first, *others = (cause for cause in causes if cause.kind == kind)
        if kind == LOAD or len(first.joints) != 1:  # on one link; loads on neighbouring links look alike
            others = []
        known = [first.joints]
        for cause in [*others]:  # of records without and with a load, both may show it of one joint
            if any(set(cause.joints) & set(joints) for joints in known):
                others.remove(cause)
            known.append(cause.joints)
        names = dict.fromkeys(name for cause in (first, *others) for name in cause.joints)
        parts = [part for cause in (first, *others) for part in cause.effect.split(", ") if part]
        joints = (part.rpartition(" on ")[2].partition(WITH_GEARS)[0] for part in reversed(parts))
        effects = dict(zip(joints, reversed(parts), strict=True))  # of each joint, by the likeliest cause
        texts = [cause.text for cause in (first, *others)]
        found.append(
            first._replace(joints=tuple(names), text=merged_text(texts), effect=", ".join(reversed(effects.values())))
        )
    return tuple(found)


def merged_text(texts: Sequence[str]) -> str:
    """Merged text of several that differ in names and numbers."""
    places = list(zip(*(text.split(" ") for text in texts), strict=False))
    differ, words_of_cause = sum(len(set(words)) > 1 for words in places), texts[0].partition(" (")[0].split(" ")
    if len({text.count(" ") for text in texts}) > 1 or 2 * differ > len(words_of_cause):
        return "; ".join(texts)
    return " ".join(words[0] if len(set(words)) == 1 else ", ".join(words) for words in places)


# Words


def of_each(
    rest: Discrepancy,
    text: str,
    *,
    scale: float = 1.0,
    start: float = 0.0,
    signs: tuple[str, ...] = (),
    times: Sequence[str] = ("",),
) -> Callable[[Array, int, int], str]:
    """Function for the text of a number of joint j from time m on; if `signs` are given, of its size and sign."""

    def told(c: Array, j: int, m: int) -> str:
        size, (unit, torque) = start + scale * float(c[0]), units(rest.robot, j)
        sign = signs[size <= 0] if signs else ""
        size = abs(size) if signs else size
        return text.format(joint=rest.names[j], size=size, sign=sign, unit=unit, torque=torque, time=times[m])

    return told


def delay_text(joints: tuple[str, ...]) -> Callable[[Array], str]:
    """Text of a delay, of all joints or of some."""
    whose = f" of {listed(joints)}" if joints else ""

    def told(c: Array) -> str:
        sign = "later" if c[0] > 0 else "earlier"
        return f"torques{whose} are measured {abs(1000 * c[0]):.3g} ms {sign} than positions"

    return told


def size_text(factor: float) -> str:
    """Text of another magnitude of gravity."""
    clock = f", or the times are {1 / np.sqrt(factor):.3g} times the true ones" if factor > 0 else ""
    return f"gravity is {factor:.3g} times the model's{clock}"


def direction_text(gravity: Array, given: Array) -> str:
    """Text of gravity along another vector than the given one."""
    (x, y, z), angle = gravity / np.linalg.norm(gravity), angle_between(gravity, given)
    return f"gravity acts along ({x:.2f}, {y:.2f}, {z:.2f}), {angle:.3g} degrees from the model's"


def angle_between(a: Array, b: Array) -> float:
    """Angle between two vectors in degrees."""
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def units(robot: Robot, j: int) -> tuple[str, str]:
    """Units of a joint's position and torque."""
    return ("rad", "N m") if robot.model.is_revolute[robot.model.independent_joints[j]] else ("m", "N")


# Kinds of measurements and models


def of_joints(rest: Discrepancy, kinds: Iterable[str]) -> Iterator[Hypothesis]:
    """Hypotheses on torques of single joints, a family for each kind."""
    for kind, (text, torques, scale) in ((kind, OF_JOINTS[kind]) for kind in kinds):
        columns = rest.of_each_joint(torques)
        yield Hypothesis(kind, columns, of_each(rest, text, scale=scale), rest.names, numbers="each")


def factors(rest: Discrepancy, torques: Array) -> Hypothesis:
    """Hypotheses on factors of the torques of single joints, shape (rows, n)."""
    text = of_each(rest, "the torque of {joint} is measured {size:.4g} times", start=1)
    return Hypothesis(GAIN, by_joint(torques[..., None]), text, rest.names, numbers="each")


def gravity_columns(rest: Discrepancy, *bodies: Array) -> Array:
    """Torques per unit of each component of gravity of several sets of bodies, shape (rows, n, 3, sets)."""
    return rest.sampled(lambda q, qd, qdd: gravity_torques(rest.robot.model, q, np.stack(bodies, axis=-1)))


def zero_columns(rest: Discrepancy) -> Array:
    """Torques per unit of each joint's zero, shape (rows, n, n)."""
    steps = np.eye(rest.robot.n)[:, None]

    def torques(q: Array, qd: Array, qdd: Array) -> Array:
        states = [np.broadcast_to(x, (rest.robot.n, *q.shape)) for x in (qd, qdd)]
        return np.moveaxis(slope(lambda h: rest.load(q + h * steps, *states)), 0, -1)

    return rest.sampled(torques)


def slope(function: Callable[[float], Array]) -> Array:
    """Derivative at zero by central differences."""
    step = thresholds.DIFFERENCE
    return np.asarray((function(step) - function(-step)) / (2 * step))


# Kinds of measurements only


def declined_drives(rest: FitResiduals) -> Iterator[Hypothesis]:
    """Hypotheses on rotors, friction and offsets that are not fitted, of single joints and of all."""
    for kind in (kind for symbol, kind in DRIVES.items() if symbol not in rest.standard.terms):
        (each,) = of_joints(rest, [kind])
        text = OF_JOINTS[kind][0].replace("drive of {joint} has", "drives have").replace(" of {size:.3g}", "")
        yield each
        yield Hypothesis(kind, each.columns, text, rest.names)


def other_gravity(rest: FitResiduals) -> Iterator[Hypothesis]:
    """Hypotheses on gravity of another magnitude, as by a wrong clock rate, or tilted by a small angle.

    Torques may depend on the first body's centre only in tilted gravity.
    """
    gravity, size = rest.robot.model.gravity, float(np.linalg.norm(rest.robot.model.gravity))
    columns = gravity_columns(rest, rest.bodies, *np.eye(len(rest.bodies))[1:4])
    yield Hypothesis(SIZE, columns[..., 0] @ gravity[:, None], lambda c: size_text(1 + float(c[0])))
    if size:
        given = gravity / size
        level = np.linalg.svd(given[None])[2][1:]  # two directions at right angles to gravity
        pulls = size * level @ columns
        tilted = np.concatenate([pulls[..., 0], pulls[..., 0, 1:], pulls[..., 1, 1:]], axis=-1)
        yield Hypothesis(DIRECTION, tilted, lambda c: direction_text(given + c[:2] @ level, given))


def delays(rest: FitResiduals) -> Iterator[Hypothesis]:
    """Hypotheses on delays of torques: of each record, or of one joint."""
    late, names = rest.delay_column, rest.names
    of_records = [late * (rest.record == k)[:, None, None] for k in range(len(rest.records))]
    yield Hypothesis("delay", np.concatenate(of_records, axis=-1), delay_text(()), names)
    if len(names) > 1:
        yield Hypothesis("delay", by_joint(late), lambda c, j, m: delay_text((names[j],))(c), names, numbers="each")


def joints(rest: FitResiduals) -> Iterator[Hypothesis]:
    """Hypotheses on zeros, also from a certain time on, gear ratios, springs and gains of torques."""
    zeros, (times, masks) = zero_columns(rest), starts(rest)
    zero = of_each(rest, "the zero of {joint} is wrong by {size:.3g} {unit}")
    slip = of_each(rest, "the encoder of {joint} slips by {size:.3g} {unit} near {time}", times=times)
    given = "the gear ratio given for {joint} is {size:.3g} % too {sign}"
    ratio = of_each(rest, given, scale=100, signs=("large", "small"))
    each = partial(Hypothesis, joints=rest.names, numbers="each")
    yield each("joint zero", zeros, zero)
    yield each("encoder slip", zeros, slip, alternatives=thresholds.PLACES, masks=masks)
    yield each("gear ratio", ratio_columns(rest), ratio)
    yield from of_joints(rest, ["spring"])
    yield factors(rest, rest.Y @ rest.x)


def ratio_columns(rest: FitResiduals) -> Array:
    """Derivatives of measured torques with respect to each gear ratio; motions and torques are proportional to it."""
    steps = np.eye(rest.robot.n)[:, None]  # parameters of the joint's drive stay the same

    def torques(k: Array, motion: tuple[Array, ...]) -> Array:
        return np.asarray(k * rest.load(*(k * x for x in motion)))

    return rest.sampled(lambda *motion: np.moveaxis(slope(lambda h: torques(1 + h * steps, motion)), 0, -1))


def coupling_ratios(rest: FitResiduals) -> Iterator[Hypothesis]:
    """Hypotheses on ratios of mimic and coupled joints, except linkages, whose lengths determine them."""
    model, bodies = rest.robot.model, rest.bodies
    closed = {joint for loop in model.loops for joint in loop.followers}
    for joint in (name for name in model.moving_joints if name not in closed.union(rest.names)):

        def torques(q: Array, qd: Array, qdd: Array, joint: str = joint) -> Array:
            given = {"parameters": bodies}
            return slope(lambda h: inverse_dynamics.evaluate(with_ratio(model, joint, 1 + h), q, qd, qdd, **given)[0])

        def text(c: Array, joint: str = joint) -> str:
            size = f"{abs(100 * c[0]):.3g} % too {'small' if c[0] > 0 else 'large'}"
            return f"the ratio given for {joint}, which follows others, is {size}"

        yield Hypothesis("coupling ratio", rest.near_rows(torques)[..., None], text, (joint,))


def changing(rest: FitResiduals) -> Iterator[Hypothesis]:
    """Hypotheses on friction that changes during the log, and drifting torque offsets."""
    ramp = progress(rest) - progress(rest).mean()
    terms = [rest.sampled(OF_JOINTS[kind][1])[..., None] for kind in ("viscous friction", "Coulomb friction")]
    courses = [term * course for term in terms for course in (ramp, ramp**2)]
    each = partial(Hypothesis, joints=rest.names, numbers="each")
    friction = of_each(rest, "friction of {joint} changes during the log")
    yield each("friction changed", by_joint(np.concatenate(courses, axis=-1)), friction)
    drift = of_each(rest, "the zero of the torque of {joint} drifts")
    yield each("offset drifts", by_joint(ramp + np.zeros((*rest.tau.shape, 1))), drift)


def friction(rest: FitResiduals) -> Iterator[Hypothesis]:
    """Hypotheses on friction that varies with speed or with the load."""
    yield from of_joints(rest, ["friction by direction"])
    load = of_each(rest, "friction of {joint} changes by {size:.3g} % of its load", scale=100)
    yield Hypothesis("friction under load", by_joint(rest.curves[..., :1]), load, rest.names, numbers="each")
    for share in thresholds.STRIBECK_SPEEDS:
        yield stribeck(rest, np.flatnonzero(rest.fastest).tolist(), share * rest.fastest)


def stribeck_columns(rest: FitResiduals, vs: Array | float) -> Array:
    """Torques of the Stribeck effect of each joint for velocities vs, shape (rows, n, n)."""
    return rest.of_each_joint(lambda q, qd, qdd: np.sign(qd) * np.exp(-np.abs(qd) / vs))


def stribeck(rest: FitResiduals, joints: Sequence[int], vs: Array) -> Hypothesis:
    """Hypothesis of the Stribeck effect of some joints, with the velocities of all, shape (n,)."""
    columns = stribeck_columns(rest, np.maximum(vs, thresholds.TINY))[..., joints]

    def text(c: Array, k: int, m: int) -> str:
        j, sign = joints[k], "more" if c[0] > 0 else "less"
        unit, torque = units(rest.robot, j)
        size = f"{abs(c[0]):.3g} {torque} {sign} at rest than above {2 * vs[j]:.2g} {unit}/s"
        return f"friction of {rest.names[j]} is {size}"

    names, many = tuple(rest.names[j] for j in joints), len(thresholds.STRIBECK_SPEEDS)
    return Hypothesis(STRIBECK, columns, text, names, vs[joints], many, numbers="each")


def refine(rest: FitResiduals, cause: Cause) -> Cause:
    """Cause of the Stribeck effect with the best-fitting velocity."""
    from scipy.optimize import minimize_scalar

    j, middle = rest.names.index(cause.joints[0]), np.log(cause.at)

    def at(log: float) -> Cause:
        ((found, *_),) = judged(rest, stribeck(rest, [j], np.full(rest.robot.n, np.exp(log))))
        return found

    bounds, options = (middle - 1, middle + 1), {"maxiter": thresholds.STRIBECK_STEPS}
    return at(minimize_scalar(lambda log: -at(log).score, bounds=bounds, method="bounded", options=options).x)


def derivative_by(rest: FitResiduals, cause: Cause) -> Array:
    """Torques per unit of the delay or the Stribeck velocity of a cause, which the fit takes into account."""
    if cause.kind == "delay":
        late = np.isin(rest.names, cause.joints)[:, None]
        of_record = np.isnan(cause.at) | (rest.record == cause.at)
        return np.asarray(rest.delay_column * late * of_record[:, None, None])
    j, vs = rest.names.index(cause.joints[0]), cause.at
    size = rest.x[rest.standard.groups["Fs"].start + j]
    return np.asarray(size / vs * slope(lambda h: stribeck_columns(rest, (1 + h) * vs)[..., [j]]))


# Events during a log


def progress(rest: FitResiduals) -> Array:
    """Times of the rows: index of the record, and elapsed fraction of it, shape (rows, 1, 1)."""
    passed = [(r.times - r.times[0]) / (np.ptp(r.times) or 1.0) * (1 - 1e-9) for r in rest.records]
    return np.concatenate([k + x for k, x in enumerate(passed)])[:, None, None]


def time_text(rest: FitResiduals, place: float) -> str:
    """Text of a time, from the index of a record and the elapsed fraction of it."""
    t = np.concatenate([record.times - record.start for record in rest.records])
    k = min(int(np.searchsorted(progress(rest).ravel(), place)), len(t) - 1)
    name = f" of record {int(place) + 1}" if len(rest.records) > 1 else ""
    return f"{seconds(t[k])} s{name}"


def starts(rest: FitResiduals) -> tuple[list[str], Array]:
    """Candidate times of a change as texts, and the rows from then on, shape (times, rows)."""
    place = progress(rest).ravel()
    edges = np.quantile(place, np.linspace(0, 1, thresholds.PLACES + 2)[1:-1])
    return [time_text(rest, start) for start in edges], place >= edges[:, None]


def payloads(rest: FitResiduals) -> Iterator[Hypothesis]:
    """Hypotheses on a change of the last body from some time on; of other bodies if residuals are large."""
    names, nb, (times, masks) = rest.robot.model.moving_joints, rest.robot.model.nb, starts(rest)
    first = 0 if rest.share > thresholds.SEEN else nb - 1
    bodies = rest.Y[..., PARAMETERS * first : PARAMETERS * nb]

    def text(c: Array, k: int, m: int) -> str:
        body = bodies[..., PARAMETERS * k : PARAMETERS * (k + 1)]
        mass, most = (float(np.abs(x).max(initial=0.0)) for x in (body[..., 0], body))
        if first + k < nb - 1 or mass <= thresholds.NOTHING * most:  # torques may not depend on its mass
            return f"the load on the link distal to {names[first + k]} changes near {times[m]}"
        return f"the payload changes by {c[0]:.3g} kg near {times[m]}"

    many = thresholds.PLACES * np.arange(nb - first, 0, -1)
    yield Hypothesis(LOAD, bodies, text, names[first:nb], alternatives=many, numbers="each", masks=masks)


def contacts(rest: FitResiduals) -> Iterator[Hypothesis]:
    """Hypotheses on a temporary force on the last link."""
    model, place, count = rest.robot.model, progress(rest).ravel(), 2 * thresholds.PLACES
    link = [name for name, k in zip(model.link_names, model.link_body, strict=True) if k == model.nb - 1][-1]
    force = rest.sampled(lambda q, qd, qdd: np.swapaxes(rest.robot.jacobian(q, link)[..., 3:, :], -1, -2))
    edges = np.quantile(place, np.linspace(0, 1, count + 1))
    spans = [(a, a + width) for a in range(count) for width in thresholds.WIDTHS if a + width <= count]

    def text(c: Array, j: int, m: int) -> str:
        begin, end = (time_text(rest, edges[k]) for k in spans[m])
        return f"something pushes {link} with {float(np.linalg.norm(c)):.3g} N from {begin} to {end}"

    masks = np.array([(edges[a] <= place) & (place <= edges[b]) for a, b in spans])
    many = count * len(thresholds.WIDTHS)
    yield Hypothesis("contact", force, text, rest.names[-1:], alternatives=many, masks=masks)


# Changes between records without and with a load


def changes_with_load(rest: FitResiduals, known: Array, loaded: Array, body: int) -> list[Cause]:
    """Significant changes shown by the residuals of all records, the likeliest first, each given the others.

    Torques of the loads, and friction of healthy gears, are `known` columns. Rows with the load are `loaded`, shape
    (rows, 1, 1), and have the parameters of `rest`; the load is on the body with index `body`. The correlation time is
    taken from the residuals with all changes fitted.
    """
    speeds = rest.of_each_joint(lambda q, qd, qdd: qd), rest.of_each_joint(lambda q, qd, qdd: np.sign(qd))
    options = [replace(h, columns=columns_of(rest, h) * loaded) for h in hypotheses_with_load(rest, body)]
    own = np.concatenate([known, *(speed * loaded for speed in speeds)], axis=-1)
    values, found = np.zeros(rest.tau.shape), []
    values[rest.used] = rest.with_columns(np.concatenate([own, *(columns_of(rest, h) for h in options)], axis=-1))[2]
    time = rest.data.correlation_time(values, rest.used)
    left = FitResiduals(rest.robot, rest.base, rest.data, rest.beta, rest.sigma, time, own)
    while options:
        tried = [next(judged(left, h, by_rank=True)) for h in options]  # bodies share some numbers
        k = int(np.argmax([cause.score for cause, *_ in tried]))
        cause, columns, _ = tried[k]
        if cause.score <= thresholds.EVIDENT:
            break
        del options[k]
        if matters(*held_out_ratio(of_columns(columns, False, left))):
            found.append(cause)
        left = left.with_known(columns)
    return found


def hypotheses_with_load(rest: FitResiduals, body: int) -> Iterator[Hypothesis]:
    """Hypotheses on gravity, zeros, factors and offsets of torques, and bodies without the load."""
    families = [h for h in joints(rest) if h.kind in (GAIN, "joint zero")]
    tilts = [h for h in other_gravity(rest) if h.kind == DIRECTION]
    offset = of_each(rest, "the torque of {joint} is {size:.3g} {torque} larger")
    ones = by_joint(np.ones((*rest.tau.shape, 1)))
    families.append(Hypothesis("offset", ones, offset, rest.names, numbers="each"))
    tilts = [replace(h, columns=columns_of(rest, h)[..., :2]) for h in tilts]  # without other bodies
    for h in (*tilts, *one_by_one(rest, families)):

        def text(c: Array, h: Hypothesis = h) -> str:
            return f"{text_of(h, c)} with the load, not without it"

        yield replace(h, text=text)
    model = rest.robot.model
    for i in (i for i in range(model.nb) if i != body):
        link = model.link_names[list(model.link_body).index(i)]
        other = f"the body of {link} is another one with the load: is a load there, or was the arm changed?"
        columns = rest.Y[..., PARAMETERS * i : PARAMETERS * (i + 1)]
        yield Hypothesis("body", columns, other, model.moving_joints[i : i + 1])


# Changes that are fitted again


def friction_power(rest: FitResiduals) -> tuple[Array, Array]:
    """Mean power dissipated by friction in each joint, with standard error, shape (n,) each [W]; 0 without friction."""
    n, each = rest.robot.n, np.zeros((rest.robot.n, rest.standard.count))
    for symbol, exponent in (("Fv", 2), ("Fc", 1)):
        if symbol in rest.standard.groups:
            size = np.mean([(np.abs(record.qd) ** exponent).mean(0) for record in rest.records], axis=0)
            each[range(n), rest.standard.groups[symbol].start + np.arange(n)] = size
    R = rest.Q.T @ rest.A
    apart = np.linalg.lstsq(R.T, (each @ rest.base.back).T, rcond=thresholds.DEPENDENT)[0]
    return each @ rest.x, np.sqrt(rest.correlation) * np.linalg.norm(apart, axis=0)


def dissipates(rest: FitResiduals) -> Array:
    """True for joints whose friction dissipates, as with the right sign of torque; False where none is modelled."""
    return np.asarray(friction_power(rest)[0] > 0)


def powered(rest: FitResiduals) -> Iterator[tuple[Cause, None]]:
    """Causes of torques with the wrong sign that leave no residual, as negative friction compensates them."""
    (power, error), v = friction_power(rest), np.concatenate([record.reduce(record.qd) for record in rest.records])
    work = np.abs(rest.tau * v).mean(0)
    is_explained = rest.squares < thresholds.EXPLAINED**2 * rest.torques  # otherwise anything may come out negative
    is_driven = (power < -thresholds.IMPOSSIBLY * error) & (power < -thresholds.LITTLE * work)
    for j in np.flatnonzero(is_explained & is_driven & (rest.counts > 0)).tolist():
        text = f"the torque of {rest.names[j]} has the wrong sign, or is not its drive's: its friction gives power"
        score = float(rest.counts.sum())
        yield Cause("torque sign", rest.names[j : j + 1], f"{text} ({MENDED_BY['torque sign']})", score), None


def other_conventions(rest: FitResiduals, beyond: FitResiduals) -> Iterator[tuple[Cause, Trial]]:
    """Causes of other signs and orders of torques; of joints, couplings and degrees if the residual exceeds noise.

    Joints are J q, and their torques T tau.
    """
    names, turns, unit, left = rest.names, turning(rest.robot), np.eye(rest.robot.n), beyond.coarse
    odd, moved = odd_joints(rest), max(np.ptp(record.q[:, turns], axis=0).max(initial=0) for record in rest.records)
    kinds = ["torque sign", "torque order", *["joint order", "axis flipped"] * bool(odd)]
    kinds += ["angle unit"] * bool(odd and moved > 1)
    allowed = {"torque sign": ~dissipates(rest), "torque order": rest.counts > 0, "joint order": rest.counts > 0}

    def squares(J: Array, T: Array) -> Array:
        tau = rest.tau @ T.T
        return left.torques * left.refitted(left.moved(J, tau), tau)[2]

    before = squares(unit, unit)

    def gain(J: Array, T: Array) -> float:
        least = left.torques * (thresholds.ODD**2 if (unit != J).any() else 0)  # as of `of_convention`
        return left.gain(np.maximum(squares(J, T), least), np.maximum(before, least))

    for x in conventions(rest.robot, kinds, single=True):
        J, T = x.matrices(turns)
        which = np.flatnonzero((unit != J).any(1) | (unit != T).any(1)).tolist()
        if allowed.get(x.kind, rest.counts >= 0)[which].all() and (score := gain(J, T)) > thresholds.EVIDENT:
            kind, text = IN_LOGS[x.kind]
            concerned = names if x.kind == "angle unit" else tuple(names[j] for j in which)
            yield Cause(kind, concerned, text.format(*concerned), score), partial(of_convention, J, T)
    for j in [j for j in odd if j][: thresholds.TURNED_ALONG]:
        yield from couplings(rest, j, gain)


def odd_joints(rest: FitResiduals) -> list[int]:
    """Joints whose residual beyond gear friction exceeds noise, the largest share first."""
    left = rest.beyond_friction
    share, noise = np.sqrt(left.squares / left.torques), noise_shares(rest.records, 0.0)
    odd = share > np.maximum(thresholds.ABOVE_NOISE * noise, thresholds.ODD)
    return [j for j in np.argsort(-share).tolist() if odd[j] and rest.counts[j]]


def couplings(rest: FitResiduals, j: int, gain: Callable[[Array, Array], float]) -> Iterator[tuple[Cause, Trial]]:
    """Causes of motors that also turn with the joint before, by any ratio: in positions, with or without torques."""
    from scipy.optimize import minimize_scalar

    motors, unit, (name, other) = rest.standard.motors != 0, np.eye(rest.robot.n), (rest.names[j], rest.names[j - 1])
    left = rest.beyond_friction
    others = np.delete(np.sqrt(left.squares / left.torques), [j, j - 1])
    unexplained = others > thresholds.UNEXPLAINED
    if (motors[:, j] & motors[:, j - 1]).any() or 2 * unexplained.sum() > len(others):  # known, or another robot
        return
    step = np.outer(unit[j], unit[j - 1])

    def fitted(k: float, of_torques: bool) -> float:  # positions taken as the motors' positions
        return gain(unit - k * step, unit + k * of_torques * step.T)

    def nearest(start: float, of_torques: bool) -> float:
        return float(start * minimize_scalar(lambda x: -fitted(x * start, of_torques), **thresholds.COUPLING_SEARCH).x)

    start = max((sign * k for sign in (1, -1) for k in thresholds.COUPLINGS), key=lambda k: fitted(k, False))
    k = nearest(start, False)
    if of_torques := fitted(k, True) > fitted(k, False):
        k = nearest(k, True)
    text = f"the motor of {name} turns with {other} too, {k:.3g} times: a coupling is missing"
    if not of_torques:
        text += f" in its positions, not in the torques (subtract {k:.3g} times the positions of {other})"
    score = fitted(k, of_torques) - rest.penalty(1)
    change = partial(of_convention, unit - k * step, unit + k * of_torques * step.T)
    yield Cause("coupling", (other, name), text, score, k), change


def of_convention(J: Array, T: Array, rest: FitResiduals) -> tuple[Array, ...]:
    """Validation errors of the measured torques with joints q, and with joints J q and torques T tau."""
    left = rest.coarse
    shares = left.held_out_as_given, left.held_out_moved(J, rest.tau @ T.T)
    errors = [np.maximum(x, thresholds.ODD**2 / len(x)) for x in shares]  # steps of friction are wrong by this much
    return errors[0], errors[1][:, np.argmax(np.abs(T) + np.eye(len(T)) / 2, axis=0)]


def torque_scale(rest: FitResiduals) -> Iterator[tuple[Cause, None]]:
    """Causes of torques many times larger or smaller than the given bodies need, or of the opposite sign.

    What drives can explain is removed first: rotors, friction and offsets, which resemble the weight of an arm that
    hardly moves. Torques of single joints are also compared with their offsets, torques of all joints as fitted.
    """
    (factors, cosines), (factor, cosine) = torque_factors(rest)
    alike = cosines > thresholds.ALIKE
    usual = np.median(factors[alike]) if alike.any() else 1.0
    odd = alike & (np.abs(np.log(np.where(alike, factors, usual) / usual)) > thresholds.UNIT)
    certain = float(rest.counts.sum())
    for j in np.flatnonzero(odd).tolist():
        what = f"{factors[j]:.3g} times that of the robot given"
        text = f"the torque of {rest.names[j]} is {what}: N mm, mA, at the motor, or is a mass given wrong?"
        yield Cause("torque unit", rest.names[j : j + 1], text, certain, factors[j]), None
    if not odd.any() and cosine >= thresholds.ALIKE and not 1 / thresholds.FACTOR < factor < thresholds.FACTOR:
        yield scale_of_all(rest, factor), None


def torque_factors(rest: FitResiduals) -> tuple[tuple[Array, Array], tuple[float, float]]:
    """Factors of torques relative to the given robot, with squared cosines: of each joint, signed, and of all.

    What drives may explain is left out of both. A single joint's factor is found with offsets if its torque then
    resembles the robot's.
    """
    bodies, drives = len(rest.bodies), rest.Y[..., len(rest.bodies) :]
    is_offset = np.array([name.startswith("tau0") for name in rest.standard.names[bodies:]], bool)
    moved = [rest.of_each_joint(OF_JOINTS[kind][1]) for kind in ("rotor", "viscous friction", "Coulomb friction")]
    torques = [rest.weighted(rest.Y[..., :bodies] @ x[:bodies]) for x in (rest.x, rest.standard.values)]
    torques.insert(0, rest.weighted(rest.tau))
    with_offsets = orthonormal(rest.weighted(np.concatenate([*moved, drives[..., ~is_offset]], axis=-1)))
    without = extended(with_offsets, rest.weighted(drives[..., is_offset]))

    def factor(tau: Array, given: Array, total: Callable[[Array, Array], Any]) -> tuple[Any, Any]:
        both, size = total(tau, given), np.maximum(total(given, given), thresholds.TINY)
        return both / size, both * np.abs(both) / size / np.maximum(total(tau, tau), thresholds.TINY)

    (tau, _, given), (least, found, bare) = ([x - Q @ (Q.T @ x) for x in torques] for Q in (with_offsets, without))
    first, second = factor(tau, given, rest.by_joint), factor(least, bare, rest.by_joint)
    each = np.where(second[1] > thresholds.ALIKE, second, first)
    whole, cosine = factor(found, bare, lambda a, b: float(a @ b))
    return (each[0], each[1]), (float(whole), abs(float(cosine)))


def scale_of_all(rest: FitResiduals, factor: float) -> Cause:
    """Cause of torques that are a multiple of the given robot's in all joints."""
    kind, text = "torque unit", f"torques are {factor:.3g} times those of the robot given: N mm, mA, or at the motors?"
    certain = float(rest.counts.sum())
    score = certain if rest.share < thresholds.POOR else 2 * thresholds.EVIDENT  # a failed fit determines no factor
    if factor < 0:
        kind, text = "torque sign", "the torques of all joints have the wrong sign"
        if friction_power(rest)[0].sum() < 0:  # evidence too, and faster than the residuals
            score = certain * float(np.log(1 / thresholds.LEAST))
    return Cause(kind, rest.names, text, score, factor)


class Gravity:
    """Fit of torques as a function of gravity, in units of the model's magnitude, at some of the rows."""

    def __init__(self, rest: FitResiduals) -> None:
        model, self.rest, count = rest.robot.model, rest.coarse, len(rest.bodies)
        size = float(np.linalg.norm(model.gravity))
        self.given = model.gravity / size
        pulls = self.rest.near_rows(lambda q, qd, qdd: gravity_torques(model, q, np.eye(count)))
        self.pulls = size * np.moveaxis(pulls, 2, 0)
        self.still = rest.Y[..., :count] - np.tensordot(self.given, self.pulls, 1)
        self.tau, self.drives = self.rest.weighted(rest.tau), self.rest.weighted(rest.Y[..., count:])

    def bodies(self, gravity: Array) -> Array:
        """Columns of the bodies' parameters that torques depend on under a gravity vector, shape (R, 10 nb)."""
        return self.rest.weighted(self.still + np.tensordot(gravity, self.pulls, 1))

    def squares(self, gravity: Array) -> Array:
        """Sum of squares of each joint's residual, shape (n,)."""
        X = np.concatenate([self.bodies(gravity), self.drives], axis=1)
        lengths = np.linalg.norm(X, axis=0)
        X = X / np.maximum(lengths, thresholds.NOTHING * lengths.max())  # dependent columns, without what is rounding
        whole = X.T @ X + thresholds.DEPENDENT * np.eye(len(lengths))
        return self.rest.by_joint(self.tau - X @ np.linalg.solve(whole, X.T @ self.tau))

    def loss(self, gravity: Array) -> float:
        """Negative log likelihood; prefers gravity near the model's among equally good fits."""
        turned = float(((gravity - self.given) ** 2).sum())
        return thresholds.KEPT * turned - self.rest.gain(self.squares(gravity))

    def start(self) -> Array:
        """Best of the model's gravity, the axes, and sums of both, as a start."""
        axes = [s * e for e in np.eye(3) for s in (1, -1)]
        return min((x for x in (self.given, *axes, *(self.given + x for x in axes)) if x.any()), key=self.loss)

    def best(self) -> Array:
        """Best-fitting gravity vector (Nelder and Mead 1965)."""
        from scipy.optimize import minimize

        start = self.start()
        options = thresholds.GRAVITY_SEARCH | {"initial_simplex": start + thresholds.TILT * np.eye(4, 3, -1)}
        return np.asarray(minimize(self.loss, start, method="Nelder-Mead", options=options).x)

    def held_out(self, gravity: Array) -> Array:
        """Validation errors, see `FitResiduals.held_out`."""
        Q = extended(orthonormal(self.drives), self.bodies(gravity))
        return self.rest.held_out(Q, self.tau, self.rest.blocks)


def gravity_directions(rest: FitResiduals) -> Iterator[tuple[Cause, Trial]]:
    """Causes of gravity with another direction and any magnitude, by the best fit."""
    if not rest.robot.model.gravity.any() or not (rest.share > thresholds.POOR or odd_joints(rest)):
        return
    fit = Gravity(rest)
    given, found = fit.given, fit.best()
    length, angle = float(np.linalg.norm(found)), angle_between(found, given)
    kind, text, value = DIRECTION, direction_text(found, given), angle
    if angle <= thresholds.TURNED:
        if abs(length - 1) <= thresholds.SCALED:
            return
        kind, text, value = SIZE, size_text(length), length
    score = fit.rest.gain(fit.squares(found), fit.squares(given)) - rest.penalty(3)
    yield Cause(kind, (), text, score, value), lambda _: (fit.held_out(given), fit.held_out(found))
