"""Linear loops against the exact motion between instants at which a command changes; scenes against simulations."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import rne
from rne.control.sampled_loop import LinearLoop

from .helpers import Part, assemble, kept
from .random_robots import straight_chain

EXACT = 1e-10  # relative to the largest entry: of some products of exponentials
DELAYS = [0.0, 0.3, 1.0, 1.7, 3.0]  # in sample times
SLOPES = 1e-6  # relative: by forward differences of a called law
EDGE = 1e-4  # relative distance from a margin at which the oracle's spectral radius is clearly beyond 1


def random_loop(seed, delay=0.0, states=1):
    """Two coupled oscillators under feedback by a law with states: slow poles 1/s, sampled about 20 times in one."""
    rng = np.random.default_rng(seed)
    K, D = (np.diag(rng.uniform(0.5, 3, 2)) + 0.3 * X @ X.T for X in rng.normal(size=(2, 2, 2)))
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-0.5 * K, np.zeros((2, 2))]])
    B, T = np.vstack([np.zeros((2, 2)), np.eye(2)]), rng.uniform(0.05, 0.2)
    F = np.hstack([-K, -D, 0.1 * rng.normal(size=(2, states))])
    R = np.hstack([rng.normal(size=(states, 4)), -np.eye(states)])
    return rne.control.FeedbackLoop(A, B, F, R, sample_time=T, delay=delay * T)


def exact_map(loop, gain=1.0, delay=None, sample_time=None):
    """The map of (x, z, past commands) over a sample: each segment between changes of the command by its exponential."""
    T = sample_time or loop.sample_time
    delay = loop.delay if delay is None else delay
    (N, n), p, late = loop.B.shape, len(loop.R), int(np.ceil(delay / T))
    found = []
    for start in np.eye(N + p + late * n):
        x, z, past = start[:N], start[N : N + p], start[N + p :].reshape(late, n)
        commands = [gain * loop.F @ np.concatenate([x, z]), *past]  # taken at 0, -T, -2 T, ...
        z = z + T * loop.R @ np.concatenate([x, z])
        acting = [-k * T + delay for k in range(len(commands))]
        instants = np.unique([0.0, T, *(t for t in acting if 0 < t < T)])
        for begun, ended in itertools.pairwise(instants):
            u = next(u for u, t in zip(commands, acting, strict=True) if t <= begun + 1e-12)
            flow = np.zeros((N + 1, N + 1))
            flow[:N, :N], flow[:N, N] = loop.A, loop.B @ u
            x = (expm((ended - begun) * flow) @ np.append(x, 1.0))[:N]
        found.append(np.concatenate([x, z, *commands[:late]]))
    return np.array(found).T


def exact_radius(*arguments, **options):
    return np.abs(np.linalg.eigvals(exact_map(*arguments, **options))).max()


@pytest.mark.parametrize("delay", DELAYS)
def test_the_map_from_sample_to_sample_is_exact(delay):
    for seed in range(3):
        loop = random_loop(seed, delay)
        expected = exact_map(loop)
        np.testing.assert_allclose(loop.sample_map, expected, rtol=0, atol=EXACT * np.abs(expected).max())
        assert loop.is_stable == (exact_radius(loop) < 1)


def test_stiff_loops_lose_no_digits():
    """A mode of 1e4 1/s beside one of 1 1/s, over times from 1e-6 to 1 s."""
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    A = turn @ np.diag([-1e4, -1.0, 0.5]) @ turn.T
    loop = rne.control.FeedbackLoop(A, np.eye(3), -np.eye(3))
    for T in (1e-6, 1e-3, 1.0):
        found = replace(loop, sample_time=T).sample_map
        np.testing.assert_allclose(found, exact_map(loop, sample_time=T), rtol=0, atol=EXACT)


@pytest.mark.parametrize("delay", kept([0.0, 0.4, 1.2], [0.0, 1.2]))
def test_margins_and_windows_are_those_that_bisection_by_the_exact_map_finds(delay):
    """Stable at all that is tried before, unstable just behind."""
    loop = random_loop(0, delay)
    gain, late, before = loop.gain_margin, loop.delay_margin, np.append(np.linspace(0, 1, 9)[:-1], 1 - EDGE)
    assert 1.1 < gain < 1e3
    assert max(exact_radius(loop, 1 + part * (gain - 1)) for part in before) < 1
    assert exact_radius(loop, 1 + (1 + EDGE) * (gain - 1)) > 1
    assert max(exact_radius(loop, delay=loop.delay + part * late) for part in before) < 1
    assert exact_radius(loop, delay=loop.delay + (1 + EDGE) * late) > 1
    first, second, *_ = loop.windows
    assert (first.start, first.verdict, second.verdict) == (0.0, "stable", "unstable")
    times = [part * first.end for part in before[1:] if part * first.end > loop.delay / 8]
    assert (
        max(exact_radius(loop, sample_time=T) for T in times)
        < 1
        < exact_radius(loop, sample_time=second.start * (1 + EDGE))
    )


@pytest.mark.parametrize("seed", kept(range(20), range(4)))
def test_modes_are_counted_as_the_eigenvalues_outside_the_circle(seed):
    """By the argument principle, whatever the delay."""
    rng = np.random.default_rng(seed)
    loop, counts = random_loop(seed), set()
    for gain, delay in zip(10 ** rng.uniform(-0.5, 2, 8), rng.uniform(0, 6, 8), strict=True):
        T, late = loop.sample_time, delay * loop.sample_time
        expected = int((np.abs(np.linalg.eigvals(exact_map(loop, gain, late))) > 1).sum())
        assert loop._unstable_modes(T, late, gain * loop.F) == expected
        counts.add(expected)
    assert len(counts) > 2


def test_an_integrator_has_the_margins_of_its_closed_forms():
    """x' = -k u(t - delay): pi / 2 / k in continuous time; sampled 2 / (k T), with r T <= T / 2 of delay by Jury."""
    loop = rne.control.FeedbackLoop([[0.0]], [[1.0]], [[-2.0]])
    assert (loop.gain_margin, loop.windows[0].end) == (np.inf, pytest.approx(1.0, rel=1e-8))
    assert loop.delay_margin == pytest.approx(np.pi / 4, rel=1e-7)
    assert replace(loop, delay=0.5).delay_margin == pytest.approx(np.pi / 4 - 0.5, rel=1e-7)
    assert replace(loop, delay=0.5).gain_margin == pytest.approx(np.pi / 2, rel=1e-7)
    for r, limit in ((0.0, 2.0), (0.2, 2 / 0.6), (0.45, 1 / 0.45), (1.0, 1.0), (2.0, (np.sqrt(5) - 1) / 2)):
        sampled = replace(loop, sample_time=0.1, delay=0.1 * r)
        assert sampled.gain_margin == pytest.approx(limit / 0.2, rel=1e-7), r


