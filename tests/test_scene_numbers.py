"""A scene's numbers are inputs of its kernels: other ones give what a scene built anew gives, and no other program."""

import copy
import pickle
import re
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

import rne
from rne.graph.program import Instruction, Operand, Program, evaluate
from rne.kernels import kernel as kernels
from rne.kernels import trace as tracing
from rne.kernels.soundness import Trace

from .helpers import kept, relative
from .random_robots import random_tree, straight_chain

TIMES = np.array([0.0, 0.01, 0.02])
# Sums of other order: the two programs of bodies, and numbers that are 0 and inputs. Times few steps of conditions <1e3.
OTHER_PROGRAM = 1e-9
ADAPTED = 1e-6  # of two programs whose steps are accepted at rtol 1e-9, one now and then where the other's is not
SAME_STEPS = 1e-12  # of equal steps in a batch and alone


@pytest.fixture(scope="module")
def arm():
    return rne.Robot(random_tree(2, 4, prismatic=0, branching=0))


@pytest.fixture
def programs(monkeypatch):
    """The programs of scenes that are traced."""
    found, trace = [], kernels.trace

    def noted(quantity, *args, **how):
        found.extend([quantity.name] if quantity.of_run else [])
        return trace(quantity, *args, **how)

    monkeypatch.setattr(kernels, "trace", noted)
    return found


def motion(scene, **how):
    start = np.linspace(0.3, -0.4, scene.n), np.linspace(-0.8, 0.9, scene.n)
    return rne.simulate(scene, *start, TIMES[-1], t_eval=TIMES, **{"method": "RK45", **how})


def arrays(run):
    return [getattr(run, name) for name in ("q", "qd", "qdd", "tau", "work")]


def assert_same(run, other):
    for array, its in zip(arrays(run), arrays(other), strict=True):
        np.testing.assert_array_equal(array, its)


def difference(run, other):
    """The largest one of any array, relative to its largest entry."""
    pairs = zip(arrays(run), arrays(other), strict=True)
    return max(np.abs(array - its).max() / max(np.abs(its).max(), 1e-6) for array, its in pairs)


def assert_close(run, other, tolerance):
    assert difference(run, other) <= tolerance


@dataclass(frozen=True, eq=False)
class Damped:
    """A user's law with gains, a width and a matrix."""

    kp: float
    width: np.ndarray
    across: np.ndarray
    traceable = True

    def __call__(self, t, q, qd):
        pull = -self.kp * rne.elementwise.tanh(q / self.width)
        return pull - (self.across * qd[..., None, :]).sum(-1) + 0.1 * t


class Attributes:
    """A law whose numbers are attributes, read by methods and functions that it keeps."""

    traceable = True

    def __init__(self, kp, kd):
        self.kp, self.kd = kp, kd
        self.pull, self.brake = self.stiffness, lambda qd: -self.kd * qd

    def stiffness(self, q):
        return -self.kp * q

    def __call__(self, t, q, qd):
        return self.pull(q) + self.brake(qd)

    def called(self, t, q, qd):
        """The same as a bound method."""
        return self(t, q, qd)

    called.traceable = True


def closure(kp, kd):
    """A law with numbers in cells, one of which another function shares."""

    def pull(q):
        return -kp * q

    return rne.traceable(lambda t, q, qd: pull(q) - 0.1 * kp * qd - kd * qd)


def defaults(kp, kd):
    """A law with numbers as defaults of its arguments."""

    def law(t, q, qd, kp=kp, *, kd=kd):
        return -kp * q - kd * qd

    return rne.traceable(law)


def springs(**numbers):
    own = {"stiffness": 40.0, "length": 0.2, "force": 3.0, "damping": 2.0, **numbers}
    return [rne.Spring("root", [0.3, 0.1, 0], "link1", [0.1, 0, 0.2], **own)]


SIZES = {"viscous": 2.0, "coulomb": 1.5, "load": 0.2, "saturation": 0.5, "stribeck_rise": 0.7, "stribeck": 0.4}
SIZES |= {"viscous_back": 1.0, "coulomb_back": 2.5, "offset": 0.3, "smoothing": 0.05}
LIMITED = {"effort_limit": [4.0, 6.0], "sample_time": 0.004, "torque_rate": [800.0, 500.0], "delay": 0.001}
OTHERS = {"viscous": [3.0, 1.0], "coulomb": [2.0, 1.0], "load": [0.1, 0.3], "saturation": [0.2, 0.9]}
OTHERS |= {"viscous_back": [0.5, 3.0], "coulomb_back": [1.5, 3.0], "offset": [-0.4, 0.1], "smoothing": 0.02}
OTHERS |= {"stribeck_rise": [0.2, 0.9], "stribeck": [0.3, 0.6]}


