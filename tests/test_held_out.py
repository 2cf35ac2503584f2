"""What was held out decides: the cut-off where noise is fed back, and which causes are named."""

import dataclasses
import logging
import re

import numpy as np
import pytest
from scipy.signal import butter, lfilter

import rne
from rne.identification import Cause, Record, fit_base_parameters, regression, thresholds
from rne.identification.diagnosis.hypotheses import merged_by_kind, of_columns, of_convention, with_effect
from rne.identification.diagnosis.residuals import FitResiduals

from . import faulty_logs as faults

KD, BAND = 5.0, 20.0  # damping [1 / (rad/s) of the torque], bandwidth of the noise of positions [Hz]


@pytest.fixture(autouse=True)
def short_logs(monkeypatch):
    monkeypatch.setattr(faults, "DURATION", 10.0)
    monkeypatch.setattr(faults, "RATE", 250.0)


def fed_back(size):
    """A log whose torques contain what the drives made of noise of the positions, and the case."""
    c, rng = faults.case("SCARA", 3, linear=True), np.random.default_rng(0)
    noise = lfilter(*butter(1, BAND / (faults.RATE / 2)), rng.normal(size=c.tau.shape), axis=0)
    noise *= size * np.abs(c.states[0] - c.states[0].mean(0)).mean(0) / noise.std(0)
    tau = c.tau - KD * c.size * np.gradient(noise, c.t, axis=0) + 0.005 * c.size * rng.normal(size=c.tau.shape)
    return c, Record(c.t, c.states[0] + noise, tau), faults.given_robot(c.arm.robot, c.rng)


@pytest.mark.filterwarnings("ignore::rne.IdentificationWarning")
@pytest.mark.parametrize("size", [0.003, 0.01])  # where a tenth of the torques is left, and where a third is
def test_the_cutoff_is_halved_where_noise_is_fed_back_and_torques_without_it_are_predicted_better(size):
    c, record, known = fed_back(size)
    found = rne.identify(known, record, consistent=False, causes=False)
    given = record.prepare().cutoff
    plain = rne.identify(known, record, consistent=False, causes=False, cutoff=given)
    assert found.records[0].cutoff == given / 2
    note = found.records[0].notes[0]
    assert note.startswith(f"cut-off {given / 2:.3g} Hz: of blocks not fitted ")
    assert note in found.report()
    exact = regression(known, Record(c.t, c.states[0], c.tau), found.base, cutoff=given, folds=2).fitted
    assert exact.shares(found.parameters).max() < 0.7 * exact.shares(plain.parameters).max()


def test_the_cutoff_of_the_spectrum_stays_where_little_is_left():
    _, record, known = fed_back(1e-6)
    found = rne.identify(known, record, consistent=False, causes=False)
    assert found.records[0].cutoff == record.prepare().cutoff
    assert "chosen from the spectrum" in found.records[0].notes[0]


def test_a_log_of_a_lower_rate_is_checked_with_what_its_rate_allows():
    """The fit's cut-off is above a fifth of the other log's rate, and nobody gave it."""
    c = faults.case("gantry", 3, linear=True)
    found = rne.identify(c.arm.robot, Record(c.t, c.states[0], c.tau), cutoff=12.0, consistent=False, causes=False)
    few = slice(None, None, 10)
    check = found.check(Record(c.t[few], c.states[0][few], c.tau[few]))
    assert (check.relative < 0.02).all()


def test_causes_are_not_looked_for_on_request(caplog):
    c = faults.case("gantry", 3, linear=True)
    data, known = faults.sign(c), faults.given_robot(c.arm.robot, c.rng)
    record = Record(data.t, data.q, data.tau)
    with caplog.at_level(logging.INFO, "rne"), pytest.warns(rne.IdentificationWarning, match="has the wrong sign"):
        rne.identify(known, record, consistent=False)
    said = [line for line in caplog.messages if "changes tried" in line]
    assert re.fullmatch(r"\d+ changes tried, \d+ evident, \d+ reduce the validation error", said[-1])
    with pytest.warns(rne.IdentificationWarning) as warned:
        found = rne.identify(known, record, consistent=False, causes=False)
    assert found.causes == ()
    assert "single change" not in str(warned[0].message) + found.report()
    assert "causes of the residuals were not searched for, as `causes` says" in found.report()
    with pytest.raises(ValueError, match=r"^`hypotheses` are tried as causes: leave them out, or set `causes=True`$"):
        rne.identify(known, record, hypotheses=[rne.identification.Hypothesis("x", c.tau, "x")], causes=False)


