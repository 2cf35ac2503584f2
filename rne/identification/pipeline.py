"""Identification as a pipeline: read, clean, filter, regressor, fit, consistent bodies, diagnosis, report.

    stage       by                                  gives
    read        Record.from_log, Record             measured positions and torques
    clean       Record.cleaned                      a grid of equal steps, and findings
    filter      Record.prepare                      velocities, accelerations, a low-pass filter: Prepared
    regressor   regression                          Y x = tau in folds of time: RegressionData
    fit         fit_base_parameters                 base parameters with standard errors: LeastSquares
    consistent  fit_bodies                          masses, centres and inertias: BodiesFit
    diagnose    diagnose                            likely causes of the residuals
    report      assemble                            Identification: report, plot, predict, scene, to_urdf

Each may be called by itself. `identify` is all of them, with the assumptions of a `FitModel` found from the residuals.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number
from ..basics.inertia import PARAMETERS
from ..dynamics.base_inertial_parameters import BaseParameters
from ..errors import IdentificationError, IdentificationWarning
from ..model.standard_parameters import DriveModel, StandardParameters
from ..robot import Robot, robot_argument
from . import thresholds
from .diagnosis.hypotheses import (
    DRIVES,
    GEARS,
    Cause,
    Hypothesis,
    delay_text,
    derivative_by,
    hypotheses_argument,
    likely_causes,
    merged_by_kind,
)
from .diagnosis.residuals import FitResiduals
from .fit.bodies import BodiesFit, fit_bodies, possible_bodies, prior_of_bodies, prior_robot
from .fit.equations import (
    EARLY,
    MEASURED,
    Motion,
    RegressionData,
    build_regression,
    checked_records,
    delay_argument,
    of_named_joints,
    warn_of_locked,
)
from .fit.instruments import cutoff_of_instruments, motions_of
from .fit.least_squares import LeastSquares, Unexplained, fit_base_parameters
from .fit_model import Fit, FitModel, settled
from .log.record import Record
from .result import IMPOSSIBLE, NAMED, NOT_CONSISTENT, NOT_SOUGHT, WRONG_SIGN, Identification

if TYPE_CHECKING:
    from ..simulation.springs import JointSpring, Spring, Springs

Instruments = Motion | ArrayLike | Sequence[Motion | ArrayLike]
FROM_INSTRUMENTS = "the cut-off is that of the motion of the instruments, in which there is no noise"
NO_ROTORS = (
    "rotors are not fitted: none is significantly different from zero, or reaches 10 % of its joint's inertia, as "
    "where torques are measured behind the gears"
)


def regression(
    robot: Robot,
    records: Record | Sequence[Record],
    base: BaseParameters,
    *,
    minimum_velocity: ArrayLike | None = None,
    cutoff: float | None = None,
    delay: ArrayLike | None = None,
    folds: int = thresholds.FOLDS,
) -> RegressionData:
    """Equations Y x = tau of measured motions, filtered, in folds of time.

    Parameters
    ----------
    robot : Robot
        The robot, of which joints and their places are known.
    records : Record or sequence of Record
        Measured motions of its joints, in its order.
    base : BaseParameters
        Of `robot.base_parameters(drives=...)`: the columns of Y are those of its standard parameters.
    minimum_velocity, cutoff, delay : optional
        As of `rne.identify`; the delay is zero by default.
    folds : int
        Blocks of time, as of `rne.identify`.

    Returns
    -------
    RegressionData
        Y, shape (rows, n, P), and tau, shape (rows, n), of all records; which rows are used; and their triangular
        factors by joint and fold, which the fits take.

    Raises
    ------
    TypeError, ValueError
        As of `rne.identify`.

    Notes
    -----
    Gautier, Janot and Vandanjon 2013: torques and the columns of Y pass the same filter.

    Examples
    --------
    >>> base = robot.base_parameters(drives=rne.DriveModel(friction="viscous+coulomb"))  # doctest: +SKIP
    >>> data = rne.identification.regression(robot, record, base, cutoff=10.0)  # doctest: +SKIP
    """
    given = checked_records(robot_argument(robot), records)
    late = delay_argument(delay, robot.n)
    return build_regression(robot, given, base, minimum_velocity, cutoff, folds, late)


def diagnose(
    robot: Robot, base: BaseParameters, data: RegressionData, hypotheses: Sequence[Hypothesis] = ()
) -> tuple[Cause, ...]:
    """Likely causes of the residuals of a fit: of the log, of the robot, of the drives.

    Parameters
    ----------
    robot : Robot
        The robot.
    base : BaseParameters
        The combinations of parameters that were fitted.
    data : RegressionData
        The equations, of `regression`.
    hypotheses : sequence of Hypothesis
        Causes that are tried in addition to the known ones.

    Returns
    -------
    tuple of Cause
        Those that improve the prediction of blocks of time that were not fitted, the likeliest first.

    Examples
    --------
    >>> [cause.text for cause in rne.identification.diagnose(robot, base, data)]  # doctest: +SKIP
    """
    estimate = fit_base_parameters(base, data)
    rest = FitResiduals(robot_argument(robot), base, data, estimate.values, estimate.sigma)
    return merged_by_kind(likely_causes(rest, hypotheses_argument(hypotheses))[0])


def assemble(
    robot: Robot,
    data: RegressionData,
    bodies: BodiesFit,
    *,
    causes: Sequence[Cause] = (),
    modelled: Sequence[Cause] = (),
    unexplained: Unexplained | None = None,
    notes: Sequence[str] | None = None,
) -> Identification:
    """The result of an identification from the results of its stages.

    Parameters
    ----------
    robot : Robot
        The robot as it was given.
    data : RegressionData
        The equations, of `regression`.
    bodies : BodiesFit
        The parameters, of `fit_bodies`.
    causes : sequence of Cause
        Likely causes of the residuals, of `diagnose`.
    modelled : sequence of Cause
        Delays and Stribeck effects that were found from the residuals and are part of the model: standard errors
        contain theirs.
    unexplained : Unexplained, optional
        The validation error, `bodies.validation_error(data)` by default.
    notes : sequence of str, optional
        Further texts of the report, by default the notes of `data` and `bodies`.

    Returns
    -------
    Identification
        Estimates with standard errors, predictions, plots and a report.

    Examples
    --------
    >>> print(rne.identification.assemble(robot, data, bodies).report())  # doctest: +SKIP
    """
    base = bodies.estimator.base
    errors = bodies.validation_error(data) if unexplained is None else unexplained
    estimate = fit_base_parameters(base, data)
    correlation_time = data.correlation_time(data.residuals(base.back @ estimate.values))
    if modelled:
        rest = FitResiduals(robot, base, data, estimate.values, estimate.sigma, correlation_time)
        columns = np.concatenate([derivative_by(rest, cause) for cause in modelled], axis=-1)
        estimate = estimate.with_covariance(estimate.covariance + rest.covariance_of(columns))
    lower, drift_error = data.at_lower_cutoff(base, estimate.sigma * np.sqrt(correlation_time))
    told = (*data.notes, *bodies.notes) if notes is None else tuple(notes)
    told += (*ignored_drives(base.standard), *negative_drives(robot, base, estimate))
    trust = errors, correlation_time, lower - estimate.values, drift_error, tuple(causes)
    fitted = base.standard, base, data, estimate, bodies.parameters, bodies.consistent
    std = bodies.estimator.weight**-0.5 if bodies.consistent else thresholds.PRIOR_STD
    return Identification(robot, *fitted, *trust, told, float(std))


def identify(
    robot: Robot,
    records: Record | Sequence[Record],
    *,
    drives: DriveModel | None = None,
    consistent: bool = True,
    prior: Robot | str | None = None,
    prior_std: float | None = None,
    minimum_velocity: ArrayLike | None = None,
    delay: ArrayLike | None = None,
    cutoff: float | None = None,
    folds: int = thresholds.FOLDS,
    hypotheses: Sequence[Hypothesis] = (),
    causes: bool = True,
    springs: Sequence[Spring | JointSpring] = (),
    instruments: Instruments | None = None,
) -> Identification:
    """Parameters of a robot's bodies, rotors and friction from measured motions.

    Torques are linear in the parameters: Y pi = tau. Weighted least squares, each joint by its own residual, give the
    base parameters, those combinations that torques depend on, with standard errors. The consistent fit then gives
    every body a mass, a centre and an inertia that some distribution of mass has.

    Parameters
    ----------
    robot : Robot
        The robot, of which joints and their places are known. Its bodies are the prior unless `prior` is given. Of
        joints that mimic others at a constant ratio, rotors and friction count at these; those of joints that follow by
        linkages and other functions (`rne.model.coupled`) are not found.
    records : Record or sequence of Record
        Measured motions.
    drives : DriveModel, optional
        Torques of the drives to find, by default rotors, viscous and Coulomb friction and offsets, as drives of real
        robots have, with the Stribeck effect where the log needs it; `DriveModel()` for none. Omitted torques
        appear in other parameters and residuals.
    consistent : bool
        False to skip the physically consistent fit, which needs the extra `identify`.
    prior : Robot or "geometry", optional
        Where the motion is not informative, bodies are like those of this robot; "geometry" guesses rods between the
        joints and finds their density from the measurements.
    prior_std : float, optional
        Standard deviation of the prior, how far bodies are expected to differ from it, relatively: by default 0.3, for
        "geometry" 3, less where torques that are not explained ask for one body heavier than the guess for all.
    minimum_velocity : array_like, shape (n,), optional
        Slower equations of a joint are not fitted, because the direction of Coulomb friction is not known; by default
        2 % of the joint's largest velocity, and what one step of its encoder makes, with Coulomb friction that is not
        smoothed, otherwise 0 [rad/s or m/s].
    delay : float or array_like, shape (n,), optional
        Delay of the measured torques after the positions, by default estimated for each record, and for a joint where
        it differs [s].
    cutoff : float, optional
        Cut-off of the low-pass filter [Hz]. By default that of the spectrum, as `Record.prepare` chooses it; where more
        than 5 % of a torque is then unexplained, it is halved as long as the validation error decreases: noise that a
        controller feeds back is in torques and positions alike, and no spectrum shows it.
    folds : int
        Blocks of time of the cross-validation: each record is cut into `folds` / number of records, rounded up and
        at least 2, each to be predicted from the others.
    hypotheses : sequence of Hypothesis
        Causes of residuals that are tried in addition to the known ones.
    causes : bool
        False to search for no causes of the residuals, which takes most of the time where these are large. Delays, the
        Stribeck effect and missing rotors are found in any case.
    springs : sequence of Spring
        Springs whose places are known and whose stiffness and length are found, whatever numbers they are given, at
        their given force; of springs at joints, and of those without length, only the stiffness. A rest of a joint that
        is given wrongly is found as an offset.
    instruments : callable or array_like, shape (T, n), or a sequence of one for each record, optional
        A motion without noise that resembles the measured one: what the controller was to follow, or a simulation of
        the loop; a function of time, such as those of `rne.trajectories` and a Trajectory, or positions at the times of
        the record [rad or m]. Estimates then are by instrumental variables, which noise of the positions, fed back by
        the controller or not, does not bias. Of the causes only delays are looked for.

    Returns
    -------
    Identification
        Estimates with standard errors, the robot with consistent bodies, predictions, plots and a report.

    Raises
    ------
    TypeError
        If `robot`, `records`, `drives`, `prior`, `hypotheses` or `instruments` are of another type.
    ValueError
        If an argument has a wrong value or shape, or excludes another; records lack joints and have others that the
        robot does not have, or have errors among their findings; no joint moves; there are fewer equations than
        parameters; `instruments` do not resemble the measured motion; a joint that follows others has no position at
        those measured, or numbers are so large that the equations overflow (NotFiniteError).
    IdentificationError
        If `prior` is "geometry" and the torques ask for bodies of negative mass.
    ImportError
        If Clarabel is not installed and `consistent` is true.

    Warns
    -----
    IdentificationWarning
        If records that name their joints lack some of the robot's, which are taken as locked at zero, or at the end of
        their range next to it; and with `Identification.doubt`, its text: if more than 30 % of a joint's torque in
        motion is not explained, one change of the robot, the log or the drives explains the residuals better, the
        motion excites too little, no possible bodies are found, or a rotor, friction or spring comes out impossible.

    Notes
    -----
    Gautier and Khalil 1990; Siciliano et al. 2009, section 7.3. Consistency: Wensing, Kim and Slotine 2018; the
    divergence from the prior: Lee, Wensing and Park 2020. Instruments: Janot, Vandanjon and Gautier 2014.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
    >>> w = 2 * np.pi * np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    >>> q, qd, qdd = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
    >>> record = rne.identification.Record(t, q, robot.inverse_dynamics(q, qd, qdd))
    >>> found = rne.identify(robot, record, consistent=False)
    >>> print(found.report()[:21])
    good for feed-forward
    >>> found.estimate.values.shape, found.predict(q, qd, qdd).shape, found.validation_error.shape
    ((54,), (5000, 6), (6,))
    >>> found.check(record).measured.shape[1], len(found.plot().axes)
    (6, 12)
    >>> found.essential().base.names, found.to_urdf(), found.kernel(std=True).source("c")  # doctest: +SKIP
    >>> found.save("found.npz"), rne.Identification.load("found.npz")  # doctest: +SKIP
    >>> run = rne.ensemble(found.scene(), q0, qd0, duration=1.0, numbers=found.draws(100))  # doctest: +SKIP
    """
    whole = robot_argument(robot)
    robot, records, matched = of_named_joints(whole, records)
    warn_of_locked(matched)
    fitted = fitted_springs(springs, whole, robot)
    for name, given in (("prior", prior), ("prior_std", prior_std)):
        if given is not None and not consistent:
            raise ValueError(f"`{name}` is for the physically consistent fit: leave it out, or set `consistent=True`")
    known = prior_robot(robot.model, robot if prior is None else prior) if consistent else None
    if prior_std is not None:
        positive_number("prior_std", prior_std)
    records = checked_records(robot, records)
    motions = motions_of(instruments, records)
    if motions and cutoff is None:
        cutoff, matched = cutoff_of_instruments(records, motions), (*matched, FROM_INSTRUMENTS)
    tried = tried_hypotheses(hypotheses, bool(motions), causes=causes)
    delays = np.zeros((len(records), robot.n)) + delay_argument(delay, robot.n)
    assumed = MEASURED if drives is None else drives, delays, cutoff, fitted, motions, minimum_velocity, folds, tried
    fit = settled(FitModel(robot, records, *assumed, finds_delays=delay is None, finds_drives=drives is None))
    bodies, errors = validated_bodies(fit, known, prior_std)
    notes = (*matched, *notes_of_fit(fit), *bodies.notes)
    likely = merged_by_kind(fit.causes) if causes else ()
    found = assemble(robot, fit.data, bodies, causes=likely, modelled=fit.modelled, unexplained=errors, notes=notes)
    if not causes:
        found = replace(found, notes=(*found.notes, NOT_SOUGHT))
    if found.doubt:
        warnings.warn(found.doubt, IdentificationWarning, stacklevel=2)
    return found


def validated_bodies(fit: Fit, prior: Robot | str | None, prior_std: float | None) -> tuple[BodiesFit, Unexplained]:
    """Bodies and their validation error; by least squares where no possible bodies fit the torques."""
    notes: tuple[str, ...] = ()
    if prior is not None:
        given = prior_of_bodies(prior, prior_std, fit.base, fit.data)
        try:
            bodies = possible_bodies(fit.base, fit.data, given)
            return bodies, bodies.validation_error(fit.data)
        except IdentificationError as error:
            notes = (f"{NOT_CONSISTENT}: {error}",)
    plain = fit_bodies(fit.base, fit.data, prior=None)._replace(notes=notes)
    return plain, plain.validation_error(fit.data)


def tried_hypotheses(
    hypotheses: Sequence[Hypothesis], are_instruments: bool, *, causes: bool
) -> tuple[Hypothesis, ...] | None:
    """Argument `hypotheses`, checked; None if no causes are looked for."""
    if hypotheses and not causes:
        raise ValueError("`hypotheses` are tried as causes: leave them out, or set `causes=True`")
    tried = hypotheses_argument(hypotheses) if causes else None
    if tried and are_instruments:
        raise ValueError("`hypotheses` are judged by least squares, which `instruments` replace: leave out one of them")
    return tried


def fitted_springs(springs: Sequence[Spring | JointSpring], robot: Robot, moved: Robot) -> Springs | None:
    """Springs to be found, at joints that are not locked, checked."""
    from ..simulation.springs import resolved_springs

    found = resolved_springs(springs, robot, moved)
    for k, spring in enumerate(springs):
        if spring.damping:
            raise ValueError(f"`springs[{k}]` must have no damping, which is not found, got {spring.damping:g}")
    return found


def notes_of_fit(fit: Fit) -> tuple[str, ...]:
    """Notes on the equations, on modelled effects, and on neglected ones."""
    period = max(1 / record.sample_rate for record in fit.data.prepared)
    is_early = any(cause.kind == "delay" and cause.value < -period for cause in fit.modelled)
    early = (EARLY,) * (is_early and not fit.model.motions)
    declined = (NO_ROTORS,) * (fit.model.finds_drives and not fit.model.drives.rotor)
    return (*early, *fit.data.notes, *map(taken_text, fit.modelled), *declined, *small_text(fit.likely[1]))


def taken_text(cause: Cause) -> str:
    """Text of a modelled delay or Stribeck effect, with its standard error."""
    if cause.kind == "delay":
        text = delay_text(cause.joints if np.isnan(cause.at) else ())(np.array([cause.value]))
        return f"delay of {1000 * cause.value:.3g} ms: {text} (+- {1000 * cause.error:.2g} ms); taken into account"
    return f"{cause.kind}: {cause.text} (+- {cause.error:.2g}); taken into account"


def small_text(causes: Sequence[Cause]) -> tuple[str, ...]:
    """Note on causes of small effect, without the usual friction of gears."""
    told = merged_by_kind([cause for cause in causes if cause.kind not in GEARS])[:NAMED]
    texts = [f"{cause.text} (validation error {cause.effect})" for cause in told]
    return (f"evident, but of little effect, no likely causes: {'; '.join(texts)}",) * bool(texts)


def ignored_drives(standard: StandardParameters) -> tuple[str, ...]:
    """Note on rotors and friction of the given model that were not asked for: the robot found has none."""
    model = standard.model
    known = {"Ia": model.armature, "Fv": model.damping, "Fc": model.friction}
    ignored = [DRIVES[symbol] for symbol, x in known.items() if symbol not in standard.terms and x.any()]
    text = "{} of the model was not fitted: what there is of it is in other parameters, and the robot found has none"
    return tuple(map(text.format, ignored))


def negative_drives(robot: Robot, base: BaseParameters, estimate: LeastSquares) -> tuple[str, ...]:
    """Notes on significantly negative rotors and friction, as by torques of the wrong sign."""
    found = []
    for k, name, value, error in zip(base.independent, base.names, estimate.values, estimate.errors, strict=True):
        free = name.startswith(("tau0", "c_"))  # of any sign
        if k >= PARAMETERS * robot.model.nb and not free and value < -thresholds.BEYOND_DOUBT * error:
            far = f", {IMPOSSIBLE[name.startswith('k_')]}" if value < -thresholds.IMPOSSIBLY * error else ""
            found.append(f"{name} comes out negative, {value:.3g} with a standard error of {error:.2g}{far}")
    has_friction = any(name.startswith(("Fv", "Fc", "Fl")) for name in found)
    return (*found, f"negative friction: {WRONG_SIGN}") if has_friction else tuple(found)
