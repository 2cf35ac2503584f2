r"""
Computed torque with a wrong model
==================================

A UR5 moves a part of 5 kg along a path under computed torque control, and the
controller's model has the wrong mass. How large is the tracking error? How does it
depend on the error of the model? Is computed torque with a wrong model still better
than PD control with gravity compensation?

Needs: ``pip install '.[plot,robots]'``
"""

import numpy as np
from matplotlib.figure import Figure

import rne

arm = rne.load("ur5")


def with_part(mass):
    return arm.with_payload(mass, com=[0, 0, 0.1], link="tool0")


plant = with_part(5.0)  # the robot that moves

# %%
# Controller and plant
# --------------------
# Computed torque control uses a model to calculate the torques of the commanded
# acceleration,
#
# .. math:: u = \hat M(q)\,(\ddot q_r - K_d\,\dot e - K_p\,e) + \hat C(q, \dot q)\,\dot q + \hat g(q),
#           \qquad e = q - q_r.
#
# With the right model the error obeys :math:`\ddot e + K_d \dot e + K_p e = 0`. The
# gains below give two poles at -10 1/s. If the motion begins on the reference, there is
# no error at all. The robot of the controller and the robot of the scene are two
# objects, so you can make them different.

kp, kd = np.full(6, 100.0), np.full(6, 20.0)  # [1/s^2], [1/s]
start = np.deg2rad([-40, -30, 60, -30, -90, 0])
end = np.deg2rad([40, -70, 100, -30, -60, 60])
path = rne.trajectories.quintic(start, end, 1.0)  # then the arm holds its position
t = np.linspace(0, 5, 1001)


def run(law):
    scene = rne.Scene(plant, controller=law)
    return rne.simulate(scene, start, np.zeros(6), t[-1], t_eval=t)


def flange_error(motion):
    """Distance of the flange from where it should be [mm]."""
    flange = arm.link_names.index("tool0")
    there, wanted = (
        arm.link_poses(q)[:, flange, :3, 3] for q in (motion.q, path(t)[0])
    )
    return 1e3 * np.linalg.norm(there - wanted, axis=1)


known = [5.0, 4.0, 2.5, 0.0]  # mass of the part in the controller's model [kg]
motions = {
    mass: run(rne.control.computed_torque(with_part(mass), kp, kd, path))
    for mass in known
}
for mass, motion in motions.items():
    error = flange_error(motion)
    at_rest = f"{error[-1]:6.2f} at rest"
    print(f"model with {mass} kg: largest error {error.max():6.2f} mm, {at_rest}")

# %%
# PD control with gravity compensation
# ------------------------------------
# ``rne.control.pd_gravity`` compensates the weight and leaves the rest to its gains.
# For a fair comparison it gets the right mass, and gains in N m/rad that equal those of
# computed torque in the middle of the path.

inertia = np.diag(plant.mass_matrix(path(0.5)[0]))
pd_gravity = rne.control.pd_gravity(plant, inertia * kp, inertia * kd, path)
pd_motion = run(pd_gravity)
error = flange_error(pd_motion)
print(f"PD and gravity: largest error {error.max():.2f} mm, {error[-1]:.2f} at rest")

figure = Figure(figsize=(8, 4), layout="constrained")
ax = figure.subplots()
for mass, motion in motions.items():
    ax.plot(t, flange_error(motion), label=f"computed torque, {mass} kg of 5 kg")
ax.plot(t, error, "k--", label="PD and gravity, right mass")
ax.axvline(path.duration, color="0.7", linewidth=0.8)
ax.text(path.duration, ax.get_ylim()[1] * 0.97, " end of the path", va="top")
ax.set(xlabel="time [s]", ylabel="distance from the reference [mm]", xlim=(0, 3))
ax.legend(frameon=False)
figure

# %%
# PD control lags while the arm accelerates, because nothing supplies the torques of the
# motion. It arrives exactly, because its gravity compensation is right. Computed torque
# with most of the mass in its model lags less, but does not reach the target: only a
# position error produces the torque for the weight that the model lacks. If the model
# has none of the mass, PD control is better throughout.
#
# Error against mass
# ------------------
# At rest the law gives :math:`u = \hat g - \hat M K_p e`, and the robot stands where
# this equals its own gravity:
#
# .. math:: e = -K_p^{-1} \hat M^{-1} (g - \hat g).
#
# The simulated error at the end agrees with this formula:

for mass in known[1:]:
    model, q = with_part(mass), motions[mass].q[-1]
    missing = plant.gravity_torque(q) - model.gravity_torque(q)
    predicted = -np.linalg.solve(model.mass_matrix(q), missing) / kp
    found = q - end
    errors = f"{found[1] * 1e3:.3f} mrad, {predicted[1] * 1e3:.3f} by the formula"
    print(f"missing {5 - mass} kg: joint 2 is off by {errors}")
    assert np.allclose(found, predicted, rtol=1e-4, atol=1e-5)

# %%
# The missing gravity is proportional to the missing mass. The error grows faster than
# that. The reason is :math:`\hat M`, which converts the gains into torques: it
# decreases with the mass in the model. Higher gains reduce the error in inverse
# proportion. An integral part (``rne.control.pid``) or a better mass removes it.

unknown = 5 - np.array(known)
largest = [flange_error(motion).max() for motion in motions.values()]
resting = [flange_error(motion)[-1] for motion in motions.values()]
figure = Figure(figsize=(5.5, 3.6), layout="constrained")
ax = figure.subplots()
ax.plot(unknown, largest, "o-", label="largest on the path")
ax.plot(unknown, resting, "s-", label="at rest")
ax.axhline(
    error.max(),
    color="black",
    linestyle="--",
    linewidth=0.8,
    label="largest, PD and gravity",
)
ax.set(
    xlabel="mass that the model does not know [kg]", ylabel="error of the flange [mm]"
)
ax.legend(frameon=False)
figure
