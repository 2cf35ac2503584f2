"""Torques and energies as linear functions of the inertial parameters."""

import re

import numpy as np
import pytest

import rne
from rne.dynamics.kinematics import joint_accelerations, joint_velocities, on_coordinates

from .conftest import TREES
from .helpers import Oracle, data_robots, kept, loaded
from .test_oracle import LOADABLE, ONE_OF_EACH_KIND

ROUNDING = 1e-14  # of the largest term of Y pi, times the number of bodies it is added up over, from 10 on
SAME = 1e-13  # of the largest entry: another order of operations


def random_states(robot, arrays=3, count=5):
    return np.random.default_rng(0).uniform(-2, 2, (arrays, count, robot.n))


def close(got, expected, bound=SAME):
    size = max(np.abs(expected).max(initial=0), 1e-300)
    assert np.abs(got - expected).max(initial=0) <= bound * size


@pytest.fixture(params=kept(["irb140", "panda", *TREES], ["irb140", "mixed", "mimics"]), scope="module")
def robot(request):
    return rne.Robot(TREES[request.param]) if request.param in TREES else loaded(request.param)


@pytest.fixture(params=kept(LOADABLE, ONE_OF_EACH_KIND))
def data_arm(request):
    return loaded(request.param), data_robots()[request.param].read_text()


def test_torques_are_linear_in_the_parameters(data_arm):
    robot, _ = data_arm
    q, qd, qdd = random_states(robot)
    Y, pi = robot.regressor(q, qd, qdd), robot.parameters
    joints = list(robot.model.independent_joints)
    rotors = robot.model.armature[joints] * qdd
    terms = np.abs(Y * pi).max(initial=0)
    assert np.abs(Y @ pi + rotors - robot.inverse_dynamics(q, qd, qdd)).max(initial=0) <= terms * ROUNDING * max(
        1, robot.model.nb / 10
    )


def test_regressor_is_pinocchios(data_arm):
    robot, xml = data_arm
    model = robot.model
    oracle = Oracle(model, xml)
    columns = np.concatenate([np.arange(10) + 10 * (k - 1) for k in oracle.joint_ids] or [np.zeros(0, int)])
    for q, qd, qdd in zip(*random_states(robot, count=2), strict=True):
        arguments = oracle.q(q), oracle.velocities(qd), oracle.velocities(qdd)
        theirs = oracle.pin.computeJointTorqueRegressor(oracle.theirs, oracle.data, *arguments)
        theirs = model.coordinate_map.T @ theirs[oracle.v][:, columns]
        close(robot.regressor(q, qd, qdd), theirs, 1e-12 if model.nb > 12 else SAME)


def test_form_for_adaptive_control(robot):
    q, qd, qdr, qddr = random_states(robot, 4)
    torques = robot.control_regressor(q, qd, qdr, qddr) @ robot.parameters
    M, C = robot.mass_matrix(q), robot.coriolis_matrix(q, qd)
    expected = np.einsum("...ij,...j->...i", M, qddr) + np.einsum("...ij,...j->...i", C, qdr) + robot.gravity_torque(q)
    model = robot.model
    rotors = on_coordinates(model, q, model.armature * joint_accelerations(model, q, qd, qddr, qdr))
    close(torques, expected - rotors, SAME * 10)


