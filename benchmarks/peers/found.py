"""Which packages are there, and what a call to be timed is."""

from __future__ import annotations

import functools
import importlib
import importlib.metadata
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import rne

OTHERS = {
    "mujoco": "mujoco",
    "casadi": "casadi",
    "roboticstoolbox": "roboticstoolbox-python",
    "adam": "adam-robotics",
}
Call = Callable[[], Any]


@dataclass(frozen=True)
class Case:
    """A robot, a quantity and the states to compute it in: q, rates, and accelerations or torques, each (N, n)."""

    robot: rne.Robot
    quantity: str
    kernel: rne.Kernel
    states: list[np.ndarray]

    @property
    def arrays(self) -> list[np.ndarray]:
        """The arguments that the quantity takes."""
        return self.states[: len(self.kernel.names)]


class Point(NamedTuple):
    """A call that does `count` states, and what it gave for the first few of them."""

    name: str
    call: Call
    count: int
    results: Callable[[int], np.ndarray]
    precision: str = "float64"
    build_s: float | None = None  # to compile C


@functools.cache
def module(name: str) -> Any:
    """The module, or why it cannot be had."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        return "not installed" if name.startswith(missing) else f"its import needs {missing}"
    except Exception as error:  # a package older than this NumPy fails in many ways
        return f"its import fails: {error}"


def left_out() -> dict[str, str]:
    """Why a package is not in the charts, by name."""
    reasons = {name: found for name in OTHERS if isinstance(found := module(name), str)}
    if "casadi" not in reasons and compiler() is None:
        reasons["C of CasADi"] = "there is no C compiler `cc`"
    if "adam" not in reasons and isinstance(found := module("adam.casadi"), str):
        reasons["adam.casadi"] = found
    missing = isinstance(module("pinocchio.casadi"), str)
    reasons["pinocchio.casadi"] = "not part of this Pinocchio" if missing else "no calls written"
    return reasons


def compiler() -> str | None:
    """The system's C compiler."""
    return shutil.which("cc")


def versions() -> dict[str, str]:
    """Of those that are compared."""
    reasons = left_out()
    found = {name: importlib.metadata.version(OTHERS[name]) for name in OTHERS if name not in reasons}
    if "casadi" in found and (cc := compiler()):
        run = subprocess.run([cc, "-dumpfullversion"], capture_output=True, text=True, check=False)
        found["cc"] = run.stdout.strip() or "of unknown version"
    return found
