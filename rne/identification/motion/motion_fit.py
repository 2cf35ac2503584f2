"""A model from commands and positions, without torques: motions are simulated, and their numbers fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import positive_number, whole_number
from ...basics.spatial import Array
from ...basics.text import InNotebooks, Row, aligned, counted, short
from ...errors import IdentificationError
from ...simulation.scene import Scene
from .. import thresholds
from ..log.record import Record
from .certainty import Certainty, certainty, correlation_time
from .output_error import STABLE, OutputError, columns_for, fastest_mode, shots_of
from .unknowns import SHIFT, Unknowns, unknowns_of

ROUNDING = 1 / np.sqrt(12)  # standard deviation of a uniform error of one step


@dataclass(frozen=True, eq=False)
class MotionFit(InNotebooks):
    """Numbers of a scene found from commands and positions, by `rne.identify_motion`.

    Attributes
    ----------
    initial : Scene
        The scene as it was given.
    numbers : dict of str to ndarray
        What was fitted, by the names of `wrt`, in the shapes of `scene.numbers`.
    names, units : tuple of str, length P
        The entries that were free, in words, and their units; of bodies regrouped parameters.
    values, std : ndarray, shape (P,)
        Their values and standard errors, under residuals that are correlated in time.
    told : ndarray of bool, shape (P,)
        False for entries that the log does not tell: their values and errors rest on what was allowed for.
    covariance : ndarray, shape (P, P)
        Of the entries, positive ones by their logarithms.
    rms : ndarray, shape (n,)
        Residual of the positions of each joint [rad or m].
    resolution : ndarray, shape (n,)
        Standard deviation of the rounding of each encoder, or of the white noise of its positions if that is more
        [rad or m].
    validation_error : ndarray, shape (n,)
        The residual on folds of the records that were not fitted, starts of motions excepted; NaN if not asked for.
    notes : tuple of str
        What the log cannot tell apart, what it does not explain, and what would explain it.
    records : tuple of Record
        Those that were fitted.
    message : str
        How the fit ended.
    """

    initial: Scene
    numbers: dict[str, Array]
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    std: Array
    told: Array
    covariance: Array
    rms: Array
    resolution: Array
    validation_error: Array
    notes: tuple[str, ...]
    records: tuple[Record, ...]
    message: str
    problem: OutputError
    z: Array
    sure: Certainty


def identify_motion(
    scene: Scene,
    records: Record | Sequence[Record],
    wrt: str | Sequence[str] = "auto",
    *,
    start: Mapping[str, ArrayLike] | None = None,
    priors: Mapping[str, ArrayLike] | None = None,
    starts: int = 4,
    shot: float | None = None,
    step: float | None = None,
    folds: int = 0,
    robust: bool = False,
    seed: int = 0,
    progress: Callable[[int, float], object] | None = None,
) -> MotionFit:
    """Fit."""
    given = (records,) if isinstance(records, Record) else tuple(records)
    _check(scene, given)
    period = min(1 / record.sample_rate for record in given)
    unknowns = unknowns_of(scene, wrt, period, start or {}, priors or {})
    noise = _noise(scene, given)
    spans = _ranges(scene, given)
    shots = shots_of(scene, given, None if shot is None else positive_number("shot", shot), noise)
    longest = period if step is None else positive_number("step", step)
    problem = OutputError(unknowns, given, shots, np.maximum(noise, thresholds.COARSE * spans), longest)
    solver = Solver(problem, noise, step is None, robust, progress)
    solver.from_starts(whole_number("starts", starts, least=1), seed)
    z = solver.refined()
    return _result(solver, z, given)


def _check(scene: Scene, records: Sequence[Record]) -> None:
    """Raise an error for a scene without a law that follows, or records without commands."""
    if not isinstance(scene, Scene):
        raise TypeError(f"`scene` must be an rne.Scene, got {type(scene).__name__}")
    if not hasattr(scene.controller, "reference") or not getattr(scene.controller, "traceable", False):
        raise ValueError("`scene` must have a controller with a `reference`, such as rne.control.pd or servo")
    if not records:
        raise ValueError("`records` must have one record at least")
    for record in records:
        if record.command is None:
            raise ValueError(f"{record.name}: has no commands: give `command`, or use rne.identify with its torques")


def _noise(scene: Scene, records: Sequence[Record]) -> Array:
    """The noise of positions at least: of rounding by encoders, or as third differences show it."""
    found = []
    for record in records:
        places = columns_for(scene, record)
        q, step = record.q[:, places], record.encoder_step[places]
        white = np.nanmedian(np.abs(np.diff(q, 3, axis=0)), axis=0) / (0.6745 * np.sqrt(20.0))
        found.append(np.maximum(step * ROUNDING, white))
    return np.maximum(np.min(found, axis=0), 1e-12)


def _ranges(scene: Scene, records: Sequence[Record]) -> Array:
    """How far joints move."""
    return np.max([np.nanmax(r.q[:, p], axis=0) - np.nanmin(r.q[:, p], axis=0) for r in records for p in [columns_for(scene, r)]], axis=0)


class Solver:
    """Gauss-Newton steps within a trust region, from several starts, with weights and steps that follow the fit."""

    def __init__(
        self, problem: OutputError, noise: Array, steps_free: bool, robust: bool, progress: Callable[[int, float], object] | None
    ) -> None:
        self.noise, self.steps_free, self.robust, self.progress = noise, steps_free, robust, progress
        self.iterations, self.problem = 0, problem
        self.problem = replace(self._stepped(problem, problem.first), told=self._tell)
        self.z = problem.first
        self.cost = np.inf

    def _tell(self, rms: float) -> None:
        self.iterations += 1
        if self.progress is not None:
            self.progress(self.iterations, rms)

    def _stepped(self, problem: OutputError, z: Array) -> OutputError:
        """With steps that are stable at z."""
        if not self.steps_free:
            return problem
        x, _ = problem.parts(z)
        numbers, motion, shot = problem.unknowns.numbers(x), problem.motions[0], problem.shots[0]
        n = problem.unknowns.scene.n
        q = shot.q[np.isfinite(shot.q).all(axis=1)][:: max(1, len(shot.q) // 4)][:4]
        frozen, own = motion.frozen, {name: numbers[name] for name in problem.unknowns.of_scene}
        vector = motion.vector(own)
        states = frozen.start(vector, q, np.zeros_like(q))
        rate = fastest_mode(frozen, states, vector)
        period = min(1 / record.sample_rate for record in problem.records)
        return problem.at(step=min(period, STABLE / max(rate, 1e-9)))

    def solved(self, problem: OutputError, z: Array, most: int) -> Any:
        """By scipy.optimize.least_squares from z, in so many evaluations at most."""
        from scipy.optimize import least_squares

        low, high = np.full(len(z), -np.inf), np.full(len(z), np.inf)
        if SHIFT in problem.unknowns.places:
            low[problem.unknowns.places[SHIFT]] = 0.0
        z = np.maximum(z, low)
        how: dict[str, Any] = {"loss": "soft_l1", "f_scale": 2.0} if self.robust else {}
        with np.errstate(all="ignore"):
            return least_squares(
                problem.residuals,
                z,
                problem.slopes,
                bounds=(low, high),
                x_scale=problem.spread,
                method="trf",
                ftol=1e-11,
                xtol=1e-10,
                gtol=1e-12,
                max_nfev=most,
                **how,
            )

    def from_starts(self, count: int, seed: int) -> None:
        """The best of some starts after a few steps each."""
        problem, found = self.problem, []
        for z in self._starts(count, seed):
            if np.isfinite(problem.residuals(z)).all():
                found.append(self.solved(problem, z, thresholds.FEW_STEPS))
        if not found:
            raise IdentificationError("the motion cannot be simulated from any start: give `shot`, or other numbers to start from")
        best = min(found, key=lambda s: float(s.cost))
        self.z, self.cost = best.x, best.cost

    def _starts(self, count: int, seed: int) -> list[Array]:
        """The one that was given, and the best ones of many about it."""
        problem = self.problem
        first = problem.first
        if count == 1:
            return [first]
        rng, P = np.random.default_rng(seed), len(problem.unknowns.labels)
        tried = []
        for _ in range(thresholds.TRIED * (count - 1)):
            z = first.copy()
            z[:P] += rng.normal(size=P) * np.where(problem.unknowns.is_log, thresholds.STRAY, 0.0)
            if SHIFT in problem.unknowns.places:
                place = problem.unknowns.places[SHIFT]
                z[place] += np.abs(rng.normal()) * problem.spread[:P][place]
            r = problem.residuals(z)
            if np.isfinite(r).all():
                tried.append((float(r @ r), z))
        tried.sort(key=lambda pair: pair[0])
        return [first, *(z for _, z in tried[: count - 1])]

    def refined(self) -> Array:
        """To the end, with weights by what is left of each joint, and steps for the modes that were found."""
        z, problem = self.z, self.problem
        for _ in range(thresholds.ROUNDS):
            before = problem.sigma
            rms = np.sqrt(np.nanmean(problem.misfits(z) ** 2, axis=0))
            problem = replace(self._stepped(problem, z), sigma=np.maximum(rms, self.noise), told=self._tell)
            solution = self.solved(problem, z, thresholds.MANY_STEPS)
            z, self.message = solution.x, solution.message
            if np.abs(np.log(problem.sigma / before)).max() < thresholds.SETTLED:
                break
        self.problem, self.z = problem, z
        return z


def _result(solver: Solver, z: Array, records: tuple[Record, ...]) -> MotionFit:
    problem, unknowns = solver.problem, solver.problem.unknowns
    x, _ = problem.parts(z)
    P, n, count = len(x), unknowns.scene.n, len(problem.shots)
    parts, series = [], []
    for s, (shot, (q, J)) in enumerate(zip(problem.shots, problem.derivatives(z), strict=True)):
        wide = np.zeros((*J.shape[:2], len(z)))
        wide[..., :P], wide[..., P + 2 * n * s : P + 2 * n * (s + 1)] = J[..., :P], J[..., P:]
        parts.append(((q - shot.q) / problem.sigma, wide / problem.sigma[:, None]))
    sure = certainty(parts, problem.spread, P)
    rms = np.sqrt(np.nanmean(problem.misfits(z) ** 2, axis=0))
    told = sure.told
    values = unknowns.entries(x)
    return MotionFit(
        unknowns.scene,
        unknowns.numbers(x),
        unknowns.labels,
        unknowns.units,
        values,
        sure.std * unknowns.slopes(x),
        told,
        sure.covariance,
        rms,
        solver.noise,
        np.full(n, np.nan),
        (),
        records,
        f"{solver.iterations} iterations, {solver.message}; steps {problem.step:.3g}",
        problem,
        z,
        sure,
    )
