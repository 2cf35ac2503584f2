"""Identification of robots whose joints follow others: base parameters, fits, loads, gains, ratios that are wrong."""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import rne
from benchmarks import identification_couplings as planted
from rne.basics.inertia import pseudo_inertia
from rne.dynamics.kinematics import coordinate_map, joint_positions
from rne.identification import Record
from rne.identification.diagnosis.hypotheses import coupling_ratios
from rne.identification.diagnosis.residuals import FitResiduals
from rne.model import coupled
from rne.model.coupling import with_ratio

from .helpers import kept
from .test_base_parameters import check
from .test_couplings import ROBOTS, linkage, part, robot_of, tree

WITHIN = 0.95  # share of estimates within three standard errors; 99.7 % if noise were normal and known
SAME = 1e-10  # relative, of torques by two ways
SEVERAL = [(name, 10) for name in planted.ROBOTS]  # of the 100 runs of the benchmark
QUICK = {"consistent": False, "causes": False}


def geared():
    """A forearm that turns 1.5 times as far as its shoulder, backwards, and a hand that turns by a curve."""
    links = part("shoulder", 0, (0, 0, 0)), part("forearm", 1, (0, 0, 0.4)), part("hand", 2, (0.3, 0, 0))
    open_tree = tree(*links, part("cam", 3, (0.2, 0, 0), (0, 0.6, 0.8)))
    follow = {
        "forearm": (("shoulder",), lambda x: 0.4 - 1.5 * x),
        "cam": (("hand",), lambda x: 0.2 + np.sin(x) / 2 - x),
    }
    return coupled(open_tree, follow)


def log(robot, seed=0, *, seconds=10.0, noise=0.002, **scene):
    """A record of a motion within the ranges, of a robot without drives."""
    motion = planted.truth(robot, seed, seconds=seconds)
    tau = rne.Scene(robot, **scene).inverse_dynamics(motion.q, motion.qd, motion.qdd)
    tau = tau + noise * np.abs(tau).max(0) * np.random.default_rng(seed).normal(size=tau.shape)
    return Record(motion.t, motion.q, tau, joint_names=robot.joint_names)


def without_followers_drives(model):
    drives = np.zeros(model.nb)
    drives[list(model.independent_joints)] = 0.1
    return replace(model, armature=drives)


@pytest.mark.parametrize("options", [{}, {"rotor": True, "friction": "viscous+coulomb", "offset": True}])
@pytest.mark.parametrize("name", kept(ROBOTS, ["press"]))
def test_base_parameters_are_as_many_as_the_rank(name, options):
    check(linkage(name)[0], **options)


@pytest.mark.parametrize(("name", "runs"), kept([("coupled wrist", 1), *SEVERAL], [("coupled wrist", 1)]))
def test_estimates_are_within_three_standard_errors(name, runs):
    assert planted.within(planted.parameters(name, runs))[0] >= WITHIN


@pytest.mark.parametrize(("name", "runs"), kept([("coupled wrist", 1), *SEVERAL], [("coupled wrist", 1)]))
def test_loads_are_within_three_standard_errors(name, runs):
    share, count = planted.within(planted.loads(name, runs))
    assert share >= WITHIN
    assert count == 4 * runs  # all of them are known


@pytest.mark.long
@pytest.mark.parametrize(("name", "runs"), SEVERAL)
def test_gains_are_within_three_standard_errors(name, runs):
    share, count = planted.within(planted.gains(name, runs))
    assert share >= WITHIN
    assert count == runs * planted.ROBOTS[name]().n


def test_what_is_found_is_a_robot_with_the_same_couplings(tmp_path):
    robot = robot_of(without_followers_drives(linkage("press")[0]))
    found = rne.identify(robot, log(robot), causes=False)
    other = planted.truth(robot, 1, seconds=2.0)
    motion = other.q, other.qd, other.qdd
    torques = found.predict(*motion)
    assert found.robot.model.couplings == robot.model.couplings
    assert np.linalg.eigvalsh(pseudo_inertia(found.robot.parameters)).min() > 0
    size = np.abs(torques).max()
    np.testing.assert_allclose(found.scene().inverse_dynamics(*motion), torques, atol=SAME * size)
    again = rne.identification.Identification.load(found.save(tmp_path / "press.npz"))
    np.testing.assert_allclose(again.predict(*motion), torques, atol=SAME * size)
    text = "takes no couplings, but joint 'rod' of robot"
    with pytest.raises(rne.ModelError, match=re.escape(text)):
        found.to_urdf()


