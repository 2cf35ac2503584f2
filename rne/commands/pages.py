"""Pages of the main job, on the ABB IRB 140, and of `rne report`, on any robot; speed and accuracy."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import rne

from ..basics.arrays import UNBOUNDED
from ..basics.spatial import Array
from ..basics.text import listed
from ..control.gains import workspace
from ..model.abb_irb140 import KD, KP
from ..plotting.html_page import Report, log_axis
from ..plotting.notebook import BODIES, body_table, joint_table
from ..plotting.plots import BELOW, WIDTH, blank_figure
from ..plotting.robot_picture import small_picture
from ..simulation.trajectory import Trajectory, between
from .agreement import ROUNDING, Match, has_pinocchio, random_states, relative, validate
from .oracle import Oracle, each
from .shared import units_of, work

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAMPLES = 1000  # number of random states
SWING, MAIN_SWING = 2.0, 10.0  # durations of free swings [s]
HANGING = np.array([0, 3, 0, 0.3, 0.5, 0])  # positions near which every joint swings and none spins [rad]
STRETCHED_OUT = np.array([0, np.pi / 2, -np.pi / 2, 0, 0, 0])  # stretched out horizontally: (6.19) [rad]
SETTLED = 0.01  # error of a settled joint [rad]
TARGET, LOOP = np.array([1, 0.5, -1, 2, 1, -2]), 5.0  # [rad], duration [s]: within all limits of the arm
PUSH = 1.0  # acceleration by torques of a joint that gravity hardly moves [rad/s^2 or m/s^2]
INVERSE, FORWARD = "inverse dynamics", "forward dynamics"
STATES, SINGLES, COMPARED, TURNS = 1000, 100, 50, 15
ONE, BATCH = "one state per call", f"{STATES} states per call"
NUMPY, MACHINE_CODE, PINOCCHIO = "rne, NumPy", "rne, machine code", "Pinocchio"
COUNTS = {ONE: SINGLES, BATCH: STATES}  # states of a timed call
FUNCTIONS: dict[str, Any] = {INVERSE: rne.dynamics.inverse_dynamics, FORWARD: rne.dynamics.forward_dynamics}
COLORS = {MACHINE_CODE: "C2", NUMPY: "C0", PINOCCHIO: "C1"}
MOVED, SHAPES = 3, 5  # joints that move with the least torque, and shapes of the motion of each
Way = tuple[str, str, Callable[[], object], Callable[[], Array]]  # form, program, timed call, results of first states
WHAT = (
    "An industrial arm of six joints moves from its zero position to a target. Each motor torque is that of a spring "
    "and a damper towards the target, plus what carries the weight of the arm (PD control with gravity compensation). "
    "The recursive Newton-Euler algorithm computes at each instant the accelerations that follow from masses, "
    "velocities and motor torques, and a solver integrates them."
)
MODEL = (
    "Lengths, masses and gains are those of H. Høifødt's thesis (NTNU, 2011), where links are solid cylinders; the "
    "housings are drawn to its lengths. Friction, gears and ABB's own masses are not in it."
)
SPEED = (
    "Times are medians of calls in turn, on one core, measured while this page was made. The error is the largest of "
    "50 states, against the recursion in long double, relative to each state's largest entry."
)
RELATIVE = " In brackets: relative to Pinocchio, with 1000 states to the faster of its two calls."
LEAST = (
    "Joints 1 to 3 turn to the same target in 1 s, from rest to rest. Along a polynomial of degree 5 in time the mean "
    "squared torque is {:.0f} (N m)². Along the best polynomial of degree 10 it is {:.0f} (N m)². The search took "
    "{:.2g} s, {} steps with exact derivatives. Finite differences would take {} more evaluations of the motion in "
    "each step, and are less accurate: at best they are wrong by {:.0e} of the largest derivative, with steps of "
    "{:.0e} rad."
)


def write_main_page(folder: Path, say: Callable[[str], None]) -> bool:
    """Run the main job and write its page; True if all differences from the source are within their bounds."""
    started = time.perf_counter()
    page = Report("An ABB IRB 140, simulated and checked", say, folder, work.begin)
    with page.kept_if_interrupted():
        held = _main_job(rne.load("irb140"), page)
    page.text(f"Made in {time.perf_counter() - started:.0f} s by rne {rne.__version__}.")
    say(f"page: {page.write()}")
    return held


def _main_job(robot: rne.Robot, page: Report) -> bool:
    rest = np.zeros(robot.n)
    law = rne.control.pd_gravity(robot, KP, KD, TARGET)
    page.say("simulating a motion to a target and a free swing, and comparing random states")
    work.begin("simulating two motions")
    motion = rne.simulate(robot, rest, rest, LOOP, torque=law)
    swing = rne.simulate(robot, HANGING, rest, MAIN_SWING, rtol=1e-9)
    work.begin(f"comparing {SAMPLES} random states")
    source, rows = validate(robot, SAMPLES)
    place = listed([f"{x:g}" for x in TARGET])
    page.film("motion", motion, f"The simulated motion, from zero to ({place}) rad, in real time.")
    page.text(WHAT)
    settled = settling_time(motion, TARGET, between(motion.t))
    fastest = (np.abs(motion.qd).max(axis=0) / robot.velocity_limit).max()
    page.text(
        f"From {settled:.2f} s on every joint stays within {SETTLED:g} rad of its target. {_run(motion)} The fastest "
        f"joint reaches {fastest:.0%} of its velocity limit. {MODEL}"
    )
    worst = {row.quantity: row.worst for row in rows}
    page.text(
        f"How the results are checked: torques of {SAMPLES} random states agree with {source} within "
        f"{worst['inverse dynamics']:.0e} of the largest. In a free swing of {MAIN_SWING:g} s, without motors and "
        f"friction, the energy is constant within {swing.energy_drift:.0e} J, while {np.ptp(swing.kinetic):.0f} J "
        "change from potential to kinetic energy and back."
    )
    page.heading("The motion to the target")
    page.motion("motion", motion, "Motion to the target")
    page.heading("Speed and accuracy on this machine")
    work.begin("measuring times of each way to compute")
    found = measured_speed(robot)
    page.text(SPEED + RELATIVE * any(m.who == PINOCCHIO for m in found))
    page.figure("speed", lambda: plot_speed(found), "Largest error over time per state; lower left is better.")
    heads, *cells = speed_table(found)
    page.table(heads, cells)
    held = _compared(source, rows, False, page)
    page.heading(f"A free swing of {MAIN_SWING:g} s")
    page.text(
        f"Without motors, friction and stops at the limits of joints, the arm swings from rest, hanging from its base, "
        f"at q = ({', '.join(f'{x:g}' for x in HANGING)}) rad. {_run(swing)}"
    )
    page.motion("swing", swing, "Free swing")
    page.heading("The motion with the least torque")
    work.begin("searching for the motion with the least torque")
    _least_torque(robot, TARGET[:MOVED], page)
    page.heading("Torques against gravity")
    _gravity(robot, STRETCHED_OUT, "with the arm stretched out horizontally", page)
    _parts(robot, page)
    return held


def _run(motion: Trajectory) -> str:
    """Sentences on a simulation: the solver, its error, and limits of the model that the motion exceeds."""
    exceeded: dict[str, list[str]] = {}  # joints by quantity
    for violation in motion.check_limits():
        exceeded.setdefault(violation.quantity, []).append(violation.joint)
    beyond = "; ".join(f"{kind} of {listed(list(dict.fromkeys(names)))}" for kind, names in exceeded.items())
    limits = (
        f"Limits of the model that the motion exceeds: {beyond}." if beyond else "No limit of the model is exceeded."
    )
    return (
        f"{motion.method} took {motion.evaluations} evaluations of the accelerations; the energy balance is met within "
        f"{motion.energy_drift:.1g} J. {limits}"
    )


def _least_torque(robot: rne.Robot, target: Array, page: Report) -> None:
    """Find the motion of the first joints with the least mean squared torque, by exact derivatives."""
    from numpy.polynomial import Polynomial
    from scipy.optimize import least_squares

    arm, none = robot.locked(dict.fromkeys(robot.joint_names[MOVED:], 0.0)), np.zeros(SHAPES * MOVED)
    t, s = np.linspace(0, 1, 101), Polynomial([0, 1])
    guess = rne.trajectories.quintic(0 * target, target, 1.0)(t)
    shapes = [64 * s ** (3 + k) * (1 - s) ** 3 for k in range(SHAPES)]  # that leave both ends at rest
    basis = np.array([[shape.deriv(k)(t) for shape in shapes] for k in range(3)])  # q, qd and qdd of each shape

    def states(c: Array) -> Any:
        return guess + np.einsum("akt,ki->ati", basis, c.reshape(SHAPES, MOVED))

    def torques(c: Array) -> Array:
        return arm.inverse_dynamics(*states(c)).ravel()

    def derivatives(c: Array) -> Array:
        tensors = np.einsum("atij,akt->tikj", arm.inverse_dynamics_derivatives(*states(c)), basis)
        return np.reshape(tensors, (-1, c.size))

    begun = time.perf_counter()
    found, taken = least_squares(torques, none, derivatives), time.perf_counter() - begun
    both = np.array([torques(none), found.fun]).reshape(2, len(t), MOVED)
    steps, exact = np.logspace(0, -12, 25), derivatives(none).sum(-1)
    differences = [(torques(none + h) - torques(none - h)) / (2 * h) for h in steps]
    errors = np.abs(differences - exact).max(-1) / np.abs(exact).max()
    best = errors.argmin()
    squares = (both**2).sum(-1).mean(-1)
    page.text(LEAST.format(*squares, taken, found.nfev, 2 * none.size, errors[best], steps[best]))
    page.figure("least", lambda: _plot_torques(t, both, arm.joint_names), "Torques along both motions.")
    page.figure("differences", lambda: _plot_errors(steps, errors), "Error of finite differences over their step.")


def _plot_torques(t: Array, both: Array, names: Sequence[str]) -> Figure:
    figure = blank_figure(WIDTH, 4.6)
    panels = figure.subplots(len(names), 1, sharex=True)
    for ax, name, curves in zip(panels, names, both.transpose(2, 1, 0), strict=True):
        ax.plot(t, curves, label=["degree 5", "least torque"])
        ax.set_title(f"{name}: torque [N m]")
    panels[-1].set_xlabel("time [s]")
    figure.legend(*panels[0].get_legend_handles_labels(), **BELOW)
    return figure


def _plot_errors(steps: Array, errors: Array) -> Figure:
    figure = blank_figure(WIDTH, 2.6)
    ax = figure.subplots()
    ax.plot(steps, errors, "o-")
    ax.set(xscale="log", title="finite differences: relative error", xlabel="difference [rad]")
    ax.set_xticks(steps[::8])
    log_axis(ax)
    ax.xaxis.set_major_formatter("{x:.0e}")
    return figure


def write_robot_page(robot: rne.Robot, findings: str, folder: Path, say: Callable[[str], None]) -> bool:
    """Write a robot's page with the findings in its file; False if a difference exceeds its bound or M is singular."""
    page = Report(f"Robot {robot.model.name}", say, folder, work.begin)
    with page.kept_if_interrupted():
        held = _examination(robot, findings, page)
    say(f"page: {page.write()}")
    return held


