"""Motion: energy, work, stiffness, failures."""

import pickle
import re
from types import SimpleNamespace

import numpy as np
import pytest

import rne
from rne.control import pd_gravity
from rne.integrators import base
from rne.integrators.scipy_methods import SciPySolver
from rne.simulation.plant import Plant
from rne.simulation.run import RunResult

from .helpers import Part, assemble, kept
from .random_robots import random_tree, straight_chain

METHODS = ["RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA"]


@pytest.fixture
def pendulum():
    return rne.Robot(straight_chain(1, length=1.0))


@pytest.fixture
def double():
    return rne.Robot(straight_chain(2))


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_every_step_is_reported_however_many_are_taken_at_once(count):
    T = np.arange(6.0)
    system = SimpleNamespace(modes=None, reported=lambda x: x)
    record, steps = RunResult(system, SimpleNamespace(t_eval=None)), base.Steps(T, T[:, None])
    record.begin(0.0, T[:1])
    record.take(steps, count, T[count], T[count, None])
    record.begin(T[count], np.array([7.0]))  # the next segment, after a jump of the state
    t, x, _ = record.reported
    assert t.tolist() == T[: count + 1].tolist()
    assert x[:, 0].tolist() == [*T[:count], 7.0]


def test_a_law_that_fails_at_the_first_sample_is_named_with_its_time(double):
    scene = rne.Scene(double, controller=lambda t, q, qd: np.full(2, np.nan), sample_time=0.01)
    with pytest.raises(rne.SimulationError, match=r"^simulation stopped at t = 0 s of 1 s: torque of .* is nan"):
        rne.simulate(scene, [0, 0], [0, 0], 1.0)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_swings_the_pendulum_with_its_exact_period(pendulum, method):
    """A rod of 1 m from 1 rad: T = 4 K(sin(1/2)) / w, w^2 = 3 g / 2 l."""
    from scipy.special import ellipk

    period = 4 * ellipk(np.sin(0.5) ** 2) / np.sqrt(1.5 * 9.81)
    motion = rne.simulate(pendulum, [1.0], [0.0], period, method=method, rtol=1e-8, atol=1e-10)
    assert motion.method == method
    assert motion.t[-1] == period
    assert motion.q[-1, 0] == pytest.approx(1.0, abs=1e-5)
    assert motion.energy_drift <= 1e-4


AT_ONCE = {
    "free swing": {},
    "work and losses": {
        "controller": rne.traceable(lambda t, q, qd: 3 * np.sin(6 * t) - q),
        "friction": rne.Friction(viscous=1.0),
    },
    "held torques": {"controller": lambda t, q, qd: -q - 0.1 * qd, "sample_time": 0.05},
    "a failure": {"controller": rne.traceable(lambda t, q, qd: np.sqrt(0.7 - t) - q)},
}


