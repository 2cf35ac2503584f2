"""Result of an identification, its report, and reasons for doubt."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from ..basics.archive import Archived, Kinds, names_of
from ..basics.arrays import cached_array, positive_number
from ..basics.inertia import PARAMETERS, pseudo_inertia
from ..basics.spatial import Array
from ..basics.text import InNotebooks, column, counted, listed, short, table, wrapped
from ..dynamics.base_inertial_parameters import BaseParameters
from ..errors import IdentificationError, IdentificationWarning
from ..model.model import Model
from ..model.parameters import with_parameters
from ..model.standard_parameters import DriveModel, StandardParameters
from ..robot import Robot
from . import thresholds
from .check import Check
from .diagnosis.hypotheses import GEARS, Cause, units
from .diagnosis.rigid_body_test import Consistency, certified
from .fit.consistent import expected_sizes, model_prior
from .fit.equations import (
    BEYOND,
    EARLY,
    LOCKED,
    MOVING,
    NO_TORQUE,
    Equations,
    RegressionData,
    by_number,
    check_joints,
    delayed,
    locked_text,
    solve,
)
from .fit.least_squares import (
    Bias,
    Estimator,
    LeastSquares,
    Unexplained,
    believed_noise,
    bias_of_least_squares,
    held_out,
    with_correlation,
)
from .log.prepared import Prepared
from .log.record import Record
from .prediction import Bands, bands_of, possible_draws, prior_scale

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..kernels.kernel import Kernel
    from ..simulation.friction import Friction
    from ..simulation.scene import Scene
    from ..simulation.springs import JointSpring, Spring, Springs

NOT_CONSISTENT = "parameters are those of least squares, as with `consistent=False`"  # start of a note
NOT_SOUGHT = "causes of the residuals were not searched for, as `causes` says"  # a note
NAMED = 3  # number of causes named in a warning
ESSENTIAL = "of the essential parameters alone, by least squares, which need not be those of possible bodies"  # a note
WRONG_SIGN = "is the sign of the joint's torque right?"  # end of a note on negative friction
IMPOSSIBLE = "which no drive has", "which no spring has"  # ends of notes on numbers that are not possible
BASE_UNITS = (
    "Units: m in kg, mcx ... in kg m, Ixx ... and Ia in kg m^2, Fv and Fvb in N m s/rad, Fc, Fs and tau0 in N m; of "
    "sliding joints Ia in kg, Fv and Fvb in N s/m, the others in N; Fl is a part of the load."
)
MORE = "`report(details=True)`: filters, base parameters with standard errors, bodies, the test for one rigid body"
MOVE_ALL = "Move all joints farther and faster: `rne.excitation` finds a motion"
UNKNOWN = (
    "no single change explains all of it: look at the joints' residuals over time and speed (`plot`), and check "
    "friction, the placement of the axes, couplings and the torques' source"
)


def kinds() -> Kinds:
    """Classes that a saved identification consists of, with their fields."""
    from ..model.coupling import IN_FILES
    from ..model.solids import Box, Cylinder
    from ..simulation.springs import JointSpring, Spring, Springs

    of_models = *IN_FILES, Model, Box, Cylinder, StandardParameters, DriveModel, Springs, Spring, JointSpring
    of_fits = Identification, RegressionData, Equations, Prepared, LeastSquares, Unexplained, Cause

    def with_kernels(standard: StandardParameters, **others: Any) -> BaseParameters:
        return BaseParameters(standard, body_regressor=Robot(standard.model).regressor, **others)

    found: Kinds = {kind: (names_of(kind), kind) for kind in (*of_models, *of_fits)}
    of_base = (("standard", "independent", "matrix"), with_kernels)
    return found | {Robot: (("model", "engine"), Robot), BaseParameters: of_base}


@dataclass(frozen=True, eq=False)
class Identification(Archived, InNotebooks):
    """Parameters identified from measured motions, by `rne.identify`.

    Attributes
    ----------
    initial : Robot
        The robot as it was given.
    standard : StandardParameters
        The parameters that torques are linear in, their order and names.
    base : BaseParameters
        The combinations of parameters that torques depend on.
    data : RegressionData
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
        the others: `everywhere`, `in_motion`, where equations are fitted, and `at_rest`; NaN without any torque there.
    correlation_time : ndarray, shape (n,)
        Integrated autocorrelation time of the residuals, in rows; the number of rows over it is the effective sample
        size, with which standard errors are computed.
    drift, drift_error : ndarray, shape (base.count,)
        Change of the base parameters when everything is filtered again with half the cut-off, and standard errors of
        the parameters with half the cut-off. Where the change exceeds a few of these, one of the two cut-offs biases
        the parameter, or something else changes with frequency. NaN where the record is too short, or the joints stop
        too often.
    causes : tuple of Cause
        Changes that would explain the residuals better, the likeliest first.
    notes : tuple of str
        Assumptions, and signs of mistakes.
    prior_std : float or None
        Standard deviation of the prior, how far bodies may differ from it, relatively; None in files that were saved
        before it was kept.
    """

    initial: Robot
    standard: StandardParameters
    base: BaseParameters
    data: RegressionData
    estimate: LeastSquares
    parameters: Array
    consistent: bool
    unexplained: Unexplained
    correlation_time: Array
    drift: Array
    drift_error: Array
    causes: tuple[Cause, ...]
    notes: tuple[str, ...]
    prior_std: float | None = None

    _kinds = staticmethod(kinds)

    def __repr__(self) -> str:
        worst = f"{100 * np.nanmax(self.unexplained.in_motion, initial=0):.3g} %"
        found = "physically consistent" if self.consistent else "least squares"
        error = f"validation error while moving at most {worst}"
        return wrapped(
            f"Identification({counted(self.base.count, 'base parameter')} of {self.initial.model.name!r} from "
            f"{counted(int(self.equations.rows.sum()), 'equation')}, {found}, {error})"
        )

    @property
    def validation_error(self) -> Array:
        """|predicted - measured| / |measured| of each joint on blocks not fitted, `unexplained.everywhere`, (n,)."""
        return self.unexplained.everywhere

    held_out = validation_error

    @property
    def delay(self) -> Array:
        """Delay of the torques of each record after the positions, shape (records, n) [s]."""
        return self.data.delays

    @cached_property
    def doubt(self) -> str:
        """Reasons to doubt the parameters, the likeliest causes first; empty if there are none."""
        left, names = self.unexplained.in_motion, self.initial.joint_names
        poor = np.flatnonzero(left > thresholds.UNEXPLAINED)
        impossible = [note for note in self.notes if note.endswith(IMPOSSIBLE)]
        lines, moving = [], [names[j] for j in np.flatnonzero(np.isfinite(self.minimum_velocity))]
        if 2 * len(moving) < len(names) and not self.unexcited:
            lines.append(f"no joint but {listed(moving)} moves. {MOVE_ALL}")
        if self.unexcited:
            lines.append(self.unexcited)
        elif self.data.Z is None:  # otherwise residuals contain the noise of the positions
            lines += unexplained_text(names, left)
        named = likely_text(self.causes)
        if lines or named:  # which look like a joint at another position
            lines += locked_text(self.notes, ": ", "that is the cause: ")
        lines += named
        were_sought = not self.unexcited and NOT_SOUGHT not in self.notes and self.data.Z is None
        if were_sought and any(all(cause.removed[j] < thresholds.EXPLAINS for cause in self.causes) for j in poor):
            lines.append(UNKNOWN)
        lines += [note for note in self.notes if note.startswith(NOT_CONSISTENT)]
        hint = [note for note in self.notes if impossible and note.endswith(WRONG_SIGN)]
        return ". ".join([*lines, *impossible, *hint])

    @cached_property
    def unexcited(self) -> str:
        """Warning of an uninformative motion: parts of the log are fitted but not predicted from the others."""
        are_fitted = self.equations.shares(self.parameters) < thresholds.UNEXPLAINED
        far = are_fitted & (self.unexplained.in_motion > thresholds.TOO_FAR)
        if not far.any():
            return ""
        names = listed([name for name, is_far in zip(self.initial.joint_names, far, strict=True) if is_far])
        return (
            f"the motion excites too little: {int((~self.excited).sum())} of {self.base.count} base parameters have "
            "standard errors above their expected sizes, and fits to parts of the log do not predict the others "
            f"({names}). {MOVE_ALL}"
        )

    @property
    def records(self) -> tuple[Prepared, ...]:
        """Filtered measurements."""
        return self.data.prepared

    @property
    def equations(self) -> Equations:
        """Fitted equations."""
        return self.data.fitted

    @property
    def minimum_velocity(self) -> Array:
        """Velocities below which the equations of a joint were not fitted, shape (n,) [rad/s or m/s]."""
        return self.data.minimum_velocity

    @property
    def values(self) -> Array:
        """Base parameters of `parameters`, in the order of `base.names`, shape (base.count,)."""
        return np.asarray(self.base.matrix @ self.parameters)

    @property
    def excited(self) -> Array:
        """True for base parameters determined better than their expected size, (base.count,).

        Expected sizes are those of the bodies found, if they are consistent, otherwise of the given robot's; of rotors
        and friction such that they take a tenth of the torque. Bodies without any mass are of unknown size.
        """
        model = self.initial.model
        if self.consistent:
            P = pseudo_inertia(self.parameters[self.standard.groups["bodies"]])
        else:
            P = model_prior(self.initial)[0] if model.mass.any() else np.full((model.nb, 4, 4), np.inf)
        return np.asarray(self.estimate.errors < expected_sizes(P, self.base, self.equations))

    @cached_property
    def robot(self) -> Robot:
        """Robot with the bodies found, `armature` from the rotors, and `damping` and `friction` of its joints.

        Its methods are without friction and offsets; those of `scene` have them.

        Raises
        ------
        IdentificationError
            If a body is not possible or friction is negative, after a fit that is not physically consistent.
        """
        self._check_consistent()
        try:
            model = with_parameters(self.initial.model, self.parameters[self.standard.groups["bodies"]])
        except ValueError as error:
            raise IdentificationError(f"least squares gave no possible bodies: {self._cure}; {error}") from None
        rotors, damping, friction = drives = np.zeros((3, model.nb))  # zero for joints that mimic others
        both = (np.asarray(self.friction.viscous) + np.asarray(self.friction.viscous_back)) / 2
        drives[:, list(model.independent_joints)] = [self._of_drives("Ia"), both, self._of_drives("Fc")]
        return Robot(replace(model, armature=rotors, damping=damping, friction=friction), self.initial.engine)

    @property
    def friction(self) -> Friction:
        """Friction and offsets of the drives, for a Scene; zero where they were not asked for.

        Its `smoothing` is that of the fit; where the fit had a step, sign(qd), the one of 0.001, 0.003 and 0.01
        with which the measured torques are predicted best.
        """
        from ..simulation.friction import Friction

        self._check_consistent()
        viscous, asked, drives = self._of_drives("Fv"), self.standard.asked, self.standard.drives
        sizes = {"coulomb": "Fc", "stribeck_rise": "Fs", "load": "Fl", "offset": "tau0"}
        found: dict[str, Any] = {name: self._of_drives(symbol) for name, symbol in sizes.items()}
        found |= {"viscous": viscous, "viscous_back": np.where(asked["Fvb"], self._of_drives("Fvb"), viscous)}
        found |= {"stribeck": drives.stribeck, "saturation": drives.saturation}
        try:
            return Friction(smoothing=self._law.smoothing, **found)
        except ValueError as error:
            raise IdentificationError(f"the fit gave no possible friction: {self._cure}; {error}") from None

    def scene(self, **parts: Any) -> Scene:
        """Scene of the identified robot, with friction and offsets of its drives, and springs, as for `predict`.

        Parameters
        ----------
        **parts
            Further parts of `rne.Scene`, such as `payload` or `controller`; one that is given takes the place of the
            one found, as `friction=replace(found.friction, smoothing=0)` for friction that sticks.

        Returns
        -------
        Scene
            For simulation; its inverse dynamics are those of `predict`.

        Raises
        ------
        IdentificationError
            As for `robot` and `springs`, and of a fit with coupled motors, which a Scene does not have.

        Examples
        --------
        >>> import numpy as np, rne
        >>> arm = rne.load("irb140").locked({"joint_4": 0, "joint_5": 0, "joint_6": 0})
        >>> t, w = np.arange(0, 10, 0.01), 2 * np.pi * np.array([0.3, 0.4, 0.5])
        >>> q, qd, qdd = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
        >>> record = rne.identification.Record(t, q, arm.inverse_dynamics(q, qd, qdd) + 5 * qd)
        >>> found = rne.identify(arm, record, drives=rne.DriveModel(friction="viscous"), consistent=False)
        >>> found.scene(payload=2.0).friction.viscous.round(2).tolist()
        [5.0, 5.0, 5.0]
        """
        from ..simulation.scene import Scene

        if len(self.standard.motors):
            raise IdentificationError("a scene has no coupled motors: use `predict` for the torques of the drives")
        drives: dict[str, Any] = {"friction": self.friction, "springs": self.springs}
        return Scene(self.robot, **(drives | parts))

    def to_urdf(self) -> str:
        """URDF of the identified robot: bodies, rotors, and `<dynamics>` with viscous and Coulomb friction.

        Returns
        -------
        str
            Torques of the drives that a URDF has no element for, such as offsets, are in a comment.

        Raises
        ------
        IdentificationError
            As for `robot`.
        """
        from ..urdf.write import to_urdf

        model, values = self.robot.model, zip(self.standard.names, self.parameters, strict=True)
        parts = re.compile("(Fvb|Fs|Fl|tau0)_|.*_s")  # of drives, coupled motors and springs
        others = ", ".join(f"{name} {x:.6g}" for name, x in values if x and parts.match(name))
        note = f"identified, of the joints {listed(model.joint_names)}, not in this file: {others}" if others else ""
        return to_urdf(with_note(model, note))

    def essential(self, limit: float = thresholds.ESSENTIAL) -> Identification:
        """Model of only the essential parameters, the base parameters that the log determines well.

        The base parameter of the largest relative standard error is set to zero and the others are fitted again, by
        least squares with the noise of the joints as it is, until no relative standard error is above the limit.

        Parameters
        ----------
        limit : float
            Largest relative standard error of a base parameter that is kept.

        Returns
        -------
        Identification
            Of fewer base parameters; its `unexplained` has their validation errors.

        Raises
        ------
        ValueError
            If `limit` is not positive.

        Notes
        -----
        Pressé and Gautier 1991; Gautier, Janot and Vandanjon 2013, section III.
        """
        positive_number("limit", limit)
        springs = self.standard.groups.get("springs", slice(0))  # the last ones, which are kept
        kept, every = list(range(self.base.count)), self.equations.merged().mapped(self.base.back)
        while True:
            places = [*range(every.instruments), *(every.instruments + k for k in kept), -1]
            equations = replace(every, factors=every.factors[..., places])
            solution = solve(equations.weighted(self.estimate.sigma))
            x, unknown = solution.x, np.where(solution.free, np.inf, 0.0)
            found = replace(self.estimate, values=x, errors=unknown, covariance=np.zeros((len(kept), len(kept))))
            found = with_correlation(found, equations, self.correlation_time)
            relative = found.errors / np.maximum(np.abs(x), thresholds.TINY)
            relative = relative[: len(kept) - (springs.stop - (springs.start or 0))]
            if relative.max(initial=0) <= limit:
                break
            kept.pop(int(relative.argmax()))
        names = tuple(self.base.independent[k] for k in kept)
        base = replace(self.base, independent=names, matrix=self.base.matrix[kept])
        others = self.standard.values - self.base.back @ self.base.values  # of which torques do not depend
        left = held_out(Estimator(base, None, 0.0, others), self.equations, self.data.measured)
        reduced = replace(self, base=base, estimate=found, unexplained=left, consistent=False)
        reduced = replace(reduced, notes=(*self.notes, *[ESSENTIAL] * (ESSENTIAL not in self.notes)))
        drift, error = self.drift[kept], self.drift_error[kept]
        return replace(reduced, parameters=others + base.back @ x, drift=drift, drift_error=error)

    @property
    def _cure(self) -> str:
        if self.consistent or any(note.startswith(NOT_CONSISTENT) for note in self.notes):
            return "correct what `causes` name first"
        return "use those of the fit of all parameters" if ESSENTIAL in self.notes else "fit with `consistent=True`"

    def _check_consistent(self) -> None:
        """Raise an IdentificationError if least squares gave a negative mass, rotor inertia or friction."""
        symbols, values = ("m", "Ia", "Fv", "Fvb", "Fc", "Fl"), zip(self.standard.names, self.parameters, strict=True)
        negative = [name for name, x in values if x < 0 and name.split("_")[0] in symbols]
        if negative and not self.consistent:
            text = f"least squares gave negative values of {listed(negative)}: {self._cure}"
            raise IdentificationError(f"{text}; `estimate` has them as they are")

    @property
    def springs(self) -> tuple[Spring | JointSpring, ...]:
        """Springs that were asked for, with the stiffness and length found, for a Scene.

        Raises
        ------
        IdentificationError
            If a number is negative or not identifiable.
        """
        if self.standard.springs is None:
            return ()
        place = self.standard.groups["springs"]
        rows = zip(self.base.names, self.values, self.estimate.errors, strict=True)
        for name, value, error in list(rows)[place.start - place.stop :]:
            if np.isinf(error):
                raise IdentificationError(f"{name} cannot be identified: it has no effect, or that of other parameters")
            if value < 0 and name.startswith("k"):
                raise IdentificationError(f"the stiffness {name} comes out negative, {value:.4g}: {self._cure}")
        springs: Springs = self.standard.springs
        return springs.at(self.parameters[place])

    @property
    def spring_errors(self) -> Array:
        """Standard errors of stiffness and length of each of `springs`; NaN for a length that is not found, (k, 2)."""
        from ..simulation.springs import Spring

        found, errors = self.springs, np.full((len(self.springs), 2), np.nan)
        place, covariance = self.base.count, self.estimate.covariance
        for row, spring in zip(errors[::-1], found[::-1], strict=True):
            place -= (count := len(spring.symbols))
            C = covariance[place : place + count, place : place + count]
            row[0] = np.sqrt(C[0, 0])
            if isinstance(spring, Spring) and spring.length:  # (c - force) / k
                slope = np.array([-spring.length, 1.0]) / spring.stiffness
                row[1] = np.sqrt(slope @ C @ slope)
        return errors

    @property
    def offset(self) -> Array:
        """Constant torques of the drives, shape (n,); zero where they were not asked for [N m or N]."""
        return self._of_drives("tau0")

    def _of_drives(self, symbol: str) -> Array:
        place = self.standard.groups.get(symbol)
        return np.zeros(self.initial.n) if place is None else self.parameters[place]

    @overload
    def predict(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, std: Literal[False] = False) -> Array: ...

    @overload
    def predict(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, std: Literal[True]) -> tuple[Array, Array]: ...

    def predict(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, std: bool = False) -> Array | tuple[Array, Array]:
        """Torques of the drives along a motion.

        Parameters
        ----------
        q, qd, qdd : array_like, shape (..., n)
            Joint positions, velocities and accelerations [rad or m; rad/s or m/s; rad/s^2 or m/s^2].
        std : bool
            True for standard deviations of measured torques about these, too.

        Returns
        -------
        torques : ndarray, shape (..., n)
            With rotors, friction, offsets, coupled motors and springs; the direction of friction is smoothed as in
            `scene`, whose inverse dynamics are the same [N m or N].
        deviations : ndarray, shape (..., n), with `std` only
            Infinite where a torque depends on parameters, or is of a joint, that the log says nothing of; 1.96 times
            these are a band for 95 % of the torques that `check` compares, which have passed the filter [N m or N].

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite.

        Notes
        -----
        The variance is y C y^T + s^2: of the parameters, with the torque's row y of the regressor of the base
        parameters and C = `estimate.covariance`, and of the residuals. C is that of least squares, for a
        physically consistent fit too, so that no band is narrow because of the prior; it contains the correlation of
        the residuals, and errors of delays and Stribeck velocities that were estimated, not of the smoothing, and of
        friction under load only that of its coefficient. s is of residuals of validation blocks, with other
        periods of the same motion, less the parameters' part, for each joint in motion, and at rest, below
        `minimum_velocity`, where friction has any value up to that of Coulomb, the Stribeck effect and the load: if the
        joint hardly rests in the log, its square is added to s^2. Neighbouring torques err alike, over
        `correlation_time`.
        """
        Y, bodies = self.initial.regressor(q, qd, qdd), PARAMETERS * self.initial.model.nb
        at, velocities, accelerations = (np.asarray(x) for x in (q, qd, qdd))
        load = self._law.load(Y, at, accelerations, self.parameters)
        drives = self._law.drive_torques(velocities, accelerations, self.parameters[bodies:], load)
        torques = np.asarray(Y @ self.parameters[:bodies] + drives + self._law.spring_torques(at, self.parameters))
        return (torques, self._std(at, velocities, accelerations)) if std else torques

    def _std(self, q: Array, qd: Array, qdd: Array, speed: Array | None = None) -> Array:
        """Standard deviations of torques; `speed`, by default |qd|, decides on motion or rest."""
        q, qd, qdd = np.broadcast_arrays(q, qd, qdd)
        Y = self.initial.regressor(q, qd, qdd)
        load = self._law.load(Y, q, qdd, self.parameters)
        columns = np.concatenate([Y, self._law.drive_columns(qd, qdd, load), self._law.spring_columns(q)], axis=-1)
        return self.bands.std(columns, np.abs(qd) if speed is None else speed, load)

    def kernel(self, *, std: bool = False) -> Kernel:
        """Kernel of the torques of `predict`, which prints C by ``source("c")``, or other languages.

        Parameters
        ----------
        std : bool
            True for standard deviations as a second row.

        Returns
        -------
        Kernel
            Of q, qd and qdd; gives torques (..., n), with `std` torques and deviations (..., 2, n) [N m or N].

        Raises
        ------
        IdentificationError
            If a deviation is infinite: the log leaves parameters, or a joint, undetermined; or with springs.
        """
        bands, law, x = self.bands, self._law, self.parameters
        if self.standard.springs is not None:
            raise IdentificationError("springs are not written out: use `predict`, or `scene` for the equations")
        if std and (bands.unknown.size or not np.isfinite(bands.in_motion).all()):
            text = "the log does not determine all parameters, and deviations may be infinite"
            raise IdentificationError(f"{text}: {MOVE_ALL}")

        def prediction(q: Array, qd: Array, qdd: Array) -> Array:
            Y = self.initial.regressor(q, qd, qdd)
            load = law.load(Y, q, qdd, x)
            columns = np.concatenate([Y, law.drive_columns(qd, qdd, load)], axis=-1)
            return np.stack([columns @ x, bands.written(columns, qd, load)]) if std else np.asarray(columns @ x)

        marked: Any = prediction
        marked.traceable = True
        return self.initial.kernel(marked)

    @cached_property
    def bands(self) -> Bands:
        """Components of the standard deviations of predicted torques."""
        coulomb, rise, of_load = (np.maximum(self._of_drives(symbol), 0) for symbol in ("Fc", "Fs", "Fl"))
        return bands_of(self.base, self.data, self.estimate, self.correlation_time, (coulomb + rise, of_load))

    def draws(self, count: int, seed: int = 0) -> dict[str, Array]:
        """Random numbers of `scene` distributed as the estimates, for `numbers` of `rne.ensemble`.

        Parameters
        ----------
        count, seed : int
            Number N of draws, and the seed of their random numbers.

        Returns
        -------
        dict of str to ndarray, shape (N, ...)
            "parameters" of possible bodies (N, 10 nb), "armature", "friction.viscous" and so on, as `Scene.numbers`
            names them, those that were found.

        Raises
        ------
        ValueError
            If `count` is not a positive integer.
        IdentificationError
            As for `scene`, and if the bodies found are not possible ones, as least squares may leave them, or fewer
            than one trial in twenty gives possible bodies.

        Warns
        -----
        IdentificationWarning
            If `prior_std` is None: 0.3 is taken.

        Notes
        -----
        The posterior of the linear model about the parameters found: base parameters vary by `estimate.covariance`, and
        what the log does not determine by the prior, `prior_std` relative to the bodies found (Laplace's approximation
        with the second derivatives of the divergence). Where bodies would not be possible, the part that torques do not
        depend on is shortened; trials that then are none are left out. Negative inertias of rotors and friction are set
        to zero. Residuals, such as by friction beyond the model, are not contained: they are in those of `predict`.
        """
        scene, x, base, std = self.scene(), self.parameters, self.base, self.prior_std
        if std is None:
            std = thresholds.PRIOR_STD
            text = f"draws take a prior_std of {std:g}: the file does not say that of the fit, which "
            warnings.warn(f"{text}dataclasses.replace(found, prior_std=...) sets", IdentificationWarning, stacklevel=2)
        bodies, names = self.standard.groups["bodies"], self.standard.names
        drives = np.zeros(len(x) - bodies.stop)
        for k, error in zip(base.independent, self.estimate.errors, strict=True):
            if k >= bodies.stop and np.isfinite(error):
                drives[k - bodies.stop] = thresholds.WIDE * error
        scale = prior_scale(x[bodies], std, drives, self._cure)
        known, root = self.bands.known @ base.matrix, self.bands.known @ self.bands.root
        found = possible_draws(x, scale, bodies, known, root, count, seed)
        bounded = [k for k in range(bodies.stop, len(x)) if not names[k].startswith(("tau0", "c_"))]
        found[:, bounded] = np.maximum(found[:, bounded], 0)
        law = self._law
        each = [replace(self, standard=law, parameters=own).scene().numbers for own in found]
        numbers = {name: np.array([own[name] for own in each]) for name in scene.numbers}
        return {name: x for name, x in numbers.items() if (x != scene.numbers[name]).any()}

    @cached_property
    def _law(self) -> StandardParameters:
        """Friction of the drives for simulation: steps of the fit are smoothed as in the logs."""
        if self.standard.smoothing:
            return self.standard
        smoothed = [replace(self.standard.drives, smoothing=s) for s in thresholds.SMOOTHINGS]
        laws = [replace(self.standard, drives=drives) for drives in smoothed]
        if "Fc" not in self.standard.terms:
            return laws[-1]
        bodies, left = PARAMETERS * self.initial.model.nb, np.zeros(len(laws))
        for record in self.data.prepared:
            some = slice(None, None, 1 + len(record.t) // thresholds.SAMPLES)
            q, qd, qdd, tau = (x[some] for x in (record.q, record.qd, record.qdd, record.tau))
            Y = self.initial.regressor(q, qd, qdd)
            rest = tau - Y @ self.parameters[:bodies] - self.standard.spring_torques(q, self.parameters)
            for k, law in enumerate(laws):
                load = law.load(Y, q, qdd, self.parameters)
                off = rest - law.drive_torques(qd, qdd, self.parameters[bodies:], load)
                left[k] += np.where(record.usable[some], (off / self.estimate.sigma) ** 2, 0.0).sum()
        return laws[int(left.argmin())]

    def check(self, record: Record) -> Check:
        """Validation on another measured motion: predicted and measured torques.

        Parameters
        ----------
        record : Record
            Of the same robot; it is filtered with the lowest cut-off of the fit, or a fifth of its sample rate if that
            is less, and its torques are assumed to have the mean delay of the fit's records. Torques of joints at rest
            count, which Coulomb friction does not determine.

        Returns
        -------
        Check
            Errors of each joint, a table and a plot of them.

        Raises
        ------
        TypeError
            If `record` is of another type.
        ValueError
            If the record has other joints, errors among its findings, or cannot be filtered so.
        """
        if not isinstance(record, Record):
            raise TypeError(f"`record` must be an rne.identification.Record, got {type(record).__name__}")
        record = by_number(record, self.initial.joint_names)
        if set(self.initial.joint_names) <= set(record.joint_names):
            record = record.part(slice(None), self.initial.joint_names)
        check_joints(self.initial, record, "record")
        cutoff = min(fitted.cutoff for fitted in self.records)
        prepared = record.prepare(min(cutoff, thresholds.HIGHEST_CUTOFF * record.sample_rate))
        return self._compared(record.name, delayed(prepared, self.delay.mean(0)))

    @property
    def _units(self) -> tuple[str, ...]:
        return tuple(units(self.initial, j)[1] for j in range(self.initial.n))

    def _compared(self, name: str, prepared: Prepared) -> Check:
        model, torques = self.initial.model, self.predict(prepared.q, prepared.qd, prepared.qdd)
        measured = prepared.qd, prepared.tau, torques, np.abs(prepared.qd)
        qd, tau, predicted, speed = map(prepared.reduce, measured)
        rests = np.isinf(self.minimum_velocity) & (np.ptp(prepared.q, axis=0) < thresholds.RESTS)  # as in the log
        q, v, a = (x[prepared.row_samples] for x in (prepared.q, prepared.qd * ~rests, prepared.qdd * ~rests))
        std = self._std(q, v, a, speed * ~rests)
        return Check(name, model.joint_names, self._units, prepared.times, qd, tau, predicted, prepared.valid, std)

    def plot(self) -> Figure:
        """Plot measured and predicted torque of the first record with a 95 % band, and their difference, by joint.

        Returns
        -------
        matplotlib.figure.Figure
            That of `check(record).plot()`; `figure.savefig("torques.png")` writes it to a file.
        """
        return self._compared(self.data.names[0], self.records[0]).plot()

    def consistency(self) -> Consistency:
        """Test of the measured torques for consistency with one rigid-body model.

        One set of parameters is fitted to all joints, and a separate set to each. Torques of a rigid body have the same
        residuals in both fits, up to chance. The masses of `initial` do not matter, only its joints and their places.

        Returns
        -------
        Consistency
            The verdict, and the numbers of each joint on which it is based.

        Notes
        -----
        The test is that of Draper and Smith 1998, section 6.1, with the number of equations divided by the correlation
        time of the residuals of the joint's own fit.

        Examples
        --------
        >>> import numpy as np, rne
        >>> arm = rne.load("irb140").locked({"joint_4": 0, "joint_5": 0, "joint_6": 0})
        >>> t, w = np.arange(0, 10, 0.004), 2 * np.pi * np.array([0.3, 0.4, 0.5])
        >>> q, qd, qdd = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
        >>> record = rne.identification.Record(t, q, arm.inverse_dynamics(q, qd, qdd))
        >>> verdict = rne.identify(arm, record, consistent=False).consistency()
        >>> verdict.one_model, bool(verdict.energy.missing < 0.01)
        (True, True)
        >>> verdict.report().startswith("one rigid-body model explains the torques")
        True
        """
        return certified(self.base, self.data, self.unexplained.in_motion)

    @cached_array
    def r_squared(self) -> Array:
        """Coefficient of determination of each joint's validated torques in motion, NaN without any, (n,)."""
        size, used = self.equations.rms_torques(), self.data.used
        mean = (self.data.tau * used).sum(0) / np.maximum(used.sum(0), 1)
        variance = np.maximum(size**2 - mean**2, thresholds.TINY)
        return np.asarray(1 - (self.unexplained.in_motion * size) ** 2 / variance)

    @cached_property
    def bias(self) -> Bias | None:
        """Test of least squares for a bias by noise in the feedback, by the instruments; None without these."""
        if self.data.Z is None:
            return None
        return bias_of_least_squares(self.estimate, self.equations.mapped(self.base.back), self.correlation_time)

    @property
    def verdict(self) -> str:
        """Verdict on the use of the model, in one sentence, with the joints whose validation error exceeds 15 %.

        Errors are those below the cut-off of the filter; above it, they may be many times larger.
        """
        names, left = self.initial.joint_names, self.unexplained.in_motion
        good = left <= thresholds.EXPLAINED
        use = "simulation and feed-forward" if self.consistent else "feed-forward, not simulation (least squares alone)"
        below = f"below {min(record.cutoff for record in self.records):.3g} Hz"
        other = ", ".join(f"{short(names[j])} ({self._why_not(j)})" for j in np.flatnonzero(~good).tolist())
        first = [note for note in self.notes if note.startswith((BEYOND, EARLY))] + self._far_from_given
        if self.data.Z is not None and not self.unexcited:
            text = "by instrumental variables; validation errors contain the noise of the positions"
            return "; ".join([*first, f"{text}{f': {other}' if other else ''}"])
        if self.unexcited or not good.any():
            why = self.unexcited or f"validation errors while moving {below}: {other}"
            return "; ".join([*first, f"not good for simulation or feed-forward: {why}"])
        remarks = [note for note in self.notes if note.startswith((LOCKED, MOVING))]
        which = listed([names[j] for j in np.flatnonzero(good)])
        if not other:
            which = "all joints" + " of the records" * any(note.startswith(LOCKED) for note in remarks)
        known = f"validation errors while moving of {100 * left[good].max():.2g} % or less"
        parts = [f"good for {use} of {which} {below}: {known}", *[f"not known: {other}"] * bool(other)]
        text = "; ".join(parts if 2 * good.sum() > len(good) else parts[::-1])
        if unknown := int(np.isinf(self.estimate.errors).sum()):
            which = f"{unknown} of {self.base.count} base parameters"
            remarks.append(f"{which} are not determined: other motions may differ")
        if any(cause.kind not in GEARS for cause in self.causes):
            remarks.append("a likely cause of the residuals is named below: if it applies, the model is wrong there")
        return "; ".join([*first, text, *remarks])

    def _why_not(self, j: int) -> str:
        """Reason why a joint is not predicted, for the verdict."""
        left, start = self.unexplained.in_motion[j], f"{self.initial.joint_names[j]} {NO_TORQUE}"
        if not np.isnan(left):
            return f"{100 * min(left, thresholds.FARTHEST_TOLD):.0f} %"
        silent = [note.removeprefix(start) for note in self.notes if note.startswith(start)]
        return f"its torque cannot be used{silent[0]}" if silent else "does not move"

    @property
    def _far_from_given(self) -> list[str]:
        """Doubt about units, where most masses are several times those of the given robot, or a fraction."""
        given, found = self.initial.model.mass, self.parameters[: PARAMETERS * self.initial.model.nb : PARAMETERS]
        known = given > 0
        ratio = float(np.median(found[known] / given[known])) if self.consistent and known.any() else 1.0
        is_near = 1 / thresholds.FAR_FROM_GIVEN < ratio < thresholds.FAR_FROM_GIVEN
        text = f"masses are {ratio:.2g} times those of the robot given (median): are the units of the log right?"
        return [] if is_near else [text]

    @cached_property
    def _essential(self) -> str:
        """Text on the number of essential base parameters, and the effect of the others on the validation error."""
        few, count = self.essential(), counted(self.base.count, "base parameter")
        if not few.base.count:
            return f"none of {count} is essential: the torques carry no information on the motion"
        if few.base.count == self.base.count:
            return f"all of {count} are essential"
        by_others = 100 * (self.unexplained.in_motion - few.unexplained.in_motion)
        less, more = (f"{np.nanmax(x, initial=0):.1f}" for x in (-by_others, by_others))
        changes = [f"reduce the validation error by up to {less} %"] * bool(float(less))
        changes += [f"raise {'it' if changes else 'the validation error'} by up to {more} %"] * bool(float(more))
        effect = " and ".join(changes) or "change the validation error by < 0.05 %"
        return f"{few.base.count} of {count} suffice, the others {effect}"

    def report(self, *, details: bool = False) -> str:
        """Text on the measurements, the parameters, and the quality of the fit.

        Parameters
        ----------
        details : bool
            True for all of it: filters, base parameters, bodies, and the report of `consistency`.

        Returns
        -------
        str
            First what the model is good for, then the errors of each joint, likely causes of the residuals and how many
            parameters suffice, in at most 40 lines without details.
        """
        if details:
            further = [springs_text] * (self.standard.springs is not None) + [bodies_text] * self.consistent
            told = [text(self) for text in (fitted_text, joints_text, causes_text, parameters_text, *further)]
            told = [self.verdict, *bias_text(self), *told, self.bands.text(self.initial.joint_names, self._units)]
            return "\n\n".join([*told, self._essential, self.consistency().report()])
        parts = [first_of(text(self), most) for text, most in SHORT.items()]
        parts += [self.bands.text(self.initial.joint_names, self._units), self._essential]
        parts = [self.verdict, *bias_text(self), *parts, wrapped(self.consistency().verdict)]
        return "\n".join([*parts, MORE])

    def _whole(self) -> str:
        return self.report(details=True)


