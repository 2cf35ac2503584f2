"""A kernel as a function of JAX: its machine code called by XLA, or its program in jax.numpy."""

from __future__ import annotations

import logging
import operator
from collections.abc import Callable, Sequence
from functools import partial, reduce
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from ...dynamics.quantity import common_leading_shape
from ..program import Operand, Trace
from .rules import WITH_RULES, Rules

if TYPE_CHECKING:
    from ..kernel import Kernel

LOGGER = logging.getLogger("rne")
MODES = ("reverse", "forward")
# Operations of programs by their names in jax.numpy.
SAME = ("add", "subtract", "multiply", "divide", "negative", "abs", "sin", "cos", "sqrt", "tanh", "exp", "sign")
SAME += ("arctan2", "minimum", "maximum")


def to_jax(kernel: Kernel, mode: str) -> Callable[..., Any]:
    """See `Kernel.to_jax`."""
    if mode not in MODES:
        raise ValueError(f"`mode` must be one of {list(MODES)}, got {mode!r}")
    if find_spec("jax") is None:
        raise ImportError("`to_jax` needs JAX, which is not installed: pip install 'rne[jax]'")
    import jax
    import jax.numpy as jnp

    trace = kernel.traced
    if by_machine_code(kernel):
        run = _with_rules(mode, kernel, Rules(kernel, jnp, partial(_with_rules, mode)))
    else:
        run = partial(printed, trace)

    def function(*arguments: Any) -> Any:
        arrays, dtype = _arrays(kernel, arguments)
        return run(*arrays).astype(dtype)

    function.__name__ = function.__qualname__ = kernel.quantity.name
    function.__doc__ = f"{kernel!r}"
    return jax.jit(function)  # type: ignore[no-any-return]


def by_machine_code(kernel: Kernel) -> bool:
    """True if XLA calls the kernel's machine code: on a CPU, with an interface that is known."""
    import jax

    if kernel.engine != "numba" or jax.default_backend() != "cpu":
        return False
    from . import xla

    if xla.version()[0] != 0:
        LOGGER.warning("the program runs in jax.numpy in place of machine code: this jaxlib has another interface")
        return False
    return True


def _arrays(kernel: Kernel, arguments: Sequence[Any]) -> tuple[list[Any], Any]:
    """Arguments of one leading shape, in the dtype to compute in; the dtype of the result, which may be shorter."""
    import jax.numpy as jnp

    if len(arguments) != len(kernel.names):
        raise TypeError(f"this function takes {', '.join(kernel.names)}; got {len(arguments)} arguments")
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


def _with_rules(mode: str, kernel: Kernel, rules: Rules) -> Callable[..., Any]:
    """The machine code as a function of arrays that JAX can differentiate."""
    import jax

    plain = partial(called, kernel.traced)
    if kernel.order not in WITH_RULES:
        return plain
    if mode == "reverse":
        reverse = jax.custom_vjp(plain)
        reverse.defvjp(lambda *x: (reverse(*x), x), partial(rules.backwards, kernel))
        return reverse
    forward = jax.custom_jvp(plain)
    forward.defjvp(lambda x, along: (forward(*x), rules.forwards(kernel, x, along)))
    return forward


def called(trace: Trace, *arrays: Any) -> Any:
    """The results of machine code on arrays (..., width)."""
    import jax
    import jax.numpy as jnp

    from .xla import target

    leading, dtype = jnp.broadcast_shapes(*(a.shape[:-1] for a in arrays)), arrays[0].dtype
    rows = [jnp.broadcast_to(a, (*leading, a.shape[-1])) for a in arrays]
    result = jax.ShapeDtypeStruct((*leading, *trace.shape), dtype)
    return jax.ffi.ffi_call(target(trace, str(dtype)), result, vmap_method="broadcast_all")(*rows)


def printed(trace: Trace, *arrays: Any) -> Any:
    """The program in jax.numpy on arrays (..., width) of one leading shape; states that it cannot vouch for are NaN."""
    import jax.numpy as jnp

    of: dict[str, Callable[..., Any]] = {name: getattr(jnp, name) for name in SAME}
    of |= {
        "less": lambda a, b: jnp.where(a < b, 1.0, 0.0),
        "less_equal": lambda a, b: jnp.where(a <= b, 1.0, 0.0),
        "where": lambda condition, a, b: jnp.where(condition != 0, a, b),
    }
    leading, dtype = arrays[0].shape[:-1], arrays[0].dtype
    inputs, results = [a[..., k] for a in arrays for k in range(a.shape[-1])], list[Any]()

    def value(arg: Operand) -> Any:
        return arg.value if arg.kind == "constant" else (inputs if arg.kind == "input" else results)[int(arg.value)]

    for kind, args in trace.program.instructions:
        results.append(of[kind](*map(value, args)))
    outputs = [jnp.broadcast_to(jnp.asarray(value(arg), dtype), leading) for arg in trace.program.outputs]
    conditions = trace.sound_inputs(inputs, dtype, Sound()) + trace.sound_results(outputs, dtype, Sound())
    factor = jnp.where(reduce(operator.and_, conditions, True), 1.0, jnp.nan)  # slopes become NaN as well
    columns = [output * factor.astype(dtype) for output in outputs[: trace.entries]]
    found = jnp.stack(columns, axis=-1) if columns else jnp.zeros((*leading, 0), dtype)
    return found.reshape(leading + trace.shape)


class Sound:
    """Conditions of soundness on arrays of JAX."""

    def finite(self, values: Sequence[Any]) -> Any:
        """Every value is finite."""
        import jax.numpy as jnp

        return reduce(operator.and_, map(jnp.isfinite, values), True)

    def within(self, values: Sequence[Any], bound: float) -> Any:
        """No value exceeds the bound in size."""
        return reduce(operator.and_, [abs(value) <= bound for value in values], True)

    def above(self, values: Sequence[Any], factor: float, others: Sequence[Any]) -> Any:
        """Each value exceeds the factor times its partner."""
        return reduce(operator.and_, [a > factor * b for a, b in zip(values, others, strict=True)], True)
