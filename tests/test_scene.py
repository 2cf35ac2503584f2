"""Scenes: each part is felt, costs what it says, and nothing else is there."""

import pickle
import re

import numpy as np
import pytest

import rne
from rne.robots.chains import straight_chain

from .helpers import relative, states

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
    def test_forward_undoes_inverse(self, irb140, smoothing):
        """With armature and friction on; of dry friction wherever every joint moves."""
        friction = rne.Friction(viscous=1.0, viscous_back=2.0, coulomb=[1, 2, 3, 4, 5, 6], smoothing=smoothing)
        scene = rne.Scene(irb140, **{**EVERYTHING, "friction": friction})
        q, qd, qdd = states(6, 100)
        back = scene.forward_dynamics(q, qd, scene.inverse_dynamics(q, qd, qdd))
        condition = np.linalg.cond(scene.arm.mass_matrix(q)).max()
        assert relative(back, qdd) <= 50 * np.finfo(float).eps * condition

    def test_right_hand_side_is_the_scene_written_out(self, full):
        q, qd, _ = states(6, 20)
        rates = full.kernel(np.zeros((20, 1)), np.concatenate([q, qd, np.zeros((20, 2))], axis=1))
        assert np.array_equal(rates[:, :6], qd)
        assert relative(rates[:, 6:12], full.forward_dynamics(q, qd, 0 * q)) <= 1e-11
        friction = full.resistance
        assert rates[:, 12] == pytest.approx((friction.viscous_torque(qd) * qd).sum(-1), rel=1e-13)
        assert rates[:, 13] == pytest.approx((friction.coulomb_torque(qd) * qd).sum(-1), rel=1e-13)

    def test_urdf_friction(self, tmp_path):
        text = rne.to_urdf(straight_chain(1)).replace("</joint>", '<dynamics damping="0.7" friction="0.3"/></joint>')
        (tmp_path / "arm.urdf").write_text(text)
        scene = rne.Scene(rne.load(tmp_path / "arm.urdf"), friction="urdf")
        q = np.zeros(1)
        extra = scene.inverse_dynamics(q, [2.0], q) - scene.robot.inverse_dynamics(q, [2.0], q)
        assert extra[0] == pytest.approx(0.7 * 2.0 + 0.3, rel=1e-12)

    def test_mounting_turns_gravity(self, irb140):
        hanging = rne.Scene(irb140, mounting=[np.pi, 0, 0])
        q = states(6)[0]
        assert np.allclose(hanging.arm.gravity_torque(q), -irb140.gravity_torque(q), atol=1e-12)

    def test_locked_joints_are_no_coordinates(self, irb140):
        scene = rne.Scene(irb140, locked={"joint_4": 0.3})
        assert scene.n == 5
        assert scene.kernel.widths == (1, 10)


class TestCost:
    def test_what_is_not_named_costs_nothing(self, irb140):
        plain = sum(rne.Scene(irb140).kernel.operations.values())
        assert plain <= sum(irb140.kernel(rne.forward_dynamics).operations.values())
        assert rne.Scene(irb140).cost() == {"total": plain, "gravity": 4, "law": "none"}

    def test_parts_are_what_is_saved_without_them(self, irb140, full):
        costs = full.cost()
        for part in EVERYTHING:
            less = rne.Scene(irb140, **{k: v for k, v in EVERYTHING.items() if k != part})
            assert costs[part] == costs["total"] - less.cost()["total"] > 0

    def test_from_everything_to_hardly_anything(self, irb140, full):
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
        alone = sum(irb140.kernel(rne.gravity_torque).operations.values())
        assert costs["law"] == "traced"
        assert costs["controller"] < alone + 6 * 4 + 11  # feedback: 4 a joint; power: 11

    def test_called_law_says_so(self, irb140):
        assert rne.Scene(irb140, controller=lambda t, q, qd: -qd).cost()["law"] == "called"


