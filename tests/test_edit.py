"""Robots made from robots."""

import inspect
import re
from dataclasses import replace

import numpy as np
import pytest

import rne

from .helpers import EPS, relative, states
from .random_robots import random_tree


def test_payload_adds_the_kinetic_energy_of_a_body(tree):
    """The payload's own energy, from its link's Jacobian: nothing of the link is overwritten."""
    q, qd, _ = states(tree.n, 5)
    mass, com, inertia = 1.7, np.array([0.1, -0.2, 0.3]), np.diag([0.02, 0.03, 0.04])
    link = tree.link_names[-1]
    loaded = rne.model.with_payload(tree, mass, com, inertia, link)
    twist = (rne.dynamics.jacobian(tree, q, link) @ qd[..., None])[..., 0]
    R = rne.dynamics.link_poses(tree, q)[:, tree.link_index(link), :3, :3]
    omega, v = twist[:, :3], twist[:, 3:] + np.cross(twist[:, :3], (R @ com))
    own = (np.swapaxes(R, -1, -2) @ omega[..., None])[..., 0]
    added = (mass * (v * v).sum(-1) + (own @ inertia * own).sum(-1)) / 2
    expected = rne.dynamics.kinetic_energy(tree, q, qd) + added
    np.testing.assert_allclose(rne.dynamics.kinetic_energy(loaded, q, qd), expected, rtol=1e-12)


def test_a_payload_in_no_plausible_place_is_warned_of(irb140, caplog):
    """Millimetres for metres; what an arm or a gantry may carry, and a body without mass, say nothing."""
    axes = dict(a=[0, 0], alpha=[0, 0], d=[0.01, 0], theta=[0, 0], types="prismatic", lower=[0, 0])
    rne.Robot(rne.dh_chain(**axes, upper=[2, 3])).with_payload(5.0, [0, 0, 1])
    irb140.with_payload(5.0, [0, 0, 0.06])
    irb140.with_payload(0.0, [0, 0, 60])
    assert not caplog.text
    irb140.with_payload(5.0, [0, 0, 60])
    size = sum(np.linalg.norm(x, axis=1).sum() for x in (irb140.model.translation, irb140.model.com))
    tool = np.linalg.norm(irb140.model.link_translation[irb140.link_names.index("tool0")])
    said = f"60 m from the link's origin, the robot measures {size + tool:.4g} m; check `com`: metres"
    assert f"payload on link 'tool0': the centre of mass is {said}" in caplog.messages


def test_payload_on_the_base_moves_nothing():
    tree = random_tree(3, seed=1)
    loaded = rne.model.with_payload(tree, 5.0, [0, 0, 1], None, "root")
    s = states(3)
    assert np.array_equal(rne.dynamics.inverse_dynamics(loaded, *s), rne.dynamics.inverse_dynamics(tree, *s))
    assert loaded.base_mass == tree.base_mass + 5.0


def test_locked_robot_is_the_full_robot_at_rest_in_those_joints(tree):
    names = tree.joint_names[::2]
    free = [name not in names for name in tree.joint_names]
    q, qd, qdd = states(tree.n, 5)
    values = np.linspace(0.3, 1.0, len(names))
    for x, value in ((q, values), (qd, 0), (qdd, 0)):
        x[:, ~np.array(free)] = value
    smaller = rne.model.locked(tree, dict(zip(names, values, strict=True)))
    assert smaller.joint_names == tuple(np.array(tree.joint_names)[free])
    assert smaller.link_names == tree.link_names
    full = rne.dynamics.inverse_dynamics(tree, q, qd, qdd)
    got = rne.dynamics.inverse_dynamics(smaller, *(x[:, free] for x in (q, qd, qdd)))
    assert np.abs(got - full[:, free]).max(initial=0) <= 1e-12 * np.abs(full).max()
    np.testing.assert_allclose(
        rne.dynamics.link_poses(smaller, q[:, free]), rne.dynamics.link_poses(tree, q), atol=1e-13
    )


