"""Commands rne simulate, torques, view and cycle: simulation, torques of a file, 3-D pages, and least-time plans.

A CSV file can be read without an error and still be wrong: times in milliseconds, angles in degrees or wrapped, noise
that differentiation amplifies. Warnings report each; the numbers change only if an option asks for it.
"""

from __future__ import annotations

import argparse
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import rne

from ..basics.arrays import per_joint_array
from ..basics.filters import low_pass
from ..basics.spatial import Array
from ..basics.text import UNITS, plain, short
from ..files.samples import MissingColumn, Samples, in_seconds, read_samples
from ..files.time_units import FACTOR, SPIKED, velocity_ratio
from . import shared
from .shared import CommandError, bodies, fail, in_one_line, note, number, numbers, say, units_of, used, work, written

NOT_GIVEN = " (not given: zero)"
MOTIONS = (".npz", ".csv")
SIMULATION = "rne simulate irb140 --q0 0 0.5 0 0 0 0 --duration 2 --out motion.csv"
TORQUES = "rne torques irb140 motion.csv --out torques.csv"
VIEW = "rne view irb140 --motion motion.csv --out irb140.html"
COLUMNS = ".npz of rne.Trajectory.save, or .csv with columns t and q.<joint> [s, rad or m]"
CYCLE = "rne cycle irb140 via.csv --effort 250 250 150 50 50 20 --gear 100 --rotor 1e-4 --efficiency 0.85"
FILM = 0.02  # interval between the positions of the film of a cycle [s]
PAGES = (".html", ".htm")
NOISY = 0.05  # rms torque made by noise, relative to the joint's torque, above which a warning is given
TURN = 2 * np.pi
UNEVEN = 100  # ratio of the longest to the shortest step above which a warning is given
EVEN = 1e-2  # largest difference of steps that a filter takes as even, relative to their mean
FEW = 30  # fewest samples for an estimate of noise
WINDOWS = 20_000  # windows of a long file from which noise is estimated
ORDERS = (6, 9)  # orders of the differences that show noise
STEADY = 0.7  # smallest ratio of the two estimates for noise: those of a smooth motion fall with the order
MEDIAN = 0.6745  # median magnitude of a standard normal number
RESIDUAL = 1.2  # ratio of what a filter removes to the noise


def add_simulate(commands: Any) -> None:
    """Register `rne simulate`."""
    title = "simulate a motion and write it to a file"
    parser = shared.add_parser(commands, "simulate", title, SIMULATION, run_simulate)
    shared.add_robot(parser)
    joints = "one number per joint, separated by blanks or commas"
    parser.add_argument("--q0", metavar="Q", type=numbers, help=f"initial positions [rad or m], {joints}; else zero")
    parser.add_argument("--qd0", metavar="QD", type=numbers, help="initial velocities [rad/s or m/s]; else at rest")
    parser.add_argument("--duration", metavar="S", type=number, required=True, help="of the motion [s]")
    parser.add_argument("--torque", metavar="TAU", type=numbers, help="constant drive torques [N m or N]; else none")
    parser.add_argument("--method", default="auto", help="solver of rne.simulate (default: auto)")
    parser.add_argument("--rtol", type=number, default=1e-6, help="relative tolerance (default: 1e-6)")
    parser.add_argument("--every", metavar="S", type=number, help="time between samples [s]; else the solver's steps")
    out = "file to write: .npz, for rne.Trajectory.load, or .csv, for other programs"
    parser.add_argument("--out", metavar="FILE", type=Path, required=True, help=out)
    shared.add_force(parser)


