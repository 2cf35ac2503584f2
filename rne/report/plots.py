"""Pictures of a Trajectory, drawn on matplotlib figures without any global state."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..spatial import Array
from ..trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SMALLEST = 1e-8  # [rad] shown on a log axis
MAX_POINTS = 4000  # of a curve; a picture shows no more


def _figure(rows: int, title: str) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 2.6 * rows), layout="constrained", dpi=120)
    axes = np.atleast_1d(figure.subplots(rows, 1, sharex=True))
    figure.suptitle(title)
    for ax in axes:
        ax.grid(True, alpha=0.3)
    axes[-1].set_xlabel("time [s]")
    return figure, list(axes)


def _curves(ax: Axes, t: Array, values: Array, names: tuple[str, ...], label: str) -> None:
    step = max(1, len(t) // MAX_POINTS)
    for column, name in zip(values.T, names, strict=True):
        ax.plot(t[::step], column[::step], label=name, linewidth=1.2)
    ax.set_ylabel(label)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", frameon=False)


def plot_free_motion(trajectory: Trajectory, names: tuple[str, ...], title: str) -> Any:
    """Joint positions, energies and the energy error of a motion without drives."""
    figure, axes = _figure(3, title)
    t = trajectory.t
    _curves(axes[0], t, trajectory.q, names, "position [rad]")
    energies = np.stack([trajectory.kinetic, trajectory.potential, trajectory.energy], axis=1)
    _curves(axes[1], t, energies, ("kinetic", "potential", "total"), "energy [J]")
    drift = trajectory.energy - trajectory.energy[0] - trajectory.work
    _curves(axes[2], t, drift[:, None], ("drift",), "energy error [J]")
    return figure


def plot_closed_loop(trajectory: Trajectory, reference: Array, names: tuple[str, ...], title: str) -> Any:
    """Errors and torques of a controlled motion, and its errors on a log scale."""
    figure, axes = _figure(3, title)
    t, error = trajectory.t, trajectory.q - reference
    _curves(axes[0], t, error, names, "error [rad]")
    _curves(axes[1], t, np.maximum(np.abs(error), SMALLEST), names, "|error| [rad]")
    axes[1].set_yscale("log")
    axes[1].axhline(0.01, color="0.4", linestyle="--", linewidth=1)
    axes[1].set_ylim(SMALLEST, 10)
    axes[1].annotate(
        "0.01 rad", (t[-1], 0.01), xytext=(0, 3), textcoords="offset points", ha="right", fontsize="small", color="0.4"
    )
    _curves(axes[2], t, trajectory.tau, names, "torque [N m]")
    return figure


def save(figure: Any, path: Path) -> None:
    """Write a figure as PNG."""
    figure.savefig(path)
