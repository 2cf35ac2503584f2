"""Base parameters by rules, against the rank of regressors at random states and known counts."""

import inspect
import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

import rne
from rne.basics.spatial import rotation_about
from rne.dynamics.base_inertial_parameters import independent_columns
from rne.model.parameters import with_fewest_terms
from rne.model.standard_parameters import StandardParameters
from rne.model.topology import where_loops_close

from .conftest import TREES
from .helpers import Part, assemble, kept, loaded
from .random_robots import random_tree
from .test_oracle import LOADABLE, ONE_OF_EACH_KIND

TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)  # of the largest pivot; the rank is to be the same for all
SAME = 1e-11  # of the terms that add up to a column: geometry of some fifty bodies, behind axes 4e-6 rad apart
ZERO = 1e-11  # of the largest torque: columns of zeros but for rounding; kinova's first axis is 1e-12 off the vertical
# pi / 2 written as 1.5708 and the like: axes parallel but for 4e-6 rad, which a rank at 1e-8 sees and at 1e-3 does not
ROUNDED_FILES = (
    "tiago_description/tiago_dual",  # is not rounded, but takes minutes, and has twice the arm and hand of tiago
    "hextilt_description/hextilt_flying_arm_5",
    "tiago_pro_description/tiago_pro",
    "xarm_description/xarm7",
)
OPTIONS = {
    "bodies": {},
    "rotors": {"rotor": True},
    "friction": {"friction": "viscous+coulomb"},
    "offsets": {"offset": True},
    "all": {"rotor": True, "friction": "viscous+coulomb", "offset": True},
}


def in_any_gravity(model):
    return {"": model, "without gravity ": replace(model, gravity=np.zeros(3))}


def stacked_regressors(model, seed=0, **options):
    """Y of all standard parameters at random states: of gravity alone, at speed, and with accelerations."""
    standard = StandardParameters(model, rne.DriveModel(**options))
    rng = np.random.default_rng(seed)
    samples = 40 + 4 * standard.count // max(model.n, 1)
    q, qd, qdd = rng.uniform(-1, 1, (3, samples, model.n)) * np.array([np.pi, 3, 10])[:, None, None]
    q = where_loops_close(model, q)
    at_rest, steady = np.arange(samples) % 3 == 1, np.arange(samples) % 3 == 2
    qd[at_rest], qdd[at_rest | steady] = 0, 0
    Y = np.concatenate([rne.dynamics.regressor(model, q, qd, qdd), standard.drive_columns(qd, qdd)], axis=-1)
    return Y, (q, qd, qdd)


def numeric_ranks(Y):
    """Rank by QR with column pivoting, columns scaled to unit length, for each tolerance."""
    Y = Y.reshape(Y.shape[0] * Y.shape[1], Y.shape[2])
    sizes = np.linalg.norm(Y, axis=0)
    Y = Y[:, sizes > 1e-12 * sizes.max(initial=0)]
    if not Y.size:
        return [0] * len(TOLERANCES)
    pivots = np.abs(np.diag(scipy.linalg.qr(Y / np.linalg.norm(Y, axis=0), mode="r", pivoting=True)[0]))
    return [int((pivots > tolerance * pivots[0]).sum()) for tolerance in TOLERANCES]


def check(model, **options):
    """The count is the numeric rank, the matrices are what they are said to be."""
    base = rne.dynamics.base_parameters(model, drives=rne.DriveModel(**options))
    Y, states = stacked_regressors(model, **options)
    ranks = numeric_ranks(Y)
    assert [base.count] * len(ranks) == ranks
    check_matrices(base, Y, states)


def check_matrices(base, Y, states):
    E, B = base.back, base.matrix
    assert not B.flags.writeable
    np.testing.assert_array_equal(B @ E, np.eye(base.count))
    np.testing.assert_array_equal(base.regressor(*states), Y @ E)
    sizes = np.abs(Y).max(axis=(0, 1), initial=0)
    differences = np.abs(Y - Y @ E @ B).max(axis=(0, 1), initial=0)
    terms = sizes + np.abs(B).T @ sizes[list(base.independent)]
    assert (differences <= SAME * terms + ZERO * sizes.max(initial=0)).all()


@pytest.mark.parametrize("options", kept(OPTIONS, ["bodies", "all"]))
@pytest.mark.parametrize("name", kept([name for name in LOADABLE if name not in ROUNDED_FILES], ONE_OF_EACH_KIND))
def test_robots_of_files(name, options):
    for model in in_any_gravity(loaded(name).model).values():
        check(model, **OPTIONS[options])


