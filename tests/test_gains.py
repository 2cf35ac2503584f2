"""check_gains against brute force and against simulations of the sampled loop itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import rne
from rne.bounds import Bound, Bounds
from rne.commands.agreement import validate
from rne.control.gains import SampledLoop, largest_over, random_configurations
from rne.control.sampled_loop import CoupledModes, LinearLoop, gravity_modes
from rne.dynamics import gravity_torque

from .helpers import Part, assemble, kept, pose
from .random_robots import random_tree

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


def test_without_damping_no_sample_time_is_stable_and_with_little_a_short_one_is():
    assert rne.check_gains(slider(), 2e8, 0.04).sample_time_limit == pytest.approx(2 * 0.04 / 2e8, rel=1e-12)
    assert rne.check_gains(slider(), 2e8, 0.0).sample_time_limit == 0.0


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
        "fastest mode M^-1 Kd 4 1/s, fastest pole 3.73205 1/s\nlargest stable sample time 0.5 s (searched).{}\n"
        "largest gravity gradient 0 N m/rad (searched): the gains exceed it, so there is one equilibrium without compensation"
    )
    assert str(rne.check_gains(robot, 2.0, 8.0)) == lines.format("")
    assert str(rne.check_gains(robot, 2.0, 8.0, 0.25)) == lines.format(" 0.25 s is stable.")
    assert str(rne.check_gains(robot, 2.0, 8.0, 0.75)) == lines.format(" 0.75 s is NOT stable.")


@pytest.mark.parametrize(("limits", "largest"), [({}, 1.0), ({"lower": -1.0, "upper": 0.5}, np.sin(1.0))])
def test_a_coordinate_is_searched_within_its_limits_or_over_a_whole_turn(limits, largest):
    """A pendulum whose centre of mass is level with its pivot at q = 0: dg/dq is largest at a quarter turn."""
    rod = Part(link="rod", joint="pivot", kind="revolute", parent=0, axis=np.array([0, 1.0, 0]), mass=2.0, **limits)
    parts = [Part(link="base"), replace(rod, com=np.array([0.5, 0, 0]))]
    gains = rne.check_gains(rne.Robot(assemble("level", parts, gravity=[0, 0, -9.81])), 1.0, 1.0)
    assert gains.gravity_stiffness == pytest.approx(9.81 * largest)


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
    slope = robot.kernel(gravity_torque, "q")(q)
    step = exact_step(robot.mass_matrix(q), slope, kp, kd, T)
    predicted = [simulated[0]]
    for _ in range(SAMPLES):
        predicted.append(step @ predicted[-1])
    difference = np.abs((simulated - predicted) * scale).max()
    assert difference <= 1e-4 * np.abs(np.array(predicted) * scale).max()


def exact_step(M, G, kp, kd, T):
    """The map of (e, qd) over one sample by the matrix exponential, for one T or several; G is dg/dq."""
    n, inverse = len(M), np.linalg.inv(M)
    flow = np.zeros((3 * n, 3 * n))  # of (y, y', a): y'' = -M^-1 G y + a while a is held
    flow[:n, n : 2 * n], flow[n : 2 * n, :n], flow[n : 2 * n, 2 * n :] = np.eye(n), -inverse @ G, np.eye(n)
    held = expm(flow * np.asarray(T)[..., None, None])
    by_rate, by_force = held[..., : 2 * n, n : 2 * n], held[..., : 2 * n, 2 * n :]
    step = np.concatenate([-by_force @ (inverse * kp), by_rate - by_force @ (inverse * kd)], axis=-1)
    step[..., :n, :n] += np.eye(n)
    return step


def exact_radius(*loop):
    """Spectral radius of `exact_step`."""
    return np.abs(np.linalg.eigvals(exact_step(*loop))).max(axis=-1)


def gravity_slope(robot, q, h=1e-6):
    """dg/dq by differences."""
    return np.array([robot.gravity_torque(q + h * e) - robot.gravity_torque(q - h * e) for e in np.eye(len(q))]) / (
        2 * h
    )


def test_the_map_is_that_of_the_matrix_exponential(irb140, planar):
    for robot, T in ((irb140, 1.2e-4), (irb140, 1e-2), (planar, 0.05), (planar, 30.0)):
        kp, kd = np.full(robot.n, 50.0), np.full(robot.n, 3.0)
        for q in np.random.default_rng(1).uniform(-1, 1, (3, robot.n)):
            expected = exact_radius(robot.mass_matrix(q), gravity_slope(robot, q), kp, kd, T)
            assert SampledLoop(robot, kp, kd).radius(q, T) == pytest.approx(expected, rel=1e-5)


ROUNDING = 1e-9  # of a spectral radius by the matrix exponential


def pendulum_loop(seed):
    """Inertia, gravity's stiffness (three in four hang), and gains 0.003 to 100 times as stiff, damped or not."""
    rng = np.random.default_rng(seed)
    M, G = 10 ** rng.uniform(-2, 2), 10 ** rng.uniform(-1, 3)
    kp = G * 10 ** rng.uniform(np.log10(0.003), 2)
    kd = 2 * np.sqrt(kp * M) * 10 ** rng.uniform(-4, 1) * (rng.random() > 0.1)
    return np.array([[M]]), np.array([[G * (1 if rng.random() < 0.75 else -1)]]), np.array([kp]), np.array([kd])


