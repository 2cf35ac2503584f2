"""The search through the hypotheses: each alone, and if none explains the difference, two at a time."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from math import comb

import numpy as np

from ...basics.spatial import Array
from .bodies import payloads, turned_inertias
from .candidate import NEAR, Candidate, Fitter, joint_group
from .conventions import Convention, Screen, families
from .evidence import Evidence
from .groups import Group, Named, groups
from .zeros import shifted_zeros

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
