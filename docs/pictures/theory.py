"""The pictures of docs/explanation/theory.md: python docs/pictures/theory.py

Recursions run on symbols, with and without the rules by which the graph folds and shares operations.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import rne
from rne.graph.graph import LEAVES, UNARY, Graph
from rne.graph.scalar import inputs, references
from rne.kernels.trace import argument_widths, run_core

HERE = Path(__file__).parent
COLORS = {"input": "#c8501e", "constant": "#b0b0b0", "sum": "#2a7f3e", "product": "#0b62a4", "function": "#8a3fa0"}
SIGNS = {"add": "+", "subtract": "+", "multiply": "×", "divide": "/", "negative": "−"}
TITLES = {"every operation": "As written", "masses moved": "Simplified"}  # of the stages that are drawn
FONT = 11


class Plain(Graph):
    """A graph that writes down every operation; with `folds` zeros, ones and constants go, but nothing is shared."""

    def __init__(self, folds: bool) -> None:
        super().__init__()
        self.folds = folds

    def node(self, kind: str, *args: object) -> int:
        if kind not in LEAVES:
            self._index.pop((kind, *args), None)
        return super().node(kind, *args)

    def add(self, a: int, b: int) -> int:
        return super().add(a, b) if self.folds else self.node("add", a, b)

    def multiply(self, a: int, b: int) -> int:
        return super().multiply(a, b) if self.folds else self.node("multiply", a, b)

    def unary(self, kind: str, a: int) -> int:
        return super().unary(kind, a) if self.folds else self.node(kind, a)


def recorded(function, model: rne.Model, graph: Graph, moved: bool) -> tuple[Graph, list[int]]:
    """The graph of a recursion, and its outputs; with `moved` masses are where the fewest terms depend on them."""
    quantity, arrays, start = function.quantity, [], 0
    for width in argument_widths(function.quantity, model).values():
        arrays.append(inputs(graph, (1, width), start))
        start += width
    core = run_core(quantity, model, arrays, {})[0] if moved else quantity.core(model, *arrays)
    return graph, references(graph, core)


def stages(function, model: rne.Model) -> dict[str, tuple[Graph, list[int]]]:
    """The same recursion under more and more of the rules."""
    return {
        "every operation": recorded(function, model, Plain(folds=False), moved=False),
        "zeros, ones and constants folded": recorded(function, model, Plain(folds=True), moved=False),
        "repeated terms once": recorded(function, model, Graph(), moved=False),
        "masses moved": recorded(function, model, Graph(), moved=True),
    }


def operations(graph: Graph, outputs: list[int]) -> int:
    """Operations that the outputs need."""
    return len(graph.needed(outputs))


def draw(ax, graph: Graph, outputs: list[int], size: float, labelled: bool) -> None:
    """Inputs at the left, operations right of their operands, results at the right; dashed lines change the sign."""
    needed = graph.needed(outputs)
    leaves = dict.fromkeys(j for k in needed for j in graph.arguments(k) if graph.nodes[j].kind in LEAVES)
    order, level = [*leaves, *needed], {}
    for k in order:
        level[k] = 1 + max((level[j] for j in graph.arguments(k)), default=-1)
    for k in reversed(order):  # constants stand beside what they are used in
        if graph.nodes[k].kind == "constant":
            level[k] = max(0, min(level[j] for j in order if k in graph.arguments(j)) - 1)
    columns: dict[int, list[int]] = {}
    place: dict[int, tuple[float, float]] = {}
    for k in order:
        columns.setdefault(level[k], []).append(k)
    for column in sorted(columns):
        members = columns[column]
        middle = {k: np.mean([place[j][1] for j in graph.arguments(k) if j in place] or [0.5]) for k in members}
        for row, k in enumerate(sorted(members, key=lambda k: middle[k])):
            has_room = graph.nodes[k].kind == "constant" and len(members) < 4
            lower = 0.13 if has_room else 0.0  # beside the lines of others
            place[k] = column, (row + 0.5) / len(members) - lower
    for k in order:
        for j in graph.arguments(k):
            _line(ax, place[j], place[k], graph.nodes[k].kind == "subtract" and j == graph.arguments(k)[1], labelled)
    for row, ref in enumerate(outputs if labelled else []):
        end = max(columns) + 1, 1 - (row + 0.5) / len(outputs)
        _line(ax, place[ref >> 1], end, bool(ref & 1), labelled)
        ax.scatter(*end, s=size, color="white", edgecolor=COLORS["input"], zorder=2)
        ax.text(*end, f"g{row + 1}", ha="center", va="center", fontsize=FONT, zorder=3)
    for k in order:
        kind, args = graph.nodes[k]
        group = "function" if kind in UNARY else {"add": "sum", "subtract": "sum"}.get(kind, "product")
        ax.scatter(*place[k], s=size, color=COLORS.get(kind, COLORS[group]), zorder=2)
        if labelled:
            text = f"q{args[0] + 1}" if kind == "input" else f"{args[0]:.3g}" if kind == "constant" else kind
            ink = "black" if kind == "constant" else "white"
            look = {"color": ink, "fontsize": FONT - 2 * (kind == "constant"), "ha": "center", "va": "center"}
            ax.text(*place[k], SIGNS.get(kind, text), zorder=3, **look)
    ax.set_axis_off()


def _line(ax, start: tuple[float, float], end: tuple[float, float], negative: bool, labelled: bool) -> None:
    style = "--" if negative and labelled else "-"
    ax.plot(*zip(start, end, strict=True), style, color="0.5", linewidth=1.2 if labelled else 0.4, zorder=1)


def arm() -> rne.Model:
    """Two links of 0.4 m in a vertical plane, 4 and 2 kg."""
    return rne.dh_chain(
        a=[0.4, 0.4],
        alpha=[0, 0],
        d=[0, 0],
        theta=[0, 0],
        masses=[4.0, 2.0],
        centres=[[-0.2, 0, 0]] * 2,
        inertias=[np.diag([0.01, 0.05, 0.05])] * 2,
        gravity=[0, -9.81, 0],
        name="two links",
    )


def graphs() -> Figure:
    """The gravity torques of two links, before and after."""
    found = stages(rne.dynamics.gravity_torque, arm())
    figure = Figure(figsize=(5.4, 7.6), layout="constrained")
    panels = figure.subplots(2, 1)
    for ax, (name, title), size in zip(panels, TITLES.items(), (7, 620), strict=True):
        draw(ax, *found[name], size, labelled=size > 100)
        ax.set_title(f"{title}: {operations(*found[name])} operations", fontsize=FONT + 1)
        ax.margins(0.09)
    return figure


def bars() -> Figure:
    """Operations of the torques of the IRB 140, rule by rule."""
    found = stages(rne.dynamics.inverse_dynamics, rne.irb140())
    counts = {name: operations(*graph) for name, graph in found.items()}
    figure = Figure(figsize=(5.4, 2.3), layout="constrained")
    ax = figure.subplots()
    ax.barh(list(counts), list(counts.values()), color=COLORS["product"])
    for row, count in enumerate(counts.values()):
        ax.text(count, row, f" {count}", va="center", fontsize=FONT)
    ax.invert_yaxis()
    ax.margins(x=0.15)
    ax.tick_params(labelsize=FONT)
    ax.set_xlabel("operations", fontsize=FONT)
    ax.spines[["top", "right"]].set_visible(False)
    return figure


if __name__ == "__main__":
    graphs().savefig(HERE / "theory_graphs.png", dpi=150, facecolor="white")
    bars().savefig(HERE / "theory_counts.png", dpi=150, facecolor="white")
