"""Derivatives of motions along their steps and by variational equations, against complex steps, adjoints, closed forms."""

import pickle
import re
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
import scipy.integrate

import rne
from rne.integrators import tableaus

from .helpers import Part, assemble, kept
from .random_robots import random_tree, straight_chain

ROUNDING = 1e-12  # of sums in another order, times derivatives of at most some tens
SEEN = 1e-12  # of two sums of products of some hundred factors, relative to the largest
START = np.array([0.3, -0.4]), np.array([-0.8, 0.9])


@pytest.fixture(scope="module")
def chain():
    return rne.Robot(straight_chain(2)).with_armature(0.2)


def relative(found, expected):
    """The largest difference, relative to the largest entry."""
    return np.abs(found - expected).max() / max(np.abs(expected).max(), 1e-12)


def along(found, name):
    """Derivatives of positions and velocities side by side."""
    return np.concatenate([found.dq[name], found.dqd[name]], axis=1)


def complex_motion(robot, viscous, ends, method, times):
    """States at times within frozen steps, (T, 2 n, 3 n), whose imaginary parts are derivatives by q0, qd0, viscous.

    By SciPy's coefficients and its formulas of interpolants.
    """
    n, made = robot.n, tableaus.scipy_class(method)
    seeds = 1e-30j * np.eye(3 * n)
    b = viscous + seeds[:, 2 * n :]

    def rates(x):
        q, qd = x[:, :n], x[:, n:]
        return np.concatenate([qd, rne.dynamics.forward_dynamics(robot.model, q, qd, -b * qd)], axis=1)

    x, found = np.concatenate(START) + seeds[:, : 2 * n], []
    for begin, end in pairwise(ends):
        h, K = end - begin, []
        for row in made.A:
            K.append(rates(x + h * sum((a * k for a, k in zip(row, K, strict=False)), np.zeros_like(x))))
        after = x + h * sum(b * k for b, k in zip(made.B, K, strict=True))
        K.append(rates(after))
        for row in getattr(made, "A_EXTRA", ()):
            K.append(rates(x + h * sum(a * k for a, k in zip(row, K, strict=False))))
        K = np.array(K)
        for t in times[(times >= begin) & ((times < end) | (end == ends[-1]))]:
            u = (t - begin) / h
            if method == "DOP853":
                F = [after - x, h * K[0] - (after - x), 2 * (after - x) - h * (K[12] + K[0])]
                F += list(h * np.tensordot(made.D, K, 1))
                y = np.zeros_like(x)
                for k, f in enumerate(reversed(F)):
                    y = (y + f) * (u if k % 2 == 0 else 1 - u)
                found.append((x + y).T)
            else:
                weights = made.P @ u ** np.arange(1, made.P.shape[1] + 1)
                found.append((x + h * np.tensordot(weights, K, 1)).T)
        x = after
    return np.array(found)


@pytest.mark.parametrize("method", kept(["Tsit5", "RK45", "DOP853"], ["Tsit5", "DOP853"]))
def test_steps_and_interpolants_are_differentiated_exactly(chain, method):
    """Of steps as an explicit method took them, at their ends and inside, by complex steps through the same steps."""
    scene, names = rne.Scene(chain, friction=rne.Friction(viscous=[0.3, 0.5])), ["q0", "qd0", "friction.viscous"]
    ends = rne.simulate(scene, *START, 0.5, method=method).t
    times = np.sort(np.concatenate([ends, [0.013, 0.27, 0.271, 0.499]]))
    found = rne.sensitivities(scene, *START, 0.5, wrt=names, method=method, t_eval=times)
    expected = complex_motion(chain, np.array([0.3, 0.5]), ends, method, times)
    assert relative(np.concatenate([found.q, found.qd], axis=1), expected[..., 0].real) < ROUNDING
    assert relative(np.concatenate([along(found, name) for name in names], axis=2), expected.imag / 1e-30) < ROUNDING
    assert found.message.endswith(f"derivatives of the {len(ends) - 1} steps as they were taken")


