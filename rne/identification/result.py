"""What an identification found, and how far to trust it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..basics.text import counted, listed, wrapped
from ..dynamics.base_inertial_parameters import BaseParameters
from ..errors import IdentificationError
from ..model.model import joint_array
from ..model.parameters import PARAMETERS, pseudo_inertia, with_parameters
from ..model.standard_parameters import StandardParameters
from ..robot import Robot
from ..simulation.friction import SMOOTHING, Friction
from .causes import Cause
from .checking import Check
from .consistent import expected_sizes, model_prior
from .equations import Equations
from .least_squares import LeastSquares, Unexplained
from .prepared import Prepared
from .record import Record
from .regression import Gathered, check_joints
from .report import EXPLAINS, report_text
from .rigid_body_test import certified

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNEXPLAINED = 0.30  # part of a joint's torque in motion above which an identification warns
NAMED = 3  # causes that a warning names
IMPOSSIBLE = "which no drive has"  # end of a note on numbers that are not possible
UNKNOWN = (
    "no single change explains all of it: look at the joints' residuals over time and speed (`plot`), and check "
    "friction, the placement of the axes, couplings and the torques' source"
)


@dataclass(frozen=True, eq=False)
class Identification:
    """Parameters found from measured motions, by `rne.identify`.

    Attributes
    ----------
    initial : Robot
        The robot as it was given.
    standard : StandardParameters
        What the torques are linear in, and the names.
    base : BaseParameters
        Those combinations that torques depend on.
    data : Gathered
        The measurements after the filter, and the equations from them.
    estimate : LeastSquares
        Base parameters by weighted least squares, with standard errors.
    parameters : ndarray, shape (P,)
        Standard parameters, in the order of `standard.names`: the physically consistent ones, or the given robot's with
        those in `base.names` changed so that the base parameters are `estimate.values`.
    consistent : bool
        True for physically consistent parameters.
    unexplained : Unexplained
        |predicted - measured| / |measured| of each joint, over blocks of time of which each was predicted by a fit to
        the others: `everywhere`, `in_motion`, where equations are fitted, and `at_rest`. NaN for a joint without.
    repeats : ndarray, shape (n,)
        How many equations of a joint count as one, because residuals are like their neighbours; in the standard errors.
    drift : ndarray, shape (base.count,)
        By how much base parameters change when everything is filtered again with half the cut-off: beyond a few
        standard errors, the filter biases them. NaN where the record is too short for it.
    causes : tuple of Cause
        What would explain the residuals better, the likeliest first.
    notes : tuple of str
        What was assumed, and what looks wrong.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
    >>> motion = rne.trajectories.quintic([0] * 6, [1] * 6, 10.0)
    >>> q, qd, qdd = motion(t)
    >>> record = rne.identification.Record(t, q, robot.inverse_dynamics(q, qd, qdd))
    >>> rne.identify(robot, record, consistent=False).held_out.shape
    (6,)
    """

    initial: Robot
    standard: StandardParameters
    base: BaseParameters
    data: Gathered
    estimate: LeastSquares
    parameters: Array
    consistent: bool
    unexplained: Unexplained
    repeats: Array
    drift: Array
    causes: tuple[Cause, ...]
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        worst = f"{100 * np.nanmax(self.held_out, initial=0):.3g} %"
        found = "physically consistent" if self.consistent else "least squares"
        return wrapped(
            f"Identification({counted(self.base.count, 'base parameter')} of {self.initial.model.name!r} from "
            f"{counted(int(self.equations.rows.sum()), 'equation')}, {found}, held-out error at most {worst})"
        )

    @property
    def held_out(self) -> Array:
        """`unexplained.everywhere`: |predicted - measured| / |measured| of each joint on held-out blocks, (n,)."""
        return self.unexplained.everywhere

    @property
    def delay(self) -> Array:
        """By which torques of each record were measured later than positions, shape (records, n) [s]."""
        return self.data.delays

    @cached_property
    def doubt(self) -> str:
        """Why the parameters should not be believed, the likeliest causes first; empty if nothing is found."""
        left = self.unexplained.in_motion
        names = self.initial.joint_names
        poor = [j for j in range(len(names)) if left[j] > UNEXPLAINED]
        impossible = [note for note in self.notes if note.endswith(IMPOSSIBLE)]
        lines, causes = [], self.causes[:NAMED]
        if poor:
            shares = listed([f"{names[j]} {100 * left[j]:.0f} %" for j in poor])
            lines.append(f"torques in motion that the model does not explain: {shares}")
        if causes:
            first = "likely causes" if len(causes) > 1 else "the likely cause"
            lines.append(f"{first}: " + "; ".join(cause.text for cause in causes))
        if any(all(cause.removed[j] < EXPLAINS for cause in self.causes) for j in poor):
            lines.append(UNKNOWN)
        return ". ".join([*lines, *impossible])

    @property
    def records(self) -> tuple[Prepared, ...]:
        """The measurements after the filter."""
        return self.data.prepared

    @property
    def equations(self) -> Equations:
        """What was fitted."""
        return self.data.fitted

    @property
    def minimum_rate(self) -> Array:
        """Rates below which the equations of a joint were not fitted, shape (n,) [rad/s or m/s]."""
        return self.data.minimum_rate

    @property
    def values(self) -> Array:
        """Base parameters of `parameters`, in the order of `base.names`, shape (base.count,)."""
        values: Array = self.base.matrix @ self.parameters
        return values

    @property
    def excited(self) -> Array:
        """True for base parameters that the motion determines to better than their expected size, (base.count,).

        That is the size of the bodies found, if they are consistent, otherwise of the given robot's; of a rotor or
        friction what would take a tenth of the torque. Bodies without any mass are of unknown size.
        """
        model, bodies = self.initial.model, self.parameters[self.standard.groups["bodies"]]
        if self.consistent:
            P = pseudo_inertia(bodies)
        else:
            P = model_prior(model)[0] if model.mass.any() else np.full((model.nb, 4, 4), np.inf)
        found: Array = self.estimate.errors < expected_sizes(P, self.base, self.equations)
        return found

    @cached_property
    def robot(self) -> Robot:
        """The robot with the bodies found, `armature` from the rotors, and `damping` and `friction` of its joints.

        Offsets and coupled motors are not part of a robot, and a URDF has no element for rotors: load it again with
        ``Scene(..., armature=...)``.

        Raises
        ------
        IdentificationError
            If a body is not possible or friction is negative, after a fit that is not physically consistent.
        """
        self._check_consistent()
        try:
            model = with_parameters(self.initial.model, self.parameters[self.standard.groups["bodies"]])
        except ValueError as error:
            raise IdentificationError(
                f"least squares gave no possible bodies: fit with `consistent=True`; {error}"
            ) from None
        return Robot(
            replace(
                model,
                armature=self._by_joint("Ia"),
                damping=self._by_joint("Fv"),
                friction=self._by_joint("Fc"),
            ),
            self.initial.engine,
        )

    def _by_joint(self, symbol: str) -> Array:
        """A parameter of drives with one entry per moving joint, zero for those that mimic others."""
        values = np.zeros(self.initial.model.nb)
        values[list(self.initial.model.independent_joints)] = self._of_drives(symbol)
        return values

    @property
    def friction(self) -> Friction:
        """Friction of the joints, for a Scene; zero where it was not asked for.

        Its `smoothing` is that of the fit, or the default of Friction where the fit had a step, sign(qd).
        """
        self._check_consistent()
        smoothing = self.standard.smoothing or SMOOTHING
        return Friction(viscous=self._of_drives("Fv"), coulomb=self._of_drives("Fc"), smoothing=smoothing)

    def _check_consistent(self) -> None:
        """Refuse to make a robot or its friction from least squares that came out negative."""
        of_drives_and_masses = [name.split("_")[0] in ("m", "Ia", "Fv", "Fc") for name in self.standard.names]
        negative = [self.standard.names[k] for k in np.flatnonzero(of_drives_and_masses & (self.parameters < 0))]
        if negative and not self.consistent:
            raise IdentificationError(
                f"least squares gave negative values of {listed(negative)}: fit with `consistent=True`; `estimate` has "
                "them as they are"
            )

    @property
    def offset(self) -> Array:
        """Constant torques of the drives, shape (n,); zero where they were not asked for [N m or N]."""
        return self._of_drives("tau0")

    def _of_drives(self, symbol: str) -> Array:
        place = self.standard.groups.get(symbol)
        return np.zeros(self.initial.n) if place is None else self.parameters[place]

    def predict(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Torques of the drives along a motion.

        Parameters
        ----------
        q, qd, qdd : array_like, shape (..., n)
            Joint positions, rates and accelerations [rad or m; rad/s or m/s; rad/s^2 or m/s^2].

        Returns
        -------
        ndarray, shape (..., n)
            With rotors, friction, offsets and coupled motors [N m or N].

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
        >>> q, qd, qdd = rne.trajectories.quintic([0] * 6, [1] * 6, 10.0)(t)
        >>> tau = robot.inverse_dynamics(q, qd, qdd)
        >>> found = rne.identify(robot, rne.identification.Record(t, q, tau), consistent=False)
        >>> found.predict(q, qd, qdd).shape
        (5000, 6)
        """
        model, bodies = self.initial.model, PARAMETERS * self.initial.model.nb
        rates, accelerations = joint_array("qd", qd, model), joint_array("qdd", qdd, model)
        drives = self.standard.drive_torques(rates, accelerations, self.parameters[bodies:])
        torques: Array = self.initial.regressor(q, rates, accelerations) @ self.parameters[:bodies] + drives
        return torques

    def check(self, record: Record) -> Check:
        """The torques predicted for another measured motion beside the measured ones.

        Parameters
        ----------
        record : Record
            Of the same robot; it is filtered with the lowest cut-off of those of the fit. Torques of joints at rest
            count, which Coulomb friction does not determine.

        Returns
        -------
        Check
            Errors of each joint, a table and a plot of them.

        Raises
        ------
        ValueError
            If the record has another number of joints, or cannot be filtered so.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
        >>> q, qd, qdd = rne.trajectories.quintic([0] * 6, [1] * 6, 10.0)(t)
        >>> record = rne.identification.Record(t, q, robot.inverse_dynamics(q, qd, qdd))
        >>> rne.identify(robot, record, consistent=False).check(record).measured.shape[1]
        6
        """
        if not isinstance(record, Record):
            raise TypeError(f"`record` must be an rne.identification.Record, got {type(record).__name__}")
        check_joints(self.initial, record, "record")
        return self._compared(record.name, record.prepare(min(fitted.cutoff for fitted in self.records)))

    def _compared(self, name: str, prepared: Prepared) -> Check:
        predicted = prepared.reduce(self.predict(prepared.q, prepared.qd, prepared.qdd))
        model = self.initial.model
        units = tuple("N m" if model.is_revolute[i] else "N" for i in model.independent_joints)
        measured = prepared.reduce(prepared.tau)
        return Check(
            name,
            model.joint_names,
            units,
            prepared.times,
            prepared.reduce(prepared.qd),
            measured,
            predicted,
            prepared.valid,
        )

    def plot(self, record: Record | None = None) -> Figure:
        """Measured and predicted torque and their difference over time, and the difference over speed, by joint.

        Parameters
        ----------
        record : Record, optional
            By default the first of those that were fitted.

        Returns
        -------
        matplotlib.figure.Figure
            `figure.savefig("torques.png")` writes it to a file.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
        >>> q, qd, qdd = rne.trajectories.quintic([0] * 6, [1] * 6, 10.0)(t)
        >>> record = rne.identification.Record(t, q, robot.inverse_dynamics(q, qd, qdd))
        >>> found = rne.identify(robot, record, consistent=False)
        >>> len(found.plot().axes)
        12
        """
        check = self._compared(self.data.names[0], self.records[0]) if record is None else self.check(record)
        return check.plot()

    def report(self) -> str:
        """What was fitted, what was found and how far to trust it, as text.

        Returns
        -------
        str
            Paragraphs on the measurements, the joints, the base parameters and the bodies, and whether one rigid-body
            model can be behind the measurements, as `rne.consistency` says.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
        >>> q, qd, qdd = rne.trajectories.quintic([0] * 6, [1] * 6, 10.0)(t)
        >>> record = rne.identification.Record(t, q, robot.inverse_dynamics(q, qd, qdd))
        >>> found = rne.identify(robot, record, consistent=False)
        >>> print(found.report().splitlines()[0][:28])
        36 base parameters of irb140
        """
        verdict = certified(self.base, self.data, self.repeats)
        certificate = replace(verdict, held_out=self.unexplained.in_motion).report()
        return f"{report_text(self)}\n\n{certificate}"
