"""What is reported is what ran, and what cannot be is refused: findings of random searches, each once wrong in silence."""

import numpy as np
import pytest

import rne


class Gain:
    """A traceable law with a parameter that its owner may change."""

    traceable = True

    def __init__(self, k):
        self.k = k

    def __call__(self, t, q, qd):
        return -self.k * q


def test_a_law_that_is_changed_between_runs_is_traced_anew(two):
    law = Gain(1.0)
    scene = rne.Scene(two, controller=law)
    start = np.full(2, 0.1)
    rne.simulate(scene, start, 0 * start, 0.05)
    law.k = 50.0
    motion = rne.simulate(scene, start, 0 * start, 0.05)
    fresh = rne.simulate(rne.Scene(two, controller=Gain(50.0)), start, 0 * start, 0.05)
    assert np.array_equal(motion.q, fresh.q)
    np.testing.assert_allclose(motion.tau, -50.0 * motion.q, rtol=1e-12, atol=1e-12)


def test_a_change_that_shows_in_some_states_only_is_noticed(two):
    """The gain counts where the second joint is above zero, as in one half of all states."""

    class OneSided(Gain):
        def __call__(self, t, q, qd):
            above = rne.elementwise.less(0.0, q[1:2])
            return rne.elementwise.where(above, -self.k * q, -10 * q) - 5 * qd

    law, start = OneSided(1.0), np.full(2, 0.1)
    scene = rne.Scene(two, controller=law)
    rne.simulate(scene, start, 0 * start, 0.05)
    law.k = 50.0
    motion = rne.simulate(scene, start, 0 * start, 0.05)
    fresh = rne.simulate(rne.Scene(two, controller=OneSided(50.0)), start, 0 * start, 0.05)
    assert np.array_equal(motion.q, fresh.q)


def test_a_law_that_is_infinite_before_it_is_clipped_is_linearised(irb140):
    """At q = 0 the kernel of the slopes refuses 1 / q^2, and the complex step of the recursion answers."""

    @rne.traceable
    def law(t, q, qd):
        return rne.elementwise.clip(-1 / (q * q), -5.0, 5.0)

    motion = rne.simulate(rne.Scene(irb140, controller=law), np.zeros(6), np.zeros(6), 0.01)
    assert motion.status == 0
    np.testing.assert_array_equal(motion.tau[0], -5.0)


def test_the_state_of_a_sampled_controller_is_that_of_its_sample(irb140):
    law = rne.control.pid(irb140, [50] * 6, [10] * 6, [20] * 6, [1.0] * 6)
    motion = rne.simulate(rne.Scene(irb140, controller=law, sample_time=1e-4), [0] * 6, [0] * 6, 5e-4)
    assert not motion.controller_state[0].any()
    np.testing.assert_allclose(motion.controller_state[1], -1e-4)
    assert (np.diff(motion.controller_state[:, 0]) < 0).all()


def test_a_payload_that_no_body_has_is_refused(irb140):
    text = (
        r"^payload on link 'tool0': the largest principal moment of inertia must not exceed the sum of the two others$"
    )
    with pytest.raises(ValueError, match=text):
        irb140.with_payload(1.0, inertia=np.diag([1.0, 1.0, 5.0]))


def test_a_rotated_inertia_is_symmetric_up_to_rounding(irb140):
    R, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    loaded = irb140.with_payload(1.0, inertia=R @ np.diag([0.1, 0.2, 0.25]) @ R.T)
    assert loaded.model.mass[-1] == 2.0


def test_friction_refuses_nan(irb140):
    with pytest.raises(ValueError, match=r"^`qd` must be finite, got nan at index \(2,\)$"):
        rne.Friction(viscous=1.0).torque(irb140.model, [0, 0, np.nan, 0, 0, 0])


def test_complex_torques_keep_their_imaginary_part(irb140):
    scene = rne.Scene(irb140, friction=rne.Friction(viscous=1.0))
    q, tau = np.full(6, 0.3), np.arange(6.0)
    by_tau = scene.forward_dynamics(q, 0 * q, tau + 1e-30j * np.eye(6)[5]).imag / 1e-30
    np.testing.assert_allclose(by_tau, np.linalg.inv(irb140.mass_matrix(q))[:, 5], rtol=1e-10)


