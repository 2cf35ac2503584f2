"""Identification from synthetic measurements, of which the truth is known."""

import numpy as np
import pytest

import rne
from rne.identification import Record
from rne.model.pseudo_inertia import pseudo_inertia

from .measurements import measure, record, truth

VISCOUS, COULOMB = np.array([8, 6, 2, 1.2, 1.4, 0.6]), np.array([6, 8, 6, 2, 2.4, 0.5])
NOISE = np.array([1.5, 1.5, 0.9, 0.3, 0.3, 0.3])  # standard deviation of each torque [N m]
ENCODER = 2 * np.pi / 2**17  # step of the joint positions [rad]
CLOCK = 2e-5  # largest error of a stamp [s], 1 % of the sampling period
WITHIN_THREE = 0.9973
BETWEEN_SAMPLES = 1e-3  # of the torques: what filters and differences change in a motion up to 0.5 Hz


@pytest.fixture(scope="module")
def scene():
    """Coulomb friction is nearly a step, as the fit takes it."""
    friction = rne.Friction(viscous=VISCOUS, coulomb=COULOMB, smoothing=1e-4)
    return rne.Scene(rne.load("irb140"), friction=friction)


@pytest.fixture(scope="module")
def motions(scene):
    """One to fit and one to predict, 10 s at 500 Hz."""
    return truth(scene, seed=1), truth(scene, seed=2)


def true_values(found):
    """The base parameters behind the synthetic torques."""
    standard = found.standard.values.copy()
    standard[found.standard.groups["Fv"]], standard[found.standard.groups["Fc"]] = VISCOUS, COULOMB
    return found.base.matrix @ standard


def identified(scene, motion, seed, **options):
    rng = np.random.default_rng(seed)
    t, q, tau = motion.t, motion.q, motion.tau + NOISE * rng.normal(size=motion.tau.shape)
    return rne.identify(scene.robot, Record(t, q, tau), friction="viscous+coulomb", **options)


def test_without_noise_the_truth_is_found(scene, motions):
    t, q, tau = measure(motions[0])
    found = rne.identify(scene.robot, Record(t, q, tau), friction="viscous+coulomb", spread=3.0)
    size = np.abs(tau).max(0)
    assert (found.estimate.sigma < BETWEEN_SAMPLES * size).all()
    check = found.check(record(motions[1]))
    assert (check.rms < 3 * BETWEEN_SAMPLES * size).all()
    assert found.base.count == 48


def errors_in_standard_errors(scene, motion, seeds, **options):
    """(estimate - truth) / standard error, and the smallest eigenvalue of the bodies' pseudo-inertias, per seed."""
    z, least = [], []
    for seed in seeds:
        found = identified(scene, motion, seed, blocks=2, **options)
        z.append((found.estimate.values - true_values(found)) / found.estimate.errors)
        least.append(np.linalg.eigvalsh(pseudo_inertia(found.parameters[:60])).min())
    return np.array(z), np.array(least)


def test_truth_lies_within_three_standard_errors(scene, motions):
    z, _ = errors_in_standard_errors(scene, motions[0], range(6), consistent=False)
    assert np.mean(np.abs(z) < 3) > 0.985
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1, abs=0.15)  # 288 errors: three deviations


@pytest.mark.long
def test_truth_lies_within_three_standard_errors_in_200_runs(scene, motions):
    z, least = errors_in_standard_errors(scene, motions[0], range(200))
    inside = np.abs(z) < 3
    assert (inside.mean(0) >= 0.95).all()  # each parameter
    assert inside.mean() >= WITHIN_THREE - 0.005
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1, abs=0.08)
    assert (least > 0).all()
