"""Identification: the parameters of a robot's bodies, rotors and friction from measured motions."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, real_array
from ..basics.spatial import Array
from ..basics.text import counted
from ..dynamics.base_inertial_parameters import BaseParameters, with_springs
from ..errors import IdentificationError, IdentificationWarning
from ..model.parameters import PARAMETERS, parameters_of_pseudo_inertia
from ..model.standard_parameters import MEASURED, DriveModel, StandardParameters, drive_argument
from ..robot import Robot
from ..simulation.springs import JointSpring, Spring, Springs, resolved_springs
from . import thresholds
from .diagnosis.hypotheses import (
    DRIVES,
    GEARS,
    STRIBECK,
    Cause,
    Hypothesis,
    added_delay,
    delay_text,
    delays_by_instruments,
    delays_of,
    derivative_by,
    hypotheses_argument,
    likely_causes,
    linear_causes,
    merged_by_kind,
    refine,
)
from .diagnosis.residuals import FitResiduals
from .fit.consistent import geometric_prior, model_prior
from .fit.equations import (
    EARLY,
    Equations,
    Motion,
    RegressionData,
    along,
    build_regression,
    checked_records,
    delay_argument,
    fitted_robot,
    of_named_joints,
    warn_of_locked,
)
from .fit.least_squares import Estimator, LeastSquares, held_out, least_squares, with_correlation
from .log.record import Record
from .result import IMPOSSIBLE, NAMED, NOT_CONSISTENT, NOT_SOUGHT, WRONG_SIGN, Identification

Instruments = Motion | ArrayLike | Sequence[Motion | ArrayLike]
KINDS_OF_INSTRUMENTS = (
    "`instruments` must be, for each record, a function of time that returns q, qd and qdd, a Trajectory, or positions "
    "at the record's times, shape (T, n), without the noise of the measured ones"
)
FROM_INSTRUMENTS = "the cut-off is that of the motion of the instruments, in which there is no noise"
NO_ROTORS = (
    "rotors are not fitted: none is told from zero, or reaches 10 % of its joint's inertia, as where torques are "
    "measured behind the gears"
)


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
        The robot, of which joints and their places are known. Its bodies are the prior unless `prior` is given.
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
        Cut-off of the low-pass filter [Hz]. By default that of the spectrum, as `Record.prepare` chooses it; where more
        than 5 % of a torque is then left, it is halved as long as the fit predicts blocks of time better that it has
        not seen: noise that a controller feeds back is in torques and positions alike, and no spectrum tells it.
    folds : int
        Blocks of time of the cross-validation: each record is cut into `folds` / number of records, rounded up and
        at least 2, each to be predicted from the others.
    hypotheses : sequence of Hypothesis
        Causes of residuals that are tried beside those that are known.
    causes : bool
        False to look for no causes of what is left, which takes most of the time where much is left. Delays, the
        Stribeck effect and missing rotors are found in any case.
    springs : sequence of Spring
        Springs whose places are known and whose stiffness and length are found, whatever numbers they are given, at
        their given force; of springs at joints, and of those without length, the stiffness alone. A rest of a joint
        that is given wrongly is found as an offset.
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
        robot does not know, or have errors among their findings; no joint moves; there are fewer equations than
        parameters; `instruments` do not resemble the measured motion; joints of the robot are coupled (ModelError); or
        numbers are so large that the equations overflow (NotFiniteError).
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
    >>> found.estimate.values.shape, found.predict(q, qd, qdd).shape, found.held_out.shape
    ((54,), (5000, 6), (6,))
    >>> found.check(record).measured.shape[1], len(found.plot().axes)
    (6, 12)
    """
    whole = fitted_robot(robot)
    robot, records, matched = of_named_joints(whole, records)
    warn_of_locked(matched)
    fitted = fitted_springs(springs, whole, robot)
    for name, given in (("prior", prior), ("prior_std", prior_std)):
        if given is not None and not consistent:
            raise ValueError(f"`{name}` is for the physically consistent fit: leave it out, or set `consistent=True`")
    known = prior_robot(robot, prior) if consistent else None
    stds = thresholds.PRIOR_STDS_OF_GUESS if isinstance(prior, str) else (thresholds.PRIOR_STD,)
    stds = stds if prior_std is None else (positive_number("prior_std", prior_std),)
    options: dict[str, Any] = {"minimum_velocity": minimum_velocity, "cutoff": cutoff, "folds": folds}
    motions = motions_of(instruments, checked_records(robot, records))
    if motions and cutoff is None:
        options["cutoff"] = cutoff_of_instruments(records, motions)
    options |= {"instruments": motions}
    tried = hypotheses_argument(hypotheses) if causes else None
    if hypotheses and not causes:
        raise ValueError("`hypotheses` are tried as causes: leave them out, or set `causes=True`")
    if tried and motions:
        raise ValueError("`hypotheses` are judged by least squares, which `instruments` replace: leave out one of them")
    base, data, likely, modelled, declined = fit_with_delays(robot, records, drives, delay, options, tried, fitted)
    standard = base.standard
    guess, notes = (None, ()) if known is None else prior_bodies(known, standard, data.fitted)
    try:
        for std in stds:
            estimator = Estimator(base, guess, std**-2)
            estimate, parameters = estimator.fit(data.fitted)
            if guess is None or plausible(parameters, guess, data.fitted):
                break
        errors = held_out(estimator, data.fitted, data.measured)
    except IdentificationError as error:  # of torques that no bodies have, of which the causes say more
        consistent, estimator, std = False, Estimator(base, None, 1.0), stds[0]
        notes = (f"{NOT_CONSISTENT}: {error}",)
        estimate, parameters = estimator.fit(data.fitted)
        errors = held_out(estimator, data.fitted, data.measured)
    correlation_time = data.correlation_time(data.residuals(base.back @ estimate.values))
    estimate = with_correlation(estimate, data.fitted.mapped(base.back), correlation_time)
    if modelled:  # standard errors with those of the delays and Stribeck velocities that were estimated too
        rest = FitResiduals(robot, base, data, estimate.values, estimate.sigma, correlation_time)
        columns = np.concatenate([derivative_by(rest, cause) for cause in modelled], axis=-1)
        estimate = estimate._with_covariance(estimate.covariance + rest.covariance_of(columns))
    lower, drift_error = data.at_lower_cutoff(base, estimate.sigma * np.sqrt(correlation_time))
    if std != stds[0]:
        why = "with a larger one, torques that are not explained ask for one body of a mass above the guess of all"
        notes += (f"prior_std {std:g}: {why}",)
    matched += (FROM_INSTRUMENTS,) * (bool(motions) and cutoff is None)
    period = max(1 / record.sample_rate for record in data.prepared)
    is_early = not motions and any(c.kind == "delay" and c.value < -period for c in modelled)
    matched += (EARLY,) * is_early
    notes = (*matched, *data.notes, *map(taken_text, modelled), *declined, *notes)
    notes += (*ignored_drives(standard), *negative_drives(robot, base, estimate), *[NOT_SOUGHT] * (not causes))
    trust = errors, correlation_time, lower - estimate.values, drift_error, merged_by_kind(likely)
    found = Identification(robot, standard, base, data, estimate, parameters, consistent, *trust, notes)
    if found.doubt:
        warnings.warn(found.doubt, IdentificationWarning, stacklevel=2)
    return found


