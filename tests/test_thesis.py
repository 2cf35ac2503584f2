"""Every simulation of Høifødt 2011, chapters 6 and 7, with the figure that its plots show or hide."""

import numpy as np
import pytest

import rne
from examples.thesis import appendix_c
from examples.thesis.experiments import wrong_height
from examples.thesis.formulations import irb140_mirrored, simulated
from examples.thesis.loop_plots import inputs
from rne.model.abb_irb140 import CLOSED_LOOPS

from .helpers import EPS, KD, KP, kept

PI = np.pi
STRETCHED_OUT = np.array([0, PI / 2, -PI / 2, 0, 0, 0])
REST = np.zeros(6)
TIGHT = {"rtol": 1e-9, "atol": 1e-12}


@pytest.fixture(scope="module")
def holding(irb140):
    """The torque of (6.21)."""
    return irb140.gravity_torque(STRETCHED_OUT)


def first_time(motion, distance, centre):
    """When some joint is first further than `distance` from `centre`, between samples by interpolation."""
    apart = np.abs(motion.q - centre).max(axis=1)
    k = int(np.argmax(apart > distance))
    assert apart[k] > distance
    share = (distance - apart[k - 1]) / (apart[k] - apart[k - 1])
    return motion.t[k - 1] + share * (motion.t[k] - motion.t[k - 1])


def test_holding_torque_is_that_of_6_21(holding):
    assert holding / 9.81 == pytest.approx([0, -16.191, -2.409, 0, -0.029, 0], abs=1e-3)


@pytest.mark.parametrize(
    ("start", "tenth", "one"),
    [([0] * 6, 0.082, 0.2415), ([0, PI, -PI / 2, 0, 0, 0], 0.0795, 0.295)],
    ids=["6.3-1", "6.3-2"],
)
def test_constant_torque_is_unstable(irb140, holding, start, tenth, one):
    motion = rne.simulate(irb140, start, REST, 0.5, torque=holding, t_eval=np.linspace(0, 0.5, 5001), **TIGHT)
    assert first_time(motion, 0.1, start) == pytest.approx(tenth, abs=5e-4)
    assert first_time(motion, 1.0, start) == pytest.approx(one, abs=5e-4)


def test_6_3_3_stays_put(irb140, holding):
    """dg/dq vanishes there: an error grows as t^2, not exponentially."""
    slope = rne.kernels.derivative(rne.dynamics.gravity_torque, irb140.model, "q")(STRETCHED_OUT)
    motion = rne.simulate(irb140, STRETCHED_OUT, REST, 10.0, torque=holding)
    assert np.abs(motion.q - STRETCHED_OUT).max() <= 6e-12
    assert np.abs(slope).max() <= 1e-13 * np.abs(holding).max()
    assert np.abs(rne.kernels.derivative(rne.dynamics.gravity_torque, irb140.model, "q")(REST)).max() > 1


def test_6_3_4_collapses_after_four_seconds(irb140, holding):
    start = STRETCHED_OUT + [0, 0.05, 0, 0, 0, 0]
    times = np.linspace(0, 6, 6001)
    motion = rne.simulate(irb140, start, REST, 6.0, torque=holding, t_eval=times, **TIGHT)
    assert first_time(motion, 0.1, STRETCHED_OUT) == pytest.approx(4.242, abs=0.01)
    assert first_time(motion, 1.0, STRETCHED_OUT) == pytest.approx(5.418, abs=0.01)


