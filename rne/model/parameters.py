"""The inertial parameters of a model: as a vector, ten per body, and as pseudo-inertias; a model with others.

The pseudo-inertia of a body is the symmetric 4 x 4 matrix of its second moments of mass, P = [[Sigma, h], [h^T, m]]
with Sigma = tr(I) / 2 1 - I, the integral of r r^T dm, and h = m c. A body that some distribution of mass has is one
with P positive semidefinite; Wensing, Kim and Slotine 2018.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_array
from ..basics.spatial import IDENTITY, Array, dot, outer, point_mass_inertia, symmetric, transpose, zeros
from .model import Model, model_argument, with_unchecked
from .solids import Moments

PARAMETERS = 10  # of a body
PRODUCTS = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # entries of the inertia, in their order
ROWS, COLUMNS = (np.array(indices) for indices in zip(*PRODUCTS, strict=True))
ENTRIES = np.zeros((3, 3), np.intp)  # of a symmetric matrix: the place of each among the PRODUCTS
ENTRIES[ROWS, COLUMNS] = ENTRIES[COLUMNS, ROWS] = range(len(PRODUCTS))
# The inertia per unit of each of its entries; small integers are promoted to the dtype of the other operand.
BASIS = np.array([[[int({r, c} == {i, j}) for c in range(3)] for r in range(3)] for i, j in PRODUCTS], np.int8)


def of_states(model: Model, states: Any) -> Model:
    """The robot of some states of a batch: with their moments, where every state has its own."""
    moments = model.given_moments
    if moments is None or moments.mass.ndim == 1:
        return model
    return with_moments(model, Moments(*(moment[states] for moment in moments)))


def with_moments(model: Model, moments: Moments) -> Model:
    """The robot for dynamics alone, with other moments of mass: (..., nb), (..., nb, 3) and (..., nb, 3, 3)."""
    return with_unchecked(model, given_moments=moments)


def parameters_of(model: Model) -> Array:
    """Mass, first moment and inertia of each body about the origin of its joint's frame in the URDF."""
    if model.given_moments is None:
        return parameters_of_bodies(model.mass, model.com - model.joint_origin, model.inertia).reshape(-1)
    return parameters_seen_from(*model.given_moments, -model.joint_origin).reshape(-1)


def parameters_of_bodies(mass: Array, centre: Array, inertia: Array) -> Array:
    """The ten parameters about a point, (..., 10), of bodies with centres of mass seen from there."""
    inertia = inertia + point_mass_inertia(mass[..., None, None], centre)
    moments = mass[..., None] * centre
    return np.concatenate([mass[..., None], moments, inertia[..., ROWS, COLUMNS]], axis=-1)


def parameters_seen_from(m: Array, h: Array, inertia: Array, p: Array) -> Array:
    """The ten parameters (..., 10) of bodies about another point, from where the former one is at p."""
    shift = 2 * dot(h, p)[..., None, None] * IDENTITY - outer(h, p) - outer(p, h)
    inertia = inertia + shift + point_mass_inertia(m[..., None, None], p)
    return np.concatenate([m[..., None], h + m[..., None] * p, inertia[..., ROWS, COLUMNS]], axis=-1)


def body_of_parameters(pi: Array) -> tuple[Array, Array, Array]:
    """Mass, centre of mass, and inertia about it, of a body with ten parameters about a point."""
    mass, centre = pi[0], pi[1:4] / pi[0] if pi[0] else np.zeros(3)
    return mass, centre, pi[4:].take(ENTRIES, -1) - point_mass_inertia(mass[None, None], centre)


def at_parameters(model: Model, parameters: Array) -> Model:
    """The robot for dynamics alone, at parameters that are not checked and may differ from state to state.

    They have shape (..., 10 nb), as of `with_parameters`, and any dtype, traced numbers too.
    """
    rows = parameters.reshape(*parameters.shape[:-1], model.nb, PARAMETERS)
    m, h, o = rows[..., 0], rows[..., 1:4], model.joint_origin
    inertia = rows[..., 4:].take(ENTRIES, -1)
    # from the joint's origin in the URDF to that of the body's frame
    shift = 2 * dot(h, o)[..., None, None] * IDENTITY - outer(h, o) - outer(o, h)
    inertia = inertia + shift + point_mass_inertia(m[..., None, None], o)
    return with_moments(model, Moments(m, h + m[..., None] * o, inertia))


