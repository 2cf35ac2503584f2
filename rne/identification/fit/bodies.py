"""Physically consistent bodies of a fit, close to those of a prior where the motion is not informative.

The prior is a robot, or a guess from the places of the joints whose density is found from the torques.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...basics.arrays import positive_number
from ...basics.inertia import PARAMETERS, parameters_of_pseudo_inertia
from ...basics.spatial import Array
from ...dynamics.base_inertial_parameters import BaseParameters
from ...errors import IdentificationError
from ...model.model import Model
from ...robot import Robot
from .. import thresholds
from .consistent import geometric_prior, model_prior
from .equations import Equations, RegressionData
from .least_squares import Estimator, Unexplained, held_out, least_squares

NARROWER = "with a larger one, torques that are not explained ask for one body of a mass above the guess of all"


# Pseudo-inertias (nb, 4, 4); relative standard deviations, of which the first with plausible bodies is taken; notes.
BodiesPrior = tuple[Array, tuple[float, ...], tuple[str, ...]]


class BodiesFit(NamedTuple):
    """Parameters of bodies and drives, by `fit_bodies`.

    Attributes
    ----------
    parameters : ndarray, shape (P,)
        Standard parameters, in the order of `base.standard.names`.
    estimator : Estimator
        Estimator of these parameters from equations, with the prior and its weight.
    consistent : bool
        True for bodies that some distribution of mass has.
    notes : tuple of str
        On the prior.

    Examples
    --------
    >>> bodies = rne.identification.fit_bodies(base, data, prior=robot)  # doctest: +SKIP
    >>> bodies.validation_error(data).in_motion, bodies.held_out(data).at_rest  # doctest: +SKIP
    """

    parameters: Array
    estimator: Estimator
    consistent: bool
    notes: tuple[str, ...] = ()

    def validation_error(self, data: RegressionData) -> Unexplained:
        """Validation error of each joint: each block of time predicted by a fit to the others.

        Parameters
        ----------
        data : RegressionData
            The equations.

        Returns
        -------
        Unexplained
            |predicted - measured| / |measured| by joint: everywhere, in motion, at rest.
        """
        return held_out(self.estimator, data.fitted, data.measured)


BodiesFit.held_out = BodiesFit.validation_error  # type: ignore[attr-defined]  # no statement for a NamedTuple's class


def fit_bodies(
    base: BaseParameters, data: RegressionData, *, prior: Robot | str | None, prior_std: float | None = None
) -> BodiesFit:
    """Fit bodies with a possible mass distribution, and drives with positive friction, to the equations of motions.

    Parameters
    ----------
    base : BaseParameters
        The combinations of parameters that torques depend on, of `Robot.base_parameters`.
    data : RegressionData
        The equations, of `regression`.
    prior : Robot, "geometry" or None
        Bodies expected where the motion is not informative, as of `rne.identify`; None for least squares, whose bodies
        need not be possible.
    prior_std : float, optional
        Relative standard deviation of the prior, as of `rne.identify`.

    Returns
    -------
    BodiesFit
        The parameters, and their estimator.

    Raises
    ------
    TypeError, ValueError
        If `prior` is neither a robot with these joints and masses, nor "geometry"; `prior_std` is not positive.
    IdentificationError
        If no possible bodies have such torques.
    ImportError
        If Clarabel is not installed.

    Notes
    -----
    Wensing, Kim and Slotine 2018; Lee, Wensing and Park 2020.

    Examples
    --------
    >>> parameters = rne.identification.fit_bodies(base, data, prior=robot).parameters  # doctest: +SKIP
    """
    if prior is None:
        if prior_std is not None:
            raise ValueError("`prior_std` is of a prior: give one, or leave it out")
        estimator = Estimator(base, None, 1.0)
        return BodiesFit(estimator.fit(data.fitted)[1], estimator, False)
    return possible_bodies(base, data, prior_of_bodies(prior, prior_std, base, data))


def possible_bodies(base: BaseParameters, data: RegressionData, prior: BodiesPrior) -> BodiesFit:
    """Physically consistent fit, with the widest standard deviation of the prior that gives plausible bodies."""
    bodies, stds, notes = prior
    for std in stds:
        estimator = Estimator(base, bodies, std**-2)
        _, parameters = estimator.fit(data.fitted)
        if plausible(parameters, bodies, data.fitted):
            break
    notes = *notes, *[f"prior_std {std:g}: {NARROWER}"] * (std != stds[0])
    return BodiesFit(parameters, estimator, True, notes)


def prior_robot(model: Model, prior: Robot | str) -> Robot | str:
    """Robot whose bodies are the prior of a model's, checked, or "geometry"."""
    if isinstance(prior, str) and prior == "geometry":
        return prior
    if not isinstance(prior, Robot):
        raise TypeError(f"`prior` must be an rne.Robot or 'geometry', got {prior!r}")
    if prior.model.moving_joints != model.moving_joints:
        raise ValueError(f"`prior` must have the joints {list(model.moving_joints)}")
    if not prior.model.mass.any():
        raise ValueError(
            "`prior` must have masses, which the robot does not: give another robot, or 'geometry' for rods between "
            "the joints, or `consistent=False`"
        )
    return prior


def prior_of_bodies(
    prior: Robot | str, prior_std: float | None, base: BaseParameters, data: RegressionData
) -> BodiesPrior:
    """Prior from a robot's bodies, or from the geometry with the best-fitting density."""
    standard, known = base.standard, prior_robot(base.standard.model, prior)
    stds = thresholds.PRIOR_STDS_OF_GUESS if isinstance(known, str) else (thresholds.PRIOR_STD,)
    stds = stds if prior_std is None else (positive_number("prior_std", prior_std),)
    if isinstance(known, str):
        bodies, drives = geometric_prior(standard.model), standard.count - PARAMETERS * standard.model.nb
        E = np.zeros((standard.count, 1 + drives))
        E[: -drives or None, 0] = parameters_of_pseudo_inertia(bodies)
        E[standard.count - drives :, 1:] = np.eye(drives)
        density = float(least_squares(data.fitted.mapped(E)).values[0])
        if density <= 0:
            text = f"the torques ask for bodies of {density:.4g} kg in all; check the signs of torques and of gravity"
            raise IdentificationError(f"`prior` 'geometry': {text}")
        return density * bodies, stds, (f"prior: rods between the joints, {density:.4g} kg in all",)
    bodies, thickened = model_prior(known)
    notes = tuple(f"prior: the body of {name} was too thin and was made thicker" for name in thickened)
    return bodies, stds, notes


def plausible(parameters: Array, guess: Array, fitted: Equations) -> bool:
    """False if unexplained torques make one body heavier than the guess for all together."""
    heaviest = parameters[: PARAMETERS * len(guess) : PARAMETERS].max(initial=0)
    return bool(heaviest <= guess[:, 3, 3].sum() or (fitted.shares(parameters) <= thresholds.EXPLAINED).all())
