"""Gradients of motions: against complex steps of the same steps, written plainly, and by the laws that they obey."""

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

import rne
from rne.elementwise import clip, less, tanh, where
from rne.integrators import frozen_steps
from rne.simulation import motion_gradients as module

from .helpers import kept
from .plain_motions import by_complex_steps
from .random_robots import random_tree, straight_chain

CONTROLLED_ERROR = 1e-7  # of an energy's slopes, relative, by steps that are controlled to 1e-8
# Relative to the largest of a name, and to the largest d(state)/d(start): rounding of some dozen steps
SAME_STEPS = 1e-11
DIFFERENCE, BY_DIFFERENCES = 1e-5, 1e-7  # of central differences; their error, its square and rounding over it
SAME_MOTION = 1e-13  # side by side and alone, whole and in parts: the same operations, summed in another order
USUAL = {"duration": 0.044, "step": 0.012}  # neither of which divides the other, nor the sample time


def cost(t, q, qd, tau):
    return (q * q).sum(-1) + 0.3 * t * (qd * q).sum(-1) + 1e-2 * (tau * tau).sum(-1)


def final(q, qd):
    return (q * qd).sum(-1) + (0.5 * qd * qd).sum(-1) + q[..., 0]


COSTS = {"cost": cost, "final": final}


@dataclass(frozen=True, eq=False)
class Damped:
    """A user's law with gains, a width and a matrix."""

    kp: float
    width: np.ndarray
    across: np.ndarray
    traceable = True

    def __call__(self, t, q, qd):
        pull = -self.kp * tanh(q / self.width)
        return pull - (self.across * qd[..., None, :]).sum(-1) + 0.1 * t


@dataclass(frozen=True, eq=False)
class Switched:
    """A law that jumps at times of its own, to and from what it is at these times."""

    breaks: np.ndarray
    kp: float
    traceable = True

    def __call__(self, t, q, qd):
        return where(less(t, 0.01), 1.0, -3.0) + where(less(0.02, t), 5.0, 0.0) - self.kp * q


def filtered(kp, kd, lag):
    """A law with a state for each joint, which lags behind its velocity."""

    def law(t, q, qd, z):
        return -kp * q - kd * z, (qd - z) / lag

    law.states = 2
    return rne.traceable(law)


def clipped(kp, most):
    """A law with numbers in cells, which is clipped."""
    return rne.traceable(lambda t, q, qd: clip(-kp * (q - 0.1 * t), -most, most) - 0.2 * qd)


def both_sides(kp):
    """A law that reads links and motors of two joints."""
    return rne.traceable(lambda t, q, qd, kp=kp: -kp * q[2:] + 5.0 * q[:2] - 2.0 * qd[:2])


def arm(n=2, seed=4, **shape):
    """A serial arm of rotating joints, or another tree."""
    return rne.Robot(random_tree(n, seed, **(shape or {"prismatic": 0, "branching": 0})), "numpy")


def friction(name, joints=slice(2)):
    own = {k: np.array(x)[joints] if np.ndim(x) else x for k, x in SIZES[name].items()}
    return rne.Friction(**own, smoothing=0.1)


SIZES = {
    "viscous": {"viscous": [1.0, 2.0, 0.5]},
    "viscous of both ways": {"viscous": [1.0, 2.0, 0.5], "viscous_back": [0.5, 1.0, 2.0]},
    "coulomb": {"coulomb": [1.0, 2.0, 1.5]},
    "coulomb of both ways": {"coulomb": [1.0, 2.0, 1.5], "coulomb_back": [2.0, 1.0, 0.5]},
    "stribeck": {"coulomb": 1.0, "stribeck_rise": [0.7, -0.5, 0.0], "stribeck": [0.4, 0.3, 0.0]},
    "saturation": {"viscous": 2.0, "saturation": [0.5, 0.0, 0.3]},
    "load": {"load": [0.2, 0.1, 0.4], "viscous": 0.3},
    "offset": {"offset": [0.3, -0.2, 0.5]},
}
SIZES["all"] = {**SIZES["viscous of both ways"], **SIZES["coulomb of both ways"], **SIZES["offset"]}
SIZES["all"] |= {"stribeck_rise": [0.7, -0.3, 0.3], "stribeck": [0.4, 0.3, 0.2], "load": [0.2, 0.1, 0.4]}
SIZES["all"] |= {"saturation": [0.5, 0.0, 0.3]}


