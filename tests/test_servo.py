"""Hobby servos: their torques in every regime, motions against SciPy, derivatives, the same by machine code."""

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate

import rne

from .random_robots import random_tree, straight_chain

ROUNDING = 1e-12  # of sums in another order
KP, KD, BAND, STALL, SPEED = 20.0, 0.3, 0.05, 2.0, 5.0
NUMBERS = ("kp", "kd", "dead_band", "stall_torque", "no_load_speed")


@pytest.fixture(scope="module")
def rod():
    return rne.Robot(straight_chain(1)).with_armature(0.05)


def servo_of(robot, reference=0.0, **other):
    given = {"dead_band": BAND, "stall_torque": STALL, "no_load_speed": SPEED} | other
    return rne.control.servo(robot, KP, KD, reference, **given)


def torque(law, q, qd):
    return law(0.0, np.array([float(q)]), np.array([float(qd)])).item()


def test_at_rest_the_torque_is_that_of_the_error_beyond_the_dead_band(rod):
    law = servo_of(rod)
    expected = {0.04: 0.0, -0.04: 0.0, 0.05: 0.0, 0.07: -KP * 0.02, -0.07: KP * 0.02, 1.0: -STALL, -1.0: STALL}
    for q, u in expected.items():
        assert abs(torque(law, q, 0) - u) < ROUNDING


def test_under_full_voltage_torque_falls_linearly_with_speed(rod):
    """To 0 at the no-load speed, and below beyond it; a motor that brakes has no less torque than at rest."""
    law = servo_of(rod, 10.0)
    for speed, share in {0: 1, 2.5: 0.5, 5: 0, 6: -0.2, -2.5: 1.5, -5: 2}.items():
        assert abs(torque(law, 0, speed) - share * STALL) < ROUNDING
    for q, qd in np.random.default_rng(0).uniform(-3, 3, (20, 2)):
        assert torque(servo_of(rod), q, qd) == -torque(servo_of(rod), -q, -qd)


def test_within_its_limits_it_is_a_pd_law_whose_damping_is_that_of_the_back_emf_too(rod):
    law, pd = servo_of(rod, 0.1, dead_band=0), rne.control.pd(rod, KP, KD + STALL / SPEED, 0.1)
    unlimited = servo_of(rod, 0.1, dead_band=0, stall_torque=np.inf, no_load_speed=np.inf)
    for q, qd in np.random.default_rng(1).uniform([0.05, -1], [0.15, 1], (20, 2)):
        assert abs(torque(law, q, qd) - torque(pd, q, qd)) < ROUNDING
        assert torque(unlimited, 9 + q, qd) == torque(rne.control.pd(rod, KP, KD, 0.1), 9 + q, qd)


def test_limits_may_be_those_of_some_joints():
    robot = rne.Robot(straight_chain(3))
    law = rne.control.servo(robot, 10, 0, 1, stall_torque=[2, np.inf, 3], no_load_speed=[4, np.inf, np.inf])
    np.testing.assert_allclose(law(0.0, np.zeros(3), np.ones(3)), [1.5, 10, 3], rtol=ROUNDING)
    numbers = rne.Scene(robot, controller=law).numbers
    np.testing.assert_array_equal(numbers["controller.stall_torque"], [2, np.inf, 3])
    np.testing.assert_array_equal(numbers["controller.no_load_speed"], [4, np.inf, np.inf])
    assert "stall_torque=[2, 1e+300, 3]" in repr(law)
    assert "stall" not in repr(rne.control.servo(robot, 10))
    assert "dead_band" not in repr(law)


def test_a_motion_is_that_of_its_equation(rod):
    """Of a rod that is lifted: full voltage, then the loop, in the end the dead band; by SciPy from its own formula."""
    scene, times = rne.Scene(rod, controller=servo_of(rod, 0.6)), np.linspace(0, 2, 41)
    J, weight = 0.3**2 / 3 * rod.model.mass[0] + 0.05, 9.81 * 0.15 * rod.model.mass[0]

    def rates(t, y):
        e = 0.6 - y[0]
        drive = np.clip(KP * np.sign(e) * max(abs(e) - BAND, 0) - KD * y[1], -STALL, STALL)
        return [y[1], (drive - STALL / SPEED * y[1] - weight * np.sin(y[0])) / J]

    how = {"rtol": 1e-10, "atol": 1e-12, "max_step": 0.01}
    expected = scipy.integrate.solve_ivp(rates, (0, 2), [-0.5, 0.0], t_eval=times, **how).y
    found = rne.simulate(scene, [-0.5], [0.0], 2.0, t_eval=times, rtol=1e-9, atol=1e-11)
    assert scene.cost()["law"] == "traced"
    np.testing.assert_allclose(found.q[:, 0], expected[0], rtol=0, atol=1e-7)
    np.testing.assert_allclose(found.qd[:, 0], expected[1], rtol=0, atol=1e-6)


