"""The errors of Høifødt 2011 listed in docs/errata.md, each shown by numbers: the printed line against the right one."""

import ast
import functools
import itertools
import re
from dataclasses import replace

import mpmath
import numpy as np
import pytest

import rne
from examples.thesis import closed_loop
from examples.thesis.formulations import STARTS, THESIS
from rne.basics.spatial import rotation_about
from rne.control import pd_gravity
from rne.model import cylinder_inertia
from rne.model.abb_irb140 import CLOSED_LOOPS, LINKS, frame_rotation

from .helpers import KD, KP, ROOT, kept, relative, states
from .test_closed_forms import planar_arm

LAW = 1e-12  # of the largest entry
STEP = 1e-30  # of the complex step: exact derivatives
ERRATA = (ROOT / "docs" / "errata.md").read_text(encoding="utf-8")


def rate(function, q, qd, qdd):
    """Time derivative of function(q, qd) along a motion."""
    return function(q + 1j * STEP * qd, qd + 1j * STEP * qdd).imag / STEP


def true_acceleration(model, link, point, q, qd, qdd):
    """Acceleration of a point of a link in the link's axes: positions alone, differenced twice with 60 digits."""
    with mpmath.workdps(60):
        number = np.vectorize(mpmath.mpf, otypes=[object])
        q, qd, qdd, h = number(q), number(qd), number(qdd), mpmath.mpf(10) ** -20
        poses = [
            rne.dynamics.link_poses(model, q + t * qd + t * t / 2 * qdd)[model.link_index(link)] for t in (-h, 0, h)
        ]
        before, now, after = (T[:3, :3] @ number(point) + T[:3, 3] for T in poses)
        return (poses[1][:3, :3].T @ ((before - 2 * now + after) / h**2)).astype(float)


# 1. After (3.31)


def test_alpha_is_the_rate_of_omega_in_the_axes_of_the_link(tree):
    q, qd, qdd = states(tree.n, 5)
    record = rne.dynamics.recursion(tree, q, qd, qdd)
    omega_dot = rate(lambda x, v: rne.dynamics.recursion(tree, x, v, qdd).omega, q, qd, qdd)
    assert relative(omega_dot, record.alpha) <= LAW


def test_alpha_is_the_rate_of_omega_in_the_axes_of_the_base(irb140):
    q, qd, qdd = states(6, seed=1)

    def omega_in_base(x, v):
        R = irb140.link_poses(x)[1:7, :3, :3]
        return (R @ irb140.recursion(x, v, qdd).omega[..., None])[..., 0]

    R = irb140.link_poses(q)[1:7, :3, :3]
    in_link = (np.swapaxes(R, -1, -2) @ rate(omega_in_base, q, qd, qdd)[..., None])[..., 0]
    assert relative(in_link, irb140.recursion(q, qd, qdd).alpha) <= LAW


# 2. (3.35) and (D.5)


def centre_acceleration(irb140, printed):
    """The acceleration of link 2's centre by (3.37), or with the cross that stands alone in (3.35), and the true one."""
    motion = states(6, seed=2)
    record = irb140.recursion(*motion)
    start = record.a_o[1]  # of the frame's origin, a_e,1 seen from frame 2
    r, w, alpha = LINKS[1].r_com, record.omega[1], record.alpha[1]
    spin = np.cross(w, np.cross(w, r))
    line = np.cross(start, r) + spin if printed else start + np.cross(alpha, r) + spin
    return line, true_acceleration(irb140.model, "link_2", r, *motion)


def test_acceleration_with_omega_dot_cross_r_is_that_of_the_kinematics(irb140):
    line, truth = centre_acceleration(irb140, printed=False)
    assert relative(line, truth) <= LAW


def test_acceleration_as_printed_in_3_35_is_not_that_of_the_kinematics(irb140):
    line, truth = centre_acceleration(irb140, printed=True)
    assert np.linalg.norm(line - truth) == pytest.approx(8.4, abs=0.05)


# 3. (6.46)


