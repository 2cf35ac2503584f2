"""What is said of M before forward dynamics are asked, and that they never answer wrongly in silence."""

import warnings
from dataclasses import replace

import mpmath
import numpy as np
import pytest

import rne
from rne.basics.spatial import rotation_about

from .helpers import EPS, Part, assemble, pose, states
from .random_robots import random_tree, straight_chain

X, Y, Z = np.eye(3)


def gimbal(link_inertia=0.0):
    """Three axes through one point, the outer two rings next to massless; at q2 = 0 the first and third coincide."""
    rings = [np.eye(3) * link_inertia, np.eye(3) * link_inertia, np.diag([0.3, 0.2, 0.1])]
    parts = [Part(link="base")]
    for k, (axis, inertia) in enumerate(zip((Z, Y, Z), rings, strict=True)):
        body = {"mass": 2.0, "com": np.array([0.01, 0.02, 0.1])} if k == 2 else {}
        parts.append(Part(link=f"l{k}", joint=f"j{k}", kind="continuous", parent=k, axis=axis, inertia=inertia, **body))
    return rne.Robot(assemble("gimbal", parts))


def sliders(axis, angle=0.0, light=0.0):
    """Two sliders along the same line, the first of them with next to no mass of its own."""
    turn = pose(rotation_about(Y, np.asarray(angle)), [0.1, 0.2, 0.3])
    second = turn.R.T.astype(float) @ axis
    parts = [
        Part(link="base"),
        Part(link="a", joint="first", kind="prismatic", axis=axis, parent=0, mass=light),
        Part(link="b", joint="second", kind="prismatic", axis=second, parent=1, placement=turn, mass=1.7),
    ]
    return rne.Robot(assemble("sliders", parts))


def exact_forward(robot, *arguments):
    with mpmath.workdps(80):
        numbers = [np.array([mpmath.mpf(float(x)) for x in v], dtype=object) for v in arguments]
        return np.array([float(x) for x in rne.dynamics.forward_dynamics(robot.model, *numbers)])


def right_or_refused(robot, q, qd, tau, tolerance):
    """Both methods, readable and compiled: the answer has the digits promised, or an error says why not."""
    calls = [robot.forward_dynamics]
    calls += [
        lambda *s, f=f: f(robot.model, *map(np.asarray, s))
        for f in (rne.dynamics.forward_dynamics, rne.dynamics.articulated_forward_dynamics)
    ]
    expected, answers = None, 0
    for call in calls:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", rne.PrecisionWarning)
            try:
                got = call(q, qd, tau)
            except rne.SingularMassMatrixError as error:
                assert error.joints
                continue
        expected = exact_forward(robot, q, qd, tau) if expected is None else expected
        error = np.abs(got - expected).max() / np.abs(expected).max()
        assert error <= tolerance
        assert error <= 1e-2 or said
        answers += 1
    return answers


def test_an_ordinary_robot_keeps_its_digits(irb140):
    found = irb140.diagnose(np.full(6, 0.3))
    assert found.condition.shape == found.digits.shape == found.pivot.shape == ()
    assert found.worst_state == ()
    assert 1 <= found.condition < 1e3
    assert 12 < found.digits < 16
    assert 0 < found.pivot <= 1
    assert set(found.worst_joint) <= set(irb140.joint_names)
    assert "digits in forward dynamics; a motion of joint_" in str(found)


def test_condition_is_that_of_unit_diagonal():
    robot = rne.Robot(random_tree(7, seed=4))
    q = states(7, 20)[0]
    found = robot.diagnose(q)
    for k, M in enumerate(robot.mass_matrix(q)):
        d = np.sqrt(np.diagonal(M))
        assert found.condition[k] == pytest.approx(np.linalg.cond(M / np.outer(d, d)), rel=1e-8)
    assert found.worst_state == (int(found.condition.argmax()),)
    assert str(found).startswith(f"worst of 20 states is {found.worst_state}: condition ")


