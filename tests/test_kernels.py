"""Kernels: the same results as the recursion, whatever the shape, order, block, thread or process."""

import inspect
import itertools
import pickle
import re
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rne
from rne.graph.graph import Graph
from rne.graph.program import lower
from rne.graph.scalar import inputs, references
from rne.kernels import numpy_backend
from rne.kernels import trace as trace_module
from rne.kernels.python_backend import state_function
from rne.kernels.soundness import Trace

from .conftest import TREES
from .helpers import EPS, gimbal, kept, loaded, relative, states
from .quantities import QUANTITIES, arguments_of
from .random_robots import random_tree, straight_chain
from .test_oracle import LOADABLE, ONE_OF_EACH_KIND

ARMS = ["irb140", "ur_description/ur5_robot", "panda_description/panda", "double_pendulum_description/double_pendulum"]


def tolerance(n, model, q, function, eps=EPS):
    """4e-15 n of the largest entry, times the condition of M where M is solved."""
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(model, q)).max() if "forward" in function.__name__ else 1.0
    return 4e-15 / EPS * eps * max(n, 1) * kappa


def apart(a, b, size=1e-300):
    """Largest difference relative to the largest entry of the batch, or to `size` where everything cancels."""
    return float(np.abs(a - b).max(initial=0) / max(np.abs(b).max(initial=0), size))


@pytest.fixture(params=QUANTITIES)
def function(request):
    return QUANTITIES[request.param]


def check_same(model, function, dtype=np.float64):
    if model.has_mimics and function is rne.dynamics.articulated_forward_dynamics:
        with pytest.raises(rne.ModelError):
            rne.compile(function, model)
        return
    arguments = [x.astype(dtype) for x in arguments_of(function, model.n, 9)]
    kernel = rne.compile(function, model)
    expected = function(model, *(x.astype(np.float64) for x in arguments))
    bound = tolerance(model.n, model, arguments[0], function, float(np.finfo(dtype).eps))
    size = 1e-300
    if "coriolis" in function.__name__:  # on a single joint everything cancels
        size = np.abs(rne.dynamics.mass_matrix(model, arguments[0].astype(float))).max() * np.abs(arguments[1]).max()
    batch = kernel(*arguments)
    assert batch.dtype == dtype
    assert batch.shape == expected.shape
    assert apart(batch, expected, size) <= bound
    single = np.array([kernel(*state) for state in zip(*arguments, strict=True)])
    assert single.dtype == dtype
    assert apart(single, expected, size) <= bound


@pytest.mark.parametrize("tree", kept(TREES, ["mimics"]), indirect=True)
def test_kernel_is_the_recursion_on_trees(tree, function):
    check_same(tree, function)


@pytest.mark.parametrize("name", kept(ARMS, ["double_pendulum_description/double_pendulum"]))
def test_kernel_is_the_recursion_on_arms(name, function):
    model = rne.irb140() if name == "irb140" else loaded(name).model
    check_same(model, function)


def test_kernel_in_float32_is_the_recursion(function):
    check_same(rne.irb140(), function, dtype=np.float32)


@pytest.mark.parametrize("name", kept(LOADABLE, ONE_OF_EACH_KIND))
def test_robot_is_the_recursion_on_every_data_robot(name):
    robot = loaded(name)
    q, qd, qdd = states(robot.n, 5)
    bound = 4e-15 * max(robot.n, 1)
    assert apart(robot.inverse_dynamics(q, qd, qdd), rne.dynamics.inverse_dynamics(robot.model, q, qd, qdd)) <= bound
    assert apart(robot.mass_matrix(q), rne.dynamics.mass_matrix(robot.model, q)) <= bound


def test_kernels_with_an_argument_of_their_own_are_the_recursion(irb140):
    q, qd, _ = states(6, 5)
    assert apart(irb140.jacobian(q, "link_4"), rne.dynamics.jacobian(irb140.model, q, "link_4")) <= 4e-15 * 6
    assert (
        apart(irb140.jacobian_rate(q, qd, "link_4"), rne.dynamics.jacobian_rate(irb140.model, q, qd, "link_4"))
        <= 4e-15 * 6
    )


