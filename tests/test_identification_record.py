"""Records of measured motions: the filters, the faults of logs, measurements at the motors."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

import rne
from rne.basics.filters import low_pass, settling
from rne.identification import Record
from rne.identification.log.filtering import derivatives
from rne.identification.log.screening import clipped, equal_steps

from .helpers import first_joints, loaded
from .measurements import measure, record, truth
from .random_robots import straight_chain

MARGIN = 4  # cut-offs

RATE = 500.0
LINEAR = 1e-12  # of the largest entry: rounding of a filter of fourth order, twice
STEP_LEFT = 0.01  # of a step, where samples are kept
EDGE = 1e-3  # of a sine's amplitude, where samples are kept: its phase at the end is no step
BAND = 1.5e-3  # gain lost at half the cut-off: 1 / (1 + 2^-8) is 0.4 % less for a full filter, with margin taken below


@pytest.fixture(scope="module")
def scene():
    return rne.Scene(first_joints(), friction=rne.Friction(viscous=3.0, coulomb=4.0, smoothing=0.01))


@pytest.fixture(scope="module")
def true(scene):
    return truth(scene, duration=8.0, rate=RATE)


@pytest.fixture(scope="module")
def scene_of_six(scene):
    """All joints of the robot, for faults of single ones."""
    return rne.Scene(loaded("irb140"), friction=scene.friction)


@pytest.fixture(scope="module")
def true_of_six(scene_of_six):
    return truth(scene_of_six, duration=8.0, rate=RATE)


def exactly(text):
    return pytest.raises(ValueError, match=f"^{re.escape(text)}$")


def sine(frequency, seconds=6.0, rate=RATE, phase=0.3):
    t = np.arange(int(seconds * rate)) / rate
    return t, np.sin(2 * np.pi * frequency * t + phase)


def amplitude_and_phase(t, x, frequency):
    basis = np.column_stack([np.sin(2 * np.pi * frequency * t), np.cos(2 * np.pi * frequency * t)])
    a, b = np.linalg.lstsq(basis, x, rcond=None)[0]
    return np.hypot(a, b), np.arctan2(b, a)


# The filters


@pytest.mark.parametrize(("frequency", "gain"), [(5.0, 1 / (1 + 0.5**8)), (10.0, 0.5), (20.0, 1 / (1 + 2.0**8))])
def test_low_pass_has_no_phase_and_the_gain_of_butterworth_squared(frequency, gain):
    t, x = sine(frequency, rate=5000.0)
    inner = slice(2500, -2500)
    amplitude, phase = amplitude_and_phase(t[inner], low_pass(x, 10.0, 5000.0)[inner], frequency)
    assert amplitude == pytest.approx(gain, rel=2e-3)  # the bilinear transform warps frequencies by 1e-4 of their value
    assert phase == pytest.approx(0.3, abs=1e-4)


@pytest.mark.parametrize(
    ("cutoff", "rate"), [(2.5, 125.0), (10.0, 125.0), (25.0, 125.0), (16.0, 5000.0), (31.25, 125.0)]
)
def test_a_step_has_settled_where_samples_are_kept(cutoff, rate):
    m = settling(cutoff, rate)
    step = np.concatenate([np.zeros(8 * m), np.ones(8 * m)])
    away = np.abs(low_pass(step, cutoff, rate) - step)
    assert away[: 7 * m].max() < STEP_LEFT
    assert away[9 * m :].max() < STEP_LEFT
    assert away[7 * m + m // 3 : 9 * m - m // 3].max() > STEP_LEFT  # no more is dropped than is needed


def test_ends_dropped_are_enough(true):
    """A part of a record gives the rows that the whole gives: what lies outside has no influence left."""
    whole = Record(true.t, true.q, true.tau).prepare(cutoff=5.0)
    part = Record(true.t[1000:3000], true.q[1000:3000], true.tau[1000:3000]).prepare(cutoff=5.0)
    same = np.flatnonzero(np.isin(np.rint(whole.times * RATE), np.rint(part.times * RATE)))
    for x, y in ((whole.tau, part.tau), (whole.qdd, part.qdd)):
        difference = np.abs(whole.reduce(x)[same] - part.reduce(y))
        assert difference.max() < STEP_LEFT * np.ptp(x, axis=0).max()


def test_derivatives_are_those_of_a_sine():
    """At a tenth of the sample rate, where two-point differences lose 6 and 3 %."""
    t, x = sine(50.0)
    omega = 2 * np.pi * 50.0
    first, second = derivatives(x, RATE)
    inner = slice(MARGIN, -MARGIN)
    assert np.abs(first / omega - np.cos(omega * t + 0.3)[inner]).max() < 1e-4
    assert np.abs(second / omega**2 + x[inner]).max() < 1e-4


def test_prepared_rates_and_accelerations_are_the_motions(true):
    prepared = Record(true.t, true.q, true.tau).prepare(cutoff=10.0)
    rows = np.rint(prepared.t * RATE).astype(int)
    inner = slice(200, -200)
    for got, expected in ((prepared.q, true.q), (prepared.qd, true.qd), (prepared.qdd, true.qdd)):
        assert np.abs(got - expected[rows])[inner].max() < 1e-6 * np.abs(expected).max()
    assert np.array_equal(prepared.tau, true.tau[rows])


def test_same_filter_of_measurement_and_regressor_leaves_their_relation(scene, true):
    """Y pi of the motion itself: reduced, the relation holds to rounding."""
    robot = scene.robot
    prepared = Record(true.t, true.q, true.tau).prepare(cutoff=5.0)
    Y = robot.regressor(prepared.q, prepared.qd, prepared.qdd)
    difference = prepared.reduce(Y) @ robot.parameters - prepared.reduce(Y @ robot.parameters)
    assert np.abs(difference).max() < LINEAR * np.abs(Y * robot.parameters).max()


def test_parameters_are_found_through_noise_and_quantisation(scene, true):
    """The chain as a whole: reduced torques are those of the true model on the prepared motion."""
    prepared = record(true, encoder_step=1e-5, torque_noise=0.2).prepare()
    predicted = scene.inverse_dynamics(prepared.q, prepared.qd, prepared.qdd)
    residual = prepared.reduce(prepared.tau) - prepared.reduce(predicted)
    kept = np.sqrt(2 * prepared.cutoff / prepared.sample_rate)  # share of white noise that passes
    assert np.sqrt(np.mean(residual**2)) < 1.2 * 0.2 * kept


def test_decimation_keeps_the_band(true):
    """Below half the cut-off nothing is lost, and rows come often enough to show it."""
    t, x = sine(2.0, seconds=8.0)
    prepared = Record(t, x[:, None], x[:, None]).prepare(cutoff=5.0)
    assert prepared.decimation == 40  # 12.5 rows/s: the cut-off is 0.8 times half of it
    amplitude, phase = amplitude_and_phase(
        prepared.times, prepared.reduce(x[np.rint(prepared.t * RATE).astype(int)]), 2.0
    )
    assert amplitude == pytest.approx(1.0, rel=BAND)
    assert phase == pytest.approx(0.3, abs=1e-3)


def test_columns_are_reduced_block_by_block_as_one(monkeypatch, true):
    prepared = Record(true.t, true.q, true.tau).prepare(cutoff=5.0)
    whole = prepared.reduce(prepared.tau)
    monkeypatch.setattr("rne.basics.filters.BLOCK", 1)
    assert np.array_equal(prepared.reduce(prepared.tau), whole)


def test_segments_are_filtered_by_themselves(true):
    """What lies beyond a gap has no influence."""
    lost = range(1500, 1560)
    both = record(true, lost=lost).prepare(cutoff=5.0)
    first = Record(true.t[:1500], true.q[:1500], true.tau[:1500]).prepare(cutoff=5.0)
    rows = len(first.times)
    assert len(both.segments) == 2
    assert np.allclose(both.times[:rows], first.times, rtol=0, atol=1e-12)
    assert np.allclose(both.reduce(both.tau)[:rows], first.reduce(first.tau), rtol=0, atol=LINEAR * 1e3)


# The cut-off


@pytest.mark.parametrize("base", [0.1, 0.3])
def test_cut_off_follows_the_motion(scene, base):
    """Five harmonics of the base frequency: the cut-off lies well above the highest one, and is said."""
    prepared = record(truth(scene, base=base), torque_noise=0.5, encoder_step=1e-5).prepare()
    assert 3 * 5 * base < prepared.cutoff < 10 * 5 * base + 2.5  # spectra of 4 s tell 0.25 Hz apart
    assert prepared.notes[0].startswith(
        f"cut-off {prepared.cutoff:.3g} Hz, chosen from the spectrum of the positions: 5 times the motion's bandwidth of "
    )


def test_noise_of_positions_lowers_the_cut_off(scene):
    true = truth(scene, base=0.3, rate=100.0)
    quiet, noisy = (record(true, position_noise=noise).prepare() for noise in (1e-6, 3e-3))
    assert noisy.cutoff < 0.7 * quiet.cutoff
    assert "noise disturbs the accelerations from" in noisy.notes[0]


def test_cut_off_is_at_most_a_fifth_of_the_sample_rate():
    t, x = sine(3.0, rate=40.0)
    prepared = Record(t, x[:, None], x[:, None]).prepare()
    assert prepared.cutoff == pytest.approx(8.0)
    assert prepared.notes[0].endswith("0.2 times the sample rate of 40 Hz")
    assert prepared.notes[1].startswith("warning: the spectrum asks for a cut-off above 8 Hz, a fifth of the sample")


def test_a_cut_off_that_is_printed_can_be_given_back():
    t, x = sine(12.0, rate=199.6)
    q = x[:, None]
    measured = Record(t, q, q)
    chosen = measured.prepare()
    assert chosen.cutoff == pytest.approx(39.92)
    assert measured.prepare(chosen.cutoff).cutoff == chosen.cutoff
    assert measured.prepare(float(f"{chosen.cutoff:.2g}")).cutoff == 40.0


def test_inertia_does_not_depend_on_the_cut_off_without_noise():
    """Torque I qdd at 4 Hz, which the lowest cut-off takes nine tenths of, from torque and acceleration alike."""
    t, x = sine(4.0, seconds=10.0)
    q = x[:, None]
    measured = Record(t, q, -((8 * np.pi) ** 2) * q)
    sweep = [measured.prepare(cutoff) for cutoff in (3.0, 6.0, 30.0)]
    reduced = [(p.reduce(p.qdd), p.reduce(p.tau)) for p in sweep]
    sizes = [np.sqrt(np.mean(tau**2)) / np.sqrt(np.mean(p.tau**2)) for p, (_, tau) in zip(sweep, reduced, strict=True)]
    assert sizes[0] < 0.2 < 0.9 < sizes[1] < sizes[2]
    inertias = [np.vdot(qdd, tau) / np.vdot(qdd, qdd) for qdd, tau in reduced]
    assert inertias == pytest.approx([1.0, 1.0, 1.0], rel=1e-3)  # the filter of the positions takes 1e-4 at most


# Faults


CLEAN = [
    {},
    {"torque_noise": 0.5},
    {"encoder_step": 1e-4, "torque_noise": 0.5},
    {"position_noise": 1e-4, "encoder_step": 1e-4, "torque_noise": 0.2},
]


@pytest.mark.parametrize("sensors", CLEAN, ids=["exact", "torque noise", "encoder", "noisy encoder"])
@pytest.mark.parametrize("seed", range(3))
def test_clean_measurements_have_no_findings(scene, sensors, seed):
    assert record(truth(scene, duration=4.0, seed=seed), seed, **sensors).findings == ()


def test_a_robot_that_comes_to_rest_and_goes_on_has_no_findings(scene_of_six):
    robot = scene_of_six.robot
    move = rne.trajectories.quintic(np.zeros(6), np.full(6, 0.8), 1.0)
    t = np.arange(1000) / RATE
    q, qd, qdd = (
        np.where((t < 1)[:, None], a, b)
        for a, b in zip(move(t % 1), (0.8 + move(t % 1)[0], *move(t % 1)[1:]), strict=True)
    )
    q = 1e-4 * np.rint(q / 1e-4)
    assert Record(t, q, scene_of_six.inverse_dynamics(q, qd, qdd)).findings == ()
    assert robot.n == 6


def kinds(measured):
    return [(finding.joint, finding.kind, finding.samples) for finding in measured.findings]


@pytest.mark.parametrize("sensors", CLEAN[1:], ids=["torque noise", "encoder", "noisy encoder"])
def test_planted_faults_are_found_where_they_are(true_of_six, sensors):
    wild = {(900, 1): 0.05, (901, 1): -0.04, (2000, 4): 0.02}
    fast = int(np.argmax(np.abs(true_of_six.qd[2500:3500, 0]))) + 2500
    measured = record(true_of_six, wild=wild, stuck={(fast, 0): 2}, **sensors)
    assert kinds(measured) == [
        ("joint_1", "repeated position", (fast, fast + 1)),
        ("joint_2", "position spike", (900, 901)),
        ("joint_5", "position spike", (2000,)),
    ]
    clean = record(true_of_six, **sensors).prepare(cutoff=5.0)
    assert np.abs(measured.prepare(cutoff=5.0).q - clean.q).max() < 2e-4


@pytest.mark.parametrize("first", [2, 100])
def test_spikes_are_replaced_by_a_spline_through_the_samples_on_both_sides(first):
    """A cubic one is off by 5/384 of the fourth derivative times the fourth power of the interval, others by more."""
    step, omega, count = 0.01, 10.0, np.array([1, 3])
    t = step * np.arange(200)
    exact = np.cos(omega * step * (np.arange(200)[:, None] - first - (count - 1) / 2))
    spike = (np.arange(200)[:, None] >= first) & (np.arange(200)[:, None] < first + count)
    found = Record(t, exact + 0.3 * spike, exact, bridge=5).cleaned
    assert [finding.kind for finding in found.findings] == ["position spike"] * 2
    assert (np.abs(found.q - exact).max(axis=0) < 5 / 384 * (omega * step * (count + 1)) ** 4).all()
    assert (found.q[~spike] == exact[~spike]).all()


def test_torque_spikes_are_found_and_steps_of_friction_are_not(true_of_six):
    t, q, tau = measure(true_of_six, torque_noise=0.3)
    tau[:, 2] += 20 * np.sign(true_of_six.qd[:, 2])
    tau[1234, 3] += 40
    measured = Record(t, q, tau)
    assert kinds(measured) == [("joint_4", "torque spike", (1234,))]
    assert str(measured.findings[0]) == (
        "warning: record: joint_4: torque spike at sample 1234 (t = 2.468 s); interpolated"
    )


def test_spikes_are_cut_out_where_nothing_is_to_be_bridged(true):
    t, q, tau = measure(true)
    q[2000, 0] += 0.1
    measured = Record(t, q, tau, bridge=0)
    assert measured.findings[0].cure == "cut out"
    assert len(measured.prepare(cutoff=5.0).segments) == 2


def test_a_jump_cuts_the_record(true_of_six):
    t, q, tau = measure(true_of_six, encoder_step=1e-5, torque_noise=0.2)
    q[2000:, 1] += 0.2
    q[3000:, 1] += 0.1
    measured = Record(t, q, tau)
    assert kinds(measured) == [("joint_2", "jump of the position", (1999, 2999))]
    assert measured.findings[0].text.endswith(", by up to 0.1999")
    assert len(measured.prepare(cutoff=5.0).segments) == 3


def test_two_samples_between_gaps_are_a_segment_too_short(true):
    measured = record(true, lost=[*range(900, 1000), *range(1002, 1100)], torque_noise=0.2)
    assert any(note.startswith("1 segment, 2 samples in all, left out: ") for note in measured.prepare(5.0).notes)


@pytest.mark.parametrize("lost", [(1000, 1500), (3, 503)], ids=str)
def test_samples_beside_a_gap_are_no_spikes(lost):
    """The motion goes on elsewhere; the cubic through both sides of the gap is not the motion."""
    t, w = np.arange(0, 20, 0.01), 2 * np.pi * np.array([0.21, 0.34])
    q, kept = 0.5 * np.sin(np.outer(t, w)), np.setdiff1d(np.arange(2000), np.arange(*lost))
    tau = q + 0.01 * np.random.default_rng(0).normal(size=q.shape)
    assert [f.kind for f in Record(t[kept], q[kept], tau[kept]).findings] == ["gap"]


def test_a_gap_cuts_and_single_missing_samples_are_interpolated(true):
    measured = record(true, lost=[500, *range(1500, 1540), 3000, 3001], torque_noise=0.2)
    assert [str(finding) for finding in measured.findings] == [
        "warning: record: gap after sample 1498 (t = 2.998 s); the longest lasts 0.082 s; the record is cut there",
        "warning: record: missing samples after 2 samples: 499 (t = 0.998 s), 2958 (t = 5.998 s): 3 in all; "
        "interpolated by a cubic spline",
    ]
    prepared = measured.prepare(cutoff=5.0)
    rows = np.rint(prepared.t * RATE).astype(int)
    assert len(prepared.segments) == 2
    assert np.abs(prepared.qd - true.qd[rows])[300:-300].max() < 0.05
    assert prepared.notes[-2:] == tuple(str(finding) for finding in measured.findings)


def test_samples_that_are_not_finite_are_missing(true_of_six):
    t, q, tau = measure(true_of_six)
    tau[700, 2] = np.nan
    q[900:1000, 5] = np.inf
    measured = Record(t, q, tau)
    assert kinds(measured)[:2] == [
        ("joint_6", "no finite position", tuple(range(900, 1000))),
        ("joint_3", "no finite torque", (700,)),
    ]
    assert len(measured.prepare(cutoff=5.0).segments) == 2


def accelerations_off(measured, true, rate=RATE):
    """Largest error of prepared accelerations away from the ends, as a part of the largest acceleration."""
    prepared = measured.prepare(cutoff=5.0)
    rows = np.rint((prepared.t - true.t[0]) * rate).astype(int)
    return np.abs(prepared.qdd - true.qdd[rows])[300:-300].max() / np.abs(true.qdd).max()


def taken_at(true, late):
    """Positions at times that are a little later, by Taylor's series."""
    return true.q + true.qd * late[:, None] + true.qdd * (late**2)[:, None] / 2


