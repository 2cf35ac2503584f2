"""Closed forms of plane linkages: four-bars and parallelograms, cylinders, slider-cranks.

A loop of joints is walked around from the driver on, through the pivot that closes it. Angles are those by which links
turned since the zero pose, about the driver's axis; a joint turns by that of the next link less that of the link before
it. Vectors lie in the plane of the motion: pairs of numbers, or of traced ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, real_array
from ..basics.spatial import Array, cross, rotate, rotation_about
from ..elementwise import arctan2
from ..errors import ModelError
from .coupling import Followed, coupled
from .model import Model, model_argument
from .parameters import perpendicular

CLOSED = 1e-9  # of a loop's size: how well it must close at the zero pose, and be plane
Closing = tuple[tuple[str, ArrayLike], tuple[str, ArrayLike]]


class Pivot(NamedTuple):
    """A joint of a loop, or the pivot that closes it, which has no name: place and axis in the plane, and sense.

    The sense is 1 if a positive motion of the joint moves the next link of the loop in the positive sense, else -1.
    """

    joint: str
    place: Array
    axis: Array
    sense: float


def four_bar(model: Model, driver: str, closing: Closing) -> Model:
    """The robot with a four-bar linkage closed: two joints follow the driver, on the branch of the zero pose.

    In a parallelogram they mimic it, by 1 or -1. There the loop may have one joint more, before the driver and on its
    axis, as with the shoulder and the elbow drive of a palletiser: both drive.

    Parameters
    ----------
    model : Model
        The robot as a tree, with the loop open at one of its pivots.
    driver : str
        One of the joints of the loop, all rotating and with parallel axes.
    closing : ((str, array_like), (str, array_like))
        The pivot that closes the loop: two links, and its place in the frame of each [m].

    Returns
    -------
    Model
        Without the joints that follow among its coordinates; ranges are cut as by `rne.model.coupled`.

    Raises
    ------
    ModelError
        If the loop has other joints, is not plane, or at the zero pose does not close to 1e-9 of its size or is at a
        dead point, where its branches meet.
    ValueError, TypeError
        If an argument is of another form, or names no joint or link.

    Notes
    -----
    Freudenstein 1955, Trans. ASME 77, 853: circles around the ends of two links meet where a third pivot is.

    Examples
    --------
    >>> import numpy as np, rne
    >>> right = np.pi / 2
    >>> arm = rne.dh_chain(a=[0.3, 0.8, 0.4], alpha=[0] * 3, d=[0] * 3, theta=[right, -right, -right])
    >>> rne.model.four_bar(arm, "joint_1", (("tool0", [0, 0, 0]), ("base_link", [0.8, -0.1, 0]))).joint_names
    ('joint_1',)
    """
    D, X, Y, Z, *second = loop = _loop(model, driver, closing, "RRRR", "RRRRR")
    x0, z, y0 = X.place - D.place, Z.place - D.place, Y.place - Z.place
    size = CLOSED * float(np.abs([x0, z, y0]).max())
    if np.abs(x0 - y0).max() <= size and all(np.abs(E.place - D.place).max() <= size for E in second):

        def turns(position: Any, *other: Any) -> tuple[Any, ...]:
            turn = D.sense * position + sum(E.sense * x for E, x in zip(second, other, strict=True))
            return turn, -turn, turn, -turn

        return _closed(model, loop, turns, driver, *(E.joint for E in second))
    if second:
        raise ModelError(f"a loop with {[E.joint for E in (D, *second)]} must be a parallelogram, these on one axis")
    branch = _branch(driver, x0 - z, y0)

    def motions(position: Any) -> tuple[Any, ...]:
        alpha = D.sense * position
        u = _turned(x0, alpha) - z  # from Z to X
        along = (u @ u + y0 @ y0 - (y0 - x0 + z) @ (y0 - x0 + z)) / (2 * (u @ u))
        y = along * u + branch * np.sqrt(y0 @ y0 / (u @ u) - along * along) * np.array([-u[1], u[0]])
        of_xy, of_yz = _turn(y0 - x0 + z, y - u), _turn(y0, y)
        return alpha, of_xy - alpha, of_yz - of_xy, -of_yz

    return _closed(model, loop, motions, driver)


def cylinder(model: Model, driver: str, closing: Closing) -> Model:
    """The robot with a hydraulic cylinder or ball screw closed, between a pivot on each side of a joint that it turns.

    Parameters
    ----------
    model : Model
        The robot as a tree: the turned joint, the cylinder's swing at one pivot, and its slide; the other pivot open.
    driver : str
        The slide, along the line between the pivots, or the turned joint, opposite to it in the loop.
    closing : ((str, array_like), (str, array_like))
        The pivot that closes the loop: two links, and its place in the frame of each [m].

    Returns
    -------
    Model
        Without the two other joints among its coordinates; ranges are cut as by `rne.model.coupled`.

    Raises
    ------
    ModelError
        As of `rne.model.four_bar`; joint and pivots on one line are a dead point where the slide drives.
    ValueError, TypeError
        If an argument is of another form, or names no joint or link.

    Examples
    --------
    >>> import numpy as np, rne
    >>> kinds = ["revolute", "revolute", "prismatic"]
    >>> boom = rne.dh_chain(a=[1, 0, 0], alpha=[0, np.pi / 2, 0], d=[0, 0, 0.7], theta=[0] * 3, types=kinds)
    >>> rne.model.cylinder(boom, "joint_3", (("tool0", [0, 0, 0]), ("base_link", [1, -0.7, 0]))).joint_names
    ('joint_3',)
    """
    D, X, S, Z = loop = _loop(model, driver, closing, "RRPR")
    x0, z = X.place - D.place, Z.place - D.place
    w0, product = x0 - z, float(np.sqrt((x0 @ x0) * (z @ z)))
    length0, start = float(np.sqrt(w0 @ w0)), float(_turn(z, x0))
    if abs(_cross(S.axis, w0)) > CLOSED * length0:
        raise ModelError(f"the axis of joint {S.joint!r} must be parallel to the line between the cylinder's pivots")
    sense = -float(np.sign(S.axis @ w0))  # of the length, in motions of the slide towards the next link
    branch = _branch(driver, z, x0) if driver == S.joint else 0.0

    def motions(position: Any) -> tuple[Any, ...]:
        alpha = D.sense * position
        if driver == S.joint:  # the law of cosines
            cos = (x0 @ x0 + z @ z - (length0 + sense * S.sense * position) ** 2) / (2 * product)
            alpha = arctan2(branch * np.sqrt(1 - cos * cos), cos) - start
        w = _turned(x0, alpha) - z
        return alpha, _turn(w0, w) - alpha, sense * (np.sqrt(w @ w) - length0), -_turn(w0, w)

    return _closed(model, loop, motions, driver)


def slider_crank(driver: str, *, crank: float, rod: float, angle: float = 0.0) -> Callable[[Model, str], Followed]:
    """A slider-crank for `rne.model.coupled`: the slider, the crank or the rod as a joint that follows another.

    The slider's line passes through the crank's axis, and the slider is on its positive side. Where the crank drives, a
    sliding joint that follows is the slider, a rotating one the rod, mounted on the crank or on the slider; where the
    slider drives, a joint mounted on it is the rod, any other the crank.

    Parameters
    ----------
    driver : str
        The crank, a rotating joint, or the slider.
    crank, rod : float
        Their lengths between axes [m].
    angle : float
        From the slider's direction to the crank at the zero pose, about the crank's axis, or that of a rod that follows
        the slider. Where the slider drives, no multiple of pi, which is a dead point [rad].

    Returns
    -------
    callable
        A value for the mapping of `rne.model.coupled`.

    Raises
    ------
    ValueError
        If a length is not positive or the rod does not reach the slider's line.

    Examples
    --------
    >>> import rne
    >>> press = rne.dh_chain(a=[0.1, 0.5], alpha=[0, 0], d=[0, 0], theta=[0, 0])  # the crank and its rod
    >>> rod = rne.model.slider_crank("joint_1", crank=0.1, rod=0.5)
    >>> rne.model.coupled(press, {"joint_2": rod}).joint_names
    ('joint_1',)
    """
    r, l, theta0 = positive_number("crank", crank), positive_number("rod", rod), float(real_array("angle", angle, "()"))
    if abs(side := r * float(np.sin(theta0))) >= l:
        raise ValueError(f"`rod` must reach the slider's line at `angle`, got {rod!r}")
    foot0 = float(np.sqrt(l * l - side * side))  # of the rod, along the slider's line
    x0, rest = r * float(np.cos(theta0)) + foot0, float(np.arctan2(-side, foot0))

    def of(model: Model, joint: str) -> Followed:
        if driver not in model.moving_joints:
            raise ValueError(f"`driver` must be one of {list(model.moving_joints)}, got {driver!r}")
        (i, k), (R, _) = (model.moving_joints.index(name) for name in (joint, driver)), _zero_pose(model)
        turns, cranked, behind = bool(model.is_revolute[i]), bool(model.is_revolute[k]), k in _carriers(model, i)
        along = float(R[i] @ model.axis[i] @ (R[k] @ model.axis[k]))
        if abs(abs(along) - (turns and cranked)) > CLOSED or not (turns or cranked):
            raise ModelError(f"the axes of joints {joint!r} and {driver!r} are not those of a slider-crank")
        branch = 0.0 if cranked else _branch(driver, np.array([1.0, 0.0]), np.array([np.cos(theta0), np.sin(theta0)]))

        def position(given: Any) -> Any:
            theta, x = theta0 + given, x0 + given
            if not cranked:  # the law of cosines
                cos = (x * x + r * r - l * l) / (2 * r * x)
                theta = arctan2(branch * np.sqrt(1 - cos * cos), cos)
            side, near = r * np.sin(theta), r * np.cos(theta)
            foot = np.sqrt(l * l - side * side) if cranked else x - near
            if not turns:
                return near + foot - x0
            if not cranked and not behind:
                return theta - theta0
            turn = arctan2(-side, foot) - rest - (given if cranked and behind else 0.0)
            return along * turn if cranked else turn

        return (driver,), position

    return of


def _loop(model: Model, driver: str, closing: Closing, *forms: str) -> list[Pivot]:
    """The pivots of a loop in its plane, in order from the driver or from the one opposite, so that it has such a form.

    A form has an R for each that rotates and a P for each that slides.
    """
    if driver not in model_argument(model).moving_joints:
        raise ValueError(f"`driver` must be one of {list(model.moving_joints)}, got {driver!r}")
    if not isinstance(closing, Sequence) or [isinstance(end, Sequence) and len(end) for end in closing] != [2, 2]:
        raise TypeError(f"`closing` must be ((link, point), (link, point)), got {closing!r}")
    R, p = _zero_pose(model)
    paths, ends = [], []
    for k, (link, point) in enumerate(closing):
        index, here = model.link_index(link), real_array(f"closing[{k}][1]", point, "(3,)")
        body, here = model.link_body[index], model.link_translation[index] + rotate(model.link_rotation[index], here)
        paths.append(_carriers(model, body))
        ends.append(p[body] + rotate(R[body], here))
    inwards, outwards = ([i for i in own if i not in other] for own, other in (paths, paths[::-1]))
    d = model.moving_joints.index(driver)
    if d in inwards:  # the other way around, so that the link before the driver carries it
        inwards, outwards = outwards, inwards
    loop = [*((i, 1.0) for i in outwards[::-1]), (-1, 1.0), *((i, -1.0) for i in inwards)]
    first = next((k for k, (i, _) in enumerate(loop) if i == d), 0)
    loop = loop[first:] + loop[:first]
    form = "".join("R" if i < 0 or model.is_revolute[i] else "P" for i, _ in loop)
    if form not in forms and form[2:] + form[:2] in forms:
        form, loop = form[2:] + form[:2], loop[2:] + loop[:2]
    names = [model.moving_joints[i] for i, _ in loop if i >= 0]
    if form not in forms or driver not in names or any(name not in (driver, *model.joint_names) for name in names):
        what = " or ".join(str(len(text) - 1) for text in forms)
        sliding = "one of them the slide of the cylinder" if "P" in forms[0] else "all rotating"
        raise ModelError(
            f"the loop must have {what} joints, {driver!r} and others that follow none, {sliding}; it has {names}"
        )
    return _in_plane(model, loop, R, p, ends)


def _in_plane(model: Model, loop: Sequence[tuple[int, float]], R: Any, p: Any, ends: Sequence[Array]) -> list[Pivot]:
    """The pivots of a loop, which is checked to close and to be plane."""
    turning = next(i for i, _ in loop if i >= 0 and model.is_revolute[i])
    normal, first = R[turning] @ model.axis[turning], R[turning] @ perpendicular(model.axis[turning])
    plane, places = np.array([first, cross(normal, first)]), [p[i] if i >= 0 else ends[0] for i, _ in loop]
    gap, size = (float(np.abs(np.subtract(a, ends[0])).max()) for a in (ends[1:], places))
    if gap > CLOSED * size:
        raise ModelError(f"the loop must close at the zero pose, got a gap of {gap:.3g} m at the points of `closing`")
    found = []
    for (i, sense), place in zip(loop, places, strict=True):
        turns, name = i < 0 or bool(model.is_revolute[i]), model.moving_joints[i] if i >= 0 else ""
        axis = R[i] @ model.axis[i] if i >= 0 else normal
        along = float(axis @ normal)
        if abs(abs(along) - turns) > CLOSED:
            what = "parallel" if turns else "perpendicular"
            raise ModelError(f"the axis of joint {name!r} must be {what} to those about which the loop turns")
        found.append(Pivot(name, plane @ place, plane @ axis, sense * round(along) if turns else sense))
    return found


def _zero_pose(model: Model) -> tuple[dict[int, Array], dict[int, Array]]:
    """Rotation and origin of the frames of all bodies where the coordinates are 0, the base's under -1."""
    R, p = {-1: np.eye(3)}, {-1: np.zeros(3)}
    for i, parent in enumerate(model.parent):
        slid = model.rotation[i] @ model.linear_axis[i] * model.rest[i]
        p[i] = p[parent] + rotate(R[parent], model.translation[i] + slid)
        turn = np.array(model.rest[i] * model.is_revolute[i])
        R[i] = R[parent] @ model.rotation[i] @ rotation_about(model.axis[i], turn)
    return R, p