def residuals(fault="clean"):
    """What least squares leave of a log, and its case."""
    c = faults.case("gantry", 3)
    data, robot = (faults.FAULTS[fault][0] if fault in faults.FAULTS else faults.clean)(c), c.arm.robot
    base = robot.base_parameters(drives=rne.DriveModel(rotor=True, friction="viscous+coulomb", offset=True))
    rows = regression(robot, Record(data.t, data.q, data.tau), base, cutoff=4.0)
    fit = fit_base_parameters(base, rows)
    return c, FitResiduals(robot, base, rows, fit.values, fit.sigma)


def test_errors_held_out_are_those_of_fits_to_the_other_blocks():
    _, rest = residuals()
    b = rest.weighted(rest.tau)
    found = rest.held_out(rest.Q, b, rest.blocks)
    squares, block = [], rest.blocks[np.nonzero(rest.used)[0]]
    for k in range(block.max() + 1):
        x = np.linalg.lstsq(rest.A[block != k], b[block != k], rcond=None)[0]
        squares.append(rest.by_joint(np.where(block == k, b - rest.A @ x, 0)))
    np.testing.assert_allclose(found, squares / rest.by_joint(b), rtol=1e-6)  # of a condition number of 1e3


def test_noise_beyond_friction_is_what_a_fit_with_friction_of_real_gears_leaves():
    """By it the residuals of each joint have a mean square of one; the next fit, of other weights, leaves less."""
    beyond = residuals()[1].beyond_friction
    np.testing.assert_allclose(beyond.squares / beyond.used.sum(0), 1, rtol=0.1)


def test_a_cause_is_dropped_if_it_improves_no_joint_or_costs_another_more_than_a_fifth_of_what_it_brings():
    _, rest = residuals()
    cause, before = Cause("spring", ("x",), "x", 100.0), np.full((10, 4), 0.1**2 / 10)
    cases = {(1, 1, 1, 0.5): True, (1, 1, 1, 0.98): False, (1, 1, 1.5, 0.5): False, (1, 1, 1.05, 0.5): True}
    for ratio, is_kept in cases.items():
        found = with_effect(rest, cause, lambda _, ratio=ratio: (before, before * np.array(ratio) ** 2))
        assert (found is not None) == is_kept, ratio
    kept, matters = found
    assert matters
    error = 100 * np.sqrt(rest.held_out(rest.Q, rest.weighted(rest.tau), rest.blocks)[:, 3].sum())
    assert kept.effect == f"{error:.3g} -> {error / 2:.3g} % on w"
    np.testing.assert_allclose(kept.removed, [0, 0, 1 - 1.05**2, 0.75])


@pytest.mark.parametrize(
    ("least", "most", "matters"),
    [(0.95, 0.97, False), (0.85, 0.97, True), (0.2, 1.25, False), (0.3, 0.5, True)],
    ids=["4 %", "9 %", "one block in two", "60 %"],
)
def test_a_cause_is_named_for_5_per_cent_of_an_error_and_two_standard_deviations_over_the_blocks(least, most, matters):
    """Errors of the blocks fall to these ratios in turn, those of one joint."""
    _, rest = residuals()
    before = np.full((10, 4), 0.02**2 / 10)
    after = before * np.where(np.eye(4)[3], np.where(np.arange(10) % 2, least, most)[:, None] ** 2, 1)
    rest.counts = np.full(4, 1e3)  # chance is not the reason
    _, found = with_effect(rest, Cause("friction under load", ("x",), "x", 100.0), lambda _: (before, after))
    assert found is matters


