"""Derivatives: traced ones against complex step of the recursion and against Pinocchio."""

import mpmath
import numpy as np
import pinocchio as pin
import pytest

import rne
from rne.graph.differentiation import differentiate
from rne.graph.graph import Graph
from rne.graph.program import lower
from rne.graph.scalar import inputs
from rne.kernels.python_backend import state_function
from rne.kernels.soundness import Trace

from .helpers import EPS, Part, assemble, complex_steps, kept, relative, states
from .quantities import QUANTITIES, arguments_of
from .random_robots import random_tree

EXACT = 1e-12  # of the largest entry
# As in conftest, but smaller: programs of derivatives grow with the square of the number of joints.
TREES = {
    "single": random_tree(1, seed=1),
    "serial": random_tree(4, seed=2, prismatic=0, branching=0),
    "sliders": random_tree(5, seed=3, prismatic=1),
    "mixed": random_tree(5, seed=4),
    "bushy": random_tree(8, seed=5, branching=0.8),
    "mimics": random_tree(4, seed=6, mimics=3),
}


@pytest.fixture(params=kept(TREES, ["mimics"]), scope="module")
def robot(request):
    return rne.Robot(TREES[request.param])


@pytest.mark.parametrize("name", kept(QUANTITIES, [name for name in QUANTITIES if "regressor" not in name]))
def test_derivative_is_the_complex_step_of_the_recursion(robot, name):
    function = QUANTITIES[name]
    wrt, tree = tuple(function.quantity.widths), robot.model
    if name == "articulated_forward_dynamics" and tree.has_mimics:
        with pytest.raises(rne.ModelError):
            robot.kernel(function, *wrt)
        return
    kernel, arguments = robot.kernel(function, *wrt), arguments_of(function, tree.n, 4)
    expected = complex_steps(function, tree, arguments, wrt)
    got = kernel(*arguments)
    assert got.shape == expected.shape
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(tree, arguments[0])).max() if "forward" in name else 1.0
    bound = EXACT * kappa
    size = max(np.abs(expected).max(), 1e-300)
    if "coriolis" in name:  # on a single joint everything cancels
        size = max(size, np.abs(rne.dynamics.mass_matrix(tree, arguments[0])).max())
    assert np.abs(got - expected).max() <= bound * size
    single = np.array([kernel(*s) for s in zip(*arguments, strict=True)])
    assert np.abs(single - expected).max() <= bound * size


@pytest.mark.parametrize(("masses", "armature"), [([2.0], 0.0), ([1.0], 1.0), ([0.5, 0.5], 0.0), ([2.0, 5.0], 1.0)])
def test_derivatives_by_torques_are_the_inverse_of_a_constant_mass_matrix(masses, armature):
    """Of sliders across one another; where pivots are powers of two, accelerations are products of what is solved for."""
    parts = [Part(link="root")]
    for k, mass in enumerate(masses):
        parts.append(Part(link=f"link{k}", joint=f"j{k}", kind="prismatic", parent=k, axis=np.eye(3)[k], mass=mass))
    arm = rne.Robot(assemble("gantry", parts, gravity=[1.0, 2.0, 3.0])).with_armature(armature)
    q, weights = np.zeros(arm.n), np.arange(1.0, arm.n + 1)
    inverse = np.linalg.inv(arm.mass_matrix(q))
    jacobian = rne.kernels.derivative(rne.dynamics.forward_dynamics, arm.model, "tau")(q, q, q)
    gradient = rne.kernels.gradient(rne.dynamics.forward_dynamics, arm.model, "tau")(q, q, q, weights)
    np.testing.assert_allclose(jacobian, inverse, rtol=EXACT)
    np.testing.assert_allclose(gradient, weights @ inverse, rtol=EXACT)


def test_forward_dynamics_derivatives_are_the_complex_step(robot):
    tree = robot.model
    q, qd, tau = states(tree.n, 4, rate=2.0)
    expected = complex_steps(rne.dynamics.forward_dynamics, tree, (q, qd, tau), ("q", "qd", "tau"))
    got = np.concatenate(robot.forward_dynamics_derivatives(q, qd, tau), axis=-1)
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(tree, q)).max()
    assert np.abs(got - expected).max() <= EXACT * kappa * np.abs(expected).max()