def test_equal_steps_are_differentiated_exactly(chain):
    """By complex steps through the classical method's formula; the steps end at times to report."""
    scene = rne.Scene(chain, friction=rne.Friction(viscous=0.4))
    times = np.array([0.0, 0.07, 0.1])
    found = rne.sensitivities(scene, *START, 0.1, wrt=["qd0", "friction.viscous"], step=0.02, t_eval=times)
    seeds = 1e-30j * np.eye(4)
    x, b = np.concatenate(START) + np.pad(seeds[:, :2], ((0, 0), (2, 0))), 0.4 + seeds[:, 2:]

    def rates(x):
        return np.concatenate(
            [x[:, 2:], rne.dynamics.forward_dynamics(chain.model, x[:, :2], x[:, 2:], -b * x[:, 2:])], 1
        )

    for k, h in enumerate([0.0175] * 4 + [0.015] * 2):
        k1 = rates(x)
        k2 = rates(x + h / 2 * k1)
        k3 = rates(x + h / 2 * k2)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(x + h * k3))
        if k == 3:
            inside = x
    for row, state in ((1, inside), (2, x)):
        expected = state.T.imag / 1e-30
        both = np.concatenate([along(found, "qd0"), along(found, "friction.viscous")], axis=2)
        assert relative(both[row], expected) < ROUNDING
    assert (along(found, "qd0")[0] == np.eye(4)[:, 2:]).all()


def mass_on_a_rail(mass=2.0):
    parts = [Part(link="root"), Part(link="cart", joint="rail", kind="prismatic", parent=0, axis=[1, 0, 0], mass=mass)]
    return rne.Robot(assemble("cart", parts))


def test_a_damped_mass():
    """v = v0 exp(-b t / m): derivatives by v0, b and m in closed form."""
    t, b, m, v0 = np.linspace(0, 1, 5), 3.0, 2.0, 0.7
    scene = rne.Scene(mass_on_a_rail(m), friction=rne.Friction(viscous=b), gravity=[0, 0, 0])
    names = ["qd0", "friction.viscous", "parameters", "armature", "gravity"]
    found = rne.sensitivities(scene, [0.0], [v0], 1.0, wrt=names, method="DOP853", rtol=1e-12, atol=1e-14, t_eval=t)
    decay = np.exp(-b * t / m)
    expected = {"qd0": decay, "friction.viscous": -t / m * v0 * decay, "armature": b * t / m**2 * v0 * decay}
    for name, slopes in expected.items():
        np.testing.assert_allclose(found.dqd[name][:, 0, 0], slopes, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.dqd["parameters"][:, 0, 0], expected["armature"], rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.dqd["gravity"][:, 0, 0], m / b * (1 - decay), rtol=0, atol=1e-10)


AT_REST = {
    "rk4": ({"step": 2e-3}, 2e-8),
    "LSODA": ({"method": "LSODA", "rtol": 1e-10, "atol": 1e-12}, 2e-8),
    "DOP853": ({"method": "DOP853"}, 1e-6),  # whose control of errors would allow one step
    "Tsit5": ({"method": "Tsit5"}, 1e-5),
}


@pytest.mark.parametrize("name", AT_REST)
def test_a_pendulum_at_rest_is_a_linear_one(name):
    """dq/dq0 = cos wt and dq/dqd0 = sin wt / w at the equilibrium, where nothing moves that errors are controlled of."""
    how, tolerance = AT_REST[name]
    w, t = np.sqrt(9.81 * 0.15 / (0.3**2 / 3)), np.linspace(0, 0.5, 6)
    rod = rne.Robot(straight_chain(1))
    found = rne.sensitivities(rod, [0.0], [0.0], 0.5, wrt=["q0", "qd0"], t_eval=t, **how)
    expected = {"q0": (np.cos(w * t), -w * np.sin(w * t)), "qd0": (np.sin(w * t) / w, np.cos(w * t))}
    for name, slopes in expected.items():
        np.testing.assert_allclose(along(found, name)[..., 0].T, slopes, rtol=0, atol=w * tolerance)


