"""Stiff motions: Rodas5P in machine code against tight runs of Radau, and how "auto" chooses and changes its method."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import rne
from rne.integrators import base, compiled_methods
from rne.model.abb_irb140 import CLOSED_LOOPS
from rne.simulation import run
from rne.simulation.method_choice import MethodMonitor, work_per_step
from rne.simulation.plant import Plant

from .helpers import KD, KP, kept
from .random_robots import straight_chain
from .test_compiled_motions import interpreted

LOOK = 100  # steps between two checks of the method

pytest.importorskip("numba", reason="Numba is not installed")
EXACT = {"method": "Radau", "rtol": 1e-9, "atol": 1e-11}
LOOP = CLOSED_LOOPS[0]


@pytest.fixture(scope="module", params=kept(["interpreted", "numba"], ["interpreted"]))
def pair(request):
    """Two links run by NumPy, and with the loop's text run by Python, or compiled."""
    model = straight_chain(2)
    with pytest.MonkeyPatch.context() as patch:
        by_loop = interpreted(patch) if request.param == "interpreted" else lambda m: rne.Robot(m, "numba")
        yield rne.Robot(model), by_loop(model)


@rne.traceable
def of_time(t, q, qd):
    return 3 * np.sin(5 * t) - 20 * q - 40 * qd


class Integral:
    """A law with states, the integrals of the errors."""

    states, traceable = 2, True

    def __call__(self, t, q, qd, z):
        error = q - 0.3 * np.cos(t)
        return -30 * error - 60 * qd - 20 * z, error


PARTS = {
    "of time": {"controller": of_time},
    "with states": {"controller": Integral()},
    "friction": {"friction": rne.Friction(viscous=50.0, coulomb=1.0)},
    "limits": {"controller": of_time, "effort_limit": [4.0, 2.0]},
    "sampled": {"controller": of_time, "sample_time": 0.02, "friction": rne.Friction(viscous=100.0)},
}


@pytest.mark.parametrize("parts", kept(PARTS, ["with states", "sampled"]))
def test_motions_are_those_of_a_tight_run(pair, parts):
    """States, ledger and steps' interpolants, with all that a scene may have."""
    scenes = [rne.Scene(robot, **PARTS[parts]) for robot in pair]
    end = 0.05 if parts == "sampled" else 0.1
    start, times = ([0.5, 0.2], [0.0, 1.0]), np.linspace(0, end, 17)
    exact = rne.simulate(scenes[0], *start, end, t_eval=times, **EXACT)
    got = rne.simulate(scenes[1], *start, end, t_eval=times, method="Rodas5P", rtol=1e-7, atol=1e-10)
    assert got.method == "Rodas5P"
    for name in ("q", "qd", "controller_state", "work"):
        np.testing.assert_allclose(getattr(got, name), getattr(exact, name), rtol=0, atol=2e-5, err_msg=name)
    assert got.energy_drift < 1e-4
    at_steps = rne.simulate(scenes[1], *start, end, method="Rodas5P", rtol=1e-7, atol=1e-10)
    assert at_steps.t[-1] == end
    np.testing.assert_allclose(at_steps.q[-1], exact.q[-1], atol=1e-5)


def test_a_stop_is_met_inside_a_step(pair):
    ends = {"lower": np.array([0.45, -3.0]), "upper": np.array([3.0, 3.0])}
    robots = [rne.Robot(replace(robot.model, **ends), robot.engine) for robot in pair]
    expected, got = (
        rne.simulate(rne.Scene(r, friction=rne.Friction(viscous=5.0), stops=True), [0.5, 0.2], [0, 2.0], 1.0, **how)
        for r, how in zip(robots, (EXACT, {"method": "Rodas5P", "rtol": 1e-9, "atol": 1e-12}), strict=True)
    )
    assert expected.status == got.status == 1
    assert got.t[-1] == pytest.approx(expected.t[-1], abs=1e-6)


def test_a_torque_that_becomes_nan_is_named_with_its_time(pair):
    law = rne.traceable(lambda t, q, qd: np.sqrt(1.2 - t) - q - 30 * qd)
    with pytest.raises(rne.SimulationError, match=r"torque of 'joint0' is nan at t = 1\.") as caught:
        rne.simulate(rne.Scene(pair[1], controller=law), [0.1, 0.1], [0, 0], 1.5, method="Rodas5P")
    assert 1.0 < caught.value.trajectory.t[-1] <= 1.2