def test_sizes_and_units_do_not_count():
    """A light tip on a bent chain: the condition number of M itself is 1e14, and none of it costs a digit."""
    chain = straight_chain(3)
    light = replace(
        chain, mass=chain.mass * [1, 1, 1e-12], inertia=chain.inertia * np.array([1, 1, 1e-12])[:, None, None]
    )
    q = [0.3, 1.2, 1.0]
    assert np.linalg.cond(rne.dynamics.mass_matrix(light, np.array(q))) > 1e11
    assert rne.dynamics.diagnose(light, q).digits > 13


def test_the_weakest_motion_of_two_joints_is_of_both_however_light_one_is():
    """M of unit diagonal is (1, c; c, 1): its eigenvectors are (1, 1) and (1, -1), its eigenvalues 1 + c and 1 - c."""
    chain = straight_chain(2)
    light = replace(chain, mass=chain.mass * [1, 1e-12], inertia=chain.inertia * np.array([1, 1e-12])[:, None, None])
    assert rne.dynamics.diagnose(light, [0.3, 1.2]).worst_joint == light.joint_names


def test_the_weakest_motion_is_of_the_joints_that_move_nothing():
    """Their diagonal entries are zero."""
    chain = straight_chain(2)
    massless = replace(chain, mass=chain.mass * [1, 0], inertia=chain.inertia * np.array([1, 0])[:, None, None])
    assert rne.dynamics.diagnose(massless, [0.3, 1.2]).worst_joint == ("joint1",)


def test_digits_are_those_of_the_dtype(irb140):
    q = np.full(6, 0.3)
    single, double, long = (irb140.diagnose(q, dtype=t).digits for t in (np.float32, np.float64, np.longdouble))
    assert double - single == pytest.approx(np.log10(np.finfo("f4").eps / EPS))
    assert long > double + 3
    assert irb140.diagnose(q.astype(np.float32)).digits == pytest.approx(single, abs=1e-4)
    assert irb140.diagnose(np.array([mpmath.mpf(0.3)] * 6)).digits == double


@pytest.mark.parametrize("n", [10, 20, 40])
def test_straight_chains_lose_what_is_said(n):
    """Condition 4 n^4; the articulated bodies lose fewer digits, none of the methods more."""
    robot = rne.Robot(straight_chain(n))
    q, (_, qd, tau) = np.zeros(n), states(n)
    found = robot.diagnose(q)
    assert 0.1 <= found.condition / (4 * n**4) <= 10
    expected = exact_forward(robot, q, qd, tau) if n == 10 else None
    if expected is not None:
        error = np.abs(rne.dynamics.forward_dynamics(robot.model, q, qd, tau) - expected).max() / np.abs(expected).max()
        assert error <= 10 ** -(found.digits - 1)


def test_a_singular_M_is_a_finding_not_an_error():
    robot = gimbal()
    found = robot.diagnose([[0.1, 0.5, 0.2], [0.1, 0.0, 0.2]])
    assert found.digits[0] > 13
    assert np.isinf(found.condition[1])
    assert found.digits[1] == 0
    assert found.worst_state == (1,)
    assert found.worst_joint == ("j0", "j2")
    assert (
        str(found)
        == "worst of 2 states is (1,): M is singular to working precision: a motion of j0, j2 moves no inertia"
    )


def test_every_joint_of_the_weakest_motion_is_named_however_small_its_part():
    """Three sliders in a plane: the third is the first and a fiftieth of the second; a fourth one stands apart."""
    third = np.array([0.98, 0.02, 0.0]) / np.hypot(0.98, 0.02)
    axes = {"along": X, "across": Y, "oblique": third, "apart": Z}
    parts = [Part(link="base")]
    for k, (name, axis) in enumerate(axes.items()):
        body = {"mass": 1.0} if k == 3 else {}
        parts.append(Part(link=name, joint=name, kind="prismatic", axis=axis, parent=k, **body))
    robot = rne.Robot(assemble("plane", parts))
    assert robot.diagnose(np.zeros(4)).worst_joint == ("along", "across", "oblique")
    with pytest.raises(rne.SingularMassMatrixError) as caught:
        robot.forward_dynamics(np.zeros(4), np.zeros(4), np.zeros(4))
    assert caught.value.joints == ("along", "across", "oblique")


