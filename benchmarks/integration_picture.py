"""Chart B's picture: a panel for each comparison and robot, and one legend."""

from __future__ import annotations

from typing import Any

from benchmarks.pictures import NUMBA, OTHER, OURS, PINOCCHIO
from benchmarks.runs import WAYS
from rne.plotting.plots import blank_figure

COLORS = {"numba": NUMBA, "numpy": OURS, "pinocchio": PINOCCHIO, "mujoco": OTHER}
MARKERS = {
    "RK45": "o",
    "DOP853": "s",
    "LSODA": "^",
    "Rodas5P": "P",
    "Radau": "D",
    "BDF": "v",
    "gauss-4": "*",
    "Euler": "<",
    "implicit": ">",
    "implicitfast": "X",
    "RK4": "h",
}
ERROR, DRIFT = "error of the joint positions at the end [rad]", "energy drift, largest |E(t) - E(0)| [J]"
LABELS = {
    "sampled": "error of the joint positions at the samples [rad]",
    "ensemble": "median error of the joint positions at the end [rad]",
}
HEADS = {
    "closed-loop": "stiff closed loop for {1:g} s",
    "sampled": "PD sampled at 1 kHz for {1:g} s",
    "ensemble": "{0} free swings of {1:g} s",
}


def picture(results: dict[str, Any]) -> Any:
    """Work-precision lines."""
    from matplotlib.ticker import LogLocator, NullFormatter

    panels = [
        (f"{robot}, {_head(name, panel)}", _label(name), result)
        for name, panel in results.items()
        for robot, result in panel["robots"].items()
    ]
    rows = len(panels) // 2 + 1
    figure = blank_figure(9.4, 3.9 * rows)
    grid = figure.subplots(rows, 2, squeeze=False).ravel()
    figure.suptitle("Wall time against error: lower left is better (log scales)")
    for ax, (title, label, result) in zip(grid, panels, strict=False):
        lines(ax, result)
        ax.set(xscale="log", yscale="log", title=title, xlabel="wall time [ms]", ylabel=label)
        ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        ax.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.grid(True, alpha=0.25)
    for ax in grid[len(panels) :]:
        ax.axis("off")
    legend(grid[len(panels)], [row for _, _, result in panels for row in result["runs"]])
    return figure


def _head(name: str, panel: dict[str, Any]) -> str:
    return HEADS.get(name, "free swing of {1:g} s").format(panel.get("starts"), panel["duration"])


def _label(name: str) -> str:
    return DRIFT if name.startswith("drift") else LABELS.get(name, ERROR)


def lines(ax: Any, result: dict[str, Any]) -> None:
    """One for each method and way, and the uncertainty of the reference."""
    for who in WAYS:
        for method, marker in MARKERS.items():
            rows = [row for row in result["runs"] if row["method"] == method and who in row["seconds"]]
            seconds = [row["seconds"][who] * 1e3 for row in rows]
            errors = [row["errors"][who] for row in rows]
            size = 8 if marker in "*XP" else 5.5
            ax.plot(seconds, errors, marker=marker, markersize=size, linewidth=1.1, color=COLORS[who])
    uncertain = result.get("reference_uncertainty")
    if uncertain is None:
        return
    ax.axhline(uncertain, color="0.5", linestyle="--", linewidth=0.8)
    ax.annotate(
        "uncertainty of the reference",
        (0.02, uncertain),
        xycoords=("axes fraction", "data"),
        xytext=(0, 3),
        textcoords="offset points",
        fontsize=8,
        color="0.4",
    )


def legend(ax: Any, rows: list[dict[str, Any]]) -> None:
    """Colours and markers, in a cell of their own."""
    from matplotlib.lines import Line2D

    ways = [who for who in WAYS if any(who in row["seconds"] for row in rows)]
    methods = [m for m in MARKERS if any(row["method"] == m for row in rows)]
    lines = [Line2D([], [], marker="o", linewidth=1.6, label=WAYS[who], color=COLORS[who]) for who in ways]
    shapes = [Line2D([], [], color="0.2", marker=MARKERS[m], markersize=7, linestyle="", label=m) for m in methods]
    look = {"frameon": False, "fontsize": "large", "title_fontsize": "large", "alignment": "left"}
    ax.add_artist(ax.legend(handles=lines, title="Who: colour", loc="upper left", **look))
    ax.legend(handles=shapes, title="Method: marker", loc="upper left", bbox_to_anchor=(0.0, 0.6), ncols=2, **look)
