"""Gauss-Newton method for the output error, from several starts; fits of starts only; folds for validation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import compress
from typing import Any

import numpy as np

from ...basics.spatial import Array
from ...errors import IdentificationError
from .. import thresholds
from .output_error import OutputError, Shot, shots_of
from .unknowns import DELAY

MEDIAN = 0.6745  # median of the absolute value of a standard normal number
OPTIONS: dict[str, Any] = {"method": "trf", "ftol": 1e-11, "xtol": 1e-10, "gtol": 1e-12}
ROBUST: dict[str, Any] = {"loss": "soft_l1", "f_scale": 2.0}


class MotionSolver:
    """Gauss-Newton steps within a trust region, from several starts, with adapted weights and step sizes."""

    def __init__(
        self,
        problem: OutputError,
        noise: Array,
        steps_free: bool,
        robust: bool,
        progress: Callable[[int, float], object] | None,
    ) -> None:
        self.noise, self.steps_free, self.robust, self.progress = noise, steps_free, robust, progress
        self.iterations, self.message, self.finer = 0, "", 1.0
        self.problem = replace(self._stepped(problem, problem.first), told=self._tell)
        self.z = problem.first

    def _tell(self, rms: float) -> None:
        self.iterations += 1
        if self.progress is not None:
            self.progress(self.iterations, rms)

    def _stepped(self, problem: OutputError, z: Array) -> OutputError:
        """Problem with integration steps that are stable at z."""
        if not self.steps_free:
            return problem
        numbers, shot = problem.unknowns.numbers(problem.parts(z)[0]), problem.shots[0]
        q = shot.q[np.isfinite(shot.q).all(axis=1)][:: max(1, len(shot.q) // 4)][:4]
        rate = problem.motions[0].fastest_rate(problem.vectors(numbers), q)
        period = min(1 / record.sample_rate for record in problem.records)
        return replace(problem, step=min(period, thresholds.STABLE / max(rate, 1e-9)) / self.finer)

    def solved(self, problem: OutputError, z: Array, most: int) -> Any:
        """Solution of scipy.optimize.least_squares from z, with a limit of evaluations."""
        from scipy.optimize import least_squares

        low = np.full(len(z), -np.inf)
        if DELAY in problem.unknowns.places:
            low[problem.unknowns.places[DELAY]] = 0.0
        how = OPTIONS | {"bounds": (low, np.inf), "x_scale": problem.spread} | (ROBUST if self.robust else {})
        with np.errstate(all="ignore"):
            return least_squares(problem.residuals, np.maximum(z, low), problem.slopes, max_nfev=most, **how)

    def from_starts(self, count: int, seed: int) -> None:
        """Best of some starts after a few steps each."""
        problem, found = self.problem, []
        for z in self._starts(count, seed):
            if np.isfinite(problem.residuals(z)).all():
                found.append(self.solved(problem, z, thresholds.FEW_STEPS))
                left = np.sqrt(np.nanmean(problem.misfits(found[-1].x) ** 2, axis=0))
                if (left < thresholds.ABOVE_RESOLUTION * self.noise).all():
                    break  # no other start can explain more
        if not found:
            raise IdentificationError(
                "the motion cannot be simulated from any start: give `shot`, or other numbers to start from"
            )
        self.z = min(found, key=lambda solution: float(solution.cost)).x

    def _starts(self, count: int, seed: int) -> list[Array]:
        """Given start, and the best ones of many near it."""
        problem, first, tried = self.problem, self.problem.first, []
        rng, unknowns, P = np.random.default_rng(seed), problem.unknowns, len(problem.unknowns.labels)
        for _ in range(thresholds.TRIED * (count - 1)):
            z = first.copy()
            z[:P] += rng.normal(size=P) * np.where(unknowns.is_log, thresholds.STRAY, 0.0)
            if DELAY in unknowns.places:
                place = unknowns.places[DELAY]
                z[place] += np.abs(rng.normal()) * problem.spread[place]
            r = problem.residuals(z)
            if np.isfinite(r).all():
                tried.append((float(r @ r), z))
        tried.sort(key=lambda pair: pair[0])
        return [first, *(z for _, z in tried[: count - 1])]

    def refine(self) -> None:
        """Solution to convergence, with weights by each joint's residual, and steps for the modes found."""
        z, problem = self.z, self.problem
        for _ in range(thresholds.ROUNDS):
            before, left = problem.sigma, problem.misfits(z)
            rms = np.sqrt(np.nanmean(left**2, axis=0))
            rms = np.nanmedian(np.abs(left), axis=0) / MEDIAN if self.robust else rms
            problem = replace(self._stepped(problem, z), sigma=np.maximum(rms, self.noise), told=self._tell)
            solution = self.solved(problem, z, thresholds.MANY_STEPS)
            z, self.message = solution.x, solution.message
            is_settled = np.abs(np.log(problem.sigma / before)).max() < thresholds.SETTLED
            if self._precise(problem, z) and is_settled:
                break
        self.problem, self.z = problem, z

    def _precise(self, problem: OutputError, z: Array) -> bool:
        """True if half the steps give the same positions, far below sigma; otherwise steps are refined."""
        if not self.steps_free:
            return True
        halved = replace(problem, step=problem.step / 2, traced=dict(problem.traced))
        error = float(np.sqrt(np.nanmean(((problem.misfits(z) - halved.misfits(z)) / problem.sigma) ** 2)))
        self.finer *= max(1.0, np.ceil((error / thresholds.ERROR_OF_STEPS) ** 0.25)) if np.isfinite(error) else 2.0
        return error <= thresholds.ERROR_OF_STEPS


