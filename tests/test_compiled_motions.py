"""Motions by the loop in machine code are those of SciPy's solvers: errors, evaluations, ledger, events, failures.

The estimate of a step's error is a difference that rounding moves, so that steps differ a little and errors are compared.
"""

from dataclasses import replace

import numpy as np
import pytest

import rne
from rne.integrators import compiled_methods, runge_kutta, step_control, tableaus
from rne.kernels import Kernel
from rne.kernels.python_backend import state_function
from rne.kernels.soundness import NeedsRecursion
from rne.simulation import run
from rne.simulation.plant import Plant
from rne.simulation.zero_order_hold import ZeroOrderHold

from .helpers import kept
from .random_robots import straight_chain

TEXTS = "take_segments", "take_samples", "add_stages"
EXACT = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}


def interpreted(monkeypatch):
    """A copy of a robot for which the loop's text is run by Python, which needs no compiler."""

    def address(kernel, lanes=1):
        function = state_function(kernel.traced)

        def call(*arguments):
            try:
                arguments[-1][:] = function(*arguments[:-1])
            except NeedsRecursion:
                return False
            return True

        return call

    for name in TEXTS:
        monkeypatch.setattr(compiled_methods, name, getattr(runge_kutta, name))
    monkeypatch.setattr(compiled_methods, "take_stiff_segments", compiled_methods.rosenbrock.take_segments)
    monkeypatch.setattr(Kernel, "address", address)
    is_meant = property(lambda plant: plant.law is None and plant.robot.model.name == "interpreted")
    monkeypatch.setattr(Plant, "is_compiled", is_meant)
    return lambda model: rne.Robot(replace(model, name="interpreted"))


@pytest.fixture(scope="module", params=kept(["interpreted", "numba"], ["interpreted"]))
def free(request):
    """Two links, run by SciPy's solvers and by the loop."""
    model = straight_chain(2)
    with pytest.MonkeyPatch.context() as monkeypatch:
        by_loop = interpreted(monkeypatch) if request.param == "interpreted" else lambda m: rne.Robot(m, "numba")
        yield rne.Robot(model), by_loop(model)


@pytest.fixture(scope="module")
def driven(free):
    """All that a compiled right-hand side may have: a law of time and state, friction, limits.

    Friction is smooth, so that accuracy, not stability, limits the steps: otherwise roundings place them.
    """

    @rne.traceable
    def law(t, q, qd):
        return 3 * np.sin(5 * t) - 2 * q - 0.5 * qd

    parts = {"controller": law, "friction": rne.Friction(viscous=0.1, coulomb=0.2, smoothing=0.3)}
    parts["effort_limit"] = [2.0] * 2
    return [rne.Scene(robot, **parts) for robot in free]


def check(pair, start, duration, *, worse=1.2, luck=0.0, **how):
    """Errors at most 1.2 times SciPy's on a grid of times, and the same words; as many evaluations, but for interpolants:
    those of DOP853 take three of fifteen, and are made for all steps of a block.

    Roundings differ between them and between processors, and place the steps: errors are compared over several starts.
    No error is more than four times SciPy's, or than `luck`, relative, where SciPy's happens to be smaller.
    """
    times, machine_code = np.linspace(0, duration, 97), is_machine_code(pair[1])
    ratios, counts, excess = {"q": [], "qd": [], "work": []}, [], []
    for k in range(6 if machine_code else 3):
        q0 = np.array(start[0]) + 0.02 * k
        exact = rne.simulate(pair[0], q0, start[1], duration, t_eval=times, **(how | EXACT))
        expected, got = (rne.simulate(one, q0, start[1], duration, t_eval=times, **how) for one in pair)
        for name, found in ratios.items():
            right = getattr(exact, name)
            small = 1e-12 * max(1.0, np.abs(right).max())
            errors = [np.abs(getattr(motion, name) - right).max() + small for motion in (expected, got)]
            found.append(errors[1] / errors[0])
            excess.append(errors[1] / max(errors[0], luck * max(1.0, np.abs(right).max())))
        counts.append((expected.evaluations, got.evaluations))
    most = np.sum(counts, axis=0)
    assert 0.97 * most[0] <= most[1] <= 1.25 * most[0]
    for name, found in ratios.items():
        assert np.exp(np.mean(np.log(found))) <= worse, (name, found)
    assert max(excess) <= 4, excess
    assert "; in machine code" in got.message
    words = got.message.replace("; in machine code", "")
    assert (got.method, words.split(",")[0]) == (expected.method, expected.message.split(",")[0])
    return got


