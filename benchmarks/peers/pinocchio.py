"""Pinocchio: its calls for one state, and its batch calls, on one thread.

It reads the URDF, and its placements and inertias are then set to our own numbers, so that a difference is rounding in
the algorithm and not in the reading of the file.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

import rne
from benchmarks.peers.registry import Call, Case, Point, peer
from rne.commands.oracle import Oracle

LOOP = 2000  # states of a Python loop over single calls
SINGLE: dict[str, tuple[Any, int]] = {
    "inverse_dynamics": (pin.rnea, 3),
    "mass_matrix": (pin.crba, 1),
    "forward_dynamics": (pin.aba, 3),
    "inverse_dynamics_derivatives": (pin.computeRNEADerivatives, 3),
}
BATCH = {"inverse_dynamics": pin.rneaInParallel, "forward_dynamics": pin.abaInParallel}  # M has no batch call


@peer("Pinocchio", requirement="pin>=3.0", modules=("pinocchio",))
def points(case: Case) -> list[Point]:
    """One state per call, and all states in one call for a quantity that has one."""
    theirs, quantity = Pinocchio(case.robot.model, case.states), case.quantity
    call, count = theirs.loop(quantity)
    found = [Point("Pinocchio, one state", call, count, lambda few: theirs.single_results(quantity, few))]
    if quantity in BATCH:
        call, count = theirs.fastest(quantity)
        found.append(Point("Pinocchio, batch", call, count, lambda few: theirs.results(quantity, few)))
    return found


class Pinocchio:
    """Its calls on states in its own order and memory layout, and their results in ours."""

    def __init__(self, model: rne.Model, states: list[np.ndarray]) -> None:
        self.oracle = Oracle(model, rne.to_urdf(model))
        self.model = self.oracle.theirs
        _set_numbers(model, self.oracle)
        self.data = self.oracle.data = self.model.createData()
        self.pool = pin.ModelPool(self.model, 1)
        q = np.array([self.oracle.q(x) for x in states[0]])
        rates = [np.array([self.oracle.velocities(x) for x in array]) for array in states[1:]]
        self.arrays = [np.asfortranarray(a.T) for a in (q, *rates)]
        self.count = len(q)
        self.out = np.asfortranarray(np.zeros((self.model.nv, self.count)))
        self.columns = [[np.ascontiguousarray(a[:, k]) for a in self.arrays] for k in range(min(self.count, LOOP))]

    def loop(self, quantity: str) -> tuple[Call, int]:
        """A Python loop over single calls, and how many states it computes."""
        call, arity = SINGLE[quantity]
        columns = [c[:arity] for c in self.columns]
        model, data = self.model, self.data

        def run() -> None:
            for c in columns:
                call(model, data, *c)

        return run, len(columns)

    def fastest(self, quantity: str) -> tuple[Call, int]:
        """The batch call on all states, or the loop for a quantity that has none; and how many states it computes."""
        if quantity not in BATCH:
            return self.loop(quantity)
        call = BATCH[quantity]
        return lambda: call(1, self.pool, *self.arrays, self.out), self.count

    def in_threads(self, quantity: str, threads: int) -> tuple[Call, int]:
        """The batch call on all states, for a quantity that has one, by several threads."""
        call, pool = BATCH[quantity], pin.ModelPool(self.model, threads)
        return lambda: call(threads, pool, *self.arrays, self.out), self.count

    def results(self, quantity: str, few: int) -> np.ndarray:
        """Results of `fastest` for the first states."""
        if quantity not in BATCH:
            return self.single_results(quantity, few)
        self.fastest(quantity)[0]()
        return np.array([self.oracle.torque(column) for column in self.out[:, :few].T])

    def single_results(self, quantity: str, few: int) -> np.ndarray:
        """Results of single calls for the first states."""
        call, arity = SINGLE[quantity]
        turn = self.oracle.matrix if quantity == "mass_matrix" else self.oracle.torque
        return np.array([turn(call(self.model, self.data, *c[:arity]).copy()) for c in self.columns[:few]])


def _set_numbers(model: rne.Model, oracle: Oracle) -> None:
    """Give Pinocchio our placements, inertias and armatures, which differ from those it read by rounding."""
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
