"""Exciting motions: their limits hold at all times, gradients are exact, they excite better than random motions."""

import dataclasses
import re
from functools import partial

import numpy as np
import pytest
from scipy.optimize import OptimizeResult

import rne
from rne.identification.exciting_motions.limits import FourierBasis, MotionLimits, motion_limits
from rne.identification.exciting_motions.motion import (
    BaseRegressor,
    MotionSearch,
    SingularValues,
    log_condition,
    log_volume,
)

from .helpers import loaded
from .random_robots import random_tree

DURATION, HARMONICS = 4.0, 3
LIMITS = {"acceleration_limit": [10.0] * 3, "effort_limit": [60.0, 150.0, 40.0]}
ROUNDING = 1e-12  # of velocities and accelerations of a few units
DIFFERENCES = 1e-7  # central differences of step 1e-5, of the largest entry
TORQUES_BETWEEN = 1e-3  # of the limit: what the parabola between samples leaves out


@pytest.fixture(scope="module")
def arm():
    """The first three joints of the IRB 140."""
    return loaded("irb140").locked({"joint_4": 0.3, "joint_5": 0.5, "joint_6": 0.0})


@pytest.fixture(scope="module")
def motion(arm):
    return rne.excitation(arm, DURATION, HARMONICS, limits=LIMITS)


@pytest.fixture(scope="module")
def gantry():
    """Two sliding joints and one that rotates, with limits."""
    return limited(random_tree(3, seed=3, prismatic=0.7, branching=0))


def limited(model, **changes):
    """The robot with ranges of 2, velocities of 1.5 and any effort."""
    ones = np.ones(model.nb)
    limits = {"lower": -ones, "upper": ones, "velocity_limit": 1.5 * ones, "effort_limit": np.inf * ones}
    return rne.Robot(dataclasses.replace(model, **(limits | changes)))


def search_of(robot, criterion, harmonics=HARMONICS, rest=True, **options):
    """The search that `excitation` makes, and a random series in it."""
    base = robot.base_parameters(drives=rne.DriveModel(**({"smoothing": 0.1} | options)))
    within = MotionLimits(robot, FourierBasis(DURATION, harmonics), rest, **motion_limits(robot, {}))
    noise = np.linspace(1, 2, robot.n)
    x = 0.2 * np.random.default_rng(1).normal(size=within.size)
    return MotionSearch(within, BaseRegressor(base), noise, 40, criterion, (criterion,), 5, None), x


def condition(p=np.inf):
    """The condition number with a Schatten norm of order p."""
    return partial(log_condition, p=p)


def exactly(criterion, W):
    """A criterion of W itself, not of W^T W."""
    return criterion(SingularValues(W, exact=True).s)[0]


def slope(function, x, h=1e-5):
    """Central differences of a function by each entry of x, of fourth order."""
    e = h * np.eye(len(x))
    one = [(np.asarray(function(x + d)) - np.asarray(function(x - d))) / (2 * h) for d in e]
    two = [(np.asarray(function(x + 2 * d)) - np.asarray(function(x - 2 * d))) / (4 * h) for d in e]
    return np.stack([(4 * a - b) / 3 for a, b in zip(one, two, strict=True)], axis=-1)


def close(got, expected, bound):
    assert np.abs(got - expected).max() <= bound * np.abs(expected).max()


def fine(motion, count=4000):
    """States at many times, none of them on the grid of the search."""
    return motion((np.arange(count) + 0.37) * (motion.duration / count))


def observed(robot, motion, count, **options):
    """W of a motion, all base parameters, and the torques of the model that it should explain."""
    states = motion(np.arange(count) * (motion.duration / count))
    W = robot.base_parameters(drives=rne.DriveModel(**options)).regressor(*states)
    return W.reshape(-1, W.shape[-1]), robot.inverse_dynamics(*states).ravel()


def test_positions_rates_and_accelerations_keep_their_limits_at_all_times(arm, motion):
    q, qd, qdd = fine(motion)
    assert (arm.lower <= q.min(0)).all()
    assert (q.max(0) <= arm.upper).all()
    assert (np.abs(qd).max(0) <= arm.velocity_limit).all()
    assert (np.abs(qdd).max(0) <= LIMITS["acceleration_limit"]).all()


