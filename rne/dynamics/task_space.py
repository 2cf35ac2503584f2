"""Dynamics of a point of a link: its inertia, the force of its motion, the inverse with least kinetic energy.

With v = J qd, where J has the chosen rows of the Jacobian, tau = J^T (Lambda dv/dt + mu) moves the point as if it were
a body of inertia Lambda (Khatib 1987). Rotations come before translations; axes are the root link's or the link's own.

| quantity                            | code         | Khatib 1987 | Siciliano, Khatib 2016, chapter 8 |
|-------------------------------------|--------------|-------------|-----------------------------------|
| inertia of the task (J M^-1 J^T)^-1 | task_inertia | Lambda      | Lambda                            |
| force at dv/dt = 0                  | task_bias    | mu + p      | mu + p                            |
| M^-1 J^T Lambda                     | task_inverse | J-bar       | J-bar                             |

At a singular pose J M^-1 J^T is singular, as no torque accelerates the point in some direction; like M it is judged by
its pivots. `damping` d adds d times the diagonal: then Lambda stays below 1/d of each direction's own inertia, and the
point no longer follows exactly.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from ..basics.spatial import Array, mirrored, rotate, transpose
from ..errors import SingularMassMatrixError
from ..model.model import Model
from ..model.parameters import of_states
from .crba import mass_matrix, solve_with_pivots
from .kinematics import ORIGIN, Point, jacobian, jacobian_rate, link_poses
from .precision import SINGULAR, check_singularity, pivots_below
from .quantity import BatchIndex, PrecisionStatus, Solved, checked_quantity
from .rnea import bias_torque, inertia_torque

Rows = tuple[int, ...]  # of the Jacobian
ROWS = (0, 1, 2, 3, 4, 5)
DIRECTIONS = tuple(f"{motion} {axis}" for motion in ("rotation about", "translation along") for axis in "xyz")
BASE_AXES, LINK_AXES = "base", "link"
TASK: dict[str, Any] = {"link": "", "point": ORIGIN, "rows": ROWS, "axes": BASE_AXES}
SHARE = 0.1  # smallest named component of a direction relative to the largest


def task_jacobian(model: Model, q: Array, link: str, point: Point, rows: Rows, axes: str) -> Array:
    """Rows of the Jacobian of a point, in the axes of the root link or the link."""
    return _in_axes(model, q, jacobian.core(model, q, link, point), link, axes)[..., rows, :]


def _in_axes(model: Model, q: Array, J: Array, link: str, axes: str) -> Array:
    if axes == BASE_AXES:
        return J
    return in_link_axes(link_poses.core(model, q)[..., model.link_index(link), :3, :3], J)


def in_link_axes(R: Array, J: Array) -> Array:
    """Matrix (..., 6, k) of angular and linear rows in the root link's axes, turned to those of a link."""
    return np.concatenate([transpose(R) @ J[..., :3, :], transpose(R) @ J[..., 3:, :]], axis=-2)


def _solved(A: Array, parent: tuple[int, ...], Y: Array, product: Any = None) -> Solved:
    """Solution X of A X^T = Y^T, row by row, the pivots of A and its diagonal."""
    rows = [solve_with_pivots(A, parent, Y[..., k, :], product) for k in range(Y.shape[-2])]
    return np.stack([x for x, _, _ in rows], axis=-2), *rows[0][1:]


def _inertia(
    model: Model, q: Array, link: str, point: Point, rows: Rows, damping: float, axes: str
) -> tuple[Array, Array, Array, Array]:
    """Lambda, J M^-1, and the pivots and diagonals of M and of J M^-1 J^T."""
    if not model.n:
        raise pose_error(model, np.zeros(0), (), link, rows, point=point, axes=axes)
    J = task_jacobian(model, q, link, point, rows, axes)
    M = mass_matrix.core(model, q)
    X, pivots, diagonal = _solved(M, model.coordinate_parent, J, partial(inertia_torque, model, q))
    mobility, m = mirrored(J @ transpose(X)), range(len(rows))
    mobility[..., m, m] = (1 + damping) * mobility[..., m, m]
    unit = np.zeros_like(mobility) + np.eye(len(rows))
    Lambda, own, sizes = _solved(mobility, tuple(k - 1 for k in m), unit)
    pivots, diagonal = np.concatenate([pivots, own], axis=-1), np.concatenate([diagonal, sizes], axis=-1)
    return mirrored(Lambda), X, pivots, diagonal


