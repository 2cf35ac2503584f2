r"""
Tune the gains of a motion
==========================

Twelve gains of PD control decide how an IRB 140 moves to a pose: how fast, and with
which torques. The cost is an integral over the motion. ``rne.motion_gradient`` computes
it and its derivatives with respect to all gains in the time of three motions, so that
an optimiser needs the time of 70 motions instead of 900 with finite differences.

Needs: ``pip install '.[plot,numba]'``
"""

from time import process_time

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import minimize

import rne

robot = rne.load("irb140", engine="numba").with_armature([2, 2, 1, 0.2, 0.2, 0.1])
effort = np.array([250.0, 250.0, 150.0, 20.0, 20.0, 10.0])  # of the drives [N m]
friction = rne.Friction(
    viscous=[10, 10, 5, 0.5, 0.5, 0.2],
    coulomb=[4, 6, 4, 0.5, 0.5, 0.1],
    smoothing=0.1,
)
rest, goal = np.zeros(6), np.array([0.8, 0.4, -0.5, 0.6, 0.5, -1.0])  # [rad]
kp, kd = [50, 50, 50, 50, 50, 60], [20, 20, 20, 20, 20, 22]  # the thesis's gains
law = rne.control.pd_gravity(robot, kp, kd, goal)
scene = rne.Scene(robot, controller=law, friction=friction)
duration = 2.0  # [s]

# %%
# The cost of a motion
# --------------------
# The squared distance from the goal, and the squared torques beyond those that hold the
# arm, relative to the limits of its drives. The cost is a function of one state, and is
# traced: it may use arithmetic, the robot's methods and the functions of
# ``rne.elementwise``. It is integrated along with the motion. The scene has no
# ``effort_limit``: the cost alone keeps torques small.


def cost(t, q, qd, tau):
    used = (tau - robot.gravity_torque(q)) / effort
    return ((q - goal) ** 2).sum() + (used**2).sum()


names = ["controller.kp", "controller.kd"]
value, slopes = rne.motion_gradient(scene, rest, rest, duration, cost, wrt=names)
print(f"cost {value:.4f}")
for name in names:
    print(name, slopes[name].round(5))

# %%
# Before you trust a derivative, compare it with a finite difference along one
# direction:

along = {name: np.linspace(1.0, 2.0, 6) for name in names}
ends = [
    rne.motion_gradient(
        scene,
        rest,
        rest,
        duration,
        cost,
        wrt=names,
        numbers={name: scene.numbers[name] + h * along[name] for name in names},
    ).value
    for h in (-1e-3, 1e-3)
]
difference = (ends[1] - ends[0]) / 2e-3
exact = sum(slopes[name] @ along[name] for name in names)
print(f"slope along it: {exact:.9f} by the adjoint, {difference:.9f} by a difference")
assert abs(exact / difference - 1) < 1e-6

# %%
# The optimisation
# ----------------
# Gains stay positive if the optimiser varies their logarithms. Every evaluation is one
# call with other numbers in the same scene: nothing is traced or compiled again.


def numbers(z):
    return dict(zip(names, np.exp(z).reshape(2, 6)))


def cost_and_slopes(z):
    value, slopes = rne.motion_gradient(
        scene, rest, rest, duration, cost, wrt=names, numbers=numbers(z)
    )
    history["gradients"].append((process_time(), value))
    return value, np.exp(z) * np.concatenate([slopes[name] for name in names])


# %%
# Without derivatives the same optimiser uses finite differences: one motion for each of
# the twelve gains, and one more. The cost is then a sum over times of ``rne.simulate``,
# by Simpson's rule.

times = np.linspace(0, duration, 401)
weights = np.ones(len(times))
weights[1:-1:2], weights[2:-1:2] = 4, 2
weights *= times[1] / 3