@pytest.mark.parametrize("options", kept(OPTIONS, ["bodies", "all"]))
@pytest.mark.parametrize("name", kept(ROUNDED_FILES, ["xarm_description/xarm7"]))
def test_robots_of_rounded_files(name, options):
    """A finer rank sees the roundings, a coarse one does not: nor do the rules with a coarse tolerance."""
    for model in in_any_gravity(loaded(name).model).values():
        exact, coarse = (
            rne.dynamics.base_parameters(model, tolerance=x, drives=rne.DriveModel(**OPTIONS[options]))
            for x in (1e-9, 1e-5)
        )
        Y, states = stacked_regressors(model, **OPTIONS[options])
        ranks = numeric_ranks(Y)
        assert (coarse.count, exact.count) == (ranks[0], ranks[-1])
        check_matrices(exact, Y, states)


@pytest.mark.parametrize(("small", "kept"), [(0.0, [1]), (0.04, [1]), (0.06, [0]), (-0.06, [0])])
def test_a_parameter_is_kept_unless_others_take_twenty_times_its_coefficient(small, kept):
    row = np.array([[small, np.sqrt(1 - small**2)]])
    assert independent_columns(row) == kept


def arm_of_two_axes(angle):
    """Two horizontal axes, apart by an angle; parallel ones leave two parameters fewer to be seen."""
    turned = [np.eye(3), rotation_about(np.array([0.0, 1.0, 0.0]), np.array(angle))]
    return rne.model.chain(turned, [[0, 0, 0], [0, 0, 0.5]], axes=[[1.0, 0, 0]] * 2)


@pytest.mark.parametrize(
    ("tolerance", "options"), [(1e-9, {}), (1e-7, {"tolerance": 1e-7}), (1e-5, {"tolerance": 1e-5})]
)
def test_axes_within_the_tolerance_are_parallel_and_others_are_not(tolerance, options):
    """1e-9 rad where nothing is said: what a file's fifteen digits hold counts, their rounding does not."""
    parallel = rne.dynamics.base_parameters(arm_of_two_axes(0.0)).count
    counts = [
        rne.dynamics.base_parameters(arm_of_two_axes(factor * tolerance), **options).count for factor in (0.25, 4.0)
    ]
    assert counts == [parallel, parallel + 2]


@pytest.mark.parametrize("options", kept(OPTIONS, ["bodies", "all"]))
@pytest.mark.parametrize("name", kept(TREES, ["single", "sliders", "mixed", "mimics", "coupled"]))
def test_random_trees(name, options):
    for model in in_any_gravity(TREES[name]).values():
        check(model, **OPTIONS[options])


def tree_of_right_angles(rng, n, mimics):
    """Axes and offsets from small sets, so that parallel, meeting, coaxial and vertical axes are common."""
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    model = random_tree(
        n, int(rng.integers(1000)), prismatic=rng.choice([0, 0.3, 0.6, 1]), branching=rng.choice([0, 0.5])
    )
    rotation = np.array([np.eye(3)[rng.permutation(3)] * rng.choice([-1, 1], 3)[:, None] for _ in range(n)])
    rotation[rng.random(n) < 0.5] = np.eye(3)
    follower = np.isin(np.arange(n), rng.permutation(np.arange(1, n))[:mimics])
    independent = np.flatnonzero(~follower)
    followed = np.where(follower, rng.integers(len(independent), size=n), np.cumsum(~follower) - 1)
    return replace(
        model,
        rotation=rotation * np.linalg.det(rotation)[:, None, None],
        translation=rng.choice([0, 0, 0.3, -0.5], (n, 3)),
        axis=axes[rng.integers(6, size=n)] if rng.random() < 0.7 else np.tile(axes[0], (n, 1)),
        gravity=[(0, 0, -9.81), (0, 0, 0), (3, 0, -9), (0, 9.81, 0)][rng.integers(4)],
        coordinate=tuple(followed.tolist()),
        independent_joints=tuple(independent.tolist()),
        multiplier=np.where(follower, rng.choice([1, -1, 2, 0.5, -1.5], n), 1.0),
        offset=np.where(follower, rng.choice([0, 0.3], n), 0.0),
    )


@pytest.mark.parametrize("joints", kept([1, 2, 4, 5], [2, 5]))
@pytest.mark.parametrize("mimics", [0, 2])
@settings(max_examples=6, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), options=st.sampled_from(sorted(OPTIONS)), motors=st.integers(0, 2))
def test_special_geometries(joints, mimics, seed, options, motors):
    rng = np.random.default_rng(seed)
    model = tree_of_right_angles(rng, joints, min(mimics, joints - 1))
    check(model, **OPTIONS[options], coupled_motors=rng.choice([0.0, 1.0, -1.0, 2.0], (motors, model.n)))


