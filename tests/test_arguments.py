"""Shapes broadcast, wrong arguments are refused with the exact words."""

import inspect
import re
from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import mutually_broadcastable_shapes

import rne

from .random_robots import random_tree

TREE = random_tree(3, seed=9)
BASE = rne.load("irb140").base_parameters()


@settings(max_examples=20, deadline=None, derandomize=True)
@given(mutually_broadcastable_shapes(num_shapes=3, max_dims=3, max_side=3), st.integers(0, 2**32 - 1))
def test_leading_axes_broadcast_as_single_states_would(shapes, seed):
    rng = np.random.default_rng(seed)
    q, qd, x = (rng.normal(size=(*shape, 3)) for shape in shapes.input_shapes)
    got = rne.dynamics.inverse_dynamics(TREE, q, qd, x)
    assert got.shape == (*shapes.result_shape, 3)
    assert rne.dynamics.forward_dynamics(TREE, q, qd, x).shape == got.shape
    assert rne.dynamics.mass_matrix(TREE, q).shape == (*q.shape, 3)
    assert rne.dynamics.kinetic_energy(TREE, q, qd).shape == np.broadcast_shapes(q.shape, qd.shape)[:-1]
    full = [np.broadcast_to(v, got.shape).reshape(-1, 3) for v in (q, qd, x)]
    single = np.array([rne.dynamics.inverse_dynamics(TREE, *s) for s in zip(*full, strict=True)]).reshape(got.shape)
    np.testing.assert_allclose(got, single, rtol=0, atol=1e-13 * max(1, np.abs(single).max(initial=0)))


def test_arguments_are_not_changed():
    q = np.linspace(0, 1, 3)
    before = q.copy()
    rne.dynamics.forward_dynamics(TREE, q, q, q)
    assert np.array_equal(q, before)


def refused(call, text, error=ValueError):
    with pytest.raises(error, match="^" + re.escape(text) + "$"):
        call()


def test_an_array_of_a_wrong_length_is_refused(irb140):
    refused(lambda: irb140.gravity_torque(np.zeros(5)), "`q` must have shape (..., 6) for robot 'irb140', got (5,)")


def test_a_number_is_no_state(irb140):
    refused(lambda: irb140.gravity_torque(0.0), "`q` must have shape (..., 6) for robot 'irb140', got ()")


def test_transposed_batch_is_named(irb140):
    refused(
        lambda: irb140.gravity_torque(np.zeros((6, 100))),
        "`q` must have shape (..., 6) for robot 'irb140', got (6, 100); states go along the first axis: "
        "pass `q`.T, of shape (100, 6)",
    )


def test_nan_is_refused_with_its_place(irb140):
    q = np.zeros((3, 6))
    q[2, 1] = np.nan
    refused(lambda: irb140.mass_matrix(q), "`q` must be finite, got nan at index (2, 1)")


def test_infinity_is_refused_in_every_argument(irb140):
    qd = [0, 0, np.inf, 0, 0, 0]
    refused(lambda: irb140.bias_torque([0] * 6, qd), "`qd` must be finite, got inf at index (2,)")


def test_words_are_no_numbers(irb140):
    text = "`q` must be an array of numbers of shape (..., 6), got dtype <U1"
    refused(lambda: irb140.gravity_torque(["a"] * 6), text)


def test_nothing_and_objects_are_no_numbers():
    text = "`q` must be an array of numbers of shape (..., 3), got dtype object"
    refused(lambda: rne.dynamics.gravity_torque(TREE, [None] * 3), text)
    refused(lambda: rne.dynamics.gravity_torque(TREE, None), text)
    refused(lambda: rne.Robot(TREE).gravity_torque([{1}] * 3), text)


