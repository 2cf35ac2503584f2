"""Inertial parameters as an input of kernels: many variants of a robot in one call, and the same as one Robot each."""

import importlib.util
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest

import rne
from rne.dynamics.quantity import quantity
from rne.model.parameters import at_parameters

from .conftest import TREES
from .helpers import first_joints, kept
from .random_robots import random_tree

SAME = 1e-13  # of the largest entry: another order of operations, and centres of mass divided out and multiplied back
SOLVED = 1e-10  # the same times the condition of M, up to some 1000
VARIANTS = 4

# By method: its function and the number of its joint arrays.
METHODS = {
    "inverse_dynamics": (rne.dynamics.inverse_dynamics, 3),
    "mass_matrix": (rne.dynamics.mass_matrix, 1),
    "forward_dynamics": (rne.dynamics.forward_dynamics, 3),
    "bias_torque": (rne.dynamics.bias_torque, 2),
    "gravity_torque": (rne.dynamics.gravity_torque, 1),
    "coriolis_torque": (rne.dynamics.coriolis_torque, 2),
    "coriolis_matrix": (rne.dynamics.coriolis_matrix, 2),
    "kinetic_energy": (rne.dynamics.kinetic_energy, 2),
    "potential_energy": (rne.dynamics.potential_energy, 1),
    "momentum": (rne.dynamics.momentum, 2),
}


def moved_origins():
    """A tree whose joints' frames in the URDF are not at the origins of the bodies' frames."""
    model = random_tree(3, seed=1, prismatic=0.5)
    moves = np.random.default_rng(7).uniform(-0.2, 0.2, model.nb)
    translation = model.link_translation.copy()
    for i, joint in enumerate(model.moving_joints):
        translation[model.link_joints.index(joint)] = moves[i] * model.axis[i]
    return replace(model, link_translation=translation)


def robot_of(name):
    return rne.Robot(moved_origins() if name == "moved origins" else TREES[name]) if name in MODELS else rne.load(name)


MODELS = [*TREES, "moved origins"]
BY_MOMENTS = [
    name
    for name in rne.dynamics.__all__
    if getattr(getattr(getattr(rne.dynamics, name), "quantity", None), "moments", False)
    and not name.startswith("task_")  # they need a link
]


@pytest.fixture(params=kept(["irb140", "panda", *MODELS], ["mimics", "moved origins"]), scope="module")
def robot(request):
    return robot_of(request.param)


def variants(robot, count=VARIANTS, spread=0.2):
    """Parameters of possible bodies: each body's own, all by one factor."""
    factors = np.random.default_rng(1).uniform(1 - spread, 1 + spread, (count, robot.model.nb, 1))
    return (factors * robot.parameters.reshape(-1, 10)).reshape(count, -1)


def random_states(robot, arrays=3, count=VARIANTS):
    return np.random.default_rng(0).uniform(-2, 2, (arrays, count, robot.n))


def close(got, expected, bound=SAME, size=0.0):
    """Equal to a bound relative to the largest entry, or to a larger size of the terms that cancel in it."""
    got, expected = np.asarray(got), np.asarray(expected)
    assert got.shape == expected.shape
    assert np.abs(got - expected).max(initial=0) <= bound * max(np.abs(expected).max(initial=1e-300), size)


def one_robot_each(robot, method, arrays, parameters, **options):
    """A loop over robots with these parameters."""
    robots = [robot.with_parameters(pi) for pi in parameters]
    return np.array([getattr(r, method)(*s, **options) for r, *s in zip(robots, *arrays, strict=True)])


@pytest.mark.parametrize("method", METHODS)
def test_variants_are_robots_with_these_parameters(robot, method):
    pi, arrays = variants(robot), random_states(robot, METHODS[method][1])
    expected = one_robot_each(robot, method, arrays, pi)
    bound = SOLVED if method == "forward_dynamics" else SAME
    size = np.abs(robot.mass_matrix(arrays[0])).max()  # C of one joint is zero but for rounding
    for _ in range(2):  # one state: the recursion at the first call of this robot, the kernel at the second
        close(getattr(robot, method)(*(a[0] for a in arrays), parameters=pi[0]), expected[0], bound, size)
    close(getattr(robot, method)(*arrays, parameters=pi), expected, bound, size)
    close(METHODS[method][0].evaluate(robot.model, *arrays, parameters=pi)[0], expected, bound, size)


