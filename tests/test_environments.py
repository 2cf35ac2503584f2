"""Environments of gymnasium: what is observed and paid, seeds, many arms as one by one, and learning."""

import contextlib
import importlib
import io
import pickle
import re
import sys
import warnings

import numpy as np
import pytest

import rne

from .helpers import ROOT

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not installed, whose interface this is")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import SyncVectorEnv  # noqa: E402

from rne.environments import ArmEnv, ArmVectorEnv  # noqa: E402

STANDS = {"task": "swing-up", "link": "tool0", "goal": [0.0, 0.0]}


def two_links(engine="numpy", **limits):
    """Rods of 1 m and 1 kg that stand at 0 and turn freely."""
    limits = {"effort": [10, 5], "velocity": [20, 20]} | limits
    rods = {"masses": [1, 1], "centres": [[-0.5, 0, 0]] * 2, "inertias": [[0, 1 / 12, 1 / 12]] * 2}
    rows = {"a": [1, 1], "alpha": [0, 0], "d": [0, 0], "theta": [0, 0]}
    return rne.Robot(rne.dh_chain(**rows, **rods, types="continuous", gravity=[-9.81, 0, 0], **limits), engine)


def arm(engine="numpy"):
    """Joints with ranges, friction, and rotors as heavy as an arm's."""
    friction = rne.Friction(viscous=2.0, coulomb=1.0, smoothing=0.5)
    return rne.Scene(rne.load("irb140", engine=engine), friction=friction, armature=0.5, effort_limit=60.0)


def slide(engine="numpy"):
    """A slide with a range that carries a joint without one, turned so that it is pulled down."""
    types = {"types": ["prismatic", "continuous"], "lower": [-0.3, -np.inf], "upper": [0.5, np.inf]}
    chain = rne.dh_chain(
        **{"a": [0, 0.3], "alpha": [0.3, 0], "d": [0.2, 0], "theta": [0, 0]},
        **{"masses": [2, 1], "centres": [[0, 0, 0], [-0.1, 0, 0]], "inertias": np.zeros((2, 3)) + 0.01},
        **{"effort": [40, 2], "velocity": [3, 40]} | types,
    )
    return rne.Robot(chain, engine)


CASES = {
    "swing-up": (two_links, STANDS | {"start": [[2.5, -0.5], [3.7, 0.5]], "time_limit": 0.3}),
    "tool": (arm, {"link": "tool0", "time_limit": 0.2}),
    "joints": (slide, {"time_limit": 0.1}),
    "own": (two_links, {"time_limit": 0.2, "reward": rne.traceable(lambda q, qd, goal, action: -qd[0] * goal[1])}),
}


