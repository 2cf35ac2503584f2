"""Identification: the parameters of a robot's bodies, rotors and friction from measured motions."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import per_joint_array, positive_number
from ..basics.spatial import Array
from ..dynamics.base_inertial_parameters import BaseParameters
from ..errors import IdentificationError, IdentificationWarning
from ..model.parameters import PARAMETERS, parameters_of_pseudo_inertia
from ..model.standard_parameters import MEASURED, DriveModel, StandardParameters, drive_argument
from ..robot import Robot, robot_argument
from .causes import DRIVES, Cause, delay_text, derivative_by, likely_causes, merged_by_kind, sharpened
from .consistent import geometric_prior, model_prior
from .equations import Equations
from .least_squares import LeastSquares, Method, held_out, least_squares, with_correlation
from .record import Record
from .regression import FOLDS, RegressionData, build_regression
from .residuals import Residuals
from .result import IMPOSSIBLE, WRONG_SIGN, Identification
from .rigid_body_test import EXPLAINED

PRIOR_STD = 0.3  # of the prior: that bodies differ from it by 30 % is as likely as one standard deviation of noise
PRIOR_STDS_OF_GUESS = (3.0, 1.0, 0.3, 0.1)  # of bodies guessed from the geometry: the first with plausible masses
BEYOND_DOUBT = 4.0  # standard errors
IMPOSSIBLY = 8.0  # standard errors below zero from which identify warns
ROUNDS = 4  # of taking a cause into account


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
    decimation: int | None = None,
    folds: int = FOLDS,
) -> Identification:
    """Parameters of a robot's bodies, rotors and friction from measured motions.

    Torques are linear in the parameters: Y pi = tau. Weighted least squares, each joint by its own residual, give the
    base parameters, those combinations that torques depend on, with standard errors. The consistent fit then gives
    every body a mass, a centre and an inertia that some distribution of mass has.

    Parameters
    ----------
    robot : Robot
        Its joints and their places are known. Its bodies are the prior, unless `prior` says otherwise.
    records : Record or sequence of Record
        Measured motions.
    drives : DriveModel, optional
        Torques of the drives to find, by default rotors, viscous and Coulomb friction and offsets, as drives of real
        robots have, with the Stribeck effect where the log asks for it; `DriveModel()` for none. What is left out is
        found in other parameters and residuals.
    consistent : bool
        False to skip the physically consistent fit, which needs the extra `identify`.
    prior : Robot or "geometry", optional
        Where the motion says nothing, bodies are like those of this robot; "geometry" guesses rods between the joints
        and finds their density from the measurements.
    prior_std : float, optional
        Standard deviation of the prior, how far bodies are expected to differ from it, relatively: by default 0.3, for
        "geometry" 3, less where torques that are not explained ask for one body heavier than the guess of all.
    minimum_velocity : array_like, shape (n,), optional
        Slower equations of a joint are not fitted, because the direction of Coulomb friction is not known; by default
        2 % of the joint's largest velocity, and what one step of its encoder makes, with Coulomb friction that is not
        smoothed, otherwise 0 [rad/s or m/s].
    delay : float or array_like, shape (n,), optional
        By which torques were measured later than positions, by default estimated for each record, and for a joint where
        it differs [s].
    cutoff : float, optional
        Of the low-pass filter, by default chosen from the measurements [Hz].
    decimation : int, optional
        Samples per equation after the filter; by default from the cut-off.
    folds : int
        Of the cross-validation, contiguous in time: each record is cut into `folds` / number of records, rounded up and
        at least 2, each to be predicted from the others.

    Returns
    -------
    Identification
        Estimates with standard errors, the robot with consistent bodies, predictions, plots and a report.

    Raises
    ------
    ValueError
        If an argument does not fit the robot, or there are fewer equations than parameters.
    IdentificationError
        If the consistent fit does not succeed.
    ImportError
        If Clarabel is not installed and `consistent` is true.

    Warns
    -----
    IdentificationWarning
        If more than 30 % of a joint's torque in motion is not explained, if one change of the robot, the log or the
        drives explains the residuals better, or if a rotor or friction comes out impossible: `Identification.doubt`.

    Notes
    -----
    Gautier and Khalil 1990; Siciliano et al. 2009, section 7.3. Consistency: Wensing, Kim and Slotine 2018; the
    divergence from the prior: Lee, Wensing and Park 2020.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
    >>> w = 2 * np.pi * np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    >>> q, qd, qdd = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
    >>> record = rne.identification.Record(t, q, robot.inverse_dynamics(q, qd, qdd))
    >>> found = rne.identify(robot, record, consistent=False)
    >>> print(found.report().splitlines()[0][:28])
    58 base parameters of irb140
    >>> found.estimate.values.shape, found.predict(q, qd, qdd).shape, found.held_out.shape
    ((58,), (5000, 6), (6,))
    >>> found.check(record).measured.shape[1], len(found.plot().axes)
    (6, 12)
    """
    robot_argument(robot)
    for name, given in (("prior", prior), ("prior_std", prior_std)):
        if given is not None and not consistent:
            raise ValueError(f"`{name}` is for the physically consistent fit: leave it out, or set `consistent=True`")
    known = prior_robot(robot, prior) if consistent else None
    stds = PRIOR_STDS_OF_GUESS if isinstance(prior, str) else (PRIOR_STD,)
    stds = stds if prior_std is None else (positive_number("prior_std", prior_std),)
    options = {"minimum_velocity": minimum_velocity, "cutoff": cutoff, "decimation": decimation, "folds": folds}
    base, data, causes, modelled = explained(robot, records, drives, delay, options)
    standard = base.standard
    guess, notes = (None, ()) if known is None else prior_bodies(known, standard, data.fitted)
    for std in stds:
        method = Method(standard, base, guess, std**-2)
        estimate, parameters = method.solved(data.fitted)
        if guess is None or plausible(parameters, guess, data.fitted):
            break
    correlation_time = data.correlation_time(base.back @ estimate.values)
    estimate = with_correlation(estimate, data.fitted.mapped(base.back), correlation_time)
    estimate = with_estimated(estimate, residuals_of(robot, base, data, estimate), modelled)
    lower, drift_error = data.at_lower_cutoff(base, estimate.sigma * np.sqrt(correlation_time))
    errors = held_out(method, data.fitted, data.measured)
    if std != stds[0]:
        notes += (
            f"prior_std {std:g}: with a larger one, torques that are not explained ask for one body of a mass "
            "above the guess of all",
        )
    notes = (*data.notes, *map(taken_text, modelled), *notes)
    notes += (*ignored_drives(standard), *negative_drives(robot, base, estimate))
    trust = errors, correlation_time, lower - estimate.values, drift_error, merged_by_kind(causes)
    found = Identification(robot, standard, base, data, estimate, parameters, consistent, *trust, notes)
    if found.doubt:
        warnings.warn(found.doubt, IdentificationWarning, stacklevel=2)
    return found


def explained(
    robot: Robot,
    records: Record | Sequence[Record],
    drives: DriveModel | None,
    delay: ArrayLike | None,
    options: dict[str, Any],
) -> tuple[BaseParameters, RegressionData, tuple[Cause, ...], list[Cause]]:
    """The equations with the delays and Stribeck effects that they ask for, what causes the rest, what is modelled."""
    delays = np.zeros((len(records) if isinstance(records, Sequence) else 1, robot.n))
    if delay is not None:
        delays = delays + per_joint_array("delay", delay, robot.n)
    free = {"delay": delay is None, "Stribeck friction": drives is None}  # what may be taken into account
    drives = MEASURED if drives is None else drive_argument(drives)
    modelled: dict[tuple[str, tuple[str, ...], float], Cause] = {}
    for k in range(ROUNDS + 1):
        base = robot.base_parameters(drives=drives)
        data = build_regression(robot, records, base, **options, delays=delays)
        rest = residuals_of(robot, base, data, least_squares(data.fitted.mapped(base.back)))
        causes = likely_causes(rest)
        found = [cause for cause in causes if free.get(cause.kind)]
        if k == ROUNDS or not found or found[0].score < causes[0].score / 2:
            break
        if found[0].kind == "delay":
            best, key = found[0], ("delay", found[0].joints, found[0].at)
            joints = best.joints if np.isnan(best.at) else ()
            delays = delays + delay_of(robot, best, len(delays))
            total = best.value + (modelled[key].value if key in modelled else 0.0)
            modelled[key] = best._replace(value=total, text=delay_text(joints)(np.array([total])))
        else:
            sharp = [sharpened(rest, cause) for cause in found if cause.kind == found[0].kind]
            drives = with_stribeck(robot, drives, sharp)
            modelled |= {(cause.kind, cause.joints, np.nan): cause for cause in sharp}
    return base, data, causes, list(modelled.values())


def with_estimated(estimate: LeastSquares, rest: Residuals, modelled: Sequence[Cause]) -> LeastSquares:
    """Standard errors with those of the delays and Stribeck velocities that were estimated too."""
    if not modelled:
        return estimate
    columns = np.concatenate([derivative_by(rest, cause) for cause in modelled], axis=-1)
    covariance = estimate.covariance + rest.covariance_of(columns)
    errors = np.where(np.isinf(estimate.errors), np.inf, np.sqrt(np.diag(covariance)))
    return replace(estimate, covariance=covariance, errors=errors)


def taken_text(cause: Cause) -> str:
    """What is taken into account, with its standard error."""
    name, error = cause.kind, f"{cause.error:.2g}"
    if cause.kind == "delay":
        name, error = f"delay of {1000 * cause.value:.3g} ms", f"{1000 * cause.error:.2g} ms"
    return f"{name}: {cause.text} (+- {error}); taken into account"


def residuals_of(robot: Robot, base: BaseParameters, data: RegressionData, found: LeastSquares) -> Residuals:
    """What least squares left."""
    correlation_time = data.correlation_time(base.back @ found.values)
    return Residuals(robot, base, data.prepared, data.rows, found.values, found.sigma, correlation_time)


def delay_of(robot: Robot, cause: Cause, count: int) -> Array:
    """The delay that a cause tells, shape (records, n)."""
    joints = np.isin(robot.joint_names, cause.joints)
    records = np.ones(count) if np.isnan(cause.at) else np.arange(count) == cause.at
    return cause.value * np.outer(records, joints)


def with_stribeck(robot: Robot, drives: DriveModel, causes: Sequence[Cause]) -> DriveModel:
    """The drives with the Stribeck velocities of these causes."""
    velocities = np.zeros(robot.n) if drives.stribeck is None else np.array(drives.stribeck, np.float64)
    for cause in causes:
        velocities[robot.joint_names.index(cause.joints[0])] = cause.at
    return replace(drives, stribeck=velocities)


def ignored_drives(standard: StandardParameters) -> tuple[str, ...]:
    """Rotors and friction that the given model has and that were not asked for: the robot found is without them."""
    model = standard.model
    known = {"Ia": model.armature, "Fv": model.damping, "Fc": model.friction}
    return tuple(
        f"{DRIVES[symbol][0]} of the model was not fitted: what there is of it is in other parameters, and the robot "
        "found has none"
        for symbol, values in known.items()
        if symbol not in standard.terms and values.any()
    )


def negative_drives(robot: Robot, base: BaseParameters, estimate: LeastSquares) -> tuple[str, ...]:
    """Rotors and friction that come out negative beyond doubt: a torque of the wrong sign does this."""
    bodies, found = PARAMETERS * robot.model.nb, []
    for k, name in enumerate(base.names):
        value, error = estimate.values[k], estimate.errors[k]
        if base.independent[k] >= bodies and not name.startswith("tau0") and value < -BEYOND_DOUBT * error:
            far = f", {IMPOSSIBLE}" if value < -IMPOSSIBLY * error else ""
            found.append(f"{name} comes out negative, {value:.3g} with a standard error of {error:.2g}{far}")
    has_friction = any(name.startswith(("Fv", "Fc")) for name in found)
    return (*found, f"negative friction: {WRONG_SIGN}") if has_friction else tuple(found)


def prior_robot(robot: Robot, prior: Robot | str | None) -> Robot | str:
    """The robot whose bodies are the prior, checked, or "geometry"."""
    if isinstance(prior, str) and prior == "geometry":
        return prior
    known = robot if prior is None else prior
    if not isinstance(known, Robot):
        raise TypeError(f"`prior` must be an rne.Robot or 'geometry', got {known!r}")
    if known.model.moving_joints != robot.model.moving_joints:
        raise ValueError(f"`prior` must have the joints {list(robot.model.moving_joints)}")
    if not known.model.mass.any():
        raise ValueError(
            "`prior` must have masses, which the robot does not: give another robot, or 'geometry' for rods between "
            "the joints, or `consistent=False`"
        )
    return known


def prior_bodies(known: Robot | str, standard: StandardParameters, fitted: Equations) -> tuple[Array, tuple[str, ...]]:
    """Pseudo-inertias to start from, and what to say of them."""
    if isinstance(known, str):
        bodies = geometric_prior(standard.model)
        density = found_density(bodies, standard, fitted)
        return density * bodies, (f"prior: rods between the joints, {density:.4g} kg in all",)
    bodies, thickened = model_prior(known.model)
    return bodies, tuple(f"prior: the body of {name} was too thin and was made thicker" for name in thickened)


def plausible(parameters: Array, guess: Array, fitted: Equations) -> bool:
    """False if torques that are not explained make one body heavier than all together are guessed to be."""
    explained = fitted.residuals(parameters) <= EXPLAINED**2 * fitted.torques()
    masses = parameters[: PARAMETERS * len(guess) : PARAMETERS]
    return bool(explained.all() or masses.max(initial=0) <= guess[:, 3, 3].sum())


def found_density(bodies: Array, standard: StandardParameters, fitted: Equations) -> float:
    """The factor of guessed bodies with which torques are fitted best."""
    drives = standard.count - PARAMETERS * standard.model.nb
    E = np.zeros((standard.count, 1 + drives))
    E[: -drives or None, 0] = parameters_of_pseudo_inertia(bodies)
    E[standard.count - drives :, 1:] = np.eye(drives)
    density = float(least_squares(fitted.mapped(E)).values[0])
    if density <= 0:
        raise IdentificationError(
            f"`prior` 'geometry': the torques ask for bodies of {density:.4g} kg in all; check the signs of torques "
            "and of gravity"
        )
    return density
