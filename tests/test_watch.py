"""Runs that are watched: loops that become stiff on the way, and laws that chatter, end in bounded time."""

import itertools
import re

import numpy as np
import pytest

import rne

from .helpers import Part, assemble, kept
from .random_robots import straight_chain

CHATTERING = list(itertools.product(["called", "traced", "dry"], ["auto", "LSODA", "RK45", "Radau"]))


@pytest.fixture
def block():
    joint = Part(link="l", joint="j", kind="prismatic", parent=0, axis=np.eye(3)[0], mass=1.0)
    return rne.Robot(assemble("slider", [Part(link="base"), joint], gravity=(0, 0, 0)))


def switching(t, q, qd):
    """A sliding mode: on q + qd = 0 the force switches without end."""
    return -2 * np.sign(q + qd)


def test_auto_goes_on_with_lsoda_where_a_motion_becomes_stiff(irb140):
    """Smoothed Coulomb friction is stiff around zero rate only, where a joint passes later."""
    scene = rne.Scene(irb140, friction=rne.Friction(coulomb=2.0))
    motion = rne.simulate(scene, np.zeros(6), np.ones(6), 0.5)
    assert motion.method == "LSODA"
    assert "LSODA from t = " in motion.message
    reference = rne.simulate(scene, np.zeros(6), np.ones(6), 0.5, method="LSODA", rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(motion.q[-1], reference.q[-1], atol=1e-4)
    held_back = rne.simulate(scene, np.zeros(6), np.ones(6), 0.025, method="DOP853")
    assert motion.evaluations < held_back.evaluations  # twenty times as long


@pytest.mark.parametrize(
    ("kind", "method"),
    kept(CHATTERING, [("called", "auto"), ("dry", "LSODA")]),
)
def test_a_sliding_mode_ends_with_an_error_that_says_what_to_smooth(block, kind, method):
    """Once without end: 60 s take 1e9 steps. The surface q + qd = 0 is reached after 0.41 s, 0.48 s with friction."""
    traced = rne.traceable(lambda t, q, qd: -2 * rne.elementwise.sign(q + qd))
    friction = rne.Friction(coulomb=0.3, smoothing=0) if kind == "dry" else None
    scene = rne.Scene(block, controller=traced if kind == "traced" else switching, friction=friction)
    with pytest.raises(rne.SimulationError) as caught:
        rne.simulate(scene, [1.0], [0.0], 60.0, method=method)
    error = caught.value
    assert "the torque of 'j' jumps by " in str(error)
    assert str(error).endswith("the law chatters; smooth it, such as by tanh, or sample it")
    assert 0.41 < error.time < 0.5
    assert error.trajectory.t[-1] == error.time
    assert error.trajectory.evaluations < 20_000


def test_a_milligram_may_chatter_as_a_kilogram():
    calls, slider = [], Part(link="l", joint="j", kind="prismatic", parent=0, axis=np.eye(3)[0], mass=1e-6)
    robot = rne.Robot(assemble("slider", [Part(link="base"), slider], gravity=(0, 0, 0)))

    def law(t, q, qd):
        calls.append(t)
        assert len(calls) < 100_000
        return 1e-6 * switching(t, q, qd)

    with pytest.raises(rne.SimulationError, match=r"the torque of 'j' jumps by 4e-06 where"):
        rne.simulate(robot, [1.0], [0.0], 60.0, torque=law)


@pytest.mark.parametrize("kind", kept(["called", "traceable"], ["called"]))
def test_a_law_with_noise_ends_after_bounded_work(block, kind):
    """Once without end: no step control follows torques that differ at each call, nor do panels of the ledger."""
    rng, calls = np.random.default_rng(0), []

    def noise(t, q, qd):
        calls.append(t)
        return rng.normal(size=1)

    law = {"called": lambda law: law, "traceable": rne.traceable}[kind](noise)
    text = (
        r"is -?[\d.]+ and, asked for again at the same time and state, -?[\d.]+ at t = .* noise or memory; sample it$"
    )
    with pytest.raises(rne.SimulationError, match=text) as caught:
        rne.simulate(rne.Scene(block, controller=law), [0.0], [0.0], 10.0)
    assert caught.value.trajectory.evaluations < 20_000
    assert len(calls) < 200_000


def test_the_joint_whose_torque_is_noise_is_named():
    rng = np.random.default_rng(0)
    scene = rne.Scene(rne.Robot(straight_chain(2)), controller=lambda t, q, qd: np.array([0.5, rng.normal()]))
    text = r"the torque of 'joint1' is (\S+) and, asked for again at the same time and state, (\S+) at t = "
    with pytest.raises(rne.SimulationError, match=text) as caught:
        rne.simulate(scene, [0.0, 0.0], [0.0, 0.0], 1.0)
    first, again = re.search(text, str(caught.value)).groups()
    assert first != again


@pytest.mark.parametrize("method", kept(["DOP853", "RK45"], ["DOP853"]))
def test_a_stiff_loop_is_no_chatter(irb140, method):
    """An explicit method is held to tiny steps by stability; its torques are continuous."""
    law = rne.control.pd_gravity(irb140, [50] * 6, [200] * 6, np.zeros(6))
    motion = rne.simulate(rne.Scene(irb140, controller=law), np.full(6, 0.1), np.zeros(6), 0.02, method=method)
    assert motion.status == 0


@pytest.mark.parametrize("x0", kept([0.5, 0.4, 0.3, 0.2, 0.1], [0.5]))
def test_a_law_that_switches_once_in_a_while_runs(block, x0):
    """A bang-bang oscillator: x'' = -sign(x) has period 4 sqrt(2 x0), and jumps that are left behind at once."""
    duration = 10 * 4 * (2 * x0) ** 0.5
    motion = rne.simulate(block, [x0], [0.0], duration, torque=lambda t, q, qd: -np.sign(q), rtol=1e-9, atol=1e-12)
    assert motion.q[-1, 0] == pytest.approx(x0, abs=1e-5)
    assert motion.energy_drift <= 1e-6 * 40 * x0  # x0 joules are exchanged in each of 40 quarters


def test_sampled_switching_is_a_motion(block):
    """Sampled, the same law is a sequence of constant forces."""
    motion = rne.simulate(rne.Scene(block, controller=switching, sample_time=0.01), [1.0], [0.0], 10.0)
    assert abs(motion.q[-1, 0]) < 0.02


def test_a_motion_that_would_take_ever_so_many_steps_is_given_up():
    """At 1e30 rad/s a step is some 1e-31 s; at 1e200 rad/s squares overflow."""
    robot = rne.Robot(straight_chain(2))
    text = r"1000 steps came to t = \d\.\d+e-\d+ s, where 'joint\d' moves at \d\.\d+e\+3\d rad/s or m/s: the run would take more than 1e\+10$"
    with pytest.raises(rne.SimulationError, match=text) as error:
        rne.simulate(robot, [0, 0], [1e30, 1e30], 0.01)
    assert error.value.time > 0
    with pytest.raises(rne.SimulationError, match="overflows float64"):
        rne.simulate(robot, [0, 0], [1e200, 1e200], 0.01)
