"""Steps of a control interval: equal to motions, differentiable, whoever computes them."""

import pickle
import re
import sys
from dataclasses import replace

import numpy as np
import pytest

import rne
from benchmarks.peers.mujoco import MuJoCo

from .helpers import Part, assemble, kept
from .random_robots import random_tree, straight_chain

STEPS = 1e-8  # error of steps of 1 ms and shorter, of motions of a few rad/s
DIFFERENCE = 1e-7  # of central differences relative to the largest slope: eps to the power 2/3, times a few 100
ROUNDING = 1e-11  # of states of a few rad and rad/s: sums in another order
LIMIT = [6.0, 3.0]  # N m; some of the torques drawn are beyond
FRICTION = rne.Friction(viscous=[0.4, 0.2], coulomb=[0.5, 0.3], smoothing=0.5, saturation=[2.0, 0])
UNEQUAL = replace(FRICTION, viscous_back=[0.3, 0.5])
REFERENCE = rne.trajectories.sampled(np.linspace(0, 1, 5), np.random.default_rng(3).normal(size=(5, 2)) * 0.3)


def chain(engine="numpy", **parts):
    """Two rods of 0.3 m and 1 kg with friction, whose kernels are small."""
    return rne.Scene(rne.Robot(straight_chain(2), engine), **{"friction": FRICTION, "armature": 0.05} | parts)


def sampled(engine="numpy", law="pd", **parts):
    """The same under a law that is sampled every 10 ms."""
    robot = rne.Robot(straight_chain(2), engine)
    laws = {
        "pd": lambda: rne.control.pd_gravity(robot, [20, 10], [3, 1], [0.3, -0.2]),
        "pid": lambda: rne.control.pid(robot, [20, 10], [15, 8], [3, 1], [0.3, -0.2]),
        "reference": lambda: rne.control.computed_torque(robot, [50, 50], [10, 10], REFERENCE),
    }
    return chain(engine, **{"controller": laws[law](), "sample_time": 0.01, "effort_limit": LIMIT} | parts)


def drawn(stepper, count=3, seed=0):
    """States, torques and weights."""
    rng, n = np.random.default_rng(seed), stepper.scene.n
    x = rng.uniform(-1, 1, (count, stepper.size))
    return x, rng.uniform(-8, 8, (count, n)) if stepper.scene.controller is None else None, rng.normal(size=x.shape)


def slope_error(stepper, numbers, t=0.0, step=1e-5):
    """The error of a gradient against central differences in one direction for each state, relative to the largest."""
    (x, u, W), rng = drawn(stepper), np.random.default_rng(1)
    given = {"x": x} | ({} if u is None else {"u": u}) | {name: np.asarray(v, float) for name, v in numbers.items()}
    along = {name: rng.normal(size=np.shape(value)) for name, value in given.items()}

    def cost(h):
        moved = {name: value + h * along[name] for name, value in given.items()}
        own = {name: moved[name] for name in numbers}
        return (W * stepper(moved["x"], moved.get("u"), own, t=t)).sum(1)

    slopes = stepper.gradient(x, u, W, numbers, t=t)
    assert {name: a.shape[1:] for name, a in slopes.items()} == {
        name: np.shape(a)[name in ("x", "u") :] for name, a in given.items()
    }
    found = sum((slopes[name] * along[name]).reshape(len(x), -1).sum(1) for name in given)
    expected = (cost(step) - cost(-step)) / (2 * step)
    return abs(found - expected).max() / abs(expected).max()


