"""Runs with continuous right-hand sides between the declared breaks: SciPy's solvers, restarted at each break."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..basics.spatial import Array
from .plant import Plant
from .scipy_solvers import FAILURES, guarded_solver
from .trajectory import Run, Task

IMPLICIT = ("Radau", "BDF", "LSODA")
UNCONTROLLED_ATOL = 1e100  # of the energies, which are integrated without controlling the step size


def tolerances(plant: Plant, task: Task) -> tuple[float, Array]:
    """Relative and absolute tolerances with which the energies of the ledger do not control the step size.

    All methods but LSODA take the root mean square of the components' errors, so that components that are always 0
    would loosen the tolerance of the others; it is tightened to make up for them.
    """
    size, energies = plant.rhs.size, len(plant.rhs.ledger)
    atols = np.full(size, task.atol)
    if not energies:
        return task.rtol, atols
    atols[size - energies :] = UNCONTROLLED_ATOL
    undiluted = 1.0 if task.method == "LSODA" else float(np.sqrt(1 - energies / size))
    return task.rtol * undiluted, atols * undiluted


def stops(plant: Plant) -> list[Callable[[float, Array], float]]:
    """One event for each end of a joint's range, mimic joints included."""
    model = plant.robot.model
    found = []
    for i, joint in enumerate(model.moving_joints):
        for bound, sign in ((model.upper[i], 1.0), (model.lower[i], -1.0)):
            if np.isfinite(bound):
                place = model.coordinate[i], float(model.multiplier[i]), float(model.offset[i])
                found.append(_stop(joint, place, float(bound), sign))
    return found


def _stop(joint: str, place: tuple[int, float, float], bound: float, sign: float) -> Callable[[float, Array], float]:
    """The event of a joint at `multiplier * q[coordinate] + offset`, the three of `place`."""
    coordinate, multiplier, offset = place
    slack = 4 * float(np.finfo(float).eps) * max(1.0, abs(bound))  # a joint at rest on its stop has not just reached it

    def position(x: Array) -> float:
        return multiplier * float(x[coordinate]) + offset

    def beyond(t: float, x: Array) -> float:
        return sign * (position(x) - bound) - slack

    beyond.terminal, beyond.direction = True, 1.0  # type: ignore[attr-defined]
    beyond.joint, beyond.bound, beyond.position = joint, bound, position  # type: ignore[attr-defined]
    return beyond


def check_within_stops(events: Sequence[Any], x0: Array) -> None:
    """Refuse an initial state beyond a stop."""
    for event in events:
        if event(0.0, x0) > 0:
            raise ValueError(
                f"`q0` must be within the stops, got {event.position(x0):.6g} for joint {event.joint!r}, "
                f"whose stop is at {event.bound:.6g}"
            )


def stop_message(event: Any, t: float) -> str:
    """The message of a run that ended at a stop."""
    return f"{event.joint!r} reached its stop at {event.bound:.6g} at t = {t:.6g} s"


def continuous_run(plant: Plant, task: Task, failures: list[tuple[float, str]]) -> Run:
    """Integrate from break to break until the end, an event or a failure, which is added to `failures`."""
    edges = [0.0, *sorted({b for b in task.breaks if 0 < b < task.duration}), task.duration]
    x0, t_eval = task.x0, task.t_eval
    times: list[Array] = []
    states: list[Array] = []
    run = Run(np.zeros(0), np.zeros((0, len(x0))), 0, "")
    for begin, end in itertools.pairwise(edges):
        inside = None
        if t_eval is not None:
            inside = t_eval[(t_eval > begin if begin else t_eval >= begin) & (t_eval <= end)]
        fun = plant if len(edges) == 2 else _within(plant, (begin, end))
        t, x, x0, status, ending = _segment(fun, plant, x0, (begin, end), inside, task, failures)
        first = 1 if t_eval is None and times else 0  # the end of the previous segment
        times.append(t[first:])
        states.append(x[first:])
        run = Run(np.concatenate(times), np.concatenate(states), status, ending)
        if failures or status:
            break
    return run


def _segment(
    fun: Callable[[float, Array], Array],
    plant: Plant,
    x0: Array,
    span: tuple[float, float],
    t_eval: Array | None,
    task: Task,
    failures: list[tuple[float, str]],
) -> tuple[Array, Array, Array, int, str]:
    """Times, states, the last state, status and message of one segment."""
    from scipy.integrate import solve_ivp

    rtol, atol = tolerances(plant, task)
    events = task.events
    options: dict[str, Any] = {"jac": plant.jacobian} if task.method in IMPLICIT else {}
    last = [x0]
    solver = guarded_solver(task.method, failures, last, events)
    try:
        solution = solve_ivp(
            fun, span, x0, solver, t_eval, events=list(events) or None, rtol=rtol, atol=atol, **options
        )
    except FAILURES as error:  # before the first step
        failures.append((span[0], str(error)))
        return np.zeros(0), np.zeros((0, len(x0))), x0, -1, ""
    t = np.asarray(solution.t, dtype=float)
    x = np.asarray(solution.y, dtype=float).T.reshape(len(t), len(x0))
    if solution.status != 1:
        return t, x, last[0], 0, str(solution.message)
    hit = next(k for k, when in enumerate(solution.t_events) if len(when))
    event, when = events[hit], float(solution.t_events[hit][0])
    if t_eval is not None:
        t, x = np.append(t, when), np.concatenate([x, solution.y_events[hit]])
    return t, x, last[0], 1, stop_message(event, when)


def _within(plant: Plant, span: tuple[float, float]) -> Callable[[float, Array], Array]:
    """The right-hand side between two breaks, each evaluated just inside the span."""
    first, last = float(np.nextafter(span[0], np.inf)), float(np.nextafter(span[1], 0.0))
    return lambda t, x: plant(min(max(t, first), last), x)
