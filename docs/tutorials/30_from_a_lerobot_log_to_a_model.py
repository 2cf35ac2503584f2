r"""
From a LeRobot log to a model
=============================

A data set of LeRobot has commands and positions of a hobby-servo arm, and no torques.
That is enough to find the servos' gains, their torque limits, friction and rotors, and
the delay of the commands: ``rne.identify_motion`` simulates the arm with its servos,
and finds the numbers for which the simulated positions fit the recorded ones.

Needs: ``pip install '.[plot,robots,numba,lerobot]'``
"""

import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet
from matplotlib.figure import Figure

import rne

# %%
# The initial model
# -----------------
# Bodies are those of the CAD model. The wrist and the gripper are locked. The servos
# start from published figures: nominal torques and speeds of the data sheet, rotors and
# friction from published pendulum experiments.

still = {"wrist_flex": 0.0, "wrist_roll": 0.0, "gripper": 0.5}  # [rad]
arm = rne.load("so101", engine="numba").locked(still)
figures = rne.control.servo_figures("sts3215-12v")
friction = rne.Friction(figures.viscous, figures.coulomb, smoothing=0.05)
known = rne.Scene(
    arm,
    controller=figures.law(arm, p=16),  # the gain that LeRobot sets
    friction=friction,
    armature=figures.armature,
    effort_limit=np.inf,
)

# %%
# The recording
# -------------
# Instead of a real arm we simulate one. Its servos differ from the figures and from
# each other, and its commands act 8 ms after their time stamps. Two episodes of 12 s,
# 30 commands per second: steps all over the range, then swings. The steps are large, so
# that servos reach their torque limits; the swings are slow, so that gravity dominates.

rng = np.random.default_rng(1)
n, delay, rate = arm.n, 0.008, 30


def varied(number):
    return number * rng.uniform(0.7, 1.4, n)


plain = rne.Robot(arm.model)  # by NumPy: single motions are not worth compiling
servos = replace(
    figures.law(plain),
    kp=varied(figures.law(plain).kp),
    stall_torque=varied(1.3 * figures.stall_torque),
)
true = rne.Scene(
    plain,
    controller=servos,
    friction=rne.Friction(
        varied(figures.viscous), varied(figures.coulomb), smoothing=0.05
    ),
    armature=varied(figures.armature),
    effort_limit=np.inf,
)
t = np.arange(0, 12, 1 / rate)
middle, half = (arm.upper + arm.lower) / 2, (arm.upper - arm.lower) / 2


def episode():
    """Commands and positions in degrees, positions by encoders of 4096 steps a turn."""
    levels = rng.uniform(-0.5, 0.5, (6, n)) + np.zeros((rate, 1, 1))
    steps = levels.swapaxes(0, 1).reshape(-1, n)
    w = 2 * np.pi * rng.uniform(0.15, 0.6, n)
    swings = 0.5 * np.sin((t[t >= 6] - 6)[:, None] * w + np.arange(n))
    command = middle + half * np.concatenate([steps, swings])
    late = np.concatenate([[0.0], t[1:] + delay])
    reference = rne.trajectories.sampled(late, command, kind="hold")
    scene = replace(true, controller=replace(servos, reference=reference))
    run = rne.simulate(scene, command[0], np.zeros(n), t[-1], t_eval=t)
    counts = np.round(run.q * 4096 / (2 * np.pi))
    return np.rad2deg(command), counts * 360 / 4096


episodes = [episode() for _ in range(2)]

# %%
# The data set has LeRobot's format: a table with a list of positions and one of
# commands per row, in degrees except for the gripper, which is in percent of its range.

folder = Path(tempfile.mkdtemp())
names = [f"{name}.pos" for name in (*arm.joint_names, *still)]
features = {
    key: {"dtype": "float32", "shape": [6], "names": names}
    for key in ("action", "observation.state")
}
info = {"codebase_version": "v3.0", "robot_type": "so101_follower", "fps": rate}
(folder / "meta").mkdir()
(folder / "meta" / "info.json").write_text(json.dumps(info | {"features": features}))
columns = {"action": [], "observation.state": [], "timestamp": [], "episode_index": []}
for k, (command, state) in enumerate(episodes):
    for name, x in (("action", command), ("observation.state", state)):
        columns[name] += np.column_stack([x, 0 * t, 0 * t, 0 * t + 30]).tolist()
    columns["timestamp"] += t.tolist()
    columns["episode_index"] += [k] * len(t)
data = folder / "data" / "chunk-000"
data.mkdir(parents=True)
pyarrow.parquet.write_table(pyarrow.table(columns), data / "file-000.parquet")

