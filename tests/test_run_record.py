"""The laws of the arrays of a run's record, as the docstring of RunResult states and numbers them."""

import numpy as np
import pytest

import rne

from .random_robots import straight_chain

END, PERIOD, BREAK = 0.5, 0.05, 0.21
TOLERANCE = 1e-6  # of torques [N m], positions and energies [J] of runs with rtol=1e-9


def step(t, q, qd):
    return np.full(2, 1.0 if t <= BREAK else 2.0) - qd


step.breaks = [BREAK]

SCENES = {
    "free": {},
    "smooth": {"friction": rne.Friction(viscous=0.5, coulomb=0.2), "controller": rne.traceable(lambda t, q, qd: -q)},
    "dry": {"friction": rne.Friction(coulomb=[8.0, 0.3], smoothing=0)},
    "called": {"controller": step},
    "sampled": {"controller": rne.traceable(lambda t, q, qd: -3 * q - qd), "sample_time": PERIOD},
}


@pytest.fixture(scope="module")
def pairs():
    """For each scene the motion at the solver's steps, and at some times without the first."""
    robot, times = rne.Robot(straight_chain(2)), np.linspace(0.1, END, 5)
    scenes = {name: rne.Scene(robot, **parts) for name, parts in SCENES.items()}
    options = {"rtol": 1e-9, "atol": 1e-12}
    return {
        name: [rne.simulate(scene, [0.4, 0.1], [0, 0.2], END, t_eval=t, **options) for t in (None, times)]
        for name, scene in scenes.items()
    }


@pytest.mark.parametrize("name", SCENES)
def test_times_ascend_from_the_start_or_are_those_asked_for(pairs, name):
    whole, asked = pairs[name]
    assert (np.diff(whole.t) > 0).all()
    assert (whole.t[0], whole.t[-1]) == (0.0, END)
    assert asked.t.tolist() == np.linspace(0.1, END, 5).tolist()
    assert not len(asked.jumps)
    for motion in (whole, asked):
        assert {len(getattr(motion, name)) for name in ("q", "qd", "qdd", "tau", "kinetic", "work")} == {len(motion.t)}


@pytest.mark.parametrize("name", SCENES)
def test_energies_count_from_the_start_whatever_is_left_out(pairs, name):
    whole, asked = pairs[name]
    for energy in (whole.work, *whole.dissipated.values()):
        assert energy[0] == 0.0  # where integrals begin
    rounding = 1e-14 * np.abs([whole.kinetic, whole.potential]).max()  # sums of other batches end in other digits
    np.testing.assert_allclose([asked.energy_start, whole.energy_start], whole.energy[0], rtol=0, atol=rounding)
    np.testing.assert_allclose(asked.work[-1], whole.work[-1], atol=TOLERANCE)
    for loss, energy in asked.dissipated.items():
        np.testing.assert_allclose(energy[-1], whole.dissipated[loss][-1], atol=TOLERANCE)
    for motion in (whole, asked):
        assert motion.energy_drift == np.abs(motion.balance).max() < TOLERANCE


def test_values_are_those_after_a_jump_and_those_before_it_beside(pairs):
    motion = pairs["called"][0]
    (k,) = np.flatnonzero(np.isin(motion.t, motion.jumps))
    assert motion.jumps.tolist() == [motion.t[k]] == [BREAK]
    np.testing.assert_allclose(motion.tau[k] - motion.tau_before[0], 1.0, rtol=1e-12)
    robot = rne.Robot(motion.model)
    for tau, qdd in ((motion.tau[k], motion.qdd[k]), (motion.tau_before[0], motion.qdd_before[0])):
        np.testing.assert_allclose(robot.forward_dynamics(motion.q[k], motion.qd[k], tau), qdd, rtol=1e-9)


def test_torques_between_samples_are_those_of_the_sample_before(pairs):
    motion, asked = pairs["sampled"]
    samples = np.arange(round(END / PERIOD)) * PERIOD
    at = np.searchsorted(motion.t, samples * (1 - 1e-12))
    np.testing.assert_allclose(motion.tau[at], -3 * motion.q[at] - motion.qd[at], rtol=1e-12)
    held = at[np.searchsorted(samples, motion.t[:-1] * (1 + 1e-12), side="right") - 1]
    np.testing.assert_array_equal(motion.tau[:-1], motion.tau[held])
    np.testing.assert_allclose(motion.jumps, samples[1:], rtol=1e-12)
    np.testing.assert_allclose(asked.tau[:-1], motion.tau[at[2::2]], atol=TOLERANCE)


def test_where_a_joint_sticks_velocity_and_acceleration_are_zero_and_the_torque_is_the_drives(pairs):
    motion, _ = pairs["dry"]
    stuck = motion.qd[:, 0] == 0.0
    assert stuck.sum() > 3
    assert (motion.qdd[stuck, 0] == 0.0).all()
    assert (motion.tau == 0.0).all()  # no drive, though friction holds the joint against gravity
    assert motion.qd[:, 1].any()


@pytest.mark.parametrize("is_bad", [lambda t: t > 0.2, lambda t: t == 0.3], ids=["for good", "where only a report is"])
def test_a_run_that_fails_ends_before_what_is_not_finite(is_bad):
    robot, times = rne.Robot(straight_chain(2)), [0.0, 0.1, 0.15, 0.3, 0.4]
    with pytest.raises(rne.SimulationError) as failed:
        rne.simulate(
            robot, [0.4, 0.1], [0, 0], END, torque=lambda t, q, qd: (np.nan if is_bad(t) else 1) + q, t_eval=times
        )
    motion = failed.value.trajectory
    assert motion.t.tolist() == times[:3]
    assert motion.status == -1
    assert 0 < motion.t[-1] <= failed.value.time
    for name in ("q", "qd", "qdd", "tau", "energy", "work"):
        values = getattr(motion, name)
        assert len(values) == len(motion.t)
        assert np.isfinite(values).all()


def test_the_time_of_a_stop_is_reported_behind_those_asked_for():
    robot = rne.load("irb140")
    motion = rne.simulate(rne.Scene(robot, stops=True), [0] * 6, [3.0, 0, 0, 0, 0, 0], 2.0, t_eval=np.linspace(0, 2, 5))
    assert motion.status == 1
    *before, last = motion.t.tolist()
    assert before == np.linspace(0, 2, 5)[: len(before)].tolist()
    assert before[-1] < last < before[-1] + 0.5
    assert (
        np.abs(motion.q[-1] - robot.model.upper).min() < TOLERANCE
        or np.abs(motion.q[-1] - robot.model.lower).min() < TOLERANCE
    )
