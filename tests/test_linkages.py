"""Where linkages end and how often they turn, in closed form: dead points, full turns, scales; what couplings combine with."""

from dataclasses import replace

import numpy as np
import pytest

import rne
from rne.dynamics.kinematics import joint_accelerations, joint_positions, joint_velocities
from rne.elementwise import tanh
from rne.model import coupled, cylinder, four_bar, slider_crank

from .helpers import kept
from .test_couplings import linkage, part, tree

ENDS = 1e-9  # of the size: dead points
CLOSED = 1e-13  # of the size: some hundred rounding errors
Z = (0.0, 0.0, 1.0)
FREE = {"axis": Z, "lower": -np.inf, "upper": np.inf}


def bars(a, b, c, g, angle, side=1.0, scale=1.0, signs=(1, 1, 1), **limits):
    """A four-bar of crank, coupler, rocker and ground in the plane of x and y: the open tree and its closing pivot."""
    A, B = a * np.array([np.cos(angle), np.sin(angle)]), np.array([g, 0.0])
    d = np.linalg.norm(A - B)
    along = (c * c - b * b + d * d) / (2 * d)
    e = (A - B) / d
    C = B + along * e + side * np.sqrt(c * c - along * along) * np.array([-e[1], e[0]])
    A, B, C = (scale * np.append(x, 0.0) for x in (A, B, C))
    places = ("crank", 0, 0 * A), ("coupler", 1, A), ("rocker", 0, B)
    options = [
        FREE | {"axis": (0, 0, sign)} | limits.get(name, {}) for sign, (name, *_) in zip(signs, places, strict=True)
    ]
    parts = [part(*place, **option) for place, option in zip(places, options, strict=True)]
    return tree(*parts), (("coupler", tuple(C - A)), ("rocker", tuple(C - B)))


def jack(arm, gap, angle, scale=1.0, signs=(1, 1, 1)):
    """A boom on the origin, a cylinder from a pivot at `gap` to its end, which is at `angle` from there."""
    X, Z0 = arm * np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([gap, 0.0, 0.0])
    w = X - Z0
    along = {"kind": "prismatic", "axis": signs[2] * w, "lower": -np.inf, "upper": np.inf}
    options = FREE | {"axis": (0, 0, signs[0])}, FREE | {"axis": (0, 0, signs[1])}
    places = ("boom", 0, 0 * X), ("barrel", 0, scale * Z0)
    parts = [part(*place, **option) for place, option in zip(places, options, strict=True)]
    closing = (("piston", tuple(scale * 0.4 * w)), ("boom", tuple(scale * X)))
    return tree(*parts, part("piston", 2, scale * 0.6 * w, **along)), closing


def gap_of(model, closing, q):
    """How far the loop is open at most."""
    T = rne.dynamics.link_poses(model, q)
    ends = [T[:, model.link_index(link)] @ np.append(point, 1.0) for link, point in closing]
    return np.abs(ends[0] - ends[1])[:, :3].max()


def follows(model, closing, low, high, scale, step, samples=1001):
    """Check that positions of joints that turn are continuous, and that the loop is closed, between two ends."""
    q = np.linspace(low, high, samples)[:, None]
    positions = joint_positions(model, q)
    assert np.abs(np.diff(positions, axis=0))[:, model.is_revolute].max() < step
    assert gap_of(model, closing, q) < CLOSED * scale


@pytest.mark.parametrize("scale", kept([1e-6, 1.0, 1e4], [1e-6]))
def test_a_slide_ends_where_its_linkage_does(scale):
    """At lengths of 0.3 and 1.7 m of an arm of 1 m and a gap of 0.7 m, whatever the slide's own range; no negative length."""
    for angle, sense in ((2.0, 1), (-2.0, -1)):
        open_tree, closing = jack(1.0, 0.7, angle, scale, (1, -1, sense))
        model, k = cylinder(open_tree, "piston", closing), 2
        length = np.sqrt(1 + 0.49 - 1.4 * np.cos(angle))
        low, high = sorted(sense * scale * (np.array([0.3, 1.7]) - length))
        assert abs(model.lower[k] - low) < ENDS * scale
        assert abs(model.upper[k] - high) < ENDS * scale
        own = np.array([np.inf, np.inf, 5 * scale])
        within = cylinder(replace(open_tree, lower=-own, upper=own), "piston", closing)
        assert (within.lower[k], within.upper[k]) == (model.lower[k], model.upper[k])
        follows(model, closing, 0.999 * low, 0.999 * high, scale, 0.1)
        for length_now in (0.29, -0.5, -1.0, 1.71):
            with pytest.raises(rne.NotFiniteError, match="cannot follow 'piston'"):
                rne.dynamics.gravity_torque(model, [sense * scale * (length_now - length)])


