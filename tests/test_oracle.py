"""Every quantity against Pinocchio, joints mapped by name."""

import numpy as np
import pinocchio as pin
import pytest

import rne

from .helpers import EPS, Oracle, data_robots, each, kept, loaded, relative, states

EXACT = 1e-13  # of the largest entry: a few tens of roundings on six joints
DATA = 1e-12  # robots of up to a hundred joints
# Not a fixed-base tree of supported, physical parts; the loader says why (tested below).
REFUSED = {
    "alex_description/alex_psyonic_hands": "<mimic> names the unknown joint 'index_q1'",
    "romeo_description/romeo_laas_small": "link 'LHipPitch_link': <inertia>: the inertia must have no negative eigenvalue",
    "ur_description/ur3": "there is no <link>",
}
LOADABLE = [name for name in data_robots() if name not in REFUSED]
ONE_OF_EACH_KIND = [  # no joint, a chain, a tree, and branches with sliding joints and a mimic
    "iris_description/iris_simple",
    "ur_description/ur5_robot",
    "solo_description/solo12",
    "panda_description/panda",
]


@pytest.fixture(params=["irb140", "ur5"], scope="module")
def arm(request):
    return request.getfixturevalue(request.param), request.getfixturevalue(f"{request.param}_oracle")


@pytest.fixture(params=kept(LOADABLE, ONE_OF_EACH_KIND), scope="module")
def data_arm(request):
    robot = loaded(request.param)
    return robot, Oracle(robot.model, data_robots()[request.param].read_text())


class TestArms:
    """IRB 140 and UR5, 1000 random states, rates up to 10 rad/s."""

    def test_inverse_dynamics_are_pinocchios(self, arm):
        robot, oracle = arm
        s = states(robot.n, 1000)
        assert relative(robot.inverse_dynamics(*s), each(oracle.inverse_dynamics, *s)) <= EXACT

    def test_mass_matrix_is_pinocchios(self, arm):
        robot, oracle = arm
        q, _, _ = states(robot.n, 1000)
        assert relative(robot.mass_matrix(q), each(oracle.mass_matrix, q)) <= EXACT

    def test_gravity_and_bias_are_pinocchios(self, arm):
        robot, oracle = arm
        q, qd, _ = states(robot.n, 1000)
        assert relative(robot.gravity_torque(q), each(oracle.gravity_torque, q)) <= EXACT
        assert relative(robot.bias_torque(q, qd), each(oracle.bias_torque, q, qd)) <= EXACT

    def test_forward_dynamics_undoes_pinocchios_inverse_dynamics(self, arm):
        robot, oracle = arm
        q, qd, qdd = states(robot.n, 1000)
        tau = each(oracle.inverse_dynamics, q, qd, qdd)
        kappa = np.linalg.cond(robot.mass_matrix(q))
        error = np.abs(robot.forward_dynamics(q, qd, tau) - qdd).max(axis=1) / np.abs(qdd).max(axis=1)
        assert (error <= kappa * EPS).all()

    def test_articulated_bodies_undo_inverse_dynamics(self, arm):
        robot, oracle = arm
        q, qd, qdd = states(robot.n, 200)
        tau = each(oracle.inverse_dynamics, q, qd, qdd)
        kappa = np.linalg.cond(robot.mass_matrix(q))
        got = rne.dynamics.articulated_forward_dynamics(robot.model, q, qd, tau)
        assert (np.abs(got - qdd).max(axis=1) / np.abs(qdd).max(axis=1) <= 4 * kappa * EPS).all()


