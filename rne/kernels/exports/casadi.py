"""A program as a CasADi function: its operations on SX scalars, which CasADi then differentiates and prints itself."""

from __future__ import annotations

import operator
from collections.abc import Callable
from math import prod
from typing import TYPE_CHECKING, Any

from ...basics.arrays import whole_number
from ..program import Operand

if TYPE_CHECKING:
    from ..kernel import Kernel

OPERATORS: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": operator.truediv,
    "negative": operator.neg,
    "less": operator.lt,
    "less_equal": operator.le,
}
# Operations whose function has another name in CasADi; sin, cos, sqrt, tanh, exp and sign have the same.
NAMES = {"abs": "fabs", "arctan2": "atan2", "minimum": "fmin", "maximum": "fmax", "where": "if_else"}
SPARSE = ("jacobian", "hessian")  # orders whose zeros are structural, as in CasADi's own derivatives


def to_casadi(kernel: Kernel, title: str, name: str | None = None, symbolic: str = "SX") -> Any:
    """The function of a kernel's arrays, called by its title unless a name is given; see `Kernel.to_casadi`."""
    ca, trace = _casadi(), kernel.traced
    name, kind = _name(ca, name, title), _kind(ca, symbolic)
    inputs = [ca.SX.sym(argument, width) for argument, width in zip(kernel.names, kernel.widths, strict=True)]
    entries, results = ca.vertsplit(ca.vertcat(*inputs)), list[Any]()

    def value(arg: Operand) -> Any:
        if arg.kind == "constant":
            return ca.SX(arg.value)
        return (entries if arg.kind == "input" else results)[int(arg.value)]

    for operation, args in trace.program.instructions:
        call = OPERATORS.get(operation) or getattr(ca, NAMES.get(operation, operation))
        results.append(call(*map(value, args)))
    result = ca.vertcat(*map(value, trace.program.outputs[: trace.entries]))
    if len(trace.shape) > 1:  # CasADi counts the entries of a matrix column by column
        result = ca.reshape(result, trace.shape[-1], prod(trace.shape[:-1])).T
    if kernel.order in SPARSE:
        result = ca.sparsify(result)
    if kind is ca.MX:  # a call of the function of scalars
        function = ca.Function(f"{name}_of_scalars", inputs, [result])
        inputs = [ca.MX.sym(argument, width) for argument, width in zip(kernel.names, kernel.widths, strict=True)]
        result = function(*inputs)
    return ca.Function(name, inputs, [result], list(kernel.names), ["result"])


def scene_to_casadi(kernel: Kernel, title: str, name: str | None, symbolic: str, steps: int | None) -> Any:
    """(dx/dt, torques) of a kernel of (t, x, ...) that gives both in one array, or (x(t + h), torques at t).

    The latter is taken in `steps` classical Runge-Kutta steps, and h is the last argument; see `Scene.to_casadi`.
    """
    ca = _casadi()
    name, kind = _name(ca, name, title), _kind(ca, symbolic)
    both, size = to_casadi(kernel, f"{name}_rates_and_torques"), kernel.widths[1]
    inputs = [kind.sym(argument, width) for argument, width in zip(kernel.names, kernel.widths, strict=True)]
    t, x, *further = inputs

    def rates(t: Any, x: Any) -> tuple[Any, Any]:
        found = ca.vertsplit(both(t, x, *further), [0, size, kernel.traced.entries])
        return found[0], found[1]

    dx, tau = rates(t, x)
    if steps is None:
        return ca.Function(name, inputs, [dx, tau], list(kernel.names), ["dx", "tau"])
    duration = kind.sym("h")
    h = duration / whole_number("steps", steps, least=1)
    for k in range(steps):
        k1 = rates(t, x)[0] if k else dx
        k2 = rates(t + h / 2, x + h / 2 * k1)[0]
        k3 = rates(t + h / 2, x + h / 2 * k2)[0]
        k4 = rates(t + h, x + h * k3)[0]
        t, x = t + h, x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function(name, [*inputs, duration], [x, tau], [*kernel.names, "h"], ["x_next", "tau"])


def _casadi() -> Any:
    """The package, or an ImportError with the cure."""
    try:
        import casadi
    except ImportError:
        raise ImportError("CasADi is not installed: pip install 'rne[casadi]'") from None
    return casadi


def _name(ca: Any, name: str | None, title: str) -> str:
    """The name of a function: the title with what CasADi does not allow in a name replaced, or the one that is given."""
    if name is not None and not (isinstance(name, str) and ca.Function.check_name(name)):
        raise ValueError(f"`name` must be letters, digits and single underscores after a letter, got {name!r}")
    return name or str(ca.Function.fix_name(title))


def _kind(ca: Any, symbolic: str) -> Any:
    """CasADi's type of symbols."""
    if symbolic not in ("SX", "MX"):
        raise ValueError(f"`symbolic` must be 'SX' or 'MX', got {symbolic!r}")
    return getattr(ca, symbolic)
