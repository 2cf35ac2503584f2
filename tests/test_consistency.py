"""Whether measured torques can come from one rigid-body model: torques of a robot can, planted contradictions cannot."""

import warnings

import numpy as np
import pytest
from scipy.linalg import orth
from scipy.stats import f

import rne
from rne.basics.filters import low_pass
from rne.identification import Record, regression
from rne.identification.diagnosis.rigid_body_test import certified, torque_noise

from .helpers import first_joints, kept
from .measurements import truth

VISCOUS, COULOMB = np.array([8, 6, 2, 1.2, 1.4, 0.6]), np.array([6, 8, 6, 2, 2.4, 0.5])
NOISE = np.array([1.5, 1.5, 0.9, 0.3, 0.3, 0.3])  # standard deviation of each torque [N m]
NOISE_FOUND = 0.35  # relative error of the noise, from some hundred ordinates of its spectrum and steps of friction
BALANCED = 0.01  # of the work: noise of 1 % of the torques, averaged


@pytest.fixture(scope="module", params=kept([3, 6], [3]))
def scene(request):
    """The first joints of the IRB 140, or all."""
    n = request.param
    robot = first_joints(n)
    return rne.Scene(robot, friction=rne.Friction(viscous=VISCOUS[:n], coulomb=COULOMB[:n], smoothing=1e-4))


@pytest.fixture(scope="module")
def motion(scene):
    return truth(scene, seed=1)


def judged(*given, **options):
    return identified(*given, **options).consistency()


def identified(scene, motion, tau, seed, noise=1.0, friction="viscous+coulomb"):
    noisy = tau + noise * NOISE[: scene.n] * np.random.default_rng(seed).normal(size=tau.shape)
    record, drives = Record(motion.t, motion.q, noisy), rne.DriveModel(friction=friction)
    with warnings.catch_warnings(action="ignore", category=rne.IdentificationWarning):
        options = {"consistent": False, "delay": 0.0, "folds": 2, "causes": False}
        return rne.identify(scene.robot, record, drives=drives, **options)


@pytest.mark.parametrize("seed", range(1))
def test_torques_of_a_robot_are_of_one_model(scene, seed):
    motion = truth(scene, seed=seed)
    found = judged(scene, motion, motion.tau, seed)
    assert found.one_model, found.report()
    assert found.energy.missing < BALANCED


def test_without_noise_a_torque_that_is_off_by_three_in_ten_thousand_is_a_conflict(scene, motion):
    tau = scene.robot.inverse_dynamics(motion.q, motion.qd, motion.qdd)
    assert judged(scene, motion, tau, 1, noise=0.0).one_model
    tau[:, 2] *= 1.0003
    assert judged(scene, motion, tau, 1, noise=0.0).conflict.any()


def test_noise_is_found(scene, motion):
    found = judged(scene, motion, motion.tau, 5)
    prepared = Record(motion.t, motion.q, motion.tau).prepare()
    noise = prepared.reduce(NOISE[: scene.n] * np.random.default_rng(6).normal(size=prepared.tau.shape))
    expected = noise.std(0) / np.sqrt((prepared.reduce(prepared.tau) ** 2).mean(0))
    np.testing.assert_allclose(found.noise, expected, rtol=NOISE_FOUND)


def test_noise_after_the_filter_is_that_of_its_response_to_an_impulse():
    """White noise of variance one leaves the sum of squares of the response."""
    t, cutoff = np.arange(40_000) / 250.0, 5.0
    tau = np.random.default_rng(0).normal(size=(len(t), 6))
    prepared = Record(t, np.sin(np.outer(t, np.ones(6))), tau).prepare(cutoff)
    impulse = np.zeros((2001, 1))
    impulse[1000] = 1
    expected = (low_pass(impulse, cutoff, 250.0) ** 2).sum()
    assert torque_noise(prepared).mean() == pytest.approx(expected, rel=0.02)  # 50 000 ordinates, windows overlap


def test_noise_of_every_part_of_a_record_counts():
    """Between two gaps as after them."""
    t = np.concatenate([np.arange(5000), np.arange(6000, 10_000)]) / 250.0
    tau = np.random.default_rng(0).normal(size=(len(t), 6)) * np.where(t < 22, 1.0, 3.0)[:, None]
    prepared = Record(t, np.sin(np.outer(t, np.ones(6))), tau).prepare(5.0)
    both = torque_noise(prepared).mean()
    alone = torque_noise(Record(t[:5000], np.sin(np.outer(t[:5000], np.ones(6))), tau[:5000]).prepare(5.0)).mean()
    assert both / alone == pytest.approx((5 + 4 * 9) / 9, rel=0.05)


