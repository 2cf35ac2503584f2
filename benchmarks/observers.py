"""One tick of observers on a controller: python -m benchmarks.observers [--quick]

CPU time of a call of compiled laws by `into`, in machine code, calls in turn: PD with gravity compensation of the IRB
140 alone, and with observers of contacts and of a payload in it. Writes benchmarks/results/observers.json and the table
of docs/observers.md.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import rne
from benchmarks.measure import QUICK_NOTE, interleaved, is_quick, many, nanoseconds, write
from benchmarks.pages import DOCS, rewrite, table

STEP = 1e-3  # s
CALLS, REPEATS = 5000, 31
QUICK_CALLS, QUICK_REPEATS = 50, 3
Q, QD = np.array([0.1, -0.4, 0.3, 0.2, 0.5, -0.1]), np.array([0.3, 0.2, -0.4, 0.5, -0.1, 0.6])

Results = dict[str, Any]


def laws() -> dict[str, Any]:
    """Laws to be timed, by their names in the table."""
    arm = rne.load("irb140", engine="numba")
    hold, friction = rne.control.pd_gravity(arm, 400, 40, 0), rne.Friction(viscous=5.0, coulomb=4.0)
    factors = 1 + 0.05 * np.random.default_rng(1).choice([-1, 1], (6, 6))
    cases = [arm.with_parameters(np.repeat(f, 10) * arm.parameters) for f in factors]
    contacts = rne.control.MomentumObserver(arm, friction=friction, friction_error=0.2, floor=0.5)
    between = rne.control.MomentumObserver(arm, friction=friction, friction_error=0.2, floor=0.5, cases=cases)
    return {
        "PD with gravity compensation": hold,
        "with contacts": contacts.law(hold, hold, sample_time=STEP),
        "with contacts, six cases": between.law(hold, hold, sample_time=STEP),
        "with a payload": rne.control.payload_observer(arm, law=hold, friction=friction, sample_time=STEP),
    }


def run(quick: bool) -> Results:
    """Times, states and operations of each law."""
    calls, rows = dict[str, Callable[[], Any]](), dict[str, Any]()
    for name, law in laws().items():
        kernel, states = rne.control.compiled(law), getattr(law, "states", 0)
        given = [np.zeros(1), Q.copy(), QD.copy(), *([np.zeros(states)] if states else [])]
        into, out = kernel.into, np.empty(6 + states)
        into(*given, out)
        if states:
            given[-1][:] = out[6:]
        calls[name] = lambda into=into, given=given, out=out: into(*given, out)
        rows[name] = {"states": states, "operations": sum(kernel.operations.values())}
    count, repeats = (QUICK_CALLS, QUICK_REPEATS) if quick else (CALLS, REPEATS)
    seconds = interleaved({k: many(f, count) for k, f in calls.items()}, repeats, clock=time.process_time)
    return {k: row | {"ns": nanoseconds([s / count for s in seconds[k]])} for k, row in rows.items()}


def tables(results: Results) -> dict[str, str]:
    """The table of the page."""
    rows = [[k, str(x["states"]), str(x["operations"]), f"{x['ns'] / 1e3:.2f}"] for k, x in results.items()]
    return {"observers": table(["law", "states", "operations", "CPU time of a call [us]"], rows)}


def main() -> None:
    quick = is_quick(__doc__)
    results = run(quick)
    print(tables(results)["observers"])
    if quick:
        print(QUICK_NOTE)
        return
    write("observers.json", results)
    rewrite(tables(results), DOCS / "observers.md")


if __name__ == "__main__":
    main()