# Elementary operations of two numbers, on traced numbers and on arrays, with their derivatives by both.
OPERATIONS = {
    "sin": (lambda x, y: (x * y).sin(), lambda x, y: (y * np.cos(x * y), x * np.cos(x * y))),
    "cos": (lambda x, y: (x + 2 * y).cos(), lambda x, y: (-np.sin(x + 2 * y), -2 * np.sin(x + 2 * y))),
    "sqrt": (lambda x, y: (x * x + y * y).sqrt(), lambda x, y: (x / np.hypot(x, y), y / np.hypot(x, y))),
    "tanh": (lambda x, y: (x - y).tanh(), lambda x, y: (np.cosh(x - y) ** -2, -(np.cosh(x - y) ** -2))),
    "divide": (lambda x, y: x / y, lambda x, y: (1 / y, -x / y**2)),
    "abs": (lambda x, y: abs(x * y), lambda x, y: (np.sign(x * y) * y, np.sign(x * y) * x)),
    "minimum": (lambda x, y: x.minimum(3 * y), lambda x, y: (1, 0) if x < 3 * y else (0, 3)),
    "maximum": (lambda x, y: x.maximum(3 * y), lambda x, y: (1, 0) if x > 3 * y else (0, 3)),
    "where": (lambda x, y: (x < y).where(x * x, -y), lambda x, y: (2 * x, 0) if x < y else (0, -1)),
    "sign": (lambda x, y: x.sign() * y, lambda x, y: (0, np.sign(x))),
    "negative": (lambda x, y: -(x - y).maximum(y), lambda x, y: (-1, 1) if x - y > y else (0, -1)),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_derivative_of_every_elementary_operation_is_that_of_the_textbook(name):
    operation, slopes = OPERATIONS[name]
    graph = Graph()
    result = operation(*inputs(graph, (2,), 0))
    program = lower(graph, differentiate(graph, "jacobian", [result.ref], [0, 1], 2), 2)
    function = state_function(Trace(program, (2,), (2,)))
    for x, y in np.random.default_rng(0).uniform(-2, 2, (20, 2)):
        np.testing.assert_allclose(function(np.array([x, y])), slopes(x, y), rtol=1e-13, atol=1e-15)


def test_linearize_predicts_the_change_of_the_motion(irb140):
    q, qd, tau = states(6, rate=1.0)
    A, B = irb140.linearize(q, qd, tau)
    rng = np.random.default_rng(0)
    dx, du, h = rng.normal(size=12), rng.normal(size=6), 1e-6

    def motion(s):
        x = np.concatenate([q, qd]) + s * dx
        return np.concatenate([x[6:], irb140.forward_dynamics(x[:6], x[6:], tau + s * du)])

    difference = (motion(h) - motion(-h)) / (2 * h)
    assert relative((A @ dx + B @ du)[None], difference[None]) <= 1e-7
    assert A.shape == (12, 12)
    assert irb140.linearize(np.stack([q, q]), qd, tau)[1].shape == (2, 12, 6)


def test_derivatives_of_the_irb140_are_pinocchios(irb140, irb140_oracle):
    oracle = irb140_oracle
    q, qd, qdd = states(6, 20)
    ours = irb140.inverse_dynamics_derivatives(q, qd, qdd)
    forward = irb140.forward_dynamics_derivatives(q, qd, irb140.inverse_dynamics(q, qd, qdd))
    for k in range(20):
        theirs = pin.computeRNEADerivatives(oracle.theirs, oracle.data, q[k], qd[k], qdd[k])
        for a, b in zip(ours, theirs, strict=True):
            assert relative(a[k][None], np.asarray(b)[None]) <= EXACT
        tau = irb140.inverse_dynamics(q[k], qd[k], qdd[k])
        pin.computeABADerivatives(oracle.theirs, oracle.data, q[k], qd[k], tau)
        kappa = np.linalg.cond(irb140.mass_matrix(q[k]))
        M_inverse = np.triu(oracle.data.Minv)
        M_inverse = M_inverse + np.triu(M_inverse, 1).T
        for a, b in zip(forward, (oracle.data.ddq_dq, oracle.data.ddq_dv, M_inverse), strict=True):
            assert relative(a[k][None], np.asarray(b)[None]) <= 100 * kappa * EPS


def test_a_large_robot_takes_the_complex_step(monkeypatch):
    from rne.kernels import trace as module

    model = random_tree(4, 2)
    traced = rne.kernels.derivative(rne.dynamics.bias_torque, model, "q", "qd")
    monkeypatch.setattr(module, "LIMIT", 10)
    stepped = rne.kernels.derivative(rne.dynamics.bias_torque, model, "q", "qd")
    assert stepped.operations == {}
    s = states(4, 6)[:2]
    assert relative(stepped(*s), traced(*s)) <= EXACT


def test_wrong_arguments_are_named(irb140):
    with pytest.raises(ValueError, match=r"^`wrt` must name arguments of \['q', 'qd'\], got 'tau'$"):
        rne.kernels.derivative(rne.dynamics.bias_torque, irb140.model, "tau")
    with pytest.raises(ValueError, match=r"^`wrt` must name at least one argument of \['q', 'qd'\]$"):
        rne.kernels.derivative(rne.dynamics.bias_torque, irb140.model)
    with pytest.raises(ValueError, match=r"^`q` must be finite, got nan at index \(2,\)$"):
        irb140.inverse_dynamics_derivatives([0, 0, np.nan, 0, 0, 0], [0] * 6, [0] * 6)


def test_derivatives_in_long_double_are_exact_to_it(irb140):
    """Against differences of 60 digits."""
    q = states(6)[0].astype(np.longdouble)
    got = irb140.kernel(rne.dynamics.gravity_torque, "q")(q)
    with mpmath.workdps(60):
        h, exact = mpmath.mpf(10) ** -20, np.vectorize(lambda x: mpmath.mpf(float(x)), otypes=[object])(q)
        steps = [h * np.eye(6, dtype=int)[j] for j in range(6)]
        slopes = [
            (
                rne.dynamics.gravity_torque(irb140.model, exact + e)
                - rne.dynamics.gravity_torque(irb140.model, exact - e)
            )
            / (2 * h)
            for e in steps
        ]
        reference = np.vectorize(lambda x: np.longdouble(mpmath.nstr(x, 25)))(np.stack(slopes, axis=1))
    assert got.dtype == np.longdouble
    assert np.abs(got - reference).max() <= 100 * np.finfo(np.longdouble).eps * np.abs(reference).max()


def test_derivatives_in_long_double_agree_with_those_in_double(irb140):
    q, qd, tau = (x.astype(np.longdouble) for x in states(6, 3))
    A, B = irb140.linearize(q, qd, tau)
    plain = irb140.linearize(*(x.astype(float) for x in (q, qd, tau)))
    assert A.dtype == B.dtype == np.longdouble
    kappa = np.linalg.cond(irb140.mass_matrix(q.astype(float))).max()
    assert relative(A.astype(float), plain[0]) <= 100 * kappa * EPS
    assert relative(B.astype(float), plain[1]) <= 100 * kappa * EPS
