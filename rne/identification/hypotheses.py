"""A hypothesis on how two models differ, the fit of its free numbers, and those that torques are linear in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import comb

import numpy as np

from ..basics.spatial import Array
from ..basics.text import listed, six_digits
from ..model.parameters import PARAMETERS, parameters_of
from .evidence import Evidence

RANK = 1e-9  # singular values below this part of the largest, of columns of unit length, are rounding
PAIR = " and "  # between the causes of a pair
NEAR = 0.2  # distance of a fitted coefficient from a named one at which that is tried


@dataclass(frozen=True, eq=False)
class Candidate:
    """A hypothesis on the difference between two models, of `ModelComparison.candidates`.

    Attributes
    ----------
    causes : tuple of str
        One cause, or two that act together.
    text : str
        What it says of the other model.
    numbers : int
        Free numbers that were fitted.
    alternatives : float
        How many hypotheses it was chosen from.
    residual : ndarray, shape (R, n)
        Torques that it does not explain [N m or N].
    score : float
        Smaller is better.
    explains : bool
        True if no joint's residual is above rounding or noise.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> best = rne.compare_models(robot, robot.with_payload(3.0)).candidates[0]
    >>> best.causes, best.numbers, best.explains
    (('payload',), 4, True)
    """

    causes: tuple[str, ...]
    text: str
    numbers: int
    alternatives: float
    residual: Array
    score: float
    explains: bool

    @classmethod
    def of(
        cls, evidence: Evidence, causes: tuple[str, ...], text: str, numbers: int, alternatives: float, residual: Array
    ) -> Candidate:
        score = evidence.score(residual, numbers, alternatives)
        return cls(causes, text, numbers, alternatives, residual, score, evidence.explains(residual))

    def followed_by(self, evidence: Evidence, other: Candidate) -> Candidate:
        """Both together; the other was fitted to what this one leaves."""
        causes, text = (*self.causes, *other.causes), f"{self.text}; {other.text}"
        numbers, alternatives = self.numbers + other.numbers, self.alternatives * other.alternatives
        return Candidate.of(evidence, causes, text, numbers, alternatives, other.residual)


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients of columns, and how many of them are free."""

    coefficients: Array
    rank: int


class Fitter:
    """Least squares of one residual by the columns of one group."""

    def __init__(self, evidence: Evidence, group: Group, difference: Array) -> None:
        self.evidence, self.group, self.difference = evidence, group, difference
        self.A = evidence.weighted(group.columns)
        self.b = evidence.weighted(difference)
        self.lengths = np.linalg.norm(self.A, axis=0)

    def fit(self, kept: Array) -> Fit:
        """Coefficients of the columns chosen; the others are zero."""
        kept = kept[self.lengths[kept] > 0]
        coefficients = np.zeros(self.A.shape[1])
        if not len(kept):
            return Fit(coefficients, 0)
        scaled = self.A[:, kept] / self.lengths[kept]
        found, _, rank, _ = np.linalg.lstsq(scaled, self.b, rcond=RANK)
        coefficients[kept] = found / self.lengths[kept]
        return Fit(coefficients, int(rank))

    def candidate(self, fit: Fit, kept: int) -> Candidate:
        """The hypothesis that a fit makes; `kept` columns were chosen among those of the group."""
        alternatives = self.group.alternatives * (comb(self.A.shape[1], kept) if self.group.prune else 1)
        c = fit.coefficients
        return self._made(tuple(self.group.cause.split(PAIR)), self.group.text(c), fit.rank, alternatives, c)

    def _made(self, causes: tuple[str, ...], text: str, numbers: int, alternatives: float, c: Array) -> Candidate:
        return Candidate.of(
            self.evidence, causes, text, numbers, alternatives, self.difference - self.group.columns @ c
        )

    def pruned(self) -> Candidate:
        """The best fit with as few columns as possible: those that matter least are left out one after another."""
        kept = np.arange(self.A.shape[1])
        best = self.candidate(self.fit(kept), len(kept))
        while self.group.prune and len(kept) > 1:
            fit = self.fit(kept)
            sizes = np.abs(fit.coefficients[kept]) * self.lengths[kept]
            kept = np.delete(kept, int(np.argmin(sizes)))
            candidate = self.candidate(self.fit(kept), len(kept))
            if candidate.score < best.score or (candidate.explains and not best.explains):
                best = candidate
        return best

    def named(self) -> list[Candidate]:
        """Hypotheses without free numbers."""
        found = [
            self._made((named.cause,), named.text, 0, named.alternatives, named.values) for named in self.group.named
        ]
        for value in self.group.values:
            full = self.fit(np.arange(self.A.shape[1])).coefficients
            c = np.where(np.abs(full / value - 1) < NEAR, value, 0.0)
            chosen = int(np.count_nonzero(c))
            if chosen:
                alternatives = self.group.alternatives * comb(len(c), chosen)
                found.append(self._made((self.group.cause,), self.group.text(c), 0, alternatives, c))
        return found

    def best(self) -> list[Candidate]:
        """All hypotheses of the group: with and without free numbers."""
        free = [] if self.group.values else [self.pruned()]
        return [*self.named(), *free]


