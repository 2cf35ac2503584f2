"""Loads on the bearings along a motion, and their peaks."""

import re
from dataclasses import replace

import numpy as np
import pytest

import rne

from .helpers import Part, assemble
from .random_robots import straight_chain

G = 9.81


@pytest.fixture(scope="module")
def swing(irb140):
    return rne.simulate(irb140, np.zeros(6), np.zeros(6), 1.0, t_eval=np.linspace(0, 1, 51))


def test_peaks_are_the_largest_of_single_samples(irb140, swing):
    peaks = rne.bearing_peaks(irb140, swing)
    loads = [
        rne.dynamics.bearing_loads(irb140.recursion(*motion), irb140.model)
        for motion in zip(swing.q, swing.qd, swing.qdd, strict=True)
    ]
    for k, (peak, when) in enumerate([(peaks.force, peaks.force_time), (peaks.torque, peaks.torque_time)]):
        every = np.array([load[k] for load in loads])
        np.testing.assert_allclose(peak, every.max(axis=0), rtol=1e-12)
        at = np.searchsorted(swing.t, when)
        np.testing.assert_allclose(every[at, range(6)], every.max(axis=0), rtol=1e-12)


def test_a_rod_falling_from_upright_loads_its_bearing_most_at_the_bottom():
    """m g + m w^2 l/2 with w^2 = 6 g / l: four times its weight (a rod's w^2 l / 2 = 3 g)."""
    m, l = 2.0, 0.5
    rod = rne.Robot(straight_chain(1, length=l, mass=m))
    fall = rne.simulate(rod, [np.pi - 1e-2], [0.0], 3.0, rtol=1e-9, t_eval=np.linspace(0, 3, 3001))
    peaks = rne.bearing_peaks(rod, fall)
    assert peaks.force[0] == pytest.approx(4 * m * G, rel=1e-3)
    assert peaks.torque[0] == pytest.approx(0, abs=1e-12)
    assert abs(fall.q[np.searchsorted(fall.t, peaks.force_time[0]), 0]) < 0.02


def test_a_slider_on_a_level_rail_carries_its_weight_whatever_its_drive():
    sled = rne.Robot(
        assemble(
            "sled",
            [
                Part(link="base"),
                Part(link="box", joint="rail", kind="prismatic", parent=0, axis=np.array([1.0, 0, 0]), mass=3.0),
            ],
        )
    )
    run = rne.simulate(sled, [0.0], [0.0], 1.0, torque=[50.0])
    assert rne.bearing_peaks(sled, run).force[0] == pytest.approx(3 * G, rel=1e-12)


def test_one_sample_is_its_own_peak(irb140):
    still = np.zeros(6)
    alone = rne.simulate(irb140, still, still, 0.0, torque=irb140.gravity_torque(still))
    peaks = rne.bearing_peaks(irb140, alone)
    assert peaks.samples == 1
    assert peaks.force[0] == pytest.approx(75 * G, rel=1e-12)
    assert (peaks.force_time == 0).all()


def test_the_bearing_of_an_upright_axis_carries_weight_and_tilting_moment():
    """2 kg, 0.5 m beside the axis: 2 g along it and 2 g 0.5 across it; spinning adds m omega^2 r."""
    crane = rne.model.chain([np.eye(3)], [[0, 0, 0]], masses=[2.0], centres=[[0.5, 0, 0]], inertias=[np.eye(3)])
    record = rne.dynamics.recursion(crane, np.zeros((2, 1)), [[0.0], [3.0]], np.zeros((2, 1)))
    force, torque = rne.dynamics.bearing_loads(record, crane)
    np.testing.assert_allclose(force[:, 0], [2 * G, np.hypot(2 * G, 2 * 3**2 * 0.5)], rtol=1e-14)
    np.testing.assert_allclose(torque[:, 0], [2 * G * 0.5] * 2, rtol=1e-14)


def test_a_robot_without_joints_has_no_bearings():
    block = rne.Robot(assemble("block", [Part(link="base", mass=1.0)]))
    peaks = rne.bearing_peaks(block, rne.simulate(block, [], [], 1.0))
    assert peaks.force.shape == (0,)
    assert str(peaks) == "Peak loads on the bearings, 0 ... 1 s, 17 samples: no moving joints"


def test_table_has_a_line_for_every_joint_with_units(irb140):
    still = np.zeros(6)
    text = str(rne.bearing_peaks(irb140, rne.simulate(irb140, still, still, 0.0, torque=irb140.gravity_torque(still))))
    lines = text.splitlines()
    assert lines[0] == "Peak loads on the bearings, 0 ... 0 s, 1 sample"
    assert [part.strip() for part in lines[1].split("  ") if part.strip()] == [
        "joint", "force [N]", "at t [s]", "torque [N m]", "at t [s]",
    ]  # fmt: skip
    assert [line.split()[0] for line in lines[2:]] == list(irb140.joint_names)
    assert lines[2].split()[1:3] == ["735.75", "0"]
    peaks = rne.bearing_peaks(irb140, rne.simulate(irb140, still, still, 0.0, torque=irb140.gravity_torque(still)))
    for column, values in ((1, peaks.force), (3, peaks.torque)):
        np.testing.assert_allclose([float(line.split()[column]) for line in lines[2:]], values, rtol=5e-6)
    assert max(map(len, lines)) <= 100
    ends = [title.end() for title in re.finditer(r"(force|at t|torque) \[[^]]+\]", lines[1])]
    for line in lines[2:]:
        numbers = list(re.finditer(r"\S+", line))[1:]
        assert all(number.end() <= end for number, end in zip(numbers, ends, strict=True))
        assert all(number.start() > end for number, end in zip(numbers[1:], ends[:-1], strict=True))


def empty(trajectory):
    arrays = {k: v[:0] for k, v in vars(trajectory).items() if isinstance(v, np.ndarray)}
    return replace(trajectory, **arrays)


def test_empty_trajectory_is_refused(irb140, swing):
    with pytest.raises(ValueError, match=r"^`motion` must have at least one sample, got none$"):
        rne.bearing_peaks(irb140, empty(swing))


def test_trajectory_of_another_robot_is_refused(swing):
    other = rne.Robot(straight_chain(2))
    with pytest.raises(ValueError, match=r"^`motion` must be of the robot 'chain2' with joints \['joint0', 'joint1'\]"):
        rne.bearing_peaks(other, swing)


def test_model_for_robot_is_refused(irb140, swing):
    with pytest.raises(TypeError, match=r"^`robot` must be an rne.Robot, got Model$"):
        rne.bearing_peaks(irb140.model, swing)


def test_array_for_trajectory_is_refused(irb140, swing):
    with pytest.raises(
        TypeError, match=r"^`motion` must be a function of time or have arrays t, q and qd, got ndarray$"
    ):
        rne.bearing_peaks(irb140, swing.q)
