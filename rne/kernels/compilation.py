"""Compilation of kernels: of a quantity, its Jacobian, the gradient and Hessian of its weighted sum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..dynamics.quantity import Declared
from ..model.model import Model
from .kernel import Kernel
from .trace import inputs_as_arrays


def compile(function: Declared, model: Model, *, engine: str = "numpy", **fixed: Any) -> Kernel:
    """Trace a function of (model, q, ...) on one model and return its kernel.

    A function of more than 50,000 operations is not written out: its kernel runs the recursion itself.

    Parameters
    ----------
    function : callable
        One of this package's functions of a model and joint arrays, such as `rne.dynamics.inverse_dynamics`.
    model : Model
        The robot's parameters.
    engine : {"numpy", "numba"}
        Engine that runs the kernel. "numba" is machine code, compiled by LLVM at the first call of one state and at the
        first batch, about 0.2 ms per operation, and kept on disk for other processes: in the platform's folder for
        caches, or that of the environment variable RNE_CACHE (empty: nowhere); ``rne cache`` shows it. In memory it
        lives as long as the kernel. It needs the extra `numba`: `pip install 'rne[numba]'`.
    **fixed
        Arguments other than joint arrays, such as `link="link_6"` for `rne.dynamics.jacobian`. Of `external` the names
        of the links, such as `external=["link_6"]`: their wrenches, each (..., 6), follow the joint arrays in order.
        With `parameters=True` the inertial parameters, (..., 10 nb) in the order of `Robot.parameters`, are the last
        argument, instead of the model's; nothing checks that such bodies are possible.

    Returns
    -------
    Kernel
        Called like the function, without the model: `kernel(q, qd, qdd)`, or `kernel(q, qd, qdd, wrench)`, or
        `kernel(q, qd, qdd, parameters)`.

    Raises
    ------
    TypeError
        If the function is not one that can be traced, a fixed argument is missing, or `parameters` are asked of a
        function that does not depend on them.
    ValueError, ImportError
        If there is no such engine, or Numba is not installed.

    Examples
    --------
    >>> import rne
    >>> kernel = rne.compile(rne.dynamics.inverse_dynamics, rne.irb140())
    >>> sum(kernel.operations.values()) <= 320
    True
    """
    return Kernel(function, model, fixed, engine=engine)


def derivative(function: Declared, model: Model, *wrt: str, engine: str = "numpy", **fixed: Any) -> Kernel:
    """Trace a function and differentiate it exactly by some of its joint arrays.

    Parameters
    ----------
    function, model : callable, Model
        As in `compile`.
    *wrt : str
        Names of arguments, such as "q", "qd"; "external_1" for the wrench on the first link of `external`;
        "parameters" for the inertial parameters, with `parameters=True`.
    engine, **fixed : str, Any
        As in `compile`.

    Returns
    -------
    Kernel
        It returns derivatives along a further last axis: with respect to the entries of the first argument, then of
        the second ...

    Raises
    ------
    ValueError
        If a name is not one of the function's joint arrays.

    Examples
    --------
    >>> import rne
    >>> rne.kernels.derivative(rne.dynamics.gravity_torque, rne.irb140(), "q")([0.0] * 6).shape
    (6, 6)
    >>> derivatives = rne.kernels.derivative(rne.dynamics.gravity_torque, rne.irb140(), "parameters", parameters=True)
    >>> derivatives.names
    ('q', 'parameters')
    """
    return _derivative("jacobian", function, model, wrt, engine, fixed)


def gradient(function: Declared, model: Model, *wrt: str, engine: str = "numpy", **fixed: Any) -> Kernel:
    """Trace a function and the gradient of a weighted sum of its entries, by one sweep backwards.

    It takes two to three times the operations of the function, however many arguments there are.

    Parameters
    ----------
    function : callable
        As in `compile`, or your own function of one state, marked by `rne.traceable`. Its arguments are some of q, qd,
        qdd, qdr, qddr and tau, and it may call methods of a Robot and functions of `rne.elementwise`.
    model : Model
        The robot's parameters.
    *wrt : str
        Names of arguments as in `derivative`; by default all of them.
    engine, **fixed : str, Any
        As in `compile`.

    Returns
    -------
    Kernel
        `kernel(q, qd, ..., weights)`, with weights of shape (..., entries of the function's result in C order), which
        may be left out if there is one entry. The result has shape (..., k), d(weights . function)/d wrt.

    Raises
    ------
    ValueError
        If a name is not one of the function's arguments.

    Examples
    --------
    >>> import rne
    >>> kernel = rne.kernels.gradient(rne.dynamics.inverse_dynamics, rne.irb140())
    >>> kernel.names, kernel([0.1] * 6, [0.0] * 6, [0.0] * 6, [1.0] * 6).shape
    (('q', 'qd', 'qdd', 'weights'), (18,))
    """
    return _derivative("gradient", function, model, wrt, engine, fixed)


def hessian(function: Declared, model: Model, *wrt: str, engine: str = "numpy", **fixed: Any) -> Kernel:
    """Trace a function and the Hessian of a weighted sum of its entries: forwards through the gradient's sweep.

    Where k is large, `hessian_product` takes far fewer operations.

    Parameters
    ----------
    function, model, *wrt, engine, **fixed : callable, Model, str, str, Any
        As in `gradient`.

    Returns
    -------
    Kernel
        As returned by `gradient`; the result has shape (..., k, k) and is exactly symmetric.

    Raises
    ------
    TypeError
        If it takes more than 50,000 operations.

    Examples
    --------
    >>> import rne
    >>> kernel = rne.kernels.hessian(rne.dynamics.potential_energy, rne.irb140())
    >>> kernel([0.1] * 6).shape
    (6, 6)
    """
    return _derivative("hessian", function, model, wrt, engine, fixed)


def hessian_product(function: Declared, model: Model, *wrt: str, engine: str = "numpy", **fixed: Any) -> Kernel:
    """Trace the Hessian of a weighted sum of a function's entries times a vector, about five times the function's work.

    Parameters
    ----------
    function, model, *wrt, engine, **fixed : callable, Model, str, str, Any
        As in `gradient`.

    Returns
    -------
    Kernel
        `kernel(q, qd, ..., weights, vector)`, with a vector of shape (..., k); the result has shape (..., k).

    Examples
    --------
    >>> import rne
    >>> kernel = rne.kernels.hessian_product(rne.dynamics.kinetic_energy, rne.irb140(), "qd")
    >>> kernel([0.0] * 6, [0.0] * 6, [1.0], [0, 0, 0, 0, 0, 1.0]).round(3).tolist()  # the last column of M
    [0.0, 0.0, 0.0, 0.001, 0.0, 0.001]
    """
    return _derivative("hessian_product", function, model, wrt, engine, fixed)


def _derivative(
    order: str, function: Declared, model: Model, wrt: Sequence[str], engine: str, fixed: Mapping[str, Any]
) -> Kernel:
    """Kernel of a derivative, by known arguments; by all if none is named and they may be left out."""
    names = tuple(inputs_as_arrays(function, model, fixed)[0].widths)
    for name in wrt:
        if name not in names:
            cure = "; `parameters=True` makes them one" if name == "parameters" else ""
            raise ValueError(f"`wrt` must name arguments of {list(names)}, got {name!r}{cure}")
    if not wrt and order == "jacobian":
        raise ValueError(f"`wrt` must name at least one argument of {list(names)}")
    return Kernel(function, model, fixed, wrt or names, engine, order)