def test_torques_keep_their_limits_and_one_is_active(arm, motion):
    tau = np.abs(arm.inverse_dynamics(*fine(motion))).max(0)
    assert (tau <= np.array(LIMITS["effort_limit"]) * (1 + TORQUES_BETWEEN)).all()
    assert any(limit.startswith("torque of ") for limit in motion.active)
    assert f"active limits: {', '.join(motion.active)}" in " ".join(repr(motion).split())
    assert (tau <= motion.limit_use["torque"] * LIMITS["effort_limit"] * (1 + TORQUES_BETWEEN)).all()


def test_the_limits_that_a_motion_uses_are_named(motion):
    told = " ".join(repr(motion).split())
    assert f"; active limits: {', '.join(motion.active)} collisions of the arm" in told
    idle = dataclasses.replace(motion, limit_use={kind: 0 * use for kind, use in motion.limit_use.items()})
    assert "active" not in repr(idle)


def test_shares_of_limits_are_bounds_that_are_nearly_reached(arm, motion):
    q, qd, qdd = fine(motion)
    found = {
        "position": np.abs(q - (arm.lower + arm.upper) / 2).max(0) / ((arm.upper - arm.lower) / 2),
        "velocity": np.abs(qd).max(0) / arm.velocity_limit,
        "acceleration": np.abs(qdd).max(0) / LIMITS["acceleration_limit"],
    }
    for kind, share in found.items():
        assert (share <= motion.limit_use[kind]).all()
        np.testing.assert_allclose(share, motion.limit_use[kind], rtol=2e-3)  # 1 - cos(pi / 64) is 1.2e-3


def test_starts_and_ends_at_rest_and_repeats(motion):
    for t in (0.0, DURATION, 5 * DURATION):
        q, qd, qdd = motion(t)
        np.testing.assert_allclose([qd, qdd], 0, atol=ROUNDING * 100)
        np.testing.assert_allclose(q, motion(0.0)[0], atol=ROUNDING)
    for x, y in zip(motion(1.234), motion(1.234 + 3 * DURATION), strict=True):
        np.testing.assert_allclose(x, y, atol=ROUNDING * 100)


def test_rates_and_accelerations_are_derivatives(motion):
    t, h = np.linspace(0.1, 3.9, 20), 1e-5
    (q0, v0, _), (_, v, a), (q1, v1, _) = motion(t - h), motion(t), motion(t + h)
    np.testing.assert_allclose((q1 - q0) / (2 * h), v, atol=1e-8)
    np.testing.assert_allclose((v1 - v0) / (2 * h), a, atol=1e-7)


def test_is_a_reference_that_can_be_traced(arm, motion):
    law = rne.control.computed_torque(arm, [100] * 3, [20] * 3, motion)
    scene = rne.Scene(arm, controller=law)
    times = np.linspace(0, 1, 6)
    run = rne.simulate(scene, motion(0.0)[0], [0] * 3, 1.0, t_eval=times, rtol=1e-9)
    assert scene.cost()["law"] == "traced"
    np.testing.assert_allclose(run.q, motion(times)[0], atol=1e-7)
    for column, row in zip(motion(times[:, None]), motion(times), strict=True):
        np.testing.assert_array_equal(column, row)


def test_condition_is_that_of_the_stacked_regressor(arm, motion):
    W, _ = observed(arm, motion, 20 * HARMONICS)
    np.testing.assert_allclose(motion.condition, np.linalg.cond(W), rtol=1e-9)
    np.testing.assert_allclose(motion.log_det, np.linalg.slogdet(W.T @ W)[1], rtol=1e-9)
    other, _ = observed(arm, motion, 1000)
    np.testing.assert_allclose(motion.condition, np.linalg.cond(other), rtol=0.02)  # of all times, not of the grid


def test_excites_better_than_the_best_random_motion(motion):
    assert len(motion.random) == 100
    assert motion.condition < 0.6 * motion.random.min()
    assert motion.converged


def test_determinant_is_larger_than_of_random_motions_and_of_the_other_criterion(arm, motion):
    other = rne.excitation(arm, DURATION, HARMONICS, "d-optimal", limits=LIMITS, starts=1)
    assert other.log_det > other.random.max() + 5
    assert other.log_det > motion.log_det + 1
    assert other.condition > motion.condition


