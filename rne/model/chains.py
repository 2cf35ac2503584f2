"""Unbranched robots from arrays: the thesis's rotations and vectors between frames, or a Denavit-Hartenberg table."""

from __future__ import annotations

import warnings
from collections import namedtuple
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import per_joint_array, real_array, real_numbers, refuse_degrees
from ..basics.spatial import Array, rotate, rotate_back, rotation_about, snap, unit_vector
from .builder import Extended, Part, assemble, pose
from .checks import JOINT_TYPES, inertia_error, is_rotation, looks_like_degrees, symmetric_up_to_rounding
from .model import STANDARD_GRAVITY, Model
from .modify import limit_array

FLANGE = "flange"  # the fixed joint of the last frame
BODIES = ("masses", "centres", "inertias")
Links = namedtuple(  # arguments that `chain` and `dh_chain` have in common, as given
    "Links",
    "masses centres inertias types lower upper velocity effort gravity name joint_names link_names base tool tip",
)
X, _, Z = np.eye(3, dtype=Extended)


def chain(
    rotations: ArrayLike,
    positions: ArrayLike,
    masses: ArrayLike | None = None,
    centres: ArrayLike | None = None,
    inertias: ArrayLike | None = None,
    *,
    axes: ArrayLike | None = None,
    **options: Any,
) -> Model:
    """Unbranched robot from the rotations and vectors between its frames, as in the thesis's appendix B.

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
    inertias : array_like, shape (n, 3, 3), (n, 3) or (n, 6), optional
        About the centre of mass, in the axes of frame i, as for `dh_chain` [kg m^2].
    axes : array_like, shape (n, 3), optional
        Direction b_i of joint i's axis in frame i, of any length. By default z of frame i-1, seen from frame i (3.30).
    **options
        Arguments of `dh_chain`, whose DH frames are here the frames i: `types`, `lower`, `upper`, `velocity`, `effort`,
        `gravity`, `name`, `joint_names`, `link_names`, `base`, `tool` and `tip`.

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
    R = extended("rotations", rotations, "(n, 3, 3)")
    n = len(R)
    ends = extended("positions", positions, f"({n}, 3)")
    defaults = {name: x for name, x in (dh_chain.__kwdefaults__ or {}).items() if name in Links._fields[3:]}
    if unknown := sorted(options.keys() - defaults):
        raise TypeError(f"chain() got an unexpected keyword argument {unknown[0]!r}")
    given = Links(masses, centres, inertias, **(defaults | options))
    joints, _ = names_of(given, n)
    for i, joint in enumerate(joints):
        if not is_rotation(R[i].astype(np.float64)):
            need = "must be a rotation: orthogonal with determinant +1"
            raise ValueError(f"`rotations[{i}]` of joint {joint!r} {need}")
    R = snap(R)
    b = R[:, 2, :] if axes is None else _directions(axes, joints)
    return _chain_model(given, R, np.concatenate([np.zeros((1, 3)), ends]), b, np.zeros((n, 3)))


def dh_chain(
    *,
    a: ArrayLike,
    alpha: ArrayLike,
    d: ArrayLike,
    theta: ArrayLike,
    offset: ArrayLike = 0.0,
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
    base: str | ArrayLike = "base_link",
    tool: ArrayLike | None = None,
    tip: str = "tool0",
) -> Model:
    """Unbranched robot from its Denavit-Hartenberg table; centres and inertias are seen from the DH frames.

    Parameters
    ----------
    a, alpha, d, theta : array_like, shape (n,)
        The columns of the table. The joint's position is added to theta (revolute) or to d (prismatic): what is given
        here for it is its value at q = 0 [m, rad, m, rad].
    offset : float or array_like, shape (n,)
        Added to the position of each joint, in addition to theta or d [rad or m].
    convention : {"standard", "modified"}
        Standard (Siciliano, Corke's `SerialLink`, the thesis): T_i = Rot(z, theta) Trans(z, d) Trans(x, a)
        Rot(x, alpha); frame i lies at the far end of link i. Modified (Craig): T_i = Rot(x, alpha) Trans(x, a)
        Rot(z, theta) Trans(z, d), where row i holds a_{i-1} and alpha_{i-1}; frame i lies on the axis of joint i.
    masses : array_like, shape (n,), optional
        [kg]; links without masses, centres and inertias are massless.
    centres : array_like, shape (n, 3), optional
        Centre of mass of link i from the origin of DH frame i, in its axes (Corke's `r`). The thesis's r_{i-1,ci}
        counts from the origin of frame i-1: for that see `chain` [m].
    inertias : array_like, shape (n, 3, 3), (n, 3) or (n, 6), optional
        About the centre of mass, in the axes of DH frame i [kg m^2]: matrices, or their entries xx, yy, zz, or xx, yy,
        zz, xy, yz, xz (Corke's order; a URDF's is another).
    types : str or sequence of n str
        "revolute", "continuous" or "prismatic".
    lower, upper, velocity, effort : array_like, shape (n,), optional
        Limits, infinite where not given [rad or m; rad/s or m/s; N m or N].
    gravity : array_like, shape (3,)
        In the axes of the base [m/s^2].
    name : str
        Name of the robot.
    joint_names, link_names : sequence of n str, optional
        "joint_1", ... and "link_1", ... by default.
    base : str or array_like, shape (4, 4)
        Name of the link with DH frame 0, or the pose of DH frame 0 in the link "base_link".
    tool : array_like, shape (4, 4), optional
        Pose of the last link in DH frame n.
    tip : str
        Name of the last link, fixed to link n: its frame is DH frame n, or the tool's.

    Returns
    -------
    Model
        For `rne.Robot`; the last of `link_poses` is base T_1 T_2 ... T_n tool. Its link i has the orientation of DH
        frame i. In the modified convention it is DH frame i; in the standard one its origin is on the axis of joint i,
        where DH frame i-1 has its own at q = 0.

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
    length = extended("a", a, "(n,)")
    n = len(length)
    columns = {"alpha": alpha, "d": d, "theta": theta}
    twist, shift, angle = (extended(column, x, f"({n},)") for column, x in columns.items())
    refuse_degrees("alpha", twist)
    refuse_degrees("theta", angle)
    zero = per_joint_array("offset", offset, n).astype(Extended)
    given = Links(
        masses, centres, inertias, types, lower, upper, velocity, effort, gravity,
        name, joint_names, link_names, base, tool, tip,
    )  # fmt: skip
    slides = np.array(_types(given, names_of(given, n)[0])) == "prismatic"
    refuse_degrees("offset", np.where(slides, 0, zero))
    angle, shift = angle + np.where(slides, 0, zero), shift + np.where(slides, zero, 0)
    Rx, Rz = snap(rotation_about(X, twist)), snap(rotation_about(Z, angle))
    along_x, along_z, none = length[:, None] * X, shift[:, None] * Z, np.zeros((n, 3), dtype=Extended)
    if convention == "modified":  # frame i is the joint's frame
        origins = along_x + rotate(Rx, along_z)
        return _chain_model(given, Rx @ Rz, np.concatenate([origins, np.zeros((1, 3))]), none + Z, none)
    ends = rotate_back(Rx, along_x + along_z)  # r_{i-1,i} in frame i; the joint's frame has the origin of frame i-1
    return _chain_model(given, Rz @ Rx, np.concatenate([np.zeros((1, 3)), ends]), Rx[:, 2, :], ends)


def _chain_model(given: Links, R: Array, origins: Array, axes: Array, shifts: Array) -> Model:
    """Model of an unbranched chain; raises ValueError for what `load` would refuse in a file.

    Joint i has orientation R[i] and origin origins[i] in the frame before it, and the last frame is at origins[n];
    centres of mass count from shifts[i] in the joint's frame.
    """
    n = len(R)
    (base, first), (tool, last) = (_placement(x, getattr(given, x)) for x in ("base", "tool"))
    R, origins = np.concatenate([R, tool[None]]), np.concatenate([origins[:-1], origins[-1:] + last])
    R[0], origins[0] = base @ R[0], base @ origins[0] + first
    joints, links = names_of(given, n)
    types = _types(given, joints)
    bodies = _bodies(given, links[1:-1])
    limits = _limits(given, joints, types)
    gravity = extended("gravity", given.gravity, "(3,)").astype(np.float64)
    parts = [Part(link=links[0])]
    for i, (mass, centre, inertia) in enumerate(bodies):
        body = {"mass": mass, "com": centre + shifts[i], "inertia": inertia}
        joint = {"joint": joints[i], "kind": types[i], "axis": axes[i], "placement": pose(snap(R[i]), origins[i])}
        own_limits = {field: values[i] for field, values in limits.items()}
        parts.append(Part(link=links[i + 1], parent=i, **joint, **body, **own_limits))
    parts.append(Part(link=links[-1], joint=FLANGE, parent=n, placement=pose(snap(R[-1]), origins[-1])))
    return assemble(given.name, parts, gravity=gravity)


def _placement(name: str, value: Any) -> tuple[Array, Array]:
    """Rotation and origin of a pose; the identity for the name of a frame or None."""
    if value is None or isinstance(value, str):
        return np.eye(3, dtype=Extended), np.zeros(3, dtype=Extended)
    T = extended(name, value, "(4, 4)")
    if not is_rotation(T[:3, :3].astype(np.float64)) or T[3].tolist() != [0, 0, 0, 1]:
        raise ValueError(f"`{name}` must be a pose: a rotation and an origin [m] above a row of 0, 0, 0, 1")
    return T[:3, :3], T[:3, 3]


def _inertias(value: Any, n: int) -> Array:
    """Inertia matrices, given whole or by three or six of their entries."""
    I = real_numbers("inertias", value, f"({n}, 3, 3)").astype(Extended)
    if I.shape == (n, 3):
        return np.asarray(I[:, None] * np.eye(3, dtype=Extended))
    if I.shape == (n, 6):
        return np.asarray(I[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2]]])
    if I.shape != (n, 3, 3):
        forms = f"({n}, 3, 3), or ({n}, 3) with xx, yy, zz, or ({n}, 6) with xx, yy, zz, xy, yz, xz"
        raise ValueError(f"`inertias` must have shape {forms}, got {I.shape}")
    return np.asarray(I)


