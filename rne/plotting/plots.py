"""Plots of motions and ensembles over time, without pyplot's global state."""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_numbers
from ..basics.spatial import Array
from ..basics.text import short
from ..model.model import Model
from ..robot import Robot
from ..simulation.drive_report import DriveReport
from ..simulation.ensembles import Ensemble
from ..simulation.sensitivities import Sensitivities
from ..simulation.trajectory import Trajectory
from .motions import Motion, joint_labels, motion_argument

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.typing import ColorType

HIDDEN = "_nolegend_"  # label of curves that legends leave out
QUANTITIES = {  # name and unit, of rotating and of sliding joints
    "q": (("position", "rad"), ("position", "m")),
    "qd": (("velocity", "rad/s"), ("velocity", "m/s")),
    "qdd": (("acceleration", "rad/s²"), ("acceleration", "m/s²")),
    "tau": (("torque", "N m"), ("force", "N")),
    "motor_q": (("motor position", "rad"), ("motor position", "m")),
    "motor_qd": (("motor velocity", "rad/s"), ("motor velocity", "m/s")),
}
ENERGIES = {"energy": ("kinetic", "potential", "total"), "energy error": (HIDDEN,)}
DEFAULT = ("q", "qd", "tau", "energy", "energy error")
ENDINGS = {1: ", stopped by an event", -1: ", failed"}
DASHED = (0, (4, 2))
SEPARATE = 120  # most samples that are shown as separate points
PALE, DARK = 0.18, 0.5  # opacity of the outermost and of the innermost band between quantiles
LEGEND_ROWS = 12  # rows of a legend that fit beside one panel
COLORS = 10  # number of colours in matplotlib's cycle
WIDTH = 4.9  # width of a figure for pages that are read on phones too [inch]
BELOW: dict[str, Any] = {"loc": "outside lower center", "ncols": 3, "frameon": False}  # a legend for all panels
MANY = ("turbo", 0.02, 0.96)  # colour map of more curves, from the first to the last
LOOK = {"measured": ("0.7", 3.0), "predicted": ("C0", 1.2), "residual": ("C3", 1.0)}  # colours and widths of torques
BAND = 1.96  # half width of a band for 95 % [standard deviations]
GAP = 1.5  # longest step over which a line is drawn, relative to the usual one


class Panel(NamedTuple):
    """Quantity in one unit: columns of its array, with their names and colours."""

    quantity: str
    columns: list[int]
    names: tuple[str, ...]
    colors: Sequence[ColorType]
    label: str


def plot(
    motion: Trajectory | Sequence[ArrayLike | None],
    joint_names: Robot | Sequence[str] | None = None,
    *,
    other: Trajectory | Sequence[ArrayLike | None] | None = None,
    quantities: Sequence[str] | None = None,
    axes: Axes | Sequence[Axes] | None = None,
) -> Figure:
    """Joint positions, velocities and torques, energies and the energy error over time.

    Parameters
    ----------
    motion : Trajectory or tuple of array_like
        A simulated motion, or arrays (t, q), (t, q, qd), (t, q, qd, qdd) or (t, q, qd, qdd, tau) of shapes (T,) and
        (T, n), such as measured ones; None for an array that is missing.
    joint_names : Robot or sequence of str, length n, optional
        The robot, or names of its joints. By default the names that the motion's model has, and for arrays numbers.
    other : Trajectory or tuple of array_like, optional
        A second motion of as many joints, drawn dashed on the same panels where it has the quantity.
    quantities : sequence of str, optional
        Quantities to draw, from "q", "qd", "qdd", "tau", "energy" and "energy error", and with elastic joints "motor_q"
        and "motor_qd"; by default all but "qdd" and the last two that `motion` has, torques only if they are not all
        zero. Of a robot with rotating and sliding joints each of them but energies takes two panels, one for each unit.
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
    torques or accelerations jump. Arrays, and motions simulated with `t_eval`, which know neither when torques jump nor
    what happens between these times, are drawn as straight lines between samples. The energy error, energy - energy at
    the start - work + dissipated, is zero but for the solver's errors, and is known at the samples only. Without a
    model the labels name the units of both kinds of joints.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> swing = rne.simulate(robot, [0] * 6, [0] * 6, 0.1)
    >>> [ax.get_ylabel() for ax in rne.plotting.plot(swing).axes]
    ['position [rad]', 'velocity [rad/s]', 'energy [J]', 'energy error [J]']
    >>> stiffer = rne.simulate(robot, [0] * 6, [0] * 6, 0.1, torque=rne.control.pd(robot, [9] * 6, [1] * 6, [0] * 6))
    >>> figure = rne.plotting.plot(swing, other=stiffer, quantities=["q"])
    """
    shown = motion_argument("motion", motion)
    second = None if other is None else motion_argument("other", other)
    if second is not None and second.n != shown.n:
        raise ValueError(f"`other` must have {shown.n} joints as `motion` has, got {second.n}")
    labels, rotating = joint_labels(shown, joint_names)
    wanted = panels_of(shown, labels, rotating, quantities)
    title = _title(shown, second)
    where = panels(len(wanted), title) if axes is None else check_axes(axes, [panel.label for panel in wanted])
    for panel, ax in zip(wanted, where, strict=True):
        draw_panel(ax, panel, shown, second)
        legend_beside(ax)
    return figure_of(where)