def test_states_that_must_be_examined_are_stepped_through_by_the_interpreter(pair):
    """Beyond the velocities whose squares may cost digits the recursion examines each state."""
    scenes = [rne.Scene(robot, friction=rne.Friction(viscous=1e3)) for robot in pair]
    expected, got = (
        rne.simulate(s, [0.5, 0.2], [3e8, -2e8], 1e-10, method=m, rtol=1e-8)
        for s, m in zip(scenes, ("Radau", "Rodas5P"), strict=True)
    )
    np.testing.assert_allclose(got.q[-1], expected.q[-1], rtol=1e-6)


REFUSED = (
    "`method` 'Rodas5P' runs in machine code: it needs a robot of engine 'numba', a controller that is traced "
    "(rne.traceable) or sampled, and friction that does not stick; 'LSODA' and 'Radau' need none of these"
)


def test_rodas5p_is_refused_where_it_cannot_run(two):
    compiled = rne.Robot(two.model, "numba")
    called, sticking = {"controller": lambda t, q, qd: -qd}, {"friction": rne.Friction(coulomb=1.0, smoothing=0)}
    for scene in (rne.Scene(two), rne.Scene(compiled, **called), rne.Scene(compiled, **sticking)):
        with pytest.raises(ValueError, match="^" + re.escape(REFUSED) + "$"):
            rne.simulate(scene, [0, 0], [0, 0], 1.0, method="Rodas5P")


class Linear:
    """What a MethodMonitor asks of a plant: modes that may change, and the work of its methods."""

    is_compiled, is_conservative, sticks, sampled, counted = True, False, False, np.zeros(2), 4
    robot, dynamics = SimpleNamespace(n=2, joint_names=("a", "b")), SimpleNamespace(n=2, states=0)
    kernel = SimpleNamespace(operations={"multiply": 500})
    implicit = base.Implicit(2, SimpleNamespace(operations={"multiply": 500}, is_unrolled=True))
    fastest = 1.0

    def linearised(self, t, x):
        return np.diag([-self.fastest, -1.0, -1.0, -1.0])


def watched(start="DOP853", hold=None):
    plant = Linear()
    watch = MethodMonitor(plant, hold, start, 100.0, may_change=True)

    def walk(h, count):
        """Steps of length h, at most so many, until the method changes; the method."""
        before, last = watch.method, watch.recent[-1][0] if watch.recent else 0.0
        while count > 0 and watch.method == before:
            T = last + h * np.arange(min(count, watch.steps_to_look) + 1)
            watch.changes_method(base.Steps(T, np.zeros((len(T), 4))))
            count, last = count - len(T) + 1, T[-1]
        return watch.method

    return plant, watch, walk


def test_an_explicit_method_that_stability_holds_back_is_left_for_rodas5p_and_taken_again_where_that_ends():
    plant, watch, walk = watched()
    plant.fastest = 1e4
    assert walk(1e-5, 300) == "DOP853"  # accuracy asks for short steps
    assert walk(5e-4, 1000) == "Rodas5P"
    assert walk(1e-2, 2000) == "Rodas5P"
    plant.fastest = 10.0
    assert walk(1e-2, 2000) == "DOP853"
    assert walk(4e-2, 2000) == "DOP853"
    assert watch.note.count(" from t = ") == 2


def test_a_change_that_does_not_pay_is_undone_and_not_soon_tried_again():
    plant, watch, walk = watched()
    plant.fastest = 1e3
    assert walk(4e-3, 1000) == "Rodas5P"
    assert walk(3e-3, 100) == "DOP853"  # an explicit step is about as much work
    assert watch.note.endswith("on, which is faster")
    assert walk(4e-3, 300) == "DOP853"
    assert walk(4e-3, 1000) == "Rodas5P"


def test_rodas5p_stays_where_an_explicit_method_was_faster_before_the_motion_became_stiff():
    plant, _, walk = watched()
    plant.fastest = 1e2
    assert walk(2e-2, 1000) == "Rodas5P"
    plant.fastest = 1e5
    assert walk(1e-3, 2000) == "Rodas5P"