def with_note(model: Model, note: str) -> Model:
    """Model with a further note on the robot, for a comment in its file."""
    notes = filter(None, (model.notes.get("robot"), note))
    return replace(model, notes=dict(model.notes) | {"robot": "; ".join(notes)})


def first_of(text: str, most: int) -> str:
    """First lines of a text, followed by the number of omitted ones."""
    lines = text.split("\n")
    more = [f"  ... {len(lines) - most + 1} more lines"] if len(lines) > most > 1 else []
    return "\n".join([*lines[: most - len(more)], *more])


def bias_text(found: Identification) -> list[str]:
    """Text on the bias of least squares, if instruments are given."""
    if found.bias is None:
        return []
    test = f"Durbin-Wu-Hausman p = {found.bias.probability:.2g}"
    if found.bias.probability > thresholds.BIASED:
        return [f"noise that is fed back does not bias least squares by more than chance ({test})"]
    far = np.abs(found.bias.shift) / np.maximum(found.bias.errors, thresholds.TINY)
    k = int(np.nanargmax(far))
    text = f"least squares is biased by noise that is fed back ({test}), by up to {far[k]:.2g} of its standard errors"
    return [f"{text} ({found.base.names[k]})" + ": use these estimates, by instrumental variables" * bool(far[k] > 1)]


