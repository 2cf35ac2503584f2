"""Comparison of the dynamics with an independent source: Pinocchio or, without it, the energies."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_array
from ..basics.spatial import Array, rotate
from ..dynamics.energy import kinetic_energy, potential_energy
from ..model.model import Model
from ..model.topology import where_loops_close
from ..robot import Robot
from ..urdf import to_urdf
from .oracle import Oracle, each

ROUNDING = 1e-13  # rounding relative to the largest entry: about a hundred rounding errors
STEP = 1e-30  # length of complex steps


class Match(NamedTuple):
    """Compared quantity: its largest difference over all states, relative to the largest entry of each state."""

    quantity: str
    worst: float
    bound: float


def has_pinocchio() -> bool:
    """True if the package `pin` is installed."""
    return importlib.util.find_spec("pinocchio") is not None


def loop_gap(robot: Robot, *ends: tuple[str, ArrayLike]) -> tuple[float, Array]:
    """Largest distance of points on two links [m], in 2000 random positions and that of zeros, and the position."""
    points = [real_array(f"ends[{k}][1]", point, "(3,)") for k, (_, point) in enumerate(ends)]
    low, high = (np.clip(x, -np.pi, np.pi) for x in (robot.lower, robot.upper))
    drawn = np.random.default_rng(0).uniform(np.minimum(low, high), np.maximum(low, high), (2000, robot.n))
    q = np.vstack([np.clip(0.0, low, high), drawn])
    T = robot.link_poses(q)[:, [robot.model.link_index(link) for link, _ in ends]]
    a, b = (rotate(T[:, k, :3, :3], points[k]) + T[:, k, :3, 3] for k in (0, 1))
    gaps = np.sqrt(((a - b) ** 2).sum(-1))
    return float(gaps.max()), q[gaps.argmax()]


def random_states(n: int, samples: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Positions within +-pi, velocities within +-10, accelerations within +-50 [SI], shape (samples, n) each."""
    rng = np.random.default_rng(seed)
    q, qd, qdd = (rng.uniform(-x, x, (samples, n)) for x in (np.pi, 10.0, 50.0))
    return q, qd, qdd


def relative(a: Array, b: Array, terms: Array | None = None) -> float:
    """Largest difference over the states, relative to the largest entry of each state, or of its `terms`."""
    axes = tuple(range(1, a.ndim))
    size = np.abs(b).max(axis=axes, initial=0)
    if terms is not None:
        size = np.maximum(size, terms.max(axis=axes, initial=0))
    return float((np.abs(a - b).max(axis=axes, initial=0) / np.where(size > 0, size, 1)).max(initial=0))


def _terms(M: Array, qdd: Array, bias: Array, tau: Array) -> tuple[Array, Array]:
    """Sizes of terms of torques and accelerations, |M| |qdd| + |h| and |M^-1| (|tau| + |h|), shapes (samples, n)."""
    of_torques = np.einsum("kij,kj->ki", np.abs(M), np.abs(qdd)) + np.abs(bias)
    of_accelerations = np.einsum("kij,kj->ki", np.abs(np.linalg.inv(M)), np.abs(tau) + np.abs(bias))
    return of_torques, of_accelerations


def _bound_of_accelerations(M: Array) -> float:
    """eps cond(M) of the worst state, at least ROUNDING, which it is without joints."""
    condition = np.linalg.cond(M).max() if M.size else 1.0
    return max(ROUNDING, float(condition * np.finfo(float).eps))


def validate(robot: Robot, samples: int = 1000, *, by_terms: bool = False) -> tuple[str, list[Match]]:
    """Compare inverse dynamics, M, gravity, bias and forward dynamics with an independent source, in random states.

    The name of the source comes first: Pinocchio, or the energies if it is not installed or joints follow others by
    couplings. With `by_terms`, differences of torques and accelerations are relative to the largest term of each state,
    for robots of few joints, whose torques can cancel.
    """
    if robot.model.couplings or not has_pinocchio():
        why = "its URDF has no couplings" if robot.model.couplings else "package pin is not installed"
        rows = against_energies(robot, samples, by_terms=by_terms)
        return f"energy and Lagrange identities ({why})", list(rows)
    import pinocchio

    return f"Pinocchio {pinocchio.__version__}", list(against_pinocchio(robot, samples, by_terms=by_terms))