def cases(arm):
    """By name: a scene, the number, and the scene built anew with it changed."""
    path = rne.trajectories.quintic([0, 0], [1, 1], 2.0)
    C, target = rne.control, np.array([0.2, -0.1])

    def with_(name, value, part, make, given, **further):
        field = name.rpartition(".")[2]
        scene, other = (
            rne.Scene(arm, **further, **{part: make(**values)}) for values in (given, given | {field: value})
        )
        return scene, {name: value}, other

    for name, value in OTHERS.items():
        yield f"friction.{name}", with_(f"friction.{name}", value, "friction", rne.Friction, SIZES)
    dry = {"coulomb": 1.0, "static": 1.5, "smoothing": 0.0}
    for name, value in {"coulomb": [1.2, 0.4], "static": [2.0, 3.0]}.items():
        yield f"dry {name}", with_(f"friction.{name}", value, "friction", rne.Friction, dry)
    for name, value in {"effort_limit": [1.0, 9.0], "torque_rate": [150.0, 90.0], "delay": 0.0062}.items():
        yield (
            name,
            with_(
                name,
                value,
                name,
                lambda **of: next(iter(of.values())),
                {name: LIMITED[name]},
                **({"controller": C.pd(arm, 30, 2, target)} | {k: v for k, v in LIMITED.items() if k != name}),
            ),
        )
    for name, value in {"stiffness": 60.0, "length": 0.1, "force": -2.0, "damping": 3.0}.items():
        yield f"springs {name}", with_(f"springs[0].{name}", value, "springs", springs, {})
    gains = {"kp": 30.0, "kd": [3.0, 2.0], "reference": target}
    laws = {
        "pd": (C.pd, gains, {"kp": [20.0, 50.0], "kd": [1.0, 4.0], "reference": [0.5, -0.7]}),
        "pid": (
            C.pid,
            gains | {"ki": 9.0, "windup": 0.02},
            {"ki": [5.0, 20.0], "windup": [0.01, 0.5], "kd": [1.0, 4.0]},
        ),
        "computed": (C.computed_torque, {"kp": 90.0, "kd": 20.0, "reference": path}, {"kp": [80.0, 99.0]}),
        "adaptive": (
            C.adaptive,
            {"kd": 5.0, "bandwidth": 4.0, "reference": path, "viscous": 1.0, "coulomb": 0.5, "smoothing": 0.1},
            {"kd": [3.0, 7.0], "bandwidth": [2.0, 5.0], "gain": 3.0, "viscous": [2.0, 1.0], "smoothing": 0.2},
        ),
        "robust": (
            C.robust,
            {"bandwidth": 5.0, "boundary": 0.1, "reference": path, "rho": 2.0},
            {"boundary": [0.2, 0.05], "rho": 3.0, "bandwidth": [4.0, 6.0]},
        ),
    }
    for law, (make, given, others) in laws.items():
        for name, value in others.items():
            how = lambda make=make, **of: make(arm, **of)  # noqa: E731
            yield f"{law} {name}", with_(f"controller.{name}", value, "controller", how, given)
    yield (
        "pd_gravity scale",
        (
            rne.Scene(arm, controller=C.pd_gravity(arm, 30, 2, 0, scale=0.8)),
            {"controller.gravity": 0.5},
            rne.Scene(arm, controller=C.pd_gravity(arm, 30, 2, 0, scale=0.5)),
        ),
    )
    fed = [C.pd_gravity(arm, 30, 2, path, feedforward=rne.Friction(viscous=k, offset=0.3)) for k in (1.0, 2.5)]
    yield (
        "feedforward",
        (rne.Scene(arm, controller=fed[0]), {"controller.feedforward.viscous": 2.5}, rne.Scene(arm, controller=fed[1])),
    )
    held = [
        C.impedance(arm, "link1", np.full(6, 20.0), np.full(6, 2.0), np.eye(4), posture=([0.1, 0.2], k, 1.0))
        for k in (5.0, 8.0)
    ]
    yield (
        "posture",
        (rne.Scene(arm, controller=held[0]), {"controller.posture.kp": 8.0}, rne.Scene(arm, controller=held[1])),
    )
    own = Damped(3.0, np.array([0.5, 0.7]), np.array([[2.0, 0.3], [0.4, 1.0]]))
    for name, value in {"kp": 5.0, "width": [0.2, 0.9], "across": [[1.0, 0.6], [0.2, 2.0]]}.items():
        yield (
            f"dataclass {name}",
            (
                rne.Scene(arm, controller=own),
                {f"controller.{name}": value},
                rne.Scene(arm, controller=replace(own, **{name: value if name == "kp" else np.array(value)})),
            ),
        )
    makers = {
        "attributes": Attributes,
        "method": lambda *k: Attributes(*k).called,
        "cells": closure,
        "defaults": defaults,
    }
    for name, make in makers.items():
        yield (
            name,
            (
                rne.Scene(arm, controller=make(9.0, 2.0)),
                {"controller.kp": 14.0},
                rne.Scene(arm, controller=make(14.0, 2.0)),
            ),
        )
    joints = {"stiffness": 300.0, "damping": 2.0, "rotor": 0.2}
    for name, value in {"stiffness": [200.0, 400.0], "damping": [1.0, 3.0], "rotor": [0.1, 0.4]}.items():
        yield f"elastic {name}", with_(f"elastic.{name}", value, "elastic", rne.ElasticJoints, joints)


# The others of these are of the same code, and run in the long test
SHORT = "friction.saturation", "pid windup", "cells"


def check_numbers(arm, programs, name, scene, numbers, other):
    first = motion(scene)
    programs.clear()
    run = motion(scene.with_numbers(numbers))
    assert programs == [], name
    assert_same(run, motion(other))
    assert_same(run, motion(scene, numbers=numbers))
    assert not np.array_equal(run.qdd, first.qdd) or name == "dry static"  # which slips
    assert_same(motion(scene), first)


def test_other_numbers_give_what_a_scene_built_anew_gives_bit_for_bit_by_the_same_program(arm, programs):
    of = dict(cases(arm))
    for name in SHORT:
        check_numbers(arm, programs, name, *of[name])


@pytest.mark.long
def test_every_number_of_every_part(arm, programs):
    for name, case in cases(arm):
        check_numbers(arm, programs, name, *case)


@pytest.fixture(scope="module")
def loaded_arm(arm):
    payload = rne.Payload(1.5, [0.1, 0.0, 0.2], np.diag([0.02, 0.03, 0.01]), link="link0")
    parts = {"payload": payload, "mounting": [0.2, -0.4, 0.3], "armature": [0.1, 0.0], "gravity": [0.5, 0.0, -9.0]}
    return rne.Scene(arm, **parts, friction=rne.Friction(viscous=1.0))


def with_bodies(scene):
    """By name: a number of the second program, and the scene built anew with it."""
    heavier = rne.Payload(2.5, [0.0, 0.1, 0.1], np.diag([0.03, 0.02, 0.01]), link="link0")
    pi = rne.Scene(scene.robot, payload=heavier).numbers["payload"]
    yield {"payload": pi}, replace(scene, payload=heavier)
    yield {"armature": [0.0, 0.3]}, replace(scene, armature=[0.0, 0.3])
    yield {"gravity": [0.0, 3.0, -5.0]}, replace(scene, gravity=[0.0, 3.0, -5.0])
    both = replace(scene, payload=heavier).numbers["parameters"]
    yield {"parameters": both}, replace(scene, payload=heavier)


