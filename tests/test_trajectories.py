"""Reference motions: their shapes for one time and for many, their derivatives, and what they refuse."""

import re

import numpy as np
import pytest

import rne

from .helpers import loaded

START, END = np.linspace(0.0, 0.5, 6), np.linspace(1.0, -1.0, 6)
PATHS = {
    "quintic": rne.trajectories.quintic(START, END, 3.0),
    "trapezoidal": rne.trajectories.trapezoidal(START, END, 3.0, 0.5),
}


@pytest.fixture(params=PATHS)
def path(request):
    return PATHS[request.param]


@pytest.mark.parametrize("samples", [0, 2, 5, 6])
def test_a_vector_of_times_gives_one_row_for_each(path, samples):
    """With as many times as joints, joint k at time k would be a wrong answer of the right shape."""
    times = np.linspace(-0.5, 3.5, samples)
    for k, values in enumerate(path(times)):
        assert values.shape == (samples, 6)
        np.testing.assert_array_equal(values, np.array([path(t)[k] for t in times]).reshape(samples, 6))


def test_a_list_of_times_is_an_array_of_times(path):
    np.testing.assert_array_equal(path([0, 1, 2])[0], path(np.arange(3))[0])


@pytest.mark.parametrize("t", [1, 1.0, np.float32(1), np.array(1.0), np.array([1.0])])
def test_one_time_gives_one_row_without_an_axis_of_times(path, t):
    assert [values.shape for values in path(t)] == [(6,)] * 3


def test_times_of_shape_n_1_are_one_time_per_state(path):
    """A simulation gives t this shape beside q of shape (..., n)."""
    times = np.linspace(0, 3, 4)
    for column, row in zip(path(times[:, None]), path(times), strict=True):
        np.testing.assert_array_equal(column, row)
    for column, row in zip(path(times.reshape(2, 2)), path(times), strict=True):
        np.testing.assert_array_equal(column.reshape(4, 6), row)


def test_a_traced_reference_agrees_with_calls_of_it(path):
    """Tracing hands over t as an array of one traced number, shape (1, 1)."""
    robot = loaded("irb140")
    law = rne.traceable(lambda t, q, qd: sum(path(t)))
    scene = rne.Scene(robot, controller=law)
    times = np.linspace(0, 0.2, 6)
    motion = rne.simulate(scene, START, [0] * 6, 0.2, t_eval=times)
    assert scene.cost()["law"] == "traced"
    np.testing.assert_allclose(motion.tau, sum(path(times)), rtol=1e-13)


def test_duration_and_ends_are_kept(path):
    for t, q in ((-1.0, START), (0.0, START), (3.0, END), (4.0, END)):
        position, rate, _ = path(t)
        np.testing.assert_allclose(position, q, atol=1e-15)
        assert not rate.any()


def test_rates_are_derivatives(path):
    times, h = np.array([0.2, 1.0, 2.3, 2.8]), 1e-5
    (q0, v0, _), (_, v, a), (q1, v1, _) = path(times - h), path(times), path(times + h)
    np.testing.assert_allclose((q1 - q0) / (2 * h), v, atol=1e-8)
    np.testing.assert_allclose((v1 - v0) / (2 * h), a, atol=1e-8)


