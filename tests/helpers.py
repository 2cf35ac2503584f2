"""Shared by the tests: states, differences, and Pinocchio with our joint order."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import numpy as np
import pinocchio as pin

import rne

ROOT = Path(__file__).parent.parent
EPS = float(np.finfo(float).eps)


def states(n, samples=None, seed=0, *, rate=10.0, acceleration=50.0):
    """Random (q, qd, qdd): angles in +-pi, rates and accelerations up to the given ones."""
    rng = np.random.default_rng(seed)
    shape = (n,) if samples is None else (samples, n)
    return tuple(rng.uniform(-x, x, shape) for x in (np.pi, rate, acceleration))


def relative(a, b):
    """Worst difference over a batch, each state's relative to its largest entry."""
    a, b = np.atleast_2d(a), np.atleast_2d(b)
    if a.size == 0:
        return 0.0
    axes = tuple(range(1, a.ndim))
    size = np.maximum(np.abs(b).max(axis=axes), 1e-300)
    return float((np.abs(a - b).max(axis=axes) / size).max())


def data_robots():
    """URDF files of example-robot-data, by short name."""
    files = importlib.metadata.files("example-robot-data") or []
    urdfs = sorted((f for f in files if f.suffix == ".urdf"), key=str)
    return {f"{f.parts[f.parts.index('robots') + 1]}/{f.stem}": Path(f.locate()) for f in urdfs}


class Oracle:
    """Pinocchio's answers in our joint order; joints are mapped by name, mimics reduced with G."""

    def __init__(self, model: rne.Model, xml: str):
        self.model = model
        self.pin = pin.buildModelFromXML(xml)
        self.pin.gravity.linear = np.array(model.gravity)
        self.data = self.pin.createData()
        self.joint_ids = [self.pin.getJointId(name) for name in model.moving_joints]
        self.v = np.array([self.pin.joints[k].idx_v for k in self.joint_ids], dtype=int)

    def q(self, q):
        ours = self.model.coordinate_map @ q + self.model.offset
        theirs = pin.neutral(self.pin)
        for k, x in zip(self.joint_ids, ours, strict=True):
            joint = self.pin.joints[k]
            theirs[joint.idx_q : joint.idx_q + joint.nq] = [x] if joint.nq == 1 else [np.cos(x), np.sin(x)]
        return theirs

    def rates(self, x):
        theirs = np.zeros(self.pin.nv)
        theirs[self.v] = self.model.coordinate_map @ x
        return theirs

    def torque(self, tau):
        return self.model.coordinate_map.T @ np.asarray(tau)[self.v]

    def matrix(self, M):
        G = self.model.coordinate_map
        return G.T @ np.asarray(M)[np.ix_(self.v, self.v)] @ G

    def rnea(self, q, qd, qdd, *more):
        return self.torque(pin.rnea(self.pin, self.data, self.q(q), self.rates(qd), self.rates(qdd), *more))

    def mass_matrix(self, q):
        return self.matrix(pin.crba(self.pin, self.data, self.q(q)))

    def gravity(self, q):
        return self.torque(pin.computeGeneralizedGravity(self.pin, self.data, self.q(q)))

    def bias(self, q, qd):
        return self.torque(pin.nonLinearEffects(self.pin, self.data, self.q(q), self.rates(qd)))

    def coriolis_matrix(self, q, qd):
        return self.matrix(pin.computeCoriolisMatrix(self.pin, self.data, self.q(q), self.rates(qd)))


def each(call, *arrays):
    """Call on every state of a batch."""
    return np.array([call(*state) for state in zip(*arrays, strict=True)])
