"""Base parameters: a minimal set of combinations of the standard parameters that determine joint torques.

They follow from the axes and places of the joints alone. Kinetic and potential energy of a body are linear in its
pseudo-inertia P, the integral of x x^T dm with x = (r, 1). They are tr(Phi P), with Phi = xi^T xi / 2 for a velocity
xi, and Phi = -(g, 0) (0, 1)^T for gravity g. Seen from a body with pose T in its parent, Phi is T^T Phi T and xi is
T^-1 xi T. Torques are zero in every motion if and only if the robot's kinetic energy is zero and its potential energy
constant. Therefore, from the tips to the base: combinations that change no energy when the joint moves are counted with
the parent body; all others are observed. They are three parameters after a rotating joint (Gautier and Khalil 1990),
six after a sliding one, and more where the possible energies of a body span less: after joints with parallel axes, or
axes along gravity. For trees see Wensing, Niemeyer and Slotine 2024; here joints with common coordinates (mimics, and
those that follow others by couplings) are treated as one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import ReadOnlyArrays, cached_array, positive_number, real_array
from ..basics.inertia import PARAMETERS, UNITS
from ..basics.spatial import Array, cross, cross_matrix, rotate, symmetric, transpose
from ..basics.text import counted, listed, short, six_digits, wrapped
from ..errors import ModelError
from ..model.model import Model, model_argument
from ..model.standard_parameters import OF_MOTORS, DriveModel, StandardParameters, drive_argument
from ..model.topology import carriers, drivers_of, joint_groups, where_loops_close
from .kinematics import BASE, coordinate_map, joint_transforms
from .regressors import regressor

COARSEST = 0.01  # largest tolerance: with a larger one different robots have the same parameters
ROUNDING = 1e-12  # rounding of coefficients that are 0 or a whole number
PIVOT = 0.05  # smallest pivot relative to the largest entry
FLAT = 16  # number of entries of Phi or xi
DRAWN = 4  # random positions per needed one, for joints that cannot follow everywhere


@dataclass(frozen=True, eq=False, repr=False)
class BaseParameters(ReadOnlyArrays):
    """Combinations of the standard parameters that determine torques, each named after the parameter it keeps.

    Each is a kept parameter plus multiples of others with the same effect on torques. Those of each body are kept
    before those of the bodies that it carries, and the bodies' before those of drives. Y pi = (Y E) (B pi) in every
    state, with Y E the columns of Y that belong to the kept parameters.

    Attributes
    ----------
    standard : StandardParameters
        The standard parameters pi, their order and their names.
    independent : tuple of int, length count
        Places of the kept parameters among them.
    matrix : ndarray, shape (count, standard.count)
        B of beta = B pi.
    body_regressor : callable
        Gives the regressor of the bodies, as `rne.dynamics.regressor`.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot = rne.load("irb140")
    >>> base = robot.base_parameters()
    >>> base.count, base.names[:3], base.formulas[2]
    (36, ('Iyy_1', 'mcx_2', 'mcy_2'), 'mcy_2')
    """

    standard: StandardParameters
    independent: tuple[int, ...]
    matrix: Array
    body_regressor: Callable[..., Array]

    @property
    def count(self) -> int:
        """Number of base parameters."""
        return len(self.independent)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Kept parameter of each combination."""
        return tuple(self.standard.names[k] for k in self.independent)

    @cached_property
    def formulas(self) -> tuple[str, ...]:
        """Formula of each combination, such as "Izz_1 + Iyy_2 + 0.0049 m_2", the kept parameter first."""
        return tuple(self._formula(k, row) for k, row in zip(self.independent, self.matrix, strict=True))

    def _formula(self, kept: int, row: Array) -> str:
        text = self.standard.names[kept]
        for k in np.flatnonzero(row):
            if k != kept:
                factor = six_digits(abs(row[k]))
                text += f" {'+' if row[k] > 0 else '-'} {'' if factor == '1' else factor + ' '}{self.standard.names[k]}"
        return text

    @cached_array
    def back(self) -> Array:
        """Matrix E with Y = Y E B in every state, and B E = 1; shape (standard.count, count).

        Its columns are unit vectors: E beta has the base parameters in the places of the kept ones, zeros elsewhere.
        """
        E = np.zeros((self.standard.count, self.count))
        E[list(self.independent), range(self.count)] = 1
        return E

    @cached_array
    def values(self) -> Array:
        """Base parameters of the model; offsets and parameters of coupled motors count as zero."""
        return np.asarray(self.matrix @ self.standard.values)

    def of(self, parameters: ArrayLike) -> Array:
        """Base parameters beta = B pi of standard parameters.

        Parameters
        ----------
        parameters : array_like, shape (..., standard.count)
            In the order of `standard.names`.

        Returns
        -------
        ndarray, shape (..., count)
            In the order of `names`.

        Raises
        ------
        ValueError
            If the shape is wrong.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> base = robot.base_parameters()
        >>> bool((base.of(robot.parameters) == base.values).all())
        True
        """
        pi = real_array("parameters", parameters, f"(..., {self.standard.count})")
        return np.asarray(pi @ self.matrix.T)

    def standard_parameters(self, beta: ArrayLike) -> Array:
        """Standard parameters with these base parameters: the kept ones, all others zero.

        They give the same torques as all others with the same base parameters, but are not physical.

        Parameters
        ----------
        beta : array_like, shape (..., count)
            In the order of `names`.

        Returns
        -------
        ndarray, shape (..., standard.count)
            In the order of `standard.names`.

        Raises
        ------
        ValueError
            If the shape is wrong.

        Examples
        --------
        >>> import numpy as np, rne
        >>> base = rne.load("irb140").base_parameters()
        >>> np.allclose(base.of(base.standard_parameters(base.values)), base.values)
        True
        """
        values = real_array("beta", beta, f"(..., {self.count})")
        return np.asarray(values @ self.back.T)

    def regressor(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Matrix Y E of tau = Y E beta: torques per unit of each base parameter.

        Parameters
        ----------
        q, qd, qdd : array_like, shape (..., n)
            Joint positions, velocities and accelerations [rad or m; rad/s or m/s; rad/s^2 or m/s^2].

        Returns
        -------
        ndarray, shape (..., n, count)
            The columns `independent` of the regressor of the standard parameters.

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or an entry overflows.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot = rne.load("irb140")
        >>> base = robot.base_parameters()
        >>> q, qd, qdd = np.random.default_rng(0).normal(size=(3, 6))
        >>> np.allclose(base.regressor(q, qd, qdd) @ base.values, robot.inverse_dynamics(q, qd, qdd))
        True
        """
        at, rates, accelerations = (np.asarray(x) for x in (q, qd, qdd))
        bodies = np.asarray(self.body_regressor(at, rates, accelerations))
        load = self.standard.load(bodies, at, accelerations, self.standard.values)
        drives = self.standard.drive_columns(rates, accelerations, load)
        springs = self.standard.spring_columns(at)
        return np.asarray(np.concatenate([bodies, drives, springs], axis=-1)[..., list(self.independent)])

    def __repr__(self) -> str:
        return wrapped(
            f"BaseParameters of '{short(self.standard.model.name)}': {self.count} combinations of "
            f"{counted(self.standard.count, 'standard parameter')}: {listed(self.names)}"
        )

    def __str__(self) -> str:
        return "\n".join(self.formulas)


def base_parameters(model: Model, *, drives: DriveModel | None = None, tolerance: float = 1e-9) -> BaseParameters:
    """Minimal combinations of inertial and drive parameters that determine the joint torques, by rules.

    Gautier and Khalil 1990; Wensing, Niemeyer and Slotine 2024. They follow from the axes and places of the joints
    and the direction of gravity, not from its size, the masses or the limits. No states are sampled at random,
    except for the coordinates that joints share. Parameters, result and errors are those of
    `rne.Robot.base_parameters`, with the model first.
    """
    standard = StandardParameters(model_argument(model), drive_argument(drives))
    if positive_number("tolerance", tolerance) >= COARSEST:
        raise ValueError(f"`tolerance` must be below {COARSEST}, got {tolerance!r}")
    kept, matrix = regrouped(standard, tolerance)
    return BaseParameters(standard, kept, matrix, partial(regressor, model))


def regrouped(standard: StandardParameters, tolerance: float) -> tuple[tuple[int, ...], Array]:
    """Indices of the kept parameters, and the matrix B of beta = B pi, with the identity at these indices."""
    energies, units = observed_combinations(standard, tolerance)
    friction = [_friction_rows(standard, symbol) for symbol in ("Fv", "Fvb", "Fc", "Fs", "Fl")]
    rows = span(np.concatenate([energies, *friction]), tolerance)
    kept = independent_columns(rows)
    matrix: Array = np.linalg.solve(rows[:, kept], rows)
    matrix[np.abs(matrix) < ROUNDING] = 0
    matrix *= units[kept, None] / units
    whole = np.abs(matrix - matrix.round()) < ROUNDING
    matrix[whole] = matrix[whole].round()
    matrix[:, kept] = np.eye(len(kept))
    return tuple(kept), matrix


def _friction_rows(standard: StandardParameters, symbol: str) -> Array:
    """Combinations of the drives' and coupled motors' friction that torques depend on; it is odd in the velocities.

    Torques of viscous friction are the matrix sum of Fv a a^T times qd. Those of Coulomb friction are independent
    unless shafts turn at the same velocity; a factor between velocities counts only if friction is smooth.
    """
    if symbol not in standard.groups:
        return np.zeros((0, standard.count))
    if symbol not in OF_MOTORS:
        return np.eye(standard.count)[standard.groups[symbol]][standard.asked[symbol]]
    columns = [standard.groups[name] for name in (symbol, f"{symbol} of coupled motors")]
    shafts = np.concatenate([np.diag(standard.asked[symbol].astype(float)), standard.motors])
    if symbol == "Fv":
        upper = np.triu_indices(standard.model.n)
        entries = (shafts[:, :, None] * shafts[:, None, :])[:, upper[0], upper[1]].T
    else:
        sizes = np.linalg.norm(shafts, axis=1)
        turning = np.flatnonzero(sizes)
        directions = shafts[turning] / sizes[turning, None]
        same = np.abs(np.abs(directions @ directions.T) - 1) < ROUNDING
        if standard.smoothing:
            same &= np.abs(sizes[turning, None] - sizes[turning]) < ROUNDING
        entries = np.zeros((len(turning), len(shafts)))
        entries[:, turning] = np.where(same, sizes[turning], 0)
    rows, n = np.zeros((len(entries), standard.count)), standard.model.n
    rows[:, columns[0]], rows[:, columns[1]] = entries[:, :n], entries[:, n:]
    return np.asarray(rows[entries.any(axis=1)])


def independent_columns(rows: Array) -> list[int]:
    """Independent columns, as many as there are orthonormal rows; the first ones that give no large coefficients.

    Threshold pivoting: the next column's part orthogonal to the kept ones must not be small relative to the largest
    such part. The largest always passes, so the loop ends.
    """
    kept: list[int] = []
    left = rows.copy()
    while len(kept) < len(rows):
        for k in range(rows.shape[1]):
            overlap = left[:, k] @ left
            if len(kept) < len(rows) and overlap[k] > max(PIVOT * np.abs(overlap).max(), ROUNDING):
                left -= left[:, k, None] * (overlap / overlap[k])
                kept.append(k)
    return sorted(kept)


class Reach(NamedTuple):
    """Bases, as rows, of all energies and velocities that a body can have while the robot moves."""

    energies: Array  # Phi, flat, then 1 for gravity's, shape (..., 17)
    velocities: Array  # xi, flat, then the velocities of the shafts, shape (..., 16 + s)


class Group(NamedTuple):
    """Bodies that move together, at sampled positions of their coordinates."""

    bodies: tuple[int, ...]
    parent: int
    coordinates: list[int]
    q: Array  # shape (samples, coordinates)
    T: Array  # pose of each body against the parent, shape (bodies, samples, 4, 4)
    xi: Array  # velocity of each body per unit of qd, shape (bodies, samples, coordinates, 4, 4)


def observed_combinations(standard: StandardParameters, tolerance: float) -> tuple[Array, Array]:
    """Independent combinations of bodies, rotors and offsets that span what torques depend on.

    Directions and distances that differ by less than the tolerance, relative to the robot's size, count as equal. Rows
    have shape (count, standard.count), in the units of the second result, shape (standard.count,).
    """
    model = standard.model
    length, gravity, coordinates = sizes(model)
    place = {name: list(range(standard.count))[places] for name, places in standard.groups.items()}
    turning = place.get("Ia", []) + place.get("Ia of coupled motors", [])  # rotors turn as shafts, with their joints
    shafts = np.concatenate([np.eye(model.n), standard.motors])[: len(turning)] * coordinates
    offsets = np.diag(coordinates) if standard.drives.offset else np.zeros((0, model.n))
    groups = [_group(model, bodies, length, coordinates) for bodies in joint_groups(model)]
    weight = np.zeros((4, 4))
    weight[:3, 3] = -model.gravity / gravity
    reach = {BASE: Reach(np.append(symmetric(weight), 1.0)[None], np.zeros((0, FLAT + len(shafts))))}
    observed = []
    for group in groups:
        rows, met = _energies_of_group(group, reach[group.parent], shafts, offsets)
        reach |= {i: Reach(*(span(x, tolerance) for x in met[i])) for i in group.bodies}
        observed.append(span(rows, tolerance))
    found = [_of_all_bodies(groups, k, rows, PARAMETERS * model.nb) for k, rows in enumerate(observed)]
    between = _shafts_between_branches(model, groups, shafts)
    found.append(np.pad(between, ((0, 0), (PARAMETERS * model.nb, len(offsets)))))
    columns = [*place["bodies"], *turning, *place.get("tau0", [])]
    rows, units = np.zeros((sum(map(len, found)), standard.count)), np.ones(standard.count)
    rows[:, columns] = np.concatenate(found)
    units[place["bodies"]] = np.tile([1.0] + [length] * 3 + [length**2] * 6, model.nb)
    units[turning], units[place.get("tau0", [])] = length**2, length * gravity
    return rows, units


def sizes(model: Model) -> tuple[float, float, Array]:
    """Longest offset between joints, magnitude of gravity, and each coordinate's unit: 1, or that length."""
    length = float(np.linalg.norm(model.translation, axis=1).max(initial=0)) or 1.0
    units = np.where(model.is_revolute, 1.0, length)[list(model.independent_joints)]
    return length, float(np.linalg.norm(model.gravity)) or 1.0, units


def _group(model: Model, bodies: tuple[int, ...], length: float, units: Array) -> Group:
    """Poses and velocities of a group's bodies about the origins of their joints in the URDF, of the size `length`."""
    parent = next(model.parent[i] for i in bodies if model.parent[i] not in bodies)
    drivers = drivers_of(model)
    coordinates = sorted({k for i in bodies for k in drivers[i]})
    q = _sample_positions(model, bodies, coordinates, units)
    R, p = joint_transforms(model, q)
    G = np.broadcast_to(coordinate_map(model, q), (len(q), model.nb, model.n))
    slopes = G[..., coordinates] * units[coordinates]
    poses: Array = np.zeros((model.nb, len(q), 4, 4))
    xi: dict[int, Array] = {}
    for i in bodies:
        above, o, twist = model.parent[i], model.joint_origin[i], np.zeros((4, 4))
        origin = p[i] + rotate(R[i], o) - (model.joint_origin[above] if above != BASE else 0)
        step = homogeneous(R[i], origin / length)
        poses[i] = step if above == parent else poses[above] @ step
        carried = np.zeros((len(coordinates), len(q), 4, 4)) if above == parent else xi[above]
        s, t = model.angular_axis[i], model.linear_axis[i]
        twist[:3, :3], twist[:3, 3] = cross_matrix(s), (t + cross(s, o)) / length
        xi[i] = inverse(step) @ carried @ step + slopes[:, i].T[..., None, None] * twist
    twists = np.moveaxis(np.array([xi[i] for i in bodies]), 1, 2)
    return Group(bodies, parent, coordinates, (q / units)[:, coordinates], poses[list(bodies)], twists)


def _sample_positions(model: Model, bodies: tuple[int, ...], coordinates: list[int], units: Array) -> Array:
    """Positions that determine a group's energies for all others, shape (samples, n); other coordinates are zero.

    Energies are of degree two in the sine and cosine of a rotating joint, and in the position of a sliding one: five
    angles, or three positions, determine them. For joints that share coordinates they have at most ten dimensions for
    each body and one for each offset, which as many random positions span with probability one. The first position is
    zero, except with couplings, which may have no position there.
    """
    if len(bodies) == 1:
        factor = abs(float(model.multiplier[bodies[0]])) or 1.0
        single = np.arange(5) * (2 * np.pi / 5 / factor) if model.is_revolute[bodies[0]] else np.array([0, -1, 1]) / 3
        return np.asarray(single[:, None] * (units * np.isin(range(model.n), coordinates)))
    multiplier = np.abs(model.multiplier * units[list(model.coordinate)])
    turn = np.pi / min([multiplier[i] for i in bodies if model.is_revolute[i] and multiplier[i]], default=np.pi)
    count, following = (PARAMETERS + 2) * len(bodies), [c for c in model.coupled_joints if c[0] in bodies]
    drawn = count * (DRAWN if following else 1)
    q = np.zeros((drawn, model.n))
    positions = np.random.default_rng(0).uniform(-turn, turn, (drawn, len(coordinates)))
    q[1:, coordinates] = positions[1:] * units[coordinates]
    if following:
        q = where_loops_close(model, q)
    for i, drivers, coupling in following:
        q = q[np.isfinite(coupling.derivatives(q[:, drivers])[0]).all(-1)]
        if len(q) < count:
            joint, names = model.moving_joints[i], listed(coupling.drivers)
            raise ModelError(f"joint {joint!r} of robot {model.name!r} hardly ever can follow {names} in their ranges")
    return q[:count]


def _energies_of_group(
    group: Group, reach: Reach, shafts: Array, offsets: Array
) -> tuple[Array, dict[int, tuple[Array, Array]]]:
    """Combinations of the group's bodies, shafts and offsets in torques, and energies and velocities of each body."""
    Phi, falls = reach.energies[:, :FLAT].reshape(-1, 4, 4), reach.energies[:, FLAT:]
    xi, carried = reach.velocities[:, :FLAT].reshape(-1, 4, 4), reach.velocities[:, FLAT:]
    T, own, turned = group.T[:, :, None], group.xi, shafts[:, group.coordinates].T
    # M and potential energy of the parent's motions, of its motions with the group's own, and of these
    moved = transpose(T) @ Phi @ T
    seen = inverse(T) @ xi @ T
    mixed = kinetic(seen[:, :, :, None], own[:, :, None])
    within = kinetic(own[:, :, :, None], own[:, :, None])
    work = falls * ((group.q - group.q[0]) @ offsets[:, group.coordinates].T)[:, None]
    none = np.zeros(len(shafts)), np.zeros(len(offsets))
    rows = [
        _flat(np.moveaxis(moved - moved[:, :1], 0, 2), none[0], work),
        _flat(np.moveaxis(mixed, 0, 3), carried[:, None] * turned, none[1]),
        _flat(np.moveaxis(within, 0, 3), turned[:, None] * turned, none[1]),
    ]
    met = {}
    for b, i in enumerate(group.bodies):
        energies = [_flat(moved[b, :, :, None], falls)]
        energies += [_flat(x[b, ..., None, :, :], np.zeros(1)) for x in (mixed, within)]
        velocities = [_flat(x[b, ..., None, :, :], turns) for x, turns in ((seen, carried), (own, turned))]
        met[i] = np.concatenate(energies), np.concatenate(velocities)
    return np.concatenate(rows), met


def _flat(matrices: Array, *columns: Array) -> Array:
    """Matrices (..., bodies, 4, 4) as rows, side by side, followed by further columns."""
    flat = matrices.reshape(*matrices.shape[:-3], FLAT * matrices.shape[-3])
    further = [np.broadcast_to(x, (*flat.shape[:-1], x.shape[-1])) for x in columns]
    rows = np.concatenate([flat, *further], axis=-1)
    return rows.reshape(-1, rows.shape[-1])


def _of_all_bodies(groups: list[Group], k: int, observed: Array, bodies: int) -> Array:
    """Rows of a group in terms of the standard parameters of its bodies and of all bodies distal to them."""
    width = FLAT * len(groups[k].bodies)
    rows = np.zeros((len(observed), bodies + observed.shape[1] - width))
    rows[:, bodies:] = observed[:, width:]
    Phi = {i: observed[:, FLAT * b : FLAT * (b + 1)].reshape(-1, 4, 4) for b, i in enumerate(groups[k].bodies)}
    for group in groups[k + 1 :]:
        if group.parent in Phi:
            for b, i in enumerate(group.bodies):
                T = group.T[b, 0]
                Phi[i] = T.T @ Phi[group.parent] @ T
    for i, matrices in Phi.items():
        flat = matrices.reshape(-1, FLAT)
        rows[:, PARAMETERS * i : PARAMETERS * (i + 1)] = flat @ UNITS.reshape(PARAMETERS, FLAT).T
    return rows


def _shafts_between_branches(model: Model, groups: list[Group], shafts: Array) -> Array:
    """Entries of M of two coordinates that move no common body, to which only shafts contribute."""
    place = {i: g for g, group in enumerate(groups) for i in group.bodies} | {BASE: BASE}
    above = [place[group.parent] for group in groups]
    of = [place[i] for i in model.independent_joints]
    on = [{*carriers(above, g)} for g in of]  # the groups on the way to each coordinate's own
    pairs = [(j, k) for k in range(model.n) for j in range(k) if not {of[j], of[k]} & on[j] & on[k]]
    first, second = np.array(pairs, dtype=int).reshape(-1, 2).T
    entries = (shafts[:, first] * shafts[:, second]).T
    return np.asarray(entries[entries.any(axis=1)])


def span(rows: Array, tolerance: float) -> Array:
    """Orthonormal basis of the rows' span; rows of the size of roundings count as zero."""
    _, sizes, basis = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(basis[sizes > tolerance * sizes.max(initial=1.0)])


def kinetic(x: Array, y: Array) -> Array:
    """Matrix of the entry of M that belongs to the velocities x and y."""
    return symmetric(transpose(x) @ y)


def homogeneous(R: Array, p: Array) -> Array:
    """Pose as a matrix of homogeneous coordinates."""
    T = np.zeros((*R.shape[:-2], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, p, 1
    return T


def inverse(T: Array) -> Array:
    """Inverse of poses."""
    R = transpose(T[..., :3, :3])
    return homogeneous(R, -rotate(R, T[..., :3, 3]))
