"""Plots of a motion over time, or of two to compare them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..robot import Robot
from ..simulation.trajectory import Trajectory
from .figures import check_axes, curves, dress, figure_of, joint_colors, legend_beside, stacked_panels
from .motions import Motion, joint_labels, motion_argument

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

QUANTITIES = {  # what it is called and its unit, of rotating and of sliding joints
    "q": (("position", "rad"), ("position", "m")),
    "qd": (("rate", "rad/s"), ("rate", "m/s")),
    "qdd": (("acceleration", "rad/s²"), ("acceleration", "m/s²")),
    "tau": (("torque", "N m"), ("force", "N")),
}
ENERGIES = {"energy": ("kinetic", "potential", "total"), "energy error": ("_nolegend_",)}
DEFAULT = ("q", "qd", "tau", "energy", "energy error")
ENDINGS = {1: ", stopped by an event", -1: ", failed"}
DASHED = (0, (4, 2))
SEPARATE = 120  # samples whose points can still be told apart


class Panel(NamedTuple):
    """One quantity with one unit."""

    quantity: str
    columns: list[int]
    names: tuple[str, ...]
    colors: list[Any]
    label: str


def plot(
    motion: Trajectory | Sequence[Any],
    names: Robot | Sequence[str] | None = None,
    *,
    other: Trajectory | Sequence[Any] | None = None,
    quantities: Sequence[str] | None = None,
    axes: Any = None,
) -> Figure:
    """Joint positions, rates and torques, energies and the energy error over time.

    Parameters
    ----------
    motion : Trajectory or tuple of array_like
        A simulated motion, or arrays (t, q), (t, q, qd), (t, q, qd, qdd) or (t, q, qd, qdd, tau) of shapes (T,) and
        (T, n), such as measured ones; None for an array that is missing.
    names : Robot or sequence of str, length n, optional
        The robot, or names of its joints. By default the names that the motion's model has, and for arrays numbers.
    other : Trajectory or tuple of array_like, optional
        A second motion of as many joints, drawn dashed on the same panels where it has the quantity.
    quantities : sequence of str, optional
        What to draw, from "q", "qd", "qdd", "tau", "energy" and "energy error"; by default all but "qdd" that `motion`
        has, torques only if they are not all zero. Of a robot with rotating and sliding joints each of the first four
        takes two panels, one for each unit.
    axes : matplotlib axes or sequence of them, optional
        Where to draw, one for each panel; by default a new figure with the panels below each other.

    Returns
    -------
    matplotlib.figure.Figure
        `figure.savefig("motion.png")` writes it to a file.

    Raises
    ------
    TypeError
        If an argument is of another type.
    ValueError
        If a motion has no samples, shapes do not fit, `motion` lacks one of the `quantities`, or there are too few or
        too many names or axes.
    ImportError
        If matplotlib is not installed.

    Notes
    -----
    Simulated motions are drawn as smooth curves, evaluated between the solver's steps, with vertical lines where
    torques or accelerations jump; a motion simulated with `t_eval` does not know when. Arrays are drawn as straight
    lines between samples. The energy error, energy - energy at the start - work + dissipated, is zero but for the
    solver's errors, and is known at the samples only. Without a model the labels name the units of both kinds of
    joints.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> swing = rne.simulate(robot, [0] * 6, [0] * 6, 0.1)
    >>> [ax.get_ylabel() for ax in rne.plotting.plot(swing).axes]
    ['position [rad]', 'rate [rad/s]', 'energy [J]', 'energy error [J]']
    >>> stiffer = rne.simulate(robot, [0] * 6, [0] * 6, 0.1, torque=rne.control.pd(robot, [9] * 6, [1] * 6, [0] * 6))
    >>> figure = rne.plotting.plot(swing, other=stiffer, quantities=["q"])
    """
    shown = motion_argument("motion", motion)
    second = None if other is None else motion_argument("other", other)
    if second is not None and second.n != shown.n:
        raise ValueError(f"`other` must have {shown.n} joints as `motion` has, got {second.n}")
    labels, rotating = joint_labels(shown, names)
    wanted = panels_of(shown, labels, rotating, quantities)
    if axes is None:
        where = stacked_panels(len(wanted), _title(shown, second))
    else:
        where = check_axes(axes, [panel.label for panel in wanted])
    for panel, ax in zip(wanted, where, strict=True):
        draw_panel(ax, panel, shown, second)
        legend_beside(ax)
    return figure_of(where)


def panels_of(
    motion: Motion, labels: Sequence[str], rotating: Array | None, quantities: Sequence[str] | None
) -> list[Panel]:
    """The panels that show the quantities, each with one unit where the types of the joints are known."""
    if quantities is None:
        quantities = [name for name in DEFAULT if name in motion.quantities and (name != "tau" or motion.is_driven)]
    elif isinstance(quantities, str):
        raise TypeError("`quantities` must be a sequence of str, got str")
    if not len(quantities):
        raise ValueError("`quantities` must name at least one quantity, got none")
    colors, found = joint_colors(motion.n), []
    for quantity in quantities:
        if quantity not in motion.quantities:
            raise ValueError(f"`quantities` must be from {list(motion.quantities)}, got {quantity!r}")
        if quantity in ENERGIES:
            names = ENERGIES[quantity]
            shades = joint_colors(len(names)) if len(names) > 1 else ["0.5"]
            found.append(Panel(quantity, list(range(len(names))), names, shades, f"{quantity} [J]"))
            continue
        for columns, label in _units(quantity, motion.n, rotating):
            chosen = tuple(labels[k] for k in columns)
            found.append(Panel(quantity, columns, chosen, [colors[k] for k in columns], label))
    return found


def _units(quantity: str, n: int, rotating: Array | None) -> list[tuple[list[int], str]]:
    """Columns that share a unit, with their label."""
    kinds = QUANTITIES[quantity]
    if rotating is None or not n:
        return [(list(range(n)), f"{kinds[0][0]} [{kinds[0][1]} or {kinds[1][1]}]")]
    groups = [
        (np.flatnonzero(rotating == (kind == 0)).tolist(), f"{kinds[kind][0]} [{kinds[kind][1]}]") for kind in (0, 1)
    ]
    return [(columns, label) for columns, label in groups if columns]


def draw_panel(ax: Axes, panel: Panel, motion: Motion, other: Motion | None = None) -> None:
    """The curves of one panel, those of a second motion dashed."""
    for drawn, style in ((motion, "-"), (other, DASHED)):
        if drawn is None or panel.quantity not in drawn.quantities:
            continue
        t, values = drawn.curve(panel.quantity)
        names = panel.names if drawn is motion else ("_nolegend_",) * len(panel.names)
        at_samples = panel.quantity == "energy error" and len(t) <= SEPARATE
        marks = {"marker": ".", "linewidth": 0.6} if at_samples else {}
        curves(ax, t, values[:, panel.columns], names, panel.colors, linestyle=style, **marks)
    dress(ax, panel.label)


def _title(motion: Motion, other: Motion | None) -> str:
    if other is not None:
        return f"Solid: motion, {_origin(motion)}; dashed: other, {_origin(other)}"
    return "Given samples" if motion.trajectory is None else f"Motion {_origin(motion)}"


def _origin(motion: Motion) -> str:
    run = motion.trajectory
    return "as given" if run is None else f"by {run.method}{ENDINGS.get(run.status, '')}"