def same(a, b):
    """True if two results are equal bit for bit, with their types."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray) and a.dtype != object:
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b)
    return all(map(same, a, b)) if isinstance(a, np.ndarray) else type(a) is type(b) and a == b


@pytest.mark.parametrize("case", CASES)
def test_gymnasium_finds_nothing_wrong(case):
    make, options = CASES[case]
    env = gymnasium.make("rne/Arm-v0", scene=make(), substeps=1, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


LONG = [(case, engine, mode) for case in CASES for engine in ("numpy", "numba") for mode in ("NextStep", "SameStep")]


def compared(case, engine, mode, count, steps, substeps):
    """Many arms beside arms one by one; how often episodes ended in each way."""
    make, options = CASES[case]
    scene, ends = make(engine), np.zeros(2, int)
    options = options | {"substeps": substeps}
    each = SyncVectorEnv([lambda: ArmEnv(scene, **options)] * count, autoreset_mode=mode)
    many = ArmVectorEnv(count, scene, autoreset_mode=mode, **options)
    assert many.observation_space == each.observation_space
    assert many.action_space == each.action_space
    assert many.metadata == each.metadata
    assert same(many.reset(seed=5), each.reset(seed=5))
    many.action_space.seed(1)
    for k in range(steps):
        actions = 1.2 * many.action_space.sample()
        found = many.step(actions)
        assert same(found, each.step(actions)), k
        assert found[0] in many.observation_space
        ends += found[2].sum(), found[3].sum()
        if k == steps // 2:
            seeds = [None, 7] * (count // 2)
            assert same(many.reset(seed=seeds), each.reset(seed=seeds))
    return ends


def test_many_arms_are_arms_one_by_one_to_the_bit():
    """Also where episodes end at once and some are seeded anew."""
    assert compared("swing-up", "numpy", "NextStep", 4, 60, 1)[1] > 4
    assert compared("joints", "numpy", "SameStep", 2, 24, 1).sum() > 2


@pytest.mark.long
@pytest.mark.parametrize(("case", "engine", "mode"), LONG)
def test_many_arms_are_arms_one_by_one_to_the_bit_over_500_steps(case, engine, mode):
    assert compared(case, engine, mode, 4, 500, 2).sum() > 30


SINGLE = float(np.finfo(np.float32).eps)
HELD = (
    2e-7  # of float32, and of 200 steps of order 2 whose error is h^2 T / 24 times third derivatives of some 100 / s^3
)


def test_what_is_observed_of_a_swing_up_and_paid_is_as_written():
    """Of the state that another rule reaches."""
    arm, q0 = two_links(), [2.0, -0.5]
    env = ArmEnv(arm, **STANDS, start=q0)
    observation, info = env.reset(seed=0)
    assert observation == pytest.approx([*np.sin(q0), *np.cos(q0), 0, 0], abs=SINGLE)
    assert info["height"] == pytest.approx((np.cos(2.0) + np.cos(1.5)) / 2, abs=4e-16)
    observation, reward, terminated, truncated, info = env.step([0.5, -3.0])
    q, qd = np.array(q0), np.zeros(2)
    for _ in range(200):  # Euler's rule from the middle of each step
        middle = q + 5e-5 * qd, qd + 5e-5 * arm.forward_dynamics(q, qd, [5.0, -5.0])
        q, qd = q + 1e-4 * middle[1], qd + 1e-4 * arm.forward_dynamics(*middle, [5.0, -5.0])
    assert observation == pytest.approx([*np.sin(q), *np.cos(q), *qd / 20], abs=HELD)
    assert info["height"] == pytest.approx((np.cos(q[0]) + np.cos(q.sum())) / 2, abs=HELD)
    assert reward == pytest.approx((1 + info["height"]) / 2 - 0.01 * (0.25 + 1) / 2, abs=4e-16)
    assert (type(reward), terminated, truncated, observation.dtype) == (float, False, False, np.float32)


def test_what_is_observed_of_a_tool_on_its_way_and_paid_is_as_written():
    scene, start, goal = arm(), np.array([0.5, 0.4, -0.3, 0.2, 0.1, 0.3]), np.array([0.0, 0.1, 0.2, 0, 0, 0])
    env = ArmEnv(scene, link="tool0", start=start, goal=goal, substeps=1)
    observation, info = env.reset(seed=0)
    robot = scene.robot
    scaled = (2 * start - robot.lower - robot.upper) / (robot.upper - robot.lower)
    way = robot.link_poses(goal)[-1, :3, 3] - robot.link_poses(start)[-1, :3, 3]
    assert observation == pytest.approx([*scaled, *np.zeros(6), *way], abs=SINGLE)
    assert info["distance"] == pytest.approx(np.linalg.norm(way), rel=1e-14)
    _, reward, _, _, info = env.step(np.full(6, 0.5))
    assert reward == pytest.approx(0.1 / (0.1 + info["distance"]) - 0.0025, abs=4e-16)


def test_joints_without_a_range_take_the_short_way_and_the_others_stop_at_its_end():
    env = ArmEnv(slide(), start=[0.0, 3.0], goal=[0.25, -3.0], substeps=1, speed_limit=40.0)
    observation, info = env.reset(seed=0)
    short = 2 * np.pi - 6
    expected = [np.sin(3), np.cos(3), -0.25, 0, 0, np.sin(short), np.cos(short), 0.625]
    assert observation == pytest.approx(expected, abs=SINGLE)
    assert info["distance"] == pytest.approx(np.hypot(0.25, short), rel=1e-14)
    for _ in range(40):
        observation, _, terminated, _, _ = env.step([1.0, 0.0])
    assert (observation[2], observation[3], terminated) == (1, 0, False)


def test_speeds_observed_of_elastic_joints_are_those_of_the_links():
    elastic = rne.ElasticJoints(stiffness=300.0, damping=2.0, rotor=0.5)
    scene = rne.Scene(two_links(), elastic=elastic)
    env = ArmEnv(scene, **STANDS, start=[2.0, -0.5])
    env.reset(seed=0)
    observation = env.step([1.0, -1.0])[0]
    stepper = rne.Stepper(scene, sample_time=0.02, substeps=4)
    x = stepper(stepper.start([2.0, -0.5], [0, 0]), [10.0, -5.0])
    assert observation[4:] == pytest.approx(x[4:6] / 20, rel=4 * SINGLE)
    assert (abs(x[4:6] - x[6:8]) > 1e-3).all()


def test_an_own_reward_is_paid():
    env = ArmEnv(two_links(), reward=rne.traceable(lambda q, qd, goal, action: goal[1] - 2 * q[0] + action[0] ** 3))
    env.reset(seed=0)
    observation, reward, *_ = env.step([0.5, 0.0])
    q = np.arctan2(observation[:2], observation[2:4])
    goal = q + np.arctan2(observation[6:8], observation[8:10])
    turns = (reward - (goal[1] - 2 * q[0] + 0.125)) / (2 * np.pi)  # that sines do not tell
    assert abs(turns - round(turns)) < 8 * SINGLE


def test_episodes_are_drawn_evenly_by_seeds():
    low, high = np.array([2.5, -0.5]), np.array([3.7, 0.5])
    arms = ArmVectorEnv(400, two_links(), **STANDS, start=[low, high])
    observations = arms.reset(seed=1)[0]
    q = np.arctan2(observations[:, :2], observations[:, 2:4]) % (2 * np.pi)
    parts = ((q[:, 0] - low[0]) / 1.2, (q[:, 1] + 0.5) % (2 * np.pi))
    for part in parts:  # 400 even numbers: less than 1 in 1e8 seeds leave 5 % empty at an end
        assert -SINGLE <= part.min() < 0.05
        assert 1 + 4 * SINGLE >= part.max() > 0.95
    assert abs(np.corrcoef(parts)[0, 1]) < 0.25  # five standard deviations
    again = arms.reset()[0]
    assert (again != observations).any(axis=1).all()
    assert np.array_equal(arms.reset(seed=np.int64(1))[0], observations)
    assert np.array_equal(arms.reset()[0], again)
    assert np.array_equal(arms.reset(seed=[*range(2, 402)])[0][:-1], observations[1:])


def test_an_episode_ends_where_a_joint_is_too_fast_or_its_time_is_over():
    arms = ArmVectorEnv(2, two_links(), **STANDS, start=[[np.pi, 0], [np.pi, 0]], time_limit=0.2, speed_limit=3.0)
    arms.reset(seed=0)
    for k in range(1, 11):
        still = [[0, 0], [0, 1 if k > 2 else 0]]
        observations, _, terminated, truncated, _ = arms.step(still)
        if terminated[1]:
            break
        assert not truncated.any()
    assert observations[1, 5] == 1
    at_start = arms.step(still)[:2]
    assert at_start[0][1].tolist() == arms.reset()[0][1].tolist()
    assert at_start[1][1] == 0
    ended = [arms.step(np.zeros((2, 2)))[3].tolist() for _ in range(11)]
    assert ended == [[False, False]] * 9 + [[True, True], [False, False]]


def test_a_copy_goes_on_as_its_original():
    env = ArmEnv(two_links(), **STANDS)
    env.reset(seed=3)
    env.step([1.0, 0.5])
    other = pickle.loads(pickle.dumps(env))
    assert same(env.step([0.5, 0.0]), other.step([0.5, 0.0]))
    assert same(env.reset(), other.reset())


REFUSED = {
    "`task` must be one of ['reach', 'swing-up'], got 'walk'": {"task": "walk"},
    "`link` must be given for 'swing-up': the one whose height counts": {"task": "swing-up"},
    "`goal` must be joint positions that hold `link` above the root link": STANDS | {"goal": [np.pi, 0.0]},
    "`start` must have shape (2, 2), got (3, 2)": {"start": np.zeros((3, 2))},
    "`goal` must have shape (2,), got (1,)": {"goal": [0.0]},
    "`start` must be within the joints' ranges, the lowest positions first, got 1 to -1 of 'joint_2'": {
        "start": [[0, 1], [0, -1]]
    },
    "joint 'joint_1' must have a finite speed limit above 0, got 0: give `speed_limit`": {"speed_limit": 0.0},
    "`sample_time` must be positive, got -1.0": {"sample_time": -1.0},
    "`time_limit` must be positive, got 0.0": {"time_limit": 0.0},
    "`reward` must return one number, got None": {"reward": lambda q, qd, goal, action: None},
    "`reward` must return one number, got shape (2,)": {"reward": rne.traceable(lambda q, qd, goal, action: q)},
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_does_not_fit_is_refused(text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        ArmEnv(two_links(), **REFUSED[text])


def test_missing_limits_laws_and_ranges_are_refused_with_the_cure():
    arm = two_links()
    law = rne.Scene(arm, controller=rne.control.pd(arm, 1.0, 1.0, 0.0))
    endless = rne.dh_chain(a=[0], alpha=[0], d=[0], theta=[0], types="prismatic", effort=1, velocity=1)
    for scene, text in (
        (
            two_links(effort=[10, np.inf]),
            "joint 'joint_2' must have a finite effort limit above 0, got inf: give rne.Scene(..., effort_limit=...)",
        ),
        (
            two_links(velocity=[np.inf, 1]),
            "joint 'joint_1' must have a finite speed limit above 0, got inf: give `speed_limit`",
        ),
        (rne.Robot(endless), "joint 'joint_1' must have a range: give Robot.with_limits(lower=..., upper=...)"),
        (law, "`scene` has a controller: leave it out, the actions are the torques"),
    ):
        with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
            ArmEnv(scene)
    with pytest.raises(
        TypeError, match=r"^`reward` must be a function of \(q, qd, goal, action\) of one state, got float$"
    ):
        ArmEnv(arm, reward=1.0)
    with pytest.raises(
        TypeError, match=r"^`reward` must be a formula that can be traced: a traced number has no value"
    ):
        ArmEnv(arm, reward=lambda q, qd, goal, action: 1.0 if q[0] > 0 else 0.0)
    with pytest.raises(TypeError, match=r"^`scene` must be an rne.Scene or rne.Robot, got str$"):
        ArmEnv("ur5")


def test_actions_and_numbers_of_arms_are_checked():
    arms = ArmVectorEnv(3, two_links())
    for call, text in (
        (lambda: arms.step(np.zeros((2, 2))), "`actions` must have shape (3, 2), got (2, 2)"),
        (lambda: arms.step(np.full((3, 2), np.nan)), "`actions` must be finite, got nan at index (0, 0)"),
        (lambda: arms.reset(seed=[1, 2]), "`seed` must be one number or 3, got 2"),
        (lambda: arms.reset(seed=1.5), "`seed` must be a whole number of at least 0, got 1.5"),
        (lambda: ArmVectorEnv(0, two_links()), "`num_envs` must be a whole number above zero, got 0"),
        (
            lambda: ArmVectorEnv(1, two_links(), autoreset_mode="Disabled"),
            "`autoreset_mode` must be 'NextStep' or 'SameStep', got 'Disabled'",
        ),
    ):
        with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
            call()


def test_without_gymnasium_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "rne.environments")
    with pytest.raises(ImportError, match=re.escape("pip install 'rne[gymnasium]'")):
        importlib.import_module("rne.environments")


TUTORIAL = ROOT / "docs" / "tutorials" / "26_an_environment_for_learning.py"


def of_the_tutorial(engine):
    """What the tutorial defines before it learns."""
    text = TUTORIAL.read_text(encoding="utf-8").partition("# %%\n# Learning\n")[0]
    names = {"__name__": "tutorial"}
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(text.replace('engine="numba"', f"engine={engine!r}"), TUTORIAL.name, "exec"), names)
    return names


def test_few_updates_lift_the_arm():
    """In 0.6 s from hanging, twice as well as the first guess."""
    names = of_the_tutorial("numpy")
    names["task"] |= {"time_limit": 0.6, "substeps": 1}
    w, history = names["learn"](4, updates=8, pairs=6, starts=2)
    first = np.random.default_rng(4).normal(0, 0.3, names["size"])
    arms = ArmVectorEnv(8, names["arm"], **names["task"])
    rewards = names["episodes"](arms, np.array([w, first]), [*range(4)] * 2)[0].reshape(2, 4).mean(axis=1)
    assert rewards[0] > 2 * rewards[1] > 0
    assert len(history) == 8


@pytest.mark.long  # and seed 0 in the tutorial: 30 s of CPU each
def test_a_swing_up_is_learned_from_another_seed():
    names = of_the_tutorial("numba")
    w, _ = names["learn"](1)
    assert not names["trial"](np.random.default_rng(1).normal(0, 0.3, names["size"]))[1].any()
    assert names["trial"](w)[1].mean() >= 0.9