def closed_loop_poles(irb140, reference, sign):
    """Eigenvalues at the reference, at rest, under u = g(q) + sign Kp (q - reference) - Kd qd."""
    rest = np.zeros(6)
    A, B = irb140.linearize(reference, rest, irb140.gravity_torque(reference))
    g_slope = rne.kernels.derivative(rne.dynamics.gravity_torque, irb140.model, "q")(reference)
    return np.linalg.eigvals(A + B @ np.hstack([g_slope + sign * np.diag(KP), -np.diag(KD)]))


@pytest.mark.parametrize("scene", CLOSED_LOOPS)
def test_loop_with_the_printed_sign_of_6_46_is_unstable(irb140, scene):
    rates = closed_loop_poles(irb140, np.array(scene.reference), +1).real
    assert (rates > 0).sum() == 6
    assert rates.max() == pytest.approx(2.727, abs=1e-3)


@pytest.mark.parametrize("scene", CLOSED_LOOPS)
def test_loop_with_the_right_sign_is_stable(irb140, scene):
    assert -1.7 < closed_loop_poles(irb140, np.array(scene.reference), -1).real.max() < -1.2


def test_arm_leaves_the_reference_under_the_printed_sign(irb140):
    reference = np.array(CLOSED_LOOPS[0].reference)

    def wrong(t, q, qd):
        return irb140.gravity_torque(q) + KP * (q - reference) - np.multiply(KD, qd)

    motion = rne.simulate(irb140, reference + 1e-3, np.zeros(6), 2.0, torque=wrong)
    assert np.abs(motion.q[-1] - reference).max() > 0.2


# 4. (6.70)


def energy_rate(irb140, sign, stray=0.0):
    """dE/dt and -qd^T Fv qd where M qdd + C qd + sign Fv qd + stray qd + g = 0."""
    q, qd, _ = states(6, seed=4)
    Fv = np.linspace(1.0, 6.0, 6)
    qdd = irb140.forward_dynamics(q, qd, -sign * Fv * qd - stray * qd)
    power = rate(
        lambda x, v: rne.dynamics.kinetic_energy(irb140.model, x, v) + rne.dynamics.potential_energy(irb140.model, x),
        q,
        qd,
        qdd,
    )
    return power, -(Fv * qd**2).sum()


def test_friction_beside_the_inertia_takes_qd_Fv_qd_from_the_energy(irb140):
    power, loss = energy_rate(irb140, +1)
    assert power == pytest.approx(loss, rel=1e-11)


def test_a_rate_by_itself_as_printed_in_6_70_would_be_one_more_friction(irb140):
    power, loss = energy_rate(irb140, +1, stray=1.0)
    qd = states(6, seed=4)[1]
    assert power == pytest.approx(loss - qd @ qd, rel=1e-11)


def test_friction_on_the_other_side_of_6_70_would_feed_the_arm(irb140):
    power, loss = energy_rate(irb140, -1)
    assert power == pytest.approx(-loss, rel=1e-11)


# 5. (5.18)


def alpha_3(irb140, qdd_3, q, qd, qdd):
    """(5.18): the angular acceleration of link 3 with `qdd_3` beside b_3."""
    record = irb140.recursion(q, qd, qdd)
    b = irb140.model.axis[2]
    return frame_rotation(LINKS[2], q[2]).T @ record.alpha[1] + b * qdd_3 + np.cross(record.omega[2], b * qd[2])


def test_alpha_3_with_b_3_qdd_3_is_the_rate_of_omega_3(irb140):
    q, qd, qdd = states(6, seed=5)
    omega_dot = rate(lambda x, v: irb140.recursion(x, v, qdd).omega[2], q, qd, qdd)
    assert relative(alpha_3(irb140, qdd[2], q, qd, qdd), omega_dot) <= LAW


def test_alpha_3_as_printed_in_5_18_is_off_by_qdd_3_less_qd_3(irb140):
    q, qd, qdd = states(6, seed=5)
    omega_dot = rate(lambda x, v: irb140.recursion(x, v, qdd).omega[2], q, qd, qdd)
    error = np.linalg.norm(omega_dot - alpha_3(irb140, qd[2], q, qd, qdd))
    assert error == pytest.approx(abs(qdd[2] - qd[2]), rel=1e-12)
    assert error > 1


# 6. Saturated torques in 6.5.3