def test_a_joint_that_moves_nothing_is_named():
    parts = [Part(link="base"), Part(link="a", joint="idle", kind="continuous", parent=0, axis=Z)]
    found = rne.Robot(assemble("empty", parts)).diagnose([0.0])
    assert (found.condition, found.pivot, found.digits, found.worst_joint) == (np.inf, 0, 0, ("idle",))


def test_digits_of_a_motion_are_those_of_skeels_amplification():
    """max |M^-1| (|M| |qdd| + |tau| + |h|) / max |qdd|, of which each state of a batch has its own."""
    robot = rne.Robot(random_tree(3, seed=4))
    q, qd, tau = states(3, 4)
    M, h = robot.mass_matrix(q), robot.bias_torque(q, qd)
    inverse = np.abs(np.linalg.inv(M))
    qdd = robot.forward_dynamics(q, qd, tau)
    terms = np.einsum("kij,kj->ki", np.abs(M), np.abs(qdd)) + np.abs(tau) + np.abs(h)
    expected = np.einsum("kij,kj->ki", inverse, terms).max(axis=-1) / np.abs(qdd).max(axis=-1)
    found = robot.diagnose(q, qd, tau)
    assert found.digits == pytest.approx(-np.log10(EPS * expected), abs=1e-6)
    assert found.worst_state == (int(expected.argmax()),)


def test_a_robot_at_rest_without_gravity_keeps_all_digits():
    found = rne.dynamics.diagnose(replace(random_tree(3, seed=4), gravity=np.zeros(3)), *np.zeros((3, 3)))
    assert found.digits == -np.log10(EPS)


def test_no_joints_and_no_states_are_sound(irb140):
    still = rne.Robot(assemble("still", [Part(link="base", mass=1.0)])).diagnose([])
    assert (still.condition, still.pivot, still.worst_joint) == (1, 1, ())
    assert still.condition.shape == still.pivot.shape == ()
    assert (
        str(still)
        == "condition 1.0e+00, smallest pivot 1.0e+00 of its diagonal entry, about 16 digits in forward dynamics"
    )
    none = irb140.diagnose(np.zeros((0, 6)))
    assert none.condition.shape == (0,)
    assert str(none) == "no states"


def test_what_is_no_state_is_refused(irb140):
    with pytest.raises(ValueError, match=r"^`q` must be finite, got nan at index \(2,\)$"):
        irb140.diagnose([0, 0, np.nan, 0, 0, 0])
    with pytest.raises(ValueError, match=r"^`q` must have shape \(\.\.\., 6\) for robot 'irb140', got \(5,\)$"):
        irb140.diagnose(np.zeros(5))
    with pytest.raises(ValueError, match=r"^`q` must be real floating point, got complex128$"):
        irb140.diagnose(np.zeros(6) + 1j)
    with pytest.raises(ValueError, match=r"^`dtype` must be real floating point, got int64$"):
        irb140.diagnose(np.zeros(6), dtype=np.int64)


@pytest.mark.parametrize("link_inertia", [0.0, 1e-12, 1e-9])
def test_a_closing_gimbal_is_right_or_refused(link_inertia):
    """The middle axis closes to 1e-10 rad; an answer has the digits that diagnose says it has."""
    robot = gimbal(link_inertia)
    refused = 0
    for exponent in range(1, 11):
        q = [0.3, 10.0**-exponent, -0.8]
        found = robot.diagnose(q)
        assert {"j0", "j2"} <= set(found.worst_joint)
        answers = right_or_refused(robot, q, [0.5, -0.7, 0.9], [1.0, 2.0, 3.0], 50 * 10.0 ** -float(found.digits))
        if not np.isfinite(found.condition):
            assert found.digits == 0
            refused += answers == 0
    assert refused >= 2 * (link_inertia < 1e-14)


