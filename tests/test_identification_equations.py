"""Fits of linear equations: compressed equations, weighted least squares, and physically consistent bodies."""

import re
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import eigvalsh
from scipy.signal import lfilter

import rne
from rne.basics.filters import low_pass
from rne.basics.inertia import dual_of_gradient, parameters_of_pseudo_inertia, pseudo_inertia
from rne.identification import Record, fit_bodies, regression
from rne.identification.fit.consistent import consistent_fit, expected_sizes, geometric_prior, model_prior
from rne.identification.fit.equations import correlation_time_of_residuals, equations, solve
from rne.identification.fit.least_squares import least_squares, with_correlation

from .helpers import first_joints, loaded
from .random_robots import straight_chain

SAME = 1e-11  # relative: another order of operations, condition below 100
SOLVED = 1e-6  # relative accuracy of the cone programme's solution
THREE_SIGMA = 0.9973


def problem(seed=0, samples=200, noise=(0.1, 2.0, 0.5), unknowns=7):
    """Equations of three joints with different noise."""
    rng = np.random.default_rng(seed)
    Y, x = rng.normal(size=(samples, len(noise), unknowns)), rng.normal(size=unknowns)
    return Y, Y @ x + rng.normal(size=(samples, len(noise))) * noise, x


def blocks(samples, count):
    return [slice(k * samples // count, (k + 1) * samples // count) for k in range(count)]


def compressed(Y, tau, count=4, used=None):
    return equations(Y, tau, np.ones(tau.shape, bool) if used is None else used, blocks(len(tau), count))


def test_residuals_of_any_values_are_those_of_the_rows():
    Y, tau, x = problem()
    used = np.random.default_rng(1).uniform(size=tau.shape) < 0.7
    rows = compressed(Y, tau, used=used)
    for values in (x, 3 * x, 0 * x):
        np.testing.assert_allclose(rows.residuals(values), (((Y @ values - tau) * used) ** 2).sum(0), rtol=SAME)
    np.testing.assert_array_equal(rows.rows.sum(0), used.sum(0))


def test_blocks_joints_and_other_unknowns():
    Y, tau, x = problem()
    rows = compressed(Y, tau)
    np.testing.assert_allclose(
        rows.of_blocks(np.array([1, 2])).residuals(x), ((Y[50:150] @ x - tau[50:150]) ** 2).sum(0), rtol=SAME
    )
    uneven = equations(Y, tau, np.ones(tau.shape, bool), [slice(0, 20), slice(20, 200)])
    np.testing.assert_array_equal(uneven.rows, [[20] * 3, [180] * 3])
    assert rows.of_joint(1).residuals(x) == pytest.approx(rows.residuals(x)[[1]], rel=SAME)
    E = np.random.default_rng(2).normal(size=(7, 4))
    np.testing.assert_allclose(rows.mapped(E).residuals(x[:4]), ((Y @ E @ x[:4] - tau) ** 2).sum(0), rtol=SAME)


def test_estimates_are_those_of_the_weighted_rows():
    Y, tau, _ = problem()
    fit = least_squares(compressed(Y, tau))
    A, b = Y / fit.sigma[:, None], tau / fit.sigma
    expected, _, _, singular = np.linalg.lstsq(A.reshape(-1, 7), b.ravel(), rcond=None)
    np.testing.assert_allclose(fit.values, expected, rtol=SAME)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(A.reshape(-1, 7).T @ A.reshape(-1, 7)), rtol=SAME)
    assert fit.condition == pytest.approx(singular[0] / singular[-1], rel=SAME)
    hat = A.reshape(-1, 7) @ np.linalg.pinv(A.reshape(-1, 7))
    freedom = len(tau) - np.diag(hat).reshape(-1, 3).sum(0)
    np.testing.assert_allclose(fit.sigma, np.sqrt(((Y @ fit.values - tau) ** 2).sum(0) / freedom), rtol=1e-5)


def test_truth_lies_within_three_standard_errors_as_often_as_it_should():
    inside, sigma = [], []
    for seed in range(200):
        Y, tau, x = problem(seed, samples=60)
        fit = least_squares(compressed(Y, tau))
        inside.append(np.abs(fit.values - x) <= 3 * fit.errors)
        sigma.append(fit.sigma)
    assert np.mean(inside) == pytest.approx(THREE_SIGMA, abs=0.005)  # 1400 cases: 3.6 binomial deviations
    np.testing.assert_allclose(np.mean(sigma, 0), (0.1, 2.0, 0.5), rtol=0.02)


@pytest.mark.parametrize(("ratio", "is_known"), [(1e-8, True), (1e-12, False)])
def test_columns_that_differ_by_rounding_are_one(ratio, is_known):
    Y, tau, _ = problem(noise=(0.1,) * 3)
    Y[..., 5] = Y[..., 4] + ratio * Y[..., 5]
    fit = least_squares(compressed(Y, tau))
    assert np.isfinite(fit.errors[4:6]).all() == np.isfinite(fit.scaled_condition) == is_known


@pytest.mark.parametrize("unit", [1.0, 1e6])
def test_what_the_motion_says_nothing_of_has_an_infinite_error(unit):
    Y, tau, _ = problem(noise=(0.1,) * 3)
    Y = unit * Y
    Y[..., 2] = 0
    Y[..., 5] = 2 * Y[..., 4]
    fit = least_squares(compressed(Y, tau))
    np.testing.assert_array_equal(np.isinf(fit.errors), [False, False, True, False, True, True, False])
    assert fit.condition == np.inf
    assert np.isfinite(fit.values).all()


def test_equations_without_noise():
    Y, tau, x = problem(noise=(0.0,) * 3)
    fit = least_squares(compressed(Y, tau))
    np.testing.assert_allclose(fit.values, x, rtol=SAME)
    assert (fit.errors < 1e-11).all()


def arm_problem(seed=0, samples=60, noise=0.5, drives=2):
    """Torques of the IRB 140 with some parameters of drives, the equations weighted."""
    robot, rng = loaded("irb140"), np.random.default_rng(seed)
    q, qd, qdd = rng.uniform(-1, 1, (3, samples, 6)) * np.array([[[2.0]], [[2.0]], [[8.0]]])
    Y = np.concatenate([robot.regressor(q, qd, qdd), rng.normal(size=(samples, 6, drives))], axis=-1)
    x = np.concatenate([robot.parameters, np.linspace(1, 2, drives)])
    tau = Y @ x + noise * rng.normal(size=(samples, 6))
    return robot, compressed(Y, tau, 1).weighted(np.full(6, max(noise, 1e-3))), x


BOTH = np.ones(2, bool)


@pytest.mark.parametrize("weight", [0.1, 10.0, 1000.0])
def test_consistent_fit_is_a_minimum(weight):
    """The slope of the objective by every parameter vanishes; that of log det P is P^-1."""
    robot, factor, _ = arm_problem()
    prior = geometric_prior(robot.model) * 80
    found = consistent_fit(factor, prior, weight, BOTH, np.ones(2))
    R, b = factor[:, :-1], factor[:, -1]
    slope = R.T @ (R @ found - b)
    P = pseudo_inertia(found[:60])
    assert (np.linalg.eigvalsh(P) > 0).all()
    from_prior = weight * (np.linalg.inv(prior) - np.linalg.inv(P))
    L = np.linalg.cholesky(P)  # in terms of the bodies themselves, whose scales differ
    total = np.swapaxes(L, 1, 2) @ (dual_of_gradient(slope[:60]) + from_prior) @ L
    assert np.abs(total).max() <= 1e-4 * weight + SOLVED * np.abs(b).max()
    assert (np.abs(slope[60:]) <= 1e-4 * np.abs(R[:, 60:]).max() * np.linalg.norm(b)).all()


def test_without_measurements_the_bodies_are_those_of_the_prior(capfd):
    """And nothing is printed."""
    robot = loaded("ur5")
    prior, changed = model_prior(robot)
    assert changed == ()
    found = consistent_fit(np.zeros((63, 63)), prior, 1.0, BOTH, np.ones(2))
    np.testing.assert_allclose(pseudo_inertia(found[:60]), pseudo_inertia(robot.parameters), atol=SOLVED)
    assert capfd.readouterr() == ("", "")


def test_friction_is_not_negative():
    """The torques ask for -3 of it."""
    _, factor, x = arm_problem(noise=0.1, samples=200)
    factor[:, -1] -= 5 * factor[:, -2]
    robot = loaded("irb140")
    found = consistent_fit(factor, model_prior(robot)[0], 1.0, BOTH, np.ones(2))
    assert found[-1] == pytest.approx(0, abs=1e-6)
    free = consistent_fit(factor, model_prior(robot)[0], 1.0, np.array([True, False]), np.ones(2))
    assert free[-1] == pytest.approx(x[-1] - 5, abs=0.02)


def test_equations_that_say_nothing_change_no_body():
    robot, factor, _ = arm_problem()
    prior = model_prior(robot)[0]
    more = np.concatenate([factor[:-1], np.zeros((5, factor.shape[1])), factor[-1:]])
    found, same = (consistent_fit(x, prior, 1.0, BOTH, np.ones(2)) for x in (factor, more))
    np.testing.assert_allclose(same, found, atol=SOLVED * np.abs(found).max())


def test_units_of_length_do_not_matter():
    """In millimetres second moments are a million times larger, and the fit is the same."""
    robot, factor, _ = arm_problem()
    prior = model_prior(robot)[0] * 1.3
    unit = np.concatenate([np.tile([1, *[1e3] * 3, *[1e6] * 6], 6), [1, 1]])
    scale = np.array([1e3, 1e3, 1e3, 1])
    scaled = consistent_fit(factor / np.append(unit, 1), prior * np.outer(scale, scale), 1.0, BOTH, np.ones(2))
    found = consistent_fit(factor, prior, 1.0, BOTH, np.ones(2))
    P, Q = pseudo_inertia(found[:60]), pseudo_inertia((scaled / unit)[:60])
    L = np.linalg.inv(np.linalg.cholesky(P))
    np.testing.assert_allclose(L @ Q @ np.swapaxes(L, 1, 2), np.broadcast_to(np.eye(4), P.shape), atol=1e-4)


@pytest.mark.parametrize("inertia", [(0, 0, 0), (0.1, 0.1, 0.5)], ids=["point mass", "impossible"])
def test_bodies_that_are_too_thin_are_made_thicker(inertia):
    """Point masses on massless rods, as textbooks have them; and a moment of inertia above the sum of the others."""
    model = loaded("ur5").model
    rows = np.array(loaded("ur5").parameters).reshape(6, 10)
    rows[2] = [5, 0, 0, 0, inertia[0], 0, inertia[1], 0, 0, inertia[2]]
    prior, changed = model_prior(rne.Robot(rne.model.with_parameters(model, rows.ravel())))
    assert changed == (model.moving_joints[2],)
    rod = geometric_prior(model)[2]
    given, thick = (eigvalsh(P[2], rod / rod[3, 3] * 5)[0] for P in (pseudo_inertia(rows.ravel()), prior))
    assert thick == pytest.approx(0.01)  # in its thinnest direction, of a rod of its mass
    assert prior[2, 3, 3] == pytest.approx((1 + 0.01 - given) * 5)


def test_a_body_is_thin_beside_a_rod_of_its_own_mass():
    """However much lighter than the other bodies it is."""
    model, rows = loaded("ur5").model, np.array(loaded("ur5").parameters).reshape(6, 10)
    rows[2] *= 1e-6
    prior, changed = model_prior(rne.Robot(rne.model.with_parameters(model, rows.ravel())))
    assert changed == ()
    np.testing.assert_allclose(prior, pseudo_inertia(rows.ravel()), rtol=SAME)


def test_expected_sizes_are_those_of_the_bodies_and_of_a_tenth_of_the_torque():
    robot, rng = loaded("irb140"), np.random.default_rng(0)
    base = robot.base_parameters(drives=rne.DriveModel(friction="viscous"))
    q, qd, qdd = rng.uniform(-1, 1, (3, 60, 6))
    Y = np.concatenate([robot.regressor(q, qd, qdd), base.standard.drive_columns(qd, qdd)], axis=-1)
    tau, P = robot.inverse_dynamics(q, qd, qdd), pseudo_inertia(robot.parameters)
    sizes, larger = (expected_sizes(k * P, base, compressed(Y, tau)) for k in (1, 4))
    drives = np.array(base.independent) >= 60
    np.testing.assert_allclose(larger[~drives], 4 * sizes[~drives])
    np.testing.assert_allclose(sizes[drives], 0.1 * np.linalg.norm(tau, axis=0) / np.linalg.norm(qd, axis=0))


def test_guess_of_bodies_has_a_total_mass_of_one():
    for name in ("irb140", "panda", "ur5"):
        model = rne.load(name).model
        guess = geometric_prior(model)
        assert guess[:, 3, 3].sum() == pytest.approx(1)
        assert (np.linalg.eigvalsh(guess) > 0).all()


def test_a_guessed_body_scatters_across_its_length_by_a_fifth_of_it():
    """The standard deviation of its mass, and that of a uniform rod along it besides."""
    guess = geometric_prior(straight_chain(2, length=0.7))[0]
    mean = guess[:3, 3] / guess[3, 3]
    variances = np.linalg.eigvalsh(guess[:3, :3] / guess[3, 3] - np.outer(mean, mean))
    np.testing.assert_allclose(variances, 0.7**2 * np.array([0.2**2, 0.2**2, 0.2**2 + 1 / 12]), rtol=1e-12)


def test_without_clarabel_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "clarabel", None)
    robot, factor, _ = arm_problem()
    text = "the physically consistent fit needs Clarabel, which is not installed: pip install 'rne[identify]'"
    with pytest.raises(ImportError, match=f"^{re.escape(text)}$"):
        consistent_fit(factor, model_prior(robot)[0], 1.0, BOTH, np.ones(2))


