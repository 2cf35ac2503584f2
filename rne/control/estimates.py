"""Estimates of the inertial parameters of some bodies as states of a controller, and how they adapt."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..basics.spatial import Array, transpose, zeros
from ..model.parameters import PARAMETERS, dual_of_gradient, parameters_of_pseudo_inertia, pseudo_inertia
from ..robot import Robot

ROWS, COLUMNS = np.triu_indices(4)
SMALLEST = 1e-12  # eigenvalue, of the largest, of a pseudo-inertia that counts as positive definite


def can_adapt(robot: Robot) -> Array:
    """True for each body whose pseudo-inertia is positive definite, shape (nb,)."""
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(robot.parameters))
    return np.asarray(eigenvalues[:, 0] > SMALLEST * eigenvalues[:, -1])


def adapted_bodies(robot: Robot, bodies: Sequence[str] | None, *, required: bool) -> tuple[str, ...]:
    """Joints whose bodies are adapted, in the order of `model.moving_joints`; `required`: nothing else is adapted."""
    joints, possible = robot.model.moving_joints, can_adapt(robot)
    if bodies is None:
        if required and not possible.any():
            raise ValueError(
                "`robot` has nothing to adapt: the pseudo-inertia of none of its bodies is positive definite, and "
                "neither `viscous` nor `coulomb` is given"
            )
        return tuple(name for name, can in zip(joints, possible, strict=True) if can)
    if isinstance(bodies, str):
        raise ValueError(f"`bodies` must be a sequence of names of joints, got the string {bodies!r}")
    for name in bodies:
        if name not in joints:
            raise ValueError(f"`bodies` must name joints of {list(joints)}, got {name!r}")
        if not possible[joints.index(name)]:
            raise ValueError(
                f"`bodies`: the body of joint {name!r} cannot be adapted: its pseudo-inertia is not positive definite"
            )
    return tuple(name for name in joints if name in bodies)


class BodyEstimates:
    """Bodies by the pseudo-inertias P = L (1 + Z) L^T, where P0 = L L^T is that of the start.

    Parameters
    ----------
    start : ndarray, shape (10 nb,)
        Parameters of all bodies at the start.
    places : sequence of int
        Bodies that are adapted.
    gain : float
        Rate of adaptation [1/J].
    consistent : bool
        True for the metric at the estimate, False for that at the start.
    """

    def __init__(self, start: Array, places: Sequence[int], gain: float, consistent: bool) -> None:
        self.start, self.gain, self.consistent = start, gain, consistent
        self.columns = np.concatenate([np.arange(PARAMETERS) + PARAMETERS * i for i in places] or [np.zeros(0, int)])
        self.L = np.linalg.cholesky(pseudo_inertia(start[self.columns]))
        self.states = PARAMETERS * len(places)

    def deviations(self, z: Array) -> Array:
        """The symmetric matrices Z of the states, which are their upper triangles, shape (..., bodies, 4, 4)."""
        rows = z[..., : self.states].reshape(*z.shape[:-1], -1, PARAMETERS)
        Z = zeros((*rows.shape[:-1], 4, 4), like=z)
        Z[..., ROWS, COLUMNS] = rows
        Z[..., COLUMNS, ROWS] = rows
        return Z

    def parameters(self, z: Array) -> Array:
        """The parameters of all bodies."""
        change = self.L @ self.deviations(z) @ transpose(self.L)
        pi = zeros((*z.shape[:-1], len(self.start)), like=z) + self.start
        pi[..., self.columns] = pi[..., self.columns] + parameters_of_pseudo_inertia(change)
        return pi

    def rates(self, z: Array, slope: Array) -> Array:
        """dz/dt of Z' = -gain L^T S L, with S dual to Y^T s; consistent: -gain (1 + Z) L^T S L (1 + Z)."""
        S = dual_of_gradient(slope[..., self.columns])
        rate = -self.gain * (transpose(self.L) @ S @ self.L)
        if self.consistent:  # P' = -gain P S P, Lee, Kwon and Park 2018
            metric = np.eye(4) + self.deviations(z)
            rate = metric @ rate @ metric
        return np.asarray(rate[..., ROWS, COLUMNS].reshape(*z.shape[:-1], -1))

    def distance(self, z: Array, parameters: Array) -> Array:
        """What 1/gain times falls by tr(S (P_hat - P)): a Bregman divergence, or half a squared norm."""
        P = pseudo_inertia(parameters[self.columns])
        inverse = np.linalg.inv(self.L)
        relative = inverse @ P @ transpose(inverse)  # of the truth, in the axes of the estimates
        estimate = np.eye(4) + self.deviations(z)
        if not self.consistent:
            return np.asarray(((estimate - relative) ** 2).sum((-1, -2, -3)) / 2)
        ratio = np.linalg.solve(estimate, np.broadcast_to(relative, estimate.shape))
        _, logarithm = np.linalg.slogdet(ratio)
        return np.asarray((np.trace(ratio, axis1=-2, axis2=-1) - logarithm - 4).sum(-1))