@pytest.mark.long
def test_bodies_rotors_and_gravity_take_one_program_more(loaded_arm, programs):
    """It is another one than that of constants: sums of another order, to rounding."""
    first = motion(loaded_arm)
    for number, (numbers, other) in enumerate(with_bodies(loaded_arm)):
        (name,) = numbers
        motion(loaded_arm.with_numbers({name: loaded_arm.numbers[name]}))
        programs.clear()
        run = motion(loaded_arm, numbers=numbers)
        assert programs == [], (number, name)
        assert_close(run, motion(other), OTHER_PROGRAM)
        assert relative(run.qdd, first.qdd) > 1e-3
    programs.clear()
    assert_same(motion(loaded_arm), first)
    assert programs == []


@pytest.mark.long
def test_numbers_come_back(loaded_arm):
    """Set to zero and back they are the first ones, in the print as well; so are all numbers of a scene at once."""
    zero = loaded_arm.with_numbers({"friction.viscous": 0.0, "friction.coulomb": 0.0, "gravity": np.zeros(3)})
    assert_close(motion(zero), motion(replace(loaded_arm, friction=None, gravity=[0, 0, 0])), OTHER_PROGRAM)
    names = ("friction.viscous", "friction.coulomb", "gravity")
    back = zero.with_numbers({name: loaded_arm.numbers[name] for name in names})
    assert repr(back.numbers) == repr(loaded_arm.numbers)
    assert_close(motion(back), motion(loaded_arm), OTHER_PROGRAM)
    every = {name: x for name, x in loaded_arm.numbers.items() if name != "parameters"}
    assert_close(motion(loaded_arm, numbers=every), motion(loaded_arm), OTHER_PROGRAM)


@pytest.mark.long
def test_numbers_that_are_named_at_zero_are_inputs_of_their_own(arm, programs):
    """A scene without Coulomb friction has a program with it once it is named: then any size takes it."""
    scene = rne.Scene(arm, friction=rne.Friction(viscous=1.0)).with_numbers({"friction.coulomb": 0.0})
    assert_close(motion(scene), motion(rne.Scene(arm, friction=rne.Friction(viscous=1.0))), OTHER_PROGRAM)
    programs.clear()
    run = motion(scene, numbers={"friction.coulomb": [2.0, 0.0]})
    assert programs == []
    assert_close(run, motion(rne.Scene(arm, friction=rne.Friction(viscous=1.0, coulomb=[2.0, 0.0]))), OTHER_PROGRAM)


@pytest.mark.long
def test_a_size_of_the_negative_direction_that_was_not_given_follows(arm):
    new = {"friction.viscous": [3.0, 4.0]}
    follows, given = (rne.Scene(arm, friction=rne.Friction(viscous=2.0, viscous_back=back)) for back in (None, 2.0))
    assert "friction.viscous_back" not in follows.numbers
    for scene, back in ((follows, None), (given, 2.0)):
        other = rne.Scene(arm, friction=rne.Friction(viscous=[3.0, 4.0], viscous_back=back))
        assert_same(motion(scene, numbers=new), motion(other))
        run = rne.ensemble(scene, *STARTS, 0.02, numbers={"friction.viscous": [[3.0, 4.0]] * 2}, step=0.002)
        assert relative(run.q, rne.ensemble(other, *STARTS, 0.02, step=0.002).q) <= SAME_STEPS


STARTS = np.array([[0.3, -0.4], [0.1, 0.6]]), np.array([[-0.8, 0.9], [0.5, 0.4]])
ENSEMBLES = {  # parts of a scene, and numbers of motions of their own: what is 0 or no limit in the scene is not in all
    "friction": ({"friction": rne.Friction(viscous=1.0)}, {"friction.coulomb": [[0.0, 0.0], [2.0, 1.0]]}),
    "saturation": (
        {"friction": rne.Friction(viscous=1.0, saturation=0.5)},
        {"friction.saturation": [[0.0, 0.2], [0.4, 0.0]]},
    ),
    "stribeck": (
        {"friction": rne.Friction(coulomb=2.0, stribeck=0.2, stribeck_rise=0.1)},
        {"friction.stribeck_rise": [[0.0, 0.0], [0.5, 0.3]], "friction.stribeck": [[0.0, 1.0], [0.2, 2.0]]},
    ),
    "limits": (
        {"controller": "pid", "effort_limit": [np.inf, 5.0]},
        {"effort_limit": [[3.0, 9.0], [np.inf, 2.0]], "controller.windup": [[0.1, 0.2], [np.inf, 0.3]]},
    ),
    "springs": ({"springs": springs(length=0.0, force=0.0, damping=0.0)}, {"springs[0].length": [0.0, 0.3]}),
    "bodies": (
        {"payload": 2.0},
        {
            "payload": [[0.0] * 10, [1.0, 0.1, 0.0, 0.2, *[0.1, 0.0, 0.1, 0.0, 0.0, 0.1]]],
            "gravity": [[0, 0, 0], [1, 2, 3]],
        },
    ),
    "elastic": (
        {"elastic": rne.ElasticJoints(stiffness=300.0, rotor=0.2)},
        {"elastic.damping": [[0.0, 0.0], [2.0, 1.0]]},
    ),
}


def scene_of(arm, parts):
    if parts.get("controller") == "pid":
        parts = parts | {"controller": rne.control.pid(arm, 30, 9, 2, 0.1)}
    return rne.Scene(arm, **parts)


def of_motion(numbers, k):
    return {name: np.asarray(x, float)[k] for name, x in numbers.items()}


@pytest.mark.parametrize("name", kept(ENSEMBLES, ["limits"]))
def test_motions_with_numbers_of_their_own_are_single_ones(arm, name):
    scene, own = scene_of(arm, ENSEMBLES[name][0]), ENSEMBLES[name][1]
    run = rne.ensemble(scene, *STARTS, 0.02, numbers=own, step=0.002)
    for k in range(2):
        alone = rne.ensemble(scene.with_numbers(of_motion(own, k)), *(x[k : k + 1] for x in STARTS), 0.02, step=0.002)
        assert relative(run.q[:, k], alone.q[:, 0]) <= SAME_STEPS
        assert relative(run.tau[:, k], alone.tau[:, 0]) <= SAME_STEPS
    assert relative(run.q[-1], rne.ensemble(scene, *STARTS, 0.02, step=0.002).q[-1]) > 1e-6
    assert run.numbers.keys() == own.keys()


