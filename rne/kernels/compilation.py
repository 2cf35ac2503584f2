"""Functions of a model traced, and differentiated, into kernels."""

from __future__ import annotations

from typing import Any

from ..dynamics.quantity import Declared
from ..model.model import Model
from .kernel import Kernel
from .parameter_inputs import inputs_as_arrays
from .trace import quantity_of


def compile(function: Declared, model: Model, *, engine: str = "numpy", **fixed: Any) -> Kernel:
    """Trace a function of (model, q, ...) on one model and return its kernel.

    Parameters
    ----------
    function : callable
        One of this package's functions of a model and joint arrays, such as `rne.dynamics.inverse_dynamics`.
    model : Model
        The robot's parameters.
    engine : {"numpy", "numba"}
        What runs the kernel. "numba" is machine code, compiled at the first call of one state and at the first batch:
        0.2 to 1 s each for an arm; of thousands of operations each takes some 0.3 ms for one state and 1 to 3 ms for
        batches. The code of a kernel, 1 to 2 MB, stays until the process ends. It needs `pip install 'rne[numba]'`.
    **fixed
        Arguments other than joint arrays, such as `link="link_6"` for `rne.dynamics.jacobian`. Of `external` the names
        of the links, such as `external=["link_6"]`: their wrenches, each (..., 6), follow the joint arrays in order.
        With `parameters=True` the inertial parameters, (..., 10 nb) in the order of `Robot.parameters`, are the last
        argument, in place of the model's; they are not checked to be those of possible bodies.

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
    function : callable
        One of this package's functions of a model and joint arrays, such as `rne.dynamics.inverse_dynamics`.
    model : Model
        The robot's parameters.
    *wrt : str
        Names of arguments, such as "q", "qd"; "external_1" for the wrench on the first link of `external`;
        "parameters" for the inertial parameters, with `parameters=True`.
    engine : {"numpy", "numba"}
        What runs the kernel; see `compile`.
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
    >>> rne.kernels.derivative(rne.dynamics.gravity_torque, rne.irb140(), "q")([0.0] * 6).shape
    (6, 6)
    >>> slopes = rne.kernels.derivative(rne.dynamics.gravity_torque, rne.irb140(), "parameters", parameters=True)
    >>> slopes.names
    ('q', 'parameters')
    """
    function, fixed = inputs_as_arrays(function, model, fixed)
    names = tuple(quantity_of(function).widths)
    for name in wrt:
        if name not in names:
            cure = "; `parameters=True` makes them one" if name == "parameters" else ""
            raise ValueError(f"`wrt` must name arguments of {list(names)}, got {name!r}{cure}")
    if not wrt:
        raise ValueError(f"`wrt` must name at least one argument of {list(names)}")
    return Kernel(function, model, fixed, wrt, engine)