@pytest.mark.parametrize("parts", AT_ONCE)
@pytest.mark.parametrize("method", kept(METHODS, ["LSODA"]))
@pytest.mark.parametrize("t_eval", [None, np.linspace(0, 0.6, 7)], ids=["steps", "t_eval"])
def test_steps_of_scipy_taken_at_once_are_those_taken_one_by_one(double, parts, method, t_eval, monkeypatch):
    """To the last bit, with fewer calls where nothing is asked between them; a failure keeps the steps before it."""
    scene = rne.Scene(double, **AT_ONCE[parts])
    calls, steps = [], SciPySolver.steps

    def run():
        calls.clear()
        try:
            with np.errstate(invalid="ignore"):  # of the square root
                return rne.simulate(scene, [0.1, 0.5], [0, 0], 1.0, method=method, t_eval=t_eval)
        except rne.SimulationError as error:
            return error.trajectory

    def counted(self, most):
        calls.append(most)
        return steps(self, most)

    def alone(self, most):
        self.keeps = None
        return counted(self, most)

    found = []
    for taken in (counted, alone):
        monkeypatch.setattr(SciPySolver, "steps", taken)
        found.append((run(), len(calls)))
    (one, few), (other, many) = found
    for name in ("t", "q", "qd", "qdd", "tau", "work", "energy"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert (one.evaluations, one.message, one.status) == (other.evaluations, other.message, other.status)
    assert (one.status, len(one.t) > 5) == (-1 if parts == "a failure" else 0, True)
    if parts == "free swing" and t_eval is None:
        assert few < many / 8  # as many as the watch lets pass


def test_tighter_tolerance_means_less_drift(double):
    drifts = [
        rne.simulate(double, [2.0, 0.0], [0.0, 0.0], 2.0, rtol=r, atol=r * 1e-3).energy_drift for r in (1e-5, 1e-9)
    ]
    assert drifts[1] < drifts[0] / 100


def energy_within_tolerance(robot, motion, tolerance):
    """Largest change of the energy if every step is as wrong as the tolerances rtol = atol = `tolerance` allow [J].

    The solvers keep the root mean square of the local error over the scale atol + rtol |x| below 1, so that
    |dE/dx . error| <= sqrt(2 n) |dE/dx * scale| in each step. Energy is constant: it passes errors on unamplified.
    """
    x = np.concatenate([motion.q, motion.qd], axis=1)
    slope = robot.kernel(rne.dynamics.kinetic_energy, "q", "qd")(motion.q[1:], motion.qd[1:])
    slope[:, : robot.n] += robot.gravity_torque(motion.q[1:])
    scale = tolerance * (1 + np.maximum(np.abs(x[1:]), np.abs(x[:-1])))
    return np.sqrt(2 * robot.n) * np.linalg.norm(slope * scale, axis=1).sum()


def check_free_swing(robot, duration, method):
    """The thesis's 6.4-1: energy is kept within the tolerances, and in proportion to them.

    A method of order p that controls its error per step has a global error of tolerance^(p / (p + 1)): at a
    thousandth of the tolerance at most a hundredth for p >= 2. A wrong equation of motion would show no less of itself.
    """
    swings = [
        rne.simulate(robot, np.zeros(6), np.zeros(6), duration, rtol=x, atol=x, method=method) for x in (1e-6, 1e-9)
    ]
    for tolerance, swing in zip((1e-6, 1e-9), swings, strict=True):
        assert swing.energy[0] == pytest.approx(370.87686, abs=1e-10)
        assert swing.energy_drift <= energy_within_tolerance(robot, swing, tolerance)
        assert not swing.work.any()
    assert swings[1].energy_drift <= swings[0].energy_drift / 1000 ** (2 / 3)
    return swings[1]


@pytest.mark.parametrize("method", kept(["auto", *METHODS], ["auto", "LSODA", "BDF"]))
def test_free_swing_keeps_the_energy_in_proportion_to_the_tolerance(irb140, method):
    swing = check_free_swing(irb140, 1.0, method)
    assert swing.method == ("DOP853" if method == "auto" else method)


@pytest.mark.long
@pytest.mark.parametrize("method", METHODS)
def test_ten_seconds_of_free_swing_by_any_method(irb140, method):
    check_free_swing(irb140, 10.0, method)


@pytest.mark.parametrize("method", ["DOP853", "LSODA", "BDF"])
def test_work_of_the_drives_is_the_gain_in_energy(double, method):
    def push(t, q, qd):
        return [np.sin(t), 0.3 - 0.1 * qd[1]]

    motion = rne.simulate(double, [0.1, 0.2], [0.0, 0.0], 2.0, torque=push, method=method, rtol=1e-9, atol=1e-11)
    assert np.abs(motion.work).max() > 0.1
    assert motion.energy_drift <= 2e-6
    np.testing.assert_allclose(motion.energy - motion.energy[0], motion.work, atol=2e-6)


def test_record_is_consistent(double):
    motion = rne.simulate(double, [0.5, 0.1], [0.0, 0.0], 0.5, torque=[0.1, -0.2])
    T = len(motion.t)
    assert motion.q.shape == motion.qd.shape == motion.qdd.shape == motion.tau.shape == (T, 2)
    assert motion.kinetic.shape == motion.potential.shape == motion.energy.shape == motion.work.shape == (T,)
    np.testing.assert_array_equal(motion.tau, np.tile([0.1, -0.2], (T, 1)))
    np.testing.assert_allclose(double.inverse_dynamics(motion.q, motion.qd, motion.qdd), motion.tau, atol=1e-12)
    np.testing.assert_array_equal(motion.energy, motion.kinetic + motion.potential)
    assert (motion.status, motion.t[0], motion.t[-1]) == (0, 0.0, 0.5)


@pytest.mark.parametrize("method", ["auto", "LSODA", "Radau"])
def test_t_eval_is_the_grid_exactly(double, method):
    grid = np.array([0.0, 0.1, 0.30000000000000004, 0.7])
    assert np.array_equal(rne.simulate(double, [1, 0], [0, 0], 1.0, t_eval=grid, method=method).t, grid)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("grid", [None, [0.0]])
def test_duration_zero_is_the_start(double, method, grid):
    motion = rne.simulate(double, [1, 0], [0, 0], 0.0, method=method, t_eval=grid, torque=[1.0, 2.0])
    assert motion.t.tolist() == [0.0]
    assert motion.q.tolist() == [[1, 0]]
    assert motion.tau.tolist() == [[1.0, 2.0]]


@pytest.mark.parametrize("grid", [None, [0.0]])
@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"friction": rne.Friction(1.0, 2.0)},
        {"friction": rne.Friction(1.0, 2.0, smoothing=0), "stops": True},
        {"controller": lambda t, q, qd: -q, "effort_limit": 0.5},
        {"controller": rne.traceable(lambda t, q, qd: -q), "sample_time": 0.1},
    ],
    ids=["free", "smooth", "dry", "called", "sampled"],
)
def test_an_instant_is_a_motion(double, parts, grid, tmp_path):
    """All that can be asked of a motion can be asked of one sample."""
    for robot in (double, *([rne.Robot(double.model, "numba")] if "sample_time" in parts else [])):
        scene = rne.Scene(robot, **parts)
        motion = rne.simulate(scene, [0.5, 0], [0, 0], 0.0, t_eval=grid)
        assert "0 to 0 s, 1 sample" in repr(motion)
        assert motion.energy_drift < 1e-14  # [J], a rounding of 5 J
        assert motion.check_limits() == []
        assert motion(0.0)[0].tolist() == [0.5, 0]
        assert motion.trusted_horizon() == 0.0
        for copy in (pickle.loads(pickle.dumps(motion)), rne.Trajectory.load(motion.save(tmp_path / "m.npz"))):
            np.testing.assert_array_equal(copy.tau, motion.tau)
        assert motion.to_csv(tmp_path / "m.csv").read_text().count("\n") == 2
        if not parts:
            assert rne.view(motion).html
            assert rne.plotting.plot(motion, quantities=["q", "tau", "energy", "energy error"]).axes
        motions = rne.ensemble(scene, [[0.5, 0], [1, 0]], np.zeros((2, 2)), 0.0, t_eval=grid)
        assert motions.t.tolist() == [0.0]
        np.testing.assert_array_equal(motions.q, [[[0.5, 0], [1, 0]]])
        np.testing.assert_allclose(motions.tau[:, 0], motion.tau, rtol=1e-15)
        assert repr(motions)


