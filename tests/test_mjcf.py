"""MJCF files: the robot read has MuJoCo's own M, bias, gravity and accelerations; what is not read is named."""

import io
import re
import sys

import numpy as np
import pytest

import rne
from rne.__main__ import main
from rne.plotting.shapes import link_shapes

mujoco = pytest.importorskip("mujoco")

EPS = np.finfo(float).eps
TOLERANCE = 1e-12  # of M, bias and gravity, relative to their largest entry: two programs, some hundred roundings each
C = 100  # of c kappa eps for accelerations, which have the roundings of M times its condition
BODY = '<inertial pos="0.1 0.02 -0.03" mass="{}" fullinertia="0.02 0.03 0.04 0.001 -0.002 0.003"/>'
ARMS = {
    "ref": f"""<compiler angle="radian"/><worldbody><body name="a" pos="0 0 1" quat="0.8 0 0.6 0">
        <joint name="j" axis="0 0 1" ref="0.7"/>{BODY.format(3)}<body name="b" pos="0.4 0 0.1" euler="0.3 0.2 0.1">
        <joint name="k" axis="1 2 2" ref="-1.2" range="-3 1"/>{BODY.format(2)}</body></body></worldbody>""",
    "several joints on a body": f"""<worldbody><body name="a"><joint name="x" type="slide" axis="1 0 0" ref="0.2"/>
        <joint name="y" type="slide" axis="0 1 0"/><joint name="t" axis="0 0 1" ref="30"/>{BODY.format(5)}
        <body name="b" pos="0.5 0 0"><joint name="u" axis="0 1 0"/><joint name="v" axis="1 0 0"/>{BODY.format(2)}</body>
        </body></worldbody>""",
    "slides": f"""<worldbody><body name="a" euler="10 20 30"><joint type="slide" name="j" axis="1 1 0" ref="0.3"
        range="-1 2"/>{BODY.format(4)}<body name="b" pos="0 0 0.5"><joint name="k" type="slide" axis="0 0 -1"/>
        {BODY.format(2)}<body name="c"><joint name="l" axis="0 1 0"/>{BODY.format(1)}</body></body></body></worldbody>""",
    "joint pos off the origin": f"""<worldbody><body name="a" pos="1 0 0"><joint name="j" axis="0 0 1" pos="0.1 0.2 0.7"
        ref="25"/>{BODY.format(3)}<body name="b" pos="0.3 0 0"><joint name="k" axis="0 1 0" pos="0 0.5 0"/>
        <joint name="l" axis="1 0 0" pos="-0.1 0 0.2" ref="-40"/>{BODY.format(2)}</body></body></worldbody>""",
    "springs and friction": f"""<worldbody><body name="a"><joint name="j" axis="0 1 0" stiffness="20" springref="15"
        damping="0.4" frictionloss="0.3"/>{BODY.format(3)}</body></worldbody>""",
    "equality": f"""<worldbody><body name="a"><joint name="j" axis="0 1 0" ref="20" armature="0.2"/>{BODY.format(3)}
        <body name="b" pos="0.4 0 0"><joint name="k" axis="0 1 0" ref="-10" armature="0.1"/>{BODY.format(2)}
        <body name="c" pos="0.4 0 0"><joint name="l" axis="0 0 1"/>{BODY.format(1)}</body></body></body>
        <body name="d" pos="0 1 0"><joint name="s" type="slide" axis="0 0 1" ref="0.1"/>{BODY.format(1)}</body>
        </worldbody><equality><joint joint1="l" joint2="k" polycoef="0.1 -2 0 0 0"/>
        <joint joint1="k" joint2="j" polycoef="0 0.5 0 0 0"/><joint joint1="s" joint2="j" polycoef="0 0.3 0 0 0"/>
        </equality>""",
    "armature": f"""<worldbody><body name="a"><joint name="j" axis="0 1 0" armature="0.7"/>{BODY.format(3)}
        <body name="b" pos="0.1 0 0"><joint name="k" type="slide" axis="0 1 0" armature="2"/>{BODY.format(2)}</body>
        </body></worldbody><actuator><motor joint="j" gear="-50" ctrlrange="-2 2"/>
        <position joint="k" kp="100" forcerange="-30 30"/></actuator>""",
    "nested frames": f"""<compiler eulerseq="ZYX"/><option gravity="1 -2 -3"/><worldbody><frame pos="0.1 0 0"
        euler="40 50 60"><frame axisangle="0 1 0 30"><body name="a" xyaxes="0 1 0 -1 0 0.5"><frame pos="0 0 0.3">
        <joint name="j" axis="0 1 0"/></frame>{BODY.format(3)}<body name="b" pos="0 0 1" zaxis="1 0 1">
        <joint name="k" axis="0 0 1"/>{BODY.format(2)}</body></body></frame></frame></worldbody>""",
    "inertia from geoms": """<compiler inertiafromgeom="true" angle="radian"/><default><geom density="700"/>
        <default class="heavy"><geom density="7800"/><joint armature="0.01" axis="1 0 0"/></default></default>
        <worldbody><geom type="plane" size="1 1 1"/><body name="a" pos="0 0 0.2"><joint name="j" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 0.3 0.1 0.2" size="0.05"/><body name="b" pos="0.3 0.1 0.2"
        childclass="heavy"><joint name="k"/><geom type="cylinder" fromto="0 0 0 0 0 0.3" size="0.02"/>
        <geom class="main" type="ellipsoid" size="0.1 0.05 0.07" pos="0 0.1 0.3"/><geom type="mesh" mesh="wedge"/>
        </body></body></worldbody><asset><mesh name="wedge" vertex="0 0 0 0.1 0 0 0 0.1 0 0 0 0.2"/></asset>""",
    "static bodies": f"""<worldbody><body name="stand" pos="0 0 0.5">{BODY.format(9)}
        <body name="a" pos="0 0 0.5"><joint name="j" axis="0 1 0"/>{BODY.format(3)}<body name="tool" pos="0.3 0 0"
        euler="0 90 0">{BODY.format(0.7)}<site name="tip"/><body><joint axis="1 0 0"/>{BODY.format(0.2)}</body></body>
        </body></body></worldbody>""",
}
FUSED = '<compiler fusestatic="true"/>'  # which MuJoCo 3.3 does to nine digits
LOOSE = (
    "dof_damping",
    "dof_dampingpoly",
    "jnt_stiffness",
    "jnt_stiffnesspoly",
    "actuator_damping",
)  # passive, added by scenes


