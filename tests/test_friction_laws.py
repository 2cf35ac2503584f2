"""Friction laws by name and joint: their closed forms, in scenes, and found again in logs; the model that is found."""

import functools
import json
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

import rne
from rne.identification import Record

from .helpers import EPS, archived, first_joints, states
from .measurements import truth

BEYOND_LIMITS = "the motion leaves the robot's limits: in other units, or from another zero?"

n = 3
ALL = rne.Friction(
    viscous=[8, 9, 5],
    viscous_back=[6, 9, 4],
    coulomb=[4, 5, 3],
    coulomb_back=[3, 5, 3.5],
    stribeck_rise=[2, -1, 0],
    stribeck=[0.2, 0.3, 0.0],
    saturation=[0.5, 0.0, 0.8],
    load=[0.1, 0.15, 0.0],
    offset=[1, -2, 0.5],
)
ROTORS = np.array([1.0, 2.0, 0.5])
DRIVES = rne.DriveModel(
    rotor=True,
    friction="viscous+coulomb+asymmetric+load",
    offset=True,
    stribeck=ALL.stribeck,
    saturation=ALL.saturation,
)


@pytest.fixture(scope="module")
def robot():
    return first_joints(n).with_armature(ROTORS)


def quiet(robot, record, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rne.IdentificationWarning)
        return rne.identify(robot, record, **options)


def test_closed_forms(robot):
    """Each law alone, at a velocity where its value is known; a drive that lifts supplies more than one that lowers."""
    qd, load = np.array([0.5, -0.5, 0.0]), np.array([10.0, 10.0, 10.0])
    laws = {
        "saturating": (rne.Friction(viscous=2.0, saturation=0.25), 0.5 * np.tanh([2, -2, 0])),
        "stribeck": (
            rne.Friction(coulomb=1, stribeck_rise=2, stribeck=0.5, smoothing=0),
            [1 + 2 / np.e, -1 - 2 / np.e, 0],
        ),
        "load": (rne.Friction(load=0.2, smoothing=0), [2, -2, 0]),
        "offset": (rne.Friction(offset=[1, 2, 3]), [1, 2, 3]),
    }
    for name, (friction, expected) in laws.items():
        found = friction.torque(robot.model, qd, load)
        np.testing.assert_allclose(found, expected, rtol=4 * EPS, err_msg=name)
        passed = friction.transmitted(load + found, qd)
        assert name != "load" or np.allclose(passed, load, rtol=4 * EPS)


def test_scenes_solve_their_own_torques(robot):
    """Forward dynamics invert inverse dynamics, the kernel is the same, and no energy is lost."""
    scene = rne.Scene(robot, friction=ALL)
    q, qd, qdd = states(n, 20)
    tau = scene.inverse_dynamics(q, qd, qdd)
    extra = tau - robot.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(extra, ALL.torque(robot.model, qd, tau - extra), rtol=1e-11)
    np.testing.assert_allclose(scene.forward_dynamics(q, qd, tau), qdd, rtol=1e-10, atol=1e-10)
    run = rne.simulate(scene, q[0], qd[0], 0.1, torque=tau[0], rtol=1e-9, atol=1e-12)
    assert tuple(run.dissipated) == ("viscous", "coulomb", "offset", "load")
    assert all(run.dissipated[name][-1] > 0 for name in ("viscous", "coulomb", "load"))
    assert run.energy_drift < 1e-5
    middle = len(run.t) // 2
    np.testing.assert_allclose(
        run.qdd[middle], scene.forward_dynamics(run.q[middle], run.qd[middle], tau[0]), rtol=1e-9
    )


def test_a_drive_under_friction_of_its_load_has_that_efficiency(robot):
    """Of one joint without gravity a torque tau accelerates by tau / (1 + mu) forwards, and brakes by tau / (1 - mu)."""
    one = first_joints(1)
    scene = rne.Scene(one, friction=rne.Friction(load=0.25))
    for tau, part in ((10.0, 1 / 1.25), (-10.0, 1 / 0.75)):
        expected = one.forward_dynamics([0.0], [1.0], [tau * part])
        np.testing.assert_allclose(scene.forward_dynamics([0.0], [1.0], [tau]), expected, rtol=1e-13)


