"""Reference motions from rest to rest along profiles, or through samples; paths, which are curves without times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import wraps
from itertools import pairwise
from math import factorial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import ReadOnlyArrays, cached_array, plain_array, positive_number, real_array, real_numbers
from ..basics.piecewise import Piecewise, on_rows, rows_at
from ..basics.spatial import Array
from ..basics.text import summary
from ..elementwise import clip, less, where
from ..graph.scalar import is_traced

DEGREE = 5  # degree of a spline: continuous third derivatives of q, so that accelerations have no corners
MISMATCH = 1e-6  # largest error of the spline at a sample relative to the largest |q|
KINDS = ("hold", "linear", "cubic")  # kinds of motions through samples
T = TypeVar("T")
I = TypeVar("I", bound="Interpolated")


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


class ReferenceMotion(ReadOnlyArrays):
    """Base of the motions of this module: a function of time that returns positions, velocities and accelerations.

    Examples
    --------
    >>> import rne
    >>> motion = rne.trajectories.quintic([0, 0], [1, 2], 1.0)
    >>> isinstance(motion, rne.trajectories.ReferenceMotion)
    True
    >>> [x.shape for x in motion([0.0, 0.5, 1.0])]
    [(3, 2), (3, 2), (3, 2)]
    """

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations of the joints at given times.

        Parameters
        ----------
        t : float or array_like, shape (T,) or (..., 1)
            Times [s]. An array whose last axis has length one holds one time per state, as in control laws: it is
            broadcast against joint arrays of shape (..., n). Any other array is an array of times.

        Returns
        -------
        q, qd, qdd : ndarray, shape (n,) for one time, (T, n) for T times, (..., n) for times of shape (..., 1)
            [rad or m], [rad/s or m/s], [rad/s^2 or m/s^2]. A motion from rest to rest is at rest before its start and
            after its end.

        Raises
        ------
        ValueError
            If `t` is not real or not finite, or outside the samples of a spline.
        TypeError
            If `t` is traced and the motion passes through samples: a law that does not hold it itself is called.
        """
        times = plain_array("t", t)
        if not is_traced(times):
            times = real_numbers("t", times, "(T,)")
        return self._at(times if times.ndim == 0 or times.shape[-1] == 1 else times[..., None])

    def _at(self, t: Array) -> tuple[Array, Array, Array]:
        raise NotImplementedError


@made_by("quintic")
@dataclass(frozen=True, eq=False)
class Quintic(ReferenceMotion):
    """Motion along a polynomial of fifth degree, made by `quintic`; attributes are its arguments."""

    start: Array
    end: Array
    duration: float

    __repr__ = summary

    def _at(self, t: Array) -> tuple[Array, Array, Array]:
        T, distance = self.duration, self.end - self.start
        s = clip(t / T, 0.0, 1.0)
        q = self.start + distance * (s * s * s * (10.0 - 15.0 * s + 6.0 * s * s))
        qd = distance / T * (s * s * (30.0 - 60.0 * s + 30.0 * s * s))
        return q, qd, distance / T / T * (s * (60.0 - 180.0 * s + 120.0 * s * s))


def quintic(start: ArrayLike, end: ArrayLike, duration: float) -> Quintic:
    """Motion from rest to rest along a polynomial of fifth degree, with continuous acceleration.

    Parameters
    ----------
    start, end : array_like, shape (n,)
        Joint positions [rad or m].
    duration : float
        Time from start to end [s].

    Returns
    -------
    Quintic
        A function f(t) -> (q, qd, qdd), each of shape (n,) for one time and (T, n) for an array of T times.

    Raises
    ------
    ValueError
        If the shapes differ, a number is not finite, `duration` is not positive, or so short that accelerations exceed
        the range of float64.

    Notes
    -----
    Siciliano et al. 2009, section 4.2.1. The peak velocity is 15/8 times distance / duration, the peak acceleration
    10 / sqrt(3) times distance / duration^2.

    Examples
    --------
    >>> import rne
    >>> path = rne.trajectories.quintic([0.0], [2.0], 4.0)
    >>> [x.tolist() for x in path(2.0)]
    [[1.0], [0.9375], [0.0]]
    >>> path([0.0, 2.0, 4.0])[0].tolist()
    [[0.0], [1.0], [2.0]]
    """
    motion = Quintic(*_ends(start, end), positive_number("duration", duration))
    _refuse_overflow(motion, motion.duration * (0.5 - np.sqrt(3) / 6), duration=motion.duration)
    return motion