def test_motions_that_run_one_by_one_are_single_ones_bit_for_bit(arm):
    """Of these some stick and some creep: none does as its neighbour."""
    scene = rne.Scene(arm, friction=rne.Friction(coulomb=2.0, viscous=1.0))
    own = {"friction.smoothing": [0.0, 0.02], "friction.coulomb": [[9.0, 9.0], [1.0, 2.0]]}
    run = rne.ensemble(scene, *STARTS, 0.05, numbers=own)
    turned = rne.ensemble(scene, *(x[::-1] for x in STARTS), 0.05, numbers={k: x[::-1] for k, x in own.items()})
    np.testing.assert_array_equal(run.q, turned.q[:, ::-1])
    for k in range(2):
        alone = rne.simulate(scene, *(x[k] for x in STARTS), 0.05, numbers=of_motion(own, k))
        np.testing.assert_array_equal(run.q[-1, k], alone.q[-1])


@pytest.mark.long
def test_numbers_in_float32(arm):
    scene = rne.Scene(arm, friction=rne.Friction(viscous=1.0))
    own = {"friction.viscous": [[1.0, 2.0], [3.0, 0.5]]}
    run = rne.ensemble(scene, *(x.astype(np.float32) for x in STARTS), 0.02, numbers=own, step=0.002)
    assert run.q.dtype == np.float32
    assert relative(run.q, rne.ensemble(scene, *STARTS, 0.02, numbers=own, step=0.002).q) < 1e-5  # eps of float32


def test_robots_too_large_to_be_written_out_have_numbers_of_each_motion(monkeypatch):
    """The recursion computes them, with those of bodies side by side."""
    monkeypatch.setattr(tracing, "LIMIT", 20)
    scene = rne.Scene(rne.Robot(straight_chain(3)), friction=rne.Friction(viscous=0.5))
    assert not scene.kernel.is_unrolled
    own = {"friction.viscous": np.outer([0.1, 2.0], np.ones(3)), "gravity": np.array([[0, 0, -9.0], [1, 2, 3]])}
    q = np.full((2, 3), 0.1)
    run = rne.ensemble(scene, q, 0 * q + 1, 0.002, numbers=own, step=0.001)
    for k in range(2):
        alone = rne.ensemble(scene.with_numbers(of_motion(own, k)), q[:1], 0 * q[:1] + 1, 0.002, step=0.001)
        assert relative(run.q[:, k], alone.q[:, 0]) <= SAME_STEPS
        single = rne.simulate(scene, q[k], 0 * q[k] + 1, 0.002, numbers=of_motion(own, k))
        assert relative(run.q[-1, k], single.q[-1]) <= 1e-5  # of the longer steps


def test_numbers_travel_to_other_processes_and_in_copies(arm):
    law = Damped(3.0, np.array([0.5, 0.7]), np.eye(2))
    scene = rne.Scene(arm, controller=law, payload=1.0).with_numbers({"controller.kp": 5.0, "gravity": [0.0, 1.0, 2.0]})
    run = motion(scene)
    for twin in (pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene), copy.copy(scene)):
        assert_same(motion(twin), run)
        assert_same(motion(twin, numbers={"controller.kp": 7.0}), motion(scene, numbers={"controller.kp": 7.0}))


@pytest.mark.long
@pytest.mark.parametrize("engine", ["numpy", "numba"])
def test_numbers_in_processes_and_threads(arm, engine):
    robot = rne.Robot(arm.model, engine)
    own = {"friction.viscous": np.array([[1.0, 2.0], [3.0, 0.5]]), "gravity": np.array([[0, 0, -9.0], [1, 2, 3]])}
    for parts in ({}, {"stops": True}):
        scene = rne.Scene(robot, friction=rne.Friction(viscous=1.0), **parts)
        run = rne.ensemble(scene, *STARTS, 0.02, numbers=own)
        for pool in (ProcessPoolExecutor(2), ThreadPoolExecutor(2)):
            with pool as executor:
                np.testing.assert_array_equal(
                    rne.ensemble(scene, *STARTS, 0.02, numbers=own, executor=executor).q, run.q
                )


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ({"friction.viscous": -1.0}, "`numbers['friction.viscous']` must not be negative, got -1.0"),
        ({"friction.viscous": np.nan}, "`numbers['friction.viscous']` must be real numbers, none of them NaN"),
        ({"friction.viscous": np.inf}, "`numbers['friction.viscous']` must be finite, got inf"),
        ({"friction.viscous": [1, 2, 3]}, "`numbers['friction.viscous']` must have shape (2,), got (3,)"),
        ({"friction.load": 1.0}, "`numbers['friction.load']` must be below 1"),
        ({"friction.static": 1.0}, "`numbers['friction.static']` must"),
        ({"controller.kp": -1.0}, "`numbers['controller.kp']` must not be negative, got -1.0"),
        ({"controller.kp": np.inf}, "`numbers['controller.kp']` must be finite, got inf"),
        ({"effort_limit": -1.0}, "`numbers['effort_limit'][0]` of joint 'joint0' must not be negative, got -1.0"),
        ({"delay": -1.0}, "`numbers['delay']` must not be negative, got -1.0"),
        ({"armature": -1.0}, "`numbers['armature'][0]` of joint 'joint0' must not be negative, got -1.0"),
        ({"payload": [-1.0, *[0.0] * 9]}, "mass must be 0 or positive, got -1.0"),
        ({"payload": [0.0, 1.0, *[0.0] * 8]}, "without mass must have no first moment"),
        ({"springs[0].damping": -1.0}, "`numbers['springs[0].damping']` must not be negative, got -1.0"),
        ({"gravity": [1.0, 2.0]}, "`numbers['gravity']` must have shape (3,), got (2,)"),
        (
            {"parameters": np.zeros(20), "payload": np.zeros(10)},
            "'parameters', which contain the payload, or 'payload'",
        ),
    ],
)
def test_an_error_names_the_number(every_part, numbers, text):
    given = {"friction": rne.Friction(coulomb=2.0, static=3.0, smoothing=0)} if "friction.static" in numbers else {}
    scene = replace(every_part, **given)
    with pytest.raises(ValueError, match=re.escape(text)):
        scene.with_numbers(numbers)
    if "payload" in numbers and len(numbers) == 1 and numbers["payload"][0] == 0:
        return  # in ensembles any parameters are taken, as of identified ones
    many = {
        name: np.broadcast_to(x, (2, *scene.numbers[name].shape)) if np.ndim(x) == 0 else [x, x]
        for name, x in numbers.items()
    }
    with pytest.raises(ValueError, match=r"numbers"):
        rne.ensemble(scene, *STARTS, 0.01, numbers=many)