def with_parameters(model: Model, parameters: ArrayLike) -> Model:
    """The robot with other masses, centres of mass and inertias.

    The result is a Model; parameters and errors are those of `rne.Robot.with_parameters`, with the model first.
    """
    model_argument(model)
    pi = real_array("parameters", parameters, f"({PARAMETERS * model.nb},), ten per body").astype(np.float64)
    rows = pi.reshape(model.nb, PARAMETERS)
    mass, moment = rows[:, 0], rows[:, 1:4]
    for i in np.flatnonzero((mass == 0) & moment.any(axis=1)):
        raise ValueError(f"`parameters`: the body of joint {model.moving_joints[i]!r} has a first moment and no mass")
    centre = moment / np.where(mass == 0, 1.0, mass)[:, None]
    inertia = rows[:, 4:].take(ENTRIES, -1) - point_mass_inertia(mass[:, None, None], centre)
    return replace(model, mass=mass, com=centre + model.joint_origin, inertia=inertia, notes={})


def with_fewest_terms(model: Model) -> Model:
    """The robot for dynamics alone, with every inertial parameter that may be moved towards the base moved there.

    Its moments may differ from state to state.

    Torques, M and accelerations are the same in every state, with fewer terms; energies and joint wrenches are not.

    A mass on the axis of a rotating joint moves alike with the bodies on both sides of it, so it may be counted with
    either; and a body's inertia about its origin depends only on its rotation, which is the same on both sides of a
    sliding joint. Of its ten inertial parameters a body keeps seven behind a rotating joint and four behind a sliding
    one; what reaches the base is dropped: the regrouping of Gautier and Khalil 1990, joint by joint.
    `rne.dynamics.base_parameters` says which combinations torques depend on, with what a first axis along gravity hides
    besides.
    """
    mass, first_moment, inertia = (array.copy() for array in model.moments)
    for i in reversed(range(model.nb)):
        R, p, b = model.rotation[i], model.translation[i], model.axis[i]
        if model.is_revolute[i]:
            e = perpendicular(b)
            on_axis = mass[..., i].copy(), first_moment[..., i, :] @ b, e @ inertia[..., i, :, :] @ e
            moved = _moments_of_rod(*on_axis, p, R @ b)
            mass[..., i], first_moment[..., i, :] = 0, first_moment[..., i, :] - on_axis[1][..., None] * b
            inertia[..., i, :, :] = inertia[..., i, :, :] - on_axis[2][..., None, None] * (IDENTITY - outer(b, b))
        else:
            turned = R @ inertia[..., i, :, :] @ transpose(R)
            moved = Moments(0 * mass[..., i], 0 * first_moment[..., i, :], turned)
            inertia[..., i, :, :] = 0
        if model.parent[i] >= 0:
            k = model.parent[i]
            mass[..., k] = mass[..., k] + moved.mass
            first_moment[..., k, :] = first_moment[..., k, :] + moved.first_moment
            inertia[..., k, :, :] = inertia[..., k, :, :] + moved.inertia
    return with_moments(model, Moments(mass, first_moment, inertia))


def moments_as_vector(model: Model) -> Array:
    """The moments of the bodies one after another, shape (..., 10 nb): masses, first moments, inertias."""
    m, h, inertia = model.moments
    leading = m.shape[:-1]
    return np.concatenate([m, h.reshape(*leading, -1), inertia[..., ROWS, COLUMNS].reshape(*leading, -1)], axis=-1)


