"""Closed forms of planar linkages: four-bars and parallelograms, cylinders, slider-cranks.

The joints of a loop are in order from the driver on, through the pivot that closes it. Angles are rotations of links
since the zero pose, about the driver's axis; a joint turns by that of the next link minus that of the previous one.
Vectors lie in the plane of the motion: pairs of numbers, or of traced numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, real_array
from ..basics.spatial import Array, cross, rotate, rotate_back, rotation_about
from ..elementwise import arctan2
from ..errors import ModelError
from .coupling import Linked, coupled
from .model import Loop, Model, of_either
from .parameters import perpendicular
from .topology import carriers

CLOSED = 1e-9  # largest gap of a loop at the zero pose, and deviation from a plane, relative to its size
Closing = tuple[tuple[str, ArrayLike], tuple[str, ArrayLike]]
Motions = Callable[..., Sequence[Any]]  # of the joints of a loop, from those of its drivers
Ends = tuple[float, float]  # of a range


class Pivot(NamedTuple):
    """Joint of a loop, or the pivot that closes it, which has no name: place and axis in the plane, and sense.

    The sense is 1 if a positive motion of the joint moves the next link of the loop in the positive sense, else -1.
    """

    joint: str
    place: Array
    axis: Array
    sense: float


@of_either
def four_bar(model: Model, driver: str, closing: Closing) -> Model:
    """Robot with a closed four-bar linkage: two joints follow the driver, on the branch of the zero pose.

    In a parallelogram, flat at the zero pose or not, they mimic it, by 1 or -1. There the loop may have one joint more,
    before the driver and on its axis, as with the shoulder and the elbow drive of a palletiser: both drive.

    Parameters
    ----------
    model : Model or Robot
        The robot as a tree, with the loop open at one of its pivots.
    driver : str
        One of the joints of the loop, all rotating and with parallel axes.
    closing : ((str, array_like), (str, array_like))
        The pivot that closes the loop: two links, and its place in the frame of each [m].

    Returns
    -------
    Model or Robot
        As `model`, without the joints that follow among its coordinates; ranges are cut as by `rne.model.coupled`.

    Raises
    ------
    ModelError
        If the loop has other joints, is not plane, has a link without length, or at the zero pose does not close to
        1e-9 of its size or is at a dead point, where its branches meet.
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
    size = _size(D, X, Y, Z)
    if np.abs(x0 - y0).max() <= size and all(np.abs(E.place - D.place).max() <= size and E.joint for E in second):

        def turns(position: Any, *other: Any) -> tuple[Any, ...]:
            turn = D.sense * position + sum(E.sense * x for E, x in zip(second, other, strict=True))
            return turn, -turn, turn, -turn

        return _closed(model, loop, closing, turns, (-np.inf, np.inf), driver, *(E.joint for E in second))
    if second:
        raise ModelError(f"a loop with {[E.joint for E in (D, *second)]} must be a parallelogram, these on one axis")
    branch, psi0 = _branch(driver, x0 - z, y0), float(_turn(z, x0))
    a, g, b, r = (_length(v) for v in (x0, z, y0 - x0 + z, y0))

    def links(alpha: Any) -> tuple[Any, Any]:
        """Angles of coupler and rocker, from the triangle that they form with the diagonal, by Heron's formula."""
        S, C = _half(psi0 + alpha, np.sign(psi0), abs(a - g) - abs(b - r), b + r - a - g, CLOSED * (a + g))
        diagonal, squared = _across(a, g, psi0 + alpha, S, C)
        nearest, farthest = (a - g - b + r) * (a - g + b - r), (b + r - a - g) * (b + r + a + g)
        area = np.sqrt((nearest + 4 * a * g * S * S) * (farthest + 4 * a * g * C * C))  # four times it
        at_x, at_z = (arctan2(area, squared + side) for side in ((b - r) * (b + r), (r - b) * (r + b)))
        return diagonal - branch * at_x, diagonal + branch * at_z

    def motions(position: Any) -> tuple[Any, ...]:
        alpha = D.sense * position
        of_xy, of_yz = (now - then for now, then in zip(links(alpha), links(0.0), strict=True))
        return alpha, of_xy - alpha, of_yz - of_xy, -of_yz

    return _closed(model, loop, closing, motions, _ends(D.sense, *_span(a, g, psi0, abs(b - r), b + r)), driver)