def quantile_plot(
    ensemble: Ensemble,
    joints: Sequence[str] | None = None,
    probabilities: ArrayLike = (0.05, 0.25, 0.5, 0.75, 0.95),
    of: Literal["q", "qd", "tau"] = "q",
    *,
    axes: Axes | Sequence[Axes] | None = None,
) -> Figure:
    """Bands between quantiles of an ensemble over time, one panel for each joint.

    Parameters
    ----------
    ensemble : Ensemble
        With enough stored times: `keep` of `rne.ensemble`.
    joints : sequence of str, optional
        Names of the joints to show; by default all.
    probabilities : array_like, shape (P,)
        Probabilities of the quantiles, rising, from 0 to 1. Each one and its opposite number bound a band: the first
        and the last, the second and the last but one, and so on; of an odd number the one in the middle is a line.
    of : {"q", "qd", "tau"}
        Positions, velocities or torques.
    axes : matplotlib axes or sequence of them, optional
        Where to draw, one for each joint; by default a new figure.

    Returns
    -------
    matplotlib.figure.Figure
        One panel for each joint; `figure.savefig("quantiles.png")` writes it to a file.

    Raises
    ------
    TypeError
        If `ensemble` is no Ensemble, or `axes` are no axes.
    ValueError
        If a joint is unknown, the probabilities are not rising numbers from 0 to 1, or there are no motions.
    ImportError
        If matplotlib is not installed.

    Notes
    -----
    Quantiles are known at the stored times only, and joined by straight lines. They are quantiles of each joint
    separately: no single motion need follow any of them.

    Examples
    --------
    >>> import numpy as np, rne
    >>> starts = np.random.default_rng(0).uniform(-0.1, 0.1, (50, 6))
    >>> swings = rne.ensemble(rne.load("irb140"), starts, 0 * starts, 0.2, step=2e-3, keep=11)
    >>> [ax.get_ylabel() for ax in rne.plotting.quantile_plot(swings, ["joint_2", "joint_3"]).axes]
    ['position [rad]', 'position [rad]']
    """
    if not isinstance(ensemble, Ensemble):
        raise TypeError(f"`ensemble` must be an rne.Ensemble, got {type(ensemble).__name__}")
    model = ensemble.model
    names = _some_of(model.joint_names, joints, "joints", "joint")
    chosen = [model.joint_names.index(name) for name in names]
    levels = real_numbers("probabilities", probabilities, "(P,)")
    if levels.ndim != 1 or not len(levels) or (np.diff(levels) <= 0).any():
        given = np.asarray(probabilities).tolist()
        raise ValueError(f"`probabilities` must be rising numbers from 0 to 1, got {given}")
    values = ensemble.quantiles(levels, of)
    if axes is None:
        title, height = f"{ensemble.q.shape[1]} motions of {model.name}", 2.6 if len(chosen) > 1 else 3.2
        where = panels(len(chosen), title, min(len(chosen), 3), height)
    else:
        where = check_axes(axes, names)
    for ax, k in zip(where, chosen, strict=True):
        _bands(ax, ensemble.t, values[..., k], levels)
        _style_of_joint(ax, model, k, of)
    figure = figure_of(where)
    if axes is None:
        handles, labels = where[0].get_legend_handles_labels()
        figure.legend(handles, labels, **BELOW | {"ncols": min(len(labels), 4)})
    return figure


