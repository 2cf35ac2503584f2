"""Pinocchio's calls; it reads the URDF, and is then given our very numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

import rne
from benchmarks.peers.found import Call
from rne.analysis.pinocchio import Oracle


class Pinocchio:
    """Its calls on states in its own order and memory layout, and their results in ours.

    Its placements and inertias are set to our very numbers, so that a difference is rounding in the algorithm and not
    in the reading of the file.
    """

    def __init__(self, model: rne.Model, xml: str, states: list[np.ndarray]) -> None:
        self.oracle = Oracle(model, xml)
        self.model, self.data = self.oracle.theirs, self.oracle.data
        _same_numbers(model, self.oracle)
        self.data = self.oracle.data = self.model.createData()
        self.pool = pin.ModelPool(self.model, 1)
        q = np.array([self.oracle.q(x) for x in states[0]])
        rates = [np.array([self.oracle.rates(x) for x in array]) for array in states[1:]]
        self.arrays = [np.asfortranarray(a.T) for a in (q, *rates)]
        self.count = len(q)
        self.out = np.asfortranarray(np.zeros((self.model.nv, self.count)))
        self.columns = [[np.ascontiguousarray(a[:, k]) for a in self.arrays] for k in range(min(self.count, 2000))]

    def ours(self, out: np.ndarray) -> np.ndarray:
        """A batch result as (N, n)."""
        return np.array([self.oracle.torque(column) for column in out.T])

    def batch(self, quantity: str) -> Call | None:
        """The call for many states; M has none."""
        call = {"inverse_dynamics": pin.rneaInParallel, "forward_dynamics": pin.abaInParallel}.get(quantity)
        return None if call is None else (lambda: call(1, self.pool, *self.arrays, self.out))

    def loop(self, quantity: str) -> tuple[Call, int]:
        """One call a state from Python, and how many states."""
        call, arity = CALLS[quantity]
        columns = [c[:arity] for c in self.columns]
        model, data = self.model, self.data

        def run() -> None:
            for c in columns:
                call(model, data, *c)

        return run, len(columns)

    def results(self, quantity: str, count: int) -> np.ndarray:
        """Of the first states, one call each."""
        call, arity = CALLS[quantity]
        turn = self.oracle.matrix if quantity == "mass_matrix" else self.oracle.torque
        return np.array([turn(call(self.model, self.data, *c[:arity]).copy()) for c in self.columns[:count]])


CALLS: dict[str, tuple[Any, int]] = {
    "inverse_dynamics": (pin.rnea, 3),
    "mass_matrix": (pin.crba, 1),
    "forward_dynamics": (pin.aba, 3),
}


def _same_numbers(model: rne.Model, oracle: Oracle) -> None:
    theirs = oracle.theirs
    theirs.armature = np.array(model.armature)[np.argsort(oracle.v)]
    for i, k in enumerate(oracle.joint_ids):
        placement, inertia = theirs.jointPlacements[k], theirs.inertias[k]
        pairs = [
            (placement.rotation, model.rotation[i]),
            (placement.translation, model.translation[i]),
            (inertia.mass, model.mass[i]),
            (inertia.lever, model.com[i]),
            (inertia.inertia, model.inertia[i]),
        ]
        if not all(np.allclose(a, b, rtol=1e-12, atol=1e-12) for a, b in pairs):
            raise ValueError(f"Pinocchio reads joint {model.moving_joints[i]!r} of {model.name!r} differently")
        theirs.jointPlacements[k] = pin.SE3(model.rotation[i].copy(), model.translation[i].copy())
        theirs.inertias[k] = pin.Inertia(float(model.mass[i]), model.com[i].copy(), model.inertia[i].copy())
