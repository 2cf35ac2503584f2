"""CasADi on our kernel's own source, so the same operations: in its virtual machine, and as the C that it writes."""

from __future__ import annotations

import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import rne
from benchmarks.peers.found import Case, Point, compiler, module

FLAGS = ["-O3", "-march=native", "-shared", "-fPIC"]


def points(case: Case) -> list[Point]:
    """The virtual machine, and C where there is a compiler."""
    peer = CasADi(case.kernel, case.arrays)
    found = [Point("CasADi VM, batch", peer.batch, len(case.arrays[0]), peer.results)]
    return found + compiled_point("CasADi in C, batch", peer.function, case)


def compiled_point(name: str, function: Any, case: Case) -> list[Point]:
    """The Function in C on all states, if there is a compiler."""
    if compiler() is None:
        return []
    count = len(case.arrays[0])
    library, seconds = compiled(function.map(count))
    batch = Batch(library, case.arrays, (count, *case.kernel.shapes[0]))
    return [Point(name, batch.call, count, batch.results, build_s=seconds)]


class CasADi:
    """The kernel as a Function, mapped over all states."""

    def __init__(self, kernel: rne.Kernel, arrays: list[np.ndarray]) -> None:
        ca = module("casadi")
        scope: dict[str, Any] = {}
        exec(kernel.source("python"), scope)
        scope |= {"sin": ca.sin, "cos": ca.cos, "sqrt": ca.sqrt}
        symbols = [ca.SX.sym(name, a.shape[1]) for name, a in zip(kernel.names, arrays, strict=True)]
        flat = _flat(scope[kernel.function.__name__](*[[s[i] for i in range(s.shape[0])] for s in symbols]))
        self.function = ca.Function("f", symbols, [ca.vertcat(*flat)])
        count = len(arrays[0])
        batch = Batch(self.function.map(count), arrays, (count, *kernel.shapes[0]))
        self.batch, self.results = batch.call, batch.results


class Batch:
    """A mapped Function on NumPy's own memory: CasADi's usual call copies the states and takes several times longer."""

    def __init__(self, mapped: Any, arrays: list[np.ndarray], shape: tuple[int, ...]) -> None:
        self.arrays = [np.ascontiguousarray(a) for a in arrays]  # (N, n) by rows is CasADi's n x N by columns
        self.out = np.zeros(shape)
        self.buffer, self.call = mapped.buffer()
        for i, a in enumerate(self.arrays):
            self.buffer.set_arg(i, memoryview(a))
        self.buffer.set_res(0, memoryview(self.out))

    def results(self, count: int) -> np.ndarray:
        """Of the first states."""
        self.call()
        return self.out[:count].copy()


def compiled(function: Any) -> tuple[Any, float]:
    """The Function in C, and the seconds it took to write and compile it."""
    ca, start = module("casadi"), time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder) / "f.c", Path(folder) / "f.so"
        generator = ca.CodeGenerator(source.name)
        generator.add(function)
        generator.generate(f"{folder}/")
        subprocess.run([str(compiler()), *FLAGS, str(source), "-o", str(library), "-lm"], check=True)
        return ca.external(function.name(), str(library)), time.perf_counter() - start


def _flat(rows: Any) -> list[Any]:
    return [x for row in rows for x in _flat(row)] if isinstance(rows, list | tuple) else [rows]
