"""CPU time of `rne.identify` with the robot of a log, with others, and of a log without motion; of reading a log.

python -m benchmarks.identification_times [ROBOT ...] prints each and its ratio: to the fit of the right robot, and of
`Record.from_csv` to numpy.loadtxt. The log is that of a UR5 of tests/faulty_logs.py without a fault.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import rne
from rne.identification import Record
from tests.faulty_logs import case, clean, robots

ROWS, FORMATS = 50_000, ("%.18e", "%.9g")


def seconds(call: Callable[[], Any], runs: int = 2) -> float:
    """Least CPU time of some runs, the first of which compiles; errors are answers too."""
    spent = []
    for _ in range(runs):
        start = time.process_time()
        with suppress(ValueError), warnings.catch_warnings(action="ignore"):
            call()
        spent.append(time.process_time() - start)
    return min(spent)


def main() -> None:
    log, own = clean(case("UR5", 3)), robots()["UR5"]
    still = np.repeat(log.q[:1], len(log.t), axis=0)
    asked = {name: (rne.load(name), log.q) for name in sys.argv[1:] or ("ur10", "irb140", "kinova")}
    asked |= {"torques of another motion": (own, log.q[::-1]), "no motion": (own, still)}
    right = seconds(lambda: rne.identify(own, Record(log.t, log.q, log.tau)), 3)
    print(f"{'UR5':26} {right:6.2f} s")
    for name, (robot, q) in asked.items():
        spent = seconds(lambda robot=robot, q=q: rne.identify(robot, Record(log.t, q, log.tau)))
        print(f"{name:26} {spent:6.2f} s {spent / right:6.2f}", flush=True)
    joints = [f"j{k}" for k in range(6)]
    names = ["t", *(f"{x}.{joint}" for x in ("q", "qd", "tau") for joint in joints)]
    walk = np.cumsum(np.random.default_rng(0).normal(size=(ROWS, 18)), axis=0) * 1e-2
    for form in FORMATS:
        with TemporaryDirectory() as folder:
            file, table = Path(folder) / "log.csv", np.column_stack([np.arange(ROWS) / 500, walk])
            np.savetxt(file, table, form, ",", header=",".join(names))
            plain = seconds(lambda file=file: np.loadtxt(file, delimiter=","), 3)
            spent = seconds(lambda file=file: Record.from_csv(file, joints), 3)
        print(f"{f'from_csv of {form}':26} {spent:6.2f} s {spent / plain:6.2f}", flush=True)


if __name__ == "__main__":
    main()