class TestEveryDataRobot:
    """Every robot of example-robot-data that loads, by the recursions; test_kernels holds the kernels to these."""

    SAMPLES = 8

    def test_torques_and_mass_matrix_are_pinocchios(self, data_arm):
        robot, oracle = data_arm
        q, qd, qdd = states(robot.n, self.SAMPLES)
        tau = rne.dynamics.inverse_dynamics(robot.model, q, qd, qdd)
        assert relative(tau, each(oracle.inverse_dynamics, q, qd, qdd)) <= DATA
        assert relative(rne.dynamics.mass_matrix(robot.model, q), each(oracle.mass_matrix, q)) <= DATA
        assert relative(rne.dynamics.gravity_torque(robot.model, q), each(oracle.gravity_torque, q)) <= DATA
        assert relative(rne.dynamics.bias_torque(robot.model, q, qd), each(oracle.bias_torque, q, qd)) <= DATA

    @pytest.mark.parametrize("forward", [rne.dynamics.forward_dynamics, rne.dynamics.articulated_forward_dynamics])
    def test_forward_dynamics_solve_pinocchios_equation_or_name_a_singularity(self, data_arm, forward):
        robot, oracle = data_arm
        if robot.model.has_mimics and forward is rne.dynamics.articulated_forward_dynamics:
            with pytest.raises(rne.ModelError, match="mimic"):
                forward(robot.model, *states(robot.n))
            return
        q, qd, qdd = states(robot.n, self.SAMPLES)
        M, h = each(oracle.mass_matrix, q), each(oracle.bias_torque, q, qd)
        tau = each(oracle.inverse_dynamics, q, qd, qdd)
        try:
            got = forward(robot.model, q, qd, tau)
        except rne.SingularMassMatrixError as error:
            assert error.joints
            scale = 1 / np.sqrt(np.maximum(np.diagonal(M, axis1=1, axis2=2), 1e-300))
            smallest = np.linalg.eigvalsh(M * scale[:, :, None] * scale[:, None, :])[:, 0]
            assert smallest.min() <= 100 * robot.n * EPS
            return
        residual = np.linalg.norm((M @ got[..., None])[..., 0] + h - tau, axis=-1)
        norm_M = np.linalg.norm(M, axis=(1, 2))
        size = norm_M * np.linalg.norm(got, axis=-1) + np.linalg.norm(h, axis=-1) + np.linalg.norm(tau, axis=-1)
        assert (residual <= 10 * max(robot.n, 1) * EPS * size).all()

    def test_link_poses_are_pinocchios(self, data_arm):
        robot, oracle = data_arm
        q, _, _ = states(robot.n)
        data = oracle.theirs.createData()
        pin.framesForwardKinematics(oracle.theirs, data, oracle.q(q))
        poses = rne.dynamics.link_poses(robot.model, q)
        for link, T in zip(robot.link_names, poses, strict=True):
            theirs = data.oMf[oracle.theirs.getFrameId(link, pin.FrameType.BODY)].homogeneous
            assert np.abs(T - theirs).max() <= 1e-13 * max(1.0, np.abs(theirs).max()), link

    def test_velocities_accelerations_and_wrenches_within_are_pinocchios(self, data_arm):
        robot, oracle = data_arm
        q, qd, qdd = states(robot.n)
        record = robot.recursion(q, qd, qdd)
        oracle.inverse_dynamics(q, qd, qdd)
        for i, k in enumerate(oracle.joint_ids):
            v, a_gravity, f = oracle.data.v[k], oracle.data.a_gf[k], oracle.data.f[k]
            classical = a_gravity.linear + np.cross(v.angular, v.linear)
            known = record.known  # not of fingers that mimic others
            scale = [max(1.0, np.abs(x).max(initial=0)) for x in (record.alpha, record.a_o, known.f, known.tau)]
            assert np.abs(record.omega[i] - v.angular).max() <= DATA * max(1.0, np.abs(record.omega).max())
            assert np.abs(record.alpha[i] - a_gravity.angular).max() <= DATA * scale[0]
            assert np.abs(record.a_o[i] - record.gravity[i] - classical).max() <= DATA * scale[1]
            if robot.model.moving_joints[i] not in record.not_known:
                assert np.abs(record.f[i] - f.linear).max() <= DATA * scale[2]
                assert np.abs(record.tau[i] - f.angular).max() <= DATA * scale[3]

    def test_kinetic_energy_is_pinocchios(self, data_arm):
        robot, oracle = data_arm
        q, qd, _ = states(robot.n)
        kinetic = pin.computeKineticEnergy(oracle.theirs, oracle.data, oracle.q(q), oracle.velocities(qd))
        assert rne.dynamics.kinetic_energy(robot.model, q, qd) == pytest.approx(kinetic, rel=DATA, abs=1e-300)

    def test_centre_of_mass_is_pinocchios(self, data_arm):
        robot, oracle = data_arm
        q, _, _ = states(robot.n)
        if not robot.model.mass.sum():
            with pytest.raises(ValueError, match="centre_of_mass"):
                robot.centre_of_mass(q)
            return
        theirs = oracle.theirs.copy()
        theirs.inertias[0] = pin.Inertia.Zero()  # of the base, which does not move
        data = theirs.createData()
        J = pin.jacobianCenterOfMass(theirs, data, oracle.q(q), False)[:, oracle.v] @ robot.model.coordinate_map
        reach = 1 + abs(data.com[0]).max()
        assert abs(robot.centre_of_mass(q) - data.com[0]).max() <= DATA * reach
        assert abs(robot.centre_of_mass_jacobian(q) - J).max() <= DATA * reach

    def test_jacobians_and_their_rates_are_pinocchios(self, data_arm):
        robot, oracle = data_arm
        q, qd, _ = states(robot.n)
        link = robot.link_names[-1]
        ours, our_rate = (
            rne.dynamics.jacobian(robot.model, q, link),
            rne.dynamics.jacobian_rate(robot.model, q, qd, link),
        )
        if robot.n == 0:  # Pinocchio itself crashes here
            assert ours.shape == our_rate.shape == (6, 0)
            return
        frame = oracle.theirs.getFrameId(link, pin.FrameType.BODY)
        data, world = oracle.theirs.createData(), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        pin.computeJointJacobiansTimeVariation(oracle.theirs, data, oracle.q(q), oracle.velocities(qd))
        pin.updateFramePlacements(oracle.theirs, data)
        G, order = robot.model.coordinate_map, [3, 4, 5, 0, 1, 2]
        J = pin.getFrameJacobian(oracle.theirs, data, frame, world)[np.ix_(order, oracle.v)] @ G
        dJ = pin.getFrameJacobianTimeVariation(oracle.theirs, data, frame, world)[np.ix_(order, oracle.v)] @ G
        assert relative(ours[None], J[None]) <= DATA
        assert np.abs(our_rate - dJ).max(initial=0) <= DATA * max(1, np.abs(dJ).max(initial=0))