def test_coordinates_shared_by_two_branches():
    """Six bodies that move together, by three coordinates, at random positions of them."""
    model = replace(
        tree_of_right_angles(np.random.default_rng(5), 6, 0),
        parent=(-1, 0, 1, -1, 3, 4),
        coordinate=(0, 1, 2, 0, 1, 2),
        independent_joints=(0, 1, 2),
        joint_types=("revolute", "revolute", "prismatic", "revolute", "revolute", "revolute"),
        gravity=(0, 0, -9.81),
    )
    check(model, offset=True)


@pytest.mark.parametrize("name", ["irb140", "panda", "mixed", "mimics"])
def test_formulas_and_matrices(name):
    """Each formula, read as it is printed, is the base parameter; B E = 1; values come back."""
    model = TREES[name] if name in TREES else rne.load(name).model
    base = rne.dynamics.base_parameters(model, drives=rne.DriveModel(rotor=True, friction="viscous", offset=True))
    rng = np.random.default_rng(0)
    pi = rng.normal(size=base.standard.count)
    numbers = dict(zip(base.standard.names, pi, strict=True))
    for formula, leading, value in zip(base.formulas, base.names, base.of(pi), strict=True):
        terms = re.findall(r"([+-]?) ?([0-9][0-9.e-]* )?([A-Za-z]\w*)", formula)
        assert terms[0] == ("", "", leading)
        sizes = [numbers[symbol] * float(factor or 1) * (-1 if sign == "-" else 1) for sign, factor, symbol in terms]
        assert abs(sum(sizes) - value) <= 1e-5 * np.abs(sizes).sum()  # six digits are printed
    beta = rng.normal(size=(3, base.count))
    np.testing.assert_allclose(base.of(base.standard_parameters(beta)), beta, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(base.standard_parameters(beta), beta @ base.back.T)
    np.testing.assert_array_equal(base.values, base.of(base.standard.values))


@pytest.mark.parametrize("name", ["irb140", "ur5", "mixed", "sliders", "bushy"])
def test_masses_redistributed_for_kernels_keep_them(name):
    """`with_fewest_terms` moves masses joint by joint: no base parameter may change."""
    robots = {"irb140": lambda: rne.irb140(), "ur5": lambda: loaded("ur_description/ur5_robot").model}
    model = TREES[name] if name in TREES else robots[name]()
    model = replace(
        model, link_translation=np.zeros_like(model.link_translation)
    )  # parameters about the frame's origin

    def parameters(moments):
        entries = moments.inertia[:, [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
        return np.concatenate([moments.mass[:, None], moments.first_moment, entries], axis=1).ravel()

    base = rne.dynamics.base_parameters(model)
    before, after = (base.of(parameters(x.moments)) for x in (model, with_fewest_terms(model)))
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-12 * np.abs(before).max())


def one_joint(kind, axis, gravity=(0.0, 0.0, -9.81), **options):
    tip = Part(link="tip", joint="j", kind=kind, parent=0, axis=np.array(axis, float), mass=1.0, inertia=np.eye(3))
    model = replace(assemble("one", [Part(link="base"), tip]), gravity=np.array(gravity))
    return rne.dynamics.base_parameters(model, drives=rne.DriveModel(**options)).formulas


@pytest.mark.parametrize(
    ("formulas", "expected"),
    [
        (one_joint("revolute", (0, 0, 1)), ("Izz_1",)),
        (one_joint("revolute", (1, 0, 0)), ("mcy_1", "mcz_1", "Ixx_1")),
        (one_joint("revolute", (1, 0, 0), (0, 0, 0)), ("Ixx_1",)),
        (one_joint("revolute", (1, 0, 0), rotor=True), ("mcy_1", "mcz_1", "Ixx_1 + Ia_1")),
        (one_joint("revolute", (1, 0, 0), offset=True), ("mcy_1", "mcz_1", "Ixx_1", "tau0_1")),
        (one_joint("prismatic", (0, 0, 1)), ("m_1",)),
        (one_joint("prismatic", (0, 0, 1), rotor=True), ("m_1", "Ia_1")),
        (one_joint("prismatic", (1, 0, 0), rotor=True), ("m_1 + Ia_1",)),
        (one_joint("prismatic", (0, 0, 1), offset=True), ("m_1", "tau0_1")),
        (
            one_joint("prismatic", (0, 0, 1), rotor=True, offset=True),
            ("m_1 + 0.101937 tau0_1", "Ia_1 - 0.101937 tau0_1"),
        ),
    ],
)
def test_one_joint(formulas, expected):
    """A pendulum, a vertical and a level slider: a rotor and a weight can be told apart only if both are unknown."""
    assert formulas == expected


def test_known_counts(irb140, ur5):
    """Arms of six rotating joints, the first vertical: 36, and 40 with rotors; of seven 43; Gautier and Khalil 1990."""
    for robot in (irb140, ur5, loaded("ur_description/ur3_robot"), loaded("ur_description/ur10_robot")):
        assert (robot.base_parameters().count, robot.base_parameters(drives=rne.DriveModel(rotor=True)).count) == (
            36,
            40,
        )
    panda = loaded("panda_description/panda").locked({"panda_finger_joint1": 0.0})
    right = np.pi / 2
    lwr = rne.dh_chain(
        a=[0] * 7,
        alpha=[right, -right, -right, right, right, -right, 0],
        d=[0.31, 0, 0.4, 0, 0.39, 0, 0.078],
        theta=[0] * 7,
        masses=[1.0] * 7,
        centres=np.zeros((7, 3)),
        inertias=[0.1 * np.eye(3)] * 7,
    )
    assert [panda.base_parameters().count, rne.dynamics.base_parameters(lwr).count] == [43, 43]


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (
            lambda robot: rne.dynamics.base_parameters(robot),
            TypeError,
            "`model` must be an rne.Model, got Robot; a Robot has it as .model",
        ),
        (
            lambda robot: robot.base_parameters(drives=rne.DriveModel(friction="dry")),
            ValueError,
            "`friction` must be of the words 'viscous', 'asymmetric', 'coulomb', 'load', joined by '+', got 'dry'",
        ),
        (
            lambda robot: robot.base_parameters(tolerance=0),
            ValueError,
            "`tolerance` must be positive, got 0.0",
        ),
        (
            lambda robot: robot.base_parameters(tolerance=2.0),
            ValueError,
            "`tolerance` must be below 0.01, got 2.0",
        ),
        (
            lambda robot: robot.base_parameters().of(np.zeros(36)),
            ValueError,
            "`parameters` must have shape (..., 60), got (36,)",
        ),
        (
            lambda robot: robot.base_parameters().standard_parameters(np.zeros((2, 60))),
            ValueError,
            "`beta` must have shape (..., 36), got (2, 60)",
        ),
    ],
)
def test_wrong_arguments(irb140, call, error, text):
    with pytest.raises(error, match=f"^{re.escape(text)}$"):
        call(irb140)


