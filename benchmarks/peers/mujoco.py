"""MuJoCo, one state per call: it reads the URDF and turns the inertias to their principal axes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import rne
from benchmarks.peers.registry import Case, Point, peer

LOOP = 2000  # states of a Python loop over single calls


@peer("MuJoCo", requirement="mujoco>=3.2", modules=("mujoco",))
def points(case: Case) -> list[Point]:
    """A Python loop over single calls."""
    theirs = MuJoCo(case.robot.model)
    call, states = theirs.state_function(case.quantity), list(zip(*(s[:LOOP] for s in case.states), strict=True))

    def loop() -> None:
        for state in states:
            call(*state)

    def results(few: int) -> np.ndarray:
        return np.array([call(*state).copy() for state in states[:few]])

    return [Point("MuJoCo, one state", loop, len(states), results)]


class MuJoCo:
    """The robot in MuJoCo; contacts, limits and joint damping are off."""

    def __init__(self, model: rne.Model) -> None:
        import mujoco

        self.mujoco = mujoco
        try:
            theirs = mujoco.MjModel.from_xml_string(rne.to_urdf(model))
        except ValueError as error:
            raise ValueError(str(error).splitlines()[0].removeprefix("Error: ")) from None
        theirs.opt.gravity[:] = model.gravity
        theirs.dof_damping[:] = 0
        theirs.dof_frictionloss[:] = 0
        theirs.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        self.model, self.data = theirs, mujoco.MjData(theirs)
        joints = [mujoco.mj_name2id(theirs, mujoco.mjtObj.mjOBJ_JOINT, name) for name in model.moving_joints]
        if sorted(joints) != joints:
            raise ValueError(f"MuJoCo orders the joints of {model.name!r} differently")

    def state_function(self, quantity: str) -> Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
        """The call for one state, which is set first."""
        mj, m, d = self.mujoco, self.model, self.data
        M = np.zeros((m.nv, m.nv))

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