@pytest.mark.parametrize("jitter", [5e-5, 4e-4, 9e-4])
def test_stamps_are_believed(scene, jitter):
    """Jitter, a clock that is 0.04 % slow and wanders by 2 ms are no faults: samples were taken at the stamps."""
    true = truth(scene, duration=20.0)
    late = np.random.default_rng(0).uniform(-jitter, jitter, len(true.t)) + 4e-4 * true.t + 2e-3 * np.sin(true.t / 2)
    measured = Record(true.t + late, taken_at(true, late), true.tau)
    assert measured.findings == ()
    prepared = measured.prepare(cutoff=5.0)
    expected = np.column_stack([np.interp(prepared.t, true.t, qdd) for qdd in true.qdd.T])
    assert np.abs(prepared.qdd - expected)[300:-300].max() < 2e-3 * np.abs(true.qdd).max()
    assert prepared.notes[-1].startswith("resampled by a cubic spline through the stamps, every 2.00")


def reader_stamps(kind, t):
    """What a reader of the log makes of the times of samples that were taken in equal steps."""
    rng = np.random.default_rng(1)
    if kind == "jitter":
        return t + rng.uniform(-4e-4, 4e-4, len(t))
    if kind == "scatter":
        return np.sort(t + rng.uniform(-2e-3, 2e-3, len(t)))
    if kind == "rounded":
        return np.round(t, 2)
    k = np.arange(len(t))  # 25 samples at a time, centred
    return (k // 25 * 25 + 12) / RATE + 1e-5 * (k % 25) + np.repeat(rng.uniform(-2e-3, 2e-3, len(t) // 25), 25)


@pytest.mark.parametrize("kind", ["jitter", "scatter", "rounded", "bursts"])
@pytest.mark.parametrize("lost", [range(0), range(1500, 1800)], ids=["whole", "gap"])
def test_stamps_made_by_the_reader_are_told_and_samples_are_counted(true, kind, lost):
    t, q, tau = measure(true, encoder_step=1e-5, torque_noise=0.2)
    measured = Record(*(np.delete(x, lost, axis=0) for x in (reader_stamps(kind, t), q, tau)))
    assert [finding.kind for finding in measured.findings] == ["stamps that are not the samples'"] + ["gap"] * bool(
        lost
    )
    assert measured.findings[0].cure == "samples are counted, for the positions are smoother over equal steps"
    off = np.delete(1e3 * (reader_stamps(kind, t) - t), lost).std()  # but for the rate that is found
    text = r"differ from equal steps by (\S+) ms \(standard deviation; period (\S+) ms\)"
    told = np.array(re.fullmatch(text, measured.findings[0].text).groups(), float)
    assert told == pytest.approx([off, 2.0], rel=0.1)
    assert accelerations_off(measured, true) < 0.02  # a ms, of which times of bursts are uncertain, makes 0.004
    assert len(measured.prepare(cutoff=5.0).segments) == 1 + bool(lost)


@pytest.mark.parametrize("made_by", ["clock", "reader"])
def test_measured_velocities_decide_whose_stamps_they_are(made_by):
    """A rate that changes by a tenth and jitter: the stamps of the samples, or of what read equal steps."""
    robot = first_joints(2)
    true = truth(robot, duration=12.0, rate=200.0)
    t, rng = true.t, np.random.default_rng(3)
    other = np.sort(t + 0.05 * np.sin(2 * np.pi * t / 3) + 4e-4 * rng.normal(size=len(t)))
    taken, stamps = (other, other) if made_by == "clock" else (t, np.sort(t + 2e-3 * rng.normal(size=len(t))))
    q, qd = (np.column_stack([CubicSpline(t, x)(taken) for x in y.T]) for y in (true.q, true.qd))
    q, qd = q + 2e-3 * rng.normal(size=q.shape), qd + 0.01 * rng.normal(size=q.shape)  # too much for fourth differences
    measured = Record(stamps, q, true.tau, qd)
    reason = "for measured velocities integrate to the positions over"
    if made_by == "clock":
        assert not measured.findings
        assert f"stamps are believed, {reason} the stamps" in measured.prepare(5.0).notes
    else:
        assert measured.findings[0].cure == f"samples are counted, {reason} equal steps"


def test_a_gap_leaves_no_segment_shorter_than_a_step():
    """Two samples a third of a period apart between two gaps."""
    t = np.arange(1000) / 100
    q = np.sin(np.outer(t, [2.0, 3.0]))
    times = np.delete(t, [*range(500, 520), *range(522, 560)])
    rows = np.searchsorted(t, times)
    times[501] = times[500] + 0.004
    prepared = Record(times, q[rows], q[rows], np.gradient(q, t, axis=0)[rows], stamps="sampled").prepare(5.0)
    assert len(prepared.segments) == 2


def test_counted_samples_of_some_seconds_have_one_rate():
    """Clocks drift slower than that: the line through all stamps, whatever they scatter."""
    true = np.arange(500) / 250
    stamps = true + np.random.default_rng(4).uniform(-1e-3, 1e-3, len(true))
    steps = np.diff(equal_steps(stamps, np.zeros(len(true) - 1, dtype=bool), 1 / 250))
    np.testing.assert_allclose(steps, np.polyfit(np.arange(len(true)), stamps, 1)[0], rtol=1e-9)


def test_stamps_are_judged_beyond_doubt():
    """Noise of positions hides who made the stamps: those of a reader are told later, believed ones are always right."""
    robot = first_joints(1)
    true = truth(robot, duration=8.0, rate=100.0)

    def are_counted(seed, noise, sampled):
        rng = np.random.default_rng(seed)
        late = rng.uniform(-3e-3, 3e-3, len(true.t))
        q = taken_at(true, late * sampled) + noise * rng.normal(size=true.q.shape)
        return bool(Record(true.t + late, q, true.tau).findings)

    assert sum(are_counted(seed, 3e-3, False) for seed in range(20)) >= 18
    assert not any(are_counted(seed, 8e-3, True) for seed in range(20))


def test_a_joint_of_much_noise_hides_nothing_of_the_stamps():
    """The other joint tells that they are the reader's."""
    t, rng = np.arange(800) / 100, np.random.default_rng(0)
    q = np.sin(np.outer(t, [2.0, 3.0])) + rng.normal(size=(800, 2)) * [1e-5, 0.1]
    measured = Record(t + rng.uniform(-3e-3, 3e-3, len(t)), q, q)
    assert [finding.kind for finding in measured.findings] == ["stamps that are not the samples'"]


def test_a_clock_that_wanders_is_followed():
    """By 20 ms in half a minute: lines of 10 s each leave 9 ms of it, of 15 s 22 ms."""
    robot = first_joints(2)
    true = truth(robot, duration=60.0, rate=100.0)
    clock = true.t + 0.02 * np.sin(2 * np.pi * true.t / 30)
    stamps = clock + np.random.default_rng(0).uniform(-4e-3, 4e-3, len(clock))
    prepared = Record(stamps, true.q, true.tau).prepare(cutoff=5.0)
    expected = np.column_stack([np.interp(prepared.t, clock, q) for q in true.q.T])
    assert (np.abs(prepared.q - expected).max(0) < 0.012 * np.abs(true.qd).max(0)).all()


def test_stamps_are_what_they_are_said_to_be(true):
    t, q, tau = measure(true, clock=4e-4)
    measured = Record(t, q, tau, stamps="regular")
    assert measured.findings[0].cure == "samples are counted, as `stamps` says"
    assert accelerations_off(measured, true) < 1e-3
    believed = Record(t, q, tau, stamps="sampled")
    assert believed.findings == ()
    assert accelerations_off(believed, true) > 0.1


def test_a_sample_that_is_there_twice_counts_once(true):
    t, q, tau = (np.insert(x, 800, x[800], axis=0) for x in measure(true))
    measured = Record(t, q, tau)
    assert kinds(measured) == [("", "sample twice", (801,))]
    assert np.array_equal(measured.prepare(cutoff=5.0).q, Record(*measure(true)).prepare(cutoff=5.0).q)


def test_of_samples_closer_than_a_third_of_the_period_the_spline_takes_the_first():
    """A later one that is off by 1e-4 rad after 1e-5 s would be a jump to a rate of 10 rad/s."""
    rng = np.random.default_rng(0)
    t = np.arange(400) / 100 + rng.uniform(-1e-3, 1e-3, 400)
    tau = np.sin(t)[:, None] + 0.01 * rng.normal(size=(400, 1))
    t, q, tau = (
        np.insert(t, 201, t[200] + 1e-5),
        np.sin(2 * np.insert(t, 201, t[200])),
        np.insert(tau, 201, 0.1, axis=0),
    )
    q[201] += 1e-4
    prepared = Record(t, q[:, None], tau).prepare(cutoff=5.0)
    assert np.abs(prepared.qdd[:, 0] + 4 * np.sin(2 * prepared.t)).max() < 0.01  # of 4 rad/s^2: errors of the spline


def test_times_that_go_back_are_refused(true):
    t, q, tau = measure(true)
    t[100] = t[98] - 1e-3
    with exactly(
        "record: time that goes back at sample 100 (t = 0.195 s), after 0.198 s; "
        "sort the samples, or pass each motion as a record"
    ):
        Record(t, q, tau).prepare()


def test_one_time_for_different_samples_is_refused(true):
    t, q, tau = measure(true)
    with exactly(
        "record: one time for different samples at 3199 samples: 1 (t = 0 s), 2 (t = 0 s), 4 (t = 0.01 s) and 3196 more; "
        "give times with more digits, or the index divided by the sample rate"
    ):
        Record(np.round(t, 2), q, tau, stamps="sampled").prepare()


def test_one_time_for_different_samples_beside_a_spike_is_told():
    """Of stamps that are believed otherwise: the positions were taken at them."""
    t = np.arange(800) / 100 + np.random.default_rng(0).uniform(-4e-3, 4e-3, 800)
    q = np.sin(np.outer(t, [2.0, 3.0]))
    t[402], q[400, 0] = t[401], q[400, 0] + 0.5
    assert [finding.kind for finding in Record(t, q, q).findings] == ["one time for different samples"]


@pytest.mark.parametrize(("unit", "name"), [("1000", "milli"), ("1e6", "micro"), ("1e9", "nano")])
@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_times_that_are_not_in_seconds_are_refused(true, unit, name, start):
    t, q, tau = measure(true, encoder_step=1e-5, torque_noise=0.2)
    with pytest.raises(
        ValueError, match=f"`t` looks like {name}seconds, not seconds: .*; divide it by {unit}$"
    ) as info:
        Record((t + start) * float(unit), q, tau).prepare()
    assert str(info.value).startswith(f"record: sample rate of {RATE / float(unit):.4g} samples per second; ")


def test_slow_records_of_slow_motions_are_refused(true):
    """A sample each four seconds, at speeds that no other unit would make plausible."""
    t, q, tau = measure(true, encoder_step=1e-5, torque_noise=0.2)
    with exactly("record: sample rate of 0.25 samples per second; are the times in seconds?"):
        Record(t * 2e3, 1e4 * q, tau).prepare()


def test_the_unit_of_times_in_a_file_can_be_given(true, tmp_path):
    t, q, tau = measure(true, encoder_step=1e-5, torque_noise=0.2)
    names = [f"j{k}" for k in range(q.shape[1])]
    heading = ",".join(["t", *(f"q.{x}" for x in names), *(f"tau.{x}" for x in names)])
    np.savetxt(tmp_path / "log.csv", np.column_stack([1e3 * t, q, tau])[:200], "%.17g", ",", header=heading)
    record = Record.from_csv(tmp_path / "log.csv", names, time_unit="ms")
    np.testing.assert_allclose(record.t, t[:200], atol=1e-12)


def test_segments_too_short_for_a_spectrum_are_refused():
    t = np.arange(40) / RATE + np.repeat(np.arange(8), 5)
    with exactly("record: the segments are too short for a spectrum of the positions; give `cutoff` [Hz]"):
        Record(t, np.sin(t)[:, None], np.cos(t)[:, None]).prepare()


@pytest.mark.parametrize("t", [np.zeros(4000), np.float32(1.7e9 + np.arange(4000) / 500)])
def test_stamps_that_hardly_change_are_refused(true, t):
    """Times of a 32-bit float since 1970 change each 128 s."""
    with pytest.raises(
        ValueError, match=r"^record: one time for different samples .*; give times with more digits, or "
    ):
        Record(t, true.q[:4000], true.tau[:4000]).prepare()


def test_joints_of_one_name_are_refused(true_of_six):
    with exactly("`joint_names` must be different, got 'a' 2 times"):
        Record(true_of_six.t, true_of_six.q, true_of_six.tau, joint_names=[*"abcde", "a"])


def test_a_joint_whose_position_is_missing_is_named(true_of_six):
    q = true_of_six.q * np.where(np.arange(6) == 1, np.nan, 1)
    with pytest.raises(
        ValueError,
        match=r"too few samples: 0 are usable: joint_2 has no finite position at 4000 samples: 0 \(t = 0 s\)",
    ):
        Record(true_of_six.t, q, true_of_six.tau).prepare()


def test_few_samples_are_refused(true):
    with exactly("record: too few samples: 19 are usable; at least 20 are needed"):
        Record(true.t[:19], true.q[:19], true.tau[:19]).prepare()


def test_torques_that_do_not_follow_the_motion_are_not_used(true_of_six):
    t, q, tau = measure(true_of_six, torque_noise=0.3)
    tau[:, 5] = 0.25 + 1e-13 * np.clip(np.sin(3 * t), -0.3, 0.3)  # of digits lost by a filter
    tau[:, 1] = np.clip(tau[:, 1], None, np.percentile(tau[:, 1], 97))
    measured = Record(t, q, tau)
    flat = tuple(np.flatnonzero(tau[:, 1] == tau[:, 1].max()))
    assert [finding.kind for finding in measured.findings] == ["saturated torque", "constant torque"]
    assert set(measured.findings[0].samples) <= set(flat)
    assert len(measured.findings[0].samples) > 0.8 * len(flat)  # single samples at the edges of a plateau are none
    prepared = measured.prepare(cutoff=5.0)
    assert not prepared.valid[:, 5].any()
    assert prepared.valid[:, [0, 2, 3, 4]].all()
    reach = settling(5.0, RATE) / RATE
    near = [np.abs(prepared.times - t[k]).min(initial=9) for k in measured.findings[0].samples]
    assert min(near) < reach
    assert 0 < prepared.valid[:, 1].mean() < 1


@pytest.mark.parametrize("torque_noise", [0.0, 0.3, 5.0], ids=["smooth", "noisy", "short plateaus"])
@pytest.mark.parametrize("seed", range(3))
def test_torques_at_a_limit_are_named_whatever_their_last_digit(scene, torque_noise, seed):
    true = truth(scene, duration=20.0, seed=seed)
    t, q, tau = measure(true, seed, encoder_step=1e-5, torque_noise=torque_noise)
    limit = np.percentile(np.abs(tau[:, 1]), 93)
    at_limit = np.abs(tau[:, 1]) >= limit
    tau[:, 1] = np.clip(tau[:, 1], -limit, limit) + 0.01 * np.random.default_rng(seed).integers(-1, 2, len(t))
    (finding,) = Record(t, q, tau).findings
    assert (finding.joint, finding.kind) == ("joint_2", "saturated torque")
    assert abs(abs(float(finding.text.split()[1])) - limit) < 1e-3 * 2 * limit + 0.02
    named = np.isin(np.arange(len(t)), finding.samples)
    assert named[at_limit].mean() > 0.9
    assert (named & ~at_limit).sum() < 0.15 * at_limit.sum()  # close to it


@pytest.mark.parametrize(("samples", "is_limit"), [(9, False), (10, True)])
def test_ten_samples_at_a_limit_make_one(samples, is_limit):
    x = np.sin(2 * np.pi * (np.arange(1000) + 0.3) / 1000)
    x = np.minimum(x, np.sort(x)[-samples])
    assert clipped(x, 0.0, np.ones(1000, bool), np.zeros(1000, bool)).sum() == samples * is_limit


def test_single_samples_at_the_top_do_not_hide_that_a_plateau_is_quiet():
    """A plateau of three samples and eight peaks that just touch it: what changes beside the peaks is not at the limit."""
    x = 2 * np.abs((np.arange(1800) / 200 + 0.5) % 1 - 0.5)
    x[99:102] = x[100]
    assert clipped(x, 0.0, np.ones(1800, bool), np.zeros(1800, bool)).any()


@pytest.mark.parametrize(("plateaus", "is_limit"), [(2, False), (3, True)])
def test_three_plateaus_make_a_limit_where_it_flickers(plateaus, is_limit):
    """Digits at the limit change as much as the torque does elsewhere."""
    count = 1000 * plateaus
    x = 5 * np.sin(2 * np.pi * np.arange(count) / 1000)
    x[x > 4] = 4 + 0.01 * np.random.default_rng(0).integers(-1, 2, (x > 4).sum())
    assert clipped(x, 0.01, np.ones(count, bool), np.zeros(count, bool)).any() == is_limit


@pytest.mark.parametrize("torque_noise", [0.0, 0.01, 0.1, 1.0])
def test_steady_acceleration_is_no_limit(torque_noise):
    """Trapezoids of velocity: the torque of a joint about a vertical axis is constant for as long as it accelerates."""
    moves = np.concatenate([np.linspace(0, 1, 200), np.ones(100), np.linspace(1, 0, 200), np.zeros(200)])
    qd = np.concatenate([moves, -moves] * 4)
    q, qdd = np.cumsum(qd) / RATE, np.gradient(qd) * RATE
    rng = np.random.default_rng(0)
    tau = 3 * qdd + 5 * qd + 4 * np.tanh(qd / 0.01) + torque_noise * rng.normal(size=len(qd))
    measured = Record(np.arange(len(q)) / RATE, q[:, None], tau[:, None])
    assert "saturated torque" not in [finding.kind for finding in measured.findings]


@pytest.mark.parametrize("changes", [0, 1, 500])
def test_a_joint_that_does_not_move_is_named(true_of_six, changes):
    """Its position is constant, or flickers between two values of the encoder."""
    t, q, tau = measure(true_of_six, encoder_step=1e-4)
    q[:, 3] = 0.2
    q[np.linspace(100, 3900, changes, dtype=int), 3] += 1e-4
    measured = Record(t, q, tau)
    text = "joint_4: no motion at any time; its friction and rotor cannot be found from this record"
    assert f"warning: record: {text}" in [str(finding) for finding in measured.findings]
    assert {finding.joint for finding in measured.findings} == {"joint_4"}
    assert measured.prepare().usable.all()  # the joint's torques say something of the bodies


def test_a_joint_at_rest_repeats_no_position(scene_of_six):
    """It flickers between values of its encoder, and moves in the middle of the record."""
    true_of_six = truth(scene_of_six, duration=8.0)
    t, q, tau = measure(true_of_six, encoder_step=1e-4, torque_noise=0.3)
    s = np.clip((t - 3) / 2, 0, 1)
    moved = 0.8 * s**3 * (10 - 15 * s + 6 * s**2)
    for noise in (0.0, 2e-5, 5e-5):
        q[:, 3] = 1e-4 * np.rint((moved + noise * np.random.default_rng(0).normal(size=len(t))) / 1e-4)
        assert Record(t, q, tau).findings == ()


def test_a_pose_is_no_motion(true):
    t, q, tau = measure(true, torque_noise=0.3)
    pose = np.zeros_like(q)
    pose[::50] += 1e-4
    for rest in (np.zeros_like(q), pose):
        for cutoff in (None, 5.0):
            with exactly(
                "record: no motion of any joint; nothing can be found from one pose: measure while the joints move"
            ):
                Record(t, rest, tau).prepare(cutoff)


def test_rates_that_are_not_those_of_the_positions_are_named(true_of_six):
    t, q, tau = measure(true_of_six, encoder_step=1e-5)
    assert Record(t, q, tau, true_of_six.qd).findings == ()
    wrong = true_of_six.qd * [1, 1, np.rad2deg(1), 1, -1, 1]
    assert [str(finding) for finding in Record(t, q, tau, wrong).findings] == [
        "warning: record: joint_3: measured velocities are 57.3 times those of the positions; "
        "the velocities are not used; check their unit, sign and joint",
        "warning: record: joint_5: measured velocities are -1 times those of the positions; "
        "the velocities are not used; check their unit, sign and joint",
    ]


@pytest.mark.parametrize("lost", [4, 8])
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_stamps_of_a_log_that_has_lost_a_sample_near_its_ends_are_believed(lost, noise):
    """Where the velocity is least known, by which stamps are judged; all steps are whole periods."""
    t = np.arange(200) / 100
    q = np.sin(np.pi * t[:, None] + 0.7 * np.arange(6))
    q += noise * np.random.default_rng(0).normal(size=q.shape)
    t, q = (np.delete(x, lost, 0) for x in (t, q))
    assert [str(x).split(" after")[0] for x in Record(t, q, q).findings] == ["warning: record: missing samples"]


@pytest.mark.parametrize("pauses", [1, 2, 3])
@pytest.mark.parametrize(("count", "lost"), [(60, 5), (60, 10), (120, 10)])
def test_stamps_of_a_short_log_with_pauses_are_believed(count, lost, pauses):
    """However large the share of the pauses: all steps are whole periods, and no sample is moved in time."""
    t = np.arange(count) / 50
    t = np.delete(t, [k * count // (pauses + 1) + np.arange(lost) for k in range(1, pauses + 1)])
    log = Record(t, q := np.column_stack([np.sin(6 * t), np.cos(7 * t)]), q)
    assert [finding.kind for finding in log.findings] == ["gap"]
    np.testing.assert_allclose(log.cleaned.t, t, rtol=0, atol=1e-14)  # to rounding of 2.4 s


def test_rates_of_a_record_too_short_to_compare_are_no_error(true):
    """Shorter than the span over which they are integrated, as with times in hours."""
    t, q, tau = measure(true)
    assert not any("velocities" in str(x) for x in Record(t / 3600, q, tau, true.qd).findings)


@pytest.mark.parametrize("part", [0.005, 0.05])
def test_rates_of_a_joint_that_hardly_moves_are_not_compared(true_of_six, part):
    """They are noise below 1 % of the fastest joint's."""
    q, qd = true_of_six.q.copy(), true_of_six.qd.copy()
    scale = part * np.ptp(q[:, 0]) / np.ptp(q[:, 5])
    q[:, 5], qd[:, 5] = scale * q[:, 5], 2 * scale * qd[:, 5]
    assert len(Record(true_of_six.t, q, true_of_six.tau, qd).findings) == (part > 0.01)


def test_few_differences_tell_no_step_of_an_encoder():
    for count, step in ((20, 0.0), (60, 0.5)):
        q = np.repeat(0.5 * np.arange(count), 10)[:, None]
        assert Record(np.arange(len(q)) / 100, q, np.cos(q)).encoder_step == step


def polled(q, most, seed=0):
    """Positions of which each is repeated up to `most` times, as of a controller that is asked now and then."""
    starts = np.cumsum(np.random.default_rng(seed).integers(1, most + 1, len(q)))
    last = np.searchsorted(starts, np.arange(len(q)), side="right")
    return q[np.concatenate([[0], starts])[last].clip(max=len(q) - 1)]


def acceleration_errors(prepared, true):
    """Of each joint's reduced accelerations, as a part of their size."""
    rows = np.rint(prepared.t * RATE).astype(int)
    error, size = prepared.reduce(prepared.qdd - true.qdd[rows]), prepared.reduce(true.qdd[rows])
    return np.sqrt((error**2).mean(0) / (size**2).mean(0))


@pytest.mark.parametrize("most", [4, 10])
def test_positions_that_repeat_and_jump_do_not_spoil_what_rates_measure(scene_of_six, most):
    true_of_six = truth(scene_of_six, duration=20.0)
    rng = np.random.default_rng(0)
    tau = true_of_six.tau + 0.3 * rng.normal(size=true_of_six.tau.shape)
    q, qd = polled(true_of_six.q, most), true_of_six.qd + 1e-3 * rng.normal(size=true_of_six.qd.shape)
    without, fused = Record(true_of_six.t, q, tau).prepare(), Record(true_of_six.t, q, tau, qd).prepare()
    source = "chosen from the spectrum of the positions and measured velocities: "
    assert fused.notes[0].startswith(f"cut-off 3.75 Hz, {source}")
    assert fused.notes[1].startswith(
        "velocities as measured above a crossover, from the positions below it: 0.1, 0.1, "
    )
    assert acceleration_errors(fused, true_of_six).max() < 2e-3
    assert acceleration_errors(without, true_of_six).max() > 5e-3
    assert without.notes[1].startswith(
        "warning: the spectrum asks for a cut-off above 100 Hz, a fifth of the sample rate"
    )
    assert 2 < without.cutoff < 5  # what positions and torques have in common: the motion


@pytest.mark.parametrize("rounded", [0.0, 1e-2])
def test_rates_take_over_where_their_noise_is_less(scene, rounded):
    """A coarse encoder: below the crossover of about 2 Hz positions are better, above it velocities, rounded or not."""
    true = truth(scene, duration=20.0)
    t, q, tau = measure(true, encoder_step=5e-4, torque_noise=0.3)
    qd = true.qd + 1e-3 * np.random.default_rng(0).normal(size=true.qd.shape)
    qd = rounded * np.rint(qd / rounded) if rounded else qd
    fused, alone = (acceleration_errors(Record(t, q, tau, rates).prepare(), true) for rates in (qd, None))
    assert (fused < (1.0 if rounded else 0.7) * alone).all()


@pytest.mark.parametrize("kind", ["late", "noisy"])
def test_positions_alone_count_where_they_are_better(scene, kind):
    """Velocities of a drive's filter at 20 Hz come 8 ms late, however little noise they have."""
    true = truth(scene, duration=20.0)
    t, q, tau = measure(true, encoder_step=1e-5, torque_noise=0.3)
    late = lfilter([0.22], [1, -0.78], true.qd, axis=0)
    qd = late if kind == "late" else true.qd + 0.1 * np.random.default_rng(0).normal(size=q.shape)
    prepared = Record(t, q, tau, qd).prepare()
    assert "velocities from the positions: the measured ones are noisier, or late" in prepared.notes
    assert np.array_equal(prepared.qdd, Record(t, q, tau).prepare().qdd)


def test_measured_velocities_count_below_a_quarter_of_the_sample_rate_alone():
    """With ever more noise the crossover rises, to 25 Hz; from there on positions alone are used."""
    t, rng = np.arange(2000) / 100, np.random.default_rng(0)
    q, qd = np.sin(2 * t)[:, None], 2 * np.cos(2 * t)[:, None]
    of_q, of_qd = 1e-4 * rng.normal(size=(2, *q.shape))
    named = r"velocities as measured above a crossover, from the positions below it: (\S+) Hz by joint"
    found = []
    for level in (80, 110, 140, 170):  # [1/s], of the velocities' noise over that of the positions
        notes = Record(t, q + of_q, q, qd + level * of_qd).prepare(5.0).notes
        found += [float(match[1]) for match in (re.fullmatch(named, note) for note in notes) if match]
    assert 1 < len(found) < 4
    assert sorted(found) == found
    assert 25 * 80 / 110 < found[-1] < 25


def test_degrees_are_named_and_not_guessed(true_of_six):
    t, q, tau = measure(true_of_six)
    degrees = Record(t, np.rad2deg(q), tau)
    assert {finding.kind for finding in degrees.findings} == {"range of the positions"}
    assert np.allclose(Record(t, np.rad2deg(q), tau, unit="deg").q, q, rtol=1e-15)
    mixed = Record(t, q * [1, 1, 180 / np.pi, 1, 1, 1], tau, unit=["rad", "m", "deg", "rad", "rad", "rad"])
    assert np.allclose(mixed.q, q, rtol=1e-15)


def test_the_encoders_step_is_told(true):
    measured = record(true, encoder_step=2 * np.pi / 2**16)
    assert measured.encoder_step == pytest.approx(2 * np.pi / 2**16, rel=1e-9)
    assert not record(true, position_noise=1e-4).encoder_step.any()


# Motors


def motors(rng, n=6):
    ratios = rng.uniform(30, 120, n) * np.where(np.arange(n) == 3, -1, 1)
    coupling = np.eye(n)
    coupling[5, 4] = 1.0
    return ratios, coupling


def test_power_is_the_same_at_motors_and_joints(true_of_six):
    ratios, coupling = motors(np.random.default_rng(3))
    K = np.diag(ratios) @ coupling
    gains = np.linspace(0.2, 0.7, 6)
    offsets = np.linspace(-1, 1, 6)
    motor_tau = np.linalg.solve(K.T, true_of_six.tau.T).T
    measured = Record.from_motors(
        true_of_six.t,
        np.rad2deg((true_of_six.q - offsets) @ K.T),
        motor_tau / gains,
        np.rad2deg(true_of_six.qd @ K.T),
        ratios=ratios,
        coupling=coupling,
        drive_gains=gains,
        offsets=offsets,
        unit="deg",
    )
    for got, expected in ((measured.q, true_of_six.q), (measured.qd, true_of_six.qd), (measured.tau, true_of_six.tau)):
        assert np.abs(got - expected).max() < 1e-13 * np.abs(expected).max()
    power = (motor_tau * (true_of_six.qd @ K.T)).sum(-1)
    assert np.abs((measured.tau * measured.qd).sum(-1) - power).max() < 1e-13 * np.abs(power).max()
    assert measured.findings == ()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"ratios": [100, 80, 0]}, "`ratios` must not be zero, got zero for joint 3"),
        ({"ratios": [100, 80]}, "`ratios` must have shape (3,), got (2,)"),
        ({"ratios": [1, 1, 1], "drive_gains": [0, 1, 1]}, "`drive_gains` must not be zero, got zero for joint 1"),
        ({"ratios": [1, 1, 1], "coupling": np.eye(2)}, "`coupling` must have shape (3, 3), got (2, 2)"),
        (
            {"ratios": [1, 1, 1], "coupling": [[1, 0, 0], [0, 1, 1], [0, 1, 1]]},
            "`coupling` must be invertible: joint positions do not follow from the motors' through a singular matrix",
        ),
        ({"ratios": [1, 1, 1], "unit": "turns"}, '`unit` must be "rad" or "deg" for motors, got \'turns\''),
    ],
)
def test_gears_that_are_none_are_refused(options, text):
    with exactly(text):
        Record.from_motors(np.arange(50) / 50, np.zeros((50, 3)), np.zeros((50, 3)), **options)