def spring(**numbers):
    own = {"stiffness": 40.0, "length": 0.2, "force": 3.0, "damping": 2.0, **numbers}
    return rne.Spring("root", [0.3, 0.1, 0], "link1", [0.1, 0, 0.2], **own)


def samples(kind):
    """A motion of two joints through samples, at times that are no multiples of steps."""
    t, values = (
        np.array([0.0, 0.013, 0.02, 0.031, 0.042, 0.06, 0.08, 0.1]),
        np.random.default_rng(3).normal(size=(8, 2)),
    )
    return rne.trajectories.spline(t, values) if kind == "spline" else rne.trajectories.sampled(t, values, kind)


def of_friction():
    """Scenes by the laws of friction."""
    two = arm()
    law = rne.control.pd(two, [20, 30], [5, 4], [0.3, 0.1])
    for name in SIZES:
        yield f"friction: {name}", rne.Scene(two, friction=friction(name), controller=law), {}


def of_robots():
    """Trees, joints that follow others, payloads, springs."""
    three, tree = arm(3, 2), arm(2, 3, branching=0.4, mimics=1)
    yield "tree", rne.Scene(arm(5, 7, branching=0.6), friction=rne.Friction(viscous=0.5)), {"torque": True}
    law = rne.control.pd(tree, 20, 3, 0.2)
    yield "mimics", rne.Scene(tree, controller=law, armature=[0.1, 0.2, 0.3]), {}
    coupled = arm(5, 3, branching=0.4, coupled=True)
    law, load = rne.control.pd(coupled, 20, 3, 0.2), friction("load", slice(3))
    yield "couplings", rne.Scene(coupled, controller=law, friction=load), {}
    payload = {"payload": rne.Payload(1.0, [0.1, 0, 0.05], np.diag([0.1, 0.2, 0.15])), "mounting": [0.3, 0.2, -1.0]}
    yield "payload", rne.Scene(arm(), **payload, armature=[0.1, 0.3]), {"without": ["parameters"], "torque": True}
    yield "parameters", rne.Scene(arm(), **payload, friction=rne.Friction(viscous=0.3)), {}
    middle = rne.Payload(1.0, [0.1, 0, 0.05], link="link0")
    yield "payload in the middle", rne.Scene(three, payload=middle), {"without": ["parameters"]}
    locked, held = arm(4, 6), {"joint2": 0.4}
    law = rne.control.pd(locked.locked(held), 9, 2, 0)
    yield "locked", rne.Scene(locked, locked=held, controller=law), {}
    springs = [spring(), rne.Spring.at_joint("joint0", 30.0, 0.5, 1.0)]
    yield "springs", rne.Scene(arm(2, 3, prismatic=0.5), springs=springs), {}
    yield "spring without length", rne.Scene(tree, springs=[spring(length=0, force=0, damping=0)]), {}
    yield "spring at a joint that follows", rne.Scene(tree, springs=[rne.Spring.at_joint("joint2", 30.0, 0.5, 1.0)]), {}
    yield "pendulum", rne.Scene(rne.Robot(straight_chain(1), "numpy")), {}


SAMPLED, LIMITS = {"sample_time": 0.01}, {"effort_limit": [15.9, 9.2], "torque_rate": [4.0, 30.0]}


def of_elastic_joints():
    """Elastic joints by what laws read."""
    two = arm()
    for reads in ("motor", "link", "both"):
        elastic = rne.ElasticJoints([800, 500], [2, 1], [0.3, 0.2], reads=reads)
        law = both_sides(30.0) if reads == "both" else rne.control.pd(two, [80, 90], [3, 2], [0.5, -0.5])
        how = {"controller": law} if reads == "both" else {"controller": law, **SAMPLED, "delay": 0.004, **LIMITS}
        how |= {"friction": rne.Friction(viscous=0.3, coulomb=0.4, load=0.1, smoothing=0.2)}
        springs = [spring(length=0.1)] if reads == "motor" else None
        yield f"elastic, {reads}", rne.Scene(two, elastic=elastic, springs=springs, **how), {}


