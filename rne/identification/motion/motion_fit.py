"""Identification from commands and positions without torques: motions are simulated and the numbers fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...basics.archive import Archived, Kinds, names_of
from ...basics.arrays import positive_number, whole_number
from ...basics.inertia import PARAMETERS
from ...basics.spatial import Array
from ...basics.text import InNotebooks, column, counted, listed, short, table
from ...control import PID
from ...simulation.scene import Scene
from ...trajectories import sampled
from .. import thresholds
from ..diagnosis.hypotheses import Cause
from ..fit.consistent import consistent_fit, model_prior
from ..log.record import Record
from ..result import kinds as kinds_of_identifications
from ..result import with_note
from .certainty import Certainty, certainty
from .missing import missing_effects, mistaken_columns
from .output_error import FIRST, OutputError, Shot, columns_for, commands, joint_units, shots_of, states_of
from .solver import MotionSolver, fitted_starts, parts_of_folds, validation_errors
from .unknowns import Unknown, Unknowns, regrouped, rotors, unknowns_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def kinds() -> Kinds:
    """Classes that a saved fit consists of, with their fields."""
    from ... import control
    from ...simulation.elastic_joints import ElasticJoints
    from ...simulation.friction import Friction
    from ...simulation.scene import Payload

    def record(**fields: Any) -> Record:
        names = fields.pop("_given_names", None)
        return Record(fields.pop("t"), fields.pop("q"), joint_names=names, stamps="sampled", **fields)

    def friction(numbers: dict[str, Any]) -> Friction:
        return Friction(**numbers | {"smoothing": float(numbers["smoothing"])})

    def problem(unknowns: Unknowns, records: Any, shots: Any, sigma: Array, step: float) -> OutputError:
        return OutputError(unknowns, records, shots, sigma, step)

    plain = MotionFit, Certainty, Unknowns, Unknown, Shot, Scene, Payload, ElasticJoints, Friction
    laws = [x for x in map(partial(getattr, control), control.__all__) if isinstance(x, type) and is_dataclass(x)]
    found: Kinds = kinds_of_identifications() | {kind: (names_of(kind), kind) for kind in (*plain, *laws)}
    found[Friction] = (("numbers",), friction)  # directions that follow the other have none
    found[Record] = (("t", "q", "qd", "command", "command_rate", "command_hold", "name", "_given_names"), record)
    return found | {OutputError: (("unknowns", "records", "shots", "sigma", "step"), problem)}


@dataclass(frozen=True, eq=False)
class MotionFit(Archived, InNotebooks):
    """Numbers of a scene found from commands and positions, by `rne.identify_motion`.

    Attributes
    ----------
    problem : OutputError
        The residuals of the positions as a function of what was fitted.
    z : ndarray, shape (P + 2 n S,)
        Solution: P entries, positive ones by their logarithms, and the starts of S parts of the records.
    certainty : Certainty
        Standard errors, and what the log does not determine.
    resolution : ndarray, shape (n,)
        Standard deviation of the rounding of each encoder, or of the white noise of its positions if that is more
        [rad or m].
    validation_error : ndarray, shape (n,)
        Root mean square of the residual on folds of the records that were not fitted, but for starts of motions; NaN
        without `folds` [rad or m].
    causes : tuple of Cause
        Changes that would explain the residual better, the likeliest first.
    message : str
        How the fit ended.
    """

    problem: OutputError
    z: Array
    certainty: Certainty
    resolution: Array
    validation_error: Array
    causes: tuple[Cause, ...]
    message: str

    _kinds = staticmethod(kinds)

    @property
    def initial(self) -> Scene:
        """Scene as given."""
        return self.problem.unknowns.scene

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the P fitted entries, such as "controller.kp of joint_1"; for bodies regrouped parameters."""
        return self.problem.unknowns.labels

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the fitted entries."""
        return self.problem.unknowns.units

    @property
    def _x(self) -> Array:
        return self.z[: self.certainty.count]

    @cached_property
    def numbers(self) -> dict[str, Array]:
        """Fitted numbers by the names of `wrt`, in the shapes of `scene.numbers`."""
        return self.problem.unknowns.numbers(self._x)

    @cached_property
    def values(self) -> Array:
        """Values of the fitted entries, shape (P,)."""
        return self.problem.unknowns.entries(self._x)

    @cached_property
    def std(self) -> Array:
        """Standard errors of the values, shape (P,), for residuals correlated in time."""
        return np.asarray(self.certainty.std * self.problem.unknowns.slopes(self._x))

    @property
    def determined(self) -> Array:
        """False for entries that the allowed spread determines, not the log."""
        return self.certainty.determined

    @cached_property
    def rms(self) -> Array:
        """Root mean square of each joint's residual, shape (n,) [rad or m]."""
        return np.asarray(np.sqrt(np.nanmean(self.problem.misfits(self.z) ** 2, axis=0)))

    @cached_property
    def explained(self) -> Array:
        """True for joints whose residual is explained by the resolution of their positions."""
        loud = self.rms > thresholds.ABOVE_RESOLUTION * self.resolution
        far = self.rms > thresholds.FAR_ABOVE_RESOLUTION * self.resolution
        left = self.problem.misfits(self.z)
        correlated = self.problem.correlation_times(left[self.problem.measured]) > thresholds.WHITE
        return np.asarray(~(far | (loud & correlated)))

    @cached_property
    def alike(self) -> tuple[str, ...]:
        """Texts on combinations that the log does not determine, each with a remedy."""
        unknowns, names, sure, found = self.problem.unknowns, self.names, self.certainty, []
        of_each = [part.name for part in unknowns.parts for _ in part.labels]
        scaled = sure.scale(self.values, of_each, unknowns.is_log)
        if scaled is not None:
            remedy = "give a mass or a gain, by leaving it out of `wrt` or by `priors`"
            if "parameters" not in unknowns.places:
                remedy = (
                    "weight and inertia of the bodies, which are not fitted, are negligible beside the torques found; "
                    "check masses, gravity and the directions of the axes, or give a gain or a rotor"
                )
            found.append(f"all torques may be scaled together: {remedy}")
            sure = sure.given_scale(scaled)
        for group, free in sure.alike():
            which = [names[i] for i in group]
            if not free:
                found.append(f"{which[0]} is not determined: the motion hardly depends on it")
            elif len(which) == 1:
                found.append(f"{which[0]} acts as others together do: give it, or some of them")
            else:
                found.append(f"{listed(which)} act alike: give {free if free > 1 else 'one'} of them")
        return tuple(found)

    @property
    def verdict(self) -> str:
        """Verdict on the use of the model, in one sentence."""
        names, units = self.initial.resolved.robot.joint_names, joint_units(self.initial)
        worst = int(np.argmax(self.rms / self.resolution))
        error = f"{self.rms[worst]:.2g} {units[worst]} rms on {short(names[worst])}"
        sized = f"{error}, {self.rms[worst] / self.resolution[worst]:.1f} times its resolution"
        poor = [short(name) for name, good in zip(names, self.explained, strict=True) if not good]
        if poor:
            text = f"the model misses something: residuals of {listed(poor)} exceed the resolution ({sized})"
            text += "; standard errors account for their correlation in time, not for a bias"
        else:
            text = f"the model explains the positions to their resolution ({sized})"
            text += "; a small effect that is missing shifts numbers: see the likely cause" * bool(self.causes)
        count = int((~self.determined).sum())
        return text + f"; {count} of {counted(len(self.names), 'number')} not determined" * bool(count)

    def scene(self) -> Scene:
        """Scene with the fitted numbers.

        Bodies are the possible ones that are most like those given, among those with the regrouped parameters found.

        Returns
        -------
        Scene
            With the given controller, whose reference is not that of a record, and without the numbers of commands and
            sensors, which are in `numbers`.

        Raises
        ------
        IdentificationError
            If no possible bodies have such parameters.
        ImportError
            If bodies were fitted and Clarabel is not installed.
        """
        numbers = {name: self.numbers[name] for name in self.problem.unknowns.of_scene}
        if "parameters" in numbers:
            numbers["parameters"] = self._possible_bodies
        return self.initial.with_numbers(numbers)

    @cached_property
    def _possible_bodies(self) -> Array:
        """Standard parameters of physically consistent bodies, (10 nb,)."""
        robot, unknowns = self.initial.resolved.robot, self.problem.unknowns
        place, (_, matrix) = unknowns.places["parameters"], regrouped(robot)
        C = self.certainty.covariance[place, place]
        w, V = np.linalg.eigh(C)
        half = (V / np.sqrt(np.maximum(w, 1e-12 * w.max()))).T
        bodies = PARAMETERS * robot.model.nb
        held = matrix[:, bodies:] @ rotors(robot)
        factor = np.column_stack([half @ matrix[:, :bodies], half @ (self._x[place] - held)])
        prior, no_drives = model_prior(robot)[0], (np.zeros(0, bool), np.zeros(0))
        return consistent_fit(np.vstack([factor, 0 * factor[:1]]), prior, thresholds.PRIOR_STD**-2, *no_drives)

    def to_urdf(self) -> str:
        """URDF of the robot: bodies, and viscous and Coulomb friction as its joints' damping and friction.

        Returns
        -------
        str
            The file's text; gains, delays and others are in comments.
        """
        from ...urdf import to_urdf

        scene = self.scene()
        model, friction = scene.resolved.robot.model, scene.resolved.friction
        rest = {name: x for name, x in self.numbers.items() if name not in ("parameters", "armature")}
        text = ", ".join(f"{name} {np.array2string(x, precision=6, separator=', ')}" for name, x in rest.items())
        damping, coulomb = np.zeros((2, model.nb))
        if friction is not None:
            own = list(model.independent_joints)
            damping[own], coulomb[own] = np.asarray(friction.viscous), np.asarray(friction.coulomb)
        model = replace(model, damping=damping, friction=coulomb)
        return to_urdf(with_note(model, f"fitted: {text}" * bool(rest)))

    def predict(self, record: Record, *, std: bool = False) -> Any:
        """Predicted positions for a record's commands, from starts fitted to the record's positions.

        Parameters
        ----------
        record : Record
            With commands and positions.
        std : bool
            True for standard deviations of measured positions about them, too.

        Returns
        -------
        positions : ndarray, shape (T, n)
            At the record's times, NaN in gaps, and before the first command [rad or m].
        deviations : ndarray, shape (T, n)
            With `std`: of the numbers' errors and the residual together [rad or m].

        Raises
        ------
        ValueError
            If the record has no commands, not the scene's joints, or errors among its findings.
        """
        check_records(self.initial, (record,))
        clean, apart = record.on_grid(), 0.5 / record.sample_rate
        shots = shots_of(self.initial, (clean,), None, self.resolution)
        problem = replace(self.problem, records=(clean,), shots=shots, traced={})
        z = fitted_starts(problem, self._x)
        found = np.full((2, len(record.t), self.initial.n), np.nan)
        P = self.certainty.count
        for shot, (q, J) in zip(shots, problem.derivatives(z), strict=True):
            rows = (record.t > shot.t[0] - apart) & (record.t < shot.t[-1] + apart)
            of_numbers = np.einsum("tjp,pq,tjq->tj", J[..., :P], self.certainty.covariance, J[..., :P])
            found[:, rows] = at_times((q, np.sqrt(of_numbers + self.rms**2)), shot.t, record.t[rows])
        return (found[0], found[1]) if std else found[0]

    def report(self) -> str:
        """Text on the numbers, their errors, and the quality of the fit.

        Returns
        -------
        str
            The verdict, combinations that are not determined, likely causes of the residual, and two tables.
        """
        errors = column(np.where(self.determined, self.std, np.nan), ".2g", "not determined")
        cells = column(self.values, ".6g"), errors, self.units
        numbers = table("number", ("value", "standard error", "unit"), self.names, *cells, indent="  ")
        titles, names = (
            ("rms residual", "resolution", "validation error", "unit"),
            self.initial.resolved.robot.joint_names,
        )
        sizes = (column(x, ".3g", "-") for x in (self.rms, self.resolution, self.validation_error))
        joints = table("joint", titles, names, *sizes, joint_units(self.initial), indent="  ")
        likely = [f"likely cause: {cause.text}" for cause in self.causes[: thresholds.NAMED]]
        out = self.problem.unknowns.left_out
        unused = [f"not fitted, as they are zero: {listed(out)}"] * bool(out)
        rates = any(record.command_rate is not None for record in self.problem.records)
        unused += ["`command_rate` is not used: the controller follows positions"] * rates
        return "\n".join([self.verdict, *self.alike, *likely, *unused, *numbers, *joints, self.message])

    _whole = report

    def __repr__(self) -> str:
        numbers, records = counted(len(self.names), "number"), counted(len(self.problem.records), "record")
        return f"MotionFit of {numbers} to {records}: {self.verdict}"

    def draws(self, count: int, seed: int = 0) -> dict[str, Array]:
        """Random numbers distributed as the fit's, for the argument `numbers` of `rne.ensemble`.

        Parameters
        ----------
        count, seed : int
            Number N of draws, and the seed of their random numbers.

        Returns
        -------
        dict of str to ndarray, shape (N, ...)
            By the names of the scene's numbers.
        """
        unknowns, w, V = self.problem.unknowns, *np.linalg.eigh(self.certainty.covariance)
        normal = np.random.default_rng(seed).normal(size=(whole_number("count", count, least=1), len(w)))
        each = [unknowns.numbers(x) for x in self._x + normal * np.sqrt(np.maximum(w, 0)) @ V.T]
        return {name: np.array([numbers[name] for numbers in each]) for name in unknowns.of_scene}

    def plot(self, record: Record | None = None) -> Figure:
        """Measured and predicted positions and their difference over time, by joint.

        Parameters
        ----------
        record : Record, optional
            With commands and positions; by default the one with most samples of those that were fitted.

        Returns
        -------
        matplotlib.figure.Figure
            With the 95 % band of measured positions about the predicted ones, and the residual over velocity.
        """
        from ...plotting import prediction_plot

        record = (record or max(self.problem.records, key=lambda one: len(one.t))).on_grid()
        predicted, std = self.predict(record, std=True)
        qd = np.gradient(predicted, record.t, axis=0)
        measured, units = record.q[:, columns_for(self.initial, record)], joint_units(self.initial)
        how: dict[str, Any] = {"joint_names": self.initial.resolved.robot.joint_names, "units": units}
        title = f"Positions of {record.name}"
        how["valid"] = np.isfinite(measured - predicted) & np.isfinite(qd)
        return prediction_plot(record.t, measured, predicted, qd, std=std, title=title, **how)