def test_torques_that_are_interchanged_are_judged_as_they_were_measured():
    """By the error of each torque, whatever joint it is taken to belong to."""
    c, rest = residuals("swapped torques")
    i, j = c.joint, (c.joint + 1) % 4
    swap = np.eye(4)[[*np.where(np.arange(4) == i, j, np.where(np.arange(4) == j, i, np.arange(4)))]]
    before, after = (x.sum(0) for x in of_convention(np.eye(4), swap, rest))
    columns, tau, left = rest.Y @ rest.base.back, rest.tau @ swap.T, rest.coarse
    sigma = left.refitted(columns, tau)[1]
    Q, b = np.linalg.qr(left.weighted(columns, sigma))[0], left.weighted(tau, sigma)
    shares = left.held_out(Q, b, left.blocks)
    expected = np.maximum(shares, thresholds.ODD**2 / len(shares)).sum(0)  # steps of friction are off by as much
    np.testing.assert_allclose(after[[i, j]], expected[[j, i]], rtol=1e-9)
    assert (after < 1.1 * before).all()
    assert after[[i, j]].max() < 0.01 * before[[i, j]].max()


def test_what_happens_within_one_block_is_judged_on_short_ones():
    """A constant torque of one joint during one block of time."""
    _, rest = residuals()
    column = ((rest.blocks == 5)[:, None] * np.eye(4)[0])[..., None]
    rest.tau = rest.tau + 0.5 * np.sqrt((rest.tau[:, 0] ** 2).mean()) * column[..., 0]
    for is_event, most in ((True, 0.5), (False, 2.0)):
        before, after = of_columns(column, is_event, rest)
        blocks = rest.short_blocks if is_event else rest.blocks
        np.testing.assert_array_equal(before, rest.held_out(rest.Q, rest.weighted(rest.tau), blocks))
        of_joint, error = (np.sqrt(x[:, 0].sum()) for x in (before, after))
        assert (error < 0.5 * of_joint) == is_event
        assert error < most * of_joint


def test_each_joint_of_a_cause_is_told_with_its_own_number():
    def merged_text(texts):
        (found,) = merged_by_kind([Cause("x", (name,), text, 9.0) for name, text in zip("ab", texts, strict=True)])
        return found.text

    texts = [f"friction of {name} changes by {x} % of its load" for name, x in (("a", 4.67), ("b", 5.1))]
    assert merged_text(texts) == "friction of a, b changes by 4.67, 5.1 % of its load"
    others = ["the torque of a has the wrong sign", "the torque of b is measured -0.5 times"]
    assert merged_text(others) == "; ".join(others)
    others = [f"{text} (drive_gains of Record.from_motors)" for text in others]
    assert merged_text(others) == "; ".join(others)
    causes = [
        Cause("joint zero", (x,), f"the zero of {x} is wrong by 1 rad", 9.0, effect=f"5 -> 3 % on {x}") for x in "ab"
    ]
    (both,) = merged_by_kind(causes)
    assert (both.joints, both.effect) == (("a", "b"), "5 -> 3 % on a, 5 -> 3 % on b")
    assert both.text == "the zero of a, b is wrong by 1 rad"
    assert merged_by_kind([causes[0], causes[0]._replace(text="of another record")]) == (causes[0],)
    causes[0] = causes[0]._replace(effect="5 -> 3 % on a, 4 -> 2 % on b")  # each was judged alone
    assert merged_by_kind(causes)[0].effect == "5 -> 3 % on a, 4 -> 2 % on b"


def test_a_log_without_an_evident_cause_says_so():
    """Torques of a hysteresis that no hypothesis has leave a fifth."""
    c = faults.case("gantry", 3, linear=True)
    t, rng = c.t, np.random.default_rng(5)
    odd = lfilter(*butter(2, 1.0 / (faults.RATE / 2)), rng.normal(size=c.tau.shape), axis=0)
    tau = c.tau + 0.1 * c.size * odd / odd.std(0)
    found = rne.identify(c.arm.robot, Record(t, c.states[0], tau), consistent=False)
    assert not found.doubt
    assert "no single change of the log, the robot or the drives that was tried reduces" in found.report()
    assert (
        "likely causes" in dataclasses.replace(found, causes=(Cause("x", (), "x", 9.0, removed=np.zeros(4)),)).report()
    )


def test_merged_causes_have_one_effect_of_each_joint():
    likely = Cause("viscous", ("j1",), "friction of j1", 9.0, effect="5 -> 3 % on j1 with gear friction modelled")
    other = Cause("viscous", ("j2",), "friction of j2", 8.0, effect="4 -> 2 % on j1, 6 -> 3 % on j2")
    (merged,) = merged_by_kind([likely, other])
    assert set(merged.effect.split(", ")) == {likely.effect, "6 -> 3 % on j2"}
