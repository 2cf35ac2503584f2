"""Physically consistent fit: least squares over bodies with a possible mass distribution.

minimise 1/2 |R x - b|^2 + w sum over bodies of (tr(P0^-1 P) - log det(P0^-1 P) - 4)

over the bodies' pseudo-inertias P, which log det keeps positive definite, and over drives whose inertia and friction
are not negative. The second term is the log-det divergence from a prior P0 (Lee, Wensing and Park 2020): it decides
where the motion is not informative, and does not depend on units and frames. With P = L X L^T and P0 = L L^T each body
is a matrix X near the identity; log det X is the largest sum of log Z_ii with [[X, Z], [Z^T, diag Z]] positive
semidefinite and Z lower triangular (Ben-Tal and Nemirovski 2001, section 4.2). Clarabel solves the cone programme to a
small gap of its objective, which is flat because of log det: half of the digits of the bodies are then correct. The
minimum is smooth inside the cone, and a few Newton steps find the other digits.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...basics.inertia import PARAMETERS, parameters_of_pseudo_inertia, pseudo_inertia
from ...basics.spatial import Array
from ...dynamics.base_inertial_parameters import BaseParameters
from ...errors import IdentificationError
from ...model.model import Model
from ...robot import Robot
from .. import thresholds
from .equations import Equations

LOWER = [(i, j) for i in range(4) for j in range(i + 1)]  # entries of X and of Z, in the order of their variables
DIAGONAL = [k for k, (i, j) in enumerate(LOWER) if i == j]
ENTRIES = len(LOWER)
TRACE = np.isin(range(ENTRIES), DIAGONAL).astype(float)  # coefficients of tr X in the entries of X
UNITS = np.zeros((ENTRIES, 4, 4))  # symmetric basis matrices of the entries of X
for k, (i, j) in enumerate(LOWER):
    UNITS[k, i, j] = UNITS[k, j, i] = 1
ROOT_2 = np.sqrt(2.0)

Objective = Callable[[Array], float]
Slopes = Callable[[Array], tuple[Array, Array]]  # gradient and Hessian


def consistent_fit(factor: Array, prior: Array, weight: float, bounded: Array, size: Array) -> Array:
    """Best-fitting physically consistent standard parameters.

    `factor` is triangular, of the weighted equations [R b] of the standard parameters; `prior` has pseudo-inertias P0,
    positive definite, of shape (nb, 4, 4), `weight` is the weight of the divergence from it; `bounded` drives may not
    be negative, `size` is their typical size.
    """
    factor = factor[:-1]  # the last row is the residual norm
    scale = scaling(prior, size)
    R, b, nb = factor[:, :-1] @ scale, factor[:, -1], len(prior)
    like_prior = np.append(np.tile(TRACE, nb), np.zeros(len(size)))  # X = 1, drives zero
    by_cones, status = cone_solution(R, b, weight * like_prior, bounded)
    least = -thresholds.CONE_GAP * max(1.0, np.abs(b).max(initial=0))
    held, start = ENTRIES * nb + np.flatnonzero(bounded), inside(by_cones, nb)
    for first in (0, thresholds.PATH):  # from there; or, where that is far from the minimum, along the central path
        for w in weight * 10.0 ** np.arange(first, -1, -1):
            y = at_minimum(*barrier_objective(R, b, w, nb), start, held, thresholds.CONE_GAP * w, least)
            start = start if y is None else y
        if y is not None:
            return np.asarray(scale @ y)
        start = like_prior
    raise IdentificationError(
        f"no physically consistent bodies were found (Clarabel: {status}); check the signs and units of the torques"
    )


def inside(y: Array, nb: int) -> Array:
    """Entries with positive definite matrices X, corrected for a solver's rounding."""
    own, found = np.s_[: ENTRIES * nb], np.nan_to_num(y, posinf=0.0, neginf=0.0)
    values, axes = np.linalg.eigh(np.tensordot(found[own].reshape(nb, -1), UNITS, 1))
    X = (axes * np.maximum(values, thresholds.INSIDE)[:, None]) @ np.swapaxes(axes, 1, 2)
    found[own] = X[:, *zip(*LOWER, strict=True)].ravel()
    return found


