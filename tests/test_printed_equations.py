"""The equations of Høifødt 2011 as printed, against this package; those that do not hold are in tests/test_errata.py."""

import math

import numpy as np
import pytest

import rne
from examples.thesis import experiments, formulations
from rne.basics.spatial import rotation_about
from rne.control import pd_gravity
from rne.model.abb_irb140 import CLOSED_LOOPS, LINKS, frame_rotation

from .helpers import KD, KP, cross_matrix, point_mass_inertia, relative, states
from .test_closed_forms import G, planar_arm

LAW = 1e-12  # of the largest entry: some hundred roundings
STEP = 1e-30  # of the complex step: exact derivatives
PI = math.pi
X, Z = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
REST = np.zeros(6)


def rate(function, q, qd, qdd=0.0):
    """Time derivative of function(q, qd) along a motion."""
    return function(q + 1j * STEP * qd, qd + 1j * STEP * np.asarray(qdd)).imag / STEP


def rotations(q):
    """R_1^0 to R_6^0 by the package's kinematics."""
    return rne.dynamics.link_poses(rne.irb140(), q)[1:7, :3, :3]


def check(found, expected, law=LAW):
    assert relative(np.ravel(found), np.ravel(expected)) <= law


# Chapter 2


def test_rotations_of_chapter_2(irb140):
    """(2.1) to (2.5), and that R is orthogonal with determinant 1."""
    q, _, _ = states(6, seed=21)
    R_10, R_20 = rotations(q)[:2]
    R_21, v = frame_rotation(LINKS[1], q[1]), np.array([0.3, -1.2, 0.7])
    check(R_10[:, 2], irb140.jacobian(q, "link_6")[:3, 1])  # (2.1): the axis of joint 2 is z_1, in frame 0
    check(R_10 @ (R_21 @ v), R_20 @ v)  # (2.2) to (2.4)
    check(R_20, R_10 @ R_21)  # (2.5)
    check(R_20.T @ R_20, np.eye(3))
    assert np.linalg.det(R_20) == pytest.approx(1, abs=1e-14)


def test_skew_symmetric_matrices_of_chapter_2():
    """(2.6), (2.8), (2.9) and (2.11), with the right sign in (2.7)."""
    s, a = np.random.default_rng(22).normal(size=(2, 3))
    S, R = cross_matrix(s), rotations(states(6, seed=22)[0])[4]
    assert not (S.T + S).any()  # (2.6)
    check(S @ a, np.cross(s, a))  # (2.8)
    check(R @ S @ R.T, cross_matrix(R @ s))  # (2.9)
    assert abs(a @ S @ a) <= 1e-15  # (2.11)


def test_rate_of_a_rotation_is_that_of_2_10(irb140):
    q, qd, _ = states(6, seed=23)
    R = rotations(q)
    for i, R_rate in enumerate(rate(lambda x, v: rotations(x), q, qd)):
        omega = R[i] @ irb140.recursion(q, qd, REST).omega[i]
        check(R_rate, cross_matrix(omega) @ R[i])


def test_moments_and_products_of_inertia_of_2_12_to_2_18():
    """Of some points instead of a density."""
    rng = np.random.default_rng(24)
    m, (x, y, z) = rng.uniform(1, 2, 9), rng.normal(size=(3, 9))
    I = point_mass_inertia(m[:, None, None], np.stack([x, y, z], -1)).sum(0)
    Ixx, Iyy, Izz = (m * (y**2 + z**2)).sum(), (m * (x**2 + z**2)).sum(), (m * (x**2 + y**2)).sum()
    Ixy, Ixz, Iyz = -(m * x * y).sum(), -(m * x * z).sum(), -(m * y * z).sum()
    check(I, [[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz], [Ixz, Iyz, Izz]])


# Chapter 3


def turning_body():
    """R, omega in the body's axes, their rates, and an inertia, of link 6 in some motion."""
    q, qd, qdd = states(6, seed=31)
    record = rne.dynamics.recursion(rne.irb140(), q, qd, qdd)
    A = np.random.default_rng(31).normal(size=(3, 3))
    return (q, qd, qdd), rotations(q)[5], record.omega[5], record.alpha[5], A @ A.T


