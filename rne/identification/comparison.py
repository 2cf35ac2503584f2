"""The search through the hypotheses on how two models differ, each alone and then two at a time, and its result."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np

from ..basics.arrays import positive_number
from ..basics.spatial import Array
from ..basics.text import Row, aligned, short, wrapped
from ..robot import Robot, robot_argument
from .conventions import Convention, Screen, families, payloads, shifted_zeros, turned_inertias
from .evidence import TOLERANCE, Evidence, Other, measured_evidence, model_evidence, states_of
from .hypotheses import NEAR, Candidate, Fitter, Group, Named, groups, joint_group
from .record import Record

OTHER_BODIES = {"one body", "payload"}  # two of them are several bodies
DECISIVE = 10.0  # difference of scores that chance hardly makes (Kass and Raftery 1995)
LAST = "several bodies"  # explains whatever other bodies do: asked only after pairs of causes


def search(evidence: Evidence) -> list[Candidate]:
    """Hypotheses, the best first.

    Parameters
    ----------
    evidence : Evidence

    Returns
    -------
    list of Candidate
    """
    linear = groups(evidence)
    screens = {cause: Screen(evidence, family) for cause, family in families(evidence.robot).items() if family}
    found = list(single(evidence, linear, screens))
    if not any(c.explains and c.causes != (LAST,) for c in found):
        found += double(evidence, linear, screens)
    return ranked(evidence, found)


def ranked(evidence: Evidence, found: list[Candidate]) -> list[Candidate]:
    """The best first; with noise, of those nearly as good as the best the one with the fewest free numbers."""
    found = sorted(found, key=lambda c: (not c.explains, c.score))
    if evidence.exact or not found[0].explains:
        return found
    near = [c for c in found if c.explains and c.score <= found[0].score + DECISIVE]
    first = min(near, key=lambda c: (len(c.causes), c.numbers))
    return [first, *(c for c in found if c is not first)]


def single(evidence: Evidence, linear: list[Group], screens: dict[str, Screen]) -> Iterator[Candidate]:
    """One cause at a time."""
    for cause, screen in screens.items():
        for convention in screen.finalists():
            yield of_convention(evidence, cause, convention)
    for group in linear:
        yield from Fitter(evidence, group, evidence.difference).best()
    yield from shifted_zeros(evidence)
    yield from turned_inertias(evidence)
    yield from payloads(evidence)


def of_convention(evidence: Evidence, cause: str, convention: Convention) -> Candidate:
    """The hypothesis that another convention explains the difference."""
    residual = evidence.tau - convention_torques(evidence, convention)
    return Candidate.of(
        evidence, (cause,), convention.describe(), convention.numbers, convention.alternatives, residual
    )


def convention_torques(evidence: Evidence, convention: Convention) -> Array:
    """The robot's torques with another convention, filtered as the measured ones."""
    robot = evidence.robot
    return evidence.predict(lambda q, qd, qdd: convention.torques(robot, q, qd, qdd))


def double(evidence: Evidence, linear: list[Group], screens: dict[str, Screen]) -> Iterator[Candidate]:
    """Two causes at a time, of which at least one is linear in its free numbers."""
    free = [g for g in linear if g.cause != LAST and not g.values]
    for cause, screen in screens.items():
        for group in free:
            yield from of_both(evidence, cause, screen.finalists(group.columns)[0], group)
    for first, second in combinations(free, 2):
        if first.cause != second.cause and not {first.cause, second.cause} <= OTHER_BODIES:
            pair = Fitter(evidence, joint_group(first, second), evidence.difference).pruned()
            yield pair
            if pair.explains:
                yield from with_named(evidence, linear, first)
                yield from with_named(evidence, linear, second)


def of_both(evidence: Evidence, cause: str, convention: Convention, group: Group) -> Iterator[Candidate]:
    """A convention and a linear cause."""
    difference = evidence.tau - convention_torques(evidence, convention)
    first = of_convention(evidence, cause, convention)
    for second in Fitter(evidence, group, difference).best():
        yield first.followed_by(evidence, second)