def arm_loop(seed):
    """As `pendulum_loop`, for two rods in some configuration; one in ten has a joint without damping, one in ten two."""
    rng = np.random.default_rng(seed)
    (m1, m2), (l1, l2), (q1, q2) = 10 ** rng.uniform(-1, 1, 2), 10 ** rng.uniform(-0.5, 0.5, 2), rng.uniform(-4, 4, 2)
    outer, both = m2 * l2**2 / 3, m2 * l1 * l2 / 2 * np.cos(q2)
    M = np.array([[(m1 / 3 + m2) * l1**2 + outer + 2 * both, outer + both], [outer + both, outer]])
    k1, k2 = 9.81 * (m1 / 2 + m2) * l1 * np.cos(q1), 9.81 * m2 * l2 / 2 * np.cos(q1 + q2)
    G = np.array([[k1 + k2, k2], [k2, k2]])
    kp = np.linalg.norm(G, 2) * 10 ** rng.uniform(np.log10(0.003), 2, 2)
    kd = 2 * np.sqrt(kp * np.diagonal(M)) * 10 ** rng.uniform(-4, 1, 2)
    return M, G, kp, kd * [(1, 1), (1, 1), (1, 0), (0, 0)][min(3, int(10 * rng.random() // 2.7))]


def check_windows(loop, seed):
    """No verdict of any window is contradicted by the matrix exponential, nor the largest stable time."""
    linear = LinearLoop(*gravity_modes(*loop))
    upto = 2.5 * linear.horizon
    windows, first = linear.windows(upto), linear.first_unstable(upto)
    assert [w.start for w in windows[1:]] == [w.end for w in windows[:-1]]
    T = np.random.default_rng(seed).uniform(0, upto, 20)
    T = np.append(T, np.append(T[:5] / upto, 1 - 1e-7) * first)
    for radius, t in zip(exact_radius(*loop, T), T, strict=True):
        verdicts = [w.verdict for w in windows if w.start <= t <= w.end]
        assert "stable" not in verdicts or radius <= 1 + ROUNDING, (seed, t)
        assert "unstable" not in verdicts or radius >= 1 - ROUNDING, (seed, t)
        assert t > first or radius <= 1 + ROUNDING, (seed, t)
    return sum(w.end - w.start for w in windows if w.verdict == "undecided") / upto


def check_boundaries(loop, seed):
    """A pendulum's verdicts are those of the exponential 1e-9 before and behind each boundary, and at 400 times."""
    linear = LinearLoop(*gravity_modes(*loop))
    upto = 3 * np.pi / np.sqrt(np.abs(linear.w[0]))
    windows = np.reshape([w[:2] for w in linear.windows(upto) if w.verdict == "unstable"], (-1, 2))
    ends = windows[(windows > 0) & (windows < upto)]
    T = np.concatenate([ends * (1 - 1e-9), ends * (1 + 1e-9), np.linspace(0, upto, 401)[1:]])
    unstable = ((windows[:, 0] <= T[:, None]) & (T[:, None] <= windows[:, 1])).any(axis=1)
    radius = exact_radius(*loop, T)
    wrong = (unstable != (radius > 1)) & (np.abs(radius - 1) > 1e-12 * max(1, radius.max()))
    assert not wrong.any(), (seed, T[wrong], radius[wrong] - 1)


@pytest.mark.parametrize("seeds", kept([range(4), range(4, 12)], [range(4)]), ids=["few", "more"])
@pytest.mark.parametrize("loop", [pendulum_loop, arm_loop])
def test_no_unstable_sample_time_is_called_stable(loop, seeds):
    undecided = [check_windows(loop(seed), seed) for seed in seeds]
    assert max(undecided) <= (0 if loop is pendulum_loop else 1e-6)


@pytest.mark.long
def test_no_unstable_sample_time_of_a_thousand_is_called_stable():
    for seed in range(12, 512):
        assert check_windows(pendulum_loop(seed), seed) == 0
        assert check_windows(arm_loop(seed), seed) <= 1e-6


@pytest.mark.parametrize("seeds", kept([range(20), range(20, 60)], [range(20)]), ids=["few", "more"])
def test_windows_of_pendulums_end_where_the_exponential_says(seeds):
    for seed in seeds:
        check_boundaries(pendulum_loop(seed), seed)


@pytest.mark.long
def test_windows_of_a_thousand_pendulums_end_where_the_exponential_says():
    for seed in range(60, 1060):
        check_boundaries(pendulum_loop(seed), seed)


def test_light_damping_is_not_called_stable(planar):
    """Stiff and lightly damped: once called stable up to 0.0499 s, eight times the limit."""
    gains = rne.check_gains(planar, *PLANAR_GAINS, sample_time=0.045)
    assert gains.stable is False
    for part in (0.97, 1.1):
        check_against_simulation(planar, *PLANAR_GAINS, gains.sample_time_q, part * gains.sample_time_limit)


def pendulum(limit):
    """A hanging pendulum of 2 kg at 0.5 m that turns by at most `limit`, its stiffness and its inertia."""
    rod = Part(link="rod", joint="pivot", kind="revolute", parent=0, axis=np.array([0, 1.0, 0]), mass=2.0)
    rod = replace(rod, com=np.array([0, 0, -0.5]), lower=-limit, upper=limit)
    return rne.Robot(assemble("pendulum", [Part(link="base"), rod], gravity=[0, 0, -9.81])), 9.81, 0.5


def test_a_simulated_pendulum_grows_in_the_narrow_window_alone():
    """Weak gains, Kp a third of gravity's: unstable from 0.694 to 0.709 s, and stable again behind; a scan missed that."""
    robot, stiffness, inertia = pendulum(0.2)
    kp, kd = 0.3 * stiffness, 0.1 * np.sqrt(stiffness * inertia)
    gains = rne.check_gains(robot, kp, kd, 0.7, max_sample_time=0.9)
    before, narrow, behind = gains.windows
    assert (before.verdict, narrow.verdict, behind.verdict) == ("stable", "unstable", "stable")
    assert narrow.start == gains.sample_time_limit
    assert narrow.end == pytest.approx(np.pi / np.sqrt(stiffness / inertia), rel=1e-9)  # half the period of the swing
    assert gains.stable is False
    for T, grows in ((0.98 * narrow.start, False), ((narrow.start + narrow.end) / 2, True), (1.02 * narrow.end, False)):
        scene = rne.Scene(robot, controller=rne.control.pd_gravity(robot, kp, kd, 0.0), sample_time=T)
        run = rne.simulate(scene, [0.0], [1e-3], 40 * T, rtol=1e-7, atol=1e-12, t_eval=T * np.array([0, 20, 40]))
        growth = abs(run.qd[2, 0] / run.qd[1, 0])
        radius = exact_radius(np.array([[inertia]]), np.array([[stiffness]]), np.array([kp]), np.array([kd]), T)
        assert growth == pytest.approx(radius**20, rel=1e-2)
        assert (growth > 1) == grows


@pytest.mark.parametrize("width", [0.005, 0.1])
def test_narrow_windows_of_other_configurations_are_found(width):
    """Two pendulums side by side that hang inside their range, where the swing is fastest and the windows begin first.

    In one configuration only 0.3 % (or 6 %) of the sample times below the limit of the others are unstable.
    """
    parts = [Part(link="base")]
    for k, length in enumerate((0.5, 1.0)):
        com = length * np.array([np.sin(0.4), 0, -np.cos(0.4)])
        joint = {"joint": f"pivot{k}", "kind": "revolute", "parent": 0, "axis": np.array([0, 1.0, 0])}
        parts.append(Part(link=f"rod{k}", **joint, mass=2.0, com=com, lower=-0.6, upper=0.6))
    robot = rne.Robot(assemble("two", parts, gravity=[0, 0, -9.81]))
    omega = np.sqrt(9.81 / 0.5)
    gains = rne.check_gains(robot, [0.3 * 9.81, 0.3 * 19.62], [width * omega * 0.5, 0.04 * np.sqrt(9.81)])
    assert gains.sample_time_limit == pytest.approx(2 * np.arctan2(1, width) / omega, rel=1e-6)
    assert gains.sample_time_q[0] == pytest.approx(0.4, abs=2e-3)


def test_the_rest_of_the_series_is_bounded():
    """Of phi_1(h F) = (exp(h F) - 1) / (h F), beyond the terms 1 and h F / 2, where h |F| reaches 1."""
    for seed in range(20):
        w = np.random.default_rng(seed).uniform(-4, 4, 2)
        modes, h = CoupledModes(w, np.eye(2), np.eye(2)), 1 / np.sqrt(np.abs(w).max())
        lifted = np.zeros((8, 8))
        lifted[:4, :4], lifted[:4, 4:] = h * modes.F, np.eye(4)
        rest = expm(lifted)[:4, 4:] - np.eye(4) - h * modes.F / 2
        assert (np.abs(rest) <= modes.rest(h) * (1 + 1e-12) + 1e-15).all()
        assert (
            modes.rest(h).max()
            <= 1.5 * np.abs(expm(np.abs(lifted))[:4, 4:] - np.eye(4) - h * np.abs(modes.F) / 2).max()
        )


def test_a_mode_that_stays_unstable_is_told_while_another_begins_to_be():
    """Of two masses, hardly coupled, the less damped is unstable from T = 2 kd / kp = 0.2 on, the other from 1 on."""
    modes = CoupledModes(np.zeros(2), np.array([[1, 0.01], [0.01, 1]]), np.array([[0.1, 0.005], [0.005, 2]]))
    assert modes.verdicts(np.array([0.1, 1.0]), np.array([0.03, 0.03])).tolist() == ["stable", "unstable"]


@pytest.mark.parametrize("seed", [0, 1, 5])
def test_one_middle_decides_most_of_the_times_around_it(seed):
    """As the series is known to its second term: of 0.007 to 0.093 s, all stable."""
    rng = np.random.default_rng(seed)
    A, B, w = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.uniform(-1, 1, 3)
    modes = CoupledModes(w, A @ A.T + np.eye(3), 2 * (B @ B.T + np.eye(3)))
    assert modes.verdicts(np.array([0.05]), np.array([0.043])) == ["stable"]


def known(robot, stiffness, inertia):
    """Bounds of a robot from numbers."""
    bounds = [
        Bound(np.array(low), np.array(high), np.array(high), np.zeros(1), 0.05) for low, high in (stiffness, inertia)
    ]
    full = {"lower": np.full(robot.n, -np.pi), "upper": np.full(robot.n, np.pi), "circle": np.full(robot.n, True)}
    return Bounds(
        gravity_stiffness=bounds[0],
        mass_eigenvalues=bounds[1],
        joint_names=robot.joint_names,
        models=(robot.model,),
        **full,
    )


def test_bounds_prove_the_limit_of_a_joint_and_what_gravity_needs():
    """Of a pendulum that turns all the way round; the limit is shorter by no more than the bounds are wide."""
    robot, stiffness, _ = pendulum(np.pi)
    bounds = robot.bounds(quantities=["gravity_stiffness", "mass_eigenvalues"])
    for kp in (0.1, 0.9, 3.0, 30.0):
        searched = rne.check_gains(robot, kp * stiffness, 2.0)
        proven = rne.check_gains(robot, kp * stiffness, 2.0, bounds=bounds)
        assert (searched.proven, proven.proven) == ((), ("beats_gravity", "sample_time_limit"))
        assert 0.9 <= proven.sample_time_limit / searched.sample_time_limit <= 1 + 1e-9
        assert proven.beats_gravity is (kp > 1)
        assert proven.gravity_stiffness == bounds.gravity_stiffness.upper


def test_the_worst_corner_of_inertia_and_stiffness_is_the_worst_within():
    """No pendulum within bounds of a pendulum is unstable at shorter sample times than the limit."""
    rng = np.random.default_rng(0)
    robot, stiffness, inertia = pendulum(np.pi)
    for _ in range(20):
        k, low, high = [stiffness, inertia, inertia] * 10 ** (rng.uniform(0, 1, 3) * [1, -1, 1])
        kp, kd = k * 10 ** rng.uniform(-2, 2, 1), 10 ** rng.uniform(-2, 1, 1)
        bounds = known(robot, (0, k), ([low, low], [high, high]))
        limit = rne.check_gains(robot, kp, kd, bounds=bounds).sample_time_limit
        for G, M in zip(rng.choice([-k, k], 20), rng.choice([low, high], 20), strict=True):
            radius = exact_radius(np.array([[M]]), np.array([[G]]), kp, kd, limit * np.array([0.3, 0.9, 1 - 1e-6]))
            assert (radius <= 1 + ROUNDING).all()


def test_a_bound_that_was_not_found_proves_nothing_stable():
    robot = pendulum(np.pi)[0]
    for stiffness, least in ((np.inf, 0.5), (10.0, 0.0)):
        bounds = known(robot, (0.0, stiffness), ([least, least], [0.6, 0.6]))
        assert rne.check_gains(robot, 50.0, 2.0, bounds=bounds).sample_time_limit == 0


def test_bounds_of_an_arm_prove_what_gravity_needs_alone(planar):
    bounds = planar.bounds("limits", quantities=["gravity_stiffness"])
    assert rne.check_gains(planar, 100.0, 10.0, bounds=bounds).proven == ("beats_gravity",)


def test_bounds_of_the_robot_without_its_payload_are_refused():
    """They would call gains proven that the payload's gravity exceeds."""
    robot = pendulum(3.0)[0]
    found = robot.bounds("limits", payload=(0, 5), quantities=["gravity_stiffness"])
    loaded = robot.with_payload(5.0)
    assert rne.check_gains(loaded, 100.0, 10.0, bounds=found).gravity_stiffness == found.gravity_stiffness.upper
    for other in (robot.with_payload(6.0), rne.Robot(replace(robot.model, gravity=[0.0, 0.0, -98.1]))):
        with pytest.raises(ValueError, match="`bounds` must be of this very robot, with its masses, gravity"):
            rne.check_gains(other, 100.0, 10.0, bounds=found)


def test_bounds_of_another_robot_or_of_a_part_of_the_workspace_are_refused(planar):
    robot = pendulum(3.0)[0]
    text = "`bounds` must be of the robot, with the joints joint0, joint1, got bounds of one with pivot"
    with pytest.raises(ValueError, match=f"^{text}$"):
        rne.check_gains(planar, 1.0, 1.0, bounds=robot.bounds(quantities=["gravity_stiffness"]))
    for bounds in (
        robot.bounds(([-1], [1]), quantities=["gravity_stiffness"]),
        robot.bounds(quantities=["mass_eigenvalues"]),
    ):
        with pytest.raises(
            ValueError, match=r"^`bounds` must have the gravity_stiffness, and for all positions of the work"
        ):
            rne.check_gains(robot, 1.0, 1.0, bounds=bounds)


def test_one_configuration_is_examined_alone_and_proven(planar):
    q = np.array([0.3, 1.2])
    gains = rne.check_gains(planar, 300.0, [8.0, 2.0], q=q)
    np.testing.assert_array_equal(gains.sample_time_q, q)
    assert gains.proven == ("beats_gravity", "sample_time_limit")
    loop = planar.mass_matrix(q), gravity_slope(planar, q), np.full(2, 300.0), np.array([8.0, 2.0])
    assert (
        exact_radius(*loop, gains.sample_time_limit * (1 - 1e-6))
        < 1
        < exact_radius(*loop, gains.sample_time_limit * 1.00001)
    )


def test_gains_without_damping_are_legal():
    """Stable by the compensation that is held where gravity is stiffer, but for multiples of half its periods."""
    robot, stiffness, inertia = pendulum(0.2)
    half = np.pi / np.sqrt(stiffness / inertia)
    weak, strong = (rne.check_gains(robot, k * stiffness, 0.0, q=0.0, max_sample_time=2.5 * half) for k in (0.5, 2.0))
    assert [w.verdict for w in weak.windows] == ["stable", "unstable"] * 2 + ["stable"]
    np.testing.assert_allclose([w[:2] for w in weak.windows[1::2]], [[half, half], [2 * half, 2 * half]], rtol=1e-12)
    assert strong.windows == ((0.0, 2.5 * half, "unstable"),)
    M, G = np.array([[3.0, 1.0], [1.0, 1.0]]), np.array([[30.0, 9.0], [9.0, 9.0]])
    for kp, verdict in ((np.array([1.0, 1.0]), "stable"), (np.array([90.0, 90.0]), "unstable")):
        windows = LinearLoop(*gravity_modes(M, G, kp, np.zeros(2))).windows(3.0)
        assert all(w.verdict == verdict or w.start == w.end for w in windows)
        T = np.linspace(0.01, 3, 60)
        assert ((exact_radius(M, G, kp, np.zeros(2), T) < 1) == (verdict == "stable")).all()


def test_sample_times_are_looked_at_up_to_half_a_period_of_the_fastest_mode_of_gravity():
    M, none = np.eye(2), np.zeros(2)
    assert LinearLoop(*gravity_modes(M, np.diag([1.0, 400.0]), none, none)).horizon == pytest.approx(np.pi / 20)


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
    drawn = rng.uniform(-np.pi, np.pi, (300, robot.n))
    loop = SampledLoop(robot, kp, kd)
    assert loop.radius(drawn, T).max() < 1
    check_against_simulation(robot, kp, kd, gains.sample_time_q, T)
    worst = drawn[np.argmax(loop.radius(drawn, gains.sample_time_limit))]
    loops = [LinearLoop(*loop.modes(q)) for q in (worst, gains.sample_time_q)]
    found = min(one.first_unstable(2 / gains.largest_mode * 1.01) for one in loops)
    assert gains.sample_time_limit >= 0.8 * found
    q = gains.sample_time_q
    assert (
        exact_radius(robot.mass_matrix(q), gravity_slope(robot, q), kp, kd, 1.001 * gains.sample_time_limit) >= 1 - 1e-9
    )


@pytest.mark.parametrize("seed", kept([0, 1, 36], [36]))  # of 5, 3 and 2 joints
def test_random_robots_and_gains(seed):
    check_case(seed)


@pytest.mark.long
def test_many_random_robots_and_gains():
    for seed in range(2, 22):
        check_case(seed)


def test_a_singular_mass_matrix_is_an_error_that_names_the_joint():
    """A last link without mass: nothing accelerates with its joint, so that there are no modes."""
    masses, centres, inertias = [1.0, 0.0], np.zeros((2, 3)), [np.eye(3), np.zeros((3, 3))]
    arm = rne.Robot(rne.model.chain([np.eye(3)] * 2, [[0, 0, 0], [1, 0, 0]], masses, centres, inertias))
    with pytest.raises(rne.SingularMassMatrixError, match="nothing with inertia moves with 'joint_2'"):
        rne.check_gains(arm, 10.0, 1.0)
    with pytest.raises(rne.SingularMassMatrixError, match="nothing with inertia moves with 'joint_2'"):
        validate(arm, 3, by_terms=True)


def test_bounds_that_are_none_are_refused():
    with pytest.raises(TypeError, match=r"^`bounds` must be a result of robot.bounds\(\), got int$"):
        rne.check_gains(slider(1.0), 1.0, 1.0, bounds=3)