def unexplained_text(names: Sequence[str], in_motion: Array) -> list[str]:
    """Text on joints with large validation errors in motion, if any."""
    shares = zip(names, in_motion, strict=True)
    poor = [f"{name} {100 * x:.0f} %" for name, x in shares if x > thresholds.UNEXPLAINED]
    return [f"torques in motion that the model does not explain: {listed(poor)}"] * bool(poor)


def likely_text(causes: Sequence[Cause]) -> list[str]:
    """Text on the likeliest causes, other than the usual friction of gears, if any."""
    told = [cause for cause in causes if cause.kind not in GEARS][:NAMED]
    texts = [f"{cause.text} (validation error {cause.effect})" if cause.effect else cause.text for cause in told]
    first = "likely causes" if len(texts) > 1 else "the likely cause"
    return [f"{first}: {'; '.join(texts)}"] * bool(texts)


def fitted_text(found: Identification) -> str:
    """Text on the motions, their filter and the prior."""
    e = found.estimate
    lines = [
        f"{counted(found.base.count, 'base parameter')} of {short(found.initial.model.name)} from "
        f"{counted(int(found.equations.rows.sum()), 'equation')}, condition number {e.condition:.3g} "
        f"({e.scaled_condition:.3g} with columns of unit length)"
    ]
    for name, record in zip(found.data.names, found.records, strict=True):
        lines.append(f"motion {short(name)}: {len(record.t) / record.sample_rate:.3g} s at {record.sample_rate:.6g} Hz")
        lines += [f"  {note}" for note in (f"decimated by {record.decimation} after the filter", *record.notes)]
    return "\n".join([*lines, *(note for note in found.notes if note != NOT_SOUGHT)])