@pytest.mark.long
def test_springs_at_joints_that_follow_are_found():
    robot, stiffness = planted.palletiser(), 200.0
    springs = [rne.Spring.at_joint("forearm", stiffness=stiffness, rest=0.5)]
    found = rne.identify(robot, log(robot, seconds=20.0, springs=springs), springs=springs, **QUICK)
    assert abs(found.springs[0].stiffness - stiffness) < 3 * found.spring_errors[0, 0]
    assert found.spring_errors[0, 0] < 0.05 * stiffness


@pytest.mark.long
def test_mimics_are_written(tmp_path):
    model = linkage("palletiser")[0]
    model = robot_of(model).locked({"lever": 0.0}).model
    robot = rne.Robot(without_followers_drives(model))
    assert robot.model.couplings == ()
    found = rne.identify(robot, log(robot), causes=False)
    (tmp_path / "found.urdf").write_text(found.to_urdf())
    again = rne.load(tmp_path / "found.urdf")
    np.testing.assert_array_equal(again.model.multiplier, robot.model.multiplier)


@pytest.mark.parametrize(
    ("joint", "factor"), kept([("forearm", 1.03), ("forearm", 0.95), ("cam", 0.9)], [("forearm", 1.03)])
)
def test_a_ratio_that_is_wrong_is_named(joint, factor):
    """Robots are given with a ratio of 1 / factor of the true one."""
    model = replace(geared(), armature=np.zeros(4))
    given = rne.Robot(with_ratio(model, joint, 1 / factor))
    record = log(rne.Robot(model), seconds=20.0)
    with pytest.warns(rne.IdentificationWarning, match=f"the ratio given for {joint}"):
        first = rne.identify(given, record, consistent=False).causes[0]
    assert (first.kind, first.joints) == ("coupling ratio", (joint,))
    assert abs(first.value - (factor - 1)) < 3 * first.error + (factor - 1) ** 2
    words = "small" if factor > 1 else "large"
    start = f"the ratio given for {joint}, which follows others, is {abs(100 * first.value):.3g} % too {words} ("
    assert first.text.startswith(start)


@pytest.mark.parametrize("joint", ["forearm", "cam"])
def test_a_ratio_turns_a_joint_farther_from_its_rest(joint):
    model, q = geared(), np.random.default_rng(0).normal(size=(5, 2))
    farther, i = with_ratio(model, joint, 1.2), model.moving_joints.index(joint)
    factors = np.where(np.arange(4) == i, 1.2, 1.0)
    expected = model.rest + factors * (joint_positions(model, q) - model.rest)
    np.testing.assert_allclose(joint_positions(farther, q), expected, rtol=SAME)
    np.testing.assert_allclose(coordinate_map(farther, q), factors[:, None] * coordinate_map(model, q), atol=SAME)


@pytest.mark.long
def test_columns_of_ratios_are_derivatives():
    """Of torques without noise, by the ratio of each joint but those of linkages."""
    model = replace(geared(), armature=np.zeros(4))
    robot = rne.Robot(model)
    found = rne.identify(robot, log(robot, noise=0.0), drives=rne.DriveModel(), **QUICK)
    rest = FitResiduals(robot, found.base, found.data, found.estimate.values, found.estimate.sigma)
    columns = {h.joints[0]: h.columns[..., 0] for h in coupling_ratios(rest)}
    assert list(columns) == ["forearm", "cam"]
    bodies, step = rest.bodies, 1e-3
    for joint, column in columns.items():
        ends = [rne.Robot(with_ratio(model, joint, 1 + h)).inverse_dynamics for h in (step, -step)]
        above, below = (rest.near_rows(partial(end, parameters=bodies)) for end in ends)
        np.testing.assert_allclose(column, (above - below) / (2 * step), atol=1e-4 * np.abs(column).max())
    bar = robot_of(without_followers_drives(linkage("bar")[0]))
    found = rne.identify(bar, log(bar), **QUICK)
    rest = FitResiduals(bar, found.base, found.data, found.estimate.values, found.estimate.sigma)
    assert list(coupling_ratios(rest)) == []


def test_positions_that_cannot_be_followed_are_no_cause():
    """Where much is left, joints are tried the other way and in degrees, also where a linkage has no position."""
    robot = robot_of(without_followers_drives(linkage("crane")[0]))
    record = log(robot)
    tau = record.tau + 0.3 * np.abs(record.tau).max() * np.sin(20 * record.q)
    with pytest.warns(rne.IdentificationWarning, match="piston"):
        found = rne.identify(robot, Record(record.t, record.q, tau), consistent=False)
    assert not {"joint sign", "degrees"}.intersection(cause.kind for cause in found.causes)


