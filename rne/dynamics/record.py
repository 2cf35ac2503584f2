"""The student's view: every vector of the recursion, link by link."""

from __future__ import annotations

import operator
from dataclasses import dataclass, fields, replace

import numpy as np

from ..model import Model
from ..spatial import Array, dot, rotate, rotate_back, zeros
from .checks import checked
from .kinematics import joint_rates, joint_transforms
from .newton_euler import (
    External,
    applied_wrenches,
    backward_recursion,
    forward_recursion,
    joint_torques,
)
from .record_table import recursion_table


@dataclass(frozen=True)
class Recursion:
    """What the forward and backward recursions find for every moving body.

    Body i is the one behind `joints[i]`; its vectors are in its own axes. Shapes (..., nb, 3) unless said.
    Printed, it is a table with units and equation numbers, joint by joint; of a batch, of its first state.

    Attributes
    ----------
    joints : tuple of str
        The moving joints, in order.
    omega, alpha : ndarray
        Angular velocity (3.29) and acceleration (3.33) [rad/s, rad/s^2].
    a_o, a_c : ndarray
        True acceleration of the frame's origin and of the centre of mass (3.37), without gravity [m/s^2].
    a_e : ndarray or None, shape (..., k, 3)
        True acceleration of the link's end, the next joint's origin (3.38), for an unbranched chain; the last
        link has an end if the model knows its `tip`, then k = nb, otherwise k = nb - 1 [m/s^2].
    gravity : ndarray
        Gravity in each frame (5.33) [m/s^2].
    f, tau : ndarray
        Force (3.24) and torque (3.27) of the joint on the body, at the frame's origin: along the axis the drive's,
        across it the bearing's [N, N m].
    u : ndarray, shape (..., n)
        Torques of the drives (5.3) [N m or N].
    joint_types : tuple of str
        "revolute", "continuous" or "prismatic", of each of `joints`.
    drivers : tuple of int, length n
        The joint that u[..., k] drives; the others are mimics.

    Examples
    --------
    >>> import rne
    >>> print(rne.recursion(rne.irb140(), [0] * 6, [1, 0, 0, 0, 0, 0], [0] * 6))  # doctest: +ELLIPSIS
    Each vector in the axes of its own link; in brackets the equations of Høifødt 2011.
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
    drivers: tuple[int, ...]

    @property
    def batch(self) -> tuple[int, ...]:
        """The leading shape: () for a single state."""
        return self.u.shape[:-1]

    def state(self, index: int | tuple[int, ...]) -> Recursion:
        """One state of a batch.

        Parameters
        ----------
        index : int or tuple of int
            Its place in the leading shape, one number for each leading axis; negative ones count from the end.

        Returns
        -------
        Recursion

        Raises
        ------
        TypeError
            If the index is something else, such as a slice.
        IndexError
            If there is no such state, or the index is one of several states.
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

    def __str__(self) -> str:
        return recursion_table(self)


@checked
def recursion(model: Model, q: Array, qd: Array, qdd: Array, *, external: External | None = None) -> Recursion:
    """Inverse dynamics with every intermediate vector of every link kept.

    Parameters
    ----------
    model : Model
    q, qd, qdd : ndarray, shape (..., n)
        Joint positions, rates and accelerations [rad or m, /s, /s^2].
    external : mapping of str to ndarray, shape (..., 6), optional
        Wrenches [moment; force] acting on the robot at the named link's origin, in its axes [N m, N].

    Returns
    -------
    Recursion

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or a result overflows.

    Notes
    -----
    Høifødt 2011, (3.24)-(3.38) and (5.33).

    Examples
    --------
    >>> import rne
    >>> rne.recursion(rne.irb140(), [0] * 6, [1, 0, 0, 0, 0, 0], [0] * 6).omega[0].tolist()
    [0.0, -1.0, 0.0]
    """
    R, p = joint_transforms(model, q)
    rates, accelerations = joint_rates(model, qd), joint_rates(model, qdd)
    upward = forward_recursion(model, R, p, rates, accelerations, -model.gravity)
    f, n = backward_recursion(model, R, p, upward, applied_wrenches(model, external))
    true = forward_recursion(model, R, p, rates, accelerations, 0 * model.gravity)
    gravity: list[Array] = []
    for i, parent in enumerate(model.parent):
        gravity.append(rotate_back(R[i], gravity[parent] if parent >= 0 else model.gravity))  # (5.33)

    def collect(vectors: list[Array]) -> Array:
        result = zeros((*q.shape[:-1], len(vectors), 3), like=q)
        for i, v in enumerate(vectors):
            result[..., i, :] = v
        return result

    ends = [
        a + rotate(U, r)  # (3.38)
        for a, U, r in zip(true.a_o, true.U, link_ends(model) or [], strict=False)
    ]
    return Recursion(
        joints=model.moving_joints,
        omega=collect(true.omega),
        alpha=collect(true.alpha),
        a_o=collect(true.a_o),
        a_c=collect([a + rotate(U, c) for a, U, c in zip(true.a_o, true.U, model.com, strict=True)]),  # (3.37)
        a_e=None if link_ends(model) is None else collect(ends),
        gravity=collect(gravity),
        f=collect(f),
        tau=collect(n),
        u=joint_torques(model, f, n, accelerations),
        joint_types=model.joint_types,
        drivers=model.drivers,
    )


def link_ends(model: Model) -> list[Array] | None:
    """End of each link in its own frame, the next joint's origin (the thesis's r_{i-1,i}); None if it branches."""
    if any(parent != i - 1 for i, parent in enumerate(model.parent)):
        return None
    ends = [model.translation[i] for i in range(1, model.nb)]
    return ends if model.tip is None else [*ends, model.tip]


def bearing_loads(record: Recursion, model: Model) -> tuple[Array, Array]:
    """Magnitudes of force and torque that each joint's bearing carries across (revolute) or around its axis.

    Parameters
    ----------
    record : Recursion
    model : Model
        The robot of the record.

    Returns
    -------
    force, torque : ndarray, shape (..., nb)
        [N, N m]; the drive's own component is left out.

    Examples
    --------
    >>> import rne
    >>> force, torque = rne.bearing_loads(rne.recursion(rne.irb140(), [0] * 6, [0] * 6, [0] * 6), rne.irb140())
    >>> force[0].round(2).item()  # the weight of the 75 kg that move
    735.75
    """
    turns = model.turns[:, None]
    f, n = record.f, record.tau
    f_along, n_along = (dot(v, model.axis)[..., None] * model.axis for v in (f, n))
    carried_f, carried_n = f - (1 - turns) * f_along, n - turns * n_along
    return dot(carried_f, carried_f) ** 0.5, dot(carried_n, carried_n) ** 0.5