class TestTracing:
    def test_law_with_memory_marked_traceable_is_refused(self, irb140):
        calls = []

        @rne.traceable
        def law(t, q, qd):
            calls.append(1)
            return -len(calls) * qd

        with pytest.raises(
            ValueError, match=r"^the controller is marked traceable, but traced it gives torques that differ by "
        ):
            rne.simulate(rne.Scene(irb140, controller=law), [0] * 6, [1] * 6, 0.1)

    def test_branch_on_a_value_is_refused(self, irb140):
        law = rne.traceable(lambda t, q, qd: -qd if t < 1 else qd)
        with pytest.raises(TypeError, match="a traced number has no value"):
            rne.Scene(irb140, controller=law).cost()

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
            x = np.concatenate([*states(6)[:2], np.zeros(1)])
            q, qd = x[:6], x[6:12]
            expected = irb140.forward_dynamics(q, qd, law(t, q, qd))
            assert relative(scene.kernel(np.array([t]), x)[6:12], expected) <= 1e-11

    def test_jacobian_is_the_derivative_of_the_right_hand_side(self, irb140):
        """Exact with a traced law, friction and limits, against central differences."""
        from rne.plant import Plant

        law = rne.control.pid(irb140, [50] * 6, [5] * 6, [20] * 6, [0.1] * 6, gravity=True)
        scene = rne.Scene(
            irb140, controller=law, friction=rne.Friction(1.0, 2.0, smoothing=0.5), torque_limit=[300] * 6
        )
        plant = Plant(scene.right_hand_side, None)
        x = np.random.default_rng(1).uniform(-1, 1, scene.right_hand_side.size)
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
        x = np.concatenate([*states(6)[:2], np.zeros(2)])
        assert np.array_equal(again.kernel(np.zeros(1), x), full.kernel(np.zeros(1), x))


class TestLimits:
    def test_torques_are_held_within_limits(self, irb140):
        law = rne.control.pd(irb140, [5000] * 6, [20] * 6, [1] * 6)
        motion = rne.simulate(rne.Scene(irb140, controller=law, torque_limit=[40] * 6), [0] * 6, [0] * 6, 0.05)
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

    def test_held_torques_change_at_samples_only(self, irb140):
        law = rne.control.pd(irb140, [50] * 6, [20] * 6, [1] * 6)
        scene = rne.Scene(irb140, controller=law, sample_time=1e-3)
        motion = rne.simulate(scene, [0] * 6, [0] * 6, 5e-3, t_eval=np.arange(51) * 1e-4)
        changes = np.nonzero(np.abs(np.diff(motion.tau[:, 0])) > 0)[0] + 1
        assert set(changes) <= {10, 11, 20, 21, 30, 31, 40, 41}
        assert len(changes) == 4

    def test_overload_warns(self, irb140):
        with pytest.warns(UserWarning, match=r"^payload of 7 kg is beyond the 6 kg of the data sheet of 'irb140'$"):
            rne.Scene(irb140, payload=7.0)


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
        ({"armature": [-1] * 6}, ValueError, "`armature` must not be negative, got -1.0"),
        ({"torque_limit": "file"}, ValueError, "`torque_limit` must be an array or 'urdf', got 'file'"),
        ({"controller": 3}, TypeError, "`controller` must be a function of (t, q, qd), got int"),
        ({"sample_time": 1.0}, ValueError, "`sample_time` needs a `controller` to ask"),
        (
            {"torque_rate": [1] * 6},
            ValueError,
            "`torque_rate` needs a `sample_time`: it bounds the step from one held torque to the next",
        ),
        ({"gravity": [0, 0]}, ValueError, "`gravity` must have shape (3,), got (2,)"),
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
            "`static` must be at least `coulomb`: a joint resists no less at rest than slipping",
        ),
    ],
)
def test_wrong_friction_is_named(arguments, text):
    with pytest.raises(ValueError, match=rf"^{re.escape(text)}$"):
        rne.Friction(**arguments)


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

    def test_what_cannot_go_together(self, irb140):
        scene = rne.Scene(irb140, friction=rne.Friction(coulomb=1.0, smoothing=0))
        with pytest.raises(
            ValueError,
            match=r"^`method` of a scene whose joints stick must not need a Jacobian, got 'Radau'; take LSODA$",
        ):
            rne.simulate(scene, [0] * 6, [0] * 6, 1.0, method="Radau")


class Spring:
    def __init__(self, k, v):
        self.k, self.v = k, v

    def __call__(self, t, q, qd):
        return self.k * (self.v * t - q)


SLIDER = """<robot name="slider"><link name="base"/><link name="block"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="base"/><child link="block"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" effort="9" velocity="9"/></joint></robot>"""
