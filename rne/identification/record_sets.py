"""The equations of motions without and with loads, and standard errors that contain the errors of drives.

Torques of real drives differ from Y pi by more than noise: gains are a little wrong, friction rises with the load or
changes between the records, offsets drift. Each kind of such errors has a column for each joint. Its coefficients are
random, with a variance that is estimated with the parameters by expectation and maximisation (Dempster, Laird and Rubin
1977; variance components, Searle, Casella and McCulloch 1992), so that the parameters' covariance contains them. Fits
to all blocks of time but one (the jackknife of Tukey 1958) show other variations.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.inertia import PARAMETERS, parameters_of_pseudo_inertia, pseudo_inertia
from ..basics.spatial import Array
from ..basics.text import InNotebooks, Row, aligned, column, table, wrapped
from ..dynamics.base_inertial_parameters import BaseParameters
from ..model.standard_parameters import DriveModel, StandardParameters
from ..robot import Robot, robot_argument
from . import thresholds
from .diagnosis import hypotheses
from .diagnosis.hypotheses import GEARS, Cause
from .diagnosis.residuals import FitResiduals, by_joint
from .diagnosis.rigid_body_test import percent
from .fit.equations import (
    MEASURED,
    Equations,
    RegressionData,
    Solution,
    blocks_of_time,
    build_regression,
    checked_records,
    delay_argument,
    delayed,
    equations,
    joined,
    of_named_joints,
    solve,
    triangular,
    with_prior,
)
from .fit.least_squares import LeastSquares, believed_noise, least_squares
from .log.findings import torques_of
from .log.prepared import Prepared
from .log.record import Record
from .result import Identification, likely_text, unexplained_text

KINDS = (
    "torque factors",
    "friction under load",
    "viscous friction that is not linear",
    "viscous friction that saturates",
    "friction by direction",
    "offsets that drift",
)
CHANGES = tuple(
    f"{what} that changed between the records"
    for what in ("torque factors", "viscous friction", "Coulomb friction", "offsets")
)
GAINS_CONTAINED = (
    "standard errors contain those of the gains, noise, the scatter between blocks of time, and what errors of the "
    "drives make of the load; not an error of the load weighed: the mass is as wrong as it is, relatively"
)
QUIET = "no change of the log, the robot or the drives that was tried explains the residuals"
FEWEST_FOLDS = 2  # fewest folds of the equations, where no validation is needed
CONTAINED = (
    "standard errors contain noise, the scatter between blocks of time, and what errors of the drives make of the "
    "load; not a factor common to all torques"
)


class SetsFit(NamedTuple):
    """Fit with random errors of the drives; unknowns are base and load parameters, and changes of gains."""

    estimate: LeastSquares
    held_out: Array  # rms validation errors in motion, and rms torques, shape (sets, 2, n)
    load: Array  # triangular equations of only the loads' parameters
    notes: tuple[str, ...]  # on the records, and on what the errors contain


@dataclass(frozen=True, eq=False)
class RecordSets:
    """Equations of sets of records, without and with loads, of the same standard parameters pi.

    The load of a set adds its `known` + S phi to pi, of which phi is unknown and the same for all.
    """

    robot: Robot
    base: BaseParameters
    data: tuple[RegressionData, ...]
    S: Array  # shape (sets, P, number of unknowns of the loads)
    known: Array  # shape (sets, P)
    records: tuple[tuple[Record, ...], ...]  # of each set whose delays are to be estimated, otherwise none

    def with_records(
        self, records: Record | Sequence[Record], cutoff: float | None, delay: ArrayLike | None = None
    ) -> RecordSets:
        """Equations with another set of records, by default with the mean delays of the last set."""
        robot, given, notes = of_named_joints(self.robot, records)
        if robot is not self.robot:
            lacking = [name for name in self.robot.joint_names if name not in robot.joint_names]
            raise ValueError(f"`with_load` must have all joints of the other records, it lacks {lacking}")
        given = checked_records(self.robot, given, "with_load")
        late = self.data[-1].delays.mean(0) if delay is None else delay_argument(delay, self.robot.n)
        data = build_regression(self.robot, given, self.base, None, cutoff, FEWEST_FOLDS, late)
        others = [pair for part in self.data for pair in zip(part.prepared, part.delays, strict=True)]
        for record, (other, delays) in product(given, others):
            if is_that_of(record, other, delays):
                both = f"a record that the others have too, {record.name!r}"
                raise ValueError(f"`with_load` has {both}: one is the wrong file")
        data = replace(data, notes=(*notes, *data.notes))
        S, known = (np.concatenate([x, np.zeros((1, *x.shape[1:]))]) for x in (self.S, self.known))
        kept = (*self.records, given if delay is None else ())
        return replace(self, data=(*self.data, data), S=S, known=known, records=kept)

    def with_delays(self, gains: Array | None = None) -> RecordSets:
        """Equations with delays of each record, and of single joints where they differ, by residuals of torques."""
        found = list(self.data)
        for i, records in enumerate(self.records):
            cutoffs = [record.cutoff for record in found[i].prepared]
            for _ in range(thresholds.DELAY_ROUNDS * bool(records)):
                rest = self._residuals(found[i] if gains is None else found[i].in_torques(gains))
                if not (causes := hypotheses.delays_of(rest.beyond_friction)):
                    break
                late = sum((hypotheses.added_delay(x, len(records), rest.names) for x in causes), found[i].delays)
                again = build_regression(self.robot, records, self.base, None, cutoffs, FEWEST_FOLDS, late)
                found[i] = replace(again, notes=found[i].notes)
            found[i] = replace(found[i], notes=(*found[i].notes, *delay_notes(found[i], self.robot.joint_names)))
        return replace(self, data=tuple(found), records=((),) * len(found))

    def with_load(self, link: str) -> RecordSets:
        """Equations with the ten parameters of a load on a link, in the last set, among the unknowns."""
        S = np.zeros((*self.known.shape, PARAMETERS))
        S[-1] = load_map(self.base.standard, link)
        return replace(self, S=np.concatenate([self.S, S], axis=-1))

    def _residuals(self, data: RegressionData) -> FitResiduals:
        """Residuals of a fit to one set of records."""
        estimate = least_squares(data.fitted.mapped(self.base.back))
        return FitResiduals(self.robot, self.base, data, estimate.values, estimate.sigma)

    @cached_property
    def plain(self) -> list[Equations]:
        """Equations of the sets, each in one block."""
        return [data.fitted.merged() for data in self.data]

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """Changes that would reduce the residuals of a set of records, or of all together; see `rne.identify`."""
        found = self.changes
        told = {cause.kind: [c for c in found if c.kind == cause.kind] for cause in found}
        for data in self.data:
            for x in hypotheses.likely_causes(self._residuals(data))[0]:
                if all(x.joints != c.joints and x.score > c.score for c in told.get(x.kind, ())):
                    found.append(x)
        return hypotheses.merged_by_kind(sorted(found, key=lambda cause: -cause.score))

    @property
    def changes(self) -> list[Cause]:
        """Other changes between the records with the last load and the others."""
        estimate = least_squares(self.assembled(self.plain))
        loads = np.concatenate([self.S, self.known[..., None]], axis=-1)
        torques = np.concatenate([part.Y @ x for part, x in zip(self.data, loads, strict=True)])
        betas = self.states(estimate.values) @ self.base.matrix.T
        one, data = np.ones(self.robot.n), joined_data(self.data)
        rest = FitResiduals(self.robot, self.base, data, betas[-1], estimate.sigma, one)  # with the last load
        sets = [(r, beta) for part, beta in zip(self.data, betas, strict=True) for r in part.prepared]
        curves = [r.reduce(rest.friction_curves(r.q, r.qd, r.qdd, self.base.back @ beta)) for r, beta in sets]
        of_law = np.concatenate(curves)[..., :-1]  # two loads would explain some of what differs
        known = np.concatenate([torques, by_joint(of_law)], axis=-1)
        loaded = np.arange(len(data.tau)) >= len(data.tau) - len(self.data[-1].tau)
        body = int(loads[-1].any(1).argmax()) // PARAMETERS
        return hypotheses.changes_with_load(rest, known, loaded[:, None, None], body)

    def in_torques(self, gains: Array) -> RecordSets:
        """Equations in torques from measurements and gains; joints whose gain is NaN have none."""
        return replace(self, data=tuple(data.in_torques(gains) for data in self.data))

    def states(self, x: Array) -> Array:
        """Standard parameters of each set, of unknowns x, shape (sets, P)."""
        K = self.base.count
        return np.asarray(self.base.back @ x[:K] + self.known + self.S @ x[K : K + self.S.shape[-1]])

    def assembled(self, parts: Sequence[Equations], at: Array | None = None) -> Equations:
        """Equations Y (pi + S phi) + X c + Y at d = tau - Y known, for base parameters of pi, c, phi and d of joints.

        `parts` have columns Y, X of each set. `at` are parameters of each set.
        """
        back, n = self.base.back, self.robot.n
        (P, K), f, joints = back.shape, self.S.shape[-1], np.arange(n)
        k, found = parts[0].factors.shape[-1] - 1 - P, []
        for i, data in enumerate(parts):
            T = np.zeros((n, P + k + 1, K + k * n + f + n * (at is not None) + 1))
            T[:, :P, :K], T[:, :P, K + k * n : K + k * n + f] = back, self.S[i]
            for kind in range(k):
                T[joints, P + kind, K + kind * n + joints] = 1
            if at is not None:
                T[joints, :P, K + k * n + f + joints] = at[i]
            T[:, :P, -1], T[:, -1, -1] = -self.known[i], 1
            found.append(Equations(triangular(data.factors @ T), data.rows))
        return joined(found)

    def fitted(self, at: Array | None = None) -> SetsFit:
        """Fit of these unknowns with random errors of the drives."""
        K, n = self.base.count, self.robot.n
        m = len(self.kinds) * n
        plain = least_squares(self.assembled(self.plain, at))
        X = self.random_errors(self.states(plain.values), with_factors=at is None)
        blocks = [in_blocks(data, x, len(self.data)) for data, x in zip(self.data, X, strict=True)]
        of_blocks = self.assembled(blocks, at)
        both = of_blocks.merged()
        solution, noise, spread, sigma = self._with_spreads(both, plain, X)
        kept = np.r_[:K, K + m : len(solution.x)]
        left_out = jackknife(of_blocks, noise, K, spread)
        scatter = (len(left_out) - 1) * left_out.var(0)
        estimate = replace(plain, values=solution.x[kept], errors=np.where(solution.free[kept], np.inf, 0), sigma=sigma)
        covariance = solution.inverse[kept] @ solution.inverse[kept].T
        wider = np.sqrt(np.maximum(scatter[kept] / np.maximum(np.diag(covariance), thresholds.TINY), 1))
        estimate = estimate.with_covariance(covariance * np.outer(wider, wider))
        factor = with_prior(both.weighted(believed_noise(both, noise)), K, 1 / spread)
        load = eliminated(factor, np.s_[K + m : K + m + self.S.shape[-1]])
        squares = validation_squares(of_blocks, plain.sigma, K, spread)
        of_sets = np.split(squares, np.cumsum([len(x.rows) for x in blocks])[:-1])
        left = np.array([errors_of(x, part) for x, part in zip(blocks, of_sets, strict=True)])
        notes = (*(note for data in self.data for note in data.notes), *self._shown_text(spread[::n]))
        return SetsFit(estimate, left, load, tuple(dict.fromkeys(notes)))

    def _with_spreads(
        self, both: Equations, plain: LeastSquares, X: Sequence[Array]
    ) -> tuple[Solution, Array, Array, Array]:
        """Solution with random errors X: its noise for weights, the errors' spreads, and the residual noise."""
        K, n, m = self.base.count, self.robot.n, len(self.kinds) * self.robot.n
        c, sigma, states = np.zeros((n, len(self.kinds))), plain.sigma, self.states(plain.values)
        for _ in range(2):  # errors found are taken out of the noise
            noise = sigma * np.sqrt(self.correlation_time(states, X, c))
            factor = both.weighted(noise)
            spread = spreads(factor, K, m, n)
            solution = solve(with_prior(factor, K, 1 / spread))
            c = solution.x[K : K + m].reshape(-1, n).T
            states = self.states(np.delete(solution.x, np.s_[K : K + m]))
            freedom = np.maximum(both.rows.sum(0) - solution.spent(both, noise), 1)
            left = np.sqrt(both.residuals(solution.x) / freedom)
            sigma = np.maximum(left, thresholds.APART_FROM_OTHERS * plain.sigma)
        return solution, noise, spread, sigma

    def _shown_text(self, spread: Array) -> tuple[str, ...]:
        """Note on the kinds of random errors present in the torques, with their spreads."""
        shown = [(name, s) for name, s in zip(self.kinds, spread, strict=True) if s > thresholds.TOLD_SPREAD]
        told = ", ".join(f"{name} ({100 * s:.2g} %)" for name, s in shown)
        return (f"the torques show, and the standard errors contain: {told}",) * bool(told)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of random errors; of changes, one for each set but the first."""
        between = ("",) if len(self.data) < 3 else (*(", load weighed",) * (len(self.data) - 2), ", load")
        return (*KINDS, *(f"{kind}{which}" for which in between for kind in CHANGES))

    def random_errors(self, states: Array, *, with_factors: bool) -> list[Array]:
        """Torques of all `kinds` in each set, as large as each joint's torque, shape (rows, n, number of kinds).

        Torques are those of standard parameters of each set; factors are zero if not asked.
        """
        groups, X = self.base.standard.groups, []
        passed_on = np.r_[tuple(groups[name] for name in ("bodies", "Ia", "springs") if name in groups)]
        for i, (data, x) in enumerate(zip(self.data, states, strict=True)):
            v, sign = (np.concatenate([r.reduce(f(r.qd)) for r in data.prepared]) for f in (np.asarray, np.sign))
            passed = np.concatenate([np.linspace(-1, 1, len(record.times)) for record in data.prepared])
            speed, one, load = np.abs(v), np.ones_like(v), np.abs(data.Y[..., passed_on] @ x[passed_on])
            terms = [data.Y @ x, load * sign, v * speed, np.sign(v) * np.sqrt(speed), speed]
            terms += [passed[:, None] * one]
            terms += [(i == k) * x for k in range(1, len(self.data)) for x in (terms[0], v, sign, one)]
            X.append(np.stack(terms, axis=-1) * data.used[..., None])
        squares = sum((x**2).sum(0) for x in X)
        scale = np.sqrt(np.divide(squares[:, :1], squares, out=np.zeros_like(squares), where=squares > 0))
        scale[:, [0, *range(len(KINDS), scale.shape[1], len(CHANGES))]] *= with_factors
        return [x * scale for x in X]

    def correlation_time(self, states: Array, X: Sequence[Array], c: Array) -> Array:
        """Correlation time of each joint's residuals, in rows, of parameters of each set and errors X c."""
        rows, sets = np.array([part.rows[0] for part in self.plain]), zip(self.data, states, X, strict=True)
        times = [data.correlation_time(data.residuals(x) - (errors * c).sum(-1)) for data, x, errors in sets]
        return np.asarray(np.maximum((rows * times).sum(0) / np.maximum(rows.sum(0), 1), 1.0))


