"""External wrenches as arrays of a kernel: the laws of mechanics, and the recursion's results, words and verdicts."""

import functools
import pickle
import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import rne
from rne.kernels import kernel as kernel_module

from .helpers import EPS, complex_steps, kept, relative, states
from .random_robots import random_tree, straight_chain

FUNCTIONS = {
    "inverse_dynamics": (rne.dynamics.inverse_dynamics, 3),
    "bias_torque": (rne.dynamics.bias_torque, 2),
    "forward_dynamics": (rne.dynamics.forward_dynamics, 3),
    "articulated_forward_dynamics": (rne.dynamics.articulated_forward_dynamics, 3),
}
METHODS = ("inverse_dynamics", "bias_torque", "forward_dynamics")
# A few eps for each joint, of the largest torque, which may be smaller than the wrenches' own torques.
ROUNDING = 40 * EPS


TREES = {
    "single": random_tree(1, seed=1),
    "sliders": random_tree(4, seed=3, prismatic=1),
    "mixed": random_tree(4, seed=4),
    "bushy": random_tree(12, seed=5, branching=0.8),
    "mimics": random_tree(3, seed=16, branching=0.4, mimics=2),
}


@pytest.fixture(params=kept(TREES, ["single", "mixed", "mimics"]))
def tree(request):
    """As in conftest, but smaller; links on fixed joints among them."""
    return TREES[request.param]