def written(folder, text, name="arm.xml"):
    file = folder / name
    file.parent.mkdir(exist_ok=True)
    file.write_text(text if text.startswith("<?") else f"<mujoco>{text}</mujoco>")
    return file


def own_dynamics(m, q, qd, tau):
    """MuJoCo's M, bias and accelerations, without constraints and drives, at the positions of all its joints."""
    d = mujoco.MjData(m)
    d.qpos[:], d.qvel[:], d.qfrc_applied[:] = q, qd, tau
    mujoco.mj_forward(m, d)
    M = np.zeros((m.nv, m.nv))
    for column, unit in zip(M, np.eye(m.nv), strict=True):  # mj_fullM has other arguments from version 4 on
        mujoco.mj_mulM(m, d, column, unit)
    return M, d.qfrc_bias.copy(), d.qacc.copy(), d.xpos.copy(), d.xmat.reshape(-1, 3, 3).copy()


def relative(value, expected):
    return np.abs(value - expected).max() / max(np.abs(expected).max(), 1e-3)


def compare(file, states):
    robot, m = rne.load(file), mujoco.MjModel.from_xml_path(str(file))
    for bit in ("CONSTRAINT", "ACTUATION"):
        m.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{bit}"))
    for name in (x for x in LOOSE if hasattr(m, x)):
        getattr(m, name)[:] = 0
    G, offset = robot.model.coordinate_map, robot.model.offset
    assert list(robot.model.moving_joints) == [m.joint(j).name or f"joint_{j}" for j in range(m.njnt)]
    for q, qd, tau in np.random.default_rng(1).uniform(-2, 2, (states, 3, robot.n)):
        M, bias, qdd, p, R = own_dynamics(m, G @ q + offset, G @ qd, np.zeros(m.nv) if robot.model.has_mimics else tau)
        M, bias = G.T @ M @ G, G.T @ bias
        if robot.model.has_mimics:
            qdd = np.linalg.solve(M, tau - bias)
        gravity = G.T @ own_dynamics(m, G @ q + offset, 0, 0)[1]
        assert relative(robot.mass_matrix(q), M) < TOLERANCE
        assert relative(robot.bias_torque(q, qd), bias) < TOLERANCE
        assert relative(robot.gravity_torque(q), gravity) < TOLERANCE
        assert relative(robot.forward_dynamics(q, qd, tau), qdd) < max(C * np.linalg.cond(M) * EPS, TOLERANCE)
        poses = robot.link_poses(q)
        for b in (b for b in range(m.nbody) if m.body(b).name):
            pose = poses[robot.model.link_index(m.body(b).name)]
            assert np.abs(pose[:3, 3] - p[b]).max() < TOLERANCE
            assert np.abs(pose[:3, :3] - R[b]).max() < TOLERANCE


