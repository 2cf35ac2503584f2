"""Laws of physics on random trees: no oracle, only the functions against each other."""

import numpy as np
import pytest

import rne
from rne.commands.agreement import against_energies
from rne.dynamics.kinematics import coordinate_map, joint_accelerations, on_coordinates
from rne.dynamics.rnea import newton_euler

from .helpers import EPS, loaded, relative, states

LAW = 1e-12  # of the largest entry
STEP = 1e-30  # of the complex step: exact derivatives


def along(function, q, qd):
    """Time derivative of function(q) along qd."""
    return function(q + 1j * STEP * qd).imag / STEP


def gradient(function, q):
    """Derivatives of a scalar by each component of q."""
    return function(q[..., None, :] + 1j * STEP * np.eye(q.shape[-1])).imag / STEP


def multiply(M, v):
    return (M @ v[..., None])[..., 0]


def coriolis_size(tree, q, qd):
    """What C is made of, also where it cancels, as on a single joint."""
    return np.abs(rne.dynamics.mass_matrix(tree, q)).max() * np.abs(qd).max()


def test_mass_matrix_is_symmetric_to_the_last_bit(tree):
    M = rne.dynamics.mass_matrix(tree, states(tree.n, 10)[0])
    assert np.array_equal(M, np.swapaxes(M, -1, -2))


def test_mass_matrix_is_positive_definite(tree):
    assert (np.linalg.eigvalsh(rne.dynamics.mass_matrix(tree, states(tree.n, 10)[0])) > 0).all()


def test_columns_of_the_mass_matrix_are_torques_of_unit_accelerations(tree):
    q, qd, _ = states(tree.n, 5)
    bias = rne.dynamics.bias_torque(tree, q, qd)
    M = rne.dynamics.mass_matrix(tree, q)
    for j in range(tree.n):
        column = rne.dynamics.inverse_dynamics(tree, q, 0 * qd, np.eye(tree.n)[j]) - rne.dynamics.gravity_torque(
            tree, q
        )
        assert relative(column, M[..., j]) <= LAW * max(1, np.abs(bias).max() / np.abs(M[..., j]).max())


def test_inverse_dynamics_is_mass_matrix_times_acceleration_plus_bias(tree):
    q, qd, qdd = states(tree.n, 10)
    expected = multiply(rne.dynamics.mass_matrix(tree, q), qdd) + rne.dynamics.bias_torque(tree, q, qd)
    assert relative(rne.dynamics.inverse_dynamics(tree, q, qd, qdd), expected) <= LAW


def test_kinetic_energy_is_half_qd_M_qd(tree):
    q, qd, _ = states(tree.n, 10)
    half = (qd * multiply(rne.dynamics.mass_matrix(tree, q), qd)).sum(-1) / 2
    np.testing.assert_allclose(rne.dynamics.kinetic_energy(tree, q, qd), half, rtol=LAW)


def test_kinetic_energy_is_the_sum_over_links(tree):
    q, qd, _ = states(tree.n, 10)
    np.testing.assert_allclose(
        rne.dynamics.link_kinetic_energies(tree, q, qd).sum(-1), rne.dynamics.kinetic_energy(tree, q, qd), rtol=LAW
    )


def test_gravity_torque_is_the_gradient_of_potential_energy(tree):
    q, _, _ = states(tree.n, 10)
    assert (
        relative(rne.dynamics.gravity_torque(tree, q), gradient(lambda x: rne.dynamics.potential_energy(tree, x), q))
        <= LAW
    )


def test_mass_matrix_rate_is_C_plus_its_transpose(tree):
    q, qd, _ = states(tree.n, 10)
    C = rne.dynamics.coriolis_matrix(tree, q, qd)
    Md = along(lambda x: rne.dynamics.mass_matrix(tree, x), q, qd)
    assert np.abs(C + np.swapaxes(C, -1, -2) - Md).max() <= LAW * coriolis_size(tree, q, qd)


def test_coriolis_matrix_times_rate_is_the_coriolis_torque(tree):
    q, qd, _ = states(tree.n, 10)
    torque = rne.dynamics.coriolis_torque(tree, q, qd)
    size = coriolis_size(tree, q, qd) * np.abs(qd).max()
    assert np.abs(multiply(rne.dynamics.coriolis_matrix(tree, q, qd), qd) - torque).max() <= LAW * size


def test_coriolis_matrix_is_that_of_the_christoffel_symbols(tree):
    q, qd, _ = states(tree.n)
    dM = np.array([along(lambda x: rne.dynamics.mass_matrix(tree, x), q, e) for e in np.eye(tree.n)])  # [k, i, j]
    C = np.einsum("kij,k->ij", dM, qd) + np.einsum("jik,k->ij", dM, qd) - np.einsum("ijk,k->ij", dM, qd)
    assert np.abs(rne.dynamics.coriolis_matrix(tree, q, qd) - C / 2).max() <= LAW * coriolis_size(tree, q, qd)


