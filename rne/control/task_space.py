"""Control in the task space: impedance of a link, and operational-space control of its motion.

Wrenches and velocities of a link have rotations first, as `Robot.jacobian`. With the pose (R, p) of the link and a
target (R_d, p_d), stiffnesses K_r and K_t belong to the potential

    V = tr(G (1 - R R_d^T)) + (p - p_d)^T K_t (p - p_d) / 2,  G = tr(K_r) / 2 - K_r,

in the root link's axes. For small angles it is theta^T K_r theta / 2; half a turn away from the target it has a saddle,
at which the moment vanishes. The moment is minus the gradient, so that V and the kinetic energy together fall at the
rate of the damping: a moment K_r times the logarithm of R R_d^T, or times its skew part, is no gradient, and a motion
around a closed path can take energy from it (Fasse and Broenink 1997; Zhang and Fasse 2000).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import check_function, per_joint_array, real_array
from ..basics.spatial import Array, rotate, symmetric, transpose, zeros
from ..basics.text import summary
from ..robot import Robot, rows_argument
from .laws import PD, of_robot, pd, reference_values

VEE = np.array([[2, 1], [0, 2], [1, 0]])  # entries of a skew-symmetric matrix that form its vector
ROTATION = 1e-9  # largest deviation of a pose's R^T R from the identity
NOT_NEGATIVE = -1e-12  # smallest eigenvalue relative to the largest of a positive semidefinite matrix with rounding

Target = Callable[[float], Any]


@dataclass(frozen=True, eq=False)
class Impedance:
    """A spring and a damper between a link and a target pose, made by `impedance`; its attributes are its arguments."""

    robot: Robot
    link: str
    stiffness: Array
    damping: Array
    pose: Array | Target
    axes: str
    posture: PD | None
    projector: bool
    traceable = True

    __repr__ = summary

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Torques [N m or N] at time t [s] for positions and velocities q, qd, shape (..., n)."""
        robot, (target, twist) = self.robot, target_values(self.pose, t)
        T, J = link_pose(robot, q, self.link), robot.jacobian(q, self.link)
        K, D = (in_base_axes(X, target, self.axes) for X in (self.stiffness, self.damping))
        wrench = spring_wrench(T, target, K) - rotate(D, rotate(J, qd) - twist)
        torques: Array = rotate(transpose(J), wrench) + robot.gravity_torque(q)
        return with_posture(self, torques, t, q, qd)

    def potential_energy(self, t: float, q: ArrayLike) -> Array:
        """Energy in the springs of link and posture.

        Parameters
        ----------
        t : float
            Time, for a target that moves [s].
        q : array_like, shape (..., n)
            Joint positions [rad or m].

        Returns
        -------
        ndarray, shape (...)
            Zero where link and joints are where they are held [J].

        Examples
        --------
        >>> import rne
        >>> arm, q = rne.load("irb140"), [0, 0, 0, 0, 1.0, 0]
        >>> law = rne.control.impedance(arm, "tool0", [50] * 3 + [800] * 3, [5] * 3 + [80] * 3, arm.link_poses(q)[-1])
        >>> law.potential_energy(0.0, q).round(12).item() == 0
        True
        """
        q = np.asarray(q, dtype=float)
        (target, _), T = target_values(self.pose, t), link_pose(self.robot, q, self.link)
        K, e = in_base_axes(self.stiffness, target, self.axes), T[..., :3, 3] - target[:3, 3]
        G = np.trace(K[:3, :3]) / 2 * np.eye(3) - K[:3, :3]
        turned = np.trace(G @ (np.eye(3) - T[..., :3, :3] @ target[:3, :3].T), axis1=-2, axis2=-1)
        V: Array = turned + (e * rotate(K[3:, 3:], e)).sum(-1) / 2
        if self.posture is not None:
            V = V + (self.posture.kp * (q - self.posture.reference) ** 2).sum(-1) / 2
        return V


def with_posture(law: Any, torques: Array, t: float, q: Array, qd: Array, rows: Any = None) -> Array:
    """Torques plus the posture's, which are projected into the null space of the task if `law.projector` is True."""
    if law.posture is None:
        return torques
    held = law.posture(t, q, qd)
    if law.projector:
        held = rotate(law.robot.null_space(q, law.link, rows=rows), held)
    total: Array = torques + held
    return total


