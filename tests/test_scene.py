"""Scenes: each part is felt, costs what it says, and nothing else is there."""

import math
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import rne
from rne.simulation.dry_friction import DryPlant
from rne.simulation.plant import Plant

from .helpers import first_joints, kept, relative, states
from .random_robots import random_tree, straight_chain

EVERYTHING = {
    "payload": rne.Payload(5.0, [0.05, 0.02, 0.1]),
    "friction": rne.Friction(viscous=[1, 2, 3, 1, 1, 1], coulomb=2.0, coulomb_back=3.0),
    "armature": [0.5, 0.5, 0.2, 0.1, 0.1, 0.1],
}


@pytest.fixture(scope="module")
def full(irb140):
    return rne.Scene(irb140, **EVERYTHING)


class TestDynamics:
    @pytest.mark.parametrize("smoothing", [0.0, 0.01])
    def test_forward_dynamics_undo_inverse_dynamics(self, irb140, smoothing):
        """With armature and friction on; of dry friction wherever every joint moves."""
        friction = rne.Friction(viscous=1.0, viscous_back=2.0, coulomb=[1, 2, 3, 4, 5, 6], smoothing=smoothing)
        scene = rne.Scene(irb140, **{**EVERYTHING, "friction": friction})
        q, qd, qdd = states(6, 100)
        back = scene.forward_dynamics(q, qd, scene.inverse_dynamics(q, qd, qdd))
        condition = np.linalg.cond(scene.resolved.robot.mass_matrix(q)).max()
        assert relative(back, qdd) <= 50 * np.finfo(float).eps * condition

    def test_right_hand_side_is_the_scene_written_out(self, full):
        q, qd, _ = states(6, 20)
        kernel = Plant(full.dynamics, full.resolved.robot).kernel
        rates = kernel(np.zeros((20, 1)), np.concatenate([q, qd, np.zeros((20, 2))], axis=1), full.dynamics.vector)
        assert np.array_equal(rates[:, :6], qd)
        assert relative(rates[:, 6:12], full.forward_dynamics(q, qd, 0 * q)) <= 1e-11
        friction = full.resolved.friction
        assert rates[:, 12] == pytest.approx((friction.viscous_torque(qd) * qd).sum(-1), rel=1e-13)
        assert rates[:, 13] == pytest.approx((friction.coulomb_torque(qd) * qd).sum(-1), rel=1e-13)
        assert relative(full.kernel(np.zeros((20, 1)), np.concatenate([q, qd], axis=1)), rates[:, :12]) <= 1e-15

    def test_friction_of_the_file_is_added(self, tmp_path):
        text = rne.to_urdf(straight_chain(1)).replace("</joint>", '<dynamics damping="0.7" friction="0.3"/></joint>')
        (tmp_path / "arm.urdf").write_text(text)
        scene = rne.Scene(rne.load(tmp_path / "arm.urdf"), friction="urdf")
        q = np.zeros(1)
        extra = scene.inverse_dynamics(q, [2.0], q) - scene.robot.inverse_dynamics(q, [2.0], q)
        assert extra[0] == pytest.approx(0.7 * 2.0 + 0.3, rel=1e-12)

    def test_mounting_turns_gravity(self, irb140):
        hanging = rne.Scene(irb140, mounting=[np.pi, 0, 0])
        q = states(6)[0]
        assert np.allclose(hanging.resolved.robot.gravity_torque(q), -irb140.gravity_torque(q), atol=1e-12)

    def test_locked_joints_are_no_coordinates(self, irb140):
        scene = rne.Scene(irb140, locked={"joint_4": 0.3})
        assert scene.n == 5
        assert scene.kernel.widths == (1, 10)


class TestCost:
    def test_what_is_not_named_costs_nothing(self, irb140):
        plain = sum(rne.Scene(irb140).kernel.operations.values())
        assert plain <= sum(irb140.kernel(rne.dynamics.forward_dynamics).operations.values())
        assert rne.Scene(irb140).cost() == {"total": plain, "gravity": 4, "law": "none"}

    def test_parts_are_what_is_saved_without_them(self, irb140, full):
        costs = full.cost()
        for part in EVERYTHING:
            less = rne.Scene(irb140, **{k: v for k, v in EVERYTHING.items() if k != part})
            assert costs[part] == costs["total"] - less.cost()["total"] > 0

    def test_cost_falls_from_everything_to_hardly_anything(self, irb140, full):
        wrist = {f"joint_{k}": 0.0 for k in (4, 5, 6)}
        one = {f"joint_{k}": 0.0 for k in (1, 3, 4, 5, 6)}
        scenes = [
            full,
            rne.Scene(irb140),
            rne.Scene(irb140, gravity=[0, 0, 0]),
            rne.Scene(irb140, locked=wrist),
            rne.Scene(irb140, locked=one),
            rne.Scene(irb140, locked=one, gravity=[0, 0, 0]),
        ]
        costs = [scene.cost()["total"] for scene in scenes]
        assert costs == sorted(costs, reverse=True)
        assert costs[-2] <= 10
        assert costs[-1] == 0

    def test_controller_and_model_share_the_weight(self, irb140):
        """The law's gravity term alone is more than the whole law adds to the right-hand side."""
        law = rne.control.pd_gravity(irb140, [50] * 6, [20] * 6, [0] * 6)
        costs = rne.Scene(irb140, controller=law).cost()
        alone = sum(irb140.kernel(rne.dynamics.gravity_torque).operations.values())
        assert costs["law"] == "traced"
        assert costs["controller"] < alone + 6 * 4 + 11  # feedback: 4 a joint; power: 11

    def test_a_sampled_scene_costs_what_its_held_torques_do(self, irb140):
        law = rne.control.pd(irb140, [50] * 6, [20] * 6, [0] * 6)
        limits = {"sample_time": 1e-3, "effort_limit": [40.0] * 6, "torque_rate": [1e3] * 6}
        costs = rne.Scene(irb140, controller=law, **limits).cost()
        assert costs["controller"] == costs["total"] - rne.Scene(irb140).cost()["total"] > 0

    def test_called_law_says_so(self, irb140):
        assert rne.Scene(irb140, controller=lambda t, q, qd: -qd).cost()["law"] == "called"


COUNTER = []
GAINS = 5 * np.eye(6) + np.ones((6, 6))
SPLINE = CubicSpline([0, 1, 2], [0.0, 1.0, 0.0])


