"""Figures that the thesis does not have: what its figures do not show."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import rne
from rne.plotting.html_page import log_axis
from rne.plotting.plots import BELOW

from .closed_loop import lyapunov
from .experiments import SAMPLE_TIMES, SOLVERS, Timed, levels, wrong_height
from .formulations import Motion, Pair
from .loop_plots import FLOOR, JOINTS, log_lines
from .numbered_figures import DASHED
from .panels import column, lines


def plot_holding(runs: Sequence[rne.Trajectory]) -> Any:
    """Distance of the joints from their start under a constant torque, for each run."""
    title = "Distance from the start, constant torque"
    figure, axes = column(title, [1.9] * 4, share=False)
    for ax, run, k in zip(axes, runs, range(1, 5), strict=True):
        drawn = log_lines(ax, run.t, run.q - run.q[0], JOINTS)
        if not (run.q - run.q[0]).any():
            ax.set_xlim(0, run.t[-1])
            ax.set_ylim(FLOOR, 1)
            ax.text(0.5, 0.5, "no joint moves by a single bit", transform=ax.transAxes, ha="center", va="center")
        ax.set_title(f"6.3-{k}: |q - start| [rad]")
    figure.legend(handles=drawn, **BELOW)
    return figure


def plot_swings(one: rne.Trajectory, other: rne.Trajectory) -> Any:
    """The distance between two free swings that start 1e-6 rad apart."""
    figure, (ax,) = column("Difference of the swings 6.4-1 and 6.4-2", [2.4])
    log_lines(ax, one.t, np.abs(one.q - other.q).max(axis=1)[:, None], [""])
    ax.set_title("largest difference of any joint [rad]")
    return figure


def plot_energies(swings: Sequence[rne.Trajectory]) -> Any:
    """Total energy of both free swings with the height of the wrist of (6.38), of which only that height varies."""
    figure, axes = column("Total energy with the height of (6.38)", [1.7] * len(swings))
    for k, (ax, swing) in enumerate(zip(axes, swings, strict=True)):
        lines(ax, swing.t, (wrong_height(swing) - swing.energy[0])[:, None], [""], first=3)
        ax.set_title(f"6.4-{k + 1}: total less {swing.energy[0]:.4f} J [J]")
    return figure


def plot_lyapunov(motions: Sequence[rne.Trajectory]) -> Any:
    """V and its rate of decrease in the three closed loops."""
    figure, axes = column("Lyapunov function of the closed loops", [2.2, 2.2])
    pairs = [lyapunov(motion, k) for k, motion in enumerate(motions)]
    names = [f"6.5-{k + 1}" for k in range(len(motions))]
    drawn = log_lines(axes[0], motions[0].t, np.stack([V for V, _ in pairs], axis=1), names)
    axes[0].set_title("V of (6.50) [J]")
    log_lines(axes[1], motions[0].t, np.stack([-rate for _, rate in pairs], axis=1), names)
    axes[1].set_title("-dV/dt of (6.55) [W]")
    figure.legend(handles=drawn, **BELOW)
    return figure


def plot_stiffness(loops: Sequence[Mapping[str, Timed]]) -> Any:
    """Evaluations of the right-hand side by each solver for the closed loops."""
    figure, (ax,) = column("Evaluations of RK45 and of stiff solvers", [3.2])
    for k, loop in enumerate(loops):
        counts = [loop[method].motion.evaluations for method in SOLVERS]
        bars = ax.bar(np.arange(len(SOLVERS)) + 0.27 * (k - 1), counts, 0.25, label=f"6.5-{k + 1}")
        ax.bar_label(bars, [f"{count}" for count in counts], rotation=90, padding=3)
    ax.set_xticks(range(len(SOLVERS)), SOLVERS)
    log_axis(ax)
    ax.set_ylim(300, 6e6)
    ax.grid(visible=False, axis="x")
    ax.set_xlabel("")
    ax.set_title("evaluations for the run")
    figure.legend(**BELOW)
    return figure


def plot_sampled(runs: Sequence[Sequence[Timed]], limit: float) -> Any:
    """Largest joint rate of the sampled closed loops, just below and just above the stability limit."""
    title = f"Sampled control: stable below {limit:.4g} s"
    figure, axes = column(title, [2.2, 2.2], share=False)
    for ax, j in zip(axes, range(2), strict=True):
        for k, pair in enumerate(runs):
            motion, style = pair[j].motion, DASHED if k == 2 else "-"
            rate = np.abs(motion.qd).max(axis=1)[:, None]
            log_lines(ax, motion.t, rate, [f"6.5-{k + 1}"], first=k, linestyle=style)
        ax.set_title(f"sample time {SAMPLE_TIMES[j]:.3g} s: largest rate [rad/s]")
    figure.legend(*axes[0].get_legend_handles_labels(), **BELOW)
    return figure


def plot_formulations(pairs: Mapping[str, Pair]) -> Any:
    """Differences between the formulations in one motion, for each closed loop."""
    figure, (ax,) = column("One motion by both formulations", [2.4])
    for k, (run, pair) in enumerate(pairs.items()):
        log_lines(ax, pair.newton.t, np.abs(pair.difference).max(axis=1)[:, None], [run], first=k)
    ax.set_title("largest difference of any joint, q3 turned back [rad]")
    figure.legend(**BELOW)
    return figure


def plot_tipping(motion: Motion, distance: np.ndarray, rate: float) -> Any:
    """7.1-2 from 1e-6 rad along its unstable mode, and the exponential growth of its linearisation."""
    figure, (ax,) = column("7.1-2 started 1e-6 rad off its equilibrium", [2.4])
    growth = 1e-6 * np.exp(rate * motion.t)
    log_lines(ax, motion.t, distance[:, None], ["simulated"])
    log_lines(ax, motion.t, np.where(growth < 3, growth, np.nan)[:, None], [f"exp({rate:.3f} t)"], 1, linestyle=DASHED)
    ax.set_title("distance from the equilibrium [rad]")
    figure.legend(**BELOW)
    return figure


def plot_long(runs: Mapping[str, rne.Trajectory]) -> Any:
    """Energy errors over long runs, by method and tolerance, and their levels."""
    duration = max(run.t[-1] for run in runs.values())
    figure, axes = column(f"Free swing for {duration:g} s: energy error", [1.8] * len(runs))
    for ax, (name, run) in zip(axes, runs.items(), strict=True):
        drawn = lines(ax, run.t, (run.energy - run.energy[0])[:, None], ["error"], color="0.5")
        middles, level = levels(run)
        drawn += lines(ax, middles, level[:, None], ["its level: medians"], first=3)
        ax.set_title(f"{name}: energy error [J]")
    figure.legend(handles=drawn, **BELOW)
    return figure
