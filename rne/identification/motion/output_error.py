"""Output error of motions that follow commands: position residuals and their derivatives, over shots of records.

A shot is a part of a record that is simulated from its own start, which is fitted together with the unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from ...basics.spatial import Array
from ...errors import IdentificationError
from ...simulation.commanded import CommandedMotion
from ...simulation.scene import Scene
from ...trajectories import sampled
from .. import thresholds
from ..diagnosis.hypotheses import units
from ..fit.equations import correlation_time_of_residuals
from ..log.record import Record
from .unknowns import SENSOR_OFFSET, SENSOR_SCALE, SENSORS, Unknowns

FIRST = 7  # samples of the parabola that estimates the start
HELD, JOINED = "hold", "linear"


@dataclass(frozen=True, eq=False)
class Shot:
    """Part of a record simulated as one motion, at times since its first sample."""

    record: int
    t: Array  # (T,), in the record's time [s]
    q: Array  # (T, n), measured, NaN where not [rad or m]
    start: Array  # (2 n,), positions and velocities at the first, estimated
    start_spread: Array  # (2 n,)


def columns_for(scene: Scene, record: Record) -> list[int]:
    """Column indices of the scene's joints in a record, in its order."""
    names = scene.resolved.robot.joint_names
    if record.is_of(names):
        if lost := [name for name in names if name not in record.joint_names]:
            has = f"not in the record, which has {', '.join(record.joint_names)}"
            raise ValueError(f"{record.name}: joint {lost[0]!r} of the scene is {has}")
        return [record.joint_names.index(name) for name in names]
    if record.q.shape[1] != scene.n:
        raise ValueError(f"{record.name}: has {record.q.shape[1]} joints without names, the scene has {scene.n}")
    return list(range(scene.n))


def commands(scene: Scene, record: Record) -> Array:
    """Commands of a record for the joints of the scene, (T, n)."""
    if record.command is None:
        raise ValueError(f"{record.name}: has no commands: give `command`, or use rne.identify with its torques")
    return np.asarray(record.command[:, columns_for(scene, record)])


def states_of(scene: Scene) -> int:
    """Number of states of the controller."""
    return int(getattr(scene.controller, "states", 0))


def shots_of(scene: Scene, records: Sequence[Record], length: float | None, noise: Array) -> list[Shot]:
    """Shots of records, up to a length, cut where samples are missing."""
    found = []
    for k, record in enumerate(records):
        q, period = record.q[:, columns_for(scene, record)], 1 / record.sample_rate
        gaps = np.flatnonzero(np.diff(record.t) > thresholds.GAP_OF_COMMANDS * period) + 1
        for rows in np.split(np.arange(len(record.t)), gaps):
            span = record.t[rows[-1]] - record.t[rows[0]]
            parts = 1 if length is None else max(1, int(np.ceil(span / length)))
            for part in np.array_split(rows, parts):
                if len(part) >= FIRST:
                    found.append(_shot(k, record.t[part], q[part], noise))
    memory = "elastic joints" if scene.elastic else "the states of the controller" if states_of(scene) else ""
    memory = "a sampled controller" if scene.sample_time is not None else memory
    if memory and len({shot.record for shot in found}) < len(found):
        cure = "leave `shot` out, give records without gaps"
        raise ValueError(f"with {memory} a motion cannot start in its midst: {cure}")
    if not found:
        raise IdentificationError(f"no part of the records has {FIRST} samples in a row")
    return found


def _shot(record: int, t: Array, q: Array, noise: Array) -> Shot:
    """Shot with its start, estimated by a parabola through the first samples."""
    n, s = q.shape[1], t - t[0]
    start, spread = np.zeros((2, n)), np.zeros((2, n))
    speed = np.nanmax(np.abs(np.diff(q, axis=0) / np.diff(t)[:, None]), axis=0, initial=0.0)
    for j in range(n):
        rows = np.flatnonzero(np.isfinite(q[:, j]))[:FIRST]
        if len(rows) < 3:
            few = f"joint {j + 1} has {len(rows)} measured positions"
            raise IdentificationError(f"{few} in a part of {t[-1] - t[0]:.3g} s")
        fit = np.polynomial.polynomial.polyfit(s[rows], q[rows, j], 2)
        start[:, j] = fit[0], np.clip(fit[1], -speed[j], speed[j])
        spread[0, j] = thresholds.STARTS_OF_SHOTS * noise[j] + 0.1 * np.abs(q[rows, j] - fit[0]).max()
        spread[1, j] = max(speed[j], 1e-3)
    return Shot(record, t, q, start.reshape(-1), spread.reshape(-1))


def joint_units(scene: Scene) -> list[str]:
    """Units of the positions of its joints."""
    return [units(scene.resolved.robot, j)[0] for j in range(scene.n)]


