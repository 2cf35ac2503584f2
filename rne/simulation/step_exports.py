"""Export of one control interval: as functions of CasADi and JAX, and as a function in C."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..integrators.frozen_steps import Schedule
from ..integrators.loops import next_state
from ..kernels.exports.casadi import to_casadi
from ..kernels.kernel import Kernel, with_table
from ..kernels.source import Printable
from ..kernels.units import Unit, unit
from .frozen_motion import FrozenScene
from .named_numbers import plain_name
from .scene_numbers import unknown


def interval_to_casadi(stepper: Any, name: str, symbolic: str, names: Sequence[str]) -> Any:
    """CasADi function of an interval; see `Stepper.to_casadi`."""
    for number in names:
        if number not in stepper.scene.numbers:
            raise ValueError(f"`numbers`: {unknown(number, stepper.scene.numbers)}")
    frozen: FrozenScene = stepper._frozen(stepper.scene, tuple(names))
    kernels, model = list[Any](), frozen.scene.resolved.robot.model
    for function in (frozen.dynamics.right_hand_side, frozen.law and frozen.law.outputs):
        whole: Any = function and replace(function, quantity=replace(function.quantity, of_run=None))
        kernels.append(whole and Kernel(whole, model, {}))  # numbers are an input, nothing is computed of them before
    functions = [
        k and to_casadi(k, f"{name}_{part}", symbolic) for k, part in zip(kernels, ("rates", "law"), strict=True)
    ]
    import casadi as ca

    kind, n, known = getattr(ca, symbolic), stepper.scene.n, stepper.scene.numbers
    widths = {"x": stepper.size, "u": n * frozen.is_driven, "t": int(not frozen.is_driven)}
    widths["piece"] = max(k.widths[k.names.index("piece")] if k and "piece" in k.names else 0 for k in kernels)
    symbols = {key: kind.sym(key, width) for key, width in widths.items() if width}
    plain = {key: plain_name(key) for key in names}
    given = {key: kind.sym(plain[key], known[key].size) for key in names}

    def vector(owner: Any, part: str) -> Any:
        """Numbers that a kernel takes."""
        found = [ca.DM(0, 1)]
        for key, mask in owner.masks.items():
            number = ca.DM(owner.numbers[key].reshape(-1))
            if part + key in given and part + key not in frozen.of_bodies:
                number = given[part + key]
            for body, slopes in {} if part else frozen.of_bodies.items():
                if key in slopes:
                    by_body = ca.DM(slopes[key].reshape(len(slopes[key]), -1).T)
                    number = number + by_body @ (given[body] - ca.DM(known[body].reshape(-1)))
            found.append(number[np.flatnonzero(mask).tolist()])
        return ca.vertcat(*found)

    vectors = [owner and vector(owner, part) for owner, part in ((frozen.dynamics, ""), (frozen.law, "controller."))]

    def call(k: int, t: Any, x: Any, u: Any = None) -> Any:
        arguments = symbols | {"t": t, "x": x, "u": u, "numbers": vectors[k]}
        return functions[k](*(arguments[key] for key in kernels[k].names))

    limit = given.get("effort_limit", ca.DM(known.get("effort_limit", np.full(n, np.inf))))
    x_next = _composed(stepper, ca, call, symbols, limit)
    return ca.Function(name, [*symbols.values(), *given.values()], [x_next], [*symbols, *plain.values()], ["x_next"])


def _composed(stepper: Any, ca: Any, call: Callable[..., Any], symbols: Mapping[str, Any], limit: Any) -> Any:
    """Steps of `advance` on CasADi's symbols: call(0, t, x, u) is dx/dt, call(1, t, x) the sampled law."""
    side, plan, n, t = stepper.own_numbers.side, stepper.schedule, stepper.scene.n, symbols.get("t", 0.0)
    row, size, m = symbols["x"], side.size, side.m
    x, z, held = row[:size], row[size : size + m], symbols.get("u")
    waiting = [row[first : first + n] for first in range(size + m, stepper.size, n)] if n else []
    held = waiting.pop(0) if stepper.holds else held
    for k, h in enumerate(plan.lengths.tolist()):
        if plan.sampled[k]:
            found = call(1, t, ca.vertcat(x, z))
            waiting.append(ca.fmin(ca.fmax(found[:n], -limit), limit))
            z = next_state(side.frozen.update, z, found[n:])
        held = waiting.pop(0) if plan.acting[k] else held
        total = _mean_slope(plan, k, x, lambda at, moved: call(0, t + at, moved, held))  # noqa: B023
        if plan.positions:  # which move with the rates at the end
            rates = slice(plan.positions, 2 * plan.positions)
            total = ca.vertcat(x[rates] + h * total[rates], total[plan.positions :])
        x = x + h * total
    if stepper.position_stops:
        x = _within_stops(stepper, ca, x)
    return ca.vertcat(x, z, *([held] if stepper.holds else []), *waiting)


