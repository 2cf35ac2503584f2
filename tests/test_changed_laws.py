"""Traced laws that were changed between two runs: wherever the number stands that their code reads, it is noticed."""

import dataclasses
import functools
import itertools
import operator
import types

import numpy as np
import pytest

import rne
from rne.elementwise import clip, less, where

from .helpers import kept
from .random_robots import straight_chain

BOUND = 50.0
FAR = [20.0]  # rad, where torques are at their bound; where laws are compared with their traces none is


class Bounded:
    """A law whose bound subclasses find; as it stands on the class."""

    traceable = True
    bound = 50.0

    def __call__(self, t, q, qd):
        bound = self.find()
        return clip(-5 * q, -bound, bound)

    def find(self):
        return self.bound


def instance():
    law = Bounded()
    return law, lambda: setattr(law, "bound", 10.0)


def class_attribute():
    kind = type("Own", (Bounded,), {"bound": 50.0})
    return kind(), lambda: setattr(kind, "bound", 10.0)


def base_class():
    base = type("Base", (Bounded,), {})
    kind = type("Own", (base,), {})
    return kind(), lambda: setattr(base, "bound", 10.0)


def metaclass():
    meta = type("Meta", (type,), {"bound": 50.0})
    kind = meta("Own", (Bounded,), {"find": lambda self: type(type(self)).bound})
    return kind(), lambda: setattr(meta, "bound", 10.0)


def slot():
    kind = type("Own", (Bounded,), {"__slots__": ("held",), "find": lambda self: self.held})
    law = kind()
    law.held = 50.0
    return law, lambda: setattr(law, "held", 10.0)


def method():
    kind = type("Own", (Bounded,), {})
    return kind(), lambda: setattr(kind, "find", lambda self: 10.0)


def code():
    kind = type("Own", (Bounded,), {"find": lambda self: 50.0})
    return kind(), lambda: setattr(kind.find, "__code__", (lambda self: 10.0).__code__)


def default():
    kind = type("Own", (Bounded,), {"find": lambda self, bound=50.0: bound})
    return kind(), lambda: setattr(kind.find, "__defaults__", (10.0,))


def property_of_a_global():
    kind = type("Own", (Bounded,), {"bound": property(lambda self: BOUND)})
    return kind(), lambda: globals().update(BOUND=10.0)


def inner_function():
    def find(self):
        def inner():
            return next(BOUND for _ in range(1))

        return inner()

    return type("Own", (Bounded,), {"find": find})(), lambda: globals().update(BOUND=10.0)


def getattr_of_an_object():
    table = {"bound": 50.0}
    kind = type("Own", (), {"__getattr__": lambda self, name: table[name]})
    other = kind()
    law = rne.traceable(lambda t, q, qd: clip(-5 * q, -other.bound, other.bound))
    return law, lambda: table.update(bound=10.0)


def module():
    part = types.ModuleType("part")
    part.bound = 50.0
    law = rne.traceable(lambda t, q, qd: clip(-5 * q, -part.bound, part.bound))
    return law, lambda: setattr(part, "bound", 10.0)


def installed_module():
    kind = type("Own", (Bounded,), {"find": lambda self: np.bound_of_a_law})
    np.bound_of_a_law = 50.0
    return kind(), lambda: setattr(np, "bound_of_a_law", 10.0)


def array_in_place():
    bound = np.array([50.0])
    law = rne.traceable(lambda t, q, qd: clip(-5 * q, -bound, bound))
    return law, lambda: operator.setitem(bound, 0, 10.0)


def view_of_bytes():
    memory = bytearray(np.array([50.0]).tobytes())
    kind = type("Own", (Bounded,), {"find": lambda self: np.frombuffer(memory)[0]})
    return kind(), lambda: operator.setitem(memory, slice(None), np.array([10.0]).tobytes())


def mutable_field():
    kind = dataclasses.make_dataclass(
        "Own", [("table", dict)], bases=(Bounded,), namespace={"find": lambda self: self.table["a"][0]}, frozen=True
    )
    law = kind({"a": [50.0]})
    return law, lambda: operator.setitem(law.table["a"], 0, 10.0)


def cached():
    law = type(
        "Own", (Bounded,), {"find": lambda self: self.kept, "kept": functools.cached_property(lambda s: BOUND)}
    )()
    assert law.kept == 50.0

    def change():
        globals().update(BOUND=10.0)
        del law.kept

    return law, change


def cleared_cache():
    found = functools.lru_cache(lambda: BOUND)

    def change():
        globals().update(BOUND=10.0)
        found.cache_clear()

    return type("Own", (Bounded,), {"find": lambda self: found()})(), change


def partial():
    bounds = [50.0]
    law = rne.traceable(functools.partial(lambda bounds, t, q, qd: clip(-5 * q, -bounds[0], bounds[0]), bounds))
    return law, lambda: operator.setitem(bounds, 0, 10.0)


def bound_method():
    marked = rne.traceable(lambda self, t, q, qd: Bounded.__call__(self, t, q, qd))
    law = type("Own", (Bounded,), {"torques": marked})()
    return law.torques, lambda: setattr(law, "bound", 10.0)


