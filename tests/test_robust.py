"""Robust control: every law keeps the bound that it states, for payloads that the controller does not know."""

import itertools
import re

import numpy as np
import pytest

import rne
from benchmarks import robust_laws
from rne.bounds.bounds import inertia_extremes

from .helpers import first_joints, kept
from .random_robots import straight_chain
from .test_adaptive import BANDWIDTH, KD, arm, circle, composite_error, short_circle
from .test_gains import slider

__all__ = ["arm"]

LARGEST = 3.0  # payload [kg]
DEPTH = [0, 0, 0.1]  # its centre, before the flange [m]
LAYER = np.array([0.05, 0.05, 0.1])  # [rad/s]


def cases_of(robot):
    return robot, robot.with_payload(LARGEST, com=DEPTH)


def laws_of(robot, reference, layer, kd):
    cases, rate = cases_of(robot), [BANDWIDTH] * robot.n
    middle = rne.control.Cases(cases).centre
    rho = rne.control.uncertainty_bound(middle, cases, rate, layer, reference, 2.0, samples=1600)
    return {
        "robust": rne.control.robust(middle, rate, layer, reference, rho),
        "passive": rne.control.robust_passive(cases, kd, rate, reference, boundary=0.3),
        "sliding": rne.control.sliding_mode(cases, rate, layer, reference),
    }


@pytest.fixture(scope="module")
def laws(arm):
    return laws_of(arm, short_circle, LAYER, KD[:3])


@pytest.fixture(scope="module")
def laws_of_irb140(irb140):
    """The layer in proportion to the inverse root of the inertias."""
    inertia = np.diag(irb140.with_payload(1.5, com=DEPTH).mass_matrix(circle(0)[0]))
    return laws_of(irb140, circle, 0.1 / np.sqrt(inertia), KD)


def run(law, plant, reference, duration=2.0, **parts):
    times = np.linspace(0, duration, 401)
    scene = rne.Scene(plant, controller=law, **parts)
    assert scene.cost()["law"] == "traced"
    motion = rne.simulate(scene, *reference(0)[:2], duration, t_eval=times, method="DOP853")
    return motion, motion.q - reference(times[:, None])[0]


def payloads(count, seed=0):
    """Seeded masses within the cases, the largest among them."""
    return [LARGEST, *np.random.default_rng(seed).uniform(0, LARGEST, count - 1)]


@pytest.fixture(scope="module")
def largest_error_of_computed_torque(arm):
    exact = rne.control.computed_torque(arm, [BANDWIDTH**2] * 3, [2 * BANDWIDTH] * 3, short_circle)
    return np.abs(run(exact, arm.with_payload(LARGEST, com=DEPTH), short_circle, duration=1.0)[1]).max()


@pytest.mark.parametrize("name", kept(["robust", "passive", "sliding"], ["robust", "sliding"]))
def test_error_keeps_the_stated_bound(arm, laws, name, largest_error_of_computed_torque):
    law = laws[name]
    _, error = run(law, arm.with_payload(LARGEST, com=DEPTH), short_circle, duration=1.0)
    assert (np.abs(error).max(axis=0) <= law.error_bound).all()
    assert np.abs(error).max() < largest_error_of_computed_torque / 5


@pytest.mark.long
@pytest.mark.parametrize("name", ["robust", "passive", "sliding"])
@pytest.mark.parametrize("mass", payloads(5))
def test_error_of_the_irb140_keeps_the_stated_bound(irb140, laws_of_irb140, name, mass):
    law = laws_of_irb140[name]
    _, error = run(law, irb140.with_payload(mass, com=DEPTH), circle)
    assert (np.abs(error).max(axis=0) <= law.error_bound).all()