def test_eulers_equation_is_derived_in_3_5_to_3_19():
    motion, R, w, w_rate, I = turning_body()

    def spin(x, v):  # I_0 omega_0 of (3.5), by (3.7) and (3.8)
        R = rotations(x)[5]
        return R @ I @ R.T @ (R @ rne.dynamics.recursion(rne.irb140(), x, v, 0 * x).omega[5])

    tau_0 = rate(spin, *motion)  # (3.5), (3.9)
    R_rate = rate(lambda x, v: rotations(x)[5], *motion[:2])
    w_0, S = R @ w, cross_matrix
    check(R.T @ (R @ I @ R.T) @ R, I)  # (3.6)
    check(R_rate @ I @ w + R @ I @ w_rate, tau_0)  # (3.10), (3.11)
    check(R.T @ (R_rate @ I @ w + R @ I @ w_rate), R.T @ tau_0)  # (3.12), (3.13)
    check(R.T @ R_rate @ I @ w + I @ w_rate, R.T @ tau_0)  # (3.14)
    check(R.T @ S(w_0) @ R @ I @ w + I @ w_rate, R.T @ tau_0)  # (3.15)
    check(S(R.T @ w_0) @ I @ w + I @ w_rate, R.T @ tau_0)  # (3.16), (3.17)
    check(S(w) @ I @ w + I @ w_rate, R.T @ tau_0)  # (3.18)
    check(np.cross(w, I @ w) + I @ w_rate, R.T @ tau_0)  # (3.19), (3.21)


def test_force_is_the_rate_of_momentum_in_3_3_and_3_4():
    """Of link 6, whose mass is 1 kg and which no other link burdens: (3.20), (3.22) to (3.24)."""
    q, qd, qdd = states(6, seed=32)
    model = rne.irb140()

    def momentum(x, v):
        J = rne.dynamics.jacobian(model, x, "link_6")
        turned = rotations(x)[5] @ LINKS[5].r_com
        return LINKS[5].mass * (J[3:] @ v + np.cross(J[:3] @ v, turned))

    R, record = rotations(q)[5], rne.dynamics.recursion(model, q, qd, qdd)
    force = R.T @ rate(momentum, q, qd, qdd)
    check(LINKS[5].mass * record.a_c[5], force, 1e-11)  # (3.4), (3.20)
    check(record.f[5] + LINKS[5].mass * record.gravity[5], force, 1e-11)  # (3.22), (3.23) with f_7 = 0
    check(record.f[5], LINKS[5].mass * record.a_c[5] - LINKS[5].mass * record.gravity[5], 1e-11)  # (3.24)


def velocities_in_frame_0(q, qd):
    """omega_i, v_c,i and v_e,i of all links in frame 0, by (3.28) and (3.34)."""
    R = rotations(q)
    before = [np.eye(3), *R[:5]]
    omega, end, rows = 0 * R[0, 0], 0 * R[0, 0], []
    for i, link in enumerate(LINKS):
        omega = omega + before[i] @ Z * qd[i]  # (3.28)
        centre = end + np.cross(omega, R[i] @ link.r_com)  # (3.34)
        end = end + np.cross(omega, R[i] @ link.r_end)
        rows.append([omega, centre, end])
    return np.array(rows)


def centres_in_frame_0(q):
    """Centres of mass of all links, by the package's kinematics."""
    T = rne.dynamics.link_poses(rne.irb140(), q)[1:7]
    return np.array([T[i, :3, :3] @ link.r_com + T[i, :3, 3] for i, link in enumerate(LINKS)])


def test_velocities_and_accelerations_in_frame_0_of_3_28_to_3_35(irb140):
    q, qd, qdd = states(6, seed=33)
    record, R = irb140.recursion(q, qd, qdd), rotations(q)
    here, there = velocities_in_frame_0(q, qd), rate(velocities_in_frame_0, q, qd, qdd)
    check(here[:, 1], rate(lambda x, v: centres_in_frame_0(x), q, qd))  # (3.34)
    omega_rate = end_rate = np.zeros(3)
    for i, link in enumerate(LINKS):
        z = R[i - 1, :, 2] if i else Z
        omega, r = here[i, 0], R[i] @ link.r_com
        check(R[i].T @ omega, record.omega[i])  # (3.28), (3.29)
        check(R[i].T @ z, irb140.model.axis[i])  # (3.30)
        omega_rate = omega_rate + z * qdd[i] + np.cross(omega, z * qd[i])  # (3.32)
        check(omega_rate, there[i, 0])
        check(R[i].T @ omega_rate, record.alpha[i])  # (3.31), (3.33)
        a_c = end_rate + np.cross(omega_rate, r) + np.cross(omega, np.cross(omega, r))  # (3.35) as it should be
        check(a_c, there[i, 1])
        check(R[i].T @ a_c, record.a_c[i])  # (3.37)
        end_rate = there[i, 2]
        check(R[i].T @ end_rate, record.a_e[i])  # (3.38)


