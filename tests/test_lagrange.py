"""Euler-Lagrange against the recursions it has nothing in common with but the kinematics."""

import re
from dataclasses import replace

import mpmath
import numpy as np
import pytest

import rne
from examples.thesis.formulations import irb140_mirrored

from .conftest import TREES
from .helpers import EPS, Part, assemble, complex_steps, kept, relative, states
from .random_robots import random_tree

LAW = 1e-12  # of the largest entry: thousands of roundings, which sums over n^4 products may need
ARMS = {"irb140": rne.irb140(), **TREES, "more mimics": random_tree(3, seed=11, mimics=4)}
# A wrist whose last joint follows the one before, all numbers exact.
COUPLED = replace(
    rne.irb140(),
    coordinate=(0, 1, 2, 3, 4, 4),
    independent_joints=(0, 1, 2, 3, 4),
    multiplier=np.array([1, 1, 1, 1, 1, -0.5]),
    offset=np.array([0, 0, 0, 0, 0, 0.25]),
)
MIRROR = np.array([1, 1, -1, 1, 1, 1])


@pytest.fixture(params=ARMS)
def arm(request):
    return ARMS[request.param]


def size(model, q):
    """What Christoffel symbols are made of, also where they cancel, as on a single joint."""
    return np.abs(rne.dynamics.mass_matrix(model, q)).max()


def joints_only(model):
    """The same robot with every mimic a joint of its own."""
    every = tuple(range(model.nb))
    return replace(
        model,
        coordinate=every,
        independent_joints=every,
        multiplier=np.ones(model.nb),
        offset=np.zeros(model.nb),
        couplings=(),
    )


def test_torques_are_those_of_the_recursion(arm):
    s = states(arm.n, 20)
    assert relative(rne.dynamics.lagrange_inverse_dynamics(arm, *s), rne.dynamics.inverse_dynamics(arm, *s)) <= LAW


@pytest.mark.parametrize("seed", range(20, 26))
def test_torques_are_those_of_the_recursion_on_more_trees(seed):
    tree = random_tree(6, seed, prismatic=0.4, branching=0.4, mimics=seed % 3)
    s = states(tree.n, 10, seed=seed)
    assert relative(rne.dynamics.lagrange_inverse_dynamics(tree, *s), rne.dynamics.inverse_dynamics(tree, *s)) <= LAW


def test_armature_is_part_of_M(arm):
    geared = replace(arm, armature=np.linspace(0.1, 1.0, arm.nb))
    s = states(arm.n, 5)
    torque = rne.dynamics.lagrange_inverse_dynamics(geared, *s)
    assert relative(torque, rne.dynamics.inverse_dynamics(geared, *s)) <= LAW
    assert relative(torque, rne.dynamics.lagrange_inverse_dynamics(arm, *s)) > 1e-6


def test_M_from_jacobians_is_M_from_composite_bodies(arm):
    """Its columns are the torques of unit accelerations at rest, without gravity."""
    arm = replace(joints_only(arm), gravity=np.zeros(3))
    q = states(arm.n, 10)[0]
    columns = [rne.dynamics.lagrange_inverse_dynamics(arm, q, 0 * q, 0 * q + e) for e in np.eye(arm.n)]
    assert relative(np.stack(columns, axis=-1), rne.dynamics.mass_matrix(arm, q)) <= LAW


def test_gravity_is_that_of_the_recursion(arm):
    arm = joints_only(arm)
    q = states(arm.n, 10)[0]
    held = rne.dynamics.lagrange_inverse_dynamics(arm, q, 0 * q, 0 * q)
    assert relative(held, rne.dynamics.gravity_torque(arm, q)) <= LAW


def test_christoffel_symbols_are_made_of_the_derivatives_of_M(arm):
    q = states(arm.n, 10)[0]
    dM = complex_steps(rne.dynamics.mass_matrix, arm, [q], ["q"])  # [s, i, j, k] = dM_ij / dq_k
    expected = (np.einsum("skji->sijk", dM) + np.einsum("skij->sijk", dM) - dM) / 2
    assert np.abs(rne.dynamics.christoffel_symbols(arm, q) - expected).max() <= LAW * size(arm, q)


