"""Gradients and Hessians of weighted sums: against 100 digits, complex steps, Jacobians, and each other."""

import itertools
import warnings
from dataclasses import replace
from functools import cache

import mpmath
import numpy as np
import pytest

import rne
from rne import elementwise
from rne.graph.differentiation import differentiate
from rne.graph.graph import Graph
from rne.graph.program import evaluate, lower
from rne.graph.scalar import inputs
from rne.kernels import gradient, hessian, hessian_product

from .helpers import EPS, Part, assemble, gimbal, kept, loaded, relative, states
from .quantities import QUANTITIES, arguments_of
from .random_robots import random_tree

SMALL = {
    "serial": {"n": 3, "seed": 2, "prismatic": 0, "branching": 0},
    "mixed": {"n": 3, "seed": 4},
    "mimics": {"n": 2, "seed": 6, "mimics": 2},
    "pair": {"n": 2, "seed": 5},
}
ARMS = ("irb140", "ur5", "panda", "talos_left_arm")
DIGITS, STEP = 100, mpmath.mpf(10) ** -25  # the truncation of differences ahead, whose rounding is 1e-50


@cache
def small(name):
    return rne.Robot(random_tree(**SMALL[name]))


def exact(x):
    return np.vectorize(mpmath.mpf, otypes=[object])(np.asarray(x, dtype=float))


def nearest(x):
    """Numbers of many digits as doubles."""
    return np.asarray(x, dtype=object).astype(float)


# Operations of two numbers, on traced ones and on others; the derivative rules of all kinds occur.
OPERATIONS = {
    "sin": lambda x, y: np.sin(x * y) * x,
    "cos": lambda x, y: np.cos(x + 2 * y) * y,
    "sqrt": lambda x, y: np.sqrt(x * x + y * y),
    "tanh": lambda x, y: elementwise.tanh(x - y)[()] * x,
    "exp": lambda x, y: elementwise.exp(x * y)[()],
    "divide": lambda x, y: x / (2 + y * y) - y / (x * x + 1),
    "arctan2": lambda x, y: elementwise.arctan2(x * x, y)[()] * y,
    "abs": lambda x, y: abs(x * y) * x,
    "minimum": lambda x, y: elementwise.minimum(x * y, 3 * y)[()] * x,
    "maximum": lambda x, y: elementwise.maximum(x * x, 3 * y)[()] * y,
    "where": lambda x, y: elementwise.where(elementwise.less(x, y), x * x * y, -y * y)[()],
    "sign": lambda x, y: elementwise.sign(x)[()] * y * y,
    "negative": lambda x, y: -elementwise.maximum(x - y, y)[()] * x,
}


def traced(operation, order):
    """A derivative of w times an operation of (x, y) as a function of rows (x, y, w)."""
    graph = Graph()
    result = operation(*inputs(graph, (2,), 0))
    outputs = [result.ref] if order == "values" else differentiate(graph, order, [result.ref], [0, 1], 2)
    program = lower(graph, outputs, 3)
    return lambda rows: evaluate(program, len(outputs), rows)


