"""Printed C and Rust, compiled: many kernels in one library, called from Python."""

import ctypes
import subprocess

import numpy as np

import rne

from .helpers import relative
from .quantities import QUANTITIES, arguments_of
from .random_robots import random_tree

TREES = {
    "pair": {"n": 2, "seed": 5},
    "mixed": {"n": 3, "seed": 4},
    "mimics": {"n": 2, "seed": 6, "mimics": 2},
    "bushy": {"n": 8, "seed": 5, "branching": 0.8},
}
ARMS = ("irb140", "ur5", "panda", "talos_left_arm", "iiwa", "kinova")
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


def kernels(model, are_derivatives):
    """Of every quantity, or their derivatives by all of its arguments."""
    if not are_derivatives:
        return [rne.compile(function, model) for function in QUANTITIES.values()]
    return [rne.kernels.derivative(function, model, *function.quantity.widths) for function in QUANTITIES.values()]


def name_of(kernel):
    """The name of the function in its source."""
    return "_".join([kernel.quantity.name, *(["by", *kernel.wrt] if kernel.wrt else [])])


def c_library(sources, folder, *options):
    """Functions in C, compiled with all warnings as errors."""
    (folder / "all.c").write_text("\n".join(sources))
    warnings = "-std=c99", "-Wall", "-Wextra", "-Werror", "-Wdouble-promotion", "-Wfloat-conversion"
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


def check_all(model, made, functions, dtype):
    """Each function gives what its kernel gives in double precision, to 8 n eps, times the condition of M if inverted.

    The states are numbers of single precision. Of a sum of n terms the rounding errors grow with n; a derivative is a
    product rule on these sums.
    """
    eps, count = float(np.finfo(dtype).eps), 5
    for kernel in made:
        q, qd, qdd = (a.astype(np.float32) for a in states_of(kernel, model, count))
        arrays = [a.astype(float) for a in arguments_by_name(kernel, q, qd, qdd)]
        expected = kernel(*arrays).reshape(count, -1)
        bound = 8 * model.n * eps
        if kernel.quantity.name in INVERTING:
            M = rne.dynamics.mass_matrix(model, arrays[0])
            bound *= np.linalg.cond(M).max()
        got = call(functions(name_of(kernel)), arrays, kernel.traced.entries, dtype)
        assert relative(got.astype(float), expected) <= bound, (name_of(kernel), dtype)


def states_of(kernel, model, count):
    return arguments_of(rne.dynamics.inverse_dynamics, model.n, count, seed=7)


def arguments_by_name(kernel, q, qd, qdd):
    arrays = {"q": q, "qd": qd, "qdd": qdd, "tau": qdd, "qdr": qd[..., ::-1], "qddr": qdd}
    return [arrays[name] for name in kernel.names]
