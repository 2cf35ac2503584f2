"""What a Model refuses, with the joint, body or link at fault; what it holds and derives."""

import pickle
import re
from dataclasses import replace

import numpy as np
import pytest

import rne
from examples.thesis.formulations import irb140_mirrored
from rne.model.abb_irb140 import DATA_SHEET
from rne.model.parameters import at_parameters, of_states

from .random_robots import random_tree, straight_chain

TREE = random_tree(3, seed=2, mimics=1)
SKEW = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])


def edited(name, k, value):
    """TREE with one entry of an array or tuple replaced."""
    old = getattr(TREE, name)
    new = old.copy() if isinstance(old, np.ndarray) else list(old)
    new[k] = value
    return replace(TREE, **{name: new if isinstance(old, np.ndarray) else tuple(new)})


def faults():
    joints, links = TREE.moving_joints, TREE.link_names
    last, mimic = 3, (set(range(4)) - set(TREE.independent_joints)).pop()
    rotation = "must be a rotation: orthogonal with determinant +1"
    for k in range(4):
        longer = TREE.axis[k] * (1 + 1e-10)
        text = f"joint {joints[k]!r}: `axis` must be a unit vector, got length {np.linalg.norm(longer):.17g}"
        yield "axis", k, longer, text
        yield "rotation", k, -TREE.rotation[k], f"joint {joints[k]!r}: `rotation` {rotation}"
        yield "mass", k, -1.0, f"body of joint {joints[k]!r}: the mass must be 0 or positive, got -1.0"
    yield "rotation", last, TREE.rotation[last] * (1 + 1e-10), f"joint {joints[last]!r}: `rotation` {rotation}"
    yield "link_rotation", 1, 2 * np.eye(3), f"link {links[1]!r}: `link_rotation` {rotation}"
    yield "inertia", 0, TREE.inertia[0] + SKEW, f"body of joint {joints[0]!r}: the inertia must be symmetric"
    yield "parent", 2, 2, f"joint {joints[2]!r}: parent must be one of the 2 bodies before it, got 2"
    yield "parent", 0, -2, f"joint {joints[0]!r}: parent must be one of the 0 bodies before it, got -2"
    yield "link_body", 1, 4, f"link {links[1]!r}: body must be from -1 to 3, got 4"
    yield "link_body", 1, -2, f"link {links[1]!r}: body must be from -1 to 3, got -2"
    yield "moving_joints", 1, "no", "joint 'no': no link of body 1 is carried by it"
    yield "link_names", 1, links[0], f"link {links[0]!r} is duplicated"
    yield "coordinate", mimic, 3, f"joint {joints[mimic]!r}: coordinate must be from 0 to 2, got 3"
    yield "coordinate", mimic, -1, f"joint {joints[mimic]!r}: coordinate must be from 0 to 2, got -1"
    yield "independent_joints", 0, 4, "`independent_joints[0]` must be a joint of coordinate 0, got 4"
    yield "independent_joints", 0, -1, "`independent_joints[0]` must be a joint of coordinate 0, got -1"
    independent = f"joint {joints[0]!r}: an independent joint has multiplier 1 and offset 0"
    yield "multiplier", 0, 2.0, independent
    yield "offset", 0, 0.1, independent
    yield "gravity", 1, np.nan, "`gravity` must be finite, got nan at index (1,)"
    yield "damping", 3, np.inf, "`damping` must be finite, got inf at index (3,)"
    for name in ("lower", "upper", "effort_limit", "velocity_limit", "acceleration_limit", "jerk_limit"):
        yield name, 2, np.nan, f"`{name}` must be finite, got nan at index (2,)"


@pytest.mark.parametrize(("name", "k", "value", "text"), list(faults()))
def test_what_contradicts_itself_is_refused(name, k, value, text):
    with pytest.raises(rne.ModelError, match=f"^{re.escape(text)}$"):
        edited(name, k, value)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"mass": np.ones(3)}, "`mass` must have shape (4,), got (3,)"),
        ({"axis": np.ones((4, 2))}, "`axis` must have shape (4, 3), got (4, 2)"),
        ({"inertia": np.ones((4, 3))}, "`inertia` must have shape (4, 3, 3), got (4, 3)"),
        ({"jerk_limit": np.ones(1)}, "`jerk_limit` must have shape (4,), got (1,)"),
        ({"base_inertia": np.ones(3)}, "`base_inertia` must have shape (3, 3), got (3,)"),
        ({"gravity": np.ones(2)}, "`gravity` must have shape (3,), got (2,)"),
        ({"joint_types": ("revolute",)}, "`joint_types` must have 4 entries, got 1"),
        ({"base_mass": -1.0}, "base: the mass must be 0 or positive, got -1.0"),
        ({"base_mass": np.inf}, "`base_mass` must be finite, got inf"),
        ({"effort_limit": np.array([1, -1.0, 0, 2])}, "`effort_limit` must not be negative, got -1.0 at index (1,)"),
        ({"deceleration_limit": -np.ones(4)}, "`deceleration_limit` must not be negative, got -1.0 at index (0,)"),
        ({"armature": np.array([0, 1, -1.0, 0])}, "`armature` must not be negative, got -1.0 at index (2,)"),
    ],
)
def test_fields_of_a_wrong_shape_are_refused(changes, text):
    with pytest.raises(rne.ModelError, match=f"^{re.escape(text)}$"):
        replace(TREE, **changes)


