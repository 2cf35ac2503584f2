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


SHARES = [[1, 0, 0, 0], [0, 0, 0, 1], [0.4, 0.1, 0.3, 0.2]]  # of three cases and the model
RATES = [(100, 0.5), (1000, 0.3), (10_000, 0.05)]  # samples per second, and seconds


@pytest.mark.parametrize("gain", [50.0, 1000.0])  # times the step below and above two, where the filter alternates
@pytest.mark.parametrize(("rate", "duration"), RATES)
def test_no_smooth_torque_without_a_contact_exceeds_the_threshold(arm, cases, rate, duration, gain):
    """Without a floor: the thresholds cover what the rules of integration err, of joints that reverse too."""
    t, turns = np.arange(rate * duration + 1) / rate, 5.0 * np.arange(1, arm.n + 1)
    q, qd = START[: arm.n] + 0.3 * np.sin(np.outer(t, turns)), 0.3 * turns * np.cos(np.outer(t, turns))
    qdd, known = -0.3 * turns**2 * np.sin(np.outer(t, turns)), rne.Friction(viscous=4.0, coulomb=5.0)
    observers = [
        MomentumObserver(arm, gain=gain, cases=cases),
        MomentumObserver(arm, gain=gain, cases=cases, friction=known, friction_error=0.2),
    ]
    for shares in SHARES:
        tau = mixture([*cases, arm], shares).inverse_dynamics(q, qd, qdd)
        for observer, friction in zip(observers, (0.0, 0.8 * known.torque(arm.model, qd)), strict=True):
            assert observer.observe(t, q, qd, tau + friction).kind is None
    tau = arm.inverse_dynamics(q, qd, qdd)
    alone = MomentumObserver(arm, gain=gain).observe(t, q, qd, tau)
    assert alone.kind is None
    largest = (
        np.abs(np.diff(tau, 2, axis=0)).max() / 2 * max(1, gain / rate / 2)
    )  # 6 times the trapezoidal rule's error
    assert alone.threshold.max() < largest


@pytest.mark.parametrize("shares", kept(SHARES, SHARES[2:]))
@pytest.mark.parametrize(("rate", "duration"), kept(RATES, RATES[:2]))
def test_no_held_torque_without_a_contact_exceeds_the_threshold(arm, cases, path, rate, duration, shares):
    """Between samples accelerations change and at samples they jump; the solver's default tolerances are enough."""
    t, kp = np.arange(rate * duration + 1) / rate, min(rate, 400)
    law = rne.control.computed_torque(arm, kp, 2 * kp**0.5, path)
    real = mixture([*cases, arm], shares)
    scene = rne.Scene(real, controller=law, sample_time=1 / rate, effort_limit=40.0)
    motion = rne.simulate(scene, START[: arm.n], [0] * arm.n, duration, t_eval=t, method="RK45")
    observer = MomentumObserver(arm, cases=cases)
    assert observer.observe(t, motion.q, motion.qd, motion.tau, held=True).kind is None


def test_friction_that_is_known_is_no_contact_between_samples(arm, path):
    """Rates bend between samples at which torques are held, and friction with them."""
    friction, t = rne.Friction(viscous=20.0), np.linspace(0, 0.3, 31)
    law = rne.control.computed_torque(arm, 400, 40, path)
    scene = rne.Scene(arm, controller=law, sample_time=0.01, friction=friction)
    motion = rne.simulate(scene, START[: arm.n] + 0.1, [0] * arm.n, 0.3, t_eval=t, method="RK45")
    observer = MomentumObserver(arm, friction=friction)
    assert observer.observe(t, motion.q, motion.qd, motion.tau, held=True).kind is None
    assert observer.observe(t, motion.q, motion.qd, motion.tau + 10.0, held=True).kind is not None
    assert MomentumObserver(arm).observe(t, motion.q, motion.qd, motion.tau, held=True).kind is not None


def test_a_joint_that_dry_friction_holds_has_no_contact(two):
    """At rest friction may be anything up to the static one: pushes below it do not show, those above it do."""
    friction = rne.Friction(coulomb=2.0, static=3.0, smoothing=0)
    q, qd = np.zeros((len(T), 2)), np.zeros((len(T), 2))
    for held, error in ((True, 0.0), (False, 0.0), (True, 0.2), (False, 0.2)):  # the real friction may be larger
        observer = MomentumObserver(two, friction=friction, friction_error=error)
        tau = two.gravity_torque(q) + 3.0 * (1 + error) - 0.1
        assert observer.observe(T, q, qd, tau, held=held).kind is None
        assert observer.observe(T, q, qd, tau + 0.2, held=held).kind is not None


def test_errors_of_friction_count_though_friction_changes_its_sign_between_samples(two):
    """The joint swings to and fro with the samples: friction's impulse cancels, its error does not."""
    q, qd = np.zeros((len(T), 2)), np.where(np.arange(len(T)) % 2, 0.1, -0.1)[:, None] * np.ones(2)
    observer = MomentumObserver(two, friction=rne.Friction(viscous=10.0), friction_error=0.5)
    threshold = observer.observe(T, q, qd, two.gravity_torque(q)).threshold
    assert (threshold[-1] >= 0.999 * 0.5 * 10.0 * 0.1).all()


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
        """The drives give what the guarded law says, and from 20 ms on something pushes."""

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


