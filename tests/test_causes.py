"""Causes of what an identification leaves unexplained, on simulated logs of which the fault is known."""

import collections
import dataclasses
import functools
import itertools
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import rne
from rne.dynamics.regressors import gravity_torques
from rne.identification import Record, fit_base_parameters, regression, thresholds
from rne.identification.diagnosis import hypotheses
from rne.identification.diagnosis.hypotheses import (
    contacts,
    dissipates,
    friction,
    gravity_directions,
    ratio_columns,
    stribeck_columns,
)
from rne.identification.diagnosis.residuals import FitResiduals

from . import faulty_logs as faults
from .conftest import TREES
from .helpers import first_joints, kept

QUICK = {
    "gear +10 %": "SCARA",
    "payload half-way": "gantry",
    "contact": "mimic",
    "slip": "mimic",
    "drift of friction": "mimic",
    "N mm": "gantry",
    "sign": "gantry",
    "swapped joints": "mimic",
    "swapped torques": "mimic",
    "zero 0.1 rad": "SCARA",
    "gravity's direction": "mimic",
    "degrees": "mimic",
    "ms": "gantry",
    "clipping": "gantry",
}
# of other short tests below, or found as others are: by time as "drift of friction", by unit as "ms"
ELSEWHERE = {
    "payload half-way",
    "swapped joints",
    "swapped torques",
    "gravity's direction",
    "contact",
    "slip",
    "N mm",
    "degrees",
    "ms",
    "sign",
}
FRICTION = rne.DriveModel(friction="viscous+coulomb")


@pytest.fixture(autouse=True)
def half_of_a_log(request, monkeypatch):
    """Logs of short tests have half the length and half the rate, unless they need all of it."""
    if "whole_log" not in request.fixturenames and not request.node.get_closest_marker("long"):
        monkeypatch.setattr(faults, "DURATION", 10.0)
        monkeypatch.setattr(faults, "RATE", 250.0)


@pytest.fixture
def whole_log():
    """Asked for by tests that need logs of full length."""


@pytest.mark.parametrize("fault", kept(QUICK, [fault for fault in QUICK if fault not in ELSEWHERE]))
def test_a_fault_is_named_among_the_first_two_causes(fault):
    outcome = faults.run(fault, QUICK[fault], 7)
    assert outcome.warned, outcome
    assert outcome.named, outcome


@pytest.mark.long
@pytest.mark.parametrize("fault", faults.FAULTS)
@pytest.mark.parametrize("robot", ["IRB 140", "Panda", "SCARA"])
def test_parameters_are_right_or_the_fault_is_named(robot, fault):
    outcome = faults.run(fault, robot, 70)
    assert not outcome.wrong or outcome.named or outcome.hidden, outcome


@pytest.mark.parametrize("seed", kept(range(12), [1]))
def test_nothing_is_blamed_on_a_clean_log(seed):
    outcome = faults.run("clean", ["SCARA", "gantry", "mimic"][seed % 3], seed)
    assert not outcome.warned, outcome
    assert not outcome.wrong, outcome


def case(robot, seed):
    """A log's case with friction as the fit has it, and without a delay."""
    return faults.case(robot, seed, linear=True)


def truth_of(c, found):
    """The base parameters of a case."""
    x, groups = np.zeros(found.standard.count), found.standard.groups
    x[groups["bodies"]] = c.arm.robot.parameters
    for symbol, values in (("Ia", c.arm.rotor), ("Fv", c.arm.viscous), ("Fc", c.arm.coulomb), ("tau0", c.arm.offset)):
        x[groups[symbol]] = values
    return found.base.matrix @ x


def identified(fault, robot="SCARA", seed=3, **options):
    data = fault(case(robot, seed))
    return rne.identify(known_robot(robot, seed), Record(data.t, data.q, data.tau), consistent=False, **options)


@functools.cache
def known_robot(robot, seed):
    """The robot given, with masses that are wrong: one for all logs of a robot, for it keeps the kernels it traces."""
    return faults.given_robot(faults.robots()[robot], np.random.default_rng(seed))


@pytest.mark.parametrize("ms", kept([1.0, -2.0, 5.0], [-2.0]))
def test_delays_are_found_taken_into_account_and_stated(ms):
    found = identified(faults.delayed(ms), causes=False)
    assert (np.abs(1000 * found.delay - ms) < 0.3).all()
    assert found.delay.shape == (1, 4)
    assert "delay of" in found.report(details=True)
    assert (found.unexplained.in_motion < 0.004).all()


def test_each_record_has_its_own_delay():
    """Of two motions one is logged 8 ms late; a third, as late as both on average, is predicted at that time."""
    cases = [case("SCARA", 3), case("SCARA", 3), case("SCARA", 3)]
    logs = [faults.delayed(ms)(c) for ms, c in zip((8.0, 0.0, 4.0), cases, strict=True)]
    records = [Record(data.t, data.q, data.tau) for data in logs]
    found = rne.identify(known_robot("SCARA", 3), records[:2], consistent=False, causes=False)
    np.testing.assert_allclose(1000 * found.delay, np.outer([8, 0], np.ones(4)), atol=0.3)
    assert (found.check(records[2]).relative < 0.01).all()  # friction of the log is a step, that predicted is smooth


@pytest.mark.filterwarnings("ignore::rne.IdentificationWarning")
def test_delays_are_found_whatever_else_is_found():
    """Three logs with a payload taken up in the second: each has its own delay."""
    cases, late = [faults.case("mimic", 3) for _ in range(3)], (0.0106, 0.0123, 0.004)
    cases = [c._replace(late=x) for c, x in zip(cases, late, strict=True)]
    known = known_robot("mimic", 3)
    logs = [make(c) for make, c in zip((faults.clean, faults.payload, faults.clean), cases, strict=True)]
    records = [Record(data.t, data.q, data.tau) for data in logs]
    found = rne.identify(known, records, consistent=False).delay
    np.testing.assert_allclose(found[1], late[1], atol=3e-3)  # three standard errors of the payload log
    np.testing.assert_allclose(found[[0, 2]], np.outer([0.0106, 0.004], np.ones(2)), atol=1e-3)


