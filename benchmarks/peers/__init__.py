"""Other packages on the same robots and states; those that are not there are named, not counted."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.peers import adam, casadi, mujoco, toolbox
from benchmarks.peers.casadi import CasADi
from benchmarks.peers.found import Case, Point, left_out, versions
from benchmarks.peers.mujoco import MuJoCo
from benchmarks.peers.pinocchio import Pinocchio

__all__ = ["PEERS", "CasADi", "Case", "MuJoCo", "Pinocchio", "Point", "left_out", "versions"]

PEERS: dict[str, Callable[[Case], list[Point]]] = {
    "mujoco": mujoco.points,
    "casadi": casadi.points,
    "roboticstoolbox": toolbox.points,
    "adam": adam.points,
}