def _mean_slope(plan: Schedule, k: int, x: Any, rates: Callable[[float, Any], Any]) -> Any:
    """Weighted sum of the stage derivatives of step k: rates(time, state) of each."""
    slopes, h = list[Any](), float(plan.lengths[k])
    for a, at in zip(plan.tableau.A.tolist(), plan.times[k].tolist(), strict=False):
        slopes.append(rates(at, x + h * sum((w * slope for w, slope in zip(a, slopes, strict=False) if w), 0.0)))
    return sum(w * slope for w, slope in zip(plan.tableau.B.tolist(), slopes, strict=True))


def _within_stops(stepper: Any, ca: Any, x: Any) -> Any:
    """State with positions within their ranges, and without velocities that lead out of them."""
    n, moving, (lower, upper) = stepper.scene.n, stepper.own_numbers.side.frozen.dynamics.n, map(ca.DM, stepper._ranges)
    q, rest, qd = x[:n], x[n:moving], x[moving:]
    ends = ca.fmin(ca.fmax(q, lower), upper)
    return ca.vertcat(ends, rest, ca.if_else((q - ends) * qd[:n] > 0, 0.0, qd[:n]), qd[n:])


def interval_to_jax(stepper: Any) -> Callable[..., Any]:
    """JAX function of an interval; see `Stepper.to_jax`."""
    try:
        import jax
        import jax.numpy as jnp
    except ImportError:
        raise ImportError("`to_jax` needs JAX, which is not installed: pip install 'rne[jax]'") from None
    known = {name: x.ndim for name, x in stepper.scene.numbers.items()}

    def rows(x: Any, u: Any, numbers: Any, t: Any) -> tuple[Any, ...]:
        """Arguments of the same leading shape as rows."""
        count, axes = int(np.prod(x.shape[:-1])), {**known, "x": 1, "u": 1, "t": 0}
        given = {"x": x, "u": u, "t": t, **numbers}
        each = {
            k: np.asarray(a, np.float64).reshape(count, *a.shape[a.ndim - axes[k] :])
            for k, a in given.items()
            if a is not None
        }
        common = {k: a[0] if k != "x" and count and (a == a[:1]).all() else a for k, a in each.items()}
        return common.pop("x"), common.pop("u", None), common, common.pop("t")

    def values(*given: Any) -> Array:
        x, u, own, t = rows(*given)
        return np.asarray(stepper(x, u, own, t=t)).reshape(given[0].shape).astype(given[0].dtype)

    def slopes(weights: Any, *given: Any) -> tuple[Any, ...]:
        x, u, own, t = rows(*given)
        found = stepper.gradient(x, u, np.asarray(weights, np.float64).reshape(x.shape), own, t=t)
        each = {"x": given[0], "u": given[1], **given[2]}
        found = {k: found[k].reshape(a.shape).astype(a.dtype) for k, a in each.items() if a is not None}
        return found.pop("x"), found.pop("u", None), found

    def called(function: Callable[..., Any], like: Any, *given: Any) -> Any:
        shapes = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape, a.dtype), like)
        return jax.pure_callback(function, shapes, *given, vmap_method="broadcast_all")

    step: Any = jax.custom_vjp(lambda *given: called(values, given[0], *given))
    step.defvjp(
        lambda *given: (called(values, given[0], *given), given),
        lambda given, weights: (*called(slopes, given[:3], weights, *given), jnp.zeros_like(given[3])),
    )

    def function(x: Any, u: Any = None, numbers: Mapping[str, Any] | None = None, t: Any = 0.0) -> Any:
        x, leading = jnp.asarray(x), jnp.shape(x)[:-1]
        u = None if u is None else jnp.broadcast_to(u, (*leading, jnp.shape(u)[-1]))
        own = {k: jnp.asarray(a) for k, a in (numbers or {}).items()}
        own = {k: jnp.broadcast_to(a, leading + a.shape[a.ndim - known[k] :]) for k, a in own.items()}
        return step(x, u, own, jnp.broadcast_to(jnp.asarray(t, x.dtype), leading))

    return function


C_STEPS = """    for (int k = 0; k < {steps}; k++) {{{act}
        for (int s = 0; s < {stages}; s++) {{
            const double time = t[0] + at[k][s];
            for (int i = 0; i < {size}; i++) {{
                double sum = 0.0;
                for (int r = 0; r < s; r++)
                    sum += a[s][r] * slope[r][i];
                stage[i] = x_next[i] + h[k] * sum;
            }}
            {call}
        }}
        for (int i = {size} - 1; i >= 0; i--) {{ /* the first ones may move with the rates at the end */
            double sum = 0.0;
            for (int r = 0; r < {stages}; r++)
                sum += b[r] * slope[r][i];
            x_next[i] += h[k] * (i < {positions} ? x_next[{positions} + i] : sum);
        }}
    }}"""
C_FAILS = """if ({call}) {{
{indent}    for (int i = 0; i < {row}; i++)
{indent}        x_next[i] = NAN;
{indent}    return;
{indent}}}"""
C_SAMPLE = """
    {call}
    for (int i = 0; i < {m}; i++)
        x_next[{size} + i] {becomes}command[{n} + i];
    for (int i = 0; i < {n}; i++) {{
        for (int k = 0; k < {late}; k++)
            queue[k][i] = x[{first} + {n} * k + i];
        queue[{late}][i] = fmin(fmax(command[i], -limit[i]), limit[i]);
        for (int k = 0; k < {late}; k++)
            x_next[{first} + {n} * k + i] = queue[k + 1][i];
        held[i] = {held};
    }}"""
