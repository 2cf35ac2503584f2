"""Rotors of the robot: given, written as Drake reads them, read, and the same for Drake, MuJoCo and Pinocchio."""

import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from lxml import etree

import rne

from .helpers import Oracle, each, first_joints, relative, states
from .random_robots import random_tree

DRAKE = 'xmlns:drake="http://drake.mit.edu"'
SAME = 1e-12  # of two programs that round
ROTORS = np.array([0.5, 0.4, 1 / 3, 0.2, 0.1, 2e-7])
ARM = """<robot name="arm" {space}>
<link name="a"/><link name="b"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="{kind}"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
{drives}</robot>"""
ROTOR, GEAR = '<drake:rotor_inertia value="0.5"/>', '<drake:gear_ratio value="-3"/>'
NEEDED = "a rotor must have a separate SimpleTransmission, with one actuator, gear ratio and joint of the robot, got "


def drive(inside, joints='<joint name="j"/>', kind="transmission_interface/SimpleTransmission", name="t"):
    return (
        f'<transmission name="{name}"><type>{kind}</type>{joints}<actuator name="{name}_m">{inside}</actuator>'
        "</transmission>"
    )


@pytest.fixture
def arm(tmp_path):
    def write(*drives, space=DRAKE, kind="revolute"):
        file = tmp_path / "arm.urdf"
        file.write_text(ARM.format(space=space, kind=kind, drives="".join(drives)), encoding="utf-8")
        return file

    return write


def written(model, tmp_path):
    file = tmp_path / "written.urdf"
    file.write_text(rne.to_urdf(model), encoding="utf-8")
    return file


class TestGiven:
    def test_one_for_all_one_for_each_or_by_name(self, irb140):
        assert irb140.with_armature(0.3).model.armature.tolist() == [0.3] * 6
        each_own = irb140.with_armature(ROTORS)
        assert np.array_equal(each_own.model.armature, ROTORS)
        named = each_own.with_armature({"joint_2": 7})
        assert named.model.armature.tolist() == [0.5, 7.0, *ROTORS[2:].tolist()]
        assert np.array_equal(rne.load("irb140", armature=ROTORS).model.armature, ROTORS)
        assert rne.load("irb140", armature={"joint_2": 7}).model.armature.tolist() == [0, 7, 0, 0, 0, 0]
        assert irb140.with_armature(None) is irb140

    def test_joints_that_mimic_have_their_own(self):
        model = random_tree(4, seed=3, mimics=2)
        robot, G = rne.Robot(model), model.coordinate_map
        own = np.linspace(0.1, 0.6, model.nb)
        mimic = next(i for i in range(model.nb) if i not in model.independent_joints)
        name = model.moving_joints[mimic]
        q = states(model.n, 5)[0]
        added = rne.Scene(robot, armature=own).resolved.robot.mass_matrix(q) - robot.mass_matrix(q)
        np.testing.assert_allclose(added, np.broadcast_to(G.T @ np.diag(own) @ G, added.shape), atol=1e-12)
        by_name = rne.Scene(robot, armature={name: 2.0}).resolved.robot.model.armature
        assert by_name.tolist() == [2.0 * (i == mimic) for i in range(model.nb)]
        assert rne.Scene(robot, armature=0.5).resolved.robot.model.armature.tolist() == [0.5] * model.nb

    def test_scene_replaces_the_robots(self, irb140):
        geared = irb140.with_armature(ROTORS)
        assert np.array_equal(rne.Scene(geared).resolved.robot.model.armature, ROTORS)
        assert rne.Scene(geared, armature=0.0).resolved.robot.model == irb140.model
        cost = rne.Scene(geared).cost()
        assert cost["armature"] == cost["total"] - rne.Scene(irb140).cost()["total"] > 0
        shared = rne.Scene(geared, locked={"joint_2": 0.1}, armature={"joint_3": 9.0})
        assert shared.resolved.robot.model.armature.tolist() == [0.5, 9.0, *ROTORS[3:].tolist()]

    @pytest.mark.parametrize(
        ("armature", "text"),
        [
            ([1, 2], "`armature` must have shape (6,), got (2,)"),
            ({"elbow": 1}, f"`armature` must name joints of {[f'joint_{k}' for k in range(1, 7)]}, got 'elbow'"),
            ({"joint_2": -1}, "`armature[1]` of joint 'joint_2' must not be negative, got -1.0"),
            (np.nan, "`armature[0]` of joint 'joint_1' must be a number, got nan"),
            (np.inf, "`armature` must be finite, got inf at index (0,)"),
            (1j, "`armature` must be real, got dtype complex128"),
            ("urdf", "`armature` must be an array of numbers of shape (6,), got dtype <U4"),
        ],
    )
    def test_errors(self, irb140, armature, text):
        for give in (
            irb140.with_armature,
            lambda x: rne.Scene(irb140, armature=x),
            lambda x: rne.load("irb140", armature=x),
        ):
            with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
                give(armature)

    def test_they_stay_with_the_robot(self, irb140):
        geared = irb140.with_armature(ROTORS)
        for robot in (
            geared.with_payload(2.0),
            geared.mounted([0.1, 0, 0]),
            geared.with_limits(effort=5),
            geared.with_parameters(geared.parameters),
            pickle.loads(pickle.dumps(geared)),
        ):
            assert np.array_equal(robot.model.armature, ROTORS)
        assert np.array_equal(geared.locked({"joint_1": 0.2}).model.armature, ROTORS[1:])
        assert geared.model.astype(np.float32).armature.dtype == np.float32
        line = "rotors: armature [0.5, 0.4, 0.3333, 0.2, 0.1, 2e-07], part of M"
        assert line in repr(geared)
        assert "rotors" not in repr(irb140)


