"""A joint's origin may be written anywhere on its axis: the robot is the same, and dynamics keeps its digits."""

from dataclasses import fields, replace

import mpmath
import numpy as np
import pytest

import rne
from rne.urdf.read import far_origins

from ..helpers import Part, data_robots, kept, pose, states
from ..random_robots import random_tree
from .families import case
from .far_file import exact_model, far_text
from .structured import DIGITS, EPS, Reference, changed, compared, measure

LONG_EPS = float(np.finfo(np.longdouble).eps)
MODELS = {
    "irb140": rne.irb140(),
    "ur5": rne.load(data_robots()["ur_description/ur5_robot"]).model,
    "serial": random_tree(6, seed=2, prismatic=0, branching=0),
    "branching": random_tree(8, seed=5, prismatic=0.2, branching=0.6),
}


@pytest.fixture
def read(tmp_path):
    def read(text):
        path = tmp_path / "far.urdf"
        path.write_text(text, encoding="utf-8")
        return rne.load(path)

    return read


def bound(n, distance):
    """Error that is allowed, in units of eps times the condition of the robot with short levers.

    10 n roundings of double precision, as for any robot. The robot read differs from the file's by one rounding of long
    double per metre that joints were slid, relative to these robots of about a metre: 0.05 at 1e2 m, 5 at 1e4 m and 488
    at 1e6 m, where 277 were measured.
    """
    return 10 * n + distance * LONG_EPS / EPS


@pytest.mark.parametrize("distance", kept([1e2, 1e4, 1e6], [1e6]))
@pytest.mark.parametrize("name", kept(MODELS, ["branching"]))  # its joints turn and slide
def test_dynamics_keep_their_digits(read, name, distance):
    """Against 50 digits of exactly the file's doubles."""
    text = far_text(MODELS[name], distance)
    robot = read(text)
    one = case(name, robot.model)
    with mpmath.workdps(DIGITS):
        exact = exact_model(text, robot.model)
    assert np.abs(exact.com).max() > distance / 10 > 5 * np.abs(robot.model.com).max()
    for quantity, measured in measure(one, perturbations=1, exact_model=exact).items():
        assert not measured.refused
        assert measured.ratio <= bound(robot.n, distance), quantity


@pytest.mark.parametrize("name", MODELS)
def test_links_stay_in_the_frames_of_the_file(read, name):
    text = far_text(MODELS[name], 1e6)
    robot = read(text)
    q = case(name, robot.model).q
    with mpmath.workdps(DIGITS):
        exact = rne.dynamics.link_poses.core(exact_model(text, robot.model), changed(q, None))
    got = robot.link_poses(q)
    rotations = [x[..., :3, :3].reshape(len(q), -1) for x in (got, exact)]
    places = [x[..., :3, 3].reshape(len(q), -1) for x in (got, exact)]
    for mine, theirs in (rotations, places):
        ones = np.ones(len(q))
        assert compared(mine, Reference(theirs, ones)).error <= 10 * robot.n * EPS


@pytest.mark.parametrize("name", kept(MODELS, ["irb140", "branching"]))
def test_written_and_read_again_it_is_the_same_robot(read, name):
    """Up to the rounding of doubles at this distance: 1e-10 m, compared with a wrist of a few centimetres."""
    first = read(far_text(MODELS[name], 1e6))
    again = read(rne.to_urdf(first.model))
    q = case("", first.model).q
    M, poses = (
        [f(robot.model, q) for robot in (again, first)] for f in (rne.dynamics.mass_matrix, rne.dynamics.link_poses)
    )
    assert again.link_names == first.link_names
    assert np.abs(M[0] - M[1]).max() <= 1e-8 * np.abs(M[1]).max()
    np.testing.assert_allclose(*poses, rtol=1e-14, atol=1e-8)


def test_the_record_is_that_of_the_same_motion(read):
    """Angular quantities and torques agree with the near robot's; origins are the near ones."""
    far = read(far_text(MODELS["serial"], 1e6))
    near = rne.Robot(replace(MODELS["serial"], gravity=far.model.gravity))
    state = [x[0] for x in case("", far.model)[2:]]
    mine, theirs = far.recursion(*state), near.recursion(*state)
    for name in ("omega", "alpha", "a_c", "f"):
        np.testing.assert_allclose(getattr(mine, name), getattr(theirs, name), rtol=1e-7, atol=1e-8, err_msg=name)
    assert np.abs(mine.a_o).max() < 1e4


