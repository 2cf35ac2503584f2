"""Proven constants of a robot that stability theorems assume, with the values attained."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import dynamics
from ..basics.arrays import per_joint_array, positive_number, real_array
from ..basics.spatial import Array, christoffel
from ..basics.text import UNITS, InNotebooks, short
from ..kernels.cache import KernelCache
from ..model.model import Model
from ..model.modify import with_payload
from .branch_and_bound import Clock, ProvenMaximum, largest
from .criteria import ROUNDING, Coriolis, LargestModulus, LargestOfInverse, Modulus, Norm, Torque, half_of_corners
from .polynomials import Polynomial, PositionBox, box_argument, independent, levers, polynomial, sizes_of_terms

Range = tuple[float, float]
QUANTITIES = ("gravity_torque", "gravity_stiffness", "mass_matrix", "mass_eigenvalues", "coriolis", "torque")
NAMES = (*QUANTITIES, "point_speed")  # "point_speed" needs a link
SAMPLES = 500  # random positions over which M is averaged to scale slacks
HALF = 180  # steps from 0 to pi / 2
UNKNOWN = 1e150  # placeholder for an unknown bound, with a finite square


@dataclass(frozen=True)
class Bound(InNotebooks):
    """Constant, or array of constants, of `Robot.bounds`: proven to be from `lower` to `upper`.

    Attributes
    ----------
    lower, upper : ndarray
        Proven bounds, rounding included; 0 and infinity where nothing is proven. Of an entry that vanishes everywhere,
        0 and a bound of its rounding error.
    attained : ndarray
        The extreme value that a search found; 0 where it is within the rounding error.
    q : ndarray, shape (..., n)
        Positions at which it is attained [rad or m].
    tolerance : float
        Relative gap that was asked for.

    Examples
    --------
    >>> import rne
    >>> k_g = rne.load("irb140").bounds(quantities=["gravity_stiffness"]).gravity_stiffness
    >>> k_g.attained.round(1).item(), bool(k_g.is_tight)
    (162.8, True)
    """

    lower: Array
    upper: Array
    attained: Array
    q: Array
    tolerance: float

    @property
    def gap(self) -> Array:
        """(upper - lower) / attained, 0 for entries that are identically zero, inf where a side is not proven."""
        proven = (self.upper < np.inf) & ((self.lower > 0) | (self.attained == 0))
        with np.errstate(all="ignore"):
            gap = np.where(self.attained == 0, 0.0, (self.upper - self.lower) / self.attained)
        return np.where(proven, gap, np.inf)

    @property
    def is_tight(self) -> Array:
        """True where both sides are proven and the gap is within the tolerance, up to rounding."""
        return self.gap <= self.tolerance * (1 + 1e-6) + 1e-9


@dataclass(frozen=True)
class Bounds(InNotebooks):
    """Proven constants of a robot, as found by `Robot.bounds`; those not asked for are None.

    Attributes
    ----------
    gravity_torque : Bound, shape (n,)
        The largest \\|g_i(q)\\| [N m or N].
    gravity_stiffness : Bound, shape ()
        k_g, the largest norm of dg/dq [N m/rad].
    mass_matrix : Bound, shape (n, n)
        The largest \\|M_ij(q)\\| [kg m^2, kg m or kg].
    mass_eigenvalues : Bound, shape (2,)
        The least and the largest eigenvalue of M(q).
    coriolis : Bound, shape ()
        k_C, the largest \\|C(q, v) w\\| of unit vectors v and w.
    torque : Bound, shape (n,)
        The largest \\|tau_i\\| within the rates and accelerations; values attained are found by local searches over
        positions, rates and accelerations [N m or N].
    point_speed : Bound, shape ()
        The largest speed of a point of a link within the rates [m/s].
    joint_names : tuple of str
    lower, upper : ndarray, shape (n,)
        The positions considered [rad or m].
    circle : ndarray, shape (n,)
        True for coordinates that make full turns.
    models : tuple of Model
        The robot's, or those at the ends of ranges of masses.
    stopped : str
        The proofs that `seconds` stopped, in words, printed below the table; empty if none.

    Examples
    --------
    >>> import rne
    >>> print(rne.load("irb140").bounds(quantities=["gravity_stiffness"]))
       gap    proven  attained
    0.23 %  <= 163.2     162.8  norm of dg/dq
    """

    gravity_torque: Bound | None = None
    gravity_stiffness: Bound | None = None
    mass_matrix: Bound | None = None
    mass_eigenvalues: Bound | None = None
    coriolis: Bound | None = None
    torque: Bound | None = None
    point_speed: Bound | None = None
    joint_names: tuple[str, ...] = ()
    lower: Array = field(default_factory=lambda: np.zeros(0))
    upper: Array = field(default_factory=lambda: np.zeros(0))
    circle: Array = field(default_factory=lambda: np.zeros(0, bool))
    models: tuple[Model, ...] = ()
    stopped: str = ""

    def __str__(self) -> str:
        rows = [("gap", "proven", "attained", "")]
        for bound, name, place, least in self._entries():
            lower, upper, attained, gap = (getattr(bound, x)[place] for x in ("lower", "upper", "attained", "gap"))
            proven = f">= {lower:.4g}" if least else f"<= {upper:.4g}"
            if attained == 0 and gap == 0:
                rows.append(("rounding", proven, "0", name))
            elif lower == 0 if least else upper == np.inf:
                rows.append(("", "not proven", f"{attained:.4g}", name))
            else:
                rows.append((f"{100 * gap:.2g} %" if gap < np.inf else "", proven, f"{attained:.4g}", name))
        width = [max(len(row[k]) for row in rows) for k in range(3)]
        lines = ["  ".join([*(c.rjust(w) for c, w in zip(row, width, strict=False)), row[3]]).rstrip() for row in rows]
        return "\n".join([*lines, *[self.stopped] * bool(self.stopped)])

    __repr__ = __str__

    def _entries(self) -> Iterator[tuple[Bound, str, Any, bool]]:
        """Each bound with its name, its index in the arrays, and True if it bounds from below."""
        names = [short(name) for name in self.joint_names]
        turns = {joint: x for m in self.models for joint, x in zip(m.moving_joints, m.is_revolute, strict=True)}
        units = [UNITS["tau"][not turns.get(name, True)] for name in self.joint_names]
        pairs = [(i, j) for i in range(len(names)) for j in range(i, len(names))]
        places: dict[str, dict[Any, str]] = {
            "gravity_torque": {i: f"gravity torque of {name} [{units[i]}]" for i, name in enumerate(names)},
            "gravity_stiffness": {(): "norm of dg/dq"},
            "mass_matrix": {(i, j): f"|M| of {names[i]}" + (f" and {names[j]}" if i != j else "") for i, j in pairs},
            "mass_eigenvalues": {0: "least eigenvalue of M", 1: "largest eigenvalue of M"},
            "coriolis": {(): "|C(q, v) w| of unit v and w"},
            "torque": {i: f"torque of {name} [{units[i]}]" for i, name in enumerate(names)},
            "point_speed": {(): "speed of the point [m/s]"},
        }
        for quantity, rows in places.items():
            bound = getattr(self, quantity)
            for place, name in rows.items() if bound is not None else ():
                yield bound, name, place, name.startswith("least")


def robot_bounds(
    cache: KernelCache,
    positions: Any,
    rates: ArrayLike | None,
    accelerations: ArrayLike | None,
    payload: Range | None,
    masses: Mapping[str, Range] | None,
    tolerance: float,
    budget: float,
    seconds: float | None,
    quantities: Sequence[str] | None,
    link: str | None,
    point: tuple[float, ...],
) -> Bounds:
    """Implementation of `Robot.bounds` for the model of a kernel cache."""
    model = cache.model
    if not model.n:
        raise ValueError(f"bounds need a robot that moves, {model.name!r} has no joints")
    tolerance, budget = positive_number("tolerance", tolerance), positive_number("budget", budget)
    seconds = np.inf if seconds is None else positive_number("seconds", seconds)
    known = model.coordinate_limits()
    fastest = np.maximum(known["acceleration_limit"], known["deceleration_limit"])
    limits = {"rates": (rates, known["velocity_limit"]), "accelerations": (accelerations, fastest)}
    speeds, changes = (
        limit if given is None else per_joint_array(name, given, model.n, sign="not negative")
        for name, (given, limit) in limits.items()
    )
    able = {"torque": np.isfinite([*speeds, *changes]).all(), "point_speed": link is not None}
    chosen = [q for q in NAMES if able.get(q, True)] if quantities is None else quantities
    is_list = isinstance(chosen, Collection) and not isinstance(chosen, str)
    if not is_list or not chosen or any(name not in NAMES for name in chosen):
        raise ValueError(f"`quantities` must be a list of some of {list(NAMES)}, got {quantities!r}")
    if "torque" in chosen and not able["torque"]:
        raise ValueError("bounds of torques need `rates` and `accelerations`: not all joints have such limits")
    if "point_speed" in chosen and not (able["point_speed"] and np.isfinite(speeds).all()):
        raise ValueError("bounds of the speed of a point need its `link`, and `rates` where not all joints have limits")
    if link is None and any(point):
        raise ValueError("`point` is one of a link: give its `link`")
    if link is not None and model.link_body[model.link_index(link)] < 0:
        raise ValueError(f"`link` must be a link that moves, got {link!r}")
    box = box_argument(model, positions)
    caches = [KernelCache(m, cache.engine) for m in corners_of_masses(model, payload, masses)] or [cache]
    stopped, of_point = [], (link or "", point)
    found: dict[str, Any] = {}
    for name in chosen:
        per_model, used = [], caches[:1] if name == "point_speed" else caches  # masses do not change a speed
        for c in used:
            clock, terms = Clock(seconds / len(used)), RobotPolynomials(c, positions)
            per_model.append(bound_of(terms, name, speeds, changes, of_point, tolerance, budget / len(used), clock))
            if clock.stopped:
                stopped.append(f"{name} after {clock.work:.2g} of {budget / len(used):.4g} of the budget")
        found[name] = extremes(per_model, least=name == "mass_eigenvalues")
    words = f"`seconds` stopped {', '.join(stopped)}; another run may differ" if stopped else ""
    found |= {"lower": box.lower, "upper": box.upper, "circle": box.circle}
    return Bounds(**found, joint_names=model.joint_names, models=tuple(c.model for c in caches), stopped=words)


def corners_of_masses(model: Model, payload: Range | None, masses: Mapping[str, Range] | None) -> list[Model]:
    """Models at the corners of the ranges of masses; none without ranges.

    M, g and C are linear in the masses, and the quantities are convex in these matrices (the least eigenvalue of M is
    concave), so that their extremes are at the corners.
    """
    if not isinstance(masses, Mapping | None):
        example = f"{{{model.link_names[-1]!r}: (1.0, 2.0)}}"
        raise ValueError(f"`masses` must be a dict of two masses for each link, such as {example}, got {masses!r}")
    models, scaled = [model] if payload is not None or masses else [], []
    for link, ends in (masses or {}).items():
        low, high = mass_range(f"masses[{link!r}]", ends)
        able = [name for name, k in zip(model.link_names, model.link_body, strict=True) if k >= 0 and model.mass[k] > 0]
        if link not in able:
            raise ValueError(f"`masses` must name links that move and have a mass, got {link!r}; they are {able}")
        body = model.link_body[model.link_index(link)]
        if body in scaled:
            raise ValueError(f"`masses` must name each body once: {link!r} is fixed to another link of `masses`")
        scaled.append(body)
        factors = [np.where(np.arange(model.nb) == body, mass / model.mass[body], 1.0) for mass in (low, high)]
        models = [replace(m, mass=m.mass * f, inertia=m.inertia * f[:, None, None]) for m in models for f in factors]
    if payload is not None:
        ends = mass_range("payload", payload)
        try:
            models = [with_payload(m, mass) for m in models for mass in ends]
        except ValueError as error:
            why = str(error).partition(": ")[2]
            cure = "bound robot.with_payload(mass, link=...) with the least and with the largest mass"
            raise ValueError(f"`payload` needs one last link at whose end it is: {why}; {cure}") from None
    return models


def mass_range(name: str, ends: Any) -> Range:
    """Smallest and largest mass of a range, checked."""
    low, high = real_array(name, ends, "(2,)").tolist() if np.shape(ends) == (2,) else (1.0, 0.0)
    if not 0 <= low <= high:
        raise ValueError(f"`{name}` must be the least and the largest mass in kg, got {ends!r}")
    return low, high


def extremes(bounds: Sequence[Bound], least: bool = False) -> Bound:
    """Bounds of several models together: the largest of each entry, and the least of the first eigenvalue."""
    sign = np.array([-1.0, 1.0]) if least else 1.0
    lower, upper, attained = (np.array([getattr(b, x) for b in bounds]) for x in ("lower", "upper", "attained"))
    k = (sign * attained).argmax(axis=0)
    q = np.take_along_axis(np.array([b.q for b in bounds]), k[None, ..., None], axis=0)[0]
    lower, upper, attained = ((sign * (sign * x).max(axis=0)) for x in (lower, upper, attained))
    return Bound(lower, upper, attained, q, bounds[0].tolerance)


class RobotPolynomials:
    """M, g and their derivatives of one model as polynomials on a box of positions."""

    def __init__(self, cache: KernelCache, positions: Any) -> None:
        model = cache.model
        self.box = box = box_argument(model, positions)
        self.free = KernelCache(independent(model), cache.engine) if model.has_mimics else cache
        self.samples = np.random.default_rng(4).uniform(box.lower, box.upper, (SAMPLES, model.n))

    def polynomial(self, function: Any, degree: int, *wrt: str) -> Polynomial:
        """Polynomial of a quantity in the coordinates; indices of joints are mapped by G, q_joints = G q + offset."""

        def reduced(x: Array, G: Array) -> Array:
            for axis in range(1, x.ndim if self.box.model.has_mimics else 1):
                x = np.moveaxis(np.moveaxis(x, axis, -1) @ G, -1, axis)
            return x

        return polynomial(self.free.kernel(function, *wrt), self.box, degree, reduced)

    def point_jacobian(self, box: PositionBox, link: str, point: tuple[float, ...]) -> Polynomial:
        """Polynomial of the Jacobian of a point's velocity, (3, n)."""
        model = box.model
        k = model.link_index(link)
        body, offset = model.link_body[k], model.link_translation[k] + model.link_rotation[k] @ np.array(point)
        centred = replace(model, com=np.where(np.arange(model.nb)[:, None] == body, offset, 0.0))
        kernel = self.free.kernel(dynamics.jacobian, link=link, point=point)
        return polynomial(
            kernel, box, 1, lambda x, G: np.asarray(x[:, 3:] @ G), lambda s: levers(centred, s)[0][None, :, body]
        )