def test_a_body_is_felt_that_is_not_felt_at_every_sample(monkeypatch):
    """In the middle of the motion the joints stand still: their columns but gravity's are zero there."""
    robot = first_joints(2)
    base = robot.base_parameters(drives=rne.DriveModel())
    t = np.arange(400) / 100
    q = np.sin(np.outer(t, [2.0, 3.0]))
    prepared = Record(t, q, q).prepare(5.0)
    moves = np.abs(prepared.t - 2)[:, None] > 0.1
    still = replace(prepared, qd=prepared.qd * moves, qdd=prepared.qdd * moves)
    monkeypatch.setattr(Record, "prepare", lambda *_: still)
    Y = regression(robot, Record(t, q, q), base).Y
    expected = still.reduce(robot.inverse_dynamics(still.q, still.qd, still.qdd))
    np.testing.assert_allclose(Y @ base.standard.values, expected, atol=SAME * np.abs(expected).max())


def test_correlated_residuals_count_as_fewer():
    """A first-order process x_k = r x_(k-1) + noise has 1 + 2 sum r^k = (1 + r) / (1 - r)."""
    rng = np.random.default_rng(0)
    parts = [
        np.stack([lfilter([1], [1, -0.5], rng.normal(size=20000)), rng.normal(size=20000)], axis=1) for _ in range(2)
    ]
    x = np.concatenate(parts)
    used = rng.uniform(size=x.shape) < 0.9
    found = correlation_time_of_residuals(x, used, [slice(0, 20000), slice(20000, 40000)])
    assert found == pytest.approx([3.0, 1.0], rel=0.1)


