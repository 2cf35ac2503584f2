"""Joints that follow others: against multipliers on the open tree, against laws, and through everything that has q."""

import copy
import pickle
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import rne
from rne.__main__ import main
from rne.commands.agreement import loop_gap, validate
from rne.dynamics.kinematics import coordinate_map, coordinate_map_rate, joint_positions, joint_velocities
from rne.elementwise import arctan2, minimum
from rne.graph.program import Operand, evaluate
from rne.model import coupled, cylinder, four_bar, slider_crank

from .helpers import EPS, Part, assemble, complex_steps, kept, pose

Y = (0.0, 1.0, 0.0)
INERTIA = np.array([[0.02, 0.003, 0.001], [0.003, 0.03, 0.002], [0.001, 0.002, 0.04]])
MULTIPLIERS = 1e-11  # relative, times the condition of M
CLOSED = 1e-12  # [m] of links of a metre: some hundred rounding errors, more near dead points
STEP = 1e-30  # of complex steps
robot_of = cache(rne.Robot)  # one of each model, which keeps the kernels that are traced


def part(name, parent, at, axis=Y, **given):
    """A body of 2 kg that is not symmetric, on a joint of its name with a rotor."""
    body = {"mass": 2.0, "com": np.array([0.1, 0.03, 0.05]), "inertia": 2 * INERTIA}
    given = {"kind": "revolute", "lower": -3.0, "upper": 3.0, "armature": 0.1} | body | given
    axis = np.array(axis) / np.linalg.norm(axis)
    return Part(link=name, joint=name, parent=parent, placement=pose(np.eye(3), np.array(at)), axis=axis, **given)


def tree(*parts):
    return assemble("linkage", [Part(link="base"), *parts])


def bar():
    """Crank, coupler and rocker of 0.35, 0.838 and 0.6 m on a base of 0.8 m, and an arm on the rocker."""
    arm = part("arm", 3, (0, 0, 0.65), (0.6, 0, 0.8))
    open_tree = tree(
        part("crank", 0, (0, 0, 0)), part("coupler", 1, (0, 0.1, 0.35)), part("rocker", 0, (0.8, 0, 0)), arm
    )
    closing = (("coupler", (0.8, 0, 0.25)), ("rocker", (0, 0.1, 0.6)))
    return four_bar(open_tree, "crank", closing), open_tree, [closing]


def press():
    """A crank of 0.1 m that drives a slider by a rod of 0.5 m, which is mounted on it."""
    slider = part("slider", 0, (0.6, 0, 0), (1, 0, 0), kind="prismatic")
    open_tree = tree(part("crank", 0, (0, 0, 0)), part("rod", 1, (0.1, 0.05, 0)), slider)
    value = slider_crank("crank", crank=0.1, rod=0.5)
    closing = (("rod", (0.5, 0, 0)), ("slider", (0, 0.05, 0)))
    return coupled(open_tree, {"rod": value, "slider": value}), open_tree, [closing]


def engine():
    """A slider that drives the same crank by a rod that is mounted on the slider, the crank at an angle of 0.7."""
    pin = 0.1 * np.array([np.cos(0.7), 0, -np.sin(0.7)])
    x = pin[0] + np.sqrt(0.25 - pin[2] ** 2)
    slider = part("slider", 0, (x, 0, 0), (1, 0, 0), kind="prismatic")
    open_tree = tree(slider, part("rod", 1, (0, 0, 0)), part("crank", 0, (0, 0, 0)))
    value = slider_crank("slider", crank=0.1, rod=0.5, angle=0.7)
    closing = (("rod", tuple(pin - [x, 0, 0])), ("crank", tuple(pin)))
    return coupled(open_tree, {"rod": value, "crank": value}), open_tree, [closing]


def crane(driver="piston"):
    """A boom that a hydraulic cylinder turns."""
    piston = part("piston", 2, (0.3, 0, 0.35), (0.6, 0, 0.7), kind="prismatic")
    open_tree = tree(part("boom", 0, (0, 0, 0)), part("barrel", 0, (0.2, 0, -0.6)), piston)
    closing = (("piston", (0.3, 0, 0.35)), ("boom", (0.8, 0, 0.1)))
    return cylinder(open_tree, driver, closing), open_tree, [closing]


def palletiser():
    """Shoulder and elbow drive on one axis, the elbow driven through a parallelogram, the tool kept level."""
    links = part("upper", 0, (0, 0, 0)), part("forearm", 1, (0, 0, 0.6)), part("lever", 0, (0, 0.1, 0))
    open_tree = tree(*links, part("rod", 3, (-0.2, 0, 0)), part("tool", 2, (0.7, 0, 0)))
    closing = (("rod", (0, 0, 0.6)), ("forearm", (-0.2, 0.1, 0)))
    closed = four_bar(open_tree, "upper", closing)
    return (
        coupled(closed, {"tool": (("lever",), lambda x: -x)}),
        open_tree,
        [closing, {"tool": 1, "lever": 1}],
    )


def wrist():
    """Two motors that bend by half their sum and turn by half their difference."""
    motors = part("a", 1, (0, 0, 0.1), (1, 0, 0)), part("b", 1, (0, 0.1, 0.1), (1, 0, 0))
    bend, turn = part("bend", 1, (0.3, 0, 0)), part("turn", 4, (0.1, 0, 0), (1, 0, 0))
    open_tree = tree(part("forearm", 0, (0, 0, 0)), *motors, bend, turn)
    both = {"bend": (("a", "b"), lambda a, b: (a + b) / 2), "turn": (("a", "b"), lambda a, b: (a - b) / 2)}
    rows = [{"bend": 2, "a": -1, "b": -1}, {"turn": 2, "a": -1, "b": 1}]
    return coupled(open_tree, both), open_tree, rows