@pytest.mark.parametrize("name", kept(["robust", "passive", "sliding"], ["passive"]))
@pytest.mark.parametrize("seconds", kept([0.2, 1.0], [0.2]))
def test_worst_case_starts_keep_the_stated_bound(arm, laws, name, seconds, monkeypatch):
    """From the edge of the set that the proof holds invariant, payloads at the ends of their range; for four time
    constants of the error's decay, or for long.
    """
    monkeypatch.setattr(robust_laws, "SECONDS", seconds)
    found = robust_laws.campaign(laws[name], cases_of(arm), 4)
    assert found["within"] == found["starts"] == 4
    assert min(found["bound_over_seen"]) >= 1
    assert max(found["over_before"]) <= 1.5  # of the bounds by samples


def test_root_mean_square_keeps_the_exact_bound(arm, laws):
    law = laws["passive"]
    _, error = run(law, arm.with_payload(LARGEST, com=DEPTH), short_circle, duration=4.0)
    assert (np.sqrt((error**2).mean(axis=0)) <= law.rms_bound).all()


@pytest.mark.parametrize("mass", kept(payloads(3, seed=1), [LARGEST]))
def test_lyapunov_redesign_stays_in_its_layer(arm, laws, mass):
    """|s / boundary| <= 1 along a run, and its derivative is negative on the layer's edge in random states."""
    law, plant = laws["robust"], arm.with_payload(mass, com=DEPTH)
    motion, error = run(law, plant, short_circle, duration=1.0)
    s = motion.qd - short_circle(motion.t[:, None])[1] + law.bandwidth * error
    assert np.linalg.norm(s / law.boundary, axis=1).max() <= 1
    rng = np.random.default_rng(2)
    for t in rng.uniform(0, 2, 50):
        q_ref, qd_ref, qdd_ref = short_circle(t)
        z = rng.normal(size=3)
        z /= np.linalg.norm(z)
        e = law.error_bound * rng.uniform(-1, 1, 3)
        s = law.boundary * z
        q, qd = q_ref + e, qd_ref + s - law.bandwidth * e
        qdd = plant.forward_dynamics(q, qd, law(t, q, qd))
        s_rate = qdd - qdd_ref + law.bandwidth * (qd - qd_ref)
        assert z @ (s_rate / law.boundary) < 0


@pytest.mark.parametrize("name", ["passive", "sliding"])
@pytest.mark.parametrize("seed", range(3))
def test_power_of_the_proof(arm, laws, name, seed):
    """V = s^T M s / 2 falls as stated in any state, for any mixture of the cases, by differences along the flow."""
    law, rng = laws[name], np.random.default_rng(seed)
    cases = cases_of(arm)
    share = rng.uniform(0, 1)
    plant = arm.with_parameters((1 - share) * cases[0].parameters + share * cases[1].parameters)
    t = rng.uniform(0, 2)
    q, qd, _ = short_circle(t)
    q, qd = q + rng.normal(0, 0.1, 3), qd + rng.normal(0, 1, 3)
    qdd = plant.forward_dynamics(q, qd, law(t, q, qd))
    h = 1e-6

    def energy(k):
        position = q + k * h * qd
        s = composite_error(law, t + k * h, position, qd + k * h * qdd)
        return s @ plant.mass_matrix(position) @ s / 2

    power = (8 * (energy(1) - energy(-1)) - (energy(2) - energy(-2))) / (12 * h)
    s = composite_error(law, t, q, qd)
    z = np.linalg.norm(s / LAYER)
    assert z > 1  # outside of the sliding layer
    limit = -(s @ (law.kd * s)) + law.boundary / 4 if name == "passive" else -law.reaching * z
    assert power <= limit + 1e-6 * abs(power)


def test_ball_holds_every_mixture(arm):
    cases = [arm, arm.with_payload(3.0), arm.with_payload(2.0, com=[0.1, 0, 0]), arm.with_payload(1.0, com=DEPTH)]
    hull = rne.control.Cases(tuple(cases))
    W = hull.ball
    assert W.shape == (30, 3)
    weights = np.concatenate([np.eye(4), np.random.default_rng(0).dirichlet(np.ones(4), 20)])
    deviations = hull.deviations @ weights.T
    z, *_ = np.linalg.lstsq(W, deviations, rcond=None)
    np.testing.assert_allclose(W @ z, deviations, atol=1e-12)
    assert np.linalg.norm(z, axis=0).max() == pytest.approx(1.0, abs=1e-9)