def run_simulate(arguments: argparse.Namespace) -> int:
    """Simulate, write the file, and print the options and the result; returns 1 if the simulation failed."""
    shared.check_file(arguments.out, arguments, suffixes=MOTIONS)
    robot = shared.robot_of(arguments)
    times = _times(arguments.duration, arguments.every)
    q0, qd0, torque = (_per_joint(robot, name, getattr(arguments, name)) for name in ("q0", "qd0", "torque"))
    say(used(robot, arguments))
    say(f"q0 {written(q0)} {units_of(robot, 'rad', 'm')}{NOT_GIVEN if arguments.q0 is None else ''}")
    say(f"qd0 {written(qd0)} {units_of(robot, 'rad/s', 'm/s')}{NOT_GIVEN if arguments.qd0 is None else ''}")
    say(f"torque {written(torque)} {units_of(robot, 'N m', 'N')}{NOT_GIVEN if arguments.torque is None else ''}")
    say(f"{bodies(robot)}: no friction, stops or torque limits")
    try:
        with shared.warnings_in_one_line(arguments):
            options = {"method": arguments.method, "rtol": arguments.rtol, "t_eval": times}
            law = None if arguments.torque is None else torque
            work.begin(f"simulating {arguments.duration:g} s of motion")
            motion = rne.simulate(robot, q0, qd0, arguments.duration, torque=law, progress=work.progress, **options)
            work.begin("computing torques and energies, and writing the file")
    except rne.SimulationError as error:
        fail(in_one_line(error))
        return 1
    except rne.SimulationInterrupted as interrupt:
        _write(interrupt.trajectory, arguments.out)
        raise KeyboardInterrupt(f"the motion up to t = {interrupt.time:.4g} s is in {arguments.out}") from None
    _write(motion, arguments.out)
    say(motion.message)
    say(f"energy drift {motion.energy_drift:.3g} J")
    shared.say_limits(say, robot, motion.check_limits())
    shared.say_samples(arguments.out, motion.t)
    return 0


def _write(motion: rne.Trajectory, file: Path) -> None:
    (motion.save if file.suffix.lower() == ".npz" else motion.to_csv)(file)


def _per_joint(robot: rne.Robot, option: str, given: list[float] | None) -> list[float]:
    """Numbers of an option, one per joint, zeros by default."""
    if given is None:
        return [0.0] * robot.n
    if len(given) != robot.n:
        names = ", ".join(robot.joint_names)
        raise CommandError(f"--{option}: must be {robot.n} numbers, for {names}; got {len(given)}")
    return given


def _times(duration: float, every: float | None) -> list[float] | None:
    """Samples at equal intervals from 0, the end included."""
    if every is None:
        return None
    if not 0 < every <= duration:
        raise CommandError(f"--every: must be positive and at most the duration of {duration:g} s, got {every:g}")
    return [*np.arange(0.0, duration - 1e-9 * every, every).tolist(), duration]


def add_torques(commands: Any) -> None:
    """Register `rne torques`."""
    title = "compute the torques of a motion in a CSV file"
    parser = shared.add_parser(commands, "torques", title, TORQUES, run_torques)
    shared.add_robot(parser)
    columns = "CSV with columns t and q.<joint>, if known qd.<joint> and qdd.<joint>, in any order [s, rad or m]"
    parser.add_argument("motion", metavar="MOTION.csv", type=Path, help=columns)
    add_units(parser)
    cutoff = "filter the columns before they are differentiated: Butterworth, fourth order, no delay, cut off at HZ"
    parser.add_argument("--cutoff", metavar="HZ", type=number, help=cutoff)
    out = "CSV file to write, columns t and tau.<joint> (default: standard output)"
    parser.add_argument("--out", metavar="FILE", type=Path, help=out)
    shared.add_force(parser)