def link_pose(robot: Robot, q: Array, link: str) -> Array:
    """Pose of a link in the root link's frame, shape (..., 4, 4)."""
    pose: Array = robot.link_poses(q)[..., robot.model.link_index(link), :, :]
    return pose


def spring_wrench(T: Array, target: Array, K: Array) -> Array:
    """[moment; force], minus the gradient of the potential of a stiffness in the root link's axes, shape (..., 6)."""
    G = (K[0, 0] + K[1, 1] + K[2, 2]) / 2 * np.eye(3) - K[:3, :3]
    A = T[..., :3, :3] @ (target[:3, :3].T @ G)
    moment = A[..., VEE[:, 1], VEE[:, 0]] - A[..., VEE[:, 0], VEE[:, 1]]
    return np.concatenate([moment, -rotate(K[3:, 3:], T[..., :3, 3] - target[:3, 3])], axis=-1)


def in_base_axes(X: Array, target: Array, axes: str) -> Array:
    """Matrix (6, 6) in the root link's axes, from one whose blocks are in the target's or the root link's axes."""
    if axes == "base":
        return X
    turn = zeros((6, 6), like=target)
    turn[:3, :3] = turn[3:, 3:] = target[:3, :3]
    product: Array = turn @ X @ turn.T
    return product


def target_values(pose: Any, t: Any) -> tuple[Array, Array]:
    """The target pose (4, 4) and its velocity [omega; v] in the root link's axes; zero unless it is given."""
    if not callable(pose):
        return pose, np.zeros(6)
    found = pose(t)
    target, twist = found if isinstance(found, tuple) else (found, np.zeros(6))
    target, twist = np.asarray(target), np.asarray(twist)
    if target.shape != (4, 4) or twist.shape != (6,):
        raise ValueError(f"`pose` must give (4, 4), or ((4, 4), (6,)), got {target.shape} and {twist.shape}")
    return target, twist


def pose_argument(pose: Any) -> Any:
    """A target pose, or the function of time that gives it."""
    if callable(pose):
        check_function("pose", pose, "(t)")
        target_values(pose, 0.0)
        return pose
    T = real_array("pose", pose, "(4, 4)").astype(float)
    R = T[:3, :3]
    if abs(R.T @ R - np.eye(3)).max() > ROTATION or np.linalg.det(R) < 0 or (T[3] != [0, 0, 0, 1]).any():
        raise ValueError("`pose` must be a homogeneous matrix: a rotation, a translation and the row 0, 0, 0, 1")
    return T


def task_matrix(name: str, value: ArrayLike, *, blocks: bool) -> Array:
    """Positive semidefinite (6, 6) matrix from six diagonal entries, a matrix, or its two blocks."""
    given = np.asarray(value)
    if given.shape not in ((6,), (6, 6)):
        raise ValueError(f"`{name}` must have shape (6,) or (6, 6), rotations first, got {given.shape}")
    X = np.diag(real_array(name, given, "(6,)")) if given.ndim == 1 else real_array(name, given, "(6, 6)")
    X = X.astype(float)
    values = np.linalg.eigvalsh(symmetric(X))
    if (X != X.T).any() or values[0] < NOT_NEGATIVE * abs(values[-1]):
        raise ValueError(
            f"`{name}` must be six numbers that are not negative, or a symmetric matrix that is not indefinite"
        )
    if blocks and X[:3, 3:].any():
        raise ValueError(f"`{name}` must have two blocks of shape (3, 3), rotations first: no terms couple both")
    return X


def critical_damping(stiffness: Array, inertia: Array) -> Array:
    """Damping 2 Q diag(w) Q^T, critical in every mode, for K = Q diag(w^2) Q^T and Lambda = Q Q^T, shape (6, 6)."""
    from scipy.linalg import eigh

    w2, V = eigh(stiffness, inertia)
    Q = inertia @ V
    return symmetric(Q @ (2 * np.sqrt(np.maximum(w2, 0))[:, None] * Q.T))


