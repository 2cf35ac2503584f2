"""Torques whose terms cancel exactly leave rounding noise, which high velocities make large: a warning says so."""

import warnings

import numpy as np
import pytest

import rne

from .helpers import Part, assemble


def spinner(seed):
    """One joint about a crooked axis, under gravity: C qd is 0, its terms are not."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    A = rng.normal(size=(3, 3))
    part = Part(
        link="l",
        joint="j",
        kind="revolute",
        parent=0,
        axis=axis / np.linalg.norm(axis),
        mass=rng.uniform(0.5, 2),
        com=rng.normal(size=3),
        inertia=A @ A.T + 3 * np.trace(A @ A.T) * np.eye(3),
    )
    return rne.Robot(assemble("spinner", [Part(link="base"), part]))


SINGLE, DOUBLE = (
    (np.float32, np.float64),
    (np.float64, np.longdouble),
)  # each with the wider one that is exact beside it


@pytest.mark.parametrize(
    ("types", "velocity"), [*((SINGLE, v) for v in (10.0, 1e3, 3e3, 1e4)), (DOUBLE, 10.0), (DOUBLE, 2e8)]
)
def test_no_wrong_acceleration_without_a_warning(types, velocity):
    """Once 14 of 40 robots were more than 3 % off at 3000 rad/s in float32, without a warning."""
    wrong, warned = 0, 0
    for seed in range(20):
        model = spinner(seed).model
        narrow, narrow_model = [np.array([x], dtype=types[0]) for x in (0.3, velocity, 0.0)], model.astype(types[0])
        exact = rne.dynamics.forward_dynamics.core(narrow_model.astype(types[1]), *[x.astype(types[1]) for x in narrow])
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            found = rne.dynamics.forward_dynamics(narrow_model, *narrow)[0]
        off = abs(found - exact[0][0]) > 0.03 * abs(exact[0][0])
        wrong, warned = wrong + off, warned + bool(caught)
        assert caught or not off, seed
    if velocity == 10.0:
        assert not warned
    if velocity in (1e4, 2e8):
        assert wrong > 5
