"""Events inside steps: stops touched and left again, rates that dip to zero, break-away while everything sticks.

The oracles are closed forms: parabolas under gravity, and a block under sums of sines, integrated exactly between the
zeros of its rate and load.
"""

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.optimize import brentq

import rne
from rne.integrators import base
from rne.simulation.events import first_crossing

from .helpers import Mimic, Part, assemble, kept

X, _, Z = np.eye(3)
TIGHT = {"rtol": 1e-9, "atol": 1e-12}


def slider(axis=X, gravity=0.0, upper=np.inf, mass=1.0):
    joint = Part(link="l", joint="j", kind="prismatic", parent=0, axis=axis, mass=mass, upper=upper)
    return rne.Robot(assemble("slider", [Part(link="base"), joint], gravity=(0, 0, -gravity)))


def dry(robot, coulomb, static=None):
    return rne.Scene(robot, friction=rne.Friction(coulomb=coulomb, static=static, smoothing=0))


@pytest.mark.parametrize("method", ["auto", "RK45", "LSODA", "Radau", "BDF", "sampled"])
def test_a_stop_touched_inside_a_step_is_found(method):
    """A lift thrown to an apex of 0.4505 m passes its stop at 0.45 m and returns within 20 ms."""
    rate = np.sqrt(2 * 9.81 * 0.4505)
    sampled = {"controller": lambda t, q, qd: 0 * q, "sample_time": 0.05} if method == "sampled" else {}
    scene = rne.Scene(slider(Z, 9.81, upper=0.45), stops=True, **sampled)
    motion = rne.simulate(scene, [0.0], [rate], 1.0, method="auto" if sampled else method)
    assert motion.status == 1
    expected = (rate - np.sqrt(rate**2 - 2 * 9.81 * 0.45)) / 9.81
    assert motion.t[-1] == pytest.approx(expected, abs=1e-6)


def test_the_stops_of_a_mimic_joint_bind():
    parts = [Part(link="base")]
    parts.append(Part(link="a", joint="ja", kind="prismatic", parent=0, axis=X, mass=1.0, lower=-1.0, upper=1.0))
    parts.append(
        Part(link="b", joint="jb", kind="prismatic", parent=1, axis=X, mass=1.0, upper=0.5, mimic=Mimic(1, 2.0, 0.1))
    )
    robot = rne.Robot(assemble("gripper", parts, gravity=(0, 0, 0)))
    motion = rne.simulate(rne.Scene(robot, stops=True), [0.0], [1.0], 2.0)
    assert motion.t[-1] == pytest.approx(0.2, abs=1e-12)
    assert motion.message.endswith("'jb' reached its stop at 0.5 at t = 0.2 s")


def test_a_start_beyond_a_stop_is_refused():
    text = r"^`q0` must be within the stops, got 0.5 for joint 'j', whose stop is at 0.45$"
    with pytest.raises(ValueError, match=text):
        rne.simulate(rne.Scene(slider(upper=0.45), stops=True), [0.5], [0.0], 1.0)


class TimeItself(base.Steps):
    """Steps along x(t) = t."""

    def __init__(self, times):
        super().__init__(np.array(times), np.array(times)[:, None])

    def states(self, times, k):
        return times[:, None]


@pytest.mark.parametrize("seed", kept(range(10), range(4)))
def test_the_first_event_of_many_steps_is_that_of_each_alone(seed):
    """Among them passages of zero that return within a part of a step, which show as a peak below zero alone."""
    rng = np.random.default_rng(seed)
    phases, levels = rng.uniform(0, 6, 3), np.array([0.7, 0.97, 0.99995])
    steps = TimeItself(np.concatenate([[0], np.cumsum(rng.uniform(0.1, 0.5, 12))]))
    events = [lambda t, X, u, p=p, h=h: np.sin(X[:, 0] + p) - h for p, h in zip(phases, levels, strict=True)]
    passages = (np.arcsin(levels) - phases) % (2 * np.pi)
    found = first_crossing(events, steps)
    alone = [(k, hit) for k in range(12) if (hit := first_crossing(events, steps, k, k + 1))]
    if found is None:
        assert not alone
        assert passages.min() > steps.T[-1]
        return
    k, one = alone[0]
    assert (found.step, found.event, found.t) == (k, one.event, one.t)
    assert found.event == np.argmin(passages)
    assert found.t == pytest.approx(passages.min(), abs=1e-9)


