"""Assumptions of a fit about drives and measurements, and the steps that find them from the residuals.

A fit assumes drives, delays of the torques, and cut-offs of the filter: its `FitModel`. The residuals show which of
these are wrong. Each of `STEPS` looks at a fit for one kind of error, and returns the model without it, or None;
`settled` fits again with that model until no step finds anything.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..dynamics.base_inertial_parameters import BaseParameters
from ..model.standard_parameters import DriveModel
from ..robot import Robot
from . import thresholds
from .diagnosis import hypotheses
from .diagnosis.hypotheses import GEARS, STRIBECK, Cause, Hypothesis, LinearCauses
from .diagnosis.residuals import FitResiduals
from .fit.equations import Motion, RegressionData, along, build_regression
from .fit.least_squares import LeastSquares, blocks_left_out, fit_base_parameters, least_squares, unexplained
from .log.record import Record

if TYPE_CHECKING:
    from ..simulation.springs import Springs


@dataclass(frozen=True, eq=False)
class FitModel:
    """Model of a fit: the robot, further assumptions, and which of these the residuals may change."""

    robot: Robot
    records: tuple[Record, ...]
    drives: DriveModel
    delays: Array  # of torques after the positions, shape (records, n) [s]
    cutoffs: float | tuple[float, ...] | None = None  # [Hz]; None for those of the spectra
    springs: Springs | None = None  # springs whose stiffness and length are found
    motions: tuple[Motion, ...] = ()  # of the instruments, one for each record; none for least squares
    minimum_velocity: ArrayLike | None = None  # this and `folds` as of `rne.identify`
    folds: int = thresholds.FOLDS
    hypotheses: tuple[Hypothesis, ...] | None = ()  # tried as further causes; None to look for no causes
    finds_delays: bool = True
    finds_drives: bool = True  # True to look for Stribeck effects, and for absent rotors
    filtered: tuple[tuple[str, ...], ...] = ()  # notes on the filter of each record, once the cut-offs are chosen
    modelled: Mapping[tuple[object, ...], Cause] = field(default_factory=dict)  # delays and Stribeck effects found

    def data(self, base: BaseParameters, loaded: Array | None = None) -> RegressionData:
        """Equations; friction under load is that of standard parameters `loaded`."""
        filters = self.minimum_velocity, self.cutoffs, self.folds
        return build_regression(self.robot, self.records, base, *filters, self.delays, loaded, self.motions)


@dataclass(frozen=True, eq=False)
class Fit:
    """Base parameters fitted under a model, and the diagnosis of their residuals."""

    model: FitModel
    base: BaseParameters
    data: RegressionData
    estimate: LeastSquares

    @property
    def modelled(self) -> list[Cause]:
        """Delays, then Stribeck effects, that the model takes into account."""
        return sorted(self.model.modelled.values(), key=lambda cause: cause.kind == STRIBECK)

    @cached_property
    def residuals(self) -> FitResiduals:
        """The residuals of the fit."""
        estimate = self.estimate
        return FitResiduals(self.model.robot, self.base, self.data, estimate.values, estimate.sigma)

    @cached_property
    def linear(self) -> LinearCauses:
        """Causes of the residuals whose torques are linear in their numbers."""
        return hypotheses.linear_causes(self.residuals, self.model.hypotheses)

    @cached_property
    def likely(self) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
        """Likely causes of the residuals, and those that are evident but of small effect."""
        if self.model.motions:  # the noise of the positions is in the residuals
            return (), ()
        return hypotheses.likely_causes(self.residuals, self.model.hypotheses, self.linear)

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Likely causes of the residuals; only gear friction if the model has no hypotheses."""
        return self.likely[0]


def settled(model: FitModel) -> Fit:
    """Fit under a model in which no step finds an error, or the one of the last iteration."""
    fit = with_chosen_cutoffs(fitted(model))
    for _ in range(thresholds.DELAY_ROUNDS):
        changed = next((found for step in STEPS if (found := step(fit)) is not None), None)
        if changed is None:
            break
        fit = fitted(changed)
    return fit


