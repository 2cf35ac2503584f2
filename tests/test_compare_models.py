"""The likely cause of a difference of torques: faults are planted, and named."""

import collections
import re
from dataclasses import replace

import numpy as np
import pytest

import rne
from rne.identification import Hypothesis, thresholds
from rne.identification.diagnosis.conventions import conventions

from .faulty_logs import robots
from .helpers import first_joints, loaded
from .planted_faults import planted, planted_pair

CAUSES = tuple(planted(loaded("panda")))
SCARA = robots()["SCARA"]
OF_SCARA = planted(SCARA)
HIDDEN = ("joint zero/of one joint", "products of inertia")  # a zero of the slider, bodies that turn about one axis
MEASURED = "for measured motions use `rne.identify(robot, record)`, whose report names likely causes"


@pytest.mark.parametrize("label", [label for label in OF_SCARA if label not in HIDDEN])
def test_planted_fault_is_named(label):
    found = rne.compare_models(SCARA, OF_SCARA[label])
    assert found.cause == label.split("/")[0], found.report()
    assert (found.unexplained <= found.accuracy).all()


@pytest.mark.long
@pytest.mark.parametrize("label", CAUSES)
@pytest.mark.parametrize(("name", "seed"), [("irb140", 1), ("irb140", 2), ("ur5", 1), ("ur5", 2), ("panda", 1)])
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
    """On a wrist that turns about three axes all coordinates of its centre are seen."""
    robot = loaded("ur5").locked({"shoulder_pan_joint": 0.0, "elbow_joint": 0.5, "wrist_3_joint": 0.0})
    found = rne.compare_models(robot, robot.with_payload(2.5, com=(0.02, -0.03, 0.1), link="wrist_3_link"))
    assert found.text.startswith("it carries a payload of 2.5 kg at (0.02, -0.03, 0.1946) m"), found.text


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (3, "`other` must be an rne.Robot, a function of (q, qd, qdd) or arrays (q, qd, qdd, tau), got int; " + MEASURED),
        (rne.identification.Record([0, 1], np.zeros((2, 6)), np.zeros((2, 6))),
         "`other` must be an rne.Robot, a function of (q, qd, qdd) or arrays (q, qd, qdd, tau), got Record; " + MEASURED),
        (loaded("panda"), "`other` must have 6 joints, as the robot, got 8"),
        (lambda q, qd, qdd: q[:, :5], "`other` must return torques of shape (120, 6), got (120, 5)"),
        (lambda q, qd, qdd: np.nan * q, "`other`: the torques must be finite"),
        ([np.zeros((5, 6))] * 3 + [np.zeros((4, 6))],
         "`other` must be four arrays of shape (N, 6), got [(5, 6), (5, 6), (5, 6), (4, 6)]"),
        ([np.zeros((0, 6))] * 4, "`other` must have at least 14 states for 6 joints, got 0"),
        ([np.ones((1, 6))] * 4, "`other` must have at least 14 states for 6 joints, got 1"),
    ],
    ids=["number", "record", "other joints", "shape", "not finite", "lengths", "no state", "one state"],
)  # fmt: skip
def test_wrong_argument_is_refused(other, message):
    with pytest.raises((TypeError, ValueError), match=f"^{re.escape(message)}$"):
        rne.compare_models(loaded("irb140"), other)


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


def test_a_range_with_crossed_ends_is_searched_all_the_same():
    model = loaded("ur5").model
    crossed = rne.Robot(replace(model, lower=model.upper, upper=model.lower))
    assert rne.compare_models(crossed, loaded("ur5")).cause == "none"


def test_two_faults_are_both_named_or_none_is():
    model = SCARA.model
    other = rne.Robot(replace(model, gravity=-model.gravity, armature=[0.1, 0.2, 0.3, 0], notes={}))
    assert set(rne.compare_models(SCARA, other).causes) == {"gravity sign", "armature"}


def test_a_change_of_bodies_that_turn_alike_is_told_in_its_direction():
    """The slider of a SCARA turns as the link before it, so that torques do not determine a number of each."""
    found = rne.compare_models(SCARA, OF_SCARA["inertia point"])
    assert found.text == "the inertia about the joint is taken as one about the centre of mass, all bodies"


