"""Bounds that hold: closed forms, samples never outside, second derivatives, parameters' corners, errors."""

import itertools
import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import rne
from benchmarks.bounds import ACCELERATION as ACCELERATIONS
from benchmarks.bounds import RATE as RATES
from benchmarks.bounds import outside, sampled, searched
from rne.bounds import branch_and_bound
from rne.bounds.articulated import ArticulatedSearch, applies, control_points, functions
from rne.bounds.bounds import (
    Bound,
    Bounds,
    RobotPolynomials,
    about_first_angle,
    entry,
    gravity_torques_of_full_turns,
    torque_criteria,
)
from rne.bounds.branch_and_bound import (
    CellSearch,
    Clock,
    largest,
    local_maximum,
    ratio_on_grid,
    short_basis,
    values_on_grid,
)
from rne.bounds.criteria import Coriolis, LargestOfInverse, Modulus, Norm, positive_definite
from rne.bounds.polynomials import Polynomial

from .helpers import Part, assemble, first_joints, kept, pose
from .random_robots import random_tree, straight_chain

QUANTITIES = ("gravity_torque", "gravity_stiffness", "mass_matrix", "mass_eigenvalues", "coriolis", "torque")

M1, M2, L1, C1, C2, I1, I2, G = 3.0, 2.0, 0.7, 0.4, 0.3, 0.05, 0.04, 9.81
ROUNDING = 1e-10  # relative: a proof allows 2000 eps of the sum of some 100 terms
GRID = 1e-3  # of gravity's tables: (pi / 360)^2 / 2 and (pi / 720)^2 / 2 for each joint


def christoffel(dM):
    """Symbols c_ijk of the derivatives dM_ij/dq_k."""
    return (np.einsum("...kji->...ijk", dM) + np.einsum("...kij->...ijk", dM) - dM) / 2


def planar(masses, lengths, centres, inertias, **options):
    """Joints about z, gravity along -y."""
    n = len(masses)
    vectors = [[[x, 0, 0] for x in values] for values in (lengths, centres)]
    return rne.model.chain(
        [np.eye(3)] * n,
        vectors[0],
        masses,
        vectors[1],
        [np.diag([0, i, i]) for i in inertias],
        gravity=[0, -G, 0],
        **options,
    )


def two_link():
    return rne.Robot(planar([M1, M2], [L1, 0.5], [C1, C2], [I1, I2]))


def mimicking(multiplier, **limits):
    """A planar arm whose second joint follows the first."""
    model = replace(
        planar([M1, M2], [L1, 0.5], [C1, C2], [I1, I2]),
        coordinate=(0, 0), independent_joints=(0,), multiplier=[1.0, multiplier], offset=[0.0, 0.3],
    )  # fmt: skip
    return rne.Robot(replace(model, **{name: np.full(2, x) for name, x in limits.items()}))


def polar_arm(lower=0.2, upper=0.9):
    """An arm that turns and slides: M_11 = M1 C1^2 + I1 + M2 (q2 + C2)^2 + I2."""
    slider = {"types": ["revolute", "prismatic"], "axes": [[0, 0, 1], [1, 0, 0]]}
    return rne.Robot(planar([M1, M2], [0, 0.5], [C1, C2], [I1, I2], lower=[-9, lower], upper=[9, upper], **slider))


@pytest.fixture(scope="module", params=kept([3, 6], [3]))
def arm(request, irb140):
    """The IRB 140 with some of its joints."""
    return first_joints(request.param)


@pytest.fixture(scope="module")
def of_arm(arm):
    return arm.bounds(rates=RATES, accelerations=ACCELERATIONS, tolerance=0.15)


def test_a_pendulum_has_its_closed_form():
    m, c = 2.0, 0.5
    found = rne.Robot(planar([m], [1.0], [c], [0.1])).bounds(rates=3.0, accelerations=4.0, tolerance=1e-9)
    inertia = m * c**2 + 0.1
    exact = {
        "gravity_torque": m * G * c, "gravity_stiffness": m * G * c, "mass_matrix": inertia, "mass_eigenvalues": inertia,
        "torque": m * G * c + inertia * 4.0,
    }  # fmt: skip
    for name, value in exact.items():
        bound = getattr(found, name)
        for x in (bound.lower, bound.upper, bound.attained):
            np.testing.assert_allclose(x, value, rtol=2e-9)
        assert (bound.lower <= value).all()
        assert (value <= bound.upper).all()
        assert bound.is_tight.all()
    assert found.coriolis.attained == 0 == found.coriolis.gap


def test_a_two_link_arm_has_its_closed_forms():
    """Siciliano et al. 2009, (7.82): a = M2 L1 C2 sin q2 is the only Coriolis term, stretched out is the extreme of M."""
    found = two_link().bounds(tolerance=1e-9, quantities=[q for q in QUANTITIES if q not in ("coriolis", "torque")])
    M = two_link().mass_matrix([[0, 0], [0, np.pi]])
    eigenvalues = np.linalg.eigvalsh(M)
    torques = G * np.array([M1 * C1 + M2 * (L1 + C2), M2 * C2])
    stiffness = np.linalg.norm([[torques[0], torques[1]], [torques[1], torques[1]]], 2)
    expected = {
        "gravity_torque": torques, "gravity_stiffness": stiffness, "mass_matrix": abs(M).max(axis=0),
        "mass_eigenvalues": [eigenvalues[:, 0].min(), eigenvalues[:, 1].max()],
    }  # fmt: skip
    for name, value in expected.items():
        bound = getattr(found, name)
        np.testing.assert_allclose(bound.attained, value, rtol=1e-9, err_msg=name)
        assert (bound.lower <= np.multiply(value, 1 + ROUNDING)).all(), name
        assert (np.multiply(value, 1 - ROUNDING) <= bound.upper).all(), name
        assert bound.is_tight.all(), name


def test_coriolis_of_a_two_link_arm():
    """|C(q, v) v| is at most a times the largest of |(2 v1 v2 + v2^2, v1^2)| on the circle."""
    v1, v2 = np.cos(turn := np.linspace(0, np.pi, 200_001)), np.sin(turn)
    a = M2 * L1 * C2
    exact = a * np.hypot(2 * v1 * v2 + v2**2, v1**2).max()
    bound = two_link().bounds(quantities=["coriolis"], tolerance=0.01).coriolis
    np.testing.assert_allclose(bound.attained, exact, rtol=1e-8)  # of the grid of angles
    assert bound.lower <= exact * (1 + 1e-8)
    assert exact <= bound.upper
    assert bound.is_tight