def joints_text(found: Identification) -> str:
    """Table of the errors of each joint."""
    columns = ["validation: moving", "[N m or N]", "R^2", "at rest", "fitted"]
    columns += ["noise [N m or N]", "equations", "independent"]
    left, counts = found.unexplained, found.equations.rows.sum(0)
    fitted = np.where(np.isnan(left.everywhere), np.nan, found.equations.shares(found.parameters))
    in_torque = left.in_motion * found.equations.rms_torques()
    motion, rest, fit = (
        ["> 1000" if x >= thresholds.FARTHEST_TOLD else cell for x, cell in zip(share, cells, strict=True)]
        for share in (left.in_motion, left.at_rest, fitted)
        for cells in [column(100 * share, ".1f", "-")]
    )
    cells = motion, column(in_torque, ".4g", "-"), column(found.r_squared, ".4f", "-"), rest, fit
    numbers = column(found.estimate.sigma, ".4g"), column(counts, "d"), column(counts / found.correlation_time, ".0f")
    rows = table("errors [%]", columns, found.initial.joint_names, *cells, *numbers, indent="  ")
    close = (
        f"Validation: each of {len(found.equations.factors)} blocks of the log, predicted by a fit to the others. "
        "At rest: torques of slow joints, which are not fitted because Coulomb friction then has no known direction."
    )
    return "\n".join([*rows, close, *motions_text(found)])


