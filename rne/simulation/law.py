"""A traceable control law, evaluated with numbers or traced, in one state or in many."""

from __future__ import annotations

import inspect
from functools import cached_property
from typing import Any

import numpy as np

from ..basics.spatial import Array

AGREEMENT = 1e-9  # relative: torques that differ by less are the same


def check_law(name: str, law: Any) -> None:
    """Raise a TypeError if a law cannot be called with its arguments."""
    expected = "(t, q, qd, z), as it has `states`" if hasattr(law, "states") else "(t, q, qd)"
    if not callable(law):
        raise TypeError(f"`{name}` must be a function of {expected}, got {type(law).__name__}")
    try:
        signature = inspect.signature(law)
    except (TypeError, ValueError):  # of compiled functions, which show none
        return
    try:
        signature.bind(*range(4 if hasattr(law, "states") else 3))
    except TypeError:
        raise TypeError(f"`{name}` must be a function of {expected}, got one of {signature}") from None


class TracedLaw:
    """The torques of a law, and the rates of its states, for states x = (q, qd, z) of shape (..., size).

    The law is called with one state, as (t, q, qd): laws are written so. Numbers of many states are handed over at once
    if the law takes them so.

    Parameters
    ----------
    law : callable
    n : int
        Number of coordinates.
    """

    def __init__(self, law: Any, n: int) -> None:
        self.law, self.n = law, n
        self.states = int(getattr(law, "states", 0))

    def __call__(self, t: Any, x: Array) -> tuple[Array, Array | None]:
        """(torques, dz/dt); times have shape (..., 1)."""
        if x.ndim == 1:
            return self._called(np.asarray(t).item(), x)
        if x.dtype != object and self._takes_batches:
            return self._called(t, x)
        times = np.broadcast_to(t, (*x.shape[:-1], 1)).reshape(-1)
        found = [self._called(*state) for state in zip(times, x.reshape(-1, x.shape[-1]), strict=True)]
        u = np.array([torques for torques, _ in found]).reshape(*x.shape[:-1], -1)
        return u, None if found[0][1] is None else np.array([r for _, r in found]).reshape(*x.shape[:-1], -1)

    def _called(self, t: Any, x: Array) -> tuple[Array, Array | None]:
        n = self.n
        q, qd = x[..., :n].copy(), x[..., n : 2 * n].copy()  # a law may modify its arguments
        if not hasattr(self.law, "states"):
            return _shaped_like(self.law(t, q, qd), q), None
        u, rates = torques_and_rates(self.law(t, q, qd, x[..., 2 * n : 2 * n + self.states].copy()))
        return _shaped_like(u, q), np.asarray(rates)

    @cached_property
    def _takes_batches(self) -> bool:
        """True if the law gives for two states at once what it gives for each."""
        rng = np.random.default_rng(0)
        t, X = rng.uniform(0, 1, (2, 1)), rng.uniform(-1, 1, (2, 2 * self.n + self.states))
        try:
            together, _ = self._called(t, X)
            single = [self._called(float(s[0]), x)[0] for s, x in zip(t, X, strict=True)]
        except Exception:  # whatever the law raises
            return False
        return together.shape == (2, self.n) and np.allclose(together, single, rtol=AGREEMENT, atol=AGREEMENT)


def torques_and_rates(returned: Any) -> tuple[Any, Any]:
    """What a law with states returned, as (torques, dz/dt)."""
    if not isinstance(returned, tuple) or len(returned) != 2:
        got = f"a tuple of {len(returned)}" if isinstance(returned, tuple) else type(returned).__name__
        raise ValueError(f"`controller` with states must return (torques, rates of its states), got {got}")
    return returned


def _shaped_like(u: Any, q: Array) -> Array:
    """A law's torques with one row per state; a constant is repeated."""
    try:
        torques = np.asarray(u)
    except ValueError:
        torques = np.asarray(None)
    if torques.shape != q.shape and (torques.shape != q.shape[-1:] or (torques.dtype == object and torques.size == 0)):
        raise ValueError(
            f"`controller` must return shape (..., {q.shape[-1]}) for states of that shape, got {torques.shape}"
        )
    return torques + 0 * q if torques.shape != q.shape else torques
