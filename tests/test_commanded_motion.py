"""Motions under recorded commands: positions against rne.simulate, derivatives against differences, on both engines."""

from dataclasses import replace

import numpy as np
import pytest

import rne
from rne.simulation.commanded import CommandedMotion
from rne.trajectories import sampled

from .helpers import kept
from .random_robots import straight_chain

DIFFERENCE, SLOPES = 1e-5, 2e-8  # central differences of positions at the same steps: (1e-5)^2, and rounding over 1e-5
DELAYS = 1e-3  # with a delay lengths of steps change, which derivatives take as constants: the method's error
ENGINES = 1e-11  # of sums in another order, over some hundred steps
NONE = 0.0, np.ones(1), np.zeros(1)
COMMAND = 0.013, np.array([1.1]), np.array([-0.05])  # a delay that no step meets, a scale and an offset
T = np.arange(8) * 0.04
SENT = 0.1 + 0.6 * np.sin(9 * T)[:, None]
TIMES = np.arange(7) * 0.02
START = np.array([[0.2], [0.5]])


@pytest.fixture(scope="module")
def rod():
    return rne.Robot(straight_chain(1)).with_armature(0.05)


def scene_of(robot, law="pd", kind="hold", **how):
    """One joint with friction, whose law follows SENT."""
    reference = sampled(T, SENT, kind)
    if law == "servo":
        limits = {"dead_band": 0.02, "stall_torque": 6.0, "no_load_speed": 9.0}
        controller = rne.control.servo(robot, 40, 0.5, reference, **limits)
    else:
        controller = getattr(rne.control, law)(robot, 40, 2, reference)
    friction = rne.Friction(viscous=0.2, coulomb=0.1, smoothing=0.2)
    return rne.Scene(robot, controller=controller, **{"friction": friction} | how)


def motion_of(scene, taken=(), step=0.005, begin=0.0, times=TIMES):
    """The motion, differentiated in all entries of some names."""
    sizes = {name: np.size(scene.numbers[name]) for name in taken if name not in CommandedMotion.NAMES}
    sizes |= {name: 1 for name in taken if name in CommandedMotion.NAMES}
    return CommandedMotion.of(
        scene, tuple(sizes.keys() - {*CommandedMotion.NAMES}), begin, times, directions(sizes), step
    )


def directions(sizes):
    return {name: np.eye(size) for name, size in sizes.items()}


def as_simulated(scene, kind, command, begin=0.0, times=TIMES):
    """Positions by rne.simulate, of a law that follows what becomes of the commands, the first of which holds before."""
    delay, scale, offset = command
    sent = np.concatenate([SENT[:1], SENT, SENT[-1:]]) * scale + offset
    t = np.concatenate([[min(0.0, T[0] - begin + delay) - 1e-3], T - begin + delay, [10.0]])
    law = replace(scene.controller, reference=sampled(t, sent, kind))
    options = {"t_eval": times, "rtol": 1e-11, "atol": 1e-13}
    return rne.simulate(replace(scene, controller=law), *START, times[-1], **options).q


@pytest.mark.parametrize("kind", ["hold", "linear"])
@pytest.mark.parametrize("begin", kept([0.0, 0.05], [0.05]))
def test_positions_are_those_that_are_simulated_and_converge_with_order_four(rod, kind, begin):
    """Of commands that come late, scaled and with an offset, seen from a time among them, and beyond the last one."""
    scene, times = scene_of(rod, kind=kind, friction=rne.Friction(viscous=0.2)), np.arange(13) * 0.025
    expected, errors = as_simulated(scene, kind, COMMAND, begin, times), []
    for step in (0.0125, 0.00625):
        motion = motion_of(scene, step=step, begin=begin, times=times)
        errors.append(np.abs(motion.positions(motion.vectors({}), COMMAND, START) - expected).max())
    assert errors[1] < 1e-6
    assert errors[0] / errors[1] > 12  # 16 of order 4


def test_positions_under_other_numbers_are_those_of_a_scene_that_has_them(rod):
    scene, numbers = scene_of(rod), {"controller.kp": np.array([30.0]), "friction.viscous": np.array([0.4])}
    motion, other = motion_of(scene, numbers), motion_of(scene.with_numbers(numbers))
    found = motion.positions(motion.vectors(numbers), COMMAND, START)
    np.testing.assert_allclose(found, other.positions(other.vectors({}), COMMAND, START), atol=1e-14)  # by rounding


def test_a_motion_that_overflows_has_no_positions(rod):
    scene = scene_of(rod)
    motion = motion_of(scene, ["controller.kd"])
    assert motion.positions(motion.vectors({"controller.kd": np.array([-1e6])}), NONE, START) is None


SPRING = rne.Spring("rod0", [0, 0, -0.2], "root", [0.3, 0, -0.3], stiffness=40.0, length=0.2, damping=2.0)
SAMPLED = {"sample_time": 0.01, "effort_limit": 8.0}
CASES = {
    "pd": {},
    "linear": {"kind": "linear"},
    "servo": {"law": "servo"},
    "servo, linear": {"law": "servo", "kind": "linear"},
    "pd_gravity": {"law": "pd_gravity"},
    "limited": {"effort_limit": 4.0},
    "elastic": {"elastic": rne.ElasticJoints(300.0, 0.5), "kind": "linear"},
    "springs": {"springs": [SPRING]},
    "sampled": SAMPLED,
    "sampled, late": SAMPLED | {"delay": 0.013, "torque_rate": 300.0, "kind": "linear"},
    "sampled servo": {"law": "servo", "sample_time": 0.01, "delay": 0.004},
}


