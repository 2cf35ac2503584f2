"""Task space: inertia, bias, inverse and null space of a link; wrenches; impedance and operational-space control."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

import rne

from .helpers import EPS, Oracle, each, first_joints, kept, loaded
from .random_robots import straight_chain

ROBOTS = {"irb140": "tool0", "ur5": "tool0", "kinova": "j2s6s200_end_effector", "panda": "panda_hand"}
ROBOTS |= {"ur10": "tool0", "z1": "gripperStator"}
SHORT = ["irb140", "panda"]


def arm(name):
    return loaded(name), ROBOTS[name]


def planar(n=2):
    """Links of 1 m with point masses at their ends, without gravity."""
    still = {"gravity": [0, 0, 0], "masses": [1] * n, "centres": np.zeros((n, 3)), "inertias": np.zeros((n, 3, 3))}
    return rne.Robot(rne.dh_chain(a=[1] * n, alpha=[0] * n, d=[0] * n, theta=[0] * n, **still))


def dense(robot, q, qd, link, rows):
    """Lambda, bias and inverse by dense algebra on Pinocchio's M and bias, and the condition of the task."""
    oracle = Oracle(robot.model, rne.to_urdf(robot.model))
    M, h = each(oracle.mass_matrix, q), each(oracle.bias_torque, q, qd)
    J, rate = robot.jacobian(q, link)[:, rows], robot.jacobian_rate(q, qd, link)[:, rows]
    X = np.linalg.solve(M, J.swapaxes(1, 2))
    mobility = J @ X
    Lambda = np.linalg.inv(mobility)
    bias = Lambda @ (X.swapaxes(1, 2) @ h[..., None] - rate @ qd[..., None])
    scale = np.sqrt(np.diagonal(mobility, axis1=1, axis2=2))
    scaled = np.linalg.cond(mobility / scale[:, :, None] / scale[:, None, :])
    return Lambda, bias[..., 0], X @ Lambda, scaled * np.linalg.cond(M)


@pytest.mark.parametrize(
    ("name", "count"), [(n, 20) if n in SHORT else pytest.param(n, 500, marks=pytest.mark.long) for n in ROBOTS]
)
@pytest.mark.parametrize("rows", [None, "xyz", [3, 5, 0]])
def test_dense_algebra_gives_the_same(name, count, rows):
    robot, link = arm(name)
    q, qd = np.random.default_rng(1).uniform(-1.5, 1.5, (2, count, robot.n))
    chosen = {None: list(range(6)), "xyz": [3, 4, 5]}.get(rows if not isinstance(rows, list) else 0, rows)
    Lambda, bias, inverse, condition = dense(robot, q, qd, link, chosen)
    found = (
        robot.task_inertia(q, link, rows=rows),
        robot.task_bias(q, qd, link, rows=rows),
        robot.task_inverse(q, link, rows=rows),
    )
    for ours, theirs in zip(found, (Lambda, bias, inverse), strict=True):
        axes = tuple(range(1, theirs.ndim))
        error = abs(ours - theirs).max(axes) / abs(theirs).max(axes)
        assert (error <= 8 * robot.n * EPS * condition).all()
    np.testing.assert_array_equal(found[0], found[0].swapaxes(1, 2))


PLACES = [
    {"rows": (3, 4, 5), "point": (0.1, 0.0, 0.2), "axes": "link"},
    {"rows": (3, 4, 5)},
    {},
]  # of three joints, six


