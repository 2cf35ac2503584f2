"""Control laws that return their states at the next sample, in all that runs them: as the same law called."""

import ctypes
import re
import zipfile
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.linalg import expm

import rne
from rne.elementwise import less, where
from rne.integrators import lanes
from rne.kernels import Kernel

from .compiled_sources import c_library
from .helpers import address_by_numpy, kept
from .random_robots import straight_chain
from .test_compiled_motions import interpreted
from .test_fmu import HERE, MINUTE, Opened, needs_fmpy

T, END = 0.01, 0.065  # sample time and duration [s]
Q, QD = np.array([0.3, -0.2]), np.array([0.5, -1.0])
TIMES = np.linspace(0, END, 14)
TIGHT = {"rtol": 1e-10, "atol": 1e-12}
ROUNDING = 1e-12  # of programs that differ by the order of sums, relative to numbers of at least 1
TWO_SOLVERS = 1e-8  # a hundred tolerances of TIGHT
BY_DIFFERENCES, STEP = 1e-7, 1e-5  # relative error of central differences with this step
NAMES = ("q0", "qd0", "controller.kp", "controller.time")
WAYS = kept(["loop", "numba"], ["loop"])  # the text of loops run by Python, and machine code


class Filtered:
    """PD with velocities that a filter of first order smooths, by rates, or by Euler's rule within the law."""

    traceable, states = True, 2

    def __init__(self, discrete, kp=20.0, time=0.03):
        self.discrete, self.kp, self.time = discrete, kp, time

    def __call__(self, t, q, qd, z):
        rates = (qd - z) / self.time
        u = np.array([1.0, 0.2]) * (self.kp * (0.4 + np.sin(3 * t) - q) - 4.0 * z)
        return u, z + T * rates if self.discrete else rates


class Counting:
    """PD with means of three positions, velocities by a bilinear filter, and a count of samples, the first two idle.

    No rates give such states by Euler's rule: filtered velocities, the last positions, those before, the count.
    """

    traceable, states, discrete = True, 7, True

    def __init__(self, kp=20.0, time=0.03):
        self.kp, self.time = kp, time

    def __call__(self, t, q, qd, z):
        filtered, last, before, count = z[:2], z[2:4], z[4:6], z[6:]
        a = 2 * self.time / T
        velocity = ((a - 1) * filtered + 2 / T * (q - last)) / (a + 1)
        u = np.array([1.0, 0.2]) * (self.kp * (0.4 - (q + last + before) / 3) - velocity)
        return where(less(count[0], 1.5), 0.0, u), np.concatenate([velocity, q, last, count + 1])


def scene_of(law, robot=None, **parts):
    """Two links with friction, within reach of the limits, commands of which act in the next interval but one."""
    given = {"friction": rne.Friction(viscous=0.2), "effort_limit": [6.0, 1.5], "delay": 1.4 * T, "sample_time": T}
    return rne.Scene(robot or rne.Robot(straight_chain(2), "numpy"), controller=law, **given | parts)


def simulated(scene, q=Q, qd=QD):
    return rne.simulate(scene, q, qd, END, t_eval=TIMES, **TIGHT)