def test_a_rotation_turns_a_cross_product_as_in_3_36():
    a, b = np.random.default_rng(36).normal(size=(2, 3))
    R = rotations(states(6, seed=36)[0])[5]
    check(R @ np.cross(a, b), np.cross(R @ a, R @ b))


# Chapter 4


def rot(axis, angle):
    """(4.1)."""
    return rotation_about(axis, np.asarray(angle))


def test_rotations_of_chapter_4():
    """(4.1) to (4.12); joints 2 and 5 with the offsets of (4.3) and (4.6)."""
    q, _, _ = states(6, seed=41)
    (s1, s2, s3, s4, s5, s6), (c1, c2, c3, c4, c5, c6) = (f(q + [0, -PI / 2, 0, 0, PI, 0]) for f in (np.sin, np.cos))
    printed = [
        [[c1, 0, -s1], [s1, 0, c1], [0, -1, 0]],  # (4.2)
        [[c2, -s2, 0], [s2, c2, 0], [0, 0, 1]],  # (4.3)
        [[c3, 0, -s3], [s3, 0, c3], [0, -1, 0]],  # (4.4)
        [[c4, 0, s4], [s4, 0, -c4], [0, 1, 0]],  # (4.5)
        [[c5, 0, s5], [s5, 0, -c5], [0, 1, 0]],  # (4.6)
        [[c6, -s6, 0], [s6, c6, 0], [0, 0, 1]],  # (4.7)
    ]
    product = np.eye(3)
    for i, R in enumerate(printed):
        check(frame_rotation(LINKS[i], q[i]), R)
        check(rot(Z, q[i] + LINKS[i].theta) @ rot(X, LINKS[i].a), R)  # (4.1)
        product = product @ R  # (4.8) to (4.12)
        check(rotations(q)[i], product)


def test_lengths_of_chapter_4(irb140):
    """(4.13) to (4.24), a second transcription; and r_{i,ci} of (5.42), (5.48) and (5.51)."""
    centres = [[0.014, -0.264, 0.067], [0.201, 0, -0.070], [0, 0, 0], [0, 0.080, 0], [0, 0, 0], [0, 0, 0.029]]
    ends = [[0.070, -0.352, 0], [0.360, 0, 0], [0, 0, 0], [0, 0.380, 0], [0, 0, 0], [0, 0, 0.065]]
    assert irb140.model.com.tolist() == centres
    assert [list(link.r_end) for link in LINKS] == ends
    assert irb140.model.translation[1:].tolist() == ends[:5]
    from_ends = np.subtract(centres, ends)[[3, 1, 0]]
    check(from_ends, [[0, -0.300, 0], [-0.159, 0, -0.070], [-0.056, 0.088, 0.067]])


def test_inertias_of_4_25_to_4_31_with_the_numbers_of_table_4_1(irb140):
    def along_z(m, r, h):  # (4.25)
        return [m * h**2 / 12 + m * r**2 / 4, m * h**2 / 12 + m * r**2 / 4, m * r**2 / 2]

    table = [(27, 0.147, 0.264, "xzy"), (22, 0.108, 0.402, "zyx"), (25, 0.094, 0.600, "xzy"), (1, 0.054, 0.072, "xyz")]
    for i, (m, r, h, order) in zip((0, 1, 3, 5), table, strict=True):  # (4.26), (4.27), (4.29), (4.31)
        entries = along_z(m, r, h)
        check(irb140.model.inertia[i], np.diag([entries["xyz".index(axis)] for axis in order]))
        assert irb140.model.mass[i] == m
    assert not irb140.model.inertia[[2, 4]].any()  # (4.28), (4.30)
    assert not irb140.model.mass[[2, 4]].any()


# Chapter 5