def fitted(model: FitModel) -> Fit:
    """Fit under a model; where friction depends on the load, iterated with the loads of the last fit.

    Each iteration multiplies the error of the parameters by about the share of the torque that friction takes.
    """
    base = model.robot.base_parameters(drives=model.drives)
    base = base if model.springs is None else with_springs(base, model.springs)
    x, before = None, np.full(base.count, np.inf)
    for _ in range(thresholds.LOAD_ROUNDS if "Fl" in base.standard.terms else 1):
        data = model.data(base, x)
        estimate = least_squares(data.fitted.mapped(base.back))
        moved, x, before = np.abs(estimate.values - before), base.back @ estimate.values, estimate.values
        if (moved <= thresholds.LOAD_SETTLED * estimate.errors).all():
            break
    if model.filtered:
        notes = zip(data.prepared, model.filtered, strict=True)
        data = replace(data, prepared=tuple(replace(record, notes=text) for record, text in notes))
    return Fit(model, base, data, estimate)


def with_springs(base: BaseParameters, springs: Any) -> BaseParameters:
    """Base parameters, and the parameters of springs, each of which is a base parameter."""
    standard = replace(base.standard, springs=springs)
    places = range(base.standard.count, standard.count)
    matrix = np.pad(base.matrix, (0, len(places)))
    matrix[range(base.count, len(matrix)), places] = 1
    return replace(base, standard=standard, independent=(*base.independent, *places), matrix=matrix)


# The cut-offs


def with_chosen_cutoffs(fit: Fit) -> Fit:
    """Fit with the given cut-offs, or with those of `lower_cutoffs`, which later iterations keep."""
    data = fit.data if fit.model.cutoffs else lower_cutoffs(fit)
    cutoffs, notes = tuple(r.cutoff for r in data.prepared), tuple(r.notes for r in data.prepared)
    model = replace(fit.model, cutoffs=cutoffs, filtered=notes)
    return replace(fit, model=model) if data is fit.data else fitted(model)


def lower_cutoffs(fit: Fit) -> RegressionData:
    """Equations with the cut-offs of the spectra, halved where that reduces the validation error.

    Of two fits the one with the lower cut-off is taken if it predicts blocks of time that neither was fitted to better,
    in signals below that cut-off, and its validation error in its own signals is smaller than that of the other; where
    errors are large, also if it predicts as well and its error is clearly smaller. There, a few halvings without
    improvement may precede one that helps.
    """
    base, first = fit.base, fit.data
    x = base.back @ fit.estimate.values
    if first.fitted.shares(x).max(initial=0) < thresholds.LITTLE:
        return first
    estimates = blocks_left_out(base, first)
    data, failed, errors = first, 0, [shares_held_out(estimates, first)]
    for k in range(1, thresholds.CUTOFF_HALVINGS + 1):
        model = replace(fit.model, cutoffs=tuple(record.cutoff / 2**k for record in first.prepared))
        try:
            lower = model.data(base, x)
        except ValueError:  # the record is too short for this filter
            break
        if lower.used.sum() < thresholds.FEWEST_ROWS * base.count:
            break
        lower_estimates = blocks_left_out(base, lower)
        own, other = (shares_held_out(x, lower) for x in (lower_estimates, estimates))
        ratio, fallen = (float(np.sqrt(np.nansum(own**2) / np.nansum(e**2))) for e in (other, errors[-1]))
        is_poor, least = np.nanmedian(errors[-1]) > thresholds.EXPLAINED, 1 - thresholds.LOWER
        if (ratio < least and fallen < 1) or (is_poor and fallen < least and ratio < 1 / least):
            data, estimates, failed = lower, lower_estimates, 0
            errors.append(own)
        elif is_poor and failed < thresholds.FAILED:
            failed += 1
        else:
            break
    return data if data is first else with_reasons(first, data, errors[0], errors[-1])


def shares_held_out(estimates: Sequence[Array], others: RegressionData) -> Array:
    """Validation errors of the torques, each block by parameters fitted without it, shape (n,)."""
    return unexplained(estimates, others.fitted, others.fitted).everywhere