def _examination(robot: rne.Robot, findings: str, page: Report) -> bool:
    """Examine a motion, the robot's components, agreement with Pinocchio or the energies, and torques by gravity."""
    work.begin(f"searching where gravity pulls hardest, in {SAMPLES} positions, and simulating a swing from there")
    q, torque = moving_start(robot)
    motion = _swing(robot, q, torque, page)
    for line in repr(robot).splitlines():
        page.text(line.strip())
    if findings:
        page.heading("Findings in the file")
        for line in findings.splitlines():
            page.text(line)
    work.begin(f"comparing {SAMPLES} random states")
    within = _comparison(robot, page)
    page.heading("Torques against gravity")
    _gravity(robot, q, "at the start of the swing", page)
    if motion is not None:
        page.heading("The free swing")
        page.text(_run(motion))
        page.motion("swing", motion, "Free swing")
    _parts(robot, page)
    return within


def _swing(robot: rne.Robot, q: Array, torque: Array, page: Report) -> Trajectory | None:
    """Show a swing under gravity and constant torques; None if it cannot be simulated."""
    place = f"q = ({', '.join(f'{x:.3g}' for x in q)})"
    turns = robot.model.is_revolute[list(robot.model.independent_joints)]
    names = np.array(robot.joint_names, dtype=object)
    held = list(names[~turns]) if turns.any() else []  # without stops they would slide away
    moves = np.isin(names, held, invert=True)
    moving = robot.locked(dict(zip(held, q[~moves], strict=True))) if held else robot
    try:
        motion = rne.simulate(moving, q[moves], np.zeros(moving.n), SWING, torque=torque[moves])
    except (rne.SimulationError, rne.SingularMassMatrixError) as error:
        page.figure("robot", lambda: small_picture(robot, q), f"The robot at {place}")
        page.text(f"The swing cannot be simulated: {error}")
        return None
    page.film("swing", motion, f"The free swing of {robot.model.name}, in real time.")
    chosen = f"Of {SAMPLES} random positions this is where gravity pulls hardest."
    page.text(f"It swings for {SWING:g} s from rest at {place}, without friction and limits. {chosen}")
    pushed = ", ".join(f"{n} by {x:.3g}" for n, x in zip(moving.joint_names, torque[moves], strict=True) if x)
    if pushed:
        page.text(f"Joints that gravity hardly moves are pushed [{units_of(moving, 'N m', 'N')}]: {pushed}.")
    if held:
        page.text(f"Sliding joints are held: {', '.join(held)}.")
    return motion


