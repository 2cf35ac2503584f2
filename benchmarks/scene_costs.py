"""Costs of other numbers of a scene: python -m benchmarks.scene_costs [--quick] [--before FOLDER] [--only WORD]

Time of the processor from the change to the end of the first step, each in a process of its own in which the scene ran
once before: medians of 11 processes, with the smallest and largest. Processes share a folder for compiled code; what is
changed is new in every one, so that no folder holds it. The IRB 140 under PD control with friction and limits. With
`--before`, the same with the package of another folder, in turn. The last case is the text of a motion. Writes
benchmarks/results/scene_costs.json.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import rne

HERE = Path(__file__).resolve().parents[1]
MOMENT = 1e-6  # [s], one step
START = np.linspace(0.3, 0.8, 6)
KP, KD = np.array([400, 400, 200, 40, 40, 2.0]), np.array([60, 60, 30, 5, 5, 0.2])
COULOMB = np.array([4.0, 6.0, 4.0, 0.5, 0.5, 0.1])
EFFORT = np.array([160.0, 220.0, 160.0, 25.0, 25.0, 5.0])
LOAD = np.array([2.0, 0.04, 0.0, 0.1, 0.02, 0.0, 0.02, 0.0, 0.0, 0.02])  # about the link's origin
NAMES = {"controller.kp": KP, "friction.coulomb": COULOMB, "effort_limit": EFFORT}


def scene(arm: rne.Robot, gain: float = 1.0, friction: float = 1.0, limit: float = 1.0, **parts: Any) -> rne.Scene:
    """The scene, with gains, friction and limits by factors."""
    law = rne.control.pd_gravity(arm, gain * KP, KD, START + 0.1)
    resisting = rne.Friction(viscous=1.0, coulomb=friction * COULOMB)
    return rne.Scene(arm, controller=law, friction=resisting, effort_limit=limit * EFFORT, **parts)


def step(given: rne.Scene) -> rne.Trajectory:
    """A run of one step."""
    return rne.simulate(given, START, 0 * START, MOMENT)


def anew(**which: bool) -> Callable[[rne.Robot, float], Callable[[], object]]:
    """A scene built anew with other factors."""

    def ready(arm: rne.Robot, x: float) -> Callable[[], object]:
        step(scene(arm))
        return lambda: step(scene(arm, **dict.fromkeys(which, x)))

    return ready


def named(*names: str) -> Callable[[rne.Robot, float], Callable[[], object]]:
    """The scene with other numbers, by its method."""

    def ready(arm: rne.Robot, x: float) -> Callable[[], object]:
        base = scene(arm)
        step(base)
        return lambda: step(base.with_numbers({name: x * NAMES[name] for name in names}))

    return ready


def kept(arm: rne.Robot, x: float) -> Callable[[], object]:
    """Unchanged scene again."""
    base = scene(arm)
    step(base)
    return lambda: step(base)


def law(arm: rne.Robot, x: float) -> Callable[[], object]:
    """A law made anew in a scene of the same parts."""
    base = scene(arm)
    step(base)
    same: dict[str, Any] = {"friction": base.friction, "effort_limit": base.effort_limit}
    return lambda: step(rne.Scene(arm, controller=rne.control.pd_gravity(arm, KP, KD, START + 0.1), **same))


def payload(arm: rne.Robot, x: float) -> Callable[[], object]:
    """Another payload, when the program that takes bodies exists."""
    base = scene(arm, payload=rne.Payload(2.0, (0.02, 0.0, 0.05), 0.01 * np.eye(3)))
    step(base)
    step(base.with_numbers({"payload": LOAD}))
    return lambda: step(base.with_numbers({"payload": x * LOAD}))


def text(arm: rne.Robot, x: float) -> Callable[[], object]:
    """The text of a motion of a hundred samples."""
    motion = rne.simulate(scene(arm), START, 0 * START, 0.5, t_eval=np.linspace(0.0, 0.5, 100))
    return lambda: repr(motion)


Case = tuple[Callable[[rne.Robot, float], Callable[[], object]], float]
CASES: dict[str, Case] = {  # with the most that they shall take [ms]
    "the same scene": (kept, 7.0),
    "another gain": (anew(gain=True), 10.0),
    "another gain, with_numbers": (named("controller.kp"), 10.0),
    "other friction": (anew(friction=True), 10.0),
    "other friction, with_numbers": (named("friction.coulomb"), 10.0),
    "another limit": (anew(limit=True), 10.0),
    "another limit, with_numbers": (named("effort_limit"), 10.0),
    "all three, with_numbers": (named(*NAMES), 10.0),
    "an equal law": (law, 5.0),
    "an equal scene": (anew(), 5.0),
    "another payload, with_numbers": (payload, 12.0),
    "text of a motion": (text, 6.0),
}


def process(case: str, engine: str, x: float, folder: Path, cache: Path) -> float:
    """Milliseconds of a case in a process of its own, with the package of a folder."""
    environment = os.environ | {"PYTHONPATH": str(folder), "RNE_CACHE": str(cache / folder.name)}
    command = [sys.executable, "-P", __file__, case, engine, str(x)]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    return float(done.stdout)


def serve(case: str, engine: str, x: float) -> None:
    """Print the milliseconds of a case in this process."""
    call = CASES[case][0](rne.load("irb140", engine=engine), x)
    begun = time.process_time()
    call()
    print(1e3 * (time.process_time() - begun))


def measured(cases: list[str], engines: tuple[str, ...], folders: dict[str, Path], trials: int) -> list[dict[str, Any]]:
    """Each case by each engine and package: milliseconds of all processes, which take turns."""
    found: dict[tuple[str, str, str], list[float]] = {}
    with tempfile.TemporaryDirectory() as cache:
        for k in range(trials):
            for case in cases:
                for engine in engines:
                    for who, folder in folders.items():
                        if who == "now" or "with_numbers" not in case:
                            spent = process(case, engine, 1.1 + 0.01 * k, folder, Path(cache))
                            found.setdefault((case, engine, who), []).append(spent)
    keys = ("case", "engine", "package")
    return [dict(zip(keys, key, strict=True)) | {"target_ms": CASES[key[0]][1], "ms": ms} for key, ms in found.items()]


def main() -> None:
    from benchmarks.cases import engines
    from benchmarks.measure import command_line, write
    from benchmarks.pages import table

    parser = command_line(__doc__)
    parser.add_argument("--before", type=Path, help="folder of another version of this repository")
    parser.add_argument("--only", default="", help="cases with this word in their names")
    given = parser.parse_args()
    folders = {"now": HERE} | ({} if given.before is None else {"before": given.before.resolve()})
    cases = [case for case in CASES if given.only in case][: 1 if given.quick else None]
    rows = measured(cases, engines(), folders, 1 if given.quick else 11)
    lines = [[r["case"], r["engine"], r["package"], f"{r['target_ms']:g}", _figures(r["ms"])] for r in rows]
    print(table(["case", "engine", "package", "at most [ms]", "irb140"], lines))
    if not given.quick and not given.only:
        write("scene_costs.json", {"duration": MOMENT, "rows": rows})


def _figures(ms: list[float]) -> str:
    return f"{median(ms):.1f} ({min(ms):.1f} to {max(ms):.1f})"


if __name__ == "__main__":
    if len(sys.argv) == 4 and sys.argv[1] in CASES:
        serve(sys.argv[1], sys.argv[2], float(sys.argv[3]))
    else:
        main()