@of_robot
def impedance(
    robot: Robot,
    link: str,
    stiffness: ArrayLike,
    damping: ArrayLike | str,
    pose: ArrayLike | Target,
    *,
    posture: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
    projector: bool = False,
    inertia: ArrayLike | None = None,
    axes: str = "target",
) -> Impedance:
    """A spring and a damper between a link and a target pose, with gravity compensated.

    u = J^T (moment; force) + g(q). The link is soft: pushed by F at its origin it moves by about K^-1 F.

    Parameters
    ----------
    robot : Robot
        The controller's model.
    link : str
        One of `link_names`.
    stiffness : array_like, shape (6,) or (6, 6)
        Rotations first; as a matrix symmetric, of two blocks [N m/rad; N/m].
    damping : array_like, shape (6,) or (6, 6), or "critical"
        "critical" for damping ratio 1 of every mode of `inertia` with `stiffness` [N m s/rad; N s/m].
    pose : array_like, shape (4, 4), or callable
        Target pose in the root link's frame, or a function of time that gives it, or a tuple of it and its velocity
        [omega; v] in the root link's axes, shape (6,), which is taken as zero otherwise.
    posture : tuple of three array_like, optional
        Positions, stiffness and damping of springs in the joints: they hold what the link leaves free, and pull at the
        link too [rad or m; N m/rad; N m s/rad].
    projector : bool
        True for the part of the posture's torques that does not accelerate the link, `Robot.null_space`. The energy of
        the closed loop need not fall then.
    inertia : array_like, shape (6, 6), optional
        For critical damping: `robot.task_inertia(q, link)` at the target, in the root link's axes. By default the
        inertia at the positions of `posture`, at time 0 if these move, which should place the link at the target.
    axes : {"target", "base"}
        Axes of stiffness and damping: the target's or the root link's.

    Returns
    -------
    Impedance
        The law f(t, q, qd) -> torques. Without a projector, energy of motion plus `potential_energy` falls as long as
        nothing else pushes and the target rests.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or is negative, there is no such link or axes, or damping is
        "critical" without inertia and posture.
    SingularMassMatrixError
        If critical damping needs the inertia of a singular pose; the law itself needs no inertia.

    Notes
    -----
    Hogan 1985; the potential is in the heading of ``rne/control/task_space.py``. Critical damping follows
    Albu-Schäffer et al. 2003, section III: with the task inertia Lambda = Q Q^T and K = Q diag(w^2) Q^T it is D = 2 Q
    diag(w) Q^T. The ratio is 1 in the pose of the inertia; in other poses it differs, since D is constant.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, q = rne.load("irb140"), np.array([0, 0, 0, 0, 1.0, 0])
    >>> pose = robot.link_poses(q)[-1]
    >>> law = rne.control.impedance(robot, "tool0", [100] * 3 + [2000] * 3, [10] * 3 + [200] * 3, pose)
    >>> np.allclose(law(0.0, q, 0 * q), robot.gravity_torque(q))
    True
    """
    robot.model.link_index(link)
    if axes not in ("target", "base"):
        raise ValueError(f"`axes` must be 'target' or 'base', got {axes!r}")
    K, target = task_matrix("stiffness", stiffness, blocks=True), pose_argument(pose)
    held = posture_argument(robot, posture)
    if not isinstance(damping, str):
        if inertia is not None:
            raise ValueError("`inertia` is for damping 'critical' only")
        D = task_matrix("damping", damping, blocks=False)
    elif damping == "critical":
        L = task_matrix("inertia", inertia_at(robot, link, held) if inertia is None else inertia, blocks=False)
        D = critical_damping(K, in_base_axes(L, np.linalg.inv(target_values(target, 0.0)[0]), axes))
    else:
        raise ValueError(f"`damping` must be an array or 'critical', got {damping!r}")
    return Impedance(robot, link, K, D, target, axes, held, bool(projector))


def inertia_at(robot: Robot, link: str, posture: PD | None) -> Array:
    """Task inertia of a link at the positions of a posture, at time 0 if these move."""
    if posture is None:
        cure = "give `inertia`, such as robot.task_inertia(q, link), or `posture`, whose positions are taken then"
        raise ValueError(f"damping 'critical' needs an inertia, which depends on joint positions: {cure}")
    q = posture.reference
    return robot.task_inertia(reference_values(robot, q(0.0))[0] if callable(q) else q, link)