def test_offsets_are_held_by_dry_friction_and_by_drives(robot):
    """Without gravity a joint at rest stays while its offset is below its dry friction, and moves against it above."""
    still = replace(robot.model, gravity=np.zeros(3))
    for offset, moves in ((0.9, False), (1.1, True)):
        friction = rne.Friction(coulomb=1.0, smoothing=0, offset=[0, 0, offset])
        run = rne.simulate(rne.Scene(rne.Robot(still), friction=friction), np.zeros(n), np.zeros(n), 0.2)
        assert (run.q[-1, 2] < -1e-6) == moves
        assert run.energy_drift < 1e-6


LAWS = {
    "viscous": (rne.Friction(viscous=[8, 9, 5]), rne.DriveModel(friction="viscous")),
    "coulomb, unequal": (
        rne.Friction(viscous=[8, 9, 5], coulomb=[4, 5, 3], coulomb_back=[3, 4, 3.5]),
        rne.DriveModel(friction="viscous+coulomb", offset=True),
    ),
    "asymmetric": (
        rne.Friction(viscous=[8, 9, 5], viscous_back=[6, 10, 3], coulomb=[4, 5, 3]),
        rne.DriveModel(friction="viscous+coulomb+asymmetric"),
    ),
    "stribeck": (
        rne.Friction(viscous=[8, 9, 5], coulomb=[4, 5, 3], stribeck_rise=[2, 3, 1], stribeck=[0.2, 0.3, 0.1]),
        rne.DriveModel(friction="viscous+coulomb", stribeck=[0.2, 0.3, 0.1]),
    ),
    "saturating": (
        rne.Friction(viscous=[8, 9, 5], coulomb=[4, 5, 3], saturation=[0.5, 0.6, 0.3]),
        rne.DriveModel(friction="viscous+coulomb", saturation=[0.5, 0.6, 0.3]),
    ),
    "load": (
        rne.Friction(viscous=[8, 9, 5], coulomb=[4, 5, 3], load=[0.1, 0.15, 0.05]),
        rne.DriveModel(rotor=True, friction="viscous+coulomb+load"),
    ),
    "by joint": (
        rne.Friction(viscous=[8, 0, 5], coulomb=[0, 5, 3], load=[0, 0.15, 0]),
        rne.DriveModel(friction={"joint_1": "viscous", "joint_2": "coulomb+load", "joint_3": "viscous+coulomb"}),
    ),
}


@functools.cache
def lighter():
    """The arm with a fifth of its masses."""
    return first_joints(n).with_parameters(0.2 * first_joints(n).parameters)


def deviations(name, seed):
    """Errors of the base parameters of a log with this friction, in standard errors, and those of all of friction.

    The robot given has other masses, of which the load of the first fit is wrong.
    """
    friction, drives = LAWS[name]
    arm, given = first_joints(n), lighter()
    motion = truth(rne.Scene(arm, friction=replace(friction, smoothing=1e-4)), seed=seed, rate=100.0, speed=1.0)
    tau = motion.tau + 0.5 * np.random.default_rng(seed).normal(size=motion.tau.shape)
    record = Record(motion.t, motion.q, tau, motion.qd)
    found = quiet(given, record, drives=drives, consistent=False, causes=False, delay=0.0, cutoff=10.0)
    pi, back = arm.base_parameters(drives=drives).standard.values.copy(), friction.viscous_back
    mean, half = (friction.coulomb + friction.coulomb_back) / 2, (friction.coulomb - friction.coulomb_back) / 2
    true = {"Fv": friction.viscous, "Fvb": back, "Fc": mean, "Fs": friction.stribeck_rise, "Fl": friction.load}
    for symbol, value in (true | {"tau0": half}).items():
        if symbol in found.standard.groups:
            pi[found.standard.groups[symbol]] = value
    return (found.estimate.values - found.base.matrix @ pi) / found.estimate.errors


