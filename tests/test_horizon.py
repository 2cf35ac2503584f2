"""The time up to which a motion can be trusted, against a motion that is far more accurate."""

import copy
import itertools
import pickle
from dataclasses import replace

import numpy as np
import pytest

import rne
from benchmarks.swing import extrapolated

from .helpers import kept
from .random_robots import straight_chain

Q0 = np.linspace(0.3, 0.8, 6)
END = 6.0
GRID = np.linspace(0, END, 1201)


@pytest.fixture(scope="module", params=kept([3, 6], [3]))
def arm(request, irb140):
    """The IRB 140 with some of its joints."""
    n = request.param
    return irb140.locked({f"joint_{k + 1}": Q0[k] for k in range(n, 6)})


@pytest.fixture(scope="module")
def exact(arm):
    q0 = Q0[: arm.n]
    return rne.simulate(arm, q0, 0 * q0, END, method="DOP853", rtol=1e-13, atol=1e-15, t_eval=GRID)


@pytest.mark.parametrize(("last", "expected"), [(2.9e-3, np.log(10 / 3) / np.log(29 / 3)), (4.5e-3, 0.0)])
def test_an_error_that_grows_at_once_is_trusted_until_the_instant_before(irb140, last, expected):
    """Tenfold, as an exponential would; fifteenfold, it may have grown anywhere between."""
    errors = np.array([0.0, 1.0]), np.array([3e-4, last])
    motion = replace(rne.simulate(irb140, Q0, 0 * Q0, 0.01), error_estimate=lambda: errors)
    assert motion.trusted_horizon(1e-3) == pytest.approx(expected)


def measured_horizon(motion, exact, accuracy):
    wrong = np.abs(motion.q - exact.q).max(axis=1) > accuracy
    return float(GRID[np.argmax(wrong)]) if wrong.any() else END


@pytest.mark.parametrize(
    "options",
    [
        pytest.param({"method": "RK45", "rtol": 1e-4}, marks=pytest.mark.long),
        {"method": "DOP853", "rtol": 1e-6},
        pytest.param({"method": "LSODA", "rtol": 1e-6}, marks=pytest.mark.long),
        pytest.param({"method": "RK45", "rtol": 1e-6}, marks=pytest.mark.long),
        pytest.param({"method": "DOP853", "rtol": 1e-8}, marks=pytest.mark.long),
        pytest.param({"method": "BDF", "rtol": 1e-5}, marks=pytest.mark.long),
    ],
    ids=lambda o: " ".join(str(x) for x in o.values()),
)
def test_the_horizon_is_where_the_error_passes_the_accuracy(arm, exact, options):
    """A free swing is chaotic: errors grow tenfold in half a second, and the horizon with the tolerance's logarithm."""
    motion = rne.simulate(arm, Q0[: arm.n], np.zeros(arm.n), END, t_eval=GRID, **options)
    for accuracy in (1e-4, 1e-2):
        assert motion.trusted_horizon(accuracy) == pytest.approx(measured_horizon(motion, exact, accuracy), rel=0.1)


def test_steps_of_the_solver_and_asked_for_times_give_the_same(arm):
    options = {"method": "RK45", "rtol": 1e-5}
    ways = [
        rne.simulate(arm, Q0[: arm.n], np.zeros(arm.n), 3.0, t_eval=times, **options)
        for times in (None, GRID[GRID <= 3])
    ]
    first, second = (motion.trusted_horizon() for motion in ways)
    assert first == second < 3.0


@pytest.mark.parametrize("tolerances", kept([[1e-4, 1e-6, 1e-8], [1e-4, 1e-6]], [[1e-4, 1e-6]]), ids=len)
def test_a_tighter_tolerance_reaches_farther(arm, tolerances):
    reached = [
        rne.simulate(arm, Q0[: arm.n], np.zeros(arm.n), END, method="DOP853", rtol=rtol).trusted_horizon()
        for rtol in tolerances
    ]
    assert all(one < tighter - 0.5 for one, tighter in itertools.pairwise(reached))


