"""Motions through samples as references: by SciPy's interpolants, and in laws that are traced, their table beside them."""

import ctypes
import importlib.util
import pickle
import re
import shutil

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, make_interp_spline

import rne
from rne.integrators import compiled_methods, lanes
from rne.kernels import Kernel
from rne.kernels import kernel as kernel_module
from rne.simulation import run
from rne.trajectories import sampled, spline

from .compiled_sources import c_library, call
from .helpers import EPS, address_by_numpy, kept, relative
from .random_robots import straight_chain
from .test_compiled_motions import interpreted

T = np.array([0.0, 0.03, 0.05, 0.1, 0.12, 0.2, 0.23, 0.3, 0.4])
Q = np.stack([0.5 * np.sin(3 * T), T - 2 * T**2], axis=-1)
OTHER = 0.4 * np.cos(2 * T)[:, None] * [1.0, -0.5]
TIMES = np.array([0.01, 0.07, 0.11, 0.19, 0.25, 0.39])  # between samples
MADE = {"spline": spline} | {kind: lambda t, q, kind=kind: sampled(t, q, kind) for kind in ("hold", "linear", "cubic")}
SUMS = 1e3 * EPS  # relative: rounding of some hundred operations, of M's inverse among them
END, REPORTED = 0.06, [0.02, 0.05, 0.06]  # of runs [s]
TIGHT = {"rtol": 1e-9, "atol": 1e-11}
AGREED = 1e-6  # a thousand tolerances: gains up to 40 multiply the errors of motions


def scene_of(reference, robot=None, **parts):
    robot = robot or rne.Robot(straight_chain(2))
    law = rne.control.pd_gravity(robot, [40.0, 5.0], [6.0, 0.3], reference)
    return rne.Scene(robot, controller=law, **parts)


def interpolants():
    """q, qd and qdd as functions of time, by kind."""
    quintic, cubic = make_interp_spline(T, Q, k=5), CubicSpline(T, Q)
    slopes = np.diff(Q, axis=0) / np.diff(T)[:, None]

    def piece(t):
        return np.minimum(np.searchsorted(T, t, side="right"), len(T) - 1) - 1

    return {
        "spline": [lambda t, k=k: quintic(t, nu=k) for k in range(3)],
        "cubic": [lambda t, k=k: cubic(t, k) for k in range(3)],
        "hold": [lambda t: Q[np.searchsorted(T, t, side="right") - 1], lambda t: 0 * Q[piece(t)], lambda t: 0 * Q[piece(t)]],
        "linear": [
            lambda t: np.stack([np.interp(t, T, q) for q in Q.T], axis=-1),
            lambda t: slopes[piece(t)],
            lambda t: 0 * Q[piece(t)],
        ],
    }  # fmt: skip


@pytest.mark.parametrize("kind", MADE)
def test_motions_are_scipys_interpolants(kind):
    """At samples too, where positions that are held and velocities along lines are those from there on."""
    times = np.concatenate([TIMES, T])
    for found, expected in zip(MADE[kind](T, Q)(times), interpolants()[kind], strict=True):
        np.testing.assert_allclose(found, expected(times), rtol=0, atol=1e-11 * max(1.0, np.abs(expected(T)).max()))


def test_breaks_are_the_times_of_jumps():
    assert sampled(T, Q).breaks == sampled(T, Q, "linear").breaks == tuple(T)
    assert sampled(T, Q, "cubic").breaks == ()
    for time in T[1:-1].tolist():  # on each side of a jump its own value
        before, after = (sampled(T, Q)(t)[0] for t in (np.nextafter(time, 0), time))
        k = T.tolist().index(time)
        assert (before.tolist(), after.tolist()) == (Q[k - 1].tolist(), Q[k].tolist())


ERRORS = {
    "kind": ((T, Q, "quintic"), "`kind` must be one of ['hold', 'linear', 'cubic'], got 'quintic'"),
    "rows": ((T, Q[1:]), "`values` must have shape (9, n), a row for each time, got (8, 2)"),
    "order": (([0.0, 2.0, 1.0], np.zeros((3, 1))), "`t` must ascend, got 1 after 2 at index 2"),
    "nan": (([0.0, 1.0], [[0.0], [np.nan]]), "`values` must be finite, got nan at index (1, 0)"),
    "close": (
        ([0.0, 1e-310, 1.0], [[0.0], [1.0], [2.0]], "linear"),
        "`t` is spaced too closely for `values`: accelerations exceed the range of float64 within 1 s",
    ),
}


