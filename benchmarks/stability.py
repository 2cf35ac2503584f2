"""Where methods fail, docs/stability.md: python -m benchmarks.stability [--quick]

Every method on every family of tests/stability, against 50 digits.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mpmath

import rne
from rne.robots.chains import straight_chain
from tests.stability.families import FAMILIES, Case, case, straight, subjects
from tests.stability.far_file import exact_model, far_text
from tests.stability.known import KNOWN
from tests.stability.structured import DIGITS, Measured, measure

OUT = Path(__file__).parent.parent / "docs" / "stability.md"
INTRODUCTION = """# Where methods fail

Errors in float64 against 50 digits, written by `python -m benchmarks.stability`. *Error* is relative to the largest
entry; for M, to its diagonal. *Condition* is the structured one: by how much a small relative change of every number
of the robot and of the state (entries of rotations and axes each by itself, angles relative to at most pi) is
amplified in the result, and at least 1, found by perturbing in 50 digits. Each row shows the case of its family where
error / (eps condition) is largest; `tests/stability` asserts that it stays below 10 n, or that
`SingularMassMatrixError` is raised, except where the last column says what to use instead. *Compiled* is what a
`Robot`'s methods run. A large error beside a small last figure is no fault of the method: the robot's numbers, rounded
to float64, do not say more; give the arguments as `np.longdouble` if they are known better.
`robot.diagnose(q)` estimates the digits that forward dynamics keep.

"""
HEAD = (
    "| family | quantity | worst case | error | condition | error / (eps condition) | use instead |\n"
    + "|---" * 7
    + "|\n"
)


def far_origins() -> Iterator[tuple[Case, Any]]:
    """Robots loaded from files with joint origins up to 1e6 m away along their axes, and exactly the files' numbers."""
    for name, model in subjects():
        text = far_text(model, 1e6)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "far.urdf"
            path.write_text(text, encoding="utf-8")
            loaded = rne.load(path).model
        with mpmath.workdps(DIGITS):
            exact = exact_model(text, loaded)
        yield case(f"{name}, a URDF with joint origins slid to 1e6 m", loaded), exact


def rows(family: str, cases: list[tuple[Case, Any]]) -> list[str]:
    """One row a method: the worst case of the family."""
    worst: dict[str, tuple[float, str, Measured]] = {}
    refused: dict[str, list[str]] = {}
    for one, exact in cases:
        found = measure(one, perturbations=1 if one.model.n > 60 else 3, exact_model=exact)
        for method, measured in found.items():
            if measured.refused:
                refused.setdefault(method, []).append(one.name)
            key = (measured.ratio / one.model.n, one.name, measured)
            if method not in worst or key[0] > worst[method][0]:
                worst[method] = key
    lines = []
    for method, (_, name, m) in worst.items():
        known = KNOWN.get((name, method))
        instead = known.instead if known else ""
        if method in refused:
            instead = f"mpmath numbers for {', '.join(refused[method])}, refused as singular"
        ratio = f"**{m.ratio:.2g}**" if known else f"{m.ratio:.2g}"
        lines.append(f"| {family} | {method} | {name} | {m.error:.1e} | {m.condition:.1e} | {ratio} | {instead} |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one family, and no file is written")
    quick = parser.parse_args().quick
    table = HEAD
    for family, cases in FAMILIES.items():
        if quick and family != "base far away":
            continue
        members: list[tuple[Case, Any]] = [(one, None) for one in cases()]
        if family == "straight chains" and not quick:
            members.append((case("straight chain, n = 100", straight_chain(100), straight(100), count=1), None))
        table += "\n".join(rows(family, members)) + "\n"
    if not quick:
        table += "\n".join(rows("slid joint origins", list(far_origins()))) + "\n"
    print(table)
    if not quick:
        OUT.write_text(INTRODUCTION + table, encoding="utf-8")


if __name__ == "__main__":
    main()