@pytest.mark.parametrize("name", BY_MOMENTS)
def test_moments_are_all_that_is_read_of_the_bodies(name):
    """Of every function that takes parameters as an input: its masses, centres and inertias may be anything else."""
    function, robot = getattr(rne.dynamics, name), robot_of("moved origins")
    count = len(function.quantity.widths)
    arrays = random_states(robot, count)
    at = at_parameters(robot.model, variants(robot))
    expected = function(at, *arrays)
    for field in ("mass", "com", "inertia"):
        at.__dict__[field] = np.full_like(getattr(at, field), np.nan)
    assert np.array_equal(function(at, *arrays), expected)


def test_states_and_parameters_broadcast(robot):
    pi, arrays = variants(robot), random_states(robot)
    one = [a[0] for a in arrays]
    close(
        robot.inverse_dynamics(*one, parameters=pi),
        one_robot_each(robot, "inverse_dynamics", [[a] * 4 for a in one], pi),
    )
    grid = robot.inverse_dynamics(*(a[:3, None] for a in arrays), parameters=pi)
    assert grid.shape == (3, VARIANTS, robot.n)
    close(grid[2, 1], robot.with_parameters(pi[1]).inverse_dynamics(*(a[2] for a in arrays)))
    close(robot.mass_matrix(arrays[0], parameters=robot.parameters), robot.mass_matrix(arrays[0]))


def test_external_wrenches_and_parameters_together(irb140):
    pi, arrays = variants(irb140), random_states(irb140)
    pull = {"tool0": np.arange(6.0), "link_3": np.ones((VARIANTS, 6))}
    for method in ("inverse_dynamics", "forward_dynamics", "bias_torque"):
        taken = arrays[: METHODS[method][1]]
        expected = np.array(
            [
                getattr(irb140.with_parameters(pi[k]), method)(
                    *(a[k] for a in taken), external={"tool0": pull["tool0"], "link_3": pull["link_3"][k]}
                )
                for k in range(VARIANTS)
            ]
        )
        close(getattr(irb140, method)(*taken, external=pull, parameters=pi), expected, SOLVED)
    kernel = rne.compile(rne.dynamics.bias_torque, irb140.model, external=["tool0"], parameters=True)
    assert kernel.names == ("q", "qd", "external_1", "parameters")


class TestLaws:
    def test_torques_are_linear_in_the_parameters(self, robot):
        """For any numbers, rotors apart."""
        q, qd, qdd = random_states(robot)
        a, b = np.random.default_rng(2).normal(size=(2, VARIANTS, 10 * robot.model.nb))
        rotors = robot.inverse_dynamics(q, qd, qdd, parameters=0 * a)

        def tau(pi):
            return robot.inverse_dynamics(q, qd, qdd, parameters=pi) - rotors

        close(tau(2 * a - 3 * b), 2 * tau(a) - 3 * tau(b))
        close(tau(a), (robot.regressor(q, qd, qdd) @ a[..., None])[..., 0])

    def test_m_of_possible_bodies_is_positive_definite(self, robot):
        M = robot.mass_matrix(random_states(robot, 1)[0], parameters=variants(robot))
        assert np.array_equal(M, np.swapaxes(M, -1, -2))
        assert (np.linalg.eigvalsh(M) > 0).all()

    def test_kinetic_energy_is_that_of_m(self, robot):
        (q, qd), pi = random_states(robot, 2), variants(robot)
        M = robot.mass_matrix(q, parameters=pi)
        close(robot.kinetic_energy(q, qd, parameters=pi), np.einsum("ki,kij,kj->k", qd, M, qd) / 2, 10 * SAME)

    def test_forward_and_inverse_dynamics_agree(self, robot):
        (q, qd, qdd), pi = random_states(robot), variants(robot)
        tau = robot.inverse_dynamics(q, qd, qdd, parameters=pi)
        close(robot.forward_dynamics(q, qd, tau, parameters=pi), qdd, SOLVED)

    def test_the_derivative_by_the_parameters_is_the_regressor(self, robot):
        (q, qd, qdd), pi = random_states(robot), variants(robot)
        slopes = rne.kernels.derivative(rne.dynamics.inverse_dynamics, robot.model, "parameters", parameters=True)
        close(slopes(q, qd, qdd, pi), robot.regressor(q, qd, qdd))
        close(slopes(q[0], qd[0], qdd[0], pi[0]), robot.regressor(q[0], qd[0], qdd[0]))

    def test_derivatives_of_accelerations_by_the_parameters(self):
        """From M qdd + h = tau: dqdd/dpi = -M^-1 Y, with Y at these accelerations."""
        robot = robot_of("moved origins")
        (q, qd, tau), pi = random_states(robot), variants(robot)
        qdd = robot.forward_dynamics(q, qd, tau, parameters=pi)
        expected = -np.linalg.solve(robot.mass_matrix(q, parameters=pi), robot.regressor(q, qd, qdd))
        got = robot.kernel(rne.dynamics.forward_dynamics, "parameters", parameters=True)(q, qd, tau, pi)
        close(got, expected, SOLVED)

    def test_derivatives_by_the_state_are_those_of_the_variant(self):
        robot = robot_of("moved origins")
        (q, qd), pi = random_states(robot, 2), variants(robot)
        kernel = rne.kernels.derivative(rne.dynamics.bias_torque, robot.model, "q", "qd", parameters=True)
        expected = [
            rne.kernels.derivative(rne.dynamics.bias_torque, robot.with_parameters(pi[k]).model, "q", "qd")(q[k], qd[k])
            for k in range(VARIANTS)
        ]
        close(kernel(q, qd, pi), np.array(expected), 10 * SAME)


