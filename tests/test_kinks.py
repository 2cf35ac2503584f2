"""Derivatives of functions with kinks, jumps and infinite bounds: each call gives those of the side that is documented."""

import math
from functools import partial

import numpy as np
import pytest

import rne
from rne.commands.agreement import validate
from rne.elementwise import arctan2, clip, exp, less, maximum, minimum, sign, tanh, where
from rne.graph.graph import Graph
from rne.kernels import kernel as kernels
from rne.kernels import trace as module
from rne.simulation.plant import Plant

from .helpers import EPS, states
from .random_robots import random_tree

ROBOT = rne.Robot(random_tree(3, 4))
SAME = 40 * EPS  # relative: the same operations, added up in another order


def kinked(q, qd):
    """A function of every operation, with values on both sides of its kinks in random states."""
    size = np.sqrt(q @ q)
    angle = arctan2(q[0] - qd[1], 0.3 + q[1])
    choice = where(less(q, qd), tanh(q) * abs(qd), -exp(q) / (2 + np.cos(qd)))
    limited = clip(3 * q - qd, -1.0, np.inf) + maximum(q, qd) * minimum(q**3, 0.2) + sign(qd) * q**-2
    return np.stack([size, angle, *choice, *limited, abs(q[0]) ** 0.5, np.sin(2 / qd[0]) * 0 + q[0] ** 0])


