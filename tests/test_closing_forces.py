"""Forces in the pivots of closed linkages: by hand, by multipliers on the open tree, by MuJoCo's equality constraints."""

import copy
import pickle
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

import rne
from rne.dynamics import inverse_dynamics, jacobian, link_poses, recursion
from rne.dynamics.kinematics import joint_accelerations, joint_positions, joint_velocities
from rne.model import coupled, four_bar, slider_crank

from .helpers import kept
from .test_couplings import drawn, linkage, part, tree

LEAST_SQUARES = 1e-9  # relative: those of rows and columns of different size, near dead points more
BALANCE = 1e-12  # relative, of sums of some ten forces
LOOPS = ["bar", "press", "engine", "crane", "boom"]
G = 9.81


def levels():
    """A palletiser whose tool is kept level by two more parallelograms, one behind the other."""
    parts = [part("upper", 0, (0, 0, 0)), part("forearm", 1, (0, 0, 0.6)), part("lever", 0, (0, 0.1, 0))]
    parts += [part("rod", 3, (-0.2, 0, 0)), part("tool", 2, (0.7, 0, 0)), part("bone", 1, (0, 0.2, 0.6))]
    parts += [part("stay", 0, (0.1, 0.2, 0.15)), part("bar", 6, (0, 0, 0.25))]
    closings = {
        "upper": (("rod", (0, 0, 0.6)), ("forearm", (-0.2, 0.1, 0))),
        "bone": (("stay", (0, 0, 0.6)), ("bone", (0.1, 0, 0.15))),
        "forearm": (("bar", (0.7, 0, 0)), ("tool", (0, 0.2, 0.25))),
    }
    return tree(*parts), closings


def closed_levels(order=("upper", "bone", "forearm")):
    model, closings = levels()
    for name in order:
        model = four_bar(model, "upper" if name == "bone" else name, closings[name])
    return model, levels()[0], list(closings.values())


ALL = {name: partial(linkage, name) for name in LOOPS} | {"levels": cache(closed_levels)}
EVERY = kept([*ALL], ["crane", "levels"])


def states(model, samples=2):
    q, qd, _, qdd = drawn(model, samples)
    return 0.3 * q if model.n > 1 else q, qd, qdd


def by_least_squares(model, open_tree, closings, state, external):
    """f, tau on the open tree with the loops' forces, found together from all torques that nothing supplies."""
    q, qd, qdd = state
    place = joint_positions(model, q), joint_velocities(model, q, qd)
    motion = *place, joint_accelerations(model, q, qd, qdd)
    rows = []
    for (a, p), (b, r) in closings:
        J = jacobian(open_tree, place[0], a, point=p) - jacobian(open_tree, place[0], b, point=r)
        rows += [J[3], J[5]]
    tau = inverse_dynamics(open_tree, *motion, external=external)
    free = [i for i in range(open_tree.nb) if i not in model.independent_joints]
    forces, *_ = np.linalg.lstsq(np.array(rows)[:, free].T, tau[free], rcond=None)
    wrenches = {link: np.array(w) for link, w in (external or {}).items()}
    poses, found = link_poses(open_tree, place[0]), []
    for (x, z), ends in zip(forces.reshape(-1, 2), closings, strict=True):
        for sign, (link, point) in zip((1, -1), ends, strict=True):
            force = sign * poses[open_tree.link_index(link), :3, :3].T @ [x, 0, z]
            wrenches[link] = wrenches.get(link, 0) + np.concatenate([np.cross(point, force), force])
            found += [force] if sign == 1 else []
    record = recursion(open_tree, *motion, external=wrenches)
    return record.f, record.tau, np.array(found)


@pytest.mark.parametrize("name", EVERY)
def test_forces_are_those_of_multipliers_on_the_open_tree(name):
    model, open_tree, closings = ALL[name]()
    q, qd, qdd = states(model)
    rng = np.random.default_rng(1)
    external = {model.link_names[-1]: rng.normal(size=6), model.link_names[2]: rng.normal(size=6)}
    for wrenches in (None, external):
        record = recursion(model, q, qd, qdd, external=wrenches)
        assert record.not_known == ()
        assert record.pivots == tuple(" to ".join(link for link, _ in ends) for ends in closings)
        for k in range(len(q)):
            one = record.state(k)
            wanted = by_least_squares(model, open_tree, closings, (q[k], qd[k], qdd[k]), wrenches)
            for found, value in zip((one.f, one.tau, one.pivot_force), wanted, strict=True):
                assert np.abs(found - value).max() < LEAST_SQUARES * max(np.abs(x).max() for x in wanted)


