"""yourdfpy as an independent second reader: every robot of example-robot-data that loads is the same in both.

yourdfpy keeps links and joints as the file has them, so everything `rne` does at load is done here a second time, in
double precision and with other formulas: the order of joints, poses of links, merged bodies, composed mimics.
"""

import numpy as np
import pytest
import yourdfpy
from scipy.spatial.transform import Rotation

import rne

from .helpers import EPS, ROOT, data_robots, kept
from .test_oracle import LOADABLE, ONE_OF_EACH_KIND

# Products of up to 20 transforms in double, where `rne` multiplies in long double and sets entries within 4 eps of 0 or
# +-1 to them; relative to the largest distance, at least a metre. Measured: 4.3 eps.
POSES = 20 * EPS
AXES = 4 * EPS  # one normalisation in double, and the same entries set to 0 or +-1. Measured: 0.6 eps
# Sums over the links of a body, relative to its mass and the largest distance of a link. Measured: 2.9 eps.
BODIES = 20 * EPS
MIMICS = 4 * EPS  # of a radian: a product of at most three multipliers

FILES = {name: path for name, path in data_robots().items() if name in LOADABLE}
FILES["irb140"] = ROOT / "robots" / "irb140.urdf"
PLACE = '<origin xyz="0.3 -0.2 0.5" rpy="0.4 1.1 -0.7"/>'
BODY = f'<inertial>{PLACE}<mass value="2"/><inertia ixx="0.1" ixy="0.01" ixz="0.02" iyy="0.2" iyz="-0.03" izz="0.25"/></inertial>'


def carried(name, parent, kind, inside=""):
    """A link with the joint of the same name that carries it."""
    joint = f'<joint name="{name}" type="{kind}">{inside}<parent link="{parent}"/><child link="{name}"/></joint>'
    return f'<link name="{name}">{BODY}</link>{joint}'


# What those files do not have: no axis, an axis to be normalised, chains of mimics with offsets, half a limit, and
# bodies of several links that are turned against each other.
ODD = f"""<robot name="odd">
{carried("tip", "tool", "fixed", PLACE)}
<link name="base">{BODY}</link>
{carried("bolted", "base", "fixed", PLACE)}
{carried("c", "b", "prismatic", PLACE + '<axis xyz="1 -2 3"/><limit upper="1"/><mimic joint="b" offset="0.3"/>')}
{carried("b", "a", "continuous", PLACE + '<axis xyz="0 3 4"/><mimic joint="a" multiplier="-2" offset="0.7"/>')}
{carried("a", "bolted", "revolute", PLACE + '<limit lower="-2" effort="5"/>')}
{carried("tool", "c", "fixed", PLACE)}
{carried("d", "a", "revolute", '<axis xyz="0 0 -1"/>')}
</robot>"""
NO_LIMIT = float(np.finfo(float).max)  # as written by `rne.to_urdf`


class Theirs:
    """A robot as yourdfpy reads it."""

    def __init__(self, path):
        robot = yourdfpy.URDF.load(str(path), build_scene_graph=False, load_meshes=False).robot
        self.name, self.links, self.joints = robot.name, robot.links, robot.joints
        self.joint = {joint.name: joint for joint in robot.joints}
        self.joint_above = {joint.child: joint for joint in robot.joints}
        (self.root,) = (link.name for link in robot.links if link.name not in self.joint_above)

    def position(self, name, q):
        """Position of a joint that may mimic another; `q` by joint name."""
        mimic = self.joint[name].mimic
        return q[name] if mimic is None else mimic.multiplier * self.position(mimic.joint, q) + mimic.offset

    def pose(self, link, q, end=None):
        """Transform from a link's axes to those of `end`, the root if not given."""
        T = np.eye(4)
        while link not in (end, self.root):
            joint = self.joint_above[link]
            T = matrix(joint.origin) @ self.motion(joint, q) @ T
            link = joint.parent
        return T

    def motion(self, joint, q):
        T = np.eye(4)
        if joint.type == "prismatic":
            T[:3, 3] = unit_axis(joint) * self.position(joint.name, q)
        elif joint.type != "fixed":
            T[:3, :3] = Rotation.from_rotvec(unit_axis(joint) * self.position(joint.name, q)).as_matrix()
        return T

    def carrier(self, link):
        """The first link of the body that a link is part of: the one behind its moving joint, or the root."""
        while link != self.root and self.joint_above[link].type == "fixed":
            link = self.joint_above[link].parent
        return link


def matrix(origin):
    return np.eye(4) if origin is None else origin


def unit_axis(joint):
    axis = np.array([1.0, 0, 0]) if joint.axis is None else joint.axis
    return axis / np.linalg.norm(axis)


@pytest.fixture(params=kept([*FILES, "odd"], [*ONE_OF_EACH_KIND, "irb140", "odd"]), scope="module")
def both(request, tmp_path_factory):
    path = FILES.get(request.param) or tmp_path_factory.mktemp("second") / "odd.urdf"
    if request.param == "odd":
        path.write_text(ODD, encoding="utf-8")
    return rne.load(path).model, Theirs(path)


def test_names_types_and_parents(both):
    model, theirs = both
    assert model.name == theirs.name
    assert sorted(model.link_names) == sorted(link.name for link in theirs.links)
    assert dict(zip(model.link_names, model.link_joints, strict=True)) == {theirs.root: ""} | {
        joint.child: joint.name for joint in theirs.joints
    }
    body = dict(zip(model.link_names, model.link_body, strict=True))
    assert body[theirs.root] == -1
    for joint in theirs.joints:
        if joint.type == "fixed":
            assert joint.name not in model.moving_joints
            assert body[joint.child] == body[joint.parent]
        else:
            i = model.moving_joints.index(joint.name)
            assert model.joint_types[i] == joint.type
            assert (body[joint.child], model.parent[i]) == (i, body[joint.parent])


