"""Identification from synthetic measurements, of which the truth is known."""

import dataclasses
import re

import numpy as np
import pytest

import rne
from rne.basics.inertia import pseudo_inertia
from rne.identification import Record, regression
from rne.identification.fit.equations import of_named_joints
from rne.identification.fit.least_squares import least_squares

from . import faulty_logs as faults
from .conftest import TREES
from .helpers import first_joints, kept, loaded
from .measurements import measure, record, truth

VISCOUS, COULOMB = np.array([8, 6, 2, 1.2, 1.4, 0.6]), np.array([6, 8, 6, 2, 2.4, 0.5])
NOISE = np.array([1.5, 1.5, 0.9, 0.3, 0.3, 0.3])  # standard deviation of each torque [N m]
ENCODER = 2 * np.pi / 2**17  # step of the joint positions [rad]
CLOCK = 4e-5  # largest error of a stamp [s], 1 % of the sampling period
WITHIN_THREE = 0.9973
MEASURED = rne.DriveModel(rotor=True, friction="viscous+coulomb", offset=True)  # without what the log asks for besides
BETWEEN_SAMPLES = 1e-3  # of the torques: what filters and differences change in a motion up to 0.5 Hz


@pytest.fixture(scope="module", params=kept([3, 6], [3]))
def scene(request):
    """The first joints of the IRB 140, or all; Coulomb friction is nearly a step, as the fit takes it."""
    n = request.param
    robot = first_joints(n)
    friction = rne.Friction(viscous=VISCOUS[:n], coulomb=COULOMB[:n], smoothing=1e-4)
    return rne.Scene(robot, friction=friction)


@pytest.fixture(scope="module")
def motions(scene):
    """One to fit and one to predict, 10 s at 125 Hz."""
    return truth(scene, seed=1, rate=125.0), truth(scene, seed=2, rate=125.0)


def true_values(found):
    """The base parameters behind the synthetic torques."""
    standard = found.standard.values.copy()
    n = found.initial.n
    standard[found.standard.groups["Fv"]], standard[found.standard.groups["Fc"]] = VISCOUS[:n], COULOMB[:n]
    return found.base.matrix @ standard


def identified(scene, motion, seed, **options):
    rng = np.random.default_rng(seed)
    t, q, tau = motion.t, motion.q, motion.tau + NOISE[: scene.n] * rng.normal(size=motion.tau.shape)
    options = {"drives": rne.DriveModel(friction="viscous+coulomb"), "causes": False} | options
    return rne.identify(scene.robot, Record(t, q, tau), **options)


def test_without_noise_the_truth_is_found(scene, motions):
    t, q, tau = measure(motions[0])
    found = rne.identify(
        scene.robot,
        Record(t, q, tau),
        drives=rne.DriveModel(friction="viscous+coulomb"),
        prior_std=3.0,
        folds=2,
        causes=False,
    )
    size = np.abs(tau).max(0)
    assert (found.estimate.sigma < BETWEEN_SAMPLES * size).all()
    check = found.check(record(motions[1]))
    assert (check.rms < 3 * BETWEEN_SAMPLES * size).all()
    assert found.base.count == {3: 21, 6: 48}[scene.n]


def test_the_weight_of_the_prior_is_that_of_a_standard_deviation(scene, motions, monkeypatch):
    weights = []

    def spy(factor, prior, weight, bounded, size):
        weights.append(weight)
        return np.concatenate([scene.robot.parameters, VISCOUS[: scene.n], COULOMB[: scene.n]])

    monkeypatch.setattr("rne.identification.fit.least_squares.consistent_fit", spy)
    identified(scene, motions[0], 0, prior_std=0.5, folds=2)
    assert weights == [4.0] * 3


def errors_in_standard_errors(scene, motion, seeds, **options):
    """(estimate - truth) / standard error, with the cut-off and with half of it, and the bodies' smallest eigenvalue."""
    z, lower, least = [], [], []
    for seed in seeds:
        found = identified(scene, motion, seed, folds=2, **options)
        off = found.estimate.values - true_values(found)
        z.append(off / found.estimate.errors)
        lower.append((off + found.drift) / found.drift_error)
        least.append(np.linalg.eigvalsh(pseudo_inertia(found.parameters[: 10 * scene.n])).min())
    return np.array(z), np.array(lower), np.array(least)


def test_truth_lies_within_three_standard_errors(scene, motions):
    *both, _ = errors_in_standard_errors(scene, motions[0], range(12), consistent=False)
    for z in both:
        assert np.mean(np.abs(z) < 3) > 0.985
        assert np.sqrt(np.mean(z**2)) == pytest.approx(1, abs=0.2)  # three deviations; those of a log are related


@pytest.mark.long
def test_truth_lies_within_three_standard_errors_in_200_runs(scene, motions):
    z, _, least = errors_in_standard_errors(scene, motions[0], range(200))
    inside = np.abs(z) < 3
    assert (inside.mean(0) >= 0.95).all()  # each parameter
    assert inside.mean() >= WITHIN_THREE - 0.005
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1, abs=0.08)
    assert (least > 0).all()


@pytest.fixture(scope="module")
def found(scene, motions):
    """A consistent fit to one motion with noise on the torques."""
    return identified(scene, motions[0], 0, drives=MEASURED, folds=4)


