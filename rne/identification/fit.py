"""Identification: the parameters of a robot's bodies, rotors and friction from measured motions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, vector
from ..basics.spatial import Array
from ..dynamics.base_parameters import BaseParameters
from ..errors import IdentificationError
from ..model.parameters import PARAMETERS
from ..model.pseudo_inertia import parameters_of_pseudo_inertia
from ..model.standard_parameters import StandardParameters
from ..robot import Robot
from .estimation.correlation import repeats_of_filtered_noise, repeats_of_residuals
from .estimation.equations import Equations, joined
from .estimation.least_squares import least_squares, with_correlation
from .estimation.method import Method, held_out
from .estimation.prior import geometric_prior, model_prior
from .estimation.stacking import Stacked, stacked
from .measurements.prepared import Prepared
from .measurements.record import Record
from .result import Identification

SLOWEST = 0.02  # of a joint's largest rate: below it, Coulomb friction has no known direction
HELD_OUT = 10  # blocks of the measurements, each predicted from the others
SPREAD = 0.3  # of the prior: that bodies differ from it by 30 % is as likely as one standard deviation of noise


def identify(
    robot: Robot,
    records: Record | Sequence[Record],
    *,
    rotor: bool = False,
    friction: str | None = None,
    offset: bool = False,
    shafts: ArrayLike | None = None,
    consistent: bool = True,
    prior: Robot | str | None = None,
    spread: float = SPREAD,
    smoothing: float = 0.0,
    minimum_rate: ArrayLike | None = None,
    cutoff: float | None = None,
    decimation: int | None = None,
    blocks: int = HELD_OUT,
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
    rotor : bool
        True to find the inertia of each drive's rotor, reflected to its joint.
    friction : {None, "viscous", "coulomb", "viscous+coulomb"}
        Friction of each drive to find. Without it, friction ends up in other parameters and residuals.
    offset : bool
        True to find a constant torque of each drive.
    shafts : array_like, shape (s, n), optional
        Further shafts with rotor and friction, each turning at a^T qd for a row a: coupled motors.
    consistent : bool
        False to skip the physically consistent fit, which needs the extra `identify`.
    prior : Robot or "geometry", optional
        Where the motion says nothing, bodies are like those of this robot; "geometry" guesses rods between the joints
        and finds their density from the measurements.
    spread : float
        How far, relatively, bodies are expected to differ from the prior.
    smoothing : float
        Coulomb friction is Fc tanh(qd / smoothing); 0 for Fc sign(qd) [rad/s or m/s].
    minimum_rate : array_like, shape (n,), optional
        Slower equations of a joint are not fitted, because the direction of Coulomb friction is not known; by default
        2 % of the joint's largest rate with Coulomb friction that is not smoothed, otherwise 0 [rad/s or m/s].
    cutoff : float, optional
        Of the low-pass filter, by default chosen from the measurements [Hz].
    decimation : int, optional
        Samples per equation after the filter; by default from the cut-off.
    blocks : int
        The measurements are cut into so many, each to be predicted from the others.

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
    >>> found.base.count
    36
    """
    given = checked_records(robot, records)
    standard = StandardParameters(robot.model, rotor, friction, offset, shafts, smoothing)
    base = robot.base_parameters(rotor=rotor, friction=friction, offset=offset, shafts=shafts)
    prepared = tuple(record.prepare(cutoff, decimation) for record in given)
    rates = minimum_rates(standard, prepared, minimum_rate)
    rows = [stacked(robot, standard, record, rates) for record in prepared]
    check_count(rows, base)
    fitted, measured = equations_of(rows, prepared, blocks)
    guess, notes = prior_bodies(robot, prior, standard, fitted) if consistent else (None, ())
    method = Method(standard, base, guess, positive_number("spread", spread) ** -2)
    estimate, parameters = method.solved(fitted)
    repeats = repeated_equations(rows, prepared, base.back @ estimate.values)
    estimate = with_correlation(estimate, fitted.mapped(base.back), repeats)
    errors = held_out(method, fitted, measured)
    return Identification(
        robot, standard, base, prepared, estimate, parameters, consistent, errors, fitted, rates, repeats, notes
    )


def checked_records(robot: Robot, records: Record | Sequence[Record]) -> tuple[Record, ...]:
    """The records as a tuple, all of the robot's joints."""
    if not isinstance(robot, Robot):
        raise TypeError(f"`robot` must be an rne.Robot, got {type(robot).__name__}")
    given = (records,) if isinstance(records, Record) else tuple(records)
    if not given:
        raise ValueError("`records` must have at least one record")
    for record in given:
        if not isinstance(record, Record):
            raise TypeError(f"`records` must be an rne.identification.Record or several, got {type(record).__name__}")
        if record.n != robot.n:
            raise ValueError(f"`records` must be of {robot.n} joints, as the robot, got one of {record.n}")
    return given


def minimum_rates(standard: StandardParameters, prepared: Sequence[Prepared], given: ArrayLike | None) -> Array:
    """Rates below which the equations of a joint are not fitted, shape (n,)."""
    if given is not None:
        return vector("minimum_rate", given, standard.model.n, sign="not negative")
    if "Fc" not in standard.terms or standard.smoothing:
        return np.zeros(standard.model.n)
    largest: Array = np.max([np.abs(record.qd).max(0) for record in prepared], axis=0)
    return SLOWEST * largest


def equations_of(rows: Sequence[Stacked], prepared: Sequence[Prepared], blocks: int) -> tuple[Equations, Equations]:
    """Equations to fit, and those to check the fit on, in blocks of time."""
    each = max(-(-blocks // len(prepared)), 2)
    parts = [r.compressed(record.blocks(each)) for r, record in zip(rows, prepared, strict=True)]
    return joined([fitted for fitted, _ in parts]), joined([measured for _, measured in parts])


def repeated_equations(rows: Sequence[Stacked], prepared: Sequence[Prepared], x: Array) -> Array:
    """How many equations of a joint count as one, shape (n,)."""
    residuals = np.concatenate([r.Y @ x - r.tau for r in rows])
    used = np.concatenate([r.used for r in rows])
    parts, start = [], 0
    for record in prepared:
        for length in record.segment_lengths:
            parts.append(slice(start, start + length))
            start += length
    by_filter = max(repeats_of_filtered_noise(p.cutoff, p.sample_rate, p.decimation) for p in prepared)
    return np.maximum(repeats_of_residuals(residuals, used, parts), by_filter)


def check_count(rows: Sequence[Stacked], base: BaseParameters) -> None:
    """Refuse fewer equations than unknowns."""
    count = sum(int(r.used.sum()) for r in rows)
    if count <= base.count:
        raise ValueError(
            f"`records` give {count} equations for {base.count} base parameters: a longer motion is needed, or a "
            "higher `cutoff`"
        )


def prior_bodies(
    robot: Robot, prior: Robot | str | None, standard: StandardParameters, fitted: Equations
) -> tuple[Array, tuple[str, ...]]:
    """Pseudo-inertias to start from, and what to say of them."""
    if isinstance(prior, str) and prior == "geometry":
        bodies = geometric_prior(robot.model)
        density = found_density(bodies, standard, fitted)
        return density * bodies, (f"prior: rods between the joints, {density:.4g} kg in all",)
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
    bodies, thickened = model_prior(known.model)
    return bodies, tuple(f"prior: the body of {name} was too thin and was made thicker" for name in thickened)


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
