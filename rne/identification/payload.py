"""Mass, centre and inertia of a load in the gripper, from motions without and with it.

The load is a rigid body: its ten parameters phi add to those of the body that it is fixed to, so that torques are
Y pi without and Y (pi + S phi) with it. Both sets of measurements together give pi and phi by least squares (Khalil,
Gautier and Lemoine 2007).
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..basics.inertia import COLUMNS, ENTRIES, PARAMETERS, ROWS, parameters_of_bodies, pseudo_inertia
from ..basics.spatial import Array, point_mass_inertia
from ..basics.text import Row, short, wrapped
from ..errors import IdentificationError, IdentificationWarning
from ..model.standard_parameters import DriveModel, StandardParameters
from ..model.topology import end_link
from ..robot import Robot
from . import thresholds
from .drive_gains import DriveGains, gain_rows, of_all_joints
from .fit.consistent import consistent_fit
from .fit.equations import RegressionData, warn_of_locked
from .log.prepared import Prepared
from .log.record import Record
from .prediction import possible_draws, prior_scale, square_root
from .record_sets import CONTAINED, GAINS_CONTAINED, SetsResult, eliminated, record_sets
from .result import Identification

if TYPE_CHECKING:
    from ..simulation.scene import Payload

SCALED = "torques of the bodies without the load are"  # start of a note
STEP = 1e-30  # imaginary step of complex-step derivatives
INERTIAS = ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
QUANTITIES = ("mass [kg]", *(f"centre {x} [m]" for x in "xyz"), *(f"{symbol} [kg m^2]" for symbol in INERTIAS))


@dataclass(frozen=True, eq=False)
class PayloadEstimate(SetsResult):
    """Load estimated by `rne.identify_payload`; a Scene takes it as its `payload`.

    Attributes
    ----------
    payload : Payload
        The load, for a Scene: ``robot.with_payload(*found.payload)``.
    mass_error : float
        Standard error of the mass [kg].
    com_error : ndarray, shape (3,)
        Standard errors of the centre of mass; infinite where not identifiable [m].
    inertia_error : ndarray, shape (3, 3)
        Standard errors of the inertia about the centre of mass; infinite where not identifiable [kg m^2].
    estimate : LeastSquares
        The robot's base parameters, then the load's ten parameters m, m cx, m cy, m cz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz
        about the link's origin and in its axes; with gains, the relative changes of the gains last.
    consistent : bool
        True if the load is the physically consistent one, because least squares give an impossible one, or the motions
        do not determine all of it.
    unknown : tuple of str
        Numbers that the motions do not determine, such as "its centre along (0.00, 0.00, 1.00)" or "Ixx", in the
        link's axes; there the load is like a ball of 3000 kg/m^3.
    gains, gain_errors : ndarray, shape (n,), or None
        Gains of the drives, if they were found together with the load, with standard errors; NaN for joints without an
        identifiable gain.
    held_out_rms : ndarray, shape (sets, 2, n)
        Root mean squares of errors and of torques in motion, of the records without the load first and those with it
        last, on blocks of time of which each was predicted by a fit to the others without terms for errors of the
        drives, as by `rne.identify`; with the load they contain what changed between the records [N m or N].
    notes : tuple of str
        Assumptions, errors of the drives that the standard errors contain, and signs of mistakes.
    sets : RecordSets
        The equations of all sets of records.
    """

    payload: Payload
    mass_error: float
    com_error: Array
    inertia_error: Array
    consistent: bool
    unknown: tuple[str, ...]
    gains: Array | None = None
    gain_errors: Array | None = None

    def _reasons(self) -> list[str]:
        share = self.mass_error / abs(self.mass)
        return [f"the mass is known to {100 * share:.2g} % only"] if share > thresholds.DOUBTFUL else []

    @property
    def mass(self) -> float:
        """Mass of the load [kg]."""
        return self.payload.mass

    @property
    def com(self) -> Array:
        """Centre of mass in the link's frame, shape (3,) [m]."""
        return np.asarray(self.payload.com)

    @property
    def inertia(self) -> Array:
        """Inertia about the centre of mass, in the link's axes, shape (3, 3) [kg m^2]."""
        return np.asarray(self.payload.inertia)

    def __repr__(self) -> str:
        com = ", ".join(f"{x:.4g}" for x in self.com)
        return wrapped(
            f"PayloadEstimate({self.mass:.4g} kg, standard error {self.mass_error:.2g} kg, at ({com}) m of "
            f"{short(str(self.payload.link))})"
        )

    def draws(self, count: int, seed: int = 0) -> dict[str, Array]:
        """Random loads distributed as the estimate, for `numbers` of `rne.ensemble` and a Scene that carries it.

        Parameters
        ----------
        count, seed : int
            Number N of draws, and the seed of their random numbers.

        Returns
        -------
        dict of str to ndarray
            "payload": ten parameters of possible bodies about the link's origin, as in `estimate`, shape (N, 10).

        Raises
        ------
        ValueError, IdentificationError
            As for `Identification.draws`, whose notes hold: by the covariance of `estimate`, and where the motions say
            nothing of a parameter by a prior of bodies like the load, which may be three times as large.
        """
        first = self.sets.base.count + self.sets.S.shape[-1] - PARAMETERS
        own, phi = np.s_[first : first + PARAMETERS], parameters_of_bodies(np.array(self.mass), self.com, self.inertia)
        told = np.eye(PARAMETERS)[np.isfinite(self.estimate.errors[own])]
        root = told @ square_root(self.estimate.covariance[own, own])
        scale = prior_scale(phi, thresholds.LOAD_STD, np.zeros(0), "identify it with `consistent=True`")
        return {"payload": possible_draws(phi, scale, np.s_[:PARAMETERS], told, root, count, seed)}

    def report(self) -> str:
        """Text on the load: accuracy, standard errors of its parameters, and notes.

        Returns
        -------
        str
            A sentence, a table, then the notes and the likely causes of the residuals.
        """
        values = [self.mass, *self.com, *self.inertia[ROWS, COLUMNS]]
        errors = [self.mass_error, *self.com_error, *self.inertia_error[ROWS, COLUMNS]]
        link, share = short(str(self.payload.link)), 100 * self.mass_error / abs(self.mass)
        rows = [Row(f"load on {link}", ("estimate", "standard error"), words=True)]
        for name, value, error in zip(QUANTITIES, values, errors, strict=True):
            rows.append(Row(f"  {name}", (f"{value:.5f}", f"{error:.5f}")))
        first, contained = f"{self.mass:.4g} kg on {link}, known to {share:.2g} %", CONTAINED
        first += " if the torques are right, see below" * any(note.startswith(SCALED) for note in self.notes)
        if self.gains is not None and self.gain_errors is not None:
            rows += gain_rows(self.sets.robot.joint_names, self.gains, self.gain_errors)
            contained = GAINS_CONTAINED
        return self._report(first, rows, contained)