class TestTracing:
    @pytest.mark.parametrize(
        ("law", "reason"),
        [
            (lambda t, q, qd: -np.sum(COUNTER.append(1) or len(COUNTER)) * qd, "traced, it differs by "),
            (lambda t, q, qd: -qd if t < 1 else qd, "TypeError: a traced number has no value: a branch"),
            (lambda t, q, qd: math.sin(t) - qd, "TypeError: a traced number has no value: a branch"),
            (lambda t, q, qd: np.log1p(-t) - qd, "TypeError: loop of ufunc does not support argument 0 of type Scalar"),
            (lambda t, q, qd: SPLINE(t) - qd, ""),
        ],
        ids=["memory", "branch", "math.sin", "np.log1p", "spline"],
    )
    def test_a_law_that_cannot_be_traced_is_called_and_the_log_says_so(self, two, law, reason, caplog):
        scene = rne.Scene(two, controller=rne.traceable(law))
        assert scene.cost()["law"] == "called"
        (line,) = [record.getMessage() for record in caplog.records if record.name == "rne"]
        assert line.startswith(f"`controller` is called, not traced: {reason}")
        if law(0.0, np.ones(1), np.ones(1)) != law(0.0, np.ones(1), np.ones(1)):
            return  # it has memory
        motion = rne.simulate(scene, [0] * 2, [0] * 2, 0.1)
        assert np.array_equal(motion.q, rne.simulate(two, [0] * 2, [0] * 2, 0.1, torque=law).q)

    @pytest.mark.parametrize(
        "law",
        [
            pytest.param(lambda t, q, qd: -GAINS @ q - 2 * qd, marks=pytest.mark.long),
            lambda t, q, qd: np.array([-5 * q[0] * t**3, -3 * q[1] + np.sin(t), *(-qd[2:])]),
            pytest.param(lambda t, q, qd: [np.cos(q[0]), *(t * np.arange(5.0))], marks=pytest.mark.long),
            lambda t, q, qd: -np.tanh(q) * np.sqrt(4 + t * t) + GAINS[0] / (1 + t**2),
            pytest.param(lambda t, q, qd: 3.0 * np.ones(6), marks=pytest.mark.long),
        ],
        ids=["matrix", "entries", "list", "functions", "constant"],
    )
    def test_laws_are_traced_as_people_write_them(self, irb140, law):
        scene = rne.Scene(irb140, controller=rne.traceable(law))
        assert scene.cost()["law"] == "traced"
        traced = rne.simulate(scene, [0.1] * 6, [0] * 6, 0.2, rtol=1e-9)
        called = rne.simulate(irb140, [0.1] * 6, [0] * 6, 0.2, torque=law, rtol=1e-9)
        np.testing.assert_allclose(traced.q[-1], called.q[-1], atol=1e-9)
        np.testing.assert_allclose(traced.tau[-1], law(0.2, traced.q[-1], traced.qd[-1]), rtol=1e-12, atol=1e-12)

    @pytest.mark.parametrize(
        "rates",
        [lambda q, z: np.array([1.0, -2.0]), lambda q, z: np.array([1.0 - z[0], 2.0]), lambda q, z: q[:2] - q[0]],
    )
    def test_rates_that_are_constant_or_of_one_state_are_traced(self, irb140, rates):
        """The rates of many states at once are compared with those of each, as their torques are."""
        law = rne.traceable(lambda t, q, qd, z: (-5 * q, rates(q, z)))
        law.states = 2
        scene = rne.Scene(irb140, controller=law)
        assert scene.cost()["law"] == "traced"
        ends = []
        for law.traceable in (True, False):
            motion = rne.simulate(rne.Scene(irb140, controller=law), [0.1, 0.3] * 3, [0] * 6, 0.1, rtol=1e-9)
            ends.append(motion.controller_state[-1])
        np.testing.assert_allclose(*ends, atol=1e-8)

    @pytest.mark.parametrize("n", [2, 3])
    def test_a_matrix_times_as_many_states_as_joints_is_no_law_of_many_states(self, n):
        """-2 I q is -2 q of n states too, but of no other number of them."""
        robot, gains = rne.Robot(straight_chain(n)), 2 * np.eye(n)
        scene = rne.Scene(
            robot, controller=rne.traceable(lambda t, q, qd: -gains @ (q + qd)), friction=rne.Friction(viscous=1.0)
        )
        assert scene.cost()["law"] == "traced"
        x = np.random.default_rng(0).uniform(-1, 1, (n, 2 * n))
        u, _ = scene.dynamics.drives(np.zeros((n, 1)), x, None)
        assert np.array_equal(u, -2 * (x[:, :n] + x[:, n:]))

    def test_a_reference_may_be_a_spline(self, irb140):
        path = CubicSpline([0, 1, 2], np.outer([0, 1, 0], np.ones(6)))
        law = rne.control.computed_torque(irb140, [100] * 6, [20] * 6, lambda t: (path(t), path(t, 1), path(t, 2)))
        motion = rne.simulate(rne.Scene(irb140, controller=law), path(0.0), path(0.0, 1), 1.0)
        np.testing.assert_allclose(motion.q, path(motion.t), atol=1e-5)

    def test_a_reference_of_a_wrong_shape_is_named(self, irb140):
        law = rne.control.computed_torque(
            irb140, [100] * 6, [20] * 6, lambda t: (np.zeros(6), np.zeros(6), np.zeros(6 if t < 0.05 else 2))
        )
        text = r"^`reference` must give \(q, qd, qdd\) of shape \(6,\) each, got \[\(6,\), \(6,\), \(2,\)\]$"
        with pytest.raises(ValueError, match=text):
            rne.simulate(rne.Scene(irb140, controller=law), [0] * 6, [0] * 6, 0.1)

    def test_traced_and_called_laws_move_alike(self, irb140):
        law = rne.control.pd_gravity(irb140, [50] * 6, [20] * 6, [0.1] * 6)
        times = np.linspace(0, 0.5, 11)
        how = {"rtol": 1e-9, "atol": 1e-12, "t_eval": times}
        traced = rne.simulate(rne.Scene(irb140, controller=law), [0] * 6, [0] * 6, 0.5, **how)
        called = rne.simulate(irb140, [0] * 6, [0] * 6, 0.5, torque=law, **how)
        assert np.abs(traced.q - called.q).max() <= 1e-8
        assert np.abs(traced.work - called.work).max() <= 1e-6

    def test_elementwise_branches_are_traced(self, irb140):
        def law(t, q, qd):
            return rne.elementwise.where(rne.elementwise.less(t, 0.5), -qd, -2 * qd) + rne.elementwise.clip(
                q, -0.1, 0.1
            )

        scene = rne.Scene(irb140, controller=rne.traceable(law))
        for t in (0.4, 0.6):
            q, qd = states(6)[:2]
            x = np.concatenate([q, qd])
            expected = irb140.forward_dynamics(q, qd, law(t, q, qd))
            assert relative(scene.kernel(np.array([t]), x)[6:12], expected) <= 1e-11

    def test_jacobian_is_the_derivative_of_the_right_hand_side(self):
        """Exact with a traced law, friction and limits, against central differences."""
        arm = first_joints()
        law = rne.control.pid(arm, [50] * 3, [5] * 3, [20] * 3, [0.1] * 3, gravity=True)
        scene = rne.Scene(arm, controller=law, friction=rne.Friction(1.0, 2.0, smoothing=0.5), effort_limit=[300] * 3)
        plant = Plant(scene.dynamics, scene.resolved.robot)
        x = np.random.default_rng(1).uniform(-1, 1, scene.dynamics.size)
        J = plant.jacobian(0.0, x)
        h = 1e-6
        for j in range(len(x)):
            e = np.zeros(len(x))
            e[j] = h
            slope = (plant(0.0, x + e) - plant(0.0, x - e)) / (2 * h)
            assert np.abs(slope - J[:, j]).max() <= 1e-6 * max(1.0, np.abs(J[:, j]).max())

    def test_scene_pickles_with_its_kernel(self, full):
        full.kernel  # noqa: B018
        again = pickle.loads(pickle.dumps(full))
        x = np.concatenate(states(6)[:2])
        assert np.array_equal(again.kernel(np.zeros(1), x), full.kernel(np.zeros(1), x))