def test_locking_everything_leaves_no_coordinates(irb140):
    statue = irb140.locked(dict.fromkeys(irb140.joint_names, 0.2))
    assert statue.n == 0
    assert statue.model.base_mass == pytest.approx(75.0)


def test_mounted_robot_is_the_robot_in_turned_gravity(irb140):
    q, _, _ = states(6)
    roof = irb140.mounted([np.pi, 0, 0])
    assert roof.model.gravity.tolist() == [0, 0, 9.81]
    assert relative(roof.gravity_torque(q)[None], -irb140.gravity_torque(q)[None]) <= 4 * EPS


@pytest.mark.parametrize(
    ("rpy", "down"),
    [
        ([np.pi / 2, 0, 0], [0, -1, 0]),
        ([0, np.pi / 2, 0], [1, 0, 0]),
        ([0, np.pi / 6, 0], [0.5, 0, -np.sqrt(3) / 2]),
        ([0, np.pi / 2, np.pi / 2], [1, 0, 0]),
        ([np.pi / 2, np.pi / 2, 0.0], [1, 0, 0]),
    ],
)
def test_down_is_seen_from_the_rotated_root_link(irb140, rpy, down):
    """Rolled by a quarter turn the root's y axis points up; pitched by one, its x axis points down."""
    np.testing.assert_allclose(irb140.mounted(rpy).model.gravity, 9.81 * np.array(down), atol=1e-14)


def test_mounting_keeps_gravitys_size(irb140):
    slope = irb140.mounted([0.3, -0.7, 1.1])
    assert np.linalg.norm(slope.model.gravity) == pytest.approx(9.81, rel=1e-15)


def test_originals_are_unchanged(irb140):
    irb140.with_payload(6.0)
    irb140.locked({"joint_1": 1.0})
    irb140.mounted([1, 0, 0])
    assert irb140.model == rne.irb140()


def refused(call, text):
    with pytest.raises(ValueError, match="^" + re.escape(text) + "$"):
        call()


def linkage_of_two(robot):
    """A parallelogram of the first three joints of a plane arm."""
    return rne.model.four_bar(robot, "joint_1", (("tool0", [0, 0, 0]), ("base_link", [0.8, 0.0, 0])))