@pytest.mark.parametrize("method", ["DOP853", "Tsit5"])
def test_gradients_of_a_pendulum_at_rest_do_not_grow(method):
    """Where control of errors alone would take steps in which derivatives grow a hundredfold."""
    end = {"final": lambda q, qd: q[0], "wrt": "q0", "method": method}
    slope = rne.motion_gradient(rne.Robot(straight_chain(1)), [0.0], [0.0], 5.0, **end).gradient["q0"][0]
    assert abs(slope) < 1.2


@pytest.mark.parametrize(("how", "tolerance"), [({"step": 0.05}, 1e-12), ({"method": "LSODA", "rtol": 1e-9}, 1e-7)])
def test_a_late_command_moves_a_mass_by_its_jumps(how, tolerance):
    """Of u = -k q - c v, sampled, motions are parabolas from command to command: derivatives by complex steps in these."""
    k, c, m, period, delay = 3.0, 1.5, 2.0, 0.1, 0.13
    law = rne.control.pd(mass_on_a_rail(m), k, c, [0.0])
    scene = rne.Scene(mass_on_a_rail(m), controller=law, gravity=[0, 0, 0], sample_time=period, delay=delay)

    def end(q, v, k, late):
        t, u, pending = 0.0, 0.0, []
        events = sorted(
            [(i * period, "sample") for i in range(6)] + [(i * period + late, "act") for i in range(5)],
            key=lambda e: e[0].real,
        )
        for instant, kind in [*((t, kind) for t, kind in events if t.real < 0.55), (0.55, "end")]:
            h = instant - t
            q, v, t = q + h * v + h**2 / 2 * u / m, v + h * u / m, instant
            if kind == "sample":
                pending.append(-k * q - c * v)
            elif kind == "act":
                u = pending.pop(0)
        return np.array([q, v, u])

    given = 0.4, -0.3, k, delay
    found = rne.sensitivities(scene, [0.4], [-0.3], 0.55, wrt=["q0", "qd0", "controller.kp", "delay"], **how)
    np.testing.assert_allclose([found.q[-1, 0], found.qd[-1, 0], found.tau[-1, 0]], end(*given), rtol=0, atol=tolerance)
    for j, name in enumerate(["q0", "qd0", "controller.kp", "delay"]):
        expected = end(*(x + 1e-30j * (i == j) for i, x in enumerate(given))).imag / 1e-30
        slopes = [getattr(found, part)[name][-1, 0, 0] for part in ("dq", "dqd", "dtau")]
        np.testing.assert_allclose(slopes, expected, rtol=0, atol=tolerance)


def test_steps_may_be_taken_in_parts(monkeypatch):
    """One by one they give the same bits, with commands that act, times inside and the law's states."""
    law = rne.control.pid(mass_on_a_rail(), 3.0, 0.5, 1.5, [0.2])
    scene = rne.Scene(mass_on_a_rail(), controller=law, sample_time=0.1, delay=0.13, gravity=[0, 0, 0])
    names, times = ["q0", "controller.ki", "delay"], [0.0, 0.1, 0.17, 0.45, 0.5]

    def motion():
        return rne.sensitivities(scene, [0.4], [-0.3], 0.5, wrt=names, method="DOP853", t_eval=times)

    together = motion()
    monkeypatch.setattr("rne.simulation.sensitivities.AT_ONCE", 1)
    apart = motion()
    for name in names:
        for kind in ("dq", "dqd", "dtau"):
            np.testing.assert_array_equal(getattr(apart, kind)[name], getattr(together, kind)[name])


