"""Simulation at its edges: boundaries where they were predicted, errors where they were said to be."""

import numpy as np
import pytest

import rne

from ..helpers import kept
from ..random_robots import straight_chain
from . import motions, steps
from .motions import Top


@pytest.fixture(scope="module")
def gains(gains_of_thesis):
    return gains_of_thesis


@pytest.fixture(scope="module")
def chain():
    """Three rods that swing in a plane."""
    return rne.Robot(straight_chain(3))


@pytest.fixture(scope="module")
def fastest(gains):
    return gains.worst_q


@pytest.mark.parametrize("method", kept(steps.METHODS, list(steps.METHODS)[:1]))
@pytest.mark.parametrize("scale", kept([0.01, 100.0, 1.0], [1.0]))
def test_the_largest_stable_step_is_the_predicted_one(irb140, fastest, method, scale):
    """Over four decades of gain: 0.2 % below it a deviation shrinks in 100 steps, 0.2 % above it grows."""
    one = steps.loop(irb140, scale, fastest)
    step = steps.predicted(method, one)
    assert steps.shrinks(method, one, step * (1 - 2e-3))
    assert not steps.shrinks(method, one, step * (1 + 2e-3))


def test_check_gains_knows_the_sampled_limit(irb140, gains, fastest):
    one = steps.loop(irb140, 1.0, fastest)
    assert gains.sample_time_limit == pytest.approx(steps.predicted("sampled", one), rel=1e-6)


@pytest.mark.parametrize("methods", [("auto", "LSODA"), pytest.param(("Radau",), marks=pytest.mark.long)], ids=len)
def test_stiff_damping_costs_implicit_methods_nothing(chain, methods):
    """Explicit steps shrink in proportion to 1/damping; "auto" never takes an explicit method there."""
    mild, stiff = (motions.stiff_damping(chain, damping, methods, duration=0.15) for damping in (100.0, 1e5))
    for method in methods:
        assert stiff[method].evaluations <= 1.5 * mild[method].evaluations
        assert stiff[method].error <= 1e-5
    damped = [rne.Scene(chain, friction=rne.Friction(viscous=d)) for d in (200.0, 1000.0)]
    explicit = [rne.simulate(scene, motions.Q0[:3], np.zeros(3), 0.02, method="RK45").evaluations for scene in damped]
    assert explicit[1] / explicit[0] == pytest.approx(5, rel=0.15)


@pytest.mark.parametrize("spin", [100.0, 1e3, 3e4])
def test_a_top_in_steady_precession_stays_in_it(spin):
    """Its rates solve across cos(tilt) w^2 - about spin w + moment = 0, whatever the spin."""
    top = Top.of()
    rates = top.steady(spin, 0.6)
    run = rne.simulate(top.robot, [0.0, 0.6, 0.0], rates, 1.0, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(run.q[:, 1], 0.6, rtol=0, atol=1e-9)
    assert run.q[-1, 0] == pytest.approx(rates[0], rel=1e-9)


def test_a_released_top_nods_at_its_rate_and_keeps_its_momenta():
    """The work grows with the nutation; the momentum about the vertical is kept to the tolerance."""
    efforts = [motions.released_top(spin)[0] for spin in (300.0, 3000.0)]
    for effort in efforts:
        assert effort.error <= 1e-9
    assert efforts[1].evaluations / efforts[0].evaluations == pytest.approx(10, rel=0.3)
    top, spin = Top.of(), 1000.0
    t = np.linspace(0, 20 * np.pi / top.nutation(spin), 2001)
    run = rne.simulate(top.robot, [0, 0.6, 0], [0, 0, spin], t[-1], rtol=1e-10, atol=1e-14, t_eval=t)
    nod = 2 * top.moment * np.sin(0.6) * top.across / (top.about * spin) ** 2
    assert run.q[:, 1].max() - 0.6 == pytest.approx(nod, rel=0.02)  # to first order in the nod
    lows = np.flatnonzero((run.q[1:-1, 1] <= run.q[:-2, 1]) & (run.q[1:-1, 1] < run.q[2:, 1]))
    assert len(lows) in (9, 10)


def test_estimated_errors_of_a_chaotic_motion_are_those_measured(chain):
    """Until they saturate, measured and estimated errors agree; each passes the accuracy at the horizon."""
    for one in motions.chaos(chain, (1e-5, 1e-7), duration=3.0, points=301).values():
        inside = (one.t > 0.5) & (one.t < min(one.estimated_t[-1], 2.5)) & (one.measured < 1e-2)
        assert inside.sum() > 50
        estimated = np.interp(one.t[inside], one.estimated_t, one.estimated)
        ratio = np.log10(one.measured[inside] / estimated)
        assert np.abs(np.median(ratio)) < 0.1
        assert (np.abs(ratio) < 0.7).mean() > 0.9


@pytest.mark.long
def test_an_unstable_rest_departs_at_the_rate_of_its_linearisation():
    falling = motions.unstable_rest((1e-4, 1e-8, 0.0), duration=2.9, points=291)
    for push in (1e-4, 1e-8):
        departure = falling.departure[push]
        small = (departure > 2 * push) & (departure < 1e-2)
        rate = np.polyfit(falling.t[small], np.log(departure[small]), 1)[0]
        assert rate == pytest.approx(falling.rate, rel=0.02)
    assert falling.departure[0.0][0] == 0
    assert falling.departure[0.0][-1] > 0.1  # rounding alone


@pytest.mark.parametrize("width", kept([0.05, 1e-4], [1e-4]))
def test_pulses_are_met_if_they_are_named_and_missed_otherwise(chain, width):
    assert motions.pulse_missed(chain, width, "DOP853", named=False, impulse=0.1) > 0.99
    for method in ("DOP853", "LSODA"):
        assert motions.pulse_missed(chain, width, method, named=True, impulse=0.1) < 1e-5


@pytest.mark.long
@pytest.mark.parametrize("starts", [2, 8, 32])
def test_single_precision_follows_until_its_rounding_adds_up(irb140, starts):
    double = motions.equal_steps(irb140, (1e-2, 2e-3), np.float64, starts=starts, finest=1e-3)
    single = motions.equal_steps(irb140, (1e-2, 2e-3, 5e-4), np.float32, starts=starts, finest=1e-3)
    assert double[1e-2] / double[2e-3] == pytest.approx(5**4, rel=0.5)
    assert single[1e-2] == pytest.approx(double[1e-2], rel=0.05)
    assert single[2e-3] > 5 * double[2e-3]
    assert single[5e-4] > single[2e-3]
    assert max(single[2e-3], single[5e-4]) < 1e-4
