"""Functions of rne.elementwise: NumPy's values; traced, the same by every engine, in derivatives and in printed source."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

import rne
from rne.dynamics.quantity import quantity

from .conftest import TREES
from .helpers import kept

f = rne.elementwise
LAWS = {  # the traced function, and the same by NumPy
    "exp": (lambda x, y: f.exp(x), lambda x, y: np.exp(x)),
    "tanh": (lambda x, y: f.tanh(x), lambda x, y: np.tanh(x)),
    "sign": (lambda x, y: f.sign(x) * y, lambda x, y: np.sign(x) * y),
    "arctan2": (lambda x, y: f.arctan2(x, y), np.arctan2),
    "arctan2 of a number": (lambda x, y: f.arctan2(0.7, x), lambda x, y: np.arctan2(0.7, x)),
    "arctan2 by a number": (lambda x, y: f.arctan2(-x, -1.3), lambda x, y: np.arctan2(-x, -1.3)),
    "minimum": (lambda x, y: f.minimum(x, y), np.minimum),
    "maximum": (lambda x, y: f.maximum(x, y), np.maximum),
    "where": (lambda x, y: f.where(f.less(x, y), 2 * x, y * y), lambda x, y: np.where(x < y, 2 * x, y * y)),
    "clip": (lambda x, y: f.clip(x, -1.2, 1.2) * y, lambda x, y: np.clip(x, -1.2, 1.2) * y),
}
ROUNDING = 4 * np.finfo(float).eps  # relative: other libraries' last digits


@pytest.fixture(params=LAWS)
def law(request):
    """The law as a quantity of a model of six joints, and its values by NumPy."""
    traced, plain = LAWS[request.param]

    @quantity()
    def torques(model: rne.Model, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Torques of the law."""
        return traced(q, qd)

    return torques, plain


def arguments(count):
    return np.random.default_rng(3).uniform(-2, 2, (2, count, 6))


def test_values_of_arrays_are_numpys(law, irb140):
    function, plain = law
    q, qd = arguments(20)
    np.testing.assert_array_equal(function(irb140.model, q, qd), plain(q, qd))


@pytest.mark.parametrize("engine", kept(["numpy", "numba"], ["numpy"]))
@pytest.mark.parametrize("dtype", kept([np.float64, np.float32], [np.float64]))
def test_kernels_of_both_engines(law, irb140, engine, dtype):
    function, plain = law
    kernel = rne.compile(function, irb140.model, engine=engine)
    q, qd = arguments(70).astype(dtype)
    rounding = 4 * np.finfo(dtype).eps
    np.testing.assert_allclose(kernel(q, qd), plain(q, qd), rtol=rounding, atol=rounding)
    np.testing.assert_allclose(kernel(q[0], qd[0]), plain(q[0], qd[0]), rtol=rounding, atol=rounding)


def test_derivatives_are_those_of_differences(law, irb140):
    function, plain = law
    slopes = rne.kernels.derivative(function, irb140.model, "q", "qd")
    q, qd = arguments(30)
    h = 1e-6
    found = slopes(q, qd)
    by_q = (plain(q + h, qd) - plain(q - h, qd)) / (2 * h)
    by_qd = (plain(q, qd + h) - plain(q, qd - h)) / (2 * h)
    away = (abs(q - qd) > 1e-5) & (abs(abs(q) - 1.2) > 1e-5) & (abs(q) > 1e-5)  # where nothing switches in between
    diagonal = np.einsum("...ii->...i", found[..., :6]), np.einsum("...ii->...i", found[..., 6:])
    np.testing.assert_allclose(diagonal[0][away], by_q[away], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(diagonal[1][away], by_qd[away], rtol=1e-6, atol=1e-8)


def test_an_exponential_that_overflows_is_an_error():
    @quantity()
    def torques(model: rne.Model, q: np.ndarray) -> np.ndarray:
        """Torques of the law."""
        return rne.elementwise.exp(q)

    for engine in ("numpy", "numba"):
        kernel = rne.compile(torques, TREES["single"], engine=engine)
        for q in (np.full(1, 1000.0), np.full((9, 1), 1000.0)):
            with pytest.raises(rne.NotFiniteError):
                kernel(q)


def test_printed_python_and_numpy(law, irb140):
    function, plain = law
    kernel = rne.compile(function, irb140.model)
    q, qd = arguments(5)
    for language in ("python", "numpy"):
        space = {}
        exec(kernel.source(language), space)
        for k in range(5):
            np.testing.assert_allclose(space["torques"](q[k], qd[k]), plain(q[k], qd[k]), rtol=ROUNDING, atol=ROUNDING)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler `cc`")
def test_printed_c(law, irb140, tmp_path):
    function, plain = law
    source, library = tmp_path / "law.c", tmp_path / "law.so"
    source.write_text(rne.compile(function, irb140.model).source("c"))
    subprocess.run(["cc", "-shared", "-fPIC", "-O0", "-o", library, source, "-lm"], check=True)
    q, qd = arguments(5)
    for k in range(5):
        result = np.zeros(6)
        pointers = [x.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for x in (q[k], qd[k], result)]
        ctypes.CDLL(str(library)).torques(*pointers)
        np.testing.assert_allclose(result, plain(q[k], qd[k]), rtol=ROUNDING, atol=ROUNDING)


@pytest.mark.parametrize("function", [np.clip, np.where, np.minimum, np.maximum])
def test_numpys_functions_that_need_values_name_what_to_use(irb140, function, caplog):
    arguments = {np.clip: (-1, 1), np.where: (1.0, 2.0)}.get(function, (1.0,))
    law = rne.traceable(
        lambda t, q, qd: function(q, *arguments) if function is not np.where else np.where(q > 0, q, qd)
    )
    assert rne.Scene(irb140, controller=law).cost()["law"] == "called"
    assert caplog.messages == [
        "`controller` is called, not traced: TypeError: a traced number has no value: a branch, float() or array "
        "conversion would freeze one outcome; rne.elementwise has where, less, minimum, maximum, clip and sign for this"
    ]


@pytest.mark.parametrize("engine", kept(["numpy", "numba"], ["numpy"]))
def test_the_sign_of_zero_is_zero(engine):
    """Of a state, in a batch, and of a constant that is folded away."""

    @quantity()
    def torques(model: rne.Model, q: np.ndarray) -> np.ndarray:
        """Torques of the law."""
        return f.sign(q) + 10 * f.sign(0 * q)

    kernel = rne.compile(torques, TREES["single"], engine=engine)
    assert kernel([0.0]).tolist() == [0.0]
    assert kernel([[0.0], [-2.0]]).tolist() == [[0.0], [-1.0]]
