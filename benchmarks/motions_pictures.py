"""Pictures of docs/stability: errors by family, largest steps, evaluations, growing errors."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.motions import EXPLICIT, STIFF, TOPS
from rne.plotting.plots import blank_figure

STYLES = {"rk4": "o", "semi-implicit-euler": "s", "sampled": "^"}
QUANTITIES = {"inverse dynamics": "#0b62a4", "mass matrix": "#3f9b6e", "forward dynamics": "#c8501e"}
MARKERS = {
    "": "o",
    " by M": "o",
    ", compiled": "s",
    " by articulated bodies": "^",
    ", Pinocchio": "x",
}
COLORS = {
    "auto": "#000000",
    "LSODA": "#0b62a4",
    "BDF": "#3f9b6e",
    "Radau": "#8a5fb0",
    "RK45": "#c8501e",
    "DOP853": "#d99a00",
}


def families(rows: list[dict[str, Any]]) -> Any:
    """Error over n eps times the condition, a line for each family."""
    names = list(dict.fromkeys(r["family"] for r in rows))
    methods = list(dict.fromkeys(r["method"] for r in rows))
    figure = blank_figure(9.2, 7.2)
    ax = figure.subplots()
    for m, method in enumerate(methods):
        quantity = next(q for q in QUANTITIES if method.startswith(q))
        marker = MARKERS[method.removeprefix(quantity)]
        mine = [r for r in rows if r["method"] == method and r["ratio"] > 0]
        y = [names.index(r["family"]) + 0.07 * (m - (len(methods) - 1) / 2) for r in mine]
        x = [r["ratio"] / r["n"] for r in mine]
        ax.plot(x, y, marker, color=QUANTITIES[quantity], markersize=6, fillstyle="none", label=method)
    ax.axvline(10, color="0.3", linestyle="--", linewidth=1, label="bound")
    ax.set(xscale="log", xlabel="error / (n eps structured condition), worst case of the family [1]")
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.grid(True, alpha=0.25)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", frameon=False)
    return figure


def steps(found: dict[str, Any]) -> Any:
    """Largest stable steps over gain; errors of equal steps in two precisions."""
    figure = blank_figure(9.2, 4.8)
    left, right = figure.subplots(1, 2)
    for k, (method, marker) in enumerate(STYLES.items()):
        rows = [r for r in found["steps"] if r["method"] == method]
        x, color = [r["scale"] for r in rows], f"C{k}"
        width = 4 if method == "semi-implicit-euler" else 1  # the same limit as sampled, to a part in 5000
        look = {"color": color, "linewidth": width, "alpha": 0.6}
        left.plot(x, [r["predicted"] for r in rows], "-", label=f"{method}, predicted", **look)
        left.plot(x, [r["measured"] for r in rows], marker, color=color, fillstyle="none", label="measured")
    left.set(xscale="log", yscale="log", xlabel="gains, times the thesis's [1]", ylabel="largest stable step [s]")
    left.set_title("PD with gravity compensated, IRB 140", fontsize="medium")
    for k, (dtype, errors) in enumerate(found["float"].items()):
        right.plot([float(s) for s in errors], list(errors.values()), "o-", color=f"C{k}", label=dtype)
    right.set(xscale="log", yscale="log", xlabel="step [s]", ylabel="largest error of a position after 0.5 s [rad]")
    right.set_title("rk4 of rne.ensemble", fontsize="medium")
    return _finished(figure, left, right)


def effort(found: dict[str, Any]) -> Any:
    """Evaluations over damping and over spin."""
    figure = blank_figure(9.2, 4.8)
    left, right = figure.subplots(1, 2)
    evaluations(left, found["damping"], "damping", STIFF + EXPLICIT)
    left.set_xlabel("damping of every joint [N m s/rad]")
    left.set_title("swing under viscous friction, rtol 1e-6", fontsize="medium")
    evaluations(right, found["tops"], "spin", TOPS)
    right.set_xlabel("spin [rad/s]")
    right.set_title("released top, rtol 1e-9", fontsize="medium")
    return _finished(figure, left, right)


def evaluations(ax: Any, rows: list[dict[str, Any]], over: str, methods: tuple[str, ...]) -> None:
    """A line for each method, where it has finished."""
    for method in methods:
        there = [row for row in rows if method in row]
        line = "o--" if method == "auto" else "o-"
        x, y = [row[over] for row in there], [row[method]["evaluations"] for row in there]
        ax.plot(x, y, line, color=COLORS[method], fillstyle="none", label=method)
    ax.set(xscale="log", yscale="log", ylabel="evaluations for 1 s [1]")


def growth(found: dict[str, Any]) -> Any:
    """Errors in chaos with their estimates; departures from rest with theirs."""
    figure = blank_figure(9.2, 4.8)
    left, right = figure.subplots(1, 2)
    for k, (rtol, one) in enumerate(found["chaos"].items()):
        left.plot(one["t"], np.maximum(one["measured"], 1e-16), color=f"C{k}", linewidth=1, label=f"rtol {rtol}")
        estimate = np.maximum(one["estimated"], 1e-16)
        left.plot(one["estimated_t"], estimate, "--", color=f"C{k}", linewidth=1)
        left.plot(one["horizon"], 1e-3, "o", color=f"C{k}", markersize=6, fillstyle="none")
    left.axhline(1e-3, color="0.4", linestyle=":", linewidth=1)
    left.set(yscale="log", ylim=(1e-12, 20), xlabel="t [s]", ylabel="largest error of a position [rad]")
    left.set_title("free swing, DOP853: measured,\nestimated (dashed), horizons (rings)", fontsize="medium")
    t, rate = np.array(found["rest"]["t"]), found["rest"]["rate"]
    for k, (push, departure) in enumerate(found["rest"]["departure"].items()):
        right.plot(t, np.maximum(departure, 1e-18), color=f"C{k}", linewidth=1, label=f"push {push} rad")
        if float(push):
            grown = float(push) * np.exp(rate * t)
            right.plot(t[grown < 1], grown[grown < 1], "--", color=f"C{k}", linewidth=1)
    right.set(yscale="log", ylim=(1e-17, 100), xlabel="t [s]", ylabel="departure from upright [rad]")
    right.set_title("two links upright: simulated,\npush e^(rate t) (dashed)", fontsize="medium")
    return _finished(figure, left, right)


def _finished(figure: Any, *axes: Any) -> Any:
    for ax in axes:
        ax.grid(True, alpha=0.25)
        ax.legend(fontsize="small", frameon=False)
    return figure
