"""Interleaved timing: compared calls run in turn, so that changes of the machine's speed affect all of them alike."""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import json
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

RESULTS = Path(__file__).parent / "results"
QUICK_NOTE = (
    "--quick: these figures are not for comparison. A kernel's batch call has a fixed cost, which outweighs the small "
    "batches of a quick run and reverses the ranking."
)
Call = Callable[[], Any]
Spread = tuple[float, float, float]  # median, smallest, largest


def command_line(doc: str | None) -> argparse.ArgumentParser:
    """The command line that all have: --quick."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few states, few repeats, no file is written")
    return parser


def is_quick(doc: str | None) -> bool:
    """Read a command line that has no other option."""
    return bool(command_line(doc).parse_args().quick)


def interleaved(
    calls: Mapping[str, Callable[[], Any]],
    repeats: int,
    warm_ups: int = 1,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, list[float]]:
    """Seconds of each call, run in turn `repeats` times after the warm-ups; of the processor by `time.process_time`."""
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for repeat in range(warm_ups + repeats):
        for name, call in calls.items():
            start = clock()
            call()
            if repeat >= warm_ups:
                seconds[name].append(clock() - start)
    return seconds


def per_state(
    calls: Mapping[str, tuple[Callable[[], Any], int]], repeats: int, clock: Callable[[], float] = time.perf_counter
) -> dict[str, list[float]]:
    """Seconds per state of calls that each compute a number of states, run in turn."""
    seconds = interleaved({name: call for name, (call, _) in calls.items()}, repeats, clock=clock)
    return {name: [s / calls[name][1] for s in runs] for name, runs in seconds.items()}


def repeats_within(calls: Sequence[Callable[[], Any]], seconds: float, least: int = 5, most: int = 41) -> int:
    """Number of turns of all calls within a time, judged by one run of each."""
    start = time.perf_counter()
    for call in calls:
        call()
    return min(max(int(seconds / (time.perf_counter() - start)), least), most)


def within(call: Callable[[], Any], seconds: float, most: int = 50) -> int:
    """Number of calls within a time, at least one; the first call may compile."""
    for _ in range(2):
        start = time.perf_counter()
        call()
        took = time.perf_counter() - start
        if took > 10 * seconds:
            return 1
    return min(max(int(seconds / took), 1), most)


def many(call: Callable[[], Any], times: int) -> Callable[[], None]:
    """The call repeated, for calls too short to time alone."""

    def repeated() -> None:
        for _ in range(times):
            call()

    return repeated


def ratio(seconds: Mapping[str, list[float]], a: str, b: str) -> Spread:
    """Median time of a over that of b, and the smallest and largest ratio of neighbouring runs."""
    pairs = [x / y for x, y in zip(seconds[a], seconds[b], strict=True)]
    return statistics.median(seconds[a]) / statistics.median(seconds[b]), min(pairs), max(pairs)


def nanoseconds(seconds: Sequence[float]) -> float:
    """The median in ns."""
    return statistics.median(seconds) * 1e9


def machine() -> dict[str, Any]:
    """Processor and versions, without which times say nothing."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    needed = ("numpy", "scipy", "pin", "example-robot-data", "numba")
    there = {name for name in needed if name != "numba" or importlib.util.find_spec(name)}
    packages = {name: importlib.metadata.version(name) for name in needed if name in there}
    cpu = names[0] if names else "unknown"
    return {"cpu": cpu, "cores": os.cpu_count(), "python": platform.python_version(), **packages}


def write(name: str, content: Mapping[str, Any]) -> None:
    """Keep results as JSON beside the benchmarks, with the day of the run."""
    RESULTS.mkdir(exist_ok=True)
    about = {"date": date.today().isoformat(), "machine": machine(), "numpy_simd": simd()}
    text = json.dumps(about | dict(content), indent=1)
    (RESULTS / name).write_text(text + "\n", encoding="utf-8")


def simd() -> list[str]:
    """Vector extensions that NumPy uses here."""
    config: Any = np.show_config(mode="dicts")
    return list(config.get("SIMD Extensions", {}).get("found", []))
