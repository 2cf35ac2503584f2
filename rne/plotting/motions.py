"""Motions to be drawn: a Trajectory, or times and joint arrays such as measured ones."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_numbers
from ..basics.spatial import Array
from ..basics.text import numbered_joints
from ..dynamics.energy import kinetic_energy, potential_energy
from ..files.motion_files import MOTORS
from ..model.model import Model
from ..robot import Robot
from ..simulation.trajectory import Trajectory, motors_at, samples_of

JOINT_ARRAYS = ("q", "qd", "qdd", "tau")
POINTS = 600  # points of a curve between samples, more where the solver's steps are shorter
EXPECTED = "an rne.Trajectory or a tuple of arrays (t, q)"


class Motion:
    """Motion to be drawn: samples (T, n) of "q", "qd", "qdd", "tau" at times (T,), of a trajectory also in between."""

    def __init__(self, t: Array, samples: dict[str, Array], trajectory: Trajectory | None = None) -> None:
        self.t, self.samples, self.trajectory = t, samples, trajectory
        self.n = max((array.shape[1] for array in samples.values()), default=0)
        self.model: Model | None = None if trajectory is None else trajectory.model
        self.quantities = (*samples, *(() if trajectory is None else ("energy", "energy error")))
        self.is_driven = bool(np.any(samples.get("tau", 0)))

    def curve(self, quantity: str) -> tuple[Array, Array]:
        """Times and values of a curve, shapes (P,) and (P, k); a time stands twice where the values jump."""
        motion = self.trajectory
        if motion is None:
            return self.t, self.samples[quantity]
        if quantity == "energy error":
            return motion.t, motion.balance[:, None]
        if quantity == "energy" and not self._has_model_energies:
            return motion.t, np.stack([motion.kinetic, motion.potential, motion.energy], axis=1)
        t, *values = samples_of(motion, np.linspace(motion.t[0], motion.t[-1], POINTS + 1))
        if quantity in MOTORS:
            return t, motors_at(motion, t)[MOTORS.index(quantity)]
        if quantity != "energy":
            return t, values[JOINT_ARRAYS.index(quantity)]
        assert motion.model is not None
        parts = kinetic_energy(motion.model, *values[:2]), potential_energy(motion.model, values[0])
        return t, np.stack([*parts, sum(parts)], axis=1)

    @property
    def _has_model_energies(self) -> bool:
        """True if energies between the samples are those of the model, which knows no springs and rotors."""
        motion = self.trajectory
        if motion is None or motion.model is None or motion.motor_q.size or not 1 < len(motion.t) <= POINTS:
            return False
        return np.allclose(potential_energy(motion.model, motion.q), motion.potential, atol=1e-9 * motion.energy.max())

    def positions(self, t: Array) -> Array:
        """Joint positions at times within the motion, shape (frames, n) [rad or m]."""
        if self.trajectory is not None and self.trajectory.at_steps and len(self.t) > 1:
            return self.trajectory(t)[0].reshape(len(t), self.n)
        return np.array([np.interp(t, self.t, q_j) for q_j in self.samples["q"].T]).T.reshape(len(t), self.n)


def motion_argument(name: str, given: Any) -> Motion:
    """Motion of a Trajectory or of arrays (t, q), (t, q, qd), (t, q, qd, qdd) or (t, q, qd, qdd, tau), checked."""
    if isinstance(given, Trajectory):
        keys = (*JOINT_ARRAYS, *(MOTORS if given.motor_q.size else ()))
        motion = Motion(np.asarray(given.t), {key: getattr(given, key) for key in keys}, given)
    elif isinstance(given, tuple | list) and 2 <= len(given) <= 1 + len(JOINT_ARRAYS):
        motion = arrays_argument([f"{name}[{k}]" for k in range(len(given))], given[0], given[1:])
        if not motion.samples:
            raise ValueError(f"`{name}` must hold at least one array in addition to t, got none")
    else:
        raise TypeError(f"`{name}` must be {EXPECTED}, got {type(given).__name__}")
    if not len(motion.t):
        raise ValueError(f"`{name}` must have at least one sample, got none")
    return motion


def arrays_argument(names: Sequence[str], times: ArrayLike, arrays: Sequence[ArrayLike | None]) -> Motion:
    """Motion of times and joint arrays, each an argument of its own name."""
    t = real_numbers(names[0], times, "(T,)").astype(float)
    if t.ndim != 1:
        raise ValueError(f"`{names[0]}` must be times of shape (T,), got {t.shape}")
    for k in np.flatnonzero(np.diff(t) < 0)[:1]:
        raise ValueError(f"`{names[0]}` must be ascending times, got {t[k + 1]:.6g} s after {t[k]:.6g} s")
    samples: dict[str, Array] = {}
    for key, name, values in zip(JOINT_ARRAYS, names[1:], arrays, strict=False):
        if values is None:
            continue
        n = next(iter(samples.values())).shape[1] if samples else "n"
        array = real_numbers(name, values, f"({len(t)}, {n})").astype(float)
        if array.ndim != 2 or len(array) != len(t) or (samples and array.shape[1] != n):
            cure = ": transpose it" if array.ndim == 2 and array.shape[1] == len(t) else ""
            what = f"`{name}`" if name == key else f"`{name}`, {key},"
            raise ValueError(f"{what} must have shape ({len(t)}, {n}), got {array.shape}{cure}")
        samples[key] = array
    return Motion(t, samples)


def check_positions(name: str, motion: Motion, robot: Robot) -> Motion:
    """Motion, checked to have samples with positions of all joints of a robot."""
    if not len(motion.t):
        raise ValueError(f"`{name}` must have at least one sample, got none")
    if "q" not in motion.samples:
        raise ValueError(f"`{name}` must hold positions, got None for them")
    if motion.n != robot.n:
        raise ValueError(f"`{name}` must have {robot.n} joints as robot {robot.model.name!r} has, got {motion.n}")
    return motion


def joint_labels(motion: Motion, names: Robot | Sequence[str] | None) -> tuple[tuple[str, ...], Array | None]:
    """Names of the joints, by default of the motion's model or numbers, and if each rotates, None without a model."""
    model = motion.model
    if isinstance(names, Robot):
        model, names = names.model, names.joint_names
    if names is None:
        names = numbered_joints(motion.n) if model is None else model.joint_names
    elif not isinstance(names, Iterable) or isinstance(names, str):
        raise TypeError(f"`joint_names` must be an rne.Robot or a sequence of str, got {type(names).__name__}")
    labels = tuple(names)
    for label in labels:
        if not isinstance(label, str):
            raise TypeError(f"`joint_names` must be a sequence of str, got one with {type(label).__name__}")
    if len(labels) != motion.n:
        raise ValueError(f"`joint_names` must have {motion.n} names, one per joint of `motion`, got {len(labels)}")
    return labels, None if model is None else model.is_revolute[list(model.independent_joints)]
