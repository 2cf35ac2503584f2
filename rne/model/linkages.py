"""Closed forms of plane linkages, from the geometry of the model: four-bars, parallelograms, cylinders, slider-cranks.

A loop is walked around from joint to joint, through the pivot that closes it. Angles are those by which links turned
since the zero pose, about the driver's axis; a joint turns by the angle of the next link less that of the link before
it. Vectors lie in the plane of the motion: pairs of numbers, or of traced ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, real_array
from ..basics.spatial import Array, cross, rotate, rotation_about
from ..elementwise import arctan2
from ..errors import ModelError
from .following import Followed, coupled
from .model import Model, model_argument
from .parameters import perpendicular

CLOSED = 1e-9  # of a loop's size: how well it must close at the zero pose, and be plane
Closing = tuple[tuple[str, ArrayLike], tuple[str, ArrayLike]]


class Pivot(NamedTuple):
    """A joint of a loop, or the pivot that closes it, which has no name: its place and axis in the plane, and sense.

    The sense is 1 if a positive motion of the joint moves the next link of the loop in the positive sense, else -1.
    """

    joint: str
    place: Array
    axis: Array
    slides: bool
    sense: float


def four_bar(model: Model, driver: str, closing: Closing) -> Model:
    """The robot with a four-bar linkage closed: two joints follow the driver, on the branch of the zero pose.

    Parameters
    ----------
    model : Model
        The robot as a tree, with the loop open at one of its four pivots.
    driver : str
        One of the three joints of the loop, all rotating and with parallel axes.
    closing : ((str, array_like), (str, array_like))
        The pivot that closes the loop: two links, and its place in the frame of each [m].

    Returns
    -------
    Model
        Without the two other joints of the loop among its coordinates, and with the driver's range cut to where the
        loop closes and they are within theirs, as in `rne.model.coupled`.

    Raises
    ------
    ModelError
        If the loop has other joints, is not plane, does not close at the zero pose to 1e-9 of its size, or is at a dead
        point there, where its branches meet.
    ValueError, TypeError
        If an argument is of another form, or names no joint or link.

    Notes
    -----
    Freudenstein 1955, Trans. ASME 77, 853: two links meet where circles intersect, one square root and two arctan2.

    Examples
    --------
    >>> import numpy as np, rne
    >>> right = np.pi / 2
    >>> arm = rne.dh_chain(a=[0.3, 0.8, 0.4], alpha=[0] * 3, d=[0] * 3, theta=[right, -right, -right])
    >>> rne.model.four_bar(arm, "joint_1", (("tool0", [0, 0, 0]), ("base_link", [0.8, -0.1, 0]))).joint_names
    ('joint_1',)
    """
    D, X, Y, Z = loop = _loop(model, driver, closing, "RRRR")
    x0, z, y0 = X.place - D.place, Z.place - D.place, Y.place - Z.place
    u0 = x0 - z
    branch = _branch(driver, u0, y0)

    def motions(position: Any) -> tuple[Any, ...]:
        alpha = D.sense * position
        u = _turned(x0, alpha) - z  # from Z to X; Y is where the circles of the links X Y and Y Z meet
        along = (u @ u + y0 @ y0 - (y0 - u0) @ (y0 - u0)) / (2 * (u @ u))
        y = along * u + branch * np.sqrt(y0 @ y0 / (u @ u) - along * along) * np.array([-u[1], u[0]])
        of_xy, of_yz = _turn(y0 - u0, y - u), _turn(y0, y)
        return alpha, of_xy - alpha, of_yz - of_xy, -of_yz

    return _closed(model, driver, loop, motions)


def parallelogram(model: Model, driver: str, closing: Closing) -> Model:
    """The robot with a parallelogram closed, whose joints follow by multipliers of 1 or -1.

    With three joints in the loop two of them mimic the driver. With four, of which the driver and the one before it have
    one axis, as shoulder and elbow drive of a palletiser, these two drive and the others follow the difference.

    Parameters
    ----------
    model : Model
        The robot as a tree, with the loop open at one pivot.
    driver : str
        A joint of the loop, all rotating and with parallel axes.
    closing : ((str, array_like), (str, array_like))
        The pivot that closes the loop: two links, and its place in the frame of each [m].

    Returns
    -------
    Model
        Without the joints that follow among its coordinates.

    Raises
    ------
    ModelError
        If the loop has other joints, is not plane, does not close at the zero pose or has opposite sides that differ, by
        more than 1e-9 of its size.
    ValueError, TypeError
        If an argument is of another form, or names no joint or link.

    Examples
    --------
    >>> import numpy as np, rne
    >>> right = np.pi / 2
    >>> arm = rne.dh_chain(a=[0.3, 0.8, 0.3], alpha=[0] * 3, d=[0] * 3, theta=[right, -right, -right])
    >>> arm = rne.model.parallelogram(arm, "joint_1", (("tool0", [0, 0, 0]), ("base_link", [0.8, 0, 0])))
    >>> arm.multiplier.tolist()
    [1.0, -1.0, 1.0]
    """
    loop = _loop(model, driver, closing, "RRRR", "RRRRR")
    D, X, Y, Z = loop[:4]
    gap = float(np.abs(X.place - D.place - Y.place + Z.place).max())
    gap = max(gap, *(float(np.abs(E.place - D.place).max()) for E in loop[4:]), 0.0)
    if gap > CLOSED * float(np.abs(Y.place - D.place).max()):
        raise ModelError(f"the linkage of {driver!r} is no parallelogram: opposite sides differ by {gap:.3g} m")

    def motions(position: Any, *other: Any) -> tuple[Any, ...]:
        turn = D.sense * position + sum(E.sense * x for E, x in zip(loop[4:], other, strict=True))
        return turn, -turn, turn, -turn

    return _closed(model, driver, loop, motions, *(E.joint for E in loop[4:]))


def cylinder(model: Model, driver: str, closing: Closing) -> Model:
    """The robot with a hydraulic cylinder or ball screw closed, between a pivot on each side of a joint that it turns.

    Parameters
    ----------
    model : Model
        The robot as a tree: the turned joint, the cylinder's swing at one pivot and its slide, the other pivot open.
    driver : str
        The slide, along the line between the pivots, or the turned joint, opposite to it in the loop.
    closing : ((str, array_like), (str, array_like))
        The pivot that closes the loop: two links, and its place in the frame of each [m].

    Returns
    -------
    Model
        Without the two other joints among its coordinates, and the driver's range cut, as in `rne.model.four_bar`.

    Raises
    ------
    ModelError
        If the loop has other joints, is not plane, or does not close at the zero pose to 1e-9 of its size; if the slide
        drives and the zero pose is a dead point, where joint and pivots are on one line.
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
    loop = _loop(model, driver, closing, "RRPR")
    D, X, S, Z = loop
    x0, z = X.place - D.place, Z.place - D.place
    w0 = x0 - z
    length0, a2, b2 = float(np.sqrt(w0 @ w0)), x0 @ x0, z @ z
    if abs(_cross(S.axis, w0)) > CLOSED * length0:
        raise ModelError(f"the axis of joint {S.joint!r} must be parallel to the line between the cylinder's pivots")
    sense = -S.sense * float(np.sign(S.axis @ w0))  # of the length, in the slide's motion
    branch = _branch(driver, z, x0) if driver == S.joint else 0.0

    def motions(position: Any) -> tuple[Any, ...]:
        alpha = D.sense * position
        if driver == S.joint:  # the law of cosines
            cos = (a2 + b2 - (length0 + sense * position) ** 2) / (2 * float(np.sqrt(a2 * b2)))
            start = float(arctan2(_cross(z, x0), z @ x0))
            alpha = arctan2(branch * np.sqrt(1 - cos * cos), cos) - start
        w = _turned(x0, alpha) - z
        turn = _turn(w0, w)
        return alpha, turn - alpha, S.sense * sense * (np.sqrt(w @ w) - length0), -turn

    return _closed(model, driver, loop, motions)


