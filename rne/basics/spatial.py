"""Three-vectors, rotations and the inertia of rigid bodies.

Everything broadcasts over leading axes and takes any dtype: float32, float64, long double, complex,
or object arrays of mpmath numbers. Nothing here knows about robots.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Map = Callable[[Array], Array]

# Entries of a rotation this close to 0 or +-1 are roundings of an exact 0 or +-1; a real angle is larger.
SNAP = 4 * float(np.finfo(np.float64).eps)

YZX, ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])  # cyclic orders of the axes
# Small integers are promoted to the dtype of the other operand.
IDENTITY = np.eye(3, dtype=np.int8)
CROSS_ENTRIES = np.array([[0, 2, 1], [2, 0, 0], [1, 0, 0]])  # [v]x has these entries of v,
CROSS_SIGNS = np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]], np.int8)  # times these


def zeros(shape: tuple[int, ...], like: Array) -> Array:
    """Zeros of the dtype of `like`, to be filled by assignment."""
    return np.zeros(shape, dtype=like.dtype)


def cross(a: Array, b: Array) -> Array:
    """Cross product a x b of vectors along the last axis."""
    product: Array = a.take(YZX, -1) * b.take(ZXY, -1) - a.take(ZXY, -1) * b.take(YZX, -1)
    return product


def dot(a: Array, b: Array) -> Array:
    """Scalar product of vectors along the last axis."""
    product: Array = (a * b).sum(-1, keepdims=True)[..., 0]  # an array also for single vectors of objects
    return product


def cross_matrix(v: Array) -> Array:
    """Matrix [v]x with [v]x u = v x u, shape (..., 3, 3)."""
    product: Array = v.take(CROSS_ENTRIES, -1) * CROSS_SIGNS
    return product


def outer(a: Array, b: Array) -> Array:
    """Matrix a b^T of two vectors, shape (..., 3, 3)."""
    product: Array = a[..., :, None] * b[..., None, :]
    return product


def transpose(A: Array) -> Array:
    """Transposed matrices."""
    return np.swapaxes(A, -1, -2)


def rotate(R: Array, v: Array) -> Array:
    """Vector R v: from the axes of the rotated frame to those of the reference frame."""
    product: Array = (R @ v[..., None])[..., 0]
    return product


def rotate_back(R: Array, v: Array) -> Array:
    """Vector R^T v: from the axes of the reference frame to those of the rotated frame."""
    return rotate(transpose(R), v)


def _elementwise(name: str) -> Any:
    plain = getattr(math, name)

    def apply(x: Any) -> Any:
        if hasattr(x, name):
            return getattr(x, name)()
        if hasattr(x, "context"):  # mpmath: its context holds the precision
            return getattr(x.context, name)(x)
        return plain(x)

    return np.frompyfunc(apply, 1, 1)


_object_sin, _object_cos, _object_sqrt = map(_elementwise, ("sin", "cos", "sqrt"))


def sincos(angle: Array) -> tuple[Array, Array]:
    """Sine and cosine; np.sin itself fails on mpmath numbers."""
    if np.asarray(angle).dtype == object:
        return _object_sin(angle), _object_cos(angle)
    return np.sin(angle), np.cos(angle)


def sqrt(x: Array) -> Array:
    """Square root; np.sqrt itself fails on mpmath numbers."""
    return np.asarray(_object_sqrt(x)) if np.asarray(x).dtype == object else np.sqrt(x)


def rotation_about(axis: Array, angle: Array) -> Array:
    """Rotation by `angle` about the unit vector `axis` (Rodrigues), shape (..., 3, 3).

    Written as b b^T + cos (1 - b b^T) + sin [b]x, so that about a coordinate axis every 0 and 1 is exact.
    """
    sin, cos = sincos(angle)
    along = outer(axis, axis)
    across = IDENTITY - along
    product: Array = along + cos[..., None, None] * across + sin[..., None, None] * cross_matrix(axis)
    return product


def snap(x: Array) -> Array:
    """Set entries within 4 eps of 0, 1 or -1 to them; larger deviations are real and stay."""
    x = np.array(x)
    for exact in (0, 1, -1):
        x[np.abs(x - exact) <= SNAP] = exact
    return x


def rotation_from_rpy(rpy: Array, *, snapped: bool = True) -> Array:
    """Rotation by URDF's fixed-axis roll, pitch, yaw: Rz(yaw) Ry(pitch) Rx(roll), entries snapped by default."""
    x, y, z = np.eye(3, dtype=np.asarray(rpy).dtype)
    roll, pitch, yaw = (rotation_about(b, angle) for b, angle in zip((x, y, z), rpy, strict=True))
    R: Array = yaw @ pitch @ roll
    return snap(R) if snapped else R