def test_christoffel_symbols_are_symmetric_in_the_first_two(arm):
    q = states(arm.n, 10)[0]
    c = rne.dynamics.christoffel_symbols(arm, q)
    bound = LAW * size(arm, q) if arm.has_mimics else 0  # the products with G are rounded in some order
    assert np.abs(c - np.swapaxes(c, -3, -2)).max() <= bound


def test_christoffel_symbols_give_the_coriolis_torque_and_matrix(arm):
    q, qd, _ = states(arm.n, 10)
    C = np.einsum("sijk,si->skj", rne.dynamics.christoffel_symbols(arm, q), qd)
    rate = np.abs(qd).max()
    assert np.abs(C - rne.dynamics.coriolis_matrix(arm, q, qd)).max() <= LAW * size(arm, q) * rate
    torque = (C @ qd[..., None])[..., 0]
    assert np.abs(torque - rne.dynamics.coriolis_torque(arm, q, qd)).max() <= LAW * size(arm, q) * rate**2


@pytest.mark.parametrize("tree", kept(ARMS, ["single", "sliders", "more mimics"]))
@pytest.mark.parametrize(("name", "count"), [("lagrange_inverse_dynamics", 3), ("christoffel_symbols", 1)])
def test_kernel_is_the_function(tree, name, count):
    function, arm = getattr(rne.dynamics, name), ARMS[tree]
    arguments = states(arm.n, 300)[:count]
    kernel = rne.compile(function, arm)
    expected = function(arm, *arguments)
    bound = LAW * max(np.abs(expected).max(), size(arm, arguments[0]))
    batch = kernel(*arguments)
    assert batch.shape == expected.shape
    assert np.abs(batch - expected).max() <= bound
    single = np.array([kernel(*state) for state in zip(*(a[:5] for a in arguments), strict=True)])
    assert np.abs(single - expected[:5]).max() <= bound


def test_the_recursion_saves_operations_on_the_irb140():
    """The thesis's reason for Newton-Euler: at least five times fewer, both with every zero gone."""
    lagrange, newton_euler = (
        sum(rne.compile(f, rne.irb140()).operations.values())
        for f in (rne.dynamics.lagrange_inverse_dynamics, rne.dynamics.inverse_dynamics)
    )
    assert 5 * newton_euler < lagrange <= 1800


def test_a_batch_is_its_states():
    s = states(6, 12)
    got = rne.dynamics.lagrange_inverse_dynamics(rne.irb140(), s[0].reshape(3, 4, 6), s[1].reshape(3, 4, 6), s[2][:4])
    assert got.shape == (3, 4, 6)
    one = rne.dynamics.lagrange_inverse_dynamics(rne.irb140(), s[0][7], s[1][7], s[2][3])
    assert one.shape == (6,)
    assert relative(got[1, 3], one) <= 100 * EPS


@pytest.mark.parametrize("dtype", [np.float32, np.longdouble])
def test_result_is_in_the_dtype_of_the_arguments(dtype):
    s = [x.astype(dtype) for x in states(6, 5)]
    got = rne.dynamics.lagrange_inverse_dynamics(rne.irb140(), *s)
    assert got.dtype == rne.dynamics.christoffel_symbols(rne.irb140(), s[0]).dtype == dtype
    exact = rne.dynamics.inverse_dynamics(
        rne.irb140().astype(dtype).astype(np.float64), *(x.astype(np.longdouble) for x in s)
    )
    assert relative(got.astype(np.longdouble), exact) <= 100 * float(np.finfo(dtype).eps)


def test_complex_arguments_give_exact_derivatives():
    q, qd, qdd = states(6)
    step = q + 1e-30j * qd
    ours, theirs = (
        f(rne.irb140(), step, qd, qdd).imag
        for f in (rne.dynamics.lagrange_inverse_dynamics, rne.dynamics.inverse_dynamics)
    )
    assert relative(ours, theirs) <= LAW


@pytest.mark.parametrize("model", [rne.irb140(), irb140_mirrored(), COUPLED], ids=["irb140", "mirrored", "coupled"])
def test_two_formulations_agree_to_45_of_50_digits(model):
    """Two formulations, one torque, to 45 of 50 digits: they agree in exact arithmetic, not by tolerance.

    Only where the rotations hold exact zeros and ones: a random tree's, rounded to doubles, turn no body rigidly, and
    what then is right to 50 digits depends on the formulation.
    """
    with mpmath.workdps(50):
        s = [np.array([mpmath.mpf(float(x)) for x in v], dtype=object) for v in states(model.n)]
        ours, theirs = rne.dynamics.lagrange_inverse_dynamics(model, *s), rne.dynamics.inverse_dynamics(model, *s)
        assert max(abs(a - b) for a, b in zip(ours, theirs, strict=True)) < max(abs(theirs)) * mpmath.mpf(10) ** -45


