"""A thousand seconds of free swing: energy errors of DOP853, of RK45, and of the symplectic method beside them."""

import numpy as np
import pytest

import rne
from benchmarks import gauss

from .helpers import kept
from .random_robots import straight_chain

HANGING = np.array([0, np.pi, -np.pi / 2, 0, 0, 0]) + 0.1


@pytest.mark.parametrize("duration", kept([8.0, 1000.0], [8.0]))
def test_at_a_tight_tolerance_dop853_errs_less_than_a_symplectic_method(irb140, duration):
    """Measured 2.1e-9 J in 1000 s at the default absolute tolerance, and 4.2e-12 J at this one, of 78 J.

    Gauss's method of order 4 with steps of 5 ms: 8.6e-11 J for any duration. About the hanging arm, where motions are
    regular: a chaotic one ends elsewhere on every processor.
    """
    how = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12, "t_eval": np.arange(0, duration + 0.25, 0.5)}
    swing = rne.simulate(irb140, HANGING, np.zeros(6), duration, **how)
    assert np.ptp(swing.energy) <= 2e-11


@pytest.mark.parametrize("duration", kept([20.0, 60.0], [20.0]))
def test_energy_error_of_rk45_is_all_trend(irb140, duration):
    times = np.arange(0, duration + 0.1, 0.5)
    swing = rne.simulate(irb140, HANGING, np.zeros(6), duration, method="RK45", t_eval=times)
    error = swing.energy - swing.energy[0]
    assert abs(np.polyfit(times, error, 1)[0]) * duration >= np.ptp(error) / 2


def test_the_symplectic_method_compared_with_has_order_4():
    robot, x0 = rne.Robot(straight_chain(3)), np.array([0.5, 1.0, -0.5, 0.0, 0.0, 0.0])
    grid = np.array([0.0, 0.25, 0.5])
    exact = rne.simulate(robot, x0[:3], x0[3:], 0.5, rtol=1e-12, atol=1e-13, t_eval=grid)
    errors = [np.abs(gauss.swing(robot, x0, grid, h)[0] - exact.q).max() for h in (0.008, 0.004)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.4)


def test_the_symplectic_method_compared_with_is_symplectic():
    """J^T Omega J = Omega for the step's Jacobian J by differences, in (q, p)."""
    slopes = gauss.hamilton(rne.Robot(straight_chain(2)))

    def step(x, h=0.05):
        return x + h * gauss.stages(slopes, x, h, np.tile(slopes(x[None]), (2, 1))).mean(axis=0)

    x, d = np.array([0.4, 1.0, 0.3, -0.2]), 1e-5
    J = np.stack([(step(x + d * e) - step(x - d * e)) / (2 * d) for e in np.eye(4)], axis=1)
    omega = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]])
    assert np.abs(J.T @ omega @ J - omega).max() <= 1e-8  # of the differences