def of_laws():
    """Laws of this package and of users, sampled and not."""
    C, two, three = rne.control, arm(), arm(3, 2)
    path, model = rne.trajectories.quintic([0, 0], [1, 1], 0.1), {"with": ["controller.robot.parameters"]}
    yield "pd_gravity", rne.Scene(two, controller=C.pd_gravity(two, 20, 3, [0.2, 0.1], scale=0.8), **SAMPLED), model
    forward = rne.Friction(viscous=2.0, coulomb=1.0, smoothing=1.0, offset=[0.2, -0.1])
    yield "feed-forward", rne.Scene(two, controller=C.pd_gravity(two, 20, 3, path, feedforward=forward)), {}
    yield "computed torque", rne.Scene(two, controller=C.computed_torque(two, [200, 100], [20, 10], path)), model
    law = C.pid(two, 30, [400, 500], 3, [0.5, -0.3], gravity=True, windup=[1.2, np.inf])
    yield "pid, sampled", rne.Scene(two, controller=law, **SAMPLED, delay=0.004), {}
    yield "pid", rne.Scene(two, controller=law, effort_limit=[16.2, 2.2]), {}
    law = Damped(3.0, np.array([0.4, 0.6]), np.array([[1.0, 0.2], [0.1, 0.8]]))
    yield "a dataclass", rne.Scene(two, controller=law, **SAMPLED), {}
    yield "a closure", rne.Scene(two, controller=clipped(30.0, np.array([2.0, 19.0]))), {}
    law = Switched(np.array([0.01, 0.02]), 2.0)
    yield "a law that jumps", rne.Scene(two, controller=law), {"without": ["controller.breaks"]}
    yield "states", rne.Scene(two, controller=filtered(20.0, np.array([2.0, 3.0]), 0.03)), {}
    yield "states, sampled", rne.Scene(two, controller=filtered(20.0, np.array([2.0, 3.0]), 0.03), **SAMPLED), {}
    slow = rne.trajectories.quintic([0.3, -0.4], [0.5, -0.2], 0.5)
    law = C.adaptive(two, [2, 1], [3, 2], slow, gain=0.1)
    yield "adaptive", rne.Scene(two, controller=law, payload=0.5), {}
    pose = three.link_poses([0.3, -0.2, 0.5])[-1]
    law = C.impedance(three, three.link_names[-1], [50] * 3 + [80] * 3, [5] * 6, pose, posture=([0, 0, 0], 3, 1))
    without = ["controller.pose", "controller.damping", "parameters"]
    yield "impedance", rne.Scene(three, controller=law), {"without": without}
    for kind in ("hold", "linear", "cubic", "spline"):
        law = C.pd(two, [80, 90], [3, 2], samples(kind))
        yield f"reference: {kind}", rne.Scene(two, controller=law), {}
        yield f"reference: {kind}, sampled", rne.Scene(two, controller=law, **SAMPLED, delay=0.013), {}
    trapezium = rne.trajectories.trapezoidal([0, 0], [0.1, 0.2], 0.05, 0.013)
    yield "reference that jumps", rne.Scene(two, controller=C.pd(two, 80, 3, trapezium)), {}


def of_delays():
    """Delays of whole periods, with rests, below one, and none; commands at both of their limits."""
    two = arm()
    law, damped = rne.control.pd(two, [80, 90], [3, 2], [0.5, -0.5]), rne.Friction(viscous=0.3)
    yield "limits", rne.Scene(two, controller=law, effort_limit=[15.7, 8.7]), {}
    for delay in (None, 0.0, 0.004, 0.01, 0.013, 0.02, 0.0273, 0.1):
        yield f"delay {delay}", rne.Scene(two, controller=law, **SAMPLED, delay=delay, **LIMITS, friction=damped), {}


KINDS = of_friction, of_robots, of_elastic_joints, of_laws, of_delays
CASES = {name: (scene, how) for kind in KINDS for name, scene, how in kind()}
SHORT = [
    "friction: all",
    "mimics",
    "payload",
    "pendulum",
    "elastic, link",
    "pid, sampled",
    "a law that jumps",
    "reference: hold",
    "reference: linear, sampled",
    "delay 0.013",
]


def start(scene):
    return np.linspace(0.3, -0.4, scene.n), np.linspace(0.05, -0.1, scene.n)


def asked(name):
    """A scene, the names of its numbers and starts but for the delay, and constant torques if it takes some."""
    scene, how = CASES[name]
    without = {"delay", *how.get("without", ["payload"])}
    names = [*(name for name in scene.numbers if name not in without), *how.get("with", []), "q0", "qd0"]
    return scene, names, np.linspace(1.0, -2.0, scene.n) if how.get("torque") else None