@pytest.mark.parametrize("name", LAWS)
def test_friction_is_found_again(name):
    """In one log; 0.9973 of normal deviations are within three standard errors, of a few dozen all within four."""
    assert np.abs(deviations(name, 0)).max() < 4


@pytest.mark.long
@pytest.mark.parametrize("name", LAWS)
def test_friction_is_found_again_in_a_hundred_logs(name):
    found = np.abs([deviations(name, seed) for seed in range(100)])
    assert (found < 3).mean() > 0.95


@pytest.fixture(scope="module")
def found(robot):
    motion = truth(rne.Scene(robot, friction=ALL), seed=1, rate=100.0, speed=1.0)
    tau = motion.tau + 0.2 * np.random.default_rng(0).normal(size=motion.tau.shape)
    record = Record(motion.t, motion.q, tau, motion.qd)
    return quiet(first_joints(n), record, drives=DRIVES, delay=0.0, cutoff=10.0, folds=4)


def test_predictions_and_the_scene_are_one_model(found):
    q, qd, qdd = states(n, 50)
    qd[:5] *= 1e-3  # where the direction of friction is smoothed
    scene = found.scene()
    expected = found.predict(q, qd, qdd)
    assert np.abs(scene.inverse_dynamics(q, qd, qdd) - expected).max() <= 1e-12 * np.abs(expected).max()
    prepared = found.records[0]
    check = found.check(Record(prepared.t, prepared.q, prepared.tau, prepared.qd))
    assert (check.relative < 0.05).all()
    assert (check.r_squared > 0.99).all()
    for j in range(n):
        tau = found.data.tau[found.data.used[:, j], j]
        left = found.unexplained.in_motion[j] ** 2 * np.mean(tau**2)
        assert found.r_squared[j] == pytest.approx(1 - left / np.var(tau), rel=1e-9)
    assert (found.robot.model.armature == found.parameters[found.standard.groups["Ia"]]).all()
    stuck = found.scene(friction=replace(found.friction, smoothing=0, load=0, stribeck_rise=0), payload=1.0)
    assert stuck.resolved.friction.sticks
    assert stuck.resolved.robot.model.mass[-1] == pytest.approx(found.robot.model.mass[-1] + 1)


class TestTheUrdfOfOtherPrograms:
    """Torques of the robot found to 1e-10, once the armature is set that these programs do not read."""

    def states(self, found):
        q, qd, qdd = states(n, 20)
        tau = found.robot.inverse_dynamics(q, qd, qdd)
        return q, qd, qdd, tau, 1e-10 * np.abs(tau).max()

    def test_here(self, found, tmp_path):
        file = tmp_path / "found.urdf"
        file.write_text(found.to_urdf(), encoding="utf-8")
        loaded, (q, qd, qdd, tau, same) = rne.load(file), self.states(found)
        assert np.abs(loaded.inverse_dynamics(q, qd, qdd) - tau).max() <= same
        np.testing.assert_array_equal(loaded.model.armature, found.robot.model.armature)
        np.testing.assert_array_equal(loaded.model.friction, found.robot.model.friction)
        comment = found.to_urdf().split("<!--")[1]
        assert all(f" {name} " in comment for name in ("Fvb_1", "Fl_2", "tau0_3"))

    def test_pinocchio(self, found):
        pin = pytest.importorskip("pinocchio")
        theirs, (q, qd, qdd, tau, same) = pin.buildModelFromXML(found.to_urdf()), self.states(found)
        theirs.armature[:] = found.robot.model.armature
        data = theirs.createData()
        assert np.abs([pin.rnea(theirs, data, *state) for state in zip(q, qd, qdd, strict=False)] - tau).max() <= same

    def test_mujoco(self, found):
        mujoco = pytest.importorskip("mujoco")
        theirs, (q, qd, qdd, tau, same) = mujoco.MjModel.from_xml_string(found.to_urdf()), self.states(found)
        theirs.dof_armature[:], theirs.dof_damping[:], theirs.dof_frictionloss[:] = found.robot.model.armature, 0, 0
        theirs.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        data = mujoco.MjData(theirs)
        for state, expected in zip(zip(q, qd, qdd, strict=False), tau, strict=False):
            data.qpos[:], data.qvel[:], data.qacc[:] = state
            mujoco.mj_inverse(theirs, data)
            assert np.abs(data.qfrc_inverse - expected).max() <= same