@dataclass(frozen=True, eq=False)
class SetsResult(InNotebooks):
    """Base of results from records without and with a load."""

    estimate: LeastSquares
    held_out_rms: Array
    notes: tuple[str, ...]
    sets: RecordSets

    @property
    def validation_error(self) -> Array:
        """Validation error |predicted - measured| / |measured| of each joint in motion with the load, (n,)."""
        errors, torques = self.held_out_rms[-1]
        return np.asarray(errors / np.maximum(torques, thresholds.TINY))

    held_out = validation_error

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Changes that would reduce the residuals of either set, the likeliest first; see `rne.identify`."""
        return self.sets.causes

    @cached_property
    def doubt(self) -> str:
        """Reasons to doubt the result, with the likely causes; empty if there are none."""
        lines = self._reasons() + unexplained_text(self.sets.robot.joint_names, self.validation_error)
        return ". ".join([*lines, *likely_text(self.causes)]) if lines else ""

    def _reasons(self) -> list[str]:
        raise NotImplementedError

    def _report(self, first: str, rows: Sequence[Row], contained: str = CONTAINED) -> str:
        error = percent(self.validation_error)
        first += f"; validation error while moving {error}, on blocks of time that were not fitted"
        causes = [*likely_text(self.causes), *(cause.text for cause in self.causes if cause.kind in GEARS)]
        notes = [*self.notes, contained, *(causes or [QUIET])]
        return "\n".join([wrapped(first), *aligned(rows), *self._errors(), *map(wrapped, notes)])

    def _errors(self) -> list[str]:
        """Table of the validation errors."""
        of_sets = ("no load", *("load weighed",) * (len(self.held_out_rms) - 2), "load")
        columns = (*(f"{name} [%]" for name in of_sets), "load [N m or N]", "noise [N m or N]")
        errors, torques = np.moveaxis(self.held_out_rms, 1, 0)
        shares, known = 100 * errors / np.maximum(torques, thresholds.TINY), np.where(np.isnan(errors[-1]), np.nan, 1.0)
        cells = *(column(x * known, ".2f", "-") for x in shares), column(errors[-1], ".4g", "-")
        noise = column(self.estimate.sigma * known, ".4g", "-")
        return table("validation errors", columns, self.sets.robot.joint_names, *cells, noise, indent="  ")


def is_that_of(record: Record, prepared: Prepared, delays: Array) -> bool:
    """True if this record was prepared from the same measurements, with any filter and delays."""
    rows = np.isin(record.cleaned.t, prepared.t)
    if rows.sum() != len(prepared.t):
        return False
    again = delayed(replace(prepared, tau=torques_of(record.cleaned)[rows]), delays)
    return np.array_equal(again.tau, prepared.tau)


def delay_notes(data: RegressionData, joints: Sequence[str]) -> Iterator[str]:
    """Text of the delays taken into account in each record."""
    for name, late in zip(data.names, data.delays, strict=True):
        for x in np.unique(late[late != 0]):  # zero unless given or found
            names = tuple(joint for joint, own in zip(joints, late, strict=True) if own == x)
            text = hypotheses.delay_text(names if len(names) < len(joints) else ())(np.array([x]))
            yield f"{name}: {text}; taken into account"


def joined_data(parts: Sequence[RegressionData]) -> RegressionData:
    """Equations of several sets of records as one."""
    tuples = {name: tuple(x for part in parts for x in getattr(part, name)) for name in ("names", "prepared", "notes")}
    masks = ("delays", "Y", "tau", "valid", "used", "sure")
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in masks}
    both = {name: joined([getattr(part, name) for part in parts]) for name in ("fitted", "measured")}
    fields: dict[str, Any] = tuples | arrays | both
    return replace(parts[0], **fields)


def in_blocks(data: RegressionData, X: Array, sets: int) -> Equations:
    """Equations of [Y, X, tau] in blocks of time, for a number of sets that share the folds."""
    each = max(-(-thresholds.FOLDS // sets // len(data.prepared)), 2)
    blocks = blocks_of_time(data.prepared, each)
    return equations(np.concatenate([data.Y, X], axis=-1), data.tau, data.used, blocks)


def eliminated(factor: Array, kept: slice) -> Array:
    """Triangular equations of the unknowns kept, from equations of all."""
    others = np.delete(factor[:, :-1], kept, axis=1)
    lengths = np.linalg.norm(others, axis=0)
    U, S, _ = np.linalg.svd(others / np.where(lengths == 0, 1, lengths))
    rank = int((thresholds.DEPENDENT * S.max(initial=0) < S).sum())
    return triangular(U[:, rank:].T @ np.concatenate([factor[:, :-1][:, kept], factor[:, -1:]], axis=1))


def spreads(factor: Array, K: int, m: int, n: int) -> Array:
    """Standard deviations of the m coefficients of n joints' random errors, which follow the first K unknowns."""
    errors, rest = factor[:, K : K + m], eliminated(factor, np.s_[K : K + m])
    H, h = rest[:, :-1].T @ rest[:, :-1], rest[:, :-1].T @ rest[:, -1]
    told = (np.diag(H) > thresholds.APART_FROM_OTHERS**2 * (errors**2).sum(0)).reshape(-1, n)
    squares, chosen = np.full(m // n, thresholds.FIRST_SPREAD**2), np.flatnonzero(told)
    for _ in range(thresholds.SPREAD_ROUNDS):
        V = np.linalg.inv(H[np.ix_(chosen, chosen)] + np.diag(1 / squares[chosen // n]))
        moments = np.zeros(m)
        moments[chosen] = (V @ h[chosen]) ** 2 + np.diag(V)
        squares = np.maximum(moments.reshape(-1, n).sum(1) / np.maximum(told.sum(1), 1), thresholds.LEAST_SPREAD**2)
    few = np.maximum(told.sum(1), 3)  # of so few joints the variance is not sure: that of Student's t
    return np.repeat(np.sqrt(squares * few / (few - 2)), n)


def jackknife(both: Equations, noise: Array, K: int, spread: Array) -> Array:
    """Parameters fitted to all blocks but one, with random errors of this spread, shape (blocks, unknowns)."""
    blocks = np.arange(len(both.factors))
    factors = np.array([both.of_blocks(blocks == k).weighted(noise) for k in blocks])
    others = (factors[blocks != k].reshape(-1, factors.shape[-1]) for k in blocks)
    return np.array([solve(with_prior(x, K, 1 / spread)).x for x in others])


def validation_squares(both: Equations, noise: Array, K: int, spread: Array) -> Array:
    """Squared validation errors of blocks, by fits to the others without errors of `KINDS`, shape (blocks, n).

    With these errors, base parameters would not contain all of viscous and Coulomb friction. Changes between the
    records are fitted, and left out of the prediction: they are errors of the records after the change.
    """
    own, m = len(KINDS) * both.joints, len(spread)
    both = replace(both, factors=np.delete(both.factors, np.s_[K : K + own], axis=-1))
    fits = jackknife(both, noise, K, spread[own:])
    fits[:, K : K + m - own] = 0
    return np.array([both.of_blocks(np.array([k])).residuals(x) for k, x in enumerate(fits)])


def errors_of(equations: Equations, squares: Array) -> Array:
    """Root mean square of validation errors by joint, from squares of blocks, and of the torques, shape (2, n)."""
    rows = equations.rows.sum(0)
    rms = np.sqrt(squares.sum(0) / np.maximum(rows, 1))
    return np.where(rows == 0, np.nan, [rms, equations.rms_torques()])


def record_sets(
    robot: Robot | Identification,
    without: Record | Sequence[Record] | None,
    with_load: Record | Sequence[Record],
    drives: DriveModel | None,
    cutoff: float | None,
    delay: ArrayLike | None = None,
) -> RecordSets:
    """Equations of both sets, with checked arguments, without unknowns of a load."""
    if isinstance(robot, Identification):
        if without is not None or drives is not None:
            raise ValueError("an Identification has its records and drives: `without` and `drives` must be None")
        if robot.data.Z is not None:
            raise ValueError("`robot` must be identified without `instruments`, or give the records as `without`")
        return of_one_set(robot.initial, robot.base, robot.data).with_records(with_load, cutoff, delay)
    if without is None:
        raise ValueError(
            "`without` must have a record without the load, unless an Identification is given: from records with it "
            "alone its mass cannot be separated from the last body's, nor gains from masses"
        )
    without, with_load = (x if isinstance(x, Sequence) else (x,) for x in (without, with_load))
    robot, named, matched = of_named_joints(robot_argument(robot), [*without, *with_load])
    base = robot.base_parameters(drives=MEASURED if drives is None else drives)
    sets = {"without": named[: len(without)], "with_load": named[len(without) :]}
    given = {name: checked_records(robot, x, name) for name, x in sets.items()}
    late = delay_argument(delay, robot.n)
    first = build_regression(robot, given["without"], base, None, cutoff, FEWEST_FOLDS, late)
    first = replace(first, notes=(*matched, *first.notes))
    kept = given["without"] if delay is None else ()
    return of_one_set(robot, base, first, kept).with_records(given["with_load"], cutoff, delay)


def of_one_set(
    robot: Robot, base: BaseParameters, data: RegressionData, records: tuple[Record, ...] = ()
) -> RecordSets:
    """Equations of records without a load."""
    if "Fl" in base.standard.terms:
        raise ValueError('`drives`: friction under "load" changes with the load that is to be found; leave it out here')
    S, known = np.zeros((1, base.standard.count, 0)), np.zeros((1, base.standard.count))
    return RecordSets(robot, base, (data,), S, known, (records,))


def load_map(standard: StandardParameters, link: str) -> Array:
    """Matrix S of pi + S phi: standard parameters per unit of the load's about a link's origin, in its axes."""
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