def fitted_starts(problem: OutputError, x: Array) -> Array:
    """z with the numbers x and the starts of shots that fit their positions best."""
    from scipy.optimize import least_squares

    P, first = len(x), problem.first[len(x) :]
    rows = np.ones(problem.count, bool)
    rows[problem.count - len(first) - P : problem.count - len(first)] = False  # deviations of x

    def residuals(s: Array) -> Array:
        return problem.residuals(np.append(x, s))[rows]

    def slopes(s: Array) -> Array:
        return problem.slopes(np.append(x, s))[rows][:, P:]

    if not np.isfinite(residuals(first)).all():
        raise IdentificationError("the motion cannot be simulated from the start that the positions show")
    found = least_squares(residuals, first, slopes, x_scale=problem.spread[P:], max_nfev=thresholds.MANY_STEPS)
    return np.append(x, found.x)


def parts_of_folds(problem: OutputError, folds: int) -> Sequence[Shot]:
    """The problem's shots, or shorter ones where they are fewer than the folds; a ValueError if those are."""
    if folds == 1:
        raise ValueError("`folds` must be 0, or 2 and more")
    shots = problem.shots
    if len(shots) < folds:
        total = sum(float(shot.t[-1] - shot.t[0]) for shot in shots)
        shots = shots_of(problem.unknowns.scene, problem.records, total / folds, problem.sigma)
    if len(shots) < folds:
        raise ValueError(f"`folds` must be at most {len(shots)}, the parts that records can be cut into, got {folds}")
    return shots


def validation_errors(solver: MotionSolver, folds: int) -> Array:
    """Root mean square of the residual of each joint on parts of records left out of a fit, fold by fold."""
    problem, P, n = replace(solver.problem, told=None), len(solver.problem.unknowns.labels), solver.problem.n
    shots = parts_of_folds(problem, folds)
    problem, total_square, count = replace(problem, shots=shots), np.zeros(n), np.zeros(n)
    z = fitted_starts(problem, solver.z[:P])
    starts = z[P:].reshape(len(shots), 2 * n)
    for fold in range(folds):
        out = np.arange(len(shots)) % folds == fold
        fitted, left = (replace(problem, shots=list(compress(shots, chosen))) for chosen in (~out, out))
        x = solver.solved(fitted, np.append(z[:P], starts[~out]), thresholds.MANY_STEPS).x[:P]
        misfits = left.misfits(fitted_starts(left, x))
        total_square, count = total_square + np.nansum(misfits**2, axis=0), count + np.isfinite(misfits).sum(axis=0)
    return np.asarray(np.sqrt(np.divide(total_square, count, out=np.full(n, np.nan), where=count > 0)))