@pytest.mark.parametrize("case", ERRORS)
def test_samples_that_are_no_motion_are_refused(case):
    given, message = ERRORS[case]
    with pytest.raises(ValueError, match="^" + re.escape(message) + "$"):
        sampled(*given)


@pytest.mark.parametrize("kind", kept(MADE, ["spline"]))
def test_a_law_is_traced_and_its_kernel_gives_what_a_call_gives(kind):
    reference = MADE[kind](T, Q)
    scene, x = scene_of(reference), np.random.default_rng(0).uniform(-1, 1, (len(TIMES), 4))
    law, robot = scene.controller, scene.robot
    assert scene.is_traced
    torques = np.array([law(t, *np.split(state, 2)) for t, state in zip(TIMES, x, strict=True)])
    assert relative(rne.control.compiled(law)(TIMES[:, None], x[:, :2], x[:, 2:]), torques) <= SUMS
    expected = np.concatenate([x[:, 2:], robot.forward_dynamics(x[:, :2], x[:, 2:], torques)], axis=1)
    assert relative(scene.kernel(TIMES[:, None], x), expected) <= SUMS
    assert relative(scene.kernel(TIMES[:1], x[0])[None], expected[:1]) <= SUMS
    again = pickle.loads(pickle.dumps(scene.kernel))
    np.testing.assert_array_equal(again(TIMES[:, None], x), scene.kernel(TIMES[:, None], x))


@pytest.mark.parametrize("kind", kept(MADE, ["cubic"]))
def test_derivatives_by_time_are_exact_within_pieces(kind):
    """Of torques -Kp (q - r) - Kd (qd - r'): Kp r' + Kd r''."""
    scene = scene_of(MADE[kind](T, Q))
    law = rne.control.compiled(scene.controller)
    by_time = Kernel(law.function, law.model, {}, ("t",))
    q = np.zeros((len(TIMES), 2))
    found = by_time(TIMES[:, None], q, q, law.piece(TIMES[:, None]))[..., 0]
    _, rate, acceleration = interpolants()[kind]
    expected = scene.controller.kp * rate(TIMES) + scene.controller.kd * acceleration(TIMES)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("kind", kept(MADE, ["linear"]))
def test_samples_are_a_number_of_the_scene_and_no_part_of_its_program(kind):
    scene, made = scene_of(MADE[kind](T, Q)), MADE[kind]
    np.testing.assert_array_equal(scene.numbers["controller.reference"], Q)
    changed, anew = scene.with_numbers({"controller.reference": OTHER}), scene_of(made(T, OTHER), scene.robot)
    kernels = {id(s.kernels.scene_kernel(s.dynamics.right_hand_side)) for s in (scene, changed, anew)}
    assert len(kernels) == 1
    motions = [rne.simulate(s, [0.3, 0.1], [0, 0], 0.2) for s in (changed, anew, scene)]
    np.testing.assert_array_equal(motions[0].q, motions[1].q)
    assert np.abs(motions[2].q[-1] - motions[0].q[-1]).max() > 0.01


def test_another_motion_in_place_of_one_is_noticed():
    robot = rne.Robot(straight_chain(2))

    class Law:
        traceable = True

        def __init__(self, path):
            self.path = path

        def __call__(self, t, q, qd):
            return 50.0 * (self.path(t)[0] - q) - 5.0 * qd

    law = Law(spline(T, Q))
    scene = rne.Scene(robot, controller=law)
    first = rne.simulate(scene, [0, 0], [0, 0], 0.2).q[-1]
    law.path = spline(T, OTHER)
    expected = rne.simulate(rne.Scene(robot, controller=Law(law.path)), [0, 0], [0, 0], 0.2).q[-1]
    assert scene.is_traced
    np.testing.assert_array_equal(rne.simulate(scene, [0, 0], [0, 0], 0.2).q[-1], expected)
    assert np.abs(expected - first).max() > 0.01


@pytest.fixture(params=kept(["text", "numba"], ["text"]))
def in_loops(request, monkeypatch):
    """A robot whose motions are run in machine code, or by the texts of its loops in Python, which need no compiler."""
    if request.param == "numba":
        pytest.importorskip("numba", reason="Numba is not installed")
        return rne.Robot(straight_chain(2), "numba")
    robot = interpreted(monkeypatch)(straight_chain(2))
    is_traced = property(lambda scene: scene._law if scene.sample_time and scene.robot is robot else None)
    monkeypatch.setattr(rne.Scene, "traced_samples", is_traced)
    return robot