def assert_same(value, gradient, expected, tolerance=SAME_STEPS):
    assert abs(value - expected.value) <= tolerance * max(1.0, abs(expected.value))
    for name, slope in gradient.items():
        error = abs(slope - expected[name]).max()
        assert error <= tolerance * expected.growth * abs(expected[name]).max(), name


@pytest.mark.parametrize("name", kept(CASES, SHORT))
def test_gradient_is_that_of_complex_steps(name):
    scene, names, torque = asked(name)
    given = {**USUAL, **COSTS, "wrt": names, "torque": torque}
    found = rne.motion_gradient(scene, *start(scene), **given)
    assert_same(*found, by_complex_steps(scene, *start(scene), **given))


@pytest.mark.parametrize("name", kept(CASES, ["pendulum"]))
def test_sensitivities_of_the_end_are_those_of_complex_steps(name):
    scene, names, torque = asked(name)
    given = {**USUAL, "wrt": names, "torque": torque}
    found = rne.sensitivities(scene, *start(scene), **given)
    expected = by_complex_steps(scene, *start(scene), **given, cost=cost)
    for key in names:
        q, qd = (x[: scene.n] for x in np.split(expected.of_end[key], 2))
        for slopes, its in ((found.dq, q), (found.dqd, qd)):
            error = abs(slopes[key][-1].reshape(its.shape) - its).max()
            assert error <= SAME_STEPS * expected.growth * abs(its).max(), key


@pytest.mark.parametrize("name", kept(CASES, ["friction: all"]))
def test_gradient_is_that_of_differences(name):
    """Of the values, in a direction in which all numbers and starts move, where the reference shares no branch."""
    scene, names, torque = asked(name)
    rng, known = np.random.default_rng(5), values_of(scene, names)
    way = {k: x * rng.uniform(-1, 1, x.shape if k.rpartition(".")[2] in JOINTWISE else ()) for k, x in known.items()}
    way = {k: np.where(np.isfinite(known[k]), x, 0.0) for k, x in way.items()}
    both = {k: np.stack([known[k] - DIFFERENCE * way[k], known[k] + DIFFERENCE * way[k]]) for k in known}
    torques = None if torque is None else np.stack([torque, torque])
    q, qd, numbers = both.pop("q0"), both.pop("qd0"), both
    found = rne.motion_gradient(scene, q, qd, **USUAL, **COSTS, wrt=names, torque=torques, numbers=numbers)
    slope = sum((found.gradient[k].mean(axis=0) * way[k]).sum() for k in names)
    size = sum(abs(found.gradient[k].mean(axis=0) * way[k]).sum() for k in names)
    difference = (found.value[1] - found.value[0]) / (2 * DIFFERENCE)
    assert abs(slope - difference) <= BY_DIFFERENCES * size


JOINTWISE = "q0", "qd0", "kp", "kd", "viscous", "coulomb", "stiffness", "armature", "gravity", "reference"


def values_of(scene, names):
    """The numbers of these names, and the usual start."""
    known = {**scene.numbers, **dict(zip(("q0", "qd0"), start(scene), strict=True))}
    if "controller.robot.parameters" in names:
        known["controller.robot.parameters"] = scene.controller.robot.parameters
    return {name: known[name] for name in names}


def different(scene, names, count):
    """Starts and numbers of motions side by side, apart by some per cent, in a mapping of arrays (count, ...)."""
    factors, found = np.random.default_rng(6).uniform(0.97, 1.03, count), {}
    for name, x in values_of(scene, names).items():
        found[name] = x * factors.reshape(count, *[1] * x.ndim)
    return found