def same(found, expected, tolerance=ROUNDING):
    """Equal arrays, relative to their largest entry or 1."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * max(1.0, np.abs(expected).max()))


@pytest.fixture
def traced_robot(monkeypatch):
    """A function of a way: a robot whose single motions sample traced laws in loops, `many` for motions side by side."""

    def make(way, *, many=False):
        pytest.importorskip("numba", reason="Numba is not installed")
        if way == "loop":
            robot = interpreted(monkeypatch)(straight_chain(2))
            robot = rne.Robot(straight_chain(2), "numba") if many else robot
            monkeypatch.setattr(Kernel, "address", address_by_numpy)
            monkeypatch.setattr(lanes, "compiled", lambda text: text)
            monkeypatch.setattr(rne.Scene, "traced_samples", property(lambda scene: scene.traced_law()))
            return robot
        return rne.Robot(straight_chain(2), "numba")

    return make


@pytest.mark.parametrize("way", ["called", *WAYS])
def test_eulers_rule_within_the_law_is_that_of_the_scene(traced_robot, way):
    robot = None if way == "called" else traced_robot(way)
    scenes = [scene_of(Filtered(discrete), robot) for discrete in (False, True)]
    assert all((scene.traced_samples is None) == (way == "called") for scene in scenes)
    by_rates, discrete = map(simulated, scenes)
    for name in ("q", "qd", "tau", "controller_state"):
        same(getattr(discrete, name), getattr(by_rates, name))


@pytest.mark.parametrize("way", WAYS)
def test_traced_it_moves_as_it_is_called(traced_robot, way):
    called, traced = simulated(scene_of(Counting())), simulated(scene_of(Counting(), traced_robot(way)))
    assert "in machine code" in traced.message
    for name in ("q", "qd", "tau", "controller_state"):
        same(getattr(traced, name), getattr(called, name), TWO_SOLVERS)
    last = called.controller_state[-1]  # of the sample at 0.06 s
    assert last[6] == 6
    same(last[2:4], called.q[np.isclose(TIMES, 0.05)][0])
    assert np.abs(called.tau[TIMES < 3.4 * T]).max() < 1e-9  # idle at first
    assert np.abs(called.tau[:, 1]).max() == 1.5  # at its limit


@pytest.mark.parametrize("way", WAYS)
def test_side_by_side_it_moves_as_it_is_called(traced_robot, way):
    count = lanes.LANES + 2
    speeds = np.linspace(-1, 1, count)[:, None] * QD
    scene = scene_of(Counting(), traced_robot(way, many=True))
    runs = rne.ensemble(scene, np.tile(Q, (count, 1)), speeds, END, t_eval=TIMES, **TIGHT)
    assert runs.method == "Tsit5"
    for k in (0, count - 1):
        one = simulated(scene_of(Counting()), Q, speeds[k])
        same(runs.q[:, k], one.q, TWO_SOLVERS)
        same(runs.tau[:, k], one.tau, TWO_SOLVERS)


@pytest.fixture(scope="module", params=kept(["numpy", "numba"], ["numpy"]))
def stepper(request):
    """Control intervals of the law that counts, in two steps each."""
    if request.param == "numba":
        pytest.importorskip("numba", reason="Numba is not installed")
    return rne.Stepper(scene_of(Counting(), rne.Robot(straight_chain(2), request.param)), substeps=2)


def drawn(stepper, count=2):
    """States within reach of the limits, where a law counts at 1 and 2 samples."""
    x = np.random.default_rng(3).uniform(-0.3, 0.3, (count, stepper.size))
    x[:, 10:11] = np.linspace(1, 2, count)[:, None]
    return x


def test_intervals_make_the_motion(stepper):
    x, motion = stepper.start(Q, QD), simulated(scene_of(Counting()))
    for _ in range(6):
        x = stepper(x)
    same(x[:2], motion.q[np.isclose(TIMES, 6 * T)][0], 1e-6)  # of steps of order 4
    assert x[10] == 6
    same(x[6:8], motion.q[np.isclose(TIMES, 5 * T)][0], 1e-6)


def test_intervals_have_derivatives(stepper):
    x, weights = drawn(stepper), np.random.default_rng(4).normal(size=(2, stepper.size))
    own = {name: stepper.scene.numbers[name] for name in NAMES[2:]}
    by_x, slopes = stepper.jacobian(x), stepper.gradient(x, None, weights, own)
    shift = STEP * np.eye(stepper.size)
    for k, state in enumerate(x):
        differences = (stepper(state + shift) - stepper(state - shift)).T / (2 * STEP)
        same(by_x[k], differences, BY_DIFFERENCES)
        same(slopes["x"][k], weights[k] @ by_x[k])
        assert by_x[k, 10, 10] == 1  # of the count
        for name, value in own.items():
            more, less_ = (stepper(state, None, {name: value * (1 + by)}) for by in (STEP, -STEP))
            same(slopes[name][k], weights[k] @ (more - less_) / (2 * STEP * value), BY_DIFFERENCES)


def test_motions_have_derivatives_forwards_and_backwards(stepper):
    def cost(q, qd):
        return (q * qd).sum() + q[0]

    how = {"step": T / 2, "wrt": NAMES}
    backwards = rne.motion_gradient(stepper.scene, Q, QD, END, final=cost, **how)
    along = rne.sensitivities(stepper.scene, Q, QD, END, t_eval=[END], method="rk4", **how)
    q, qd = along.q[-1], along.qd[-1]
    for name in NAMES:
        expected = (qd + [1, 0]) @ along.dq[name][-1] + q @ along.dqd[name][-1]
        same(np.ravel(backwards.gradient[name]), expected, 1e-10)

    def value(kp):
        numbers = {"controller.kp": np.array(kp)}
        return rne.motion_gradient(stepper.scene, Q, QD, END, final=cost, step=T / 2, wrt="q0", numbers=numbers).value

    by_kp = (value(20 * (1 + STEP)) - value(20 * (1 - STEP))) / (2 * 20 * STEP)
    same(backwards.gradient["controller.kp"], by_kp, BY_DIFFERENCES)


def test_printed_steps_are_those_of_the_stepper(stepper, tmp_path):
    function = c_library([stepper.source("c", "arm_step")], tmp_path).arm_step
    x = drawn(stepper)
    for state, end in zip(x, stepper(x), strict=True):
        out = np.empty(stepper.size)
        function(*(a.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for a in (np.zeros(1), state.copy(), out)))
        same(out, end)
    ca = pytest.importorskip("casadi", reason="CasADi is not installed")
    step, symbol = stepper.to_casadi(), ca.SX.sym("x", stepper.size)
    given = [symbol if name == "x" else 0 for name in step.name_in()]
    slopes = ca.Function("slopes", [symbol], [step(*given), ca.jacobian(step(*given), symbol)])
    for state, end, by_x in zip(x, stepper(x), stepper.jacobian(x), strict=True):
        found, jacobian = map(np.array, slopes(state))
        same(found[:, 0], end)
        same(jacobian, by_x)


def test_compiled_it_gives_torques_and_next_states():
    robot, z = rne.Robot(straight_chain(2), "numpy"), np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 4.0])
    kernel = rne.control.compiled(Counting(), robot)
    same(kernel(np.zeros(1), Q, QD, z), np.concatenate(Counting()(0.0, Q, QD, z)))


def test_laws_of_one_formula_differ_where_one_is_discrete():
    """Of one robot, whose cache of kernels has the traced laws of both."""
    robot, scenes = rne.Robot(straight_chain(2), "numpy"), []
    for discrete in (False, True):
        law = rne.traceable(lambda t, q, qd, z: (-5 * q - z, 0.5 * z + q))
        law.states, law.discrete = 2, discrete
        scenes.append(scene_of(law, robot))
    x = drawn(rne.Stepper(scenes[0]))
    by_rates, discrete = (rne.Stepper(scene)(x) for scene in scenes)
    same(by_rates[:, 4:6], x[:, 4:6] + T * (0.5 * x[:, 4:6] + x[:, :2]))
    same(discrete[:, 4:6], 0.5 * x[:, 4:6] + x[:, :2])
    assert scenes[0].traced_law() != scenes[1].traced_law()
    scenes[1].controller.discrete = False
    same(rne.Stepper(scenes[1])(x), by_rates)


def test_this_packages_laws_differ_where_one_is_discrete():
    """Of those that differ in numbers alone one is traced, unless a number makes one discrete."""
    own = {"traceable": True, "states": 2, "discrete": property(lambda law: law.period > 0)}
    own |= {"__call__": lambda law, t, q, qd, z: (-5 * q, 0.5 * z + law.period * q), "__module__": "rne.control.own"}
    kind, robot = type("Own", (), own), rne.Robot(straight_chain(2), "numpy")
    laws = [kind(), kind()]
    for law, law.period in zip(laws, (T, -T), strict=True):
        assert scene_of(law, robot).traced_law().discrete == law.discrete


def sampled_by_hand(M, viscous, delay):
    """The map of (q, qd, z, last command) of one joint without gravity under PD with a bilinear filter's velocity."""
    a, kp, kd = 2 * 0.03 / T, 5.0, 0.4
    plant = np.zeros((3, 3))
    plant[0, 1], plant[1, 1], plant[1, 2] = 1.0, -viscous / M, 1 / M
    late, rest = expm(plant * delay), expm(plant * (T - delay))
    by_x, by_u = (rest @ late)[:2, :2], rest[:2, 2]
    by_last = rest[:2, :2] @ late[:2, 2]
    velocity = np.array([2 / T, 0, (a - 1), -2 / T]) / (a + 1)  # of q, qd, filtered velocity, last position
    u = -kp * np.array([1, 0, 0, 0]) - kd * velocity
    top = np.block([[by_x, np.zeros((2, 2)), by_last[:, None]]]) + np.outer(by_u, [*u, 0])
    return np.vstack([top, [*velocity, 0], [1, 0, 0, 0, 0], [*u, 0]]), velocity, u