def test_parallel_sliders_are_refused_whatever_their_direction():
    rng = np.random.default_rng(0)
    for _ in range(50):
        axis = rng.normal(size=3)
        robot = sliders(axis / np.sqrt(axis @ axis), rng.uniform(-3, 3))
        assert np.isinf(robot.diagnose([0.1, 0.2]).condition)
        assert right_or_refused(robot, [0.1, 0.2], [0.3, 0.4], [1.0, 2.0], 0) == 0


def test_nearly_parallel_sliders_are_right_or_refused():
    for exponent in range(18):
        robot = sliders(np.array([0.6, 0.0, 0.8]), 0.7, light=10.0**-exponent)
        digits = float(robot.diagnose([0.1, 0.2]).digits)
        answers = right_or_refused(robot, [0.1, 0.2], [0.3, 0.4], [1.0, 2.0], 50 * 10.0**-digits)
        assert answers == 3 or exponent >= 14


class TestWithRatesAndTorques:
    def test_digits_are_those_that_cancellation_leaves(self, irb140):
        """Torques that balance the terms in qd squared: the amplification grows with the square of the rates."""
        q, qd, qdd = states(6, 20)
        for rate in (1.0, 1e2, 1e4):
            tau = irb140.inverse_dynamics(q, rate * qd, qdd)
            digits = irb140.diagnose(q, rate * qd, tau).digits
            got = irb140.forward_dynamics(q, rate * qd, tau)
            for k in (0, 7):
                expected = exact_forward(irb140, q[k], rate * qd[k], tau[k])
                error = np.abs(got[k] - expected).max() / np.abs(expected).max()
                assert error <= 10 * 10 ** -digits[k]
                assert error >= 1e-3 * 10 ** -digits[k] or error < 1e-14

    def test_shapes_broadcast_and_a_singular_M_has_none(self, irb140):
        q, qd, tau = states(6, 5)
        assert irb140.diagnose(q[0], qd, tau).digits.shape == irb140.diagnose(q[0], qd, tau).condition.shape == (5,)
        assert gimbal().diagnose([0.1, 0.0, 0.2], [1, 2, 3], [1, 2, 3]).digits == 0

    def test_one_singular_state_does_not_spoil_the_others(self):
        q = [[0.1, 0.5, 0.2], [0.1, 0.0, 0.2]]
        found = gimbal().diagnose(q, np.ones(3), np.ones(3))
        assert found.digits[0] > 13
        assert found.digits[1] == 0
        assert found.worst_state == (1,)

    def test_what_overflows_has_none(self, irb140):
        assert irb140.diagnose([0.3] * 6, [1e200] * 6, [1.0] * 6).digits == 0

    def test_an_arm_at_rest_without_gravity_has_all(self):
        from dataclasses import replace

        still = rne.Robot(replace(rne.irb140(), gravity=np.zeros(3)))
        assert still.diagnose([0.1] * 6, [0] * 6, [0] * 6).digits > 15

    def test_one_without_the_other_is_refused(self, irb140):
        with pytest.raises(ValueError, match=r"^`qd` and `tau` go together, got only `tau`$"):
            irb140.diagnose([0] * 6, tau=[0] * 6)
        with pytest.raises(ValueError, match=r"^`tau` must be finite, got nan at index \(0,\)$"):
            irb140.diagnose([0] * 6, [0] * 6, [np.nan] * 6)


