"""Sampled laws whose torques act a delay after their samples, in every engine and way of taking steps."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import rne
from rne.simulation.plant import Plant
from rne.simulation.zero_order_hold import ZeroOrderHold

from .helpers import Part, assemble, kept
from .random_robots import straight_chain
from .test_compiled_motions import interpreted

T = 0.01  # sample time [s]
KP, KD, TARGET, VISCOUS = 30.0, 0.8, 0.1, 0.4  # of the linear loop
START = np.array([0.3, 0.2])
DELAYS = [0.3 * T, T, 1.7 * T, 3 * T]
TIGHT = {"rtol": 1e-12, "atol": 1e-14}
NO_GRAVITY = {"gravity": [0, 0, 0]}
METHODS = ["DOP853", "Tsit5", "RK45", "LSODA"]
WAYS = [(way, method) for way in ("called", "traced", "loop", "numba", "numba called") for method in METHODS]
WAYS += [("numba", "Rodas5P"), ("numba called", "Rodas5P")]


@pytest.fixture
def made(monkeypatch):
    """A function of a model, a law of time and state, and a way of running it: the robot, and the law to give it."""

    def make(model, law, way):
        traced = law if getattr(law, "traceable", False) else rne.traceable(lambda t, q, qd: law(t, q, qd))
        if way == "loop":
            monkeypatch.setattr(rne.Scene, "traced_samples", property(_traced_where_interpreted))
            return interpreted(monkeypatch)(model), traced
        return rne.Robot(model, engine="numba" if "numba" in way else "numpy"), law if "called" in way else traced

    return make


def _traced_where_interpreted(scene):
    return scene._law if scene.robot.model.name == "interpreted" else None


def pd(t, q, qd):
    return -KP * (q - TARGET) - KD * qd


def one_sample(inertia, delay, viscous=VISCOUS):
    """(q, qd, acting torque, pending commands, the last one behind) from sample to sample, its command left out.

    The state is that just after the sample at which a command of zero is taken.
    """
    late, A = int(np.ceil(delay / T - 1e-9)), np.array([[0, 1, 0], [0, -viscous / inertia, 1 / inertia], [0, 0, 0]])
    first = delay - (late - 1) * T if late else 0.0  # of the period, after which the oldest command acts
    step, arrives = np.eye(3 + late), np.eye(3 + late)
    if late:
        arrives[2] = np.eye(3 + late)[3]
        arrives[3:] = np.eye(3 + late, k=1)[3:]
    for h, then in ((first, arrives), (T - first, np.eye(3 + late))):
        flow = np.eye(3 + late)
        flow[:3, :3] = expm(A * h)
        step = then @ flow @ step
    return step


def exact(inertia, delay, count):
    """Positions and velocities at samples of the linear loop, from matrix exponentials."""
    step, state = one_sample(inertia, delay), np.zeros(3 + int(np.ceil(delay / T - 1e-9)))
    state[:2], found = START, []
    for _ in range(count):
        found.append(state[:2])
        state[-1] = pd(0.0, *state[:2])
        state = step @ state
    return np.array(found)


def inertia_of(model):
    return rne.Robot(model).mass_matrix([0.0])[0, 0]


def linear_loop(make, way, delay, **parts):
    robot, law = make(straight_chain(1), pd, way)
    return rne.Scene(
        robot, friction=rne.Friction(viscous=VISCOUS), controller=law, sample_time=T, delay=delay, **NO_GRAVITY, **parts
    )


@pytest.mark.parametrize(("way", "method"), kept(WAYS, [("called", "DOP853"), ("traced", "LSODA"), ("loop", "Tsit5")]))
@pytest.mark.parametrize("delay", DELAYS)
def test_a_linear_loop_is_that_of_the_matrix_exponential(made, way, method, delay):
    """To 1e-10 at tolerances of 1e-12, at the samples; the energies balance, and no torque acts before its time."""
    times = T * np.arange(21)
    scene = linear_loop(made, way, delay)
    motion = rne.simulate(scene, START[:1], START[1:], times[-1], method=method, t_eval=times, **TIGHT)
    expected = exact(inertia_of(straight_chain(1)), delay, len(times))
    np.testing.assert_allclose(np.hstack([motion.q, motion.qd]), expected, rtol=0, atol=1e-10)
    assert motion.energy_drift < 1e-10
    arrived = np.floor((times - delay) / T + 1e-9).astype(int)  # number of the last command that acts
    commands = pd(0.0, *expected.T)
    np.testing.assert_allclose(motion.tau[:-1, 0], np.where(arrived < 0, 0, commands[arrived])[:-1], atol=1e-9)
    assert motion.message.endswith(f"the controller was sampled 20 times, every 0.01 s, and acted {delay:g} s later")


def growth(gain, delay, inertia):
    """Spectral radius of the loop from sample to sample, with both gains multiplied."""
    step = one_sample(inertia, delay)
    step[:, :2] -= gain * step[:, -1:] * [KP, KD]
    step[:, -1] = 0  # the command of the sample is in its place
    return np.abs(np.linalg.eigvals(step)).max()


@pytest.mark.parametrize("count", kept([2, 50], [2]))
def test_loops_beside_their_limits_of_stability_grow_and_decay(made, count):
    """By the spectral radius: 3 % below the largest stable gain, and above it."""
    rng, inertia = np.random.default_rng(count), inertia_of(straight_chain(1))
    for k in range(count):
        delay = T * (rng.uniform(0, 3) if k % 2 else rng.integers(0, 4))
        limit = brentq(lambda *given: growth(*given) - 1, 0.3, 100.0, args=(delay, inertia))
        for gain in (0.97 * limit, 1.03 * limit):
            robot, law = made(straight_chain(1), lambda t, q, qd: gain * (-KP * q - KD * qd), "called")  # noqa: B023
            parts = {"friction": rne.Friction(viscous=VISCOUS), "controller": law, "sample_time": T, "delay": delay}
            times = T * np.arange(121)
            motion = rne.simulate(rne.Scene(robot, **parts, **NO_GRAVITY), [0.1], [0.0], times[-1], t_eval=times)
            size = np.hypot(KP * motion.q, KD * motion.qd)
            rate = np.log(size[90:].max() / size[60:90].max()) / 30
            assert rate == pytest.approx(np.log(growth(gain, delay, inertia)), rel=0.5), (delay, gain)  # beats


@pytest.mark.parametrize("late", kept([1, 2], [2]))
@pytest.mark.parametrize("way", kept(["called", "numba called"], ["called"]))
def test_a_delay_of_whole_samples_is_a_memory_of_the_law_to_the_last_bit(made, way, late):
    class Late:
        """Commands through a queue."""

        def __call__(self, t, q, qd):
            if t == 0:
                self.queue = [np.zeros(2)] * late
            self.queue.append(law(t, q, qd))
            return self.queue.pop(0)

    robot, law = made(straight_chain(2), lambda t, q, qd: np.array([3.0, 1.0]) * np.sin(9 * t) - 8 * q - qd, way)
    parts = {"friction": rne.Friction(viscous=0.1, coulomb=[0.3, 0.1], smoothing=0), "effort_limit": [2.5, 1.0]}
    scenes = [
        rne.Scene(robot, controller=Late(), sample_time=T, **parts),
        rne.Scene(robot, controller=law, sample_time=T, delay=late * T, **parts),
    ]
    one, other = (rne.simulate(scene, [0.3, 0.2], [0, 0], 0.3) for scene in scenes)
    assert "changes between sticking and slipping" in one.message
    for name in ("t", "q", "qd", "qdd", "tau", "work", "energy", "jumps", "qdd_before", "tau_before"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize("delay", [0.4 * T, 2 * T, 2.6 * T])
def test_commands_are_limited_at_their_samples_and_act_later(made, delay):
    """By limits of torque and of its rate, of a law with states; it is told the commands, and they act in their order."""

    class Integrating:
        states = 1

        def __init__(self):
            self.told, self.states_seen = [], []

        def __call__(self, t, q, qd, z):
            self.states_seen.append(z)
            return np.array([20 * np.sin(40 * t) - 5 * q[0] - 3 * z[0]]), q - TARGET

        def delivered(self, torque):
            self.told.append(torque)

    robot, law = made(straight_chain(1), Integrating(), "called")
    limits = {"effort_limit": 4.0, "torque_rate": 150.0}
    scene = rne.Scene(robot, controller=law, sample_time=T, delay=delay, **limits)
    motion = rne.simulate(scene, [0.3], [0.0], 0.3)
    commands, k = np.array(law.told), np.searchsorted(T * np.arange(30), motion.t - delay + 1e-12, side="right") - 1
    assert np.abs(np.diff(commands, axis=0)).max() == pytest.approx(150.0 * T)
    assert np.abs(commands).max() == 4.0
    np.testing.assert_array_equal(motion.tau[:-1], np.where(k[:, None] < 0, 0.0, commands[k])[:-1])
    changes = np.flatnonzero(np.diff(commands[:, 0], prepend=0.0))
    changes = changes[changes * T + delay < 0.3 - 1e-9]
    np.testing.assert_allclose(motion.jumps, T * changes + delay, rtol=1e-12)
    np.testing.assert_array_equal(motion.tau_before, np.vstack([[0.0], commands])[changes])
    assert motion.energy_drift < 1e-6
    samples = np.searchsorted(motion.t, T * np.arange(30) - 1e-12)
    by_euler = np.append(0.0, np.cumsum(T * (motion.q[samples, 0] - TARGET)))
    np.testing.assert_allclose(np.ravel(law.states_seen), by_euler[:-1], atol=1e-15)
    np.testing.assert_allclose(motion.controller_state[samples, 0], by_euler[:-1], atol=1e-15)


def pid(robot):
    return rne.control.pid(robot, [20.0, 5.0], [20.0, 10.0], [1.0, 0.2], [0.4, -0.1], windup=2.0)


ALL_PARTS = [(p, d, w) for p in ("dry", "smooth", "elastic") for d in (0.6 * T, T, 2.3 * T) for w in ("loop", "numba")]
FEW_PARTS = [("dry", 2.3 * T, "loop"), ("elastic", T, "loop")]


@pytest.mark.parametrize(("parts", "delay", "way"), kept(ALL_PARTS, FEW_PARTS))
def test_samples_in_machine_code_are_those_of_scipys_solvers(made, parts, delay, way):
    """With friction that sticks, whose events throw samples and commands away that come behind them, and elastic joints."""
    motions, model = [], straight_chain(2)
    friction = {"viscous": 0.2, "coulomb": [1.0, 0.2], "static": [1.5, 0.25], "smoothing": 0}
    friction = friction if parts == "dry" else {"viscous": 0.2, "coulomb": 0.2, "smoothing": 0.3}
    further = {"elastic": rne.ElasticJoints(stiffness=300.0, rotor=0.05)} if parts == "elastic" else {}
    for one in ("traced", way):
        robot, law = made(model, pid(rne.Robot(model)), one)
        further |= {"effort_limit": [9.0, 3.0], "torque_rate": [200.0, 100.0], "friction": rne.Friction(**friction)}
        scene = rne.Scene(robot, controller=law, sample_time=T, delay=delay, **further)
        how = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-12}
        ways = {}, {"t_eval": np.linspace(0, 0.1, 11)}
        motions.append([rne.simulate(scene, [0.3, 0.2], [0, 0], 0.1, **how, **further) for further in ways])
    at_steps, at_times = ("jumps", "qdd_before", "tau_before"), ("q", "qd", "qdd", "tau", "work", "controller_state")
    for expected, got, names in zip(*motions, (at_steps, at_times), strict=True):
        assert got.message.replace("; in machine code", "") == expected.message
        assert got.energy_drift < 1e-6
        for name in names:  # steps between events are where roundings place them
            other = getattr(expected, name)
            tolerance = 1e-7 * np.abs(other).max(initial=0.0)  # 100 times that of the runs
            np.testing.assert_allclose(getattr(got, name), other, rtol=1e-7, atol=tolerance, err_msg=name)


@pytest.mark.parametrize("way", kept(["called", "loop", "numba"], ["called", "loop"]))
def test_a_stop_ends_a_run_while_commands_are_pending(made, way):
    """A constant force from the delay on: x = F (t - delay)^2 / 2 m comes to the stop between two samples."""
    block = Part(link="l", joint="j", kind="prismatic", parent=0, axis=np.eye(3)[0], mass=2.0, upper=0.5, lower=-1.0)
    model = assemble("block", [Part(link="base"), block], gravity=(0, 0, 0))
    robot, law = made(model, lambda t, q, qd: 40.0 + 0.0 * q, way)
    scene = rne.Scene(robot, controller=law, sample_time=0.03, delay=0.1, stops=True)
    motion = rne.simulate(scene, [0.0], [0.0], 1.0)
    assert motion.status == 1
    assert motion.t[-1] == pytest.approx(0.1 + (2 * 0.5 * 2.0 / 40.0) ** 0.5, rel=1e-9)
    assert motion.jumps == pytest.approx([0.1])
    np.testing.assert_allclose(motion.tau[:, 0], np.where(motion.t < 0.1 - 1e-9, 0, 40.0))
    assert motion.work[-1] == pytest.approx(20.0)
    assert motion.message.endswith("reached its stop at 0.5 at t = 0.323607 s")
    assert rne.ensemble(scene, [[0.0]], [[0.0]], 0.3).q[-1, 0, 0] == pytest.approx(10.0 * 0.2**2)


def test_a_delay_beyond_the_end_and_one_of_roundings(made):
    """No torque acts; and all do at their samples."""
    whole = linear_loop(made, "called", None)
    motions = [
        rne.simulate(scene, START[:1], START[1:], 10 * T, t_eval=T * np.arange(11))
        for scene in (whole, linear_loop(made, "called", 0.0), linear_loop(made, "called", 1e-14 * T))
    ]
    for motion in motions[1:]:
        np.testing.assert_array_equal(motion.q, motions[0].q)
        assert motion.message == motions[0].message
    for delay in (0.1, 1e300):
        motion = rne.simulate(linear_loop(made, "called", delay), START[:1], START[1:], 10 * T)
        decay = inertia_of(straight_chain(1)) / VISCOUS
        slid = START[0] + START[1] * decay * (1 - np.exp(-motion.t / decay))
        np.testing.assert_allclose(motion.q[:, 0], slid, rtol=1e-6)
        np.testing.assert_array_equal(motion.tau, 0.0)  # of no command


@pytest.mark.parametrize("delay", kept([0.0, 0.3 * T, 2 * T, 2.6 * T], [0.3 * T, 2 * T]))
def test_a_hold_that_was_set_back_is_one_that_never_went_on(made, delay):
    """Behind each of its instants and between them; the pending commands are those of the samples that are kept."""
    scene = linear_loop(made, "called", delay, torque_rate=500.0)

    def held(*until):
        plant = Plant(scene.dynamics, scene.resolved.robot)
        hold = ZeroOrderHold(scene, plant, 1.0)
        for t in until:
            hold.rewind(t)
            while hold.next <= t:
                hold.renew(hold.next, np.array([0.3 + hold.next, np.cos(50 * hold.next)]))
        acting, count = hold.commands(), min(hold.count, len(hold.pending))
        last = hold.pending[np.arange(hold.count - count, hold.count) % len(hold.pending)]
        return [*hold.samples(), *acting, last, plant.sampled, hold.next, hold.count, hold.arrived]

    for back in np.arange(0.0, 7.3, 0.2):
        for one, other in zip(held(7.35 * T, back * T), held(back * T), strict=True):
            np.testing.assert_array_equal(one, other)


def test_a_loop_that_diverges_is_told_with_its_delay():
    robot = rne.Robot(straight_chain(1))
    scene = rne.Scene(robot, controller=rne.control.pd_gravity(robot, 5, 2, [0]), sample_time=T, delay=2 * T)
    hold = ZeroOrderHold(scene, Plant(scene.dynamics, robot), 1.0)
    hold.renew(0.0, np.zeros(scene.dynamics.size))
    loop = scene.check_gains([0])
    assert f"smallest unstable sample time {loop.sample_time_limit:.4g} s" in str(loop)
    later = replace(scene, delay=9 * T).check_gains([0])
    words = "unstable at the shortest sample times, with this delay\nstable with ([0-9.]+) times the law's torques"
    factor = float(re.search(f"{words}$", str(later))[1])
    free = replace(scene, controller=rne.control.pd(robot, 0, 2, [0]), gravity=[0, 0, 0], delay=None).check_gains([0])
    assert free.windows[0].verdict == "undecided"
    assert "; undecided at the shortest sample times\nzero poles: 1 of 2" in str(free)
    weaker = [replace(later.loop, F=k * later.loop.F).is_stable for k in (factor, factor + 0.1)]
    assert weaker == [True, False]
    limit = loop.sample_time_limit
    assert hold.stability() == (
        f"by scene.check_gains it is stable up to {limit:.4g} s with its delay of 0.02 s, and sampled every 0.01 s"
    )


@pytest.mark.parametrize(
    ("delay", "period", "expected"),
    [(0.0, 0.1, (0, 0)), (0.3, 0.1, (3, 0)), (0.1 + 0.2, 0.1, (3, 0)), (0.25, 0.1, (2, 0.05)), (0.29, 0.1, (2, 0.09))],
)
def test_a_delay_in_periods(delay, period, expected):
    """As an observer remembers earlier commands: one more than whole periods; the older one acts for the remainder."""
    observer = rne.control.MomentumObserver(rne.Robot(straight_chain(1)))
    law = observer.law(lambda t, q, qd: 0 * q, sample_time=period, delay=delay)
    assert law.earlier == (expected[0] + 1 if delay else 0)
    assert law.share * period == pytest.approx(expected[1], abs=1e-15)


@pytest.mark.parametrize("delay", kept([0.6 * T, 2 * T], [0.6 * T]))
def test_a_watched_law_knows_what_acts(delay):
    """No contact is seen without one, but where the law is not told the delay; and one within some samples."""
    robot = rne.Robot(straight_chain(2))
    law = lambda t, q, qd: np.array([3.0, 1.0]) * np.sin(20 * t) - [8.0, 2.0] * q - [0.5, 0.1] * qd  # noqa: E731
    observer, contacts = rne.control.MomentumObserver(robot, floor=0.05), []
    for given, push in ((delay, 0.0), (0.0, 0.0), (delay, 1.0)):
        watched = observer.watching(law, law, T, given)
        pushed = lambda t, q, qd: watched(t, q, qd) + push * (t > 0.1)  # noqa: B023, E731
        scene = rne.Scene(robot, controller=pushed if push else watched, sample_time=T, delay=delay, effort_limit=2.5)
        rne.simulate(scene, [0.3, 0.2], [0, 0], 0.16, rtol=1e-8)
        contacts.append(watched.contact)
    assert contacts[0] is None
    assert contacts[1] == pytest.approx(T)
    assert 0.1 + delay < contacts[2] < 0.1 + delay + 4 * T