# Sources and arguments


def test_a_simulated_motion_and_its_file_are_the_same_record(scene_of_six, tmp_path):
    t = np.arange(61) / 100
    motion = rne.simulate(scene_of_six, [0.3] * 6, [0] * 6, 0.6, torque=[1, 2, 3, 1, 1, 1], t_eval=t)
    measured = Record.from_trajectory(motion, 100)
    assert measured.joint_names == scene_of_six.robot.joint_names
    for model, names in ((loaded("ur5").model, loaded("ur5").joint_names), (None, measured.joint_names)):  # of numbers
        assert Record.from_trajectory(replace(motion, model=model), 100).joint_names == names
    file = motion.to_csv(tmp_path / "motion.csv")
    read = Record.from_csv(file, scene_of_six.robot.joint_names)
    assert read.name == "motion.csv"
    for name in ("t", "q", "qd", "tau"):
        assert np.allclose(getattr(read, name), getattr(measured, name), rtol=0, atol=1e-12)


def test_a_simulated_motion_that_is_reported_late_has_no_sample_after_its_end():
    t = np.arange(20, 61) / 100
    motion = rne.simulate(rne.Robot(straight_chain(1), "numpy"), [0.3], [0.0], 0.6, t_eval=t)
    assert np.allclose(Record.from_trajectory(motion, 100).t, t, rtol=0, atol=1e-12)


