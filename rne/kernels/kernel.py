"""Traced function: called like the function itself, with its checks, but run as straight-line arithmetic."""

from __future__ import annotations

import importlib.util
import itertools
import logging
import re
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from math import prod
from types import FunctionType, MethodType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import copy_with, is_read_only, read_only, real_numbers, whole_number
from ..basics.piecewise import NO_TABLE, rows_at
from ..basics.spatial import Array
from ..basics.text import short, wrapped
from ..dynamics.quantity import (
    OK,
    BatchIndex,
    Declared,
    PrecisionStatus,
    check_result,
    common_dtype,
    common_leading_shape,
)
from ..errors import NotFiniteError
from ..graph.differentiation import ORDERS, accumulated
from ..graph.graph import TooLarge
from ..graph.program import evaluate
from ..graph.scalar import inputs, is_traced, outline_of, references
from ..model.model import Model, joint_array, model_argument
from . import array_layout
from .numpy_backend import BlockProgram, check_array, check_out
from .python_backend import state_function
from .soundness import NeedsRecursion, Recursion, Trace
from .source import Printable, checked_name, entry_of_element, heading, identifier, to_source
from .trace import (
    LIMIT,
    argument_widths,
    by_recursion,
    check_own,
    declared,
    inputs_as_arrays,
    named_by_function,
    run_core,
    takes_complex_steps,
    trace,
    within_a_trace,
)

LOGGER = logging.getLogger("rne")
ENGINES = ("numpy", "numba")
Run = Callable[[Sequence[Array], Array, Recursion], PrecisionStatus]  # (states, results, recursion)
ALONE = 1  # number of threads
NUMBERS = 2**24  # most derivatives stored at once, of functions too large to be written out
FLOAT64, FLOAT32 = np.dtype("float64"), np.dtype("float32")


def engine_argument(engine: str) -> str:
    """Engine to run, checked: its packages are installed, and it can read arrays."""
    if engine not in ENGINES:
        raise ValueError(f"`engine` must be one of {list(ENGINES)}, got {engine!r}")
    if engine == "numba" and importlib.util.find_spec("numba") is None:
        raise ImportError("engine 'numba' needs Numba, which is not installed: pip install 'rne[numba]'")
    if engine == "numba" and not array_layout.is_known():
        LOGGER.warning("engine 'numpy' runs instead of 'numba': this Python or NumPy has arrays of another layout")
        return "numpy"
    return engine


def backends(engine: str) -> tuple[Callable[[Trace], Callable[..., Array]], Callable[[Trace], Any]]:
    """Functions of an engine that compile a trace for one state, and a program for batches."""
    if engine == "numba":
        from . import llvm_backend  # LLVM is imported when its first kernel is compiled

        return llvm_backend.state_function, llvm_backend.BatchProgram
    return state_function, BlockProgram


class _LookedUp:
    """Method replaced by machine code at its first look-up, so that loops that store it before a call have it."""

    def __init__(self, method: Callable[..., Array]) -> None:
        self.method = method

    def __get__(self, kernel: Kernel | None, owner: type) -> Callable[..., Array]:
        if kernel is None:
            return self.method
        if not kernel.is_unrolled or kernel.engine != "numba" or kernel.traced.of_run is not None:
            return MethodType(self.method, kernel)
        from .llvm_backend import into

        kernel.__dict__["into"] = made = into(kernel)  # is found before the method
        return made