def fit_with_delays(
    robot: Robot,
    records: Sequence[Record],
    drives: DriveModel | None,
    delay: ArrayLike | None,
    options: dict[str, Any],
    hypotheses: Sequence[Hypothesis] | None,
    springs: Springs | None = None,
) -> tuple[BaseParameters, RegressionData, tuple[Cause, ...], list[Cause], tuple[str, ...]]:
    """The equations with delays, Stribeck effects and rotors as they show in the residuals, found in a few rounds.

    Returns the base parameters, the equations, the causes of what is left, those that are modelled, and notes. Without
    `hypotheses`, no causes but those that may be modelled are looked for.
    """
    delays = np.zeros((len(records), robot.n)) + delay_argument(delay, robot.n)
    is_open = drives is None  # to Stribeck effects and fewer rotors
    drives = MEASURED if drives is None else drive_argument(drives)
    late: dict[tuple[Any, ...], Cause] = {}
    sharp: dict[tuple[str, ...], Cause] = {}
    for k in range(thresholds.DELAY_ROUNDS + 1):
        base = robot.base_parameters(drives=drives)
        base = base if springs is None else with_springs(base, springs)
        data, estimate = fit_with_loads(robot, records, base, options | {"delays": delays})
        if not k:
            lower = data if options["cutoff"] else with_lower_cutoff(robot, records, base, data, options)
            options, notes = options | {"cutoff": [r.cutoff for r in lower.prepared]}, [r.notes for r in lower.prepared]
            if lower is not data:
                data, estimate = fit_with_loads(robot, records, base, options | {"delays": delays})
        rest = FitResiduals(robot, base, data, estimate.values, estimate.sigma)
        is_last = k == thresholds.DELAY_ROUNDS
        found: list[Cause] = []
        causes: tuple[Cause, ...] = ()
        small: tuple[Cause, ...] = ()
        if not is_last and delay is None:
            motions = zip(data.prepared, options["instruments"], strict=False)
            moved = [along(record, motion) for record, motion in motions]
            found = delays_by_instruments(rest, moved) if moved else delays_of(rest.beyond_friction)
        if not found and data.Z is None:
            linear = linear_causes(rest, hypotheses)
            if linear.leading is not None and not is_last and delay is None:  # which may hide a delay
                found = delays_of(rest.beyond_friction.with_known(linear.leading))
            causes, small = ((), ()) if found else likely_causes(rest, hypotheses, linear)
        for cause in found:
            delays = delays + added_delay(cause, len(delays), robot.joint_names)
            key = cause.joints, str(cause.at)
            late[key] = cause._replace(value=cause.value + (late[key].value if key in late else 0.0))
        slow = [] if found or is_last or not is_open else [cause for cause in causes if cause.kind == STRIBECK]
        if slow and slow[0].score >= max(cause.score for cause in causes) / 2:
            velocities = np.zeros(robot.n) if drives.stribeck is None else np.array(drives.stribeck, np.float64)
            for cause in (refine(rest, cause) for cause in slow):
                sharp[cause.joints], velocities[robot.joint_names.index(cause.joints[0])] = cause, cause.at
            drives = replace(drives, stribeck=velocities)
        elif not found:
            if is_last or not is_open or not drives.rotor or not has_no_rotors(robot, base, data, causes):
                break
            drives = replace(drives, rotor=False)
    declined = (NO_ROTORS,) * (is_open and not drives.rotor) + small_text(small)
    prepared = tuple(replace(record, notes=text) for record, text in zip(data.prepared, notes, strict=True))
    causes = causes if hypotheses is not None else ()
    return base, replace(data, prepared=prepared), causes, [*late.values(), *sharp.values()], declined