ROBOTS = {f.__name__: f for f in (bar, press, engine, crane, palletiser, wrist)}
ROBOTS["boom"] = lambda: crane("boom")
linkage = cache(lambda name: ROBOTS[name]())


def drawn(model, samples, seed=0):
    """Random states in the ranges of the coordinates, 2 % away from the ends."""
    rng, low, high = (
        np.random.default_rng(seed),
        *(np.clip(model.coordinate_limits()[k], -3, 3) for k in ("lower", "upper")),
    )
    margin = 0.02 * (high - low)
    return rng.uniform(low + margin, high - margin, (samples, model.n)), *rng.normal(size=(3, samples, model.n))


def constraints(robot, conditions, q, qd):
    """A and dA/dt of the loops' velocities A qd = 0 on the open tree; planes are x and z."""
    A, dA = [], []
    for condition in conditions:
        if isinstance(condition, dict):
            A.append([condition.get(name, 0) for name in robot.joint_names])
            dA.append(np.zeros(robot.n))
            continue
        J, dJ = (
            first - second
            for first, second in zip(
                *((robot.jacobian(q, l, point=p), robot.jacobian_rate(q, qd, l, point=p)) for l, p in condition),
                strict=True,
            )
        )
        A += [*J[[3, 5]]]
        dA += [*dJ[[3, 5]]]
    return np.array(A), np.array(dA)


def by_multipliers(robot, conditions, S, q, qd, u):
    """Accelerations of M qdd + h = S u + A^T l with A qdd + dA/dt qd = 0 on the open tree, and the system's condition."""
    A, dA = constraints(robot, conditions, q, qd)
    M, h = robot.mass_matrix(q), robot.bias_torque(q, qd)
    K = np.block([[M, -A.T], [A, np.zeros((len(A), len(A)))]])
    return np.linalg.solve(K, np.concatenate([S @ u - h, -dA @ qd]))[: robot.n], np.linalg.cond(K)


@pytest.mark.parametrize("samples", kept([10, 1000], [10]))
@pytest.mark.parametrize("name", ROBOTS)
def test_motion_is_that_of_multipliers_on_the_open_tree(name, samples):
    model, open_tree, conditions = linkage(name)
    robot, whole = robot_of(model), robot_of(open_tree)
    q, qd, u, _ = drawn(model, samples)
    u = 20 * u
    S = np.array([[float(j == k) for k in model.joint_names] for j in whole.joint_names])
    positions, velocities = joint_positions(model, q), joint_velocities(model, q, qd)
    G, dG, qdd = coordinate_map(model, q), coordinate_map_rate(model, q, qd), robot.forward_dynamics(q, qd, u)
    assert np.abs(robot.inverse_dynamics(q, qd, qdd) - u).max() < MULTIPLIERS * np.abs(u).max()
    for k in range(samples):
        wanted, condition = by_multipliers(whole, conditions, S, positions[k], velocities[k], u[k])
        bound = MULTIPLIERS * np.linalg.cond(robot.mass_matrix(q[k])) + EPS * condition  # a folded parallelogram's: 1e7
        bound *= np.abs(wanted).max()
        for own in (qdd[k], rne.dynamics.forward_dynamics(model, q[k], qd[k], u[k])) if k < 10 else (qdd[k],):
            found = G[k] @ own + dG[k] @ qd[k]
            assert np.abs(found - wanted).max() < bound


@pytest.mark.parametrize("name", ROBOTS)
def test_loops_stay_closed(name):
    model, open_tree, conditions = linkage(name)
    q, qd, *_ = drawn(model, 50)
    positions, velocities = joint_positions(model, q), joint_velocities(model, q, qd)
    for condition in conditions:
        if isinstance(condition, dict):
            rows = np.array([condition.get(joint, 0) for joint in open_tree.joint_names])
            assert np.abs(positions @ rows).max() < 1e-14
            continue
        points = []
        for link, point in condition:
            T = rne.dynamics.link_poses(open_tree, positions)[:, open_tree.link_index(link)]
            points.append(T[:, :3, :3] @ point + T[:, :3, 3])
        assert np.abs(points[0] - points[1]).max() < CLOSED
        assert loop_gap(robot_of(model), *condition)[0] < 1e-6  # at dead points, where roots have half the digits
    for k in range(10):
        A, _ = constraints(rne.Robot(open_tree), conditions, positions[k], velocities[k])
        assert np.abs(A @ coordinate_map(model, q[k])).max() < 1e-12 * np.abs(coordinate_map(model, q[k])).max()


@pytest.mark.parametrize("duration", kept([2.0, 60.0], [2.0]))
@pytest.mark.parametrize("name", ["bar", "press", "palletiser", "wrist", "boom"])
def test_free_swing_keeps_its_energy(name, duration):
    """A minute within 1e-9 of the energy that is exchanged; cranks turn around and beyond their ranges."""
    model = replace(linkage(name)[0], armature=np.full(linkage(name)[0].nb, 1.0))
    motion = rne.simulate(robot_of(model), np.full(model.n, 0.05), np.zeros(model.n), duration, rtol=1e-12, atol=1e-13)
    assert motion.energy_drift < 1e-9
    assert np.ptp(motion.kinetic) > 1


