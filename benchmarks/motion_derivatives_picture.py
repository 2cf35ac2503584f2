"""The picture of gradients of a motion: error against time, by each way to them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.pictures import NUMBA, OTHER, OURS, PINOCCHIO, label_points, lay_out
from rne.plotting.plots import blank_figure

ERRORS = (1e-16, 1.0)  # shown
COLORS = {"rne, RK4, NumPy": OURS, "rne": NUMBA, "differences of MuJoCo": PINOCCHIO, "differences": "#8a5fa8"}
DASHED = "DOP853", "Euler"


def picture(rows: Sequence[dict[str, Any]]) -> Any:
    """One panel: a line for each way, along its steps, tolerances or shares, with its ends labelled."""
    figure = blank_figure(9.2, 6.2)
    ax = figure.subplots()
    times = [row["ms"] for row in rows]
    ax.set(xscale="log", yscale="log", xlim=(min(times) / 3, 9 * max(times)), ylim=ERRORS)
    ax.set_xlabel("CPU time of a gradient [ms]")
    ax.set_ylabel("worst error of a derivative by a share of a number, relative to the largest [1]")
    ax.set_title(
        "Gradient of a motion of 1 s by 36 numbers, UR5: error against time; lower left is better", fontsize="medium"
    )
    ax.grid(True, alpha=0.25)
    spots = []
    for by in dict.fromkeys(row["by"] for row in rows):
        own = [row for row in rows if row["by"] == by]
        points = [(row["ms"], max(row["error"], ERRORS[0])) for row in own]
        dash = "--" if any(word in by for word in DASHED) else "-"
        ax.plot(*zip(*points, strict=True), "o", linestyle=dash, color=_color(by), markersize=4, linewidth=0.8)
        labelled = own[0], own[-1], min(own, key=lambda row: row["error"])
        for row, point in zip(own, points, strict=True):
            if any(row is x for x in labelled):
                named = f"{by}, {row['setting']}" if row is own[0] else row["setting"]
                spots.append((*point, named, _color(by)))
        for x, y in [place for pair in pairwise(points) for place in np.geomspace(*pair, 12).tolist()]:
            ax.text(x, y, "o", fontsize=5, alpha=0, ha="center", va="center")  # keeps labels off the line
    lay_out(figure)
    label_points(ax, spots)
    return figure


def _color(by: str) -> str:
    return next((color for begin, color in COLORS.items() if by.startswith(begin)), OTHER)