def test_symbols_are_refused_with_the_way_to_have_them(irb140):
    class Symbol:
        def __array__(self, dtype=None, copy=None):
            raise TypeError("no numbers")

    with pytest.raises(TypeError, match=r"^no numbers$"):
        irb140.gravity_torque(Symbol())
    Symbol.__module__ = "casadi.casadi"
    text = "`q` must be an array of numbers, got symbols of casadi: make a function of them, as by "
    text += "robot.kernel(rne.dynamics.inverse_dynamics).to_casadi()"
    with pytest.raises(TypeError, match=f"^{re.escape(text)}$"):
        irb140.gravity_torque(Symbol())


def test_the_engine_of_a_robots_kernels_is_its_own(irb140):
    with pytest.raises(TypeError, match=r"^`engine` is the robot's: give it to rne.load or rne.Robot, or to rne.comp"):
        irb140.kernel(rne.dynamics.inverse_dynamics, engine="numba")


def test_numbers_beyond_double_are_refused(irb140):
    with pytest.raises(ValueError, match=r"^`q` must be numbers within the range of float64$"):
        irb140.gravity_torque([10**400] * 6)


def test_python_numbers_in_an_object_array_are_numbers(irb140):
    q = np.array([Fraction(1, 2)] * 6, dtype=object)
    assert np.array_equal(irb140.gravity_torque(q), irb140.gravity_torque([0.5] * 6))
    slopes = rne.kernels.derivative(rne.dynamics.gravity_torque, rne.irb140(), "q")
    assert np.array_equal(slopes(q), slopes(np.full(6, 0.5)))


@pytest.mark.parametrize("positions", [None, ["joint_1"]])
def test_locked_takes_a_mapping(irb140, positions):
    with pytest.raises(
        TypeError, match=rf"to positions, such as \{{'joint_6': 0.0\}}, got {type(positions).__name__}$"
    ):
        irb140.locked(positions)


def test_joints_are_locked_at_one_position_each(irb140):
    with pytest.raises(ValueError, match=r"^`positions\['joint_2'\]` must be one number, got shape \(2,\)$"):
        irb140.locked({"joint_1": 0.0, "joint_2": [0.0, 1.0]})


def test_couplings_are_refused_or_dropped_in_a_file():
    with pytest.raises(ValueError, match=r'^`couplings` must be "raise" or "drop", got \'keep\'$'):
        rne.to_urdf(rne.irb140(), couplings="keep")


def test_a_name_that_xml_cannot_hold_is_refused():
    with pytest.raises(
        ValueError, match=r"^'a\\x00b' cannot be written to XML, which has no control characters; rename it$"
    ):
        rne.to_urdf(replace(rne.irb140(), name="a\x00b"))


def test_half_precision_is_computed_in_single(irb140):
    assert irb140.gravity_torque(np.ones(6, np.float16)).dtype == np.float32


def test_ragged_rows_are_refused():
    refused(
        lambda: rne.dynamics.gravity_torque(TREE, [[0, 1], [2]]),
        "`q` must be an array of numbers of shape (..., 3), got rows of unequal length",
    )


def test_leading_shapes_that_do_not_fit_are_refused():
    refused(
        lambda: rne.dynamics.bias_torque(TREE, np.zeros((2, 3)), np.zeros((5, 3))),
        "leading shapes must broadcast against each other, got `q` (2, 3), `qd` (5, 3)",
    )


def test_overflow_is_an_error_not_an_infinity():
    refused(
        lambda: rne.dynamics.coriolis_torque(TREE, np.ones(3), np.full(3, 1e200)),
        "coriolis_torque overflows float64 for these arguments; the result is not finite",
    )


def test_external_on_an_unknown_link_is_refused():
    refused(
        lambda: rne.dynamics.bias_torque(TREE, np.zeros(3), np.zeros(3), external={"hand": np.zeros(6)}),
        f"`external` must name links of {list(TREE.link_names)}, got 'hand'",
    )


def test_external_of_a_wrong_shape_is_refused():
    refused(
        lambda: rne.dynamics.bias_torque(TREE, np.zeros(3), np.zeros(3), external={"link0": np.zeros(3)}),
        "`external['link0']` must have shape (..., 6), [moment; force], got (3,)",
    )


