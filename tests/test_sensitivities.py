"""Derivatives of motions along their steps and by variational equations, against complex steps, adjoints, closed forms."""

from itertools import pairwise

import numpy as np
import pytest

import rne
from rne.integrators import tableaus

from .helpers import Part, assemble, kept
from .random_robots import straight_chain

ROUNDING = 1e-12  # of sums in another order, times derivatives of at most some tens
DIFFERENCES = 2e-7  # of central differences with STEP: its square and rounding by it, times third derivatives
STEP = 1e-5
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


@pytest.mark.parametrize(
    "how", [{"step": 2e-3}, {"method": "LSODA", "rtol": 1e-10, "atol": 1e-12}], ids=["rk4", "LSODA"]
)
def test_a_pendulum_at_rest_is_a_linear_one(how):
    """dq/dq0 = cos wt and dq/dqd0 = sin wt / w at the equilibrium, by steps and by variational equations."""
    w, t = np.sqrt(9.81 * 0.15 / (0.3**2 / 3)), np.linspace(0, 0.5, 6)
    rod = rne.Robot(straight_chain(1))
    found = rne.sensitivities(rod, [0.0], [0.0], 0.5, wrt=["q0", "qd0"], t_eval=t, **how)
    expected = {"q0": (np.cos(w * t), -w * np.sin(w * t)), "qd0": (np.sin(w * t) / w, np.cos(w * t))}
    for name, slopes in expected.items():
        np.testing.assert_allclose(along(found, name)[..., 0].T, slopes, rtol=0, atol=2e-8)


def test_a_late_command_moves_a_mass_by_its_jumps():
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
    found = rne.sensitivities(scene, [0.4], [-0.3], 0.55, wrt=["q0", "qd0", "controller.kp", "delay"], step=0.05)
    np.testing.assert_allclose([found.q[-1, 0], found.qd[-1, 0], found.tau[-1, 0]], end(*given), rtol=0, atol=1e-13)
    for j, name in enumerate(["q0", "qd0", "controller.kp", "delay"]):
        expected = end(*(x + 1e-30j * (i == j) for i, x in enumerate(given))).imag / 1e-30
        slopes = [getattr(found, part)[name][-1, 0, 0] for part in ("dq", "dqd", "dtau")]
        np.testing.assert_allclose(slopes, expected, rtol=0, atol=1e-12)
