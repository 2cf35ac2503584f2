"""Machine code gives what NumPy's kernels give: numbers, errors, warnings, and what may be given to them."""

import gc
import logging
import os
import pickle
import re
import subprocess
import sys
import warnings
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest

import rne
from rne.dynamics.quantity import OK
from rne.graph.graph import Graph
from rne.graph.program import lower
from rne.graph.scalar import inputs, references
from rne.kernels import array_layout, llvm_backend, object_code
from rne.kernels import kernel as kernel_module
from rne.kernels.soundness import NeedsRecursion, Trace

from .helpers import EPS, ROOT, gimbal, kept, loaded, relative, states
from .random_robots import random_tree, straight_chain

CALLS = {  # quantities, and the number of joint arrays that they take
    "inverse_dynamics": 3,
    "mass_matrix": 1,
    "forward_dynamics": 3,
    "kinetic_energy": 2,
    "link_poses": 1,
}
FURTHER = {"bias_torque": 2, "gravity_torque": 1, "coriolis_torque": 2, "coriolis_matrix": 2, "potential_energy": 1}


@pytest.fixture(scope="module")
def pair():
    """The IRB 140 on both engines."""
    return rne.Robot(rne.irb140(), "numpy"), rne.Robot(rne.irb140(), "numba")


@pytest.fixture(scope="module")
def kernels(pair):
    return [robot.kernel(rne.dynamics.inverse_dynamics) for robot in pair]


@pytest.fixture(scope="session")
def gimbals():
    """Two massless links that carry a body, on both engines, with forward dynamics of one state compiled."""
    robots = [rne.Robot(gimbal(), engine) for engine in kernel_module.ENGINES]
    for robot in robots:
        for _ in range(2):  # the first call of one state runs the recursion
            robot.forward_dynamics(*np.ones((3, 3)))
    return robots


def difference_allowed(robot, method, arguments, eps=EPS):
    """A few roundings per joint, times the condition number of M where it is solved with."""
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(robot.model, arguments[0])).max() if "forward" in method else 1.0
    return 8 * robot.n * eps * kappa


TREES = {kind: random_tree(n, seed=seed, **more) for kind, n, seed, more in [
    ("mixed", 5, 4, {}),
    ("sliders", 4, 3, {"prismatic": 1}),
    ("bushy", 8, 5, {"branching": 0.8}),
    ("mimics", 4, 6, {"mimics": 2}),
    ("two mimics", 2, 6, {"mimics": 2}),
]}  # fmt: skip


class TestNumbers:
    @pytest.mark.parametrize("method", kept([*CALLS, *FURTHER], ["inverse_dynamics"]))
    def test_of_the_irb140(self, pair, method):
        self.check(pair, method, (CALLS | FURTHER)[method])

    @pytest.mark.parametrize("method", kept(["inverse_dynamics", "forward_dynamics"], ["forward_dynamics"]))
    @pytest.mark.parametrize("kind", kept(TREES, []))
    def test_of_trees(self, kind, method):
        self.check([rne.Robot(TREES[kind], engine) for engine in kernel_module.ENGINES], method, CALLS[method])

    def test_of_the_gimbal(self, gimbals):
        self.check(gimbals, "forward_dynamics", 3)

    @pytest.mark.long
    @pytest.mark.parametrize("method", CALLS)
    @pytest.mark.parametrize("name", ["ur_description/ur5_robot", "panda_description/panda"])
    def test_of_arms(self, name, method):
        model = loaded(name).model
        self.check([rne.Robot(model, engine) for engine in kernel_module.ENGINES], method, CALLS[method])

    def check(self, pair, method, count):
        s = states(pair[0].n, 37)[:count]
        expected, got = (getattr(robot, method)(*s) for robot in pair)
        assert (got.dtype, got.shape) == (expected.dtype, expected.shape)
        allowed = difference_allowed(pair[0], method, s)
        assert relative(got, expected) <= allowed
        one = [a[3] for a in s]
        for robot in pair:
            getattr(robot, method)(*one)  # the first call of one state runs the recursion
        expected, got = (getattr(robot, method)(*one) for robot in pair)
        assert type(got) is type(expected)
        assert relative(np.ravel(got)[None], np.ravel(expected)[None]) <= allowed

    def test_float32_is_computed_in_float32(self, pair):
        s = [a.astype(np.float32) for a in states(6, 37)]
        exact = pair[0].inverse_dynamics(*(a.astype(np.longdouble) for a in s))
        for robot in pair:
            tau = robot.inverse_dynamics(*s)
            assert tau.dtype == np.float32
            assert relative(tau, exact) <= 8 * 6 * np.finfo(np.float32).eps

    @pytest.mark.parametrize("name", kept(["chain", "irb140", "panda_description/panda"], ["chain"]))
    def test_derivatives(self, name):
        own = {"chain": straight_chain(2), "irb140": rne.irb140()}
        model = own[name] if name in own else loaded(name).model
        pair = [rne.Robot(model, engine) for engine in kernel_module.ENGINES]
        s = states(model.n, 5)
        for expected, got in zip(*(robot.inverse_dynamics_derivatives(*s) for robot in pair), strict=True):
            assert relative(got, expected) <= 50 * model.n * EPS

    @pytest.mark.parametrize("dtype", kept(["float64", "float32"], ["float64"]))
    def test_M_is_symmetric_to_the_last_bit(self, gimbals, dtype):
        M = gimbals[1].mass_matrix(states(3, 11)[0].astype(dtype))
        assert np.array_equal(M, np.swapaxes(M, -1, -2))


