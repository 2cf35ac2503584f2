"""Identification stage by stage: what `identify` composes may be called by itself, and its steps find their errors."""

import sys
from collections import Counter
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

import rne
from rne import identification

from .helpers import first_joints
from .measurements import truth

DRIVES = rne.DriveModel(friction="viscous+coulomb")
USUAL = rne.DriveModel(rotor=True, friction="viscous+coulomb", offset=True)
LATE = 0.004  # [s], a sample
STRIBECK = 0.08  # [rad/s]
NOISE = 0.2  # [N m]
ALIKE = 1e-12  # relative: the same operations in the same order, but for threads of BLAS
MOST_CLASSES, MOST_OBJECTS = 12, 300  # that one call makes: more are not taken in


def log_of(scene, *, late=0.0, seed=3):
    """A log of 10 s at 125 Hz, of which the torques are measured late."""
    motion, rng = truth(scene, seed=seed, rate=125.0), np.random.default_rng(seed)
    tau = np.stack([np.interp(motion.t - late, motion.t, x) for x in motion.tau.T], axis=1)
    return identification.Record(motion.t, motion.q, tau + NOISE * rng.normal(size=tau.shape))


@pytest.fixture(scope="module")
def scene():
    friction = rne.Friction(viscous=[8.0, 6.0, 2.0], coulomb=[6.0, 8.0, 6.0], smoothing=1e-4)
    return rne.Scene(first_joints(3), friction=friction)


@pytest.fixture(scope="module")
def record(scene):
    return log_of(scene)


def test_stages_by_hand_give_what_identify_gives(scene, record):
    whole = rne.identify(scene.robot, record, drives=DRIVES, delay=0.0, cutoff=5.0, folds=2)
    base = scene.robot.base_parameters(drives=DRIVES)
    data = identification.regression(scene.robot, record, base, delay=0.0, cutoff=5.0, folds=2)
    estimate = identification.fit_base_parameters(base, data)
    bodies = identification.fit_bodies(base, data, prior=scene.robot)
    causes = identification.diagnose(scene.robot, base, data)
    found = identification.assemble(scene.robot, data, bodies, causes=causes)
    np.testing.assert_allclose(estimate.values, whole.estimate.values, rtol=ALIKE)
    np.testing.assert_allclose(estimate.errors, whole.estimate.errors, rtol=ALIKE)
    np.testing.assert_allclose(bodies.parameters, whole.parameters, rtol=1e-7, atol=1e-9)  # Newton's method ends there
    assert [cause.text for cause in causes] == [cause.text for cause in whole.causes]
    assert found.report() == whole.report()


def test_inputs_and_outputs_of_stages_cannot_be_changed(scene, record):
    base = scene.robot.base_parameters(drives=DRIVES)
    data = identification.regression(scene.robot, record, base, cutoff=5.0)
    for thing in (record.cleaned, record.prepare(5.0), base, data, identification.fit_base_parameters(base, data)):
        with pytest.raises(FrozenInstanceError):
            thing.t = 0


def test_a_clean_record_lies_on_a_grid_without_the_samples_that_are_wrong(record):
    q = record.q.copy()
    q[200, 1] += 0.3
    clean = identification.Record(np.delete(record.t, 400), np.delete(q, 400, 0), np.delete(record.tau, 400, 0)).cleaned
    assert len(clean.t) == len(record.t)
    np.testing.assert_allclose(np.diff(clean.t), clean.period, rtol=1e-9)
    assert abs(clean.q[200, 1] - record.q[200, 1]) < 1e-3 < abs(q[200, 1] - record.q[200, 1])
    assert [finding.kind for finding in clean.findings] == ["missing samples", "position spike"]


def identified(scene, record, **options):
    return rne.identify(scene.robot, record, consistent=False, cutoff=5.0, folds=2, **options)


def test_delays_are_found_once_and_rotors_dropped_where_none_is_felt(scene):
    """Steps are taken until none finds an error: the last delay is the sum of those found."""
    late = log_of(scene, late=LATE)
    found = identified(scene, late)
    np.testing.assert_allclose(found.delay, LATE, atol=3e-4)  # standard errors are 0.05 ms
    assert sum(note.startswith("delay of ") for note in found.notes) == 1
    assert "Ia" not in found.standard.terms
    given = identified(scene, late, delay=found.delay[0], drives=USUAL)
    assert not any(note.startswith("delay of ") for note in given.notes)
    assert "Ia" in given.standard.terms


def test_stribeck_effects_are_found_with_their_velocity(scene):
    friction = replace(scene.friction, stribeck=[STRIBECK, 0.0, 0.0], stribeck_rise=[20.0, 0.0, 0.0])
    found = identified(scene, log_of(replace(scene, friction=friction)))
    velocity = found.standard.drives.stribeck
    assert velocity[0] == pytest.approx(STRIBECK, rel=0.2)  # three times its scatter over six seeds, 6 %
    assert not velocity[1:].any()
    assert not any(cause.kind == "Stribeck friction" for cause in found.causes)


def test_large_rotors_are_kept(scene):
    with_armature = rne.Scene(scene.robot.with_armature([20.0, 20.0, 10.0]), friction=scene.friction)
    assert "Ia" in identified(scene, log_of(with_armature)).standard.terms


def test_identify_makes_objects_of_few_classes(scene, record):
    """Each is something that a reader of a fit has to know; those of kernels, which are there before, do not count."""
    rne.identify(scene.robot, record, consistent=False)
    made = Counter()

    def note(frame, event, _):
        owner = frame.f_locals.get("self") if event == "call" and frame.f_code.co_name == "__init__" else None
        if type(owner).__module__.startswith("rne"):
            made[type(owner).__name__] += 1

    sys.setprofile(note)
    try:
        rne.identify(scene.robot, record, consistent=False)
    finally:
        sys.setprofile(None)
    assert {"FitModel", "RegressionData", "Identification"} <= made.keys()
    assert len(made) <= MOST_CLASSES, made
    assert made.total() <= MOST_OBJECTS, made


@pytest.mark.parametrize(
    ("prior", "std", "text"),
    [
        ("geom", None, "`prior` must be an rne.Robot or 'geometry', got 'geom'"),
        (rne.load("irb140"), None, "`prior` must have the joints"),
        (None, 0.3, "`prior_std` is of a prior"),
    ],
)
def test_a_prior_that_is_none_is_refused(scene, record, prior, std, text):
    base = scene.robot.base_parameters(drives=DRIVES)
    data = identification.regression(scene.robot, record, base, cutoff=5.0, folds=2)
    with pytest.raises((TypeError, ValueError), match=text):
        identification.fit_bodies(base, data, prior=prior, prior_std=std)
