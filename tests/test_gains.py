"""check_gains against brute force and against simulations of the sampled loop itself."""

import numpy as np
import pytest
from scipy.linalg import expm

import rne
from rne.control.gains import SampledLoop, workspace
from rne.model.builder import Part, assemble, pose
from rne.model.generators import random_tree

from .helpers import kept

PLANAR_GAINS = [1000.0, 10.0], [3.0, 3.0]


@pytest.fixture(scope="module")
def planar():
    """Two rods of 1 m and 1 kg that swing in a vertical plane."""
    parts = [Part(link="base")]
    for k in range(2):
        parts.append(
            Part(
                link=f"rod{k}",
                joint=f"joint{k}",
                kind="revolute",
                lower=-3.0,
                upper=3.0,
                parent=k,
                placement=pose(np.eye(3), [float(k), 0, 0]),
                axis=np.array([0.0, 0.0, 1.0]),
                mass=1.0,
                com=np.array([0.5, 0, 0]),
                inertia=np.diag([0, 1 / 12, 1 / 12]),
            )
        )
    return rne.Robot(assemble("planar", parts, gravity=[0, -9.81, 0]))


SMALL = 1e-7  # deviation in which terms of second order are 1e-7 of the linear ones
SAMPLES = 100


def deviations(robot, kp, kd, q, T):
    """(e, qd) at the samples of a simulated run that starts SMALL away from the reference q, shape (samples, 2 n)."""
    scene = rne.Scene(robot, controller=rne.control.pd_gravity(robot, kp, kd, q), sample_time=T)
    start = q + SMALL * np.random.default_rng(0).normal(size=robot.n)
    motion = rne.simulate(scene, start, 0 * q, SAMPLES * T, method="DOP853", rtol=1e-12, atol=1e-17)
    return np.concatenate([motion.q - q, motion.qd], axis=1)


def check_against_simulation(robot, kp, kd, q, T):
    """A simulation of the sampled loop follows the linear map."""
    simulated = deviations(robot, kp, kd, q, T)
    scale = np.concatenate([np.ones(robot.n), np.full(robot.n, T)])
    step = SampledLoop(robot, kp, kd).step(q, T)
    predicted = [simulated[0]]
    for _ in range(SAMPLES):
        predicted.append(step @ predicted[-1])
    difference = np.abs((simulated - predicted) * scale).max()
    assert difference <= 1e-4 * np.abs(np.array(predicted) * scale).max()


def exact_radius(robot, kp, kd, q, T):
    """Spectral radius of the sampled loop by the matrix exponential, gravity's slope by differences."""
    n, h = robot.n, 1e-6
    slope = [(robot.gravity_torque(q + h * e) - robot.gravity_torque(q - h * e)) / (2 * h) for e in np.eye(n)]
    inverse = np.linalg.inv(robot.mass_matrix(q))
    flow = np.zeros((3 * n, 3 * n))  # of (y, y', a): y'' = -M^-1 G y + a while a is held
    flow[:n, n : 2 * n], flow[n : 2 * n, :n], flow[n : 2 * n, 2 * n :] = (
        np.eye(n),
        -inverse @ np.array(slope).T,
        np.eye(n),
    )
    held = expm(flow * T)
    by_rate, by_force = held[: 2 * n, n : 2 * n], held[: 2 * n, 2 * n :]
    step = np.concatenate([-by_force @ (inverse * kp), by_rate - by_force @ (inverse * kd)], axis=1)
    step[:n, :n] += np.eye(n)
    return np.abs(np.linalg.eigvals(step)).max()


def test_the_map_is_that_of_the_matrix_exponential(irb140, planar):
    for robot, T in ((irb140, 1.2e-4), (irb140, 1e-2), (planar, 0.05)):
        kp, kd = np.full(robot.n, 50.0), np.full(robot.n, 3.0)
        for q in np.random.default_rng(1).uniform(-1, 1, (3, robot.n)):
            expected = exact_radius(robot, kp, kd, q, T)
            assert SampledLoop(robot, kp, kd).radius(q, T) == pytest.approx(expected, rel=1e-6)


def test_light_damping_is_not_called_stable(planar):
    """Stiff and lightly damped: once called stable up to 0.0499 s, eight times the limit."""
    gains = rne.check_gains(planar, *PLANAR_GAINS, sample_time=0.045)
    assert gains.stable is False
    for part in (0.97, 1.1):
        check_against_simulation(planar, *PLANAR_GAINS, gains.sample_time_q, part * gains.sample_time_limit)


def random_case(seed):
    """A robot of one to five joints, and gains of any ratio, often lightly damped."""
    rng = np.random.default_rng(seed)
    robot = rne.Robot(random_tree(int(rng.integers(1, 6)), seed))
    inertia = np.diagonal(robot.mass_matrix(np.zeros(robot.n)))
    frequency, damping = 10 ** rng.uniform(0, 2, robot.n), 10 ** rng.uniform(-2, 0.5, robot.n)
    return robot, inertia * frequency**2, 2 * damping * inertia * frequency


def check_case(seed):
    """No configuration below 0.97 of the limit is unstable, in the linear map or in simulation; it is not too careful."""
    robot, kp, kd = random_case(seed)
    gains = rne.check_gains(robot, kp, kd)
    T = 0.97 * gains.sample_time_limit
    rng = np.random.default_rng(seed + 1)
    drawn = rng.uniform(*workspace(robot), (300, robot.n))
    loop = SampledLoop(robot, kp, kd)
    assert loop.radius(drawn, T).max() < 1
    check_against_simulation(robot, kp, kd, gains.sample_time_q, T)
    worst = drawn[np.argmax(loop.radius(drawn, gains.sample_time_limit))]
    found = min(loop.first_unstable(q, 2 / gains.largest_mode * 1.01) for q in (worst, gains.sample_time_q))
    assert gains.sample_time_limit >= 0.8 * found
    assert exact_radius(robot, kp, kd, gains.sample_time_q, 1.001 * gains.sample_time_limit) >= 1 - 1e-9


@pytest.mark.parametrize("seed", kept(range(2), [1]))
def test_random_robots_and_gains(seed):
    check_case(seed)


@pytest.mark.long
def test_many_random_robots_and_gains():
    for seed in range(2, 60):
        check_case(seed)