def test_ball_holds_mixtures_of_parameters_of_any_size(arm):
    """A thousandth of a kg mm^2 besides a kilogram: each parameter is measured by its own range."""
    thicker = arm.with_parameters(arm.parameters + 1e-9 * (np.arange(30) == 19))
    hull = rne.control.Cases((arm, arm.with_payload(1.0), thicker))
    size = np.abs(hull.deviations).max(axis=1, keepdims=True)
    scale = 1 / np.where(size == 0, 1, size)
    z, *_ = np.linalg.lstsq(scale * hull.ball, scale * hull.deviations, rcond=None)
    np.testing.assert_allclose(scale * (hull.ball @ z), scale * hull.deviations, atol=1e-9)


def test_payload_between_two_robots_is_one_direction(arm):
    hull = rne.control.Cases(cases_of(arm))
    assert hull.ball.shape == (30, 1)
    half = (hull.robots[1].parameters - hull.robots[0].parameters) / 2
    np.testing.assert_allclose(np.abs(hull.ball[:, 0]), np.abs(half), atol=1e-12)


def test_law_without_uncertainty_is_that_of_the_model(arm):
    """Equal cases: only the feedback is left."""
    q, qd, qdd = short_circle(0.4)
    rate = [BANDWIDTH] * 3
    for law in (
        rne.control.robust_passive([arm, arm], KD[:3], rate, short_circle, boundary=0.1),
        rne.control.sliding_mode([arm, arm], rate, LAYER, short_circle),
        rne.control.robust(arm, rate, LAYER, short_circle, 1.0),
    ):
        np.testing.assert_allclose(law(0.4, q, qd), arm.inverse_dynamics(q, qd, qdd), rtol=1e-9)
        assert rne.Scene(arm, controller=law).cost()["law"] == "traced"


@pytest.mark.parametrize("name", ["robust", "passive", "sliding"])
def test_batches_are_single_states(laws, name):
    law, rng = laws[name], np.random.default_rng(0)
    t = rng.uniform(0, 2, 4)
    q, qd = rng.uniform(-1, 1, (2, 4, 3))
    together = law(t[:, None], q, qd)
    single = [law(*state) for state in zip(t, q, qd, strict=True)]
    np.testing.assert_allclose(together, single, rtol=1e-11)


ACCELERATION = 3.0  # [m/s^2]


def uniform(t):
    """A reference at rest in place that wants an acceleration all the time: the worst state is known."""
    return [0.0], [0.0], [ACCELERATION]


def bound_of_sliders(known, masses, **options):
    return rne.control.uncertainty_bound(slider(known), [slider(m) for m in masses], 4.0, 0.5, uniform, 1.0, **options)


@pytest.mark.parametrize(("known", "masses"), [(1.0, (1.0, 1.2, 3.0)), (3.0, (1.0, 2.8, 3.0)), (1.5, (1.0, 3.0))])
def test_uncertainty_bound_of_a_mass_is_that_of_its_worst_state(known, masses):
    """boundary |m - m_hat| |y| with y = qdd_ref - 2 L s + L^2 e, |s| <= boundary = 0.5, |e| <= boundary / L, L = 4."""
    largest = 0.5 * max(abs(m - known) for m in masses) * (ACCELERATION + 3 * 4.0 * 0.5)
    found = bound_of_sliders(known, masses, margin=1.0)
    assert 0.95 * largest <= found <= largest * (1 + 1e-12)


def test_a_model_without_errors_needs_a_bound_of_rounding_alone():
    """Also where positions, velocities and accelerations all count; a payload makes much of it."""
    arm, path = rne.Robot(straight_chain(2)), rne.trajectories.quintic([0.0, 0.0], [1.0, 1.0], 2.0)
    exact, other = (
        rne.control.uncertainty_bound(arm, [case, case], BANDWIDTH, 1.0, path, 2.0, samples=16)
        for case in (arm, arm.with_payload(1.0))
    )
    assert exact < 1e-9 * other