def test_an_event_that_touches_zero_and_turns_back_has_not_happened():
    def event(t, X, u):
        return -np.maximum(0, np.abs(X[:, 0] - 0.45) - width)

    steps, width = TimeItself([0, 1]), 0.02  # between two points at which events are evaluated
    assert first_crossing([event], steps) is None
    assert first_crossing([lambda t, X, u: event(t, X, u) + 1e-6], steps).t == pytest.approx(0.43, abs=1e-5)


def test_a_value_that_a_sample_makes_positive_ends_the_step_before():
    steps = TimeItself([0.0, 1.0, 2.0, 3.0])
    steps.U = np.array([[0.0], [0.0], [1.0]])
    found = first_crossing([lambda t, X, u: u[:, 0] - 0.5], steps)
    assert (found.step, found.event, found.t, found.x.tolist()) == (1, None, 2.0, [2.0])


def test_an_error_of_an_event_counts_before_a_crossing_only():
    def event(t, X, u):
        if (t > last).any():
            raise rne.NotFiniteError("beyond", 1.0)
        return X[:, 0] - 0.35

    steps, last = TimeItself(np.linspace(0, 1, 11)), 0.45
    assert first_crossing([event], steps).step == 3
    last = 0.25
    with pytest.raises(rne.NotFiniteError, match=r"^beyond$"):
        first_crossing([event], steps)


