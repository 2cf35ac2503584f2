"""Dynamics that travel, in one run: python -m benchmarks.elsewhere [--quick]

Inside CasADi, inside JAX and as C and Rust, beside what else is there: `benchmarks.elsewhere_casadi`, `elsewhere_jax`
and `elsewhere_c` one after the other. Writes benchmarks/results/elsewhere.json, the tables and
the picture of docs/benchmarks/export.md.
"""

from __future__ import annotations

from typing import Any

from benchmarks import elsewhere_c, elsewhere_casadi, elsewhere_jax
from benchmarks.measure import QUICK_NOTE, is_quick, write
from benchmarks.pages import DOCS, rewrite
from benchmarks.peers.registry import import_failure
from benchmarks.pictures import OTHER, OURS, label_points, lay_out
from rne.plotting.plots import blank_figure

PARTS = {"jax": elsewhere_jax, "casadi": elsewhere_casadi, "c": elsewhere_c}
ERRORS = (1e-17, 1e-4)  # shown


def run(quick: bool) -> dict[str, Any]:
    """All figures; without CasADi its part is left out."""
    return {
        name: part.run(quick) for name, part in PARTS.items() if name != "casadi" or import_failure("casadi") is None
    }


def tables(results: dict[str, Any]) -> dict[str, str]:
    """Every table of the page, by its name."""
    return {name: text for part, found in results.items() for name, text in PARTS[part].tables(found).items()}


def points(results: dict[str, Any]) -> dict[str, list[tuple[float, float, str]]]:
    """Time per state [ns], error and name of values of the UR5's inverse dynamics, by where they are computed."""
    inside = [(row["value_ns"], row["errors"]["value"], name) for name, row in results["jax"].get("calls", {}).items()]
    casadi = results.get("casadi", {}).get("ur5", {})
    machine = [(1e3 * row["us"]["function"], row["worst_error"], name) for name, row in casadi.items()]
    compiled = results["c"]["robots"].get("ur5", {})
    code = [(row["ns_per_state"], row["worst_error"], name) for name, row in compiled.items()]
    panels = {"inside JAX, 20 000 states": inside, "inside CasADi, one state": machine, "compiled by gcc, rustc": code}
    return {title: found for title, found in panels.items() if found}


def picture(results: dict[str, Any]) -> Any:
    """A panel for each place."""
    from matplotlib.ticker import LogLocator, NullFormatter

    panels = points(results)
    figure = blank_figure(6.5, 3.6 * len(panels))
    grid = figure.subplots(len(panels), 1, squeeze=False)[:, 0]
    figure.suptitle("Inverse dynamics of the UR5 elsewhere: error against time")
    theirs = (elsewhere_jax.FRAX, elsewhere_casadi.BY_HAND, elsewhere_casadi.ADAM, elsewhere_c.CASADI)
    for ax, (title, found) in zip(grid, panels.items(), strict=True):
        times = [time for time, _, _ in found]
        ax.set(xscale="log", yscale="log", xlim=(min(times) / 1.7, 2.6 * max(times)), ylim=ERRORS)
        ax.set_title(title, fontsize="medium")
        ax.set_xlabel("CPU time per state [ns]")
        ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        ax.xaxis.set_major_formatter("{x:g}")
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.grid(True, alpha=0.25)
        for time, error, name in found:
            ax.plot(time, max(error, ERRORS[0]), "o", color=OTHER if name in theirs else OURS, markersize=6)
        ax.set_ylabel("worst error, relative to\nlargest entry [1]")
    lay_out(figure)
    for ax, found in zip(grid, panels.values(), strict=True):
        label_points(ax, [(t, max(e, ERRORS[0]), name, OTHER if name in theirs else OURS) for t, e, name in found])
    return figure


def main() -> None:
    quick = is_quick(__doc__)
    results = run(quick)
    print("\n\n".join(f"{name}:\n\n{text}" for name, text in tables(results).items()))
    if quick:
        print(QUICK_NOTE)
        return
    write("elsewhere.json", results)
    picture(results).savefig(DOCS / "benchmarks" / "elsewhere.png", facecolor="white")
    rewrite(tables(results), DOCS / "benchmarks" / "export.md")


if __name__ == "__main__":
    main()
