"""Rodas5P: its orders, its control of steps, and motions by it against closed forms and tight runs of Radau."""

from typing import NamedTuple

import numpy as np
import pytest

from rne.integrators import rosenbrock, step_control


class Wanted:
    """(2 + sin q) qdd + 0.3 qd + q^2 - z = g(t) and dz/dt = -(1 + q) z + qd / 2 + p(t), with g and p such that q = sin t and
    z = cos 2t: M depends on q, both equations on time, and each on the states of the other."""

    n, size = 1, 3

    @staticmethod
    def solution(t):
        return np.stack([np.sin(t), np.cos(t), np.cos(2 * t)], axis=-1)

    @staticmethod
    def drive(t):
        g = (2 + np.sin(np.sin(t))) * -np.sin(t) + 0.3 * np.cos(t) + np.sin(t) ** 2 - np.cos(2 * t)
        return g, -2 * np.sin(2 * t) + (1 + np.sin(t)) * np.cos(2 * t) - np.cos(t) / 2

    def rates(self, t, x, out):
        (q, qd, z), (g, p) = x, self.drive(t[0])
        out[:] = qd, (g + z - q**2 - 0.3 * qd) / (2 + np.sin(q)), p - (1 + q) * z + qd / 2
        return True

    def slopes(self, t, x, a, out):
        (q, _, z), tiny = x, 1e-30
        by_time = [part.imag / tiny for part in self.drive(t[0] + tiny * 1j)]
        out[0] = 2 * q + np.cos(q) * a[0], 0.3, -1.0, 2 + np.sin(q), -by_time[0]
        out[1] = -z, 0.5, -(1 + q), 0.0, by_time[1]
        return True


class Relaxing:
    """0.01 qdd = -c (q - cos t), overdamped by qd: a fast mode beside a slow motion, at rest where it starts."""

    n, size = 1, 2

    def __init__(self, stiffness):
        self.c = stiffness

    def rates(self, t, x, out):
        out[:] = x[1], -100 * self.c * (x[1] + x[0] - np.cos(t[0]) + np.sin(t[0]))
        return True

    def slopes(self, t, x, a, out):
        out[0] = self.c, self.c, 0.01, self.c * (np.sin(t[0]) + np.cos(t[0]))
        return True


class Run(NamedTuple):
    """What the text leaves: times, states, interpolants, lengths to try next, evaluations, stages of the last step."""

    T: np.ndarray
    X: np.ndarray
    P: np.ndarray
    H: np.ndarray
    count: np.ndarray
    stages: np.ndarray


def steps(problem, x0, end, *, h=None, rtol=1e-6, atol=1e-9, most=2000, first=1e-4, begin=0.0, functions=None):
    """Steps by the text as it stands: equal ones of length h, or by control of the error."""
    equal = h is not None
    most = round(end / h) if equal else most
    T, X, P = np.full(most + 1, begin), np.zeros((most + 1, problem.size)), np.zeros((most, 3, problem.size))
    H, count = np.full(most + 1, h if equal else first), np.zeros(2, dtype=np.int64)
    X[0] = x0
    tolerances, max_step = ((1e9, 1e9), h) if equal else ((rtol, atol), np.inf)
    counted = getattr(problem, "counted", problem.size)
    interval = step_control.Interval(rosenbrock.TABLEAU, begin, end, -np.inf, np.inf, *tolerances, counted, max_step)
    state, work = (np.zeros(1), np.zeros(problem.size)), rosenbrock.workspace(problem.n, counted, problem.size)
    rates, slopes = functions or (problem.rates, problem.slopes)
    given = step_control.Problem(rates, state, interval), (slopes, (*state, np.zeros(problem.n)))
    taken = rosenbrock.take_steps(*given, step_control.Storage(T, X, P, H, count, work))
    return Run(T[: taken + 1], X[: taken + 1], P[:taken], H[: taken + 1], count, work[4])


def order(errors, ratio):
    return np.log(errors[0] / errors[1]) / np.log(ratio)


def test_the_sums_of_the_coefficients_are_the_published_ones():
    """alpha_i and gamma_i are not in the table but follow from it; these are those of OrdinaryDiffEq.jl."""
    alpha = [0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1, 1, 1]
    gamma = [0.21193756319429014, -0.42387512638858027, -0.3384627126235924, 1.8046452872882734, 2.325825639765069, 0, 0, 0]  # fmt: skip
    np.testing.assert_allclose(rosenbrock.ALPHA, alpha, rtol=0, atol=2e-14)
    np.testing.assert_allclose(rosenbrock.GAMMAS, gamma, rtol=0, atol=2e-14)


def test_orders_of_the_steps_and_of_the_interpolant():
    """On a motion that depends on time, with a state of the controller: 5, and errors of order 5 inside steps."""
    problem, ends, inside = Wanted(), [], []
    for h in (0.1, 0.05):
        T, X, P, *_ = steps(problem, problem.solution(0.0), 2.0, h=h)
        assert len(T) == round(2 / h) + 1
        ends.append(np.abs(X[-1] - problem.solution(2.0)).max())
        s = np.array([0.2, 0.5, 0.7])
        times = T[:-1, None] + np.diff(T)[:, None] * s
        found = rosenbrock.inside(X[:-1, None], X[1:, None], P[:, None], s[:, None])
        inside.append(np.abs(found - problem.solution(times)).max())
    assert 4.6 < order(ends, 2) < 5.6
    assert 4.4 < order(inside, 2) < 5.6


