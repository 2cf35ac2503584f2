"""Loads and drive gains from motions without and with a load, of which the truth is known."""

import dataclasses
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import rne
from rne.identification import Record, thresholds
from rne.identification.fit.least_squares import least_squares
from rne.identification.payload import doubts, possible_load, unknown_parts
from rne.identification.record_sets import spreads
from rne.model.standard_parameters import StandardParameters

from .faulty_logs import SCARA
from .helpers import kept, loaded
from .measurements import measure, truth

OTHER = rne.Payload(1.7, (-0.02, 0.05, 0.04), np.diag([4, 5, 6]) * 1e-3, "tool0")
DENSITY = 3000.0  # of the ball that a load is like where motions say nothing [kg/m^3]

NOISE = 0.01  # of a joint's largest torque, standard deviation
QUIET = 0.003  # of which three joints tell a load as well as six of NOISE
VISCOUS, COULOMB = np.array([8, 6, 2, 1.2, 1.4, 0.6]), np.array([6, 8, 6, 2, 2.4, 0.5])
LOAD = rne.Payload(3.0, (0.04, -0.03, 0.08), np.array([[12, 1, 0], [1, 9, -2], [0, -2, 7]]) * 1e-3, "tool0")
BETWEEN_SAMPLES = 1e-3  # relative, what filters and differences change in a motion up to 0.5 Hz
GAINS = np.array([12.0, 9.0, 8.0, 3.0, 4.0, 2.5])  # [N m/A]
THREE = [
    1,
    3,
    4,
]  # joints of the arm of three: a shoulder and two of the wrist, which tell a load in a quarter of the time


def robot_of(name):
    """The arm alone: fingers are locked."""
    robot = loaded({"ur5": "ur_description/ur5_robot", "panda": "panda_description/panda"}.get(name, name))
    return robot.locked({"panda_finger_joint1": 0.0}) if name == "panda" else robot


def logs(robot, load, seed=0, noise=NOISE, rate=125.0, duration=10.0, units=1.0, friction=(VISCOUS, COULOMB)):
    """Records without and with the load: different motions, the same drives; torques divided by `units`."""
    viscous, coulomb = friction
    if robot.n == len(THREE):
        units, viscous, coulomb = (x[THREE] if np.ndim(x) else x for x in (units, viscous, coulomb))
    records = []
    for k, payload in enumerate((None, load)):
        drives = rne.Friction(viscous=viscous, coulomb=coulomb, smoothing=1e-4)
        motion = truth(rne.Scene(robot, friction=drives, payload=payload), duration, rate, seed=2 * seed + k)
        t, q, tau = measure(motion, seed + 1000 * k, torque_noise=noise * np.abs(motion.tau).max(0))
        records.append(Record(t, q, tau / units, joint_names=robot.joint_names))
    return records


def notes_of(found):
    """Notes but that the motion, which is any, leaves the robot's limits."""
    return [note for note in found.notes if "leaves the robot's limits" not in note]


def wrist_still(robot, load, moving):
    """Records in which all joints but some stand still."""
    records = []
    for k, arm in enumerate((robot, robot.with_payload(*load))):
        motion = truth(arm, 10.0, 100.0, seed=k)
        mask = np.isin(np.arange(robot.n), moving)
        q, qd, qdd = motion.q * mask + 0.3 * ~mask, motion.qd * mask, motion.qdd * mask
        tau = arm.inverse_dynamics(q, qd, qdd) + VISCOUS * qd + COULOMB * np.sign(qd)
        rng = np.random.default_rng(k)
        records.append(Record(motion.t, q, tau + 0.3 * rng.normal(size=q.shape)))
    return records


@pytest.fixture(scope="module")
def robot():
    return loaded("irb140")


@pytest.fixture(scope="module")
def arm(robot):
    """Three joints of the robot, the others locked."""
    return robot.locked({name: 0.3 for k, name in enumerate(robot.joint_names) if k not in THREE})


@pytest.fixture(scope="module")
def currents(arm):
    """Records of the arm of three whose torques are currents."""
    return logs(arm, LOAD, units=GAINS, noise=QUIET)


@pytest.fixture(scope="module")
def gains(arm, currents):
    return rne.identify_drive_gains(arm, *currents, LOAD)


@pytest.fixture(scope="module")
def three(arm):
    """Records of the arm of three."""
    return logs(arm, LOAD, noise=QUIET)


@pytest.fixture(scope="module")
def load_of_three(arm, three):
    return rne.identify_payload(arm, *three, link="tool0")


@pytest.fixture(scope="module")
def measured(robot):
    return logs(robot, LOAD)


@pytest.fixture(scope="module")
def found(robot, measured):
    return rne.identify_payload(robot, *measured)


@pytest.fixture
def no_causes(monkeypatch):
    """Reports without a search for causes, which takes longer than a fit."""
    monkeypatch.setattr("rne.identification.record_sets.RecordSets.causes", ())


def test_without_noise_the_load_is_found(arm):
    records = logs(arm, LOAD, noise=0.0, rate=250.0, friction=(0.0, 0.0))
    found = rne.identify_payload(arm, *records, link="tool0", drives=rne.DriveModel())
    assert found.mass == pytest.approx(LOAD.mass, rel=BETWEEN_SAMPLES)
    np.testing.assert_allclose(found.com, LOAD.com, atol=BETWEEN_SAMPLES * 0.08)
    np.testing.assert_allclose(found.inertia, LOAD.inertia, atol=10 * BETWEEN_SAMPLES * 0.012)
    assert not found.consistent
    assert notes_of(found) == []


@pytest.mark.parametrize("name", kept(["irb140", "ur5", "panda"], ["ur5"]))
def test_the_truth_is_within_three_standard_errors(name):
    robot = robot_of(name)
    link = "panda_hand_tcp" if name == "panda" else "tool0"
    load = LOAD._replace(link=link)
    found = rne.identify_payload(robot, *logs(robot, load, seed=3, friction=(3.0, 2.0)), link=link)
    assert abs(found.mass - load.mass) < min(3 * found.mass_error, 0.02 * load.mass)
    assert (np.abs(found.com - load.com) < 3 * found.com_error).all()
    assert (np.abs(found.inertia - load.inertia) < 3 * found.inertia_error).all()
    assert found.payload.link == link


@pytest.mark.long
def test_standard_errors_are_those_of_repeated_measurements(robot):
    """The mass and a centre of 24 runs with other noise scatter as the standard errors say."""
    runs, clean = [], logs(robot, LOAD, 0, rate=100.0, noise=0.0)
    for seed in range(24):
        rng = np.random.default_rng(seed)
        noisy = [Record(r.t, r.q, r.tau + NOISE * np.abs(r.tau).max(0) * rng.normal(size=r.q.shape)) for r in clean]
        runs.append(rne.identify_payload(robot, *noisy))
    z = [[(r.mass - LOAD.mass) / r.mass_error, (r.com[0] - LOAD.com[0]) / r.com_error[0]] for r in runs]
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1, abs=0.31)  # 48 errors: three deviations


