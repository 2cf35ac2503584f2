r"""
Sensitivities of a motion to masses and friction
================================================

An arm moves under PD control, and its masses and friction are known to a few percent.
How much does its motion change with each of them, and when? ``rne.sensitivities``
computes the derivatives of a motion together with it. The last part shows which of them
grow, and when a derivative is no longer useful.

Needs: ``pip install '.[plot]'``
"""

import numpy as np
from matplotlib.figure import Figure

import rne

robot = rne.load("irb140").with_armature([2, 2, 1, 0.2, 0.2, 0.1])
friction = rne.Friction(
    viscous=[10, 10, 5, 0.5, 0.5, 0.2],
    coulomb=[4, 6, 4, 0.5, 0.5, 0.1],
    smoothing=0.1,
)
path = rne.trajectories.quintic([0] * 6, [1.0, 0.8, -0.6, 1.0, -0.5, 1.5], 0.8)
gains = [400, 400, 200, 40, 40, 20], [60, 60, 30, 6, 6, 3]
law = rne.control.pd_gravity(robot, *gains, path)
scene = rne.Scene(robot, controller=law, friction=friction)
rest, t = np.zeros(6), np.linspace(0, 1.2, 121)

# %%
# One run
# -------
# Derivatives have the names of ``scene.numbers``, with an axis of joints and one of the
# number's entries: 72 columns in one run.

names = ["parameters", "friction.viscous", "friction.coulomb"]
found = rne.sensitivities(scene, rest, rest, 1.2, wrt=names, t_eval=t)
print(found)
print({name: slopes.shape for name, slopes in found.dq.items()})
figure = found.plot("friction.viscous", joints=["joint_2", "joint_4"])
figure

# %%
# Which body matters
# ------------------
# The ten parameters of a body grow with its density. So the products of derivatives and
# parameters, summed over a body, are the change of the motion when this body gets
# denser by 100 %. The controller compensates the gravity of the nominal masses only:
# joint 2 is pulled down where the arm is stretched out.

bodies = robot.parameters.reshape(-1, 10)
by_density = (found.dq["parameters"].reshape(len(t), 6, -1, 10) * bodies).sum(-1)
by_viscous = found.dq["friction.viscous"] * friction.viscous
by_coulomb = found.dq["friction.coulomb"] * friction.coulomb

figure = Figure(figsize=(8, 5.4), layout="constrained")
panels = figure.subplots(2, 2, sharex=True)
for ax, k in zip(panels[0], (1, 2)):
    ax.plot(t, 10 * by_density[:, k], label=robot.model.moving_joints)
    ax.set_title(f"{robot.joint_names[k]}, body denser by 1 %", fontsize="medium")
for ax, k in zip(panels[1], (1, 2)):
    ax.plot(t, 10 * by_viscous[:, k, k], label="viscous")
    ax.plot(t, 10 * by_coulomb[:, k, k], label="Coulomb")
    ax.set_title(f"{robot.joint_names[k]}, its friction 1 % more", fontsize="medium")
for ax in panels.flat:
    ax.grid(alpha=0.3)
panels[0, 0].legend(title="body behind", fontsize="small", frameon=False)
panels[1, 0].legend(fontsize="small", frameon=False)
figure.supxlabel("time [s]")
figure.supylabel("change of the position [mrad]")
figure

# %%
# A band without sampling
# -----------------------
# Each body may be 5 % denser or lighter, one standard deviation. To first order the
# variance of the motion is a sum of squares. 300 runs of the same scene confirm it; for
# each of them the error of the prediction is of second order.

rng = np.random.default_rng(0)
share = 0.05 * rng.standard_normal((300, len(bodies)))
variants = ((1 + share)[:, :, None] * bodies).reshape(300, -1)
start = np.zeros((300, 6))
runs = rne.ensemble(
    scene, start, start, 1.2, numbers={"parameters": variants}, t_eval=t, step=0.002
)
predicted = found.q[:, None] + np.einsum("tkb,nb->tnk", by_density, share)
spread = 0.05 * np.sqrt((by_density**2).sum(-1))
moved, missed = abs(runs.q - found.q[:, None]), abs(runs.q - predicted)
print(f"spread at the end, joint 2: {1e3 * spread[-1, 1]:.2f} mrad")
print(f"of 300 runs: {1e3 * runs.q[-1, :, 1].std():.2f} mrad")
print(f"largest change {1e3 * moved.max():.1f} mrad, of which the prediction misses")
print(f"{1e3 * missed.max():.2f} mrad at most")
assert missed.max() < 0.05 * moved.max()
assert abs(runs.q[-1, :, 1].std() / spread[-1, 1] - 1) < 0.15

# %%
# Derivatives that grow
# ---------------------
# Derivatives of the motion with respect to the initial position of joint 2 are compared
# with motions that start 1 mrad apart. Under control they decay: whatever the start
# was, the arm reaches its reference. With friction alone the arm falls, swings and
# comes to rest. The free arm is chaotic: its derivatives grow without end, by a factor
# of e each 1 to 2 s.

scenes = {
    "free": rne.Scene(robot),
    "friction": rne.Scene(robot, friction=friction),
    "PD control and friction": scene,
}
T, begin, offset = np.linspace(0, 10, 201), np.full(6, 0.1), 1e-3
figure = Figure(figsize=(8, 4), layout="constrained")
ax = figure.subplots()
size = {}
for name, one in scenes.items():
    slopes = rne.sensitivities(one, begin, rest, T[-1], wrt="q0", t_eval=T)
    size[name] = np.linalg.norm(slopes.dq["q0"][:, :, 1], axis=1)
    (line,) = ax.plot(T, size[name], label=name)
    starts = begin, begin + offset * np.eye(6)[1]
    runs = [rne.simulate(one, q0, rest, T[-1], t_eval=T, rtol=1e-10) for q0 in starts]
    change = np.linalg.norm(runs[1].q - runs[0].q, axis=1) / offset
    ax.plot(T, change, ":", color=line.get_color())
ax.plot([], [], ":", color="0.5", label="motion from 1 mrad beside, over 1 mrad")
ax.axhline(1 / offset, color="0.7", linewidth=0.8)
ax.text(0.1, 1.3 / offset, "1 mrad has become 1 rad", color="0.4", fontsize="small")
ax.set(
    yscale="log",
    ylim=(1e-6, 1e5),
    xlabel="time [s]",
    ylabel="change of all positions over\nthat of joint 2 at the start [1]",
)
ax.legend(frameon=False, fontsize="small", loc="lower right")
ax.grid(alpha=0.3)
figure

# %%
# Above the grey line the prediction fails: the two motions are no longer close to each
# other. The derivative is exact, but useless. For the same reason a gradient over a
# long free motion is of no use to an optimiser, whichever method computed it. Use
# several shorter motions, or a scene with a controller or friction.

rate = np.polyfit(T[40:], np.log(size["free"][40:]), 1)[0]
print(f"the free arm's derivatives grow by a factor of e each {1 / rate:.2f} s")
assert size["free"][-1] > 1000 > 50 > size["friction"].max()
assert size["PD control and friction"][-1] < 1e-6

# %%
# What else to know
# -----------------
# - Derivatives are those of the steps as they were taken, exact up to rounding, and as
#   far from those of the true motion as the tolerances allow.
# - At a limit of a drive, and at a kink of a law, they are those of one side;
#   ``found.message`` says when limits were reached.
# - Friction that sticks and stops are refused: they need events, at which derivatives
#   jump. A ``smoothing`` of friction makes the motion smooth; the smaller it is, the
#   shorter the steps.
# - For one number and many derivatives ``rne.motion_gradient`` takes less time.