def test_of_many_changes_of_method_the_first_and_the_last_are_told():
    watch = MethodMonitor(Linear(), None, "DOP853", 100.0)
    watch.notes = [f"change {k}" for k in range(9)]
    assert watch.note == "change 0; change 1; change 2; 5 more changes; change 8"


@pytest.mark.parametrize("method", ["DOP853", "Tsit5", "Rodas5P"])
def test_more_states_take_more_work(method):
    small, large = Linear(), Linear()
    large.counted = 40
    assert work_per_step(large, method) > work_per_step(small, method) > 0


def test_joints_that_stick_are_left_to_machine_code_for_longer():
    """LSODA, which runs where joints stick, takes no steps in machine code; others change at a hundredth of this decay."""
    plant, _, walk = watched()
    plant.sticks, plant.fastest = True, 900.0
    assert walk(3e-3, 1000) == "DOP853"
    plant.fastest = 1100.0
    assert walk(3e-3, 1000) == "LSODA"


def test_after_a_change_the_next_look_is_soon():
    """Else, where steps cost little, after twice as many steps."""
    plant, watch, walk = watched()
    assert watch.steps_to_look == 2 * LOOK
    plant.fastest = 1e4
    assert walk(5e-4, 1000) == "Rodas5P"
    assert watch.steps_to_look == LOOK
    walk(5e-4, LOOK)
    assert watch.steps_to_look == 2 * LOOK


def test_longer_steps_of_an_explicit_method_must_be_worth_a_change():
    plant, _, walk = watched("Rodas5P")
    plant.fastest = 4.0 / 1e-3 * work_per_step(plant, "Rodas5P") / work_per_step(plant, "DOP853") / 1.9
    assert walk(1e-3, 1000) == "Rodas5P"
    plant.fastest *= 1.9 / 2.1
    assert walk(1e-3, 1000) == "DOP853"


def test_torques_that_jumped_earlier_do_not_chatter(monkeypatch):
    watch = MethodMonitor(Linear(), None, "DOP853", 100.0)
    watch.recent.extend((float(k), np.zeros(4)) for k in range(LOOK))
    monkeypatch.setattr(watch, "_check_repeats", lambda *_: None)
    monkeypatch.setattr(watch, "_jump", lambda t, *_: np.ones(2) if t < LOOK - 20 else None)
    watch.check_chatter()
    monkeypatch.setattr(watch, "_jump", lambda *_: np.ones(2))
    with pytest.raises(rne.NotFiniteError, match="the law chatters"):
        watch.check_chatter()


def test_joints_that_stick_and_slip_without_end_are_refused():
    """A thousand changes within 1e-4 of the time, not one less, nor in more time."""
    monitor, text = (
        MethodMonitor(Linear(), None, "DOP853", 100.0),
        r"^1000 changes between sticking and slipping within ",
    )
    for t in np.concatenate([np.linspace(0, 1, 1000), 2 + 1e-5 * np.arange(999)]):
        monitor.change(t)
    with pytest.raises(rne.NotFiniteError, match=text + r"0\.00999 s at t = 2\.00999 s: the torques chatter"):
        monitor.change(2.00999)


@pytest.mark.parametrize(("compiled", "conservative", "looks"), [(False, True, 1), (True, False, 2), (True, True, 10)])
def test_steps_that_cost_little_are_looked_at_less_often(compiled, conservative, looks):
    plant = Linear()
    plant.is_compiled, plant.is_conservative = compiled, conservative
    assert MethodMonitor(plant, None, "DOP853", 100.0).steps_to_look == looks * LOOK


@pytest.mark.parametrize(("traced", "fast_enough", "too_fast"), [(None, 2e4, 4e4), (True, 1e5, 2e5)])
def test_between_samples_the_decay_until_the_next_one_counts(traced, fast_enough, too_fast):
    """Where the law is sampled in machine code, steps of Tsit5 cost little."""
    plant, _, walk = watched("Tsit5", SimpleNamespace(period=1e-3, traced=traced))
    plant.fastest = fast_enough
    assert walk(1.5e-4, 1000) == "Tsit5"
    plant.fastest = too_fast
    assert walk(1.5e-4, 1000) == "Rodas5P"