def test_a_cylinder_between_equal_arms_ends_at_length_zero():
    open_tree, closing = jack(0.8, 0.8, 1.0)
    length = 1.6 * np.sin(0.5)
    assert cylinder(open_tree, "piston", closing).lower[2] == pytest.approx(-length, abs=ENDS)
    by_boom = cylinder(open_tree, "boom", closing)
    assert by_boom.lower[0] == pytest.approx(-1.0, abs=ENDS)
    assert by_boom.upper[0] == pytest.approx(2 * np.pi - 1.0, abs=ENDS)
    with pytest.raises(rne.NotFiniteError, match="cannot follow 'boom'"):
        rne.dynamics.gravity_torque(by_boom, [-1.01])


@pytest.mark.parametrize(("arm", "gap", "turns"), [(1.0, 0.7, 1), (0.7, 1.0, 0)])
def test_a_cylinder_swings_around_with_the_longer_arm(arm, gap, turns):
    open_tree, closing = jack(arm, gap, 2.0, signs=(-1, 1, 1))
    model = cylinder(open_tree, "boom", closing)
    assert np.isinf(model.upper[0])
    follows(model, closing, -40.0, 40.0, 1.0, 0.3)
    swing = np.diff(joint_positions(model, np.array([[0.0], [6 * np.pi]]))[:, 1])
    assert swing == pytest.approx(-6 * np.pi * turns, abs=1e-12)


@pytest.mark.parametrize("driver", kept(["crank", "coupler", "rocker"], ["crank"]))
def test_a_drag_link_counts_its_turns(driver):
    """The ground is the shortest link: crank and rocker turn around together."""
    open_tree, closing = bars(0.5, 0.45, 0.55, 0.2, 0.8, signs=(1, -1, -1))
    model = four_bar(open_tree, driver, closing)
    k = model.moving_joints.index(driver)
    low, high = np.clip([0.999 * model.lower[k], 0.999 * model.upper[k]], -20, 20)
    follows(model, closing, low, high, 1.0, 0.15)
    if driver == "crank":
        assert joint_positions(model, np.array([[20 * np.pi]]))[0, 2] == pytest.approx(-20 * np.pi, abs=1e-12)


@pytest.mark.parametrize("scale", kept([1e-6, 1.0, 1e4], [1e-6]))
def test_a_hole_narrower_than_samples_is_found(scale):
    """A crank that is longer by 1e-10 of the size than one that turns around: 2e-5 rad are missing."""
    a, b, g = 0.3, 0.7, 0.8
    c = b + (g - a) + 1e-10  # nearest ends are g - a apart, c - b is what they need
    open_tree, closing = bars(a, b, c, g, 2.0, scale=scale)
    model = four_bar(open_tree, "crank", closing)
    half = 2 * np.arcsin(np.sqrt(((c - b) ** 2 - (g - a) ** 2) / (4 * a * g)))  # by the law of cosines
    assert half == pytest.approx(2e-5, rel=0.3)
    assert model.lower[0] == pytest.approx(half - 2.0, abs=1e-6 * half + ENDS)
    assert model.upper[0] == pytest.approx(2 * np.pi - half - 2.0, abs=1e-6 * half + ENDS)


KITE, CROSSED, ALIKE = (0.9, 1.0, 1.0, 0.9), (0.4, 0.9, 0.4, 0.9), (0.5, 0.5, 0.5, 0.5)