def causes_text(found: Identification) -> str:
    """Text on unexplained joints and causes of the residuals, the likeliest first."""
    if found.unexcited:
        return found.unexcited
    if found.data.Z is not None:
        return "causes of the residuals, other than delays, are not searched for with instruments"
    lines: list[str] = []
    for j, (name, left) in enumerate(zip(found.initial.joint_names, found.unexplained.in_motion, strict=True)):
        if left > thresholds.EXPLAINED:
            own = [cause.text for cause in found.causes if cause.removed[j] > thresholds.EXPLAINS]
            if not own and NOT_SOUGHT not in found.notes:
                own = ["no single change of the log, the robot or the drives explains it"]
            why = "".join(f": {text}" for text in own[:1])
            lines.append(f"  {short(name)} {100 * left:.0f} % while moving{why}")
    lines = ["not explained", *lines] if lines else []
    if found.causes:
        lines.append("likely causes of the residuals, validation error before -> after")
        lines += [f"  {cause.text}{f': {cause.effect}' * bool(cause.effect)}" for cause in found.causes]
    if NOT_SOUGHT in found.notes:
        lines.append(NOT_SOUGHT)
    elif not lines and np.nanmax(found.unexplained.in_motion, initial=0) > thresholds.LITTLE:
        lines = ["no single change of the log, the robot or the drives that was tried reduces the validation error"]
    return "\n".join(lines or ["residuals are small: no change of the log, the robot or the drives is needed"])