def test_torques_of_joints_are_about_the_origins_of_the_file(read):
    """Moved by r along the axis, the moment about the file's origin is n - r x f; the drive's share stays."""
    far = read(far_text(MODELS["serial"], 1e3))
    state = [x[0] for x in case("", far.model)[2:]]
    poses, record = far.link_poses(state[0]), far.recursion(*state)
    for i, joint in enumerate(far.model.moving_joints):
        k = far.model.link_joints.index(joint)
        by_hand = np.zeros(3)  # Euler's equation of everything behind the joint, about the file's origin, in the world
        behind = [b for b in range(far.model.nb) if b >= i]
        world = far.model.link_rotation[k].T @ np.eye(3)
        assert np.array_equal(world, np.eye(3))
        R, p = poses[k][:3, :3], poses[k][:3, 3]
        for b in behind:
            place = poses[far.model.link_joints.index(far.model.moving_joints[b])]
            Rb = place[:3, :3]
            com = place[:3, 3] + Rb @ (far.model.com[b] - far.model.joint_origin[b])
            I = Rb @ far.model.inertia[b] @ Rb.T
            omega, alpha = Rb @ record.omega[b], Rb @ record.alpha[b]
            force = far.model.mass[b] * Rb @ (record.a_c[b] - record.gravity[b])
            by_hand += np.cross(com - p, force) + I @ alpha + np.cross(omega, I @ omega)
        np.testing.assert_allclose(R @ record.tau[i], by_hand, rtol=1e-7, atol=1e-6)


def test_edits_keep_the_frames(read):
    """A locked joint, a payload and a wrench at links far away from their joints."""
    far = read(far_text(MODELS["serial"], 1e6))
    near = rne.Robot(replace(MODELS["serial"], gravity=far.model.gravity))
    q, qd, qdd = (x[0] for x in case("", far.model)[2:])
    joint, link = far.joint_names[3], far.link_names[-1]
    less = [np.delete(x, 3) for x in (q, qd, qdd)]
    locked = far.locked({joint: float(q[3])})
    np.testing.assert_allclose(locked.link_poses(less[0]), far.link_poses(q), rtol=1e-14, atol=1e-8)
    np.testing.assert_allclose(
        locked.inverse_dynamics(*less), near.locked({joint: float(q[3])}).inverse_dynamics(*less), rtol=1e-8
    )
    where = far.link_poses(q)[-1]  # the payload at the near robot's last link
    place = near.link_poses(q)[-1]
    com = where[:3, :3].T @ (place[:3, 3] - where[:3, 3])
    loaded, light = far.with_payload(2.0, com), near.with_payload(2.0)
    np.testing.assert_allclose(loaded.mass_matrix(q), light.mass_matrix(q), rtol=1e-7)
    wrench = {link: np.array([1.0, 2.0, 3.0, 0, 0, 0])}
    np.testing.assert_allclose(
        far.inverse_dynamics(q, qd, qdd, external=wrench), near.inverse_dynamics(q, qd, qdd, external=wrench), rtol=1e-7
    )


@pytest.mark.parametrize("name", [*MODELS, "sliders"])
def test_ordinary_robots_are_loaded_as_written(read, name):
    """To the last bit: a lever of the robot's own size stays."""
    model = MODELS.get(name) or random_tree(5, seed=3, prismatic=1)
    loaded = read(rne.to_urdf(model)).model
    carriers = [loaded.link_joints.index(joint) for joint in loaded.moving_joints]
    assert not loaded.link_translation[carriers].any()
    for f in fields(model):
        if f.name in ("mass", "com", "translation", "axis"):
            np.testing.assert_array_equal(getattr(loaded, f.name), getattr(model, f.name), err_msg=f.name)


def test_an_arm_a_few_times_its_size_up_the_axis_is_no_mistake():
    body = {"mass": 1.0, "com": np.array([0.1, 0, 0.9]), "inertia": np.eye(3) * 1e-3}
    parts = [
        Part(link="base"),
        Part(link="a", joint="j", kind="revolute", parent=0, axis=np.array([0, 0, 1.0]), **body),
    ]
    assert far_origins(parts) == [0.0, 0.0]
    assert far_origins([parts[0], Part(**{**vars(parts[1]), "com": np.array([0.1, 0, 1e3])})]) == [0.0, 1e3]
    assert far_origins([Part(link="base")]) == [0.0]
    massless = Part(link="a", joint="j", kind="revolute", parent=0, axis=np.array([0, 0, 1.0]))
    assert far_origins([parts[0], massless]) == [0.0, 0.0]


