"""Simulations against Pinocchio's ABA: python -m benchmarks.simulation [--quick]

An ensemble of the IRB 140 by RK4, beside the raw cost of its right-hand sides and beside abaInParallel driving the
same RK4 in NumPy; one trajectory of the UR5 by SciPy's methods, beside Pinocchio's ABA under the same ones; "auto"
beside RK45 on the thesis's closed loops. Interleaved, one thread each. Writes benchmarks/results/simulation.json.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import rne
from benchmarks.kernels import robots
from benchmarks.measure import interleaved, ratio, write
from rne.analysis.pinocchio import Oracle
from rne.model.robots.abb_irb140 import CLOSED_LOOPS, KD, KP


def pinocchio_rk4(model: Any, q: np.ndarray, qd: np.ndarray, step: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
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
        k2 = slope(x + step / 2 * k1)
        k3 = slope(x + step / 2 * k2)
        k4 = slope(x + step * k3)
        x = x + step / 6 * (k1 + 2 * (k2 + k3) + k4)
    return x[:n].T, x[n:].T


def ensemble(count: int, steps: int, pieces: int) -> dict[str, Any]:
    """Ours, its raw right-hand sides, and Pinocchio's, from the same starts, piece by piece in turn."""
    robot, xml = robots()["irb140"]
    model = Oracle(robot.model, xml).theirs
    start = np.random.default_rng(0).uniform(-1, 1, (count, 6))
    step = 1e-3
    scene = rne.Scene(robot)
    x, t = np.concatenate([start, 0 * start], axis=1), np.zeros((count, 1))
    out = scene.kernel(t, x)
    ours_at, theirs_at = (start, 0 * start), (start, 0 * start)

    def raw() -> None:
        for _ in range(4 * steps):
            scene.kernel(t, x, out=out)

    def ours() -> None:
        nonlocal ours_at
        runs = rne.ensemble(scene, *ours_at, step * steps, step=step)
        ours_at = runs.q[-1], runs.qd[-1]

    def theirs() -> None:
        nonlocal theirs_at
        theirs_at = pinocchio_rk4(model, *theirs_at, step, steps)

    seconds = interleaved({"ours": ours, "raw": raw, "pinocchio": theirs}, pieces)
    return {
        "starts": count,
        "steps": steps * pieces,
        "seconds": sum(seconds["ours"]),
        "times_the_raw_cost": ratio(seconds, "ours", "raw"),
        "times_faster_than_pinocchio": ratio(seconds, "pinocchio", "ours"),
        "difference": float(np.abs(ours_at[0] - theirs_at[0]).max()),
    }


def trajectories(duration: float, repeats: int) -> dict[str, Any]:
    """One free swing of the UR5 by SciPy's methods, ours and Pinocchio's ABA."""
    robot, xml = robots()["ur5"]
    oracle = Oracle(robot.model, xml)
    model, data, n = oracle.theirs, oracle.data, robot.n
    rest = np.zeros(n)

    def aba(t: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[n:], pin.aba(model, data, x[:n], x[n:], rest)])

    start = np.full(n, 0.3)
    exact = rne.simulate(robot, start, rest, duration, method="DOP853", rtol=1e-12, atol=1e-13).q[-1]
    rows = {}
    for method, tolerance in (("DOP853", 1e-8), ("LSODA", 1e-10)):
        found: dict[str, Any] = {}

        def ours(m: str = method, r: float = tolerance, found: dict[str, Any] = found) -> None:
            found["ours"] = rne.simulate(robot, start, rest, duration, method=m, rtol=r, atol=r).q[-1]

        def theirs(m: str = method, r: float = tolerance, found: dict[str, Any] = found) -> None:
            x0 = np.concatenate([oracle.q(start), rest])
            found["theirs"] = solve_ivp(aba, (0.0, duration), x0, method=m, rtol=r, atol=r).y[:n, -1]

        seconds = interleaved({"ours": ours, "pinocchio": theirs}, repeats)
        rows[method] = {
            "rtol": tolerance,
            "seconds": statistics.median(seconds["ours"]),
            "times_slower_than_pinocchio": ratio(seconds, "ours", "pinocchio"),
            "error": float(np.abs(found["ours"] - exact).max()),
            "pinocchio_error": float(np.abs(found["theirs"] - oracle.q(exact)).max()),
        }
    return rows


def closed_loops(repeats: int, duration: float) -> list[dict[str, Any]]:
    """ "auto" beside RK45 on the thesis's three closed loops."""
    robot = rne.load("irb140")
    rows = []
    for run in CLOSED_LOOPS:
        scene = rne.Scene(robot, controller=rne.control.pd_gravity(robot, KP, KD, run.reference))
        rne.simulate(scene, run.start, [0] * 6, 1e-3)
        motions: dict[str, rne.Trajectory] = {}

        def simulated(
            method: str, s: rne.Scene = scene, start: Any = run.start, m: Any = motions
        ) -> Callable[[], None]:
            def go() -> None:
                m[method] = rne.simulate(s, start, [0] * 6, duration, method=method, t_eval=[0.0, duration])

            return go

        seconds = interleaved({"auto": simulated("auto"), "RK45": simulated("RK45")}, repeats)
        rows.append(
            {
                "evaluations": motions["auto"].evaluations,
                "RK45_evaluations": motions["RK45"].evaluations,
                "auto_times_faster": ratio(seconds, "RK45", "auto"),
                "apart_at_the_end": float(np.abs(motions["auto"].q[-1] - motions["RK45"].q[-1]).max()),
            }
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small, few repeats, nothing written")
    quick = parser.parse_args().quick
    start = time.perf_counter()
    swarm = ensemble(200 if quick else 10_000, 10 if quick else 100, 1 if quick else 10)
    print("| scene | what | ours | compared with Pinocchio or RK45 | error, theirs or difference [rad] |")
    print("|---|---|---|---|---|")
    print(
        f"| irb140 | {swarm['starts']} starts, {swarm['steps']} steps of RK4 | {swarm['seconds']:.1f} s, "
        f"{swarm['times_the_raw_cost'][0]:.2f} times the raw right-hand sides | "
        f"{swarm['times_faster_than_pinocchio'][0]:.1f} times faster | {swarm['difference']:.0e} |"
    )
    single = trajectories(0.5 if quick else 10.0, 1 if quick else 5)
    for method, row in single.items():
        print(
            f"| ur5 | free swing, {method} at {row['rtol']:g} | {row['seconds']:.2f} s | "
            f"{row['times_slower_than_pinocchio'][0]:.2f} times slower | "
            f"{row['error']:.0e}, {row['pinocchio_error']:.0e} |"
        )
    loops = closed_loops(1, 0.05) if quick else closed_loops(3, 5.0)
    for k, loop in enumerate(loops):
        print(
            f"| irb140 | 6.5-{k + 1}, auto | {loop['evaluations']} evaluations, RK45 {loop['RK45_evaluations']} | "
            f"{loop['auto_times_faster'][0]:.0f} times faster | {loop['apart_at_the_end']:.0e} |"
        )
    if not quick:
        write("simulation.json", {"ensemble": swarm, "ur5": single, "closed_loops": loops})
    print(f"in {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
