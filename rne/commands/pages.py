"""The pages of the main job, on the ABB IRB 140, and of `rne report`, on any robot; speed beside accuracy."""

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
from ..control.gains import workspace
from ..model.abb_irb140 import CLOSED_LOOPS, KD, KP
from ..plotting.html_page import Report, log_axis
from ..plotting.notebook import BODIES, body_table, joint_table
from ..plotting.plots import BELOW, WIDTH, blank_figure, small_plots
from ..plotting.robot_picture import small_picture
from ..simulation.trajectory import Trajectory, between, trajectory_lines
from .agreement import ROUNDING, Match, has_pinocchio, random_states, relative, validate
from .oracle import Oracle, each
from .shared import units_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAMPLES = 1000  # random states
SWING, MAIN_SWING = 2.0, 10.0  # durations of free swings [s]
HANGING = np.array([0, 3, 0, 0.3, 0.5, 0])  # [rad], nearly: where every joint swings and none spins
STRETCHED_OUT = np.array([0, np.pi / 2, -np.pi / 2, 0, 0, 0])  # [rad], horizontally: (6.19)
SETTLED = 0.01  # [rad], every joint
PUSH = 1.0  # [rad/s^2 or m/s^2], of a joint that gravity hardly moves
INVERSE, FORWARD = "inverse dynamics", "forward dynamics"
STATES, SINGLES, COMPARED, TURNS = 1000, 100, 50, 15
ONE, BATCH = "one state a call", f"{STATES} states a call"
NUMPY, MACHINE_CODE, PINOCCHIO = "rne, NumPy", "rne, machine code", "Pinocchio"
COLORS = {MACHINE_CODE: "C2", NUMPY: "C0", PINOCCHIO: "C1"}
MOVED, SHAPES = 3, 5  # joints that move with the least torque, and shapes of the motion of each
WHAT = (
    "An industrial arm of six joints turns from its zero position to a target. Each motor pulls towards the target "
    "like a spring with a damper, and carries the weight of the arm (PD control with gravity compensation). Nothing is "
    "recorded: at each instant the recursive Newton-Euler algorithm gives the accelerations that follow from masses, "
    "velocities and motor torques, and a solver adds them up."
)
MODEL = (
    "Lengths, masses and gains are those of H. Høifødt's thesis (NTNU, 2011), where links are solid cylinders; the "
    "housings are drawn to its lengths. Friction, gears and ABB's own masses are not in it."
)
FAST = (
    "Joints 4 and 6 go faster than their velocity limits: their targets are half a turn away, and with these gains a "
    "joint of little inertia moves at kp/kd times that distance, {:.1f} and {:.1f} rad/s. Limits are compared with the "
    "motion; they do not act on it."
)
SPEED = (
    "Measured while this page was made: medians of calls that took turns, on one core. The error is that of the worst "
    "of 50 states against the recursion in long double, relative to its largest entry."
)
BESIDE = " Every time is compared with the shortest of Pinocchio's in the same table."
LEAST = (
    "Joints 1 to 3 turn to the target above in 1 s, from rest to rest. Along a polynomial of degree 5 in time the mean "
    "squared torque is {:.0f} (N m)². The best polynomial of degree 10 needs {:.0f} (N m)²; it was found in {:.2g} s, "
    "in {} steps with exact derivatives. Finite differences would take {} further motions in each step, and a step "
    "whose size must be guessed: at best they are off by {:.0e} of the largest, with steps of {:.0e} rad."
)


def write_main_page(folder: Path, say: Callable[[str], None]) -> bool:
    """Run the main job and write its page; True if all differences from the source are within their bounds."""
    started = time.perf_counter()
    page = Report("An ABB IRB 140 moves, and why to believe it", say, folder)
    with page.kept_if_interrupted():
        held = _main_job(rne.load("irb140"), page)
    page.text(f"Made in {time.perf_counter() - started:.0f} s.")
    say(f"page: {page.write()}")
    return held