def lyapunov(irb140, q, qd, reference):
    """V of (6.50)."""
    error = q - reference
    return rne.dynamics.kinetic_energy(irb140.model, q, qd) + (np.array(KP) * error * error).sum(-1) / 2


def saturated_rate(irb140, q, qd, reference, limit):
    """dV/dt by complex step, what (6.55) says, and the term that saturation adds to it."""
    asked = pd_gravity(irb140, KP, KD, reference)(0.0, q, qd)
    given = np.clip(asked, -limit, limit)
    qdd = irb140.forward_dynamics(q, qd, given)
    slope = rate(lambda x, v: lyapunov(irb140, x, v, reference), q, qd, qdd)
    return slope, -(KD * qd**2).sum(), qd @ (given - asked)


def test_rate_of_V_is_6_55_while_no_torque_is_saturated(irb140):
    q, qd, _ = states(6, seed=6, rate=1.0)
    slope, said, extra = saturated_rate(irb140, q, qd, np.zeros(6), np.inf)
    assert extra == 0
    assert slope == pytest.approx(said, rel=1e-11)


def test_saturation_adds_qd_times_the_torque_cut_off_to_the_rate_of_V(irb140):
    q, qd, _ = states(6, seed=6, rate=1.0)
    slope, said, extra = saturated_rate(irb140, q, qd, np.zeros(6), 30.0)
    assert abs(extra) > 1
    assert slope == pytest.approx(said + extra, rel=1e-11)


def test_V_grows_under_a_limit_above_every_holding_torque(irb140):
    """Arm stretched out and sinking at 0.5 rad/s, away from a reference a quarter turn above it; limit 160 N m."""
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (1000, 6))
    assert np.abs(irb140.gravity_torque(angles)).max() <= 158.84
    q = np.array([0, np.pi / 2, -np.pi / 2, 0, 0, 0])
    slope, said, _ = saturated_rate(irb140, q, 0.5 * np.eye(6)[1], np.array([0, 0, -np.pi / 2, 0, 0, 0]), 160.0)
    assert said == -5
    assert slope == pytest.approx(38.7, abs=0.1)


def test_V_grows_along_run_6_5_2_with_drives_of_60_newton_metres(irb140):
    scene = CLOSED_LOOPS[1]
    reference = np.array(scene.reference)
    law = pd_gravity(irb140, KP, KD, reference)
    motion = rne.simulate(
        irb140, scene.start, np.zeros(6), scene.duration, method="LSODA", t_eval=np.linspace(0, 5, 501),
        torque=lambda t, q, qd: np.clip(law(t, q, qd), -60, 60),
    )  # fmt: skip
    V = lyapunov(irb140, motion.q, motion.qd, reference)
    assert (V - np.minimum.accumulate(V)).max() == pytest.approx(147.7, abs=0.5)
    assert np.abs(motion.q[-1] - reference).max() == pytest.approx(1.99, abs=0.01)


# 7. Stiffness of the closed loop in 7.2 and table 7.1


def fastest(irb140, q):
    """Largest eigenvalue of M^-1 Kd [1/s]."""
    return np.linalg.eigvals(np.linalg.solve(irb140.mass_matrix(q), np.diag(KD))).real.max(-1)


def test_fastest_mode_of_the_closed_loop_at_zero(irb140):
    assert fastest(irb140, np.zeros(6)) == pytest.approx(15_291, abs=0.5)


def test_fastest_mode_over_the_workspace(irb140):
    modes = fastest(irb140, np.random.default_rng(0).uniform(-np.pi, np.pi, (20_000, 6)))
    assert 15_089 <= modes.min() <= 15_090
    assert 15_290 <= modes.max() <= 15_291


def evaluations(irb140, method, rtol, closed):
    scene = CLOSED_LOOPS[0]
    law = pd_gravity(irb140, KP, KD, scene.reference) if closed else None
    return rne.simulate(irb140, scene.start, np.zeros(6), 0.2, torque=law, method=method, rtol=rtol).evaluations


@pytest.mark.parametrize("rtol", kept([1e-3, 1e-6], [1e-3]))
def test_stability_and_not_accuracy_holds_an_explicit_method_to_its_steps(irb140, rtol):
    assert evaluations(irb140, "RK45", rtol, closed=True) == pytest.approx(6500, rel=0.1)