def test_joints_are_in_the_order_of_the_file_once_their_parent_is_placed(both):
    model, theirs = both
    order, waiting = [theirs.root], list(theirs.joints)
    while waiting:
        joint = next(joint for joint in waiting if joint.parent in order)
        order.append(joint.child)
        waiting.remove(joint)
    assert list(model.link_names) == order


def test_link_poses(both):
    """At zero, and where every joint has moved, which needs axes, directions of motion and mimics as well."""
    model, theirs = both
    for q in (np.zeros(model.n), np.random.default_rng(0).uniform(-1, 1, model.n)):
        positions = dict(zip(model.joint_names, q, strict=True))
        expected = np.array([theirs.pose(link, positions) for link in model.link_names])
        error = np.abs(rne.dynamics.link_poses(model, q) - expected)
        assert error[:, :3, :3].max() <= POSES
        assert error[:, :3, 3].max() <= POSES * max(1, np.abs(expected[:, :3, 3]).max())


def test_axes(both):
    model, theirs = both
    for name, axis in zip(model.moving_joints, model.axis, strict=True):
        assert np.abs(axis - unit_axis(theirs.joint[name])).max() <= AXES


def test_mimics(both):
    """The position of every joint at two values of every coordinate."""
    model, theirs = both
    assert list(model.joint_names) == [name for name in model.moving_joints if theirs.joint[name].mimic is None]
    for q in np.random.default_rng(1).uniform(-1, 1, (2, model.n)):
        positions = dict(zip(model.joint_names, q, strict=True))
        expected = [theirs.position(name, positions) for name in model.moving_joints]
        np.testing.assert_allclose(model.coordinate_map @ q + model.offset, expected, rtol=0, atol=MIMICS)


def test_limits(both):
    """To the last bit: they are only copied."""
    model, theirs = both
    for i, name in enumerate(model.moving_joints):
        joint = theirs.joint[name]
        has_range = joint.limit is not None and joint.type != "continuous"  # URDF's default is then 0
        lower, upper = (joint.limit.lower or 0, joint.limit.upper or 0) if has_range else (None, None)
        velocity, effort = (getattr(joint.limit, kind, None) for kind in ("velocity", "effort"))
        assert model.lower[i] == -limit(None if lower is None else -lower), name
        ours = model.upper[i], model.velocity_limit[i], model.effort_limit[i]
        assert ours == (limit(upper), limit(velocity), limit(effort)), name


def limit(value):
    return np.inf if value is None or value == NO_LIMIT else value


def test_damping_and_friction(both):
    """yourdfpy leaves them as text."""
    model, theirs = both
    for i, name in enumerate(model.moving_joints):
        dynamics = theirs.joint[name].dynamics
        assert model.damping[i] == float(getattr(dynamics, "damping", None) or 0)
        assert model.friction[i] == float(getattr(dynamics, "friction", None) or 0)


def moments(theirs, links, carrier):
    """Mass, first moment and inertia about the carrier's origin, of all links of a body, by the parallel axis theorem."""
    mass, first, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    for link in links:
        if link.inertial is None:
            continue
        T = theirs.pose(link.name, {}, carrier) @ matrix(link.inertial.origin)
        R, c, m = T[:3, :3], T[:3, 3], link.inertial.mass
        C = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
        mass, first = mass + m, first + m * c
        inertia = inertia + R @ link.inertial.inertia @ R.T - m * C @ C
    return mass, first, inertia


def test_masses_centres_and_inertias(both):
    """Of each body, merged from its links, about its frame's origin; what is fixed to the base included."""
    model, theirs = both
    members = {link: [] for link in (theirs.root, *(theirs.joint[name].child for name in model.moving_joints))}
    for link in theirs.links:
        members[theirs.carrier(link.name)].append(link)
    ours = [
        (model.base_mass, model.base_com, model.base_inertia),
        *zip(model.mass, model.com, model.inertia, strict=True),
    ]
    for (mass, com, inertia), (carrier, links) in zip(ours, members.items(), strict=True):
        m, first, about_origin = moments(theirs, links, carrier)
        places = [theirs.pose(x.name, {}, carrier) @ matrix(x.inertial.origin) for x in links if x.inertial]
        spread = max((np.linalg.norm(T[:3, 3]) for T in places), default=0)
        assert abs(mass - m) <= BODIES * m
        assert np.abs(mass * com - first).max() <= BODIES * m * spread
        got = inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))
        assert np.abs(got - about_origin).max() <= BODIES * (np.trace(about_origin) + m * spread**2)
    total = sum(link.inertial.mass for link in theirs.links if link.inertial)
    assert abs(model.base_mass + model.mass.sum() - total) <= BODIES * total


def test_cylinders_and_boxes(both):
    model, theirs = both
    by_name = {link.name: link for link in theirs.links}
    visuals = [
        (name, v) for name in model.link_names for v in by_name[name].visuals if v.geometry.cylinder or v.geometry.box
    ]
    for shape, (name, visual) in zip(model.shapes, visuals, strict=True):
        cylinder, T = visual.geometry.cylinder, matrix(visual.origin)
        if cylinder:
            assert (shape.link, shape.radius, shape.length) == (name, cylinder.radius, cylinder.length)
        else:
            assert (shape.link, *shape.size) == (name, *visual.geometry.box.size)
        assert list(shape.position) == T[:3, 3].tolist()
        assert np.abs(Rotation.from_euler("xyz", shape.rpy).as_matrix() - T[:3, :3]).max() <= POSES