@pytest.mark.parametrize("name", EVERY)
def test_nothing_drives_joints_that_follow(name):
    """Along their axes bearings carry what accelerates rotors, and along those of drivers the torques of the drives."""
    model, *_ = ALL[name]()
    q, qd, qdd = states(model)
    record = recursion(model, q, qd, qdd)
    rotors = model.armature * joint_accelerations(model, q, qd, qdd)
    along = (record.tau * model.angular_axis).sum(-1) + (record.f * model.linear_axis).sum(-1) + rotors
    size = np.abs(record.tau).max() + np.abs(record.f).max()
    follows = [i not in model.independent_joints for i in range(model.nb)]
    assert np.abs(along[:, follows]).max() < BALANCE * size
    assert np.abs(along[:, list(model.independent_joints)] - record.u).max() < BALANCE * size
    assert np.abs(record.u - inverse_dynamics(model, q, qd, qdd)).max() < BALANCE * size


def lamp():
    """A level head of 30 kg, 0.25 m before its pin, on an upper arm of 8 kg; a tie rod of 1.5 kg, 0.15 m behind it."""

    def link(name, parent, at, mass, com):
        return part(name, parent, at, mass=mass, com=np.array(com), inertia=np.eye(3), armature=0.0)

    parts = link("upper", 0, (0, 0, 0.2), 8.0, (0, 0, 0.35)), link("tie", 0, (-0.15, 0, 0.2), 1.5, (0, 0, 0.35))
    return tree(*parts, link("head", 1, (0, 0, 0.7), 30.0, (0.25, 0, 0)))


PULL = 30 * G * 0.25 / 0.15  # of the tie on the head, which turns about its pin on the upper arm
BY_HAND = {"upper": 8 * G + 30 * G + PULL, "tie": abs(1.5 * G - PULL), "head": 30 * G + PULL, "tie to head": PULL}


class Rest:
    duration = 0.01

    def __init__(self, n):
        self.n = n

    def __call__(self, t):
        return (np.zeros((*np.shape(t), self.n)),) * 3


TIE = (("tie", (0, 0, 0.7)), ("head", (-0.15, 0, 0)))


def test_a_lamp_by_hand():
    closed = four_bar(lamp(), "upper", TIE)
    for model in (closed, pickle.loads(pickle.dumps(closed)), copy.deepcopy(closed)):
        peaks = rne.bearing_peaks(rne.Robot(model), Rest(1))
        assert dict(zip(peaks.joints, peaks.force, strict=True)) == pytest.approx(BY_HAND, rel=1e-12)
    assert "\ntie to head    490.5           0             0         0" in str(peaks)
    assert rne.drives(rne.Robot(closed), Rest(1)).bearings.joints == peaks.joints
    text = str(rne.Robot(closed).recursion([0], [0], [0]))
    assert "Pivots that close linkages: f on the first link, in its axes, in the plane of the linkage.\n" in text
    assert [line.split() for line in text.splitlines()[-2:]] == [
        ["tie", "to", "head,", "closing", "pivot"],
        ["f", "N", "0", "0", "490.5"],
    ]


def test_what_is_made_of_a_robot_keeps_its_pivots():
    """With a payload, other rotors, on a slope, with a joint locked that carries the linkage or is carried by it."""
    model, open_tree, (closing,) = linkage("bar")
    robot = rne.Robot(model)
    state = np.array([0.3, 0.2]), np.array([1.0, -1.0]), np.array([2.0, 0.5])
    changes = {
        "payload": lambda r: r.with_payload(5.0, (0.1, 0.2, 0.3), link="coupler"),
        "armature and slope": lambda r: r.with_armature(0.3).mounted([0.3, 0.2, 0.1]).with_limits(velocity=3.0),
    }
    for change in changes.values():
        changed, whole = change(robot), change(rne.Robot(open_tree))
        f, tau, force = by_least_squares(changed.model, whole.model, [closing], state, None)
        record = changed.recursion(*state)
        assert np.abs(record.f - f).max() < LEAST_SQUARES * np.abs(f).max()
        assert np.abs(record.pivot_force - force).max() < LEAST_SQUARES * np.abs(f).max()
        assert np.abs(record.tau - tau).max() < LEAST_SQUARES * np.abs(tau).max()
    assert robot.locked({"crank": 0.3}).model.loops == ()
    kept_closed, arm = robot.locked({"arm": 0.2}), np.array([0.3, 0.2])
    assert kept_closed.model.loops == model.loops
    both = [r.recursion(x, 0 * x, 0 * x) for r, x in ((kept_closed, arm[:1]), (robot, arm))]
    assert np.abs(both[0].pivot_force - both[1].pivot_force).max() < BALANCE * np.abs(both[0].f).max()
    lever = rne.Robot(closed_levels()[0]).locked({"lever": 0.1})  # of two drivers one is left
    assert np.isfinite(lever.recursion(*np.full((3, 1), 0.1)).pivot_force).all()
    assert len(lever.model.loops) == 3