def is_machine_code(scene):
    robot = scene.robot if isinstance(scene, rne.Scene) else scene
    return robot.engine == "numba"


@pytest.mark.parametrize("method", kept(["RK45", "DOP853"], ["DOP853"]))
def test_a_free_swing(free, method):
    motion = check(free, ([0.5, 0.2], [0, 0]), 2.0, method=method, rtol=1e-8)
    assert motion.energy_drift <= 1e-6


def test_a_law_of_time_with_friction_and_limits(driven):
    """Its ledger is integrated on the interpolants of the same steps."""
    motion = check(driven, ([0.5, 0.2], [0, 0]), 1.5, method="RK45", rtol=1e-7, luck=1e-7)
    assert motion.energy_drift <= 1e-5
    assert motion.dissipated.keys() == {"viscous", "coulomb"}


@pytest.mark.long
def test_a_law_of_time_with_friction_by_dop853(driven):
    """As by RK45, with limits that are not reached.

    Where torques reach their limits within steps, roundings place the steps of DOP853, and its errors at single starts,
    SciPy's too, scatter by a factor of ten around the tolerance: they are bounded, not compared.
    """
    start, how = ([0.5, 0.2], [0, 0]), {"method": "DOP853", "rtol": 1e-7}
    check([replace(scene, effort_limit=[50.0] * 2) for scene in driven], start, 1.5, luck=1e-7, **how)
    t = np.linspace(0, 1.5, 97)
    exact, got = (rne.simulate(s, *start, 1.5, t_eval=t, **h) for s, h in zip(driven, (EXACT, how), strict=True))
    assert (np.abs(got.tau) == 2.0).any()
    for name in ("q", "qd", "work"):
        right = getattr(exact, name)
        np.testing.assert_allclose(getattr(got, name), right, rtol=0, atol=1e-6 * max(1.0, np.abs(right).max()))
    assert got.energy_drift <= 1e-5


def test_the_steps_themselves_are_reported_and_end_at_the_end(free):
    expected, got = (rne.simulate(r, [0.5, 0.2], [0, 0], 1.0, method="DOP853", rtol=1e-8) for r in free)
    assert got.t[-1] == expected.t[-1] == 1.0
    assert len(got.t) == pytest.approx(len(expected.t), rel=0.05)
    assert (np.diff(got.t) > 0).all()
    at_expected = got(expected.t)[0]  # a quintic polynomial between steps
    np.testing.assert_allclose(at_expected, expected.q, atol=1e-6)


def test_states_that_must_be_examined_are_left_to_scipys_solver(free):
    """Beyond the velocities whose squares may cost digits the recursion examines each state."""
    expected, got = (rne.simulate(r, [0.5, 0.2], [3e8, -2e8], 1e-8, method="DOP853") for r in free)
    np.testing.assert_allclose(got.q, expected.q, rtol=1e-8)
    assert got.evaluations >= expected.evaluations


def test_a_stop_is_met_at_the_same_time(free):
    ends = {"lower": np.array([-0.1, -3.0]), "upper": np.array([3.0, 3.0])}
    robots = [rne.Robot(replace(robot.model, **ends), robot.engine) for robot in free]
    expected, got = (
        rne.simulate(rne.Scene(r, stops=True), [0.5, 0.2], [0, 0], 3.0, method="DOP853", rtol=1e-10) for r in robots
    )
    assert expected.status == got.status == 1
    assert got.t[-1] == pytest.approx(expected.t[-1], abs=1e-8)
    np.testing.assert_allclose(got.q[-1], expected.q[-1], atol=1e-8)