def run_torques(arguments: argparse.Namespace) -> int:
    """Write the torques, and print their source, on standard error if the torques go to standard output."""
    from ..dynamics.limits import limit_violations
    from ..files.motion_files import csv_text, write_columns

    shared.check_file(arguments.out, arguments, suffixes=(".csv",))
    robot = shared.robot_of(arguments)
    work.begin(f"reading {arguments.motion}")
    given = read_motion(arguments.motion, robot, arguments)
    if given.qd is None:
        refuse_wrapped_angles(given, robot, arguments.motion)
    motion, change = given, ""
    if arguments.cutoff is not None:
        motion, change = filtered(given, arguments.cutoff)
    q, qd, qdd, source = differentiated(motion, arguments.motion)
    work.begin(f"computing torques of {len(q)} samples")
    with shared.warnings_in_one_line(arguments):
        tau = robot.inverse_dynamics(q, qd, qdd)
    tell = note if arguments.out is None else say
    tell(used(robot, arguments))
    tell(source)
    if change:
        tell(change)
    if given.qd is None or given.qdd is None:
        work.begin("estimating the noise of the samples")
        warn_of_uneven_steps(given.t)
        warn_of_noise(robot, given, arguments, tau)
    without = "friction" if robot.model.armature.any() else "friction and inertia of the drives"
    tell(f"tau in {units_of(robot, *UNITS['tau'])}: {bodies(robot)}, without {without}")
    exceeded = limit_violations(robot.model, motion.t - motion.t[0], q, qd, tau)
    if exceeded and motion.t[0]:
        tell(f"times of limits count from the first row, t = {motion.t[0]:.13g} s")
    shared.say_limits(tell, robot, exceeded)
    columns = {f"tau.{name}": tau[:, k] for k, name in enumerate(robot.joint_names)}
    if arguments.out is None:
        print(csv_text(motion.t, columns), end="")
    else:
        write_columns(arguments.out, motion.t, columns)
        shared.say_samples(arguments.out, motion.t)
    return 0


def warn_of_noise(robot: rne.Robot, given: Samples, arguments: argparse.Namespace, tau: Array) -> None:
    """Warn if noise makes more than 5 % of a joint's torque; computed by adding noise of the same size once more."""
    name = "q" if given.qd is None else "qd"  # the column that is differentiated
    x: Array = getattr(given, name)
    sigma = noise(given.t, x)
    if not sigma.any():
        return
    shaken = given._replace(**{name: x + sigma * np.random.default_rng(0).normal(size=x.shape)})
    if arguments.cutoff is not None:
        shaken, _ = filtered(shaken, arguments.cutoff)
    q, qd, qdd, _ = differentiated(shaken, arguments.motion)
    made, own = _rms(robot.inverse_dynamics(q, qd, qdd) - tau), _rms(tau) + _rms(robot.gravity_torque(q))
    share = made / np.maximum(own, 1e-3 * own.max())  # a joint that carries nothing is compared with the others
    if share.max() <= NOISY:
        return
    k, worst = int(np.where(share > NOISY, made, 0.0).argmax()), int(sigma.argmax())
    cutoff = suggested_cutoff(given.t, x, sigma)
    cure = "give samples at even steps and --cutoff" if cutoff is None else f"give --cutoff {cutoff:.2g}"
    unit = UNITS["tau"][not rotating(robot)[k]]
    note(
        f"warning: {name}.{robot.joint_names[worst]} scatters by about {sigma[worst]:.1g} from sample to sample, and "
        f"derivatives turn such noise into about {made[k]:.3g} {unit} (rms) on {robot.joint_names[k]}, more than "
        f"{NOISY:.0%} of its torque: {cure}, or give velocities and accelerations"
    )


def _rms(x: Array) -> Array:
    size: Array = np.sqrt((x**2).mean(axis=0))
    return size


def add_view(commands: Any) -> None:
    """Register `rne view`."""
    title = "write a robot or its motion as an HTML page with a 3-D view"
    parser = shared.add_parser(commands, "view", title, VIEW, run_view)
    shared.add_robot(parser)
    parser.add_argument("--motion", metavar="FILE", type=Path, help=f"{COLUMNS}; else the zero position")
    parser.add_argument("--other", metavar="FILE", type=Path, help="a second motion, shown half transparent")
    add_units(parser)
    parser.add_argument("--out", metavar="FILE.html", type=Path, help="page to write (default: <name of ROBOT>.html)")
    shared.add_force(parser)
    parser.add_argument("--speed", type=number, default=1.0, help="seconds of the motion per second (default: 1)")
    parser.add_argument("--frames", action="store_true", help="show the links' frames at first")
    parser.add_argument("--inertia", action="store_true", help="show masses as solids of their inertia at first")