@pytest.mark.long
@pytest.mark.parametrize("name", ["irb140", "ur5", "panda"])
def test_masses_of_many_loads_are_found_within_two_percent(name):
    robot = robot_of(name)
    link, inside = "panda_hand_tcp" if name == "panda" else "tool0", []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        load = rne.Payload(rng.uniform(1, 5), rng.uniform(-0.1, 0.1, 3), rng.uniform(1e-3, 5e-3) * np.eye(3), link)
        found = rne.identify_payload(
            robot, *logs(robot, load, seed, rate=250.0, duration=20.0, friction=(3.0, 2.0)), link=link
        )
        inside.append(abs(found.mass - load.mass) < min(3 * found.mass_error, 0.02 * load.mass))
    assert np.mean(inside) >= 0.95


def test_a_scene_takes_what_was_found(robot, found):
    direct = robot.with_payload(*found.payload).model
    assert rne.Scene(robot, payload=found).resolved.robot.model == direct
    assert rne.Scene(robot, payload=found.payload).resolved.robot.model == direct
    assert rne.Scene(robot, payload=found).cost()["payload"] > 0


def test_an_identification_is_the_side_without_load(arm, three, load_of_three):
    found, of_robot = load_of_three, rne.identify(arm, three[0], consistent=False, causes=False)
    same = rne.identify_payload(of_robot, None, three[1], link="tool0")
    np.testing.assert_allclose(same.estimate.values, found.estimate.values, rtol=1e-6, atol=1e-9)
    assert same.mass_error == pytest.approx(found.mass_error, rel=1e-6)
    with pytest.raises(ValueError, match=r"^an Identification has its records and drives: `without` and `drives` "):
        rne.identify_payload(of_robot, *three)


def test_the_robots_own_bodies_do_not_matter(arm, three, load_of_three):
    """Joints and their places alone are taken from the robot."""
    other = arm.with_parameters(arm.parameters * 1.7)
    mass = rne.identify_payload(other, *three, link="tool0").mass
    assert mass == pytest.approx(load_of_three.mass, rel=1e-9)


def test_the_link_is_the_frame_of_the_load(arm, three, load_of_three):
    """The same body in the frame of link_6, which is 0.065 m behind the flange and has its axes turned."""
    found, other = load_of_three, rne.identify_payload(arm, *three, link="link_6")
    poses = dict(zip(arm.link_names, arm.link_poses(np.zeros(3)), strict=True))
    T = np.linalg.inv(poses["link_6"]) @ poses["tool0"]
    assert other.mass == pytest.approx(found.mass, rel=1e-9)
    np.testing.assert_allclose(other.com, T[:3, :3] @ found.com + T[:3, 3], atol=1e-9)
    np.testing.assert_allclose(other.inertia, T[:3, :3] @ found.inertia @ T[:3, :3].T, atol=1e-9)


FAR = """<robot name="far"><link name="base"/><link name="hook"/><link name="arm"><inertial>
<origin xyz="0.1 -300 0.2"/><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="arm"/><origin xyz="0 300 0.5"/><axis xyz="0 1 0"/>
</joint><joint name="k" type="fixed"><parent link="arm"/><child link="hook"/><origin xyz="0.1 -300 0.3" rpy="0.5 1 2"/>
</joint></robot>"""


