"""Torque per ampere of each drive, from currents measured without and with a known load.

Currents are torques in another unit for each joint, i_j = k_j (Y_j pi + Y_j S phi): without a load (phi = 0) any
gains fit, with one its known parameters set the scale (Gautier and Briot 2014). Of a load that is only weighed, the
other nine parameters are unknowns too. Currents are noisy, and as a column of the equations their noise would draw
gains to zero. Instead, the columns are currents that a model predicts (instruments, as of instrumental variables):
first those of each joint's own fit, then, in Gauss-Newton steps, those of the parameters found.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, whole_number
from ..basics.inertia import PARAMETERS
from ..basics.spatial import Array
from ..basics.text import Row, listed, short, wrapped
from ..errors import IdentificationError, IdentificationWarning
from ..model.standard_parameters import DriveModel
from ..model.topology import end_link
from ..robot import Robot
from . import thresholds
from .diagnosis.rigid_body_test import percent, single_joint_fit
from .fit.equations import solve, warn_of_locked
from .fit.least_squares import least_squares
from .log.record import Record
from .prediction import square_root
from .record_sets import RecordSets, SetsFit, SetsResult, record_sets
from .result import Identification

if TYPE_CHECKING:
    from ..simulation.scene import Payload

UNTOLD = (
    "the gain of {} cannot be identified: the load produces no torque there in these motions, or acts as the joint's "
    "own body or offset does; move the joint against the load, or mount the load further from its axis"
)
NOT_SEPARABLE = (
    "`payload` must be a load that was weighed, got None: twice the gains fit twice the masses of the arm and of a "
    "load unknown. Find them with one that was weighed, then this one: `rne.identify_payload(gains, None, records)`"
)
NONE_TOLD = (
    "`payload`: the load changes the currents of no joint by more than chance does: move the joints that lift it, and "
    "turn the hand meanwhile, or take a heavier load"
)


@dataclass(frozen=True, eq=False)
class DriveGains(SetsResult):
    """Gains of the drives, by `rne.identify_drive_gains`.

    Attributes
    ----------
    joint_names : tuple of str
        The joints of the gains, in the robot's order.
    gains : ndarray, shape (n,)
        Joint torque per measured unit; NaN where it cannot be identified, with a reason in `notes` and the report
        [N m/A or N/A for currents].
    errors : ndarray, shape (n,)
        Standard errors of the gains; NaN for the same joints.
    held_out_rms : ndarray, shape (2, 2, n)
        Root mean squares of validation errors and torques, without the load and with it, as of `PayloadEstimate`; NaN
        for joints without a gain [N m or N].
    estimate : LeastSquares
        The base parameters, in N m, with the gains found; then, of a load of which only the mass is known, m cx, m cy,
        m cz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the link's origin; last, the relative changes of the gains.
    com : ndarray, shape (3,)
        The load's centre of mass in its link's frame, as given or as found [m].
    notes : tuple of str
        Assumptions and signs of mistakes.
    sets : RecordSets
        The equations, with torques by these gains.
    currents : RecordSets
        The equations as measured, from which `rne.identify_payload` finds another load and the gains together.
    """

    joint_names: tuple[str, ...]
    gains: Array
    errors: Array
    com: Array
    currents: RecordSets

    def _reasons(self) -> list[str]:
        share = self.errors / np.abs(self.gains)
        named = zip(self.joint_names, share, strict=True)
        wide = [f"{name} to {100 * x:.2g} %" for name, x in named if x > thresholds.DOUBTFUL]
        return [f"gains are known poorly: {listed(wide)}"] if wide else []

    def __repr__(self) -> str:
        return wrapped(f"DriveGains([{', '.join(f'{gain:.4g}' for gain in self.gains)}])")

    def draws(self, count: int, seed: int = 0) -> Array:
        """Random gains distributed by their standard errors and correlations, shape (count, n).

        Parameters
        ----------
        count, seed : int
            Number of draws, and the seed of their random numbers.

        Returns
        -------
        ndarray, shape (count, n)
            Of a normal distribution; NaN for joints without a gain.

        Raises
        ------
        ValueError
            If `count` is not a positive integer.
        """
        n, rng = len(self.gains), np.random.default_rng(seed)
        root = square_root(self.estimate.covariance[-n:, -n:])
        root *= (self.errors / np.maximum(np.linalg.norm(root, axis=1), thresholds.TINY))[:, None]
        return np.asarray(self.gains + rng.normal(size=(whole_number("count", count, least=1), n)) @ root.T)

    def report(self) -> str:
        """Text on the gains: accuracy, standard errors, and notes.

        Returns
        -------
        str
            A sentence, a table, then the notes and likely causes of the residuals.
        """
        rows = gain_rows(self.joint_names, self.gains, self.errors)
        count = np.isfinite(self.gains).sum()
        known = percent(self.errors / np.abs(self.gains))
        return self._report(f"gains of {count} of {len(self.gains)} joints, known to {known}", rows)


def identify_drive_gains(
    robot: Robot | Identification,
    without: Record | Sequence[Record] | None,
    with_load: Record | Sequence[Record],
    payload: Payload | Any,
    *,
    drives: DriveModel | None = None,
    cutoff: float | None = None,
    delay: ArrayLike | None = None,
) -> DriveGains:
    """Torque per ampere of each drive, from currents without and with a known load.

    Parameters
    ----------
    robot : Robot or Identification
        The robot without the load, of which only joints and their places need be right; or the result of `rne.identify`
        from the currents without the load.
    without : Record or sequence of Record, or None
        Measured motions without the load, with currents, or other quantities proportional to torques, instead of
        torques; None with an Identification.
    with_load : Record or sequence of Record
        Measured motions with the load; they may differ from those without.
    payload : Payload, PayloadEstimate or float
        The load, weighed: gains are as wrong as its mass is, relatively. Of a mass alone, or a Payload with neither
        centre nor inertia, these are estimated too; otherwise they are taken as given and compared with an estimate.
    drives : DriveModel, optional
        Torques of the drives, by default rotors, viscous and Coulomb friction and offsets; not with an Identification,
        which has its own.
    cutoff : float, optional
        Cut-off of the low-pass filter, by default chosen from the measurements [Hz].
    delay : float or array_like, shape (n,), optional
        Delay of the measured currents of these records after the positions, by default estimated for each record, and
        for a joint where it differs; records of an Identification keep theirs [s].

    Returns
    -------
    DriveGains
        Gains with standard errors; NaN, and a note, for joints whose torque the load does not change by enough.

    Raises
    ------
    TypeError
        If `robot`, a record or `drives` is of another type.
    ValueError
        If a record is of other joints or in both sets, has errors among its findings, or moves no joint; there are
        fewer equations than parameters; `without` or `drives` is missing or given twice; `drives` have friction under
        load; the Identification has instruments; the mass is not positive; the load is on no joint; or numbers are so
        large that the equations overflow (NotFiniteError).
    IdentificationError
        If no gain can be identified, a gain is negative, the fit does not settle, or the currents contradict the load
        as given: an estimate of its centre and inertia changes a gain by more than 10 % and four standard errors.

    Warns
    -----
    IdentificationWarning
        If records that name their joints lack some of the robot's, which are taken as locked; and with
        `DriveGains.doubt`, its text: if a gain is known to no better than 5 %, or more than 30 % of a joint's torque
        in motion is not explained.

    Notes
    -----
    A gain is found if it differs from zero by more than four standard errors. These contain errors of the drives, as
    those of `rne.identify_payload` do, and the change of a gain by an estimate of the load's centre and inertia beyond
    chance. Drives are taken as the same without and with the load. Of coupled motors the gains are those of the joints'
    torques.

    Examples
    --------
    >>> import numpy as np, rne
    >>> arm, motion = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1, 0.9, 0.8, 2, 1, 2], 2.0)
    >>> t, load = np.arange(0, 2, 0.004), rne.Payload(5.0, com=[0.1, 0, 0.1])
    >>> currents = [robot.inverse_dynamics(*motion(t)) / 8 for robot in (arm, arm.with_payload(*load))]
    >>> logs = [rne.identification.Record(t, motion(t)[0], i) for i in currents]
    >>> found = rne.identify_drive_gains(arm, *logs, load, cutoff=20, drives=rne.DriveModel())
    >>> found.gains.round(1).tolist()
    [8.0, 8.0, 8.0, 8.0, 8.0, 8.0]
    >>> print(found.report().split(";")[0][:32])
    gains of 6 of 6 joints, known to
    >>> found.draws(100).shape
    (100, 6)
    """
    from ..simulation.scene import payload_argument

    sets = record_sets(robot, without, with_load, drives, cutoff, delay)
    warn_of_locked(sets.data[0].notes)
    model, names = sets.robot.model, sets.robot.joint_names
    if payload is None:
        raise ValueError(NOT_SEPARABLE)
    load = payload_argument(payload)
    mass = positive_number("payload", load.mass)
    bare = load.inertia is None and not np.any(load.com)
    link = load.link or end_link(model, axes_count=not bare)
    S, first = sets.with_load(link).S, sets.base.count
    weighed = replace(sets, S=S[..., 1:], known=mass * S[..., 0])
    fitted = weighed = weighed.with_delays(first_gains(weighed)[0])
    if bare:
        gains, errors, fit = of_all_joints(weighed)
        com, com_error = (x[first : first + 3] / mass for x in (fit.estimate.values, fit.estimate.errors))
        notes = [f"the load's centre, not given, is found at {place(com)} m of {link}, +- {place(com_error)} m"]
    else:
        of_bodies, com, notes = PARAMETERS * model.nb, np.array(load.com, np.float64), []
        known = np.zeros_like(sets.known)
        known[-1, :of_bodies] = sets.robot.with_payload(*load).parameters - sets.robot.parameters
        fitted = replace(weighed, S=sets.S, known=known)
        gains, errors, fit = of_all_joints(fitted)
        errors = np.hypot(errors, change_by_another_load(weighed, mass, com, gains))
    refuse_negative(names, gains, errors, bare)
    notes = [*fit.notes, *notes]
    if np.isnan(gains).any():
        notes.append(UNTOLD.format(listed([names[j] for j in np.flatnonzero(np.isnan(gains))])))
    common = fit.estimate, fit.held_out, tuple(notes), fitted.in_torques(gains)
    result = DriveGains(*common, names, gains, errors, com, fitted)
    if result.doubt:
        warnings.warn(result.doubt, IdentificationWarning, stacklevel=2)
    return result


def gain_rows(names: Sequence[str], gains: Array, errors: Array) -> list[Row]:
    """Table of gains."""
    rows = [Row("drive gains [N m or N per unit]", ("gain", "standard error"), words=True)]
    for name, gain, error in zip(names, gains, errors, strict=True):
        rows.append(Row(f"  {short(name)}", ("-", "-") if np.isnan(gain) else (f"{gain:.5g}", f"{error:.2g}")))
    return rows


def place(x: Array) -> str:
    """Text of a point."""
    return f"({', '.join(f'{value:.3g}' for value in x)})"


def refuse_negative(names: Sequence[str], gains: Array, errors: Array, bare: bool) -> None:
    """Raise an IdentificationError for negative gains, with likely causes."""
    negative = np.flatnonzero(gains < 0).tolist()
    if not len(negative):
        return
    values = listed([f"{names[j]} {gains[j]:.3g} (+- {errors[j]:.2g})" for j in negative])
    why = f"change the sign of {'its current' if len(negative) == 1 else 'their currents'} in all records"
    if len(negative) == np.isfinite(gains).sum() > 1:
        why = "are the records without and with the load exchanged, or all currents of the wrong sign?"
    elif not bare:
        why += ", or give the mass alone, `payload=mass`: is the load's centre as given?"
    raise IdentificationError(f"gains come out negative: {values}: {why}")


def change_by_another_load(weighed: RecordSets, mass: float, com: Array, gains: Array) -> Array:
    """Significant change of the gains if only the load's mass is taken as given; an error if it is large."""
    K, names = weighed.base.count, weighed.robot.joint_names
    try:
        other, errors, fit = of_all_joints(weighed)
    except IdentificationError:  # not identifiable from these motions
        return np.zeros(len(gains))
    change, errors = np.abs(np.nan_to_num(gains - other)), np.nan_to_num(errors)
    least = np.maximum(thresholds.BEYOND_DOUBT * errors, thresholds.CONTRADICTED * np.abs(np.nan_to_num(other)))
    if len(wrong := np.flatnonzero(change > least)):
        found = listed([f"{names[j]} {gains[j]:.3g}, not {other[j]:.3g} (+- {errors[j]:.2g})" for j in wrong])
        centre = fit.estimate.values[K : K + 3] / mass
        raise IdentificationError(
            f"`payload`: the currents contradict the load as given: gains would be {found}, its centre {place(com)} m, "
            f"not {place(centre)} m. Give its mass alone, `payload={mass:g}`, to have the rest estimated"
        )
    return np.where(change > thresholds.BY_CHANCE * errors, change, 0.0)