def identify_payload(
    robot: Robot | Identification | DriveGains,
    without: Record | Sequence[Record] | None,
    with_load: Record | Sequence[Record],
    *,
    link: str | None = None,
    consistent: bool = True,
    drives: DriveModel | None = None,
    cutoff: float | None = None,
    delay: ArrayLike | None = None,
) -> PayloadEstimate:
    """Mass, centre of mass and inertia of a load, from measured motions without and with it.

    Parameters
    ----------
    robot : Robot, Identification or DriveGains
        The robot without the load, of which only joints and their places need be right; the result of `rne.identify`
        from motions without the load, whose equations are then used; or the result of `rne.identify_drive_gains` from
        currents without and with a load that was weighed: gains and the load are then found together from all three.
    without, with_load : Record or sequence of Record
        Measured motions without the load, None with an Identification or DriveGains; and motions with it, which may be
        others.
    link : str, optional
        The link that carries the load, in whose frame it is given; the last link of the chain if not given, as of
        `rne.Payload`.
    consistent : bool
        False to keep the load of least squares, even where no distribution of mass has it.
    drives, cutoff, delay : optional
        Model of the drives, cut-off frequency [Hz] and delay of torques or currents [s], as of
        `rne.identify_drive_gains`; no `drives` with an Identification or DriveGains, whose records keep their delays.

    Returns
    -------
    PayloadEstimate
        The load with standard errors.

    Raises
    ------
    TypeError
        If `robot`, a record or `drives` is of another type.
    ValueError
        For the reasons of `rne.identify_drive_gains`, except for its mass; or if `link` is not one of the robot's, or
        does not move.
    IdentificationError
        If the mass is not identifiable, it is negative beyond doubt, or no possible load fits.
    ImportError
        If the physically consistent load is needed and Clarabel is not installed.

    Warns
    -----
    IdentificationWarning
        If records that name their joints lack some of the robot's, which are taken as locked; and with
        `PayloadEstimate.doubt`, its text: if the mass is known to no better than 5 %, or more than 30 % of a joint's
        torque in motion is not explained.

    Notes
    -----
    Standard errors contain noise and the effect of errors of the drives: torque factors that differ between joints or
    change between the records, friction that rises with the load, saturates, differs between the directions or
    changes, offsets that change or drift. Each is a random coefficient of each joint, whose variance is estimated;
    where fits without one of the blocks of time scatter more, their scatter is the error. A factor common to all
    torques makes the mass as wrong as it is; it is only visible relative to the masses of the robot given, and a note
    reports it. A load that is impossible by least squares, or not determined completely, is replaced by the physically
    consistent one that fits best; where the motions are not informative, it is like a ball of 3000 kg/m^3.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, motion = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1, 0.9, 0.8, 2, 1, 2], 2.0)
    >>> t = np.arange(0, 2, 0.004)
    >>> logs = [rne.identification.Record(t, motion(t)[0], arm.inverse_dynamics(*motion(t)))
    ...         for arm in (robot, robot.with_payload(3.0, com=[0, 0, 0.1]))]
    >>> found = rne.identify_payload(robot, *logs, cutoff=20, drives=rne.DriveModel())
    >>> round(found.mass, 2), rne.Scene(robot, payload=found).n
    (3.0, 6)
    >>> print(found.report()[:23])
    3 kg on tool0, known to
    >>> found.draws(100)["payload"].shape
    (100, 10)
    """
    from ..simulation.scene import Payload

    if isinstance(robot, DriveGains):
        if without is not None or drives is not None:
            raise ValueError("DriveGains have their records and drives: `without` and `drives` must be None")
        sets = robot.currents.with_records(with_load, cutoff, delay).with_delays(robot.gains)
    else:
        sets = record_sets(robot, without, with_load, drives, cutoff, delay).with_delays()
        warn_of_locked(sets.data[0].notes)
    model, K = sets.robot.model, sets.base.count
    name = end_link(model, axes_count=True) if link is None else link
    sets, scaled, gains, gain_errors = sets.with_load(name), 1.0, None, None
    own = np.s_[K + sets.S.shape[-1] - PARAMETERS : K + sets.S.shape[-1]]
    if isinstance(robot, DriveGains):
        gains, gain_errors, fit = of_all_joints(sets)
        sets = sets.in_torques(gains)
    else:
        fit = sets.fitted()
        scaled = beside_given(sets.base.standard, sets.data[0], sets.states(fit.estimate.values)[0], fit.estimate.sigma)
    estimate, factor = fit.estimate, eliminated(fit.load, np.s_[own.start - K :])
    phi, errors = estimate.values[own], estimate.errors[own]
    if not errors[0] < np.inf:
        raise IdentificationError(
            "`with_load`: the motions do not separate the load's mass from its centre: move the joints that lift it"
        )
    if consistent and phi[0] < -thresholds.BEYOND_DOUBT * errors[0]:
        raise IdentificationError(
            f"`with_load`: the torques ask for a mass of {phi[0]:.3g} kg, with a standard error of {errors[0]:.2g} kg: "
            "are the records exchanged, or the signs of torques or of gravity wrong?"
        )
    unknown = unknown_parts(factor, max(abs(phi[0]), errors[0]), gravity_in(sets.robot, name, sets.data[-1].prepared))
    notes = [*fit.notes]
    if unknown:
        value = f"as of a ball of {thresholds.DENSITY:g} kg/m^3" if consistent else "zero, or what noise makes of it"
        where = f"in the axes of {short(name)}: {', '.join(unknown)}"
        notes.insert(0, f"not identifiable from the motions, {where}; taken {value}")
    if abs(scaled - 1) > thresholds.SCALED_TORQUES:
        right = f"if its masses are right, the load has {phi[0] / scaled:.3g} kg, not {phi[0]:.3g}"
        notes.append(f"{SCALED} {scaled:.3g} times those of the robot given: {right}")
    notes = doubts(phi, errors) + notes
    replaced = consistent and bool(unknown or np.linalg.eigvalsh(pseudo_inertia(phi)[0])[0] <= 0)
    if replaced:
        phi = possible_load(factor, phi, errors)
        notes.append("the load is the physically consistent one that fits best; `estimate` holds that of least squares")
    body, error = standard_errors(phi, estimate.covariance[own, own], np.isinf(errors))
    payload = Payload(float(body[0]), body[1:4], body[4:][ENTRIES], name)
    common, stated = (estimate, fit.held_out, tuple(notes), sets), (float(error[0]), error[1:4], error[4:][ENTRIES])
    found = PayloadEstimate(*common, payload, *stated, replaced, unknown, gains, gain_errors)
    if found.doubt:
        warnings.warn(found.doubt, IdentificationWarning, stacklevel=2)
    return found