@pytest.mark.parametrize("traceable", [True, False])
def test_eigenvalues_of_the_sampled_loop_are_those_by_hand(traceable):
    robot, viscous, delay = rne.Robot(straight_chain(1), "numpy"), 0.05, 0.4 * T
    M = robot.mass_matrix([0.0])[0, 0]
    expected, velocity, u = sampled_by_hand(M, viscous, delay)

    def law(t, q, qd, z):
        row = np.concatenate([q, qd, z])
        return (u @ row)[None], np.concatenate([(velocity @ row)[None], q])

    law.states, law.discrete, law.traceable = 2, True, traceable
    friction = rne.Friction(viscous=viscous)
    scene = rne.Scene(robot, controller=law, gravity=[0, 0, 0], friction=friction, sample_time=T, delay=delay)
    found = scene.check_gains([0.0])
    wanted = np.linalg.eigvals(expected)
    tolerance = ROUNDING if traceable else 1e-5  # forward differences, over the sample time
    roots = np.linalg.eigvals(found.loop.sample_map)
    assert max(np.abs(roots - root).min() for root in wanted) < tolerance**0.5  # of roots at 0 that nearly meet
    same(np.poly(roots), np.poly(wanted), tolerance)
    assert found.stable == (np.abs(wanted).max() < 1)
    at_other_times = f"{found.sample_time_limit:.4g} s, if the law's states then change in proportion to it\n"
    assert f"smallest unstable sample time {at_other_times}" in str(found)
    A, B = np.array([[0, 1], [0, -viscous / M]]), [[0], [1 / M]]
    R = [velocity, [1, 0, 0, 0]]
    loop = rne.control.closed_loop(A, B, u[None], R, sample_time=T, delay=delay, discrete=True)
    same(np.poly(np.linalg.eigvals(loop.sample_map)), np.poly(wanted))
    same(loop.R * T + np.eye(2, 4, 2), R)


