"""The rigid-body dynamics of a case by Pinocchio, in the coordinates of the scene. Shares no code with rne."""

from __future__ import annotations

import numpy as np
import pinocchio as pin


class Plant:
    """Mass matrix and bias torque of a case's robot: q_joints = G q + o, with mimics reduced and locked joints held.

    Pinocchio wants the joints of every subtree in a row, so they are added depth first.
    """

    def __init__(self, case, *, loaded=True):
        self.model = pin.Model()
        joints = case.joints
        order, ids = _depth_first(joints), {-1: 0}
        for k in order:
            joint = joints[k]
            axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
            kind = pin.JointModelPrismaticUnaligned if joint.kind == "prismatic" else pin.JointModelRevoluteUnaligned
            place = pin.SE3(pin.rpy.rpyToMatrix(np.array(joint.rpy)), np.array(joint.xyz))
            ids[k] = self.model.addJoint(ids[joint.parent], kind(axis), place, f"j{k}")
            self._append(ids[k], joint.mass, joint.com, joint.inertia)
        if loaded and case.payload is not None:
            mass, com, inertia, link = case.payload
            self._append(ids[link], mass, com, inertia)
        gravity = np.array(case.gravity if case.scene_gravity is None else case.scene_gravity)
        if case.mounting is not None:
            gravity = pin.rpy.rpyToMatrix(np.array(case.mounting)).T @ gravity
        self.model.gravity.linear = gravity
        self.data = self.model.createData()
        G, o = coordinates(case)
        self.n, self.G, self.o = G.shape[1], G[order], o[order]
        self.is_plain = np.array_equal(self.G, np.eye(len(joints))) and not self.o.any()
        self.armature = self.G.T @ np.diag([joints[k].armature for k in order]) @ self.G
        if loaded and case.armature is not None:
            self.armature = self.armature + np.diag(case.armature)

    def _append(self, joint, mass, com, inertia):
        I = np.zeros((3, 3)) if inertia is None else np.array(inertia)
        self.model.appendBodyToJoint(joint, pin.Inertia(mass, np.array(com), I), pin.SE3.Identity())

    def mass_matrix(self, q):
        """M of the scene's coordinates, armature included."""
        if self.is_plain:
            return pin.crba(self.model, self.data, q) + self.armature
        return self.G.T @ pin.crba(self.model, self.data, self.G @ q + self.o) @ self.G + self.armature

    def bias(self, q, qd):
        """C qd + g."""
        if self.is_plain:
            return pin.nonLinearEffects(self.model, self.data, q, qd)
        return self.G.T @ pin.nonLinearEffects(self.model, self.data, self.G @ q + self.o, self.G @ qd)

    def gravity_torque(self, q):
        """The torques that hold the robot at rest."""
        return self.bias(q, np.zeros(self.n))


def coordinates(case):
    """G and o of q_joints = G q + o, rows in the order of the case's joints."""
    names = [k for k, joint in enumerate(case.joints) if joint.mimic is None]
    G, o = np.zeros((len(case.joints), len(names))), np.zeros(len(case.joints))
    for k, joint in enumerate(case.joints):
        driver, factor, offset = (k, 1.0, 0.0) if joint.mimic is None else joint.mimic
        G[k, names.index(driver)], o[k] = factor, offset
    for k, position in case.locked.items():
        o = o + G[:, names.index(k)] * position
    return G[:, [i for i, k in enumerate(names) if k not in case.locked]], o


def _depth_first(joints, parent=-1):
    order = []
    for k, joint in enumerate(joints):
        if joint.parent == parent:
            order += [k, *_depth_first(joints, k)]
    return order
