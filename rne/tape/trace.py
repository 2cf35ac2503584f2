"""From a function of a model to a program: its core, run on traced numbers."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..dynamics.articulated import articulated_forward_dynamics
from ..dynamics.checks import JOINT_ARGUMENTS, Checked
from ..dynamics.composite import mass_matrix
from ..dynamics.forward import forward_dynamics
from ..dynamics.newton_euler import bias_torque, coriolis_torque, gravity_torque, inverse_dynamics
from ..dynamics.record import recursion
from ..grouping import grouped
from ..model import Model
from .derivative import differentiate
from .graph import Graph, TooLarge
from .program import Program, lower
from .scalar import inputs, references

# What does not depend on which body a mass on a joint's axis is counted with.
GROUPS = (
    inverse_dynamics,
    bias_torque,
    gravity_torque,
    coriolis_torque,
    mass_matrix,
    forward_dynamics,
    articulated_forward_dynamics,
)
LIMIT = 50_000  # operations that are still sensibly written out


class Trace(NamedTuple):
    """A function traced on one model."""

    program: Program
    shapes: tuple[tuple[int, ...], ...]  # of each output, without the batch axis
    judged: bool  # True if the core returns more than the result, to be judged


def trace(
    function: Checked[Any, Any, Any],
    model: Model,
    names: Sequence[str],
    fixed: Mapping[str, Any],
    wrt: Sequence[str] = (),
) -> Trace:
    """Run the core of a function on traced numbers, one state in a batch axis of length 1; differentiate if asked."""
    graph = Graph(limit=8 * LIMIT)
    widths = argument_widths(function, model, names)
    starts = dict(zip(names, np.cumsum([0, *widths.values()]).tolist(), strict=False))
    arguments = {name: inputs(graph, (1, width), starts[name]) for name, width in widths.items()}
    result = function.core(traced_model(function, model), **arguments, **fixed)
    parts = result if isinstance(result, tuple) else (result,)
    outputs = [ref for part in parts for ref in references(graph, part)]
    if wrt:
        by = [starts[name] + j for name in wrt for j in range(widths[name])]
        outputs = differentiate(graph, references(graph, parts[0]), by)
    program = lower(graph, outputs, sum(widths.values()))
    if len(program.instructions) > LIMIT or not program.is_finite:
        raise TooLarge("operations or constants")  # the recursion runs, and says what is wrong
    if wrt:
        return Trace(program, ((*np.shape(parts[0])[1:], len(by)),), False)
    return Trace(program, tuple(np.shape(part)[1:] for part in parts), isinstance(result, tuple))


def traced_model(function: Checked[Any, Any, Any], model: Model) -> Model:
    """The model a function is traced on: with masses moved inwards, where that changes nothing."""
    return grouped(model) if function in GROUPS or getattr(function, "groups", False) else model


def joint_arguments(function: Checked[Any, Any, Any]) -> tuple[str, ...]:
    """The joint arrays a function takes, in order."""
    if not hasattr(function, "core"):
        raise TypeError(f"`function` must be one of rne's functions of a model, got {function!r}")
    if function is recursion:
        raise TypeError("`function` must give an array; rne.recursion gives a record, which is not compiled")
    further = getattr(function, "widths", {})
    return tuple(name for name in inspect.signature(function.core).parameters if name in (*JOINT_ARGUMENTS, *further))


def argument_widths(function: Checked[Any, Any, Any], model: Model, names: Sequence[str]) -> dict[str, int]:
    """How many numbers each argument has: one a joint, unless the function says otherwise."""
    further: Mapping[str, int] = getattr(function, "widths", {})
    return {name: further.get(name, model.n) for name in names}