def test_blocks_of_any_number_of_steps_are_the_same_steps(pair):
    solvers, times = [], []
    for most in (1, 100):
        plant = Plant(rne.Scene(pair[1], controller=of_time).dynamics, pair[1])
        how = base.IntegrationOptions("Rodas5P", 1e-6, 1e-9), plant
        solvers.append(compiled_methods.RosenbrockSolver(*how))
        solvers[-1].start(plant, 0.0, np.array([0.5, 0.2, 0, 1.0, 0]), 0.1)
        times.append([0.0])
        while solvers[-1].is_running:
            times[-1].extend(solvers[-1].steps(most).T[1:])
    np.testing.assert_allclose(times[0], times[1], rtol=1e-9)
    assert len(times[0]) > 10


def test_the_first_step_is_a_part_of_the_time_that_is_left(pair):
    """However much has passed before."""
    plant, lengths = Plant(rne.Scene(pair[1]).dynamics, pair[1]), []
    how = base.IntegrationOptions("Rodas5P", 1e-6, 1e-9), plant
    for begin in (0.0, 1e3):
        solver = compiled_methods.RosenbrockSolver(*how)
        solver.start(plant, begin, np.array([0.5, 0.2, 0, 1.0]), begin + 0.1)
        lengths.append(np.diff(solver.steps(1).T)[0])
    assert lengths[0] == pytest.approx(0.1 * compiled_methods.FIRST)
    assert lengths[1] == pytest.approx(lengths[0], rel=1e-5)  # rounding of the time


def test_evaluations_are_calls_and_one_per_component_of_the_state_for_each_jacobian(pair, monkeypatch):
    counts, run = [], compiled_methods.take_stiff_segments

    def noted(*arguments):
        taken = run(*arguments)
        counts.append(arguments[-1].evaluations)
        return taken

    monkeypatch.setattr(compiled_methods, "take_stiff_segments", noted)
    scene = rne.Scene(pair[1], controller=of_time)
    motion = rne.simulate(scene, [0.5, 0.2], [0, 1], 0.1, method="Rodas5P")
    calls, jacobians = np.sum(counts, axis=0)
    assert motion.evaluations == calls + 4 * jacobians