def run_view(arguments: argparse.Namespace) -> int:
    """Write the page, and print its place and size."""
    out = arguments.out or Path(f"{Path(arguments.robot).stem}.html")
    shared.check_file(out, arguments, suffixes=PAGES)
    robot = shared.robot_of(arguments)
    work.begin("reading the motion")
    labels = [plain(file.stem) for file in (arguments.motion or out, arguments.other or out)]
    files = arguments.motion, arguments.other
    motion, other = (None if file is None else _motion(file, robot, arguments) for file in files)
    shown = {name: getattr(arguments, name) for name in ("speed", "frames", "inertia")}
    work.begin("drawing the 3-D page")
    with shared.warnings_in_one_line(arguments):
        if isinstance(motion, rne.Trajectory):
            page = rne.view(motion, out, other=other, labels=labels, **shown)
        else:
            t, q = motion or (None, None)
            page = rne.view(robot, out, q=q, t=t, other=other, labels=labels, **shown)
    say(f"{page.path}: {len(page.html.encode()) / 1e6:.2f} MB")
    return 0


def _motion(file: Path, robot: rne.Robot, arguments: argparse.Namespace) -> rne.Trajectory | tuple[Array, Any]:
    """Motion in a file: with this robot's model, or times and positions."""
    if file.suffix.lower() == ".npz":
        motion = rne.Trajectory.load(file)
        if motion.q.shape[1] != robot.n:
            raise ValueError(f"{file}: robot {robot.model.name!r} has {robot.n} joints, the motion {motion.q.shape[1]}")
        names = () if motion.model is None else motion.model.joint_names
        if names and names != robot.joint_names:
            raise ValueError(f"{file}: the motion is of joints {list(names)}, the robot has {list(robot.joint_names)}")
        return replace(motion, model=robot.model)
    if file.suffix.lower() != ".csv":
        raise ValueError(f"{file}: a motion must be a file ending in .npz or .csv")
    samples = read_motion(file, robot, arguments)
    return samples.t, samples.q


def add_cycle(commands: Any) -> None:
    """Register `rne cycle`."""
    title = "drive through via points in least time and report on the drives"
    parser = shared.add_parser(commands, "cycle", title, CYCLE, run_cycle)
    shared.add_robot(parser)
    columns = "CSV with columns q.<joint>, a row for each via point [rad or m]"
    parser.add_argument("via", metavar="VIA.csv", type=Path, help=columns)
    parser.add_argument("--degrees", action="store_true", help="angles are in degrees")
    parser.add_argument("--stops", action="store_true", help="stand still at every via point")
    each = "one number for all joints or one for each"
    parser.add_argument("--acceleration", metavar="A", type=numbers, help=f"acceleration limits, {each} [rad/s^2]")
    smoothing = "time over which the motion is averaged, 0 for none (default: 0.01, more if jerk limits need it) [s]"
    parser.add_argument("--smoothing", metavar="S", type=number, help=smoothing)
    friction = "friction of the URDF's <dynamics> counts too"
    parser.add_argument("--friction", action="store_const", const="urdf", help=friction)
    options = ("gear", "gear ratios", 1.0), ("rotor", "rotors [kg m^2]", 0.0), ("efficiency", "of the gears, to 1", 1.0)
    for option, text, value in options:
        letter = option[0].upper()
        parser.add_argument(f"--{option}", metavar=letter, type=numbers, default=[value], help=f"{text}, {each}")
    folder = "folder for the page (default: rne-cycle)"
    parser.add_argument("--out", metavar="FOLDER", type=Path, default=Path("rne-cycle"), help=folder)
    shared.add_force(parser)