@pytest.mark.parametrize(("n", "duration"), [(0, 1.0), (2, 0.0)])
def test_equal_steps_where_nothing_moves(double, n, duration):
    robot = double if n else rne.Robot(random_tree(0, 1))
    motions = rne.ensemble(robot, np.zeros((3, n)), np.zeros((3, n)), duration, step=0.1)
    assert motions.q.shape == (1 if n else 2, 3, n)


@pytest.mark.parametrize("method", METHODS)
def test_a_law_that_changes_its_arguments_changes_nothing(double, method):
    def tidy(t, q, qd):
        torque = -0.1 * qd
        q[:], qd[:] = np.nan, np.nan
        return torque

    disturbed = rne.simulate(double, [1, 0], [0, 0], 0.3, torque=tidy, method=method)
    plain = rne.simulate(double, [1, 0], [0, 0], 0.3, torque=lambda t, q, qd: -0.1 * qd, method=method)
    assert np.array_equal(disturbed.q, plain.q)


def test_stiff_loop_takes_lsoda_and_says_why(irb140):
    law = pd_gravity(irb140, [50] * 6, [20] * 6, np.zeros(6))
    motion = rne.simulate(irb140, np.full(6, 0.1), np.zeros(6), 0.5, torque=law)
    assert motion.method == "LSODA"
    assert re.match(r"LSODA: stiff, the largest decay rate at the start, 1\.\d+e\+04 1/s, ", motion.message)


