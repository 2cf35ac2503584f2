"""The inertial parameters of a model as one vector, ten per body, and a model with others."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_array
from ..basics.spatial import IDENTITY, Array, dot, outer, point_mass_inertia
from .arguments import model_argument
from .other_moments import with_moments
from .solids import Moments

if TYPE_CHECKING:
    from .model import Model

PARAMETERS = 10  # of a body
PRODUCTS = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # entries of the inertia, in their order
ROWS, COLUMNS = (np.array(indices) for indices in zip(*PRODUCTS, strict=True))
ENTRIES = np.zeros((3, 3), np.intp)  # of a symmetric matrix: the place of each among the PRODUCTS
ENTRIES[ROWS, COLUMNS] = ENTRIES[COLUMNS, ROWS] = range(len(PRODUCTS))


def parameters_of(model: Model) -> Array:
    """Mass, first moment and inertia of each body about the origin of its joint's frame in the URDF."""
    centre = model.com - model.joint_origin
    inertia = model.inertia + point_mass_inertia(model.mass[:, None, None], centre)
    moments = model.mass[:, None] * centre
    return np.concatenate([model.mass[:, None], moments, inertia[:, ROWS, COLUMNS]], axis=1).reshape(-1)


def at_parameters(model: Model, parameters: Array) -> Model:
    """The robot for dynamics alone, at parameters that are not checked and may differ from state to state.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    parameters : ndarray, shape (..., 10 nb)
        As of `with_parameters`, of any dtype, traced numbers too.
    """
    rows = parameters.reshape(*parameters.shape[:-1], model.nb, PARAMETERS)
    m, h, o = rows[..., 0], rows[..., 1:4], model.joint_origin
    inertia = rows[..., 4:].take(ENTRIES, -1)
    # from the joint's origin in the URDF to that of the body's frame
    shift = 2 * dot(h, o)[..., None, None] * IDENTITY - outer(h, o) - outer(o, h)
    inertia = inertia + shift + point_mass_inertia(m[..., None, None], o)
    return with_moments(model, Moments(m, h + m[..., None] * o, inertia))


def with_parameters(model: Model, parameters: ArrayLike) -> Model:
    """The same robot with other masses, centres of mass and inertias.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    parameters : array_like, shape (10 nb,)
        Ten per body, in the order of `model.moving_joints`: m [kg], m cx, m cy, m cz [kg m], Ixx, Ixy, Iyy, Ixz, Iyz,
        Izz [kg m^2], about the origin of the body's joint frame in the URDF and in its axes.

    Returns
    -------
    Model
        With these bodies; joints, links, limits and the base are the same.

    Raises
    ------
    ValueError
        If the shape is wrong or a number is not finite, or a body without mass has a first moment.
    ModelError
        If a body is not possible: a negative mass, or an inertia that no distribution of mass has.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> rne.model.with_parameters(robot.model, 2 * robot.parameters).mass[1].item()
    44.0
    """
    model_argument(model)
    pi = real_array("parameters", parameters, f"({PARAMETERS * model.nb},)").astype(np.float64)
    if pi.shape != (PARAMETERS * model.nb,):
        raise ValueError(f"`parameters` must have shape ({PARAMETERS * model.nb},), ten per body, got {pi.shape}")
    rows = pi.reshape(model.nb, PARAMETERS)
    mass, moment = rows[:, 0], rows[:, 1:4]
    for i in np.flatnonzero((mass == 0) & moment.any(axis=1)):
        raise ValueError(f"`parameters`: the body of joint {model.moving_joints[i]!r} has a first moment and no mass")
    centre = moment / np.where(mass == 0, 1.0, mass)[:, None]
    inertia = np.empty((model.nb, 3, 3))
    inertia[:, ROWS, COLUMNS] = inertia[:, COLUMNS, ROWS] = rows[:, 4:]
    inertia = inertia - point_mass_inertia(mass[:, None, None], centre)
    return replace(model, mass=mass, com=centre + model.joint_origin, inertia=inertia, notes={})
