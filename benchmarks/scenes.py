"""Chart D: what a scene pays. Parts are taken away down to the plain arm; what is not modelled must cost nothing.

A scene's dx/dt is one kernel: controller, friction, limits and forward dynamics together. Pinocchio's ABA stands
beside the scenes that are an arm alone; friction and controllers it leaves to its caller, and its batch call crashes
on a single joint. Errors are those of the accelerations, against the recursion in long double.
"""

from __future__ import annotations

import statistics
from dataclasses import replace
from typing import Any

import numpy as np

import rne
from benchmarks.evaluation import states
from benchmarks.kernels import robots
from benchmarks.measure import interleaved, ratio
from benchmarks.peers import Pinocchio
from benchmarks.pictures import OURS, PINOCCHIO, table, three
from rne.plotting.plots import blank_figure

EXACT = 200  # states whose error is taken, against long double


def ladder(robot: rne.Robot) -> dict[str, rne.Scene]:
    """From the full scene to the plain arm, each a part less than the one before, and less than that arm."""
    n = robot.n
    wrist = {name: 0.3 for name in robot.joint_names[3:]}
    rest = {name: 0.3 for k, name in enumerate(robot.joint_names) if k != 1}
    law = rne.control.pd_gravity(robot, [200.0] * n, [30.0] * n, [0.5] * n)
    load = rne.Payload(3.0, [0.05, 0.02, 0.1], np.diag([0.02, 0.03, 0.01]))
    friction = rne.Friction(viscous=np.full(n, 5.0), coulomb=np.full(n, 2.0))
    full = rne.Scene(robot, payload=load, friction=friction, armature=np.full(n, 0.5), controller=law)
    scenes = {"all: payload, armature, friction, PD with gravity term": full}
    for title, less in (
        ("without controller", {"controller": None}),
        ("without friction", {"friction": None}),
        ("without armature", {"armature": None}),
        ("without payload: the plain arm", {"payload": None}),
        ("the plain arm without gravity", {"gravity": np.zeros(3)}),
        ("the plain arm, wrist locked: three joints", {"gravity": None, "locked": wrist}),
        ("the plain arm, all but one joint locked", {"locked": rest}),
    ):
        full = replace(full, **less)
        scenes[title] = full
    return scenes


def compare(robot: rne.Robot, count: int, repeats: int) -> dict[str, Any]:
    """Every scene of the ladder in one interleaved run, the arms alone with Pinocchio's."""
    scenes = ladder(robot)
    calls: dict[str, Any] = {}
    rows: dict[str, dict[str, Any]] = {}
    for title, scene in scenes.items():
        q, qd, tau = states(scene.n, count)
        kernel = scene.kernel
        x = np.concatenate([q, qd, np.zeros((count, scene.right_hand_side.size - 2 * scene.n))], axis=1)
        t = np.zeros((count, 1))
        out = kernel(t, x)
        calls[title] = lambda k=kernel, t=t, x=x, o=out: k(t, x, out=o)
        few = min(EXACT, count)
        long = scene.right_hand_side(scene.arm.model, t[:few].astype(np.longdouble), x[:few].astype(np.longdouble))
        acceleration = slice(scene.n, 2 * scene.n)
        exact = long[:, acceleration]
        rows[title] = {
            "joints": scene.n,
            "operations": sum(kernel.operations.values()),
            "error": _worst(out[:few, acceleration], exact),
        }
        if scene.controller is None and scene.friction is None and scene.n > 1:
            theirs = Pinocchio(scene.arm.model, rne.to_urdf(scene.arm.model), [q, qd, 0 * tau])
            batch = theirs.batch("forward_dynamics")
            assert batch is not None
            batch()
            calls[f"Pinocchio, {title}"] = batch
            rows[title]["pinocchio_error"] = _worst(theirs.ours(theirs.out[:, :few]), exact)
    seconds = interleaved(calls, repeats)
    first = next(iter(scenes))
    for title, row in rows.items():
        row["ns_a_state"] = statistics.median(seconds[title]) / count * 1e9
        row["times_faster_than_full"] = ratio(seconds, first, title)
        name = f"Pinocchio, {title}"
        if name in seconds:
            row["pinocchio_ns_a_state"] = statistics.median(seconds[name]) / count * 1e9
            row["times_faster"] = ratio(seconds, name, title)
    return rows


