"""Measurements of a robot without and with a load: equations of the same unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..dynamics.base_inertial_parameters import BaseParameters
from ..model.standard_parameters import MEASURED, DriveModel, StandardParameters
from ..robot import Robot, robot_argument
from .equations import Equations, joined
from .record import Record
from .regression import Gathered, gathered
from .result import Identification


class TwoSets(NamedTuple):
    """The equations of records without and with a load, of the same standard parameters."""

    robot: Robot
    standard: StandardParameters
    base: BaseParameters
    without: Gathered
    loaded: Gathered
    equations: tuple[Equations, Equations]  # of both, each in one block

    @classmethod
    def of(cls, robot: Robot, base: BaseParameters, without: Gathered, loaded: Gathered) -> TwoSets:
        return cls(robot, base.standard, base, without, loaded, (without.fitted.merged(), loaded.fitted.merged()))

    @property
    def notes(self) -> tuple[str, ...]:
        """What was said of the records, once."""
        return tuple(dict.fromkeys((*self.without.notes, *self.loaded.notes)))

    def joined(self, E: Array, K: int) -> Equations:
        """Equations of both for unknowns z, of which the last, from K on, belong to the load: parameters are E z."""
        without, loaded = self.equations
        return joined([without.mapped(E * (np.arange(E.shape[1]) < K)), loaded.mapped(E)])

    def repeats(self, without: Array, loaded: Array) -> Array:
        """How many equations of a joint count as one, for residuals of parameters of either set, shape (n,)."""
        rows = np.concatenate([equations.rows for equations in self.equations])
        both = np.array([self.without.repeats(without), self.loaded.repeats(loaded)])
        return np.asarray(np.maximum((rows * both).sum(0) / np.maximum(rows.sum(0), 1), 1.0))


def two_sets(
    robot: Robot | Identification,
    without: Record | Sequence[Record] | None,
    with_load: Record | Sequence[Record],
    drives: DriveModel | None,
    minimum_rate: ArrayLike | None,
    cutoff: float | None,
    decimation: int | None,
) -> TwoSets:
    """Check and prepare the records of both sets."""
    further = (minimum_rate, cutoff, decimation, 2)  # two blocks each: none is held out
    if isinstance(robot, Identification):
        if without is not None or drives is not None:
            raise ValueError("an Identification has its records and drives: `without` and `drives` must be None")
        found = robot
        loaded = gathered(found.initial, with_load, found.base, *further)
        return TwoSets.of(found.initial, found.base, found.data, loaded)
    base = robot_argument(robot).base_parameters(drives=MEASURED if drives is None else drives)
    if without is None:
        raise ValueError("`without` must have a record without the load, unless an Identification is given")
    sets = [gathered(robot, records, base, *further) for records in (without, with_load)]
    return TwoSets.of(robot, base, *sets)
