"""Batches: states in blocks, blocks on threads, and what is said when something is wrong in one of them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arguments import joint_array
from ..dynamics.checks import common_leading_shape
from ..dynamics.precision import DOUBTFUL, Few, gather, give, pivots_below
from ..errors import SingularMassMatrixError
from ..spatial import Array
from .block import Workspace, block_length

if TYPE_CHECKING:
    from .kernel import Kernel


def run_batch(kernel: Kernel, arrays: Sequence[Array], dtype: np.dtype[Any], out: Array | None, workers: int) -> Array:
    """The kernel on arrays of shape (..., n), broadcast against each other."""
    leading = common_leading_shape(dict(zip(kernel.names, arrays, strict=True)))
    shape = leading + kernel.shapes[0]
    out = np.empty(shape, dtype=dtype) if out is None else check_out(out, shape, dtype, kernel.names, arrays)
    count = int(np.prod(leading, dtype=np.int64))
    states = [np.broadcast_to(a, leading + a.shape[-1:]).reshape(count, a.shape[-1]) for a in arrays]
    results = out.reshape(count, int(np.prod(kernel.shapes[0], dtype=np.int64)))
    length = block_length(kernel.layout.registers, dtype.itemsize)
    if count < length * workers:  # equal shares, and no larger registers than the states need
        length = max(1, -(-count // workers))
    starts = range(0, count, length)
    batch = _Batch(kernel, states, results, dtype, leading)

    def share(k: int) -> None:
        with np.errstate(all="ignore"), _Borrowed(kernel, length, dtype) as workspace:
            for start in starts[k::workers]:
                batch.run(workspace, start, min(start + length, count))

    if workers == 1 or len(starts) < 2:
        for k in range(workers):
            share(k)
    else:
        from concurrent.futures import ThreadPoolExecutor

        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(share, range(workers)))
    give(batch.few)
    return out


def check_out(
    out: Array, shape: tuple[int, ...], dtype: np.dtype[Any], names: Sequence[str], arrays: Sequence[Array]
) -> Array:
    """Refuse an `out` of another shape or dtype, or one that overlays an input."""
    if not isinstance(out, np.ndarray) or out.shape != shape or out.dtype != dtype:
        got = f"{out.dtype} {out.shape}" if isinstance(out, np.ndarray) else type(out).__name__
        raise ValueError(f"`out` must be a {dtype} array of shape {shape}, got {got}")
    if not out.flags.c_contiguous or not out.flags.writeable:
        raise ValueError("`out` must be C-contiguous and writeable")
    for name, array in zip(names, arrays, strict=True):
        if np.may_share_memory(out, array):
            raise ValueError(f"`out` must not share memory with `{name}`")
    return out


class _Borrowed:
    """A workspace of the kernel's own, given back when done, so that threads never share one."""

    def __init__(self, kernel: Kernel, length: int, dtype: np.dtype[Any]) -> None:
        self.pool = kernel.workspaces[dtype.name]
        self.kernel, self.length, self.dtype = kernel, length, dtype

    def __enter__(self) -> Workspace:
        try:
            self.workspace = self.pool.pop()
        except IndexError:
            self.workspace = Workspace(self.kernel.layout, self.length, self.dtype)
        if self.workspace.rows.shape[1] < self.length:
            self.workspace = Workspace(self.kernel.layout, self.length, self.dtype)
        return self.workspace

    def __exit__(self, *_: object) -> None:
        self.pool.append(self.workspace)


class _Batch:
    """Arrays of one call."""

    def __init__(
        self, kernel: Kernel, states: list[Array], results: Array, dtype: np.dtype[Any], leading: tuple[int, ...]
    ) -> None:
        self.kernel, self.states, self.results = kernel, states, results
        self.dtype, self.leading = dtype, leading
        self.few: list[Few] = []
        edges = np.cumsum([0, *kernel.widths])
        self.inputs = [slice(a, b) for a, b in itertools.pairwise(edges.tolist())]
        self.first_output = int(edges[-1])

    def run(self, workspace: Workspace, begin: int, end: int) -> None:
        """One block."""
        m = end - begin
        rows = workspace.rows[:, :m]
        for place, array in zip(self.inputs, self.states, strict=True):
            rows[place] = array[begin:end].T
        sound = all([all_finite(rows[k]) for k in self.kernel.unchecked_inputs])
        for call, arguments in workspace.calls(m):
            call(*arguments)
        stop = self.first_output + self.results.shape[1]
        if sound and self._is_sound(rows[self.first_output :], stop - self.first_output):
            store(rows[self.first_output : stop], self.results[begin:end])
        else:
            self.results[begin:end] = self._by_function(begin, end)

    def _is_sound(self, outputs: Array, size: int) -> bool:
        if not all_finite(outputs[:size]):
            return False
        if not self.kernel.judged:
            return True
        n = self.kernel.model.n
        pivots, diagonal = outputs[size : size + n].T, outputs[size + n : size + 2 * n].T
        return not pivots_below(DOUBTFUL, pivots, diagonal).any()

    def _by_function(self, begin: int, end: int) -> Array:
        """The block by the recursion itself, which names what is wrong; states are counted in the whole batch."""
        for name, array, width in zip(self.kernel.names, self.states, self.kernel.widths, strict=True):
            joint_array(name, array.reshape(*self.leading, width), self.kernel.model, width)
        try:
            with gather() as few:
                result = self.kernel.by_function([array[begin:end].astype(self.dtype) for array in self.states])
        except SingularMassMatrixError as error:
            raise error.at(self._state(begin, error.state)) from None
        self.few += [one._replace(state=self._state(begin, one.state)) for one in few]
        return np.asarray(result).reshape(end - begin, -1)

    def _state(self, begin: int, local: tuple[int, ...]) -> tuple[int, ...]:
        """A state of a block, counted in the whole batch."""
        k = begin + (local[0] if local else 0)
        return tuple(int(i) for i in np.unravel_index(k, self.leading))


def store(rows: Array, results: Array) -> None:
    """Registers to states: column by column while these share a cache line, otherwise in one sweep."""
    if len(rows) > 8:
        results[...] = rows.T
        return
    for k, row in enumerate(rows):
        results[:, k] = row


def all_finite(rows: Array) -> bool:
    """True if every entry is finite; a finite sum shows it at once."""
    with np.errstate(all="ignore"):
        return bool(np.isfinite(rows.sum())) or bool(np.isfinite(rows).all())