@pytest.mark.parametrize(("rtol", "factor"), [(1e-6, 0.01), (1e-12, 100.0)])
def test_the_other_run_has_other_tolerances(rtol, factor):
    """Tighter by 100, or looser where tighter ones are below rounding; by the method that the run ended with."""
    motion = rne.simulate(rne.Robot(straight_chain(1)), [0.1], [0.0], 0.1, rtol=rtol, atol=1e-9)
    asked, run = [], motion.run
    run.method, run.repeat = "Radau", lambda task: asked.append(task) or run
    assert motion.trusted_horizon() == 0.1
    again = asked[-1]
    assert (again.rtol, again.atol) == pytest.approx((rtol * factor, 1e-9 * factor), rel=1e-12)
    assert (again.method, again.is_auto) == ("Radau", False)


def test_a_chain_that_stands_upside_down_is_trusted_for_the_logarithm_of_rounding():
    """At an unstable equilibrium nothing moves but rounding, which grows at the fastest rate of the chain."""
    robot = rne.Robot(straight_chain(2))
    up = np.array([np.pi, 0.0]) if robot.potential_energy([np.pi, 0.0]) > robot.potential_energy([0.0, 0.0]) else 0.0
    q0 = np.broadcast_to(up, 2)
    rate = np.linalg.eigvals(robot.linearize(q0, [0, 0], [0, 0])[0]).real.max()
    assert rate > 1
    motion = rne.simulate(robot, q0, [0, 0], 60 / rate, method="DOP853", rtol=1e-10, atol=1e-12)
    horizon = motion.trusted_horizon(1e-3)
    assert 15 < horizon * rate < 45
    fallen = np.abs(motion.q - q0).max(axis=1) > 0.1
    assert fallen.any()
    assert horizon < motion.t[np.argmax(fallen)]


def test_between_two_steps_the_horizon_is_where_an_exponential_passes_the_accuracy(irb140):
    t = np.arange(6.0)
    motion = replace(rne.simulate(irb140, Q0, 0 * Q0, 0.01), error_estimate=lambda: (t, 1e-8 * np.exp(2 * t)))
    for accuracy in (3e-8, 1e-6, 1e-4):
        assert motion.trusted_horizon(accuracy) == pytest.approx(np.log(accuracy / 1e-8) / 2, rel=1e-12)
    assert motion.trusted_horizon(1e-9) == 0.0
    assert motion.trusted_horizon(1.0) == 5.0


def test_a_stable_loop_is_trusted_to_the_end(irb140):
    law = rne.control.pd_gravity(irb140, [50] * 5 + [60], [20] * 5 + [22], Q0)
    motion = rne.simulate(rne.Scene(irb140, controller=law), 0 * Q0, 0 * Q0, 1.0)
    assert motion.trusted_horizon() == 1.0


@pytest.mark.long
@pytest.mark.parametrize("end", [1.5, 2.0])
def test_called_laws_and_breaks_are_followed(irb140, end):
    """A pulse, through a law that is called: the horizon is that of the same pulse traced or not."""

    def pulse(t, q, qd):
        return 5.0 * (0.1 <= t < 0.2) * np.ones(6)

    t = np.linspace(0, end, round(200 * end) + 1)
    motion = rne.simulate(irb140, Q0, 0 * Q0, end, torque=pulse, breaks=[0.1, 0.2], rtol=1e-6, t_eval=t)
    finer = rne.simulate(
        irb140, Q0, 0 * Q0, end, torque=pulse, breaks=[0.1, 0.2], method="DOP853", rtol=1e-12, atol=1e-14,
        t_eval=t,
    )  # fmt: skip
    wrong = np.abs(motion.q - finer.q).max(axis=1)
    accuracy = 0.5 * float(wrong.max())
    assert motion.trusted_horizon(accuracy) == pytest.approx(t[np.argmax(wrong > accuracy)], rel=0.1)