def test_where_a_law_jumps_torques_are_those_after_it():
    """Of tau = kp (r - q) - kd qd, whose r is held and changes at 0.1 s."""
    steps = rne.trajectories.sampled([0.0, 0.1, 0.2], [[0.0], [1.0], [1.0]], kind="hold")
    cart = mass_on_a_rail()
    scene = rne.Scene(cart, controller=rne.control.pd(cart, 20.0, 2.0, steps), gravity=[0, 0, 0])
    found = rne.sensitivities(scene, [0.3], [0.0], 0.2, wrt="controller.reference", t_eval=[0.0, 0.1, 0.2])
    np.testing.assert_allclose(found.tau[1], 20 * (1 - found.q[1]) - 2 * found.qd[1], rtol=ROUNDING)
    slopes = found.dtau["controller.reference"] + 20 * found.dq["controller.reference"]
    slopes = slopes + 2 * found.dqd["controller.reference"]
    np.testing.assert_allclose(slopes[:, 0], 20 * np.eye(3), rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match=r"`t` must be within the samples, 0 to 0\.2 s, got 0\.3"):
        rne.sensitivities(scene, [0.3], [0.0], 0.3, wrt="qd0", step=0.01)
    brake = rne.traceable(lambda t, q, qd: rne.elementwise.where(t > 0.1, -5.0, -2.0) * qd)
    brake.breaks = (0.1,)
    found = rne.sensitivities(rne.Scene(cart, controller=brake), [0.3], [1.0], 0.2, wrt="qd0", t_eval=[0.09, 0.1])
    np.testing.assert_allclose(found.tau[:, 0], [-2, -5] * found.qd[:, 0], rtol=ROUNDING)
    np.testing.assert_allclose(found.dtau["qd0"][:, 0, 0], [-2, -5] * found.dqd["qd0"][:, 0, 0], rtol=ROUNDING)


def test_motors_behind_springs_begin_where_torsion_holds_the_links():
    """A motor that is held there keeps the link at rest, whatever the stiffness."""
    rod, q0 = rne.Robot(straight_chain(1)), np.array([0.3])
    scene = rne.Scene(rod, elastic=rne.ElasticJoints(stiffness=50.0, rotor=0.2))
    torque = rod.gravity_torque(q0)
    found = rne.sensitivities(scene, q0, [0.0], 0.2, wrt="elastic.stiffness", torque=torque, step=0.02)
    assert np.abs(found.qd).max() < 1e-13
    assert np.abs(found.dq["elastic.stiffness"]).max() < 1e-15


@dataclass(frozen=True, eq=False)
class Integrating:
    """A user's law with a state, which is sampled."""

    kp: np.ndarray
    ki: np.ndarray
    target: np.ndarray
    traceable = True
    states = 3

    def __call__(self, t, q, qd, z):
        e = self.target - q
        return self.kp * e + self.ki * z - 4 * qd + 0.3 * np.sin(t), e - 0.1 * z


def spline(rng):
    return rne.trajectories.spline(np.linspace(0, 1, 5), 0.2 * rng.normal(size=(5, 3)))


def held(rng):
    return rne.trajectories.sampled(np.linspace(0, 1, 5), 0.2 * rng.normal(size=(5, 3)), kind="hold")


def scene_of(name):
    """A scene of three joints, and the names that its motions depend on."""
    rng = np.random.default_rng(5)
    arm = rne.Robot(random_tree(3, 4, prismatic=0, branching=0)).with_armature(0.3)
    friction = rne.Friction(viscous=0.5, coulomb=0.4, smoothing=0.3)
    law = Integrating(np.array([20.0, 30, 25]), np.array([5.0, 4, 3]), np.array([0.2, 0.1, -0.3]))
    fast = {"sample_time": 0.02}
    tracking = lambda reference: rne.control.pd_gravity(arm, [30, 20, 25], [4, 5, 6], reference)  # noqa: E731
    spring = rne.Spring(
        arm.link_names[-1], [0.1, 0.2, 0.3], arm.link_names[0], [1, 1, 1], stiffness=30, length=0.2, damping=0.5
    )
    soft = rne.ElasticJoints(stiffness=200.0, damping=0.5, rotor=0.5)
    of_law = ("controller.kp", "controller.ki", "controller.target")
    of_friction = ("friction.viscous", "friction.coulomb", "friction.smoothing")
    if name == "free":
        return rne.Scene(arm, friction=friction, payload=2.0), (*of_friction, "parameters", "armature", "gravity")
    if name == "payload":
        return rne.Scene(arm, payload=rne.Payload(2.0, [0.1, 0.2, 0]), mounting=[0.1, 0.2, 0.3]), ("payload", "gravity")
    if name == "limited":
        return rne.Scene(arm, controller=law, effort_limit=[6, 50, 4.1]), (*of_law, "effort_limit")
    if name == "sampled and limited":
        limits = {"effort_limit": [6, 50, 4.1], "torque_rate": [51, 43, 23.0]}
        return rne.Scene(arm, controller=law, **fast, **limits), (*of_law, *limits)
    if name == "late":
        return rne.Scene(arm, controller=law, **fast, delay=0.053, friction=friction), (*of_law, "delay", *of_friction)
    if name in ("spline", "held"):
        followed = tracking({"spline": spline, "held": held}[name](rng))
        return rne.Scene(arm, controller=followed), ("controller.kp", "controller.reference")
    if name == "sampled spline":
        law = rne.control.computed_torque(arm, [30, 20, 25], [4, 5, 6], spline(rng))
        return rne.Scene(arm, controller=law, **fast), ("controller.reference", "controller.robot.parameters")
    if name == "springs":
        return rne.Scene(arm, springs=[spring]), ("springs[0].stiffness", "springs[0].length", "springs[0].damping")
    elastic = {"armature": 0.0, "elastic": soft, "springs": [spring], "effort_limit": 5.0, **fast}
    names = ("elastic.stiffness", "elastic.rotor", "parameters", "springs[0].stiffness", "effort_limit")
    return rne.Scene(arm, controller=tracking([0.1, 0.2, 0.3]), **elastic), names