def test_round_trip_without_noise(arm, motion):
    """Torques of the excitation determine the base parameters to the condition number times rounding."""
    W, tau = observed(arm, motion, 200)
    found, *_ = np.linalg.lstsq(W, tau, rcond=None)
    expected = arm.base_parameters().values
    bound = 100 * motion.condition * np.finfo(float).eps  # rounding of W and tau: some tens of operations
    assert np.linalg.norm(found - expected) <= bound * np.linalg.norm(expected)


def test_the_same_arguments_give_the_same_motion(arm):
    options = {"limits": LIMITS, "iterations": 3, "starts": 1, "random_motions": 10}
    first, again = (rne.excitation(arm, DURATION, 2, **options) for _ in range(2))
    np.testing.assert_array_equal([first.a, first.b], [again.a, again.b])


def test_early_stop_is_reported_and_keeps_the_limits(arm, caplog):
    caplog.set_level("INFO", "rne")
    seen = []
    motion = rne.excitation(
        arm, DURATION, HARMONICS, limits=LIMITS, iterations=2, starts=2, progress=lambda *s: seen.append(s)
    )
    assert not motion.converged
    assert motion.message == "Iteration limit reached"
    assert "not converged: Iteration limit reached" in repr(motion).replace("\n  ", " ")
    assert all(use.max() <= 1 for use in motion.limit_use.values())
    assert seen == [(done, 6) for done in range(1, 7)]  # two starts, the best of them once more
    assert caplog.messages[0] == "excitation, start 0: Iteration limit reached after 2 iterations"
    assert motion.condition <= motion.random.min()


@pytest.mark.parametrize(
    ("ends", "expected"),
    [
        ((1.0, np.nan), (1.0, False, "Iteration limit reached")),
        ((np.nan, 1.0), (1.0, True, "Optimization terminated successfully")),
        ((np.nan, 0.25), (0.5, False, "no run found a better motion than the best random ones")),
    ],
    ids=["first run", "last run", "neither"],
)
def test_message_is_that_of_the_run_that_found_the_motion(arm, monkeypatch, ends, expected):
    """Runs end at multiples of a series that excites the more the larger it is; they start at its half."""
    search, x = search_of(arm, log_volume)
    said = [(False, 9, "Iteration limit reached"), (True, 0, "Optimization terminated successfully")]
    runs = iter(
        OptimizeResult(x=end * x, success=success, status=status, message=message, nit=1)
        for end, (success, status, message) in zip(ends, said, strict=True)
    )
    monkeypatch.setattr("scipy.optimize.minimize", lambda *arguments, **options: next(runs))
    found = dataclasses.replace(search, stages=2 * search.stages).run(0.5 * x[None])
    np.testing.assert_array_equal(found.x, expected[0] * x)
    assert (found.success, found.message) == expected[1:]


def test_a_run_that_rounding_ends_begins_again_at_the_best_of_its_iterates(arm, monkeypatch):
    search, x = search_of(arm, log_volume)
    begun = []

    def minimize(_, start, *, callback, **options):
        begun.append(start / x)
        callback(0.9 * x)
        callback(0.2 * x)
        return OptimizeResult(x=0.2 * x, success=len(begun) > 1, status=4 * (len(begun) == 1), message="", nit=2)

    monkeypatch.setattr("scipy.optimize.minimize", minimize)
    search.run(0.5 * x[None])
    np.testing.assert_allclose(np.array(begun), [np.full(len(x), 0.5), np.full(len(x), 0.9)], rtol=1e-12)


def test_a_run_that_ends_beyond_the_limits_is_taken_back_to_them(arm):
    search, x = search_of(arm, log_volume)
    held = search._held(0.01 * x, 100 * x)
    assert max(use.max() for use in search.within.use(held).values()) == pytest.approx(1, abs=1e-3)
    assert search.within.holds(held)


def test_the_condition_number_depends_on_the_extreme_singular_values_alone():
    np.testing.assert_array_equal(log_condition(np.array([1.0, 0.99, 0.11, 0.1]))[1], [1, 0, 0, -1])