def test_complex_steps_are_the_traced_derivatives(irb140):
    """The first derivative of a state is taken by complex steps of the recursion, later ones by the kernel."""
    (q, qd), pi = random_states(irb140, 2), variants(irb140)
    cache = rne.Robot(irb140.model).kernels
    first, again = (
        cache.evaluate_quantity(rne.dynamics.bias_torque, q[0], qd[0], wrt=("parameters",), parameters=pi[0])
        for _ in range(2)
    )
    close(first, again)
    close(first, irb140.regressor(q[0], qd[0], 0 * q[0]))


@pytest.mark.parametrize("dtype", [np.float32, np.longdouble])
def test_other_precisions(irb140, dtype):
    (q, qd, qdd), pi = (x.astype(dtype) for x in random_states(irb140)), variants(irb140).astype(dtype)
    tau = irb140.inverse_dynamics(q, qd, qdd, parameters=pi)
    assert tau.dtype == dtype
    wide = irb140.inverse_dynamics(*(x.astype(float) for x in (q, qd, qdd)), parameters=pi.astype(float))
    close(tau.astype(float), wide, 1e-5 if dtype == np.float32 else SAME)
    assert irb140.inverse_dynamics(q, qd, qdd, parameters=variants(irb140)).dtype == np.result_type(dtype, float)


def test_within_a_law_that_is_traced(irb140):
    """Gravity compensation with parameters that are the law's own."""
    pi = variants(irb140)[0]

    @rne.traceable
    def law(t, q, qd):
        return irb140.gravity_torque(q, parameters=pi) - qd

    q0 = np.full(6, 0.3)
    scene = rne.Scene(irb140.with_parameters(pi), controller=law)
    motions = rne.ensemble(scene, q0[None], np.zeros((1, 6)), 0.01, step=1e-3)
    assert np.abs(motions.q[-1] - q0).max() <= 1e-12


def test_threads_give_the_same_bits(irb140):
    kernel = irb140.kernel(rne.dynamics.mass_matrix, parameters=True)
    q, pi = random_states(irb140, 1, 50)[0], variants(irb140, 50)
    assert (kernel(q, pi, workers=2) == kernel(q, pi)).all()


def test_pickling(irb140):
    kernel = irb140.kernel(rne.dynamics.inverse_dynamics, parameters=True)
    again, arrays, pi = pickle.loads(pickle.dumps(kernel)), random_states(irb140), variants(irb140)
    assert again.function is kernel.function
    assert again.names == kernel.names == ("q", "qd", "qdd", "parameters")
    assert (again(*arrays, pi) == kernel(*arrays, pi)).all()
    assert "at parameters given" in repr(again)


