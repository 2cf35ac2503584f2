"""The fastest motion along a path: closed forms, limits by two engines, toppra's own solution, and what is refused."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest

import rne
from benchmarks.fastest import (
    friction_of,
    largest_deviation,
    largest_shares,
    random_path,
    robot_named,
    toppra_with_pinocchio,
)
from rne.trajectories import fastest, through

from .helpers import Oracle, Part, assemble, kept
from .random_robots import straight_chain

EXCEEDED = 1e-3  # of a limit, between the points of the grid
UNUSED = 0.99  # the least share of some limit that the fastest motion uses
DIFFERENT_SOLVERS = 1e-5  # of the duration; toppra reduces x by up to 1e-4 of it where it is small, 1e-8 elsewhere
GRID = 2e-4  # of the duration: toppra's steps
STEPS = 2.5e-3  # half of 0.5 % of the torque, which stays unused where friction changes along an interval of the grid
ARM = {"effort": [250, 250, 150, 50, 50, 20]}


def slider(effort=10.0, **limits):
    """A mass of 2 kg on a horizontal rail."""
    cart = Part(link="cart", joint="rail", kind="prismatic", parent=0, axis=np.array([1.0, 0, 0]), mass=2.0)
    return rne.Robot(assemble("slider", [Part(link="base"), cart])).with_limits(effort=effort, **limits)


@pytest.mark.parametrize("coulomb", [0.0, 4.0])
def test_a_mass_on_a_rail_is_driven_at_full_force_and_braked_at_full_force(coulomb):
    """d = T^2 / 2 / (1 / a1 + 1 / a2) with a1 = (F - Fc) / m and a2 = (F + Fc) / m."""
    speed_up, brake = (10 - coulomb) / 2, (10 + coulomb) / 2
    expected = np.sqrt(2 * 3.0 * (1 / speed_up + 1 / brake))
    motion = fastest(slider(), [[0.0], [3.0]], friction=rne.Friction(coulomb=coulomb), smoothing=0)
    assert motion.duration == pytest.approx(expected, rel=GRID)
    assert motion.torques([0.1 * expected, 0.9 * expected])[:, 0] == pytest.approx([10, -10], rel=EXCEEDED)


@pytest.mark.parametrize(
    ("effort", "acceleration", "deceleration", "used"),
    [
        (np.inf, 4, 1, (4, 1)),
        (np.inf, 1, 8, (1, 8)),
        (10, np.inf, 1, (5, 1)),
        (10, 2, np.inf, (2, 2)),
        (10, 9, 9, (5, 5)),
    ],
)
@pytest.mark.parametrize("way", [3.0, -3.0])
def test_a_mass_on_a_rail_brakes_with_its_deceleration(effort, acceleration, deceleration, used, way):
    """d = T^2 / 2 / (1 / a1 + 1 / a2), by a drive of 5 m/s^2 where it has a force; without a deceleration a2 = a1."""
    rail = slider(effort, acceleration=acceleration, deceleration=deceleration)
    expected = np.sqrt(2 * 3.0 * (1 / used[0] + 1 / used[1]))
    motion = fastest(rail, [[0.0], [way]], smoothing=0)
    assert motion.duration == pytest.approx(expected, rel=GRID)
    assert motion([0.01 * expected, 0.99 * expected])[2][:, 0] * np.sign(way) == pytest.approx(
        [used[0], -used[1]], rel=EXCEEDED
    )
    assert max(share.max() for share in motion.shares().values()) == pytest.approx(1, rel=EXCEEDED)


def test_every_joint_brakes_with_its_own_deceleration(arm):
    """At all times of a path on which joints turn around, in either direction; one of the limits is used."""
    limited = arm.with_limits(effort=np.inf, velocity=np.inf, acceleration=10, deceleration=[2, 20, 4, 5, 40, 7])
    points = np.random.default_rng(3).uniform(-1, 1, (3, 6))
    motion = fastest(limited, points, smoothing=0)
    _, qd, qdd = motion(np.linspace(0, motion.duration, 4001)[1:-1])
    share = np.abs(qdd) / np.where(qd * qdd < 0, limited.deceleration_limit, 10)
    assert share.max() <= 1 + EXCEEDED
    assert np.median(share.max(1)) >= UNUSED
    assert fastest(limited.with_limits(deceleration=2), points, smoothing=0).duration > motion.duration
    with pytest.raises(ValueError, match=r"^`robot`: the deceleration limit of joint 'joint_2' is 0$"):
        fastest(limited.with_limits(deceleration={"joint_2": 0}), points)


@pytest.mark.parametrize("c", [1e-3, 3.0, 400.0, 1e5])
def test_viscous_friction_slows_a_mass_as_the_closed_form_says(c):
    """m v' = F - c v up to the switch, m v' = -F - c v after it; the switch and T from d by a root."""
    from scipy.optimize import brentq

    m, F, d = 2.0, 10.0, 3.0

    def braking(v):
        return m / c * np.log(1 + c * v / F), m / c * (v - F / c * np.log(1 + c * v / F))

    def missed(T):
        v = F / c * (1 - np.exp(-c * T / m))
        return F / c * (T - m / F * v) + braking(v)[1] - d

    rise = brentq(missed, 1e-3, 10.0 + c * d / F)
    expected = rise + braking(F / c * (1 - np.exp(-c * rise / m)))[0]
    motion = fastest(slider(), [[0.0], [d]], friction=rne.Friction(viscous=c), smoothing=0)
    assert expected <= motion.duration <= expected * (1 + STEPS)


def beyond(motion, count=20_001):
    """The largest share of any limit at many times, around the corners of the motion too."""
    t = np.concatenate([np.linspace(0, motion.duration, count), (motion.instants[1:] + motion.instants[:-1]) / 2])
    (_, qd, qdd), limits = motion(t), motion.scene.robot.model.coordinate_limits()
    used = {"effort": motion.torques(t), "velocity": qd, "acceleration": qdd}
    return max(np.abs(x / limits[f"{name}_limit"]).max() for name, x in used.items())


@pytest.mark.parametrize("viscous", [1e-3, 400.0, 1e3, 1e5])
def test_arms_with_much_viscous_friction_creep_at_their_limits(arm, viscous):
    """Torque over viscous friction is the speed; a slow motion keeps the limits, so the fastest does."""
    motion = fastest(arm, [[0] * 6, [0.5] * 6], friction=rne.Friction(viscous=viscous), smoothing=0)
    assert beyond(motion, 2001) <= 1 + EXCEEDED
    assert motion.duration >= 0.5 * viscous / 20  # of joint 6, whose torque is least
    assert motion.duration <= 0.5 * viscous / 20 * 1.01 + 0.3  # s that all joints take without friction


def test_friction_that_dwarfs_inertia_is_driven_through_turns():
    """The way of 3.9 m at the speed F / c; where the slider turns, it stands, and its parameter may have any speed."""
    motion = fastest(slider(), [[0.0], [2.1], [0.3]], friction=rne.Friction(viscous=200.0), smoothing=0)
    way = np.abs(np.diff(motion.path.pieces[0](np.linspace(0, 1, 100_001))[:, 0])).sum()
    assert motion.duration == pytest.approx(way * 200 / 10, rel=EXCEEDED)
    assert beyond(motion, 2001) <= 1 + EXCEEDED


@pytest.fixture(scope="module")
def swung():
    """Duration of a pendulum's motion, all lengths and the gravity times `size`, all masses times `mass`."""

    def duration(size, mass):
        bob = Part(link="bob", joint="pivot", kind="revolute", parent=0, axis=np.array([0, 1.0, 0]), mass=2.0 * mass)
        bob = replace(bob, com=np.array([0, 0, 0.5]) * size, inertia=np.eye(3) * 0.1 * mass * size**2)
        robot = rne.Robot(assemble("pendulum", [Part(link="base"), bob], gravity=[0, 0, -9.81 * size]))
        unit = mass * size**2
        friction = rne.Friction(viscous=3.0 * unit)
        return fastest(
            robot.with_limits(effort=12.0 * unit), [[0.0], [1.5], [-0.5]], friction=friction, smoothing=0
        ).duration

    return duration