@pytest.mark.parametrize("options", kept(PLACES, PLACES[:2]))
def test_recursion_kernel_and_engines_agree(options):
    robot = loaded("ur5") if "rows" not in options else first_joints()
    q, qd = np.random.default_rng(2).uniform(-1, 1, (2, 4, robot.n))
    q[:, robot.n // 2 :] = 1.0
    for function, arrays in ((rne.dynamics.task_inertia, (q,)), (rne.dynamics.task_bias, (q, qd))):
        expected = function(robot.model, *arrays, "tool0", **options)
        method = getattr(robot, function.__name__)(*arrays, "tool0", **options)
        np.testing.assert_allclose(method, expected, rtol=1e-10)  # also where both take what is not given from defaults
        for engine in ("numpy", "numba"):
            kernel = rne.compile(function, robot.model, engine=engine, link="tool0", **options)
            np.testing.assert_allclose(kernel(*arrays), expected, rtol=1e-10)


@pytest.mark.parametrize("options", kept(PLACES, PLACES[:1]))
@pytest.mark.parametrize("name", ["task_inertia", "task_bias", "task_inverse"])
def test_derivatives_are_complex_steps(name, options):
    robot = loaded("ur5") if "rows" not in options else first_joints()
    function = getattr(rne.dynamics, name)
    q, qd = np.array([[0.1, -1.0, 1.2, 0.3, 1.1, 0.2]]), np.full((1, 6), 0.5)
    wrt, fixed = tuple(function.quantity.widths), {"link": "tool0", **options}
    arrays = [q[:, : robot.n], qd[:, : robot.n]][: len(wrt)]
    slopes = rne.kernels.derivative(function, robot.model, *wrt, **fixed)(*arrays)
    steps, _ = rne.kernels.trace.by_recursion(function, robot.model, arrays, wrt, fixed)
    assert abs(slopes - steps).max() <= 1e-10 * abs(steps).max()  # of the conditions of M and of the pose, 1e5
    weights = np.ones((1, slopes[..., 0].size))
    gradient = rne.kernels.gradient(function, robot.model, *wrt, **fixed)(*arrays, weights)
    np.testing.assert_allclose(gradient, slopes.reshape(1, -1, slopes.shape[-1]).sum(1), rtol=1e-9, atol=1e-9)


def test_axes_and_points():
    robot, link = arm("irb140")
    q, point = np.random.default_rng(3).uniform(-1, 1, (3, 6)), [0.1, -0.2, 0.3]
    R = robot.link_poses(q)[:, robot.link_names.index(link), :3, :3]
    turn = np.zeros((3, 6, 6))
    turn[:, :3, :3] = turn[:, 3:, 3:] = R
    J = robot.jacobian(q, link, point)
    np.testing.assert_allclose(turn @ robot.jacobian(q, link, point, axes="link"), J, atol=1e-15)
    there, base = (robot.task_inertia(q, link, point, axes=axes) for axes in ("link", "base"))
    np.testing.assert_allclose(turn @ there @ turn.swapaxes(1, 2), base, rtol=1e-8)


def test_null_space_torques_do_not_accelerate_the_point():
    robot, link = arm("panda")
    rng = np.random.default_rng(4)
    q, tau = rng.uniform(-1, 1, (2, 5, robot.n))
    free = (robot.null_space(q, link) @ tau[..., None])[..., 0]
    qdd = robot.forward_dynamics(q, 0 * q, robot.gravity_torque(q) + free)
    moved = robot.jacobian(q, link) @ qdd[..., None]
    assert abs(moved).max() <= 1e-9 * abs(qdd).max()  # of the condition of M and of the poses
    assert abs(qdd).max() > 0.1


class TestSingularPoses:
    @pytest.mark.parametrize("given", [{}, {"damping": 0.1}])
    def test_a_robot_without_joints_moves_in_no_direction(self, given):
        robot = loaded("irb140").locked(dict.fromkeys(loaded("irb140").joint_names, 0.0))
        with pytest.raises(rne.SingularMassMatrixError, match="no torques accelerate a rotation about x, "):
            robot.task_inertia([], "tool0", **given)

    def test_the_lost_directions_are_named(self):
        robot = loaded("irb140")
        text = (
            "the pose is singular for link 'link_6': no torques accelerate a rotation about z, translation along y; "
            "leave out rows, or give `damping`"
        )
        for _ in range(3):  # by the recursion, then by the kernel
            with pytest.raises(rne.SingularMassMatrixError) as error:
                robot.task_inertia(np.zeros(6), "link_6")
            assert str(error.value) == text
            assert error.value.joints == ("rotation about z", "translation along y")

    def test_the_state_of_a_batch_is_named(self):
        q = np.array([[0, 0, 0, 0, 1.0, 0], [0.0] * 6])
        with pytest.raises(rne.SingularMassMatrixError, match=r"at state \(1,\)"):
            loaded("irb140").task_inertia(q, "link_6")

    def test_arms_of_few_joints_need_rows(self):
        arm = planar()
        with pytest.raises(
            rne.SingularMassMatrixError, match="rotation about x, rotation about y, translation along z"
        ):
            arm.task_inertia([0.1, 1.0], "tool0")
        assert arm.task_inertia([0.1, 1.0], "tool0", rows=[3, 4]).shape == (2, 2)

    def test_damping_bounds_the_inertia(self):
        robot = loaded("irb140")
        Lambda = robot.task_inertia(np.zeros(6), "link_6", damping=1e-3)
        J, M = robot.jacobian(np.zeros(6), "link_6"), robot.mass_matrix(np.zeros(6))
        mobility = J @ np.linalg.solve(M, J.T)
        expected = np.linalg.inv(mobility + 1e-3 * np.diag(np.diag(mobility)))
        assert abs(Lambda - expected).max() <= 1e-9 * abs(expected).max()  # of the condition, 1e6
        assert (np.diag(Lambda) <= 1001 / np.diag(mobility)).all()


@pytest.mark.parametrize("name", kept(ROBOTS, SHORT))
def test_wrenches_are_pinocchios_external_forces(name):
    pin = pytest.importorskip("pinocchio")
    robot, link = arm(name)
    rng = np.random.default_rng(5)
    oracle = Oracle(robot.model, rne.to_urdf(robot.model))
    q, qd = rng.uniform(-1, 1, (2, robot.n))
    force, moment, point = rng.uniform(-50, 50, (3, 3))
    point = point / 100
    frame = oracle.theirs.getFrameId(link, pin.FrameType.BODY)
    place, theirs = oracle.theirs.frames[frame], oracle.theirs.createData()
    pin.framesForwardKinematics(oracle.theirs, theirs, oracle.q(q))
    R = theirs.oMf[frame].rotation
    for axes in ("base", "link"):
        f, m = (R.T @ force, R.T @ moment) if axes == "base" else (force, moment)
        zero = [pin.Force.Zero() for _ in range(oracle.theirs.njoints)]
        zero[place.parentJoint] = place.placement.act(pin.Force(f, m + np.cross(point, f)))
        expected = oracle.inverse_dynamics(q, qd, 0 * q, zero)
        given = rne.wrench(robot, q, link, force, moment, point, axes)
        np.testing.assert_allclose(robot.bias_torque(q, qd, external=given), expected, rtol=1e-12, atol=1e-12)
    J = robot.jacobian(q, link, point)
    given = rne.wrench(robot, q, link, force, moment, point)
    torques = robot.bias_torque(q, qd, external=given) - robot.bias_torque(q, qd)
    np.testing.assert_allclose(torques, -J.T @ np.r_[moment, force], atol=1e-12 * abs(torques).max())


def test_wrenches_of_batches_and_errors():
    robot, q = loaded("irb140"), np.zeros((4, 6))
    assert rne.wrench(robot, q, "tool0", [0, 0, 1])["tool0"].shape == (4, 6)
    assert rne.wrench(robot, q[0], "tool0", np.ones((5, 3)), axes="link")["tool0"].shape == (5, 6)
    for arguments, text in (
        ({}, "`force` or `moment` must be given"),
        ({"force": [1, 2]}, r"`force` must have shape \(\.\.\., 3\)"),
        ({"force": [1, 2, np.nan]}, "`force` must be finite"),
        ({"force": [1, 2, 3], "axes": "world"}, "`axes` must be 'base' or 'link', got 'world'"),
    ):
        with pytest.raises(ValueError, match=text):
            rne.wrench(robot, q[0], "tool0", **arguments)
    with pytest.raises(ValueError, match="`link` must be one of"):
        rne.wrench(robot, q[0], "tool", [0, 0, 1])
    for rows in ("yz", [6], [0, 0], []):
        with pytest.raises(ValueError, match="`rows` must be"):
            robot.task_inertia(q, "tool0", rows=rows)


POSE_Q = np.array([0.1, -0.5, 0.7, 0.2, 1.0, 0.3])


def soft(robot, link, **options):
    pose = robot.link_poses(POSE_Q[: robot.n])[robot.link_names.index(link)]
    given = {"stiffness": [100] * 3 + [2000] * 3, "damping": [5] * 3 + [100] * 3, "pose": pose} | options
    return rne.control.impedance(robot, link, **given)


class TestImpedance:
    @pytest.mark.parametrize("axes", ["target", "base"])
    def test_torques_are_the_gradient_of_the_energy(self, axes):
        robot, link = arm("ur5")
        rng = np.random.default_rng(6)
        K = np.zeros((6, 6))
        for block in (slice(0, 3), slice(3, 6)):
            root = rng.uniform(-1, 1, (3, 3)) * 20
            K[block, block] = root @ root.T
        K = (K + K.T) / 2
        law = soft(robot, link, stiffness=K, axes=axes, posture=(POSE_Q + 0.2, 10, 0))
        for _ in range(5):
            q, h = rng.uniform(-3, 3, 6), 1e-6
            moved = q + h * np.eye(6), q - h * np.eye(6)
            slope = (law.potential_energy(0, moved[0]) - law.potential_energy(0, moved[1])) / (2 * h)
            held = robot.gravity_torque(q) - law(0.0, q, 0 * q)
            assert abs(held - slope).max() <= 1e-7 * abs(slope).max()  # of central differences

    def test_small_rotations_and_the_saddle_of_half_a_turn(self):
        K = np.diag([10, 20, 30, 0, 0, 0.0])
        target = np.eye(4)
        for k in range(3):
            for angle, size in ((1e-4, K[k, k] * 1e-4), (np.pi, 0.0)):
                T = np.eye(4)
                T[:3, :3] = rne.basics.spatial.rotation_about(np.eye(3)[k], np.array(angle))
                moment = rne.control.task_space.spring_wrench(T, target, K)[:3]
                np.testing.assert_allclose(moment, -size * np.eye(3)[k], atol=1e-8)

    @pytest.mark.parametrize("seed", kept(range(200), range(3)))
    def test_stored_energy_never_rises(self, seed):
        """Random poses, gains, postures and payloads: the power of the dampers is all that changes the energy."""
        rng = np.random.default_rng(seed)
        robot, link = arm(["irb140", "ur5"][seed % 2])
        K = np.diag(10 ** rng.uniform([0] * 3 + [1] * 3, [2] * 3 + [3.5] * 3))
        D = np.diag(10 ** rng.uniform([-1] * 3 + [0] * 3, [1] * 3 + [2] * 3))
        posture = (rng.uniform(-1, 1, 6), rng.uniform(0, 20), rng.uniform(0, 5)) if seed % 3 else None
        pose = robot.link_poses(rng.uniform(-2, 2, 6))[robot.link_names.index(link)]
        carried = robot.with_payload(rng.uniform(0, 5), rng.uniform(-0.1, 0.1, 3), link=link)
        law = rne.control.impedance(carried, link, K, D, pose, posture=posture, axes=["target", "base"][seed % 2])
        scene = rne.Scene(carried, controller=law)
        motion = rne.simulate(scene, rng.uniform(-2, 2, 6), rng.uniform(-1, 1, 6), 0.3, rtol=1e-9, atol=1e-9)
        energy = motion.kinetic + law.potential_energy(0.0, motion.q)
        assert np.diff(energy).max() <= 1e-6 * energy.max()  # of the integration
        assert scene.is_traced

    def test_deflection_under_a_force_is_that_of_the_stiffness(self):
        robot, link = arm("ur5")
        K = np.diag([2e3] * 3 + [1e5, 2e5, 3e5])
        law = soft(robot, link, stiffness=K, damping="critical", axes="base", inertia=robot.task_inertia(POSE_Q, link))
        force = np.array([30.0, -40.0, 50.0])
        own = lambda t, q, qd: law(t, q, qd) + robot.jacobian(q, link)[3:].T @ force  # noqa: E731
        motion = rne.simulate(rne.Scene(robot, controller=rne.traceable(own)), POSE_Q, np.zeros(6), 3.0)
        k = robot.link_names.index(link)
        moved = robot.link_poses(motion.q[-1])[k, :3, 3] - law.pose[:3, 3]
        np.testing.assert_allclose(moved, force / np.diag(K)[3:], rtol=1e-5)

    def test_critical_damping_is_critical_in_every_mode(self):
        robot, link = arm("ur5")
        L, K = robot.task_inertia(POSE_Q, link), np.diag([10, 20, 30, 1e3, 2e3, 3e3])
        D = soft(robot, link, stiffness=K, damping="critical", axes="base", inertia=L).damping
        poles = np.linalg.eigvals(
            np.block([[np.zeros((6, 6)), np.eye(6)], [-np.linalg.solve(L, K), -np.linalg.solve(L, D)]])
        )
        assert (abs(poles.imag) <= 1e-5 * abs(poles)).all()  # double poles: half of the digits
        np.testing.assert_allclose(
            np.sort(-poles.real)[::2], np.sort(np.sqrt(np.linalg.eigvals(np.linalg.solve(L, K)).real)), rtol=1e-5
        )

    @pytest.mark.parametrize("axes", ["target", "base"])
    def test_without_inertia_the_damping_ratio_is_1_at_the_posture(self, axes):
        """In joint space: modes V of J^T K J with M, V^T M V = 1, have V^T D V = 2 w, D being that of the torques."""
        robot, link = arm("ur5")
        K, J = [10, 20, 30, 1e3, 2e3, 3e3], robot.jacobian(POSE_Q, link)
        turned = rne.basics.spatial.rotation_from_rpy(np.array([0.3, 0.2, 0.1]))
        given = {"stiffness": np.kron(np.eye(2), turned) @ np.diag(K) @ np.kron(np.eye(2), turned).T, "axes": axes}
        given["stiffness"] = (given["stiffness"] + given["stiffness"].T) / 2
        motion = lambda t: (POSE_Q + t, np.ones(6), np.zeros(6))  # noqa: E731
        laws = [soft(robot, link, damping="critical", posture=(p, 0, 0), **given) for p in (POSE_Q, motion)]
        laws += [soft(robot, link, damping="critical", inertia=robot.task_inertia(POSE_Q, link), **given)]
        for law in laws:
            D = (law(0.0, POSE_Q, np.zeros((6, 6))) - law(0.0, np.tile(POSE_Q, (6, 1)), np.eye(6))).T
            in_base = rne.control.task_space.in_base_axes(law.stiffness, law.pose, axes)
            w2, V = scipy.linalg.eigh(J.T @ in_base @ J, robot.mass_matrix(POSE_Q))
            ratios = V.T @ D @ V / (2 * np.sqrt(np.sqrt(np.outer(w2, w2))))
            np.testing.assert_allclose(ratios, np.eye(6), atol=1e-9)  # conditions of J and M are some 100 each

    def test_planar_arm_against_its_closed_form(self):
        pose = np.eye(4)
        pose[:3, 3] = [1.2, 0.5, 0]
        law = rne.control.impedance(planar(), "tool0", [0, 0, 0, 100, 200, 0], [0] * 6, pose)
        q = np.array([0.4, 0.9])
        x = np.cumsum(np.cos(np.cumsum(q)))[-1], np.cumsum(np.sin(np.cumsum(q)))[-1]
        s, c = np.sin(np.cumsum(q)), np.cos(np.cumsum(q))
        J = np.array([[-s.sum(), -s[1]], [c.sum(), c[1]]])
        force = -np.array([100 * (x[0] - 1.2), 200 * (x[1] - 0.5)])
        np.testing.assert_allclose(law(0.0, q, np.zeros(2)), J.T @ force, atol=1e-12)

    def test_a_tool_that_moves_with_its_target_is_not_damped(self):
        """At the target's pose and velocity the torques are those of gravity."""
        robot = planar()
        q, qd = np.array([0.4, 0.9]), np.array([1.0, -0.5])
        pose, twist = robot.link_poses(q)[robot.link_names.index("tool0")], robot.jacobian(q, "tool0") @ qd
        law = rne.control.impedance(robot, "tool0", [10] * 6, [20] * 6, lambda t: (pose, twist))
        np.testing.assert_allclose(law(0.0, q, qd), robot.gravity_torque(q), atol=1e-12)
        assert np.abs(law(0.0, q, 0 * qd) - robot.gravity_torque(q)).min() > 1

    def test_moving_targets_and_projected_postures_are_traced(self):
        robot, link = arm("panda")
        pose = robot.link_poses(np.full(robot.n, 0.3))[robot.link_names.index(link)]

        def moving(t):
            target = pose.astype(object) if not isinstance(t, float) else pose.copy()
            target[0, 3] = target[0, 3] + 0.1 * t
            return target, np.array([0, 0, 0, 0.1, 0, 0])

        law = rne.control.impedance(
            robot, link, [10] * 3 + [500] * 3, [1] * 3 + [50] * 3, moving, posture=(0.3, 5, 1), projector=True
        )
        scene = rne.Scene(robot, controller=law)
        assert scene.is_traced
        motion = rne.simulate(scene, np.full(robot.n, 0.3), np.zeros(robot.n), 1.0)
        end = robot.link_poses(motion.q[-1])[robot.link_names.index(link), 0, 3]
        assert abs(end - pose[0, 3] - 0.1) < 0.02

    def test_errors(self):
        robot, link = arm("ur5")
        bad = np.eye(4)
        bad[0, 0] = 2
        coupled = np.eye(6)
        coupled[0, 3] = coupled[3, 0] = 0.1
        for options, text in (
            ({"stiffness": [1] * 5}, r"`stiffness` must have shape \(6,\) or \(6, 6\), rotations first, got \(5,\)"),
            ({"stiffness": [-1] * 6}, "`stiffness` must be six numbers that are not negative"),
            ({"stiffness": [1e3, 1e3, 1e3, 1e3, 1e3, -1e-6]}, "`stiffness` must be six numbers that are not negative"),
            ({"stiffness": coupled}, "`stiffness` must have two blocks"),
            ({"pose": bad}, "`pose` must be a homogeneous matrix"),
            ({"pose": lambda t: np.eye(3)}, r"`pose` must give \(4, 4\)"),
            (
                {"damping": "critical"},
                r"damping 'critical' needs an inertia, which depends on joint positions: give `inertia`, such as "
                r"robot.task_inertia\(q, link\), or `posture`, whose positions are taken then",
            ),
            ({"damping": "some"}, "`damping` must be an array or 'critical', got 'some'"),
            ({"inertia": np.eye(6)}, "`inertia` is for damping 'critical' only"),
            ({"axes": "link"}, "`axes` must be 'target' or 'base'"),
            ({"posture": [0.0] * 6}, "`posture` must be a tuple"),
        ):
            with pytest.raises(ValueError, match=text):
                soft(robot, link, **options)
        turned = rne.basics.spatial.rotation_from_rpy(np.array([0.3, 0.2, 0.1]))
        flat = np.kron(np.eye(2), turned @ np.diag([1e3, 1e3, 0]) @ turned.T)
        soft(robot, link, stiffness=(flat + flat.T) / 2)  # no stiffness in two directions, but for rounding


def test_operational_space_follows_its_reference():
    robot, link = arm("ur5")
    k, start = robot.link_names.index(link), robot.link_poses(POSE_Q)[robot.link_names.index(link)]

    def circle(t):
        s, c = np.sin(t), np.cos(t)
        pose = start.astype(object)
        pose[1, 3], pose[2, 3] = pose[1, 3] + 0.1 * s, pose[2, 3] + 0.1 * (1 - c)
        zero = 0 * t
        return (
            pose,
            np.array([zero, zero, zero, zero, 0.1 * c, 0.1 * s]),
            np.array([zero, zero, zero, zero, -0.1 * s, 0.1 * c]),
        )

    with pytest.raises(ValueError, match=r"^`kp` must not be negative, got -1.0$"):
        rne.control.operational_space(robot, link, [1, 1, 1, 1, 1, -1], 20, circle)
    law = rne.control.operational_space(robot, link, 100, 20, circle)
    scene = rne.Scene(robot, controller=law)
    assert scene.is_traced
    qd = np.linalg.solve(robot.jacobian(POSE_Q, link), [0, 0, 0, 0, 0.1, 0])
    motion = rne.simulate(scene, POSE_Q, qd, 1.0, rtol=1e-9)
    end = robot.link_poses(motion.q[-1])[k]
    np.testing.assert_allclose(end, np.asarray(circle(1.0)[0], float), atol=1e-7)  # of the integration


class TestCompiledLaws:
    @pytest.mark.parametrize("engine", ["numpy", "numba"])
    def test_kernels_are_the_laws(self, engine):
        robot, link = rne.load("ur5", engine=engine), "tool0"
        laws = [
            soft(robot, link, posture=(POSE_Q, 5, 1), projector=True),
            rne.control.pd_gravity(robot, 50, 20, POSE_Q),
            rne.control.pid(robot, 50, 10, 20, POSE_Q),
            rne.traceable(lambda t, q, qd: t - q * qd),
        ]
        q, qd = np.random.default_rng(7).uniform(-1, 1, (2, 6))
        for law in laws[2 if engine == "numba" else 0 :]:
            kernel = rne.control.compiled(law, robot)
            z = [np.full(6, 0.2)] if hasattr(law, "states") else []
            expected = np.concatenate(law(0.5, q, qd, *z)) if z else law(0.5, q, qd)
            out = np.empty_like(expected)
            assert kernel.into(np.array([0.5]), q, qd, *z, out) is out
            np.testing.assert_allclose(out, expected, rtol=1e-11, atol=1e-11)
            assert kernel.names == ("t", "q", "qd", "z")[: 3 + len(z)]
            names = ", ".join(f"const float *{name}" for name in kernel.names)
            assert f"void control_law({names}, float *result)" in kernel.source("c", dtype="float32")

    def test_errors(self):
        robot = loaded("irb140")
        for law, text in (
            (lambda t, q, qd: q, "`robot` must be an rne.Robot, got NoneType"),
            (lambda t: t, "`law` must"),
        ):
            with pytest.raises(TypeError, match=text):
                rne.control.compiled(law)
        with pytest.raises(TypeError, match=r"^`law` must be marked by rne\.traceable$"):
            rne.control.compiled(lambda t, q, qd: q, robot)
        branch = rne.traceable(lambda t, q, qd: q if q[0] > 0 else -q)
        with pytest.raises(TypeError, match=r"^`law` cannot be traced: TypeError: a traced number has no value"):
            rne.control.compiled(branch, robot)


class TestLinearisedLoops:
    Q = np.zeros(3)
    WRIST_BENT = np.array([0, 0, 0, 0, 1.0, 0])

    def test_pd_gains_are_those_of_the_closed_form(self):
        robot, kp, kd = first_joints(), [50.0, 50.0, 60.0], [20.0, 20.0, 22.0]
        proven = rne.check_gains(robot, kp, kd, q=self.Q)
        law = rne.control.pd_gravity(robot, kp, kd, self.Q)
        for factor, stable in ((0.99, True), (1.01, False)):
            scene = rne.Scene(robot, controller=law, sample_time=factor * proven.sample_time_limit)
            found = scene.check_gains(self.Q)
            assert found.stable is stable
            assert found.is_rest
            np.testing.assert_allclose(found.sample_time_limit, proven.sample_time_limit, rtol=1e-4)
            np.testing.assert_allclose(-found.poles.real.min(), proven.fastest_pole, rtol=1e-9)
        sampled = rne.check_gains(robot, kp, kd, 0.5 * proven.sample_time_limit, q=self.Q)
        found = replace(scene, sample_time=sampled.sample_time).check_gains(self.Q)
        assert isinstance(sampled, rne.control.LinearisedLoop)
        assert proven.gain_margin == np.inf
        assert 1 < sampled.gain_margin < 3
        np.testing.assert_allclose(sampled.gain_margin, found.gain_margin, rtol=1e-6)
        np.testing.assert_allclose(sampled.delay_margin, found.delay_margin, rtol=1e-6)
        assert f"gain margin {found.gain_margin:.4g}, delay margin {found.delay_margin:.4g} s" in str(found)

    @pytest.mark.parametrize("carried", kept([0.0, 4.0], [4.0]))
    def test_sampled_impedances_diverge_where_it_says_so(self, carried):
        robot, link = arm("irb140")
        pose = robot.link_poses(self.WRIST_BENT)[robot.link_names.index(link)]
        law = rne.control.impedance(robot.with_payload(carried), link, [50] * 3 + [800] * 3, [5] * 3 + [80] * 3, pose)
        parts = {"controller": law, "payload": carried}
        limit = rne.Scene(robot, **parts).check_gains(self.WRIST_BENT).sample_time_limit
        for factor, stable in ((0.97, True), (1.03, False)):
            scene = rne.Scene(robot, **parts, sample_time=factor * limit)
            assert scene.check_gains(self.WRIST_BENT).stable is stable
            motion = rne.simulate(scene, self.WRIST_BENT + 1e-4, np.zeros(6), 150 * scene.sample_time)
            assert bool(abs(motion.q[-1] - self.WRIST_BENT).max() < 1e-4) is stable

    @pytest.mark.parametrize("viscous", [0.0, 5.0, 1000.0])
    def test_the_limit_of_a_damped_joint_is_that_of_its_closed_form(self, viscous):
        """x' = [[0, 1], [0, -d/m]] x + [0, 1/m] u, u = -kp q - kd qd held; T where the map's spectral radius is 1."""
        m, kp, kd = 0.6, 100.0, 1.0
        table, body = {"a": [0.5], "alpha": [0], "d": [0], "theta": [0]}, {"masses": [2.0], "centres": [[0, 0, 0]]}
        robot = rne.Robot(rne.dh_chain(**table, **body, inertias=[[0.1] * 3], gravity=[0, 0, 0]))
        law = rne.control.pd(robot, kp, kd, 0.0)

        def radius(T):
            rate = viscous / m
            decay, slide = (np.exp(-rate * T), -np.expm1(-rate * T) / rate) if viscous else (1.0, T)
            gain = np.array([(T - slide) / viscous, slide / m]) if viscous else np.array([T**2 / 2 / m, T / m])
            return abs(np.linalg.eigvals([[1, slide], [0, decay]] - np.outer(gain, [kp, kd]))).max()

        scene = rne.Scene(robot, controller=law, friction=rne.Friction(viscous=viscous))
        limit = scene.check_gains([0.0]).sample_time_limit
        assert radius(0.999 * limit) < 1 < radius(1.001 * limit)
        own = replace(scene, sample_time=1.2 * limit).check_gains([0.0])
        assert not own.stable
        assert own.sample_time_limit == pytest.approx(limit, rel=1e-5)

    def test_smoothed_friction_is_told(self):
        robot = first_joints()
        law = rne.control.pd_gravity(robot, 500, 20, self.Q)
        text = "smoothed Coulomb friction damps the loop near rest, less in larger motions"
        assert text in str(rne.Scene(robot, controller=law, friction=rne.Friction(coulomb=3.0)).check_gains(self.Q))
        assert text not in str(rne.Scene(robot, controller=law, friction=rne.Friction(viscous=3)).check_gains(self.Q))

    @pytest.mark.parametrize("name", kept(["planar", "panda"], ["planar"]))
    def test_a_redundant_arm_without_posture_is_told_to_be_free(self, name):
        if name == "planar":
            robot, link, q, turns = planar(3), "tool0", np.array([0.1, 0.9, 0.7]), [0.0] * 3
        else:
            robot, link, turns = loaded("panda").locked({"panda_finger_joint1": 0.0}), "panda_link8", [1.0] * 3
            q = np.array([0, -0.5, 0, -2.0, 0, 1.6, 0.8])
        pose = robot.link_poses(q)[robot.link_names.index(link)]
        gains = ([50 * k for k in turns] + [800] * 3, [5 * k for k in turns] + [80] * 3, pose)
        law = rne.control.impedance(robot, link, *gains)
        loop = rne.Scene(robot, controller=law).check_gains(q)
        assert not loop.stable
        text = "of motions that nothing holds or damps: the law holds a link, not the joints; give it a `posture`"
        assert str(loop).endswith(f"\nzero poles: 2 of {2 * robot.n}, {text}")
        held = rne.control.impedance(robot, link, *gains, posture=(q, 10.0, 5.0))
        loop = rne.Scene(robot, controller=held).check_gains(q)
        assert loop.stable
        assert "zero poles" not in str(loop)

    def test_what_is_no_rest_and_what_is_refused(self):
        robot = first_joints()
        found = rne.Scene(robot, controller=rne.control.pd(robot, 500, 20, 0.0)).check_gains(self.Q)
        assert not found.is_rest
        assert str(found).endswith("the target is no equilibrium: the motion leaves it")
        with pytest.raises(ValueError, match="`controller` of the scene must be given"):
            rne.Scene(robot).check_gains(self.Q)
        law = rne.control.pd(robot, 500, 20, 0.0)
        with pytest.raises(ValueError, match="holds the joints at the target"):
            rne.Scene(robot, controller=law, friction=rne.Friction(coulomb=1, smoothing=0)).check_gains(self.Q)

    def test_laws_with_states(self):
        robot = first_joints()
        for ki, stable in ((5.0, True), (1e5, False)):
            law = rne.control.pid(robot, 50, ki, 20, self.Q, gravity=True)
            assert rne.Scene(robot, controller=law).check_gains(self.Q).stable is stable

    def test_integrals_without_gain_are_no_poles(self):
        """Nor those of some joints; those with a gain stay."""
        robot = rne.Robot(straight_chain(2))
        expected = rne.Scene(robot, controller=rne.control.pd(robot, 500, 40, 0.0)).check_gains([0.0, 0.0])
        for ki, count, traceable in ((0.0, 0, True), ([0.0, 3.0], 1, False)):
            law = rne.control.pid(robot, 500, ki, 40, 0.0)
            object.__setattr__(law, "traceable", traceable)
            loop = rne.Scene(robot, controller=law).check_gains([0.0, 0.0])
            assert loop.stable
            assert "zero poles" not in str(loop)
            assert len(loop.poles) == 4 + count
            if not count:
                np.testing.assert_allclose(np.sort(loop.poles), np.sort(expected.poles), rtol=1e-9)
        led = rne.control.pd_gravity(robot, 0, 40, 0.0)
        text = str(rne.Scene(robot, controller=led).check_gains([0.0, 0.0]))
        assert text.endswith("\nzero poles: 2 of 4, of motions that nothing holds or damps")

    @pytest.mark.parametrize("kind", ["delay", "long delay", "differences", "noise"])
    def test_a_law_with_memory_is_judged_without_it_and_a_warning_names_the_cure(self, kind):
        """As in motion at constant velocity, after which q - delay qd is the position that a late law saw."""
        robot, period = rne.Robot(straight_chain(1)), 1e-3
        pd = rne.control.pd_gravity(robot, 50, 5, 0.0)
        count = {"delay": 1, "long delay": 40}.get(kind, 0)
        delayed, last, rng = [np.zeros(1)] * count, [np.zeros(1)], np.random.default_rng(0)

        def law(t, q, qd):
            if kind == "noise":
                return pd(t, q, qd + 0.01 * rng.normal(size=1))
            if kind == "differences":
                velocity, last[0] = (q - last[0]) / period, q
                return pd(t, q, velocity)
            delayed.append(pd(t, q, qd))
            return delayed.pop(0)

        scene = rne.Scene(robot, controller=law, sample_time=period)
        if kind == "noise":
            with pytest.raises(
                ValueError, match=r"^`controller` has noise: its torques differ by .* after equal calls"
            ):
                scene.check_gains([0.0])
            return
        text = (
            r"^`controller` has memory: its torques in one state differ by .* N m or N after different calls. The loop is "
            r"judged as if it had none, by its torques at constant velocity: give torques that act late as the scene's "
            r"`delay`, other memory as `states` of the law$"
        )
        with pytest.warns(UserWarning, match=text):
            found = scene.check_gains([0.0])
        weight = float(robot.kernel(rne.dynamics.gravity_torque, "q")([0.0])[0, 0])  # its compensation is late, too
        late = rne.control.pd_gravity(robot, 50, 5 - count * period * (50 - weight), 0.0)
        expected = rne.Scene(robot, controller=late, sample_time=period).check_gains([0.0])
        np.testing.assert_allclose(np.sort(found.poles), np.sort(expected.poles), rtol=1e-6)
        assert found.stable

    def test_a_reference_that_ends_soon_is_no_memory(self):
        robot = rne.Robot(straight_chain(1))
        path = rne.simulate(robot, [0.0], [0.0], 0.01)
        law = rne.control.computed_torque(robot, 50, 20, path)
        with pytest.raises(ValueError, match="must be within the motion"):
            law(1.0, np.zeros(1), np.zeros(1))
        assert rne.Scene(robot, controller=law, sample_time=0.01).check_gains([0.0]).stable

    def test_a_delay_of_a_sample_or_as_states_is_stable_where_its_simulation_is(self):
        robot = rne.Robot(straight_chain(1))
        pd = rne.control.pd(robot, 50, 5, 0.0)

        class Late:
            states = 1

            def __init__(self, period):
                self.period = period

            def __call__(self, t, q, qd, z):
                return z, (pd(t, q, qd) - z) / self.period

        found = []
        for period in (1e-3, 0.05):
            scene = rne.Scene(robot, controller=Late(period), sample_time=period, gravity=[0, 0, 0])
            motion = rne.simulate(scene, [1e-4], [0.0], 20 * period)
            found.append(scene.check_gains([0.0]).stable)
            assert found[-1] is bool(abs(motion.q[-1, 0]) < 2e-4)
            late = replace(scene, controller=pd, delay=period).check_gains([0.0])  # the same loop
            maps = late.loop.sample_map, scene.check_gains([0.0]).loop.sample_map
            modes = [np.sort_complex(np.linalg.eigvals(step)) for step in maps]
            np.testing.assert_allclose(modes[0], modes[1], rtol=1e-6, atol=1e-6)
            assert late.stable is found[-1]
        assert found == [True, False]

    @pytest.mark.parametrize("ki", kept([5.0, 20.0], [20.0]))
    def test_laws_with_states_diverge_where_it_says_so(self, ki):
        robot = first_joints()
        law = rne.control.pid(robot, 50, ki, 20, self.Q, gravity=True)
        limit = rne.Scene(robot, controller=law).check_gains(self.Q).sample_time_limit
        for factor, stable in ((0.97, True), (1.03, False)):
            scene = rne.Scene(robot, controller=law, sample_time=factor * limit)
            assert scene.check_gains(self.Q).stable is stable
            motion = rne.simulate(scene, self.Q + 1e-4, np.zeros(3), 400 * scene.sample_time)
            assert bool(abs(motion.q[-1] - self.Q).max() < 1.5e-4) is stable

    @pytest.mark.parametrize(
        ("parts", "is_rest"),
        [
            ({}, True),
            ({"friction": rne.Friction(viscous=1.0, load=0.1)}, True),
            ({"friction": rne.Friction(offset=5.0)}, False),
            ({"effort_limit": 1.0}, False),
            ({"springs": [rne.Spring.at_joint("joint_2", 100.0, 0.5)]}, False),
            ({"springs": [rne.Spring.at_joint("joint_2", 100.0, 0.0)]}, True),
        ],
    )
    def test_a_rest_is_one_of_the_whole_scene(self, parts, is_rest):
        robot = first_joints()
        scene = rne.Scene(robot, controller=rne.control.pd_gravity(robot, 500, 50, self.Q), **parts)
        assert scene.check_gains(self.Q).is_rest is is_rest
        motion = rne.simulate(scene, self.Q, np.zeros(3), 0.1)
        assert bool(abs(motion.q[-1] - self.Q).max() < 1e-9) is is_rest
