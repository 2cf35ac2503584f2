"""Interleaved timing: what is compared runs in turn, so that a machine's moods fall on all alike."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

RESULTS = Path(__file__).parent / "results"


def interleaved(calls: Mapping[str, Callable[[], Any]], repeats: int, warm_ups: int = 1) -> dict[str, list[float]]:
    """Seconds of each call, run in turn `repeats` times after the warm-ups."""
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for repeat in range(warm_ups + repeats):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            if repeat >= warm_ups:
                seconds[name].append(time.perf_counter() - start)
    return seconds


def repeats_within(calls: Mapping[str, Callable[[], Any]], seconds: float, least: int = 5, most: int = 41) -> int:
    """How often all calls can take turns within a time, from one run of each."""
    start = time.perf_counter()
    for call in calls.values():
        call()
    return min(max(int(seconds / (time.perf_counter() - start)), least), most)


def many(call: Callable[[], Any], times: int) -> Callable[[], None]:
    """The call repeated, for calls too short to time alone."""

    def repeated() -> None:
        for _ in range(times):
            call()

    return repeated


def ratio(seconds: Mapping[str, list[float]], a: str, b: str) -> tuple[float, float, float]:
    """Median time of a over that of b, and the smallest and largest ratio of neighbouring runs."""
    pairs = [x / y for x, y in zip(seconds[a], seconds[b], strict=True)]
    return statistics.median(seconds[a]) / statistics.median(seconds[b]), min(pairs), max(pairs)


def machine() -> dict[str, Any]:
    """What a reader needs to judge the figures."""
    model = "unknown"
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [
            line.split(":")[1].strip() for line in cpuinfo.read_text().splitlines() if line.startswith("model name")
        ]
        model = names[0] if names else model
    packages = {name: importlib.metadata.version(name) for name in ("numpy", "scipy", "pin", "example-robot-data")}
    return {"cpu": model, "cores": os.cpu_count(), "python": platform.python_version(), **packages}


def write(name: str, content: Mapping[str, Any]) -> None:
    """Keep results as JSON beside the benchmarks."""
    RESULTS.mkdir(exist_ok=True)
    text = json.dumps({"machine": machine(), "numpy_simd": simd()} | dict(content), indent=1)
    (RESULTS / name).write_text(text + "\n")


def simd() -> list[str]:
    """Vector extensions that NumPy uses here."""
    config: Any = np.show_config(mode="dicts")
    return list(config.get("SIMD Extensions", {}).get("found", []))