def at_minimum(
    objective: Objective, slopes: Slopes, start: Array, bounded: Array, gap: float, least: float
) -> Array | None:
    """Minimum near a start to within a gap, with nonnegative `bounded` entries; None if not reached.

    An entry at its bound is held there while its derivative is at least `least`.
    """
    y, held = start.copy(), set(bounded[start[bounded] < thresholds.AT_BOUND].tolist())
    for _ in range(thresholds.BOUND_ROUNDS):
        free = np.ones(len(y), bool)
        free[list(held)] = False
        y[~free] = 0.0
        if not np.isfinite(objective(y)):
            break
        y, gradient, decrement = refined(objective, slopes, y, free)
        beyond = {k for k in bounded.tolist() if y[k] < 0}
        pulled = {k for k in held if gradient[k] < least}
        if not beyond and not pulled and decrement <= gap:
            return y
        held = (held | beyond) - pulled
    return None


def scaling(prior: Array, size: Array) -> Array:
    """Matrix of (pi, drives) = scaling (X, drives / size), with P = L X L^T of each body."""
    nb = len(prior)
    matrix = np.zeros((PARAMETERS * nb + len(size), ENTRIES * nb + len(size)))
    for k, L in enumerate(np.linalg.cholesky(prior)):
        own = slice(ENTRIES * k, ENTRIES * (k + 1))
        bodies = (L @ UNITS @ L.T)[:, None]
        matrix[PARAMETERS * k : PARAMETERS * (k + 1), own] = parameters_of_pseudo_inertia(bodies).T
    matrix[PARAMETERS * nb :, ENTRIES * nb :] = np.diag(size)
    return matrix


def cone_solution(R: Array, b: Array, trace: Array, bounded: Array) -> tuple[Array, str]:
    """Minimum by Clarabel, to a small gap of the objective, and its status; `trace` @ y is w times tr X.

    Variables are the entries of X, the drives, the entries of Z, four log Z_ii per body, and the residual R y - b; the
    objective is 1/2 |residual|^2 + w (tr X - sum of the log Z_ii).
    """
    try:
        import clarabel
    except ModuleNotFoundError:
        raise ImportError(
            "the physically consistent fit needs Clarabel, which is not installed: pip install 'rne[identify]'"
        ) from None
    from scipy import sparse

    nb = (R.shape[1] - len(bounded)) // ENTRIES
    counts = [ENTRIES * nb, len(bounded), ENTRIES * nb, len(DIAGONAL) * nb, len(b)]
    X, drives, Z, log, residual = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
    unit = np.eye(sum(counts))  # rows that pick a variable
    cones = [(clarabel.ZeroConeT(len(b)), unit[residual] - np.pad(R, ((0, 0), (0, len(unit) - R.shape[1]))), -b)]
    if bounded.any():
        held = drives[bounded]
        cones.append((clarabel.NonnegativeConeT(len(held)), -unit[held], np.zeros(len(held))))
    for k in range(nb):
        own = slice(ENTRIES * k, ENTRIES * (k + 1))
        cones.append((clarabel.PSDTriangleConeT(8), -block_matrix(unit[X[own]], unit[Z[own]]), np.zeros(36)))
        for place, d in zip(log[len(DIAGONAL) * k :], DIAGONAL, strict=False):  # exp(log Z_ii) <= Z_ii
            rows = np.array([unit[place], np.zeros(len(unit)), unit[Z[own][d]]])
            cones.append((clarabel.ExponentialConeT(), -rows, np.array([0.0, 1.0, 0.0])))
    linear, quadratic = np.zeros(len(unit)), np.zeros(len(unit))
    linear[: R.shape[1]], linear[log], quadratic[residual] = trace, -trace.max(initial=0), 1
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    kinds, A, c = zip(*cones, strict=True)
    P, A = sparse.diags(quadratic).tocsc(), sparse.csc_matrix(np.concatenate(A))
    found = clarabel.DefaultSolver(P, linear, A, np.concatenate(c), kinds, settings).solve()
    return np.array(found.x)[: R.shape[1]], str(found.status)