def _style_of_joint(ax: Axes, model: Model, k: int, of: str, more: str = "") -> None:
    """Title and label of a panel for one quantity of joint k."""
    name, unit = QUANTITIES[of][not model.is_revolute[model.independent_joints[k]]]
    style_axes(ax, f"{name} [{unit}]{more}")
    ax.set_title(literal(model.joint_names[k]), fontsize="medium")


def _bands(ax: Axes, t: Array, values: Array, levels: Array) -> None:
    """Plot the bands of one joint, the outermost first; values of shape (P, S)."""
    pairs = len(levels) // 2
    for k, shade in enumerate(np.linspace(PALE, DARK, pairs)):
        label = f"{100 * levels[k]:.4g} to {100 * levels[-1 - k]:.4g} %"
        ax.fill_between(t, values[k], values[-1 - k], color="C0", alpha=shade, linewidth=0, label=label)
    if len(levels) % 2:
        ax.plot(t, values[pairs], color="C0", linewidth=1.4, label=f"{100 * levels[pairs]:.4g} %")


def sensitivity_plot(
    found: Sensitivities,
    name: str | None = None,
    of: Literal["q", "qd", "tau"] = "q",
    *,
    joints: Sequence[str] | None = None,
    axes: Axes | Sequence[Axes] | None = None,
) -> Figure:
    """Derivatives of a motion with respect to one number over time, one panel for each joint.

    Parameters
    ----------
    found : Sensitivities
        Of `rne.sensitivities`.
    name : str, optional
        The number; by default the first.
    of : {"q", "qd", "tau"}
        Of positions, velocities or torques.
    joints : sequence of str, optional
        Names of the joints to show; by default all.
    axes : matplotlib axes or sequence of them, optional
        Where to draw, one for each joint; by default a new figure.

    Returns
    -------
    matplotlib.figure.Figure
        One curve for each entry of the number.

    Raises
    ------
    TypeError
        If `found` are no Sensitivities, or `axes` are no axes.
    ValueError
        If the motion was not differentiated with respect to this number, or `of` or a joint is unknown.
    ImportError
        If matplotlib is not installed.

    Examples
    --------
    >>> import rne
    >>> found = rne.sensitivities(rne.load("irb140"), [0] * 6, [0] * 6, 0.1, wrt=["gravity"])
    >>> [ax.get_ylabel().splitlines() for ax in rne.plotting.sensitivity_plot(found, joints=["joint_2"]).axes]
    [['position [rad]', 'by gravity']]
    """
    if not isinstance(found, Sensitivities):
        raise TypeError(f"`found` must be rne.Sensitivities, got {type(found).__name__}")
    _some_of(("q", "qd", "tau"), [of], "of", "quantity")
    number = _some_of(tuple(found.dq), [next(iter(found.dq), "") if name is None else name], "name", "number")[0]
    model, slopes = found.model, getattr(found, f"d{of}")[number]
    names = _some_of(model.joint_names, joints, "joints", "joint")
    where = (
        panels(len(names), f"Derivatives with respect to {number}, {model.name}")
        if axes is None
        else check_axes(axes, names)
    )
    entries = [f"{number}[{k}]" if slopes.shape[2] > 1 else number for k in range(slopes.shape[2])]
    for ax, joint in zip(where, names, strict=True):
        k = model.joint_names.index(joint)
        plot_columns(ax, found.t, slopes[:, k], entries, joint_colors(len(entries)))
        _style_of_joint(ax, model, k, of, f"\nby {literal(number)}")
    legend_beside(where[0])
    return figure_of(where)


