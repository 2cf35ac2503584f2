"""Robots from arrays as in the thesis's appendix B, and from Denavit-Hartenberg tables."""

import io
import re
from dataclasses import fields, replace

import numpy as np
import pytest

import rne
from rne.model.abb_irb140 import DATA_SHEET, LINKS, frame_rotation

from .helpers import Oracle, each, relative, states

ROUNDING = 1e-15  # of entries of the order of 1: the table's numbers are added in another order
ORACLE = 1e-13  # of the largest entry; seen: at most 2.6e-15 over 80 such robots
LIMITS = {
    "lower": -np.radians(np.array(DATA_SHEET["ranges"].value) / 2),
    "upper": np.radians(np.array(DATA_SHEET["ranges"].value) / 2),
    "velocity": np.radians(DATA_SHEET["speeds"].value),
}
R = np.array([frame_rotation(link) for link in LINKS])
ENDS = np.array([link.r_end for link in LINKS])
CENTRES = np.array([link.r_com for link in LINKS])
MASSES = np.array([link.mass for link in LINKS])
INERTIAS = np.array([rne.model.cylinder_inertia(link.mass, link.radius, link.height, link.along) for link in LINKS])
# Chapter 4 of the thesis, standard convention
TABLE = {
    "a": [0.070, 0.360, 0, 0, 0, 0],
    "alpha": [-np.pi / 2, 0, -np.pi / 2, np.pi / 2, np.pi / 2, 0],
    "d": [0.352, 0, 0, 0.380, 0, 0.065],
    "theta": [0, -np.pi / 2, 0, 0, np.pi, 0],
}


