"""A dozen scenes with dry friction, stops and limits, as this tree and another run them.

Each tree has a process of its own, which runs a scene when it is asked to: so the runs of both take turns. This file is
executed with the other tree first on the path, and imports nothing but rne.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import rne

OFFERED = (
    *("t", "q", "qd", "qdd", "tau", "kinetic", "potential", "energy", "work", "energy_drift", "dissipated", "balance"),
    *("controller_state", "jumps", "qdd_before", "tau_before"),
)  # what a trajectory has
KP, KD = (400, 400, 200, 1, 1, 0.02), (60, 60, 30, 0.1, 0.1, 0.002)
TARGET = (1, 0, -1, 2, 1, -2)
COULOMB = np.array([4.0, 6.0, 4.0, 0.5, 0.5, 0.1])
EFFORT = np.array([60.0, 120.0, 60.0, 5.0, 5.0, 1.0])
Row = dict[str, Any]
DRY = rne.Friction(viscous=1.0, coulomb=COULOMB, smoothing=0)


def scenes(engine: str) -> dict[str, tuple[rne.Scene, float]]:
    """By name: the scene and its duration [s]."""
    arm, ur5 = rne.load("irb140", engine=engine), rne.load("ur5", engine=engine)
    pd = rne.control.pd_gravity(arm, KP, KD, TARGET)
    pid = rne.control.pid(arm, KP, np.array(KP) / 2, KD, TARGET)
    path = rne.control.computed_torque(arm, 100, 20, rne.trajectories.quintic(np.zeros(6), 0.5 * np.array(TARGET), 1.0))
    ur5_pd = rne.control.pd_gravity(ur5, 200, 30, TARGET)
    static = rne.Friction(viscous=0.5, coulomb=COULOMB, static=1.5 * COULOMB, smoothing=0)
    sampled = {"controller": pd, "sample_time": 1e-3, "friction": DRY}
    limited = {"payload": 2.0, "effort_limit": 2 * EFFORT}
    return {
        "irb140, dry friction": (rne.Scene(arm, friction=DRY), 2.0),
        "irb140, static friction": (rne.Scene(arm, friction=static), 2.0),
        "irb140, PD, dry friction": (rne.Scene(arm, friction=DRY, controller=pd), 2.0),
        "irb140, PD, dry friction, effort limit": (
            rne.Scene(arm, friction=DRY, controller=pd, effort_limit=EFFORT),
            2.0,
        ),
        "irb140, PD, effort limit": (rne.Scene(arm, friction=rne.Friction(1.0), controller=pd, effort_limit=EFFORT), 2),
        "irb140, PID, dry friction, effort limit": (
            rne.Scene(arm, friction=DRY, controller=pid, effort_limit=EFFORT),
            2.0,
        ),
        "irb140, computed torque, dry friction": (rne.Scene(arm, friction=DRY, controller=path), 1.5),
        "irb140, PD at 1 kHz, dry friction": (rne.Scene(arm, **sampled), 1.0),
        "irb140, PD at 1 kHz, dry friction, effort limit, torque rate": (
            rne.Scene(arm, **sampled, effort_limit=EFFORT, torque_rate=20 * EFFORT),
            1.0,
        ),
        "irb140, stops": (rne.Scene(arm, stops=True), 2.0),
        "ur5, dry friction": (rne.Scene(ur5, friction=DRY), 2.0),
        "ur5, PD, dry friction, effort limit, stops, payload": (
            rne.Scene(ur5, friction=DRY, controller=ur5_pd, stops=True, **limited),
            2.0,
        ),
    }


def read(motion: rne.Trajectory) -> rne.Trajectory:
    """The trajectory, after all that it offers has been asked for."""
    for name in OFFERED:
        getattr(motion, name)
    return motion


def serve(engine: str, shortened: float) -> None:
    """Run the scenes whose names are read, and print the seconds of the run and of reading, and how it ended."""
    there = scenes(engine)
    q0 = np.linspace(0.3, 0.8, 6)
    print(json.dumps(list(there)), flush=True)
    for line in sys.stdin:
        scene, duration = there[json.loads(line)]
        begun = time.perf_counter()
        motion = rne.simulate(scene, q0, 0 * q0, duration * shortened)
        done = time.perf_counter()
        read(motion)
        found = {"run": done - begun, "read": time.perf_counter() - begun, "message": motion.message}
        found |= {"t": float(motion.t[-1]), "q": motion.q[-1].tolist(), "evaluations": int(motion.evaluations)}
        print(json.dumps(found), flush=True)


class Tree:
    """A process that runs the scenes with the package of one folder."""

    def __init__(self, folder: Path, engine: str, shortened: float) -> None:
        arguments = [sys.executable, "-P", __file__, engine, str(shortened)]
        environment = os.environ | {"PYTHONPATH": str(folder)}
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        self.process = subprocess.Popen(arguments, env=environment, text=True, **pipes)  # type: ignore[call-overload]
        self.names: list[str] = self._answer()

    def _answer(self) -> Any:
        return json.loads(self.process.stdout.readline())

    def run(self, name: str) -> dict[str, Any]:
        """One run."""
        self.process.stdin.write(json.dumps(name) + "\n")
        self.process.stdin.flush()
        found: dict[str, Any] = self._answer()
        return found

    def close(self) -> None:
        """End the process."""
        self.process.stdin.close()
        self.process.wait()


def compare(before: Path | None, engines: tuple[str, ...], repeats: int, shortened: float = 1.0) -> list[Row]:
    """Each scene by each engine in this tree, and in the one before if there is one."""
    folders = {"now": Path(__file__).resolve().parents[1]} | ({} if before is None else {"before": before})
    return [row for engine in engines for row in _of_engine(folders, engine, repeats, shortened)]


def _of_engine(folders: dict[str, Path], engine: str, repeats: int, shortened: float) -> list[Row]:
    trees = {who: Tree(folder, engine, shortened) for who, folder in folders.items()}
    try:
        return [_row(name, engine, trees, repeats) for name in trees["now"].names]
    finally:
        for tree in trees.values():
            tree.close()


def _row(name: str, engine: str, trees: dict[str, Tree], repeats: int) -> Row:
    first = {who: tree.run(name) for who, tree in trees.items()}
    runs = [{who: tree.run(name) for who, tree in trees.items()} for _ in range(repeats)]
    row: Row = {"scene": name, "engine": engine, "message": first["now"]["message"]}
    for what in ("run", "read"):
        seconds = {who: statistics.median(run[who][what] for run in runs) for who in trees}
        row |= {f"{what}_seconds": seconds, f"{what}_first": {who: first[who][what] for who in trees}}
        if "before" in trees:
            pairs = [run["before"][what] / run["now"][what] for run in runs]
            row[f"{what}_times_faster"] = (seconds["before"] / seconds["now"], min(pairs), max(pairs))
    if "before" in trees:
        row["difference"] = float(np.abs(np.subtract(first["now"]["q"], first["before"]["q"])).max())
        row["time_difference"] = abs(first["now"]["t"] - first["before"]["t"])
    return row


if __name__ == "__main__":
    serve(sys.argv[1], float(sys.argv[2]))