def test_6_4_keeps_its_energy_while_a_small_offset_grows(irb140):
    """An offset of 1e-6 rad gives an entirely different motion, both of constant energy: figures 6.6 to 6.9."""
    times = np.linspace(0, 6, 2401)
    runs = [(0.0, np.linspace(0, 10, 4001)), (1e-6, times)]
    swings = [rne.simulate(irb140, [0, x, 0, 0, 0, 0], REST, t[-1], t_eval=t, **TIGHT) for x, t in runs]
    assert [s.energy[0] for s in swings] == pytest.approx([370.876860, 370.876836], abs=1e-6)
    assert max(s.energy_drift for s in swings) <= 1e-6
    assert [s.kinetic.max() for s in swings] == pytest.approx([293.5, 293.4], abs=0.05)
    assert [s.potential.min() for s in swings] == pytest.approx([77.3, 77.5], abs=0.05)
    printed = [np.ptp(wrong_height(s)[s.t <= 5]) for s in swings]  # with the height of (6.38)
    assert printed == pytest.approx([0.79, 0.78], abs=5e-3)
    apart = np.abs(swings[0].q[: len(times)] - swings[1].q).max(axis=1)
    assert times[np.argmax(apart > 1e-3)] == pytest.approx(3.0, abs=0.01)
    assert times[np.argmax(apart > 1.0)] == pytest.approx(5.69, abs=0.01)


LOOPS = dict(zip(["6.5-1", "6.5-2", "6.5-3"], CLOSED_LOOPS, strict=True))
ONE_LOOP = pytest.mark.parametrize("loop", kept(LOOPS, ["6.5-3"]), indirect=True)


@pytest.fixture(scope="module", params=LOOPS)
def loop(request, irb140):
    run = LOOPS[request.param]
    return run, rne.Scene(irb140, controller=rne.control.pd_gravity(irb140, KP, KD, run.reference))


FIGURES_OF_LOOPS = {  # each joint within 0.01 rad [s]; a joint, its largest excursion beyond its reference [rad]; u(0)
    CLOSED_LOOPS[0]: ([1.123, 2.814, 1.677, 2.268, 2.022, 2.109], 2, 0.222, [78.5, 0, -78.5, 157.1, 78.5, -188.5]),
    CLOSED_LOOPS[1]: ([2.093, 2.000, 2.362, 2.278, 2.035, 0], 1, 0.305, [157.1, -157.1, 78.5, 157.1, -78.5, 0]),
    CLOSED_LOOPS[2]: (
        [2.365, 3.002, 2.831, 2.261, 2.034, 2.109],
        1,
        -0.548,
        [-157.1, 78.5, -78.5, -157.1, -78.5, 188.5],
    ),
}


@ONE_LOOP
def test_closed_loop_settles(loop):
    """Figures 6.11 to 6.16."""
    scene_of_thesis, scene = loop
    settled, joint, beyond, first = FIGURES_OF_LOOPS[scene_of_thesis]
    times = np.linspace(0, 5, 5001)
    motion = rne.simulate(scene, scene_of_thesis.start, REST, 5.0, t_eval=times)
    error = motion.q - scene_of_thesis.reference
    last = [np.flatnonzero(outside) for outside in (np.abs(error) > 0.01).T]
    assert [times[k[-1] + 1] if len(k) else 0.0 for k in last] == pytest.approx(settled, abs=2e-3)
    assert (np.sign(beyond) * error[:, joint - 1]).max() == pytest.approx(abs(beyond), abs=1e-3)
    u = inputs(motion, scene_of_thesis.reference)
    assert u[0] == pytest.approx(first, abs=0.05)
    assert u[-1] == pytest.approx(0, abs=0.1)  # 7e-4 rad are left
    assert motion.method == "LSODA"
    assert motion.evaluations <= 2500


def test_gravity_may_be_compensated_or_left_out(irb140):
    """(6.48) on the arm and (6.58) on an arm without gravity, figure 6.10, are one motion: (6.49) and (6.57)."""
    run, weightless = CLOSED_LOOPS[2], rne.load("irb140", gravity=(0, 0, 0))
    laws = (irb140, rne.control.pd_gravity), (weightless, rne.control.pd)
    ends = [
        rne.simulate(rne.Scene(robot, controller=law(robot, KP, KD, run.reference)), run.start, REST, 0.1, rtol=1e-8)
        for robot, law in laws
    ]
    assert np.abs(ends[0].q[-1] - ends[1].q[-1]).max() <= 1e-6
    assert np.abs(ends[0].tau[-1] - ends[1].tau[-1]).max() > 100  # gravity's share