@pytest.mark.parametrize("name", ARMS)
def test_dynamics_are_those_of_mujoco(name, tmp_path):
    compare(written(tmp_path, ARMS[name]), 3)


@pytest.mark.long
@pytest.mark.parametrize("name", ARMS)
def test_dynamics_are_those_of_mujoco_in_200_states(name, tmp_path):
    compare(written(tmp_path, ARMS[name]), 200)


INERTIAL = '<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>'
ARM = f'<worldbody><body name="a"><joint name="j" axis="0 1 0"/>{INERTIAL}</body></worldbody>'


def one_joint(joint, rest=""):
    return f'<compiler angle="radian"/><worldbody><body name="a"><joint name="j" {joint}/>{INERTIAL}</body></worldbody>{rest}'


def test_limits_and_losses_are_those_of_the_joints(tmp_path):
    text = one_joint(
        'range="-1 2" damping="0.4" frictionloss="0.3" armature="0.1"',
        '<actuator><motor joint="j" ctrlrange="-5 5" gear="-4"/></actuator>',
    )
    model = rne.load(written(tmp_path, text)).model
    assert model.joint_types == ("revolute",)
    assert [model.lower[0], model.upper[0], model.effort_limit[0]] == [-1, 2, 20]
    assert [model.damping[0], model.friction[0], model.armature[0]] == [0.4, 0.3, 0.1]
    assert model.velocity_limit[0] == np.inf
    free = rne.load(written(tmp_path, one_joint(""))).model
    assert free.joint_types == ("continuous",)
    assert [free.lower[0], free.upper[0], free.effort_limit[0]] == [-np.inf, np.inf, np.inf]


DRIVES = {
    "force of the joint's drives": ('actuatorfrcrange="-7 7"', '<motor joint="j" ctrlrange="-50 50"/>', 7),
    "force": ("", '<position joint="j" kp="9" gear="3" forcerange="-5 5" ctrlrange="-1 1"/>', 15),
    "gain": ("", '<general joint="j" gainprm="3" ctrlrange="-2 2"/>', 6),
    "servo without a limit of force": ("", '<position joint="j" kp="9" ctrlrange="-1 1"/>', np.inf),
    "two drives and a limit of both": (
        'actuatorfrcrange="-7 7"',
        '<motor joint="j" ctrlrange="-5 5"/><motor joint="j" ctrlrange="-5 5"/>',
        7,
    ),
    "one side": ("", '<motor joint="j" ctrlrange="0 2"/>', np.inf),
    "two drives": ("", '<motor joint="j" ctrlrange="-2 2"/><motor joint="j" ctrlrange="-2 2"/>', np.inf),
}


@pytest.mark.parametrize("name", DRIVES)
def test_effort_is_read_where_it_is_one_number(name, tmp_path, capsys):
    joint, drives, effort = DRIVES[name]
    file = written(tmp_path, one_joint(joint, f"<actuator>{drives}</actuator>"))
    assert rne.load(file).effort_limit.tolist() == [effort]
    rne.check(file)
    told = "limits of its drives" in capsys.readouterr().out
    assert told == (name in ("one side", "two drives"))