def both(reference, robot, method="DOP853", **parts):
    """The motion of a scene in loops, and by SciPy with the law called."""
    parts, how = {"friction": rne.Friction(viscous=0.3)} | parts, {"t_eval": REPORTED} | TIGHT
    scene = scene_of(reference, robot, **parts)
    called = scene_of(reference, **parts)
    law = called.controller
    torque = rne.control.pd_gravity(law.robot, law.kp, law.kd, lambda t: reference(t))  # which cannot be traced
    called = rne.Scene(called.robot, controller=torque, **parts)
    breaks = getattr(reference, "breaks", ())
    return (
        rne.simulate(scene, [0.1, 0.2], [0, 0], END, method=method, **how),
        rne.simulate(called, [0.1, 0.2], [0, 0], END, method="DOP853", breaks=breaks, **how),
    )


@pytest.mark.parametrize("kind", kept(MADE, ["spline"]))
@pytest.mark.parametrize("method", kept(["DOP853", "Rodas5P"], ["DOP853"]))
def test_loops_follow_the_motion_that_is_called(kind, method, in_loops):
    loop, called = both(MADE[kind](T, Q), in_loops, method)
    for name in ("q", "qd", "tau"):
        np.testing.assert_allclose(getattr(loop, name), getattr(called, name), rtol=0, atol=AGREED)


@pytest.mark.parametrize("kind", kept(MADE, ["linear"]))
def test_sampled_laws_in_loops_follow_the_motion_that_is_called(kind, in_loops):
    loop, called = both(MADE[kind](T, Q), in_loops, sample_time=0.01)
    for name in ("q", "qd", "tau"):
        np.testing.assert_allclose(getattr(loop, name), getattr(called, name), rtol=0, atol=AGREED)


@pytest.mark.parametrize("at_once", [1, 1000])
@pytest.mark.parametrize("kind", ["held", "trapezoidal"])
def test_steps_in_loops_are_those_from_break_to_break(in_loops, monkeypatch, kind, at_once):
    """To the last bit, with the values on both sides of the jumps, however many steps the loop takes at once."""
    t = np.linspace(0, 0.1, 6)
    held = sampled(t, np.sin(9 * t)[:, None] * [0.3, 0.1])
    reference = held if kind == "held" else rne.trajectories.trapezoidal([0, 0], [0.3, 0.1], 0.08, 0.02)
    scene, motions = scene_of(reference, in_loops), []
    monkeypatch.setattr(run.Run, "_steps_at_once", lambda run: at_once)
    for takes_breaks in (True, False):
        monkeypatch.setattr(compiled_methods.CompiledSolver, "takes_breaks", takes_breaks)
        motions.append(rne.simulate(scene, [0, 0], [0, 0], 0.1, method="RK45"))
    inner = [b for b in reference.breaks if 0 < b < 0.1]
    assert motions[0].jumps.tolist() == (inner if kind == "held" else [])
    for name in ("t", "q", "tau", "qdd", "jumps", "tau_before", "qdd_before"):
        np.testing.assert_array_equal(*(getattr(motion, name) for motion in motions), err_msg=name)


@pytest.mark.long
def test_steps_of_rodas5p_end_at_breaks(in_loops, monkeypatch):
    t = np.linspace(0, 0.4, 41)
    scene = scene_of(sampled(t, np.sin(9 * t)[:, None] * [0.3, 0.1]), in_loops, friction=rne.Friction(viscous=1.0))
    motions = []
    for takes_breaks in (True, False):
        monkeypatch.setattr(compiled_methods.RosenbrockSolver, "takes_breaks", takes_breaks)
        motions.append(rne.simulate(scene, [0, 0], [0, 0], 0.4, method="Rodas5P", rtol=1e-10, atol=1e-12))
    np.testing.assert_array_equal(motions[0].jumps, motions[1].jumps)
    np.testing.assert_allclose(motions[0].q[-1], motions[1].q[-1], rtol=0, atol=AGREED)
    np.testing.assert_allclose(motions[0].tau_before, motions[1].tau_before, rtol=0, atol=1e3 * AGREED)


