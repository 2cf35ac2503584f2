"""The physically consistent fit: least squares over bodies that some distribution of mass has.

minimise 1/2 |R x - b|^2 + w sum over bodies of (tr(P0^-1 P) - log det(P0^-1 P) - 4)

over the bodies' pseudo-inertias P, which log det keeps positive definite, and over drives whose inertia and friction
are not negative. The second term is the log-det divergence from a prior P0 (Lee, Wensing and Park 2020): it decides
where the motion says nothing, and does not depend on units and frames. With P = L X L^T and P0 = L L^T each body is a
matrix X near the identity. Its log det is a barrier: Newton's method follows the minimum from a large weight of the
logarithms down to w, and with the logarithm of each drive on to next to nothing (the barrier method; Boyd and
Vandenberghe 2004, section 11.3).
"""

from __future__ import annotations

import numpy as np

from ..basics.spatial import Array
from ..dynamics.base_inertial_parameters import BaseParameters
from ..errors import IdentificationError
from ..model.model import Model
from ..model.parameters import PARAMETERS, parameters_of, parameters_of_pseudo_inertia, pseudo_inertia
from .equations import Equations

LOWER = [(i, j) for i in range(4) for j in range(i + 1)]  # entries of X, in the order of their variables
ENTRIES = len(LOWER)
UNITS = np.zeros((ENTRIES, 4, 4))  # symmetric matrices that the entries of X multiply
for k, (i, j) in enumerate(LOWER):
    UNITS[k, i, j] = UNITS[k, j, i] = 1
IDENTITY = [float(i == j) for i, j in LOWER]
FACTOR = 30.0  # by which the weight falls from one minimisation to the next, about
LAST = 1e-11  # weight v of the drives' logarithms at the end, of that of the bodies, w
STEPS = 100  # of Newton's method, at most
CENTRED, CONVERGED = 1e-3, 1e-11  # decrement at which they end, per weight v or w
ATTEMPTS = 40  # halvings of a step
ROUNDING = 1e-13  # of a Hessian of unit diagonal
GAP = 1e-6  # of the objective to its minimum, per weight, above which the fit has failed
AT_BOUND = 1e-4  # of its usual size: a parameter of a drive below it is zero


def consistent_fit(factor: Array, prior: Array, weight: float, bounded: Array, size: Array) -> Array:
    """The standard parameters that fit best among the physically consistent ones.

    `factor` is triangular, of the weighted equations [R b] of the standard parameters; `prior` has pseudo-inertias P0,
    positive definite, of shape (nb, 4, 4), `weight` belongs to the divergence from it; `bounded` drives may not be
    negative, `size` is what they typically are.
    """
    scale, nb = scaling(prior, size), len(prior)
    problem = Barrier(factor[:-1, :-1] @ scale, factor[:-1, -1], nb, ENTRIES * nb + np.flatnonzero(bounded))
    y = np.concatenate([np.tile(IDENTITY, nb), np.ones(len(size))])
    first, last = max(weight, np.abs(problem.slopes(y, 0, 0)[0]).max(initial=0)), LAST * weight
    try:
        for of_drives in np.geomspace(first, last, 2 + int(np.log(first / last) / np.log(FACTOR))):
            y, decrement = problem.minimum(y, weight, of_drives)
    except np.linalg.LinAlgError:  # a body at the boundary of the cone, up to rounding
        decrement = np.inf
    if not decrement <= GAP * weight:
        raise IdentificationError(
            "no physically consistent bodies were found. With `consistent=False` the report says which parameters are "
            "negative or not excited; check signs and units of the torques, or give a larger `prior_std`"
        )
    y[problem.bounded] *= y[problem.bounded] > AT_BOUND
    return np.asarray(scale @ y)


def scaling(prior: Array, size: Array) -> Array:
    """The matrix of (pi, drives) = scaling (X, drives / size), with P = L X L^T of each body."""
    nb = len(prior)
    matrix = np.zeros((PARAMETERS * nb + len(size), ENTRIES * nb + len(size)))
    for k, L in enumerate(np.linalg.cholesky(prior)):
        own = slice(ENTRIES * k, ENTRIES * (k + 1))
        bodies = (L @ UNITS @ L.T)[:, None]
        matrix[PARAMETERS * k : PARAMETERS * (k + 1), own] = parameters_of_pseudo_inertia(bodies).T
    matrix[PARAMETERS * nb :, ENTRIES * nb :] = np.diag(size)
    return matrix


