"""Torques that are held, of sampled laws and given ones, in many motions side by side: as in each by itself."""

import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import rne
from rne.integrators import lanes
from rne.kernels import Kernel
from rne.simulation import zero_order_hold

from .helpers import address_by_numpy, kept, states
from .random_robots import straight_chain
from .test_compiled_motions import interpreted
from .test_ensemble import check_interrupt

T, END = 0.01, 0.035  # sample time and duration [s]
TIMES = [0.0, 0.004, 0.014, np.nextafter(2 * T, 0), 0.027, END]  # of commands that act, up to rounding of a sample
N = lanes.LANES + 3
TIGHT = {"rtol": 1e-11, "atol": 1e-13}
AGREED = 1e-8  # a thousand tolerances: energies of single motions are controlled loosely
QUANTITIES = ("q", "qd", "tau", "energies")


@pytest.fixture(params=kept(["text", "numba"], ["text"]))
def engine(request, monkeypatch):
    """Machine code, or the texts of its loops run by Python."""
    pytest.importorskip("numba", reason="Numba is not installed")
    if request.param == "numba":
        return

    interpreted(monkeypatch)  # single motions are run by SciPy's solvers
    monkeypatch.setattr(Kernel, "address", address_by_numpy)
    monkeypatch.setattr(lanes, "compiled", lambda text: text)
    is_traced = lambda scene: scene.sample_time is not None and scene.robot.engine == "numba"  # noqa: E731
    monkeypatch.setattr(rne.Scene, "traced_samples", property(lambda scene: scene._law if is_traced(scene) else None))


def scene_of(delay, engine="numba", **parts):
    """Two links under a law with states, all bounds within reach."""
    robot = rne.Robot(straight_chain(2), engine)
    law = rne.control.pid(robot, [20.0, 5.0], [20.0, 10.0], [1.0, 0.2], [0.4, -0.1], windup=2.0)
    parts = {"friction": rne.Friction(viscous=0.2), "effort_limit": [9.0, 2.0], "torque_rate": [60.0, 25.0]} | parts
    return rne.Scene(robot, controller=law, sample_time=T, delay=delay, **parts)


def many(count=N):
    """Starts, and numbers of their own."""
    rng, (q, qd, _) = np.random.default_rng(count), states(2, count, rate=1.0)
    own = {"controller.kp": (10, 30), "controller.ki": (5, 20), "friction.viscous": (0.1, 0.5)}
    own |= {"effort_limit": (2, 10), "torque_rate": (20, 60)}
    return q, qd, {name: rng.uniform(*ends, (count, 2)) for name, ends in own.items()}


def rows_of(numbers, k):
    return {name: array[k] for name, array in numbers.items()}


def worst(runs, k, one):
    """Largest difference of a motion from one by itself."""
    found = [np.abs(getattr(runs, name)[:, k] - getattr(one, name)).max() for name in QUANTITIES[:3]]
    energies = {"drives": one.work, **one.dissipated}
    return max(*found, *(np.abs(runs.energies[:, k, j] - energies[x]).max() for j, x in enumerate(runs.ledger)))


CASES = [(delay, own) for delay in (None, 0.4 * T, 2 * T) for own in (False, True)]


@pytest.mark.parametrize(("delay", "own"), kept(CASES, [(0.4 * T, True)]))
def test_motions_are_those_by_themselves(engine, delay, own):
    (q, qd, numbers), scene = many(), scene_of(delay)
    numbers = numbers if own else {}
    runs = rne.ensemble(scene, q, qd, END, numbers=numbers, t_eval=TIMES, **TIGHT)
    assert (runs.method, runs.ledger) == ("Tsit5", ("drives", "viscous"))
    for k in (0, N - 1):
        one = rne.simulate(
            scene_of(delay, "numpy"), q[k], qd[k], END, numbers=rows_of(numbers, k), t_eval=TIMES, **TIGHT
        )
        assert worst(runs, k, one) <= AGREED


