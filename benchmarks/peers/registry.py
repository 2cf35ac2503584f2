"""The registry of peers: what a peer is, which ones are registered, and which can take part on this machine."""

from __future__ import annotations

import functools
import importlib
import importlib.metadata
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import rne

Call = Callable[[], Any]


@dataclass(frozen=True)
class Case:
    """A robot, a quantity, its kernel, and the states: q, rates, and accelerations or torques, each (N, n)."""

    robot: rne.Robot
    quantity: str
    kernel: rne.kernels.Kernel
    states: list[np.ndarray]

    @property
    def arrays(self) -> list[np.ndarray]:
        """The arguments that the quantity takes."""
        return self.states[: len(self.kernel.names)]


class Point(NamedTuple):
    """A call that computes `count` states, and a function that gives its results for the first few of them."""

    name: str
    call: Call
    count: int
    results: Callable[[int], np.ndarray]
    precision: str = "float64"
    build_s: float | None = None  # time to trace or compile what is called


Points = Callable[[Case], list[Point]]


@dataclass(frozen=True)
class Peer:
    """Another package, and the function that gives its points.

    Attributes
    ----------
    name : str
        As the tables show it.
    requirement : str
        What pip installs.
    modules : tuple of str
        What `points` imports.
    compiles : bool
        True if it needs a C compiler.
    points : callable
        points(case) -> list of Point; raises ValueError for a robot that the package cannot take.
    """

    name: str
    requirement: str
    modules: tuple[str, ...]
    compiles: bool
    points: Points

    @property
    def distribution(self) -> str:
        """The package's name for pip, without its version."""
        return re.split(r"[^\w.-]", self.requirement)[0]

    def missing(self) -> str | None:
        """Why it cannot take part on this machine, if it cannot."""
        for name in self.modules:
            if reason := import_failure(name):
                return reason
        return "there is no C compiler `cc`" if self.compiles and compiler() is None else None


PEERS: dict[str, Peer] = {}


def peer(
    name: str, *, requirement: str, modules: tuple[str, ...], compiles: bool = False
) -> Callable[[Points], Points]:
    """Register a function that gives points; see `Peer` for the arguments."""

    def register(points: Points) -> Points:
        PEERS[name] = Peer(name, requirement, modules, compiles, points)
        return points

    return register


@functools.cache
def import_failure(name: str) -> str | None:
    """Why a module cannot be imported, if it cannot."""
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        return "not installed" if name.startswith(missing) else f"its import needs {missing}"
    except Exception as error:  # a package older than this NumPy fails in many ways
        return f"its import fails: {error}"
    return None


def left_out() -> dict[str, str]:
    """The peers that cannot take part on this machine, and why."""
    return {name: reason for name, one in PEERS.items() if (reason := one.missing())}


def versions() -> dict[str, str]:
    """The versions of the packages that take part, and of the C compiler if one is used."""
    present = [one for one in PEERS.values() if not one.missing()]
    found = {one.distribution: importlib.metadata.version(one.distribution) for one in present}
    return found | ({"cc": compiler_version()} if any(one.compiles for one in present) else {})


def compiler() -> str | None:
    """The system's C compiler."""
    return shutil.which("cc")


def compiler_version() -> str:
    """The version of `cc`."""
    run = subprocess.run([str(compiler()), "-dumpfullversion"], capture_output=True, text=True, check=False)
    return run.stdout.strip() or "of unknown version"