def test_bias_is_coriolis_plus_gravity(tree):
    q, qd, _ = states(tree.n, 10)
    expected = rne.dynamics.coriolis_torque(tree, q, qd) + rne.dynamics.gravity_torque(tree, q)
    assert relative(rne.dynamics.bias_torque(tree, q, qd), expected) <= LAW


def test_forward_dynamics_undoes_inverse_dynamics(tree):
    q, qd, qdd = states(tree.n, 10)
    tau = rne.dynamics.inverse_dynamics(tree, q, qd, qdd)
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(tree, q))
    error = np.abs(rne.dynamics.forward_dynamics(tree, q, qd, tau) - qdd).max(-1) / np.abs(qdd).max(-1)
    size = np.abs(tau).max(-1) / (np.linalg.norm(rne.dynamics.mass_matrix(tree, q), axis=(1, 2)) * np.abs(qdd).max(-1))
    assert (error <= 4 * tree.n * kappa * EPS * (1 + size)).all()


def test_inverse_dynamics_undoes_forward_dynamics(tree):
    q, qd, tau = states(tree.n, 10)
    qdd = rne.dynamics.forward_dynamics(tree, q, qd, tau)
    size = (
        np.abs(multiply(rne.dynamics.mass_matrix(tree, q), qdd)).max()
        + np.abs(rne.dynamics.bias_torque(tree, q, qd)).max()
    )
    assert np.abs(rne.dynamics.inverse_dynamics(tree, q, qd, qdd) - tau).max() <= LAW * size


def test_articulated_bodies_agree_with_the_mass_matrix(tree):
    if tree.has_mimics:
        with pytest.raises(rne.ModelError):
            rne.dynamics.articulated_forward_dynamics(tree, *states(tree.n))
        return
    q, qd, tau = states(tree.n, 10)
    wrenches = {tree.link_names[-1]: np.arange(6.0)}
    a = rne.dynamics.articulated_forward_dynamics(tree, q, qd, tau, external=wrenches)
    b = rne.dynamics.forward_dynamics(tree, q, qd, tau, external=wrenches)
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(tree, q)).max()
    assert relative(a, b) <= 20 * kappa * EPS


def test_power_of_drives_and_outside_is_the_rate_of_energy(tree):
    q, qd, qdd = states(tree.n, 10)
    link = tree.link_names[-1]
    wrench = np.random.default_rng(0).normal(size=6)
    tau = rne.dynamics.inverse_dynamics(tree, q, qd, qdd, external={link: wrench})
    kinetic = along_state(lambda x, v: rne.dynamics.kinetic_energy(tree, x, v), q, qd, qdd)
    potential = along(lambda x: rne.dynamics.potential_energy(tree, x), q, qd)
    R = rne.dynamics.link_poses(tree, q)[:, tree.link_index(link), :3, :3]
    twist = multiply(rne.dynamics.jacobian(tree, q, link), qd)
    outside = (twist[:, :3] * multiply(R, wrench[None, :3])).sum(-1) + (
        twist[:, 3:] * multiply(R, wrench[None, 3:])
    ).sum(-1)
    power = (tau * qd).sum(-1)
    np.testing.assert_allclose(power + outside, kinetic + potential, atol=LAW * np.abs(power).max())


def along_state(function, q, qd, qdd):
    return function(q + 1j * STEP * qd, qd + 1j * STEP * qdd).imag / STEP


def test_momentum_rate_is_the_wrench_of_base_and_gravity(tree):
    q, qd, qdd = states(tree.n)
    record = rne.dynamics.recursion(tree, q, qd, qdd)
    open_tree, origin = newton_euler(tree, q, qd, qdd, tree.gravity), tree.joint_origin  # without what moves a coupling
    rate = along_state(lambda x, v: rne.dynamics.momentum(tree, x, v), q, qd, qdd)
    poses = {body: T for body, T in zip(tree.link_body, rne.dynamics.link_poses(tree, q), strict=True) if body >= 0}
    carried = np.zeros(6)
    frames = body_frames(tree, q)
    for i in range(tree.nb):
        R, p = frames[i]
        if tree.parent[i] < 0:
            f, tau = R @ open_tree.f[i], R @ (open_tree.n[i] - np.cross(origin[i], open_tree.f[i]))
            if not record.not_known:
                np.testing.assert_allclose(
                    [R @ record.f[i], R @ record.tau[i]], [f, tau], atol=LAW * np.abs(tau).max(), rtol=LAW
                )
            carried += np.concatenate([tau + np.cross(p, f), f])
        weight = tree.mass[i] * tree.gravity
        carried += np.concatenate([np.cross(p + R @ tree.com[i], weight), weight])
    assert len(poses) == tree.nb
    np.testing.assert_allclose(rate, carried, atol=LAW * np.abs(carried).max() * 10)