def _main_job(robot: rne.Robot, page: Report) -> bool:
    loop, rest = CLOSED_LOOPS[0], np.zeros(robot.n)
    law = rne.control.pd_gravity(robot, KP, KD, loop.reference)
    page.say("simulating two motions and comparing random states")
    motion = rne.simulate(robot, loop.start, rest, loop.duration, torque=law)
    swing = rne.simulate(robot, HANGING, rest, MAIN_SWING, rtol=1e-9)
    source, rows = validate(robot, SAMPLES)
    page.film("motion", motion, "The arm moves from its zero position to a target")
    page.text(WHAT)
    worst = {row.quantity: row.worst for row in rows}
    page.text(
        f"Why to believe it: torques of {SAMPLES} random states agree with {source} within "
        f"{worst['inverse dynamics']:.0e} of the largest. In a free swing of {MAIN_SWING:g} s, where no motor and no "
        f"friction changes the energy, it stays within {swing.energy_drift:.0e} J, while {np.ptp(swing.kinetic):.0f} J "
        f"change from potential to kinetic energy and back. {MODEL}"
    )
    page.heading("Speed beside accuracy, on this machine")
    found = measured_speed(robot)
    who = dict.fromkeys(measured.way.who for measured in found)
    page.text(SPEED + BESIDE * (PINOCCHIO in who))
    page.figure("speed", lambda: plot_speed(found), f"Error against time per state: {', '.join(who)}")
    for title, (heads, *cells) in speed_tables(found).items():
        page.text(f"{title[0].upper()}{title[1:]}:")
        page.table(heads, cells)
    held = _compared(source, rows, False, page)
    page.heading("The motion with the least torque, found on this machine")
    _least_torque(robot, np.array(loop.reference[:MOVED]), page)
    page.heading("The motion above")
    settled = settling_time(motion, loop.reference, between(motion.t))
    page.text(f"From {settled:.2f} s on every joint stays within {SETTLED:g} rad of its target.")
    page.lines("\n".join(trajectory_lines(motion)))
    page.text(FAST.format(*np.divide(KP, KD)[[3, 5]] * np.abs(loop.reference)[[3, 5]]))
    page.motion("motion", motion, "The motion above")
    page.figure("start", lambda: _start(motion), "The same torques over the logarithm of time, from microseconds on")
    page.heading(f"A free swing of {MAIN_SWING:g} s: no motors, no friction, no joint limits")
    page.text(f"The arm starts at rest, hanging from its base, at q = ({', '.join(f'{x:g}' for x in HANGING)}) rad.")
    page.lines("\n".join(trajectory_lines(swing)))
    page.motion("swing", swing, "Free swing")
    page.heading("Torques against gravity")
    _gravity(robot, STRETCHED_OUT, "with the arm stretched out horizontally", page)
    _parts(robot, page)
    return held


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

    def slopes(c: Array) -> Array:
        tensors = np.einsum("atij,akt->tikj", arm.inverse_dynamics_derivatives(*states(c)), basis)
        return np.reshape(tensors, (-1, c.size))

    begun = time.perf_counter()
    found, taken = least_squares(torques, none, slopes), time.perf_counter() - begun
    both = np.array([torques(none), found.fun]).reshape(2, len(t), MOVED)
    steps, exact = np.logspace(0, -12, 25), slopes(none).sum(-1)
    differences = [(torques(none + h) - torques(none - h)) / (2 * h) for h in steps]
    errors = np.abs(differences - exact).max(-1) / np.abs(exact).max()
    best = errors.argmin()
    numbers = *(both**2).sum(-1).mean(-1), taken, found.nfev, 2 * none.size, errors[best], steps[best]
    page.text(LEAST.format(*numbers))
    page.figure("least", lambda: _plot_torques(t, both, arm.joint_names), "Torques of both motions over time")
    page.figure("slopes", lambda: _plot_errors(steps, errors), "Relative error of finite differences over their size")


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
    ax.xaxis.set_major_formatter("{x:g}")
    return figure


def _start(motion: Trajectory) -> Figure:
    """The torques from the first step on, so that what takes a millisecond can be seen."""
    figure = dict(small_plots(motion))["torque [N m]"]()
    figure.axes[0].set(xscale="log", xlim=(1e-6, None), xticks=[1e-6, 1e-4, 1e-2, 1])
    figure.axes[0].xaxis.set_major_formatter("{x:g}")
    return figure


def write_robot_page(robot: rne.Robot, findings: str, folder: Path, say: Callable[[str], None]) -> bool:
    """Examine a robot and write the page; `findings` are the lines that `rne.check` prints about its file.

    True if all differences from Pinocchio or the energies are within their bounds; False if M is singular.
    """
    page = Report(f"Robot {robot.model.name}", say, folder)
    with page.kept_if_interrupted():
        held = _examination(robot, findings, page)
    say(f"page: {page.write()}")
    return held