def _worst(got: np.ndarray, exact: np.ndarray) -> float:
    return float((np.abs(got - exact).max(1) / np.abs(exact).max(1)).max())


def run(quick: bool) -> dict[str, Any]:
    """IRB 140 and UR5."""
    count, repeats = (200, 1) if quick else (20_000, 15)
    found = {name: robot for name, (robot, _) in robots().items() if name in ("irb140", "ur5")}
    return {
        "states": count,
        "repeats": repeats,
        "robots": {n: compare(r, count, repeats) for n, r in found.items()},
    }


def picture(results: dict[str, Any]) -> Any:
    """Operations and time a state, a bar for each scene."""
    found = results["robots"]
    figure = blank_figure(14, 3.9 * len(found) + 0.5)
    grid = np.atleast_2d(figure.subplots(len(found), 2, sharey=True, sharex="col"))
    figure.suptitle("What a scene pays: dx/dt of a state, parts taken away row by row")
    for axes, (robot, rows) in zip(grid, found.items(), strict=True):
        places = np.arange(len(rows))
        axes[0].set_yticks(places, list(rows))
        bars = axes[0].barh(places, [r["operations"] for r in rows.values()], color=OURS, height=0.6)
        axes[0].bar_label(bars, padding=3, fontsize="small")
        bars = axes[1].barh(places - 0.2, [r["ns_a_state"] for r in rows.values()], color=OURS, height=0.38)
        axes[1].bar_label(bars, fmt="%.0f", padding=3, fontsize="small")
        there = [k for k, r in enumerate(rows.values()) if "times_faster" in r]
        values = [r["pinocchio_ns_a_state"] for r in rows.values() if "times_faster" in r]
        bars = axes[1].barh(np.array(there) + 0.2, values, color=PINOCCHIO, height=0.38)
        axes[1].bar_label(bars, fmt="%.0f", padding=3, fontsize="small")
        axes[1].barh([0], [0], color=OURS, label="rne, scene's kernel, batch")
        axes[1].barh([0], [0], color=PINOCCHIO, label="Pinocchio, ABA of the same arm, batch")
        axes[1].legend(loc="lower right", fontsize="small", frameon=False)
        for ax in axes:
            ax.set_title(robot)
            ax.grid(True, axis="x", alpha=0.3)
            ax.set_axisbelow(True)
            ax.margins(x=0.1)
    grid[0, 0].invert_yaxis()
    grid[-1, 0].set_xlabel("operations a state [1]")
    grid[-1, 1].set_xlabel(f"time a state [ns], batch of {results['states']}")
    return figure


def tables(results: dict[str, Any]) -> str:
    """All scenes."""
    rows = [
        [
            robot,
            title,
            str(row["joints"]),
            str(row["operations"]),
            f"{row['ns_a_state']:.0f}",
            three(row["times_faster_than_full"]),
            f"{row['error']:.1e}",
            f"{row['pinocchio_ns_a_state']:.0f}" if "times_faster" in row else "-",
            three(row["times_faster"]) if "times_faster" in row else "-",
            f"{row['pinocchio_error']:.1e}" if "times_faster" in row else "-",
        ]
        for robot, scenes in results["robots"].items()
        for title, row in scenes.items()
    ]
    head = ["robot", "scene", "joints", "operations", "ns a state", "times the full scene's speed", "error"]
    return table([*head, "Pinocchio ns", "times its speed", "Pinocchio's error"], rows)
