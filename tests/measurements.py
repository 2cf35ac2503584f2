"""Synthetic measurements of which the truth is known: exact motions, and what sensors and loggers make of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rne.identification import Record


class Truth(NamedTuple):
    """A motion and its torques, of which measurements are made; shape (T,) and (T, n)."""

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    tau: np.ndarray


def fourier_series(t, base, a, b):
    """q, qd and qdd of sums of sines a and cosines b, shape (n, harmonics), at base, 2 base, ... [Hz]."""
    omega = 2 * np.pi * base * np.arange(1, a.shape[1] + 1)
    sine, cosine = np.sin(np.outer(t, omega)), np.cos(np.outer(t, omega))
    q = sine @ (a / omega).T - cosine @ (b / omega).T
    qd = cosine @ a.T + sine @ b.T
    qdd = -(sine * omega) @ a.T + (cosine * omega) @ b.T
    return q, qd, qdd


def truth(scene, duration=10.0, rate=500.0, seed=0, base=0.1, harmonics=5, speed=1.5, phase=0.0):
    """A seeded Fourier motion and the torques of a Robot or Scene on it; `phase` shifts the samples, in periods."""
    t = (np.arange(int(duration * rate)) + phase) / rate
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, scene.n, harmonics)) * speed / np.sqrt(harmonics)
    q, qd, qdd = fourier_series(t, base, a, b)
    return Truth(t, q, qd, qdd, scene.inverse_dynamics(q, qd, qdd))


def measure(true, seed=0, *, torque_noise=0.0, position_noise=0.0, encoder_step=0.0, clock=0.0):
    """Times, positions and torques with noise (standard deviations), quantised positions, and stamps off by `clock` [s]."""
    rng = np.random.default_rng(seed)
    q = true.q + position_noise * rng.normal(size=true.q.shape)
    if encoder_step:
        q = encoder_step * np.rint(q / encoder_step)
    tau = true.tau + torque_noise * rng.normal(size=true.tau.shape)
    t = true.t + clock * rng.uniform(-1, 1, len(true.t))
    return t, q, tau


def record(true, seed=0, *, lost=(), wild=None, stuck=None, **sensors):
    """A Record of `measure`, without the samples `lost`; `wild` maps (sample, joint) to errors of positions.

    `stuck` maps (sample, joint) to how many samples repeat the position before.
    """
    t, q, tau = measure(true, seed, **sensors)
    for (k, joint), error in (wild or {}).items():
        q[k, joint] += error
    for (k, joint), count in (stuck or {}).items():
        q[k : k + count, joint] = q[k - 1, joint]
    return Record(*(np.delete(x, list(lost), axis=0) for x in (t, q, tau)))