def law_with(returned, states=1, discrete=True):
    """A law of two joints without torques, by a function of (t, z)."""

    def law(t, q, qd, z):
        return np.zeros(2), returned(t, z)

    law.states, law.discrete = states, discrete
    return law


REFUSED = {
    "`controller` is discrete: its states change from sample to sample; give a `sample_time`": lambda: scene_of(
        law_with(lambda t, z: z), sample_time=None, delay=None
    ),
    "`discrete` needs a `sample_time`: R gives the states at the next sample": lambda: rne.control.closed_loop(
        [[0]], [[1]], [[-1, 0]], [[1, 1]], discrete=True
    ),
    "`next values of the controller's states` must have shape (1,), got (2,)": lambda: simulated(
        scene_of(law_with(lambda t, z: np.zeros(2)))
    ),
    "`controller` discrete must return (torques, its next states), got (torques, None)": lambda: simulated(
        scene_of(law_with(lambda t, z: None))
    ),
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_is_no_discrete_law_is_refused(text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}"):
        REFUSED[text]()


def test_the_mark_is_checked():
    with pytest.raises(TypeError, match=r"^`controller\.discrete` must be True or False, got str$"):
        scene_of(law_with(lambda t, z: z, discrete="yes"))
    stateless = rne.traceable(lambda t, q, qd: -q)
    stateless.discrete = True
    with pytest.raises(ValueError, match=r"^`controller` is discrete, .* it needs an attribute `states`$"):
        scene_of(stateless)
    one = dataclass(type("Plain", (), {"states": 2, "__call__": lambda self, t, q, qd, z: (-q, z)}))()
    one.discrete = True
    with pytest.raises(ValueError, match=r"^`controller\.discrete` must be in the class or a field"):
        scene_of(one)
    scene = scene_of(law := law_with(lambda t, z: 0 * z, discrete=False), sample_time=None, delay=None)
    law.discrete = True
    with pytest.raises(ValueError, match=r"give a `sample_time`$"):
        simulated(scene)


@pytest.mark.parametrize("way", ["called", *WAYS])
def test_next_states_that_are_not_finite_are_named_with_their_time(traced_robot, way):
    law = law_with(lambda t, z: z + 1 + 0 * np.sqrt(2.5 - z))  # NaN from the fourth sample on
    law.traceable = way != "called"
    scene = scene_of(law, None if way == "called" else traced_robot(way))
    assert (scene.traced_samples is None) == (way == "called")
    text = r"next value of state 0 of the controller is nan at t = 0\.03 s"
    with np.errstate(invalid="ignore"), pytest.raises(rne.SimulationError, match=text):
        simulated(scene)


@pytest.mark.parametrize("discrete", [False, True])
def test_a_traced_law_of_another_number_of_states_is_called(traced_robot, caplog, discrete):
    law = rne.traceable(law_with(lambda t, z: np.concatenate([z, z]), discrete=discrete))
    assert scene_of(law, traced_robot("loop")).traced_samples is None
    what = "next states" if discrete else "rates of its states"
    assert f"`controller` must return {what} of shape (1,), got (2,)" in caplog.text


def test_the_text_of_a_unit_takes_the_next_states(tmp_path):
    """Which the long test runs."""
    for discrete, numbers in ((True, ("0.0", "1.0")), (False, ("1.0", "0.01"))):
        path = tmp_path / f"{discrete}.fmu"
        scene_of(Filtered(discrete)).to_fmu(path, q0=Q, qd0=QD, platforms=())
        with zipfile.ZipFile(path) as unit:
            sources = "".join(unit.read(name).decode() for name in unit.namelist() if name.endswith(".c"))
        assert tuple(re.search(rf"#define {name} (\S+)", sources)[1] for name in ("KEEP", "GAIN")) == numbers
        assert "KEEP * m->z[i - N] + GAIN * found[i]" in sources


@needs_fmpy
@pytest.mark.long
def test_a_unit_moves_as_rne_simulate(tmp_path):
    scene = scene_of(Counting())
    scene.to_fmu(tmp_path / "arm.fmu", q0=Q, qd0=QD, platforms=HERE)
    motion = rne.simulate(scene, Q, QD, 0.2, t_eval=np.arange(41) * T / 2, rtol=MINUTE, atol=MINUTE, method="DOP853")
    unit = Opened(str(tmp_path / "arm.fmu")).begin()
    for k in range(1, 41):
        unit.step(T / 2)
        same(unit.get("q", 2), motion.q[k], TWO_SOLVERS)
        same(unit.get("tau", 2), motion.tau[k], TWO_SOLVERS)
        same(unit.get("z", 7), motion.controller_state[k], TWO_SOLVERS)
