"""Other packages, whose calls chart A times beside ours. One that is not installed is left out by name, but for
Pinocchio, which all are compared with.

To add one, write one file in this folder. Its function takes a `Case`, returns a list of `Point`, and is decorated:

    @peer("MuJoCo", requirement="mujoco>=3.2", modules=("mujoco",))
    def points(case: Case) -> list[Point]: ...

Import the package inside the function; raise ValueError for a robot that it cannot take. Nothing else needs to be
edited: the files of this folder are found here. `pip install $(python -m benchmarks.peers)` installs every package.
"""

from __future__ import annotations

import importlib
import pkgutil

from benchmarks.peers.registry import PEERS, Case, Point, left_out, peer, versions

__all__ = ["PEERS", "Case", "Point", "left_out", "peer", "versions"]

for _module in pkgutil.iter_modules(__path__):
    if not _module.name.startswith("_"):
        importlib.import_module(f"{__name__}.{_module.name}")
