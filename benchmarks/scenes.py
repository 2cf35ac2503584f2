"""Chart D: what a scene costs. Parts are removed one by one down to the bare arm, and then parts of the arm.

A scene's dx/dt is one kernel: controller, friction, limits and forward dynamics together. Pinocchio's ABA stands
beside the scenes that are an arm alone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import rne
from benchmarks.batch_sizes import EXACT, error
from benchmarks.cases import load, states
from benchmarks.measure import nanoseconds, per_state, ratio
from benchmarks.pages import table, three
from benchmarks.peers.pinocchio import Pinocchio
from benchmarks.pictures import OURS, PINOCCHIO
from rne.model.topology import end_link
from rne.plotting.plots import blank_figure


def ladder(robot: rne.Robot) -> dict[str, rne.Scene]:
    """From the full scene to the bare arm, each a part less than the one before, and less than that arm."""
    n = robot.n
    wrist = {name: 0.3 for name in robot.joint_names[3:]}
    rest = {name: 0.3 for k, name in enumerate(robot.joint_names) if k != 1}
    law = rne.control.pd_gravity(robot, [200.0] * n, [30.0] * n, [0.5] * n)
    payload = rne.Payload(3.0, [0.05, 0.02, 0.1], np.diag([0.02, 0.03, 0.01]), end_link(robot.model))
    friction = rne.Friction(viscous=np.full(n, 5.0), coulomb=np.full(n, 2.0))
    full = rne.Scene(robot, payload=payload, friction=friction, armature=np.full(n, 0.5), controller=law)
    scenes = {"all: payload, armature, friction, PD with gravity term": full}
    for title, less in (
        ("without controller", {"controller": None}),
        ("without friction", {"friction": None}),
        ("without armature", {"armature": None}),
        ("without payload: the bare arm", {"payload": None}),
        ("the bare arm without gravity", {"gravity": np.zeros(3)}),
        ("the bare arm, wrist locked: three joints", {"gravity": None, "locked": wrist}),
        ("the bare arm, all but one joint locked", {"locked": rest}),
    ):
        full = replace(full, **less)
        scenes[title] = full
    return scenes


def compare(robot: rne.Robot, count: int, repeats: int) -> dict[str, Any]:
    """Run of every scene of the ladder, interleaved, the bare arms with Pinocchio."""
    scenes = ladder(robot)
    calls: dict[str, Any] = {}
    rows: dict[str, dict[str, Any]] = {}
    for title, scene in scenes.items():
        q, qd, tau = states(scene.n, count)
        kernel, dynamics = scene.kernel, scene.dynamics
        x = np.concatenate([q, qd, np.zeros((count, dynamics.counted - 2 * scene.n))], axis=1)
        t = np.zeros((count, 1))
        out = kernel(t, x)
        calls[title] = lambda k=kernel, t=t, x=x, o=out: k(t, x, out=o), count
        qdd = slice(scene.n, 2 * scene.n)
        f, numbers = kernel.function, replace(dynamics, has_energies=False).vector

        def accelerations(model: rne.Model, t: Any, x: Any, f: Any = f, v: Any = numbers, qdd: Any = qdd) -> np.ndarray:
            return np.asarray(f.evaluate(model, t, x, v)[0][:, qdd])

        model = kernel.model
        operations = sum(kernel.operations.values())
        worst = error(accelerations, model, [t, x], out[:, qdd])
        rows[title] = {"joints": scene.n, "operations": operations, "error": worst}
        if scene.controller is None and scene.friction is None and scene.n > 1:
            theirs = Pinocchio(model, [q, qd, 0 * tau])
            calls[f"Pinocchio, {title}"] = theirs.fastest("forward_dynamics")
            result = theirs.results("forward_dynamics", min(EXACT, count))
            rows[title]["pinocchio_error"] = error(accelerations, model, [t, x], result)
    each = per_state(calls, repeats)
    for title, row in rows.items():
        row["ns_per_state"] = nanoseconds(each[title])
        row["times_faster_than_full"] = ratio(each, next(iter(scenes)), title)
        if f"Pinocchio, {title}" in each:
            row["pinocchio_ns_per_state"] = nanoseconds(each[f"Pinocchio, {title}"])
            row["times_faster"] = ratio(each, f"Pinocchio, {title}", title)
    return rows


def run(quick: bool) -> dict[str, Any]:
    """IRB 140 and UR5."""
    count, repeats = (200, 1) if quick else (20_000, 15)
    names = ("irb140",) if quick else ("irb140", "ur5")
    robots = {name: compare(load(name), count, repeats) for name in names}
    return {"states": count, "repeats": repeats, "robots": robots}


def picture(results: dict[str, Any]) -> Any:
    """Operations and time per state, a bar for each scene."""
    found = results["robots"]
    figure = blank_figure(9.4, 3.9 * len(found) + 0.5)
    grid = figure.subplots(len(found), 2, sharey=True, sharex="col", squeeze=False)
    figure.suptitle("What a scene costs: dx/dt per state, parts removed row by row")
    for (left, right), (robot, rows) in zip(grid, found.items(), strict=True):
        left.set_yticks(np.arange(len(rows)), list(rows))
        bars = left.barh(np.arange(len(rows)), [r["operations"] for r in rows.values()], color=OURS, height=0.6)
        left.bar_label(bars, padding=3, fontsize="small")
        theirs = [k for k, r in enumerate(rows.values()) if "times_faster" in r]
        values = list(rows.values())
        for places, key, color, label in (
            (np.arange(len(rows)) - 0.2, "ns_per_state", OURS, "rne, scene's kernel, batch"),
            (np.array(theirs) + 0.2, "pinocchio_ns_per_state", PINOCCHIO, "Pinocchio, ABA of the same arm, batch"),
        ):
            lengths = [r[key] for r in values if key in r]
            bars = right.barh(places, lengths, color=color, height=0.38, label=label)
            right.bar_label(bars, fmt="%.0f", padding=3, fontsize="small")
        for ax in (left, right):
            ax.set_title(robot)
            ax.grid(True, axis="x", alpha=0.3)
            ax.set_axisbelow(True)
            ax.margins(x=0.2)
    grid[0, 0].invert_yaxis()
    grid[-1, 0].set_xlabel("operations per state [1]")
    grid[-1, 1].set_xlabel(f"time per state [ns], batch of {results['states']}")
    figure.legend(*grid[0, 1].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    return figure


def tables(results: dict[str, Any]) -> dict[str, str]:
    """All scenes."""
    rows = [
        [
            robot,
            title,
            str(row["joints"]),
            str(row["operations"]),
            f"{row['ns_per_state']:.0f}",
            three(row["times_faster_than_full"]),
            f"{row['error']:.1e}",
            f"{row['pinocchio_ns_per_state']:.0f}" if "times_faster" in row else "-",
            three(row["times_faster"]) if "times_faster" in row else "-",
            f"{row['pinocchio_error']:.1e}" if "times_faster" in row else "-",
        ]
        for robot, scenes in results["robots"].items()
        for title, row in scenes.items()
    ]
    head = ["robot", "scene", "joints", "operations", "ns per state", "times the full scene's speed", "error"]
    return {"scenes": table([*head, "Pinocchio ns", "times its speed", "Pinocchio's error"], rows)}
