"""The regressor and Pinocchio's, and variants of a robot as one batch: python -m benchmarks.regressor [--quick]

Time of Y for one state and per state of a batch, with the error of the same calls against long double, beside
computeJointTorqueRegressor in a loop; and inverse dynamics of one state for thousands of robots with other inertial
parameters, in one call and by a Robot each. Compared calls take turns, one thread. Writes
benchmarks/results/regressor.json and the tables of docs/benchmarks/regressor.md, whose text is written by hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

import rne
from benchmarks.cases import ENGINES, engines, engines_left_out, load, states
from benchmarks.kernel_errors import EXACT, reference, relative_error, single_results
from benchmarks.measure import QUICK_NOTE, is_quick, many, nanoseconds, per_state, ratio, write
from benchmarks.pages import DOCS, rewrite, table, three
from benchmarks.peers.pinocchio import Pinocchio
from rne.basics.inertia import PARAMETERS

ROBOTS = ("irb140", "ur5", "panda")
PAGE = DOCS / "benchmarks" / "regressor.md"
BATCH, VARIANTS = 1000, 5000
TIMES, BATCHES = 200, 5  # single calls and batches in a repeat
FEW_ROBOTS = 50  # robots of a loop in a repeat: each takes some ms
REPEATS = 25
SPREAD = 0.1  # of masses, first moments and inertias of each body, all by one factor
Results = dict[str, Any]
Robots = Mapping[str, rne.Robot]


class TheirRegressor:
    """computeJointTorqueRegressor, and its results in our order."""

    def __init__(self, model: rne.Model, arrays: list[np.ndarray]) -> None:
        self.peer, self.model = Pinocchio(model, arrays), model
        oracle = self.peer.oracle
        self.columns = np.concatenate([np.arange(PARAMETERS) + PARAMETERS * (k - 1) for k in oracle.joint_ids])

    def loop(self) -> None:
        """All states, one by one."""
        model, data = self.peer.model, self.peer.data
        for state in self.peer.columns:
            pin.computeJointTorqueRegressor(model, data, *state)

    def results(self, few: int) -> np.ndarray:
        """Values of the first states; rows of joints that mimic others are added to these."""
        oracle, G = self.peer.oracle, self.model.coordinate_map
        model, data = self.peer.model, self.peer.data
        found = (pin.computeJointTorqueRegressor(model, data, *state) for state in self.peer.columns[:few])
        return np.array([G.T @ Y[oracle.v][:, self.columns] for Y in found])


def run(quick: bool) -> Results:
    """All figures."""
    batch, variants, repeats = (50, 200, 1) if quick else (BATCH, VARIANTS, REPEATS)
    taken = ("numpy",) if quick else engines()
    found: Results = {"batch": batch, "variants": variants, "repeats": repeats, "spread": SPREAD}
    found |= {"engines_left_out": engines_left_out(), "robots": {}}
    for name in ROBOTS[:1] if quick else ROBOTS:
        robots = {engine: load(name, engine) for engine in taken}
        found["robots"][name] = {
            "regressor": regressors(robots, states(robots["numpy"].n, batch), repeats),
            "variants": of_variants(robots, variants, 20 if quick else FEW_ROBOTS, repeats),
        }
    return found


def regressors(robots: Robots, arrays: list[np.ndarray], repeats: int) -> Results:
    """Y of one robot by every engine, and by Pinocchio."""
    theirs, count = TheirRegressor(robots["numpy"].model, arrays), len(arrays[0])
    one = [a[0].copy() for a in arrays]
    calls: dict[str, Any] = {"pinocchio": (theirs.loop, len(theirs.peer.columns))}
    for engine, robot in robots.items():
        robot.compile(rne.dynamics.regressor)
        calls[f"{engine} single"] = many(lambda y=robot.regressor: y(*one), TIMES), TIMES
        calls[f"{engine} batch"] = many(lambda y=robot.regressor: y(*arrays), BATCHES), BATCHES * count
    each = per_state(calls, repeats)
    first = [a[:EXACT] for a in arrays]
    exact = reference(rne.dynamics.regressor, robots["numpy"].model, first)
    found: Results = {
        "operations": sum(robots["numpy"].kernel(rne.dynamics.regressor).operations.values()),
        "pinocchio": {
            "single_us": nanoseconds(each["pinocchio"]) / 1e3,
            "error_eps": relative_error(theirs.results(EXACT), exact),
        },
    }
    for engine, robot in robots.items():
        single, batch = f"{engine} single", f"{engine} batch"
        found[engine] = {
            "single_us": nanoseconds(each[single]) / 1e3,
            "ns_per_state": nanoseconds(each[batch]),
            "single_times_slower": ratio(each, single, "pinocchio"),
            "batch_times_faster": ratio(each, "pinocchio", batch),
            "error_eps": relative_error(robot.regressor(*arrays)[:EXACT], exact),
            "single_error_eps": relative_error(single_results(robot.regressor, first), exact),
        }
    return found


def of_variants(robots: Robots, count: int, few: int, repeats: int) -> Results:
    """Inverse dynamics of one state for many inertial parameters: one call, and a loop over a Robot for each."""
    robot = robots["numpy"]
    q, qd, qdd = (a[0].copy() for a in states(robot.n, 1))
    factors = np.random.default_rng(0).uniform(1 - SPREAD, 1 + SPREAD, (count, robot.model.nb, 1))
    pi = (factors * robot.parameters.reshape(-1, PARAMETERS)).reshape(count, -1)

    def loop(given: rne.Robot) -> np.ndarray:
        return np.array([given.with_parameters(row).inverse_dynamics(q, qd, qdd) for row in pi[:few]])

    calls: dict[str, Any] = {}
    for engine, given in robots.items():
        given.inverse_dynamics(q, qd, qdd, parameters=pi)  # traced and compiled
        one_call = partial(given.inverse_dynamics, q, qd, qdd, parameters=pi)
        calls[f"{engine} batch"] = many(one_call, BATCHES), BATCHES * count
        calls[f"{engine} loop"] = (lambda g=given: loop(g)), few
    each = per_state(calls, repeats)
    kernel = robot.kernel(rne.dynamics.inverse_dynamics, parameters=True)
    found: Results = {"operations": sum(kernel.operations.values())}
    for engine, given in robots.items():
        found[engine] = {
            "ns_per_variant": nanoseconds(each[f"{engine} batch"]),
            "loop_us_per_variant": nanoseconds(each[f"{engine} loop"]) / 1e3,
            "times_faster": ratio(each, f"{engine} loop", f"{engine} batch"),
            "difference_eps": relative_error(given.inverse_dynamics(q, qd, qdd, parameters=pi)[:few], loop(given)),
        }
    return found


def tables(results: Results) -> dict[str, str]:
    """By the name of their place in the page."""
    return {"regressor": of_regressors(results), "variants": variants_table(results)}


def of_regressors(results: Results) -> str:
    """A row for each robot and engine."""
    head = ["robot", "engine", "operations", "one state [µs]", "times Pinocchio's time"]
    head += [f"batch of {results['batch']}, ns per state", "times faster than Pinocchio's loop"]
    head += ["error, batch [eps]", "one state [eps]"]
    lines = []
    for name, robot in results["robots"].items():
        found = robot["regressor"]
        for engine in (e for e in ENGINES if e in found):
            own = found[engine]
            single = [f"{own['single_us']:.1f}", three(own["single_times_slower"])]
            batch = [f"{own['ns_per_state']:.0f}", three(own["batch_times_faster"])]
            errors = [f"{own['error_eps']:.1f}", f"{own['single_error_eps']:.1f}"]
            lines.append([name, ENGINES[engine], str(found["operations"]), *single, *batch, *errors])
        theirs = found["pinocchio"]
        error = f"{theirs['error_eps']:.1f}"
        lines.append([name, "Pinocchio", "-", f"{theirs['single_us']:.1f}", "1", "-", "-", "-", error])
    return table(head, lines)


def variants_table(results: Results) -> str:
    """A row for each robot and engine."""
    head = ["robot", "engine", "operations", f"{results['variants']} variants in one call, ns per variant"]
    head += ["a Robot for each, µs per variant", "times faster", "difference [eps]"]
    lines = []
    for name, robot in results["robots"].items():
        found = robot["variants"]
        for engine in (e for e in ENGINES if e in found):
            own = found[engine]
            times = [f"{own['ns_per_variant']:.0f}", f"{own['loop_us_per_variant']:.0f}", three(own["times_faster"])]
            error = f"{own['difference_eps']:.1f}"
            lines.append([name, ENGINES[engine], str(found["operations"]), *times, error])
    return table(head, lines)


def main() -> None:
    quick = is_quick(__doc__)
    results = run(quick)
    for text in tables(results).values():
        print(f"{text}\n")
    if quick:
        print(QUICK_NOTE)
        return
    write("regressor.json", results)
    rewrite(tables(results), PAGE)


if __name__ == "__main__":
    main()