@pytest.mark.parametrize("name", kept(["bar", "engine", "crane", "wrist"], ["engine", "crane"]))
def test_derivatives_are_those_of_complex_steps(name):
    model, *_ = linkage(name)
    q, qd, u, weights = drawn(model, 5)
    for function in (rne.dynamics.inverse_dynamics, rne.dynamics.forward_dynamics):
        names = tuple(function.quantity.widths)
        wanted = complex_steps(function, model, (q, qd, u), names)
        found = rne.kernels.derivative(function, model, *names)(q, qd, u)
        assert np.abs(found - wanted).max() < 1e-11 * np.abs(wanted).max()
        gradient = rne.kernels.gradient(function, model, *names)
        wanted = np.einsum("si,sij->sj", weights, wanted)
        assert np.abs(gradient(q, qd, u, weights) - wanted).max() < 1e-11 * np.abs(wanted).max()
        hessian = rne.kernels.hessian(function, model, *names)(q, qd, u, weights)
        X = np.concatenate([q, qd, u, weights], axis=1)
        for k in range(3 * model.n):  # complex steps of the gradient
            X_k = X + 1j * STEP * (np.arange(X.shape[1]) == k)
            column = evaluate(gradient.traced.program, gradient.traced.entries, X_k).imag / STEP
            assert np.abs(hessian[..., k] - column).max() < 1e-10 * np.abs(hessian).max()


def test_pinocchios_constrained_dynamics():
    """A contact of three directions, one of which is redundant in the plane, for which Pinocchio regularises by 1e-12."""
    pin = pytest.importorskip("pinocchio")
    model, open_tree, (closing,) = linkage("bar")
    theirs = pin.buildModelFromXML(rne.to_urdf(open_tree))
    theirs.armature[:] = 0.1
    (a, p), (b, r) = (
        (theirs.getJointId(link), pin.SE3(np.eye(3), np.array(point, dtype=float))) for link, point in closing
    )
    contact = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, theirs, a, p, b, r, pin.ReferenceFrame.LOCAL)
    contacts, contact_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    contacts.append(contact)
    contact_data.append(contact.createData())
    data = theirs.createData()
    pin.initConstraintDynamics(theirs, data, contacts, contact_data)
    order = [theirs.joints[theirs.getJointId(joint)].idx_v for joint in open_tree.joint_names]
    q, qd, u, _ = drawn(model, 20)
    for state in zip(q, qd, u, strict=True):
        positions, velocities, torques = np.zeros(4), np.zeros(4), np.zeros(4)
        positions[order] = joint_positions(model, state[0])
        velocities[order] = joint_velocities(model, *state[:2])
        torques[[order[i] for i in model.independent_joints]] = state[2]
        settings = pin.ProximalSettings(1e-12, 1e-12, 100)
        found = pin.constraintDynamics(theirs, data, positions, velocities, torques, contacts, contact_data, settings)[
            order
        ]
        qdd = rne.dynamics.forward_dynamics(model, *state)
        wanted = coordinate_map(model, state[0]) @ qdd + coordinate_map_rate(model, *state[:2]) @ state[1]
        assert np.abs(found - wanted).max() < MULTIPLIERS * np.abs(wanted).max()


@pytest.mark.parametrize("name", ROBOTS)
def test_rate_of_m_less_twice_c_is_skew(name):
    model, *_ = linkage(name)
    q, qd, *_ = drawn(model, 10)
    C = rne.dynamics.coriolis_matrix(model, q, qd)
    N = rne.dynamics.mass_matrix(model, q + 1j * STEP * qd).imag / STEP - 2 * C
    assert np.abs(N + np.swapaxes(N, -1, -2)).max() < 1e-12 * np.abs(C).max(initial=1)


def test_couplings_are_data():
    model, open_tree, _ = linkage("bar")
    for same in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model), bar()[0]):
        assert same == model
        assert hash(same) == hash(model)
    assert model != open_tree
    q, qd, u, _ = drawn(model, 6)
    wanted = rne.dynamics.inverse_dynamics(model, q, qd, u)
    single = robot_of(model).inverse_dynamics(*(x.astype(np.float32) for x in (q, qd, u)))
    assert single.dtype == np.float32
    assert np.abs(single - wanted).max() < 1e-4 * np.abs(wanted).max()
    mpmath = pytest.importorskip("mpmath")
    with mpmath.workdps(40):
        digits = [np.vectorize(mpmath.mpf, otypes=[object])(x[0]) for x in (q, qd, u)]
        exact = rne.dynamics.inverse_dynamics(model, *digits)
        again = rne.dynamics.lagrange_inverse_dynamics(model, *digits)
        assert max(abs(exact - again)) < 1e-14  # rotations of the model have double precision
        assert np.abs(exact.astype(float) - wanted[0]).max() < 1e-14 * np.abs(wanted).max() * 10


@pytest.mark.parametrize("name", kept(["bar", "engine"], ["engine"]))
def test_engines_and_batches_agree(name):
    pytest.importorskip("numba")
    model, *_ = linkage(name)
    q, qd, u, _ = drawn(model, 60)
    wanted = rne.dynamics.forward_dynamics(model, q, qd, u)
    for engine in ("numpy", "numba"):
        robot = rne.Robot(model, engine=engine)
        for found in (
            robot.forward_dynamics(q, qd, u),
            [robot.forward_dynamics(*x) for x in zip(q, qd, u, strict=True)],
        ):
            assert np.abs(found - wanted).max() < 1e-11 * np.abs(wanted).max()


def test_casadis_function_is_the_kernel():
    pytest.importorskip("casadi")
    model, *_ = linkage("bar")
    q, qd, u, _ = drawn(model, 1)
    kernel = rne.compile(rne.dynamics.inverse_dynamics, model)
    assert (
        np.abs(np.array(kernel.to_casadi()(q[0], qd[0], u[0])).ravel() - kernel(q, qd, u)[0]).max()
        < 1e-12 * np.abs(u).max()
    )