@pytest.mark.skipif(int(mujoco.__version__[0]) < 4, reason="older versions have no armature of actuators")
def test_armature_and_damping_of_actuators_go_through_the_gear(tmp_path):
    rest = '<actuator><general joint="j" gear="10" armature="0.5" damping="0.3"/></actuator>'
    file = written(tmp_path, one_joint('armature="0.1" damping="2"', rest))
    compare(file, 2)
    model = rne.load(file).model
    assert [model.armature[0], model.damping[0]] == [50.1, 32]


def test_gravity_is_the_files_unless_it_is_given(tmp_path):
    file = written(tmp_path, '<option gravity="0 0 -1.62"/>' + ARM)
    assert rne.load(file).model.gravity.tolist() == [0, 0, -1.62]
    assert rne.load(file, gravity=[0, 0, -9.81]).model.gravity.tolist() == [0, 0, -9.81]
    off = written(tmp_path, '<option><flag gravity="disable"/></option>' + ARM)
    assert rne.load(off).model.gravity.tolist() == [0, 0, 0]
    assert rne.load("robots/irb140.urdf").model.gravity.tolist() == [0, 0, -9.81]


def test_links_have_the_frames_of_the_bodies_and_joints_the_order_of_qpos(tmp_path):
    robot = rne.load(written(tmp_path, ARMS["joint pos off the origin"]))
    assert robot.joint_names == ("j", "k", "l")
    assert robot.link_names == ("world", "a/j", "a", "b/k", "b/l", "b")
    assert rne.load(written(tmp_path, one_joint('axis="0 1 0" pos="0 3 0"'))).link_names == ("world", "a")
    assert rne.load(written(tmp_path, FUSED + ARMS["static bodies"])).link_names == (
        "world",
        "stand",
        "a",
        "tool",
        "body_4",
    )


def test_urdf_of_a_robot_read_from_mjcf_is_the_same_robot(tmp_path):
    for name in ("joint pos off the origin", "equality"):
        robot = rne.load(written(tmp_path, ARMS[name]))
        again = rne.load(
            written(tmp_path, '<?xml version="1.0"?>' + rne.to_urdf(robot.model).partition("?>")[2], "a.urdf")
        )
        assert again.model.armature.tolist() == robot.model.armature.tolist()
        q = np.full(robot.n, 0.3)
        assert relative(again.mass_matrix(q), robot.mass_matrix(q)) < TOLERANCE


def test_equalities_other_than_straight_lines_are_left(tmp_path, capsys):
    text = ARMS["equality"].replace("0.3 0 0 0", "0.3 0.1 0 0").replace('joint2="k"', 'active="false" joint2="k"')
    file = written(tmp_path, text)
    assert rne.load(file).joint_names == ("j", "l", "s")
    rne.check(file)
    expected = "joints 'l', 's': an <equality> that is no active straight line of one other joint is not read; the joint moves freely"
    assert expected in capsys.readouterr().out


def test_what_the_options_switch_off_does_not_act(tmp_path):
    """Equalities, friction, damping and springs, as MuJoCo's flags have them."""
    flags = '<option><flag equality="disable" frictionloss="disable" spring="disable" damper="disable"/></option>'
    joints = '<joint name="j" axis="0 1 0" stiffness="3" damping="2" frictionloss="1"/>'
    text = f'<worldbody><body name="a">{joints}{INERTIAL}<body name="b"><joint name="k"/>{INERTIAL}</body></body></worldbody>'
    text += '<equality><joint joint1="k" joint2="j"/></equality>'
    robot, said = rne.load(written(tmp_path, flags + text)), io.StringIO()
    assert robot.joint_names == ("j", "k")
    assert not robot.model.damping.any()
    assert not robot.model.friction.any()
    rne.check(tmp_path / "arm.xml", out=said)
    assert "spring" not in said.getvalue()
    assert rne.load(written(tmp_path, text)).joint_names == ("j",)


def test_names_that_are_made_are_none_of_the_files(tmp_path):
    two = '<joint name="x" axis="0 0 1" pos="1 0 0"/><joint axis="0 1 0"/>'
    text = f'<body name="a">{two}{INERTIAL}<body>{INERTIAL}<body name="body_2">{INERTIAL}</body><body name="a/x"/></body></body>'
    robot = rne.load(written(tmp_path, f"<worldbody>{text}</worldbody>"))
    assert robot.link_names == ("world", "a/x_", "a", "body_2_", "body_2", "a/x")


