r"""
Minimum-torque trajectory
=========================

A Panda moves from one pose to another in a given time. Which of all smooth motions
between the two needs the least torque? We describe the motion by 16 numbers. SciPy's
optimiser finds them with exact first and second derivatives of the cost.

Needs: ``pip install '.[plot,robots]'``
"""

import numpy as np
from matplotlib.figure import Figure
from numpy.polynomial import Legendre, Polynomial
from scipy.optimize import minimize

import rne
from rne.elementwise import maximum

still = ("panda_joint3", "panda_joint5", "panda_joint7", "panda_finger_joint1")
arm = rne.load("panda").locked(dict.fromkeys(still, 0.0))  # its links stay in a plane
limit, fastest = arm.effort_limit, arm.velocity_limit  # [N m], [rad/s]
print(arm.joint_names)

# %%
# The motions
# -----------
# A quintic polynomial is the first guess. We add polynomials that vanish at both ends
# together with their velocities and accelerations: :math:`s^3 (1 - s)^3` times Legendre
# polynomials, with :math:`s = t/T`. Positions, velocities and accelerations are linear
# in the coefficients c, four for each joint.

start = np.array([-0.8, 0.9, -0.9, 1.6])
end = np.array([0.8, 0.6, -1.5, 1.9])
duration, shapes = 1.5, 4  # [s]
t = np.linspace(0, duration, 61)
quintic = rne.trajectories.quintic(start, end, duration)

s = Polynomial([0, 1 / duration])
shape = [
    (s * (1 - s)) ** 3 * 64 * Legendre.basis(k, [0, duration]).convert(kind=Polynomial)
    for k in range(shapes)
]
b, bd, bdd = (np.array([f.deriv(k)(t) for f in shape]).T for k in range(3))


def motion(c):
    return tuple(
        given + part @ c.reshape(shapes, arm.n)
        for given, part in zip(quintic(t), (b, bd, bdd))
    )


# %%
# The cost and its derivatives
# ----------------------------
# The cost is the mean over time of the squared torques, each relative to its drive's
# limit. Penalties are added for positions and velocities beyond 95 % of the joints'
# ranges, and for wrist and hand lower than 0.1 m. We write it for one state, with the
# robot's methods and the functions of ``rne.elementwise``, and mark it as traceable.
# ``rne.kernels.gradient`` and ``hessian`` then give its exact derivatives, which take 2.5
# and 13 times the operations of the cost, and run on all times in one call.

middle = (arm.upper + arm.lower) / 2
half = (arm.upper - arm.lower) / 2
low = [
    arm.link_names.index(name)
    for name in ("panda_link6", "panda_link8", "panda_hand_tcp")
]


def penalty(excess):
    """What exceeds zero, cubed: its second derivative has no jump."""
    return 2000 * (maximum(excess, 0.0) ** 3).sum()


@rne.traceable
def cost_of_state(q, qd, qdd):
    tau = arm.inverse_dynamics(q, qd, qdd)
    ranges = penalty(abs(q - middle) / half - 0.95)
    speeds = penalty(abs(qd) / fastest - 0.95)
    heights = arm.link_poses(q)[low, 2, 3]
    return ((tau / limit) ** 2).sum() + ranges + speeds + penalty(0.1 - heights)


value = rne.compile(cost_of_state, arm.model)
gradient = rne.kernels.gradient(cost_of_state, arm.model)
hessian = rne.kernels.hessian(cost_of_state, arm.model)
print(value, gradient, hessian, sep="\n")

# %%
# Positions, velocities and accelerations are linear in the coefficients, so that the
# chain rule is a product with constant matrices: B of shape (times, 3 n, coefficients).

joints = np.eye(arm.n)
B = np.concatenate(
    [
        np.einsum("ts,ij->tisj", part, joints).reshape(len(t), arm.n, -1)
        for part in (b, bd, bdd)
    ],
    axis=1,
)


def cost(c):
    return value(*motion(c)).mean()


def slopes(c):
    return np.einsum("tk,tkc->c", gradient(*motion(c)), B) / len(t)


