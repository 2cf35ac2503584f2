"""A robot with other moments of mass than those of its bodies, the same in all states or different from state to state.

The moments of a batch have its leading shape: mass (..., nb), first moments (..., nb, 3), inertias (..., nb, 3, 3).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.typing import DTypeLike

from ..basics.arrays import convert_array
from ..basics.spatial import Array
from .model import Model
from .solids import Moments


class ModelWithMoments(Model):
    """A Model for dynamics alone, which read its `moments`; its mass, com and inertia are still the robot's own."""

    def astype(self, dtype: DTypeLike, number: Callable[[float], Any] | None = None) -> Model:
        """The same with every array in another dtype, the moments too."""

        def convert(moment: Array) -> Array:
            if moment.dtype.kind in "cO":  # complex steps and traced numbers keep their own
                return moment
            return moment.astype(dtype) if number is None else convert_array(moment, number)

        return with_moments(super().astype(dtype, number), Moments(*(convert(moment) for moment in self.moments)))


def of_states(model: Model, states: Any) -> Model:
    """The robot of some states of a batch: with their moments, where every state has its own."""
    if not isinstance(model, ModelWithMoments) or model.moments.mass.ndim == 1:
        return model
    return with_moments(model, Moments(*(moment[states] for moment in model.moments)))


def with_moments(model: Model, moments: Moments) -> ModelWithMoments:
    """The same robot with other moments of mass."""
    clone = object.__new__(ModelWithMoments)
    clone.__dict__.update(model.__dict__)
    clone.__dict__["moments"] = moments
    return clone
