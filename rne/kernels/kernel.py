"""A traced function: the same call and the same results, as straight-line arithmetic."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from math import prod
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..basics.text import InNotebooks, short, wrapped
from ..dynamics.quantity import OK, BatchIndex, Declared, PrecisionStatus, common_dtype, common_leading_shape
from ..model.model import Model, joint_array, joint_shaped, model_argument
from .complex_step import complex_step
from .elements import entry_of_element
from .engines import Batches, engine_argument, engine_of
from .graph import TooLarge
from .heading import heading
from .numpy_backend import check_out
from .parameter_inputs import inputs_as_arrays
from .plain_state import plain_state_call
from .python_backend import Guard, Refused
from .scalar import is_traced
from .source import Printable, to_source
from .threads import check_workers, run_in_threads
from .trace import Trace, argument_widths, quantity_of, trace, within_a_trace
from .wrenches import named_by_function

FLOAT64, FLOAT32 = np.dtype("float64"), np.dtype("float32")


class Kernel(InNotebooks):
    """A function compiled for one model; see `compile`.

    A kernel may be called from many threads, and pickles. Its results may differ from the function's in the last bits.

    Attributes
    ----------
    model : Model
    names : tuple of str
        The arrays it takes, in order; wrenches are external_1, external_2, ..., inertial parameters `parameters`.
    wrt : tuple of str
        The arguments of the derivatives; empty for the function itself.
    engine : {"numpy", "numba"}
        What runs it.

    Examples
    --------
    >>> import rne
    >>> kernel = rne.compile(rne.dynamics.mass_matrix, rne.irb140())
    >>> kernel.names, kernel([[0.1] * 6] * 1000).shape
    (('q',), (1000, 6, 6))
    """

    def __init__(
        self,
        function: Declared,
        model: Model,
        fixed: Mapping[str, Any],
        wrt: Sequence[str] = (),
        engine: str = "numpy",
    ) -> None:
        self.function, self.fixed = inputs_as_arrays(function, model, fixed)
        self.quantity = quantity_of(self.function)
        self.model = model_argument(model)
        self.wrt = tuple(wrt)
        self.engine = engine_argument(engine)
        widths = argument_widths(self.quantity, model)
        self.names, self.widths = tuple(widths), tuple(widths.values())
        try:
            with np.errstate(all="ignore"):
                self._trace: Trace | None = trace(self.quantity, model, self.fixed, self.wrt)
        except TooLarge:
            self._trace = None
        self.plain_state = plain_state_call(self.widths, lambda: self.state_function)

    def __reduce__(self) -> tuple[Any, ...]:
        return Kernel, (self.function, self.model, self.fixed, self.wrt, self.engine)

    def __repr__(self) -> str:
        count = f"{sum(self.operations.values())} operations" if self._trace else "run as the recursion"
        by = f" by {', '.join(self.wrt)}" if self.wrt else ""
        links = ", ".join(f"'{short(link)}'" for link in self.quantity.wrenches.values())
        under = f" under wrenches on {links}" if links else ""
        at = " at parameters given" if "parameters" in self.names else ""
        by_numba = self.engine == "numba" and self.is_unrolled
        engine = f", by Numba{self._compiled_in}" if by_numba else ""
        return wrapped(f"Kernel {self.quantity.name}{by} of '{short(self.model.name)}'{under}{at}: {count}{engine}")

    @property
    def _compiled_in(self) -> str:
        """How long compilations took so far."""
        forms = ("state_function", "state_function_at_any_rate", "blocks")
        seconds = sum(getattr(self.__dict__[name], "seconds", 0.0) for name in forms if name in self.__dict__)
        return f", compiled in {seconds:.2g} s" if seconds else ""

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
        if self.quantity.velocities is None:
            return range(0)
        name, entries = self.quantity.velocities
        k = self.names.index(name)
        start = sum(self.widths[:k])
        return range(start, start + self.widths[k])[entries]

    @cached_property
    def state_function(self) -> Callable[..., Array]:
        """The program on one float64 vector per argument; raises Refused where the recursion must look closer."""
        return self._state_function(self._rates)

    @cached_property
    def state_function_at_any_rate(self) -> Callable[..., Array]:
        """The same without the check of joint rates, for simulations, which check them at their samples."""
        return self._state_function(range(0))

    def _state_function(self, rates: range) -> Callable[..., Array]:
        guard = None if self.quantity.check is None else Guard.of(self.model.n, rates, FLOAT64)
        make = engine_of(self.engine).state_function
        return make(self.traced.program, self.widths, self.traced.shape, guard)

    @cached_property
    def blocks(self) -> Any:
        """The program on batches."""
        pivots = None if self.quantity.check is None else self.model.n
        entries = prod(self.traced.shape)
        batches: Batches = engine_of(self.engine).batches(
            self.traced.program, self.widths, entries, pivots, self._rates
        )
        return batches

    def __call__(self, *arguments: Any, out: Array | None = None, workers: int = 1) -> Array:
        """Run the kernel.

        Parameters
        ----------
        *arguments : array_like, shape (..., n)
            The arrays that the function takes, in order.
        out : ndarray, optional
            Array for the result of a batch, of its shape and dtype, sharing no memory with the inputs.
        workers : int
            Threads that share a batch. With engine "numba" they run in parallel; NumPy's calls are mostly too short.
            After an error what is in `out` is undefined.

        Returns
        -------
        ndarray
            As the function returns it.

        Raises
        ------
        ValueError, RneError
            As the function does.

        Examples
        --------
        >>> import numpy as np, rne
        >>> kernel = rne.compile(rne.dynamics.gravity_torque, rne.irb140())
        >>> result = np.empty((1000, 6))
        >>> kernel(np.zeros((1000, 6)), out=result) is result
        True
        """
        result, status = self.evaluate(*arguments, out=out, workers=workers)
        if status is not OK:
            status.raise_or_warn(stacklevel=2)
        return result

    def evaluate(self, *arguments: Any, out: Array | None = None, workers: int = 1) -> tuple[Array, PrecisionStatus]:
        """The result and its PrecisionStatus, not yet announced; see `__call__` for the arguments."""
        if out is None and workers == 1 and self._trace is not None and len(arguments) == len(self.names):
            result = self.plain_state(*arguments)
            if result is not None:
                return result, OK
        if any(is_traced(a) for a in arguments):  # within a law that is being traced itself
            return within_a_trace(self.quantity, self.model, arguments, self.fixed), OK
        check_workers(workers)
        if len(arguments) != len(self.names):
            raise TypeError(f"this kernel takes {', '.join(self.names)}; got {len(arguments)} arguments")
        try:
            return self._evaluate_arrays(arguments, out, workers)
        except ValueError as error:
            raise named_by_function(self.quantity, self.model, arguments, error) from None

    def _evaluate_arrays(
        self, arguments: Sequence[Any], out: Array | None, workers: int
    ) -> tuple[Array, PrecisionStatus]:
        arrays = [
            joint_shaped(name, a, self.model, width)
            for name, a, width in zip(self.names, arguments, self.widths, strict=True)
        ]
        dtype = common_dtype(arrays)
        if self._trace is not None and dtype in (FLOAT64, FLOAT32):
            if out is None and dtype == FLOAT64 and all(a.ndim == 1 for a in arrays):
                return self._evaluate_one_state([a.astype(FLOAT64, copy=False) for a in arrays])
            return self._batch(arrays, dtype, out, workers)
        result, status = self._by_function(arrays)
        if out is None or status.error is not None:
            return result, status
        check_out(out, result.shape, result.dtype, self.names, arrays)[...] = result
        return out, status

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
        >>> rne.compile(rne.dynamics.gravity_torque, rne.irb140()).source("matlab", "g4").splitlines()[:2]
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

    def _by_function(self, arguments: Sequence[Any]) -> tuple[Array, PrecisionStatus]:
        """The function itself, or its derivatives by complex step."""
        if self.wrt:
            return complex_step(self.function, self.model, arguments, self.wrt, self.fixed)
        return self.function.evaluate(self.model, *arguments, **self.fixed)

    def _evaluate_one_state(self, arrays: Sequence[Array]) -> tuple[Array, PrecisionStatus]:
        try:
            return self.state_function(*arrays), OK
        except Refused:
            return self._by_function(arrays)

    def _batch(
        self, arrays: Sequence[Array], dtype: np.dtype[Any], out: Array | None, workers: int
    ) -> tuple[Array, PrecisionStatus]:
        leading = common_leading_shape(dict(zip(self.names, arrays, strict=True)))
        shape = leading + self.traced.shape
        out = np.empty(shape, dtype=dtype) if out is None else check_out(out, shape, dtype, self.names, arrays)
        count = prod(leading)
        states = [self._rows(a, leading, count) for a in arrays]

        def by_function(begin: int, end: int) -> tuple[Array, PrecisionStatus]:
            for name, array, width in zip(self.names, arrays, self.widths, strict=True):
                joint_array(name, array, self.model, width)  # names NaN by its index
            result, status = self._by_function([array[begin:end].astype(dtype) for array in states])

            def place(state: BatchIndex) -> BatchIndex:
                k = begin + (state[0] if state else 0)
                return tuple(int(i) for i in np.unravel_index(k, leading))

            return np.asarray(result).reshape(end - begin, -1), status.with_state(place)

        rows = out.reshape(count, prod(self.traced.shape))
        return out, run_in_threads(self.blocks, states, rows, by_function, workers)

    def _rows(self, array: Array, leading: tuple[int, ...], count: int) -> Array:
        """One row for each state of a batch."""
        width = array.shape[-1]
        if array.shape[:-1] != leading:
            array = np.broadcast_to(array, (*leading, width))
        return array.reshape(count, width)
