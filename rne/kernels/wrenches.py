"""External wrenches as arrays: what a kernel takes in place of a mapping of links to wrenches."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..dynamics.quantity import Declared, PrecisionStatus, Quantity, check_arguments
from ..model.model import Model, model_argument
from .trace import quantity_of


@dataclass(frozen=True)
class UnderWrenches:
    """A function of a model whose wrenches on some links are arrays behind its joint arrays.

    Attributes
    ----------
    function : Declared
        A function with the argument `external`.
    links : tuple of str
        In the order of the arrays.
    """

    function: Declared
    links: tuple[str, ...]

    @property
    def quantity(self) -> Quantity:
        """That of the function, with further arrays external_1, external_2, ... of shape (..., 6)."""
        declared = self.function.quantity
        wrenches = {f"external_{k}": link for k, link in enumerate(self.links, 1)}
        widths = {**declared.widths, **dict.fromkeys(wrenches, 6)}
        return replace(declared, core=self.core, widths=widths, wrenches=wrenches)

    def core(self, model: Model, *arrays: Any, **named: Any) -> Any:
        """The core of the function, which takes wrenches by link."""
        return self.function.quantity.core(model, **by_link(self.quantity, arrays, named))

    def evaluate(self, model: Model, *args: Any, **kwargs: Any) -> tuple[Any, PrecisionStatus]:
        """The function itself, which takes wrenches by link."""
        return self.function.evaluate(model, **by_link(self.quantity, args, kwargs))


def by_link(quantity: Quantity, arrays: Sequence[Any], named: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments by name, the wrenches among them in one mapping `external` by link."""
    given = {**dict(zip(quantity.widths, arrays, strict=False)), **named}
    external = {link: given.pop(name) for name, link in quantity.wrenches.items()}
    return given | {"external": external}


def wrenches_as_arrays(function: Declared, model: Model, fixed: Mapping[str, Any]) -> tuple[Declared, dict[str, Any]]:
    """A function and its fixed arguments; links named as `external` become arrays of the function.

    Parameters
    ----------
    function : Declared
    model : Model
        The robot's parameters.
    fixed : mapping of str to object
        May have `external`, a sequence of link names.

    Returns
    -------
    function : Declared
        An UnderWrenches if links are named.
    fixed : dict of str to object
        Without `external`.

    Raises
    ------
    TypeError
        If the function takes no external wrenches, or `external` is not a sequence of names.
    ValueError
        If a link is unknown or named twice.
    """
    rest = dict(fixed)
    external = rest.pop("external", None)
    if external is None:
        return function, rest
    quantity = quantity_of(function)
    if "external" not in inspect.signature(quantity.core).parameters:
        raise TypeError(f"rne.dynamics.{quantity.name} takes no external wrenches")
    links = wrench_links(model_argument(model), external)
    return (UnderWrenches(function, links) if links else function), rest


def wrench_links(model: Model, external: Any) -> tuple[str, ...]:
    """The links on which wrenches of a kernel act: known ones, each named once."""
    if isinstance(external, str) or not isinstance(external, Sequence):
        raise TypeError(
            f"`external` of a kernel must be a sequence of link names, such as ['link_6'], got "
            f"{type(external).__name__}; the wrenches are arguments of its calls"
        )
    for k, link in enumerate(external):
        if link not in model.link_names:
            raise ValueError(f"`external` must name links of {list(model.link_names)}, got {link!r}")
        if link in external[:k]:
            raise ValueError(f"`external` must name each link once, got {link!r} again")
    return tuple(external)


def named_by_function(quantity: Quantity, model: Model, arguments: Sequence[Any], error: ValueError) -> ValueError:
    """The error of a kernel, in the words of the function itself where that calls wrenches by their links."""
    if not quantity.wrenches:
        return error
    try:
        check_arguments(model, by_link(quantity, arguments, {}))
    except ValueError as same:
        return same
    return error