def of_all_joints(sets: RecordSets) -> tuple[Array, Array, SetsFit]:
    """Gains and errors by a fit of all joints with common parameters; NaN where they are not identifiable."""
    first = sets.base.count + sets.S.shape[-1]  # of the unknowns that are changes of gains
    gains, states = first_gains(sets)
    for k in range(thresholds.GAIN_ROUNDS):
        scaled = sets.in_torques(gains)
        step = least_squares(scaled.assembled(scaled.plain, states))
        change, told = step.values[first:], step.errors[first:] * thresholds.BEYOND_DOUBT < 1
        settled = np.abs(change[told]).max(initial=0) <= thresholds.GAINS_SETTLED
        if k < thresholds.GAIN_TRIALS and not settled:  # the first steps may lead through poor gains
            told = np.isfinite(gains)
        factor, least = 1 + change, 1 / thresholds.GAIN_GROWTH
        gains = np.where(told, gains / np.where(np.abs(factor) < least, least, factor), np.nan)
        states = sets.states(step.values)
        if told.any() and np.abs(change[told]).max() > thresholds.GAINS_SETTLED:
            continue
        fit = sets.in_torques(gains).fitted(states) if told.any() else None
        errors = np.abs(gains) * (np.inf if fit is None else fit.estimate.errors[first:])
        told &= errors * thresholds.BEYOND_DOUBT < np.abs(gains)
        if fit is None or not told.any():
            raise IdentificationError(NONE_TOLD)
        if (told == np.isfinite(gains)).all():
            return with_random_errors(sets, gains, fit)
        gains = np.where(told, gains, np.nan)
    why = "are its centre, inertia and link right? Give its mass and link alone, `rne.Payload(mass, link=...)`"
    raise IdentificationError(f"`payload`: the fit of gains and parameters together does not settle: {why}")


