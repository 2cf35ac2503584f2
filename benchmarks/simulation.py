"""Simulations beside Pinocchio's ABA: python -m benchmarks.simulation [--quick]

An ensemble of the IRB 140 by RK4, beside the time of its right-hand sides alone and beside abaInParallel driving the
same RK4 in NumPy; one trajectory of the UR5 by SciPy's methods, beside Pinocchio's ABA in the same ones; "auto" beside
RK45 on the thesis's closed loops. Interleaved, one thread each. Writes benchmarks/results/simulation.json.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

import rne
from benchmarks.cases import load
from benchmarks.measure import interleaved, is_quick, ratio, write
from benchmarks.pages import table
from benchmarks.peers.pinocchio import Pinocchio
from benchmarks.runs import Row, in_solve_ivp, measured, simulated, start, their_side, tolerance
from rne.model.robots.abb_irb140 import CLOSED_LOOPS, KD, KP

STEP = 1e-3  # of the ensemble [s]
METHODS = (("DOP853", 1e-8), ("LSODA", 1e-10))


def pinocchio_rk4(model: Any, q: np.ndarray, qd: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """The same method on columns of states, its accelerations by abaInParallel on one thread."""
    pool = pin.ModelPool(model, 1)
    x = np.asfortranarray(np.concatenate([q.T, qd.T]))
    n = model.nv
    tau, qdd = np.asfortranarray(np.zeros((n, len(q)))), np.asfortranarray(np.zeros((n, len(q))))

    def slope(x: np.ndarray) -> np.ndarray:
        pin.abaInParallel(1, pool, np.asfortranarray(x[:n]), np.asfortranarray(x[n:]), tau, qdd)
        return np.concatenate([x[n:], qdd])

    for _ in range(steps):
        k1 = slope(x)
        k2 = slope(x + STEP / 2 * k1)
        k3 = slope(x + STEP / 2 * k2)
        k4 = slope(x + STEP * k3)
        x = x + STEP / 6 * (k1 + 2 * (k2 + k3) + k4)
    return x[:n].T, x[n:].T


def ensemble(count: int, steps: int, pieces: int) -> dict[str, Any]:
    """Ours, its right-hand sides alone, and Pinocchio's, from the same starts, piece by piece in turn."""
    robot = load("irb140")
    q0 = np.random.default_rng(0).uniform(-1, 1, (count, 6))
    model = Pinocchio(robot.model, [q0[:1]] * 3).model
    scene = rne.Scene(robot)
    x, t = np.concatenate([q0, 0 * q0], axis=1), np.zeros((count, 1))
    out = scene.kernel(t, x)
    at = {"ours": (q0, 0 * q0), "pinocchio": (q0, 0 * q0)}

    def rates_alone() -> None:
        for _ in range(4 * steps):
            scene.kernel(t, x, out=out)

    def ours() -> None:
        runs = rne.ensemble(scene, *at["ours"], STEP * steps, step=STEP)
        at["ours"] = runs.q[-1], runs.qd[-1]

    def theirs() -> None:
        at["pinocchio"] = pinocchio_rk4(model, *at["pinocchio"], steps)

    seconds = interleaved({"ours": ours, "rates alone": rates_alone, "pinocchio": theirs}, pieces)
    return {
        "starts": count,
        "steps": steps * pieces,
        "seconds": sum(seconds["ours"]),
        "times_its_right_hand_sides": ratio(seconds, "ours", "rates alone"),
        "times_faster_than_pinocchio": ratio(seconds, "pinocchio", "ours"),
        "difference": float(np.abs(at["ours"][0] - at["pinocchio"][0]).max()),
    }


def trajectories(duration: float, repeats: int) -> list[Row]:
    """One free swing of the UR5 by SciPy's methods, by rne.simulate and by Pinocchio's ABA."""
    robot = load("ur5")
    x0, theirs = start(robot.n), their_side(robot)
    exact = simulated(robot, x0, duration, method="DOP853", rtol=1e-12, atol=1e-13)[0][-1]
    rows = []
    for method, rtol in METHODS:
        o = tolerance(method, rtol)
        calls = {
            "simulate": lambda o=o: simulated(robot, x0, duration, **o),
            "pinocchio": lambda o=o: in_solve_ivp(theirs, x0, duration, o),
        }
        rows.append(measured(method, f"{rtol:g}", calls, lambda m: float(np.abs(m[0][-1] - exact).max()), repeats))
    return rows


def closed_loops(repeats: int, duration: float) -> list[dict[str, Any]]:
    """Method "auto" beside RK45 on the thesis's three closed loops."""
    robot = load("irb140")
    rows = []
    for loop in CLOSED_LOOPS:
        scene = rne.Scene(robot, controller=rne.control.pd_gravity(robot, KP, KD, loop.reference))
        motions: dict[str, rne.Trajectory] = {}

        def run(method: str, s: rne.Scene = scene, q0: Any = loop.start, m: Any = motions) -> Callable[[], None]:
            def go() -> None:
                m[method] = rne.simulate(s, q0, [0] * 6, duration, method=method, t_eval=[0.0, duration])

            return go

        rne.simulate(scene, loop.start, [0] * 6, 1e-3)
        seconds = interleaved({method: run(method) for method in ("auto", "RK45")}, repeats, warm_ups=0)
        rows.append(
            {
                "evaluations": motions["auto"].evaluations,
                "RK45_evaluations": motions["RK45"].evaluations,
                "auto_times_faster": ratio(seconds, "RK45", "auto"),
                "difference": float(np.abs(motions["auto"].q[-1] - motions["RK45"].q[-1]).max()),
            }
        )
    return rows


def lines(swarm: dict[str, Any], single: list[Row], loops: list[dict[str, Any]]) -> list[list[str]]:
    """Of the table."""
    ours = f"{swarm['seconds']:.1f} s, {swarm['times_its_right_hand_sides'][0]:.2f} times its right-hand sides alone"
    beside = f"{swarm['times_faster_than_pinocchio'][0]:.1f} times faster than Pinocchio"
    what = f"{swarm['starts']} starts, {swarm['steps']} steps of RK4"
    found = [["irb140", what, ours, beside, f"difference {swarm['difference']:.0e}"]]
    for row in single:
        beside = f"{row['times_slower']['simulate'][0]:.2f} times slower than Pinocchio"
        errors = f"error {row['errors']['simulate']:.0e}, Pinocchio's {row['errors']['pinocchio']:.0e}"
        what = f"free swing, {row['method']} at {row['setting']}"
        found.append(["ur5", what, f"{row['seconds']['simulate']:.2f} s", beside, errors])
    for k, loop in enumerate(loops):
        ours = f"{loop['evaluations']} evaluations, RK45 {loop['RK45_evaluations']}"
        beside = f"{loop['auto_times_faster'][0]:.0f} times faster than RK45"
        found.append(["irb140", f"closed loop 6.5-{k + 1}, auto", ours, beside, f"difference {loop['difference']:.0e}"])
    return found


def main() -> None:
    quick = is_quick(__doc__)
    swarm = ensemble(100, 5, 1) if quick else ensemble(10_000, 100, 10)
    single = trajectories(0.2, 1) if quick else trajectories(10.0, 5)
    loops = closed_loops(1, 0.02) if quick else closed_loops(3, 5.0)
    print(table(["robot", "what", "rne", "beside", "positions at the end [rad]"], lines(swarm, single, loops)))
    if not quick:
        write("simulation.json", {"ensemble": swarm, "ur5": single, "closed_loops": loops})


if __name__ == "__main__":
    main()
