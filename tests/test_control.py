"""Control laws do what their formulas say."""

import re

import numpy as np
import pytest

import rne

from .helpers import relative, states
from .random_robots import random_tree


def test_computed_torque_follows_its_reference(irb140):
    """From a start on the reference the error stays at the solver's tolerance; from one off it, it decays as designed."""
    path = rne.trajectories.quintic([0] * 6, [1, 0.5, -0.5, 1, 0.5, -1], 1.0)
    scene = rne.Scene(irb140, controller=rne.control.computed_torque(irb140, [100] * 6, [20] * 6, path))
    times = np.linspace(0, 1.2, 13)
    on = rne.simulate(scene, [0] * 6, [0] * 6, 1.2, t_eval=times, rtol=1e-9, atol=1e-12)
    assert np.abs(on.q - np.array([path(t)[0] for t in times])).max() <= 1e-8
    off = rne.simulate(scene, [0.1] * 6, [0] * 6, 1.2, t_eval=times, rtol=1e-9, atol=1e-12)
    expected = 0.1 * (1 + 10 * times) * np.exp(-10 * times)  # critically damped, e'' + 20 e' + 100 e = 0
    assert np.abs((off.q - on.q) - expected[:, None]).max() <= 1e-8


def test_integral_removes_the_error_that_weight_leaves(irb140):
    gains = [400] * 6, [400] * 6, [60] * 6
    reference = [0.1, 0.2, 0.1, 0, 0.1, 0]
    scene = rne.Scene(irb140, controller=rne.control.pid(irb140, *gains, reference))
    motion = rne.simulate(scene, reference, [0] * 6, 12.0, t_eval=[0, 12.0])
    plain = rne.Scene(irb140, controller=rne.control.pd(irb140, gains[0], gains[2], reference))
    without = rne.simulate(plain, reference, [0] * 6, 12.0, t_eval=[0, 12.0])
    assert np.abs(motion.q[-1] - reference).max() <= 1e-3
    assert np.abs(without.q[-1] - reference).max() >= 0.1
    assert np.abs(irb140.gravity_torque(motion.q[-1]) + 400 * motion.controller_state[-1]).max() <= 0.5


def test_windup_is_bounded(irb140):
    law = rne.control.pid(irb140, [0] * 6, [100] * 6, [0] * 6, [0] * 6, windup=5.0)
    tau, rates = law(0.0, np.ones(6), np.zeros(6), np.full(6, 3.0))
    assert tau == pytest.approx(-5.0)
    assert rates == pytest.approx(1.0)


def test_a_law_shows_the_bound_of_its_integral_if_any_joint_has_one(irb140):
    assert "windup" not in repr(rne.control.pid(irb140, 1, 1, 1, 0))
    assert "windup=[5, 1e+300," in repr(rne.control.pid(irb140, 1, 1, 1, 0, windup=[5] + [np.inf] * 5))


def test_pd_gravity_carries_the_weight(irb140):
    q, qd, _ = states(6, 20)
    law = rne.control.pd_gravity(irb140, [50] * 6, [20] * 6, [0.5] * 6)
    assert relative(law(0, q, qd), irb140.gravity_torque(q) - 50 * (q - 0.5) - 20 * qd) <= 1e-14


def test_pd_follows_a_moving_reference(irb140):
    """Feedback of the error and of its rate; a reference at rest is the constant one."""
    path = rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
    law = rne.control.pd_gravity(irb140, [50] * 6, [20] * 6, path)
    q, qd, _ = states(6)
    q_ref, qd_ref, _ = path(0.7)
    expected = irb140.gravity_torque(q) - 50 * (q - q_ref) - 20 * (qd - qd_ref)
    np.testing.assert_allclose(law(0.7, q, qd), expected, rtol=1e-13)
    at_rest = rne.control.pd_gravity(irb140, [50] * 6, [20] * 6, [1] * 6)
    np.testing.assert_array_equal(law(3.0, q, qd), at_rest(3.0, q, qd))
    assert rne.Scene(irb140, controller=law).cost()["law"] == "traced"


def test_trapezoidal_breaks_are_stepped_onto(irb140):
    """The energy balance would show a step across a jump of the acceleration."""
    path = rne.trajectories.trapezoidal([0] * 6, [1] * 6, 1.0, 0.25)
    assert path.breaks == (0.0, 0.25, 0.75, 1.0)
    scene = rne.Scene(irb140, controller=rne.control.computed_torque(irb140, [100] * 6, [20] * 6, path))
    motion = rne.simulate(scene, [0] * 6, [0] * 6, 1.0, rtol=1e-9, atol=1e-12)
    assert {0.25, 0.75} <= set(motion.t)
    assert motion.energy_drift <= 1e-7


def test_pulse_of_torque_is_not_stepped_over(irb140):
    """A pulse of 1 ms after 5 s of rest: found only if the solver steps onto its instants."""
    start = np.array([0, np.pi / 2, -np.pi / 2, 0, 0, 0])
    weight = irb140.gravity_torque(start)

    def law(t, q, qd):
        return weight + (100.0 if 5.0 <= t < 5.001 else 0.0)

    hit = rne.simulate(irb140, start, [0] * 6, 6.0, torque=law, breaks=[5.0, 5.001])
    assert 5.0 in hit.t
    impulse = np.linalg.solve(irb140.mass_matrix(start), np.full(6, 100.0)) * 1e-3
    after = hit.qd[np.searchsorted(hit.t, 5.001)]
    assert relative(after, impulse) <= 0.02