def moments_of_vector(vector: Array) -> Moments:
    """The moments of bodies from the vector of `moments_as_vector`, which may be traced."""
    leading, nb = vector.shape[:-1], vector.shape[-1] // PARAMETERS
    m, h, products = vector[..., :nb], vector[..., nb : 4 * nb], vector[..., 4 * nb :]
    inertia = products.reshape(*leading, nb, 6).take(ENTRIES, -1)
    return Moments(m, h.reshape(*leading, nb, 3), inertia)


def perpendicular(b: Array) -> Array:
    """A unit vector perpendicular to b: along a frame axis if b is."""
    k = int(np.argmin(np.abs(b)))
    e = np.eye(3)[k] - b[k] * b
    return np.asarray(e / np.sqrt(e @ e))


def _moments_of_rod(mass: Array, first: Array, second: Array, p: Array, u: Array) -> Moments:
    """Moments of masses on a line through p along u, from their moments along it about p."""
    cross_terms = 2 * (p @ u) * IDENTITY - outer(p, u) - outer(u, p)
    first, second = np.asarray(first), np.asarray(second)
    inertia: Array = point_mass_inertia(np.asarray(mass)[..., None, None], p) + first[..., None, None] * cross_terms
    inertia = inertia + second[..., None, None] * (IDENTITY - outer(u, u))
    return Moments(mass, np.asarray(mass)[..., None] * p + first[..., None] * u, inertia)


# P = sum over k of pi_k UNITS[k]: the pseudo-inertia per unit of each parameter
UNITS = np.zeros((PARAMETERS, 4, 4))
UNITS[0, 3, 3] = 1.0
UNITS[1:4, :3, 3] = UNITS[1:4, 3, :3] = np.eye(3)
UNITS[4:, :3, :3] = np.trace(BASIS, axis1=1, axis2=2)[:, None, None] / 2 * np.eye(3) - BASIS


def pseudo_inertia(pi: Array) -> Array:
    """The pseudo-inertias (..., nb, 4, 4) of bodies with inertial parameters (..., 10 nb), numbers or traced numbers.

    Second moments [kg m^2], first moments [kg m] and mass [kg], about the point and in the axes of the parameters.
    """
    return combined(pi, UNITS)


def parameters_of_pseudo_inertia(P: Array) -> Array:
    """The inertial parameters (..., 10 nb) of bodies with pseudo-inertias (..., nb, 4, 4), numbers or traced."""
    pi = zeros((*P.shape[:-2], PARAMETERS), like=P)
    pi[..., 0] = P[..., 3, 3]
    pi[..., 1:4] = P[..., :3, 3]
    trace = P[..., 0, 0] + P[..., 1, 1] + P[..., 2, 2]
    for k, (i, j) in enumerate(PRODUCTS):  # I = tr(Sigma) 1 - Sigma
        pi[..., 4 + k] = trace - P[..., i, i] if i == j else -P[..., i, j]
    return pi.reshape(*P.shape[:-3], -1)


def dual_of_gradient(slope: Array) -> Array:
    """The symmetric matrices S (..., nb, 4, 4) with tr(S dP) = slope . dpi for every change dpi of the parameters.

    `slope` (..., 10 nb) holds derivatives by each parameter, numbers or traced numbers.
    """
    return combined(slope, DUALS)


def combined(coefficients: Array, matrices: Array) -> Array:
    """Sum of the ten matrices, times ten coefficients per body, shape (..., nb, 4, 4)."""
    rows = np.asarray(coefficients).reshape(*np.shape(coefficients)[:-1], -1, PARAMETERS)
    total: Any = zeros((*rows.shape[:-1], 4, 4), like=rows)
    for k, matrix in enumerate(matrices):
        for i, j in np.argwhere(matrix):  # products with zeros would be operations of a kernel
            total[..., i, j] += matrix[i, j] * rows[..., k]
    return np.asarray(total)


# tr(DUALS[k] UNITS[l]) is 1 for k = l, otherwise 0: tr(DUALS[k] P) is parameter k of P
DUALS = symmetric(parameters_of_pseudo_inertia(np.eye(16).reshape(16, 4, 4)).reshape(4, 4, PARAMETERS).T)