def fitted_names(scene):
    """All numbers by which a motion can be fitted."""
    left_out = "reference", "gravity", "smoothing"
    found = [name for name in scene.numbers if name.rpartition(".")[2] not in left_out]
    commands = CommandedMotion.NAMES if scene.sample_time is None else CommandedMotion.NAMES[1:]
    return [name for name in found if np.any(scene.numbers[name])] + list(commands)


def values_of(scene, names):
    command = dict(zip(CommandedMotion.NAMES, (np.array([COMMAND[0]]), *COMMAND[1:]), strict=True))
    known = dict(scene.numbers) | command | {"q0": START[0], "qd0": START[1]}
    return {name: np.asarray(known[name], float) for name in (*names, "q0", "qd0")}


def test_bodies_are_differentiated_in_directions_that_are_given():
    """And nothing else: a direction of all ten parameters of both links and one of the first gain."""
    robot = rne.Robot(straight_chain(2)).with_armature(0.05)
    law = rne.control.pd(robot, [40, 20], [2, 1], sampled(T, np.hstack([SENT, -SENT]), "hold"))
    scene, size = rne.Scene(robot, controller=law), np.random.default_rng(0).normal(size=(20, 1)) * 0.01
    taken = {"controller.kp": np.eye(2)[:, :1], "parameters": size}
    motion = CommandedMotion.of(scene, tuple(taken), 0.0, TIMES, taken, 0.01)
    start, none = np.array([[0.2, -0.1], [0.5, 0.3]]), (0.0, np.ones(2), np.zeros(2))
    q, J = motion.derivatives(motion.vectors({}), none, start)
    assert J.shape == (len(TIMES), 2, 2 + 4)
    for k, (name, direction) in enumerate(taken.items()):
        given, h = scene.numbers[name], DIFFERENCE * direction[:, 0]
        high, low = (motion.positions(motion.vectors({name: given + x}), none, start) for x in (h, -h))
        expected = (high - low) / (2 * DIFFERENCE)
        np.testing.assert_allclose(J[..., k], expected, atol=SLOPES * np.abs(expected).max())
    np.testing.assert_array_equal(q, motion.positions(motion.vectors({}), none, start))


def positions_at(motion, values):
    """Positions under numbers, commands and a start by name."""
    own = {name: x for name, x in values.items() if name in motion.frozen.names}
    given = dict(zip(CommandedMotion.NAMES, COMMAND, strict=True)) | values
    delay, scale, offset = (given[name] for name in CommandedMotion.NAMES)
    start = np.array([values["q0"], values["qd0"]])
    return motion.positions(motion.vectors(own), (float(np.ravel(delay)[0]), scale, offset), start)


def slopes_by_name(motion, values):
    """Derivatives of positions, (T, k), by each name."""
    own = {name: x for name, x in values.items() if name in motion.frozen.names}
    _, J = motion.derivatives(motion.vectors(own), COMMAND, np.array([values["q0"], values["qd0"]]))
    ends = np.cumsum([values[name].size for name in (*motion.taken, "q0", "qd0")])
    return dict(zip((*motion.taken, "q0", "qd0"), np.split(J[:, 0], ends[:-1], axis=1), strict=True))


def moved(values, name, direction, size):
    change = size * direction.reshape(values[name].shape)
    return values | {name: values[name] + change}


@pytest.mark.parametrize("case", kept(CASES, ["servo, linear", "sampled, late"]))
def test_derivatives_are_those_of_differences(rod, case):
    """By all entries of each name at once, in a random direction in proportion to their size."""
    scene, rng = scene_of(rod, **CASES[case]), np.random.default_rng(3)
    names = fitted_names(scene)
    motion, values = motion_of(scene, names), values_of(scene, names)
    for name, slopes in slopes_by_name(motion, values).items():
        size = values[name].reshape(-1) * rng.uniform(0.5, 1.5, values[name].size)
        high, low = (positions_at(motion, moved(values, name, size, h)) for h in (DIFFERENCE, -DIFFERENCE))
        expected = ((high - low) / (2 * DIFFERENCE))[:, 0]
        scale = max(np.abs(expected).max(), 1e-3)
        assert np.abs(slopes @ size - expected).max() < scale * (DELAYS if "delay" in name else SLOPES), name
        assert np.abs(expected).max() > 1e-7, name  # so that there is something to compare


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_machine_code_gives_what_numpy_gives(rod, case):
    scene = scene_of(rod, **CASES[case])
    names, found = fitted_names(scene), []
    for engine in ("numpy", "numba"):
        robot = rne.Robot(rod.model, engine=engine)
        motion = motion_of(replace(scene, robot=robot, controller=replace(scene.controller, robot=robot)), names)
        values = values_of(scene, names)
        found.append((positions_at(motion, values), slopes_by_name(motion, values)))
    (q, slopes), (by_machine, its_slopes) = found
    np.testing.assert_allclose(by_machine, q, atol=ENGINES)
    for name, expected in slopes.items():
        np.testing.assert_allclose(its_slopes[name], expected, atol=ENGINES * max(1.0, np.abs(expected).max()))