def with_lower_cutoff(
    robot: Robot, records: Sequence[Record], base: BaseParameters, data: RegressionData, options: dict[str, Any]
) -> RegressionData:
    """The equations with the cut-offs of the spectra, halved where that predicts what was not fitted better.

    Of two fits that with the lower cut-off is taken if it predicts blocks of time that neither has seen better, on
    signals below that cut-off, and less is left of its own signals than of the other's; where much is left also if it
    is as good there, and clearly less is left. There some halves that do not help may be followed by one that does.
    """
    estimator, first, failed = Estimator(base, None, 1.0), data, 0

    def errors_of(part: RegressionData, other: RegressionData) -> Array:
        """Errors held out, with the weights of all blocks: those of each take ten times as long."""
        known = estimator._replace(noise=estimator.fit(part.fitted)[0].sigma)
        return held_out(known, part.fitted, other.fitted).everywhere

    x = base.back @ estimator.fit(data.fitted)[0].values
    if data.fitted.shares(x).max(initial=0) < thresholds.LITTLE:
        return data
    options, errors = options | {"delays": data.delays, "loaded": x}, [errors_of(data, data)]
    for k in range(1, thresholds.CUTOFF_HALVINGS + 1):
        cutoffs = [record.cutoff / 2**k for record in first.prepared]
        try:
            lower = build_regression(robot, records, base, **options | {"cutoff": cutoffs})
        except ValueError:  # the record is too short for this filter
            break
        if lower.used.sum() < thresholds.FEWEST_ROWS * base.count:
            break
        own, other = (errors_of(part, lower) for part in (lower, data))
        ratio, fallen = (float(np.sqrt(np.nansum(own**2) / np.nansum(x**2))) for x in (other, errors[-1]))
        is_poor, least = np.nanmedian(errors[-1]) > thresholds.EXPLAINED, 1 - thresholds.LOWER
        if (ratio < least and fallen < 1) or (is_poor and fallen < least and ratio < 1 / least):
            data, failed = lower, 0
            errors.append(own)
        elif is_poor and failed < thresholds.FAILED:
            failed += 1
        else:
            break
    if data is first:
        return data
    before, after = (", ".join(f"{100 * x:.3g}" for x in e) for e in (errors[0], errors[-1]))
    why = f"of blocks not fitted {after} % is left by joint, with that of the spectrum, {{:.3g}} Hz, {before} %: "
    why += "noise may be fed back"
    pairs = zip(data.prepared, (record.cutoff for record in first.prepared), strict=True)
    told = ((record, f"cut-off {record.cutoff:.3g} Hz: {why.format(given)}") for record, given in pairs)
    return replace(data, prepared=tuple(replace(record, notes=(text, *record.notes[1:])) for record, text in told))


