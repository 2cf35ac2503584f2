"""The README's chart, from the results that `python -m benchmarks` keeps: python -m benchmarks.readme_picture

Error against time of the UR5: inverse dynamics of a batch of states, and a free swing, for a light and a dark page.
"""

from __future__ import annotations

import json
from typing import Any

from benchmarks.integration_picture import DRIFT
from benchmarks.measure import RESULTS
from benchmarks.pages import DOCS
from rne.plotting.plots import blank_figure

NUMBA, NUMPY, PINOCCHIO, MUJOCO = "rne, machine code", "rne, NumPy", "Pinocchio", "MuJoCo"
CALLS = {
    NUMBA: "Numba kernel, batch",
    NUMPY: "kernel, batch",
    PINOCCHIO: "Pinocchio, batch",
    MUJOCO: "MuJoCo, one state",
}
METHODS = {NUMBA: ("numba", "DOP853"), NUMPY: ("numpy", "DOP853"), PINOCCHIO: ("pinocchio", "DOP853")}
METHODS |= {MUJOCO: ("mujoco", "RK4")}
THEMES = {  # ink, then the colours of the four
    "": ("#24292f", ("#2a7f3e", "#0b62a4", "#c8501e", "#6a6a6a")),
    "_dark": ("#d1d9e0", ("#56c271", "#5aa9ec", "#ff8c5a", "#a5a5a5")),
}
MARKERS = "osD^"


def picture(charts: dict[str, Any], theme: str) -> Any:
    """Two panels and a legend, with a transparent background."""
    import matplotlib as mpl

    ink, colors = THEMES[theme]
    names = ("text.color", "axes.labelcolor", "axes.edgecolor", "axes.titlecolor", "xtick.color", "ytick.color")
    with mpl.rc_context(dict.fromkeys(names, ink) | {"font.size": 11, "axes.titlesize": 11, "axes.facecolor": "none"}):
        figure = blank_figure(9.0, 3.9)
        left, right = figure.subplots(1, 2)
        rows = charts["evaluation"]["robots"]["ur5"]["inverse_dynamics"]
        runs = charts["integration"]["drift-10"]["robots"]["ur5"]["runs"]
        for (who, call), color, marker in zip(CALLS.items(), colors, MARKERS, strict=True):
            look = {"color": color, "marker": marker, "markersize": 7, "label": who}
            left.plot(rows[call]["ns_per_state"], rows[call]["worst_error"], linestyle="", **look)
            way, method = METHODS[who]
            chosen = [run for run in runs if run["method"] == method and way in run["seconds"]]
            times = [1e3 * run["seconds"][way] for run in chosen]
            right.plot(times, [run["errors"][way] for run in chosen], **look)
        left.set(
            title="inverse dynamics of 20 000 states", xlabel="time per state [ns]", ylabel="largest relative error [1]"
        )
        left.set(xlim=(20, 2e4), ylim=(1e-16, 1e-14))
        right.set(title="free swing of 10 s", xlabel="time [ms]", ylabel=DRIFT.replace(", ", ",\n"))
        for ax in (left, right):
            ax.set(xscale="log", yscale="log")
            ax.grid(True, alpha=0.25)
        figure.suptitle("UR5, error against time: lower left is better", fontsize=12)
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, labelcolor=ink)
    return figure


def write_pictures(charts: dict[str, Any]) -> None:
    """For both themes."""
    for theme in THEMES:
        picture(charts, theme).savefig(DOCS / "pictures" / f"speed_and_accuracy{theme}.png", transparent=True, dpi=180)


if __name__ == "__main__":
    write_pictures(json.loads((RESULTS / "charts.json").read_text(encoding="utf-8"))["charts"])
