"""One state per call in a control loop: python -m benchmarks.control_loop [--quick]

CPU time of a single call of inverse dynamics of the UR5, and of an impedance law, many times in a row, calls in turn;
then a loop of 1 kHz that sleeps until each tick, and times one call behind it: how late the tick came, and how long the
call took on the clock. The collection of garbage is off. Writes benchmarks/results/control_loop.json, the tables of
docs/in-a-control-loop.md and its picture.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import rne
from benchmarks.cases import engines, states
from benchmarks.measure import QUICK_NOTE, interleaved, is_quick, many, nanoseconds, ratio, write
from benchmarks.pages import DOCS, rewrite, table, three
from benchmarks.peers.pinocchio import Pinocchio
from benchmarks.pictures import NUMBA, OTHER, OURS, PINOCCHIO
from rne.plotting.plots import blank_figure

PEER, ROBOT, KERNEL, INTO = "pin.rnea", "robot.inverse_dynamics", "kernel", "kernel.into"
COLORS = {PEER: PINOCCHIO, f"{ROBOT}, NumPy": OURS, f"{KERNEL}, Numba": OTHER, f"{INTO}, Numba": NUMBA}
SOFT, PEER_SOFT = "impedance law, compiled, Numba", "impedance law by Pinocchio in Python"
PEERS = dict.fromkeys((SOFT, PEER_SOFT), PEER_SOFT)
LINK, STIFFNESS, DAMPING = "tool0", np.array([50.0] * 3 + [800.0] * 3), np.array([5.0] * 3 + [80.0] * 3)
PERIOD = 1e-3  # s
TICKS, CALLS, REPEATS = 10_000, 5000, 31  # ticks of each call
QUICK_TICKS, QUICK_CALLS, QUICK_REPEATS = 20, 50, 3
PERCENTILES = (50, 99, 99.9)
EDGES = np.geomspace(1e-8, 1e-1, 141)  # s, of the histograms

Results = dict[str, Any]


def run(quick: bool) -> Results:
    """All figures."""
    ticks, count, repeats = (QUICK_TICKS, QUICK_CALLS, QUICK_REPEATS) if quick else (TICKS, CALLS, REPEATS)
    calls = prepared()
    gc.collect()
    gc.disable()
    try:
        seconds = interleaved({k: many(f, count) for k, f in calls.items()}, repeats, clock=time.process_time)
        ticked = loop({name: calls[name] for name in COLORS if name in calls}, ticks)
    finally:
        gc.enable()
    each = {name: [s / count for s in runs] for name, runs in seconds.items()}
    singles = {
        name: {"ns": nanoseconds(runs), "pinocchio_faster": ratio(each, PEERS.get(name, PEER), name)}
        for name, runs in each.items()
    }
    return {"single": singles, "loop": {name: summary(values) for name, values in ticked.items()}}


def prepared() -> dict[str, Callable[[], Any]]:
    """Every call, with the same state."""
    import pinocchio as pin

    robot = rne.load("ur5")
    arrays = [a[0] for a in states(robot.n, 1)]
    theirs = Pinocchio(robot.model, [a[None] for a in arrays])
    (column,), model, data, rnea = theirs.columns, theirs.model, theirs.data, pin.rnea
    q, qd, qdd = (np.ascontiguousarray(a) for a in arrays)
    out = np.empty(robot.n)
    calls: dict[str, Callable[[], Any]] = {PEER: lambda: rnea(model, data, *column)}
    for engine in engines():
        title = {"numpy": "NumPy", "numba": "Numba"}[engine]
        made = rne.load("ur5", engine=engine)
        kernel = made.kernel(rne.dynamics.inverse_dynamics)
        kernel.into(q, qd, qdd, out)
        calls[f"{ROBOT}, {title}"] = lambda made=made: made.inverse_dynamics(q, qd, qdd)
        calls[f"{KERNEL}, {title}"] = lambda kernel=kernel: kernel(q, qd, qdd)
        calls[f"{INTO}, {title}"] = lambda kernel=kernel: kernel.into(q, qd, qdd, out)
    if "numba" in engines():
        calls |= impedance_laws(theirs, column, q, qd)
    for call in calls.values():
        call()
    return calls


def impedance_laws(theirs: Pinocchio, column: Any, q: Any, qd: Any) -> dict[str, Callable[[], Any]]:
    """One impedance law, as a kernel and by Pinocchio's functions in Python; the same torques to 1e-12."""
    import pinocchio as pin

    robot, model, data = rne.load("ur5", engine="numba"), theirs.model, theirs.data
    pose = robot.link_poses(q + 0.3)[robot.link_names.index(LINK)]
    law = rne.control.compiled(rne.control.impedance(robot, LINK, STIFFNESS, DAMPING, pose, axes="base"))
    t, out, frame = np.zeros(1), np.empty(robot.n), model.getFrameId(LINK)
    Rd, pd, axes, still = pose[:3, :3].copy(), pose[:3, 3].copy(), pin.LOCAL_WORLD_ALIGNED, np.zeros(model.nv)
    G = np.diag(STIFFNESS[:3].sum() / 2 - STIFFNESS[:3])
    K, D = STIFFNESS[3:], np.r_[DAMPING[3:], DAMPING[:3]]  # Pinocchio has forces first
    place, rate = column[0], column[1]

    def peer() -> Any:
        pin.computeJointJacobians(model, data, place)
        pin.updateFramePlacement(model, data, frame)
        J, T = pin.getFrameJacobian(model, data, frame, axes), data.oMf[frame]
        A = T.rotation @ (Rd.T @ G)
        moment = (A[1, 2] - A[2, 1], A[2, 0] - A[0, 2], A[0, 1] - A[1, 0])
        wrench = np.concatenate([-K * (T.translation - pd), moment]) - D * (J @ rate)
        return J.T @ wrench + pin.nonLinearEffects(model, data, place, still)

    ours, reference = law(t, q, qd), peer()
    assert np.abs(ours - reference).max() <= 1e-12 * np.abs(reference).max()
    law.into(t, q, qd, out)
    return {PEER_SOFT: peer, SOFT: lambda: law.into(t, q, qd, out)}


