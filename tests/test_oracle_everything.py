"""Every torque and wrench against Pinocchio, each joint relative to its own size, not to the largest joint's.

The comparisons are those of `python -m benchmarks.validation`, on fewer states.
"""

import numpy as np
import pytest

from benchmarks.every_torque import (
    INERTIA,
    Twin,
    arms,
    of_controllers,
    of_edits,
    of_runs,
    of_states,
    quotients,
)
from rne.commands.agreement import random_states

from .helpers import kept, relative

PER_JOINT = 1e-13  # of the joint's own terms: some hundred roundings; measured 1.4e-14 in 1000 states, 1.1e-14 in runs
SAMPLES = 40
ARMS = arms()
RUNS = ["free swing", "driven run"]
THESIS = [name for k in (1, 2, 3) for name in (f"closed loop 6.5-{k}", f"law of 6.5-{k}")]


@pytest.fixture(params=kept(ARMS, set(ARMS) - {"ur5"}), scope="module")
def arm(request):
    return ARMS[request.param]


@pytest.fixture(scope="module")
def samples(arm):
    return random_states(arm.robot.n, SAMPLES)


def agree(differences, quantities):
    """All of the quantities are there, and no joint differs by more than rounding at its own size."""
    found = {one.quantity: one for one in differences}
    assert list(found) == quantities
    too_far = [
        f"{name}, {joint}: {x:.1e}"
        for name, one in found.items()
        for joint, x in zip(one.joints, one.worst, strict=True)
        if not x <= PER_JOINT
    ]
    assert too_far == []


def test_torques_wrenches_and_bearing_loads_are_pinocchios_at_every_joint(arm, samples):
    torques = ["inverse dynamics", "gravity", "bias"]
    wrenches = ["joint force f", "joint moment tau", "bearing force", "bearing torque"]
    agree(of_states(arm, samples), torques + wrenches)


def test_torques_with_payload_mounting_armature_friction_and_wrenches_are_pinocchios(arm, samples):
    agree(of_edits(arm, samples), ["payload", "mounting", "armature", "friction", "wrench on a link"])


def test_torques_of_controllers_are_pinocchios(arm, samples):
    agree(of_controllers(arm, samples), ["pd_gravity", "computed_torque"])


@pytest.mark.parametrize("arm", kept(ARMS, ["panda"]), indirect=True)  # with sliding joints and a mimic
def test_torques_of_simulated_runs_are_pinocchios_at_every_sample(arm):
    thesis = THESIS if arm.robot.model.name == "irb140" else []
    agree(of_runs(arm), [RUNS[0], *thesis, RUNS[1]])


@pytest.mark.parametrize("edit", [{"payload": True}, {"mounted": True}, {"armature": 0.3}], ids=lambda e: next(iter(e)))
def test_each_edit_changes_pinocchios_torques(arm, samples, edit):
    """Otherwise agreement with an edit would say nothing about it."""
    assert relative(Twin(arm, **edit).torques(*samples), Twin(arm).torques(*samples)) >= 1e-3


def test_a_payload_of_another_inertia_is_noticed_at_the_last_joint():
    arm = ARMS["irb140"]
    states = random_states(6, SAMPLES)
    other = arm.robot.with_payload(3.0, [0.05, -0.1, 0.2], INERTIA * (1 + 1e-9), arm.link)
    twin = Twin(arm, payload=True)
    apart = np.abs(other.inverse_dynamics(*states) - twin.torques(*states)).max(axis=0) / twin.sizes(*states)
    assert apart[5] > 100 * PER_JOINT


def test_an_error_of_joint_6_that_hides_behind_joint_2_is_noticed():
    """1e-11 of joint 6's torque is 1e-14 of joint 2's: it passes as a share of the largest entry."""
    arm = ARMS["irb140"]
    states = random_states(6, SAMPLES)
    twin = Twin(arm)
    theirs = twin.torques(*states)
    wrong = theirs * (1 + 1e-11 * np.eye(6)[5])
    assert relative(wrong, theirs) <= PER_JOINT
    assert (np.abs(wrong - theirs).max(axis=0) / twin.sizes(*states))[5] > PER_JOINT


def test_a_difference_without_a_size_is_infinite_and_none_is_zero():
    assert quotients(np.array([0.0, 1.0, 1.0]), np.array([0.0, 0.0, 2.0])).tolist() == [0, np.inf, 0.5]


def test_the_robots_have_branches_mimics_and_sliding_joints():
    kinds = {kind for arm in ARMS.values() for kind in arm.robot.model.joint_types}
    assert {"revolute", "prismatic"} <= kinds
    panda = ARMS["panda"].robot.model
    assert panda.has_mimics
    assert len(set(panda.parent)) < panda.nb