def test_a_shaft_that_two_branches_share_is_a_parameter():
    """Its inertia alone joins their coordinates in M."""
    body = {"kind": "revolute", "parent": 0, "mass": 1.0, "com": np.array([0.3, 0.1, 0.2]), "inertia": np.eye(3)}
    parts = [Part(link=link, joint=f"to {link}", axis=np.array([0, 0, 1.0]), **body) for link in ("left", "right")]
    model = assemble("branches", [Part(link="base"), *parts])
    check(model, rotor=True, coupled_motors=[[1.0, 1.0]])
    assert (
        "Ia"
        in rne.dynamics.base_parameters(model, drives=rne.DriveModel(rotor=True, coupled_motors=[[1.0, 1.0]])).formulas[
            -1
        ]
    )


def test_methods_have_the_defaults_of_the_functions():
    for name in ("base_parameters", "regressor", "diagnose"):
        method, function = (inspect.signature(getattr(x, name)) for x in (rne.Robot, rne.dynamics))
        assert [p.default for p in method.parameters.values()][1:] == [p.default for p in function.parameters.values()][
            1:
        ]


def test_a_robot_keeps_its_base_parameters():
    """By value of the options, with the robot's own regressor; another robot, and other options, have their own."""
    robot, shaft = loaded("irb140"), [[0, 0, 0, 0, 1, 1]]
    base = robot.base_parameters(drives=rne.DriveModel(rotor=True, coupled_motors=shaft))
    assert base is robot.base_parameters(drives=rne.DriveModel(rotor=True, coupled_motors=np.array(shaft)))
    assert base.body_regressor == robot.regressor
    assert base is not robot.base_parameters(drives=rne.DriveModel(rotor=True))
    assert base.standard.model is robot.model is not robot.with_payload(1.0).base_parameters().standard.model
    with pytest.raises(ValueError, match="read-only"):
        base.matrix[0, 0] = 2.0