def rz(x):
    return np.array([[np.cos(x), -np.sin(x), 0, 0], [np.sin(x), np.cos(x), 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def rx(x):
    return np.array([[1, 0, 0, 0], [0, np.cos(x), -np.sin(x), 0], [0, np.sin(x), np.cos(x), 0], [0, 0, 0, 1.0]])


def shift(x, y, z):
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def dh_matrix(row, convention):
    """The matrix of one row as the textbooks print it: standard (Siciliano 2.52), modified (Craig 3.6)."""
    a, alpha, d, theta = row
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    if convention == "standard":
        return np.array(
            [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]]
        )
    return np.array([[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]])


def table_at(robot, q):
    """Rows (a, alpha, d, theta) with the joints' positions put in."""
    sliding = np.array(robot["types"]) == "prismatic"
    d, theta = robot["d"] + q * sliding, robot["theta"] + q * ~sliding
    return np.stack([robot["a"], robot["alpha"], d, theta], axis=1)


def random_table(seed, n=5):
    """A random table with physical bodies, gravity in any direction."""
    rng = np.random.default_rng(seed)
    inertias = []
    for _ in range(n):
        Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        inertias.append(Q @ np.diag(rng.uniform(0.1, 0.19, 3)) @ Q.T)
    return {
        "a": rng.uniform(-0.5, 0.5, n),
        "alpha": rng.choice([0, np.pi / 2, -np.pi / 2, 0.7, -2.1], n),
        "d": rng.uniform(-0.5, 0.5, n),
        "theta": rng.uniform(-np.pi, np.pi, n),
        "types": list(rng.choice(["revolute", "prismatic"], n, p=[0.6, 0.4])),
        "masses": rng.uniform(0.5, 5, n),
        "centres": rng.uniform(-0.3, 0.3, (n, 3)),
        "inertias": np.array(inertias),
        "gravity": rng.uniform(-10, 10, 3),
    }


@pytest.fixture(params=[(c, s) for c in ("standard", "modified") for s in range(4)], ids=lambda p: f"{p[0]}-{p[1]}")
def dh(request):
    """A random table, its convention, and its Model."""
    convention, seed = request.param
    table = random_table(seed)
    return table, convention, rne.dh_chain(convention=convention, **table)


def pinocchio_by_hand(table, convention):
    """The robot built joint by joint in Pinocchio: joint i turns or slides along z of its own frame there.

    In the standard convention that frame is DH frame i-1, turned and lifted by the joint, and DH frame i sits at a
    fixed place in it; in the modified one it is DH frame i itself.
    """
    pin = pytest.importorskip("pinocchio")
    model = pin.Model()
    model.gravity.linear = np.array(table["gravity"])
    parent, fixed = 0, np.eye(4)
    for i, kind in enumerate(table["types"]):
        a, alpha, d, theta = (table[name][i] for name in ("a", "alpha", "d", "theta"))
        before, after = rz(theta) @ shift(0, 0, d), shift(a, 0, 0) @ rx(alpha)
        if convention == "modified":
            before, after = rx(alpha) @ shift(a, 0, 0) @ before, np.eye(4)
        joint = pin.JointModelPZ() if kind == "prismatic" else pin.JointModelRZ()
        parent = model.addJoint(parent, joint, pin.SE3(fixed @ before), f"joint_{i + 1}")
        body = pin.Inertia(float(table["masses"][i]), np.array(table["centres"][i]), np.array(table["inertias"][i]))
        model.appendBodyToJoint(parent, body, pin.SE3(after))
        fixed = after
    return pin, model


# The IRB 140


def test_appendix_b_arrays_are_the_built_in_robot():
    arm = rne.model.chain(R, ENDS, MASSES, CENTRES, INERTIAS, **LIMITS, name="irb140")
    built = rne.irb140()
    assert arm.link_parent == built.link_parent
    assert replace(arm, shapes=built.shapes) == built


def test_its_dh_table_is_the_built_in_robot_up_to_rounding_of_centres():
    """Centres count from the far ends in the table, from the near ones in the thesis: their difference is rounded."""
    arm = rne.dh_chain(**TABLE, masses=MASSES, centres=CENTRES - ENDS, inertias=INERTIAS, **LIMITS, name="irb140")
    built = rne.irb140()
    np.testing.assert_allclose(arm.com, built.com, rtol=0, atol=ROUNDING)
    assert replace(arm, com=built.com, shapes=built.shapes) == built


def test_frames_with_given_axes_are_those_of_the_default(irb140):
    b = irb140.model.axis * np.array([[2.0], [1], [0.1], [1], [1e300], [1e-300]])  # of any length
    assert rne.model.chain(R, ENDS, MASSES, CENTRES, INERTIAS, axes=b) == rne.model.chain(
        R, ENDS, MASSES, CENTRES, INERTIAS
    )


def test_rounded_right_angles_cost_nothing(irb140):
    """Rotations multiplied out from sines and cosines of pi/2, 6e-17 where a zero is meant."""
    rough = np.array([(rz(link.theta) @ rx(link.a))[:3, :3] for link in LINKS])
    assert np.abs(rough - R).max() > 0
    arm = rne.model.chain(rough, ENDS, MASSES, CENTRES, INERTIAS)
    assert sum(rne.compile(rne.dynamics.inverse_dynamics, arm).operations.values()) == 280


# A published robot

PUMA = {
    "a": [0, 0.4318, 0.0203, 0, 0, 0],
    "alpha": np.array([1, 0, -1, 1, -1, 0]) * np.pi / 2,
    "d": [0, 0, 0.15005, 0.4318, 0, 0],
    "theta": np.zeros(6),
    "masses": [0, 17.4, 4.8, 0.82, 0.34, 0.09],
    "centres": [
        [0, 0, 0], [-0.3638, 0.006, 0.2275], [-0.0203, -0.0141, 0.070], [0, 0.019, 0], [0, 0, 0], [0, 0, 0.032],
    ],
    "inertias": [
        np.diag(x)
        for x in (
            [0, 0.35, 0], [0.13, 0.524, 0.539], [0.066, 0.086, 0.0125],
            [1.8e-3, 1.3e-3, 1.8e-3], [0.3e-3, 0.4e-3, 0.3e-3], [0.15e-3, 0.15e-3, 0.04e-3],
        )
    ],
}  # fmt: skip
PRINTED = 5.001e-5  # four decimals


def test_puma_560_has_the_torques_and_m_that_corkes_toolbox_prints():
    """`mdl_puma560`: p560.gravload(qn), and gravload and inertia at (1, 2, ... 6); motors as inertia of the drives."""
    gear, motor = [62.6111, 107.815, 53.7063, 76.0364, 71.923, 76.686], [200e-6] * 3 + [33e-6] * 3
    puma = replace(rne.dh_chain(**PUMA), armature=np.square(gear) * motor)
    at_n = rne.dynamics.gravity_torque(puma, [0, np.pi / 4, np.pi, 0, np.pi / 4, 0])
    np.testing.assert_allclose(at_n, [0, 31.6399, 6.0351, 0, 0.0283, 0], rtol=0, atol=PRINTED)
    q = np.arange(1.0, 7.0)
    np.testing.assert_allclose(
        rne.dynamics.gravity_torque(puma, q), [0, -7.9683, 8.4581, -0.0197, 0.0027, 0], rtol=0, atol=PRINTED
    )
    M = [
        [2.6152, -0.6550, -0.0363, 0.0001, 0.0010, 0],
        [-0.6550, 4.3038, 0.2953, -0.0008, -0.0017, 0],
        [-0.0363, 0.2953, 0.9366, -0.0009, -0.0006, 0],
        [0.0001, -0.0008, -0.0009, 0.1926, 0, 0],
        [0.0010, -0.0017, -0.0006, 0, 0.1713, 0],
        [0, 0, 0, 0, 0, 0.1941],
    ]
    np.testing.assert_allclose(rne.dynamics.mass_matrix(puma, q), M, rtol=0, atol=PRINTED)


# Random tables


def test_last_frame_is_the_product_of_the_printed_matrices(dh):
    table, convention, model = dh
    for q in states(model.n, 5)[0]:
        T = np.eye(4)
        for i, row in enumerate(table_at(table, q)):
            T = T @ dh_matrix(row, convention)
            link = rne.dynamics.link_poses(model, q)[model.link_index(f"link_{i + 1}")]
            np.testing.assert_allclose(link[:3, :3], T[:3, :3], atol=1e-14)
            if convention == "modified":
                np.testing.assert_allclose(link, T, atol=1e-13)
        np.testing.assert_allclose(rne.dynamics.link_poses(model, q)[-1], T, atol=1e-13)


def test_dynamics_are_those_of_pinocchio_built_by_hand(dh):
    table, convention, model = dh
    pin, theirs = pinocchio_by_hand(table, convention)
    data, motion = theirs.createData(), states(model.n, 20, seed=1)
    torques = each(lambda *s: pin.rnea(theirs, data, *s), *motion)
    assert relative(rne.dynamics.inverse_dynamics(model, *motion), torques) <= ORACLE
    M = each(lambda q: pin.crba(theirs, data, q).copy(), motion[0])
    assert relative(rne.dynamics.mass_matrix(model, motion[0]), M) <= ORACLE


def test_the_exported_file_is_the_same_robot_to_pinocchio(dh):
    pytest.importorskip("pinocchio")
    _, _, model = dh
    oracle, motion = Oracle(model, rne.to_urdf(model)), states(model.n, 10, seed=2)
    assert relative(rne.dynamics.inverse_dynamics(model, *motion), each(oracle.inverse_dynamics, *motion)) <= ORACLE
    assert relative(rne.dynamics.mass_matrix(model, motion[0]), each(oracle.mass_matrix, motion[0])) <= ORACLE


ANY_INERTIA = "mass and inertia are those of a body lighter than air"  # as random ones may be


def test_file_and_back_is_the_same_model(dh, tmp_path):
    """Rotations by other than right angles may change in the last digit, as a file holds angles."""
    _, _, model = dh
    path = tmp_path / "chain.urdf"
    path.write_text(rne.to_urdf(model), encoding="utf-8")
    assert {finding.kind for finding in rne.check(path, out=io.StringIO())} <= {ANY_INERTIA}
    again = rne.read_urdf(path, gravity=model.gravity)
    assert again.link_parent == model.link_parent
    for field in fields(model):
        a, b = getattr(again, field.name), getattr(model, field.name)
        if field.name in ("rotation", "link_rotation"):
            np.testing.assert_allclose(a, b, rtol=0, atol=4e-16)
        elif isinstance(b, np.ndarray):
            np.testing.assert_array_equal(a, b, err_msg=field.name)
        elif field.name not in ("notes", "source"):
            assert a == b, field.name


def test_file_of_the_irb140_from_its_table_and_back_is_equal(tmp_path):
    arm = rne.dh_chain(**TABLE, masses=MASSES, centres=CENTRES - ENDS, inertias=INERTIAS, **LIMITS)
    (tmp_path / "arm.urdf").write_text(rne.to_urdf(arm), encoding="utf-8")
    assert rne.read_urdf(tmp_path / "arm.urdf") == arm


def test_base_tool_and_offsets_place_the_table(dh):
    """Poses are base T_1 ... T_n tool at q + offset; torques those of the table under gravity seen from frame 0."""
    table, convention, plain = dh
    base, tool = shift(0.1, -0.2, 0.3) @ rx(0.4) @ rz(-1.1), shift(0, 0.1, 0.2) @ rx(-0.7)
    offset, (q, qd, qdd) = np.linspace(-0.5, 0.6, plain.n), states(plain.n, 5, seed=3)
    gravity = base[:3, :3] @ table["gravity"]
    model = rne.dh_chain(convention=convention, **table | {"gravity": gravity}, base=base, tool=tool, offset=offset)
    ends = rne.dynamics.link_poses(plain, q + offset)[:, -1]
    np.testing.assert_allclose(rne.dynamics.link_poses(model, q)[:, -1], base @ ends @ tool, atol=1e-13)
    expected = rne.dynamics.inverse_dynamics(plain, q + offset, qd, qdd)
    assert relative(rne.dynamics.inverse_dynamics(model, q, qd, qdd), expected) <= ORACLE
    assert model.link_names == plain.link_names


def test_base_and_tool_of_frames():
    base, tool = shift(0, 0, 1) @ rz(0.3), shift(0, 0, 0.2)
    frames = {"rotations": [np.eye(3)], "positions": [[0.5, 0, 0]]}
    model = rne.model.chain(**frames, base=base, tool=tool)
    end = base @ rz(0.7) @ shift(0.5, 0, 0) @ tool
    np.testing.assert_allclose(rne.dynamics.link_poses(model, [0.7])[-1], end, atol=1e-15)


def test_inertias_of_three_and_six_numbers_are_those_of_the_matrices():
    """Six in the order of Corke's `Link.I`: xx, yy, zz, xy, yz, xz."""
    six = np.array([[2.0, 3.0, 4.0, 0.1, 0.2, 0.3], [1.0, 1.5, 2.0, 0.0, -0.1, 0.1]])
    full = [[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]] for xx, yy, zz, xy, yz, xz in six]
    np.testing.assert_array_equal(bad(inertias=six).inertia, bad(inertias=full).inertia)
    diagonal = [np.diag(row) for row in six[:, :3]]
    np.testing.assert_array_equal(bad(inertias=six[:, :3]).inertia, bad(inertias=diagonal).inertia)


def test_both_conventions_describe_one_robot():
    """Modified row i holds a and alpha of standard row i-1; the last standard twist is left to the tool."""
    rng = np.random.default_rng(5)
    a, alpha, d, theta = rng.uniform(-1, 1, (4, 4))
    standard = rne.dh_chain(a=a, alpha=alpha, d=d, theta=theta)
    modified = rne.dh_chain(a=np.r_[0, a[:-1]], alpha=np.r_[0, alpha[:-1]], d=d, theta=theta, convention="modified")
    q = states(4)[0]
    tool = shift(a[-1], 0, 0) @ rx(alpha[-1])
    np.testing.assert_allclose(
        rne.dynamics.link_poses(standard, q)[-1], rne.dynamics.link_poses(modified, q)[-1] @ tool, atol=1e-14
    )


def test_a_sliding_joint_moves_along_the_z_axis_before_it():
    """Cartesian arm of one slider, lying along x: gravity does no work, and the mass is all there is."""
    slider = rne.dh_chain(
        a=[0.2], alpha=[0.3], d=[0.1], theta=[0.5], types="prismatic", gravity=[0, 0, -9.81],
        masses=[3.0], centres=[[0.1, 0.2, 0.3]], inertias=np.zeros((1, 3, 3)),
    )  # fmt: skip
    assert rne.dynamics.mass_matrix(slider, [0.7]).item() == 3.0
    assert rne.dynamics.gravity_torque(slider, [0.7]).item() == pytest.approx(3 * 9.81, rel=1e-15)
    rise = (rne.dynamics.link_poses(slider, [0.7]) - rne.dynamics.link_poses(slider, [0.0]))[-1, :3, 3]
    np.testing.assert_allclose(rise, [0, 0, 0.7], atol=1e-16)


def test_an_unknown_argument_is_named():
    with pytest.raises(TypeError, match=r"^chain\(\) got an unexpected keyword argument 'lowr'$"):
        rne.model.chain([np.eye(3)], [[0, 0, 1]], lowr=[0])


def test_no_joints_and_no_masses_are_legal():
    block = rne.model.chain(np.zeros((0, 3, 3)), np.zeros((0, 3)))
    assert block.n == 0
    assert block.link_names == ("base_link", "tool0")
    bare = rne.dh_chain(**TABLE)
    assert bare.mass.tolist() == [0] * 6
    np.testing.assert_array_equal(
        rne.dynamics.link_poses(bare, np.ones(6)), rne.dynamics.link_poses(rne.irb140(), np.ones(6))
    )


def test_one_limit_may_stand_for_all_joints():
    arm = rne.model.chain([np.eye(3)] * 2, np.zeros((2, 3)), lower=-1, upper=[1, 2], effort=5)
    assert (arm.lower.tolist(), arm.upper.tolist(), arm.effort_limit.tolist()) == ([-1, -1], [1, 2], [5, 5])


def test_names_types_and_limits_are_taken_over():
    arm = rne.model.chain(
        [np.eye(3)] * 2, np.zeros((2, 3)), types=["continuous", "prismatic"], name="two", base="world", tip="tcp",
        joint_names=["turn", "lift"], link_names=["mast", "fork"], lower=[-np.inf, 0], upper=[np.inf, 2],
        velocity=[1, np.inf], effort=[10, 20],
    )  # fmt: skip
    assert (arm.name, arm.joint_names, arm.link_names) == ("two", ("turn", "lift"), ("world", "mast", "fork", "tcp"))
    assert arm.joint_types == ("continuous", "prismatic")
    assert (arm.lower.tolist(), arm.upper.tolist()) == ([-np.inf, 0], [np.inf, 2])
    assert (arm.velocity_limit.tolist(), arm.effort_limit.tolist()) == ([1, np.inf], [10, 20])


# What is refused


def bad(**changes):
    """A chain of two links with some arguments replaced."""
    body = {"masses": [1.0, 2.0], "centres": np.zeros((2, 3)), "inertias": [np.eye(3)] * 2}
    return rne.model.chain(**{"rotations": [np.eye(3)] * 2, "positions": np.zeros((2, 3))} | body | changes)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"rotations": np.eye(3)}, "`rotations` must have shape (n, 3, 3), got (3, 3)"),
        (
            {"rotations": [np.eye(3), -np.eye(3)]},
            "`rotations[1]` of joint 'joint_2' must be a rotation: orthogonal with determinant +1",
        ),
        (
            {"rotations": [1.01 * np.eye(3), np.eye(3)]},
            "`rotations[0]` of joint 'joint_1' must be a rotation: orthogonal with determinant +1",
        ),
        ({"positions": np.zeros((3, 3))}, "`positions` must have shape (2, 3), got (3, 3)"),
        ({"positions": [[0, 0, np.nan]] * 2}, "`positions` must be finite, got nan at index (0, 2)"),
        ({"masses": [1, -2]}, "`masses[1]` of link 'link_2' must be 0 or positive, got -2.0"),
        ({"masses": [1, np.inf]}, "`masses` must be finite, got inf at index (1,)"),
        ({"masses": ["1", "2"]}, "`masses` must be an array of numbers of shape (2,), got dtype <U1"),
        ({"masses": [1j, 2]}, "`masses` must be real, got dtype complex128"),
        ({"masses": None}, "`masses` must be given too: masses, centres and inertias belong together"),
        ({"inertias": None}, "`inertias` must be given too: masses, centres and inertias belong together"),
        ({"centres": np.zeros(3)}, "`centres` must have shape (2, 3), got (3,)"),
        (
            {"inertias": np.ones((2, 5))},
            "`inertias` must have shape (2, 3, 3), or (2, 3) with xx, yy, zz, or (2, 6) with xx, yy, zz, xy, yz, xz, "
            "got (2, 5)",
        ),
        ({"base": np.eye(3)}, "`base` must have shape (4, 4), got (3, 3)"),
        ({"tool": -np.eye(4)}, "`tool` must be a pose: a rotation and an origin [m] above a row of 0, 0, 0, 1"),
        (
            {"inertias": [np.eye(3), np.diag([1, 1, -1])]},
            "`inertias[1]` of link 'link_2': the inertia must have no negative eigenvalue, got -1 kg m^2",
        ),
        (
            {"inertias": [np.triu(np.ones((3, 3))), np.eye(3)]},
            "`inertias[0]` of link 'link_1': the inertia must be symmetric",
        ),
        (
            {"axes": [[0, 0, 1], [0, 0, 0]]},
            "`axes[1]` of joint 'joint_2' is zero; give the direction of the joint's axis",
        ),
        ({"axes": [[0, 0, 1]]}, "`axes` must have shape (2, 3), got (1, 3)"),
        (
            {"types": ["revolute", "planar"]},
            "`types[1]` of joint 'joint_2' must be one of ['revolute', 'continuous', 'prismatic'], got 'planar'",
        ),
        ({"types": ["revolute"]}, "`types` must be one type or 2 of them, got 1"),
        ({"lower": [0, np.nan]}, "`lower[1]` of joint 'joint_2' must be a number, got nan"),
        ({"upper": [1.0]}, "`upper` must have shape (2,), got (1,)"),
        ({"upper": [1j, 0]}, "`upper` must be real, got dtype complex128"),
        (
            {"types": "continuous", "upper": [np.inf, 1]},
            "`upper[1]` of joint 'joint_2' must be inf, as a continuous joint has no range, got 1.0",
        ),
        ({"velocity": [1, -1]}, "`velocity[1]` of joint 'joint_2' must not be negative, got -1.0"),
        ({"gravity": [0, 9.81]}, "`gravity` must have shape (3,), got (2,)"),
        ({"joint_names": ["a"]}, "`joint_names` must be 2 names, got ['a']"),
        ({"joint_names": "ab"}, "`joint_names` must be 2 names, got 'ab'"),
        ({"joint_names": ["a", "a"]}, "`joint_names` must differ, got the joint 'a' twice"),
        ({"joint_names": ["a", "flange"]}, "`joint_names` must differ, got the joint 'flange' twice"),
        ({"link_names": ["a", "base_link"]}, "`link_names` must differ, got the link 'base_link' twice"),
        ({"link_names": ["a", ""]}, "`link_names[1]` must be a name, got ''"),
        ({"tip": ""}, "`tip` must be a name, got ''"),
        ({"name": None}, "`name` must be a name, got None"),
    ],
)
def test_what_load_would_refuse_is_refused(changes, text):
    with pytest.raises(ValueError, match="^" + re.escape(text) + "$"):
        bad(**changes)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"convention": "craig"}, "`convention` must be 'standard' or 'modified', got 'craig'"),
        ({"a": 0.1}, "`a` must have shape (n,), got ()"),
        ({"alpha": [0.0]}, "`alpha` must have shape (6,), got (1,)"),
        ({"offset": [0.0]}, "`offset` must have shape (6,), got (1,)"),
        ({"offset": 90}, "`offset` looks like degrees; pass np.deg2rad(offset), got 90 at index (0,)"),
        ({"theta": [np.inf] * 6}, "`theta` must be finite, got inf at index (0,)"),
        (
            {"alpha": [90, 0, 0, 0, 0, 0]},
            "`alpha` looks like degrees; pass np.deg2rad(alpha), got 90 at index (0,)",
        ),
        (
            {"theta": [0, 0, 0, -180, 0, 0]},
            "`theta` looks like degrees; pass np.deg2rad(theta), got -180 at index (3,)",
        ),
        ({"masses": np.ones(6)}, "`centres` must be given too: masses, centres and inertias belong together"),
        ({"link_names": ["tool0"] * 6}, "`link_names` must differ, got the link 'tool0' twice"),
    ],
)
def test_a_wrong_table_is_refused(changes, text):
    with pytest.raises(ValueError, match="^" + re.escape(text) + "$"):
        rne.dh_chain(**TABLE | changes)


