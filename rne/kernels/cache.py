"""Kernels of one model, traced on demand."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..dynamics.aba import articulated_forward_dynamics
from ..dynamics.crba import mass_matrix
from ..dynamics.forward import forward_dynamics
from ..dynamics.quantity import Declared, PrecisionStatus
from ..dynamics.rnea import External, inverse_dynamics
from ..graph.scalar import is_traced
from ..model.model import Model
from .compilation import compile, derivative, gradient, hessian, hessian_product
from .kernel import Kernel, engine_argument
from .soundness import NeedsRecursion
from .trace import by_recursion, takes_complex_steps, wrench_links

# Counted on straight chains and on random ones: M with L^T D L takes fewer operations up to the first number of
# joints, articulated bodies beyond the second. They lose about the same digits on few joints, and on long chains
# articulated bodies lose fewer.
FEW_JOINTS, MANY_JOINTS = 9, 20
NOTHING: Mapping[str, Any] = {}
SCENES, VARIANTS = 64, 16  # most kernels of scenes, and most derived robots, that are kept
CALLED = 256  # most quantities and functions of scenes whose first evaluation is remembered
OF_TRACING, OF_A_CALL = 1500, 150  # time of tracing, and of a recursion's call, in states by the recursion
MAKERS = {"gradient": gradient, "hessian": hessian, "hessian_product": hessian_product}
K = TypeVar("K")
V = TypeVar("V")


class Recent(OrderedDict[K, V]):
    """Dictionary of the entries used last, safe for threads; it is empty in another process."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self.most, self.lock = most, threading.RLock()

    def get_or_make(self, key: K, make: Callable[[], V]) -> V:
        """Value of a key, computed where there is none."""
        with self.lock:
            value = self.pop(key, None)
            value = self[key] = make() if value is None else value
            while len(self) > self.most:
                self.popitem(last=False)
            return value


