"""Parametric and random trees, for tests and benchmarks. Deterministic in their arguments."""

from __future__ import annotations

from typing import Any

import numpy as np

import rne
from rne import Model
from rne.basics.spatial import Array, rotation_about
from rne.model.builder import Mimic, Part, assemble, pose

from .helpers import point_mass_inertia


def random_tree(
    n: int, seed: int, *, prismatic: float = 0.25, branching: float = 0.3, mimics: int = 0, coupled: bool = False
) -> Model:
    """A tree of n coordinates with random axes, placements and physical inertias; some links on fixed joints.

    `prismatic` and `branching` are the probabilities that a joint slides, and that it is not mounted on the link before
    it; `mimics` further joints follow a random one. If it is `coupled`, two of five follow others by curves.
    """
    rng = np.random.default_rng(seed)
    parts = [Part(link="root", **_body(rng))]
    moving: list[int] = []
    for k in range(n + mimics):
        parent = int(rng.integers(len(parts))) if rng.random() < branching else len(parts) - 1
        kind = "prismatic" if rng.random() < prismatic else str(rng.choice(["revolute", "continuous"]))
        follows = None
        if k >= n:
            follows = Mimic(int(rng.choice(moving)), float(rng.normal()), float(rng.normal()))
        else:
            moving.append(len(parts))
        parts.append(
            Part(
                link=f"link{k}",
                joint=f"joint{k}",
                kind=kind,
                parent=parent,
                placement=_placement(rng),
                axis=_direction(rng),
                mimic=follows,
                **_body(rng),
            )
        )
        if rng.random() < 0.3:
            parts.append(
                Part(link=f"tool{k}", joint=f"fixed{k}", parent=len(parts) - 1, placement=_placement(rng), **_body(rng))
            )
    gravity = rng.normal(size=3) * 10
    model = assemble(f"tree{n}-{seed}", parts, gravity=gravity)
    if not coupled:
        return model
    curve = ("joint0",), lambda a: a + np.sin(a) / 2 + np.sqrt(3 + np.cos(a))
    surface = ("joint0", "joint2"), lambda a, b: 0.3 * np.sin(a) * b - a
    return rne.model.coupled(model, {"joint1": curve, "joint3": surface})


def straight_chain(n: int, *, length: float = 0.3, mass: float = 1.0) -> Model:
    """n equal rods [m, kg] hanging end to end, all axes y: the pendulum, the double pendulum, ..."""
    across = mass * length**2 / 12
    parts = [Part(link="root")]
    for k in range(n):
        parts.append(
            Part(
                link=f"rod{k}",
                joint=f"joint{k}",
                kind="continuous",
                parent=k,
                placement=pose(np.eye(3), [0, 0, -length if k else 0]),
                axis=np.array([0.0, 1.0, 0.0]),
                mass=mass,
                com=np.array([0, 0, -length / 2]),
                inertia=np.diag([across, across, 0.0]),
            )
        )
    return assemble(f"chain{n}", parts)


def _direction(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3).astype(np.longdouble)
    unit: Array = v / np.sqrt((v * v).sum())
    return unit


def _placement(rng):
    angle = np.asarray(rng.uniform(-np.pi, np.pi), dtype=np.longdouble)
    return pose(rotation_about(_direction(rng), angle), rng.uniform(-0.5, 0.5, 3))


def _body(rng: np.random.Generator) -> dict[str, Any]:
    """Four random point masses: any such cloud is a physical body."""
    points, masses = rng.uniform(-0.3, 0.3, (4, 3)), rng.uniform(0.2, 2.0, 4)
    com = masses @ points / masses.sum()
    d = points - com
    inertia = point_mass_inertia(masses[:, None, None], d).sum(0)
    return {"mass": float(masses.sum()), "com": com, "inertia": (inertia + inertia.T) / 2}
