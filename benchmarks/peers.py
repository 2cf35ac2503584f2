"""Other packages on the same robots and states; those that are not installed are named, not counted."""

from __future__ import annotations

import importlib
import importlib.metadata
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

import rne
from rne.report.oracle import Oracle

OTHERS = {
    "mujoco": "mujoco",
    "casadi": "casadi",
    "roboticstoolbox": "roboticstoolbox-python",
    "adam": "adam-robotics",
}
NOT_COMPARED = {"roboticstoolbox", "adam"}  # no calls of theirs are written here
Call = Callable[[], Any]


def installed(name: str) -> Any:
    """The module, or None."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def left_out() -> dict[str, str]:
    """Why a package is not in the charts, by name."""
    reasons = {name: "not installed" for name in OTHERS if installed(name) is None}
    return reasons | {name: "no calls written" for name in NOT_COMPARED - set(reasons)}


def versions() -> dict[str, str]:
    """Of those that are compared."""
    return {name: importlib.metadata.version(OTHERS[name]) for name in OTHERS if name not in left_out()}


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


class MuJoCo:
    """One state a call; contacts, limits and joint damping are off."""

    def __init__(self, model: rne.Model, states: list[np.ndarray]) -> None:
        self.mj = installed("mujoco")
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


class CasADi:
    """Its virtual machine on our kernel's own source, so the same operations; columns are states."""

    def __init__(self, kernel: rne.Kernel, arrays: list[np.ndarray]) -> None:
        ca = installed("casadi")
        scope: dict[str, Any] = {}
        exec(kernel.source("python"), scope)
        scope |= {"sin": ca.sin, "cos": ca.cos, "sqrt": ca.sqrt}
        symbols = [ca.SX.sym(name, a.shape[1]) for name, a in zip(kernel.names, arrays, strict=True)]
        flat = _flat(scope[kernel.function.__name__](*[[s[i] for i in range(s.shape[0])] for s in symbols]))
        self.function = ca.Function("f", symbols, [ca.vertcat(*flat)])
        self.arrays = [np.asfortranarray(a.T) for a in arrays]
        self.shape = kernel.shapes[0]

    def batch(self) -> Any:
        """All states in one call."""
        return self.function(*self.arrays)

    def results(self, count: int) -> np.ndarray:
        """Of the first states."""
        return np.asarray(self.batch())[:, :count].T.reshape(count, *self.shape)


def _flat(rows: Any) -> list[Any]:
    return [x for row in rows for x in _flat(row)] if isinstance(rows, list | tuple) else [rows]