@pytest.mark.parametrize(("size", "mass"), [(1e-6, 1e-6), (1e-6, 1e6), (1e3, 1e-6), (1e3, 1e6)])
def test_durations_do_not_depend_on_units(swung, size, mass):
    assert swung(size, mass) == pytest.approx(swung(1.0, 1.0), rel=1e-9)


def test_averages_keep_limits_between_instants_too():
    """Via points close to each other, at which accelerations change within milliseconds."""
    bob = Part(link="bob", joint="pivot", kind="revolute", parent=0, axis=np.array([0, 1.0, 0]), mass=2.0)
    pendulum = rne.Robot(assemble("pendulum", [Part(link="base"), replace(bob, com=np.array([0, 0, 0.5]))]))
    pendulum = pendulum.with_limits(effort=14.0, acceleration=25.0)
    points = [[0.97], [1.06], [-0.25], [-0.05], [-0.0122], [-0.0121], [-1.03]]
    for friction in (None, rne.Friction(coulomb=2.0)):
        assert beyond(fastest(pendulum, points, friction=friction, smoothing=0.05)) <= 1 + EXCEEDED


def test_limits_of_velocity_and_acceleration_make_a_trapezoid():
    motion = fastest(slider(np.inf, velocity=1.5, acceleration=2.0), [[0.0], [3.0]], smoothing=0)
    assert motion.duration == pytest.approx(3.0 / 1.5 + 1.5 / 2.0, rel=GRID)