def test_springs_that_check_names_have_the_torques_of_mujoco(tmp_path):
    """At a hinge and a slide with `ref`, each by the line of Python that the finding gives."""
    joints = '<joint name="j" axis="0 1 0" ref="20" stiffness="30" springref="-10"/>'
    joints += '<joint name="s" type="slide" axis="1 0 0" ref="0.2" stiffness="500" springref="0.3"/>'
    file = written(tmp_path, f'<worldbody><body name="a">{joints}{INERTIAL}</body></worldbody>')
    lines = [re.search(r"add (rne\.Spring.*) to a scene", x.cure) for x in rne.check(file, out=io.StringIO())]
    springs = [eval(line[1]) for line in lines if line]
    assert len(springs) == 2
    robot, m = rne.load(file), mujoco.MjModel.from_xml_path(str(file))
    d, q, zero = mujoco.MjData(m), np.array([0.4, -0.3]), np.zeros(2)
    d.qpos[:] = q
    mujoco.mj_forward(m, d)
    held = rne.Scene(robot, springs=springs).inverse_dynamics(q, zero, zero) - robot.gravity_torque(q)
    assert held == pytest.approx(-d.qfrc_passive, rel=TOLERANCE)


def test_positions_of_coupled_joints_are_those_that_mujoco_holds(tmp_path):
    """Its constraint y - y0 = a0 + a1 (x - x0) + ... is met at q_joints = G q + offset."""
    file = written(tmp_path, ARMS["equality"])
    model, m = rne.load(file).model, mujoco.MjModel.from_xml_path(str(file))
    d = mujoco.MjData(m)
    for q in ([0.3], [-1.2]):
        d.qpos[:] = model.coordinate_map @ q + model.offset
        mujoco.mj_forward(m, d)
        assert d.ne == 3
        assert np.abs(d.efc_pos[:3]).max() < TOLERANCE


FINDINGS = {
    "site": (
        ARM.replace("<joint", "<site/><camera/><joint") + '<statistic extent="1"/>',
        "robot: not read: <site> (1), <camera> (1); none of them acts on the robot here",
    ),
    "tendon": (
        ARM
        + '<tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon><actuator><motor tendon="t"/></actuator>',
        "robot: not read: <tendon> (1), <motor> (1); none of them acts on the robot here",
    ),
    "spring of a tendon": (
        ARM + '<tendon><fixed name="t" stiffness="7" damping="0"><joint joint="j" coef="2"/></fixed></tendon>',
        "tendon 't': is a spring (stiffness '7') that is missing from all torques; add rne.Spring, or a law with its torques, to a scene",
    ),
    "damper of a class of tendons": (
        ARM.replace("<world", '<default><tendon damping=".5"/><default class="c"/></default><world', 1)
        + '<tendon><fixed class="c" stiffness="0"><joint joint="j" coef="2"/></fixed></tendon>',
        "tendon '': is a damper (damping '.5') that is missing",
    ),
    "weld": (
        ARM + '<equality><weld body1="a"/></equality>',
        "robot: not read: <weld> (1); none of them acts on the robot here",
    ),
    "loop that is closed": (
        ARM + '<equality><connect body1="a" anchor="0 0 0"/><weld active="false" body1="a"/></equality>',
        "<connect>: its constraint is missing, the bodies move freely; close a loop by rne.model.four_bar, slider_crank,",
    ),
    "gear": (
        ARM + '<actuator><motor joint="j"/></actuator>',
        "joint 'j': gear, gains and dynamics of its actuator are not read; torques are those of the joint",
    ),
    "gravcomp": (
        ARM.replace('name="a"', 'name="a" gravcomp="1"'),
        "link 'a': 'gravcomp' is not read; gravity acts on it in full",
    ),
    "medium": (
        '<option density="1000"/>' + ARM,
        "robot: density and viscosity of the medium are not read; forces of it are missing",
    ),
    "mocap": (
        ARM.replace("</world", '<body mocap="true"/></world'),
        "robot: bodies that motion capture would move are fixed; remove them",
    ),
    "impossible body": (
        ARM.replace('mass="1"', 'mass="1e-2"'),
        "link 'a': mass and inertia are those of a body lighter than air",
    ),
}