def test_open_loop_and_a_stiff_method_are_free_of_those_steps(irb140):
    assert evaluations(irb140, "RK45", 1e-6, closed=False) < 100
    assert evaluations(irb140, "LSODA", 1e-6, closed=True) < 600


@pytest.mark.long  # 0.2 s of the runs are above
def test_whole_runs_take_72_to_73_times_the_evaluations_of_the_open_loop(irb140):
    opened = rne.simulate(irb140, STARTS["7.1-2"], np.zeros(6), 10.0, **THESIS).evaluations
    for scene in CLOSED_LOOPS:
        law = pd_gravity(irb140, KP, KD, scene.reference)
        closed = rne.simulate(irb140, scene.start, np.zeros(6), scene.duration, torque=law, method="RK45").evaluations
        assert closed / opened == pytest.approx(72.3, abs=0.8)


# 8. (6.38)


def height_of_link_6(q, printed):
    """(6.38), with the cos q4 of its last term or as printed without."""
    s23, c23, s5, c5 = (
        np.sin(q[..., 1] + q[..., 2]),
        np.cos(q[..., 1] + q[..., 2]),
        np.sin(q[..., 4]),
        np.cos(q[..., 4]),
    )
    c4 = 1 if printed else np.cos(q[..., 3])
    return 0.352 + 0.360 * np.cos(q[..., 1]) - 0.380 * s23 + 0.029 * (-s23 * c5 - c23 * c4 * s5)


def height_by_kinematics(irb140, q):
    T = irb140.link_poses(q)[..., irb140.model.link_index("link_6"), :, :]
    return (T[..., :3, :3] @ [0, 0, 0.029] + T[..., :3, 3])[..., 2]


def test_height_of_link_6_with_cos_q4_is_that_of_the_kinematics(irb140):
    q, _, _ = states(6, 100)
    np.testing.assert_allclose(height_of_link_6(q, printed=False), height_by_kinematics(irb140, q), atol=1e-14)


def test_height_as_printed_in_6_38_holds_at_q4_zero_and_nowhere_else(irb140):
    q, _, _ = states(6, 100)
    assert 0.04 < np.abs(height_of_link_6(q, printed=True) - height_by_kinematics(irb140, q)).max() <= 0.058
    q[:, 3] = 0
    np.testing.assert_allclose(height_of_link_6(q, printed=True), height_by_kinematics(irb140, q), atol=1e-14)


@pytest.mark.parametrize("q2", kept([0.0, 1e-6], [0.0]))
def test_energy_variations_of_6_4_5_are_those_of_6_38(irb140, q2):
    """Both free swings with ode45's method and tolerances; the first 5 s, where all solvers still agree."""
    swing = rne.simulate(irb140, [0, q2, 0, 0, 0, 0], np.zeros(6), 10.0, method="RK45", rtol=1e-6, atol=1e-6)
    wrong = swing.energy + 9.81 * (height_of_link_6(swing.q, printed=True) - height_by_kinematics(irb140, swing.q))
    assert np.ptp(swing.energy) < 5e-4
    assert np.ptp(wrong[swing.t <= 5]) == pytest.approx(0.78, abs=0.03)


# 9. (2.7)


def skew(s, printed):
    """(2.7), the general skew-symmetric matrix, or as printed with -s2 in row 1, column 3."""
    s1, s2, s3 = s
    return np.array([[0, -s3, -s2 if printed else s2], [s3, 0, -s1], [-s2, s1, 0]])


def test_S_of_2_7_with_s2_in_row_1_is_skew_symmetric_and_gives_the_cross_product():
    s, a = np.random.default_rng(9).normal(size=(2, 3))
    S = skew(s, printed=False)
    assert not (S + S.T).any()
    np.testing.assert_allclose(S @ a, np.cross(s, a), rtol=0, atol=1e-15)