@ONE_LOOP
@pytest.mark.parametrize("method", kept(["LSODA", "Radau", "BDF"], ["LSODA"]))
def test_lyapunov_function_falls_at_every_step(irb140, loop, method):
    """V = qd^T M qd / 2 + e^T Kp e / 2 (6.50), and dV/dt = -qd^T Kd qd (6.55) from the simulated accelerations."""
    scene_of_thesis, scene = loop
    motion = rne.simulate(scene, scene_of_thesis.start, REST, 5.0, method=method)
    e = motion.q - scene_of_thesis.reference
    V = motion.kinetic + (np.array(KP) * e**2).sum(-1) / 2
    assert (np.diff(V) <= 4 * EPS * V[0]).all()
    M, C = irb140.mass_matrix(motion.q), irb140.coriolis_matrix(motion.q, motion.qd)
    inertial = np.einsum("ti,tij,tj->t", motion.qd, M, motion.qdd) + np.einsum("ti,tij,tj->t", motion.qd, C, motion.qd)
    slope = inertial + (np.array(KP) * e * motion.qd).sum(-1)
    dissipated = -(np.array(KD) * motion.qd**2).sum(-1)
    size = np.abs(motion.tau * motion.qd).sum(-1) + np.abs(dissipated) + 1e-12
    assert (np.abs(slope - dissipated) / size).max() <= 1e-9


@ONE_LOOP
def test_stiffness_costs_the_explicit_method_a_hundred_times_the_evaluations(irb140, loop):
    """RK45 is held to about 3.3 / lambda a step whatever its tolerance: 0.25 s here, 5 s in the report."""
    scene_of_thesis, scene = loop
    explicit = rne.simulate(scene, scene_of_thesis.start, REST, 0.25, method="RK45")
    implicit = rne.simulate(scene, scene_of_thesis.start, REST, 0.25, method="LSODA")
    assert 0.25 * 28_000 <= explicit.evaluations <= 0.25 * 36_000
    assert implicit.evaluations <= explicit.evaluations / 8
    assert np.abs(explicit.q[-1] - implicit.q[-1]).max() <= 1e-5


@ONE_LOOP
def test_sampled_controller_is_unstable_beyond_2_by_lambda(irb140, loop):
    """Torques held between samples of 1.35e-4 s, more than 2 / lambda = 1.308e-4 s."""
    scene_of_thesis, unsampled = loop
    scene = rne.Scene(irb140, controller=unsampled.controller, sample_time=1.35e-4)
    try:
        rates = rne.simulate(scene, scene_of_thesis.start, REST, 0.031).qd
    except rne.SimulationError as error:
        rates = error.trajectory.qd
    assert np.abs(rates).max() >= 1e5


@ONE_LOOP
def test_sampled_controller_is_stable_below_2_by_lambda(irb140, loop):
    """1000 samples of 1.30e-4 s."""
    scene_of_thesis, unsampled = loop
    scene = rne.Scene(irb140, controller=unsampled.controller, sample_time=1.30e-4)
    motion = rne.simulate(scene, scene_of_thesis.start, REST, 0.13)
    assert np.abs(motion.qd[-1]).max() <= 10
    assert np.abs(motion.qd).max() <= 100


def test_check_gains_knows_the_limit_before_anyone_simulates(gains_of_thesis):
    gains = gains_of_thesis
    assert gains.sample_time_limit == pytest.approx(1.308e-4, rel=2e-3)
    assert gains.stable is False
    assert gains.largest_mode == pytest.approx(15291, abs=1)
    assert gains.fastest_pole == pytest.approx(15288, abs=1)
    assert gains.gravity_stiffness == pytest.approx(163, abs=1)
    assert not gains.beats_gravity


@pytest.mark.long  # tests/test_gains.py has a pendulum
def test_gains_beat_gravity_if_the_smallest_does(irb140):
    """dg/dq reaches 163 N m/rad over the workspace."""
    assert rne.check_gains(irb140, [170] * 6, KD).beats_gravity
    assert not rne.check_gains(irb140, [170] * 5 + [160], KD).beats_gravity


