"""A robot from its Denavit-Hartenberg table, in the standard or the modified convention."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array, rotate, rotate_back, rotation_about, snap
from .builder import Extended, Pose, pose
from .chain_parts import Geometry, Given, chain_model, checked_names, checked_types, rows
from .model import STANDARD_GRAVITY, Model

X, _, Z = np.eye(3, dtype=Extended)


def dh_chain(
    *,
    a: ArrayLike,
    alpha: ArrayLike,
    d: ArrayLike,
    theta: ArrayLike,
    convention: Literal["standard", "modified"] = "standard",
    masses: ArrayLike | None = None,
    centres: ArrayLike | None = None,
    inertias: ArrayLike | None = None,
    types: str | Sequence[str] = "revolute",
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    effort: ArrayLike | None = None,
    gravity: ArrayLike = STANDARD_GRAVITY,
    name: str = "chain",
    joint_names: Sequence[str] | None = None,
    link_names: Sequence[str] | None = None,
    base: str = "base_link",
    tip: str = "tool0",
) -> Model:
    """An unbranched robot from its Denavit-Hartenberg table; centres and inertias are seen from the DH frames.

    Parameters
    ----------
    a, alpha, d, theta : array_like, shape (n,)
        The columns of the table. The joint's position is added to theta (revolute) or to d (prismatic): what is given
        here for it is its offset, the value at q = 0 [m, rad, m, rad].
    convention : {"standard", "modified"}
        Standard (Siciliano, Corke's `SerialLink`, the thesis): T_i = Rot(z, theta) Trans(z, d) Trans(x, a)
        Rot(x, alpha); frame i lies at the far end of link i. Modified (Craig): T_i = Rot(x, alpha) Trans(x, a)
        Rot(z, theta) Trans(z, d), where row i holds a_{i-1} and alpha_{i-1}; frame i lies on the axis of joint i.
    masses : array_like, shape (n,), optional
        [kg]; links without masses, centres and inertias are massless.
    centres : array_like, shape (n, 3), optional
        Centre of mass of link i from the origin of DH frame i, in its axes (Corke's `r`). The thesis's r_{i-1,ci}
        counts from the origin of frame i-1: for that see `chain` [m].
    inertias : array_like, shape (n, 3, 3), optional
        About the centre of mass, in the axes of DH frame i [kg m^2].
    types : str or sequence of n str
        "revolute", "continuous" or "prismatic".
    lower, upper, velocity, effort : array_like, shape (n,), optional
        Limits, infinite where not given [rad or m; rad/s or m/s; N m or N].
    gravity : array_like, shape (3,)
        In frame 0 [m/s^2].
    name : str
        Of the robot.
    joint_names, link_names : sequence of n str, optional
        "joint_1", ... and "link_1", ... by default.
    base, tip : str
        Names of the link with DH frame 0, and of the link with DH frame n, fixed behind link n.

    Returns
    -------
    Model
        For `rne.Robot`; the last of `link_poses` is T_1 T_2 ... T_n. Its link i has the orientation of DH frame i. In
        the modified convention it is DH frame i; in the standard one its origin is on the axis of joint i, where DH
        frame i-1 has its own at q = 0.

    Raises
    ------
    ValueError
        If the convention or a type is unknown, an array has the wrong shape or is not finite, a mass is negative, an
        inertia has a negative eigenvalue, or a name is empty or given twice.

    Notes
    -----
    Siciliano et al. 2009, (2.52); Craig, Introduction to Robotics, (3.6); Høifødt 2011, chapter 4.

    Examples
    --------
    >>> import rne
    >>> arm = rne.dh_chain(a=[0.3, 0.2], alpha=[0, 0], d=[0, 0.1], theta=[0, 0])
    >>> rne.dynamics.link_poses(arm, [0.0, 0.0])[-1, :3, 3].tolist()
    [0.5, 0.0, 0.1]
    """
    if convention not in ("standard", "modified"):
        raise ValueError(f"`convention` must be 'standard' or 'modified', got {convention!r}")
    lengths = rows("a", a, (-1,))
    n = len(lengths)
    table = lengths, rows("alpha", alpha, (n,)), rows("d", d, (n,)), rows("theta", theta, (n,))
    given = Given(
        masses, centres, inertias, types, lower, upper, velocity, effort, gravity,
        name, joint_names, link_names, base, tip,
    )  # fmt: skip
    names = checked_names(given, n)
    kinds = checked_types(given, names.joints)
    geometry = _standard(*table) if convention == "standard" else _modified(*table)
    return chain_model(given, names, kinds, geometry)


def _rotations(angle: Array, axis: Array) -> Array:
    """Rotations by each of some angles; those by right angles are exact."""
    return snap(rotation_about(axis, angle))


def _standard(a: Array, alpha: Array, d: Array, theta: Array) -> Geometry:
    """Frame i at the far end of link i: a joint's frame has its orientation, and the origin of DH frame i-1."""
    n, Rx, Rz = len(a), _rotations(alpha, X), _rotations(theta, Z)
    end = [rotate_back(Rx[i], a[i] * X + d[i] * Z) for i in range(n)]  # r_{i-1,i}, seen from frame i
    start = [np.zeros(3, dtype=Extended), *end]
    placements = [pose(snap(Rz[i] @ Rx[i]), start[i]) for i in range(n)]
    return Geometry(placements, [Rx[i].T @ Z for i in range(n)], end, start[-1])


def _modified(a: Array, alpha: Array, d: Array, theta: Array) -> Geometry:
    """Frame i on the axis of joint i: it is the joint's frame."""
    n, Rx, Rz = len(a), _rotations(alpha, X), _rotations(theta, Z)
    placements = [Pose(snap(Rx[i] @ Rz[i]), a[i] * X + rotate(Rx[i], d[i] * Z)) for i in range(n)]
    return Geometry(placements, [Z] * n, [np.zeros(3)] * n, np.zeros(3))