def beside_given(standard: StandardParameters, data: RegressionData, x: Array, sigma: Array) -> float:
    """Ratio of the torques of bodies of parameters x to the model's, 1 where they are not proportional."""
    bodies = standard.groups["bodies"]
    found, given = ((data.Y[..., bodies] @ values[bodies] / sigma)[data.used] for values in (x, standard.values))
    both, own, whole = found @ given, given @ given, found @ found
    return float(both / own) if both**2 > thresholds.LIKE_GIVEN * own * whole > 0 else 1.0


def doubts(phi: Array, errors: Array) -> list[str]:
    """Notes on a doubtful or impossible least-squares load."""
    notes, mass = [], f"a mass of {phi[0]:.3g} kg with a standard error of {errors[0]:.2g} kg"
    if phi[0] < -thresholds.BEYOND_DOUBT * errors[0]:
        notes.append(f"least squares give {mass}: are the records exchanged?")
    elif phi[0] < thresholds.BEYOND_DOUBT * errors[0]:
        notes.append(f"the mass is hardly significant, +- {errors[0]:.2g} kg: is it on another `link`?")
    if phi[0] > 0 and np.linalg.eigvalsh(pseudo_inertia(phi)[0])[0] <= 0:
        notes.append("least squares give an inertia that no distribution of mass has")
    return notes


