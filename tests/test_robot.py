"""What the Robot chooses, and that its choice shows only in the time."""

import copy
import dataclasses
import gc
import weakref

import numpy as np
import pytest

import rne

from .helpers import EPS, kept, states
from .random_robots import random_tree, straight_chain


@pytest.mark.parametrize("n", kept([2, 9, 10, 14, 20, 21, 30], [2, 9, 10, 21]))
def test_forward_dynamics_takes_the_method_with_fewer_operations(n):
    robot = rne.Robot(straight_chain(n))
    count = sum(robot.kernels.forward_kernel().operations.values())
    both = [robot.kernel(f) for f in (rne.dynamics.forward_dynamics, rne.dynamics.articulated_forward_dynamics)]
    assert count == min(sum(k.operations.values()) for k in both)


@pytest.mark.parametrize(
    "model",
    [
        straight_chain(5),
        random_tree(12, 4),
        pytest.param(straight_chain(15), marks=pytest.mark.long),
        pytest.param(random_tree(25, 3), marks=pytest.mark.long),
    ],
)
def test_either_method_is_as_accurate_as_the_condition_of_M_allows(model):
    q, qd, qdd = states(model.n, 3, rate=1.0, acceleration=1.0)
    robot = rne.Robot(model)
    tau = rne.dynamics.inverse_dynamics(model, *(x.astype(np.longdouble) for x in (q, qd, qdd))).astype(float)
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(model, q)).max()
    assert np.abs(robot.forward_dynamics(q, qd, tau) - qdd).max() <= 10 * model.n * kappa * EPS


def test_mimics_are_solved_through_M():
    robot = rne.Robot(random_tree(12, 6, mimics=2))
    assert robot.kernels.forward_kernel().function is rne.dynamics.forward_dynamics


def test_repr_of_a_plain_robot_is_one_line(irb140):
    assert repr(irb140) == "Robot 'irb140': 6 joints, 8 links, 75 kg moving, gravity [0.0, 0.0, -9.81] m/s^2"


def test_repr_counts_mimic_joints_and_says_what_the_file_gives_and_dynamics_leave_out():
    mimics = rne.Robot(random_tree(3, seed=3, branching=0.4, mimics=2))
    assert repr(mimics).splitlines()[1:] == ["  2 further joints mimic these"]
    for name in ("damping", "friction"):  # of one joint alone
        model = dataclasses.replace(rne.irb140(), **{name: np.arange(6) // 5 * 0.1})
        note = "  damping and friction of its <dynamics> are on record, not applied"
        assert repr(rne.Robot(model)).splitlines()[1:] == [note]


def test_copies_share_their_kernels_and_simulated_robots_are_freed():
    gc.freeze()  # what is there before need not be visited
    robot = rne.Robot(straight_chain(1))
    twin = copy.copy(robot)
    assert twin.model is robot.model
    assert twin.kernel(rne.dynamics.mass_matrix) is robot.kernel(rne.dynamics.mass_matrix)
    rne.simulate(robot, [0.1], [0], 0.01, torque=[1.0])
    alive = weakref.ref(robot)
    del robot, twin
    gc.collect()
    assert alive() is None


def test_kernels_are_kept(irb140):
    assert irb140.kernel(rne.dynamics.mass_matrix) is irb140.kernel(rne.dynamics.mass_matrix)
    assert irb140.kernel(rne.dynamics.mass_matrix) is not irb140.kernel(rne.dynamics.mass_matrix, "q")


def test_joint_order_without_the_parents_of_links(irb140):
    """A Model built by hand need not know how links on fixed joints hang together."""
    tree = random_tree(8, 5, branching=0.6)
    unknown = rne.Robot(dataclasses.replace(tree, link_parent=None))
    order = unknown.joint_order("pinocchio")
    assert sorted(order) == list(range(8))
    depth_first = [tree.joint_names[k] for k in order]
    for i, joint in enumerate(tree.moving_joints):
        if tree.parent[i] >= 0:
            assert depth_first.index(tree.moving_joints[tree.parent[i]]) < depth_first.index(joint)
    with pytest.raises(rne.ModelError, match=r"^`link_parent` must have 8 entries, got 2$"):
        dataclasses.replace(irb140.model, link_parent=(-1, 0))


def test_jacobians_of_a_point_are_those_of_the_link_and_its_turning(irb140):
    """v + w x r of a point r beside the link's origin, and the rate along a motion by central differences."""
    q, qd, point, h = *states(6, seed=3)[:2], np.array([0.1, -0.2, 0.3]), 1e-6
    J, of_point = irb140.jacobian(q, "tool0"), irb140.jacobian(q, "tool0", point)
    r = irb140.link_poses(q)[irb140.link_names.index("tool0"), :3, :3] @ point
    np.testing.assert_allclose(of_point[:3], J[:3], atol=1e-14)
    np.testing.assert_allclose(of_point[3:], J[3:] + np.cross(J[:3], r, axis=0), atol=1e-14)
    ahead, behind = (irb140.jacobian(q + s * h * qd, "tool0", point) for s in (1, -1))
    np.testing.assert_allclose(irb140.jacobian_rate(q, qd, "tool0", point), (ahead - behind) / (2 * h), atol=1e-7)