SCENES = ["free", "payload", "limited", "sampled and limited", "late", "spline", "held", "sampled spline", "springs"]
SCENES += ["elastic"]
OF_THREE = np.array([0.3, -0.1, -0.4]), np.array([-0.8, 0.1, 0.9])


@pytest.mark.parametrize("method", kept(["rk4", "Tsit5", "DOP853"], ["rk4"]))
@pytest.mark.parametrize("name", kept(SCENES, ["sampled and limited", "late"]))
def test_forward_and_adjoint_derivatives_agree(name, method):
    """Of a linear function of the end: two ways through the same steps."""
    scene, names = scene_of(name)
    names, how = ("q0", "qd0", *names), {"step": 0.01} if method == "rk4" else {"method": method}
    c, e = np.random.default_rng(3).normal(size=(2, 3))
    found = rne.sensitivities(scene, *OF_THREE, 0.13, wrt=names, **how)
    of_end = rne.motion_gradient(
        scene, *OF_THREE, 0.13, final=lambda q, qd: (c * q).sum() + (e * qd).sum(), wrt=names, **how
    )
    for name in names:
        slopes = c @ found.dq[name][-1] + e @ found.dqd[name][-1]
        np.testing.assert_allclose(
            slopes, of_end.gradient[name].reshape(-1), rtol=0, atol=SEEN * max(1, np.abs(slopes).max())
        )


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_derivatives_are_those_of_differences(name):
    """Of positions, velocities and torques at all times, by central differences of the same equal steps."""
    scene, names = scene_of(name)
    how, step = {"step": 0.01, "t_eval": [0.0, 0.05, 0.1]}, 1e-5
    found = rne.sensitivities(scene, *OF_THREE, 0.1, wrt=("q0", *names), **how)

    def motion(name, value):
        q0, at = (value, scene) if name == "q0" else (OF_THREE[0], scene.with_numbers({name: value}))
        run = rne.sensitivities(at, q0, OF_THREE[1], 0.1, wrt="q0", **how)
        return np.concatenate([run.q, run.qd, run.tau], axis=1)

    for name in ("q0", *names):
        if name in (
            "payload",
            "delay",
            "controller.robot.parameters",
        ):  # bounded; whose steps end elsewhere; held alone
            continue
        given = OF_THREE[0] if name == "q0" else scene.numbers[name]
        slopes = np.concatenate([found.dq[name], found.dqd[name], found.dtau[name]], axis=1)
        for k in range(0, given.size, 1 + given.size // 12):
            unit = step * (np.arange(given.size) == k).reshape(given.shape)
            difference = (motion(name, given + unit) - motion(name, given - unit)) / (2 * step)
            np.testing.assert_allclose(slopes[..., k], difference, rtol=0, atol=1e-8 * max(1, np.abs(slopes).max()))


def test_torques_change_as_their_law_says(chain):
    """Of tau = kp (r - q) - kd qd, by its own derivative; within a limit that is reached they are the limit."""
    kp, kd, r = np.array([20.0, 30.0]), np.array([2.0, 3.0]), np.array([0.1, 0.2])
    law = rne.control.pd(chain, kp, kd, r)
    names = ["q0", "controller.kp", "controller.reference"]
    found = rne.sensitivities(rne.Scene(chain, controller=law), *START, 0.2, wrt=names, step=0.02)
    own = {"q0": 0.0, "controller.kp": (r - found.q)[..., None] * np.eye(2), "controller.reference": np.diag(kp)}
    for name, slopes in own.items():
        expected = slopes - kp[:, None] * found.dq[name] - kd[:, None] * found.dqd[name]
        assert relative(found.dtau[name], expected) < ROUNDING
    assert "limits" not in found.message
    limited = rne.Scene(chain, controller=law, effort_limit=[0.3, 100.0])
    found = rne.sensitivities(limited, *START, 0.1, wrt=["q0", "effort_limit"], step=0.02)
    at_limit = np.abs(found.tau[:, 0]) == 0.3
    np.testing.assert_array_equal(at_limit, [True, True, True, False, True, True])
    np.testing.assert_array_equal(found.dtau["effort_limit"][at_limit, 0, 0], np.sign(found.tau[at_limit, 0]))
    np.testing.assert_array_equal(found.dtau["q0"][:, 0].any(axis=1), ~at_limit)
    assert found.message.endswith("; torques reached limits, where derivatives are those of one side")


@pytest.mark.parametrize("method", kept(["Radau", "BDF", "LSODA"], ["BDF", "LSODA"]))
def test_variational_equations_are_those_of_a_pendulum(method):
    """J q'' = -m g l sin q - b q' and its derivatives by q0 and b, written by hand, by SciPy."""
    J, weight, b = 0.3**2 / 3, 9.81 * 0.15, 0.02
    rod = rne.Scene(rne.Robot(straight_chain(1)), friction=rne.Friction(viscous=b))
    t = np.linspace(0, 1, 5)
    found = rne.sensitivities(
        rod, [1.0], [0.5], 1.0, wrt=["q0", "friction.viscous"], method=method, rtol=1e-8, t_eval=t
    )

    def rates(t, y):
        q, v, *S = y
        slope = -weight * np.cos(q) / J
        by_q, by_b = slope * S[0] - b / J * S[1], slope * S[2] - b / J * S[3] - v / J
        return [v, (-weight * np.sin(q) - b * v) / J, S[1], by_q, S[3], by_b]

    how = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12, "t_eval": t}
    y = scipy.integrate.solve_ivp(rates, (0, 1), [1.0, 0.5, 1, 0, 0, 0], **how).y
    np.testing.assert_allclose(along(found, "q0")[..., 0].T, y[2:4], rtol=0, atol=1e-5)
    np.testing.assert_allclose(along(found, "friction.viscous")[..., 0].T, y[4:], rtol=0, atol=3e-5)
    assert found.method == method
    assert found.message.endswith(f"derivatives by the variational equations, by {method} at rtol 1e-08")


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_variational_equations_and_short_steps_agree(name):
    """Also of sampled laws, delays and references of samples, and where limits are left."""
    scene, names = scene_of(name)
    times = np.array([0.0, 0.021, 0.05, 0.13, 0.2])
    names = "q0", *names
    exact = rne.sensitivities(scene, *OF_THREE, 0.2, wrt=names, step=5e-4, t_eval=times)
    found = rne.sensitivities(scene, *OF_THREE, 0.2, wrt=names, method="LSODA", rtol=1e-8, t_eval=times)
    tolerance = 2e-3 if name == "limited" else 1e-5  # stages of steps that reach across the end of a limit
    for name in names:
        for kind in ("dq", "dqd", "dtau"):
            assert relative(getattr(found, kind)[name], getattr(exact, kind)[name]) < tolerance