def test_fast_samples_come_near_to_continuous_time():
    """Held for T and T' late, it is as in continuous time T / 2 + T' late, to second order; so many commands are counted."""
    loop = rne.control.FeedbackLoop([[0.0]], [[1.0]], [[-2.0]], sample_time=1e-3, delay=0.3)
    assert loop.delay / loop.sample_time > 100  # past commands from which on modes are counted
    assert loop.delay_margin == pytest.approx(np.pi / 4 - 0.3005, abs=1e-6)


def test_a_loop_that_is_not_stable_has_no_margin_and_one_that_nothing_holds_no_verdict():
    pushed, free = (rne.control.FeedbackLoop([[0, 1], [0, 0]], [[0], [1]], [[k, -1]]) for k in (1, 0))
    for loop in (
        pushed,
        free,
        replace(pushed, sample_time=0.1, delay=0.05),
        replace(free, sample_time=0.1, delay=20.0),
    ):
        assert (loop.is_stable, loop.gain_margin, loop.delay_margin) == (False, 1.0, 0.0)
    assert [window.verdict for window in free.windows] == ["undecided"]
    assert pushed.windows[0].verdict == "unstable"


def test_a_narrow_window_is_found_between_the_times_of_a_scan():
    """A hanging pendulum under weak gains: the certain windows, of which one is 0.6 % of its time wide."""
    w, P, D = 19.62, 0.3 * 19.62, 0.01 * np.sqrt(19.62)
    loop = rne.control.FeedbackLoop([[0, 1], [-w, 0]], [[0], [1]], [[w - P, -D]])
    certain = LinearLoop(np.array([w]), np.array([[P]]), np.array([[D]])).windows(1.0)
    for found, expected in zip(loop.windows, certain[:-1], strict=False):
        assert found[2] == expected[2]
        np.testing.assert_allclose(found[:2], expected[:2], rtol=1e-7)
    assert len(certain) == 3
    assert certain[1].end < 1.01 * certain[1].start


