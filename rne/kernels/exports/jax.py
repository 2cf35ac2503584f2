"""Export of a kernel as a function of JAX: machine code called by XLA, or the program in jax.numpy."""

from __future__ import annotations

import importlib.util
import operator
from collections.abc import Callable, Sequence
from functools import partial, reduce
from typing import Any

from ...dynamics.quantity import common_leading_shape
from ...graph.program import ON_ARRAYS, interpret
from ..soundness import Conditions, Trace
from .rules import BACKWARDS, FORWARDS, Rules

MODES = ("reverse", "forward")


def to_jax(kernel: Any, mode: str) -> Callable[..., Any]:
    """JAX function of a kernel; see `Kernel.to_jax`."""
    if mode not in MODES:
        raise ValueError(f"`mode` must be one of {list(MODES)}, got {mode!r}")
    if importlib.util.find_spec("jax") is None:
        raise ImportError("`to_jax` needs JAX, which is not installed: pip install 'rne[jax]'")
    import jax
    import jax.numpy as jnp

    run: Callable[..., Any] = partial(printed, kernel.whole)
    if kernel.engine == "numba" and jax.default_backend() == "cpu":
        run = _with_rules(mode, kernel, Rules(kernel, jnp, partial(_with_rules, mode)))

    def function(*arguments: Any) -> Any:
        arrays, dtype = _arrays(kernel, arguments)
        return run(*arrays).astype(dtype)

    function.__name__, function.__doc__ = kernel.quantity.name, repr(kernel)
    compiled: Callable[..., Any] = jax.jit(function)
    return compiled


def _arrays(kernel: Any, arguments: Sequence[Any]) -> tuple[list[Any], Any]:
    """Arguments with a common leading shape, in the dtype to compute in, and the dtype of the result."""
    import jax.numpy as jnp

    if len(arguments) != len(kernel.names):
        raise TypeError(f"{kernel.quantity.name} takes {', '.join(kernel.names)}; got {len(arguments)} arguments")
    arrays = [jnp.asarray(a) for a in arguments]
    for name, array, width in zip(kernel.names, arrays, kernel.widths, strict=True):
        if array.shape[-1:] != (width,):
            robot = f"for robot {kernel.model.name!r}"
            raise ValueError(f"`{name}` must have shape (..., {width}) {robot}, got {array.shape}")
    dtype = jnp.result_type(float, *arrays)
    if not jnp.issubdtype(dtype, jnp.floating):
        raise TypeError(f"arguments must be real numbers, got {dtype}")
    leading = common_leading_shape(dict(zip(kernel.names, arrays, strict=True)))
    number = jnp.promote_types(dtype, jnp.float32)
    return [jnp.broadcast_to(a, (*leading, a.shape[-1])).astype(number) for a in arrays], dtype


def _with_rules(mode: str, kernel: Any, rules: Rules) -> Any:
    """Machine code as a function of arrays, with its derivatives by the rules."""
    import jax

    plain = partial(called, kernel.whole)
    if not rules.apply(kernel, BACKWARDS if mode == "reverse" else FORWARDS):
        return plain
    function: Any = jax.custom_vjp(plain) if mode == "reverse" else jax.custom_jvp(plain)
    if mode == "reverse":
        function.defvjp(lambda *x: (function(*x), x), partial(rules.backwards, kernel))
    else:
        function.defjvp(lambda x, along: (function(*x), rules.forwards(kernel, x, along)))
    return function


def called(trace: Trace, *arrays: Any) -> Any:
    """Results of machine code on arrays (..., width), broadcast against each other."""
    import jax
    import jax.numpy as jnp

    from .xla import target

    leading, dtype = jnp.broadcast_shapes(*(a.shape[:-1] for a in arrays)), arrays[0].dtype
    result = jax.ShapeDtypeStruct((*leading, *trace.shape), dtype)
    call = jax.ffi.ffi_call(target(trace, str(dtype)), result, vmap_method="broadcast_all")
    return call(*(jnp.broadcast_to(a, (*leading, a.shape[-1])) for a in arrays))


def printed(trace: Trace, *arrays: Any) -> Any:
    """Program in jax.numpy on arrays (..., width) of one leading shape; NaN for states to be examined."""
    import jax.numpy as jnp

    own: dict[str, Callable[..., Any]] = {
        "less": lambda a, b: jnp.where(a < b, 1.0, 0.0),
        "less_equal": lambda a, b: jnp.where(a <= b, 1.0, 0.0),
        "where": lambda condition, a, b: jnp.where(condition != 0, a, b),
    }
    leading, dtype = arrays[0].shape[:-1], arrays[0].dtype
    inputs = [a[..., k] for a in arrays for k in range(a.shape[-1])]
    operations = {kind: own.get(kind) or getattr(jnp, kind) for kind in ON_ARRAYS}
    found = interpret(trace.program, inputs, operations, float)
    columns = [jnp.broadcast_to(jnp.asarray(x, dtype), leading) for x in found]
    outputs = jnp.stack(columns) if columns else jnp.zeros((0, *leading), dtype)  # XLA computes them once
    sound = Conditions(
        finite=lambda values: jnp.isfinite(jnp.asarray(values)).all(0),
        within=lambda values, bound: (jnp.asarray(values) ** 2).sum(0) <= bound**2,  # as machine code has it
        above=lambda values, factor, others: (values > factor * others).all(0),
    )
    conditions = trace.sound_inputs(inputs, dtype, sound) + trace.sound_results(outputs, dtype, sound)
    factor = jnp.where(reduce(operator.and_, conditions), 1.0, jnp.nan).astype(dtype)  # derivatives become NaN as well
    return jnp.moveaxis(outputs[: trace.entries] * factor, 0, -1).reshape(leading + trace.shape)