def test_a_run_ends_with_an_error_where_the_samples_end(in_loops):
    for robot in (None, in_loops):
        scene = scene_of(spline(T, Q), robot)
        with pytest.raises(ValueError, match=r"^`t` must be within the samples, 0 to 0\.4 s, got 0\.4\d+$"):
            rne.simulate(scene, [0, 0], [0, 0], 0.5)


@pytest.fixture(params=kept(["rows", "text", "numba"], ["rows", "text"]))
def side_by_side(request, monkeypatch):
    """A robot whose ensembles run in rows of NumPy, or in lanes, whose texts may be run by Python."""
    if request.param == "rows":
        return rne.Robot(straight_chain(2))
    if importlib.util.find_spec("numba") is None:
        pytest.skip("Numba is not installed")
    if request.param == "text":
        monkeypatch.setattr(lanes, "compiled", lambda text: text)
        monkeypatch.setattr(Kernel, "address", address_by_numpy)
        of_numpy = kernel_module.backends("numpy")
        monkeypatch.setattr(kernel_module, "backends", lambda engine: of_numpy)
        monkeypatch.setattr(Kernel, "fast_call", property(lambda kernel: lambda *_: None))
        monkeypatch.setattr(rne.Scene, "traced_samples", property(lambda s: s._law if s.sample_time else None))
    return rne.Robot(straight_chain(2), "numba")


@pytest.mark.parametrize("kind", kept(MADE, ["cubic"]))
@pytest.mark.parametrize("has_own", kept([True, False], [True]))
@pytest.mark.parametrize("sample_time", kept([None, 0.01], [None]))
def test_motions_side_by_side_follow_their_own_samples(kind, has_own, sample_time, side_by_side):
    """As each does by itself; common samples are a table for all."""
    count = lanes.LANES + 1
    scene = scene_of(MADE[kind](T, Q), side_by_side, sample_time=sample_time)
    samples = Q + 0.1 * np.random.default_rng(0).uniform(-1, 1, (count, 1, 2)) * T[:, None]
    starts = np.random.default_rng(1).uniform(-0.3, 0.3, (count, 2))
    numbers = {"controller.reference": samples} if has_own else None
    found = rne.ensemble(scene, starts, 0 * starts, END, numbers=numbers, t_eval=REPORTED, **TIGHT)
    k = count - 1
    single = scene_of(MADE[kind](T, samples[k] if has_own else Q), sample_time=sample_time)
    motion = rne.simulate(single, starts[k], [0, 0], END, t_eval=REPORTED, **TIGHT)
    for name in ("q", "qd", "tau"):
        np.testing.assert_allclose(getattr(found, name)[:, k], getattr(motion, name), rtol=0, atol=AGREED)


def test_equal_steps_side_by_side_end_at_jumps(side_by_side):
    """They are those of `rne.sensitivities`; a stage on the other side of a jump would cost all orders but one."""
    start, how = ([0.1, -0.2], [0.0, 0.0]), {"step": 7e-3, "t_eval": [0.05, 0.17, 0.25]}
    found = rne.ensemble(scene_of(MADE["hold"](T, Q), side_by_side), *np.array(start)[:, None], 0.25, **how)
    motion = rne.sensitivities(scene_of(MADE["hold"](T, Q)), *start, 0.25, wrt="q0", **how)
    for name in ("q", "qd", "tau"):
        np.testing.assert_allclose(getattr(found, name)[:, 0], getattr(motion, name), rtol=0, atol=1e-11)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_c_source_has_the_samples(tmp_path):
    law = rne.control.compiled(scene_of(spline(T, Q)).controller)
    library = c_library([law.source("c")], tmp_path)
    find = library.control_law_piece
    find.argtypes, find.restype = [ctypes.c_double], ctypes.POINTER(ctypes.c_double)
    x = np.random.default_rng(0).uniform(-1, 1, (len(TIMES), 4))
    width = law.table.shape[1]
    pieces = np.array([find(t)[:width] for t in TIMES])
    np.testing.assert_array_equal(pieces, law.piece(TIMES[:, None]))
    arrays = TIMES[:, None], x[:, :2], x[:, 2:]
    found = call(library.control_law, (*arrays, pieces), 2, "float64")
    assert relative(found, law(*arrays)) <= SUMS
    assert not find(-0.01)
    assert not find(0.41)