def loop(calls: dict[str, Callable[[], Any]], ticks: int) -> dict[str, list[float]]:
    """Seconds by which ticks were late, and of one call behind each, in turn."""
    clock, found = time.perf_counter, {name: list[float]() for name in ("tick is late", *calls)}
    late = found["tick is late"]
    names = list(calls) * ticks
    start = clock() + PERIOD
    for k, name in enumerate(names):
        call, kept, tick = calls[name], found[name], start + k * PERIOD
        while (rest := tick - clock()) > 0:
            time.sleep(rest)
        begin = clock()
        call()
        end = clock()
        kept.append(end - begin)
        late.append(begin - tick)
        if late[-1] > PERIOD:  # missed: the next ticks are not made up for
            start += late[-1]
    return found


def summary(values: list[float]) -> dict[str, Any]:
    """Percentiles, the longest, and a histogram."""
    counts, _ = np.histogram(np.clip(values, EDGES[0], EDGES[-1]), EDGES)
    shares = {str(p): float(np.percentile(values, p)) for p in PERCENTILES}
    return {"count": len(values), "percentiles": shares, "longest": max(values), "counts": counts.tolist()}


def tables(results: Results) -> dict[str, str]:
    """Every table of the page, by its name."""
    lines = [[k, f"{row['ns'] / 1e3:.2f}", three(row["pinocchio_faster"])] for k, row in results["single"].items()]
    head = ["", *(f"{p} % within [us]" for p in PERCENTILES), "longest [us]"]
    ticked = [
        [
            name,
            *(
                f"{1e6 * s:.2g}" if s < 1e-5 else f"{1e6 * s:.0f}"
                for s in (*row["percentiles"].values(), row["longest"])
            ),
        ]
        for name, row in results["loop"].items()
    ]
    return {
        "single": table(["call", "CPU time [us]", "times the speed of Pinocchio"], lines),
        "loop": table(head, ticked),
    }


def picture(results: Results) -> Any:
    """Histograms of the loop: of calls, and of the ticks that they waited for."""
    figure = blank_figure(8.2, 3.9)
    ax = figure.subplots()
    for name, row in results["loop"].items():
        style = {"color": COLORS[name]} if name in COLORS else {"color": "black", "linestyle": ":"}
        ax.stairs(np.array(row["counts"]) / row["count"], EDGES * 1e6, label=name, **style)
    ax.set(xscale="log", yscale="log", xlim=(0.1, 1e4), xlabel="time [us]", ylabel="share of the ticks [1]")
    ax.set_title("A loop of 1 kHz in Python: the call, and how late its tick comes", fontsize="medium")
    ax.grid(True, alpha=0.25)
    ax.legend(frameon=False, fontsize="small")
    return figure


def main() -> None:
    quick = is_quick(__doc__)
    results = run(quick)
    print("\n\n".join(f"{name}:\n\n{text}" for name, text in tables(results).items()))
    figure = picture(results)
    if quick:
        print(QUICK_NOTE)
        return
    write("control_loop.json", results)
    figure.savefig(DOCS / "benchmarks" / "control_loop.png", facecolor="white", dpi=150)
    rewrite(tables(results), DOCS / "in-a-control-loop.md")


if __name__ == "__main__":
    main()
