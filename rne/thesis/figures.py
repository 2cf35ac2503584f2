"""Figures of the thesis's experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..basics.spatial import Array
from ..model.robots.abb_irb140 import CLOSED_LOOPS, KD, KP
from ..plotting.plots import blank_figure, curves, joint_panels, panels
from ..simulation.trajectory import Trajectory
from .experiments import SAMPLE_TIMES, SOLVERS, Timed, wrong_height

if TYPE_CHECKING:
    from matplotlib.axes import Axes

JOINTS = tuple(f"joint_{k}" for k in range(1, 7))
FLOOR = 1e-16  # smallest value on a log axis
DASHED = (0, (4, 4))  # over a solid line that it may cover


def _log(ax: Axes, t: Array, values: Array, names: Sequence[str], label: str, floor: float = FLOOR) -> None:
    curves(ax, t, np.where(np.abs(values) > floor, np.abs(values), np.nan), names, label)
    ax.set_yscale("log")


def plot_holding(runs: Sequence[Trajectory]) -> Any:
    """Distance of the joints from their start under a constant torque, for each run."""
    figure, axes = panels(4, "Constant holding torque, 6.3-1 to 6.3-4", share=False)
    for ax, run, k in zip(axes, runs, range(1, 5), strict=True):
        apart = run.q - run.q[0]
        _log(ax, run.t, apart, JOINTS, "|q - start| [rad]")
        if not apart.any():
            ax.set_xlim(0, run.t[-1])
            ax.set_ylim(FLOOR, 1)
            ax.text(0.5, 0.5, "no joint moves by a single bit", transform=ax.transAxes, ha="center", va="center")
        ax.set_title(f"6.3-{k}", fontsize="medium", loc="left")
        ax.set_xlabel("time [s]")
    return figure


def plot_swings(one: Trajectory, other: Trajectory) -> Any:
    """Two free swings that start 1e-6 rad apart, joint by joint, and the distance between them."""
    figure, joints, (below,) = joint_panels(JOINTS, "Free swings 6.4-1 and 6.4-2", "q [rad]", wide=1)
    for ax, first, second in zip(joints, one.q.T, other.q.T, strict=True):
        ax.plot(one.t, first, linewidth=1.2, label="6.4-1")
        ax.plot(other.t, second, linewidth=1.2, linestyle=DASHED, label="6.4-2, 1e-6 rad off at the start")
    figure.legend(*joints[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    apart = np.abs(one.q - other.q).max(axis=1)
    _log(below, one.t, apart[:, None], ("largest\ndifference",), "difference [rad]")
    return figure


def plot_energies(swing: Trajectory) -> Any:
    """Energy of 6.4-1 at the thesis's tolerance, with the correct height of the wrist and with that of (6.38)."""
    figure, axes = panels(3, "Energy of the free swing 6.4-1, RK45 at the thesis's tolerance")
    parts = np.stack([swing.kinetic, swing.potential, swing.energy], axis=1)
    curves(axes[0], swing.t, parts, ("kinetic", "potential", "total"), "energy [J]")
    curves(axes[1], swing.t, (wrong_height(swing) - swing.energy[0])[:, None], ("height\nof (6.38)",), "change [J]")
    curves(axes[2], swing.t, (swing.energy - swing.energy[0])[:, None], ("correct\nheight",), "change [J]")
    return figure


def lyapunov(motion: Trajectory, k: int) -> tuple[Array, Array]:
    """V of (6.50) and its derivative of (6.55) along a closed loop [J, W]."""
    error = motion.q - CLOSED_LOOPS[k].reference
    V = motion.kinetic + (np.array(KP) * error**2).sum(-1) / 2
    return V, -(np.array(KD) * motion.qd**2).sum(-1)


def plot_lyapunov(motions: Sequence[Trajectory]) -> Any:
    """V and its rate of decrease in the three closed loops."""
    figure, axes = panels(2, "Lyapunov function of the closed loops 6.5-1 to 6.5-3")
    pairs = [lyapunov(motion, k) for k, motion in enumerate(motions)]
    names = [f"6.5-{k + 1}" for k in range(len(motions))]
    _log(axes[0], motions[0].t, np.stack([V for V, _ in pairs], axis=1), names, "V [J]")
    _log(axes[1], motions[0].t, np.stack([-rate for _, rate in pairs], axis=1), names, "-dV/dt [W]")
    return figure


def plot_stiffness(loops: Sequence[Mapping[str, Timed]]) -> Any:
    """Evaluations of the right-hand side by each solver for the closed loops."""
    figure = blank_figure(8, 3.6)
    ax = figure.subplots()
    for k, loop in enumerate(loops):
        counts = [loop[method].motion.evaluations for method in SOLVERS]
        bars = ax.bar(np.arange(len(SOLVERS)) + 0.27 * (k - 1), counts, 0.25, label=f"6.5-{k + 1}")
        ax.bar_label(bars, [f"{count}" for count in counts], fontsize=7, rotation=90, padding=2)
    ax.set_xticks(range(len(SOLVERS)), SOLVERS)
    ax.set_yscale("log")
    ax.set_ylim(300, 3e6)
    ax.set_ylabel("evaluations for 5 s")
    ax.set_title("Evaluations of an explicit method (RK45) and of stiff solvers")
    ax.legend(loc="upper right", frameon=False, fontsize="small")
    return figure


def plot_sampled(runs: Sequence[Sequence[Timed]]) -> Any:
    """Largest joint rate of the sampled closed loops, just below and just above the stability limit."""
    figure, axes = panels(2, "Torques held between samples: stable below 1.308e-4 s", share=False)
    for ax, j in zip(axes, range(2), strict=True):
        for k, pair in enumerate(runs):
            motion, style = pair[j].motion, DASHED if k == 2 else "-"
            ax.plot(motion.t, np.abs(motion.qd).max(axis=1), label=f"6.5-{k + 1}", linewidth=1.2, linestyle=style)
        ax.set_yscale("log")
        ax.set_ylabel("largest rate [rad/s]")
        ax.set_title(f"sample time {SAMPLE_TIMES[j]:.3g} s", fontsize="medium", loc="left")
        ax.set_xlabel("time [s]")
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", frameon=False)
    return figure


def plot_tipping(motion: Trajectory, rate: float) -> Any:
    """7.1-2 from 1e-6 rad along its unstable mode, and the exponential growth of its linearisation."""
    figure, axes = panels(1, "Unstable equilibrium 7.1-2, started 1e-6 rad off")
    apart = np.abs(motion.q - [0, np.pi, np.pi / 2, 0, 0, 0]).max(axis=1)
    growth = 1e-6 * np.exp(rate * motion.t)
    names = ("simulated", f"exp({rate:.3f} t)")
    values = np.stack([apart, np.where(growth < 3, growth, np.nan)], axis=1)
    _log(axes[0], motion.t, values, names, "distance [rad]")
    axes[0].lines[1].set_linestyle(DASHED)
    axes[0].legend(loc="lower right", frameon=False)
    return figure


def plot_long(symplectic: Trajectory, explicit: Trajectory) -> Any:
    """Energy error over 1000 s by a symplectic method and by RK45."""
    figure, axes = panels(2, "Free swing for 1000 s")
    for ax, run, name in ((axes[0], symplectic, "gauss-4,\n5 ms"), (axes[1], explicit, "RK45,\nrtol 1e-4")):
        curves(ax, run.t, (run.energy - run.energy[0])[:, None], (name,), "energy error [J]")
    return figure