def test_joint_order_is_that_of_pinocchios_own_model(data_arm):
    """Of the independent joints; Pinocchio numbers mimics too."""
    robot, oracle = data_arm
    order = robot.joint_order("pinocchio")
    theirs = [name for name in oracle.theirs.names if name in robot.joint_names]
    assert [robot.joint_names[k] for k in order] == theirs


def test_joint_order_reorders_a_state_for_pinocchio(ur5, ur5_oracle):
    q, qd, qdd = states(6)
    order = ur5.joint_order("pinocchio")
    theirs = pin.rnea(ur5_oracle.theirs, ur5_oracle.data, q[order], qd[order], qdd[order])
    assert relative(theirs[np.argsort(order)], ur5.inverse_dynamics(q, qd, qdd)) <= EXACT


def test_joint_order_of_another_library_is_refused(ur5):
    with pytest.raises(ValueError, match=r"^`library` must be 'pinocchio', got 'mujoco'$"):
        ur5.joint_order("mujoco")


@pytest.mark.parametrize("name", REFUSED)
def test_refused_data_robots_say_why(name):
    with pytest.raises(rne.UrdfError, match=r".") as caught:
        rne.load(data_robots()[name])
    assert REFUSED[name] in str(caught.value)


def test_every_data_robot_is_either_loaded_or_refused_by_name():
    assert len(LOADABLE) >= 60
    assert set(REFUSED) <= set(data_robots())


def test_torques_under_an_external_wrench_are_pinocchios(ur5, ur5_oracle):
    oracle = ur5_oracle
    q, qd, qdd = states(6, seed=7)
    wrench = np.random.default_rng(8).normal(size=6)
    forces = pin.StdVec_Force()
    for _ in range(oracle.theirs.njoints):
        forces.append(pin.Force.Zero())
    frame = oracle.theirs.frames[oracle.theirs.getFrameId("tool0", pin.FrameType.BODY)]
    forces[frame.parentJoint] = frame.placement.act(pin.Force(wrench[3:], wrench[:3]))
    got = ur5.inverse_dynamics(q, qd, qdd, external={"tool0": wrench})
    assert relative(got, oracle.inverse_dynamics(q, qd, qdd, forces)) <= EXACT


def test_coriolis_matrix_is_pinocchios(arm):
    robot, oracle = arm
    q, qd, _ = states(robot.n, 20)
    assert relative(robot.coriolis_matrix(q, qd), each(oracle.coriolis_matrix, q, qd)) <= DATA