def joint_group(first: Group, second: Group) -> Group:
    """Two causes at once."""
    columns = np.concatenate([first.columns, second.columns], axis=-1)
    k = first.columns.shape[-1]

    def text(c: Array) -> str:
        return f"{first.text(c[:k])}; {second.text(c[k:])}"

    return Group(f"{first.cause}{PAIR}{second.cause}", columns, text, prune=False)


Text = Callable[[Array], str]
NONE = 1e-9  # a coefficient that is rounding
MILLI = 1000.0  # N mm in one N m


@dataclass(frozen=True, eq=False)
class Named:
    """Coefficients that need no free number, and what they mean."""

    values: Array
    text: str
    cause: str
    alternatives: float


@dataclass(frozen=True, eq=False)
class Group:
    """One cause: coefficients of columns, shape (R, n, k)."""

    cause: str
    columns: Array
    text: Text
    named: tuple[Named, ...] = field(default=())
    prune: bool = True  # coefficients that are not needed are dropped
    alternatives: float = 1.0
    values: tuple[float, ...] = ()  # of single coefficients that need no free number, such as 1 of 0 or 1


def groups(evidence: Evidence) -> list[Group]:
    """All of them, the plainest first."""
    return [*gravity(evidence), *gains(evidence), *drives(evidence), *inertias(evidence), *bodies(evidence)]


def gravity(evidence: Evidence) -> list[Group]:
    """Sign, magnitude and direction."""
    g = evidence.robot.model.gravity
    size = float(np.linalg.norm(g)) or 9.81
    found = []
    if g.any():
        along = (evidence.gravity @ g)[..., None]
        named = (
            Named(np.array([-2.0]), "gravity has the opposite sign", "gravity sign", 1),
            Named(np.array([-1.0]), "it has no gravity", "gravity missing", 1),
        )
        found.append(
            Group("gravity magnitude", along, lambda c: f"gravity is {1 + c[0]:.6g} times this robot's", named)
        )
    cardinal = [size * s * e for e in np.eye(3) for s in (1, -1)]
    turned = tuple(
        Named(h - g, f"the base is turned: gravity is {_vector(h)} m/s^2", "base turned", 6)
        for h in cardinal
        if not np.allclose(np.cross(h, g), 0) or not g.any()
    )
    text = f"gravity is %s m/s^2 in the axes of the base, {_vector(g)} m/s^2 in this robot"
    found.append(Group("base turned", evidence.gravity, lambda c: text % _vector(g + c), turned, prune=False))
    return found


def _vector(x: Array) -> str:
    return "(" + ", ".join(f"{round(float(v), 9) + 0.0:.4g}" for v in x) + ")"


def gains(evidence: Evidence) -> list[Group]:
    """Torques in another unit or of the opposite sign, of all joints and of single ones."""
    n, names, own = evidence.robot.n, evidence.robot.joint_names, evidence.expected
    all_named = tuple(
        Named(np.array([factor - 1]), text, cause, 3)
        for factor, text, cause in (
            (-1.0, "torques of all joints have the opposite sign", "torque sign"),
            (MILLI, "torques are in N mm", "torque unit"),
            (1 / MILLI, "torques are in kN m", "torque unit"),
        )
    )

    def one(c: Array) -> str:
        return "torques are " + listed([f"{1 + x:.6g} times in {names[j]}" for j, x in enumerate(c) if abs(x) > NONE])

    single = np.eye(n) * own[..., None]
    return [
        Group("torque unit", own[..., None], lambda c: f"torques are {1 + c[0]:.6g} times this robot's", all_named),
        Group("torque sign", single, one, prune=True, values=(-2.0,)),
        Group("torque factor", single, one),
    ]


def drives(evidence: Evidence) -> list[Group]:
    """Rotors, friction and offsets."""
    words = {
        "Ia": ("armature", "inertia of rotors (armature)"),
        "Fv": ("viscous friction", "viscous friction"),
        "Fc": ("Coulomb friction", "Coulomb friction"),
        "tau0": ("torque offset", "constant torque"),
    }
    found = [_drive_group(evidence, (symbol,), *words[symbol]) for symbol in words]
    found[0] = _with_armature(evidence, found[0])
    found.append(_drive_group(evidence, ("Fv", "Fc"), "friction", "viscous and Coulomb friction"))
    return found


