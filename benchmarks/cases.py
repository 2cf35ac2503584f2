"""Common parts of the benchmarks: quantities, robots and states."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import rne
from benchmarks.peers.registry import import_failure
from rne.urdf.loading import library

QUANTITIES: dict[str, tuple[Any, int]] = {  # the function and how many of (q, qd, qdd or tau) it takes
    "inverse_dynamics": (rne.dynamics.inverse_dynamics, 3),
    "mass_matrix": (rne.dynamics.mass_matrix, 1),
    "forward_dynamics": (rne.dynamics.forward_dynamics, 3),
}
ENGINES = {"numpy": "NumPy", "numba": "Numba"}  # as `rne.load` takes them and as tables show them
FREE_FINGERS = "panda without its mimic tag"
RATES = (np.pi, 10.0, 50.0)  # largest angles [rad], rates [rad/s], and accelerations [rad/s^2] or torques [N m]


def load(name: str, engine: str = "numpy") -> rne.Robot:
    """One of the compared robots."""
    if name == FREE_FINGERS:
        return without_mimics(library()["panda"], engine)
    return rne.load(name, engine=engine)


def without_mimics(path: Path, engine: str) -> rne.Robot:
    """The robot of a URDF whose mimic tags are removed, so that every joint is a coordinate."""
    text = re.sub(r"<mimic[^>]*/>", "", path.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        changed = Path(folder) / path.name
        changed.write_text(text, encoding="utf-8")
        return rne.load(changed, engine=engine)


def engines() -> tuple[str, ...]:
    """Engines that can run here, NumPy's first."""
    return tuple(name for name in ENGINES if import_failure(name) is None)


def compiled_by_numba(quick: bool) -> tuple[str, ...]:
    """The quantities that Numba compiles: all; in a quick run one, because each takes seconds; none without Numba."""
    if "numba" not in engines():
        return ()
    return ("mass_matrix",) if quick else tuple(QUANTITIES)


def engines_left_out() -> dict[str, str]:
    """The others, and why."""
    return {title: reason for name, title in ENGINES.items() if (reason := import_failure(name))}


def states(n: int, count: int, seed: int = 0) -> list[np.ndarray]:
    """Random q, rates, and accelerations or torques, which float32 holds exactly."""
    rng = np.random.default_rng(seed)
    return [rng.uniform(-x, x, (count, n)).astype(np.float32).astype(float) for x in RATES]


def title(quantity: str) -> str:
    """Title in tables and pictures."""
    return quantity.replace("_", " ")