def without_first_joint(box: PositionBox, link: str) -> PositionBox:
    """Box with the joint nearest to the root held: that joint turns velocities of the link's points as a whole."""
    model = box.model
    body = model.link_body[model.link_index(link)]
    while model.parent[body] >= 0:
        body = model.parent[body]
    k = model.coordinate[body]
    held = (np.arange(model.n) == k) & (list(model.coordinate).count(k) == 1)
    lower, upper = (np.where(held, (box.lower + box.upper) / 2, end) for end in (box.lower, box.upper))
    return replace(box, lower=lower, upper=upper, circle=box.circle & ~held)


def bound_of(
    terms: RobotPolynomials,
    name: str,
    rates: Array,
    accelerations: Array,
    point: tuple[str, tuple[float, ...]],
    tolerance: float,
    budget: float,
    clock: Clock,
) -> Bound:
    """Bound of one quantity of one model, whose entries share the budget."""
    box, n = terms.box, terms.box.model.n
    end = clock.now() + budget

    def proven(criteria: Sequence[Any], *shape: int, uppers: Sequence[float] | None = None) -> Bound:
        return as_bound(largest(criteria, box, tolerance, end, clock, uppers), shape, tolerance)

    if name == "gravity_torque":
        g = terms.polynomial(dynamics.gravity_torque, 1)
        uppers = None if box.model.has_mimics else gravity_torques_of_full_turns(box.model).tolist()
        return proven([Modulus(entry(g, k)) for k in range(n)], n, uppers=uppers)
    if name == "gravity_stiffness":
        return proven([Norm(terms.polynomial(dynamics.gravity_torque, 1, "q"))])
    if name == "coriolis":
        dM = terms.polynomial(dynamics.mass_matrix, 2, "q")
        c = dM.mapped(christoffel, 1.5 * np.full_like(dM.terms, dM.terms.max(initial=0.0)))
        return proven([Coriolis(c)])
    if name == "torque":
        return proven(torque_criteria(terms, rates, accelerations), n)
    if name == "point_speed":
        box = without_first_joint(box, point[0])
        corners, J = half_of_corners(n) * rates, terms.point_jacobian(box, *point)
        velocities = J.mapped(lambda x: corners @ x.swapaxes(1, 2), np.ones((len(corners), 1)) * (J.terms @ rates))
        return proven([LargestModulus(velocities)])
    M = terms.polynomial(dynamics.mass_matrix, 2)
    if name == "mass_matrix":
        i, j = np.triu_indices(n)
        place = np.zeros((n, n), dtype=int)
        place[i, j] = place[j, i] = range(len(i))
        entries = [Modulus(entry(M, *ij)) for ij in zip(i.tolist(), j.tolist(), strict=True)]
        found = largest(entries, box, tolerance, end, clock)
        return as_bound([found[k] for k in place.ravel()], (n, n), tolerance)
    inverse = LargestOfInverse(M, terms.samples, np.eye(n))
    (high,) = largest([Norm(M, positive=True)], box, tolerance, clock.now() + 2 / 3 * budget, clock)
    (low,) = largest([inverse], box, tolerance, end, clock)
    return as_bound([least_eigenvalue(M, low), high], (2,), tolerance)


