"""`Kernel.into`: results in the caller's array, by both engines, and everything that is refused."""

import copy
import pickle
import re
import tracemalloc
import warnings

import numpy as np
import pytest

import rne
from rne.dynamics import forward_dynamics, gravity_torque, inverse_dynamics, kinetic_energy, mass_matrix

from .helpers import gimbal, states
from .quantities import arguments_of
from .random_robots import random_tree

N = 3
MODEL = random_tree(N, 4)


@pytest.fixture(params=["numpy", "numba"])
def engine(request):
    if request.param == "numba":
        pytest.importorskip("numba", reason="Numba is not installed")
    return request.param


@pytest.fixture
def kernel(engine):
    return rne.compile(gravity_torque, MODEL, engine=engine)


@pytest.mark.parametrize("leading", [(), (1,), (5,), (2, 3), (0,)])
def test_the_result_is_written_and_returned(engine, leading):
    for function in (inverse_dynamics, mass_matrix, kinetic_energy):
        kernel = rne.compile(function, MODEL, engine=engine)
        arrays = [a.reshape(*leading, N) for a in arguments_of(function, N, int(np.prod(leading)))]
        out = np.full((*leading, *kernel.traced.shape), np.nan)
        for _ in range(2):  # the first call compiles
            assert kernel.into(*arrays, out) is out
            np.testing.assert_array_equal(out, kernel(*arrays))
            out[...] = np.nan


def test_of_machine_code_python_calls_it_directly():
    pytest.importorskip("numba", reason="Numba is not installed")
    kernel = rne.compile(inverse_dynamics, MODEL, engine="numba")
    arrays, out = states(N), np.empty(N)
    kernel.into(*arrays, out)
    assert type(kernel.into).__name__ == "builtin_function_or_method"
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(kernel)).into(*arrays, np.empty(N)), out)


def test_a_name_given_before_the_first_call_is_the_machine_code(monkeypatch):
    """So a loop that keeps the method in a name calls machine code that is made once, of copies as well."""
    pytest.importorskip("numba", reason="Numba is not installed")
    from rne.kernels import llvm_backend

    made, make = [], llvm_backend.into
    monkeypatch.setattr(llvm_backend, "into", lambda kernel: made.append(kernel) or make(kernel))
    original = rne.compile(gravity_torque, MODEL, engine="numba")
    for kernel in (original, copy.copy(original)):
        into = kernel.into
        assert type(into).__name__ == "builtin_function_or_method"
        for q in states(N, 3)[0]:
            np.testing.assert_array_equal(into(q, np.empty(N)), original(q))
        assert kernel.into is into
    assert len(made) == 2


def test_a_kernel_that_no_one_keeps_is_made_again_once(monkeypatch):
    pytest.importorskip("numba", reason="Numba is not installed")
    from rne.kernels import kernel as module

    into, traced, trace = rne.compile(gravity_torque, MODEL, engine="numba").into, [], module.trace
    monkeypatch.setattr(module, "trace", lambda *given, **options: traced.append(given) or trace(*given, **options))
    for _ in range(3):  # batches are not for this machine code
        found = into(np.zeros((2, N)), np.empty((2, N)))
        np.testing.assert_allclose(found, gravity_torque(MODEL, np.zeros((2, N))), rtol=1e-13)
    assert len(traced) == 1


def test_machine_code_allocates_nothing():
    pytest.importorskip("numba", reason="Numba is not installed")
    kernel = rne.compile(inverse_dynamics, MODEL, engine="numba")
    arrays, out = states(N), np.empty(N)
    kernel.into(*arrays, out)
    tracemalloc.start()
    try:
        into = kernel.into
        into(*arrays, out)
        before, _ = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        into(*arrays, out)
        assert tracemalloc.get_traced_memory()[1] - before <= 100  # the tuple of the arguments: an array takes more
        tracemalloc.reset_peak()
        kernel(*arrays)
        assert tracemalloc.get_traced_memory()[1] - before > 100
    finally:
        tracemalloc.stop()