@pytest.mark.parametrize(("name", "seed"), [("irb140", 1), ("ur5", 2), ("panda", 3)])
def test_motions_keep_their_limits_and_use_one_by_two_engines(name, seed):
    robot = robot_named(name)
    oracle = Oracle(robot.model, rne.to_urdf(robot.model))
    friction = friction_of(robot) if seed % 2 else None
    motion = fastest(robot, random_path(robot, np.random.default_rng(seed)), friction=friction, smoothing=0)
    for shares in largest_shares(motion, oracle, 1000):
        assert shares.max() <= 1 + EXCEEDED
        assert (shares < UNUSED).sum() <= 1  # that falls on a switch
    assert motion.duration == pytest.approx(toppra_with_pinocchio(motion, oracle), rel=DIFFERENT_SOLVERS)


@pytest.fixture(scope="module")
def arm(irb140):
    return irb140.with_limits(**ARM)


@pytest.fixture(scope="module")
def path():
    return through([[0.0] * 6, [1, 0.5, -0.3, 1, 0.5, 0], [0.5, 0.8, 0.2, 0, 1, 2], [-0.5, 0, 0, 0, 0, 0]], stops=[2])


@pytest.fixture(scope="module")
def smooth(arm, path):
    return fastest(arm, path, friction=friction_of(arm), payload=2.0)


def test_smoothing_stays_on_the_path_and_within_limits_and_ends_steps(arm, path, smooth):
    sharp = fastest(arm, path, friction=friction_of(arm), payload=2.0, smoothing=0)
    assert smooth.unsmoothed_duration == sharp.duration < smooth.duration
    before, after = (sharp(np.array(sharp.breaks[1:-1]) + step)[2] for step in (-1e-9, 1e-9))
    jumps = np.abs(after - before).max(axis=1)  # between switches accelerations change by far less in 2 ns
    assert (jumps > 1e-3 * np.abs(sharp(sharp.breaks)[2]).max()).all()
    assert all(share.max() <= 1 + EXCEEDED for share in smooth.shares().values())
    turns = 2 * friction_of(arm).coulomb  # where a joint turns, its friction jumps at any speed
    assert (smooth.steps()[0] < 0.15 * sharp.steps()[0] + turns).all()
    t = np.linspace(0, smooth.duration, 50)
    s = np.concatenate([piece(np.linspace(0, 1, 4001)) for piece in path.pieces])
    distance = np.abs(smooth(t)[0][:, None] - s).max(-1).min(1)
    assert distance.max() < 1e-3  # half of the way between points of s


