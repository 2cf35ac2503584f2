"""A traced function: the same call and the same results, as straight-line arithmetic."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ..arguments import joint_shaped, model_argument
from ..dynamics.checks import Checked
from ..dynamics.precision import DOUBTFUL
from ..model import Model
from ..spatial import Array
from .block import Layout, Workspace, allocate
from .complex_step import complex_step
from .graph import TooLarge
from .printer import Printable, to_source
from .run import check_out, run_batch
from .scalar import is_traced
from .single import function as single_function
from .trace import Trace, argument_widths, joint_arguments, trace, traced_model

DTYPES = ("float64", "float32")


def compile(function: Checked[Any, Any, Any], model: Model, **fixed: Any) -> Kernel:
    """Trace a function of (model, q, ...) on one model and return its kernel.

    Parameters
    ----------
    function : callable
        One of this package's functions of a model and joint arrays, such as `rne.inverse_dynamics`.
    model : Model
    **fixed
        Arguments other than joint arrays, such as `link="link_6"` for `rne.jacobian`.

    Returns
    -------
    Kernel
        To be called as the function without the model: `kernel(q, qd, qdd)`.

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


def derivative(function: Checked[Any, Any, Any], model: Model, *wrt: str, **fixed: Any) -> Kernel:
    """Trace a function and differentiate it exactly by some of its joint arrays.

    Parameters
    ----------
    function : callable
        One of this package's functions of a model and joint arrays, such as `rne.inverse_dynamics`.
    model : Model
    *wrt : str
        Names of arguments, such as "q", "qd".
    **fixed
        Arguments other than joint arrays.

    Returns
    -------
    Kernel
        Gives the derivatives along a further last axis: by each joint of the first name, then of the second ...

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
    names = joint_arguments(function)
    for name in wrt:
        if name not in names:
            raise ValueError(f"`wrt` must name arguments of {list(names)}, got {name!r}")
    if not wrt:
        raise ValueError(f"`wrt` must name at least one argument of {list(names)}")
    return Kernel(function, model, fixed, wrt)


class Kernel:
    """A function compiled for one model; see `compile`.

    A kernel may be called from many threads, and pickles.

    Attributes
    ----------
    model : Model
    names : tuple of str
        The joint arrays it takes, in order.
    wrt : tuple of str
        Those it gives the derivatives by; empty for the function itself.
    """

    def __init__(
        self, function: Checked[Any, Any, Any], model: Model, fixed: Mapping[str, Any], wrt: Sequence[str] = ()
    ) -> None:
        self.function = function
        self.model = model_argument(model)
        self.fixed = dict(fixed)
        self.names = joint_arguments(function)
        self.wrt = tuple(wrt)
        if "external" in self.fixed:
            raise TypeError("`external` cannot be compiled in; call the function itself with it")
        try:
            with np.errstate(all="ignore"):
                self._trace: Trace | None = trace(function, model, self.names, self.fixed, self.wrt)
        except TooLarge:
            self._trace = None
        self.widths = tuple(argument_widths(function, model, self.names).values())
        self.workspaces: dict[str, list[Workspace]] = {dtype: [] for dtype in DTYPES}
        self._shapes = tuple((width,) if self._trace else None for width in self.widths)

    def __reduce__(self) -> tuple[Any, ...]:
        return Kernel, (self.function, self.model, self.fixed, self.wrt)

    def __repr__(self) -> str:
        count = f"{sum(self.operations.values())} operations" if self._trace else "run as the recursion"
        by = f" by {', '.join(self.wrt)}" if self.wrt else ""
        return f"Kernel {self.function.__name__}{by} of {self.model.name!r}: {count}"

    @property
    def operations(self) -> dict[str, int]:
        """Arithmetic operations a state, by kind; empty where the recursion itself runs."""
        return self._trace.program.operations if self._trace else {}

    @property
    def is_unrolled(self) -> bool:
        """False where the function is too large to be written out, and runs itself."""
        return self._trace is not None

    @property
    def traced(self) -> Trace:
        """The traced program; a TypeError where the recursion itself runs."""
        if self._trace is None:
            raise TypeError(f"{self!r}: too large to be written out")
        return self._trace

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shape of each output, without the batch axes."""
        return self.traced.shapes

    @property
    def judged(self) -> bool:
        """True if pivots of M come with the result."""
        return self.traced.judged

    @cached_property
    def _traced_model(self) -> Model:
        return traced_model(self.function, self.model)

    @cached_property
    def unchecked_inputs(self) -> list[int]:
        """Inputs whose NaN or infinity might not show in the outputs."""
        return self.traced.program.unchecked_inputs

    @cached_property
    def layout(self) -> Layout:
        """Registers of the block kernel."""
        return allocate(self.traced.program)

    @cached_property
    def single(self) -> Callable[..., Array]:
        """The program on lists of floats, one state; ValueError or ArithmeticError says only that it is refused."""
        n = self.model.n
        eps = float(np.finfo(np.float64).eps)
        guard = (DOUBTFUL * n * eps, n) if self.judged else None
        return single_function(self.traced.program, self.widths, self.shapes[0], guard)

    def __call__(self, *arguments: Any, out: Array | None = None, workers: int = 1) -> Array:
        """Run the kernel.

        Parameters
        ----------
        *arguments : array_like, shape (..., n)
            As the function takes them, without the model.
        out : ndarray, optional
            Where to write the result of a batch; must have its shape and dtype and share no memory with the inputs.
        workers : int
            Threads that share the blocks of a large batch.

        Returns
        -------
        ndarray
            As the function returns it.

        Raises
        ------
        ValueError, RneError
            As the function does.
        """
        if out is None and workers == 1:
            try:
                for a, shape in zip(arguments, self._shapes, strict=True):
                    if a.shape != shape or a.dtype.char != "d":
                        break
                else:
                    return self.single(*[a.tolist() for a in arguments])
            except (AttributeError, TypeError, ValueError, ArithmeticError):
                pass  # not one plain state, or something is wrong with it: looked at below
        return self._batch(arguments, out, workers)

    def source(self, language: str = "python") -> str:
        """The kernel as source text of a function of one state; it does not check its arguments, nor M's pivots.

        Parameters
        ----------
        language : {"python", "numpy", "matlab", "c"}
            MATLAB runs in Octave too; "numpy" takes batches.

        Returns
        -------
        str

        Raises
        ------
        ValueError
            For any other language.
        TypeError
            If the kernel is too large to be written out.
        """
        name = "_".join([self.function.__name__, *(["by", *self.wrt] if self.wrt else [])])
        return to_source(Printable(self.traced.program, name, self.names, self.widths, self.shapes[0]), language)

    def by_function(self, arguments: Sequence[Any]) -> Array:
        """The function itself, or its derivatives by complex step."""
        if self.wrt:
            return complex_step(self.function, self.model, self.names, arguments, self.wrt, self.fixed)
        result: Array = self.function(self.model, *arguments, **self.fixed)
        return result

    def _batch(self, arguments: Sequence[Any], out: Array | None, workers: int) -> Array:
        if any(is_traced(a) for a in arguments):  # within a law that is being traced itself
            result = self.function.core(self._traced_model, *arguments, **self.fixed)
            return result[0] if self.judged else result  # type: ignore[no-any-return]
        if len(arguments) != len(self.names):
            raise TypeError(f"this kernel takes {', '.join(self.names)}; got {len(arguments)} arguments")
        if not isinstance(workers, int) or workers < 1:
            raise ValueError(f"`workers` must be a whole number, at least 1, got {workers!r}")
        arrays = [
            joint_shaped(name, a, self.model, width)
            for name, a, width in zip(self.names, arguments, self.widths, strict=True)
        ]
        dtype = np.result_type(*arrays)
        if self._trace is not None and dtype == np.float64 and out is None and all(a.ndim == 1 for a in arrays):
            try:
                return self.single(*[a.tolist() for a in arrays])
            except (TypeError, ValueError, ArithmeticError):
                return self.by_function(arrays)  # which says what is wrong
        if self._trace is not None and dtype.name in DTYPES:
            return run_batch(self, arrays, dtype, out, workers)
        result = self.by_function(arrays)
        if out is None:
            return result
        check_out(out, result.shape, result.dtype, self.names, arrays)[...] = result
        return out
