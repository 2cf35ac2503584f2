"""The chart of the start page, from the results that other benchmarks keep: python -m benchmarks.readme_picture

Error against time of the UR5: inverse dynamics and Hessians of batches of states, and a free swing; for a light and a
dark page, beside each other for wide screens and below each other for phones.
"""

from __future__ import annotations

import json
from itertools import product
from typing import Any

from benchmarks.integration_picture import DRIFT
from benchmarks.measure import RESULTS
from benchmarks.pages import DOCS
from rne.plotting.plots import blank_figure

NUMBA, NUMPY, PINOCCHIO, MUJOCO, CASADI = "rne, machine code", "rne, NumPy", "Pinocchio", "MuJoCo", "CasADi"
CALLS = {
    NUMBA: "Numba kernel, batch",
    NUMPY: "kernel, batch",
    PINOCCHIO: "Pinocchio, batch",
    MUJOCO: "MuJoCo, one state",
}
HESSIANS = {NUMBA: "Numba, Hessian", NUMPY: "NumPy, Hessian", CASADI: "CasADi, Hessian"}
METHODS = {NUMBA: ("numba", "DOP853"), NUMPY: ("numpy", "DOP853"), PINOCCHIO: ("pinocchio", "DOP853")}
METHODS |= {MUJOCO: ("mujoco", "RK4")}
COLORS = {  # on a light page, on a dark one; and the marker
    NUMBA: ("#2a7f3e", "#56c271", "o"),
    NUMPY: ("#0b62a4", "#5aa9ec", "s"),
    PINOCCHIO: ("#c8501e", "#ff8c5a", "D"),
    MUJOCO: ("#6a6a6a", "#a5a5a5", "^"),
    CASADI: ("#8a3fa0", "#d08ae6", "v"),
}
INK = {"": "#24292f", "_dark": "#d1d9e0"}  # by theme
SIZES = {"": (12.0, 4.0), "_narrow": (5.2, 9.0)}  # [inch], by shape
Results = dict[str, Any]


def picture(charts: Results, derivatives: Results, theme: str = "", shape: str = "") -> Any:
    """Three panels and a legend, with a transparent background."""
    import matplotlib as mpl
    from matplotlib.ticker import FuncFormatter, NullFormatter

    names = ("text.color", "axes.labelcolor", "axes.edgecolor", "axes.titlecolor", "xtick.color", "ytick.color")
    style = dict.fromkeys(names, INK[theme]) | {"font.size": 12, "axes.titlesize": 12, "axes.facecolor": "none"}
    with mpl.rc_context(style):
        figure = blank_figure(*SIZES[shape])
        torques, hessians, swing = figure.subplots(*((3, 1) if shape else (1, 3)))
        looks = {
            who: {"color": pair[bool(theme)], "marker": pair[2], "markersize": 8, "label": who}
            for who, pair in COLORS.items()
        }
        rows = charts["evaluation"]["robots"]["ur5"]["inverse_dynamics"]
        _points(torques, {who: rows[call] for who, call in CALLS.items()}, looks)
        rows = derivatives["robots"]["ur5 inverse_dynamics"]
        _points(hessians, {who: rows[call] for who, call in HESSIANS.items()}, looks)
        runs = charts["integration"]["drift-10"]["robots"]["ur5"]["runs"]
        for who, (way, method) in METHODS.items():
            chosen = [run for run in runs if run["method"] == method and way in run["seconds"]]
            swing.plot(
                [1e3 * run["seconds"][way] for run in chosen], [run["errors"][way] for run in chosen], **looks[who]
            )
        error, time = "largest relative error [1]", "time per state [ns]"
        torques.set(title="Inverse dynamics of 20 000 states", xlabel=time, ylabel=error, xlim=(10, 2e4))
        hessians.set(title=f"Hessian, {derivatives['states']} states", xlabel=time, ylabel=error, xlim=(60, 2e5))
        swing.set(title="Free swing of 10 s", xlabel="time [ms]", ylabel=DRIFT.replace(", ", ",\n"))
        for ax in (torques, hessians, swing):
            ax.set(xscale="log", yscale="log")
            ax.grid(True, alpha=0.25)
            for axis in (ax.xaxis, ax.yaxis):  # exponents in small print cannot be read on a phone
                axis.set_major_formatter(FuncFormatter(_tick))
                axis.set_minor_formatter(NullFormatter())
        for ax in (torques, hessians):
            ax.set(ylim=(1e-16, 1e-14))
        found = {who: line for ax in figure.axes for line in ax.lines for who in [line.get_label()]}
        place = {"loc": "outside lower center", "ncols": 2 if shape else len(found), "labelcolor": INK[theme]}
        figure.legend(found.values(), found.keys(), frameon=False, **place)
    return figure


def _points(ax: Any, rows: Results, looks: Results) -> None:
    for who, row in rows.items():
        ax.plot(row["ns_per_state"], row["worst_error"], linestyle="", **looks[who])


def write_pictures(charts: Results, derivatives: Results) -> None:
    """For both themes and shapes."""
    for theme, shape in product(INK, SIZES):
        path = DOCS / "pictures" / f"speed_and_accuracy{theme}{shape}.png"
        picture(charts, derivatives, theme, shape).savefig(path, transparent=True, dpi=180)


def _tick(x: float, _: int) -> str:
    """Label of a tick, such as 20000 or 1e-5."""
    return f"{x:g}" if x >= 1 else f"{x:.0e}".replace("e-0", "e-")


def main() -> None:
    charts, derivatives = (json.loads((RESULTS / f"{x}.json").read_text("utf-8")) for x in ("charts", "derivatives"))
    write_pictures(charts["charts"], derivatives)


if __name__ == "__main__":
    main()