def test_springs_at_joints_that_follow_load_the_pivots():
    """A torsion spring at the head's pin takes 20 of the 73.575 N m that the tie holds; a coil spring along a piston."""
    scene = rne.Scene(
        rne.Robot(four_bar(lamp(), "upper", TIE)), springs=[rne.Spring.at_joint("head", stiffness=20.0, rest=-1.0)]
    )
    peaks = rne.bearing_peaks(scene, Rest(1))
    assert peaks.force[-1] == pytest.approx((30 * G * 0.25 - 20.0) / 0.15, rel=1e-12)
    model, open_tree, _ = linkage("boom")
    spring = rne.Spring("barrel", (0, 0, 0), "piston", (0, 0, 0), stiffness=900.0, length=0.0)
    at_joint = rne.Spring.at_joint("piston", stiffness=900.0, rest=-np.hypot(0.3, 0.35))
    both = [rne.bearing_peaks(rne.Scene(rne.Robot(model), springs=[x]), Rest(1)) for x in (spring, at_joint)]
    place = open_tree.moving_joints.index("boom")
    assert both[0].force[place] == pytest.approx(both[1].force[place], rel=1e-12)
    assert both[0].force[-1] == pytest.approx(both[1].force[-1], rel=1e-12)
    assert abs(both[0].force[-1] - rne.bearing_peaks(rne.Robot(model), Rest(1)).force[-1]) > 100


@pytest.mark.long
def test_order_of_closing_changes_nothing():
    orders = [("upper", "bone", "forearm"), ("forearm", "bone", "upper")]
    records = []
    for order in orders:
        record = recursion(closed_levels(order)[0], [0.2, 0.1], [0.3, -0.2], [1.0, 2.0])
        records.append((dict(zip(record.pivots, record.pivot_force, strict=True)), record.f))
    for pivots, f in records[1:]:
        assert pivots.keys() == records[0][0].keys()
        assert np.abs(f - records[0][1]).max() < BALANCE * np.abs(f).max()
        for name, force in pivots.items():
            assert np.abs(force - records[0][0][name]).max() < BALANCE * np.abs(f).max()


def gripper(joint="mimic"):
    """Two fingers on a hand on an arm; one follows the other."""
    parts = [part("arm", 0, (0, 0, 0)), part("hand", 1, (0, 0, 0.5))]
    slides = {"kind": "prismatic", "axis": (1, 0, 0)}
    parts += [
        part("left", 2, (0.1, 0, 0.1), **slides),
        part("right", 2, (-0.1, 0, 0.1), **slides),
        part("tip", 3, (0, 0, 0.1)),
    ]
    return coupled(tree(*parts), {"right": (("left",), (lambda x: -x) if joint == "mimic" else (lambda x: -np.sin(x)))})


@pytest.mark.parametrize("joint", ["mimic", "coupling"])
def test_forces_of_parts_that_are_not_there_are_not_known(joint, caplog):
    """What carries or is carried by both fingers has the forces of the open tree; u is right in any case."""
    model = gripper(joint)
    whole = gripper(joint), rne.Robot(model)
    record = whole[1].recursion(*np.full((3, 4), 0.1))
    assert record.not_known == ("left", "right")
    assert record.follow == ("right",)
    known = [i for i, name in enumerate(record.joints) if name not in record.not_known]
    assert np.isnan(record.f[[2, 3]]).all()
    assert np.isnan(record.tau[[2, 3]]).all()
    assert np.isfinite(record.f[known]).all()
    assert np.array_equal(record.u, whole[1].inverse_dynamics(*np.full((3, 4), 0.1)))
    peaks = rne.bearing_peaks(whole[1], Rest(4))
    assert np.isnan(peaks.force).tolist() == np.isnan(peaks.force_time).tolist() == [False, False, True, True, False]
    assert caplog.messages[-1] == (
        "Not known: forces in left, right, as what moves right is no part of the robot; rne.model.four_bar, cylinder and "
        "slider_crank close linkages with their pivots."
    )
    lines = str(peaks).splitlines()
    assert lines[4].split() == ["left", *["not", "known"] * 4]
    why = "Not known: forces in left, right, as what moves right is no part of the robot;"
    assert " ".join(lines[7:]).startswith(why)
    assert " ".join(str(record).split()).find(why) > 0


