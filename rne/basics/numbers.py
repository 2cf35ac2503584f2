"""Named numbers as inputs of kernels: selection of their entries, and the flat vector of inputs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, Self

import numpy as np

from .arrays import UNBOUNDED, cached_array
from .spatial import Array


class WithNumbers(ABC):
    """Base of objects with numbers, arrays by name, that are inputs of kernels as one flat vector.

    Infinities, and zeros except those of the names in `named`, are constants of the kernel, not inputs.
    """

    named: frozenset[str]
    numbers: Any

    @abstractmethod
    def at(self, numbers: Mapping[str, Any]) -> Self:
        """Copy with other numbers of some names, which are not checked and may be traced."""

    @cached_array
    def masks(self) -> dict[str, Array]:
        """Masks of the entries that are inputs, by name, for names that have some."""
        found = {name: is_input(x, named=name in self.named) for name, x in self.numbers.items()}
        return {name: mask for name, mask in found.items() if mask.any()}

    @cached_array
    def vector(self) -> Array:
        """Inputs as a vector, shape (p,)."""
        return np.concatenate([np.zeros(0), *(self.numbers[name][mask] for name, mask in self.masks.items())])

    def vectors(self, own: Mapping[str, Array]) -> Array:
        """Vectors of N motions, (N, p), with the numbers (N, ...) in `own`; (p,) if it is empty."""
        if not own:
            return np.asarray(self.vector)
        count = len(next(iter(own.values())))
        parts = [
            own[name].reshape(count, -1)[:, mask.reshape(-1)]
            if name in own
            else np.broadcast_to(self.numbers[name][mask], (count, mask.sum()))
            for name, mask in self.masks.items()
        ]
        return np.concatenate([np.zeros((count, 0)), *parts], axis=1)

    def filled(self, vector: Array) -> Self:
        """Copy with the entries of a vector, traced or not, as inputs.

        Numbers that differ between the states of (..., p) get the leading shape.
        """
        found, first, leading = dict[str, Array](), 0, vector.shape[:-1]
        for name, mask in self.masks.items():
            count = int(mask.sum())
            own, first = vector[..., first : first + count], first + count
            if leading and (own == own.reshape(-1, count)[0]).all():
                own = own.reshape(-1, count)[0]
            full = np.broadcast_to(self.numbers[name].astype(vector.dtype), own.shape[:-1] + mask.shape).copy()
            full[..., mask] = own
            found[name] = full
        return self.at(found)


def part_of(numbers: Mapping[str, Any], part: str) -> dict[str, Any]:
    """Numbers whose names begin with `part`, by their names without it."""
    return {name.removeprefix(part): x for name, x in numbers.items() if name.startswith(part)}


def is_input(number: Array, *, named: bool = False) -> Array:
    """Mask of the entries of a number that are inputs of kernels."""
    return np.asarray((np.abs(number) < UNBOUNDED) & ((number != 0) | named))