def motions_text(found: Identification) -> list[str]:
    """Table of the errors of each motion, if there are several."""
    if len(found.records) == 1:
        return []
    parts = np.split(np.arange(len(found.equations.factors)), len(found.records))
    shares = np.array([found.equations.of_blocks(part).shares(found.parameters) for part in parts])
    joints, cells = list(map(short, found.initial.joint_names)), (column(100 * x, ".1f") for x in shares.T)
    return table("errors of each motion [%]", joints, found.data.names, *cells, indent="  ")


def parameters_text(found: Identification) -> str:
    """Table of base parameters with standard errors."""
    e = found.estimate
    title = ["least squares", "standard error", "of the value [%]", "drift", "its error"]
    title += ["consistent"] * found.consistent
    joints = ", ".join(f"{k} {short(name)}" for k, name in enumerate(found.initial.model.moving_joints, 1))
    relative = 100 * e.errors / np.maximum(np.abs(e.values), thresholds.TINY)
    shares = column(np.where(relative < thresholds.UNKNOWN_VALUE, relative, np.nan), ".2g", "-")
    numbers = found.drift, found.drift_error, *[found.values] * found.consistent
    cells = column(e.values, ".5f"), column(e.errors, ".5f"), shares, *(column(x, ".5f", "-") for x in numbers)
    lines = [
        *table("base parameters", title, found.base.names, *cells, indent="  "),
        f"Numbers are those of the joints: {joints}. {BASE_UNITS} A dash for a share: not "
        "significant. Drift is the change with half the cut-off, to be compared with its own standard error.",
    ]
    combined = [text for name, text in zip(found.base.names, found.base.formulas, strict=True) if text != name]
    if combined:
        lines += ["Base parameters that stand for a combination of several:", *(f"  {text}" for text in combined)]
    moved = [found.base.names[k] for k in np.flatnonzero(np.abs(found.drift) > thresholds.MOVED * found.drift_error)]
    if moved:
        lines.append(
            f"drift, the change with half the cut-off, beyond three standard errors: {', '.join(moved)}; one of the "
            "two cut-offs biases these, or something else changes with frequency"
        )
    weak = [name for name, seen in zip(found.base.names, found.excited, strict=True) if not seen]
    if weak:
        lines.append(f"not excited, with a standard error above the expected size: {', '.join(weak)}")
    return "\n".join(lines)