def test_ranges_are_cut_to_where_the_loop_closes(caplog):
    """A rocker that swings, driven by itself: its crank would have to be longer."""
    _, open_tree, _ = linkage("bar")
    closing = (("coupler", (0.8, 0, 0.25)), ("rocker", (0, 0.1, 0.6)))
    caplog.clear()
    by_rocker = four_bar(open_tree, "rocker", closing)
    k = by_rocker.moving_joints.index("rocker")
    coupler = np.hypot(0.8, 0.25)
    # from the crank's axis the coupler's far end is at most crank + coupler away, and at least their difference
    reach = np.array([coupler + 0.35, coupler - 0.35])
    angles = np.arccos((0.8**2 + 0.6**2 - reach**2) / (2 * 0.8 * 0.6))  # of the rocker, from the line between the axes
    assert by_rocker.upper[k] == pytest.approx(angles[0] - np.pi / 2, abs=1e-9)
    assert by_rocker.lower[k] == pytest.approx(angles[1] - np.pi / 2, abs=1e-9)
    ends = "range cut from -3 ... 3 to -0.916448 ... 0.443232, beyond which crank, coupler cannot follow within the joints' ranges"
    assert caplog.messages == [f"joint 'rocker': {ends}"]
    assert by_rocker.notes["rocker"] == ends
    beyond = [by_rocker.upper[k] + 0.01, 0.0]
    robot = rne.Robot(by_rocker)
    low, high = by_rocker.lower[k], by_rocker.upper[k]
    text = f"joint 'crank' cannot follow 'rocker' at {beyond[0]:.6g}, range {low:.6g} ... {high:.6g}"
    # of one state, of a batch, by the recursion, and of a result that does not depend on the loop
    states = [np.array([[0.0, 0.0], beyond])] * 3
    for call, where in (
        (lambda: robot.inverse_dynamics(beyond, beyond, beyond), ""),
        (lambda: robot.forward_dynamics(*states), " at state (1,)"),
        (lambda: rne.dynamics.jacobian(by_rocker, beyond, "rocker"), ""),
        (lambda: rne.dynamics.forward_dynamics(by_rocker, *states), " at state (1,)"),
    ):
        with pytest.raises(rne.NotFiniteError) as error:
            call()
        assert str(error.value) == text + where
    with pytest.raises(rne.SimulationError, match="joint 'crank' cannot follow 'rocker' at"):
        rne.simulate(robot, [0.0, 0.0], [20.0, 0.0], 1.0)


def test_ranges_end_where_those_of_joints_that_follow_do():
    model, *_ = linkage("bar")
    coupler = joint_positions(model, np.array([[model.upper[0], 0.0], [model.upper[0] + 1e-9, 0.0]]))[:, 1]
    assert coupler[0] == pytest.approx(-3, abs=1e-14)
    assert coupler[1] < -3


def test_a_range_ends_where_a_joint_that_follows_is_beyond_its_own_for_a_hair_only():
    """0.5 sin(x) is above 0.5 - 1e-9 over 1e-4 rad, between any samples of x."""
    _, open_tree, _ = linkage("bar")
    upper = np.array(open_tree.upper)
    upper[open_tree.moving_joints.index("arm")] = 0.5 - 1e-9
    model = coupled(replace(open_tree, upper=upper), {"arm": (("crank",), lambda x: 0.5 * np.sin(x))})
    k = model.moving_joints.index("crank")
    assert model.upper[k] == pytest.approx(np.arcsin(1 - 2e-9), abs=1e-9)  # rounding of sin, over its slope there
    assert model.lower[k] == -3


def test_drivers_may_follow_others():
    """A six-bar: a second four-bar on the rocker of the first; a mimic of a joint that follows; linear ones are mimics."""
    _, open_tree, (closing,) = linkage("bar")
    mimic = coupled(open_tree, {"arm": (("rocker",), lambda x: 1.0 - 2 * x)})
    assert mimic.couplings == ()
    assert mimic.multiplier.tolist() == [1, 1, 1, -2]
    assert mimic.offset.tolist() == [0, 0, 0, 1]
    assert "<mimic" in rne.to_urdf(mimic)
    by_mimic = four_bar(mimic, "crank", closing)
    at_once = coupled(linkage("bar")[0], {"arm": (("rocker",), lambda x: 1.0 - 2 * x)})
    q = np.array([0.3])
    for model in (by_mimic, at_once):
        assert model.joint_names == ("crank",)
        positions = joint_positions(model, q)
        assert positions[3] == pytest.approx(1 - 2 * positions[2], abs=1e-15)
    assert np.abs(rne.Robot(at_once).mass_matrix(q) - rne.Robot(by_mimic).mass_matrix(q)).max() < 1e-14


def test_locked_joints():
    model, open_tree, _ = linkage("bar")
    robot, whole = robot_of(model), robot_of(open_tree)
    positions = joint_positions(model, np.array([0.3, 0.2]))
    fixed = robot.locked({"crank": 0.3})
    assert fixed.model.couplings == ()
    same = whole.locked(dict(zip(("crank", "coupler", "rocker"), positions, strict=False)))
    assert fixed.inverse_dynamics([0.2], [1.0], [2.0]) == pytest.approx(
        same.inverse_dynamics([0.2], [1.0], [2.0]), rel=1e-13
    )
    kept = robot.locked({"arm": 0.2})  # the coupling stays
    q, qd, u, _ = drawn(kept.model, 5)
    at = np.full((5, 1), 0.2)
    wanted = robot.inverse_dynamics(*(np.hstack(x) for x in ((q, at), (qd, 0 * at), (u, 0 * at))))[:, :1]
    assert np.abs(kept.inverse_dynamics(q, qd, u) - wanted).max() < 1e-12 * np.abs(wanted).max()
    wrist_model, *_ = linkage("wrist")
    half = rne.Robot(wrist_model).locked({"a": 0.5}).model  # of two drivers one is left: a mimic
    assert half.couplings == ()
    assert half.multiplier[list(half.moving_joints).index("turn")] == -0.5
    assert half.offset[list(half.moving_joints).index("turn")] == 0.25