@pytest.mark.parametrize(
    ("q3", "stiffness"), [(-PI / 2, [-151.7, -42.2, -17.3, 0, 0, 0]), (PI / 2, [151.7, 22.2, 0, 0, 0, -32.9])]
)
def test_stiffness_at_the_equilibria_of_7_1(irb140, q3, stiffness):
    """Eigenvalues of -M^-1 dg/dq: hanging it is stable but for three joints that drift, standing it is not."""
    A, _ = irb140.linearize([0, PI, q3, 0, 0, 0], REST, REST)
    found = np.linalg.eigvals(A[6:, :6]).real
    assert sorted(found) == pytest.approx(sorted(stiffness), abs=0.05)


def test_7_1_1_hangs_still_in_both_arms(irb140):
    """The hanging equilibrium, and the same arm with q3 counted the other way."""
    flip = np.array([1, 1, -1, 1, 1, 1])
    start = np.array([0, PI, -PI / 2, 0, 0, 0])
    times = np.linspace(0, 10, 101)
    ours = rne.simulate(irb140, start, REST, 10.0, t_eval=times, **TIGHT)
    mirrored = rne.simulate(rne.Robot(irb140_mirrored()), start * flip, REST, 10.0, t_eval=times, **TIGHT)
    assert np.abs(ours.q - start).max() <= 1e-9
    assert np.abs(ours.q - mirrored.q * flip).max() <= 1e-9


@pytest.mark.parametrize("dynamics", ["forward_dynamics", "lagrange_forward_dynamics"])
def test_7_1_2_grows_at_the_rate_of_its_linearisation(irb140, dynamics):
    """When noise tips it depends on the solver; how fast it grows does not."""
    start = np.array([0, PI, PI / 2, 0, 0, 0])
    A, _ = irb140.linearize(start, REST, REST)
    squares, modes = np.linalg.eig(A[6:, :6])  # the whole A is defective: of its modes LAPACK's can be wrong
    k = int(np.argmax(squares.real))
    rate = np.sqrt(squares[k].real)
    assert rate == pytest.approx(12.318, abs=1e-3)
    mode = modes[:, k].real / np.abs(modes[:, k]).max() * 1e-6
    times = np.linspace(0, 0.5, 51)
    how = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-15}
    motion = simulated(irb140, getattr(rne.dynamics, dynamics), start + mode, rate * mode, times, **how)
    apart = np.abs(motion.q - start).max(axis=1)
    assert np.polyfit(times, np.log(apart), 1)[0] == pytest.approx(12.318, abs=0.01)


@pytest.fixture(scope="module")
def coefficients(irb140):
    """Of the kinetic energy and of the torque of joint 1, in the order of `appendix_c.PRINTED`."""
    return dict(zip(appendix_c.PRINTED, appendix_c.ours(irb140), strict=True))


@pytest.mark.parametrize("term", appendix_c.PRINTED, ids=lambda t: f"{t.entry} {t.function} {t.k}")
def test_coefficient_of_appendix_C(coefficients, term):
    """54 numbers that are legible, by Fourier coefficients of M(q) and C q'."""
    assert coefficients[term] == pytest.approx(term.coefficient, rel=0, abs=1e-12)  # hundreds of roundings of 3 kg m^2


def test_coefficients_of_a_known_sum():
    q2, q3, q4, q5 = np.moveaxis(appendix_c.samples()[..., 1:5], -1, 0)
    known = appendix_c.terms("11 0 0 0 0 cos 3\n11 1 -2 0 2 sin 0.5\n11 0 0 1 -1 cos -2\n11 1 2 0 2 sin 0")
    values = 3 + 0.5 * np.sin(q2 - 2 * q3 + 2 * q5) - 2 * np.cos(q4 - q5)
    assert appendix_c.coefficients(values, known) == pytest.approx([t.coefficient for t in known], abs=1e-15)