def extended(name: str, value: ArrayLike, shape: str) -> Array:
    """Array of finite real numbers of a given shape, in long double."""
    return real_array(name, value, shape).astype(Extended)


def names_of(given: Links, n: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the joints, and of all links from the base to the last frame, none of them empty or given twice."""
    joints = _names("joint_names", given.joint_names, [f"joint_{i}" for i in range(1, n + 1)])
    links = _names("link_names", given.link_names, [f"link_{i}" for i in range(1, n + 1)])
    base = given.base if given.base is None or isinstance(given.base, str) else "base_link"
    for argument, value in (("name", given.name), ("base", base), ("tip", given.tip)):
        if not isinstance(value, str) or not value:
            raise ValueError(f"`{argument}` must be a name, got {value!r}")
    links = (str(base), *links, given.tip)
    for kind, all_names in (("joint", (*joints, FLANGE)), ("link", links)):
        for k, name in enumerate(all_names):
            if name in all_names[:k]:
                raise ValueError(f"`{kind}_names` must differ, got the {kind} {name!r} twice")
    return joints, links


def _names(argument: str, given: Sequence[str] | None, default: list[str]) -> tuple[str, ...]:
    names = tuple(default if given is None else given)
    if isinstance(given, str) or len(names) != len(default):
        raise ValueError(f"`{argument}` must be {len(default)} names, got {given!r}")
    for k, name in enumerate(names):
        if not isinstance(name, str) or not name:
            raise ValueError(f"`{argument}[{k}]` must be a name, got {name!r}")
    return names


def _types(given: Links, joints: tuple[str, ...]) -> list[str]:
    """Type of every joint; one string is the type of all."""
    types = [given.types] * len(joints) if isinstance(given.types, str) else list(given.types)
    if len(types) != len(joints):
        raise ValueError(f"`types` must be one type or {len(joints)} of them, got {len(types)}")
    for i, kind in enumerate(types):
        if kind not in JOINT_TYPES:
            raise ValueError(f"`types[{i}]` of joint {joints[i]!r} must be one of {list(JOINT_TYPES)}, got {kind!r}")
    return types


def _directions(axes: ArrayLike, joints: tuple[str, ...]) -> Array:
    """Unit vectors of the axes."""
    directions = extended("axes", axes, f"({len(joints)}, 3)")
    for i, joint in enumerate(joints):
        if not directions[i].any():
            raise ValueError(f"`axes[{i}]` of joint {joint!r} is zero; give the direction of the joint's axis")
        directions[i] = unit_vector(directions[i])
    return snap(directions)


def _bodies(given: Links, links: Sequence[str]) -> list[tuple[Any, Array, Array]]:
    """Mass, centre and inertia of each link; all zero if none is given."""
    n = len(links)
    missing = [name for name in BODIES if getattr(given, name) is None]
    if len(missing) == 3:
        return [(0.0, np.zeros(3), np.zeros((3, 3)))] * n
    if missing:
        raise ValueError(f"`{missing[0]}` must be given too: masses, centres and inertias belong together")
    masses, centres = extended("masses", given.masses, f"({n},)"), extended("centres", given.centres, f"({n}, 3)")
    inertias = _inertias(given.inertias, n)
    bodies = []
    for i, (mass, centre, inertia) in enumerate(zip(masses, centres, inertias, strict=True)):
        link = links[i]
        if mass < 0:
            raise ValueError(f"`masses[{i}]` of link {link!r} must be 0 or positive, got {float(mass)!r}")
        even = symmetric_up_to_rounding(inertia)
        error = inertia_error(float(mass), centre.astype(np.float64), even.astype(np.float64))
        if error:
            raise ValueError(f"`inertias[{i}]` of link {link!r}: {error}")
        bodies.append((mass, centre, even))
    return bodies


def _limits(given: Links, joints: tuple[str, ...], types: list[str]) -> dict[str, Array]:
    """Limits by the names of a Part's fields, infinite where not given."""
    limits = {}
    for name, default in (("lower", -np.inf), ("upper", np.inf), ("velocity", np.inf), ("effort", np.inf)):
        limits[name] = values = limit_array(name, getattr(given, name), joints, np.full(len(joints), default))
        for i, joint in enumerate(joints):
            if name in ("lower", "upper") and types[i] == "continuous" and values[i] != default:
                need = f"must be {default}, as a continuous joint has no range, got {float(values[i])!r}"
                raise ValueError(f"`{name}[{i}]` of joint {joint!r} {need}")
    for i, (low, high) in enumerate(zip(limits["lower"].tolist(), limits["upper"].tolist(), strict=True)):
        if types[i] == "revolute" and looks_like_degrees(low, high):
            text = f"the range of joint {joints[i]!r}, {low:g} to {high:g}, looks like degrees; pass np.deg2rad of it"
            warnings.warn(text, stacklevel=4)
    return limits