@dataclass(frozen=True)
class SliderCrank:
    """A slider-crank as a coupling, made by `slider_crank`; its attributes are the arguments of that."""

    driver: str
    crank: float
    rod: float
    angle: float

    def of(self, model: Model, joint: str) -> Followed:
        """Driver and function of a joint of a robot that follows it: the slider, the crank or the rod."""
        if self.driver not in model.moving_joints:
            raise ValueError(f"`driver` must be one of {list(model.moving_joints)}, got {self.driver!r}")
        i, k = (model.moving_joints.index(name) for name in (joint, self.driver))
        R, _ = _zero_pose(model)
        along = float(R[i] @ model.axis[i] @ (R[k] @ model.axis[k]))
        turns, driver_turns = bool(model.is_revolute[i]), bool(model.is_revolute[k])
        if abs(abs(along) - (turns and driver_turns)) > CLOSED or not (turns or driver_turns):
            raise ModelError(f"the axes of {joint!r} and {self.driver!r} are not those of a slider-crank")
        is_behind, r, l = k in _carriers(model, i), self.crank, self.rod
        start = r * np.cos(self.angle) + np.sqrt(l * l - (r * np.sin(self.angle)) ** 2)
        rest = float(np.arctan2(-r * np.sin(self.angle), start - r * np.cos(self.angle)))
        if not driver_turns:
            _refuse_dead_point(self.driver, np.sin(self.angle), 1.0)

        def position(given: Any) -> Any:
            if driver_turns:
                theta, sin = self.angle + given, r * np.sin(self.angle + given)
                foot = np.sqrt(l * l - sin * sin)  # the rod along the slider's line
                if not turns:
                    return r * np.cos(theta) + foot - start
            else:  # the law of cosines
                x = start + given
                cos = (x * x + r * r - l * l) / (2 * r * x)
                sin = np.sign(np.sin(self.angle)) * np.sqrt(1 - cos * cos)
                theta, sin, foot = arctan2(sin, cos), r * sin, x - r * cos
                if not is_behind:
                    return theta - self.angle
            turn = arctan2(-sin, foot) - rest
            return along * (turn - given) if driver_turns and is_behind else (along if driver_turns else 1.0) * turn

        return (self.driver,), position