def curvatures(c):
    return np.tensordot(B, hessian(*motion(c)) @ B, axes=([0, 1], [0, 1])) / len(t)


# %%
# Before you trust derivatives that you have assembled, compare them with finite
# differences along one direction.

rng = np.random.default_rng(0)
c, direction = rng.normal(size=(2, arm.n * shapes))
h = 1e-5
ahead, behind = c + h * direction, c - h * direction
difference = (cost(ahead) - cost(behind)) / (2 * h)
exact = slopes(c) @ direction
print(f"slope along it: {exact:.8f} exact, {difference:.8f} by differences")
assert abs(exact - difference) < 1e-7 * abs(exact)
bend = (slopes(ahead) - slopes(behind)) / (2 * h)
np.testing.assert_allclose(curvatures(c) @ direction, bend, atol=1e-6 * abs(bend).max())

# %%
# The optimisation
# ----------------
# With the exact Hessian a trust-region method converges quadratically near the optimum.
# A quasi-Newton method, which uses only the gradient, has still not converged after 190
# evaluations.

found = minimize(
    cost, np.zeros(arm.n * shapes), jac=slopes, hess=curvatures, method="trust-exact"
)
assert found.success
before, after = cost(np.zeros(arm.n * shapes)), found.fun
print(f"{found.nit} steps, {found.nfev} evaluations of the cost, {found.message}")
less = 1 - after / before
print(f"cost: {before:.4f} quintic, {after:.4f} optimised, {less:.0%} less")
assert after < 0.8 * before

q, qd, qdd = motion(found.x)
torques = {
    "quintic": arm.inverse_dynamics(*quintic(t)),
    "optimised": arm.inverse_dynamics(q, qd, qdd),
}
print("within the ranges:", bool((abs(q - middle) <= half).all()))
print(f"largest use of a speed limit: {(abs(qd) / arm.velocity_limit).max():.2f}")
assert (abs(q - middle) <= half).all()
assert (abs(qd) <= arm.velocity_limit).all()

# %%
# What was gained
# ---------------
# The quintic turns joint 1 with the arm stretched out. The optimised motion draws the
# hand in on its way, as low as is allowed (the dotted line), and stretches the arm
# again at the end. The weights then act on shorter levers, and less inertia has to be
# turned. The bars show the mean squares of the joints. They add up to the cost without
# its penalties. Nothing can be saved at the ends, because the poses are given.

shown = [0, 2, 3, 4, 5, 6, 7, *low[1:]]


def side_view(q):
    """Links' origins in the vertical plane that turns with joint 1 [m]."""
    origins = arm.link_poses(q)[..., :3, 3][:, shown]
    x, y, z = np.moveaxis(origins, -1, 0)
    ahead = np.cos(q[:, :1]) * x + np.sin(q[:, :1]) * y
    return np.stack([ahead, z], axis=-1)


figure = Figure(figsize=(9, 4.2), layout="constrained")
view, bars = figure.subplots(1, 2)
for k in (0, 8, 15, 22, 30):
    view.plot(
        *side_view(q)[k].T,
        "o-",
        color=f"{0.8 - 0.8 * k / 30:.2f}",
        markersize=4,
        label=f"{t[k]:.2f} s",
    )
view.plot(*side_view(q)[:, -1].T, color="C1", label="hand")
view.axhline(0.1, color="C3", linestyle=":", linewidth=1)
view.set(
    title="optimised, first half",
    xlabel="distance ahead [m]",
    ylabel="height [m]",
    aspect="equal",
    ylim=(-0.03, 0.85),
)
view.legend(frameon=False, ncols=3, loc="upper center", fontsize="small")
squares = {name: ((tau / limit) ** 2).mean(axis=0) for name, tau in torques.items()}
assert (squares["optimised"] < squares["quintic"]).all()
for k, (name, heights) in enumerate(squares.items()):
    bars.bar(np.arange(arm.n) + 0.4 * (k - 0.5), heights, width=0.4, label=name)
bars.set(
    xlabel="joint",
    ylabel="mean square of torque / limit",
    xticks=range(arm.n),
    xticklabels=(1, 2, 4, 6),
)
bars.legend(frameon=False)
figure