@pytest.mark.parametrize(
    "name",
    kept(["delay 0.013", "friction: all", "mimics", "payload", "springs", "elastic, motor", "pid", "pd_gravity",
          "reference: spline", "reference: hold, sampled"], ["delay 0.013"]),
)  # fmt: skip
def test_motions_side_by_side_are_those_alone_and_may_be_kept_in_parts(name):
    scene, names, torque = asked(name)
    own, given = different(scene, names, 3), {**USUAL, **COSTS, "wrt": names, "torque": torque}
    numbers = {k: x for k, x in own.items() if k not in ("q0", "qd0")}
    numbers |= {} if scene.delay is None else {"delay": np.array([1.0, 0.3, 2.0]) * scene.delay}
    many = {"numbers": numbers, **given}
    value, gradient = rne.motion_gradient(scene, own["q0"], own["qd0"], **many)
    for k in range(1, 3):
        alone = scene if scene.delay is None else replace(scene, delay=numbers["delay"][k])
        mine = {name: x[k] for name, x in numbers.items() if name != "delay"}
        expected = by_complex_steps(alone, own["q0"][k], own["qd0"][k], numbers=mine, **given)
        assert_same(value[k], {name: x[k] for name, x in gradient.items()}, expected)
    many["wrt"] = names = [*names, *["delay"][: scene.delay is not None]]
    value, gradient = rne.motion_gradient(scene, own["q0"], own["qd0"], **many)
    parts = rne.motion_gradient(scene, own["q0"], own["qd0"], **many, memory=500)  # one step or two
    np.testing.assert_array_equal(parts.value, value)
    for name in names:
        np.testing.assert_allclose(
            parts.gradient[name], gradient[name], rtol=0, atol=SAME_MOTION * abs(gradient[name]).max()
        )


def test_steps_are_taken_some_at_a_time_and_told_both_ways(monkeypatch):
    """As Ctrl-C is handled between them: the gradient is that of all steps at once."""
    scene, names, _ = asked("delay 0.013")
    how, told = {**USUAL, **COSTS, "wrt": [*names, "delay"]}, []
    expected = rne.motion_gradient(scene, *start(scene), **how)
    monkeypatch.setattr(module, "MOST_AT_ONCE", 2)
    found = rne.motion_gradient(scene, *start(scene), **how, progress=lambda *done: told.append(done))
    np.testing.assert_array_equal(found.value, expected.value)
    for name, slopes in expected.gradient.items():
        np.testing.assert_allclose(found.gradient[name], slopes, rtol=0, atol=SAME_MOTION * abs(slopes).max())
    assert {total for _, total in told} == {told[-1][0]}
    assert set(np.diff([0, *(done for done, _ in told)])) == {1, 2}  # steps, of an odd number each way


CONTROLLED = [
    ("springs", "DOP853"),
    ("friction: all", "RK23"),
    ("limits", "DOP853"),
    ("friction: all", "DOP853"),
    ("friction: all", "RK45"),
    ("couplings", "DOP853"),
    ("elastic, both", "DOP853"),
    ("delay 0.013", "Tsit5"),
    ("delay 0.013", "DOP853"),
    ("reference: hold", "Tsit5"),
    ("pid, sampled", "RK45"),
]


@pytest.mark.parametrize(("name", "method"), kept(CONTROLLED, CONTROLLED[:1]))
def test_steps_that_are_controlled_are_differentiated_as_they_were(name, method, monkeypatch):
    scene, names, _ = asked(name)
    take, taken = module.steps_taken, []
    monkeypatch.setattr(module, "steps_taken", lambda *given, **how: taken.append(take(*given, **how)) or taken[-1])
    given = {**COSTS, "wrt": names, "duration": 0.044, "method": method}
    found = rne.motion_gradient(scene, *start(scene), **given)
    *_, ends = taken[0]
    assert_same(*found, by_complex_steps(scene, *start(scene), **given, ends=ends))


@pytest.mark.parametrize(
    "name", kept(["friction: all", "delay 0.013", "elastic, link", "reference: hold"], ["delay 0.013"])
)
def test_value_is_of_the_motion_that_simulate_computes(name):
    scene = CASES[name][0]
    weights = np.linspace(1.0, 2.0, scene.n)
    motion = rne.simulate(scene, *start(scene), 0.09)
    found = rne.motion_gradient(scene, *start(scene), 0.09, None, lambda q, qd: weights @ q + weights @ qd, wrt="q0")
    expected = weights @ motion.q[-1] + weights @ motion.qd[-1]
    assert abs(found.value - expected) <= 100 * SAME_MOTION * abs(expected)  # the motion, with its growth


MACHINE = ["friction: all", "delay 0.013", "elastic, link", "reference: linear", "pid, sampled"]


