"""Inertial parameters as an array: a kernel that runs many variants of a robot as one batch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ..dynamics.quantity import Declared, PrecisionStatus, Quantity
from ..model.model import Model, model_argument
from ..model.parameters import PARAMETERS, at_parameters
from .trace import quantity_of
from .wrenches import wrenches_as_arrays


@dataclass(frozen=True)
class AtParameters:
    """A function of a model whose inertial parameters are an array behind its other arrays.

    Attributes
    ----------
    function : Declared
        A function that depends on the inertial parameters through the moments of the bodies.
    nb : int
        Number of moving bodies.
    """

    function: Declared
    nb: int

    @property
    def quantity(self) -> Quantity:
        """That of the function, with a further array `parameters` of shape (..., 10 nb)."""
        declared = self.function.quantity
        widths = {**declared.widths, "parameters": PARAMETERS * self.nb}
        return replace(declared, core=self.core, widths=widths, base_parameters=False)

    def core(self, model: Model, *arrays: Any, **named: Any) -> Any:
        """The core of the function, on the model at the parameters."""
        given = self._by_name(arrays, named)
        return self.function.quantity.core(at_parameters(model, given.pop("parameters")), **given)

    def evaluate(self, model: Model, *args: Any, **kwargs: Any) -> tuple[Any, PrecisionStatus]:
        """The function itself at the parameters."""
        return self.function.evaluate(model, **self._by_name(args, kwargs))

    def _by_name(self, arrays: Any, named: Mapping[str, Any]) -> dict[str, Any]:
        return {**dict(zip(self.quantity.widths, arrays, strict=False)), **named}


def inputs_as_arrays(function: Declared, model: Model, fixed: Mapping[str, Any]) -> tuple[Declared, dict[str, Any]]:
    """A function and its fixed arguments; of these, `external` and `parameters` become arrays of the function.

    Parameters
    ----------
    function : Declared
    model : Model
        The robot's parameters.
    fixed : mapping of str to object
        May have `external`, a sequence of link names, and `parameters`, True or False.

    Returns
    -------
    function : Declared
        Takes the joint arrays, then the wrenches, then the inertial parameters.
    fixed : dict of str to object
        Without these two.

    Raises
    ------
    TypeError
        If the function takes no external wrenches or does not depend on inertial parameters, or an argument is of
        another type.
    ValueError
        If a link is unknown or named twice.
    """
    function, rest = wrenches_as_arrays(function, model, fixed)
    given = rest.pop("parameters", False)
    if not isinstance(given, bool):
        raise TypeError(
            f"`parameters` of a kernel must be True or False, got {type(given).__name__}; the parameters themselves "
            "are an argument of its calls"
        )
    if not given:
        return function, rest
    quantity_of(function).require_moments()
    return AtParameters(function, model_argument(model).nb), rest