def with_named(evidence: Evidence, linear: list[Group], group: Group) -> Iterator[Candidate]:
    """A cause that needs no free number, and a linear one."""
    for other in linear:
        if other.cause == group.cause:
            continue
        for named in (*other.named, *near_values(evidence, other, group)):
            left = evidence.difference - other.columns @ named.values
            first = Candidate.of(evidence, (named.cause,), named.text, 0, named.alternatives, left)
            for second in Fitter(evidence, group, left).best():
                yield first.followed_by(evidence, second)


def near_values(evidence: Evidence, other: Group, group: Group) -> Iterator[Named]:
    """Coefficients without free numbers that are near those of a fit together with another cause."""
    k = other.columns.shape[-1]
    fitter = Fitter(evidence, joint_group(other, group), evidence.difference)
    fitted = fitter.fit(np.arange(fitter.A.shape[1])).coefficients[:k] if other.values else np.zeros(k)
    for value in other.values:
        c = np.where(np.abs(fitted / value - 1) < NEAR, value, 0.0)
        if c.any():
            yield Named(c, other.text(c), other.cause, other.alternatives * comb(k, int(np.count_nonzero(c))))


SHOWN = 5
NONE, UNKNOWN = "none", "unknown"


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """The likely cause of a difference of torques, by `rne.compare_models`.

    Attributes
    ----------
    joint_names : tuple of str
    causes : tuple of str
        ("none",) if the torques agree, ("unknown",) if no hypothesis explains the difference; else one cause, or two
        that act together.
    text : str
        The cause in words, with its numbers: what the other model has.
    difference : ndarray, shape (n,)
        |tau - torques of the robot| / |tau| of each joint, tau being the other's or the measured ones.
    unexplained : ndarray, shape (n,)
        The same for what the cause leaves.
    accuracy : ndarray, shape (n,)
        Rounding that is allowed, or noise, as a part of |tau|.
    candidates : tuple of Candidate
        All hypotheses, the best first.
    equivalent : tuple of str
        Other causes that explain these torques as well, with as few free numbers.
    shares : tuple of float
        Of the difference, what each of `candidates` leaves.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> upside_down = lambda q, qd, qdd: robot.inverse_dynamics(q, qd, qdd) - 2 * robot.gravity_torque(q)
    >>> rne.compare_models(robot, upside_down).causes
    ('gravity sign',)
    """

    joint_names: tuple[str, ...]
    causes: tuple[str, ...]
    text: str
    difference: Array
    unexplained: Array
    accuracy: Array
    candidates: tuple[Candidate, ...]
    equivalent: tuple[str, ...]
    shares: tuple[float, ...]

    @property
    def cause(self) -> str:
        """The cause; of two that act together, both joined by "and"."""
        return " and ".join(self.causes)

    def __repr__(self) -> str:
        return wrapped(f"ModelComparison(cause: {self.cause}; {self.text})")

    def report(self) -> str:
        """The cause, a table of the joints, and what else was tried.

        Returns
        -------
        str
            Lines of at most 100 characters.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> print(rne.compare_models(robot, robot).report().splitlines()[0])
        cause: none
        """
        rows = [Row("|difference| / |torque| [%]", ("before", "explained so", "rounding or noise"), words=True)]
        for name, *cells in zip(self.joint_names, self.difference, self.unexplained, self.accuracy, strict=True):
            rows.append(Row(f"  {short(name)}", [f"{100 * x:.3g}" for x in cells]))
        lines = [f"cause: {self.cause}", *wrapped(f"  {self.text}").splitlines(), *aligned(rows)]
        if self.equivalent:
            lines.append("cannot be told apart from: " + "; ".join(self.equivalent))
        if self.candidates:
            lines.append("hypotheses (share of the difference that is left [%]; free numbers)")
            for c, share in zip(self.candidates[:SHOWN], self.shares, strict=False):
                lines += wrapped(f"  {100 * share:.3g}; {c.numbers}: {' and '.join(c.causes)}: {c.text}").splitlines()
        return "\n".join(lines)