def test_one_number_is_meant_for_all_joints_of_a_scene(irb140):
    law = rne.control.pd(irb140, 50, 20, 0)
    one, six = (
        rne.Scene(irb140, controller=law, sample_time=1e-3, armature=x(2.0), effort_limit=x(40), torque_rate=x(np.inf))
        for x in (lambda a: a, lambda a: [a] * 6)
    )
    for name in ("effort_limit", "torque_rate"):
        np.testing.assert_array_equal(getattr(one.resolved, name), getattr(six.resolved, name))
    np.testing.assert_array_equal(one.resolved.robot.model.armature, [2.0] * 6)


class TestLimits:
    def test_torques_are_held_within_limits(self, irb140):
        law = rne.control.pd(irb140, [5000] * 6, [20] * 6, [1] * 6)
        motion = rne.simulate(rne.Scene(irb140, controller=law, effort_limit=[40] * 6), [0] * 6, [0] * 6, 0.05)
        assert np.abs(motion.tau).max() == 40.0

    def test_a_stop_ends_the_run_where_it_is(self, irb140):
        motion = rne.simulate(rne.Scene(irb140, stops=True), [0] * 6, [0] * 6, 3.0)
        assert motion.status == 1
        assert motion.q[-1, 1] == pytest.approx(irb140.model.upper[1], abs=1e-12)
        assert re.search(r"'joint_2' reached its stop at 1.74533 at t = 0.744583 s$", motion.message)

    def test_a_stop_ends_a_sampled_run_too(self, irb140):
        law = rne.control.pd(irb140, [1e-9] * 6, [1e-9] * 6, [0] * 6)
        scene = rne.Scene(irb140, stops=True, controller=law, sample_time=0.01)
        motion = rne.simulate(scene, [0] * 6, [0] * 6, 3.0, rtol=1e-9)
        assert motion.status == 1
        assert motion.t[-1] == pytest.approx(0.744583, abs=1e-5)

    def test_rate_limit_bounds_the_step_between_samples(self, irb140):
        law = rne.control.pd(irb140, [500] * 6, [20] * 6, [1] * 6)
        scene = rne.Scene(irb140, controller=law, sample_time=1e-4, torque_rate=[1000.0] * 6)
        motion = rne.simulate(scene, [0] * 6, [0] * 6, 0.02)
        assert np.abs(np.diff(motion.tau, axis=0)).max() <= 1000 * 1e-4 * (1 + 1e-9)

    def test_the_first_torque_is_not_held_to_the_rate(self, irb140):
        law = rne.control.pd(irb140, [500] * 6, [20] * 6, [1] * 6)
        scene = rne.Scene(irb140, controller=law, sample_time=1e-3, torque_rate=[1000.0] * 6)
        assert rne.simulate(scene, [0] * 6, [0] * 6, 2e-3).tau[0] == pytest.approx(500)

    def test_rate_limit_counts_from_the_limited_torque(self, irb140):
        """Asked for +-100 N m, limited to 10 N m and 5 N m per sample: from 10 it comes back at once."""
        scene = rne.Scene(
            irb140, controller=lambda t, q, qd: np.full(6, 100.0 if t < 0.0015 else -100.0), sample_time=1e-3,
            effort_limit=[10.0] * 6, torque_rate=[5000.0] * 6,
        )  # fmt: skip
        motion = rne.simulate(scene, [0] * 6, [0] * 6, 7e-3)
        assert motion.tau[:-1, 0] == pytest.approx([10, 10, 5, 0, -5, -10, -10])

    @pytest.mark.parametrize(("rate", "bound"), [(2.0, "upper"), (-2.0, "lower")])
    def test_each_end_of_a_range_is_a_stop(self, irb140, rate, bound):
        """A joint that turns at a constant rate is stopped when it has passed through its range."""
        model = replace(irb140.model, gravity=np.zeros(3))
        scene = rne.Scene(rne.Robot(model).locked({f"joint_{k}": 0.0 for k in range(2, 7)}), stops=True)
        motion = rne.simulate(scene, [0.0], [rate], 10.0)
        end = getattr(irb140.model, bound)[0]
        assert motion.status == 1
        assert motion.q[-1, 0] == pytest.approx(end, rel=1e-12)
        assert motion.message.endswith(f"'joint_1' reached its stop at {end:.6g} at t = {end / rate:.6g} s")

    def test_held_torques_change_at_samples_only(self, irb140):
        law = rne.control.pd(irb140, [50] * 6, [20] * 6, [1] * 6)
        scene = rne.Scene(irb140, controller=law, sample_time=1e-3)
        motion = rne.simulate(scene, [0] * 6, [0] * 6, 5e-3, t_eval=np.arange(51) * 1e-4)
        changes = np.nonzero(np.abs(np.diff(motion.tau[:, 0])) > 0)[0] + 1
        assert set(changes) <= {10, 11, 20, 21, 30, 31, 40, 41}
        assert len(changes) == 4


