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
from ..robot import Robot, robot_argument
from ..urdf import to_urdf
from .oracle import Oracle, each

ROUNDING = 1e-13  # rounding relative to the largest entry: some hundred rounding errors, and their effect on zero
STEP = 1e-30  # length of complex steps


class Match(NamedTuple):
    """Compared quantity: its largest difference over all states, relative to the largest entry of each state."""

    quantity: str
    worst: float
    bound: float
    symbol: str


def has_pinocchio() -> bool:
    """True if the package `pin` is installed."""
    return importlib.util.find_spec("pinocchio") is not None


def loop_gap(robot: Robot, *ends: tuple[str, ArrayLike]) -> tuple[float, Array]:
    """Largest distance between points of two links, seen from each, over the ranges, with its position: (m, q).

    It shows if mimics or couplings keep a loop closed, in 2000 random configurations and that of zeros.
    """
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
    for robots of few joints, whose torques can cancel. A SingularMassMatrixError says where M is singular.

    >>> import rne
    >>> from rne.commands.agreement import validate
    >>> source, rows = validate(rne.load("irb140"), samples=10)
    >>> all(row.worst <= row.bound for row in rows)
    True
    """
    robot_argument(robot)
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
    tau = robot.inverse_dynamics(q, qd, qdd)
    M = robot.mass_matrix(q)
    gravity, bias = robot.gravity_torque(q), robot.bias_torque(q, qd)
    of_tau, of_qdd = None, None
    if by_terms:
        robot.forward_dynamics(q, qd, tau)  # before M is inverted: the error names the joints of a singular M
        of_tau, of_qdd = _terms(M, qdd, bias, tau)
    yield Match("inverse dynamics", relative(tau, each(oracle.inverse_dynamics, q, qd, qdd), of_tau), ROUNDING, "tau")
    yield Match("mass matrix", relative(M, each(oracle.mass_matrix, q)), ROUNDING, "M")
    yield Match("gravity", relative(gravity, each(oracle.gravity_torque, q)), ROUNDING, "g")
    yield Match("bias", relative(bias, each(oracle.bias_torque, q, qd)), ROUNDING, "C qd + g")
    ours, bound = robot.forward_dynamics(q, qd, tau), _bound_of_accelerations(M)
    if not robot.model.has_mimics:
        theirs = each(oracle.forward_dynamics, q, qd, tau)
        yield Match("forward dynamics", relative(ours, theirs, of_qdd), bound, "qdd, bound eps cond(M), at least 1e-13")
    yield Match("forward after inverse", relative(ours, qdd, of_qdd), bound, "qdd, bound eps cond(M), at least 1e-13")


def euler_lagrange(model: Model, q: Array, qd: Array, qdd: Array) -> Array:
    """Torques d/dt dT/dqd - dT/dq + dU/dq from the energies alone, by complex-step derivatives.

    T is quadratic in qd, so that dT/dqd_i = (T(qd + e_i) - T(qd - e_i)) / 2 exactly.
    """
    T, U = kinetic_energy, potential_energy
    e = np.eye(model.n)

    def momenta(q: Array, qd: Array) -> Array:
        q, qd = q[..., None, :], qd[..., None, :]
        return np.asarray((T(model, q, qd + e) - T(model, q, qd - e)) / 2)

    force = momenta(q + 1j * STEP * qd, qd + 1j * STEP * qdd).imag
    shifted = q[..., None, :] + 1j * STEP * e
    return np.asarray((force - T(model, shifted, qd[..., None, :]).imag + U(model, shifted).imag) / STEP)


def against_energies(robot: Robot, samples: int, *, by_terms: bool = False) -> Iterator[Match]:
    """Differences from torques that follow from the kinetic and potential energies alone."""
    q, qd, qdd = random_states(robot.n, samples)
    q, still = where_loops_close(robot.model, q), np.zeros_like(q)
    tau = robot.inverse_dynamics(q, qd, qdd)
    M = robot.mass_matrix(q)
    ours = robot.forward_dynamics(q, qd, tau)  # before M is inverted: the error names the joints of a singular M
    lagrange = euler_lagrange(robot.model, q, qd, qdd)
    of_tau, of_qdd = _terms(M, qdd, robot.bias_torque(q, qd), tau) if by_terms else (None, None)
    yield Match("inverse dynamics", relative(tau, lagrange, of_tau), 1e-12, "tau, from Euler-Lagrange")
    gravity = euler_lagrange(robot.model, q, still, still)
    yield Match("gravity", relative(robot.gravity_torque(q), gravity), 1e-12, "g, the gradient of U")
    bias = euler_lagrange(robot.model, q, qd, still)
    yield Match("bias", relative(robot.bias_torque(q, qd), bias), 1e-12, "C qd + g, from Euler-Lagrange")
    T = np.einsum("ni,nij,nj->n", qd, M, qd) / 2
    yield Match("mass matrix", relative(T[:, None], robot.kinetic_energy(q, qd)[:, None]), 1e-12, "qd.M qd / 2 = T")
    bound = _bound_of_accelerations(M)
    yield Match("forward after inverse", relative(ours, qdd, of_qdd), bound, "qdd")
