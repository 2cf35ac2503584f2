"""Integrators without a robot: tableaus, what counts in the error, and a method that is nothing but its tableau."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.integrate

from rne.basics.piecewise import NO_TABLE
from rne.integrators import base, compiled_methods, lanes, rosenbrock, rows, runge_kutta, step_control, tableaus
from rne.integrators.scipy_methods import SciPySolver

from .helpers import EPS

EXPLICIT_METHODS = ("RK45", "RK23", "DOP853", "Tsit5")

DAMPING = 0.3
START = np.array([1.0, 0.5])
ROUNDING = 100 * EPS  # of sums over coefficients up to 50, given with 16 digits
SCIPY = ["RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA"]
LOOPS = ["RK45", "DOP853", "Rodas5P"]


class Oscillator:
    """q'' = u - q - 0.3 q', with u = 0 or held, and behind (q, q') what is dissipated so far, if that is asked for."""

    span, held, numbers, table = (-np.inf, np.inf), None, np.zeros(0), NO_TABLE
    integral_scale = 1e300  # any error of the energy is small

    def __init__(self, with_energy):
        self.counted, self.size, self.evaluations = 2, 2 + with_energy, 0
        self.kernel = SimpleNamespace(address=lambda: self.function, coefficients=lambda numbers: numbers)
        slopes = SimpleNamespace(address=lambda: self.slopes, coefficients=lambda numbers: numbers)
        self.width, self.implicit = self.size, base.Implicit(1, slopes)

    def jacobian(self, t, x):
        """Over q and q'."""
        slopes = np.zeros((self.size, self.size))
        slopes[:2, :2] = [[0, 1], [-1, -DAMPING]]
        slopes[2:, 1] = 2 * DAMPING * x[1]
        return slopes

    def rates(self, t, x, u):
        force = 0.0 if u is None else u[0]
        return np.array([x[1], force - x[0] - DAMPING * x[1], DAMPING * x[1] ** 2])[: self.size]

    def __call__(self, t, x):
        self.evaluations += 1
        return self.rates(t, x, self.held)

    def function(self, *arguments):
        *given, rates = arguments
        rates[:] = self.rates(given[0][0], given[1], given[2] if len(given) == 4 else None)
        return True

    def slopes(self, t, x, a, numbers, out):
        """Of q'' + q + 0.3 q' and of the dissipated power, by x, q'' and t."""
        out[:] = 0.0
        out[0, [0, 1, self.size]] = 1.0, DAMPING, 1.0
        if self.size == 3:
            out[1, 1] = 2 * DAMPING * x[1]
        return True


@pytest.fixture
def interpreted(monkeypatch):
    """Loops run by Python."""
    for name in ("take_segments", "take_samples", "add_stages"):
        monkeypatch.setattr(compiled_methods, name, getattr(runge_kutta, name))
    monkeypatch.setattr(compiled_methods, "take_stiff_segments", rosenbrock.take_segments)
    monkeypatch.setattr(lanes, "compiled", lambda text: text)


def solver_of(system, way, options):
    if way == "scipy":
        return SciPySolver(options, True)
    if options.method == "Rodas5P":
        return compiled_methods.RosenbrockSolver(options, system)
    return compiled_methods.CompiledSolver(options, system.kernel)


def motion(system, way, method, end=10.0, rtol=1e-6, atol=1e-9):
    """Times, states, and states in the middles of all steps but the first."""
    solver = solver_of(system, way, base.IntegrationOptions(method, rtol, atol))
    solver.start(system, 0.0, np.append(START, np.zeros(system.size - 2)), end)
    T, X, middles = [0.0], [np.append(START, np.zeros(system.size - 2))], []
    while solver.is_running:
        steps = solver.steps(7)
        T.extend(steps.T[1:])
        X.extend(steps.X[1:])
        times = (steps.T[1:] + steps.T[:-1]) / 2
        middles.extend(steps.states(times, np.arange(len(times))))
    return np.array(T), np.array(X), np.array(middles)


def exact(t):
    """The closed form of q, q' and the dissipated energy."""
    w = np.sqrt(1 - DAMPING**2 / 4)
    a, decay = (START[1] + DAMPING / 2 * START[0]) / w, np.exp(-DAMPING / 2 * t)
    q = decay * (START[0] * np.cos(w * t) + a * np.sin(w * t))
    qd = decay * w * (a * np.cos(w * t) - START[0] * np.sin(w * t)) - DAMPING / 2 * q
    return np.stack([q, qd, (START @ START - q**2 - qd**2) / 2], axis=-1)


