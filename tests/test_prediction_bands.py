"""How sure predictions of an identified robot are: bands of torques, draws of parameters, printed programs."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

import rne
from benchmarks import prediction_bands
from benchmarks.measure import RESULTS
from benchmarks.pages import filled
from rne.basics.inertia import pseudo_inertia
from rne.identification import Record
from rne.identification.prediction import repeated

from .compiled_sources import c_library, call
from .helpers import archived, first_joints
from .measurements import fourier_series

RATE, NOISE = 100.0, np.array([0.6, 0.8, 0.3])  # samples per second, deviation of each torque [N m]
FRICTION = rne.Friction(viscous=[3.0, 4.0, 2.0], coulomb=[4.0, 5.0, 2.0], smoothing=0.003)


def log(seed, *, duration=10.0, scale=1.0, still=(), base=0.2, load=None, units=1.0, friction=FRICTION):
    """A motion of the IRB 140's first three axes with friction and white noise; joints that are `still` rest at zero."""
    rng, t = np.random.default_rng(seed), np.arange(int(duration * RATE)) / RATE
    a, b = scale * rng.normal(size=(2, 3, 5)) * 0.5
    a[list(still)] = b[list(still)] = 0.0
    q, qd, qdd = fourier_series(t, base, a, b)
    tau = rne.Scene(first_joints(), payload=load, friction=friction).inverse_dynamics(q, qd, qdd)
    return (q, qd, qdd), Record(t, q, units * (tau + NOISE * rng.normal(size=tau.shape)))


@pytest.fixture(scope="module")
def found():
    return rne.identify(first_joints(), log(0)[1], causes=False)


def coverage(check):
    """Share of the torques of each joint that are within the 95 % band, and the number of independent ones."""
    within = np.abs(check.measured - check.predicted) <= norm.ppf(0.975) * check.std
    return np.array([within[check.valid[:, j], j].mean() for j in range(within.shape[1])])


def test_the_variance_is_that_of_parameters_and_of_residuals(found):
    """From the covariance of parameters by finite differences of the torques, and the same residuals in every state."""
    (q, qd, qdd), _ = log(1, duration=2.0)
    qd[::10] = 0.0
    torques, std = found.predict(q, qd, qdd, std=True)
    np.testing.assert_array_equal(torques, found.predict(q, qd, qdd))
    columns = []
    for k in found.base.independent:  # torques are linear in the parameters
        one = found.parameters + np.eye(len(found.parameters))[k]
        columns.append(replaced(found, one).predict(q, qd, qdd) - torques)
    y = np.stack(columns, -1)
    of_parameters = np.einsum("tjk,kl,tjl->tj", y, found.estimate.covariance, y)
    moving = np.abs(qd) > found.minimum_velocity
    for j in range(3):
        rest = std[:, j] ** 2 - of_parameters[:, j]
        for part in (moving[:, j], ~moving[:, j]):
            np.testing.assert_allclose(rest[part], rest[part][:1].repeat(part.sum()), rtol=1e-6)
        assert rest[~moving[:, j]].min() > FRICTION.coulomb[j] ** 2 / 2 > 10 * rest[moving[:, j]].max()


def replaced(found, parameters):
    """The identification with other parameters, and the smoothing that it predicts with."""
    return replace(found, standard=found._law, parameters=parameters)


def test_bands_cover_another_motion(found):
    """Of nearly independent rows: the share is within four standard errors of 95 %."""
    check = found.check(log(2)[1])
    share = coverage(check)
    few = np.sqrt(0.95 * 0.05 / (len(check.t) / found.correlation_time))
    assert (np.abs(share - 0.95) < 4 * few).all()


