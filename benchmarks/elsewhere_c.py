"""Inverse dynamics as C and Rust, beside C that CasADi writes: python -m benchmarks.elsewhere_c [--quick]

Printed C in double and single precision, Rust where there is a compiler, and what CasADi generates from a recursion
written for it by hand. All are compiled with -O3 and run on the same states by a loop in C, in turn, on one thread;
errors against 50 digits. CPU times. `benchmarks.elsewhere` keeps them.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import rne
from benchmarks.cases import states
from benchmarks.derivative_calls import recursion
from benchmarks.derivatives import EXACT, error, exact
from benchmarks.measure import QUICK_NOTE, is_quick, nanoseconds, per_state, ratio
from benchmarks.pages import table, three
from benchmarks.peers.registry import import_failure

ROBOTS = ("irb140", "ur5", "xarm7")
COUNT, REPEATS, ROUNDS = 256, 31, 200
QUICK_COUNT, QUICK_REPEATS, QUICK_ROUNDS = 16, 3, 2
CASADI, OURS = "CasADi's C of a recursion by hand", "C, double"
REAL = {"float64": ("double", "f64"), "float32": ("float", "f32")}
OPTIONS = ("-O3", "-fPIC", "-shared")
LOOP = """
{declaration}
void run(const {real} *q, const {real} *qd, const {real} *qdd, {real} *out, int count, int rounds)
{{
    for (int round = 0; round < rounds; ++round)
        for (int k = 0; k < count; ++k) {{
            {call}
        }}
}}
"""
OWN = "void inverse_dynamics(const {real} *q, const {real} *qd, const {real} *qdd, {real} *result);"
PLAIN = "inverse_dynamics(q + {n} * k, qd + {n} * k, qdd + {n} * k, out + {n} * k);"
PEER = "int peer(const double **arg, double **res, long long *iw, double *w, int mem);"
OF_PEER = """const double *arg[16] = {{q + {n} * k, qd + {n} * k, qdd + {n} * k}};
            double *res[16] = {{out + {n} * k}};
            peer(arg, res, 0, w, 0);"""

Results = dict[str, Any]


def run(quick: bool) -> Results:
    """All figures."""
    found: Results = {"states": QUICK_COUNT if quick else COUNT, "robots": {}}
    with tempfile.TemporaryDirectory() as folder:
        for name in ROBOTS[:1] if quick else ROBOTS:
            found["robots"][name] = compare(rne.load(name), Path(folder) / name, quick)
    return found


def compare(robot: rne.Robot, folder: Path, quick: bool) -> Results:
    """Time per state and error of each way."""
    count, repeats, rounds = (QUICK_COUNT, QUICK_REPEATS, QUICK_ROUNDS) if quick else (COUNT, REPEATS, ROUNDS)
    folder.mkdir()
    kernel = robot.kernel(rne.dynamics.inverse_dynamics)
    arrays = states(robot.n, count)
    truth = exact(kernel, arrays)
    libraries = {OURS: c_of(kernel, "float64", folder), "C, single": c_of(kernel, "float32", folder)}
    if shutil.which("rustc"):
        libraries |= {"Rust, f64": rust_of(kernel, "float64", folder), "Rust, f32": rust_of(kernel, "float32", folder)}
    if import_failure("casadi") is None:
        libraries[CASADI] = casadi_of(robot.model, folder)
    calls, errors = {}, {}
    for name, library in libraries.items():
        dtype = "float32" if name in ("C, single", "Rust, f32") else "float64"
        calls[name], errors[name] = prepared(library, arrays, dtype, rounds, truth)
    seconds = per_state({name: (call, count * rounds) for name, call in calls.items()}, repeats, time.process_time)
    return {
        name: {
            "ns_per_state": nanoseconds(seconds[name]),
            "worst_error": errors[name],
            "of_casadis_time": ratio(seconds, name, CASADI) if CASADI in seconds else None,
        }
        for name in libraries
    }


def prepared(library: Path, arrays: list[np.ndarray], dtype: str, rounds: int, truth: np.ndarray) -> tuple[Any, float]:
    """A call of the loop on all states, and the error of the first ones."""
    given = [np.ascontiguousarray(a, dtype) for a in arrays]
    out = np.zeros_like(given[0])
    function = ctypes.CDLL(str(library)).run
    function.argtypes = [np.ctypeslib.ndpointer(dtype, flags="C")] * 4 + [ctypes.c_int] * 2
    function.restype = None

    def call() -> None:
        function(*given, out, len(out), rounds)

    function(*given, out, len(out), 1)
    return call, error(out[:EXACT].astype(float), truth)


def c_of(kernel: Any, dtype: str, folder: Path) -> Path:
    """Printed C, and the loop in a file of its own, so that nothing is computed ahead of it."""
    real, _ = REAL[dtype]
    code, loop, library = folder / f"{real}.c", folder / f"{real}_loop.c", folder / f"{real}.so"
    code.write_text(kernel.source("c", dtype=dtype))
    loop.write_text(LOOP.format(real=real, declaration=OWN.format(real=real), call=PLAIN.format(n=kernel.model.n)))
    subprocess.run(["gcc", *OPTIONS, code, loop, "-o", library, "-lm"], check=True)
    return library


def rust_of(kernel: Any, dtype: str, folder: Path) -> Path:
    """Printed Rust as a static library of C's convention, and the same loop."""
    real, kind = REAL[dtype]
    n = kernel.model.n
    arguments = ", ".join(f"{name}: &[{kind}; {n}]" for name in kernel.names)
    exported = f"""
#[no_mangle]
pub extern "C" fn rust_{kind}({arguments}, out: &mut [{kind}; {n}]) {{
    inverse_dynamics({", ".join(kernel.names)}, out)
}}
"""
    code, loop, library = folder / f"{kind}.rs", folder / f"{kind}_loop.c", folder / f"{kind}.so"
    code.write_text(kernel.source("rust", dtype=dtype) + exported)
    name = f"rust_{kind}"
    declaration = OWN.format(real=real).replace("inverse_dynamics", name)
    loop.write_text(
        LOOP.format(real=real, declaration=declaration, call=PLAIN.format(n=n).replace("inverse_dynamics", name))
    )
    options = "--edition", "2021", "--crate-type", "lib", "--emit", "obj", "-C", "opt-level=3", "-C", "panic=abort"
    object_code = code.with_suffix(".o")
    subprocess.run(["rustc", *options, "-C", "relocation-model=pic", code, "-o", object_code], check=True)
    subprocess.run(["gcc", *OPTIONS, loop, object_code, "-o", library, "-lm"], check=True)
    return library