def test_residuals_that_are_all_equal_count_as_one():
    found = correlation_time_of_residuals(np.ones((8, 1)), np.ones((8, 1), bool), [slice(0, 8)])
    assert found == pytest.approx([8.0])


@pytest.mark.parametrize("decimation", [1, 10, 20])
def test_filtered_noise_counts_as_fewer(decimation):
    """The variance of the mean of filtered white noise is that of its rows over the effective sample size."""
    rate, cutoff = 500.0, 10.0
    noise = low_pass(np.random.default_rng(0).normal(size=(2000, 400)), cutoff, rate)[250:-250:decimation]
    measured = noise.mean(0).var() * len(noise) / noise.var()
    t, robot = np.arange(1000) / rate, first_joints(2)
    record = Record(t, np.sin(np.outer(t, [6.0, 9.0])), np.cos(np.outer(t, [6.0, 9.0])))
    data = regression(robot, record, robot.base_parameters(), cutoff=cutoff)
    prepared = replace(data.prepared[0], decimation=decimation)
    none = np.zeros((len(prepared.times), 2))  # of no residuals it is the filter's
    found = replace(data, prepared=(prepared,)).correlation_time(none, none == 0)
    np.testing.assert_allclose(found, measured, rtol=0.2)


def test_standard_errors_of_correlated_residuals_are_the_sandwich():
    Y, tau, _ = problem(samples=80)
    rows, correlation_time = compressed(Y, tau), np.array([1.0, 3.0, 5.0])
    fit = least_squares(rows)
    A = (Y / fit.sigma[:, None]).reshape(-1, 7)
    bread = np.linalg.inv(A.T @ A)
    expected = bread @ A.T @ np.diag(np.tile(correlation_time, 80)) @ A @ bread
    found = with_correlation(fit, rows, correlation_time)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-9)
    np.testing.assert_allclose(found.errors, np.sqrt(np.diag(expected)), rtol=1e-9)


