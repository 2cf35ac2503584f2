"""Identifiability of a scene's numbers from positions along motions: sensitivities instead of regressors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import is_dataclass, replace
from typing import Any

import numpy as np

from ...basics.spatial import Array
from ...basics.text import counted, listed, short
from ...simulation.scene import Scene
from ...simulation.sensitivities import sensitivities
from ...trajectories import spline
from .. import thresholds
from .limits import MotionLimits


def position_argument(scene: Any, wrt: str | Sequence[str] | None) -> tuple[str, ...]:
    """Names of the numbers to be found; an error for those not identifiable from positions."""
    if not isinstance(scene, Scene):
        raise TypeError(
            f"`robot` must be an rne.Scene, whose controller follows the motion, for `measured` 'positions', "
            f"got {type(scene).__name__}"
        )
    law = scene.controller
    if not is_dataclass(law) or not hasattr(law, "reference"):
        raise ValueError(
            "`robot` must be a scene whose controller has a `reference`, as rne.control.servo and rne.control.pd have, "
            f"for `measured` 'positions', got {'none' if law is None else type(law).__name__}"
        )
    if not wrt:
        raise ValueError("`wrt` must name the numbers of the scene that are to be found from positions, got none")
    names = tuple(dict.fromkeys((wrt,) if isinstance(wrt, str) else wrt))
    for name in names:
        if name in ("q0", "qd0", "controller.reference"):
            raise ValueError(f"`wrt` must name numbers that are to be found from positions, got {name!r}")
        scene.numbers[name]  # a KeyError lists the names
    return names


def position_matrices(
    scene: Scene,
    names: Sequence[str],
    within: MotionLimits,
    x: Array,
    noise: Array,
    progress: Callable[[int, int], Any] | None,
) -> tuple[list[Array], tuple[str, ...]]:
    """Derivatives of positions with respect to numbers along each series, over the noise, and a note.

    Of each motion only the second of two periods is used, after the start has settled. Columns are divided by their
    norms over all motions, and combined to the directions that at least one motion determines.
    """
    found = []
    for k, series in enumerate(x):
        found.append(_derivatives(scene, names, within, series) / noise[:, None])
        if progress is not None:
            progress(k + 1, len(x))
    matrices = [J.reshape(-1, J.shape[-1]) for J in found]
    norms = np.sqrt(sum((J**2).sum(0) for J in matrices))
    scaled = [J / np.where(norms > 0, norms, 1.0) for J in matrices]
    _, s, Vt = np.linalg.svd(np.vstack([np.linalg.qr(J)[1] for J in scaled]))
    known = int((s > thresholds.UNTOLD * s[0]).sum())
    if not known or not norms.any():
        raise ValueError(f"`wrt`: positions along {counted(len(x), 'random motion')} depend on none of these numbers")
    return [J @ Vt[:known].T for J in scaled], _untold(scene, names, Vt[known:])


def _derivatives(scene: Scene, names: Sequence[str], within: MotionLimits, series: Array) -> Array:
    """Derivatives of positions at equal times of one period, shape (T, n, p)."""
    basis, count = within.basis, thresholds.OBSERVED * within.basis.harmonics
    t = np.arange(2 * count + 1) * (basis.duration / count)
    q, _, _ = basis.states(t[:, None], within.coefficients(series))
    at = replace(scene, controller=replace(scene.controller, reference=spline(t, q)))
    run = sensitivities(at, q[0], 0 * q[0], float(t[-1]), wrt=names, t_eval=t[count:-1])
    return np.concatenate([run.dq[name] for name in names], axis=-1)


def _untold(scene: Scene, names: Sequence[str], directions: Array) -> tuple[str, ...]:
    """Note on numbers that are identifiable only with others known."""
    if not len(directions):
        return ()
    labels, joints = [], scene.resolved.robot.joint_names
    for name in names:
        size = scene.numbers[name].size
        own = [f" of {short(joint)}" for joint in joints] if size == len(joints) else [f"[{k}]" for k in range(size)]
        labels += [f"{name}{place if size > 1 else ''}" for place in own]
    parts = np.linalg.norm(directions, axis=0)
    some = [label for label, part in zip(labels, parts, strict=True) if part > thresholds.TAKES_PART]
    told = f"no motion determines {counted(len(directions), 'combination')} of {listed(some)}; it is left out"
    return (told if len(directions) == 1 else told.replace("it is", "they are"),)