class TestSource:
    def test_the_heading_says_what_the_parameters_are(self):
        model = robot_of("panda").model
        text = rne.compile(rne.dynamics.gravity_torque, model, parameters=True).source()
        comment = " ".join(line[1:].strip() for line in text.splitlines() if line.startswith("#"))
        assert (
            "parameters - ten per body: m kg, m cx, m cy, m cz kg m, Ixx, Ixy, Iyy, Ixz, Iyz, Izz kg m^2, about the "
            "origin of the body's joint frame in the URDF, in its axes Bodies by their joints - 1 panda_joint1, "
        ) in comment
        assert "9 panda_finger_joint2" in comment
        assert "def gravity_torque(q, parameters):" in text

    @pytest.mark.parametrize(
        "function",
        [
            rne.dynamics.regressor,
            rne.dynamics.control_regressor,
            rne.dynamics.kinetic_energy_regressor,
            rne.dynamics.potential_energy_regressor,
        ],
        ids=lambda f: f.__name__,
    )
    def test_the_heading_of_a_regressor_lists_its_columns(self, irb140, function):
        comment = irb140.kernel(function).source().split("from math")[0].replace("\n#  ", "")
        assert "Columns of the result - ten per body: m kg, m cx, m cy, m cz kg m, Ixx, Ixy, Iyy, Ixz, Iyz" in comment
        assert "Bodies by their joints - 1 joint_1, 2 joint_2, " in comment

    def test_the_printed_function_runs(self, irb140):
        kernel, space = irb140.kernel(rne.dynamics.mass_matrix, parameters=True), {}
        exec(kernel.source("python"), space)
        q, pi = random_states(irb140, 1)[0][0], variants(irb140)[0]
        close(np.reshape(space["mass_matrix"](q, pi), (6, 6)), kernel(q, pi))


class TestVerdicts:
    """Of a batch of variants, one that cannot be accelerated is named by its place."""

    def changed(self, robot, k, change):
        pi = variants(robot)
        pi[k, 50:] = change(pi[k, 50:])  # of the last body
        pi[k, 40:50] = change(pi[k, 40:50])
        return pi

    @pytest.mark.parametrize(
        ("change", "text"),
        [
            (lambda x: 0 * x, "M is singular{}: nothing with inertia moves with 'joint_5', 'joint_6'"),
            (lambda x: -x, "M is not positive definite{}: a motion of 'joint_5', 'joint_6' moves negative inertia"),
        ],
    )
    def test_singular_variants_are_refused(self, irb140, change, text):
        pi, arrays = self.changed(irb140, 2, change), random_states(irb140)
        calls = {
            " at state (2,)": lambda: irb140.forward_dynamics(*arrays, parameters=pi),
            "": lambda: irb140.forward_dynamics(*(a[2] for a in arrays), parameters=pi[2]),
            " at state (1, 2)": lambda: irb140.forward_dynamics(*arrays, parameters=np.array([variants(irb140), pi])),
        }
        for where, call in calls.items():
            with pytest.raises(rne.SingularMassMatrixError, match=f"^{re.escape(text.format(where))}$"):
                call()

    def test_nearly_singular_variants_are_warned_of(self):
        """Two joints on one axis, with a little inertia between them in one of the variants."""
        eye, zero = np.eye(3), np.zeros((2, 3))
        robot = rne.Robot(rne.model.chain([eye] * 2, zero, [1, 1], zero, [eye, eye]))
        pi = np.tile(robot.parameters, (3, 1))
        pi[1, 4:10] *= 1e-14
        with pytest.warns(rne.PrecisionWarning, match=r"digits at state \(1,\): M is nearly singular"):
            robot.forward_dynamics([0, 0], [0, 0], [1, 1], parameters=pi)

    def test_fast_rates_are_warned_of(self, irb140):
        pi, qd = variants(irb140), np.ones((VARIANTS, 6))
        qd[3] = 3e7
        q = random_states(irb140, 1)[0]
        tau = irb140.bias_torque(q, qd, parameters=pi)
        with pytest.warns(rne.PrecisionWarning, match=r"digits at state \(3,\): the torques and C qd \+ g cancel"):
            irb140.forward_dynamics(q, qd, tau, parameters=pi)