@pytest.mark.parametrize("method", kept(["rk4", "semi-implicit-euler"], ["rk4"]))
def test_equal_steps_end_where_torques_change(engine, method):
    """So that both methods keep their orders; each motion's commands come after a delay of its own."""
    (q, qd, numbers), scene = many(3), scene_of(0.4 * T)
    numbers["delay"] = np.array([0.4, 0.0, 2.7]) * T
    how, end = {"numbers": numbers, "method": method, "t_eval": [0.0, np.nextafter(T, 0), 3 * T]}, 3 * T
    runs = [rne.ensemble(scene, q, qd, end, step=step, **how) for step in (T / 3, T / 6)]
    for k in range(3):
        one = rne.simulate(
            scene_of(0.4 * T, "numpy"), q[k], qd[k], end, numbers=rows_of(numbers, k), t_eval=runs[0].t, **TIGHT
        )
        errors = [worst(run, k, one) for run in runs]
        assert np.log2(errors[0] / errors[1]) == pytest.approx({"rk4": 4}.get(method, 1), abs=0.5)
    steps = 3 * 9 + 3 + 1  # commands after 0.4 T cut one step in each sample, those after 2.7 T one in all
    assert runs[0].evaluations == {"rk4": 4}.get(method, 1) * steps


@pytest.mark.parametrize("how", kept([{}, {"method": "DOP853"}, {"step": 2e-3}], [{}]))
def test_no_motion_changes_the_bits_of_another(engine, how):
    """Not by its presence, nor by its place, nor by the chunk."""
    (q, qd, numbers), scene, order = many(), scene_of(0.4 * T), np.random.default_rng(0).permutation(N)[:4]
    numbers["delay"] = np.linspace(0, 3 * T, N)
    end, how = 2 * T, how | {"t_eval": [0.0, 0.004, 2 * T]}
    runs = rne.ensemble(scene, q, qd, end, numbers=numbers, **how)
    some = rne.ensemble(scene, q[order], qd[order], end, numbers=rows_of(numbers, order), **how)
    with ThreadPoolExecutor(2) as pool:
        shared = rne.ensemble(scene, q, qd, end, numbers=numbers, executor=pool, **how)
    for name in QUANTITIES:
        assert np.array_equal(getattr(some, name), getattr(runs, name)[:, order]), name
        assert np.array_equal(getattr(shared, name), getattr(runs, name)), name


def test_what_a_lane_cannot_run_is_run_alone(engine, monkeypatch):
    """A state that the recursion must examine, and steps that become too many between two samples."""
    (q, qd, _), how = many(3), {"t_eval": [0.0, 4e-10, 1e-9]}
    scenes = [replace(scene_of(None, e), sample_time=3e-10) for e in ("numba", "numpy")]
    calm = rne.ensemble(scenes[0], q, qd, 1e-9, **how)
    qd[1] = 3e8, -2e8
    runs, one = rne.ensemble(scenes[0], q, qd, 1e-9, **how), rne.simulate(scenes[1], q[1], qd[1], 1e-9, **how)
    np.testing.assert_allclose(runs.q[:, 1], one.q, rtol=1e-8)
    assert np.array_equal(runs.q[:, [0, 2]], calm.q[:, [0, 2]])
    assert runs.status.tolist() == [0, 0, 0]
    monkeypatch.setattr(zero_order_hold, "MAX_STEPS", -1)
    scene, how = scene_of(0.4 * T), {"t_eval": [0.0, 0.014, 2 * T], "rtol": 1e-9}
    alone = rne.simulate(scene, q[0], qd[0], 2 * T, **how)
    assert np.array_equal(rne.ensemble(scene, q[:1], qd[:1], 2 * T, **how).q[:, 0], alone.q)


@pytest.mark.long
def test_ctrl_c_leaves_what_was_finished(engine, monkeypatch):
    monkeypatch.setattr(lanes, "OPERATIONS", 1)
    check_interrupt(scene_of(0.4 * T), many(40)[:2])


@pytest.mark.filterwarnings("ignore:overflow")
def test_a_law_that_is_not_finite_is_named(engine):
    """With the motion and the time, as that one alone does."""
    robot = rne.Robot(straight_chain(2), "numba")
    law = rne.traceable(lambda t, q, qd: -1e300 * q * (1e300 * q))
    scene = rne.Scene(robot, controller=law, sample_time=T, effort_limit=5.0)
    with pytest.raises(rne.SimulationError, match=r"^start 1: simulation stopped at t = 0 s of 0.02 s: torque of"):
        rne.ensemble(scene, [[0.0, 0.0], [0.3, 0.0]], np.zeros((2, 2)), 2 * T)


