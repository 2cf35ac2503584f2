"""Shared by the tests: states, differences, robots of parts, and Pinocchio with our joint order."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import numpy as np
import pytest

import rne
from rne.commands.oracle import Oracle, each
from rne.kernels import kernel as kernel_module
from rne.model.builder import Mimic, Part, assemble, pose
from rne.urdf.loading import urdf_files

__all__ = [
    "EPS",
    "FIGURES",
    "KD",
    "KP",
    "ROOT",
    "Mimic",
    "Oracle",
    "Part",
    "archived",
    "assemble",
    "complex_steps",
    "cross_matrix",
    "data_robots",
    "each",
    "first_joints",
    "gimbal",
    "kept",
    "loaded",
    "point_mass_inertia",
    "pose",
    "relative",
    "states",
]

ROOT = Path(__file__).parent.parent
EPS = float(np.finfo(float).eps)
KP, KD = (50.0,) * 5 + (60.0,), (20.0,) * 5 + (22.0,)  # the thesis's gains [N m/rad], [N m s/rad]
FIGURES = [
    "6.2",
    "6.3",
    "6.4",
    "6.5",
    "6.6",
    "6.7",
    "6.8",
    "6.9",
    "6.11",
    "6.12",
    "6.13",
    "6.14",
    "6.15",
    "6.16",
    "7.1",
    "7.2",
    "7.3",
    "7.4",
    "7.5",
]  # of the thesis, drawn here


def archived(file):
    """Arrays by name and texts of an archive that the package wrote: a motion, an identification or a fit."""
    with np.load(file) as archive:
        arrays = dict(archive)
    return arrays, json.loads(str(arrays.pop("texts")))


def cross_matrix(v):
    """The matrix [v]x with [v]x u = v x u, shape (..., 3, 3)."""
    return np.cross(np.eye(3), np.asarray(v)[..., None, :])


def point_mass_inertia(mass, r):
    """Inertia about the origin of point masses at r, shape (..., 3, 3): m (r.r 1 - r r^T)."""
    return mass * ((r**2).sum(-1)[..., None, None] * np.eye(3) - r[..., :, None] * r[..., None, :])


def kept(values, short):
    """Parameters of a test: those in `short` are in every run, the others in the long run only."""
    long = {"marks": pytest.mark.long}
    return [pytest.param(*(v if isinstance(v, tuple) else (v,)), **({} if v in short else long)) for v in values]


def gimbal():
    """Two massless links that carry a body: their axes, the outer and the inner, are one at q2 = 0."""
    z, y = np.array([0, 0, 1.0]), np.array([0, 1.0, 0])
    joints = [("a", "outer", z), ("b", "middle", y)]
    parts = [Part(link=l, joint=j, kind="revolute", parent=k, axis=axis) for k, (l, j, axis) in enumerate(joints)]
    tip = Part(link="c", joint="inner", kind="revolute", parent=2, axis=z, mass=1.0, inertia=np.diag([1.0, 2.0, 3.0]))
    return assemble("gimbal", [Part(link="base"), *parts, tip])


def states(n, samples=None, seed=0, *, rate=10.0, acceleration=50.0):
    """Random (q, qd, qdd): angles in +-pi, rates and accelerations up to the given ones."""
    rng = np.random.default_rng(seed)
    shape = (n,) if samples is None else (samples, n)
    return tuple(rng.uniform(-x, x, shape) for x in (np.pi, rate, acceleration))


def relative(a, b):
    """Worst difference over a batch, each state's relative to its largest entry."""
    a, b = np.atleast_2d(a), np.atleast_2d(b)
    if a.size == 0:
        return 0.0
    axes = tuple(range(1, a.ndim))
    size = np.maximum(np.abs(b).max(axis=axes), 1e-300)
    return float((np.abs(a - b).max(axis=axes) / size).max())


def data_robots():
    """URDF files of example-robot-data, by "folder/file"."""
    return urdf_files()


def loaded(name):
    """A robot by name or "folder/file" of example-robot-data, one for all tests: it keeps the kernels that they trace."""
    return _load(data_robots().get(name, name))


@functools.cache
def _load(source):
    return rne.load(source)


@functools.cache
def first_joints(n=3):
    """The IRB 140 with its first joints, the others locked: one for all tests."""
    return loaded("irb140").locked({f"joint_{k}": 0.3 for k in range(n + 1, 7)})


def complex_steps(function, model, arguments, wrt, external=()):
    """Derivatives of a function of rne.dynamics by complex steps, exact to rounding; wrenches are the last arguments."""
    count = len(function.quantity.widths)
    names, columns = [*function.quantity.widths, *(f"external_{k + 1}" for k in range(len(external)))], []
    for k in map(names.index, wrt):
        moved = [a[:, None] for a in arguments]
        moved[k] = moved[k] + 1e-30j * np.eye(arguments[k].shape[-1])
        wrenches = {"external": dict(zip(external, moved[count:], strict=True))} if external else {}
        result, _ = function.evaluate(model, *moved[:count], **wrenches)
        columns.append(np.moveaxis(result.imag / 1e-30, 1, -1))
    return np.concatenate(columns, axis=-1)


def address_by_numpy(kernel, count=1, common=True):
    """In place of `Kernel.address`, for texts of loops that Python runs: the program on `count` states side by side."""
    _, block_program = kernel_module.backends("numpy")
    program = block_program(kernel.traced)

    def function(*arguments):
        *given, numbers, out = arguments
        rows = [np.reshape(a, (-1, count)).T for a in given]
        numbers = numbers if common else np.reshape(numbers, (-1, count)).T
        return program.sound([*rows, numbers], np.reshape(out, (-1, count)).T).all()

    return function