def least_eigenvalue(M: Polynomial, inverse: ProvenMaximum) -> ProvenMaximum:
    """Least eigenvalue of M from the largest one of M^-1.

    At the position found, x^T M x is at least the least eigenvalue for every unit vector x. Its rounding error follows
    from those of M's entries, and is far below that of the largest eigenvalue where masses differ widely.
    """
    A = M.evaluate(inverse.q[None])[0]
    x = np.hstack([np.linalg.eigh(A)[1], np.eye(len(A))])
    value, error = (np.einsum("ik,ij,jk->k", y, B, y) for y, B in ((x, A), (abs(x), ROUNDING * M.terms)))
    k, lower = (value + error).argmin(), 1 / inverse.upper
    attained = max(value[k] if value[k] > error[k] else 0.0, lower)
    return ProvenMaximum(lower, max(value[k] + error[k], attained), attained, inverse.q)


def entry(polynomial: Polynomial, *place: int) -> Polynomial:
    """Entry of a polynomial array, as a vector of length one."""
    return polynomial.mapped(lambda x: x[(slice(None), *place, None)])


def torque_criteria(terms: RobotPolynomials, rates: Array, accelerations: Array) -> list[Torque]:
    """Torque criterion of each joint k, from g_k, row M_k and c_ij = (dM_kj/dq_i + dM_ki/dq_j - dM_ij/dq_k) / 2."""
    i, j = np.triu_indices(len(rates))
    g, M = terms.polynomial(dynamics.gravity_torque, 1), terms.polynomial(dynamics.mass_matrix, 2)
    dM = terms.polynomial(dynamics.mass_matrix, 2, "q")
    alone = not M.frequency[:, 0].any() and not dM.frequency[:, 0].any() and abs(g.frequency[:, 0]).max() == 1
    is_searched = not (alone and terms.box.circle[0])  # q_1; then g stands for itself, and a, b, c = g, 0, 0

    def gravity(k: int) -> Polynomial:
        own = entry(g, k)
        return own.mapped(lambda x: np.hstack([x, x, 0 * x, 0 * x])) if is_searched else about_first_angle(own)

    def of(k: int) -> Torque:
        def symbols(x: Array) -> Array:
            c = (x[:, k].swapaxes(1, 2) + x[:, k] - x[..., k]) / 2
            return np.asarray(c[:, i, j] * np.where(i == j, 1, 2))

        c = dM.mapped(symbols, 3 * np.full(len(i), dM.terms.max()))
        return Torque(gravity(k).joined(M.mapped(lambda x: x[:, k]), c), rates, accelerations)

    return [of(k) for k in range(len(rates))]