@pytest.mark.parametrize(
    ("parts", "error", "text"),
    [
        ({"friction": "rust"}, ValueError, "`friction` must be an rne.Friction or 'urdf', got 'rust'"),
        ({"friction": 3}, TypeError, "`friction` must be an rne.Friction or 'urdf', got int"),
        (
            {"friction": rne.Friction([1, 2])},
            ValueError,
            "`viscous` of the friction must be a number or of shape (6,), got (2,)",
        ),
        ({"armature": [1]}, ValueError, "`armature` must have shape (6,), got (1,)"),
        ({"armature": [-1] * 6}, ValueError, "`armature[0]` of joint 'joint_1' must not be negative, got -1.0"),
        ({"effort_limit": "file"}, ValueError, "`effort_limit` must be an array or 'urdf', got 'file'"),
        ({"effort_limit": True}, ValueError, "`effort_limit` must be an array or 'urdf', got True"),
        ({"controller": 3}, TypeError, "`controller` must be a function of (t, q, qd), got int"),
        ({"sample_time": 1.0}, ValueError, "`sample_time` needs a `controller`"),
        (
            {"torque_rate": [1] * 6},
            ValueError,
            "`torque_rate` needs a `sample_time`: it limits the change from one held torque to the next",
        ),
        ({"gravity": [0, 0]}, ValueError, "`gravity` must have shape (3,), got (2,)"),
        (
            {"delay": 0.01},
            ValueError,
            "`delay` needs a `sample_time`: it is that of a sampled controller's torques",
        ),
    ],
)
def test_wrong_parts_are_named(irb140, parts, error, text):
    with pytest.raises(error, match=rf"^{re.escape(text)}$"):
        rne.Scene(irb140, **parts)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"coulomb": -1}, "`coulomb` must not be negative, got -1.0"),
        (
            {"coulomb": 2, "static": 1},
            "`static` must be at least `coulomb`: friction at rest is no less than when slipping",
        ),
    ],
)
def test_wrong_friction_is_named(arguments, text):
    with pytest.raises(ValueError, match=rf"^{re.escape(text)}$"):
        rne.Friction(**arguments)


class TestFriction:
    def test_numbers_that_its_hash_is_made_of_are_read_only(self):
        friction = rne.Friction(viscous=[1.0, 2.0])
        with pytest.raises(ValueError, match=r"^assignment destination is read-only$"):
            friction.viscous[0] = 3.0

    def test_each_direction_has_its_own(self, irb140):
        friction = rne.Friction(viscous=1.0, viscous_back=2.0, coulomb=3.0, coulomb_back=4.0, smoothing=0.01)
        ahead, back = (friction.torque(irb140.model, np.full(6, rate)) for rate in (0.5, -0.5))
        assert ahead == pytest.approx(1.0 * 0.5 + 3.0, rel=1e-15)
        assert back == pytest.approx(-2.0 * 0.5 - 4.0, rel=1e-15)
        slow = friction.torque(irb140.model, np.full(6, -0.01))
        assert slow == pytest.approx(-0.02 - 4.0 * np.tanh(1.0), rel=1e-15)

    def test_friction_of_a_file_takes_the_power_that_its_joints_take(self):
        """A mimic's damping and friction act at its own rate, whatever its multiplier."""
        tree = random_tree(5, seed=6, mimics=3)
        rng = np.random.default_rng(0)
        model = replace(tree, damping=rng.uniform(0, 1, tree.nb), friction=rng.uniform(0, 1, tree.nb))
        friction = rne.Scene(rne.Robot(model), friction="urdf").resolved.friction
        for qd in np.diag(rng.uniform(-2, 2, tree.n)):  # one coordinate at a time, with those that mimic it
            rates = model.coordinate_map @ qd
            assert friction.viscous_torque(qd) @ qd == pytest.approx(model.damping @ rates**2, rel=1e-14)
            dry = replace(friction, smoothing=0.0)
            assert dry.coulomb_torque(qd) @ qd == pytest.approx(model.friction @ np.abs(rates), rel=1e-14)


class TestDryFriction:
    """A block of 1 kg on a slider is the textbook."""

    @pytest.fixture
    def slider(self, tmp_path):
        (tmp_path / "slider.urdf").write_text(SLIDER)
        return rne.load(tmp_path / "slider.urdf")

    def test_sticks_below_and_slips_above(self, slider):
        scene = rne.Scene(slider, friction=rne.Friction(coulomb=2.0, static=3.0, smoothing=0))
        below = rne.simulate(scene, [0], [0], 1.0, torque=[2.9])
        above = rne.simulate(scene, [0], [0], 1.0, torque=[3.1])
        assert not below.q.any()
        assert above.q[-1, 0] == pytest.approx((3.1 - 2.0) / 2, rel=1e-6)

    @pytest.mark.parametrize(("sign", "kinetic"), kept([(1, 2.0), (-1, 3.0)], [(-1, 3.0)]))
    def test_each_direction_breaks_away_and_brakes_by_its_own(self, slider, sign, kinetic):
        """A block of 1 kg held by 2 N against moving ahead and by 3 N against moving back."""
        scene = rne.Scene(slider, friction=rne.Friction(coulomb=2.0, coulomb_back=3.0, smoothing=0))
        held = rne.simulate(scene, [0], [0], 1.0, torque=[sign * (kinetic - 0.1)])
        assert not held.q.any()
        pushed = rne.simulate(scene, [0], [0], 1.0, torque=[sign * (kinetic + 0.5)])
        assert pushed.q[-1, 0] == pytest.approx(sign * 0.5 / 2, rel=1e-6)
        sliding = rne.simulate(scene, [0], [sign * 3.0], 4.0)
        assert sliding.q[-1, 0] == pytest.approx(sign * 9 / (2 * kinetic), rel=1e-6)

    def test_slides_to_rest_and_stays(self, slider):
        """v0^2 / (2 mu): and the heat is the kinetic energy it had."""
        scene = rne.Scene(slider, friction=rne.Friction(coulomb=2.0, smoothing=0))
        motion = rne.simulate(scene, [0], [3.0], 4.0, t_eval=np.linspace(0, 4, 41))
        assert motion.q[-1, 0] == pytest.approx(9 / 4, rel=1e-6)
        assert not motion.qd[motion.t > 1.6].any()
        assert motion.dissipated["coulomb"][-1] == pytest.approx(4.5, rel=1e-6)
        assert motion.energy_drift <= 1e-5

    def test_stick_slip_on_a_pulled_spring(self, slider):
        """A spring drawn at constant speed: it sticks until the spring holds the static friction, then jumps."""
        k, v = 50.0, 0.1
        scene = rne.Scene(slider, friction=rne.Friction(coulomb=1.0, static=2.0, smoothing=0), controller=Spring(k, v))
        motion = rne.simulate(scene, [0], [0], 2.0, t_eval=np.linspace(0, 2, 2001), rtol=1e-9)
        first = motion.t[np.argmax(motion.q[:, 0] > 0)]
        assert first == pytest.approx(2.0 / (k * v), abs=2e-3)
        assert (motion.qd[:, 0] == 0).mean() > 0.3
        assert "changes between sticking and slipping" in motion.message

    def test_arm_comes_to_rest_and_holds_its_weight(self, irb140):
        scene = rne.Scene(irb140, friction=rne.Friction(viscous=20.0, coulomb=200.0, smoothing=0))
        motion = rne.simulate(scene, [0] * 6, [0.5, 0, 0, 0, 0, 0], 2.0)
        assert not motion.qd[-1].any()
        assert not motion.qdd[-1].any()
        assert motion.energy_drift <= 1e-4

    @pytest.mark.parametrize("method", ["RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA"])
    def test_every_method_brings_a_block_to_rest(self, slider, method):
        """Sliding from 3 m/s against 1 N: 4.5 m."""
        scene = rne.Scene(slider, friction=rne.Friction(coulomb=1.0, smoothing=0))
        motion = rne.simulate(scene, [0], [3.0], 4.0, method=method, rtol=1e-8)
        assert motion.q[-1, 0] == pytest.approx(4.5, rel=1e-7)
        assert motion.message.endswith("1 changes between sticking and slipping")

    def test_sampled_control_of_a_joint_that_sticks(self, slider):
        """A ramp of 1 N/s held for 0.1 s: break-away from 1 N at the sample 1.1 s, then u = k 0.1 s in each period."""
        scene = rne.Scene(
            slider,
            friction=rne.Friction(coulomb=1.0, smoothing=0),
            controller=lambda t, q, qd: np.array([t]),
            sample_time=0.1,
        )
        motion = rne.simulate(scene, [0], [0], 2.0)
        x, v = 0.0, 0.0
        for k in range(11, 20):
            a = 0.1 * k - 1.0
            x, v = x + 0.1 * v + 0.005 * a, v + 0.1 * a
        assert motion.q[-1, 0] == pytest.approx(x, rel=1e-9)
        assert not motion.q[motion.t <= 1.1].any()
        assert motion.energy_drift <= 1e-12