def test_springs_on_joints_that_follow():
    """A spring between links of a loop, and one at a joint that follows: energies and torques agree, and are kept."""
    model, *_ = linkage("bar")
    robot = robot_of(model)
    springs = [rne.Spring("base", (0, 0, 1), "rocker", (0, 0.1, 0.4), stiffness=300.0, length=0.3)]
    springs += [rne.Spring.at_joint("coupler", stiffness=20.0, rest=0.5)]
    scene = rne.Scene(robot, springs=springs)
    motion = rne.simulate(scene, [0.3, 0.2], [0.0, 0.0], 1.0, rtol=1e-11, atol=1e-12)
    assert motion.energy_drift < 1e-9
    assert np.ptp(motion.kinetic) > 1


def test_stops_of_joints_that_follow():
    model, *_ = linkage("palletiser")
    motion = rne.simulate(rne.Scene(robot_of(model), stops=True), [0.5, -0.5], [4.0, -4.0], 2.0)
    assert "'rod' reached its stop at 3" in motion.message
    assert joint_positions(model, motion.q[-1])[list(model.moving_joints).index("rod")] == pytest.approx(3, abs=1e-9)


def test_violations_name_joints_that_follow():
    model, *_ = linkage("palletiser")
    limit = np.where(np.array(model.moving_joints) == "forearm", 2.0, np.inf)
    motion = rne.simulate(rne.Robot(replace(model, velocity_limit=limit)), [0.5, -0.5], [3.0, -3.0], 0.2)
    assert {v.joint for v in motion.check_limits() if v.quantity == "velocity"} == {"forearm"}


def test_urdf(tmp_path):
    model, open_tree, _ = linkage("bar")
    with pytest.raises(rne.ModelError) as error:
        rne.to_urdf(model)
    assert str(error.value) == (
        "a URDF can only say that a joint follows one other in a constant ratio and takes no couplings, but joint "
        "'coupler' of robot 'linkage' follows crank; rne.to_urdf(model, couplings=\"drop\") writes it as a joint that moves freely"
    )
    text = rne.to_urdf(model, couplings="drop")
    assert text.count("follows crank by a coupling") == 2
    (tmp_path / "open.urdf").write_text(text)
    assert rne.read_urdf(tmp_path / "open.urdf").joint_names == open_tree.joint_names


def test_laws_are_traced_where_the_loop_closes():
    robot = robot_of(linkage("engine")[0])
    assert rne.Scene(robot, controller=rne.control.pd_gravity(robot, 100.0, 10.0, -0.05)).cost()["law"] == "traced"


def test_zeros_cost_nothing():
    """Positions and slopes of couplings are checked to be finite, so that products of them with zeros are left out."""
    operations = {name: rne.compile(rne.dynamics.inverse_dynamics, linkage(name)[0]).operations for name in ROBOTS}
    counts = {"bar": 321, "press": 113, "engine": 125, "crane": 158, "palletiser": 133, "wrist": 277, "boom": 124}
    assert {name: sum(given.values()) for name, given in operations.items()} == counts


def test_what_kernels_check():
    """An engine may hold further numbers behind the outputs, which are no results."""

    class Counts:
        finite = staticmethod(len)

    for model, further in ((rne.irb140(), []), (linkage("press")[0], [3 + 2])):
        trace = rne.compile(rne.dynamics.inverse_dynamics, model).traced
        checked = trace.sound_results(range(1000), np.float64, Counts())
        assert checked == [
            model.n,
            *further,
        ]  # position and derivatives of the rod; no torque needs the slider's position


@pytest.mark.parametrize("name", ["bar", "wrist"])
def test_rates_of_jacobians_and_references(name):
    model, *_ = linkage(name)
    q, qd, qdr, qddr = drawn(model, 5)
    link = model.link_names[-1]
    rate = rne.dynamics.jacobian(model, q + 1j * STEP * qd, link, point=(0.1, 0.2, 0.3)).imag / STEP
    found = rne.dynamics.jacobian_rate(model, q, qd, link, point=(0.1, 0.2, 0.3))
    assert np.abs(found - rate).max() < 1e-12 * np.abs(rate).max()
    bare = rne.Robot(replace(model, armature=np.zeros(model.nb)))
    torques = bare.control_regressor(q, qd, qdr, qddr) @ bare.parameters - bare.gravity_torque(q)
    wanted = bare.mass_matrix(q) @ qddr[..., None] + bare.coriolis_matrix(q, qd) @ qdr[..., None]
    assert np.abs(torques - wanted[..., 0]).max() < 1e-12 * np.abs(torques).max()


@pytest.mark.parametrize("driver", ["joint_1", "joint_2", "joint_3"])
@pytest.mark.parametrize(("lengths", "end"), [((0.3, 0.8, 0.4), -0.1), ((0.3, 0.8, 0.3), 0.0)])
def test_any_joint_of_a_loop_drives_it(driver, lengths, end):
    """Three joints in series, closed at the base: a four-bar and a parallelogram."""
    right = np.pi / 2
    chain = rne.dh_chain(a=lengths, alpha=[0] * 3, d=[0] * 3, theta=[right, -right, -right])
    closing = ("tool0", (0, 0, 0)), ("base_link", (0.8, end, 0))
    model = four_bar(chain, driver, closing)
    assert model.joint_names == (driver,)
    assert bool(model.couplings) == (end != 0)
    assert loop_gap(robot_of(model), *closing)[0] < 1e-6


