r"""
An environment for learning
===========================

Two links of 1 m and 1 kg hang from a shoulder whose drive cannot lift them: it has 10 N
m, and 19.6 N m are needed. A small network learns to swing them up and to balance them,
with NumPy only, from hundreds of arms that are simulated at once. Their environment is
a gymnasium environment, so that a library for reinforcement learning can replace the
last part.

Needs: ``pip install '.[plot,numba,gymnasium]'``
"""

from time import process_time

import numpy as np
from matplotlib.figure import Figure

import rne

# %%
# The arm
# -------
# It stands upright at q = 0, and gravity points along -x. An action is a share of the
# largest torques, so the drives need limits.

rods = {"centres": [[-0.5, 0, 0]] * 2, "inertias": [[0, 1 / 12, 1 / 12]] * 2}
model = rne.dh_chain(
    **{"a": [1, 1], "alpha": [0, 0], "d": [0, 0], "theta": [0, 0]},
    **rods,
    masses=[1, 1],
    types="continuous",
    effort=[10, 5],
    gravity=[-9.81, 0, 0],
)
arm = rne.Robot(model, engine="numba")
print("stretched out sideways:", arm.gravity_torque([np.pi / 2, 0]).round(2), "N m")

# %%
# The environment
# ---------------
# An episode begins at rest, near hanging, and lasts 6 s. The tool's height is 1 where
# the arm stands upright. The episode of an arm that exceeds the speed limit ends there.

task = {
    "task": "swing-up",
    "link": "tool0",
    "goal": [0, 0],
    "start": [[np.pi - 0.5, -0.5], [np.pi + 0.5, 0.5]],
    "speed_limit": 12.0,
    "sample_time": 0.05,
    "time_limit": 6.0,
}
env = rne.environments.ArmEnv(arm, **task)
observation, info = env.reset(seed=0)
print("sines, cosines, speeds:", observation.round(2), info)
observation, reward, terminated, truncated, info = env.step([1.0, 0.0])
print(f"after 50 ms: {observation.round(2)}, reward {reward:.3f}")

# %%
# A policy
# --------
# One hidden layer of 16, from the six numbers observed to the two torques. It is
# written for many networks at once, each of which controls the same number of arms.

shapes = [(6, 16), (1, 16), (16, 2), (1, 2)]
size = sum(rows * columns for rows, columns in shapes)
splits = np.cumsum([rows * columns for rows, columns in shapes])[:-1]


def policy(weights, observed):
    """Actions of arms under networks with weights of shape (networks, size)."""
    parts = np.split(weights, splits, axis=1)
    W, b, V, c = (part.reshape(-1, *shape) for part, shape in zip(parts, shapes))
    hidden = np.tanh(observed.reshape(len(weights), -1, 6) @ W + b)
    return np.tanh(hidden @ V + c).reshape(-1, 2)


def episodes(arms, weights, seeds):
    """Mean rewards of one episode of each arm, and its heights at all steps."""
    observed, _ = arms.reset(seed=seeds)
    rewards, heights, going = [], [], np.ones(arms.num_envs, dtype=bool)
    for _ in range(round(task["time_limit"] / task["sample_time"])):
        observed, reward, too_fast, _, info = arms.step(policy(weights, observed))
        rewards.append(reward * going)
        going &= ~too_fast
        heights.append(np.where(going, info["height"], -1))
    return np.mean(rewards, axis=0), np.array(heights)


# %%
# An evolution strategy
# ---------------------
# Each update tries 32 random directions, forwards and backwards, each from the same four
# starts: 256 arms in one batch. The ranks of the rewards weight the directions (Wierstra
# et al. 2014; Salimans et al. 2017), and Adam (Kingma and Ba 2015) takes the step.


def learn(seed, updates=1200, pairs=32, starts=4, width=0.2, rate=0.1):
    """Weights, and the mean reward of each update."""
    rng, history = np.random.default_rng(seed), []
    arms = rne.environments.ArmVectorEnv(2 * pairs * starts, arm, **task)
    w, m, v = rng.normal(0, 0.3, size), np.zeros(size), np.zeros(size)
    for k in range(updates):
        tried = rng.normal(size=(pairs, size))
        networks = w + width * np.concatenate([tried, -tried])
        seeds = rng.integers(2**31, size=starts).tolist() * (2 * pairs)
        reward = episodes(arms, networks, seeds)[0].reshape(2 * pairs, starts).mean(1)
        rank = reward.argsort().argsort() / (2 * pairs - 1)
        slope = (rank[:pairs] - rank[pairs:]) @ tried / pairs
        m, v = 0.9 * m + 0.1 * slope, 0.99 * v + 0.01 * slope**2
        scale = np.sqrt(1 - 0.99 ** (k + 1)) / (1 - 0.9 ** (k + 1))
        w = w + rate * 0.1 ** (k / updates) * scale * m / (np.sqrt(v) + 1e-8)
        history.append(reward.mean())
    return w, history


def trial(w, count=200):
    """Heights of episodes from new starts, and which of them end balanced."""
    arms = rne.environments.ArmVectorEnv(count, arm, **task)
    heights = episodes(arms, w[None], [10**6 + k for k in range(count)])[1]
    last = heights[-round(1 / task["sample_time"]) :]
    return heights, (last >= 0.85).all(axis=0)


# %%
# Learning
# --------
# A trial is a success if the height stays above 0.85 for all of the last second.

untrained = np.random.default_rng(0).normal(0, 0.3, size)
began = process_time()
w, history = learn(seed=0)
print(f"{len(history)} updates took {process_time() - began:.0f} s of one core")
before, after = trial(untrained), trial(w)
for name, (_, balanced) in {"untrained": before, "learned": after}.items():
    print(f"{name}: {balanced.mean():.1%} of 200 new starts end balanced")
assert not before[1].any()
assert after[1].mean() >= 0.9

# %%
# On the left the mean reward of the 64 networks of each update; on the right 20 of the
# new starts. An episode in which a joint was too fast has the height -1 from there on.

figure = Figure(figsize=(9, 3.6), layout="constrained")
left, right = figure.subplots(1, 2)
left.plot(history, linewidth=0.8)
left.set(xlabel="update", ylabel="mean reward", title="Learning")
t = task["sample_time"] * np.arange(1, len(after[0]) + 1)
right.plot(t, before[0][:, :20], "0.8", linewidth=0.8)
right.plot(t, after[0][:, :20], "C0", linewidth=0.8)
right.axhline(0.85, color="k", linestyle=":", linewidth=1)
right.set(xlabel="time [s]", ylabel="height", title="New starts; untrained: gray")
figure