@pytest.mark.parametrize("method", ["RK45", "DOP853"])
def test_what_a_kernel_gives_behind_the_rates_is_carried_along_unread(interpreted, method):
    plain, wide = Oscillator(with_energy=True), Oscillator(with_energy=True)

    def function(*arguments):
        arguments[-1][wide.size :] = np.nan
        return plain.function(*arguments[:-1], arguments[-1][: wide.size])

    wide.width, wide.kernel = wide.size + 2, SimpleNamespace(address=lambda: function, coefficients=lambda x: x)
    for found, expected in zip(motion(wide, "loop", method), motion(plain, "loop", method), strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(("way", "method"), [*(("scipy", m) for m in SCIPY), *(("loop", m) for m in LOOPS)])
def test_energies_behind_the_state_change_no_step(interpreted, way, method):
    """And their error is that of the tolerance, at the steps and inside them."""
    plain, with_energy = Oscillator(with_energy=False), Oscillator(with_energy=True)
    T, X, _ = motion(plain, way, method)
    t, x, middles = motion(with_energy, way, method)
    if way == "loop":  # Rodas5P multiplies by 1 / h where it solves, and by h where it need not
        np.testing.assert_array_equal(t, T)
        np.testing.assert_array_equal(x[:, :2], X)
        assert with_energy.evaluations == plain.evaluations
    elif method in EXPLICIT_METHODS:
        np.testing.assert_allclose(t, T, rtol=1e-9)  # tolerances are scaled, and round
        assert with_energy.evaluations == plain.evaluations
    else:  # without energies the Jacobian is the solver's
        assert abs(len(t) - len(T)) <= 1
        assert abs(with_energy.evaluations - plain.evaluations) <= 4
    assert np.abs(x - exact(t)).max() < 2e-5
    assert np.abs(middles - exact((t[1:] + t[:-1]) / 2)).max() < 2e-5


class Pushed(Oscillator):
    """q'' = 3 t^2, which methods follow exactly, and the work t^6 / 2 of this force."""

    integral_scale = 1.0

    def rates(self, t, x, u):
        return np.array([x[1], 3 * t**2, 3 * t**2 * x[1]])

    def slopes(self, t, x, a, numbers, out):
        out[:] = 0.0
        out[0, self.size], out[0, self.size + 1] = 1.0, -6 * t[0]
        out[1, 1], out[1, self.size + 1] = 3 * t[0] ** 2, 6 * t[0] * x[1]
        return True


@pytest.mark.parametrize("method", LOOPS)
def test_integrals_hold_the_steps_of_loops_where_nothing_else_does(interpreted, method, monkeypatch):
    """As those of SciPy's methods, see tests/test_ledger.py."""
    monkeypatch.setitem(globals(), "START", np.zeros(2))
    _, X, _ = motion(Pushed(with_energy=True), "loop", method, end=2.0, rtol=1e-9)
    assert X[-1, 2] == pytest.approx(32.0, rel=1e-7)


def test_energies_keep_the_order_of_rodas5p(interpreted):
    """5, with the slopes of their rates; without these a step errs by the square of its length."""
    errors = {}
    for rtol in (1e-5, 1e-8):
        T, X, _ = motion(Oscillator(with_energy=True), "loop", "Rodas5P", rtol=rtol, atol=rtol)
        errors[len(T)] = np.abs(X[-1] - exact(10.0))[2]
    (few, coarse), (many, fine) = errors.items()
    assert np.log(coarse / fine) / np.log((many - 1) / (few - 1)) > 4


def test_errors_are_compared_with_the_tolerance_of_what_counts():
    """A step of Euler's that errs by (3, 4) times the tolerance, and by anything behind, has the norm 5 / sqrt(2)."""
    interval = step_control.Interval((), 0.0, 1.0, -np.inf, np.inf, 0.0, 1e-3, 2)
    E, K, x = np.array([[-1.0, 1.0]]), np.array([[0.0, 0, 0], [3e-3, 4e-3, 1e9]]), np.zeros(3)
    assert step_control.error_norm(E, K, 1.0, x, x, interval, np.zeros(3)) == pytest.approx(5 / 2**0.5, rel=4 * EPS)


def test_an_error_that_is_no_number_shortens_the_step_most():
    factors = [step_control.step_factor(error, -0.2) for error in (0.0, 1e-9, 1.0, 1e9, np.inf, np.nan)]
    assert factors == [10.0, 10.0, 0.9, 0.2, 0.2, 0.2]


def trees(order):
    """Rooted trees with so many vertices, as sorted tuples of their branches."""
    if order == 1:
        return {()}
    found = set()
    for parts in itertools.chain.from_iterable(
        itertools.combinations_with_replacement(range(1, order), k) for k in range(1, order)
    ):
        if sum(parts) == order - 1:
            found |= {tuple(sorted(branches)) for branches in itertools.product(*map(trees, parts))}
    return found


def weight_and_density(tree, A):
    """The weight of each stage in the condition of a tree, and its density: Hairer, Norsett and Wanner 1993, II.2."""
    weight, size, density = np.ones(len(A)), 1, 1
    for branch in tree:
        inner, vertices, its_density = weight_and_density(branch, A)
        weight, size, density = weight * (A @ inner), size + vertices, density * its_density
    return weight, size, density * size


def whole(table):
    """A with the end of the step, and the stages for interpolants, as further stages."""
    count = table.D.shape[1]
    A = np.zeros((count, count))
    A[: len(table.A), : table.A.shape[1]] = table.A[:, :count]
    A[len(table.B), : len(table.B)] = table.B
    for s, row in enumerate(table.A2, start=len(table.B) + 1):
        A[s, : min(len(row), count)] = row[:count]
    return A


ORDERS = {
    "RK23": (3, 2, 3),
    "RK45": (5, 4, 4),
    "DOP853": (8, 5, 7),
    "Tsit5": (5, 4, 4),
}  # of step, estimate, interpolant


@pytest.mark.parametrize("method", ORDERS)
def test_every_condition_of_order(method):
    """Of the step, of the step minus its estimated error, and of the interpolant at fractions of the step."""
    table, (order, estimate, inside) = tableaus.tableau(method), ORDERS[method]
    A, u = whole(table), np.linspace(0.1, 1.0, 7)
    b = np.append(table.B, np.zeros(len(A) - len(table.B)))
    e = np.zeros(len(A))
    e[: table.E.shape[1]] = table.E[0]
    powers = np.array([*itertools.accumulate([u if j % 2 == 0 else 1 - u for j in range(len(table.D))], np.multiply)])
    polynomials = powers.T @ table.D
    for size in range(1, order + 1):
        errors = []
        for tree in trees(size):
            weight, vertices, density = weight_and_density(tree, A)
            assert vertices == size
            interpolated = np.abs(polynomials @ weight - u**size / density).max()
            errors.append((abs(b @ weight - 1 / density), abs(e @ weight), interpolated))
        for error, kept_to in zip(np.max(errors, axis=0), (order, estimate, inside), strict=True):
            assert (error < ROUNDING) == (size <= kept_to)


class Sampler:
    """A law that pulls back, sampled every 0.1 s: u = -2 q."""

    period, delay, count, arrived, next = 0.1, (0.0, 0.0), 0, 0, 0.0
    state = next_state = np.zeros(0)
    law_table, update = NO_TABLE, SimpleNamespace(keep=1.0, gain=period)  # by Euler's rule

    def __init__(self, system):
        self.system, self.entries, self.traced = system, 1, self
        self.kernel, self.widths, self.pending = self, (1, 2), np.zeros((1, 1))
        self.numbers, self.coefficients = np.zeros(0), lambda numbers: numbers

    def address(self):
        """Of the law, as its kernel."""

        def law(t, x, numbers, found):
            found[0] = -2 * x[0]
            return True

        return law

    def bounds(self):
        return np.full((2, 1), np.inf)

    def note(self, samples, acting, states, evaluations):
        self.system.held = acting[2][-1]
        self.count, self.arrived = self.count + len(samples[0]), self.arrived + len(acting[0])
        self.next = self.period * self.count


def test_a_step_from_a_slope_that_is_not_valid_is_left_to_scipy(interpreted):
    system, answers = Oscillator(with_energy=False), iter([False])
    system.kernel.address = lambda: lambda *arguments: system.function(*arguments) and next(answers, True)
    solver = compiled_methods.CompiledSolver(base.IntegrationOptions("RK45", 1e-6, 1e-9), system.kernel)
    solver.start(system, 0.0, START, 1.0)
    assert len(solver.steps(10).T) == 2
    assert solver.note == "in machine code, 1 step by SciPy"


def test_the_torque_of_a_sample_is_told_where_its_first_step_is_left_to_scipy(interpreted):
    system, answers = Oscillator(with_energy=False), iter([False])
    system.kernel.address = lambda: lambda *arguments: system.function(*arguments) and next(answers, True)
    system.held, sampler = np.full(1, 9.0), Sampler(system)
    solver = compiled_methods.SampledSolver(base.IntegrationOptions("RK45", 1e-6, 1e-9), system.kernel, sampler)
    solver.start(system, 0.0, START, 1.0)
    assert len(solver.steps(10).T) == 2
    assert system.held == -2 * START[0]


def test_a_sample_ends_a_block_where_its_first_step_cannot_be_taken(interpreted):
    """The slope there under the torque before it is not that of the next step."""
    system, answers = Oscillator(with_energy=False), iter([False])

    def function(t, x, u, numbers, rates):
        return system.function(t, x, u, numbers, rates) and (u[0] == -2 * START[0] or next(answers, True))

    system.kernel.address = lambda: function
    system.held, sampler = np.zeros(1), Sampler(system)
    solver = compiled_methods.SampledSolver(base.IntegrationOptions("RK45", 1e-12, 1e-13), system.kernel, sampler)
    solver.start(system, 0.0, START, 0.12)
    ends = []
    while solver.is_running:
        ends.append(solver.steps(500).T[-1])
    x = START
    for duration in (0.1, 0.02):
        system.held = np.array([-2 * x[0]])
        x = scipy.integrate.solve_ivp(system, (0, duration), x, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    assert ends[0] == 0.1
    np.testing.assert_allclose(solver.x, x, rtol=0, atol=1e-11)


def test_a_method_is_its_tableau(interpreted, monkeypatch):
    """Heun's method with Euler's in SciPy, in a loop, sampled, by rows and in lanes: the same steps."""

    class Heun:
        """K. Heun 1900; the estimate is the difference from Euler's method, the interpolant is Hermite's."""

        order, error_estimator_order, n_stages = 2, 1, 2
        A, B, C = np.array([[0.0, 0], [1, 0]]), np.array([0.5, 0.5]), np.array([0.0, 1])
        E = np.array([-0.5, 0.5, 0])
        P = np.array([[1.0, -0.5, 0], [0, 0.5, 0], [0, 0, 0]])

    monkeypatch.setitem(tableaus.OWN, "Heun", Heun)
    assert issubclass(tableaus.scipy_class("Heun"), scipy.integrate.RK45)
    system, how = Oscillator(with_energy=True), {"end": 1.0, "rtol": 1e-4, "atol": 1e-4}
    T, X, middles = motion(system, "scipy", "Heun", **how)
    t, x, inside = motion(system, "loop", "Heun", **how)
    np.testing.assert_allclose(t, T, rtol=1e-9)
    np.testing.assert_allclose(x, X, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(inside, middles, rtol=1e-9, atol=1e-12)
    assert 1e-6 < np.abs(x[-1] - exact(1.0)).max() < 1e-3

    def in_all(t, states):
        return np.stack([states[1], -states[0] - DAMPING * states[1], DAMPING * states[1] ** 2])

    def valid(given, out):
        out[:] = in_all(given[0].T, given[1].T).T
        return np.ones(len(out), dtype=bool)

    def in_lanes(times, states, numbers, out):
        out[:] = in_all(times, states.reshape(3, -1)).ravel()
        return True

    kernel = SimpleNamespace(operations={}, is_unrolled=True, engine="numpy", coefficients=lambda numbers: numbers)
    kernel.traced = SimpleNamespace(widths=(1, 3, 0))
    kernel.blocks, kernel.address = SimpleNamespace(sound=valid), lambda count, common: in_lanes
    interval = step_control.Interval(
        tableaus.tableau("Heun"), 0.0, 1.0, -np.inf, np.inf, 1e-4, 1e-4, 2, t_eval=np.array([T[3], 1.0])
    )
    starts, results = np.tile(np.append(START, 0.0), (3, 1)), np.full((2, 2, 3, 3), np.nan)
    rows.run_rows(interval, kernel, np.zeros(0), np.arange(3), starts, results[0], lambda count: None)
    lanes.run_lanes(interval, kernel, np.zeros(0), starts, results[1], lambda count: None)
    np.testing.assert_allclose(results, np.broadcast_to(X[[3, -1], None], results.shape), rtol=1e-9, atol=1e-12)

    sampled = Oscillator(with_energy=True)
    sampled.held, sampler = np.zeros(1), Sampler(sampled)
    solver = compiled_methods.SampledSolver(base.IntegrationOptions("Heun", 1e-8, 1e-8), sampled.kernel, sampler)
    solver.start(sampled, 0.0, np.append(START, 0.0), 0.3)
    x = np.append(START, 0.0)
    while solver.is_running:
        steps = solver.steps(50)
    for _ in range(3):  # from sample to sample
        sampled.held = np.array([-2 * x[0]])
        x = scipy.integrate.solve_ivp(sampled, (0, 0.1), x, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    assert sampler.count == 3
    np.testing.assert_allclose(steps.X[-1], x, atol=1e-6)


def test_methods_in_machine_code_are_the_explicit_ones():
    for method in EXPLICIT_METHODS:
        table = tableaus.tableau(method)
        np.testing.assert_allclose(table.A.sum(axis=1), table.C, atol=1e-13)
        assert table.B.sum() == pytest.approx(1.0, abs=4 * EPS)