def block_matrix(X: Array, Z: Array) -> Array:
    """[[X, Z], [Z^T, diag Z]] of rows that pick the entries of X and Z: its upper triangle, column by column."""
    dense = np.zeros((8, 8, X.shape[1]))
    for k, (i, j) in enumerate(LOWER):
        dense[i, j] = dense[j, i] = X[k]
        dense[i, 4 + j] = Z[k]
        if i == j:
            dense[4 + i, 4 + i] = Z[k]
    return np.array([dense[i, j] * (1 if i == j else ROOT_2) for j in range(8) for i in range(j + 1)])


def barrier_objective(R: Array, b: Array, w: float, nb: int) -> tuple[Objective, Slopes]:
    """Objective 1/2 |R y - b|^2 + w sum (tr X - log det X) of y = (entries of nb X, drives), and its derivatives."""

    def bodies(y: Array) -> Array:
        return np.asarray(np.tensordot(y[: ENTRIES * nb].reshape(nb, -1), UNITS, 1))

    def objective(y: Array) -> float:
        X = bodies(y)
        if np.linalg.eigvalsh(X).min(initial=np.inf) <= 0:
            return float("inf")  # outside the cone
        barrier = np.trace(X, axis1=1, axis2=2).sum() - np.linalg.slogdet(X)[1].sum()
        return float(0.5 * ((R @ y - b) ** 2).sum() + w * barrier)

    def slopes(y: Array) -> tuple[Array, Array]:
        gradient, hessian = R.T @ (R @ y - b), R.T @ R
        for k, inverse in enumerate(np.linalg.inv(bodies(y))):
            own = slice(ENTRIES * k, ENTRIES * (k + 1))
            turned = inverse @ UNITS
            gradient[own] += w * np.trace(UNITS - turned, axis1=1, axis2=2)
            hessian[own, own] += w * np.einsum("kab,lba->kl", turned, turned)
        return gradient, hessian

    return objective, slopes


def refined(objective: Objective, slopes: Slopes, start: Array, free: Array) -> tuple[Array, Array, float]:
    """Minimum by Newton's method over the free entries of y, from a start inside the cone.

    With the gradient there, and the decrement, twice the estimated gap to the minimum.
    """
    y, decrement, lengths = start.copy(), np.inf, 0.5 ** np.arange(thresholds.STEP_HALVINGS)
    for _ in range(thresholds.NEWTON_STEPS):
        gradient, hessian = slopes(y)
        step = np.zeros(len(y))
        step[free] = -np.linalg.lstsq(hessian[np.ix_(free, free)], gradient[free], rcond=None)[0]
        decrement = float(-gradient @ step)
        value, least = objective(y), thresholds.SUFFICIENT * decrement
        length = next((a for a in lengths if objective(y + a * step) <= value - a * least), 0.0)
        y = y + length * step
        if decrement <= thresholds.CONVERGED or length == 0:
            break
    return y, slopes(y)[0], decrement