def test_f_is_that_of_nested_models_by_independent_equations(scene, motion):
    """Draper and Smith 1998, (6.1.8), of all rows: residuals of a joint's own fit and of one fit to all joints."""
    base = scene.robot.base_parameters(drives=rne.DriveModel(friction="viscous+coulomb"))
    tau = motion.tau + NOISE[: scene.n] * np.random.default_rng(0).normal(size=motion.tau.shape)
    data = regression(scene.robot, Record(motion.t, motion.q, tau), base, cutoff=5.0, folds=2)
    joint, A, b = np.nonzero(data.used)[1], (data.Y @ base.back)[data.used], data.tau[data.used]
    own, N = [A[joint == j] for j in range(scene.n)], np.bincount(joint)
    spaces = [orth(X / np.maximum(np.linalg.norm(X, axis=0), 1e-9), rcond=1e-6) for X in own]
    ranks = np.array([U.shape[1] for U in spaces])
    alone = np.array([((b[joint == j] - U @ (U.T @ b[joint == j])) ** 2).sum() for j, U in enumerate(spaces)])
    fits = [np.linalg.lstsq(X, b[joint == j])[0] for j, X in enumerate(own)]
    times = np.array([data.correlation_time(data.residuals(base.back @ x))[j] for j, x in enumerate(fits)])
    sigma = np.sqrt(alone / (N - ranks))[joint]
    Q = np.linalg.qr(A / sigma[:, None])[0]
    together = np.bincount(joint, (b - sigma * (Q @ (Q.T @ (b / sigma)))) ** 2)
    shared = ranks - np.bincount(joint, (Q**2).sum(1))
    F = (together - alone) / shared / (alone / (N - ranks)) / times
    found = certified(base, data, np.zeros(scene.n))
    np.testing.assert_allclose(found.F, F, rtol=1e-6)
    np.testing.assert_allclose(found.probability, f.sf(F, shared, N / times - ranks), rtol=1e-4)
    np.testing.assert_allclose(found.independent, N / times - ranks)


@pytest.mark.parametrize(("joint", "factor"), [(2, 1.2)])
def test_wrong_gear_ratio_is_a_contradiction(scene, motion, joint, factor):
    tau = motion.tau.copy()
    tau[:, joint] *= factor
    fit = identified(scene, motion, tau, 0)
    found = fit.consistency()
    assert found.conflict[joint], found.report()
    assert found.verdict.startswith("no single set of inertial parameters fits joint_1, joint_2")
    assert found.verdict in " ".join(fit.report().split())  # the whole sentence, of several lines


def test_exchanged_torques_are_a_contradiction(scene, motion):
    assert not judged(scene, motion, motion.tau[:, [0, 2, 1, 3, 4, 5][: scene.n]], 0).one_model


def test_missing_friction_is_missing_energy(scene, motion):
    """Drives do work that a model without friction neither stores nor loses, in every joint."""
    found = judged(scene, motion, motion.tau, 0, noise=0.0, friction=None)
    assert found.energy.missing > 0.1
    assert (found.energy.lost > 0).all()
    complete = judged(scene, motion, motion.tau, 0, noise=0.0)
    assert complete.energy.missing < BALANCED
    assert (np.abs(complete.energy.lost) < BALANCED).all()


def test_report_of_an_identification_ends_with_the_certificate(scene, motion):
    record = Record(motion.t, motion.q, motion.tau)
    text = rne.identify(
        scene.robot, record, drives=rne.DriveModel(friction="viscous+coulomb"), consistent=False, causes=False
    ).report(details=True)
    last = text.split("\n\n")[-1]
    assert last.startswith("one rigid-body model explains the torques: validation error "), last
    assert last.splitlines()[-1].startswith("energy: "), last


def test_a_conflict_of_one_joint_alone_is_told_with_its_name():
    shares = np.array([0.01, 0.01])
    balance = rne.identification.EnergyBalance(0.0, shares, shares)
    alike = dict.fromkeys(("noise", "held_out", "single_joint", "F", "probability", "independent"), shares)
    conflict = np.array([False, True])
    found = rne.Consistency(("a", "b"), **alike, all_joints=np.array([0.01, 0.08]), conflict=conflict, energy=balance)
    assert not found.one_model
    assert found.verdict.startswith("no single set of inertial parameters fits b: residual ")


@pytest.mark.long
@pytest.mark.parametrize("name", ["irb140", "ur5"])
@pytest.mark.parametrize("seed", range(20))
def test_no_false_alarm(name, seed):
    friction = rne.Friction(viscous=VISCOUS, coulomb=COULOMB, smoothing=1e-4)
    scene = rne.Scene(rne.load(name), friction=friction)
    motion = truth(scene, seed=seed)
    found = judged(scene, motion, motion.tau, seed)
    assert found.one_model, found.report()
