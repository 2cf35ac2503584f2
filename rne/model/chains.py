"""A robot from the arrays of the thesis's appendix B: rotations, vectors between frames, masses, inertias."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array, snap
from .builder import Extended, pose
from .chain_parts import Geometry, Given, chain_model, checked_names, checked_types, rows
from .model import STANDARD_GRAVITY, Model
from .validation import is_rotation


def chain(
    rotations: ArrayLike,
    positions: ArrayLike,
    masses: ArrayLike | None = None,
    centres: ArrayLike | None = None,
    inertias: ArrayLike | None = None,
    *,
    axes: ArrayLike | None = None,
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
    """An unbranched robot from the rotations and vectors between its frames, as in the thesis's appendix B.

    Frame 0 is the base's, frame i is fixed to link i at its far end, and joint i between link i-1 and link i moves at
    the origin of frame i-1. Every vector of link i is seen from frame i. For a Denavit-Hartenberg table see `dh_chain`.

    Parameters
    ----------
    rotations : array_like, shape (n, 3, 3)
        R_i^{i-1} at q = 0: takes coordinates of frame i to those of frame i-1.
    positions : array_like, shape (n, 3)
        The vector r_{i-1,i} from the origin of frame i-1 to that of frame i at q = 0, in frame i [m].
    masses : array_like, shape (n,), optional
        [kg]; links without masses, centres and inertias are massless.
    centres : array_like, shape (n, 3), optional
        The vector r_{i-1,ci} from the origin of frame i-1 to the centre of mass of link i at q = 0, in frame i [m].
    inertias : array_like, shape (n, 3, 3), optional
        About the centre of mass, in the axes of frame i [kg m^2].
    axes : array_like, shape (n, 3), optional
        Direction b_i of joint i's axis in frame i, of any length. By default z of frame i-1, seen from frame i (3.30).
    types : str or sequence of n str
        "revolute", "continuous" or "prismatic"; a prismatic link slides along its axis by q.
    lower, upper, velocity, effort : array_like, shape (n,), optional
        Limits, infinite where not given [rad or m; rad/s or m/s; N m or N].
    gravity : array_like, shape (3,)
        In frame 0 [m/s^2].
    name : str
        Of the robot.
    joint_names, link_names : sequence of n str, optional
        "joint_1", ... and "link_1", ... by default.
    base, tip : str
        Names of the link with frame 0, and of the link with frame n, fixed behind link n.

    Returns
    -------
    Model
        For `rne.Robot`. Its link i has the orientation of frame i and the origin of frame i-1, on the joint's axis.

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, a matrix is no rotation, a mass is negative, an inertia has a
        negative eigenvalue, an axis is zero, a type is unknown, or a name is empty or given twice.

    Notes
    -----
    Høifødt 2011, appendix B, (3.29)-(3.38). Entries of rotations and axes within 4 eps of 0 or 1 are set to them, as
    when a file is read, so that `np.cos(np.pi / 2)` costs no operations.

    Examples
    --------
    >>> import numpy as np, rne
    >>> one, none = [np.eye(3)], np.zeros((1, 3, 3))
    >>> rod = rne.model.chain(one, [[0.5, 0, 0]], [2.0], [[0.25, 0, 0]], none, gravity=[0, -9.81, 0])
    >>> rne.Robot(rod).gravity_torque([0.0]).round(6).tolist()  # 2 kg at a quarter metre
    [4.905]
    """
    R = rows("rotations", rotations, (-1, 3, 3))
    n = len(R)
    ends = rows("positions", positions, (n, 3))
    given = Given(
        masses, centres, inertias, types, lower, upper, velocity, effort, gravity,
        name, joint_names, link_names, base, tip,
    )  # fmt: skip
    names = checked_names(given, n)
    for i, joint in enumerate(names.joints):
        if not is_rotation(R[i].astype(np.float64)):
            need = "must be a rotation: orthogonal with determinant +1"
            raise ValueError(f"`rotations[{i}]` of joint {joint!r} {need}")
    R = snap(R)
    b = R[:, 2, :] if axes is None else _directions(axes, names.joints)
    origins = np.concatenate([np.zeros((1, 3), dtype=Extended), ends])
    placements = [pose(R[i], origins[i]) for i in range(n)]
    geometry = Geometry(placements, list(b), [np.zeros(3)] * n, origins[-1])
    return chain_model(given, names, checked_types(given, names.joints), geometry)


def _directions(axes: ArrayLike, joints: tuple[str, ...]) -> Array:
    """Unit vectors of the axes."""
    directions = rows("axes", axes, (len(joints), 3))
    for i, joint in enumerate(joints):
        largest = np.abs(directions[i]).max()
        if largest == 0:
            raise ValueError(f"`axes[{i}]` of joint {joint!r} is zero; give the direction of the joint's axis")
        directions[i] /= largest  # squares of very large or small numbers are not finite or zero
        directions[i] /= np.sqrt((directions[i] * directions[i]).sum())
    return snap(directions)