class TestDryFrictionOfSeveralJoints:
    """Two rods in a row; each case once looped at one instant or chose modes that contradict the accelerations."""

    def scene(self, two, law=None, **friction):
        return rne.Scene(two, gravity=[0, 0, 0], friction=rne.Friction(smoothing=0, **friction), controller=law)

    def test_joint_without_friction_never_sticks(self, two):
        motion = rne.simulate(self.scene(two, coulomb=[5, 0]), [0, 0], [0, 0], 1.0)
        assert not motion.q.any()

    def test_a_joint_without_friction_slips_at_rest_however_small_its_load(self, two):
        scene = self.scene(two, lambda t, q, qd: np.array([0.0, 1e-12]), coulomb=[5, 0])
        motion = rne.simulate(scene, [0, 0], [0, 0], 1.0)
        free = 1e-12 / two.mass_matrix([0, 0])[1, 1]
        assert motion.qdd[0].tolist() == pytest.approx([0.0, free], rel=1e-6)

    def test_load_at_the_bound_itself_is_held(self, two):
        scene = self.scene(two, lambda t, q, qd: np.array([1.0, 0.0]), coulomb=[1, 1])
        assert not rne.simulate(scene, [0, 0], [0, 0], 1.0).q.any()

    def test_torques_of_a_law_are_those_of_the_states_whatever_sticks_at_the_end(self, two):
        motion = rne.simulate(self.scene(two, lambda t, q, qd: -2.0 * qd, coulomb=[1, 1]), [0, 0], [3.0, -3.0], 5.0)
        assert not motion.qd[-1].any()
        np.testing.assert_array_equal(motion.tau, -2.0 * motion.qd)

    @pytest.mark.parametrize("breaks", [[1.0], []])
    def test_a_jump_of_the_torque_is_met_while_a_joint_sticks(self, two, breaks):
        scene = self.scene(two, lambda t, q, qd: np.array([0.5 if t < 1 else 5.0, 0.0]), coulomb=[1, 1])
        motion = rne.simulate(scene, [0, 0], [0, 0], 1.5, breaks=breaks, t_eval=[0, 0.9, 1.5])
        assert not motion.q[1].any()
        assert motion.q[2, 0] > 1
        assert motion.energy_drift <= 1e-6

    def test_modes_agree_with_the_accelerations_they_give(self, two):
        """Every joint at rest resists its load or starts the way it is accelerated: 300 random loads."""
        scene = self.scene(two, lambda t, q, qd: self.load, coulomb=[0.5, 0.2])
        rng = np.random.default_rng(0)
        dry = DryPlant(scene.dynamics, scene.resolved.robot, scene.controller)
        modes = set()
        for _ in range(300):
            self.load = rng.normal(size=2)
            x = np.concatenate([rng.uniform(-3, 3, 2), np.zeros(4)])
            dry.settle(0.0, x, [])
            qdd, needed, _ = dry.loads(0.0, x)
            modes.add(tuple(dry.mode))
            assert (qdd * dry.mode >= -1e-9).all()
            assert (np.abs(needed)[dry.mode == 0] <= np.array([0.5, 0.2])[dry.mode == 0] * (1 + 1e-8)).all()
        assert len(modes) == 9

    def test_rates_and_loads_under_modes_are_those_of_the_joints_that_slip(self, tree):
        """M_ss qdd_s = (net - dry)_s; what sticks carries the rest, and its rate is as if nothing held it."""
        robot, rng = rne.Robot(tree), np.random.default_rng(0)
        friction = rne.Friction(viscous=rng.uniform(0, 1, robot.n), coulomb=1.0, smoothing=0)
        law = rne.traceable(lambda t, q, qd: np.sin(t) - qd)
        dynamics = rne.Scene(robot, friction=friction, controller=law).dynamics
        for _ in range(4):
            self.check_modes(robot, friction, dynamics, rng)

    def check_modes(self, robot, friction, dynamics, rng):
        """In a random state, with any of the joints slipping."""
        n = robot.n
        q, qd, t = rng.uniform(-1, 1, n), rng.uniform(-1, 1, n), rng.uniform(0, 1, 1)
        slips = rng.integers(0, 2, n).astype(float)
        dry = slips * rng.uniform(-1, 1, n)
        x, modes = np.concatenate([q, qd, np.zeros(3)]), np.concatenate([slips, dry])
        moving = slips * qd
        net = np.sin(t) - moving - friction.viscous * moving - robot.bias_torque(q, moving)
        M, s = robot.mass_matrix(q), slips == 1
        qdd = np.zeros(n)
        qdd[s] = np.linalg.solve(M[np.ix_(s, s)], (net - dry)[s])
        load = np.where(s, dry, net - M @ qdd)
        rates = np.concatenate([moving, np.where(s, qdd, load / np.diagonal(M))])
        rates = np.concatenate(
            [rates, [(np.sin(t) - moving) @ moving, friction.viscous * moving @ moving, dry @ moving]]
        )
        kernels, function, largest = robot.kernels, dynamics.right_hand_side_under_modes, np.abs(net).max()
        given = t, x, modes, dynamics.vector
        for found in (kernels.scene_kernel(function)(*given), function.evaluate(robot.model, *given)[0]):
            for got, expected in zip(np.split(found, [len(x), len(x) + n]), (rates, load, net), strict=True):
                np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-9 * max(largest, np.abs(expected).max()))

    def test_pid_with_limits_passes_through_many_events(self, two):
        law = rne.control.pid(two, [50, 20], [30, 10], [10, 4], [0.3, -0.2], gravity=True)
        friction = rne.Friction(viscous=0.1, coulomb=[0.5, 0.2], smoothing=0)
        motion = rne.simulate(
            rne.Scene(two, friction=friction, effort_limit=[8, 3], controller=law), [0, 0], [0, 0], 3.0
        )
        assert motion.status == 0
        assert motion.energy_drift <= 1e-6