class Barrier:
    """1/2 |R y - b|^2 + sum (w tr X - max(v, w) log det X) + sum (min(v, w) d - v log d), y = (entries of X, drives).

    Each `bounded` entry d of y is a drive that may not be negative; there are nb bodies X.
    """

    def __init__(self, R: Array, b: Array, nb: int, bounded: Array) -> None:
        self.R, self.b, self.nb, self.bounded = R, b, nb, bounded
        self.hessian = R.T @ R

    def bodies(self, y: Array) -> Array:
        """The matrices X, shape (nb, 4, 4)."""
        return np.asarray(np.tensordot(y[: ENTRIES * self.nb].reshape(self.nb, -1), UNITS, 1))

    def value(self, y: Array, w: float, v: float) -> float:
        """The objective, inside the cone."""
        X, d = self.bodies(y), y[self.bounded]
        traces = w * np.trace(X, axis1=1, axis2=2).sum() + min(v, w) * d.sum()
        logs = max(v, w) * np.linalg.slogdet(X)[1].sum() + v * np.log(d).sum()
        return float(0.5 * ((self.R @ y - self.b) ** 2).sum() + traces - logs)

    def longest(self, y: Array, step: Array) -> float:
        """The part of a step, at most 1, that goes to a tenth of the distance from the boundary at most."""
        bodies = np.linalg.eigvals(np.linalg.solve(self.bodies(y), self.bodies(step))).real
        drives = step[self.bounded] / y[self.bounded]
        return float(min(1.0, 0.9 / max(-bodies.min(initial=0), -drives.min(initial=0), 0.9)))

    def slopes(self, y: Array, w: float, v: float) -> tuple[Array, Array]:
        """Gradient and Hessian."""
        gradient, hessian = self.R.T @ (self.R @ y - self.b), self.hessian.copy()
        for k, inverse in enumerate(np.linalg.inv(self.bodies(y))):
            own = slice(ENTRIES * k, ENTRIES * (k + 1))
            turned = inverse @ UNITS
            gradient[own] += np.trace(w * UNITS - max(v, w) * turned, axis1=1, axis2=2)
            hessian[own, own] += max(v, w) * np.einsum("kab,lba->kl", turned, turned)
        d = y[self.bounded]
        gradient[self.bounded] += min(v, w) - v / d
        hessian[self.bounded, self.bounded] += v / d**2
        return gradient, hessian

    def minimum(self, y: Array, w: float, v: float) -> tuple[Array, float]:
        """The minimum from a start inside the cone, and the decrement there, twice the estimated gap."""
        from scipy.linalg import cho_factor, cho_solve

        for _ in range(STEPS):
            gradient, hessian = self.slopes(y, w, v)
            scale = 1 / np.sqrt(np.maximum(np.diag(hessian), np.finfo(float).tiny))
            regular = hessian * np.outer(scale, scale) + ROUNDING * np.eye(len(y))
            step = -scale * cho_solve(cho_factor(regular), scale * gradient)
            decrement = float(-gradient @ step)
            if decrement <= max(CENTRED * v, CONVERGED * w):
                break
            value, lengths = self.value(y, w, v), self.longest(y, step) * 0.5 ** np.arange(ATTEMPTS)
            lower = (a for a in lengths if self.value(y + a * step, w, v) <= value - 1e-4 * a * decrement)
            length = next(lower, 0.0)
            y = y + length * step
            if length == 0:
                break
        return y, decrement


THICKNESS = 0.2  # of a guessed body: standard deviation of its mass across its length, as a part of the length
SHORTEST = 0.1  # length of a guessed body without extent, as a part of the robot's mean distance between joints
DEGENERATE = 1e-3  # bodies of a model that are thinner than this in terms of the guess, in second moments, ...
ADDED = 1e-2  # ... get this part of it
SHARE_OF_DRIVES = 0.1  # of a joint's torque, that its rotor or friction is expected to take
UNIT = 1.0  # [m], of a robot whose joints are all at one point


def model_prior(model: Model) -> tuple[Array, tuple[str, ...]]:
    """Pseudo-inertias of the model's bodies, positive definite, shape (nb, 4, 4).

    With the joints whose bodies are points, lines, sheets or impossible and were made thicker by some of the guess.
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

    The pseudo-inertias P are infinite if nothing is known of the bodies; equations are those of standard parameters.
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
    """Pseudo-inertias of rods from each joint to the next, of one density per length and a total mass of 1 kg."""
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
    children = [j for j in range(model.nb) if model.parent[j] == i]
    joints = [model.translation[j] + model.rotation[j] @ model.joint_origin[j] for j in children]
    links = [p for p, body in zip(model.link_translation, model.link_body, strict=True) if body == i]
    points = np.array([p - origin for p in (joints or links)]).reshape(-1, 3)
    return points if len(points) else np.zeros((1, 3))


def rods(ends: Array, lengths: Array) -> Array:
    """Pseudo-inertia of rods from the origin to points, of unit density per length."""
    total = np.zeros((4, 4))
    total[:3, :3] = (lengths * ends.T) @ ends / 3 + (THICKNESS**2 * lengths**3).sum() * np.eye(3)
    total[:3, 3] = total[3, :3] = lengths @ ends / 2
    total[3, 3] = lengths.sum()
    return total