@pytest.mark.parametrize("name", ["panda", "far"])
def test_parameters_of_a_load_are_those_that_a_payload_adds(name, load_of_three, tmp_path):
    """On every link that moves; the second robot's joint is moved along its axis when it is loaded."""
    (tmp_path / "far.urdf").write_text(FAR)
    arm = rne.load(tmp_path / "far.urdf") if name == "far" else loaded("panda_description/panda")
    assert arm.model.joint_origin.any() == (name == "far")
    com, inertia = np.array(LOAD.com), np.array(LOAD.inertia)
    about_origin = inertia + LOAD.mass * (com @ com * np.eye(3) - np.outer(com, com))
    phi = np.array([LOAD.mass, *LOAD.mass * com, *about_origin[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
    standard = StandardParameters(arm.model)
    shape, base = (1, standard.count), SimpleNamespace(standard=standard)
    empty = {"data": (), "S": np.zeros((*shape, 0)), "known": np.zeros(shape)}
    sets = dataclasses.replace(load_of_three.sets, robot=arm, base=base, **empty)
    for link in np.array(arm.link_names)[np.array(arm.model.link_body) >= 0].tolist():
        added = arm.with_payload(*LOAD._replace(link=link)).parameters - arm.parameters
        size = 1 + np.abs(added).max()
        np.testing.assert_allclose(sets.with_load(link).S[-1] @ phi, added, atol=1e-12 * size)


def inertia_about_centre(phi):
    """Of a body with ten parameters about the link's origin."""
    com, inertia = phi[1:4] / phi[0], phi[4:][[[0, 1, 3], [1, 2, 4], [3, 4, 5]]]
    return inertia - phi[0] * (com @ com * np.eye(3) - np.outer(com, com))


def test_without_any_information_the_load_is_a_ball():
    phi = np.array([3.0, 0.3, 0.0, -0.6, 1, 0, 1, 0, 0, 1.0])
    ball = possible_load(np.zeros((11, 11)), phi, np.full(10, 0.1))
    np.testing.assert_allclose(ball[:4], phi[:4], atol=1e-6)
    inertia = inertia_about_centre(ball)
    volume = 4 / 3 * np.pi * (inertia[0, 0] * 2.5 / 3.0) ** 1.5  # I = 2/5 m r^2
    assert pytest.approx(3.0 / volume, rel=1e-4) == DENSITY
    np.testing.assert_allclose(inertia, inertia[0, 0] * np.eye(3), atol=1e-4 * inertia[0, 0])


def test_a_load_differs_from_the_ball_by_three_times_its_size(monkeypatch):
    monkeypatch.setattr("rne.identification.payload.consistent_fit", lambda factor, prior, weight, *_: weight)
    assert possible_load(np.zeros((11, 11)), np.ones(10), np.ones(10)) == pytest.approx(1 / 9)


def test_standard_errors_count_the_correlation_time_of_filtered_noise(robot, monkeypatch):
    """Variances are at least those of independent residuals, times the number of equations that count as one."""
    measured = logs(robot, LOAD, rate=250.0)
    found = rne.identify_payload(robot, *measured)
    sets = found.sets
    alone = least_squares(sets.assembled(sets.plain))
    x = sets.states(alone.values)
    none = [np.zeros((len(data.tau), 6, 1)) for data in sets.data]
    correlation_time = sets.correlation_time(x, none, np.zeros((6, 1)))
    both = [data.correlation_time(data.residuals(values)) for data, values in zip(sets.data, x, strict=True)]
    assert (np.min(both, 0) <= correlation_time * (1 + 1e-12)).all()
    assert (correlation_time <= np.max(both, 0) * (1 + 1e-12)).all()
    assert correlation_time.min() > 1.1
    ratio = (found.estimate.errors / alone.errors)[-10:] ** 2
    assert (ratio >= 0.7 * correlation_time.min()).all()  # the random errors take some of the noise
    # Without random errors and the scatter between blocks only the equations that count as one are left.
    monkeypatch.setattr("rne.identification.record_sets.spreads", lambda factor, K, m, n: np.full(m, 1e-12))
    monkeypatch.setattr(
        "rne.identification.record_sets.jackknife",
        lambda both, noise, K, spread: np.zeros((len(both.factors), both.factors.shape[-1] - 1)),
    )
    fit = sets.fitted()
    ratio = (fit.estimate.errors / alone.errors) ** 2
    assert (ratio >= 0.999 * correlation_time.min()).all()
    assert (ratio <= 1.001 * correlation_time.max()).all()
    of_load = np.linalg.lstsq(fit.load[:, :-1], fit.load[:, -1])[0]  # the other unknowns are eliminated
    np.testing.assert_allclose(of_load, fit.estimate.values[-10:], rtol=1e-6, atol=1e-9)


def test_numbers_of_the_load_do_not_depend_on_unknowns_that_are_nothing(load_of_three):
    """Of a load of which nothing is unknown no parameter is left, and the base parameters are those of both sets."""
    sets = load_of_three.sets
    none, ten = (x.assembled(sets.plain) for x in (dataclasses.replace(sets, S=sets.S[..., :0]), sets))
    assert least_squares(none).values.shape == (sets.base.count,)
    np.testing.assert_allclose(none.torques(), ten.torques(), rtol=1e-12)


def test_errors_of_drives_that_hardly_matter_keep_the_spread_assumed_first():
    """As many rows as unknowns, all of them independent, and no torque that errors of so small a weight would explain."""
    joints, others, kinds = 3, 2, 6
    factor = 1e-3 * np.eye(others + kinds * joints + 1)
    factor[:, -1] = 0
    students = np.sqrt(joints / (joints - 2))  # standard deviation of Student's t with so many degrees of freedom
    found = spreads(factor, others, kinds * joints, joints)
    np.testing.assert_allclose(found, thresholds.FIRST_SPREAD * students, rtol=1e-6)


def used(values, tau):
    """Values of the joints that torques are of."""
    return values[THREE] if tau.shape[-1] == len(THREE) else values


class Faults:
    """What drives of real arms do, as torques for the motion and the torque of the bodies in record k."""

    @staticmethod
    def factors(tau, qd, k):
        return tau * used(np.array([1.04, 0.95, 1.03, 0.97, 1.05, 0.98]), tau)

    @staticmethod
    def changed(tau, qd, k):
        return tau * (1 + 0.1 * k * used(np.array([0, 0, 1, 0, 0, 0]), tau))

    @staticmethod
    def under_load(tau, qd, k):
        return tau + 0.08 * np.abs(tau) * np.sign(qd)

    @staticmethod
    def saturating(tau, qd, k):
        return tau + used(VISCOUS, tau) * qd / (1 + np.abs(qd))

    @staticmethod
    def warmer(tau, qd, k):
        return tau + (1 - 0.2 * k) * (used(VISCOUS, tau) * qd + used(COULOMB, tau) * np.sign(qd)) + 0.2 * k


def faulty(robot, load, fault, seed=0, rate=125.0, duration=10.0):
    """Records without and with the load of drives with a fault, and noise."""
    records = []
    for k, arm in enumerate((robot, robot.with_payload(*load))):
        motion = truth(arm, duration, rate, seed=2 * seed + k)
        tau = fault(motion.tau, motion.qd, k)
        noise = QUIET if robot.n == len(THREE) else NOISE
        tau = tau + noise * np.abs(tau).max(0) * np.random.default_rng(seed + k).normal(size=tau.shape)
        records.append(Record(motion.t, motion.q, tau, joint_names=robot.joint_names))
    return records


@pytest.mark.parametrize(
    (
        "fault",
        "kind",
        "error",
    ),  # the stated error, relative, changes between the records contained: that of noise alone is 0.2 %
    [
        ("factors", "torque factors (", 0.012),
        ("changed", "torque factors that changed between the records (", 0.012),
        ("under_load", "friction under load (", 0.005),
        ("saturating", "viscous friction that ", 0.006),
        ("warmer", "friction that changed between the records (", 0.008),
    ],
)
def test_stated_errors_contain_what_drives_do_besides(robot, arm, fault, kind, error):
    arm = robot if fault in ("factors", "changed") else arm  # factors of three joints alone leave the load in doubt
    found = rne.identify_payload(arm, *faulty(arm, LOAD, getattr(Faults, fault)), link="tool0")
    assert abs(found.mass - LOAD.mass) < 3 * found.mass_error
    assert (np.abs(found.com - LOAD.com) < 3 * found.com_error).all()
    assert found.mass_error < 2 * error * LOAD.mass
    assert any(kind in note for note in found.notes), found.notes


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::rne.IdentificationWarning")  # of what faults leave unexplained
@pytest.mark.parametrize("fault", ["factors", "changed", "under_load", "saturating", "warmer"])
def test_the_truth_is_within_three_stated_errors_of_faulty_drives(robot, fault):
    inside = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        load = rne.Payload(rng.uniform(1, 5), rng.uniform(-0.1, 0.1, 3), rng.uniform(1e-3, 5e-3) * np.eye(3), "tool0")
        found = rne.identify_payload(robot, *faulty(robot, load, getattr(Faults, fault), seed, 250.0, 20.0))
        inside.append(abs(found.mass - load.mass) < 3 * found.mass_error)
    assert np.mean(inside) >= 0.95


def test_a_doubtful_load_warns_with_the_likely_causes(arm):
    """The torque of joint 4 is measured at half its size."""
    records = faulty(arm, LOAD, lambda tau, qd, k: tau * [1, 0.5, 1])
    with pytest.warns(rne.IdentificationWarning, match=r"the mass is known to .* % only.*likely causes: .*joint_4"):
        found = rne.identify_payload(arm, *records, link="tool0")
    assert any(cause.kind == "torque factor" and "joint_4" in cause.joints for cause in found.causes)
    assert abs(found.mass - LOAD.mass) < 3 * found.mass_error


def test_held_out_errors_of_a_load_are_those_of_the_noise(found, measured):
    """Noise of a hundredth of the largest torque, of which the filter leaves a part."""
    assert found.held_out.shape == (6,)
    assert (found.held_out > 0.5 * NOISE / 5).all()
    assert (found.held_out < 2 * NOISE).all()
    assert found.doubt == ""
    assert found.causes == ()


def test_a_load_that_least_squares_make_impossible_is_replaced(robot):
    """A wrist at rest leaves the inertia to noise: the mass stays."""
    records = wrist_still(robot, LOAD, [0, 1, 2])
    found = rne.identify_payload(robot, *records)
    assert np.linalg.eigvalsh(inertia_about_centre(found.estimate.values[-10:]))[0] < 0
    assert "least squares give an inertia that no distribution of mass has" in found.notes
    assert found.consistent
    moments = np.linalg.eigvalsh(found.inertia)
    assert moments[0] > 0
    assert moments[2] < moments[0] + moments[1]
    assert abs(found.mass - LOAD.mass) < min(3 * found.mass_error, 0.02 * LOAD.mass)
    assert "joint_4, joint_5, joint_6 do not move: their rotor and friction cannot be found" in found.notes
    rne.Scene(robot, payload=found)


@pytest.mark.parametrize("mass", [0.5, 2.0])
def test_an_inertia_that_none_has_is_told_of_a_light_load_too(mass):
    """A rod along two axes at once."""
    phi = mass * np.array([1, 0, 0, 0, 1, 0, 3, 0, 0, 1.0])
    assert doubts(phi, np.full(10, 1e-3)) == ["least squares give an inertia that no distribution of mass has"]


def test_what_motions_do_not_tell_is_infinite_and_like_a_ball(robot):
    """A pendulum in its plane tells the mass times its distance: with two joints the mass, never the centre across."""
    arm = robot.locked(dict.fromkeys(("joint_1", "joint_4", "joint_5", "joint_6"), 0.0))
    load = LOAD._replace(com=(0.05, 0.0, 0.08))
    found = rne.identify_payload(arm, *logs(arm, load, friction=(0.0, 0.0)), link="tool0", drives=rne.DriveModel())
    assert np.isinf(found.com_error).sum() == 1
    across = int(np.argmax(found.com_error))
    assert found.com[across] == pytest.approx(0, abs=1e-4)
    assert found.consistent
    assert abs(found.mass - load.mass) < 4 * found.mass_error
    assert found.unknown == ("its centre along (0.00, 1.00, 0.00)", "its inertia")
    assert any(
        note.startswith("not identifiable from the motions, in the axes of tool0: its centre") for note in found.notes
    )


@pytest.mark.parametrize("moving", kept([[5], [3, 4, 5], [0]], [[3, 4, 5], [0]]), ids=str)
def test_motions_that_do_not_tell_the_mass_are_refused(robot, moving):
    with pytest.raises(rne.IdentificationError, match=r"^`with_load`: the motions do not separate the load's mass"):
        rne.identify_payload(robot, *wrist_still(robot, LOAD, moving))


def test_exchanged_records_are_named(arm, three):
    with pytest.raises(rne.IdentificationError, match=r"a mass of -3(\.\d+)? kg, .*: are the records exchanged"):
        rne.identify_payload(arm, *three[::-1], link="tool0")
    free = rne.identify_payload(arm, *three[::-1], consistent=False, link="tool0")
    assert free.notes[0].startswith("least squares give a mass of -")


def test_records_of_named_joints_may_have_others_and_another_order(arm, three, load_of_three, no_causes):
    """As for `rne.identify`; joints that they lack are locked."""
    order, names = [2, 0, 1], np.array(arm.joint_names)
    turned = [Record(r.t, r.q[:, order], r.tau[:, order], joint_names=names[order].tolist()) for r in three]
    assert rne.identify_payload(arm, *turned, link="tool0").mass == pytest.approx(load_of_three.mass, rel=1e-9)
    drives = rne.DriveModel(friction="viscous+coulomb")
    alone = rne.identify(arm, turned[0], drives=drives, consistent=False, causes=False)
    assert rne.identify_payload(alone, None, turned[1], link="tool0").mass == pytest.approx(LOAD.mass, rel=0.02)
    panda = loaded("panda_description/panda").locked({f"panda_joint{k}": 0.3 for k in (1, 3, 5, 7)})
    arm, load = panda.locked({"panda_finger_joint1": 0.0}), rne.Payload(2.0, (0, 0, 0.1), link="panda_hand")
    records = logs(arm, load, noise=QUIET, units=1.0, friction=(1.0, 1.0))
    with pytest.warns(
        rne.IdentificationWarning, match=r"taken as locked: panda_finger_joint1 at 0; if they stood"
    ) as told:
        more = rne.identify_payload(panda, *records, link="panda_hand")
    assert Path(told[0].filename).name == "test_payload.py"
    assert more.mass == pytest.approx(2.0, rel=0.02)
    assert "joints that the records do not have, taken as locked: panda_finger_joint1 at 0" in more.report()
    assert str(more) == more.report()


def test_a_joint_without_torque_under_load_is_left_out(robot, measured):
    without, with_load = measured
    tau = with_load.tau * np.where(np.arange(6) == 0, np.nan, 1)
    found = rne.identify_payload(robot, without, Record(with_load.t, with_load.q, tau))
    assert abs(found.mass - LOAD.mass) < 3 * found.mass_error


def test_doubt_names_no_friction_of_sound_gears():
    """A mass that is not told may be on another link; friction that rises with the load is no cause of it."""
    arm, load = robot_of("ur5"), rne.Payload(2.0, (0.2, 0, 0.05), link="forearm_link")
    without, with_load = logs(arm, load, rate=100.0, friction=(2.0, 2.0))
    tau = [
        r.tau + 0.08 * np.abs(arm.gravity_torque(r.q)) * np.sign(np.gradient(r.q, axis=0)) for r in (without, with_load)
    ]
    with pytest.warns(rne.IdentificationWarning, match="^the mass is known to .* % only") as warned:
        found = rne.identify_payload(
            arm, *(Record(r.t, r.q, x) for r, x in zip((without, with_load), tau, strict=True)), link="tool0"
        )
    assert "friction under load" in [cause.kind for cause in found.causes]
    assert "% of its load" not in str(warned[0].message)
    assert any(note.endswith(": is it on another `link`?") for note in found.notes)


def test_wrong_arguments_are_refused(robot, measured):
    without, with_load = measured
    planar = logs(rne.load("irb140").locked({"joint_6": 0.0}), None, friction=(1.0, 1.0), duration=4.0)[0]
    q = with_load.q * np.where(np.arange(6) == 2, np.nan, 1)
    broken = Record(with_load.t, q, with_load.tau)
    cases = [
        (TypeError, "`robot` must be an rne.Robot, got str", lambda: rne.identify_payload("arm", without, with_load)),
        (
            ValueError,
            "`with_load` must be of the joints ['joint_1', 'joint_2', 'joint_3', 'joint_4', 'joint_5', 'joint_6'], "
            "'record' has 5 joints without names: give the names of ",
            lambda: calls(robot, without, Record(planar.t, planar.q, planar.tau)),
        ),
        (
            ValueError,
            "records must be of the same joints, record has ['joint_1', 'joint_2', 'joint_3', 'joint_4', 'joint_5', "
            "'joint_6'], record ['joint_1', 'joint_2', 'joint_3', 'joint_4', 'joint_5']: give `joints` that both have",
            lambda: calls(robot, without, planar),
        ),
        (ValueError, "`without` must have a record without the load", lambda: calls(robot, None, with_load)),
        (TypeError, "`drives` must be an rne.DriveModel, got str", lambda: calls(robot, *measured, drives="rotor")),
        (ValueError, "`link` must move, 'base_link' is fixed", lambda: calls(robot, *measured, link="base_link")),
        (ValueError, "", lambda: calls(robot, without, broken)),
    ]
    for error, text, call in cases:
        with pytest.raises(error) as raised:
            call()
        assert str(raised.value).startswith(text), raised.value


def calls(*args, **more):
    return rne.identify_payload(*args, **more)


def test_a_mass_beyond_four_standard_errors_is_no_doubt(arm):
    light = rne.Payload(0.05, (0.04, -0.03, 0.08))
    with pytest.warns(rne.IdentificationWarning, match="the mass is known to 2[01] % only"):
        found = rne.identify_payload(arm, *logs(arm, light, noise=0.004, rate=100.0), link="tool0", consistent=False)
    assert 4 < found.mass / found.mass_error < 5
    assert not any("hardly significant" in note for note in found.notes)


def test_report_and_repr_of_a_load(found):
    lines = found.report().splitlines()
    assert lines[0].startswith(f"{found.mass:.4g} kg on tool0, known to 0.")
    assert lines[1].endswith("that were not fitted")
    assert lines[2].split() == ["load", "on", "tool0", "estimate", "standard", "error"]
    lines = lines[2:]
    assert [line.split()[0] for line in lines[1:11]] == [
        "mass",
        *["centre"] * 3,
        "Ixx",
        "Ixy",
        "Iyy",
        "Ixz",
        "Iyz",
        "Izz",
    ]
    assert repr(found).startswith(f"PayloadEstimate({found.mass:.4g} kg, standard error 0.0")


def test_without_noise_the_gains_are_found(arm):
    records = logs(arm, LOAD, noise=0.0, friction=(0.0, 0.0), units=GAINS)
    found = rne.identify_drive_gains(arm, *records, LOAD, drives=rne.DriveModel())
    np.testing.assert_allclose(found.gains, GAINS[THREE], rtol=BETWEEN_SAMPLES)
    assert notes_of(found) == []
    assert repr(found).startswith("DriveGains([")


@pytest.mark.parametrize("joints", kept([3, 6], [3]))
def test_gains_are_within_three_standard_errors_and_two_percent(request, robot, joints):
    if joints == 3:
        found, true = request.getfixturevalue("gains"), GAINS[THREE]
    else:
        found, true = rne.identify_drive_gains(robot, *logs(robot, LOAD, units=GAINS, rate=250.0), LOAD), GAINS
    assert (np.abs(found.gains - true) < np.minimum(3 * found.errors, 0.02 * true)).all()


def test_gains_follow_the_load_and_the_unit(arm, currents, gains, no_causes):
    """i = tau / g: twice the load, twice the gains; another unit of a joint, another gain."""
    assert gains.report().startswith("gains of 3 of 3 joints, known to 0.")
    heavy = rne.Payload(2 * LOAD.mass, LOAD.com, 2 * LOAD.inertia, LOAD.link)
    np.testing.assert_allclose(rne.identify_drive_gains(arm, *currents, heavy).gains, 2 * gains.gains, rtol=1e-6)
    units = np.array([4, 0.5, 10])
    scaled = [Record(r.t, r.q, r.tau / units) for r in currents]
    np.testing.assert_allclose(rne.identify_drive_gains(arm, *scaled, LOAD).gains, units * gains.gains, rtol=1e-6)


@pytest.mark.long  # the same of torques: test_an_identification_is_the_side_without_load
def test_an_identification_of_currents_gives_the_same_gains(robot):
    records = logs(robot, LOAD, units=GAINS)
    expected = rne.identify_drive_gains(robot, *records, LOAD)
    with pytest.warns(rne.IdentificationWarning, match="is measured"):
        of_currents = rne.identify(robot, records[0], consistent=False, folds=2)
    np.testing.assert_allclose(
        rne.identify_drive_gains(of_currents, None, [records[1]], LOAD).gains, expected.gains, rtol=1e-6
    )


def test_several_records_give_better_gains(arm, currents, gains):
    more = [
        [first, second] for first, second in zip(currents, logs(arm, LOAD, 1, units=GAINS, noise=QUIET), strict=True)
    ]
    both = rne.identify_drive_gains(arm, *more, LOAD)
    assert (both.errors < gains.errors).all()
    assert (np.abs(both.gains - GAINS[THREE]) < 3 * both.errors).all()


def test_payload_found_and_gains_agree(arm):
    """With the load that the same torques gave, all gains are one."""
    records = logs(arm, LOAD)
    gains = rne.identify_drive_gains(arm, *records, rne.identify_payload(arm, *records, link="tool0"))
    assert (np.abs(gains.gains - 1) < np.maximum(3 * gains.errors, 1e-3)).all()


@pytest.mark.long  # of less noise: test_gains_are_within_three_standard_errors_and_two_percent
@pytest.mark.filterwarnings("ignore:gains are known poorly:rne.IdentificationWarning")
def test_noise_of_the_currents_does_not_draw_gains_to_zero(robot):
    """Ten times the noise of before: least squares with currents as a column would lose half of these gains."""
    load = rne.Payload(1.0, (0.05, 0.0, 0.08), link="tool0")
    z = []
    for seed in range(4):
        found = rne.identify_drive_gains(robot, *logs(robot, load, seed, noise=0.1, rate=100.0, units=GAINS), load)
        told = np.isfinite(found.gains)
        z += ((found.gains - GAINS) / found.errors)[told].tolist()
    assert len(z) >= 12
    assert abs(np.mean(z)) < 3 / np.sqrt(len(z)) + 0.2
    assert np.mean(np.abs(z) < 3) > 0.9


def test_a_joint_that_the_load_does_not_act_on_has_no_gain(robot, no_causes):
    """A point mass on the axis of joint 6."""
    arm, load = robot.locked({f"joint_{k}": 0.3 for k in (1, 3, 4)}), rne.Payload(3.0, (0.0, 0.0, 0.05), link="tool0")
    found = rne.identify_drive_gains(arm, *logs(arm, load, units=3.0, friction=(2.0, 1.5)), load)
    assert np.isnan(found.gains).tolist() == np.isnan(found.errors).tolist() == [False, False, True]
    assert found.notes[-1] == (
        "the gain of joint_6 cannot be identified: the load produces no torque there in these motions, or acts as the "
        "joint's own body or offset does; move the joint against the load, or mount the load further from its axis"
    )
    assert found.report().splitlines()[5].split() == ["joint_6", "-", "-"]
    assert (np.abs(found.gains - 3.0)[:2] < 3 * found.errors[:2]).all()


def test_a_load_that_is_none_gives_no_gains(robot, arm, measured):
    with pytest.raises(ValueError, match=r"^`link` must move, 'base_link' is fixed to the base: no joint carries"):
        rne.identify_drive_gains(robot, *measured, rne.Payload(3.0, link="base_link"))
    with pytest.raises(rne.IdentificationError, match=r"^`payload`: the load changes the currents of no joint"):
        rne.identify_drive_gains(arm, *logs(arm, None), LOAD)


def test_of_a_mass_alone_the_rest_of_the_load_is_estimated(arm, currents):
    found = rne.identify_drive_gains(arm, *currents, LOAD.mass)
    assert (np.abs(found.gains - GAINS[THREE]) < np.minimum(3 * found.errors, 0.02 * GAINS[THREE])).all()
    np.testing.assert_allclose(found.com, LOAD.com, atol=2e-3)
    assert notes_of(found)[0].startswith("the load's centre, not given, is found at (0.04")
    same = rne.identify_drive_gains(arm, *currents, rne.Payload(LOAD.mass, link="tool0"))
    np.testing.assert_array_equal(same.gains, found.gains)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:gains are known poorly:rne.IdentificationWarning")
def test_gains_of_a_mass_alone_cover_the_truth(robot):
    """Each of 12 other loads, of noise up to a tenth of the largest torque."""
    z = []
    for seed, noise in ((s, x) for s in range(4) for x in (0.01, 0.03, 0.1)):
        load = rne.Payload(2.0, (0.05 * (seed % 3 - 1), 0.03, 0.08), 1e-3 * np.eye(3), "tool0")
        found = rne.identify_drive_gains(
            robot, *logs(robot, load, seed, noise=noise, rate=250.0, duration=20.0, units=GAINS), 2.0
        )
        z += np.abs((found.gains - GAINS) / found.errors)[np.isfinite(found.gains)].tolist()
    assert len(z) > 60
    assert np.mean(np.array(z) < 3) >= 0.95


def test_a_centre_that_is_wrong_is_refused_or_in_the_errors(arm, currents):
    """At 5 mm from the truth gains change by less than a tenth: the stated errors have the change."""
    guessed = LOAD._replace(com=(0.1, 0.0, 0.1), inertia=None)
    with pytest.raises(
        rne.IdentificationError,
        match=r"^`payload`: the currents contradict the load as given: gains would be .*joint_4 4\.2\d, not 3\.0\d "
        r".* Give its mass alone, `payload=3`, to have the rest estimated$",
    ):
        rne.identify_drive_gains(arm, *currents, guessed)
    near = rne.identify_drive_gains(arm, *currents, LOAD._replace(com=(0.043, -0.03, 0.08)))
    assert (np.abs(near.gains - GAINS[THREE]) < 3 * near.errors).all()
    assert near.errors[1] > 0.005 * GAINS[THREE][1]


def test_negative_gains_are_refused_with_what_may_cause_them(arm, currents):
    turned = [Record(r.t, r.q, r.tau * [1, -1, 1]) for r in currents]
    with pytest.raises(
        rne.IdentificationError,
        match=r"^gains come out negative: joint_4 -3\.\d+ \(\+- 0\.\d+\): change the sign of its current in all records$",
    ):
        rne.identify_drive_gains(arm, *turned, LOAD.mass)
    with pytest.raises(rne.IdentificationError, match=r"records without and with the load exchanged, or all currents"):
        rne.identify_drive_gains(arm, *currents[::-1], LOAD.mass)


@pytest.mark.parametrize("call", [rne.identify_payload, rne.identify_drive_gains])
def test_a_record_of_both_sets_is_refused(robot, measured, call):
    more = () if call is rne.identify_payload else (3.0,)
    text = "^`with_load` has a record that the others have too, 'record': one is the wrong file$"
    copied = Record(measured[0].t, measured[0].q, measured[0].tau)
    with pytest.raises(ValueError, match=text):
        call(robot, measured[0], [measured[1], copied], *more)


@pytest.mark.parametrize("cutoff", [5.0, 8.0])
def test_a_record_of_both_sets_is_seen_with_another_delay_and_cutoff(arm, three, cutoff):
    """Records were found late by 0 and 6 ms, the next ones are taken to be late by their mean."""
    records = three[0], late(three[0], 0.006)
    first = rne.identify(arm, records, consistent=False, causes=False, cutoff=5.0)
    np.testing.assert_allclose(first.delay[1] - first.delay[0], 0.006, atol=5e-4)

    for k, record in enumerate(records):
        with pytest.raises(ValueError, match=f"^`with_load` has a record that the others have too, 'run {k}': one is"):
            rne.identify_payload(first, None, Record(record.t, record.q, record.tau, name=f"run {k}"), cutoff=cutoff)
    other = Record(three[0].t, three[0].q, 1.001 * three[0].tau)
    with pytest.warns(rne.IdentificationWarning, match="^the mass is known to "):
        rne.identify_payload(first, None, other, cutoff=cutoff)


def test_gains_of_a_mass_alone_need_no_frame():
    """The last link of a UR5 ends in frames of one point and different axes."""
    arm = robot_of("ur5").locked({"shoulder_pan_joint": 0.0, "elbow_joint": 0.5, "wrist_3_joint": 0.3})
    found = rne.identify_drive_gains(arm, *logs(arm, LOAD, noise=QUIET, units=GAINS), 3.0)
    assert (np.abs(found.gains - GAINS[THREE]) < 3 * found.errors).all()


def test_a_load_far_from_its_place_is_refused_with_a_cure(robot):
    arm = robot.locked({"joint_1": 0.3})
    records = logs(arm, LOAD, units=GAINS[1:], rate=100.0, friction=(VISCOUS[1:], COULOMB[1:]))
    with pytest.raises(
        rne.IdentificationError, match=r"does not settle: are its centre, inertia and link right\? Give"
    ):
        rne.identify_drive_gains(arm, *records, LOAD._replace(com=[-0.04, 0.03, -0.08]))


def late(record, seconds):
    """The record with torques that are measured later."""
    tau = np.column_stack([np.interp(record.t - seconds, record.t, x) for x in record.tau.T])
    return Record(record.t, record.q, tau, joint_names=record.joint_names)


def test_delays_are_estimated_and_may_be_given(arm, three):
    """6 and 4 ms, of 8 between samples: each set of records by itself."""
    options = {"cutoff": 5.0, "link": "tool0"}
    sets = rne.identify_payload(arm, late(three[0], 0.006), late(three[1], 0.004), **options).sets
    for data, true in zip(sets.data, (0.006, 0.004), strict=True):
        np.testing.assert_allclose(data.delays, true, atol=5e-4)  # a tenth of it: the noise of these records
        told = (
            f"record: torques are measured {1000 * data.delays[0, 0]:.3g} ms later than positions; taken into account"
        )
        assert data.notes[-1] == told
    as_given = rne.identify_payload(arm, *three, delay=0.01, **options).sets
    assert all((data.delays == 0.01).all() for data in as_given.data)
    with pytest.raises(ValueError, match=r"^`delay` must be at most 1 s, got 4: give seconds, 0.005 for 5 ms$"):
        rne.identify_payload(arm, *three, delay=4)


@pytest.mark.parametrize("seconds", [0.006, pytest.param(0.0, marks=pytest.mark.long)])
def test_delays_of_currents_are_estimated_though_their_unit_is_not_known(arm, currents, seconds, monkeypatch):
    """The first gains do for them; all later steps have the delays."""
    seen = []

    def stop(sets):
        seen.extend(sets.data)
        raise rne.IdentificationError("far enough")

    monkeypatch.setattr("rne.identification.drive_gains.of_all_joints", stop)
    with pytest.raises(rne.IdentificationError, match="far enough"):
        rne.identify_drive_gains(arm, *(late(record, seconds) for record in currents), LOAD.mass)
    for data in seen:
        np.testing.assert_allclose(data.delays, seconds, atol=5e-4 * bool(seconds))


@pytest.mark.long
def test_loads_and_gains_of_late_torques_are_as_wrong_as_their_errors_say(arm, three, currents):
    load = rne.identify_payload(arm, late(three[0], 0.006), late(three[1], 0.004), link="tool0")
    assert abs(load.mass - LOAD.mass) < 3 * load.mass_error
    found = rne.identify_drive_gains(arm, *(late(record, 0.006) for record in currents), LOAD)
    assert (np.abs(found.gains - GAINS[THREE]) < 3 * found.errors).all()


@pytest.mark.parametrize("mass", [0.0, -3.0])
def test_gains_need_a_positive_mass(robot, measured, mass):
    with pytest.raises(ValueError, match=rf"^`payload` must be positive, got {mass}$"):
        rne.identify_drive_gains(robot, *measured, mass)


def test_gains_that_are_known_poorly_warn(arm):
    load = rne.Payload(1.0, (0.05, 0.0, 0.08), link="tool0")
    records = logs(arm, load, noise=0.01, rate=100.0, units=GAINS)
    with pytest.warns(rne.IdentificationWarning, match=r"^gains are known poorly: joint_2 to "):
        rne.identify_drive_gains(arm, *records, 1.0)


@pytest.fixture(scope="module")
def other_currents(arm):
    """Records of the arm of three with another load, whose torques are currents."""
    return logs(arm, OTHER, seed=5, noise=QUIET, units=GAINS)[1]


@pytest.fixture(scope="module")
def together(gains, other_currents):
    return rne.identify_payload(gains, None, other_currents, link="tool0")


def test_gains_and_another_load_are_found_together(gains, together):
    found = together
    assert abs(found.mass - OTHER.mass) < min(3 * found.mass_error, 0.01 * OTHER.mass)
    assert (np.abs(found.com - OTHER.com) < 3 * found.com_error).all()
    assert (np.abs(found.inertia - OTHER.inertia) < 3 * found.inertia_error).all()
    assert (np.abs(found.gains - GAINS[THREE]) < 3 * found.gain_errors).all()
    assert (found.gain_errors < 1.5 * gains.errors).all()  # a third record tells more of them
    assert found.held_out_rms.shape == (3, 2, 3)
    report = found.report()
    assert "drive gains [N m or N per unit]" in report
    assert "no load [%]  load weighed [%]  load [%]" in report
    assert "standard errors contain those of the gains" in report
    assert found.causes == ()


def test_a_load_is_as_heavy_as_the_one_that_was_weighed(gains, other_currents, together):
    """Of a load that is weighed twice as heavy gains and the other load are twice as large."""
    currents = dataclasses.replace(gains.currents, known=2 * gains.currents.known)
    doubled = dataclasses.replace(gains, currents=currents)
    other = rne.identify_payload(doubled, None, other_currents, link="tool0")
    np.testing.assert_allclose([other.mass, *other.gains], [2 * together.mass, *(2 * together.gains)], rtol=1e-6)
    np.testing.assert_allclose(other.com, together.com, rtol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("name", ["arm", "ur5"])
def test_gains_and_loads_of_100_runs_are_within_two_standard_errors(arm, name):
    """Masses, centres, inertias and gains, in 95 % of the runs; of every second load weighed the mass alone is given."""
    robot, z = arm if name == "arm" else robot_of(name), []
    for seed in range(100 if name == "arm" else 20):
        rng = np.random.default_rng(seed)
        units = rng.uniform(2, 20, 6)
        known, load = (
            rne.Payload(mass, rng.uniform([-0.08, -0.08, 0], [0.08, 0.08, 0.16]), rng.uniform(2e-3, 6e-3) * np.eye(3))
            for mass in rng.uniform([2, 1], 5)
        )
        known, load = known._replace(link="tool0"), load._replace(link="tool0")
        calm = {"noise": QUIET, "units": units, "friction": (3.0, 2.0)}
        records = [*logs(robot, known, 2 * seed, **calm), logs(robot, load, 2 * seed + 1, **calm)[1]]
        gains = rne.identify_drive_gains(robot, *records[:2], known if seed % 2 else known.mass)
        found = rne.identify_payload(gains, None, records[2], link="tool0")
        inertia = ((found.inertia - load.inertia) / found.inertia_error)[np.triu_indices(3)]
        errors = [(found.mass - load.mass) / found.mass_error, *(found.com - load.com) / found.com_error, *inertia]
        z.append([*errors, *(found.gains - used(units, found.gains)) / found.gain_errors])
    inside = np.abs(z) < 2
    assert inside.mean() >= 0.95
    assert inside.mean(0).min() >= (0.95 if name == "arm" else 0.8)  # four of 20 are beyond by chance in one of 60


def test_gains_of_a_load_that_is_not_weighed_are_refused(arm, currents, gains, other_currents):
    with pytest.raises(
        ValueError, match=r"^`payload` must be a load that was weighed, got None: .*twice the gains fit"
    ):
        rne.identify_drive_gains(arm, *currents, None)
    with pytest.raises(
        ValueError, match=r"from records with it alone its mass cannot be separated .*, nor gains from masses$"
    ):
        rne.identify_drive_gains(arm, None, currents[1], LOAD)
    with pytest.raises(ValueError, match=r"^DriveGains have their records and drives: `without` and `drives` must be"):
        rne.identify_payload(gains, currents[0], other_currents)


CHANGED = {  # what else differs in the record with the load: its kind, joints and words
    "gain": (
        "torque factor",
        ("joint_4",),
        r"the torque of joint_4 is measured 1\.[12]\d* times with the load, not without it",
    ),
    "zero": (
        "joint zero",
        ("joint_4",),
        r"the zero of joint_4 is wrong by -?0\.0\d+ rad with the load, not without it",
    ),
    "offset": ("offset", ("joint_4",), r"the torque of joint_4 is 0\.\d+ N m larger with the load, not without it"),
    "base": ("gravity direction", (), r"gravity acts along .* degrees from the model's with the load, not without it"),
    "body": (
        "body",
        ("joint_3",),
        r"the body of link_3 is another one with the load: is a load there, or was the arm",
    ),
}


def changed(robot, arm, what):
    """Three joints and their records without and with a load, in the second of which something else differs."""
    records = []
    if what == "body":
        arm = robot.locked({name: 0.3 for k, name in enumerate(robot.joint_names) if k not in (1, 2, 4)})
    for k, scene in enumerate((arm, arm.with_payload(*LOAD))):
        if k and what == "base":
            model, tilt = scene.model, 0.05
            gravity = 9.81 * np.array([np.sin(tilt), 0, -np.cos(tilt)])
            scene = scene.with_model(dataclasses.replace(model, gravity=gravity))
        if k and what == "body":
            scene = scene.with_payload(3.0, (0.1, 0.1, 0.05), link="link_3")
        motion, here = truth(scene, 10.0, 125.0, seed=k), k * np.array([0, 1, 0])
        tau = (motion.tau + 2 * motion.qd + 1.5 * np.sign(motion.qd)) * (1 + 0.15 * (what == "gain") * here)
        noise = QUIET * np.abs(motion.tau).max(0)
        tau = tau + 0.6 * (what == "offset") * here + noise * np.random.default_rng(k).normal(size=tau.shape)
        records.append(Record(motion.t, motion.q + 0.05 * (what == "zero") * here, tau, joint_names=arm.joint_names))
    return arm, records


@pytest.mark.parametrize("what", kept([*CHANGED], ["gain", "body"]))
def test_what_else_differs_with_the_load_is_named(robot, arm, what):
    arm, records = changed(robot, arm, what)
    found = rne.identify_payload(arm, *records, link="tool0", consistent=False)
    kind, joints, text = CHANGED[what]
    first = found.causes[0]
    assert (first.kind, first.joints[: len(joints)]) == (kind, joints)
    assert re.match(text, first.text), first.text


def test_what_differs_with_the_load_is_named_where_it_lowers_an_error(robot, arm, monkeypatch):
    """Not because it is evident: by more than 5 % of a joint's error, and here by all of it."""
    monkeypatch.setattr(thresholds, "MATTERS", 1.0)
    arm, records = changed(robot, arm, "gain")
    found = rne.identify_payload(arm, *records, link="tool0", consistent=False)
    assert not any(cause.text.endswith("with the load, not without it") for cause in found.causes)


def test_what_a_load_on_a_scara_does_not_tell(tmp_path, no_causes):
    """All joints are along gravity: neither the height of the centre nor moments about horizontal axes are felt."""
    (tmp_path / "scara.urdf").write_text(SCARA)
    arm = rne.load(tmp_path / "scara.urdf")
    load = rne.Payload(2.0, (0.05, 0.02, 0.08), np.diag([0.010, 0.012, 0.007]), "l4")
    found = rne.identify_payload(arm, *logs(arm, load, noise=QUIET, friction=(3.0, 2.0)))
    assert found.unknown == ("its centre along (0.00, 0.00, 1.00), as gravity", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz")
    assert abs(found.mass - 2) < min(3 * found.mass_error, 0.01)
    assert (np.abs(found.com - load.com) < 3 * found.com_error)[:2].all()
    assert "taken as of a ball of 3000 kg/m^3" in " ".join(found.report().split())


def test_directions_that_are_not_told_have_names():
    """Of ten parameters, equations tell those that the names leave; gravity across the axis is not named."""
    known = np.diag([1e6] * 10 + [0.0])
    known[1:4, 1:4] -= 1e6 * np.outer([0.6, 0, 0.8], [0.6, 0, 0.8])
    known[[4, 6]] = 0
    known[4, [4, 6]] = 1e6
    down = np.array([[0, 1, 0], [0, 0, 1.0]])
    assert unknown_parts(known, 3.0, down) == ("its centre along (0.60, 0.00, 0.80)", "Ixx", "Iyy")
    assert unknown_parts(np.diag([1e6] * 11), 3.0, down) == ()
    assert unknown_parts(np.diag([1e6] + [0.0] * 10), 3.0, down) == ("its centre", "its inertia")


def test_errors_held_out_are_those_of_the_load_and_the_parameters_alone(arm, no_causes):
    """Friction that changed is in the errors with the load, beside which those without it are small."""
    found = rne.identify_payload(arm, *faulty(arm, LOAD, Faults.warmer), link="tool0")
    errors, torques = found.held_out_rms[1]
    data = found.sets.data[1]
    np.testing.assert_allclose(
        torques, [np.sqrt(np.mean(x[used] ** 2)) for x, used in zip(data.tau.T, data.used.T, strict=True)]
    )
    np.testing.assert_allclose(found.held_out, errors / torques, rtol=1e-12)
    assert (errors > 3 * found.estimate.sigma).all()
    assert (found.held_out_rms[0, 0] < errors / 5).all()  # by 20 % of the friction, not of the noise alone
    row = next(line for line in found.report().splitlines() if line.startswith("  joint_4"))
    assert [float(x) for x in row.split()[2:4]] == pytest.approx([100 * found.held_out[1], errors[1]], rel=0.01)


def test_errors_held_out_of_drives_that_do_not_change_are_those_of_an_identification(arm, no_causes):
    """Also where terms for errors of the drives fit better than Coulomb friction, whose steps are smooth here."""
    records = faulty(arm, LOAD, lambda tau, qd, k: tau + COULOMB[THREE] * np.tanh(10 * qd) + VISCOUS[THREE] * qd)
    found = rne.identify_payload(arm, *records, link="tool0")
    drives = rne.DriveModel(friction="viscous+coulomb")
    alone = rne.identify(arm, records[1], drives=drives, consistent=False, causes=False)
    assert (found.validation_error < 1.5 * alone.validation_error).all()  # other blocks, other noise


def test_torques_are_compared_with_those_of_the_robot_given(arm, three, no_causes):
    louder = [Record(r.t, r.q, 1.1 * r.tau, joint_names=arm.joint_names) for r in three]
    found = rne.identify_payload(arm, *louder, link="tool0")
    note = "torques of the bodies without the load are 1.1 times those of the robot given: if its masses are right, the load"
    assert found.notes[-1] == f"{note} has 3 kg, not 3.3"
    assert " % if the torques are right, see below; " in found.report().replace("\n", " ").replace("  ", " ")


def test_a_load_of_fewer_joints_than_the_arm_was_identified_from_is_refused(arm, three):
    """Without the warning on joints that would be locked."""
    alone = rne.identify(
        arm, three[0], drives=rne.DriveModel(friction="viscous+coulomb"), consistent=False, causes=False
    )
    fewer = three[1].part(slice(None), arm.joint_names[:2])
    text = f"`with_load` must have all joints of the other records, it lacks {[arm.joint_names[2]]}"
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        rne.identify_payload(alone, None, fewer, link="tool0")


def test_the_record_that_the_arm_was_identified_from_has_no_load(arm, three, gains, currents):
    alone = rne.identify(
        arm, three[0], drives=rne.DriveModel(friction="viscous+coulomb"), consistent=False, causes=False
    )
    text = "^`with_load` has a record that the others have too, 'record': one is the wrong file$"
    for known, record in ((alone, three[0]), (gains, currents[1])):
        with pytest.raises(ValueError, match=text):
            rne.identify_payload(known, None, record, link="tool0")
