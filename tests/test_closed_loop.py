"""Noise that the controller feeds back: what it does to least squares, and instrumental variables that it does not bias.

The arm is a simulation: a PD law with gravity compensation reads noisy positions, once each sample, and the log has
these positions and the torques that the law commanded.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import f

import rne
from rne.basics.filters import low_pass, settling
from rne.identification import Record
from rne.identification.diagnosis.rigid_body_test import certified
from rne.identification.fit.equations import equations
from rne.identification.fit.least_squares import bias_of_least_squares, least_squares, with_correlation

from .helpers import first_joints
from .measurements import fourier_series

VISCOUS = np.array([8.0, 6.0, 2.0])
BANDWIDTH = 15.0  # of the loop [rad/s]
COLOUR = 0.9  # of the noise, from sample to sample: of a few hertz, as the motion is
NOISY, QUIET = 5e-3, 2e-6  # of the positions [rad]
DRIVES = rne.DriveModel(friction="viscous")
TORQUE_NOISE = np.array([0.4, 1.4, 0.25])  # 1 % of the torques [N m]
ROUNDING = 1e-9  # relative: another order of operations, condition below 100
SIZE, RUNS = 0.05, 50
MOST_FALSE = 0.10  # of 50 runs; more than 5 of them by chance at a size of 5 %: 4 % of the time


def reference(t):
    """The motion to follow, up to 1.5 Hz."""
    a, b = np.random.default_rng(1).normal(size=(2, 3, 5)) * 1.5 / np.sqrt(5)
    return fourier_series(np.atleast_1d(t), 0.3, a, b)


class Loops(NamedTuple):
    """Logs of the same motion with different noise, shape (samples, runs, n)."""

    t: np.ndarray
    q: np.ndarray
    tau: np.ndarray

    def record(self, k, torque_noise=0.0):
        noise = torque_noise * np.random.default_rng(k).normal(size=self.tau[:, k].shape)
        return Record(self.t, self.q[:, k], self.tau[:, k] + noise)


def closed_loops(noise, runs, duration, rate):
    """Simulated logs of the loop; velocities are differences of the noisy positions."""
    robot, rng, h = first_joints(3), np.random.default_rng(0), 1 / rate
    t = np.arange(int(duration * rate)) * h
    q_ref, qd_ref, _ = reference(t)
    white = rng.normal(size=(len(t), runs, 3))
    errors = noise * np.sqrt(1 - COLOUR**2) * lfilter([1], [1, -COLOUR], white, axis=0)
    inertia = np.diag(robot.mass_matrix(np.zeros(3)))
    kp, kd = BANDWIDTH**2 * inertia, 1.4 * BANDWIDTH * inertia
    q, qd = (np.repeat(x[:1], runs, 0) for x in (q_ref, qd_ref))
    before, (logged, torques) = q + errors[0] - h * qd, np.empty((2, *errors.shape))
    for k in range(len(t)):
        logged[k] = q + errors[k]
        rate_error = (logged[k] - before) / h - qd_ref[k]
        torques[k] = robot.gravity_torque(logged[k]) - kp * (logged[k] - q_ref[k]) - kd * rate_error
        before = logged[k]
        q, qd = stepped(robot, q, qd, torques[k], h)
    return Loops(t, logged, torques)


def stepped(robot, q, qd, tau, h):
    """A step of the classical Runge-Kutta method with constant torque."""
    a = robot.forward_dynamics(q, qd, tau - VISCOUS * qd)
    slopes = [(qd, a)]
    for part in (h / 2, h / 2, h):
        v, a = slopes[-1]
        states = q + part * v, qd + part * a
        slopes.append((states[1], robot.forward_dynamics(*states, tau - VISCOUS * states[1])))
    weights = h / 6 * np.array([1, 2, 2, 1])
    return tuple(x + sum(w * s[i] for w, s in zip(weights, slopes, strict=True)) for i, x in enumerate((q, qd)))


def off(found):
    """Errors of both estimates over their standard errors: by instrumental variables, and by least squares."""
    truth = found.standard.values.copy()
    truth[found.standard.groups["Fv"]] = VISCOUS
    error = found.estimate.values - found.base.of(truth)
    return error / found.estimate.errors, (error + found.bias.shift) / found.bias.errors


def identified(record, **options):
    return rne.identify(first_joints(3), record, **({"drives": DRIVES, "consistent": False, "folds": 2} | options))


@pytest.fixture(scope="module")
def loops():
    """Three noisy runs."""
    return closed_loops(NOISY, 3, 10.0, 100.0)


@pytest.fixture(scope="module")
def found(loops):
    return [identified(loops.record(k), instruments=reference) for k in range(3)]


def test_noise_that_is_fed_back_biases_least_squares_but_not_instrumental_variables(found):
    errors, of_least_squares = np.swapaxes([off(x) for x in found], 0, 1)
    assert (np.abs(errors) < 3).all()
    assert (np.abs(of_least_squares).max(1) > 3).all()  # five in twice the time
    assert all(x.bias.probability < SIZE for x in found)
    k = found[0].base.names.index("Iyy_3")
    assert all(x.bias.shift[k] < -3 * x.bias.errors[k] for x in found)  # noise makes inertias smaller
    delays = [1e3 * x.delay[0, 0] for x in found]
    assert delays == pytest.approx([-5.0] * 3, abs=4.0)  # half a sample, as torques are held; three deviations


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::rne.IdentificationWarning")
@pytest.mark.parametrize("exact", [True, False])
def test_bias_and_test_in_50_runs(exact):
    """The motion that was asked for, or a simulation of the loop without noise."""
    quiet = closed_loops(0.0, 1, 20.0, 100.0).q[:, 0]
    motion = reference if exact else quiet
    loops = closed_loops(NOISY, RUNS, 20.0, 100.0)
    runs = [identified(loops.record(k), instruments=motion) for k in range(RUNS)]
    errors, of_least_squares = (np.abs(z).max(1) for z in np.swapaxes([off(x) for x in runs], 0, 1))
    assert np.mean((of_least_squares > 5) & (errors < 3)) >= 0.9
    assert all(x.bias.probability < SIZE for x in runs)
    loops = closed_loops(QUIET, RUNS, 20.0, 100.0)
    quiet_runs = [identified(loops.record(k, TORQUE_NOISE), instruments=motion) for k in range(RUNS)]
    assert np.mean([x.bias.probability < SIZE for x in quiet_runs]) <= MOST_FALSE
    z = np.array([off(x)[0] for x in quiet_runs])
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1, abs=0.15)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::rne.IdentificationWarning")
def test_least_squares_as_it_is_called_is_biased():
    """With its own cut-off, which is lower as what was held out asks for it, and delays: beyond three errors."""
    loops = closed_loops(NOISY, 5, 20.0, 100.0)
    for k in range(5):
        plain = identified(loops.record(k))
        truth = plain.standard.values.copy()
        truth[plain.standard.groups["Fv"]] = VISCOUS
        assert np.abs((plain.estimate.values - plain.base.of(truth)) / plain.estimate.errors).max() > 3


def test_noise_of_the_torques_alone_is_no_bias():
    """The same law for an exact motion: of 6 tests of 5 %, two or more say so by chance in 3 % of the cases."""
    robot, t = first_joints(3), np.arange(1000) / 100
    q, qd, qdd = reference(t)
    tau, said = robot.inverse_dynamics(q, qd, qdd) + VISCOUS * qd, 0
    q_late, *_ = reference(t - 0.01)  # as it lags behind what it follows
    for seed in range(6):
        noise = TORQUE_NOISE * np.random.default_rng(seed).normal(size=tau.shape)
        rng_q = 1e-5 * np.random.default_rng(50 + seed).normal(size=tau.shape)
        said += identified(Record(t, q + rng_q, tau + noise), instruments=q_late, delay=0).bias.probability < SIZE
    assert said <= 1


def test_as_many_instruments_as_unknowns_are_orthogonal_to_the_residual():
    """Z^T W (tau - Y x) = 0, and with Y itself as instruments the estimates are those of least squares."""
    rng = np.random.default_rng(0)
    Y, Z, x = rng.normal(size=(200, 3, 7)), rng.normal(size=(200, 3, 7)), rng.normal(size=7)
    Z += 2 * Y
    tau = Y @ x + rng.normal(size=(200, 3)) * (0.1, 2.0, 0.5)
    used, blocks = np.ones(tau.shape, bool), [slice(0, 80), slice(80, 200)]
    fit = least_squares(equations(Y, tau, used, blocks, Z))
    left = (tau - Y @ fit.values) / fit.sigma**2
    np.testing.assert_allclose(np.einsum("tjk,tj->k", Z, left), 0, atol=ROUNDING)
    A = np.einsum("tjk,tjl->kl", Z / fit.sigma[:, None] ** 2, Y)
    meat = np.einsum("tjk,tjl->kl", Z / fit.sigma[:, None] ** 2, Z)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(A) @ meat @ np.linalg.inv(A).T, rtol=ROUNDING)
    plain, same = (least_squares(equations(Y, tau, used, blocks, z)) for z in (None, Y))
    np.testing.assert_allclose(same.values, plain.values, rtol=ROUNDING)
    np.testing.assert_allclose(same.covariance, plain.covariance, rtol=ROUNDING)
    ours = with_correlation(fit, equations(Y, tau, used, blocks, Z), np.ones(3))
    np.testing.assert_allclose(ours.covariance, fit.covariance, rtol=ROUNDING)
    bias = bias_of_least_squares(fit, equations(Y, tau, used, blocks, Z), np.ones(3))
    W = 1 / fit.sigma[:, None] ** 2
    V = np.linalg.inv(np.einsum("tjk,tjl->kl", Y * W, Y))
    shift = V @ np.einsum("tjk,tj->k", Y * W, tau) - fit.values
    H = shift @ np.linalg.solve(fit.covariance - V, shift)  # Hausman 1978
    np.testing.assert_allclose(bias.shift, shift, rtol=1e-7)
    assert bias.probability == pytest.approx(f.sf(H / 7, 7, 600 - 14), rel=1e-6)


def test_half_the_cutoff_and_the_test_for_one_model(found):
    """Drift is that of instrumental variables too; the test for one rigid body is that of least squares."""
    data, base = found[0].data, found[0].base
    record, x = data.prepared[0], data.at_lower_cutoff(base, np.ones(3))[0]
    rate = record.sample_rate / record.decimation
    reach = settling(record.cutoff / 2, rate)
    columns = np.concatenate([data.Z, data.Y @ base.back, data.tau[..., None]], axis=-1)
    rows = low_pass(columns, record.cutoff / 2, rate, np.arange(reach, len(columns) - reach))
    Z, Y, tau = np.split(rows, [base.count, -1], axis=-1)
    left = np.einsum("tjk,tj->k", Z, tau[..., 0] - Y @ x)
    np.testing.assert_allclose(left, 0, atol=ROUNDING * np.abs(Z).sum((0, 1)).max() * np.abs(tau).max())
    plain = dataclasses.replace(data, Z=None, fitted=data.fitted.without_instruments())
    of_least_squares = certified(base, plain, found[0].unexplained.in_motion)
    np.testing.assert_array_equal(found[0].consistency().F, of_least_squares.F)


def test_more_instruments_than_unknowns_are_two_stage_least_squares():
    rng = np.random.default_rng(1)
    Z, V, x = rng.normal(size=(300, 1, 5)), rng.normal(size=(300, 1, 2)), np.array([2.0, -1.0])
    Y = Z[..., :2] + Z[..., 2:4] + V
    tau = Y @ x + V.sum(-1)  # as noise that is fed back
    fit = least_squares(equations(Y, tau, np.ones(tau.shape, bool), [slice(0, 300)], Z))
    predicted = Z[:, 0] @ np.linalg.lstsq(Z[:, 0], Y[:, 0], rcond=None)[0]
    np.testing.assert_allclose(fit.values, np.linalg.lstsq(predicted, tau[:, 0], rcond=None)[0], rtol=ROUNDING)


def test_possible_bodies_essential_parameters_and_files(loops, tmp_path):
    found = identified(loops.record(0), instruments=reference(loops.t)[0], drives=None, consistent=True)
    assert found.consistent
    truth = found.standard.values.copy()
    truth[found.standard.groups["Fv"]] = VISCOUS
    assert (np.abs(found.values - found.base.of(truth)) < 3 * found.estimate.errors).all()
    lines = found.report().splitlines()
    assert lines[1].startswith("least squares is biased by noise that is fed back (Durbin-Wu-Hausman p = ")
    assert lines[1].endswith("): use these estimates, by instrumental variables")
    assert "causes of the residuals, other than delays, are not searched for with instruments" in lines
    assert "the cut-off is that of the motion of the instruments, in which there is no noise" in found.notes
    record = found.records[0]
    slow = record.reduce(np.abs(reference(record.t)[1])) < 0.9 * found.minimum_velocity  # splines differ a little
    assert not found.data.used[slow].any()
    again = rne.Identification.load(found.save(tmp_path / "found.npz"))
    assert again.bias.probability == found.bias.probability
    assert again.report(details=True) == found.report(details=True)
    few = found.essential()
    assert few.base.count < found.base.count
    assert (few.unexplained.in_motion < found.unexplained.in_motion + 0.02).all()
    q = reference(loops.t)
    np.testing.assert_allclose(found.scene().inverse_dynamics(*q), found.predict(*q), atol=1e-9)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ([reference, reference], "`instruments` must have one motion for each of 1 record, got 2 motions"),
        ([], "`instruments` must have one motion for each of 1 record, got 0 motions"),
        (np.zeros((1000, 2)), "`instruments[0]` must have shape (1000, 3), got (1000, 2)"),
        (lambda t: (t, t), "`instruments` must return q, qd and qdd, got 2 results"),
        (
            lambda t: (np.zeros(2),) * 3,
            "`instruments` must give finite q, qd and qdd of shape (972, 3), got (972, 2), (972, 2), (972, 2)",
        ),
        (
            lambda t: tuple(-x for x in reference(t)),
            "`instruments` must resemble the measured motion: of joint 1 they differ by 0.475 (standard deviation), while it "
            "moves by 0.243: check units, joints and times",
        ),
    ],
)
def test_what_is_no_motion_of_the_record(loops, given, text):
    with pytest.raises(ValueError, match="instruments") as error:
        identified(loops.record(0), instruments=given, cutoff=8)
    assert str(error.value) == text


def test_a_record_is_no_instrument(loops):
    with pytest.raises(
        TypeError, match=r"^`instruments` must be, for each record, a function of time .*, got a Record$"
    ):
        identified(loops.record(0), instruments=[loops.record(1)])


def test_held_out_errors_do_not_judge_estimates_by_instruments(found):
    for each in found:
        assert "by instrumental variables; validation errors contain the noise of the positions" in each.verdict
        poor = dataclasses.replace(each, unexplained=each.unexplained._replace(in_motion=np.full(3, 0.9)))
        assert "does not explain" not in poor.doubt
        plain = dataclasses.replace(poor, data=dataclasses.replace(each.data, Z=None))
        assert "does not explain: joint_1 90 %" in plain.doubt


def test_a_motion_for_each_record(loops, found):
    """Once as a function of time, once as positions; the delays are those of single records."""
    logs = [loops.record(k) for k in range(2)]
    both = identified(logs, instruments=[reference, reference(loops.t)[0]])
    single = np.concatenate([x.delay for x in found[:2]])
    np.testing.assert_allclose(both.delay, single, atol=2e-3)
    assert (np.abs(off(both)[0]) < 3).all()


def test_a_function_of_one_time_is_called_for_each(loops, found):
    one = identified(loops.record(0), instruments=lambda t: tuple(x[0] for x in reference(float(t))))
    np.testing.assert_allclose(one.estimate.values, found[0].estimate.values, rtol=ROUNDING)


def test_a_motion_of_instruments_is_evaluated_once_for_the_same_times(loops):
    """Rounds of the fit, and the choice of the cut-off, ask for it again."""
    asked = []

    def motion(t):
        asked.append(np.asarray(t).tobytes())
        return reference(t)

    given = identified(loops.record(0), instruments=motion)
    assert len(asked) == len(set(asked))
    np.testing.assert_array_equal(given.values, identified(loops.record(0), instruments=reference).values)


def test_what_instruments_exclude(loops, found):
    cable = rne.identification.Hypothesis("cable", lambda q, qd, qdd: q[..., None], "{:.3g}")
    with pytest.raises(ValueError, match="instruments") as error:
        identified(loops.record(0), instruments=reference, hypotheses=[cable])
    assert str(error.value) == (
        "`hypotheses` are judged by least squares, which `instruments` replace: leave out one of them"
    )
    with pytest.raises(ValueError, match="instruments") as error:
        rne.identify_payload(found[0], None, loops.record(1))
    assert str(error.value) == "`robot` must be identified without `instruments`, or give the records as `without`"