def _examination(robot: rne.Robot, findings: str, page: Report) -> bool:
    """A motion, what the robot consists of, whether Pinocchio or the energies agree, and torques against gravity."""
    q, torque = moving_start(robot)
    motion = _swing(robot, q, torque, page)
    for line in repr(robot).splitlines():
        page.text(line.strip())
    if findings:
        page.heading("Findings in the file")
        for line in findings.splitlines():
            page.text(line)
    within = _comparison(robot, page)
    page.heading("Torques against gravity")
    _gravity(robot, q, "at the start of the swing", page)
    if motion is not None:
        page.heading("The motion above")
        page.lines("\n".join(trajectory_lines(motion)))
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
    page.film("swing", motion, f"{robot.model.name} swings freely")
    chosen = f"Of {SAMPLES} random positions this is where gravity pulls hardest."
    page.text(f"It swings for {SWING:g} s from rest at {place}, without friction and limits. {chosen}")
    pushed = ", ".join(f"{n} by {x:.3g}" for n, x in zip(moving.joint_names, torque[moves], strict=True) if x)
    if pushed:
        page.text(f"Joints that gravity hardly moves are pushed [{units_of(moving, 'N m', 'N')}]: {pushed}.")
    if held:
        page.text(f"Sliding joints are held: {', '.join(held)}.")
    return motion


def moving_start(robot: rne.Robot) -> tuple[Array, Array]:
    """A position where gravity pulls hard, and constant torques that push the joints that it hardly pulls there.

    Hard is relative to the largest torque of each joint; hardly is less than would give it `PUSH` alone.
    """
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
    """Say how far the results are apart; True if all are within their bounds."""
    entry, bound, eps = "term" if by_terms else "entry", rows[0].bound, np.finfo(float).eps
    page.heading(f"Comparison with {source.partition(' (')[0]}")
    page.text(
        f"Largest difference over {SAMPLES} random states, velocities up to 10 rad/s or m/s, against {source}, "
        f"relative to the largest {entry} of each state. Both computations round, so they may differ by the bound: "
        f"{bound:.0e}, which is {float(f'{bound / eps:.2g}'):g} roundings; for accelerations 1e-13, or one rounding "
        "times the condition number of the mass matrix, where this is more. Forward after inverse: torques from "
        "accelerations, accelerations from these."
    )
    cells = [[x.quantity, f"{x.worst:.1e}", f"{x.bound:.1e}", "yes" if x.worst <= x.bound else "NO"] for x in rows]
    page.table(["quantity", "largest difference", "bound", "within bound"], cells)
    return all(row.worst <= row.bound for row in rows)


def carried_masses(model: rne.Model) -> Array:
    """The mass behind each joint: the body that it moves and all bodies beyond, shape (nb,) [kg]."""
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
    """First sample, or one of some times, from which on every joint stays within 0.01 rad of its reference [s].

    Infinity if there is none.
    """
    t, q = (motion.t, motion.q) if times is None else (times, motion(times)[0])
    outside = np.flatnonzero((np.abs(q - np.asarray(reference)) > SETTLED).any(axis=1))
    return float(np.append(t, np.inf)[outside[-1] + 1 if len(outside) else 0])


class Way(NamedTuple):
    """A way to compute a quantity: the call that is timed, of how many states, and its results for the first ones."""

    quantity: str
    form: str
    who: str
    call: Callable[[], object]
    states: int
    results: Callable[[], Array]


class Measured(NamedTuple):
    """A way, its time per state [s], and its largest error relative to each state's largest entry."""

    way: Way
    seconds: float
    error: float


def measured_speed(robot: rne.Robot) -> list[Measured]:
    """Time all ways in turn and take medians, so that changes of the machine's speed affect all alike."""
    found: list[Measured] = []
    for quantity in (INVERSE, FORWARD):
        q, qd, x = random_states(robot.n, STATES)
        arrays = [q, qd, x if quantity == INVERSE else robot.inverse_dynamics(q, qd, x)]
        ways = [*_own(robot, quantity, arrays), *_of_pinocchio(robot, quantity, arrays)]
        seconds: list[list[float]] = [[] for _ in ways]
        for _ in range(1 + TURNS):
            for way, times in zip(ways, seconds, strict=True):
                begun = time.perf_counter()
                way.call()
                times.append((time.perf_counter() - begun) / way.states)
        function = rne.dynamics.inverse_dynamics if quantity == INVERSE else rne.dynamics.forward_dynamics
        # Long double has three decimal digits more on most machines.
        exact = function(robot.model.astype(np.longdouble), *[x[:COMPARED].astype(np.longdouble) for x in arrays])
        for way, times in zip(ways, seconds, strict=True):
            found.append(Measured(way, median(times[1:]), relative(way.results(), exact)))  # the first one warms up
    return found