@pytest.mark.parametrize("method", ["rk4", "tsit5"])
def test_an_interval_of_constant_torques_is_a_motion(method):
    stepper = rne.Stepper(chain(effort_limit=LIMIT), 0.02, substeps=20, method=method)
    x, u, _ = drawn(stepper, count=2)
    assert (abs(u) > LIMIT).any()
    for row, torque, end in zip(x, u, stepper(x, u), strict=True):
        motion = rne.simulate(stepper.scene, row[:2], row[2:], 0.02, torque=torque, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(end, [*motion.q[-1], *motion.qd[-1]], rtol=0, atol=STEPS)


LAWS = kept(
    [(law, delay) for law in ("pd", "pid", "reference") for delay in (None, 0.004, 0.01, 0.023, 0.03)],
    [("pid", 0.023)],
)


@pytest.mark.parametrize(("law", "delay"), LAWS)
def test_intervals_of_a_sampled_law_are_a_motion(law, delay):
    """Commands wait, the oldest first, and one acts beyond its interval where the delay is no whole number of them."""
    scene = sampled(law=law, delay=delay)
    stepper = rne.Stepper(scene, substeps=10)
    waiting = {None: 0, 0.004: 1, 0.01: 1, 0.023: 3, 0.03: 3}[delay]
    assert stepper.size == 4 + 2 * (law == "pid") + 2 * waiting
    x = stepper.start([0.3, -0.5], [0.4, 0.2])
    for k in range(8):
        x = stepper(x, t=0.01 * k)
    motion = rne.simulate(scene, [0.3, -0.5], [0.4, 0.2], 0.08, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(x[:4], [*motion.q[-1], *motion.qd[-1]], rtol=0, atol=STEPS)


def test_each_state_has_its_time():
    stepper = rne.Stepper(sampled(law="reference"))
    x, _, _ = drawn(stepper)
    times = np.array([0.1, 0.5, 0.93])
    each = [stepper(row, t=t) for row, t in zip(x, times, strict=True)]
    np.testing.assert_allclose(stepper(x, t=times), each, rtol=0, atol=ROUNDING)
    with pytest.raises(ValueError, match="`t` must be within the samples, 0 to 1 s, got 2"):
        stepper(x, t=2.0)


def test_implicit_friction_of_eulers_rule():
    """(M + h D) (qd+ - qd) = h (tau - friction - bias), D the slope of viscous friction; then q+ = q + h qd+."""
    scene, h = chain(friction=UNEQUAL), 0.01
    stepper, robot = rne.Stepper(scene, h, method="semi-implicit-euler"), scene.resolved.robot
    x, u, _ = drawn(stepper, count=4)
    for row, torque, end in zip(x, u, stepper(x, u), strict=True):
        q, qd = row[:2], row[2:]
        slope = np.where(qd < 0, UNEQUAL.viscous_back, UNEQUAL.viscous) * [1 / np.cosh(qd[0] / 2) ** 2, 1]
        rest = torque - UNEQUAL.torque(robot.model, qd) - robot.bias_torque(q, qd)
        after = qd + h * np.linalg.solve(robot.mass_matrix(q) + h * np.diag(slope), rest)
        np.testing.assert_allclose(end, [*(q + h * after), *after], rtol=0, atol=ROUNDING)


def test_implicit_friction_is_stable_at_any_step():
    """Over 0.1 s a decay of 50 N m s over some 0.1 kg m^2 throws an explicit step far out."""
    scene, after = chain(friction=rne.Friction(viscous=50.0), gravity=[0, 0, 0]), {}
    for method in ("semi-implicit-euler", "rk4"):
        after[method] = rne.Stepper(scene, 0.1, method=method)([0.3, 0.2, 1.0, -1.0], [0, 0])
    assert abs(after["semi-implicit-euler"][2:]).max() < 0.1
    assert abs(after["rk4"][2:]).max() > 1e3


SPRING = rne.Spring("root", [0.1, 0, 0], "rod1", [0, 0.1, 0], 50.0, 0.1)
CASES = {
    "torques": lambda: (chain(effort_limit=LIMIT), {"friction.viscous": FRICTION.viscous, "effort_limit": LIMIT}),
    "euler": lambda: (chain(), {"friction.viscous": FRICTION.viscous, "gravity": [0, 0, -9.81]}),
    "delay": lambda: (sampled(law="pid", delay=0.023), {"controller.ki": [15, 8], "effort_limit": LIMIT}),
    "samples": lambda: (sampled(law="reference", delay=0.004), {"controller.reference": REFERENCE.samples}),
    "continuous": lambda: (sampled(law="reference", sample_time=None, effort_limit=None), {"controller.kp": [50, 50]}),
    "elastic": lambda: (
        chain(elastic=rne.ElasticJoints(100.0, 0.5, 0.1), armature=None),
        {"elastic.stiffness": [100, 100], "elastic.rotor": [0.1, 0.1]},
    ),
    "bodies": lambda: (
        chain(springs=[SPRING], payload=rne.Payload(0.3, [0.1, 0, 0], 0.01 * np.eye(3))),
        {"springs[0].stiffness": 50.0, "payload": [0.3, 0.03, 0, 0, 0.01, 0, 0.013, 0, 0, 0.013]},
    ),
    "articulated bodies": lambda: (
        rne.Scene(rne.Robot(straight_chain(21)), friction=rne.Friction(viscous=2.0)),
        {"friction.viscous": np.full(21, 2.0)},
    ),
    "mimics": lambda: (
        rne.Scene(rne.Robot(random_tree(3, seed=3, branching=0.4, mimics=2)), friction=rne.Friction(viscous=2.0)),
        {"friction.viscous": [2, 2, 2]},
    ),
}
SLOPES = [("torques", "rk4"), ("euler", "semi-implicit-euler"), ("delay", "rk4"), ("samples", "tsit5")]
SLOPES += [
    (name, method) for name in CASES for method in ("rk4", "semi-implicit-euler") if (name, method) not in SLOPES
]


@pytest.mark.parametrize(("name", "method"), kept(SLOPES, SLOPES[:4]))
def test_gradients_are_those_of_differences(name, method):
    scene, numbers = CASES[name]()
    stepper = rne.Stepper(scene, scene.sample_time or 0.01, substeps=2, method=method)
    assert slope_error(stepper, numbers, t=0.3 if "reference" in str(scene.controller) else 0.0) < DIFFERENCE


def limited():
    """A scene whose joints range over +-0.5 rad."""
    model = replace(straight_chain(2), lower=[-0.5] * 2, upper=[0.5] * 2)
    return rne.Scene(rne.Robot(model, "numpy"), friction=FRICTION)


def test_position_stops_end_an_interval_within_the_ranges():
    x = np.array([[0.49, 0.1, 3.0, -0.2], [-0.49, 0.49, -3.0, 9.0], [0.6, 0, -3.0, 0]])
    u, W = np.zeros((3, 2)), np.random.default_rng(0).normal(size=(3, 4))
    free, stopped = (rne.Stepper(limited(), 0.02, position_stops=stops) for stops in (False, True))
    y = free(x, u)
    outside = np.clip(y[:, :2], -0.5, 0.5) != y[:, :2]
    assert outside.tolist() == [[True, False], [True, True], [True, False]]
    leaving = outside & (np.sign(y[:, 2:]) == np.sign(y[:, :2]))
    assert leaving.tolist() == [[True, False], [True, True], [False, False]]  # the last comes back from outside
    expected = np.hstack([np.clip(y[:, :2], -0.5, 0.5), np.where(leaving, 0.0, y[:, 2:])])
    np.testing.assert_array_equal(stopped(x, u), expected)
    kept_of = np.hstack([~outside, ~leaving])
    for name, slope in stopped.gradient(x, u, W).items():
        np.testing.assert_array_equal(slope, free.gradient(x, u, W * kept_of)[name])


def test_jacobians_have_the_gradients_as_rows():
    stepper = rne.Stepper(sampled(law="reference", delay=0.004))
    x, u, W = drawn(stepper)
    J, t = stepper.jacobian(x, u, t=[0.1, 0.2, 0.3]), np.array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(np.einsum("ni,nij->nj", W, J), stepper.gradient(x, u, W, t=t)["x"], atol=ROUNDING)
    np.testing.assert_array_equal(stepper.jacobian(x, u), stepper.jacobian(x, u, t=0.0))
    assert np.abs(stepper.jacobian(x, u) - J).max() > 0.1  # the law depends on time
    assert rne.Stepper(chain(), 0.01).jacobian(np.zeros(4), np.zeros(2)).shape == (4, 6)


def test_numbers_are_those_of_a_scene_that_has_them():
    stepper, numbers = rne.Stepper(sampled()), {"friction.viscous": [0.8, 0.1], "effort_limit": [1.0, 2.0]}
    x, _, _ = drawn(stepper)
    found, other = stepper(x, numbers=numbers), rne.Stepper(stepper.scene.with_numbers(numbers))(x)
    np.testing.assert_allclose(found, other, rtol=0, atol=ROUNDING)
    own = {name: np.array([stepper.scene.numbers[name], value, value]) for name, value in numbers.items()}
    np.testing.assert_allclose(stepper(x, numbers=own)[1:], found[1:], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(stepper(x, numbers=own)[0], stepper(x)[0], rtol=0, atol=ROUNDING)
    own["effort_limit"][2] = 0.5  # in place: those given last are not taken for them
    assert abs(stepper(x, numbers=own)[2] - found[2]).max() > 1e-3

    with pytest.raises(ValueError, match=r"must have shape \(2, 2\), got \(3, 2\)"):  # known, but of three states
        stepper(x[:2], numbers=own)


def test_limits_that_are_infinite_are_none():
    numbers, free = {"effort_limit": np.inf}, rne.Stepper(chain(), 0.01)
    stepper = rne.Stepper(chain(effort_limit=LIMIT), 0.01)
    x, u, W = drawn(stepper)
    np.testing.assert_allclose(stepper(x, u, numbers), free(x, u), rtol=0, atol=ROUNDING)
    assert not stepper.gradient(x, u, W, numbers)["effort_limit"].any()
    given = {"final": lambda q, qd: q[0], "wrt": "effort_limit", "torque": u[0], "step": 0.01, "numbers": numbers}
    value, slopes = rne.motion_gradient(stepper.scene, x[0, :2], x[0, 2:], 0.01, **given)
    assert value == pytest.approx(free(x[0], u[0])[0], abs=ROUNDING)
    assert not slopes["effort_limit"].any()


def test_no_states_have_no_derivatives():
    stepper, x, u = rne.Stepper(chain(), 0.01), np.zeros((0, 4)), np.zeros((0, 2))
    for viscous in ([0.4, 0.2], u):
        slopes = stepper.gradient(x, u, 1.0, {"friction.viscous": viscous})
        assert {name: a.shape for name, a in slopes.items()} == {"x": (0, 4), "u": (0, 2), "friction.viscous": (0, 2)}
    assert stepper.jacobian(x, u).shape == (0, 4, 6)


def test_states_begin_and_begin_anew():
    stepper = rne.Stepper(sampled(law="pid", delay=0.023))
    x = stepper.start(np.ones((3, 2)), np.zeros(2))
    assert x.tolist() == [[1, 1, 0, 0, *[0] * 8]] * 3
    x += 1
    assert stepper.reset(x, [True, False, True], np.arange(12)) is x
    assert x[[0, 2]].tolist() == [[*range(12)]] * 2
    assert x[1].tolist() == [2, 2, 1, 1, *[1] * 8]
    elastic = chain(elastic=rne.ElasticJoints(100.0, 0.5, 0.1), armature=None)
    held = rne.Stepper(elastic, 0.01).start([0.3, 0.2], [0, 0])
    np.testing.assert_allclose(held[2:4] - held[:2], elastic.resolved.robot.gravity_torque([0.3, 0.2]) / 100)


def test_into_is_a_call_in_place_too():
    stepper = rne.Stepper(chain(), 0.02)
    x, u, _ = drawn(stepper)
    expected, out = stepper(x, u), np.empty_like(x)
    assert stepper.into(x, u, out) is out
    assert (out == expected).all()
    assert (stepper.into(x, u, x) == expected).all()


def test_a_stepper_pickles_and_says_what_it_is():
    stepper = rne.Stepper(chain(), 0.02, substeps=2)
    x, u, _ = drawn(stepper)
    assert (pickle.loads(pickle.dumps(stepper))(x, u) == stepper(x, u)).all()
    assert repr(stepper) == "Stepper of 'chain2' under torques: states of 4, 0.02 s in steps of 0.01 s by rk4"


REFUSED = {
    "`sample_time` must be given: the scene has none": lambda: rne.Stepper(chain()),
    "`sample_time` must be that of the scene, 0.01 s, or left out, got 0.02": lambda: rne.Stepper(sampled(), 0.02),
    "`substeps` must be a whole number above zero, got 0": lambda: rne.Stepper(chain(), 0.01, 0),
    "`method` must be one of ['rk4', 'tsit5', 'semi-implicit-euler'], got 'euler'": lambda: rne.Stepper(
        chain(), 0.01, method="euler"
    ),
    "the scene cannot be stepped from its state alone: `stops` end a run: set `stops` to False": lambda: rne.Stepper(
        chain(stops=True), 0.01
    ),
    "the scene cannot be stepped from its state alone: dry `friction` sticks and slips by events: give it a "
    "`smoothing` above 0": lambda: rne.Stepper(chain(friction=rne.Friction(coulomb=1.0, smoothing=0)), 0.01),
    "the scene cannot be stepped from its state alone: `controller` is called, as it is not marked by "
    "rne.traceable: mark it by rne.traceable": lambda: rne.Stepper(chain(controller=lambda t, q, qd: -qd), 0.01),
    "the scene cannot be stepped from its state alone: `torque_rate` needs the previous command: leave it out, "
    "or bound what the law gives": lambda: rne.Stepper(sampled(torque_rate=10.0)),
    "`u` must be given, torques of shape (2,) or (N, 2): the scene has no controller": lambda: rne.Stepper(
        chain(), 0.01
    )([0] * 4),
    "`u` cannot be given for a scene that has a controller": lambda: rne.Stepper(sampled())([0] * 4, [0, 0]),
    "`u` must have shape (2,) or (3, 2), got (4, 2)": lambda: rne.Stepper(chain(), 0.01)(
        np.zeros((3, 4)), np.zeros((4, 2))
    ),
    "`x` must be real, of shape (4,) or (N, 4), got (3, 5)": lambda: rne.Stepper(sampled())(np.zeros((3, 5))),
    "`t` must be one number or of shape (3,), got (2,)": lambda: rne.Stepper(sampled())(np.zeros((3, 4)), t=[0, 1]),
    "`numbers` cannot have 'delay', on which the state depends: make another Stepper": lambda: rne.Stepper(
        sampled(delay=0.01)
    )([0] * 6, numbers={"delay": 0.02}),
    "`x` must have shape (4,) or (N, 4), got (1, 2, 4)": lambda: rne.Stepper(sampled()).into(
        np.zeros((1, 2, 4)), None, np.zeros((1, 2, 4))
    ),
    "`weights` must have shape (4,) or (3, 4), got (3,)": lambda: rne.Stepper(sampled()).gradient(
        np.zeros((3, 4)), weights=np.ones(3)
    ),
    "`t` must be one number for derivatives by the samples of a motion": lambda: rne.Stepper(
        sampled(law="reference")
    ).gradient(np.zeros((2, 4)), numbers={"controller.reference": np.zeros((5, 2))}, t=[0.0, 0.1]),
    "`numbers` must have the samples of a motion once for all states": lambda: rne.Stepper(sampled(law="reference"))(
        np.zeros((2, 4)), numbers={"controller.reference": np.zeros((2, 5, 2))}
    ),
    "`numbers['friction.smoothing']` must be above 0": lambda: rne.Stepper(chain(), 0.01)(
        np.zeros((2, 4)), [0, 0], {"friction.smoothing": [0.1, 0]}
    ),
    "`mask` must be bool of shape (2,), got int64 of (2,)": lambda: rne.Stepper(chain(), 0.01).reset(
        np.zeros((2, 4)), [0, 1], np.zeros(4)
    ),
    "`out` must be a float64 array of shape (4,), got float64 (3,)": lambda: rne.Stepper(chain(), 0.01).into(
        np.zeros(4), np.zeros(2), np.zeros(3)
    ),
    "`x` must be a float64 array of shape (2, 4), got int64 (2, 4)": lambda: rne.Stepper(chain(), 0.01).reset(
        np.zeros((2, 4), int), [True, False], np.full(4, 0.5)
    ),
    "`out` must be `x` itself or have none of its memory": lambda: (
        lambda a: rne.Stepper(chain(), 0.01).into(a[1:], np.zeros((2, 2)), a[:-1])
    )(np.zeros((3, 4))),
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_cannot_be_is_refused_with_its_cure(text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        REFUSED[text]()


@pytest.mark.parametrize("method", ["__call__", "gradient", "jacobian"])
def test_numbers_without_names_are_refused(method):
    stepper = rne.Stepper(chain(), 0.01)
    with pytest.raises(TypeError, match=r"^`numbers` must be a mapping of names to arrays, got list$"):
        getattr(stepper, method)(np.zeros(4), np.zeros(2), numbers=[1.0])


@pytest.mark.parametrize("engine", kept(["numpy", "numba"], ["numpy"]))
def test_a_state_at_fault_is_named(engine):
    stepper = rne.Stepper(chain(engine, effort_limit=LIMIT), 0.01)
    x, u, W = drawn(stepper, 20)
    for name, array, text in (("x", x, "`x` is not finite"), ("u", u, "`u` must be finite, got nan at index (13, 1)")):
        bad = {"x": x, "u": u} | {name: array.copy()}
        bad[name][13, 1] = np.nan
        for call in (stepper, lambda x, u: stepper.gradient(x, u, W)):
            with pytest.raises(ValueError, match=f"^{re.escape(text)}") as error:
                call(bad["x"], bad["u"])
            assert name == "u" or (isinstance(error.value, rne.NotFiniteError) and error.value.state == (13,))
    u[13, 1] = np.inf  # which a limit would hide
    with pytest.raises(rne.NotFiniteError, match=r"^`u` is not finite at state \(13,\)$"):
        stepper.into(x, u, np.empty_like(x))
    x[7, 3] = 1e200
    with pytest.raises(rne.NotFiniteError, match=r"overflows .* at state \(7,\)$"):
        stepper(x, 0 * u[0])


def test_a_result_that_overflows_is_named():
    """The position, from one near the largest double at such a rate; nothing moves by itself."""
    rail = Part(link="cart", joint="rail", kind="prismatic", parent=0, axis=np.array([1.0, 0, 0]), mass=1.0)
    stepper = rne.Stepper(
        rne.Scene(rne.Robot(assemble("cart", [Part(link="root"), rail]))), 1.0, method="semi-implicit-euler"
    )
    with pytest.raises(rne.NotFiniteError, match=r"^the result overflows at state \(1,\)$"), np.errstate(over="ignore"):
        stepper([[0.0, 0.0], [1.7e308, 1e308]], [0.0])


def test_a_singular_mass_matrix_names_the_state():
    """Of a point mass on the last axis."""
    arm = {"a": [0.5, 0.0], "alpha": [np.pi / 2, 0.0], "d": [0.0, 0.2], "theta": [0.0, 0.0], "masses": [1.0, 0.2]}
    robot = rne.Robot(rne.dh_chain(**arm, centres=[[0.0] * 3] * 2, inertias=[[0.1] * 3, [0.0] * 3]))
    told = "nothing with inertia moves with 'joint_2'"
    for x, state in ((np.zeros(4), ""), (np.zeros((2, 4)), " at state (0,)")):
        text = f"at t = 0 s: M is singular{state}: {told}"
        with pytest.raises(rne.SingularMassMatrixError, match=f"^{re.escape(text)}$"):
            rne.Stepper(rne.Scene(robot), 0.01)(x, [0.0, 0.0])
    text = f"motion 0 at t = 0 s: M is singular: {told}"
    with pytest.raises(rne.SingularMassMatrixError, match=f"^{re.escape(text)}$"):
        rne.motion_gradient(robot, *np.zeros((2, 3, 2)), 0.1, final=lambda q, qd: q[0], wrt="q0", step=0.01)


def test_exports_to_jax_need_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(ImportError, match=r"^`to_jax` needs JAX, which is not installed: pip install 'rne\[jax\]'$"):
        rne.Stepper(chain(), 0.01).to_jax()


MACHINE = {
    "torques": lambda engine: (chain(engine, effort_limit=LIMIT), {"friction.viscous": [0.3, 0.4]}),
    "delay": lambda engine: (sampled(engine, "pid", delay=0.023), {"effort_limit": [4.0, 3.0]}),
    "samples": lambda engine: (sampled(engine, "reference"), {"controller.reference": REFERENCE.samples * 0.9}),
    "continuous": lambda engine: (sampled(engine, "reference", sample_time=None), {"controller.kp": [40.0, 30.0]}),
}


@pytest.mark.long
@pytest.mark.parametrize("method", ["rk4", "tsit5", "semi-implicit-euler"])
@pytest.mark.parametrize("name", MACHINE)
def test_machine_code_computes_what_numpy_does(name, method):
    """21 states are no whole number of groups."""
    steppers = []
    for engine in ("numba", "numpy"):
        scene, numbers = MACHINE[name](engine)
        steppers.append(rne.Stepper(scene, 0.01, 2, method, position_stops=True))
    (x, u, W), t = drawn(steppers[0], 21), np.linspace(0.1, 0.9, 21)
    rows = {k: np.array([np.asarray(v) * (1 + 0.01 * i) for i in range(21)]) for k, v in numbers.items()}
    for own in ({}, numbers, rows if name != "samples" else numbers):
        times = t if "controller.reference" not in own else 0.3
        found, expected = (s(x, u, own, t=times) for s in steppers)
        np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)
        assert (steppers[0](x, u, own, workers=2, t=times) == found).all()
        slopes, others = (s.gradient(x, u, W, own, t=times) for s in steppers)
        for key, slope in slopes.items():
            np.testing.assert_allclose(slope, others[key], rtol=0, atol=ROUNDING * max(1, abs(slope).max()))
        assert all((a == slopes[k]).all() for k, a in steppers[0].gradient(x, u, W, own, workers=2, t=times).items())
    found = steppers[0](x, u, t=0.3)
    assert (steppers[0](x[4], None if u is None else u[4], t=0.3) == found[4]).all()
    out = x.copy()
    assert steppers[0].into(out, u, out, t=0.3) is out
    assert (out == found).all()


@pytest.mark.long
def test_a_state_that_needs_the_recursion_changes_no_other():
    stepper, x = rne.Stepper(chain("numba"), 1e-5), drawn(rne.Stepper(chain(), 1e-5), 21)[0]
    u, W, fast = np.ones(2), np.ones_like(x), x.copy()
    fast[10, 3] = 9000.0  # beyond the velocity up to which digits are known to be left
    others = np.arange(21) != 10
    for call in (lambda x: stepper(x, u), lambda x: stepper.gradient(x, u, W)["x"]):
        found, expected = call(fast), call(x)
        assert (found[others] == expected[others]).all()
    by_numpy = rne.Stepper(chain(), 1e-5)
    np.testing.assert_allclose(stepper(fast, u)[10], by_numpy(fast[10], u), rtol=1e-12)
    slope = by_numpy.gradient(fast[10], u, W[10])["x"]
    np.testing.assert_allclose(stepper.gradient(fast, u, W)["x"][10], slope, rtol=0, atol=1e-9 * abs(slope).max())


@pytest.mark.long
@pytest.mark.parametrize("method", ["rk4", "semi-implicit-euler"])
def test_constant_torques_are_those_of_an_ensemble(method):
    """Without friction Euler's rule has nothing implicit."""
    stepper = rne.Stepper(rne.Scene(rne.load("ur5", engine="numba"), effort_limit="urdf"), 0.02, 4, method)
    rng = np.random.default_rng(0)
    q, qd, u = rng.uniform(-1, 1, (3, 50, 6)) * [[[1]], [[2]], [[100]]]
    motions = rne.ensemble(stepper.scene, q, qd, 0.02, torque=u, step=0.005, method=method)
    found = stepper(stepper.start(q, qd), u)
    np.testing.assert_allclose(found, np.hstack([motions.q[-1], motions.qd[-1]]), rtol=0, atol=ROUNDING)


@pytest.mark.long
@pytest.mark.parametrize(("method", "theirs"), [("rk4", "RK4"), ("semi-implicit-euler", "EULER")])
def test_steps_are_those_of_mujoco(method, theirs):
    """Whose Euler has implicit damping as well."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    arm = rne.load("ur5")
    scene = rne.Scene(arm, friction=rne.Friction(viscous=40.0), armature=0.1)
    stepper, model = rne.Stepper(scene, 0.005, method=method), MuJoCo(arm.model).model
    model.dof_armature[:], model.dof_damping[:], model.opt.timestep = 0.1, 40.0, 0.005
    model.opt.integrator = int(getattr(mujoco.mjtIntegrator, f"mjINT_{theirs}"))
    rng, data = np.random.default_rng(0), mujoco.MjData(model)
    for q, qd, u in rng.uniform(-1, 1, (5, 3, 6)) * [[1], [1], [40]]:
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, qd, u
        mujoco.mj_step(model, data)
        np.testing.assert_allclose(stepper([*q, *qd], u), [*data.qpos, *data.qvel], rtol=0, atol=ROUNDING)