def test_defaults_of_the_uncertainty_bound():
    found = bound_of_sliders(1.0, (1, 3))
    assert found == bound_of_sliders(1.0, (1, 3), samples=4000, margin=1.2, seed=0)
    assert found != bound_of_sliders(1.0, (1, 3), seed=1)


def test_bounds_of_inertias_of_a_mass_are_exact_but_for_the_margin_of_the_inverse():
    largest, inverse = rne.control.Cases((slider(1.0), slider(4.0))).inertia_bounds(np.array([0.5]))
    assert largest == pytest.approx(4.0 * 0.25)
    assert inverse == pytest.approx(1.1 / 1.0)


@pytest.mark.parametrize("joints", kept([3, 6], [3]))
def test_bounds_of_inertias_hold_for_every_mixture(joints):
    arm, D = first_joints(joints), np.array([1.0, 1, 1, 3, 3, 9])[:joints]
    largest, inverse = rne.control.Cases((arm, arm.with_payload(3.0))).inertia_bounds(D)
    q = np.random.default_rng(3).uniform(arm.lower, arm.upper, (3000, joints))
    for mass in (0.0, 1.0, 3.0):
        M = arm.with_payload(mass).mass_matrix(q)
        assert np.linalg.eigvalsh(M * np.outer(D, D)).max() <= largest
        assert (np.diagonal(np.linalg.inv(M), axis1=1, axis2=2) <= inverse).all()


def test_bounds_of_inertias_do_not_depend_on_the_speed_of_the_machine(monkeypatch):
    arm = first_joints(2)

    def uppers():
        limits = arm.lower, arm.upper
        return inertia_extremes([arm.model], limits, "numpy", np.ones(arm.n), 0.1, 100_000).upper.tolist()

    before, seconds = uppers(), itertools.count(0, 100)
    assert np.isfinite(before).all()
    monkeypatch.setattr("time.monotonic", lambda: next(seconds))  # as if every step took minutes
    assert uppers() == before


def test_what_is_not_proven_of_one_case_leaves_the_values_of_the_others():
    """A payload has smaller entries of M^-1, and no proof without a budget; those of the empty arm count."""
    arm = first_joints(2)
    heavy, limits = arm.with_payload(3.0).model, (arm.lower, arm.upper)
    alone, both = (
        inertia_extremes(models, limits, "numpy", np.ones(arm.n), 0.1, 1)
        for models in ([arm.model], [arm.model, heavy])
    )
    assert both.attained[1:].tolist() == alone.attained[1:].tolist()
    assert both.attained[0] > alone.attained[0]
    assert (both.upper >= alone.upper).all()


def test_error_bounds_of_a_mass_are_those_of_the_formulas():
    cases = [slider(1.0), slider(4.0)]
    robust = rne.control.robust(slider(2.0), 4.0, 0.5, uniform, 1.0)
    passive = rne.control.robust_passive(cases, 9.0, 4.0, uniform, boundary=0.36)
    sliding = rne.control.sliding_mode(cases, 4.0, 0.5, uniform)
    assert robust.error_bound == pytest.approx(0.5 / 4.0)
    assert passive.rms_bound == pytest.approx(0.1 / 4.0)
    assert passive.error_bound == pytest.approx(np.sqrt(4 / 9 * 0.36 / 4 * 1.1) / 4.0)
    assert sliding.error_bound == pytest.approx(np.sqrt(4 * 0.25 * 1.1) / 4.0)
    assert sliding.reaching == 1.0