def prediction_plot(
    t: ArrayLike,
    measured: ArrayLike,
    predicted: ArrayLike,
    qd: ArrayLike,
    *,
    std: ArrayLike = np.nan,
    valid: ArrayLike = True,
    joint_names: Robot | Sequence[str] | None = None,
    units: Sequence[str] | None = None,
    title: str = "Torques",
) -> Figure:
    """Measured and predicted torques and their difference over time, and the difference over velocity, by joint.

    Parameters
    ----------
    t : array_like, shape (T,)
        Times [s]; over a step that is longer than the others no line is drawn.
    measured, predicted : array_like, shape (T, n)
        Torques [N m or N].
    qd : array_like, shape (T, n)
        Joint velocities [rad/s or m/s].
    std : array_like, shape (T, n), optional
        Standard deviations of measured about predicted torques, drawn as a 95 % band where they are finite [N m or N].
    valid : array_like of bool, shape (T, n), optional
        False for torques that are left out over velocity.
    joint_names : Robot or sequence of str, length n, optional
        The robot, or names of its joints; by default numbers.
    units : sequence of str, length n, optional
        "N m" or "N", of positions "rad" or "m", by joint; by default those of the robot, or "N m".
    title : str
        Title of the figure.

    Returns
    -------
    matplotlib.figure.Figure
        Two panels for each joint.

    Raises
    ------
    ValueError
        If an array has the wrong shape, or there are too few or too many names.
    ImportError
        If matplotlib is not installed.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, t = rne.load("irb140"), np.linspace(0, 2, 50)
    >>> q, qd, qdd = rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)(t)
    >>> tau = robot.inverse_dynamics(q, qd, qdd)
    >>> len(rne.plotting.prediction_plot(t, 1.1 * tau, tau, qd, std=2.0, joint_names=robot).axes)
    12
    """
    times = real_numbers("t", t, "(T,)").astype(float)
    given = {"measured": measured, "predicted": predicted, "qd": qd, "std": std, "valid": valid}
    shape = np.shape(measured)
    for name, x in given.items():
        if times.ndim != 1 or len(shape) != 2 or shape[0] != len(times) or np.shape(x) not in (shape, ()):
            wanted = f"({len(times)}, n)" if name == "measured" else str(shape)
            raise ValueError(f"`{name}` must have shape {wanted}, got {np.shape(x)}")
    used = np.broadcast_to(np.asarray(valid, dtype=bool), shape)
    arrays = (np.broadcast_to(np.asarray(x, dtype=np.float64), shape) for x in (measured, predicted, qd, std))
    torques, expected, speed, deviation = arrays
    labels, rotating = joint_labels(Motion(times, {"tau": torques}), joint_names)
    if units is None:
        units = np.where(np.ones(len(labels), bool) if rotating is None else rotating, "N m", "N").tolist()
    if len(units) != len(labels):
        raise ValueError(f"`units` must have {len(labels)} entries, got {len(units)}")
    grid = panels(2 * len(labels), title, 2, height=1.5)
    band = BAND * np.where(np.isfinite(deviation), deviation, np.nan)
    for j, (ax, beside) in enumerate(zip(grid[::2], grid[1::2], strict=True)):
        _over_time(ax, times, torques[:, j], expected[:, j], band[:, j], named=j == 0)
        style_axes(ax, f"[{units[j]}]")
        ax.set_title(literal(short(labels[j])), loc="left", fontsize="small", pad=2)
        chosen = used[:, j]
        _over_velocity(beside, speed[chosen, j], (torques - expected)[chosen, j], band[chosen, j])
        unit = "rad/s" if units[j] in ("N m", "rad") else "m/s"
        beside.set_title(f"residual over velocity [{unit}]", loc="left", fontsize="small", pad=2)
    legend_beside(grid[0])
    figure = figure_of(grid)
    figure.align_ylabels(grid[::2])
    return figure