class Stribeck(rne.Friction):
    """A friction law of a user's own."""

    extra = 0.0

    def coulomb_torque(self, qd):
        return super().coulomb_torque(qd) * (1 + self.extra)


def test_a_scene_keeps_its_springs_when_the_list_changes(two):
    springs = [rne.Spring("root", [0, 0, 1.0], "rod1", [0, 0, 0], 100, 0)]
    scene = rne.Scene(two, springs=springs)
    springs.clear()
    assert len(scene.springs) == 1


def test_equal_parts_make_equal_scenes_and_a_friction_of_ones_own_is_its_own(two):
    scenes = [rne.Scene(two, friction=rne.Friction(viscous=v, coulomb=1.0)) for v in (1.0, 1.0, 2.0)]
    assert scenes[0].kernel is scenes[1].kernel is not scenes[2].kernel
    ends = []
    for extra in (0.0, 0.5, 1.0):
        own = Stribeck(viscous=1.0, coulomb=1.0)
        object.__setattr__(own, "extra", extra)
        ends.append(rne.simulate(rne.Scene(two, friction=own), [1.0, 0.5], [0, 0], 0.5).dissipated["coulomb"][-1])
    assert ends[0] < ends[1] < ends[2]


class Held:
    """A law whose limit and gain can be changed."""

    traceable = True

    def __init__(self, gain=30.0, limit=100.0):
        self.gain, self.limit = gain, limit

    def __call__(self, t, q, qd):
        return rne.elementwise.clip(-self.gain * q - 5 * qd, -self.limit, self.limit)


def test_cost_says_why_a_law_is_called(two):
    two = rne.Robot(two.model, "numpy")
    law, unmarked = rne.control.pd(two, 20, 5, 0.0), lambda t, q, qd: -q
    branch = rne.traceable(lambda t, q, qd: -q if q[0] > 0 else q)
    found = {
        name: rne.Scene(two, controller=given, sample_time=period).cost()
        for name, given, period in (
            ("traced", law, None), ("sampled", law, 0.01), ("unmarked", unmarked, 0.01), ("branch", branch, 0.01),
        )
    }  # fmt: skip
    assert "why" not in found["traced"]
    assert {found[name]["law"] for name in ("sampled", "unmarked", "branch")} == {"called"}
    assert (
        found["sampled"]["why"] == "a sampled law is called at each sample; engine 'numba' samples it in machine code"
    )
    assert found["unmarked"]["why"] == "it is not marked by rne.traceable"
    assert found["branch"]["why"].startswith("TypeError: a traced number has no value: a branch")


@pytest.mark.long
def test_a_law_that_is_sampled_in_machine_code_is_traced(two, caplog):
    fast = rne.Robot(two.model, "numba")
    assert rne.Scene(fast, controller=rne.control.pd(fast, 20, 5, 0.0), sample_time=0.01).cost()["law"] == "traced"
    branch = rne.traceable(lambda t, q, qd: -q if q[0] > 0 else q)
    assert rne.Scene(fast, controller=branch, sample_time=0.01).cost()["law"] == "called"
    (line,) = [record.getMessage() for record in caplog.records if "not traced" in record.getMessage()]
    assert line.startswith("`controller` is called, not traced: TypeError: a traced number has no value: a branch")


@pytest.mark.parametrize("anew", [True, False], ids=["new scene", "same scene"])
@pytest.mark.parametrize("sample_time", [None, 0.01])
def test_a_law_that_was_changed_runs_as_it_is_now(two, sample_time, anew):
    """Also where no torque of small states shows the change."""
    law = Held()
    scene = rne.Scene(two, controller=law, sample_time=sample_time)
    largest = []
    for limit in (100.0, 40.0, 30.0):
        law.limit = limit
        scene = rne.Scene(two, controller=law, sample_time=sample_time) if anew else scene
        largest.append(np.abs(rne.simulate(scene, [4.0, 4.0], [0, 0], 0.05).tau).max())
    assert largest == [100.0, 40.0, 30.0]


def test_what_functions_call_is_looked_at_once(two):
    """Of functions that call each other there are more ways from one to another than could be followed."""
    numbers = {"gain": 1.0}

    def made(others):
        return lambda x: sum((other(x) for other in others), numbers["gain"] * x)

    layers = [made([])]
    for _ in range(60):
        layers.append(made(layers[-2:]))
    law = rne.traceable(lambda t, q, qd: -layers[3](q))
    scene = rne.Scene(two, controller=law)
    before = rne.simulate(scene, [0.5, 0.5], [0, 0], 0.01).tau[0]
    numbers["gain"] = 2.0
    np.testing.assert_allclose(rne.simulate(scene, [0.5, 0.5], [0, 0], 0.01).tau[0], 2 * before)


def test_a_motion_remembers_the_law_that_it_ran_under(two):
    law = Held(gain=10.0)
    motion, same = (rne.simulate(rne.Scene(two, controller=law), [1.0, 0.0], [0, 0], 0.2) for _ in range(2))
    expected = same.tau, same.error_estimate()[1]
    law.gain = 1.0
    rne.simulate(rne.Scene(two, controller=law), [1.0, 0.0], [0, 0], 0.2)
    assert np.array_equal(motion.tau, expected[0])
    assert np.array_equal(motion.error_estimate()[1], expected[1])