def test_springs_belong_to_the_load_and_to_the_scene(robot, tmp_path):
    """Friction rises with the torque against them too; the scene found has them, and a file keeps them."""
    spring = rne.Spring.at_joint("joint_2", 300.0, 0.5)
    friction = rne.Friction(viscous=5.0, load=[0, 0.2, 0], smoothing=1e-4)
    scene = rne.Scene(robot, friction=friction, springs=[spring])
    q, qd, qdd = states(n, 20)
    tau = scene.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(scene.forward_dynamics(q, qd, tau), qdd, rtol=1e-9, atol=1e-9)
    run = rne.simulate(scene, q[0], qd[0], 0.02, torque=tau[0])
    np.testing.assert_allclose(run.qdd[-1], scene.forward_dynamics(run.q[-1], run.qd[-1], tau[0]), rtol=1e-8)
    motion = truth(scene, seed=1, rate=100.0, speed=1.0)
    options = {
        "drives": rne.DriveModel(rotor=True, friction="viscous+load"),
        "delay": 0.0,
        "cutoff": 10.0,
        "folds": 2,
        "causes": False,
    }
    found = quiet(robot, Record(motion.t, motion.q, motion.tau, motion.qd), springs=[spring], **options)
    np.testing.assert_allclose(found.friction.load, [0, 0.2, 0], atol=2e-3)
    assert found.springs[0].stiffness == pytest.approx(300, rel=0.01)
    expected = found.predict(q, qd, qdd)
    assert np.abs(found.scene().inverse_dynamics(q, qd, qdd) - expected).max() <= 1e-12 * np.abs(expected).max()
    assert found.essential(0.05).base.names[-1].endswith("spring1")
    again = rne.Identification.load(found.save(tmp_path / "found.npz"))
    np.testing.assert_array_equal(again.predict(q, qd, qdd), expected)
    assert again.springs == found.springs


def test_what_is_saved_is_loaded(found, tmp_path):
    file = found.save(tmp_path / "found.npz")
    again = rne.Identification.load(file)
    assert again.report(details=True) == found.report(details=True)
    state = states(n, 3)
    np.testing.assert_array_equal(again.predict(*state), found.predict(*state))
    assert again.to_urdf() == found.to_urdf()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda texts: texts.update(version=2), "`version` must be 1, got 2"),
        (lambda texts: texts["value"]["fields"].update(new=1), "`Identification.new` is not known to this version"),
        (lambda texts: texts["value"]["fields"]["estimate"].update(type="Weighted"), "`Identification.estimate` is of a type that is not known to this version, 'Weighted'"),
        (lambda texts: texts["value"]["fields"].update(parameters={"array": "array_999"}), "`Identification.parameters` is missing"),
        (lambda texts: texts["value"]["fields"].pop("notes"), "Identification.__init__() missing 1 required positional argument: 'notes'"),
        (lambda texts: texts.update(value=3), "the object must be of type Identification, got int"),
    ],
)  # fmt: skip
def test_other_files_are_refused(found, tmp_path, change, text):
    file = found.save(tmp_path / "found.npz")
    arrays, texts = archived(file)
    change(texts)
    np.savez(file, **arrays, **{"texts": np.array(json.dumps(texts))})
    with pytest.raises(ValueError, match=f"^{re.escape(f'{str(file)!r}: {text}')}$"):
        rne.Identification.load(file)


def test_a_file_that_is_none_is_refused(tmp_path):
    (tmp_path / "text.npz").write_text("no archive", encoding="utf-8")
    with pytest.raises(ValueError, match=r"text.npz' is not written by Identification.save$"):
        rne.Identification.load(tmp_path / "text.npz")


