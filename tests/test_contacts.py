"""The momentum observer: its differential equation, its thresholds, contacts and payloads, online and in records."""

import re

import numpy as np
import pytest

import rne
from rne.control import MomentumObserver

from .helpers import kept, loaded

T = np.linspace(0, 1, 1001)
SAMPLES = 2e-3  # of the push: the trapezoidal rule at 1 ms
START, END = np.array([0, 0.2, 0, 0, 0.5, 0]), np.array([1, -0.3, 0.4, 1, -0.5, 1])
PUSHES = np.array([0, -30.0, 5.0, 0, 0, 0])


@pytest.fixture(scope="module", params=kept([3, 6], [3]))
def arm(request):
    """The IRB 140, or its first three joints."""
    robot = loaded("irb140")
    return robot if request.param == 6 else robot.locked({"joint_4": 0.0, "joint_5": 0.5, "joint_6": 0.0})


@pytest.fixture(scope="module")
def path(arm):
    return rne.trajectories.quintic(START[: arm.n], END[: arm.n], 1.0)


@pytest.fixture(scope="module")
def states(path):
    """Positions, velocities and accelerations every millisecond."""
    return path(T)


@pytest.fixture(scope="module")
def push(arm):
    return PUSHES[: arm.n]


def test_the_residual_follows_a_push_as_a_first_order_filter(arm, states, push):
    """r = (1 - exp(-gain t)) push."""
    begun, (q, qd, _) = T - 0.4, states
    tau = arm.inverse_dynamics(*states) - np.where(begun > 0, 1.0, 0.0)[:, None] * push
    seen = MomentumObserver(arm, gain=50.0, floor=1.0).observe(T, q, qd, tau)
    expected = np.where(begun > 0, 1 - np.exp(-50.0 * begun), 0.0)[:, None] * push
    late = begun > 0.01  # the push begins within a sample
    np.testing.assert_allclose(seen.torque[late], expected[late], atol=30 * (SAMPLES + 50e-3 / 2))
    np.testing.assert_allclose(seen.torque[-1], push, atol=30 * SAMPLES)
    assert seen.kind == "contact"
    assert 0.4 < seen.first_contact < 0.405
    assert "joint_2" in str(seen)


def mixture(robots, shares):
    return robots[0].with_parameters(sum(s * robot.parameters for s, robot in zip(shares, robots, strict=True)))


@pytest.fixture(scope="module")
def cases(arm):
    factors = 1 + 0.05 * np.array([[1, -1, 1, -1, 1, -1], [-1, 1, 1, 1, -1, 1], [1, 1, -1, -1, -1, 1]])
    return [arm.with_parameters(np.repeat(factor[: arm.n], 10) * arm.parameters) for factor in factors]


@pytest.mark.parametrize("shares", [[0.5, 0.3, 0.2], [0, 0, 1], [0.1, 0.9, 0]])
def test_no_mixture_of_the_cases_exceeds_the_threshold(arm, cases, states, shares):
    """Residuals are linear in the parameters; with friction within its stated error too."""
    known = rne.Friction(viscous=4.0, coulomb=5.0)
    actual = rne.Friction(viscous=4.0 * 1.2, coulomb=5.0 * 0.8)
    q, qd, _ = states
    tau = mixture(cases, shares).inverse_dynamics(*states) + actual.torque(arm.model, qd)
    observer = MomentumObserver(arm, friction=known, cases=cases, friction_error=0.2, floor=0.1)
    seen = observer.observe(T, q, qd, tau)
    assert seen.kind is None
    assert "No contact" in str(seen)
    assert np.abs(seen.torque).max() > 1.0  # there are errors
    narrow = MomentumObserver(arm, friction=known, floor=0.1).observe(T, q, qd, tau)
    assert narrow.kind is not None


def test_a_corner_of_the_cases_reaches_the_threshold(arm, cases, states):
    """It is no larger than it must be: one of the cases is on it at every instant."""
    tau = [case.inverse_dynamics(*states) for case in cases]
    observer = MomentumObserver(arm, cases=cases)
    seen = [observer.observe(T, *states[:2], x) for x in tau]
    largest = np.max([np.abs(x.torque) for x in seen], axis=0)
    np.testing.assert_allclose(largest, seen[0].threshold, atol=SAMPLES * seen[0].threshold.max())


def test_a_payload_is_told_with_its_mass(irb140):
    q, qd, qdd = rne.trajectories.quintic(START, END, 1.0)(T)
    heavy = irb140.with_payload(3.0, com=[0.05, 0, 0.1])
    seen = MomentumObserver(irb140, floor=2.0).observe(T, q, qd, heavy.inverse_dynamics(q, qd, qdd))
    assert seen.kind == "payload"
    assert seen.payload_mass == pytest.approx(3.0, rel=0.1)


def test_a_record_is_observed(arm, states, push):
    tau = arm.inverse_dynamics(*states) - np.where(T > 0.5, 1.0, 0.0)[:, None] * push
    ready = rne.identification.Record(T, states[0], tau).prepare()
    seen = MomentumObserver(arm, floor=5.0).observe(ready.t, ready.q, ready.qd, ready.tau)
    assert 0.48 < seen.first_contact < 0.52  # the filter of the velocities is without delay


def test_a_watched_law_is_replaced_at_the_contact(arm, path, push):
    """Online and offline are one filter: the contact is the first sample beyond the threshold."""
    law = rne.control.computed_torque(arm, 400, 40, path)
    observer = MomentumObserver(arm, floor=3.0)

    class World:
        """The drives give what the watched law says, and from 20 ms on something pushes."""

        def __init__(self, reaction):
            self.watched = observer.watching(law, reaction, 1e-3)

        def __call__(self, t, q, qd):
            return self.watched(t, q, qd) + (push if t >= 0.02 else 0.0)

    def brake(t, q, qd):
        return arm.gravity_torque(q) - arm.mass_matrix(q) @ (40 * qd)

    world, t = World(brake), np.arange(61) * 1e-3
    scene = rne.Scene(arm, controller=world, sample_time=1e-3)
    motion = rne.simulate(scene, path(0.0)[0], [0] * arm.n, 0.06, t_eval=t)
    drives = motion.tau - np.where(t >= 0.02, 1.0, 0.0)[:, None] * push
    seen = observer.observe(t, motion.q, motion.qd, drives, held=True)
    blurred = observer.observe(t, motion.q, motion.qd, drives)  # as if torques changed evenly between samples
    before = t < 0.02
    assert np.abs(seen.torque[before]).max() < 0.2 * np.abs(blurred.torque[before]).max()
    assert world.watched.contact == pytest.approx(seen.first_contact, abs=1e-9)
    assert 0.02 < seen.first_contact < 0.025


REST = np.zeros((len(T), 6))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"tau": np.where(np.arange(6) == 3, np.nan, REST)}, "`tau` must be finite, got nan at index (0, 3)"),
        ({"t": T**2}, "`t` must ascend at equal intervals; rne.identification.Record.prepare resamples"),
        ({"qd": REST[1:]}, "`q`, `qd` and `tau` must have shape (1001, 6), a row for each of at least two times"),
    ],
)
def test_what_is_refused(irb140, change, text):
    arrays = {"t": T, "q": REST, "qd": REST, "tau": REST} | change
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        MomentumObserver(irb140).observe(**arrays)


def test_cases_must_be_of_the_same_joints(irb140, ur5):
    with pytest.raises(ValueError, match="`cases` must have the joints of the robot in its order"):
        MomentumObserver(irb140, cases=[ur5])
