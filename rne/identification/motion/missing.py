"""Effects missing in a fit of motions that would explain its residual (score test, Rao 1948)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...basics.spatial import Array
from ...basics.text import short
from ...simulation.friction import Friction
from ...simulation.scene import Scene
from .. import thresholds
from ..diagnosis.hypotheses import Cause
from ..log.record import Record
from .output_error import OutputError, columns_for, commands
from .unknowns import DELAY, OFFSET, OUTSIDE, SCALE, SENSOR_OFFSET, Unknown, Unknowns, outside


class Effect(NamedTuple):
    """Quantity that may be missing: its name, text, and True if it can only be positive."""

    name: str
    text: str
    is_positive: bool


EFFECTS = (
    Effect("friction.viscous", "viscous friction", True),
    Effect("friction.coulomb", "Coulomb friction", True),
    Effect("friction.load", "friction that grows with load", True),
    Effect("friction.stribeck_rise", "the Stribeck effect", True),
    Effect("friction.offset", "a constant torque", False),
    Effect(DELAY, "a delay of commands", True),
    Effect(OFFSET, "an offset of commands", False),
    Effect(SCALE, "a scale of commands", False),
    Effect(SENSOR_OFFSET, "a zero of the positions", False),
)


def missing_effects(problem: OutputError, z: Array, noise: Array) -> tuple[Cause, ...]:
    """Effects missing in the model that would reduce the squares of the residual.

    Where the sensors explain the residual, reductions of any size count that chance does not explain.
    """
    rms = np.sqrt(np.nanmean(problem.misfits(z) ** 2, axis=0))
    is_fine = bool((rms < thresholds.ABOVE_RESOLUTION * noise).all())  # where small effects shift numbers unseen
    part = 0.0 if is_fine else thresholds.PART_EXPLAINED
    scene, parts = _extended(problem.unknowns)
    if not parts:
        return ()
    unknowns = Unknowns(scene, (*problem.unknowns.parts, *parts))
    P, P_all = len(problem.unknowns.labels), len(unknowns.labels)
    wider = replace(problem, unknowns=unknowns, traced={}, told=None)
    z_all = np.concatenate([z[:P], np.concatenate([part.start for part in parts]), z[P:]])
    J, r = wider.slopes(z_all)[: -len(z_all)], wider.residuals(z_all)[: -len(z_all)]
    known = np.delete(np.arange(len(z_all)), np.arange(P, P_all))
    Q, _ = np.linalg.qr(J[:, known])
    floor = float(np.min(noise / problem.sigma)) ** 2
    found = []
    for effect in EFFECTS:
        if effect.name not in unknowns.places or effect.name in problem.unknowns.places:
            continue
        found.append(_judged(effect, wider, J[:, unknowns.places[effect.name]], Q, r, (floor, part)))
    return tuple(sorted(filter(None, found), key=lambda cause: -cause.score))


def _judged(
    effect: Effect, wider: OutputError, J: Array, Q: Array, r: Array, floors: tuple[float, float]
) -> Cause | None:
    """Effect as a cause, if it explains enough, with its likely size for each joint.

    The gain is compared with that by chance: the variance of the remaining residual, at least the variance of the
    resolution, times its correlation time.
    """
    unknowns, (floor, part) = wider.unknowns, floors
    apart = J - Q @ (Q.T @ J)
    least = thresholds.APART_FROM_OTHERS * np.maximum(np.linalg.norm(J, axis=0), thresholds.TINY)
    is_apart = np.linalg.norm(apart, axis=0) > least
    if not is_apart.any():
        return None
    size = np.zeros(J.shape[1])
    size[is_apart] = -np.linalg.lstsq(apart[:, is_apart], r, rcond=None)[0]
    if effect.is_positive:
        size = np.maximum(size, 0.0)
    rest = r + apart @ size
    gain = float(r @ r - rest @ rest)
    chance = max(float(np.mean(rest**2)), floor) * float(wider.correlation_times(rest).max())
    score, share = gain / (chance * is_apart.sum()), gain / float(r @ r)
    if score < thresholds.SCORE or share < part:
        return None
    unknown = unknowns.parts[[p.name for p in unknowns.parts].index(effect.name)]
    joints = unknowns.scene.resolved.robot.joint_names
    names = joints if len(size) == len(joints) else ()
    each = [f"{x:.3g} on {short(name)}" for x, name in zip(size, names, strict=False) if x]  # or one for all joints
    of = ", ".join(each) or f"{size[0]:.3g}"
    what = f"{effect.text} is not in the model ({unknown.name} {of} {unknown.unit})".replace(" )", ")")
    text = f"{what}: it would explain {100 * share:.1f} % of the residual's squares"
    error = float(np.sqrt(chance / max(float((apart[:, is_apart] ** 2).sum(axis=0).max()), 1e-300)))
    return Cause(effect.name, tuple(names), text, score, float(size[np.argmax(np.abs(size))]), error, numbers=len(size))


def _extended(unknowns: Unknowns) -> tuple[Scene, list[Unknown]]:
    """Scene extended by all effects, of size 0 where missing, and these as further unknowns."""
    scene, n = unknowns.scene, unknowns.scene.n
    given = scene.resolved.friction
    if given is None or not given.sticks:
        own: dict[str, Any] = {} if given is None else dict(given.numbers)
        if "stribeck" not in own:
            own["stribeck"] = np.full(n, thresholds.STRIBECK_VELOCITY)
        scene = replace(scene, friction=Friction(**own))
    sizes, found = dict(scene.numbers) | outside(scene), []
    for effect in EFFECTS:
        is_there = effect.name in sizes and not (effect.name == DELAY and scene.sample_time is not None)
        is_zero = effect.name in OUTSIDE or (is_there and not sizes[effect.name].any())
        if effect.name in unknowns.places or not is_there or not is_zero:
            continue
        number = sizes[effect.name]
        k = number.size
        of_each = np.eye(k), number.copy(), np.full(k, 1e6), np.zeros(k, bool)
        found.append(Unknown(effect.name, (effect.name,) * k, "", number, *of_each))
    return scene, found


def mistaken_columns(scene: Scene, records: Sequence[Record]) -> tuple[Cause, ...]:
    """Joints whose positions follow another joint's commands, the negative of their own, or other units."""
    names, found = scene.resolved.robot.joint_names, []
    for record in records:
        places = columns_for(scene, record)
        q, command = record.q[:, places], commands(scene, record)
        R, slopes = _correlations(q, command)
        for j, name in enumerate(names):
            k, start = int(np.argmax(np.abs(R[j]))), f"{record.name}: positions of {short(name)}"
            if k != j and abs(R[j, k]) > thresholds.FOLLOWS and abs(R[j, j]) < thresholds.OTHER_JOINT:
                text = f"{start} follow the commands of {short(names[k])}: are columns swapped?"
                found.append(Cause("swapped joints", (name, names[k]), text, float(abs(R[j, k]))))
            elif R[j, j] < -thresholds.FOLLOWS:
                text = f"{start} follow the opposite of its commands: is a sign wrong?"
                found.append(Cause("sign", (name,), text, float(-R[j, j])))
            elif R[j, j] > thresholds.FOLLOWS and not 1 / thresholds.OTHER_UNIT < slopes[j] < thresholds.OTHER_UNIT:
                text = f"{start} are {slopes[j]:.3g} times its commands: are units alike?"
                found.append(Cause("unit", (name,), text, float(R[j, j]), value=float(slopes[j])))
    return tuple({cause.text: cause for cause in found}.values())


def _correlations(q: Array, command: Array) -> tuple[Array, Array]:
    """Largest correlations of positions with commands at any delay, (n, n), and regression slopes on each one's own."""
    n, T = q.shape[1], len(q)
    a, b = (np.nan_to_num(x - np.nanmean(x, axis=0)) for x in (q, command))
    A, B = np.fft.rfft(a, 2 * T, axis=0), np.fft.rfft(b, 2 * T, axis=0)
    size = np.linalg.norm(a, axis=0)[:, None] * np.linalg.norm(b, axis=0)
    R, slopes = np.zeros((n, n)), np.ones(n)
    for j in range(n):
        late = np.fft.irfft(A[:, [j]] * B.conj(), 2 * T, axis=0)[: max(1, T // 4)]
        best = np.argmax(np.abs(late), axis=0)
        top = late[best, np.arange(n)]
        R[j] = np.divide(top, size[j], out=np.zeros(n), where=size[j] > 0)
        power = float(b[:, j] @ b[:, j])
        slopes[j] = top[j] / power if power > 0 else 1.0
    return R, slopes