def compare_models(
    robot: Robot,
    other: Other,
    *,
    tolerance: float = TOLERANCE,
    cutoff: float | None = None,
    seed: int = 0,
) -> ModelComparison:
    """Name the likely cause of a difference between a robot's torques and others.

    Each hypothesis of a list is a change of the robot with few free numbers. Those that explain the difference, in
    every joint, to rounding or noise are compared by their free numbers and the number of alternatives that they were
    chosen from: the one that needs fewest is named. Two hypotheses act together only where none alone explains it.

    Parameters
    ----------
    robot : Robot
        The model that is taken as right. Its joint friction is not part of its torques.
    other : Robot, callable, tuple of arrays, or Record
        Another robot with the same number of joints; a function (q, qd, qdd) -> torques of another library, for arrays
        of shape (N, n); numbers (q, qd, qdd, tau), shape (N, n) each; or a measured motion.
    tolerance : float
        Differences below this part of the torques of a joint are rounding; for a Record noise takes its place.
    cutoff : float, optional
        Of the filter of a Record, by default chosen from the measurements [Hz].
    seed : int
        Of the random states at which a robot or function is evaluated.

    Returns
    -------
    ModelComparison
        The cause, in a word and with its numbers, and what else was tried.

    Raises
    ------
    TypeError
        If `robot` or `other` is none of these.
    ValueError
        If an array has the wrong shape or is not finite, or there are fewer torques than standard
        parameters of the robot.

    Notes
    -----
    Hypotheses: gravity of another sign, magnitude or direction, or a turned base; joints in another order, with flipped
    axes, or with another zero; degrees for radians; torques in another unit or of another sign; inertia about another
    point or in other axes, products of inertia of the other sign; rotors, viscous or Coulomb friction, offsets; a
    payload, other parameters of one body or of several. The measure is the Bayesian information criterion (Schwarz
    1978), with log of the number of alternatives added. Measured torques are explained if no residual is above 1.3
    times the noise: that of torques and of positions, estimated from spectra above the filter's cut-off.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> other = rne.Robot(rne.model.with_payload(robot.model, 3.0, com=(0, 0, 0.1)))
    >>> print(rne.compare_models(robot, other).text)
    it carries a payload of 3 kg at (0, 0, 0.165) m of the frame of joint_6
    """
    robot_argument(robot)
    positive_number("tolerance", tolerance)
    if isinstance(other, Record):
        if other.n != robot.n:
            raise ValueError(f"`other` must be of {robot.n} joints, as the robot, got a record of {other.n}")
        return judged(measured_evidence(robot, other.prepare(cutoff)))
    return judged(model_evidence(robot, *states_of(robot, other, seed), tolerance))


def judged(evidence: Evidence) -> ModelComparison:
    """The cause, from all hypotheses."""
    difference = evidence.relative(evidence.difference)
    accuracy = evidence.relative(np.broadcast_to(evidence.sigma, evidence.tau.shape))
    if evidence.explains(evidence.difference):
        return _result(evidence, (NONE,), "the torques agree", difference, accuracy, [], ())
    found = search(evidence)
    if not found[0].explains:
        text = "no hypothesis explains the difference; the nearest are below"
        return _result(evidence, (UNKNOWN,), text, difference, accuracy, found, ())
    best = found[0]
    equals = [c for c in found[1:] if c.explains and c.numbers <= best.numbers and not _akin(c.causes, best.causes)]
    equivalent = tuple(dict.fromkeys(" and ".join(c.causes) for c in equals))
    return _result(evidence, best.causes, best.text, evidence.relative(best.residual), accuracy, found, equivalent)


def _akin(causes: tuple[str, ...], others: tuple[str, ...]) -> bool:
    """True if one names the other: friction and viscous friction."""
    return any(a in b or b in a for a in causes for b in others)


def _result(
    evidence: Evidence,
    causes: tuple[str, ...],
    text: str,
    unexplained: Array,
    accuracy: Array,
    found: list[Candidate],
    equivalent: tuple[str, ...],
) -> ModelComparison:
    size = float(np.linalg.norm(evidence.weighted(evidence.difference))) or 1.0
    shares = tuple(float(np.linalg.norm(evidence.weighted(c.residual))) / size for c in found)
    return ModelComparison(
        evidence.robot.joint_names,
        causes,
        text,
        evidence.relative(evidence.difference),
        unexplained,
        accuracy,
        tuple(found),
        equivalent,
        shares,
    )