def outwards(q, qd, qdd):
    """(5.8) to (5.31), with the right (5.18): omega, alpha, a_c and, up to link 5, a_e."""
    T = [frame_rotation(link, x).T for link, x in zip(LINKS, q, strict=True)]
    b = rne.irb140().axis  # (5.1) to (5.7)
    centre, end, x = [link.r_com for link in LINKS], [link.r_end for link in LINKS], np.cross
    w1 = b[0] * qd[0]  # (5.9), from (5.8)
    A1 = b[0] * qdd[0] + x(w1, b[0] * qd[0])  # (5.10)
    e1 = x(A1, end[0]) + x(w1, x(w1, end[0]))  # (5.11)
    c1 = x(A1, centre[0]) + x(w1, x(w1, centre[0]))  # (5.12)
    w2 = T[1] @ w1 + b[1] * qd[1]  # (5.13)
    A2 = T[1] @ A1 + b[1] * qdd[1] + x(w2, b[1] * qd[1])  # (5.14)
    e2 = T[1] @ e1 + x(A2, end[1]) + x(w2, x(w2, end[1]))  # (5.15)
    c2 = T[1] @ e1 + x(A2, centre[1]) + x(w2, x(w2, centre[1]))  # (5.16)
    w3 = T[2] @ w2 + b[2] * qd[2]  # (5.17)
    A3 = T[2] @ A2 + b[2] * qdd[2] + x(w3, b[2] * qd[2])  # (5.18)
    e3 = T[2] @ e2  # (5.19)
    c3 = T[2] @ e2  # (5.20)
    w4 = T[3] @ w3 + b[3] * qd[3]  # (5.21)
    A4 = T[3] @ A3 + b[3] * qdd[3] + x(w4, b[3] * qd[3])  # (5.22)
    e4 = T[3] @ e3 + x(A4, end[3]) + x(w4, x(w4, end[3]))  # (5.23)
    c4 = T[3] @ e3 + x(A4, centre[3]) + x(w4, x(w4, centre[3]))  # (5.24)
    w5 = T[4] @ w4 + b[4] * qd[4]  # (5.25)
    A5 = T[4] @ A4 + b[4] * qdd[4] + x(w5, b[4] * qd[4])  # (5.26)
    e5 = T[4] @ e4  # (5.27)
    c5 = T[4] @ e4  # (5.28)
    w6 = T[5] @ w5 + b[5] * qd[5]  # (5.29)
    A6 = T[5] @ A5 + b[5] * qdd[5] + x(w6, b[5] * qd[5])  # (5.30)
    c6 = T[5] @ e5 + x(A6, centre[5]) + x(w6, x(w6, centre[5]))  # (5.31)
    return (w1, w2, w3, w4, w5, w6), (A1, A2, A3, A4, A5, A6), (c1, c2, c3, c4, c5, c6), (e1, e2, e3, e4, e5)


def inwards(q, w, A, c):
    """(5.32) to (5.51): gravity, f and tau of each link."""
    R = [frame_rotation(link, x) for link, x in zip(LINKS, q, strict=True)]
    R0 = rotations(q)
    m, I, x = [link.mass for link in LINKS], rne.irb140().inertia, np.cross
    r = [np.array(link.r_com) for link in LINKS]  # r_{i-1,ci}
    s = [np.subtract(link.r_com, link.r_end) for link in LINKS]  # r_{i,ci}
    spin = [np.cross(w[i], I[i] @ w[i]) + I[i] @ A[i] for i in range(6)]
    g0 = np.array([0, 0, -9.81])  # (5.34)
    g1, g2, g3, g4, g5, g6 = (R0[i].T @ g0 for i in range(6))  # (5.49), (5.46), (5.43), (5.40), (5.37), (5.33)
    f6 = m[5] * c[5] - m[5] * g6  # (5.35), with (5.32)
    t6 = -x(f6, r[5]) + spin[5]  # (5.36)
    f5 = R[5] @ f6  # (5.38)
    t5 = R[5] @ t6 + spin[4]  # (5.39)
    f4 = R[4] @ f5 + m[3] * c[3] - m[3] * g4  # (5.41)
    t4 = R[4] @ t5 - x(f4, r[3]) + x(R[4] @ f5, s[3]) + spin[3]  # (5.42)
    f3 = R[3] @ f4  # (5.44)
    t3 = R[3] @ t4 + spin[2]  # (5.45)
    f2 = R[2] @ f3 + m[1] * c[1] - m[1] * g2  # (5.47)
    t2 = R[2] @ t3 - x(f2, r[1]) + x(R[2] @ f3, s[1]) + spin[1]  # (5.48)
    f1 = R[1] @ f2 + m[0] * c[0] - m[0] * g1  # (5.50)
    t1 = R[1] @ t2 - x(f1, r[0]) + x(R[1] @ f2, s[0]) + spin[0]  # (5.51)
    return (g1, g2, g3, g4, g5, g6), (f1, f2, f3, f4, f5, f6), (t1, t2, t3, t4, t5, t6)