def body_frames(tree, q):
    """Pose of each body's own frame, from the link its joint carries."""
    poses = rne.dynamics.link_poses(tree, q)
    where = [tree.link_joints.index(joint) for joint in tree.moving_joints]
    return [(poses[k, :3, :3], poses[k, :3, 3]) for k in where]


def test_torque_is_linear_in_the_inertial_parameters(tree):
    from dataclasses import replace

    s = states(tree.n, 5)
    doubled = replace(tree, mass=2 * tree.mass, inertia=2 * tree.inertia)
    assert relative(rne.dynamics.inverse_dynamics(doubled, *s), 2 * rne.dynamics.inverse_dynamics(tree, *s)) <= LAW


def test_armature_adds_to_the_diagonal_and_to_the_energy(tree):
    from dataclasses import replace

    q, qd, qdd = states(tree.n, 5)
    armature = np.linspace(0.1, 1.0, tree.nb)
    geared = replace(tree, armature=armature)
    G = coordinate_map(tree, q)  # the drive of a joint that follows others turns with them
    added = np.swapaxes(G, -1, -2) @ np.diag(armature) @ G
    assert relative(rne.dynamics.mass_matrix(geared, q), rne.dynamics.mass_matrix(tree, q) + added) <= LAW
    rotors = on_coordinates(tree, q, armature * joint_accelerations(tree, q, qd, qdd))
    tau = rne.dynamics.inverse_dynamics(tree, q, qd, qdd) + rotors
    assert relative(rne.dynamics.inverse_dynamics(geared, q, qd, qdd), tau) <= LAW
    forward = rne.dynamics.forward_dynamics if tree.has_mimics else rne.dynamics.articulated_forward_dynamics
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(geared, q)).max()
    assert relative(forward(geared, q, qd, tau), qdd) <= 100 * kappa * EPS


def test_pivots_are_scaled_by_the_diagonal_of_M(tree):
    """Both methods return M's diagonal, armature included, by which their pivots are judged."""
    from dataclasses import replace

    q, qd, tau = states(tree.n, 5)
    geared = replace(tree, armature=np.linspace(10.0, 100.0, tree.nb))
    expected = np.diagonal(rne.dynamics.mass_matrix(geared, q), axis1=-2, axis2=-1)
    methods = (
        [rne.dynamics.forward_dynamics]
        if tree.has_mimics
        else [rne.dynamics.forward_dynamics, rne.dynamics.articulated_forward_dynamics]
    )
    for method in methods:
        _, pivots, diagonal = method.core(geared, q, qd, tau)
        np.testing.assert_allclose(diagonal, expected, rtol=LAW)
        assert (pivots <= diagonal * (1 + LAW)).all()


def test_kinetic_energy_with_armature_is_half_qd_M_qd(tree):
    from dataclasses import replace

    q, qd, _ = states(tree.n, 5)
    geared = replace(tree, armature=np.linspace(0.1, 1.0, tree.nb))
    half = (qd * multiply(rne.dynamics.mass_matrix(geared, q), qd)).sum(-1) / 2
    np.testing.assert_allclose(rne.dynamics.kinetic_energy(geared, q, qd), half, rtol=LAW)


def test_euler_lagrange_from_the_energies_gives_the_same_torque(tree):
    found = {row.quantity: row.worst for row in against_energies(rne.Robot(tree), 5)}
    assert max(found[x] for x in ("inverse dynamics", "gravity", "bias", "mass matrix")) <= LAW


def test_acceleration_of_a_link_is_J_qdd_plus_Jd_qd(tree):
    q, qd, qdd = states(tree.n, 5)
    record = rne.dynamics.recursion(tree, q, qd, qdd)
    i = tree.nb - 1
    link = tree.link_names[tree.link_joints.index(tree.moving_joints[i])]
    a = multiply(rne.dynamics.jacobian(tree, q, link), qdd) + multiply(
        rne.dynamics.jacobian_rate(tree, q, qd, link), qd
    )
    R = rne.dynamics.link_poses(tree, q)[:, tree.link_index(link), :3, :3]
    expected = np.concatenate([multiply(R, record.alpha[:, i]), multiply(R, record.a_o[:, i])], axis=-1)
    assert relative(a, expected) <= LAW


def test_the_root_link_does_not_move(tree):
    q, qd, _ = states(tree.n, 2)
    root = tree.link_names[0]
    for J in (rne.dynamics.jacobian(tree, q, root), rne.dynamics.jacobian_rate(tree, q, qd, root)):
        np.testing.assert_array_equal(J, np.zeros((2, 6, tree.n)))