def run_cycle(arguments: argparse.Namespace) -> int:
    """Plan the motion, print the reports and write the page."""
    from ..plotting.html_page import Report
    from ..plotting.plots import small_plots, torque_speed

    shared.check_folder(arguments.out, arguments)
    robot = shared.robot_of(arguments)
    try:
        if arguments.acceleration is not None:
            robot = robot.with_limits(acceleration=shared.one_or_each(arguments.acceleration))
        q = read_samples(arguments.via, robot.joint_names, needed=["q"], timed=False).q
        assert q is not None
        if len(q) < 2:
            raise CommandError(f"{arguments.via}: a path needs two via points at least, there is one row")
        points = q * np.where(rotating(robot) & arguments.degrees, np.pi / 180, 1.0)
        path = rne.trajectories.through(points, stops=arguments.stops)
        work.begin(f"planning the motion in least time through {len(points)} points, and its drives")
        given = {x: shared.one_or_each(getattr(arguments, x)) for x in ("gear", "rotor", "efficiency")}
        gear, rotor, efficiency = (per_joint_array(name, values, robot.n) for name, values in given.items())
        turned = robot.model.armature.copy()
        turned[list(robot.model.independent_joints)] += rotor * gear**2  # limits hold for loads with their rotors
        options = {"friction": arguments.friction, "smoothing": arguments.smoothing}
        motion = rne.trajectories.fastest(robot.with_armature(turned), path, **options)
        alone = replace(motion.scene, robot=robot)
        report = rne.drives(alone, motion, gear=gear, rotor=rotor, efficiency=efficiency)
    except (ValueError, ImportError) as error:
        raise CommandError(in_one_line(error) + _cure(error, robot)) from None
    work.begin("drawing the page of the cycle")
    page = Report(f"A cycle of {robot.model.name}", say, arguments.out, work.begin)
    page.text(used(robot, arguments))
    t = np.linspace(0, motion.duration, max(int(motion.duration / FILM), 2))
    page.film("motion", (t, motion(t)[0]), "The motion", robot)
    for title, result in (("Motion", motion), ("Drives", report)):
        page.heading(title)
        page.lines(str(result))
    page.figure("torque_speed", lambda: torque_speed(report), "Torque over speed of each joint, with its limits")
    page.heading("Positions, velocities and torques")
    for k, (label, draw) in enumerate(small_plots((report.t, report.q, report.qd, report.qdd, report.tau), robot)):
        page.figure(f"motion_{k}", draw, f"The motion: {label}")
    say(f"page: {page.write()}")
    return 0


def _cure(error: Exception, robot: Any) -> str:
    """Remedy for an error, in terms of the command line."""
    from ..trajectories.time_optimal import MissingLimit, OutOfRange

    if isinstance(error, MissingLimit):
        return "; on the command line: --effort or --acceleration"
    if isinstance(error, MissingColumn):
        return f"; the first row must be {','.join(f'q.{name}' for name in robot.joint_names)}"
    return "; if the positions are in degrees, give --degrees" if isinstance(error, OutOfRange) else ""


def add_units(parser: argparse.ArgumentParser) -> None:
    """Add the options for the units of a CSV file."""
    parser.add_argument("--degrees", action="store_true", help="q, qd and qdd of rotating joints are in degrees")
    unit = "unit of the times (default: seconds; another one is guessed by rne identify, else refused)"
    parser.add_argument("--time-unit", choices=("s", "ms", "us", "ns"), help=unit)


