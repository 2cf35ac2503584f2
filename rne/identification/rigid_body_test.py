"""Whether measured torques can come from one rigid-body model: the F-test of nested linear models.

A joint's own fit may take every combination of parameters that its torque depends on. That of all joints has to share
them, which costs a joint with independent noise no more than chance; F compares the cost with the joint's own residual
(Draper and Smith 1998, section 6.1). Beside it the noise of the torques, from their spectrum above the filter's
cut-off, and the energy balance W = T + U - (T + U at the start) + losses, W the integral of tau . qd, whose energies
come from their own regressors (Gautier and Khalil 1988 identify with them).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import gamma
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..basics.text import Row, aligned, listed, short, wrapped
from ..dynamics.base_inertial_parameters import BaseParameters
from ..dynamics.regressors import kinetic_energy_regressor, potential_energy_regressor
from ..model.parameters import PARAMETERS
from ..model.standard_parameters import MEASURED, DriveModel, StandardParameters
from ..robot import Robot
from .equations import Equations
from .filtering import ORDER
from .least_squares import solve
from .prepared import Prepared
from .record import Record
from .regression import HELD_OUT, Gathered, check_robot, gathered

CHANCE = 1e-3  # of all joints together, that F is called large by accident
WORSE = 2.0  # times the joint's own residual: a conflict has to matter
EXPLAINED = 0.15  # part of a torque in motion that may be left where a model explains it
FLOOR = 3.0  # times the noise, above which a residual is not noise


@dataclass(frozen=True, eq=False)
class Consistency:
    """Whether torques can come from one rigid-body model, by `rne.consistency`.

    Attributes
    ----------
    joint_names : tuple of str
    noise : ndarray, shape (n,)
        Noise of the filtered torques, from their spectrum above the filter's cut-off, as a part of |torque|.
    held_out : ndarray, shape (n,)
        |predicted - measured| / |measured| of torques in motion on blocks of time that were not fitted, with one set of
        parameters for all joints.
    together, alone : ndarray, shape (n,)
        Standard deviation of the fitted residual, in |measured|: with one set of parameters, and with one of its own
        for each joint. The parameters that a joint spends are taken into account.
    F, probability : ndarray, shape (n,)
        The F-test of the one set against the joint's own, and how likely chance makes F so large.
    independent : ndarray, shape (n,)
        Number of independent equations, which the test counts with.
    conflict : ndarray of bool, shape (n,)
        True for joints that fit alone but not together: F is larger than chance makes it in one of a thousand tests of
        all joints, and the residual together is more than twice that alone.
    energy : EnergyBalance
        `missing`, the share of the work that the fitted model neither stores nor loses, and by joint `lost` and
        `power`, the mean and the root mean square of the residual torques' power, as parts of that of the torques.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
    >>> w = 2 * np.pi * np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    >>> q, qd, qdd = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
    >>> tau = robot.inverse_dynamics(q, qd, qdd)
    >>> rne.consistency(robot, rne.identification.Record(t, q, tau)).one_model
    True
    """

    joint_names: tuple[str, ...]
    noise: Array
    held_out: Array
    together: Array
    alone: Array
    F: Array
    probability: Array
    independent: Array
    conflict: Array
    energy: EnergyBalance

    @property
    def one_model(self) -> bool:
        """True if no joint is in conflict with the others, and all are explained to 15 % or better."""
        return not (self.conflict | (self.held_out > EXPLAINED)).any()

    def __repr__(self) -> str:
        return wrapped(f"Consistency({self.verdict})")

    @property
    def verdict(self) -> str:
        """The answer in a sentence."""
        noise, alone = percent(self.noise), percent(self.alone)
        above = self._named(self.alone > FLOOR * np.maximum(self.noise, PRECISION))
        if self.conflict.any():
            text = (
                f"no single set of inertial parameters fits: {self._named(self.conflict)}. Together the torques "
                f"are off by {percent(self.together)}, each joint's alone by {alone}; noise explains {noise}"
            )
            cause = f"alone, {above} are above the noise too: friction of another kind may set the joints at variance"
            return f"{text}; {cause}" if above else text
        poor = self.held_out > EXPLAINED
        if poor.any():
            left = percent(self.held_out[poor])
            return f"no rigid-body model with these drives predicts {self._named(poor)}: {left} of the torques is left"
        text = f"one rigid-body model explains the torques to {percent(self.held_out)}, noise explains {noise}"
        cause = (
            f"what is above the noise in {above} no inertial parameters explain, not those of each joint alone either"
        )
        return f"{text}; {cause}" if above else text

    def _named(self, chosen: Array) -> str:
        """The joints for which a mask is true."""
        return listed([name for name, yes in zip(self.joint_names, chosen, strict=True) if yes])

    def report(self) -> str:
        """The verdict, a table of the joints, and the energy balance.

        Returns
        -------
        str
            Lines of at most 100 characters.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
        >>> w = 2 * np.pi * np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
        >>> q, qd, qdd = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
        >>> record = rne.identification.Record(t, q, robot.inverse_dynamics(q, qd, qdd))
        >>> rne.consistency(robot, record).report().startswith("one rigid-body model explains the torques")
        True
        """
        title = ("noise", "alone", "together", "held out", "F", "chance of F", "power left", "its mean")
        rows = [Row("errors [%]", title, words=True)]
        for j, name in enumerate(self.joint_names):
            percents = [f"{100 * x[j]:.3g}" for x in (self.noise, self.alone, self.together, self.held_out)]
            power = [f"{100 * x[j]:.2g}" for x in (self.energy.power, self.energy.lost)]
            rows.append(Row(f"  {short(name)}", [*percents, f"{self.F[j]:.3g}", f"{self.probability[j]:.1g}", *power]))
        energy = (
            f"energy: {100 * self.energy.missing:.2g} % of the work of the drives is neither stored nor lost in the "
            "fitted model"
        )
        return "\n".join([wrapped(self.verdict), *aligned(rows), energy])


def percent(x: Array) -> str:
    """The range of some shares."""
    low, high = 100 * float(x.min()), 100 * float(x.max())
    return f"{low:.2g} to {high:.2g} %"


def certified(base: BaseParameters, data: Gathered, repeats: Array) -> Consistency:
    """The verdict on the equations of records."""
    E = base.back
    found = joint_statistics(data.fitted.mapped(E), repeats)
    conflict = (found.probability < CHANCE / data.fitted.joints) & (found.together > WORSE * found.alone)
    x = E @ found.parameters
    energy = energy_balance(base.standard, data.prepared, x, data.residuals(x))
    return Consistency(
        base.standard.model.joint_names,
        noise_shares(data.prepared),
        found.held_out,
        found.together,
        found.alone,
        found.F,
        found.probability,
        found.independent,
        conflict,
        energy,
    )


def noise_shares(prepared: Sequence[Prepared]) -> Array:
    """Noise as a part of |torque|."""
    squares = np.zeros((2, prepared[0].q.shape[1]))
    for record in prepared:
        torque = record.reduce(record.tau) * record.valid
        squares += [record.valid.sum(0) * torque_noise(record) ** 2, (torque**2).sum(0)]
    return np.asarray(np.sqrt(squares[0] / np.maximum(squares[1], np.finfo(float).tiny)))


def consistency(
    robot: Robot,
    records: Record | Sequence[Record],
    *,
    drives: DriveModel | None = None,
    minimum_rate: ArrayLike | None = None,
    cutoff: float | None = None,
    decimation: int | None = None,
    blocks: int = HELD_OUT,
) -> Consistency:
    """Say whether measured torques can come from one rigid-body model at all.

    One set of parameters is fitted to all joints, and a set of its own to each. Torques of a rigid body leave the
    same in both fits, up to chance. The masses of `robot` do not matter, only its joints and their places.

    Parameters
    ----------
    robot : Robot
        Its joints and their places are known.
    records : Record or sequence of Record
        Measured motions.
    drives : DriveModel, optional
        Torques of the drives, by default rotors, viscous and Coulomb friction and offsets.
    minimum_rate : array_like, shape (n,), optional
        Slower equations of a joint are left out, as by `rne.identify` [rad/s or m/s].
    cutoff : float, optional
        Of the low-pass filter, by default chosen from the measurements [Hz].
    decimation : int, optional
        Samples per equation after the filter; by default from the cut-off.
    blocks : int
        The measurements are cut into so many, each to be predicted from the others.

    Returns
    -------
    Consistency
        The verdict, and the numbers of each joint that it rests on.

    Raises
    ------
    ValueError
        If an argument does not fit the robot, or there are fewer equations than parameters.

    Notes
    -----
    The test is that of Draper and Smith 1998, section 6.1, with the number of equations divided by the correlation time
    of the residuals. The noise is taken from the spectrum of the torques above twice the filter's cut-off.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
    >>> w = 2 * np.pi * np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    >>> q, qd, qdd = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
    >>> tau = robot.inverse_dynamics(q, qd, qdd)
    >>> tau[:, 2] *= 1.2  # a wrong gear ratio
    >>> rne.consistency(robot, rne.identification.Record(t, q, tau)).one_model
    False
    """
    check_robot(robot)
    base = robot.base_parameters(drives=MEASURED if drives is None else drives)
    data = gathered(robot, records, base, minimum_rate, cutoff, decimation, blocks)
    own = [base.back @ own_fit(data.fitted.of_joint(j).mapped(base.back))[0] for j in range(robot.n)]
    repeats = np.array([data.repeats(x)[j] for j, x in enumerate(own)])
    return certified(base, data, repeats)


PRECISION = 1e-6  # of a joint's torques: no fit is taken for more exact
BELIEVED = 1e-6  # singular values below this part of the largest say nothing


@dataclass(frozen=True, eq=False)
class JointStatistics:
    """Residuals of each joint: together with the others, and alone; shape (n,) each.

    Attributes
    ----------
    parameters : ndarray, shape (count,)
        Base parameters of all joints together.
    held_out : ndarray
        |predicted - measured| / |measured| on blocks of time that were not fitted, together.
    together, alone : ndarray
        Standard deviation of the residual, with the parameters that a joint spends taken into account, in |measured|.
    F : ndarray
        Ratio of the mean squares; about 1 if one set of parameters serves all joints.
    probability : ndarray
        That chance alone makes F so large.
    independent : ndarray
        Number of independent equations.
    """

    parameters: Array
    held_out: Array
    together: Array
    alone: Array
    F: Array
    probability: Array
    independent: Array


def joint_statistics(fitted: Equations, repeats: Array) -> JointStatistics:
    """The comparison, for equations of the base parameters.

    Parameters
    ----------
    fitted : Equations
    repeats : ndarray, shape (n,)
        How many equations of a joint count as one.

    Returns
    -------
    JointStatistics
    """
    n, all_rows = fitted.joints, fitted.rows.sum(0)
    size = fitted.torques()
    least = PRECISION**2 * np.maximum(size, PRECISION**2 * size.max(initial=0)) + np.finfo(float).tiny
    own = [own_fit(fitted.of_joint(j)) for j in range(n)]
    squares, ranks = (np.array(x) for x in zip(*((s, r) for _, s, r in own), strict=True))
    squares = np.maximum(squares, least)
    sigma = np.sqrt(squares / np.maximum(all_rows - ranks, 1))
    x, spent = joint_fit(fitted, sigma)
    freedom, independent = np.maximum(all_rows - ranks, 1), np.maximum(all_rows / repeats - ranks, 1)
    total = np.maximum(fitted.residuals(x), squares)
    free = np.maximum(ranks - spent, 1)
    F = (total - squares) / free / (squares / freedom) / repeats
    from scipy.stats import f

    def share(squares: Array, freedom: Array) -> Array:
        return np.asarray(np.sqrt(squares / freedom * all_rows / np.maximum(size, np.finfo(float).tiny)))

    held = held_out_together(fitted, sigma)
    return JointStatistics(
        x,
        np.sqrt(held / np.maximum(size, np.finfo(float).tiny)),
        share(total, np.maximum(all_rows - spent, 1)),
        share(squares, freedom),
        F,
        np.asarray(f.sf(F, free, independent)),
        independent,
    )


def own_fit(equations: Equations) -> tuple[Array, float, int]:
    """Estimates, |residual|^2 and rank of the equations of one joint."""
    factor = equations.weighted(np.ones(1))
    x, rank = truncated(factor)
    return x, float(equations.residuals(x)[0]), rank


def truncated(factor: Array) -> tuple[Array, int]:
    """The solution of smallest length in the directions that the equations determine."""
    A, b = factor[:, :-1], factor[:, -1]
    lengths = np.linalg.norm(A, axis=0)
    lengths[lengths == 0] = 1
    x, _, rank, _ = np.linalg.lstsq(A / lengths, b, rcond=BELIEVED)
    return x / lengths, int(rank)


def joint_fit(equations: Equations, sigma: Array) -> tuple[Array, Array]:
    """Estimates of all joints together, and how many parameters each joint's equations determine."""
    solution = solve(equations.weighted(sigma))
    spent = ((equations.factors[..., :-1] @ solution.inverse) ** 2).sum((0, 2, 3)) / sigma**2
    return solution.x, spent