def test_external_that_is_no_mapping_is_refused():
    refused(
        lambda: rne.dynamics.bias_torque(TREE, np.zeros(3), np.zeros(3), external=np.zeros(6)),
        "`external` must be a mapping of link name to wrench, got ndarray",
    )


def test_external_batches_broadcast_too():
    wrench = np.random.default_rng(0).normal(size=(4, 6))
    got = rne.dynamics.bias_torque(TREE, np.zeros(3), np.zeros(3), external={"link2": wrench})
    assert got.shape == (4, 3)


def test_jacobian_of_an_unknown_link_is_refused():
    names = list(TREE.link_names)
    refused(lambda: rne.dynamics.jacobian(TREE, np.zeros(3), "hand"), f"`link` must be one of {names}, got 'hand'")


def test_a_robot_is_not_a_model(irb140):
    refused(
        lambda: rne.dynamics.gravity_torque(irb140, np.zeros(6)),
        "`model` must be an rne.Model, got Robot; a Robot has it as .model",
        TypeError,
    )
    refused(lambda: rne.Robot("irb140"), "`model` must be an rne.Model, got str", TypeError)


def test_load_refuses_what_is_neither_name_nor_file():
    refused(
        lambda: rne.load("irb14"),
        "'irb14' is neither a file nor one of rne.robots(); did you mean 'irb140'?",
        FileNotFoundError,
    )


def test_gravity_of_a_wrong_shape_is_refused():
    refused(lambda: rne.load("irb140", gravity=[9.81]), "`gravity` must have shape (3,), got (1,)")


def test_gravity_is_a_keyword_of_load():
    weightless = rne.load("irb140", gravity=[0, 0, 0])
    assert not weightless.gravity_torque(np.ones(6)).any()


class TestSingularMassMatrix:
    def test_massless_joint_is_named(self):
        bodies = {"masses": [1.0, 0.0], "centres": [[0, 1.0, 0], [0, 0, 0]], "inertias": np.zeros((2, 3))}
        arm = rne.dh_chain(a=[0, 0], alpha=[0, 0], d=[0, 0], theta=[0, 0], joint_names=["j1", "j2"], **bodies)
        with pytest.raises(rne.SingularMassMatrixError) as caught:
            rne.dynamics.forward_dynamics(arm, [0, 0], [0, 0], [0, 0])
        assert str(caught.value) == "M is singular: nothing with inertia moves with 'j2'"
        assert caught.value.joints == ("j2",)
        assert isinstance(caught.value, np.linalg.LinAlgError)

    @pytest.mark.parametrize("forward", [rne.dynamics.forward_dynamics, rne.dynamics.articulated_forward_dynamics])
    def test_two_parallel_sliders_are_named(self, forward):
        table = {column: [0, 0, 0] for column in ("a", "alpha", "d", "theta")}
        bodies = {"masses": [0, 1.3, 0.7], "centres": [[0, 0, 0], [0, 0, 0], [0.1, 0.3, 0.2]]}
        types, names = ["prismatic", "prismatic", "revolute"], ["left", "right", "swing"]
        arm = rne.dh_chain(**table, **bodies, inertias=np.zeros((3, 3)), types=types, joint_names=names)
        q = np.array([[0.1, 0.2, 0.3], [0.5, -0.7, 1.1]])
        with pytest.raises(rne.SingularMassMatrixError) as caught:
            forward(arm, q, q, q)
        assert caught.value.joints == ("left", "right")
        assert str(caught.value).startswith(
            "M is singular to working precision at state (0,): a combined motion of 'left', 'right' moves no inertia"
        )


def test_one_number_stands_for_every_joint(small):
    for value, expected in ((2, [2.0, 2.0, 2.0]), ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])):
        array = rne.control.pd(small, value, 1.0, 0.0).kp
        assert array.tolist() == expected
        assert array.dtype == np.float64
        assert not array.flags.writeable


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([1.0, 2.0], "`kp` must have shape (3,), got (2,)"),
        ([[1.0]], "`kp` must have shape (3,), got (1, 1)"),
        (np.nan, "`kp` must be finite, got nan at index ()"),
        (1j, "`kp` must be real, got dtype complex128"),
        ("1", "`kp` must be an array of numbers of shape (3,), got dtype <U1"),
    ],
)
def test_what_is_no_number_per_joint_is_refused(small, value, message):
    refused(lambda: rne.control.pd(small, value, 1.0, 0.0), message)


