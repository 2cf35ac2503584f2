"""The likely cause of a difference of torques: faults are planted, and named."""

import re
from dataclasses import replace

import numpy as np
import pytest

import rne

from .helpers import loaded
from .measurements import record, truth
from .planted_faults import planted, planted_pair

SHORT = {  # some causes on one of two robots
    "irb140": ("base turned", "none"),
    "ur5": ("joint order",),
}
ROBOTS = ("irb140", "ur5", "panda")
CAUSES = tuple(planted(loaded("panda")))


@pytest.mark.parametrize(("name", "label"), [(name, label) for name, labels in SHORT.items() for label in labels])
def test_planted_fault_is_named(name, label):
    robot = loaded(name)
    found = rne.compare_models(robot, planted(robot)[label])
    assert found.cause == label.split("/")[0], found.report()


@pytest.mark.long
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("label", CAUSES)
@pytest.mark.parametrize("seed", [1, 2])
def test_every_planted_fault_is_named(name, label, seed):
    robot = loaded(name)
    faults = planted(robot, seed)
    if label not in faults:
        pytest.skip(f"{name} has no products of inertia")
    found = rne.compare_models(robot, faults[label], seed=seed)
    if visible(robot, faults[label]):
        assert found.cause == label.split("/")[0], found.report()
    else:
        assert found.cause == "none", found.report()


def visible(robot, other):
    """False for a fault that torques do not show, such as an inertia that only turns about one axis."""
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 20, robot.n))
    tau = robot.inverse_dynamics(q, qd, qdd)
    return bool((np.abs(other(q, qd, qdd) - tau).max(0) > 1e-7 * np.abs(tau).max(0)).any())


def test_numbers_of_a_payload_are_found():
    robot = loaded("ur5")
    other = rne.Robot(rne.model.with_payload(robot.model, 2.5, com=(0.02, -0.03, 0.1), link="wrist_3_link"))
    found = rne.compare_models(robot, other)
    assert found.text.startswith("it carries a payload of 2.5 kg at (0.02, -0.03, 0.1) m"), found.text


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (3, "`other` must be an rne.Robot, a function of (q, qd, qdd), arrays (q, qd, qdd, tau) or an "
            "rne.identification.Record, got int"),
        (loaded("panda"), "`other` must have 6 joints, as the robot, got 8"),
        (lambda q, qd, qdd: q[:, :5], "`other` must return torques of shape (120, 6), got (120, 5)"),
        (lambda q, qd, qdd: np.nan * q, "`other`: the torques must be finite"),
        ([np.zeros((5, 6))] * 3 + [np.zeros((4, 6))],
         "`other` must be four arrays of shape (N, 6), got [(5, 6), (5, 6), (5, 6), (4, 6)]"),
        ([np.zeros((0, 6))] * 4, "`other` must have at least 14 states for 6 joints, got 0"),
        ([np.ones((1, 6))] * 4, "`other` must have at least 14 states for 6 joints, got 1"),
    ],
    ids=["number", "other joints", "shape", "not finite", "lengths", "no state", "one state"],
)  # fmt: skip
def test_wrong_argument_is_refused(other, message):
    with pytest.raises((TypeError, ValueError), match=f"^{re.escape(message)}$"):
        rne.compare_models(loaded("irb140"), other)


class Torques:
    """A model that is measured: torques alone."""

    def __init__(self, n, torques):
        self.n, self.inverse_dynamics = n, torques


def measured(robot, torques, seed):
    """A record of 10 s with noise of 2 % of each torque and 1e-5 rad."""
    true = truth(Torques(robot.n, torques), seed=seed)
    return record(true, seed, torque_noise=0.02 * np.sqrt((true.tau**2).mean(0)), position_noise=1e-5)


@pytest.mark.long
@pytest.mark.parametrize("label", ["friction"])
def test_fault_is_named_in_a_measured_motion(label):
    robot = loaded("irb140")
    found = rne.compare_models(robot, measured(robot, planted(robot)[label], seed=6))
    assert found.cause == label, found.report()


def test_coarse_encoders_are_no_fault():
    """Rounded to 11 bits, positions give more noise to the predicted torques than the measured ones have."""
    robot = loaded("irb140")
    noise = np.array([1.5, 1.5, 0.9, 0.3, 0.3, 0.3])
    found = rne.compare_models(robot, record(truth(robot), torque_noise=noise, encoder_step=2 * np.pi / 2**11))
    assert found.cause == "none", found.report()


@pytest.mark.long
@pytest.mark.parametrize("label", [label for label in CAUSES if label != "products of inertia"])
@pytest.mark.parametrize(("name", "seed"), [("irb140", 1), ("irb140", 2), ("ur5", 1), ("ur5", 2)])
def test_every_fault_is_named_in_a_measured_motion(name, seed, label):
    robot = loaded(name)
    torques = planted(robot, seed)[label]
    found = rne.compare_models(robot, measured(robot, torques, seed + 5))
    assert found.cause == (label.split("/")[0] if above_noise(robot, torques, seed + 5) else "none"), found.report()


def above_noise(robot, torques, seed):
    """False for a fault that changes torques by less than their noise."""
    true = truth(Torques(robot.n, torques), seed=seed)
    change = true.tau - robot.inverse_dynamics(true.q, true.qd, true.qdd)
    return bool((np.sqrt((change**2).mean(0)) > 2e-3 * np.sqrt((true.tau**2).mean(0))).any())


BODIES = {"one body", "several bodies", "payload", "inertia point", "inertia axes", "products of inertia"}


def assert_both_or_unknown(robot, seed):
    """Never one cause alone, and never one that is not there."""
    first, second, torques = planted_pair(robot, np.random.default_rng(seed))
    found = rne.compare_models(robot, torques)
    expected = {x.split("/")[0] for x in (first, second)}
    named = set(found.causes)
    generous = BODIES if expected & BODIES else set()
    assert named == {"unknown"} or (expected - BODIES <= named <= expected | generous), (first, second, found.report())


@pytest.mark.long
@pytest.mark.parametrize("name", ["irb140", "ur5"])
@pytest.mark.parametrize("seed", range(30))
def test_pairs_of_faults_are_never_taken_for_others(name, seed):
    assert_both_or_unknown(rne.load(name), seed)


@pytest.mark.long
@pytest.mark.parametrize("name", ["ur10", "kinova", "z1", "xarm7", "panda", "double_pendulum"])
def test_same_torques_by_other_bodies_are_no_fault(name):
    """The base parameters alone, all other standard parameters zero: the same torques."""
    robot = loaded(name)
    base = robot.base_parameters()
    found = rne.compare_models(robot, lambda q, qd, qdd: base.regressor(q, qd, qdd) @ base.values)
    assert found.cause == "none", found.report()


def test_two_faults_are_both_named_or_none_is():
    robot = loaded("irb140")
    other = rne.Robot(replace(robot.model, gravity=-robot.model.gravity, armature=[0.1, 0.2, 0.3, 0, 0, 0], notes={}))
    assert set(rne.compare_models(robot, other).causes) == {"gravity sign", "armature"}
