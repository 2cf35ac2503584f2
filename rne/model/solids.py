"""Solid bodies: shapes for drawing, and moments of inertia."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from ..basics.arrays import positive_number
from ..basics.spatial import Array


class Cylinder(NamedTuple):
    """Cylinder fixed to a link, for drawing only; its axis is the z axis of its own pose.

    Attributes
    ----------
    link : str
        The link that it is fixed to.
    radius, length : float
        Its size [m].
    position : tuple of float, length 3
        Its middle, in the link's frame [m].
    rpy : tuple of float, length 3
        Roll, pitch and yaw of its pose in the link's frame [rad].

    Examples
    --------
    >>> import rne
    >>> rne.irb140().shapes[1].link
    'base_link'
    """

    link: str
    radius: float
    length: float
    position: tuple[float, float, float]
    rpy: tuple[float, float, float]


class Box(NamedTuple):
    """Box fixed to a link, for drawing only; its edges are along the axes of its own pose.

    Attributes
    ----------
    link : str
        The link that it is fixed to.
    size : tuple of float, length 3
        Lengths of its edges [m].
    position, rpy : tuple of float, length 3
        Its middle, and roll, pitch and yaw of its pose, in the link's frame [m, rad].

    Examples
    --------
    >>> import rne
    >>> rne.irb140().shapes[0].size
    (0.4, 0.34, 0.05)
    """

    link: str
    size: tuple[float, float, float]
    position: tuple[float, float, float]
    rpy: tuple[float, float, float]


class Moments(NamedTuple):
    """Mass, first moment (mass times centre) and inertia of each body about its frame's origin.

    Shapes (nb,), (nb, 3), (nb, 3, 3) [kg, kg m, kg m^2].
    """

    mass: Array
    first_moment: Array
    inertia: Array

    def plus(self, other: Moments) -> Moments:
        """Sum of the moments of two bodies in the same frame."""
        return Moments(*(a + b for a, b in zip(self, other, strict=True)))


def cylinder_inertia(mass: float, radius: float, length: float, axis: Literal["x", "y", "z"]) -> Array:
    """Inertia of a solid cylinder about its centre of mass, in axes parallel and perpendicular to it.

    Parameters
    ----------
    mass : float
        Mass [kg].
    radius, length : float
        Size [m].
    axis : {"x", "y", "z"}
        The axis of the link's frame that the cylinder is parallel to.

    Returns
    -------
    ndarray, shape (3, 3)
        The moments m r^2 / 2 about the cylinder's axis, m (3 r^2 + h^2) / 12 about the two others [kg m^2].

    Raises
    ------
    ValueError
        If a number is negative or not finite, or the axis is another.

    Notes
    -----
    Høifødt 2011, (4.25)-(4.31).

    Examples
    --------
    >>> import rne
    >>> rne.model.cylinder_inertia(12.0, 1.0, 1.0, "y").diagonal().tolist()
    [4.0, 6.0, 4.0]
    """
    if axis not in ("x", "y", "z"):
        raise ValueError(f"`axis` must be 'x', 'y' or 'z', got {axis!r}")
    sizes = {"mass": mass, "radius": radius, "length": length}
    m, r, h = (positive_number(name, value, zero_allowed=True) for name, value in sizes.items())
    moments = np.full(3, m * (3 * r**2 + h**2) / 12)
    moments["xyz".index(axis)] = m * r**2 / 2
    return np.diag(moments)