def read_motion(file: Path, robot: rne.Robot, arguments: argparse.Namespace) -> Samples:
    """Positions, and rates if known, in a CSV file in the units of `add_units`; doubtful units are refused or noted."""
    heading = ",".join(["t", *(f"q.{joint}" for joint in robot.joint_names)])
    needed = f"; the first row must be {heading}, with qd. and qdd. of the joints if they are known"
    try:
        samples = read_samples(file, robot.joint_names)
    except ValueError as error:
        raise CommandError(in_one_line(error) + needed * isinstance(error, MissingColumn)) from None
    if samples.q is None:
        raise CommandError(f"{file}: there are no positions{needed}")
    unit = np.where(rotating(robot) & arguments.degrees, np.pi / 180, 1.0)
    q = samples.q * unit
    qd, qdd = (None if x is None else x * unit for x in (samples.qd, samples.qdd))
    cure = "give --time-unit {}, or s if they are seconds"
    t = in_seconds(file, Samples(samples.t, q, qd), arguments.time_unit, cure, robot.velocity_limit).t
    if qd is not None and len(t) >= SPIKED and not 1 / FACTOR < (ratio := velocity_ratio(t, q, qd) or 1.0) < FACTOR:
        note(f"warning: qd is {ratio:.3g} times the differences of q over those of t; check their units and signs")
    _warn_of_degrees(q, robot)
    for joint, held in (arguments.locked or {}).items():
        with suppress(MissingColumn):
            unused = np.asarray(read_samples(file, [joint], needed=("q",)).q)
            between = f"from {unused.min():.6g} to {unused.max():.6g}"
            note(f"warning: column 'q.{short(joint)}', {between}, is not used: --locked holds the joint at {held:g}")
    return Samples(t, q, qd, qdd)


def rotating(robot: rne.Robot) -> Array:
    """True for each joint that rotates, shape (n,)."""
    return np.asarray(robot.model.is_revolute)[list(robot.model.independent_joints)]


def _warn_of_degrees(q: Array, robot: rne.Robot) -> None:
    """Warn if a joint is more than a turn beyond its range, and all joints are within theirs with q in degrees."""
    beyond = np.where(rotating(robot), np.maximum(robot.lower - q, q - robot.upper).max(axis=0), 0.0)
    radians = np.where(rotating(robot), np.radians(q), 0.0)
    inside = ((robot.lower <= radians) & (radians <= robot.upper)) | ~rotating(robot)
    if (beyond > TURN).any() and inside.all():
        k = int(beyond.argmax())
        note(
            f"warning: q.{robot.joint_names[k]} is up to {np.abs(q[:, k]).max():.4g} rad, more than a turn beyond the "
            "joint's range; if q is in degrees, give --degrees"
        )


def refuse_wrapped_angles(motion: Samples, robot: rne.Robot, file: Path) -> None:
    """Refuse a jump by about a turn between small steps: its derivative would be a huge velocity."""
    if motion.q is None or len(motion.t) < 3:
        return
    for k in np.flatnonzero(rotating(robot)):
        step = np.diff(motion.q[:, k])
        beside = np.pad(np.abs(step), 1)
        beside = np.maximum(beside[:-2], beside[2:])
        wrapped = np.flatnonzero((np.abs(np.abs(step) - TURN) < TURN / 4) & (beside < TURN / 4))
        if len(wrapped):
            i = wrapped[0]
            raise CommandError(
                f"{file}: q.{robot.joint_names[k]} jumps by {step[i]:.4g} rad between t = {motion.t[i]:.6g} s and "
                f"{motion.t[i + 1]:.6g} s, as wrapped angles do; unwrap them, for example by numpy.unwrap"
            )


def differentiated(motion: Samples, file: Path) -> tuple[Array, Array, Array, str]:
    """Positions, velocities and accelerations, by splines where the file has none, and a line on their source."""
    t, q, qd, qdd, _ = motion
    assert q is not None
    if qd is not None and qdd is not None:
        return q, qd, qdd, f"q, qd and qdd from {file}"
    try:
        path = rne.trajectories.spline(t, q if qd is None else qd)
    except ValueError as error:
        what = "velocities and accelerations" if qd is None else "accelerations"
        raise CommandError(f"{file}: {what} are missing, and no spline gives them: {in_one_line(error)}") from None
    _, first, second = path(t)
    kind = f"spline of degree {path.degree}"
    if qd is not None:
        return q, qd, first, f"q and qd from {file}; qdd: derivative of a {kind} through qd"
    if qdd is not None:
        return q, first, qdd, f"q and qdd from {file}; qd: derivative of a {kind} through q"
    return q, first, second, f"q from {file}; qd and qdd: derivatives of a {kind} through q"