@pytest.mark.parametrize("name", OPERATIONS)
def test_rules_of_every_operation_are_those_of_the_textbook(name):
    """First and second derivatives against differences of 60 digits of the operation itself."""
    rng = np.random.default_rng(0)
    rows = np.column_stack([rng.uniform(-2, 2, (6, 2)), rng.uniform(0.5, 2, 6)])
    value, slopes, bends = (traced(OPERATIONS[name], order) for order in ("values", "gradient", "hessian"))
    with mpmath.workdps(60):
        numbers, h = exact(rows), mpmath.mpf(10) ** -15

        def of(k, l=None, signs=(1, 1)):
            moved = numbers.copy()
            moved[:, k] += signs[0] * h
            if l is not None:
                moved[:, l] += signs[1] * h
            return numbers[:, 2] * value(moved)[:, 0]

        first = [(of(k) - of(k, signs=(-1, 1))) / (2 * h) for k in range(2)]
        second = [
            (of(k, l) - of(k, l, (1, -1)) - of(k, l, (-1, 1)) + of(k, l, (-1, -1))) / (4 * h * h)
            for k in range(2)
            for l in range(2)
        ]
        first, second = (nearest(np.stack(d, axis=-1)) for d in (first, second))
    np.testing.assert_allclose(slopes(rows), first, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(bends(rows), second, rtol=1e-13, atol=1e-13)


def test_what_where_does_not_take_contributes_nothing():
    """Not even where its own slope is infinite, as those of a root, a quotient and an angle are at 0."""
    for hidden in (
        lambda x: np.sqrt(x),
        lambda x: np.sqrt(abs(x)),
        lambda x: 1.0 / x,
        lambda x: (1.0 / x) * (2.0 + x),
        lambda x: elementwise.exp(1.0 / x)[()] * x,
        lambda x: elementwise.arctan2(x, x)[()],
    ):

        def operation(x, y, hidden=hidden):
            return elementwise.where(elementwise.less(0.0, x), hidden(x), x * y)[()]

        with np.errstate(all="ignore"):
            np.testing.assert_array_equal(traced(operation, "gradient")(np.array([[0.0, 3.0, 2.0]])), [[6.0, 0.0]])
            np.testing.assert_array_equal(
                traced(operation, "hessian")(np.array([[0.0, 3.0, 2.0]])), [[0.0, 2.0, 2.0, 0.0]]
            )


def test_slopes_at_ties_are_those_of_the_side_that_is_documented():
    """A constant's, so that a limit acts at its value; of two others that of the one traced later; 0 of abs at 0."""
    for limited in (
        lambda x, y: elementwise.minimum(x, 1.0)[()] + 0 * y,
        lambda x, y: elementwise.maximum(x, 1.0)[()] + 0 * y,
        lambda x, y: abs(x - 1.0),
    ):
        assert traced(limited, "gradient")(np.array([[1.0, 0.0, 1.0]])).tolist() == [[0.0, 0.0]]
    later = lambda x, y: elementwise.minimum(x, y)[()]  # noqa: E731
    assert traced(later, "gradient")(np.array([[1.0, 1.0, 1.0]])).tolist() == [[0.0, 1.0]]


def reference(robot, function, arrays, weights):
    """Gradient of weights . function by the recursion in 100 digits, and a function of its change in a direction."""
    quantity_of = [np.asarray(a) for a in arrays]
    sizes = [a.shape[-1] for a in quantity_of]

    def value(x):
        parts = np.split(x, np.cumsum(sizes)[:-1], axis=-1)
        fixed = {"parameters": parts.pop()} if len(parts) > len(function.quantity.widths) else {}
        return (function.evaluate(robot.model, *parts, **fixed)[0] * exact(weights)).sum(-1)

    def slopes(x):
        values = value(np.vstack([x, x + STEP * np.eye(len(x), dtype=int)]))
        return (values[1:] - values[0]) / STEP

    x = exact(np.concatenate(quantity_of))
    here = slopes(x)
    return here, lambda v: (slopes(x + STEP * v) - here) / STEP


def check_against_recursion(robot, function, parameters, seed):
    """Errors of gradient and Hessian, relative to the largest entry of each block, in units of n eps."""
    rng = np.random.default_rng(seed)
    arrays = list(states(robot.n, seed=seed, rate=3.0, acceleration=10.0))
    fixed = {"parameters": True} if parameters else {}
    arrays += [robot.parameters.ravel()] if parameters else []
    weights = rng.normal(size=robot.n)
    blocks = np.split(np.arange(sum(map(len, arrays))), np.cumsum(list(map(len, arrays)))[:-1])
    first = gradient(function, robot.model, **fixed)(*arrays, weights)
    second = hessian(function, robot.model, **fixed)(*arrays, weights)
    assert np.array_equal(second, second.T)
    errors = []
    with mpmath.workdps(DIGITS):
        expected, change = reference(robot, function, arrays, weights)
        expected = nearest(expected)
        largest = np.abs(expected).max()

        def size(block):
            """Its largest entry; of a block that is zero but for the rounding of the differences, that of all."""
            found = np.abs(block).max()
            return found if found > 1e-30 * largest else largest

        for block in blocks:
            errors.append(np.abs(first[block] - expected[block]).max() / size(expected[block]))
            direction = np.zeros(len(first))
            direction[block] = rng.choice([-1.0, 1.0], len(block))
            along = nearest(change(exact(direction)))
            for rows in blocks:
                entries = second[np.ix_(rows, block)] if np.abs(along[rows]).max() > 1e-30 * largest else along[rows]
                errors.append(np.abs(second[rows] @ direction - along[rows]).max() / (size(entries) * len(block)))
    return max(errors) / (robot.n * EPS)


@pytest.mark.parametrize(
    ("name", "parameters"),
    kept([("mimics", False), ("mimics", True), ("pair", True)], [("mimics", False), ("pair", True)]),
)
def test_inverse_dynamics_against_the_recursion_in_100_digits(name, parameters):
    assert check_against_recursion(small(name), rne.dynamics.inverse_dynamics, parameters, 1) <= 100


@pytest.mark.long
@pytest.mark.parametrize("seed", range(40))
def test_random_trees_against_the_recursion_in_100_digits(seed):
    robot = rne.Robot(random_tree(2 + seed % 3, seed, mimics=seed % 2, prismatic=0.25 * (seed % 4)))
    for parameters in (False, True):
        assert check_against_recursion(robot, rne.dynamics.inverse_dynamics, parameters, seed) <= 100


@pytest.mark.long
@pytest.mark.parametrize("name", ARMS)
def test_arms_against_the_recursion_in_100_digits(name):
    assert check_against_recursion(loaded(name), rne.dynamics.inverse_dynamics, False, 3) <= 100


@pytest.mark.parametrize("name", kept([*SMALL, "ur5"], ["pair"]))
def test_forward_dynamics_against_the_recursion_in_100_digits(name):
    robot = loaded(name) if name == "ur5" else small(name)
    kappa = np.linalg.cond(robot.mass_matrix(states(robot.n, seed=2)[0]))
    assert check_against_recursion(robot, rne.dynamics.forward_dynamics, False, 2) <= 100 * kappa


FORWARD = [rne.dynamics.forward_dynamics, rne.dynamics.articulated_forward_dynamics]


def coaxial(light):
    """Two joints of one axis, a body of a given mass [kg] between them, and a third joint across."""
    z = np.eye(3)
    bodies = [(z[1], light, [0.1, 0.05, 0.2]), (z[1], 2.0, [0.3, 0.1, 0.1]), (z[0], 1.0, [0.1, 0.2, 0.1])]
    parts = [
        Part(
            link=f"l{k}",
            joint=f"j{k}",
            kind="revolute",
            parent=k,
            axis=axis,
            mass=mass,
            com=np.array(com),
            inertia=mass * 0.1 * np.eye(3),
        )
        for k, (axis, mass, com) in enumerate(bodies)
    ]
    return assemble("coaxial", [Part(link="base"), *parts])


@pytest.mark.parametrize("function", FORWARD, ids=lambda f: f.__name__)
def test_derivatives_keep_the_digits_of_forward_dynamics_where_m_is_nearly_singular(function):
    """Through what solves for the accelerations, such as M's factors, a slope would lose twice as many."""
    model = coaxial(1e-8)
    q, qd, tau = states(3, 5, seed=1, rate=1.0)
    weights = np.random.default_rng(0).normal(size=(5, 3))
    digits = rne.dynamics.diagnose(model, q, qd, tau).digits.min()
    assert 6 < digits < 8
    rows = np.concatenate([q, qd, tau, weights], axis=-1)
    for make, worst in ((gradient, digits - 0.5), (hessian, digits - 1.5)):
        kernel = make(function, model)
        program, entries = kernel.traced.program, kernel.traced.entries
        with mpmath.workdps(DIGITS):
            truth = nearest(evaluate(program, entries, exact(rows)))
        assert relative(kernel(q, qd, tau, weights).reshape(5, -1), truth) < 10**-worst


def test_the_warning_of_few_digits_is_that_of_the_derivative():
    q, qd, tau = states(3, seed=1, rate=1.0)
    kernel = hessian(rne.dynamics.forward_dynamics, coaxial(2e-13))
    with pytest.warns(
        rne.PrecisionWarning, match=r"^the Hessian of forward_dynamics by q, qd, tau keeps about \d digits: "
    ):
        kernel(q, qd, tau, np.ones(3))


@pytest.mark.parametrize("tree", kept(SMALL, ["pair"]))
@pytest.mark.parametrize("name", QUANTITIES)
def test_gradients_are_weighted_jacobians_and_hessians_their_complex_steps(name, tree):
    function, robot = QUANTITIES[name], small(tree)
    if name == "articulated_forward_dynamics" and robot.model.has_mimics:
        return
    wrt, arrays = tuple(function.quantity.widths), arguments_of(function, robot.n, 3, rate=2.0)
    jacobian = rne.kernels.derivative(function, robot.model, *wrt)(*arrays)
    k, entries = jacobian.shape[-1], int(np.prod(jacobian.shape[1:-1]))
    rng = np.random.default_rng(1)
    weights, vector = rng.normal(size=(3, entries)), rng.normal(size=(3, k))
    first = gradient(function, robot.model)
    assert first.names == (*wrt, "weights")
    expected = np.einsum("se,sek->sk", weights, jacobian.reshape(3, entries, k))
    kappa = np.linalg.cond(robot.mass_matrix(arrays[0])).max() if "forward" in name or "solve" in name else 1.0
    scale = np.einsum("se,sek->sk", abs(weights), abs(jacobian.reshape(3, entries, k))).max()
    assert np.abs(first(*arrays, weights) - expected).max() <= 1e-13 * kappa * scale
    second = hessian(function, robot.model)(*arrays, weights)
    assert np.array_equal(second, np.swapaxes(second, -1, -2))
    steps = 1e-30j * np.eye(k)
    stepped = [a[:, None] + step for a, step in zip(arrays, np.split(steps, len(arrays), axis=1), strict=True)]
    columns = first(*stepped, weights[:, None]).imag / 1e-30
    tolerance = 1e-12 * kappa * max(np.abs(columns).max(), scale)
    assert np.abs(second - columns).max() <= tolerance
    product = hessian_product(function, robot.model)(*arrays, weights, vector)
    assert np.abs(product - np.einsum("sij,sj->si", second, vector)).max() <= k * tolerance


@pytest.mark.parametrize("name", kept(["pair", "ur5"], ["pair"]))
@pytest.mark.parametrize("make", [gradient, hessian, hessian_product])
def test_engines_batches_types_and_text_are_those_of_every_kernel(make, name):
    pytest.importorskip("numba")
    robot = loaded(name) if name == "ur5" else small(name)
    n, k = robot.n, 3 * robot.n
    arrays = list(states(n, 40, rate=2.0))
    rng = np.random.default_rng(0)
    arrays += [rng.normal(size=(40, n)), *([rng.normal(size=(40, k))] if make is hessian_product else [])]
    plain, native = (make(rne.dynamics.inverse_dynamics, robot.model, engine=engine) for engine in ("numpy", "numba"))
    expected = plain(*arrays)
    assert relative(native(*arrays), expected) <= 20 * EPS
    assert relative(native(*(a[0] for a in arrays))[None], expected[:1]) <= 20 * EPS
    out = np.empty_like(expected)
    assert native(*arrays, out=out, workers=2) is out
    assert relative(out, expected) <= 20 * EPS
    assert plain(*(a.astype(np.float32) for a in arrays)).dtype == np.float32
    assert plain(*arrays[:-1], arrays[-1][0]).shape == expected.shape  # the same weights for all
    single = plain(*(a[:4].astype(np.longdouble) for a in arrays))
    assert single.dtype == np.longdouble
    assert relative(single.astype(float), expected[:4]) <= 100 * EPS
    namespace = {}
    exec(plain.source("numpy"), namespace)
    name = plain.source().split("def ")[1].split("(")[0]
    assert relative(namespace[name](*arrays), expected) <= 20 * EPS


def test_robots_have_them_as_methods():
    robot = small("pair")
    q, qd, qdd = states(2, 4, rate=2.0)
    weights = np.random.default_rng(0).normal(size=(4, 2))
    for kind, x in (("inverse", qdd), ("forward", robot.inverse_dynamics(q, qd, qdd))):
        jacobian = np.concatenate(getattr(robot, f"{kind}_dynamics_derivatives")(q, qd, x), axis=-1)
        slopes = getattr(robot, f"{kind}_dynamics_gradient")(q, qd, x, weights)
        assert relative(slopes, np.einsum("si,sij->sj", weights, jacobian)) <= 1e-12
        bends = getattr(robot, f"{kind}_dynamics_hessian")(q, qd, x, weights)
        h = 1e-6
        ahead, behind = (getattr(robot, f"{kind}_dynamics_gradient")(q + s * h, qd, x, weights) for s in (1, -1))
        assert relative(bends[:, :, :2].sum(-1), (ahead - behind) / (2 * h)) <= 1e-7
    assert robot.kernel(rne.dynamics.inverse_dynamics, order="gradient").order == "gradient"
    with pytest.raises(ValueError, match=r"^`order` must be one of \['gradient', 'hessian', 'hessian_product'\], got"):
        robot.kernel(rne.dynamics.inverse_dynamics, order="second")


class TestStatesThatTheProgramRefuses:
    def test_a_singular_m_is_the_error_of_the_function(self):
        for make in (gradient, hessian):
            kernel = make(rne.dynamics.forward_dynamics, gimbal())
            with pytest.raises(rne.SingularMassMatrixError, match="'outer', 'inner'"):
                kernel([0.3, 0.0, 0.2], *np.ones((3, 3)))

    def test_so_is_an_m_that_is_singular_in_every_state(self):
        """The program of the derivatives divides by a constant that is 0."""
        model = small("pair").model
        last = np.arange(model.nb) < model.nb - 1
        model = replace(model, mass=model.mass * last, inertia=model.inertia * last[:, None, None])
        for make in (hessian, hessian_product):
            kernel = make(rne.dynamics.forward_dynamics, model)
            vectors = [np.ones(width) for width in kernel.widths]
            with pytest.raises(rne.SingularMassMatrixError, match="M is singular: nothing with inertia moves"):
                kernel(*vectors)

    def test_fast_states_are_judged_by_the_function_and_run_by_the_program(self):
        robot = small("pair")
        q, qd, tau = states(2, 4)
        weights = np.ones((4, 2))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rne.PrecisionWarning)
            fast = robot.forward_dynamics_gradient(q, 1e4 * qd, tau, weights)
            slopes = np.concatenate(robot.forward_dynamics_derivatives(q, 1e4 * qd, tau), axis=-1)
        assert relative(fast, slopes.sum(1)) <= 1e-11

    def test_arguments_that_are_not_finite_are_named(self):
        robot = small("serial")
        for make in (gradient, hessian):
            kernel = make(rne.dynamics.inverse_dynamics, robot.model)
            with pytest.raises(ValueError, match=r"^`weights` must be finite, got nan at index \(1,\)$"):
                kernel(*np.zeros((3, 3)), [0, np.nan, 0])
            with pytest.raises(ValueError, match=r"^`q` must be finite, got inf at index \(0,\)$"):
                kernel([np.inf, 0, 0], *np.zeros((3, 3)))
            with pytest.raises(ValueError, match=r"^`weights` must have shape \(\.\.\., 3\) for robot 'tree3-2', got"):
                kernel(*np.zeros((3, 3)), np.zeros(4))

    def test_a_slope_that_is_infinite_is_an_error(self):
        root = rne.traceable(lambda q: np.sqrt(q[0]))
        with pytest.raises(rne.NotFiniteError, match="is not finite"):
            gradient(root, small("serial").model)([0.0, 0.0, 0.0])