def test_stiff_motions_have_variational_equations(chain):
    scene = rne.Scene(chain, friction=rne.Friction(viscous=[1000.0, 500.0]))
    found = rne.sensitivities(scene, *START, 0.5, wrt="friction.viscous", t_eval=[0.0, 0.5])
    assert re.match(r"(LSODA|Rodas5P): stiff, .*; derivatives by the variational equations", found.message)
    finer = rne.sensitivities(scene, *START, 0.5, wrt="friction.viscous", method="LSODA", rtol=1e-9, t_eval=[0.0, 0.5])
    assert relative(found.dq["friction.viscous"], finer.dq["friction.viscous"]) < 1e-4


@pytest.mark.long
def test_a_motion_whose_method_changes_has_variational_equations():
    """Of a brake that comes on; the short sibling is that of a stiff motion."""
    law = rne.traceable(lambda t, q, qd: -(2.0 + 1e5 * t**4) * qd - 5 * q)
    scene, how = rne.Scene(mass_on_a_rail(), controller=law), {"wrt": "q0", "t_eval": [0.0, 2.0]}
    found = rne.sensitivities(scene, [1.0], [0.0], 2.0, **how)
    assert rne.simulate(scene, [1.0], [0.0], 2.0).run.changed
    assert " from t = " in found.message
    assert "; derivatives by the variational equations" in found.message
    finer = rne.sensitivities(scene, [1.0], [0.0], 2.0, method="LSODA", rtol=1e-10, atol=1e-12, **how)
    assert relative(found.dq["q0"], finer.dq["q0"]) < 1e-6


