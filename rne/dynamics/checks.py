"""The one decorator of every public quantity: check the arguments, run the core, check the result.

A core is the bare recursion. It takes arrays that are finite, of one dtype and of one leading shape, and never
branches on a value. `function.core` is that recursion, to be read, tested or traced on its own.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar, cast

import numpy as np

from ..arguments import is_finite, joint_array, model_argument, number_array
from ..errors import NotFiniteError
from ..model import Model
from ..spatial import Array

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)

JOINT_ARGUMENTS = ("q", "qd", "qdd", "tau")


class Checked(Protocol[P, R, T_co]):
    """A public function together with the bare recursion it wraps."""

    core: Callable[..., R]
    __name__: str

    def __call__(self, model: Model, *args: P.args, **kwargs: P.kwargs) -> T_co: ...


def checked(core: Callable[Concatenate[Model, P], T]) -> Checked[P, T, T]:
    """Make a public function of a core whose result needs no judgement but that it is finite."""
    return judged(_as_it_is)(core)


def _as_it_is(model: Model, result: T, arguments: Mapping[str, Any]) -> T:
    return result


def judged(
    judge: Callable[[Model, R, Mapping[str, Any]], T],
) -> Callable[[Callable[Concatenate[Model, P], R]], Checked[P, R, T]]:
    """Like `checked`, where `judge(model, core result, arguments)` turns the core's result into the public one."""

    def decorate(core: Callable[Concatenate[Model, P], R]) -> Checked[P, R, T]:
        signature = inspect.signature(core)

        @functools.wraps(core)
        def function(model: Model, *args: P.args, **kwargs: P.kwargs) -> T:
            model_argument(model)
            arguments = signature.bind(model, *args, **kwargs).arguments
            given = {name: value for name, value in arguments.items() if name != "model"}
            checked_model, given = check_arguments(model, given)
            with np.errstate(all="ignore"):  # what goes wrong is judged below, by name
                result = core(checked_model, **given)  # type: ignore[call-arg]
            judged_result = judge(checked_model, result, given)
            check_result(core.__name__, judged_result)
            return judged_result

        public = cast("Checked[P, R, T]", function)
        public.core = core
        return public

    return decorate


def check_arguments(model: Model, given: Mapping[str, Any]) -> tuple[Model, dict[str, Any]]:
    """Finite arrays of one dtype and one leading shape, and the model in that dtype."""
    arrays = {name: joint_array(name, given[name], model) for name in JOINT_ARGUMENTS if name in given}
    external = given.get("external")
    wrenches = {} if external is None else check_external(model, external)
    every = [*arrays.values(), *wrenches.values()]
    dtype = np.result_type(*every)
    leading = common_leading_shape(arrays | wrenches)

    def conform(array: Array) -> Array:
        return np.broadcast_to(array.astype(dtype, copy=False), leading + array.shape[-1:])

    checked_arguments = dict(given) | {name: conform(array) for name, array in arrays.items()}
    if external is not None:
        checked_arguments["external"] = {link: conform(wrench) for link, wrench in wrenches.items()}
    return model_for(model, dtype, every), checked_arguments


def check_external(model: Model, external: Any) -> dict[str, Array]:
    """Check wrenches by link name: shape (..., 6), [moment; force]."""
    if not isinstance(external, Mapping):
        raise ValueError(f"`external` must be a mapping of link name to wrench, got {type(external).__name__}")
    wrenches = {}
    for link, value in external.items():
        if link not in model.link_names:
            raise ValueError(f"`external` must name links of {list(model.link_names)}, got {link!r}")
        name = f"external[{link!r}]"
        wrench = number_array(name, value, "(..., 6)")
        if wrench.ndim == 0 or wrench.shape[-1] != 6:
            raise ValueError(f"`{name}` must have shape (..., 6), [moment; force], got {wrench.shape}")
        wrenches[link] = wrench
    return wrenches


def common_leading_shape(arrays: Mapping[str, Array]) -> tuple[int, ...]:
    """The leading (batch) shape all arrays broadcast to."""
    try:
        return np.broadcast_shapes(*(array.shape[:-1] for array in arrays.values()))
    except ValueError:
        shapes = ", ".join(f"`{name}` {array.shape}" for name, array in arrays.items())
        raise ValueError(f"leading shapes must broadcast against each other, got {shapes}") from None


def model_for(model: Model, dtype: np.dtype[Any], arrays: list[Array]) -> Model:
    """The model in the dtype of the arguments, so that the arithmetic stays in it."""
    if dtype.kind == "O":
        numbers = (x for array in arrays for x in array.flat if hasattr(x, "context"))
        example = next(numbers, None)
        return model if example is None else model.astype(object, example.context.mpf)
    real = np.zeros((), dtype=dtype).real.dtype
    return model if real == model.mass.dtype else model.astype(real)


def check_result(name: str, result: Any) -> None:
    """Refuse a result that overflowed: finite arguments must not become a silent infinity or NaN."""
    if is_dataclass(result):
        parts: list[Any] = [getattr(result, f.name) for f in fields(result)]
    else:
        parts = [result]
    for part in parts:
        if isinstance(part, np.ndarray) and not is_finite(part).all():
            raise NotFiniteError(f"{name} overflows {part.dtype} for these arguments; the result is not finite")