C_ACT = """
        for (int i = 0; k == {arrival} && i < {n}; i++)
            held[i] = {lasting}queue[0][i];"""
C_ENDS = """
    for (int i = 0; i < {n}; i++) {{
        const double out = x_next[i] > upper[i] ? 1.0 : x_next[i] < lower[i] ? -1.0 : 0.0;
        x_next[i] = fmin(fmax(x_next[i], lower[i]), upper[i]);
        if (out * x_next[{rates} + i] > 0.0)
            x_next[{rates} + i] = 0.0;
    }}"""


def interval_to_c(stepper: Any, name: str) -> str:
    """C function of an interval; see `Stepper.source`."""
    frozen, side, plan, row = stepper.own_numbers.frozen, stepper.own_numbers.side, stepper.schedule, stepper.size
    functions = _functions_in_c(frozen, name)
    arrays = {"a": plan.tableau.A, "b": plan.tableau.B, "h": plan.lengths, "at": plan.times}
    n, first = stepper.scene.n, side.size + side.m + stepper.scene.n * stepper.holds
    fill: dict[str, Any] = {"name": name, "steps": len(plan.lengths), "stages": len(plan.tableau.B), "size": side.size}
    fill |= {"n": n, "m": side.m, "row": row, "positions": plan.positions, "first": first}
    fill |= {"late": (row - first) // max(n, 1), "arrival": int(np.argmax(plan.acting))}
    keep, gain = frozen.update
    fill |= {"rates": frozen.dynamics.n, "becomes": f"+= {gain} * " if keep else "= "}
    sample, act, ends, declared = "", "", "", [f"stage[{side.size}], slope[{fill['stages']}][{side.size}]"]
    if frozen.law is not None:
        arrays["limit"] = side.limits[0]
        sample, act = _sample_in_c(fill, holds=stepper.holds, function=functions.functions["law"])
        declared += [f"command[{n + side.m}], queue[{fill['late'] + 1}][{n}], held[{n}]"]
    if stepper.position_stops:
        arrays |= {"lower": stepper._ranges[0], "upper": stepper._ranges[1]}
        ends = C_ENDS.format(**fill)
    rates = functions.functions["rates"]
    torques = ("u",) if frozen.is_driven else ("held",)
    given = ["&time", "stage", *(torques if "u" in rates.taken else ()), "slope[s]"]
    steps = C_STEPS.format(**fill, act=act, call=_call(rates, given, row, 12))
    constants = [f"    static const double {k}{_sizes(array)} = {_literal(array)};" for k, array in arrays.items()]
    heading = f"/* {stepper!r}: x_next of x{', torques u' * frozen.is_driven} and the time t of the begin. */"
    head = f"void {name}(const double *t, const double *x, {'const double *u, ' * frozen.is_driven}double *x_next)"
    copy = f"    for (int i = 0; i < {row}; i++)\n        x_next[i] = x[i];"
    body = [*constants, *(f"    double {names};" for names in declared), copy + sample, steps + ends]
    return "\n".join([functions.source, heading, head, "{", *body, "}", ""])


def _functions_in_c(frozen: FrozenScene, name: str) -> Unit:
    """Functions of the rates and of the law, if there is one."""
    kernels = dict[str, Kernel]()
    for part, owner, function in (("rates", frozen.dynamics, "right_hand_side"), ("law", frozen.law, "outputs")):
        if owner is not None:
            quantity, numbers = getattr(owner, function), tuple(owner.vector.tolist())
            kernel = frozen.scene.kernels.scene_kernel(quantity, numbers=numbers)
            kernels[part] = with_table(kernel, owner.table)
    return unit(kernels, name=name, static=True)


def _sample_in_c(fill: dict[str, Any], *, holds: bool, function: Printable) -> tuple[str, str]:
    """Text that samples the law, and text within a step that has a command act; `holds` for one that is a state."""
    held = f"x[{fill['size'] + fill['m']} + i]"
    own = {"call": _call(function, ["t", "x", "command"], fill["row"], 4), "held": held if holds else "0.0"}
    return C_SAMPLE.format(**fill | own), C_ACT.format(**fill, lasting=f"x_next{held[1:]} = " if holds else "")


def _call(function: Printable, given: Sequence[str], row: int, indent: int) -> str:
    """Call in C, after which all that follows is NaN where it fails."""
    call = f"{function.name}({', '.join(given)})"
    return C_FAILS.format(call=call, row=row, indent=" " * indent) if function.may_fail else f"{call};"


def _sizes(array: Array) -> str:
    return "".join(f"[{k}]" for k in array.shape)


def _literal(array: Array) -> str:
    if array.ndim:
        return f"{{{', '.join(map(_literal, array))}}}"
    number = float(array)
    return repr(number) if np.isfinite(number) else "INFINITY" if number > 0 else "-INFINITY"
