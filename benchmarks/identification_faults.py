"""Faults of measurements that an identification has to survive or to name: python -m benchmarks.identification_faults

The robots and faults of tests/faulty_logs.py: ten runs of each kind of fault, and clean logs. No parameters of
the fit give the friction of harmonic drives, so a run is wrong if its parameters differ from those of the same motion
without the fault, noise and delay by more than the 99.9 % point of chi-square; it is warned if an error or an
IdentificationWarning came, named if the fault is among its first two causes, and blamed if a cause other than friction
of gears is given. `--noisy` has logs by controllers that feed noise of the positions back and with uneven clocks, whose
stamps are those of the samples, or of what read them. Writes benchmarks/results/identification_faults.json, of some
faults alone with `--only`, and the tables of docs/benchmarks/identification.md. `--processes` share the runs.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from itertools import islice
from typing import Any

from benchmarks.identification_tables import rewrite_page
from benchmarks.measure import RESULTS, write
from tests.faulty_logs import FAULTS, LOGGED, Outcome, robots, run


def row_of(fault: str, outcomes: list[Outcome]) -> dict[str, Any]:
    """Results of the runs with one fault."""
    seen = [o for o in outcomes if not o.hidden]
    return {
        "fault": fault,
        "runs": len(seen),
        "equal": len(outcomes) - len(seen),
        "wrong": sum(o.wrong for o in seen),
        "good": sum(not o.wrong or o.named for o in seen),
        "silent": sum(o.wrong and not o.warned for o in seen),
        "warned": sum(o.warned for o in seen),
        "blamed": sum(o.blamed for o in seen),
    }


def text_of(o: Outcome) -> str:
    """A run in a line."""
    marks = {"WRONG": o.wrong, "warned": o.warned, "named": o.named, "equal": o.hidden, "blamed": o.blamed}
    said = " ".join(word for word, is_so in marks.items() if is_so)
    return f"  {o.robot:8} {o.seed} {o.chi_square:8.3g} {said} {o.causes[:3]} {o.error[:110]}"


def keep(kind: str, row: dict[str, Any], order: list[str]) -> None:
    """A row in the place of the last one of its fault."""
    kept = json.loads((RESULTS / "identification_faults.json").read_text(encoding="utf-8"))
    rows = {name: {r["fault"]: r for r in kept.get(name, [])} for name in ("rows", "noisy")}
    rows[kind][row["fault"]] = row
    write("identification_faults.json", {k: [found[f] for f in order if f in found] for k, found in rows.items()})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--clean", type=int, default=200)
    parser.add_argument("--noisy", action="store_true")
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args()
    kinds, names, logged = ["clean", *FAULTS], list(robots()), LOGGED[1:] if given.noisy else LOGGED[:1]
    chosen = [fault for fault in kinds if fault in (given.only or kinds)]
    tasks = []
    for fault in chosen:
        for k in range(given.clean if fault == "clean" else given.runs):
            seed = 1000 * kinds.index(fault) + k
            tasks.append((fault, names[k % len(names)], seed, logged[k // len(names) % len(logged)]))
    with ProcessPoolExecutor(given.processes) as pool:
        every = pool.map(run, *zip(*tasks, strict=True))
        for fault in chosen:
            outcomes = list(islice(every, sum(task[0] == fault for task in tasks)))
            for o in outcomes:
                if given.verbose and (fault != "clean" or o.wrong or o.warned):
                    print(text_of(o), flush=True)
            row = row_of(fault, outcomes)
            print(row, flush=True)
            keep("noisy" if given.noisy else "rows", row, kinds)
    rewrite_page()


if __name__ == "__main__":
    main()
