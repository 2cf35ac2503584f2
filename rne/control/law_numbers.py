"""The numbers of a control law by name, and the law with others: fields of dataclasses, attributes, cells, defaults.

A number is a float, or an array of floats of at most two axes. It may be replaced by traced numbers, so that a law of
other numbers needs no other program. Robots, references and functions that a law calls keep their numbers; frictions
do not. A motion through samples is a table apart from the program, and its samples are a number.
"""

from __future__ import annotations

import functools
import operator
import types
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ..basics.arrays import copy_with, real_array
from ..basics.numbers import part_of
from ..basics.piecewise import on_rows
from ..basics.spatial import Array
from ..graph.scalar import is_traced
from ..model.model import unchecked_model
from ..robot import Robot

CONSTANT = {"constant": True}  # metadata of a dataclass's field that is no such number: a sample time, a memory
MOST = 400  # largest size of an array that is a parameter of a law; larger ones are tables
Numbers = dict[str, Array]


def is_number(value: Any) -> bool:
    """True for a float and for a float array that is small enough not to be a table."""
    if isinstance(value, np.ndarray):
        return value.dtype.kind == "f" and 0 < value.size <= MOST and value.ndim <= 2
    return isinstance(value, float)


def parts_of(law: Any) -> dict[str, Any]:
    """Attributes, fields or closure variables of a law by name."""
    if isinstance(law, types.MethodType):
        return parts_of(law.__self__)
    if isinstance(law, types.FunctionType):
        return dict(_cells(law)) | dict(_defaults(law)) | (law.__kwdefaults__ or {})
    if is_dataclass(law):
        return {f.name: getattr(law, f.name) for f in fields(law) if f.init}
    cached = {k for k in vars(type(law)) if isinstance(getattr(type(law), k, None), functools.cached_property)}
    return {k: v for k, v in getattr(law, "__dict__", {}).items() if k not in cached}


def numbers_of(law: Any) -> Numbers:
    """Numerical parameters of a law by name, such as "kp", and of its parts, such as "feedforward.viscous"."""
    found: Numbers = {}
    constants = {f.name for f in fields(law) if f.metadata == CONSTANT} if is_dataclass(law) else ()
    for name, part in parts_of(law).items():
        if is_number(part) and name not in constants:
            found[name] = np.array(part, dtype=np.float64)  # a copy: the law may be changed
        elif hasattr(type(part), "numbers") and hasattr(type(part), "at"):  # as of frictions
            found |= {f"{name}.{k}": np.array(number) for k, number in part.numbers.items()}
        elif is_dataclass(type(part)) and getattr(type(part), "traceable", False):  # a law within a law
            found |= {f"{name}.{k}": number for k, number in numbers_of(part).items()}
    return found


def models_of(law: Any, asked: Collection[str]) -> Numbers:
    """Inertial parameters of the robots held by a law, "robot.parameters"; only for the names `asked`."""
    held = {f"{name}.parameters": part for name, part in parts_of(law).items()} if asked else {}
    return {name: part.parameters for name, part in held.items() if name in asked and isinstance(part, Robot)}


class _KernelsAt(NamedTuple):
    """Kernels of a robot inside a traced law, evaluated at traced inertial parameters."""

    kernels: Any
    traced: Array

    def evaluate_quantity(self, function: Any, *arrays: Any, parameters: Any = None, **how: Any) -> Any:
        parameters = self.traced if function.quantity.moments else None
        if parameters is not None and how.get("link") is not None:
            raise TypeError(f"{function.quantity.name} takes no parameters")
        return self.kernels.evaluate_quantity(function, *arrays, parameters=parameters, **how)


_first: WeakKeyDictionary[Robot, Robot] = WeakKeyDictionary()  # of robots at other parameters, whose formulas they have


def _robot_at(robot: Robot, parameters: Array) -> Robot:
    first = _first.get(robot, robot)
    if is_traced(parameters):
        values = {f.name: getattr(first.model, f.name) for f in fields(first.model)}
        unknown = {name: values[name] * np.nan for name in ("mass", "com", "inertia")}  # for laws that read them
        own = {"_model": unchecked_model(values | unknown), "kernels": _KernelsAt(first.kernels, parameters)}
        return copy_with(first, **own)
    found = first.with_parameters(parameters)
    _first[found] = first
    return found


def motion_of(law: Any) -> tuple[str, Any] | None:
    """Name and value of the law's motion through samples, which has a `table`; None for none or several."""
    found = [(name, part) for name, part in parts_of(law).items() if hasattr(type(part), "with_samples")]
    return found[0] if len(found) == 1 else None


def samples_of(law: Any) -> Numbers:
    """Samples of the law's motion, by its name."""
    found = motion_of(law)
    return {} if found is None else {found[0]: found[1].samples}