@pytest.fixture(scope="module")
def every_part(arm):
    law = rne.control.pd(arm, 30, 2, 0)
    parts = {"payload": 1.0, "friction": rne.Friction(viscous=1.0, load=0.1), "springs": springs()}
    return rne.Scene(arm, controller=law, **parts, **LIMITED)


def test_absent_parts_have_no_names(arm, every_part):
    scene = rne.Scene(arm)
    assert list(scene.numbers) == ["parameters", "armature", "gravity"]
    with pytest.raises(KeyError, match=r"numbers parameters, armature, gravity; got 'friction.viscous'"):
        scene.with_numbers({"friction.viscous": 1.0})
    with pytest.raises(KeyError, match=r"did you mean 'friction.viscous'"):
        every_part.numbers["friction.viscos"]
    locked = replace(scene, springs=[rne.Spring.at_joint("joint1", 5, 0), *springs()], locked={"joint1": 0.1})
    assert "springs[1].force" in locked.numbers
    with pytest.raises(KeyError, match=r"springs\[0\].rest"):
        locked.with_numbers({"springs[0].rest": 1.0})
    new = replace(locked, springs=[locked.springs[0], *springs(force=7.0)])
    assert_same(motion(locked.with_numbers({"springs[1].force": 7.0})), motion(new))


def test_numbers_of_motions_are_judged_together(arm):
    """Each of these is right beside the scene's other numbers, but not beside those of its motion; and the reverse."""
    scene = rne.Scene(arm, friction=rne.Friction(coulomb=1.0, stribeck_rise=-0.5, stribeck=0.3))
    own = {"friction.coulomb": [[1.0, 0.6], [3.0, 3.0]], "friction.stribeck_rise": [[-1.0, -0.1], [-2.0, -2.5]]}
    assert np.isfinite(rne.ensemble(scene, *STARTS, 0.002, numbers=own, step=0.001).q).all()
    own["friction.coulomb"][0][0] = 0.7
    with pytest.raises(ValueError, match=r"numbers\['friction.stribeck_rise'\].*at least -`coulomb`"):
        rne.ensemble(scene, *STARTS, 0.002, numbers=own, step=0.001)


@dataclass(frozen=True, eq=False)
class Odd:
    """A law that reads its numbers where a traced number has no value: they stay constants."""

    kp: float
    threshold: float = 5.0
    power: float = 2.0
    index: float = 1.0
    ki: float = 0.0
    traceable = True

    def __call__(self, t, q, qd):
        pull = -self.kp * (2 if self.threshold > 4 else 1) * q**self.power
        pull = pull - np.array([1.0, 3.0])[int(self.index)] * qd
        return pull if self.ki == 0 else pull - self.ki * q


@dataclass(eq=False)
class Remembering:
    """A law with memory among its numbers."""

    kp: float
    last: float = 0.0
    traceable = True

    def __call__(self, t, q, qd):
        self.last = self.last + 0.5
        return -self.kp * q - self.last


@dataclass(frozen=True, eq=False)
class Derived:
    """A law with a number that is computed of another one, and checked."""

    kp: float
    kd: float = field(init=False)
    traceable = True

    def __post_init__(self):
        if isinstance(self.kp, float) and self.kp < 2:
            raise ValueError("`kp` must be at least 2")
        object.__setattr__(self, "kd", 2 * self.kp**0.5)

    def __call__(self, t, q, qd):
        return -self.kp * q - self.kd * qd


@pytest.mark.long
def test_a_law_that_needs_the_value_of_a_number_keeps_it_as_a_constant(arm):
    scene = rne.Scene(arm, controller=Odd(9.0))
    assert scene.is_traced
    assert {name for name in scene.numbers if "controller" in name} == {"controller.kp"}
    assert_same(motion(scene, numbers={"controller.kp": 4.0}), motion(rne.Scene(arm, controller=Odd(4.0))))
    for other in (Odd(9.0, threshold=3.0, power=3.0), Odd(9.0, index=0.0, ki=2.0)):
        called = rne.Scene(arm, controller=lambda t, q, qd, law=other: law(t, q, qd))
        run = motion(rne.Scene(arm, controller=other))
        assert_close(run, motion(called), 1e-5)  # of steps that follow another state as well
        assert relative(run.q, motion(scene).q) > 1e-5


def test_a_law_with_memory_is_called(arm, caplog):
    scene = rne.Scene(arm, controller=Remembering(3.0))
    assert not scene.is_traced
    assert "it has memory, noise or a branch" in caplog.text


def test_what_a_law_computes_of_its_numbers_follows(arm, programs):
    scene = rne.Scene(arm, controller=Derived(4.0))
    motion(scene)
    programs.clear()
    run = motion(scene, numbers={"controller.kp": 9.0})
    assert programs == []
    assert_same(run, motion(rne.Scene(arm, controller=Derived(9.0))))
    with pytest.raises(ValueError, match=r"numbers\['controller.kp'\].* must be at least 2"):
        scene.with_numbers({"controller.kp": 1.0})


def test_equal_laws_and_those_of_other_numbers_share_a_program(arm, programs):
    makers = {
        "closure": closure,
        "defaults": defaults,
        "attributes": Attributes,
        "pd": lambda *k: rne.control.pd(arm, *k, 0.1),
        "dataclass": lambda k, d: Damped(k, np.array([d, d]), np.eye(2)),
        "method": lambda *k: Attributes(*k).called,
    }
    for name, make in makers.items():
        first = motion(rne.Scene(arm, controller=make(9.0, 2.0)))
        programs.clear()
        assert_same(motion(rne.Scene(arm, controller=make(9.0, 2.0))), first)
        other = motion(rne.Scene(arm, controller=make(7.0, 3.0)))
        assert programs == [], name
        assert relative(other.q, first.q) > 1e-6
        called = make(7.0, 3.0)
        assert_close(other, motion(rne.Scene(arm, controller=lambda t, q, qd, law=called: law(t, q, qd))), 1e-5)