def slider_crank(driver: str, *, crank: float, rod: float, angle: float = 0.0) -> SliderCrank:
    """A slider-crank for `rne.model.coupled`: the slider, the crank or the rod as a joint that follows another.

    The slider's line passes through the crank's axis, and the slider is on its positive side. Where the crank drives,
    a sliding joint that follows is the slider, a rotating one the rod, mounted on the crank or on the slider; where the
    slider drives, a joint mounted on it is the rod, any other the crank.

    Parameters
    ----------
    driver : str
        The crank, a rotating joint, or the slider.
    crank, rod : float
        Their lengths between axes [m].
    angle : float
        From the slider's direction to the crank at the zero pose, about the crank's axis, which a rod on a driving
        slider shares; not at a dead point, a multiple of pi, where the slider drives [rad].

    Returns
    -------
    SliderCrank
        A value for the mapping of `rne.model.coupled`.

    Raises
    ------
    ValueError
        If a length is not positive or the rod does not reach the slider's line.

    Examples
    --------
    >>> import numpy as np, rne
    >>> press = rne.dh_chain(a=[0.1, 0.5], alpha=[0, 0], d=[0, 0], theta=[0, 0])  # the crank and its rod
    >>> value = rne.model.slider_crank("joint_1", crank=0.1, rod=0.5)
    >>> rne.model.coupled(press, {"joint_2": value}).joint_names
    ('joint_1',)
    """
    r, l = positive_number("crank", crank), positive_number("rod", rod)
    start = float(real_array("angle", angle, "()"))
    if abs(r * np.sin(start)) >= l:
        raise ValueError(f"`rod` must reach the slider's line at `angle`, got {rod!r}")
    return SliderCrank(driver, r, l, start)


def _loop(model: Model, driver: str, closing: Closing, *kinds: str) -> list[Pivot]:
    """The joints of a loop and its pivot, in order from the driver, or so that the kinds, R or P, are some of these."""
    if driver not in model_argument(model).moving_joints:
        raise ValueError(f"`driver` must be one of {list(model.moving_joints)}, got {driver!r}")
    R, p = _zero_pose(model)
    k, (a, b) = model.moving_joints.index(driver), _ends(model, closing, R, p)
    paths = [_carriers(model, body) for body, _ in (a, b)]
    inwards, outwards = ([i for i in own if i not in other] for own, other in (paths, paths[::-1]))
    if k in inwards:  # the other way around, so that the link in front of the driver carries it
        inwards, outwards = outwards, inwards
    loop = [(i, 1.0) for i in outwards[::-1]] + [(-1, 1.0)] + [(i, -1.0) for i in inwards]
    names = [model.moving_joints[i] for i, _ in loop if i >= 0]
    start = next((place for place, (i, _) in enumerate(loop) if i == k), 0)
    loop = loop[start:] + loop[:start]
    form = "".join("R" if i < 0 or model.is_revolute[i] else "P" for i, _ in loop)
    if form not in kinds and form[2:] + form[:2] in kinds:
        form, loop = form[2:] + form[:2], loop[2:] + loop[:2]
    free = [name for name in names if name == driver or name in model.joint_names]
    if form not in kinds or driver not in names or free != names:
        need = " or ".join(kinds).replace("R", "rotating ").replace("P", "sliding ")
        raise ModelError(
            f"the loop that `closing` closes must be, from {driver!r} on and with its pivot, {need}joints that follow no "
            f"others, got {names}"
        )
    return _in_plane(model, loop, R, p, a[1], b[1])