class TestFiles:
    def test_identical_to_the_last_bit(self, irb140, tmp_path):
        model = irb140.with_armature(ROTORS).model
        assert rne.read_urdf(written(model, tmp_path)) == model
        assert "drake" not in rne.to_urdf(irb140.model)
        drives = etree.fromstring(rne.to_urdf(model)).findall("transmission")
        assert len({drive.get("name") for drive in drives} - {None}) == irb140.n

    @pytest.mark.parametrize("seed", range(4))
    def test_of_any_tree(self, seed, tmp_path):
        rng = np.random.default_rng(seed)
        model = random_tree(5, seed, mimics=seed % 3)
        model = replace(model, armature=rng.uniform(0, 1, model.nb) ** 9 * (rng.uniform(size=model.nb) > 0.3))
        back = rne.read_urdf(written(model, tmp_path))
        assert np.array_equal(back.armature, model.armature)

    def test_gears_reflect(self, arm):
        """Declared prefix, any other namespace, none; a negative ratio turns the motor the other way."""
        for space in (DRAKE, 'xmlns:drake="urn:x"', ""):
            file = arm(drive(ROTOR + GEAR), space=space)
            assert rne.load(file).model.armature.tolist() == [4.5]
            (finding,) = rne.check(file)
            assert str(finding).partition("arm.urdf:")[2] == (
                "6: joint 'j': <drake:rotor_inertia> is read, and adds to M: 4.5; give Pinocchio and MuJoCo this "
                "armature, as they read no rotors"
            )

    @pytest.mark.parametrize(
        ("drives", "kind", "warnings", "armature"),
        [
            ([drive(ROTOR)], "revolute", ["<drake:gear_ratio> is missing, taken as 1; give it"], [0.5]),
            ([drive(ROTOR + GEAR)], "fixed", ["the rotor of a fixed joint is ignored; remove it"], []),
            ([drive(GEAR)], "revolute", [], [0.0]),
            ([drive("<mechanicalReduction>100</mechanicalReduction>")], "revolute", [], [0.0]),
            ([drive(ROTOR.replace("drake:", "") + GEAR)], "revolute", [], [0.0]),
        ],
    )
    def test_findings(self, arm, drives, kind, warnings, armature):
        file = arm(*drives, kind=kind)
        found = [f"{x.message}; {x.cure}" for x in rne.check(file) if "<axis>" not in x.message]
        assert [x for x in found if "adds to M" not in x] == warnings
        assert sum("adds to M" in x for x in found) == (np.sum(armature) > 0)
        assert rne.load(file).model.armature.tolist() == armature

    @pytest.mark.parametrize(
        ("drives", "text"),
        [
            (
                [drive('<drake:rotor_inertia value="-1"/>')],
                "attribute 'value' of <drake:rotor_inertia> must not be negative, got '-1'",
            ),
            (
                [drive('<drake:rotor_inertia value="nan"/>')],
                "attribute 'value' of <drake:rotor_inertia> must be one number, finite and decimal, got 'nan'",
            ),
            ([drive("<drake:rotor_inertia/>")], "attribute 'value' of <drake:rotor_inertia> is missing"),
            (
                [drive(ROTOR + '<drake:gear_ratio value="0"/>')],
                "attribute 'value' of <drake:gear_ratio> must not be 0, got '0'",
            ),
            (
                [drive(ROTOR + '<drake:gear_ratio value="1 2"/>')],
                "attribute 'value' of <drake:gear_ratio> must be one number, got '1 2'",
            ),
            ([drive(ROTOR + '<drake:gear_ratio ratio="2"/>')], "attribute 'value' of <drake:gear_ratio> is missing"),
            ([drive(ROTOR), drive(ROTOR, name="u")], NEEDED + "'transmission_interface/SimpleTransmission' of 'j'"),
            ([drive(ROTOR + ROTOR)], NEEDED + "'transmission_interface/SimpleTransmission' of 'j'"),
            ([drive(ROTOR + GEAR + GEAR)], NEEDED + "'transmission_interface/SimpleTransmission' of 'j'"),
            ([drive(ROTOR, '<joint name="k"/>')], NEEDED + "'transmission_interface/SimpleTransmission' of 'k'"),
            ([drive(ROTOR, "")], NEEDED + "'transmission_interface/SimpleTransmission' of "),
            ([drive(ROTOR, kind="Differential")], NEEDED + "'Differential' of 'j'"),
        ],
    )
    def test_errors(self, arm, drives, text):
        with pytest.raises(rne.UrdfError) as error:
            rne.load(arm(*drives))
        assert error.value.finding.message == text
        assert error.value.finding.line == 6

    def test_what_xacro_left_is_an_error(self, arm):
        with pytest.raises(rne.UrdfError, match="is a xacro file, not yet a URDF"):
            rne.load(arm(drive('<drake:rotor_inertia value="${J}"/>')))

    def test_an_overflow_is_an_error(self, arm):
        with pytest.raises(rne.UrdfError, match="`armature` must be finite, got inf"):
            rne.load(arm(drive(ROTOR + '<drake:gear_ratio value="1e200"/>')))


