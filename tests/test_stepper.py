"""Steps of a control interval: equal to motions, differentiable, whoever computes them."""

import pickle

import numpy as np
import pytest

import rne

from .random_robots import straight_chain

ROUNDING = 1e-11  # of states of a few rad and rad/s, that other sums reach
DIFFERENCE = 2e-6  # of central differences relative to the largest slope: cube root of eps, squared, and rounding
LIMIT = [6.0, 3.0]  # N m; some of the torques drawn are beyond
FRICTION = rne.Friction(viscous=[0.4, 0.2], coulomb=[0.5, 0.3], smoothing=0.5, viscous_back=[0.3, 0.2])


@pytest.fixture(scope="module")
def two_arm():
    """Two links of 0.3 m and 1 kg, whose kernels are small."""
    return rne.Robot(straight_chain(2), "numpy")


@pytest.fixture(scope="module")
def scene(two_arm):
    return rne.Scene(two_arm, friction=FRICTION, effort_limit=LIMIT, armature=0.05)


def drawn(stepper, count=7, seed=0):
    """States, torques and weights."""
    rng, n = np.random.default_rng(seed), stepper.scene.n
    x = rng.uniform(-1, 1, (count, stepper.size))
    return x, rng.uniform(-8, 8, (count, n)) if stepper.scene.controller is None else None, rng.normal(size=x.shape)


@pytest.mark.parametrize("method", ["rk4", "tsit5"])
def test_constant_torques_are_those_of_a_motion(scene, method):
    """Against a motion by tight tolerances: the error of the steps alone is left."""
    stepper = rne.Stepper(scene, 0.02, substeps=20, method=method)
    x, u, _ = drawn(stepper, count=2)
    found = stepper(x, u)
    for row, torque, end in zip(x, u, found, strict=True):
        held = rne.simulate(scene, row[:2], row[2:], 0.02, torque=torque, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(end, [*held.q[-1], *held.qd[-1]], rtol=0, atol=1e-8)


def test_gradient_is_that_of_differences(scene):
    stepper = rne.Stepper(scene, 0.02, substeps=2)
    x, u, W = drawn(stepper)
    assert (abs(u) > LIMIT).any()
    slopes, rng, h = stepper.gradient(x, u, W), np.random.default_rng(1), 1e-5
    dx, du = rng.normal(size=x.shape), rng.normal(size=u.shape)
    found = (slopes["x"] * dx).sum(1) + (slopes["u"] * du).sum(1)
    expected = (W * (stepper(x + h * dx, u + h * du) - stepper(x - h * dx, u - h * du))).sum(1) / (2 * h)
    np.testing.assert_allclose(found, expected, rtol=0, atol=DIFFERENCE * abs(expected).max())
    J = stepper.jacobian(x, u)
    assert J.shape == (7, 4, 6)
    np.testing.assert_allclose(np.einsum("ni,nij->nj", W, J), np.hstack([slopes["x"], slopes["u"]]), atol=1e-13)


def test_a_stepper_pickles_and_says_what_it_is(scene):
    stepper = rne.Stepper(scene, 0.02, substeps=2)
    x, u, _ = drawn(stepper)
    assert (pickle.loads(pickle.dumps(stepper))(x, u) == stepper(x, u)).all()
    assert "under torques: states of 4, 0.02 s in steps of 0.01 s by rk4" in repr(stepper)
