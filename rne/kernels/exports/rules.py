"""Derivatives of kernels by other kernels of the same function, for automatic differentiation.

With f(x), its Jacobian J, weights s and tangents t: backwards, f gives s J by the gradient kernel, and w J gives the
Hessian of w . f times s, by w J s. Forwards, f gives J t, and J the Hessians of all entries times t.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import accumulate, pairwise
from math import prod
from typing import Any

BACKWARDS, FORWARDS = ("values", "gradient"), ("values", "jacobian")  # orders with a rule


class Rules:
    """Rules of a kernel and of the kernels they lead to, on arrays (..., width) of a package `numbers`.

    `wrap` makes a function of arrays of a kernel and these rules.
    """

    def __init__(self, kernel: Any, numbers: Any, wrap: Callable[[Any, Rules], Callable[..., Any]]) -> None:
        self.numbers, self.names = numbers, tuple(kernel.quantity.widths)
        self.ends = [0, *accumulate(kernel.widths[: len(self.names)])]
        shape = kernel.traced.shape[: -1 if kernel.order == "jacobian" else None]
        self.entries = kernel.widths[-1] if kernel.order == "gradient" else prod(shape)  # of f
        own = kernel.function, kernel.model, kernel.fixed, self.names, kernel.engine
        self.of = cache(lambda order: wrap(type(kernel)(*own, order), self))

    def apply(self, kernel: Any, orders: Sequence[str]) -> bool:
        """True if the kernel is of one of these orders, and by all arguments."""
        return kernel.order in orders and kernel.wrt in ((), self.names)

    def backwards(self, kernel: Any, arrays: Sequence[Any], slope: Any) -> tuple[Any, ...]:
        """Vector-Jacobian product: derivatives by each array of a sum weighted by `slope`."""
        x, by_weights = arrays[: len(self.names)], list[Any]()
        if kernel.order == "values":
            slope = slope.reshape((*x[0].shape[:-1], self.entries))
        else:
            by_weights = [self.numbers.einsum("...ek,...k->...e", self._jacobian(x), slope)]
        found = self.of("hessian_product" if by_weights else "gradient")(*arrays, slope)
        return *(found[..., i:j] for i, j in pairwise(self.ends)), *by_weights

    def forwards(self, kernel: Any, x: Sequence[Any], tangents: Sequence[Any]) -> Any:
        """Jacobian-vector product: derivative of the kernel's result along tangents, linear in them."""
        along = self.numbers.concatenate(tangents, -1)
        if kernel.order == "values":
            found = self.numbers.einsum("...ek,...k->...e", self._jacobian(x), along)
        else:
            unit = self.numbers.eye(self.entries, dtype=x[0].dtype)
            hessians = self.of("hessian")(*(a[..., None, :] for a in x), unit)
            found = self.numbers.einsum("...eij,...j->...ei", hessians, along)
        return found.reshape((*x[0].shape[:-1], *kernel.traced.shape))

    def _jacobian(self, x: Sequence[Any]) -> Any:
        return self.of("jacobian")(*x).reshape((*x[0].shape[:-1], self.entries, self.ends[-1]))
