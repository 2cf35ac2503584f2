"""How well a motion excites the base parameters: condition number and determinant, with exact gradients."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ...basics.spatial import Array
from ...dynamics.base_inertial_parameters import BaseParameters
from ...dynamics.quantity import PrecisionStatus, Quantity
from ...dynamics.regressors import regressor
from ...model.model import Model
from ...robot import Robot

States = tuple[Array, Array, Array]  # q, qd, qdd of shape (K, n) each


class Slopes(NamedTuple):
    """Derivatives of a number by q, qd and qdd at each sample, shape (K, n) each."""

    q: Array
    qd: Array
    qdd: Array


@dataclass(frozen=True)
class RegressorColumns:
    """Some columns of `rne.dynamics.regressor` as a quantity of its own, whose kernel computes no others.

    Attributes
    ----------
    columns : tuple of int
    """

    columns: tuple[int, ...]

    @property
    def quantity(self) -> Quantity:
        """That of the regressor, with another core."""
        return replace(regressor.quantity, core=self.core)

    def core(self, model: Model, q: Array, qd: Array, qdd: Array) -> Array:
        """The columns, shape (..., n, number of columns)."""
        columns: Array = regressor.core(model, q, qd, qdd)[..., list(self.columns)]
        return columns

    def evaluate(self, model: Model, *args: Any, **kwargs: Any) -> tuple[Any, PrecisionStatus]:
        """The columns of the function itself."""
        Y, verdict = regressor.evaluate(model, *args, **kwargs)
        return Y[..., list(self.columns)], verdict


class Observation:
    """The matrix W of a motion's samples: rows are torques over their noise, columns are base parameters.

    Parameters
    ----------
    robot : Robot
        The robot.
    base : BaseParameters
        Its base parameters, those of the bodies before those of the drives.
    noise : ndarray, shape (n,)
        Standard deviation of each torque, or its relative size.
    """

    def __init__(self, robot: Robot, base: BaseParameters, noise: Array) -> None:
        self.robot, self.base, self.standard, self.noise = robot, base, base.standard, noise
        first = self.standard.groups["bodies"].stop
        self.bodies = RegressorColumns(tuple(k for k in base.independent if k < first))
        self.drives = [k - first for k in base.independent if k >= first]

    def matrix(self, states: States) -> Array:
        """W, shape (..., K n, number of base parameters)."""
        bodies = self.robot.kernel(self.bodies)(*states)
        drives = self.standard.drive_columns(*states[1:])[..., self.drives]
        Y = np.concatenate([bodies, drives], axis=-1) / self.noise[:, None]
        return Y.reshape(*Y.shape[:-3], -1, self.base.count)

    def slopes(self, states: States, G: Array) -> Slopes:
        """Derivatives of a function of W, given its derivatives G by the entries of W.

        Coulomb friction without smoothing has the derivative zero, which it has everywhere but at rest.
        """
        K, n = states[0].shape
        by_columns = G.reshape(K, n, -1) / self.noise[:, None]
        bodies, drives = np.split(by_columns, [len(self.bodies.columns)], axis=-1)
        dY = self.robot.kernel(self.bodies, "q", "qd", "qdd")(*states)
        found = (bodies.reshape(K, 1, -1) @ dY.reshape(K, -1, 3 * n))[:, 0]
        by_rates, by_accelerations = self._drive_slopes(states, drives)
        q, qd, qdd = (found[:, n * k : n * (k + 1)] for k in range(3))
        return Slopes(q, qd + by_rates, qdd + by_accelerations)

    def _drive_slopes(self, states: States, G: Array) -> tuple[Array, Array]:
        """Those by qd and qdd of the drives' columns."""
        first, n = self.standard.groups["bodies"].stop, self.robot.n
        full = np.zeros((*states[0].shape, self.standard.count - first))
        full[..., self.drives] = G
        qd, qdd = np.zeros_like(states[0]), np.zeros_like(states[0])
        for name, group in self.standard.groups.items():
            if name == "bodies":
                continue
            shafts = np.asarray(self.standard.shafts) if name.endswith("shafts") else np.eye(n)
            torques = np.einsum("kni,in->ki", full[..., group.start - first : group.stop - first], shafts)
            if name.startswith("Ia"):
                qdd += torques @ shafts
            elif name.startswith("Fv"):
                qd += torques @ shafts
            elif name.startswith("Fc"):
                qd += (torques * self._sign_slope(states[1] @ shafts.T)) @ shafts
        return qd, qdd

    def _sign_slope(self, rate: Array) -> Array:
        width = self.standard.smoothing
        slope: Array = (1 - np.tanh(rate / width) ** 2) / width if width else np.zeros_like(rate)
        return slope


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

    def measure(self, W: Array) -> float:
        """The condition number."""
        return float(np.exp(self.value(W)))

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

    def measure(self, W: Array) -> float:
        """log det(W^T W)."""
        return float(-self.value(W) * W.shape[1])

    def gradient(self, W: Array) -> Array:
        """Derivatives by the entries of W, of its shape."""
        U, s, Vt = np.linalg.svd(W, full_matrices=False)
        G: Array = U * (-2 / len(s) / s) @ Vt
        return G