class TestTooLargeToBeWrittenOut:
    def by_differences(self, x, h=1e-7):
        slopes = [(kinked(*np.split(x + h * e, 2)) - kinked(*np.split(x - h * e, 2))) / (2 * h) for e in np.eye(len(x))]
        return np.array(slopes).T

    def test_derivatives_are_those_that_are_written_out(self, monkeypatch):
        model, (q, qd) = random_tree(3, 4), states(3, 5, rate=1.0)[:2]
        function = rne.traceable(kinked)
        expected = rne.kernels.derivative(function, model, "q", "qd")(q, qd)
        np.testing.assert_allclose(expected[0], self.by_differences(np.r_[q[0], qd[0]]), rtol=1e-6, atol=1e-6)
        weights = np.random.default_rng(1).normal(size=expected.shape[1])
        monkeypatch.setattr(module, "LIMIT", 30)
        large = rne.kernels.derivative(function, model, "q", "qd")
        assert not large.is_unrolled
        monkeypatch.setattr(kernels, "NUMBERS", 1000)  # two states at once
        scale = np.abs(expected).max()
        np.testing.assert_allclose(large(q, qd), expected, rtol=0, atol=SAME * scale)
        np.testing.assert_allclose(large(q[0], qd[0]), expected[0], rtol=0, atol=SAME * scale)
        np.testing.assert_allclose(
            rne.kernels.gradient(function, model)(q, qd, weights), weights @ expected, rtol=0, atol=10 * SAME * scale
        )
        wide = large(q.astype(np.longdouble), qd.astype(np.longdouble))
        assert wide.dtype == np.longdouble
        np.testing.assert_allclose(wide.astype(float), expected, rtol=0, atol=SAME * scale)
        assert large(*(a.astype(np.float32) for a in (q, qd))).dtype == np.float32

    def test_ties_are_those_that_are_written_out(self, monkeypatch):
        model, zero = random_tree(3, 4), np.zeros(3)

        @rne.traceable
        def ties(q, qd):
            later = q[1] * 2.0
            return np.stack([maximum(qd[0], q[0]), minimum(q[0], qd[0]), maximum(later, q[1]), clip(q[2], 0.0, 1.0),
                             abs(q[0]), sign(q[1]), where(less(q[0], qd[0]), q[2], qd[2])])  # fmt: skip

        expected = rne.kernels.derivative(ties, model, "q", "qd")(zero, zero)
        monkeypatch.setattr(module, "LIMIT", 4)
        np.testing.assert_array_equal(rne.kernels.derivative(ties, model, "q", "qd")(zero, zero), expected)

    def test_of_the_robot_and_its_couplings(self, monkeypatch):
        model = rne.model.coupled(random_tree(3, 4), {"joint2": (["joint0"], lambda x: 0.4 * abs(x) - 0.2 * x)})
        q, qd, qdd = states(2, 3)
        expected = rne.kernels.derivative(rne.dynamics.inverse_dynamics, model, "q")(q, qd, qdd)
        monkeypatch.setattr(module, "LIMIT", 200)
        found = rne.kernels.derivative(rne.dynamics.inverse_dynamics, model, "q")(q, qd, qdd)
        np.testing.assert_allclose(found, expected, rtol=0, atol=SAME * np.abs(expected).max())

    def test_what_a_bound_makes_constant_does_not_change_behind_it(self, monkeypatch):
        """A root of 0 has an infinite derivative, and none that counts where the 0 is a bound: forwards as backwards."""
        model = random_tree(3, 4)

        @rne.traceable
        def speeds(q, qd):
            left = 2 * maximum(q - 0.5, 0.0)
            return np.stack([*np.sqrt(left), arctan2(left[0], left[0]) * qd[0], np.sqrt(left @ left), qd[1] / qd[2]])

        for limit in (module.LIMIT, 6):
            monkeypatch.setattr(module, "LIMIT", limit)
            slopes = rne.kernels.derivative(speeds, model, "q", "qd")
            for q in ([0.5, -0.3, 0.7], [0.1, 0.5, 0.7]):
                found = slopes(q, [0.3, 0.1, 0.2])
                np.testing.assert_array_equal(found[:, :2], 0.0)
                np.testing.assert_allclose(found[2:5, 2], [1 / np.sqrt(0.4), 0.0, 2.0], rtol=SAME)
        with pytest.raises(rne.NotFiniteError, match="the result is not finite"):
            rne.kernels.derivative(rne.traceable(lambda q: np.sqrt(q @ q)), model, "q")([0.0, 0.0, 0.0])

    def test_a_function_may_be_too_large_whose_derivative_is_not(self, monkeypatch):
        monkeypatch.setattr(module, "LIMIT", 8)
        steps = rne.traceable(lambda q: sum(sign(x - 0.1 * k) for x in q for k in range(4)) + 2 * q[0])
        slopes = rne.kernels.derivative(steps, random_tree(2, 1), "q")
        np.testing.assert_array_equal(slopes([0.25, -0.75]), [2.0, 0.0])

    def test_numbers_of_a_run_are_numbers_of_what_is_too_large(self, monkeypatch):
        """Six numbers, of which the program takes three products."""
        robot, found = rne.Robot(random_tree(3, 2)), []
        a, b = np.array([1.0, 2.0, 3.0]), np.array([3.0, 1.0, 2.0])
        law = rne.traceable(lambda t, q, qd: where(less(q, 0.35), a * b * q**2, -a * b * abs(qd)))
        for limit in (module.LIMIT, 300):
            monkeypatch.setattr(module, "LIMIT", limit)
            scene = rne.Scene(rne.Robot(robot.model), controller=law)
            assert scene.numbers["controller.a"].size + scene.numbers["controller.b"].size == 6
            x = np.array([0.3, -0.2, 0.4, 0.7, -0.4, 0.5, *np.zeros(scene.dynamics.size - 6)])
            found.append(Plant(scene.dynamics, scene.resolved.robot).jacobian(0.0, x))
        np.testing.assert_allclose(found[1], found[0], rtol=1e-12, atol=1e-12)  # sums in another order

    def test_a_derivative_that_is_infinite_is_an_error(self, monkeypatch):
        monkeypatch.setattr(module, "LIMIT", 2)
        root = rne.kernels.gradient(rne.traceable(lambda q: np.sqrt(q @ q)), random_tree(2, 1))
        np.testing.assert_allclose(root([3.0, 4.0]), [0.6, 0.8], rtol=SAME)
        with pytest.raises(rne.NotFiniteError, match="the result is not finite"):
            root([0.0, 0.0])

    def test_what_is_too_large_for_that_too_is_refused(self, monkeypatch):
        monkeypatch.setattr(module, "LIMIT", 1)

        @rne.traceable
        def wide(q):
            return sum(exp(k * x) for k in range(5) for x in q)

        kernel = rne.kernels.gradient(wide, ROBOT.model)
        text = r"^wide takes more than 8 operations: too large to be differentiated$"
        with pytest.raises(TypeError, match=text):
            kernel(np.ones(3), [1.0])


