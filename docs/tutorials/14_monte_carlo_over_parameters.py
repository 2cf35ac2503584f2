r"""
Monte Carlo over parameters
===========================

You know the masses, centres of mass and inertias of an arm to some percent. How
uncertain are then the torques of a motion? And the motion itself, under a controller
that uses the nominal values? Inertial parameters are an input of every quantity, so
thousands of variants of a robot are one batch.

Needs: ``pip install '.[plot]'``
"""

import numpy as np
from matplotlib.figure import Figure

import rne

robot = rne.load("irb140")
rng = np.random.default_rng(0)

# %%
# Variants of a robot
# -------------------
# ``robot.parameters`` are ten numbers per body: mass, first moment and inertia. If you
# scale the density of a body, all ten are scaled by the same factor, and it remains a
# possible body. Here each body weighs 5 % more or less (one standard deviation).

count = 4000
density = 1 + 0.05 * rng.standard_normal((count, robot.model.nb))
variants = (density[:, :, None] * robot.parameters.reshape(-1, 10)).reshape(count, -1)
print(variants.shape)

# %%
# Torques of a motion
# -------------------
# The arm swings from rest to rest in 0.8 s. Parameters broadcast against states: 81
# states times 4000 variants in one call. The band holds 95 % of the variants.

path = rne.trajectories.quintic([0] * 6, [1.0, 0.8, -0.6, 1.0, -0.5, 1.5], 0.8)
t = np.linspace(0, 0.8, 81)
q, qd, qdd = (x[:, None] for x in path(t))
torques = robot.inverse_dynamics(q, qd, qdd, parameters=variants)  # times, variants
low, high = np.quantile(torques, [0.025, 0.975], axis=1)
nominal = robot.inverse_dynamics(*path(t))

figure = Figure(figsize=(8, 5), layout="constrained")
for k, ax in enumerate(figure.subplots(2, 3, sharex=True).flat):
    ax.fill_between(t, low[:, k], high[:, k], color="C0", alpha=0.3, linewidth=0)
    ax.plot(t, nominal[:, k])
    ax.set_title(robot.joint_names[k], fontsize="medium")
    ax.grid(alpha=0.3)
figure.supxlabel("time [s]")
figure.supylabel("torque [N m]")
figure

# %%
# Which body matters
# ------------------
# Torques are linear in the parameters, :math:`\tau = Y \pi`, so you need no sampling to
# find the share of each body in the variance. Here it is at the largest torque of joint
# 2:

worst = abs(nominal[:, 1]).argmax()
Y = robot.regressor(*(x[worst] for x in path(t)))[1].reshape(-1, 10)
by_body = (Y * robot.parameters.reshape(-1, 10)).sum(axis=1)  # torque due to each body
share = by_body**2 / (by_body**2).sum()
spread = torques[worst, :, 1].std()
predicted = 0.05 * np.sqrt((by_body**2).sum())
for name, part in zip(robot.model.moving_joints, share):
    print(f"body of {name}: {100 * part:4.1f} %")
print(
    f"standard deviation {spread:.2f} N m sampled, {predicted:.2f} N m by the regressor"
)
assert abs(spread / predicted - 1) < 0.05

# %%
# Motions under a controller
# --------------------------
# A computed-torque controller with the nominal model moves 200 of the variants. The
# controller keeps the parameters that it was created with, and only the arm varies. All
# 200 motions are one ensemble.

law = rne.control.computed_torque(robot, [100] * 6, [20] * 6, path)
scene = rne.Scene(robot, controller=law)
start = np.zeros((200, 6))
runs = rne.ensemble(
    scene,
    start,
    start,
    1.2,
    step=0.002,
    keep=61,
    parameters=variants[: len(start)],
)
error = runs.q[-1] - path(1.2)[0]  # motions, joints
spread = error.std(axis=0)
print("left of the swing after 0.4 s at rest [mrad], rms:", (1e3 * spread).round(2))

figure = rne.plotting.quantile_plot(runs, of="tau")

# %%
# The error after the motion is the difference of the weights divided by the
# controller's stiffness, as computed torque has no integral part. By linearity again,
# :math:`M^{-1} \Delta g = K_p e` at rest:

end = path(1.2)[0]
weights = robot.gravity_torque(end, parameters=variants[:200])
believed = robot.gravity_torque(end)
unknown = believed - weights  # [N m]
settled = np.linalg.solve(robot.mass_matrix(end), unknown[..., None])[..., 0] / 100
print("expected at rest [mrad], rms:", (1e3 * settled.std(axis=0)).round(2))
assert np.allclose(spread[[1, 2, 4]], settled.std(axis=0)[[1, 2, 4]], rtol=0.1)