def _carriers(model: Model, body: int) -> list[int]:
    """A body and all that carry it, towards the base."""
    return [] if body < 0 else [body, *_carriers(model, model.parent[body])]


def _closed(model: Model, loop: Sequence[Pivot], motions: Callable[..., Sequence[Any]], *drivers: str) -> Model:
    """The robot with the joints of a loop following the drivers, by their motions since the zero pose."""
    rest = [float(model.rest[model.moving_joints.index(name)]) for name in drivers]

    def following(k: int) -> Followed:
        return drivers, lambda *given: loop[k].sense * motions(*(x - x0 for x, x0 in zip(given, rest, strict=True)))[k]

    names = {pivot.joint: k for k, pivot in enumerate(loop) if pivot.joint not in ("", *drivers)}
    return coupled(model, {name: following(k) for name, k in names.items()})


def _branch(driver: str, u: Array, v: Array) -> float:
    """On which side of u the vector v is at the zero pose: 1 or -1; on neither, where branches meet, is an error."""
    area = _cross(u, v)
    if abs(area) <= CLOSED * np.sqrt((u @ u) * (v @ v)):
        raise ModelError(f"the zero pose is a dead point of the linkage that {driver!r} drives; move a joint's zero")
    return float(np.sign(area))


def _cross(u: Array, v: Array) -> Any:
    return u[0] * v[1] - u[1] * v[0]


def _turn(u: Array, v: Array) -> Any:
    """The angle from a vector u to v."""
    return arctan2(_cross(u, v), u @ v)


def _turned(v: Array, angle: Any) -> Array:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * v[0] - sin * v[1], sin * v[0] + cos * v[1]])
