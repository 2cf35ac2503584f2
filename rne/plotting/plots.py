"""Pictures of a Trajectory, drawn on matplotlib figures without any global state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..basics.spatial import Array
from ..simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SMALLEST = 1e-8  # [rad] shown on a log axis
MAX_POINTS = 4000  # of a curve; a picture shows no more
ROWS = 12  # of a legend that stands beside one panel
COLORS = 10  # of matplotlib's cycle; from then on the dashes differ
DASHES = ("-", "--", ":", "-.")
ENDINGS = {1: ", stopped by an event", -1: ", failed"}


def blank_figure(width: float, height: float) -> Figure:
    """An empty figure of the given size [inch]; an ImportError says how to get matplotlib."""
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError:
        raise ImportError("pictures need matplotlib, which is not installed: pip install 'rne[plot]'") from None
    return Figure(figsize=(width, height), layout="constrained", dpi=120)


def check_trajectory(trajectory: Trajectory) -> None:
    """Refuse what is no Trajectory, and one without samples."""
    if not isinstance(trajectory, Trajectory):
        raise TypeError(f"`trajectory` must be an rne.Trajectory, got {type(trajectory).__name__}")
    if not len(trajectory.t):
        raise ValueError("`trajectory` must have at least one sample, got none")


def plot(trajectory: Trajectory, names: Sequence[str] | None = None) -> Figure:
    """Joint positions, rates and torques, energies and the energy error over time.

    Parameters
    ----------
    trajectory : Trajectory
    names : sequence of str, length n, optional
        The joints' names for the legends, such as `robot.joint_names`; numbers if not given.

    Returns
    -------
    matplotlib.figure.Figure
        `figure.savefig("motion.png")` writes it. A trajectory does not say which joints turn and which slide, so
        the labels name both units.

    Raises
    ------
    ValueError
        If `trajectory` has no samples or `names` is not of its joints.
    ImportError
        If matplotlib is not installed.

    Notes
    -----
    The energy error is energy - energy at the start - work: what the solver's errors have created or lost.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> swing = rne.simulate(robot, [0] * 6, [0] * 6, 0.1)
    >>> [ax.get_ylabel() for ax in rne.plotting.plot(swing, robot.joint_names).axes]
    ['position [rad or m]', 'rate [rad/s or m/s]', 'torque [N m or N]', 'energy [J]', 'energy error [J]']
    """
    check_trajectory(trajectory)
    labels = _joint_labels(trajectory.q.shape[1], names)
    title = f"Motion by {trajectory.method}{ENDINGS.get(trajectory.status, '')}"
    figure, axes = panels(5, title, height=2.1)
    curves(axes[0], trajectory.t, trajectory.q, labels, "position [rad or m]")
    curves(axes[1], trajectory.t, trajectory.qd, labels, "rate [rad/s or m/s]")
    curves(axes[2], trajectory.t, trajectory.tau, labels, "torque [N m or N]")
    _energies(axes[3], axes[4], trajectory)
    return figure


def _joint_labels(n: int, names: Sequence[str] | None) -> tuple[str, ...]:
    if names is None:
        return tuple(f"joint {i}" for i in range(1, n + 1))
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise TypeError(f"`names` must be a sequence of str, got {names!r}")
    if len(names) != n:
        raise ValueError(f"`names` must have {n} names, one a joint of `trajectory`, got {len(names)}")
    return tuple(names)


def panels(rows: int, title: str, height: float = 2.6, *, share: bool = True) -> tuple[Figure, list[Axes]]:
    """Panels one below the other over time, with one time axis or each with its own."""
    figure = blank_figure(8, height * rows)
    axes = np.atleast_1d(figure.subplots(rows, 1, sharex=share))
    figure.suptitle(title)
    for ax in axes:
        ax.grid(True, alpha=0.3)
    axes[-1].set_xlabel("time [s]")
    return figure, list(axes)


def curves(ax: Axes, t: Array, values: Array, names: Sequence[str], label: str) -> None:
    """Columns over time with a legend beside the panel."""
    step = max(1, len(t) // MAX_POINTS)
    marker = "." if len(t) == 1 else ""
    for k, (column, name) in enumerate(zip(values.T, names, strict=True)):
        dashes = DASHES[k // COLORS % len(DASHES)]
        ax.plot(t[::step], column[::step], label=name, linewidth=1.2, linestyle=dashes, marker=marker)
    ax.set_ylabel(label)
    if names:
        columns = -(-len(names) // ROWS)
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", frameon=False, ncols=columns)


def _energies(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """The energies, and below them what the solver's errors have created or lost."""
    t = trajectory.t
    energies = np.stack([trajectory.kinetic, trajectory.potential, trajectory.energy], axis=1)
    curves(upper, t, energies, ("kinetic", "potential", "total"), "energy [J]")
    curves(lower, t, trajectory.balance[:, None], ("drift",), "energy error [J]")


def plot_free_motion(trajectory: Trajectory, names: tuple[str, ...], title: str) -> Any:
    """Joint positions, energies and the energy error of a motion without drives."""
    figure, axes = panels(3, title)
    curves(axes[0], trajectory.t, trajectory.q, names, "position [rad]")
    _energies(axes[1], axes[2], trajectory)
    return figure


def plot_closed_loop(trajectory: Trajectory, reference: Array, names: tuple[str, ...], title: str) -> Any:
    """Errors and torques of a controlled motion, and its errors on a log scale."""
    figure, axes = panels(3, title)
    t, error = trajectory.t, trajectory.q - reference
    curves(axes[0], t, error, names, "error [rad]")
    curves(axes[1], t, np.maximum(np.abs(error), SMALLEST), names, "|error| [rad]")
    axes[1].set_yscale("log")
    axes[1].axhline(0.01, color="0.4", linestyle="--", linewidth=1)
    axes[1].set_ylim(SMALLEST, 10)
    axes[1].annotate(
        "0.01 rad", (t[-1], 0.01), xytext=(0, 3), textcoords="offset points", ha="right", fontsize="small", color="0.4"
    )
    curves(axes[2], t, trajectory.tau, names, "torque [N m]")
    return figure