@pytest.mark.parametrize("fault", kept(["swapped joints", "sign", "contact"], ["sign"]))
def test_a_delay_is_a_number_of_the_fit_beside_a_gross_fault(fault):
    c = faults.case("SCARA", 5)
    data = faults.FAULTS[fault][0](c)
    known = known_robot("SCARA", 3)
    with pytest.warns(rne.IdentificationWarning):
        found = rne.identify(known, Record(data.t, data.q, data.tau), consistent=False, cutoff=5.0)
    np.testing.assert_allclose(found.delay, c.late, rtol=0.2)


def test_friction_of_harmonic_drives_is_told_without_a_warning():
    """It rises with the load and saturates with speed."""
    outcome = faults.run("clean", "gantry", 4)
    assert not outcome.warned, outcome
    assert outcome.causes[0] == "friction under load"


def test_a_delay_that_is_given_is_not_estimated():
    found = identified(faults.delayed(5.0), delay=0.005, causes=False)
    assert (found.delay == 0.005).all()
    assert "taken into account" not in found.report(details=True)


def test_stribeck_friction_is_modelled_where_the_log_asks_for_it():
    found = identified(faults.stribeck, "gantry", causes=False)
    assert (np.asarray(found.standard.drives.stribeck) > 0).any()
    assert any(name.startswith("Fs_") for name in found.base.names)
    (note,) = [note for note in found.notes if note.startswith("Stribeck friction: ")][:1]
    name, size = re.search(r"friction of (\S+) is (\S+) N(?: m)? more at rest", note).groups()
    fitted = found.estimate.values[found.base.names.index(f"Fs_{found.initial.joint_names.index(name) + 1}")]
    assert float(size) == pytest.approx(fitted, rel=0.1)
    assert (found.unexplained.in_motion < 0.004).all()


def test_drives_that_were_declined_are_proposed():
    """Without friction as asked for, friction is the first cause; with friction alone, the rotors are."""
    with pytest.warns(rne.IdentificationWarning, match="friction.* which was not asked for"):
        bare = identified(faults.clean, "gantry", drives=rne.DriveModel())
    assert "friction" in bare.causes[0].kind
    assert "friction changed" not in [cause.kind for cause in bare.causes]
    for count, words in ((1, "the likely cause: "), (2, "likely causes: ")):
        assert words in dataclasses.replace(bare, causes=bare.causes[:count]).doubt
    assert clean_without_rotors().causes[0].kind == "rotor"
    assert re.search("a rotor.* which was not asked for", clean_without_rotors().doubt)


@functools.cache
def clean_without_rotors():
    """A clean log, half of one, fitted with friction alone."""
    with pytest.warns(rne.IdentificationWarning):
        return identified(faults.clean, drives=FRICTION)


def cable(q, qd, qdd):
    """The torque of a cable about the second of four joints, per unit of its pull."""
    return np.cos(3 * q)[..., None] * np.eye(4)[:, [1]]


CABLE = rne.identification.Hypothesis("cable", cable, "a cable pulls with {:.3g} N m", ("b",))


def test_a_hypothesis_of_the_user_is_judged_as_those_of_the_package():
    """Planted with a tenth of the joint's torque in a log, it is the first cause, of its size; a clean log has none."""

    def pulled(c):
        return faults.log(c, c.tau + 0.1 * c.size[1] * cable(*c.states)[..., 0])

    size = 0.1 * case("SCARA", 3).size[1]
    with pytest.warns(rne.IdentificationWarning, match="the likely cause: a cable pulls with|likely causes: a cable"):
        first = identified(pulled, hypotheses=[CABLE]).causes[0]
    assert (first.kind, first.joints) == ("cable", ("b",))
    assert abs(first.value - size) < 3 * first.error < size
    assert "cable" not in {cause.kind for cause in identified(faults.clean, hypotheses=[CABLE]).causes}


def test_a_hypothesis_of_the_user_names_a_difference_of_models_alone_and_beside_others():
    robot = faults.robots()["SCARA"]

    def other(q, qd, qdd):
        return robot.inverse_dynamics(q, qd, qdd) + 2 * cable(q, qd, qdd)[..., 0]

    assert rne.compare_models(robot, other).cause == "unknown"
    found = rne.compare_models(robot, other, hypotheses=[CABLE])
    assert (found.cause, found.text) == ("cable", "a cable pulls with 2 N m")
    both = rne.compare_models(robot, lambda *x: other(*x) + 0.3 * x[2], hypotheses=[CABLE])
    assert set(both.causes) == {"cable", "armature"}


def test_a_hypothesis_that_is_none_is_refused():
    wrong = rne.identification.Hypothesis("flat", lambda q, qd, qdd: q, "{:.3g}")
    message = "`columns` of the hypothesis 'flat' must be finite, of shape (120, 4, k), got (120, 4)"
    robot = faults.robots()["SCARA"]
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        rne.compare_models(robot, robot.with_payload(1.0), hypotheses=[wrong])
    message = "`hypotheses` must be a sequence of rne.identification.Hypothesis, got [3]"
    with pytest.raises(TypeError, match=f"^{re.escape(message)}$"):
        identified(faults.clean, hypotheses=[3])


def scaled_times(c):
    data = faults.clean(c)
    return data._replace(t=1.05 * data.t)


def pulled(c):
    return faults.log(c, c.tau + 0.5 * c.size * (c.states[0] - 0.3) * np.eye(len(c.size))[1])


def one_sided(c):
    return faults.log(c, c.tau + 0.05 * c.size * np.abs(c.states[1]) * np.eye(len(c.size))[0])


def coupled(c):
    """The motor of the second joint turns with the first one too, and its measurements are taken for the joint's."""
    data = faults.clean(c)
    q, tau = data.q.copy(), data.tau.copy()
    q[:, 1] += q[:, 0]
    tau[:, 0] -= tau[:, 1]
    return data._replace(q=q, tau=tau)


def interchanged(c):
    data, order = faults.clean(c), [1, 0, 2, 3]
    return data._replace(q=data.q[:, order], tau=data.tau[:, order])


def turned(c):
    """The second joint is logged with the other sign."""
    data, signs = faults.clean(c), np.array([1, -1, 1, 1])
    return data._replace(q=data.q * signs, tau=data.tau * signs)


def drifting(c):
    return faults.log(c, c.tau + np.outer(c.t / c.t[-1], [0, 0.5 * c.size[1], 0, 0]))


def tilted(c):
    robot = c.arm.robot
    other = rne.Robot(dataclasses.replace(robot.model, gravity=9.81 * np.array([0.5, 0, -np.sqrt(0.75)])))
    return faults.log(c, c.tau + other.gravity_torque(c.states[0]) - robot.gravity_torque(c.states[0]))


