"""How well a motion excites the base parameters: condition number and determinant, with exact gradients."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..dynamics.regressor import regressor
from ..model.standard_parameters import StandardParameters
from ..robot import Robot

States = tuple[Array, Array, Array]  # q, qd, qdd of shape (K, n) each


class Slopes(NamedTuple):
    """Derivatives of a number by q, qd and qdd at each sample, shape (K, n) each."""

    q: Array
    qd: Array
    qdd: Array


class Observation:
    """The matrix W of a motion's samples: rows are torques over their noise, columns are base parameters.

    Parameters
    ----------
    robot : Robot
        The robot.
    standard : StandardParameters
        What the torques are linear in.
    columns : ndarray of int
        Those of `standard` that are linearly independent.
    noise : ndarray, shape (n,)
        Standard deviation of each torque, or its relative size.
    """

    def __init__(self, robot: Robot, standard: StandardParameters, columns: Array, noise: Array) -> None:
        self.robot, self.standard, self.columns, self.noise = robot, standard, columns, noise

    def matrix(self, states: States) -> Array:
        """W, shape (..., K n, number of columns)."""
        Y = full_regressor(self.robot, self.standard, states)[..., self.columns] / self.noise[:, None]
        return Y.reshape(*Y.shape[:-3], -1, len(self.columns))

    def slopes(self, states: States, G: Array) -> Slopes:
        """Derivatives of a function of W, given its derivatives G by the entries of W.

        Coulomb friction without smoothing has the derivative zero, which it has everywhere but at rest.
        """
        K, n = states[0].shape
        full = np.zeros((K, n, self.standard.count))
        full[..., self.columns] = G.reshape(K, n, -1) / self.noise[:, None]
        bodies = self.standard.groups["bodies"]
        dY = self.robot.kernel(regressor, "q", "qd", "qdd")(*states)
        found = (full[..., bodies].reshape(K, 1, -1) @ dY.reshape(K, -1, 3 * n))[:, 0]
        q, qd, qdd = (found[:, n * k : n * (k + 1)] for k in range(3))
        for name, group in self.standard.groups.items():
            symbol, shafts = name.split(" ")[0], self._shafts(name)
            if symbol not in ("Ia", "Fv", "Fc"):
                continue
            torque = np.einsum("kni,in->ki", full[..., group], shafts)
            if symbol == "Ia":
                qdd = qdd + torque @ shafts
            else:
                qd = qd + (torque * (1.0 if symbol == "Fv" else self._sign_slope(states[1] @ shafts.T))) @ shafts
        return Slopes(q, qd, qdd)

    def _shafts(self, group: str) -> Array:
        return np.asarray(self.standard.shafts) if group.endswith("shafts") else np.eye(self.robot.n)

    def _sign_slope(self, rate: Array) -> Array:
        width = self.standard.smoothing
        slope: Array = (1 - np.tanh(rate / width) ** 2) / width if width else np.zeros_like(rate)
        return slope


def full_regressor(robot: Robot, standard: StandardParameters, states: States) -> Array:
    """Torques of the drives per unit of each standard parameter, shape (..., n, count)."""
    return np.concatenate([robot.regressor(*states), standard.drive_columns(*states[1:])], axis=-1)


class Condition:
    """log of the condition number, the spectral norm being replaced by Schatten's of order p.

    The largest and the smallest singular value have no derivative where two of them meet, as they do at the optimum.
    (sum of s^p)^(1/p) and (sum of s^-p)^(1/p) have one, and exceed the condition number by a factor of at most
    (number of columns)^(2/p).

    Parameters
    ----------
    p : float
        Order of the norm; infinity for the condition number itself.
    scaled : bool
        True to divide each column of W by its norm first.
    """

    def __init__(self, p: float = np.inf, scaled: bool = False) -> None:
        self.p, self.scaled = p, scaled

    def value(self, W: Array) -> float:
        """The value at W."""
        W = W / np.linalg.norm(W, axis=0) if self.scaled else W
        s = np.linalg.svd(W, compute_uv=False)
        value = np.log(s[0] / s[-1])
        if np.isfinite(self.p):
            value += (np.log(((s / s[0]) ** self.p).sum()) + np.log(((s[-1] / s) ** self.p).sum())) / self.p
        return float(value)

    def gradient(self, W: Array) -> Array:
        """Derivatives by the entries of W, of its shape."""
        D = np.linalg.norm(W, axis=0) if self.scaled else np.ones(W.shape[1])
        W = W / D
        U, s, Vt = np.linalg.svd(W, full_matrices=False)
        p = self.p if np.isfinite(self.p) else 1e6  # picks the two extreme values
        large, small = (s / s[0]) ** p, (s[-1] / s) ** p
        G: Array = U * ((large / large.sum() - small / small.sum()) / s) @ Vt  # ds = u^T dW v
        return (G - W * (W * G).sum(0)) / D if self.scaled else G


class Determinant:
    """-log det(W^T W) / number of columns: the log of the volume of the confidence ellipsoid, per parameter."""

    def value(self, W: Array) -> float:
        """The value at W."""
        s = np.linalg.svd(W, compute_uv=False)
        return float(-2 * np.log(s).mean())

    def gradient(self, W: Array) -> Array:
        """Derivatives by the entries of W, of its shape."""
        U, s, Vt = np.linalg.svd(W, full_matrices=False)
        G: Array = U * (-2 / len(s) / s) @ Vt
        return G
