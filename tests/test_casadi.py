"""Kernels and scenes as CasADi functions: values, CasADi's own derivatives of them, motions, saving, refusals."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

import rne
from rne.graph.program import ON_ARRAYS, Instruction, Operand, Program, evaluate
from rne.kernels import Kernel
from rne.kernels.soundness import Trace

from .helpers import EPS, kept, loaded
from .quantities import QUANTITIES, arguments_of
from .random_robots import random_tree

ca = pytest.importorskip("casadi", reason="CasADi is not installed")

ROBOTS = {
    "mixed": lambda: rne.Robot(random_tree(2, seed=5, prismatic=0.5)),
    "mimics": lambda: rne.Robot(random_tree(2, seed=6, mimics=2)),
    **{name: lambda name=name: loaded(name) for name in ("irb140", "ur5", "panda", "kinova", "xarm7", "z1")},
}
SHORT = ("mixed", "mimics")
SLOPES = 100  # a derivative's error, in those of its function: it has as many times the operations, and cancels more


@pytest.fixture(scope="module", params=kept(ROBOTS, SHORT))
def robot(request):
    return ROBOTS[request.param]()


def loss(robot, q, name):
    """The error that a result may have beyond rounding: M is solved with once, and twice in a derivative."""
    return np.linalg.cond(robot.mass_matrix(q)).item() if "forward" in name else 1.0


def matrix(kernel, result):
    """A kernel's result in the shape that it has in CasADi."""
    return np.reshape(result, (-1, kernel.traced.shape[-1]) if result.ndim > 1 else (-1, 1))


def slopes(function, arguments):
    """CasADi's Jacobian of a function by its arguments side by side, with rows as those of a kernel."""
    symbols = [ca.SX.sym(name, len(a)) for name, a in zip(function.name_in(), arguments, strict=True)]
    result = ca.vec(function(*symbols).T)
    return ca.Function("slopes", symbols, [ca.jacobian(result, ca.vertcat(*symbols))])(*arguments).full()


@pytest.mark.parametrize("name", QUANTITIES)
def test_values_and_slopes_are_those_of_the_kernels(robot, name):
    function = QUANTITIES[name]
    wrt = tuple(function.quantity.widths)
    if name == "articulated_forward_dynamics" and robot.model.has_mimics:
        return  # which refuses them
    arguments = arguments_of(function, robot.n)
    kernel = robot.kernel(function)
    if not kernel.is_unrolled:
        with pytest.raises(TypeError, match="too large to be written out"):
            kernel.to_casadi()
        return
    made = kernel.to_casadi()
    assert made.name_in() == list(kernel.names)
    assert made.name_out() == ["result"]
    expected, found = kernel(*arguments), made(*arguments).full()
    assert found.shape == matrix(kernel, expected).shape
    bound = 8 * robot.n * EPS * loss(robot, arguments[0], name)
    size = max(np.abs(expected).max(), 1e-300)
    assert np.abs(found - matrix(kernel, expected)).max() <= bound * size
    derivative = robot.kernel(function, *wrt)
    if derivative.is_unrolled:
        expected = derivative(*arguments)
        own = derivative.to_casadi()(*arguments).full()
        assert own.shape == matrix(derivative, expected).shape
        expected = expected.reshape(found.size, -1)
        assert np.abs(own.reshape(expected.shape) - expected).max() <= bound * loss(robot, arguments[0], name) * max(
            np.abs(expected).max(), 1e-300
        )
        size = max(np.abs(expected).max(), size)
        assert (
            np.abs(slopes(made, arguments) - expected).max() <= SLOPES * bound * loss(robot, arguments[0], name) * size
        )


ORDERS = {order: getattr(rne.kernels, order) for order in ("gradient", "hessian", "hessian_product")}