def closure():
    bound = 50.0

    def change():
        nonlocal bound
        bound = 10.0

    return rne.traceable(lambda t, q, qd: clip(-5 * q, -bound, bound)), change


def iterator():
    bounds = [50.0]
    kind = type("Own", (Bounded,), {"find": lambda self: next(itertools.chain(bounds))})
    return kind(), lambda: operator.setitem(bounds, 0, 10.0)


def another_class():
    law = Bounded()
    return law, lambda: setattr(law, "__class__", type("Lower", (Bounded,), {"bound": 10.0}))


def reference():
    class Path:
        bound = 50.0

        def __call__(self, t):
            return np.array([20.0 - self.bound / 5]), np.zeros(1), np.zeros(1)

    path = Path()
    return rne.control.pd(CHAIN, 5, 0, path), lambda: setattr(Path, "bound", 10.0)


KINDS = [
    class_attribute, base_class, metaclass, slot, method, code, default, property_of_a_global, inner_function,
    getattr_of_an_object, module, installed_module, view_of_bytes, cleared_cache, iterator, another_class, closure,
]  # fmt: skip
MORE = [instance, array_in_place, mutable_field, cached, partial, bound_method, reference]  # that are held in sight
CHAIN = rne.Robot(straight_chain(1))


@pytest.fixture(autouse=True)
def as_before():
    globals().update(BOUND=50.0)
    yield
    globals().update(BOUND=50.0)
    np.__dict__.pop("bound_of_a_law", None)


def first_torques(scene, change):
    """At the start of a run before and after a change."""
    found = [rne.simulate(scene, FAR, [0.0], 0.0).tau[0, 0]]
    change()
    return [*found, rne.simulate(scene, FAR, [0.0], 0.0).tau[0, 0]]


@pytest.mark.parametrize("kind", kept([*KINDS, *MORE], KINDS), ids=lambda kind: kind.__name__)
def test_a_law_runs_as_it_is_now_wherever_its_number_stands(kind):
    law, change = kind()
    scene = rne.Scene(CHAIN, controller=law)
    assert scene.is_traced
    assert first_torques(scene, change) == [-50.0, -10.0]


@pytest.mark.long
@pytest.mark.parametrize("sample_time", [None, 0.01])
@pytest.mark.parametrize("kind", [*KINDS, *MORE], ids=lambda kind: kind.__name__)
def test_the_same_in_machine_code(kind, sample_time):
    law, change = kind()
    scene = rne.Scene(rne.Robot(CHAIN.model, "numba"), controller=law, sample_time=sample_time)
    assert first_torques(scene, change) == [-50.0, -10.0]


def test_a_change_that_acts_late_is_noticed():
    numbers = {"late": 1.0}
    law = rne.traceable(lambda t, q, qd: where(less(5.0, t), numbers["late"], 0.0) + 0 * q)
    scene = rne.Scene(CHAIN, controller=law)
    before = scene.kernel
    numbers["late"] = 2.0
    assert scene.kernel is not before
    rates = [kernel(np.array([6.0]), np.zeros(2))[1] for kernel in (before, scene.kernel)]
    assert rates[1] - rates[0] == pytest.approx(1 / CHAIN.mass_matrix([0.0])[0, 0])


def test_a_law_whose_number_of_states_changes_runs_with_as_many():
    class Filtered:
        states, traceable = 1, True

        def __call__(self, t, q, qd, z):
            return -z[:1], 0 * z + q[0]

    for traceable in (True, False):
        law = Filtered()
        law.traceable = traceable
        scene = rne.Scene(CHAIN, controller=law)
        for law.states in (1, 3):
            assert rne.simulate(scene, FAR, [0.0], 0.01).controller_state.shape[1] == law.states


def test_what_a_formula_does_not_show_is_reported_by_hand():
    law = Bounded()
    scene = rne.Scene(CHAIN, controller=law)
    first = scene.kernel
    assert scene.kernel is first
    assert rne.control.changed(law) is None
    assert scene.kernel is not first
    with pytest.raises(TypeError, match=r"^`law` must be a function, got float$"):
        rne.control.changed(3.0)


def test_the_same_formula_keeps_its_kernel(irb140):
    """Quantities of robots are not traced to find that."""
    scene = rne.Scene(irb140, controller=rne.control.pd_gravity(irb140, 50, 20, 0))
    assert scene.kernel is scene.kernel
    assert len(scene.dynamics.law.formula[1]) < 100  # operations


def test_laws_of_one_structure_share_their_formula_and_keep_their_numbers():
    robot = rne.Robot(straight_chain(2))
    for gain, share in [(10.0, 1.0), (20.0, 0.5), (20.0, 0.0), (30.0, 1.0)]:
        law = dataclasses.replace(rne.control.pd_gravity(robot, gain, 5.0, 0.1), gravity=share)
        motion = rne.simulate(rne.Scene(robot, controller=law), [0.3, -0.2], [0, 0.5], 0.02)
        called = [law(t, q, qd) for t, q, qd in zip(motion.t, motion.q, motion.qd, strict=True)]
        np.testing.assert_allclose(motion.tau, called, rtol=1e-12, atol=1e-12)  # [N m], roundings of some 5 N m
    assert len(robot.kernels.laws) == 2  # with a share of gravity, and without