def fit_with_loads(
    robot: Robot, records: Sequence[Record], base: BaseParameters, options: dict[str, Any]
) -> tuple[RegressionData, LeastSquares]:
    """The equations and their solution; where friction depends on the load, in rounds with the loads of the last one.

    A round leaves of the parameters' error about the part of the torque that friction takes.
    """
    x, before = None, np.full(base.count, np.inf)
    for _ in range(thresholds.LOAD_ROUNDS if "Fl" in base.standard.terms else 1):
        data = build_regression(robot, records, base, **options, loaded=x)
        estimate = least_squares(data.fitted.mapped(base.back))
        moved, x, before = np.abs(estimate.values - before), base.back @ estimate.values, estimate.values
        if (moved <= thresholds.LOAD_SETTLED * estimate.errors).all():
            break
    return data, estimate


def motions_of(given: Any, records: Sequence[Record]) -> tuple[Motion, ...]:
    """The motions of the instruments, one for each record; none if they are not given."""
    from scipy.interpolate import CubicSpline

    if given is None:
        return ()
    for x in given if isinstance(given, Sequence) else [given]:
        if isinstance(x, Record | str):
            raise TypeError(f"{KINDS_OF_INSTRUMENTS}, got a {type(x).__name__}")
    several = isinstance(given, Sequence) and all(callable(x) or np.ndim(x) == 2 for x in given)
    each = list(given) if several else [given] * (len(records) if callable(given) else 1)
    if len(each) != len(records):
        wanted = f"one motion for each of {counted(len(records), 'record')}"
        raise ValueError(f"`instruments` must have {wanted}, got {counted(len(each), 'motion')}")
    motions = []
    for k, (motion, record) in enumerate(zip(each, records, strict=True)):
        if not callable(motion):
            t, rows = np.unique(record.t, return_index=True)
            q = real_array(f"instruments[{k}]", motion, f"({len(record.t)}, {record.n})")[rows]
            if len(t) < 2:
                raise ValueError(f"`instruments[{k}]` needs a record of several times, {record.name!r} has {len(t)}")
            spline = CubicSpline(t, q)
            motion = partial(lambda s, t: (s(t), s(t, 1), s(t, 2)), spline)
        motions.append(evaluated_once(motion))
    return tuple(motions)


def evaluated_once(motion: Motion) -> Motion:
    """The motion, which is not evaluated again at the same times, as each round of a fit asks for."""
    found: dict[bytes, tuple[Array, Array, Array]] = {}

    def at(t: Array) -> tuple[Array, Array, Array]:
        times = np.asarray(t).tobytes()
        if times not in found:
            found[times] = motion(t)
        return found[times]

    return at


def cutoff_of_instruments(records: Sequence[Record], motions: Sequence[Motion]) -> float:
    """The cut-off for motions without noise, from which the noise of the measured positions cannot be told [Hz]."""
    moved = [along(record.prepare(), motion) for record, motion in zip(records, motions, strict=True)]
    return max(Record(m.t, m.q, m.tau).prepare().cutoff for m in moved)


def fitted_springs(springs: Sequence[Spring | JointSpring], robot: Robot, moved: Robot) -> Springs | None:
    """The springs that are to be found, of which joints that are not locked move, checked."""
    found = resolved_springs(springs, robot, moved)
    for k, spring in enumerate(springs):
        if spring.damping:
            raise ValueError(f"`springs[{k}]` must have no damping, which is not found, got {spring.damping:g}")
    return found