def model_prior(robot: Robot) -> tuple[Array, tuple[str, ...]]:
    """Positive definite pseudo-inertias of bodies, (nb, 4, 4), and joints whose bodies were made thicker."""
    model, given, guess = robot.model, pseudo_inertia(robot.parameters), geometric_prior(robot.model)
    mean = model.mass.mean() if model.mass.any() else 1.0
    mass = np.where(model.mass > 0, model.mass, thresholds.ADDED * mean)
    guess = guess / guess[:, 3:, 3:] * mass[:, None, None]
    prior, changed = given.copy(), []
    for i, name in enumerate(model.moving_joints):
        L = np.linalg.inv(np.linalg.cholesky(guess[i]))
        thinnest = np.linalg.eigvalsh(L @ given[i] @ L.T)[0]
        if thinnest < thresholds.DEGENERATE:
            prior[i] = given[i] + (thresholds.ADDED - thinnest) * guess[i]
            changed.append(name)
    return prior, tuple(changed)


def sizes_of_parameters(P: Array, shortest: float = 0.0) -> Array:
    """Sizes of the ten parameters of bodies with the mass and extent of pseudo-inertias P, at least `shortest` [m]."""
    mass, second = P[:, 3, 3], np.trace(P[:, :3, :3], axis1=1, axis2=2)
    second = np.maximum(second, mass * shortest**2) if shortest else second
    first = np.sqrt(mass * second)
    return np.column_stack([mass, *[first] * 3, *[second] * 6])


def expected_sizes(P: Array, base: BaseParameters, equations: Equations) -> Array:
    """Expected sizes of base parameters: of bodies like these, and of drives that need a tenth of the torque.

    The pseudo-inertias P are infinite if nothing is known of the bodies; equations are those of standard parameters.
    """
    bodies = sizes_of_parameters(P)
    columns = np.sqrt((equations.columns[..., bodies.size : -1] ** 2).sum((0, 2)))  # joints, drives
    shares = (columns / np.maximum(np.sqrt(equations.torques()), thresholds.TINY)[:, None]).max(0, initial=0)
    drives = np.divide(thresholds.SHARE_OF_DRIVES, shares, out=np.zeros(len(shares)), where=shares > 0)
    shown = np.where(base.matrix[:, : bodies.size] == 0, 0.0, bodies.ravel())
    of_bodies = np.linalg.norm(base.matrix[:, : bodies.size] * shown, axis=1)
    kept = np.array(base.independent, int)
    return np.asarray(np.where(kept < bodies.size, of_bodies, np.append(np.zeros(bodies.size), drives)[kept]))


def geometric_prior(model: Model) -> Array:
    """Pseudo-inertias of rods from each joint to the next, of uniform line density and a total mass of 1 kg."""
    ends = [body_ends(model, i) for i in range(model.nb)]
    lengths = [np.linalg.norm(end, axis=1) for end in ends]
    known = np.concatenate(lengths)[np.concatenate(lengths) > 0]
    shortest = thresholds.SHORTEST * (known.mean() if len(known) else thresholds.GUESSED_LENGTH)
    each = [rods(end, np.maximum(length, shortest)) for end, length in zip(ends, lengths, strict=True)]
    bodies = np.array(each).reshape(-1, 4, 4)
    return np.asarray(bodies / max(bodies[:, 3, 3].sum(), thresholds.TINY))


def body_ends(model: Model, i: int) -> Array:
    """End points of body i relative to its joint's origin: the next joints and its further links."""
    origin = model.joint_origin[i]
    children = [j for j in range(model.nb) if model.parent[j] == i]
    joints = [model.translation[j] + model.rotation[j] @ model.joint_origin[j] for j in children]
    links = [p for p, body in zip(model.link_translation, model.link_body, strict=True) if body == i]
    points = np.array([p - origin for p in (joints or links)]).reshape(-1, 3)
    return points if len(points) else np.zeros((1, 3))


def rods(ends: Array, lengths: Array) -> Array:
    """Pseudo-inertia of rods from the origin to points, of unit density per length."""
    total = np.zeros((4, 4))
    total[:3, :3] = (lengths * ends.T) @ ends / 3 + (thresholds.THICKNESS**2 * lengths**3).sum() * np.eye(3)
    total[:3, 3] = total[3, :3] = lengths @ ends / 2
    total[3, 3] = lengths.sum()
    return total
