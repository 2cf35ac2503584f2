"""Measurements of one motion: times, joint positions and torques, from arrays, CSV files, simulations or motors."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from ...basics.archive import File
from ...basics.arrays import ReadOnlyArrays, convert_numbers, positive_number, real_array, vector, whole_number
from ...basics.spatial import Array
from ...basics.text import counted, numbered_joints, plain
from ...files.log_columns import measured
from ...files.logs import LogOptions
from .. import thresholds
from .commands import Commands
from .findings import NO_COMMANDS, RecordFinding, Screened, torques_of
from .prepared import Prepared, prepare
from .screening import STAMPS, screen

if TYPE_CHECKING:
    from ...simulation.trajectory import Trajectory

GUESS = "guess"  # kind of the findings on assumptions about a log
TimeUnits = Literal["s", "ms", "us", "ns"]
UNITS = {"rad": 1.0, "m": 1.0, "deg": np.pi / 180}


class Record(ReadOnlyArrays):
    """Measurements of one motion, screened for faults.

    Parameters
    ----------
    t : array_like, shape (T,)
        Times [s].
    q : array_like, shape (T, n)
        Joint positions, in `unit`.
    tau : array_like, shape (T, n), optional
        Joint torques [N m or N]; without them `command` is needed.
    qd : array_like, shape (T, n), optional
        Measured joint velocities, in `unit` per second. Where they agree with the positions and have less noise than
        the derivatives of these, `prepare` uses them.
    command : array_like, shape (T, n), optional
        Commanded positions at the times `t`, in `unit`, from which `rne.identify_motion` fits a model.
    command_rate : array_like, shape (T, n), optional
        Commanded velocities at the same times, in `unit` per second.
    command_hold : bool
        True if a command holds until the next sample, False if commands are linear in between.
    name : str
        For messages.
    joint_names : sequence of str, optional
        For messages; "joint_1" and so on if not given.
    unit : {"rad", "m", "deg"}, or a sequence of n of them
        Unit of the positions of all joints, or of each.
    stamps : {"auto", "sampled", "regular"}
        Whether the samples were taken at the times ("sampled") or in equal steps, the times being those at which a
        reader got them ("regular"). By default measured velocities decide, which integrate to the positions over the
        right ones; without them the times are believed, however irregular, unless the positions are smoother over
        equal steps or different samples have the same time.
    bridge : int
        How many samples in a row, missing or wrong, are interpolated; at longer gaps the record is cut.

    Attributes
    ----------
    t : ndarray, shape (T,)
        Times as given [s].
    q, tau, qd, command, command_rate : ndarray, shape (T, n), or None
        As given, in SI units [rad, N m and rad/s; m, N and m/s of sliding joints].
    command_hold : bool
        As given.
    cleaned : CleanRecord
        The measurements on a grid of equal steps, without what cannot be used.
    findings : tuple of RecordFinding
        Faults of the measurements and what is done about them; empty if there are none.
    encoder_step : ndarray, shape (n,)
        Smallest step of each position, of which all others are multiples [rad or m]; zero if there is none.
    sample_rate : float
        Samples per second, those that are missing included [Hz].
    source : str
        How `from_log` read the log, and what `in_motion` cut; empty for other records.

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not of numbers, there are neither torques nor commands, or an option has
        no allowed value.

    Notes
    -----
    Findings are: times that go back or occur twice, gaps and missing samples; times made by the reader of the log;
    values that are not finite; spikes, up to three samples whose distance from the curve through their neighbours is
    more than ten times the usual one, such as positions repeated during a motion; jumps of positions; torques that are
    constant or at a limit; velocities that disagree with the positions; positions in degrees; joints that do not move;
    fewer than two samples per second, and times that look like milliseconds, microseconds or nanoseconds. Of commands:
    values that are not finite, constant commands, another unit than the positions have, commands a turn away from the
    positions or later, jumps by turns, and commands that repeat themselves during a motion and then catch up.
    Errors are raised by `prepare`.

    Examples
    --------
    >>> import numpy as np, rne
    >>> t = np.arange(2000) / 500
    >>> q = np.sin(2 * np.pi * np.outer(t, [0.5, 1.0]))
    >>> q[700, 1] += 0.3
    >>> record = rne.identification.Record(t, q, np.cos(q), name="run 1")
    >>> print(record.findings[0])
    warning: run 1: joint_2: position spike at sample 700 (t = 1.4 s); interpolated
    >>> len(record.between(1.0, 2.0).t)
    501
    >>> record.prepare().notes[0]
    "cut-off 6.25 Hz, chosen from the spectrum of the positions: 5 times the motion's bandwidth of 1.25 Hz"
    >>> record = rne.identification.Record.from_csv("log.csv", ["shoulder", "elbow"])  # doctest: +SKIP
    """

    def __init__(
        self,
        t: ArrayLike,
        q: ArrayLike,
        tau: ArrayLike | None = None,
        qd: ArrayLike | None = None,
        *,
        command: ArrayLike | None = None,
        command_rate: ArrayLike | None = None,
        command_hold: bool = True,
        name: str = "record",
        joint_names: Sequence[str] | None = None,
        unit: str | Sequence[str] = "rad",
        stamps: str = "auto",
        bridge: int = 3,
    ) -> None:
        if stamps not in STAMPS:
            raise ValueError(f'`stamps` must be "auto", "sampled" or "regular", got {stamps!r}')
        self.name, self._stamps, self._bridge = name, stamps, whole_number("bridge", bridge, least=0)
        self.q = samples_array("q", q, None)
        self.t = vector("t", t, len(self.q))
        if tau is None and command is None:
            raise ValueError("`tau` or `command` must be given, got neither")
        if command is None and command_rate is not None:
            raise ValueError("`command_rate` must come with the positions, `command`")
        given = {"tau": tau, "qd": qd, "command": command, "command_rate": command_rate}
        arrays = {x: None if y is None else samples_array(x, y, self.q.shape) for x, y in given.items()}
        self.tau, self.command_hold, n = arrays.pop("tau"), bool(command_hold), self.q.shape[1]
        self.joint_names = numbered_joints(n) if joint_names is None else tuple(joint_names)
        if len(self.joint_names) != n:
            raise ValueError(f"`joint_names` must have {n} names, got {len(self.joint_names)}")
        commonest, count = Counter(self.joint_names).most_common(1)[0]
        if count > 1:
            raise ValueError(f"`joint_names` must be different, got {commonest!r} {count} times")
        self._given_names = None if joint_names is None else self.joint_names
        units = [unit] * n if isinstance(unit, str) else list(unit)
        if len(units) != n or any(u not in UNITS for u in units):
            raise ValueError(f'`unit` must be "rad", "m" or "deg", or {n} of them, got {unit!r}')
        self.q *= (factors := [UNITS[u] for u in units])
        self.qd, self.command, self.command_rate = (None if x is None else x * factors for x in arrays.values())
        asked = None if self.command is None else Commands(self.command, self.command_rate, self.command_hold)
        of_motion = self.t, self.q, self.tau, self.qd
        self.cleaned = screen(Screened(name, self.joint_names, *of_motion, self._bridge, stamps), asked)
        self.findings: tuple[RecordFinding, ...] = self.cleaned.findings
        self.encoder_step: Array = self.cleaned.encoder_step
        self.sample_rate = 1 / self.cleaned.period
        self.source = ""
        self.__post_init__()

    def _tell(self, source: str, guessed: Iterable[RecordFinding]) -> None:
        """Add how the record was made, and findings on assumptions."""
        self.source = "; ".join(filter(None, (self.source, source)))
        self.findings = (*guessed, *self.findings)
        self.cleaned = replace(self.cleaned, findings=self.findings)

    @classmethod
    def from_csv(cls, path: File, joint_names: Sequence[str], *, time_unit: TimeUnits = "s", **options: Any) -> Self:
        """Record from a CSV file.

        Parameters
        ----------
        path : path-like
            A text file in UTF-8. Its first row names the columns: `t`, `q.<joint>`, `tau.<joint>` or
            `command.<joint>`, and if there are such `qd.<joint>` and `command_rate.<joint>`, in any order; others are
            ignored. Separator and decimal sign are found. Empty entries and `nan`, except of times, are missing values,
            which the findings name.
        joint_names : sequence of str
            The joints in the order of the arrays, such as `robot.joint_names`.
        time_unit : {"s", "ms", "us", "ns"}
            Unit of the column `t`.
        **options
            Options of `Record`; `name` is the file's if not given.

        Returns
        -------
        Record
            The file's samples.

        Raises
        ------
        TypeError
            If `joint_names` is no sequence of str.
        ValueError
            If a column is missing, or a row is short or holds no numbers; names the file, row and column.
        OSError
            If the file cannot be read.
        """
        reading = LogOptions(joint_names, time_unit=time_unit, exact=True)
        return cls._read(path, reading, {"joint_names": joint_names} | options)

    @classmethod
    def from_log(
        cls,
        path: File | Mapping[str, File],
        *,
        joints: Sequence[str] | None = None,
        columns: Sequence[str] | Mapping[str, Any] | None = None,
        units: Mapping[str, Any] | None = None,
        time_unit: TimeUnits | None = None,
        sample_rate: float | None = None,
        gains: ArrayLike | None = None,
        offsets: ArrayLike = 0.0,
        separator: str | None = None,
        decimal: Literal[".", ","] | None = None,
        topic: str | None = None,
        episode: int | None = None,
        torques: bool = True,
        **options: Any,
    ) -> Self:
        """Record from a log file of a robot.

        Read are text with or without names of the columns, in columns or in rows of joints; JSON and lines of it; joint
        states of ROS 1 and 2 (bags as .bag, .db3 and .mcap, and folders of them, `rostopic echo -p`,
        `ros2 topic echo --csv`), exports of bags by PlotJuggler and bagpy; .mat files of versions 5 to 7, .npz files,
        and LeRobot data sets. Names of joints in the log count before numbers, and these before guesses. What the log
        does not say is given, or guessed, which `source` and `findings` report. Where there are no torques, commanded
        positions are read instead, such as `action` with `observation.state`, `target_q`, `goal_position`,
        `q_cmd`, and the references of joint trajectory controllers in bags.

        Parameters
        ----------
        path : path-like, or mapping of path-like
            A file or folder; or a file for each of "q" and "tau" or "command", and of "t", "qd" and "command_rate" if
            there are such.
        joints : sequence of str, optional
            Joints to read, in the order of the arrays, such as `robot.joint_names`; by default those with positions and
            torques, or commands.
        columns : sequence of str, or mapping, optional
            Names of all columns of a text, "" for one to ignore; or a column, its number from 0, or several of them,
            for "t", "q", "qd", "tau", "command" and "command_rate". By default by their names, such as `q.<joint>`,
            `actual_q_0` or `joint1_pos [deg]`; "target", "command" and the like are not read if there are torques.
        units : mapping, optional
            Units of "q" ("rad", "deg", "m", "mm"), "qd" ("rad/s", "deg/s", "rpm", "m/s", "mm/s"), "tau" ("Nm", "mNm",
            "N", "A", "mA"), "command" and "command_rate", by default as "q", or SI units per unit of the log as a
            number, such as 2 pi / 4096 for steps of an encoder; one for all joints or a sequence.
        time_unit : {"s", "ms", "us", "ns"}, optional
            Unit of the times.
        sample_rate : float, optional
            Samples per second where the log has no times [Hz].
        gains : float or array_like, shape (n,), optional
            Torque of each joint per ampere of its drive [N m/A], or per unit of what the log has as torque.
        offsets : float or array_like, shape (n,)
            Joint positions where the log has zero, of positions and commands [rad or m].
        separator, decimal : str, optional
            Between the columns of a text, and of its numbers.
        topic : str, optional
            Of the messages, where a file has several of joint states, or of states of controllers.
        episode : int, optional
            Of a data set that has several.
        torques : bool
            False to read commands instead of torques where a log has both.
        **options
            Other options of `Record`; `name` is the file's if not given.

        Returns
        -------
        Record
            The measurements; `source` says in a sentence how the log was read.

        Raises
        ------
        ValueError
            If the file is of another kind, damaged or cut off; has no positions, or no torques and no commands; a row,
            column, unit or joint is wrong; or columns may be commands of one joint alike: names the file and what there
            is.
        ImportError
            If rosbags or pyarrow is needed and not installed.
        OSError
            If the file cannot be read.

        Examples
        --------
        >>> import pathlib, tempfile, rne
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "log.csv"
        >>> rows = [f"{20 * k};{k % 7},5;{k % 5},25" for k in range(100)]
        >>> _ = file.write_text("\\n".join(["Time [ms];elbow pos [deg];elbow torque", *rows]))
        >>> record = rne.identification.Record.from_log(file)
        >>> record.joint_names, record.t[1].item(), record.tau[1].tolist()
        (('elbow',), 0.02, [1.25])
        """
        if "unit" in options or "joint_names" in options:
            raise ValueError("give `units` and `joints` instead of `unit` and `joint_names`")
        if isinstance(joints, str) or isinstance(columns, str):
            raise TypeError("`joints` and `columns` must be sequences of names, such as robot.joint_names, got str")
        times, texts = (time_unit, sample_rate), (separator, decimal)
        reading = LogOptions(joints, columns, units or {}, *times, gains, offsets, *texts, topic, episode, torques)
        return cls._read(path, reading, options)

    @classmethod
    def _read(cls, path: File | Mapping[str, File], reading: LogOptions, options: dict[str, Any]) -> Self:
        """Measurements of a log, and the remarks on it."""
        samples, said, guessed = measured(path, reading)
        if names := samples.get("joint_names"):
            samples["joint_names"] = tuple(map(plain, names))
        first = next(iter(path.values())) if isinstance(path, Mapping) else path
        record = cls(**(samples | {"name": plain(Path(first).name)} | options))
        guesses = [RecordFinding("warning", record.name, "", GUESS, f"that {text}", cure) for text, cure in guessed]
        record._tell("; ".join(said), guesses)
        return record

    @classmethod
    def from_trajectory(cls, motion: Trajectory, sample_rate: float, **options: Any) -> Self:
        """Record of a simulated motion at equal steps, as perfect drives would report it.

        Parameters
        ----------
        motion : Trajectory
            As `rne.simulate` returns it.
        sample_rate : float
            Samples per second [Hz].
        **options
            Options of `Record`.

        Returns
        -------
        Record
            Positions, velocities and torques of the drives; of elastic joints, positions and velocities of the motors.

        Raises
        ------
        ValueError
            If `sample_rate` is not positive, or the motion has no samples.

        Examples
        --------
        >>> import rne
        >>> motion = rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 0.5)
        >>> rne.identification.Record.from_trajectory(motion, 100).q.shape
        (51, 6)
        """
        from ...simulation.trajectory import motors_at

        rate = positive_number("sample_rate", sample_rate)
        t = np.arange(int((motion.t[-1] - motion.t[0]) * rate + 1e-9) + 1) / rate + motion.t[0]
        q, qd = motors_at(motion, t)
        names = {} if motion.model is None else {"joint_names": motion.model.joint_names}
        return cls(t, q, motion.torques(t), qd, **(names | options))

    @classmethod
    def from_motors(
        cls,
        t: ArrayLike,
        motor_q: ArrayLike,
        motor_tau: ArrayLike,
        motor_qd: ArrayLike | None = None,
        *,
        ratios: ArrayLike,
        coupling: ArrayLike | None = None,
        drive_gains: ArrayLike | None = None,
        offsets: ArrayLike | None = None,
        unit: str = "rad",
        **options: Any,
    ) -> Self:
        """Record of joints from measurements at the motors.

        Parameters
        ----------
        t : array_like, shape (T,)
            Times [s].
        motor_q : array_like, shape (T, n)
            Positions of the motors, in `unit`.
        motor_tau : array_like, shape (T, n)
            Torques of the motors [N m], or what is proportional to them by `drive_gains`, such as currents [A].
        motor_qd : array_like, shape (T, n), optional
            Velocities of the motors, per second of `unit`.
        ratios : array_like, shape (n,)
            Turns of each motor per turn of its joint; negative if they turn against each other.
        coupling : array_like, shape (n, n), optional
            Joints that each motor turns with, the identity if not given: motor_q = K (q - offsets) with
            K = diag(ratios) coupling. A wrist whose joint 5 turns motor 6 as well has coupling[5, 4] = 1. The rotor and
            friction of such a motor act at the sum of the velocities: to fit them, give its row of `coupling` as a row
            of `DriveModel.coupled_motors` to `rne.identify`.
        drive_gains : array_like, shape (n,), optional
            Torque of the motor per unit of `motor_tau` [N m/A]; one if not given.
        offsets : array_like, shape (n,), optional
            Joint positions where the motors read zero [rad]; zero if not given.
        unit : {"rad", "deg"}
            Of the motors' positions.
        **options
            Other options of `Record`.

        Returns
        -------
        Record
            Of the joints: q = K^-1 motor_q + offsets, tau = K^T (drive_gains motor_tau), so that tau . qd is the power
            of the motors.

        Raises
        ------
        ValueError
            If an array has the wrong shape, a ratio or gain is zero, or `coupling` is singular.

        Examples
        --------
        >>> import numpy as np, rne
        >>> t = np.arange(100) / 100
        >>> motor_q, motor_tau = np.outer(np.sin(t), [50.0, 80.0]), np.outer(np.cos(t), [1.0, 2.0])
        >>> record = rne.identification.Record.from_motors(t, motor_q, motor_tau, ratios=[100, -80])
        >>> record.tau[0].tolist()
        [100.0, -160.0]
        """
        if unit not in ("rad", "deg"):
            raise ValueError(f'`unit` must be "rad" or "deg" for motors, got {unit!r}')
        positions = samples_array("motor_q", motor_q, None) * UNITS[unit]
        n = positions.shape[1]
        gains = np.ones(n) if drive_gains is None else _not_zero("drive_gains", drive_gains, n)
        zero = 0.0 if offsets is None else vector("offsets", offsets, n)
        mixed = np.eye(n) if coupling is None else np.array(real_array("coupling", coupling, f"({n}, {n})"), np.float64)
        K, rows = _not_zero("ratios", ratios, n)[:, None] * mixed, np.linalg.norm(mixed, axis=1)
        if (rows == 0).any() or np.linalg.cond(mixed / rows[:, None]) > 1 / thresholds.SINGULAR_COUPLING:
            why = "joint positions do not follow from the motors' through a singular matrix"
            raise ValueError(f"`coupling` must be invertible: {why}")
        torques = (gains * samples_array("motor_tau", motor_tau, positions.shape)) @ K
        velocities = None
        if motor_qd is not None:
            velocities = np.linalg.solve(K, samples_array("motor_qd", motor_qd, positions.shape).T).T * UNITS[unit]
        return cls(t, np.linalg.solve(K, positions.T).T + zero, torques, velocities, **options)

    def __repr__(self) -> str:
        t = self.t
        return (
            f"Record '{self.name}': {counted(len(t), 'sample')} of {counted(self.n, 'joint')}, "
            f"{t[-1] - t[0]:.4g} s{f' from {t[0]:.3f} s on' if t[0] else ''}, "
            f"{'' if self.tau is not None else 'commands without torques, '}{counted(len(self.findings), 'finding')}"
        )

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    @property
    def given_names(self) -> tuple[str, ...] | None:
        """Names of the joints that the record was given, None where it numbers them."""
        return self._given_names

    def is_of(self, joint_names: Sequence[str]) -> bool:
        """True if the record has the robot's joint names; joint_1 and so on may only be numbers."""
        given = self._given_names or ()
        plain = tuple(re.sub(r"[ _]*0*(\d+)$", r"_\1", name.lower()) for name in given)  # Joint1, joint 01
        are_numbers = plain in (numbered_joints(self.n), tuple(f"joint_{k}" for k in range(self.n)))
        return bool(given) and not (are_numbers and set(given).isdisjoint(joint_names))

    def between(self, start: float, end: float) -> Record:
        """Part of the record in an interval of time.

        Parameters
        ----------
        start, end : float
            Of the interval [s].

        Returns
        -------
        Record
            With the samples of which start <= t <= end.

        Raises
        ------
        ValueError
            If there is none.
        """
        part = (self.t >= start) & (self.t <= end)
        if not part.any():
            span = f"the record's are from {self.t[0]:.12g} to {self.t[-1]:.12g} s"
            raise ValueError(f"there are no samples between {start:.12g} and {end:.12g} s: {span}")
        return self.part(part, self.joint_names)

    def part(
        self, rows: Array | slice, joint_names: Sequence[str], called: Sequence[str] = (), *, torques: bool = True
    ) -> Record:
        """Part of the record: some samples of some joints, renamed if given (`called`)."""
        joints = [self.joint_names.index(name) for name in joint_names]
        options: dict[str, Any] = {"stamps": self._stamps, "bridge": self._bridge, "command_hold": self.command_hold}
        options["joint_names"] = self._given_names and (called or joint_names)
        there = {x: getattr(self, x) for x in (*["tau"] * torques, "qd", "command", "command_rate")}
        options |= {x: y[rows][:, joints] for x, y in there.items() if y is not None}
        part = Record(self.t[rows], self.q[rows][:, joints], name=self.name, **options)
        part._tell(self.source, [finding for finding in self.findings if finding.kind == GUESS])
        return part

    def _without_torques(self) -> Record:
        """Record of only the commands and positions, screened as such."""
        if self.command is None:
            raise ValueError(f"{self.name}: {NO_COMMANDS}")
        return self if self.tau is None else self.part(slice(None), self.joint_names, torques=False)

    def on_grid(self) -> Record:
        """Clean commands and positions, NaN where not measured; a ValueError for an error."""
        record = self._without_torques()
        record._refuse_errors()
        clean = record.cleaned
        arrays: dict[str, Any] = {"t": clean.t, "q": np.where(clean.interpolated, np.nan, clean.q)}
        arrays |= {"qd": clean.qd, "command": clean.command, "command_rate": clean.command_rate}
        if all(np.array_equal(x, getattr(record, name), equal_nan=True) for name, x in arrays.items() if x is not None):
            return record
        how: dict[str, Any] = {"command_hold": self.command_hold, "bridge": self._bridge, "stamps": "sampled"}
        found = Record(**arrays, **how, name=self.name, joint_names=self._given_names)
        found.encoder_step = record.encoder_step  # which resampled positions do not show
        return found

    def _refuse_errors(self) -> None:
        """Raise a ValueError if a finding is an error."""
        errors = [finding for finding in self.findings if finding.severity == "error"]
        if errors:
            more = f" ({len(errors) - 1} more errors in `findings`)" if len(errors) > 1 else ""
            raise ValueError(errors[0].message + more)

    def in_motion(self) -> Record:
        """Part of the record without rest at its start and end.

        Rest lasts more than 0.2 s, until a joint leaves its position by half a per cent of its range, or by more
        than noise, and without torques until a command does.

        Returns
        -------
        Record
            From the last sample before the motion to the first after it; `source` says what was cut.

        Raises
        ------
        ValueError
            If no joint moves.

        Examples
        --------
        >>> import numpy as np, rne
        >>> q = np.concatenate([np.zeros((300, 1)), np.sin(np.arange(500) / 50)[:, None]])
        >>> rne.identification.Record(np.arange(800) / 100, q, q).in_motion().source
        'rest cut off: 3.01 s at the start'
        """
        from scipy.ndimage import median_filter

        x = self.q if self.tau is not None or self.command is None else np.hstack([self.q, self.command])
        pairs, rows = zip(x.T, np.isfinite(x.T), strict=True), np.arange(len(x))
        known = [np.interp(rows, rows[given], x[given]) if given.any() else 0.0 * rows for x, given in pairs]
        q = median_filter(np.stack(known, axis=1), (5, 1), mode="nearest")  # without single spikes
        noise = np.median(np.abs(np.diff(known, append=q[-1:].T)), axis=1)
        span = np.ptp(q, axis=0)
        least = thresholds.AT_REST * span
        shaken = np.minimum(thresholds.NOISE_AT_REST * noise, thresholds.NOISIEST_REST * least)
        still = np.maximum(least, shaken + np.pad(self.encoder_step, (0, x.shape[1] - self.n)))
        start, end = (np.flatnonzero((np.abs(q - x) > still).any(axis=1)) for x in (q[0], q[-1]))
        if not len(start):
            raise ValueError(f"{self.name}: no joint moves")
        first, last = max(start[0] - 1, 0), min(end[-1] + 1, len(q) - 1)
        before, after = self.t[first] - self.t[0], self.t[-1] - self.t[last]
        first, last = first * (before > thresholds.PAUSE), last if after > thresholds.PAUSE else len(q) - 1
        part = self.part(slice(first, last + 1), self.joint_names)
        cut = [f"{x:.4g} s at the {end}" for x, end in ((before, "start"), (after, "end")) if x > thresholds.PAUSE]
        part._tell(f"rest cut off: {', '.join(cut)}" * bool(cut), ())
        return part

    def prepare(self, cutoff: float | None = None) -> Prepared:
        """Positions, velocities, accelerations and torques on an equidistant grid, with the filter for a fit.

        Parameters
        ----------
        cutoff : float, optional
            Of the parallel filter [Hz], at most a fifth of the sample rate. If it is not given, five times the
            frequency below which 99 % of the power of the velocities lies, less where noise disturbs the accelerations.
            Were that more than a fifth of the sample rate, only what positions and torques have in common counts.

        Returns
        -------
        Prepared
            The arrays; `notes` says how the cut-off was chosen, what was dropped, and the findings.

        Raises
        ------
        ValueError
            If the record has no torques, a finding is an error, there is no motion to choose a cut-off from, no segment
            is long enough for the filters, or an argument is out of its range.

        Notes
        -----
        Measured velocities and the derivatives of positions pass complementary filters, those above and these below the
        frequency at which both have the same noise; of positions, the integrals of the velocities take the upper part.
        They pass a filter of five times the cut-off, at most a quarter of the sample rate, before they are
        differentiated by central differences of eighth order. Both filters are Butterworth filters of fourth order that
        run forwards and backwards. What a filter takes from the accelerations it takes from the inertias, so that
        parameters depend on the cut-off: `Identification.drift` shows by how much.
        """
        torques_of(self.cleaned)
        self._refuse_errors()
        return prepare(self.name, self.cleaned, cutoff, float(self.t[0]))


def samples_array(name: str, value: ArrayLike, shape: tuple[int, ...] | None) -> Array:
    """Float64 copy of shape (T, n), of any real numbers, finite or not."""
    wanted = "(T, n)" if shape is None else str(shape)
    array = convert_numbers(name, value, wanted)
    if array.dtype.kind == "c":
        raise ValueError(f"`{name}` must be real, got dtype {array.dtype}")
    if array.ndim != 2 or 0 in array.shape or (shape is not None and array.shape != shape):
        raise ValueError(f"`{name}` must have shape {wanted}, got {array.shape}")
    return np.array(array, dtype=np.float64)


def _not_zero(name: str, value: ArrayLike, n: int) -> Array:
    factors = vector(name, value, n)
    if (factors == 0).any():
        raise ValueError(f"`{name}` must not be zero, got zero for joint {int(np.argmin(np.abs(factors))) + 1}")
    return factors
