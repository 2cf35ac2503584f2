"""The likely cause of a difference between two models: each hypothesis alone, then two at a time, and the result."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np

from ..basics.arrays import positive_number
from ..basics.spatial import Array
from ..basics.text import Row, aligned, short, wrapped
from ..robot import Robot, robot_argument
from . import hypotheses
from .hypotheses import Convention, LinearCause
from .torque_difference import Candidate, Other, TorqueDifference, torque_difference

TOLERANCE = 1e-8  # of torques: two models that differ by less are the same
NEAR = 0.2  # distance of a fitted coefficient from 1 at which a switch is tried
FINALISTS = 3  # of many changes, those that a few states choose are looked at closely
OTHER_BODIES = {"one body", "payload"}  # two of them are several bodies
SHOWN = 5  # candidates in a report


class Family(NamedTuple):
    """Hypotheses without free numbers, and what each leaves of the difference in a few states."""

    alternatives: Sequence[float]
    left: Array  # in units of the rounding, shape (A, S n)
    candidate: Callable[[int], Candidate]

    def nearest(self, number: int, columns: Array | None = None) -> list[Candidate]:
        """Those that leave least, after a fit of columns, shape (S n, k); of equally good ones the plainest."""
        left = self.left
        if columns is not None:
            Q = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny))[0]
            left = left - (left @ Q) @ Q.T
        above_rounding = np.maximum((left**2).mean(1), 1.0)
        return [self.candidate(k) for k in np.lexsort((self.alternatives, above_rounding))[:number]]


class Search:
    """The hypotheses on a difference: alone, and in pairs of which at least one has free numbers."""

    def __init__(self, data: TorqueDifference) -> None:
        self.data = data
        linear = hypotheses.linear_causes(data)
        self.switches = [cause for cause in linear if cause.coefficients == "switches"]
        self.free = [cause for cause in linear if cause.coefficients != "switches"]
        found = hypotheses.conventions(data.robot).items()
        self.families = [self.of_conventions(cause, members) for cause, members in found if members]
        self.families.append(self.of_switches())

    def candidates(self) -> list[Candidate]:
        """All hypotheses, the best first; two at a time only where none alone explains the difference."""
        found = list(self.single())
        if not any(c.explains and c.causes != (hypotheses.SEVERAL_BODIES,) for c in found):
            found += self.double()
        return sorted(found, key=lambda c: (not c.explains, c.score))

    def of_conventions(self, cause: str, members: Sequence[Convention]) -> Family:
        """Conventions of a cause: their torques in a few states, and in all states of those that are asked for."""
        data = self.data
        states = data.q, data.qd, data.qdd
        torques = hypotheses.torques_of(members, *(x[data.few] for x in states))

        def candidate(k: int) -> Candidate:
            left = data.tau - hypotheses.torques_of([members[k]], *states)[0]
            return data.candidate(cause, members[k].text(), 0, members[k].alternatives, left)

        left = ((data.tau[data.few] - torques) / data.rounding).reshape(len(members), -1)
        return Family([c.alternatives for c in members], left, candidate)

    def of_switches(self) -> Family:
        """All switches of a cause together, and each alone."""
        members = []
        for cause in self.switches:
            n = cause.columns.shape[-1]
            members += [self.switched(cause, c) for c in np.unique([np.ones(n), *np.eye(n)], axis=0)]
        left = np.array([self.data.weighted(c.residual, self.data.few) for c in members])
        return Family([c.alternatives for c in members], left, members.__getitem__)

    def rounded(self, others: Array) -> Iterator[Candidate]:
        """Several switches of a cause: those whose coefficients, fitted together with other columns, are near 1."""
        for cause in self.switches:
            columns = np.concatenate([cause.columns, others], axis=-1)
            fitted = self.data.fit(columns, self.data.difference, self.data.few)[0]
            near = np.abs(fitted[: cause.columns.shape[-1]] - 1) < NEAR
            if near.sum() > 1:
                yield self.switched(cause, near.astype(float))

    def switched(self, cause: LinearCause, c: Array) -> Candidate:
        """The switches of a cause where c is 1."""
        alternatives = cause.alternatives * comb(len(c), np.count_nonzero(c))
        return self.data.candidate(cause.name, cause.text(c), 0, alternatives, self.data.difference - cause.columns @ c)

    def single(self) -> Iterator[Candidate]:
        """One cause at a time."""
        for family in self.families:
            yield from family.nearest(FINALISTS)
        yield from self.rounded(np.zeros((*self.data.tau.shape, 0)))
        yield from map(self.fitted, self.free)
        yield from hypotheses.shifted_zeros(self.data)
        yield from hypotheses.changes_of_one_body(self.data)

    def double(self) -> Iterator[Candidate]:
        """Two causes at a time, of which at least one has free numbers."""
        free = [cause for cause in self.free if cause.name != hypotheses.SEVERAL_BODIES]
        for cause in free:
            columns = self.data.weighted(cause.columns, self.data.few)
            nearest = [family.nearest(1, columns)[0] for family in self.families]
            for first in (*nearest, *self.rounded(cause.columns)):
                if first.causes != (cause.name,):
                    yield self.fitted(cause, first)
        for one, other in combinations(free, 2):
            if one.name != other.name and not {one.name, other.name} <= OTHER_BODIES:
                yield self.fitted_both(one, other)

    def fitted(self, cause: LinearCause, before: Candidate | None = None) -> Candidate:
        """A cause with free numbers, or as few of them as suffice, on top of a hypothesis."""
        data, n = self.data, cause.columns.shape[-1]
        torques = before.residual if before else data.difference
        best, kept = None, np.arange(n)
        while True:
            c, columns = np.zeros(n), cause.columns[..., kept]
            c[kept], rank = data.fit(columns, torques)
            alternatives = cause.alternatives * comb(n, len(kept))
            found = data.candidate(cause.name, cause.text(c), rank, alternatives, torques - cause.columns @ c, before)
            if best and not found.explains:
                return best
            best = found
            if cause.coefficients == "all" or len(kept) <= 1 or not found.explains:
                return best
            kept = np.delete(kept, np.argmin(np.abs(c[kept]) * np.linalg.norm(data.weighted(columns), axis=0)))

    def fitted_both(self, one: LinearCause, other: LinearCause) -> Candidate:
        """Two causes with free numbers."""
        data, k = self.data, one.columns.shape[-1]
        c, rank = data.fit(np.concatenate([one.columns, other.columns], axis=-1), data.difference)
        first = data.candidate(one.name, one.text(c[:k]), rank, 1, data.difference - one.columns @ c[:k])
        return data.candidate(other.name, other.text(c[k:]), 0, 1, first.residual - other.columns @ c[k:], first)


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
        |tau - torques of the robot| / |tau| of each joint, tau being the other's.
    unexplained : ndarray, shape (n,)
        The same for what the cause leaves.
    accuracy : ndarray, shape (n,)
        Rounding that is allowed, as a part of |tau|.
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
        """The cause; two that act together are joined by "and"."""
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
        rows = [Row("|difference| / |torque| [%]", ("before", "explained so", "rounding"), words=True)]
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


def compare_models(robot: Robot, other: Other, *, tolerance: float = TOLERANCE, seed: int = 0) -> ModelComparison:
    """Name the likely cause of a difference between a robot's torques and those of another model.

    Each hypothesis of a list is a change of the robot with few free numbers. Those that explain the difference, in
    every joint, to rounding are compared by their free numbers and the number of alternatives that they were chosen
    from: the one that needs fewest is named. Two hypotheses act together only where none alone explains it.

    Parameters
    ----------
    robot : Robot
        The model that is taken as right. Its joint friction is not part of its torques.
    other : Robot, callable, or tuple of arrays
        Another robot with the same number of joints; a function (q, qd, qdd) -> torques of another library, for arrays
        of shape (N, n); or its numbers (q, qd, qdd, tau), shape (N, n) each. Of measured motions, the report of
        `rne.identify` names likely causes.
    tolerance : float
        Differences below this part of the torques of a joint are rounding.
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
    1978), with log of the number of alternatives added.

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
    data = torque_difference(robot, other, tolerance, seed)
    if data.explains(data.difference):
        return _result(data, ("none",), "the torques agree", data.difference, [])
    found = Search(data).candidates()
    if not found[0].explains:
        text = "no hypothesis explains the difference; the nearest are below"
        return _result(data, ("unknown",), text, data.difference, found)
    return _result(data, found[0].causes, found[0].text, found[0].residual, found)


def _result(
    data: TorqueDifference, names: tuple[str, ...], text: str, residual: Array, found: list[Candidate]
) -> ModelComparison:
    """The result, with other causes that explain the torques with as few free numbers as the first."""
    fitting = [c for c in found if c.explains and c.numbers <= found[0].numbers]
    others = [c for c in fitting if not any(a in b or b in a for a in c.causes for b in names)]  # friction: viscous too
    size = float(np.linalg.norm(data.weighted(data.difference))) or 1.0
    return ModelComparison(
        data.robot.joint_names,
        names,
        text,
        data.relative(data.difference),
        data.relative(residual),
        data.relative(np.broadcast_to(data.rounding, data.tau.shape)),
        tuple(found),
        tuple(dict.fromkeys(" and ".join(c.causes) for c in others)),
        tuple(float(np.linalg.norm(data.weighted(c.residual))) / size for c in found),
    )
