"""Pictures of the closed loops of section 6.5 and of single joints, for the figures under the thesis's numbers."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import rne
from rne.commands.pages import SETTLED
from rne.model.abb_irb140 import KD, KP
from rne.plotting.html_page import log_axis
from rne.plotting.plots import BELOW

from .panels import column, lines

JOINTS = tuple(f"joint_{k}" for k in range(1, 7))
FIRST = 0.02  # [s], in which the wrist's torques fall from their peak
SMALLEST = 1e-8  # [rad], lower end of the axis of errors
FLOOR = 1e-16  # smallest value on a log axis
REFERENCE = "Dotted: the references."
GRAVITY = (
    "The thesis plots u = -Kp q̃ - Kd q̇ of (6.57)-(6.58), with gravity taken out of the model: the first two "
    "panels, the first 20 ms on a time axis of their own because of the wrist's peak. Below them what the drives of "
    "an arm with gravity must give, τ = u + g(q)."
)


def fine_grid(duration: float) -> np.ndarray:
    """Times 5e-5 s apart at first, then 1e-3 s [s]."""
    first = min(FIRST, duration)
    later = np.linspace(first, duration, 1 + round((duration - first) / 1e-3))
    times: np.ndarray = np.r_[np.linspace(0, first, 401)[:-1], later]
    return times


def log_lines(ax: Any, t: np.ndarray, values: Any, names: Sequence[str], first: int = 0, **style: Any) -> list[Any]:
    """Plot the sizes of the columns of `values` on a log axis; zeros leave gaps."""
    size = np.abs(values)
    drawn = lines(ax, t, np.where(size > FLOOR, size, np.nan), names, first, **style)
    log_axis(ax)
    return drawn


def plot_each_joint(title: str, motion: rne.Trajectory) -> Any:
    """Joint positions, each on a panel of its own."""
    figure, axes = column(title, [1.2] * len(JOINTS))
    for k, ax in enumerate(axes):
        lines(ax, motion.t, motion.q[:, [k]], [JOINTS[k]])
        ax.set_title(f"{JOINTS[k]} [rad]")
    return figure


def plot_loop_inputs(title: str, motion: rne.Trajectory, reference: ArrayLike) -> Any:
    """Inputs of a closed loop, without gravity's share as in the thesis, and with it."""
    u = inputs(motion, reference)
    figure, axes = column(title, [1.9, 2.3, 2.3], share=False)
    later = motion.t >= min(FIRST, motion.t[-1])
    for ax, values, part, scale, text in (
        (axes[0], u, ~later, 1e3, "u without gravity's share, at first [N m]"),
        (axes[1], u, later, 1, "u without gravity's share, (6.58) [N m]"),
        (axes[2], motion.tau, later, 1, "τ = u + g(q), with gravity's share [N m]"),
    ):
        drawn = lines(ax, scale * motion.t[part], values[part], JOINTS)
        ax.set_title(text)
    axes[0].set_xlabel("time [ms]")
    figure.legend(handles=drawn, **BELOW)
    return figure


def inputs(motion: rne.Trajectory, reference: ArrayLike) -> np.ndarray:
    """The inputs u = -Kp q~ - Kd qd of (6.57)-(6.58), without gravity's share, shape (T, 6) [N m]."""
    u: np.ndarray = -np.array(KP) * (motion.q - np.asarray(reference)) - np.array(KD) * motion.qd
    return u


def plot_errors(title: str, motion: rne.Trajectory, reference: ArrayLike) -> Any:
    """Errors of a closed loop on a log axis."""
    figure, (ax,) = column(title, [2.8])
    error = np.abs(motion.q - np.asarray(reference))
    drawn = log_lines(ax, motion.t, np.maximum(error, SMALLEST), JOINTS)
    ax.set_ylim(SMALLEST, 10)
    ax.axhline(SETTLED, color="0.5", linestyle="--", linewidth=1)
    ax.set_title("|q - reference| [rad]; dashed: 0.01 rad")
    figure.legend(handles=drawn, **BELOW)
    return figure
