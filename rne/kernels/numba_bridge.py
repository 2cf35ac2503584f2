"""Batches by the machine code of LLVM's, as Numba's functions call them."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic


def rows_function(address: int, count: int, dtype: np.dtype[Any]) -> Any:
    """f(*arguments, out, begin, end) of arrays of rows."""
    number: Any = {"float64": types.float64, "float32": types.float32}[dtype.name]
    given: Any = types.Array(number, 2, "A", readonly=True, aligned=False)
    names = [f"a{k}" for k in range(count)]

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        integer, byte = ir.IntType(64), ir.IntType(8).as_pointer()
        arrays, begin, end = args[0], args[1], args[2]
        values = []
        for k, kind in enumerate(signature.args[0]):
            array = context.make_array(kind)(context, builder, builder.extract_value(arrays, k))
            values += [builder.bitcast(array.data, byte), builder.extract_value(array.strides, 0)]
        function = ir.FunctionType(integer, [value.type for value in (*values, begin, end)]).as_pointer()
        return builder.call(builder.inttoptr(ir.Constant(integer, address), function), [*values, begin, end])

    call: Any = intrinsic(lambda typing, arrays, begin, end: (types.int64(arrays, begin, end), emit))
    namespace = {"call": call}
    text = (
        f"def function({', '.join(names)}, out, begin, end):\n    return call(({', '.join(names)}, out), begin, end)\n"
    )
    exec(text, namespace)
    kinds: Any = [given] * count + [types.Array(number, 2, "C"), types.int64, types.int64]
    return njit([tuple(kinds)], nogil=True)(namespace["function"])