def against_pinocchio(robot: Robot, samples: int, xml: str | None = None, *, by_terms: bool = False) -> Iterator[Match]:
    """Differences from Pinocchio, which reads `xml`, or the robot as `rne.to_urdf` writes it."""
    oracle = Oracle(robot.model, to_urdf(robot.model) if xml is None else xml)
    q, qd, qdd = random_states(robot.n, samples)
    tau, M = robot.inverse_dynamics(q, qd, qdd), robot.mass_matrix(q)
    gravity, bias = robot.gravity_torque(q), robot.bias_torque(q, qd)
    of_tau, of_qdd = None, None
    if by_terms:
        robot.forward_dynamics(q, qd, tau)  # before M is inverted: the error names the joints of a singular M
        of_tau, of_qdd = _terms(M, qdd, bias, tau)
    yield Match("inverse dynamics", relative(tau, each(oracle.inverse_dynamics, q, qd, qdd), of_tau), ROUNDING)
    yield Match("mass matrix", relative(M, each(oracle.mass_matrix, q)), ROUNDING)
    yield Match("gravity", relative(gravity, each(oracle.gravity_torque, q)), ROUNDING)
    yield Match("bias", relative(bias, each(oracle.bias_torque, q, qd)), ROUNDING)
    ours, bound = robot.forward_dynamics(q, qd, tau), _bound_of_accelerations(M)
    if not robot.model.has_mimics:
        yield Match("forward dynamics", relative(ours, each(oracle.forward_dynamics, q, qd, tau), of_qdd), bound)
    yield Match("forward after inverse", relative(ours, qdd, of_qdd), bound)


def euler_lagrange(model: Model, q: Array, qd: Array, qdd: Array) -> Array:
    """Torques d/dt dT/dqd - dT/dq + dU/dq by complex-step derivatives of the energies."""
    T, U = kinetic_energy, potential_energy
    e = np.eye(model.n)

    def momenta(q: Array, qd: Array) -> Array:  # exact, as T is quadratic in qd
        q, qd = q[..., None, :], qd[..., None, :]
        return np.asarray((T(model, q, qd + e) - T(model, q, qd - e)) / 2)

    force = momenta(q + 1j * STEP * qd, qd + 1j * STEP * qdd).imag
    shifted = q[..., None, :] + 1j * STEP * e
    return np.asarray((force - T(model, shifted, qd[..., None, :]).imag + U(model, shifted).imag) / STEP)


def against_energies(robot: Robot, samples: int, *, by_terms: bool = False) -> Iterator[Match]:
    """Differences from torques that follow from the kinetic and potential energies."""
    q, qd, qdd = random_states(robot.n, samples)
    q, still = where_loops_close(robot.model, q), np.zeros_like(q)
    tau = robot.inverse_dynamics(q, qd, qdd)
    M, bias = robot.mass_matrix(q), robot.bias_torque(q, qd)
    ours = robot.forward_dynamics(q, qd, tau)  # before M is inverted: the error names the joints of a singular M
    of_tau, of_qdd = _terms(M, qdd, bias, tau) if by_terms else (None, None)
    lagrange = euler_lagrange(robot.model, q, qd, qdd)
    yield Match("inverse dynamics", relative(tau, lagrange, of_tau), 1e-12)
    for quantity, torque, velocity in (("gravity", robot.gravity_torque(q), still), ("bias", bias, qd)):
        yield Match(quantity, relative(torque, euler_lagrange(robot.model, q, velocity, still)), 1e-12)
    T = np.einsum("ni,nij,nj->n", qd, M, qd) / 2
    yield Match("mass matrix", relative(T[:, None], robot.kinetic_energy(q, qd)[:, None]), 1e-12)
    yield Match("forward after inverse", relative(ours, qdd, of_qdd), _bound_of_accelerations(M))