def test_rounding_of_unit_vectors_and_inertias_is_no_fault():
    edited("axis", 0, TREE.axis[0] * (1 + 4e-13))
    edited("lower", 0, -np.inf)
    R = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turned = R @ np.diag([1.0, 2, 2.5]) @ R.T
    assert not np.array_equal(turned, turned.T)
    rne.model.with_payload(TREE, 1.0, inertia=turned, link=TREE.link_names[-1])
    with pytest.raises(ValueError, match=r"the inertia must be symmetric$"):
        rne.model.with_payload(TREE, 1.0, inertia=turned + 1e-10 * SKEW, link=TREE.link_names[-1])
    thin = np.diag([1.0, 1.0, 0.0])
    edited("inertia", 0, thin - np.diag([0, 0, 1e-13]))
    with pytest.raises(rne.ModelError, match="the inertia must have no negative eigenvalue"):
        edited("inertia", 0, thin - np.diag([0, 0, 1e-9 + 1e-9 * TREE.com[0] @ TREE.com[0] * TREE.mass[0]]))


def test_triangle_excess_is_relative_to_the_trace():
    for scale in (1e-3, 1e3):
        for largest in (2.5, 3 + 0.9 * 6e-12):  # 1e-12 of the trace is rounding
            rne.model.with_payload(TREE, 1.0, inertia=scale * np.diag([1, 2, largest]), link="root")
        with pytest.raises(ValueError, match="the largest principal moment of inertia must not exceed"):
            rne.model.with_payload(TREE, 1.0, inertia=scale * np.diag([1, 2, 3 + 1.1 * 6e-12]), link="root")
    rne.model.with_payload(TREE, 1.0, inertia=np.zeros((3, 3)), link="root")


def test_arrays_are_read_only_copies_and_models_compare_by_value():
    mass = TREE.mass.copy()
    model = replace(TREE, mass=mass)
    mass[0] = 7
    assert model == TREE
    assert hash(model) == hash(TREE)
    assert pickle.loads(pickle.dumps(model)) == TREE
    with pytest.raises(ValueError, match="read-only"):
        model.mass[0] = 1.0
    assert replace(TREE, mass=2 * TREE.mass) != TREE
    assert TREE.astype(np.float32) != TREE
    assert replace(TREE, notes={"robot": "other"}) == TREE
    assert TREE != 1


def test_a_robot_of_parts_seen_from_its_links_has_no_shifted_links(tmp_path):
    arm = rne.model.chain([np.eye(3)] * 2, [[0, 0, 1.0]] * 2, [1.0, 1.0], np.zeros((2, 3)), [np.eye(3)] * 2)
    moved = replace(arm, link_translation=arm.link_translation + [[0, 0, 0], *[[0, 0, 5]] * 3])
    for model, com in ((arm, "0 0 0"), (moved, "0 0 -5")):
        text = rne.to_urdf(model)
        assert re.findall('<inertial>\n *<origin xyz="(.*?)"', text) == [com] * 2
        (tmp_path / "arm.urdf").write_text(text)
        poses = [rne.dynamics.link_poses(x, [0.0, 0.0]) for x in (model, rne.read_urdf(tmp_path / "arm.urdf"))]
        np.testing.assert_allclose(*poses, rtol=0, atol=1e-14)


def test_the_mirrored_arm_has_the_ranges_of_the_arm():
    """They lie symmetric about zero, so that reversing an axis does not change them."""
    arm, mirrored = rne.irb140(), irb140_mirrored()
    for name in ("lower", "upper"):
        np.testing.assert_array_equal(getattr(mirrored, name), getattr(arm, name))