def with_random_errors(sets: RecordSets, gains: Array, fit: SetsFit) -> tuple[Array, Array, SetsFit]:
    """Gains by further steps of the fit with random errors of the drives."""
    first, told = sets.base.count + sets.S.shape[-1], np.isfinite(gains)
    for k in range(thresholds.REFINED):
        change, errors = fit.estimate.values[first:], fit.estimate.errors[first:]
        gains = gains / (1 + change)
        if k + 1 == thresholds.REFINED or (np.abs(change[told]) <= thresholds.GAIN_STEP * errors[told]).all():
            break
        fit = sets.in_torques(gains).fitted(sets.states(fit.estimate.values))
    return gains, np.where(told, np.abs(gains) * np.hypot(errors, change), np.nan), fit


def first_gains(sets: RecordSets) -> tuple[Array, Array]:
    """Initial gains by the currents that each joint's own fit predicts, and parameters of each set."""
    K, n = sets.base.count, sets.robot.n
    alone = replace(sets, S=np.concatenate([sets.S, sets.known[..., None]], axis=-1), known=0 * sets.known)
    both = alone.assembled(sets.plain)
    own = np.array([alone.states(single_joint_fit(both.of_joint(j))[0]) for j in range(n)])
    silent = sets.in_torques(np.zeros(n))
    x = solve(silent.assembled(silent.plain, -np.moveaxis(own, 0, 1)).merged().weighted(np.ones(n))).x
    return x[K + sets.S.shape[-1] :], sets.states(x)