class TestSines:
    """Of the machine code: polynomials in batches, the C library's functions for one state and beyond their reach."""

    NEAR = np.arange(-200, 201) * np.pi / 2  # where sine or cosine vanish, and the reduction must keep its digits
    ANGLES = np.concatenate(
        [NEAR, NEAR * (1 + EPS), 10.0 ** np.arange(-300, 13), -(10.0 ** np.arange(0, 12.5, 0.1)), [0.0, 1e5, 99999.5]]
        + [np.random.default_rng(0).uniform(-top, top, 300) for top in (3.2, 1e3, 1e5)]
    )

    @pytest.fixture
    def program(self):
        graph = Graph()
        x = inputs(graph, (1,), 0)
        return lower(graph, references(graph, np.concatenate([np.sin(x), np.cos(x)])), 1)

    @pytest.fixture
    def exact(self):
        with mpmath.workdps(50):
            return np.array([[mpmath.sin(mpmath.mpf(a)), mpmath.cos(mpmath.mpf(a))] for a in self.ANGLES])

    def units(self, got, exact):
        """Largest error, in units in the last place."""
        last = np.spacing(np.abs(exact.astype(float)))
        return float((np.abs(got - exact) / last).max())

    def test_error_is_below_one_unit_in_the_last_place(self, program, exact):
        got = np.empty((len(self.ANGLES), 2))
        llvm_backend.BatchProgram(Trace(program, (1,), (2,))).run([self.ANGLES[:, None]], got, None)
        assert self.units(got, exact) <= 1
        single = llvm_backend.state_function(Trace(program, (1,), (2,)))
        assert self.units(np.array([single(np.array([a])) for a in self.ANGLES]), exact) <= 1

    def test_neighbours_beyond_the_polynomials_change_no_bit(self, program):
        angles = np.random.default_rng(1).uniform(-1e3, 1e3, (4096, 1))
        alone, beside = np.empty((2, 4096, 2))
        batches = llvm_backend.BatchProgram(Trace(program, (1,), (2,)))
        batches.run([angles], alone, None)
        angles[::8] *= 1e6
        batches.run([angles], beside, None)
        same = np.arange(4096) % 8 != 0
        assert np.array_equal(beside[same], alone[same])

    def test_float32_is_rounded_once(self, program):
        angles = self.ANGLES[np.abs(self.ANGLES) < 1e30].astype(np.float32)
        got = np.empty((len(angles), 2), np.float32)
        llvm_backend.BatchProgram(Trace(program, (1,), (2,))).run([angles[:, None]], got, None)
        exact = np.stack([np.sin(angles.astype(float)), np.cos(angles.astype(float))], axis=1)
        assert self.units(got, exact.astype(np.float32).astype(float)) <= 2**29  # one unit of float32

    def test_torques_at_great_angles_are_as_good_as_those_of_numpy(self, pair):
        q, qd, qdd = states(6, 40)
        q *= 10.0 ** np.linspace(0, 12, 40)[:, None]
        exact = rne.dynamics.inverse_dynamics(pair[0].model, *(a.astype(np.longdouble) for a in (q, qd, qdd)))
        ours, numpys = (relative(robot.inverse_dynamics(q, qd, qdd), exact) for robot in reversed(pair))
        assert ours <= 2 * numpys