def test_a_robot_without_joints_has_empty_answers():
    block = assemble("block", [Part(link="base", mass=1.0)])
    for shape in ((0,), (4, 0)):
        empty = np.zeros(shape)
        assert rne.dynamics.lagrange_inverse_dynamics(block, empty, empty, empty).shape == shape
        assert rne.dynamics.christoffel_symbols(block, empty).shape == (*shape[:-1], 0, 0, 0)


def test_wrong_shapes_are_named():
    text = "`q` must have shape (..., 6) for robot 'irb140', got (5,)"
    with pytest.raises(ValueError, match="^" + re.escape(text) + "$"):
        rne.dynamics.christoffel_symbols(rne.irb140(), np.zeros(5))
    text = (
        "`qdd` must have shape (..., 6) for robot 'irb140', got (6, 100); states go along the first axis: "
        "pass `qdd`.T, of shape (100, 6)"
    )
    with pytest.raises(ValueError, match="^" + re.escape(text) + "$"):
        rne.dynamics.lagrange_inverse_dynamics(rne.irb140(), np.zeros((100, 6)), np.zeros(6), np.zeros((6, 100)))


def test_overflow_is_an_error():
    text = "lagrange_inverse_dynamics overflows float64 for these arguments; the result is not finite"
    with pytest.raises(rne.NotFiniteError, match=f"^{text}$"):
        rne.dynamics.lagrange_inverse_dynamics(rne.irb140(), np.ones(6), np.full(6, 1e200), np.zeros(6))


@pytest.mark.parametrize("function", [rne.dynamics.lagrange_inverse_dynamics, rne.dynamics.inverse_dynamics])
def test_the_arm_of_chapter_7_with_q3_mirrored(function):
    """The same arm under q3 -> -q3: the third torque changes its sign, the others stay."""
    s = states(6, 20)
    mirrored = function(irb140_mirrored(), *(MIRROR * x for x in s))
    assert relative(mirrored, MIRROR * rne.dynamics.inverse_dynamics(rne.irb140(), *s)) <= LAW


def test_the_mirrored_arm_stands_where_the_arm_does():
    q = states(6, 20)[0]
    poses = rne.dynamics.link_poses(irb140_mirrored(), MIRROR * q)
    np.testing.assert_allclose(poses, rne.dynamics.link_poses(rne.irb140(), q), rtol=0, atol=8 * EPS)


def test_hanging_needs_no_torque_in_either_arm():
    """Section 7.1's first run starts at q3 = -pi/2 in one convention and at +pi/2 in the other."""
    hanging = np.array([0, np.pi, -np.pi / 2, 0, 0, 0])
    assert (
        np.abs(rne.dynamics.gravity_torque(rne.irb140(), hanging)).max() < 1e-13
    )  # pi is rounded: 235 N m times eps / 2
    assert np.abs(rne.dynamics.gravity_torque(irb140_mirrored(), MIRROR * hanging)).max() < 1e-13


def test_limits_of_the_mirrored_arm_are_mirrored():
    arm, mirrored = rne.irb140(), irb140_mirrored()
    assert (mirrored.lower[2], mirrored.upper[2]) == (-arm.upper[2], -arm.lower[2])
    assert np.array_equal(mirrored.lower[[0, 1, 3, 4, 5]], arm.lower[[0, 1, 3, 4, 5]])


def test_forward_dynamics_are_those_of_newton_euler(arm):
    q, qd, tau = states(arm.n, 10)
    expected = rne.dynamics.forward_dynamics(arm, q, qd, tau)
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(arm, q)).max()
    traced = rne.Robot(arm).kernel(rne.dynamics.lagrange_forward_dynamics)
    for found in (rne.dynamics.lagrange_forward_dynamics(arm, q, qd, tau), traced(q, qd, tau)):
        assert relative(found, expected) <= 20 * kappa * EPS