def check_stop(seed):
    """A throw against gravity: stopped below the apex, not stopped above it."""
    rng = np.random.default_rng(seed)
    gravity, rate = rng.uniform(1, 20), rng.uniform(0.5, 5)
    apex = rate**2 / 2 / gravity
    upper = apex * (rng.uniform(0.2, 1.3) if seed % 2 else 1 + rng.choice([-1, 1]) * 10 ** rng.uniform(-5, -2))
    scene = rne.Scene(slider(Z, gravity, upper), stops=True)
    end = rng.uniform(1.2, 4) * rate / gravity
    motion = rne.simulate(scene, [0.0], [rate], end, method=str(rng.choice(["auto", "RK45", "LSODA"])))
    assert motion.status == (upper < apex)
    if upper < apex:
        assert motion.t[-1] == pytest.approx((rate - np.sqrt(rate**2 - 2 * gravity * upper)) / gravity, abs=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_random_throws_at_stops(seed):
    check_stop(seed)


def test_strokes_of_a_block_that_sticks_at_first():
    """Strokes of 20 mm, once missed altogether: while everything sticks the state says nothing of the force."""
    law = lambda t, q, qd: [1.5 * np.sin(2 * np.pi * t)]  # noqa: E731
    motion = rne.simulate(dry(slider(), 1.0), [0.0], [0.0], 10.0, torque=law)
    assert motion.q.max() == pytest.approx(0.02045, abs=1e-4)
    assert motion.message.endswith("39 changes between sticking and slipping")


def test_a_rate_that_dips_to_zero():
    motion = rne.simulate(dry(slider(), 1.0), [0.0], [1.98], 2.0, torque=lambda t, q, qd: [4 * t - 3])
    assert motion.q[-1, 0] == pytest.approx(1.3146667, abs=1e-6)


def test_a_block_of_a_milligram_is_a_block():
    """0.5 nN against 0.1 nN of friction: 20 mm in 10 s."""
    motion = rne.simulate(dry(slider(mass=1e-6), 1e-10), [0.0], [0.0], 10.0, torque=[5e-10])
    assert motion.q[-1, 0] == pytest.approx(0.02, rel=1e-6)


def test_static_friction_needs_dry_friction():
    with pytest.raises(ValueError, match=r"^`static` needs dry friction: set `smoothing` to 0$"):
        rne.Friction(coulomb=1.0, static=2.0)


def test_a_scene_copies_what_it_is_given(irb140):
    armature = np.full(6, 0.1)
    scene = rne.Scene(irb140, armature=armature)
    before = rne.simulate(scene, [0] * 6, [0] * 6, 0.1, torque=np.zeros(6)).q[-1]
    armature[:] = 50.0
    assert np.array_equal(rne.simulate(scene, [0] * 6, [0] * 6, 0.1, torque=np.zeros(6)).q[-1], before)


def test_a_joint_that_can_be_held_stays_when_another_turns_back():
    """Two blocks, one riding on the other, under -3 N each; the lower one is held by 2 N, the upper slides, stops at
    0.25 s and turns back: the load on the lower one goes from 1 N to -1 N, and never exceeds what holds it."""
    parts = [Part(link="base")]
    parts += [Part(link=f"l{k}", joint=f"j{k}", kind="prismatic", parent=k, axis=X, mass=1.0) for k in (0, 1)]
    robot = rne.Robot(assemble("riders", parts, gravity=(0, 0, 0)))
    scene = rne.Scene(robot, friction=rne.Friction(coulomb=[0.5, 1.0], static=[2.0, 1.0], smoothing=0))
    motion = rne.simulate(scene, [0, 0], [0, 1], 1.0, torque=[-3.0, -3.0])
    np.testing.assert_allclose(motion.q[-1], [0.0, -0.4375], atol=1e-9)


def test_a_joint_that_can_be_held_stays_when_another_breaks_away():
    """Blocks on crossed rails, held by 2 N: the first under -1 N, the second under 3 N, against which 0.5 N slide."""
    parts = [Part(link="base")]
    for k, axis in enumerate((X, (0.0, 1.0, 0.0))):
        parts.append(Part(link=f"l{k}", joint=f"j{k}", kind="prismatic", parent=k, axis=axis, mass=1.0))
    robot = rne.Robot(assemble("crossed", parts, gravity=(0, 0, 0)))
    motion = rne.simulate(dry(robot, 0.5, 2.0), [0, 0], [0, 0], 1.0, torque=[-1.0, 3.0])
    np.testing.assert_allclose(motion.q[-1], [0.0, 1.25], atol=1e-9)


@pytest.mark.parametrize("duration", kept([0.06, 0.6], [0.06]))
def test_an_arm_that_follows_small_sines_against_dry_friction(irb140, duration):
    """Stiff control, 50 mrad at 2 rad/s: every joint stops and breaks away; once 26 mrad wrong. The second way: breaks
    every 10 ms, so that no step can miss an event."""
    omega = np.array([2, 1.7, 2.3, 1.9, 2.1, 2.5])
    kp, kd = np.array([5000, 5000, 3000, 500, 500, 100.0]), np.array([200, 200, 100, 10, 10, 2.0])

    def law(t, q, qd):
        error, rate = q - 0.05 * np.sin(omega * t), qd - 0.05 * omega * np.cos(omega * t)
        return irb140.gravity_torque(q) - kp * error - kd * rate

    friction = rne.Friction(coulomb=[20, 20, 10, 2, 2, 0.5], smoothing=0)
    scene = rne.Scene(irb140, friction=friction, controller=law)
    ways = [rne.simulate(scene, [0] * 6, [0] * 6, duration, breaks=b) for b in ((), np.arange(0.01, duration, 0.01))]
    np.testing.assert_allclose(ways[0].q[-1], ways[1].q[-1], atol=1e-6)
    assert "changes between sticking and slipping" in ways[0].message


@pytest.mark.parametrize("method", kept(["DOP853", "LSODA", "RK45", "BDF", "Radau"], ["LSODA"]))
@pytest.mark.parametrize("marked", [True, False], ids=["traced", "called"])
@pytest.mark.parametrize("coulomb", [None, 0.1], ids=["free", "dry"])
def test_a_drive_at_its_limit_is_not_stepped_over(method, marked, coulomb):
    """20 sin(6 t) N within 2 N: while the force is constant the solver sees nothing of the law."""

    def law(t, q, qd):
        return 20 * np.sin(6.0 * t) * (1 + 0 * q)

    friction = None if coulomb is None else rne.Friction(coulomb=coulomb, smoothing=0)
    controller = rne.traceable(law) if marked else law
    scene = rne.Scene(slider(), effort_limit=[2.0], friction=friction, controller=controller)
    end = 2.0 if coulomb is None else 0.9  # before it would slip back
    motion = rne.simulate(scene, [0], [0], end, method=method, rtol=1e-9, atol=1e-12)
    t = np.linspace(0, end, 400_001)
    force = np.clip(20 * np.sin(6 * t), -2, 2)
    if coulomb is not None:
        starts = np.argmax(force > coulomb)
        force = np.where(np.arange(len(t)) < starts, 0.0, force - coulomb)
    rate = np.concatenate([[0], np.cumsum((force[1:] + force[:-1]) / 2 * t[1])])
    assert (rate >= 0).all()
    assert motion.q[-1, 0] == pytest.approx(simpson(rate, x=t), abs=2e-6)


class Block:
    """A block of 1 kg under a constant force and sines, with dry friction, integrated in closed form."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        k = int(rng.integers(1, 4))
        self.size, self.omega = rng.uniform(0.2, 2, k), 10 ** rng.uniform(0, 1.3, k)
        self.phase, self.constant = rng.uniform(0, 2 * np.pi, k), rng.uniform(-0.5, 0.5)
        self.coulomb = rng.uniform(0.3, 1.5)
        self.static = self.coulomb * rng.choice([1.0, rng.uniform(1, 1.6)])
        self.rate, self.end = rng.choice([0.0, rng.uniform(-2, 2)]), rng.uniform(1, 5)
        self.method = str(rng.choice(["auto", "RK45", "LSODA"]))

    def force(self, t, integrals=0):
        """The force, or its integral or double integral over time."""
        angle = self.omega * np.asarray(t)[..., None] + self.phase
        wave = (np.sin(angle), -np.cos(angle) / self.omega, -np.sin(angle) / self.omega**2)[integrals]
        constant = self.constant * (1.0, t, t * t / 2)[integrals]
        return constant + (self.size * wave).sum(-1)

    def slip(self, t, v, u, sign):
        """Rate and path from t to u of a slip in direction `sign` that starts with rate v."""
        since = u - t
        rate = v + self.force(u, 1) - self.force(t, 1) - sign * self.coulomb * since
        path = v * since + self.force(u, 2) - self.force(t, 2) - self.force(t, 1) * since
        return rate, path - sign * self.coulomb * since**2 / 2

    def break_away(self, t):
        """When the force next exceeds static friction."""
        grid = np.linspace(t, self.end, 20001)
        over = np.abs(self.force(grid)) - self.static * (1 + 1e-12)
        if not (over > 0).any():
            return None
        k = int(np.argmax(over > 0))
        return brentq(lambda s: abs(self.force(s)) - self.static, grid[k - 1], grid[k], xtol=1e-15) if k else t

    def position(self):
        """The exact position at the end."""
        t, x, v = 0.0, 0.0, self.rate
        while t < self.end:
            if v == 0:
                t = self.break_away(t)
                if t is None:
                    break
            sign = np.sign(v) if v else np.sign(self.force(t))
            grid = np.linspace(t, self.end, 20001)[1:]
            rates = sign * self.slip(t, v, grid, sign)[0]
            rests = rates <= 0
            rests[: int(np.argmax(rates > 0))] = False  # a slip that starts at rest
            if not rests.any():
                return x + self.slip(t, v, self.end, sign)[1]
            k = int(np.argmax(rests))
            rest = brentq(lambda u: sign * self.slip(t, v, u, sign)[0], grid[k - 1] if k else t, grid[k], xtol=1e-15)  # noqa: B023
            t, x, v = rest, x + self.slip(t, v, rest, sign)[1], 0.0
        return x


def check_block(seed):
    block = Block(seed)
    scene = dry(slider(), block.coulomb, block.static)
    law = lambda t, q, qd: [float(block.force(t))]  # noqa: E731
    motion = rne.simulate(scene, [0.0], [block.rate], block.end, torque=law, method=block.method, **TIGHT)
    assert motion.q[-1, 0] == pytest.approx(block.position(), abs=1e-6)


@pytest.mark.parametrize("seed", kept(range(4), range(2)))
def test_random_stick_slip(seed):
    check_block(seed)


@pytest.mark.long
def test_many_random_throws_and_blocks():
    for seed in range(20, 270):
        check_stop(seed)
    for seed in range(4, 157):
        check_block(seed)