def test_a_range_in_degrees_is_warned_of():
    text = "the range of joint 'joint_2', -170 to 170, looks like degrees; pass np.deg2rad of it"
    with pytest.warns(UserWarning, match=f"^{re.escape(text)}$") as caught:
        assert bad(lower=[-1, -170], upper=[1, 170]).upper.tolist() == [1, 170]
    assert caught[0].filename == __file__  # the line of the call
    arm = bad(types=["continuous", "prismatic"], upper=[np.inf, 170])  # metres
    assert arm.upper[1] == 170


def test_an_inertia_turned_by_a_rotation_is_taken_as_symmetric():
    Q, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    turned = Q @ np.diag([1.0, 2, 2.5]) @ Q.T
    turned[0, 1] = np.nextafter(turned[1, 0], np.inf)  # as most processors round it
    arm = bad(inertias=[turned, np.eye(3)])
    np.testing.assert_array_equal(arm.inertia[0], arm.inertia[0].T)


# Cylinders


def test_cylinder_is_the_integral_over_its_points():
    """Moments of points spread evenly over a solid cylinder, by the midpoint rule in radius and height."""
    m, r, h, N = 3.0, 0.4, 0.7, 400
    radii = (np.arange(N) + 0.5) / N * r
    weights = radii / radii.sum()
    heights = ((np.arange(N) + 0.5) / N - 0.5) * h
    square, height = (weights * radii**2).sum(), (heights**2).mean()
    along, across = m * square, m * (square / 2 + height)
    for k, axis in enumerate("xyz"):
        expected = np.full(3, across)
        expected[k] = along
        np.testing.assert_allclose(rne.model.cylinder_inertia(m, r, h, axis), np.diag(expected), rtol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((1, 1, 1, 2), "`axis` must be 'x', 'y' or 'z', got 2"),
        ((-1, 1, 1, "x"), "`mass` must not be negative, got -1.0"),
        ((1, np.nan, 1, "x"), "`radius` must be finite, got nan at index ()"),
        ((1, 1, [1], "x"), "`length` must be one number, got shape (1,)"),
    ],
)
def test_wrong_cylinders_are_refused(arguments, text):
    with pytest.raises(ValueError, match="^" + re.escape(text) + "$"):
        rne.model.cylinder_inertia(*arguments)
