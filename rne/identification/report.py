"""The report of an identification as text: what was fitted, what was found, and how far to trust it.

`found` is an Identification, whose method calls these functions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..basics.text import Row, aligned, counted, short
from ..model.parameters import PARAMETERS
from .least_squares import LEAST_NOISE

EXPLAINED = 0.15  # part of a torque in motion that may be left where a model explains it
EXPLAINS = 0.5  # part of a joint's squares that a cause takes away if it explains them
WORSE = 1.2  # residuals of possible bodies, of those of least squares


def report_text(found: Any) -> str:
    """The report, in paragraphs.

    Parameters
    ----------
    found : Identification

    Returns
    -------
    str
    """
    parts = [fitted_text(found), joints_text(found), causes_text(found), parameters_text(found)]
    if found.consistent:
        parts.append(bodies_text(found))
    return "\n\n".join(parts)


def fitted_text(found: Any) -> str:
    """What was fitted: the motions, their filter, the prior."""
    e = found.estimate
    lines = [
        f"{counted(found.base.count, 'base parameter')} of {short(found.initial.model.name)} from "
        f"{counted(int(found.equations.rows.sum()), 'equation')}, condition number {e.condition:.3g} "
        f"({e.scaled_condition:.3g} with columns of unit length)"
    ]
    for name, record in zip(found.data.names, found.records, strict=True):
        lines.append(f"motion {short(name)}: {len(record.t) / record.sample_rate:.3g} s at {record.sample_rate:.6g} Hz")
        lines += [f"  {note}" for note in record.notes]
    return "\n".join([*lines, *found.notes])


def joints_text(found: Any) -> str:
    """Errors of each joint."""
    fitted = found.equations.residuals(found.parameters)
    torques = np.maximum(found.equations.torques(), np.finfo(float).tiny)
    columns = ("noise [N m or N]", "fitted [%]", "held out: in motion", "at rest", "equations", "independent")
    rows = [Row("errors", columns, words=True)]
    left = found.unexplained
    for j, name in enumerate(found.initial.joint_names):
        shares = (np.sqrt(fitted[j] / torques[j]), left.in_motion[j], left.at_rest[j])
        count = int(found.equations.rows[:, j].sum())
        cells = (
            f"{found.estimate.sigma[j]:.4g}",
            *("-" if np.isnan(left.everywhere[j]) or np.isnan(x) else f"{100 * x:.1f}" for x in shares),
            str(count),
            f"{count / found.repeats[j]:.0f}",
        )
        rows.append(Row(f"  {short(name)}", cells))
    blocks = len(found.equations.factors)
    close = (
        f"Held out: each of {blocks} blocks of the measurements, predicted by a fit to the others. At rest: torques of "
        "slow joints, which are not fitted because Coulomb friction then has no known direction."
    )
    return "\n".join([*aligned(rows), close, *motions_text(found)])


def causes_text(found: Any) -> str:
    """What would explain the residuals, the likeliest first, and joints that are not explained."""
    lines: list[str] = []
    for j, (name, left) in enumerate(zip(found.initial.joint_names, found.unexplained.in_motion, strict=True)):
        if left > EXPLAINED:
            own = [cause.text for cause in found.causes if cause.removed[j] > EXPLAINS]
            why = f": {own[0]}" if own else ": no single change of the log, the robot or the drives explains it"
            lines.append(f"  {short(name)} {100 * left:.0f} % in motion{why}")
    lines = ["not explained", *lines] if lines else []
    if found.causes:
        lines.append("likely causes of what is left, and how much of a joint's residual each takes away")
        lines += [f"  {100 * (1 - np.sqrt(max(1 - c.removed.max(), 0))):.0f} %: {c.text}" for c in found.causes]
    return "\n".join(lines or ["no single change of the log, the robot or the drives explains what is left"])


def motions_text(found: Any) -> list[str]:
    """Errors of each of several motions."""
    if len(found.records) == 1:
        return []
    rows = [Row("errors of each motion [%]", [short(name) for name in found.initial.joint_names], words=True)]
    each = len(found.equations.factors) // len(found.records)
    for k, name in enumerate(found.data.names):
        part = found.equations.of_blocks(np.arange(each * k, each * (k + 1)))
        share = np.sqrt(part.residuals(found.parameters) / np.maximum(part.torques(), np.finfo(float).tiny))
        rows.append(Row(f"  {short(name)}", [f"{100 * x:.1f}" for x in share]))
    return aligned(rows)


def parameters_text(found: Any) -> str:
    """Base parameters with standard errors."""
    e = found.estimate
    title = "least squares", "standard error", "drift", *(("consistent",) if found.consistent else ())
    joints = ", ".join(f"{k} {short(name)}" for k, name in enumerate(found.initial.model.moving_joints, 1))
    rows = [Row("base parameters", title, words=True)]
    for k, name in enumerate(found.base.names):
        numbers = [e.values[k], e.errors[k], found.drift[k], *([found.values[k]] if found.consistent else [])]
        rows.append(Row(f"  {name}", ["-" if np.isnan(x) else f"{x:.5f}" for x in numbers]))
    lines = [*aligned(rows), f"Numbers are those of the joints: {joints}."]
    combined = [text for name, text in zip(found.base.names, found.base.formulas, strict=True) if text != name]
    lines += (
        ["Base parameters that stand for a combination of several:", *(f"  {text}" for text in combined)]
        if combined
        else []
    )
    moved = [name for name, x, error in zip(found.base.names, found.drift, e.errors, strict=True) if abs(x) > 3 * error]
    if moved:
        lines.append(
            f"drift, the change with half the cut-off, beyond three standard errors: {', '.join(moved)}; the filter "
            "biases these, or something else changes with frequency"
        )
    weak = [name for name, seen in zip(found.base.names, found.excited, strict=True) if not seen]
    if weak:
        lines.append(f"not excited, with a standard error above the expected size: {', '.join(weak)}")
    return "\n".join(lines)


def bodies_text(found: Any) -> str:
    """Masses and centres of the consistent bodies; each is one of many with the same torques."""
    rows = [Row("bodies", ("mass [kg]", "centre x [m]", "y", "z"), words=True)]
    bodies = found.parameters[found.standard.groups["bodies"]].reshape(-1, PARAMETERS)
    for name, body in zip(found.initial.model.moving_joints, bodies, strict=True):
        rows.append(Row(f"  {short(name)}", [f"{x:.4f}" for x in (body[0], *(body[1:4] / body[0]))]))
    return "\n".join([*aligned(rows), closing(found)])


def closing(found: Any) -> str:
    """What the bodies are worth."""
    values = found.base.back @ found.estimate.values, found.parameters
    size = np.sqrt(found.equations.torques() / np.maximum(found.equations.rows.sum(0), 1))
    sigma = np.maximum(found.estimate.sigma, LEAST_NOISE * size)
    free, consistent = ((found.equations.residuals(x) / sigma**2).sum() for x in values)
    growth = float(np.sqrt(consistent / max(free, found.equations.rows.sum())))
    if growth > WORSE:
        return (
            f"No possible bodies fit as least squares do: residuals are {growth:.3g} times larger. Signs, units and "
            "zeros of the measurements may be wrong, friction or rotors missing, or the prior too narrow (`spread`)."
        )
    return (
        "Torques do not determine single masses: of all bodies with the same base parameters, these are the nearest to "
        "the prior."
    )
