"""Which combinations of the standard parameters torques depend on, from the axes and places of the joints alone.

Kinetic and potential energy of a body are linear in its pseudo-inertia P, the integral of x x^T dm with x = (r, 1).
They are tr(Phi P), with Phi = xi^T xi / 2 for a velocity xi, and Phi = -(g, 0) (0, 1)^T for gravity g. Seen from a body
that moves by T against its parent, Phi is T^T Phi T and xi is T^-1 xi T. Torques are zero in every motion if and only
if the robot's kinetic energy is zero and its potential energy constant. Therefore, from the tips to the base: what
changes no energy when the joint moves counts with the parent body; all else of a body is observed. Behind a rotating
joint three parameters are not (Gautier and Khalil 1990), behind a sliding one six, and more where the energies that a
body meets span less: behind joints with parallel axes, or along gravity. The argument for trees is that of Wensing,
Niemeyer and Slotine 2024; here joints on a common coordinate (mimics) are taken as one.
"""

from __future__ import annotations

from dataclasses import fields
from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array, cross, cross_matrix, rotate, transpose
from ..model.model import Model, unchecked_model
from ..model.parameters import PARAMETERS, UNITS
from ..model.standard_parameters import StandardParameters
from ..model.topology import joint_groups, sample_positions
from .kinematics import BASE, joint_transforms

FLAT = 16  # entries of Phi or xi


class Scale(NamedTuple):
    """Units in which the robot's longest offset between joints, and gravity, are 1."""

    length: float
    gravity: float
    coordinates: Array  # 1 for an angle, `length` for a position, shape (n,)


class Reach(NamedTuple):
    """What a body meets in all motions: bases of the spans of its energies and velocities, as rows."""

    energies: Array  # Phi, flat, then 1 for gravity's, shape (..., 17)
    velocities: Array  # xi, flat, then the rates of the further shafts, shape (..., 16 + s)


class Group(NamedTuple):
    """Bodies that move together, at sampled positions of their coordinates."""

    bodies: tuple[int, ...]
    parent: int
    coordinates: list[int]
    q: Array  # shape (samples, coordinates)
    T: Array  # pose of each body against the parent, shape (bodies, samples, 4, 4)
    xi: Array  # velocity of each body per unit rate of each coordinate, shape (bodies, samples, coordinates, 4, 4)


class Drives(NamedTuple):
    """Where the parameters of drives are in rows, behind the entries of Phi."""

    width: int  # number of these parameters
    places: dict[str, int]  # of the first parameter of "Ia", "tau0", "Ia of shafts"
    units: Array  # of the coordinates
    shafts: Array  # rows of further shafts, in these units


def observed_combinations(standard: StandardParameters, tolerance: float) -> tuple[Array, Array]:
    """Independent combinations of bodies, rotors and offsets that span what torques depend on.

    Parameters
    ----------
    standard : StandardParameters
        Without friction.
    tolerance : float
        Directions and distances that differ by less, of the robot's size, are taken as the same.

    Returns
    -------
    rows : ndarray, shape (count, standard.count)
        In the units of the second result.
    units : ndarray, shape (standard.count,)
    """
    model, scale = scaled(standard.model)
    drives = _drives(standard, scale)
    groups = [_group(model, bodies) for bodies in joint_groups(model)]
    gravity = np.zeros((4, 4))
    gravity[:3, 3] = -model.gravity
    fall = np.append(symmetric(gravity), 1.0)
    reach = {BASE: Reach(fall[None], np.zeros((0, FLAT + len(drives.shafts))))}
    observed = []
    for group in groups:
        rows, met = _energies_of_group(group, reach[group.parent], drives)
        reach |= {i: Reach(*(span(x, tolerance) for x in met[i])) for i in group.bodies}
        observed.append(span(rows, tolerance))
    bodies = PARAMETERS * model.nb
    found = [_of_all_bodies(groups, k, observed[k], bodies) for k in range(len(groups))]
    found.append(_shafts_between_branches(model, groups, drives, bodies))
    units = [np.tile([1.0] + [scale.length] * 3 + [scale.length**2] * 6, model.nb), np.full(drives.width, 1.0)]
    for name, place in standard.groups.items():
        if name.startswith("Ia"):
            units[1][place.start - bodies : place.stop - bodies] = scale.length**2
        elif name == "tau0":
            units[1][place.start - bodies : place.stop - bodies] = scale.length * scale.gravity
    return np.concatenate([np.zeros((0, bodies + drives.width)), *found]), np.concatenate(units)