def test_a_joint_with_hardly_more_equations_than_unknowns_gets_no_weight_from_them():
    """Its residual is zero by construction, which is no sign of exactness."""
    Y, tau, x = problem(noise=(0.1, 0.1, 0.1), unknowns=6)
    Y[:, 2, :3] = 0
    used = np.ones(tau.shape, bool)
    used[3:, 2] = False
    Y[:, :2, 3:] = 0
    fit = least_squares(compressed(Y, tau, 1, used))
    assert fit.sigma[2] > 0.1
    assert np.abs(fit.values[:3] - x[:3]).max() < 5 * fit.errors[:3].max()


ENDS = {
    "far": lambda y: -np.ones_like(y),
    "outside": lambda y: np.append(0 * y[:-2], y[-2:]),
    "nan": lambda y: y * np.nan,
}


@pytest.mark.parametrize("end", ENDS.values(), ids=ENDS)
def test_the_consistent_fit_does_not_depend_on_how_the_cone_solver_ends(end, monkeypatch):
    """Newton's method begins nearby where a body is not quite possible, and at the prior where the end says nothing."""
    from rne.identification.fit import consistent

    rng = np.random.default_rng(3)
    prior = geometric_prior(loaded("irb140").model)[:2] * 10
    rows = rng.normal(size=(60, 22))
    truth = np.append(parameters_of_pseudo_inertia(1.3 * prior), [0.5, 0.2])
    factor = np.linalg.qr(np.column_stack([rows, rows @ truth + 0.01 * rng.normal(size=60)]), mode="r")
    given = (factor, prior, 1e-3, np.array([True, True]), np.ones(2))
    expected = consistent_fit(*given)
    solve = consistent.cone_solution
    monkeypatch.setattr(consistent, "cone_solution", lambda *a: (end(solve(*a)[0]), "InsufficientProgress"))
    np.testing.assert_allclose(consistent_fit(*given), expected, rtol=1e-6, atol=1e-9)