@pytest.mark.long
@pytest.mark.parametrize("name", MACHINE)
def test_machine_code_gives_the_same(name):
    scene, names, _ = asked(name)
    fast = replace(scene, robot=rne.Robot(scene.robot.model, "numba"))
    own = different(scene, names, 3)
    numbers = {k: x for k, x in own.items() if k not in ("q0", "qd0")}
    one = {**USUAL, **COSTS, "wrt": [*names, *["delay"][: scene.delay is not None]]}
    for starts, given in ((start(scene), one), ((own["q0"], own["qd0"]), {**one, "numbers": numbers, "memory": 3000})):
        found, expected = (rne.motion_gradient(s, *starts, **given) for s in (fast, scene))
        np.testing.assert_allclose(found.value, expected.value, rtol=SAME_STEPS, atol=0)
        for key, slopes in expected.gradient.items():
            np.testing.assert_allclose(found.gradient[key], slopes, rtol=0, atol=SAME_STEPS * abs(slopes).max())


class TestLaws:
    def test_gradient_of_a_sum_is_the_sum_of_gradients(self):
        scene, names, _ = asked("pid, sampled")
        together, *alone = (
            rne.motion_gradient(scene, *start(scene), **USUAL, **costs, wrt=names)
            for costs in (COSTS, {"cost": cost}, {"final": final})
        )
        assert together.value == pytest.approx(sum(part.value for part in alone), rel=SAME_STEPS)
        for name, slopes in together.gradient.items():
            total = sum(part.gradient[name] for part in alone)
            np.testing.assert_allclose(slopes, total, rtol=0, atol=SAME_STEPS * abs(total).max())

    def test_energy_that_is_kept_has_at_the_end_the_gradient_of_the_start(self):
        robot, (q, qd) = arm(), start(CASES["limits"][0])
        scene = rne.Scene(robot, springs=[rne.Spring.at_joint("joint1", 30.0, 0.5)])

        def energy(q, qd):
            return robot.kinetic_energy(q, qd) + robot.potential_energy(q) + 15.0 * (q[1] - 0.5) ** 2

        found = rne.motion_gradient(scene, q, qd, 0.1, final=energy, wrt=["q0", "qd0"], rtol=1e-8)
        steps = np.split(np.concatenate([q, qd]) + 1e-30j * np.eye(4), 2, axis=1)
        expected = np.array([energy(*state).imag / 1e-30 for state in zip(*steps, strict=True)])
        slopes = np.concatenate([*found.gradient.values()])
        np.testing.assert_allclose(slopes, expected, rtol=0, atol=CONTROLLED_ERROR * abs(expected).max())

    def test_parameters_of_which_torques_do_not_depend_have_no_derivative(self):
        scene = CASES["parameters"][0]
        base = scene.resolved.robot.base_parameters()
        slope = rne.motion_gradient(scene, *start(scene), **USUAL, **COSTS, wrt="parameters").gradient["parameters"]
        unseen = np.eye(20) - np.linalg.pinv(base.matrix) @ base.matrix
        assert abs(slope).max() > 0.1
        np.testing.assert_allclose(unseen @ slope, 0, atol=SAME_STEPS * abs(slope).max())

    def test_motion_in_two_halves_obeys_the_chain_rule(self):
        scene, names, _ = asked("pd_gravity")  # sampled, without memory and time
        how = {"step": 0.005, "wrt": names, "cost": lambda t, q, qd, tau: (q * q).sum(-1) + (tau * qd).sum(-1)}
        whole = rne.motion_gradient(scene, *start(scene), 0.04, final=final, **how)
        middle = by_complex_steps(scene, *start(scene), 0.02, **{**how, "wrt": ()}).end
        second = rne.motion_gradient(scene, middle[:2], middle[2:], 0.02, final=final, **how)
        slopes = second.gradient["q0"], second.gradient["qd0"]
        first = rne.motion_gradient(
            scene, *start(scene), 0.02, final=lambda q, qd: slopes[0] @ q + slopes[1] @ qd, **how
        )
        for name in names:
            total = first.gradient[name] + (0.0 if name in ("q0", "qd0") else second.gradient[name])
            np.testing.assert_allclose(whole.gradient[name], total, rtol=0, atol=SAME_STEPS * abs(total).max())

    def test_derivative_by_the_delay_is_what_ever_closer_differences_approach(self):
        scene = replace(CASES["delay 0.0273"][0], effort_limit=None, torque_rate=None)  # without kinks
        shifts = np.array([0.0, 1e-3, -1e-3, 3e-4, -3e-4, 1e-4, -1e-4])
        starts = [np.tile(x, (7, 1)) for x in start(scene)]
        given = {**COSTS, "wrt": "delay", "step": 0.004, "numbers": {"delay": 0.0133 + shifts}}
        found = rne.motion_gradient(scene, *starts, 0.06, **given)
        slopes = (found.value[1::2] - found.value[2::2]) / (2 * shifts[1::2])
        errors = abs(slopes - found.gradient["delay"][0])
        assert abs(found.gradient["delay"][0]) > 1
        assert errors[0] > 8 * errors[1] > 64 * errors[2]  # of second order: 11 and 9 times

    def test_limits_of_zero_have_the_derivative_of_larger_ones(self):
        scene, given = CASES["delay 0.0273"][0], {**USUAL, **COSTS, "wrt": "effort_limit"}
        starts = [np.tile(x, (2, 1)) for x in start(scene)]
        value, gradient = rne.motion_gradient(
            scene, *starts, **given, numbers={"effort_limit": [[0.0, 5.0], [1e-6, 5.0]]}
        )
        slope = (value[1] - value[0]) / 1e-6
        assert abs(gradient["effort_limit"][0, 0] - slope) <= 1e-4 * abs(slope)


