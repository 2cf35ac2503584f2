"""CasADi on the source text of our kernel, so the same operations: in its virtual machine, and as C that it writes."""

from __future__ import annotations

import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.registry import Case, Point, compiler, peer

REQUIREMENT = "casadi>=3.7"
FLAGS = ["-O3", "-march=native", "-shared", "-fPIC"]


@peer("CasADi VM", requirement=REQUIREMENT, modules=("casadi",))
def points(case: Case) -> list[Point]:
    """The virtual machine, on all states in one call."""
    batch = Batch(kernel_as_function(case).map(len(case.arrays[0])), case)
    return [Point("CasADi VM, batch", batch.call, batch.count, batch.results)]


@peer("CasADi in C", requirement=REQUIREMENT, modules=("casadi",), compiles=True)
def compiled_points(case: Case) -> list[Point]:
    """The C that CasADi writes, on all states in one call."""
    return [in_c("CasADi in C, batch", kernel_as_function(case), case)]


def kernel_as_function(case: Case) -> Any:
    """The kernel as a CasADi Function of one state."""
    import casadi as ca

    scope: dict[str, Any] = {}
    exec(case.kernel.source("python"), scope)
    scope |= {"sin": ca.sin, "cos": ca.cos, "sqrt": ca.sqrt}
    symbols = [ca.SX.sym(name, a.shape[1]) for name, a in zip(case.kernel.names, case.arrays, strict=True)]
    result = scope[case.kernel.quantity.name](*[[s[i] for i in range(s.shape[0])] for s in symbols])
    return ca.Function("f", symbols, [ca.vertcat(*_flat(result))])


def in_c(name: str, function: Any, case: Case) -> Point:
    """A CasADi Function of one state, compiled for all states in one call."""
    library, seconds = compiled(function.map(len(case.arrays[0])))
    batch = Batch(library, case)
    return Point(name, batch.call, batch.count, batch.results, build_s=seconds)


class Batch:
    """A mapped Function on NumPy's own memory: CasADi's usual call copies the states and takes several times longer."""

    def __init__(self, mapped: Any, case: Case) -> None:
        self.arrays = [np.ascontiguousarray(a) for a in case.arrays]  # (N, n) by rows is CasADi's n x N by columns
        self.count = len(self.arrays[0])
        self.out = np.zeros((self.count, *case.kernel.traced.shape))
        self.buffer, self.call = mapped.buffer()
        for i, a in enumerate(self.arrays):
            self.buffer.set_arg(i, memoryview(a))
        self.buffer.set_res(0, memoryview(self.out))

    def results(self, few: int) -> np.ndarray:
        """Results of the first states."""
        self.call()
        return self.out[:few].copy()


def compiled(function: Any) -> tuple[Any, float]:
    """The Function in C, and the seconds it took to write and compile it."""
    import casadi as ca

    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder) / "f.c", Path(folder) / "f.so"
        generator = ca.CodeGenerator(source.name)
        generator.add(function)
        generator.generate(f"{folder}/")
        subprocess.run([str(compiler()), *FLAGS, str(source), "-o", str(library), "-lm"], check=True)
        return ca.external(function.name(), str(library)), time.perf_counter() - start


def _flat(rows: Any) -> list[Any]:
    return [x for row in rows for x in _flat(row)] if isinstance(rows, list | tuple) else [rows]
