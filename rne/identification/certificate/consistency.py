"""The test of measured torques, from records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...model.standard_parameters import StandardParameters
from ...robot import Robot
from ..gathering import HELD_OUT, check_robot, gathered
from ..measurements.record import Record
from .joint_statistics import own_fit
from .verdict import Consistency, certified


def consistency(
    robot: Robot,
    records: Record | Sequence[Record],
    *,
    rotor: bool = False,
    friction: str | None = None,
    offset: bool = False,
    shafts: ArrayLike | None = None,
    smoothing: float = 0.0,
    minimum_rate: ArrayLike | None = None,
    cutoff: float | None = None,
    decimation: int | None = None,
    blocks: int = HELD_OUT,
) -> Consistency:
    """Say whether measured torques can come from one rigid-body model at all.

    One set of parameters is fitted to all joints, and a set of its own to each. Torques of a rigid body leave the
    same in both fits, up to chance. The masses of `robot` do not matter, only its joints and their places.

    Parameters
    ----------
    robot : Robot
        Its joints and their places are known.
    records : Record or sequence of Record
        Measured motions.
    rotor : bool
        True if the drives' rotors have an inertia.
    friction : {None, "viscous", "coulomb", "viscous+coulomb"}
        Friction of each drive.
    offset : bool
        True for a constant torque of each drive.
    shafts : array_like, shape (s, n), optional
        Further shafts with rotor and friction, each turning at a^T qd for a row a: coupled motors.
    smoothing : float
        Coulomb friction is Fc tanh(qd / smoothing); 0 for Fc sign(qd) [rad/s or m/s].
    minimum_rate : array_like, shape (n,), optional
        Slower equations of a joint are left out, as by `rne.identify` [rad/s or m/s].
    cutoff : float, optional
        Of the low-pass filter, by default chosen from the measurements [Hz].
    decimation : int, optional
        Samples per equation after the filter; by default from the cut-off.
    blocks : int
        The measurements are cut into so many, each to be predicted from the others.

    Returns
    -------
    Consistency
        The verdict, and the numbers of each joint that it rests on.

    Raises
    ------
    ValueError
        If an argument does not fit the robot, or there are fewer equations than parameters.

    Notes
    -----
    The test is that of Draper and Smith 1998, section 6.1, with the number of equations divided by the correlation time
    of the residuals. The noise is taken from the spectrum of the torques above twice the filter's cut-off.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
    >>> w = 2 * np.pi * np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    >>> q, qd, qdd = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
    >>> tau = robot.inverse_dynamics(q, qd, qdd)
    >>> tau[:, 2] *= 1.2  # a wrong gear ratio
    >>> rne.consistency(robot, rne.identification.Record(t, q, tau)).one_model
    False
    """
    check_robot(robot)
    standard = StandardParameters(robot.model, rotor, friction, offset, shafts, smoothing)
    base = robot.base_parameters(rotor=rotor, friction=friction, offset=offset, shafts=shafts, smoothing=smoothing)
    data = gathered(robot, records, standard, base, minimum_rate, cutoff, decimation, blocks)
    own = [base.back @ own_fit(data.fitted.of_joint(j).mapped(base.back))[0] for j in range(robot.n)]
    repeats = np.array([data.repeats(x)[j] for j, x in enumerate(own)])
    return certified(
        base, data.prepared, data.fitted, data.measured, repeats, lambda x: [r.tau - r.Y @ x for r in data.rows]
    )