SQUARE = {"a": [0.3, 0.8, 0.3], "alpha": [0] * 3, "d": [0] * 3, "theta": [np.pi / 2, -np.pi / 2, -np.pi / 2]}
BOOM = {"a": [1, 0, 0], "alpha": [0, np.pi / 2, 0], "d": [0, 0, 0.7], "theta": [0] * 3}
BOOM |= {"types": ["revolute", "revolute", "prismatic"]}
JACK = (("tool0", [0, 0, 0]), ("base_link", [1, -0.7, 0]))
CHANGES = {
    "coupled": (None, lambda x: rne.model.coupled(x, {"joint_3": (["joint_2"], lambda q: 0.2 * np.sin(q))})),
    "cylinder": (BOOM, lambda x: rne.model.cylinder(x, "joint_3", JACK)),
    "four_bar": (SQUARE, linkage_of_two),
    "locked": (None, lambda x: rne.model.locked(x, {"joint_2": 0.3})),
    "mounted": (None, lambda x: rne.model.mounted(x, [0.1, 0, 0])),
    "with_armature": (None, lambda x: rne.model.with_armature(x, 0.1)),
    "with_limits": (None, lambda x: rne.model.with_limits(x, effort=10.0)),
    "with_parameters": (None, lambda x: rne.model.with_parameters(x, 2 * rne.Robot(rne.irb140()).parameters)),
    "with_payload": (None, lambda x: rne.model.with_payload(x, 2.0)),
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_changes_a_model_changes_a_robot(name):
    """The Robot of the model that results, with the engine of the one that is given."""
    chain, change = CHANGES[name]
    model = rne.irb140() if chain is None else rne.dh_chain(**chain)
    robot = rne.Robot(model, "numba")
    found, expected = change(robot), change(model)
    assert type(found) is rne.Robot
    assert type(expected) is rne.Model
    assert found.model == expected != model
    assert found.engine == "numba"
    assert robot.model is model


def test_every_function_that_changes_a_model_is_among_them():
    changing = {
        name
        for name in rne.model.__all__
        if "model" in (signature := inspect.signature(getattr(rne.model, name))).parameters
        and signature.return_annotation == "Model"
    }
    assert changing == {*CHANGES}


@pytest.mark.parametrize("name", CHANGES)
def test_neither_a_model_nor_a_robot_is_refused(name):
    with pytest.raises(TypeError, match=r"^`model` must be an rne.Model or rne.Robot, got str$"):
        CHANGES[name][1]("irb140")


def test_wrong_arguments_are_named(irb140):
    refused(lambda: irb140.with_payload(-1.0), "payload on link 'tool0': the mass must be 0 or positive, got -1.0")
    refused(lambda: irb140.with_payload(1.0, [0, 0]), "`com` must have shape (3,), got (2,)")
    refused(
        lambda: irb140.with_payload(np.ones(3)),
        "`mass` must be one number, got shape (3,); for many masses in one call, "
        "parameters=np.stack([robot.with_payload(m).parameters for m in masses])",
    )
    refused(lambda: irb140.with_payload(np.nan), "`mass` must be finite, got nan at index ()")
    refused(
        lambda: irb140.with_payload(1.0, [0, 0, 0], np.diag([1, 1, -1])),
        "payload on link 'tool0': the inertia must have no negative eigenvalue, got -1 kg m^2",
    )
    refused(
        lambda: irb140.locked({"joint_7": 0.0}),
        f"`positions` must name joints of {list(irb140.joint_names)}, got 'joint_7'",
    )
    refused(lambda: irb140.mounted([0, 0]), "`rpy` must have shape (3,), got (2,)")


LINKLESS = dict.fromkeys(("link_names", "link_joints", "link_body", "link_parent"), ())
LINKLESS |= {"link_rotation": np.zeros((0, 3, 3)), "link_translation": np.zeros((0, 3))}


class TestModel:
    def test_arrays_are_read_only(self, irb140):
        with pytest.raises(ValueError, match="read-only"):
            irb140.model.mass[0] = 1.0

    def test_a_model_pickles_with_its_arrays_read_only(self, tree):
        import pickle

        copy = pickle.loads(pickle.dumps(tree))
        assert copy == tree
        assert not copy.mass.flags.writeable

    @pytest.mark.parametrize(
        ("changes", "text"),
        [
            ({"mass": [1, -1, 1]}, "body of joint 'joint1': the mass must be 0 or positive, got -1.0"),
            ({"mass": [1, 2]}, "`mass` must have shape (3,), got (2,)"),
            ({"axis": np.ones((3, 3))}, "joint 'joint0': `axis` must be a unit vector, got length 1.7320508075688772"),
            ({"rotation": np.ones((3, 3, 3))}, "joint 'joint0': `rotation` must be a rotation: orthogonal with determinant +1"),
            ({"parent": (0, 0, 0)}, "joint 'joint0': parent must be one of the 0 bodies before it, got 0"),
            ({"joint_types": ("planar",) * 3}, "joint 'joint0': type must be one of ['revolute', 'continuous', 'prismatic'], got 'planar'"),
            ({"gravity": [0, 0, np.nan]}, "`gravity` must be finite, got nan at index (2,)"),
            ({"parent": (-1,)}, "`parent` must have 3 entries, got 1"),
            (LINKLESS, "a robot needs at least its root link"),
        ],
    )  # fmt: skip
    def test_contradictions_are_named(self, changes, text):
        from dataclasses import replace

        with pytest.raises(rne.ModelError, match="^" + re.escape(text) + "$"):
            replace(random_tree(3, seed=1), **changes)


# Limits

PAIR = random_tree(2, seed=4, mimics=1)
FIRST, SECOND = PAIR.joint_names


@pytest.mark.parametrize("name", ["effort", "velocity", "acceleration", "deceleration", "jerk"])
def test_limits_are_one_for_all_or_one_for_each_or_some_by_name(name):
    def of(value, model=PAIR):
        limits = getattr(rne.model.with_limits(model, **{name: value}), f"{name}_limit")
        return limits[list(PAIR.independent_joints)].tolist()

    assert of(3) == [3.0, 3.0]
    assert of([1, np.inf]) == [1.0, np.inf]
    assert of({SECOND: 5}) == [np.inf, 5.0]
    assert of({FIRST: 0}, rne.model.with_limits(PAIR, **{name: 2})) == [0.0, 2.0]


def test_other_limits_and_those_of_joints_that_mimic_stay():
    changed = rne.model.with_limits(PAIR, velocity=2)
    (mimic,) = set(range(3)) - set(PAIR.independent_joints)
    assert changed.velocity_limit[mimic] == np.inf
    assert changed == rne.model.with_limits(changed, effort=None)
    for name in ("lower", "upper", "effort_limit", "acceleration_limit", "jerk_limit", "mass", "parent"):
        assert np.array_equal(getattr(changed, name), getattr(PAIR, name))
    assert changed != PAIR
    assert PAIR.velocity_limit.tolist() == [np.inf] * 3


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ([1.0], "`{}` must have shape (2,), got (1,)"),
        ([1.0, -2.0], f"`{{}}[1]` of joint {SECOND!r} must not be negative, got -2.0"),
        ({SECOND: np.nan}, f"`{{}}[1]` of joint {SECOND!r} must be a number, got nan"),
        (-1, f"`{{}}[0]` of joint {FIRST!r} must not be negative, got -1.0"),
        (1j, "`{}` must be real, got dtype complex128"),
        ("strong", "`{}` must be an array of numbers of shape (2,), got dtype <U6"),
    ],
)
def test_limits_that_are_none_are_refused(value, text, tmp_path):
    file = tmp_path / "pair.urdf"
    file.write_text(rne.to_urdf(PAIR))
    with pytest.raises(ValueError, match=f"^{re.escape(text.format('jerk'))}$"):
        rne.model.with_limits(PAIR, jerk=value)
    with pytest.raises(ValueError, match=f"^{re.escape(text.format('effort'))}$"):
        rne.load(file, effort=value)


