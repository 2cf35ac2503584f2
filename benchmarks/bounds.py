"""Bounds with proof beside samples and searches: python -m benchmarks.bounds [--quick] [--only ARM ...] [--parts ...]

Four parts: Robot.bounds of nine arms in machine code, on full turns and within limits; N random states of each (10^8 by
default, a tenth of them for eigenvalues of M and k_C); local searches (1000 for each entry of each quantity); within
limits a tenth of both; the table of docs/benchmarks/bounds.md and docs/stability/bounds.png. No state may be outside
of the bounds. Results are kept for each arm as they come, in benchmarks/results/bounds.json (proofs) and
bounds_samples.json; samples that were interrupted go on where they stopped.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import rne
from benchmarks.measure import RESULTS, command_line, write
from benchmarks.pages import DOCS, rewrite, table
from rne import dynamics
from rne.basics.spatial import Array
from rne.bounds.bounds import QUANTITIES
from rne.bounds.branch_and_bound import local_maximum
from rne.bounds.criteria import positive_definite
from rne.bounds.polynomials import box_argument
from rne.plotting.plots import blank_figure

ARMS = ("irb140", "ur5", "ur10", "kinova", "z1", "talos_left_arm", "so101", "xarm7", "panda")  # ur3's file is empty
LOCKED = ("finger", "gripper", "Gripper")
RATE, ACCELERATION = 3.0, 10.0  # of every joint [rad/s, rad/s^2]
BUDGETS = {  # of at most six joints and of seven, in units of work
    "gravity_torque": (8, 8),
    "gravity_stiffness": (30, 30),
    "mass_matrix": (45, 90),
    "mass_eigenvalues": (45, 90),
    "coriolis": (45, 90),
    "torque": (45, 90),
}
PARTS = ("proofs", "samples", "searches", "page")
POSITIONS = ("circle", "limits")
SAVED = 10**6  # states after which the samples are kept
LAST = 1e-5  # of the range: the last step of local searches
NOTHING = 1e-9  # of the largest entry: entries that vanish but for rounding
BLOCK = 100_000
CHART = ("irb140", "ur5", "panda")
PAGE = DOCS / "benchmarks" / "bounds.md"


def arm(name: str) -> rne.Robot:
    """The arm in machine code, its fingers locked at zero."""
    robot = rne.load(name)
    fingers = {joint: 0.0 for joint in robot.joint_names if any(word in joint for word in LOCKED)}
    return rne.Robot((robot.locked(fingers) if fingers else robot).model, "numba")


def proven(robot: rne.Robot, positions: str, budget: float, quantities: list[str]) -> dict[str, Any]:
    """Gap, bounds and seconds of each quantity."""
    found = {}
    for name in quantities:
        start, cpu = time.perf_counter(), time.process_time()
        options = {"rates": RATE, "accelerations": ACCELERATION, "quantities": [name]}
        result = robot.bounds(positions, budget=budget * BUDGETS[name][robot.n > 6], **options)
        seconds, bound = time.perf_counter() - start, getattr(result, name)
        values = {x: np.asarray(getattr(bound, x)).tolist() for x in ("lower", "upper", "attained", "gap")}
        found[name] = values | {"seconds": seconds, "cpu": time.process_time() - cpu}
    return found


def functions(robot: rne.Robot) -> dict[str, Callable[..., Array]]:
    """Bounded quantities, by the methods of the robot: (N, entries) of positions, rates and accelerations."""
    stiffness = robot.kernel(dynamics.gravity_torque, "q")

    def coriolis(q: Array, qd: Array, qdd: Array) -> Array:
        return (np.linalg.norm(robot.coriolis_torque(q, qd), axis=1) / np.maximum((qd**2).sum(axis=1), 1e-300))[:, None]

    def eigenvalues(q: Array, qd: Array, qdd: Array) -> Array:
        return np.linalg.eigvalsh(robot.mass_matrix(q))[:, [0, -1]] * [-1, 1]

    return {
        "gravity_torque": lambda q, qd, qdd: abs(robot.gravity_torque(q)),
        "gravity_stiffness": lambda q, qd, qdd: abs(np.linalg.eigvalsh(stiffness(q))).max(axis=1)[:, None],
        "mass_matrix": lambda q, qd, qdd: abs(robot.mass_matrix(q)).reshape(len(q), -1),
        "mass_eigenvalues": eigenvalues,
        "coriolis": coriolis,
        "torque": lambda q, qd, qdd: abs(robot.inverse_dynamics(q, qd, qdd)),
    }


def ranges(robot: rne.Robot, positions: str) -> tuple[Array, Array]:
    """Least and largest position, rate and acceleration, shape (3 n,)."""
    box = box_argument(robot.model, positions)
    speeds = np.repeat([RATE, ACCELERATION], robot.n)
    return np.concatenate([box.lower, -speeds]), np.concatenate([box.upper, speeds])


def blocks(samples: int) -> Iterator[int]:
    """Sizes that end at each power of ten and at no more than BLOCK: what was drawn can be continued."""
    done = 0
    while done < samples:
        power = 10 ** max(3, math.floor(math.log10(max(done, 1))) + 1)
        yield (size := min(BLOCK, samples - done, power - done))
        done += size


def sampled(
    robot: rne.Robot, positions: str, samples: int, known: dict[str, Any] | None = None
) -> Iterator[dict[str, Any]]:
    """The largest values of random states, as they go; eigenvalues of M and k_C of a tenth of the states.

    Eigenvalues are computed where a factorisation shows that they exceed those known.
    """
    of, n = functions(robot), robot.n
    stiffness, (lower, upper) = robot.kernel(dynamics.gravity_torque, "q"), ranges(robot, positions)
    known = known or {"samples": 0, "largest": {}, "curve": {}}
    done, largest, curve, passed = known["samples"], dict(known["largest"]), known["curve"], 0

    def candidates(name: str, q: Array) -> Array:
        """Positions of which the eigenvalues may exceed the largest known."""
        if name not in largest:
            return q
        if name == "gravity_stiffness":
            A, t = stiffness(q), largest[name][0] * np.eye(n)
            suspect = np.einsum("nij,nij->n", A, A) > t[0, 0] ** 2
            A, q = A[suspect], q[suspect]
            return q[~(positive_definite(t - A) & positive_definite(t + A))]
        M, least, most = robot.mass_matrix(q), -largest[name][0] * np.eye(n), largest[name][1] * np.eye(n)
        return q[~(positive_definite(M - least) & positive_definite(most - M))]

    for number, size in enumerate(blocks(samples)):
        passed += size
        if passed <= done:
            continue
        rng = np.random.default_rng([27, number])
        state = rng.uniform(lower, upper, (size, 3 * n))
        q, qd, qdd = np.split(state, 3, axis=1)
        fast = (np.copysign(RATE, qd), np.copysign(ACCELERATION, qdd))
        for name in QUANTITIES:
            if name in ("mass_eigenvalues", "coriolis") and passed > max(10**6, samples // 10):
                continue
            here = candidates(name, q) if name in ("gravity_stiffness", "mass_eigenvalues") else q
            if len(here):
                values = of[name](here, *(fast if name == "torque" else (qd, qdd))).max(axis=0)
                largest[name] = np.maximum(values, largest.get(name, -np.inf)).tolist()
        done = passed
        if done in (marks := [10**k for k in range(3, 12)]):
            curve = curve | {str(marks.index(done) + 3): dict(largest)}
        if done % SAVED == 0 or done == samples:
            yield {"samples": done, "largest": dict(largest), "curve": curve}


def searched(robot: rne.Robot, positions: str, starts: int) -> dict[str, Any]:
    """The largest value of each entry of local searches from random states, over positions, rates and accelerations."""
    lower, upper = ranges(robot, positions)
    found: dict[str, Any] = {"starts": starts}
    for name, function in functions(robot).items():
        used = {"torque": 3, "coriolis": 2}.get(name, 1) * robot.n
        fixed = np.zeros(3 * robot.n - used)

        def of(x: Array, entry: int, function: Any = function, fixed: Array = fixed) -> Array:
            parts = np.array_split(np.arange(len(x)), 1 + len(x) // BLOCK)
            states = (np.hstack([x[part], np.tile(fixed, (len(part), 1))]) for part in parts)
            return np.concatenate([function(*np.split(s, 3, axis=1))[:, entry] for s in states])

        entries = len(function(*np.split(((lower + upper) / 2 + 0.1)[None], 3, axis=1))[0])
        best = [
            local_maximum(lambda x, e=e: of(x, e), lower[:used], upper[:used], None, starts, LAST)[1]
            for e in range(entries)
        ]
        found[name] = best
    return found


def shares(values: dict[str, list[float]], bounds: dict[str, Any]) -> dict[str, float]:
    """The largest ratio of a value to its bound, of entries that do not vanish; at most 1 is inside."""
    out = {}
    for name, found in values.items():
        value, upper, lower = np.array(found), *(np.ravel(bounds[name][x]) for x in ("upper", "lower"))
        if name == "mass_eigenvalues":
            out["least eigenvalue"] = float(lower[0] / -value[0])
            value, upper = value[1:], upper[1:]
        present = upper > NOTHING * upper.max()
        out[name] = float((value[present] / upper[present]).max())
    return out


def outside(values: dict[str, list[float]], bounds: dict[str, Any]) -> list[str]:
    """Names of the quantities of which a value is outside its bounds, entries that vanish included."""
    wrong = []
    for name, found in values.items():
        value, upper = np.array(found), np.ravel(bounds[name]["upper"])
        least = name == "mass_eigenvalues" and -value[0] < bounds[name]["lower"][0]
        if least or (value > upper)[1 if name == "mass_eigenvalues" else 0 :].any():
            wrong.append(name)
    return wrong


def rows(results: dict[str, Any]) -> list[list[str]]:
    """A row per arm and kind of positions: the worst gap and the time of each quantity."""
    out = []
    for name, one in results.items():
        for positions in (p for p in POSITIONS if p in one):
            cells = []
            for quantity in QUANTITIES:
                values = one[positions][quantity]
                lower, upper, attained = (np.ravel(values[x]) for x in ("lower", "upper", "attained"))
                ratios = np.divide(upper, attained, out=np.ones_like(upper), where=attained > 0)
                if quantity == "mass_eigenvalues":
                    ratios[0] = attained[0] / max(lower[0], 1e-300)
                shown = ratios if quantity == "mass_eigenvalues" else [ratios.max()]
                cells.append(", ".join(f"{ratio:.2f}" if ratio < 10 else "none" for ratio in shown))
                cells[-1] += f" in {values['cpu']:.2g} s"
            out.append([name, str(one["joints"]), positions, *cells])
    return out


def picture(proofs: dict[str, Any], samples: dict[str, Any]) -> Any:
    """Picture of the share of proven bounds attained by samples, over their number."""
    figure = blank_figure(9.0, 4.0)
    labels = ("gravity torque", "k_g", "largest eigenvalue of M", "k_C", "torque")
    names = dict(zip((q for q in QUANTITIES if q != "mass_matrix"), labels, strict=True))
    chosen = [name for name in CHART if name in proofs and "samples" in samples.get(name, {}).get("circle", {})]
    for axes, arm_name in zip(np.atleast_1d(figure.subplots(1, len(chosen), sharey=True)), chosen, strict=True):
        bounds, curve = proofs[arm_name]["circle"], samples[arm_name]["circle"]["samples"]["curve"]
        reached = {power: shares(values, bounds) for power, values in curve.items()}
        attained = shares({q: signed_attained(bounds, q) for q in QUANTITIES}, bounds)
        for k, (quantity, label) in enumerate(names.items()):
            powers = [power for power, values in curve.items() if not fewer(quantity, power, curve)]
            numbers = [10.0 ** int(power) for power in powers]
            values = [reached[power][quantity] for power in powers]
            axes.semilogx(numbers, values, "o-", color=f"C{k}", markersize=4, label=label)
            axes.plot(numbers[-1] * 3, attained[quantity], "*", color=f"C{k}", markersize=9)
        axes.axhline(1.0, color="k", linewidth=1)
        axes.set(title=arm_name, xlabel="random states", ylim=(None, 1.03))
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("largest value / proven bound")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=9)
    return figure


def signed_attained(bounds: dict[str, Any], name: str) -> list[float]:
    """Values attained by the proof's own search, as the functions above count them."""
    values = np.ravel(bounds[name]["attained"])
    return (values * [-1, 1] if name == "mass_eigenvalues" else values).tolist()