@pytest.mark.parametrize("parts", [{"effort_limit": 25.0}, {"torque_rate": 500.0}], ids=str)
def test_a_watched_law_is_told_what_the_drives_deliver(arm, path, parts):
    """The limits of the scene are no contact, and the second run begins anew."""
    law, observer = rne.control.computed_torque(arm, 400, 40, path), MomentumObserver(arm)
    watched = observer.watching(law, law, 2e-3)
    scene = rne.Scene(arm, controller=watched, sample_time=2e-3, **parts)
    for start in (START + 0.2, START - 0.2):
        motion = rne.simulate(scene, start[: arm.n], [0] * arm.n, 0.05, t_eval=np.arange(26) * 2e-3)
        asked = [law(t, q, qd) for t, q, qd in zip(motion.t, motion.q, motion.qd, strict=True)]
        assert np.abs(asked - motion.tau).max() > 5.0  # the limits act
        assert observer.observe(motion.t, motion.q, motion.qd, motion.tau, held=True).kind is None
        assert watched.contact is None
        watched.contact = 0.01


@pytest.mark.parametrize("sample_time", [None, 2e-3])
def test_a_watched_law_needs_its_own_sample_time(two, sample_time):
    law = rne.control.pd_gravity(two, 10, 1, [0, 0])
    scene = rne.Scene(two, controller=MomentumObserver(two).watching(law, law, 1e-3), sample_time=sample_time)
    with pytest.raises(ValueError, match=r"^a guarded law must be called every 0.001 s from t = 0 on, got t = "):
        rne.simulate(scene, [0, 0], [0, 0], 0.01)


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"law": 3.0}, TypeError, "`law` must be a function of (t, q, qd), got float"),
        ({"reaction": None}, TypeError, "`reaction` must be a function of (t, q, qd), got NoneType"),
        (
            {"law": rne.control.pid(rne.load("irb140"), 1, 1, 1, [0] * 6)},
            TypeError,
            "`law` must be a function of (t, q, qd), got one of (t: 'float', q: 'Array', qd: 'Array', z: 'Array') -> 'tuple[Array, Array]'",
        ),
        ({"sample_time": 0}, ValueError, "`sample_time` must be positive, got 0.0"),
    ],
)
def test_what_is_not_watched(irb140, change, error, text):
    law = rne.control.pd_gravity(irb140, 1, 1, [0] * 6)
    with pytest.raises(error, match=f"^{re.escape(text)}$"):
        MomentumObserver(irb140).watching(**{"law": law, "reaction": law, "sample_time": 1e-3} | change)


REST = np.zeros((len(T), 6))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"tau": np.where(np.arange(6) == 3, np.nan, REST)}, "`tau` must be finite, got nan at index (0, 3)"),
        ({"t": T**2}, "`t` must ascend at equal intervals; rne.identification.Record.prepare resamples"),
        ({"t": 0 * T}, "`t` must ascend at equal intervals; rne.identification.Record.prepare resamples"),
        ({"qd": REST[1:]}, "`q`, `qd` and `tau` must have shape (1001, 6), a row for each of at least two times"),
    ],
)
def test_what_is_refused(irb140, change, text):
    arrays = {"t": T, "q": REST, "qd": REST, "tau": REST} | change
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        MomentumObserver(irb140).observe(**arrays)


SAME = "`cases` must differ from the robot only in masses, centres of mass and inertias, not in "


@pytest.mark.parametrize(
    ("given", "error", "text"),
    [
        ({"cases": [loaded("ur5")]}, ValueError, f"{SAME}moving_joints"),
        (
            {"cases": [loaded("irb140"), rne.load("irb140", gravity=(0, 0, 0))]},
            ValueError,
            f"{SAME}gravity",
        ),
        (
            {"cases": [rne.load("irb140").mounted([np.pi, 0, 0])]},
            ValueError,
            f"{SAME}gravity",
        ),
        ({"cases": 3}, TypeError, "`cases` must be a sequence of Robots"),
        ({"friction": rne.Friction}, TypeError, "`friction` must be an rne.Friction or None, got type"),
        ({"cases": [1.0]}, TypeError, "`cases` must be a sequence of Robots"),
        ({"friction": 3.0}, TypeError, "`friction` must be an rne.Friction or None, got float"),
        (
            {"friction": rne.Friction(viscous=[1.0, 2.0])},
            ValueError,
            "`viscous` of the friction must be a number or of shape (6,), got (2,)",
        ),
        ({"robot": "irb140"}, TypeError, "`robot` must be an rne.Robot, got str"),
    ],
)
def test_observers_that_are_refused(irb140, given, error, text):
    with pytest.raises(error, match=f"^{re.escape(text)}$"):
        MomentumObserver(**{"robot": irb140} | given)
