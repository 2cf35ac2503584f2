"""Published figures of the hobby servos of the arms SO-100 and SO-101."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number
from ..robot import Robot
from .laws import Reference
from .servo_law import Servo, servo

KG_CM = 9.80665e-2  # torque of 1 kgf at 1 cm [N m]


class ServoFigures(NamedTuple):
    """Published figures of a servo, at its output shaft; `servo_figures` has them by name.

    Attributes
    ----------
    stall_torque : float
        Nominal, of the data sheet [N m].
    no_load_speed : float
        Nominal, of the data sheet [rad/s].
    gain : float
        Share of the voltage per error of the position and unit of the register P, measured by oscilloscope [1/rad].
    armature : float
        Inertia of the rotor, from a fit to pendulum motions [kg m^2].
    viscous, coulomb : float
        Friction, from the same fit [N m s/rad, N m].
    steps : int
        Of the encoder, per turn.
    source : str
        Where the figures are from.

    Examples
    --------
    >>> import rne
    >>> figures, arm = rne.control.servo_figures("sts3215-12v"), rne.load("irb140").locked({"joint_6": 0})
    >>> round(figures.no_load_speed, 2), figures.law(arm, p=32).kp[0].round(1).item()
    (4.72, 15.5)
    """

    stall_torque: float
    no_load_speed: float
    gain: float
    armature: float
    viscous: float
    coulomb: float
    steps: int
    source: str

    def law(self, robot: Robot, reference: ArrayLike | Reference = 0.0, *, p: float = 16.0) -> Servo:
        """Position control by such servos at all joints.

        Parameters
        ----------
        robot : Robot
            The robot, for the number of its joints.
        reference : float or array_like, shape (n,), or callable
            Positions to hold [rad], or a function f(t) -> (q, qd, qdd), of which the positions are taken.
        p : float
            The register P of the servos: LeRobot writes 16, 32 is the factory's.

        Returns
        -------
        Servo
            With kp = p gain stall_torque, kd = 0 and no dead band.

        Raises
        ------
        ValueError
            If the reference has the wrong shape or is not finite, or `p` is not positive.
        """
        kp = positive_number("p", p) * self.gain * self.stall_torque
        return servo(robot, kp, 0.0, reference, stall_torque=self.stall_torque, no_load_speed=self.no_load_speed)


SERVOS = {
    "sts3215-7.4v": ServoFigures(
        stall_torque=19.5 * KG_CM,
        no_load_speed=np.pi / 3 / 0.192,
        gain=0.166,
        armature=0.0261,
        viscous=0.0599,
        coulomb=0.0515,
        steps=4096,
        source="Feetech STS3215-C001, gear 1/345: 19.5 kg cm, 0.192 s per 60 degrees at 7.4 V (as sold by DFRobot, "
        "SER0069); gain, armature and friction: model M1 of github.com/Rhoban/bam, "
        "bam/params/feetech_sts3215_7_4V (commit 31e5b97)",
    ),
    "sts3215-12v": ServoFigures(
        stall_torque=30 * KG_CM,
        no_load_speed=np.pi / 3 / 0.222,
        gain=0.165,
        armature=0.0278,
        viscous=0.0616,
        coulomb=0.0528,
        steps=4096,
        source="Feetech STS3215-C018, gear 1/345: 30 kg cm, 0.222 s per 60 degrees at 12 V (issue 134 of "
        "github.com/TheRobotStudio/SO-ARM100); gain, armature and Coulomb friction of model M1, viscous of M4: "
        "github.com/kscalelabs/sysid, data/feetech/STS_3215_12V_20250317 (commits 0d8884a and 6b78737)",
    ),
}


def servo_figures(name: str) -> ServoFigures:
    """Published figures of a servo of the arms SO-100 and SO-101, as a start for fits.

    Parameters
    ----------
    name : {"sts3215-7.4v", "sts3215-12v"}
        Feetech STS3215 with gear 1/345, of followers, at a voltage. Of the leader's gears 1/191 and 1/147 no
        consistent figures are public.

    Returns
    -------
    ServoFigures
        Stall torque and no-load speed are nominal. The fits that gain, rotor and friction are from find 1.5 to 1.8
        times the nominal stall torque, before the losses in the gear, and a no-load speed of 6.3 rad/s at 7.4 V and
        3.3 rad/s at 12 V.

    Raises
    ------
    ValueError
        If no servo has this name.

    Notes
    -----
    The gain of the register D has no public unit; it is left out.

    Examples
    --------
    >>> import rne
    >>> figures = rne.control.servo_figures("sts3215-7.4v")
    >>> arm = rne.load("irb140")
    >>> friction = rne.Friction(viscous=figures.viscous, coulomb=figures.coulomb)
    >>> scene = rne.Scene(arm, controller=figures.law(arm), friction=friction, armature=figures.armature)
    """
    if name not in SERVOS:
        raise ValueError(f"`name` must be one of {list(SERVOS)}, got {name!r}")
    return SERVOS[name]