def some_links(model):
    """The last link, the root, one in between, and one on a fixed joint if there is one: not in the model's order."""
    names, joints = model.link_names, model.link_joints
    fixed = [name for name, joint in zip(names[1:], joints[1:], strict=True) if joint not in model.moving_joints]
    return tuple(dict.fromkeys((names[-1], names[0], names[len(names) // 2], *fixed[:1])))


def wrenches_on(links, *leading, seed=3):
    """Random wrenches of up to 10 N m and 10 N, one array per link."""
    return tuple(np.random.default_rng(seed).uniform(-10, 10, (len(links), *leading, 6)))


def bound(model, function, q, eps=EPS):
    """Rounding, times the condition of M where M is solved."""
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(model, q)).max() if "forward" in function.__name__ else 1.0
    return ROUNDING / EPS * eps * max(model.n, 1) * kappa


compiled = functools.cache(lambda function, model, external: rne.compile(function, model, external=external))


def check_same(model, function, count, links, dtype=np.float64):
    """Kernel and recursion, for a batch and its states one by one."""
    arrays = [x.astype(dtype) for x in (*states(model.n, 5)[:count], *wrenches_on(links, 5))]
    wide = [x.astype(np.float64) for x in arrays]
    expected = function(model, *wide[:count], external=dict(zip(links, wide[count:], strict=True)))
    kernel = compiled(function, model, links)
    allowed = bound(model, function, wide[0], float(np.finfo(dtype).eps))
    for got in (kernel(*arrays), np.array([kernel(*state) for state in zip(*arrays, strict=True)])):
        assert got.dtype == dtype
        assert np.abs(got - expected).max() <= allowed * np.abs(expected).max()


@pytest.mark.parametrize("name", FUNCTIONS)
def test_kernel_is_the_recursion_on_trees(tree, name):
    function, count = FUNCTIONS[name]
    if tree.has_mimics and name.startswith("articulated"):
        with pytest.raises(rne.ModelError):
            rne.compile(function, tree, external=some_links(tree))
        return
    check_same(tree, function, count, some_links(tree))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_kernel_in_float32_is_the_recursion(name):
    check_same(rne.irb140(), *FUNCTIONS[name], ("tool0", "link_3"), dtype=np.float32)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(60))
def test_kernel_is_the_recursion_on_many_trees(seed):
    rng = np.random.default_rng(seed)
    model = random_tree(int(rng.integers(1, 12)), seed=seed, branching=rng.uniform(), mimics=seed % 3)
    links = tuple(rng.permutation(model.link_names)[: rng.integers(1, 5)].tolist())
    for name in METHODS:
        check_same(model, *FUNCTIONS[name], links)


class TestLaws:
    def test_a_wrench_takes_its_virtual_work_from_the_joints(self, tree):
        q, qd, qdd = states(tree.n, 5)
        tau = rne.dynamics.inverse_dynamics(tree, q, qd, qdd)
        poses, links = rne.dynamics.link_poses(tree, q), some_links(tree)
        kernel = compiled(rne.dynamics.inverse_dynamics, tree, links)
        for k, link in enumerate(links):
            wrenches = np.zeros((len(links), 5, 6))
            (wrenches[k],) = wrenches_on([link], 5)
            R = poses[:, tree.link_index(link), :3, :3]
            world = np.concatenate([R @ wrenches[k, :, :3, None], R @ wrenches[k, :, 3:, None]], axis=1)
            work = (np.swapaxes(rne.dynamics.jacobian(tree, q, link), -1, -2) @ world)[..., 0]
            got = kernel(q, qd, qdd, *wrenches)
            assert np.abs(tau - work - got).max() <= 1e-12 * max(np.abs(tau).max(), np.abs(work).max()), link

    def test_the_slope_by_a_wrench_is_minus_the_jacobian(self, tree):
        q, qd, qdd = states(tree.n, 2)
        link = tree.link_names[-1]
        (wrench,) = wrenches_on([link], 2)
        R = rne.dynamics.link_poses(tree, q)[:, tree.link_index(link), :3, :3]
        J = rne.dynamics.jacobian(tree, q, link)
        own_axes = np.concatenate([np.swapaxes(R, -1, -2) @ J[:, :3], np.swapaxes(R, -1, -2) @ J[:, 3:]], axis=1)
        got = rne.kernels.derivative(rne.dynamics.inverse_dynamics, tree, "external_1", external=[link])(
            q, qd, qdd, wrench
        )
        assert np.abs(got + np.swapaxes(own_axes, -1, -2)).max() <= 1e-13 * max(np.abs(J).max(), 1)

    def test_a_wrench_on_the_root_costs_and_changes_nothing(self, irb140):
        plain = irb140.kernel(rne.dynamics.inverse_dynamics)
        kernel = irb140.kernel(rne.dynamics.inverse_dynamics, external=["base_link"])
        assert kernel.operations == plain.operations
        s = states(6)
        assert np.array_equal(kernel(*s, np.ones(6)), plain(*s))

    def test_forward_dynamics_undo_inverse_dynamics(self, irb140):
        q, qd, qdd = states(6, 20)
        external = dict(zip(("link_2", "tool0"), wrenches_on("ab", 20), strict=True))
        tau = irb140.inverse_dynamics(q, qd, qdd, external=external)
        assert relative(irb140.forward_dynamics(q, qd, tau, external=external), qdd) <= 1e-11

    @pytest.mark.parametrize("links", [("tool0",), ("wrist_1_link", "forearm_link", "base_link", "tool0")])
    def test_torques_are_pinocchios(self, ur5, ur5_oracle, links):
        oracle, (q, qd, qdd), wrenches = ur5_oracle, states(6, 10, seed=7), wrenches_on(links, 10)
        expected = []
        for k in range(10):
            forces = pin.StdVec_Force()
            for _ in range(oracle.theirs.njoints):
                forces.append(pin.Force.Zero())
            for link, wrench in zip(links, wrenches, strict=True):
                frame = oracle.theirs.frames[oracle.theirs.getFrameId(link, pin.FrameType.BODY)]
                forces[frame.parentJoint] += frame.placement.act(pin.Force(wrench[k, 3:], wrench[k, :3]))
            expected.append(oracle.inverse_dynamics(q[k], qd[k], qdd[k], forces))
        got = ur5.kernel(rne.dynamics.inverse_dynamics, external=links)(q, qd, qdd, *wrenches)
        assert relative(got, np.array(expected)) <= 1e-13


@pytest.mark.parametrize("wrt", [("q",), ("qd", "qdd"), ("q", "external_1", "external_2")])
@pytest.mark.parametrize("name", kept(["serial", "mimics"], ["mimics"]))
def test_derivatives_are_the_complex_step_of_the_recursion(name, wrt):
    model = {"serial": random_tree(4, seed=2, branching=0), "mimics": random_tree(4, seed=6, mimics=3)}[name]
    links = (model.link_names[-1], model.link_names[2])
    arguments = (*states(model.n, 3), *wrenches_on(links, 3))
    kernel = rne.kernels.derivative(rne.dynamics.inverse_dynamics, model, *wrt, external=links)
    expected = complex_steps(rne.dynamics.inverse_dynamics, model, arguments, wrt, links)
    assert relative(kernel(*arguments), expected) <= 1e-12
    assert relative(kernel(*(a[1] for a in arguments)), expected[1]) <= 1e-12


def test_derivatives_of_forward_dynamics_are_the_complex_step_of_the_recursion():
    model = random_tree(3, seed=2)
    links, wrt = (model.link_names[-1],), ("q", "tau", "external_1")
    arguments = (*states(model.n, 3), *wrenches_on(links, 3))
    expected = complex_steps(rne.dynamics.forward_dynamics, model, arguments, wrt, links)
    got = rne.kernels.derivative(rne.dynamics.forward_dynamics, model, *wrt, external=links)(*arguments)
    assert relative(got, expected) <= 1e-12 * np.linalg.cond(rne.dynamics.mass_matrix(model, arguments[0])).max()


@pytest.fixture
def traced(monkeypatch):
    """The links of each kernel that is traced from now on."""
    links, trace = [], kernel_module.trace

    def listing(quantity, *arguments, **options):
        links.append(tuple(quantity.wrenches.values()))
        return trace(quantity, *arguments, **options)

    monkeypatch.setattr(kernel_module, "trace", listing)
    return links


class TestRobot:
    @pytest.mark.parametrize("method", METHODS)
    def test_first_call_later_calls_and_batches_are_the_recursion(self, tree, method):
        function, count = FUNCTIONS[method]
        robot, arrays = rne.Robot(tree), states(tree.n, 4)[:count]
        links = some_links(tree)
        external = dict(zip(links, wrenches_on(links, 4), strict=True))
        expected = function(tree, *arrays, external=external)
        allowed = bound(tree, function, arrays[0]) * np.abs(expected).max()
        for k in (0, 1, 2, 3):
            one = {link: wrench[k] for link, wrench in external.items()}
            got = getattr(robot, method)(*(a[k] for a in arrays), external=one)
            assert np.abs(got - expected[k]).max() <= allowed
        assert np.abs(getattr(robot, method)(*arrays, external=external) - expected).max() <= allowed

    def test_the_second_call_is_the_kernels(self):
        robot, s, (w,) = rne.load("irb140"), states(6), wrenches_on(["tool0"])
        first = robot.inverse_dynamics(*s, external={"tool0": w})
        assert np.array_equal(first, rne.dynamics.inverse_dynamics(robot.model, *s, external={"tool0": w}))
        kernel = robot.kernel(rne.dynamics.inverse_dynamics, external=["tool0"])
        assert np.array_equal(robot.inverse_dynamics(*s, external={"tool0": w}), kernel(*s, w))
        assert robot.kernel(rne.dynamics.inverse_dynamics, external=("tool0",)) is kernel

    @pytest.mark.parametrize("method", METHODS)
    def test_the_order_of_the_mapping_does_not_matter(self, traced, method):
        s, (a, b) = states(6, 3)[: FUNCTIONS[method][1]], wrenches_on("ab", 3)
        call = getattr(rne.load("irb140"), method)
        got = call(*s, external={"link_2": a, "tool0": b})
        assert np.array_equal(call(*s, external={"tool0": b, "link_2": a}), got)
        assert traced == [("link_2", "tool0")]

    @pytest.mark.parametrize("method", METHODS)
    def test_one_state_is_traced_at_the_second_call_for_each_set_of_links(self, traced, method):
        s, (a, b) = states(6)[: FUNCTIONS[method][1]], wrenches_on("ab")
        call = getattr(rne.load("irb140"), method)
        call(*s)
        call(*s, external={"tool0": a})
        call(*s, external={"link_2": a, "tool0": b})
        assert traced == []
        for _ in range(2):
            call(*s, external={"tool0": b})
        assert traced == [("tool0",)]

    @pytest.mark.parametrize("method", METHODS)
    def test_no_wrenches_are_no_argument(self, irb140, method):
        s = states(6, 3)[: FUNCTIONS[method][1]]
        assert np.array_equal(getattr(irb140, method)(*s, external={}), getattr(irb140, method)(*s))

    def test_wrenches_change_between_calls_but_not_the_kernel(self, irb140):
        s = states(6)
        plain = irb140.inverse_dynamics(*s)
        one, two = (irb140.inverse_dynamics(*s, external={"tool0": k * np.ones(6)}) for k in (1, 2))
        assert np.abs((two - plain) - 2 * (one - plain)).max() <= 1e-13 * np.abs(plain).max()

    @pytest.mark.parametrize("n", kept([3, 12, 24], [3, 12]))
    def test_forward_dynamics_are_by_the_method_with_fewer_operations(self, n):
        robot = rne.Robot(straight_chain(n))
        link = robot.link_names[-1]
        s, (wrench,) = states(n, 2, rate=1.0, acceleration=1.0), wrenches_on([link], 2)
        got = robot.forward_dynamics(*s, external={link: wrench})
        chosen = robot.kernels.forward_kernel(external=(link,))
        assert np.array_equal(got, chosen(*s, wrench))
        assert chosen.function is robot.kernels.forward_method

    def test_a_traced_law_may_know_of_wrenches(self, irb140):
        @rne.traceable
        def law(t, q, qd):
            return irb140.bias_torque(q, qd, external={"tool0": [0, 0, 0, 0, 0, -20.0]})

        assert rne.Scene(irb140, controller=law).cost()["law"] == "traced"


class TestShapes:
    @pytest.fixture
    def kernel(self, irb140):
        return irb140.kernel(rne.dynamics.inverse_dynamics, external=["link_3", "tool0"])

    @pytest.mark.parametrize(
        "shapes", [((), (4,)), ((4,), ()), ((3, 1), (4,)), ((3, 4), (3, 4)), ((0,), ()), ((0,), (0,))]
    )
    def test_leading_axes_broadcast(self, irb140, kernel, shapes):
        rng = np.random.default_rng(0)
        q, a, b = rng.normal(size=6), *(rng.normal(size=(*shape, 6)) for shape in shapes)
        got = kernel(q, q, q, a, b)
        expected = rne.dynamics.inverse_dynamics(irb140.model, q, q, q, external={"link_3": a, "tool0": b})
        assert got.shape == expected.shape == (*np.broadcast_shapes(*shapes), 6)
        assert np.abs(got - expected).max(initial=0) <= 1e-13 * np.abs(expected).max(initial=0)
        assert np.array_equal(irb140.inverse_dynamics(q, q, q, external={"link_3": a, "tool0": b}), got)

    def test_the_widest_number_type_counts(self, irb140):
        s = [x.astype(np.float32) for x in states(6, 2)]
        for dtype in (np.float16, np.float32, np.float64, np.longdouble):
            external = {"tool0": np.ones(6, dtype)}
            got = irb140.inverse_dynamics(*s, external=external)
            assert got.dtype == rne.dynamics.inverse_dynamics(irb140.model, *s, external=external).dtype

    def test_lists_and_integers_are_taken(self, kernel):
        expected = kernel(np.zeros(6), np.zeros(6), np.zeros(6), np.arange(6.0), np.ones(6))
        assert np.array_equal(kernel([0] * 6, [0] * 6, [0] * 6, range(6), [1] * 6), expected)

    def test_out_is_filled_and_must_not_be_a_wrench(self, kernel):
        arrays = (*states(6, 7), *wrenches_on("ab", 7))
        out = np.empty((7, 6))
        assert kernel(*arrays, out=out) is out
        assert np.array_equal(out, kernel(*arrays))
        with pytest.raises(ValueError, match=r"^`out` must not share memory with `external_2`$"):
            kernel(*arrays, out=arrays[-1])

    def test_a_kernel_pickles(self, kernel):
        arrays = (*states(6, 7), *wrenches_on("ab", 7))
        copy = pickle.loads(pickle.dumps(kernel))
        assert copy.names == kernel.names == ("q", "qd", "qdd", "external_1", "external_2")
        assert np.array_equal(copy(*arrays), kernel(*arrays))

    def test_a_kernel_shows_its_links(self, kernel):
        count = sum(kernel.operations.values())
        text = f"Kernel inverse_dynamics of 'irb140' under wrenches on 'link_3', 'tool0': {count} operations"
        assert repr(kernel).startswith(text)

    def test_too_large_to_unroll_runs_as_the_recursion(self, irb140, monkeypatch):
        from rne.kernels import trace as module

        monkeypatch.setattr(module, "LIMIT", 100)
        kernel = rne.compile(rne.dynamics.inverse_dynamics, irb140.model, external=["tool0"])
        assert not kernel.is_unrolled
        s, (w,) = states(6, 4), wrenches_on(["tool0"], 4)
        assert np.array_equal(kernel(*s, w), rne.dynamics.inverse_dynamics(irb140.model, *s, external={"tool0": w}))
        slopes = rne.kernels.derivative(rne.dynamics.inverse_dynamics, irb140.model, "external_1", external=["tool0"])
        assert slopes(*s, w).shape == (4, 6, 6)


# Wrong calls of bias_torque under wrenches on link_3 and tool0: what is given, and the text.
GOOD = {"q": np.zeros(6), "qd": np.zeros(6), "link_3": np.ones(6), "tool0": np.ones(6)}
NAN = np.array([0, 0, 0, np.nan, 0, 0])
BATCH = np.zeros((4, 6))
WRONG = {
    "shape": ({"tool0": np.ones(3)}, "`external['tool0']` must have shape (..., 6), [moment; force], got (3,)"),
    "transposed": (
        {"tool0": np.ones((6, 4))},
        "`external['tool0']` must have shape (..., 6), [moment; force], got (6, 4)",
    ),
    "a number": ({"tool0": 1.0}, "`external['tool0']` must have shape (..., 6), [moment; force], got ()"),
    "nan": ({"tool0": NAN}, "`external['tool0']` must be finite, got nan at index (3,)"),
    "infinite": ({"link_3": -np.inf * np.ones(6)}, "`external['link_3']` must be finite, got -inf at index (0,)"),
    "nan for a batch": ({"q": BATCH, "tool0": NAN}, "`external['tool0']` must be finite, got nan at index (3,)"),
    "nan in a batch": (
        {"tool0": np.stack([NAN * 0 + 1, NAN])},
        "`external['tool0']` must be finite, got nan at index (0, 3)",
    ),
    "nan in float32": (
        {"tool0": NAN.astype(np.float32)},
        "`external['tool0']` must be finite, got nan at index (3,)",
    ),
    "nan of a joint for a batch": (
        {"q": np.array([0, np.nan, 0, 0, 0, 0]), "tool0": BATCH},
        "`q` must be finite, got nan at index (1,)",
    ),
    "several": ({"q": np.zeros(5), "tool0": NAN}, "`q` must have shape (..., 6) for robot 'irb140', got (5,)"),
    "both": ({"link_3": NAN, "tool0": np.ones(5)}, "`external['link_3']` must be finite, got nan at index (3,)"),
    "words": (
        {"tool0": ["a"] * 6},
        "`external['tool0']` must be an array of numbers of shape (..., 6), got dtype <U1",
    ),
    "ragged": (
        {"tool0": [[1, 2], [3]]},
        "`external['tool0']` must be an array of numbers of shape (..., 6), got rows of unequal length",
    ),
    "leading shapes": (
        {"q": BATCH, "tool0": np.ones((5, 6))},
        "leading shapes must broadcast against each other, got `q` (4, 6), `qd` (6,), `link_3` (6,), `tool0` (5, 6)",
    ),
    "overflow": (
        {"tool0": np.full(6, 1.7e308), "link_3": np.full(6, 1.7e308)},
        "bias_torque overflows float64 for these arguments; the result is not finite",
    ),
}
LINKS = ("link_3", "tool0")


def by_link(given):
    return {link: given[link] for link in LINKS}


@pytest.fixture(scope="module")
def warm():
    """A Robot that has the kernels, and their slopes."""
    robot = rne.load("irb140")
    robot.kernel(rne.dynamics.bias_torque, external=LINKS)
    robot.kernel(rne.dynamics.bias_torque, "q", external=LINKS)
    return robot


@pytest.mark.parametrize("case", WRONG)
def test_wrong_wrenches_are_named_alike_in_every_way(warm, case):
    changes, text = WRONG[case]
    given = GOOD | changes
    q, qd, external = given["q"], given["qd"], by_link(given)
    kernel, slopes = (warm.kernel(rne.dynamics.bias_torque, *wrt, external=LINKS) for wrt in ((), ("q",)))
    ways = {
        "function": lambda: rne.dynamics.bias_torque(warm.model, q, qd, external=external),
        "first call": lambda: rne.Robot(warm.model).bias_torque(q, qd, external=external),
        "kernel of the robot": lambda: warm.bias_torque(q, qd, external=external),
        "kernel": lambda: kernel(q, qd, *external.values()),
    }
    if case != "overflow":  # of slopes, which have no wrench in them, there is none
        ways["derivative"] = lambda: slopes(q, qd, *external.values())
    for way, call in ways.items():
        with pytest.raises(ValueError, match="^" + re.escape(text) + "$"):
            pytest.fail(f"{way}: {call()}")


@pytest.mark.parametrize(
    ("external", "text"),
    [
        ({"hand": np.zeros(6)}, "`external` must name links of {links}, got 'hand'"),
        ({"tool0": np.zeros(6), 3: np.zeros(6)}, "`external` must name links of {links}, got 3"),
        (np.zeros(6), "`external` must be a mapping of link name to wrench, got ndarray"),
        (["tool0"], "`external` must be a mapping of link name to wrench, got list"),
        ((), "`external` must be a mapping of link name to wrench, got tuple"),
        ("tool0", "`external` must be a mapping of link name to wrench, got str"),
    ],
)
@pytest.mark.parametrize("method", METHODS)
def test_what_maps_no_links_is_named_as_by_the_recursion(warm, method, external, text):
    s = states(6, 2)[: FUNCTIONS[method][1]]
    getattr(warm, method)(*s, external={"tool0": np.zeros(6)})  # its links are known from here on
    text = text.format(links=list(warm.link_names))
    for call in (getattr(warm, method), lambda *a, **k: FUNCTIONS[method][0](warm.model, *a, **k)):
        with pytest.raises(ValueError, match="^" + re.escape(text) + "$"):
            call(*s, external=external)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("link", ["base_link", "link_1", "tool0"])
def test_no_nan_passes_in_silence(warm, link, dtype):
    """Also where nothing depends on it: on the root, or across the axis of the only joint behind the link."""
    s = [x.astype(dtype) for x in states(6, 3)]
    for method in METHODS:
        call, arrays = getattr(warm, method), s[: FUNCTIONS[method][1]]
        for entry in range(6):
            wrench = np.zeros((3, 6), dtype)
            wrench[2, entry] = np.nan
            text = re.escape(f"`external[{link!r}]` must be finite, got nan at index (2, {entry})")
            with pytest.raises(ValueError, match=f"^{text}$"):
                call(*arrays, external={link: wrench})
            text = re.escape(f"`external[{link!r}]` must be finite, got nan at index ({entry},)")
            with pytest.raises(ValueError, match=f"^{text}$"):
                call(*(a[0] for a in arrays), external={link: wrench[2]})


def test_a_link_may_have_the_name_of_an_argument(irb140):
    model = replace(irb140.model, link_names=("base_link", "q", "qd", "external_1", "tau", "x", "y", "z"))
    (q, qd, qdd), (w,) = states(6, 3), wrenches_on(["q"])
    for link in ("q", "external_1"):
        expected = rne.dynamics.inverse_dynamics(model, q, qd[0], qdd[0], external={link: w})
        got = rne.compile(rne.dynamics.inverse_dynamics, model, external=[link])(q, qd[0], qdd[0], w)
        assert relative(got, expected) <= 1e-13


class TestCompiling:
    def refused(self, error, text, function=rne.dynamics.inverse_dynamics, make=rne.compile, wrt=(), **fixed):
        with pytest.raises(error, match="^" + re.escape(text) + "$"):
            make(function, rne.irb140(), *wrt, **fixed)

    @pytest.mark.parametrize("given", [{"link_6": np.zeros(6)}, "link_6", {"link_6"}, 6])
    def test_links_are_a_sequence_of_names(self, given):
        text = (
            "`external` of a kernel must be a sequence of link names, such as ['link_6'], got "
            f"{type(given).__name__}; the wrenches are arguments of its calls"
        )
        self.refused(TypeError, text, external=given)
        with pytest.raises(TypeError, match="^" + re.escape(text) + "$"):
            rne.load("irb140").kernel(rne.dynamics.inverse_dynamics, external=given)

    def test_an_unknown_link_is_named(self):
        links = list(rne.irb140().link_names)
        self.refused(ValueError, f"`external` must name links of {links}, got 'hand'", external=["tool0", "hand"])

    def test_a_repeated_link_is_named(self):
        text = "`external` must name each link once, got 'tool0' again"
        self.refused(ValueError, text, external=["tool0", "link_3", "tool0"])

    def test_functions_without_wrenches_refuse_them(self):
        text = "rne.dynamics.mass_matrix takes no external wrenches"
        self.refused(TypeError, text, function=rne.dynamics.mass_matrix, external=["tool0"])

    def test_a_robot_is_not_a_model(self, irb140):
        with pytest.raises(TypeError, match=r"^`model` must be an rne.Model, got Robot; a Robot has it as .model$"):
            rne.compile(rne.dynamics.inverse_dynamics, irb140, external=["tool0"])

    def test_a_record_is_not_compiled(self, irb140):
        with pytest.raises(TypeError, match=r"^`function` must give an array; rne.dynamics.recursion gives a record"):
            rne.compile(rne.dynamics.recursion, irb140.model, external=["tool0"])

    def test_wrt_names_the_arrays(self):
        text = "`wrt` must name arguments of ['q', 'qd', 'external_1'], got 'tool0'"
        self.refused(ValueError, text, rne.dynamics.bias_torque, rne.kernels.derivative, ("tool0",), external=["tool0"])

    def test_no_links_are_no_wrenches(self, irb140):
        for none in ((), [], None):
            assert rne.compile(rne.dynamics.inverse_dynamics, irb140.model, external=none).names == ("q", "qd", "qdd")

    def test_too_few_arguments_are_refused(self, irb140):
        with pytest.raises(TypeError, match=r"^this kernel takes q, qd, external_1; got 2 arguments$"):
            irb140.kernel(rne.dynamics.bias_torque, external=["tool0"])(np.zeros(6), np.zeros(6))

    def test_an_entry_is_printed_alone(self, irb140):
        kernel = irb140.kernel(rne.dynamics.inverse_dynamics, external=["tool0"])
        space = {}
        exec(kernel.source("python", "tau4"), space)
        s, (w,) = states(6), wrenches_on(["tool0"])
        assert space["tau4"](*s, w) == pytest.approx(kernel(*s, w)[3], rel=1e-13)