def _in_plane(
    model: Model, loop: Sequence[tuple[int, float]], R: Any, p: Any, end: Array, other_end: Array
) -> list[Pivot]:
    """The pivots of a loop in its plane, checked to be one and closed."""
    turning = next(i for i, _ in loop if i >= 0 and model.is_revolute[i])
    normal = R[turning] @ model.axis[turning]
    first = R[turning] @ perpendicular(model.axis[turning])
    plane = np.array([first, cross(normal, first)])
    places = [p[i] if i >= 0 else end for i, _ in loop]
    size = max(float(np.abs(place - end).max()) for place in places)
    gap = float(np.sqrt(((end - other_end) ** 2).sum()))
    if gap > CLOSED * size:
        raise ModelError(
            f"the loop must close at the zero pose, got a gap of {gap:.3g} m between the points of `closing`"
        )
    found = []
    for (i, sense), place in zip(loop, places, strict=True):
        axis = R[i] @ model.axis[i] if i >= 0 else normal
        slides, along = i >= 0 and not bool(model.is_revolute[i]), float(axis @ normal)
        if abs(abs(along) - (not slides)) > CLOSED:
            what = "perpendicular" if slides else "parallel"
            raise ModelError(f"the axis of joint {model.moving_joints[i]!r} must be {what} to the others of the loop")
        name = model.moving_joints[i] if i >= 0 else ""
        found.append(Pivot(name, plane @ place, plane @ axis, slides, sense if slides else sense * round(along)))
    return found


def _zero_pose(model: Model) -> tuple[dict[int, Array], dict[int, Array]]:
    """Rotation and origin of the frames of all bodies where the coordinates are 0, the base's under -1."""
    R, p = {-1: np.eye(3)}, {-1: np.zeros(3)}
    for i, parent in enumerate(model.parent):
        turn = float(model.rest[i]) if model.is_revolute[i] else 0.0
        R[i] = R[parent] @ model.rotation[i] @ rotation_about(model.axis[i], np.array(turn))
        slid = model.rotation[i] @ model.linear_axis[i] * model.rest[i]
        p[i] = p[parent] + rotate(R[parent], model.translation[i] + slid)
    return R, p


def _ends(model: Model, closing: Any, R: Any, p: Any) -> list[tuple[int, Array]]:
    """The bodies and the places, seen from the base, of the two points that a loop closes at."""
    if not isinstance(closing, Sequence) or [isinstance(end, Sequence) and len(end) for end in closing] != [2, 2]:
        raise TypeError(f"`closing` must be ((link, point), (link, point)), got {closing!r}")
    found = []
    for k, (link, point) in enumerate(closing):
        index = model.link_index(link)
        body = model.link_body[index]
        here = model.link_translation[index] + rotate(
            model.link_rotation[index], real_array(f"closing[{k}]", point, "(3,)")
        )
        found.append((body, p[body] + rotate(R[body], here)))
    return found


def _carriers(model: Model, body: int) -> list[int]:
    """A body and all that carry it, towards the base."""
    return [] if body < 0 else [body, *_carriers(model, model.parent[body])]


def _closed(
    model: Model, driver: str, loop: Sequence[Pivot], motions: Callable[..., Sequence[Any]], *others: str
) -> Model:
    """The robot with joints of a loop following the driver, and others, by their motions since the zero pose."""
    drivers = (driver, *others)
    rest = [float(model.rest[model.moving_joints.index(name)]) for name in drivers]

    def following(k: int, pivot: Pivot) -> Followed:
        def position(*given: Any) -> Any:
            return pivot.sense * motions(*(x - x0 for x, x0 in zip(given, rest, strict=True)))[k]

        return drivers, position

    names = {k: pivot.joint for k, pivot in enumerate(loop) if pivot.joint not in ("", *drivers)}
    return coupled(model, {name: following(k, loop[k]) for k, name in names.items()})


def _branch(driver: str, u: Array, v: Array) -> float:
    """On which side of u the vector v lies at the zero pose: 1 or -1."""
    area = _cross(u, v)
    _refuse_dead_point(driver, area, np.sqrt(u @ u * (v @ v)))
    return float(np.sign(area))


def _refuse_dead_point(driver: str, area: float, size: float) -> None:
    if abs(area) <= CLOSED * size:
        raise ModelError(f"the zero pose is a dead point of the linkage that {driver!r} drives; move the robot's zero")


def _cross(u: Array, v: Array) -> Any:
    return u[0] * v[1] - u[1] * v[0]


def _turn(u: Array, v: Array) -> Any:
    """The angle from a vector u of numbers to v."""
    return arctan2(_cross(u, v), u @ v)


def _turned(v: Array, angle: Any) -> Array:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * v[0] - sin * v[1], sin * v[0] + cos * v[1]])
