"""From file to Model and back: fixed joints, inertial frames, joint order, limits, mimics, shapes."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rne
from rne.basics.spatial import rotation_from_rpy, rpy_from_rotation
from rne.model import Box, Cylinder

from .helpers import EPS, Oracle, each, kept, relative, states
from .random_robots import random_tree
from .test_urdf_errors import ARM, INERTIAL, LIMIT, joint, link, robot


@pytest.fixture
def read(tmp_path):
    def read(text, **options):
        path = tmp_path / "robot.urdf"
        path.write_text(text)
        return rne.load(path, **options)

    return read


def origin(xyz="0 0 0", rpy="0 0 0"):
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'


SKEW = 'xyz="0.3 -0.2 0.5" rpy="0.4 1.1 -0.7"'
TURN = '<axis xyz="0 2 0"/>' + LIMIT


def test_fixed_joint_merges_with_its_whole_transform(read):
    """The same robot with a fixed joint, and with that joint turning but held at zero."""
    hand = INERTIAL.replace("<inertial>", f"<inertial><origin {SKEW}/>")
    parts = [link("base"), link("arm"), link("hand", hand), joint("elbow", "base", "arm", inside=TURN)]
    wrist = f"<origin {SKEW}/>"
    fixed = read(robot(*parts, joint("wrist", "arm", "hand", "fixed", wrist)))
    held = read(robot(*parts, joint("wrist", "arm", "hand", inside=wrist + TURN)))
    q, qd, qdd = states(1, 20)
    zero = np.zeros_like(q)
    full = held.inverse_dynamics(*(np.concatenate([x, zero], axis=1) for x in (q, qd, qdd)))
    assert relative(fixed.inverse_dynamics(q, qd, qdd), full[:, :1]) <= 1e-14
    assert relative(held.locked({"wrist": 0.0}).inverse_dynamics(q, qd, qdd), full[:, :1]) <= 1e-14
    assert fixed.link_names == held.link_names == ("base", "arm", "hand")
    np.testing.assert_allclose(fixed.link_poses(q), held.link_poses(np.concatenate([q, zero], 1)), atol=1e-15)


def test_a_thousand_fixed_joints_give_the_digits_of_one(read):
    """A chain of fixed joints that turns by a real angle at each step, against its product in long double."""
    count, rpy = 1000, (0.01, -0.02, 0.03)
    step = origin("0.001 0.002 0", " ".join(map(str, rpy)))
    links = [link("base", ""), *(link(f"l{k}", "") for k in range(count)), link("arm")]
    names = ["base", *(f"l{k}" for k in range(count))]
    joints = [joint(f"f{k}", names[k], names[k + 1], "fixed", step) for k in range(count)]
    chain = read(robot(*links, *joints, joint("elbow", names[-1], "arm", inside=TURN)))
    R, p = np.eye(3, dtype=np.longdouble), np.zeros(3, dtype=np.longdouble)
    one = rotation_from_rpy(np.array(rpy, dtype=np.longdouble))
    for _ in range(count):
        p, R = p + R @ np.array([0.001, 0.002, 0], dtype=np.longdouble), R @ one
    assert np.abs(chain.model.rotation[0] - R).max() <= EPS
    assert np.abs(chain.model.translation[0] - p).max() <= EPS


def test_many_fixed_right_angles_leave_exact_zeros(read):
    quarter = origin(rpy=f"{np.pi / 2} 0 0")
    links = [link(f"l{k}", "") for k in range(400)]
    joints = [joint(f"f{k}", f"l{k}", f"l{k + 1}", "fixed", quarter) for k in range(399)]
    chain = read(robot(*links, *joints, link("arm"), joint("elbow", "l399", "arm", inside=quarter + TURN)))
    assert np.array_equal(chain.model.rotation[0], np.eye(3))


def test_inertial_rpy_turns_the_inertia(read):
    inertial = (
        f'<inertial><origin {SKEW}/><mass value="2"/>'
        '<inertia ixx="0.1" ixy="0.01" ixz="0.02" iyy="0.2" iyz="-0.03" izz="0.25"/></inertial>'
    )
    model = read(robot(link("base"), link("arm", inertial), ARM[2])).model
    I = np.array([[0.1, 0.01, 0.02], [0.01, 0.2, -0.03], [0.02, -0.03, 0.25]])
    R = rotation_from_rpy(np.array([0.4, 1.1, -0.7]))
    np.testing.assert_allclose(model.inertia[0], R @ I @ R.T, atol=1e-16)
    assert model.com[0].tolist() == [0.3, -0.2, 0.5]


def test_joints_are_ordered_by_the_file_among_those_whose_parent_is_placed(read):
    text = robot(
        *(link(name) for name in ("base", "a", "b", "c", "d")),
        joint("late", "b", "d"),
        joint("z", "base", "a"),
        joint("y", "base", "b"),
        joint("x", "a", "c"),
    )
    loaded = read(text)
    assert loaded.joint_names == ("z", "y", "late", "x")
    assert loaded.link_names == ("base", "a", "b", "d", "c")


def test_mimic_chains_compose(read):
    text = robot(
        *(link(name) for name in ("base", "a", "b", "c")),
        joint("one", "base", "a"),
        joint("two", "a", "b", inside=LIMIT + '<mimic joint="one" multiplier="2" offset="0.5"/>'),
        joint("three", "b", "c", inside=LIMIT + '<mimic joint="two" multiplier="-3" offset="0.25"/>'),
    )
    model = read(text).model
    assert model.joint_names == ("one",)
    assert model.coordinate_map.tolist() == [[1.0], [2.0], [-6.0]]
    assert model.offset.tolist() == [0.0, 0.5, -1.25]


@pytest.mark.parametrize("count", kept([200, 1000], [200]))
def test_a_long_row_of_mimics_composes_in_either_order_of_the_file(read, count):
    joints = [joint("j0", "l0", "l1")]
    for k in range(1, count):
        inside = LIMIT + f'<mimic joint="j{k - 1}" multiplier="-1" offset="1"/>'
        joints.append(joint(f"j{k}", f"l{k}", f"l{k + 1}", inside=inside))
    links = [link(f"l{k}") for k in range(count + 1)]
    for text in (robot(*links, *joints), robot(*links, *reversed(joints))):
        model = read(text).model
        assert model.multiplier.tolist() == [1.0, -1.0] * (count // 2)
        assert model.offset.tolist() == [0.0, 1.0] * (count // 2)


def test_mimic_may_come_before_the_joint_it_follows(read):
    text = robot(
        *(link(name) for name in ("base", "a", "b")),
        joint("one", "base", "a", inside=LIMIT + '<mimic joint="two"/>'),
        joint("two", "a", "b"),
    )
    assert read(text).joint_names == ("two",)


def test_without_axis_it_is_x(read):
    assert read(robot(*ARM[:2], joint("elbow", "base", "arm", inside=LIMIT))).model.axis.tolist() == [[1, 0, 0]]


@pytest.mark.parametrize("length", ["1e-200", "3", "1e200"])
def test_an_axis_of_any_length_is_a_direction(read, length):
    axis = f'<axis xyz="{length} -{length} 0"/>'
    got = read(robot(*ARM[:2], joint("elbow", "base", "arm", inside=axis + LIMIT))).model.axis[0]
    assert got.tolist() == [np.sqrt(0.5), -np.sqrt(0.5), 0]


INFINITE = [-np.inf, np.inf, np.inf, np.inf]
MOST = float(np.finfo(float).max)
LIMITS = {
    "given": ("prismatic", '<limit lower="-1" upper="2" velocity="3" effort="4"/>', [-1, 2, 3, 4]),
    "no element": ("revolute", "", INFINITE),
    "no attribute": ("revolute", "<limit/>", [0, 0, np.inf, np.inf]),
    "upper only": ("revolute", '<limit upper="1"/>', [0, 1, np.inf, np.inf]),
    "zero": ("revolute", '<limit lower="-1" upper="1" velocity="0" effort="0"/>', [-1, 1, 0, 0]),
    "no bounds of a continuous joint": (
        "continuous",
        '<limit lower="-1" upper="2" velocity="3" effort="4"/>',
        [-np.inf, np.inf, 3, 4],
    ),
    "the largest double": (
        "revolute",
        f'<limit lower="-{MOST!r}" upper="{MOST!r}" velocity="{MOST!r}" effort="{MOST!r}"/>',
        INFINITE,
    ),
}


@pytest.mark.parametrize("name", LIMITS)
def test_limits(read, name):
    kind, text, expected = LIMITS[name]
    m = read(robot(*ARM[:2], joint("elbow", "base", "arm", kind, text))).model
    assert [x[0] for x in (m.lower, m.upper, m.velocity_limit, m.effort_limit)] == expected


def test_cylinders_and_boxes_are_kept_for_drawing(read):
    def visual(size, place=""):
        return f"<visual>{place}<geometry>{size}</geometry></visual>"

    first, second = '<cylinder radius="0.1" length="2"/>', '<cylinder radius="3" length="0.5"/>'
    shapes = (
        visual(first, f"<origin {SKEW}/>") + visual('<box size="1 2 3"/>') + visual(second, '<origin rpy="1 2 3"/>')
    )
    model = read(robot(link("base", visual(second)), link("arm", INERTIAL + shapes), ARM[2])).model
    assert model.shapes == (
        Cylinder("base", 3, 0.5, (0, 0, 0), (0, 0, 0)),
        Cylinder("arm", 0.1, 2, (0.3, -0.2, 0.5), (0.4, 1.1, -0.7)),
        Box("arm", (1, 2, 3), (0, 0, 0), (0, 0, 0)),
        Cylinder("arm", 3, 0.5, (0, 0, 0), (1, 2, 3)),
    )


def test_dynamics_are_recorded_and_reported_as_not_applied(read):
    loaded = read(
        robot(*ARM[:2], joint("elbow", "base", "arm", inside=LIMIT + '<dynamics damping="0.5" friction="2"/>'))
    )
    assert (loaded.model.damping[0], loaded.model.friction[0]) == (0.5, 2.0)
    assert repr(loaded).endswith("damping and friction of its <dynamics> are on record, not applied")


def test_a_link_and_a_joint_may_share_a_name(read):
    assert read(robot(*ARM[:2], joint("arm", "base", "arm"))).joint_names == ("arm",)


def test_default_namespace_comments_and_instructions_are_allowed(read):
    text = (
        '<?xml version="1.0"?><robot name="r" xmlns="http://www.ros.org"><!-- a --><?pi?>' + "".join(ARM) + "</robot>"
    )
    assert read(text).n == 1


def test_whitespace_of_any_kind_separates_numbers(read):
    assert read(robot(*ARM[:2], joint("e", "base", "arm", inside='<axis xyz=" 0\t0\n 3. "/>' + LIMIT))).model.axis[
        0
    ].tolist() == [0, 0, 1]


def test_tiny_and_huge_robots_are_robots(read):
    for scale in (1e-9, 1e9):
        body = INERTIAL.replace('"0.1"', f'"{0.1 * scale**5!r}"').replace('value="1"', f'value="{scale**3!r}"')
        arm = read(
            robot(
                link("base"), link("arm", body), joint("e", "base", "arm", inside=f'<origin xyz="{scale} 0 0"/>' + TURN)
            )
        )
        assert arm.mass_matrix([0.3])[0, 0] == pytest.approx(0.1 * scale**5, rel=1e-12)
        assert np.isfinite(arm.forward_dynamics([0.3], [1.0], [0.0])).all()


def test_real_small_angles_are_kept(read):
    arm = read(robot(*ARM[:2], joint("e", "base", "arm", inside=origin(rpy="1e-9 0 0") + LIMIT)))
    assert arm.model.rotation[0, 2, 1] == 1e-9


def test_generated_names_survive_a_round_trip(read):
    odd = ["a b", "x'y", 'q"r', "<&>", "ж", "1"]
    text = rne.to_urdf(rne.irb140())
    from xml.sax.saxutils import quoteattr

    for k, name in enumerate(odd, 1):
        text = text.replace(f'"link_{k}"', quoteattr(name))
    loaded = read(text)
    assert loaded.link_names == ("base_link", *odd, "tool0")
    assert rne.to_urdf(loaded.model).count("<link") == 8


@settings(max_examples=15, deadline=None, derandomize=True)
@given(st.integers(0, 6), st.integers(0, 2**32 - 1), st.integers(0, 2))
def test_written_robots_read_back(n, seed, mimics):
    import tempfile
    from pathlib import Path

    model = random_tree(n, seed, mimics=mimics if n else 0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tree.urdf"
        path.write_text(rne.to_urdf(model))
        back = rne.read_urdf(path, gravity=model.gravity)
    assert (back.joint_names, back.link_names) == (model.joint_names, model.link_names)
    s = states(n, 3, seed=seed % 1000)
    assert relative(rne.dynamics.inverse_dynamics(back, *s), rne.dynamics.inverse_dynamics(model, *s)) <= 1e-12
    assert relative(rne.dynamics.mass_matrix(back, s[0]), rne.dynamics.mass_matrix(model, s[0])) <= 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_written_trees_agree_with_pinocchio(seed):
    model = random_tree(6, seed, mimics=2)
    oracle = Oracle(model, rne.to_urdf(model))
    s = states(6, 5)
    assert relative(rne.dynamics.inverse_dynamics(model, *s), each(oracle.inverse_dynamics, *s)) <= 1e-12


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.tuples(*[st.floats(-4, 4)] * 3))
def test_rpy_of_a_rotation_gives_the_rotation(rpy):
    R = rotation_from_rpy(np.array(rpy))
    np.testing.assert_allclose(rotation_from_rpy(rpy_from_rotation(R)), R, atol=1e-15 * 4)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.data())
def test_a_damaged_file_is_an_error_or_a_robot_never_a_crash(data):
    """Cut, repeat or replace pieces of a valid file: UrdfError or a Model, nothing else."""
    import tempfile
    from pathlib import Path

    text = robot(*ARM, link("hand"), joint("wrist", "arm", "hand", "continuous"))
    tokens = re.split(r'(?<=[>"<= ])', text)
    for _ in range(data.draw(st.integers(1, 4))):
        k = data.draw(st.integers(0, len(tokens) - 1))
        other = data.draw(st.sampled_from([*tokens, "", "nan", "-1", "1e308", "arm", "\x00", "<", "é"]))
        tokens[k] = other
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.urdf"
        path.write_bytes("".join(tokens).encode())
        try:
            loaded = rne.read_urdf(path)
        except rne.UrdfError as error:
            assert str(error).startswith(str(path))
        else:
            assert isinstance(loaded, rne.Model)
