"""Several kernels as one text in C: names that do not clash, errors of singular M, numbers that stay arguments."""

import ctypes
import shutil

import numpy as np
import pytest

import rne
from rne.kernels.units import unit
from rne.simulation.named_numbers import NamedNumbers

from .compiled_sources import c_library
from .helpers import gimbal, kept, relative, states

QUANTITIES = ("inverse_dynamics", "mass_matrix", "gravity_torque", "forward_dynamics", "friction_torque")
ROUNDING = 1e-13  # of the largest entry: another order of a few hundred operations
WITH_CC = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler here")
COM, INERTIA = (0.05, -0.1, 0.2), np.array([[0.03, 0.004, -0.002], [0.004, 0.05, 0.006], [-0.002, 0.006, 0.04]])
FRICTION = rne.Friction(viscous=2.0, coulomb=1.5, smoothing=0.05)


def loaded(robot, mass=0.0, friction=FRICTION, **changes):
    """A scene with a payload off the flange and its own axes."""
    payload = rne.Payload(mass, *((COM, INERTIA) if mass else ()), link="tool0")
    return rne.Scene(robot, payload=payload, friction=friction, mounting=(0.3, -0.2, 0.1), **changes)


@pytest.fixture(scope="module")
def arm():
    """Its numbers and functions, with payload, gravity and friction as arguments."""
    return NamedNumbers(loaded(rne.load("ur5")), ("payload", "gravity", "friction.viscous", "friction.coulomb"))