def rpy_from_rotation(R: Array) -> Array:
    """Roll, pitch and yaw of one rotation matrix; at pitch = +-pi/2, where they are not unique, roll is 0.

    Roll is that of Rz(yaw)^T R: near pitch = +-pi/2 yaw has few digits, but its sum or difference with roll has all.
    """
    across = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], across)
    if across <= SNAP:
        return np.array([0.0, pitch, math.atan2(-R[0, 1], R[1, 1])])
    c, s = R[0, 0] / across, R[1, 0] / across  # of yaw
    roll = math.atan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, math.atan2(s, c)])


def unit_vector(v: Array) -> Array:
    """Unit vector along v, whose entries may be too large or too small to be squared."""
    scaled = v / np.abs(v).max()
    unit: Array = scaled / np.sqrt((scaled * scaled).sum())
    return unit


def point_mass_inertia(mass: Array, c: Array) -> Array:
    """Inertia about the origin of a point mass at c: m (c.c 1 - c c^T), the parallel-axis term [kg m^2]."""
    product: Array = mass * (dot(c, c)[..., None, None] * IDENTITY - outer(c, c))
    return product


def symmetric(A: Array) -> Array:
    """Symmetric part of square matrices."""
    return np.asarray((A + transpose(A)) / 2)


def mirrored(A: Array) -> Array:
    """Symmetric matrix from its upper triangle, so that both halves are the same numbers."""
    rows, columns = np.tril_indices(A.shape[-1], -1)
    whole = A.copy()
    whole[..., rows, columns] = A[..., columns, rows]
    return whole


def spin_matrix(omega: Array, alpha: Array) -> Array:
    """Matrix U with U r = alpha x r + omega x (omega x r)."""
    W = cross_matrix(omega)
    product: Array = cross_matrix(alpha) + W @ W
    return product


def combine_bodies(bodies: list[tuple[Any, Array, Array]]) -> tuple[Any, Array, Array]:
    """Rigid body composed of several: (mass, centre of mass, inertia about it), all in the same frame.

    Massless bodies may have a moment of inertia; if all are massless, the centre is the origin.
    """
    mass = sum(m for m, _, _ in bodies)
    moment: Array = np.sum([m * c for m, c, _ in bodies], axis=0)
    com = moment / mass if mass > 0 else 0 * moment
    inertia: Array = np.sum([I + point_mass_inertia(m, c - com) for m, c, I in bodies], axis=0)
    return mass, com, inertia


def note_solution(x: Array, solve: Map, product: Map, residual: Map) -> None:
    """Declare traced numbers x as the solution of residual(x) = 0 with derivative M, for their derivatives.

    Differentiating the computation of x, such as the factors of M, would lose twice as many digits.
    """
    traced = next((entry for entry in x.flat if hasattr(entry, "graph")), None) if x.dtype == object else None
    if traced is not None:
        traced.graph.note_solution(x, solve, product, residual)


def note_finite(x: Array) -> None:
    """Declare traced numbers x as finite for kernels; where they are not, the recursion computes the state."""
    for entry in x.flat if x.dtype == object else ():
        if hasattr(entry, "graph"):
            entry.graph.note_finite(entry.ref)


def christoffel(dM: Array) -> Array:
    """Christoffel symbols (dM_kj/dq_i + dM_ki/dq_j - dM_ij/dq_k) / 2 of the derivatives dM_ij/dq_k of a matrix M."""
    dM_kj_dq_i: Array = np.swapaxes(dM, -3, -1)  # [i, j, k]
    dM_ki_dq_j = np.swapaxes(dM_kj_dq_i, -3, -2)
    return np.asarray((dM_kj_dq_i + dM_ki_dq_j - dM) / 2)