def test_a_slider_crank_must_close():
    """At the zero pose: not where the slider's axis points to the crank, the crank is longer or has another angle."""
    text = (
        r"^crank, rod and slider must close at the zero pose: the rod 'rod' is mounted {} m from where they put it; `an"
    )
    for name, joint, lengths, gap in (
        ("press", "slider", {"crank": 0.1}, "0.2"),
        ("press", "", {"crank": 0.2}, "0.1"),
        ("press", "", {"crank": 0.1, "angle": np.pi / 2}, "0.1"),
        ("engine", "slider", {"crank": 0.1, "angle": 0.7}, "1.14"),
    ):
        _, open_tree, _ = linkage(name)
        turned = replace(
            open_tree, axis=open_tree.axis * np.where(np.array(open_tree.moving_joints) == joint, -1, 1)[:, None]
        )
        driver, others = ("crank", ("rod", "slider")) if name == "press" else ("slider", ("rod", "crank"))
        with pytest.raises(rne.ModelError, match=text.format(gap)):
            coupled(turned, dict.fromkeys(others, slider_crank(driver, rod=0.5, **lengths)))


def test_a_long_slide_is_no_jump_of_a_crank_without_range():
    """Places as far apart as those of 1e6 rad may differ by a turn of the rod without a jump between them."""
    _, open_tree, _ = linkage("press")
    wide = replace(open_tree, lower=np.array([-np.inf, -np.inf, -1e6]), upper=np.array([np.inf, np.inf, 1e6]))
    for rod in (0.1 + 1e-7, 0.1 + 1e-5):
        places = replace(wide, translation=wide.translation + [[0, 0, 0], [0, 0, 0], [rod - 0.5, 0, 0]])
        value = slider_crank("crank", crank=0.1, rod=rod)
        assert coupled(places, {"rod": value, "slider": value}).lower[0] == -np.inf


def test_rods_axis_may_point_the_other_way():
    _, open_tree, (closing,) = linkage("press")
    turned = replace(
        open_tree, axis=open_tree.axis * np.where(np.array(open_tree.moving_joints) == "rod", -1, 1)[:, None]
    )
    value = slider_crank("crank", crank=0.1, rod=0.5)
    assert loop_gap(rne.Robot(coupled(turned, {"rod": value, "slider": value})), *closing)[0] < 1e-12


@pytest.mark.parametrize("name", kept(["bar", "engine"], ["engine"]))
def test_validation_by_energies(name):
    model, *_ = linkage(name)
    source, rows = validate(robot_of(model), samples=20)
    assert source == "energy and Lagrange identities (its URDF has no couplings)"
    assert all(row.worst <= row.bound for row in rows)


def a_cam():
    """A joint that follows another by a function in Python, with a case in it."""
    _, open_tree, _ = linkage("bar")
    return coupled(open_tree, {"rocker": (("crank",), lambda x: 0.2 * np.sin(x) + minimum(x, 0.0) * x)})


@pytest.mark.parametrize("name", kept([*ROBOTS, "cam"], ["bar", "cam"]))
def test_motions_are_saved_with_what_they_follow_by(name, tmp_path):
    """The model that is loaded is equal, couplings included, and so are its quantities between the samples."""
    model = a_cam() if name == "cam" else linkage(name)[0]
    q0 = drawn(model, 1)[0][0]
    motion = rne.simulate(robot_of(model), q0, 0 * q0, 0.01)
    back = rne.Trajectory.load(motion.save(tmp_path / "motion.npz"))
    assert back.model == model
    assert back.model.couplings == model.couplings
    assert back.model.loops == model.loops
    for found, expected in zip((*back(0.004), back.energy), (*motion(0.004), motion.energy), strict=True):
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(back.torques(0.004), motion.torques(0.004))


def test_programs_of_couplings_that_are_damaged_are_refused(tmp_path):
    motion = rne.simulate(robot_of(linkage("bar")[0]), [0, 0], [0, 0], 0.001)
    coupling = motion.model.couplings[0]
    for value, text in ((999, "is damaged"), ("x", "must be of type")):
        outputs = (Operand("result", value),)
        damaged = replace(coupling, program=replace(coupling.program, outputs=outputs))
        model = replace(motion.model, couplings=(damaged, *motion.model.couplings[1:]))
        file = replace(motion, model=model).save(tmp_path / "motion.npz")
        with pytest.raises(ValueError, match=f"^{re.escape(repr(str(file)))}: .*{text}"):
            rne.Trajectory.load(file)


def test_check_measures_loops(tmp_path, capsys):
    links = part("upper", 0, (0, 0, 0)), part("rod", 1, (0, 0, 0.6)), part("lever", 0, (0.3, 0, 0))
    closing = (("rod", (0.3, 0, 0)), ("lever", (0, 0, 0.6)))
    closed = four_bar(tree(*links), "upper", closing)
    (tmp_path / "arm.urdf").write_text(rne.to_urdf(closed))
    points = "rod,0.3,0,0", "lever,0,0,0.6"
    assert main(["check", str(tmp_path / "arm.urdf"), "--loops", *points]) == 0
    gap = float(re.search("come (.*) m apart", capsys.readouterr().out)[1])
    assert gap < 1e-14
    apart, q = loop_gap(robot := rne.Robot(tree(*links)), *closing)
    ends = [robot.link_poses(q)[robot.model.link_index(link)] @ [*point, 1] for link, point in closing]
    assert apart == pytest.approx(np.linalg.norm(ends[0] - ends[1]), rel=1e-12)
    assert apart > 0.5  # open, it moves apart
    assert main(["check", str(tmp_path / "arm.urdf"), "--loops", "rod,0,0", "lever,0,0,0"]) == 2
    assert capsys.readouterr().err == "error: --loops: `ends[0][1]` must have shape (3,), got (2,)\n"


def test_complex_steps_of_arctan2():
    y, x = np.random.default_rng(0).normal(size=(2, 100))
    wanted = x / (x * x + y * y), -y / (x * x + y * y)
    for found, slope in zip((arctan2(y + 1j * STEP, x), arctan2(y, x + 1j * STEP)), wanted, strict=True):
        assert np.abs(found.real - np.arctan2(y, x)).max() < 4 * EPS
        assert np.abs(found.imag / STEP - slope).max() < 1e-14 * np.abs(slope).max()


