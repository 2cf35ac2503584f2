"""What bodies are taken to be before anything is measured: those of a model, or a guess from the joints' places."""

from __future__ import annotations

import numpy as np

from ...basics.spatial import Array
from ...dynamics.base_inertial_parameters import BaseParameters
from ...model.model import Model
from ...model.parameters import parameters_of, pseudo_inertia
from .equations import Equations

THICKNESS = 0.2  # of a guessed body: standard deviation of its mass across its length, as a part of the length
SHORTEST = 0.1  # length of a guessed body without extent, as a part of the robot's mean distance between joints
DEGENERATE = 1e-3  # bodies of a model that are thinner than this in terms of the guess, in second moments, ...
ADDED = 1e-2  # ... get this part of it
SHARE_OF_DRIVES = 0.1  # of a joint's torque, that its rotor or friction is expected to take
UNIT = 1.0  # [m], of a robot whose joints are all at one point


def model_prior(model: Model) -> tuple[Array, tuple[str, ...]]:
    """Pseudo-inertias of the model's bodies, positive definite.

    Parameters
    ----------
    model : Model
        The robot's parameters.

    Returns
    -------
    prior : ndarray, shape (nb, 4, 4)
    changed : tuple of str
        Joints whose bodies are points, lines, sheets or impossible and were made thicker by some of the guess.
    """
    given, guess = pseudo_inertia(parameters_of(model)), geometric_prior(model)
    mean = model.mass.mean() if model.mass.any() else 1.0
    mass = np.where(model.mass > 0, model.mass, ADDED * mean)
    guess = guess / guess[:, 3:, 3:] * mass[:, None, None]
    prior, changed = given.copy(), []
    for i, name in enumerate(model.moving_joints):
        L = np.linalg.inv(np.linalg.cholesky(guess[i]))
        thinnest = np.linalg.eigvalsh(L @ given[i] @ L.T)[0]
        if thinnest < DEGENERATE:
            prior[i] = given[i] + (ADDED + max(-thinnest, 0)) * guess[i]
            changed.append(name)
    return prior, tuple(changed)


def expected_sizes(P: Array, base: BaseParameters, equations: Equations) -> Array:
    """How large base parameters may be: of bodies like these, and of drives that take a tenth of the torque.

    Parameters
    ----------
    P : ndarray, shape (nb, 4, 4)
        Pseudo-inertias of the bodies; infinite if nothing is known of them.
    base : BaseParameters
    equations : Equations
        Of the standard parameters.

    Returns
    -------
    ndarray, shape (base.count,)
    """
    mass, second = P[:, 3, 3], np.trace(P[:, :3, :3], axis1=1, axis2=2)
    first = np.sqrt(mass * second)
    bodies = np.concatenate([mass[:, None], np.repeat(first[:, None], 3, 1), np.repeat(second[:, None], 6, 1)], axis=1)
    columns = np.sqrt((equations.factors[..., bodies.size : -1] ** 2).sum((0, 2)))  # joints, drives
    shares = (columns / np.maximum(np.sqrt(equations.torques()), np.finfo(float).tiny)[:, None]).max(0, initial=0)
    drives = np.divide(SHARE_OF_DRIVES, shares, out=np.zeros(len(shares)), where=shares > 0)
    shown = np.where(base.matrix[:, : bodies.size] == 0, 0.0, bodies.ravel())
    of_bodies = np.linalg.norm(base.matrix[:, : bodies.size] * shown, axis=1)
    kept = np.array(base.independent, int)
    sizes = np.where(kept < bodies.size, of_bodies, np.append(np.zeros(bodies.size), drives)[kept])
    return np.asarray(sizes)


def geometric_prior(model: Model) -> Array:
    """Pseudo-inertias of rods from each joint to the next, of one density per length and a total mass of 1 kg.

    Parameters
    ----------
    model : Model
        Whose masses are not looked at.

    Returns
    -------
    ndarray, shape (nb, 4, 4)
    """
    ends = [body_ends(model, i) for i in range(model.nb)]
    lengths = [np.linalg.norm(end, axis=1) for end in ends]
    known = np.concatenate(lengths)[np.concatenate(lengths) > 0]
    shortest = SHORTEST * (known.mean() if len(known) else UNIT)
    bodies = np.array([rods(end, np.maximum(length, shortest)) for end, length in zip(ends, lengths, strict=True)])
    bodies = bodies.reshape(-1, 4, 4)
    return np.asarray(bodies / max(bodies[:, 3, 3].sum(), np.finfo(float).tiny))


def body_ends(model: Model, i: int) -> Array:
    """Points that body i reaches from its joint's origin: the next joints and its further links."""
    origin = model.joint_origin[i]
    joints = [
        model.translation[j] + model.rotation[j] @ model.joint_origin[j]
        for j in range(model.nb)
        if model.parent[j] == i
    ]
    links = [p for p, body in zip(model.link_translation, model.link_body, strict=True) if body == i]
    points = np.array([p - origin for p in (joints or links)]).reshape(-1, 3)
    return points if len(points) else np.zeros((1, 3))


def rods(ends: Array, lengths: Array) -> Array:
    """Pseudo-inertia of rods from the origin to points, of unit density per length."""
    total = np.zeros((4, 4))
    for end, length in zip(ends, lengths, strict=True):
        total[:3, :3] += length * (np.outer(end, end) / 3 + (THICKNESS * length) ** 2 * np.eye(3))
        total[:3, 3] += length * end / 2
        total[3, :3] += length * end / 2
        total[3, 3] += length
    return total
