"""Logs that tell little or nothing end in one sentence of their own class of error, or in a report that says so."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import rne
from rne.identification import Record
from rne.identification.diagnosis.hypotheses import Cause, merged_by_kind

from .helpers import first_joints


def quiet(robot, records, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rne.IdentificationWarning)
        return rne.identify(robot, records, **({"consistent": False, "causes": False, "delay": 0.0} | options))


def swing(n, duration=8.0, rate=50.0):
    """Times, positions, velocities and accelerations of n joints that move all the time."""
    t, w = np.arange(0, duration, 1 / rate), 2 * np.pi * np.array([0.2, 0.31, 0.43])[:n]
    phase = np.outer(t, w) + np.arange(n)
    return t, 0.7 * np.sin(phase), 0.7 * w * np.cos(phase), -0.7 * w**2 * np.sin(phase)


def pendulum_moved_once(move=0.4, rate=200.0):
    t = np.arange(0, 10, 1 / rate)
    s = np.clip((t - 5) / move, 0, 1)
    q = (s - np.sin(2 * np.pi * s) / 2 / np.pi)[:, None]
    return Record(t, q, 3 * np.sin(q) + 0.02 * np.random.default_rng(0).normal(size=q.shape))


def test_of_torques_without_the_motion_no_parameter_is_essential():
    t, q, *_ = swing(2)
    found = quiet(first_joints(2), Record(t, q, np.random.default_rng(1).normal(size=q.shape)))
    few = found.essential(1e-9)
    assert few.base.count == 0
    np.testing.assert_allclose(few.unexplained.in_motion, 1)  # nothing is predicted
    assert (
        f"none of {found.base.count} base parameters is essential: the torques carry no information on the motion"
        in found.report()
    )


def test_one_motion_in_one_block_of_time():
    """Of fits to the other blocks, in which nothing moves, nothing is predicted."""
    found = quiet(rne.Robot(rne.dh_chain(a=[0.5], alpha=[0.0], d=[0.0], theta=[0.0])), pendulum_moved_once())
    assert found.verdict.startswith("not good for simulation or feed-forward")


@pytest.mark.parametrize("missing", [[-1], [0], range(-7, 0), range(5)], ids=str)
def test_rest_is_cut_off_whatever_samples_are_missing(missing):
    t = np.arange(0, 8, 0.01)
    s = np.clip((t - 2) / 4, 0, 1)
    q = (s - np.sin(2 * np.pi * s) / 2 / np.pi)[:, None] * [1.0, -2.0]
    q[list(missing), 1] = np.nan
    part = Record(t, q, np.cos(q)).in_motion()
    assert 2 < part.t[0] < 2.5
    assert 5.5 < part.t[-1] < 6


@pytest.mark.parametrize(
    "q", [np.full((50, 1), np.nan), np.zeros((1, 1)), np.full((50, 1), 0.3)], ids=["nan", "1", "rest"]
)
def test_a_record_without_motion_says_so(q):
    with pytest.raises(ValueError, match=r"^record: no joint moves$"):
        Record(np.arange(len(q)) / 10, q, np.zeros(q.shape)).in_motion()


def test_a_joint_is_named_once_in_causes_of_one_kind():
    """As where records without and with a load both show it."""
    of = [Cause("zero", (name,), f"the zero of {name} is off", 9.0) for name in ("a", "b", "b", "c", "a")]
    (cause,) = merged_by_kind(of)
    assert (cause.joints, cause.text) == (("a", "b", "c"), "the zero of a, b, c is off")


def test_a_joint_that_was_taken_as_locked_comes_before_the_causes_that_it_looks_like():
    t, q, qd, qdd = swing(2)
    arm, names = first_joints(3), ["joint_1", "joint_2"]
    tau = arm.locked({"joint_3": 1.2}).inverse_dynamics(q, qd, qdd)
    found = quiet(arm, Record(t, q, tau, joint_names=names))
    spring = Cause("spring", ("joint_2",), "something pulls joint_2 as a spring", 9.0, removed=np.zeros(2))
    assert replace(found, causes=(spring,)).doubt.startswith(
        "joints that the records do not have, taken as locked: joint_3 at 0: if they stood elsewhere, that is the cause: "
        "lock them there by `robot.locked`. the likely cause: something pulls joint_2"
    )


def test_instruments_of_a_record_of_one_time_are_refused():
    record = Record(np.zeros(30), np.ones((30, 1)), np.ones((30, 1)))
    with pytest.raises(ValueError, match=r"^`instruments\[0\]` needs a record of several times, 'record' has 1$"):
        rne.identify(first_joints(1), record, instruments=np.ones((30, 1)), consistent=False)