def test_M_is_symmetric_to_the_last_bit(irb140):
    M = irb140.mass_matrix(states(6, 50)[0])
    assert np.array_equal(M, np.swapaxes(M, 1, 2))


@pytest.fixture
def kernel():
    return rne.compile(rne.dynamics.inverse_dynamics, rne.irb140())


class TestOperations:
    def test_operations_of_the_irb140_are_few(self):
        counts = {
            f: rne.compile(f, rne.irb140()).operations
            for f in (rne.dynamics.inverse_dynamics, rne.dynamics.mass_matrix, rne.dynamics.forward_dynamics)
        }
        assert sum(counts[rne.dynamics.inverse_dynamics].values()) <= 290
        assert sum(counts[rne.dynamics.mass_matrix].values()) <= 160
        assert sum(counts[rne.dynamics.forward_dynamics].values()) <= 555
        assert counts[rne.dynamics.inverse_dynamics]["sin"] == counts[rne.dynamics.inverse_dynamics]["cos"] == 5

    def test_what_a_robot_lacks_costs_nothing(self):
        full = rne.irb140()
        weightless = rne.model.mounted(rne.load("irb140", gravity=[0, 0, 0]).model, [0, 0, 0])
        wristless = rne.model.locked(full, {"joint_4": 0.0, "joint_5": 0.0, "joint_6": 0.0})
        counts = [
            sum(rne.compile(rne.dynamics.inverse_dynamics, m).operations.values())
            for m in (full, weightless, wristless)
        ]
        assert counts[1] < counts[0]
        assert counts[2] < counts[0] / 2

    def test_mass_matrix_of_a_pendulum_is_a_constant(self):
        kernel = rne.compile(rne.dynamics.mass_matrix, straight_chain(1))
        assert kernel.operations == {}
        assert kernel(np.zeros((3, 1))).shape == (3, 1, 1)
        assert kernel(np.zeros(1))[0, 0] == rne.dynamics.mass_matrix(straight_chain(1), [0.0])[0, 0]

    def test_too_large_to_unroll_runs_as_the_recursion(self, monkeypatch):
        monkeypatch.setattr(trace_module, "LIMIT", 100)
        kernel = rne.compile(rne.dynamics.inverse_dynamics, rne.irb140())
        assert kernel.operations == {}
        assert repr(kernel) == "Kernel inverse_dynamics of 'irb140': run as the recursion"
        s = states(6, 4)
        assert np.array_equal(kernel(*s), rne.dynamics.inverse_dynamics(rne.irb140(), *s))
        out = np.empty((4, 6))
        assert kernel(*s, out=out) is out


def test_a_kernel_shows_its_operations_and_its_engine(monkeypatch):
    kernel = rne.compile(rne.dynamics.gravity_torque, straight_chain(2), engine="numpy")
    count = sum(kernel.operations.values())
    assert repr(kernel) == f"Kernel gravity_torque of {straight_chain(2).name!r}: {count} operations"
    machine_code = rne.compile(rne.dynamics.gravity_torque, straight_chain(2), engine="numba")
    assert repr(machine_code) == f"{kernel!r}, by Numba"
    monkeypatch.setattr(trace_module, "LIMIT", 1)
    large = rne.compile(rne.dynamics.gravity_torque, straight_chain(2), engine="numba")
    assert repr(large) == f"Kernel gravity_torque of {straight_chain(2).name!r}: run as the recursion"


def test_documented_limit_of_operations_is_the_one_that_counts():
    stated = re.search(r"more than ([0-9,]+)\s+operations", inspect.getdoc(rne.compile))[1]
    assert trace_module.LIMIT == int(stated.replace(",", "")) == 50_000


