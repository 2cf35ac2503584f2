"""Panels one column wide, below each other, for the pictures of the thesis's page."""

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np

from rne.plotting.plots import WIDTH, blank_figure, plot_columns

LINE = 46  # characters of a title that fit
LEGEND, TITLE_ROW = 0.44, 0.25  # heights [inch]


def column(title: str, heights: Sequence[float], *, share: bool = True) -> tuple[Any, list[Any]]:
    """A figure of panels of given heights [inch] below each other, with room for a legend of two rows below all.

    They share one time axis at the bottom, or have one each.
    """
    text = textwrap.fill(title, LINE)
    axis = 0.55 if share else 0.45 * len(heights)
    figure = blank_figure(WIDTH, sum(heights) + axis + LEGEND + TITLE_ROW * (1 + text.count("\n")))
    axes = list(figure.subplots(len(heights), 1, sharex=share, height_ratios=list(heights), squeeze=False)[:, 0])
    figure.suptitle(text)
    for ax in axes if not share else axes[-1:]:
        ax.set_xlabel("time [s]")
    return figure, axes


def lines(ax: Any, t: np.ndarray, values: np.ndarray, names: Sequence[str], first: int = 0, **style: Any) -> list[Any]:
    """Plot the columns of `values` over time; `first` is the number of the first one's colour."""
    drawn = plot_columns(ax, t, values, names, [f"C{k}" for k in range(first, first + len(names))], **style)
    if ax.get_yscale() == "linear":
        ax.ticklabel_format(axis="y", scilimits=(-3, 4))
    return drawn