@pytest.mark.parametrize(
    "name", kept(["inverse_dynamics", "forward_dynamics", "kinetic_energy", "mass_matrix"], ["inverse_dynamics"])
)
def test_second_derivatives_are_those_of_the_kernels(robot, name):
    """CasADi's Hessian of our function, and our own orders of derivatives as its functions."""
    function = QUANTITIES[name]
    if name == "forward_dynamics" and robot.n > 7:
        return
    arguments = arguments_of(function, robot.n, rate=1.0, acceleration=5.0)
    made = robot.kernel(function).to_casadi()
    x = ca.SX.sym("x", sum(map(len, arguments)))
    weights = ca.SX.sym("weights", made.numel_out(0))
    parts = ca.vertsplit(x, np.cumsum([0, *map(len, arguments)]).tolist())
    total = ca.dot(weights, ca.vec(made(*parts).T))
    bends = ca.Function("bends", [x, weights], [ca.hessian(total, x)[0]])
    rng = np.random.default_rng(1)
    w, v = rng.uniform(-1, 1, made.numel_out(0)), rng.uniform(-1, 1, x.numel())
    kernels = {order: make(function, robot.model) for order, make in ORDERS.items()}
    expected = kernels["hessian"](*arguments, w)
    bound = SLOPES**2 * robot.n * EPS * loss(robot, arguments[0], name) ** 2 * np.abs(expected).max()
    assert np.abs(bends(np.concatenate(arguments), w).full() - expected).max() <= bound
    for kernel in kernels.values():
        given = *arguments, w, *([v] if kernel.order == "hessian_product" else [])
        expected, found = kernel(*given), kernel.to_casadi()(*given)
        assert np.abs(found.full() - matrix(kernel, expected)).max() <= bound
    assert made.name_in() + ["weights"] == kernels["hessian"].to_casadi().name_in()


def test_zeros_of_jacobians_and_hessians_are_structural():
    robot = loaded("irb140")
    jacobian = robot.kernel(rne.dynamics.gravity_torque, "q").to_casadi()
    assert jacobian.sparsity_out(0).nnz() < 25  # of 36: nothing depends on joint 1
    assert robot.kernel(rne.dynamics.gravity_torque).to_casadi().sparsity_out(0).is_dense()


TWO = ("add", "subtract", "multiply", "divide", "arctan2", "minimum", "maximum", "less", "less_equal")
OPERANDS = dict.fromkeys(TWO, 2) | {"where": 3}


def test_every_operation_is_that_of_the_arrays():
    rng = np.random.default_rng(0)
    states = np.concatenate([rng.uniform(-2, 2, (20, 3)), [[0, 0, 0], [1, 1, 1], [2.5, -1, 3]]])
    for kind in ON_ARRAYS:
        count = OPERANDS.get(kind, 1)
        instruction = Instruction(kind, tuple(Operand("input", k) for k in range(count)))
        program = Program((instruction,), (Operand("result", 0),), count)
        inputs = states[:, :count] if kind != "sqrt" else np.abs(states[:, :1])
        if kind == "divide":
            inputs = inputs[inputs[:, 1] != 0]
        traced = Trace(program, (count,), ())
        kernel = SimpleNamespace(names=("x",), widths=(count,), order="values", printable=traced, _title=kind)
        found = Kernel.to_casadi(kernel, kind).map(len(inputs))(inputs.T).full().T
        np.testing.assert_allclose(found, evaluate(program, 1, inputs), rtol=2 * EPS, atol=2 * EPS, err_msg=kind)


def test_condition_of_where_needs_not_be_one():
    """Its slope is that of what is taken, whatever number the condition is."""
    made = robot_of_one().kernel(rne.traceable(lambda q: rne.elementwise.where(2 * q, 3 * q, -q))).to_casadi("f")
    assert slopes(made, [np.array([0.7])]).item() == 3


def robot_of_one():
    return rne.Robot(random_tree(1, seed=1))


def test_wrenches_and_parameters_are_arguments():
    robot = loaded("irb140")
    kernel = robot.kernel(rne.dynamics.inverse_dynamics, external=["link_6"], parameters=True)
    made = kernel.to_casadi()
    assert made.name_in() == ["q", "qd", "qdd", "external_1", "parameters"]
    rng = np.random.default_rng(0)
    arguments = [*rng.uniform(-1, 1, (4, 6)), 1.1 * robot.parameters]
    expected = kernel(*arguments)
    assert np.abs(made(*arguments).full()[:, 0] - expected).max() <= 8 * 6 * EPS * np.abs(expected).max()


def test_saved_functions_are_loaded_without_the_package(tmp_path):
    robot = loaded("irb140")
    path = str(tmp_path / "saved.casadi")
    q = np.full(6, 0.3)
    for symbolic in ("SX", "MX"):
        kernel = robot.kernel(rne.dynamics.mass_matrix)
        made = kernel.to_casadi("inertia", symbolic)
        assert made.is_a(f"{symbolic}Function")
        made.save(path)
        again = ca.Function.load(path)
        assert (again.name(), again.name_in(), again.name_out()) == ("inertia", ["q"], ["result"])
        np.testing.assert_array_equal(again(q).full(), made(q).full())
        made = rne.Scene(robot).to_casadi(symbolic=symbolic, steps=2)
        made.save(path)
        state = 0, np.full(12, 0.1), q, 0.01
        np.testing.assert_array_equal(ca.Function.load(path)(*state)[0].full(), made(*state)[0].full())