@pytest.mark.parametrize(
    ("t", "text"),
    [
        (np.nan, "`t` must be finite, got nan at index ()"),
        ([0.0, np.inf], "`t` must be finite, got inf at index (1,)"),
        ("now", "`t` must be an array of numbers of shape (T,), got dtype <U3"),
        (None, "`t` must be an array of numbers of shape (T,), got dtype object"),
        (1j, "`t` must be real, got dtype complex128"),
    ],
)
def test_what_is_no_time_is_refused(path, t, text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        path(t)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (
            lambda: rne.trajectories.quintic([0], [1, 2], 1.0),
            "`start` and `end` must have the same shape (n,), got (1,) and (2,)",
        ),
        (lambda: rne.trajectories.quintic([0], [1], 0), "`duration` must be positive, got 0.0"),
        (
            lambda: rne.trajectories.quintic([0], [np.nan], 1),
            "`end` must be finite, got nan at index (0,)",
        ),
        (
            lambda: rne.trajectories.trapezoidal([0], [1], 1.0, 0.6),
            "`ramp` must be at most half the duration of 1 s, got 0.6",
        ),
        (lambda: rne.trajectories.trapezoidal([0], [1], 1.0, -0.1), "`ramp` must be positive, got -0.1"),
    ],
)
def test_wrong_arguments_are_named(make, text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        make()


MAKERS = {
    "quintic": lambda start, end, T: rne.trajectories.quintic(start, end, T),
    "trapezoidal": lambda start, end, T: rne.trajectories.trapezoidal(start, end, T, T / 4),
    "spline": lambda start, end, T: rne.trajectories.spline(
        np.linspace(0, T, 9), np.linspace(start, end, 9) * (1 + 0.1 * np.sin(np.arange(9.0))[:, None])
    ),
}


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize("duration", [1e-130, 1e-200, 1e150, 1e300])
def test_a_motion_takes_any_duration_that_its_numbers_hold(maker, duration):
    """Time is a unit: velocities and accelerations scale with one and two powers of it, and no power is formed first.

    Over 1e-200 s, a motion of 1e-160 has accelerations of 1e240.
    """
    size = 1e-160 if duration < 1 else 1e200
    start, end = np.array([1.0, -2.0]), np.array([3.0, 5.0])
    once, scaled = MAKERS[maker](start, end, 1.0), MAKERS[maker](size * start, size * end, duration)
    s = np.array([0.1, 0.3, 0.5, 0.9])
    for order, (one, other) in enumerate(zip(once(s), scaled(s * duration), strict=True)):
        expected = one * size
        for _ in range(order):
            expected = expected / duration
        np.testing.assert_allclose(other, expected, rtol=1e-9, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: rne.trajectories.quintic([0.0, 0.0], [1.0, 0.0], 1e-200),
            "`duration` is too short for the way from `start` to `end`: accelerations exceed the range of float64, "
            "got 1e-200 s",
        ),
        (
            lambda: rne.trajectories.trapezoidal([0.0, 0.0], [1.0, 0.0], 1.0, 1e-310),
            "`duration` or `ramp` is too short for the way from `start` to `end`: accelerations exceed the range of "
            "float64, got 1 and 1e-310 s",
        ),
        (
            lambda: rne.trajectories.spline([0.0, 1e-200, 3e-200], [[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0]]),
            "`t` is spaced too closely for `q`: accelerations exceed the range of float64 within 3e-200 s",
        ),
    ],
)
def test_accelerations_beyond_double_are_refused(make, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        make()


def test_times_that_no_spline_passes_through_are_refused():
    """The second time is the first one, as a part of the whole; between others a spline misses the samples."""
    for second, steps in ((5e-324, "from 4.94e-324 to 1 s"), (1e-17, "from 1e-17 to 1 s")):
        with pytest.raises(
            ValueError, match=f"spaced too unevenly for a spline through the samples: intervals {steps}"
        ):
            rne.trajectories.spline([0.0, second, *range(1, 6)], np.arange(7.0)[:, None] ** 2)


def test_a_short_ramp_keeps_the_way():
    """The square of a ramp of 1e-200 s is zero; the motion still ends where it should."""
    short = rne.trajectories.trapezoidal([0.0], [1e-150], 1.0, 1e-200)
    assert short(1.0)[0].tolist() == [1e-150]
    assert short(0.5)[0].tolist() == [5e-151]


def test_a_spline_shows_its_samples_and_keeps_them():
    path = rne.trajectories.spline([0.0, 1.0, 2.0], [[0.0], [1.0], [0.0]])
    assert "curve" not in repr(path)
    for array in (path.t, path.q):
        assert not array.flags.writeable
    assert "curve" not in repr(rne.trajectories.sampled([0.0, 1.0, 2.0], [[0.0], [1.0], [0.0]]))