def test_the_nearest_convention_is_told_where_none_explains_the_difference():
    """An axis is flipped, and a small torque acts that is none of the hypotheses."""
    sign = np.array([1, 1, 1, -1])

    def torques(q, qd, qdd):
        return sign * SCARA.inverse_dynamics(sign * q, sign * qd, sign * qdd) + 0.01 * np.sin(q)

    found = rne.compare_models(SCARA, torques)
    assert found.cause == "unknown"
    first = next(causes for causes in found.candidates if len(causes) == 1)
    assert first[0].text == "the axis of d points the other way"


def test_products_of_inertia_with_the_other_sign_are_among_the_hypotheses(irb140):
    """Of bodies that have all three, about their centres of mass."""
    I = irb140.model.inertia * np.eye(3)
    products = 0.1 * np.linalg.eigvalsh(I)[:, 0, None, None] * (1 - np.eye(3))
    own, other = (rne.Robot(replace(irb140.model, inertia=I + x)) for x in (products, -products))
    found = rne.compare_models(own, other)
    assert found.text == "products of inertia about the centre of mass have the opposite sign, all bodies"
    assert (found.unexplained <= found.accuracy).all()


def test_conventions_are_tried_up_to_a_number_the_fewest_changes_first(irb140, monkeypatch):
    monkeypatch.setattr(thresholds, "CONVENTIONS", 50)
    counts = collections.Counter(x.kind for x in conventions(irb140))
    flipped = 6 + 15 + 20  # axes of at most three joints; of four it would be 15 more
    shifted = 3 * 6  # of two joints at once it would be 9 * 15 more
    orders, signs = ("joint order", "torque order"), ("axis flipped", "torque sign")
    expected = dict.fromkeys(orders, 15) | dict.fromkeys(signs, flipped)
    assert counts == expected | {"joint zero": shifted, "angle unit": 4}


def test_other_explanations_and_the_share_that_each_leaves_are_told():
    """A SCARA has no torque of gravity but its slider's, so that its axis may be flipped as well."""
    found = rne.compare_models(SCARA, OF_SCARA["gravity sign"])
    assert found.causes == ("gravity sign",)
    assert found.equivalent == ("axis flipped",)
    assert "\nindistinguishable from: axis flipped\n" in found.report()
    alike = [causes[0].kind for share, causes in zip(found.shares, found.candidates, strict=True) if share < 1e-9]
    assert alike[:2] == ["gravity sign", "axis flipped"]


@pytest.mark.parametrize(("kind", "law"), [("viscous friction", np.positive), ("Coulomb friction", np.sign)])
def test_friction_of_one_kind_is_not_told_apart_from_friction_of_both(kind, law):
    """Which explains it too, is listed among the hypotheses below their heading, and is no other explanation."""
    arm = first_joints(1)
    found = rne.compare_models(arm, lambda q, qd, qdd: arm.inverse_dynamics(q, qd, qdd) + 2.0 * law(qd))
    assert found.causes == (kind,)
    assert found.equivalent == ()
    assert [causes[0].kind for causes in found.candidates[:2]] == [kind, "friction"]
    lines = found.report().splitlines()
    below = lines.index("hypotheses (unexplained share of the difference [%]; free numbers)") + 1
    assert lines[below].endswith(f"; 1: {kind}: it has more {kind}: joint_1 2")
    assert "; 1: friction: " in lines[below + 1]
    assert not any("indistinguishable" in line for line in lines)


def test_of_two_different_robots_the_report_says_so_first_and_lists_no_hypotheses():
    arm = first_joints(2).model
    tilted = np.array([[0, 0.6, 0.8], [0.8, 0, 0.6]])
    other = replace(arm, axis=tilted, translation=0.3 + arm.translation, com=0.2 + arm.com, notes={})
    lines = rne.compare_models(rne.Robot(arm), rne.Robot(other)).report().splitlines()
    assert lines[0] == "different robots: 0 of 2 joints have the same name, axis and place"
    assert lines[1:3] == ["cause: unknown", "  no hypothesis explains the difference"]
    assert not any(line.startswith("hypotheses") for line in lines)


