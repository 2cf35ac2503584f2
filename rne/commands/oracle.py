"""Results of Pinocchio in this package's joint order and conventions, mapped by joint names.

Pinocchio orders siblings by the alphabet, has (cos, sin) of a `continuous` joint, and takes mimics as independent.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..model.model import Model


class Oracle:
    """Results of Pinocchio for a model, whose URDF text it reads by itself."""

    def __init__(self, model: Model, xml: str) -> None:
        import pinocchio

        self.pin: Any = pinocchio
        self.model = model
        self.theirs = pinocchio.buildModelFromXML(xml)
        self.theirs.gravity.linear = np.array(model.gravity)
        self.joint_ids = [self.theirs.getJointId(name) for name in model.moving_joints]
        self.v = np.array([self.theirs.joints[k].idx_v for k in self.joint_ids], dtype=int)
        self.theirs.armature[self.v] = model.armature  # of a URDF it reads none
        self.data = self.theirs.createData()

    def q(self, q: Array) -> Array:
        """Joint positions as Pinocchio's configuration vector, shape (nq,)."""
        ours = self.model.coordinate_map @ q + self.model.offset
        theirs: Array = self.pin.neutral(self.theirs)
        for k, x in zip(self.joint_ids, ours, strict=True):
            joint = self.theirs.joints[k]
            theirs[joint.idx_q : joint.idx_q + joint.nq] = [x] if joint.nq == 1 else [np.cos(x), np.sin(x)]
        return theirs

    def velocities(self, x: Array) -> Array:
        """Joint velocities or accelerations in Pinocchio's order, shape (nv,)."""
        theirs = np.zeros(self.theirs.nv)
        theirs[self.v] = self.model.coordinate_map @ x
        return theirs

    def torque(self, tau: Array) -> Array:
        """Pinocchio's torques in this package's order, shape (n,)."""
        return np.asarray(self.model.coordinate_map.T @ np.asarray(tau)[self.v])

    def matrix(self, M: Array) -> Array:
        """Joint-space matrix of Pinocchio in this package's order, shape (n, n)."""
        G = self.model.coordinate_map
        return np.asarray(G.T @ np.asarray(M)[np.ix_(self.v, self.v)] @ G)

    def inverse_dynamics(self, q: Array, qd: Array, qdd: Array, *forces: Any) -> Array:
        """Joint torques by `rnea`."""
        state = self.q(q), self.velocities(qd), self.velocities(qdd)
        return self.torque(self.pin.rnea(self.theirs, self.data, *state, *forces))

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix by `crba`."""
        return self.matrix(self.pin.crba(self.theirs, self.data, self.q(q)))

    def gravity_torque(self, q: Array) -> Array:
        """Gravity torques by `computeGeneralizedGravity`."""
        return self.torque(self.pin.computeGeneralizedGravity(self.theirs, self.data, self.q(q)))

    def bias_torque(self, q: Array, qd: Array) -> Array:
        """Bias torques by `nonLinearEffects`."""
        return self.torque(self.pin.nonLinearEffects(self.theirs, self.data, self.q(q), self.velocities(qd)))

    def coriolis_matrix(self, q: Array, qd: Array) -> Array:
        """Coriolis matrix by `computeCoriolisMatrix`."""
        return self.matrix(self.pin.computeCoriolisMatrix(self.theirs, self.data, self.q(q), self.velocities(qd)))

    def forward_dynamics(self, q: Array, qd: Array, tau: Array) -> Array:
        """Joint accelerations by `aba`; for robots without mimic joints."""
        theirs = np.zeros(self.theirs.nv)
        theirs[self.v] = tau
        return np.asarray(self.pin.aba(self.theirs, self.data, self.q(q), self.velocities(qd), theirs)[self.v])


def each(call: Callable[..., Array], *arrays: Array) -> Array:
    """Results of a function of one state for every state of a batch."""
    return np.array([call(*state) for state in zip(*arrays, strict=True)])