def moving_start(robot: rne.Robot) -> tuple[Array, Array]:
    """Position of large gravity torques relative to each joint's largest; torques that push joints of small ones."""
    q = _positions(robot)
    g, inertia = robot.gravity_torque(q), np.diagonal(robot.mass_matrix(q), axis1=1, axis2=2)
    largest = np.abs(g).max(axis=0, initial=0.0)
    k = int((np.abs(g) / np.where(largest > 0, largest, 1.0)).sum(axis=1).argmax())
    weak = np.abs(g[k]) < PUSH * inertia[k]
    return q[k], np.where(weak, PUSH * inertia[k], 0.0)


def _parts(robot: rne.Robot, page: Report) -> None:
    page.heading("Joints and links")
    heads, *rows = joint_table(robot.model)
    page.table(heads, rows)
    page.text(BODIES)
    heads, *rows = body_table(robot.model)
    page.table(heads, rows)


def _comparison(robot: rne.Robot, page: Report) -> bool:
    try:
        source, rows = validate(robot, SAMPLES, by_terms=True)
    except rne.SingularMassMatrixError as error:
        page.heading("Comparison")
        page.text(f"Not compared, as forward dynamics do not exist: {error}.")
        return False
    return _compared(source, rows, True, page)


def _compared(source: str, rows: Sequence[Match], by_terms: bool, page: Report) -> bool:
    """Print the differences of the results; True if all are within their bounds."""
    entry, bound, eps = "term" if by_terms else "entry", rows[0].bound, np.finfo(float).eps
    page.heading(f"Comparison with {source.partition(' (')[0]}")
    page.text(
        f"Largest difference from {source} over {SAMPLES} random states with velocities up to 10 rad/s or m/s, "
        f"relative to the largest {entry} of each state. Both computations round: differences are expected within "
        f"{bound:.0e}, which is {float(f'{bound / eps:.2g}'):g} roundings; for accelerations 1e-13, or one rounding "
        "times the condition number of the mass matrix, where this is more. Forward after inverse: accelerations from "
        "the torques that inverse dynamics gives."
    )
    cells = [[x.quantity, f"{x.worst:.1e}", f"{x.bound:.1e}", "yes" if x.worst <= x.bound else "NO"] for x in rows]
    page.table(["quantity", "largest difference", "bound", "within bound"], cells)
    return all(row.worst <= row.bound for row in rows)