def test_moments_given_for_each_state_go_before_those_of_the_bodies():
    model = random_tree(2, seed=1)
    factors = np.array([1.0, 2.0, 3.0])
    batch = at_parameters(model, factors[:, None] * rne.Robot(model).parameters)
    np.testing.assert_allclose(batch.moments.mass, factors[:, None] * model.mass)
    np.testing.assert_allclose(of_states(batch, 2).moments.inertia, 3 * model.moments.inertia, rtol=0, atol=1e-14)
    assert batch.astype(np.float32).moments.mass.dtype == np.float32
    one = at_parameters(model, rne.Robot(model).parameters)
    assert of_states(one, 0) is one
    assert of_states(model, 0) is model
    assert model.given_moments is None


def test_links_whose_parents_are_not_known_are_on_the_first_link_of_their_body():
    model = random_tree(3, seed=0)
    unknown = replace(model, link_parent=None)
    carrier = [model.link_joints.index(joint) for joint in model.moving_joints]
    for k, joint in enumerate(model.link_joints):
        if joint in model.moving_joints:
            i = model.moving_joints.index(joint)
            above = model.parent[i]
            assert unknown.link_parent[k] == (carrier[above] if above >= 0 else 0)
        else:
            assert unknown.link_parent[k] == (carrier[model.link_body[k]] if model.link_body[k] >= 0 else 0) - (k == 0)


def test_random_trees_are_the_same_in_every_release():
    """Their seeds stand in tests and in tables of measurements."""
    tree = random_tree(5, seed=8, mimics=2)
    assert tree.name == "tree5-8"
    assert [kind[0] for kind in tree.joint_types] == list("rcrcprr")
    assert (tree.parent, tree.coordinate) == ((-1, 0, 0, 2, 1, 4, 5), (0, 1, 2, 3, 4, 1, 2))
    assert tree.link_names == tuple(
        ["root", "link0", "link1", "tool1", "link2", "tool2", "link3", "link4", "link5", "link6"]
    )
    np.testing.assert_allclose(tree.mass.sum(), 41.49635131607662, rtol=1e-12)
    np.testing.assert_allclose(tree.base_mass, 3.707734335268351, rtol=1e-12)
    np.testing.assert_allclose(tree.gravity, [3.27007514, -5.60870966, -3.12241803], rtol=1e-8)
    np.testing.assert_allclose(tree.translation.sum(0), [-1.0765957, 1.11285909, 0.46742451], rtol=1e-7)
    np.testing.assert_allclose(tree.com.sum(0), [-0.09537208, 0.02396098, -0.1423786], rtol=1e-6)
    np.testing.assert_allclose(tree.rotation.sum(), 10.382283658232538, rtol=1e-12)
    np.testing.assert_allclose(tree.inertia.sum(), 7.997471844875162, rtol=1e-12)
    np.testing.assert_allclose(tree.multiplier[5:], [1.54355831, 2.03188039], rtol=1e-8)
    np.testing.assert_allclose(tree.offset[5:], [0.347232, -1.2340541], rtol=1e-6)
    assert "prismatic" not in random_tree(8, seed=1, prismatic=0).joint_types
    assert random_tree(8, seed=1, branching=0).parent == tuple(range(-1, 7))


def test_a_straight_chain_is_of_slender_rods_end_to_end():
    chain = straight_chain(3, length=0.4, mass=2.0)
    assert chain.com.tolist() == [[0, 0, -0.2]] * 3
    assert chain.translation.tolist() == [[0, 0, 0], [0, 0, -0.4], [0, 0, -0.4]]
    np.testing.assert_allclose(chain.inertia, [np.diag([2 * 0.4**2 / 12] * 2 + [0])] * 3, rtol=1e-15)
    assert chain.axis.tolist() == [[0, 1, 0]] * 3
    default = straight_chain(1)
    assert (default.mass.tolist(), default.com[0, 2].item()) == ([1.0], -0.15)
    assert default.name == "chain1"


def test_the_data_sheet_has_the_numbers_as_printed():
    """A second transcription, without units and sources."""
    values = {name: datum.value for name, datum in DATA_SHEET.items()}
    assert values == {
        "ranges": (360, 200, 280, 400, 240, 800),
        "speeds": (200, 200, 260, 360, 360, 450),
        "fast_speeds": (250, 250, 260, 360, 360, 450),
        "payload": 6,
        "upper_arm_load": 1,
        "wrist_load": 0.5,
        "tcp_speed": 2.5,
        "tcp_acceleration": 20,
        "acceleration_time": 0.15,
        "repeatability": 0.03,
        "reach": 810,
        "cycle_time": 0.85,
        "fast_cycle_time": 0.77,
    }