def test_jacobian_rate_is_the_derivative_of_the_jacobian(tree):
    q, qd, _ = states(tree.n, 5)
    for link in tree.link_names:
        Jd = along(lambda x, link=link: rne.dynamics.jacobian(tree, x, link), q, qd)
        got = rne.dynamics.jacobian_rate(tree, q, qd, link)
        assert np.abs(got - Jd).max() <= LAW * max(1.0, np.abs(Jd).max()), link


def test_jacobian_is_the_derivative_of_the_pose(tree):
    q, qd, _ = states(tree.n, 5)
    velocity = along(lambda x: rne.dynamics.link_poses(tree, x), q, qd)
    poses = rne.dynamics.link_poses(tree, q)
    for k, link in enumerate(tree.link_names):
        twist = multiply(rne.dynamics.jacobian(tree, q, link), qd)
        spin = velocity[:, k, :3, :3] @ np.swapaxes(poses[:, k, :3, :3], -1, -2)
        omega = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1)
        np.testing.assert_allclose(twist, np.concatenate([omega, velocity[:, k, :3, 3]], -1), atol=1e-11)


def test_jacobian_of_a_point_is_the_derivative_of_its_position(tree):
    (q, qd, _), point = states(tree.n, 5), (0.1, -0.2, 0.3)
    for k, link in enumerate(tree.link_names):
        velocity = along(lambda x, k=k: rne.dynamics.link_poses(tree, x)[:, k, :3] @ [*point, 1], q, qd)
        J = rne.dynamics.jacobian(tree, q, link, point)
        np.testing.assert_allclose(multiply(J, qd)[:, 3:], velocity, atol=1e-11)
        Jd = along(lambda x, link=link: rne.dynamics.jacobian(tree, x, link, point), q, qd)
        rate = rne.dynamics.jacobian_rate(tree, q, qd, link, point)
        assert np.abs(rate - Jd).max() <= LAW * max(1.0, np.abs(Jd).max()), link


def test_momentum_is_mass_times_the_velocity_of_the_centre_of_mass(tree):
    q, qd, _ = states(tree.n, 5)
    J = rne.dynamics.centre_of_mass_jacobian(tree, q)
    velocity = along(lambda x: rne.dynamics.centre_of_mass(tree, x), q, qd)
    np.testing.assert_allclose(multiply(J, qd), velocity, atol=LAW * np.abs(velocity).max())
    momentum = rne.dynamics.momentum(tree, q, qd)[:, 3:]
    np.testing.assert_allclose(tree.mass.sum() * multiply(J, qd), momentum, atol=LAW * np.abs(momentum).max())


def test_wrench_on_a_link_appears_as_minus_J_transposed_F(tree):
    q, qd, qdd = states(tree.n, 5)
    for link in tree.link_names:
        F = np.random.default_rng(1).normal(size=6)
        R = rne.dynamics.link_poses(tree, q)[:, tree.link_index(link), :3, :3]
        world = np.concatenate([multiply(R, F[None, :3]), multiply(R, F[None, 3:])], axis=-1)
        JtF = multiply(np.swapaxes(rne.dynamics.jacobian(tree, q, link), -1, -2), world)
        plain = rne.dynamics.inverse_dynamics(tree, q, qd, qdd)
        got = rne.dynamics.inverse_dynamics(tree, q, qd, qdd, external={link: F})
        assert np.abs(plain - JtF - got).max() <= LAW * np.abs(plain).max()


def test_shares_of_gravity_and_friction_ahead():
    robot = loaded("irb140")
    q, friction = np.full(6, 0.3), rne.Friction(viscous=2.0, coulomb=1.0)
    led = rne.control.pd_gravity(robot, 0, 0, 0, scale=0.8)
    np.testing.assert_allclose(led(0.0, q, 0 * q), 0.8 * robot.gravity_torque(q), atol=1e-14)

    def moving(t):
        return q + t, q, 0 * q

    for make in (rne.control.pd_gravity, rne.control.computed_torque):
        plain, ahead = (make(robot, 10, 5, moving, feedforward=f) for f in (None, friction))
        added = ahead(0.0, q, q) - plain(0.0, q, q)
        np.testing.assert_allclose(added, friction.torque(robot.model, q), rtol=1e-9)
        assert rne.Scene(robot, controller=ahead).is_traced
        with pytest.raises(TypeError, match=r"^`feedforward` must be an rne\.Friction, got float$"):
            make(robot, 10, 5, moving, feedforward=1.0)
        with pytest.raises(ValueError, match="`viscous`"):
            make(robot, 10, 5, moving, feedforward=rne.Friction(viscous=[1.0, 2.0]))
    with pytest.raises(ValueError, match="`scale` must not be negative"):
        rne.control.pd_gravity(robot, 0, 0, 0, scale=-1)
