"""Results are read-only and what is given is copied: nothing is computed later of numbers that a user changed."""

import copy
import pickle
from collections.abc import Mapping
from dataclasses import is_dataclass, replace
from types import MappingProxyType

import numpy as np
import pytest

import rne

from .random_robots import straight_chain

CHAIN = rne.Robot(straight_chain(2))
PENDULUM = rne.Robot(straight_chain(1))
FRICTION = rne.Friction(viscous=[0.1, 0.2], coulomb=0.1)
LAW = rne.control.pid(PENDULUM, 20, 1, 5, 0.3)
SCENE = rne.Scene(PENDULUM, controller=LAW, effort_limit=50.0)
REST, HANGING = np.zeros(2), np.zeros(1)


def motion():
    return rne.simulate(SCENE, HANGING, HANGING, 0.05)


def logged():
    t = np.linspace(0, 4, 401)
    return rne.identification.Record(t, 0.5 * np.sin(2 * t)[:, None], np.cos(2 * t)[:, None])


def observed():
    zeros = np.zeros((11, 1))
    return rne.control.MomentumObserver(PENDULUM, 10.0).observe(np.linspace(0, 0.1, 11), zeros, zeros, zeros)


RESULTS = {
    "motion": motion,
    "drives": lambda: rne.drives(SCENE, motion()),
    "ensemble": lambda: rne.ensemble(SCENE, [HANGING], [HANGING], 0.01),
    "recursion": lambda: CHAIN.recursion(REST, REST, REST),
    "loop": lambda: SCENE.check_gains([0.3]),
    "gains": lambda: rne.check_gains(PENDULUM, 20, 5, q=HANGING),
    "diagnosis": lambda: CHAIN.diagnose(REST),
    "base parameters": lambda: CHAIN.base_parameters(),
    "record": logged,
    "residuals": observed,
    "friction": lambda: FRICTION,
    "spline": lambda: rne.trajectories.spline([0.0, 1.0, 2.0], np.eye(3)),
    "path": lambda: rne.trajectories.quintic(REST, REST + 1, 1.0),
    "robot": lambda: CHAIN,
    "scene": lambda: rne.Scene(CHAIN, friction=FRICTION, effort_limit=[50.0, 40.0]),
}


def arrays_of(owner, seen=None):
    """Arrays that an object of this package holds in public attributes, and those of objects that these hold."""
    seen = {} if seen is None else seen
    if id(owner) in seen:
        return
    seen[id(owner)] = owner
    if isinstance(owner, np.ndarray):
        yield owner
    elif isinstance(owner, Mapping):
        for part in owner.values():
            yield from arrays_of(part, seen)
    elif type(owner) in (tuple, list):
        for part in owner:
            yield from arrays_of(part, seen)
    elif type(owner).__module__.startswith("rne.") and (is_dataclass(owner) or type(owner).__name__ == "Record"):
        names = [name for name in {*vars(owner), *vars(type(owner))} if not name.startswith("_")]
        found = [getattr(owner, name, None) for name in names]  # what properties keep is there then
        kept = {id(part) for part in vars(owner).values()}
        for part in found:
            if id(part) in kept:
                yield from arrays_of(part, seen)


@pytest.mark.parametrize("name", RESULTS)
def test_arrays_of_results_are_read_only(name):
    result = RESULTS[name]()
    for found in (result, copy.deepcopy(result), pickle.loads(pickle.dumps(result))):
        assert not [array for array in arrays_of(found) if array.flags.writeable]


def test_torques_do_not_follow_positions_that_a_user_converts():
    one, other = motion(), motion()
    expected = one.tau.copy()
    with pytest.raises(ValueError, match="read-only"):
        other.q[...] *= 180 / np.pi
    assert np.array_equal(other.tau, expected)
    mine = one.q * 180 / np.pi
    mine[...] = 0  # a copy is the user's own


class Estimate:
    """What has found a payload, and finds another one later."""

    def __init__(self, com):
        self.com = com

    @property
    def payload(self):
        return rne.Payload(2.0, self.com, None, "rod1")


def given(kind):
    """Arguments of a scene, and what changes the caller's own objects in them."""
    array, numbers, table = np.array([0.3, 0.1, 0.2]), [0.5, 0.4], {"joint0": 0.5}
    changes = {
        "array": lambda: array.__imul__(4),
        "list": lambda: numbers.__setitem__(0, 3.0),
        "mapping": lambda: table.update(joint0=2.0),
    }
    spring = rne.Spring.at_joint("joint1", 30.0, 0.5)
    springs = [spring]
    cases = {
        "payload's centre": ({"payload": rne.Payload(2.0, array)}, "array"),
        "payload's list": ({"payload": (2.0, [numbers[0], 0, 0], np.diag(array))}, "array"),
        "estimated payload": ({"payload": Estimate(array)}, "array"),
        "mounting": ({"mounting": array}, "array"),
        "view of gravity": ({"gravity": np.broadcast_to(array, (3,))}, "array"),
        "list of rotors": ({"armature": numbers}, "list"),
        "rotors by name": ({"armature": table}, "mapping"),
        "view of rotors": ({"armature": MappingProxyType(table)}, "mapping"),
        "locked": ({"locked": table}, "mapping"),
        "effort": ({"effort_limit": numbers, "controller": lambda t, q, qd: np.full(2, 9.0)}, "list"),
        "stiffness": ({"elastic": rne.ElasticJoints([100.0, 200.0], rotor=numbers)}, "list"),
        "springs": ({"springs": springs}, None),
    }
    options, which = cases[kind]
    return options, changes.get(which, springs.clear)


KINDS = (
    "payload's centre", "payload's list", "estimated payload", "mounting", "view of gravity", "list of rotors",
    "rotors by name", "view of rotors", "locked", "effort", "stiffness", "springs",
)  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_a_scene_keeps_what_it_was_given(kind):
    """Also where another one is made of it."""
    options, change = given(kind)
    scene = rne.Scene(CHAIN, **options)

    def numbers():
        for one in (scene, replace(scene, stops=True), pickle.loads(pickle.dumps(replace(scene, controller=None)))):
            parts = one.resolved
            yield parts.robot.model
            yield parts.motor_side, parts.springs, None if parts.effort_limit is None else parts.effort_limit.tolist()

    before = list(numbers())
    change()
    assert list(numbers()) == before


def test_a_kernel_keeps_the_links_it_was_given():
    links = ["rod1"]
    kernel = rne.compile(rne.dynamics.inverse_dynamics, CHAIN.model, external=links)
    links.append("rod0")
    assert pickle.loads(pickle.dumps(kernel)).names == kernel.names
