"""Robots small enough to be solved by hand."""

import numpy as np
import pytest

import rne

from .helpers import Part, assemble, pose, states
from .random_robots import straight_chain

TIGHT = 1e-14
G = 9.81


def planar_arm(l1, lc1, m1, I1, lc2, m2, I2):
    """The thesis's two-link example (D.8)-(D.20): both axes z, gravity along -y, angles from the x axis."""
    links = [
        Part(link="base"),
        Part(
            link="upper", joint="shoulder", kind="revolute", parent=0, axis=np.array([0, 0, 1.0]),
            mass=m1, com=np.array([lc1, 0, 0]), inertia=np.diag([0, I1, I1]),
        ),
        Part(
            link="lower", joint="elbow", kind="revolute", parent=1, placement=pose(np.eye(3), [l1, 0, 0]),
            axis=np.array([0, 0, 1.0]), mass=m2, com=np.array([lc2, 0, 0]), inertia=np.diag([0, I2, I2]),
        ),
    ]  # fmt: skip
    return assemble("planar", links, gravity=[0, -G, 0])


def test_planar_arm_of_appendix_D():
    l1, lc1, m1, I1, lc2, m2, I2 = 0.7, 0.3, 2.0, 0.11, 0.25, 1.3, 0.07
    arm = planar_arm(l1, lc1, m1, I1, lc2, m2, I2)
    q, qd, qdd = states(2, 100)
    (q1, q2), (w1, w2), (a1, a2) = q.T, qd.T, qdd.T
    tau2 = (
        I2 * (a1 + a2)
        + m2 * l1 * lc2 * (np.sin(q2) * w1**2 + np.cos(q2) * a1)
        + m2 * lc2**2 * (a1 + a2)
        + m2 * lc2 * G * np.cos(q1 + q2)
    )
    tau1 = (
        tau2
        + I1 * a1
        + m1 * lc1**2 * a1
        + m2 * l1**2 * a1
        + m2 * l1 * lc2 * (np.cos(q2) * (a1 + a2) - np.sin(q2) * (w1 + w2) ** 2)
        + (m1 * lc1 + m2 * l1) * G * np.cos(q1)
    )
    got = rne.dynamics.inverse_dynamics(arm, q, qd, qdd)
    np.testing.assert_allclose(got, np.stack([tau1, tau2], -1), atol=TIGHT * np.abs(got).max() * 4)


def test_torque_of_a_pendulum_is_that_of_the_textbook():
    rod = straight_chain(1, length=0.5, mass=2.0)
    q, qd, qdd = states(1, 50)
    expected = 2.0 * 0.5**2 / 3 * qdd + 2.0 * G * 0.25 * np.sin(q)
    np.testing.assert_allclose(
        rne.dynamics.inverse_dynamics(rod, q, qd, qdd), expected, atol=TIGHT * np.abs(expected).max()
    )


def test_M_and_coriolis_torque_of_a_double_pendulum_are_those_of_the_textbook():
    """Two equal rods: the mass matrix and the centrifugal torque of any textbook."""
    m, l = 1.5, 0.4
    chain = straight_chain(2, length=l, mass=m)
    q, qd, _ = states(2, 50)
    c = np.cos(q[:, 1])
    M = m * l**2 * np.array([[5 / 3 + c, 1 / 3 + c / 2], [1 / 3 + c / 2, 1 / 3 + 0 * c]]).transpose(2, 0, 1)
    np.testing.assert_allclose(rne.dynamics.mass_matrix(chain, q), M, atol=TIGHT)
    k = m * l**2 / 2 * np.sin(q[:, 1])
    C = np.stack([-k * (2 * qd[:, 0] * qd[:, 1] + qd[:, 1] ** 2), k * qd[:, 0] ** 2], -1)
    np.testing.assert_allclose(rne.dynamics.coriolis_torque(chain, q, qd), C, atol=TIGHT * np.abs(C).max() * 4)


def test_slider_on_a_turntable_feels_centrifugal_and_coriolis_force():
    m = 3.0
    table = assemble(
        "turntable",
        [
            Part(link="base"),
            Part(link="table", joint="turn", kind="continuous", parent=0, axis=np.array([0, 0, 1.0])),
            Part(link="bead", joint="slide", kind="prismatic", parent=1, mass=m),
        ],
    )
    q, qd, qdd = states(2, 50)
    r, (w, v), (alpha, a) = q[:, 1], qd.T, qdd.T
    expected = np.stack([m * r**2 * alpha + 2 * m * r * v * w, m * (a - r * w**2)], -1)
    got = rne.dynamics.inverse_dynamics(table, q, qd, qdd)
    np.testing.assert_allclose(got, expected, atol=TIGHT * np.abs(expected).max() * 4)


def test_free_fall_of_a_released_vertical_slider():
    lift = assemble(
        "lift",
        [
            Part(link="base"),
            Part(link="cabin", joint="rail", kind="prismatic", parent=0, axis=np.array([0, 0, 1.0]), mass=7.0),
        ],
    )
    assert rne.dynamics.forward_dynamics(lift, [0.3], [0.0], [0.0])[0] == pytest.approx(-G, rel=1e-15)


def test_a_robot_without_joints_has_empty_answers():
    block = assemble("block", [Part(link="base", mass=1.0)])
    for shape in ((0,), (4, 0)):
        empty = np.zeros(shape)
        assert rne.dynamics.inverse_dynamics(block, empty, empty, empty).shape == shape
        assert rne.dynamics.forward_dynamics(block, empty, empty, empty).shape == shape
        assert rne.dynamics.articulated_forward_dynamics(block, empty, empty, empty).shape == shape
        assert rne.dynamics.mass_matrix(block, empty).shape == (*shape[:-1], 0, 0)
        assert rne.dynamics.coriolis_matrix(block, empty, empty).shape == (*shape[:-1], 0, 0)
        assert rne.dynamics.kinetic_energy(block, empty, empty).shape == shape[:-1]
        assert rne.dynamics.link_poses(block, empty).shape == (*shape[:-1], 1, 4, 4)
        assert rne.dynamics.recursion(block, empty, empty, empty).f.shape == (*shape[:-1], 0, 3)
    assert rne.simulate(rne.Robot(block), [], [], 1.0).energy_drift == 0


def test_kinetic_energy_of_a_body_that_turns_about_its_centre():
    """The folded second link has its centre on the first axis: it only turns, and nothing cancels in its energy."""
    inertia = 1e-9
    model = planar_arm(1.1, 0.5, 1.0, 0.1, 1.1, 10.0, inertia)
    energy = rne.dynamics.link_kinetic_energies(model, [0, np.pi], [1.234, 0])
    assert energy[1] == pytest.approx(inertia * 1.234**2 / 2, rel=1e-12)