@pytest.mark.long
@pytest.mark.parametrize("method", ["LSODA", "Radau"])
def test_a_called_stiff_law_is_trusted_to_the_end(irb140, method):
    """Steps over many time constants, where extrapolation does not converge, count with their tolerance."""

    def law(t, q, qd):
        return -1e3 * np.array([20, 20, 10, 1, 1, 0.3]) * qd

    motion = rne.simulate(irb140, Q0, 0 * Q0, 0.05, torque=law, method=method, rtol=1e-8, atol=1e-11)
    assert motion.trusted_horizon(1e-3) == 0.05


def test_a_failed_run_and_one_of_nothing_have_one(irb140):
    def law(t, q, qd):
        return np.full(6, np.nan) if t > 0.3 else np.zeros(6)

    with pytest.raises(rne.SimulationError) as caught:
        rne.simulate(irb140, Q0, 0 * Q0, 1.0, torque=law)
    motion = caught.value.trajectory
    assert motion.trusted_horizon() == motion.t[-1] > 0
    still = irb140.locked(dict.fromkeys(irb140.joint_names, 0.0))
    assert rne.simulate(still, [], [], 2.0).trusted_horizon() == 2.0
    assert copy.copy(motion).trusted_horizon() == motion.trusted_horizon()


def switching(t, q, qd):
    """A force towards q = 0 that jumps there: errors of the instants of switching add up."""
    return rne.elementwise.where(rne.elementwise.less(q, 0), 3.0, -3.0) - 0.1 * qd


@pytest.mark.parametrize("kind", kept(["traced", "called", "sampled", "dry", "clipped"], ["dry"]))
def test_where_something_switches_the_horizon_claims_no_more_than_is_true(kind):
    """Once 2.5 s at 1e-5 rad, where the error was 4.4e-5."""
    n = 1 if kind in ("traced", "called", "sampled") else 2
    robot = rne.Robot(straight_chain(n))
    parts = {
        "traced": {"controller": rne.traceable(switching)},
        "called": {"controller": lambda t, q, qd: switching(t, q, qd)},
        "sampled": {"controller": switching, "sample_time": 0.01},
        "dry": {"friction": rne.Friction(coulomb=0.5, smoothing=0)},
        "clipped": {"controller": rne.control.pd(robot, [50] * n, [1] * n, [0] * n), "effort_limit": [3.0] * n},
    }
    scene = rne.Scene(robot, **parts[kind])
    t, q0 = np.linspace(0, 1, 401), np.array([0.5, 0.3])[:n]
    motion = rne.simulate(scene, q0, 0 * q0, 1.0, t_eval=t, rtol=1e-6)
    exact = rne.simulate(scene, q0, 0 * q0, 1.0, t_eval=t, rtol=1e-9, atol=1e-11, method="DOP853")
    error = np.abs(motion.q - exact.q).max(axis=1)
    for accuracy in (1e-7, 1e-6, 1e-5, 1e-4):
        horizon = motion.trusted_horizon(accuracy)
        assert error[t < horizon].max(initial=0) <= accuracy
        if error.max() < accuracy / 3:
            assert horizon == 1.0


def test_a_pickled_trajectory_has_forgotten_its_scene(irb140):
    free = rne.simulate(irb140, Q0, 0 * Q0, 0.01)
    text = r"^this trajectory was pickled or loaded from a file, and has forgotten its scene: repeat the simulation$"
    with pytest.raises(ValueError, match=text):
        pickle.loads(pickle.dumps(free)).trusted_horizon()
    with pytest.raises(ValueError, match=r"^`accuracy` must be positive, got 0\.0$"):
        free.trusted_horizon(0)


def test_extrapolation_has_its_order():
    """x' = i x over steps h: the error falls as h^(2 levels + 1)."""
    found = []
    for h in (1.0, 0.5):
        turn = np.array([[0.0, -1.0], [1.0, 0.0]])
        end, change = extrapolated(lambda t, x, turn=turn: x @ turn, np.zeros(1), np.eye(2)[:1], np.full(1, h), 4)
        assert change.max() > np.abs(end - [[np.cos(h), -np.sin(h)]]).max()
        found.append(np.abs(end - [[np.cos(h), -np.sin(h)]]).max())
    assert np.log2(found[0] / found[1]) == pytest.approx(9, abs=0.5)
