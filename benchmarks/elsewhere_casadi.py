"""Inside CasADi, beside its other sources of dynamics: python -m benchmarks.elsewhere_casadi [--quick]

The fastest motion of a robot between two rests, with limits of torque and velocity, by IPOPT with exact Hessians: the
same problem with the inverse dynamics of this package, of a recursion written for CasADi by hand, and of adam where it
is installed (pip install 'adam-robotics[casadi]'). CPU seconds of interleaved solutions, instructions of the functions
and of their derivatives, microseconds of one evaluation, errors against the recursion of this package.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any, NamedTuple

import numpy as np

import rne
from benchmarks.cases import states
from benchmarks.derivative_calls import recursion
from benchmarks.measure import QUICK_NOTE, interleaved, is_quick, many, ratio, within
from benchmarks.pages import table, three
from benchmarks.peers.registry import import_failure

EFFORT = {"irb140": [250.0, 250.0, 150.0, 20.0, 20.0, 10.0]}  # [N m]; its URDF has none
ENDS = {
    "irb140": ([-1.2, 0.3, 0.2, 0.5, -0.8, 0.0], [1.2, 0.9, -0.5, -0.5, 0.8, 2.0]),
    "ur5": ([-1.0, -1.2, 1.2, -1.5, -1.5, 0.0], [1.2, -0.6, 0.4, -0.8, 1.0, 1.0]),
}
OURS, BY_HAND, ADAM = "rne", "recursion by hand", "adam"
NODES, REPEATS = 40, 9
QUICK_NODES, QUICK_REPEATS = 8, 1
STATES = 100
GUESS = 1.5  # of the duration [s]

Results = dict[str, Any]


def sources(robot: rne.Robot) -> dict[str, Callable[[], Any]]:
    """Makers of f(q, qd, qdd) -> torques."""
    import casadi as ca

    model = robot.model

    def by_hand() -> Any:
        symbols = [ca.SX.sym(name, robot.n) for name in ("q", "qd", "qdd")]
        return ca.Function("f", symbols, [recursion(model, *symbols)])

    found: dict[str, Callable[[], Any]] = {
        OURS: lambda: rne.compile(rne.dynamics.inverse_dynamics, model).to_casadi(),
        BY_HAND: by_hand,
    }
    if import_failure("adam") is None:
        found[ADAM] = lambda: by_adam(robot)
    return found


def by_adam(robot: rne.Robot) -> Any:
    """adam's M qdd + h of a base at rest: its recursion takes no accelerations."""
    import casadi as ca
    from adam.casadi import KinDynComputations

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(rne.to_urdf(robot.model), encoding="utf-8")
        theirs = KinDynComputations(str(path), list(robot.joint_names), gravity=np.array([0, 0, -9.81, 0, 0, 0]))
    base, q, qd, qdd = ca.SX.eye(4), *(ca.SX.sym(name, robot.n) for name in ("q", "qd", "qdd"))
    tau = theirs.mass_matrix(base, q)[6:, 6:] @ qdd + theirs.bias_force(base, q, ca.SX.zeros(6), qd)[6:]
    return ca.Function("f", [q, qd, qdd], [tau])


class Motion(NamedTuple):
    """The solver of a fastest motion, its arguments, and the number of the duration among its unknowns."""

    solver: Any
    arguments: Results
    duration: int


def fastest(robot: rne.Robot, name: str, torques: Any, nodes: int) -> Motion:
    """Least T with accelerations that are linear between nodes and limits of velocity and torque at them."""
    import casadi as ca

    n, (start, end) = robot.n, map(np.array, ENDS[name])
    effort = np.array(EFFORT.get(name, robot.effort_limit))
    Q, V, A = (ca.MX.sym(symbol, n, nodes + 1) for symbol in "QVA")
    T = ca.MX.sym("T")
    h = T / nodes
    a, b = A[:, :-1], A[:, 1:]
    reached = V[:, :-1] + h / 2 * (a + b) - V[:, 1:]
    moved = Q[:, :-1] + h * V[:, :-1] + h**2 / 6 * (2 * a + b) - Q[:, 1:]
    tau = torques.map(nodes + 1)(Q, V, A) / effort
    x = ca.veccat(Q, V, A, T)
    g = ca.veccat(reached, moved, tau)
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-6}}
    solver = ca.nlpsol("fastest", "ipopt", {"x": x, "f": T, "g": g}, options)
    count = nodes + 1
    low = [np.tile(robot.lower, (count, 1)), np.tile(-robot.velocity_limit, (count, 1)), np.full((count, n), -1e3)]
    high = [np.tile(robot.upper, (count, 1)), np.tile(robot.velocity_limit, (count, 1)), np.full((count, n), 1e3)]
    for k, q in ((0, start), (-1, end)):
        low[0][k] = high[0][k] = q
        low[1][k] = high[1][k] = 0.0
    share = np.linspace(0, 1, count)[:, None]
    guess = [start + share * (end - start), np.tile((end - start) / GUESS, (count, 1)), np.zeros((count, n))]
    equal = np.zeros(2 * n * nodes)
    arguments = {
        "x0": np.concatenate([*map(np.ravel, guess), [GUESS]]),
        "lbx": np.concatenate([*map(np.ravel, low), [0.05]]),
        "ubx": np.concatenate([*map(np.ravel, high), [10.0]]),
        "lbg": np.concatenate([equal, np.full(n * count, -1.0)]),
        "ubg": np.concatenate([equal, np.full(n * count, 1.0)]),
    }
    return Motion(solver, arguments, 3 * n * count)