def test_torques_of_a_mass_are_those_of_the_formulas():
    """On the reference s = qd, e = 0: inside the boundary layer and outside of it."""
    cases = [slider(1.0), slider(4.0)]
    robust = rne.control.robust(slider(2.0), 4.0, 0.5, uniform, 0.7)
    passive = rne.control.robust_passive(cases, 9.0, 4.0, uniform, boundary=0.36)
    sliding = rne.control.sliding_mode(cases, 4.0, 0.5, uniform, reaching=0.2)
    for qd in (0.02, 2.0):
        z, qddr = qd / 0.5, ACCELERATION - 4.0 * qd
        saturated = z / max(abs(z), 1.0)
        state = (0.0, np.zeros(1), np.array([qd]))
        assert robust(*state) == pytest.approx(2.0 * (qddr - 4.0 * qd) - 0.7 / 0.5 * saturated)
        power = 1.5 * qddr * qd  # of half the difference of the cases
        shift = 1.5 * qddr * power / max(abs(power), 0.36)
        assert passive(*state) == pytest.approx(2.5 * qddr - 9.0 * qd - shift)
        k = 0.5 * 1.5 * abs(qddr) + 0.2
        assert sliding(*state) == pytest.approx(2.5 * qddr - k * saturated / 0.5)


def test_middle_of_the_cases_keeps_the_engine(arm):
    assert rne.control.Cases((rne.Robot(arm.model, "numba"), arm)).centre.engine == "numba"


def test_condition_of_the_book_fails_for_a_payload_that_outweighs_the_wrist(irb140):
    """|1 - M^-1 M_hat| < 1, which is needed in all configurations, fails for any mass in between."""
    q = np.random.default_rng(0).uniform(-1, 1, (50, 6))
    for known in (0.75, 1.5, 2.25):
        model = irb140.with_payload(known).mass_matrix(q)
        for moving in (irb140, irb140.with_payload(LARGEST)):
            A = np.eye(6) - np.linalg.solve(moving.mass_matrix(q), model)
            assert np.linalg.norm(A, 2, axis=(1, 2)).max() > 1


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (
            lambda r: rne.control.robust_passive([r], [1] * 6, [1] * 6, circle, boundary=1),
            "`cases` must be a sequence of at least two Robots, between which the robot that moves lies",
        ),
        (
            lambda r: rne.control.sliding_mode([r, r.mounted([1, 0, 0])], [1] * 6, [1] * 6, circle),
            "`cases` must differ only in masses, centres of mass and inertias, not in gravity",
        ),
        (
            lambda r: rne.control.robust_passive([r, r], [1] * 6, [1] * 6, circle, boundary=0.0),
            "`boundary` must be positive, got 0.0",
        ),
        (lambda r: rne.control.robust(r, [1] * 6, [0] * 6, circle, 1.0), "`boundary` must be positive, got 0.0"),
        (lambda r: rne.control.robust(r, [1] * 6, [1] * 6, circle, -1.0), "`rho` must be positive, got -1.0"),
        (
            lambda r: rne.control.uncertainty_bound(r, [r, r], [1] * 6, [1] * 6, 5, 1.0),
            "`reference` must be a function of time, got int",
        ),
        (
            lambda r: rne.control.uncertainty_bound(r.mounted([1, 0, 0]), [r, r], [1] * 6, [1] * 6, circle, 1.0),
            "`robot` must differ from `cases` only in masses, centres of mass and inertias, not in gravity",
        ),
        *(
            (
                lambda r, samples=samples: rne.control.uncertainty_bound(
                    r, [r, r], [1] * 6, [1] * 6, circle, 1.0, samples=samples
                ),
                f"`samples` must be a whole number of at least 16, got {samples}",
            )
            for samples in (15, 100.5)
        ),
        *(
            (
                lambda r, reaching=reaching: rne.control.sliding_mode(
                    [r, r], [1] * 6, [1] * 6, circle, reaching=reaching
                ),
                f"`reaching` must be positive, got {reaching}",
            )
            for reaching in (-1.0, 0.0)
        ),
    ],
)
def test_wrong_arguments_are_named(irb140, make, text):
    with pytest.raises(ValueError, match=rf"^{re.escape(text)}$"):
        make(irb140)