def test_S_as_printed_in_2_7_is_neither():
    s, a = np.random.default_rng(9).normal(size=(2, 3))
    S = skew(s, printed=True)
    np.testing.assert_array_equal(S + S.T, -2 * s[1] * np.array([[0, 0, 1], [0, 0, 0], [1, 0, 0]]))
    np.testing.assert_allclose(S @ a - np.cross(s, a), [-2 * s[1] * a[2], 0, 0], rtol=0, atol=1e-15)
    assert abs(2 * s[1] * a[2]) > 0.1


# 10. List of vectors


def test_a_e_is_the_acceleration_of_the_origin_of_frame_i_and_not_of_the_next(irb140):
    """The origin of the thesis's frame i is that of link_{i+1}; frame 1's and 2's are apart by link 2's length."""
    motion = states(6, seed=9)
    a_e = irb140.recursion(*motion).a_e[0]
    R = frame_rotation(LINKS[1], motion[0][1])
    frame_1 = R @ true_acceleration(irb140.model, "link_2", np.zeros(3), *motion)
    R = R @ frame_rotation(LINKS[2], motion[0][2])
    frame_2 = R @ true_acceleration(irb140.model, "link_3", np.zeros(3), *motion)
    assert relative(a_e, frame_1) <= LAW
    assert relative(a_e, frame_2) > 0.1


# 11. 6.1


def test_a_relative_tolerance_of_1_as_printed_in_6_1_gives_another_motion(irb140):
    printed, meant, fine = (
        rne.simulate(irb140, np.zeros(6), np.zeros(6), 0.5, method="RK45", rtol=rtol, atol=1e-6).q[-1]
        for rtol in (float(1**-6), 1e-6, 1e-9)
    )
    assert np.abs(meant - fine).max() < 1e-5
    assert np.abs(printed - fine).max() > 0.1


# 12. (D.11)


def planar_record(q):
    """The arm of appendix D at rest: both axes along z, gravity along -y."""
    arm = planar_arm(0.7, 0.3, 2.0, 0.11, 0.25, 1.3, 0.07)
    return rne.dynamics.recursion(arm, q, np.zeros(2), np.zeros(2))


def g_j_in_frame_1(q):
    """(R_1^0)^T g j, the middle of (D.11) as printed."""
    return rotation_about(np.array([0, 0, 1.0]), q[0]).T @ [0, 9.81, 0]


def test_g_1_of_D_11_is_minus_g_j_in_frame_1():
    q = np.array([0.4, -1.1])
    right_side = -9.81 * np.array([np.sin(q[0]), np.cos(q[0]), 0])
    np.testing.assert_allclose(-g_j_in_frame_1(q), right_side, atol=1e-15)
    np.testing.assert_allclose(planar_record(q).gravity[0], right_side, atol=1e-14)


def test_g_1_by_the_middle_of_D_11_turns_every_holding_torque_round():
    q = np.array([0.4, -1.1])
    assert np.linalg.norm(g_j_in_frame_1(q) - planar_record(q).gravity[0]) == pytest.approx(2 * 9.81)
    in_base = rotation_about(np.array([0, 0, 1.0]), q[0]) @ g_j_in_frame_1(q)
    upside_down = replace(planar_arm(0.7, 0.3, 2.0, 0.11, 0.25, 1.3, 0.07), gravity=in_base)
    wrong, right = rne.dynamics.gravity_torque(upside_down, q), planar_record(q).u
    np.testing.assert_allclose(wrong, -right, rtol=1e-13)
    assert right[1] == pytest.approx(1.3 * 0.25 * 9.81 * np.cos(q.sum()), rel=1e-13)


# 13. 6.3.1


def test_gravity_on_joint_4_is_that_of_the_bent_hand(irb140):
    q, _, _ = states(6, 100, seed=13)
    expected = 1 * 9.81 * 0.029 * np.sin(q[:, 3]) * np.sin(q[:, 4]) * np.cos(q[:, 1] + q[:, 2])
    np.testing.assert_allclose(irb140.gravity_torque(q)[:, 3], expected, rtol=0, atol=1e-14)
    for start in ([0, 0, 0], [0, np.pi, -np.pi / 2], [0, np.pi / 2, -np.pi / 2]):
        assert abs(irb140.gravity_torque([*start, 0, 0, 0])[3]) <= 1e-16  # the positions of 6.3


