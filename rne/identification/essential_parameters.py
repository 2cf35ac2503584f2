"""Essential parameters: the base parameters that are well identified, and what a model of them alone loses.

Backward elimination by relative standard errors (Pressé and Gautier 1991; Gautier, Janot and Vandanjon 2013, section
III): the base parameter with the largest one is set to zero and the others are fitted again, until none is above a
limit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..basics.text import InNotebooks, Row, aligned, counted, short
from ..dynamics.base_inertial_parameters import BaseParameters
from .fit.equations import Equations, RegressionData
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
    """

    names: tuple[str, ...]
    values: Array
    errors: Array
    unexplained: Unexplained
    all_unexplained: Unexplained
    joint_names: tuple[str, ...]
    total: int

    def __repr__(self) -> str:
        worst = 100 * np.nanmax(self.unexplained.in_motion - self.all_unexplained.in_motion, initial=0)
        return f"{len(self.names)} of {counted(self.total, 'base parameter')} are essential, at a cost of {worst:.2g} %"

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
    base: BaseParameters, data: RegressionData, correlation_time: Array, joint_names: tuple[str, ...], limit: float
) -> EssentialParameters:
    """Eliminate base parameters until all relative standard errors are at most `limit`."""
    kept = list(range(base.count))
    while True:
        mapped = data.fitted.mapped(base.back[:, kept])
        estimate = with_correlation(least_squares(mapped), mapped, correlation_time)
        relative = estimate.errors / np.maximum(np.abs(estimate.values), np.finfo(float).tiny)
        if not kept or relative.max() <= limit:
            break
        kept.pop(int(relative.argmax()))
    both = [held_out(_Reduced(base.back[:, k]), data.fitted, data.measured) for k in (kept, range(base.count))]
    names = tuple(base.names[k] for k in kept)
    return EssentialParameters(names, estimate.values, estimate.errors, *both, joint_names, base.count)
