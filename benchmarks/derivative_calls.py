"""The calls that give derivatives: ours by both engines, Pinocchio's, CasADi's, complex steps and differences."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

import rne
from benchmarks.cases import engines
from benchmarks.peers.pinocchio import Pinocchio
from benchmarks.peers.registry import Call, import_failure
from rne.kernels.trace import by_recursion

JACOBIAN, GRADIENT, HESSIAN = "jacobian", "gradient", "hessian"
TITLES = {"values": "function", JACOBIAN: "Jacobian", GRADIENT: "gradient", HESSIAN: "Hessian"}
NAMES = ("NumPy", "Numba")
FUNCTIONS = {"inverse_dynamics": rne.dynamics.inverse_dynamics, "forward_dynamics": rne.dynamics.forward_dynamics}
FEW = 128  # states of calls that take long
H = 6e-6  # of central differences: the cube root of eps
FIRST = [
    (robot, function, order)
    for robot, function in (("ur5", "inverse_dynamics"), ("ur5", "forward_dynamics"), ("panda", "forward_dynamics"))
    for order in (GRADIENT, HESSIAN)
]


def jacobian(function: Any, model: rne.Model, **options: Any) -> Any:
    """The kernel of derivatives by all arguments."""
    return rne.kernels.derivative(function, model, *function.quantity.widths, **options)


MAKERS: dict[str, Any] = {
    "values": rne.compile,
    JACOBIAN: jacobian,
    GRADIENT: rne.kernels.gradient,
    HESSIAN: rne.kernels.hessian,
}


class Derivatives(NamedTuple):
    """A call, how many states it computes, what it gives, and its results for the first few."""

    call: Call
    count: int
    order: str
    results: Any


def points(robot: rne.Robot, title: str, arrays: list[np.ndarray]) -> dict[str, Derivatives]:
    """Every call by its name."""
    function, count = FUNCTIONS[title], len(arrays[0])
    found: dict[str, Derivatives] = {}
    for engine in engines():
        for order, make in MAKERS.items():
            kernel = make(function, robot.model, engine=engine)
            given = arrays[: len(kernel.names)]
            out = np.empty((count, *kernel.traced.shape))
            name = f"{dict(zip(('numpy', 'numba'), NAMES, strict=True))[engine]}, {TITLES.get(order, order)}"
            name = name.replace("function", "values")
            found[name] = Derivatives(_call(kernel, given, out), count, order, _first(kernel, given))
    found["Pinocchio, first derivatives"] = _pinocchio(robot, title, arrays)
    if title == "inverse_dynamics" and import_failure("casadi") is None:
        found |= _casadi(robot.model, arrays)
    few = [a[:FEW] for a in arrays]
    wrt = tuple(function.quantity.widths)

    def stepped(first: int = FEW) -> np.ndarray:
        return by_recursion(function, robot.model, [a[:first] for a in arrays[:3]], wrt, {})[0]

    def differences(first: int = FEW) -> np.ndarray:
        moved = [a[:first, None, None] for a in arrays[:3]]
        steps = np.split(H * np.eye(3 * robot.n), 3, axis=1)
        signs = np.array([1, -1])[:, None, None]
        values = function(robot.model, *(a + signs * s for a, s in zip(moved, steps, strict=True)))
        return np.swapaxes(values[:, 0] - values[:, 1], -1, -2) / (2 * H)

    found["complex steps, recursion"] = Derivatives(stepped, len(few[0]), JACOBIAN, stepped)
    found["differences, recursion"] = Derivatives(differences, len(few[0]), JACOBIAN, differences)
    slopes = rne.kernels.gradient(function, robot.model)

    def bends(first: int = FEW) -> np.ndarray:
        moved = [a[:first, None, None] for a in arrays[:3]]
        steps = np.split(H * np.eye(3 * robot.n), 3, axis=1)
        signs = np.array([1, -1])[:, None, None]
        ahead = [a + signs * s for a, s in zip(moved, steps, strict=True)]
        values = slopes(*ahead, np.broadcast_to(arrays[3][:first, None, None], ahead[0].shape))
        return (values[:, 0] - values[:, 1]) / (2 * H)

    found["differences of gradients"] = Derivatives(bends, len(few[0]), HESSIAN, bends)
    return found


def _call(kernel: Any, arrays: list[np.ndarray], out: np.ndarray) -> Call:
    return lambda: kernel(*arrays, out=out)


def _first(kernel: Any, arrays: list[np.ndarray]) -> Any:
    return lambda few: kernel(*(a[:few] for a in arrays))


def _pinocchio(robot: rne.Robot, title: str, arrays: list[np.ndarray]) -> Derivatives:
    """A Python loop over its first derivatives, the only ones that it has."""
    import pinocchio as pin

    theirs = Pinocchio(robot.model, arrays[:3])
    call = {"inverse_dynamics": pin.computeRNEADerivatives, "forward_dynamics": pin.computeABADerivatives}[title]

    def loop() -> None:
        for column in theirs.columns:
            call(theirs.model, theirs.data, *column)

    def results(few: int) -> np.ndarray:
        found = []
        for column in theirs.columns[:few]:
            parts = call(theirs.model, theirs.data, *column)
            if title == "inverse_dynamics":
                parts = [np.array(part) for part in parts]
                parts[2] = np.triu(parts[2]) + np.triu(parts[2], 1).T
            else:
                upper = np.triu(theirs.data.Minv)
                parts = [np.array(theirs.data.ddq_dq), np.array(theirs.data.ddq_dv), upper + np.triu(upper, 1).T]
            found.append(np.concatenate([theirs.oracle.matrix(part) for part in parts], axis=-1))
        return np.array(found)

    return Derivatives(loop, len(theirs.columns), JACOBIAN, results)


def _casadi(model: rne.Model, arrays: list[np.ndarray]) -> dict[str, Derivatives]:
    """CasADi's derivatives of a recursion written for it by hand, in its virtual machine."""
    import casadi as ca

    q, qd, qdd, weights = (ca.SX.sym(name, model.n) for name in ("q", "qd", "qdd", "weights"))
    x = ca.vertcat(q, qd, qdd)
    total = ca.dot(weights, recursion(model, q, qd, qdd))
    found, count = {}, min(FEW, len(arrays[0]))
    for order, title in ((GRADIENT, "gradient"), (HESSIAN, "Hessian")):
        result = ca.gradient(total, x) if order == GRADIENT else ca.hessian(total, x)[0]
        function = ca.Function("f", [q, qd, qdd, weights], [ca.densify(result)])
        given = [np.ascontiguousarray(a[:count]) for a in arrays]
        out = np.zeros((count, *[3 * model.n] * (1 if order == GRADIENT else 2)))
        buffer, call = function.map(count).buffer()
        for k, a in enumerate(given):
            buffer.set_arg(k, memoryview(a))
        buffer.set_res(0, memoryview(out))

        def results(few: int, call: Any = call, out: np.ndarray = out, kept: Any = (buffer, given)) -> np.ndarray:
            call()
            return out[:few].copy()

        found[f"CasADi, {title}"] = Derivatives(call, count, order, results)
    return found