class TestArguments:
    def gradient(self, scene, *, many=True, **given):
        starts = np.zeros((2, 3, scene.n)) if many else start(scene)
        return rne.motion_gradient(scene, *starts, **USUAL, **{"final": final, "wrt": "q0", **given})

    @pytest.mark.parametrize(
        ("given", "kind", "text"),
        [
            ({"wrt": 3}, TypeError, "`wrt` must be names of numbers, got 3"),
            ({"wrt": ["q0", 3]}, TypeError, "`wrt` must be names of numbers, got 3"),
            ({"progress": 3}, TypeError, r"`progress` must be a function of \(done, total\), got int"),
            ({"final": lambda q, qd: None}, ValueError, "`final` must return one number, got None"),
            (
                {"final": lambda q, qd: q[0] if q[0] > 0 else q[1]},
                TypeError,
                "`final` must be a formula that can be traced: a traced number has no value: a branch.*",
            ),
            (
                {"cost": lambda t, q, qd, tau: q[0] if q[0] > 0 else q[1]},
                TypeError,
                "`cost` must be a formula that can be traced: a traced number has no value: a branch.*",
            ),
            (
                {"wrt": "controller.kq"},
                ValueError,
                "`wrt`: in addition to 'q0' and 'qd0' the scene has the numbers .*; got 'controller.kq'",
            ),
            (
                {"wrt": "controller.robot"},
                ValueError,
                "`wrt`: in addition to 'q0' and 'qd0' the scene has the numbers .*; got 'controller.robot'",
            ),
            (
                {"final": None},
                ValueError,
                "^`cost` or `final` must be given: without both there is nothing to differentiate$",
            ),
            ({"method": "RK45"}, ValueError, "`method` must be .*, got 'RK45'; leave `step` out for others"),
            ({"numbers": [3.0]}, TypeError, "`numbers` must be a mapping of names to arrays, got list"),
            (
                {"numbers": {"friction.load": np.full((3, 2), 2.0)}},
                ValueError,
                r"`numbers\['friction.load'\]` must be below 1",
            ),
            (
                {"numbers": {"friction.smoothing": [0.1, 0.0, 0.1]}},
                ValueError,
                "the motion cannot be differentiated: dry `friction` sticks and slips by events",
            ),
            (
                {"final": lambda q, qd: 1e200 * (1e200 + q[0])},
                rne.NotFiniteError,
                "^final overflows .* is not finite at state .0,.$",
            ),
        ],
    )
    def test_errors_name_what_is_wrong(self, given, kind, text):
        with pytest.raises(kind, match=text):
            self.gradient(CASES["friction: coulomb"][0], **given)

    def test_starts_are_of_one_motion_or_of_many(self):
        scene = CASES["friction: coulomb"][0]
        text = r"^`q0` and `qd0` must both have shape \(2,\) or \(N, 2\), got \(2,\) and \(1, 2\)$"
        with pytest.raises(ValueError, match=text):
            rne.motion_gradient(scene, np.zeros(2), np.zeros((1, 2)), **USUAL, final=final, wrt="q0")

    def test_no_torques_are_added_to_those_of_a_controller(self):
        with pytest.raises(ValueError, match=r"^`torque` cannot be given for a scene that has a controller$"):
            self.gradient(CASES["pid, sampled"][0], torque=[1.0, 2.0])

    def test_steps_too_long_for_friction_are_doubted(self):
        """Friction of 1e6 N m s/rad stops a link in much less than a step."""
        scene = rne.Scene(arm(), friction=rne.Friction(viscous=1e6))
        text = (
            "motion 0 at t = 0.02 s: the right-hand side overflows float64 for these arguments; the result is not finite; "
            "steps of 0.01 s may be too long for the fastest decay"
        )
        with pytest.raises(rne.NotFiniteError, match=f"^{re.escape(text)}$"):
            rne.motion_gradient(scene, *np.full((2, 2, 2), 0.1), 0.1, final=final, wrt="q0", step=0.01)

    def test_times_at_which_a_law_jumps_are_refused(self):
        scene = CASES["a law that jumps"][0]
        assert "controller.breaks" in scene.numbers
        text = "steps end at 'controller.breaks': it can be neither in `wrt` nor differ from motion to motion"
        for given in ({"wrt": "controller.breaks"}, {"numbers": {"controller.breaks": np.full((3, 2), 0.02)}}):
            with pytest.raises(ValueError, match=text):
                self.gradient(scene, **given)

    @pytest.mark.parametrize(("kind", "given", "late"), [("cubic", {}, 0.004), ("hold", SAMPLED, 0.014)])
    def test_motions_beyond_the_samples_that_a_law_follows_are_refused(self, kind, given, late):
        """A sampled law needs none behind its last sample."""
        scene = rne.Scene(arm(), controller=rne.control.pd(arm(), [80, 90], [3, 2], samples(kind)), **given)
        how = {"wrt": "q0", "step": 0.01, "final": final}
        rne.motion_gradient(scene, *start(scene), 0.1 + late - 0.004, **how)
        with pytest.raises(ValueError, match=r"`t` must be within the samples, 0 to 0\.1 s, got 0\.1"):
            rne.motion_gradient(scene, *start(scene), 0.1 + late, **how)

    def test_one_number_is_that_of_all_joints_and_motions(self):
        scene = CASES["friction: coulomb"][0]
        found, expected = (
            self.gradient(scene, wrt="friction.coulomb", numbers={"friction.coulomb": x})
            for x in (2.0, np.full((3, 2), 2.0))
        )
        np.testing.assert_array_equal(found.gradient["friction.coulomb"], expected.gradient["friction.coulomb"])

    def test_no_motions_have_no_derivatives(self):
        scene, starts = CASES["friction: coulomb"][0], np.zeros((2, 0, 2))
        found = rne.motion_gradient(scene, *starts, **USUAL, final=final, wrt=["q0", "friction.smoothing", "gravity"])
        shapes = {name: x.shape for name, x in found.gradient.items()}
        assert found.value.shape == (0,)
        assert shapes == {"q0": (0, 2), "friction.smoothing": (0,), "gravity": (0, 3)}

    @pytest.mark.parametrize("delay", [0.05, 1e9])
    def test_commands_that_never_act_have_no_derivatives(self, delay):
        scene = replace(CASES["delay 0.0273"][0], delay=delay)
        found = self.gradient(scene, many=False, wrt=["delay", "controller.kp", "q0"])
        assert found.gradient["delay"] == 0
        assert not found.gradient["controller.kp"].any()
        assert found.gradient["q0"].all()


def test_commands_are_bounded_by_loops_as_by_whole_arrays():
    rng, inf = np.random.default_rng(0), np.inf
    for is_first in (True, False):
        u, before = rng.normal(size=(2, 50)).round(1)
        limits = np.where(rng.random((2, 50)) < 0.3, inf, abs(rng.normal(size=(2, 50))).round(1))
        found, expected = np.empty((2, 2, 50))
        frozen_steps._bound(u, before, limits, is_first, *found)
        frozen_steps.bound(u, before, limits, is_first, *expected)
        np.testing.assert_array_equal(found, expected)
        assert {*expected[1]} >= ({-1, 0, 1} if is_first else {-2, -1, 0, 1, 2})
