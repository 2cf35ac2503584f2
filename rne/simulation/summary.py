"""A few words about a motion, for consoles."""

from __future__ import annotations

from typing import Any

from ..basics.text import counted, short, wrapped

LONGEST = 240  # characters of the solver's message


def trajectory_summary(motion: Any) -> str:
    """Robot, duration, solver, message and energies of a motion, in a few lines."""
    return wrapped("\n  ".join(trajectory_lines(motion)))


def trajectory_lines(motion: Any) -> list[str]:
    """What was simulated by what, how it ended, and the energies."""
    of = "" if motion.model is None else f" of '{short(motion.model.name)}'"
    t, message = motion.t, motion.message
    if len(message) > LONGEST:
        message = f"{message[: LONGEST - 3]}..."
    span = f", {t[0]:.6g} to {t[-1]:.6g} s" if len(t) else ""
    ends = f"energy {motion.energy[0]:.6g} to {motion.energy[-1]:.6g} J, " if len(t) else ""
    return [
        f"Trajectory{of}: {counted(motion.q.shape[1], 'joint')}{span}, {counted(len(t), 'sample')}, "
        f"{motion.method}, {counted(motion.evaluations, 'evaluation')}",
        f"status {motion.status}: {message}",
        f"{ends}largest energy error {motion.energy_drift:.2g} J",
    ]