def gravity_in(robot: Robot, link: str, records: Sequence[Prepared]) -> Array:
    """Directions of gravity in the axes of a link at some samples of records, shape (k, 3); none without gravity."""
    gravity, index = robot.model.gravity, robot.link_names.index(link)
    q = np.concatenate([record.q[:: max(len(record.q) // thresholds.FEW_POSES, 1)] for record in records])
    size = np.linalg.norm(gravity)
    return np.asarray(gravity @ robot.link_poses(q)[:, index, :3, :3] / size) if size else np.zeros((0, 3))


def unknown_parts(factor: Array, mass: float, down: Array) -> tuple[str, ...]:
    """Names of a load's parameters that the equations do not determine; gravity acts `down`, (k, 3), in its axes."""
    radius = gyration(mass)
    size = thresholds.LOAD_STD * mass * np.repeat([1.0, radius, radius**2], [1, 3, 6])
    _, S, V = np.linalg.svd(factor[:, :-1] * size)
    U, of_centre, axes = np.linalg.svd(V[S < 1][:, 1:4])
    k = int((of_centre > thresholds.NAMED_PART).sum())
    names = ["its centre"] if k == 3 else [axis_text(axis, down) for axis in axes[:k]]
    shares = ((U[:, k:].T @ V[S < 1])[:, 4:] ** 2).sum(0)
    least = thresholds.NAMED_PART * shares.max()
    told = [symbol for symbol, share in zip(INERTIAS, shares, strict=True) if share > least]
    return (*names, *(["its inertia"] if len(told) == len(shares) else told))


def axis_text(axis: Array, down: Array) -> str:
    """Text of the centre along an axis."""
    x, y, z = axis * np.sign(axis[np.abs(axis).argmax()])
    along = ", as gravity" * bool(len(down) and (np.abs(down @ axis) > thresholds.ALONG).all())
    return f"its centre along ({x:.2f}, {y:.2f}, {z:.2f}){along}".replace("-0.00", "0.00")


def gyration(mass: float) -> float:
    """Root mean square of a coordinate in a ball of this mass [m]."""
    return float((3 * mass / (4 * np.pi * thresholds.DENSITY)) ** (1 / 3) / np.sqrt(5))


def possible_load(factor: Array, phi: Array, errors: Array) -> Array:
    """Parameters of the best-fitting physically consistent load, near a ball of the mass and centre found."""
    mass = max(phi[0], errors[0])
    centre = phi[1:4] / mass if phi[0] > thresholds.BEYOND_DOUBT * errors[0] else np.zeros(3)
    ball = np.eye(4)
    ball[:3, :3] *= gyration(mass) ** 2
    ball[:3, :3] += np.outer(centre, centre)
    ball[:3, 3] = ball[3, :3] = centre
    return consistent_fit(factor, mass * ball[None], thresholds.LOAD_STD**-2, np.zeros(0, bool), np.zeros(0))


def body_of(phi: Array) -> Array:
    """Mass, centre of mass and inertia about it, from parameters about the link's origin; also complex."""
    centre = phi[1:4] / phi[0]
    inertia = phi[4:][ENTRIES] - point_mass_inertia(phi[0], centre)
    return np.concatenate([phi[:1], centre, inertia[ROWS, COLUMNS]])


def standard_errors(phi: Array, covariance: Array, free: Array) -> tuple[Array, Array]:
    """Mass, centre and inertia with their standard errors, from derivatives by complex steps."""
    steps = phi + STEP * 1j * np.eye(PARAMETERS)
    J = np.array([body_of(x).imag / STEP for x in steps]).T
    errors = np.sqrt(np.einsum("ij,jk,ik->i", J, covariance, J))
    errors[(J[:, free] != 0).any(1)] = np.inf
    return body_of(phi), errors
