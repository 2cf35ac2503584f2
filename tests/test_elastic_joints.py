"""Elastic joints: closed forms, an integration of Spong's equations with Pinocchio, and all that reads such scenes."""

import itertools
import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import rne
from rne.commands.oracle import Oracle
from rne.simulation.plant import Plant

from .helpers import Part, assemble, kept
from .random_robots import random_tree, straight_chain

TIGHT = {"rtol": 1e-11, "atol": 1e-13}
MASS, ROTOR, STIFFNESS = 1.0, 0.5, 400.0


@pytest.fixture(scope="module")
def block():
    joint = Part(link="l", joint="j", kind="prismatic", parent=0, axis=np.eye(3)[0], mass=MASS)
    return rne.Robot(assemble("slider", [Part(link="base"), joint], gravity=(0, 0, 0)))


@pytest.fixture(scope="module")
def arm():
    """Two rods that swing under gravity."""
    return rne.Robot(straight_chain(2))


def two_masses(damping, viscous=0.0, kp=0.0, kd=0.0):
    """A of dx/dt = A x for x = (q, theta, q', theta')."""
    K, D = STIFFNESS * np.array([[1, -1], [-1, 1]]), damping * np.array([[1, -1], [-1, 1]])
    K, D = K + np.diag([0, kp]), D + np.diag([0, viscous + kd])
    inverse = np.diag([1 / MASS, 1 / ROTOR])
    return np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ K, -inverse @ D]])


@pytest.mark.parametrize(
    ("method", "damping"), kept([("DOP853", 0.0), ("DOP853", 3.0), ("Radau", 3.0)], [("DOP853", 0.0), ("DOP853", 3.0)])
)
def test_a_joint_between_two_masses_moves_as_the_exponential_of_its_matrix(block, method, damping):
    """Also under friction of the motor and a law that reads it; errors of 1e-11 a step, for some hundred steps."""
    scene = rne.Scene(
        block,
        elastic=rne.ElasticJoints(STIFFNESS, damping, ROTOR),
        friction=rne.Friction(viscous=0.7),
        controller=rne.traceable(lambda t, q, qd: -50 * q - 2 * qd),
    )
    t, x0 = np.linspace(0, 1, 6), np.array([0.1, -0.05, 0.3, -0.2])
    motion = rne.simulate(scene, x0[:2], x0[2:], 1.0, t_eval=t, method=method, **TIGHT)
    exact = np.array([expm(two_masses(damping, 0.7, 50, 2) * time) @ x0 for time in t])
    found = np.concatenate([motion.q, motion.motor_q, motion.qd, motion.motor_qd], axis=1)
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-9)
    np.testing.assert_allclose(motion.qdd[:, 0], (exact @ two_masses(damping, 0.7, 50, 2).T)[:, 2], rtol=0, atol=1e-6)
    assert motion.energy_drift <= 1e-9
    assert set(motion.dissipated) == {"viscous", *(["joint_damping"] if damping else [])}


def test_free_vibration_keeps_momentum_and_has_the_frequency_of_the_reduced_mass(block):
    scene = rne.Scene(block, elastic=rne.ElasticJoints(STIFFNESS, rotor=ROTOR))
    reduced = MASS * ROTOR / (MASS + ROTOR)
    t = np.linspace(0, 2 * np.pi * np.sqrt(reduced / STIFFNESS), 5)  # one period
    motion = rne.simulate(scene, [0.0, 0.01], [0.0], t[-1], t_eval=t, **TIGHT)
    assert motion.method == "DOP853"
    np.testing.assert_allclose((motion.motor_q - motion.q)[:, 0], 0.01 * np.cos(np.arange(5) * np.pi / 2), atol=1e-12)
    np.testing.assert_allclose(MASS * motion.qd + ROTOR * motion.motor_qd, 0, atol=1e-12)