def test_what_is_not_fitted_is_exactly_as_given(monkeypatch):
    """Whatever last digits the solvers leave: another processor is one whose sums end in 1e-20."""
    from rne.identification.fit import consistent

    exact, cones = np.linalg.lstsq, consistent.cone_solution
    monkeypatch.setattr(consistent, "cone_solution", lambda *args: (cones(*args)[0] + 1e-4, "Solved"))
    monkeypatch.setattr(np.linalg, "lstsq", lambda *args, **how: (exact(*args, **how)[0] - 1e-20, None))
    robot, rng = first_joints(2).with_armature([0.3, 0.4]), np.random.default_rng(4)
    drives = rne.DriveModel(rotor=True, friction={"joint_2": "viscous+coulomb"}, stribeck=[0, 0.1])
    base = robot.base_parameters(drives=drives)
    q, qd, qdd = rng.normal(size=(3, 80, 2))
    qd[:, 0] = qdd[:, 0] = 0  # of a joint that does not move, the rotor is as given
    Y = np.concatenate([robot.regressor(q, qd, qdd), base.standard.drive_columns(qd, qdd)], axis=-1)
    x = base.standard.values + np.isin(base.standard.names, ["Fv_2", "Fc_2", "Fs_2"])
    tau = Y @ x + 0.01 * rng.normal(size=qd.shape)
    found = fit_bodies(base, SimpleNamespace(fitted=compressed(Y, tau)), prior=robot, prior_std=10**-0.5).parameters
    of = dict(zip(base.standard.names, found, strict=True))
    assert (of["Ia_1"], of["Fv_1"], of["Fc_1"], of["Fs_1"]) == (0.3, 0, 0, 0)
    np.testing.assert_allclose([of["Fv_2"], of["Fc_2"], of["Fs_2"]], 1, atol=0.05)  # noise of 80 samples


@pytest.mark.parametrize("apart", [1.0, 1e-4, 1e-7, 0.0])
def test_solutions_are_those_of_least_squares_whether_columns_are_nearly_dependent_or_not(apart):
    """x and its covariance; of columns that are one, the smallest x, in which neither is known."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(40, 4))
    A[:, 3] = A[:, 2] + apart * A[:, 3]
    b = A @ [1.0, 2, 3, 4] + 0.1 * rng.normal(size=40)
    found = solve(np.linalg.qr(np.column_stack([A, b]), mode="r"))
    lengths, rounding = np.linalg.norm(A, axis=0), 1e-12 / (apart or 1)
    inverse = np.linalg.pinv(A / lengths, rcond=1e-9) / lengths[:, None]
    covariance = inverse @ inverse.T
    np.testing.assert_allclose(found.x, inverse @ b, rtol=rounding)
    np.testing.assert_allclose(found.inverse @ found.inverse.T, covariance, atol=rounding * covariance.max())
    np.testing.assert_allclose(found.singular, np.linalg.svd(A / lengths, compute_uv=False), atol=1e-14)
    assert found.free.tolist() == [False, False, apart == 0, apart == 0]


def test_columns_that_are_dependent_beyond_their_diagonal_are_found():
    """Kahan 1966: entries of the diagonal are large, the smallest singular value is about 2^-40."""
    A = np.eye(40) - np.triu(np.ones((40, 40)), 1)
    found = solve(np.column_stack([np.vstack([A, np.zeros(40)]), np.ones(41)]))
    assert found.inverse.shape == (40, 39)
    assert found.free.any()