@pytest.mark.parametrize("options", [{"t_eval": [0.2, 0.3]}, {}])
@pytest.mark.parametrize("sample_time", [None, 0.01])
def test_a_failure_before_the_first_report_is_told_where_joints_stick(two, options, sample_time):
    begin = 0.1 if options else 0.0
    scene = rne.Scene(
        two,
        friction=rne.Friction(coulomb=1.0, smoothing=0),
        controller=lambda t, q, qd: np.full(2, np.nan if t >= begin else 5.0),
        sample_time=sample_time,
    )
    with pytest.raises(rne.SimulationError, match="torque of 'joint0' is nan") as caught:
        rne.simulate(scene, [0.1, 0.1], [0, 0], 0.3, **options)
    assert caught.value.trajectory.tau.shape == (0, 2)


def test_nothing_moves_where_all_joints_are_locked_and_friction_is_dry(two):
    locked = dict.fromkeys(two.joint_names, 0.1)
    scene = rne.Scene(
        two, locked=locked, friction=rne.Friction(coulomb=1.0, smoothing=0), controller=lambda t, q, qd: q
    )
    assert rne.simulate(scene, [], [], 1.0).t.tolist() == [0, 1]


@pytest.mark.parametrize("sample_time", [None, 0.01])
def test_rates_of_a_controllers_states_that_become_nan_are_named(two, sample_time):
    def law(t, q, qd, z):
        return -q, np.array([0.0, np.nan if t > 0.05 else 1.0])

    law.states = 2
    with pytest.raises(rne.SimulationError, match=r"rate of state 1 of the controller is nan at t = 0\.0"):
        rne.simulate(rne.Scene(two, controller=law, sample_time=sample_time), [0.1, 0.1], [0, 0], 0.2)


class TestCornerCases:
    def test_drift_is_counted_from_the_start_not_the_first_sample(self, two):
        late = rne.simulate(
            rne.Scene(two, friction=rne.Friction(viscous=1.0)), [0.3, 0.2], [0, 0], 1.0, t_eval=[0.5, 1.0]
        )
        assert late.energy_drift <= 1e-5
        assert np.abs(late.balance).max() == late.energy_drift

    @pytest.mark.parametrize(
        ("law", "text"),
        [
            (lambda t, q, qd: 5.0 + 0 * t, "shape (2,), got ()"),
            (lambda t, q, qd: None, "real numbers, got dtype object"),
            (lambda t, q, qd: [1, 2, 3], "shape (2,), got (3,)"),
        ],
    )
    def test_traced_law_of_a_wrong_shape_is_refused(self, two, law, text):
        scene = rne.Scene(two, controller=rne.traceable(law))
        with pytest.raises(ValueError, match=rf"^`controller` must return {re.escape(text)} at t = 0 s$"):
            rne.simulate(scene, [0, 0], [0, 0], 1.0)

    @pytest.mark.parametrize("sample_time", [None, 0.01], ids=["traced", "sampled"])
    @pytest.mark.parametrize(
        ("returned", "got"),
        [
            (lambda u, rates: u, "ndarray"),
            (lambda u, rates: [u, rates], "list"),
            (lambda u, rates: None, "NoneType"),
            (lambda u, rates: (u,), "a tuple of 1"),
            (lambda u, rates: (u, rates, rates), "a tuple of 3"),
        ],
        ids=["torques alone", "list", "nothing", "one", "three"],
    )
    def test_law_with_states_that_returns_no_pair_is_refused(self, two, sample_time, returned, got):
        def law(t, q, qd, z):
            return returned(-qd, q - z)

        law.states = 2
        scene = rne.Scene(two, controller=rne.traceable(law), sample_time=sample_time)
        text = f"`controller` with states must return (torques, rates of its states), got {got}"
        with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
            rne.simulate(scene, [0.1, 0.2], [0, 0], 0.05)

    @pytest.mark.parametrize(
        ("method", "dry"),
        kept(
            [("auto", False), ("Radau", False), ("auto", True), ("LSODA", True), ("BDF", True)],
            [("auto", True)],
        ),
    )
    def test_a_called_law_may_have_states(self, two, dry, method):
        """An integral action, called and traced: the same motion, and the integral of the error."""

        def law(t, q, qd, z):
            return np.array([-20.0, -10.0]) * (q - 0.3) - 4 * qd - 5 * z, q - 0.3

        law.states = 2
        friction = rne.Friction(coulomb=0.1, smoothing=0) if dry else None

        def marked(t, q, qd, z):
            return law(t, q, qd, z)

        marked.states = 2
        how = {"method": method, "rtol": 1e-8, "atol": 1e-11, "t_eval": np.linspace(0, 1, 11)}
        called = rne.simulate(rne.Scene(two, controller=law, friction=friction), [0, 0], [0, 0], 1.0, **how)
        scene = rne.Scene(two, controller=rne.traceable(marked), friction=friction)
        assert scene.cost()["law"] == "traced"
        traced = rne.simulate(scene, [0, 0], [0, 0], 1.0, **how)
        np.testing.assert_allclose(called.q, traced.q, atol=1e-6)
        np.testing.assert_allclose(called.controller_state, traced.controller_state, atol=1e-6)
        assert (called.controller_state[1:] < 0).all()

    def test_rates_of_states_of_a_wrong_shape_are_refused(self, two):
        def law(t, q, qd, z):
            return -qd, np.zeros(3)

        law.states = 2
        with pytest.raises(
            ValueError, match=r"^`rates of the controller's states` must have shape \(2,\), got \(3,\)$"
        ):
            rne.simulate(rne.Scene(two, controller=law), [0.1, 0.2], [0, 0], 0.05)

    def test_a_constant_traced_law_is_repeated(self, two):
        scene = rne.Scene(two, controller=rne.traceable(lambda t, q, qd: [1.0, 2.0]))
        motion = rne.simulate(scene, [0, 0], [0, 0], 0.1)
        assert (motion.tau == [1.0, 2.0]).all()
        assert motion.tau.shape == motion.q.shape

    def test_held_torques_are_given_at_the_times_asked_for(self, two):
        """Those of a sample from its time on."""
        scene, times = (
            rne.Scene(two, controller=lambda t, q, qd: [1 + 10 * t, -1.0], sample_time=0.1),
            [0, 0.05, 0.1, 0.55],
        )
        tau = rne.simulate(scene, [0, 0], [0, 0], 1.0, t_eval=times).tau
        assert tau[:, 0] == pytest.approx([1.0, 1.0, 2.0, 6.0])
        assert rne.simulate(scene, [0, 0], [0, 0], 0.0).tau[0] == pytest.approx([1.0, -1.0])

    def test_the_last_time_is_reached_whatever_the_sample_time(self, two):
        scene = rne.Scene(two, controller=lambda t, q, qd: -qd, sample_time=0.078)
        assert rne.simulate(scene, [0, 0], [0, 0], 3.744, t_eval=[0, 1.872, 3.744]).t[-1] == 3.744

    def test_windup_may_be_bounded_for_one_joint_only(self, two):
        law = rne.control.pid(two, [1, 1], [10, 10], [1, 1], [0, 0], windup=[0.5, np.inf])
        assert law(0.0, np.zeros(2), np.zeros(2), np.full(2, 10.0))[0] == pytest.approx([-0.5, -100.0])

    def test_a_joint_at_rest_on_its_stop_has_not_reached_it(self, two):
        lower = two.model.lower.copy()
        lower[1] = 0.0
        scene = rne.Scene(rne.Robot(replace(two.model, lower=lower)), gravity=[0, 0, 0], stops=True)
        assert rne.simulate(scene, [0, 0], [0, 0], 1.0).status == 0

    def test_breaks_of_a_reference_are_kept_by_torque(self, two):
        path = rne.trajectories.trapezoidal([0, 0], [1, -1], 1.0, 0.2)
        law = rne.control.computed_torque(two, [100, 100], [20, 20], path)
        assert 0.2 in rne.simulate(two, [0, 0], [0, 0], 1.0, torque=law).t

    def test_nearly_equal_breaks_are_one(self, two):
        law = rne.control.pd_gravity(two, [50, 50], [5, 5], [0.1, 0.1])
        motion = rne.simulate(
            rne.Scene(two, controller=law), [0, 0], [0, 0], 1.0, method="LSODA", breaks=[0.3, 0.1 + 0.2]
        )
        assert motion.t[-1] == 1.0

    def test_state_of_a_sampled_pid_is_kept(self, two):
        law = rne.control.pid(two, [1, 1], [10, 10], [1, 1], [1, 1])
        motion = rne.simulate(rne.Scene(two, controller=law, sample_time=0.01), [0, 0], [0, 0], 0.1)
        assert motion.controller_state.shape == motion.q.shape
        assert motion.controller_state[-1, 0] < -0.05

    @pytest.mark.parametrize(
        ("make", "error", "text"),
        [
            (
                lambda r: rne.Friction(coulomb=[1, 2], static=[1, 2, 3]),
                ValueError,
                "friction must be numbers or arrays of one shape (n,), got [(2,), (3,)]",
            ),
            (
                lambda r: rne.simulate(r, [0, 0], [0, 0], 1.0, breaks=0.5),
                ValueError,
                "`breaks` must have shape (k,), got ()",
            ),
            (
                lambda r: rne.control.pd(r.model, [1, 1], [1, 1], [0, 0]),
                TypeError,
                "`robot` must be an rne.Robot, got Model",
            ),
            (lambda r: rne.check_gains(r.model, [1, 1], [1, 1]), TypeError, "`robot` must be an rne.Robot, got Model"),
            (lambda r: rne.Scene(r.model), TypeError, "`robot` must be an rne.Robot, got Model"),
            (lambda r: rne.Friction(viscous=1.0, smoothing=[0.1, 0.2]), ValueError, "`smoothing` must be one number"),
            (
                lambda r: rne.control.computed_torque(r, [1, 1], [1, 1], lambda t: (0, 0)),
                ValueError,
                "`reference` must give (q, qd, qdd) of shape (2,) each, got [(), ()]",
            ),
            (
                lambda r: rne.Scene(r, locked={"joint0": 0}, controller=rne.control.pd(r, [1, 1], [1, 1], [0, 0])),
                ValueError,
                "`controller` is for a robot of 2 joints, the scene has 1",
            ),
            (
                lambda r: rne.simulate(
                    r, [0, 0], [0, 0], 1.0, torque=rne.control.pid(r, [1, 1], [1, 1], [1, 1], [0, 0])
                ),
                ValueError,
                "`torque` with states needs a scene: rne.Scene(robot, controller=...)",
            ),
        ],
    )
    def test_wrong_arguments_are_named(self, two, make, error, text):
        with pytest.raises(error, match=rf"^{re.escape(text)}$"):
            make(two)