class TestFirstCalls:
    @pytest.mark.parametrize("dtype", [np.float32, np.float64, np.longdouble])
    def test_of_a_single_number_are_of_the_same_type(self, dtype):
        robot, q = rne.Robot(random_tree(2, 1)), np.ones(2, dtype)
        assert {type(robot.potential_energy(q)) for _ in range(3)} == {dtype}

    def test_of_a_robot_whose_coupling_has_a_kink(self):
        model = rne.model.coupled(
            random_tree(3, 4), {"joint2": (["joint0"], lambda x: 0.7 * abs(x - 0.1) + sign(x) / 9)}
        )
        q, qd, qdd = states(2)
        robot = rne.Robot(model)
        first, again = (robot.linearize(q, qd, qdd)[0] for _ in range(2))
        np.testing.assert_array_equal(first, again)
        h = 1e-6 * np.eye(2)[0]
        slope = (robot.forward_dynamics(q + h, qd, qdd) - robot.forward_dynamics(q - h, qd, qdd)) / 2e-6
        np.testing.assert_allclose(first[2:, 0], slope, rtol=1e-6, atol=1e-6 * abs(slope).max())

    def test_of_the_modes_of_a_scene(self):
        class Drag(rne.Friction):
            def viscous_torque(self, qd):
                return 2 * abs(qd) * qd

        robot = rne.Robot(random_tree(2, 1))
        scene = rne.Scene(robot, friction=Drag(viscous=1.0))
        x = np.array([0.3, -0.2, 0.7, -0.4, *np.zeros(scene.dynamics.size - 4)])
        first, again = (Plant(scene.dynamics, robot).linearised(0.0, x) for _ in range(2))
        np.testing.assert_array_equal(first, again)
        np.testing.assert_allclose(
            -robot.mass_matrix(x[:2]) @ first[2:4, 2:4], self.drag_and_coriolis(robot, x), rtol=1e-6
        )

    def drag_and_coriolis(self, robot, x, h=1e-6):
        """Derivative of bias torques and drag by the velocities, by differences."""
        torques = [robot.bias_torque(x[:2], v) + 2 * abs(v) * v for s in (h, -h) for v in x[2:4] + s * np.eye(2)]
        return (np.array(torques[:2]) - torques[2:]).T / (2 * h)

    def test_energies_of_a_coupling_with_a_kink_agree_with_its_torques(self):
        """By complex steps through kinetic and potential energy."""
        model = rne.model.coupled(random_tree(2, 4), {"joint1": (["joint0"], lambda x: x / 3 + abs(x) / 2)})
        _, matches = validate(rne.Robot(model), 10)
        assert all(match.worst <= match.bound for match in matches)

    def test_an_unstable_loop_is_unstable_with_an_infinite_bound(self):
        """Near zero the law pushes the joints away: -40 q + 90 (abs(2 + q) - 2) is +50 q."""
        robot = rne.Robot(random_tree(1, 1))

        @rne.traceable
        def law(t, q, qd):
            return clip(robot.gravity_torque(q) - 40 * q + 90 * (abs(2 + q) - 2) - 30 * qd, -np.inf, np.inf)

        assert not rne.Scene(robot, controller=law).check_gains([0.0]).stable

    def test_a_kink_at_the_target_is_judged_on_both_sides(self):
        """On one side -40 q - 90 abs(q) is +50 q, though abs has the slope 0 at 0."""
        robot = rne.Robot(random_tree(1, 1))

        def law(t, q, qd, k=-90.0):
            return robot.gravity_torque(q) - 40 * q + k * abs(q) - 30 * qd

        gentle = rne.traceable(lambda t, q, qd: law(t, q, qd, 30.0))
        for controller, stable in ((rne.traceable(partial(law, k=-90.0)), False), (law, False), (gentle, True)):
            assert rne.Scene(robot, controller=controller).check_gains([0.0]).stable is stable

    def test_a_loop_whose_torques_jump_at_the_target_has_no_poles(self):
        """Compensated friction, by its sign; where it jumps elsewhere, or is steep, it has."""
        robot = rne.Robot(random_tree(1, 1))

        def law(t, q, qd, f=sign):
            return robot.gravity_torque(q) - 40 * q - 30 * qd + 2 * f(qd)

        for controller in (law, rne.traceable(law)):
            with pytest.raises(
                ValueError, match=r"^the torques of `controller` jump by 4 N m or N at the target, so th"
            ):
                rne.Scene(robot, controller=controller).check_gains([0.0])
        for f, stable in ((lambda v: sign(v - 0.1), True), (lambda v: tanh(1e3 * v), False), (lambda v: abs(v), True)):
            controller = rne.traceable(lambda t, q, qd, f=f: law(t, q, qd, f))
            assert rne.Scene(robot, controller=controller).check_gains([0.0]).stable is stable


