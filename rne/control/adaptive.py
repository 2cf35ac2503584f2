"""Adaptive control: tracking by a law that corrects the inertial parameters of its model on the way."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, vector
from ..robot import Robot
from .adaptive_law import SMOOTHING, Adaptive
from .estimates import adapted_bodies
from .laws import checked_vectors
from .reference import Reference, check_reference


def adaptive(
    robot: Robot,
    kd: ArrayLike,
    bandwidth: ArrayLike,
    reference: Reference,
    *,
    gain: float = 1.0,
    bodies: Sequence[str] | None = None,
    consistent: bool = False,
    viscous: ArrayLike | None = None,
    coulomb: ArrayLike | None = None,
    smoothing: float = SMOOTHING,
    torque_limit: ArrayLike | None = None,
) -> Adaptive:
    """Tracking with parameters that adapt: u = Y pi - Kd s, with s = e' + bandwidth e and d(pi)/dt = -Gamma Y^T s.

    Parameters
    ----------
    robot : Robot
        The controller's model. Its parameters are the first estimates.
    kd : array_like, shape (n,)
        Gains of the composite error s [N m s/rad or N s/m].
    bandwidth : array_like, shape (n,)
        Decay of the tracking error e = q - q_ref once s is zero [1/s].
    reference : callable
        A function f(t) -> (q, qd, qdd).
    gain : float
        Rate of adaptation [1/J]: work of s against a torque that a body's whole start value causes changes the estimate
        by `gain` times that work, relative to the start.
    bodies : sequence of str, optional
        Joints whose bodies are adapted, such as the last one, which carries the payload. If not given, all whose
        pseudo-inertia is positive definite: bodies without mass, without extent or not possible are left as they are.
    consistent : bool
        True for the natural adaptation law, by which every estimate stays a possible body: a positive definite
        pseudo-inertia.
    viscous, coulomb : array_like, shape (n,), optional
        First estimates of friction coefficients, which are adapted too, in proportion to them; friction that is not
        given is not modelled [N m s/rad or N s/m; N m or N].
    smoothing : float
        Coulomb friction is modelled as Fc tanh(rate / smoothing) [rad/s or m/s].
    torque_limit : array_like, shape (n,), optional
        The drives' limits. The adaptation slows down where a torque comes within 10 % of them, and pauses beyond: what
        the drives do not deliver would pass for an error of the parameters [N m or N].

    Returns
    -------
    Adaptive
        For a Scene: f(t, q, qd, z) -> (torques, dz/dt).

    Raises
    ------
    ValueError
        If an array has the wrong shape or sign or is not finite, a joint of `bodies` does not exist, the body of one
        cannot be adapted, or there is nothing to adapt: no such body, and no friction.

    Notes
    -----
    Slotine and Li 1987. The metric of the parameters is that of the pseudo-inertias P at the start, P0: with S from Y^T
    s, dP/dt = -gain P0 S P0, which is a constant Gamma; the consistent law is dP/dt = -gain P S P, Lee, Kwon and Park
    2018. Both make V = s^T M s / 2 + distance / gain fall, V' = -s^T Kd s, so that the tracking error goes to zero for
    any gains, if the robot that moves differs from the model in the parameters that are adapted alone. With
    `torque_limit` this holds while every torque is below 90 % of its limit; beyond, adaptation slows down and V may
    grow. The proof fails with saturated drives, by which the estimates of the consistent law can grow without bound in
    finite time if `torque_limit` is not given; with friction or disturbances that are not modelled, which let estimates
    drift; and with a sampled controller whose sample time is long. The parameters themselves converge if the reference
    excites all of them persistently; combinations that do not act on the torques never do.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 1.0)
    >>> law = rne.control.adaptive(robot, [20] * 6, [10] * 6, path, bodies=["joint_6"])
    >>> law.states, law.parameters(np.zeros(10))[50].item()  # the mass of link 6
    (10, 1.0)
    """
    d, rate = checked_vectors(robot, kd=kd, bandwidth=bandwidth)
    for name, value in (("kd", d), ("bandwidth", rate)):
        vector(name, value, robot.n, sign="positive")
    check_reference(robot, reference)
    viscous, coulomb, limit = (
        None if value is None else vector(name, value, robot.n, sign="positive")
        for name, value in (("viscous", viscous), ("coulomb", coulomb), ("torque_limit", torque_limit))
    )
    return Adaptive(
        robot,
        d,
        rate,
        reference,
        positive_number("gain", gain),
        adapted_bodies(robot, bodies, required=viscous is None and coulomb is None),
        consistent,
        viscous,
        coulomb,
        positive_number("smoothing", smoothing),
        limit,
    )