def held_out_together(fitted: Equations, sigma: Array) -> Array:
    """|residual|^2 of each joint on blocks that were not fitted."""
    squares = np.zeros(fitted.joints)
    for k in range(len(fitted.factors)):
        others = np.arange(len(fitted.factors)) != k
        x, _ = joint_fit(fitted.of_blocks(others), sigma)
        squares += fitted.of_blocks(~others).residuals(x)
    return squares


ABOVE = 2.0  # times the cut-off: no motion is left there
LOWEST, HIGHEST = 0.25, 0.45  # of the sample rate, between which noise is looked for
PASSED = 0.7  # of the cut-off of the positions' filter, up to which their noise passes
WINDOW = 8.0  # periods of the cut-off in one spectrum, at least
POINTS = 64  # of a spectrum, at least


def torque_noise(record: Prepared) -> Array:
    """Standard deviation that noise gives the torques after the filter, shape (n,) [N m or N].

    Noise that is equal at all frequencies has the spectral density S. It is the mean from a quarter of the sample rate
    to 0.45 of it, above twice the cut-off, where no motion is left. The filter leaves S times the integral of its
    squared gain.
    """
    rate = record.sample_rate
    f, density = spectrum(record, record.tau)
    above = (f >= max(ABOVE * record.cutoff, LOWEST * rate)) & (f <= HIGHEST * rate)
    noise: Array = np.sqrt(density[above].mean(0) * bandwidth(record.cutoff))
    return noise