@pytest.mark.parametrize("method", kept(METHODS, ["DOP853", "Radau", "LSODA"]))
@pytest.mark.parametrize("torque", [None, lambda t, q, qd: -40.0 * qd], ids=["free", "called law"])
def test_evaluations_are_calls_and_one_per_component_of_the_state_for_each_jacobian(
    double, method, torque, monkeypatch
):
    counts = {"__call__": 0, "jacobian": 0}

    def counted(name):
        original = getattr(Plant, name)

        def call(self, t, x):
            counts[name] += 1
            return original(self, t, x)

        return call

    for name in counts:
        monkeypatch.setattr(Plant, name, counted(name))
    double = rne.Robot(double.model, "numpy")  # calls are not seen in machine code
    motion = rne.simulate(double, [1, 0], [0, 0], 0.5, torque=torque, method=method)
    assert (counts["jacobian"] > 0) == (method in ("Radau", "BDF") or (method == "LSODA" and torque is not None))
    assert motion.evaluations == counts["__call__"] + 4 * counts["jacobian"]


def test_evaluations_of_a_sampled_scene_are_those_under_held_torques(double, monkeypatch):
    calls, rates = [], Plant.rates

    def counted(self, t, x, u):
        calls.append(t)
        return rates(self, t, x, u)

    monkeypatch.setattr(Plant, "rates", counted)
    double = rne.Robot(double.model, "numpy")  # calls are not seen in machine code
    scene = rne.Scene(double, controller=lambda t, q, qd: -qd, sample_time=0.01)
    motion = rne.simulate(scene, [1, 0], [0, 0], 0.1, method="RK45")
    assert motion.evaluations == len(calls) >= 60  # ten samples, six stages of Tsit5 each


def test_every_call_of_a_law_is_an_evaluation_a_difference_or_a_sample(double):
    """A law is called once an evaluation, and at the samples to report; 100 more for the choice of the method."""
    calls = []

    def damp(t, q, qd):
        calls.append(t)
        return -0.5 * qd

    for method in ("LSODA", "DOP853", "auto"):
        calls.clear()
        motion = rne.simulate(double, [1, 0], [0, 0], 0.5, torque=damp, method=method)
        assert motion.evaluations <= len(calls) <= motion.evaluations + len(motion.t) + 100


def test_hard_damping_and_soft_spring_settle_alike_for_every_stiff_method(double):
    def law(t, q, qd):
        return -30.0 * q - 40.0 * qd

    ends = [rne.simulate(double, [0.5, 0], [0, 0], 3.0, torque=law, method=m).q[-1] for m in ("LSODA", "Radau", "BDF")]
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-5)
    np.testing.assert_allclose(ends[2], ends[0], atol=1e-5)


