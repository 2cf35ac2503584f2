"""The kernels of one model: the first single-state call runs the recursion, later calls and batches a kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..dynamics.aba import articulated_forward_dynamics
from ..dynamics.crba import factorise, mass_matrix, solve_factored
from ..dynamics.forward import forward_dynamics
from ..dynamics.quantity import OK, Declared, PrecisionStatus
from ..dynamics.rnea import External, inverse_dynamics
from ..model.model import Model
from .compilation import compile, derivative
from .complex_step import complex_step
from .engines import engine_argument
from .kernel import Kernel
from .parameter_inputs import inputs_as_arrays
from .plain_state import PlainState
from .scalar import is_traced
from .wrenches import wrench_links

# Counted on straight chains and on random ones: M with L^T D L takes fewer operations up to the first number of
# joints, articulated bodies beyond the second.
FEW_JOINTS, MANY_JOINTS = 9, 20

# Which arrays a kernel takes behind the joint arrays: ("external", links), ("parameters", True)
Inputs = tuple[tuple[str, Any], ...]


class KernelCache:
    """Evaluates quantities of a model: one state by the recursion at first, then by kernels, which are kept.

    Tracing costs as much as some hundred calls of the recursion. The two may differ in the last bits.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    engine : {"numpy", "numba"}
    """

    def __init__(self, model: Model, engine: str = "numpy") -> None:
        self.model, self.engine = model, engine_argument(engine)
        self._kernels: dict[Any, Kernel] = {}
        self._plain: dict[Any, PlainState] = {}  # of the kernels; without other arguments by the function alone
        self._evaluated: set[Any] = set()  # quantities evaluated for one state
        self._forward: dict[Inputs, Kernel] = {}
        self._orders: dict[tuple[str, ...], tuple[str, ...]] = {}  # of such links, as given: in the model's order

    def kernel(self, function: Declared, *wrt: str, **fixed: Any) -> Kernel:
        """The function, or its derivatives by some arguments, traced on first use."""
        if "link" in fixed:
            self.model.link_index(fixed["link"])
        if fixed.get("external") is not None:
            fixed["external"] = wrench_links(self.model, fixed["external"])
        key = (function, *wrt, *fixed.items())
        kernel = self._kernels.get(key)
        if kernel is None:
            make = derivative if wrt else compile
            kernel = self._kernels[key] = make(function, self.model, *wrt, engine=self.engine, **fixed)
            if kernel.is_unrolled:
                self._plain[key if wrt or fixed else function] = kernel.plain_state
        return kernel

    def value(self, function: Declared, *arrays: ArrayLike) -> Array:
        """A quantity that has no PrecisionStatus and no other arguments, for one state or a batch."""
        plain = self._plain.get(function)
        result = None if plain is None else plain(*arrays)
        return self.evaluate(function, *arrays)[0] if result is None else result

    def value_with(
        self,
        function: Declared,
        *arrays: ArrayLike,
        external: External | None = None,
        parameters: ArrayLike | None = None,
    ) -> Array:
        """A quantity that has no PrecisionStatus, under external wrenches by link, or at other inertial parameters."""
        inputs, arrays = self._with_inputs(function, arrays, external, parameters)
        if not inputs:
            return self.value(function, *arrays)
        plain = self._plain.get((function, *inputs))
        result = None if plain is None else plain(*arrays)
        return self.evaluate(function, *arrays, **dict(inputs))[0] if result is None else result

    def _derivatives(self, function: Declared, wrt: tuple[str, ...], *arrays: ArrayLike) -> Array:
        """Its derivatives by some arguments."""
        plain = self._plain.get((function, *wrt))
        result = None if plain is None else plain(*arrays)
        return self.evaluate(function, *arrays, wrt=wrt)[0] if result is None else result

    def evaluate(
        self, function: Declared, *arrays: ArrayLike, wrt: Sequence[str] = (), **fixed: Any
    ) -> tuple[Array, PrecisionStatus]:
        """A quantity, or its derivatives by some arguments, for one state or a batch."""
        key = (function, *wrt, *fixed.items())
        kernel = self._kernels.get(key)
        if kernel is None:
            if self._mark_first_state(key, arrays):
                function, fixed = inputs_as_arrays(function, self.model, fixed)
                if wrt:
                    return complex_step(function, self.model, arrays, wrt, fixed)
                return function.evaluate(self.model, *arrays, **fixed)
            kernel = self.kernel(function, *wrt, **fixed)
        return kernel.evaluate(*arrays)

    def _mark_first_state(self, key: Any, arrays: Sequence[ArrayLike]) -> bool:
        """True if a quantity is evaluated for one state for the first time, which is recorded."""
        if key in self._evaluated or any(is_traced(a) for a in arrays):
            return False
        try:
            one_state = all(np.ndim(a) < 2 for a in arrays)
        except ValueError:
            one_state = True  # no array: named where the function checks its arguments
        if one_state:
            self._evaluated.add(key)
        return one_state

    def _with_inputs(
        self,
        function: Declared,
        arrays: tuple[ArrayLike, ...],
        external: External | None,
        parameters: ArrayLike | None,
    ) -> tuple[Inputs, tuple[ArrayLike, ...]]:
        """The inputs behind the joint arrays, and all arrays."""
        inputs: Inputs = ()
        if external is not None:
            links, arrays = self._with_wrenches(function, arrays, external)
            inputs = (("external", links),) if links else ()
        if parameters is not None:
            inputs, arrays = (*inputs, ("parameters", True)), (*arrays, parameters)
        return inputs, arrays

    def _with_wrenches(
        self, function: Declared, arrays: tuple[ArrayLike, ...], external: External
    ) -> tuple[tuple[str, ...], tuple[ArrayLike, ...]]:
        """The links of external wrenches in the model's order, and the arrays with their wrenches behind them."""
        links = self._orders.get(tuple(external)) if isinstance(external, Mapping) else None
        if links is None:
            names = self.model.link_names
            if not isinstance(external, Mapping) or not set(external) <= set(names):
                function.evaluate(self.model, *arrays, external=external)  # names what is wrong
            links = self._orders[tuple(external)] = tuple(sorted(external, key=names.index))
        return links, arrays + tuple([external[link] for link in links])

    def accelerations(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        tau: ArrayLike,
        external: External | None = None,
        parameters: ArrayLike | None = None,
    ) -> tuple[Array, PrecisionStatus]:
        """Forward dynamics by the method that suits the model."""
        inputs: Inputs = ()
        arrays: tuple[ArrayLike, ...] = (q, qd, tau)
        if external is not None or parameters is not None:
            inputs, arrays = self._with_inputs(forward_dynamics, arrays, external, parameters)
        kernel = self._forward.get(inputs)
        if kernel is not None and kernel.is_unrolled:
            result = kernel.plain_state(*arrays)
            if result is not None:
                return result, OK
        if kernel is None and self._mark_first_state(("forward dynamics", *inputs), arrays):
            method, _ = inputs_as_arrays(self._forward_methods()[-1], self.model, dict(inputs))
            return method.evaluate(self.model, *arrays)
        return self.forward_kernel(**dict(inputs)).evaluate(*arrays)

    def forward_kernel(self, **fixed: Any) -> Kernel:
        """The kernel of forward dynamics by the method with fewer operations; `external`, `parameters` as in `compile`.

        That is M with L^T D L for few joints, articulated bodies for many; in between both are counted. They lose
        about the same digits on few joints, and on long chains articulated bodies lose fewer.
        """
        inputs = tuple(fixed.items())
        kernel = self._forward.get(inputs)
        if kernel is None:
            kernels = [self.kernel(method, **fixed) for method in self._forward_methods()]
            kernel = min(kernels, key=lambda k: sum(k.operations.values()) or float("inf"))
            self._forward[inputs] = kernel
        return kernel

    def forward_method(self) -> Declared:
        """The function that forward dynamics of this model use; traced only where operations must be counted."""
        methods = self._forward_methods()
        return methods[0] if len(methods) == 1 else self.forward_kernel().function

    def _forward_methods(self) -> list[Declared]:
        """The candidates by the number of joints."""
        if self.model.n <= FEW_JOINTS or self.model.has_mimics:
            return [forward_dynamics]
        if self.model.n > MANY_JOINTS:
            return [articulated_forward_dynamics]
        return [forward_dynamics, articulated_forward_dynamics]

    def inverse_derivatives(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> tuple[Array, Array, Array]:
        """Derivatives of inverse dynamics by q and by qd, and M, its derivative by qdd, each (..., n, n)."""
        slopes = self._derivatives(inverse_dynamics, ("q", "qd"), q, qd, qdd)
        n = self.model.n
        dq, dqd = slopes[..., :n], slopes[..., n:]
        M = self.value(mass_matrix, q)
        if M.shape == dq.shape and M.dtype == dq.dtype:
            return dq, dqd, M
        M = self.value(mass_matrix, np.asarray(q).astype(slopes.dtype, copy=False))
        return dq, dqd, np.broadcast_to(M, dq.shape).copy()

    def forward_derivatives(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike) -> tuple[Array, PrecisionStatus]:
        """Derivatives of forward dynamics by q, qd and tau side by side, (..., n, 3 n).

        From M qdd + h = tau: M dqdd = -d(M qdd + h) at constant qdd. Carpentier and Mansard 2018.
        """
        qdd, status = self.accelerations(q, qd, tau)
        if status.error is not None:
            return qdd, status
        dq, dqd, M = self.inverse_derivatives(q, qd, qdd)
        identity = np.broadcast_to(np.eye(self.model.n, dtype=qdd.dtype), dq.shape)
        right = np.concatenate([-dq, -dqd, identity], axis=-1)
        if M.dtype.char in "fdFD":
            return np.linalg.solve(M, right), status
        parent = self.model.coordinate_parent  # LAPACK has no other types
        L, D = factorise(M, parent)
        rows = solve_factored(L[..., None, :, :], D[..., None, :], parent, np.swapaxes(right, -1, -2))
        return np.swapaxes(rows, -1, -2), status