class TestEnsembles:
    def arguments(self, robot, count=5):
        starts = np.random.default_rng(3).uniform(-1, 1, (count, robot.n))
        return (starts, 0 * starts, 0.05), {"step": 5e-3, "keep": 3}

    def scenes(self, robot, given):
        """Two scenes: free with friction, and under a law that keeps the parameters of `robot`."""
        control = rne.control.pd_gravity(robot, *(np.full(robot.n, x) for x in (2.0, 0.2, 0.2)))
        return {
            "friction": rne.Scene(given, friction=rne.Friction(viscous=0.3, coulomb=0.1, smoothing=0.1)),
            "law": rne.Scene(given, controller=control),
        }

    @pytest.mark.parametrize(
        ("kind", "method"),
        kept(
            [(kind, method) for kind in ("friction", "law") for method in ("rk4", "semi-implicit-euler")],
            [("friction", "rk4"), ("law", "semi-implicit-euler")],
        ),
    )
    def test_motions_are_those_of_robots_with_these_parameters(self, kind, method):
        arm = first_joints()
        (q0, qd0, duration), options = self.arguments(arm)
        pi = variants(arm, len(q0))
        found = rne.ensemble(self.scenes(arm, arm)[kind], q0, qd0, duration, parameters=pi, method=method, **options)
        assert (found.parameters == pi).all()
        for k in (0, 4):
            scene = self.scenes(arm, arm.with_parameters(pi[k]))[kind]
            alone = rne.ensemble(scene, q0[k : k + 1], qd0[k : k + 1], duration, method=method, **options)
            for name in ("q", "qd", "tau", "energies"):
                close(getattr(found, name)[:, k], getattr(alone, name)[:, 0], 1e-11)  # errors grow along the motion

    def test_the_robots_own_parameters_change_nothing(self, robot):
        arguments, options = self.arguments(robot)
        plain = rne.ensemble(robot, *arguments, **options)
        pi = np.tile(robot.parameters, (5, 1))
        close(rne.ensemble(robot, *arguments, parameters=pi, **options).q, plain.q, 1e-11)
        assert plain.parameters is None

    def test_chunks_in_other_threads(self, irb140):
        from concurrent.futures import ThreadPoolExecutor

        arguments, options = self.arguments(irb140, 20)
        options["parameters"] = variants(irb140, 20)
        with ThreadPoolExecutor(2) as pool:
            shared = rne.ensemble(irb140, *arguments, executor=pool, **options)
        assert (shared.q == rne.ensemble(irb140, *arguments, **options).q).all()

    def test_a_singular_variant_is_named_by_its_start(self, irb140):
        arguments, options = self.arguments(irb140)
        pi = variants(irb140, 5)
        pi[3, 40:] = 0
        with pytest.raises(rne.SingularMassMatrixError, match=r"^start 3 at t = 0 s: M is singular: nothing with"):
            rne.ensemble(irb140, *arguments, parameters=pi, **options)

    @pytest.mark.parametrize(
        ("change", "text"),
        [
            (lambda pi: pi[0], "`parameters` must have shape (5, 60), ten per body for each initial state, got (60,)"),
            (lambda pi: pi * np.nan, "`parameters` must be finite, got nan at index (0, 0)"),
        ],
    )
    def test_wrong_parameters(self, irb140, change, text):
        arguments, options = self.arguments(irb140)
        with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
            rne.ensemble(irb140, *arguments, parameters=change(variants(irb140, 5)), **options)


@pytest.fixture(params=kept(["irb140", "panda", "mimics", "two joints"], ["two joints"]), scope="module")
def two_engines(request):
    """One robot by both."""
    model = random_tree(2, seed=8) if request.param == "two joints" else robot_of(request.param).model
    return rne.Robot(model, "numpy"), rne.Robot(model, "numba")


