"""The equations of motions without and with a load, and standard errors that contain the errors of drives.

Torques of real drives differ from Y pi by more than noise: gains are a little wrong, friction rises with the load or
changes between the records, offsets drift. Each kind of such errors has a column for each joint. Its coefficients are
random, with a variance that is estimated with the parameters by expectation and maximisation (Dempster, Laird and Rubin
1977; variance components, Searle, Casella and McCulloch 1992), so that the parameters' covariance contains them. Fits
to all blocks of time but one (the jackknife of Tukey 1958) tell of what varies otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..basics.text import InNotebooks, Row, aligned, wrapped
from ..dynamics.base_inertial_parameters import BaseParameters
from ..model.parameters import PARAMETERS, parameters_of_pseudo_inertia, pseudo_inertia
from ..model.standard_parameters import MEASURED, DriveModel, StandardParameters
from ..robot import Robot, robot_argument
from . import thresholds
from .diagnosis.hypotheses import Cause, likely_causes, merged_by_kind
from .diagnosis.residuals import TINY, FitResiduals
from .diagnosis.rigid_body_test import percent
from .fit.equations import (
    Equations,
    RegressionData,
    blocks_of_time,
    build_regression,
    checked_records,
    equations,
    joined,
    of_named_joints,
    solve,
    triangular,
    with_prior,
)
from .fit.least_squares import LeastSquares, believed_noise, least_squares
from .log.record import Record
from .result import Identification, likely_text, unexplained_text

KINDS = (
    "torque factors",
    "friction under load",
    "viscous friction that is not linear",
    "viscous friction that saturates",
    "friction by direction",
    "viscous friction that changed between the records",
    "Coulomb friction that changed between the records",
    "offsets that changed between the records",
    "offsets that drift",
)
CONTAINED = (
    "standard errors contain noise, the scatter between blocks of time, and what errors of the drives make of the "
    "load; not a factor common to all torques"
)


class TwoSetsFit(NamedTuple):
    """A fit with random errors of the drives; unknowns are base parameters, those of the load, changes of gains."""

    estimate: LeastSquares
    held_out: Array  # |predicted - measured| / |measured| of each joint in motion, on blocks that were not fitted
    load: Array  # triangular equations of the load's parameters alone
    notes: tuple[str, ...]  # on the records, and on what the errors contain


@dataclass(frozen=True, eq=False)
class TwoSets:
    """The equations of records without and with a load, of the same standard parameters pi.

    The load adds `known` + S phi to pi, of which phi is unknown.
    """

    robot: Robot
    base: BaseParameters
    without: RegressionData
    loaded: RegressionData
    S: Array  # shape (P, number of unknowns of the load)
    known: Array  # shape (P,)

    @property
    def both(self) -> tuple[RegressionData, RegressionData]:
        """The records without the load, and those with it."""
        return self.without, self.loaded

    @cached_property
    def plain(self) -> list[Equations]:
        """The equations of both sets, each in one block."""
        return [data.fitted.merged() for data in self.both]

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """Changes that would explain either set of records better, as of `rne.identify`."""
        found: list[Cause] = []
        for data in self.both:
            estimate = least_squares(data.fitted.mapped(self.base.back))
            found += likely_causes(FitResiduals(self.robot, self.base, data, estimate.values, estimate.sigma))[0]
        return merged_by_kind(sorted(found, key=lambda cause: -cause.score))

    def in_torques(self, gains: Array) -> TwoSets:
        """The equations of measurements times gains; joints whose gain is NaN have none."""
        return replace(self, without=self.without.in_torques(gains), loaded=self.loaded.in_torques(gains))

    def states(self, x: Array) -> tuple[Array, Array]:
        """Standard parameters without and with the load, of unknowns x."""
        pi = self.base.back @ x[: self.base.count]
        return pi, pi + self.known + self.S @ x[self.base.count : self.base.count + self.S.shape[1]]

    def assembled(self, parts: Sequence[Equations], at: Sequence[Array] = ()) -> Equations:
        """Equations Y (pi + S phi) + X c + Y at d = tau - Y known, for base parameters of pi, c, phi and d of joints.

        `parts` have columns Y, X of each set; S phi and `known` belong to the load. `at` are parameters of either set.
        """
        back, n = self.base.back, self.robot.n
        (P, K), f, joints = back.shape, self.S.shape[1], np.arange(n)
        k, found = parts[0].factors.shape[-1] - 1 - P, []
        for i, data in enumerate(parts):
            T = np.zeros((n, P + k + 1, K + k * n + f + n * bool(len(at)) + 1))
            T[:, :P, :K], T[:, :P, K + k * n : K + k * n + f] = back, i * self.S
            for kind in range(k):
                T[joints, P + kind, K + kind * n + joints] = 1
            if len(at):
                T[joints, :P, K + k * n + f + joints] = at[i]
            T[:, :P, -1], T[:, -1, -1] = -i * self.known, 1
            found.append(Equations(triangular(data.factors @ T), data.rows))
        return joined(found)

    def fitted(self, at: Sequence[Array] = ()) -> TwoSetsFit:
        """The fit of these unknowns with random errors of the drives."""
        K, n, m = self.base.count, self.robot.n, len(KINDS) * self.robot.n
        plain = least_squares(self.assembled(self.plain, at))
        states = self.states(plain.values)
        X = self.random_errors(states, with_factors=not len(at))
        both = self.assembled([in_blocks(data, x) for data, x in zip(self.both, X, strict=True)], at)
        c, sigma = np.zeros((n, len(KINDS))), plain.sigma
        for _ in range(2):  # errors found are taken out of the noise
            noise = sigma * np.sqrt(self.correlation_time(states, X, c))
            factor = both.weighted(noise)
            spread = spreads(factor, K, n)
            solution = solve(with_prior(factor, K, 1 / spread))
            c = solution.x[K : K + m].reshape(-1, n).T
            states = self.states(np.delete(solution.x, np.s_[K : K + m]))
            freedom = np.maximum(both.rows.sum(0) - solution.spent(both, noise), 1)
            sigma = np.maximum(
                np.sqrt(both.residuals(solution.x) / freedom), thresholds.APART_FROM_OTHERS * plain.sigma
            )
        kept = np.r_[:K, K + m : len(solution.x)]
        scatter, held_out = jackknife(both, noise, K, spread)
        estimate = replace(plain, values=solution.x[kept], errors=np.where(solution.free[kept], np.inf, 0), sigma=sigma)
        estimate = estimate._with_covariance(widened(solution.inverse[kept], scatter[kept]))
        load = eliminated(with_prior(both.weighted(believed_noise(both, noise)), K, 1 / spread), K + m)
        shown = [(name, s) for name, s in zip(KINDS, spread[::n], strict=True) if s > thresholds.TOLD_SPREAD]
        told = ", ".join(f"{name} ({100 * s:.2g} %)" for name, s in shown)
        notes = [f"the torques show, and the standard errors contain: {told}"] * bool(told)
        return TwoSetsFit(
            estimate, held_out, load, tuple(dict.fromkeys((*self.without.notes, *self.loaded.notes, *notes)))
        )

    def random_errors(self, states: Sequence[Array], *, with_factors: bool) -> list[Array]:
        """Torques of KINDS in either set, as large as each joint's torque, shape (rows, n, len(KINDS)).

        Torques are those of standard parameters of either set; factors are zero if not asked.
        """
        bodies, X = PARAMETERS * self.robot.model.nb, []
        for i, (data, x) in enumerate(zip(self.both, states, strict=True)):
            v, sign = (np.concatenate([r.reduce(f(r.qd)) for r in data.prepared]) for f in (np.asarray, np.sign))
            passed = np.concatenate([np.linspace(-1, 1, len(record.times)) for record in data.prepared])
            speed, one, load = np.abs(v), np.ones_like(v), np.abs(data.Y[..., :bodies] @ x[:bodies])
            terms = [data.Y @ x, load * sign, v * speed, np.sign(v) * np.sqrt(speed), speed]
            terms += [i * v, i * sign, i * one, passed[:, None] * one]
            X.append(np.stack(terms, axis=-1) * data.used[..., None])
        squares = sum((x**2).sum(0) for x in X)
        scale = np.sqrt(np.divide(squares[:, :1], squares, out=np.zeros_like(squares), where=squares > 0))
        scale[:, 0] *= with_factors
        return [x * scale for x in X]

    def correlation_time(self, states: Sequence[Array], X: Sequence[Array], c: Array) -> Array:
        """Correlation time of each joint's residuals, in rows, of parameters of either set and errors X c."""
        rows, sets = np.array([part.rows[0] for part in self.plain]), zip(self.both, states, X, strict=True)
        times = [data.correlation_time(data.residuals(x) - (errors * c).sum(-1)) for data, x, errors in sets]
        return np.asarray(np.maximum((rows * times).sum(0) / np.maximum(rows.sum(0), 1), 1.0))