@of_either
def cylinder(model: Model, driver: str, closing: Closing) -> Model:
    """Robot with a closed hydraulic cylinder or ball screw, between pivots on both sides of the joint it turns.

    Parameters
    ----------
    model : Model or Robot
        The robot as a tree: the turned joint, the cylinder's swing at one pivot, and its slide; the other pivot open.
    driver : str
        The slide, along the line between the pivots, or the turned joint, opposite to it in the loop.
    closing : ((str, array_like), (str, array_like))
        The pivot that closes the loop: two links, and its place in the frame of each [m].

    Returns
    -------
    Model or Robot
        As `model`, without the two other joints among its coordinates; ranges are cut as by `rne.model.coupled`.

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
    _size(D, X, Z)
    x0, z = X.place - D.place, Z.place - D.place
    w0, a, g, psi0 = x0 - z, _length(x0), _length(z), float(_turn(z, x0))
    length0, nearest, farthest = _length(w0), abs(a - g), a + g
    if abs(_cross(S.axis, w0)) > CLOSED * length0:
        raise ModelError(f"the axis of joint {S.joint!r} must be parallel to the line between the cylinder's pivots")
    sense = -float(np.sign(S.axis @ w0))  # of the length, in motions of the slide towards the next link
    slides = driver == S.joint
    branch = _branch(driver, z, x0) if slides else 0.0
    direction0 = _turn(z, w0) if slides else _across(a, g, psi0, np.sin(psi0 / 2), np.cos(psi0 / 2))[0]

    def motions(position: Any) -> tuple[Any, ...]:
        if slides:  # angles of the triangle, by Heron's formula with roots that no negative length has
            l = length0 + sense * S.sense * position
            area = np.sqrt((l - nearest) * (farthest - l)) * np.sqrt((l + nearest) * (farthest + l))
            slid, psi = l - length0, branch * arctan2(area, a * a + g * g - l * l)
            direction = branch * (np.pi - arctan2(area, l * l + (g - a) * (g + a)))
        else:
            psi = psi0 + D.sense * position
            direction, squared = _across(a, g, psi, *_half(psi, np.sign(psi0), nearest, np.inf, CLOSED * farthest))
            slid = np.sqrt(squared) - length0
        alpha, swing = psi - psi0, direction - direction0
        return alpha, swing - alpha, sense * slid, -swing

    ends = _ends(D.sense, *_span(a, g, psi0, 0.0, np.inf))
    if slides:
        ends = _ends(sense * S.sense, nearest - length0, farthest - length0)
    return _closed(model, loop, closing, motions, ends, driver)


def slider_crank(driver: str, *, crank: float, rod: float, angle: float = 0.0) -> SliderCrank:
    """Slider-crank for `rne.model.coupled`: the slider, the crank or the rod as a coupled joint.

    The slider's line passes through the crank's axis, and its joint's axis points away from there. Where the crank
    drives, a sliding joint that follows is the slider, a rotating one the rod, mounted on the crank or on the slider;
    where the slider drives, a joint mounted on it is the rod, any other the crank.

    Parameters
    ----------
    driver : str
        The crank, a rotating joint, or the slider.
    crank, rod : float
        Their lengths between axes [m].
    angle : float
        From the slider's direction to the crank at the zero pose, about the crank's axis, or about that of a rod that
        follows the slider. Where the slider drives, no multiple of pi, which is a dead point [rad].

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
    if abs(r * float(np.sin(theta0))) >= l:
        raise ValueError(f"`rod` must reach the slider's line at `angle`, got {rod!r}")
    return SliderCrank(driver, r, l, float(np.arctan2(np.sin(theta0), np.cos(theta0))))


