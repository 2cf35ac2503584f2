"""Common parts of the pictures: colours, and labels beside points that keep clear of each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

OURS, NUMBA, PINOCCHIO, OTHER = "#0b62a4", "#2a7f3e", "#c8501e", "#6a6a6a"
NEAREST, FARTHEST = 6, 190  # [points] from a label to its point


Box = tuple[float, float, float, float]  # left, lower, right, upper [pixels]


def label_points(ax: Any, points: Sequence[tuple[float, float, str, str]], size: float = 8.0) -> None:
    """Write each (x, y, text, color) near its point, clear of texts and frame, with a line to it if far.

    The figure must be laid out: see `lay_out`.
    """
    renderer = ax.figure.canvas.get_renderer()
    scale = ax.figure.dpi / 72
    frame = ax.get_window_extent(renderer).padded(-3)
    spots = ax.transData.transform([(x, y) for x, y, _, _ in points])
    taken: list[Box] = [(x - 6, y - 6, x + 6, y + 6) for x, y in spots]
    taken += [tuple(text.get_window_extent(renderer).extents) for text in ax.texts]
    lines: list[np.ndarray] = []
    for k in sorted(range(len(points)), key=lambda k: -len(_near(spots, k))):
        _, _, text, color = points[k]
        trial = ax.text(0, 0, text, fontsize=size)
        extent = trial.get_window_extent(renderer)
        trial.remove()
        near = {k, *_near(spots, k, 14)}
        obstacles = [box for j, box in enumerate(taken) if j not in near]
        boxes = ((x, y, x + extent.width, y + extent.height) for x, y in _places(spots[k], extent, scale))
        free = (box for box in boxes if _within(box, frame) and not any(_overlap(box, other) for other in taken))
        found = _first_clear(spots[k], free, obstacles, lines)
        if found is None:
            raise ValueError(f"no room for the label {text!r}")
        box, line = found
        taken.append(box)
        lines.append(line)
        inverse = ax.transData.inverted()
        x, y = inverse.transform(box[:2])
        back = {"facecolor": "white", "edgecolor": "none", "pad": 0.3, "alpha": 0.8}
        ax.text(x, y, text, fontsize=size, color=color, va="bottom", ha="left", bbox=back, zorder=2.5)
        if np.hypot(*(line[1] - line[0])) > 9 * scale:
            ends = inverse.transform(line)
            ax.plot(ends[:, 0], ends[:, 1], color=color, linewidth=0.6, alpha=0.7, scalex=False, scaley=False)


def _first_clear(
    spot: np.ndarray, boxes: Iterable[Box], obstacles: Sequence[Box], lines: Sequence[np.ndarray]
) -> tuple[Box, np.ndarray] | None:
    """The first box whose line to the spot meets nothing, else meets only lines, else the first."""
    choice: tuple[int, Box, np.ndarray] | None = None
    for box in boxes:
        line = _leader(spot, box)
        blocked = any(_crosses(line, other) for other in obstacles) or any(_crosses(other, box) for other in lines)
        worth = 0 if blocked else 1 if any(_meet(line, other) for other in lines) else 2
        if choice is None or worth > choice[0]:
            choice = worth, box, line
        if worth == 2:
            break
    return None if choice is None else choice[1:]


def lay_out(figure: Any) -> None:
    """Give the axes their final places, so that labels can be placed in pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure).draw()
    figure.set_layout_engine("none")


def _near(spots: np.ndarray, k: int, distance: float = 80) -> list[int]:
    return [j for j, s in enumerate(spots) if j != k and np.hypot(*(s - spots[k])) < distance]


def _within(box: Sequence[float], frame: Any) -> bool:
    return bool(box[0] > frame.x0 and box[1] > frame.y0 and box[2] < frame.x1 and box[3] < frame.y1)


def _places(spot: np.ndarray, extent: Any, scale: float) -> Iterable[tuple[float, float]]:
    w, h = extent.width, extent.height
    for distance in np.arange(NEAREST, FARTHEST, 4.0) * scale:
        for angle in np.radians([0, 90, 270, 180, 45, 315, 135, 225, 65, 295, 115, 245, 22, 338, 158, 202]):
            x, y = spot + distance * np.array([np.cos(angle), np.sin(angle)])
            left = x if np.cos(angle) > 0.3 else x - w if np.cos(angle) < -0.3 else x - w / 2
            low = y if np.sin(angle) > 0.3 else y - h if np.sin(angle) < -0.3 else y - h / 2
            yield float(left), float(low)


def _leader(spot: np.ndarray, box: Box) -> np.ndarray:
    return np.array([spot, [np.clip(spot[0], box[0], box[2]), np.clip(spot[1], box[1], box[3])]])


def _overlap(a: Sequence[float], b: Sequence[float]) -> bool:
    return a[0] < b[2] + 2 and b[0] < a[2] + 2 and a[1] < b[3] + 1 and b[1] < a[3] + 1


def _crosses(line: np.ndarray, box: Sequence[float]) -> bool:
    along = line[0] + np.linspace(0, 1, 60)[:, None] * (line[1] - line[0])
    inside = (along[:, 0] > box[0]) & (along[:, 0] < box[2]) & (along[:, 1] > box[1]) & (along[:, 1] < box[3])
    return bool(inside.any())


def _meet(a: np.ndarray, b: np.ndarray) -> bool:
    u, v, w = a[1] - a[0], b[1] - b[0], b[0] - a[0]
    cross = u[0] * v[1] - u[1] * v[0]
    if abs(cross) < 1e-9:
        return False
    s, t = (w[0] * v[1] - w[1] * v[0]) / cross, (w[0] * u[1] - w[1] * u[0]) / cross
    return bool(0 < s < 1 and 0 < t < 1)