def carried_masses(model: rne.Model) -> Array:
    """Mass carried by each joint: the body that it moves and all bodies beyond, shape (nb,) [kg]."""
    carried = model.mass.copy()
    for i in reversed(range(model.nb)):
        if model.parent[i] >= 0:
            carried[model.parent[i]] += carried[i]
    return carried


def _gravity(robot: rne.Robot, q: Array, place: str, page: Report) -> None:
    holding = robot.gravity_torque(q)
    largest = np.abs(robot.gravity_torque(np.vstack([_positions(robot), q]))).max(axis=0)
    rounding = ROUNDING * largest.max(initial=0.0)
    carried = carried_masses(robot.model)[list(robot.model.independent_joints)]
    unit = units_of(robot, "N m", "N")
    page.text(f"Torques {place}, and the largest of these and of {SAMPLES} random positions in the joints' ranges:")
    numbers = zip(robot.joint_names, carried, holding, largest, robot.effort_limit, strict=True)
    heads = ["joint", "mass behind the joint [kg]", f"at that position [{unit}]", f"largest [{unit}]"]
    rows = [
        [name, f"{mass:g}", *(f"{x:.5g}" if abs(x) > rounding else "0" for x in (hold, most)), _share(most, bound)]
        for name, mass, hold, most, bound in numbers
    ]
    known = 5 if (robot.effort_limit < UNBOUNDED).any() else 4  # columns
    page.table([*heads, "largest / effort"][:known], [row[:known] for row in rows])


