"""Figures for a page that is also read on a phone: one column wide, no small print, log axes with plain numbers."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..basics.spatial import Array
from ..plotting.plots import blank_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 4.9  # of every figure [inch]
FONT = 11.0  # smallest text [pt]; 11.2 px where the figure is 358 px wide, on a screen of 390 px
DPI = 150
STYLE: dict[str, Any] = {  # matplotlib's parameters for the figures of pages
    "font.size": FONT,
    "axes.titlesize": FONT,
    "figure.titlesize": FONT + 1,
    "legend.fontsize": FONT,
    "legend.frameon": False,
    "legend.columnspacing": 1.2,
    "legend.handlelength": 1.4,
    "lines.linewidth": 1.3,
    "axes.grid": True,
    "figure.constrained_layout.w_pad": 0.08,  # [inch]
    "grid.alpha": 0.3,
}
MAX_POINTS = 2400  # per curve; a picture shows no more
LINE = 46  # characters of a title that fit
APART = 4.0  # times larger than the others: a joint gets a panel of its own
FLOOR = 1e-16  # smallest value on a log axis
DASHED = (0, (4, 3))  # over a solid line that it may cover
LEGEND_ROW, TITLE_ROW = 0.22, 0.25  # heights [inch]


def column(
    title: str, heights: Sequence[float], *, share: bool = True, legend_rows: int = 2
) -> tuple[Figure, list[Axes]]:
    """A figure of panels below each other.

    Parameters
    ----------
    title : str
        Wrapped to the width of the figure.
    heights : sequence of float
        Of the panels [inch].
    share : bool
        True for one time axis below all panels, False for one below each.
    legend_rows : int
        Rows of the legend below the panels, for which there must be room.

    Returns
    -------
    matplotlib.figure.Figure, list of matplotlib.axes.Axes
    """
    lines = textwrap.fill(title, LINE)
    axis = 0.55 if share else 0.45 * len(heights)
    height = sum(heights) + axis + LEGEND_ROW * legend_rows + TITLE_ROW * (1 + lines.count("\n"))
    figure = blank_figure(WIDTH, height)
    axes = list(figure.subplots(len(heights), 1, sharex=share, height_ratios=list(heights), squeeze=False)[:, 0])
    figure.suptitle(lines)
    for ax in axes if not share else axes[-1:]:
        ax.set_xlabel("time [s]")
    return figure, axes


def lines(ax: Axes, t: Array, values: Array, names: Sequence[str], first: int = 0, **style: Any) -> None:
    """Plot the columns of `values` over time; `first` is the number of the first one's colour."""
    shown = thinned(len(t))
    for k, (values_k, name) in enumerate(zip(values.T, names, strict=True), first):
        ax.plot(t[shown], values_k[shown], label=name, **{"color": f"C{k}"} | style)
    if ax.get_yscale() == "linear":
        ax.ticklabel_format(axis="y", scilimits=(-3, 4))


def thinned(count: int) -> Array:
    """Indices of at most 2400 of `count` samples, the last one among them."""
    return np.unique(np.linspace(0, count - 1, min(count, MAX_POINTS)).astype(int))


def log_lines(ax: Axes, t: Array, values: Array, names: Sequence[str], first: int = 0, **style: Any) -> None:
    """Plot the sizes of the columns of `values` on a log axis; zeros leave gaps."""
    size = np.abs(values)
    lines(ax, t, np.where(size > FLOOR, size, np.nan), names, first, **style)
    log_axis(ax)


def log_axis(ax: Axes) -> None:
    """A log axis whose labels have no exponents in small print."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(numticks=6))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: power(value)))
    ax.yaxis.set_minor_formatter(NullFormatter())


def power(value: float) -> str:
    """A power of ten in figures, such as 1e-4, 0.1 or 100."""
    exponent = round(math.log10(value)) if value > 0 else 0
    return f"{10.0**exponent:g}" if -2 <= exponent <= 3 else f"1e{exponent}"


def heading(ax: Axes, text: str) -> None:
    """What a panel shows, with the unit of its vertical axis, above its left end: a rotated label is hard to read."""
    ax.set_title(text, loc="left")


def legend(figure: Figure, ax: Axes, columns: int = 3) -> None:
    """One legend for all panels, below them, of the curves of `ax`."""
    handles, labels = ax.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(list(once.values()), list(once), loc="outside lower center", ncols=columns)


def apart(values: Array) -> list[list[int]]:
    """Columns that can share an axis, and each that is so much larger than the rest that it needs its own."""
    size = np.abs(values).max(axis=0)
    rest, alone = list(range(values.shape[1])), []
    while len(rest) > 1:
        largest = max(rest, key=lambda k: float(size[k]))
        if size[largest] <= APART * max(size[k] for k in rest if k != largest):
            break
        rest.remove(largest)
        alone.append([largest])
    return [rest, *alone]


def joint_grid(title: str, names: Sequence[str], unit: str, below: Sequence[float] = ()) -> Any:
    """A figure with a small panel for each joint, two in a row, and wide panels below them.

    Returns
    -------
    figure, list of small axes, list of wide axes
    """
    rows = -(-len(names) // 2)
    heights = [1.25] * rows + list(below)
    figure = blank_figure(WIDTH, sum(heights) + 1.2)
    figure.suptitle(textwrap.fill(title, LINE))
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    small = [figure.add_subplot(grid[k // 2, k % 2]) for k in range(len(names))]
    wide = [figure.add_subplot(grid[rows + k, :]) for k in range(len(below))]
    for ax, name in zip(small, names, strict=True):
        heading(ax, f"{name} [{unit}]")
    for ax in wide or small[-2:]:
        ax.set_xlabel("time [s]")
    return figure, small, wide