class TestFailures:
    @pytest.mark.parametrize("method", METHODS)
    def test_torque_that_becomes_nan_is_named_with_its_time(self, double, method):
        def law(t, q, qd):
            return [np.nan if t > 0.2 else 0.0, 0.0]

        with pytest.raises(rne.SimulationError) as caught:
            rne.simulate(double, [1, 0], [0, 0], 1.0, torque=law, method=method)
        error = caught.value
        assert 0.2 < error.time < 1.0
        assert 0 < error.trajectory.t[-1] <= 0.2
        assert error.trajectory.tau.shape == error.trajectory.q.shape
        assert np.isfinite(error.trajectory.q).all()
        assert error.trajectory.status == -1
        assert re.match(
            r"simulation stopped at t = 0\.\d+ s of 1 s: torque of 'joint0' is nan at t = 0\.\d+ s$", str(error)
        )

    def test_an_overflow_at_a_time_of_t_eval_is_named_with_this_time(self, double):
        """Which no step takes as the time of a stage."""

        def law(t, q, qd):
            return np.array([1e308, -1e308]) * (abs(t - 0.05) < 1e-9)

        with pytest.raises(rne.SimulationError, match=r"; the result is not finite at t = 0\.05 s$") as caught:
            rne.simulate(double, [0, 0], [0, 0], 0.1, torque=law, t_eval=[0, 0.03, 0.05, 0.1])
        assert caught.value.trajectory.t.tolist() == [0, 0.03]

    @pytest.mark.parametrize("method", kept(METHODS, ["DOP853", "LSODA"]))
    def test_motion_that_runs_away_keeps_its_finite_part(self, double, method):
        def law(t, q, qd):
            return 1e3 * qd**3

        with pytest.raises(rne.SimulationError) as caught:
            rne.simulate(double, [1, 0], [1, 0], 10.0, torque=law, method=method)
        assert np.isfinite(caught.value.trajectory.qd).all()
        assert caught.value.time < 10.0

    def test_singular_mass_matrix_is_named(self):

        ghost = rne.Robot(assemble("ghost", [Part(link="b"), Part(link="a", joint="j", kind="revolute", parent=0)]))
        with pytest.raises(rne.SimulationError, match="M is singular: nothing with inertia moves with 'j'"):
            rne.simulate(ghost, [0.0], [0.0], 1.0)

    @pytest.mark.parametrize("method", METHODS)
    def test_torque_too_large_for_the_arithmetic_is_an_overflow(self, irb140, method):
        with pytest.raises(rne.SimulationError, match="overflows"):
            rne.simulate(irb140, [0] * 6, [0] * 6, 0.1, torque=[1e308] * 6, method=method)

    def test_error_pickles(self, double):
        import pickle

        with pytest.raises(rne.SimulationError) as caught:
            rne.simulate(double, [1, 0], [0, 0], 1.0, torque=lambda t, q, qd: [np.inf, 0])
        copy = pickle.loads(pickle.dumps(caught.value))
        assert (str(copy), copy.time) == (str(caught.value), caught.value.time)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"q0": [0]}, "`q0` must have shape (..., 2) for robot 'chain2', got (1,)"),
        ({"q0": [[0, 0]]}, "`q0` must have shape (2,), one state, got (1, 2)"),
        ({"qd0": [0, np.nan]}, "`qd0` must be finite, got nan at index (1,)"),
        ({"duration": -1.0}, "`duration` must not be negative, got -1.0"),
        ({"rtol": 0.0}, "`rtol` must be positive, got 0.0"),
        ({"rtol": 1e-20}, "`rtol` must be at least 2.3e-14, as rounding errors exceed less, got 1e-20"),
        ({"atol": 1e-30}, "`atol` must be at least 1e-20, as rounding errors exceed less, got 1e-30"),
        (
            {"method": "gauss-4"},
            "`method` must be 'auto' or one of ['RK45', 'RK23', 'DOP853', 'Tsit5', 'Radau', 'BDF', 'LSODA', 'Rodas5P'], "
            "got "
            "'gauss-4'",
        ),
        ({"torque": [1.0]}, "`torque` must have shape (2,), got (1,)"),
        ({"torque": lambda t, q, qd: [1.0]}, "`torque` must return shape (2,), got (1,) at t = 0 s"),
        (
            {"torque": lambda t, q, qd: [[1.0], [1.0, 2.0]]},
            "`torque` must return shape (2,), got rows of unequal length at t = 0 s",
        ),
        ({"t_eval": [0.5, 0.1]}, "`t_eval` must ascend within [0, 1], got 0.1 ... 0.5"),
        ({"t_eval": [0.0, 2.0]}, "`t_eval` must ascend within [0, 1], got 0 ... 2"),
        ({"t_eval": [[0.0]]}, "`t_eval` must have shape (T,), got (1, 1)"),
    ],
)
def test_wrong_arguments_are_named(double, changes, text):
    arguments = {"q0": [0, 0], "qd0": [0, 0], "duration": 1.0} | changes
    with pytest.raises(ValueError, match="^" + re.escape(text) + "$"):
        rne.simulate(double, **arguments)