def vibrating(K, D, own, kp, kd):
    """A motor of 0.5 kg m^2 under PD control on a stiff spring, hardly damped, that holds 1 kg m^2."""
    torsion, losses = (k * np.array([[1, -1], [-1, 1]]) + np.diag([0, more]) for k, more in ((K, 0.0), (D, own)))
    inverse, none = np.diag([1.0, 2.0]), np.zeros((2, 2))
    A = np.block([[none, np.eye(2)], [-inverse @ torsion, -inverse @ losses]])
    return rne.control.FeedbackLoop(A, [[0], [0], [0], [2.0]], [[0, -kp, 0, -kd]])


def test_windows_of_vibrations_are_found_where_they_are_narrower_than_steps_of_the_scan():
    """At times of several periods; and just before half of one, which a coarser search missed."""
    loop = vibrating(1e4, 0.01, 0.4, 10, 8)
    assert len(loop.windows) == 9
    for window, part in itertools.product(loop.windows, np.linspace(0.01, 0.99, 12)):
        T = window.start + part * (window.end - window.start)
        stable = np.abs(np.linalg.eigvals(replace(loop, sample_time=T).sample_map)).max() < 1
        assert window.verdict == ("stable" if stable else "unstable"), (window, T)
    narrow = vibrating(1.5e4, 0.27, 0.028, 26, 1.15)
    first, second, *_ = narrow.windows
    assert second.verdict == "unstable"
    assert second.end - second.start < 0.01 * second.start
    assert (
        exact_radius(narrow, sample_time=first.end * (1 - EDGE))
        < 1
        < exact_radius(narrow, sample_time=second.start * (1 + EDGE))
    )