def test_essential_parameters_predict_as_well(found):
    """Each is known to within the limit, the others are zero, and nothing is lost that noise does not hide."""
    few = found.essential(0.2)
    assert n < few.base.count < found.base.count
    assert (few.estimate.errors <= 0.2 * np.abs(few.estimate.values)).all()
    dropped = [k for k, name in enumerate(found.base.names) if name not in few.base.names]
    np.testing.assert_allclose(found.base.matrix[dropped] @ few.parameters, 0, atol=1e-9 * np.abs(few.parameters).max())
    np.testing.assert_allclose(few.values, few.estimate.values, rtol=1e-9, atol=1e-9)
    assert (few.unexplained.in_motion < found.unexplained.in_motion + 0.005).all()
    heavy = replace(found.standard, model=replace(found.standard.model, mass=3 * found.standard.model.mass))
    of_heavy = replace(found, standard=heavy, base=replace(found.base, standard=heavy)).essential(0.2)
    np.testing.assert_allclose(of_heavy.unexplained, few.unexplained, rtol=1e-6)  # the robot given has no say
    assert found.essential(1e9).base.names == found.base.names
    too_much = found.parameters + (np.array(found.standard.names) == "Fl_1")
    with pytest.raises(
        rne.IdentificationError, match="negative values of Fl_1: use those of the fit of all parameters"
    ):
        _ = replace(few, parameters=few.parameters - (np.array(found.standard.names) == "Fl_1")).robot
    with pytest.raises(
        rne.IdentificationError, match="no possible friction: correct what `causes` name first; `load` must"
    ):
        _ = replace(found, parameters=too_much).friction
    line = f"{found.essential().base.count} of {found.base.count} base parameters suffice, the others "
    assert line in found.report()


def test_a_report_begins_with_a_verdict_and_is_short(found):
    lines = found.report().splitlines()
    assert lines[0] == found.verdict
    assert lines[0].startswith(
        "good for simulation and feed-forward of all joints below 10 Hz: validation errors while moving of "
    )
    assert len(lines) <= 40
    long = replace(found, notes=tuple(f"note {k}" for k in range(99))).report().splitlines()
    assert len(lines) < len(long) <= 40
    assert any(line.startswith("  ... ") and line.endswith(" more lines") for line in long)
    far = f"{BEYOND_LIMITS} joint_1 to 4 of 3"
    assert replace(found, notes=(far,)).verdict == f"{far}; {lines[0]}"
    light = replace(found, parameters=np.where(np.arange(len(found.parameters)) < 30, 0.2, 1.0) * found.parameters)
    masses = light.parameters[:30:10] / found.initial.model.mass
    doubt = (
        f"masses are {np.median(masses):.2g} times those of the robot given (median): are the units of the log right?"
    )
    assert light.verdict == f"{doubt}; {lines[0]}"
    errors = found.unexplained._replace(in_motion=np.array([0.05, 0.22, np.nan]))
    poor = replace(found, unexplained=errors, consistent=False)
    assert poor.verdict == (
        "not known: joint_2 (22 %), joint_3 (does not move); good for feed-forward, not simulation (least squares alone) "
        "of joint_1 below 10 Hz: validation errors while moving of 5 % or less"
    )
    most = replace(found, unexplained=errors._replace(in_motion=np.array([0.05, 0.08, 0.22])))
    assert most.verdict == (
        "good for simulation and feed-forward of joint_1, joint_2 below 10 Hz: validation errors while moving of 8 % or less; "
        "not known: joint_3 (22 %)"
    )
    far = replace(
        poor, unexplained=errors._replace(in_motion=np.array([0.3, 0.4, 0.5])), notes=(f"{BEYOND_LIMITS} joint_1",)
    )
    assert far.verdict.startswith(f"{BEYOND_LIMITS} joint_1; not good for simulation or feed-forward: ")
    none = replace(found, unexplained=errors._replace(in_motion=np.array([0.3, 0.4, 0.5])))
    assert none.verdict.startswith("not good for simulation or feed-forward: ")