@pytest.mark.parametrize("static", kept([None, 0.7], [0.7]))
def test_joints_that_stick_and_slip(free, static, monkeypatch):
    """As many changes, at the same times; no step is left to SciPy's solver, but for the first lengths of steps."""
    law = rne.traceable(lambda t, q, qd: np.array([3.0, 1.0]) * np.sin(6 * t) - q)
    friction = rne.Friction(viscous=0.1, coulomb=0.5, static=static, smoothing=0)
    scenes = [rne.Scene(r, friction=friction, effort_limit=[2.0, 0.8], controller=law) for r in free]
    run = ([0.3, 0.2], [0.0, 1.0], 1.5)
    how = {"method": "DOP853", "t_eval": np.linspace(0, 1.5, 40), "atol": 1e-11}
    expected = rne.simulate(scenes[0], *run, **how, rtol=1e-10)
    monkeypatch.setattr(
        "rne.integrators.scipy_methods.SciPySolver.steps", lambda self, max_steps: pytest.fail("a step by SciPy")
    )
    got = rne.simulate(scenes[1], *run, **how, rtol=1e-8)
    assert got.message.replace("; in machine code", "") == expected.message
    assert "changes" in got.message
    assert got.evaluations <= 1.5 * expected.evaluations  # 1.1; few steps are thrown away behind a change
    assert (got.qd == 0).sum() > 10
    np.testing.assert_allclose(got.q, expected.q, atol=1e-7)
    np.testing.assert_allclose(got.qd, expected.qd, atol=1e-6)
    assert got.energy_drift <= 1e-6


@pytest.mark.parametrize("method", kept(["RK45", "DOP853"], ["RK45"]))
def test_samples_while_joints_stick_and_slip(free, method, monkeypatch):
    """Steps under the torques of many samples, thrown away behind the first at which or after which a mode changes."""
    called, renew = [], ZeroOrderHold.renew
    monkeypatch.setattr(ZeroOrderHold, "renew", lambda hold, t, x: called.append(t) or renew(hold, t, x))
    motions = []
    for robot in free:
        if robot.model.name == "interpreted":
            monkeypatch.setattr(rne.Scene, "traced_samples", property(rne.Scene.traced_law))
        law = rne.control.pid(robot, [30.0, 10.0], [30.0, 10.0], [4.0, 1.0], [0.4, -0.1], windup=2.0)
        friction = rne.Friction(viscous=0.2, coulomb=[1.0, 0.2], static=[1.5, 0.25], smoothing=0)
        limits = {"effort_limit": [9.0, 3.0], "torque_rate": [200.0, 100.0]}
        scene = rne.Scene(robot, controller=law, sample_time=0.01, friction=friction, gravity=[0, 0, -3.0], **limits)
        ways = [{}, {"t_eval": np.linspace(0, 0.4, 31)}]
        motions.append([rne.simulate(scene, [0.3, 0.2], [0, 0], 0.4, method=method, **way) for way in ways])
        called.append(np.inf)
    own, by_loop = np.split(np.array(called)[:-1], [called.index(np.inf)])
    assert len(own) == 80
    assert len(by_loop) - 1 < 40
    for expected, got in zip(*motions, strict=True):
        assert got.message.replace("; in machine code", "") == expected.message
        assert len(got.jumps) == len(expected.jumps)
        for name in ("t", "q", "qd", "qdd", "tau", "work", "controller_state", "jumps", "qdd_before", "tau_before"):
            one, other = (np.asarray(getattr(motion, name)) for motion in (got, expected))
            tolerance = 2e-6 * np.abs(other).max(initial=0.0)  # twice that of the runs, at instants of events too
            np.testing.assert_allclose(one, other, rtol=1e-6, atol=tolerance, err_msg=name)


def test_evaluations_are_counted_from_the_last_sample(free, monkeypatch):
    """However many samples one call of machine code takes; too many within one are a loop that diverges."""
    if free[1].model.name == "interpreted":
        monkeypatch.setattr(rne.Scene, "traced_samples", property(rne.Scene.traced_law))
    scene = rne.Scene(free[1], controller=rne.control.pd(free[1], 5.0, 1.0, [0.1] * 2), sample_time=0.01)
    monkeypatch.setattr(run, "MAX_EVALUATIONS", 60)
    assert rne.simulate(scene, [0.3, 0.2], [0, 0], 0.1, method="DOP853").status == 0
    monkeypatch.setattr(run, "MAX_EVALUATIONS", 10)
    with pytest.raises(rne.SimulationError, match="more than 10 evaluations within one sample"):
        rne.simulate(scene, [0.3, 0.2], [0, 0], 0.1, method="DOP853")


