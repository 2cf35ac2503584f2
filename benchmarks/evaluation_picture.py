"""Chart A's picture: time per state against the error, for batches and for single calls, and the size of the batch."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks import batch_sizes
from benchmarks.cases import title
from benchmarks.evaluation import is_batch
from benchmarks.pictures import NUMBA, OTHER, OURS, PINOCCHIO, label_points, lay_out
from rne.plotting.plots import blank_figure

MARKERS = {"float32": "s", "float64": "o", "longdouble": "^"}
BATCHES, SINGLES = (3e-21, 1e-5), (3e-17, 3e-14)  # errors shown


def color(name: str) -> str:
    """By project, and by engine."""
    colors = {"Pinocchio": PINOCCHIO, "Numba": NUMBA, "kernel": OURS, "recursion": OURS}
    return next((color for begin, color in colors.items() if name.startswith(begin)), OTHER)


def picture(results: dict[str, Any]) -> Any:
    """For each robot a row of batches and one of single calls, a panel for each quantity; then the sizes of batches."""
    found = results["robots"]
    heights = [part for _ in found for part in (5.0, 2.3)] + [4.2]
    figure = blank_figure(17, sum(heights))
    grid = figure.subplots(len(heights), 3, squeeze=False, height_ratios=heights)
    figure.suptitle("Speed and accuracy of an evaluation (log scales); error against time: lower left is better")
    every = [(n, r) for quantities in found.values() for rows in quantities.values() for n, r in rows.items()]
    labels = []
    for k, (robot, quantities) in enumerate(found.items()):
        for axes, batch, limits in ((grid[2 * k], True, BATCHES), (grid[2 * k + 1], False, SINGLES)):
            times = [r["ns_per_state"] for n, r in every if is_batch(n) == batch]
            left, right = min(times) / 8, max(times) * 4
            for ax, (quantity, rows) in zip(axes, quantities.items(), strict=True):
                shown = {n: r for n, r in rows.items() if is_batch(n) == batch}
                kind = "batches" if batch else "one state per call"
                ax.set(xscale="log", yscale="log", xlim=(left, right), ylim=limits, xlabel="time per state [ns]")
                ax.set_title(f"{robot}: {title(quantity)}, {kind}", fontsize="medium")
                panel(ax, shown, left)
                labels.append((ax, shown))
            axes[0].set_ylabel("worst error of the states,\nrelative to largest entry [1]")
    batch_sizes.panels(grid[-1], results["batch_sizes"])
    lay_out(figure)
    for ax, rows in labels:
        points = [(r["ns_per_state"], r["worst_error"], label(n, r["batch"]), color(n)) for n, r in rows.items()]
        label_points(ax, points)
    return figure


def label(name: str, batch: int) -> str:
    """With the size of the batch; a call of one state as its panel's title says."""
    size = f"{batch:,}".replace(",", " ")
    return name.replace(", one state", "").replace("batch", f"batch of {size}")


def panel(ax: Any, rows: dict[str, Any], left: float) -> None:
    """A point for each call, and a line at the eps of each precision."""
    ax.grid(True, alpha=0.25)
    low, high = ax.get_ylim()
    for dtype, marker in MARKERS.items():
        eps = float(np.finfo(dtype).eps)
        if low < eps < high:
            ax.axhline(eps, color="0.6", linestyle=":", linewidth=0.9)
            ax.text(1.1 * left, eps / 1.15, f"eps of {dtype}", fontsize=7, color="0.45", va="top")
        for name, row in rows.items():
            if row["precision"] == dtype:
                ax.plot(row["ns_per_state"], row["worst_error"], marker, color=color(name), markersize=6)