@made_by("trapezoidal")
@dataclass(frozen=True, eq=False)
class Trapezoidal(ReferenceMotion):
    """Constant acceleration, velocity and deceleration, made by `trapezoidal`; attributes are its arguments."""

    start: Array
    end: Array
    duration: float
    ramp: float

    __repr__ = summary

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times at which the acceleration jumps [s]."""
        return 0.0, self.ramp, self.duration - self.ramp, self.duration

    def _at(self, t: Array) -> tuple[Array, Array, Array]:
        T, r = self.duration, self.ramp
        cruise = (self.end - self.start) / (T - r)
        up, level, down = clip(t, 0.0, r), clip(t, r, T - r) - r, clip(t, T - r, T) - (T - r)
        q = self.start + cruise * (up * (up / (2 * r)) + level + down - down * (down / (2 * r)))
        qd = cruise * ((up - down) / r)
        rising = where(less(0.0, t), 1.0, 0.0) * where(less(t, r), 1.0, 0.0)
        falling = where(less(T - r, t), 1.0, 0.0) * where(less(t, T), 1.0, 0.0)
        return q, qd, cruise / r * (rising - falling)


def trapezoidal(start: ArrayLike, end: ArrayLike, duration: float, ramp: float) -> Trapezoidal:
    """Motion from rest to rest with a trapezoidal profile of the velocity.

    Parameters
    ----------
    start, end : array_like, shape (n,)
        Joint positions [rad or m].
    duration : float
        Time from start to end [s].
    ramp : float
        Time of acceleration, and of deceleration; at most half the duration [s].

    Returns
    -------
    Trapezoidal
        A function f(t) -> (q, qd, qdd), each of shape (n,) for one time and (T, n) for an array of T times. Its
        acceleration jumps at the times `breaks`; `rne.simulate` ends a step at each of them, `rne.ensemble` with its
        equal steps does not, and is of order 1 there.

    Raises
    ------
    ValueError
        If the shapes differ, a number is not finite, a time is out of range, or so short that accelerations exceed the
        range of float64.

    Notes
    -----
    Siciliano et al. 2009, (4.8).

    Examples
    --------
    >>> import rne
    >>> path = rne.trajectories.trapezoidal([0.0], [3.0], 4.0, 1.0)
    >>> [x.tolist() for x in path(1.0)]
    [[0.5], [1.0], [0.0]]
    >>> path.breaks
    (0.0, 1.0, 3.0, 4.0)
    """
    T, r = positive_number("duration", duration), positive_number("ramp", ramp)
    if 2 * r > T:
        raise ValueError(f"`ramp` must be at most half the duration of {T:g} s, got {r:g}")
    motion = Trapezoidal(*_ends(start, end), T, r)
    _refuse_overflow(motion, r / 2, duration=T, ramp=r)
    return motion


def _ends(start: ArrayLike, end: ArrayLike) -> tuple[Array, Array]:
    a, b = (real_array(name, x, "(n,)").astype(np.float64) for name, x in (("start", start), ("end", end)))
    if a.shape != b.shape:
        raise ValueError(f"`start` and `end` must have the same shape (n,), got {a.shape} and {b.shape}")
    return a, b


def _overflows(motion: ReferenceMotion, t: ArrayLike) -> bool:
    with np.errstate(all="ignore"):
        return not all(np.isfinite(x).all() for x in motion(t))


def _refuse_overflow(motion: ReferenceMotion, t: float, **times: float) -> None:
    """Raise ValueError if the motion is not finite at the time of its largest acceleration."""
    if _overflows(motion, t):
        names, got = " or ".join(f"`{name}`" for name in times), " and ".join(f"{x:g}" for x in times.values())
        need = "is too short for the way from `start` to `end`: accelerations exceed the range of float64"
        raise ValueError(f"{names} {need}, got {got} s")


class Interpolated(ReferenceMotion):
    """Base of the motions through samples, piece by piece along polynomials.

    A law that holds one as a field, an attribute or in its closure is traced: the table of pieces is an input of its
    program, which takes the row for each time.
    """

    t: Array
    _curve: Piecewise

    @cached_array
    def table(self) -> Array:
        """Table with a row for each piece; see `Piecewise.table`."""
        return self._curve.table

    @property
    def samples(self) -> Array:
        """Positions at the times `t`, shape (K, n)."""
        raise NotImplementedError

    def with_samples(self, samples: ArrayLike) -> Interpolated:
        """Motion through other samples at the same times.

        Parameters
        ----------
        samples : array_like, shape (K, n)
            Joint positions [rad or m].

        Returns
        -------
        Spline or Sampled
            Motion of the same kind; errors are those of `spline` and `sampled`.

        Examples
        --------
        >>> import rne
        >>> path = rne.trajectories.spline([0.0, 1.0], [[0.0], [1.0]])
        >>> path.with_samples([[0.0], [3.0]])(0.5)[0].tolist()
        [1.5]
        """
        return self._through(samples)

    def _through(self, samples: ArrayLike) -> Interpolated:
        raise NotImplementedError

    def _at(self, t: Array) -> tuple[Array, Array, Array]:
        if is_traced(t):
            raise TypeError("a motion through samples is traced as the only one that a law itself holds, not elsewhere")
        rows = rows_at(self.table, t[..., 0] if t.ndim else t)
        return on_rows(np.clip(t, self.t[0], self.t[-1]), rows, self.samples.shape[1])


@made_by("spline")
@dataclass(frozen=True, eq=False)
class Spline(Interpolated):
    """Motion through samples, made by `spline`.

    Its attributes are the arguments, and `degree`, of the polynomials: 5, or K - 1 if there are fewer than six samples.
    """

    t: Array
    q: Array
    degree: int
    _curve: Piecewise = field(repr=False)

    @property
    def samples(self) -> Array:
        """Positions at the times `t`, shape (K, n)."""
        return self.q

    def _through(self, samples: ArrayLike) -> Spline:
        return spline(self.t, samples)


def spline(t: ArrayLike, q: ArrayLike) -> Spline:
    """Smooth motion through samples of joint positions.

    Parameters
    ----------
    t : array_like, shape (K,)
        Times, ascending; at least two [s].
    q : array_like, shape (K, n)
        Joint positions [rad or m].

    Returns
    -------
    Spline
        A function f(t) -> (q, qd, qdd), each of shape (n,) for one time and (T, n) for an array of T times, such as a
        reference for `rne.control.computed_torque`. Outside the samples it raises ValueError: the motion there is not
        known, and rest is not assumed.

    Raises
    ------
    ValueError
        If the shapes do not match, there are fewer than two samples, a number is not finite, the times do not ascend,
        are spaced so unevenly that the spline does not pass through the samples, or so closely that accelerations
        exceed the range of float64.

    Notes
    -----
    The interpolating spline of `scipy.interpolate.make_interp_spline` of fifth degree with not-a-knot ends; with fewer
    than six samples one polynomial of degree K - 1, so that two samples give a constant velocity. For samples at
    intervals h of a smooth motion, errors of q, qd and qdd decrease as h^6, h^5 and h^4; intervals of similar length
    are best. The spline passes through every sample, noise included, which its second derivative amplifies: filter
    measured positions first.

    Examples
    --------
    >>> import numpy as np, rne
    >>> t = np.linspace(0.0, 2.0, 41)
    >>> path = rne.trajectories.spline(t, np.stack([np.sin(t), t**2], axis=-1))
    >>> [x.round(6).tolist() for x in path(1.0)]
    [[0.841471, 1.0], [0.540302, 2.0], [-0.841471, 2.0]]
    >>> path.degree
    5
    """
    from scipy.interpolate import make_interp_spline

    times, positions = _checked_samples(t, "q", q)
    degree = min(DEGREE, len(times) - 1)
    # From 0 to 1: the collocation matrix is then as well conditioned as the spacing of the times allows.
    s = (times - times[0]) / (times[-1] - times[0])
    try:
        curve = make_interp_spline(s, positions, k=degree)
    except (ValueError, np.linalg.LinAlgError):
        raise ValueError(_uneven(times)) from None
    miss = np.abs(curve(s) - positions).max(initial=0.0)
    if not miss <= MISMATCH * np.abs(positions).max(initial=0.0):
        raise ValueError(_uneven(times))
    return _not_too_close("q", Spline(times, positions, degree, _pieces(times, range(3, len(times) - 3), s, curve)))


def _pieces(t: Array, inner: Sequence[int], s: Array, curve: Any) -> Piecewise:
    """Polynomials of one of SciPy's splines over s, which end at the first, some inner and the last time."""
    ends = [0, *inner, len(t) - 1]
    h, begins = np.diff(s[ends])[:, None], s[ends[:-1]]
    degree = curve.k if hasattr(curve, "k") else len(curve.c) - 1
    return Piecewise(t[ends], np.stack([curve(begins, nu=k) * h**k / factorial(k) for k in range(degree + 1)]))