def test_bands_at_rest_contain_all_friction_with_which_a_joint_breaks_away():
    """Held at rest, friction has any value up to that of Coulomb, the Stribeck effect and the load together."""
    friction = replace(FRICTION, stribeck_rise=[6.0, 7.0, 3.0], stribeck=[0.1, 0.1, 0.1], load=[0.1, 0.15, 0.2])
    robot, (motion, record) = first_joints(), log(0, friction=friction)
    drives = rne.DriveModel(friction="viscous+coulomb+load", stribeck=friction.stribeck)
    found = rne.identify(robot, record, drives=drives, causes=False, delay=0.0, consistent=False)
    rng, q = np.random.default_rng(1), motion[0][::5]
    held, zero = robot.gravity_torque(q), np.zeros(q.shape)
    breakaway = np.array(friction.coulomb) + friction.stribeck_rise + np.array(friction.load) * np.abs(held)
    predicted, std = found.predict(q, zero, zero, std=True)
    for part in (1.0, rng.uniform(-1, 1, q.shape)):
        off = held + part * breakaway + NOISE * rng.normal(size=q.shape) - predicted
        assert (np.abs(off) <= norm.ppf(0.975) * std).mean(0).min() > 0.95
    in_motion = found.bands.std(columns_at(found, q, zero), np.full(q.shape, np.inf))
    np.testing.assert_allclose(std**2 - in_motion**2, breakaway**2, rtol=0.2)  # errors of the coefficients: 5 %
    kernel = found.kernel(std=True)(q, zero, zero)
    np.testing.assert_allclose(kernel[:, 1], std, rtol=1e-12)


def columns_at(found, q, zero):
    """Torques per unit of the standard parameters at rest."""
    law, Y = found._law, found.initial.regressor(q, zero, zero)
    return np.concatenate([Y, law.drive_columns(zero, zero, law.load(Y, q, zero, found.parameters))], axis=-1)


def test_torques_that_depend_on_what_the_log_says_nothing_of_have_no_finite_deviation():
    """The third axis rests in the log: its torque is not known, those of the others are while it rests."""
    found = rne.identify(first_joints(), log(0, still=[2])[1], causes=False, consistent=False)
    (q, qd, qdd), _ = log(1, duration=4.0)
    _, std = found.predict(q, qd, qdd, std=True)
    assert np.isinf(std).any(0).tolist() == [True, True, True]
    assert np.isinf(std[:, 2]).all()
    resting = found.check(log(3, still=[2])[1]).std
    assert np.isfinite(resting).all(0).tolist() == [True, True, False]
    text = (
        "the log does not determine all parameters, and deviations may be infinite: Move all joints farther and faster: "
        "`rne.excitation` finds a motion"
    )
    with pytest.raises(rne.IdentificationError, match=f"^{re.escape(text)}$"):
        found.kernel(std=True)


def test_draws_are_possible_bodies_that_scatter_as_the_standard_errors_say(found):
    """Base parameters about those found, at most as far as least squares leave them; drives as these; mean as found."""
    count = 100
    draws = found.draws(count)
    assert draws["parameters"].shape == (count, 30)
    assert np.linalg.eigvalsh(pseudo_inertia(draws["parameters"])).min() > 0
    names, errors, n = found.base.names, found.estimate.errors, 3
    for symbol, name in (("Fv", "viscous"), ("Fc", "coulomb")):
        of_drives = [names.index(f"{symbol}_{j + 1}") for j in range(n)]
        x = draws[f"friction.{name}"]
        np.testing.assert_allclose(x.std(0), errors[of_drives], rtol=5 / np.sqrt(2 * count))  # five standard errors
        assert (np.abs(x.mean(0) - found.values[of_drives]) < 5 * errors[of_drives] / np.sqrt(count)).all()
    bodies = [k for k in range(len(names)) if found.base.independent[k] < 30]
    values = (draws["parameters"] @ found.base.matrix[:, :30].T)[:, bodies]
    assert (values.std(0) < errors[bodies] * (1 + 5 / np.sqrt(2 * count))).all()
    assert (values.std(0) > 0.2 * errors[bodies]).all()
    assert (np.abs(values.mean(0) - found.values[bodies]) < 5 * errors[bodies] / np.sqrt(count)).all()
    np.testing.assert_array_equal(found.draws(3)["parameters"], found.draws(3, seed=0)["parameters"])


def test_an_ensemble_of_draws_is_of_the_scenes_with_these_numbers(found):
    scene, draws = found.scene(), found.draws(2, seed=1)
    np.testing.assert_array_equal(draws["friction.viscous"], draws["friction.viscous_back"])  # as they are fitted
    start = np.array([0.3, -0.2, 0.5]), np.array([0.5, -0.4, 0.2])  # of either direction
    run = rne.ensemble(scene, *(np.tile(x, (2, 1)) for x in start), duration=0.05, numbers=draws)
    for k in range(2):
        numbers = {name: x[k] for name, x in draws.items()}
        one = rne.simulate(scene.with_numbers(numbers), *start, duration=0.05)
        np.testing.assert_allclose(run.q[-1, k], one.q[-1], atol=1e-6)  # the tolerance of the solver