@pytest.mark.parametrize(
    ("fault", "kind", "joints", "text"),
    [
        (interchanged, "joint order", (0, 1), r"are interchanged"),
        pytest.param(turned, "joint sign", (1,), r"turns the other way", marks=pytest.mark.long),
        (drifting, "offset drifts", (1,), r"drifts"),
        pytest.param(
            tilted, "gravity direction", (), r"along \(0\.[45]\d, -?0\.0\d, -0\.[89]\d\)", marks=pytest.mark.long
        ),
    ],
)
def test_the_likeliest_cause_of_a_kind_names_its_joints_and_direction(fault, kind, joints, text):
    with pytest.warns(rne.IdentificationWarning):
        found = identified(fault)
    cause = next(cause for cause in found.causes if cause.kind == kind)
    assert cause.joints[: len(joints)] == tuple(found.initial.joint_names[j] for j in joints)
    assert re.search(text, cause.text), cause.text
    assert fault is not drifting or cause.value > 0


def residuals():
    """What the true masses and no friction leave of a clean log."""
    c = case("gantry", 3)
    data, robot = faults.clean(c), c.arm.robot
    base = robot.base_parameters(drives=FRICTION)
    rows = regression(robot, Record(data.t, data.q, data.tau), base, cutoff=5.0, folds=2)
    unit = np.ones(robot.n)
    return FitResiduals(robot, base, rows, base.matrix @ base.standard.values, unit, 2 * unit)


def test_columns_of_each_joint_are_those_of_that_joint():
    """A gear ratio multiplies the motion and the torque of its joint; friction acts on its joint alone."""
    res, h = residuals(), 1e-3
    of_ratios, of_friction = ratio_columns(res), stribeck_columns(res, 0.2)
    for j, unit in enumerate(np.eye(res.robot.n)):
        both = [res.sampled(lambda *x, k=1 + s * h * unit: k * res.load(*(k * y for y in x))) for s in (1, -1)]
        expected = (both[0] - both[1]) / (2 * h)
        np.testing.assert_allclose(of_ratios[..., j], expected, atol=1e-4 * np.abs(expected).max())
        alone = res.sampled(lambda q, qd, qdd, j=j: np.sign(qd[:, j]) * np.exp(-np.abs(qd[:, j]) / 0.2))
        np.testing.assert_array_equal(of_friction[..., j], alone[:, None] * unit)


def test_torques_by_the_stribeck_velocity_are_those_of_the_friction_that_was_fitted():
    """The derivative of Fs exp(-|qd| / vs) by vs."""
    res, j, vs = residuals(), 1, 0.2
    names, sizes = [f"Fs_{k + 1}" for k in range(res.robot.n)], 2.0 + np.arange(res.robot.n)
    standard = SimpleNamespace(groups={"Fs": slice(3, 3 + len(names))})
    rest = SimpleNamespace(**{name: getattr(res, name) for name in ("robot", "names", "of_each_joint")})
    rest.standard, rest.x = standard, np.concatenate([np.full(3, 50.0), sizes])
    cause = SimpleNamespace(kind=hypotheses.STRIBECK, joints=(res.names[j],), at=vs)
    found = hypotheses.derivative_by(rest, cause)[..., 0]
    expected = res.sampled(lambda q, qd, qdd: np.sign(qd) * np.abs(qd) / vs**2 * np.exp(-np.abs(qd) / vs))
    expected = sizes[j] * expected * np.eye(res.robot.n)[j]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())  # of a difference


