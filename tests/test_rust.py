"""Printed Rust, compiled without its standard library: values, derivatives, and that nothing in it can panic."""

import shutil
import subprocess

import numpy as np
import pytest

import rne

from .compiled_sources import ARMS, RUST, TREES, call, check_all, kernels, model_of, name_of, rust_library, rust_types
from .helpers import kept
from .test_sources import every_operation  # noqa: F401

pytestmark = pytest.mark.skipif(shutil.which("rustc") is None, reason="there is no Rust compiler here")
REAL = {"float64": "f64", "float32": "f32"}


@pytest.mark.parametrize("name", kept([*TREES, *ARMS], ["single"]))
def test_every_quantity_and_its_derivatives(name, tmp_path):
    model = model_of(name)
    made = kernels(model)
    for dtype in ["float32"] if name in ARMS else REAL:
        (folder := tmp_path / dtype).mkdir()
        named = {name_of(kernel): rust_types(kernel, dtype) for kernel in made}
        library = rust_library([kernel.source("rust", dtype=dtype) for kernel in made], folder, named)
        check_all(model, made, lambda name, library=library: library[f"c_{name}"], dtype)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_every_operation(every_operation, dtype, tmp_path):  # noqa: F811
    printed, points, expected = every_operation
    types = [f"&[{REAL[dtype]}; 2]", f"&mut [{REAL[dtype]}; {expected.shape[1]}]"]
    library = rust_library([printed("rust", dtype)], tmp_path, {"every": types})
    got = call(library.c_every, [points], expected.shape[1], dtype)
    np.testing.assert_allclose(got, expected.astype(dtype), rtol=8 * np.finfo(dtype).eps)


def test_nothing_can_panic(irb140, tmp_path):
    """The object code calls sin and cos alone: arrays of fixed sizes need no check of bounds."""
    text = irb140.kernel(rne.dynamics.mass_matrix).source("rust", dtype="float32")
    (tmp_path / "m.rs").write_text("#![no_std]\n" + text)
    options = "--edition", "2021", "--crate-type", "lib", "--emit", "obj", "-C", "opt-level=1", "-D", "warnings"
    subprocess.run(["rustc", *options, "m.rs", "-o", "m.o"], cwd=tmp_path, check=True)
    found = subprocess.run(["nm", "-u", "m.o"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert set(found.split()) - {"U"} == {"cosf", "sinf"}


def test_names_of_functions_are_no_words_of_the_language(tmp_path):
    def match(q):
        return q * q

    made = rne.compile(rne.traceable(match), rne.irb140())
    assert "pub fn match_(q: &[f64; 6], result: &mut [f64; 6]) {" in made.source("rust")
    assert "void match_(const double *q, double *result)" in made.source("c")
    library = rust_library([made.source("rust")], tmp_path, {"match_": rust_types(made, "float64")})
    assert call(library.c_match_, [np.full((1, 6), 3.0)], 6, "float64").tolist() == [[9.0] * 6]


def test_arguments_that_are_not_of_the_size_are_refused_by_the_compiler(tmp_path):
    text = rne.compile(rne.dynamics.gravity_torque, rne.irb140()).source("rust")
    (tmp_path / "g.rs").write_text(f"{RUST}{text}\npub fn f(r: &mut [f64; 6]) {{ gravity_torque(&[0.0; 5], r) }}\n")
    run = subprocess.run(
        ["rustc", "--edition", "2021", "--crate-type", "lib", "-C", "panic=abort", "g.rs"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "expected an array with a size of 6" in run.stderr