def test_samples_of_three_joints_that_cannot_stick(monkeypatch):
    """There are no modes behind the torques."""
    make, model = interpreted(monkeypatch), straight_chain(3)
    monkeypatch.setattr(rne.Scene, "traced_samples", property(rne.Scene.traced_law))
    ends = []
    for robot in (rne.Robot(model), make(model)):
        scene = rne.Scene(robot, controller=rne.control.pd(robot, 5.0, 1.0, [0.1] * 3), sample_time=0.01)
        ends.append(rne.simulate(scene, [0.3, 0.2, 0.1], [0] * 3, 0.05, rtol=1e-9).q[-1])
    np.testing.assert_allclose(*ends, rtol=1e-8)


def test_many_short_steps_in_machine_code_are_worth_few_of_lsoda_where_joints_stick(free):
    for robot, viscous, method in ((free[0], 1.0, "LSODA"), (free[1], 1.0, "DOP853"), (free[1], 100.0, "LSODA")):
        friction = rne.Friction(viscous=10.0 * viscous, coulomb=0.5, smoothing=0)
        motion = rne.simulate(rne.Scene(robot, friction=friction), [0.5, 0.2], [0, 0], 1.0)
        assert motion.message.startswith(f"{method}: ")


def test_a_torque_that_becomes_nan_is_named_with_its_time(free):
    law = rne.traceable(lambda t, q, qd: np.sqrt(0.5 - t) - q)
    for robot in free:
        with (
            np.errstate(invalid="ignore"),
            pytest.raises(rne.SimulationError, match=r"torque of 'joint0' is nan at t = 0\.5") as caught,
        ):
            rne.simulate(rne.Scene(robot, controller=law), [0.1, 0.1], [0, 0], 1.0, method="DOP853")
        assert 0.3 < caught.value.trajectory.t[-1] <= 0.5


@pytest.mark.long
def test_sampled_torques_and_breaks_are_stepped_onto(free):
    laws = [rne.control.pd(r, [5.0] * 2, [0.3] * 2, [0.3] * 2) for r in free]
    sampled = [rne.Scene(law.robot, controller=law, sample_time=0.01) for law in laws]
    check(sampled, ([0.1, 0.1], [0, 0]), 0.5, rtol=1e-8)
    ramps = rne.trajectories.trapezoidal([0, 0], [1.0, -1.0], 1.0, 0.25)
    following = [rne.Scene(r, controller=rne.control.computed_torque(r, 100, 20, ramps)) for r in free]
    check(following, ([0.1, 0], [0, 0]), 1.2, method="DOP853")