def test_chapter_5_as_printed_is_the_record(irb140):
    """(5.8) to (5.51), and section 5.3: the drive bears the component about b_i."""
    q, qd, qdd = states(6, seed=51)
    record = irb140.recursion(q, qd, qdd)
    omega, alpha, a_c, a_e = outwards(q, qd, qdd)
    gravity, f, tau = inwards(q, omega, alpha, a_c)
    check(record.a_e[:5], a_e)
    rows = {"omega": omega, "alpha": alpha, "a_c": a_c, "gravity": gravity, "f": f, "tau": tau}
    for name, values in rows.items():
        check(getattr(record, name), values)
    check(record.u, [b @ t for b, t in zip(irb140.model.axis, tau, strict=True)])


# Chapter 6


def test_state_of_6_4_to_6_18_is_ours_in_another_order(irb140):
    """(6.1) to (6.18): x = (q1, q1', ..., q6, q6') there, (q, q') here."""
    q, qd, u = states(6, seed=61)
    M, C, g = irb140.mass_matrix(q), irb140.coriolis_matrix(q, qd), irb140.gravity_torque(q)
    x, there = np.stack([q, qd], axis=1).ravel(), np.arange(12).reshape(2, 6).T.ravel()
    scene = rne.Scene(irb140, controller=rne.traceable(lambda t, q, qd: u))
    x_rate = scene.kernel([0.0], np.concatenate([q, qd]))[there]
    check(x_rate[0::2], x[1::2])  # (6.7), (6.9), (6.11), (6.13), (6.15), (6.17)
    check(x_rate[1::2], np.linalg.solve(M, -C @ qd - g + u), 1e-10)  # (6.3); the condition of M is 4e4
    check(M @ x_rate[1::2] + C @ qd + g, u, 1e-10)  # (6.1), with (6.2)


def test_M_can_be_inverted_although_links_3_and_5_have_no_mass(irb140):
    """(6.3) takes that from the kinetic energy, which could vanish in motion; it does not."""
    smallest = np.linalg.eigvalsh(irb140.mass_matrix(states(6, 2000, seed=63)[0]))[:, 0]
    assert 1.3e-3 < smallest.min() <= smallest.max() < 1.5e-3


def test_starts_of_6_3_and_6_4():
    """(6.19), (6.20), (6.22) to (6.29), (6.40) to (6.45)."""
    held = [start for start, _ in experiments.HELD]
    expected = [[0] * 6, [0, 180, -90, 0, 0, 0], [0, 90, -90, 0, 0, 0], [0, 90 + math.degrees(0.05), -90, 0, 0, 0]]
    np.testing.assert_allclose(np.degrees(held), expected, rtol=1e-15)
    assert [list(start) for start in experiments.FREE] == [[0] * 6, [0, 1e-6, 0, 0, 0, 0]]


def test_rate_of_V_takes_every_form_of_6_51_to_6_55(irb140):
    q, qd, _ = states(6, seed=65, rate=1.0)
    reference = np.array(CLOSED_LOOPS[2].reference)
    e, Kp, Kd = q - reference, np.diag(KP), np.diag(KD)
    u = pd_gravity(irb140, KP, KD, reference)(0.0, q, qd)
    qdd = irb140.forward_dynamics(q, qd, u)
    M, C, g = irb140.mass_matrix(q), irb140.coriolis_matrix(q, qd), irb140.gravity_torque(q)
    M_rate = rate(lambda x, v: rne.dynamics.mass_matrix(irb140.model, x), q, qd)

    def V(x, v):  # (6.50)
        error = x - reference
        return v @ rne.dynamics.mass_matrix(irb140.model, x) @ v / 2 + error @ Kp @ error / 2

    forms = [
        qd @ M @ qdd + qd @ M_rate @ qd / 2 + qd @ Kp @ e,  # (6.51)
        qd @ (u - C @ qd - g) + qd @ M_rate @ qd / 2 + qd @ Kp @ e,  # (6.52)
        qd @ (u - g + Kp @ e) + qd @ (M_rate - 2 * C) @ qd / 2,  # (6.53)
        qd @ (u - g + Kp @ e),  # (6.54)
        -qd @ Kd @ qd,  # (6.55)
    ]
    assert forms == pytest.approx([rate(V, q, qd, qdd)] * 5, rel=1e-10)
    check(u, -Kp @ e - Kd @ qd + g)  # (6.46) with the right sign, (6.47), (6.48)
    check(M @ qdd + C @ qd, -Kp @ e - Kd @ qd, 1e-10)  # (6.49), (6.57), (6.58)


