"""Speed beside accuracy on this machine: both engines and Pinocchio in turn, for the main page."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Iterator, Sequence
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .. import dynamics
from ..basics.spatial import Array
from ..plotting.html_page import log_axis
from ..plotting.plots import BELOW, WIDTH, blank_figure
from ..robot import Robot
from ..urdf.write import to_urdf
from ..validation.agreement import has_pinocchio, random_states, relative
from ..validation.oracle import Oracle, each

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INVERSE, FORWARD = "inverse dynamics", "forward dynamics"
STATES, SINGLES, COMPARED, TURNS = 1000, 100, 50, 15
ONE, BATCH = "one state a call", f"{STATES} states a call"
NUMPY, MACHINE_CODE, PINOCCHIO = "rne, NumPy", "rne, machine code", "Pinocchio"
COLORS = {MACHINE_CODE: "C2", NUMPY: "C0", PINOCCHIO: "C1"}


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


def measure(robot: Robot) -> list[Measured]:
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
        function = dynamics.inverse_dynamics if quantity == INVERSE else dynamics.forward_dynamics
        # Long double has three decimal digits more on most machines.
        exact = function(robot.model.astype(np.longdouble), *[x[:COMPARED].astype(np.longdouble) for x in arrays])
        for way, times in zip(ways, seconds, strict=True):
            found.append(Measured(way, median(times[1:]), relative(way.results(), exact)))  # the first one warms up
    return found


def _own(robot: Robot, quantity: str, arrays: list[Array]) -> Iterator[Way]:
    """Ways by both engines, machine code where it can be made."""
    function = dynamics.inverse_dynamics if quantity == INVERSE else dynamics.forward_dynamics
    compiles = importlib.util.find_spec("llvmlite") is not None
    for who, engine in ((NUMPY, "numpy"), (MACHINE_CODE, "numba")) if compiles else ((NUMPY, "numpy"),):
        kernel: Any = Robot(robot.model, engine).kernel(function)
        out = kernel(*arrays)
        yield _singles(quantity, who, kernel, arrays)
        yield Way(
            quantity,
            BATCH,
            who,
            lambda kernel=kernel, out=out: kernel(*arrays, out=out),  # type: ignore[misc]
            STATES,
            lambda kernel=kernel: kernel(*arrays)[:COMPARED],  # type: ignore[misc]
        )


def _of_pinocchio(robot: Robot, quantity: str, arrays: list[Array]) -> Iterator[Way]:
    """Ways by Pinocchio's `rnea` and `aba`, one state or many, on one thread; arrays are in its order and layout."""
    if not has_pinocchio():
        return
    oracle = Oracle(robot.model, to_urdf(robot.model))
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
    quantity: str,
    who: str,
    call: Callable[..., Any],
    arrays: Sequence[Array],
    turn: Callable[[Array], Array] = np.array,
) -> Way:
    """A loop over states, each an array of its own; `turn` brings a result into our order."""
    states = [[x[k].copy() for x in arrays] for k in range(SINGLES)]

    def run() -> None:
        for state in states:
            call(*state)

    return Way(quantity, ONE, who, run, SINGLES, lambda: np.array([turn(call(*x)) for x in states[:COMPARED]]))


def speed_tables(found: Sequence[Measured]) -> dict[str, list[list[str]]]:
    """Tables by quantity and states a call: time per state, that of Pinocchio over it, and the error, titles first.

    Beside calls of many states stands the faster of Pinocchio's two calls.
    """
    theirs = {(m.way.quantity, m.way.form): m.seconds for m in found if m.way.who == PINOCCHIO}
    tables: dict[str, list[list[str]]] = {}
    for way, seconds, error in sorted(found, key=lambda m: (m.way.quantity == FORWARD, m.way.form == BATCH)):
        fastest = min((theirs[k] for k in theirs if k[0] == way.quantity and way.form in (k[1], BATCH)), default=0.0)
        beside = (
            f"{fastest / seconds:.1f} times faster"
            if fastest > seconds
            else f"{seconds / (fastest or 1):.1f} times slower"
        )
        beside = beside if theirs and way.who != PINOCCHIO else "-"
        rows = tables.setdefault(
            f"{way.quantity}, {way.form}", [["computed by", "µs a state", "beside Pinocchio", "largest error"]]
        )
        rows.append([way.who, f"{1e6 * seconds:.3g}", beside, f"{error:.1e}"])
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