@rne.traceable
class FilteredPD:
    """PD control with the velocity of a filter, whose state it has, and a reference that moves."""

    states = 3

    def __call__(self, t, q, qd, z):
        return -80 * (q - 0.5 * np.sin(2 * t)) - 10 * z, 50 * (qd - z)


def arm():
    return loaded("irb140").locked({"joint_4": 0.1, "joint_5": 0.2, "joint_6": 0.0})


SCENES = {
    "no controller": lambda: rne.Scene(arm(), friction=rne.Friction(viscous=2.0)),
    "all parts": lambda: rne.Scene(
        arm(),
        mounting=[0.2, 0, 0],
        payload=rne.Payload(3.0, com=[0, 0, 0.1]),
        friction=rne.Friction(viscous=2.0, coulomb=3.0, smoothing=0.05),
        armature=0.5,
        effort_limit=[60.0, 80.0, 40.0],
        controller=FilteredPD(),
    ),
    "torques": lambda: rne.Scene(loaded("ur5"), friction=rne.Friction(viscous=3.0), effort_limit=[20.0] * 6),
}


@pytest.mark.parametrize("name", SCENES)
def test_scene_is_the_right_hand_side_of_a_run(name):
    scene = SCENES[name]()
    made, n = scene.to_casadi(), scene.n
    rng = np.random.default_rng(0)
    x, u = rng.uniform(-1, 1, made.size1_in(1)), rng.uniform(-40, 40, n)
    given = [0.3, x, *([] if scene.controller else [u])]
    dx, tau = (a.full()[:, 0] for a in made(*given))
    if scene.controller:
        drives = np.clip(scene.controller(0.3, x[:n], x[n : 2 * n], x[2 * n :])[0], *limits(scene))
        expected = scene.controller(0.3, x[:n], x[n : 2 * n], x[2 * n :])[1]
        np.testing.assert_allclose(dx[2 * n :], expected, rtol=8 * EPS)
    else:
        drives = np.clip(u, *limits(scene))
    np.testing.assert_allclose(tau, drives, rtol=8 * n * EPS)
    qdd = scene.forward_dynamics(x[:n], x[n : 2 * n], drives)
    kappa = np.linalg.cond(scene.resolved.robot.mass_matrix(x[:n]))
    np.testing.assert_array_equal(dx[:n], x[n : 2 * n])
    np.testing.assert_allclose(dx[n : 2 * n], qdd, atol=8 * n * EPS * kappa * np.abs(qdd).max())


def limits(scene):
    limit = scene.resolved.effort_limit
    return (-np.inf, np.inf) if limit is None else (-limit, limit)


@pytest.mark.parametrize(("name", "duration"), kept([(k, d) for k in SCENES for d in (0.5, 5.0)], [("all parts", 0.5)]))
def test_cvodes_gives_the_motions_of_simulate(name, duration):
    """CVODES and DOP853 err by some 1e-9 at these tolerances, and the motions are not chaotic."""
    scene = SCENES[name]()
    n, states = scene.n, int(getattr(scene.controller, "states", 0))
    q0, u = np.linspace(0.1, 0.3, n), np.linspace(5, -5, n)
    given = {} if scene.controller else {"torque": u}
    run = rne.simulate(scene, q0, np.zeros(n), duration, rtol=1e-11, atol=1e-12, **given)
    made = scene.to_casadi()
    t, x = ca.MX.sym("t"), ca.MX.sym("x", 2 * n + states)
    ode = made(t, x, *([] if scene.controller else [u]))[0]
    options = {"reltol": 1e-11, "abstol": 1e-12, "max_num_steps": 100_000}
    cvodes = ca.integrator("motion", "cvodes", {"t": t, "x": x, "ode": ode}, 0, duration, options)
    start = np.concatenate([q0, np.zeros(n + states)])
    end = np.concatenate([run.q[-1], run.qd[-1], run.controller_state[-1]])
    np.testing.assert_allclose(cvodes(x0=start)["xf"].full()[:, 0], end, atol=1e-7)


