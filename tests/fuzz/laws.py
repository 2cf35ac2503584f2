"""The control laws of the cases once more, from their numbers alone."""

from __future__ import annotations

import numpy as np

from .plant import Plant


def law_of(case):
    """f(t, q, qd, z) -> (torques, dz/dt), and the number of states z."""
    n = len(case.q0)
    if case.law is None:
        return lambda t, q, qd, z: (np.zeros(n), z), 0
    numbers = {name: np.array(value) if isinstance(value, list) else value for name, value in case.law.items()}
    kind = numbers.pop("kind").removeprefix("control.")
    numbers.pop("states", None)
    if kind in ("pd_gravity", "computed_torque") or (kind == "pid" and numbers["gravity"]):
        numbers["model"] = Plant(case, loaded=False)
    elif kind == "pid":
        numbers["model"] = None
    law = FORMULAS[kind]
    if kind in ("pid", "filter"):
        return lambda t, q, qd, z: law(t, q, qd, z, **numbers), n
    return lambda t, q, qd, z: (law(t, q, qd, **numbers), z), 0


def _pd(t, q, qd, kp, kd, ref):
    return kp * (ref - q) - kd * qd


def _saturating(t, q, qd, kp, kd, ref, bound):
    return np.minimum(np.maximum(kp * (ref - q) - kd * qd, -bound), bound)


def _traced(t, q, qd, size, omega, kp, kd, ref, bound):
    return np.minimum(np.maximum(size * np.sin(omega * t) + kp * (ref - q), -bound), bound) - kd * qd


def _pd_gravity(t, q, qd, model, kp, kd, ref):
    return model.gravity_torque(q) + kp * (ref - q) - kd * qd


def _pid(t, q, qd, z, model, kp, ki, kd, ref, gravity, windup):
    integral = np.minimum(np.maximum(ki * z, -windup), windup)
    feedback = kp * (ref - q) - integral - kd * qd
    return (feedback + model.gravity_torque(q) if gravity else feedback), q - ref


def _computed_torque(t, q, qd, model, kp, kd, start, end, time):
    s, path = min(t / time, 1.0), end - start
    q_ref = start + path * (10 * s**3 - 15 * s**4 + 6 * s**5)
    qd_ref = path * (30 * s**2 - 60 * s**3 + 30 * s**4) / time
    qdd_ref = path * (60 * s - 180 * s**2 + 120 * s**3) / time**2
    commanded = qdd_ref + kd * (qd_ref - qd) + kp * (q_ref - q)
    return model.mass_matrix(q) @ commanded + model.bias(q, qd)


FORMULAS = {
    "constant": lambda t, q, qd, u: u,
    "sines": lambda t, q, qd, size, omega, phase: size * np.sin(omega * t + phase),
    "switch": lambda t, q, qd, before, after, time: before if t < time else after,
    "pd": _pd,
    "saturating": _saturating,
    "traced": _traced,
    "filter": lambda t, q, qd, z, kp, kd, ref, lag: (kp * (ref - q) - z, (kd * qd - z) / lag),
    "pd_gravity": _pd_gravity,
    "pid": _pid,
    "computed_torque": _computed_torque,
}
