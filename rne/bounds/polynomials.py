"""Torques and inertias as trigonometric polynomials of the joint angles, with coefficients from values on a grid.

M and its derivatives have degree 2 in the angle of each joint, gravity torques degree 1; in the position of a sliding
joint they are polynomials of the same degrees. Values on a grid of 2 degree + 1 points per joint give all coefficients.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..basics.arrays import per_joint_array
from ..basics.spatial import Array, Map
from ..kernels.kernel import Kernel
from ..model.model import Model

MOST_SAMPLES = 2_000_000  # most samples of a grid for the coefficients
NARROW = 1e-150  # half width of a sliding joint's range below which its inverse square overflows


@dataclass(frozen=True)
class PositionBox:
    """Ranges of the coordinates of a model; `circle` where a range is a full turn."""

    model: Model
    lower: Array
    upper: Array
    circle: Array

    @cached_property
    def joint_ranges(self) -> tuple[Array, Array]:
        """Middle and half width of each moving joint's range, shapes (nb,)."""
        G = self.model.coordinate_map
        return G @ (self.lower + self.upper) / 2 + self.model.offset, abs(G) @ (self.upper - self.lower) / 2


def box_argument(model: Model, positions: Any) -> PositionBox:
    """Box for the argument `positions`: "circle", "limits" or (lower, upper). Angles without a range turn fully."""
    lower, upper = (model.coordinate_limits()[name] for name in ("lower", "upper"))
    is_word, is_pair = isinstance(positions, str), isinstance(positions, Sequence | np.ndarray) and len(positions) == 2
    if not (positions in ("circle", "limits") if is_word else is_pair):
        raise ValueError(f'`positions` must be "circle", "limits" or (lower, upper), got {positions!r}')
    if not is_word:
        lower, upper = (per_joint_array("positions", x, model.n) for x in positions)
    whole = model.is_revolute & (model.multiplier == np.round(model.multiplier))  # these come back after a full turn
    periodic = np.array([whole[np.array(model.coordinate) == k].all() for k in range(model.n)], bool)
    circle = periodic & (np.array(isinstance(positions, str) and positions == "circle") | (upper - lower >= 2 * np.pi))
    if (~circle & (lower > upper)).any():
        raise ValueError(f"`positions` must have lower <= upper, also for mimic joints, got {lower} and {upper}")
    for k in np.flatnonzero(~circle & ~np.isfinite(upper - lower)):
        turns = model.is_revolute[model.independent_joints[k]]
        why = "drives joints that turn by a fraction of its angle or slide" if turns else "slides"
        need = f"bounds need a range of {model.joint_names[k]!r}, which {why}"
        raise ValueError(f"{need}; give `positions`=(lower, upper)")
    return PositionBox(model, np.where(circle, -np.pi, lower), np.where(circle, np.pi, upper), circle)


@dataclass(frozen=True)
class Polynomial:
    """Array A(q) as a sum of modes, each the product of one function of modulus at most 1 per joint."""

    evaluate: Map  # (N, n) -> (N, ...)
    coefficients: Array  # (modes, ...)
    frequency: Array  # (modes, n), in the angle of each coordinate
    power: Array  # (modes, n), sums of p / h of the powers p of sliding joints that a coordinate drives,
    power_squares: Array  # and of p / h^2, with h their half widths
    terms: Array  # (...), bounds of the sums of the moduli that the recursions add up to each entry, for their rounding
    operations: int = 0  # of `evaluate`, for each position

    def derivatives(self, basis: Array) -> tuple[Array, Array]:
        """Bounds of a mode's first and second derivative with respect to each x of q = basis x, shape (modes, n)."""
        slope = abs(self.frequency @ basis) + self.power
        return slope, slope**2 - self.power_squares  # x^p has p (p - 1)

    def mapped(self, linear: Map, terms: Array | None = None) -> Polynomial:
        """Polynomial of a linear map of A; `terms` are needed if the map has negative coefficients."""
        terms = linear(self.terms[None])[0] if terms is None else terms
        return replace(
            self, evaluate=lambda q: linear(self.evaluate(q)), coefficients=linear(self.coefficients), terms=terms
        )

    def joined(self, *others: Polynomial) -> Polynomial:
        """Polynomial of several arrays of one row each, side by side."""
        from scipy.linalg import block_diag

        parts = (self, *others)
        names = ("frequency", "power", "power_squares", "terms")
        rows = {name: np.concatenate([getattr(p, name) for p in parts]) for name in names}
        coefficients, operations = block_diag(*(p.coefficients for p in parts)), sum(p.operations for p in parts)
        return Polynomial(
            lambda q: np.hstack([p.evaluate(q) for p in parts]), coefficients, **rows, operations=operations
        )


def independent(model: Model) -> Model:
    """Model with independent mimic joints: the positions of all moving joints are its coordinates."""
    free: dict[str, Any] = {"coordinate": None, "independent_joints": None, "multiplier": None, "offset": None}
    return replace(model, **free) if model.has_mimics else model


