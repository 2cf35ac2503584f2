"""When precision is lost: python -m benchmarks.stability [--quick]

Every method on every family of tests/stability, against 50 digits, and simulations at their limits. Writes
benchmarks/results/stability.json, and the tables and pictures of the pages in docs/stability, whose
text is written by hand.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import mpmath

import rne
from benchmarks import motions, motions_pictures
from benchmarks.measure import is_quick, write
from benchmarks.pages import DOCS, rewrite, table
from benchmarks.peers.pinocchio import Pinocchio
from tests.random_robots import straight_chain
from tests.stability.families import FAMILIES, Case, case, straight, subjects
from tests.stability.far_file import exact_model, far_text
from tests.stability.structured import DIGITS, measure

PAGES = tuple(DOCS / "stability" / f"{name}.md" for name in ("evaluation", "simulation", "long-motions"))
HEAD = ["family", "quantity", "worst case", "error", "condition", "error / (eps condition)", "remarks"]


def far_origins() -> Iterator[tuple[Case, Any]]:
    """Robots loaded from files with joint origins up to 1e6 m away along their axes, and the files' exact numbers."""
    for name, model in subjects():
        text = far_text(model, 1e6)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "far.urdf"
            path.write_text(text, encoding="utf-8")
            loaded = rne.load(path).model
        with mpmath.workdps(DIGITS):
            exact = exact_model(text, loaded)
        yield case(f"{name}, a URDF with joint origins slid to 1e6 m", loaded), exact


def pinocchio(one: Case) -> dict[str, Any]:
    """Pinocchio's methods on our own numbers, as in METHODS; none where it cannot be given them."""
    try:
        oracle = Pinocchio(one.model, [one.q, one.qd, one.qdd]).oracle
    except ValueError as error:
        print(f"Pinocchio is left out of {one.name}: {error}", file=sys.stderr)
        return {}
    calls = {
        "inverse dynamics": oracle.inverse_dynamics,
        "mass matrix": oracle.mass_matrix,
        "forward dynamics": oracle.forward_dynamics,
    }
    return {quantity: {", Pinocchio": partial(_ours, call)} for quantity, call in calls.items()}


def _ours(call: Any, _model: rne.Model, *state: Any) -> Any:
    return call(*state)


def rows(family: str, cases: list[tuple[Case, Any]]) -> list[dict[str, Any]]:
    """One row per method: the worst case of the family."""
    worst: dict[str, dict[str, Any]] = {}
    refused: dict[str, list[str]] = {}
    for one, exact in cases:
        found = measure(one, perturbations=1 if one.model.n > 60 else 3, exact_model=exact, others=pinocchio(one))
        for method, measured in found.items():
            if measured.refused:
                refused.setdefault(method, []).append(one.name)
            row = {"family": family, "method": method, "case": one.name, "n": one.model.n, **measured._asdict()}
            row["ratio"] = measured.ratio
            if method not in worst or row["ratio"] / row["n"] > worst[method]["ratio"] / worst[method]["n"]:
                worst[method] = row
    return [row | {"refused_cases": refused.get(method, [])} for method, row in worst.items()]


def cells(row: dict[str, Any]) -> list[str]:
    """A line of the table."""
    remark = "`PrecisionWarning`" if row["warned"] else ""
    if row["refused_cases"]:
        remark = f"`SingularMassMatrixError` on {', '.join(row['refused_cases'])}"
    ratio = f"{row['ratio']:.2g}"
    beyond = row["ratio"] > 10 * row["n"]
    figures = [f"{row['error']:.1e}", f"{row['condition']:.1e}", f"**{ratio}**" if beyond else ratio]
    return [row["family"], row["method"], row["case"], *figures, remark]


def evaluation(quick: bool) -> list[dict[str, Any]]:
    """The rows of every family, or of one."""
    found: list[dict[str, Any]] = []
    for family, cases in FAMILIES.items():
        if quick and family != "base far away":
            continue
        members: list[tuple[Case, Any]] = [(one, None) for one in cases()]
        if family == "straight chains" and not quick:
            members.append((case("straight chain, n = 100", straight_chain(100), straight(100), count=1), None))
        found += rows(family, members)
    return found if quick else found + rows("slid joint origins", list(far_origins()))


def main() -> None:
    quick = is_quick(__doc__)
    found = evaluation(quick)
    tables = {"families": table(HEAD, map(cells, found))}
    if not quick:
        moved = json.loads(json.dumps(motions.run()))
        tables |= motions.tables(moved)
        write("stability.json", {"evaluation": found, "simulation": moved})
        pictures = {"families": motions_pictures.families(found)}
        pictures |= {name: getattr(motions_pictures, name)(moved) for name in ("steps", "effort", "growth")}
        for name, figure in pictures.items():
            figure.savefig(DOCS / "stability" / f"{name}.png", facecolor="white")
        rewrite(tables, *PAGES)
    print("\n\n".join(tables.values()))


if __name__ == "__main__":
    main()