@pytest.mark.parametrize("criterion", [condition(16.0), condition(64.0), condition(), log_volume])
def test_gradients_are_exact(arm, criterion):
    search, x = search_of(arm, criterion)
    expected = slope(lambda y: exactly(criterion, search.matrix(y)), x)
    close(search.gradient(criterion, x), expected, DIFFERENCES)


def test_gradients_with_friction_rotors_offsets_and_shafts(gantry):
    options = {"rotor": True, "friction": "viscous+coulomb", "offset": True, "coupled_motors": [[1.0, -1.0, 0.5]]}
    search, x = search_of(gantry, log_volume, rest=False, **options)
    close(search.gradient(search.exact, x), slope(lambda y: search.value(search.exact, y), x), DIFFERENCES)


def test_gradients_of_torque_limits(gantry):
    robot = limited(gantry.model, damping=np.array([3.0, 1.0, 2.0]), friction=np.ones(3))
    limits = motion_limits(robot, {"effort_limit": [10.0, np.inf, 5.0]})
    within = MotionLimits(robot, FourierBasis(DURATION, 2), True, **limits)
    x, grid = 0.3 * np.random.default_rng(0).normal(size=within.size), within.basis.grid(9)
    close(within.torque_slack_slopes(x, grid), slope(lambda y: within.torque_slack(y, grid), x), DIFFERENCES)


def test_friction_of_the_model_takes_its_part_of_the_efforts(arm):
    damping, friction = np.array([8.0, 8.0, 8.0]), np.array([5.0, 10.0, 2.0])
    rough = rne.Robot(dataclasses.replace(arm.model, damping=damping, friction=friction))
    motion = rne.excitation(rough, DURATION, HARMONICS, limits=LIMITS, starts=1, iterations=10)
    states = fine(motion)
    torques = np.abs(arm.inverse_dynamics(*states) + damping * states[1]).max(0) + friction
    assert (torques <= np.array(LIMITS["effort_limit"]) * (1 + TORQUES_BETWEEN)).all()
    assert max(torques / LIMITS["effort_limit"]) > 0.9


@pytest.mark.parametrize("count", [13, 16, 40])
def test_between_the_times_of_a_grid_a_series_is_bounded(count):
    basis, rng = FourierBasis(DURATION, 4), np.random.default_rng(0)
    coefficients = rng.normal(size=(9, 1000))
    coarse, dense = (np.abs(basis.grid(k)[1] @ coefficients).max(0) for k in (count, 2000))
    assert (dense * basis.grid_share(count) <= coarse * (1 + ROUNDING)).all()


@pytest.mark.parametrize("count", [16, 40])
def test_the_bound_between_the_times_of_a_grid_is_sharp(count):
    """The highest harmonic reaches it with its maxima half-way between the times."""
    basis = FourierBasis(DURATION, 4)
    half_way = (np.arange(count) + 0.5) * (DURATION / count)
    np.testing.assert_allclose(np.cos(basis.frequencies[-1] * half_way).max(), basis.grid_share(count), rtol=ROUNDING)


def test_schatten_norms_bound_the_condition_number(arm):
    search, x = search_of(arm, condition())
    W = search.matrix(x)
    for p in (16.0, 64.0):
        excess = exactly(condition(p), W) - np.log(np.linalg.cond(W))
        assert 0 <= excess <= 2 * np.log(W.shape[1]) / p


def test_accelerations_are_within_the_limits_of_either_direction(irb140):
    robot = irb140.with_limits(acceleration=10, deceleration=[2, 20, 4, 5, 40, 7])
    assert motion_limits(robot, None)["acceleration_limit"].tolist() == [2, 10, 4, 5, 10, 7]


def test_sliding_joints(gantry):
    motion = rne.excitation(gantry, DURATION, 2, drives=rne.DriveModel(friction="viscous"), starts=1)
    q, qd, _ = fine(motion)
    assert (np.abs(q).max(0) <= 1).all()
    assert (np.abs(qd).max(0) <= 1.5).all()
    assert motion.condition < motion.random.min()


