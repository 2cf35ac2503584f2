"""The figures of the thesis by its numbers, drawn from our runs as the thesis draws them."""

from typing import Any, NamedTuple

import numpy as np

import rne
from rne.commands.pages import GRAVITY, JOINTS, REFERENCE, plot_loop_inputs
from rne.model.abb_irb140 import CLOSED_LOOPS
from rne.plotting.html_page import FLOOR, column, lines, log_lines
from rne.plotting.plots import BELOW

from .formulations import Pair

NOTHING = 1e-14  # [rad], some roundings
APART = 4.0  # times larger than the others: a joint gets a panel of its own
DASHED = (0, (4, 3))  # over a solid line that it may cover


class Numbered(NamedTuple):
    """A figure of the thesis: its number, what it shows, the run, and what we draw in addition."""

    number: str
    shows: str
    run: str
    note: str

    @property
    def title(self) -> str:
        """Such as "Figure 6.12: control inputs of run 6.5-1"."""
        return f"Figure {self.number}: {self.shows} of run {self.run}"

    @property
    def file(self) -> str:
        """Name of the picture, without its ending."""
        return f"figure_{self.number.replace('.', '_')}"


OWN_AXIS = "A joint that turns much farther than the others has a panel of its own."
BOTH = "Both formulations, positions in the coordinates of our arm; at the bottom the difference between them."
POSITIONS = "joint positions"
FIGURES = (
    Numbered("6.2", POSITIONS, "6.3-1", OWN_AXIS),
    Numbered("6.3", POSITIONS, "6.3-2", OWN_AXIS),
    Numbered("6.4", POSITIONS, "6.3-3", "The curves of joint_1, joint_4, joint_5 and joint_6 cover each other at 0."),
    Numbered("6.5", POSITIONS, "6.3-4", ""),
    Numbered("6.9", POSITIONS, "6.4-1", "Dashed: run 6.4-2, which starts 1e-6 rad off. Each joint has its own scale."),
    Numbered("6.11", POSITIONS, "6.5-1", REFERENCE),
    Numbered("6.12", "control inputs", "6.5-1", GRAVITY),
    Numbered("6.13", POSITIONS, "6.5-2", REFERENCE),
    Numbered("6.14", "control inputs", "6.5-2", GRAVITY),
    Numbered("6.15", POSITIONS, "6.5-3", REFERENCE),
    Numbered("6.16", "control inputs", "6.5-3", GRAVITY),
    Numbered("7.1", POSITIONS, "7.1-1", BOTH),
    Numbered("7.2", POSITIONS, "7.1-2", BOTH),
    Numbered("7.3", POSITIONS, "6.5-1", BOTH),
    Numbered("7.4", POSITIONS, "6.5-2", BOTH),
    Numbered("7.5", POSITIONS, "6.5-3", BOTH),
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


def swings(one: rne.Trajectory, other: rne.Trajectory) -> Any:
    """6.9: q(t) of the free swing, joint by joint, with that of the second one."""
    figure, axes = column(BY_NUMBER["6.9"].title, [1.25] * len(JOINTS))
    for k, ax in enumerate(axes):
        solid = lines(ax, one.t, one.q[:, [k]], ["6.4-1"])
        dashed = lines(ax, other.t, other.q[:, [k]], ["6.4-2"], first=1, linestyle=DASHED)
        ax.set_title(f"{JOINTS[k]} [rad]")
    figure.legend(handles=solid + dashed, **BELOW)
    return figure


def loop_positions(number: str, motion: rne.Trajectory, k: int) -> Any:
    """6.11, 6.13, 6.15: q(t) of a closed loop."""
    return positions(BY_NUMBER[number].title, motion.t, motion.q, np.array(CLOSED_LOOPS[k].reference))


def loop_inputs(number: str, motion: rne.Trajectory, k: int) -> Any:
    """6.12, 6.14, 6.16: inputs of a closed loop, without gravity's share as in the thesis, and with it."""
    return plot_loop_inputs(BY_NUMBER[number].title, motion, CLOSED_LOOPS[k].reference)


def formulations(number: str, pair: Pair) -> Any:
    """7.1 to 7.5: q(t) by both formulations, and the difference between them."""
    newton, lagrange = pair
    groups = apart(lagrange.q)
    panels = [*groups] * 2
    heights = [2.0 if len(group) > 1 else 1.3 for group in panels]
    figure, axes = column(BY_NUMBER[number].title, [*heights, 1.8])
    halves = ((lagrange, "Euler-Lagrange"), (newton, "Newton-Euler"))
    for ax, group, (motion, name) in zip(axes, panels, [h for h in halves for _ in groups], strict=False):
        for k in group:
            lines(ax, motion.t, motion.q[:, [k]], JOINTS[k : k + 1], first=k)
        ax.set_title(f"{name}: q [rad]" if len(group) > 1 else f"{name}: q of {JOINTS[group[0]]} [rad]")
    difference = np.abs(lagrange.q - newton.q).max(axis=1)
    log_lines(axes[-1], newton.t, difference[:, None], [""], color="0.5")
    if difference.max() < NOTHING:
        axes[-1].set_ylim(FLOOR, 1)
        text = f"at most {difference.max():.0e} rad"
        axes[-1].text(0.5, 0.5, text, transform=axes[-1].transAxes, ha="center", va="center")
    axes[-1].set_title("largest difference of any joint [rad]")
    figure.legend(handles=_by_joint(axes[:-1]), **BELOW)
    return figure
