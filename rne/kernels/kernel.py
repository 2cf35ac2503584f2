"""A traced function: the same call and the same results, as straight-line arithmetic."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..dynamics.conditioning import NEARLY_SINGULAR, rate_bound
from ..dynamics.quantity import Declared, common_leading_shape
from ..dynamics.verdict import SOUND, BatchIndex, Verdict
from ..model.arguments import joint_array, joint_shaped, model_argument
from ..model.model import Model
from .complex_step import complex_step
from .elements import entry_of_element
from .graph import TooLarge
from .heading import heading
from .numpy_backend import BlockProgram, check_out
from .python_backend import Guard, Refused, compiled_function
from .scalar import is_traced
from .source import Printable, to_source
from .trace import Trace, argument_widths, quantity_of, trace, within_a_trace
from .wrenches import named_by_function, wrenches_as_arrays

DTYPES = ("float64", "float32")


def compile(function: Declared, model: Model, **fixed: Any) -> Kernel:
    """Trace a function of (model, q, ...) on one model and return its kernel.

    Parameters
    ----------
    function : callable
        One of this package's functions of a model and joint arrays, such as `rne.inverse_dynamics`.
    model : Model
    **fixed
        Arguments other than joint arrays, such as `link="link_6"` for `rne.jacobian`. Of `external` the names of the
        links, such as `external=["link_6"]`: their wrenches, each (..., 6), follow the joint arrays in that order.

    Returns
    -------
    Kernel
        Called like the function, without the model: `kernel(q, qd, qdd)`, or `kernel(q, qd, qdd, wrench)`.

    Raises
    ------
    TypeError
        If the function is not one that can be traced, or a fixed argument is missing.

    Examples
    --------
    >>> import rne
    >>> kernel = rne.compile(rne.inverse_dynamics, rne.irb140())
    >>> sum(kernel.operations.values()) <= 320
    True
    """
    return Kernel(function, model, fixed)


def derivative(function: Declared, model: Model, *wrt: str, **fixed: Any) -> Kernel:
    """Trace a function and differentiate it exactly by some of its joint arrays.

    Parameters
    ----------
    function : callable
        One of this package's functions of a model and joint arrays, such as `rne.inverse_dynamics`.
    model : Model
    *wrt : str
        Names of arguments, such as "q", "qd"; "external_1" for the wrench on the first link of `external`.
    **fixed
        Arguments other than joint arrays, as in `compile`.

    Returns
    -------
    Kernel
        Returns the derivatives along a further last axis: by the entries of the first argument, then of the second ...

    Raises
    ------
    ValueError
        If a name is not one of the function's joint arrays.

    Examples
    --------
    >>> import rne
    >>> rne.derivative(rne.gravity_torque, rne.irb140(), "q")([0.0] * 6).shape
    (6, 6)
    """
    function, fixed = wrenches_as_arrays(function, model, fixed)
    names = tuple(quantity_of(function).widths)
    for name in wrt:
        if name not in names:
            raise ValueError(f"`wrt` must name arguments of {list(names)}, got {name!r}")
    if not wrt:
        raise ValueError(f"`wrt` must name at least one argument of {list(names)}")
    return Kernel(function, model, fixed, wrt)


class Kernel:
    """A function compiled for one model; see `compile`.

    A kernel may be called from many threads, and pickles. Its results may differ from the function's in the last bits.

    Attributes
    ----------
    model : Model
    names : tuple of str
        The arrays it takes, in order; wrenches are external_1, external_2, ...
    wrt : tuple of str
        The arguments of the derivatives; empty for the function itself.
    """

    def __init__(self, function: Declared, model: Model, fixed: Mapping[str, Any], wrt: Sequence[str] = ()) -> None:
        self.function, self.fixed = wrenches_as_arrays(function, model, fixed)
        self.quantity = quantity_of(self.function)
        self.model = model_argument(model)
        self.wrt = tuple(wrt)
        widths = argument_widths(self.quantity, model)
        self.names, self.widths = tuple(widths), tuple(widths.values())
        try:
            with np.errstate(all="ignore"):
                self._trace: Trace | None = trace(self.quantity, model, self.fixed, self.wrt)
        except TooLarge:
            self._trace = None
        self._shapes = tuple((width,) for width in self.widths)

    def __reduce__(self) -> tuple[Any, ...]:
        return Kernel, (self.function, self.model, self.fixed, self.wrt)

    def __repr__(self) -> str:
        count = f"{sum(self.operations.values())} operations" if self._trace else "run as the recursion"
        by = f" by {', '.join(self.wrt)}" if self.wrt else ""
        links = ", ".join(repr(link) for link in self.quantity.wrenches.values())
        under = f" under wrenches on {links}" if links else ""
        return f"Kernel {self.quantity.name}{by} of {self.model.name!r}{under}: {count}"

    @property
    def operations(self) -> dict[str, int]:
        """Arithmetic operations per state, by kind; empty if the recursion itself runs."""
        return self._trace.program.operations if self._trace else {}

    @property
    def is_unrolled(self) -> bool:
        """False if the function is too large to be written out, so that the recursion itself runs."""
        return self._trace is not None

    @property
    def traced(self) -> Trace:
        """The traced program; raises TypeError if the recursion itself runs."""
        if self._trace is None:
            raise TypeError(f"{self!r}: too large to be written out")
        return self._trace

    @cached_property
    def _rates(self) -> range:
        """Inputs that are joint rates whose squares may cost digits."""
        if self.quantity.rates is None:
            return range(0)
        name, entries = self.quantity.rates
        k = self.names.index(name)
        start = sum(self.widths[:k])
        return range(start, start + self.widths[k])[entries]

    @cached_property
    def state_function(self) -> Callable[..., Array]:
        """The program on one list of floats per argument; raises Refused where the recursion must look closer."""
        return self._state_function(self._rates)

    @cached_property
    def state_function_at_any_rate(self) -> Callable[..., Array]:
        """The same without the check of joint rates, for simulations, which check them at their samples."""
        return self._state_function(range(0))

    def _state_function(self, rates: range) -> Callable[..., Array]:
        n, eps, guard = self.model.n, float(np.finfo(np.float64).eps), None
        if self.quantity.judge is not None:
            guard = Guard(NEARLY_SINGULAR * n * eps, n, rates, rate_bound(np.dtype(np.float64)))
        return compiled_function(self.traced.program, self.widths, self.traced.shape, guard)

    @cached_property
    def blocks(self) -> BlockProgram:
        """The program on batches."""
        pivots = None if self.quantity.judge is None else self.model.n
        entries = int(np.prod(self.traced.shape, dtype=np.int64))
        return BlockProgram(self.traced.program, self.widths, entries, pivots, self._rates)

    def __call__(self, *arguments: Any, out: Array | None = None) -> Array:
        """Run the kernel.

        Parameters
        ----------
        *arguments : array_like, shape (..., n)
            The arrays that the function takes, in order.
        out : ndarray, optional
            Array for the result of a batch, of its shape and dtype, sharing no memory with the inputs.

        Returns
        -------
        ndarray
            As the function returns it.

        Raises
        ------
        ValueError, RneError
            As the function does.
        """
        result, verdict = self.evaluate(*arguments, out=out)
        if verdict is not SOUND:
            verdict.raise_or_warn(stacklevel=2)
        return result

    def _is_plain_state(self, arguments: Sequence[Any]) -> bool:
        """True for one float64 vector of the right length per argument."""
        if self._trace is None or len(arguments) != len(self._shapes):
            return False
        for a, shape in zip(arguments, self._shapes, strict=True):
            if type(a) is not np.ndarray or a.shape != shape or a.dtype.char != "d":
                return False
        return True

    def evaluate(self, *arguments: Any, out: Array | None = None) -> tuple[Array, Verdict]:
        """The result and its Verdict, not yet announced; see `__call__` for the arguments."""
        if out is None and self._is_plain_state(arguments):
            return self._evaluate_one_state(arguments)
        if any(is_traced(a) for a in arguments):  # within a law that is being traced itself
            return within_a_trace(self.quantity, self.model, arguments, self.fixed), SOUND
        if len(arguments) != len(self.names):
            raise TypeError(f"this kernel takes {', '.join(self.names)}; got {len(arguments)} arguments")
        try:
            return self._evaluate_arrays(arguments, out)
        except ValueError as error:
            raise named_by_function(self.quantity, self.model, arguments, error) from None

    def _evaluate_arrays(self, arguments: Sequence[Any], out: Array | None) -> tuple[Array, Verdict]:
        arrays = [
            joint_shaped(name, a, self.model, width)
            for name, a, width in zip(self.names, arguments, self.widths, strict=True)
        ]
        dtype = np.result_type(*arrays)
        if self._trace is not None and dtype.name in DTYPES:
            if out is None and dtype == np.float64 and all(a.ndim == 1 for a in arrays):
                return self._evaluate_one_state(arrays)
            return self._batch(arrays, dtype, out)
        result, verdict = self._by_function(arrays)
        if out is None or verdict.error is not None:
            return result, verdict
        check_out(out, result.shape, result.dtype, self.names, arrays)[...] = result
        return out, verdict

    def source(self, language: str = "python", element: str | None = None) -> str:
        """The kernel as source text of a function of one state; it does not check its arguments, nor M's pivots.

        Parameters
        ----------
        language : {"python", "numpy", "matlab", "c"}
            MATLAB runs in Octave too; "numpy" takes batches.
        element : str, optional
            One entry alone, as in the thesis's appendix C, with the operations that it needs: "m23" of M, "c3" of
            C q', "g2" of g, "tau4" of inverse dynamics, "h1" of bias torques, "qdd5" of forward dynamics. Joints are
            counted from 1; beyond nine, "m2_13".

        Returns
        -------
        str
            With the robot, the order of its joints and the units in a comment at the head.

        Raises
        ------
        ValueError
            For any other language, or an entry that the quantity does not have.
        TypeError
            If the kernel is too large to be written out.

        Examples
        --------
        >>> import rne
        >>> rne.compile(rne.gravity_torque, rne.irb140()).source("matlab", "g4").splitlines()[:2]
        ['function result = g4(q)', '% Entry 4 of gravity_torque of robot irb140']
        """
        name = "_".join([self.quantity.name, *(["by", *self.wrt] if self.wrt else [])])
        traced, entry = self.traced, None
        title = name
        if element is not None:
            entry = entry_of_element(element, name, traced.shape)
            traced, title = trace(self.quantity, self.model, self.fixed, self.wrt, entry), element
        lines = heading(self.model, name, self.names, entry, self.quantity.wrenches)
        return to_source(Printable(traced.program, title, self.names, self.widths, traced.shape, lines), language)

    def _by_function(self, arguments: Sequence[Any]) -> tuple[Array, Verdict]:
        """The function itself, or its derivatives by complex step."""
        if self.wrt:
            return complex_step(self.function, self.model, arguments, self.wrt, self.fixed)
        return self.function.evaluate(self.model, *arguments, **self.fixed)

    def _evaluate_one_state(self, arrays: Sequence[Array]) -> tuple[Array, Verdict]:
        try:
            return self.state_function(*[a.tolist() for a in arrays]), SOUND
        except Refused:
            return self._by_function(arrays)

    def _batch(self, arrays: Sequence[Array], dtype: np.dtype[Any], out: Array | None) -> tuple[Array, Verdict]:
        leading = common_leading_shape(dict(zip(self.names, arrays, strict=True)))
        shape = leading + self.traced.shape
        out = np.empty(shape, dtype=dtype) if out is None else check_out(out, shape, dtype, self.names, arrays)
        count = int(np.prod(leading, dtype=np.int64))
        states = [np.broadcast_to(a, leading + a.shape[-1:]).reshape(count, a.shape[-1]) for a in arrays]

        def by_function(begin: int, end: int) -> tuple[Array, Verdict]:
            for name, array, width in zip(self.names, states, self.widths, strict=True):
                joint_array(name, array.reshape(*leading, width), self.model, width)  # names NaN by its index
            result, verdict = self._by_function([array[begin:end].astype(dtype) for array in states])

            def place(state: BatchIndex) -> BatchIndex:
                k = begin + (state[0] if state else 0)
                return tuple(int(i) for i in np.unravel_index(k, leading))

            return np.asarray(result).reshape(end - begin, -1), verdict.with_state(place)

        entries = int(np.prod(self.traced.shape, dtype=np.int64))
        return out, self.blocks.run(states, out.reshape(count, entries), by_function)