def test_a_sampled_motion_that_stability_holds_back_is_known_by_the_time_between_samples(irb140):
    """Friction that decays 700 times between two samples: RK45 took 72,908 evaluations over 0.05 s, LSODA 7,035."""
    law = rne.control.pd_gravity(irb140, kp=[50] * 6, kd=[2] * 6, reference=[0.5] * 6)
    scene = rne.Scene(irb140, controller=law, sample_time=1e-3, friction=rne.Friction(viscous=1000.0))
    motion = rne.simulate(scene, [0] * 6, [0] * 6, 0.01)
    assert motion.message.startswith(
        "LSODA: stiff, the largest decay rate at the start, 6.95e+05 1/s, times the sample time is 695"
    )
    assert motion.evaluations < 2500
    exact = rne.simulate(scene, [0] * 6, [0] * 6, 0.01, method="Radau", rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(motion.q[-1], exact.q[-1], rtol=1e-5)


@pytest.mark.parametrize("method", kept(["auto", "LSODA"], ["LSODA"]))
def test_sampled_motions_with_very_stiff_friction_begin(irb140, method):
    """LSODA gave up at the first sample, whose whole time was its first step. Each joint creeps with torque / viscous."""
    law = rne.control.pd_gravity(irb140, kp=[50] * 6, kd=[2] * 6, reference=[0.5] * 6)
    scene = rne.Scene(irb140, controller=law, sample_time=1e-3, friction=rne.Friction(viscous=20000.0))
    motion = rne.simulate(scene, [0] * 6, [0] * 6, 0.005, method=method)
    assert motion.method == ("Radau" if method == "auto" else method)
    creep = (motion.tau[-1] - irb140.gravity_torque(motion.q[-1])) / 20000.0
    np.testing.assert_allclose(motion.qd[-1], creep, rtol=1e-5, atol=1e-12)  # torque of the sample after


def test_a_motion_that_nothing_damps_is_not_stiff_however_long(two):
    """Long swings were once called stiff: the unstable direction of a pendulum times the duration."""
    motion = rne.simulate(two, [3.1, 0.0], [0, 0], 0.5)
    assert motion.message == "DOP853: not stiff, nothing damps the motion; completed"


def methods_that_ran(patch):
    """Methods in the order in which the loop began with them."""
    ran, make = [], run._solver

    def noted(plant, task, method, hold):
        ran.append(method)
        return make(plant, task, method, hold)

    patch.setattr(run, "_solver", noted)
    return ran


@rne.traceable
def swaying(t, q, qd):
    return 0 * q + 0.2 * np.sin(5 * t)


@rne.traceable
def fading(t, q, qd):
    return -2000 * np.exp(-20 * t) * qd - 0.1 * qd


@rne.traceable
def coming_and_going(t, q, qd):
    return -50 * (1 + np.sin(3 * t)) ** 4 * qd - 0.1 * qd


CHANGING = {
    "begins": ({"friction": rne.Friction(coulomb=2.0)}, 0.5, ["DOP853", "Rodas5P"]),
    "ends": ({"controller": fading}, 5.0, ["Rodas5P", "DOP853"]),
    "sampled": (
        {"controller": swaying, "sample_time": 3e-3, "friction": rne.Friction(coulomb=2.0)},
        0.4,
        ["Tsit5", "Rodas5P"],
    ),
    "comes and goes": ({"controller": coming_and_going}, 3.0, ["Rodas5P", "DOP853", "Rodas5P"]),
}


@pytest.mark.long
@pytest.mark.parametrize("case", CHANGING)
def test_the_message_names_the_methods_that_ran_in_their_order(monkeypatch, case):
    parts, end, expected = CHANGING[case]
    scene = rne.Scene(rne.load("irb140", engine="numba"), **parts)
    exact = rne.simulate(scene, [0.5] * 6, [1] * 6, end, method="LSODA", rtol=1e-8, atol=1e-10)
    ran = methods_that_ran(monkeypatch)
    motion = rne.simulate(scene, [0.5] * 6, [1] * 6, end)
    assert ran == expected
    assert re.findall(r"(\w+)(?:: | from t = )", motion.message) == expected
    assert motion.method == expected[-1]
    np.testing.assert_allclose(motion.q[-1], exact.q[-1], atol=1e-4)


@pytest.mark.long
def test_a_sampled_motion_changes_back_where_its_joints_move(two, monkeypatch):
    """Smoothed Coulomb friction is stiff at rest only; the samples go on in machine code, and one by one again."""
    friction = rne.Friction(coulomb=0.1, smoothing=1e-4)
    scene = rne.Scene(rne.Robot(two.model, "numba"), controller=swaying, sample_time=0.01, friction=friction)
    times, ran = np.linspace(0, 3, 7), methods_that_ran(monkeypatch)
    motion = rne.simulate(scene, [0.5, 0.2], [0, 0], 3.0, t_eval=times)
    assert ran == ["Rodas5P", "Tsit5", "Rodas5P"]
    assert motion.message.endswith("on, which is faster; the controller was sampled 300 times, every 0.01 s")
    exact = rne.simulate(scene, [0.5, 0.2], [0, 0], 3.0, t_eval=times, method="Rodas5P", rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(motion.q, exact.q, atol=1e-4)


@pytest.mark.long
def test_the_thesis_loop_at_both_tolerances():
    """Errors below those of LSODA."""
    robots = [rne.load("irb140", engine=engine) for engine in ("numpy", "numba")]
    laws = [rne.control.pd_gravity(robot, KP, KD, LOOP.reference) for robot in robots]
    scenes = [rne.Scene(r, controller=law) for r, law in zip(robots, laws, strict=True)]
    times, start = np.linspace(0, 5, 101), (LOOP.start, np.zeros(6))
    exact = rne.simulate(scenes[0], *start, 5.0, t_eval=times, method="LSODA", rtol=1e-12, atol=1e-14)
    for rtol in (1e-6, 1e-10):
        how = {"t_eval": times, "rtol": rtol, "atol": rtol / 1e3}
        lsoda = rne.simulate(scenes[0], *start, 5.0, method="LSODA", **how)
        got = rne.simulate(scenes[1], *start, 5.0, **how)
        assert got.message.startswith("Rodas5P: stiff, the largest decay rate at the start, 1.529e+04 1/s, ")
        errors = [max(np.abs(m.q - exact.q).max(), np.abs(m.qd - exact.qd).max()) for m in (lsoda, got)]
        assert errors[1] < errors[0]
