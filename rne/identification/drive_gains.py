"""Torque per ampere of each drive, from currents measured without and with a known load.

Currents are torques in a unit of their own per joint, i_j = k_j (Y_j pi + Y_j S phi): without a load (phi = 0) any
gains fit, with one its known parameters set the scale (Gautier and Briot 2014). Currents are noisy, and as a column of
the equations [Y, -i] (pi, 1 / k) = -Y S phi their noise would draw gains to zero. Here they stay on the other side:
first joint by joint, where i_j is linear in k_j pi and k_j; then all joints with one pi, by Gauss-Newton steps, whose
column for a gain is the current that the model predicts (an instrument, as of instrumental variables).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..basics.text import InNotebooks, Row, aligned, listed, short, wrapped
from ..errors import IdentificationError
from ..model.parameters import PARAMETERS
from ..model.standard_parameters import DriveModel
from ..robot import Robot
from ..simulation.scene import HasPayload, Payload, payload_argument
from .equations import Equations, joined, triangular
from .least_squares import LeastSquares, least_squares, with_correlation
from .payload import BEYOND_DOUBT, TwoSets, two_sets
from .record import Record
from .result import Identification

ROUNDS = 30  # of steps
SETTLED = 1e-7  # relative change of the gains at which they end


@dataclass(frozen=True, eq=False)
class DriveGains(InNotebooks):
    """Gains of the drives, by `rne.identify_drive_gains`.

    Attributes
    ----------
    joint_names : tuple of str
    gains : ndarray, shape (n,)
        Joint torque per unit of what was measured; NaN where the load does not tell it [N m/A or N/A for currents].
    errors : ndarray, shape (n,)
        Their standard errors; NaN likewise.
    estimate : LeastSquares
        Of the base parameters, in N m, with the gains found.
    notes : tuple of str
        What was assumed, and what looks wrong.
    """

    joint_names: tuple[str, ...]
    gains: Array
    errors: Array
    estimate: LeastSquares
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        return wrapped(f"DriveGains([{', '.join(f'{gain:.4g}' for gain in self.gains)}])")

    def report(self) -> str:
        """The gains with standard errors, and the notes.

        Returns
        -------
        str
            A table, then the notes.
        """
        rows = [Row("drive gains [N m or N per unit]", ("gain", "standard error"), words=True)]
        for name, gain, error in zip(self.joint_names, self.gains, self.errors, strict=True):
            rows.append(Row(f"  {short(name)}", ("-", "-") if np.isnan(gain) else (f"{gain:.5g}", f"{error:.2g}")))
        return "\n".join([*aligned(rows), *(line for note in self.notes for line in wrapped(note).splitlines())])


def identify_drive_gains(
    robot: Robot | Identification,
    without: Record | Sequence[Record] | None,
    with_load: Record | Sequence[Record],
    payload: Payload | HasPayload | float,
    *,
    drives: DriveModel | None = None,
    minimum_velocity: ArrayLike | None = None,
    cutoff: float | None = None,
    decimation: int | None = None,
) -> DriveGains:
    """Torque per ampere of each drive, from currents without and with a known load.

    Parameters
    ----------
    robot : Robot or Identification
        The robot without the load, of which only joints and their places need be right; or what `rne.identify` made of
        the currents without the load.
    without : Record or sequence of Record, or None
        Measured motions without the load, with currents, or what else is proportional to torques, in place of torques;
        None with an Identification.
    with_load : Record or sequence of Record
        Measured motions with the load; they may differ from those without.
    payload : Payload, PayloadEstimate or float
        The load, weighed: gains are as wrong as its mass is, relatively. As of a Scene.
    drives : DriveModel, optional
        Torques of the drives, by default rotors, viscous and Coulomb friction and offsets; not with an Identification,
        which has its own.
    minimum_velocity, cutoff, decimation : optional
        As of `rne.identify`.

    Returns
    -------
    DriveGains
        Gains with standard errors; NaN for joints whose torque the load does not change by enough.

    Raises
    ------
    ValueError
        If a record is of other joints, there are fewer equations than parameters, or the load is on no joint.
    IdentificationError
        If the load tells the gain of no joint, or the fit does not settle.

    Notes
    -----
    A gain is found if its inverse, from its joint alone, differs from zero by more than four standard errors. Drives
    are taken as the same without and with the load, and a delay of the currents only from an Identification. Of coupled
    motors the gains are those of the joints' torques.

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
    >>> print(found.report().splitlines()[0])
    drive gains [N m or N per unit]  gain  standard error
    """
    sets = two_sets(robot, without, with_load, drives, minimum_velocity, cutoff, decimation)
    load = np.zeros(sets.base.standard.count)
    arm = sets.robot
    load[: PARAMETERS * arm.model.nb] = arm.with_payload(*payload_argument(payload)).parameters - arm.parameters
    if not load.any():
        raise ValueError("`payload` must have a mass and be on a link that moves: no joint carries it")
    inverse, errors, correlation_time = of_single_joints(sets, load)
    told = np.abs(inverse) > BEYOND_DOUBT * errors
    if not told.any():
        raise IdentificationError("`payload`: the load changes the currents of no joint by more than chance does")
    gains = np.where(told, 1 / np.where(told, inverse, 1), np.nan)
    gains, equations = of_all_joints(sets, load, gains)
    estimate = with_correlation(least_squares(equations), equations, correlation_time)
    errors = np.abs(gains) * estimate.errors[sets.base.count :]
    silent = [name for name, known in zip(arm.joint_names, told, strict=True) if not known]
    notes = (f"the load does not tell the gain of {listed(silent)}",) if silent else ()
    return DriveGains(arm.joint_names, gains, errors, estimate, (*sets.notes, *notes))


def of_single_joints(sets: TwoSets, load: Array) -> tuple[Array, Array, Array]:
    """Inverse gains k of i_j = Y_j (k pi) + k Y_j S phi, each from its joint alone, errors, and correlation times."""
    back, K = sets.base.back, sets.base.count
    E = np.hstack([back, load[:, None]])
    both = sets.joined(E, K)
    found, errors, correlation_time = np.zeros((3, both.joints))
    for j in range(both.joints):
        one = both.of_joint(j)
        estimate = least_squares(one)
        correlation_time[j] = sets.correlation_time(back @ estimate.values[:K], E @ estimate.values)[j]
        found[j], errors[j] = estimate.values[K], with_correlation(estimate, one, correlation_time[[j]]).errors[K]
    return found, errors, correlation_time


def of_all_joints(sets: TwoSets, load: Array, gains: Array) -> tuple[Array, Equations]:
    """Gains by a fit of all joints with the same parameters, and the equations of the last step."""
    K = sets.base.count
    x = least_squares(stepped(sets, load, gains, None)).values
    for _ in range(ROUNDS):
        equations = stepped(sets, load, gains, sets.base.back @ x[:K])
        x = least_squares(equations).values
        gains = gains / (1 + x[K:])
        if np.nanmax(np.abs(x[K:])) <= SETTLED:
            return gains, equations
    raise IdentificationError("`payload`: the fit of gains and parameters together does not settle")


def stepped(sets: TwoSets, load: Array, gains: Array, pi: Array | None) -> Equations:
    """Equations Y_j pi' + (Y_j pi + Y_j S phi) d_j = g_j i_j - Y_j S phi of a step from gains g and parameters pi.

    The unknowns are pi' and the relative changes d of the inverse gains; with `pi` None they are pi' alone.
    """
    back, told = sets.base.back, np.isfinite(gains)
    P, K, n = len(back), sets.base.count, len(gains)
    parts = []
    for data, phi in zip(sets.equations, (0 * load, load), strict=True):
        T = np.zeros((n, P + 1, K + n + 1))
        T[:, :P, :K] = back
        T[:, :P, -1] = -phi
        T[:, P, -1] = gains
        if pi is not None:
            T[np.arange(n), :P, K + np.arange(n)] = pi + phi
        T[~told] = 0
        parts.append(Equations(triangular(data.factors @ T), data.rows * told))
    return joined(parts)