@pytest.mark.parametrize("seed", [6, 10, 13])
def test_at_the_end_of_a_range_one_of_the_joints_that_mimic_is_at_its_limit(seed):
    """None is beyond its own; of multipliers of either sign."""
    model = random_tree(4, seed=seed, mimics=2)
    limits = motion_limits(limited(model), None)
    ends = np.array([limits["lower"], limits["upper"]]) @ model.coordinate_map.T + model.offset
    reach = np.abs([*ends, model.coordinate_map @ limits["velocity_limit"] / 1.5])
    largest = [reach[:, np.array(model.coordinate) == j].max(1) for j in range(model.n)]
    np.testing.assert_allclose(largest, 1)


def test_joints_that_mimic_keep_their_own_limits():
    model = random_tree(4, seed=6, mimics=2)
    assert model.n < model.nb
    robot = limited(model)
    motion = rne.excitation(robot, DURATION, 2, starts=1, iterations=4)
    q, qd, _ = fine(motion)
    positions = q @ model.coordinate_map.T + model.offset
    assert (np.abs(positions).max(0) <= 1).all()
    assert (np.abs(qd @ model.coordinate_map.T).max(0) <= 1.5).all()


def test_a_pose_that_cannot_be_held_is_no_start(arm):
    """In mid-range, joint 2 takes 24 N m; the excitation moves where less is needed."""
    middle = np.abs(arm.gravity_torque((arm.lower + arm.upper) / 2))
    efforts = np.array([60.0, 0.8 * middle[1], 40.0])
    motion = rne.excitation(
        arm, 2 * DURATION, HARMONICS, limits=LIMITS | {"effort_limit": efforts}, starts=1, iterations=5
    )
    assert (np.abs(arm.inverse_dynamics(*fine(motion))).max(0) <= efforts * (1 + TORQUES_BETWEEN)).all()


def test_locked_joints_stay_where_they_are(arm):
    """The motion is that of the robot without them, and is as good."""
    robot = loaded("irb140")
    options = {"starts": 1, "iterations": 5, "random_motions": 10}
    drives = rne.DriveModel(friction="viscous", coupled_motors=[[1, -1, 0, 0, 0, 0], [0, 0, 0, 0, 1, -1]])
    full = {name: [*values, 1.0, 1.0, 1.0] for name, values in LIMITS.items()}
    locked = {"joint_4": 0.3, 4: 0.5, "joint_6": 0.0}
    motion = rne.excitation(robot, DURATION, 2, limits=full, locked=locked, drives=drives, **options)
    fewer = rne.DriveModel(friction="viscous", coupled_motors=[[1, -1, 0]])
    expected = rne.excitation(arm, DURATION, 2, limits=LIMITS, drives=fewer, **options)
    assert motion.condition == expected.condition
    q, qd, qdd = fine(motion)
    for part, other in zip((q, qd, qdd), fine(expected), strict=True):
        np.testing.assert_allclose(part[:, :3], other, atol=ROUNDING)
    assert (q[:, 3:] == [0.3, 0.5, 0.0]).all()
    assert not qd[:, 3:].any()
    assert not qdd[:, 3:].any()
    assert motion.robot is robot
    assert motion.locked == {"joint_4": 0.3, "joint_5": 0.5, "joint_6": 0.0}
    note = (
        "locked: joint_4 at 0.3, joint_5 at 0.5, joint_6 at 0; parameters that only these joints excite are not counted"
    )
    assert motion.notes[0] == note
    assert note in " ".join(repr(motion).split())
    assert motion.limit_use["torque"].shape == (6,)


def test_locked_joints_without_a_position_are_in_the_middle_of_their_ranges(gantry):
    lower = np.array([-1.0, -1.0, 0.5])
    robot = limited(gantry.model, lower=lower)
    options = {"starts": 1, "iterations": 1, "random_motions": 5}
    by_name, by_index = (
        rne.excitation(robot, DURATION, 2, locked=[joint], **options) for joint in (robot.joint_names[2], -1)
    )
    assert by_name.locked == by_index.locked == {robot.joint_names[2]: 0.75}
    assert (fine(by_name)[0][:, 2] == 0.75).all()


def test_notes_say_what_is_not_considered(arm, motion):
    collisions = "collisions of the arm with itself and its surroundings are not considered"
    assert motion.notes == (collisions,)
    options = {"starts": 1, "iterations": 1, "random_motions": 5}
    unbounded = LIMITS | {"effort_limit": [60.0, np.inf, np.inf]}
    other = rne.excitation(arm, DURATION, 2, limits=unbounded, **options)
    assert other.notes == (
        "torque is not bounded: the model has no effort limits of joint_2, joint_3",
        collisions,
    )
    assert repr(other).replace("\n  ", "\n").endswith("\n".join(other.notes))