def scaled(model: Model) -> tuple[Model, Scale]:
    """The model in units of its own size."""
    length = float(np.linalg.norm(model.translation, axis=1).max(initial=0)) or 1.0
    gravity = float(np.linalg.norm(model.gravity)) or 1.0
    joint_units = np.where(model.is_revolute, 1.0, length)
    units = joint_units[list(model.independent_joints)]
    values = {f.name: getattr(model, f.name) for f in fields(model)} | {
        "translation": model.translation / length,
        "link_translation": model.link_translation / length,
        "multiplier": model.multiplier * units[list(model.coordinate)] / joint_units,
        "offset": model.offset / joint_units,
        "gravity": model.gravity / gravity,
    }
    return unchecked_model(values), Scale(length, gravity, units)


def _drives(standard: StandardParameters, scale: Scale) -> Drives:
    bodies = standard.groups["bodies"].stop
    places = {name: place.start - bodies for name, place in standard.groups.items()}
    shafts = np.asarray(standard.shafts) * scale.coordinates
    return Drives(standard.count - bodies, places, scale.coordinates, shafts if standard.rotor else shafts[:0])


def _group(model: Model, bodies: tuple[int, ...]) -> Group:
    """Poses and velocities of a group's bodies about the origins of their joints in the URDF."""
    parent = next(model.parent[i] for i in bodies if model.parent[i] not in bodies)
    coordinates = sorted({model.coordinate[i] for i in bodies})
    samples = sample_positions(model, bodies, coordinates)
    q = np.zeros((len(samples), model.n))
    q[:, coordinates] = samples
    R, p = joint_transforms(model, q)
    poses: Array = np.zeros((model.nb, len(samples), 4, 4))
    xi: dict[int, Array] = {}
    for i in bodies:
        k, above, o = coordinates.index(model.coordinate[i]), model.parent[i], model.joint_origin[i]
        step = homogeneous(R[i], p[i] + rotate(R[i], o) - (model.joint_origin[above] if above != BASE else 0))
        poses[i] = step if above == parent else poses[above] @ step
        carried = np.zeros((len(coordinates), len(samples), 4, 4)) if above == parent else xi[above]
        xi[i] = inverse(step) @ carried @ step
        s, t = model.angular_axis[i], model.linear_axis[i]
        xi[i][k] += model.multiplier[i] * velocity_matrix(s, t + cross(s, o))
    twists = np.moveaxis(np.array([xi[i] for i in bodies]), 1, 2)
    return Group(bodies, parent, coordinates, samples, poses[list(bodies)], twists)


def _energies_of_group(group: Group, reach: Reach, drives: Drives) -> tuple[Array, dict[int, tuple[Array, Array]]]:
    """Rows on the group's bodies and on drives that torques depend on, and what each body meets."""
    samples, K = len(group.q), len(group.coordinates)
    Phi, falls = reach.energies[:, :FLAT].reshape(-1, 4, 4), reach.energies[:, FLAT]
    xi, rates = reach.velocities[:, :FLAT].reshape(-1, 4, 4), reach.velocities[:, FLAT:]
    T, own, shafts = group.T[:, :, None], group.xi, drives.shafts[:, group.coordinates].T
    # M and potential energy of the parent's motions, of its motions with the group's rates, and of these rates
    moved = transpose(T) @ Phi @ T
    seen = inverse(T) @ xi @ T
    mixed = kinetic(seen[:, :, :, None], own[:, :, None])
    within = kinetic(own[:, :, :, None], own[:, :, None])
    columns = [
        np.zeros((*shape, drives.width)) for shape in ((samples, len(Phi)), (samples, len(xi), K), (samples, K, K))
    ]
    for place, k in enumerate(group.coordinates):
        if "tau0" in drives.places:
            work = falls * (group.q[:, place, None] - group.q[0, place]) * drives.units[k]
            columns[0][..., drives.places["tau0"] + k] = work
        if "Ia" in drives.places:
            columns[2][:, place, place, drives.places["Ia"] + k] = drives.units[k] ** 2
    if len(drives.shafts):
        place = drives.places["Ia of shafts"]
        columns[1][..., place : place + len(drives.shafts)] = rates[:, None] * shafts
        columns[2][..., place : place + len(drives.shafts)] = shafts[:, None] * shafts
    changed = moved - moved[:, :1]
    rows = [_joined(x, c) for x, c in zip((changed, mixed, within), columns, strict=True)]
    met = {}
    for b, i in enumerate(group.bodies):
        energies = [_with(moved[b], falls[:, None]), _with(mixed[b], np.zeros(1)), _with(within[b], np.zeros(1))]
        met[i] = np.concatenate(energies), np.concatenate([_with(seen[b], rates), _with(own[b], shafts)])
    return np.concatenate(rows), met


