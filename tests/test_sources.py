"""Generated source text computes what the kernel computes, in every language."""

import shutil
import subprocess
import sys

import numpy as np
import pytest

import rne
from rne.__main__ import LANGUAGES, main, quantities
from rne.kernels.source import LANGUAGES as PRINTED

from .helpers import states

SAME = 1e-13  # of the largest entry: another order of a few operations
NAMES = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "kinetic_energy")


@pytest.fixture(params=NAMES)
def kernel(request, irb140):
    return irb140.kernel(getattr(rne, request.param))


def values(kernel, seed=0):
    return states(6, 3, seed=seed)[: len(kernel.names)]


def same(got, kernel, arguments):
    expected = kernel(*arguments)
    got = np.reshape(got, expected.shape)
    assert np.abs(got - expected).max() <= SAME * max(np.abs(expected).max(), 1e-300)


def namespace(source):
    space = {}
    exec(compile(source, "generated", "exec"), space)
    return space


def test_printed_python_is_the_kernel(kernel):
    function = namespace(kernel.source("python"))[kernel.function.__name__]
    arguments = values(kernel)
    same([function(*(a[k] for a in arguments)) for k in range(3)], kernel, arguments)


def test_numpy_source_broadcasts_in_its_dtype():
    kernel = rne.compile(rne.inverse_dynamics, rne.irb140())
    function = namespace(kernel.source("numpy"))["inverse_dynamics"]
    q, qd, qdd = states(6, 5)
    assert np.abs(function(q, qd[0], qdd) - kernel(q, qd[0], qdd)).max() <= 1e-13 * 100
    assert function(*(a.astype(np.float32) for a in (q, qd, qdd))).dtype == np.float32


def test_printed_numpy_is_the_kernel(kernel):
    function = namespace(kernel.source("numpy"))[kernel.function.__name__]
    arguments = values(kernel)
    same(function(*arguments), kernel, arguments)


def test_derivatives_are_printed_too(irb140):
    kernel = irb140.kernel(rne.gravity_torque, "q")
    function = namespace(kernel.source("python"))["gravity_torque_by_q"]
    same([function(q) for q in values(kernel)[0]], kernel, values(kernel))


@pytest.mark.skipif(
    shutil.which("octave-cli") is None and shutil.which("octave") is None, reason="GNU Octave is not here"
)
def test_printed_matlab_is_the_kernel_in_octave(kernel, tmp_path):
    octave = shutil.which("octave-cli") or shutil.which("octave")
    name, arguments = kernel.function.__name__, values(kernel)
    (tmp_path / f"{name}.m").write_text(kernel.source("matlab"))
    calls = [f"[{' '.join(repr(float(x)) for x in a[k])}]" for k in range(3) for a in arguments]
    count = len(arguments)
    lines = [
        f"r = {name}({', '.join(calls[k * count : (k + 1) * count])})'; printf('%.17g ', r(:)); printf('\\n');"
        for k in range(3)
    ]
    (tmp_path / "run.m").write_text("\n".join(["1;", *lines]) + "\n")
    run = subprocess.run(
        [octave, "--no-gui", "--quiet", "run.m"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    same([[float(x) for x in line.split()] for line in run.stdout.strip().splitlines()], kernel, arguments)


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler here")
def test_printed_c_is_the_kernel(kernel, tmp_path):
    import ctypes

    (tmp_path / "kernel.c").write_text(kernel.source("c"))
    library = tmp_path / "kernel.so"
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", "-o", library, tmp_path / "kernel.c", "-lm"], check=True)
    function = getattr(ctypes.CDLL(str(library)), kernel.function.__name__)
    arguments = values(kernel)
    pointer = ctypes.POINTER(ctypes.c_double)
    results = []
    for k in range(3):
        out = np.zeros(kernel.traced.shape)
        function(*(np.ascontiguousarray(x).ctypes.data_as(pointer) for x in (*(a[k] for a in arguments), out)))
        results.append(out)
    same(results, kernel, arguments)


def test_another_language_is_refused(irb140):
    with pytest.raises(
        ValueError, match=r"^`language` must be one of \['python', 'numpy', 'matlab', 'c'\], got 'fortran'$"
    ):
        irb140.kernel(rne.mass_matrix).source("fortran")


def test_names_of_a_file_do_not_reach_the_source(irb140):
    for language in LANGUAGES:
        text = irb140.kernel(rne.inverse_dynamics).source(language)
        assert "joint" not in text
        assert "irb140" not in text


def test_command_line_prints_source_or_says_why_not(capsys):
    assert main(["source", "irb140", "--quantity", "mass_matrix", "--language", "matlab"]) == 0
    assert capsys.readouterr().out.startswith("function result = mass_matrix(q)\n")
    assert main(["source", "nobody"]) == 2
    assert capsys.readouterr().err == "error: 'nobody' is neither a robot (irb140) nor a file\n"
    assert PRINTED == LANGUAGES
    assert all(hasattr(rne, name) for name in quantities())


def test_printed_python_needs_nothing_of_this_package(irb140, tmp_path):
    (tmp_path / "printed.py").write_text(irb140.kernel(rne.gravity_torque).source("python"))
    code = "import sys, printed; print(printed.gravity_torque([0.0] * 6)[1]); assert 'numpy' not in sys.modules"
    run = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert float(run.stdout) == pytest.approx(irb140.gravity_torque(np.zeros(6))[1])