@dataclass(frozen=True, eq=False)
class OutputError:
    """Residuals of shots as a function of z: unknowns x, then the start of each shot, (P + 2 n S,)."""

    unknowns: Unknowns
    records: Sequence[Record]
    shots: Sequence[Shot]
    sigma: Array  # (n,), standard deviations of measured positions [rad or m]
    step: float  # [s]
    told: Callable[[float], object] | None = None  # called with the rms residual of each iteration, in sigma
    traced: dict[int, CommandedMotion] = field(default_factory=dict, repr=False)  # one of each record

    @cached_property
    def motions(self) -> list[CommandedMotion]:
        """Motions, one for each shot."""
        scene, unknowns, found = self.unknowns.scene, self.unknowns, []
        for shot in self.shots:
            times = shot.t - shot.t[0]
            if shot.record not in self.traced:
                record = self.records[shot.record]
                reference = sampled(record.t, commands(scene, record), HELD if record.command_hold else JOINED)
                own = replace(scene, controller=replace(scene.controller, reference=reference))
                how = unknowns.of_scene, shot.t[0], times, unknowns.directions, self.step
                self.traced[shot.record] = CommandedMotion.of(own, *how)
            found.append(replace(self.traced[shot.record], begin=shot.t[0], times=times, step=self.step))
        return found

    @property
    def first(self) -> Array:
        """Initial value of z."""
        return np.concatenate([self.unknowns.together("start"), *(shot.start for shot in self.shots)])

    @property
    def spread(self) -> Array:
        """Allowed standard deviations of z."""
        return np.concatenate([self.unknowns.together("spread"), *(shot.start_spread for shot in self.shots)])

    def parts(self, z: Array) -> tuple[Array, list[Array]]:
        """Unknowns x, and the shots' starts, (2, n) each."""
        P = len(self.unknowns.labels)
        return z[:P], list(z[P:].reshape(len(self.shots), 2, self.n))

    def _sensed(self, numbers: dict[str, Array], q: Array) -> Array:
        """Sensor readings of positions."""
        return np.asarray(q * numbers.get(SENSOR_SCALE, 1.0) + numbers.get(SENSOR_OFFSET, 0.0))

    def positions(self, z: Array) -> list[Array | None]:
        """Sensor readings in each shot, (T, n); None where a motion cannot be computed."""
        x, starts = self.parts(z)
        numbers = self.unknowns.numbers(x)
        own, command = self.vectors(numbers), self.unknowns.command(numbers)
        found = (motion.positions(own, command, start) for motion, start in zip(self.motions, starts, strict=True))
        return [None if q is None else self._sensed(numbers, q) for q in found]

    def vectors(self, numbers: dict[str, Array]) -> Any:
        """Vectors of the scene's numbers, for the motions."""
        return self.motions[0].vectors({name: numbers[name] for name in self.unknowns.of_scene})

    def residuals(self, z: Array) -> Array:
        """Predicted minus measured positions over sigma, then z's deviations from its start; infinite on failure."""
        rows = []
        for shot, q in zip(self.shots, self.positions(z), strict=True):
            if q is None:
                return np.full(self.count, np.inf)
            rows.append(((q - shot.q) / self.sigma)[np.isfinite(shot.q)])
        return np.concatenate([*rows, (z - self.first) / self.spread])

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.unknowns.scene.n

    @cached_property
    def measured(self) -> Array:
        """True where positions were measured, (N, n), one shot after the other."""
        return np.asarray(np.isfinite(np.concatenate([shot.q for shot in self.shots])))

    def correlation_times(self, rows: Array) -> Array:
        """Integrated autocorrelation times of the residuals of positions, in samples, (n,)."""
        values, ends = np.zeros(self.measured.shape), np.cumsum([0, *(len(shot.t) for shot in self.shots)]).tolist()
        values[self.measured] = rows
        return correlation_time_of_residuals(values, self.measured, [slice(a, b) for a, b in pairwise(ends)])

    def placed(self, s: int, J: Array) -> Array:
        """Derivatives with respect to z, (..., Z), from those by x and the start of shot s, (..., P + 2 n)."""
        found, width = np.zeros((*J.shape[:-1], len(self.first))), 2 * self.n
        P = J.shape[-1] - width
        found[..., :P], found[..., P + width * s : P + width * (s + 1)] = J[..., :P], J[..., P:]
        return found

    @cached_property
    def count(self) -> int:
        """Number of residuals."""
        return int(self.measured.sum()) + len(self.first)

    def slopes(self, z: Array) -> Array:
        """Derivatives of the residuals with respect to z."""
        found, first, total = np.zeros((self.count, len(z))), 0, 0.0
        for s, (shot, (q, J)) in enumerate(zip(self.shots, self.derivatives(z), strict=True)):
            total += float(np.nansum(((q - shot.q) / self.sigma) ** 2))
            rows = self.placed(s, J / self.sigma[:, None])[np.isfinite(shot.q)]
            found[first : first + len(rows)] = rows
            first += len(rows)
        found[first:] = np.diag(1 / self.spread)
        if self.told is not None:
            self.told(float(np.sqrt(total / max(first, 1))))
        return found

    def derivatives(self, z: Array) -> list[tuple[Array, Array]]:
        """Sensor readings in each shot, (T, n), and derivatives by x and by its start, (T, n, P + 2 n)."""
        x, starts = self.parts(z)
        numbers, unknowns = self.unknowns.numbers(x), self.unknowns
        own, command, factor = self.vectors(numbers), unknowns.command(numbers), unknowns.slopes(x)
        inner = np.r_[np.zeros(0, int), *(unknowns.places[k] for k in unknowns.directions)]
        n, found = self.n, []
        for motion, start in zip(self.motions, starts, strict=True):
            q, along = motion.derivatives(own, command, start)
            J = np.zeros((*q.shape, len(x) + 2 * n))
            J[..., inner], J[..., len(x) :] = along[..., : -2 * n], along[..., -2 * n :]
            J *= np.asarray(numbers.get(SENSOR_SCALE, np.ones(n)))[:, None]
            for part in unknowns.parts:
                if part.name in SENSORS:
                    by_sensor = q if part.name == SENSOR_SCALE else np.ones_like(q)
                    J[..., unknowns.places[part.name]] = by_sensor[..., None] * part.directions
            J[..., : len(x)] *= factor
            found.append((self._sensed(numbers, q), J))
        return found

    def misfits(self, z: Array) -> Array:
        """Predicted minus measured positions, (N, n), NaN where not measured."""
        each = zip(self.shots, self.positions(z), strict=True)
        return np.concatenate([np.full_like(shot.q, np.nan) if q is None else q - shot.q for shot, q in each])