class OnRows(NamedTuple):
    """Replacement of a motion through samples of n joints, evaluated from the table rows that hold at a time."""

    rows: Array
    n: int

    def __call__(self, t: Any) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations."""
        return on_rows(t, self.rows, self.n)


def law_at(law: Any, numbers: Mapping[str, Any]) -> Any:
    """Law with other numbers, which may be traced; names as in `numbers_of`."""
    changed: dict[str, Any] = {}
    for name, part in parts_of(law).items():
        inner = part_of(numbers, f"{name}.")
        if inner and isinstance(part, Robot):
            changed[name] = _robot_at(part, inner["parameters"])
        elif inner:
            changed[name] = part.at(inner) if hasattr(part, "at") else law_at(part, inner)
        elif name in numbers and hasattr(type(part), "with_samples"):
            changed[name] = part.with_samples(numbers[name])
        elif name in numbers:
            changed[name] = as_given(numbers[name], part)
    return law_with(law, changed) if changed else law


def as_given(number: Any, part: Any) -> Any:
    """Replacement number in the form of the original: an array of its shape, or a float."""
    array = np.asarray(number)
    if isinstance(part, np.ndarray):
        return array.reshape(part.shape)
    return array.item() if array.dtype == object or array.ndim == 0 else array


def law_with(law: Any, parts: Mapping[str, Any]) -> Any:
    """The law with some of its parts replaced."""
    if isinstance(law, types.MethodType):
        return types.MethodType(law.__func__, law_with(law.__self__, parts))
    if isinstance(law, types.FunctionType):
        return _function_with(law, parts)
    if is_dataclass(law) and not isinstance(law, type):
        return replace(law, **parts)
    own = copy_with(law, **parts)
    for name, part in vars(law).items():  # its own methods and functions of itself, which it keeps
        if isinstance(part, types.MethodType) and part.__self__ is law:
            vars(own)[name] = types.MethodType(part.__func__, own)
        elif isinstance(part, types.FunctionType) and name not in parts:
            vars(own)[name] = _function_with(part, {k: own for k, held in _cells(part) if held is law})
    return own


def _cells(law: types.FunctionType) -> Iterator[tuple[str, Any]]:
    for name, cell in zip(law.__code__.co_freevars, law.__closure__ or (), strict=True):
        with suppress(ValueError):  # not yet filled
            yield name, cell.cell_contents


def _defaults(law: types.FunctionType) -> Iterator[tuple[str, Any]]:
    values = law.__defaults__ or ()
    taken = law.__code__.co_varnames[: law.__code__.co_argcount]
    return zip(taken[len(taken) - len(values) :], values, strict=True)


def _function_with(law: types.FunctionType, parts: Mapping[str, Any]) -> types.FunctionType:
    """Copy of a function with other defaults and closure cells, shared with the functions it refers to."""
    cells = zip(law.__code__.co_freevars, law.__closure__ or (), strict=True)
    own = _at_cells(law, {id(cell): types.CellType(parts[name]) for name, cell in cells if name in parts})
    own = _copied(law, law.__closure__) if own is law else own
    own.__defaults__ = tuple(parts.get(name, value) for name, value in _defaults(law)) or None
    own.__kwdefaults__ = {k: parts.get(k, v) for k, v in (law.__kwdefaults__ or {}).items()} or None
    return own


def _at_cells(law: types.FunctionType, places: dict[int, Any]) -> types.FunctionType:
    """Copy of a function with some closure cells, given by id, replaced, and of the functions it refers to."""
    held = {name: part for name, part in _cells(law) if isinstance(part, types.FunctionType)}
    for name, cell in zip(law.__code__.co_freevars, law.__closure__ or (), strict=True):
        if id(cell) not in places:
            places[id(cell)] = cell
            own = _at_cells(held[name], places) if name in held else None
            places[id(cell)] = cell if own is held.get(name) else types.CellType(own)
    cells = tuple(places[id(cell)] for cell in law.__closure__ or ())
    return law if all(map(operator.is_, cells, law.__closure__ or ())) else _copied(law, cells)


def _copied(law: types.FunctionType, cells: Any) -> types.FunctionType:
    own = types.FunctionType(law.__code__, law.__globals__, law.__name__, law.__defaults__, cells)
    own.__kwdefaults__ = law.__kwdefaults__
    own.__dict__.update(law.__dict__)
    return own


def law_breaks(law: Any, further: Sequence[float] = ()) -> list[float]:
    """Instants at which a law's torques jump, merged with others."""
    owners: dict[str, Any] = {"controller": law, "controller.reference": getattr(law, "reference", None)}
    given, found = [*further], list[float]()
    for name, owner in owners.items():
        if hasattr(type(owner), "breaks") or hasattr(owner, "breaks"):  # a property may raise an AttributeError itself
            given += real_array(f"{name}.breaks", owner.breaks, "(k,)").tolist()
    for instant in sorted(set(given)):
        if not found or instant - found[-1] > 1e-12 * max(1.0, abs(instant)):  # equal up to rounding
            found.append(float(instant))
    return found