def _positions(robot: rne.Robot) -> Array:
    """Random positions within the ranges of the joints."""
    low, high = workspace(robot)
    return np.random.default_rng(0).uniform(np.minimum(low, high), np.maximum(low, high), (SAMPLES, robot.n))


def _share(most: float, effort: float) -> str:
    if effort == 0:
        return "the drive has none"
    return f"{most / effort:.0%}" if effort < UNBOUNDED else "effort unknown"


def settling_time(motion: Trajectory, reference: ArrayLike, times: Array | None = None) -> float:
    """First sample or given time after which all joints stay within 0.01 rad of the reference [s], infinity if none."""
    t, q = (motion.t, motion.q) if times is None else (times, motion(times)[0])
    outside = np.flatnonzero((np.abs(q - np.asarray(reference)) > SETTLED).any(axis=1))
    return float(np.append(t, np.inf)[outside[-1] + 1 if len(outside) else 0])


class Measured(NamedTuple):
    """Time per state of an implementation [s], and its largest error relative to each state's largest entry."""

    quantity: str
    form: str
    who: str
    seconds: float
    error: float


def measured_speed(robot: rne.Robot) -> list[Measured]:
    """Time all implementations in turn and take medians, so that changes of the machine's speed affect all alike."""
    found: list[Measured] = []
    for quantity, function in FUNCTIONS.items():
        q, qd, x = random_states(robot.n, STATES)
        arrays = [q, qd, x if quantity == INVERSE else robot.inverse_dynamics(q, qd, x)]
        ways = [*_own(robot, function, arrays), *_of_pinocchio(robot, quantity, arrays)]
        seconds: list[list[float]] = [[] for _ in ways]
        for _ in range(1 + TURNS):
            for (form, _, call, _), times in zip(ways, seconds, strict=True):
                begun = time.perf_counter()
                call()
                times.append((time.perf_counter() - begun) / COUNTS[form])
        # Long double has three decimal digits more on most machines.
        exact = function(robot.model.astype(np.longdouble), *[x[:COMPARED].astype(np.longdouble) for x in arrays])
        for (form, who, _, results), times in zip(ways, seconds, strict=True):  # the first turn warms up
            found.append(Measured(quantity, form, who, median(times[1:]), relative(results(), exact)))
    return found


def _own(robot: rne.Robot, function: Any, arrays: list[Array]) -> Iterator[Way]:
    """Implementations by both engines, machine code where it can be made."""
    compiles = importlib.util.find_spec("llvmlite") is not None
    for who, engine in ((NUMPY, "numpy"), (MACHINE_CODE, "numba"))[: 1 + compiles]:
        kernel: Any = rne.Robot(robot.model, engine).kernel(function)
        out = kernel(*arrays)
        yield _singles(who, kernel, arrays)
        yield BATCH, who, partial(kernel, *arrays, out=out), partial(out.__getitem__, slice(COMPARED))