class KernelCache:
    """Cache that evaluates quantities of a model by kernels, traced on demand and kept.

    For one state, the first call of a quantity runs the recursion, the second traces it, and from the third on only
    the kernel runs: for six joints 0.9 ms, 8 ms and 10 us; with LLVM 0.9 ms, 5 to 100 ms and 3 us. A batch of states is
    traced at its first call; states of motions are left to the recursion until it has taken as long as tracing would. A
    scene traces only what it integrates. Recursion and kernel may differ in the last bits.
    """

    def __init__(self, model: Model, engine: str = "numpy") -> None:
        self.model, self.engine = model, engine_argument(engine)
        self._kernels: dict[Any, Kernel] = {}
        self._forward: dict[Any, Kernel] = {}  # of forward dynamics by the method chosen
        self._called: Recent[Any, int] = Recent(CALLED)  # evaluations by the recursion so far
        self._links: dict[tuple[str, ...], tuple[str, ...]] = {}  # of wrenches as given: in the model's order
        self._scenes: Recent[Any, Kernel] = Recent(SCENES)
        self._variants: Recent[Model, KernelCache] = Recent(VARIANTS)
        self.laws: Recent[Any, Any] = Recent(SCENES)  # traced laws by their structure
        self.reasons: Recent[Any, str] = Recent(SCENES)  # why laws are not traced, empty for those that are
        self.base_parameters: Recent[str, Any] = Recent(VARIANTS)  # by their options: found once for a robot

    def __reduce__(self) -> tuple[Any, ...]:
        return KernelCache, (self.model, self.engine)

    def __deepcopy__(self, _: Any) -> KernelCache:
        return self  # whose kernels never change

    @cached_property
    def typical_inertia(self) -> Array:
        """Diagonal of M in one configuration, with 0 replaced by 1, as a scale of energies and impulses."""
        diagonal = np.diagonal(mass_matrix(self.model, np.zeros(self.model.n)))
        return np.where(diagonal > 0, diagonal, 1.0)

    def kernel(self, function: Declared, *wrt: str, order: str | None = None, **fixed: Any) -> Kernel:
        """Kernel of a function, or of its derivatives by some arguments, traced on first use; see `compile`."""
        if "link" in fixed:
            self.model.link_index(fixed["link"])
        if fixed.get("external") is not None:
            fixed["external"] = wrench_links(self.model, fixed["external"])
        key = (function, *wrt, *fixed.items()) if wrt or fixed else function
        key = key if order is None else (order, key)
        try:
            kernel = self._kernels.get(key)
        except TypeError:  # an array or a list, which has no hash
            return compile(function, self.model, engine=self.engine, **fixed)
        if kernel is None:
            if order not in (None, *MAKERS):
                raise ValueError(f"`order` must be one of {list(MAKERS)}, got {order!r}")
            make: Any = MAKERS[order] if order else derivative if wrt else compile
            kernel = self._kernels[key] = make(function, self.model, *wrt, engine=self.engine, **fixed)
        return kernel

    def scene_kernel(self, function: Declared, *wrt: str, order: str = "jacobian", **fixed: Any) -> Kernel:
        """Kernel of a function of a scene, which is equal by value; the 64 used last are kept."""
        key = function, wrt, order, *fixed.items()
        return self._scenes.get_or_make(key, lambda: Kernel(function, self.model, fixed, wrt, self.engine, order))

    def evaluate_some(self, function: Declared, *arrays: Array) -> Array:
        """Quantity of a robot or a scene in states evaluated once; by the recursion up to the cost of OF_TRACING."""
        kernel, key = self._kernels.get(function) or self._scenes.get((function, (), "jacobian")), ("some", function)
        if kernel is None and not any(is_traced(a) for a in arrays):
            count = self._called.pop(key, 0) + OF_A_CALL + max(math.prod(a.shape[:-1]) for a in arrays)
            if self._called.get_or_make(key, lambda: count) <= OF_TRACING:
                return by_recursion(function, self.model, arrays, (), {})[0]
        return (kernel or self.scene_kernel(function)).evaluate(*arrays)[0]

    def keep_scene(self, kernel: Kernel) -> None:
        """Keep a kernel of a scene under its function."""
        key = kernel.function, kernel.wrt, "jacobian", *kernel.fixed.items()
        self._scenes.pop(key, None)
        self._scenes.get_or_make(key, lambda: kernel)

    def variant(self, model: Model) -> KernelCache:
        """Kernels of another model derived from this one; equal models share them."""
        if model == self.model:
            return self
        return self._variants.get_or_make(model, lambda: KernelCache(model, self.engine))

    def evaluate_quantity(
        self,
        function: Declared,
        *arrays: ArrayLike,
        wrt: Sequence[str] = (),
        external: External | None = None,
        parameters: ArrayLike | None = None,
        link: str | None = None,
        point: tuple[float, ...] | None = None,
    ) -> Array:
        """Any quantity but forward dynamics, or its derivatives with respect to `wrt`, for one state or a batch."""
        fixed = NOTHING  # a dictionary for each call would cost 5 % of one
        if external is not None or parameters is not None:
            fixed, arrays = self._with_inputs(function, arrays, external, parameters)
        elif link is not None:
            fixed = {"link": link} if point is None else {"link": link, "point": point}
        key = (function, *wrt, *fixed.items()) if wrt or fixed else function
        kernel = self._kernels.get(key)
        if kernel is None:
            if self._is_first_state(key, arrays, function, wrt):
                return by_recursion(function, self.model, arrays, wrt, fixed)[0]
            kernel = self.kernel(function, *wrt, **fixed)
        try:
            result = kernel.fast_call(*arrays)
        except NeedsRecursion:
            return kernel.by_recursion(*arrays)[0]
        return kernel.evaluate(*arrays)[0] if result is None else result

    def forward_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        tau: ArrayLike,
        external: External | None = None,
        parameters: ArrayLike | None = None,
    ) -> tuple[Array, PrecisionStatus]:
        """Accelerations by the method that suits the model, and their status."""
        inputs = NOTHING
        arrays: tuple[ArrayLike, ...] = q, qd, tau
        if external is not None or parameters is not None:
            inputs, arrays = self._with_inputs(forward_dynamics, arrays, external, parameters)
        kernel = self._forward.get(tuple(inputs.items()) if inputs else ())
        if kernel is None:
            if self._is_first_state(("forward dynamics", *inputs.items()), arrays, forward_dynamics):
                return by_recursion(self._candidates()[-1], self.model, arrays, (), inputs)
            kernel = self.forward_kernel(**inputs)
        return kernel.evaluate(*arrays)

    def _is_first_state(
        self, key: Any, arrays: Sequence[ArrayLike], function: Declared, wrt: Sequence[str] = ()
    ) -> bool:
        """True for the first single state of a quantity, if the recursion has its derivatives; remembers it."""
        if key in self._called or any(is_traced(a) for a in arrays):
            return False
        try:
            one_state = all(np.ndim(a) < 2 for a in arrays)
        except ValueError:
            one_state = True  # no array: named where the function checks its arguments
        if one_state:
            self._called.get_or_make(key, lambda: 1)
        return one_state and (not wrt or takes_complex_steps(function, self.model))

    def _with_inputs(
        self, function: Declared, arrays: tuple[ArrayLike, ...], external: External | None, parameters: ArrayLike | None
    ) -> tuple[Mapping[str, Any], tuple[ArrayLike, ...]]:
        """Inputs other than joint arrays, as arguments of `compile`, and all arrays in the kernel's order."""
        inputs: dict[str, Any] = {}
        if external is not None:
            links = self._links.get(tuple(external)) if isinstance(external, Mapping) else None
            if links is None:
                names = self.model.link_names
                if not isinstance(external, Mapping) or not set(external) <= set(names):
                    function.evaluate(self.model, *arrays, external=external)  # raises the error
                links = self._links[tuple(external)] = tuple(sorted(external, key=names.index))
            if links:
                inputs["external"], arrays = links, (*arrays, *[external[link] for link in links])
        if parameters is not None:
            inputs["parameters"], arrays = True, (*arrays, parameters)
        return inputs, arrays

    def forward_kernel(self, **fixed: Any) -> Kernel:
        """Kernel of forward dynamics by the method with fewer operations; `external`, `parameters` as in `compile`."""
        inputs = tuple(fixed.items())
        kernel = self._forward.get(inputs)
        if kernel is None:
            kernels = [self.kernel(method, **fixed) for method in self._candidates()]
            kernel = min(kernels, key=lambda k: sum(k.operations.values()) or float("inf"))
            self._forward[inputs] = kernel
        return kernel

    @cached_property
    def forward_method(self) -> Declared:
        """Function used for forward dynamics of this model; traced only where operations must be counted."""
        methods = self._candidates()
        return methods[0] if len(methods) == 1 else self.forward_kernel().function

    def _candidates(self) -> list[Declared]:
        """Candidate methods by the number of joints."""
        if self.model.n <= FEW_JOINTS or self.model.has_mimics:
            return [forward_dynamics]
        if self.model.n > MANY_JOINTS:
            return [articulated_forward_dynamics]
        return [forward_dynamics, articulated_forward_dynamics]

    def inverse_derivatives(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> tuple[Array, Array, Array]:
        """Derivatives of inverse dynamics with respect to q, qd and qdd (which is M), each (..., n, n)."""
        slopes = self.evaluate_quantity(inverse_dynamics, q, qd, qdd, wrt=("q", "qd"))
        n = self.model.n
        dq, dqd = slopes[..., :n], slopes[..., n:]
        M = self.evaluate_quantity(mass_matrix, np.asarray(q).astype(slopes.dtype, copy=False))
        return dq, dqd, M if M.shape == dq.shape else np.broadcast_to(M, dq.shape).copy()

    def forward_derivatives(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike) -> tuple[Array, PrecisionStatus]:
        """Derivatives of forward dynamics with respect to q, qd and tau, (..., n, 3 n), and their status."""
        function, wrt, arrays = self.forward_method, ("q", "qd", "tau"), (q, qd, tau)
        key = (function, *wrt)
        if key not in self._kernels and self._is_first_state(key, arrays, function, wrt):
            return by_recursion(function, self.model, arrays, wrt, NOTHING)
        return self.kernel(function, *wrt).evaluate(*arrays)
