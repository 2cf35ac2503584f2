"""Export of a program as a CasADi function: operations on SX scalars, which CasADi differentiates and prints."""

from __future__ import annotations

from math import prod
from typing import Any

from ...basics.arrays import whole_number
from ...graph.program import ON_ARRAYS, interpret

ARITHMETIC = ("add", "subtract", "multiply", "divide", "negative")  # by the operators of SX
# Functions of another name in CasADi; the others have the same.
NAMES = {"abs": "fabs", "minimum": "fmin", "maximum": "fmax", "where": "if_else"}
NAMES |= {"less": "lt", "less_equal": "le"}
SPARSE = ("jacobian", "hessian")  # orders whose zeros are structural, as in CasADi's own derivatives


def to_casadi(kernel: Any, name: str, symbolic: str = "SX") -> Any:
    """CasADi function of a kernel; see `Kernel.to_casadi`."""
    ca, trace = _casadi(name, symbolic), kernel.printable
    inputs = _symbols(ca.SX, kernel)
    functions = {kind: getattr(ca, NAMES.get(kind, kind)) for kind in ON_ARRAYS if kind not in ARITHMETIC}
    operations = ON_ARRAYS | functions
    outputs = interpret(trace.program, ca.vertsplit(ca.vertcat(*inputs)), operations, ca.SX)
    result = ca.vertcat(*outputs[: trace.entries])
    if len(trace.shape) > 1:  # CasADi counts the entries of a matrix column by column
        result = ca.reshape(result, trace.shape[-1], prod(trace.shape[:-1])).T
    if kernel.order in SPARSE:
        result = ca.sparsify(result)
    if symbolic == "MX":
        scalar = ca.Function(f"{name}_of_scalars", inputs, [result])
        inputs = _symbols(ca.MX, kernel)
        result = scalar(*inputs)
    return ca.Function(name, inputs, [result], list(kernel.names), ["result"])


def scene_to_casadi(kernel: Any, name: str, symbolic: str, steps: int | None) -> Any:
    """CasADi function of a kernel of (t, x, ...) with rates and torques in one array; see `Scene.to_casadi`."""
    ca = _casadi(name, symbolic)
    both, size, kind = to_casadi(kernel, f"{name}_in_one"), kernel.widths[1], getattr(ca, symbolic)
    t, x, *further = inputs = _symbols(kind, kernel)

    def rates(t: Any, x: Any) -> Any:
        return ca.vertsplit(both(t, x, *further), [0, size, kernel.traced.entries])

    dx, tau = rates(t, x)
    if steps is None:
        return ca.Function(name, inputs, [dx, tau], list(kernel.names), ["dx", "tau"])
    duration = kind.sym("h")
    h = duration / whole_number("steps", steps)
    for k in range(steps):
        k1 = rates(t, x)[0] if k else dx
        k2 = rates(t + h / 2, x + h / 2 * k1)[0]
        k3 = rates(t + h / 2, x + h / 2 * k2)[0]
        k4 = rates(t + h, x + h * k3)[0]
        t, x = t + h, x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function(name, [*inputs, duration], [x, tau], [*kernel.names, "h"], ["x_next", "tau"])


def _casadi(name: str, symbolic: str) -> Any:
    """Package casadi, with errors if it is not installed, or the name or the type is invalid."""
    try:
        import casadi
    except ImportError:
        raise ImportError("CasADi is not installed: pip install 'rne[casadi]'") from None
    if not (isinstance(name, str) and casadi.Function.check_name(name)):
        raise ValueError(f"`name` must be letters, digits and single underscores after a letter, got {name!r}")
    if symbolic not in ("SX", "MX"):
        raise ValueError(f"`symbolic` must be 'SX' or 'MX', got {symbolic!r}")
    return casadi


def _symbols(kind: Any, kernel: Any) -> list[Any]:
    return [kind.sym(name, width) for name, width in zip(kernel.names, kernel.widths, strict=True)]