def cost_alone(z):
    run = rne.simulate(scene, rest, rest, duration, numbers=numbers(z), t_eval=times)
    used = (run.tau - robot.gravity_torque(run.q)) / effort
    errors, efforts = ((run.q - goal) ** 2).sum(axis=1), (used**2).sum(axis=1)
    value = weights @ (errors + efforts)
    history["differences"].append((process_time(), value))
    return value


history = {"gradients": [], "differences": []}
first = np.log(np.concatenate([kp, kd]))
cost_and_slopes(first), cost_alone(first)  # what is compiled is compiled now
found, spent = {}, {}
for way, function, has_slopes in (
    ("gradients", cost_and_slopes, True),
    ("differences", cost_alone, None),
):
    history[way].clear()
    begun = process_time()
    found[way] = minimize(function, first, jac=has_slopes, method="L-BFGS-B")
    spent[way] = process_time() - begun
    history[way] = np.array(history[way]) - [begun, 0.0]
    print(
        f"{way}: {found[way].nit} iterations, {len(history[way])} motions, "
        f"{spent[way]:.2f} s, cost {found[way].fun:.5f}"
    )

best = numbers(found["gradients"].x)
for name, gains in best.items():
    print(name, gains.round(1))
np.testing.assert_allclose(found["differences"].x, found["gradients"].x, atol=0.02)
assert found["gradients"].success
assert found["gradients"].fun < 0.7 * value
assert len(history["differences"]) > 8 * len(history["gradients"])

# %%
# Both ways end at the same gains. The first three joints become three to six times as
# stiff. The wrist's gains decrease, its velocity gains most: they only slowed it down.

figure = Figure(figsize=(8, 3.4), layout="constrained")
ax = figure.subplots()
for way, points in history.items():
    ax.plot(points[:, 0], np.minimum.accumulate(points[:, 1]), label=f"by {way}")
ax.set(xscale="log", xlabel="CPU time [s]", ylabel="lowest cost so far")
ax.legend(frameon=False)
ax.grid(alpha=0.3)
figure

# %%
# The motion before and after
# ---------------------------
# Positions of the first three joints, relative to their distance, and torques, relative
# to the limits of their drives.

runs = {
    "given": rne.simulate(scene, rest, rest, duration, t_eval=times),
    "tuned": rne.simulate(scene, rest, rest, duration, t_eval=times, numbers=best),
}
figure = Figure(figsize=(8, 5), layout="constrained")
places, torques = figure.subplots(2, 3, sharex=True, sharey="row")
for k, (ax, below) in enumerate(zip(places, torques)):
    for name, run in runs.items():
        ax.plot(run.t, run.q[:, k] / goal[k], label=f"{name} gains")
        used = (run.tau - robot.gravity_torque(run.q)) / effort
        below.plot(run.t, used[:, k])
    ax.set_title(robot.joint_names[k], fontsize="medium")
    ax.grid(alpha=0.3)
    below.grid(alpha=0.3)
    below.set_xlabel("time [s]")
places[0].set_ylabel("share of the way")
torques[0].set_ylabel("torque beyond gravity's\nas share of the limit")
places[-1].legend(frameon=False, loc="lower right")
assert abs(runs["tuned"].q[-1] - goal).max() < 0.02
used = abs(runs["tuned"].tau / effort).max(axis=0)
print("largest torque as share of the limit:", used.round(2))
assert used.max() < 1.05
figure

# %%
# Where it does not help
# ----------------------
# A gradient is local. It is the gradient of the computed motion, and useful only if
# this motion depends smoothly on its numbers:
#
# - Where torques reach their limits, derivatives are those of the side on which they
#   are. Gains of a drive at its limit have derivative 0 as long as it is there.
# - Stops and friction that sticks are refused: set ``stops=False`` and a ``smoothing``.
#   With a small smoothing friction is nearly a jump, and the optimum hides behind it.
# - A law that is sampled may become unstable with the gains. Derivatives then grow
#   exponentially with the duration, and so does what the optimiser sees: bound the
#   gains, by ``scene.check_gains``, or begin with short motions.
# - Many minima stay many minima: start from several gains.