@dataclass(frozen=True)
class SliderCrank:
    """Lengths of a slider-crank and the crank's angle at the zero pose, made by `slider_crank`."""

    driver: str
    crank: float
    rod: float
    angle: float

    def __call__(self, model: Model, joint: str, joints: Sequence[str]) -> Linked:
        """Drivers and function of one of the coupled `joints`, for `rne.model.coupled`."""
        if self.driver not in model.moving_joints:
            raise ValueError(f"`driver` must be one of {list(model.moving_joints)}, got {self.driver!r}")
        (i, k), (R, _) = (model.moving_joints.index(name) for name in (joint, self.driver)), _zero_pose(model)
        turns, cranked, behind = bool(model.is_revolute[i]), bool(model.is_revolute[k]), k in carriers(model.parent, i)
        along = float(R[i] @ model.axis[i] @ (R[k] @ model.axis[k]))
        if abs(abs(along) - (turns and cranked)) > CLOSED or not (turns or cranked):
            raise ModelError(f"the axes of joints {joint!r} and {self.driver!r} are not those of a slider-crank")
        r, l, theta0, side0 = self.crank, self.rod, self.angle, self.crank * float(np.sin(self.angle))
        foot0 = float(np.sqrt((l - side0) * (l + side0)))  # of the rod, along the slider's line
        x0, rest = r * float(np.cos(theta0)) + foot0, float(np.arctan2(-side0, foot0))
        before = float(np.sign(x0)) * (abs(x0) > CLOSED * l)  # -1 for a slider on the other side of the crank's axis
        if cranked:
            reach, middle = float(np.arcsin(min(1.0, l / r))), np.pi * round(theta0 / np.pi)
            ends = (middle - theta0 - reach, middle - theta0 + reach) if r >= l * (1 - CLOSED) else (-np.inf, np.inf)
            branch = 0.0
        else:
            ends = _ends(before, abs(l - r) - abs(x0), l + r - abs(x0))
            branch = before * _branch(self.driver, np.array([before, 0.0]), np.array([np.cos(theta0), np.sin(theta0)]))

        def position(given: Any) -> Any:
            if cranked:
                side, near = r * np.sin(theta0 + given), r * np.cos(theta0 + given)
                foot = np.sqrt((l - side) * (l + side))
                if not turns:
                    return near + foot - x0
                return along * (arctan2(-side, foot) - rest - (given if behind else 0.0))
            y = before * (x0 + given)
            area = branch * np.sqrt((l - r + y) * (l + r - y)) * np.sqrt((y + r - l) * (y + r + l))
            if not behind:
                return arctan2(area, before * (y * y + (r - l) * (r + l))) - theta0
            return arctan2(-area, before * (y * y + (l - r) * (l + r))) - rest

        return Linked((self.driver,), position, ends, self._loop(model, joints, x0))

    def _loop(self, model: Model, joints: Sequence[str], x0: float) -> Loop | None:
        """Pivot at the rod's far end, in the plane of its other one; None unless crank, rod and slider all move."""
        R, p = _zero_pose(model)
        bodies = [model.moving_joints.index(name) for name in (self.driver, *joints)]
        turns = model.is_revolute
        kinds = ["slider" if not turns[i] else "rod" if model.parent[i] in bodies else "crank" for i in bodies]
        if sorted(kinds) != ["crank", "rod", "slider"]:
            return None
        c, i, s = (bodies[kinds.index(kind)] for kind in ("crank", "rod", "slider"))
        if kinds[0] == "slider" and model.parent[i] != s:
            rod, cure = model.moving_joints[i], f"must be mounted on the slider {self.driver!r} that drives"
            raise ModelError(f"the rod {rod!r} {cure}")
        u, n = R[s] @ model.axis[s], R[c] @ model.axis[c]
        pin, end = self.crank * (np.cos(self.angle) * u + np.sin(self.angle) * cross(n, u)), x0 * u
        near, far, other = (pin, end, s) if model.parent[i] == c else (end, pin, c)
        gap, place, ends = p[i] - p[c] - near, p[i] + far - near, list[tuple[str, tuple[float, ...]]]()
        if (apart := float(np.abs(gap - n * (n @ gap)).max())) > CLOSED * (self.crank + self.rod):
            raise ModelError(
                f"crank, rod and slider must close at the zero pose: the rod {model.moving_joints[i]!r} is mounted "
                f"{apart:.3g} m from where they put it; `angle` is about the crank's axis, from the slider's axis, "
                "which points away from the crank"
            )
        for body in (i, other):
            k = model.link_joints.index(model.moving_joints[body])
            at = rotate_back(model.link_rotation[k], rotate_back(R[body], place - p[body]) - model.link_translation[k])
            ends.append((model.link_names[k], tuple(at.tolist())))
        return Loop(tuple(joints), tuple(ends))