def test_what_cannot_be_served_names_the_joint():
    robot = robot_of(without_followers_drives(linkage("crane")[0]))
    record = log(robot)
    with pytest.raises(rne.errors.NotFiniteError, match=r"joint '(boom|barrel)' cannot follow 'piston' at "):
        rne.identify(robot, Record(record.t, 100 * record.q, record.tau))
    text = (
        "records must have the joints that 'bend' follows, they lack b: give positions and torques of a, b, or a robot in "
        "which 'bend' is driven itself"
    )
    wrist = robot_of(linkage("wrist")[0])
    motion = planted.truth(wrist, 0, seconds=2.0)
    with pytest.raises(ValueError, match=re.escape(text)):
        rne.identify(wrist, Record(motion.t, motion.q, motion.tau, joint_names=["forearm", "a", "bend"]))
    with pytest.raises(ValueError, match=re.escape("`link` must be given for robot 'linkage'")):
        rne.identify_payload(robot, record, log(robot, 1))


def test_drives_and_positions_of_joints_that_follow_are_told():
    model = linkage("press")[0]
    robot = robot_of(replace(model, armature=0.1 * np.ones(3)))
    record = log(robot)
    both = np.concatenate([record.q, np.sin(record.q)], axis=1), np.concatenate([record.tau, 0 * record.tau], axis=1)
    found = rne.identify(robot, Record(record.t, *both, joint_names=["crank", "rod"]), **QUICK)
    what = "are not fitted, as these follow others; the robot found has none there"
    assert f"rotors and friction at rod, slider {what}" in found.notes
    assert "rod of the records follows others: left out" in found.notes
    assert not any("move in the records" in note for note in found.notes)
    bare = rne.identify(robot, record, drives=rne.DriveModel(), **QUICK)
    assert not any("rotors and friction" in note for note in bare.notes)


@pytest.mark.parametrize("name", kept(ROBOTS, ["crane"]))
def test_models_are_compared_where_some_conventions_have_no_position(name):
    """A payload is named, although the joints' signs and zeros are tried too."""
    robot = robot_of(without_followers_drives(linkage(name)[0]))
    link = robot.link_names[-1]
    other = robot.with_payload(2.0, (0.1, 0.2, 0.1), link=link)
    motion = planted.truth(robot, 0, seconds=2.0)
    torques = other.inverse_dynamics(motion.q, motion.qd, motion.qdd)
    found = rne.compare_models(robot, (motion.q, motion.qd, motion.qdd, torques))
    assert "load" in str(found) or "parameters" in str(found)


def rooted():
    """Three joints of the IRB 140, of which the third follows the second beyond 0.2 rad alone, by a square root."""
    arm = rne.load("irb140").locked({"joint_4": 0, "joint_5": 0, "joint_6": 0})
    return rne.Robot(coupled(arm.model, {"joint_3": (("joint_2",), lambda x: 0.3 * np.sqrt(x - 0.2))}))


def test_a_joint_that_cannot_follow_at_zero_is_identified():
    """Neither the size of rotors nor the ratio of the joint that follows is looked for where it has no position."""
    robot = rooted()
    t, w = np.arange(0, 10, 0.02), 2 * np.pi * np.array([0.3, 0.4])
    wave, amplitude = np.outer(t, w), np.array([1.0, 0.4])
    q, qd, qdd = amplitude * np.sin(wave) + [0, 0.9], amplitude * w * np.cos(wave), -amplitude * w**2 * np.sin(wave)
    found = rne.identify(robot, Record(t, q, robot.inverse_dynamics(q, qd, qdd)), consistent=False)
    assert found.unexplained.in_motion.max() < 1e-3  # of the filter and differences


def test_models_are_compared_where_shifted_zeros_leave_the_range_of_a_joint_that_follows():
    robot = rooted()
    found = rne.compare_models(robot, lambda q, qd, qdd: robot.inverse_dynamics(0.9 * q + [0, 0.05], qd, qdd))
    assert found.cause == "unknown"


def test_base_parameters_of_a_driver_whose_range_is_beyond_half_a_turn():
    arm = rne.load("irb140").locked({"joint_4": 0, "joint_5": 0, "joint_6": 0}).model
    lower, upper = arm.lower.copy(), arm.upper.copy()
    lower[1], upper[1] = 3.5, 4.5
    far = coupled(replace(arm, lower=lower, upper=upper), {"joint_3": (("joint_2",), lambda x: 0.3 * np.sqrt(x - 3.3))})
    assert rne.Robot(far).base_parameters().count == rooted().base_parameters().count
