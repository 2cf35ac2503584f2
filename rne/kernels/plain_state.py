"""The shortest way to a kernel: one state, given as a float64 vector per argument."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from types import CodeType
from typing import Any

import numpy as np

from ..basics.spatial import Array
from .python_backend import Refused

PlainState = Callable[..., Array | None]


def plain_state_call(widths: Sequence[int], make: Callable[[], Callable[..., Array]]) -> PlainState:
    """A function that gives the result for plain vectors of these lengths, and None for all else.

    None is also the answer where the recursion must look closer. The checks are written out, because a loop over the
    arguments would cost as much as the kernel.

    Parameters
    ----------
    widths : sequence of int
        Number of inputs of each argument.
    make : callable
        Gives the function of one state, as compiled code, when it is first needed.
    """

    def first(*arrays: Array) -> Array:
        namespace["state"] = make()
        result: Array = namespace["state"](*arrays)
        return result

    namespace: dict[str, Any] = {f"s{k}": (width,) for k, width in enumerate(widths)}
    namespace |= {"ndarray": np.ndarray, "float64": np.dtype("float64"), "Refused": Refused, "state": first}
    exec(_code(len(widths)), namespace)
    call: PlainState = namespace["call"]
    return call


@cache
def _code(count: int) -> CodeType:
    arguments = ", ".join(f"a{k}" for k in range(count))
    checks = [f"type(a{k}) is ndarray and a{k}.dtype is float64 and a{k}.shape == s{k}" for k in range(count)]
    lines = [
        f"def call({arguments}):",
        f"    if {' and '.join(checks)}:",
        "        try:",
        f"            return state({arguments})",
        "        except Refused:",
        "            return None",
        "    return None",
    ]
    return compile("\n".join(lines) + "\n", "<rne plain state>", "exec")
