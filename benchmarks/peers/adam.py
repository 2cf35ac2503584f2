"""adam: M and the bias force from the URDF. Its robots float; the block of the joints is that of the fixed base.

It has no inverse dynamics with accelerations, and its forward dynamics is of the floating robot: both are put
together from M and the bias force here.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import rne
from benchmarks.peers.casadi import in_c
from benchmarks.peers.registry import Case, Point, peer

REQUIREMENT = "adam-robotics[casadi]>=0.5"
STATES = 1000


@peer("adam", requirement=REQUIREMENT, modules=("adam.numpy",))
def points(case: Case) -> list[Point]:
    """Its NumPy on a batch."""
    count = min(len(case.states[0]), STATES)
    call = numpy_call(case.robot.model, case.quantity, [a[:count] for a in case.states])
    return [Point("adam, batch", call, count, lambda few: call()[:few])]


@peer("adam in C", requirement=REQUIREMENT, modules=("adam.casadi", "casadi"), compiles=True)
def compiled_points(case: Case) -> list[Point]:
    """Its CasADi expressions in C."""
    return [in_c("adam in C, batch", casadi_function(case.robot.model, case.quantity), case)]


def numpy_call(model: rne.Model, quantity: str, states: list[np.ndarray]) -> Any:
    """All states in one call."""
    import adam.numpy

    robot = _read(adam.numpy, model)
    q, qd, third = states
    base, still = np.tile(np.eye(4), (len(q), 1, 1)), np.zeros((len(q), 6))

    def mass() -> np.ndarray:
        M: np.ndarray = robot.mass_matrix(base, q)[:, 6:, 6:]
        return M

    def bias() -> np.ndarray:
        h: np.ndarray = robot.bias_force(base, q, still, qd)[:, 6:]
        return h

    return {
        "inverse_dynamics": lambda: (mass() @ third[..., None])[..., 0] + bias(),
        "mass_matrix": mass,
        "forward_dynamics": lambda: np.linalg.solve(mass(), (third - bias())[..., None])[..., 0],
    }[quantity]


def casadi_function(model: rne.Model, quantity: str) -> Any:
    """Function of CasADi as an expression; M is solved by CasADi's LDL."""
    import adam.casadi
    import casadi as ca

    robot = _read(adam.casadi, model)
    q, qd, third = (ca.SX.sym(name, model.n) for name in ("q", "qd", "third"))
    M = robot.mass_matrix_fun()(np.eye(4), q)[6:, 6:]
    h = robot.bias_force_fun()(np.eye(4), q, np.zeros(6), qd)[6:]
    if quantity == "mass_matrix":
        return ca.Function("f", [q], [ca.vec(M.T)])
    result = M @ third + h if quantity == "inverse_dynamics" else ca.ldl_solve(third - h, *ca.ldl(M))
    return ca.Function("f", [q, qd, third], [result])


def _read(package: Any, model: rne.Model) -> Any:
    gravity = np.concatenate([model.gravity, np.zeros(3)])
    return package.KinDynComputations(rne.to_urdf(model), list(model.moving_joints), gravity=gravity)