def test_a_law_as_it_is_now(arm):
    """Its numbers may change between runs; a scene with others keeps its own."""
    law = Attributes(9.0, 2.0)
    scene = rne.Scene(arm, controller=law)
    other = scene.with_numbers({"controller.kd": 4.0})
    law.kp = 5.0
    assert_same(motion(scene), motion(rne.Scene(arm, controller=Attributes(5.0, 2.0))))
    assert_same(motion(other), motion(rne.Scene(arm, controller=Attributes(9.0, 4.0))))
    assert scene.numbers["controller.kp"] == 5.0


def scene_kernel(robot, *wrt):
    law = Damped(3.0, np.array([0.5, 0.7]), np.eye(2))
    scene = rne.Scene(robot, friction=rne.Friction(viscous=1.0, coulomb=0.5, smoothing=0.3), controller=law)
    dynamics = replace(scene.dynamics, has_energies=False)
    return scene.kernels.scene_kernel(dynamics.right_hand_side, *wrt), dynamics.vector


def kernel_arguments(vector, count=37):
    rng = np.random.default_rng(3)
    return (
        rng.uniform(0, 1, (count, 1)),
        rng.uniform(-1, 1, (count, 4)),
        vector * rng.uniform(0.5, 2, (count, len(vector))),
    )


