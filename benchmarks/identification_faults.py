"""Faults of measurements that an identification has to survive or to name: python -m benchmarks.identification_faults

The robots and faults of tests/faulty_logs.py: ten runs of each kind of fault, and clean logs. No parameters of
the fit give the friction of harmonic drives, so a run is wrong if its parameters differ from those of the same motion
without the fault, noise and delay by more than the 99.9 % point of chi-square; it is warned if an error or an
IdentificationWarning came, and named if the fault is among its first two causes. Writes
benchmarks/results/identification_faults.json, but for runs of some faults alone, or of logs by a noisy controller
(`--logged feedback`) and with uneven clocks (`--logged samples reader`: stamps of the samples, or of what read them).
"""

from __future__ import annotations

import argparse
from typing import Any

from benchmarks.identification_tables import rewrite_page
from benchmarks.measure import write
from tests.faulty_logs import FAULTS, LOGGED, Outcome, robots, run


def row_of(fault: str, outcomes: list[Outcome]) -> dict[str, Any]:
    """What became of the runs with one fault."""
    seen = [o for o in outcomes if not o.hidden]
    return {
        "fault": fault,
        "runs": len(seen),
        "equal": len(outcomes) - len(seen),
        "wrong": sum(o.wrong for o in seen),
        "good": sum(not o.wrong or o.named for o in seen),
        "silent": sum(o.wrong and not o.warned for o in seen),
        "warned": sum(o.warned for o in seen),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--clean", type=int, default=200)
    parser.add_argument("--logged", nargs="*", choices=LOGGED, default=[""])
    given = parser.parse_args()
    kinds, names, rows = ["clean", *FAULTS], list(robots()), []
    for fault in given.only or kinds:
        first, outcomes = 1000 * kinds.index(fault), []
        for k in range(given.clean if fault == "clean" else given.runs):
            outcomes.append(run(fault, names[k % len(names)], first + k, given.logged[k % len(given.logged)]))
            o = outcomes[-1]
            if given.verbose and (fault != "clean" or o.wrong or o.warned):
                marks = {"WRONG": o.wrong, "warned": o.warned, "named": o.named, "equal": o.hidden}
                said = " ".join(word for word, is_so in marks.items() if is_so)
                print(f"  {o.robot:8} {o.chi_square:8.3g} {said} {o.causes[:3]} {o.error[:110]}")
        rows.append(row_of(fault, outcomes))
        print(rows[-1], flush=True)
    if not given.only and given.logged == [""]:
        write("identification_faults.json", {"rows": rows})
        rewrite_page()


if __name__ == "__main__":
    main()