def test_large_programs(monkeypatch):
    """A gradient by complex steps, and no Hessian: the error has the count."""
    from rne.kernels import trace as module

    model = random_tree(3, 2)
    arrays, weights = states(3, 4)[:2], np.random.default_rng(0).normal(size=(4, 3))
    expected = gradient(rne.dynamics.bias_torque, model)(*arrays, weights)
    monkeypatch.setattr(module, "LIMIT", 150)
    stepped = gradient(rne.dynamics.bias_torque, model)
    assert stepped.operations == {}
    assert relative(stepped(*arrays, weights), expected) <= 1e-12
    assert stepped(*(a[0] for a in arrays), weights[0]).shape == (6,)
    with pytest.raises(
        TypeError, match=r"^the Hessian of bias_torque by q, qd takes more than [0-9]+ operations; at most "
    ):
        hessian(rne.dynamics.bias_torque, model)


class TestFunctionsOfYourOwn:
    def test_a_sum_of_thousands_of_terms(self):
        """Longer than Python's stack: their signs are moved from one to the next."""
        series = rne.traceable(lambda q: sum(-abs(q[0] - k) for k in range(1500)))
        np.testing.assert_array_equal(gradient(series, small("pair").model)([-1.0, 0.0]), [1500.0, 0.0])

    def test_a_cost_of_torques_poses_and_states(self):
        robot = small("pair")

        @rne.traceable
        def cost(q, qd, qdd):
            tau, hand = robot.inverse_dynamics(q, qd, qdd), robot.link_poses(q)[-1]
            return tau @ tau + 10 * (hand[0, 3] - 0.3) ** 2 + elementwise.maximum(abs(qd) - 0.5, 0.0).sum()

        arrays = [a[0] for a in states(2, 1, rate=1.0)]
        slopes, bends = gradient(cost, robot.model), hessian(cost, robot.model)
        h = 1e-6
        for k, e in enumerate(h * np.eye(6)):
            ahead, behind = (np.split(np.concatenate(arrays) + s * e, 3) for s in (1, -1))
            difference = (cost(*ahead) - cost(*behind)) / (2 * h)
            assert slopes(*arrays)[k] == pytest.approx(difference, rel=1e-6, abs=1e-6 * abs(slopes(*arrays)).max())
            difference = (slopes(*ahead) - slopes(*behind)) / (2 * h)
            np.testing.assert_allclose(bends(*arrays)[k], difference, rtol=0, atol=1e-7 * np.abs(bends(*arrays)).max())
        batch = [np.stack([a, a]) for a in arrays]
        np.testing.assert_array_equal(slopes(*batch)[1], slopes(*batch)[0])
        np.testing.assert_allclose(2 * slopes(*arrays), slopes(*arrays, [2.0]), rtol=1e-14)
        assert rne.compile(cost, robot.model)(*arrays) == pytest.approx(cost(*arrays), rel=1e-13)

    def test_what_cannot_be_traced_is_an_error_that_says_why(self):
        model = small("mixed").model
        with pytest.raises(TypeError, match=r"marked by rne\.traceable, got "):
            gradient(lambda q: q.sum(), model)
        with pytest.raises(TypeError, match=r"must have names of \['q', .*\], got \['x'\]$"):
            gradient(rne.traceable(lambda x: x.sum()), model)
        with pytest.raises(TypeError, match="a branch"):
            gradient(rne.traceable(lambda q: q[0] if q[0] > 0 else 0.0), model)
        noise = np.random.default_rng(0)
        with pytest.raises(TypeError, match=r"has memory, noise or a branch$"):
            gradient(rne.traceable(lambda q: q[0] * noise.normal()), model)
        calls = itertools.count()
        with pytest.raises(TypeError, match=r"^`function`, traced, differs by \S+e-0[67] from a call: it has memory, "):
            gradient(rne.traceable(lambda q: q[0] + 1e-7 * next(calls)), model)