def test_infinite_limits_are_no_limits(irb140):
    law = rne.control.pd_gravity(irb140, [50] * 6, [20] * 6, [0] * 6)
    free = rne.Scene(irb140, controller=law, effort_limit=np.full(6, np.inf))
    assert free.resolved.effort_limit is None
    rate = rne.Scene(irb140, controller=law, sample_time=1e-3, torque_rate=[np.inf] * 5 + [1.0]).resolved.torque_rate
    assert rate[5] == 1.0


def test_bearing_loads_of_a_loaded_scene_are_those_of_its_robot(irb140):
    scene = rne.Scene(irb140, payload=5.0)
    motion = rne.simulate(scene, [0] * 6, [0] * 6, 0.2)
    loaded = rne.bearing_peaks(irb140.with_payload(5.0), motion)
    assert np.array_equal(rne.bearing_peaks(scene, motion).force, loaded.force)
    assert (loaded.force > rne.bearing_peaks(irb140, motion).force).all()


def test_printed_python_knows_sign(irb140):
    law = rne.traceable(lambda t, q, qd: -rne.elementwise.sign(qd))
    namespace = {}
    exec(rne.Scene(irb140, controller=law).kernel.source("python"), namespace)
    rates = namespace["right_hand_side"]([0.0], [0.1] * 12)
    np.testing.assert_allclose(rates[:6], 0.1)


def test_a_windup_that_is_no_number_is_named(irb140):
    with pytest.raises(ValueError, match=r"^`windup` must be an array of numbers of shape \(6,\), got dtype object$"):
        rne.control.pid(irb140, [1] * 6, [1] * 6, [1] * 6, [0] * 6, windup=None)


def test_the_error_of_a_sampled_loop_that_diverges_names_the_limit_of_its_scene(two):
    law = rne.control.pd_gravity(two, 50, 100, 0.0)
    scene = rne.Scene(two, controller=law, sample_time=0.01, elastic=rne.ElasticJoints(3e3, 1.0, 0.1))
    limit = scene.check_gains([0.1] * 2).sample_time_limit
    text = f"; by scene.check_gains it is stable up to {limit:.4g} s, and sampled every 0.01 s$"
    with pytest.raises(rne.SimulationError, match=text):
        rne.simulate(scene, [0.1] * 2, [0] * 2, 1.0)


def test_the_error_of_a_sampled_loop_whose_law_cannot_be_examined_names_the_function_to_ask(two, monkeypatch):
    """A law that works in its own motion alone."""
    monkeypatch.setattr("rne.simulation.zero_order_hold.MAX_EVALUATIONS", 200)

    def law(t, q, qd):
        if t == 0 and q[0] != 0.1:
            raise ZeroDivisionError("elsewhere")
        return 1e3 * q + 1e4 * qd

    text = "the sampled loop is unstable; see scene.check_gains for the sample time that it needs$"
    with pytest.raises(rne.SimulationError, match=text):
        rne.simulate(rne.Scene(two, controller=law, sample_time=0.01), [0.1, 0.0], [0.0, 0.0], 1.0)


@pytest.mark.parametrize(
    ("name", "kp", "kd", "limit"),
    [
        pytest.param("irb140", [50] * 5 + [60], [20] * 5 + [22], "0.0001308", marks=pytest.mark.long),
        ("two", [50] * 2, [100] * 2, "0.0001193"),
    ],
)
def test_an_unstable_sampled_loop_ends_after_bounded_work(name, kp, kd, limit, request):
    """The thesis's gains at 1 kHz, once 9.3e6 evaluations for 8 ms; two links."""
    robot = request.getfixturevalue(name)
    scene = rne.Scene(robot, controller=rne.control.pd_gravity(robot, kp, kd, [0] * robot.n), sample_time=1e-3)
    with pytest.raises(
        rne.SimulationError,
        match=rf"within one sample at t = .* the sampled loop is unstable; by rne.check_gains it is stable up to {limit} s, and sampled every 0.001 s$",
    ) as caught:
        rne.simulate(scene, [0.1] * robot.n, [0] * robot.n, 1.0)
    assert caught.value.trajectory.evaluations < 60_000
    assert 0 < caught.value.time < 0.02