def fewer(quantity: str, power: str, curve: dict[str, Any]) -> bool:
    """True if a quantity was evaluated at a part of these states only."""
    return quantity in ("mass_eigenvalues", "coriolis") and int(power) == max(map(int, curve)) > 6


def kept(name: str) -> dict[str, Any]:
    """Results of the arms so far."""
    path = RESULTS / name
    return json.loads(path.read_text(encoding="utf-8"))["arms"] if path.exists() else {}


def keep(name: str, arm_name: str, one: dict[str, Any]) -> None:
    """Put the results of one arm beside those of the others, also of another process."""
    results = kept(name) | {arm_name: one}
    write(name, {"arms": {known: results[known] for known in ARMS if known in results}})


def verdicts(proofs: dict[str, Any], samples: dict[str, Any]) -> Iterator[str]:
    """A line for each arm: how many states and searches, and which are outside of the bounds."""
    for name, one in samples.items():
        for positions in one:
            for kind, found in one[positions].items():
                values = found["largest"] if kind == "samples" else {q: found[q] for q in QUANTITIES}
                wrong = outside(values, proofs[name][positions])
                count = f"{found['samples']:.0e} states" if kind == "samples" else f"{found['starts']} searches"
                yield f"{name}, {positions}: {count}, outside: {wrong or 'none'}"


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--samples", type=int, default=10**8, help="random states of each arm")
    parser.add_argument("--searches", type=int, default=1000, help="local searches for each entry")
    parser.add_argument("--budget", type=float, default=1.0, help="factor on the work for each quantity")
    parser.add_argument("--only", nargs="+", default=list(ARMS), choices=ARMS, help="arms to compute anew")
    parser.add_argument("--parts", nargs="+", default=list(PARTS), choices=PARTS, help="what to compute anew")
    parser.add_argument("--positions", nargs="+", default=list(POSITIONS), choices=POSITIONS)
    parser.add_argument("--quantities", nargs="+", default=list(QUANTITIES), choices=QUANTITIES, help="to prove anew")
    given = parser.parse_args()
    quick = given.quick
    budget, states, starts = (0.02, 10**4, 3) if quick else (given.budget, given.samples, given.searches)
    proofs, samples = ({}, {}) if quick else (kept("bounds.json"), kept("bounds_samples.json"))
    for name in given.only:
        robot = arm(name)
        if "proofs" in given.parts:
            before = {p: x for p, x in proofs.get(name, {}).items() if p in POSITIONS}
            proofs[name] = {"joints": robot.n, **before}
            for positions in given.positions:
                found = proven(robot, positions, budget, given.quantities)
                proofs[name][positions] = proofs[name].get(positions, {}) | found
                if not quick:
                    keep("bounds.json", name, proofs[name])
        one = samples.setdefault(name, {})
        for positions in given.positions:
            here = one.setdefault(positions, {})
            if "searches" in given.parts:
                here["searches"] = searched(robot, positions, starts if positions == "circle" else starts // 10)
            if "samples" in given.parts:
                number = states if positions == "circle" else states // 10
                for now in sampled(robot, positions, number, here.get("samples")):
                    here["samples"] = now
                    if not quick:
                        keep("bounds_samples.json", name, one)
            if not quick and here and {"samples", "searches"} & set(given.parts):
                keep("bounds_samples.json", name, one)
        print(name, flush=True)
    proofs = proofs if quick else kept("bounds.json")
    print("\n".join(verdicts(proofs, {name: one for name, one in samples.items() if name in proofs})))
    for row in rows(proofs):
        print("| " + " | ".join(row) + " |")
    if quick or "page" not in given.parts:
        return
    head = ["arm", "joints", "positions", "gravity torque", "k_g", "entries of M", "eigenvalues of M", "k_C", "torque"]
    rewrite({"bounds": table(head, rows(proofs))}, PAGE)
    picture(proofs, samples).savefig(DOCS / "stability" / "bounds.png", facecolor="white")


if __name__ == "__main__":
    main()