def levers(model: Model, slides: Array | float = 0.0) -> tuple[Array, Array]:
    """Bounds of the speeds of bodies' centres by each joint's rate, and the mask of bodies it moves: (nb, nb) each.

    Chains are taken as stretched, with bodies at their ends.
    """
    turns, nb = model.is_revolute, model.nb
    reach, behind = np.linalg.norm(model.translation, axis=1) + np.where(turns, 0.0, slides), np.eye(nb, dtype=bool)
    for i, p in enumerate(model.parent):
        if p >= 0:
            reach[i] += reach[p]
            behind[:, i] |= behind[:, p]
    lever = reach - reach[:, None] + np.linalg.norm(model.com, axis=1)
    return np.where(behind, np.where(turns[:, None], lever, 1.0), 0.0), behind


def sizes_of_terms(model: Model, slides: Array | float = 0.0) -> tuple[Array, Array]:
    """Bounds of the terms of gravity torques (nb,) and of M (nb, nb), by `levers`."""
    lever, behind = levers(model, slides)
    own = (behind & model.is_revolute[:, None]) @ np.linalg.norm(model.inertia, axis=(1, 2)) + model.armature
    inertia = np.sqrt(lever**2 @ model.mass + own)
    return np.linalg.norm(model.gravity) * lever @ model.mass, np.outer(inertia, inertia)


def polynomial(
    kernel: Kernel, box: PositionBox, degree: int, reduced: Callable[[Array, Array], Array], sizes: Map | None = None
) -> Polynomial:
    """Polynomial of a kernel of the `independent` model; `reduced` maps indices of joints to coordinates by G.

    `sizes` bounds its terms where sliding joints move by the lengths given; by default `sizes_of_terms`.
    """
    model, G = box.model, box.model.coordinate_map
    modes, coefficients = _modes(kernel, box, degree)
    half = np.where(model.is_revolute, 1.0, np.maximum(box.joint_ranges[1], NARROW))
    powers = np.where(model.is_revolute, 0.0, modes)
    turns = modes - powers
    frequency, phase = turns @ G, turns @ model.offset
    coefficients = (coefficients.T * np.exp(1j * phase)).T  # of angles of joints, G q + offset
    of_powers = powers @ abs(G / half[:, None]), powers @ (G / half[:, None]) ** 2

    def evaluate(q: Array) -> Array:
        return reduced(kernel(q @ G.T + model.offset), G)

    slides = abs(box.joint_ranges[0]) + half
    terms = sizes(slides) if sizes else sizes_of_terms(model, slides)[degree - 1]
    terms = np.broadcast_to(terms.T, coefficients[0].T.shape).T  # the same for each derivative
    terms, coefficients = reduced(terms[None], abs(G))[0], reduced(coefficients, G)
    kept = abs(coefficients).reshape(len(modes), -1).max(axis=1) > 0
    kept[0] = True  # of an array that vanishes
    power, power_squares = (x[kept] for x in of_powers)
    operations = sum(kernel.operations.values())
    return Polynomial(evaluate, coefficients[kept], frequency[kept], power, power_squares, terms, operations)


def _modes(kernel: Kernel, box: PositionBox, degree: int) -> tuple[Array, Array]:
    """Frequency or power of each joint, shape (modes, nb), and the coefficients, shape (modes, ...)."""
    model, points = box.model, 2 * degree + 1
    middle, half = box.joint_ranges
    read = kernel.traced.program.reads
    joints = np.flatnonzero(read & (half > 0))
    if points ** len(joints) > MOST_SAMPLES:
        names = [model.moving_joints[j] for j in joints]
        raise ValueError(
            f"bounds of {kernel.quantity.name} need {points}^{len(joints)} samples, one factor for each of the "
            f"joints {names}; lock those that do not matter (Robot.locked)"
        )
    turning = model.is_revolute[joints]
    indices = np.indices([points] * len(joints)).reshape(len(joints), points ** len(joints))
    turns, slides = 2 * np.pi / points * np.arange(points), np.outer(half, np.linspace(-1, 1, points)) + middle[:, None]
    nodes = np.where(turning[:, None], turns, slides[joints])
    numbers = np.where(turning[:, None], np.fft.fftfreq(points, 1 / points), np.arange(points))
    modes = np.zeros((points ** len(joints), model.nb))
    grid = modes + middle
    for k, j in enumerate(joints):
        grid[:, j], modes[:, j] = nodes[k, indices[k]], numbers[k, indices[k]]
    values = np.asarray(kernel(grid))
    c = np.fft.fftn(values.reshape(*[points] * len(joints), -1), axes=np.flatnonzero(turning).tolist(), norm="forward")
    of_slides = np.linalg.inv(np.vander(np.linspace(-1, 1, points), increasing=True))
    for axis in np.flatnonzero(~turning):
        c = np.moveaxis(np.tensordot(of_slides, c, (1, axis)), 0, axis)
    return modes, c.reshape(values.shape)