def _over_time(ax: Axes, t: Array, measured: Array, predicted: Array, band: Array, *, named: bool) -> None:
    """Plot torques of a joint over time, with an undefined sample in each gap, so that no line crosses it."""
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > GAP * np.median(steps)) + 1 if len(steps) else np.zeros(0, int)
    measured, predicted, band = (np.insert(x, gaps, np.nan) for x in (measured, predicted, band))
    t = np.insert(t, gaps, t[gaps - 1])
    label, ends = ("95 % band" if named else HIDDEN), (predicted - band, predicted + band)
    ax.fill_between(t, *ends, color=LOOK["predicted"][0], alpha=0.25, linewidth=0, label=label)
    curves = {"measured": measured, "predicted": predicted, "residual": measured - predicted}
    for label, values in curves.items():
        color, width = LOOK[label]
        plot_columns(ax, t, values[:, None], [label if named else HIDDEN], [color], linewidth=width)


def _over_velocity(ax: Axes, qd: Array, residual: Array, band: Array) -> None:
    """Plot residuals of a joint over its velocity, with the ends of their band."""
    known = np.isfinite(band)
    for side in (-band, band):
        ax.plot(qd[known], side[known], ".", color=LOOK["predicted"][0], markersize=1, alpha=0.4)
    ax.plot(qd, residual, ".", color=LOOK["residual"][0], markersize=2)
    seen = np.abs(residual[np.isfinite(residual)])
    largest = 1.1 * max(seen.max(initial=0), np.median(band[known]) if known.any() else 0.0)
    ax.set_ylim(-largest or None, largest or None)
    style_axes(ax, "")
    ax.set_xlabel("")


def panels_of(
    motion: Motion, labels: Sequence[str], rotating: Array | None, quantities: Sequence[str] | None
) -> list[Panel]:
    """Panels of the quantities, each with one unit where the types of the joints are known."""
    usual = [name for name in DEFAULT if name in motion.quantities and (name != "tau" or motion.is_driven)]
    colors, found = joint_colors(motion.n), []
    for quantity in _some_of(motion.quantities, usual if quantities is None else quantities, "quantities", "quantity"):
        if quantity in ENERGIES:
            names = ENERGIES[quantity]
            shades = joint_colors(len(names)) if len(names) > 1 else ["0.5"]
            found.append(Panel(quantity, list(range(len(names))), names, shades, f"{quantity} [J]"))
            continue
        for columns, label in _by_unit(quantity, motion.n, rotating):
            chosen = tuple(labels[k] for k in columns)
            found.append(Panel(quantity, columns, chosen, [colors[k] for k in columns], label))
    return found


def _some_of(known: Sequence[str], given: Sequence[str] | None, argument: str, noun: str) -> Sequence[str]:
    """Names given, at least one and all of them known; None stands for all."""
    if given is None:
        given = known
    if isinstance(given, str):
        raise TypeError(f"`{argument}` must be a sequence of str, got str")
    if not len(given):
        raise ValueError(f"`{argument}` must name at least one {noun}, got none")
    for name in given:
        if name not in known:
            raise ValueError(f"`{argument}` must be from {list(known)}, got {name!r}")
    return given


def _by_unit(quantity: str, n: int, rotating: Array | None) -> list[tuple[list[int], str]]:
    """Columns that share a unit, with their label."""
    (name, unit), (name_sliding, unit_sliding) = QUANTITIES[quantity]
    if rotating is None or not n:
        return [(list(range(n)), f"{name} [{unit} or {unit_sliding}]")]
    turning, sliding = np.flatnonzero(rotating).tolist(), np.flatnonzero(~rotating).tolist()
    groups = [(turning, f"{name} [{unit}]"), (sliding, f"{name_sliding} [{unit_sliding}]")]
    return [group for group in groups if group[0]]