def _loop(model: Model, driver: str, closing: Closing, *forms: str) -> list[Pivot]:
    """Pivots of a loop in its plane, in order from the driver or from the one opposite, for the closed form.

    A form has an R for each that rotates and a P for each that slides.
    """
    if driver not in model.moving_joints:
        raise ValueError(f"`driver` must be one of {list(model.moving_joints)}, got {driver!r}")
    if not isinstance(closing, Sequence) or [isinstance(end, Sequence) and len(end) for end in closing] != [2, 2]:
        raise TypeError(f"`closing` must be ((link, point), (link, point)), got {closing!r}")
    R, p = _zero_pose(model)
    paths, ends = [], []
    for k, (link, point) in enumerate(closing):
        index, here = model.link_index(link), real_array(f"closing[{k}][1]", point, "(3,)")
        body, here = model.link_body[index], model.link_translation[index] + rotate(model.link_rotation[index], here)
        paths.append(carriers(model.parent, body))
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
    drivers = (driver, *(model.moving_joints[i] for i, _ in loop[4:]))  # which may follow others
    if form not in forms or driver not in names or not set(names) <= {*drivers, *model.joint_names}:
        what = " or ".join(str(len(text) - 1) for text in forms)
        sliding = "one of them the slide of the cylinder" if "P" in forms[0] else "all rotating"
        needed = f"{what} joints, {driver!r} and others that follow none, {sliding}"
        raise ModelError(f"the loop must have {needed}; it has {names}")
    return _in_plane(model, loop, R, p, ends)


def _size(*pivots: Pivot) -> float:
    """Length below which two pivots coincide, relative to the links of the loop."""
    lengths = [float(_length(p.place - q.place)) for p, q in zip(pivots, (*pivots[1:], pivots[0]), strict=True)]
    if min(lengths) <= CLOSED * max(lengths):
        raise ModelError(f"two pivots of the loop of joint {pivots[0].joint!r} are at one place: a link has no length")
    return CLOSED * max(lengths)


def _in_plane(model: Model, loop: Sequence[tuple[int, float]], R: Any, p: Any, ends: Sequence[Array]) -> list[Pivot]:
    """Pivots of a loop, which is checked to close and to be planar."""
    turning = next(i for i, _ in loop if i >= 0 and model.is_revolute[i])
    normal, first = R[turning] @ model.axis[turning], R[turning] @ perpendicular(model.axis[turning])
    plane, places = np.array([first, cross(normal, first)]), [p[i] if i >= 0 else ends[0] for i, _ in loop]
    gap, size = (float(np.abs(np.subtract(a, ends[0])).max()) for a in (ends[1:], [p[i] for i, _ in loop if i >= 0]))
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