# %%
# Read it
# -------
# ``action`` is the command, ``observation.state`` the position. Joints are found by
# name; those that do not move are left out. For other formats, pass arrays: ``Record(t,
# q, command=command)``.

records = [
    rne.identification.Record.from_log(
        folder, episode=k, joints=arm.joint_names, units={"q": "deg"}
    )
    for k in range(2)
]
print(records[0])
print("one encoder step:", (1e3 * records[0].encoder_step).round(2), "mrad")

# %%
# Fit
# ---
# The first episode is fitted. The masses are not fitted: they fix the scale, since the
# motion does not change if masses, gains, friction and rotors are all doubled. The
# no-load speed is not fitted either, because it acts like viscous friction.

wrt = ["controller.kp", "controller.stall_torque", "friction.viscous"]
wrt += ["friction.coulomb", "armature", "command.delay"]
found = rne.identify_motion(known, records[0], wrt)
print(found.report())

# %%
# The residual is the rounding of the encoders. Here the true numbers are known: every
# estimate is within four standard errors of them.

truth = np.concatenate([true.numbers[name] for name in wrt[:-1]] + [np.array([delay])])
errors = (found.values - truth) / found.std
print("errors in standard errors:", np.sort(abs(errors))[-3:].round(1), "at most")
assert abs(errors).max() < 4
assert (found.rms < found.resolution * 1.1).all()

# %%
# The other episode
# -----------------
# Validate a model with a motion that was not fitted. From the commands the fitted model
# predicts each position to less than an encoder step. With the published figures the
# errors are a few degrees while the arm moves.

other = records[1]
at = np.concatenate([[0.0], other.t[1:] + delay])
reference = rne.trajectories.sampled(at, other.command, kind="hold")
law = replace(figures.law(plain), reference=reference)
run = rne.simulate(
    replace(known, robot=plain, controller=law),
    other.q[0],
    np.zeros(n),
    other.t[-1],
    t_eval=other.t,
)
predicted = {"published figures": run.q, "fitted": found.predict(other)}
for name, q in predicted.items():
    error = np.rad2deg(np.sqrt(((q - other.q) ** 2).mean(axis=0)))
    print(f"{name}: error rms", error.round(3), "degrees")
assert np.rad2deg(np.sqrt(((predicted["fitted"] - other.q) ** 2).mean())) < 0.05

figure = Figure(figsize=(8, 5), layout="constrained")
grid = figure.subplots(2, 2, sharex=True, sharey="row")
for k, column in zip((1, 2), grid.T):
    above, below = column
    above.plot(other.t, np.rad2deg(other.command[:, k]), "0.8", label="command")
    above.plot(other.t, np.rad2deg(other.q[:, k]), label="measured")
    above.set_title(arm.joint_names[k], fontsize="medium")
    for name, q in predicted.items():
        below.plot(other.t, np.rad2deg(q - other.q)[:, k], label=name)
    below.set_xlabel("time [s]")
grid[0, 0].set_ylabel("position [°]")
grid[1, 0].set_ylabel("prediction - measured [°]")
grid[0, 1].legend(frameon=False)
grid[1, 1].legend(frameon=False)
figure

# %%
# What a log does not show
# ------------------------
# Demonstrations have no large steps. In the swings no servo reaches its limit. There
# the stall torque acts only through the back EMF, the stall torque divided by the
# no-load speed, which is the same as viscous friction. The report lists numbers with
# the same effect, and what to do. The others are found as before, with larger errors.

swings = rne.identify_motion(known, records[0].between(6, 12), wrt, starts=1)
print(swings.verdict)
for text in swings.alike:
    print(" ", text)
undetermined = {swings.names[k] for k in np.flatnonzero(~swings.determined)}
assert "controller.stall_torque of elbow_flex" in undetermined
known_errors = abs((swings.values - truth) / swings.std)[swings.determined]
print(
    "errors of the others in standard errors:", known_errors.max().round(1), "at most"
)
assert known_errors.max() < 4

# %%
# Use it
# ------
# ``found.scene()`` is the arm with its servos, for simulation, tuning or learning;
# ``found.to_urdf()`` the robot with its friction; ``found.save("so101.npz")`` keeps all
# of it. On your own arm, read the report from its top: a residual well above the
# encoder's step means that the model lacks an effect, which the standard errors do not
# cover. The guide "Identify without torques" lists which motions determine which
# number.

scene = found.scene()
law = replace(scene.controller, robot=plain, reference=middle + 0.3 * half)
scene = replace(scene, robot=plain, controller=law)
motion = rne.simulate(scene, middle, np.zeros(n), 1.5)
lag = np.rad2deg(motion.q[-1] - law.reference)
print("after 1.5 s the arm is off by", lag.round(2), "degrees: torque / kp")
assert abs(lag[1:3]).max() > 0.5
