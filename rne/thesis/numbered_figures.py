"""The figures of the thesis by its numbers, drawn from our runs as the thesis draws them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..model.abb_irb140 import CLOSED_LOOPS
from ..simulation.trajectory import Trajectory
from .canvas import DASHED, FLOOR, apart, column, heading, joint_grid, legend, lines, log_lines
from .closed_loop import FIRST, inputs
from .formulations import Pair

NOTHING = 1e-14  # [rad], some roundings
JOINTS = tuple(f"joint_{k}" for k in range(1, 7))


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
REFERENCE = "Dotted: the references."
GRAVITY = (
    "The thesis plots u = -Kp q̃ - Kd q̇ of (6.57)-(6.58), with gravity taken out of the model: the first two "
    "panels, the first 20 ms on a time axis of their own because of the wrist's peak. Below them what the drives of "
    "an arm with gravity must give, τ = u + g(q)."
)
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


def positions(title: str, t: Array, q: Array, reference: Array | None = None) -> Any:
    """q(t) of all joints, those that turn much farther on panels of their own."""
    groups = apart(q)
    figure, axes = column(title, [2.8] + [1.5] * (len(groups) - 1))
    for ax, group in zip(axes, groups, strict=True):
        for k in group:
            lines(ax, t, q[:, [k]], JOINTS[k : k + 1], first=k)
            if reference is not None:
                ax.axhline(reference[k], color=f"C{k}", linestyle=":", linewidth=1)
        heading(ax, "q [rad]" if len(group) > 1 else f"q of {JOINTS[group[0]]} [rad]")
    handles = [axes[[k in group for group in groups].index(True)] for k in range(6)]
    _joint_legend(figure, handles)
    return figure


def _joint_legend(figure: Any, panels: list[Any]) -> None:
    """A legend of the joints in their order, whichever panel each is in."""
    named: dict[str, Any] = {}
    for ax in panels:
        handles, labels = ax.get_legend_handles_labels()
        named |= dict(zip(labels, handles, strict=True))
    shown = [name for name in JOINTS if name in named]
    figure.legend([named[name] for name in shown], shown, loc="outside lower center", ncols=3)


def holding(number: str, motion: Trajectory) -> Any:
    """6.2 to 6.5: q(t) under the constant torque."""
    return positions(BY_NUMBER[number].title, motion.t, motion.q)


def swings(one: Trajectory, other: Trajectory) -> Any:
    """6.9: q(t) of the free swing, joint by joint, with that of the second one."""
    figure, small, _ = joint_grid(BY_NUMBER["6.9"].title, JOINTS, "rad")
    for k, ax in enumerate(small):
        lines(ax, one.t, one.q[:, [k]], ["6.4-1"])
        lines(ax, other.t, other.q[:, [k]], ["6.4-2"], first=1, linestyle=DASHED)
    legend(figure, small[0])
    return figure


def loop_positions(number: str, motion: Trajectory, k: int) -> Any:
    """6.11, 6.13, 6.15: q(t) of a closed loop."""
    return positions(BY_NUMBER[number].title, motion.t, motion.q, np.array(CLOSED_LOOPS[k].reference))


def loop_inputs(number: str, motion: Trajectory, k: int) -> Any:
    """6.12, 6.14, 6.16: inputs of a closed loop, without gravity's share as in the thesis, and with it."""
    u = inputs(motion, k)
    figure, axes = column(BY_NUMBER[number].title, [1.9, 2.3, 2.3], share=False)
    later = motion.t >= min(FIRST, motion.t[-1])
    for ax, values, part, scale, text in (
        (axes[0], u, ~later, 1e3, "u without gravity's share, at first [N m]"),
        (axes[1], u, later, 1, "u without gravity's share, (6.58) [N m]"),
        (axes[2], motion.tau, later, 1, "τ = u + g(q), with gravity's share [N m]"),
    ):
        lines(ax, scale * motion.t[part], values[part], JOINTS)
        heading(ax, text)
    axes[0].set_xlabel("time [ms]")
    _joint_legend(figure, axes)
    return figure


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
        heading(ax, f"{name}: q [rad]" if len(group) > 1 else f"{name}: q of {JOINTS[group[0]]} [rad]")
    difference = np.abs(lagrange.q - newton.q).max(axis=1)
    log_lines(axes[-1], newton.t, difference[:, None], [""], color="0.5")
    if difference.max() < NOTHING:
        axes[-1].set_ylim(FLOOR, 1)
        text = f"at most {difference.max():.0e} rad"
        axes[-1].text(0.5, 0.5, text, transform=axes[-1].transAxes, ha="center", va="center")
    heading(axes[-1], "largest difference of any joint [rad]")
    _joint_legend(figure, axes[:-1])
    return figure