def test_bounds_of_a_two_link_arm_hold_in_exact_numbers():
    """Of the model's numbers as they are, without any rounding: stretched out, where gravity and M_11 are largest."""
    m1, m2, l1, c1, c2, i1, i2, g = map(Fraction, (M1, M2, L1, C1, C2, I1, I2, G))
    found = two_link().bounds(tolerance=1e-9, quantities=["gravity_torque", "mass_matrix"])
    torques = [g * (m1 * c1 + m2 * (l1 + c2)), g * m2 * c2]
    assert all(exact <= Fraction(x) for exact, x in zip(torques, found.gravity_torque.upper.tolist(), strict=True))
    inertia = m1 * c1**2 + i1 + m2 * (l1 + c2) ** 2 + i2
    assert inertia <= Fraction(float(found.mass_matrix.upper[0, 0]))
    assert max(found.gravity_torque.upper / found.gravity_torque.attained) <= 1 + 1e-9


def test_coriolis_of_a_polar_arm_is_not_at_a_saddle():
    """C(q, v) v = a (2 v1 v2, -v1^2): a at v = (1, 0), which no small step leaves, 2 / 3^(1/2) a at v1^2 = 2 / 3."""
    bound = polar_arm().bounds("limits", quantities=["coriolis"], tolerance=0.01).coriolis
    np.testing.assert_allclose(bound.attained, 2 / np.sqrt(3) * M2 * (0.9 + C2), rtol=1e-6)  # of five steps
    assert bound.is_tight


def test_samples_and_searches_of_an_arm_are_inside(arm, of_arm):
    rng = np.random.default_rng(1)
    q = rng.uniform(-np.pi, np.pi, (5_000, arm.n))
    # and around each place where a bound is attained
    places = np.concatenate([getattr(of_arm, name).q.reshape(-1, arm.n) for name in QUANTITIES])
    q = np.concatenate([q, (places[:, None] + 0.1 * rng.normal(size=(len(places), 50, arm.n))).reshape(-1, arm.n)])
    qd, qdd = (rng.choice([-1, 1], q.shape) * x for x in (RATES, ACCELERATIONS))
    assert (abs(arm.gravity_torque(q)) <= of_arm.gravity_torque.upper).all()
    assert (abs(arm.inverse_dynamics(q, qd, qdd)) <= of_arm.torque.upper).all()
    few = q[::4]
    M, stiffness = arm.mass_matrix(few), arm.kernel(rne.dynamics.gravity_torque, "q")(few)
    eigenvalues = np.linalg.eigvalsh(M)
    assert (abs(M) <= of_arm.mass_matrix.upper).all()
    assert (eigenvalues[:, 0] >= of_arm.mass_eigenvalues.lower[0]).all()
    assert (eigenvalues[:, -1] <= of_arm.mass_eigenvalues.upper[1]).all()
    assert (np.linalg.norm(stiffness, 2, axis=(1, 2)) <= of_arm.gravity_stiffness.upper).all()
    v = rng.normal(size=few.shape)
    sizes = np.linalg.norm(arm.coriolis_torque(few, v), axis=1) / (v**2).sum(axis=1)
    assert (sizes <= of_arm.coriolis.upper).all()


def test_states_and_searches_of_the_benchmark_are_inside(arm, of_arm):
    """10^4 random states and 10 local searches of each entry, by the robot's own methods."""
    proven = {q: {x: getattr(getattr(of_arm, q), x) for x in ("lower", "upper")} for q in QUANTITIES}
    *_, states = sampled(arm, "circle", 10_000)
    found = searched(arm, "circle", 10)
    assert outside(states["largest"], proven) == []
    assert outside({q: found[q] for q in QUANTITIES}, proven) == []
    found["torque"][2] *= 1.16  # beyond the bound, which is within 15 %
    found["mass_eigenvalues"][0] *= 0.85
    assert outside({q: found[q] for q in QUANTITIES}, proven) == ["mass_eigenvalues", "torque"]


def test_samples_that_were_interrupted_go_on_as_if_at_once():
    robot = two_link()
    *_, part = sampled(robot, "circle", 10_000)
    *_, continued = sampled(robot, "circle", 100_000, part)
    *_, whole = sampled(robot, "circle", 100_000)
    assert continued == whole
    assert set(whole["curve"]) == {"3", "4", "5"}


def test_what_is_attained_is_attained(arm, of_arm):
    """At the positions given, within the bounds."""
    for name in QUANTITIES:
        bound = getattr(of_arm, name)
        assert (bound.lower <= bound.attained).all(), name
        assert (bound.attained <= bound.upper).all(), name
        assert bound.is_tight.all(), name
    gravity = of_arm.gravity_torque
    np.testing.assert_allclose(
        abs(arm.gravity_torque(gravity.q))[range(arm.n), range(arm.n)], gravity.attained, atol=1e-12
    )
    least, largest = of_arm.mass_eigenvalues.q
    eigenvalues = np.linalg.eigvalsh(arm.mass_matrix([least, largest]))
    np.testing.assert_allclose([eigenvalues[0, 0], eigenvalues[1, -1]], of_arm.mass_eigenvalues.attained, rtol=1e-9)


def test_entries_that_vanish_are_proven_0(arm, of_arm):
    zero = of_arm.gravity_torque.attained == 0
    assert zero.tolist() == {3: [True, False, False], 6: [True, False, False, False, False, True]}[len(zero)]
    q = np.random.default_rng(7).uniform(-np.pi, np.pi, (100_000, arm.n))
    rounding = abs(arm.gravity_torque(q))[:, zero].max(axis=0)  # of terms as large as the others'
    assert (rounding <= of_arm.gravity_torque.upper[zero]).all()
    assert (of_arm.gravity_torque.upper[zero] < ROUNDING * of_arm.gravity_torque.upper.max()).all()
    first = str(of_arm).splitlines()[1].split()
    left = f"{of_arm.gravity_torque.upper[0]:.4g}"  # not 0: of extreme mass ratios it is not small
    assert first == ["rounding", "<=", left, "0", "gravity", "torque", "of", "joint_1", "[N", "m]"]


@pytest.mark.parametrize(("n", "seed"), kept([(2, 3), (3, 3), (4, 22), *((6, seed) for seed in range(4))], [(2, 3)]))
def test_gravity_of_full_turns_is_attained_from_below(n, seed):
    """The product of gravity's largest sine and the largest first moment, by search within the steps of its angles."""
    robot = rne.Robot(random_tree(n, seed, prismatic=0.0))
    upper = gravity_torques_of_full_turns(robot.model)
    turn = np.full(n, np.pi)
    for i in range(n):
        attained = local_maximum(lambda q, i=i: abs(robot.gravity_torque(q))[:, i], -turn, turn, starts=30)[1]
        assert attained <= upper[i] <= attained * (1 + GRID), i


