"""A joint that follows others: its position as a traced function of theirs, with the derivatives of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..basics.spatial import Array, note_finite, zeros
from ..graph.differentiation import differentiate
from ..graph.graph import Graph
from ..graph.program import ON_ARRAYS, Program, interpret, lower
from ..graph.scalar import inputs, references


@dataclass(frozen=True)
class Coupling:
    """The position of a joint as a function of the positions of `drivers`, all of them coordinates, in their order.

    `program` is the function, traced: data, so that models that have it are equal, pickled and traced again.
    """

    joint: str
    drivers: tuple[str, ...]
    program: Program

    def position(self, drivers: Array) -> Array:
        """The joint's position, shape (...), from those of the drivers, (..., d), of any type of number."""
        return _run(self.program, drivers)[..., 0]

    def at(self, values: Mapping[str, float]) -> tuple[tuple[str, ...], Callable[..., Any]]:
        """The drivers that have no value here, and the position as a function of theirs."""
        free = tuple(name for name in self.drivers if name not in values)

        def position(*given: Any) -> Any:
            known = {**values, **dict(zip(free, given, strict=True))}
            return self.position(np.array([[known[name] for name in self.drivers]], dtype=object))[0]

        return free, position

    def derivatives(self, drivers: Array) -> tuple[Array, Array]:
        """Derivatives of the position by the drivers: the first, shape (..., d), and the second, (..., d, d)."""
        d, found = len(self.drivers), _run(self._derivatives, drivers)
        return found[..., :d], found[..., d:].reshape(*drivers.shape[:-1], d, d)

    @cached_property
    def _derivatives(self) -> Program:
        d, graph = len(self.drivers), Graph()
        by = range(d)
        slopes = differentiate(graph, "jacobian", references(graph, self.position(inputs(graph, (1, d), 0))), by, d)
        return lower(graph, slopes + differentiate(graph, "jacobian", slopes, by, d), d)


def _run(program: Program, given: Array) -> Array:
    """The outputs, shape (..., outputs), of inputs (..., width); kernels check those that are traced to be finite."""
    number: Any = np.asarray if given.dtype == object else given.dtype.type
    found = zeros((*given.shape[:-1], len(program.outputs)), like=given)
    with np.errstate(all="ignore"):
        outputs = interpret(
            program, np.moveaxis(given[..., None], -2, 0), ON_ARRAYS, number
        )  # arrays, of single numbers too
        for k, output in enumerate(outputs):
            found[..., k] = np.asarray(output)[..., 0] if np.ndim(output) else output
    note_finite(found)
    return found