@pytest.mark.parametrize("name", FINDINGS)
def test_what_is_not_read_is_named(name, tmp_path, capsys):
    text, expected = FINDINGS[name]
    file = written(tmp_path, text)
    assert rne.load(file).joint_names == ("j",)
    findings = rne.check(file)
    assert re.search(rf"^warning: {file}(:\d+)?: {re.escape(expected)}", capsys.readouterr().out, re.MULTILINE)
    assert {finding.severity for finding in findings} == {"warning"}


MESH = '<asset><mesh name="m" file="{}"/></asset><worldbody><body name="a"><joint name="j"/><geom type="mesh" mesh="m"/>{}</body></worldbody>'
MASSLESS = ":1: body 'a'" if int(mujoco.__version__[0]) >= 4 else ": file"
CURE = "include files of its folder, each once, at most 100"
ERRORS = {
    "free": (
        ARM.replace('joint name="j"', 'joint type="free" name="j"'),
        ": joint 'j': is a free or ball joint, which is not covered; fix the body, or write hinges and slides",
    ),
    "ball": (
        '<default><joint type="ball"/></default>' + ARM,
        ": joint 'j': is a free or ball joint, which is not covered; fix the body, or write hinges and slides",
    ),
    "circle": (
        ARMS["equality"].replace('joint1="s" joint2="j"', 'joint1="j" joint2="l"'),
        ": joint 'l': <equality> couples joints in a circle; remove one",
    ),
    "truncated": ("<?xml version='1.0'?><mujoco><worldbody><body", ":1: file: is not well-formed XML ("),
    "entities": (
        "<?xml version='1.0'?><!DOCTYPE a [<!ENTITY b 'c'>]><mujoco/>",
        ":1: file: document type declarations and entities are not allowed",
    ),
    "above": (
        "\n<include file='../other.xml'/>",
        f":2: <include>: '../other.xml' is no file below that of the MJCF file; {CURE}",
    ),
    "absolute": (
        "<include file='/etc/passwd'/>",
        f":1: <include>: '/etc/passwd' is no file below that of the MJCF file; {CURE}",
    ),
    "linked": (
        "<include file='link.xml'/>",
        f":1: <include>: 'link.xml' is no file below that of the MJCF file; {CURE}",
    ),
    "itself": ("<include file='arm.xml'/>", f":1: <include>: 'arm.xml' is included twice; {CURE}"),
    "NaN": (
        ARM.replace("0 1 0", "0 nan 0"),
        ":1: joint 'j': attribute 'axis' must be finite, got '0 nan 0'; fix the attribute",
    ),
    "huge": (
        ARM.replace("0 1 0", "1e300 1 0"),
        ": robot: `axis` must be finite, got nan at index (0, 0); fix the file",
    ),
    "infinite": (
        ARM.replace('mass="1"', 'mass="1e999"'),
        ":1: <inertial>: MuJoCo's compiler says: number is too large in attribute 'mass'; fix the file",
    ),
    "made": (
        f'<worldbody><replicate count="1000000000">{INERTIAL}</replicate></worldbody>',
        ":1: <replicate>: <replicate> makes bodies when it is compiled; load what mujoco.mj_saveLastXML writes of the compiled file",
    ),
    "a word": (
        "\n<!-- \n -->" + ARM.replace("axis", "axs"),
        ":3: joint 'j': MuJoCo's compiler says: Schema violation: unrecognized attribute: 'axs'; fix the file",
    ),
    "massless": (
        ARM.replace(INERTIAL, ""),
        f"{MASSLESS}: MuJoCo's compiler says: mass and inertia of moving bodies must be larger than mjMINVAL; fix the file",
    ),
    "mesh": (
        MESH.format("../m.stl", ""),
        ":1: mesh 'm': '../m.stl' is no file below that of the MJCF file, and a body's inertia is of it; put it there, or give the body an <inertial>",
    ),
    "mesh folder": (
        '<compiler meshdir="/tmp"/>' + MESH.format("m.stl", ""),
        ":1: mesh 'm': 'm.stl' is no file below that of the MJCF file, and a body's inertia is of it; put it there, or give the body an <inertial>",
    ),
}


