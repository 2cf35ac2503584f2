"""Work and friction losses: the integrals of the powers along the motion that is returned, under every method."""

import numpy as np
import pytest
from scipy.integrate import simpson

import rne

from .helpers import Part, assemble, kept
from .random_robots import random_tree

METHODS = ["RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA"]
EXCHANGED = 1e-6  # of the energy exchanged


@pytest.fixture
def block():
    joint = Part(link="l", joint="j", kind="prismatic", parent=0, axis=np.eye(3)[0], mass=1.0)
    return rne.Robot(assemble("slider", [Part(link="base"), joint], gravity=(0, 0, 0)))


@pytest.mark.parametrize("method", METHODS)
def test_work_of_a_force_that_grows(block, method):
    """3 t^2 on 1 kg for 2 s: v = t^3, 32 J. LSODA once said 38 J and BDF 34 J."""
    motion = rne.simulate(block, [0.0], [0.0], 2.0, torque=lambda t, q, qd: [3 * t * t], method=method, rtol=1e-9)
    assert motion.work[-1] == pytest.approx(32.0, rel=EXCHANGED)


def check_ledger(seed, method, rtol):
    """A random robot with friction under a law: the ledger beside Simpson's rule on a fine grid of the same motion."""
    rng = np.random.default_rng(seed)
    robot = rne.Robot(random_tree(int(rng.integers(1, 5)), seed))
    n = robot.n
    friction = rne.Friction(
        viscous=rng.uniform(0, 1, n), coulomb=rng.uniform(0, 1, n), coulomb_back=rng.uniform(0, 1, n), smoothing=0.3
    )
    pull, omega = rng.uniform(1, 5, n), rng.uniform(1, 6, n)

    def law(t, q, qd):
        return pull * np.sin(omega * t) - 2 * q

    q0, t = rng.uniform(-1, 1, n), np.linspace(0, 1.5, 3001)
    scene = rne.Scene(robot, friction=friction)
    motion = rne.simulate(scene, q0, 0 * q0, 1.5, torque=law, t_eval=t, method=method, rtol=rtol, atol=rtol / 1e3)
    powers = {
        "drives": motion.tau * motion.qd,
        "viscous": friction.viscous_torque(motion.qd) * motion.qd,
        "coulomb": friction.coulomb_torque(motion.qd) * motion.qd,
    }
    exchanged = simpson(sum(np.abs(power).sum(-1) for power in powers.values()), x=t)
    found = {"drives": motion.work, **motion.dissipated}
    for name, power in powers.items():
        whole, half = simpson(power.sum(-1), x=t), simpson(power[:1501].sum(-1), x=t[:1501])
        assert found[name][-1] == pytest.approx(whole, abs=EXCHANGED * exchanged), (seed, name)
        assert found[name][1500] == pytest.approx(half, abs=EXCHANGED * exchanged), (seed, name)
    if rtol <= 1e-9:
        assert motion.energy_drift <= EXCHANGED * exchanged, seed


@pytest.mark.parametrize(
    ("method", "rtol"),
    kept(
        [*((method, 1e-6) for method in METHODS), ("DOP853", 1e-9), ("LSODA", 1e-9)],
        [("RK45", 1e-6), ("LSODA", 1e-6), ("DOP853", 1e-9)],
    ),
)
def test_ledger_is_the_integral_along_the_motion(method, rtol):
    check_ledger(0, method, rtol)


@pytest.mark.long
@pytest.mark.parametrize("method", METHODS)
def test_ledger_of_many_robots(method):
    for seed in range(1, 30):
        check_ledger(seed, method, 1e-6 if method == "RK23" else 1e-9)


def test_work_of_held_torques_is_exact(irb140):
    """Torque times displacement, sample by sample; the ledger closes to rounding and the solver's error."""
    law = rne.control.pd_gravity(irb140, [50] * 6, [2] * 6, [1] * 6)
    scene = rne.Scene(irb140, controller=law, sample_time=1e-3, friction=rne.Friction(viscous=1.0))
    motion = rne.simulate(scene, [0] * 6, [0] * 6, 0.2, rtol=1e-9)
    steps = (motion.tau[:-1] * np.diff(motion.q, axis=0)).sum(-1)
    np.testing.assert_allclose(motion.work[1:], np.cumsum(steps), rtol=1e-12, atol=1e-12)
    assert motion.energy_drift <= EXCHANGED * np.abs(motion.work).max()


def test_a_run_that_is_cut_keeps_its_ledger(block):
    def law(t, q, qd):
        return [np.nan if t > 1.0 else 3 * t * t]

    with pytest.raises(rne.SimulationError) as caught:
        rne.simulate(block, [0.0], [0.0], 2.0, torque=law)
    motion = caught.value.trajectory
    assert motion.work[-1] == pytest.approx(motion.t[-1] ** 6 / 2, rel=1e-5)


def test_a_failure_keeps_the_energies_of_all_steps_before(block):
    for limit in (0.5, 1.0, 1.5):

        def law(t, q, qd, limit=limit):
            return [np.nan if t > limit else 3 * t * t]

        for method in ("RK45", "LSODA"):
            with pytest.raises(rne.SimulationError) as caught:
                rne.simulate(block, [0.0], [0.0], 2.0, torque=law, method=method)
            motion = caught.value.trajectory
            np.testing.assert_allclose(motion.work, motion.t**6 / 2, atol=1e-5)  # ten times the tolerance of 1 J