class Spring:
    def __init__(self, k, v):
        self.k, self.v = k, v

    def __call__(self, t, q, qd):
        return self.k * (self.v * t - q)


SLIDER = """<robot name="slider"><link name="base"/><link name="block"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="base"/><child link="block"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" effort="9" velocity="9"/></joint></robot>"""


class TestTorqueLimits:
    def test_unlimited_efforts_of_the_file_cost_nothing(self, irb140):
        """The IRB 140's efforts are unknown, infinite on record: the kernel stays written out."""
        law = rne.control.pd_gravity(irb140, [50] * 6, [20] * 6, [0] * 6)
        limited = rne.Scene(irb140, controller=law, effort_limit="urdf")
        assert limited.resolved.effort_limit is None
        assert limited.cost()["total"] == rne.Scene(irb140, controller=law).cost()["total"]

    def test_drives_are_limited_each_by_itself(self, irb140):
        model = replace(irb140.model, effort_limit=np.array([40.0, np.inf, np.inf, np.inf, np.inf, np.inf]))
        robot = rne.Robot(model)
        law = rne.control.pd_gravity(robot, [500] * 6, [20] * 6, [1] * 6)
        scene = rne.Scene(robot, controller=law, effort_limit="urdf")
        motion = rne.simulate(scene, [0] * 6, [0] * 6, 0.02)
        assert scene.kernel.is_unrolled
        assert np.abs(motion.tau[:, 0]).max() == 40.0
        assert np.abs(motion.tau[:, 1]).max() > 40.0


def test_payloads_of_any_numbers_take_the_same_program(irb140):
    """Also where moments of theirs cancel, which rounding may leave as zeros or beside them."""
    scene, round_body = rne.Scene(irb140, payload=rne.Payload(2.0, (0.02, 0, 0.05), 0.01 * np.eye(3))), np.zeros(10)
    round_body[[0, 4, 6, 9]] = 2.0, 0.01, 0.01, 0.01  # Ixx = Iyy about the axis of the last joint
    numbers = [round_body, 1.1 * round_body, scene.numbers["payload"], 0 * round_body]
    first, *others = (scene.with_numbers({"payload": pi}).dynamics.right_hand_side for pi in numbers)
    assert all(other == first for other in others)
