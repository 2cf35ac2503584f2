r"""
Minimum-torque trajectory
=========================

A Panda moves from one pose to another in a given time. Which of all smooth motions
between the two needs the least torque? We describe the motion by 16 numbers. SciPy's
optimiser finds them with exact derivatives of the inverse dynamics.

Needs: ``pip install '.[plot,robots]'``
"""

import numpy as np
from matplotlib.figure import Figure
from numpy.polynomial import Legendre, Polynomial
from scipy.optimize import minimize

import rne

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
# The cost and its gradient
# -------------------------
# The cost is the mean over time of the squared torques, each relative to its drive's
# limit. Penalties are added for positions and velocities beyond 95 % of the joints'
# ranges, and for wrist and hand lower than 0.1 m. By the chain rule, the gradient needs
# the derivatives of the torques by positions, velocities and accelerations at every
# time. ``inverse_dynamics_derivatives`` gives all three exactly, for all times in one
# call. The last one is the mass matrix. The derivative of a link's height is the last
# row of its Jacobian, which is [angular; linear] in the axes of the base.

middle = (arm.upper + arm.lower) / 2
half = (arm.upper - arm.lower) / 2
low = {
    name: arm.link_names.index(name)
    for name in ("panda_link6", "panda_link8", "panda_hand_tcp")
}


def penalty(excess):
    """What exceeds zero, cubed, and its derivative."""
    beyond = np.maximum(excess, 0)
    return 2000 * (beyond**3).sum(), 6000 * beyond**2


def cost(c):
    q, qd, qdd = motion(c)
    tau = arm.inverse_dynamics(q, qd, qdd)
    place, pace = (q - middle) / half, qd / fastest
    ranges, by_place = penalty(abs(place) - 0.95)
    speeds, by_pace = penalty(abs(pace) - 0.95)
    by_q, by_qd = by_place * np.sign(place) / half, by_pace * np.sign(pace) / fastest
    total = ((tau / limit) ** 2).sum() + ranges + speeds
    heights = arm.link_poses(q)[:, :, 2, 3]
    for name, k in low.items():
        lowness, by_depth = penalty(0.1 - heights[:, k])
        total = total + lowness
        by_q = by_q - by_depth[:, None] * arm.jacobian(q, name)[:, 5]
    by_tau = 2 * tau / limit**2
    slopes = arm.inverse_dynamics_derivatives(q, qd, qdd)
    gradient = sum(
        part.T @ (np.einsum("ti,tij->tj", by_tau, slope) + further)
        for part, slope, further in zip((b, bd, bdd), slopes, (by_q, by_qd, 0))
    )
    return total / len(t), gradient.ravel() / len(t)


# %%
# Before you trust a gradient, compare it with a difference of the cost along some
# direction.

rng = np.random.default_rng(0)
c, direction = rng.normal(size=(2, arm.n * shapes))
h = 1e-5
difference = (cost(c + h * direction)[0] - cost(c - h * direction)[0]) / (2 * h)
exact = cost(c)[1] @ direction
print(f"slope along it: {exact:.8f} exact, {difference:.8f} by differences")
assert abs(exact - difference) < 1e-7 * abs(exact)

# %%
# The optimisation
# ----------------
# Without the gradient, each step of the optimiser would need 16 more evaluations of the
# cost.

found = minimize(
    cost,
    np.zeros(arm.n * shapes),
    jac=True,
    method="L-BFGS-B",
    options={"maxiter": 150},
)
before, after = cost(np.zeros(arm.n * shapes))[0], found.fun
print(f"{found.nit} steps, {found.nfev} evaluations of the cost and its gradient")
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

shown = [0, 2, 3, 4, 5, 6, 7, low["panda_link8"], low["panda_hand_tcp"]]


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