def test_the_smallest_tolerances_take_bounded_work(irb140):
    """From rest at zero, where the absolute tolerance alone counts: some times the work at 1e-12."""
    usual, least = (
        rne.simulate(irb140, [0] * 6, [0] * 6, 0.2, rtol=rtol, atol=atol)
        for rtol, atol in ((1e-12, 1e-15), (2.3e-14, 1e-20))
    )
    assert least.evaluations < 10 * usual.evaluations
    np.testing.assert_allclose(least.q[-1], usual.q[-1], rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("law", "got"),
    [(lambda t, q: -q, "(t, q)"), (lambda: 0, "()"), (lambda t, q, qd, z: -q, "(t, q, qd, z)")],
)
def test_a_law_of_other_arguments_is_named(double, law, got):
    text = f"must be a function of (t, q, qd), got one of {got}"
    with pytest.raises(TypeError, match=f"^{re.escape(f'`torque` {text}')}$"):
        rne.simulate(double, [0, 0], [0, 0], 1.0, torque=law)
    for options in ({}, {"sample_time": 0.1}):
        with pytest.raises(TypeError, match=f"^{re.escape(f'`controller` {text}')}$"):
            rne.Scene(double, controller=law, **options)


def test_a_law_with_states_takes_them(double):
    class Integral:
        states = 2

        def __call__(self, t, q, qd):
            return -q, q

    text = "`controller` must be a function of (t, q, qd, z), as it has `states`, got one of (t, q, qd)"
    with pytest.raises(TypeError, match=f"^{re.escape(text)}$"):
        rne.Scene(double, controller=Integral())


def test_smoothed_friction_creeps_as_its_notes_say_and_dry_friction_holds(pendulum):
    """Under the torque of gravity, the smaller; what remains is the change of gravity's torque by the creep itself."""
    start, duration = [0.3], 10.0
    gravity = abs(pendulum.gravity_torque(start)[0])
    smoothed, dry = (
        rne.simulate(
            rne.Scene(pendulum, friction=rne.Friction(coulomb=5 * gravity, **smoothing)), start, [0.0], duration
        )
        for smoothing in ({}, {"smoothing": 0})
    )
    crept = abs(smoothed.q[-1, 0] - start[0])
    name = pendulum.joint_names[0]
    assert smoothed.message.startswith(
        f"crept where dry friction (smoothing=0) would hold: {name} by {crept:.2g} rad; "
    )
    assert "crept" not in dry.message
    assert crept == pytest.approx(0.01 * np.arctanh(0.2) * duration, rel=0.1)
    assert dry.q[-1, 0] == start[0]


def crept(motion):
    """Names of the joints that crept, and by how much, as the message says."""
    return {name: float(by) for name, by in re.findall(r"(\S+) by (\S+) (?:rad|m)\b", motion.message.split(";")[0])}


@pytest.fixture(scope="module")
def slider():
    """A mass of 1 kg on a level rail."""
    cart = Part(link="cart", joint="rail", kind="prismatic", parent=0, axis=np.array([1.0, 0, 0]), mass=1.0)
    return rne.Robot(assemble("slider", [Part(link="base"), cart]))