def draw_panel(ax: Axes, panel: Panel, motion: Motion, other: Motion | None = None) -> None:
    """Draw the curves of one panel, those of a second motion dashed."""
    for drawn, style in ((motion, "-"), (other, DASHED)):
        if drawn is None or panel.quantity not in drawn.quantities:
            continue
        t, values = drawn.curve(panel.quantity)
        names = panel.names if drawn is motion else (HIDDEN,) * len(panel.names)
        at_samples = panel.quantity == "energy error" and len(t) <= SEPARATE
        marks = {"marker": ".", "linewidth": 0.6} if at_samples else {}
        plot_columns(ax, t, values[:, panel.columns], names, panel.colors, linestyle=style, **marks)
    style_axes(ax, panel.label)


def torque_speed(report: DriveReport) -> Figure:
    """Torque over speed of each drive during a cycle, with the limits of both as a frame, and the rms torque.

    Torques are those that the limits count, `DriveReport.drive_torque`: with the rotors that `rne.drives` was given.

    Parameters
    ----------
    report : DriveReport
        From `rne.drives`.

    Returns
    -------
    Figure
        A panel for each joint; crosses mark the peak torque.

    Raises
    ------
    ImportError
        If matplotlib is not installed.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140").with_limits(effort=[250, 250, 150, 50, 50, 20])
    >>> motion = rne.trajectories.fastest(robot, [[0] * 6, [1, 0.5, 0, 0, 0, 0]])
    >>> len(rne.plotting.torque_speed(rne.drives(robot, motion)).axes)
    6
    """
    columns = min(2, max(len(report.joints), 1))
    rows = -(-len(report.joints) // columns)
    figure = blank_figure(2.6 * columns, 2.2 * rows + 0.4)
    grid = list(figure.subplots(rows, columns, squeeze=False).flat)
    torque = report.drive_torque
    rms = np.sqrt(np.trapezoid(torque**2, report.t, axis=0) / report.duration)
    for k, (ax, joint) in enumerate(zip(grid, report.joints, strict=False)):
        qd, tau, limit, speed = report.speed[:, k], torque[:, k], report.effort_limit[k], report.velocity_limit[k]
        ax.plot(qd, tau, linewidth=1.0, label="cycle")
        peak = int(np.abs(tau).argmax())
        ax.plot(qd[peak], tau[peak], "x", color="C3", label="peak")
        for sign in (-1, 1):
            ax.axhline(sign * rms[k], color="C2", linestyle=":", label="rms" if sign > 0 else HIDDEN)
            for line, bound in ((ax.axhline, limit), (ax.axvline, speed)):
                if np.isfinite(bound):
                    line(sign * bound, color="C1", linestyle="--", label="limits" if sign > 0 else HIDDEN)
        ax.set_title(literal(short(joint)))
        ax.grid(True, alpha=0.3)
        ax.ticklabel_format(scilimits=(-3, 4))
    for ax in grid[len(report.joints) :]:
        ax.remove()
    handles: dict[str, Any] = {}
    for ax in grid[: len(report.joints)]:
        handles = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True)) | handles
    if handles:
        figure.legend(list(handles.values()), list(handles), **BELOW | {"ncols": 4})
    for ax in grid[: len(report.joints)][-columns:]:
        ax.set_xlabel("speed [rad/s or m/s]")
    for ax in grid[: len(report.joints) : columns]:
        ax.set_ylabel("torque [N m or N]")
    return figure


def small_plots(motion: Any, names: Robot | None = None) -> list[tuple[str, Callable[[], Figure]]]:
    """Panels of a Trajectory or arrays (t, q, ...) for narrow pages: the label of each and a function that draws it."""
    shown = motion_argument("motion", motion)
    wanted = panels_of(shown, *joint_labels(shown, names), None)
    return [(panel.label, partial(_small_plot, shown, panel)) for panel in wanted]


def _small_plot(motion: Motion, panel: Panel) -> Figure:
    figure = blank_figure(WIDTH, 2.9)
    ax = figure.add_subplot()
    draw_panel(ax, panel, motion)
    ax.set_xlabel("time [s]")
    if len(panel.columns) > COLORS:
        ax.set_title(literal(f"{short(panel.names[0])} (blue) to {short(panel.names[-1])} (red)"))
    elif panel.columns and panel.names[0] != HIDDEN:
        figure.legend(**BELOW)
    return figure


