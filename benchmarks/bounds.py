"""Bounds with proof beside samples: python -m benchmarks.bounds [--quick] [--samples N] [--only ARM ...]

Robot.bounds of nine arms in machine code, on full turns and within limits; then N random states of each (10^7 by
default; a tenth of them for k_g, M and k_C), of which none may be outside. Writes benchmarks/results/bounds.json, the
table of docs/explanation/bounds.md and docs/stability/bounds.png.
"""

from __future__ import annotations

import json
import time
from typing import Any

import numpy as np

import rne
from benchmarks.measure import RESULTS, command_line, write
from benchmarks.pages import DOCS, rewrite, table
from rne import dynamics
from rne.bounds.bounds import QUANTITIES
from rne.dynamics.lagrange import christoffel
from rne.plotting.plots import blank_figure

ARMS = ("irb140", "ur5", "ur10", "kinova", "z1", "talos_left_arm", "so101", "xarm7", "panda")
LOCKED = ("finger", "gripper", "Gripper")
RATE, ACCELERATION = 3.0, 10.0  # of every joint [rad/s, rad/s^2]
BUDGETS = {
    "gravity_torque": 5,
    "gravity_stiffness": 20,
    "mass_matrix": 30,
    "mass_eigenvalues": 60,
    "coriolis": 30,
    "torque": 30,
}
BLOCK = 100_000
CHART = ("irb140", "ur5", "panda")
PAGE = DOCS / "explanation" / "bounds.md"


def arm(name: str) -> rne.Robot:
    """The arm in machine code, its fingers locked at zero."""
    robot = rne.load(name)
    fingers = {joint: 0.0 for joint in robot.joint_names if any(word in joint for word in LOCKED)}
    return rne.Robot((robot.locked(fingers) if fingers else robot).model, "numba")


def proven(robot: rne.Robot, positions: str, budget: float) -> dict[str, Any]:
    """Gap, bounds and seconds of each quantity."""
    found = {}
    for name in QUANTITIES:
        start = time.perf_counter()
        result = robot.bounds(
            positions, rates=RATE, accelerations=ACCELERATION, quantities=[name], budget=budget * BUDGETS[name]
        )
        seconds, bound = time.perf_counter() - start, getattr(result, name)
        values = {x: np.asarray(getattr(bound, x)).tolist() for x in ("lower", "upper", "attained", "gap")}
        found[name] = values | {"seconds": seconds}
    return found


