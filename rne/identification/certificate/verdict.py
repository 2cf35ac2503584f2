"""The verdict on measured torques: can they come from one rigid-body model?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...basics.spatial import Array
from ...basics.text import Row, aligned, listed, short, wrapped
from ...dynamics.base_inertial_parameters import BaseParameters
from ...robot import Robot
from ..estimation.equations import Equations
from ..measurements.prepared import Prepared
from .energy import EnergyBalance, energy_balance
from .joint_statistics import PRECISION, joint_statistics
from .noise import torque_noise

CHANCE = 1e-3  # of all joints together, that F is called large by accident
WORSE = 2.0  # times the joint's own residual: a conflict has to matter
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
        |predicted - measured| / |measured| on blocks of time that were not fitted, with one set of parameters for all
        joints.
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
        """True if no joint is in conflict with the others."""
        return not self.conflict.any()

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


def certified(
    base: BaseParameters,
    prepared: Sequence[Prepared],
    fitted: Equations,
    measured: Equations,
    repeats: Array,
    residuals: Callable[[Array], Sequence[Array]],
) -> Consistency:
    """The verdict, from equations of standard parameters x; residuals(x) are those of each record's reduced rows."""
    E = base.back
    found = joint_statistics(fitted.mapped(E), measured.mapped(E), repeats)
    conflict = (found.probability < CHANCE / fitted.joints) & (found.together > WORSE * found.alone)
    x = E @ found.parameters
    energy = energy_balance(base.standard, prepared, x, residuals(x))
    return Consistency(
        base.standard.model.joint_names,
        noise_shares(prepared),
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


def certificate_lines(
    robot: Robot,
    base: BaseParameters,
    records: Sequence[Prepared],
    equations: Equations,
    repeats: Array,
    held_out: Array,
) -> str:
    """The certificate of an identification as text, from its equations and filtered records.

    Parameters
    ----------
    robot : Robot
    base : BaseParameters
    records : sequence of Prepared
    equations : Equations
        Of the standard parameters, in blocks.
    repeats : ndarray, shape (n,)
        How many equations of a joint count as one.
    held_out : ndarray, shape (n,)
        Errors on held-out blocks, as the identification has them.

    Returns
    -------
    str
    """
    bodies = base.standard.groups["bodies"].stop

    def residuals(x: Array) -> list[Array]:
        left = []
        for r in records:
            drives = base.standard.drive_columns(r.qd, r.qdd) @ x[bodies:]
            left.append(r.reduce(r.tau - robot.regressor(r.q, r.qd, r.qdd) @ x[:bodies] - drives))
        return left

    found = certified(base, records, equations, equations, repeats, residuals)
    return replace(found, held_out=held_out).report()