def _title(motion: Motion, other: Motion | None) -> str:
    if other is not None:
        return f"Solid: motion, {_origin(motion)}; dashed: other, {_origin(other)}"
    return "Given samples" if motion.trajectory is None else f"Motion {_origin(motion)}"


def _origin(motion: Motion) -> str:
    run = motion.trajectory
    return "as given" if run is None else f"by {run.method}{ENDINGS.get(run.status, '')}"


def has_matplotlib() -> bool:
    """True if matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def blank_figure(width: float, height: float) -> Figure:
    """Empty figure of the given size [inch]; without matplotlib an ImportError with the way to install it."""
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "matplotlib":  # it is installed, and something that it needs is not
            raise
        raise ImportError("pictures need matplotlib, which is not installed: pip install 'rne[plot]'") from None
    figure = Figure(figsize=(width, height), layout="constrained", dpi=120)
    figure.__dict__["_repr_png_"] = partial(_png, figure)  # notebooks show it, whether or not pyplot is imported
    return figure


def _png(figure: Figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()


def panels(count: int, title: str, columns: int = 1, height: float = 2.1) -> list[Axes]:
    """Panels of a new figure over time, row by row; those of one column share the time axis."""
    rows = -(-count // columns)
    figure = blank_figure(8 if columns == 1 else 3.2 * columns, height * rows)
    grid = list(figure.subplots(rows, columns, sharex=columns == 1, squeeze=False).flat)
    figure.suptitle(literal(title))
    for ax in grid[count:]:
        ax.remove()
    for ax in grid[:count][-columns:]:
        ax.set_xlabel("time [s]")
    return grid[:count]


def figure_of(axes: Sequence[Axes]) -> Figure:
    """Figure of some axes, that of the first if they are on several."""
    return axes[0].figure.canvas.figure  # also of axes on a part of a figure


def check_axes(axes: Any, labels: Sequence[str]) -> list[Axes]:
    """Given axes as a list, one for each label."""
    given = [axes] if hasattr(axes, "plot") else list(np.ravel(np.asarray(axes, dtype=object)))
    for ax in given:
        if not hasattr(ax, "plot"):
            raise TypeError(f"`axes` must be matplotlib axes, got {type(ax).__name__}")
    if len(given) != len(labels):
        raise ValueError(f"`axes` must have {len(labels)} axes, for {', '.join(labels)}; got {len(given)}")
    return given


def joint_colors(n: int) -> list[ColorType]:
    """A colour for each of n curves: those of matplotlib's cycle, or of a colour map if there are more."""
    if n <= COLORS:
        return [f"C{k}" for k in range(n)]
    from matplotlib import colormaps

    name, first, last = MANY
    return list(colormaps[name](np.linspace(first, last, n)))


def plot_columns(
    ax: Axes, t: Array, values: Array, names: Sequence[str], colors: Sequence[ColorType], **style: Any
) -> list[Line2D]:
    """Plot the columns of `values` over time."""
    drawn = []
    for column, name, color in zip(values.T, names, colors, strict=True):
        look = {"linewidth": 1.2, "marker": "." if len(t) == 1 else "", "label": literal(name), "color": color}
        drawn += ax.plot(t, column, **look | style)
    return drawn


def literal(name: str) -> str:
    """Name without matplotlib's special meanings of "$" and of a leading "_"."""
    text = name.replace("$", r"\$")
    return f"\u200b{text}" if text.startswith("_") and text != HIDDEN else text


def style_axes(ax: Axes, label: str) -> None:
    """Grid and label of a panel."""
    ax.grid(True, alpha=0.3)
    ax.set_ylabel(label)
    ax.ticklabel_format(axis="y", scilimits=(-3, 4))


def legend_beside(ax: Axes) -> None:
    """Add a legend to the right of a panel, in as many columns as needed; none if no curve is named."""
    _, labels = ax.get_legend_handles_labels()
    if labels:
        columns = -(-len(labels) // LEGEND_ROWS)
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", frameon=False, ncols=columns)