def solve(motion: Motion) -> float:
    """The duration [s]."""
    found = motion.solver(**motion.arguments)
    if not motion.solver.stats()["success"]:
        raise RuntimeError(f"IPOPT: {motion.solver.stats()['return_status']}")
    return float(found["x"][motion.duration])


def derivatives(torques: Any) -> dict[str, Any]:
    """f, its Jacobian, and the Hessian of a weighted sum, as CasADi makes them."""
    import casadi as ca

    symbols = [ca.SX.sym(name, torques.size1_in(k)) for k, name in enumerate(("q", "qd", "qdd"))]
    weights, x, tau = ca.SX.sym("weights", torques.size1_out(0)), ca.vertcat(*symbols), torques(*symbols)
    return {
        "function": ca.Function("f", symbols, [tau]),
        "Jacobian": ca.Function("J", symbols, [ca.jacobian(tau, x)]),
        "Hessian": ca.Function("H", [*symbols, weights], [ca.hessian(ca.dot(weights, tau), x)[0]]),
    }


def evaluation(function: Any, arguments: list[np.ndarray]) -> Callable[[], None]:
    """One call by CasADi's own pointers, which makes no Python objects."""
    buffer, call = function.buffer()
    given, out = [np.ascontiguousarray(a) for a in arguments], np.zeros(function.nnz_out(0))
    for k, a in enumerate(given):
        buffer.set_arg(k, memoryview(a))
    buffer.set_res(0, memoryview(out))
    kept = buffer, given, out  # CasADi has their addresses alone

    def called(kept: Any = kept) -> None:
        call()

    return called


def run(quick: bool) -> Results:
    """All figures of each robot."""
    nodes, repeats = (QUICK_NODES, QUICK_REPEATS) if quick else (NODES, REPEATS)
    return {name: compare(name, nodes, repeats) for name in (list(ENDS)[:1] if quick else ENDS)}


def compare(name: str, nodes: int, repeats: int) -> Results:
    """A row for each source of the dynamics."""
    robot = rne.load(name)
    makers = sources(robot)
    functions = {source: make() for source, make in makers.items()}
    q, qd, qdd = states(robot.n, STATES)
    expected = rne.dynamics.inverse_dynamics(robot.model, q, qd, qdd)
    motions = {source: fastest(robot, name, f, nodes) for source, f in functions.items()}
    durations = {source: solve(motion) for source, motion in motions.items()}
    solved = interleaved(
        {source: partial(solve, motion) for source, motion in motions.items()}, repeats, clock=process_time
    )
    forms = {source: derivatives(f) for source, f in functions.items()}
    given = q[0], qd[0], qdd[0], np.ones(robot.n)
    calls = {
        (source, form): evaluation(function, list(given[: function.n_in()]))
        for source, of in forms.items()
        for form, function in of.items()
    }
    counts = {key: within(call, 0.02) for key, call in calls.items()}
    each = interleaved({str(key): many(call, counts[key]) for key, call in calls.items()}, repeats, clock=process_time)
    rows: Results = {}
    for source, function in functions.items():
        found = function.map(STATES)(q.T, qd.T, qdd.T).full().T
        rows[source] = {
            "duration": durations[source],
            "iterations": motions[source].solver.stats()["iter_count"],
            "cpu_s": median(solved[source]),
            "ours_times": ratio(solved, OURS, source),
            "instructions": {form: f.n_instructions() for form, f in forms[source].items()},
            "us": {form: 1e6 * median(each[str((source, form))]) / counts[source, form] for form in forms[source]},
            "worst_error": float((np.abs(found - expected).max(1) / np.abs(expected).max(1)).max()),
        }
    return rows


def tables(results: Results) -> dict[str, str]:
    """The table of the page."""
    head = ["robot, dynamics", "instructions of f, Jacobian, Hessian", "one evaluation of each [us]", "IPOPT [CPU s]"]
    head += ["rne's CPU time / this one's", "iterations", "worst error"]
    lines = []
    for robot, rows in results.items():
        for source, row in rows.items():
            cells = [
                ", ".join(map(str, row["instructions"].values())),
                ", ".join(f"{us:.1f}" for us in row["us"].values()),
            ]
            cells += [f"{row['cpu_s']:.2f}", three(row["ours_times"]), str(row["iterations"])]
            lines.append([f"{robot}, {source}", *cells, f"{row['worst_error']:.0e}"])
    return {"casadi": table(head, lines)}


def main() -> None:
    quick = is_quick(__doc__)
    results = run(quick)
    print("\n\n".join(f"{name}:\n\n{text}" for name, text in tables(results).items()))
    print("durations:", {robot: {s: row["duration"] for s, row in rows.items()} for robot, rows in results.items()})
    if quick:
        print(QUICK_NOTE)


if __name__ == "__main__":
    main()