def test_the_loop_rests_only_at_its_reference_as_6_56_says(irb140):
    """At rest for good q'' = 0 as well, and 0 = -Kp e: elsewhere the arm is accelerated."""
    q, reference = states(6, seed=66)[0], np.array(CLOSED_LOOPS[0].reference)
    law = pd_gravity(irb140, KP, KD, reference)
    qdd = irb140.forward_dynamics(q, REST, law(0.0, q, REST))
    check(irb140.mass_matrix(q) @ qdd, -np.array(KP) * (q - reference), 1e-10)
    assert np.abs(irb140.forward_dynamics(reference, REST, law(0.0, reference, REST))).max() <= 1e-10


# Chapter 7


def test_starts_of_chapter_7():
    """(7.1) to (7.12): each formulation in its own coordinates."""
    printed = [([0, 180, -90, 0, 0, 0], [0, 180, 90, 0, 0, 0]), ([0, 180, 90, 0, 0, 0], [0, 180, -90, 0, 0, 0])]
    for start, (newton, lagrange) in zip(formulations.STARTS.values(), printed, strict=True):
        np.testing.assert_allclose(np.degrees(start), newton, rtol=1e-15)
        np.testing.assert_allclose(np.degrees(formulations.MIRROR * start), lagrange, rtol=1e-15)


# Appendix D


def test_planar_arm_of_D_8_to_D_20():
    l1, lc1, m1, I1, lc2, m2, I2 = 0.7, 0.3, 2.0, 0.11, 0.25, 1.3, 0.07
    q, qd, qdd = states(2, seed=8)
    record = rne.dynamics.recursion(planar_arm(l1, lc1, m1, I1, lc2, m2, I2), q, qd, qdd)
    (s1, s2), (c1, c2), i, k, x = np.sin(q), np.cos(q), X, Z, np.cross
    s12, c12, spin, spin_rate = np.sin(q.sum()), np.cos(q.sum()), qd.sum(), qdd.sum()
    R_21 = np.array([[c2, -s2, 0], [s2, c2, 0], [0, 0, 1]])
    g1, g2, (f1, f2), (t1, t2) = record.gravity[0], record.gravity[1], record.f, record.tau
    centre_1, end_1 = lc1 * i, l1 * i  # (D.9)
    from_end_1, centre_2 = (lc1 - l1) * i, lc2 * i  # (D.9), (D.10)
    check(record.omega[1], spin * k)  # (D.8)
    check(g1, -G * np.array([s1, c1, 0]))  # the right side of (D.11)
    a_e1 = np.array([-l1 * qd[0] ** 2 * c2 + l1 * qdd[0] * s2, l1 * qd[0] ** 2 * s2 + l1 * qdd[0] * c2, 0])
    check(R_21.T @ record.a_e[0], a_e1)  # (D.13), (D.14)
    check(record.a_e[0], x(qdd[0] * k, end_1) + x(qd[0] * k, x(qd[0] * k, end_1)))
    check(record.a_c[1], a_e1 + x(spin_rate * k, centre_2) + x(spin * k, x(spin * k, centre_2)))  # (D.12)
    check(record.a_c[1], a_e1 + [-lc2 * spin**2, lc2 * spin_rate, 0])  # (D.15)
    check(g2, -G * np.array([s12, c12, 0]))  # (D.16)
    torque_2 = I2 * spin_rate + m2 * l1 * lc2 * (s2 * qd[0] ** 2 + c2 * qdd[0]) + m2 * lc2**2 * spin_rate
    check(t2[2], torque_2 + m2 * lc2 * G * c12)  # (D.17)
    check(f1, R_21 @ f2 + m1 * record.a_c[0] - m1 * g1)  # (D.18)
    alpha_1 = np.array([0, 0, I1 * qdd[0]])  # I_1 alpha_1; omega_1 x I_1 omega_1 = 0
    carried = x(R_21 @ f2, from_end_1)
    check(t1, R_21 @ t2 - x(f1, centre_1) + carried + alpha_1)  # (D.19)
    weight, inertia = x(m1 * g1, centre_1), x(m1 * record.a_c[0], centre_1)
    check(t1, t2 - inertia + weight - x(R_21 @ f2, end_1) + alpha_1)  # (D.20)