@pytest.mark.parametrize("name", ERRORS)
def test_errors_name_the_element_and_the_cure(name, tmp_path, monkeypatch):
    text, expected = ERRORS[name]
    other = written(tmp_path, ARM, "other.xml")
    folder = tmp_path / "folder"
    file = written(folder, text)
    (folder / "link.xml").symlink_to(other)
    monkeypatch.chdir(folder)
    with pytest.raises(rne.UrdfError, match="^" + re.escape(f"{file}{expected}")) as caught:
        rne.load(file)
    assert caught.value.finding in rne.check(file, out=io.StringIO())
    assert name == "huge" or not (folder / "MUJOCO_LOG.TXT").exists()  # in which it writes warnings


def test_includes_are_read_below_the_folder(tmp_path):
    """Relative to the first file, or else to the one that includes; lines of errors are those of the include there."""
    written(tmp_path / "parts", '<include file="joint.xml"/>', "more.xml")
    written(tmp_path / "parts", ARM, "joint.xml")
    assert rne.load(written(tmp_path, '<include file="parts/more.xml"/>')).joint_names == ("j",)
    first = written(tmp_path, ARM.replace('"j"', '"first"'), "joint.xml")
    assert rne.load(tmp_path / "arm.xml").joint_names == ("first",)
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml")).joint(0).name == "first"
    first.unlink()
    written(tmp_path / "parts", ARM.replace("axis", "axs"), "joint.xml")
    file = written(tmp_path, '\n\n<include file="parts/more.xml"/>')
    with pytest.raises(rne.UrdfError, match=f"^{re.escape(str(file))}:3: joint 'j': MuJoCo's compiler says: Schema"):
        rne.load(file)
    broken = written(tmp_path / "parts", "<?xml version='1.0'?><mujoco", "joint.xml")
    with pytest.raises(rne.UrdfError, match=f"^{re.escape(str(broken))}:1: file: is not well-formed XML"):
        rne.load(file)


def test_meshes_are_needed_for_inertias_alone(tmp_path):
    """A mesh that is not there matters where a body has no <inertial>."""
    trimesh = pytest.importorskip("trimesh")
    stand = '<worldbody><geom type="mesh" mesh="m"/>'
    missing = MESH.format("../m.stl", INERTIAL).replace("<worldbody>", stand)
    assert rne.load(written(tmp_path, missing)).model.mass.tolist() == [1]
    (tmp_path / "shapes").mkdir()
    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "shapes" / "m.stl")
    by_mesh = '<compiler meshdir="shapes"/>' + MESH.format("m.stl", "")
    assert rne.load(written(tmp_path, by_mesh)).model.mass[0] == pytest.approx(6, rel=1e-6)  # float32, 1000 kg/m^3
    compare(written(tmp_path, by_mesh), 2)


GEOMS = """<asset><material name="green" rgba="0 1 0 1" texture="t"/><texture name="t" type="2d" file="no.png"/>
    <mesh name="wedge" vertex="0 0 0 0.1 0 0 0 0.1 0 0 0 0.2"/><mesh name="lost" file="lost.stl"/></asset>
    <default><default class="seen"><geom contype="0" conaffinity="0"/></default></default>
    <worldbody><geom type="plane" size="1 1 1"/><body name="a"><joint name="j"/>{0}
    <geom type="box" size="0.1 0.2 0.3" pos="1 0 0" rgba="1 0 0 0.5" group="{1}"/><geom type="sphere" size="0.1" group="3"/>
    <body name="b">{0}<geom type="box" size="1 1 1"/><geom class="seen" type="cylinder" size="0.1 0.3" euler="90 0 0"/>
    <geom class="seen" type="capsule" size="0.1 0.3" material="green"/><geom class="seen" type="ellipsoid" size="0.1 0.2 0.3"/>
    <geom class="seen" type="mesh" mesh="wedge" pos="0 0 1"/><geom class="seen" type="mesh" mesh="lost"/></body></body></worldbody>"""