def test_an_inverted_pendulum_is_not_followed_until_its_numbers_overflow():
    """Poles of 0.03 and -30 1/s: 100 times the slower time is 3000 s, in which exp(10 t) is no number any more."""
    (only,) = rne.control.FeedbackLoop([[0, 1], [100, 0]], [[0], [1]], [[-99, -30]]).windows
    assert only.verdict == "unstable"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (([[0, 1]], [[0]], [[1]]), r"`A` must have shape \(1, 1\), got \(1, 2\)"),
        (([[0]], [[0, 1]], [[1]]), r"`B` must have shape \(1, 1\), got \(1, 2\)"),
        (([[0]], [[np.nan]], [[1]]), "`B` must be finite"),
        (([[0]], [[1]], [[1, 0]]), r"`F` must have shape \(1, 1\), got \(1, 2\)"),
        (([[0]], [[1]], [[1, 0]], [[1]]), r"`R` must have shape \(1, 2\), got \(1, 1\)"),
        (([[0]], [[1]], [[1]], (), 0.0), "`sample_time` must be positive, got 0.0"),
        (([[0]], [[1]], [[1]], (), 1.0, -1.0), "`delay` must not be negative, got -1.0"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(arguments, text):
    with pytest.raises(ValueError, match=text):
        rne.control.FeedbackLoop(*arguments)


def test_only_a_sampled_loop_has_a_map():
    assert rne.control.FeedbackLoop([[0]], [[1]], [[1]]).sample_map is None


# Scenes

MASS, LENGTH, INERTIA, ROTOR, STIFFNESS, DAMPING, VISCOUS = 2.0, 0.3, 0.4, 0.1, 500.0, 0.6, 0.2
TARGET = 0.4


def link():
    """A link that swings under gravity in a vertical plane, hanging at q = 0."""
    com, inertia = np.array([0, 0, -LENGTH]), np.eye(3) * (INERTIA - MASS * LENGTH**2)
    part = Part(link="l", joint="j", kind="revolute", parent=0, axis=np.array([0, 1.0, 0]), mass=MASS, com=com)
    return rne.Robot(assemble("link", [Part(link="base"), replace(part, inertia=inertia)], gravity=(0, 0, -9.81)))


@pytest.mark.parametrize("reads", kept(["motor", "link", "both"], ["motor", "link"]))
def test_the_loop_of_an_elastic_joint_is_that_of_spongs_equations(reads):
    """I q'' + m g l sin q + s q = K (theta - q) + D (theta' - q'), B theta'' + v theta' + ... = u, by hand."""
    kp, kd, spring = 100.0, 8.0, 7.0
    K, D = (k * np.array([[1, -1], [-1, 1]]) for k in (STIFFNESS, DAMPING))
    weight = MASS * 9.81 * LENGTH * np.cos(TARGET) + spring
    inverse = np.diag([1 / INERTIA, 1 / ROTOR])
    A = np.block(
        [[np.zeros((2, 2)), np.eye(2)], [-inverse @ (K + np.diag([weight, 0])), -inverse @ (D + np.diag([0, VISCOUS]))]]
    )
    F = {"motor": [[0, -kp, 0, -kd]], "link": [[-kp, 0, -kd, 0]], "both": [[0, -kp, -kd, 0]]}[reads]
    torque = MASS * 9.81 * LENGTH * np.sin(TARGET) + spring * (TARGET - 0.1)
    motor = TARGET + torque / STIFFNESS

    target = TARGET if reads == "link" else motor

    def law(t, q, qd):
        return torque - kp * (q[-1:] - target) - kd * qd[:1]

    scene = rne.Scene(
        link(),
        elastic=rne.ElasticJoints(STIFFNESS, DAMPING, ROTOR, reads=reads),
        friction=rne.Friction(viscous=VISCOUS),
        springs=[rne.Spring.at_joint("j", spring, 0.1)],
        controller=law,
    )
    found = scene.check_gains([TARGET])
    expected = rne.control.FeedbackLoop(A, [[0], [0], [0], [1 / ROTOR]], F)
    np.testing.assert_allclose(np.sort_complex(found.poles), np.sort_complex(expected.poles), rtol=SLOPES)
    np.testing.assert_allclose(found.loop.A, A, rtol=SLOPES, atol=SLOPES * abs(A).max())
    assert found.is_rest
    assert found.stable is (reads == "motor")
    with pytest.raises(ValueError, match="jump by 4 N m or N at the target"):
        replace(scene, controller=lambda t, q, qd: law(t, q, qd) - 2 * np.sign(q[-1:] - target)).check_gains([TARGET])
    late = replace(scene, sample_time=2e-3, delay=3e-3).check_gains([TARGET])
    exact = exact_radius(replace(expected, sample_time=2e-3, delay=3e-3))
    assert np.abs(np.linalg.eigvals(late.loop.sample_map)).max() == pytest.approx(exact, rel=SLOPES)
    assert late.stable is bool(exact < 1)


def weightless_scene(seed):
    """One joint or two with springs under PD control, sampled slowly or fast, late or not, a third of them elastic."""
    rng = np.random.default_rng(seed)
    n, T = int(rng.integers(1, 3)), rng.choice([0.004, 0.02])
    robot, q = rne.Robot(straight_chain(n)), rng.uniform(-1, 1, n)
    inertia, omega = np.diagonal(robot.mass_matrix(q)), rng.uniform(3, 8)
    law = rne.control.pd(robot, inertia * omega**2, inertia * omega * rng.uniform(0.8, 2), q)
    springs = [rne.Spring.at_joint(name, 4.0, angle) for name, angle in zip(robot.joint_names, q, strict=True)]
    elastic = rne.ElasticJoints(inertia * 60**2, inertia * rng.uniform(2, 8), 0.5 * inertia) if seed % 3 == 2 else None
    delay = T * rng.choice([0, 0.4, 1, 2.7])
    parts = {"gravity": [0, 0, 0], "friction": rne.Friction(viscous=0.1 * inertia), "springs": springs}
    return rne.Scene(robot, controller=law, sample_time=T, delay=delay, elastic=elastic, **parts), q


def growth_of(scene, q, loop):
    """Growth of a small deviation from the third to the last quarter of a simulation: some tenfold, or to a tenth."""
    radius = np.abs(np.linalg.eigvals(loop.sample_map)).max()
    count = int(np.clip(np.log(10) / abs(np.log(radius)), 5, 3000))
    t = scene.sample_time * np.arange(2 * count, 4 * count)
    motion = rne.simulate(scene, q + 1e-9, 0 * q, t[-1], rtol=1e-7, atol=1e-16, t_eval=t)
    size = np.linalg.norm(np.hstack([motion.q - q, motion.qd]), axis=1)
    return size[count:].max() / size[:count].max()


def check_limits(seed, kinds=("louder", "later", "slower"), parts=(0.9, 1.1)):
    """Just before each limit the simulation decays, just behind it grows; True if the loop is stable by itself."""
    scene, q = weightless_scene(seed)
    loop, law = scene.check_gains(q), scene.controller
    assert loop.is_rest
    if not loop.stable:
        assert growth_of(scene, q, loop.loop) > 1, seed
        return False
    for part, kind in itertools.product(parts, kinds):
        k = 1 + part * (loop.gain_margin - 1) if kind == "louder" else 1.0
        delay = scene.delay + part * loop.delay_margin if kind == "later" else scene.delay
        T = part * loop.sample_time_limit if kind == "slower" and loop.sample_time_limit else scene.sample_time
        other = replace(scene, controller=lambda t, q, qd, k=k: k * law(t, q, qd), delay=delay, sample_time=T)
        judged = replace(loop.loop, F=k * loop.loop.F, delay=delay, sample_time=T)
        assert judged.is_stable is (part < 1) or kind == "slower", (seed, part, kind)
        assert judged.is_stable is bool(growth_of(other, q, judged) < 1), (seed, part, kind)
    return True


@pytest.mark.parametrize(("seed", "kind"), [(14, "louder"), (42, "later"), (36, "slower")])
def test_simulations_are_stable_up_to_the_limits(seed, kind):
    assert check_limits(seed, [kind], (0.6, 1.5))


@pytest.mark.long
def test_simulations_of_fifty_loops_are_stable_up_to_the_limits():
    kinds = "louder", "later", "slower"
    assert sum(check_limits(seed, [kinds[seed // 3 % 3]]) for seed in range(10, 60)) > 40


def test_a_plant_without_its_inputs_is_refused():
    with pytest.raises(ValueError, match=r"^`B` must have shape \(2, 1\), got \(0,\)"):
        rne.control.closed_loop([[0, 1], [0, 0]], [], [[-4, -2]])


def test_long_delays_of_slow_samples_are_judged():
    """Samples that are hundreds of time constants apart."""
    assert rne.control.closed_loop([[-1.0]], [[1.0]], [[-0.5]], sample_time=400.0, delay=1.2e5).is_stable
