"""Joints that follow others: against multipliers on the open tree, against laws, and through everything that has q."""

from functools import cache

import numpy as np
import pytest

import rne
from rne.dynamics.kinematics import coordinate_map, coordinate_map_rate, joint_positions, joint_velocities

from .helpers import Part, assemble, kept, pose

Y = (0.0, 1.0, 0.0)
INERTIA = np.array([[0.02, 0.003, 0.001], [0.003, 0.03, 0.002], [0.001, 0.002, 0.04]])
MULTIPLIERS = 1e-11  # relative, times the condition of M


def part(name, parent, at, axis=Y, **given):
    """A body of 2 kg that is not symmetric, on a joint of its name with a rotor."""
    given = {"kind": "revolute", "lower": -3.0, "upper": 3.0, "armature": 0.1} | given
    body = {"mass": 2.0, "com": np.array([0.1, 0.03, 0.05]), "inertia": 2 * INERTIA}
    axis = np.array(axis) / np.linalg.norm(axis)
    return Part(
        link=name, joint=name, parent=parent, placement=pose(np.eye(3), np.array(at)), axis=axis, **body, **given
    )


def tree(*parts):
    return assemble("linkage", [Part(link="base"), *parts])


def four_bar():
    """Crank, coupler and rocker of 0.35, 0.838 and 0.6 m on a base of 0.8 m, and an arm on the rocker."""
    arm = part("arm", 3, (0, 0, 0.65), (0.6, 0, 0.8))
    open_tree = tree(
        part("crank", 0, (0, 0, 0)), part("coupler", 1, (0, 0.1, 0.35)), part("rocker", 0, (0.8, 0, 0)), arm
    )
    closing = (("coupler", (0.8, 0, 0.25)), ("rocker", (0, 0.1, 0.6)))
    return rne.model.four_bar(open_tree, "crank", closing), open_tree, [closing]


def press():
    """A crank of 0.1 m that drives a slider by a rod of 0.5 m, which is mounted on it."""
    slider = part("slider", 0, (0.6, 0, 0), (1, 0, 0), kind="prismatic")
    open_tree = tree(part("crank", 0, (0, 0, 0)), part("rod", 1, (0.1, 0.05, 0)), slider)
    value = rne.model.slider_crank("crank", crank=0.1, rod=0.5)
    closing = (("rod", (0.5, 0, 0)), ("slider", (0, 0.05, 0)))
    return rne.model.coupled(open_tree, {"rod": value, "slider": value}), open_tree, [closing]


def engine():
    """A slider that drives the same crank by a rod that is mounted on the slider, the crank at an angle of 0.7."""
    pin = 0.1 * np.array([np.cos(0.7), 0, -np.sin(0.7)])
    x = pin[0] + np.sqrt(0.25 - pin[2] ** 2)
    slider = part("slider", 0, (x, 0, 0), (1, 0, 0), kind="prismatic")
    open_tree = tree(slider, part("rod", 1, (0, 0, 0)), part("crank", 0, (0, 0, 0)))
    value = rne.model.slider_crank("slider", crank=0.1, rod=0.5, angle=0.7)
    closing = (("rod", tuple(pin - [x, 0, 0])), ("crank", tuple(pin)))
    return rne.model.coupled(open_tree, {"rod": value, "crank": value}), open_tree, [closing]


def crane(driver="piston"):
    """A boom that a hydraulic cylinder turns."""
    piston = part("piston", 2, (0.3, 0, 0.35), (0.6, 0, 0.7), kind="prismatic")
    open_tree = tree(part("boom", 0, (0, 0, 0)), part("barrel", 0, (0.2, 0, -0.6)), piston)
    closing = (("piston", (0.3, 0, 0.35)), ("boom", (0.8, 0, 0.1)))
    return rne.model.cylinder(open_tree, driver, closing), open_tree, [closing]


def palletiser():
    """Shoulder and elbow drive on one axis, the elbow driven through a parallelogram, the tool kept level."""
    links = part("upper", 0, (0, 0, 0)), part("forearm", 1, (0, 0, 0.6)), part("lever", 0, (0, 0.1, 0))
    open_tree = tree(*links, part("rod", 3, (-0.2, 0, 0)), part("tool", 2, (0.7, 0, 0)))
    closing = (("rod", (0, 0, 0.6)), ("forearm", (-0.2, 0.1, 0)))
    closed = rne.model.four_bar(open_tree, "upper", closing)
    return (
        rne.model.coupled(closed, {"tool": (("lever",), lambda x: -x)}),
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
    return rne.model.coupled(open_tree, both), open_tree, rows


ROBOTS = {f.__name__: f for f in (four_bar, press, engine, crane, palletiser, wrist)}
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
    """Accelerations of M qdd + h = S u + A^T l with A qdd + dA/dt qd = 0 on the open tree."""
    A, dA = constraints(robot, conditions, q, qd)
    M, h = robot.mass_matrix(q), robot.bias_torque(q, qd)
    K = np.block([[M, -A.T], [A, np.zeros((len(A), len(A)))]])
    return np.linalg.solve(K, np.concatenate([S @ u - h, -dA @ qd]))[: robot.n]


@pytest.mark.parametrize("samples", kept([50, 1000], [50]))
@pytest.mark.parametrize("name", ROBOTS)
def test_motion_is_that_of_multipliers_on_the_open_tree(name, samples):
    model, open_tree, conditions = linkage(name)
    robot, whole = rne.Robot(model), rne.Robot(open_tree)
    q, qd, u, _ = drawn(model, samples)
    u = 20 * u
    S = np.array([[float(j == k) for k in model.joint_names] for j in whole.joint_names])
    positions, velocities = joint_positions(model, q), joint_velocities(model, q, qd)
    G, dG, qdd = coordinate_map(model, q), coordinate_map_rate(model, q, qd), robot.forward_dynamics(q, qd, u)
    assert np.abs(robot.inverse_dynamics(q, qd, qdd) - u).max() < MULTIPLIERS * np.abs(u).max()
    for k in range(samples):
        wanted = by_multipliers(whole, conditions, S, positions[k], velocities[k], u[k])
        bound = MULTIPLIERS * np.linalg.cond(robot.mass_matrix(q[k])) * np.abs(wanted).max()
        for own in (qdd[k], rne.dynamics.forward_dynamics(model, q[k], qd[k], u[k])) if k < 10 else (qdd[k],):
            found = G[k] @ own + dG[k] @ qd[k]
            print(name, np.abs(found - wanted).max() / np.abs(wanted).max()) if k < 3 else 0
            assert np.abs(found - wanted).max() < bound
