r"""
Model-predictive control
========================

An IRB 140 carries 3 kg past a wall. Every 20 ms its controller plans the next 0.8 s
again, within the limits of drives and joints, and applies the first torque of the plan.
The plan is computed by fatrop, a solver of CasADi for optimal control.

Needs: ``pip install '.[plot,casadi]'``
"""

from time import process_time

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import rne

robot, n = rne.load("irb140").with_payload(3.0, com=[0.05, 0.0, 0.1]), 6
effort = np.array([250.0, 250.0, 150.0, 20.0, 20.0, 10.0])  # assumed [N m]
viscous = np.array([10.0, 10.0, 5.0, 0.2, 0.2, 0.1])  # [N m s/rad]
start = np.array([-1.0, 0.5, 0.0, 0.0, 0.3, 0.0])
target = np.array([1.2, 0.6, 0.1, 0.0, 0.5, 1.0])
wall, margin = 0.5, 0.01  # at x, which the tool stays away [m]
period, h, N = 0.02, 0.04, 20  # of samples, of stages [s], number of stages

# %%
# The model in CasADi
# -------------------
# Kernels become functions of the kernel's arguments. The poses of the links are stacked
# in one matrix, from which we take x of the tool.

torques = robot.kernel(rne.dynamics.inverse_dynamics).to_casadi()
poses = robot.kernel(rne.dynamics.link_poses).to_casadi()
row = 4 * robot.link_names.index("tool0")

# %%
# The plan
# --------
# Inputs of the plan are accelerations. Then the equations from stage to stage are
# linear, and the torques of a stage are a constraint. With torques as inputs and
# Runge-Kutta steps, IPOPT took ten times as long for a plan, and fatrop found none.
# fatrop expects the variables stage by stage, and in every stage first the equation
# that leads to the next one.

opti = ca.Opti()
now = opti.parameter(2 * n)
stages = [(opti.variable(2 * n), opti.variable(n)) for _ in range(N)]
last = opti.variable(2 * n)
following = [x for x, _ in stages[1:]] + [last]
cost, speed = 0, robot.velocity_limit
for (x, a), x_next in zip(stages, following):
    q, qd = x[:n], x[n:]
    opti.subject_to(x_next == ca.vertcat(q + h * qd + h**2 / 2 * a, qd + h * a))
    if x is stages[0][0]:
        opti.subject_to(x == now)
    else:  # of the first stage nothing can be changed
        opti.subject_to(opti.bounded(-speed, qd, speed))
        opti.subject_to(poses(q)[row, 3] <= wall - margin)
    opti.subject_to(opti.bounded(-1, (torques(q, qd, a) + viscous * qd) / effort, 1))
    cost += ca.sumsqr(q - target) + 0.01 * ca.sumsqr(qd) + 1e-5 * ca.sumsqr(a)
opti.subject_to(opti.bounded(-speed, last[n:], speed))
opti.minimize(cost + 10 * ca.sumsqr(last[:n] - target) + ca.sumsqr(last[n:]))
options = {"print_time": False, "structure_detection": "auto", "expand": True}
opti.solver("fatrop", options, {"print_level": 0, "tol": 1e-6})
plan = opti.to_function("plan", [now, opti.x], [stages[0][1], opti.x])

# %%
# The controller
# --------------
# Computing a plan takes time: a plan computed from one sample acts from the next one
# on. So the state at the next sample is predicted by the discrete-time equations of
# motion of the whole scene, with the torque that is held until then.

model = rne.Scene(robot, friction=rne.Friction(viscous=viscous), effort_limit=effort)
predict = model.to_casadi(steps=2)
print(predict)


class Predictive:
    """Torques of the plan made since the last sample; CPU seconds of each plan."""

    def __init__(self):
        self.torque, self.seconds = robot.gravity_torque(start), []
        rest = np.concatenate([start, np.zeros(n)])
        self.guess = np.concatenate([*[rest, np.zeros(n)] * N, rest])

    def __call__(self, t, q, qd):
        applied, began = self.torque, process_time()
        x = predict(t, np.concatenate([q, qd]), applied, period)[0].full()[:, 0]
        a, self.guess = plan(x, self.guess)
        at_next = torques(x[:n], x[n:], a).full()[:, 0] + viscous * x[n:]
        self.torque = np.clip(at_next, -effort, effort)
        self.seconds.append(process_time() - began)
        return applied


# %%
# The closed loop
# ---------------
# The simulated arm has dry friction in its joints, which is not in the controller's
# model. So some joints stop slightly before their targets; an integral part would
# remove this error.

dry = [5, 5, 3, 0.3, 0.3, 0.1]  # [N m]
friction = rne.Friction(viscous=viscous, coulomb=dry, smoothing=0)
law = Predictive()
arm = rne.Scene(
    robot,
    friction=friction,
    effort_limit=effort,
    controller=law,
    sample_time=period,
)
motion = rne.simulate(arm, start, np.zeros(n), 1.5)
print(motion.message)
print(f"a plan of {N} stages takes {np.median(law.seconds) * 1e3:.0f} ms")
error = abs(motion.q[-1] - target).max()
tool = robot.link_poses(motion.q)[:, robot.link_names.index("tool0"), :2, 3]
gap = wall - tool[:, 0].max()
print(f"{error:.3f} rad from the target; {gap * 1e3:.1f} mm from the wall at least")
assert error < 0.05
assert gap > 0
assert (abs(motion.qd) < 1.02 * speed).all()

# %%
# On the left the tool's path in plan view, on the right the drives.

figure = Figure(figsize=(9, 3.8), layout="constrained")
left, right = figure.subplots(1, 2, width_ratios=[1, 2])
left.axvspan(wall, wall + 0.1, color="0.8")
left.plot(*tool.T)
left.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="Tool and wall")
right.plot(motion.t, motion.tau / effort, label=[f"joint {k + 1}" for k in range(n)])
right.set(xlabel="time [s]", ylabel="torque / limit", title="The drives")
figure.legend(loc="outside right upper")
figure