@made_by("sampled")
@dataclass(frozen=True, eq=False)
class Sampled(Interpolated):
    """Motion through samples, made by `sampled`; attributes are its arguments."""

    t: Array
    values: Array
    kind: str
    _curve: Piecewise = field(repr=False)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times at which positions or velocities jump [s]."""
        return () if self.kind == "cubic" else tuple(self.t.tolist())

    @property
    def samples(self) -> Array:
        """Positions at the times `t`, shape (K, n)."""
        return self.values

    def _through(self, samples: ArrayLike) -> Sampled:
        return sampled(self.t, samples, self.kind)


def sampled(t: ArrayLike, values: ArrayLike, kind: str = "hold") -> Sampled:
    """Motion through samples of joint positions, held or joined by straight lines or cubic polynomials.

    Parameters
    ----------
    t : array_like, shape (K,)
        Times, ascending; at least two [s].
    values : array_like, shape (K, n)
        Joint positions [rad or m].
    kind : {"hold", "linear", "cubic"}
        Each sample held until the next one, so that velocities and accelerations are zero, as set points that are sent
        to a controller; straight lines, whose accelerations are zero; or the cubic spline with continuous
        accelerations, the first and the last two pieces of which are one polynomial each (not-a-knot ends).

    Returns
    -------
    Sampled
        A function f(t) -> (q, qd, qdd), each of shape (n,) for one time and (T, n) for an array of T times; at a sample
        the values from there on. Positions that are held, and velocities along straight lines, jump at the times
        `breaks`, at which `rne.simulate` ends a step. Outside the samples it raises ValueError, as `spline` does.

    Raises
    ------
    ValueError
        If `kind` is another one, the shapes do not match, there are fewer than two samples, a number is not finite, the
        times do not ascend, or are spaced so closely that accelerations exceed the range of float64.

    Examples
    --------
    >>> import rne
    >>> steps = rne.trajectories.sampled([0.0, 1.0, 2.0], [[0.0], [3.0], [4.0]])
    >>> steps([0.5, 1.0])[0].tolist(), steps.breaks
    ([[0.0], [3.0]], (0.0, 1.0, 2.0))
    >>> [x.tolist() for x in rne.trajectories.sampled([0.0, 1.0, 2.0], [[0.0], [3.0], [4.0]], "linear")(0.5)]
    [[1.5], [3.0], [0.0]]
    """
    if kind not in KINDS:
        raise ValueError(f"`kind` must be one of {list(KINDS)}, got {kind!r}")
    times, q = _checked_samples(t, "values", values)
    if kind == "hold":
        curve = Piecewise(np.append(times, times[-1]), q[None])  # the last one, without length, is only read by rows
    elif kind == "linear":
        curve = Piecewise(times, np.stack([q[:-1], np.diff(q, axis=0)]))
    else:
        from scipy.interpolate import CubicSpline

        s = (times - times[0]) / (times[-1] - times[0])
        curve = _pieces(times, range(1, len(s) - 1), s, CubicSpline(s, q))
    return _not_too_close("values", Sampled(times, q, kind, curve))


def _not_too_close(name: str, motion: I) -> I:
    if _overflows(motion, motion.t):
        span = f"accelerations exceed the range of float64 within {motion.t[-1] - motion.t[0]:g} s"
        raise ValueError(f"`t` is spaced too closely for `{name}`: {span}")
    return motion


def _checked_samples(t: ArrayLike, name: str, values: ArrayLike) -> tuple[Array, Array]:
    times, q = real_numbers("t", t, "(K,)").astype(float), real_numbers(name, values, "(K, n)").astype(float)
    if times.ndim != 1 or len(times) < 2:
        raise ValueError(f"`t` must have shape (K,) with two times at least, got {times.shape}")
    if q.ndim != 2 or len(q) != len(times):
        raise ValueError(f"`{name}` must have shape ({len(times)}, n), a row for each time, got {q.shape}")
    late = np.flatnonzero(np.diff(times) <= 0)
    if len(late):
        k = int(late[0])
        raise ValueError(f"`t` must ascend, got {times[k + 1]:.10g} after {times[k]:.10g} at index {k + 1}")
    return times, q


def _uneven(t: Array) -> str:
    steps = np.diff(t)
    return (
        f"`t` is spaced too unevenly for a spline through the samples: intervals from {steps.min():.3g} to "
        f"{steps.max():.3g} s; sample the motion at equal intervals"
    )


@made_by("through")
@dataclass(frozen=True, eq=False)
class Path:
    """Curve through via points, made by `through`.

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

    def via(self, piece: int, s: float) -> str:
        """Text of a place on the path: s is the parameter of a piece."""
        knots = self.pieces[piece].x
        k = int(np.clip(np.searchsorted(knots, s, side="right") - 1, 0, len(knots) - 2))
        share, first = (s - knots[k]) / (knots[k + 1] - knots[k]), self.stops[piece] + k
        at = first + round(share)
        return f"at via point {at}" if abs(first + share - at) < 1e-3 else f"between via points {first} and {first + 1}"


def through(points: ArrayLike, *, stops: bool | Sequence[int] = False) -> Path:
    """Path through via points: a cubic spline, with continuous curvature.

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
        got = f"got up to {np.abs(q).max():g}"
        raise ValueError(f"`points` are too far apart: the way exceeds the range of float64, {got}")
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
    return Path(q, rests, tuple(_centripetal_spline(q[a : b + 1]) for a, b in pairwise(rests)))


def _centripetal_spline(q: Array) -> Any:
    from scipy.interpolate import CubicSpline

    steps = np.sqrt(np.linalg.norm(np.diff(q, axis=0), axis=1))
    return CubicSpline(np.concatenate([[0.0], np.cumsum(steps) / steps.sum()]), q)