READ_ONLY, MISALIGNED = np.zeros(N), np.zeros(8 * N + 1, np.uint8)[1:].view(float)
READ_ONLY.flags.writeable = False
Q = np.zeros(N)
REFUSED = {
    "list": ([0.0] * N, np.empty(N), "`q` must be a float64 array of shape (3,), got list"),
    "float32": (np.zeros(N, np.float32), np.empty(N), "`q` must be a float64 array of shape (3,), got float32 (3,)"),
    "big-endian": (np.zeros(N, ">f8"), np.empty(N), "`q` must be a float64 array of shape (3,), got >f8 (3,)"),
    "width": (np.zeros(N + 1), np.empty(N), "`q` must be a float64 array of shape (3,), got float64 (4,)"),
    "no array": (0.0, np.empty(N), "`q` must be a float64 array of shape (3,), got float"),
    "strided": (np.zeros(2 * N)[::2], np.empty(N), "`q` must be C-contiguous and aligned"),
    "misaligned": (MISALIGNED, np.empty(N), "`q` must be C-contiguous and aligned"),
    "out float32": (Q, np.empty(N, np.float32), "`out` must be a float64 array of shape (3,), got float32 (3,)"),
    "out shape": (Q, np.empty((1, N)), "`out` must be a float64 array of shape (3,), got float64 (1, 3)"),
    "out width": (Q, np.empty(N + 1), "`out` must be a float64 array of shape (3,), got float64 (4,)"),
    "out None": (Q, None, "`out` must be a float64 array of shape (3,), got NoneType"),
    "out strided": (Q, np.empty(2 * N)[::2], "`out` must be C-contiguous and writeable"),
    "out read only": (Q, READ_ONLY, "`out` must be C-contiguous and writeable"),
    "out is the input": (Q, Q, "`out` must not share memory with `q`"),
    "out batch": (np.zeros((4, N)), np.empty((5, N)), "`out` must be a float64 array of shape (4, 3), got float64 (5, 3)"),
    "out None of a batch": (np.zeros((4, N)), None, "`out` must be a float64 array of shape (4, 3), got NoneType"),
    "out list of a batch": (np.zeros((4, N)), [], "`out` must be a float64 array of shape (4, 3), got list"),
    "ragged": ([[0.0], [1.0, 2.0]], np.empty(N), "`q` must be a float64 array of shape (3,), got list"),
    "None": (None, np.empty(N), "`q` must be a float64 array of shape (3,), got NoneType"),
    "object": (np.zeros(N, object), np.empty(N), "`q` must be a float64 array of shape (3,), got object (3,)"),
    "batch strided": (np.zeros((4, 2 * N))[:, :N], np.empty((4, N)), "`q` must be C-contiguous and aligned"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_such_an_array_is_refused_and_named(kernel, case):
    q, out, text = REFUSED[case]
    before = None if out is None else np.copy(out)
    for _ in range(2):
        with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
            kernel.into(q, out)
    if out is not None:
        np.testing.assert_array_equal(out, before)


@pytest.mark.parametrize("start", [-1, 0, 1, 2, N - 1])
def test_overlapping_parts_of_one_array_are_refused(kernel, start):
    memory = np.zeros(3 * N)
    q, out = memory[N : 2 * N], memory[N + start : 2 * N + start]
    kernel.into(np.zeros(N), np.empty(N))
    with pytest.raises(ValueError, match=r"^`out` must not share memory with `q`$"):
        kernel.into(q, out)
    for neighbour in (memory[:N], memory[2 * N :]):
        np.testing.assert_array_equal(kernel.into(q, neighbour), kernel(np.zeros(N)))


def test_a_wrong_number_of_arrays_is_refused(kernel):
    for arrays in ((), (Q,), (Q, np.empty(N), np.empty(N))):
        for _ in range(2):
            with pytest.raises(TypeError, match=rf"^`into` of this kernel takes q, out; got {len(arrays)} arrays$"):
                kernel.into(*arrays)
        kernel.into(Q, np.empty(N))


def test_shapes_of_a_batch_are_those_of_the_first(engine):
    kernel = rne.compile(kinetic_energy, MODEL, engine=engine)
    with pytest.raises(ValueError, match=r"^`qd` must be a float64 array of shape \(4, 3\), got float64 \(3,\)$"):
        kernel.into(np.zeros((4, N)), np.zeros(N), np.empty(4))


def test_arrays_that_were_pickled_or_are_read_only_are_taken(kernel):
    q = np.ascontiguousarray(states(N, seed=1)[0])
    expected = kernel(q)
    q.flags.writeable = False
    kernel.into(q, np.empty(N))
    for array in (q, pickle.loads(pickle.dumps(q)), np.asarray(q, dtype=pickle.loads(pickle.dumps(q.dtype)))):
        np.testing.assert_array_equal(kernel.into(array, np.empty(N)), expected)

    class Own(np.ndarray):
        pass

    np.testing.assert_array_equal(kernel.into(q.view(Own), np.empty(N)), expected)


def test_refused_states_are_the_functions(engine):
    """M of a gimbal is singular at q2 = 0; near it digits are lost, of which the caller is warned."""
    kernel = rne.compile(forward_dynamics, gimbal(), engine=engine)
    out = np.empty(3)
    tau = np.array([0.1, 0.2, 0.3])
    good = np.array([0.1, 0.5, 0.2])
    kernel.into(good, Q, tau, out)
    for q in (np.zeros(3), np.zeros((2, 3))):
        with pytest.raises(rne.SingularMassMatrixError) as expected:
            forward_dynamics(gimbal(), q, 0 * q, 0 * q)
        with pytest.raises(rne.SingularMassMatrixError) as error:
            kernel.into(q, 0 * q, 0 * q, np.empty(q.shape))
        assert str(error.value) == str(expected.value)
    with pytest.raises(ValueError, match=r"^`q` must be finite, got nan at index"):
        kernel.into(np.array([0, np.nan, 0]), Q, tau, out)
    near = np.array([0.1, 3e-7, 0.2])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        expected = kernel(near, Q, tau)
    for fresh in (kernel, rne.compile(forward_dynamics, gimbal(), engine=engine)):
        with pytest.warns(rne.PrecisionWarning) as caught:
            assert fresh.into(near, Q, tau, out) is out
        assert [warning.filename for warning in caught] == [__file__]
        np.testing.assert_array_equal(out, expected)


def test_a_function_kept_by_itself_outlives_its_kernel(engine):
    kernel = rne.compile(gravity_torque, MODEL, engine=engine)
    kernel.into(Q, np.empty(N))
    into, expected = kernel.into, kernel(Q)
    del kernel
    np.testing.assert_array_equal(into(Q, np.empty(N)), expected)
    with pytest.raises(ValueError, match=r"^`q` must be finite, got nan at index"):
        into(np.full(N, np.nan), np.empty(N))


def test_kernels_that_are_not_written_out(engine, monkeypatch):
    from rne.kernels import trace

    monkeypatch.setattr(trace, "LIMIT", 10)
    kernel = rne.compile(gravity_torque, MODEL, engine=engine)
    assert not kernel.is_unrolled
    for q in states(N, seed=2)[:1], states(N, 4, seed=2)[:1]:
        out = np.empty(q[0].shape)
        np.testing.assert_array_equal(kernel.into(*q, out), gravity_torque(MODEL, *q))


def test_out_may_be_given_by_name(kernel):
    q, out = np.linspace(-0.2, 0.3, N), np.empty(N)
    for _ in range(3):  # compiled at the first call
        assert kernel.into(q, out=out) is out
        np.testing.assert_allclose(out, kernel(q), rtol=1e-14)
        with pytest.raises(TypeError, match="takes q, out; got 3 arrays"):
            kernel.into(q, out, out=out)
        with pytest.raises(TypeError, match=r"into\(\) got an unexpected keyword argument 'other'"):
            kernel.into(q, other=out)