HIDDEN = np.ma.masked_array([0.1, 0.2, 0.3], mask=[False, True, False])
MASKED = "must have no masked entries, got 1 of 3; fill them or leave their rows out"


@pytest.fixture(scope="module")
def small():
    return rne.Robot(TREE)


@pytest.mark.parametrize(
    "method",
    ["inverse_dynamics", "forward_dynamics", "bias_torque", "coriolis_torque", "kinetic_energy", "recursion", "kernel"],
)
def test_numbers_behind_a_mask_are_not_used(small, method):
    """At the first call, which runs the recursion, and at the next ones, which run the kernel."""
    count = 2 if method in ("bias_torque", "coriolis_torque", "kinetic_energy") else 3
    call = small.kernel(rne.dynamics.inverse_dynamics) if method == "kernel" else getattr(small, method)
    names = ("q", "qd", "tau" if method == "forward_dynamics" else "qdd")[:count]
    for k, name in enumerate(names):
        arrays = [HIDDEN if j == k else np.zeros(3) for j in range(count)]
        for _ in range(2):
            refused(lambda arrays=arrays: call(*arrays), f"`{name}` {MASKED}")
    batch = np.ma.stack([HIDDEN, HIDDEN])
    text = "`q` must have no masked entries, got 2 of 6; fill them or leave their rows out"
    refused(lambda: call(batch, *[np.zeros(3)] * (count - 1)), text)
    refused(lambda: call(list(batch), *[np.zeros(3)] * (count - 1)), f"`q` {MASKED}")


def test_masked_entries_of_other_arrays_are_refused(small):
    eye = np.broadcast_to(np.eye(3), (3, 3, 3))
    refused(lambda: rne.simulate(small, HIDDEN, np.zeros(3), 0.1), f"`q0` {MASKED}")
    refused(lambda: rne.model.chain(eye, np.zeros((3, 3)), lower=HIDDEN), f"`lower` {MASKED}")
    refused(lambda: rne.dh_chain(a=HIDDEN, alpha=[0] * 3, d=[0] * 3, theta=[0] * 3), f"`a` {MASKED}")
    refused(lambda: replace(TREE, mass=HIDDEN), f"`mass` {MASKED}")
    refused(lambda: rne.load("irb140", gravity=HIDDEN), f"`gravity` {MASKED}")
    refused(lambda: rne.trajectories.quintic(HIDDEN, HIDDEN, 1.0), f"`start` {MASKED}")
    refused(lambda: rne.trajectories.quintic([0], [1], 1.0)(HIDDEN), f"`t` {MASKED}")
    refused(lambda: rne.trajectories.spline(HIDDEN, np.zeros((3, 1))), f"`t` {MASKED}")
    refused(lambda: rne.trajectories.spline([0, 1, 2], np.zeros((3, 1)))(HIDDEN), f"`t` {MASKED}")
    refused(lambda: small.with_payload(1.0, com=HIDDEN), f"`com` {MASKED}")
    refused(lambda: rne.elementwise.tanh(HIDDEN), f"`x` {MASKED}")


def test_a_mask_that_hides_nothing_is_no_mistake(small):
    shown = np.ma.masked_array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(small.gravity_torque(shown), small.gravity_torque(shown.data), rtol=1e-12)


def test_signs_that_are_asked_for(small):
    law = rne.control.pd(small, [0.0, 1.0, 0.5], 1.0, [-1.0, 0.0, 1.0])
    assert (law.kp.tolist(), law.reference.tolist()) == ([0.0, 1.0, 0.5], [-1.0, 0.0, 1.0])
    refused(lambda: rne.control.pd(small, [-1.0, 1.0, 0.0], 1.0, 0.0), "`kp` must not be negative, got -1.0")
    refused(lambda: rne.check_gains(small, [0.0, 1.0, 0.5], 1.0), "`kp` must be positive, got 0.0")


