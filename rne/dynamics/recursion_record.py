"""Record of all link quantities of one pass of the recursive Newton-Euler algorithm, printed as a table."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from ..basics.arrays import ReadOnlyArrays
from ..basics.spatial import Array, cross, dot, rotate, rotate_back, zeros
from ..basics.text import UNITS, Row, aligned, counted, listed, short, six_digits, wrapped
from ..model.model import Model
from ..model.topology import loads_not_known, tip
from .closing_forces import closing_forces
from .kinematics import BASE, joint_transforms
from .quantity import quantity
from .rnea import External, newton_euler

# Attribute of the record, equation of Høifødt 2011, unit. a_o has no equation number: it is the parent's (3.38).
VECTORS = (
    ("omega", "(3.29)", "rad/s"),
    ("alpha", "(3.33)", "rad/s^2"),
    ("a_o", "", "m/s^2"),
    ("a_c", "(3.37)", "m/s^2"),
    ("a_e", "(3.38)", "m/s^2"),
    ("gravity", "(5.33)", "m/s^2"),
    ("f", "(3.24)", "N"),
    ("tau", "(3.27)", "N m"),
)
DRIVE = "§5.3"  # section where u is introduced, without an equation
LEGEND = (
    "Each vector in the axes of its own link; in brackets equations, after § a section of Høifødt 2011.",
    "omega, alpha: angular velocity, acceleration. a_c, a_e: true accelerations of mass centre and end.",
    "f, tau: of the joint on its link, at the joint. u: the drive's share of them.",
)
PIVOTS = "Pivots that close linkages: f on the first link, in its axes, in the plane of the linkage."
BRANCHED = "The links of a branched robot have no single end: a_o, the origin's acceleration, stands for a_e."


@dataclass(frozen=True)
class Recursion(ReadOnlyArrays):
    """All vectors of the Newton-Euler recursion, for every moving body.

    `joints[i]` carries body i, whose vectors are in its own axes. Shapes are (..., nb, 3) unless stated otherwise.
    `print` shows a table with units and equation numbers, joint by joint; of a batch, that of its first state.

    Attributes
    ----------
    joints : tuple of str
        The moving joints, in order.
    omega, alpha : ndarray
        Angular velocity (3.29) and acceleration (3.33) [rad/s, rad/s^2].
    a_o, a_c : ndarray
        True acceleration of the frame's origin and of the centre of mass (3.37), without gravity [m/s^2].
    a_e : ndarray or None, shape (..., k, 3)
        True acceleration of the link's end, the next joint's origin (3.38), for an unbranched chain; the end of the
        last body is the origin of the frame fixed to it: k = nb, or k = nb - 1 without such a frame [m/s^2].
    gravity : ndarray
        Gravity in each frame (5.33) [m/s^2].
    f, tau : ndarray
        Force (3.24) and torque (3.27) of the joint on the body, at the joint's origin in the file: the component along
        the axis is the drive's, the rest the bearing's. NaN of joints in `not_known` [N, N m].
    u : ndarray, shape (..., n)
        Torques of the drives, the components of tau or f along the axes (section 5.3) [N m or N].
    joint_types : tuple of str
        "revolute", "continuous" or "prismatic", of each of `joints`.
    independent_joints : tuple of int, length n
        The joint that u[..., k] belongs to; all others mimic one.
    pivots : tuple of str, length L
        The pivots that close linkages, by their links.
    pivot_force : ndarray, shape (..., L, 3)
        Force of each pivot on its first link, in that link's axes, in the plane of the linkage; how loads across the
        plane are shared depends on unknown stiffnesses, so f and tau of the tree's joints have them all. NaN as f [N].
    not_known : tuple of str
        Joints and pivots whose forces are not known, because joints follow others by parts that the model lacks.
    follow : tuple of str
        The joints that follow others by such parts.

    Examples
    --------
    >>> import rne
    >>> print(rne.dynamics.recursion(rne.irb140(), [0] * 6, [1, 0, 0, 0, 0, 0], [0] * 6))  # doctest: +ELLIPSIS
    Each vector in the axes of its own link; in brackets equations, after § a section of Høifødt 2011.
    ...
    joint_1, revolute
      omega   (3.29) rad/s     0            -1           0
    ...
    """

    joints: tuple[str, ...]
    omega: Array
    alpha: Array
    a_o: Array
    a_c: Array
    a_e: Array | None
    gravity: Array
    f: Array
    tau: Array
    u: Array
    joint_types: tuple[str, ...]
    independent_joints: tuple[int, ...]
    pivots: tuple[str, ...]
    pivot_force: Array
    not_known: tuple[str, ...] = ()
    follow: tuple[str, ...] = ()

    @property
    def known(self) -> Recursion:
        """Record restricted to the forces that are known."""
        joints, pivots = ([x not in self.not_known for x in names] for names in (self.joints, self.pivots))
        f, tau, pivot_force = self.f[..., joints, :], self.tau[..., joints, :], self.pivot_force[..., pivots, :]
        return replace(self, f=f, tau=tau, pivot_force=pivot_force)

    @property
    def batch(self) -> tuple[int, ...]:
        """Leading shape: () for a single state."""
        return self.u.shape[:-1]

    def state(self, index: int | tuple[int, ...]) -> Recursion:
        """State of a batch.

        Parameters
        ----------
        index : int or tuple of int
            Its place in the leading shape, one number for each leading axis; negative ones count from the end.

        Returns
        -------
        Recursion
            Of that state alone.

        Raises
        ------
        TypeError
            If the index is something else, such as a slice.
        IndexError
            If there is no such state, or the index is one of several states.

        Examples
        --------
        >>> import numpy as np, rne
        >>> batch = rne.load("irb140").recursion(*np.zeros((3, 4, 6)))
        >>> batch.batch, batch.state(3).u.shape
        ((4,), (6,))
        """
        place = index if isinstance(index, tuple) else (index,)
        try:
            where = tuple(operator.index(k) for k in place)
        except TypeError:
            raise TypeError(f"`index` must be an int or a tuple of int, got {index!r}") from None
        inside = len(where) == len(self.batch) and all(-n <= k < n for k, n in zip(where, self.batch, strict=True))
        if not inside:
            what = f"one of leading shape {self.batch}" if self.batch else "(), as this is a single state"
            raise IndexError(f"`index` must be {what}, got {index!r}")
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **{name: x[where] for name, x in values.items() if isinstance(x, np.ndarray)})

    def __repr__(self) -> str:
        states = f"states of leading shape {self.batch}" if self.batch else "1 state"
        return wrapped(
            f"Recursion of {counted(len(self.joints), 'joint')}, {states}; print() shows the table\n"
            f"  joints: {listed(self.joints) or 'none'}"
        )

    def __str__(self) -> str:
        return recursion_table(self)


@quantity(returns_array=False)
def recursion(model: Model, q: Array, qd: Array, qdd: Array, *, external: External | None = None) -> Recursion:
    """Inverse dynamics with all intermediate vectors of every link.

    Høifødt 2011, (3.24)-(3.38) and (5.33). Parameters, result and errors are those of `rne.Robot.recursion`, with
    the model first.
    """
    at_rest = 0 * model.gravity  # without gravity's upward acceleration of the base the accelerations are the true ones
    loaded = newton_euler(model, q, qd, qdd, model.gravity, external)
    not_known, follow = loads_not_known(model)
    pivots, wrenches = closing_forces(model, q, loaded.of_joints, not_known, external)
    loaded = newton_euler(model, q, qd, qdd, model.gravity, wrenches) if pivots else loaded
    true = newton_euler(model, q, qd, qdd, at_rest)
    R, _ = joint_transforms(model, q)
    gravity = {BASE: model.gravity}
    for i, parent in enumerate(model.parent):
        gravity[i] = rotate_back(R[i], gravity[parent])  # (5.33)

    def collect(vectors: Iterable[Array]) -> Array:
        rows = list(vectors)
        result = zeros((*q.shape[:-1], len(rows), 3), like=q)
        for i, v in enumerate(rows):
            result[..., i, :] = v
        return result

    bodies, ends, origin = range(model.nb), link_ends(model), model.joint_origin
    f, tau = collect(loaded.f[i] for i in bodies), collect(loaded.n[i] - cross(origin[i], loaded.f[i]) for i in bodies)
    unknown = [joint in not_known for joint in model.moving_joints]
    f[..., unknown, :] = tau[..., unknown, :] = np.nan
    return Recursion(
        joints=model.moving_joints,
        omega=collect(true.omega[i] for i in bodies),
        alpha=collect(true.alpha[i] for i in bodies),
        a_o=collect(true.a[i] for i in bodies),
        a_c=collect(true.a[i] + rotate(true.U[i], model.com[i]) for i in bodies),  # (3.37)
        a_e=None if ends is None else collect(true.a[i] + rotate(true.U[i], r) for i, r in enumerate(ends)),  # (3.38)
        gravity=collect(gravity[i] for i in bodies),
        f=f,
        tau=tau,
        u=loaded.tau,
        joint_types=model.joint_types,
        independent_joints=model.independent_joints,
        pivots=tuple(loop.name for loop in model.loops),
        pivot_force=collect(pivots),
        not_known=not_known,
        follow=follow,
    )


def link_ends(model: Model) -> list[Array] | None:
    """End of each body in its frame: the next joint's origin, the thesis's r_{i-1,i}; None for a branched tree."""
    if any(parent != i - 1 for i, parent in enumerate(model.parent)):
        return None
    ends = [model.translation[i] for i in range(1, model.nb)]
    last = tip(model)
    return ends if last is None else [*ends, last]


def bearing_loads(record: Recursion, model: Model) -> tuple[Array, Array]:
    """Magnitudes of the force and torque that each joint's bearing carries.

    Parameters
    ----------
    record : Recursion
        What `recursion` returned.
    model : Model
        The robot of the record.

    Returns
    -------
    force : ndarray, shape (..., nb + L)
        Without the drive's component along the axis of a sliding joint; behind the joints those of `record.pivots`,
        which close linkages. NaN where it is not known [N].
    torque : ndarray, shape (..., nb + L)
        Without the drive's component along the axis of a rotating joint; 0 in `record.pivots` [N m].

    Examples
    --------
    >>> import rne
    >>> record = rne.dynamics.recursion(rne.irb140(), [0] * 6, [0] * 6, [0] * 6)
    >>> force, torque = rne.dynamics.bearing_loads(record, rne.irb140())
    >>> force[0].round(2).item()  # the weight of the 75 kg that move
    735.75
    """
    s, t = model.angular_axis, model.linear_axis
    carried_f, carried_n = record.f - dot(record.f, t)[..., None] * t, record.tau - dot(record.tau, s)[..., None] * s
    closing = record.pivot_force
    carried_f, carried_n = (np.concatenate(x, -2) for x in ((carried_f, closing), (carried_n, 0 * closing)))
    return dot(carried_f, carried_f) ** 0.5, dot(carried_n, carried_n) ** 0.5


def recursion_table(record: Recursion) -> str:
    """Table of the record, or the first state of its batch, joint by joint in at most 100 columns."""
    batch = record.batch
    if 0 in batch:
        return f"Recursion of no states: leading shape {batch}"
    if not record.joints:
        return "Recursion of a robot without moving joints"
    lines = []
    if batch:
        last = tuple(k - 1 for k in batch)
        index = str(last[0]) if len(last) == 1 else str(last)
        lines.append(f"The first of {np.prod(batch)} states, leading shape {batch}; record.state({index}) is the last.")
        record = record.state((0,) * len(batch))
    lines += LEGEND if record.a_e is not None else [*LEGEND, BRANCHED]
    rows = [Row("", ("x", "y", "z"))]
    for i in range(len(record.joints)):
        rows += _joint(record, i)
    for name, force in zip(record.pivots, record.pivot_force, strict=True):
        rows += [Row(f"{short(name)}, closing pivot"), *_vector("f", "", "N", list(force))]
    lines += [PIVOTS] if record.pivots else []
    return "\n".join([*lines, *not_known(record), *aligned(rows)])


def not_known(record: Any) -> list[str]:
    """Lines on unknown forces and the reasons; none where all are known."""
    if not record.not_known:
        return []
    text = f"Not known: forces in {listed(record.not_known)}, as what moves {listed(record.follow)} is no part of the "
    text += "robot; rne.model.four_bar, cylinder and slider_crank close linkages with their pivots."
    return wrapped(text).split("\n")


def _joint(record: Recursion, i: int) -> Iterator[Row]:
    """Lines of one joint and the body that it carries; u only for joints with drives, not for mimic joints."""
    is_driven = i in record.independent_joints
    yield Row(f"{short(record.joints[i])}, {record.joint_types[i]}{'' if is_driven else ', mimic'}")
    vectors = [(*about, getattr(record, about[0])) for about in VECTORS if about[0] != "a_o" or record.a_e is None]
    rows = [(name, equation, unit, list(x[i])) for name, equation, unit, x in vectors if x is not None and i < len(x)]
    if is_driven:
        unit = UNITS["tau"][record.joint_types[i] == "prismatic"]
        rows.append(("u", DRIVE, unit, [record.u[record.independent_joints.index(i)]]))
    for row in rows:
        yield from _vector(*row)


def _vector(name: str, equation: str, unit: str, values: list[Any]) -> Iterator[Row]:
    """Line of a vector or of a number, and that of its imaginary part."""
    digits = [six_digits(x.real) if x.real == x.real else "not known" for x in values]
    yield Row(f"  {name:<7} {equation:<6} {unit:<7}", digits)
    if any(np.iscomplexobj(x) or x.imag != 0 for x in values):  # of NumPy or mpmath
        yield Row(f"  {'':<7} {'imag':<6} {unit:<7}", [six_digits(x.imag) for x in values])