def test_gradients_with_a_stribeck_effect(gantry):
    options = {"friction": "coulomb", "stribeck": [0.2, 0.0, 0.5]}
    search, x = search_of(gantry, log_volume, rest=False, **options)
    close(search.gradient(search.exact, x), slope(lambda y: search.value(search.exact, y), x), DIFFERENCES)


def test_singular_values_from_the_normal_matrix_have_the_digits_of_an_optimiser():
    """Beyond a condition number of 1000 they come from W itself."""
    rng = np.random.default_rng(0)
    (U, _), (V, _) = (np.linalg.qr(rng.normal(size=shape)) for shape in ((50, 6), (6, 6)))
    for condition, bound in ((900.0, 1e-9), (1e5, 1e-10), (1e10, 1e-5)):
        s = np.geomspace(condition, 1, 6)
        np.testing.assert_allclose(np.sort(SingularValues(U * s @ V.T).s), s[::-1], rtol=bound)


def test_samples_and_files(arm, motion, tmp_path):
    samples = motion.sample(50.0, periods=np.int64(2))
    np.testing.assert_allclose(samples.t, np.arange(401) / 50, rtol=1e-14)
    np.testing.assert_array_equal(samples.qdd, motion(samples.t)[2])
    again = rne.trajectories.read_csv(motion.to_csv(tmp_path / "motion.csv", 50.0, 2), arm.joint_names)
    for part in ("t", "q", "qd", "qdd"):
        np.testing.assert_array_equal(getattr(again, part), getattr(samples, part))
    figure = rne.plotting.plot(samples, arm, quantities=["q", "qd", "qdd"])
    assert len(figure.axes) == 3


@pytest.mark.long
def test_irb140_with_all_joints():
    """Six joints, five harmonics: the condition number of random motions is some 35, of the best of 100 some 18."""
    motion = rne.excitation(loaded("irb140"), 10.0, 5, limits={"acceleration_limit": [10.0] * 6})
    assert motion.condition < 6.5 < 13 < motion.random.min()
    assert motion.converged