@pytest.mark.long
@pytest.mark.parametrize("name", ["sampled and limited", "late", "spline", "elastic"])
def test_machine_code_and_numpy_agree(name):
    """The same text, interpreted and compiled: with times between the ends of steps too."""
    pytest.importorskip("numba", reason="Numba is not installed")
    scene, names = scene_of(name)
    names, times, found = ("q0", "qd0", *names), [0.0, 0.021, 0.05, 0.13], []
    for given in (scene, replace(scene, robot=rne.Robot(scene.robot.model, "numba"))):
        found.append(rne.sensitivities(given, *OF_THREE, 0.13, wrt=names, method="DOP853", t_eval=times))
    for name in names:
        for kind in ("dq", "dqd", "dtau"):
            slopes, expected = (getattr(run, kind)[name] for run in found)
            np.testing.assert_allclose(slopes, expected, rtol=0, atol=1e-9 * max(1, np.abs(expected).max()))


@pytest.mark.long
def test_derivatives_of_a_motion_by_rodas5p_are_by_radau(chain):
    pytest.importorskip("numba", reason="Numba is not installed")
    scene, how = (
        rne.Scene(chain, friction=rne.Friction(viscous=1.0)),
        {"wrt": "friction.viscous", "t_eval": [0.0, 0.02]},
    )
    compiled = replace(scene, robot=rne.Robot(chain.model, "numba"))
    found = rne.sensitivities(compiled, *START, 0.02, method="Rodas5P", **how)
    exact = rne.sensitivities(scene, *START, 0.02, method="DOP853", **how)
    assert found.message.startswith("Rodas5P as requested; ")
    assert found.message.endswith("; derivatives by the variational equations, by Radau at rtol 1e-06")
    assert relative(found.dq["friction.viscous"], exact.dq["friction.viscous"]) < 1e-4