MOTORS = {"coupled_motors": [[1, 1, 0]]}
REFUSED = {
    "load of 1": (lambda robot: rne.Friction(load=[0, 1, 0]), "`load` must be below 1, the part of the torque that friction takes, got [0. 1. 0.]"),
    "no velocity": (lambda robot: rne.Friction(stribeck_rise=1), "`stribeck_rise` needs `stribeck`, the velocity at which it has fallen to 1/e, above 0"),
    "drives": (lambda robot: rne.Friction(coulomb=1, stribeck_rise=-2, stribeck=0.1), "`stribeck_rise` must be at least -`coulomb`: friction does not drive a joint"),
    "no load": (lambda robot: ALL.torque(robot.model, np.zeros(n)), "friction under load needs `load`, the torques of inverse dynamics"),
    "dry": (lambda robot: rne.Scene(robot, friction=replace(ALL, smoothing=0)), "`friction` with `stribeck_rise` and `load` needs a `smoothing` above 0: of dry friction that sticks and slips by events, Coulomb friction is constant"),
    "excitation": (lambda robot: rne.excitation(robot, 5.0, drives=DRIVES), "`drives`: friction under \"load\" depends on what is to be found; leave it out here"),
    "payload": (lambda robot: rne.identify_payload(robot, *logs(robot), drives=DRIVES), "`drives`: friction under \"load\" changes with the load that is to be found; leave it out here"),
    "words": (lambda robot: rne.DriveModel(friction={"joint_1": "viscous, load"}), "`friction` must be of the words 'viscous', 'asymmetric', 'coulomb', 'load', joined by '+', got 'viscous, load'"),
    "asymmetric": (lambda robot: rne.DriveModel(friction="asymmetric"), "`friction` \"asymmetric\" is of viscous friction, and needs \"viscous\", got 'asymmetric'"),
    "joint": (lambda robot: robot.base_parameters(drives=rne.DriveModel(friction={"joint_9": "load"})), "`friction` is for joint_9, the robot's joints are joint_1, joint_2, joint_3"),
    "motors": (lambda robot: robot.base_parameters(drives=replace(DRIVES, **MOTORS)), "`friction` \"asymmetric\" is of drives without `coupled_motors`"),
    "saturation": (lambda robot: robot.base_parameters(drives=rne.DriveModel(saturation=[1.0])), "`saturation` must have shape (3,), got (1,)"),
}  # fmt: skip


def logs(robot):
    motions = [truth(robot, seed=k, duration=4.0, rate=50.0) for k in (0, 1)]
    return [Record(motion.t, motion.q, motion.tau, name=str(k)) for k, motion in enumerate(motions)]


@pytest.mark.parametrize("name", REFUSED)
def test_refused(robot, name):
    call, text = REFUSED[name]
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        call(robot)


def test_a_scene_has_no_coupled_motors(robot):
    motion = truth(robot, seed=0, duration=8.0, rate=50.0)
    drives = rne.DriveModel(rotor=True, **MOTORS)
    coupled = quiet(
        robot, Record(motion.t, motion.q, motion.tau), drives=drives, folds=2, causes=False, delay=0.0, cutoff=5.0
    )
    with pytest.raises(
        rne.IdentificationError, match=r"^a scene has no coupled motors: use `predict` for the torques "
    ):
        coupled.scene()


FASTEST = {
    "offset": {"offset": [5, -5, 2]},
    "saturating": {"saturation": 0.3},
    "stribeck": {"stribeck_rise": [5, 5, 2], "stribeck": 0.3},
    "load": {"load": [0.1, 0.15, 0.2]},
    "all": {"saturation": [0.5, 0, 1], "stribeck_rise": [2, 2, 1], "stribeck": 0.3, "load": 0.1, "offset": [1, 2, -2]},
}