@pytest.mark.parametrize("step", [None, 1e-3])
def test_given_torques_are_held(engine, step):
    """From one sample to the next, within the limits; as in a single motion whose torques have breaks."""
    (q, qd, _), K = many(3), 4
    torque, times = np.random.default_rng(1).uniform(-8, 8, (3, K, 2)), [0.0, 0.004, 0.01, 0.037, 0.04]
    slow, scene = (rne.Scene(rne.Robot(straight_chain(2), e), effort_limit=[6.0, 3.0]) for e in ("numpy", "numba"))
    how, agreed = ({"step": step}, 1e-6) if step else (TIGHT, AGREED)  # of order 4, in steps of a millisecond
    runs = rne.ensemble(scene, q, qd, K * T, torque=torque, sample_time=T, t_eval=times, **how)
    constant = rne.ensemble(scene, q, qd, T, torque=torque[:, 0], **how)
    law = lambda t, q, qd: torque[2, min(int(t / T + 1e-9), K - 1)]  # noqa: E731
    one = rne.simulate(slow, q[2], qd[2], K * T, torque=law, breaks=T * np.arange(1, K), t_eval=times, **TIGHT)
    assert worst(runs, 2, one) <= agreed
    assert np.abs(constant.q[-1, 2] - one.q[2]).max() <= agreed
    assert np.array_equal(runs.tau[:4, 0], np.clip(torque[0, [0, 0, 1, 3]], [-6, -3], [6, 3]))
    assert runs.ledger == ("drives",)


def test_given_torques_one_by_one():
    """In NumPy and at stops, as in machine code."""
    (q, qd, _), scene = many(2), rne.Scene(rne.Robot(straight_chain(2)), effort_limit=[6.0, 3.0])
    torque = np.random.default_rng(1).uniform(-8, 8, (2, 2, 2))
    runs = rne.ensemble(scene, q, qd, 2 * T, torque=torque, sample_time=T, t_eval=[0.0, np.nextafter(T, 0), 2 * T])
    assert np.array_equal(runs.tau, np.clip(torque[:, [0, 1, 1]], [-6, -3], [6, 3]).swapaxes(0, 1))
    halves = [rne.ensemble(scene, q, qd, T, torque=torque[:, 0])]
    halves.append(rne.ensemble(scene, halves[0].q[-1], halves[0].qd[-1], T, torque=torque[:, 1]))
    np.testing.assert_allclose(runs.q[1:], [half.q[-1] for half in halves], atol=1e-6)  # of a tolerance as large
    np.testing.assert_allclose(runs.energies[-1], sum(half.energies[-1] for half in halves), atol=1e-4)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"torque": np.zeros((1, 3))}, "`torque` must have shape (1, 2), or (N, K, n) with `sample_time`, got (1, 3)"),
        ({"torque": np.zeros((1, 2)), "sample_time": 0.1}, "`torque` must have shape (1, K, 2), got (1, 2)"),
        (
            {"torque": np.zeros((1, 3, 2)), "sample_time": 0.01},
            "`torque` of 3 samples every 0.01 s lasts 0.03 s, the motion 0.1 s",
        ),
        (
            {"sample_time": 0.1},
            "`sample_time` is for `torque`, which is not given; a controller has that of its scene",
        ),
        ({"torque": np.full((1, 2), np.nan)}, "`torque` must be finite"),
        (
            {"torque": np.zeros((1, 2)), "step": 0.01},
            "`step` with torques that are held needs a robot of engine 'numba'",
        ),
    ],
)
def test_wrong_torques_are_named(changes, text):
    with pytest.raises(ValueError, match=rf"^{re.escape(text)}"):
        rne.ensemble(rne.Robot(straight_chain(2)), [[0, 0]], [[0, 0]], 0.1, **changes)


def test_torques_are_not_given_beside_a_controller():
    with pytest.raises(ValueError, match=r"^`torque` cannot be given for a scene that has a controller$"):
        rne.ensemble(scene_of(None, "numpy"), [[0, 0]], [[0, 0]], 0.1, torque=[[0.0, 0.0]])