def test_derivatives_within_a_traced_law_are_derivatives():
    """Once the values of the function in their place, in silence."""
    robot = small("serial")
    slope = robot.kernel(rne.dynamics.gravity_torque, "q")
    pull = robot.kernel(rne.dynamics.potential_energy, order="gradient")
    law = rne.traceable(lambda t, q, qd: -slope(q) @ qd - pull(q, np.ones(1)))
    called = lambda t, q, qd: -slope(q) @ qd - robot.gravity_torque(q)  # noqa: E731
    ends = [
        rne.simulate(rne.Scene(robot, controller=u), [0.1] * 3, [0.2] * 3, 0.1, method="RK45").q[-1]
        for u in (law, called)
    ]
    np.testing.assert_allclose(*ends, atol=1e-7)


def test_scenes_have_them():
    """Of the right-hand side with friction and a law: along a random direction, against differences."""
    robot = small("pair")
    law = rne.control.pd_gravity(robot, 20.0, 4.0, [0.3, 0.2])
    friction = rne.Friction(viscous=1.0, coulomb=0.5, smoothing=0.05)
    scene = rne.Scene(robot, controller=law, friction=friction)
    dynamics = scene.dynamics
    rates = dynamics.right_hand_side
    slopes, bends = (make(rates, robot.model, "x", numbers=dynamics.vector) for make in (gradient, hessian))
    rng = np.random.default_rng(0)
    x, v = rng.uniform(-0.5, 0.5, (2, dynamics.size))
    weights, h, t = rng.normal(size=slopes.widths[-1]), 1e-6, np.zeros(1)

    def value(x):
        return rates.evaluate(robot.model, t, x, dynamics.vector)[0] @ weights

    assert slopes(t, x, weights) @ v == pytest.approx((value(x + h * v) - value(x - h * v)) / (2 * h), rel=1e-6)
    ahead, behind = slopes(t, x + h * v, weights), slopes(t, x - h * v, weights)
    difference = (ahead - behind) / (2 * h)
    np.testing.assert_allclose(bends(t, x, weights) @ v, difference, atol=1e-6 * np.abs(difference).max())
