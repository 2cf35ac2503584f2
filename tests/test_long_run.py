"""A thousand seconds of free swing: the energy error of a symplectic method stays where it is."""

from dataclasses import replace

import numpy as np
import pytest

import rne
from benchmarks.random_robots import straight_chain
from rne.simulation import symplectic
from rne.simulation.plant import Plant
from rne.simulation.symplectic import WEIGHTS, Hamilton, solve_stages

from .helpers import kept

STARTS = {"6.4-1": np.zeros(6), "hanging": np.array([0, np.pi, -np.pi / 2, 0, 0, 0]) + 0.1}


@pytest.mark.parametrize(
    ("start", "duration", "most"),
    kept([("6.4-1", 8.0, 1e-4), ("hanging", 8.0, 1.5e-10), ("hanging", 1000.0, 1.5e-10)], [("6.4-1", 8.0, 1e-4)]),
)
def test_energy_error_has_no_trend(irb140, start, duration, most):
    """Slope times duration stays below half the band of the error, which does not grow with the duration.

    For long about the hanging arm, where motions are regular: a chaotic one ends elsewhere on every processor.
    """
    times = np.arange(0, duration + 0.25, 0.5)
    how = {"method": "gauss-4", "step": 5e-3, "t_eval": times}
    swing = rne.simulate(irb140, STARTS[start], np.zeros(6), duration, **how)
    error = swing.energy - swing.energy[0]
    band = np.ptp(error)
    assert band <= most
    assert abs(np.polyfit(times, error, 1)[0]) * duration <= band / 2


@pytest.mark.parametrize("duration", kept([20.0, 60.0], [20.0]))
def test_energy_error_of_rk45_is_all_trend(irb140, duration):
    times = np.arange(0, duration + 0.1, 0.5)
    swing = rne.simulate(irb140, STARTS["hanging"], np.zeros(6), duration, method="RK45", t_eval=times)
    error = swing.energy - swing.energy[0]
    assert abs(np.polyfit(times, error, 1)[0]) * duration >= np.ptp(error) / 2


def test_what_a_step_loses_to_rounding_is_added_to_the_next():
    """A rod turns at 0.01 rad/s from 1e9 rad, where doubles are 1.2e-7 apart and a step moves it by 1e-8."""
    rod = rne.Robot(replace(straight_chain(1), gravity=np.zeros(3)))
    motion = rne.simulate(rod, [1e9], [0.01], 1e-3, method="gauss-4", step=1e-6)
    assert np.abs(motion.q[:, 0] - (1e9 + 0.01 * motion.t)).max() <= np.spacing(1e9)
    assert motion.q[-1, 0] - 1e9 == pytest.approx(1e-5, abs=np.spacing(1e9))


def test_the_method_has_order_4():
    robot = rne.Robot(straight_chain(3))
    start = np.array([0.5, 1.0, -0.5])
    exact = rne.simulate(robot, start, 0 * start, 0.5, rtol=1e-12, atol=1e-13).q[-1]
    errors = [
        np.abs(rne.simulate(robot, start, 0 * start, 0.5, method="gauss-4", step=h).q[-1] - exact).max()
        for h in (0.008, 0.004)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.4)


def test_the_map_is_symplectic():
    """J^T Omega J = Omega for the step's Jacobian J by differences, in (q, p)."""
    robot = rne.Robot(straight_chain(2))
    system = Hamilton(Plant(rne.Scene(robot).right_hand_side, None))

    def step(x, h=0.05):
        stages = solve_stages(system, x, h, WEIGHTS, np.tile(system(x[None]), (2, 1)))
        return x + h * stages.mean(axis=0)

    x, d = np.array([0.4, 1.0, 0.3, -0.2]), 1e-5
    J = np.stack([(step(x + d * e) - step(x - d * e)) / (2 * d) for e in np.eye(4)], axis=1)
    omega = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]])
    assert np.abs(J.T @ omega @ J - omega).max() <= 1e-8  # of the differences


def test_of_large_robots_the_recursions_themselves_run(monkeypatch):
    """Of some the derivatives are too large to be written out, but not the mass matrix."""
    systems = [Hamilton(Plant(rne.Scene(rne.Robot(straight_chain(2))).right_hand_side, None)) for _ in range(2)]
    monkeypatch.setattr(systems[1].slopes, "_trace", None)
    X = np.random.default_rng(0).uniform(-1, 1, (2, 4))
    np.testing.assert_allclose(systems[1](X), systems[0](X), rtol=1e-12)


def test_values_between_steps_are_of_the_method(irb140):
    how = {"method": "gauss-4", "step": 0.01}
    asked = rne.simulate(irb140, np.zeros(6), np.zeros(6), 0.1, t_eval=[0.0, 0.023, 0.05, 0.1], **how)
    steps = rne.simulate(irb140, np.zeros(6), np.zeros(6), 0.1, **how)
    fine = rne.simulate(irb140, np.zeros(6), np.zeros(6), 0.1, t_eval=[0.0, 0.023, 0.05, 0.1], rtol=1e-11, atol=1e-13)
    assert np.array_equal(asked.q[2], steps.q[5])
    assert np.array_equal(asked.q[3], steps.q[10])
    assert np.abs(asked.q - fine.q).max() <= 1e-4


def test_slopes_continued_from_two_steps_save_evaluations(irb140, monkeypatch):
    """The stages' slopes are guessed by a polynomial through those of past steps."""
    start, how = np.zeros(6), {"method": "gauss-4", "step": 1e-3}
    from_two = rne.simulate(irb140, start, start, 0.2, **how).evaluations
    monkeypatch.setattr(symplectic, "HISTORY", 1)
    from_one = rne.simulate(irb140, start, start, 0.2, **how).evaluations
    assert 0 < from_two < 0.8 * from_one


def test_drives_and_friction_are_refused(irb140):
    scene = rne.Scene(irb140, friction=rne.Friction(viscous=1.0))
    with pytest.raises(
        ValueError, match=r"^`method` 'gauss-4' is for motions without drives, friction and stops; there is friction$"
    ):
        rne.simulate(scene, [0] * 6, [0] * 6, 1.0, method="gauss-4")


def test_a_step_too_long_is_an_error(irb140):
    with pytest.raises(rne.SimulationError, match="the stages do not converge"):
        rne.simulate(irb140, np.zeros(6), np.full(6, 50.0), 1.0, method="gauss-4", step=0.1)


def test_an_iteration_that_hardly_converges_is_given_up():
    """After 60 rounds, each of which leaves a half of the error, or 0.7 of it: 1e-18, or 5e-10."""
    largest, start, guess = np.abs(np.linalg.eigvals(WEIGHTS)).max(), np.ones(1), np.zeros((2, 1))
    K = solve_stages(lambda X: -0.5 / largest * X, start, 1.0, WEIGHTS, guess)
    np.testing.assert_allclose(K, -0.5 / largest * (1 + WEIGHTS @ K), rtol=0, atol=1e-12)
    with pytest.raises(rne.NotFiniteError, match="the stages do not converge"):
        solve_stages(lambda X: -0.7 / largest * X, start, 1.0, WEIGHTS, guess)


def test_a_step_is_refused_for_a_method_that_chooses_its_own(irb140):
    text = r"^`step` is for the equal steps of 'gauss-4'; 'RK45' chooses its own$"
    with pytest.raises(ValueError, match=text):
        rne.simulate(irb140, np.zeros(6), np.zeros(6), 1.0, method="RK45", step=0.01)