def _closed(model: Model, loop: list[Pivot], closing: Closing, motions: Motions, ends: Ends, *drivers: str) -> Model:
    """Robot with a loop's joints coupled to the drivers, by motions since the zero pose, up to its ends."""
    rest = [float(model.rest[model.moving_joints.index(name)]) for name in drivers]
    names = {pivot.joint: k for k, pivot in enumerate(loop) if pivot.joint not in ("", *drivers)}
    points = tuple((link, tuple(np.asarray(point, dtype=float).tolist())) for link, point in closing)
    domain, kept = (ends[0] + rest[0], ends[1] + rest[0]), Loop(tuple(names), points)

    def following(k: int) -> Linked:
        def position(*given: Any) -> Any:
            return loop[k].sense * motions(*(x - x0 for x, x0 in zip(given, rest, strict=True)))[k]

        return Linked(drivers, position, domain, kept)

    return coupled(model, {name: following(k) for name, k in names.items()})


def _half(psi: Any, side: float, inner: float, outer: float, near: float) -> tuple[Any, Any]:
    """Sine and cosine of half an angle; NaN beyond a change point."""
    S, C = np.sin(psi / 2), np.cos(psi / 2)
    if abs(inner) <= near:
        S = side * np.sqrt(side * S) * np.sqrt(side * S)
    return S, np.sqrt(C) * np.sqrt(C) if abs(outer) <= near else C


def _across(a: float, g: float, psi: Any, S: Any, C: Any) -> tuple[Any, Any]:
    """Vector from the end of an arm g to that of an arm a on the same pivot, at angle psi; S and C are of psi / 2.

    Returns its direction relative to arm g, continuous over all turns, and the squared distance. The direction follows
    the longer arm; the other changes it by less than a right angle.
    """
    if a >= g:
        direction = psi + arctan2(2 * g * S * C, (a - g) + 2 * g * S * S)
    else:
        direction = np.pi - arctan2(2 * a * S * C, (g - a) + 2 * a * S * S)
    return direction, (a - g) ** 2 + 4 * a * g * S * S


def _span(a: float, g: float, psi: float, low: float, high: float) -> Ends:
    """Range of the angle from arm g to arm a, relative to psi, with their ends between `low` and `high` apart."""

    def root(x: float, y: float) -> float:
        return float(np.sqrt(max((x - y) * (x + y), 0.0)))

    nearest, farthest, side = abs(a - g), a + g, np.sign(psi)
    outer, inner = np.inf, -np.inf
    if high - farthest <= CLOSED * farthest:
        outer = 2 * np.arctan2(root(high, nearest), root(farthest, high))
        inner = -outer
    if nearest - low <= CLOSED * farthest:
        inner = 2 * np.arctan2(root(low, nearest), root(farthest, low))
        outer = min(outer, 2 * np.pi - inner)
    low, high = sorted((side * inner - psi, side * outer - psi))
    return float(low), float(high)


def _ends(sense: float, low: float, high: float) -> Ends:
    """Range of the motion times `sense`, which is 1 or -1."""
    return (low, high) if sense > 0 else (-high, -low)


def _branch(driver: str, u: Array, v: Array) -> float:
    """Side of u on which the vector v is at the zero pose: 1 or -1; an error on neither, where branches meet."""
    area, (short, long) = _cross(u, v), sorted((_length(u), _length(v)))
    if abs(area) <= CLOSED * short * long or short <= CLOSED * long:
        raise ModelError(f"the zero pose is a dead point of the linkage that {driver!r} drives; move a joint's zero")
    return float(np.sign(area))


def _cross(u: Array, v: Array) -> Any:
    return u[0] * v[1] - u[1] * v[0]


def _turn(u: Array, v: Array) -> Any:
    """Angle from a vector u to v."""
    return arctan2(_cross(u, v), u @ v)


def _length(v: Array) -> float:
    return float(np.hypot(*v))