SINE = np.sin
ERRORS = {
    "fields that do not fit": (
        lambda m: replace(linkage("bar")[0], moving_joints=("crank", "x", "rocker", "arm")),
        rne.ModelError,
        "joint 'x': no link of body 1 is carried by it",
    ),
    "couplings alone": (
        lambda m: replace(m, couplings=linkage("bar")[0].couplings),
        rne.ModelError,
        "`couplings` must lead from independent joints to others, got ['crank'] to 'coupler'",
    ),
    "no mapping": (
        lambda m: coupled(m, [1]),
        TypeError,
        "`couplings` must map joints to (drivers, function), got list",
    ),
    "unknown joint": (
        lambda m: coupled(m, {"x": (("crank",), SINE)}),
        ValueError,
        "`couplings` must name joints of ['crank', 'coupler', 'rocker', 'arm'], got 'x'",
    ),
    "no function": (
        lambda m: coupled(m, {"arm": (("crank",), 2.0)}),
        TypeError,
        "`couplings['arm']` must be (drivers, function), got (('crank',), 2.0)",
    ),
    "unknown driver": (
        lambda m: coupled(m, {"arm": (("x",), SINE)}),
        ValueError,
        "the drivers of joint 'arm' must be of ['crank', 'coupler', 'rocker', 'arm'], got ['x']",
    ),
    "circle": (
        lambda m: coupled(m, {"arm": (("crank",), SINE), "crank": (("arm",), SINE)}),
        ValueError,
        "`couplings` must not follow each other in a circle, got ['crank', 'arm', 'crank']",
    ),
    "itself": (
        lambda m: coupled(m, {"arm": (("arm",), SINE)}),
        ValueError,
        "`couplings` must not follow each other in a circle, got ['arm', 'arm']",
    ),
    "constant": (
        lambda m: coupled(m, {"arm": (("crank",), lambda x: 1.0)}),
        ValueError,
        "the function of joint 'arm' must depend on its drivers, got a constant",
    ),
    "vector": (
        lambda m: coupled(m, {"arm": (("crank",), lambda x: [x, x])}),
        ValueError,
        "the function of joint 'arm' must return one number, got shape (2,)",
    ),
    "branch": (
        lambda m: coupled(m, {"arm": (("crank",), lambda x: x if x > 0 else -x)}),
        TypeError,
        "a traced number has no value: a branch, float() or array conversion would freeze one outcome; rne.elementwise "
        "has where, less, minimum, maximum, clip and sign for this",
    ),
    "nowhere": (
        lambda m: coupled(m, {"arm": (("crank",), lambda x: 4 + x * x)}),
        rne.ModelError,
        "the joints that follow 'crank' have no positions within their ranges, wherever it is",
    ),
    "jump": (
        lambda m: coupled(
            replace(m, lower=np.array([-3.0, -3, -3, -9]), upper=np.array([3.0, 3, 3, 9])),
            {"arm": (("crank",), lambda x: arctan2(np.sin(x + 2), np.cos(x + 2)))},
        ),
        rne.ModelError,
        "the position of joint 'arm' jumps by a turn where 'crank' is 1.142; give it a function without the jump, or the "
        "driver a range that ends before",
    ),
    "rod on the crank of a slider that drives": (
        lambda m: coupled(
            linkage("press")[1], dict.fromkeys(("rod", "crank"), slider_crank("slider", crank=0.1, rod=0.5, angle=0.7))
        ),
        rne.ModelError,
        "the rod 'rod' must be mounted on the slider 'slider' that drives",
    ),
    "gap": (
        lambda m: four_bar(m, "crank", (("coupler", (0.8, 0, 0.25)), ("rocker", (0, 0.1, 0.601)))),
        rne.ModelError,
        "the loop must close at the zero pose, got a gap of 0.001 m at the points of `closing`",
    ),
    "other joints": (
        lambda m: four_bar(m, "crank", (("coupler", (0.8, 0, 0.25)), ("crank", (0, 0, 0)))),
        rne.ModelError,
        "the loop must have 3 or 4 joints, 'crank' and others that follow none, all rotating; it has ['coupler']",
    ),
    "not plane": (
        lambda m: four_bar(m, "crank", (("coupler", (0.8, 0, 0.25)), ("arm", (0, 0.1, -0.05)))),
        rne.ModelError,
        "the axis of joint 'arm' must be parallel to those about which the loop turns",
    ),
    "no driver": (
        lambda m: four_bar(m, "x", (("coupler", (0.8, 0, 0.25)), ("rocker", (0, 0.1, 0.6)))),
        ValueError,
        "`driver` must be one of ['crank', 'coupler', 'rocker', 'arm'], got 'x'",
    ),
    "one end": (
        lambda m: four_bar(m, "crank", (("coupler", (0.8, 0, 0.25)),)),
        TypeError,
        "`closing` must be ((link, point), (link, point)), got (('coupler', (0.8, 0, 0.25)),)",
    ),
    "unknown link": (
        lambda m: four_bar(m, "crank", (("x", (0.8, 0, 0.25)), ("rocker", (0, 0.1, 0.6)))),
        ValueError,
        "`link` must be one of ['base', 'crank', 'coupler', 'rocker', 'arm'], got 'x'",
    ),
    "closed already": (
        lambda m: four_bar(linkage("bar")[0], "crank", linkage("bar")[2][0]),
        rne.ModelError,
        "the loop must have 3 or 4 joints, 'crank' and others that follow none, all rotating; it has ['crank', 'coupler', "
        "'rocker']",
    ),
    "no slide": (
        lambda m: cylinder(m, "crank", linkage("bar")[2][0]),
        rne.ModelError,
        "the loop must have 3 joints, 'crank' and others that follow none, one of them the slide of the cylinder; it has "
        "['crank', 'coupler', 'rocker']",
    ),
    "rod too short": (
        lambda m: slider_crank("crank", crank=0.5, rod=0.1, angle=1.0),
        ValueError,
        "`rod` must reach the slider's line at `angle`, got 0.1",
    ),
    "not a slider-crank": (
        lambda m: coupled(m, {"arm": slider_crank("crank", crank=0.1, rod=0.5)}),
        rne.ModelError,
        "the axes of joints 'arm' and 'crank' are not those of a slider-crank",
    ),
    "a loop of five that is no parallelogram": (
        lambda m: four_bar(
            tree(
                part("crank", 0, (0, 0, 0)),
                part("coupler", 1, (0, 0, 0.35)),
                part("rocker", 0, (0.8, 0, 0)),
                part("tip", 3, (0, 0, 0.4)),
            ),
            "crank",
            (("coupler", (0.8, 0, 0.25)), ("tip", (0, 0, 0.2))),
        ),
        rne.ModelError,
        "a loop with ['crank', 'rocker'] must be a parallelogram, these on one axis",
    ),
    "a cylinder beside its pivots": (
        lambda m: cylinder(
            tree(
                part("boom", 0, (0, 0, 0)),
                part("barrel", 0, (0.5, 0, 0)),
                part("rod", 2, (0, 0, 0.3), (0, 0, 1), kind="prismatic"),
            ),
            "rod",
            (("rod", (0.1, 0, 0)), ("boom", (0.6, 0, 0.3))),
        ),
        rne.ModelError,
        "the axis of joint 'rod' must be parallel to the line between the cylinder's pivots",
    ),
    "a crank that is no joint": (
        lambda m: coupled(m, {"arm": slider_crank("x", crank=0.1, rod=0.5)}),
        ValueError,
        "`driver` must be one of ['crank', 'coupler', 'rocker', 'arm'], got 'x'",
    ),
    "a joint that can hardly follow two": (
        lambda m: rne.dynamics.base_parameters(
            coupled(
                tree(part("a", 0, (0, 0, 0)), part("b", 1, (0, 0, 1)), part("c", 2, (0, 0, 1))),
                {"c": (("a", "b"), lambda x, y: np.sqrt(1e-6 - x * x * y * y))},
            )
        ),
        rne.ModelError,
        "joint 'c' of robot 'linkage' hardly ever can follow a, b in their ranges",
    ),
    "a constant map": (
        lambda m: linkage("bar")[0].coordinate_map,
        rne.ModelError,
        "joint 'coupler' of robot 'linkage' follows others by no constant",
    ),
    "dead point": (
        lambda m: coupled(linkage("engine")[1], {"crank": slider_crank("slider", crank=0.1, rod=0.5)}),
        rne.ModelError,
        "the zero pose is a dead point of the linkage that 'slider' drives; move a joint's zero",
    ),
    "infinite": (
        lambda m: coupled(m, {"arm": (("crank",), lambda x: x * x + np.inf)}),
        rne.ModelError,
        "the joints that follow 'crank' have no positions within their ranges, wherever it is",
    ),
    "no length": (
        lambda m: four_bar(
            tree(part("crank", 0, (0, 0, 0)), part("coupler", 1, (0, 0, 0.3)), part("rocker", 0, (0, 0, 0))),
            "crank",
            (("coupler", (0, 0, 0)), ("rocker", (0, 0, 0.3))),
        ),
        rne.ModelError,
        "two pivots of the loop of joint 'crank' are at one place: a link has no length",
    ),
    "no length of a cylinder": (
        lambda m: cylinder(
            tree(
                part("boom", 0, (0, 0, 0)),
                part("barrel", 0, (0, 0, 0.3)),
                part("rod", 2, (0, 0, 0), (0, 0, -1), kind="prismatic"),
            ),
            "boom",
            (("rod", (0, 0, -0.3)), ("boom", (0, 0, 0))),
        ),
        rne.ModelError,
        "two pivots of the loop of joint 'boom' are at one place: a link has no length",
    ),
    "a path that a driver cannot take": (
        lambda m: rne.trajectories.fastest(
            robot_of(coupled(m, {"coupler": (("crank",), lambda x: np.sqrt(1 - x))})).with_limits(acceleration=1.0),
            [[0, 0, 0], [2, 0, 0]],
        ),
        ValueError,
        "`path` leaves the range of joint 'crank', -3 to 1: 2 at via point 1",
    ),
    "bounds": (
        lambda m: robot_of(linkage("bar")[0]).bounds(),
        rne.ModelError,
        "bounds take no couplings, but joint 'coupler' of robot 'linkage' follows crank",
    ),
    "damping of a joint that follows": (
        lambda m: rne.Scene(rne.Robot(replace(linkage("bar")[0], damping=np.ones(4))), friction="urdf").resolved,
        rne.ModelError,
        "`friction` 'urdf' takes no couplings, but joint 'coupler' of robot 'linkage' follows crank",
    ),
    "articulated bodies": (
        lambda m: rne.dynamics.articulated_forward_dynamics(linkage("bar")[0], [0, 0], [0, 0], [0, 0]),
        rne.ModelError,
        "robot 'linkage' has joints that mimic or follow others; use forward_dynamics, which reduces M to q",
    ),
    "locked": (
        lambda m: robot_of(linkage("bar")[0]).locked({"rocker": 0.0}),
        ValueError,
        "`positions` must name joints of ['crank', 'arm'], got 'rocker'",
    ),
}


@pytest.mark.parametrize("case", ERRORS)
def test_errors(case):
    call, kind, text = ERRORS[case]
    with pytest.raises(kind) as error:
        call(linkage("bar")[1])
    assert str(error.value) == text
    public = (c for c in type(error.value).__mro__ if c.__module__ in ("builtins", "rne.errors"))
    assert next(public) is kind