def test_velocities_and_accelerations_are_derivatives_and_stops_are_rests(path, smooth):
    t, h = np.linspace(0.05, smooth.duration - 0.05, 40), 1e-6
    (q, qd, qdd), (before, vb, _), (after, va, _) = smooth(t), smooth(t - h), smooth(t + h)
    np.testing.assert_allclose((after - before) / (2 * h), qd, atol=1e-7 * np.abs(qd).max() + 1e-8)
    np.testing.assert_allclose((va - vb) / (2 * h), qdd, atol=1e-4 * np.abs(qdd).max())
    q, qd, _ = smooth([-1.0, smooth.breaks[1], smooth.duration + 1])
    np.testing.assert_allclose(q, path.points[[0, 2, 3]], atol=1e-9)
    np.testing.assert_allclose(qd, 0, atol=1e-9)
    with pytest.raises(ValueError, match="read-only"):
        path.points[0, 0] = 1.0
    assert smooth(0.3)[0].shape == (6,)
    assert smooth(np.zeros((5, 1)))[2].shape == (5, 6)


def test_friction_changes_its_sign_where_a_joint_turns(arm):
    """Joint 1 turns half-way at full torque, a quarter of which is Coulomb friction: at its limit before and after it."""
    friction = rne.Friction(coulomb=0.25 * arm.effort_limit)
    motion = fastest(arm, [[0] * 6, [0.63, 0.2, 0, 0, 0, 0], [0.1, 0.3, 0, 0, 0, 0]], friction=friction, smoothing=0)
    t = np.linspace(0, motion.duration, 2001)[1:-1]
    turn = t[np.flatnonzero(np.diff(np.sign(motion(t)[1][:, 0])))[0]]
    near = turn + np.linspace(-1e-3, 1e-3, 20_001) * motion.duration
    used = (np.abs(motion.torques(near)) / arm.effort_limit).max(1)
    assert UNUSED <= used.min() <= used.max() <= 1 + EXCEEDED


def test_torques_at_the_ends_are_those_of_the_motion(arm):
    """Its friction included, whose sign at rest no velocity tells."""
    motion = fastest(arm, [[0] * 6, [1, 0, 0, 0, 0, 0]], friction=rne.Friction(coulomb=50.0), smoothing=0)
    assert motion.torques([0.0, motion.duration])[:, 0] == pytest.approx([250, -250], rel=EXCEEDED)


def test_before_and_after_the_motion_is_rest(arm):
    motion = fastest(arm, [[0] * 6, [1, 0.5, 0, 0, 0, 0]], smoothing=0)
    for t in (-0.1, motion.duration + 0.1):
        np.testing.assert_array_equal(np.stack(motion(t)[1:]), 0.0)


def test_jerk_limits_lengthen_the_default_smoothing(arm):
    limited = arm.with_limits(jerk=3000.0)
    motion = fastest(limited, [[0] * 6, [1, 0.5, 0, 0, 0, 0]])
    assert motion.smoothing > 0.01
    assert (motion.steps()[1] <= 3000).all()


def test_it_says_what_it_uses(smooth):
    first, heading, *rows, _, note = str(smooth).splitlines()
    assert re.match(r"Fastest motion along the path: [\d.]+ s; [\d.]+ s of it for smoothing over 10 ms$", first)
    assert heading.split()[:2] == ["joint", "torque"]
    assert [row.split()[0] for row in rows] == list(smooth.scene.robot.joint_names)
    assert all(row.split()[2] == "-" for row in rows)  # no limits of accelerations
    assert note == "-: no limit; limits hold to 0.1% throughout"
    assert max(share.max() for share in smooth.shares().values()) < 1.001


