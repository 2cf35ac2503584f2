"""Derivatives of kernels by other kernels, as packages of automatic differentiation ask for them.

The derivatives of f(x) are its Jacobian J, backwards s J by the gradient kernel; those of the gradient w J(x) are the
Hessian of w . f and, by w, J; those of J are the Hessians of all entries. Hessians have none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import accumulate, pairwise
from math import prod
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..kernel import Kernel

Function = Callable[..., Any]  # of arrays (..., width) of one leading shape
WITH_RULES = ("values", "jacobian", "gradient")


class Rules:
    """The rules of a kernel and of the kernels that it leads to.

    `numbers` is the package of their arrays, as jax.numpy; `wrap` makes a function of a kernel and its rules.
    """

    def __init__(self, kernel: Kernel, numbers: Any, wrap: Callable[[Kernel, Rules], Function]) -> None:
        self.kernel, self.numbers = kernel, numbers
        self.names = tuple(kernel.quantity.widths)
        ends = [0, *accumulate(kernel.widths[: len(self.names)])]
        self.places = dict(zip(self.names, pairwise(ends), strict=True))  # of arguments among all their entries
        self.of = cache(lambda order: wrap(kernel.related(order, self.names), self))  # by all arguments

    def backwards(self, kernel: Kernel, arrays: Sequence[Any], slope: Any) -> tuple[Any, ...]:
        """Slopes of a sum by the kernel's arrays, from those by its result."""
        einsum, (x, further) = self.numbers.einsum, self._apart(arrays)
        if kernel.order == "values":
            slope = slope.reshape((*x[0].shape[:-1], prod(kernel.traced.shape)))
            return self._split(self.of("gradient")(*x, slope))
        parts = dict(zip(kernel.wrt, self._split(slope, kernel.wrt), strict=True))
        zeros = {
            name: self.numbers.zeros((*slope.shape[:-1], j - i), dtype=slope.dtype)
            for name, (i, j) in self.places.items()
        }
        slope = self.numbers.concatenate([(zeros | parts)[name] for name in self.names], -1)
        if kernel.order == "gradient":
            by_weights = einsum("...ek,...k->...e", self._jacobian(x, further[0].shape[-1]), slope)
            return *self._split(self.of("hessian_product")(*x, *further, slope)), by_weights
        entries = prod(kernel.traced.shape[:-1])
        slope = slope.reshape((*x[0].shape[:-1], entries, slope.shape[-1]))
        return self._split(einsum("...eij,...ej->...i", self._hessians(x, entries), slope))

    def forwards(self, kernel: Kernel, arrays: Sequence[Any], tangents: Sequence[Any]) -> Any:
        """The slope of the kernel's result along tangents of its arrays, linear in them."""
        einsum, (x, further) = self.numbers.einsum, self._apart(arrays)
        along, of_weights = self.numbers.concatenate(tangents[: len(x)], -1), tangents[len(x) :]
        if kernel.order == "values":
            found = einsum("...ek,...k->...e", self._jacobian(x, prod(kernel.traced.shape)), along)
        elif kernel.order == "gradient":
            J = self._jacobian(x, further[0].shape[-1])
            found = einsum("...ij,...j->...i", self.of("hessian")(*x, *further), along)
            found = self._picked(found + einsum("...ek,...e->...k", J, of_weights[0]), kernel.wrt)
        else:
            hessians = self._hessians(x, prod(kernel.traced.shape[:-1]))
            found = self._picked(einsum("...eij,...j->...ei", hessians, along), kernel.wrt)
        return found.reshape((*x[0].shape[:-1], *kernel.traced.shape))

    def _apart(self, arrays: Sequence[Any]) -> tuple[Sequence[Any], Sequence[Any]]:
        """The function's own arrays and those behind them."""
        return arrays[: len(self.names)], arrays[len(self.names) :]

    def _split(self, array: Any, names: Sequence[str] = ()) -> tuple[Any, ...]:
        """Entries along the last axis by argument."""
        widths = [self.places[name][1] - self.places[name][0] for name in names or self.names]
        return tuple(array[..., i:j] for i, j in pairwise([0, *accumulate(widths)]))

    def _picked(self, array: Any, names: Sequence[str]) -> Any:
        """Those entries along the last axis that belong to some arguments."""
        return self.numbers.concatenate([array[..., slice(*self.places[name])] for name in names], -1)

    def _jacobian(self, x: Sequence[Any], entries: int) -> Any:
        found = self.of("jacobian")(*x)
        return found.reshape((*x[0].shape[:-1], entries, found.shape[-1]))

    def _hessians(self, x: Sequence[Any], entries: int) -> Any:
        """Of each entry of the function, (..., entries, k, k)."""
        return self.of("hessian")(*(a[..., None, :] for a in x), self.numbers.eye(entries, dtype=x[0].dtype))