def about_first_angle(g: Polynomial) -> Polynomial:
    """Gravity torque for `Torque` over full turns of q_1: g, then a, b and c of g = a + b cos q_1 + c sin q_1."""

    def evaluate(q: Array) -> Array:
        first = np.arange(q.shape[1]) == 0
        now, *around = (g.evaluate(x)[:, 0] for x in (q, *(np.where(first, a, q) for a in (0, np.pi / 2, np.pi))))
        mean = (around[0] + around[2]) / 2
        return np.stack([now, mean, around[0] - mean, around[1] - mean], axis=1)

    turns = g.frequency[:, 0]
    c = g.coefficients * np.stack([0 * turns, turns == 0, 2 * (turns > 0), 2j * (turns > 0)], axis=1)
    frequency = g.frequency * (np.arange(g.frequency.shape[1]) > 0)
    return replace(g, evaluate=evaluate, coefficients=c, frequency=frequency, terms=g.terms * [1, 1, 2, 2])


def inertia_extremes(
    models: Sequence[Model], positions: tuple[Array, Array], engine: str, scale: Array, tolerance: float, budget: float
) -> Bound:
    """Largest eigenvalue of D M D, D = diag(scale), and diagonal entries of M^-1, over models and their mixtures.

    Shape (1 + n,). These are convex in M, so that the models suffice. All share the budget.
    """
    found, clock, n = [], Clock(), len(scale)
    for model in models:
        terms = RobotPolynomials(KernelCache(model, engine), positions)
        M = terms.polynomial(dynamics.mass_matrix, 2)
        inverses = [LargestOfInverse(M, terms.samples, np.outer(e, e)) for e in np.eye(n)]
        scaled = M.mapped(lambda x: x * np.outer(scale, scale), scale.max() ** 2)
        criteria = [Norm(scaled, positive=True), *inverses]
        proven = largest(criteria, terms.box, tolerance, clock.now() + budget / len(models), clock)
        found.append(as_bound(proven, (1 + n,), tolerance))
    return extremes(found)


