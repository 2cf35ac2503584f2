"""Figures, panels and curves, without pyplot's global state."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ..basics.spatial import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_POINTS = 20000  # per curve; of longer ones the smallest and largest values of short spans are drawn
LEGEND_ROWS = 12  # that fit beside one panel
COLORS = 10  # in matplotlib's cycle
MANY = ("turbo", 0.02, 0.96)  # colour map of more curves, from the first to the last


def blank_figure(width: float, height: float) -> Figure:
    """An empty figure of the given size [inch]; without matplotlib an ImportError says how to install it."""
    try:
        import matplotlib.figure  # noqa: F401
    except ModuleNotFoundError:
        raise ImportError("pictures need matplotlib, which is not installed: pip install 'rne[plot]'") from None
    from .shown_figure import ShownFigure

    return ShownFigure(figsize=(width, height), layout="constrained", dpi=120)


def stacked_panels(rows: int, title: str, height: float = 2.1) -> list[Axes]:
    """The panels of a new figure below each other, which share one time axis."""
    figure = blank_figure(8, height * rows)
    axes = list(figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0])
    figure.suptitle(literal(title))
    axes[-1].set_xlabel("time [s]")
    return axes


def figure_of(axes: Sequence[Axes]) -> Figure:
    """The figure that axes are on, that of the first if they are on several."""
    figure: Any = axes[0].figure
    while getattr(figure, "figure", figure) is not figure:  # a part of a figure
        figure = figure.figure
    return figure  # type: ignore[no-any-return]


def check_axes(axes: Any, labels: Sequence[str]) -> list[Axes]:
    """The given axes as a list, one for each label."""
    given = [axes] if hasattr(axes, "plot") else list(np.ravel(np.asarray(axes, dtype=object)))
    for ax in given:
        if not hasattr(ax, "plot"):
            raise TypeError(f"`axes` must be matplotlib axes, got {type(ax).__name__}")
    if len(given) != len(labels):
        raise ValueError(f"`axes` must have {len(labels)} axes, for {', '.join(labels)}; got {len(given)}")
    return given


def joint_colors(n: int) -> list[Any]:
    """A colour for each of n curves: those of matplotlib's cycle, or of a colour map if there are more."""
    if n <= COLORS:
        return [f"C{k}" for k in range(n)]
    from matplotlib import colormaps

    name, first, last = MANY
    return list(colormaps[name](np.linspace(first, last, n)))


def curves(ax: Axes, t: Array, values: Array, names: Sequence[str], colors: Sequence[Any], **style: Any) -> None:
    """Plot the columns of `values` over time."""
    look = {"linewidth": 1.2, "marker": "." if len(t) == 1 else ""} | style
    for column, name, color in zip(values.T, names, colors, strict=True):
        shown = thinned(column)
        ax.plot(t[shown], column[shown], label=literal(name), color=color, **look)


HIDDEN = "_nolegend_"  # of curves that legends leave out


def literal(name: str) -> str:
    """A name as matplotlib shows it: "$" begins no formula, and a leading "_" does not hide it from legends."""
    text = name.replace("$", r"\$")
    return f"\u200b{text}" if text.startswith("_") and text != HIDDEN else text


def dress(ax: Axes, label: str) -> None:
    """Grid and label of a panel."""
    ax.grid(True, alpha=0.3)
    ax.set_ylabel(label)
    ax.ticklabel_format(axis="y", scilimits=(-3, 4))


def legend_beside(ax: Axes) -> None:
    """A legend to the right of a panel, in as many columns as needed; none if no curve is named."""
    _, labels = ax.get_legend_handles_labels()
    if labels:
        columns = -(-len(labels) // LEGEND_ROWS)
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", frameon=False, ncols=columns)


def thinned(column: Array) -> Array:
    """Indices of the values to draw: all, or the smallest and the largest of each of many short spans."""
    if len(column) <= MAX_POINTS:
        return np.arange(len(column))
    edges = np.linspace(0, len(column), MAX_POINTS // 2 + 1).astype(int)
    extremes = [a + int(pick(column[a:b])) for a, b in pairwise(edges) for pick in (np.argmin, np.argmax)]
    return np.unique([0, *extremes, len(column) - 1])
