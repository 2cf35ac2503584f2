"""The pseudo-inertia of a body is the matrix of the second moments of its mass."""

import numpy as np
import pytest

import rne
from rne.basics.inertia import dual_of_gradient, parameters_of_pseudo_inertia, pseudo_inertia
from rne.graph.graph import Graph
from rne.graph.scalar import inputs

from .conftest import TREES
from .helpers import point_mass_inertia

PARAMETERS = 10  # of a body

SAME = 1e-14  # of the largest entry: a few sums of products


def point_masses(count, seed):
    """Masses and positions, and the ten parameters of the body that they are."""
    rng = np.random.default_rng(seed)
    mass, r = rng.uniform(0.1, 2, count), rng.uniform(-1, 1, (count, 3))
    inertia = point_mass_inertia(mass[:, None, None], r).sum(0)
    I = [inertia[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
    return mass, r, np.concatenate([[mass.sum()], mass @ r, I])


def test_it_is_the_sum_over_point_masses():
    mass, r, pi = point_masses(7, seed=0)
    points = np.concatenate([r, np.ones((7, 1))], axis=1)
    np.testing.assert_allclose(pseudo_inertia(pi)[0], np.einsum("k,ki,kj->ij", mass, points, points), rtol=1e-13)


@pytest.mark.parametrize("name", ["irb140", "mixed"])
def test_there_and_back_in_batches(name):
    robot = rne.Robot(TREES[name]) if name in TREES else rne.load(name)
    pi = robot.parameters * np.random.default_rng(0).uniform(0.5, 2, (3, 2, 1))
    P = pseudo_inertia(pi)
    assert P.shape == (3, 2, robot.model.nb, 4, 4)
    np.testing.assert_array_equal(P, np.swapaxes(P, -1, -2))
    assert np.abs(parameters_of_pseudo_inertia(P) - pi).max() <= SAME * np.abs(pi).max()


@pytest.mark.parametrize("count", [1, 3, 4])
def test_rank_counts_the_point_masses(count):
    """Positive semidefinite for any masses, positive definite from four on in general position."""
    *_, pi = point_masses(count, seed=count)
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(pi)[0])
    assert eigenvalues.min() >= -1e-14 * eigenvalues.max()
    assert (eigenvalues > 1e-10).sum() == count


def test_a_triangle_inequality_that_fails_is_a_negative_eigenvalue():
    pi = np.array([1.0, 0, 0, 0, 1.0, 0, 1.0, 0, 0, 2.1])  # Ixx + Iyy < Izz
    assert np.linalg.eigvalsh(pseudo_inertia(pi)[0]).min() == pytest.approx(-0.05)


def test_dual_gives_the_same_slope():
    slope, change = np.random.default_rng(0).normal(size=(2, 5, 30))
    S, dP = dual_of_gradient(slope), pseudo_inertia(change)
    np.testing.assert_allclose((S * dP).sum((-1, -2, -3)), (slope * change).sum(-1), atol=1e-13)


def test_traced_numbers_pass():
    pi = inputs(Graph(limit=1000), (20,), 0)
    P = pseudo_inertia(pi)
    assert P.shape == (2, 4, 4)
    for array in (P, parameters_of_pseudo_inertia(P), dual_of_gradient(pi)):
        assert array.dtype == object
