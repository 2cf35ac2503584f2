"""Base parameters: the fewest combinations of the standard parameters that joint torques depend on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, real_array
from ..basics.spatial import Array
from ..basics.text import InNotebooks, counted, listed, short, six_digits, wrapped
from ..model.model import Model, model_argument
from ..model.standard_parameters import StandardParameters
from .regressors import regressor
from .regrouping import regrouped

TOLERANCE = 1e-9  # angles and distances below it, of the robot's size, are roundings
COARSEST = 0.01  # a larger tolerance takes different robots for the same


@dataclass(frozen=True, eq=False, repr=False)
class BaseParameters(InNotebooks):
    """The combinations of the standard parameters that torques depend on, one for each parameter that is kept.

    Each is a kept parameter plus multiples of others that torques cannot tell from it. Those of each body are kept
    before those of the bodies that it carries, and the bodies' before those of drives. Y pi = (Y E) (B pi) in every
    state, with Y E the columns of Y that belong to the kept parameters.

    Attributes
    ----------
    standard : StandardParameters
        The standard parameters pi, their order and their names.
    independent : tuple of int, length count
        Places of the kept parameters among them.
    matrix : ndarray, shape (count, standard.count)
        B of beta = B pi.
    body_regressor : callable
        Gives the regressor of the bodies, as `rne.dynamics.regressor`.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot = rne.load("irb140")
    >>> base = robot.base_parameters()
    >>> base.count, base.names[:3], base.formulas[2]
    (36, ('Iyy_1', 'mcx_2', 'mcy_2'), 'mcy_2')
    """

    standard: StandardParameters
    independent: tuple[int, ...]
    matrix: Array
    body_regressor: Callable[..., Array]

    @property
    def count(self) -> int:
        """Number of base parameters."""
        return len(self.independent)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The kept parameter of each combination."""
        return tuple(self.standard.names[k] for k in self.independent)

    @cached_property
    def formulas(self) -> tuple[str, ...]:
        """Each combination written out, such as "Izz_1 + Iyy_2 + 0.0049 m_2", the kept parameter first."""
        return tuple(self._formula(k, row) for k, row in zip(self.independent, self.matrix, strict=True))

    def _formula(self, kept: int, row: Array) -> str:
        text = self.standard.names[kept]
        for k in np.flatnonzero(row):
            if k != kept:
                factor = six_digits(abs(row[k]))
                text += f" {'+' if row[k] > 0 else '-'} {'' if factor == '1' else factor + ' '}{self.standard.names[k]}"
        return text

    @cached_property
    def back(self) -> Array:
        """E with Y = Y E B in every state, and B E = 1; shape (standard.count, count).

        Its columns are unit vectors: E beta has the base parameters in the places of the kept ones, and zeros else.
        """
        E = np.zeros((self.standard.count, self.count))
        E[list(self.independent), range(self.count)] = 1
        return E

    @cached_property
    def values(self) -> Array:
        """The base parameters of the model; offsets and parameters of further shafts count as zero."""
        return np.asarray(self.matrix @ self.standard.values)

    def of(self, parameters: ArrayLike) -> Array:
        """The base parameters beta = B pi of standard parameters.

        Parameters
        ----------
        parameters : array_like, shape (..., standard.count)
            In the order of `standard.names`.

        Returns
        -------
        ndarray, shape (..., count)
            In the order of `names`.

        Raises
        ------
        ValueError
            If the shape is wrong.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> base = robot.base_parameters()
        >>> bool((base.of(robot.parameters) == base.values).all())
        True
        """
        pi = self._checked("parameters", parameters, self.standard.count)
        return np.asarray(pi @ self.matrix.T)

    def standard_parameters(self, beta: ArrayLike) -> Array:
        """Standard parameters with these base parameters: the kept ones, all others zero.

        They give the same torques as all others with the same base parameters, but are those of no possible bodies.

        Parameters
        ----------
        beta : array_like, shape (..., count)
            In the order of `names`.

        Returns
        -------
        ndarray, shape (..., standard.count)
            In the order of `standard.names`.

        Raises
        ------
        ValueError
            If the shape is wrong.

        Examples
        --------
        >>> import numpy as np, rne
        >>> base = rne.load("irb140").base_parameters()
        >>> np.allclose(base.of(base.standard_parameters(base.values)), base.values)
        True
        """
        values = self._checked("beta", beta, self.count)
        return np.asarray(values @ self.back.T)

    def _checked(self, name: str, value: ArrayLike, width: int) -> Array:
        array = real_array(name, value, f"(..., {width})")
        if array.shape[-1:] != (width,):
            raise ValueError(f"`{name}` must have shape (..., {width}), got {array.shape}")
        return array

    def regressor(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """The matrix Y E of tau = Y E beta: torques per unit of each base parameter.

        Parameters
        ----------
        q, qd, qdd : array_like, shape (..., n)
            Joint positions, rates and accelerations [rad or m; rad/s or m/s; rad/s^2 or m/s^2].

        Returns
        -------
        ndarray, shape (..., n, count)
            The columns `independent` of the regressor of the standard parameters.

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or an entry overflows.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot = rne.load("irb140")
        >>> base = robot.base_parameters()
        >>> q, qd, qdd = np.random.default_rng(0).normal(size=(3, 6))
        >>> np.allclose(base.regressor(q, qd, qdd) @ base.values, robot.inverse_dynamics(q, qd, qdd))
        True
        """
        bodies = self.body_regressor(*(np.asarray(x) for x in (q, qd, qdd)))
        drives = self.standard.drive_columns(np.asarray(qd), np.asarray(qdd))
        return np.asarray(np.concatenate([bodies, drives], axis=-1)[..., list(self.independent)])

    def __repr__(self) -> str:
        return wrapped(
            f"BaseParameters of '{short(self.standard.model.name)}': {self.count} combinations of "
            f"{counted(self.standard.count, 'standard parameter')}: {listed(self.names)}"
        )

    def __str__(self) -> str:
        return "\n".join(self.formulas)


def base_parameters(
    model: Model,
    *,
    rotor: bool = False,
    friction: str | None = None,
    offset: bool = False,
    shafts: ArrayLike | None = None,
    smoothing: float = 0.0,
    tolerance: float = TOLERANCE,
) -> BaseParameters:
    """The fewest combinations of inertial and drive parameters that joint torques depend on, by rules.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    rotor : bool
        True for the inertia Ia of each drive's rotor, reflected to its joint.
    friction : {None, "viscous", "coulomb", "viscous+coulomb"}
        Fv, Fc or both of each drive.
    offset : bool
        True for a constant torque tau0 of each drive.
    shafts : array_like, shape (s, n), optional
        Rows a of further shafts, which turn at a^T qd, with rotor and friction if the joints have them.
    smoothing : float
        Coulomb friction is Fc tanh(qd / smoothing); 0 for Fc sign(qd) [rad/s or m/s].
    tolerance : float
        Angles [rad] and distances, divided by the longest one between two joints, that differ by less are taken as the
        same. 1e-5 suits a file that has 1.5708 in place of pi / 2: what only such roundings make observable, no
        measurement finds. It must be below 0.01.

    Returns
    -------
    BaseParameters
        Their names, formulas, and the matrices to and from the standard parameters.

    Raises
    ------
    TypeError
        If `model` is no Model.
    ValueError
        If an option has a wrong value or shape.

    Notes
    -----
    They follow from the axes and places of the joints and the direction of gravity, not from its size, the masses or
    the limits, and no states are sampled at random, except for several coordinates that joints in different branches
    share. Gautier and Khalil 1990; Wensing, Niemeyer and Slotine 2024.

    Examples
    --------
    >>> import rne
    >>> rne.dynamics.base_parameters(rne.irb140()).count
    36
    >>> rne.dynamics.base_parameters(rne.irb140(), rotor=True).count
    40
    """
    standard = StandardParameters(model_argument(model), rotor, friction, offset, shafts, smoothing)
    if positive_number("tolerance", tolerance) >= COARSEST:
        raise ValueError(f"`tolerance` must be below {COARSEST}, got {tolerance!r}")
    kept, matrix = regrouped(standard, tolerance)
    return BaseParameters(standard, kept, matrix, partial(regressor, model))