def stepping(rod, **other):
    """A servo that follows steps, which are held: it is limited, it holds, and rests within its dead band."""
    steps = rne.trajectories.sampled([0.0, 0.4, 1.0], [[0.5], [-0.2], [-0.2]], kind="hold")
    friction = rne.Friction(viscous=0.02, load=0.1, smoothing=0.3)
    return rne.Scene(rod, controller=servo_of(rod, steps, **other.pop("limits", {})), friction=friction, **other)


def through_complex_steps(name, seed):
    """Positions of `stepping` at the ends of equal steps of RK4 by its own formula, a number's seed beside it."""
    p = dict(zip(NUMBERS, (KP, KD, BAND, STALL, SPEED), strict=True))
    p[name] = p[name] + seed
    J, weight, h = 0.3**2 / 3 + 0.05, 9.81 * 0.15, 0.02
    clip = lambda x, low, high: low if x.real < low.real else high if x.real > high.real else x  # noqa: E731

    def rates(t, q, v):
        e = (0.5 if t < 0.4 else -0.2) - q
        e = e - clip(e, -p["dead_band"], p["dead_band"])
        u = clip(p["kp"] * e - p["kd"] * v, -p["stall_torque"], p["stall_torque"])
        u = u - p["stall_torque"] / p["no_load_speed"] * v - 0.02 * v
        way = np.tanh(v / 0.3) if u.real >= 0 else -np.tanh(v / 0.3)
        return v, (u / (1 + 0.1 * way) - weight * np.sin(q)) / J

    q, v, found = -0.4 + 0j, 0j, []
    for k in range(40):
        t, last = k * h, np.nextafter((k + 1) * h, 0)
        a1, b1 = rates(t, q, v)
        a2, b2 = rates(t + h / 2, q + h / 2 * a1, v + h / 2 * b1)
        a3, b3 = rates(t + h / 2, q + h / 2 * a2, v + h / 2 * b2)
        a4, b4 = rates(last, q + h * a3, v + h * b3)
        q, v = q + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4), v + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
        found.append(q)
    return np.array(found)


def test_derivatives_are_those_of_complex_steps(rod):
    names = [f"controller.{name}" for name in NUMBERS]
    ends = np.linspace(0, 0.8, 41)
    found = rne.sensitivities(stepping(rod), [-0.4], [0.0], 0.8, wrt=names, step=0.02, t_eval=ends)
    for name in NUMBERS:
        along = through_complex_steps(name, 1e-30j)
        np.testing.assert_allclose(found.q[1:, 0], along.real, rtol=0, atol=ROUNDING)
        slopes = found.dq[f"controller.{name}"][1:, 0, 0]
        assert np.abs(slopes).max() > 1e-3
        np.testing.assert_allclose(slopes, along.imag / 1e-30, rtol=0, atol=ROUNDING * max(1, np.abs(slopes).max()))


def test_sampled_it_is_held_for_a_period(rod):
    """The whole torque, the back EMF too: derivatives by complex steps in the motion from command to command."""
    cart = rne.Robot(rod.model).with_armature(0.5)
    scene = rne.Scene(cart, controller=servo_of(cart, 0.5, no_load_speed=2.0), gravity=[0, 0, 0], sample_time=0.05)
    J, names = 0.3**2 / 3 + 0.5, [f"controller.{name}" for name in NUMBERS]
    found = rne.sensitivities(scene, [-0.1], [0.2], 0.5, wrt=names, step=0.05)
    for j, name in enumerate(NUMBERS):
        kp, kd, band, stall, speed = np.array([KP, KD, BAND, STALL, 2.0]) + 1e-30j * np.eye(5)[j]
        q, v = -0.1 + 0j, 0.2 + 0j
        for _ in range(10):
            e = 0.5 - q
            u = kp * (e - band if e.real > BAND else e + band if e.real < -BAND else 0) - kd * v
            u = (stall * np.sign(u.real) if abs(u.real) > STALL else u) - stall / speed * v
            q, v = q + 0.05 * v + 0.05**2 / 2 * u / J, v + 0.05 * u / J
        assert abs(found.q[-1, 0] - q.real) < ROUNDING
        assert abs(found.dq[f"controller.{name}"][-1, 0, 0] - q.imag / 1e-30) < 1e-11  # of Runge-Kutta's parabolas


def test_one_program_has_all_numbers(rod):
    """Motions of numbers of their own are those of laws made with them."""
    scene, start = rne.Scene(rod, controller=servo_of(rod, 0.5)), ([-0.4], [0.0])
    numbers = {"controller.kp": [10.0, 30.0], "controller.dead_band": [0.0, 0.1]}
    numbers |= {"controller.stall_torque": [1.0, 5.0], "controller.no_load_speed": [4.0, np.inf]}
    numbers = {name: np.array(x)[:, None] for name, x in numbers.items()}
    found = rne.ensemble(scene, np.tile(start[0], (2, 1)), np.tile(start[1], (2, 1)), 0.8, step=0.02, numbers=numbers)
    for k in range(2):
        own = {name: x[k] for name, x in numbers.items()}
        law = rne.control.servo(rod, own["controller.kp"], KD, 9, **{n: own[f"controller.{n}"] for n in NUMBERS[2:]})
        law = replace(law, reference=np.array([0.5]))
        for at in (replace(scene, controller=law), scene.with_numbers(own)):
            alone = rne.sensitivities(at, *start, 0.8, wrt="q0", step=0.02)
            np.testing.assert_allclose(found.q[-1, k], alone.q[-1], rtol=0, atol=ROUNDING)