def test_derivatives_are_read_only_and_pickle(chain):
    found = rne.sensitivities(chain, *START, 0.02, wrt=["q0", "gravity"], step=0.01)
    assert list(found.dq) == ["q0", "gravity"]
    assert found.dq["gravity"].shape == (3, 2, 3)
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.dqd["q0"], found.dqd["q0"])
    for array in (found.q, found.dq["q0"], found.dtau["gravity"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(KeyError):
        found.dq["qd0"]
    assert repr(found).splitlines()[0] == "Sensitivities of 'chain2', 0 to 0.02 s, 3 samples, by q0 (2), gravity (3)"


def test_progress_and_interrupts(chain):
    """The user is told the time, and has what was found until Ctrl-C."""
    told = []
    how = {"wrt": "q0", "method": "LSODA", "t_eval": np.linspace(0, 0.5, 26)}
    found = rne.sensitivities(chain, *START, 0.5, progress=lambda t, end: told.append((t, end)), **how)
    times = [t for t, _ in told]
    assert times == sorted(times)
    assert told[-1] == (0.5, 0.5)
    assert len(told) > 5

    def interrupt(t, end):
        if t > 0.2:
            raise KeyboardInterrupt

    with pytest.raises(
        rne.SimulationInterrupted, match=r"sensitivities interrupted at t = 0\.\d+ s of 0\.5 s"
    ) as caught:
        rne.sensitivities(chain, *START, 0.5, progress=interrupt, **how)
    so_far, count = caught.value.trajectory, len(caught.value.trajectory.t)
    assert 0.2 < so_far.t[-1] + 0.02 < 0.5
    np.testing.assert_array_equal(so_far.dq["q0"], found.dq["q0"][:count])
    for name in ("q", "qd", "tau"):
        np.testing.assert_array_equal(getattr(so_far, name), getattr(found, name)[:count])


REFUSED = {
    "name": ({"wrt": "kp"}, ValueError, "`wrt`: in addition to 'q0' and 'qd0' the scene has the numbers "),
    "no text": ({"wrt": [3]}, TypeError, "`wrt` must be names of numbers, got 3"),
    "rk4": ({"method": "rk4"}, ValueError, "`method` must be 'auto' or one of .*, got 'rk4'; rk4 needs `step`"),
    "method": (
        {"method": "DOP853", "step": 0.1},
        ValueError,
        r"`method` must be 'auto' or one of \['rk4'\], got 'DOP853'",
    ),
    "step": ({"step": 0.0}, ValueError, "`step` must be positive, got 0.0"),
    "duration": ({"duration": -1.0}, ValueError, "`duration` must be positive, got -1.0"),
    "shape": ({"q0": [0.0] * 3}, ValueError, r"`q0` must have shape \(\.\.\., 2\) for robot 'chain2', got \(3,\)"),
    "one": ({"q0": np.zeros((4, 2))}, ValueError, r"`q0` must have shape \(2,\), one state, got \(4, 2\)"),
    "times": ({"t_eval": [0.0, 9.0]}, ValueError, r"`t_eval` must ascend within \[0, 0.1\], got 0 ... 9"),
    "torque": ({"torque": [1.0] * 3}, ValueError, "`torque` must have shape "),
    "law": ({"torque": lambda t, q, qd: q}, ValueError, "`torque` must be constant here"),
    "rtol": ({"rtol": 0.0}, ValueError, "`rtol` must be positive, got 0.0"),
    "progress": ({"progress": 3}, TypeError, "`progress` must be a function"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_wrong_arguments_are_named(chain, name):
    changed, kind, message = REFUSED[name]
    given = {"q0": START[0], "qd0": START[1], "duration": 0.1, "wrt": "q0"} | changed
    with pytest.raises(kind, match=message):
        rne.sensitivities(rne.Scene(chain), **given)


def test_motions_without_derivatives_are_refused_with_the_cure(chain):
    refused = {
        "`stops` end a run: set `stops` to False": {"stops": True},
        "dry `friction` sticks and slips by events: give it a `smoothing` above 0": {
            "friction": rne.Friction(coulomb=1.0, smoothing=0.0)
        },
        "`controller` is called, as it is not marked by rne.traceable": {"controller": lambda t, q, qd: -q},
    }
    for cause, parts in refused.items():
        with pytest.raises(ValueError, match=f"the motion cannot be differentiated: {re.escape(cause)}"):
            rne.sensitivities(rne.Scene(chain, **parts), *START, 0.1, wrt="q0")


def test_derivatives_that_overflow_are_named():
    """Of an unstable equilibrium, which the motion does not leave."""
    law = rne.traceable(lambda t, q, qd: 1e12 * q)
    scene = rne.Scene(mass_on_a_rail(), controller=law, gravity=[0, 0, 0])
    with pytest.raises(rne.NotFiniteError, match=r"derivatives overflow before t = .*; steps of 0.001 s may be"):
        rne.sensitivities(scene, [0.0], [0.0], 0.05, wrt="q0", step=1e-3)