ROUNDING = 1 / np.sqrt(12)  # standard deviation of a uniform error of one step


def identify_motion(
    scene: Scene,
    records: Record | Sequence[Record],
    wrt: str | Sequence[str] = "auto",
    *,
    start: Mapping[str, ArrayLike] | None = None,
    priors: Mapping[str, ArrayLike] | None = None,
    starts: int = 4,
    shot: float | None = None,
    step: float | None = None,
    folds: int = 0,
    robust: bool = False,
    seed: int = 0,
    progress: Callable[[int, float], object] | None = None,
) -> MotionFit:
    """Fit numbers of a scene to motions of which commands and positions were recorded, and no torques (output error).

    Motions under the scene's controller, which follows the commands, are simulated from starts that are fitted along,
    and compared with the positions.

    Parameters
    ----------
    scene : Scene
        The robot with all that is modelled, and a controller with a `reference`, such as `rne.control.pd` or `servo`,
        whose reference the records' commands replace. The fit starts from its numbers; within a factor of two is near
        enough.
    records : Record or sequence of Record
        With `command`. Joints are those of the scene by name, if they have names.
    wrt : "auto", str, or sequence of str
        Numbers to fit: names of `scene.numbers`, "parameters" regrouped as the motion depends on them; "command.delay"
        [s], the first command acting before the first sample too, "command.scale" and "command.offset" of the commands
        that the controller follows; "sensor.scale" and "sensor.offset" of the recorded positions, which the controller
        does not know. By default all numbers of the scene that are not zero, and those of commands.
    start : mapping of str to array_like, optional
        Values to start from instead of the scene's, of commands and of sensors.
    priors : mapping of str to array_like, optional
        Standard deviations about the start of numbers that are known roughly, in units of the quantity, one for all
        entries or each; of "parameters" of the regrouped ones. Leave numbers that are known exactly out of `wrt`.
    starts : int
        Number of starts from which the first steps are taken: the given one, and the best of many about it.
    shot : float, optional
        The longest part of a record that is simulated at once, each from its own start [s]. By default whole records;
        shorter parts suit motions that drift, as without feedback.
    step : float, optional
        The longest step of the Runge-Kutta method of order 4, by default as its fastest mode allows, at most a sample
        time [s].
    folds : int
        Number of parts of the records for cross-validation, 0 for none.
    robust : bool
        True for a loss that grows linearly beyond two standard deviations, for positions with outliers.
    seed : int
        Seed of the random starts.
    progress : callable, optional
        A function progress(iteration, residual), the residual in standard deviations of the positions.

    Returns
    -------
    MotionFit
        Numbers with standard errors, combinations that are not determined, and causes of unexplained residuals.

    Raises
    ------
    ValueError, TypeError, KeyError
        If an argument is wrong, the controller follows no reference, or a record has no commands.
    IdentificationError
        If no start leads to a motion that can be simulated.

    Notes
    -----
    `scipy.optimize.least_squares` with the exact derivatives of the steps that are taken, by their discrete
    sensitivities; positive numbers by their logarithms. Standard errors are those of residuals that are correlated in
    time, as rounding by encoders is (sandwich; Newey and West 1987), never less than those of white residuals. An entry
    is determined if its error does not grow with the spread that the fit allows for. Ljung 1999, System Identification,
    chapters 7 and 9. Engine "numba" takes about 50 to 90 times less time than NumPy.

    Examples
    --------
    >>> record = rne.identification.Record(t, q, command=command)  # doctest: +SKIP
    >>> found = rne.identify_motion(scene, record)  # doctest: +SKIP
    >>> print(found.report(), found.to_urdf(), found.scene())  # doctest: +SKIP
    >>> q, std = found.predict(record, std=True)  # doctest: +SKIP
    >>> found.plot().savefig("positions.png")  # doctest: +SKIP
    >>> found.draws(100)["friction.viscous"].shape  # doctest: +SKIP
    (100, 3)
    >>> found.save("fit.npz"), rne.identification.MotionFit.load("fit.npz")  # doctest: +SKIP
    """
    given = (records,) if isinstance(records, Record) else tuple(records)
    check_records(scene, given)
    given = tuple(record.on_grid() for record in given)
    folds = whole_number("folds", folds, least=0)
    unknowns = unknowns_of(scene, wrt, min(1 / record.sample_rate for record in given), start or {}, priors or {})
    spans = ranges(scene, given)
    least = rounding(scene, given)
    noise = np.where(least > 0, least, thresholds.LEAST_OF_RANGE * np.maximum(spans, thresholds.LEAST_OF_RANGE))
    length = None if shot is None else positive_number("shot", shot)
    shots = shots_of(scene, given, length, noise)
    longest = 1.0 if step is None else positive_number("step", step)
    problem = OutputError(unknowns, given, tuple(shots), np.maximum(noise, thresholds.OF_RANGE * spans), longest)
    parts_of_folds(problem, folds)  # an error now, not after a fit that takes long
    solver = MotionSolver(problem, noise, step is None, robust, progress)
    solver.from_starts(whole_number("starts", starts, least=1), seed)
    solver.refine()
    held = validation_errors(solver, folds) if folds else np.full(scene.n, np.nan)
    sure = how_sure(solver.problem, solver.z)
    finest = resolution(solver.problem, solver.z, least)
    causes = (*mistaken_columns(scene, given), *missing_effects(solver.problem, solver.z, finest))
    text = f"{counted(solver.iterations, 'iteration')} in steps of {solver.problem.step:.3g} s: {solver.message}"
    if lost := sum(len(record.t) for record in given) - sum(len(shot.t) for shot in shots):
        text += f"; {counted(lost, 'sample')} in parts of fewer than {FIRST} not used"
    return MotionFit(replace(solver.problem, told=None), solver.z, sure, finest, held, causes, text)