def _joined(x: Array, columns: Array) -> Array:
    """Matrices of each body side by side, flat, with columns of drives behind them."""
    flat = np.moveaxis(x, 0, -3).reshape(*columns.shape[:-1], FLAT * len(x))
    return np.concatenate([flat, columns], axis=-1).reshape(-1, flat.shape[-1] + columns.shape[-1])


def _with(x: Array, columns: Array) -> Array:
    """Matrices, flat, with further columns."""
    flat = x.reshape(*x.shape[:-2], FLAT)
    further = np.broadcast_to(columns, (*flat.shape[:-1], columns.shape[-1]))
    return np.concatenate([flat, further], axis=-1).reshape(-1, FLAT + columns.shape[-1])


def _of_all_bodies(groups: list[Group], k: int, observed: Array, bodies: int) -> Array:
    """Rows on a group, written for the standard parameters: all that is behind a body counts with it."""
    width = FLAT * len(groups[k].bodies)
    rows = np.zeros((len(observed), bodies + observed.shape[1] - width))
    rows[:, bodies:] = observed[:, width:]
    Phi = {i: observed[:, FLAT * b : FLAT * (b + 1)].reshape(-1, 4, 4) for b, i in enumerate(groups[k].bodies)}
    for group in groups[k + 1 :]:
        if group.parent in Phi:
            for b, i in enumerate(group.bodies):
                T = group.T[b, 0]
                Phi[i] = T.T @ Phi[group.parent] @ T
    for i, matrices in Phi.items():
        flat = matrices.reshape(-1, FLAT)
        rows[:, PARAMETERS * i : PARAMETERS * (i + 1)] = flat @ UNITS.reshape(PARAMETERS, FLAT).T
    return rows


def _shafts_between_branches(model: Model, groups: list[Group], drives: Drives, bodies: int) -> Array:
    """Entries of M that further shafts alone add to: those of two coordinates that move no common body."""
    place = {i: g for g, group in enumerate(groups) for i in group.bodies}
    carriers: list[set[int]] = []
    for group in groups:
        above = place.get(group.parent)
        carriers.append({len(carriers)} | (carriers[above] if above is not None else set()))
    group_of = [place[i] for i in model.independent_joints]
    pairs = [
        (j, k)
        for k in range(model.n)
        for j in range(k)
        if group_of[j] not in carriers[group_of[k]] and group_of[k] not in carriers[group_of[j]]
    ]
    rows = np.zeros((len(pairs) if len(drives.shafts) else 0, bodies + drives.width))
    if len(rows):
        start = bodies + drives.places["Ia of shafts"]
        first, second = np.transpose(pairs)
        rows[:, start : start + len(drives.shafts)] = (drives.shafts[:, first] * drives.shafts[:, second]).T
    return rows


def span(rows: Array, tolerance: float) -> Array:
    """An orthonormal basis of the rows' span; rows of the size of roundings count as zero."""
    if not rows.size:
        return rows[:0]
    _, sizes, basis = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(basis[sizes > tolerance * max(sizes[0], 1.0)])


def kinetic(x: Array, y: Array) -> Array:
    """The matrix of the entry of M that belongs to the velocities x and y."""
    return symmetric(transpose(x) @ y)


def symmetric(A: Array) -> Array:
    """The symmetric part of square matrices."""
    return np.asarray((A + transpose(A)) / 2)


def velocity_matrix(angular: Array, linear: Array) -> Array:
    """The matrix xi of the velocities xi x of points x = (r, 1)."""
    xi = np.zeros((*angular.shape[:-1], 4, 4))
    xi[..., :3, :3], xi[..., :3, 3] = cross_matrix(angular), linear
    return xi


def homogeneous(R: Array, p: Array) -> Array:
    """The pose as a matrix of homogeneous coordinates."""
    T = np.zeros((*R.shape[:-2], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, p, 1
    return T


def inverse(T: Array) -> Array:
    """The inverse of poses."""
    R = transpose(T[..., :3, :3])
    return homogeneous(R, -rotate(R, T[..., :3, 3]))