def test_joint_4_at_rest_is_not_free_of_gravity_as_6_3_1_says(irb140):
    q = np.array([0, 0, 0, 1.0, 1.0, 0])
    held = irb140.recursion(q, np.zeros(6), np.zeros(6))
    assert held.u[3] == pytest.approx(0.201, abs=5e-4)
    released = irb140.forward_dynamics(q, np.zeros(6), held.u * (np.arange(6) != 3))
    assert released[3] == pytest.approx(-1.80, abs=5e-3)  # the other drives hold: without its own torque it turns


# 14. Appendix C


def test_drives_1_3_and_4_are_y_components_in_appendix_C(irb140):
    record = irb140.recursion(*states(6, 20, seed=14))
    np.testing.assert_array_equal(record.u[:, 0], -record.tau[:, 0, 1])
    np.testing.assert_array_equal(record.u[:, 2], -record.tau[:, 2, 1])
    np.testing.assert_array_equal(record.u[:, 3], record.tau[:, 3, 1])


def test_x_components_as_appendix_C_labels_them_are_not_the_drives(irb140):
    record = irb140.recursion(*states(6, 20, seed=14))
    for k in (0, 3):
        assert (np.abs(np.abs(record.tau[:, k, 0]) - np.abs(record.u[:, k])) > 0.1).all()
    rest = np.zeros(6)
    x, y, _ = irb140.recursion(rest, rest, rest).tau[0]
    assert y == 0
    assert x == pytest.approx(2.64, abs=5e-3)


# 15. Section 2.5


def leading_minors(A):
    return [np.linalg.det(A[:k, :k]) for k in range(1, len(A) + 1)]


def principal_minors(A):
    chosen = [list(c) for k in range(1, len(A) + 1) for c in itertools.combinations(range(len(A)), k)]
    return [np.linalg.det(A[np.ix_(c, c)]) for c in chosen]


def test_leading_minors_do_not_show_that_a_matrix_is_semidefinite():
    A = np.diag([0.0, -1.0])
    assert leading_minors(A) == [0, 0]
    assert np.linalg.eigvalsh(A).min() == -1
    assert min(principal_minors(A)) == -1


def test_all_principal_minors_show_that_a_matrix_is_semidefinite():
    """On symmetric matrices of small integers, many of them singular; and of positive ones the leading minors do."""
    found = set()
    for entries in np.random.default_rng(15).integers(-1, 3, (300, 6)):
        A = np.zeros((3, 3))
        A[np.triu_indices(3)] = entries
        A = np.triu(A) + np.triu(A, 1).T
        smallest, rounding = np.linalg.eigvalsh(A).min(), 1e-12
        assert (min(principal_minors(A)) >= -rounding) == (smallest >= -rounding)
        assert (min(leading_minors(A)) > rounding) == (smallest > rounding)
        found.add((smallest >= -rounding, min(leading_minors(A)) >= -rounding))
    assert found == {(True, True), (False, False), (False, True)}  # the last are what 2.5 says cannot be


# 16. Section 5.1


def test_b_i_is_constant_for_any_arm_and_any_frames():
    """b_i by the angular velocities (3.29), with frames turned anyhow in their links."""
    rng = np.random.default_rng(16)
    arm = rne.dh_chain(a=rng.normal(size=5), alpha=rng.normal(size=5), d=rng.normal(size=5), theta=rng.normal(size=5))
    found = []
    for q in rng.normal(size=(3, 5)):
        R = rne.dynamics.link_poses(arm, q)[1:6, :3, :3]
        at_1 = [rne.dynamics.recursion(arm, q, qd, 0 * q).omega for qd in np.eye(5)]  # each joint alone at 1 rad/s
        np.testing.assert_allclose([(R[i] @ at_1[i][i]) @ R[i - 1, :, 2] for i in range(1, 5)], 1, rtol=1e-14)
        found.append([at_1[i][i] for i in range(5)])
    np.testing.assert_allclose(found, np.broadcast_to(found[0], (3, 5, 3)), atol=1e-15)


# 17 and 18. Limits to the rate of torques, and friction, in 6.5.3


