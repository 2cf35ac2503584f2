"""The figures of the thesis by its numbers, drawn from our runs as the thesis draws them."""

from typing import Any, NamedTuple

import numpy as np

import rne
from rne.model.abb_irb140 import CLOSED_LOOPS
from rne.plotting.plots import BELOW

from .formulations import Pair, SameNumbers
from .loop_plots import FLOOR, GRAVITY, JOINTS, REFERENCE, log_lines, plot_each_joint, plot_loop_inputs
from .panels import column, lines

NOTHING = 1e-14  # [rad], some roundings
APART = 4.0  # times larger than the others: a joint gets a panel of its own
DASHED = (0, (4, 3))  # over a solid line that it may cover


class Numbered(NamedTuple):
    """A figure of the thesis: its number, what it shows, and what we draw in addition."""

    number: str
    shows: str
    note: str

    @property
    def title(self) -> str:
        """Such as "Figure 6.12: control inputs of run 6.5-1"."""
        return f"Figure {self.number}: {self.shows}"

    @property
    def file(self) -> str:
        """Name of the picture, without its ending."""
        return f"figure_{self.number.replace('.', '_')}"


OWN_AXIS = "A joint that turns much farther than the others has a panel of its own."
COVERED = "The curves of joint_1, joint_4, joint_5 and joint_6 cover each other at 0."
SCALES = "Each joint has its own scale."
BESIDE = f"Dashed, for comparison: run 6.4-1, which starts 1e-6 rad away. {SCALES}"
CLOSE_UP = "At the thesis's tolerance. Below, the total by itself: its variation is the solver's error."
BOTH = "Each formulation in its own coordinates, q3 of opposite sign; at the bottom the difference with q3 turned back."
SAME = (
    "Start and reference (dotted) are the numbers of figure {}, taken in the coordinates of the Euler-Lagrange model. "
    "Its q3 counts the other way, so that the arm moves otherwise. Below, how far the numbers are from that figure."
)
POSITIONS, ENERGIES, INPUTS = (f"{what} of run" for what in ("joint positions", "energies", "control inputs"))
FIGURES = (
    Numbered("6.2", f"{POSITIONS} 6.3-1", OWN_AXIS),
    Numbered("6.3", f"{POSITIONS} 6.3-2", OWN_AXIS),
    Numbered("6.4", f"{POSITIONS} 6.3-3", COVERED),
    Numbered("6.5", f"{POSITIONS} 6.3-4", ""),
    Numbered("6.6", f"{POSITIONS} 6.4-1", SCALES),
    Numbered("6.7", f"{ENERGIES} 6.4-1", CLOSE_UP),
    Numbered("6.8", f"{POSITIONS} 6.4-2", BESIDE),
    Numbered("6.9", f"{ENERGIES} 6.4-2", CLOSE_UP),
    Numbered("6.11", f"{POSITIONS} 6.5-1", REFERENCE),
    Numbered("6.12", f"{INPUTS} 6.5-1", GRAVITY),
    Numbered("6.13", f"{POSITIONS} 6.5-2", REFERENCE),
    Numbered("6.14", f"{INPUTS} 6.5-2", GRAVITY),
    Numbered("6.15", f"{POSITIONS} 6.5-3", REFERENCE),
    Numbered("6.16", f"{INPUTS} 6.5-3", GRAVITY),
    Numbered("7.1", "run 7.1-1 by both formulations", f"{BOTH} {COVERED}"),
    Numbered("7.2", "run 7.1-2 by both formulations", BOTH),
    Numbered("7.3", "Euler-Lagrange, numbers of 6.5-1", SAME.format("6.11")),
    Numbered("7.4", "Euler-Lagrange, numbers of 6.5-2", SAME.format("6.13")),
    Numbered("7.5", "Euler-Lagrange, numbers of 6.5-3", SAME.format("6.15")),
)
BY_NUMBER = {figure.number: figure for figure in FIGURES}


def positions(title: str, t: np.ndarray, q: np.ndarray, reference: np.ndarray | None = None) -> Any:
    """q(t) of all joints, those that turn much farther on panels of their own."""
    groups = apart(q)
    figure, axes = column(title, [2.8] + [1.5] * (len(groups) - 1))
    for ax, group in zip(axes, groups, strict=True):
        for k in group:
            lines(ax, t, q[:, [k]], JOINTS[k : k + 1], first=k)
            if reference is not None:
                ax.axhline(reference[k], color=f"C{k}", linestyle=":", linewidth=1)
        ax.set_title("q [rad]" if len(group) > 1 else f"q of {JOINTS[group[0]]} [rad]")
    figure.legend(handles=_by_joint(axes), **BELOW)
    return figure