@pytest.mark.parametrize(("lengths", "turn"), kept([(KITE, 2), (CROSSED, 1), (ALIKE, 1)], [(CROSSED, 1)]))
def test_change_points_end_a_range(lengths, turn):
    """A kite, and crossed links of equal length: where all pivots are in line the branches meet."""
    open_tree, closing = bars(*lengths, 1.0)
    model = four_bar(open_tree, "crank", closing)
    assert model.lower[0] == pytest.approx(-1.0, abs=1e-7)
    assert model.upper[0] == pytest.approx(turn * np.pi - 1.0, abs=1e-7)
    for behind in (model.lower[0] - 0.01, model.upper[0] + 0.01):
        with pytest.raises(rne.NotFiniteError, match="cannot follow 'crank'"):
            rne.dynamics.gravity_torque(model, [behind])


def test_ranges_of_joints_that_follow_cut_between_samples():
    """A rocker whose last 1e-9 rad are out of its range: a hole of the crank that is a thousandth of a sample wide."""
    open_tree, closing = bars(0.2, 0.7, 0.6, 0.8, 1.0)
    free = four_bar(open_tree, "crank", closing)
    q = np.linspace(0.0, 2 * np.pi, 40001)[:, None]
    rocker = joint_positions(free, q)[:, 2]
    top = rocker.max()
    limited = bars(0.2, 0.7, 0.6, 0.8, 1.0, rocker={"upper": top - 1e-9, "lower": -9.0})[0]
    model = four_bar(limited, "crank", closing)
    at = float(q[rocker.argmax(), 0])
    ends = sorted((float(model.lower[0]) + 2 * np.pi, float(model.upper[0])))
    assert max(abs(end - at) for end in ends) < 1e-3
    assert joint_positions(model, model.upper[:1])[2] == pytest.approx(top - 1e-9, abs=1e-14)


@pytest.mark.parametrize(
    ("angle", "crank", "rod"),
    kept([(4.0, 0.2, 0.5), (-7.0, 0.2, 0.5), (0.3, 0.5, 0.2), (2.9, 0.5, 0.2)], [(4.0, 0.2, 0.5), (2.9, 0.5, 0.2)]),
)
def test_a_slider_drives_from_any_angle(angle, crank, rod):
    """Beyond half a turn, with a rod that is shorter than the crank, and behind the crank's axis."""
    pin = crank * np.array([np.cos(angle), np.sin(angle), 0.0])
    x = pin[0] + np.sqrt(rod**2 - pin[1] ** 2)
    slider = part("slider", 0, (x, 0, 0), kind="prismatic", axis=(1, 0, 0), lower=-np.inf, upper=np.inf)
    open_tree = tree(slider, part("rod", 1, (0, 0, 0), **FREE), part("crank", 0, (0, 0, 0), **FREE))
    value = slider_crank("slider", crank=crank, rod=rod, angle=angle)
    model = coupled(open_tree, {"rod": value, "crank": value})
    reach = np.sort(np.sign(x) * np.array([abs(crank - rod), crank + rod])) - x
    assert np.abs(np.array([model.lower[0], model.upper[0]]) - reach).max() < ENDS
    closing = ("rod", tuple(pin - [x, 0, 0])), ("crank", tuple(pin))
    assert np.abs(joint_positions(model, np.zeros(1))).max() < 1e-14
    follows(model, closing, 0.999 * model.lower[0], 0.999 * model.upper[0], 1.0, 0.2)
    assert model.loops[0].name == "rod to crank"


@pytest.mark.long
def test_springs_at_drag_links_keep_energy():
    open_tree, closing = bars(0.5, 0.45, 0.55, 0.2, 0.8)
    robot = rne.Robot(four_bar(replace(open_tree, gravity=np.zeros(3)), "crank", closing))
    scene = rne.Scene(robot, springs=[rne.Spring.at_joint("rocker", 5.0, 0.0)])
    motion = rne.simulate(scene, [1.0], [9.0], 3.0, rtol=1e-10, atol=1e-11)
    assert np.ptp(motion.q) > 2 * np.pi
    assert motion.energy_drift < 1e-7