def test_limits_by_name_know_joints_that_follow_but_for_efforts():
    for name, joints in (("effort", PAIR.joint_names), ("jerk", PAIR.moving_joints)):
        with pytest.raises(ValueError) as error:  # noqa: PT011
            rne.model.with_limits(PAIR, **{name: {"elbow": 1}})
        assert str(error.value) == f"`{name}` must name joints of {list(joints)}, got 'elbow'"


def test_limits_given_at_load_are_those_of_the_robot(tmp_path):
    given = {"effort": 300, "velocity": [1, 2, 3, 4, 5, 6], "acceleration": {"joint_2": 7}, "jerk": 80.0}
    given["deceleration"] = [5, 6, np.inf, 8, 9, 10]
    arm = rne.load("irb140", **given)
    assert arm.model == rne.model.with_limits(rne.irb140(), **given)
    file = tmp_path / "arm.urdf"
    file.write_text(rne.to_urdf(arm.model))
    assert rne.read_urdf(file) == arm.model
    assert rne.load(file, jerk=np.inf).model.jerk_limit.tolist() == [np.inf] * 6


def test_limits_of_a_robot_are_those_of_its_coordinates():
    robot = rne.Robot(PAIR).with_limits(effort=1, velocity=2, acceleration=3, jerk=4)
    names = ("effort_limit", "velocity_limit", "acceleration_limit", "jerk_limit")
    assert [getattr(robot, name).tolist() for name in names] == [[k, k] for k in (1.0, 2.0, 3.0, 4.0)]
    assert robot.model == rne.model.with_limits(PAIR, effort=1, velocity=2, acceleration=3, jerk=4)


