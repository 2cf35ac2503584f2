"""Where a chain ends: the default link of a payload, and the end of the last body."""

import re
from dataclasses import replace

import numpy as np
import pytest

import rne
from rne.__main__ import main
from rne.basics.spatial import rotation_about
from rne.model.topology import end_link, pinocchio_order, tip

from .conftest import TREES
from .helpers import Mimic, Part, assemble, loaded, pose, states
from .random_robots import straight_chain

Z = np.array([0.0, 0.0, 1.0])


def frame(link, parent, xyz=(0, 0, 0)):
    return Part(link=link, joint=f"to_{link}", parent=parent, placement=pose(np.eye(3), xyz))


def arm(*frames, parent=1, mimic=None):
    """Two joints, the second on part `parent`, each carrying 1 kg, and frames behind them."""
    moving = [
        Part(link=f"link{k}", joint=f"j{k}", kind="continuous", parent=p, axis=Z, mass=1.0, com=Z, mimic=m)
        for k, p, m in ((1, 0, None), (2, parent, mimic))
    ]
    return assemble("arm", [Part(link="root"), *moving, *frames])


def test_last_link_of_a_chain_carries_the_payload():
    model = straight_chain(3)
    assert end_link(model) == "rod2"
    assert rne.model.with_payload(model, 2.0) == rne.model.with_payload(model, 2.0, np.zeros(3), None, "rod2")


def test_fixed_frames_behind_the_last_joint_are_part_of_the_chain():
    model = arm(frame("flange", 2, [0, 0, 0.1]), frame("tool", 3, [0, 0, 0.2]))
    assert end_link(model) == "tool"
    np.testing.assert_allclose(tip(model), [0, 0, 0.3], rtol=1e-15)


def test_frames_on_other_bodies_are_not_its_end():
    model = arm(frame("tool", 2), frame("camera", 1), frame("pedestal", 0))
    assert model.link_names[-1] == "pedestal"
    assert end_link(model) == "tool"


@pytest.mark.parametrize(
    ("names", "first"), [(("ee_link", "tool0"), "tool0"), (("tool0", "ee_link"), "tool0"), (("a", "b"), "b")]
)
def test_of_frames_that_are_one_it_is_tool0_or_the_last_and_that_is_said(names, first, caplog):
    """Up to the rounding of a file."""
    model = arm(*(frame(name, 2, [0, 0, 0.1 + 1e-12 * k]) for k, name in enumerate(names)))
    other = next(name for name in names if name != first)
    assert end_link(model, axes_count=True) == first
    with caplog.at_level("INFO", "rne"):
        rne.model.with_payload(model, 1.0, [0, 0, 0.1])
    assert caplog.messages == [f"payload on link '{first}', which is at the same place as {other}"]
    with pytest.raises(ValueError, match=r"^ambiguous: near and far have different frames, choose one by `link`"):
        end_link(arm(frame("near", 2, [0, 0, 0.1]), frame("far", 2, [0, 0, 0.1 + 1e-6])))


def test_a_chain_without_a_frame_behind_its_last_joint_has_no_tip():
    model = straight_chain(2)
    assert tip(model) is None
    assert rne.dynamics.recursion(model, *states(2)).a_e.shape == (1, 3)


def test_end_of_the_last_body_moves_as_its_frame_does():
    """a_e's last row is the second derivative of the frame's position, by complex step from the Jacobian's."""
    model = arm(frame("tool", 2, [0.3, 0.1, 0.2]))
    q, qd, qdd = states(2, seed=3)
    J, J_rate = rne.dynamics.jacobian(model, q, "tool"), rne.dynamics.jacobian_rate(model, q, qd, "tool")
    a = (J @ qdd + J_rate @ qd)[3:]
    R = rne.dynamics.link_poses(model, q)[model.link_index("link2"), :3, :3]
    np.testing.assert_allclose(
        rne.dynamics.recursion(model, q, qd, qdd).a_e[1], R.T @ a, rtol=0, atol=1e-12 * np.abs(a).max()
    )