def test_steps_are_those_of_runge_and_kutta():
    scene = SCENES["all parts"]()
    f, step = scene.to_casadi(), scene.to_casadi(steps=2)
    assert step.name_in() == ["t", "x", "h"]
    assert step.name_out() == ["x_next", "tau"]
    t, h, x = 0.2, 0.01, np.random.default_rng(0).uniform(-1, 1, 9)
    expected, time = x, t
    for _ in range(2):
        k1 = f(time, expected)[0].full()[:, 0]
        k2 = f(time + h / 4, expected + h / 4 * k1)[0].full()[:, 0]
        k3 = f(time + h / 4, expected + h / 4 * k2)[0].full()[:, 0]
        k4 = f(time + h / 2, expected + h / 2 * k3)[0].full()[:, 0]
        expected, time = expected + h / 12 * (k1 + 2 * k2 + 2 * k3 + k4), time + h / 2
    by_calls = scene.to_casadi("by_calls", steps=2, symbolic="MX")
    for made in (step, by_calls):
        found, tau = made(t, x, h)
        np.testing.assert_allclose(found.full()[:, 0], expected, rtol=1e-13, atol=1e-13)
        np.testing.assert_array_equal(tau.full(), f(t, x)[1].full())


def test_parameters_of_a_scene_are_an_argument():
    scene = rne.Scene(arm(), payload=2.0, friction=rne.Friction(viscous=1.0))
    made = scene.to_casadi(parameters=True)
    assert made.name_in() == ["t", "x", "u", "parameters"]
    heavier = rne.Scene(arm(), payload=3.0, friction=rne.Friction(viscous=1.0))
    x, u = np.random.default_rng(0).uniform(-1, 1, 6), np.array([1.0, 2.0, 3.0])
    expected = heavier.to_casadi()(0, x, u)[0].full()
    found = made(0, x, u, heavier.resolved.robot.parameters)[0].full()
    kappa = np.linalg.cond(heavier.resolved.robot.mass_matrix(x[:3]))
    np.testing.assert_allclose(found, expected, atol=24 * EPS * kappa * np.abs(expected).max())


def unmarked(t, q, qd):
    return -q


@rne.traceable
def branching(t, q, qd):
    return -q if q[0] > 0 else q


BRANCH = (
    "TypeError: a traced number has no value: a branch, float() or array conversion would freeze one outcome; "
    "rne.elementwise has where, less, minimum, maximum, clip and sign for this"
)
GIVEN = "; without it the torques are an argument u"
REFUSED = {
    "stops": ({"stops": True}, "`stops` end a run: set `stops` to False, and bound the positions"),
    "dry": (
        {"friction": rne.Friction(coulomb=1.0, smoothing=0)},
        "dry `friction` sticks and slips by events: give it a `smoothing` above 0, a large one for `steps`",
    ),
    "sampled": ({"controller": unmarked, "sample_time": 0.01}, f"`controller` is sampled{GIVEN}"),
    "called": (
        {"controller": unmarked},
        f"`controller` is called, as it is not marked by rne.traceable{GIVEN}",
    ),
    "branching": ({"controller": branching}, f"`controller` is called, as {BRANCH}{GIVEN}"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_function_of_time_and_state_is_refused(case):
    parts, text = REFUSED[case]
    with pytest.raises(ValueError, match="no function") as error:
        rne.Scene(arm(), **parts).to_casadi()
    assert str(error.value) == f"no function of time and state: {text}"


def test_arguments_are_checked(monkeypatch):
    kernel = loaded("irb140").kernel(rne.dynamics.gravity_torque)
    for name in ("two words", "", 3):
        with pytest.raises(ValueError, match="must be letters") as error:
            kernel.to_casadi(name)
        assert str(error.value) == f"`name` must be letters, digits and single underscores after a letter, got {name!r}"
    with pytest.raises(ValueError, match="`symbolic` must be 'SX' or 'MX', got 'DM'"):
        kernel.to_casadi(symbolic="DM")
    with pytest.raises(ValueError, match="`steps` must be a whole number above zero, got 0"):
        rne.Scene(arm()).to_casadi(steps=0)
    with pytest.raises(TypeError, match="`parameters` of a kernel must be True or False"):
        rne.Scene(arm()).to_casadi(parameters=[1.0])
    monkeypatch.setattr("rne.kernels.trace.LIMIT", 50)
    for large in (rne.compile(rne.dynamics.mass_matrix, loaded("irb140").model), rne.Scene(arm())):
        with pytest.raises(TypeError, match="too large to be written out"):
            large.to_casadi()
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(ImportError, match=r"CasADi is not installed: pip install 'rne\[casadi\]'"):
        kernel.to_casadi()
