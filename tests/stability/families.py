"""Robots and states at the edges: each case is one robot and a few states."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import rne
from rne.model.builder import disassemble

from ..helpers import Part, assemble, pose
from ..random_robots import random_tree, straight_chain

X, Y, Z = np.eye(3)


class Case(NamedTuple):
    """A robot and some states: q, qd and, for inverse dynamics, qdd; for forward dynamics it serves as the torque."""

    name: str
    model: rne.Model
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray


def case(name, model, q=None, *, count=2, rate=1.0):
    rng = np.random.default_rng(7)
    angles, rates, last = rng.uniform(-1, 1, (3, count, model.n))
    q = np.pi * angles if q is None else np.broadcast_to(np.asarray(q, dtype=float), (count, model.n))
    return Case(name, model, q, rate * rates, last)


def straight(n):
    return np.concatenate([[0.5], np.zeros(n - 1)])


def chains(sizes=(5, 10, 20, 40, 60)):
    for n in sizes:
        yield case(f"straight chain, n = {n}", straight_chain(n), straight(n), count=1)


def growing_chain(n, factor):
    """Rods on crossed axes, each `factor` times as long, and of `factor`^3 the mass."""
    parts = [Part(link="root")]
    length = 0.3
    for k in range(n):
        place = pose(np.eye(3), [0, 0, -length / factor if k else 0])
        mass = (length / 0.3) ** 3
        slim = mass * length**2 / 12
        parts.append(
            Part(
                link=f"rod{k}", joint=f"joint{k}", kind="continuous", parent=k, placement=place, axis=(Y, X)[k % 2],
                mass=mass, com=np.array([0, 0, -length / 2]), inertia=np.diag([slim, slim, slim / 100]),
            )
        )  # fmt: skip
        length *= factor
    return assemble(f"growing{n}", parts)


def growing_links():
    for n in (10, 20):
        for factor, word in ((2.0, "growing"), (0.5, "shrinking")):
            yield case(f"{word} links, n = {n}", growing_chain(n, factor))


def tip_masses():
    chain = straight_chain(6)
    for ratio in (1e-12, 1e-6, 1e6, 1e12):
        scale = np.array([1, 1, 1, 1, 1, ratio])
        model = replace(chain, mass=chain.mass * scale, inertia=chain.inertia * scale[:, None, None])
        yield case(f"tip mass {ratio:.0e}, bent", model)
        yield case(f"tip mass {ratio:.0e}, straight", model, straight(6))


def last_inertias():
    """The last link all but a point on its own axis."""
    tree = random_tree(6, seed=2, prismatic=0, branching=0)
    for j in (1e-6, 1e-12, 1e-18):
        com, inertia = tree.com.copy(), tree.inertia.copy()
        com[-1], inertia[-1] = 0, j * np.diag([1.0, 2.0, 2.5])
        yield case(f"last inertia {j:.0e}", replace(tree, com=com, inertia=inertia), count=12)


def gimbals():
    rings = [np.eye(3) * 1e-12, np.eye(3) * 1e-12, np.diag([0.3, 0.2, 0.1])]
    parts = [Part(link="base")]
    for k, (axis, inertia) in enumerate(zip((Z, Y, Z), rings, strict=True)):
        body = {"mass": 2.0, "com": np.array([0.01, 0.02, 0.1])} if k == 2 else {}
        parts.append(Part(link=f"l{k}", joint=f"j{k}", kind="continuous", parent=k, axis=axis, inertia=inertia, **body))
    model = assemble("gimbal", parts)
    for closing in (1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10):
        yield case(f"gimbal closing to {closing:.0e}", model, [0.3, closing, -0.8])


def subjects():
    yield "IRB 140", rne.irb140()
    yield "random tree", random_tree(6, seed=8)


def far_bases():
    for name, model in subjects():
        parts = disassemble(model)
        for k, part in enumerate(parts):
            if part.parent == 0:
                parts[k] = replace(part, placement=part.placement._replace(p=part.placement.p + [6e5, 8e5, -1e5]))
        yield case(f"{name}, base 1e6 m away", assemble(model.name, parts, gravity=model.gravity))


def joint_speeds():
    for name, model in subjects():
        for speed in (1e2, 1e4, 1e8):
            yield case(f"{name} at {speed:.0e} rad/s", model, rate=speed)


def large_angles():
    for name, model in subjects():
        for angle in (1e3, 1e6, 1e12):
            states = case(f"{name}, angles to {angle:.0e} rad", model)
            yield states._replace(q=np.where(model.is_revolute, angle, 1.0) * states.q)


def scaled(model, s):
    """The same robot s times as large, of the same density."""
    return replace(
        model, translation=s * model.translation, com=s * model.com, link_translation=s * model.link_translation,
        mass=s**3 * model.mass, inertia=s**5 * model.inertia,
    )  # fmt: skip


def sizes():
    for name, model in subjects():
        for s in (1e-6, 1e6):
            states = case(f"{name}, {s:.0e} times as large", scaled(model, s))
            unit = np.where(model.is_revolute, 1.0, s)  # what slides goes as far as the robot is large
            yield states._replace(q=unit * states.q, qd=unit * states.qd, qdd=unit * states.qdd)


def long_slides():
    """A robot that slides much farther than it is large."""
    model = next(tree for name, tree in subjects() if name == "random tree")
    for ratio in (1e3, 1e6):
        states = case(f"random tree, slides {ratio:.0e} times its size", model)
        yield states._replace(q=np.where(model.is_revolute, 1.0, ratio) * states.q)


FAMILIES: dict[str, Callable[[], Iterator[Case]]] = {
    "straight chains": chains,
    "growing and shrinking links": growing_links,
    "tip masses": tip_masses,
    "last link's inertia": last_inertias,
    "closing gimbal": gimbals,
    "base far away": far_bases,
    "joint speeds": joint_speeds,
    "large angles": large_angles,
    "sizes": sizes,
    "long slides": long_slides,
}
