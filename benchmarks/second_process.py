"""Delays in a new process: import, load, the first batch, swing and closed loop, and the same with other numbers.

Processes of both engines take turns; they share a folder for compiled code, which one process of each has filled. Other
numbers are new in every process, so that no folder holds them.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.measure import ratio

STAGES = ("import", "load", "batch", "swing", "closed loop")
OTHERS = ("payload", "other payload", "gain", "other gain")
CODE = """
import json, sys, time
stamps = [("start", time.perf_counter())]
def done(stage):
    stamps.append((stage, time.perf_counter()))
import numpy as np
import rne
done("import")
engine, number, duration = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
arm = rne.load("irb140", engine=engine)
done("load")
q = np.linspace(-1, 1, 6000).reshape(1000, 6)
arm.inverse_dynamics(q, q, q)
done("batch")
start, still = np.linspace(0.3, 0.8, 6), np.zeros(6)
rne.simulate(arm, start, still, duration)
done("swing")
gains = (50, 50, 50, 50, 50, 60), np.array((20, 20, 20, 20, 20, 22))
def loop(factor):
    law = rne.control.pd_gravity(arm, gains[0], factor * gains[1], (1, 0, -1, 2, 1, -2))
    rne.simulate(rne.Scene(arm, controller=law), still, still, duration)
loop(1.0)
done("closed loop")
for name, mass in (("payload", 2.0), ("other payload", 2.0 + number)):
    rne.simulate(rne.Scene(arm, payload=mass), start, still, duration)
    done(name)
for name, factor in (("gain", 1.5), ("other gain", 1.5 + number)):
    loop(factor)
    done(name)
print(json.dumps({name: t - before for (_, before), (name, t) in zip(stamps, stamps[1:])}))
"""


def run(engines: Sequence[str], repeats: int, duration: float = 1.0) -> dict[str, Any]:
    """Seconds of each stage by engine: of the first process, and medians of those after it."""
    with tempfile.TemporaryDirectory() as folder:
        first = {engine: process(engine, 0.1, duration, Path(folder)) for engine in engines}
        later: dict[str, list[dict[str, float]]] = {engine: [] for engine in engines}
        for k in range(repeats):
            for engine in engines:
                later[engine].append(process(engine, 0.2 + 0.001 * k + 0.0001 * len(engine), duration, Path(folder)))
    return {engine: of_engine(first[engine], later[engine], later["numpy"]) for engine in engines}


def of_engine(
    first: Mapping[str, float], runs: Sequence[Mapping[str, float]], numpy: Sequence[Mapping[str, float]]
) -> dict[str, Any]:
    """Seconds and ratios to NumPy's of the second process as a whole, and of each stage."""

    def times(stages: Sequence[str]) -> dict[str, Any]:
        seconds = {who: [sum(r[s] for s in stages) for r in many] for who, many in (("own", runs), ("numpy", numpy))}
        both = {"seconds": median(seconds["own"]), "times_numpy": ratio(seconds, "own", "numpy")}
        return both | {"first_process": sum(first[s] for s in stages)}

    return {"whole": times(STAGES)} | {stage: times([stage]) for stage in (*STAGES, *OTHERS)}


def process(engine: str, number: float, duration: float, folder: Path) -> dict[str, float]:
    """Seconds of the stages in a process of its own."""
    environment = os.environ | {"RNE_CACHE": str(folder / "rne"), "NUMBA_CACHE_DIR": str(folder / "numba")}
    command = [sys.executable, "-c", CODE, engine, str(number), str(duration)]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found