def test_a_frame_beside_the_first_axis_turns_about_it():
    """Position r, velocity z x r, and the derivative of that at 1 rad/s, -r."""
    model = arm(frame("tool", 1, [0.3, 0.0, 0.1]))
    z, still, turning = model.axis[0], np.zeros(2), np.array([1.0, 0.0])
    r = rne.dynamics.link_poses(model, still)[model.link_index("tool"), :3, 3]
    across = r - z * (r @ z)
    assert np.linalg.norm(across) > 0.1
    np.testing.assert_allclose(rne.dynamics.jacobian(model, still, "tool")[3:, 0], np.cross(z, r), atol=1e-15)
    np.testing.assert_allclose(rne.dynamics.jacobian_rate(model, still, turning, "tool")[3:, 0], -across, atol=1e-15)


@pytest.mark.parametrize(
    ("model", "reason", "leaves"),
    [
        (arm(parent=0), "its moving joints branch", ["link1", "link2"]),
        (arm(frame("tool", 1), parent=0), "its moving joints branch", ["link2", "tool"]),
        (arm(mimic=Mimic(1, 2.0, 0.0)), "its joint 'j2' mimics another", ["link2"]),
    ],
)
def test_where_a_payload_belongs_is_not_guessed(model, reason, leaves):
    text = f"`link` must be given for robot 'arm': {reason}; its leaf links are {leaves}, others are in `link_names`"
    robot = rne.Robot(model)
    calls = (
        lambda: rne.model.with_payload(model, 1.0),
        lambda: robot.with_payload(1.0),
        lambda: rne.Scene(robot, payload=1),
    )
    for call in calls:
        with pytest.raises(ValueError, match="^" + re.escape(text) + "$"):
            call()
    loaded = rne.Scene(robot, payload=rne.Payload(1.0, link=leaves[-1])).resolved.robot
    assert loaded.model == rne.model.with_payload(model, 1.0, link=leaves[-1])


def test_frames_at_several_points_are_named_to_choose_from():
    model = arm(*(frame(name, 2, [0, k, 0]) for k, name in enumerate(("tool0", "left", "right"))), frame("base", 0))
    text = (
        "ambiguous: tool0, left and right have different frames, choose one by `link`: the last body of robot 'arm' "
        "ends at several points"
    )
    for call in (lambda: rne.Robot(model).with_payload(1.0), lambda: rne.Scene(rne.Robot(model), payload=1)):
        with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
            call()


def test_the_command_line_says_where_a_payload_is_and_how_to_choose(tmp_path, capsys):
    """Frames of one point and different axes: the same for a point mass, and not for a centre of mass."""
    turned = Part(link="tool0", joint="to_tool0", parent=2, placement=pose(rotation_about(Z, np.array(0.5)), [0, 0, 1]))
    files = [tmp_path / name for name in ("arm.urdf", "motion.csv")]
    files[0].write_text(rne.to_urdf(arm(frame("ee_link", 2, [0, 0, 1]), turned)))
    files[1].write_text("t,q.j1,q.j2,qd.j1,qd.j2,qdd.j1,qdd.j2\n0,0,0,0,0,0,0\n")
    words = ["torques", *map(str, files), "--payload", "2"]
    assert main(words) == 0
    said = "payload 2 kg at the origin of link tool0 (the same as of ee_link)"
    assert capsys.readouterr().err.splitlines()[0].endswith(said)
    assert main([*words, "--payload-com", "0 0 0.1"]) == 2
    assert capsys.readouterr().err == (
        "error: ambiguous: ee_link and tool0 have different frames, choose one by --payload-link: the last body of "
        "robot 'arm' ends in links with different axes, in which --payload-com and --payload-inertia are given\n"
    )
    assert main([*words, "--payload-com", "0 0 0.1", "--payload-link", "tool0"]) == 0