class TestWarnings:
    TEXT = "forward dynamics keep about {} digits{}: {}; see Robot.diagnose"

    def test_rates_that_leave_no_digit_are_warned_of(self, irb140):
        q, qd, qdd = (x[:3] for x in states(6, 3))
        fast = 1e8 * np.sign(qd)
        tau = irb140.inverse_dynamics(q, fast, qdd)
        calls = [irb140.forward_dynamics, lambda *s: rne.dynamics.forward_dynamics(irb140.model, *s)]
        calls.append(lambda *s: rne.dynamics.articulated_forward_dynamics(irb140.model, *s))
        for call in calls:
            with pytest.warns(rne.PrecisionWarning) as said:
                call(q, fast, tau)
            assert len(said) == 1
            assert str(said[0].message).startswith("forward dynamics keep about 0 digits at state (")
            assert str(said[0].message).endswith(
                "the torques and C qd + g cancel at joint velocities of 1.0e+08 rad/s or m/s; see Robot.diagnose"
            )
            assert said[0].filename == __file__

    def test_a_kernel_warns_near_a_singular_M(self):
        robot = sliders(np.array([0.6, 0.0, 0.8]), 0.7, light=5e-14)
        state = np.array([0.1, 0.2]), np.array([0.3, 0.4]), np.array([1.0, 2.0])
        expected = self.TEXT.format(2, "", "M is nearly singular")
        for call in (robot.forward_dynamics, robot.kernel(rne.dynamics.forward_dynamics)):
            with pytest.warns(rne.PrecisionWarning) as said:
                call(*state)
            assert [str(w.message) for w in said] == [expected]

    def test_fast_rates_alone_are_no_reason(self, irb140):
        """Without torques that cancel them, the digits are there."""
        q, qd, _ = states(6, 3)
        irb140.forward_dynamics(q, 1e8 * qd, np.zeros_like(q))

    def test_float32_is_warned_of_at_rates_of_its_own(self, irb140):
        q, qd, qdd = (x.astype(np.float32) for x in states(6, 3))
        tau = irb140.inverse_dynamics(q, 1000 * qd, qdd)
        with pytest.warns(rne.PrecisionWarning):
            irb140.forward_dynamics(q, 1000 * qd, tau)

    def test_external_wrenches_count(self, irb140):
        q, qd = np.linspace(0.3, 0.8, 6), np.full(6, 1e6)
        external = {"link_6": np.full(6, 1e12)}
        with pytest.warns(rne.PrecisionWarning):
            irb140.forward_dynamics(
                q, qd, irb140.inverse_dynamics(q, qd, np.ones(6), external=external), external=external
            )
        irb140.forward_dynamics(q, qd, irb140.inverse_dynamics(q, qd, np.ones(6)), external=external)

    def test_a_batch_warns_once_of_a_state_of_its_own(self):
        robot = sliders(np.array([0.6, 0.0, 0.8]), 0.7, light=5e-14)
        q = np.tile([0.1, 0.2], (3, 2000, 1))
        tau = np.where(np.arange(6000).reshape(3, 2000, 1) == 5000, [2.0, 2.0], [1.0, 2.0])
        with pytest.warns(rne.PrecisionWarning) as said:
            robot.kernel(rne.dynamics.forward_dynamics)(q, q + [0.2, 0.2], tau)
        assert len(said) == 1
        assert said[0].filename == __file__
        worst = robot.diagnose(q, q + [0.2, 0.2], tau).worst_state
        assert worst == (2, 1000)
        assert f"at state {worst}" in str(said[0].message)

    def test_a_state_that_is_fast_and_near_singular_is_told_once(self):
        robot = sliders(np.array([0.6, 0.0, 0.8]), 0.7, light=5e-14)
        with pytest.warns(rne.PrecisionWarning) as said:
            robot.forward_dynamics([0.1, 0.2], [3e5, 4e5], [1.0, 2.0])
        assert len(said) == 1

    def test_a_simulation_warns_once(self):
        robot = sliders(np.array([0.6, 0.0, 0.8]), 0.7, light=5e-14)
        with pytest.warns(rne.PrecisionWarning) as said:
            rne.simulate(robot, [0.1, 0.2], [0.3, 0.4], 0.1, torque=[1.0, 2.0])
        assert len(said) == 1
        assert "M is nearly singular" in str(said[0].message)