@pytest.mark.long
def test_a_motion_that_becomes_stiff_goes_on_with_an_implicit_method(free):
    scenes = [rne.Scene(r, friction=rne.Friction(coulomb=2.0)) for r in free]
    expected, got = (rne.simulate(s, [0, 0], [1, 1], 2.0) for s in scenes)
    assert (expected.method, got.method) == ("LSODA", "Rodas5P")
    assert "Rodas5P from t = " in got.message
    np.testing.assert_allclose(got.q[-1], expected.q[-1], atol=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("rtol", [1e-5, 1e-8, 1e-11])
@pytest.mark.parametrize("name", ["irb140", "ur5"])
def test_swings_of_arms(name, rtol):
    pair = [rne.load(name), rne.load(name, engine="numba")]
    check(pair, ([0.1] * 6, [0] * 6), 2.0, method="DOP853", rtol=rtol, atol=rtol / 1e3)


LAWS = {
    "sampled": {"controller": lambda t, q, qd: np.array([3.0, 1.0]) * np.sin(40 * t) - qd, "sample_time": 0.02},
    "of time": {"controller": rne.traceable(lambda t, q, qd: 3 * np.sin(40 * t) - qd)},
}


@pytest.mark.parametrize("law", LAWS)
def test_stages_of_interpolants_that_must_be_examined_are_left_to_the_recursion(monkeypatch, law):
    """Under the torques held when the step was taken: the ledger asks for them when others are held."""
    make, model = interpreted(monkeypatch), straight_chain(2)
    monkeypatch.setattr(Plant, "is_compiled", property(lambda plant: plant.law is None))

    def run():
        scene = rne.Scene(make(model), friction=rne.Friction(viscous=0.3), **LAWS[law])
        return rne.simulate(scene, [0.5, 0.2], [0, 0], 0.3, method="DOP853", t_eval=[0.0, 0.3], rtol=1e-9)

    expected = run()
    monkeypatch.setattr(compiled_methods, "add_stages", lambda *_: False)
    got = run()
    np.testing.assert_allclose(got.dissipated["viscous"], expected.dissipated["viscous"], rtol=1e-12)
    assert got.evaluations == expected.evaluations


def test_a_step_that_is_cut_ends_exactly_at_the_end():
    """Where t + (end - t) is one rounding short of the end, no step of one rounding follows."""
    t, end = next((a, b) for a, b in np.random.default_rng(0).uniform(0, [0.1, 1.0], (10**4, 2)) if a + (b - a) < b)
    T, X, H = np.full(9, t), np.ones((9, 1)), np.full(9, 10.0)
    K, count, work = np.zeros((8, 7, 1)), np.zeros(8, dtype=np.int64), np.zeros(1)
    interval = step_control.Interval(tableaus.tableau("RK45"), t, end, -np.inf, np.inf, 1e-6, 1e-9, 1)
    arguments = np.zeros(1), np.zeros(1)

    def at_rest(t, x, rates):
        rates[:] = 0.0
        return True

    problem, steps = step_control.Problem(at_rest, arguments, interval), step_control.Storage(T, X, K, H, count, work)
    assert runge_kutta.take_steps(problem, end, runge_kutta.CONTINUE, steps) == 1
    assert T[1] == end


def test_no_rate_is_asked_for_after_the_end_of_a_motion_that_starts_late():
    """Where it changes so slowly that the first step would be ten times as long."""
    t, end, asked = 0.5, 1.0, []
    interval = step_control.Interval(tableaus.tableau("RK45"), t, end, -np.inf, np.inf, 1e-6, 1e-9, 1)
    arguments = np.array([t]), np.ones(1)

    def slow(time, x, rates):
        asked.append(float(time[0]))
        rates[:] = 1e-3
        return True

    problem = step_control.Problem(slow, arguments, interval)
    assert step_control.first_length(problem, t, np.ones(1), np.full((7, 1), 1e-3)) < end - t
    assert asked == pytest.approx([end])


def test_the_motion_between_samples_is_that_of_the_solvers_steps(free):
    """One sample of 0.25 s takes several steps: motion(t), limits and the torques held know them."""
    q0, rates, law = np.array([0.5, 0.2]), [1.0, -2.0], rne.traceable(lambda t, q, qd: 2 * np.sin(5 * t) - q)
    t = np.linspace(0, 0.75, 301)
    for robot in free:
        scene = rne.Scene(robot, controller=law, sample_time=0.25)
        exact = rne.simulate(scene, q0, rates, 0.75, t_eval=t, rtol=1e-12, atol=1e-14, method="DOP853")
        motion = rne.simulate(scene, q0, rates, 0.75, rtol=1e-8)
        np.testing.assert_allclose(motion(t)[0], exact.q, atol=1e-5)
        np.testing.assert_allclose(motion.torques(t), exact.tau, atol=1e-5)
        np.testing.assert_array_equal(motion.jumps, [0.25, 0.5])
        assert motion.t[[0, -1]].tolist() == [0.0, 0.75]
        fastest = np.abs(exact.qd).max(axis=0)
        model = replace(robot.model, velocity_limit=0.99 * fastest)
        assert len([v for v in replace(motion, model=model).check_limits() if v.quantity == "velocity"]) == 2
