"""Share of the fuzz's scenes that run entirely in machine code: without a step of SciPy's solvers.

Counted are scenes without a law or with one that is traced, and with a method that has a loop in machine code.
"""

from __future__ import annotations

import warnings
from collections import Counter
from typing import Any

from scipy.integrate import OdeSolver

import rne
from tests.fuzz.scenes import draw

METHODS = ("auto", "RK45", "DOP853")


def run(count: int, engine: str = "numba") -> dict[str, Any]:
    """Runs of the scenes of the first seeds; for each with steps of SciPy's, their number and the run's message."""
    cases = [case for case in map(draw, range(count)) if case.method in METHODS and _is_traced(case.law)]
    found = {case.seed: of_case(case, engine) for case in cases}
    others = {seed: f"{steps} steps: {words}" for seed, (steps, words) in found.items() if steps}
    return {"scenes": len(found), "wholly": len(found) - len(others), "others": others}


def _is_traced(law: dict[str, Any] | None) -> bool:
    return law is None or law["kind"] == "traced" or law["kind"].startswith("control.")


def of_case(case: Any, engine: str) -> tuple[int, str]:
    """Steps that SciPy's solvers took, and the message of the run."""
    steps, names = Counter[str](), {}
    step = OdeSolver.step

    def counted(solver: Any) -> Any:
        steps[type(solver).__name__] += 1
        return step(solver)

    OdeSolver.step = counted
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            exec(case.script(engine), names)
        words = names["motion"].message
    except rne.SimulationError as error:
        words = str(error)
    finally:
        OdeSolver.step = step
    return steps.total(), f"{case.method}, {words}"