@pytest.mark.parametrize(
    ("arguments", "options", "error", "text"),
    [
        ((0.0, 3), {}, ValueError, "`duration` must be positive, got 0.0"),
        ((4.0, 0), {}, ValueError, "`harmonics` must be a whole number above zero, got 0"),
        ((4.0, 1), {}, ValueError, "`harmonics` must be at least 2 for a motion that starts at rest, got 1"),
        ((4.0, 3, "best"), {}, ValueError, "`criterion` must be one of ['condition', 'd-optimal'], got 'best'"),
        ((4.0, 3), {"limits": [1]}, TypeError, "`limits` must be a mapping of names to arrays, got list"),
        (
            (4.0, 3),
            {"limits": {"torque": [1]}},
            ValueError,
            "`limits` must name some of ['lower', 'upper', 'velocity_limit', 'acceleration_limit', 'effort_limit'], "
            "got 'torque'",
        ),
        ((4.0, 3), {"limits": {"upper": [1.0]}}, ValueError, "`limits['upper']` must have shape (3,), got (1,)"),
        (
            (4.0, 3),
            {"limits": {"upper": [1.0, np.nan, 1.0]}},
            ValueError,
            "`limits['upper'][1]` of joint 'joint_2' must be a number, got nan",
        ),
        (
            (4.0, 3),
            {"limits": {"effort_limit": -1}},
            ValueError,
            "`limits['effort_limit'][0]` of joint 'joint_1' must not be negative, got -1.0",
        ),
        (
            (4.0, 3),
            {"limits": {"upper": [1.0, np.inf, 1.0]}},
            ValueError,
            "joint 'joint_2' has no finite range; give `limits` with 'lower' and 'upper'",
        ),
        (
            (4.0, 3),
            {"limits": {"velocity_limit": [1.0, 1.0, np.inf]}},
            ValueError,
            "joint 'joint_3' has no finite velocity limit; give `limits` with 'velocity_limit'",
        ),
        (
            (4.0, 3),
            {"limits": {"lower": [4.0, 0.0, 0.0]}},
            ValueError,
            "`limits`: the range of joint 'joint_1' is empty, from 4 to 3.14159",
        ),
        (
            (4.0, 3),
            {"limits": {"effort_limit": [1.0, 0.0, 1.0]}},
            ValueError,
            "`limits`: effort_limit of joint 'joint_2' must be positive, got 0",
        ),
        (
            (4.0, 3),
            {"limits": {"effort_limit": [1.0, 1e-6, 1.0]}},
            ValueError,
            "`limits`: no pose is held with 90% of the efforts; the best of 2000 takes 3.2e+05 times effort_limit of "
            "joint 'joint_2'",
        ),
        ((4.0, 3), {"noise": [1.0, 0.0, 1.0]}, ValueError, "`noise` must be positive, got 0.0"),
        (
            (4.0, 3),
            {"locked": "joint_1"},
            TypeError,
            "`locked` must be a list of joints or a mapping to positions, got str",
        ),
        (
            (4.0, 3),
            {"locked": ["joint_4"]},
            ValueError,
            "`locked` must have joints of ['joint_1', 'joint_2', 'joint_3'] or their indices, got 'joint_4'",
        ),
        (
            (4.0, 3),
            {"locked": {0: 9.0}},
            ValueError,
            "`locked[0]` must be in the joint's range, -3.14159 to 3.14159, got 9",
        ),
        (
            (4.0, 3),
            {"locked": ["joint_3"], "limits": {"upper": [1.0, 1.0, np.inf]}},
            ValueError,
            "`locked`: joint 'joint_3' has no finite range; give its position",
        ),
        ((4.0, 3), {"locked": [0, 1, 2]}, ValueError, "`locked` must leave a joint that moves, got all of them"),
        ((4.0, 3), {"starts": 0}, ValueError, "`starts` must be a whole number above zero, got 0"),
    ],
)
def test_wrong_arguments(arm, arguments, options, error, text):
    with pytest.raises(error, match=f"^{re.escape(text)}$"):
        rne.excitation(arm, *arguments, **options)


def test_limits_too_narrow_to_excite():
    """Within 1e-12 rad, gravity is as constant as an offset."""
    pendulum = loaded("irb140").locked({f"joint_{k}": 0.0 for k in (1, 3, 4, 5, 6)})
    narrow = {"lower": [-1e-12], "upper": [1e-12]}
    text = (
        "100 random motions of 2 harmonics within the limits excite at most 3 of 4 base parameters; give more harmonics "
        "or wider limits"
    )
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        rne.excitation(pendulum, 4.0, 2, drives=rne.DriveModel(offset=True), limits=narrow)


def test_something_that_is_no_robot(arm):
    with pytest.raises(TypeError, match=r"^`robot` must be an rne\.Robot, got Model$"):
        rne.excitation(arm.model, 4.0)
    fixed = arm.locked(dict.fromkeys(arm.joint_names, 0.0))
    with pytest.raises(ValueError, match=r"^`robot` must have at least one joint, got none$"):
        rne.excitation(fixed, 4.0)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((0.0,), "`sample_rate` must be positive, got 0.0"),
        ((50.0, 0), "`periods` must be a whole number above zero, got 0"),
        ((50.0, True), "`periods` must be a whole number above zero, got True"),
    ],
)
def test_wrong_samples(motion, arguments, text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        motion.sample(*arguments)


def test_coulomb_friction_is_smoothed_by_5_percent_of_the_smallest_velocity_limit():
    """Unless the drives say by what."""
    robot = limited(random_tree(2, seed=3, branching=0), velocity_limit=np.array([1.5, 2.5]))
    options = {"random_motions": 3, "starts": 1, "iterations": 2}
    usual, same, other = (
        rne.excitation(robot, 2.0, 2, drives=rne.DriveModel(friction="coulomb", smoothing=smoothing), **options)
        for smoothing in (None, 0.05 * 1.5, 0.06 * 1.5)
    )
    np.testing.assert_allclose(usual.random, same.random, rtol=1e-9)
    assert (np.abs(other.random / usual.random - 1) > 1e-4).all()