def casadi_of(model: rne.Model, folder: Path) -> Path:
    """C that CasADi generates from the recursion, and the same loop."""
    import casadi as ca

    q, qd, qdd = (ca.SX.sym(name, model.n) for name in ("q", "qd", "qdd"))
    function = ca.Function("peer", [q, qd, qdd], [ca.densify(recursion(model, q, qd, qdd))])
    generator = ca.CodeGenerator("peer.c")
    generator.add(function)
    generator.generate(f"{folder}/")
    loop, library = folder / "peer_loop.c", folder / "peer.so"
    memory = f"{PEER}\nstatic double w[{max(function.sz_w(), 1)}];"
    loop.write_text(LOOP.format(real="double", declaration=memory, call=OF_PEER.format(n=model.n)))
    subprocess.run(["gcc", *OPTIONS, folder / "peer.c", loop, "-o", library, "-lm"], check=True)
    return library


def tables(results: Results) -> dict[str, str]:
    """The table, by its name."""
    head = ["robot", "code", "ns per state", "of CasADi's time", "worst error"]
    lines = [
        [
            robot,
            name,
            f"{row['ns_per_state']:.0f}",
            three(row["of_casadis_time"]) if row["of_casadis_time"] else "-",
            f"{row['worst_error']:.0e}",
        ]
        for robot, rows in results["robots"].items()
        for name, row in rows.items()
    ]
    return {"elsewhere-c": table(head, lines)}


def main() -> None:
    quick = is_quick(__doc__)
    print("\n\n".join(tables(run(quick)).values()))
    if quick:
        print(QUICK_NOTE)


if __name__ == "__main__":
    main()
