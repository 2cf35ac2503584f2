"""Base parameters by rules, against the rank of regressors at random states and known counts."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

import rne
from rne.model.standard_parameters import StandardParameters

from .helpers import data_robot, kept
from .test_oracle import LOADABLE, ONE_OF_EACH_KIND

TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)  # of the largest pivot; the rank is to be the same for all
SAME = 1e-11  # of the terms that add up to a column: geometry of some fifty bodies, behind axes 4e-6 rad apart
ZERO = 1e-11  # of the largest torque: columns of zeros but for rounding; kinova's first axis is 1e-12 off the vertical
# pi / 2 written as 1.5708 and the like: axes parallel but for 4e-6 rad, which a rank at 1e-8 sees and at 1e-3 does not
ROUNDED_FILES = (
    "hextilt_description/hextilt_flying_arm_5",
    "tiago_pro_description/tiago_pro",
    "xarm_description/xarm7",
)
OPTIONS = {
    "bodies": {},
    "rotors": {"rotor": True},
    "friction": {"friction": "viscous+coulomb"},
    "offsets": {"offset": True},
    "all": {"rotor": True, "friction": "viscous+coulomb", "offset": True},
}


def in_any_gravity(model):
    return {"": model, "without gravity ": replace(model, gravity=np.zeros(3))}


def stacked_regressors(model, seed=0, **options):
    """Y of all standard parameters at random states: of gravity alone, at speed, and with accelerations."""
    standard = StandardParameters(model, **options)
    rng = np.random.default_rng(seed)
    samples = 40 + 4 * standard.count // max(model.n, 1)
    q, qd, qdd = rng.uniform(-1, 1, (3, samples, model.n)) * np.array([np.pi, 3, 10])[:, None, None]
    at_rest, steady = np.arange(samples) % 3 == 1, np.arange(samples) % 3 == 2
    qd[at_rest], qdd[at_rest | steady] = 0, 0
    Y = np.concatenate([rne.regressor(model, q, qd, qdd), standard.drive_columns(qd, qdd)], axis=-1)
    return Y, (q, qd, qdd)


def numeric_ranks(Y):
    """Rank by QR with column pivoting, columns scaled to unit length, for each tolerance."""
    Y = Y.reshape(Y.shape[0] * Y.shape[1], Y.shape[2])
    sizes = np.linalg.norm(Y, axis=0)
    Y = Y[:, sizes > 1e-12 * sizes.max(initial=0)]
    if not Y.size:
        return [0] * len(TOLERANCES)
    pivots = np.abs(np.diag(scipy.linalg.qr(Y / np.linalg.norm(Y, axis=0), mode="r", pivoting=True)[0]))
    return [int((pivots > tolerance * pivots[0]).sum()) for tolerance in TOLERANCES]


def check(model, **options):
    """The count is the numeric rank, the matrices are what they are said to be."""
    base = rne.base_parameters(model, **options)
    Y, states = stacked_regressors(model, **options)
    ranks = numeric_ranks(Y)
    assert [base.count] * len(ranks) == ranks
    check_matrices(base, Y, states)


def check_matrices(base, Y, states):
    E, B = base.back, base.matrix
    np.testing.assert_array_equal(B @ E, np.eye(base.count))
    np.testing.assert_array_equal(base.regressor(*states), Y @ E)
    sizes = np.abs(Y).max(axis=(0, 1), initial=0)
    differences = np.abs(Y - Y @ E @ B).max(axis=(0, 1), initial=0)
    terms = sizes + np.abs(B).T @ sizes[list(base.independent)]
    assert (differences <= SAME * terms + ZERO * sizes.max(initial=0)).all()


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("name", kept([name for name in LOADABLE if name not in ROUNDED_FILES], ONE_OF_EACH_KIND))
def test_robots_of_files(name, options):
    for model in in_any_gravity(data_robot(name).model).values():
        check(model, **OPTIONS[options])


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("name", kept(ROUNDED_FILES, ["xarm_description/xarm7"]))
def test_robots_of_rounded_files(name, options):
    """A finer rank sees the roundings, a coarse one does not: nor do the rules with a coarse tolerance."""
    for model in in_any_gravity(data_robot(name).model).values():
        exact, coarse = (rne.base_parameters(model, tolerance=x, **OPTIONS[options]) for x in (1e-9, 1e-4))
        Y, states = stacked_regressors(model, **OPTIONS[options])
        ranks = numeric_ranks(Y)
        assert (coarse.count, exact.count) == (ranks[0], ranks[-1])
        check_matrices(exact, Y, states)


def test_known_counts(irb140, ur5):
    """Arms of six rotating joints, the first vertical: 36, and 40 with rotors; Gautier and Khalil 1990."""
    for robot in (irb140, ur5):
        assert (robot.base_parameters().count, robot.base_parameters(rotor=True).count) == (36, 40)
    panda = data_robot("panda_description/panda").locked({"panda_finger_joint1": 0.0})
    assert panda.base_parameters().count == 43