@pytest.mark.parametrize(("mass", "moment", "size"), [(1.0, 1e-3, 0.1), (2.0, 0.03, np.sqrt(0.045))])
def test_an_origin_is_moved_beyond_ten_times_the_size_of_the_robot(mass, moment, size):
    """The size is the lever across the axis, or the radius of gyration sqrt(tr(I) / m) where it is larger."""

    def distance(lever):
        body = {"mass": mass, "com": np.array([0.1, 0, lever]), "inertia": np.eye(3) * moment}
        arm = Part(link="a", joint="j", kind="revolute", parent=0, axis=np.array([0, 0, 1.0]), **body)
        return far_origins([Part(link="base"), arm])[1]

    assert distance(9.99 * size) == 0
    assert distance(10.01 * size) == pytest.approx(10.01 * size)
    assert distance(-10.01 * size) == pytest.approx(-10.01 * size)


def test_once_one_origin_is_far_all_that_are_out_by_the_size_are_moved():
    body = {"mass": 1.0, "inertia": np.zeros((3, 3)), "axis": np.array([0, 0, 1.0]), "kind": "revolute"}
    far, near, own = ([0.1, 0, 5.0], [0.1, 0, 0.3], [0.1, 0, 0.05])
    parts = [Part(link="base")]
    parts += [
        Part(
            link=f"l{k}", joint=f"j{k}", parent=0, com=np.array(com), placement=pose(np.eye(3), [0, 0, -com[2]]), **body
        )
        for k, com in enumerate((far, near, own))
    ]
    distances = far_origins(parts)  # all centres are at (0.1, 0, 0): the size is the lever of 0.1 m
    np.testing.assert_allclose(distances, [0, 5.0, 0.3, 0], rtol=1e-12)


def test_what_a_moved_joint_carries_stays_where_it_is(read):
    """A joint and a fixed link on a link whose frame is a million metres up its axis."""

    def text(far):
        body = '<inertial><origin xyz="{}"/><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2"/>'
        at = {"turn": f"0 0 {far}", "bend": f"0.3 0 {0.5 - far}", "fixed": f"0.2 0.1 {0.25 - far}"}
        link = '<link name="{}">' + body + "</inertial></link>"
        joint = '<joint name="{0}" type="{1}"><origin xyz="{2}"/><parent link="{3}"/><child link="{4}"/>{5}</joint>'
        limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
        return (
            '<robot name="r"><link name="base"/>'
            + link.format("a", f"0.1 0 {-far}")
            + link.format("b", "0 0 0.2")
            + link.format("tool", "0.1 0 0")
            + joint.format("turn", "revolute", at["turn"], "base", "a", f'<axis xyz="0 0 1"/>{limit}')
            + joint.format("bend", "revolute", at["bend"], "a", "b", f'<axis xyz="0 1 0"/>{limit}')
            + joint.format("fixed", "fixed", at["fixed"], "a", "tool", "")
            + "</robot>"
        )

    near, far = read(text(0)), read(text(2**20))
    assert abs(far.model.translation).max() < 1
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 5, 2))
    torques = far.inverse_dynamics(q, qd, qdd), near.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(*torques, rtol=1e-9, atol=1e-9)
    places = [robot.model.link_index(link) for robot, link in ((far, "b"), (far, "tool"))]
    np.testing.assert_allclose(far.link_poses(q)[:, places], near.link_poses(q)[:, places], rtol=0, atol=1e-9)


def test_energies_and_momenta_lose_the_digits_of_the_distance_once():
    """A body far along its axis from its frame's origin, on a model that no file's reader has moved: about the origin
    its energy is a difference of numbers as large as the distance squared, about its centre of mass of the distance."""
    far, axes = 1e4, [[0, 0, 1.0], [0, 0, 1.0]]
    turned = [np.eye(3), [[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]]]
    model = rne.model.chain(
        turned, [[-far, 0.1, 0.2], [0, 0, far]], [1.0] * 2, [[0, 0, 0], [0.1, 0.2, far]], [np.eye(3)] * 2, axes=axes
    )
    q, qd, _ = states(2, 20, rate=1.0)
    for quantity in (rne.dynamics.kinetic_energy, rne.dynamics.momentum, rne.dynamics.coriolis_matrix):
        exact = quantity(model, q.astype(np.longdouble), qd.astype(np.longdouble))
        assert np.abs(quantity(model, q, qd) - exact).max() <= 50 * EPS * far * np.abs(exact).max(), quantity.__name__
