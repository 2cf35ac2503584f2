r"""
From CSV to torques
===================

You recorded the positions of an arm while it moved. Which torques did the motion take?
Inverse dynamics needs accelerations, and differentiating twice amplifies the noise of
the recording. This tutorial reads a CSV file, shows what noise and quantisation do to
the torques, and smooths them away. The result is compared with the true torques.

Needs: ``pip install '.[plot]'``
"""

import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import make_smoothing_spline
from scipy.signal import butter, filtfilt

import rne

robot = rne.load("irb140")

# %%
# A recording
# -----------
# Instead of a real recording we use a simulated one: an IRB 140 moves with a
# trapezoidal profile of its velocities. Its positions are read every 4 ms, with noise
# and with the steps of an encoder. So the true torques are known, unlike in a
# laboratory. A file of this form has a column ``t`` and one column ``q.<joint>`` per
# joint, in any order.

dt, noise, count = 0.004, 1e-4, 2 * np.pi / 2**16  # [s], [rad], [rad]
t = np.arange(0, 1.6 + dt / 2, dt)
path = rne.trajectories.trapezoidal(
    [0, 0, 0, 0, 0.3, 0], [1.0, 0.8, -0.6, 1.0, -0.5, 1.5], 0.8, ramp=0.25
)
truth = path(
    t - 0.4
)  # the recording begins 0.4 s before the motion, and ends 0.4 s after it
rng = np.random.default_rng(0)
measured = (
    np.round((truth[0] + noise * rng.normal(size=(len(t), 6))) / count) * count + 0.0
)

folder = tempfile.TemporaryDirectory()
file = Path(folder.name) / "recording.csv"
header = ",".join(["t", *(f"q.{name}" for name in robot.joint_names)])
np.savetxt(
    file,
    np.column_stack([t, measured]),
    delimiter=",",
    header=header,
    comments="",
    fmt="%.9g",
)
print(*file.read_text().splitlines()[:3], sep="\n")

# %%
# Reading
# -------
# ``read_csv`` sorts the columns by the names of the joints. It raises an error for
# gaps, times that do not increase, and entries that are not numbers. Quantities that
# the file does not contain, such as velocities here, are None.

samples = rne.trajectories.read_csv(file, robot.joint_names)
folder.cleanup()
print(
    samples.q.shape,
    samples.qd,
    f"noise {noise:.0e} rad, one count of the encoder {count:.0e} rad",
)

# %%
# Straight through the samples
# ----------------------------
# ``rne.trajectories.spline`` passes exactly through all samples, noise included. That
# is a good choice for positions that were computed, and a bad one for these.

true = robot.inverse_dynamics(*truth)
exact = rne.trajectories.spline(samples.t, samples.q)(t)
interpolated = robot.inverse_dynamics(*exact)

# %%
# How large is the noise of an acceleration? Take the central difference
# :math:`(q_{k+1} - 2 q_k + q_{k-1})/\Delta t^2` of independent errors with standard
# deviation :math:`\sigma`. Its standard deviation is
# :math:`\sqrt{1 + 4 + 1}\,\sigma/\Delta t^2`. Rounding to a count adds errors of
# standard deviation count/:math:`\sqrt{12}`.

sigma = np.hypot(noise, count / np.sqrt(12))
differences = np.diff(samples.q, 2, axis=0) / dt**2
found, formula = (differences - truth[2][1:-1]).std(), np.sqrt(6) * sigma / dt**2
print(f"noise of an acceleration: {found:.2f} rad/s^2, {formula:.2f} by the formula")
assert abs(found / formula - 1) < 0.05
print(f"largest true acceleration: {abs(truth[2]).max():.2f} rad/s^2")

# %%
# Twice the sampling rate makes it four times worse: the divisor shrinks with the time
# step, and the noise does not.
#
# Smoothing
# ---------
# Most of an arm's motion lies below about 10 Hz, while the noise has all frequencies.
# Two tools of SciPy use this. ``filtfilt`` runs a low-pass filter forwards and
# backwards, which cancels its delay. A spline through the filtered samples then gives
# the derivatives. ``make_smoothing_spline`` fits a spline that balances closeness to
# the samples against curvature, and chooses the balance by cross-validation.


def low_passed(frequency):
    """Torques from samples without what is above a frequency [Hz]."""
    b, a = butter(4, frequency, fs=1 / dt)
    passed = filtfilt(b, a, samples.q, axis=0)
    return robot.inverse_dynamics(*rne.trajectories.spline(samples.t, passed)(t))


smooth = [make_smoothing_spline(samples.t, q) for q in samples.q.T]
smoothed = [np.array([f.derivative(order)(t) for f in smooth]).T for order in range(3)]
torques = {
    "filtfilt, 8 Hz": low_passed(8.0),
    "smoothing spline": robot.inverse_dynamics(*smoothed),
}
inner = (t > 0.1) & (t < 1.5)  # at the ends there are samples on one side only


def rms(tau):
    """Root of the mean squared error of joint 2 [N m]."""
    return np.sqrt(((tau - true)[inner, 1] ** 2).mean())


for name, tau in {"spline through the samples": interpolated, **torques}.items():
    print(f"{name:27} rms error at joint 2: {rms(tau):7.2f} N m")

figure = Figure(figsize=(8, 6), layout="constrained")
upper, lower = figure.subplots(2, 1, sharex=True)
label = "spline through the samples"
upper.plot(t[inner], interpolated[inner, 1], color="0.6", linewidth=0.8, label=label)
for name, tau in torques.items():
    lower.plot(t, tau[:, 1], label=name)
for ax in (upper, lower):
    ax.plot(t, true[:, 1], "k--", linewidth=1, label="truth")
    ax.set_ylabel("torque of joint 2 [N m]")
    ax.legend(frameon=False)
lower.set(xlabel="time [s]")
figure

# %%
# The two panels have different scales. Both tools come close to the truth, but neither
# can follow its jumps, which contain all frequencies. Before and after the motion, at
# rest, the torque is that of gravity.
#
# Where to cut off
# ----------------
# A low cut-off frequency removes the noise and part of the motion, a high one keeps
# both. The best one lies in between and depends on the motion. If the true torques are
# unknown, compare two recordings, one at rest and one in motion. Choose the frequency
# above which both have the same power.

frequencies = np.geomspace(2, 60, 25)
errors = [rms(low_passed(frequency)) for frequency in frequencies]
best = int(np.argmin(errors))
print(f"smallest error {errors[best]:.2f} N m, cut off at {frequencies[best]:.0f} Hz")
assert 0 < best < len(frequencies) - 1
assert errors[best] < rms(interpolated) / 20

figure = Figure(figsize=(6, 3.4), layout="constrained")
ax = figure.subplots()
ax.plot(frequencies, errors, "o-")
ax.set(xlabel="cut-off frequency [Hz]", ylabel="rms error of joint 2 [N m]")
ax.set_ylim(0, None)
ax.grid(alpha=0.3)
figure