def test_derivatives_by_a_dead_band_that_is_zero_are_those_of_one_side(rod):
    at = stepping(rod, limits={"dead_band": 0.0})
    how = {"wrt": "controller.dead_band", "step": 0.02, "t_eval": np.linspace(0, 0.8, 9)}
    found = rne.sensitivities(at, [-0.4], [0.0], 0.8, **how)
    ends = [
        rne.sensitivities(at.with_numbers({"controller.dead_band": x}), [-0.4], [0.0], 0.8, **how).q
        for x in (1e-6, 2e-6)
    ]
    differences = (4 * ends[0] - 3 * found.q - ends[1]) / 2e-6
    slopes = found.dq["controller.dead_band"][:, :, 0]
    np.testing.assert_allclose(slopes, differences, rtol=0, atol=1e-6)
    assert np.abs(slopes).max() > 0.1


@pytest.mark.long
def test_machine_code_and_numpy_agree():
    """Of three joints, limits of some: motions and derivatives by all numbers."""
    pytest.importorskip("numba", reason="Numba is not installed")
    arm = rne.Robot(random_tree(3, 4, prismatic=0, branching=0)).with_armature(0.3)
    law = rne.control.servo(arm, [20, 30, 25], [0.1, 0, 0.3], [0.5, -0.4, 1], dead_band=[0, 0.02, 0.05])
    law = replace(law, stall_torque=np.array([3.0, np.inf, 2.0]), no_load_speed=np.array([5.0, np.inf, 4.0]))
    scene = rne.Scene(arm, controller=law, friction=rne.Friction(viscous=0.1, load=0.1))
    names, found = [f"controller.{name}" for name in NUMBERS], []
    for engine in ("numpy", "numba"):
        robot = rne.Robot(arm.model, engine)
        at = replace(scene, robot=robot, controller=replace(law, robot=robot))
        found.append(rne.sensitivities(at, [0.1] * 3, [0.0] * 3, 0.5, wrt=names, step=0.01))
    for name in names:
        slopes, expected = (run.dq[name] for run in found)
        np.testing.assert_allclose(slopes, expected, rtol=0, atol=1e-10 * max(1, np.abs(expected).max()))


def test_published_figures(rod):
    """A servo lifts its nominal torque and no more, and under full voltage its speed is the nominal one."""
    for name, torque_, speed in (("sts3215-7.4v", 1.912, 5.454), ("sts3215-12v", 2.942, 4.717)):
        figures = rne.control.servo_figures(name)
        law = figures.law(rod, 9.0)
        assert abs(torque(law, 0, 0) - torque_) < 1e-3
        assert abs(torque(law, 0, speed)) < 1e-3
        assert abs(torque(law, 9 - 1 / (16 * figures.gain), 0) - torque_) < 1e-3
        assert abs(torque(law, 9 - 0.5 / (16 * figures.gain), 0) - torque_ / 2) < 1e-3
        assert abs(torque(figures.law(rod, 0.1, p=8), 0, 0) - 0.8 * figures.gain * torque_) < 1e-3
        assert "commit" in figures.source
    with pytest.raises(ValueError, match=r"^`p` must be positive, got 0.0$"):
        figures.law(rod, p=0)
    with pytest.raises(ValueError, match=r"^`name` must be one of \['sts3215-7.4v', 'sts3215-12v'\], got 'mg90s'$"):
        rne.control.servo_figures("mg90s")


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"dead_band": -0.1}, "`dead_band` must not be negative, got -0.1"),
        ({"stall_torque": 0.0}, "`stall_torque` must be positive, got 0.0"),
        ({"no_load_speed": -1.0}, "`no_load_speed` must be positive, got -1.0"),
        ({"stall_torque": None}, "`stall_torque` must be an array of numbers of shape (1,), got dtype object"),
        ({"stall_torque": [1, 2]}, "`stall_torque` must have shape (1,), got (2,)"),
        (
            {"stall_torque": np.inf},
            "`no_load_speed` needs a finite `stall_torque`, the torque that has fallen to 0 there",
        ),
        ({"reference": lambda t: (1, 2)}, "`reference` must give (q, qd, qdd) of shape (1,) each, got [(), ()]"),
    ],
)
def test_wrong_arguments_are_named(rod, wrong, text):
    with pytest.raises(ValueError, match=rf"^{re.escape(text)}$"):
        servo_of(rod, **wrong)


def test_wrong_numbers_are_named(rod):
    with pytest.raises(ValueError, match=r"^`numbers\['controller.no_load_speed'\]` must be positive, got 0.0$"):
        stepping(rod).with_numbers({"controller.no_load_speed": 0.0})