@dataclass(frozen=True, eq=False)
class TwoSetsResult(InNotebooks):
    """The common part of results from records without and with a load."""

    estimate: LeastSquares
    held_out: Array
    notes: tuple[str, ...]
    sets: TwoSets

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Changes that would explain the residuals of either set better, the likeliest first, as of `rne.identify`."""
        return self.sets.causes

    @cached_property
    def doubt(self) -> str:
        """Reasons not to believe the result, with the likely causes; empty if there is none."""
        lines = self._reasons() + unexplained_text(self.sets.robot.joint_names, self.held_out)
        return ". ".join([*lines, *likely_text(self.causes)]) if lines else ""

    def _reasons(self) -> list[str]:
        raise NotImplementedError

    def _report(self, first: str, rows: Sequence[Row]) -> str:
        first += f"; torques in motion are predicted to {percent(self.held_out)} on blocks of time that were not fitted"
        notes = [*self.notes, CONTAINED, *(cause.text for cause in self.causes)]
        return "\n".join([wrapped(first), *aligned(rows), *map(wrapped, notes)])


def in_blocks(data: RegressionData, X: Array) -> Equations:
    """Equations of [Y, X, tau] in blocks of time, half of the folds in each set."""
    each = max(-(-thresholds.FOLDS // 2 // len(data.prepared)), 2)
    blocks = blocks_of_time(data.prepared, each)
    return equations(np.concatenate([data.Y, X], axis=-1), data.tau, data.used, blocks)


def widened(inverse: Array, scatter: Array) -> Array:
    """The covariance, with variances that are at least the scatter between blocks of time."""
    covariance = inverse @ inverse.T
    wider = np.sqrt(np.maximum(scatter / np.maximum(np.diag(covariance), TINY), 1))
    return np.asarray(covariance * np.outer(wider, wider))


def eliminated(factor: Array, K: int) -> Array:
    """Triangular equations of the unknowns from the K-th on, from those of all."""
    lengths = np.linalg.norm(factor[:, :K], axis=0)
    U, S, _ = np.linalg.svd(factor[:, :K] / np.where(lengths == 0, 1, lengths))
    rank = int((thresholds.DEPENDENT * S.max(initial=0) < S).sum())
    return triangular(U[:, rank:].T @ factor[:, K:])


def spreads(factor: Array, K: int, n: int) -> Array:
    """Standard deviation of the coefficients of KINDS of each joint, which follow the K first unknowns."""
    m = len(KINDS) * n
    errors, others = factor[:, K : K + m], np.delete(factor, np.s_[K : K + m], axis=1)
    rest = eliminated(np.concatenate([others[:, :-1], errors, others[:, -1:]], axis=1), others.shape[1] - 1)
    H, h = rest[:, :-1].T @ rest[:, :-1], rest[:, :-1].T @ rest[:, -1]
    told = (np.diag(H) > thresholds.APART_FROM_OTHERS**2 * (errors**2).sum(0)).reshape(-1, n)
    squares, chosen = np.full(len(KINDS), thresholds.FIRST_SPREAD**2), np.flatnonzero(told)
    for _ in range(thresholds.SPREAD_ROUNDS):
        V = np.linalg.inv(H[np.ix_(chosen, chosen)] + np.diag(1 / squares[chosen // n]))
        moments = np.zeros(m)
        moments[chosen] = (V @ h[chosen]) ** 2 + np.diag(V)
        squares = np.maximum(moments.reshape(-1, n).sum(1) / np.maximum(told.sum(1), 1), thresholds.LEAST_SPREAD**2)
    few = np.maximum(told.sum(1), 3)  # of so few joints the variance is not sure: that of Student's t
    return np.repeat(np.sqrt(squares * few / (few - 2)), n)


def jackknife(both: Equations, noise: Array, K: int, spread: Array) -> tuple[Array, Array]:
    """Variances from fits to all blocks but one, and the unexplained part of each joint's torques on that block."""
    blocks, found, squares = np.arange(len(both.factors)), [], np.zeros(both.joints)
    factors = np.array([both.of_blocks(blocks == k).weighted(noise) for k in blocks])
    for k in blocks:
        others = factors[blocks != k].reshape(-1, factors.shape[-1])
        found.append(solve(with_prior(others, K, 1 / spread)).x)
        squares += both.of_blocks(blocks == k).residuals(found[-1])
    left = np.sqrt(squares / np.maximum(both.torques(), TINY))
    return (len(blocks) - 1) * np.var(found, axis=0), np.where(both.rows.sum(0) == 0, np.nan, left)


