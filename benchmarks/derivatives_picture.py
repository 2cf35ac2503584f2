"""The picture of derivatives: error against time per state, first order above, second order below."""

from __future__ import annotations

from typing import Any

from benchmarks.derivative_calls import HESSIAN
from benchmarks.pictures import NUMBA, OTHER, OURS, PINOCCHIO, label_points, lay_out
from rne.plotting.plots import blank_figure

COLORS = {"NumPy": OURS, "Numba": NUMBA, "Pinocchio": PINOCCHIO}
ERRORS = (1e-17, 1e-2)  # shown


def picture(results: dict[str, Any]) -> Any:
    """A row for each robot and function."""
    cases = results["robots"]
    figure = blank_figure(9.2, 3.3 * len(cases))
    grid = figure.subplots(len(cases), 2, squeeze=False)
    figure.suptitle("Derivatives: error against time per state in batches; lower left is better")
    panels = []
    for axes, (case, rows) in zip(grid, cases.items(), strict=True):
        times = [row["ns_per_state"] for row in rows.values()]
        for ax, second in zip(axes, (False, True), strict=True):
            shown = {n: r for n, r in rows.items() if r["order"] != "values" and (r["order"] == HESSIAN) == second}
            ax.set(xscale="log", yscale="log", xlim=(min(times) / 3, 8 * max(times)), ylim=ERRORS)
            ax.set_title(f"{case.replace('_', ' ')}, {'second' if second else 'first'} order", fontsize="medium")
            ax.set_xlabel("time per state [ns]")
            ax.grid(True, alpha=0.25)
            for name, row in shown.items():
                ax.plot(row["ns_per_state"], max(row["worst_error"], ERRORS[0]), "o", color=_color(name), markersize=6)
            panels.append((ax, shown))
    for ax in grid[:, 0]:
        ax.set_ylabel("worst error, relative to largest entry [1]")
    lay_out(figure)
    for ax, rows in panels:
        spots = [(r["ns_per_state"], max(r["worst_error"], ERRORS[0]), n, _color(n)) for n, r in rows.items()]
        label_points(ax, spots)
    return figure


def _color(name: str) -> str:
    return next((color for begin, color in COLORS.items() if name.startswith(begin)), OTHER)
