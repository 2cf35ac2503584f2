"""How sure predictions of an identified robot are: bands of torques, draws of parameters, printed programs."""

import numpy as np
import pytest
from scipy.stats import norm

import rne
from rne.identification import Record

from .helpers import first_joints
from .measurements import fourier_series

RATE, NOISE = 100.0, np.array([0.6, 0.8, 0.3])  # samples per second, deviation of each torque [N m]
FRICTION = rne.Friction(viscous=[3.0, 4.0, 2.0], coulomb=[4.0, 5.0, 2.0], smoothing=0.003)


def log(seed, *, duration=10.0, scale=1.0, still=(), base=0.2):
    """A motion of the IRB 140's first three axes with friction and white noise; joints that are `still` rest at zero."""
    rng, t = np.random.default_rng(seed), np.arange(int(duration * RATE)) / RATE
    a, b = scale * rng.normal(size=(2, 3, 5)) * 0.5
    a[list(still)] = b[list(still)] = 0.0
    q, qd, qdd = fourier_series(t, base, a, b)
    tau = rne.Scene(first_joints(), friction=FRICTION).inverse_dynamics(q, qd, qdd)
    return (q, qd, qdd), Record(t, q, tau + NOISE * rng.normal(size=tau.shape))


@pytest.fixture(scope="module")
def found():
    return rne.identify(first_joints(), log(0)[1], causes=False)


def coverage(check):
    """Share of the torques of each joint that are within the 95 % band, and the number of independent ones."""
    within = np.abs(check.measured - check.predicted) <= norm.ppf(0.975) * check.std
    return np.array([within[check.valid[:, j], j].mean() for j in range(within.shape[1])])


def test_the_variance_is_that_of_parameters_and_of_residuals(found):
    """From the covariance of parameters by finite differences of the torques, and the same residuals in every state."""
    (q, qd, qdd), _ = log(1, duration=2.0)
    qd[::10] = 0.0
    torques, std = found.predict(q, qd, qdd, std=True)
    np.testing.assert_array_equal(torques, found.predict(q, qd, qdd))
    columns = []
    for k in found.base.independent:  # torques are linear in the parameters
        one = found.parameters + np.eye(len(found.parameters))[k]
        columns.append(replaced(found, one).predict(q, qd, qdd) - torques)
    y = np.stack(columns, -1)
    of_parameters = np.einsum("tjk,kl,tjl->tj", y, found.estimate.covariance, y)
    moving = np.abs(qd) > found.minimum_velocity
    for j in range(3):
        rest = std[:, j] ** 2 - of_parameters[:, j]
        for part in (moving[:, j], ~moving[:, j]):
            np.testing.assert_allclose(rest[part], rest[part][:1].repeat(part.sum()), rtol=1e-6)
        assert rest[~moving[:, j]].min() > FRICTION.coulomb[j] ** 2 / 2 > 10 * rest[moving[:, j]].max()


def replaced(found, parameters):
    """The identification with other parameters, and the smoothing that it predicts with."""
    from dataclasses import replace

    return replace(found, standard=found._law, parameters=parameters)


def test_bands_cover_another_motion(found):
    """Of nearly independent rows: the share is within four standard errors of 95 %."""
    check = found.check(log(2)[1])
    share = coverage(check)
    few = np.sqrt(0.95 * 0.05 / (len(check.t) / found.correlation_time))
    assert (np.abs(share - 0.95) < 4 * few).all()


def test_torques_that_depend_on_what_the_log_says_nothing_of_have_no_finite_deviation():
    """The third axis rests in the log: its torque is not known, those of the others are while it rests."""
    found = rne.identify(first_joints(), log(0, still=[2])[1], causes=False, consistent=False)
    (q, qd, qdd), _ = log(1, duration=4.0)
    _, std = found.predict(q, qd, qdd, std=True)
    assert np.isinf(std).any(0).tolist() == [True, True, True]
    assert np.isinf(std[:, 2]).all()
    resting = found.check(log(3, still=[2])[1]).std
    assert np.isfinite(resting).all(0).tolist() == [True, True, False]