def recursion(model: rne.Model, q: Any, qd: Any, qdd: Any) -> Any:
    """Torques by the recursion, as one writes it for CasADi: for revolute joints of a chain or tree without mimics."""
    import casadi as ca

    omega, alpha, a = {-1: ca.SX.zeros(3)}, {-1: ca.SX.zeros(3)}, {-1: ca.SX(-np.array(model.gravity))}
    R, f, n, tau = {}, {}, {}, [ca.SX(0)] * model.nb
    for i, parent in enumerate(model.parent):
        s, p = ca.SX(model.angular_axis[i]), ca.SX(model.translation[i])
        c, d = ca.cos(q[i]), ca.sin(q[i])
        R[i] = ca.SX(model.rotation[i]) @ (c * ca.SX.eye(3) + (1 - c) * s @ s.T + d * ca.skew(s))
        before, E = omega[parent], R[i].T
        omega[i] = E @ before + s * qd[i]
        alpha[i] = E @ alpha[parent] + s * qdd[i] + ca.cross(E @ before, s * qd[i])
        a[i] = E @ (a[parent] + ca.cross(alpha[parent], p) + ca.cross(before, ca.cross(before, p)))
        m, com, inertia = float(model.mass[i]), ca.SX(model.com[i]), ca.SX(model.inertia[i])
        f[i] = m * (a[i] + ca.cross(alpha[i], com) + ca.cross(omega[i], ca.cross(omega[i], com)))
        n[i] = inertia @ alpha[i] + ca.cross(omega[i], inertia @ omega[i]) + ca.cross(com, f[i])
    for i in reversed(range(model.nb)):
        parent = model.parent[i]
        tau[i] = ca.dot(n[i], ca.SX(model.angular_axis[i])) + float(model.armature[i]) * qdd[i]
        if parent >= 0:
            force = R[i] @ f[i]
            f[parent] = f[parent] + force
            n[parent] = n[parent] + R[i] @ n[i] + ca.cross(ca.SX(model.translation[i]), force)
    return ca.vertcat(*tau)


def first_call(robot: str, function: str, order: str) -> str:
    """The script of a process that makes a kernel in machine code and calls it once, and prints the seconds."""
    return f"""
import numpy as np, rne, time
model = rne.load({robot!r}).model
arrays = [np.full(model.n, 0.1)] * 4
rne.compile(rne.dynamics.gravity_torque, model, engine="numba")(arrays[0])  # the compiler is loaded
start = time.perf_counter()
rne.kernels.{order}(rne.dynamics.{function}, model, engine="numba")(*arrays)
print(time.perf_counter() - start)
"""