class TestOthers:
    @pytest.mark.parametrize("mimics", [0, 2])
    def test_pinocchio(self, mimics, tmp_path):
        model = random_tree(5, 8, mimics=mimics)
        model = replace(model, armature=np.linspace(0.1, 0.9, model.nb))
        robot = rne.Robot(rne.read_urdf(written(model, tmp_path), gravity=model.gravity))
        oracle = Oracle(robot.model, rne.to_urdf(model))
        assert oracle.theirs.armature[oracle.v].tolist() == model.armature.tolist()
        q, qd, qdd = states(5, 20)
        tau = robot.inverse_dynamics(q, qd, qdd)
        assert relative(robot.mass_matrix(q), each(oracle.mass_matrix, q)) <= SAME
        assert relative(tau, each(oracle.inverse_dynamics, q, qd, qdd)) <= SAME
        if not mimics:
            condition = np.linalg.cond(robot.mass_matrix(q)).max()
            bodies = rne.dynamics.articulated_forward_dynamics(robot.model, q, qd, tau)
            for ours in (robot.forward_dynamics(q, qd, tau), bodies):
                assert relative(ours, each(oracle.forward_dynamics, q, qd, tau)) <= SAME * condition

    @pytest.mark.parametrize("mimics", [0, 2])
    def test_drake_reads_the_file(self, mimics, tmp_path):
        parsing = pytest.importorskip("pydrake.multibody.parsing")
        from pydrake.multibody.plant import MultibodyPlant

        model = random_tree(5, 8, mimics=mimics)
        model = replace(model, armature=np.linspace(0.1, 0.9, model.nb))
        plant = MultibodyPlant(0.0)
        parsing.Parser(plant).AddModels(str(written(model, tmp_path)))
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(model.link_names[0]))
        plant.Finalize()
        joints = [plant.GetJointByName(name) for name in model.moving_joints]
        at, order = plant.CreateDefaultContext(), [joint.velocity_start() for joint in joints]
        q, G = states(5, 10)[0], model.coordinate_map
        for x, M in zip(q, rne.dynamics.mass_matrix(model, q), strict=True):
            positions = np.zeros(model.nb)
            positions[[joint.position_start() for joint in joints]] = G @ x + model.offset
            plant.SetPositions(at, positions)
            theirs = plant.CalcMassMatrix(at)[np.ix_(order, order)]
            assert relative((G.T @ theirs @ G)[None], M[None]) <= SAME

    def test_mujoco(self):
        mujoco = pytest.importorskip("mujoco")
        model = random_tree(5, 8)
        model = replace(model, armature=np.linspace(0.1, 0.9, model.nb))
        theirs = mujoco.MjModel.from_xml_string(rne.to_urdf(model))
        assert not theirs.dof_armature.any()
        order = [theirs.joint(name).dofadr[0] for name in model.moving_joints]
        theirs.dof_armature[order] = model.armature
        data, M = mujoco.MjData(theirs), np.zeros((5, 5))
        for q in states(5, 5)[0]:
            data.qpos[order] = q
            mujoco.mj_forward(theirs, data)
            mujoco.mj_fullM(theirs, data, M)
            assert relative(rne.dynamics.mass_matrix(model, q)[None], M[np.ix_(order, order)][None]) <= SAME