def test_a_limit_of_1e5_newton_metres_per_second_makes_the_wrist_overshoot(monkeypatch):
    """188^2 / (2 1e5 1.46e-3) = 122 rad/s, and the motion its own 8.6; only the first 0.1 s."""
    monkeypatch.setattr(closed_loop, "RATE_DURATION", 0.1)
    ideal, limited = (closed_loop.vary(0, closed_loop.VARIATIONS[k]) for k in (0, -2))
    assert (ideal.rate, ideal.increase) == (pytest.approx(8.6, abs=0.1), 0)
    assert (limited.rate, limited.increase) == (pytest.approx(132, abs=1), pytest.approx(34, abs=1))


@pytest.mark.parametrize("k", kept([0, 1, 2], [0]))
def test_a_limit_of_3e3_newton_metres_per_second_makes_the_loop_diverge(k):
    limited = closed_loop.vary(k, closed_loop.VARIATIONS[-1])
    assert limited.rate > 500
    assert limited.settling == np.inf


def test_friction_delays_run_6_5_1_or_leaves_it_short_of_its_reference():
    ideal, viscous, coulomb = (closed_loop.vary(0, closed_loop.VARIATIONS[k]) for k in (0, 2, 3))
    assert (ideal.settling, viscous.settling) == (pytest.approx(2.814, abs=5e-3), pytest.approx(4.582, abs=5e-3))
    assert np.log(np.pi / 0.01) * (20 + 20) / 50 == pytest.approx(4.60, abs=5e-3)  # of the wrist alone
    assert coulomb.settling == np.inf
    assert coulomb.error == pytest.approx(0.074, abs=1e-3)
    assert coulomb.error < 5 / 50  # friction by stiffness


# 19. Section 2.3


def test_diagonal_entries_are_principal_moments_in_principal_axes_only():
    I = cylinder_inertia(2.0, 0.1, 0.5, "z")
    R = rotation_about(np.array([1.0, 0, 0]), np.array(0.7))
    turned = R @ I @ R.T
    np.testing.assert_allclose(np.linalg.eigvalsh(turned), np.sort(np.diag(I)), rtol=1e-13)
    assert np.abs(np.sort(np.diag(turned)) - np.sort(np.diag(I))).max() > 0.01


# 20. R_{i+1}^i


def test_R_takes_coordinates_of_the_next_frame_to_this_one(irb140):
    """(3.24) of link 2, where link 3 has no mass of its own: f_2 = R_3^2 f_3 + m_2 (a_c,2 - g_2)."""
    q, qd, qdd = states(6, seed=20)
    record = irb140.recursion(q, qd, qdd)
    R = frame_rotation(LINKS[2], q[2])
    own = LINKS[1].mass * (record.a_c[1] - record.gravity[1])
    assert relative(R @ record.f[2] + own, record.f[1]) <= LAW
    assert relative(R.T @ record.f[2] + own, record.f[1]) > 0.1


# The page itself


def named_tests():
    return re.findall(r"`(tests/\w+\.py)::(\w+)`", ERRATA)


@functools.cache
def defined_tests(file):
    return [node.name for node in ast.parse((ROOT / file).read_text(encoding="utf-8")).body if hasattr(node, "name")]


def test_every_test_named_in_the_errata_exists():
    assert named_tests()
    for file, name in named_tests():
        assert name in defined_tests(file), f"{file}::{name}"


def test_every_erratum_names_a_test():
    sections = re.split(r"^## ", ERRATA, flags=re.MULTILINE)[1:]
    numbers = [section.split(".")[0] for section in sections]
    assert numbers == [str(k) for k in range(1, 23)]
    untested = [n for n, section in zip(numbers, sections, strict=True) if "No test: a slip of wording." in section]
    assert untested == ["21", "22"]
    for number, section in zip(numbers, sections, strict=True):
        assert ("`tests/" in section) == (number not in untested), section.splitlines()[0]


def test_every_test_of_this_file_is_named_in_the_errata():
    here = defined_tests("tests/test_errata.py")
    about_the_page = here[here.index("defined_tests") :]
    shown = [name for name in here if name.startswith("test_") and name not in about_the_page]
    assert set(shown) == {name for file, name in named_tests() if file == "tests/test_errata.py"}