def asked(arm):
    """Numbers other than the scene's by the names of arguments, and the scene that has them."""
    inertia = INERTIA[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    numbers = {"payload": np.array([3.0, *COM, *inertia]), "gravity": np.array([0.4, -1.0, -9.0])}
    numbers |= {"friction_viscous": np.arange(6.0), "friction_coulomb": np.full(6, 0.7)}
    friction = rne.Friction(viscous=np.arange(6.0), coulomb=0.7, smoothing=0.05)
    return numbers, loaded(arm.scene.robot, 3.0, friction, gravity=numbers["gravity"])


def expected(scene, quantity, state):
    """A quantity of a scene by its own methods."""
    if quantity == "friction_torque":
        return scene.resolved.friction.torque(scene.robot.model, state["qd"])
    owner = scene if quantity in ("inverse_dynamics", "forward_dynamics") else scene.resolved.robot
    function = getattr(owner, quantity)
    names = getattr(rne.dynamics, quantity).quantity.widths
    return function(*(state[name] for name in names))


def test_numbers_as_arguments_are_those_of_another_scene(arm):
    numbers, scene = asked(arm)
    q, qd, qdd = states(6, 2, seed=3)
    state = {"q": q, "qd": qd, "qdd": qdd, "tau": 30 * qdd}
    for quantity in QUANTITIES:
        kernel = arm.kernel(quantity)
        given = [state.get(name, numbers.get(name)) for name in kernel.names]
        given = [np.broadcast_to(a, (2, a.shape[-1])) for a in given]
        assert relative(kernel(*given), expected(scene, quantity, state)) <= ROUNDING, quantity


def test_a_quantity_takes_only_the_numbers_that_it_can_depend_on(arm):
    taken = {quantity: (*arm.taken(quantity),) for quantity in QUANTITIES}
    assert taken == {
        "inverse_dynamics": arm.names,
        "mass_matrix": ("payload",),
        "gravity_torque": ("payload", "gravity"),
        "forward_dynamics": arm.names,
        "friction_torque": ("friction.viscous", "friction.coulomb"),
    }


def test_a_payload_as_argument_takes_at_most_1_8_times_the_operations():
    for name in ("ur5", "ur10", "panda", "irb140", "z1"):
        robot = rne.load(name)
        payload = rne.Payload(0.0, link=robot.link_names[-1])
        counts = [
            sum(NamedNumbers(scene, names).kernel("inverse_dynamics").operations.values())
            for scene, names in ((rne.Scene(robot), ()), (rne.Scene(robot, payload=payload), ("payload",)))
        ]
        assert counts[1] <= 1.8 * counts[0], (name, counts)


def test_the_mass_of_a_payload_alone_is_that_of_another_scene_with_fewer_operations():
    """Centre of mass, inertia about it and link stay those of the scene."""
    robot, q = rne.load("irb140"), states(6, 1, seed=5)[0]
    one, other = (rne.Scene(robot, payload=rne.Payload(mass, COM, INERTIA, "link_6")) for mass in (1.0, 3.0))
    kernels = [NamedNumbers(one, (name,)).kernel("mass_matrix") for name in ("payload.mass", "payload")]
    assert kernels[0].names == ("q", "payload_mass")
    assert relative(kernels[0](q, np.full((1, 1), 3.0)), other.resolved.robot.mass_matrix(q)) <= ROUNDING
    assert sum(kernels[0].operations.values()) < sum(kernels[1].operations.values())
    with pytest.raises(ValueError, match=r"^`numbers` must have 'payload\.mass' or 'payload', which contains it"):
        NamedNumbers(one, ("payload.mass", "payload"))


def test_gains_and_a_reference_are_arguments_of_the_law():
    robot = rne.load("irb140")
    scene = rne.Scene(robot, controller=rne.control.pd_gravity(robot, 50.0, 20.0, 0.1))
    kernel = NamedNumbers(scene, ("controller.kp", "controller.reference")).kernel("controller")
    assert kernel.names == ("t", "q", "qd", "controller_kp", "controller_reference")
    q, qd, reference = states(6, 1, seed=2)
    law = rne.control.pd_gravity(robot, 70.0, 20.0, reference[0])
    found = kernel(np.zeros((1, 1)), q, qd, np.full((1, 6), 70.0), reference)
    assert relative(found, law(0.0, q[0], qd[0])[None]) <= ROUNDING


def test_the_rates_of_a_scene_take_its_numbers(arm):
    numbers, scene = asked(arm)
    kernel, (q, qd, tau) = arm.kernel("rates"), states(6, 1, seed=4)
    given = {"t": np.zeros((1, 1)), "x": np.concatenate([q, qd], axis=1), "u": 20 * tau}
    found = kernel(*((given | {k: a[None] for k, a in numbers.items()})[name] for name in kernel.names))
    wanted = np.concatenate([qd, scene.forward_dynamics(q, qd, 20 * tau)], axis=1)
    assert relative(found, wanted) <= ROUNDING


def test_an_unknown_number_is_refused(arm):
    with pytest.raises(ValueError, match=r"^`numbers`: the scene has the numbers .*; got 'viscous'; did you mean"):
        NamedNumbers(arm.scene, ("viscous",))


def test_what_functions_share_stands_once():
    """A law within bounds takes minimum and maximum, in two of the functions; M of one may be singular."""
    bounded = rne.traceable(lambda t, q, qd: rne.elementwise.clip(q, -1.0, 1.0))
    functions = NamedNumbers(rne.Scene(rne.load("ur5"), controller=bounded))
    text = unit({key: functions.kernel(key) for key in ("controller", "rates", "mass_matrix")}, name="ur5")
    once = ("static double minimum(", "static double maximum(", "Joints in order", "NAN", "#include <math.h>")
    assert {part: text.source.count(part) for part in once} == dict.fromkeys(once, 1)
    assert text.header.count('extern "C"') == 1
    assert [f.name for f in text.functions.values()] == ["ur5_controller", "ur5_rates", "ur5_mass_matrix"]
    assert [f"{f.name}(" in text.header for f in text.functions.values()] == [True] * 3


@WITH_CC
@pytest.mark.parametrize("dtype", kept(["float64", "float32"], ["float64"]))
def test_two_robots_in_one_library(dtype, tmp_path, arm):
    numbers, _ = asked(arm)
    kernels = {key: arm.kernel(key) for key in QUANTITIES}
    other = NamedNumbers(loaded(rne.load("irb140")), ("payload",))
    texts = [unit(kernels, name="one", dtype=dtype)]
    texts.append(unit({key: other.kernel(key) for key in QUANTITIES}, name="two", dtype=dtype))
    for text, name in zip(texts, ("one", "two"), strict=True):
        (tmp_path / f"{name}.h").write_text(text.header)
    library = c_library([text.source for text in texts], tmp_path)
    q, qd, qdd = states(6, 1, seed=7)
    real = {"float64": ctypes.c_double, "float32": ctypes.c_float}[dtype]
    for key, function in texts[0].functions.items():
        state = {"q": q[0], "qd": qd[0], "qdd": qdd[0], "tau": 30 * qdd[0], **numbers}
        given = [state[name].astype(dtype) for name in function.taken]
        out = np.zeros(function.shape, dtype)
        pointers = [a.ctypes.data_as(ctypes.POINTER(real)) for a in (*given, out)]
        failed = getattr(library, function.name)(*pointers)
        wanted = kernels[key](*(a.astype(float) for a in given))
        tolerance = ROUNDING if dtype == "float64" else 1e-4  # single precision, M of condition 500
        assert np.abs(out - wanted).max() <= tolerance * np.abs(wanted).max()
        assert not function.may_fail or failed == 0


@WITH_CC
def test_a_singular_mass_matrix_is_an_error_and_no_numbers(tmp_path):
    kernel = rne.compile(rne.dynamics.forward_dynamics, gimbal())  # two axes are one at q = 0
    function = c_library([kernel.source("c", name="qdd")], tmp_path).qdd
    out, zero, bent = np.zeros(3), np.zeros(3), np.full(3, 0.5)
    for q, is_singular in ((zero, 1), (bent, 0), (np.full(3, np.nan), 1)):
        pointers = [a.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for a in (q, zero, zero, out)]
        assert function(*pointers) == is_singular
        assert np.isnan(out).all() == bool(is_singular)