def test_what_uses_the_robot_feels_them():
    """As the same rotors given by a scene, or M with them added."""
    arm, rotors = first_joints(3), ROTORS[:3]
    geared, scene = arm.with_armature(rotors), rne.Scene(arm, armature=rotors)
    q, qd, qdd = states(3, 10)
    tau = geared.inverse_dynamics(q, qd, qdd)
    assert np.array_equal(tau, scene.inverse_dynamics(q, qd, qdd))
    np.testing.assert_allclose(tau, arm.inverse_dynamics(q, qd, qdd) + rotors * qdd, rtol=1e-12, atol=1e-11)
    np.testing.assert_array_equal(geared.gravity_torque(q), arm.gravity_torque(q))
    energy = arm.kinetic_energy(q, qd) + (rotors * qd**2).sum(-1) / 2
    np.testing.assert_allclose(geared.kinetic_energy(q, qd), energy, rtol=1e-12)
    standard = rne.DriveModel(rotor=True)
    base = geared.base_parameters(drives=standard)
    np.testing.assert_allclose(base.regressor(q, qd, qdd) @ base.values, tau, atol=1e-9 * np.abs(tau).max())
    bounds = geared.bounds(quantities=["mass_matrix"]).mass_matrix
    assert (bounds.upper.diagonal() >= geared.mass_matrix(q).diagonal(axis1=1, axis2=2).max(0)).all()
    slow, fast = (rne.check_gains(x, 500.0, 50.0, q=np.zeros(3)) for x in (geared, arm))
    assert repr(slow) != repr(fast)