def springs_text(found: Identification) -> str:
    """Text on stiffness and length of the springs with standard errors."""
    from ..simulation.springs import Spring

    try:
        pairs = zip(found.springs, found.spring_errors, strict=True)
    except IdentificationError as error:
        return f"springs: {error}"
    lines = ["springs, with standard errors; k is the stiffness, c is k length + force [N]"]
    for spring, (of_stiffness, of_length) in pairs:
        text = f"  {spring}: stiffness {spring.stiffness:.5g} +- {of_stiffness:.2g}"
        if isinstance(spring, Spring):
            text += f" N/m, length {spring.length:.4g} +- {of_length:.2g} m, force {spring.force:.4g} N"
        lines.append(text if isinstance(spring, Spring) else f"{text} N m/rad, or N/m of a sliding joint")
    return "\n".join(lines)


SHORT = {fitted_text: 11, joints_text: 18, causes_text: 7}  # most lines of each part of a short report


def bodies_text(found: Identification) -> str:
    """Table of masses and centres of the consistent bodies; each is one of many with the same torques."""
    mass, *moments = found.parameters[found.standard.groups["bodies"]].reshape(-1, PARAMETERS).T[:4]
    titles, numbers = ("mass [kg]", "centre x [m]", "y", "z"), [mass, *(x / mass for x in moments)]
    cells = (column(x, ".4f") for x in numbers)
    rows = table("bodies", titles, found.initial.model.moving_joints, *cells, indent="  ")
    values = found.base.back @ found.estimate.values, found.parameters
    sigma = believed_noise(found.equations, found.estimate.sigma)
    free, consistent = ((found.equations.residuals(x) / sigma**2).sum() for x in values)
    growth = float(np.sqrt(consistent / max(free, found.equations.rows.sum())))
    shift = np.abs(found.values - found.estimate.values) / found.estimate.errors
    k = int(np.argmax(shift))
    worth = (
        "Torques do not determine single masses: of all bodies with nearly the same base parameters, these are the "
        f"nearest to the prior. It moves base parameters by up to {shift[k]:.1f} of their standard errors "
        f"({found.base.names[k]})."
    )
    if growth > thresholds.GROWTH:
        worth = (
            f"No possible bodies fit as least squares do: residuals are {growth:.3g} times larger. Signs, units and "
            "zeros of the measurements may be wrong, friction or rotors missing, or the prior too narrow (`prior_std`)."
        )
    return "\n".join([*rows, worth])