def torque_noise_of_positions(record: Prepared, torques: Array) -> Array:
    """Standard deviation that noise of the positions gives predicted torques after the filter, shape (n,) [N m or N].

    White noise of positions makes accelerations, and torques predicted from them, of density A f^4. A is found between
    twice the cut-off and 0.7 of that of the positions' filter; the filter leaves A times the integral of f^4 times its
    squared gain.

    Parameters
    ----------
    record : Prepared
    torques : ndarray, shape (T, n)
        Predicted on the grid, not filtered [N m or N].

    Returns
    -------
    ndarray, shape (n,)
    """
    f, density = spectrum(record, torques)
    between = (f >= ABOVE * record.cutoff) & (f <= PASSED * record.position_cutoff)
    if not between.any():
        return np.zeros(torques.shape[1])
    A = (density[between] / f[between, None] ** 4).mean(0)
    k = 5 / (2 * ORDER)  # the integral of x^4 / (1 + x^(2 m))^2 is Gamma(k) Gamma(2 - k) / (2 m), with k = 5 / (2 m)
    noise: Array = np.sqrt(A * record.cutoff**5 * gamma(k) * gamma(2 - k) / (2 * ORDER))
    return noise


def spectrum(record: Prepared, x: Array) -> tuple[Array, Array]:
    """Frequencies and power spectral density of columns on the grid, averaged over the long segments."""
    from scipy.signal import welch

    rate = record.sample_rate
    longest = max(part.stop - part.start for part in record.segments)
    length = min(longest, max(POINTS, int(WINDOW * rate / record.cutoff)))
    parts = [part for part in record.segments if part.stop - part.start >= length]
    spectra = [welch(x[part], rate, "hann", length, detrend="linear", axis=0) for part in parts]
    return spectra[0][0], np.average([s for _, s in spectra], axis=0, weights=[p.stop - p.start for p in parts])