def test_least_squares_that_are_no_bodies_have_no_draws():
    light = first_joints().with_parameters(0.1 * first_joints().parameters)
    found = rne.identify(light, log(0)[1], causes=False, consistent=False)
    with pytest.raises(rne.IdentificationError, match=r"fit with `consistent=True`"):
        found.draws(1)


def test_draws_of_a_load_are_bodies_that_scatter_as_its_standard_errors_say():
    load, count = rne.Payload(5.0, com=[0.1, 0.05, 0.1], inertia=0.2 * np.eye(3)), 200
    found = rne.identify_payload(first_joints(), log(0)[1], log(1, load=load)[1])
    scene, phi = rne.Scene(first_joints(), payload=found), found.draws(count)["payload"]
    assert phi.shape == (count, *scene.numbers["payload"].shape)
    assert np.linalg.eigvalsh(pseudo_inertia(phi)).min() > 0
    assert phi[:, 0].std() < found.mass_error * (1 + 5 / np.sqrt(2 * count))
    assert abs(phi[:, 0].mean() - found.mass) < 5 * found.mass_error / np.sqrt(count)
    own = found.estimate.covariance[-10:, -10:]  # of a load that is told whole: mass and moments are correlated
    white = np.linalg.solve(np.linalg.cholesky(own), (phi - found.estimate.values[-10:]).T)
    np.testing.assert_allclose(np.cov(white), np.eye(10), atol=5 * np.sqrt(2 / count))


def test_draws_of_gains_scatter_as_their_standard_errors_say():
    load, count = rne.Payload(5.0, com=[0.1, 0.05, 0.1]), 400
    gains = rne.identify_drive_gains(first_joints(), log(0, units=0.2)[1], log(1, load=load, units=0.2)[1], load)
    draws, told = gains.draws(count), np.isfinite(gains.gains)
    assert told.any()
    assert (np.isfinite(draws) == told).all()
    np.testing.assert_allclose(draws.std(0)[told], gains.errors[told], rtol=5 / np.sqrt(2 * count))
    assert (np.abs(draws.mean(0) - gains.gains)[told] < 5 * gains.errors[told] / np.sqrt(count)).all()


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler here")
def test_printed_c_gives_torques_and_deviations(found, tmp_path):
    """The same numbers to 1e-12 of the largest of a joint: some hundred operations' rounding."""
    (q, qd, qdd), _ = log(1, duration=0.2)
    qd[::3] = 0.0
    kernel = found.kernel(std=True)
    program = c_library([kernel.source("c")], tmp_path)[kernel.quantity.name]
    expected = np.stack(found.predict(q, qd, qdd, std=True), axis=1)
    printed = call(program, (q, qd, qdd), 6, "float64").reshape(-1, 2, 3)
    np.testing.assert_allclose(printed / np.abs(expected).max(0), expected / np.abs(expected).max(0), atol=1e-12)
    np.testing.assert_allclose(found.kernel()(q, qd, qdd), expected[:, 0], rtol=1e-12, atol=1e-12)


def test_the_page_has_the_tables_of_the_results():
    """After a new run: python -m benchmarks.prediction_bands --public FOLDER."""
    found = json.loads((RESULTS / "prediction_bands.json").read_text(encoding="utf-8"))
    text = prediction_bands.PAGE.read_text(encoding="utf-8")
    assert filled(text, prediction_bands.tables(found)) == text


def test_one_draw_is_a_draw(found):
    one, two = found.draws(1), found.draws(2)
    assert one.keys() == two.keys()
    assert one["parameters"].shape == (1, 30)


def test_bodies_that_are_not_possible_give_no_draws(found):
    """A body with I_xx = 10, I_yy = I_zz = 1, which turns as a body may, but which no distribution of mass has."""
    parameters = found.parameters.copy()
    parameters[20:30] = [1.0, 0.0, 0.0, 0.0, 10.0, 0.0, 1.0, 0.0, 0.0, 1.0]
    with pytest.raises(rne.IdentificationError, match="the bodies found are no possible ones"):
        replaced(found, parameters).draws(3)