def noise(t: Array, x: Array) -> Array:
    """Standard deviation of white noise in samples of smooth motions; zero where there is none, or too few samples."""
    if len(t) < FEW:
        return np.zeros(x.shape[1])
    low, high = (_scatter(t, x, order) for order in ORDERS)
    return np.where(high > STEADY * low, np.minimum(low, high), 0.0)


def _scatter(t: Array, x: Array, order: int) -> Array:
    """Standard deviation of the noise by the median of divided differences, without zeros, as at rest.

    In differences of high order a smooth motion nearly vanishes; divided by the norm of their weights they have the
    standard deviation of the noise. The median ignores the corners of a motion.
    """
    every = slice(None, None, 1 + len(t) // WINDOWS)
    times = np.lib.stride_tricks.sliding_window_view(t, order + 1)[every]
    times = (times - times[:, :1]) / (times[:, -1:] - times[:, :1])
    weights = 1 / (times[:, :, None] - times[:, None, :] + np.eye(order + 1)).prod(-1)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    windows = np.lib.stride_tricks.sliding_window_view(x, order + 1, axis=0)[every]
    size = np.abs(np.einsum("kp,kjp->kj", weights, windows))
    return np.array([np.median(column[column > 0]) if column.any() else 0.0 for column in size.T]) / MEDIAN


def filtered(motion: Samples, cutoff: float) -> tuple[Samples, str]:
    """Motion after the filter of `rne.basics.filters`, and a line on the change of q."""
    step = _even_step(motion.t)
    if step is None:
        raise CommandError("--cutoff: needs times at even steps")
    if not 0 < cutoff < 0.5 / step:
        raise CommandError(f"--cutoff: must be between 0 and {0.5 / step:g} Hz, half the sampling rate; got {cutoff:g}")
    smooth = Samples(motion.t, *(x if x is None else low_pass(x, cutoff, 1 / step, ends=True) for x in motion[1:]))
    assert smooth.q is not None
    change = np.abs(smooth.q - motion.q).max(initial=0.0)
    return smooth, f"zero-phase Butterworth filter of {cutoff:g} Hz; it changes q by at most {change:.2g} rad or m"


def _even_step(t: Array) -> float | None:
    """Time between samples, None if it varies."""
    steps = np.diff(t)
    return float(steps.mean()) if len(steps) and np.ptp(steps) <= EVEN * steps.mean() else None


def suggested_cutoff(t: Array, x: Array, sigma: Array) -> float | None:
    """Lowest cut-off at which a filter removes no more than the noise [Hz]; None if steps vary.

    Spectra, by which `rne.identify` chooses one, scatter too much in files no longer than a few of their windows.
    Residual analysis: D. A. Winter, Biomechanics and Motor Control of Human Movement, 4th ed., 2009, chapter 3.
    """
    step = _even_step(t)
    if step is None:
        return None
    for cutoff in np.geomspace(1 / len(t), 0.45, 40):
        residual = np.sqrt(((x - low_pass(x, cutoff, 1.0, ends=True)) ** 2).mean(axis=0))
        if (residual <= RESIDUAL * sigma)[sigma > 0].all():
            return float(cutoff / step)
    return None


def warn_of_uneven_steps(t: Array) -> None:
    """Warn if some samples are much closer than others: derivatives amplify their rounding."""
    shortest, longest = np.diff(t).min(initial=np.inf), np.diff(t).max(initial=0.0)
    if longest > UNEVEN * shortest:
        note(
            f"warning: the times are {shortest:.2g} to {longest:.2g} s apart; where they are close, derivatives "
            "amplify the rounding of the samples: give samples at even times, or velocities and accelerations"
        )
