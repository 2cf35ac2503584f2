r"""
Fastest motion with IPOPT
=========================

Which is the fastest motion of an IRB 140 from one rest to another, if it need not
follow the straight line between the two? We give its inverse dynamics to CasADi, whose
IPOPT solves the problem with exact first and second derivatives.

Needs: ``pip install '.[plot,casadi]'``
"""

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import rne

robot = rne.load("irb140")
effort = np.array([250.0, 250.0, 150.0, 20.0, 20.0, 10.0])  # assumed [N m]
start = np.array([-1.2, 0.3, 0.2, 0.5, -0.8, 0.0])
end = np.array([1.2, 0.9, -0.5, -0.5, 0.8, 2.0])
n, N = robot.n, 40  # joints, intervals

# %%
# The dynamics in CasADi
# ----------------------
# ``to_casadi`` converts a kernel of the robot to a ``casadi.Function``, whose arguments
# have the kernel's names. CasADi differentiates it; a Jacobian has 1944 operations, a
# Hessian of all torques 4734.

inverse_dynamics = robot.kernel(rne.dynamics.inverse_dynamics).to_casadi()
print(inverse_dynamics, inverse_dynamics.n_instructions(), "instructions")
np.testing.assert_allclose(
    inverse_dynamics(start, end, end).full()[:, 0],
    robot.inverse_dynamics(start, end, end),
    rtol=1e-12,
)

# %%
# The problem
# -----------
# Unknown are the duration T, and positions, velocities and accelerations at 41 nodes.
# Between nodes accelerations are linear in time, from which the equations between
# consecutive nodes follow. Torques and velocities have limits at the nodes. ``map``
# evaluates the torques of all nodes, so that the size of the problem does not depend on
# that of the robot. A small weight on changes of acceleration keeps joints that are not
# at their limits from oscillating.

opti = ca.Opti()
T = opti.variable()
q, qd, qdd = (opti.variable(n, N + 1) for _ in range(3))
h, before, after = T / N, qdd[:, :-1], qdd[:, 1:]
use = inverse_dynamics.map(N + 1)(q, qd, qdd) / effort  # share of each limit

opti.minimize(T + 1e-7 * ca.sumsqr(after - before))
opti.subject_to(T >= 0.1)
opti.subject_to(qd[:, 1:] == qd[:, :-1] + h / 2 * (before + after))
moved = h * qd[:, :-1] + h**2 / 6 * (2 * before + after)
opti.subject_to(q[:, 1:] == q[:, :-1] + moved)
opti.subject_to(opti.bounded(-1, ca.vec(use), 1))
for k in range(N + 1):
    opti.subject_to(opti.bounded(robot.lower, q[:, k], robot.upper))
    opti.subject_to(opti.bounded(-robot.velocity_limit, qd[:, k], robot.velocity_limit))
for k, pose in ((0, start), (N, end)):
    opti.subject_to(q[:, k] == pose)
    opti.subject_to(qd[:, k] == 0)

# %%
# IPOPT begins with the straight line at constant velocity. It takes exact Hessians from
# CasADi by default. Bounds of variables are passed to it as such, and T has one:
# otherwise IPOPT may try negative durations.

share = np.linspace(0, 1, N + 1)
opti.set_initial(T, 1.5)
opti.set_initial(q, start[:, None] + (end - start)[:, None] * share)
opti.set_initial(qd, (end - start)[:, None] / 1.5 * np.ones(N + 1))
options = {"print_time": False, "detect_simple_bounds": True}
opti.solver("ipopt", options, {"print_level": 0, "sb": "yes"})
found = opti.solve()
duration = found.value(T)
t = share * duration
print(f"{duration:.3f} s after {found.stats()['iter_count']} iterations")
q, qd, qdd, use = (found.value(x).T for x in (q, qd, qdd, use))

# %%
# How much does it gain?
# ----------------------
# For comparison, a quintic polynomial along the straight line within the same limits.
# Its duration is found by bisection.


def allowed(T):
    motion = rne.trajectories.quintic(start, end, T)(np.linspace(0, T, 200))
    torques = robot.inverse_dynamics(*motion)
    within = abs(motion[1]) <= robot.velocity_limit
    return bool((abs(torques) <= effort).all() and within.all())


slow, fast = 3.0, 0.3
while slow - fast > 1e-3:
    middle = (slow + fast) / 2
    slow, fast = (middle, fast) if allowed(middle) else (slow, middle)
print(f"{slow:.3f} s by a quintic, {1 - duration / slow:.0%} less by IPOPT")
assert duration < 0.8 * slow

# %%
# Between the nodes the torques are not constrained. We compute them there: positions
# and velocities follow from the accelerations.

fine = np.linspace(0, duration, 20 * N + 1)
k = np.minimum((fine / duration * N).astype(int), N - 1)
s, jerk = (fine - t[k])[:, None], (qdd[k + 1] - qdd[k]) / (duration / N)
a = qdd[k] + jerk * s
v = qd[k] + qdd[k] * s + jerk * s**2 / 2
p = q[k] + qd[k] * s + qdd[k] * s**2 / 2 + jerk * s**3 / 6
between = robot.inverse_dynamics(p, v, a) / effort
print(f"largest use of a limit: {abs(use).max():.3f} at the nodes, ", end="")
print(f"{abs(between).max():.3f} between them")
assert abs(between).max() < 1.05

# %%
# Joint 1 has the longest distance: its drive is at its limit until the joint has its
# largest velocity, and again to brake. Meanwhile joints 2 and 3 draw the wrist in and
# stretch the arm again, so that the inertia about joint 1 is smaller.

wrist = robot.link_poses(p)[:, robot.link_names.index("link_5"), :2, 3]
reach = np.hypot(*wrist.T)
full = np.isclose(abs(v[:, 0]), robot.velocity_limit[0], rtol=0.01).mean()
print(f"joint 1 at its largest velocity for {full:.0%} of the time")
print(
    f"reach {reach[0]:.2f} m, at least {reach.min():.2f} m, {reach[-1]:.2f} m at the end"
)
assert full > 0.5
assert reach.min() < 0.8 * reach[0]

figure = Figure(figsize=(9, 3.6), layout="constrained")
left, right = figure.subplots(1, 2)
left.plot(fine, between, label=[f"joint {k}" for k in range(1, n + 1)])
left.set(xlabel="time [s]", ylabel="torque / limit", title="The drives")
lines = right.plot(share, (q - start) / (end - start))
right.plot(share, share, "k:", linewidth=1)
right.set(
    xlabel="time / duration",
    ylabel="share of the way",
    title="The joints",
)
figure.legend(*left.get_legend_handles_labels(), loc="outside right upper")
figure
