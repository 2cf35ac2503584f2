"""A control law as a kernel of (t, q, qd): machine code, C, single precision, for a loop on the robot."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..dynamics.quantity import MethodQuantity
from ..kernels.kernel import Kernel
from ..model.model import Model
from ..robot import Robot, robot_argument
from .traced_law import TracedLaw, check_law


class LawOfState:
    """Torques, and the rates of a law's states behind them, as a function of t, q, qd and perhaps z."""

    def __init__(self, law: TracedLaw) -> None:
        self.law = law

    def core(self, model: Model, t: Array, q: Array, qd: Array, z: Array | None = None) -> Array:
        """The function, traced."""
        u, rates = self.law(t, np.concatenate([q, qd] if z is None else [q, qd, z], axis=-1))
        return u if rates is None else np.concatenate([u, rates], axis=-1)


def compiled(law: Any, robot: Robot | None = None, *, engine: str | None = None) -> Kernel:
    """A control law as a kernel of t, q and qd: in a microsecond by machine code, or as source text.

    Parameters
    ----------
    law : callable
        One of this package's laws, or one marked by `rne.traceable`.
    robot : Robot, optional
        The law's own if not given.
    engine : {"numpy", "numba"}, optional
        That of the robot if not given.

    Returns
    -------
    Kernel
        Of t, shape (..., 1), and q and qd, shape (..., n), and of z, shape (..., m), for a law with states. It gives
        torques, and behind them the m rates of the states: shape (..., n + m). `Kernel.into` writes them without
        allocation, `Kernel.source` prints them. Without limits: clip the torques to what your drives bear.

    Raises
    ------
    TypeError
        If the law is not marked as traceable, cannot be traced, is too large, or no robot is known.

    Examples
    --------
    >>> import numpy as np, rne
    >>> arm = rne.load("irb140")
    >>> law = rne.control.compiled(rne.control.pd_gravity(arm, 50, 20, 0))
    >>> law(np.zeros(1), np.full(6, 0.1), np.zeros(6)).round(1)[0].item()
    -5.0
    """
    check_law("law", law)
    known = robot_argument(getattr(law, "robot", None) if robot is None else robot)
    if not getattr(law, "traceable", False):
        raise TypeError("`law` must be marked by rne.traceable")
    traced = TracedLaw(law, known.n)
    reason = traced.why_not_traced(known)
    if reason is not None:
        raise TypeError(f"`law` cannot be traced: {reason}")
    widths: dict[str, int | None] = {"t": 1, "q": known.n, "qd": known.n}
    widths |= {"z": traced.states} if traced.states else {}
    declared = replace(traced.outputs.quantity, name="control_law", core=LawOfState(traced).core, widths=widths)
    kernel = Kernel(MethodQuantity(traced, declared, "the law"), known.model, {}, engine=engine or known.engine)
    _ = kernel.traced  # raises the TypeError of a law that is too large
    return kernel