def apart(values: np.ndarray) -> list[list[int]]:
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


def _by_joint(panels: list[Any]) -> list[Any]:
    """A curve of each joint in their order, whichever panel it is in."""
    curves = {curve.get_label(): curve for ax in panels for curve in ax.lines}
    return [curves[name] for name in JOINTS]


def holding(number: str, motion: rne.Trajectory) -> Any:
    """6.2 to 6.5: q(t) under the constant torque."""
    return positions(BY_NUMBER[number].title, motion.t, motion.q)


def swing_positions(number: str, swing: rne.Trajectory, beside: rne.Trajectory | None = None) -> Any:
    """6.6, 6.8: q(t) of a free swing, joint by joint, and of another one beside it."""
    figure = plot_each_joint(BY_NUMBER[number].title, swing)
    if beside is not None:
        for k, ax in enumerate(figure.axes):
            lines(ax, beside.t, beside.q[:, [k]], [""], color="0.5", linestyle=DASHED)
    return figure


def swing_energies(number: str, swing: rne.Trajectory) -> Any:
    """6.7, 6.9: energies of a free swing, and the total close up."""
    figure, axes = column(BY_NUMBER[number].title, [2.2, 1.7])
    parts = np.stack([swing.kinetic, swing.potential, swing.energy], axis=1)
    drawn = lines(axes[0], swing.t, parts, ("kinetic", "potential", "total"))
    axes[0].set_title("energy [J]")
    lines(axes[1], swing.t, (swing.energy - swing.energy[0])[:, None], [""], first=2)
    axes[1].set_title(f"total less {swing.energy[0]:.4f} J [J]")
    figure.legend(handles=drawn, **BELOW)
    return figure


def loop_positions(number: str, motion: rne.Trajectory, k: int) -> Any:
    """6.11, 6.13, 6.15: q(t) of a closed loop."""
    return positions(BY_NUMBER[number].title, motion.t, motion.q, np.array(CLOSED_LOOPS[k].reference))


def loop_inputs(number: str, motion: rne.Trajectory, k: int) -> Any:
    """6.12, 6.14, 6.16: inputs of a closed loop, without gravity's share as in the thesis, and with it."""
    return plot_loop_inputs(BY_NUMBER[number].title, motion, CLOSED_LOOPS[k].reference)


def formulations(number: str, pair: Pair) -> Any:
    """7.1, 7.2: q(t) by both formulations, each in its own coordinates, and the difference between the motions."""
    groups = apart(pair.newton.q)
    heights = [2.0 if len(group) > 1 else 1.3 for group in groups]
    figure, axes = column(BY_NUMBER[number].title, [*heights * 2, 1.8])
    halves = ((pair.newton, "Newton-Euler"), (pair.lagrange, "Euler-Lagrange"))
    panels = [(motion, name, group) for motion, name in halves for group in groups]
    for ax, (motion, name, group) in zip(axes, panels, strict=False):
        for k in group:
            lines(ax, motion.t, motion.q[:, [k]], JOINTS[k : k + 1], first=k)
        ax.set_title(f"{name}: q [rad]" if len(group) > 1 else f"{name}: q of {JOINTS[group[0]]} [rad]")
    difference = np.abs(pair.difference).max(axis=1)
    log_lines(axes[-1], pair.newton.t, difference[:, None], [""], color="0.5")
    if difference.max() < NOTHING:
        axes[-1].set_ylim(FLOOR, 1)
        text = f"at most {difference.max():.0e} rad"
        axes[-1].text(0.5, 0.5, text, transform=axes[-1].transAxes, ha="center", va="center")
    axes[-1].set_title("largest difference of any joint, q3 turned back [rad]")
    figure.legend(handles=_by_joint(axes[:-1]), **BELOW)
    return figure


def same_numbers(number: str, run: SameNumbers) -> Any:
    """7.3 to 7.5: q(t) by Euler-Lagrange from the numbers of a Newton-Euler run, and the distance from that run."""
    figure, axes = column(BY_NUMBER[number].title, [2.8, 1.8])
    distance = run.distance
    shown = slice(run.shown)
    drawn = lines(axes[0], run.lagrange.t[shown], run.lagrange.q[shown], JOINTS)
    for k, q in enumerate(run.reference):
        axes[0].axhline(q, color=f"C{k}", linestyle=":", linewidth=1)
    axes[0].set_title("Euler-Lagrange, in its own coordinates: q [rad]")
    lines(axes[1], run.lagrange.t[shown], distance, JOINTS)
    axes[1].set_title("less the numbers by Newton-Euler [rad]")
    figure.legend(handles=drawn, **BELOW)
    return figure