class TestCreep:
    def test_a_fall_that_creep_began_is_told_whole(self, pendulum):
        """The load is just below the friction at first and exceeds it after some creep."""
        load = abs(pendulum.gravity_torque([2.8])[0])
        scene = rne.Scene(pendulum, friction=rne.Friction(viscous=0.1, coulomb=1.01 * load))
        motion = rne.simulate(scene, [2.8], [0.0], 10.0)
        assert crept(motion) == {pendulum.joint_names[0]: pytest.approx(np.abs(motion.q - 2.8).max(), rel=0.05)}
        assert crept(motion)[pendulum.joint_names[0]] > 1.0

    def test_a_fall_that_friction_does_not_hold_is_none(self, pendulum):
        load = abs(pendulum.gravity_torque([0.3])[0])
        scene = rne.Scene(pendulum, friction=rne.Friction(viscous=0.1, coulomb=0.9 * load))
        assert crept(rne.simulate(scene, [0.3], [0.0], 0.5)) == {}

    def test_a_creeping_end_of_a_controlled_motion_is_told(self, slider):
        """A weak drive comes within reach of its friction: dry friction stops there, smoothed friction creeps on."""
        law = rne.control.pd_gravity(slider, 20.0, 40.0, [1.0])
        motion, dry = (
            rne.simulate(rne.Scene(slider, controller=law, friction=rne.Friction(coulomb=4.0, **dry)), [0], [0], 60.0)
            for dry in ({}, {"smoothing": 0})
        )
        beyond = motion.q[-1, 0] - dry.q[-1, 0]  # a part of it before the speed is within the band of smoothing
        assert crept(motion) == {slider.joint_names[0]: pytest.approx(beyond, rel=0.2)}
        assert crept(dry) == {}

    def test_a_reversal_is_no_creep(self, slider):
        """A fast motion passes the band of smoothing at once."""
        law = rne.traceable(lambda t, q, qd: -100.0 * q)
        scene = rne.Scene(slider, controller=law, friction=rne.Friction(coulomb=0.5))
        assert crept(rne.simulate(scene, [1.0], [0.0], 2.0)) == {}

    def test_of_a_law_that_fails_the_cause_is_told(self, slider):
        def law(t, q, qd):
            return 0 * q if t < 5 else np.nan * q

        scene = rne.Scene(slider, controller=law, friction=rne.Friction(coulomb=1.0))
        with pytest.raises(rne.SimulationError) as caught:
            rne.simulate(scene, [1.0], [0.0], 10.0)
        assert caught.value.trajectory.message.startswith("torque of ")


@pytest.mark.parametrize("method", ["LSODA", "RK45"])
def test_a_position_beyond_the_largest_double_ends_a_run(slider, method):
    """At 1e140 m/s after 1.8e168 s; LSODA looks beyond a step, and RK45 arrives."""
    text = r"^simulation stopped at t = \S+ s of 9e\+168 s: state is not finite at t = \S+ s$"
    with pytest.raises(rne.SimulationError, match=text), np.errstate(all="ignore"):  # of SciPy's steps
        rne.simulate(slider, [0.0], [1e140], 9e168, method=method)


def test_energies_that_overflow_are_named_when_they_are_asked_for(slider):
    motion = rne.simulate(slider, [0.0], [1e155], 1e-3, atol=1e150)
    text = r"^kinetic_energy overflows float64 for these arguments; the result is not finite at state \(0,\)$"
    with pytest.raises(rne.NotFiniteError, match=text):
        _ = motion.kinetic


class Odd:
    """A law with an attribute that is none, and one state where it has `states`."""

    def __init__(self, returned=None, **attributes):
        self.returned = returned
        self.__dict__.update(attributes)

    def __call__(self, t, q, qd, *z):
        return (0 * q, self.returned) if z else 0 * q


