"""check_gains against brute force and against simulations of the sampled loop itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import rne
from benchmarks.random_robots import random_tree
from rne.control.gains import SampledLoop, largest_over, random_configurations, workspace
from rne.model.builder import Part, assemble, pose
from rne.validation.agreement import validate

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


def slider(mass=2.0, **limits):
    """A mass on a level rail."""
    parts = [Part(link="base"), Part(link="mass", joint="rail", kind="prismatic", parent=0, mass=mass, **limits)]
    return rne.Robot(assemble("slider", parts, gravity=[0, 0, -9.81]))


@pytest.mark.parametrize(
    ("kp", "kd", "limit", "pole"),
    [
        (8.0, 4.0, 1.0, 1.0),  # damping 1 / 2: 2 Kd / Kp = 2 m / Kd
        (2.0, 8.0, 0.5, 2 + np.sqrt(3)),  # heavily damped: 2 m / Kd
        (800.0, 4.0, 0.01, 1.0),  # lightly damped: 2 Kd / Kp
        (2e6, 4.0, 4e-6, 1.0),  # 4e-6 of what the fastest mode alone would allow
    ],
)
def test_a_sampled_mass_is_stable_below_min_of_2_kd_by_kp_and_2_m_by_kd(kp, kd, limit, pole):
    """Jury's criterion for z^2 - (2 - T^2 P / 2 - T D) z + 1 - T D + T^2 P / 2, with P = Kp / m and D = Kd / m."""
    robot = slider()
    gains = rne.check_gains(robot, kp, kd, 0.99 * limit)
    assert gains.sample_time_limit == pytest.approx(limit, rel=1e-5)
    assert gains.stable is True
    assert rne.check_gains(robot, kp, kd, 1.01 * limit).stable is False
    assert gains.largest_mode == pytest.approx(kd / 2)
    assert gains.fastest_pole == pytest.approx(pole)
    assert gains.gravity_stiffness == 0
    assert gains.beats_gravity is True
    assert gains.sample_time == 0.99 * limit


def test_no_sample_time_is_stable_without_noticeable_damping():
    assert rne.check_gains(slider(), 2e8, 0.04).sample_time_limit == 0.0


def test_a_robot_without_joints_is_stable():
    fixed = rne.Robot(assemble("post", [Part(link="base")]))
    gains = rne.check_gains(fixed, 1.0, 1.0)
    assert (gains.sample_time_limit, gains.stable, gains.beats_gravity) == (np.inf, None, True)
    assert (gains.largest_mode, gains.fastest_pole, gains.gravity_stiffness) == (0.0, 0.0, 0.0)
    assert gains.worst_q.shape == gains.sample_time_q.shape == (0,)
    assert rne.check_gains(fixed, 1.0, 1.0, 0.1).stable is True


def test_gains_are_printed_with_a_verdict_only_if_asked_for():
    robot = slider()
    lines = (
        "fastest mode M^-1 Kd 4 1/s, fastest pole 3.73205 1/s\nlargest stable sample time 0.5 s.{}\n"
        "gravity's stiffness 0 N m/rad: without compensation the gains exceed it"
    )
    assert str(rne.check_gains(robot, 2.0, 8.0)) == lines.format("")
    assert str(rne.check_gains(robot, 2.0, 8.0, 0.25)) == lines.format(" 0.25 s is stable.")
    assert str(rne.check_gains(robot, 2.0, 8.0, 0.75)) == lines.format(" 0.75 s is NOT stable.")


def test_a_coordinate_without_limits_is_searched_from_minus_pi_to_pi():
    np.testing.assert_array_equal(workspace(slider()), [[-np.pi], [np.pi]])
    np.testing.assert_array_equal(workspace(slider(lower=-1.0, upper=2.0)), [[-1.0], [2.0]])


def test_configurations_fill_the_workspace_and_begin_nearest_to_zero():
    drawn = random_configurations(np.array([-1.0, 2.0]), np.array([3.0, 4.0]))
    assert drawn.shape == (2049, 2)
    assert drawn[0].tolist() == [0.0, 2.0]
    assert (np.abs(drawn.min(axis=0) - [-1, 2]) < 0.01).all()
    assert (np.abs(drawn.max(axis=0) - [3, 4]) < 0.01).all()


def test_the_largest_value_is_found_between_samples_and_at_the_edge():
    value, where = largest_over(lambda q: -((q - 0.1234) ** 2).sum(-1), np.array([-1.0]), np.array([1.0]))
    assert (value, where[0]) == (pytest.approx(0, abs=1e-12), pytest.approx(0.1234, abs=1e-6))
    value, where = largest_over(lambda q: q.sum(-1), np.array([-1.0, 0.0]), np.array([1.0, 5.0]))
    assert (value, where.tolist()) == (6.0, [1.0, 5.0])


def test_the_larger_of_two_peaks_is_taken():
    edges, drawn = (np.array([-1.0]), np.array([1.0])), np.array([[-0.45], [0.55]])
    value, where = largest_over(lambda q: 0.1 * (q < 0).sum(-1) - ((np.abs(q) - 0.5) ** 2).sum(-1), *edges, drawn)
    assert (value, where[0]) == (pytest.approx(0.1), pytest.approx(-0.5, abs=1e-6))


def test_gravity_stiffness_of_a_pendulum_is_its_weight_times_its_lever():
    """Largest over a full turn; the largest mode is Kd over the inertia, the same everywhere."""
    rod = Part(link="rod", joint="pivot", kind="revolute", parent=0, axis=np.array([0, 1.0, 0]), mass=2.0)
    model = assemble("pendulum", [Part(link="base"), replace(rod, com=np.array([0, 0, 0.5]))], gravity=[0, 0, -9.81])
    gains = rne.check_gains(rne.Robot(model), 9.9, 3.0)
    assert gains.gravity_stiffness == pytest.approx(2 * 9.81 * 0.5)
    assert gains.largest_mode == pytest.approx(3.0 / (2 * 0.25))
    assert gains.beats_gravity is True
    assert rne.check_gains(rne.Robot(model), 9.7, 3.0).beats_gravity is False


SMALL = 1e-7  # deviation in which terms of second order are 1e-7 of the linear ones
SAMPLES = 100


def deviations(robot, kp, kd, q, T):
    """(e, qd) at the samples of a simulated run that starts SMALL away from the reference q, shape (samples, 2 n)."""
    scene = rne.Scene(robot, controller=rne.control.pd_gravity(robot, kp, kd, q), sample_time=T)
    start = q + SMALL * np.random.default_rng(0).normal(size=robot.n)
    at = T * np.arange(SAMPLES + 1)
    motion = rne.simulate(scene, start, 0 * q, at[-1], method="DOP853", rtol=1e-12, atol=1e-17, t_eval=at)
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


def test_a_singular_mass_matrix_is_an_error_that_names_the_joint():
    """A last link without mass: nothing accelerates with its joint, so that there are no modes."""
    masses, centres, inertias = [1.0, 0.0], np.zeros((2, 3)), [np.eye(3), np.zeros((3, 3))]
    arm = rne.Robot(rne.model.chain([np.eye(3)] * 2, [[0, 0, 0], [1, 0, 0]], masses, centres, inertias))
    with pytest.raises(rne.SingularMassMatrixError, match="nothing with inertia moves with 'joint_2'"):
        rne.check_gains(arm, 10.0, 1.0)
    with pytest.raises(rne.SingularMassMatrixError, match="nothing with inertia moves with 'joint_2'"):
        validate(arm, 3, by_terms=True)