NUMBERS = {
    "pd": lambda r, x, path: rne.control.pd(r, x(50), x(20), x(0.5)),
    "pd_gravity": lambda r, x, path: rne.control.pd_gravity(r, x(50), x(20), x(0.5)),
    "computed_torque": lambda r, x, path: rne.control.computed_torque(r, x(50), x(20), path),
    "robust": lambda r, x, path: rne.control.robust(r, x(10), x(0.1), path, 5.0),
    "robust_passive": lambda r, x, path: rne.control.robust_passive([r, r], x(20), x(10), path, boundary=0.1),
    "sliding_mode": lambda r, x, path: rne.control.sliding_mode([r, r], x(10), x(0.1), path),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_one_number_is_meant_for_all_joints(irb140, name):
    path = rne.trajectories.quintic([0] * 6, [1] * 6, 1.0)
    one, six = (NUMBERS[name](irb140, x, path) for x in (lambda a: a, lambda a: [a] * 6))
    q, qd, _ = states(6)
    np.testing.assert_allclose(one(0.3, q, qd), six(0.3, q, qd), rtol=1e-12)  # recursion, then kernel


def test_one_number_is_meant_for_all_joints_of_laws_with_states(irb140):
    path, q, qd = rne.trajectories.quintic([0] * 6, [1] * 6, 1.0), *states(6)[:2]
    for make in (
        lambda x: rne.control.pid(irb140, x(50), x(10), x(20), x(0.5), windup=x(3)),
        lambda x: rne.control.adaptive(irb140, x(20), x(10), path, viscous=x(2), coulomb=x(1), effort_limit=x(99)),
    ):
        one, six = make(lambda a: a), make(lambda a: [a] * 6)
        for single, several in zip(
            one(0.3, q, qd, np.ones(one.states)), six(0.3, q, qd, np.ones(six.states)), strict=True
        ):
            np.testing.assert_allclose(single, several, rtol=1e-12)  # recursion, then kernel


def test_a_law_for_other_joints_is_refused(irb140):
    other = rne.Robot(random_tree(6, 0))
    text = (
        "`controller` is for a robot with the joints joint_1, joint_2, joint_3, joint_4, joint_5, joint_6; "
        "the scene has joint0, joint1, joint2, joint3, joint4, joint5"
    )
    with pytest.raises(ValueError, match=rf"^{re.escape(text)}"):
        rne.Scene(other, controller=rne.control.pd(irb140, 50, 20, 0))


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda r: rne.control.pd(r, [1] * 5 + [-1], 1, 0), "`kp` must not be negative, got -1.0"),
        (lambda r: rne.control.pd_gravity(r, 1, -2, 0), "`kd` must not be negative, got -2.0"),
        (lambda r: rne.control.pid(r, 1, -3, 1, 0), "`ki` must not be negative, got -3.0"),
        (
            lambda r: rne.control.computed_torque(r, 1, -4, lambda t: [[0] * 6] * 3),
            "`kd` must not be negative, got -4.0",
        ),
        (
            lambda r: rne.control.pd(r, [1], [1] * 6, [0] * 6),
            "`kp` must have shape (6,), got (1,)",
        ),
        (
            lambda r: rne.control.computed_torque(r, [1] * 6, [1] * 6, 3),
            "`reference` must be a function of time, got int",
        ),
        (
            lambda r: rne.control.pd(r, [1] * 6, [1] * 6, lambda t: (1, 2)),
            "`reference` must give (q, qd, qdd) of shape (6,) each, got [(), ()]",
        ),
        (
            lambda r: rne.control.pid(r, [1] * 6, [1] * 6, [1] * 6, [0] * 6, windup=0),
            "`windup` must be positive, got 0.0",
        ),
        (lambda r: rne.check_gains(r, [0] * 6, [1] * 6), "`kp` must be positive, got 0.0"),
        (lambda r: rne.check_gains(r, [1] * 6, [1] * 6, -1.0), "`sample_time` must be positive, got -1.0"),
        (
            lambda r: rne.simulate(rne.Scene(r, controller=lambda t, q, qd: q), [0] * 6, [0] * 6, 1.0, torque=[0] * 6),
            "`torque` cannot be given for a scene that has a controller",
        ),
    ],
)
def test_wrong_arguments_are_named(irb140, make, text):
    with pytest.raises(ValueError, match=rf"^{re.escape(text)}$"):
        make(irb140)


@pytest.mark.parametrize("make", [rne.control.pd, rne.control.pd_gravity, rne.control.computed_torque])
def test_a_call_without_the_robot_says_so(make):
    """Python itself would say that `reference` is missing."""
    with pytest.raises(TypeError, match=r"^`robot` must be an rne.Robot, got int$"):
        make(50, 20, [1] * 6)
    with pytest.raises(TypeError, match=r"^`robot` must be an rne.Robot, got Model$"):
        make(robot=rne.irb140(), kp=50, kd=20, reference=[1] * 6)
