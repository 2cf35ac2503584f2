"""Paths: curves through joint positions, without times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_array
from ..basics.spatial import Array

T = TypeVar("T")


def made_by(maker: str) -> Callable[[type[T]], type[T]]:
    """Decorator of a class that a function makes: a call with other arguments names the function."""

    def decorate(cls: type[T]) -> type[T]:
        init: Any = cls.__init__

        @wraps(init)
        def checked(self: T, *args: Any, **options: Any) -> None:
            try:
                init(self, *args, **options)
            except TypeError:
                raise TypeError(f"{cls.__name__} is made by `rne.trajectories.{maker}`, call that instead") from None

        cls.__init__ = checked  # type: ignore[assignment, method-assign]
        return cls

    return decorate


@made_by("through")
@dataclass(frozen=True, eq=False)
class Path:
    """A curve through via points, made by `through`.

    Attributes
    ----------
    points : ndarray, shape (K, n)
        The via points [rad or m].
    stops : tuple of int
        Via points at which a motion along the path stands still, the first and the last included.
    pieces : tuple of scipy.interpolate.CubicSpline
        The curve between one stop and the next, each over a parameter from 0 to 1.

    Examples
    --------
    >>> import rne
    >>> path = rne.trajectories.through([[0, 0], [1, 0.5], [1, 1]])
    >>> path.pieces[0](1.0).tolist()
    [1.0, 1.0]
    """

    points: Array
    stops: tuple[int, ...]
    pieces: tuple[Any, ...]

    def __repr__(self) -> str:
        return f"Path({len(self.points)} points, stops={self.stops})"

    def _via(self, piece: int, s: float) -> str:
        """A place on the path in words: s is the parameter of a piece."""
        knots = self.pieces[piece].x
        k = int(np.clip(np.searchsorted(knots, s, side="right") - 1, 0, len(knots) - 2))
        share, first = (s - knots[k]) / (knots[k + 1] - knots[k]), self.stops[piece] + k
        at = first + round(share)
        return f"at via point {at}" if abs(first + share - at) < 1e-3 else f"between via points {first} and {first + 1}"


def through(points: ArrayLike, *, stops: bool | Sequence[int] = False) -> Path:
    """A path through via points: a cubic spline, with continuous curvature.

    Parameters
    ----------
    points : array_like, shape (K, n)
        Joint positions, two at least. Samples of a Cartesian path, brought into joint space by any inverse kinematics,
        are such points too [rad or m].
    stops : bool or sequence of int, optional
        True to stand still at every via point, which are then joined by straight lines in joint space; or the indices
        of those to stand still at, with a spline in between.

    Returns
    -------
    Path
        For `rne.trajectories.fastest`.

    Raises
    ------
    ValueError
        If there are fewer than two points, a number is not finite, two neighbouring points are the same, or a stop is
        no index.
    TypeError
        If `stops` is neither a bool nor a sequence.

    Notes
    -----
    `scipy.interpolate.CubicSpline` with not-a-knot ends over the centripetal parameter: intervals are the square root
    of the distance between points, which keeps the curve close to them where they are unevenly spaced (Lee 1989).

    Examples
    --------
    >>> import rne
    >>> path = rne.trajectories.through([[0, 0], [1, 0.5], [1, 1], [0, 1]], stops=[2])
    >>> len(path.pieces), path.stops
    (2, (0, 2, 3))
    """
    q = real_array("points", points, "(K, n)").astype(np.float64)
    if q.ndim != 2 or len(q) < 2:
        raise ValueError(f"`points` must have shape (K, n) with two points at least, got {q.shape}")
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(np.diff(q, axis=0), axis=1)
    if not np.isfinite(lengths.sum()):
        raise ValueError(
            f"`points` are too far apart: the way exceeds the range of float64, got up to {np.abs(q).max():g}"
        )
    if not lengths.all():
        k = int(np.argmin(lengths))
        raise ValueError(f"`points` must differ from one to the next, got the same at index {k} and {k + 1}")
    last = len(q) - 1
    inner = range(last + 1) if stops is True else [] if stops is False else stops
    if not np.iterable(inner) or isinstance(inner, str):
        raise TypeError(f"`stops` must be True, False or a sequence of indices of points, got {inner!r}")
    wrong = [k for k in inner if isinstance(k, bool) or not isinstance(k, int | np.integer) or not 0 <= k <= last]
    if wrong:
        raise ValueError(f"`stops` must be indices of points, 0 to {last}, got {wrong[0]!r}")
    rests = tuple(sorted({0, last, *map(int, inner)}))
    q.flags.writeable = False
    return Path(q, rests, tuple(_spline(q[a : b + 1]) for a, b in pairwise(rests)))


def _spline(q: Array) -> Any:
    from scipy.interpolate import CubicSpline

    steps = np.sqrt(np.linalg.norm(np.diff(q, axis=0), axis=1))
    return CubicSpline(np.concatenate([[0.0], np.cumsum(steps) / steps.sum()]), q)
