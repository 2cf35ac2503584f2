"""Printed C and Rust, compiled: many kernels in one library, called from Python."""

import contextlib
import ctypes
import subprocess

import numpy as np

import rne

from .helpers import relative, states
from .quantities import QUANTITIES
from .random_robots import random_tree

TREES = {
    "single": {"n": 1, "seed": 3},
    "pair": {"n": 2, "seed": 5},
    "mixed": {"n": 3, "seed": 4},
    "mimics": {"n": 2, "seed": 6, "mimics": 2},
    "bushy": {"n": 5, "seed": 5, "branching": 0.8},
}
ARMS = ("irb140", "ur5", "panda", "talos_left_arm", "xarm7", "z1")
INVERTING = ("forward_dynamics", "articulated_forward_dynamics")
TYPES = {"float64": ctypes.c_double, "float32": ctypes.c_float}
RUST = """#![no_std]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    loop {}
}

"""


def model_of(name):
    """A tree of these, or an arm."""
    return random_tree(**TREES[name]) if name in TREES else rne.load(name).model


def kernels(model):
    """Of every quantity, and of its derivatives by all of its arguments."""
    found = []
    for function in QUANTITIES.values():
        with contextlib.suppress(rne.ModelError):  # of articulated bodies if there are mimics
            found.append(rne.compile(function, model))
            found.append(rne.kernels.derivative(function, model, *function.quantity.widths))
    return [kernel for kernel in found if kernel.is_unrolled]


def name_of(kernel):
    """The name of the function in its source."""
    return "_".join([kernel.quantity.name, *(["by", *kernel.wrt] if kernel.wrt else [])])


def c_library(sources, folder, *options):
    """Functions in C, compiled with all warnings as errors."""
    (folder / "all.c").write_text("\n".join(sources))
    warnings = (
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Wconversion",
        "-Werror",
        "-Wdouble-promotion",
    )
    command = ["cc", *warnings, *(options or ["-O0"]), "-shared", "-fPIC", "-o", "all.so", "all.c", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "all.so"))


def rust_library(sources, folder, named):
    """Functions in Rust without its standard library, each called as C calls it."""
    exported = [
        f'#[no_mangle]\npub extern "C" fn c_{name}({", ".join(f"a{k}: {kind}" for k, kind in enumerate(kinds))}) '
        f"{{\n    {name}({', '.join(f'a{k}' for k in range(len(kinds)))})\n}}\n"
        for name, kinds in named.items()
    ]
    (folder / "all.rs").write_text(RUST + "\n".join([*sources, *exported]))
    options = "--edition", "2021", "--crate-type", "cdylib", "-C", "panic=abort", "-C", "link-arg=-lm", "-D", "warnings"
    subprocess.run(["rustc", *options, "-o", "all.so", "all.rs"], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "all.so"))


def rust_types(kernel, dtype):
    """The types of a function's arguments."""
    real = {"float64": "f64", "float32": "f32"}[dtype]
    return [*(f"&[{real}; {width}]" for width in kernel.widths), f"&mut [{real}; {kernel.traced.entries}]"]


def call(function, arrays, entries, dtype):
    """Results of a compiled function for a batch."""
    arrays = [np.ascontiguousarray(a, dtype) for a in arrays]
    out = np.full((len(arrays[0]), entries), np.nan, dtype)
    pointer = ctypes.POINTER(TYPES[dtype])
    for k in range(len(out)):
        function(*(a[k].ctypes.data_as(pointer) for a in (*arrays, out)))
    return out


def check_all(model, made, function_of, dtype):
    """Each function gives what its kernel gives in double precision, to 8 n eps of the largest entry of a state.

    Of a sum of n terms the rounding errors grow with n; a derivative is the product rule on such sums. If M is inverted,
    they grow with its condition, and what is solved for is the difference of tau and the bias torques. The states are
    numbers of single precision.
    """
    eps, count = float(np.finfo(dtype).eps), 5
    q, qd, qdd = (a.astype(np.float32).astype(float) for a in states(model.n, count, seed=7))
    arrays = {"q": q, "qd": qd, "qdd": qdd, "tau": qdd, "qdr": qd[..., ::-1], "qddr": qdd}
    M, bias = rne.dynamics.mass_matrix(model, q), rne.dynamics.bias_torque(model, q, qd)
    difference = (np.linalg.norm(qdd, axis=-1) + np.linalg.norm(bias, axis=-1)) / np.linalg.norm(qdd - bias, axis=-1)
    growth = np.linalg.cond(M) * difference
    for kernel in made:
        given = [arrays[name] for name in kernel.names]
        expected = kernel(*given).reshape(count, -1)
        got = call(function_of(name_of(kernel)), given, kernel.traced.entries, dtype).astype(float)
        bounds = 8 * model.n * eps * (growth if kernel.quantity.name in INVERTING else np.ones(count))
        errors = [relative(a, b) for a, b in zip(got, expected, strict=True)]
        assert (errors <= bounds).all(), (name_of(kernel), dtype, errors / bounds)
