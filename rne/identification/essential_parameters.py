"""Essential parameters: the base parameters that are well identified, and what a model of them alone loses.

Backward elimination by relative standard errors (Pressé and Gautier 1991; Gautier, Janot and Vandanjon 2013, section
III): the base parameter with the largest one is set to zero and the others are fitted again, until none is above a
limit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..basics.text import InNotebooks, Row, aligned, counted, short
from ..dynamics.base_inertial_parameters import BaseParameters
from .fit.equations import Equations, RegressionData, solve
from .fit.least_squares import LeastSquares, Unexplained, held_out, least_squares, with_correlation


class _Reduced(NamedTuple):
    """Least squares of standard parameters E z, as an Estimator."""

    E: Array

    def fit(self, equations: Equations) -> tuple[LeastSquares, Array]:
        estimate = least_squares(equations.mapped(self.E))
        return estimate, self.E @ estimate.values


@dataclass(frozen=True, eq=False)
class EssentialParameters(InNotebooks):
    """The base parameters that a log determines well, by `Identification.essential_parameters`.

    Attributes
    ----------
    names : tuple of str
        Of the base parameters that are kept; the others are zero.
    values, errors : ndarray, shape (k,)
        Estimates by least squares and their standard errors.
    unexplained : Unexplained
        |predicted - measured| / |measured| of each joint on held-out blocks with these parameters.
    all_unexplained : Unexplained
        The same with all base parameters.
    joint_names : tuple of str
        Of the joints.
    total : int
        Number of all base parameters.
    """

    names: tuple[str, ...]
    values: Array
    errors: Array
    unexplained: Unexplained
    all_unexplained: Unexplained
    joint_names: tuple[str, ...]
    total: int

    def __repr__(self) -> str:
        lost = 100 * np.nanmax(self.unexplained.in_motion - self.all_unexplained.in_motion, initial=0)
        rise = f"with these alone held-out errors rise by up to {lost:.2g} %" if lost >= 0.005 else "none is missed"
        return f"{len(self.names)} of {counted(self.total, 'base parameter')} are essential: {rise}"

    def report(self) -> str:
        """The parameters with their relative standard errors, and what each joint loses on held-out blocks.

        Returns
        -------
        str
            Two tables.
        """
        rows = [Row("essential parameters", ("value", "standard error", "of the value [%]"), words=True)]
        for name, x, error in zip(self.names, self.values, self.errors, strict=True):
            rows.append(Row(f"  {name}", (f"{x:.5f}", f"{error:.5f}", f"{100 * error / abs(x):.2g}")))
        lost = [Row("held out in motion [%]", ("all", "essential"), words=True)]
        shares = zip(self.joint_names, self.all_unexplained.in_motion, self.unexplained.in_motion, strict=True)
        lost += [Row(f"  {short(name)}", (f"{100 * a:.2f}", f"{100 * b:.2f}")) for name, a, b in shares]
        return "\n".join([repr(self), *aligned(rows), *aligned(lost)])


def essential_parameters(
    base: BaseParameters,
    data: RegressionData,
    estimate: LeastSquares,
    correlation_time: Array,
    joint_names: tuple[str, ...],
    limit: float,
) -> EssentialParameters:
    """Eliminate base parameters until all relative standard errors are at most `limit`; the noise is that of all."""
    kept, every = list(range(base.count)), data.fitted.merged().mapped(base.back)
    while True:
        equations = Equations(every.factors[..., [*kept, -1]], every.rows)
        solution = solve(equations.weighted(estimate.sigma))
        x, unknown = solution.x, np.where(solution.free, np.inf, 0.0)
        of_kept = replace(estimate, values=x, errors=unknown, covariance=np.zeros((len(kept), len(kept))))
        found = with_correlation(of_kept, equations, correlation_time)
        relative = found.errors / np.maximum(np.abs(x), np.finfo(float).tiny)
        if relative.max(initial=0) <= limit:
            break
        kept.pop(int(relative.argmax()))
    fits = _Reduced(base.back[:, kept]), _Reduced(base.back)
    reduced, full = (held_out(fit, data.fitted, data.measured) for fit in fits)
    names = tuple(base.names[k] for k in kept)
    return EssentialParameters(names, x, found.errors, reduced, full, joint_names, base.count)