def two_sets(
    robot: Robot | Identification,
    without: Record | Sequence[Record] | None,
    with_load: Record | Sequence[Record],
    drives: DriveModel | None,
    cutoff: float | None,
) -> TwoSets:
    """The equations of both sets, of which the arguments are checked, without any unknown of a load."""
    further = (None, cutoff, 2)  # two folds: none is held out
    if isinstance(robot, Identification):
        if without is not None or drives is not None:
            raise ValueError("an Identification has its records and drives: `without` and `drives` must be None")
        if robot.data.Z is not None:
            raise ValueError("`robot` must be identified without `instruments`, or give the records as `without`")
        with_load = checked_records(*of_named_joints(robot.initial, with_load)[:2], "with_load")
        second = build_regression(robot.initial, with_load, robot.base, *further, robot.delay.mean(0))
        return TwoSets(robot.initial, robot.base, robot.data, second, *no_load(robot.base))
    if without is None:
        raise ValueError("`without` must have a record without the load, unless an Identification is given")
    without, with_load = (x if isinstance(x, Sequence) else (x,) for x in (without, with_load))
    robot, named, matched = of_named_joints(robot_argument(robot), [*without, *with_load])
    base = robot.base_parameters(drives=MEASURED if drives is None else drives)
    sets = {"without": named[: len(without)], "with_load": named[len(without) :]}
    given = {name: checked_records(robot, x, name) for name, x in sets.items()}
    for one, other in product(*given.values()):
        if all(np.array_equal(getattr(one, x), getattr(other, x), equal_nan=True) for x in ("t", "q", "tau")):
            raise ValueError(f"`with_load` has a record that `without` has too, {one.name!r}: one is the wrong file")
    first, second = (build_regression(robot, records, base, *further) for records in given.values())
    return TwoSets(robot, base, replace(first, notes=(*matched, *first.notes)), second, *no_load(base))


def no_load(base: BaseParameters) -> tuple[Array, Array]:
    """S and `known` of TwoSets where nothing of a load is known or asked for."""
    if "Fl" in base.standard.terms:
        raise ValueError('`drives`: friction under "load" changes with the load that is to be found; leave it out here')
    return np.zeros((base.standard.count, 0)), np.zeros(base.standard.count)


def load_map(standard: StandardParameters, link: str) -> Array:
    """S of pi + S phi: standard parameters per unit of the load's parameters about a link's origin, in its axes."""
    model = standard.model
    index = model.link_index(link)
    body = int(model.link_body[index])
    if body < 0:
        raise ValueError(f"`link` must move, {link!r} is fixed to the base: no joint carries its load")
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = model.link_rotation[index], model.link_translation[index] - model.joint_origin[body]
    S = np.zeros((standard.count, PARAMETERS))
    units = pseudo_inertia(np.eye(PARAMETERS))
    S[PARAMETERS * body : PARAMETERS * (body + 1)] = parameters_of_pseudo_inertia(T @ units @ T.T).T
    return S
