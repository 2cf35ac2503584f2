"""Inertial parameters of a model as a vector, ten per body, and models with other parameters."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_array
from ..basics.inertia import COLUMNS, ENTRIES, PARAMETERS, ROWS, parameters_of_bodies, parameters_seen_from
from ..basics.spatial import IDENTITY, Array, dot, outer, point_mass_inertia, transpose
from .model import Model, of_either, with_unchecked
from .solids import Moments


def of_states(model: Model, states: Any) -> Model:
    """Model for some states of a batch, with their moments if these differ between states."""
    moments = model.given_moments
    if moments is None or moments.mass.ndim == 1:
        return model
    return with_moments(model, Moments(*(moment[states] for moment in moments)))


def with_moments(model: Model, moments: Moments) -> Model:
    """Model for dynamics only, with other moments of mass: (..., nb), (..., nb, 3) and (..., nb, 3, 3)."""
    return with_unchecked(model, given_moments=moments)


def parameters_of(model: Model) -> Array:
    """Mass, first moment and inertia of each body about the origin of its joint's frame in the URDF."""
    if model.given_moments is None:
        return parameters_of_bodies(model.mass, model.com - model.joint_origin, model.inertia).reshape(-1)
    return parameters_seen_from(*model.given_moments, -model.joint_origin).reshape(-1)


def at_parameters(model: Model, parameters: Array) -> Model:
    """Model for dynamics only, at parameters that are not checked and may differ between states.

    They have shape (..., 10 nb), in the order of `with_parameters`, and any dtype, also traced numbers.
    """
    rows = parameters.reshape(*parameters.shape[:-1], model.nb, PARAMETERS)
    m, h, o = rows[..., 0], rows[..., 1:4], model.joint_origin
    inertia = rows[..., 4:].take(ENTRIES, -1)
    # from the joint's origin in the URDF to that of the body's frame
    shift = 2 * dot(h, o)[..., None, None] * IDENTITY - outer(h, o) - outer(o, h)
    inertia = inertia + shift + point_mass_inertia(m[..., None, None], o)
    return with_moments(model, Moments(m, h + m[..., None] * o, inertia))


@of_either
def with_parameters(model: Model, parameters: ArrayLike) -> Model:
    """Robot with other masses, centres of mass and inertias.

    Returns a Robot for a Robot. Parameters and errors are those of `rne.Robot.with_parameters`, with the model first.
    """
    pi = real_array("parameters", parameters, f"({PARAMETERS * model.nb},), ten per body").astype(np.float64)
    rows = pi.reshape(model.nb, PARAMETERS)
    mass, moment = rows[:, 0], rows[:, 1:4]
    for i in np.flatnonzero((mass == 0) & moment.any(axis=1)):
        raise ValueError(f"`parameters`: the body of joint {model.moving_joints[i]!r} has a first moment and no mass")
    centre = moment / np.where(mass == 0, 1.0, mass)[:, None]
    inertia = rows[:, 4:].take(ENTRIES, -1) - point_mass_inertia(mass[:, None, None], centre)
    return replace(model, mass=mass, com=centre + model.joint_origin, inertia=inertia, notes={})


def with_fewest_terms(model: Model) -> Model:
    """Model for dynamics only, with every inertial parameter moved towards the base where that is possible.

    Torques, M and accelerations are the same in every state, with fewer terms; energies and joint wrenches are not.
    The regrouping of Gautier and Khalil 1990, joint by joint: a mass on the axis of a rotating joint moves with the
    bodies on both sides of it, and a sliding joint does not change how an inertia rotates, so each can be counted with
    the parent. Of ten parameters a body keeps seven after a rotating joint and four after a sliding one; what reaches
    the base is dropped. Moments may differ from state to state.
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
    """Moments of the bodies one after another, shape (..., 10 nb): masses, first moments, inertias."""
    m, h, inertia = model.moments
    leading = m.shape[:-1]
    return np.concatenate([m, h.reshape(*leading, -1), inertia[..., ROWS, COLUMNS].reshape(*leading, -1)], axis=-1)


def moments_of_vector(vector: Array) -> Moments:
    """Moments of bodies from the vector of `moments_as_vector`, which may be traced."""
    leading, nb = vector.shape[:-1], vector.shape[-1] // PARAMETERS
    m, h, products = vector[..., :nb], vector[..., nb : 4 * nb], vector[..., 4 * nb :]
    inertia = products.reshape(*leading, nb, 6).take(ENTRIES, -1)
    return Moments(m, h.reshape(*leading, nb, 3), inertia)


def perpendicular(b: Array) -> Array:
    """Unit vector perpendicular to b: along a frame axis if b is."""
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