def test_a_deceleration_that_is_not_given_is_the_acceleration(tmp_path):
    """Also one that is given afterwards; what is written has none either."""
    robot = rne.load("irb140", acceleration=20, deceleration={"joint_2": 8})
    assert robot.deceleration_limit.tolist() == [20, 8, 20, 20, 20, 20]
    assert robot.with_limits(acceleration=30).deceleration_limit.tolist() == [30, 8, 30, 30, 30, 30]
    assert robot.with_limits(deceleration=np.inf).deceleration_limit.tolist() == [20] * 6
    text = rne.to_urdf(robot.model)
    assert re.findall(r'acceleration="20"(?: deceleration="\d+")?', text)[:2] == [
        'acceleration="20"',
        'acceleration="20" deceleration="8"',
    ]
    (tmp_path / "arm.urdf").write_text(text)
    assert rne.read_urdf(tmp_path / "arm.urdf") == robot.model


def test_a_joint_that_mimics_binds_its_coordinate():
    """q_i = m q + o with m = -2, o = 0.5: a range of -1 to 2 is one of -0.75 to 0.75 for q, other limits are half."""
    (mimic,) = set(range(3)) - set(PAIR.independent_joints)
    k, m = PAIR.coordinate[mimic], np.ones(3)
    m[mimic] = -2.0
    place = np.arange(3) == mimic
    one = {f"{name}_limit": np.where(place, 3.0, 4.0) for name in ("velocity", "acceleration", "jerk", "effort")}
    one["deceleration_limit"] = np.where(place, 1.0, np.inf)
    ranges = {"lower": np.where(place, -1.0, -9.0), "upper": np.where(place, 2.0, 9.0)}
    robot = rne.Robot(replace(PAIR, multiplier=m, offset=0.5 * place, **ranges, **one))
    limits = {name: getattr(robot, name) for name in robot.model.coordinate_limits()}
    found = {name: (limit[k], limit[1 - k]) for name, limit in limits.items()}
    same = dict.fromkeys(("velocity_limit", "acceleration_limit", "jerk_limit"), (1.5, 4.0))
    same["deceleration_limit"] = (0.5, 4.0)
    assert found == {"lower": (-0.75, -9.0), "upper": (0.75, 9.0), "effort_limit": (4.0, 4.0)} | same
    one, same = (
        robot.bounds(positions="limits", quantities=["torque"], rates=rates, budget=1e-3)
        for rates in (None, limits["velocity_limit"])
    )
    assert (one.lower[k], one.upper[k]) == (-0.75, 0.75)
    np.testing.assert_array_equal(one.torque.attained, same.torque.attained)


def test_ranges_of_a_joint_and_its_mimic_that_exclude_each_other():
    (mimic,) = set(range(3)) - set(PAIR.independent_joints)
    place = np.arange(3) == mimic
    ranges = {"lower": np.where(place, 2.0, -1.0), "upper": np.where(place, 3.0, 1.0)}
    robot = rne.Robot(replace(PAIR, multiplier=np.ones(3), offset=np.zeros(3), **ranges))
    with pytest.raises(ValueError, match=r"^`positions` must have lower <= upper, also for mimic joints, got "):
        robot.bounds(positions="limits", quantities=["gravity_torque"])


def test_degrees_of_a_mounting_are_refused():
    text = "`rpy` looks like degrees; pass np.deg2rad(rpy), got 180 at index (0,)"
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        rne.model.mounted(PAIR, [180, 0, 0])
    assert rne.model.mounted(PAIR, [2 * np.pi, -2 * np.pi, 0]).n == 2


@pytest.mark.parametrize("changes", [{"damping": [0.5, 0, 0]}, {"friction": [0, 2.0, 0]}, {"armature": [0, 0, 3.0]}])
def test_what_drives_lose_is_written_and_read(changes, tmp_path):
    model = replace(PAIR, **changes)
    file = tmp_path / "pair.urdf"
    file.write_text(rne.to_urdf(model))
    again = rne.read_urdf(file, gravity=model.gravity)
    for name in ("damping", "friction", "armature"):
        np.testing.assert_array_equal(getattr(again, name), getattr(model, name))
    assert ("xmlns:drake" in file.read_text()) == ("armature" in changes)
    assert (
        f"gravity is {' '.join(map(repr, PAIR.gravity.tolist()))} m/s^2 in the axes of the root link"
        in file.read_text()
    )