def test_shapes_are_the_geoms_that_mujoco_shows(tmp_path):
    """Of a link with geoms that nothing touches, those alone; none of groups from 3 on; not the floor."""
    pytest.importorskip("trimesh")
    model = rne.load(written(tmp_path, GEOMS.format(INERTIAL, 2))).model
    lost = "robot 'arm': visual shapes are not shown: mesh 'lost' is no file below that of the MJCF file; links without shapes are drawn as lines"
    with pytest.warns(UserWarning, match=f"^{lost}$"):
        box, cylinder, capsule, ellipsoid, wedge = link_shapes(model)
    assert [box.link, box.kind, box.color, box.pose[:3, 3].tolist()] == ["a", "box", (1, 0, 0, 0.5), [1, 0, 0]]
    assert box.size == pytest.approx((0.2, 0.4, 0.6))
    assert {x.link for x in (cylinder, capsule, ellipsoid, wedge)} == {"b"}
    assert [cylinder.kind, cylinder.radius, cylinder.length] == ["cylinder", 0.1, 0.6]
    assert cylinder.pose[:3, 2] == pytest.approx([0, -1, 0])  # turned about x by 90 degrees
    assert capsule.color == (0, 1, 0, 1)
    assert capsule.mesh.bounds == pytest.approx(np.array([[-0.1, -0.1, -0.4], [0.1, 0.1, 0.4]]))
    assert ellipsoid.mesh.bounds == pytest.approx(np.array([[-0.1, -0.2, -0.3], [0.1, 0.2, 0.3]]), abs=0.01)
    assert np.concatenate(wedge.faces()).min(axis=0) == pytest.approx([0, 0, 1], abs=1e-7)  # of float32
    assert np.concatenate(wedge.faces()).max(axis=0) == pytest.approx([0.1, 0.1, 1.2])
    assert rne.plotting.draw(rne.Robot(rne.load(written(tmp_path, ARM)).model), [0]).axes[0].name == "3d"


def test_each_mesh_has_its_own_corners(tmp_path):
    """Of files with several, whose corners MuJoCo keeps one after another."""
    pytest.importorskip("trimesh")
    corners = ("0 0 0 0.1 0 0 0 0.1 0 0 0 0.2", "1 0 0 -1 0 0 0 1 0 0 -1 0 0 0 1 0 0 -1")
    meshes = "".join(f'<mesh name="{k}" vertex="{x}"/>' for k, x in enumerate(corners))
    geoms = "".join(f'<geom type="mesh" mesh="{k}"/>' for k in range(2))
    body = f'<worldbody><body name="a"><joint name="j"/>{INERTIAL}{geoms}</body></worldbody>'
    shapes = link_shapes(rne.load(written(tmp_path, f"<asset>{meshes}</asset>{body}")).model)
    assert [len(shape.mesh.vertices) for shape in shapes] == [4, 6]
    low, high = (np.array([find(np.concatenate(x.faces()), axis=0) for x in shapes]) for find in (np.min, np.max))
    assert low == pytest.approx(np.array([[0, 0, 0], [-1, -1, -1]]), abs=1e-6)  # of float32
    assert high == pytest.approx(np.array([[0.1, 0.1, 0.2], [1, 1, 1]]), abs=1e-6)


@pytest.mark.parametrize("package", ["trimesh", "mujoco"])
def test_without_a_package_what_is_missing_of_a_picture_is_said(package, tmp_path, monkeypatch):
    model = rne.load(written(tmp_path, GEOMS.format(INERTIAL, 2), "other.xml")).model
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.warns(UserWarning, match=rf"<geom> need {package}, which is not installed: pip install"):
        assert link_shapes(model) == []


def test_without_mujoco_the_cure_is_said(tmp_path, monkeypatch, capsys):
    file = written(tmp_path, ARM)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    text = "MJCF files are compiled by MuJoCo, which is not installed: pip install 'rne[mjcf]'"
    with pytest.raises(ImportError, match=f"^{re.escape(text)}$"):
        rne.load(file)
    assert main(["check", str(file)]) == 2
    assert capsys.readouterr().err == f"error: {text}\n"