def test_a_linkage_with_a_part_that_is_not_there_is_not_known():
    """The wrist of the palletiser mimics its lever: a stay that is left out loads the whole linkage, not the turntable."""
    model, _, _ = linkage("palletiser")
    record = rne.Robot(model).recursion(*np.full((3, 2), 0.1))
    assert record.follow == ("tool",)
    assert record.not_known == (*model.moving_joints, "rod to forearm")
    assert np.isnan(record.pivot_force).all()
    partly = slider_crank("crank", crank=0.1, rod=0.5)
    _, open_tree, _ = linkage("press")
    free_slider = rne.Robot(coupled(open_tree, {"rod": partly}))
    assert free_slider.recursion(*np.full((3, 2), 0.1)).not_known == ("crank", "rod")


def test_motions_in_files_keep_pivots(tmp_path):
    model = four_bar(lamp(), "upper", TIE)
    robot = rne.Robot(model)
    motion = rne.simulate(robot, np.zeros(robot.n), np.zeros(robot.n), 0.01)
    assert rne.Trajectory.load(motion.save(tmp_path / "arm.npz")).model == model


def test_dead_points_determine_no_force():
    robot = rne.Robot(four_bar(lamp(), "upper", TIE))
    with pytest.raises(rne.NotFiniteError) as error:
        robot.recursion(np.array([[0.0], [np.pi / 2]]), *np.zeros((2, 2, 1)))
    text = "the force in the pivot tie to head is not determined at a dead point, where its links are in line"
    assert str(error.value) == f"{text} at state (1,)"


@pytest.mark.parametrize(
    ("loop", "text"),
    [
        ((("upper", "tie"), TIE), "`loops` must name joints that follow others, got ['upper', 'tie']"),
        ((("head", "tie"), (("x", (0, 0, 0)), TIE[1])), "`loops` must end at links of the robot, got x to head"),
        (
            (("head", "tie"), (("tie", (0, 0)), ("head", (0, 0)))),
            "`loops` must end at a point of each of two links, got (('tie', (0, 0)), ('head', (0, 0)))",
        ),
    ],
)
def test_loops_are_checked(loop, text):
    model = four_bar(lamp(), "upper", TIE)
    with pytest.raises(rne.ModelError) as error:
        replace(model, loops=(type(model.loops[0])(*loop),))
    assert str(error.value) == text


SOFT = 2e-4  # relative: MuJoCo's constraints yield by one part in 10^4 at least
FOUR_BAR = """<mujoco><option gravity="0 0 -9.81"/><worldbody>
  <body name="crank"><joint name="crank" axis="0 1 0" armature="0.1"/>
    <inertial pos="0.05 0 0.1" mass="3" diaginertia="0.02 0.03 0.04"/>
    <body name="coupler" pos="0 0 0.35"><joint name="coupler" axis="0 1 0"/>
      <inertial pos="0.4 0 0.1" mass="4" diaginertia="0.02 0.3 0.3"/></body></body>
  <body name="rocker" pos="0.8 0 0"><joint name="rocker" axis="0 1 0"/>
    <inertial pos="0.1 0 0.3" mass="5" diaginertia="0.1 0.2 0.1"/></body></worldbody>
  <equality><connect body1="coupler" body2="rocker" anchor="0.8 0 0.25" solref="0.01 1" solimp="0.9999 0.9999 0.01"/></equality>
</mujoco>"""


@pytest.mark.long
def test_mujocos_constraint_forces(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    (tmp_path / "open.xml").write_text(FOUR_BAR.replace("<equality>", "<!--").replace("</equality>", "-->"))
    open_tree = rne.load(tmp_path / "open.xml").model
    model = four_bar(open_tree, "crank", (("coupler", (0.8, 0, 0.25)), ("rocker", (0, 0, 0.6))))
    robot, theirs = rne.Robot(model), mujoco.MjModel.from_xml_string(FOUR_BAR)
    data = mujoco.MjData(theirs)
    for q, qd, tau in ((0.0, 0.0, 0.0), (0.4, 2.0, 30.0), (-0.3, -3.0, -20.0)):
        data.qpos[:], data.qvel[:] = (
            joint_positions(model, np.array([q])),
            joint_velocities(model, np.array([q]), np.array([qd])),
        )
        data.qfrc_applied[:] = [tau, 0, 0]
        mujoco.mj_forward(theirs, data)
        qdd = robot.forward_dynamics([q], [qd], [tau])
        record = robot.recursion([q], [qd], qdd)
        k = model.link_index("coupler")
        force = robot.link_poses([q])[k, :3, :3] @ record.pivot_force[0]
        assert np.abs(data.efc_force[:3] - force).max() < SOFT * np.abs(force).max()
