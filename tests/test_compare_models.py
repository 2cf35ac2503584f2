"""The likely cause of a difference of torques: faults are planted, and named."""

import re
from dataclasses import replace

import numpy as np
import pytest

import rne

from .planted_faults import planted

SHORT = {  # each cause once, on one of three robots
    "irb140": ("gravity sign", "base turned", "joint zero", "viscous friction", "payload", "inertia point", "none"),
    "ur5": ("joint order", "axis flipped", "torque sign", "armature", "inertia axes", "one body", "angle unit"),
}
ROBOTS = ("irb140", "ur5", "panda")
CAUSES = tuple(planted(rne.load("panda")))


@pytest.mark.parametrize(("name", "label"), [(name, label) for name, labels in SHORT.items() for label in labels])
def test_planted_fault_is_named(name, label):
    robot = rne.load(name)
    found = rne.compare_models(robot, planted(robot)[label])
    assert found.cause == label.split("/")[0], found.report()


@pytest.mark.long
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("label", CAUSES)
@pytest.mark.parametrize("seed", [1, 2])
def test_every_planted_fault_is_named(name, label, seed):
    robot = rne.load(name)
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
    robot = rne.load("ur5")
    other = rne.Robot(rne.with_payload(robot.model, 2.5, com=(0.02, -0.03, 0.1), link="wrist_3_link"))
    found = rne.compare_models(robot, other)
    assert found.text.startswith("it carries a payload of 2.5 kg at (0.02, -0.03, 0.1) m"), found.text


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (3, "`other` must be an rne.Robot, a function of (q, qd, qdd), arrays (q, qd, qdd, tau) or an "
            "rne.identification.Record, got int"),
        (rne.load("panda"), "`other` must have 6 joints, as the robot, got 8"),
        (lambda q, qd, qdd: q[:, :5], "`other` must return torques of shape (120, 6), got (120, 5)"),
        (lambda q, qd, qdd: np.nan * q, "`other`: the torques must be finite"),
        ([np.zeros((5, 6))] * 3 + [np.zeros((4, 6))],
         "`other` must be four arrays of shape (N, 6), got [(5, 6), (5, 6), (5, 6), (4, 6)]"),
    ],
    ids=["number", "other joints", "shape", "not finite", "lengths"],
)  # fmt: skip
def test_wrong_argument_is_refused(other, message):
    with pytest.raises((TypeError, ValueError), match=f"^{re.escape(message)}$"):
        rne.compare_models(rne.load("irb140"), other)


def test_two_faults_are_both_named_or_none_is():
    robot = rne.load("irb140")
    other = rne.Robot(replace(robot.model, gravity=-robot.model.gravity, armature=[0.1, 0.2, 0.3, 0, 0, 0], notes={}))
    assert set(rne.compare_models(robot, other).causes) == {"gravity sign", "armature"}
