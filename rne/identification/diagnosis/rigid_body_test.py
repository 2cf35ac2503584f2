"""Test of measured torques for consistency with one rigid-body model: the F-test of nested linear models.

The fit of a single joint has every combination of parameters that its torque depends on. In the fit of all joints these
are shared, which raises the residual of a joint with independent noise no more than chance. F compares the increase
with the joint's own residual (Draper and Smith 1998, section 6.1). Further tests are the noise of the torques, from
their spectrum above the filter's cut-off, and the energy balance W = T + U - (T + U at the start) + losses, where W is
the integral of tau . qd and energies have their own regressors (Gautier and Khalil 1988 identify with them).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...basics.filters import ORDER
from ...basics.inertia import PARAMETERS
from ...basics.spatial import Array
from ...basics.text import InNotebooks, column, listed, table, wrapped
from ...dynamics.base_inertial_parameters import BaseParameters
from ...dynamics.regressors import kinetic_energy_regressor, potential_energy_regressor, regressor
from ...model.standard_parameters import StandardParameters
from .. import thresholds
from ..fit.equations import Equations, RegressionData
from ..fit.least_squares import weighted_fit
from ..log.prepared import Prepared

COLUMNS = (
    "noise: of the filtered torques, by their spectrum; single joint, all joints: residual of a fit of each joint "
    "alone and of all joints; validation: residual on blocks that were not fitted; F: all joints against the single "
    "one, near 1 where one model fits, and how likely chance makes it so large; power left: that of the torques a fit "
    "leaves, and its mean. All but F and its chance are in % of the measured torque or power."
)


@dataclass(frozen=True, eq=False)
class Consistency(InNotebooks):
    """Consistency of torques with one rigid-body model, by `rne.Identification.consistency`.

    Attributes
    ----------
    joint_names : tuple of str
    noise : ndarray, shape (n,)
        Noise of the filtered torques, from their spectrum above the filter's cut-off, as a part of |torque|.
    held_out : ndarray, shape (n,)
        |predicted - measured| / |measured| of torques in motion on blocks of time that were not fitted:
        `Identification.unexplained.in_motion`.
    all_joints, single_joint : ndarray, shape (n,)
        Standard deviation of the fitted residual, in |measured|: with one set of parameters, and with a separate
        set for each joint. Degrees of freedom are taken into account.
    F, probability : ndarray, shape (n,)
        The F-test of the one set against the joint's own, and how likely chance makes F so large.
    independent : ndarray, shape (n,)
        Number of independent equations, which the test counts with.
    conflict : ndarray of bool, shape (n,)
        True for joints that fit by themselves but not with the others: F is larger than chance makes it in one of a
        thousand tests of all joints, and the residual of all joints is more than twice that of the single joint.
    energy : EnergyBalance
        Work that the fitted model neither stores nor loses, and the power of the residual torques.
    """

    joint_names: tuple[str, ...]
    noise: Array
    held_out: Array
    all_joints: Array
    single_joint: Array
    F: Array
    probability: Array
    independent: Array
    conflict: Array
    energy: EnergyBalance

    @property
    def validation_error(self) -> Array:
        """Validation error of torques while moving, ``held_out``, shape (n,)."""
        return self.held_out

    @property
    def one_model(self) -> bool:
        """True if no joint is in conflict with the others, and all validation errors are at most 15 %."""
        return not (self.conflict | (self.held_out > thresholds.EXPLAINED)).any()

    def __repr__(self) -> str:
        return wrapped(f"Consistency({self.verdict})")

    @property
    def verdict(self) -> str:
        """Result in one sentence."""
        noise, single = percent(self.noise), percent(self.single_joint)
        above = self._named(self.single_joint > thresholds.ABOVE_NOISE * np.maximum(self.noise, thresholds.PRECISION))
        if self.conflict.any():
            text = (
                f"no single set of inertial parameters fits {self._named(self.conflict)}: residual "
                f"{percent(self.all_joints)} of all joints together, {single} of each alone, noise {noise}"
            )
            cause = f"alone, {above} exceed the noise too: friction of another kind may cause the conflict"
        elif (poor := self.held_out > thresholds.EXPLAINED).any():
            left = percent(self.held_out[poor])
            return f"no rigid-body model with these drives predicts {self._named(poor)}: validation error {left}"
        else:
            left = percent(self.held_out)
            text = f"one rigid-body model explains the torques: validation error {left}, noise {noise}"
            cause = f"above the noise in {above}, and not due to inertial parameters: each joint alone leaves it too"
        return f"{text}; {cause}" if above else text

    def _named(self, chosen: Array) -> str:
        """Names of the joints for which a mask is true."""
        return listed([name for name, yes in zip(self.joint_names, chosen, strict=True) if yes])

    def report(self) -> str:
        """Text with the verdict, a table of the joints, and the energy balance.

        Returns
        -------
        str
            Lines of at most 100 characters.
        """
        title = ("noise", "single joint", "all joints", "validation", "F", "chance of F", "power left", "its mean")
        shares = [column(100 * x, ".3g") for x in (self.noise, self.single_joint, self.all_joints, self.held_out)]
        shares += [column(self.F, ".3g"), column(self.probability, ".1g")]
        shares += [column(100 * x, ".2g") for x in (self.energy.power, self.energy.lost)]
        rows = table("errors [%]", title, self.joint_names, *shares, indent="  ")
        energy = (
            f"energy: {100 * self.energy.missing:.2g} % of the work of the drives is neither stored nor lost in the "
            "fitted model"
        )
        return "\n".join([wrapped(self.verdict), *rows, wrapped(COLUMNS), energy])


def percent(x: Array) -> str:
    """Range of the shares that are known, as a text in per cent."""
    return f"{100 * np.nanmin(x):.2g} to {100 * np.nanmax(x):.2g} %"


def certified(base: BaseParameters, data: RegressionData, held_out: Array) -> Consistency:
    """Consistency test of the equations of records, with their validation errors in motion."""
    from scipy.stats import f

    fitted = data.fitted.without_instruments().mapped(base.back)
    rows, size = fitted.rows.sum(0), fitted.torques()
    least = thresholds.PRECISION**2 * np.maximum(size, thresholds.PRECISION**2 * size.max(initial=0)) + thresholds.TINY
    own, squares, ranks = zip(*(single_joint_fit(fitted.of_joint(j)) for j in range(fitted.joints)), strict=True)
    correlation_time = np.array([data.correlation_time(data.residuals(base.back @ x))[j] for j, x in enumerate(own)])
    squares, freedom = np.maximum(squares, least), np.maximum(rows - ranks, 1)
    sigma = np.sqrt(squares / freedom)
    x, spent = weighted_fit(fitted, sigma)
    total, free = np.maximum(fitted.residuals(x), squares), np.maximum(ranks - spent, 1)
    F = (total - squares) / free / (squares / freedom) / correlation_time
    independent = np.maximum(rows / correlation_time - ranks, 1)
    probability = np.asarray(f.sf(F, free, independent))
    scale = rows / np.maximum(size, thresholds.TINY)
    all_joints, single_joint = np.sqrt(total / np.maximum(rows - spent, 1) * scale), np.sqrt(squares / freedom * scale)
    conflict = (probability < thresholds.CHANCE / fitted.joints) & (all_joints > thresholds.CONFLICT * single_joint)
    names, energy = base.standard.model.joint_names, energy_balance(base.standard, data, base.back @ x)
    errors = noise_shares(data.prepared), held_out, all_joints, single_joint
    return Consistency(names, *errors, F, probability, independent, conflict, energy)


def noise_shares(records: Sequence[Prepared], unknown: float = np.nan) -> Array:
    """Noise of the filtered torques, from their spectra, relative to |torque|, (n,); `unknown` if not measurable."""
    noise = sum(record.valid.sum(0) * np.nan_to_num(torque_noise(record), nan=unknown) for record in records)
    size = sum(((record.reduce(record.tau) * record.valid) ** 2).sum(0) for record in records)
    return np.asarray(np.sqrt(noise / (size + thresholds.TINY)))


def single_joint_fit(equations: Equations) -> tuple[Array, float, int]:
    """Least-norm estimates, |residual|^2 and rank of the equations of one joint."""
    factor = equations.weighted(np.ones(1))
    lengths = np.linalg.norm(factor[:, :-1], axis=0)
    lengths[lengths <= thresholds.NOTHING * lengths.max(initial=0)] = np.inf  # columns of rounding, which get a zero
    x, _, rank, _ = np.linalg.lstsq(factor[:, :-1] / lengths, factor[:, -1], rcond=thresholds.BELIEVED)
    return x / lengths, float(equations.residuals(x / lengths)[0]), int(rank)


def torque_noise(record: Prepared) -> Array:
    """Variance of the filtered torques' noise, shape (n,) [N^2 m^2 or N^2]; NaN if no frequency band shows it.

    Noise that is equal at all frequencies has the spectral density S. It is the mean from a quarter of the sample rate
    to 0.45 of it, above twice the cut-off, where no motion is left. The filter leaves S times the integral of its
    squared gain, 1 / (1 + (f / cutoff)^(2 m))^2.
    """
    from scipy.signal import welch

    rate, (lowest, highest) = record.sample_rate, thresholds.NOISE_BAND
    longest = max(part.stop - part.start for part in record.segments)
    length = min(longest, max(thresholds.NOISE_POINTS, int(thresholds.NOISE_WINDOW * rate / record.cutoff)))
    parts = [part for part in record.segments if part.stop - part.start >= length]
    spectra = [welch(record.tau[part], rate, "hann", length, detrend="linear", axis=0) for part in parts]
    f = spectra[0][0]
    density = np.average([s for _, s in spectra], axis=0, weights=[part.stop - part.start for part in parts])
    above = (f >= max(thresholds.ABOVE_CUTOFF * record.cutoff, lowest * rate)) & (f <= highest * rate)
    if not above.any():
        return np.full(record.tau.shape[1], np.nan)
    k = 1 / (2 * ORDER)
    bandwidth = record.cutoff * (1 - k) * np.pi * k / np.sin(np.pi * k)
    return np.asarray(density[above].mean(0) * bandwidth)


class EnergyBalance(NamedTuple):
    """Energy balance relative to the work of drives and brakes, by `rne.Identification.consistency`.

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
    """

    missing: float
    lost: Array
    power: Array


def energy_balance(standard: StandardParameters, data: RegressionData, x: Array) -> EnergyBalance:
    """Energy balance of measured motions for standard parameters x."""
    sums, energies, residuals = np.zeros((4, standard.model.n)), np.zeros(2), data.residuals(x)
    for record, rows in zip(data.prepared, data.parts, strict=True):
        velocity = record.reduce(record.qd) * record.valid
        power, total = residuals[rows] * velocity, record.reduce(record.tau) * velocity
        sums += [power.sum(0), np.abs(total).sum(0), (power**2).sum(0), (total**2).sum(0)]
        energies += sum(energies_of_pieces(standard, record, part, x) for part in record.segments)
    (missing, work), (mean, size, square, whole) = np.sqrt(energies), sums
    lost, power = mean / np.maximum(size, thresholds.TINY), np.sqrt(square / np.maximum(whole, thresholds.TINY))
    return EnergyBalance(float(missing / max(work, thresholds.TINY)), lost, power)


def energies_of_pieces(standard: StandardParameters, record: Prepared, part: slice, x: Array) -> Array:
    """Squared missing energy and squared work, summed over the pieces of a segment, shape (2,)."""
    from scipy.integrate import cumulative_trapezoid

    model, bodies = standard.model, PARAMETERS * standard.model.nb
    q, qd, qdd, tau = (y[part] for y in (record.q, record.qd, record.qdd, record.tau))
    ends = np.unique(np.linspace(0, len(q) - 1, thresholds.ENERGY_PIECES + 1).astype(int))
    stored = kinetic_energy_regressor(model, q[ends], qd[ends]) + potential_energy_regressor(model, q[ends])
    load = standard.load(regressor(model, q, qd, qdd), q, qdd, x) if "Fl" in standard.terms else None
    drives = standard.drive_torques(qd, qdd, x[bodies:], load) + standard.spring_torques(q, x)
    powers = np.stack([((tau - drives) * qd).sum(-1), np.abs(tau * qd).sum(-1)], axis=1)
    work = cumulative_trapezoid(powers, dx=1 / record.sample_rate, axis=0, initial=0)[ends]
    work[:, 0] -= stored @ x[:bodies]
    return np.asarray((np.diff(work, axis=0) ** 2).sum(0))