class TestBatches:
    @pytest.mark.parametrize("count", [0, 1, 2, 255, 256, 257, 8191, 8192, 8193, 20000])
    def test_any_number_of_states_gives_the_same(self, kernel, count):
        s = states(6, count, rate=1.0, acceleration=1.0)
        got = kernel(*s)
        assert got.shape == (count, 6)
        for k in {0, count // 2, count - 1} if count else ():
            assert relative(got[k][None], kernel(*(x[k] for x in s))[None]) <= 4e-15 * 6

    @pytest.mark.parametrize("length", [1, 7, 64, 1000])
    def test_any_length_of_blocks_gives_the_same(self, length, monkeypatch):
        kernel = rne.compile(rne.dynamics.inverse_dynamics, rne.irb140(), engine="numpy")
        s = states(6, 333)
        expected = kernel(*s)
        monkeypatch.setattr(numpy_backend, "block_length", lambda registers, itemsize: length)
        kernel.blocks.workspaces.clear()
        assert apart(kernel(*s), expected) <= 4e-15 * 6
        kernel.blocks.workspaces.clear()

    def test_any_memory_order_gives_the_same(self, kernel):
        s = states(6, 100)
        expected = kernel(*s)
        assert np.array_equal(kernel(*(np.asfortranarray(x) for x in s)), expected)
        assert np.array_equal(kernel(*(np.repeat(x, 2, axis=1)[:, ::2] for x in s)), expected)

    def test_leading_axes_broadcast(self, kernel):
        q, qd, qdd = states(6, 12)
        got = kernel(q.reshape(3, 4, 6), qd[:4], qdd[0])
        assert apart(got, rne.dynamics.inverse_dynamics(rne.irb140(), q.reshape(3, 4, 6), qd[:4], qdd[0])) <= 4e-15 * 6

    def test_lists_and_integers_are_taken(self, kernel):
        assert kernel([0] * 6, [0] * 6, [0] * 6).shape == (6,)
        assert kernel([[0] * 6] * 3, [0] * 6, [0] * 6).shape == (3, 6)

    def test_out_is_filled_and_returned(self, kernel):
        s = states(6, 100)
        out = np.empty((100, 6))
        assert kernel(*s, out=out) is out
        assert np.array_equal(out, kernel(*s))

    def test_out_of_a_wrong_kind_is_refused(self, kernel):
        s = states(6, 100)
        with pytest.raises(
            ValueError, match=r"^`out` must be a float64 array of shape \(100, 6\), got float64 \(6, 100\)$"
        ):
            kernel(*s, out=np.empty((6, 100)))
        with pytest.raises(ValueError, match=r"^`out` must be a float64 array of shape \(100, 6\), got list$"):
            kernel(*s, out=[])
        with pytest.raises(ValueError, match=r"^`out` must be C-contiguous and writeable$"):
            kernel(*s, out=np.empty((6, 100)).T)

    def test_out_must_not_alias_an_input(self, kernel):
        q, qd, qdd = states(6, 100)
        with pytest.raises(ValueError, match=r"^`out` must not share memory with `qdd`$"):
            kernel(q, qd, qdd, out=qdd)

    def test_a_record_is_not_compiled(self):
        with pytest.raises(TypeError, match=r"^`function` must give an array; rne.dynamics.recursion gives a record"):
            rne.compile(rne.dynamics.recursion, rne.irb140())

    def test_a_robot_is_not_compiled(self):
        with pytest.raises(TypeError, match=r"^`model` must be an rne.Model, got Robot; a Robot has it as .model$"):
            rne.compile(rne.dynamics.inverse_dynamics, rne.load("irb140"))

    def test_many_threads_may_call_at_once(self, kernel):
        batches = [states(6, 3000, seed=k) for k in range(8)]
        expected = [kernel(*s) for s in batches]
        with ThreadPoolExecutor(8) as pool:
            got = list(pool.map(lambda s: kernel(*s), batches * 3))
        assert all(np.array_equal(a, b) for a, b in zip(got, expected * 3, strict=True))

    def test_kernels_go_through_a_process_pool(self, kernel):
        s = states(6, 50)
        with ProcessPoolExecutor(1) as pool:
            got = pool.submit(kernel, *s).result()
        assert apart(got, kernel(*s)) <= 4e-15 * 6

    def test_kernel_and_robot_pickle(self, kernel, irb140):
        s = states(6, 5)
        assert np.array_equal(pickle.loads(pickle.dumps(kernel))(*s), kernel(*s))
        assert pickle.loads(pickle.dumps(irb140)).model == irb140.model


class TestErrors:
    def test_nan_is_named_as_by_the_recursion(self, irb140):
        q = np.zeros((3, 4, 6))
        q[1, 2, 0] = np.nan  # the first joint turns about gravity: nothing depends on it
        for call in (irb140.gravity_torque, irb140.mass_matrix):
            with pytest.raises(ValueError, match=r"^`q` must be finite, got nan at index \(1, 2, 0\)$"):
                call(q)
            with pytest.raises(ValueError, match=r"^`q` must be finite, got nan at index \(0,\)$"):
                call(q[1, 2])

    def test_infinite_torque_is_named(self, irb140):
        tau = np.zeros((5, 6))
        tau[3, 5] = np.inf
        with pytest.raises(ValueError, match=r"^`tau` must be finite, got inf at index \(3, 5\)$"):
            irb140.forward_dynamics(np.zeros((5, 6)), np.zeros(6), tau)

    def test_overflow_is_named(self, irb140):
        qd = np.ones((2, 3, 6))
        qd[1, 2] = 1e200
        text = r"^bias_torque overflows float64 for these arguments; the result is not finite"
        for function in (irb140.bias_torque, partial(rne.dynamics.bias_torque, irb140.model)):
            with pytest.raises(rne.NotFiniteError, match=rf"{text} at state \(1, 2\)$") as caught:
                function(np.ones(6), qd)
            assert caught.value.state == (1, 2)
            with pytest.raises(rne.NotFiniteError, match=f"{text}$"):
                function(np.ones(6), qd[1, 2])

    def test_large_finite_values_are_no_error(self, irb140):
        tau = np.full((2, 6), 1e308)
        assert np.isfinite(irb140.mass_matrix(np.full((2, 6), 1e300))).all()
        assert np.isfinite(rne.Robot(straight_chain(1)).forward_dynamics([[0.0]], [[0.0]], tau[:1, :1] / 1e3)).all()

    def test_singular_state_of_a_batch_is_named(self):
        """A gimbal closes at q2 = 0, in the second block."""
        robot = rne.Robot(gimbal())
        q = np.ones((4, 2500, 3))
        q[3, 1234, 1] = 0.0
        zero = np.zeros(3)
        with pytest.raises(
            rne.SingularMassMatrixError, match=r"at state \(3, 1234\): a combined motion of 'outer', 'inner'"
        ):
            robot.forward_dynamics(q, zero, zero)
        with pytest.raises(rne.SingularMassMatrixError, match=r"^M is singular to working precision: "):
            robot.forward_dynamics(q[3, 1234], zero, zero)
        q[3, 1234, 1] = 1e-8
        with pytest.raises(rne.SingularMassMatrixError):
            robot.forward_dynamics(q, zero, zero)
        with pytest.raises(rne.SingularMassMatrixError):
            robot.forward_dynamics(q[3, 1234], zero, zero)

    def test_overflow_in_a_pivot_is_not_a_zero_acceleration(self):
        rail = rne.Robot(random_tree(3, 8, prismatic=0.5, branching=0))
        q = np.full((2, 3), 1e200)
        with pytest.raises((rne.SingularMassMatrixError, rne.NotFiniteError)):
            rail.forward_dynamics(q, 0 * q, np.ones(3))

    def test_a_function_of_ones_own_that_is_not_marked_is_refused(self):
        with pytest.raises(TypeError, match=r"^`function` must be one of rne's functions of a model, such as "):
            rne.compile(lambda model, q: q, rne.irb140())

    def test_too_few_arguments_are_refused(self):
        with pytest.raises(TypeError, match=r"^this kernel takes q, qd, qdd; got 2 arguments$"):
            rne.compile(rne.dynamics.inverse_dynamics, rne.irb140())(np.zeros(6), np.zeros(6))

    def test_a_transposed_batch_is_named(self, irb140):
        with pytest.raises(ValueError, match="states go along the first axis"):
            irb140.gravity_torque(np.zeros((6, 50)))


class TestTrigonometry:
    ANGLES = np.concatenate(
        [
            np.linspace(-np.pi, np.pi, 20001),
            np.nextafter(np.pi * np.array([-1, 1, -0.5, 0.5, 0, 1, 2, 3]), [4, -4, 4, -4, 1, 9, 9, 9]),
            np.random.default_rng(0).uniform(-1e12, 1e12, 5000),
            np.random.default_rng(1).uniform(-1e-9, 1e-9, 1000),
            [0.0, 1e300, -1e300, 1e-300],
        ]
    )

    @pytest.mark.parametrize("method", numpy_backend.METHODS)
    @pytest.mark.parametrize("dtype", [np.float64, np.float32])
    def test_absolute_error_is_two_eps(self, method, dtype):
        angles = self.ANGLES[np.abs(self.ANGLES) < (1e300 if dtype is np.float64 else 1e4)].astype(dtype)
        sin, cos = np.empty_like(angles), np.empty_like(angles)
        for call, arguments in numpy_backend.METHODS[method](angles, sin, cos, lambda x: np.array(x, dtype)):
            call(*arguments)
        exact = angles.astype(np.longdouble)
        eps = float(np.finfo(dtype).eps)
        assert np.abs(sin - np.sin(exact)).max() <= 2 * eps
        assert np.abs(cos - np.cos(exact)).max() <= 2 * eps

    @pytest.mark.parametrize("method", numpy_backend.METHODS)
    def test_either_gives_the_same_torque(self, method, monkeypatch):
        monkeypatch.setattr(numpy_backend, "faster", lambda dtype: method)
        kernel = rne.compile(rne.dynamics.inverse_dynamics, rne.irb140(), engine="numpy")
        s = states(6, 300)
        assert apart(kernel(*s), rne.dynamics.inverse_dynamics(rne.irb140(), *s)) <= 4e-15 * 6


def objects(numbers):
    """An object array of traced numbers; np.array would ask them for their values."""
    array = np.empty(len(numbers), dtype=object)
    for k, x in enumerate(numbers):
        array[k] = x
    return array


def random_expression(draw, x):
    """A random arithmetic expression tree over the inputs, as a function of any numbers."""
    pool = list(x)
    for _ in range(draw(st.integers(1, 25))):
        a = draw(st.sampled_from(range(len(pool))))
        b = draw(st.sampled_from(range(len(pool))))
        constant = draw(st.sampled_from([0.0, 1.0, -1.0, 0.5, 2.0, -3.0, 0.1]))
        kind = draw(st.sampled_from(["+", "-", "*", "c*", "c+", "neg", "sin", "cos", "abs", "min", "max", "tanh", "/"]))
        pool.append((kind, a, b, constant))
    return pool


def evaluate(plan, x, ops):
    """The values of a plan of operations on any kind of number."""
    pool = []
    for step in plan:
        if not isinstance(step, tuple):
            pool.append(x[len(pool)])
            continue
        kind, a, b, c = step
        p, q = pool[a], pool[b]
        pool.append(
            {
                "+": lambda p=p, q=q: p + q,
                "-": lambda p=p, q=q: p - q,
                "*": lambda p=p, q=q: p * q,
                "c*": lambda p=p, c=c: c * p,
                "c+": lambda p=p, c=c: p + c,
                "neg": lambda p=p: -p,
                "sin": lambda p=p: ops["sin"](p),
                "cos": lambda p=p: ops["cos"](p),
                "abs": lambda p=p: abs(p),
                "min": lambda p=p, q=q: ops["minimum"](p, q),
                "max": lambda p=p, q=q: ops["maximum"](p, q),
                "tanh": lambda p=p: ops["tanh"](p),
                "/": lambda p=p, q=q: p / (2 + q * q),
            }[kind]()
        )
    return pool


PLAIN = {"sin": np.sin, "cos": np.cos, "tanh": np.tanh, "minimum": np.minimum, "maximum": np.maximum}
TRACED = {
    "sin": lambda x: x.sin() if hasattr(x, "sin") else np.sin(x),
    "cos": lambda x: x.cos() if hasattr(x, "cos") else np.cos(x),
    "tanh": lambda x: x.tanh() if hasattr(x, "tanh") else np.tanh(x),
    "minimum": lambda a, b: a.minimum(b),
    "maximum": lambda a, b: a.maximum(b),
}


class TestRandomGraphs:
    @settings(max_examples=25, deadline=None, derandomize=True)
    @given(st.data())
    def test_folded_and_unfolded_agree(self, data):
        self.check(data)

    @pytest.mark.long
    @settings(max_examples=1000, deadline=None, derandomize=True)
    @given(st.data())
    def test_many_agree_folded_and_unfolded(self, data):
        self.check(data)

    def check(self, data):
        n = data.draw(st.integers(1, 4))
        plan = random_expression(data.draw, [None] * n)
        x = np.array([data.draw(st.floats(-2, 2)) for _ in range(n)])
        expected = np.array(evaluate(plan, list(x), PLAIN))
        graph = Graph()
        traced = evaluate(plan, list(inputs(graph, (n,), 0)), TRACED)
        outputs = references(graph, objects(traced))
        program = lower(graph, outputs, n)
        if not np.isfinite(expected).all() or np.abs(expected).max() > 1e6:
            return
        scale = 1e-12 * max(1.0, float(np.abs(expected).max()) ** 2)
        single = state_function(Trace(program, (n,), (len(outputs),)))(x)
        np.testing.assert_allclose(single, expected, atol=scale, rtol=0)
        workspace = numpy_backend.Workspace(numpy_backend.allocate(program), 3, np.dtype("float64"))
        workspace.rows[:n, :3] = x[:, None]
        for call, arguments in workspace.calls(3):
            call(*arguments)
        for column in range(3):
            np.testing.assert_allclose(workspace.rows[n : n + len(outputs), column], expected, atol=scale, rtol=0)


@pytest.mark.parametrize(("nested", "lines"), [(11, 0), (12, 1), (23, 1), (24, 2)])
def test_expressions_of_one_state_are_cut_where_they_are_nested_deeply(nested, lines):
    """A parser takes a hundred parentheses or so; here every twelfth operation is a line of its own."""

    @rne.traceable
    def sines(q):
        for _ in range(nested):
            q = np.sin(q)
        return q

    text = rne.compile(sines, straight_chain(1)).source("python")
    assert len(re.findall(r"^    t\d+ = ", text, re.MULTILINE)) == lines


def test_a_result_that_another_one_reads_too_is_written_once():
    function = rne.traceable(lambda q: np.concatenate([np.sin(q), np.sin(q) * q]))
    assert rne.compile(function, straight_chain(1)).source("python").count("sin(") == 1


def test_derivatives_of_a_users_function_may_be_part_of_another_function():
    """Of sin(q) q q^T, whose kernel is called on numbers and on symbols."""
    model, q = straight_chain(2), np.array([[0.3, -0.4], [0.5, 0.2]])
    bent = rne.traceable(lambda q: np.sin(q) * (q * q).sum())
    slope = rne.kernels.derivative(bent, model, "q")
    along = rne.compile(rne.traceable(lambda q: slope(q) @ np.ones(2)), model)
    size = (q**2).sum(1, keepdims=True)
    np.testing.assert_allclose(along(q), np.cos(q) * size + 2 * np.sin(q) * q.sum(1, keepdims=True), rtol=1e-14)


class TestRegisters:
    """Few registers are what lets large blocks stay in the cache."""

    @pytest.mark.parametrize(("quantity", "count", "angles"), [("inverse_dynamics", 63, 5), ("mass_matrix", 65, 4)])
    def test_of_the_irb140_there_are_few(self, quantity, count, angles):
        kernel = rne.compile(getattr(rne.dynamics, quantity), rne.irb140(), engine="numpy")
        layout = numpy_backend.allocate(kernel.traced.program)
        assert layout.registers <= count
        kinds = [step.kind for step in layout.steps]
        assert kinds.count("sincos") == angles  # sine and cosine at once; M depends on neither the first nor the last
        assert not {"sin", "cos"} & set(kinds)

    def test_a_block_of_states_fits_the_cache(self):
        """All registers take 8 MiB at most, rounded down to 64 states, with 256 to 8192 states in a block."""
        for count, itemsize, states_per_block in [(1, 8, 8192), (1000, 8, 1024), (1000, 4, 2048), (10**6, 8, 256)]:
            assert numpy_backend.block_length(count, itemsize) == states_per_block

    @pytest.mark.parametrize("dtype", ["float64", "float32"])
    @pytest.mark.parametrize("length", [1, 16, 100])
    def test_rows_begin_at_cache_lines_of_their_own(self, dtype, length):
        rows = numpy_backend.aligned_zeros(5, length, np.dtype(dtype))
        assert rows.shape[1] >= length
        assert not rows.any()
        for row, after in itertools.pairwise(rows):
            assert row.ctypes.data % 64 == 0
            assert after.ctypes.data - row.ctypes.data == -(-length * rows.itemsize // 64) * 64 + 64

    def test_calls_are_kept_for_few_lengths_of_blocks(self):
        kernel = rne.compile(rne.dynamics.gravity_torque, straight_chain(2), engine="numpy")
        for count in range(1, 20):
            assert kernel(np.zeros((count, 2))).shape == (count, 2)
        (workspace,) = kernel.blocks.workspaces["float64"]
        assert len(workspace._calls) <= 5

    def test_one_is_free_again_after_its_last_reader(self):
        """A chain x -> sin x -> sin sin x ... needs one register beside those of the input and the output, or none."""
        graph = Graph()
        (x,) = inputs(graph, (1,), 0)
        for _ in range(20):
            x = x.sin() + 1.0
        assert numpy_backend.allocate(lower(graph, references(graph, objects([x])), 1)).registers == 2


class TestScalars:
    @pytest.fixture
    def x(self):
        return inputs(Graph(), (1, 2), 0)[0, 0]

    @pytest.mark.parametrize(
        "misuse",
        [
            lambda x: bool(x),
            lambda x: float(x),
            lambda x: np.asarray(x) + 1.0 if float(x) else 0,
            lambda x: 1 if x > 0 else 0,
            lambda x: x == 1,
            lambda x: np.minimum(objects([x]), 0.5),
            lambda x: np.array([x], dtype=float),
        ],
    )
    def test_no_branch_is_frozen(self, x, misuse):
        with pytest.raises(TypeError, match="a traced number has no value"):
            misuse(x)

    @pytest.mark.parametrize(("other", "kind"), [(None, "NoneType"), ("a", "str"), (1j, "complex")])
    def test_what_is_no_real_number_is_named(self, x, other, kind):
        with pytest.raises(TypeError, match=f"^a traced number cannot be combined with {kind}$"):
            _ = x + other

    def test_an_array_times_a_number_is_an_array_of_numbers(self, x):
        for product in (np.array([1.0, 2.0]) * x, x * np.array([1.0, 2.0])):
            assert [entry.ref for entry in product] == [x.ref, (2.0 * x).ref]
        assert np.array([x, 1.0]).dtype == object

    def test_sum_and_difference_of_two_numbers_add_up_to_twice_one_of_them(self):
        """Whichever way round they are written: 2 x and 2 y instead of three operations."""
        x, y = inputs(Graph(), (2,), 0)
        for total, twice in [
            ((x + y) + (x - y), 2 * x),
            ((x - y) + (y + x), 2 * x),
            ((x + y) - (x - y), 2 * y),
            ((x - y) - (x + y), -2 * y),
            ((y - x) + (x + y), 2 * y),
            (-(y - x) + (x + y), 2 * x),
        ]:
            assert total.ref == twice.ref

    def test_signs_and_constants_move_outwards(self):
        """The pairs are one operation, so that none is spent twice; ref is the number of an operation and its sign."""
        graph = Graph()
        x, y, c = inputs(graph, (3,), 0)
        one, two = (x**0 * value for value in (1.0, 2.0))
        for left, right in [
            (x - y, -(y - x)),
            (-x - y, -(x + y)),
            ((-x) * y, -(x * y)),
            (x / (-y), -(x / y)),
            ((-x).sin(), -(x.sin())),
            ((-x).tanh(), -(x.tanh())),
            ((-x).sign(), -(x.sign())),
            ((-x).cos(), x.cos()),
            (abs(-x), abs(x)),
            ((-x).arctan2(y), -(x.arctan2(y))),
            ((-x).minimum(-y), -(x.maximum(y))),
            ((-x).maximum(-y), -(x.minimum(y))),
            (c.where(-x, -y), -(c.where(x, y))),
            (c.where(x, x), x),
            (one.where(x, y), x),
            ((0.0 * x).where(x, y), y),
            ((2 * x) * (3 * y), 6 * (x * y)),
            (2 * (x * 3), 6 * x),
            (2 * x + 3 * x, 5 * x),
            (2 * x - 3 * x, -x),
            (2 * x + 2 * y, 2 * (x + y)),
            (2 * x - 2 * y, 2 * (x - y)),
            (x / 4, 0.25 * x),
            (x + 0, x),
            (x * 1, x),
            (x * -1, -x),
            (one.minimum(two), one),
            (one.maximum(two), two),
            (one < two, one),
            (two <= one, 0 * x),
            (one.arctan2(0 * x), np.pi / 2 * one),
            (two / one, two),
            (0 / x, 0 * x),
        ]:
            assert left.ref == right.ref, (left, right)

    def test_whole_powers_are_products(self, x):
        assert (x**3).ref == (x * x * x).ref
        assert (x**0).ref == (0 * x + 1).ref
        assert (x**-2).ref == (1 / (x * x)).ref
        assert (x**0.5).ref == x.sqrt().ref
        assert np.sin(x).ref == x.sin().ref
        with pytest.raises(TypeError, match=r"whole powers up to 64 and to 0.5, not to 1.5$"):
            x**1.5

    def test_numpy_scalars_defer(self, x):
        assert (np.float64(2.0) * x).ref == (x * 2.0).ref
        assert (np.float64(2.0) - x).ref == (-(x - 2.0)).ref

    def test_where_and_comparisons_are_those_of_numbers(self):
        graph = Graph()
        x, y = inputs(graph, (2,), 0)
        results = [(x < y).where(x, y), (x >= y).where(-x, -y), x.maximum(-y), x.sign(), abs(-x), (x * x).sqrt()]
        program = lower(graph, references(graph, objects(results)), 2)
        single = state_function(Trace(program, (2,), (6,)))
        for a, b in ((1.0, 2.0), (2.0, -1.0), (-3.0, -3.0)):
            expected = [min(a, b), -max(a, b), max(a, -b), np.sign(a), abs(a), abs(a)]
            assert single(np.array([a, b])).tolist() == expected
            workspace = numpy_backend.Workspace(numpy_backend.allocate(program), 2, np.dtype("float64"))
            workspace.rows[0, :2], workspace.rows[1, :2] = a, b
            for call, arguments in workspace.calls(2):
                call(*arguments)
            assert workspace.rows[2:8, 1].tolist() == expected


def test_a_kernel_without_samples_has_no_pieces():
    kernel = rne.compile(rne.dynamics.gravity_torque, straight_chain(2))
    with pytest.raises(TypeError, match=f"^{re.escape(repr(kernel))} has no samples of a motion$"):
        kernel.piece([0.5])


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("jax", "`to_jax` needs JAX, which is not installed: pip install 'rne[jax]'"),
        ("torch", "`to_torch` needs PyTorch, which is not installed: see pytorch.org for its installation"),
    ],
)
def test_packages_of_exports_that_are_missing_are_named(module, text, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    kernel = rne.compile(rne.dynamics.gravity_torque, straight_chain(2))
    with pytest.raises(ImportError, match=f"^{re.escape(text)}$"):
        getattr(kernel, f"to_{module}")()


def test_what_a_kernel_cannot_take_is_named():
    robot = rne.load("irb140")
    with pytest.raises(TypeError, match=r"^rne.dynamics.jacobian needs a link by name: link='tool0'$"):
        robot.kernel(rne.dynamics.jacobian)
    with pytest.raises(TypeError, match=r"^`parameters` of a kernel must be True or False, got ndarray"):
        robot.kernel(rne.dynamics.gravity_torque, parameters=robot.parameters)
    with pytest.raises(TypeError, match=r"such as rne.dynamics.mass_matrix, .*, got 'mass_matrix'$"):
        robot.kernel("mass_matrix")
