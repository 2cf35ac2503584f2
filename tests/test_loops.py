"""Loops in machine code around kernels: one text, run by the interpreter or compiled, around functions or addresses."""

import ctypes
import math

import numpy as np
import pytest

import rne
from rne.integrators import loops

from .helpers import EPS, relative, states
from .random_robots import random_tree, straight_chain

pytest.importorskip("numba", reason="Numba is not installed")
from llvmlite import binding, ir

from rne.kernels.python_calls import emit_loop_call


@pytest.fixture(scope="module")
def kernel():
    return rne.compile(rne.dynamics.forward_dynamics, straight_chain(2), engine="numba")


def called(address, arguments, out):
    """A C function of the interface, called by ctypes."""
    function = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * (len(arguments) + 1))(address)
    return function(*(a.ctypes.data for a in (*arguments, out)))


def test_a_robot_that_mimics_in_machine_code():
    """Sines that others do not wait for come first, those of joints that mimic among them."""
    model = random_tree(n=3, seed=3, branching=0.4, mimics=2)
    kernel = rne.compile(rne.dynamics.inverse_dynamics, model, engine="numba")
    s = states(model.n, 3)
    assert relative(kernel(*s), rne.dynamics.inverse_dynamics(model, *s)) <= 1e3 * EPS


class TestAddress:
    def test_of_one_state(self, kernel):
        one, out = [s[0].copy() for s in states(2, 1)], np.empty(2)
        assert called(kernel.address(), one, out) == 1
        assert relative(out[None], kernel(*one)[None]) <= 100 * EPS

    def test_of_states_side_by_side(self, kernel):
        s, out = states(2, loops.LANES), np.empty((2, loops.LANES))
        assert called(kernel.address(loops.LANES), [a.T.copy() for a in s], out) == 1
        assert relative(out.T, kernel(*s)) <= 100 * EPS

    @pytest.mark.parametrize("lanes", [1, loops.LANES])
    @pytest.mark.parametrize("wrong", [np.nan, np.inf])
    def test_a_state_to_be_examined_gives_0(self, kernel, lanes, wrong):
        s = [a.T.copy() for a in states(2, lanes)]
        s[1][1, -1] = wrong
        assert called(kernel.address(lanes), s, np.empty((2, lanes))) == 0

    @pytest.mark.parametrize("lanes", [1, loops.LANES])
    def test_an_angle_beyond_the_polynomials_does_not_touch_its_neighbours(self, kernel, lanes):
        s = [a.T.copy() for a in states(2, lanes)]
        before, after = np.empty((2, lanes)), np.empty((2, lanes))
        assert called(kernel.address(lanes), s, before) == 1
        s[0][1, -1] = 1.1e5
        assert called(kernel.address(lanes), s, after) == 1
        assert np.array_equal(after[:, :-1], before[:, :-1])
        expected = rne.dynamics.forward_dynamics(kernel.model, *(a[:, -1] for a in s))
        assert relative(after[:, -1:].T, expected[None]) <= 1e-10  # an angle has 1.5e-11 rad of rounding there


@loops.inline
def size(x):
    """A sum of squares."""
    total = 0.0
    for i in range(len(x)):
        total += x[i] * x[i]
    return total


def sizes(function, arguments, out, found, weights):
    """Sizes of a kernel's result while the first argument grows; how many were sound."""
    for k in range(len(found)):
        if not loops.evaluate(function, arguments, out):
            return k
        found[k] = weights[0] * size(out) + weights[1]
        for i in range(len(arguments[0])):
            arguments[0][i] *= 2.0
    return len(found)


def interpreted(kernel):
    def function(*arguments):
        result, status = kernel.evaluate(*arguments[:-1])
        arguments[-1][:] = result
        return status.error is None

    return function


def run(loop, function, found):
    q, qd, tau = (s[0].copy() for s in states(2, 1))
    return loop(function, (q, qd, tau), np.empty(2), found, (0.5, 1.0))


@pytest.mark.long
def test_a_text_is_the_same_loop_compiled_and_interpreted(kernel):
    found, expected = np.empty(5), np.empty(5)
    assert run(loops.compiled(sizes), kernel.address(), found) == 5
    assert run(sizes, interpreted(kernel), expected) == 5
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_text_stops_where_the_function_says_so(kernel):
    answers = iter([True, True, False])
    assert run(sizes, lambda *_: next(answers), np.empty(5)) == 2


def beside(x, k):
    """Functions that Numba has copies of."""
    return math.nextafter(x, math.inf) + math.hypot(x, 4.0) + x**k


@pytest.mark.long
def test_functions_of_math(kernel):
    assert loops.compiled(beside)(3.0, 3) == beside(3.0, 3)


@pytest.mark.parametrize("returned", ["int64", "float64", "bool", "none"])
def test_a_call_is_machine_code_for_every_type_of_result(returned):
    module = ir.Module("call")
    emit_loop_call(module, "loop", (1, 2.0), returned)
    binding.parse_assembly(str(module)).verify()


def test_a_compiled_text_returns_what_the_text_returns_and_takes_other_kinds_of_arguments(caplog, monkeypatch):
    """Compiled once by Numba in the short run: a loop returns a float, an int, a bool or nothing, and no array."""
    monkeypatch.setenv("RNE_CACHE", "")
    total = loops.compiled(size)
    x = np.arange(4.0)
    loops._announce.cache_clear()
    with caplog.at_level("INFO", logger="rne"):
        assert total(x) == total(np.arange(4)) == total(x) == 14.0
    assert caplog.messages == ["Numba translates the loops of simulations, about 10 s in all, once on this machine"]
    for wrong in (x[::2], x.astype(np.float32)):
        with pytest.raises(TypeError, match=r"^loops take C-contiguous arrays of float64 or int64, got "):
            total(wrong)