def random_chain(seed, n=4):
    """Joints in random directions, one of which slides; a rotor on each."""
    rng = np.random.default_rng(seed)
    types = ["prismatic" if k == seed % n else "revolute" for k in range(n)]
    A = rng.normal(size=(n, 3, 3))
    axes, com, place = rng.normal(size=(3, n, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    inertia = 0.1 * (np.trace(A @ A.swapaxes(1, 2), axis1=1, axis2=2)[:, None, None] * np.eye(3) - A @ A.swapaxes(1, 2))
    turns = [np.linalg.qr(a)[0] * np.sign(np.linalg.det(np.linalg.qr(a)[0])) for a in rng.normal(size=(n, 3, 3))]
    mass, armature = rng.uniform(0.5, 2, n), rng.uniform(0, 0.02, n)
    model = rne.model.chain(turns, 0.4 * place, mass, 0.2 * com, list(inertia), types=types, axes=axes)
    return rne.Robot(replace(model, armature=armature, lower=np.full(n, -0.5), upper=np.full(n, 1.5)))


def least_eigenvalue(robot, positions):
    """Its criterion and box."""
    terms = RobotPolynomials(robot.kernels, positions)
    return LargestOfInverse(terms.polynomial(rne.dynamics.mass_matrix, 2), terms.samples, np.eye(robot.n)), terms.box


@pytest.mark.parametrize("turns", [True, False])
def test_control_points_enclose_functions_of_a_range(turns):
    """Any combination lies between its least and largest control point, and begins and ends at the first and last."""
    rng = np.random.default_rng(1)
    lower = rng.uniform(-3, 3, 500)
    upper = lower + rng.uniform(0, 2 * np.pi / 3, 500)
    points, weights = control_points(lower, upper, turns)
    assert (weights > 0).all()
    of = rng.normal(size=(500, 3 if not turns else 5))  # powers beyond the square do not occur
    points = np.einsum("njm,nm->nj", points[..., : of.shape[1]] / weights[..., None], of)
    x = np.linspace(lower, upper, 100, axis=1)
    values = np.einsum("nxm,nm->nx", functions(x, turns)[..., : of.shape[1]], of)
    np.testing.assert_allclose(values[:, [0, -1]], points[:, [0, -1]], atol=1e-12)
    assert (values >= points.min(axis=1)[:, None] - 1e-12).all()
    assert (values <= points.max(axis=1)[:, None] + 1e-12).all()


@pytest.mark.parametrize("seed", kept(range(4), [1]))
def test_articulated_pivots_at_a_position_are_those_of_the_matrix(seed):
    """On boxes without width they are positive exactly if M - 1 / t is positive definite."""
    robot = random_chain(seed)
    criterion, box = least_eigenvalue(robot, "limits")
    q = np.random.default_rng(seed).uniform(box.lower, box.upper, (500, robot.n))
    values = criterion.values(q)
    search = ArticulatedSearch(criterion, box, q[0], np.median(values), Clock())
    x = (q - search.middle) / search.scale
    holds = search.holds(np.stack([x, x], axis=-1))[0]
    np.testing.assert_array_equal(holds.all(axis=1), values <= search.target)
    np.testing.assert_array_equal(holds.all(axis=1), holds.any(axis=1))


def test_articulated_pivots_are_searched_for_the_least_eigenvalue_alone():
    criterion, box = least_eigenvalue(two_link(), "circle")
    assert applies(criterion, box)
    assert not applies(replace(criterion, projection=np.diag([1.0, 0.0])), box)


def test_a_pivot_that_dips_below_zero_between_the_halvings_is_not_proven_positive():
    """1 - d - cos(x - a) is negative within (2 d)^1/2 of a, less than the last of twenty halvings; 1 + d - cos is not."""
    criterion, box = least_eigenvalue(two_link(), "circle")
    search = ArticulatedSearch(criterion, box, box.lower, 1.0, Clock())
    a, ends = np.random.default_rng(0).uniform(-3, 3, 20), np.full(20, np.pi)
    for dip, is_proven in ((1e-14, False), (-1e-11, True)):  # rounding is a tenth of this dip
        P = np.stack([np.full(20, 1 - dip), -np.cos(a), -np.sin(a), 0 * a, 0 * a], axis=1)[..., None]
        holds, _ = search.are_positive(P, np.ones((20, 1), dtype=bool), -ends, ends, True)
        assert (holds == is_proven).all()


@pytest.mark.parametrize("seed", kept(range(4), [3]))
def test_least_eigenvalues_of_random_chains_are_proven_and_nothing_beyond(seed):
    """None of 10^4 states is outside, and what a state exceeds is refused."""
    robot = random_chain(seed)
    criterion, box = least_eigenvalue(robot, "limits")
    clock = Clock()
    (found,) = largest([criterion], box, 0.05, clock.now() + 60.0, clock)
    q = np.random.default_rng(seed).uniform(box.lower, box.upper, (10_000, robot.n))
    assert np.linalg.eigvalsh(robot.mass_matrix(q))[:, 0].min() >= 1 / found.upper
    assert found.upper <= 1.05 * found.attained * (1 + 1e-9)
    search = ArticulatedSearch(criterion, box, found.q, 0.999 * found.attained, Clock())
    assert not search.run(np.inf)
    assert criterion.values(search.higher[None]) > search.target


def test_what_fails_in_a_narrow_box_is_found_beside_wide_ones():
    """Of the second joint's range all is looked at, though at the place that is given nothing exceeds the target."""
    robot = random_chain(1)
    criterion, box = least_eigenvalue(robot, "limits")
    line = np.linspace(box.lower, box.upper, 1000)
    q = np.where(np.arange(robot.n) == 1, line, (box.lower + box.upper) / 2)
    values = criterion.values(q)
    search = ArticulatedSearch(criterion, box, q[0], (values.min() + values.max()) / 2, Clock())
    x = (q[values.argmin()] - search.middle) / search.scale
    half = np.array([[1e-8], [0.1]]) * np.ones(robot.n)  # narrow and wide
    fails = np.ones((2, 25), dtype=bool)
    search.halved(np.stack([x - half, x + half], axis=2), fails, x[[1, 1]])
    assert criterion.values(search.higher[None]) > search.target


def test_work_is_counted_up(monkeypatch):
    counted, count = [], Clock.count
    monkeypatch.setattr(Clock, "count", lambda clock, work: (counted.append(work), count(clock, work)))
    pendulum = rne.Robot(planar([2.0], [1.0], [0.5], [0.1]))
    pendulum.bounds(quantities=["torque"], rates=[1.0], accelerations=[1.0], tolerance=0.3)
    assert min(counted) >= 0


def test_rounding_of_a_pendulum_proves_nothing():
    """M - 1 / t of one joint, positive by a part in 1e14: that much is rounding."""
    criterion, box = least_eigenvalue(rne.Robot(planar([2.0], [1.0], [0.5], [0.1])), "circle")
    attained = criterion.values(box.lower[None])[0]
    for share, is_proven in ((1e-14, False), (1e-11, True)):
        search = ArticulatedSearch(criterion, box, box.lower, attained * (1 + share), Clock())
        x = np.zeros((1, 1, 2))
        assert search.holds(x)[0].all() == is_proven


def test_gravity_that_is_nothing_but_rounding_is_within_its_bound_of_full_turns(irb140):
    """Joint 1 is upright: its torque is a sum of terms that cancel."""
    robot = first_joints()
    rounding = abs(robot.gravity_torque(np.random.default_rng(1).uniform(-np.pi, np.pi, (1000, 3))))[:, 0].max()
    upper = gravity_torques_of_full_turns(robot.model)[0]
    assert max(rounding, 1e-14) <= upper <= 1e-9


def test_sliding_joints_have_no_gravity_bound_of_full_turns():
    parts = [
        Part(link="base"),
        Part(link="lift", joint="lift", kind="prismatic", axis=np.array([0, 0, 1.0]), mass=1.0),
        Part(link="swing", joint="swing", kind="revolute", axis=np.array([0, 1.0, 0]), parent=1, mass=2.0,
             com=np.array([0.3, 0, 0])),
    ]  # fmt: skip
    model = replace(assemble("lift", parts), lower=np.zeros(2), upper=np.ones(2))
    lifted, swung = gravity_torques_of_full_turns(model)
    assert lifted >= 1e150
    np.testing.assert_allclose(swung, 2 * G * 0.3, rtol=GRID)
    np.testing.assert_allclose(rne.Robot(model).bounds("limits").gravity_torque.upper, [3 * G, 2 * G * 0.3], rtol=1e-9)


def test_angles_are_exchanged_for_sums_where_axes_are_parallel():
    """Whole numbers of determinant 1 that shorten the modes, and leave coordinates with a range alone."""
    frequency = np.array([[1.0, 1, 1, 0], [2, 2, 2, 1], [0, 1, 1, 0], [0, 0, 0, 2]])
    gram = frequency.T @ frequency
    for circle in ([True] * 4, [True, True, False, True]):
        basis = short_basis(gram, np.array(circle))
        np.testing.assert_array_equal(basis, np.round(basis))
        assert round(np.linalg.det(basis)) == 1
        diagonal = np.diag(basis.T @ gram @ basis)
        assert (diagonal <= np.diag(gram)).all()
        assert diagonal.sum() < gram.trace()
        fixed = ~np.array(circle)
        np.testing.assert_array_equal(basis[fixed], np.eye(4)[fixed])
        np.testing.assert_array_equal(basis[:, fixed], np.eye(4)[:, fixed])


@pytest.mark.parametrize(
    "make", [two_link, polar_arm, lambda: mimicking(2.0), lambda: mimicking(0.7, lower=-1, upper=2)]
)
def test_modes_bound_values_and_derivatives(make):
    """Sums of modes bound |A|, |dA/dq_k| and |d^2A/dq_k^2|, turning, sliding and mimicking."""
    robot = make()
    cache = robot.kernels
    terms, h = RobotPolynomials(cache, "limits"), 1e-4
    box = terms.box
    q = np.random.default_rng(2).uniform(box.lower, box.upper, (2000, robot.n))
    for A, function in (
        (terms.polynomial(rne.dynamics.gravity_torque, 1), robot.gravity_torque),
        (terms.polynomial(rne.dynamics.mass_matrix, 2), robot.mass_matrix),
    ):
        np.testing.assert_allclose(A.evaluate(q), function(q), atol=1e-12)
        if not A.power.any():
            sums = np.tensordot(np.exp(1j * q @ A.frequency.T), A.coefficients, 1).real
            np.testing.assert_allclose(sums, A.evaluate(q), atol=1e-11)
        size, (slopes, curvatures) = abs(A.coefficients), A.derivatives(np.eye(robot.n))
        assert (abs(function(q)) <= size.sum(axis=0) * (1 + ROUNDING) + 1e-15).all()
        for k, e in enumerate(np.eye(robot.n)):
            low, middle, high = (function(q + s * h * e) for s in (-1, 0, 1))
            slope, second = abs(high - low) / 2 / h, abs(high - 2 * middle + low) / h**2
            assert (slope <= np.tensordot(slopes[:, k], size, 1) + 1e-5).all()  # of differences: h^2, eps / h^2
            assert (second <= np.tensordot(curvatures[:, k], size, 1) + 1e-5).all()


def test_a_matrix_mode_is_bounded_at_every_phase():
    """-B <= Re(exp(i phase) c) <= B for a complex symmetric c, relative to any scale."""
    rng = np.random.default_rng(3)
    robot = two_link()
    terms = RobotPolynomials(robot.kernels, "circle")
    M = terms.polynomial(rne.dynamics.mass_matrix, 2)
    c = rng.normal(size=(5, 2, 2)) + 1j * rng.normal(size=(5, 2, 2))
    M = replace(M, coefficients=c + c.swapaxes(1, 2))
    for criterion in (Norm(M), LargestOfInverse(M, rng.uniform(-3, 3, (9, 2)), np.eye(2))):
        for phase in np.linspace(0, 2 * np.pi, 50):
            real = (np.exp(1j * phase) * M.coefficients).real
            assert np.linalg.eigvalsh(criterion.modes - real).min() > -1e-12
            assert np.linalg.eigvalsh(criterion.modes + real).min() > -1e-12


def test_rounding_is_at_least_that_of_the_sum_of_modes():
    """Of 2000 operations, on a number as large as the quantity can be anywhere."""
    terms = RobotPolynomials(two_link().kernels, "circle")
    for criterion in (
        Norm(terms.polynomial(rne.dynamics.mass_matrix, 2)),
        Modulus(terms.polynomial(rne.dynamics.gravity_torque, 1)),
    ):
        assert criterion.size > 0
        assert criterion.rounding(0.0) >= 2000 * np.finfo(float).eps * criterion.size


def test_the_symmetric_form_bounds_the_coriolis_norm(irb140):
    """Of random symbols c_ijk: no unit vectors v, w give more than the root of its largest eigenvalue."""
    rng = np.random.default_rng(4)
    terms = RobotPolynomials(irb140.kernels, "circle")
    dM = terms.polynomial(rne.dynamics.mass_matrix, 2, "q")
    A = dM.mapped(christoffel, 1.5 * dM.terms)
    criterion = Coriolis(A)
    q = rng.uniform(-np.pi, np.pi, (50, 6))
    bound = np.sqrt(np.linalg.eigvalsh(criterion._form(A.evaluate(q)))[:, -1])
    attained = criterion.values(q)
    v, w = rng.normal(size=(2, 4000, 6))
    v, w = (x / np.linalg.norm(x, axis=1)[:, None] for x in (v, w))
    sampled = np.linalg.norm(np.einsum("nijk,si,sj->nsk", A.evaluate(q[:5]), v, w), axis=2).max(axis=1)
    assert (sampled <= attained[:5]).all()
    assert (attained <= bound * (1 + ROUNDING)).all()
    assert (bound <= 1.15 * attained).all()  # so tight is the relaxation for this arm
    assert [bool(criterion.holds(q[:1], t * bound[0], 0.0)[0]) for t in (0.999, 1.001)] == [False, True]


def test_positive_definite_matches_the_eigenvalues():
    A = np.random.default_rng(5).normal(size=(500, 4, 4))
    A = A + A.swapaxes(1, 2) + 2 * np.eye(4)
    np.testing.assert_array_equal(positive_definite(A), np.linalg.eigvalsh(A)[:, 0] > 0)


def test_arms_that_do_not_meet_are_bounded_each():
    """The extremes of two planar arms on one base are those of one of them."""
    parts = [Part(link="base")]
    for name, mass in (("left", 1.0), ("right", 0.3)):
        for x in (0.0, 0.4):
            carrier = 0 if x == 0 else len(parts) - 1
            body = {"mass": mass, "com": np.array([0.2, 0, 0]), "inertia": 0.01 * mass * np.eye(3)}
            joint = {"kind": "revolute", "parent": carrier, "placement": pose(np.eye(3), np.array([x, 0, 0]))}
            parts.append(Part(link=f"{name}{x}", joint=f"{name} {x}", axis=np.array([0, 0, 1.0]), **body, **joint))
    robot = rne.Robot(assemble("two arms", parts))
    found = robot.bounds(quantities=["mass_eigenvalues"], tolerance=1e-3).mass_eigenvalues
    M = np.concatenate([robot.mass_matrix([[0, a, 0, b] for a, b in [(0, 0), (np.pi, np.pi), (0, np.pi)]])])
    eigenvalues = np.linalg.eigvalsh(M)
    np.testing.assert_allclose(found.attained, [eigenvalues.min(), eigenvalues.max()], rtol=1e-9)
    assert found.is_tight.all()


def test_a_sliding_joint_has_its_range():
    found = polar_arm().bounds("limits", quantities=["mass_matrix", "gravity_torque"], tolerance=1e-6)
    inertia = M1 * C1**2 + I1 + I2 + M2 * (0.9 - 0.5 + C2 + 0.5) ** 2
    reach = max(abs(polar_arm().mass_matrix([[0, 0.2], [0, 0.9]])[:, 0, 0]))
    np.testing.assert_allclose(found.mass_matrix.upper[0, 0], reach, rtol=2e-6)
    np.testing.assert_allclose(reach, inertia, rtol=1e-12)
    np.testing.assert_allclose(found.gravity_torque.upper[1], M2 * G, rtol=2e-6)
    with pytest.raises(ValueError, match=r"bounds need a range of 'joint_2', which slides; give `positions`"):
        polar_arm(upper=np.inf).bounds()


def test_a_sliding_joint_that_is_held_leaves_a_pendulum():
    """A range of no width, and one so narrow that its inverse square is not a number."""
    for width in (0.0, 1e-160):
        found = polar_arm().bounds(([-9, 0.0], [9, width]), quantities=["gravity_stiffness"]).gravity_stiffness
        assert found.is_tight
        held = polar_arm().kernel(rne.dynamics.gravity_torque, "q")(
            np.array([[x, 0.0] for x in np.linspace(0, 7, 1000)])
        )
        assert np.linalg.norm(held, 2, axis=(1, 2)).max() <= found.upper


def test_the_table_has_the_units_of_joint_torques():
    lines = str(polar_arm().bounds(quantities=["gravity_torque"])).splitlines()
    assert [line[line.index(" [") :] for line in lines[1:]] == [" [N m]", " [N]"]


def test_a_point_is_fastest_where_a_two_link_arm_is_stretched():
    rates, beyond = np.array([1.5, 4.0]), 0.25  # of the end of the second link, which is 0.5 m long
    robot = two_link()
    found = robot.bounds(quantities=["point_speed"], rates=rates, link=robot.link_names[-1], point=[beyond, 0, 0])
    speed = L1 * rates[0] + (0.5 + beyond) * rates.sum()
    np.testing.assert_allclose(found.point_speed.attained, speed, rtol=1e-9)
    assert found.point_speed.lower <= speed * (1 + ROUNDING)
    assert speed * (1 - ROUNDING) <= found.point_speed.upper <= speed * 1.05
    assert str(found).splitlines()[-1].endswith(f"{speed:.4g}  speed of the point [m/s]")


@pytest.mark.parametrize("make", ["arm", "sliding", "mimic"])
def test_no_sample_of_a_points_velocity_is_beyond_its_bound(make, irb140):
    """Corners of the rates at random positions; the joint nearest to the root is held unless it drives another."""
    robot = {
        "arm": lambda: irb140,
        "sliding": polar_arm,
        "mimic": lambda: mimicking(2.0),
    }[make]()
    positions = {"arm": (-np.full(6, 0.5), np.full(6, 0.5)), "mimic": "circle", "sliding": "limits"}[make]
    link, point, rates = robot.link_names[-1], (0.1, -0.2, 0.3), np.linspace(0.5, 2, robot.n)
    found = robot.bounds(positions, quantities=["point_speed"], link=link, point=point, rates=rates)
    rng = np.random.default_rng(5)
    q = rng.uniform(found.lower, found.upper, (20_000, robot.n))
    velocity = robot.jacobian(q, link, point)[:, 3:] @ (rng.choice([-1, 1], q.shape) * rates)[..., None]
    fastest = np.linalg.norm(velocity, axis=(1, 2)).max()
    bound = found.point_speed
    assert fastest <= bound.attained * (1 + 1e-6)
    assert bound.attained <= bound.upper * (1 + ROUNDING)
    assert fastest > 0.8 * bound.attained
    J = robot.jacobian(bound.q, link, point)[3:]
    corners = np.array(list(itertools.product([1, -1], repeat=robot.n))) * rates
    np.testing.assert_allclose(np.linalg.norm(corners @ J.T, axis=1).max(), bound.attained, rtol=1e-12)


def test_a_robot_without_joints_is_refused():
    with pytest.raises(ValueError, match=r"bounds need a robot that moves, '.*' has no joints"):
        two_link().locked({"joint_1": 0, "joint_2": 0}).bounds()


@pytest.mark.parametrize(
    ("robot", "positions"), [(mimicking(2.0), "circle"), (mimicking(-0.7), ([-1.0], [2.0]))], ids=["whole", "fraction"]
)
def test_joints_that_mimic_follow_their_driver(robot, positions):
    wanted = ["gravity_torque", "mass_matrix", "torque"]
    found = robot.bounds(positions, rates=RATES, accelerations=ACCELERATIONS, tolerance=1e-4, quantities=wanted)
    q = np.linspace(*((-np.pi, np.pi) if positions == "circle" else (-1, 2)), 2_001)[:, None]
    sizes = {"gravity_torque": abs(robot.gravity_torque(q)).max(), "mass_matrix": robot.mass_matrix(q).max()}
    sizes["torque"] = max(
        abs(robot.inverse_dynamics(q, 0 * q + RATES, s * (0 * q + ACCELERATIONS))).max() for s in (-1, 1)
    )
    for name, size in sizes.items():
        upper = getattr(found, name).upper.max()
        assert size <= upper <= size * (1 + 2e-4), name
    slider = replace(mimicking(1.0).model, joint_types=("revolute", "prismatic"))
    for wrong in (mimicking(0.7), rne.Robot(slider)):
        with pytest.raises(
            ValueError, match=r"range of 'joint_1', which drives joints that turn by a fraction of its an"
        ):
            wrong.bounds()


def test_ranges_of_masses_have_their_extremes_at_the_ends(arm):
    wanted = ["gravity_torque", "mass_eigenvalues"]
    options = {"quantities": wanted, "tolerance": 0.5}
    found = arm.bounds(payload=(0, 3), masses={"link_2": (20, 24)}, **options)
    heavy = arm.with_payload(3.0)
    m = heavy.model
    factor = np.where(np.arange(arm.n) == 1, 24 / 22, 1.0)
    heavy = rne.Robot(replace(m, mass=m.mass * factor, inertia=m.inertia * factor[:, None, None]))
    alone = heavy.bounds(quantities=["gravity_torque"], tolerance=0.5)
    np.testing.assert_allclose(found.gravity_torque.upper, alone.gravity_torque.upper, atol=1e-9)
    rng = np.random.default_rng(6)
    for loaded in (arm, arm.with_payload(1.3), arm.with_payload(3.0)):
        q = rng.uniform(-np.pi, np.pi, (1000, arm.n))
        assert (abs(loaded.gravity_torque(q)) <= found.gravity_torque.upper).all()
        eigenvalues = np.linalg.eigvalsh(loaded.mass_matrix(q))
        assert eigenvalues.min() >= found.mass_eigenvalues.lower[0]
        assert eigenvalues.max() <= found.mass_eigenvalues.upper[1]


def test_the_least_inertia_of_a_range_of_masses_is_that_of_the_lightest():
    """Of a pendulum with a payload at the end of its rod, of length 1: m c^2 + I, and the payload's mass more."""
    rod = rne.Robot(planar([2.0], [1.0], [0.5], [0.1]))
    found = rod.bounds(payload=(0, 3), quantities=["mass_eigenvalues"], tolerance=1e-6).mass_eigenvalues
    for x in (found.lower, found.upper, found.attained):
        np.testing.assert_allclose(x, [0.6, 3.6], rtol=2e-6)


def test_smaller_ranges_have_smaller_bounds(arm):
    """Limits are within circles, and a fixed position has its own values."""
    q = np.array([0.1, 0.2, -0.3, 0.4, 0.5, 0.6])[: arm.n]
    there = arm.bounds((q, q), quantities=["gravity_torque", "gravity_stiffness"])
    np.testing.assert_allclose(there.gravity_torque.upper, abs(arm.gravity_torque(q)), rtol=1e-9, atol=1e-9)
    limits, circle = (arm.bounds(p, quantities=["gravity_torque"]).gravity_torque for p in ("limits", "circle"))
    assert (limits.attained <= circle.upper).all()
    assert limits.is_tight.all()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("steps", [6, 8])
def test_grids_bound_what_lies_between_their_points(degree, steps):
    """A peak in the middle of a cell of the grid is found to be as high as it is."""
    number = steps * degree
    m = degree * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    c = np.exp(-1j * m @ np.full(2, np.pi / number))[:, None] / 4  # cos d (x - pi / N) cos d (y - pi / N)
    peak = Modulus(Polynomial(lambda q: q, c, m, 0.0 * m, 0.0 * m, np.zeros(1)))
    everything = np.ones(4, dtype=bool)
    values = np.concatenate(list(values_on_grid(m, c, np.array([number, number]))))
    x = 2 * np.pi / number * np.indices((number, number)).reshape(2, -1).T
    np.testing.assert_allclose(values, (np.exp(1j * x @ m.T) @ c).real, atol=1e-14)
    of_grid = ratio_on_grid(peak, m, everything, np.ones(4), np.array([number, number]), Clock(), np.inf)
    assert of_grid == pytest.approx(1, abs=1e-12)
    assert values.max() < 0.95


@pytest.mark.parametrize(
    "make",
    [
        pytest.param(lambda: first_joints(5), marks=pytest.mark.long),
        lambda: mimicking(2.0),
        lambda: random_chain(3),
    ],
)
def test_second_derivatives_are_within_what_grids_prove(make):
    """Of torques, k_C and an entry of M, in each direction of the search, and less than sums of modes say."""
    robot = make().mounted([0.3, 0.4, 0])
    terms, rng = RobotPolynomials(robot.kernels, "limits"), np.random.default_rng(5)
    n, box = robot.n, terms.box
    dM = terms.polynomial(rne.dynamics.mass_matrix, 2, "q")
    torques = torque_criteria(terms, np.full(n, RATES), np.full(n, ACCELERATIONS))
    k_C = Coriolis(dM.mapped(christoffel, 1.5 * dM.terms))
    less = []
    for criterion in (*torques, k_C, Modulus(entry(terms.polynomial(rne.dynamics.mass_matrix, 2), 0, 0))):
        search, A = CellSearch(criterion, box, box.lower, np.inf, Clock()), criterion.polynomial
        sums, q = search.curvatures.copy(), rng.uniform(-np.pi, np.pi, (200, n))
        search.use_grids(np.inf)
        turn = np.exp(1j * q @ A.frequency.T) * (A.power == 0).all(axis=1)
        for k in np.flatnonzero(search.free):
            second = np.tensordot(turn * (A.frequency @ search.basis)[:, k] ** 2, A.coefficients, 1).real
            bound = search.curvatures[:, k] @ criterion.modes
            of_k_C = Coriolis(replace(A, evaluate=lambda q, second=second: second))
            norms = of_k_C.values(q) if criterion is k_C else criterion.moduli(second)
            assert norms.max() <= bound * (1 + ROUNDING)
            less.append(bound / (sums[:, k] @ criterion.modes))
    assert min(less) < 0.9


def test_gravity_and_the_rest_are_largest_together():
    """The parts of gravity about the first axis of a mounted arm; no torque of 20,000 states is outside of its bound."""
    robot = first_joints().mounted([0.5, 0, 0])
    terms = RobotPolynomials(robot.kernels, "circle")
    box = terms.box
    q = np.random.default_rng(6).uniform(box.lower, box.upper, (20_000, 3))
    g = entry(terms.polynomial(rne.dynamics.gravity_torque, 1), 1)
    parts = about_first_angle(g)
    torque, mean, cosine, sine = parts.evaluate(q[:50]).T
    angle = q[:50, 0]
    np.testing.assert_allclose(mean + cosine * np.cos(angle) + sine * np.sin(angle), torque, atol=1e-11)
    modes = (np.exp(1j * q[:50] @ parts.frequency.T) @ parts.coefficients).real
    np.testing.assert_allclose(modes[:, 1:], parts.evaluate(q[:50])[:, 1:], atol=1e-11)
    found = robot.bounds(rates=RATES, accelerations=ACCELERATIONS, quantities=["torque"]).torque
    v, a = np.random.default_rng(7).choice([-1.0, 1.0], (2, 20_000, 3)) * [[[RATES]], [[ACCELERATIONS]]]
    sampled_torques = abs(robot.inverse_dynamics(q, v, a)).max(axis=0)
    assert (sampled_torques <= found.upper).all()
    assert (sampled_torques > 0.9 * found.upper).all()


def test_gravity_of_a_mounted_robot_depends_on_the_first_joint(arm):
    found = arm.mounted([np.pi / 2, 0, 0]).bounds(quantities=["gravity_torque"]).gravity_torque
    assert found.attained[0] > 100
    assert found.is_tight.all()


def test_work_that_is_too_little_leaves_honest_bounds(arm):
    bound = arm.bounds(quantities=["coriolis"], budget=1e-6).coriolis
    assert not bound.is_tight
    assert bound.attained < bound.upper < np.inf
    table = arm.bounds(quantities=["mass_eigenvalues"], budget=1e-6, tolerance=2.0)
    assert table.mass_eigenvalues.lower[0] == 0
    assert np.isinf(table.mass_eigenvalues.gap[0])
    assert not table.mass_eigenvalues.is_tight[0]
    assert "not proven" in str(table)


def test_the_work_is_shared_evenly_by_proofs_that_are_open(monkeypatch):
    """Each search uses up its share, of 1 of 3 parts, of 1 of 2 that are left, and so on; the widest gap comes first."""

    class Search:
        def __init__(self, criterion, box, tolerance, clock, upper):
            self.gap, self.clock, self.cost, self.is_open, self.result = criterion, clock, 0.0, True, []

        def step(self, work):
            self.clock.work += work
            self.result.append(work)
            self.is_open = False

    monkeypatch.setattr(branch_and_bound, "Proof", Search)
    assert largest([1.0, 3.0, 2.0], None, 0.1, 6.0, Clock()) == [[2.0], [2.0], [2.0]]


def test_columns_of_the_table_are_as_wide_as_their_texts():
    stiffness = Bound(np.array(1.75), np.array(2.25), np.array(2.0), np.zeros(1), 0.5)
    assert str(Bounds(gravity_stiffness=stiffness)) == " gap   proven  attained\n25 %  <= 2.25         2  norm of dg/dq"


def test_bounds_do_not_depend_on_the_speed_of_the_machine(monkeypatch):
    """As if every look at the clock took minutes; with a stop the result says which proof it ended."""
    options = {"quantities": ["mass_eigenvalues", "mass_matrix"], "tolerance": 1e-3}
    before, minutes = two_link().bounds(**options), itertools.count(0, 100)
    monkeypatch.setattr("time.monotonic", lambda: next(minutes))
    after, stopped = two_link().bounds(**options), two_link().bounds(**options, seconds=150)
    for name in options["quantities"]:
        for x in ("lower", "upper", "attained"):
            np.testing.assert_array_equal(getattr(getattr(after, name), x), getattr(getattr(before, name), x))
    assert (before.stopped, after.stopped) == ("", "")
    assert stopped.mass_eigenvalues.is_tight.tolist() == [False, False]
    assert (stopped.mass_eigenvalues.lower <= before.mass_eigenvalues.attained).all()
    assert (before.mass_eigenvalues.attained <= stopped.mass_eigenvalues.upper).all()
    stop = r"`seconds` stopped mass_eigenvalues after \S+ of 90 of the budget; another run may differ$"
    assert re.match(stop, stopped.stopped)
    assert str(stopped).endswith(f"\n{stopped.stopped}")


@pytest.mark.parametrize("ratio", [1e-8, 1e-12, 1e-16, 0.0])
def test_least_eigenvalue_below_the_rounding_of_the_largest(ratio):
    """An elbow of hardly any mass behind a heavy arm: M_22 but for a share of the ratio, 0 of a massless link."""
    inertia = M1 * ratio * C2**2
    robot = rne.Robot(planar([M1, M1 * ratio], [L1, 0.5], [C1, C2], [I1, 0.0]))
    table = robot.bounds(quantities=["mass_eigenvalues"], budget=0.1)
    found = table.mass_eigenvalues
    assert found.lower[0] <= found.attained[0] <= found.upper[0]
    np.testing.assert_allclose([found.attained[0], found.upper[0]], inertia, rtol=10 * ratio + 1e-9)
    assert found.is_tight.all()
    assert str(table).splitlines()[1].split()[0] == ("4.8" if ratio else "rounding")


def test_least_eigenvalue_of_light_arms_on_one_heavy_base_has_an_interval():
    """No chain: nothing may be proven, but bounds are numbers in their order."""
    parts = [Part(link="base"), Part(link="turret", joint="turn", kind="revolute", axis=np.array([0, 0, 1.0]), mass=1e3,
                                     inertia=np.eye(3))]  # fmt: skip
    for k in range(2):
        placement = pose(np.eye(3), np.array([0.5, k, 0]))
        parts.append(Part(link=f"arm{k}", joint=f"swing{k}", kind="revolute", parent=1, axis=np.array([0, 1.0, 0]),
                          placement=placement, mass=1e-12, com=np.array([0.3, 0, 0]), inertia=1e-14 * np.eye(3)))  # fmt: skip
    found = rne.Robot(assemble("light", parts)).bounds(quantities=["mass_eigenvalues"], budget=0.01).mass_eigenvalues
    assert (found.lower >= 0).all()
    assert (found.lower <= found.attained).all()
    assert (found.attained <= found.upper).all()
    np.testing.assert_allclose(found.attained[0], 1e-12 * 0.3**2 + 1e-14, rtol=1e-6)
    assert (found.is_tight == (found.gap <= 0.05 * (1 + 1e-6))).all()


def test_a_torque_that_vanishes_in_narrow_ranges_is_proven_to():
    """Hanging down gravity has no torque, though it has elsewhere; beside it the bound is the torque at the end."""
    pendulum = rne.Robot(planar([2.0], [1.0], [0.5], [0.1]))
    for width in (0.0, 1e-15, 1e-3):
        bound = pendulum.bounds(([-np.pi / 2], [-np.pi / 2 + width]), quantities=["gravity_torque"], tolerance=1e-4)
        bound = bound.gravity_torque
        np.testing.assert_allclose(bound.upper, 2 * G * 0.5 * np.sin(width), rtol=1.1e-4, atol=1e-10)
        assert bound.is_tight


def test_torques_of_gravity_and_rates_at_one_position_are_those_of_the_largest_rates():
    """g1 - a (2 v1 v2 + v2^2) and g2 + a v1^2, a = M2 L1 C2 sin q2 < 0: gravity and the squares act together or not."""
    arm, q, v = two_link(), [0.2, -1.0], np.array([2.0, 4.0])
    found = arm.bounds((q, q), rates=v, accelerations=0.0, quantities=["torque"], tolerance=0.02).torque
    a, g = M2 * L1 * C2 * np.sin(-1.0), arm.gravity_torque(q)
    expected = [g[0] - a * (2 * v[0] * v[1] + v[1] ** 2), g[1]]
    assert g.min() > 0
    for x in (found.attained, found.lower, found.upper):
        np.testing.assert_allclose(x, expected, rtol=0.02)


def test_torques_inside_of_the_range_of_a_rate_are_attained():
    """tau_1 = M_11 qdd_1 + M_12 qdd_2 - a (2 v1 v2 + v2^2), a = M2 L1 C2 sin q2, where v2 = -v1 is not at its end."""
    model = replace(planar([M1, M2], [L1, 0.5], [C1, C2], [I1, I2]), gravity=np.zeros(3))
    found = rne.Robot(model).bounds(([0, 1.5], [0, 1.5]), rates=[1.0, 3.0], accelerations=0.0, quantities=["torque"])
    a = M2 * L1 * C2 * np.sin(1.5)
    np.testing.assert_allclose(found.torque.attained, [a * (2 * 3.0 + 9.0), a], rtol=1e-9)  # at corners
    criterion = torque_criteria(
        RobotPolynomials(rne.Robot(model).kernels, "circle"), np.array([2.0, 1.0]), np.zeros(2)
    )[0]
    forms = np.array([[0.0, 2.0, -1.0], [3.0, 1.0, -2.0], [-1.0, 0.5, -1.0]])  # of v1^2, v1 v2, v2^2
    grid = np.linspace([-2.0, -1.0], [2.0, 1.0], 401).T
    v1, v2 = np.meshgrid(*grid, indexing="ij")
    largest_values = [(c[0] * v1**2 + c[1] * v1 * v2 + c[2] * v2**2).max() for c in forms]
    np.testing.assert_allclose(
        criterion._largest_form(forms), largest_values, atol=1e-3
    )  # two sweeps, steps of the grid


def test_no_torque_of_a_state_is_proven_not_to_be_reached():
    """A target holds at no state whose torque exceeds it by 1e-9 of it, far more than rounding."""
    model = replace(planar([M1, M2], [L1, 0.5], [C1, C2], [I1, I2]), gravity=np.array([0, -1.0, 0]))
    criteria = torque_criteria(RobotPolynomials(rne.Robot(model).kernels, "circle"), np.array([3.0, 2.0]), np.zeros(2))
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (100, 2))
    for criterion in criteria:
        values = criterion.values(q)
        for target in np.quantile(values, [0.1, 0.5, 0.9]):
            assert not criterion.holds(q, target, 0.0)[values > target * (1 + 1e-9)].any()
        assert criterion.holds(q, 100.0 * values.max(), 0.0).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"positions": "all"}, r'`positions` must be "circle", "limits" or \(lower, upper\), got \'all\''),
        ({"positions": ([0] * 6, [-1] * 6)}, r"`positions` must have lower <= upper"),
        (
            {"quantities": ["inertia"]},
            r"`quantities` must be a list of some of \['gravity_torque', .*\], got \['inertia'\]",
        ),
        ({"quantities": ["torque"]}, r"bounds of torques need `rates` and `accelerations`"),
        ({"rates": [-1] * 6}, r"`rates` must not be negative"),
        ({"quantities": ["point_speed"]}, r"bounds of the speed of a point need its `link`, and `rates` where not all"),
        ({"quantities": ["point_speed"], "link": "hand"}, r"`link` must be one of \['base_link', .*\], got 'hand'"),
        ({"quantities": ["point_speed"], "link": "base_link", "rates": 1}, r"a link that moves, got 'base_link'"),
        ({"point": [0, 0, 0.1]}, r"^`point` is one of a link: give its `link`$"),
        ({"link": "tool0", "point": [1, 2]}, r"`point` must have shape \(3,\)"),
        ({"payload": (3, 1)}, r"`payload` must be the least and the largest mass in kg, got \(3, 1\)"),
        (
            {"masses": {"base_link": (1, 2)}},
            r"must name links that move and have a mass, got 'base_link'; they are \['link_1'",
        ),
        ({"masses": {3: (1, 2)}}, r"`masses` must name links that move and have a mass, got 3; they are \['link_1'"),
        ({"masses": {"link_2": 3}}, r"`masses\['link_2'\]` must be the least and the largest mass in kg, got 3"),
        (
            {"masses": {"link_6": (1, 2), "tool0": (1, 2)}},
            r"each body once: 'tool0' is fixed to another link of `masses`",
        ),
        (
            {"masses": [1]},
            r"`masses` must be a dict of two masses for each link, such as \{'tool0': \(1.0, 2.0\)\}, got \[1\]",
        ),
        ({"payload": 3}, r"`payload` must be the least and the largest mass in kg, got 3"),
        ({"positions": 3}, r'`positions` must be "circle", "limits" or \(lower, upper\), got 3'),
        ({"quantities": "torque"}, r"`quantities` must be a list of some of \[.*\], got 'torque'"),
        ({"quantities": 3}, r"`quantities` must be a list of some of \[.*\], got 3"),
        ({"quantities": []}, r"`quantities` must be a list of some of \[.*\], got \[\]"),
        ({"seconds": 0}, r"`seconds` must be positive, got 0.0"),
        ({"tolerance": 0}, r"`tolerance` must"),
    ],
)
def test_errors_name_what_is_wrong(irb140, options, message):
    with pytest.raises(ValueError, match=message):
        irb140.bounds(**options)


def test_bounds_of_too_many_joints_name_those_to_lock(monkeypatch):
    monkeypatch.setattr("rne.bounds.polynomials.MOST_SAMPLES", 20)
    text = (
        "^bounds of gravity_torque need 3\\^3 samples, one factor for each of the joints \\['joint0', 'joint1', 'joint2'\\]; "
        "lock those that do not matter \\(Robot.locked\\)$"
    )
    with pytest.raises(ValueError, match=text):
        rne.Robot(straight_chain(3)).bounds(quantities=["gravity_torque"])


def test_a_payload_of_a_branched_robot_is_refused_with_the_cure():
    body = {"mass": 1.0, "inertia": np.eye(3), "axis": np.array([0, 1.0, 0]), "kind": "revolute", "parent": 0}
    robot = rne.Robot(assemble("fork", [Part(link="base"), *(Part(link=x, joint=f"to {x}", **body) for x in "ab")]))
    text = (
        "`payload` needs one last link at whose end it is: its moving joints branch; its leaf links are ['a', 'b'], "
        "others are in `link_names`; bound robot.with_payload(mass, link=...) with the least and with the largest mass"
    )
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        robot.bounds(payload=(0, 1))