def test_the_distance_from_rigid_joints_falls_as_the_compliance(arm):
    rotor, target = np.array([0.4, 0.1]), np.array([0.3, -0.2])
    law = rne.control.pd(arm, [40.0] * 2, [8.0] * 2, target)
    rigid = rne.simulate(rne.Scene(arm, armature=rotor, controller=law), [0.5, 0.2], [0, 0], 0.3, **TIGHT).q[-1]
    distances = []
    for stiffness in (1e4, 1e5):
        elastic = rne.ElasticJoints(stiffness, damping=np.sqrt(stiffness) / 10)
        scene = rne.Scene(arm, armature=rotor, elastic=elastic, controller=law)
        distances.append(
            np.abs(rne.simulate(scene, [0.5, 0.2], [0, 0], 0.3, rtol=1e-9, atol=1e-12).q[-1] - rigid).max()
        )
    assert distances[0] / distances[1] == pytest.approx(10, rel=0.05), distances


def test_an_arm_at_rest_stays_where_its_motors_hold_it(arm):
    q0 = np.array([0.5, 0.2])
    scene = rne.Scene(arm, payload=0.5, elastic=rne.ElasticJoints(1e3, 1.0, 0.2))
    weight = scene.resolved.robot.gravity_torque(q0)
    motion = rne.simulate(scene, q0, [0, 0], 0.5, torque=weight, **TIGHT)
    assert np.abs(motion.q - q0).max() <= 1e-12
    np.testing.assert_allclose(motion.motor_q, np.tile(q0 + weight / 1e3, (len(motion.t), 1)), atol=1e-12)