def at_times(values: Sequence[Array], grid: Array, t: Array) -> Array:
    """Values of a grid at other times; interpolated only where samples were left out or resampled."""
    from scipy.interpolate import CubicSpline

    if np.array_equal(t, grid):
        return np.array(values)
    return np.array([CubicSpline(grid, x)(np.clip(t, *grid[[0, -1]])) for x in values])


def how_sure(problem: OutputError, z: Array) -> Certainty:
    """Certainty at a solution."""
    P, parts = len(problem.unknowns.labels), []
    for s, (shot, (q, J)) in enumerate(zip(problem.shots, problem.derivatives(z), strict=True)):
        parts.append(((q - shot.q) / problem.sigma, problem.placed(s, J / problem.sigma[:, None])))
    given = np.append(problem.unknowns.is_given, np.zeros(len(z) - P, bool))
    return certainty(parts, problem.spread, P, given)


def check_records(scene: Scene, records: Sequence[Record]) -> None:
    """Raise an error for a scene without a tracking law, or records without commands."""
    if not isinstance(scene, Scene):
        raise TypeError(f"`scene` must be an rne.Scene, got {type(scene).__name__}")
    law, n = scene.controller, scene.n
    if isinstance(law, PID):
        raise ValueError("`scene` has a PID controller, whose reference is constant: take rne.control.pd or servo")
    has_reference = hasattr(law, "reference") and getattr(law, "traceable", False)
    if not is_dataclass(law) or isinstance(law, type) or not has_reference:
        raise ValueError("`scene` must have a controller with a `reference`, such as rne.control.pd or servo")
    states = [np.zeros(states_of(scene))] * (states_of(scene) > 0)
    try:
        moving: Any = replace(law, reference=sampled([0.0, 1.0], np.zeros((2, n))))
        moving(0.0, np.zeros(n), np.zeros(n), *states)
    except (TypeError, ValueError) as error:
        raise ValueError(f"the controller of `scene` follows no reference that moves: {error}") from None
    if not records:
        raise ValueError("`records` must have one record at least")
    for record in records:
        commands(scene, record)


def rounding(scene: Scene, records: Sequence[Record]) -> Array:
    """Standard deviations of the rounding of encoders, (n,), 0 where no step is known."""
    steps = [record.encoder_step[columns_for(scene, record)] for record in records]
    return np.asarray(ROUNDING * np.max(steps, axis=0))


def resolution(problem: OutputError, z: Array, least: Array) -> Array:
    """Standard deviation of the white part of the residuals, by third differences, at least that due to rounding."""
    each = [np.diff(q - shot.q, 3, axis=0) for shot, q in zip(problem.shots, problem.positions(z), strict=True)]
    with np.errstate(all="ignore"):
        white = np.sqrt(np.nanmean(np.concatenate(each) ** 2, axis=0) / 20)
    return np.asarray(np.maximum(np.nan_to_num(white), least))


def ranges(scene: Scene, records: Sequence[Record]) -> Array:
    """Ranges of the joints' positions."""
    each = [record.q[:, columns_for(scene, record)] for record in records]
    return np.asarray(np.max([np.nanmax(q, axis=0) - np.nanmin(q, axis=0) for q in each], axis=0))