def as_bound(found: Sequence[ProvenMaximum], shape: tuple[int, ...], tolerance: float) -> Bound:
    """Bound with arrays of a shape, from its proven entries."""
    lower, upper, attained = (np.array(x).reshape(shape) for x in list(zip(*found, strict=True))[:3])
    return Bound(lower, upper, attained, np.array([e.q for e in found]).reshape(*shape, -1), tolerance)


def angle(v: Array, w: Array) -> Array:
    """Angle between vectors, shape (...) [rad]."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(v, w), axis=-1), (v * w).sum(axis=-1)))


def gravity_torques_of_full_turns(model: Model) -> Array:
    """Upper bounds of |g_i|, shape (nb,); UNKNOWN for sliding joints, and UNKNOWN or 0 for the joints before them.

    The first moment s_i(q) of the bodies distal to joint i is expressed in frame i. Its largest component along w,
    h_i(w), is convex in w, and after a full turn of the joint before it depends only on the angle between w and that
    joint's axis: one table of a single angle for each joint, from the last to the first, for any number of joints.
    """
    weight = np.linalg.norm(model.gravity)
    most = np.array([tables[HALF] for tables in support_tables(model)])
    torque = weight * largest_sine(model) * most + ROUNDING * sizes_of_terms(model)[0]
    return np.where(model.is_revolute, torque, UNKNOWN)


def support_tables(model: Model) -> Array:
    """Upper bounds of h_i(w) over unit vectors w at angles of 0 to pi from axis i, shape (nb, 2 HALF + 1).

    Between angles a convex function that is homogeneous in w is at most the chord's value. The unit circle of w's
    component across the axis is enclosed by a polygon.
    """
    polar, turn = np.linspace(0, np.pi, 2 * HALF + 1), np.linspace(0, 2 * np.pi, 4 * HALF, endpoint=False)
    across = np.sin(polar) / np.cos(turn[1] / 2)
    tables, mass = np.zeros((model.nb, len(polar))), model.mass.copy()
    moment = model.mass[:, None] * model.com
    axes = np.einsum("nij,nj->ni", model.rotation, model.axis)

    def of_joint(i: int, w: Array) -> Array:
        theta = angle(w, axes[i])
        k = np.minimum((theta / polar[1]).astype(int), 2 * HALF - 1)
        parts = np.sin(polar[k + 1] - theta) * tables[i, k] + np.sin(theta - polar[k]) * tables[i, k + 1]
        return np.asarray(np.linalg.norm(w, axis=-1) * parts / np.sin(polar[1]))

    for i in reversed(range(model.nb)):
        behind = [j for j in range(model.nb) if model.parent[j] == i]
        mass[i] += mass[behind].sum()
        if not model.is_revolute[i] or (tables[behind] == UNKNOWN).any():
            tables[i] = UNKNOWN
            continue
        moment[i] += mass[behind] @ model.translation[behind]
        x, y = np.linalg.svd(model.axis[i][None])[2][1:]
        circle = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
        w = np.cos(polar)[:, None, None] * model.axis[i] + across[:, None, None] * circle
        h = w @ moment[i] + sum(of_joint(j, w) for j in behind)
        tables[i] = h.max(axis=1)
    return tables


def largest_sine(model: Model) -> Array:
    """Largest sine of the angle between gravity and each axis, from the interval of these angles, shape (nb,)."""
    low, high = np.zeros((2, model.nb))
    for i, p in enumerate(model.parent):
        axis = model.rotation[i] @ model.axis[i]
        if p < 0:
            low[i] = high[i] = angle(model.gravity, axis) if model.gravity.any() else 0.0
            continue
        between, ends = angle(model.axis[p], axis), (low[p], high[p])
        low[i] = abs(between - np.clip(between, *ends))
        high[i] = np.pi - abs(np.pi - between - np.clip(np.pi - between, *ends))
    return np.asarray(np.sin(np.clip(np.pi / 2, low, high)))