def test_short_rows_of_a_file_are_named(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("t,q.a,tau.a\n0,1,2\n0.1,1\n")
    with exactly(f"{file}, row 3: must have 3 entries as the heading has, got 2"):
        Record.from_csv(file, ["a"])


def test_a_file_without_torques_is_refused(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("t,q.a\n0,1\n0.1,1\n")
    with exactly(f"{file}, row 1: there is no column 'tau.a', which is needed; there are 't', 'q.a'"):
        Record.from_csv(file, ["a"])


def test_columns_of_other_joints_are_named(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("t,q.joint_1,q.joint_2,tau.joint_1,tau.joint_2\n0,1,2,3,4\n0.1,1,2,3,4\n")
    text = "there is no column 'q.a', 'q.b', which is needed; there are 'q.joint_1', 'q.joint_2'"
    with exactly(f"{file}, row 1: {text}"):
        Record.from_csv(file, ["a", "b"])


@pytest.mark.parametrize(("joints", "kind"), [(loaded("irb140"), "Robot"), ("a", "str")])
def test_joint_names_are_names(joints, kind, tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("t,q.a,tau.a\n0,1,2\n")
    text = f"`joint_names` must be a sequence of str, such as robot.joint_names, got {kind}"
    with pytest.raises(TypeError, match=f"^{re.escape(text)}$"):
        Record.from_csv(file, joints)


def test_entries_left_out_of_a_file_are_missing_values(tmp_path):
    file = tmp_path / "log.csv"
    t = np.arange(60) / 60
    entries = [
        [f"{x:.6f}" for x in row] for row in np.column_stack([t, np.sin(6 * t), np.cos(6 * t), 6 * np.cos(6 * t)])
    ]
    entries[20][1], entries[30][2], entries[40][3] = "", " NaN", "nan"
    file.write_text("\n".join(["t,q.a,tau.a,qd.a", *(",".join(row) for row in entries)]))
    assert kinds(Record.from_csv(file, ["a"]))[:3] == [
        ("a", "no finite position", (20,)),
        ("a", "no finite torque", (30,)),
        ("a", "no finite velocity", (40,)),
    ]
    for wrong, column in (("", "t"), ("nan", "t"), ("inf", "q.a"), ("up", "q.a")):
        row = [wrong, "1", "2", "3"] if column == "t" else ["0", wrong, "2", "3"]
        file.write_text("t,q.a,tau.a,qd.a\n" + ",".join(row) + "\n")
        with exactly(f"{file}, row 2, column '{column}': must be a finite number, got {wrong!r}"):
            Record.from_csv(file, ["a"])


T, Q = np.arange(60) / 60, np.zeros((60, 2))


@pytest.mark.parametrize(
    ("arguments", "options", "text"),
    [
        ((T, Q[0], Q), {}, "`q` must have shape (T, n), got (2,)"),
        ((T, Q, Q[:, :1]), {}, "`tau` must have shape (60, 2), got (60, 1)"),
        ((T[1:], Q, Q), {}, "`t` must have shape (60,), got (59,)"),
        ((np.where(T > 0.5, np.nan, T), Q, Q), {}, "`t` must be finite, got nan at index (31,)"),
        ((T, Q, Q, Q + 1j), {}, "`qd` must be real, got dtype complex128"),
        ((T, Q, Q), {"joint_names": ["a"]}, "`joint_names` must have 2 names, got 1"),
        ((T, Q, Q), {"unit": "grad"}, '`unit` must be "rad", "m" or "deg", or 2 of them, got \'grad\''),
        ((T, Q, Q), {"stamps": "late"}, '`stamps` must be "auto", "sampled" or "regular", got \'late\''),
        ((T, Q, Q), {"bridge": -1}, "`bridge` must be a whole number of at least 0, got -1"),
    ],
)
def test_arguments_are_checked(arguments, options, text):
    with exactly(text):
        Record(*arguments, **options)


def test_what_cannot_be_prepared_says_why(true_of_six):
    measured = Record(*measure(true_of_six))
    for options, text in (
        ({"cutoff": 200.0}, "`cutoff` must be at most 100 Hz, a fifth of the sample rate, got 200"),
        ({"cutoff": -1.0}, "`cutoff` must be positive, got -1.0"),
    ):
        with exactly(text):
            measured.prepare(**options)
    with pytest.raises(ValueError, match=r"^record: a cut-off of 0\.2 Hz needs a segment of "):
        measured.prepare(cutoff=0.2)
    constant_rate = np.arange(4000)[:, None] / 1024 * np.ones(6)
    with exactly("record: the positions show no motion above their noise; give `cutoff` [Hz]"):
        Record(true_of_six.t, constant_rate, true_of_six.tau).prepare()
    prepared = measured.prepare(cutoff=5.0)
    with exactly(f"`columns` must have {len(prepared.t)} rows, one for each time of the grid, got (4000, 6)"):
        prepared.reduce(true_of_six.tau)
    with pytest.raises(ValueError, match="`columns` must be finite"):
        prepared.reduce(np.full(len(prepared.t), np.nan))


@pytest.mark.parametrize("k", [2, 3, 7])
def test_blocks_are_all_rows_once_and_stay_within_segments(true, k):
    prepared = record(true, lost=range(1500, 1560)).prepare(cutoff=5.0)
    blocks = prepared.blocks(k)
    rows = np.concatenate([np.arange(len(prepared.times))[block] for block in blocks])
    assert len(blocks) == k
    assert np.array_equal(rows, np.arange(len(prepared.times)))
    for block in blocks:
        assert np.ptp(np.diff(prepared.times[block])) < 1e-9  # no step over the gap
    for wrong in (1, 10_000, True):
        with pytest.raises(ValueError, match="`k` must be an integer from 2 to the number of reduced rows"):
            prepared.blocks(wrong)


def test_a_part_of_a_record_is_a_record(true):
    part = record(true).between(1.0, 3.0)
    assert (part.t[0], part.t[-1]) == (1.0, 3.0)
    with exactly("there are no samples between 7 and 8 s: the record's are from 1 to 3 s"):
        part.between(7, 8)


def test_texts_count_seconds_from_the_first_stamp(true):
    """Stamps since 1970; the first is told once."""
    t, q, tau = measure(true)
    q[700, 0] += 0.3
    stamped = Record(1681917731.0 + t, q, tau)
    assert str(stamped.findings[0]).startswith("warning: record: joint_1: position spike at sample 700 (t = 1.4 s)")
    assert "s from 1681917731.000 s on" in repr(stamped)
    assert "times are counted from the first stamp, 1681917731.000 s" in stamped.prepare().notes
    with exactly("there are no samples between 0 and 2 s: the record's are from 1681917731 to 1681917739 s"):
        stamped.between(0, 2)


@pytest.mark.parametrize("missing", [0.0, np.nan])
def test_torques_that_were_not_recorded_are_told_as_such(true, missing):
    t, q, tau = measure(true)
    unpublished = Record(t, q, np.full_like(tau, missing))
    with pytest.raises(ValueError, match=r"^record: no torque in any sample, all are zero or missing; did the driver "):
        unpublished.prepare()
    assert "constant torque" not in [finding.kind for finding in unpublished.findings]
    tau[:, -1] = missing
    kinds = [finding.kind for finding in Record(t, q, tau).findings if finding.joint]
    assert kinds == ["torque missing" if np.isnan(missing) else "constant torque"]


def test_an_arm_at_rest_has_one_finding(true):
    rng = np.random.default_rng(0)
    q, qd = 0.3 + 1e-5 * rng.normal(size=true.q.shape), 1e-3 * rng.normal(size=true.q.shape)
    (finding,) = Record(true.t, q, true.tau, qd).findings
    assert finding.message == (
        "record: no motion of any joint; nothing can be found from one pose: measure while the joints move"
    )


def test_a_record_that_jumps_cut_into_pieces_gets_a_cutoff_of_the_motion():
    """Many pieces in 20 s, positions that repeat: coherence needs spectra of several pieces, and finds the motion's 0.5 Hz."""
    rng, robot = np.random.default_rng(1), rne.load("ur5")
    true = truth(robot, 20.0, 1000.0, seed=1)
    tau = true.tau + 0.05 * np.sqrt((true.tau**2).mean(0)) * rng.standard_normal(true.tau.shape)
    sent = np.maximum.accumulate(np.where(rng.random(len(true.t)) < 0.2, np.arange(len(true.t)), 0))
    walk = np.cumsum(0.002 * rng.normal(size=true.q.shape) * (rng.random(true.q.shape) < 0.002), axis=0)
    prepared = Record(true.t, true.q[sent] + walk, tau).prepare()
    assert len(prepared.segments) > 3
    assert prepared.cutoff < 10
    assert "of what torques and positions have in common" in prepared.notes[0]


def test_samples_lost_from_a_log_that_counts_them_on_are_found():
    """A logger numbers what it got: in 25 places all positions jump at once, and the record is cut there."""
    robot, rng = first_joints(), np.random.default_rng(0)
    true = truth(robot, 10.0, rate=250.0, seed=2)
    kept, starts = np.ones(len(true.t), bool), np.sort(rng.choice(np.arange(50, 2450, 50), 25, replace=False))
    for start in starts:
        kept[start : start + 12] = False
    record = Record(true.t[: kept.sum()], true.q[kept], true.tau[kept])
    (finding,) = (found for found in record.findings if found.kind == "missing samples")
    assert np.isin(finding.samples, np.flatnonzero(np.diff(np.flatnonzero(kept)) > 1)).all()
    assert len(finding.samples) > 20  # where the arm hardly moves there is no jump
    assert "most positions jump at once" in str(finding)
    assert (rne.identify(robot, record, consistent=False, causes=False).held_out < 0.01).all()
    assert not any("noise of the position" in str(found) for found in record.findings)


def test_a_joint_that_rests_and_jumps_once_is_cut():
    """Its jump is its only step, but none of an encoder: the record is cut there, and no velocity comes of it."""
    t = np.arange(0, 4, 0.01)
    q = np.column_stack([0.5 * np.sin(t), np.where(t < 2, 0.3, 1.8)])
    tau = np.cos(q) + 0.01 * np.random.default_rng(0).normal(size=q.shape)
    record = rne.identification.Record(t, q, tau)
    assert "jump of the position" in [finding.kind for finding in record.findings]
    assert abs(record.prepare(5.0).qd[:, 1]).max() < 1e-9  # it rests on both sides


def test_a_single_jump_cuts_a_log_of_less_than_a_second():
    """One is no rate of jumps, however short the log."""
    t = np.arange(0, 0.9, 0.01)
    q = np.column_stack([0.5 * np.sin(5 * t), np.where(t < 0.45, 0.3, 1.8)])
    tau = np.cos(q) + 0.01 * np.random.default_rng(0).normal(size=q.shape)
    texts = [str(finding) for finding in Record(t, q, tau).findings if finding.kind == "jump of the position"]
    assert texts == [
        "warning: record: joint_2: jump of the position after sample 44 (t = 0.44 s), by up to 1.5; "
        "the record is cut there"
    ]


def test_headings_between_commas_do_not_decide_for_rows_between_blanks(tmp_path):
    rng, t = np.random.default_rng(0), np.arange(60) / 50
    np.savetxt(tmp_path / "log.txt", np.column_stack([t, rng.random((60, 4))]), header="t, q1, q2, tau1, tau2")
    assert rne.identification.Record.from_log(tmp_path / "log.txt").q.shape == (60, 2)