def bandwidth(cutoff: float) -> float:
    """Integral of the squared gain of the filter forwards and backwards, 1 / (1 + (f / cutoff)^(2 m))^2 [Hz]."""
    x = 1 / (2 * ORDER)
    return float(cutoff * (1 - x) * np.pi * x / np.sin(np.pi * x))


PIECES = 10  # of each segment, over which work and energy are compared


class EnergyBalance(NamedTuple):
    """Shares of the work that drives and brakes do, of `Consistency.energy`.

    Attributes
    ----------
    missing : float
        Root mean square of the energy that is neither stored nor lost in the model, in pieces of the motion, as a part
        of the work done there, forwards and backwards.
    lost : ndarray, shape (n,)
        Mean power of the residual torque of each joint as a part of that of its torque: above zero, the model loses
        less than the robot.
    power : ndarray, shape (n,)
        Root mean square of that power, as the same part.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
    >>> q = np.sin(np.outer(t, 2 * np.pi * np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.8])))
    >>> spline = rne.trajectories.spline(t, q)
    >>> tau = robot.inverse_dynamics(*spline(t))
    >>> energy = rne.consistency(robot, rne.identification.Record(t, q, tau)).energy
    >>> bool(energy.missing < 0.01)
    True
    """

    missing: float
    lost: Array
    power: Array


