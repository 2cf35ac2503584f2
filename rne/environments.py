"""Environments for learning, as gymnasium takes them: arms whose actions are torques, one, or many in one batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from .basics.arrays import UNBOUNDED, check_function, per_joint_array, positive_number, real_array, whole_number
from .basics.spatial import Array
from .elementwise import arctan2, clip, maximum
from .robot import Robot
from .simulation.scene import Scene
from .simulation.scene_dynamics import UserFunction
from .simulation.simulator import scene_argument
from .simulation.stepper import Stepper

try:
    import gymnasium
    from gymnasium.spaces import Box
    from gymnasium.utils.seeding import np_random
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError:
    raise ImportError("`rne.environments` needs gymnasium 1.1 or newer: pip install 'rne[gymnasium]'") from None

__all__ = ["ArmEnv", "ArmVectorEnv"]
TASKS = {"reach": "distance", "swing-up": "height"}  # tasks, and the quantity in `info`
NEAR = 0.1  # distance with half the reward [rad or m]
EFFORT = 0.01  # cost of full torques at all joints


@dataclass(frozen=True, eq=False)
class Sight:
    """Observation, information and reward in one state, traced as one function."""

    robot: Robot
    link: int | None  # whose position counts; None for positions of the joints
    up: Array | None  # of a swing-up: against gravity, over the height that counts as 1 [1/m]
    turns: Array  # True for joints without a range
    middle: Array
    half: Array  # of the ranges; 0 and 1 without one [rad or m]
    speed_limit: Array
    reward: UserFunction | None
    traceable = True

    def __call__(self, q: Array, qd: Array, qdr: Array, tau: Array) -> Array:
        """[observation, distance or height, reward, largest speed]; the goal is `qdr`, the action `tau`."""
        if self.up is not None:
            seen: list[Array] = []
            measure = (self._tool(q) * self.up).sum()
        else:
            way = self._tool(qdr) - self._tool(q) if self.link is not None else qdr - q
            seen = [way] if self.link is not None else self._joints(way)
            way = way if self.link is not None else np.concatenate([arctan2(*seen[:2]), way[~self.turns]])
            measure = np.sqrt((way * way).sum())
        closeness = (1 + measure) / 2 if self.up is not None else NEAR / (NEAR + measure)
        paid = closeness - EFFORT * (tau * tau).sum() / len(q)
        paid = paid if self.reward is None else self.reward.value(q, qd, qdr, tau)
        speeds = qd / self.speed_limit
        fastest = reduce(maximum, maximum(speeds, -speeds))
        seen = [*self._joints(q - self.middle), clip(speeds, -1.0, 1.0), *seen]
        return np.concatenate([*seen, [measure, paid, fastest]])

    def _tool(self, q: Array) -> Array:
        return self.robot.link_poses(q)[self.link, :3, 3]

    def _joints(self, q: Array) -> list[Array]:
        return [np.sin(q[self.turns]), np.cos(q[self.turns]), (q / self.half)[~self.turns]]

    def bounds(self) -> Array:
        """Largest absolute values of the observation."""
        model, turning, n = self.robot.model, int(self.turns.sum()), len(self.turns)
        if self.up is not None:
            seen = np.zeros(0)
        elif self.link is None:
            seen = np.repeat([1.0, 2.0], [2 * turning, n - turning])
        else:  # no link is farther from the root than all parts of the robot in one line
            slides = np.where(model.is_revolute, 0, np.maximum(np.abs(model.lower), np.abs(model.upper)))
            parts = np.linalg.norm([*model.translation, model.link_translation[self.link]], axis=1)
            seen = np.full(3, 2 * (parts.sum() + slides.sum()))
        return np.concatenate([np.ones(turning + 2 * n), seen])


class ArmEnv(gymnasium.Env[Array, Array]):
    """Arm that learns to reach a goal, or to swing up, by the torques of its drives.

    An action is the torques over their limits, -1 to 1, held for `sample_time`. Observed are in this order, as float32:

    - sines, then cosines of the joints without a range; positions of the others, -1 and 1 at the ends of their ranges,
      at which they stop inelastically;
    - speeds over `speed_limit`; where one is larger, the episode ends, terminated;
    - of "reach" the way to the goal: the link's along the axes of the root link [m], or without `link` the joints', as
      sines, cosines and in halves of ranges.

    The reward is 0.1 / (0.1 + distance) for "reach" [m, rad], (1 + height) / 2 for "swing-up", less 0.01 times the mean
    square of the action; `info` has the "distance" or "height". An episode begins at rest.

    Parameters
    ----------
    scene : Scene or Robot
        Without a controller; a robot's drives have the limits of its file.
    task : {"reach", "swing-up"}
        What is rewarded.
    link : str, optional
        The link whose origin is to reach its place at the goal, or whose height above the root link counts.
    goal, start : array_like, shape (n,) or (2, n), optional
        Joint positions, or lowest and highest ones, between which each episode draws evenly; by default the ranges, -pi
        to pi where a joint has none. The height is 1 at the middle of `goal` [rad or m].
    sample_time : float
        Time from action to action [s].
    substeps : int
        Steps of RK4 in between.
    time_limit : float
        After which an episode is truncated [s].
    speed_limit : float or array_like, shape (n,), optional
        By default the limits of the robot [rad/s or m/s].
    reward : callable, optional
        Another reward, f(q, qd, goal, action) of one state, all of shape (n,): a formula that can be traced.

    Raises
    ------
    ValueError, TypeError
        If there is no such task or link, a joint has no limit of torque or speed, or an argument does not fit.

    Notes
    -----
    Few files have rotors, and without them a wrist is so light that its drives exceed its speed limit at once.

    Examples
    --------
    >>> import rne
    >>> scene = rne.Scene(rne.load("irb140"), armature=0.5, effort_limit=50.0)
    >>> env = rne.environments.ArmEnv(scene, link="tool0")
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    >>> observation.shape, 0 < reward < 1
    ((15,), True)
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012, gymnasium's own

    def __init__(
        self,
        scene: Scene | Robot,
        task: str = "reach",
        *,
        link: str | None = None,
        goal: ArrayLike | None = None,
        start: ArrayLike | None = None,
        sample_time: float = 0.02,
        substeps: int = 4,
        time_limit: float = 5.0,
        speed_limit: ArrayLike | None = None,
        reward: Callable[..., Any] | None = None,
    ) -> None:
        if task not in TASKS:
            raise ValueError(f"`task` must be one of {list(TASKS)}, got {task!r}")
        scene = scene_argument(scene, "scene")
        if scene.controller is not None:
            raise ValueError("`scene` has a controller: leave it out, the actions are the torques")
        if reward is not None:
            check_function("reward", reward, "(q, qd, goal, action) of one state")
        self._robot, self._told, self._moving = scene.resolved.robot, TASKS[task], scene.dynamics.n
        robot, limit = self._robot, scene.resolved.effort_limit
        self._effort = _limits(robot, "effort", robot.effort_limit if limit is None else limit)
        speed = robot.velocity_limit if speed_limit is None else per_joint_array("speed_limit", speed_limit, robot.n)
        self._speed = _limits(robot, "speed", speed)
        turns = ~(np.isfinite(robot.lower) & np.isfinite(robot.upper))
        for k in np.flatnonzero(turns & ~robot.model.is_revolute[[*robot.model.independent_joints]]):
            name = robot.joint_names[k]
            raise ValueError(f"joint {name!r} must have a range: give Robot.with_limits(lower=..., upper=...)")
        low, high = (np.where(turns, end, x) for end, x in ((-np.pi, robot.lower), (np.pi, robot.upper)))
        starts, goals = (
            _ends(robot, k, (low, high) if x is None else x) for k, x in (("start", start), ("goal", goal))
        )
        self._low, self._high = np.hstack([starts, goals])
        index = None if link is None else robot.model.link_index(link)
        up = _up(robot, index, goals.mean(axis=0)) if task == "swing-up" else None
        middle, half = np.where(turns, 0.0, (low + high) / 2), np.where(turns | (low == high), 1.0, (high - low) / 2)
        own = None if reward is None else UserFunction("reward", reward, (robot.n,) * 4)
        sight = Sight(robot, index, up, turns, middle, half, self._speed, own)
        self._sight, bounds = robot.kernel(cast(Any, sight)), sight.bounds().astype(np.float32)
        interval = positive_number("sample_time", sample_time)
        self._stepper = Stepper(scene, sample_time=interval, substeps=substeps, position_stops=not turns.all())
        self._last = max(1, round(positive_number("time_limit", time_limit) / interval))  # step of an episode
        self.observation_space, self.action_space = Box(-bounds, bounds), Box(-1.0, 1.0, (robot.n,))
        self._place(1)

    def _place(self, count: int) -> None:
        """Place a number of arms side by side, each in the middle of its starts."""
        q, self._goal = (np.tile(half, (count, 1)) for half in np.split((self._low + self._high) / 2, 2))
        self._x, self._steps = self._stepper.start(q, np.zeros_like(q)), np.zeros(count, dtype=int)

    def _begin(self, rows: Array, generators: Sequence[np.random.Generator]) -> None:
        """Begin new episodes of some arms, each drawn by its own generator."""
        if not len(rows):
            return
        drawn = np.array([g.random(len(self._low)) for g in generators])
        q, self._goal[rows] = np.split(self._low + drawn * (self._high - self._low), 2, axis=1)
        self._x[rows], self._steps[rows] = self._stepper.start(q, np.zeros_like(q)), 0

    def _look(self, action: Array) -> tuple[Array, Array, Array, Array]:
        """Observations, distances or heights, rewards, and the mask of joints that are too fast."""
        n = self._robot.n
        q, qd = self._x[:, :n], self._x[:, self._moving : self._moving + n]
        seen = self._sight(q, qd, self._goal, action)
        return seen[:, :-3].astype(np.float32), seen[:, -3].copy(), seen[:, -2].copy(), seen[:, -1] > 1

    def _advance(self, action: Array, new: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Advance all but `new` by one interval: results of `_look`, and the mask of arms whose time is over."""
        action, started = np.clip(action.astype(np.float64), -1, 1), self._x[new]
        x, torques = self._x, action * self._effort
        if len(x) > 1 or self._robot.engine == "numba":
            self._stepper.into(x, torques, x)
        else:  # with NumPy a single state would have other last digits
            self._x = self._stepper(np.repeat(x, 2, axis=0), np.repeat(torques, 2, axis=0))[:1]
        self._steps += 1
        self._x[new], self._steps[new] = started, 0
        return *self._look(action), self._steps >= self._last

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin an episode; a seed starts the random numbers anew."""
        super().reset(seed=seed)
        self._begin(np.arange(1), [self.np_random])
        observations, measures, *_ = self._look(np.zeros((1, self._robot.n)))
        return observations[0], {self._told: float(measures[0])}

    def step(self, action: ArrayLike) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold torques for one interval; returns observation, reward, terminated, truncated, info."""
        given = real_array("action", action, f"({self._robot.n},)")[None]
        observation, measure, reward, fast, over = (x[0] for x in self._advance(given, np.arange(0)))
        return observation, float(reward), bool(fast), bool(over), {self._told: float(measure)}


class ArmVectorEnv(VectorEnv[Array, Array, Array]):
    """Arms side by side in one batch, equal, bit for bit, to a SyncVectorEnv of as many `ArmEnv`.

    Parameters
    ----------
    num_envs : int
        Number of arms; each has separate random numbers.
    scene : Scene or Robot
        As `ArmEnv` takes it.
    task : {"reach", "swing-up"}
        What is rewarded.
    autoreset_mode : {"NextStep", "SameStep"} or gymnasium.vector.AutoresetMode
        Whether the step after an episode's last one begins a new one, without a reward, or that step does itself.
    **options
        Further arguments of `ArmEnv`.

    Raises
    ------
    ValueError, TypeError
        As `ArmEnv` does; if `num_envs` is no whole number above zero, or there is no such mode.

    Notes
    -----
    All arms have the numbers of the scene, and one thread steps them. `rne.Stepper` takes other masses, friction or
    payloads for each arm, by `numbers`, and several threads, by `workers`.

    Examples
    --------
    >>> import numpy as np, rne
    >>> scene = rne.Scene(rne.load("irb140"), armature=0.5, effort_limit=50.0)
    >>> arms = rne.environments.ArmVectorEnv(100, scene, link="tool0")
    >>> observations, infos = arms.reset(seed=0)
    >>> observations.shape, arms.step(np.zeros((100, 6)))[1].shape
    ((100, 15), (100,))
    """

    def __init__(
        self,
        num_envs: int,
        scene: Scene | Robot,
        task: str = "reach",
        *,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        mode = getattr(autoreset_mode, "value", autoreset_mode)
        if mode not in ("NextStep", "SameStep"):
            raise ValueError(f"`autoreset_mode` must be 'NextStep' or 'SameStep', got {mode!r}")
        self._arms, self.num_envs = ArmEnv(scene, task, **options), whole_number("num_envs", num_envs)
        self._arms._place(num_envs)
        self.metadata = self._arms.metadata | {"autoreset_mode": AutoresetMode(mode)}
        self.single_observation_space = self._arms.observation_space
        self.single_action_space = self._arms.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators = [np_random()[0] for _ in range(num_envs)]
        self._ended = np.zeros(num_envs, dtype=bool)

    def _begin(self, rows: Array) -> None:
        self._arms._begin(rows, [self._generators[k] for k in rows])

    def _info(self, measures: Array, of: Array) -> dict[str, Any]:
        """Information on some arms, in the form of gymnasium's vectors."""
        return {self._arms._told: np.where(of, measures, 0.0), f"_{self._arms._told}": of.copy()}

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode of each arm; seeds are one for each, or seed, seed + 1, ..."""
        count = self.num_envs
        seeds: list[int | None] = [None] * count
        if isinstance(seed, Sequence | np.ndarray):
            seeds = list(seed)
        elif seed is not None:
            seeds = [whole_number("seed", seed, least=0) + k for k in range(count)]
        if len(seeds) != count:
            raise ValueError(f"`seed` must be one number or {count}, got {len(seeds)}")
        before = self._generators
        self._generators = [g if s is None else np_random(s)[0] for g, s in zip(before, seeds, strict=True)]
        self._ended[:] = False
        self._begin(np.arange(count))
        observations, measures, *_ = self._arms._look(np.zeros(self.action_space.shape or ()))
        return observations, self._info(measures, ~self._ended)

    def step(self, actions: ArrayLike) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Hold torques for one interval, and begin new episodes where some have ended."""
        arms, is_next = self._arms, self.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
        given = real_array("actions", actions, f"({self.num_envs}, {arms._robot.n})")
        new = np.flatnonzero(self._ended) if is_next else np.arange(0)
        self._begin(new)
        observations, measures, rewards, fast, over = arms._advance(given, new)
        fast[new], over[new], rewards[new] = False, False, 0.0
        self._ended, everyone, infos = fast | over, np.ones(self.num_envs, dtype=bool), {}
        ended = np.flatnonzero(self._ended)
        if len(ended) and not is_next:
            last = np.full(self.num_envs, None, dtype=object)
            for k in ended:
                last[k] = observations[k].copy()
            of = {"_final_obs": self._ended.copy(), "_final_info": self._ended.copy()}
            infos = {"final_obs": last, "final_info": self._info(measures, self._ended), **of}
            self._begin(ended)
            now, at_start, *_ = arms._look(np.zeros_like(given))
            observations[ended], measures[ended] = now[ended], at_start[ended]
        return observations, rewards, fast, over, infos | self._info(measures, everyone)

    def close(self, **kwargs: Any) -> None:
        """Close the environment; no resources are held."""
        self.closed = True


def _limits(robot: Robot, kind: str, limit: Array) -> Array:
    """Largest torques or speeds; an error for joints without."""
    cures = {"effort": "rne.Scene(..., effort_limit=...)", "speed": "`speed_limit`"}
    for name, value in zip(robot.joint_names, limit.tolist(), strict=True):
        if not 0 < value < UNBOUNDED:
            raise ValueError(
                f"joint {name!r} must have a finite {kind} limit above 0, got {value:g}: give {cures[kind]}"
            )
    return limit


def _ends(robot: Robot, name: str, given: ArrayLike) -> Array:
    """Smallest and largest positions of a draw, within the joints' ranges, shape (2, n)."""
    array = real_array(name, given, f"(2, {robot.n})" if np.ndim(given) == 2 else f"({robot.n},)")
    low, high = ends = np.broadcast_to(array, (2, robot.n))
    wrong = (low > high) | (low < robot.lower) | (high > robot.upper)
    if wrong.any():
        k = int(wrong.argmax())
        got = f"got {low[k]:g} to {high[k]:g} of {robot.joint_names[k]!r}"
        raise ValueError(f"`{name}` must be within the joints' ranges, the lowest positions first, {got}")
    return ends


def _up(robot: Robot, link: int | None, goal: Array) -> Array:
    """Vector against gravity, over the height of a link at the goal."""
    if link is None:
        raise ValueError("`link` must be given for 'swing-up': the one whose height counts")
    height = -robot.link_poses(goal)[link, :3, 3] @ robot.model.gravity
    if not height > 0:
        raise ValueError("`goal` must be joint positions that hold `link` above the root link")
    return np.asarray(-robot.model.gravity / height)


gymnasium.register("rne/Arm-v0", "rne.environments:ArmEnv", vector_entry_point="rne.environments:ArmVectorEnv")