def check_task(
    model: Model, arguments: Mapping[str, Any], result: Array, pivots: Array, diagonal: Array
) -> PrecisionStatus:
    """Status: an error if M is singular, or the point cannot be moved in some direction."""
    status, n = check_singularity(model, arguments, result, pivots[..., : model.n], diagonal[..., : model.n]), model.n
    lost = pivots_below(SINGULAR, pivots[..., n:], diagonal[..., n:]).any(axis=-1)
    if status.error is not None or not lost.any():
        return status
    state = tuple(int(k) for k in np.argwhere(lost)[0])
    given = {name: arguments.get(name, default) for name, default in TASK.items()}
    return PrecisionStatus(error=pose_error(of_states(model, state), arguments["q"][state].real, state, **given))


def pose_error(
    model: Model, q: Array, state: BatchIndex, link: str, rows: Rows, point: Point, axes: str
) -> SingularMassMatrixError:
    """Error that names the directions of the combined motion that no torque accelerates."""
    J = task_jacobian(model, q, link, point, rows, axes)
    M = mass_matrix.core(model, q)
    mobility = J @ np.linalg.solve(M, J.T)
    sizes = np.sqrt(np.diagonal(mobility))
    fixed = [DIRECTIONS[row] for row, size in zip(rows, sizes, strict=True) if not size > 0]
    if not fixed:
        weakest = np.abs(np.linalg.eigh(mobility / sizes / sizes[:, None])[1][:, 0])
        fixed = [DIRECTIONS[row] for row, x in zip(rows, weakest, strict=True) if x > SHARE * weakest.max()]
    what = f"the pose is singular for link {link!r}"
    cure = "leave out rows, or give `damping`"
    return SingularMassMatrixError(what, f": no torques accelerate a {', '.join(fixed)}; {cure}", tuple(fixed), state)


@checked_quantity(check_task)
def task_inertia(
    model: Model,
    q: Array,
    link: str,
    point: Point = ORIGIN,
    rows: Rows = ROWS,
    damping: float = 0.0,
    axes: str = BASE_AXES,
) -> Solved:
    """Inertia of a point of a link, Lambda = (J M^-1 J^T)^-1: the force per acceleration of the point.

    Khatib 1987. Parameters, result and errors are those of `rne.Robot.task_inertia`, with the model first.
    """
    Lambda, _, pivots, diagonal = _inertia(model, q, link, point, rows, damping, axes)
    return Lambda, pivots, diagonal


@checked_quantity(check_task)
def task_inverse(
    model: Model,
    q: Array,
    link: str,
    point: Point = ORIGIN,
    rows: Rows = ROWS,
    damping: float = 0.0,
    axes: str = BASE_AXES,
) -> Solved:
    """Dynamically consistent inverse M^-1 J^T Lambda of the Jacobian of a point, shape (..., n, m).

    Khatib 1987. Parameters, result and errors are those of `rne.Robot.task_inverse`, with the model first.
    """
    Lambda, X, pivots, diagonal = _inertia(model, q, link, point, rows, damping, axes)
    return transpose(X) @ Lambda, pivots, diagonal


@checked_quantity(check_task)
def task_bias(
    model: Model,
    q: Array,
    qd: Array,
    link: str,
    point: Point = ORIGIN,
    rows: Rows = ROWS,
    damping: float = 0.0,
    axes: str = BASE_AXES,
) -> Solved:
    """Force at a point that does not accelerate, Lambda (J M^-1 (C qd + g) - dJ/dt qd).

    Khatib 1987. Parameters, result and errors are those of `rne.Robot.task_bias`, with the model first.
    """
    Lambda, X, pivots, diagonal = _inertia(model, q, link, point, rows, damping, axes)
    rate = _in_axes(model, q, rotate(jacobian_rate.core(model, q, qd, link, point), qd)[..., None], link, axes)
    force = rotate(X, bias_torque.core(model, q, qd)) - rate[..., rows, 0]
    return rotate(Lambda, force), pivots, diagonal
