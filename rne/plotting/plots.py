"""Plots of a Trajectory on matplotlib figures, without pyplot's global state."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..basics.spatial import Array
from ..robot import Robot
from ..simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_POINTS = 4000  # per curve; a picture shows no more
LEGEND_ROWS = 12  # that fit beside one panel
COLORS = 10  # in matplotlib's cycle; further curves differ by their line style
LINE_STYLES = ("-", "--", ":", "-.")
ENDINGS = {1: ", stopped by an event", -1: ", failed"}


def blank_figure(width: float, height: float) -> Figure:
    """An empty figure of the given size [inch]; without matplotlib an ImportError says how to install it."""
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError:
        raise ImportError("pictures need matplotlib, which is not installed: pip install 'rne[plot]'") from None
    return Figure(figsize=(width, height), layout="constrained", dpi=120)


def check_trajectory(trajectory: Trajectory) -> None:
    """Raise TypeError for anything but a Trajectory, ValueError for one without samples."""
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
        Names of the joints for the legends, as in `robot.joint_names`; numbered from 1 if not given.

    Returns
    -------
    matplotlib.figure.Figure
        `figure.savefig("motion.png")` writes it to a file. The labels name the units of revolute and of prismatic
        joints, since a trajectory does not record the types of its joints.

    Raises
    ------
    TypeError
        If `trajectory` is no Trajectory, or `names` no sequence of str; a Robot has its names as `robot.joint_names`.
    ValueError
        If `trajectory` has no samples or `names` has another length.
    ImportError
        If matplotlib is not installed.

    Notes
    -----
    The energy error is energy - energy at the start - work + dissipated, which is zero but for the solver's errors.

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
    if not isinstance(names, Iterable) or isinstance(names, str):
        cure = "; pass robot.joint_names" if isinstance(names, Robot) else ""
        raise TypeError(f"`names` must be a sequence of str, got {type(names).__name__}{cure}")
    labels = tuple(names)
    for label in labels:
        if not isinstance(label, str):
            raise TypeError(f"`names` must be a sequence of str, got one with {type(label).__name__}")
    if len(labels) != n:
        raise ValueError(f"`names` must have {n} names, one per joint of `trajectory`, got {len(labels)}")
    return labels


def panels(rows: int, title: str, height: float = 2.6, *, share: bool = True) -> tuple[Figure, list[Axes]]:
    """A figure of panels below each other, which share one time axis or have one each."""
    figure = blank_figure(8, height * rows)
    axes = np.atleast_1d(figure.subplots(rows, 1, sharex=share))
    figure.suptitle(title)
    for ax in axes:
        ax.grid(True, alpha=0.3)
    axes[-1].set_xlabel("time [s]")
    return figure, list(axes)


def curves(ax: Axes, t: Array, values: Array, names: Sequence[str], label: str) -> None:
    """Plot the columns of `values` over time, with a legend beside the panel."""
    step = max(1, len(t) // MAX_POINTS)
    marker = "." if len(t) == 1 else ""
    for k, (column, name) in enumerate(zip(values.T, names, strict=True)):
        style = LINE_STYLES[k // COLORS % len(LINE_STYLES)]
        ax.plot(t[::step], column[::step], label=name, linewidth=1.2, linestyle=style, marker=marker)
    ax.set_ylabel(label)
    ax.ticklabel_format(axis="y", scilimits=(-3, 4))
    if names:
        columns = -(-len(names) // LEGEND_ROWS)
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", frameon=False, ncols=columns)


def _energies(upper: Axes, lower: Axes, trajectory: Trajectory) -> None:
    """The energies, and below them the energy error."""
    t = trajectory.t
    energies = np.stack([trajectory.kinetic, trajectory.potential, trajectory.energy], axis=1)
    curves(upper, t, energies, ("kinetic", "potential", "total"), "energy [J]")
    curves(lower, t, trajectory.balance[:, None], ("drift",), "energy error [J]")