class Kernel:
    """Function compiled for one model; see `compile`.

    A kernel may be called from many threads, and pickles. Its results may differ from the function's in the last bits.

    Attributes
    ----------
    model : Model
    names : tuple of str
        The arrays it takes, in order; wrenches are external_1, external_2, ..., inertial parameters `parameters`.
    wrt : tuple of str
        The arguments of the derivatives; empty for the function itself.
    order : {"values", "jacobian", "gradient", "hessian", "hessian_product"}
        What it gives of the function.
    engine : {"numpy", "numba"}
        Engine that runs it.

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
        order: str = "jacobian",
    ) -> None:
        self.function, self.fixed = declared(function), read_only(dict(fixed))
        self.quantity, self._rest = inputs_as_arrays(function, model, fixed)
        self.model = model_argument(model)
        self.wrt, self.order = tuple(wrt), order if wrt else "values"
        self.engine = engine_argument(engine)
        widths = argument_widths(self.quantity, model)
        self.names = *widths, *ORDERS[self.order].inputs
        try:
            with np.errstate(all="ignore"):
                self._trace: Trace | None = trace(self.quantity, model, self._rest, self.wrt, order=self.order)
        except TooLarge as error:
            if self.order.startswith("hessian"):
                raise TypeError(f"the {self._title} takes {error}; at most {LIMIT} are written out") from None
            self._trace = None
        if self.function is not function and self._trace is not None:
            check_own(self.function, self.model)
        self.widths = self._widths(widths)
        self._libraries: dict[tuple[int, bool], Any] = {}  # of `address`, by its arguments
        self._coefficients: tuple[Any, Array] = None, NO_TABLE  # of the last run: its numbers, and theirs
        self.table = NO_TABLE  # of the pieces of a motion through samples, where `piece` is an argument

    def __reduce__(self) -> tuple[Any, ...]:
        made = self.function, self.model, self.fixed, self.wrt, self.engine, self.order
        return (Kernel, made, {"table": self.table}) if len(self.table) else (Kernel, made)

    def piece(self, t: ArrayLike) -> Array:
        """Argument `piece` at times, for `into` and functions in C.

        Parameters
        ----------
        t : array_like, shape (..., 1)
            Times [s].

        Returns
        -------
        ndarray, shape (..., width)
            Begin, end and coefficients of the pieces.

        Raises
        ------
        ValueError
            If a time is outside the samples, not finite, or of the wrong shape.
        TypeError
            If the kernel has no such argument, or no samples.

        Examples
        --------
        >>> import rne
        >>> arm = rne.load("irb140")
        >>> steps = rne.trajectories.sampled([0.0, 1.0], [[0.0] * 6, [1.0] * 6])
        >>> law = rne.control.compiled(rne.control.pd_gravity(arm, 50, 20, steps))
        >>> law.piece([0.5])[:2].tolist()  # its begin and end [s]
        [0.0, 1.0]
        """
        if not len(self.table):
            raise TypeError(f"{self!r} has no samples of a motion")
        return rows_at(self.table, real_numbers("t", t, "(..., 1)")[..., 0])

    def __deepcopy__(self, _: Any) -> Kernel:
        return self  # which never changes

    @property
    def _title(self) -> str:
        by = f" by {', '.join(self.wrt)}" if self.wrt else ""
        return f"{ORDERS[self.order].title}{self.quantity.name}{by}"

    def _widths(self, widths: Mapping[str, int]) -> tuple[int, ...]:
        """Widths of the arguments, including the weights."""
        if self._trace is not None:
            return *widths.values(), *self._trace.widths[len(widths) :]
        if self.order != "gradient":
            return tuple(widths.values())
        zeros = [np.zeros((1, width)) for width in widths.values()]
        with np.errstate(all="ignore"):
            found = run_core(self.quantity, self.model, zeros, self._rest)[0]
        return *widths.values(), prod(np.shape(found)[1:])

    def __repr__(self) -> str:
        count = f"{sum(self.operations.values())} operations" if self._trace else "run as the recursion"
        links = ", ".join(f"'{short(link)}'" for link in self.quantity.wrenches.values())
        under = f" under wrenches on {links}" if links else ""
        at = " at parameters given" if "parameters" in self.names else ""
        engine = ", by Numba" if self.engine == "numba" and self.is_unrolled else ""
        forms = ("state_function", "state_function_unguarded", "blocks")
        seconds = sum(getattr(self.__dict__.get(form), "seconds", 0.0) for form in forms)
        engine += f", compiled in {seconds:.2g} s" if seconds else ""
        return wrapped(f"Kernel {self._title} of '{short(self.model.name)}'{under}{at}: {count}{engine}")

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
        """Traced program; raises TypeError if the recursion itself runs."""
        if self._trace is None:
            raise TypeError(f"{self!r}: too large to be written out")
        return self._trace

    @property
    def whole(self) -> Trace:
        """Traced program with the arguments of calls, including what is computed of a run's numbers."""
        if self.traced.of_run is None:
            return self.traced
        quantity = replace(self.quantity, of_run=None)
        return trace(quantity, self.model, self._rest, self.wrt, order=self.order)

    @property
    def printable(self) -> Trace:
        """Whole program, for callers that do not check its results; a TypeError if a constant is not finite."""
        if not self.traced.program.is_finite:
            raise TypeError(f"{self!r}: not written out, since it has a constant that is not finite")
        return self.whole

    def coefficients(self, numbers: Array) -> Array:
        """Inputs of the program, (..., k), computed from the argument constant over a run, (..., p), or that itself."""
        of_numbers = self._trace.of_numbers if self._trace else None
        if of_numbers is None:
            return numbers
        given, known = self._coefficients
        if given is numbers:
            return known.copy()
        rows, count = numbers.reshape(prod(numbers.shape[:-1]), of_numbers.inputs), len(of_numbers.outputs)
        found = evaluate(of_numbers, count, rows).reshape(*numbers.shape[:-1], count)
        if numbers.ndim == 1 and is_read_only(numbers):
            self._coefficients = numbers, found.copy()
        return found

    def _ready(self, arrays: Sequence[Array]) -> list[Array]:
        """Arguments in the form that the program takes."""
        given = [*arrays]
        if self._trace is not None and self._trace.of_run is not None:
            given[self._trace.of_run] = self.coefficients(given[self._trace.of_run])
        return given

    @cached_property
    def fast_call(self) -> Callable[..., Array | None]:
        """Fast path to a result, as a call of `state_function`; None for other arguments than plain float64 arrays."""
        if self._trace is not None and self._trace.of_run is not None:
            return lambda *_: None
        if self.is_unrolled and self.engine == "numba":
            from .llvm_backend import fast_call

            return fast_call(self)
        return _fast_call(self) if self.is_unrolled else lambda *_: None

    @cached_property
    def state_function(self) -> Callable[..., Array]:
        """Program on one float64 vector per argument; raises NeedsRecursion where the recursion must compute it."""
        return backends(self.engine)[0](self.traced)

    @cached_property
    def state_function_unguarded(self) -> Callable[..., Array]:
        """`state_function` without the check of joint velocities, which simulations make at their samples."""
        if self.engine == "numpy":  # the numbers of a run are arguments one by one
            return state_function(self.traced.unguarded(), apart=True)
        return backends(self.engine)[0](self.traced.unguarded())

    def state_function_at(self, numbers: Array) -> Callable[..., Array]:
        """Unguarded state function under the numbers of a run, its last argument: as defaults they cost no call."""
        function, coefficients = self.state_function_unguarded, self.coefficients(numbers)
        defaults = tuple(coefficients.tolist()) if self.engine == "numpy" else (coefficients,)
        return FunctionType(function.__code__, function.__globals__, function.__name__, defaults)

    @cached_property
    def blocks(self) -> Any:
        """Program on batches."""
        return backends(self.engine)[1](self.traced)

    def address(self, lanes: int = 1, *, common: bool = True) -> int:
        """Address of the program in machine code, for loops that are compiled.

        Parameters
        ----------
        lanes : int
            Number of states that a call computes, 1 or ``rne.integrators.loops.LANES``.
        common : bool
            False if numbers of a run, such as those of a scene, differ from state to state; they are given as
            `coefficients` of the numbers, of shape (k,) where they are common.

        Returns
        -------
        int
            Address of int64 f(const double* a0, const double* a1, ..., double* out), valid as long as the kernel lives.
            It returns 1 if the result is sound, 0 if a state must be examined by a call of the kernel. Argument k has
            shape (width, lanes) in C order, `out` (entries, lanes).

        Raises
        ------
        TypeError
            If the kernel is too large to be written out.

        Examples
        --------
        >>> import rne
        >>> rne.compile(rne.dynamics.gravity_torque, rne.irb140()).address() > 0  # doctest: +SKIP
        True
        """
        form = lanes, common or lanes == 1 or self.traced.of_run is None
        if form not in self._libraries:
            from .llvm_backend import lanes_library

            known: Any = self.state_function if lanes == 1 and self.engine == "numba" else None
            self._libraries[form] = known.library if known else lanes_library(self.traced, lanes, common=form[1])
        return int(self._libraries[form].address["function"])

    def __call__(self, *arguments: Any, out: Array | None = None, workers: int = ALONE) -> Array:
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
            Result of the function.

        Raises
        ------
        ValueError, RneError
            Errors of the function.

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

    @_LookedUp
    def into(self, *arrays: Array, out: Array | None = None) -> Array:
        """Write the result into an array; with engine "numba" nothing is allocated.

        Looking `kernel.into` up compiles it: it is machine code that Python calls directly, in a name of yours as well.
        States whose results may not be sound are computed by the function, with its errors and warnings.

        Parameters
        ----------
        *arrays : ndarray
            The arrays that the function takes, in order, of shape (..., n) with the same leading axes, float64 in C
            order; then `out`, if it is not given by name.
        out : ndarray
            Of the result's shape, float64 in C order, without common memory.

        Returns
        -------
        ndarray
            `out`. After an error its content is undefined.

        Raises
        ------
        TypeError, ValueError
            If an array is missing, or is not as above: none is copied.

        Examples
        --------
        >>> import numpy as np, rne
        >>> kernel = rne.compile(rne.dynamics.gravity_torque, rne.irb140())
        >>> q, out = np.zeros(6), np.empty(6)
        >>> kernel.into(q, out) is out
        True
        """
        return self.checked_into(*arrays, out=out)

    def checked_into(self, *arrays: Array, out: Array | None = None) -> Array:
        """Checked `into` in Python, of one state or many; warns the caller's caller."""
        arrays = arrays if out is None else (*arrays, out)
        if len(arrays) != len(self.names) + 1:
            raise TypeError(f"`into` of this kernel takes {', '.join(self.names)}, out; got {len(arrays)} arrays")
        given, out, leading = arrays[:-1], arrays[-1], getattr(arrays[0], "shape", ())[:-1]
        for name, array, width in zip(self.names, given, self.widths, strict=True):
            check_array(name, array, (*leading, width), FLOAT64)
        result, status = self.evaluate(*given, out=out if leading else None)
        if status is not OK:
            status.raise_or_warn(stacklevel=3)
        if not leading or out is None:
            check_out(out, np.shape(result), FLOAT64, self.names, given)[...] = result
        return out

    def evaluate(
        self, *arguments: Any, out: Array | None = None, workers: int = ALONE
    ) -> tuple[Array, PrecisionStatus]:
        """Result and its PrecisionStatus, not yet announced; see `__call__` for the arguments."""
        if len(self.table) and len(arguments) == len(self.names) - 1:
            k = self.names.index("piece")
            arguments = *arguments[:k], self.piece(arguments[0]), *arguments[k:]
        if out is None and workers is ALONE and len(arguments) == len(self.names):
            try:
                result = self.fast_call(*arguments)
            except NeedsRecursion:
                return self.by_recursion(*arguments)
            if result is not None:
                return result, OK
        if self.order in ("gradient", "hessian") and len(arguments) == len(self.names) - 1 and self.widths[-1] == 1:
            arguments = *arguments, np.ones(1, dtype=np.float32)  # a single entry needs no weight
        if any(is_traced(a) for a in arguments):  # within a law that is being traced itself
            return self._within_a_trace(arguments), OK
        whole_number("workers", workers)
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
            joint_array(name, a, self.model, width, may_be_infinite=True)
            for name, a, width in zip(self.names, arguments, self.widths, strict=True)
        ]
        dtype = common_dtype(arrays)
        if self._trace is not None and dtype in (FLOAT64, FLOAT32):
            if out is None and dtype == FLOAT64 and all(a.ndim == 1 for a in arrays):
                try:
                    return self.state_function(*(a.astype(FLOAT64, copy=False) for a in self._ready(arrays))), OK
                except NeedsRecursion:
                    return self.by_recursion(*arrays)
            return self._batch(arrays, dtype, out, workers)
        result, status = self.by_recursion(*arrays)
        if out is None or status.error is not None:
            return result, status
        check_out(out, result.shape, result.dtype, self.names, arrays)[...] = result
        return out, status

    def _within_a_trace(self, arguments: Sequence[Any]) -> Array:
        """Result on traced numbers: of the function itself, or by the operations of its derivatives."""
        outline = outline_of(arguments)
        if outline is not None and self._trace is not None and hasattr(self.function, "core"):  # not a user's own
            arrays = [np.asarray(a) for a in arguments]
            leading = np.broadcast_shapes(*(a.shape[:-1] for a in arrays))
            given = tuple((a.shape, *references(outline, a)) for a in arrays)
            of = self.function, self.model, self.wrt, self.order, *self.fixed.items(), given
            return inputs(outline, leading + self._trace.shape, 0, *of)[()]
        if not self.wrt:
            return within_a_trace(self.quantity, self.model, arguments, self._rest)
        return self._by_program([np.asarray(a, dtype=object) for a in arguments])

    def _by_program(self, arrays: Sequence[Array]) -> Array:
        """Traced operations on arrays of any type of number."""
        leading, inputs = _rows(self._ready(arrays))
        found = evaluate(self.traced.program, self.traced.entries, inputs).reshape(leading + self.traced.shape)
        return found[()]

    @cached_property
    def _values(self) -> Trace:
        """Operations of the function itself, where those of its derivatives are too many to be written out."""
        try:
            with np.errstate(all="ignore"):
                return trace(replace(self.quantity, of_run=None), self.model, self._rest, is_large=True)
        except TooLarge as error:
            raise TypeError(f"{self.quantity.name} takes {error}: too large to be differentiated") from None

    def _accumulated(self, arrays: Sequence[Array]) -> Array:
        """Jacobian of all entries, (..., entries, k), accumulated operation by operation."""
        (leading, inputs), starts = _rows(arrays), np.cumsum([0, *self.widths])  # never of numbers of a run
        places = [(starts[k], self.widths[k]) for k in map(self.names.index, self.wrt)]
        by = [start + j for start, width in places for j in range(width)]
        wide, (program, entries) = np.result_type(inputs, FLOAT64), (self._values.program, self._values.entries)
        few = max(1, NUMBERS // (1 + len(program.instructions) * len(by)))  # states
        parts = [inputs[k : k + few].astype(wide) for k in range(0, max(1, len(inputs)), few)]
        found = np.concatenate([accumulated(program, entries, part, by) for part in parts])
        return found.astype(inputs.dtype).reshape(*leading, entries, len(by))

    def source(
        self,
        language: str = "python",
        element: str | None = None,
        dtype: str = "float64",
        *,
        name: str | None = None,
        namespace: str | None = None,
    ) -> str:
        """Source text of the kernel as a function of one state, which does not check its arguments.

        In C and C++ it says where M is singular, as the comment above the function describes; in other languages it
        does not check M's pivots.

        Parameters
        ----------
        language : {"python", "numpy", "matlab", "c", "c++", "rust"}
            MATLAB runs in Octave too; "numpy" takes batches. Rust is of edition 2021, needs only `core`, and calls
            sin, cos, ... of libm. C++ is a header of C++17, with arrays of the standard library.
        element : str, optional
            Only one entry, as in the thesis's appendix C, with the operations that it needs: "m23" of M, "c3" of
            C q', "g2" of g, "tau4" of inverse dynamics, "h1" of bias torques, "qdd5" of forward dynamics. Joints are
            counted from 1; beyond nine, "m2_13".
        dtype : {"float64", "float32"}
            Of arguments, constants and results; "float32" in C, C++ and Rust.
        name : str, optional
            Name of the function; by default the quantity's or the entry's.
        namespace : str, optional
            Namespace in C++, by default `robot`; of two robots it keeps the functions apart.

        Returns
        -------
        str
            With the robot, the order of its joints, the units and the operations in a comment at the head, in C and
            Rust with the memory that the numbers take. Where `piece` of a motion through samples is an argument, C has
            a second function, with the samples: `<name>_piece(t)` gives it.

        Raises
        ------
        ValueError
            For any other language or dtype, an entry that the quantity does not have, a constant that float32 cannot
            hold, or a `name` or `namespace` that the language does not take.
        TypeError
            If the kernel is too large to be written out.

        Examples
        --------
        >>> import rne
        >>> rne.compile(rne.dynamics.gravity_torque, rne.irb140()).source("matlab", "g4").splitlines()[:2]
        ['function result = g4(q)', '% Entry 4 of gravity_torque of robot irb140']
        """
        printed = self.printed(element)
        if name is not None:
            printed = printed._replace(name=checked_name("name", name, self.names))
        if namespace is not None and language != "c++":
            raise ValueError(f"`namespace` is for language 'c++', got language {language!r}")
        if language == "c++":
            own = "robot" if namespace is None else checked_name("namespace", namespace)
            printed = printed._replace(namespace=own, looks_up=len(self.table) > 0)
        return to_source(printed, language, dtype)

    def printed(self, element: str | None = None) -> Printable:
        """Printable form of the kernel, or of one entry of its result, with the name and the comment of its text."""
        name = re.sub("[ ,]+", "_", self._title)
        traced, title, entry = self.printable, name, None
        if element is not None:
            entry = entry_of_element(element, name, traced.shape)
            traced, title = trace(self.quantity, self.model, self._rest, self.wrt, entry, self.order), element
        lines = heading(self.model, name, self.names, entry, self.quantity.wrenches)
        return Printable(traced, title, self.names, lines, self.table)

    def to_sympy(self) -> Any:
        """Return the kernel as SymPy expressions; needs the extra `sympy`.

        Symbols are q_1, qd_1, ...; the inertial parameters of body 1, where they are an argument, are m_1, mx_1, ...,
        Ixx_1, Ixy_1, Iyy_1, Ixz_1, Iyz_1, Izz_1; a wrench external_1 has nx_1, ..., fx_1, .... Constants that are
        decimal numbers of at most 12 digits, up to rounding, are rational numbers.

        Returns
        -------
        sympy.Expr, sympy.Matrix or sympy.ImmutableDenseNDimArray
            Of the shape of the result; a vector is a column.

        Raises
        ------
        ImportError
            If SymPy is not installed.
        TypeError
            If the kernel is too large to be written out.

        Examples
        --------
        >>> import rne
        >>> rne.compile(rne.dynamics.gravity_torque, rne.irb140()).to_sympy()[3]
        28449*(-sin(q_2)*sin(q_3) + cos(q_2)*cos(q_3))*sin(q_4)*sin(q_5)/100000
        """
        from .exports.sympy import to_sympy

        return to_sympy(self)

    def to_casadi(self, name: str | None = None, symbolic: str = "SX") -> Any:
        """Return the kernel as a CasADi function of one state, which CasADi can differentiate, print as C and save.

        Parameters
        ----------
        name : str, optional
            Name of the function; by default the quantity's.
        symbolic : {"SX", "MX"}
            Scalar operations, or one call of a function of such, which stays small where it is called often.

        Returns
        -------
        casadi.Function
            Its arguments have the kernel's names, weights always among them; its `result` has the shape for one state.
            Of more than two axes, all but the last are merged, row by row: poses of links are stacked. Zeros of
            Jacobians and Hessians are structural. It checks nothing, neither NaN nor a singular M.

        Raises
        ------
        ImportError, TypeError, ValueError
            If CasADi is missing, the kernel too large to be written out, or CasADi allows no such name or type.

        Examples
        --------
        >>> import rne
        >>> rne.compile(rne.dynamics.mass_matrix, rne.irb140()).to_casadi()  # doctest: +SKIP
        Function(mass_matrix:(q[6])->(result[6x6]) SXFunction)
        """
        from .exports.casadi import to_casadi

        own = re.sub(r"[\W_]+", "_", identifier(re.sub("[ ,]+", "_", self._title)))
        return to_casadi(self, own.strip("_") if name is None else name, symbolic)

    def to_jax(self, mode: str = "reverse") -> Callable[..., Any]:
        """Return the kernel as a function of JAX, for jit, vmap and derivatives of first and second order.

        With engine "numba", XLA calls machine code on a CPU, and derivatives are separate kernels, compiled when they
        are first needed. With "numpy", and on other devices, it is the program in jax.numpy: every transformation
        works in both modes, but compilation takes seconds, and for derivatives a minute where a kernel is called
        several times, as by a Runge-Kutta step; within an inner `jax.lax.scan` it is compiled once.

        ==============  =====================  =======  =================================  ======================
        machine code    grad, vjp, jacrev      jvp,     second order                       the same of a lax.scan
                                               jacfwd
        ==============  =====================  =======  =================================  ======================
        mode="reverse"  by the gradient        no       grad of grad, jacrev of grad       the same
        mode="forward"  by the Jacobian        yes      hessian and any mix                of jacfwd only
        ==============  =====================  =======  =================================  ======================

        Other combinations raise an error of JAX about "forward-mode autodiff", "custom_lin" or the "FFI call".

        Parameters
        ----------
        mode : {"reverse", "forward"}
            "reverse" is the faster one for gradients of a loss, "forward" for Jacobians.

        Returns
        -------
        callable
            Of arrays (..., width) in the order of `names`, as a call of the kernel, in their dtype: float32, or float64
            with JAX's option jax_enable_x64. States that the kernel would refuse or examine are NaN: where few digits
            remain because M is nearly singular, and in forward dynamics where the root sum of squares of the joint
            velocities exceeds eps^(-1/4), 54 in float32 and 8192 in float64. In float32 both occur far sooner.

        Raises
        ------
        TypeError, ValueError, ImportError
            If the kernel is too large to be written out, there is no such mode, or JAX is not installed.

        Examples
        --------
        >>> import rne
        >>> torques = rne.compile(rne.dynamics.gravity_torque, rne.irb140()).to_jax()  # doctest: +SKIP
        """
        from .exports.jax import to_jax

        return to_jax(self, mode)

    def to_torch(self) -> Callable[..., Any]:
        """Return the kernel as a function of PyTorch, with derivatives of first and second order by further kernels.

        Returns
        -------
        callable
            Of tensors (..., width) on the CPU, in the order of `names`. The kernel reads and writes the memory of
            float64 and float32, without copies if they are contiguous; float16 and bfloat16 are computed in float32 and
            returned in the given type. It raises the errors of a call, and a TypeError for complex tensors.

        Raises
        ------
        TypeError, ImportError
            If the kernel is too large to be written out, or PyTorch is not installed.

        Examples
        --------
        >>> import rne
        >>> torques = rne.compile(rne.dynamics.gravity_torque, rne.irb140()).to_torch()  # doctest: +SKIP
        """
        from .exports.torch import to_torch

        return to_torch(self)

    def by_recursion(self, *arguments: Any) -> tuple[Array, PrecisionStatus]:
        """Result and status of states by the function itself, or by its complex steps.

        Of gradients, Hessians and functions without complex steps, the function gives the status, and the traced
        operations the result in the dtype of the arguments.
        """
        count = len(self.quantity.widths)
        given, further = arguments[:count], arguments[count:]
        has_steps = takes_complex_steps(self.function, self.model) and (self._trace is None or not further)
        wrt = self.wrt if has_steps else ()
        result, status = by_recursion(self.function, self.model, given, wrt, self.fixed)
        if status.error is not None or (wrt == self.wrt and not further):
            return result, status
        named = zip(self.names, arguments, self.widths, strict=True)
        arrays = [joint_array(name, a, self.model, width) for name, a, width in named]
        leading = np.broadcast_shapes(*(a.shape[:-1] for a in arrays[:count]))
        if self._trace is not None:
            result = self._by_program(arrays)
        elif not wrt:
            result = self._accumulated(arrays[:count]).reshape(*np.shape(result), -1)
        if self._trace is None and further:
            slopes = result.reshape(*leading, self.widths[-1], result.shape[-1])
            result = (arrays[-1][..., None, :] @ slopes)[..., 0, :]
        check_result(self._title, result, leading)
        if status.loss is not None:
            digits = max(0.0, status.loss.digits - ORDERS[self.order].digits)
            status = PrecisionStatus(loss=status.loss._replace(digits=digits, what=f"the {self._title} keeps"))
        return result, status

    def _batch(
        self, arrays: Sequence[Array], dtype: np.dtype[Any], out: Array | None, workers: int
    ) -> tuple[Array, PrecisionStatus]:
        leading = common_leading_shape(dict(zip(self.names, arrays, strict=True)))
        shape = leading + self.traced.shape
        out = np.empty(shape, dtype=dtype) if out is None else check_out(out, shape, dtype, self.names, arrays)
        count = prod(leading)
        states = [
            (a if a.shape[:-1] == leading else np.broadcast_to(a, (*leading, width))).reshape(count, width)
            for a, width in zip(arrays, self.widths, strict=True)
        ]
        common = [a.astype(dtype, copy=False) if a.ndim == 1 else s for a, s in zip(arrays, states, strict=True)]
        ready = self._ready(common)

        def by_function(begin: int, end: int) -> tuple[Array, PrecisionStatus]:
            for name, array, width in zip(self.names, arrays, self.widths, strict=True):
                joint_array(name, array, self.model, width)  # the error for NaN has its index

            def place(state: BatchIndex) -> BatchIndex:
                k = begin + (state[0] if state else 0)
                return tuple(int(i) for i in np.unravel_index(k, leading))

            try:
                result, status = self.by_recursion(*[array[begin:end].astype(dtype) for array in states])
            except NotFiniteError as error:
                raise NotFiniteError(error.args[0], error.time, place(error.state)) from None

            return np.asarray(result).reshape(end - begin, -1), status.with_state(place)

        rows = out.reshape(count, prod(self.traced.shape))
        status = _run_in_threads(self.blocks.run, ready, rows, by_function, workers)
        return (out if shape else out[()]), status  # a number of NumPy, as from the recursion


def with_table(kernel: Kernel, table: Array) -> Kernel:
    """Copy of a kernel whose calls find `piece`, the row of a table, (N, width), that holds at their times."""
    return copy_with(kernel, table=table) if len(table) else kernel


def _rows(arrays: Sequence[Array]) -> tuple[tuple[int, ...], Array]:
    """Leading shape of arrays (..., width), and their states as rows of all widths."""
    leading, dtype = np.broadcast_shapes(*(a.shape[:-1] for a in arrays)), common_dtype(arrays)
    states = [np.broadcast_to(a, (*leading, a.shape[-1])).astype(dtype, copy=False) for a in arrays]
    return leading, np.concatenate(states, axis=-1).reshape(prod(leading), -1)


def _fast_call(kernel: Kernel) -> Callable[..., Array | None]:
    """`Kernel.fast_call` by NumPy's engine, for one state, without a loop, which would cost as much as the kernel."""

    def first(*arrays: Array) -> Array:
        namespace["state"] = kernel.state_function
        return kernel.state_function(*arrays)

    namespace: dict[str, Any] = {f"s{k}": (width,) for k, width in enumerate(kernel.widths)}
    namespace |= {"ndarray": np.ndarray, "float64": FLOAT64, "state": first}
    arguments = ", ".join(f"a{k}" for k in range(len(kernel.widths)))
    check = "type(a{0}) is ndarray and a{0}.dtype is float64 and a{0}.shape == s{0}"
    checks = " and ".join(check.format(k) for k in range(len(kernel.widths)))
    exec(f"def call({arguments}):\n    if {checks}:\n        return state({arguments})\n", namespace)
    call: Callable[..., Array | None] = namespace.pop("call")
    return call


def _run_in_threads(
    run: Run, states: Sequence[Array], results: Array, recursion: Recursion, workers: int
) -> PrecisionStatus:
    """Fill `results` as `run` does, in threads that take a range of the states each."""
    count = len(results)
    workers = min(workers, count)
    if workers <= 1:
        return run(states, results, recursion)

    def run_part(first: int, last: int) -> PrecisionStatus:
        arrays = [a[first:last] if a.ndim > 1 else a for a in states]  # vectors are common to all states
        return run(arrays, results[first:last], lambda i, j: recursion(first + i, first + j))

    own, *others = itertools.pairwise(count * k // workers for k in range(workers + 1))
    with ThreadPoolExecutor(workers - 1) as pool:
        futures = [pool.submit(run_part, *stretch) for stretch in others]
        status = run_part(*own)
        for future in futures:
            if status.error is None:  # the error of the first state is reported
                status = status.worse(future.result())
    return status