def posture_argument(robot: Robot, posture: Any) -> PD | None:
    """Springs in the joints as a control law."""
    if posture is None:
        return None
    if not isinstance(posture, tuple) or len(posture) != 3:
        raise ValueError("`posture` must be a tuple of positions, stiffness and damping")
    return pd(robot, posture[1], posture[2], posture[0])


@dataclass(frozen=True, eq=False)
class OperationalSpace:
    """Computed torque of a link's motion, made by `operational_space`; its attributes are its arguments."""

    robot: Robot
    link: str
    kp: Array
    kd: Array
    reference: Target
    rows: tuple[int, ...]
    posture: PD | None
    traceable = True
    projector = True

    __repr__ = summary

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Torques [N m or N] at time t [s] for positions and velocities q, qd, shape (..., n)."""
        robot, rows = self.robot, list(self.rows)
        target, twist, rate = motion_values(self.reference(t))
        T, J = link_pose(robot, q, self.link), robot.jacobian(q, self.link)
        unit = spring_wrench(T, target, np.eye(6))  # minus the errors: half of a skew part is sin(angle) times the axis
        wanted = rate[rows] - self.kd * (rotate(J, qd) - twist)[..., rows] + self.kp * unit[..., rows]
        force = rotate(robot.task_inertia(q, self.link, rows=rows), wanted)
        force = force + robot.task_bias(q, qd, self.link, rows=rows)
        torques: Array = rotate(transpose(J[..., rows, :]), force)
        return with_posture(self, torques, t, q, qd, rows)


def motion_values(given: Any) -> tuple[Array, Array, Array]:
    """Pose, velocity and acceleration of a link, from a reference."""
    shapes = [np.shape(part) for part in given] if isinstance(given, tuple) else []
    if shapes != [(4, 4), (6,), (6,)]:
        raise ValueError(f"`reference` must give shapes (4, 4), (6,) and (6,), got {shapes or 'something else'}")
    pose, twist, rate = map(np.asarray, given)
    return pose, twist, rate


@of_robot
def operational_space(
    robot: Robot,
    link: str,
    kp: ArrayLike,
    kd: ArrayLike,
    reference: Target,
    *,
    rows: str | list[int] | None = None,
    posture: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
) -> OperationalSpace:
    """Computed torque in the task space: J^T (Lambda a + mu) with a = a_ref - Kd (v - v_ref) - Kp e.

    Parameters
    ----------
    robot : Robot
        The controller's model.
    link : str
        One of `link_names`.
    kp, kd : float or array_like, one number per row
        Gains, not negative [1/s^2, 1/s].
    reference : callable
        A function of time that gives the pose (4, 4), velocity [omega; v] (6,) and acceleration (6,) of the link in
        the root link's axes.
    rows : {"xyz", "rotation"} or list of int, optional
        What is controlled, as in `Robot.task_inertia`: all six rows by default.
    posture : tuple of three array_like, optional
        Positions, stiffness and damping of springs in the joints, in the null space of the rows.

    Returns
    -------
    OperationalSpace
        The law f(t, q, qd) -> torques. The error of rotation is the sine of the angle times the axis.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or is negative, or there is no such link or row.

    Notes
    -----
    Khatib 1987, (45). Near singular poses torques grow without bound; where M or the pose is singular the law raises a
    SingularMassMatrixError with the lost direction.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, q, rest = rne.load("irb140"), np.array([0, 0, 0, 0, 1.0, 0]), np.zeros(6)
    >>> pose = robot.link_poses(q)[-1]
    >>> law = rne.control.operational_space(robot, "tool0", 100, 20, lambda t: (pose, rest, rest))
    >>> np.allclose(law(0.0, q, rest), robot.gravity_torque(q))
    True
    """
    robot.model.link_index(link)
    check_function("reference", reference, "(t)")
    motion_values(reference(0.0))
    chosen = rows_argument(rows)
    p, d = (per_joint_array(name, x, len(chosen), sign="not negative") for name, x in (("kp", kp), ("kd", kd)))
    return OperationalSpace(robot, link, p, d, reference, chosen, posture_argument(robot, posture))
