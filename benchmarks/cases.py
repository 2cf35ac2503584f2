"""What the benchmarks share: quantities, robots and states."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path
from typing import Any

import numpy as np

import rne

QUANTITIES: dict[str, tuple[Any, int]] = {  # the function and how many of (q, qd, qdd or tau) it takes
    "inverse_dynamics": (rne.inverse_dynamics, 3),
    "mass_matrix": (rne.mass_matrix, 1),
    "forward_dynamics": (rne.forward_dynamics, 3),
}
RATES = (np.pi, 10.0, 50.0)  # largest angles [rad], rates [rad/s], and accelerations [rad/s^2] or torques [N m]


def data_robots() -> dict[str, Path]:
    """URDF files of example-robot-data, by short name."""
    files = importlib.metadata.files("example-robot-data") or []
    return {
        f"{f.parts[f.parts.index('robots') + 1]}/{f.stem}": Path(str(f.locate())) for f in files if f.suffix == ".urdf"
    }


def load(name: str) -> rne.Robot:
    """One of the compared robots."""
    short = {"ur5": "ur_description/ur5_robot", "panda": "panda_description/panda"}
    return rne.load(data_robots()[short[name]] if name in short else name)


def states(n: int, count: int, seed: int = 0) -> list[np.ndarray]:
    """Random q, rates, and accelerations or torques, which float32 holds exactly."""
    rng = np.random.default_rng(seed)
    return [rng.uniform(-x, x, (count, n)).astype(np.float32).astype(float) for x in RATES]


def title(quantity: str) -> str:
    """As tables and pictures show it."""
    return quantity.replace("_", " ")