def with_reasons(first: RegressionData, data: RegressionData, before: Array, after: Array) -> RegressionData:
    """Equations with notes on why cut-offs differ from the first ones, by the validation errors."""
    left, given = (", ".join(f"{100 * x:.3g}" for x in errors) for errors in (after, before))
    why = f"of blocks not fitted {left} % is left by joint, with that of the spectrum, {{:.3g}} Hz, {given} %: "
    why += "noise may be fed back"
    pairs = zip(data.prepared, (record.cutoff for record in first.prepared), strict=True)
    told = ((record, f"cut-off {record.cutoff:.3g} Hz: {why.format(spectrum)}") for record, spectrum in pairs)
    return replace(data, prepared=tuple(replace(record, notes=(text, *record.notes[1:])) for record, text in told))


# Steps: each takes a fit and returns the model without the error that it finds, or None


def with_delays(fit: Fit) -> FitModel | None:
    """Model with delays of the torques that the residuals show, or that another cause may hide."""
    model = fit.model
    if not model.finds_delays:
        return None
    if model.motions:
        moved = [along(record, motion) for record, motion in zip(fit.data.prepared, model.motions, strict=True)]
        found = hypotheses.delays_by_instruments(fit.residuals, moved)
    else:
        rest = fit.residuals.beyond_friction
        found = hypotheses.delays_of(rest)
        if not found and (leading := hypotheses.leading_columns(fit.linear)) is not None:
            found = hypotheses.delays_of(rest.with_known(leading))
    delays, modelled = model.delays, dict(model.modelled)
    for cause in found:
        delays = delays + hypotheses.added_delay(cause, len(delays), model.robot.joint_names)
        key = cause.kind, cause.joints, str(cause.at)
        before = modelled[key].value if key in modelled else 0.0
        modelled[key] = cause._replace(value=cause.value + before)
    return replace(model, delays=delays, modelled=modelled) if found else None


def with_stribeck(fit: Fit) -> FitModel | None:
    """Model with Stribeck effects, where these are among the likeliest causes."""
    model, names = fit.model, fit.model.robot.joint_names
    slow = [cause for cause in fit.causes if cause.kind == STRIBECK] if fit.model.finds_drives else []
    if not slow or slow[0].score < max(cause.score for cause in fit.causes) / 2:
        return None
    velocities = np.zeros(len(names)) if model.drives.stribeck is None else np.array(model.drives.stribeck, np.float64)
    modelled = dict(model.modelled)
    for cause in (hypotheses.refine(fit.residuals, cause) for cause in slow):
        modelled[cause.kind, cause.joints], velocities[names.index(cause.joints[0])] = cause, cause.at
    return replace(model, drives=replace(model.drives, stribeck=velocities), modelled=modelled)


def without_rotors(fit: Fit) -> FitModel | None:
    """Model without rotors, if none is significant, as with torque sensors behind the gears; other causes hide them."""
    model, base, robot = fit.model, fit.base, fit.model.robot
    own = [k for k, name in enumerate(base.names) if name.startswith("Ia_") and base.formulas[k] == name]
    is_open = fit.model.finds_drives and model.drives.rotor
    if not is_open or not own or any(cause.kind not in GEARS for cause in fit.causes):
        return None
    found, size = fit_base_parameters(base, fit.data), np.zeros(robot.model.nb)
    pose = fit.data.prepared[0].q[:1] if robot.model.couplings else np.zeros((1, robot.n))  # where joints can follow
    size[list(robot.model.independent_joints)] = np.diag(robot.mass_matrix(pose)[0])
    joints = [int(base.names[k].removeprefix("Ia_")) - 1 for k in own]
    doubt = thresholds.BEYOND_DOUBT * found.errors[own]
    are_small = found.values[own] < np.minimum(doubt, thresholds.SMALL_ROTOR * size[joints] - doubt)
    return replace(model, drives=replace(model.drives, rotor=False)) if are_small.all() else None


STEPS: tuple[Callable[[Fit], FitModel | None], ...] = (with_delays, with_stribeck, without_rotors)