class TestExponentials:
    """Hyperbolic tangents and exponential functions of the machine code, without branches in all of its forms."""

    CHANGES = ((np.arange(-8, 60)[:, None] + [0.25, 0.5, 0.75]) * np.log(2) / 2).ravel()  # of the reduction's k
    SIZES = 10.0 ** np.concatenate([np.arange(-323, 3, 2.7), np.linspace(-3, 1.6, 200)])
    NUMBERS = np.concatenate(
        [CHANGES, CHANGES * (1 + EPS), SIZES, -SIZES, [0.0, 709.78, -708.5, -740.0, -745.1, -746.0, -1e9]]
        + [np.random.default_rng(0).uniform(*ends, 300) for ends in ((-0.7, 0.7), (0.17, 0.19), (15, 20), (-700, 700))]
    )
    BOUNDS = 1, 1.1  # units in the last place, as the docstrings say

    def trace(self, width):
        """Both functions of each number, and each of what is known late."""
        graph = Graph()
        x = inputs(graph, (width,), 0)
        late = [x[0].sin().tanh(), x[0].tanh().exp()]
        outputs = references(graph, np.concatenate([np.tanh(x), np.exp(x), np.array(late, dtype=object)]))
        return Trace(lower(graph, outputs, width), (width,), (2 * width + 2,))

    @pytest.fixture(scope="class")
    def rows(self):
        """A function of numbers: what is stored for them in batches, sound or not."""
        batches = llvm_backend.BatchProgram(self.trace(1))

        def run(x):
            found, begin, function = np.empty((len(x), 4), x.dtype), 0, batches.compiled(x.dtype)
            while begin < len(x):
                begin = 1 + function(x[:, None], found, begin)
            return found[:, :2]

        return run

    def units(self, found, exact):
        """The largest errors of both, in units in the last place."""
        last = np.spacing(np.abs(exact.astype(float).astype(found.dtype)))
        return (np.abs(found.astype(float) - exact) / last).max(axis=0)

    def test_errors_are_those_of_the_docstrings(self, rows):
        with mpmath.workdps(50):
            exact = np.array([[mpmath.tanh(x), mpmath.exp(x)] for x in map(mpmath.mpf, self.NUMBERS)])
        assert (self.units(rows(self.NUMBERS), exact) <= self.BOUNDS).all()
        x, function = np.resize(self.NUMBERS, (len(exact) // 11, 11)), llvm_backend.state_function(self.trace(11))
        many = np.array([function(state) for state in x])  # eight, three and one side by side
        single = many[:, :22].reshape(-1, 2, 11).swapaxes(1, 2).reshape(-1, 2)
        assert (self.units(single, exact[: len(single)]) <= self.BOUNDS).all()
        late = np.stack([np.tanh(np.sin(x[:, 0])), np.exp(np.tanh(x[:, 0]))], axis=1)
        np.testing.assert_allclose(many[:, 22:], late, rtol=4 * EPS)

    def test_float32_is_rounded_once(self, rows):
        x = self.NUMBERS[self.NUMBERS < 88].astype(np.float32)
        exact = np.stack([np.tanh(x.astype(float)), np.exp(x.astype(float))], axis=1)
        assert (self.units(rows(x), exact) <= 0.5 + 1e-6).all()

    @pytest.mark.parametrize("dtype", ["float64", "float32"])
    def test_of_what_is_no_number_or_infinite(self, rows, dtype):
        """NaN stays, beside numbers that it does not change."""
        x = np.array([np.nan, 1.0, np.inf, -np.inf, 1e30, -1e30, 710.0, -0.0], dtype)
        found = rows(x)
        assert np.array_equal(found[[0, 2, 3, 4, 5, 6], 0], [np.nan, 1, -1, 1, -1, 1], equal_nan=True)
        assert np.array_equal(found[[0, 2, 3, 4, 5, 6], 1], [np.nan, np.inf, 0, np.inf, 0, np.inf], equal_nan=True)
        assert np.array_equal(found[[1, 7]], rows(x[[1, 7]]))
        assert np.array_equal(found[7], [0, 1])

    def test_tanh_is_odd_bounded_and_ascends(self, rows):
        x = np.sort(np.abs(self.NUMBERS))
        found = rows(x)[:, 0]
        assert np.array_equal(rows(-x)[:, 0], -found)
        assert found.max() == 1
        assert (np.diff(found) >= -np.spacing(found[1:])).all()


class TestOperations:
    def test_each_is_that_of_numpy(self):
        """On numbers and on vectors, in both precisions; NaN passes through all but comparisons."""
        graph = Graph()
        a, b = inputs(graph, (2,), 0)
        traced = [a + b, a - b, a * b, a / b, -a, abs(a), abs(a).sqrt(), a.tanh(), a.sign(), a.minimum(b), a.maximum(b)]
        traced += [(a < b).where(a, b), (a <= b).where(1.0, -a), (a.sign()).where(b, a), a.exp(), a.arctan2(b)]
        outputs = np.empty(len(traced), dtype=object)
        outputs[:] = traced
        program = lower(graph, references(graph, outputs), 2)
        x, y = np.meshgrid([-2.5, -1.0, 0.0, 0.5, 1.0, 3.0], [-2.5, -1.0, 0.5, 1.0, 7.0])
        X = np.stack([x.ravel(), y.ravel()], axis=1)
        for dtype, eps in (("float64", EPS), ("float32", float(np.finfo(np.float32).eps))):
            got = np.empty((len(X), len(traced)), dtype)
            llvm_backend.BatchProgram(Trace(program, (2,), (len(traced),))).run([X], got, None)
            expected = self.by_numpy(*X.astype(dtype).T)
            np.testing.assert_allclose(got, expected, rtol=4 * eps, atol=0)
        single = llvm_backend.state_function(Trace(program, (2,), (len(traced),)))
        np.testing.assert_allclose(np.array([single(x) for x in X]), self.by_numpy(*X.T), rtol=4 * EPS, atol=0)

    def by_numpy(self, a, b):
        parts = [a + b, a - b, a * b, a / b, -a, abs(a), np.sqrt(abs(a)), np.tanh(a), np.sign(a), np.minimum(a, b)]
        parts += [np.maximum(a, b), np.where(a < b, a, b), np.where(a <= b, 1.0, -a), np.where(a != 0, b, a)]
        parts += [np.exp(a), np.arctan2(a, b)]
        return np.stack(parts, axis=1)


class TestArguments:
    @pytest.mark.parametrize("count", [0, 1, 2, 3, 4, 5, 8, 1023, 1025])
    def test_any_number_of_states(self, kernels, count):
        s = states(6, count)
        expected, got = (kernel(*s) for kernel in kernels)
        assert got.shape == (count, 6)
        assert relative(got, expected) <= 8 * 6 * EPS

    def test_any_strides_byte_orders_and_alignments(self, kernels):
        s = states(6, 30)
        expected = kernels[1](*s)
        odd = np.frombuffer(b"x" + s[0].tobytes(), dtype=np.uint8)[1:].view(np.float64).reshape(30, 6)
        forms = [np.asfortranarray(s[0]), np.repeat(s[0], 2, axis=0)[::2], s[0][::-1][::-1], s[0].astype(">f8"), odd]
        for q in forms:
            q.flags.writeable = False
            assert np.array_equal(kernels[1](q, *s[1:]), expected)
            one = kernels[1](q[7], s[1][7], s[2][7])
            assert relative(one[None], expected[7][None]) <= 8 * 6 * EPS

    def test_arrays_that_were_pickled_whose_dtype_is_another_object(self, kernels):
        s = states(6, 9)
        dtype = pickle.loads(pickle.dumps(np.dtype("float64").newbyteorder("=")))
        moved = [np.frombuffer(pickle.loads(pickle.dumps(a)).tobytes(), dtype).reshape(9, 6) for a in s]
        moved = [pickle.loads(pickle.dumps(a)) for a in moved]
        assert moved[0].dtype is not s[0].dtype
        fresh = rne.compile(rne.dynamics.inverse_dynamics, rne.irb140(), engine="numba")
        for kernel in (fresh, kernels[1]):
            assert np.array_equal(kernel(*moved), kernels[1](*s))
            assert np.array_equal(kernel(*(a[0] for a in moved)), kernels[1](*(a[0] for a in s)))

    def test_leading_axes_broadcast_and_dtypes_mix(self, kernels):
        q, qd, qdd = states(6, 12)
        mixed = q.reshape(3, 4, 6), qd[:4], qdd[0].astype(np.float32)
        expected, got = (kernel(*mixed) for kernel in kernels)
        assert (got.shape, got.dtype) == ((3, 4, 6), np.float64)
        assert relative(got.reshape(12, 6), expected.reshape(12, 6)) <= 8 * 6 * EPS

    def test_bits_do_not_depend_on_the_number_of_states(self, kernels):
        s = states(6, 50)
        for kernel in kernels:
            all_states = kernel(*s)
            assert np.array_equal(kernel(*(a[1:40] for a in s)), all_states[1:40])
            assert np.array_equal(kernel(*s, workers=3), all_states)

    def test_out_is_filled(self, kernels):
        s = states(6, 9)
        out = np.empty((9, 6))
        assert kernels[1](*s, out=out) is out
        assert np.array_equal(out, kernels[1](*s))

    @pytest.mark.parametrize("workers", [1, 2, 3, 64])
    def test_threads_share_a_batch(self, kernels, workers):
        s = states(6, 50)
        for kernel in kernels:
            assert relative(kernel(*s, workers=workers), kernel(*s)) <= 8 * 6 * EPS

    @pytest.mark.parametrize("workers", [0, -1, 1.5, True, None])
    def test_workers_that_are_none_are_refused(self, kernels, workers):
        for kernel in kernels:
            with pytest.raises(ValueError, match=rf"^`workers` must be a whole number above zero, got {workers!r}$"):
                kernel(*states(6, 5), workers=workers)


def outcome(call):
    """What a call raises or warns of: types and texts."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            call()
        except Exception as error:
            return type(error), str(error)
    return [(w.category, str(w.message)) for w in caught]


def with_entry(arrays, k, index, value):
    """A copy of some arrays with one entry of array k replaced."""
    changed = [a.copy() for a in arrays]
    changed[k][index] = value
    return changed


S = states(6, 20)
MISTAKES = {
    "NaN in a batch": with_entry(S, 0, (13, 2), np.nan),
    "infinity in a batch": with_entry(S, 2, (0, 5), -np.inf),
    "NaN in one state": with_entry([a[0] for a in S], 1, 4, np.nan),
    "overflow in a batch": with_entry(S, 1, (7, 0), 1e200),
    "overflow of one state": with_entry([a[0] for a in S], 1, 0, 1e200),
    "wrong width of one state": [S[0][0, :5], S[1][0], S[2][0]],
    "wrong width": [S[0][:, :5], *S[1:]],
    "transposed": [S[0].T, *S[1:]],
    "leading shapes": [S[0][:3], *S[1:]],
    "text": ["abc", *S[1:]],
    "ragged": [[[1.0], [1.0, 2.0]], *S[1:]],
    "too few": [S[0]],
}


GUARDED = """
import ctypes, mmap
import numpy as np
import rne
from tests.random_robots import straight_chain
page = mmap.PAGESIZE
memory = mmap.mmap(-1, 2 * page)
behind = ctypes.addressof(ctypes.c_char.from_buffer(memory)) + page
assert ctypes.CDLL(None).mprotect(ctypes.c_void_p(behind), page, 0) == 0
for n in (1, 2, 3):
    kernel = rne.compile(rne.dynamics.bias_torque, straight_chain(n), engine="numba")
    for count in (1, 5, 8, 9):
        q = np.frombuffer(memory, np.float64, n * count, page - 8 * n * count).reshape(count, n)
        assert np.isfinite(kernel(np.zeros((count, n)), q)).all()
    kernel(np.zeros(n), q[-1])
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a page of memory is made unreadable")
def test_nothing_is_read_behind_an_array():
    subprocess.run([sys.executable, "-c", GUARDED], check=True, cwd=ROOT)


def test_of_joints_that_mimic():
    """Angles that are computed have their sines before the rest of the program."""
    q, results = states(2, 9)[0], []
    for engine in kernel_module.ENGINES:
        kernel = rne.compile(rne.dynamics.gravity_torque, TREES["two mimics"], engine=engine)
        results += [kernel(q), np.array([kernel(one) for one in q])]
    assert all(relative(found, results[0]) <= 64 * EPS for found in results[1:])


class TestErrors:
    """The same on both engines, to the letter."""

    def test_overflow_of_a_heavy_robot_in_float32(self):
        heavy = straight_chain(2)
        heavy = replace(heavy, mass=heavy.mass * 1e40, inertia=heavy.inertia * 1e40)
        q = states(2, 9)[0].astype(np.float32)
        expected, got = (outcome(lambda e=e: rne.Robot(heavy, e).mass_matrix(q)) for e in kernel_module.ENGINES)
        assert expected[0] is rne.NotFiniteError
        assert got == expected

    @pytest.mark.parametrize("mistake", MISTAKES)
    def test_mistakes(self, kernels, mistake):
        expected, got = (outcome(lambda kernel=kernel: kernel(*MISTAKES[mistake])) for kernel in kernels)
        assert isinstance(expected, tuple), "no error"
        assert got == expected

    def test_an_engine_that_there_is_not(self):
        for call in (lambda: rne.load("irb140", engine="jax"), lambda: rne.Robot(rne.irb140(), "jax")):
            with pytest.raises(ValueError, match=r"^`engine` must be one of \['numpy', 'numba'\], got 'jax'$"):
                call()

    def test_without_numba_the_error_says_what_to_install(self, monkeypatch):
        monkeypatch.setattr(kernel_module.importlib.util, "find_spec", lambda name: None)
        with pytest.raises(
            ImportError, match=r"^engine 'numba' needs Numba, which is not installed: pip install 'rne\[numba\]'$"
        ):
            rne.load("irb140", engine="numba")
        assert rne.load("irb140").engine == "numpy"


def gimbal_state(case):
    """A state of 20 with which forward dynamics lose digits, or have no answer; the other 19 are sound."""
    q, qd, tau = (np.ones((20, 3)) for _ in range(3))
    if case == "great velocities":
        q, (qd,) = states(3, 20)[0], with_entry([qd], 0, (7, 2), 1e10)
        tau = rne.dynamics.bias_torque(gimbal(), q, qd) * (1 + 1e-15)
    else:
        (q,) = with_entry([q], 0, (7, 1), {"singular": 0.0, "nearly singular": 2e-7, "beyond digits": 1e-8}[case])
    return q, qd, tau


@pytest.mark.parametrize("case", ["nearly singular", "beyond digits", "singular", "great velocities"])
@pytest.mark.parametrize("batch", [False, True], ids=["one state", "batch"])
def test_losses_of_digits_are_those_of_the_recursion(gimbals, case, batch):
    """The recursion decides whether a result is an error, to be warned of or sound; no kernel is silent instead."""
    s = gimbal_state(case) if batch else [x[7] for x in gimbal_state(case)]
    expected = outcome(lambda: rne.dynamics.forward_dynamics(gimbals[0].model, *s))
    assert expected, "neither an error nor a warning"
    for robot in gimbals:
        assert outcome(lambda robot=robot: robot.forward_dynamics(*s)) == expected


@pytest.fixture(scope="module")
def trace():
    """By hand: an argument (r, pivot, diagonal, unused) and a velocity; the result 2 r shows neither of the last two."""
    graph = Graph()
    r, pivot, diagonal, *_ = inputs(graph, (5,), 0)
    outputs = references(graph, np.array([2.0 * r, pivot, diagonal], dtype=object))
    return Trace(lower(graph, outputs, 5), (4, 1), (1,), velocities=range(4, 5), pivots=1)


@pytest.fixture(scope="module")
def made(trace):
    """By engine: the function of one state, and what runs batches."""
    return {name: [make(trace) for make in kernel_module.backends(name)] for name in kernel_module.ENGINES}


class TestSoundness:
    """A state goes to the recursion exactly if a number is not finite, a velocity too great or a pivot of M too small."""

    def cases(self, dtype):
        """(r, pivot, diagonal, unused, velocity) -> sound"""
        eps = float(np.finfo(dtype).eps)
        bound, least = eps**-0.25, 1000 * eps
        near = 0.99999, 1.00001
        table = {(1.0, 1.0, 1.0, 1.0, 1.0): True, (2 * bound, 1.0, 1.0, -2 * bound, 1.0): True}
        table |= {(1.0, 1.0, 1.0, 1.0, sign * bound * size): size < 1 for sign in (1, -1) for size in near}
        table |= {(1.0, size * least * 3.0, 3.0, 1.0, 1.0): size > 1 for size in (*near, -2.0, 0.0)}
        for k in range(5):
            for wrong in (np.nan, np.inf, -np.inf):
                state = [1.0, 1.0, 1.0, 1.0, 1.0]
                state[k] = wrong
                # an infinite pivot exceeds its bound, as any does that of a diagonal below zero: results show those
                table[tuple(state)] = (k, wrong) in ((1, np.inf), (2, -np.inf))
        return table

    @pytest.mark.parametrize("engine", kernel_module.ENGINES)
    def test_of_one_state(self, made, engine):
        function = made[engine][0]
        for (*rest, velocity), sound in self.cases("float64").items():
            arguments = np.array(rest), np.array([velocity])
            if sound:
                assert function(*arguments) == 2.0 * rest[0]
            else:
                with pytest.raises(NeedsRecursion):
                    function(*arguments)

    @pytest.mark.parametrize("dtype", ["float64", "float32"])
    @pytest.mark.parametrize("engine", kernel_module.ENGINES)
    def test_in_batches(self, made, engine, dtype):
        """The recursion computes the state, with its neighbours in a block, and its result is the one that is given."""
        batches, asked = made[engine][1], []

        def recursion(begin, end):
            asked.append((begin, end))
            return np.full((end - begin, 1), -1.0), OK

        for state, sound in self.cases(dtype).items():
            s = np.ones((21, 5), dtype)
            s[9] = state
            results = np.zeros((21, 1), dtype)
            asked.clear()
            assert batches.run([s[:, :4], s[:, 4:]], results, recursion) is OK
            if sound:
                assert not asked
                assert (results == 2.0 * s[:, :1]).all()
            else:
                (first, last), *_ = asked
                assert first <= 9 < last
                assert results[9] == -1.0
                assert first == (9 if engine == "numba" else 0)
                assert (results[:first] == 2.0).all()
                assert (results[last:] == 2.0).all()

    def test_states_in_a_row_are_left_to_the_recursion_in_growing_numbers(self, made):
        """By Numba: 16 at first, twice as many each time up to 1024, and 16 again behind a state that is sound."""
        s, asked = np.full((4000, 5), np.nan), []
        s[3056] = 1.0  # behind the first eight stretches

        def recursion(begin, end):
            asked.append((begin, end - begin))
            return np.zeros((end - begin, 1)), OK

        made["numba"][1].run([s[:, :4], s[:, 4:]], np.zeros((4000, 1)), recursion)
        assert [count for _, count in asked] == [16, 32, 64, 128, 256, 512, 1024, 1024, 16, 32, 64, 128, 256, 447]

    @pytest.mark.parametrize("engine", kernel_module.ENGINES)
    def test_unguarded_it_takes_any_velocity_but_nothing_else(self, trace, engine):
        function = kernel_module.backends(engine)[0](trace.unguarded())
        assert function(np.ones(4), np.array([1e9])) == 2.0
        for wrong in ([np.nan, 1.0, 1.0, 1.0], [1.0, 0.0, 1.0, 1.0]):
            with pytest.raises(NeedsRecursion):
                function(np.array(wrong), np.ones(1))

    @pytest.mark.parametrize("engine", kernel_module.ENGINES)
    def test_infinity_is_seen_where_operations_hide_it(self, engine):
        """Of an infinite x these are finite: tanh x, 1 / x, min(x, 1), its sign and the angle of (x, 1)."""
        graph = Graph()
        (x,) = inputs(graph, (1,), 0)
        hidden = {"all": x.tanh() + 1 / x + x.minimum(1.0) + x.sign() + (0.0 * x + 1.0).arctan2(x)}
        if engine == "numpy":  # one compilation by Numba is enough
            hidden |= {"tanh": x.tanh(), "exp": (-x).exp(), "divide": 1 / x, "minimum": x.minimum(1.0)}
            hidden |= {"less": x < 1.0, "where": (x < 1.0).where(x, 2.0), "sign": x.sign()}
        for name, y in hidden.items():
            trace = Trace(lower(graph, references(graph, np.array([y])), 1), (1,), (1,))
            single, batches = (make(trace) for make in kernel_module.backends(engine))
            assert np.isfinite(single(np.ones(1))), name
            with pytest.raises(NeedsRecursion):
                single(np.array([np.inf]))
            asked = []

            def recursion(begin, end, asked=asked):
                asked.append(begin)
                return np.zeros((end - begin, 1)), OK

            batches.run([np.full((9, 1), np.inf)], np.zeros((9, 1)), recursion)
            assert asked, name


class TestMemory:
    def kernel(self, length):
        kernel = rne.compile(rne.dynamics.inverse_dynamics, straight_chain(2, length=length), engine="numba")
        s = states(2, 9)
        kernel(*s)
        kernel(*(a[0] for a in s))
        kernel.address(8)
        return kernel

    def test_machine_code_goes_with_its_kernel(self):
        """At once: nothing that keeps it refers to itself."""
        kernel = self.kernel(0.5)
        libraries = [kernel.state_function.library, kernel._libraries[8, True]]
        libraries += [x for x in kernel.blocks.compiled(np.dtype("float64")).__self__ if type(x) is object_code.Library]
        kept = [weakref.ref(library) for library in libraries]
        assert len(set(libraries)) == 3
        gc.disable()
        try:
            del kernel, libraries
            assert [library() for library in kept] == [None] * 3
        finally:
            gc.enable()

    def test_a_function_keeps_its_machine_code(self):
        kernel = self.kernel(0.5)
        q, qd, qdd = (a[0] for a in states(2, 9))
        function, expected = kernel.state_function, kernel(q, qd, qdd)
        del kernel
        assert np.array_equal(function(q, qd, qdd), expected)


PAYLOADS = "robot = arm.with_payload(1 + k / 64); robot.mass_matrix([[0.1] * 2] * 2)"
SWINGS = "; rne.simulate(rne.Scene(robot, friction=rne.Friction(1.0)), [0] * 2, [0] * 2, 0.01)"
MEMORY = """
import resource, sys
import rne
from tests.random_robots import straight_chain
arm = rne.Robot(straight_chain(2), "numba")
def largest():  # [MB]
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
for k in range(10 + {count}):
    if k == 10:
        before = largest()
    {work}
print(largest() - before)
"""


class TestWhatKeepsItsEngine:
    def test_what_is_derived_from_a_robot(self, pair):
        robot = pair[1]
        for other in (robot.with_payload(1.0), robot.locked({"joint_6": 0.0}), robot.mounted([0.1, 0, 0])):
            assert other.engine == "numba"
        scene = rne.Scene(robot, gravity=[0, 0, 0], armature=[1.0] * 6, payload=2.0)
        assert scene.kernel.engine == scene.resolved.robot.engine == "numba"
        assert pickle.loads(pickle.dumps(robot)).engine == "numba"
        assert pickle.loads(pickle.dumps(robot.kernel(rne.dynamics.mass_matrix))).engine == "numba"

    def test_llvm_is_imported_when_a_kernel_is_compiled_and_numba_never(self):
        code = (
            "import sys, rne; from tests.random_robots import straight_chain;"
            "r = rne.Robot(straight_chain(2), 'numba'); assert 'llvmlite' not in sys.modules;"
            "r.inverse_dynamics(*[[0.0] * 2] * 3); assert 'llvmlite' not in sys.modules;"  # the recursion
            "r.mass_matrix([[0.0] * 2] * 2); assert 'llvmlite' in sys.modules;"
            "r.mass_matrix([0.0] * 2); r.mass_matrix([0.0] * 2); assert 'numba' not in sys.modules"
        )
        subprocess.run([sys.executable, "-c", code], check=True)

    @pytest.mark.parametrize(("count", "work"), kept([(60, PAYLOADS), (30, PAYLOADS + SWINGS)], [(60, PAYLOADS)]))
    def test_memory_of_machine_code_is_given_back(self, count, work):
        """Each robot has another payload and is compiled anew; a compilation that stayed would keep a megabyte or more."""
        command = [sys.executable, "-c", MEMORY.format(work=work, count=count)]
        run = subprocess.run(command, check=True, capture_output=True, text=True, env=os.environ | {"RNE_CACHE": ""})
        assert float(run.stdout) < 0.2 * count  # [MB]; measured 0 to 2 in all

    @pytest.mark.parametrize(("operations", "seconds"), [(5000, 0.9), (5001, 0.9), (5000, 1.1)])
    def test_long_compilations_are_announced_and_told(self, monkeypatch, caplog, operations, seconds):
        """More than 5000 operations beforehand, more than a second afterwards; here nothing is compiled."""
        clock = iter([100.0, 100.0 + seconds])
        monkeypatch.setattr(llvm_backend, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
        monkeypatch.setattr(object_code, "compiled", lambda text, loops: b"")
        monkeypatch.setattr(
            object_code, "Library", lambda code, names: SimpleNamespace(address={"call": 0, "table": 0})
        )
        graph = Graph()
        (x,) = inputs(graph, (1,), 0)
        for k in range(operations):
            x = x + 1.0 if k % 2 else x * x
        program = lower(graph, references(graph, np.array([x])), 1)
        with caplog.at_level(logging.INFO, logger="rne"):
            function = llvm_backend.state_function(Trace(program, (1,), (1,)))
        assert function.seconds == pytest.approx(seconds)
        announced = "LLVM compiles a kernel of 5001 operations, which takes some seconds"
        told = "LLVM took 1.1 s to compile a kernel"
        assert [r.getMessage() for r in caplog.records] == [announced] * (operations > 5000) + [told] * (seconds > 1)

    def test_a_kernel_shows_how_long_it_was_compiled(self):
        kernel = rne.compile(rne.dynamics.gravity_torque, straight_chain(2), engine="numba")
        assert repr(kernel).endswith(" operations, by Numba")
        kernel([0.0] * 2)
        seconds = float(re.search(r" operations, by Numba, compiled in ([0-9.]+) s$", repr(kernel))[1])
        assert seconds == pytest.approx(kernel.state_function.seconds, rel=0.1)

    def test_a_group_of_states_fills_a_vector_register(self):
        assert llvm_backend.REGISTER_BITS in (256, 512)  # AVX2 and AVX-512


@pytest.fixture(scope="module")
def arms():
    """Two links on both engines."""
    return [rne.Robot(straight_chain(2), engine) for engine in kernel_module.ENGINES]


class TestMotions:
    def scenes(self, arms, **more):
        for robot in arms:
            law = rne.control.pd_gravity(robot, [50.0] * 2, [20.0] * 2, [0.2] * 2)
            yield rne.Scene(
                robot, controller=law, friction=rne.Friction(viscous=2.0, coulomb=1.0), armature=[1.0] * 2, **more
            )

    @pytest.mark.long  # the loop's text is run without a compiler in test_compiled_motions.py
    @pytest.mark.parametrize("method", ["LSODA", "DOP853", "Radau", "auto"])
    def test_are_those_of_numpy(self, arms, method):
        runs = [rne.simulate(s, [0.1] * 2, [0] * 2, 0.3, method=method, rtol=1e-9) for s in self.scenes(arms)]
        expected, got = runs
        assert np.abs(got.q[-1] - expected.q[-1]).max() <= 1e-8
        assert got.work[-1] == pytest.approx(expected.work[-1], rel=1e-7)
        # In machine code the stages of interpolants, 3 of 15, are evaluated when energies are asked for.
        assert 0.75 <= got.evaluations / expected.evaluations <= 1.1

    @pytest.mark.long
    def test_of_free_swings_sampled_laws_and_called_ones(self, arms):
        for how in ({}, {"torque": lambda t, q, qd: -qd}):
            expected, got = (rne.simulate(r, [0.1] * 2, [0] * 2, 0.5, rtol=1e-9, **how) for r in arms)
            assert np.abs(got.q[-1] - expected.q[-1]).max() <= 1e-7
        expected, got = (rne.simulate(s, [0.1] * 2, [0] * 2, 0.2) for s in self.scenes(arms, sample_time=1e-3))
        assert np.abs(got.q[-1] - expected.q[-1]).max() <= 1e-6

    @pytest.mark.long  # two kernels and two loops to compile
    @pytest.mark.parametrize("dtype", ["float64", "float32"])
    @pytest.mark.parametrize("method", ["rk4", "semi-implicit-euler"])
    def test_ensembles_are_those_of_numpy(self, arms, method, dtype):
        q = (states(2, 300)[0] * 0.2).astype(dtype)
        ticks = []
        how = {"step": 1e-3, "method": method, "keep": 3}
        scenes = list(self.scenes(arms))
        expected, got = (rne.ensemble(s, q, 0 * q, 0.05, **how) for s in scenes)
        last = rne.ensemble(scenes[1], q, 0 * q, 0.05, **how, progress=lambda *a: ticks.append(a))
        assert got.q.dtype == expected.q.dtype == dtype
        scale = float(np.finfo(dtype).eps) * 1e4
        for name in ("t", "q", "qd", "energies"):
            np.testing.assert_allclose(getattr(got, name), getattr(expected, name), rtol=scale, atol=scale)
        assert np.array_equal(last.q, got.q)
        assert ticks[-1] == (300 * 50, 300 * 50)
        with ThreadPoolExecutor(2) as pool:
            shared = rne.ensemble(scenes[1], q, 0 * q, 0.05, **how, executor=pool)
        np.testing.assert_allclose(shared.q, got.q, rtol=scale, atol=scale)

    @pytest.mark.long  # another loop to compile
    def test_a_start_that_fails_is_named_with_its_time(self):
        arms = [rne.Robot(straight_chain(1), engine) for engine in kernel_module.ENGINES]
        q = np.zeros((300, 1))
        qd = q.copy()
        qd[217, 0] = 1e160
        found = [outcome(lambda r=r: rne.ensemble(r, q, qd, 0.01, step=1e-3)) for r in arms]
        assert found[0][0] is rne.NotFiniteError
        assert "start 217 at t = 0 s" in found[0][1]
        assert found[1] == found[0]


class TestLayout:
    """Machine code reads arrays where they are, which a process finds out before it makes any."""

    @pytest.fixture
    def asked_anew(self):
        array_layout.is_known.cache_clear()
        yield
        array_layout.is_known.cache_clear()

    FIELDS = ("DATA", "AXES", "SHAPE", "STRIDES", "DTYPE", "FLAGS", "HEAD", "ITEMS")

    def test_is_that_of_this_process(self, asked_anew):
        assert array_layout.is_known()

    @pytest.mark.parametrize("moved", [-8, 4, 8, 16])
    @pytest.mark.parametrize("field", FIELDS)
    def test_is_not_known_if_a_field_is_elsewhere(self, asked_anew, monkeypatch, field, moved):
        monkeypatch.setattr(array_layout, field, getattr(array_layout, field) + moved)
        assert not array_layout.is_known()

    def test_is_not_known_if_two_fields_are_exchanged(self, asked_anew, monkeypatch):
        monkeypatch.setattr(array_layout, "SHAPE", array_layout.STRIDES)
        monkeypatch.setattr(array_layout, "STRIDES", array_layout.STRIDES - 8)
        assert not array_layout.is_known()

    @pytest.mark.parametrize("kind", [np.ndarray, None])
    def test_other_pythons_and_numpys_get_the_same_from_numpy(self, asked_anew, monkeypatch, caplog, kind):
        """A free-threaded Python, and an array that ends before its flags."""
        robots = [rne.Robot(straight_chain(2), "numpy")]
        if kind is None:
            monkeypatch.setattr(array_layout.sysconfig, "get_config_var", lambda name: int(name == "Py_GIL_DISABLED"))
        else:
            monkeypatch.setattr(array_layout, "FLAGS", np.ndarray.__basicsize__)
        robots.append(rne.Robot(straight_chain(2), "numba"))
        assert robots[1].engine == "numpy"
        assert caplog.messages == [
            "engine 'numpy' runs instead of 'numba': this Python or NumPy has arrays of another layout"
        ]
        s = states(2, 5)
        here, there = (
            (*(robot.forward_dynamics(*x) for x in (s, [a[0] for a in s])), rne.ensemble(robot, *s[:2], 0.1).q)
            for robot in robots
        )
        for a, b in zip(here, there, strict=True):
            assert np.array_equal(a, b)