@pytest.mark.parametrize(
    ("shape", "name", "right", "wrong", "call"),
    [
        ("()", "angle", [()], [(1,), (0,)], lambda x: rne.model.slider_crank("j", crank=1, rod=2, angle=x)),
        ("(3,)", "gravity", [(3,)], [(), (2,), (3, 1), (0,)], lambda x: rne.load("irb140", gravity=x)),
        ("(30,), ten per body", "parameters", [(30,)], [(), (3, 10)], lambda x: rne.model.with_parameters(TREE, x)),
        (
            "(n, 3, 3)",
            "rotations",
            [(0, 3, 3)],
            [(3,), (3, 3), (2, 3, 5)],
            lambda x: rne.model.chain(x, np.zeros((0, 3))),
        ),
        ("(..., 36)", "beta", [(36,), (2, 36), (3, 2, 36)], [(), (5,), (36, 2)], BASE.standard_parameters),
    ],
)
def test_arrays_of_another_shape_are_refused(shape, name, right, wrong, call):
    for size in right:
        call(np.zeros(size))
    for size in wrong:
        refused(lambda size=size: call(np.zeros(size)), f"`{name}` must have shape {shape}, got {size}")


def test_mpmath_numbers_beside_pythons_keep_their_digits():
    slides = rne.dh_chain(a=[0, 0], alpha=[0, 0], d=[0, 0], theta=[0, 0], types="prismatic")
    with mpmath.workdps(40):
        third = mpmath.mpf(1) / 3
        assert rne.dynamics.link_poses(slides, [third, 2.0])[1, 2, 3] == third


DEFAULTS = """bounds: tolerance 0.05, budget 90 | base_parameters: tolerance 1e-09 | trusted_horizon: accuracy 0.001
simulate: rtol 1e-06, atol 1e-09 | ensemble: rtol 1e-06, atol 1e-09 | dh_chain: offset 0 | view: speed 1
animate: fps 20, speed 1 | drives: gear 1, rotor 0, efficiency 1 | Friction: viscous 0, coulomb 0, smoothing 0.01, stribeck_rise 0, load 0, offset 0
compare_models: tolerance 1e-08, seed 0 | identify: folds 10 | Record: bridge 3
excitation: harmonics 5, starts 3, iterations 150 | sample: periods 1 | to_csv: periods 1
MomentumObserver: gain 200, friction_error 0, floor 0 | adaptive: gain 1, smoothing 0.01 | pid: windup inf
sliding_mode: reaching 1 | uncertainty_bound: samples 4000, margin 1.2, seed 0"""


def test_numbers_that_are_taken_where_none_is_given():
    """A default is a promise: with another one the same call has another result."""
    functions = {name: getattr(rne.Robot, name) for name in ("bounds", "base_parameters")}
    functions |= {
        name: getattr(rne, name) for name in ["simulate", "ensemble", "dh_chain", "view", "drives", "Friction"]
    }
    functions |= {name: getattr(rne, name) for name in ["compare_models", "identify", "excitation"]}
    functions |= {name: getattr(rne.Excitation, name) for name in ("sample", "to_csv")}
    functions |= {"trusted_horizon": rne.Trajectory.trusted_horizon, "animate": rne.plotting.animate}
    functions |= {"Record": rne.identification.Record}
    laws = ["MomentumObserver", "adaptive", "pid", "sliding_mode", "uncertainty_bound"]
    functions |= {name: getattr(rne.control, name) for name in laws}
    told = dict(part.split(": ") for line in DEFAULTS.splitlines() for part in line.split(" | "))
    for name, function in functions.items():
        parameters = inspect.signature(function).parameters.values()
        numbers = [p for p in parameters if type(p.default) in (int, float)]
        assert told.pop(name) == ", ".join(f"{p.name} {p.default:g}" for p in numbers), name
    assert told == {}
