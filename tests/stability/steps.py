"""The step at which a loop of high gain turns unstable: predicted from the linearised loop, measured in simulation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import rne

from ..helpers import KD, KP

SMALL = 1e-6  # [rad] away from the reference along the fastest mode
STEPS = 100  # in which that must shrink
HALVINGS = 6
METHODS = ("rk4", "semi-implicit-euler", "sampled")


class Loop(NamedTuple):
    """PD with gravity compensated around its reference, and its linearisation dx/dt = A x."""

    scene: rne.Scene
    q: np.ndarray
    A: np.ndarray

    @property
    def fastest(self):
        """The eigenvalue farthest from 0 [1/s] and its real eigenvector."""
        values, vectors = np.linalg.eig(self.A)
        k = int(np.argmax(np.abs(values)))
        return values[k], vectors[:, k].real / np.abs(vectors[:, k].real).max()


def loop(robot, scale, q):
    """Of the thesis's gains times `scale`, with q as its reference."""
    kp, kd = scale * np.array(KP), scale * np.array(KD)
    inverse = np.linalg.inv(robot.mass_matrix(q))
    A = np.block([[np.zeros((6, 6)), np.eye(6)], [-inverse * kp, -inverse * kd]])
    return Loop(rne.Scene(robot, controller=rne.control.pd_gravity(robot, kp, kd, q)), q, A)


def step_matrix(method, one, h):
    """What a step of length h multiplies a small deviation by."""
    n, A = 6, one.A
    identity = np.eye(2 * n)
    if method == "rk4":
        z = h * A
        return identity + z @ (identity + z @ (identity / 2 + z @ (identity / 6 + z / 24)))
    if method == "semi-implicit-euler":
        rates = identity[n:] + h * A[n:]
        return np.concatenate([identity[:n] + h * rates, rates])
    # torques held for h; gravity's own stiffness is left out beside theirs
    return np.concatenate([identity[:n] + h * A[:n] + h * h / 2 * A[n:], identity[n:] + h * A[n:]])


def predicted(method, one):
    """The largest stable step [s], by bisection on the spectral radius."""
    low, high = 0.0, 20 / abs(one.fastest[0])
    for _ in range(60):
        middle = (low + high) / 2
        stable = np.abs(np.linalg.eigvals(step_matrix(method, one, middle))).max() <= 1 + 1e-12
        low, high = (middle, high) if stable else (low, middle)
    return low


def shrinks(method, one, h):
    """Whether a small deviation along the fastest mode is smaller after STEPS steps of the whole, nonlinear loop."""
    start = SMALL * one.fastest[1] / abs(one.fastest[0])
    q0, qd0 = one.q + start[:6], start[6:]
    try:
        if method == "sampled":
            scene = rne.Scene(one.scene.robot, controller=one.scene.controller, sample_time=h)
            end = rne.simulate(scene, q0, qd0, STEPS * h, rtol=1e-6, atol=1e-12).qd[-1]
        else:
            end = rne.ensemble(one.scene, q0[None], qd0[None], STEPS * h, step=h, method=method).qd[-1, 0]
    except (rne.NotFiniteError, rne.SimulationError, rne.SingularMassMatrixError):
        return False
    return bool(np.abs(end).max() < np.abs(qd0).max())


def measured(method, one, within=0.05):
    """The same by simulations, looked for within a part of the predicted step; NaN if it is not there."""
    step = predicted(method, one)
    low, high = step * (1 - within), step * (1 + within)
    if not shrinks(method, one, low) or shrinks(method, one, high):
        return np.nan
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if shrinks(method, one, middle) else (low, middle)
    return (low + high) / 2