def _of_pinocchio(robot: rne.Robot, quantity: str, arrays: list[Array]) -> Iterator[Way]:
    """Implementations by Pinocchio's `rnea` and `aba`, one state or many, on one thread; in its order and layout."""
    if robot.model.couplings or not has_pinocchio():
        return
    oracle = Oracle(robot.model, rne.to_urdf(robot.model))
    pin, model, data = oracle.pin, oracle.theirs, oracle.data
    one, many = (pin.rnea, pin.rneaInParallel) if quantity == INVERSE else (pin.aba, pin.abaInParallel)
    q, *others = arrays
    theirs = [each(oracle.q, q), *(each(oracle.velocities, x) for x in others)]
    columns, out = [np.asfortranarray(x.T) for x in theirs], np.zeros((model.nv, len(q)), order="F")
    pool = pin.ModelPool(model, 1)
    yield _singles(PINOCCHIO, partial(one, model, data), theirs, oracle.torque)
    yield BATCH, PINOCCHIO, partial(many, 1, pool, *columns, out), lambda: each(oracle.torque, out.T[:COMPARED])


def _singles(who: str, call: Callable[..., Any], arrays: Sequence[Array], turn: Callable[..., Array] = np.array) -> Way:
    """Loop over states in separate arrays; `turn` brings a result into our order."""
    states = [[x[k].copy() for x in arrays] for k in range(SINGLES)]

    def run() -> None:
        for state in states:
            call(*state)

    return ONE, who, run, lambda: np.array([turn(call(*x)) for x in states[:COMPARED]])


def speed_table(found: Sequence[Measured]) -> list[list[str]]:
    """Time per state of each quantity and program, relative to the shortest of Pinocchio's there, and the error."""
    rows = [["quantity", "computed by", ONE, BATCH, "largest error"]]
    for quantity, who in product(dict.fromkeys(m.quantity for m in found), COLORS):
        of = {(m.who, m.form): m for m in found if m.quantity == quantity}
        cells = []
        for form, theirs in ((ONE, [ONE]), (BATCH, [ONE, BATCH])):
            if measured := of.get((who, form)):
                best = min((of[PINOCCHIO, x].seconds for x in theirs if (PINOCCHIO, x) in of), default=0.0)
                ratio, side = best / measured.seconds, "faster"
                if ratio < 1:
                    ratio, side = 1 / (ratio or 1), "slower"
                compared = f" ({ratio:.1f}× {side})" if best and who != PINOCCHIO else ""
                cells.append(f"{1e6 * measured.seconds:.3g} µs{compared}")
        if cells:
            error = max(m.error for (by, _), m in of.items() if by == who)
            rows.append([quantity, who, *cells, f"{error:.1e}"])
    return rows


def plot_speed(found: Sequence[Measured]) -> Figure:
    """Error against time per state, a panel for each quantity."""
    figure = blank_figure(WIDTH, 4.6)
    figure.suptitle(f"× {ONE}, ● {BATCH}")
    for ax, quantity in zip(figure.subplots(2, 1, sharex=True), (INVERSE, FORWARD), strict=True):
        shown = [m for m in found if m.quantity == quantity]
        for m in shown:
            marker, label = ("o", m.who) if m.form == BATCH else ("x", "_")
            look = {"color": COLORS[m.who], "marker": marker, "markersize": 8, "linestyle": ""}
            ax.plot(1e6 * m.seconds, m.error, label=label, **look)
        ax.set(xscale="log", title=f"{quantity}: largest error, relative")
        log_axis(ax)
        ax.margins(x=0.15)
        decades = np.floor(np.log10([max(m.error, 1e-17) for m in shown]))
        ax.set_ylim(0.6 * 10.0 ** decades.min(), 10.0 ** (decades.max() + 1))
        ax.xaxis.set_major_formatter("{x:g}")
    ax.set_xlabel("time per state [µs]")
    figure.legend(*ax.get_legend_handles_labels(), **BELOW)
    return figure