def test_couplings_may_be_added_in_any_order():
    arm = rne.irb140()
    last, middle = {"joint_4": (["joint_3"], lambda x: 0.3 * np.cos(x))}, {"joint_3": (["joint_2"], lambda x: tanh(x))}
    models = coupled(arm, {**last, **middle}), coupled(coupled(arm, middle), last), coupled(coupled(arm, last), middle)
    q = np.array([0.1, 0.4, 0.2, -0.3])
    wanted = [0.1, 0.4, np.tanh(0.4), 0.3 * np.cos(np.tanh(0.4)), 0.2, -0.3]
    for model in models:
        assert joint_positions(model, q) == pytest.approx(wanted, abs=1e-15)


def test_parallelograms_behind_another_close_in_either_order():
    """Second drivers that follow already; a joint that would follow twice is refused."""
    from .test_closing_forces import ALL, closed_levels, levels

    outwards, inwards = ALL["levels"]()[0], closed_levels(("forearm", "upper", "bone"))[0]
    q = np.random.default_rng(0).uniform(-0.5, 0.5, (5, 2))
    assert np.abs(joint_positions(outwards, q) - joint_positions(inwards, q)).max() < 1e-14
    with pytest.raises(rne.ModelError) as error:
        four_bar(outwards, "upper", levels()[1]["upper"])
    assert str(error.value) == (
        "the loop must have 3 or 4 joints, 'upper' and others that follow none, all rotating; it has ['upper', 'forearm', "
        "'rod', 'lever']"
    )


def test_cases_share_their_couplings():
    def geared(ratio):
        return rne.Robot(coupled(rne.irb140(), {"joint_3": (["joint_2"], lambda x: ratio * np.sin(x))}))

    first, same, other = geared(0.5), geared(0.5).with_payload(1.0, link="tool0"), geared(1.5)
    assert rne.control.MomentumObserver(first, cases=[same]).cases == (same,)
    with pytest.raises(ValueError, match="only in masses, centres of mass and inertias, not in couplings"):
        rne.control.MomentumObserver(first, cases=[other])


def test_limits_of_joints_that_follow_go_by_name():
    robot = rne.Robot(linkage("bar")[0])
    limited = robot.with_limits(velocity={"rocker": 1.5, "crank": 3.0}, acceleration={"coupler": 9.0})
    assert limited.model.velocity_limit.tolist() == [3.0, np.inf, 1.5, np.inf]
    assert limited.model.acceleration_limit.tolist() == [np.inf, 9.0, np.inf, np.inf]
    with pytest.raises(ValueError, match=r"`effort` must name joints of \['crank', 'arm'\], got 'rocker'"):
        robot.with_limits(effort={"rocker": 1.0})


def test_robots_with_couplings_are_checked(capsys):
    weak = np.array([100.0, np.inf, np.inf, 0.01])
    assert [str(x) for x in rne.check(rne.Robot(linkage("bar")[0]))] == []
    (found,) = rne.check(replace(linkage("bar")[0], effort_limit=weak))
    assert "the drive cannot carry the robot's weight" in str(found)
    assert "'arm'" in str(found)


@pytest.mark.long
def test_fastest_motions_keep_limits_of_joints_that_follow():
    pytest.importorskip("toppra")
    robot = rne.Robot(linkage("bar")[0]).with_limits(
        effort=[400, 100], velocity={"rocker": 1.0}, acceleration={"coupler": 30.0}
    )
    motion = rne.trajectories.fastest(robot, [[-0.5, 0], [0.8, 0.4]])
    q, qd, qdd = motion(np.linspace(0, motion.duration, 2001))
    rocker = np.abs(joint_velocities(robot.model, q, qd)[:, 2]).max()
    coupler = np.abs(joint_accelerations(robot.model, q, qd, qdd)[:, 1]).max()
    assert 0.99 < rocker < 1.001  # what `fastest` promises
    assert 29 < coupler < 30.03


def test_paths_stay_in_the_ranges_of_joints_that_follow():
    two = coupled(rne.irb140(), {"joint_5": (["joint_2", "joint_4"], lambda a, b: a + b)})
    robot = rne.Robot(two).with_limits(effort=[250, 250, 150, 50, 20])
    with pytest.raises(
        ValueError, match=r"^`path` leaves the range of joint 'joint_5', -2.094 to 2.094: 3 at via point 1$"
    ):
        rne.trajectories.fastest(robot, [[0] * 5, [0, 1.5, 0, 1.5, 0]])
