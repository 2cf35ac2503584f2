r"""
Velocities by an extended Kalman filter
=======================================

Differences of encoder positions are noisy, and filtering delays them. With a model,
velocities also follow from the known torques. This extended Kalman filter predicts the
state with ``rne.Stepper`` and the covariance with its ``jacobian``.

Needs: ``pip install '.[plot]'``
"""

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import lfilter

import rne

arm = rne.load("irb140").locked({"joint_4": 0, "joint_5": 0, "joint_6": 0})
friction = rne.Friction(viscous=8.0, coulomb=5.0, smoothing=0.1)
scene = rne.Scene(arm, friction=friction, armature=[2.0, 2.0, 1.0])
h, count = 0.002, 2 * np.pi / 2**14  # period [s]; step of encoders of 14 bits [rad]
step, t, w = rne.Stepper(scene, h), np.arange(0, 2, h), np.array([3.0, 4.0, 5.0])
q, qd = 0.5 * np.sin(np.outer(t, w)), 0.5 * w * np.cos(np.outer(t, w))  # reference
known = scene.inverse_dynamics(q, qd, -(w**2) * q)  # [N m]
# %%
# Twenty arms are simulated, each with a filter and a controller that uses its estimate
# z: three positions, three velocities, and three disturbance torques, modelled as
# random walks of 5 N m in one second. Encoder rounding is treated as noise of variance
# count² / 12.
begin, walk = np.repeat([1e-3, 0.1, 5.0], 3), np.repeat([0, 0, 5 * h**0.5], 3)
z, P = np.tile([*q[0], *qd[0], 0, 0, 0], (20, 1)), np.array([np.diag(begin**2)] * 20)
rng, F, rows, nees = np.random.default_rng(0), np.tile(np.eye(9), (20, 1, 1)), [], []
true = z + begin * rng.normal(size=z.shape)
for k in range(len(t)):
    y = count * np.round(true[:, :3] / count)
    K = P[:, :, :3] @ np.linalg.inv(P[:, :3, :3] + np.eye(3) * count**2 / 12)
    z, P = z + np.einsum("nij,nj->ni", K, y - z[:, :3]), P - K @ P[:, :3]
    rows.append(np.hstack([y, true, z, np.sqrt(np.diagonal(P, axis1=1, axis2=2))]))
    nees.append(np.einsum("ni,nij,nj", z - true, np.linalg.inv(P), z - true) / len(z))
    u = known[k] + 900 * (q[k] - z[:, :3]) + 60 * (qd[k] - z[:, 3:6]) - z[:, 6:]
    F[:, :6] = step.jacobian(z[:, :6], u + z[:, 6:])  # by x and u + torques lacking
    P = F @ P @ F.swapaxes(1, 2) + np.diag(walk**2)
    z, true = (np.hstack([step(x[:, :6], u + x[:, 6:]), x[:, 6:]]) for x in (z, true))
    true += walk * rng.normal(size=z.shape)
# %%
# Errors are as large as the filter's covariance says. Velocity errors are an eighth of
# those of filtered differences, even with the best of many low-pass filters, which
# could be chosen only because the true velocities are known. On your arm check y - z:
# it shows whether the model and its noise are right.
y, true, z, std = np.split(np.array(rows), [3, 12, 21], axis=2)
share = (abs(z - true) < 2 * std)[100:].mean((0, 1))
rate, poles = np.diff(y, axis=0, prepend=y[:1]) / h, np.arange(0.3, 0.95, 0.05)
late = [lfilter([1 - a], [1, -a], rate, axis=0) for a in poles]
best = min((v[100:] - true[100:, :, 3:6] for v in late), key=np.std)  # from 0.2 s on
own, band = (z - true)[100:, :, 3:6], 2 * std[100:400, 0, 4]
print(f"within 2 standard deviations: {share.round(3)}; NEES {np.mean(nees[100:]):.2f}")
print(f"velocity errors: {best.std():.4f} rad/s filtered, {own.std():.4f} estimated")
assert (abs(share - 0.954) < 0.03).all()
assert abs(np.mean(nees[100:]) / 9 - 1) < 0.06
assert own.std() < best.std() / 7
figure = Figure(figsize=(8, 3.6), layout="constrained")
ax, x = figure.subplots(), t[100:400]
ax.plot(x, best[:300, 0, 1], "0.6", label="filtered differences")
ax.plot(x, own[:300, 0, 1], label="Kalman filter")
ax.fill_between(x, -band, band, alpha=0.3, label="its 2 standard deviations")
ax.set(xlabel="time [s]", ylabel="velocity error of joint 2 [rad/s]")
ax.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1))
figure