def test_the_pandas_payload_is_refused_without_a_link():
    text = (
        "`link` must be given for robot 'panda': its moving joints branch; "
        "its leaf links are ['panda_hand_tcp', 'panda_leftfinger', 'panda_rightfinger'], others are in `link_names`"
    )
    panda = loaded("panda_description/panda")
    with pytest.raises(ValueError, match="^" + re.escape(text) + "$"):
        panda.with_payload(3.0)
    assert panda.with_payload(3.0, link="panda_hand_tcp").model.mass.sum() > panda.model.mass.sum()


@pytest.mark.parametrize(
    ("name", "link"), [("ur_description/ur5_robot", "tool0"), ("xarm_description/xarm7", "link_eef")]
)
def test_arms_of_makers_carry_it_at_their_tool_frame(name, link):
    assert end_link(loaded(name).model) == link


def test_a_hand_of_fixed_fingers_has_no_single_end():
    with pytest.raises(ValueError, match="have different frames, choose one by `link`"):
        loaded("kinova_description/kinova").with_payload(1.0)


def test_locking_joints_one_by_one_or_together_keeps_the_end(irb140):
    together = irb140.locked({"joint_5": 0.3, "joint_6": 0.2})
    one_by_one = irb140.locked({"joint_5": 0.3}).locked({"joint_6": 0.2})
    assert end_link(together.model) == end_link(one_by_one.model) == "tool0"
    assert together.model.link_parent == one_by_one.model.link_parent == irb140.model.link_parent
    q = states(4)[0]
    moved = irb140.link_poses(np.r_[q, 0.3, 0.2])
    np.testing.assert_allclose(together.link_poses(q)[-1], moved[-1], atol=1e-15)
    R = moved[4, :3, :3]
    np.testing.assert_allclose(tip(together.model), R.T @ (moved[-1] - moved[4])[:3, 3], atol=1e-15)


def test_a_model_that_does_not_know_its_links_parents_has_the_same_end(irb140):
    unknown = replace(irb140.model, link_parent=None)
    assert unknown.link_parent == irb140.model.link_parent
    assert end_link(unknown) == "tool0"


def test_a_robot_without_moving_joints_carries_it_at_its_last_frame():
    block = assemble("block", [Part(link="base", mass=1.0), frame("top", 0, [0, 0, 1])])
    assert end_link(block) == "top"
    assert tip(block) is None
    assert rne.model.with_payload(block, 1.0).base_com.tolist() == [0, 0, 0.5]


def test_branched_robots_have_no_tip():
    assert tip(TREES["bushy"]) is None


def test_axes_count_where_something_is_seen_in_them(ur5):
    """Links tool0 and ee_link of the UR5 have one origin and different axes."""
    expected = (
        "ambiguous: ee_link and tool0 have different frames, choose one by `link`: the last body of robot 'ur5' ends "
        "in links with different axes, in which `com` and `inertia` are given"
    )
    for more in ({"com": [0, 0, 0.1]}, {"inertia": np.eye(3)}):
        with pytest.raises(ValueError, match=f"^{re.escape(expected)}$"):
            ur5.with_payload(3.0, **more)
    assert (
        ur5.with_payload(3.0).model
        == ur5.with_payload(3.0, link="tool0").model
        == ur5.with_payload(3.0, link="ee_link").model
    )


def test_pinocchio_numbers_joints_depth_first_and_siblings_by_name():
    names = [("c", 0), ("a", 0), ("z", 1), ("b", 1), ("fixed", 2), ("d", 5)]
    parts = [Part(link="base")]
    for k, (name, parent) in enumerate(names, 1):
        kind = "fixed" if name == "fixed" else "revolute"
        parts.append(Part(link=f"l{k}", joint=name, kind=kind, parent=parent, mass=1.0))
    model = assemble("tree", parts)
    order = pinocchio_order(model)
    assert [model.joint_names[k] for k in order] == ["a", "d", "c", "b", "z"]