@pytest.mark.parametrize("name", FASTEST)
def test_the_fastest_motion_uses_its_limits(robot, name):
    """Some limit is reached at almost all times, with the friction of a scene, and none is exceeded: no motion is faster."""
    limits = np.array([60, 200, 100])
    friction = rne.Friction(viscous=[8, 9, 5], coulomb=[4, 5, 3], **FASTEST[name])
    strong = robot.with_limits(effort=limits, velocity=1e3)
    motion = rne.trajectories.fastest(strong, [[0.0] * n, [1.0, 0.5, 0.3]], friction=friction, smoothing=0)
    t = np.linspace(0, motion.duration, 301)[1:-1]
    q, qd, qdd = motion(t)
    used = rne.Scene(robot, friction=replace(friction, smoothing=1e-9)).inverse_dynamics(q, qd, qdd) / limits
    assert np.abs(used).max() < 1 + 1e-3
    assert (np.abs(used).max(1) > 0.99).mean() > 0.95


def test_the_observer_knows_friction_under_load(robot):
    """Without a contact nothing is seen; friction of 10 % of the load that is not told looks like one."""
    motion = truth(rne.Scene(robot, friction=replace(ALL, smoothing=0.05)), seed=1, duration=3.0, rate=1000.0)
    known, light = (replace(ALL, smoothing=0.05, load=load) for load in (ALL.load, 0.0))
    seen = [
        np.abs(
            rne.control.MomentumObserver(robot, friction=f).observe(motion.t, motion.q, motion.qd, motion.tau).torque
        )
        for f in (known, light)
    ]
    assert seen[0][50:].max() < 0.02 * seen[1][50:].max()


def test_a_law_that_supplies_friction_under_load_follows_exactly(robot):
    """Computed torque with the friction of the scene as feed-forward leaves the solver's error; without the load more."""
    motion = rne.trajectories.quintic([0] * n, [1] * n, 1.0)
    friction = rne.Friction(viscous=5, coulomb=3, load=0.15, offset=1, smoothing=0.05)
    errors = []
    for supplied in (friction, replace(friction, load=0)):
        law = rne.control.computed_torque(robot, 100, 20, motion, feedforward=supplied)
        scene = rne.Scene(robot, friction=friction, controller=law)
        assert scene.is_traced
        run = rne.simulate(scene, [0] * n, [0] * n, 0.5)
        errors.append(np.abs(run.q - motion(run.t)[0]).max())
    assert errors[0] < 1e-6
    assert errors[1] > 1e-3


@pytest.mark.parametrize("friction", [replace(ALL, stribeck_rise=0), rne.Friction(coulomb=3, smoothing=0, offset=2)])
def test_drives_of_elastic_joints_have_them_too(friction):
    """No energy is created or lost, smooth or dry."""
    scene = rne.Scene(first_joints(n), friction=friction, elastic=rne.ElasticJoints(stiffness=1e4, rotor=1.0))
    run = rne.simulate(scene, np.zeros(n), [0.1, 0.2, 0.3], 0.1)
    assert "offset" in run.dissipated
    assert run.energy_drift < 1e-5


@pytest.mark.parametrize("smoothing", [0.001, 0.01])
def test_the_smoothing_of_a_step_is_the_one_that_predicts_best(smoothing):
    robot, t = first_joints(2), np.arange(0, 20, 0.01)
    w = 2 * np.pi * np.array([0.1, 0.17])
    q, qd, qdd = (f * np.outer(np.ones(len(t)), a) for f, a in zip(waves(t, w), ([0.1, 0.1],) * 3, strict=True))
    noise = 0.5 * np.random.default_rng(0).normal(size=q.shape)
    tau = robot.inverse_dynamics(q, qd, qdd) + 20 * np.tanh(qd / smoothing) + noise
    found = rne.identify(robot, rne.identification.Record(t, q, tau), causes=False)
    assert found.friction.smoothing == smoothing
    assert found.scene().friction.smoothing == smoothing
    lost = tau.copy()
    lost[:, 1] = np.nan
    one = rne.identify(robot, rne.identification.Record(t, q, lost), causes=False)
    assert one.friction.smoothing == smoothing  # by the joint that has torques


def waves(t, w):
    """Positions, velocities and accelerations of sines."""
    return np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