def test_of_a_joint_in_another_place_the_text_names_the_joint():
    arm = first_joints(3).model
    found = rne.compare_models(
        rne.Robot(arm), rne.Robot(replace(arm, translation=arm.translation + np.eye(3)[0] * [[0], [0], [0.01]]))
    )
    assert found.causes == ("unknown",)
    assert found.text.startswith("no hypothesis explains the difference; joint_3 has another axis or place")


def test_a_zero_that_no_torque_feels_is_not_told():
    """The last body of an IRB 140 turns alike about its own axis, but for rounding."""
    arm = loaded("irb140").locked({f"joint_{k}": 0.3 for k in (1, 2, 3)})
    shift = np.array([0.03, 0.02, 0.4])
    found = rne.compare_models(arm, lambda q, qd, qdd: arm.inverse_dynamics(q + shift, qd, qdd))
    assert found.text == "zero positions differ: its zero is at joint_4 = 0.03, joint_5 = 0.02 [rad or m] of this robot"


def cables(arm):
    """A torque sin(3 q) at each joint, as a family."""

    def text(c, j, m):
        return f"a cable of {c[0]:.3g} N m pulls {arm.joint_names[j]}"

    columns = lambda q, qd, qdd: np.sin(3 * q)[..., None] * np.eye(arm.n)  # noqa: E731
    return Hypothesis("cable", columns, text, arm.joint_names, numbers="each")


@pytest.mark.parametrize("gravity", [0.0, 0.1])
def test_a_family_of_joints_is_tried_joint_by_joint(irb140, gravity):
    """Alone, and together with another change."""

    def other(q, qd, qdd):
        pulled = 3 * np.sin(3 * q) * np.eye(6)[3]
        return irb140.inverse_dynamics(q, qd, qdd) + pulled + gravity * irb140.gravity_torque(q)

    found = rne.compare_models(irb140, other, hypotheses=[cables(irb140)])
    assert found.cause == ("gravity magnitude and cable" if gravity else "cable")
    assert "a cable of 3 N m pulls joint_4" in found.text


def test_a_hypothesis_of_some_of_the_states_stands_beside_another(irb140):
    rng = np.random.default_rng(0)
    q, qd, qdd = rng.uniform(-1, 1, (200, 6)), rng.normal(size=(200, 6)), rng.normal(size=(200, 6))
    late, pulled = np.arange(200) >= 100, np.sin(3 * q) * np.eye(6)[3]
    tau = irb140.inverse_dynamics(q, qd, qdd) + 3 * pulled * late[:, None] + 0.1 * irb140.gravity_torque(q)
    cable = Hypothesis("cable", pulled[..., None], lambda c, j, m: f"{c[0]:.3g}", masks=late[None])
    found = rne.compare_models(irb140, (q, qd, qdd, tau), hypotheses=[cable])
    assert found.cause == "gravity magnitude and cable"


def test_a_family_has_as_many_columns_for_each_joint(irb140):
    for joints in ((), irb140.joint_names[:4]):
        family = replace(cables(irb140), joints=joints)
        with pytest.raises(ValueError, match=f"got 6 columns for {len(joints)} joints"):
            rne.compare_models(irb140, lambda *x: 2 * irb140.inverse_dynamics(*x), hypotheses=[family])


def test_joints_without_limits_are_compared_over_a_turn_and_sliders_over_0_6_m():
    arm = rne.Robot(rne.dh_chain(a=[0, 0], alpha=[0, 0], d=[0, 0], theta=[0, 0], types=["revolute", "prismatic"]))
    q, _, _ = states_compared(arm)
    reach = np.array([np.pi, 0.3])
    assert (np.abs(q) <= reach).all()
    assert (np.abs(q).max(axis=0) > 0.9 * reach).all()


def states_compared(robot):
    """States at which torques are compared: q, qd and qdd."""
    states = []

    def torques(*motion):
        states.extend(motion)
        return robot.inverse_dynamics(*motion)

    rne.compare_models(robot, torques)
    return states


def test_torques_are_compared_at_states_of_these_rates_and_accelerations(irb140):
    """Deviations within three standard errors of those of so many normal numbers."""
    _, qd, qdd = states_compared(irb140)
    error = 3 / np.sqrt(2 * qd.size)
    assert qd.std() == pytest.approx(1.5, rel=error)
    assert qdd.std() == pytest.approx(5.0, rel=error)