def _drive_group(evidence: Evidence, symbols: tuple[str, ...], cause: str, what: str) -> Group:
    standard, names = evidence.standard, evidence.robot.joint_names
    columns = np.concatenate([evidence.columns[..., standard.groups[s]] for s in symbols], axis=-1)
    labels = [f"{names[j]} {s}" if len(symbols) > 1 else names[j] for s in symbols for j in range(len(names))]

    def text(c: Array) -> str:
        parts = [f"{label} {six_digits(x)}" for label, x in zip(labels, c, strict=True) if abs(x) > NONE]
        return f"it has more {what}: {listed(parts)}"

    return Group(cause, columns, text)


def _with_armature(evidence: Evidence, group: Group) -> Group:
    own = evidence.standard.values[evidence.standard.groups["Ia"]]
    if not own.any():
        return group
    named = (Named(-own, "it lacks the inertia of this robot's rotors (armature)", "armature", 1),)
    return Group(group.cause, group.columns, group.text, named)


def inertias(evidence: Evidence) -> list[Group]:
    """Inertias about another point, or with other products: a coefficient is 1 for a body to which it applies."""
    model = evidence.robot.model
    pi = parameters_of(model).reshape(-1, PARAMETERS)
    centred = pi[:, 4:].copy()
    steiner = np.zeros_like(pi)
    mass = np.where(pi[:, 0] == 0, 1.0, pi[:, 0])[:, None]
    x, y, z = (pi[:, 1:4] / mass).T
    steiner[:, 4:] = pi[:, :1] * np.stack([y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y], axis=1)
    centred -= steiner[:, 4:]
    products = np.zeros_like(pi)
    products[:, [5, 7, 8]] = centred[:, [1, 3, 4]]
    about_joint = np.zeros_like(pi)
    about_joint[:, [5, 7, 8]] = pi[:, [5, 7, 8]]
    kinds = [
        ("inertia point", steiner, "the inertia about the joint is taken as one about the centre of mass"),
        ("inertia point", -steiner, "the inertia about the centre of mass is taken as one about the joint"),
        ("inertia point", -2 * steiner, "the parallel-axis term has the wrong sign"),
        ("products of inertia", -2 * products, "products of inertia about the centre of mass have the opposite sign"),
        ("products of inertia", -products, "products of inertia about the centre of mass are missing"),
        ("products of inertia", -2 * about_joint, "products of inertia about the joint have the opposite sign"),
    ]
    return [_inertia_group(evidence, *kind) for kind in kinds]


def _inertia_group(evidence: Evidence, cause: str, change: Array, what: str) -> Group:
    nb, names = len(change), evidence.robot.model.moving_joints
    blocks = [evidence.columns[..., PARAMETERS * i : PARAMETERS * (i + 1)] @ change[i] for i in range(nb)]
    columns = np.stack(blocks, axis=-1)

    def text(c: Array) -> str:
        chosen = [names[i] for i in np.flatnonzero(c)]
        return f"{what}, body of {listed(chosen)}"

    every = Named(np.ones(nb), f"{what}, all bodies", cause, 6)
    one = [Named(np.eye(nb)[i], text(np.eye(nb)[i]), cause, 6 * nb) for i in range(nb)]
    return Group(cause, columns, text, (every, *one), values=(1.0,), alternatives=6)


def bodies(evidence: Evidence) -> list[Group]:
    """Other parameters of one body, or of all."""
    model = evidence.robot.model
    tips = [i for i in range(model.nb) if i not in model.parent]
    found = []
    for i in range(model.nb):
        name = model.moving_joints[i]
        columns = evidence.columns[..., PARAMETERS * i : PARAMETERS * (i + 1)]
        cause = "payload" if i in tips else "one body"
        text = _tip_text(name) if i in tips else _constant(f"the body of {name} has other inertial parameters")
        found.append(Group(cause, columns, text, prune=False, alternatives=len(tips) if i in tips else model.nb))
    every = evidence.columns[..., : PARAMETERS * model.nb]
    text = _constant("several bodies have other inertial parameters; joints and their places are the same")
    return [*found, Group("several bodies", every, text, prune=False)]


def _constant(text: str) -> Text:
    return lambda c: text


def _tip_text(name: str) -> Text:
    def text(c: Array) -> str:
        mass = float(c[0])
        if not abs(mass) > 0:
            return f"the last body, of {name}, has other inertial parameters"
        centre = _vector(c[1:4] / mass)
        what = "carries a payload of" if mass > 0 else "lacks a payload of"
        return f"the last body, of {name}, {what} {abs(mass):.4g} kg with its centre at {centre} m of the joint's frame"

    return text
