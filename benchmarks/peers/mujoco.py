"""MuJoCo's calls, one state each; it reads the URDF."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import rne
from benchmarks.peers.found import Call, Case, Point, module


def points(case: Case) -> list[Point]:
    """Its calls from Python."""
    peer = MuJoCo(case.robot.model, case.states)
    call, count = peer.loop(case.quantity)
    return [Point("MuJoCo, one state", call, count, lambda few: peer.results(case.quantity, few))]


class MuJoCo:
    """One state a call; contacts, limits and joint damping are off."""

    def __init__(self, model: rne.Model, states: list[np.ndarray]) -> None:
        self.mj = module("mujoco")
        theirs = self.mj.MjModel.from_xml_string(rne.to_urdf(model))
        theirs.opt.gravity[:] = model.gravity
        theirs.dof_damping[:] = 0
        theirs.dof_frictionloss[:] = 0
        theirs.opt.disableflags |= int(self.mj.mjtDisableBit.mjDSBL_CONSTRAINT)
        self.theirs, self.data = theirs, self.mj.MjData(theirs)
        joints = [self.mj.mj_name2id(theirs, self.mj.mjtObj.mjOBJ_JOINT, name) for name in model.moving_joints]
        if sorted(joints) != joints:
            raise ValueError(f"MuJoCo orders the joints of {model.name!r} differently")
        self.states = states
        self.M = np.zeros((theirs.nv, theirs.nv))

    def one(self, quantity: str) -> Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
        """The call, with its state set before it."""
        mj, m, d = self.mj, self.theirs, self.data
        M = self.M

        def inverse(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
            d.qpos[:], d.qvel[:], d.qacc[:] = q, qd, qdd
            mj.mj_inverse(m, d)
            return np.asarray(d.qfrc_inverse)

        def mass(q: np.ndarray, _qd: np.ndarray, _qdd: np.ndarray) -> np.ndarray:
            d.qpos[:] = q
            mj.mj_kinematics(m, d)
            mj.mj_comPos(m, d)
            mj.mj_makeM(m, d)
            mj.mj_fullM(m, d, M)
            return M

        def forward(q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> np.ndarray:
            d.qpos[:], d.qvel[:], d.qfrc_applied[:] = q, qd, tau
            mj.mj_forward(m, d)
            return np.asarray(d.qacc)

        return {"inverse_dynamics": inverse, "mass_matrix": mass, "forward_dynamics": forward}[quantity]

    def loop(self, quantity: str) -> tuple[Call, int]:
        """One call a state."""
        call, states = self.one(quantity), list(zip(*(s[:2000] for s in self.states), strict=True))

        def run() -> None:
            for s in states:
                call(*s)

        return run, len(states)

    def results(self, quantity: str, count: int) -> np.ndarray:
        """Of the first states."""
        call = self.one(quantity)
        return np.array([call(*s).copy() for s in zip(*(s[:count] for s in self.states), strict=True)])