def test_bodies_that_hardly_any_trial_makes_possible_give_no_draws():
    """A slow short log under a prior that says little; one that says more gives them, as the error proposes."""
    found = rne.identify(
        first_joints(),
        log(0, scale=0.2, duration=2.0)[1],
        causes=False,
        drives=rne.DriveModel(friction="viscous+coulomb"),
    )
    assert found.draws(2)["parameters"].shape == (2, 30)
    text = r"only 0 % of the trials give possible bodies: excite the motion more, or fit with a smaller `prior_std`"
    with pytest.raises(rne.IdentificationError, match=f"^{text}$"):
        replace(found, prior_std=100.0).draws(2)


def test_a_log_of_which_nothing_was_left_out_says_nothing_of_other_motions(found):
    silent = replace(found.bands, largest=np.full(3, np.nan))
    text = "the error of predictions for another motion is unknown: no block of the log was left out of a fit"
    assert silent.text(found.initial.joint_names, ["N m"] * 3) == text


def test_what_is_no_record_is_not_checked(found):
    with pytest.raises(TypeError, match=r"^`record` must be an rne\.identification\.Record, got str$"):
        found.check("log.csv")


def test_draws_of_a_file_without_the_prior_say_what_they_take(found, tmp_path):
    """As files were saved before the prior's deviation was kept."""
    arrays, texts = archived(found.save(tmp_path / "found.npz"))
    del texts["value"]["fields"]["prior_std"]
    np.savez(tmp_path / "older.npz", **arrays, texts=np.array(json.dumps(texts)))
    read = rne.Identification.load(tmp_path / "older.npz")
    assert (found.prior_std, read.prior_std) == (0.3, None)
    text = "draws take a prior_std of 0.3: the file does not say that of the fit, which dataclasses.replace"
    with pytest.warns(rne.IdentificationWarning, match=re.escape(text)):
        draws = read.draws(2)
    np.testing.assert_array_equal(draws["parameters"], found.draws(2)["parameters"])


def test_deviations_of_states_that_share_a_position(found):
    (q, qd, qdd), _ = log(1, duration=0.2)
    for x, y in zip(found.predict(q[:1], qd, qdd, std=True), found.predict(q[0], qd, qdd, std=True), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-12)
        assert x.shape == qd.shape


def test_a_joint_that_only_trembles_makes_no_period_another_one():
    """Blocks of the same motion are left out together, whatever noise a joint at rest has."""
    again = []
    for noise in (0.0, 2e-5):
        t = np.arange(0, 12, 0.01)
        q = np.sin(2 * np.pi * np.outer(t, [0.25, 0.5, 0.75]))
        q[:, 0] = noise * np.random.default_rng(0).normal(size=len(t))
        prepared = Record(t, q, q).prepare(5.0)
        again.append(repeated([prepared], prepared.blocks(10)))
    np.testing.assert_array_equal(*again)
    assert again[0].sum() > 20


@pytest.mark.long
@pytest.mark.parametrize("linear", [True, False])
def test_bands_cover_other_motions_of_four_arms(linear):
    """93 to 97 % where the model is complete; with friction beyond it 90 %, or the report says that the model is wrong.

    One log of each arm: some 700 nearly independent torques, of which a share has a standard error below 1 %.
    """
    shares = []
    for k, arm in enumerate(prediction_bands.ARMS):
        found, check = prediction_bands.planted(arm, 100 + k, linear)
        shares.append(check.covered.mean())
        assert shares[-1] > 0.9 or "The model, not the noise" in found.report()
    assert 0.93 < np.mean(shares) < 0.97 or not linear


def test_joints_whose_validation_torques_leave_their_band_are_named(found):
    """Those with less than 90 % within it."""
    fault = (
        "The model, not the noise, is at fault where less than 90 % of the validation torques are within the 95 % band "
        "of parameters and noise, as with friction beyond the model: "
    )
    names, units = found.initial.joint_names, ["N m"] * 3
    shares = np.array([[0.91, 0.95, 0.91], [0.91, 0.89, 0.5]])
    good, poor = (replace(found.bands, covered=share).text(names, units) for share in shares)
    assert poor == f"{good}. {fault}joint_2 89 %, joint_3 50 %"
