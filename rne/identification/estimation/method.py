"""How parameters are found from equations: least squares for base parameters, then the consistent fit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...basics.spatial import Array
from ...dynamics.base_inertial_parameters import BaseParameters
from ...model.parameters import PARAMETERS
from ...model.standard_parameters import StandardParameters
from .consistent import consistent_fit
from .equations import Equations, triangular
from .least_squares import LeastSquares, least_squares

HELD = 1e-4  # weight of the model's drives, of that of the measurements
LEAST_NOISE = 1e-3  # of the torques: the consistent fit does not take measurements for more exact than this


class Method(NamedTuple):
    """What is unknown, and what is known beforehand.

    Attributes
    ----------
    standard : StandardParameters
    base : BaseParameters
    prior : ndarray, shape (nb, 4, 4), or None
        Pseudo-inertias; None for least squares alone.
    weight : float
        Of the divergence from the prior.
    """

    standard: StandardParameters
    base: BaseParameters
    prior: Array | None
    weight: float

    def solved(self, equations: Equations) -> tuple[LeastSquares, Array]:
        """Base parameters, and standard parameters: consistent ones, or the nearest to the model's."""
        estimate = least_squares(equations.mapped(self.base.back))
        if self.prior is not None:
            return estimate, self.consistent(equations, estimate.sigma)
        model = self.standard.values
        return estimate, model + self.base.back @ (estimate.values - self.base.matrix @ model)

    def consistent(self, equations: Equations, sigma: Array) -> Array:
        """The physically consistent standard parameters."""
        size = np.sqrt(equations.torques() / np.maximum(equations.rows.sum(0), 1))
        factor = equations.merged().weighted(np.maximum(sigma, LEAST_NOISE * size))
        bodies = PARAMETERS * self.standard.model.nb
        lengths = np.linalg.norm(factor[:, bodies:-1], axis=0)
        factor = triangular(np.concatenate([factor, self.drives_of_the_model(lengths)]))
        bounded = np.array([not name.startswith("tau0") for name in self.standard.names[bodies:]], bool)
        assert self.prior is not None
        return consistent_fit(factor, self.prior, self.weight, bounded, 1 / np.where(lengths == 0, 1, lengths))

    def drives_of_the_model(self, lengths: Array) -> Array:
        """Equations that keep a drive as the model has it where the motion says nothing of it."""
        bodies = PARAMETERS * self.standard.model.nb
        known = np.maximum(self.standard.values[bodies:], 0)
        rows = np.zeros((len(lengths), self.standard.count + 1))
        weights = np.where(lengths == 0, 1.0, HELD * lengths)
        rows[:, bodies:-1], rows[:, -1] = np.diag(weights), weights * known
        return rows


def held_out(method: Method, fitted: Equations, measured: Equations) -> Array:
    """|predicted - measured| / |measured| of each joint, each block predicted from the others, shape (n,).

    NaN for a joint of which no torque was measured.
    """
    squares = np.zeros(fitted.joints)
    for k in range(len(fitted.factors)):
        others = np.arange(len(fitted.factors)) != k
        _, parameters = method.solved(fitted.of_blocks(others))
        squares += measured.of_blocks(~others).residuals(parameters)
    errors = np.sqrt(squares / np.maximum(measured.torques(), np.finfo(float).tiny))
    return np.where(measured.rows.sum(0) == 0, np.nan, errors)