def sampled(robot: rne.Robot, found: dict[str, Any], samples: int) -> dict[str, Any]:
    """The largest values of random states, relative to the proven bounds, after 10^3, 10^4, ... of them."""
    rng, n = np.random.default_rng(0), robot.n
    stiffness = robot.kernel(dynamics.gravity_torque, "q")
    slopes, sizes = robot.kernel(dynamics.mass_matrix, "q"), {k: np.asarray(v["upper"]) for k, v in found.items()}
    least = found["mass_eigenvalues"]["lower"][0]
    marks, done = [10**k for k in range(3, 12) if 10**k <= samples], 0
    worst: dict[str, float] = dict.fromkeys((*QUANTITIES, "least eigenvalue"), 0.0)
    curve: dict[str, list[float]] = {name: [] for name in worst}

    def see(name: str, values: Any, bound: Any) -> None:
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(np.asarray(bound) > 1e-9 * np.max(bound), values / bound, 0.0)
        worst[name] = max(worst[name], float(share.max()))

    while done < samples:
        count = min(BLOCK, samples - done, marks[0] - done if marks else samples)
        q = rng.uniform(-np.pi, np.pi, (count, n))
        qd, qdd = (rng.choice([-x, x], (count, n)) for x in (RATE, ACCELERATION))
        see("gravity_torque", abs(robot.gravity_torque(q)).max(axis=0), sizes["gravity_torque"])
        see("torque", abs(robot.inverse_dynamics(q, qd, qdd)).max(axis=0), sizes["torque"])
        norms = np.linalg.eigvalsh(stiffness(q if count < BLOCK else q[: BLOCK // 10]))
        see("gravity_stiffness", abs(norms).max(), sizes["gravity_stiffness"])
        few = q if count < BLOCK else q[: BLOCK // 10]
        M = robot.mass_matrix(few)
        eigenvalues = np.linalg.eigvalsh(M)
        see("mass_matrix", abs(M).max(axis=0), sizes["mass_matrix"])
        see("mass_eigenvalues", eigenvalues[:, -1].max(), sizes["mass_eigenvalues"][1])
        see("least eigenvalue", least, eigenvalues[:, 0].min())
        v = rng.normal(size=few.shape)
        v /= np.linalg.norm(v, axis=1)[:, None]
        c = christoffel(slopes(few))
        see("coriolis", np.linalg.norm(np.einsum("nijk,ni,nj->nk", c, v, v), axis=1).max(), sizes["coriolis"])
        done += count
        if marks and done == marks[0]:
            marks.pop(0)
            for name, value in worst.items():
                curve[name].append(value)
    return {"samples": samples, "worst": worst, "curve": curve}


def rows(results: dict[str, Any]) -> list[list[str]]:
    """A row per arm and kind of positions: the worst gap and the time of each quantity."""
    out = []
    for name, one in results.items():
        for positions in ("circle", "limits"):
            cells = []
            for quantity in QUANTITIES:
                values = one[positions][quantity]
                gaps = np.atleast_1d(values["gap"]).ravel()
                shown = gaps if quantity == "mass_eigenvalues" else [gaps.max()]
                cells.append(", ".join(f"{1 + g:.2f}" if g < 9 else "none" for g in shown))
                cells[-1] += f" in {values['seconds']:.2g} s"
            out.append([name, str(one["joints"]), positions, *cells])
    return out


def picture(results: dict[str, Any]) -> Any:
    """What samples reach of the proven bounds, over their number."""
    figure = blank_figure(9.0, 3.6)
    labels = ("gravity torque", "k_g", "largest eigenvalue of M", "k_C", "torque")
    names = dict(zip((q for q in QUANTITIES if q != "mass_matrix"), labels, strict=True))
    chosen = [name for name in CHART if name in results]
    for axes, arm_name in zip(np.atleast_1d(figure.subplots(1, len(chosen), sharey=True)), chosen, strict=True):
        one = results[arm_name]
        for k, (quantity, label) in enumerate(names.items()):
            curve = one["sampled"]["curve"][quantity]
            numbers = 10.0 ** np.arange(3, 3 + len(curve))
            axes.semilogx(numbers, curve, "o-", color=f"C{k}", markersize=4, label=label)
            values = one["circle"][quantity]
            reached = np.asarray(values["attained"]) / np.maximum(values["upper"], 1e-300)
            best = float(reached[-1] if quantity == "mass_eigenvalues" else np.max(reached))
            axes.plot(numbers[-1] * 3, best, "*", color=f"C{k}", markersize=9)
        axes.axhline(1.0, color="k", linewidth=1)
        axes.set(title=arm_name, xlabel="random states", ylim=(None, 1.03))
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("largest value / proven bound")
    figure.axes[-1].legend(fontsize=8, loc="lower right")
    return figure


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--samples", type=int, default=10**7, help="random states of each arm")
    parser.add_argument("--only", nargs="+", default=list(ARMS), choices=ARMS, help="arms to compute anew")
    given = parser.parse_args()
    budget, samples = (0.02, 10**4) if given.quick else (1.0, given.samples)
    kept = RESULTS / "bounds.json"
    results = json.loads(kept.read_text(encoding="utf-8"))["arms"] if kept.exists() and not given.quick else {}
    for name in given.only:
        robot = arm(name)
        one: dict[str, Any] = {"joints": robot.n}
        for positions in ("circle", "limits"):
            one[positions] = proven(robot, positions, budget)
        one["sampled"] = sampled(robot, one["circle"], samples)
        outside = [quantity for quantity, share in one["sampled"]["worst"].items() if share > 1]
        print(f"{name}: {samples} states, outside: {outside or 'none'}", flush=True)
        results[name] = one
        if not given.quick:
            write("bounds.json", {"arms": {known: results[known] for known in ARMS if known in results}})
    for row in rows(results):
        print(" | ".join(row))
    if given.quick:
        return
    head = ["arm", "joints", "positions", "gravity torque", "k_g", "entries of M", "eigenvalues of M", "k_C", "torque"]
    rewrite(PAGE, {"bounds": table(head, rows(results))})
    picture(results).savefig(DOCS / "stability" / "bounds.png", facecolor="white")


if __name__ == "__main__":
    main()