NO_RATES = "rates of the controller's states"


@pytest.mark.parametrize(
    ("parts", "options", "text"),
    [
        ({}, {"progress": 3}, "`progress` must be a function of (t, duration), got int"),
        ({}, {"progress": lambda t: None}, "`progress` must be a function of (t, duration), got one of (t)"),
        ({"controller": Odd}, {}, "`controller` must be a function of (t, q, qd), got the class Odd"),
        ({}, {"torque": int}, "`torque` must be a function of (t, q, qd), got the class int"),
        ({"controller": Odd(breaks=0.5)}, {}, "`controller.breaks` must have shape (k,), got ()"),
        (
            {"controller": Odd(breaks=None)},
            {},
            "`controller.breaks` must be an array of numbers of shape (k,), got dtype object",
        ),
        ({"controller": Odd(states="2")}, {}, "`controller.states` must be a whole number of at least 0, got '2'"),
        ({"controller": Odd(states=-2)}, {}, "`controller.states` must be a whole number of at least 0, got -2"),
        (
            {"controller": Odd(None, states=1)},
            {},
            "`controller` with states must return (torques, rates of its states), got (torques, None)",
        ),
        ({"controller": Odd([1, 2], states=1)}, {}, f"`{NO_RATES}` must have shape (1,), got (2,)"),
        (
            {"controller": Odd("x", states=1)},
            {},
            f"`{NO_RATES}` must be an array of numbers of shape (1,), got dtype <U1",
        ),
        ({"stops": "no"}, {}, "`stops` must be True or False, got str"),
        (
            {"payload": (1, 2, 3, 4, 5, 6)},
            {},
            "`payload` must be a mass or rne.Payload(mass, com, inertia, link), got 6 values",
        ),
        (
            {"payload": {"mass": 2.0}},
            {},
            "`payload` must be a mass or rne.Payload(mass, com, inertia, link), got dict",
        ),
    ],
)
def test_odd_arguments_are_named(double, parts, options, text):
    """Of laws that are called and sampled; a class in place of its object, a text in place of a number."""
    for sampled in ({}, {"sample_time": 0.1}) if "controller" in parts else ({},):
        with pytest.raises((TypeError, ValueError), match=f"^{re.escape(text)}$"):
            rne.simulate(rne.Scene(double, **parts, **sampled), [0, 0], [0, 0], 0.3, **options)


def test_other_odd_arguments_are_named(double, irb140):
    cases = [
        (
            lambda: rne.ensemble(double, [[0, 0]], [[0, 0]], 0.1, progress="bar"),
            "`progress` must be a function of (done, total), got str",
        ),
        (lambda: rne.Trajectory.load(3), "`path` must be a str or path-like, got int"),
        (lambda: rne.Friction(None), "`viscous` must be an array of numbers of shape (n,), got dtype object"),
        (lambda: rne.Friction([[1, 2]]), "friction must be numbers or arrays of one shape (n,), got [(1, 2)]"),
        (lambda: rne.traceable(3), "`law` must be a function, got int"),
        (
            lambda: rne.control.computed_torque(double, 1, 1, lambda: 0),
            "`reference` must be a function of (t), got one of ()",
        ),
        (lambda: rne.check_gains(double, 1, 1, bounds=3), "`bounds` must be a result of robot.bounds(), got int"),
        (
            lambda: rne.Scene(irb140, friction=rne.Friction(1)).forward_dynamics([0] * 6, [0] * 6, [1, 2]),
            "`tau` must have shape (..., 6) for robot 'irb140', got (2,)",
        ),
    ]
    for call, text in cases:
        with pytest.raises((TypeError, ValueError), match=f"^{re.escape(text)}$"):
            call()


def test_a_model_is_not_a_robot():
    with pytest.raises(TypeError, match=r"^`scene_or_robot` must be an rne.Scene or rne.Robot, got Model$"):
        rne.simulate(random_tree(1, 1), [0], [0], 1.0)