ERRORS = {
    "torques": ("irb140", [[0] * 6, [1] + [0] * 5], {}, "`robot`: joint_1, joint_2, joint_3, joint_4, joint_5, joint_6 have neither a torque nor an acceleration limit; give them by `robot.with_limits(effort=...)`"),
    "load": ("arm", [[0] * 6, [1] + [0] * 5], {"payload": 80.0}, "`path` cannot be driven: at via point 0, joint 'joint_3' needs a torque of 372.9 only for gravity and Coulomb friction; its limit is 150"),
    "range": ("arm", [[0] * 6, [1, 2.5, 0, 0, 0, 0]], {}, "`path` leaves the range of joint 'joint_2', -1.745 to 1.745: 2.5 at via point 1"),
    "joints": ("arm", [[0] * 5, [1] * 5], {}, "`path` must have points of shape (K, 6), got (2, 5)"),
    "same": ("arm", [[0] * 6, [0] * 6], {}, "`points` must differ from one to the next, got the same at index 0 and 1"),
    "same at last": ("arm", [[0] * 6, [1] * 6, [1] * 6], {}, "`points` must differ from one to the next, got the same at index 1 and 2"),
    "few": ("arm", [[0] * 6], {}, "`points` must have shape (K, n) with two points at least, got (1, 6)"),
    "smoothing": ("arm", [[0] * 6, [1] * 6], {"smoothing": -1}, "`smoothing` must not be negative, got -1.0"),
}  # fmt: skip


@pytest.mark.parametrize("case", ERRORS)
def test_what_is_refused_and_why(case, arm, irb140):
    robot, points, options, text = ERRORS[case]
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        fastest(irb140 if robot == "irb140" else arm, points, **options)


def test_a_law_that_follows_a_path_cannot_be_traced(arm, smooth):
    text = "^`law` cannot be traced: TypeError: a motion along a path is evaluated with numbers and cannot be traced$"
    with pytest.raises(TypeError, match=text):
        rne.control.compiled(rne.control.pd_gravity(arm, 50.0, 20.0, smooth))


@pytest.mark.parametrize(("stops", "error", "text"), [
    ([2], ValueError, "`stops` must be indices of points, 0 to 1, got 2"),
    ([True], ValueError, "`stops` must be indices of points, 0 to 1, got True"),
    (None, TypeError, "`stops` must be True, False or a sequence of indices of points, got None"),
    (1, TypeError, "`stops` must be True, False or a sequence of indices of points, got 1"),
    ("all", TypeError, "`stops` must be True, False or a sequence of indices of points, got 'all'"),
])  # fmt: skip
def test_a_stop_that_is_no_point_is_refused(stops, error, text):
    with pytest.raises(error, match=f"^{re.escape(text)}$"):
        through([[0.0], [1.0]], stops=stops)


def test_a_limit_of_decelerations_alone_has_its_share_in_the_table():
    _, heading, row, *_ = str(fastest(slider(10, deceleration=1), [[0.0], [3.0]], smoothing=0)).splitlines()
    assert heading.split()[:4] == ["joint", "torque", "accel.", "velocity"]
    assert row.split()[:4] == ["rail", "100.0%", "100.0%", "-"]


def test_a_payload_that_is_given_is_one_on_the_robot(arm):
    path = [[0.0] * 6, [0.5, 0.3, 0, 0, 0, 0]]
    plain, loaded, on_robot = fastest(arm, path), fastest(arm, path, payload=3.0), fastest(arm.with_payload(3.0), path)
    assert plain.duration < loaded.duration == on_robot.duration


def test_at_every_time_some_joint_is_at_a_limit(arm):
    rows = str(fastest(arm, [[0.0] * 6, [0.5, 0.3, 0, 0, 0, 0]], smoothing=0)).splitlines()[2:8]
    assert sum(float(row.split()[4].rstrip("%")) for row in rows) >= 99


def test_points_too_far_apart_for_numbers_are_refused():
    with pytest.raises(
        ValueError, match=r"^`points` are too far apart: the way exceeds the range of float64, got up to 1e"
    ):
        through([[0.0, 0.0], [1e300, 1e300]])


@pytest.mark.parametrize(("name", "maker"), [
    ("FastestMotion", "fastest"), ("Path", "through"), ("Spline", "spline"), ("Quintic", "quintic"), ("Trapezoidal", "trapezoidal"),
])  # fmt: skip
def test_what_a_function_makes_says_so_when_it_is_called(name, maker):
    with pytest.raises(TypeError, match=f"^{name} is made by `rne.trajectories.{maker}`, call that instead$"):
        getattr(rne.trajectories, name)([])


def test_no_times_give_no_states(smooth):
    assert [x.shape for x in smooth([])] == [(0, 6)] * 3


