r"""
LQR from a linearisation
========================

Two rods stand upright on a cart, one on top of the other, and only the cart is driven.
We design a linear-quadratic regulator (LQR) from the exact linearisation of the robot.
Then we try it on the nonlinear robot: after a small push, after larger ones, and up to
the push from which it does not recover.

Needs: ``pip install '.[plot]'``
"""

import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import expm, solve_continuous_are

import rne

# %%
# The robot
# ---------
# It is a chain of a prismatic joint along x and two revolute joints about y. All frames
# are parallel at q = 0, where the rods stand upright.

lengths = np.array([0.0, 0.5, 0.4])  # cart, rods [m]
masses = np.array([1.0, 0.3, 0.2])  # [kg]
x, y, z = np.eye(3)
model = rne.model.chain(
    rotations=[np.eye(3)] * 3,
    positions=lengths[:, None] * z,
    masses=masses,
    centres=lengths[:, None] * z / 2,
    inertias=[
        rne.model.cylinder_inertia(m, 0.01, l, "z") for m, l in zip(masses, lengths)
    ],
    axes=[x, y, y],
    types=["prismatic", "revolute", "revolute"],
    name="cart with two rods",
    joint_names=["cart", "lower", "upper"],
)
robot = rne.Robot(model)
print(robot)

# %%
# The regulator
# -------------
# ``linearize`` returns A and B of :math:`\dot x = A x + B \tau` for small changes of
# the state x = (q, qd). The derivatives are exact; no differences are taken. At the
# upright rest the torques are zero, and the force on the cart is the first column of B.
# The open loop has poles with positive real parts: the rods fall.

A, B = robot.linearize(np.zeros(3), np.zeros(3), np.zeros(3))
B = B[:, :1]
Q = np.diag([10.0, 10.0, 10.0, 1.0, 1.0, 1.0])  # weights of the squares of q and qd
R = np.array([[0.1]])  # weight of the squared force
P = solve_continuous_are(A, B, Q, R)
K = np.linalg.solve(R, B.T @ P)  # the force is -K x
for name, matrix in (("open", A), ("closed", A - B @ K)):
    poles = np.sort_complex(np.linalg.eigvals(matrix)) + 0
    print(f"{name:6} loop: poles [1/s]", *(f"{pole:.2f}" for pole in poles))
assert np.linalg.eigvals(A).real.max() > 0 > np.linalg.eigvals(A - B @ K).real.max()


@rne.traceable
def lqr(t, q, qd):
    force = -(K[0, :3] @ q + K[0, 3:] @ qd)
    return force * np.array([1.0, 0.0, 0.0])  # the rods' joints are not driven


drives = [50.0, 0.0, 0.0]  # largest force of the cart's drive [N]; free hinges
scene = rne.Scene(robot, controller=lqr, effort_limit=drives)

# %%
# A push
# ------
# A tap on the upper rod gives it a velocity at once. The cart first moves back, which
# tips the rods forward. Then it runs under them and stops.

duration, tap = 4.0, np.array([0.0, 0.0, 1.0])  # [s], [rad/s]
t = np.linspace(0, duration, 401)
motion = rne.simulate(scene, np.zeros(3), 2 * tap, duration, t_eval=t)
joints = robot.link_poses(motion.q)[
    :, 1:, :3, 3
]  # cart, lower hinge, upper hinge, upper end

figure = Figure(figsize=(9, 5.4), layout="constrained")
shown = [0.0, 0.1, 0.2, 0.4, 0.7, 1.5]  # [s]
axes = figure.subplot_mosaic([shown, ["curves"] * len(shown)])
curves = axes.pop("curves")
for instant, ax in axes.items():
    k = np.searchsorted(t, instant)
    ax.plot(*joints[: k + 1, 3, ::2].T, color="0.8")  # way of the upper end
    ax.plot(*joints[k, 1:, ::2].T, "o-", linewidth=2.5, markersize=5)
    ax.plot(joints[k, 0, 0], 0, "s", color="black", markersize=11)
    ax.set(
        title=f"{instant} s",
        aspect="equal",
        xlim=(-0.35, 0.75),
        ylim=(-0.1, 1.1),
        xlabel="x [m]",
        yticks=[],
    )
axes[0.0].set(ylabel="z [m]", yticks=[0, 0.5, 1])
curves.plot(
    t,
    motion.q,
    label=["cart [m]", "lower rod [rad]", "upper rod, relative to the lower one [rad]"],
)
curves.set(xlabel="time [s]", ylabel="position [m or rad]")
curves.legend(frameon=False)
figure

# %%
# Small motions are linear
# ------------------------
# For a state near the upright one the design predicts :math:`x(t) = e^{(A - BK)t} x_0`.
# The robot is symmetric to left and right, so the nonlinear motion differs from this by
# terms of third order: a tenth of the push leaves about a thousandth of the difference.

for size in (0.1, 0.01):
    pushed = rne.simulate(scene, np.zeros(3), size * tap, 1.0, rtol=1e-10, atol=1e-13)
    linear = expm((A - B @ K) * 1.0) @ np.concatenate([np.zeros(3), size * tap])
    difference = abs(pushed.q[-1] - linear[:3]).max()
    print(f"tap of {size} rad/s: linear and nonlinear differ by {difference:.1e}")
    assert difference < 5 * size**3

# %%
# How large a push?
# -----------------
# ``ensemble`` simulates all initial states at once. The robot has recovered from a push
# if all joints are at rest at the end.

sizes = np.linspace(0.1, 6, 60)
starts = np.zeros((60, 3))
pushed = rne.ensemble(scene, starts, sizes[:, None] * tap, 6.0, step=5e-3)
remaining = abs(pushed.q[-1]).max(axis=1) + abs(pushed.qd[-1]).max(axis=1)
recovered = remaining < 0.05
largest, failed = sizes[recovered].max(), sizes[~recovered].min()
print(f"recovers from taps up to {largest:.1f} rad/s, not from {failed:.1f} rad/s")
assert largest < failed
