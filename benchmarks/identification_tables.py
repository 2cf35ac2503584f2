"""The tables of the pages on identification below docs/benchmarks, from the last results."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.measure import RESULTS
from benchmarks.pages import DOCS, rewrite, table
from rne.basics.spatial import Array

PAGES = tuple(
    DOCS / "benchmarks" / f"{name}.md" for name in ("identification", "identification-payload", "public-logs")
)


def rewrite_page() -> None:
    """Write the tables of the last results into their pages."""
    rewrite(tables(), *PAGES)


def tables() -> dict[str, str]:
    """Tables by their names, from the last results."""
    names = ("", "_faults", "_payload", "_couplings")
    found, faults, payloads, couplings = (last(f"identification{name}") for name in names)
    logs = last("public_logs")
    return {
        "coverage": noise_table(found["noise on torques"]),
        "sensors": sensor_table(found["sensors"]),
        "logs": log_table(logs["logs"]),
        "faults": fault_table(faults["rows"]),
        "noisy-faults": noisy_table(faults["noisy"]),
        "payloads": load_table(payloads["loads"]),
        "drive-gains": gain_table(payloads["gains"]),
        "couplings": coupling_table(couplings),
    }


def last(name: str) -> dict[str, Any]:
    """The last results of a benchmark."""
    found: dict[str, Any] = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
    return found


def numbers(lines: Sequence[str]) -> Array:
    """Kept numbers, a row for each run."""
    return np.array([line.split() for line in lines], float)


def noise_table(found: dict[str, Any]) -> str:
    """Coverage of the standard errors."""
    rows = [
        ["runs, base parameters", f"{found['runs']}, {found['parameters']}"],
        ["true values within three standard errors", f"{100 * found['within three']:.1f} %"],
        ["of the parameter least often so", f"{100 * found['least of a parameter']:.1f} % of the runs"],
        ["all at once", f"{100 * found['all at once']:.1f} % of the runs"],
        ["error over standard error, rms", f"{found['error / standard error']:.2f}"],
        ["physically consistent", f"{found['consistent']} of {found['runs']}"],
    ]
    return table(["noise on the torques alone", ""], rows)


def sensor_table(cases: Sequence[dict[str, Any]]) -> str:
    """Predictions and bias by encoder and cut-off."""
    rows = [
        [
            f"{c['bits']} bits",
            f"{c['cutoff']:g} Hz",
            f"{max(c['error / noise']):.2f}",
            f"{c['bias / standard error']:.2f}",
            f"{c['worst bias']:.1f} ({c['of']})",
            f"{c['consistent']} of {c['runs']}",
        ]
        for c in cases
    ]
    head = ["encoder", "cut-off", "error / noise, another motion", "bias / standard error", "worst bias", "consistent"]
    return table(head, rows)


def log_table(logs: Sequence[dict[str, Any]]) -> str:
    """Errors of predicted torques of published logs."""
    rows = [
        [
            f"{log['robot']}, {log['cutoff']:.1f} Hz" + (" (chosen)" if log["chosen"] else ""),
            str(log["parameters"]),
            f"{log['condition']:.0f}",
            " ".join(f"{e:.1f}" for e in log["error"]),
            " ".join(f"{x:.2f}" for x in log["Fv"]),
            " ".join(f"{x:.2f}" for x in log["Fc"]),
        ]
        for log in logs
    ]
    return table(
        ["log, cut-off", "base parameters", "condition", "error per joint [%]", "Fv [N m s/rad]", "Fc [N m]"], rows
    )


def fault_table(rows: list[dict[str, Any]]) -> str:
    """A row per fault."""
    head = ["fault", "runs", "equal", "wrong", "not wrong, or named", "wrong and silent", "warned"]
    keys = ("fault", "runs", "equal", "wrong", "good", "silent", "warned")
    total = {key: sum(row[key] for row in rows if row["fault"] != "clean") for key in keys[1:]}
    lines = [*rows, {"fault": "all faults"} | total]
    return table(head, [[str(row[key]).replace("clean", "none") for key in keys] for row in lines])


def noisy_table(rows: list[dict[str, Any]]) -> str:
    """A row of the logs without a fault, and one of those with any."""
    keys = ("runs", "equal", "wrong", "good", "silent", "blamed")
    kinds = {kind: [r for r in rows if (r["fault"] == "clean") == (kind == "none")] for kind in ("none", "any")}
    lines = [[kind, *(str(sum(row[key] for row in found)) for key in keys)] for kind, found in kinds.items()]
    return table(["fault", "runs", "equal", "wrong", "not wrong, or named", "wrong and silent", "blamed"], lines)


def load_table(cases: list[dict[str, Any]]) -> str:
    """A row per robot and encoder."""
    rows = []
    for case in cases:
        mass, stated, z, com, com_z, inertia_z, replaced = (np.array(values) for values in case["runs"].values())
        rows.append(
            [
                case["robot"],
                case["drives"],
                f"{case['bits']} bits" if case["bits"] else "exact",
                str(len(mass)),
                f"{100 * np.median(np.abs(mass)):.2f}, {100 * np.abs(mass).max():.2f}",
                f"{100 * (np.abs(mass) < 0.02).mean():.0f} %",
                f"{100 * np.median(stated):.2f}",
                f"{100 * (np.abs(z) < 3).mean():.0f} %",
                f"{1000 * np.median(com):.2f}, {1000 * com.max():.2f}",
                f"{100 * (com_z < 3).mean():.0f} %, {100 * (inertia_z < 3).mean():.0f} %",
                f"{int(replaced.sum())}",
            ]
        )
    head = [
        "robot",
        "drives",
        "positions",
        "runs",
        "error of the mass, median and largest [%]",
        "within 2 %",
        "standard error, median [%]",
        "within three standard errors",
        "error of the centre, median and largest [mm]",
        "centre, inertia within three",
        "impossible by least squares",
    ]
    return table(head, rows)


def coupling_table(found: dict[str, Any]) -> str:
    """A row per robot and kind of estimate."""
    kinds = {"parameters": "base parameters", "loads": "mass and centre of a load", "gains": "drive gains"}
    rows = []
    for kind, text in kinds.items():
        for case in found[kind]:
            z = numbers(case["runs"]["z"])
            known = np.abs(z[np.isfinite(z)])
            rows.append([case["robot"], text, str(len(z)), str(known.size), f"{100 * (known < 3).mean():.1f} %"])
    return table(["robot", "estimates", "runs", "numbers", "within three standard errors"], rows)


def gain_table(cases: list[dict[str, Any]]) -> str:
    """A row per robot."""
    rows = []
    for case in cases:
        error, z = (numbers(case["runs"][key]) for key in ("error", "z"))
        told = np.isfinite(error)
        rows.append(
            [
                case["robot"],
                case["drives"],
                case["given"],
                str(len(error)),
                " ".join(f"{100 * x:.0f}" for x in told.mean(0)),
                " ".join(f"{x:.2f}" for x in 100 * np.nanmedian(np.abs(error), axis=0)),
                f"{100 * (np.abs(error[told]) < 0.02).mean():.0f} %",
                f"{100 * (np.abs(z[told]) < 3).mean():.1f} %",
            ]
        )
    head = [
        "robot",
        "drives",
        "given of the load",
        "runs",
        "found, per joint [% of the runs]",
        "median error per joint [%]",
        "within 2 %",
        "within three standard errors",
    ]
    return table(head, rows)