def sensors(n, seed):
    return {"torque_noise": NOISE[:n], "encoder_step": ENCODER, "clock": CLOCK, "seed": seed}


def error_over_noise(found, motion, seed):
    """Error of the torques predicted for a motion over the noise of those measured, per joint."""
    measured = record(motion, **sensors(found.robot.n, seed))
    prepared = measured.prepare(found.records[0].cutoff)
    exact = np.stack([np.interp(prepared.t, motion.t, tau) for tau in motion.tau.T], axis=1)
    return found.check(measured).rms / (prepared.reduce(prepared.tau) - prepared.reduce(exact)).std(0)


def test_torques_of_another_motion_are_predicted_to_the_noise(scene, motions):
    """Encoders, clocks and noise; positions differentiated and filtered; two motions fitted."""
    fitted = [
        record(motion, **sensors(scene.n, k))
        for k, motion in enumerate((motions[0], truth(scene, seed=11, rate=250.0)))
    ]
    found = rne.identify(scene.robot, fitted, drives=rne.DriveModel(friction="viscous+coulomb"), folds=2, causes=False)
    assert (error_over_noise(found, motions[1], 100) < 1.2).all()


def test_bodies_are_physically_consistent_and_predict_as_well(found):
    P = pseudo_inertia(found.parameters[: 10 * found.robot.n])
    assert (np.linalg.eigvalsh(P) > 0).all()
    values = found.base.back @ found.estimate.values, found.parameters
    free, consistent = ((found.equations.residuals(x) / found.estimate.sigma**2).sum() for x in values)
    assert free < consistent < 1.1 * free
    assert (np.array(found.robot.model.mass) > 0).all()
    title, first = re.search(r"^(bodies .*)\n(.*)$", found.report(details=True), re.MULTILINE).groups()
    assert title.index("mass [kg]") + len("mass [kg]") == re.search(r"\d+\.\d{4}", first).end()


def test_held_out_errors_are_those_of_fits_without_the_block(scene, motions):
    found = identified(scene, motions[0], 0, consistent=False, folds=2)
    squares = np.zeros(scene.n)
    for k in range(2):
        others = found.equations.of_blocks(np.arange(2) != k).mapped(found.base.back)
        values = least_squares(others).values
        prepared = found.records[0]
        block = prepared.blocks(2)[k]
        rows = prepared.reduce(prepared.tau)[block]
        Y = prepared.reduce(found.base.regressor(prepared.q, prepared.qd, prepared.qdd))[block]
        squares += ((Y @ values - rows) ** 2).sum(0)
    total = (prepared.reduce(prepared.tau) ** 2).sum(0)
    np.testing.assert_allclose(found.held_out, np.sqrt(squares / total), rtol=1e-6)