@pytest.mark.skipif(importlib.util.find_spec("numba") is None, reason="Numba is not installed")
class TestNumba:
    """The same by machine code; every run has a small robot alone, because compiling takes seconds."""

    @pytest.mark.parametrize("method", kept(["inverse_dynamics", "forward_dynamics"], ["inverse_dynamics"]))
    def test_variants(self, two_engines, method):
        plain, compiled = two_engines
        pi, arrays = variants(plain, 21), random_states(plain, 3, 21)
        expected = getattr(plain, method)(*arrays, parameters=pi)
        close(getattr(compiled, method)(*arrays, parameters=pi), expected, SOLVED)
        one = [a[0] for a in arrays]
        for _ in range(2):
            close(getattr(compiled, method)(*one, parameters=pi[0]), expected[0], SOLVED)
        close(getattr(compiled, method)(*one, parameters=pi)[0], expected[0], SOLVED)
        with pytest.raises(ValueError, match=r"^`parameters` must be finite, got nan at index \(0, 0\)$"):
            getattr(compiled, method)(*arrays, parameters=np.nan * pi)

    @pytest.mark.long
    def test_ensembles(self, two_engines):
        plain, compiled = two_engines
        pi, starts = variants(plain, 7), random_states(plain, 1, 7)[0]
        one, other = (
            rne.ensemble(robot, starts, 0 * starts, 0.05, step=5e-3, keep=3, parameters=pi) for robot in two_engines
        )
        close(other.q, one.q, 1e-11)
        close(other.qd, one.qd, 1e-11)
        pi[5] = 0
        with pytest.raises(rne.SingularMassMatrixError, match=r"^start 5 at t = 0 s: M is singular: nothing with"):
            rne.ensemble(compiled, starts, 0 * starts, 0.05, step=5e-3, parameters=pi)


class TestErrors:
    @pytest.mark.parametrize(
        ("change", "text"),
        [
            (lambda pi: pi[:, :-1], "`parameters` must have shape (..., 60) for robot 'irb140', got (4, 59)"),
            (lambda pi: np.full_like(pi, np.nan), "`parameters` must be finite, got nan at index (0, 0)"),
            (
                lambda pi: np.array([pi[0, :3], "x"], dtype=object),
                "`parameters` must be an array of numbers of shape (..., 60), got dtype object",
            ),
            (
                lambda pi: pi[:3],
                "leading shapes must broadcast against each other, got `q` (4, 6), `qd` (4, 6), `parameters` (3, 60)",
            ),
        ],
    )
    def test_wrong_parameters_are_named(self, irb140, change, text):
        (q, qd), pi = random_states(irb140, 2), change(variants(irb140))
        for call in (irb140.bias_torque, irb140.with_parameters(irb140.parameters).bias_torque):
            with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
                call(q, qd, parameters=pi)

    def test_a_nan_of_one_variant_is_found(self, irb140):
        pi, q = variants(irb140), random_states(irb140, 1)[0]
        pi[2, 0] = np.nan  # the mass of the first body, on which no torque depends
        for given, index in ((pi, (2, 0)), (pi[2], (0,))):
            for _ in range(2):
                with pytest.raises(
                    ValueError, match=re.escape(f"`parameters` must be finite, got nan at index {index}")
                ):
                    irb140.gravity_torque(q if given is pi else q[2], parameters=given)

    @pytest.mark.parametrize(
        "function",
        [
            rne.dynamics.regressor,
            rne.dynamics.link_poses,
            rne.dynamics.lagrange_inverse_dynamics,
            rne.dynamics.lagrange_forward_dynamics,
        ],
    )
    def test_functions_that_do_not_depend_on_moments_refuse_them(self, irb140, function):
        text = f"^rne.dynamics.{function.__name__} takes no inertial parameters as an input$"
        with pytest.raises(TypeError, match=text):
            rne.compile(function, irb140.model, parameters=True)

    def test_parameters_of_a_kernel_are_a_choice(self, irb140):
        text = (
            "`parameters` of a kernel must be True or False, got ndarray; the parameters themselves are an argument of "
            "its calls"
        )
        with pytest.raises(TypeError, match=f"^{re.escape(text)}$"):
            rne.compile(rne.dynamics.mass_matrix, irb140.model, parameters=irb140.parameters)
        assert rne.compile(rne.dynamics.mass_matrix, irb140.model, parameters=False).names == ("q",)

    def test_derivatives_by_parameters_need_them_as_an_input(self, irb140):
        text = "`wrt` must name arguments of ['q'], got 'parameters'; `parameters=True` makes them one"
        with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
            rne.kernels.derivative(rne.dynamics.gravity_torque, irb140.model, "parameters")


def test_what_depends_on_base_parameters_alone_depends_on_moments_alone():
    """So it may be given them, without a word on moments."""

    @quantity(base_parameters=True)
    def torque(model: rne.Model, q: np.ndarray) -> np.ndarray:
        """The weight's torques."""
        return rne.dynamics.gravity_torque.core(model, q)

    assert torque.quantity.moments