@pytest.mark.parametrize("seed", kept(range(50), range(4)))
def test_random_scenes_agree_with_an_integration_of_the_equations_with_pinocchio(seed):
    """Within 0.3 s errors of 1e-11 a step grow less than a thousandfold, and ten times as much where limits begin."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    model = random_tree(n, seed)
    own = Oracle(model, rne.to_urdf(model))
    inertia = np.diag(rne.dynamics.mass_matrix(model, np.zeros(n)))
    rotor, viscous, coulomb = (
        inertia * rng.uniform(0.5, 2, n),
        inertia * rng.uniform(0, 3, n),
        inertia * rng.uniform(0, 2, n),
    )
    stiffness = inertia * rng.uniform(20, 60, n) ** 2
    damping = inertia * rng.uniform(0, 10, n) if seed % 2 else np.zeros(n)
    gains, limit = inertia * 100, inertia * 30
    q0, qd0 = rng.uniform(-1, 1, (2, n))
    target = q0 + rng.uniform(-0.2, 0.2, n)

    def law(t, q, qd):
        return gains * (target - q) - gains / 4 * qd

    def rates(t, x):
        q, theta, qd, motor_qd = x.reshape(4, n)
        torsion = stiffness * (theta - q) + damping * (motor_qd - qd)
        drives = np.clip(law(t, theta, motor_qd), -limit, limit)
        resisting = viscous * motor_qd + coulomb * np.tanh(motor_qd / 0.3)
        return np.concatenate(
            [qd, motor_qd, own.forward_dynamics(q, qd, torsion), (drives - resisting - torsion) / rotor]
        )

    theta0 = q0 + own.gravity_torque(q0) / stiffness
    x = solve_ivp(rates, (0, 0.3), np.concatenate([q0, theta0, qd0, qd0]), method="DOP853", rtol=1e-11, atol=1e-13).y[
        :, -1
    ]
    scene = rne.Scene(
        rne.Robot(model),
        elastic=rne.ElasticJoints(stiffness, damping, rotor),
        friction=rne.Friction(viscous, coulomb, smoothing=0.3),
        effort_limit=limit,
        controller=law if seed % 3 else rne.traceable(law),
    )
    motion = rne.simulate(scene, q0, qd0, 0.3, method="DOP853", **TIGHT)
    found = np.concatenate([motion.q[-1], motion.motor_q[-1], motion.qd[-1], motion.motor_qd[-1]])
    np.testing.assert_allclose(found, x, rtol=0, atol=1e-7 * np.abs(x).max())
    assert motion.energy_drift <= 1e-8 * max(np.abs(motion.energy).max(), np.abs(motion.work).max())


LAWS = {"motor": lambda t, q, qd: -30 * q - 3 * qd, "link": lambda t, q, qd: -30 * q - 3 * qd}
LAWS["both"] = lambda t, q, qd: -30 * q[2:] - 3 * qd[2:] - 2 * (qd[2:] - qd[:2])


class Integral:
    """PI on what it reads."""

    states = 1

    def __call__(self, t, q, qd, z):
        return -30 * q - 3 * qd - 10 * z, q


@pytest.mark.parametrize("engine", kept(["numpy", "numba"], ["numpy"]))
@pytest.mark.parametrize("reads", ["motor", "link", "both"])
@pytest.mark.parametrize("sampled", [None, 0.002])
def test_a_law_reads_what_the_joints_say_however_it_is_run(arm, reads, sampled, engine):
    """Called and traced: the same motion, whose torques are the law's of what it reads."""
    law, elastic = LAWS[reads], rne.ElasticJoints(2e3, 1.0, 0.2, reads)
    how = {"elastic": elastic, "sample_time": sampled}
    called = rne.Scene(arm, **how, controller=lambda *state: law(*state))
    traced = rne.Scene(rne.Robot(arm.model, engine), **how, controller=rne.traceable(law))
    motion, other = (rne.simulate(scene, [0.5, 0.2], [0.0, 0.1], 0.1, **TIGHT) for scene in (called, traced))
    given = {"motor": (motion.motor_q, motion.motor_qd), "link": (motion.q, motion.qd)}
    given["both"] = tuple(np.concatenate(pair, axis=1) for pair in zip(given["link"], given["motor"], strict=True))
    at_samples = slice(None) if sampled is None else np.isin(motion.t, 0.002 * np.arange(50))
    assert at_samples is not None
    assert len(motion.t[at_samples]) > 20
    for t, q, qd, tau in zip(*(x[at_samples] for x in (motion.t, *given[reads], motion.tau)), strict=True):
        np.testing.assert_allclose(tau, law(t, q, qd), atol=1e-12)
    assert max(motion.energy_drift, other.energy_drift) <= 1e-9
    np.testing.assert_allclose(other.q[-1], motion.q[-1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("sampled", [None, 1e-4])
def test_states_of_a_law_are_integrals_of_what_it_reads(block, sampled):
    """By Euler's rule from sample to sample, 1e-4 s apart."""
    law = rne.traceable(Integral())
    scene = rne.Scene(block, elastic=rne.ElasticJoints(STIFFNESS, 1.0, ROTOR), controller=law, sample_time=sampled)
    motion = rne.simulate(scene, [0.1, 0.2], [0.0], 0.05, t_eval=np.linspace(0, 0.05, 501), **TIGHT)
    integral = np.trapezoid(motion.motor_q[:, 0], motion.t)
    assert motion.controller_state[-1, 0] == pytest.approx(integral, abs=1e-6 if sampled is None else 1e-5)


def test_slopes_of_the_motion_are_those_of_a_complex_step(arm):
    """eps times the condition of M, which is below 100."""
    law = rne.traceable(LAWS["both"])
    elastic = rne.ElasticJoints([2e3, 1e3], 1.0, [0.2, 0.1], "both")
    scene = rne.Scene(arm, elastic=elastic, controller=law, friction=rne.Friction(1.0, 0.5))
    plant, x = Plant(scene.dynamics, scene.resolved.robot), np.random.default_rng(0).uniform(-1, 1, scene.dynamics.size)
    rates, step = scene.dynamics.right_hand_side_core, 1e-30
    columns = []
    for k in range(len(x)):
        moved = x.astype(complex)
        moved[k] += 1j * step
        columns.append(rates(scene.resolved.robot.model.astype(complex), np.zeros(1), moved)[0].imag / step)
    np.testing.assert_allclose(plant.jacobian(0.0, x), np.array(columns).T, rtol=1e-12, atol=1e-9)


def test_links_vibrate_behind_motors_that_stick_and_motors_break_away_under_the_torsion(block):
    """While a motor sticks its link swings as on a wall; the torsion that moves a motor is its static friction."""
    dry = rne.Friction(coulomb=10.0, static=12.0, smoothing=0)
    scene = rne.Scene(block, elastic=rne.ElasticJoints(STIFFNESS, rotor=ROTOR), friction=dry)
    t = np.linspace(0, 0.3, 7)
    held = rne.simulate(scene, [0.02, 0.0], [0.0], 0.3, t_eval=t, **TIGHT)
    np.testing.assert_allclose(held.q[:, 0], 0.02 * np.cos(np.sqrt(STIFFNESS / MASS) * t), rtol=0, atol=1e-9)
    assert not held.motor_q.any()
    assert not held.motor_qd.any()
    scene = replace(scene, friction=replace(dry, viscous=0.5))
    pulled = rne.simulate(scene, [0.0, 0.0], [1.0, 0.0], 0.3, **TIGHT)
    assert pulled.energy_drift <= 1e-9
    assert pulled.dissipated["coulomb"][-1] > 0.01
    first = np.flatnonzero(pulled.motor_q[:, 0])[0] - 1
    assert STIFFNESS * pulled.q[first, 0] == pytest.approx(12.0, abs=1e-6)


def test_stops_are_those_of_links(arm):
    model = replace(arm.model, upper=np.array([0.6, np.inf]))
    scene = rne.Scene(rne.Robot(model), elastic=rne.ElasticJoints(200.0, rotor=0.2), stops=True)
    motion = rne.simulate(scene, [0.5, 0.2], [3.0, 0.0], 1.0)
    assert motion.status == 1
    assert motion.q[-1, 0] == pytest.approx(0.6, abs=1e-9)
    assert abs(motion.motor_q[-1, 0] - 0.6) > 1e-4


def test_impulses_of_limited_torques_are_of_the_motors(arm):
    """A law at its limit all the way: the motor gets the limit."""
    scene = rne.Scene(
        arm, elastic=rne.ElasticJoints(1e3, 0.5, 0.2), effort_limit=[2.0, 1.0], controller=rne.traceable(LAWS["motor"])
    )
    motion = rne.simulate(scene, [0.5, 0.9], [0.0, 0.0], 0.1, **TIGHT)
    assert np.abs(motion.tau).max(axis=0).tolist() == [2.0, 1.0]
    assert motion.energy_drift <= 1e-9


@pytest.mark.parametrize("smoothing", [0.01, 0.0])
def test_springs_pull_at_links(arm, smoothing):
    """The torsion holds weight and springs at first; the ledger closes, and equals that of Spong's equations."""
    springs = [rne.Spring.at_joint("joint1", 5.0, 1.0, damping=0.3), rne.Spring.at_joint("joint0", 3.0, -1.0)]
    dry = rne.Friction(coulomb=0.5, smoothing=smoothing)
    scene = rne.Scene(arm, elastic=rne.ElasticJoints(500.0, 1.0, 0.2), springs=springs, friction=dry)
    q0 = np.array([0.5, 0.2])
    motion = rne.simulate(scene, q0, [0, 0], 0.5, **TIGHT)
    weight = arm.gravity_torque(q0) + [3.0 * (0.5 + 1.0), 5.0 * (0.2 - 1.0)]
    np.testing.assert_allclose(500.0 * (motion.motor_q[0] - q0), weight, rtol=0, atol=1e-11)
    assert motion.energy_drift <= 1e-9
    assert list(motion.dissipated) == ["coulomb", "springs", "joint_damping"]
    assert min(energy[-1] for energy in motion.dissipated.values()) > 1e-4
    torsion = 500.0 * (motion.motor_q - motion.q) + motion.motor_qd - motion.qd
    held = np.stack([3.0 * (motion.q[:, 0] + 1.0), 5.0 * (motion.q[:, 1] - 1.0) + 0.3 * motion.qd[:, 1]], axis=1)
    qdd = arm.forward_dynamics(motion.q, motion.qd, torsion - held)
    np.testing.assert_allclose(motion.qdd, qdd, rtol=0, atol=1e-10 * np.abs(qdd).max())


@pytest.mark.parametrize("engine", kept(["numpy", "numba"], ["numpy"]))
def test_ensembles_move_as_single_motions(arm, engine):
    """Side by side, by equal steps, and one after another; with other inertial parameters too."""
    robot = rne.Robot(arm.model, engine).with_armature(0.2)
    rng, law = np.random.default_rng(0), rne.traceable(LAWS["both"])
    elastic = rne.ElasticJoints(500.0, 1.0, reads="both")
    scene = rne.Scene(robot, elastic=elastic, controller=law)
    q0, qd0 = rng.uniform(-1, 1, (2, 2)), np.zeros((2, 2))
    single = [rne.simulate(scene, q, qd, 0.05, **TIGHT) for q, qd in zip(q0, qd0, strict=True)]
    ends = np.array([motion.q[-1] for motion in single])
    together = rne.ensemble(scene, q0, qd0, 0.05, **TIGHT)
    np.testing.assert_allclose(together.q[-1], ends, rtol=0, atol=1e-9)
    np.testing.assert_allclose(together.tau[-1], [motion.tau[-1] for motion in single], rtol=0, atol=1e-7)
    np.testing.assert_allclose(together.qd[-1], [motion.qd[-1] for motion in single], rtol=0, atol=1e-8)
    assert together.ledger == ("drives", "joint_damping")
    losses = [motion.dissipated["joint_damping"][-1] for motion in single]
    np.testing.assert_allclose(together.energies[-1, :, 1], losses, rtol=0, atol=1e-9)
    np.testing.assert_allclose(rne.ensemble(scene, q0, qd0, 0.05, step=5e-4).q[-1], ends, rtol=0, atol=1e-6)
    euler = rne.ensemble(scene, q0, qd0, 0.05, step=5e-4, method="semi-implicit-euler")
    np.testing.assert_allclose(euler.q[-1], ends, rtol=0, atol=5e-3)
    stopped = rne.ensemble(replace(scene, stops=True), q0, qd0, 0.05, **TIGHT)
    np.testing.assert_allclose(stopped.q[-1], ends, rtol=0, atol=1e-9)
    heavier = 1.2 * robot.parameters
    other = rne.simulate(replace(scene, robot=robot.with_parameters(heavier)), q0[0], qd0[0], 0.05, **TIGHT)
    start = np.concatenate([q0[0], other.motor_q[0]])
    for stops, where in itertools.product((False, True), (start, q0[0])):  # torsion holds the heavier links too
        found = rne.ensemble(replace(scene, stops=stops), where[None], qd0[:1], 0.05, parameters=heavier[None], **TIGHT)
        np.testing.assert_allclose(found.q[-1, 0], other.q[-1], rtol=0, atol=1e-9)


def test_auto_takes_explicit_methods_where_joints_are_undamped_and_stiff_ones_where_they_are_damped(arm):
    """Joints of 400 rad/s and more: their periods must be followed where nothing damps them."""
    law = rne.traceable(lambda t, q, qd: -30 * q - 3 * qd)
    methods = []
    for damping in (0.0, 40.0):
        scene = rne.Scene(arm, elastic=rne.ElasticJoints(2e4, damping, 0.2), controller=law)
        methods.append(rne.simulate(scene, [0.5, 0.2], [0, 0], 1.0).method)
    assert methods == ["DOP853", "LSODA"]


def test_a_motion_is_kept_shown_and_told_with_its_motors(arm, tmp_path):
    scene = rne.Scene(arm, elastic=rne.ElasticJoints(500.0, 1.0, 0.2), controller=rne.traceable(LAWS["motor"]))
    motion = rne.simulate(scene, [0.5, 0.2], [0, 0], 0.5, rtol=1e-9)
    for other in (rne.Trajectory.load(motion.save(tmp_path / "m.npz")), pickle.loads(pickle.dumps(motion))):
        assert np.array_equal(other.motor_q, motion.motor_q)
        assert np.array_equal(other.motor_qd, motion.motor_qd)
        assert other.dissipated.keys() == {"joint_damping"}
    file = motion.to_csv(tmp_path / "m.csv")
    assert "motor_q.joint0,motor_q.joint1,motor_qd.joint0" in file.read_text()
    assert np.array_equal(rne.trajectories.read_csv(file, arm.joint_names).q, motion.q)
    record = rne.identification.Record.from_trajectory(motion, 100.0)
    fine = rne.simulate(scene, [0.5, 0.2], [0, 0], 0.5, rtol=1e-9, t_eval=record.t)
    np.testing.assert_allclose(record.q, fine.motor_q, rtol=0, atol=1e-4)
    report = rne.drives(scene, motion)
    assert report.work.sum() == pytest.approx(motion.work[-1], rel=1e-4)
    assert np.array_equal(report.peak_speed, np.abs(report.speed).max(axis=0))
    assert report.work_error < 1e-2 * np.abs(motion.work).max()
    rigid = rne.simulate(rne.Scene(arm), [0.5, 0.2], [0, 0], 0.1)
    assert rigid.motor_q.shape == rigid.motor_qd.shape == (0, 0)


def test_plots_show_motors_and_energies_of_rotors_and_torsion(arm):
    plt = pytest.importorskip("matplotlib.pyplot", reason="matplotlib is not installed")
    motion = rne.simulate(rne.Scene(arm, elastic=rne.ElasticJoints(500.0, 1.0, 0.2)), [0.5, 0.2], [0, 0], 0.5)
    figure = rne.plotting.plot(motion, quantities=["motor_q", "motor_qd", "energy"])
    assert [ax.get_ylabel() for ax in figure.axes][:2] == ["motor position [rad]", "motor velocity [rad/s]"]
    total = figure.axes[2].get_lines()[2].get_ydata()
    assert np.array_equal(total, motion.energy)
    plt.close(figure)


def test_the_function_of_casadi_is_the_right_hand_side(arm):
    pytest.importorskip("casadi", reason="CasADi is not installed")
    scene = rne.Scene(arm, elastic=rne.ElasticJoints(500.0, 1.0, 0.2), friction=rne.Friction(1.0))
    x, u = np.random.default_rng(0).uniform(-1, 1, 8), np.array([1.0, 2.0])
    dx, tau = scene.to_casadi()(0.0, x, u)
    torqued = replace(scene.dynamics, inputs="called", has_energies=False)
    expected, _ = torqued.right_hand_side.evaluate(scene.resolved.robot.model, np.zeros(1), x, u, torqued.vector)
    np.testing.assert_allclose(np.array(dx).ravel(), expected, rtol=1e-12, atol=1e-12)
    assert np.array(tau).ravel().tolist() == [1.0, 2.0]


def test_a_scene_tells_what_it_costs(arm):
    """Two torsions with damping, two rotors: at most nine operations a joint more than the links alone."""
    scene = rne.Scene(arm, elastic=rne.ElasticJoints(500.0, 1.0, 0.2, "both"), controller=rne.traceable(LAWS["both"]))
    assert scene.cost().keys() == {"total", "controller", "gravity", "law"}
    links = sum(rne.Scene(arm).kernel.operations.values())
    assert 0 < sum(replace(scene, controller=None).kernel.operations.values()) - links <= 2 * 9


def test_links_without_inertia_need_rigid_joints():
    """Rotors make M of a rigid arm regular; behind elastic joints nothing resists the torsion."""
    parts = [Part(link="base"), Part(link="l", joint="j", kind="revolute", parent=0, axis=np.eye(3)[0])]
    hand = rne.Robot(assemble("massless", parts, gravity=(0, 0, 0))).with_armature(1.0)
    assert rne.simulate(rne.Scene(hand), [0.0], [1.0], 0.1).q[-1, 0] == pytest.approx(0.1)
    assert rne.dynamics.forward_dynamics(hand.model, [0.0], [0.0], [2.0]) == 2.0
    text = "simulation stopped at t = 0 s of 0.1 s: M is singular: nothing with inertia moves with 'j'"
    with pytest.raises(rne.SimulationError, match=text):
        rne.simulate(rne.Scene(hand, elastic=rne.ElasticJoints(100.0)), [0.0], [1.0], 0.1)


def test_motors_creep_under_smoothed_friction_that_would_hold_them(arm):
    """Under 1 / 1.3 of the friction at rest a motor creeps at 0.01 rad/s times artanh(1 / 1.3), and takes its link."""
    q0 = np.array([0.5, 0.2])
    friction = rne.Friction(coulomb=1.3 * np.abs(arm.gravity_torque(q0)))
    scene = rne.Scene(arm, elastic=rne.ElasticJoints(500.0, 1.0, 0.2), friction=friction)
    motion = rne.simulate(scene, q0, [0, 0], 2.0)
    assert motion.message.startswith("crept where dry friction (smoothing=0) would hold: joint0 by 0.02")
    still = rne.simulate(replace(scene, friction=replace(friction, smoothing=0.0)), q0, [0, 0], 2.0)
    assert np.abs(still.q - q0).max() <= 1e-9
    assert not still.motor_qd.any()


def test_equal_scenes_have_equal_equations_also_after_pickling(arm):
    """By value: their kernels are shared."""
    first, second = (rne.Scene(arm, elastic=rne.ElasticJoints(k, rotor=1.0)).dynamics for k in (1e3, 1e3))
    assert first == second == pickle.loads(pickle.dumps(first))
    assert hash(first) == hash(second)
    assert first != rne.Scene(arm, elastic=rne.ElasticJoints(1e3, rotor=2.0)).dynamics


MIMIC = rne.Robot(random_tree(2, 0, mimics=1))
REFUSED = [
    (lambda arm: rne.ElasticJoints(1.0, reads="q"), "`reads` must be one of ['motor', 'link', 'both'], got 'q'"),
    (lambda arm: rne.Scene(arm, elastic=5.0), "`elastic` must be an rne.ElasticJoints, got float"),
    (
        lambda arm: rne.Scene(arm, elastic=rne.ElasticJoints(1.0)),
        "elastic joints need a `rotor`, or an armature, got none for joint0, joint1",
    ),
    (
        lambda arm: rne.Scene(arm, armature=[1.0, 0.0], elastic=rne.ElasticJoints(1.0)),
        "elastic joints need a `rotor`, or an armature, got none for joint1",
    ),
    (
        lambda arm: rne.Scene(arm, armature=1.0, elastic=rne.ElasticJoints(1.0, rotor=1.0)),
        "`rotor` of the elastic joints is given, and so is an armature: give one of them",
    ),
    (
        lambda arm: rne.Scene(arm, elastic=rne.ElasticJoints([1.0, 0.0], rotor=1.0)),
        "`stiffness` of joint 'joint1' must be positive and finite, got 0",
    ),
    (
        lambda arm: rne.Scene(arm, elastic=rne.ElasticJoints({"joint0": 1.0, "j": 2.0}, rotor=1.0)),
        "`stiffness` must name joints of ['joint0', 'joint1'], got 'j'",
    ),
    (
        lambda arm: rne.Scene(arm, elastic=rne.ElasticJoints({"joint1": 2.0}, rotor=1.0)),
        "`stiffness` must name all joints, as all are flexible, got none for joint0; where one is rigid, give it a stiffness "
        "far above the others' and critical damping, 2 sqrt(stiffness rotor)",
    ),
    (
        lambda arm: rne.Scene(arm, elastic=rne.ElasticJoints([1.0, np.nan], rotor=1.0)),
        "`stiffness[1]` of joint 'joint1' must be a number, got nan",
    ),
    (
        lambda arm: rne.Scene(arm, elastic=rne.ElasticJoints(1.0, np.inf, rotor=1.0)),
        "`damping` of joint 'joint0' must be finite, got inf",
    ),
    (
        lambda arm: rne.Scene(arm, elastic=rne.ElasticJoints(1.0, -1.0, rotor=1.0)),
        "`damping[0]` of joint 'joint0' must not be negative, got -1.0",
    ),
    (
        lambda arm: rne.Scene(arm, elastic=rne.ElasticJoints(1.0, rotor=[1.0, -2.0])),
        "`rotor[1]` of joint 'joint1' must not be negative, got -2.0",
    ),
    (
        lambda arm: rne.Scene(arm, elastic=rne.ElasticJoints([np.inf, 1.0], rotor=1.0)),
        "`stiffness` of joint 'joint0' must be positive and finite, got inf; where one is rigid, give it a stiffness far above "
        "the others' and critical damping, 2 sqrt(stiffness rotor)",
    ),
    (lambda arm: rne.Scene(arm, elastic=rne.ElasticJoints([1.0] * 3, rotor=1.0)), "`stiffness` must have shape (2,), got (3,)"),
    (lambda arm: rne.Scene(MIMIC, elastic=rne.ElasticJoints(1.0, rotor=1.0)), "`elastic` is not for joints that follow others, got joint2"),
    (
        lambda arm: scene_of(arm).inverse_dynamics([0] * 2, [0] * 2, [0] * 2),
        "`inverse_dynamics` is not for elastic joints: torques of drives also depend on how accelerations change; "
        "use scene.resolved.robot for the links alone",
    ),
    (
        lambda arm: scene_of(arm).forward_dynamics([0] * 2, [0] * 2, [0] * 2),
        "`forward_dynamics` is not for elastic joints: accelerations follow from the torsion, not from the drives' "
        "torques; use scene.resolved.robot for the links alone",
    ),
    (lambda arm: rne.simulate(scene_of(arm), [0] * 3, [0] * 2, 1.0), "`q0` must have shape (..., 2) for robot 'chain2', got (3,)"),
    (lambda arm: rne.simulate(scene_of(arm), [0] * 2, [np.nan] * 4, 1.0), "`qd0` must be finite, got nan at index (0,)"),
    (
        lambda arm: rne.drives(arm, rne.simulate(scene_of(arm), [0] * 2, [0] * 2, 0.1), rotor=0.1),
        "`rotor` must be 0 for a motion with elastic joints: the rotors are in its torques",
    ),
]  # fmt: skip


def scene_of(arm):
    return rne.Scene(arm, elastic=rne.ElasticJoints(500.0, rotor=0.2))


@pytest.mark.parametrize(("call", "text"), REFUSED, ids=[text[:40] for _, text in REFUSED])
def test_what_does_not_fit_is_refused(arm, call, text):
    with pytest.raises((ValueError, TypeError)) as caught:
        call(arm)
    assert str(caught.value) == text


def test_numbers_by_name_and_rotors_of_the_robot(arm):
    by_name = {"joint1": 2e3, "joint0": 1e3}
    side = rne.Scene(arm, armature=[0.2, 0.1], elastic=rne.ElasticJoints(by_name)).resolved
    assert side.motor_side == ((1e3, 2e3), (0.0, 0.0), (0.2, 0.1), "motor")
    assert not side.robot.model.armature.any()
    of_robot = rne.Scene(arm.with_armature([0.2, 0.1]), elastic=rne.ElasticJoints(by_name)).resolved
    assert of_robot.motor_side == side.motor_side
    locked = rne.Scene(arm, locked={"joint0": 0.3}, elastic=rne.ElasticJoints(2e3, rotor=0.1))
    assert locked.resolved.motor_side.stiffness == (2e3,)
    stiffness = np.array([1e3, 1e3])
    elastic = rne.ElasticJoints(stiffness, rotor=1.0)
    stiffness[:] = -1  # the array is the caller's
    assert rne.Scene(arm, elastic=elastic).resolved.motor_side.stiffness == (1e3, 1e3)


def test_laws_of_n_numbers_cannot_read_links_and_motors():
    robot = rne.load("irb140").with_armature(1.0)
    law = rne.control.pd_gravity(robot, 50, 20, 0)
    with pytest.raises(
        ValueError, match=r"^`controller` reads 6 numbers: `reads` of `elastic` must be 'motor' or 'link'$"
    ):
        rne.Scene(robot, elastic=rne.ElasticJoints(1e4, reads="both"), controller=law)