def test_a_law_follows_it_by_calls(arm, smooth):
    law = rne.control.computed_torque(arm, 100, 20, smooth)
    q, qd, _ = smooth(0.2)
    assert np.isfinite(law(0.2, q, qd)).all()


@pytest.mark.parametrize(
    ("seed", "smoothing", "deviation"), kept([(2, None, 1e-4), (2, 0, 2e-4), (11, 0, 5e-5)], [(11, 0, 5e-5)])
)
def test_the_planned_torques_drive_the_arm_along_the_path(arm, seed, smoothing, deviation):
    """At 1 kHz; held torques that are right but in the middle of a sample, where they jump, lead to ten times as much."""
    motion = fastest(arm, random_path(arm, np.random.default_rng(seed)), smoothing=smoothing)
    assert largest_deviation(motion) < deviation


@pytest.mark.parametrize("share", [0.9, 0.8])
def test_a_pendulum_swings_up_through_where_its_drive_cannot_hold_it(share):
    """From 30 degrees beside straight down to 30 beside straight up: work of gravity 2 m g l cos(30), of the drive T 2 pi / 3."""
    bob = Part(link="bob", joint="pivot", kind="revolute", parent=0, axis=np.array([0, 1.0, 0]), mass=2.0)
    bob = replace(bob, com=np.array([0, 0, 0.5]))
    weight = 2.0 * 9.81 * 0.5
    pendulum = rne.Robot(assemble("pendulum", [Part(link="base"), bob])).with_limits(effort=share * weight)
    swing = [[np.radians(150)], [np.radians(30)]]
    if share * 2 * np.pi / 3 < np.sqrt(3):
        cause = "`path` cannot be driven: between via points 0 and 1, joint 'pivot' needs a torque of 9.81"
        with pytest.raises(ValueError, match=re.escape(cause)):
            fastest(pendulum, swing, smoothing=0)
    else:
        motion = fastest(pendulum, swing, smoothing=0)
        used = np.abs(motion.torques(np.linspace(0, motion.duration, 502)[1:-1])) / (share * weight)
        assert UNUSED < used.min() <= used.max() < 1 + EXCEEDED


def test_an_average_that_gravity_makes_too_strong_is_slowed_or_refused():
    """Past a place that takes 98 % of the drive's torque, which leaves little for the average's accelerations."""
    weight = 9.81 * 0.15
    rod = rne.Robot(straight_chain(1)).with_limits(effort=1.02 * weight)
    optimal, slowed = (fastest(rod, [[1.2], [1.9]], smoothing=window) for window in (0, 0.15))
    assert slowed.duration > optimal.duration + 0.15 + 1e-3
    assert 0.9 < slowed.shares()["torque"].max() <= 1 + EXCEEDED
    text = "`smoothing` of 0.4 s is too long for this path: averaged motions exceed a limit; give less, or 0"
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        fastest(rod, [[1.2], [1.9]], smoothing=0.4)


def test_a_light_arm_on_which_the_solver_fails_by_rounding_on_one_scale():
    robot = rne.load("so101")
    span = robot.upper - robot.lower
    points = (robot.upper + robot.lower) / 2 + 0.35 * span * np.random.default_rng(1001).uniform(-1, 1, (3, robot.n))
    motion = fastest(robot, points, smoothing=0)
    assert all(share.max() <= 1 + EXCEEDED for share in motion.shares().values())


def test_it_says_what_to_install(arm, monkeypatch):
    monkeypatch.setitem(sys.modules, "toppra.constraint", None)
    with pytest.raises(ImportError, match=re.escape("`fastest` needs toppra, which is not installed: pip install")):
        fastest(arm, [[0] * 6, [1] + [0] * 5])


def test_an_unexpected_failure_of_the_solver_is_told(arm, monkeypatch):
    monkeypatch.setattr("rne.trajectories.time_optimal._largest_x", lambda *_: None)
    with pytest.raises(
        ValueError, match=r"^`path`: toppra finds no motion; at rest it needs most .*, \d+% of joint 'j"
    ):
        fastest(arm, [[0] * 6, [1, 0, 0, 0, 0, 0]])