def has_no_rotors(robot: Robot, base: BaseParameters, data: RegressionData, causes: Sequence[Cause]) -> bool:
    """True if no rotor is felt where it could be, as by torque sensors behind the gears; other causes hide rotors."""
    own = [k for k, name in enumerate(base.names) if name.startswith("Ia_") and base.formulas[k] == name]
    if not own or any(cause.kind not in GEARS for cause in causes):
        return False
    fitted = data.fitted.mapped(base.back)
    found = least_squares(fitted)
    found = with_correlation(found, fitted, data.correlation_time(data.residuals(base.back @ found.values)))
    size = np.zeros(robot.model.nb)
    size[list(robot.model.independent_joints)] = np.diag(robot.mass_matrix(np.zeros((1, robot.n)))[0])
    joints = [int(base.names[k].removeprefix("Ia_")) - 1 for k in own]
    doubt = thresholds.BEYOND_DOUBT * found.errors[own]
    return bool((found.values[own] < np.minimum(doubt, thresholds.SMALL_ROTOR * size[joints] - doubt)).all())


def taken_text(cause: Cause) -> str:
    """A delay or Stribeck effect that is taken into account, with its standard error, in words."""
    if cause.kind == "delay":
        text = delay_text(cause.joints if np.isnan(cause.at) else ())(np.array([cause.value]))
        return f"delay of {1000 * cause.value:.3g} ms: {text} (+- {1000 * cause.error:.2g} ms); taken into account"
    return f"{cause.kind}: {cause.text} (+- {cause.error:.2g}); taken into account"


def small_text(causes: Sequence[Cause]) -> tuple[str, ...]:
    """A note on causes that matter little to the model, but for friction that sound gears have."""
    told = merged_by_kind([cause for cause in causes if cause.kind not in GEARS])[:NAMED]
    texts = [f"{cause.text} (held out: {cause.effect})" for cause in told]
    return (f"evident, but of little effect, no likely causes: {'; '.join(texts)}",) * bool(texts)


def ignored_drives(standard: StandardParameters) -> tuple[str, ...]:
    """Rotors and friction that the given model has and that were not asked for: the robot found is without them."""
    model = standard.model
    known = {"Ia": model.armature, "Fv": model.damping, "Fc": model.friction}
    ignored = [DRIVES[symbol] for symbol, x in known.items() if symbol not in standard.terms and x.any()]
    text = "{} of the model was not fitted: what there is of it is in other parameters, and the robot found has none"
    return tuple(map(text.format, ignored))


def negative_drives(robot: Robot, base: BaseParameters, estimate: LeastSquares) -> tuple[str, ...]:
    """Rotors and friction that come out negative beyond doubt: a torque of the wrong sign does this."""
    bodies, found = PARAMETERS * robot.model.nb, []
    for k, name in enumerate(base.names):
        value, error = estimate.values[k], estimate.errors[k]
        free = name.startswith(("tau0", "c_"))  # of any sign
        if base.independent[k] >= bodies and not free and value < -thresholds.BEYOND_DOUBT * error:
            far = f", {IMPOSSIBLE[name.startswith('k_')]}" if value < -thresholds.IMPOSSIBLY * error else ""
            found.append(f"{name} comes out negative, {value:.3g} with a standard error of {error:.2g}{far}")
    has_friction = any(name.startswith(("Fv", "Fc", "Fl")) for name in found)
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
    """Pseudo-inertias of the prior, and notes on them."""
    if isinstance(known, str):
        bodies, drives = geometric_prior(standard.model), standard.count - PARAMETERS * standard.model.nb
        E = np.zeros((standard.count, 1 + drives))
        E[: -drives or None, 0] = parameters_of_pseudo_inertia(bodies)
        E[standard.count - drives :, 1:] = np.eye(drives)
        density = float(least_squares(fitted.mapped(E)).values[0])  # with which torques are fitted best
        if density <= 0:
            raise IdentificationError(
                f"`prior` 'geometry': the torques ask for bodies of {density:.4g} kg in all; check the signs of "
                "torques and of gravity"
            )
        return density * bodies, (f"prior: rods between the joints, {density:.4g} kg in all",)
    bodies, thickened = model_prior(known.model)
    return bodies, tuple(f"prior: the body of {name} was too thin and was made thicker" for name in thickened)


def plausible(parameters: Array, guess: Array, fitted: Equations) -> bool:
    """False if torques that are not explained make one body heavier than all together are guessed to be."""
    heaviest = parameters[: PARAMETERS * len(guess) : PARAMETERS].max(initial=0)
    return bool(heaviest <= guess[:, 3, 3].sum() or (fitted.shares(parameters) <= thresholds.EXPLAINED).all())