def energy_balance(
    standard: StandardParameters, records: Sequence[Prepared], x: Array, residuals: Sequence[Array]
) -> EnergyBalance:
    """The balance of measured motions.

    Parameters
    ----------
    standard : StandardParameters
    records : sequence of Prepared
    x : ndarray, shape (P,)
        Standard parameters.
    residuals : sequence of ndarray, shape (R, n)
        Measured less predicted torques of each record's reduced rows.

    Returns
    -------
    EnergyBalance
    """
    pieces = np.concatenate([_pieces(standard, record, x) for record in records])
    sums = np.zeros((4, standard.model.n))
    for record, residual in zip(records, residuals, strict=True):
        rate, torque = record.reduce(record.qd), record.reduce(record.tau)
        power, total = residual * rate * record.valid, torque * rate * record.valid
        sums += [power.sum(0), np.abs(total).sum(0), (power**2).sum(0), (total**2).sum(0)]
    tiny = np.finfo(float).tiny
    work = max(float(np.sqrt((pieces[:, 1] ** 2).sum())), tiny)
    return EnergyBalance(
        float(np.sqrt((pieces[:, 0] ** 2).sum())) / work,
        sums[0] / np.maximum(sums[1], tiny),
        np.sqrt(sums[2] / np.maximum(sums[3], tiny)),
    )


def _pieces(standard: StandardParameters, record: Prepared, x: Array) -> Array:
    """Energy that is missing, and work done, in each piece; shape (pieces, 2) [J]."""
    model, bodies = standard.model, PARAMETERS * standard.model.nb
    found = []
    for part in record.segments:
        q, qd, qdd, tau = (y[part] for y in (record.q, record.qd, record.qdd, record.tau))
        ends = np.unique(np.linspace(0, len(q) - 1, PIECES + 1).astype(int))
        stored = kinetic_energy_regressor(model, q[ends], qd[ends]) + potential_energy_regressor(model, q[ends])
        drives = (qd * standard.drive_torques(qd, qdd, x[bodies:])).sum(-1)  # rotors and losses
        power = (tau * qd).sum(-1)
        left = integral(power - drives, record.sample_rate)[ends]
        done = integral(np.abs(tau * qd).sum(-1), record.sample_rate)[ends]
        found.append(np.stack([np.diff(left - stored @ x[:bodies]), np.diff(done)], axis=1))
    return np.concatenate(found)


def integral(power: Array, rate: float) -> Array:
    """Integral from the first sample, by trapezoids."""
    steps = (power[1:] + power[:-1]) / (2 * rate)
    return np.concatenate([[0.0], np.cumsum(steps)])