@pytest.mark.parametrize("column", [2, 4])
def test_slopes_by_states_and_by_time_count(column):
    """Without them the order falls: a method of this kind needs the whole Jacobian."""
    problem, errors = Wanted(), []

    def lacking(*arguments):
        problem.slopes(*arguments)
        arguments[-1][:, column] = 0.0
        return True

    for h in (0.1, 0.05):
        _, X, *_ = steps(problem, problem.solution(0.0), 2.0, h=h, functions=(problem.rates, lacking))
        errors.append(np.abs(X[-1] - problem.solution(2.0)).max())
    assert order(errors, 2) < 3


@pytest.mark.parametrize("rtol", [1e-4, 1e-7])
def test_errors_follow_the_tolerance_and_the_interpolants_too(rtol):
    problem = Wanted()
    T, X, P, _, count, _ = steps(problem, problem.solution(0.0), 3.0, rtol=rtol, atol=rtol)
    assert T[-1] == 3.0
    assert np.abs(X - problem.solution(T)).max() < 5 * rtol
    middle = rosenbrock.inside(X[:-1], X[1:], P, np.full((len(P), 1), 0.5))
    assert np.abs(middle - problem.solution((T[:-1] + T[1:]) / 2)).max() < 5 * rtol
    assert count[1] == len(T) - 1
    assert 8 * count[1] <= count[0]  # of rejected steps the first stage is not repeated


@pytest.mark.parametrize("stiffness", [1e2, 1e6, 1e10])
def test_steps_follow_the_slow_motion_however_fast_the_fast_mode(stiffness):
    """q + qd = cos t - sin t in the limit, of which q = cos t; the fast mode decays with 100 c."""
    T, X, *_ = steps(Relaxing(stiffness), [1.0, 0.0], 5.0)
    assert len(T) < 60
    assert np.abs(X[:, 0] - np.cos(T)).max() < 2e-4 + 0.1 / stiffness


def test_an_unsound_evaluation_and_a_singular_matrix_end_the_steps():
    problem = Wanted()
    until_1 = (lambda t, *rest: t[0] < 1 and problem.rates(t, *rest)), problem.slopes
    T, *_ = steps(problem, problem.solution(0.0), 3.0, functions=until_1)
    assert 0.3 < T[-1] <= 1.0
    singular = problem.rates, lambda *arguments: arguments[-1].fill(0.0) is None
    with np.errstate(all="ignore"):  # steps become as short as numbers can be
        T, *_ = steps(problem, problem.solution(0.0), 3.0, functions=singular)
    assert len(T) == 1


def test_an_accepted_step_is_within_the_tolerance_and_the_next_at_most_ten_times_as_long():
    problem, t, x, first = Wanted(), 0.0, Wanted.solution(0.0), 1e-9
    for _ in range(30):
        run = steps(problem, x, 3.0, most=1, begin=t, first=first, rtol=1e-5, atol=1e-5)
        scale = 1e-5 + 1e-5 * np.maximum(np.abs(run.X[0]), np.abs(run.X[1]))
        assert np.sqrt(((run.stages[-1] / scale) ** 2).mean()) < 1
        assert run.H[1] <= 10 * (run.T[1] - run.T[0]) * (1 + 1e-6) or run.T[1] == 3.0
        t, x, first = run.T[1], run.X[1], run.H[1]
        if t == 3.0:
            break
    assert t == 3.0


class Dissipating(Wanted):
    """With the integral of qd^2 behind."""

    size, counted = 4, 3

    def rates(self, t, x, out):
        out[3] = x[1] ** 2
        return super().rates(t, x[:3], out[:3])

    def slopes(self, t, x, a, out):
        inner = np.zeros((2, 5))
        super().slopes(t, x[:3], a, inner)
        out[:] = 0.0
        out[:2, :3], out[:2, 4:], out[2, 1] = inner[:, :3], inner[:, 3:], 2 * x[1]
        return True


@pytest.mark.parametrize("problem", [Wanted(), Dissipating()])
def test_the_next_length_follows_from_the_mean_square_of_the_error(problem):
    """Over the states that count: not over an integral, whose scale is infinite here."""
    x0 = np.append(Wanted.solution(0.0), np.zeros(problem.size - 3))
    run = steps(problem, x0, 3.0, most=1, first=0.3, rtol=1e-4, atol=1e-4)
    assert run.count.tolist() == [8, 1]
    scale = 1e-4 + 1e-4 * np.maximum(np.abs(run.X[0]), np.abs(run.X[1]))
    error = np.sqrt(((run.stages[-1] / scale)[:3] ** 2).mean())
    assert run.H[1] == pytest.approx(0.3 * 0.9 * error**-0.2, rel=1e-12)


def test_after_a_rejected_step_the_next_is_not_longer():
    problem = Wanted()
    for first in (1.5, 2.0, 3.0):
        run = steps(problem, problem.solution(0.0), 3.0, most=1, first=first, rtol=1e-4, atol=1e-4)
        assert run.count[0] > 8
        assert run.H[1] <= run.T[1]


def test_a_step_cut_at_the_end_leaves_the_length_that_it_would_have_had():
    problem = Wanted()
    run = steps(problem, problem.solution(0.0), 1e-4, first=0.05)
    assert len(run.T) == 2
    assert run.H[1] == 0.05


def test_rows_are_exchanged_before_a_pivot_that_is_zero():
    W, G = np.array([[0.0, 2.0, 4.0], [1.0, 1.0, 3.0]]), np.zeros((1, 2))
    assert rosenbrock.eliminate(W, G)
    np.testing.assert_allclose(G, [[1.0, 2.0]])