def _own(robot: rne.Robot, quantity: str, arrays: list[Array]) -> Iterator[Way]:
    """Ways by both engines, machine code where it can be made."""
    function = rne.dynamics.inverse_dynamics if quantity == INVERSE else rne.dynamics.forward_dynamics
    compiles = importlib.util.find_spec("llvmlite") is not None
    for who, engine in ((NUMPY, "numpy"), (MACHINE_CODE, "numba")) if compiles else ((NUMPY, "numpy"),):
        kernel: Any = rne.Robot(robot.model, engine).kernel(function)
        out = kernel(*arrays)
        yield _singles(quantity, who, kernel, arrays)
        in_place = partial(kernel, *arrays, out=out)
        yield Way(quantity, BATCH, who, in_place, STATES, partial(out.__getitem__, slice(COMPARED)))


def _of_pinocchio(robot: rne.Robot, quantity: str, arrays: list[Array]) -> Iterator[Way]:
    """Ways by Pinocchio's `rnea` and `aba`, one state or many, on one thread; arrays are in its order and layout."""
    if robot.model.couplings or not has_pinocchio():
        return
    oracle = Oracle(robot.model, rne.to_urdf(robot.model))
    pin, model, data = oracle.pin, oracle.theirs, oracle.data
    one, many = (pin.rnea, pin.rneaInParallel) if quantity == INVERSE else (pin.aba, pin.abaInParallel)
    q, *others = arrays
    theirs = [each(oracle.q, q), *(each(oracle.velocities, x) for x in others)]
    columns, out = [np.asfortranarray(x.T) for x in theirs], np.zeros((model.nv, len(q)), order="F")
    pool = pin.ModelPool(model, 1)
    yield _singles(quantity, PINOCCHIO, lambda *state: one(model, data, *state), theirs, oracle.torque)
    in_parallel = lambda: many(1, pool, *columns, out)  # noqa: E731
    yield Way(quantity, BATCH, PINOCCHIO, in_parallel, STATES, lambda: each(oracle.torque, out.T[:COMPARED]))


def _singles(
    quantity: str, who: str, call: Callable[..., Any], arrays: Sequence[Array], turn: Callable[..., Array] = np.array
) -> Way:
    """A loop over states, each an array of its own; `turn` brings a result into our order."""
    states = [[x[k].copy() for x in arrays] for k in range(SINGLES)]

    def run() -> None:
        for state in states:
            call(*state)

    return Way(quantity, ONE, who, run, SINGLES, lambda: np.array([turn(call(*x)) for x in states[:COMPARED]]))


def speed_tables(found: Sequence[Measured]) -> dict[str, list[list[str]]]:
    """Tables by quantity and states a call: time per state, beside the shortest of Pinocchio's there, and the error."""
    tables: dict[str, list[list[str]]] = {}
    for quantity, form in product(dict.fromkeys(m.way.quantity for m in found), (ONE, BATCH)):
        ways = {(who, form) for who in COLORS} | {(PINOCCHIO, ONE)}
        shown = [m for m in found if m.way.quantity == quantity and (m.way.who, m.way.form) in ways]
        theirs = min((m.seconds for m in shown if m.way.who == PINOCCHIO), default=0.0)
        rows = [["computed by", "µs a state", *["beside Pinocchio"] * bool(theirs), "largest error"]]
        for way, seconds, error in shown:
            ratio, side = (theirs / seconds, "faster") if theirs > seconds else (seconds / (theirs or 1), "slower")
            beside = f"{ratio:.1f} times {side}" if way.who != PINOCCHIO else "-"
            who = way.who if way.form == form else f"{way.who}, {ONE}"
            rows.append([who, f"{1e6 * seconds:.3g}", *[beside] * bool(theirs), f"{error:.1e}"])
        tables[f"{quantity}, {form}"] = rows
    return tables


def plot_speed(found: Sequence[Measured]) -> Figure:
    """Error against time per state, a panel for each quantity."""
    figure = blank_figure(WIDTH, 4.6)
    figure.suptitle(f"× one state, ● {BATCH}; lower left is better")
    for ax, quantity in zip(figure.subplots(2, 1, sharex=True), (INVERSE, FORWARD), strict=True):
        shown = [m for m in found if m.way.quantity == quantity]
        for way, seconds, error in shown:
            is_batch = way.form == BATCH
            look = {"color": COLORS[way.who], "marker": "o" if is_batch else "x", "markersize": 8, "linestyle": ""}
            ax.plot(1e6 * seconds, error, label=way.who if is_batch else "_", **look)
        ax.set(xscale="log", title=f"{quantity}: largest error, relative")
        log_axis(ax)
        ax.margins(x=0.15)
        decades = np.floor(np.log10([max(m.error, 1e-17) for m in shown]))
        ax.set_ylim(0.6 * 10.0 ** decades.min(), 10.0 ** (decades.max() + 1))
        ax.xaxis.set_major_formatter("{x:g}")
    ax.set_xlabel("time per state [µs]")
    figure.legend(*ax.get_legend_handles_labels(), **BELOW)
    return figure