def test_the_robot_found_has_what_was_found(found, scene):
    """Predictions, robot, scene and URDF are the same model."""
    rng = np.random.default_rng(3)
    q, qd, qdd = rng.uniform(-1, 1, (3, 20, scene.n))
    friction = found.friction.viscous * qd + found.friction.coulomb * np.tanh(qd / found.friction.smoothing)
    expected = found.robot.inverse_dynamics(q, qd, qdd) + friction + found.offset
    np.testing.assert_allclose(found.predict(q, qd, qdd), expected, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_array_equal(found.robot.model.damping, found.friction.viscous)
    assert (found.robot.model.armature == found.parameters[found.standard.groups["Ia"]]).all()


def test_urdf_of_the_robot_found(found, tmp_path):
    path = tmp_path / "found.urdf"
    path.write_text(rne.to_urdf(found.robot.model), encoding="utf-8")
    loaded = rne.load(path)
    assert found.robot.model.armature.any()
    for name in ("mass", "com", "inertia", "rotation", "translation", "axis", "armature", "damping", "friction"):
        np.testing.assert_array_equal(getattr(loaded.model, name), getattr(found.robot.model, name))
    motion = np.random.default_rng(4).uniform(-1, 1, (3, 20, loaded.n))
    np.testing.assert_array_equal(loaded.mass_matrix(motion[0]), found.robot.mass_matrix(motion[0]))
    np.testing.assert_array_equal(loaded.inverse_dynamics(*motion), found.robot.inverse_dynamics(*motion))


def test_rotors_that_the_model_has_are_not_counted_twice(scene, motions):
    """What is said of a fit, delays and causes among it, is the same for a robot that has rotors already."""
    t, q, *_, tau = motions[0]
    record = Record(t, q, np.roll(tau, 5, axis=0))
    drives = rne.DriveModel(rotor=True, friction="viscous+coulomb", offset=True)
    bare, geared = (
        rne.identify(robot, record, drives=drives, consistent=False, folds=2)
        for robot in (scene.robot.with_armature(0.0), scene.robot.with_armature(3.0))
    )
    assert [cause.kind for cause in bare.causes] == [cause.kind for cause in geared.causes]
    np.testing.assert_allclose(geared.delay, bare.delay, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(geared.values, bare.values, rtol=1e-6, atol=1e-9 * np.abs(bare.values).max())


def test_report_and_check_name_joints_and_parameters(found, motions):
    text = found.report(details=True)
    n = found.robot.n
    for part in (f"{found.base.count} base parameters of", f"joint_{n}", f"Fc_{n}", "nearest to the prior", "cut-off"):
        assert part in text
    assert "> 1000" not in text
    assert f"motion record: {len(found.records[0].t) / 125:.3g} s at 125 Hz" in text
    counts = re.findall(r"^  joint_\d .* (\d+) +\d+$", text, re.MULTILINE)
    assert [int(count) for count in counts] == found.equations.rows.sum(axis=0).astype(int).tolist()
    shares = re.findall(r"^  joint_\d +\S+ +\S+ +(\S+) .* \d+ +\d+$", text, re.MULTILINE)  # explained, R^2
    assert shares == [f"{share:.4f}" for share in found.r_squared]
    check = found.check(record(motions[1], **sensors(found.robot.n, 5)))
    assert check.report().count("joint_") == n
    turned = dataclasses.replace(check, predicted=-check.predicted)
    assert "are units, zero and order those of the fitted records?" not in check.report()
    assert f"a constant torque predicts {', '.join(check.joint_names)} better" in turned.report()
    assert (check.relative < 0.2).all()
    assert repr(found).startswith("Identification(")
    assert repr(check).startswith("Check(motion ")
    assert f"error at most {100 * check.relative.max():.3g} %" in " ".join(repr(check).split())


def test_a_standard_error_as_large_as_its_value_is_no_share_of_it(found):
    """The table has a dash from 100 % on."""
    ratios = np.where(np.arange(found.base.count) % 2, 0.96, 1.04)
    errors = np.maximum(np.abs(found.estimate.values), 1e-3) * ratios
    estimate = dataclasses.replace(found.estimate, values=errors / ratios, errors=errors)
    text = dataclasses.replace(found, estimate=estimate).report(details=True)
    rows = text.partition("\nbase parameters  ")[2].splitlines()[1 : found.base.count + 1]
    expected = ["-" if ratio >= 1 else f"{100 * ratio:.2g}" for ratio in ratios]
    assert [row.split()[3] for row in rows] == expected


def test_a_record_of_other_joints_is_no_motion_to_predict(found):
    t = np.linspace(0, 5, 501)
    with pytest.raises(
        ValueError,
        match=r"^`record` must be of the joints \['\w+', .*\], 'record' has 2 joints without names: give the ",
    ):
        found.check(Record(t, np.zeros((501, 2)), np.zeros((501, 2))))


def test_parameters_that_stand_for_several_are_told_with_their_combination(found):
    lines = found.report(details=True).splitlines()
    where = lines.index("Base parameters that stand for a combination of several:")
    combined = [text for name, text in zip(found.base.names, found.base.formulas, strict=True) if text != name]
    assert [line.strip() for line in lines[where + 1 : where + 1 + len(combined)]] == combined


def test_a_guess_from_the_geometry_is_prior_enough(scene):
    """Masses are not known at all; torques are predicted as well."""
    motion = truth(scene, 20.0, rate=250.0, seed=1)
    known, guessed = (identified(scene, motion, 0, folds=2, prior=prior) for prior in (None, "geometry"))
    assert (guessed.held_out < 1.2 * known.held_out).all()
    total = guessed.parameters[: 10 * scene.n : 10].sum()
    assert 0.2 < total / scene.robot.model.mass.sum() < 5
    assert any("rods between the joints" in note for note in guessed.notes)


@pytest.mark.filterwarnings("ignore::rne.IdentificationWarning")
def test_torques_of_no_rigid_body_make_no_guessed_body_heavier_than_all_together():
    """A quarter of the torques is of nothing that is modelled: bodies stay near the guess, and the report says so."""
    arm = loaded("panda_description/panda").locked({"panda_finger_joint1": 0, "panda_joint1": 0, "panda_joint6": 0.5})
    true, rng = truth(arm, 10.0, 125.0, seed=1), np.random.default_rng(0)
    size = np.sqrt((true.tau**2).mean(0)) + 1
    tau = true.tau * rng.uniform(0.75, 1.25, 5) + 0.25 * size * np.sin(3 * true.q + 1)
    log = Record(true.t, true.q, tau + 0.01 * size * rng.normal(size=tau.shape))
    options = {
        "prior": "geometry",
        "folds": 2,
        "drives": MEASURED,
        "delay": 0.0,
        "causes": False,
    }  # neither delays nor Stribeck effects
    found = rne.identify(arm, log, **options)
    guess = float(re.search(r"rods between the joints, ([0-9.]+) kg", found.report(details=True))[1])
    assert found.robot.model.mass.max() < guess
    assert "with a larger one, torques that are not explained ask for one body" in found.report(details=True)


def test_coupled_motor(scene, motions):
    """A rotor that turns with the sum of two joints that cross, its inertia and friction."""
    shaft, inertia, viscous, coulomb = np.zeros((1, scene.n)), 0.5, 2.0, 1.5
    shaft[0, {3: [0, 1], 6: [4, 5]}[scene.n]] = 1.0
    t, q, qd, qdd, tau = motions[0]
    rate = qd @ shaft.T
    tau = tau + (inertia * (qdd @ shaft.T) + viscous * rate + coulomb * np.sign(rate)) * shaft
    found = rne.identify(
        scene.robot,
        Record(t, q, tau),
        drives=rne.DriveModel(rotor=True, friction="viscous+coulomb", coupled_motors=shaft),
        consistent=False,
        causes=False,
    )
    last = dict(zip(found.base.names, found.estimate.values, strict=True))
    assert [last[f"{s}_s1"] for s in ("Ia", "Fv", "Fc")] == pytest.approx([inertia, viscous, coulomb], abs=0.02)


@pytest.mark.parametrize("name", kept(["mixed", "mimics"], ["mimics"]))
def test_sliding_joints_branches_and_mimics(name):
    robot = rne.Robot(TREES[name])
    motion = truth(robot, seed=4, rate=250.0)
    found = rne.identify(robot, record(motion), drives=rne.DriveModel(), folds=2, prior_std=3.0, causes=False)
    other = truth(robot, seed=5, rate=250.0)
    check = found.check(record(other))
    assert (check.relative < 0.02).all()
    assert (np.linalg.eigvalsh(pseudo_inertia(found.parameters)) > 0).all()


def test_a_joint_that_does_not_move_is_not_excited(scene, motions):
    """Its encoder flickers between steps."""
    t, q, qd, qdd, _ = (x.copy() for x in motions[0])
    q[:, -1], qd[:, -1], qdd[:, -1] = 0.3, 0, 0
    tau = scene.inverse_dynamics(q, qd, qdd)
    q[:, -1] += ENCODER * np.random.default_rng(0).integers(-1, 2, len(t))
    rec = Record(t, ENCODER * np.rint(q / ENCODER), tau)
    found = rne.identify(
        scene.robot, rec, drives=rne.DriveModel(rotor=True, friction="viscous+coulomb"), folds=2, causes=False
    )
    names = [found.base.names.index(f"{symbol}_{scene.n}") for symbol in ("Ia", "Fv", "Fc")]
    assert not found.excited[names].any()
    assert np.isinf(found.estimate.errors[names]).all()
    assert [found.friction.viscous[-1], found.friction.coulomb[-1]] == pytest.approx([0, 0], abs=1e-9)
    assert f"joint_{scene.n} does not move: its rotor and friction cannot be found" in found.notes
    assert "not excited" in found.report(details=True)


def test_where_the_motion_says_nothing_the_model_has_the_last_word(scene, motions):
    """The rotor of a joint at rest, on a model that knows it; of the others it is found to be zero."""
    model = scene.robot.model
    robot = rne.Robot(dataclasses.replace(model, armature=np.full(scene.n, 0.5)))
    t, q, qd, qdd, _ = (x.copy() for x in motions[0])
    q[:, -1], qd[:, -1], qdd[:, -1] = 0.3, 0, 0
    rec = Record(t, q, scene.robot.inverse_dynamics(q, qd, qdd))
    found = rne.identify(robot, rec, drives=rne.DriveModel(rotor=True), folds=2, causes=False)
    assert found.robot.model.armature[-1] == pytest.approx(0.5, rel=1e-6)
    assert found.robot.model.armature[1] < 0.2


def test_a_joint_without_torques_is_no_perfect_one(scene, motions):
    t, q, tau = measure(motions[0], torque_noise=NOISE[: scene.n])
    tau[:, -1] = 0
    found = rne.identify(
        scene.robot, Record(t, q, tau), drives=rne.DriveModel(friction="viscous+coulomb"), folds=2, causes=False
    )
    assert np.isnan(found.held_out[-1])
    assert (found.held_out[:-1] < 0.1).all()
    assert f"joint_{scene.n} has no torque that can be used: constant torque of 0 in all samples" in found.notes
    assert f"joint_{scene.n} (its torque cannot be used: constant torque of 0 in all samples)" in found.verdict


def test_a_torque_of_the_wrong_sign_is_told_from_negative_friction(scene, motions):
    t, q, tau = measure(motions[0], torque_noise=NOISE[: scene.n])
    tau[:, 2] *= -1
    with pytest.warns(rne.IdentificationWarning, match="the torque of joint_3 has the wrong sign"):
        found = rne.identify(scene.robot, Record(t, q, tau), drives=rne.DriveModel(friction="viscous+coulomb"), folds=2)
    assert found.causes[0].kind == "torque sign"
    assert found.notes[-1] == "negative friction: is the sign of the joint's torque right?"
    assert any(note.startswith("Fv_3 comes out negative") for note in found.notes)
    assert "No possible bodies fit as least squares do" in found.report(details=True)
    with pytest.warns(rne.IdentificationWarning, match="negative friction: is the sign of the joint's torque right"):
        free = rne.identify(
            scene.robot,
            Record(t, q, tau),
            drives=rne.DriveModel(friction="viscous+coulomb"),
            folds=2,
            consistent=False,
            causes=False,
        )
    with pytest.raises(
        rne.IdentificationError, match=r"^least squares gave negative values of .*Fv_3.*consistent=True"
    ):
        _ = free.friction


def test_torques_of_the_other_sign_are_told_though_no_bodies_have_them(monkeypatch):
    """Reaction torques: the default call names the cause and gives what least squares find."""

    def fail(*_):
        raise rne.IdentificationError("no physically consistent bodies were found")

    robot = first_joints()
    t, w = np.arange(0, 20, 0.01), 2 * np.pi * np.array([0.21, 0.34, 0.55])
    q, qd, qdd = 0.8 * np.sin(np.outer(t, w)), 0.8 * w * np.cos(np.outer(t, w)), -0.8 * w**2 * np.sin(np.outer(t, w))
    tau = robot.inverse_dynamics(q, qd, qdd) + 3 * qd + 2 * np.sign(qd)
    tau += 0.2 * np.random.default_rng(0).normal(size=q.shape)
    with pytest.warns(rne.IdentificationWarning, match="^torques in motion that the model does not explain: joint_1 1"):
        found = rne.identify(robot, Record(t, q, -tau), causes=False, folds=2)
    assert found.consistent  # on every processor: the minimum is there, whatever it leaves of the torques
    assert found.unexplained.in_motion[0] > 1
    monkeypatch.setattr("rne.identification.fit.least_squares.consistent_fit", fail)
    with pytest.warns(
        rne.IdentificationWarning, match="^the likely cause: the torques of all joints have the wrong sign"
    ):
        found = rne.identify(robot, Record(t, q, -tau))
    assert not found.consistent
    assert any(
        note.startswith("parameters are those of least squares, as with `consistent=False`") for note in found.notes
    )
    with pytest.raises(rne.IdentificationError, match="correct what `causes` name first"):
        _ = found.robot


SCARA = faults.from_text(faults.SCARA)


def swings(robot, rotors=0.0):
    """Times, positions and torques of the SCARA or of its first joints."""
    t, w, size = np.arange(0, 8, 0.008), 2 * np.pi * np.array([0.31, 0.44, 0.55, 0.7]), np.array([1, 1, 0.1, 1])
    q, qd, qdd = size * np.sin(np.outer(t, w)), size * w * np.cos(np.outer(t, w)), -size * w**2 * np.sin(np.outer(t, w))
    q, qd, qdd = (x[:, : robot.n] for x in (q, qd, qdd))
    tau = robot.inverse_dynamics(q, qd, qdd) + 0.5 * qd + rotors * qdd
    return t, q, tau + 0.005 * np.abs(tau).max(0) * np.random.default_rng(0).normal(size=q.shape)


def test_joints_that_are_not_in_the_log_are_locked_and_others_taken_by_name():
    locked = SCARA.locked({"d": 0.0})
    t, q, tau = swings(locked)
    log = Record(t, q[:, [2, 0, 1]], tau[:, [2, 0, 1]], joint_names=["c", "a", "b"])
    plain = Record(t, q, tau, joint_names=["a", "b", "c"])
    turning = replace_names(Record(t, np.c_[q, np.sin(t)], np.c_[tau, tau[:, 2]]), ["a", "b", "c", "d"])
    text = (
        "joints that the robot has locked, and that move in the records: d by 2; fit them too, or take a part in which "
    )
    with pytest.warns(rne.IdentificationWarning, match=f"^{text}they rest \\(`Record.between`\\)$"):
        rne.identify(locked, turning, consistent=False, causes=False, folds=2)
    said = "joints that the records do not have, taken as locked: d at 0"
    with pytest.warns(rne.IdentificationWarning) as warned:
        found = rne.identify(SCARA, log, consistent=False, causes=False)
    assert str(warned[0].message) == f"{said}; if they stood elsewhere, lock them there by `robot.locked`"
    expected = rne.identify(locked, plain, consistent=False, causes=False)
    assert found.notes[0] == said
    assert re.fullmatch(rf"good for .* of all joints of the records below .* Hz: .*; {said}", found.verdict)
    np.testing.assert_array_equal(found.estimate.values, expected.estimate.values)
    np.testing.assert_array_equal(found.check(log).relative, expected.check(plain).relative)
    assert found.consistency().joint_names == ("a", "b", "c")
    order = [0, 1, 2, 2]
    more = Record(t, q[:, order], tau[:, order], joint_names=["a", "b", "c", "force"])
    assert rne.identify(locked, more, consistent=False, causes=False).notes[0] == (
        "force of the records is not a joint of the robot, or locked: left out"
    )


@pytest.mark.parametrize(
    ("names", "error"),
    [
        (
            ["a", "b", "c", "e"],
            "records must name the robot's joints, log has ['a', 'b', 'c', 'e'] and lacks ['d']: give names as the robot has "
            "them, or lock these where they were, `robot.locked({'d': 0.0})`",
        ),
        (
            ["a", "b", "c"],
            "records must be of the same joints, log has ['a', 'b', 'c'], whole ['a', 'b', 'c', 'd']: give `joints` that both "
            "have",
        ),
    ],
)
def test_logs_that_name_joints_differently_are_refused(names, error):
    t, q, tau = swings(SCARA)
    log = Record(t, q[:, : len(names)], tau[:, : len(names)], joint_names=names, name="log")
    whole = Record(t, q, tau, joint_names=SCARA.joint_names, name="whole")
    with pytest.raises(ValueError, match=f"^{re.escape(error)}$"):
        rne.identify(SCARA, log if len(names) == SCARA.n else [log, whole], consistent=False)


def replace_names(record, joint_names):
    return Record(record.t, record.q, record.tau, joint_names=joint_names)


def test_a_log_of_one_joint_of_six_is_refused_and_of_two_is_not():
    arm, t = loaded("irb140"), np.arange(0, 8, 0.01)
    log = Record(t, np.sin(t)[:, None], np.cos(t)[:, None], joint_names=["joint_2"], name="log")
    lost = {f"joint_{k}": 0.0 for k in (1, 3, 4, 5, 6)}
    error = (
        f"records must name the robot's joints, log has ['joint_2'] and lacks {list(lost)}: give names as the robot has "
        f"them, or lock these where they were, `robot.locked({lost})`"
    )
    with pytest.raises(ValueError, match=f"^{re.escape(error)}$"):
        rne.identify(arm, log)
    two = Record(t, np.sin(np.outer(t, [1, 2])), np.cos(np.outer(t, [1, 2])), joint_names=["joint_2", "joint_3"])
    assert of_named_joints(arm, two)[0].joint_names == ("joint_2", "joint_3")
    first = replace_names(
        two, ["joint_1", "joint_2"]
    )  # as rne numbers joints without names, and as this robot's are called
    assert of_named_joints(arm, first)[0].joint_names == ("joint_1", "joint_2")
    assert of_named_joints(arm, first.between(1, 7))[0].joint_names == ("joint_1", "joint_2")
    other = of_named_joints(
        loaded("ur5").locked({"wrist_1_joint": 0, "wrist_2_joint": 0, "wrist_3_joint": 0, "elbow_joint": 0}), first
    )
    assert other[2] == ("joints of record are taken in the robot's order, as they are numbered",)
    assert of_named_joints(arm, replace_names(two, None))[0] is arm


@pytest.mark.parametrize(
    ("robot", "log", "order"),
    [
        (["j1", "j10", "j2"], ["joint_10", "joint_2", "joint_1"], [2, 0, 1]),  # as q_j10, q_j2, q_j1 are read
        (["arm_a3", "arm_a1", "arm_a2"], ["A1", "A2", "A3"], [2, 0, 1]),
        (["x", "y", "z"], ["Joint1", "Joint2", "Joint3"], [0, 1, 2]),
        (["x", "y", "z"], ["joint_0", "joint_1", "joint_2"], [0, 1, 2]),
        (["left_1", "left_2", "left_3"], ["right_1", "right_2", "right_3"], None),
        (["j0", "j1", "j2", "j3"], ["joint_1", "joint_3", "joint_2"], None),  # from 0 or from 1
    ],
)
def test_joints_that_are_numbered_go_by_number_and_else_in_the_robots_order(robot, log, order):
    t, first = np.arange(0, 2, 0.01), first_joints(len(robot)).model
    called = dict(zip(first.moving_joints, robot, strict=True))
    named = rne.Robot(
        dataclasses.replace(
            first, moving_joints=tuple(robot), link_joints=tuple(called.get(x, x) for x in first.link_joints)
        )
    )
    q = np.sin(np.outer(t, [1, 2, 3]))
    record = Record(t, q, q, joint_names=log)
    if order is None:
        with pytest.raises(ValueError, match="records must name the robot's joints, record has"):
            of_named_joints(named, record)
        return
    kept, (given,), _ = of_named_joints(named, record)
    assert kept.joint_names == tuple(robot)
    np.testing.assert_array_equal(given.q, q[:, order])


def test_rotors_are_declined_where_no_joint_feels_one():
    """As by torque sensors behind the gears."""
    t, q, tau = swings(SCARA)
    found = rne.identify(SCARA, Record(t, q, tau), consistent=False)
    assert "Ia" not in found.standard.terms
    assert any(note.startswith("rotors are not fitted") for note in found.notes)
    felt = rne.identify(SCARA, Record(*swings(SCARA, rotors=0.2)), consistent=False, causes=False)
    assert felt.estimate.values[felt.base.names.index("Ia_4")] == pytest.approx(0.2, rel=0.1)
    asked = rne.identify(SCARA, Record(t, q, tau), drives=MEASURED, consistent=False, causes=False)
    assert "Ia" in asked.standard.terms


def test_a_motion_that_excites_nothing_is_told_in_one_sentence():
    """Joints move once and rest: other parts of the log say nothing of it."""
    t = np.arange(0, 20, 0.01)
    q, qd, qdd = rne.trajectories.quintic([0] * 4, [1, 1, 0.1, 1], 4.0)(np.minimum(t, 4.0))
    qd[t >= 4], qdd[t >= 4] = 0, 0
    tau = SCARA.inverse_dynamics(q, qd, qdd) + 0.5 * qd
    tau += 0.01 * np.abs(tau).max(0) * np.random.default_rng(0).normal(size=q.shape)
    with pytest.warns(rne.IdentificationWarning, match=r"^the motion excites too little: \d+ of \d+ base parameters"):
        found = rne.identify(SCARA, Record(t, q, tau), consistent=False, causes=False)
    count, estimate = int((~found.excited).sum()), found.estimate
    assert count < (np.abs(estimate.values) < 2 * estimate.errors).sum()  # the text counts others: of larger errors
    assert f"{count} of 22 base parameters have standard errors above their expected sizes" in found.unexcited
    assert "the model does not explain" not in found.doubt
    assert re.search(r"%.*\n.*  a .*> 1000", found.report(details=True))
    worse = 100 * (found.unexplained.in_motion - found.essential().unexplained.in_motion).max()
    assert worse > 100  # parameters that these data do not determine spoil the prediction of the other blocks
    assert f"suffice, the others raise the validation error by up to {worse:.1f} %" in found.report()


def test_the_report_says_how_far_the_prior_moves_what_is_known(found):
    shift = np.abs(found.values - found.estimate.values) / found.estimate.errors
    text = f"moves base parameters by up to {shift.max():.1f} of their standard errors"
    assert text in found.report(details=True)


def test_errors_of_each_motion_show_the_bad_one(scene, motions):
    good, other, bad = (
        Record(*measure(motions[0], k, torque_noise=NOISE[: scene.n]), name=name)
        for k, name in enumerate(("good", "good too", "bad"))
    )
    bad = Record(bad.t, bad.q, bad.tau * np.array([1, 1, -1, 1, 1, 1])[: scene.n], name="bad")
    options = {"drives": rne.DriveModel(friction="viscous+coulomb"), "folds": 2, "consistent": False, "causes": False}
    with pytest.warns(rne.IdentificationWarning):
        text = rne.identify(scene.robot, [good, other, bad], **options).report()
    lines = {line.split()[0]: line.split() for line in text.split("errors of each motion [%]")[1].splitlines()[1:4]}
    assert float(lines["bad"][3]) > 2 * float(lines["good"][3])


def test_low_speeds_are_left_out_with_coulomb_friction(found, scene, motions):
    assert (found.minimum_velocity > 0).all()
    every, fast = (
        identified(scene, motions[1], 0, consistent=False, folds=2, minimum_velocity=least)
        for least in (np.zeros(scene.n), None)
    )
    assert every.equations.rows.sum() > fast.equations.rows.sum()


def short():
    t = np.arange(0, 6, 0.01)
    q = np.sin(np.outer(t, np.arange(1, 7)))
    return t, q


@pytest.mark.parametrize(
    ("kind", "make", "text"),
    [
        (
            TypeError,
            lambda r, rec: rne.identify("irb140", rec, drives=rne.DriveModel()),
            "`robot` must be an rne.Robot, got str",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(r, [], drives=rne.DriveModel()),
            "`records` must have at least one record",
        ),
        (
            TypeError,
            lambda r, rec: rne.identify(r, [3], drives=rne.DriveModel()),
            "`records` must be an rne.identification.Record or several, got int",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(loaded("panda"), rec, drives=rne.DriveModel()),
            "`records` must be of the joints ['panda_joint1', 'panda_joint2', 'panda_joint3', 'panda_joint4', "
            "'panda_joint5', 'panda_joint6', 'panda_joint7', 'panda_finger_joint1'], 'record' has 6 joints without names: "
            "give the names of those measured as `joint_names` of the Record, or lock the others: "
            "`robot.locked({'panda_joint7': 0, 'panda_finger_joint1': 0})`",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(
                r, [rec, Record(rec.t, rec.q, rec.tau, joint_names=tuple("abcdef"))], drives=rne.DriveModel()
            ),
            "`records` must be of the joints ['joint_1', 'joint_2', 'joint_3', 'joint_4', 'joint_5', 'joint_6'], 'record' has "
            "['a', 'b', 'c', 'd', 'e', 'f']: name the joints of all records as the robot does, by `joint_names` of the Record",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(
                r,
                [rec, Record(rec.t, rec.q[:, 1:], rec.tau[:, 1:], joint_names=r.joint_names[1:])],
                drives=rne.DriveModel(),
            ),
            "`records` must be of the joints ['joint_1', 'joint_2', 'joint_3', 'joint_4', 'joint_5', 'joint_6'], 'record' has "
            "['joint_2', 'joint_3', 'joint_4', 'joint_5', 'joint_6']: name the joints of all records as the robot does, by "
            "`joint_names` of the Record, or lock the others: `robot.locked({'joint_1': 0})`",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(r, rec, drives=rne.DriveModel(), prior_std=0.0),
            "`prior_std` must be positive, got 0.0",
        ),
        (
            TypeError,
            lambda r, rec: rne.identify(r, rec, drives=rne.DriveModel(), prior="urdf"),
            "`prior` must be an rne.Robot or 'geometry', got 'urdf'",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(r, rec, drives=rne.DriveModel(), prior=loaded("panda")),
            "`prior` must have the joints ['joint_1', 'joint_2', 'joint_3', 'joint_4', 'joint_5', 'joint_6']",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(
                rne.Robot(rne.model.with_parameters(r.model, 0 * r.parameters)), rec, drives=rne.DriveModel()
            ),
            "`prior` must have masses, which the robot does not: give another robot, or 'geometry' for rods between the "
            "joints, or `consistent=False`",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(
                r, rec, drives=rne.DriveModel(rotor=True, friction="viscous+coulomb", offset=True), cutoff=0.9
            ),
            "`records` give 25 equations for 58 base parameters: a longer motion is needed, or a higher `cutoff`",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(r, [rec, Record(rec.t + 9, rec.q, rec.tau, name="copy")]),
            "`records` has the same measurements twice, 'record' and 'copy': one is the wrong file, or to be left out, since "
            "blocks of one are predicted by fits to the other",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(r, Record(rec.t, rec.q, 0 * rec.tau + 5)),
            "`records` give no equations: joint_1 has no torque that can be used: constant torque of 5 in all samples and so "
            "on: record torques in motion",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(
                r, Record(rec.t, rec.q, rec.tau, joint_names=list("abcdef")), drives=rne.DriveModel()
            ),
            "records must name the robot's joints, record has ['a', 'b', 'c', 'd', 'e', 'f'] and lacks ['joint_1', "
            "'joint_2', 'joint_3', 'joint_4', 'joint_5', 'joint_6']: give names as the robot has them",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(r, rec, drives=rne.DriveModel(), folds=1),
            "`folds` must be a whole number of at least 2, got 1",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(r, rec, drives=rne.DriveModel(), prior="geometry", consistent=False),
            "`prior` is for the physically consistent fit: leave it out, or set `consistent=True`",
        ),
        (
            rne.NotFiniteError,
            lambda r, rec: rne.identify(r, Record(rec.t, rec.q, rec.tau * 1e300), drives=rne.DriveModel()),
            "the equations overflow: torques or velocities of the measurements are too large",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(r, rec, delay=[0, 0, -5, 0, 0, 2]),
            "`delay` must be at most 1 s, got 5: give seconds, 0.005 for 5 ms",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(r, Record(rec.t, rec.q, rec.tau, joint_names=["joint1", *r.joint_names[1:]])),
            "records must name the robot's joints, record has ['joint1', 'joint_2', 'joint_3', 'joint_4', 'joint_5', "
            "'joint_6'] and lacks ['joint_1']: give names as the robot has them, or lock these where they were, "
            "`robot.locked({'joint_1': 0.0})`",
        ),
        (
            TypeError,
            lambda r, rec: rne.identify(r, None),
            "`records` must be an rne.identification.Record or several, got NoneType",
        ),
        (
            ValueError,
            lambda r, rec: rne.DriveModel("viscous"),
            "`rotor` and `offset` must be True or False, got 'viscous' and False",
        ),
        (
            ValueError,
            lambda r, rec: rne.identify(r, rec, drives=rne.DriveModel(), minimum_velocity=[0.1]),
            "`minimum_velocity` must have shape (6,), got (1,)",
        ),
    ],
)
def test_errors(kind, make, text):
    robot = loaded("irb140")
    t, q = short()
    rec = Record(t, q, robot.gravity_torque(q))
    with pytest.raises(kind, match=f"^{re.escape(text)}$"):
        make(robot, rec)


def test_torques_with_the_wrong_sign_are_not_explained_by_bodies(scene, motions):
    t, q, tau = measure(motions[0])
    with pytest.raises(rne.IdentificationError, match="the torques ask for bodies of -"):
        rne.identify(
            scene.robot, Record(t, q, -tau), drives=rne.DriveModel(friction="viscous+coulomb"), prior="geometry"
        )


def test_bodies_of_least_squares_that_have_no_mass_are_no_robot():
    """Torques do not tell the mass of a body that turns about a fixed axis: it is the given one."""
    known = first_joints()
    t, w = np.arange(0, 10, 0.01), np.array([1.3, 2.1, 3.4])
    q, qd, qdd = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
    record = Record(t, q, known.inverse_dynamics(q, qd, qdd))
    light = known.with_parameters(0 * known.parameters)
    found = rne.identify(light, record, drives=rne.DriveModel(), consistent=False, causes=False)
    text = (
        "least squares gave no possible bodies: fit with `consistent=True`; `parameters`: the body of joint 'joint_2' "
        "has a first moment and no mass"
    )
    with pytest.raises(rne.IdentificationError, match=f"^{re.escape(text)}$"):
        _ = found.robot


def test_plot_has_a_panel_per_joint_and_no_line_across_a_gap(scene, motions):
    t, q, tau = measure(motions[0], torque_noise=NOISE[: scene.n])
    kept = (t < 5) | (t > 6)
    found = rne.identify(
        scene.robot,
        Record(t[kept], q[kept], tau[kept]),
        drives=rne.DriveModel(friction="viscous+coulomb"),
        consistent=False,
        causes=False,
    )
    figure = found.plot()
    assert [ax.get_title(loc="left") for ax in figure.axes[::2]] == list(scene.robot.joint_names)
    assert [ax.get_xlabel() for ax in figure.axes[-2:]] == ["time [s]", ""]  # the second is over velocity, as above it
    for line in figure.axes[4].lines:
        x, y = line.get_xdata(), line.get_ydata()
        (gap,) = np.flatnonzero(np.isnan(y))
        assert x[gap - 1] < 5 < 6 < x[gap + 1]


def test_a_motion_beyond_the_limits_is_told_before_the_verdict():
    """A log in degrees that moves little passes no two turns: read as radians, it leaves the limits."""
    robot = first_joints(3).with_limits(velocity=[1.0, 2.0, 9.0])
    robot = rne.Robot(dataclasses.replace(robot.model, lower=robot.lower * [1, 1, 0.1]))
    t = np.arange(0, 10, 0.01)
    q = np.array([1.5, 4.0, 0.5]) * np.sin(np.pi / 5 * t)[:, None]
    ends = (
        f"joint_2 reaches 4, its limit is {robot.upper[1]:.3g}; joint_3 reaches -0.5, its limit is {robot.lower[2]:.3g}"
    )
    tau, base = np.cos(np.outer(t, [1.0, 2.0, 3.0])), robot.base_parameters()

    def notes(robot, q):
        return regression(robot, Record(t, q, tau), base, cutoff=5.0).notes

    (note,) = notes(robot, q)
    assert (
        note
        == f"the motion leaves the robot's limits: in other units, or from another zero? {ends}; joint_2 reaches 2.51/s, its limit is 2/s"
    )
    assert notes(robot, 0.3 * q) == ()
    unlimited = rne.Robot(dataclasses.replace(robot.model, lower=0 * robot.lower, upper=0 * robot.upper))
    assert notes(unlimited, 0.3 * q) == ()  # as a URDF without `lower` and `upper` is read