class TestInfiniteBounds:
    def test_they_are_folded(self):
        """Beside an input, which is finite: less(x, inf) is 1 and minimum(x, inf) is x."""
        graph = Graph()
        x, one, zero = graph.input(0), graph.constant(1.0), graph.constant(0.0)
        above, below = graph.constant(math.inf), graph.constant(-math.inf)
        for a in (x, x ^ 1):
            for f in ("minimum", "maximum"):
                bound, other = (above, below) if f == "minimum" else (below, above)
                assert graph.binary(f, a, bound) == graph.binary(f, bound, a) == a
                assert graph.binary(f, a, other) == graph.binary(f, other, a) == other
            for f in ("less", "less_equal"):
                assert graph.binary(f, a, above) == graph.binary(f, below, a) == one
                assert graph.binary(f, a, below) == graph.binary(f, above, a) == zero
        assert len(graph.nodes) == 4

    def test_they_cost_nothing_and_change_nothing(self):
        robot = rne.Robot(random_tree(2, 1))

        def power(q, qd, *limits):
            torque = robot.bias_torque(q, qd)
            return abs((clip(torque, *limits) if limits else torque) * qd).sum()

        bounded = rne.kernels.gradient(rne.traceable(lambda q, qd: power(q, qd, [-np.inf] * 2, np.inf)), robot.model)
        free = rne.kernels.gradient(rne.traceable(lambda q, qd: power(q, qd)), robot.model)
        assert bounded.operations == free.operations
        q, qd = states(2)[:2]
        np.testing.assert_array_equal(bounded(q, qd), free(q, qd))

    def test_what_may_be_infinite_itself_is_compared(self):
        """1 / q is infinite at 0, and -inf or NaN then pass through the bound as they do in NumPy."""
        function = rne.traceable(lambda q: where(less(1 / q[0], math.inf), q[1], 7.0) + maximum(exp(q[0]), -math.inf))
        kernel = rne.compile(function, random_tree(2, 1))
        assert kernel([1.0, 2.0]) == 2.0 + math.e
        assert kernel([0.0, 2.0]) == 8.0

    def test_an_infinite_choice_is_a_constant_of_the_program(self):
        barrier = rne.traceable(lambda q: minimum(where(less(q[0], 0.0), math.inf, q[0] * q[1]), 5.0 + q[1]))
        kernel = rne.kernels.gradient(barrier, random_tree(2, 1))
        assert kernel.is_unrolled
        np.testing.assert_array_equal([kernel([2.0, 0.5]), kernel([-1.0, 0.5])], [[0.5, 2.0], [0.0, 1.0]])
        assert rne.compile(barrier, random_tree(2, 1))([-1.0, 0.5]) == 5.5


def test_complex_numbers_are_chosen_by_their_real_parts():
    """So that complex steps through a choice are those of the branch taken."""
    a, b = np.array([1 + 2j, -1 + 1j, 2 - 3j]), np.array([1 + 1j, 2 - 3j, np.nan])
    np.testing.assert_array_equal(sign(a), [1, -1, 1])
    np.testing.assert_array_equal(less(a, b), [False, True, False])
    np.testing.assert_array_equal(minimum(a, b), [b[0], a[1], np.nan])
    np.testing.assert_array_equal(maximum(a, b), [b[0], b[1], np.nan])
    np.testing.assert_array_equal(maximum(b, a)[2], np.nan)


class TestSingleNumbers:
    """Of rne.elementwise: np.array takes them as it takes entries of q, so that laws are traced."""

    @pytest.mark.parametrize(
        "function",
        {
            "all": lambda q: np.array([exp(q[0]), tanh(q[1]), sign(q[2]), arctan2(q[0], q[1]), clip(q[2], -1, 1)]),
            "two rows": lambda q: np.array([[minimum(q[0], q[1]), 2.0], [where(less(q[0], 0), q[1], 1), maximum(0, q[2])]]),
            "joined": lambda q: np.concatenate([np.stack([exp(q[0]), q[1] * 2]), np.hstack([tanh(q[0]), q[1:]])]),
            "bare": lambda q: exp(q[0]),
            "subscripts": lambda q: np.concatenate([exp(q[0])[None], q[1:] * tanh(q[2])[()]]),
            "list": lambda q: [clip(q[0], 0, 1), q[1]],
            "as an array of its own": lambda q: np.array([np.asarray(q[0]), q[1]]),
            "of functions": lambda q: np.sin(np.array([exp(q[0]), arctan2(q[1], 2.0)])),
            "energies": lambda q: np.array([ROBOT.kinetic_energy(q, q), ROBOT.potential_energy(q)]),
            "argument of a robot": lambda q: ROBOT.gravity_torque(np.array([clip(q[0], -1, 1), exp(q[1]), 0.0])),
            "list for a robot": lambda q: ROBOT.gravity_torque([q[0], exp(q[1]), 0.0]),
            "norms": lambda q: np.linalg.norm(np.stack([q, 2 * q]), axis=1) * np.vecdot(q, q),
        }.values(),
    )  # fmt: skip
    def test_they_are_traced(self, function):
        kernel, (q, *_) = rne.compile(rne.traceable(function), ROBOT.model), states(3)
        np.testing.assert_allclose(kernel(q), function(q), rtol=SAME, atol=SAME)

    def test_one_that_is_put_into_an_array_of_floats_says_that_it_has_no_value(self, caplog):
        def law(t, q, qd):
            torques = np.zeros(3)
            torques[0] = clip(q[0], -1, 1)
            return torques

        assert not rne.Scene(ROBOT, controller=rne.traceable(law)).is_traced
        assert "TypeError: a traced number has no value" in caplog.text

    def test_of_laws(self):
        law = rne.traceable(lambda t, q, qd: np.array([clip(-60 * q[k] - 4 * qd[k], -30, 30) for k in range(3)]))
        assert rne.Scene(ROBOT, controller=law).is_traced