def check_kernel(robot, wrt):
    """Numbers of the run in batches, for all states and for each, `into`, in threads, as the function itself."""
    kernel, vector = scene_kernel(robot, *wrt)
    t, x, numbers = kernel_arguments(vector)
    alone = np.array([kernel(*row) for row in zip(t, x, numbers, strict=True)])
    common = np.array([kernel(*row, vector) for row in zip(t, x, strict=True)])
    np.testing.assert_allclose(kernel(t, x, numbers), alone, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(kernel(t, x, vector), common, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(kernel(t, x, numbers, workers=2), kernel(t, x, numbers))
    np.testing.assert_array_equal(kernel(t, x, vector, workers=2), kernel(t, x, vector))
    out = np.empty_like(alone)
    for given, expected in (
        (numbers, kernel(t, x, numbers)),
        (np.tile(vector, (37, 1)), kernel(t, x, np.tile(vector, (37, 1)))),
    ):
        assert kernel.into(t, x, given, out) is out
        np.testing.assert_array_equal(out, expected)
    np.testing.assert_array_equal(kernel.into(t[0], x[0], numbers[0], out[0].copy()), alone[0])
    np.testing.assert_allclose(kernel.by_recursion(t, x, numbers)[0], alone, rtol=1e-9, atol=1e-9)
    grid = [a[:36].reshape(4, 9, -1) for a in (t, x, numbers)]
    np.testing.assert_array_equal(kernel(*grid).reshape(36, *alone.shape[1:]), kernel(t, x, numbers)[:36])
    low = kernel(*(a.astype(np.float32) for a in (t, x, numbers)))
    assert low.dtype == np.float32
    assert relative(low, alone) < 1e-4  # eps of float32 times operations


@pytest.mark.parametrize("engine", kept(["numpy", "numba"], ["numpy"]))
@pytest.mark.parametrize("wrt", kept(["", "x", "numbers", "x numbers"], [""]))
def test_kernels_and_their_derivatives_take_the_numbers_of_a_run(arm, engine, wrt):
    check_kernel(rne.Robot(arm.model, engine), wrt.split())


@pytest.mark.long
def test_slopes_by_numbers_are_those_of_differences(arm):
    kernel, vector = scene_kernel(arm)
    slopes, _ = scene_kernel(arm, "numbers")
    t, x, numbers = kernel_arguments(vector, 5)
    for j in range(len(vector)):
        step = np.eye(len(vector))[j] * 1e-6
        central = (kernel(t, x, numbers + step) - kernel(t, x, numbers - step)) / 2e-6
        np.testing.assert_allclose(slopes(t, x, numbers)[..., j], central, rtol=1e-6, atol=1e-6)  # of the step's square


def random_program(rng, inputs, length):
    """A program of all kinds of operands, whose results stay moderate."""
    kinds = ("add", "subtract", "multiply", "negative", "sin", "cos", "abs", "minimum", "tanh", "less_equal", "where")
    operands = [Operand("input", k) for k in range(inputs)] + [Operand("constant", x) for x in (0.5, -1.0, 2.0)]
    instructions = []
    for k in range(length):
        kind = str(rng.choice(kinds))
        count = {"where": 3, "negative": 1, "sin": 1, "cos": 1, "abs": 1, "tanh": 1}.get(kind, 2)
        chosen = [operands[int(i)] for i in rng.integers(len(operands), size=count)]
        instructions.append(Instruction(kind, tuple(chosen)))
        operands.append(Operand("result", k))
    outputs = tuple(operands[int(i)] for i in rng.integers(len(operands), size=6))
    return Program(tuple(instructions), outputs, inputs)


@pytest.mark.parametrize("count", kept([6, 300], [6]))
def test_divided_programs_are_the_undivided_ones(count):
    """The part of the numbers alone, then the rest: the same operations on the same operands."""
    for seed in range(count):
        rng = np.random.default_rng(seed)
        program, first = random_program(rng, 9, 40), int(rng.integers(0, 6))
        given = rng.uniform(-1, 1, (5, 9))
        found = Trace(program, (first, 3, 6 - first), (6,), of_run=1).divided()
        of_numbers, rest = found.of_numbers, found.program
        assert found.widths == (first, len(of_numbers.outputs), 6 - first)
        coefficients = evaluate(of_numbers, len(of_numbers.outputs), given[:, first : first + 3])
        inputs = np.concatenate([given[:, :first], coefficients, given[:, first + 3 :]], axis=1)
        np.testing.assert_array_equal(evaluate(rest, 6, inputs), evaluate(program, 6, given))
        assert len(of_numbers.instructions) + len(rest.instructions) == len(program.instructions)


def random_scene(seed, engine="numpy"):
    """A scene of random parts, and others of its numbers, some of them 0."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    robot = rne.Robot(random_tree(n, seed, prismatic=0.3, branching=0), engine)

    def sizes(low=0.0):
        return np.where(rng.random(n) < 0.25, low, rng.uniform(low, 3, n))

    parts = {"payload": rne.Payload(*rng.uniform(0, 1, 1), rng.normal(size=3))} if rng.random() < 0.4 else {}
    if rng.random() < 0.6:
        given = {"viscous": sizes(), "coulomb": sizes(), "smoothing": float(rng.uniform(0.1, 1))}
        given |= {name: x for name, x in (("viscous_back", sizes()), ("offset", sizes(-3.0))) if rng.random() < 0.4}
        given |= {"load": rng.uniform(0, 0.5, n)} if rng.random() < 0.3 else {}
        given |= {"saturation": sizes()} if rng.random() < 0.3 else {}
        parts["friction"] = rne.Friction(**given)
    laws = {
        "none": None,
        "pd": rne.control.pd_gravity(robot, sizes(), sizes(), rng.normal(size=n), scale=float(rng.random())),
        "closure": closure(float(rng.uniform(1, 5)), sizes()),
        "pid": rne.control.pid(robot, sizes(), sizes(), sizes(), rng.normal(size=n), windup=0.1 + sizes()),
    }
    parts["controller"] = laws[str(rng.choice([*laws]))]
    if parts["controller"] is not None and rng.random() < 0.5:
        parts["effort_limit"] = 1 + sizes()
    if parts["controller"] is not None and rng.random() < 0.3:
        parts |= {"sample_time": 0.005, "delay": float(rng.choice([0.0, 0.005, 0.0071]))}
    if rng.random() < 0.3:
        parts["springs"] = [rne.Spring.at_joint("joint0", 5.0, 0.3, damping=float(rng.choice([0.0, 1.0])))]
    if rng.random() < 0.25:
        parts["elastic"] = rne.ElasticJoints(stiffness=200 + sizes(), damping=sizes(), rotor=0.2)
    scene = rne.Scene(robot, **parts)
    left_out = {"parameters", "friction.stribeck_rise"}  # contain the payload; has no velocity here
    if "effort_limit" in parts:  # its steps follow impulses over the inertia of the scene that was given
        left_out |= {"payload", "armature"}
    names = [str(x) for x in rng.permutation([*scene.numbers]) if x not in left_out][: int(rng.integers(1, 5))]
    known = {name: scene.numbers[name] for name in names}
    return scene, {name: changed_number(rng, name, x) for name, x in known.items()}


def changed_number(rng, name, x):
    """Another number of a name, in which entries become 0 where they may."""
    other = x * rng.uniform(0.5, 1.5, x.shape) + (x == 0) * rng.uniform(0, 0.5, x.shape)
    if name in ("payload", "elastic.stiffness", "elastic.rotor", "controller.windup", "friction.smoothing", "delay"):
        return x * float(rng.uniform(0.5, 1.5))
    return np.where(rng.random(x.shape) < 0.3, 0.0, np.minimum(other, 0.9) if name == "friction.load" else other)


@pytest.mark.parametrize(("engine", "count"), kept([("numpy", 1), ("numpy", 200), ("numba", 40)], [("numpy", 1)]))
def test_random_scenes(engine, count):
    """Other numbers, and back: as of scenes built anew."""
    for seed in range(count):
        scene, numbers = random_scene(seed, engine)
        first, how = motion(scene, rtol=1e-9, atol=1e-12), {"rtol": 1e-9, "atol": 1e-12}
        other = scene.with_numbers(numbers)
        assert_close(motion(other, **how), motion(replace(other), **how), ADAPTED)
        back = other.with_numbers({name: scene.numbers[name] for name in numbers})
        assert_close(motion(back, **how), first, ADAPTED)
        assert_close(motion(scene, **how), first, ADAPTED)


@dataclass(frozen=True, eq=False)
class ReadsMasses:
    """A law that reads its robot where it cannot be traced."""

    robot: rne.Robot
    traceable = True

    def __call__(self, t, q, qd):
        return self.robot.gravity_torque(q) - self.robot.model.mass[-1] * qd


def test_a_law_has_the_parameters_of_its_own_robot_if_they_are_named(arm, programs):
    heavier = arm.with_parameters(1.3 * arm.parameters)
    law = lambda robot: rne.control.pd_gravity(robot, 30, 2, 0.1)  # noqa: E731
    scene, name = rne.Scene(arm, controller=law(arm)), "controller.robot.parameters"
    motion(scene, numbers={name: arm.parameters})
    programs.clear()
    run = motion(scene, numbers={name: heavier.parameters})
    assert programs == []
    assert_close(run, motion(rne.Scene(arm, controller=law(heavier))), OTHER_PROGRAM)
    assert name not in scene.numbers
    assert name in scene.with_numbers({name: heavier.parameters}).numbers
    own = {name: [arm.parameters, heavier.parameters]}
    many = rne.ensemble(scene, *STARTS, 0.02, numbers=own, step=0.002)
    alone = rne.ensemble(rne.Scene(arm, controller=law(heavier)), *(x[1:] for x in STARTS), 0.02, step=0.002)
    assert relative(many.q[:, 1], alone.q[:, 0]) <= SAME_STEPS
    other = rne.Scene(arm, controller=ReadsMasses(arm))
    run = motion(other, numbers={name: heavier.parameters})
    assert_same(run, motion(rne.Scene(arm, controller=ReadsMasses(heavier))))
    with pytest.raises(ValueError, match="cannot differ: the law reads its robot where it cannot be traced"):
        rne.ensemble(other, *STARTS, 0.02, numbers=own)


def test_a_number_that_a_law_decides_on_has_no_name_even_where_it_is_zero():
    """Otherwise the motions of an ensemble would all follow the law of the zero."""
    arm = rne.Robot(straight_chain(2))

    class Pulled:
        traceable = True

        def __init__(self, ki):
            self.ki = ki

        def __call__(self, t, q, qd):
            return -5.0 * qd - self.ki * q if self.ki else -5.0 * qd

    for ki in (0.0, 3.0):
        scene = rne.Scene(arm, controller=Pulled(ki))
        assert [name for name in scene.numbers if name.startswith("controller")] == []
        with pytest.raises(KeyError, match=r"got 'controller\.ki'"):
            rne.ensemble(scene, np.zeros((2, arm.n)), np.zeros((2, arm.n)), 0.1, numbers={"controller.ki": [0.0, 9.0]})


def test_losses_that_only_some_motions_have():
    """One by one: torques that are held in NumPy."""
    arm, z = rne.Robot(straight_chain(2)), np.zeros((2, 2))
    own = {"friction.viscous": np.array([0.0, 1.0])[:, None] * np.ones(arm.n)}
    motions = rne.ensemble(rne.Scene(arm, friction=rne.Friction(viscous=1.0)), z, z, 0.1, torque=z + 1, numbers=own)
    losses = motions.energies[-1, :, motions.ledger.index("viscous")]
    assert losses[0] == pytest.approx(0.0, abs=1e-12)
    assert losses[1] > 1e-6


def test_numbers_that_are_not_per_joint_are_given_whole_and_payloads_are_of_possible_bodies():
    arm = rne.Robot(straight_chain(2))
    scene = rne.Scene(arm, payload=rne.Payload(1.0, link=arm.model.link_names[-1]))
    for name in ("gravity", "parameters", "payload"):
        with pytest.raises(ValueError, match=rf"^`numbers\['{name}'\]` must have shape"):
            scene.with_numbers({name: 1.0})
    z = np.zeros((2, arm.n))
    with pytest.raises(ValueError, match=r"^`numbers\['payload'\]` must be of physically possible bodies; start 1"):
        rne.ensemble(scene, z, z, 0.1, numbers={"payload": [scene.numbers["payload"], np.ones(10)]})


def test_numbers_of_bodies_follow_one_another_in_any_order():
    """A mounting turns gravity before and after the bodies were given; a payload may be contained in them."""
    arm = rne.Robot(straight_chain(2))
    scene = rne.Scene(arm, mounting=[np.pi, 0, 0], payload=rne.Payload(1.0, link=arm.model.link_names[-1]))
    pi, down = 1.1 * scene.numbers["parameters"], [0.0, 0.0, -9.0]
    first = scene.with_numbers({"gravity": down}).with_numbers({"parameters": pi})
    second = scene.with_numbers({"parameters": pi}).with_numbers({"gravity": down})
    for found in (first, second):
        assert found.resolved.robot.model.gravity == pytest.approx([0, 0, 9.0], abs=1e-14)
        assert found.numbers["gravity"].tolist() == down
    heavier = scene.with_numbers({"payload": 2 * scene.numbers["payload"]}).with_numbers({"parameters": pi})
    np.testing.assert_allclose(heavier.numbers["parameters"], pi, rtol=1e-14)
    elastic = rne.Scene(arm.with_armature(0.1), elastic=rne.ElasticJoints(100.0))
    softer = elastic.with_numbers({"elastic.stiffness": 50.0}).with_numbers({"elastic.damping": 1.0})
    assert softer.numbers["elastic.stiffness"].tolist() == [50.0, 50.0]
    assert softer.numbers["elastic.rotor"].tolist() == [0.1, 0.1]


@pytest.mark.parametrize("other", ["armature", "controller.kp"])
def test_digits_of_fast_motions_with_numbers_of_their_own_are_judged(other):
    """By the recursion, state by state: velocities whose squares may cost digits."""
    arm, count = rne.Robot(straight_chain(2)), 3
    law = rne.control.pd(arm, 5.0, 1.0, 0.0)
    scene = rne.Scene(arm, controller=law, payload=rne.Payload(1.0, link=arm.model.link_names[-1]))
    payload = (1 + np.arange(count))[:, None] * scene.numbers["payload"]
    own = {other: np.linspace(1, 2, 2 * count).reshape(count, 2), "payload": payload}
    q, qd = np.zeros((count, 2)), np.full((count, 2), [1e6, -2e6])
    motions = rne.ensemble(scene, q, qd, 1e-9, numbers=own, method="RK45")
    for k in range(count):
        numbers = {name: x[k] for name, x in own.items()}
        one = rne.simulate(scene, q[k], qd[k], 1e-9, numbers=numbers, method="RK45")
        np.testing.assert_allclose(motions.q[-1, k], one.q[-1], rtol=ADAPTED)


def test_a_kernel_that_is_written_out_takes_the_numbers_as_its_calls_do(arm):
    friction = rne.Friction(viscous=2.0, coulomb=1.0, smoothing=0.1)  # of which the kernel takes the reciprocal
    dynamics = replace(rne.Scene(arm, friction=friction).dynamics, has_energies=False)
    kernel, names = rne.kernels.Kernel(dynamics.right_hand_side, arm.model, {}), dict[str, object]()
    exec(kernel.source("python"), names)
    t, x = np.zeros(1), np.linspace(0.1, 1.0, 2 * arm.n)
    printed = names["right_hand_side"](t, x, dynamics.vector)
    np.testing.assert_allclose(printed, kernel(t, x, dynamics.vector), rtol=1e-13)


def test_payloads_of_motions_are_not_put_into_the_axes_of_one_of_several_links(irb140):
    """As of one motion: a centre in axes that no link names is refused, a further mass at the common origin is not."""
    parts = dict(link_names=(*irb140.model.link_names, "sensor"), link_body=(*irb140.model.link_body, 5))
    tip, last = irb140.model.link_index("tool0"), irb140.model.link_index("link_6")
    parts |= {"link_parent": (*irb140.model.link_parent, last), "link_joints": (*irb140.model.link_joints, "turned")}
    parts["link_translation"] = np.r_[irb140.model.link_translation, irb140.model.link_translation[[tip]]]
    parts["link_rotation"] = np.r_[irb140.model.link_rotation, [np.diag([1.0, -1.0, -1.0])]]
    scene = rne.Scene(rne.Robot(replace(irb140.model, **parts)), payload=1.0)
    starts, (mass, centre) = np.zeros((2, 6)), np.zeros((2, 2, 10))
    mass[:, 0], centre[:, :2], centre[:, [6, 9]] = [1, 2], [1, 0.1], 0.01
    assert np.isfinite(rne.ensemble(scene, starts, starts, 0.01, numbers={"payload": mass}).q).all()
    with pytest.raises(ValueError, match="ambiguous: tool0 and sensor have different frames"):
        rne.ensemble(scene, starts, starts, 0.01, numbers={"payload": centre})