def test_rate_of_m_less_twice_c_is_skew(robot):
    """Both from the regressor alone: M e_j and C e_j are its torques for reference accelerations and rates e_j."""
    q, qd, _ = random_states(robot)
    n, unit = robot.n, np.eye(robot.n)
    pi, zero = robot.parameters, np.zeros((1, 1, robot.n))

    def columns(q, qd, qdr, qddr):
        """Torques for each unit vector, as columns, less those of gravity."""
        q, qd = q[:, None, :], qd[:, None, :]
        gravity = robot.control_regressor(q, qd, zero, zero) @ pi
        return np.swapaxes(robot.control_regressor(q, qd, qdr, qddr) @ pi - gravity, -1, -2)

    C = columns(q, qd, unit[None], zero)
    h = 1e-5
    dM = (columns(q + h * qd, qd, zero, unit[None]) - columns(q - h * qd, qd, zero, unit[None])) / (2 * h)
    S = dM - 2 * C
    assert S.shape[-2:] == (n, n)
    size = np.abs(robot.mass_matrix(q)).max()  # C of one joint is zero but for rounding
    assert np.abs(S + np.swapaxes(S, -1, -2)).max() <= 1e-8 * size  # of the differences
    assert np.abs(C - robot.coriolis_matrix(q, qd)).max() <= SAME * 10 * size


def test_energies_are_linear_in_the_parameters(robot):
    q, qd, _ = random_states(robot)
    model, pi = robot.model, robot.parameters
    rotors = model.armature * joint_velocities(model, q, qd) ** 2 / 2
    close(rne.dynamics.kinetic_energy_regressor(model, q, qd) @ pi + rotors.sum(-1), robot.kinetic_energy(q, qd))
    base = robot.potential_energy(q) - rne.dynamics.potential_energy_regressor(model, q) @ pi
    np.testing.assert_allclose(base, base[0], atol=1e-12 * np.abs(robot.potential_energy(q)).max() + 1e-12)


def test_work_of_each_parameter_is_its_energy(robot):
    """Along any motion qd.Y = d/dt (y_T + y_U), column by column."""
    model = robot.model
    (q0,), (a,), (b,) = random_states(robot, count=1)

    def energies(t):
        q, qd = q0 + a * t + b * t * t, a + 2 * b * t
        return rne.dynamics.kinetic_energy_regressor(model, q, qd) + rne.dynamics.potential_energy_regressor(model, q)

    t, h = 0.3, 1e-4
    power = (a + 2 * b * t) @ robot.regressor(q0 + a * t + b * t * t, a + 2 * b * t, 2 * b)
    slope = (8 * (energies(t + h) - energies(t - h)) - (energies(t + 2 * h) - energies(t - 2 * h))) / (12 * h)
    np.testing.assert_allclose(slope, power, atol=1e-8 * np.abs(power).max(initial=1))


def test_parameters_there_and_back(robot):
    again = robot.with_parameters(robot.parameters)
    close(again.parameters, robot.parameters)
    q, qd, qdd = random_states(robot)
    close(again.inverse_dynamics(q, qd, qdd), robot.inverse_dynamics(q, qd, qdd), 1e-12)
    assert again.engine == robot.engine


def test_parameters_of_the_irb140(irb140):
    """Link 2: 22 kg; its first moment is 22 kg times its centre; (4.22)."""
    rows = irb140.parameters.reshape(6, 10)
    assert rows[:, 0].tolist() == irb140.model.mass.tolist()
    np.testing.assert_allclose(rows[:, 1:4], irb140.model.mass[:, None] * irb140.model.com)


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        (lambda pi: pi[:-1], ValueError, "`parameters` must have shape (60,), ten per body, got (59,)"),
        (
            lambda pi: np.where(np.arange(60) == 3, np.nan, pi),
            ValueError,
            "`parameters` must be finite, got nan at index (3,)",
        ),
        (
            lambda pi: np.where(np.arange(60) == 10, 0.0, pi),
            ValueError,
            "`parameters`: the body of joint 'joint_2' has a first moment and no mass",
        ),
    ],
)
def test_wrong_parameters(irb140, change, error, text):
    with pytest.raises(error, match=f"^{re.escape(text)}$"):
        irb140.with_parameters(change(irb140.parameters))


def test_impossible_bodies_are_refused(irb140):
    negative = irb140.parameters.copy()
    negative[20] = -1.0
    with pytest.raises(rne.ModelError, match=r"^body of joint 'joint_3': "):
        irb140.with_parameters(negative)