def test_changes_begin_in_the_order_of_the_records_and_name_them():
    times = np.arange(100) / 10
    rest = SimpleNamespace(records=[SimpleNamespace(times=times, start=0.0), SimpleNamespace(times=times, start=0.0)])
    texts, since = hypotheses.starts(rest)
    assert [text.partition(" of ")[2] for text in texts] == sorted(["record 1", "record 2"] * (len(texts) // 2))
    assert (np.diff(since.astype(int), axis=1) >= 0).all()
    assert (np.diff(since.sum(axis=1)) < 0).all()


def test_friction_may_rise_and_fall_again_during_a_log():
    """Friction that follows a parabola of time is in the span of the columns of each joint."""
    res = residuals()
    (family,) = [h for h in hypotheses.changing(res) if h.kind == "friction changed"]
    passed = hypotheses.progress(res)
    viscous = res.sampled(lambda q, qd, qdd: qd)[..., None] * (passed - passed.mean()) ** 2
    columns = family.columns.reshape(*res.tau.shape, -1)[:, 0]
    left = viscous[:, 0, 0] - columns @ np.linalg.lstsq(columns, viscous[:, 0, 0], rcond=None)[0]
    assert np.abs(left).max() < 1e-9 * np.abs(viscous[:, 0, 0]).max()  # rounding


def test_hypotheses_of_one_kind_are_one_object():
    """Families of joints and of times, as many places in time as there are."""
    kinds = hypotheses.delays, hypotheses.joints, hypotheses.changing, hypotheses.payloads, contacts, friction
    found = [h for kind in kinds for h in kind(residuals())]
    assert len(found) < 25
    windows = sum(2 * thresholds.PLACES + 1 - width for width in thresholds.WIDTHS)
    assert sum(len(h.masks) for h in found if h.masks is not None) == 2 * thresholds.PLACES + windows


def test_a_family_is_judged_as_its_members_alone():
    """The best place of each joint's encoder slip, its number and its score."""
    res = residuals()
    (family,) = [h for h in hypotheses.joints(res) if h.kind == "encoder slip"]
    for j, (cause, columns, c) in enumerate(hypotheses.judged(res, family)):
        alone = [dataclasses.replace(family, masks=family.masks[[m]]) for m in range(len(family.masks))]
        each = [list(hypotheses.judged(res, h))[j] for h in alone]
        best = max(each, key=lambda x: x[0].score)
        assert (cause.joints, cause.score, cause.value) == (best[0].joints, best[0].score, best[0].value)
        np.testing.assert_array_equal(columns, best[1])
        assert c.shape == (1,)


@pytest.mark.long
def test_a_clean_log_makes_few_objects():
    """Of hypotheses, causes and fits: of a UR5's log of 10 s, kernels traced before."""
    robot, t, rng = rne.load("ur5"), np.arange(0, 10, 0.002), np.random.default_rng(0)
    q, qd, qdd = faults.motion(robot, rng, t)
    tau = robot.inverse_dynamics(q, qd, qdd)
    tau += np.sqrt((tau**2).mean(0)) * (0.1 * np.sign(qd) + 0.1 * qd + 0.01 * rng.standard_normal(q.shape))
    rne.identify(robot, Record(t, q, tau))
    made = collections.Counter()

    def count(frame, event, _):
        known = frame.f_locals
        if event == "call" and (frame.f_code.co_name == "__init__" or "_cls" in known):
            kind = known["_cls"] if "_cls" in known else type(known.get("self"))
            made[kind] += kind.__module__.startswith("rne")

    sys.setprofile(count)
    try:
        rne.identify(robot, Record(t, q, tau))
    finally:
        sys.setprofile(None)
    assert made.total() <= 300, made
    ours = {kind.__name__ for kind, many in made.items() if many and "diagnosis" in kind.__module__}
    assert ours <= {"Cause", "Convention", "FitResiduals", "Hypothesis"}


def test_friction_under_load_has_the_load_of_the_law_of_the_drives():
    """That of bodies, rotors and springs: the cause has the column that a fit has for Fl."""
    c = case("gantry", 3)
    data, robot = faults.clean(c), c.arm.robot
    springs, drives = [rne.Spring.at_joint("y", 1.0, 0.1)], rne.DriveModel(rotor=True, friction="coulomb")
    options = {"cutoff": 5.0, "folds": 2, "consistent": False, "causes": False, "delay": 0.0}
    found = rne.identify(robot, Record(data.t, data.q, data.tau), drives=drives, springs=springs, **options)
    base, rows = found.base, found.data
    rest = FitResiduals(robot, base, rows, np.arange(1.0, base.count + 1), np.ones(4), np.ones(4))
    groups, x = base.standard.groups, rest.x
    under_load = dataclasses.replace(base.standard, drives=rne.DriveModel(rotor=True, friction="load"))
    known = np.concatenate([x[groups["bodies"]], x[groups["Ia"]], np.zeros(4), x[groups["springs"]]])

    def load(q, qd, qdd):
        pull = x[groups["springs"]] * (q - [0, 0.1, 0, 0]) * [0, 1, 0, 0]
        return robot.inverse_dynamics(q, qd, qdd, parameters=x[groups["bodies"]]) + x[groups["Ia"]] * qdd + pull

    def of_fit(q, qd, qdd):
        passed = under_load.load(robot.regressor(q, qd, qdd), q, qdd, known)
        return under_load.drive_columns(qd, qdd, passed)[..., np.arange(4), 4 + np.arange(4)]

    expected = rest.sampled(lambda q, qd, qdd: np.abs(load(q, qd, qdd)) * np.sign(qd))
    (family,) = [h for h in friction(rest) if h.kind == "friction under load"]
    for found in (rest.curves[..., 0], rest.sampled(of_fit)):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_array_equal(family.columns[:, 1, family.joints.index("y")], rest.curves[:, 1, 0])


def test_columns_from_few_samples_are_those_of_the_filter():
    """Smooth ones within 1 %; a step, of which the filter's response to 1.25 periods leaves 1 %, within 3 %."""
    res, used = residuals(), residuals().used[:, 0]
    for values, tolerance in ((lambda q, qd, qdd: q * qdd, 0.01), (lambda q, qd, qdd: np.sign(qd), 0.03)):
        exact, few = res.sampled(values), res.near_rows(values)
        assert np.abs(few - exact)[used].max() < tolerance * np.abs(exact).max()
    rows = np.arange(len(used)) % 3 == 0
    thin = res._with(res.sigma, res.correlation_time, None, res.used & rows[:, None])
    np.testing.assert_array_equal(thin.near_rows(values)[~rows], 0)
    np.testing.assert_allclose(thin.near_rows(values)[rows & used], few[rows & used], atol=1e-12)


def test_a_contact_is_told_with_its_force_and_its_times():
    res = residuals()
    record, (family,) = res.records[0], contacts(res)
    on = np.flatnonzero(family.masks[7])
    newtons, *times = map(float, re.findall(r"[0-9.]+(?= N| s)", family.text(np.array([3.0, 0, 4.0]), 0, 7)))
    assert newtons == 5
    np.testing.assert_allclose(times, record.times[on[[0, -1]]] - record.start, atol=np.diff(record.times).max() + 0.05)
    assert 0 < times[0] < times[1]


def test_friction_dissipates_where_its_mean_power_is_positive():
    """Viscous and Coulomb friction of any signs: what one of them takes the other may give."""
    res = residuals()
    groups, qd = res.standard.groups, res.records[0].qd
    for viscous, coulomb in np.random.default_rng(0).normal(size=(20, 2, res.robot.n)):
        res.x[groups["Fv"]], res.x[groups["Fc"]] = viscous, coulomb
        power = (qd * (viscous * qd + coulomb * np.sign(qd))).mean(0)
        np.testing.assert_array_equal(dissipates(res), power > 0)


def test_joints_in_their_own_order_move_the_columns_of_the_fit():
    """The general path, J close to 1, against the equations that the fit has."""
    res = residuals()
    moved, own = (res.moved(J, res.tau) for J in (np.eye(4) * (1 + 1e-9), np.eye(4)))
    np.testing.assert_array_equal(own, res.Y @ res.base.back)
    lengths = np.linalg.norm(own[res.used], axis=0)
    np.testing.assert_array_less(np.linalg.norm((moved - own)[res.used], axis=0), 0.02 * lengths)


def test_changes_are_fitted_with_the_weights_of_what_they_leave():
    """As the fit of the package, whose weights have converged, wherever the residuals' weights are."""
    res = residuals()
    fit = fit_base_parameters(res.base, res.data)
    for sigma in (res.sigma, np.array([1e-3, 1e3, 1, 1]) * res.sigma):
        x, noise, left = res._with(sigma, res.correlation_time, None, res.data.used).refitted(
            res.moved(np.eye(4), res.tau), res.tau
        )
        np.testing.assert_array_less(
            np.abs(x - fit.values), 0.15 * fit.errors
        )  # which contain the correlation of residuals
        np.testing.assert_allclose(noise, fit.sigma, rtol=0.1)  # of rows, not of degrees of freedom
        np.testing.assert_allclose(np.sqrt(left), res.data.fitted.shares(res.base.back @ fit.values), rtol=0.01)


def test_columns_add_to_the_covariance_what_a_fit_with_them_has_more():
    res = residuals()
    base = res.base
    X = np.random.default_rng(0).normal(size=(*res.tau.shape, 2)) + 3 * (res.Y @ base.back)[..., :2]
    both = np.column_stack([res.A, res.weighted(X)])
    more = np.linalg.inv(both.T @ both)[: base.count, : base.count] - np.linalg.inv(res.A.T @ res.A)
    np.testing.assert_allclose(res.covariance_of(X), 2 * more, rtol=1e-6, atol=1e-9 * np.abs(more).max())


@pytest.mark.parametrize("name", kept(TREES, ["mimics", "coupled"]))
def test_torques_by_component_of_gravity_are_those_of_a_robot_at_rest_in_it(name):
    robot = rne.Robot(TREES[name])
    q, g = np.random.default_rng(0).uniform(-1, 1, (5, robot.n)), np.array([1.0, -2.0, 3.0])
    model = dataclasses.replace(robot.model, gravity=g)
    by_component = gravity_torques(model, q, np.column_stack([robot.parameters, np.eye(len(robot.parameters))]))
    assert by_component.shape == (5, robot.n, 3, 1 + len(robot.parameters))
    expected = rne.dynamics.regressor(model, q, 0 * q, 0 * q)
    np.testing.assert_allclose(g @ by_component[..., 1:], expected, atol=1e-13 * np.abs(expected).max())
    expected = rne.dynamics.gravity_torque(model, q)
    np.testing.assert_allclose(by_component[..., 0] @ g, expected, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("degrees", [0, 40])
def test_a_base_that_is_turned_far_is_told_with_its_angle(degrees):
    robot, t = faults.robots()["SCARA"], np.arange(0, 8, 0.01)
    w, size = np.array([2.0, 2.9, 3.7, 4.3]), np.array([1, 1, 0.1, 1])
    q, qd, qdd = size * np.sin(np.outer(t, w)), size * w * np.cos(np.outer(t, w)), -size * w**2 * np.sin(np.outer(t, w))
    turned = rne.Robot(rne.model.mounted(robot.model, [np.deg2rad(degrees), 0, 0]))
    tau = turned.inverse_dynamics(q, qd, qdd) + 0.01 * np.random.default_rng(0).normal(size=q.shape)
    base, noise = robot.base_parameters(drives=FRICTION), np.full(robot.n, 0.01)
    rows = regression(robot, Record(t, q, tau), base, cutoff=8.0, folds=2)
    values = fit_base_parameters(base, rows).values
    rest = FitResiduals(robot, base, rows, values, noise, np.ones(robot.n))
    told = [(cause.kind, round(cause.value)) for cause, _ in gravity_directions(rest)]
    assert told == ([("gravity direction", degrees)] if degrees else [])


@pytest.mark.parametrize(
    ("fault", "robot", "kind"),
    [
        (scaled_times, "gantry", "gravity magnitude"),
        pytest.param(scaled_times, "IRB 140", "gravity magnitude", marks=pytest.mark.long),
        pytest.param(pulled, "gantry", "spring", marks=pytest.mark.long),
        (coupled, "gantry", "coupling"),
    ],
)
def test_faults_that_no_campaign_planted_first(fault, robot, kind):
    with pytest.warns(rne.IdentificationWarning):
        found = identified(fault, robot)
    assert kind in [cause.kind for cause in found.causes[:2]], found.causes


def options_of(kind):
    """What the text of a cause says, done: options of `identify`."""
    own = {"rotor": True, "friction": "viscous+coulomb", "offset": True}
    return {
        "spring": {"springs": [rne.Spring.at_joint("b", 1.0, 0.0)]},
        "friction by direction": {"drives": rne.DriveModel(**own | {"friction": "viscous+asymmetric+coulomb"})},
        "friction under load": {"drives": rne.DriveModel(**own | {"friction": "viscous+coulomb+load"})},
        "rotor": {"drives": rne.DriveModel(**own)},
    }[kind]


def under_load(c):
    passed = c.arm.robot.inverse_dynamics(*c.states) + c.arm.rotor * c.states[2]
    return faults.log(c, c.tau + 0.2 * np.abs(passed) * np.sign(c.states[1]))


@pytest.mark.filterwarnings("ignore::rne.IdentificationWarning")
@pytest.mark.parametrize(
    ("fault", "kind", "words"),
    [
        (pulled, "spring", "(springs=[rne.Spring.at_joint(...)])"),
        (one_sided, "friction by direction", '(friction="viscous+asymmetric" of rne.DriveModel)'),
        (under_load, "friction under load", '(friction="load" of rne.DriveModel)'),
        (faults.clean, "rotor", "(rotor=True of rne.DriveModel)"),
    ],
)
def test_what_the_text_of_a_cause_names_fits_it(fault, kind, words):
    """The cause is gone, and less is left."""
    before = clean_without_rotors() if kind == "rotor" else identified(fault)
    after = identified(fault, **options_of(kind))
    (cause,) = [cause for cause in before.causes if cause.kind == kind]
    assert cause.text.endswith(words)
    assert kind not in {cause.kind for cause in after.causes}
    assert (after.held_out / before.held_out).min() < 0.1
    assert (after.held_out < 1.05 * before.held_out).all()


def test_a_joint_that_stands_still_leaves_the_others_alone():
    """Its parameters have infinite errors, or values of their size, not of the inverse of a rounding."""
    c = case("IRB 140", 5)
    q, qd, qdd = (x.copy() for x in c.states)
    q[:, 1], qd[:, 1], qdd[:, 1] = 0.4, 0, 0
    tau = c.arm.robot.inverse_dynamics(q, qd, qdd) + 3 * qd + 0.01 * c.size * c.rng.normal(size=q.shape)
    found = rne.identify(c.arm.robot, Record(c.t, q, tau), consistent=False, causes=False)
    assert np.abs(found.estimate.values).max() < 1e6
    assert np.isinf(found.estimate.errors).any()
    assert any("does not move" in note for note in found.notes)


def test_torques_that_are_not_explained_are_not_praised():
    """Swapped torques: no sentence of the report says that they are explained, each poor joint is named."""
    with pytest.warns(rne.IdentificationWarning, match="torques in motion that the model does not explain"):
        found = identified(faults.swapped_torques)
    report = found.report(details=True)
    poor = [
        name for name, left in zip(found.initial.joint_names, found.unexplained.in_motion, strict=True) if left > 0.15
    ]
    assert poor
    assert "model explains" not in report
    not_explained = report.split("not explained\n")[1].splitlines()[: len(poor)]
    assert [line.split()[0] for line in not_explained] == poor
    assert all("interchanged" in line for line in not_explained)


def test_consistency_is_not_one_model_where_torques_are_left():
    """A clean log is one model; of the same torques backwards nothing is explained, which is no conflict of joints."""
    c = case("gantry", 5)
    data = faults.clean(c)
    options = {"consistent": False, "causes": False}
    assert rne.identify(c.arm.robot, Record(data.t, data.q, data.tau), **options).consistency().one_model
    with pytest.warns(rne.IdentificationWarning):
        backwards = rne.identify(c.arm.robot, Record(data.t, data.q, data.tau[::-1]), **options)
    found = backwards.consistency()
    assert found.held_out.max() > 0.15
    assert not found.one_model
    assert "model explains" not in found.verdict


def test_a_joint_at_rest_is_judged_apart():
    """Joint d rests from 8 to 14 s, where sticking friction takes up a torque that no model knows."""
    c = case("SCARA", 4)
    q, qd, qdd = (x.copy() for x in c.states)
    rest = (c.t > 8) & (c.t < 14)
    a = np.where(c.t < 14, np.pi / 8, np.pi / 6)
    x = a * np.where(c.t < 14, c.t, c.t - 14)
    sine, cosine = np.where(rest, 0, np.sin(x)), np.cos(x)
    q[:, 3], qd[:, 3] = sine**4, 4 * a * sine**3 * cosine
    qdd[:, 3] = 4 * a**2 * (3 * sine**2 * cosine**2 - sine**4)
    body = c.arm.robot.inverse_dynamics(q, qd, qdd)
    tau = body + faults.friction(c.arm, qd, qdd, body)
    tau[rest, 3] += c.arm.coulomb[3] * np.sin(2 * c.t[rest])
    tau += 0.01 * c.size * c.rng.normal(size=tau.shape)
    left = rne.identify(c.arm.robot, Record(c.t, q, tau), consistent=False, causes=False).unexplained
    assert left.in_motion[3] < 0.02 < 0.2 < left.at_rest[3]
    assert left.in_motion[3] < left.everywhere[3] < left.at_rest[3]
    assert np.isfinite(left.in_motion).all()


@pytest.mark.filterwarnings("ignore::rne.IdentificationWarning")
@pytest.mark.parametrize(
    ("robot", "degrees"), kept([("SCARA", 2), ("SCARA", 8), ("mimic", 5), ("gantry", 15)], [("mimic", 5)])
)
def test_a_base_that_is_tilted_by_some_degrees_is_told(robot, degrees):
    c, angle = case(robot, 3), np.deg2rad(degrees)
    gravity = 9.81 * np.array([0, np.sin(angle), -np.cos(angle)])
    tilted = rne.Robot(dataclasses.replace(c.arm.robot.model, gravity=gravity))
    tau = c.tau + tilted.gravity_torque(c.states[0]) - c.arm.robot.gravity_torque(c.states[0])
    data = faults.log(c, tau)
    found = rne.identify(known_robot(robot, 3), Record(data.t, data.q, data.tau), consistent=False)
    texts = [cause.text for cause in found.causes[:2] if cause.kind == "gravity direction"]
    *direction, told = map(float, re.findall(r"-?[0-9.]+(?=[,) ])", texts[0]))
    np.testing.assert_allclose(direction, gravity / 9.81, atol=0.03)
    assert abs(told - degrees) < 1 + 0.1 * degrees  # the derivative by a small angle


def test_torques_of_one_joint_in_another_unit_are_told_without_a_residual():
    """The slider of a SCARA in kN: only the robot given tells, as masses may be a thousand times larger, offsets 2 %."""

    def in_kN(c):
        data = faults.clean(c)
        return data._replace(tau=data.tau * np.array([1, 1, 1e-3, 1]))

    with pytest.warns(rne.IdentificationWarning, match=r"the torque of c is 0\.0009 times that of the robot given"):
        found = identified(in_kN)
    assert (found.unexplained.in_motion < 0.01).all()
    assert [(cause.kind, cause.joints) for cause in found.causes] == [("torque unit", ("c",))]


@pytest.mark.parametrize("factor", [100.0, -1.0])
def test_signs_and_units_are_told_by_what_drives_cannot_explain(factor):
    """An offset hides the weight of a slider, so that torques of all joints of a wrong sign look like many faults."""
    scale = np.array([factor, 1, 1, 1]) if factor > 0 else np.full(4, factor)
    with pytest.warns(rne.IdentificationWarning):
        found = identified(lambda c: (data := faults.clean(c))._replace(tau=data.tau * scale), seed=4)
    assert found.causes[0].joints == ("a",) if factor > 0 else found.causes[0].text.endswith("have the wrong sign")
    if factor > 0:
        assert re.match(r"the torque of a is (8|9|1\d)\d(\.\d)? times that of the robot", found.causes[0].text)


def test_a_joint_of_a_rotor_and_friction_alone_is_in_no_other_unit():
    """The hand weighs 20 g and lies on the axis, so that its drive takes a thousand times the torque of its body."""
    c = case("SCARA", 5)
    model = c.arm.robot.model
    mass, com, inertia = model.mass.copy(), model.com.copy(), model.inertia.copy()
    mass[3], com[3], inertia[3] = 0.02, 0, 1e-5 * np.eye(3)
    robot = rne.Robot(dataclasses.replace(model, mass=mass, com=com, inertia=inertia))
    drives = faults.friction(c.arm, *c.states[1:], np.zeros_like(c.tau)) + np.eye(4)[3] * 0.3 * c.states[2]
    tau = robot.inverse_dynamics(*c.states) + drives
    tau += 0.01 * tau.std(0) * c.rng.normal(size=tau.shape)
    found = rne.identify(robot, Record(*(x[::2] for x in (c.t, c.states[0], tau))), consistent=False)
    assert not {"torque unit", "torque sign", "torque factor"} & {cause.kind for cause in found.causes}


@pytest.mark.filterwarnings("ignore::rne.IdentificationWarning")
def test_the_sign_of_all_torques_comes_before_gravity_and_what_else_is_left():
    """Gravity is a fifth too large as well, friction rises by half of the load, and an encoder slips."""
    c = case("mimic", 4)
    heavy = rne.Robot(dataclasses.replace(c.arm.robot.model, gravity=np.array([0, 0, -1.2 * 9.81])))
    body, q = heavy.inverse_dynamics(*c.states), c.states[0].copy()
    q[len(q) // 2 :, 1] += 0.1
    tau = -(body + faults.friction(c.arm, *c.states[1:], body) + 0.5 * np.abs(body) * np.sign(c.states[1]))
    tau += 0.02 * c.size * c.rng.normal(size=tau.shape)
    found = rne.identify(c.arm.robot, Record(c.t, q, tau), consistent=False)
    assert found.causes[0].text == "the torques of all joints have the wrong sign"


def test_torques_of_drives_whose_friction_gives_power_have_the_wrong_sign():
    """Viscous friction of two joints is negative, Coulomb friction is not: no residual tells it."""
    c = case("gantry", 6)
    push = np.array([0, 0, 1, 3]) * c.size / np.abs(c.states[1]).max(0)
    data = faults.log(c, c.tau - push * c.states[1])
    with pytest.warns(rne.IdentificationWarning, match="the torque of [zw], [zw] has the wrong sign, or is not its"):
        found = rne.identify(known_robot("gantry", 6), Record(*data), consistent=False)
    assert set(found.causes[0].joints) == {"z", "w"}
    assert found.causes[0].text.endswith("its friction gives power (negative drive_gains of Record.from_motors)")
    assert (found.unexplained.in_motion < 0.05).all()


@pytest.mark.filterwarnings("ignore::rne.IdentificationWarning")
def test_a_wrong_sign_that_friction_tells_has_the_effect_of_turning_it():
    """Negative friction names it; a fifth of the torque is left all the same, which the other sign explains."""
    c = case("UR5", 3)
    data = faults.log(c, c.tau * [1, -1, 1, 1, 1, 1])
    found = rne.identify(known_robot("UR5", 3), Record(*data), consistent=False)
    (cause, *_), left = found.causes, found.unexplained.in_motion[1]
    assert cause.joints == ("shoulder_lift_joint",)
    assert "its friction gives power" in cause.text
    assert cause.effect.endswith(" % on shoulder_lift_joint")
    assert left > 0.1
    assert cause.removed[1] > thresholds.EXPLAINS  # else the report says that no change explains it
    assert "no single change" not in found.report()


TURNED = [("mimic", 0.35, False, 0.01), ("mimic", -0.6, True, 0.01), ("IRB 140", -0.6, False, 1e-3)]


@pytest.mark.filterwarnings("ignore::rne.IdentificationWarning")
@pytest.mark.parametrize(("robot", "ratio", "of_torques", "noise"), kept(TURNED, TURNED[:1]))
def test_a_motor_that_turns_with_the_joint_before_is_told_with_its_ratio(monkeypatch, robot, ratio, of_torques, noise):
    """Steps of friction, which few samples tell to a hundredth, do not hide it where there is less noise."""
    monkeypatch.setattr(faults, "NOISE", noise)
    c = case(robot, 3)
    data = faults.log(c, c.tau)
    q, tau = data.q.copy(), data.tau.copy()
    q[:, -1] += ratio * q[:, -2]
    tau[:, -2] -= of_torques * ratio * tau[:, -1]
    cause = rne.identify(known_robot(robot, 3), Record(data.t, q, tau), consistent=False).causes[0]
    assert (cause.kind, cause.joints) == ("coupling", c.arm.robot.joint_names[-2:])
    assert abs(cause.value - ratio) < 0.03
    assert ("not in the torques (subtract" in cause.text) is not of_torques
    assert cause.text.endswith("(coupling of Record.from_motors)") is of_torques


def test_a_cause_of_small_effect_is_a_note(monkeypatch):
    monkeypatch.setattr(thresholds, "MATTERS", 1.0)
    found = identified(pulled, "mimic")
    assert not found.causes
    assert not found.doubt
    (note,) = [note for note in found.notes if note.startswith("evident, but of little effect, no likely causes: ")]
    assert "something pulls joint_2 as a spring of" in note
    assert note in found.report(details=True)


def test_gravity_is_looked_for_where_more_is_left_than_noise_though_the_fit_is_fair():
    """Gears take nearly all of the torque: 60 degrees of tilt leave less than 5 % of it."""
    c = case("mimic", 3)
    turned = 9.81 * np.array([np.sin(1.05), 0, -np.cos(1.05)])
    other = rne.Robot(dataclasses.replace(c.arm.robot.model, gravity=turned))
    drives = 120 * c.size * c.states[1] / np.abs(c.states[1]).max(0)
    tau = other.inverse_dynamics(*c.states) + faults.friction(c.arm, *c.states[1:], c.tau) + drives
    tau += 3e-4 * tau.std(0) * c.rng.normal(size=tau.shape)
    with pytest.warns(rne.IdentificationWarning, match="gravity acts along .*, (59|60|61)[.0-9]* degrees"):
        found = rne.identify(c.arm.robot, Record(c.t, c.states[0], tau), consistent=False)
    assert (found.unexplained.in_motion < thresholds.POOR).all()


def test_a_motion_of_few_degrees_is_blamed_on_no_sign_and_no_degrees():
    """Its weight cannot be told from offsets, and its positions are in no degrees."""
    c = case("IRB 140", 5)
    q, qd, qdd = (0.05 * x for x in c.states)
    tau = c.arm.robot.inverse_dynamics(q, qd, qdd) + c.arm.offset + 0.3 * c.arm.viscous * qd
    known = known_robot("IRB 140", 5)
    record = Record(c.t, q, tau + 0.01 * np.abs(tau).max(0) * c.rng.normal(size=q.shape))
    found = rne.identify(known, record, consistent=False)
    assert not {"torque sign", "degrees"} & {cause.kind for cause in found.causes}


@pytest.mark.parametrize("missing", [0.0, np.nan])
def test_a_joint_without_torque_is_not_blamed_on_the_order_of_joints(missing):
    def without(c):
        data = faults.clean(c)
        return data._replace(tau=data.tau * np.array([1, 1, 1, missing]))

    found = identified(without)
    assert any(note.startswith("d has no torque that can be used") for note in found.notes)
    assert not {"torque order", "joint order"} & {cause.kind for cause in found.causes}


def test_a_motion_of_one_joint_has_one_sentence():
    c = case("IRB 140", 5)
    q, qd, qdd = (x * (np.arange(6) == 1) for x in c.states)
    tau = c.arm.robot.inverse_dynamics(q, qd, qdd) + 3 * qd + 0.01 * c.size * c.rng.normal(size=q.shape)
    only = "no joint but joint_2 moves. Move all joints farther and faster: `rne.excitation` finds a motion"
    with pytest.warns(rne.IdentificationWarning, match=f"^{only}$"):
        found = rne.identify(c.arm.robot, Record(c.t, q, tau), consistent=False, causes=False)
    still = "joint_1, joint_3, joint_4, joint_5, joint_6 do not move: their rotor and friction cannot be found"
    assert still in found.notes


@pytest.mark.filterwarnings("ignore::rne.IdentificationWarning")
def test_a_load_on_an_inner_link_is_told_with_its_link(whole_log):
    c = case("SCARA", 3)  # for its times and its seed
    robot = rne.load("ur5").locked({f"wrist_{k}_joint": 0.3 for k in (1, 2, 3)})
    q, qd, qdd = faults.motion(robot, c.rng, c.t)
    more = robot.with_payload(5.0, (0, 0.1, 0.3), link="upper_arm_link").inverse_dynamics(q, qd, qdd)
    tau = robot.inverse_dynamics(q, qd, qdd)
    size = np.sqrt((tau**2).mean(0))
    tau = (
        np.where(c.t[:, None] > 9, more, tau) + 0.1 * size * np.sign(qd) + 0.01 * size * faults.coloured(c.rng, q.shape)
    )
    found = rne.identify(robot, Record(c.t, q, tau), consistent=False)
    assert found.causes[0].kind == "payload changed"
    assert re.match(r"the load on the link distal to shoulder_lift_joint changes near (8|9|10)\.", found.causes[0].text)
    assert "likewise" not in found.causes[0].text  # links beside it look alike, and are not loaded too


@pytest.mark.filterwarnings("ignore::rne.IdentificationWarning")
def test_parameters_that_noise_of_positions_biases_drift(monkeypatch):
    """14 bits of encoder, a cut-off far above the motion: rates are noisy, and half the cut-off gives other inertias."""
    monkeypatch.setattr(faults, "ENCODER", 2 * np.pi / 2**14)
    monkeypatch.setattr(faults, "DURATION", 8.0)
    c, found = (
        case("gantry", 1),
        [identified(faults.clean, "gantry", 1, cutoff=cutoff, causes=False) for cutoff in (30, 4)],
    )
    gaps = [f.estimate.values - truth_of(c, f) for f in found]
    wrong, right = (np.abs(gap) / f.estimate.errors for gap, f in zip(gaps, found, strict=True))
    assert wrong.max() > 4 > right.max()
    drifts = [np.abs(f.drift) / f.drift_error for f in found]
    assert drifts[0][np.argmax(wrong)] > 3 > drifts[1].max()
    assert "drift, the change with half the cut-off, beyond three standard errors" in found[0].report(details=True)
    assert "drift, the change" not in found[1].report(details=True)


def test_friction_at_stops_does_not_look_like_a_bias_of_the_filter():
    """tanh(qd / 0.01) for the fit's sign(qd) differs only where joints stop, and no equation with half the cut-off has
    these."""
    robot, rng = first_joints(), np.random.default_rng(0)
    stops, t = rng.uniform(-1, 1, (7, 3)), np.arange(0, 4, 0.002)
    parts = [rne.trajectories.quintic(a, b, 4.0)(t) for a, b in itertools.pairwise(stops)]
    q, qd, qdd = map(np.concatenate, zip(*parts, strict=True))
    tau = robot.inverse_dynamics(q, qd, qdd)
    size = np.sqrt((tau**2).mean(0)) + 1
    tau += size * (0.3 * np.tanh(qd / 0.01) + 0.1 * qd + 0.03 * rng.standard_normal(q.shape))
    found = rne.identify(robot, Record(0.002 * np.arange(len(q)), q, tau), consistent=False, causes=False)
    assert (np.abs(found.drift) < 3 * found.drift_error).all()


def test_a_joint_at_rest_takes_the_drift_of_its_own_parameters_alone():
    robot, rng = first_joints(), np.random.default_rng(0)
    t, w, size = np.arange(0, 20, 0.002), 2 * np.pi * np.array([0.13, 0.27, 0]), np.array([1.0, 1.0, 0])
    q, qd, qdd = size * np.sin(np.outer(t, w)), size * w * np.cos(np.outer(t, w)), -size * w**2 * np.sin(np.outer(t, w))
    tau = robot.inverse_dynamics(q, qd, qdd) + 0.5 * np.sign(qd) + 0.1 * rng.normal(size=q.shape)
    found = rne.identify(robot, Record(t, q, tau), consistent=False, causes=False)
    known = np.isfinite(found.estimate.errors)
    assert 0 < known.sum() < len(known)
    assert (np.isfinite(found.drift) == known).all()
    assert (np.isfinite(found.drift_error) == known).all()


def test_the_report_tells_which_parameters_are_known_and_notebooks_show_it():
    found = identified(faults.clean, causes=False)
    rows = {
        line.split()[0]: line.split()[3] for line in found.report(details=True).splitlines() if line.startswith("  Fc_")
    }
    shares = dict(zip(found.base.names, 100 * found.estimate.errors / np.abs(found.estimate.values), strict=True))
    assert rows == {name: f"{shares[name]:.2g}" for name in rows}
    assert len(rows) == 4
    assert found.report().splitlines()[0] in found._repr_html_()


def test_a_warning_can_be_an_error():
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("error", rne.IdentificationWarning)
        with pytest.raises(rne.IdentificationWarning, match="has the wrong sign"):
            identified(faults.sign, "gantry")


@pytest.mark.parametrize(
    ("felt", "text"),
    [(0, "the load on the link distal to joint_1 changes near 3 s"), (1, "the payload changes by 2 kg near 3 s")],
)
def test_a_load_whose_mass_is_not_felt_is_named_without_one(felt, text, monkeypatch):
    monkeypatch.setattr(hypotheses, "starts", lambda rest: (["3 s"], np.ones((1, 4), bool)))
    Y = np.ones((4, 1, 10)) * [felt, *[1] * 9]
    (one,) = hypotheses.payloads(SimpleNamespace(robot=first_joints(1), Y=Y, share=0))
    assert one.text(np.full(10, 2.0), 0, 0) == text
