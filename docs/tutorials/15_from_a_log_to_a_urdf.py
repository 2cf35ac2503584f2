r"""
From a log to a URDF
====================

The URDF of an arm has wrong masses and no friction, as many have. Its controller can
record positions and torques. This tutorial finds a motion that is worth recording,
simulates the recording, and fits bodies and friction. Then it checks the model on
another motion and writes a URDF. The log is simulated, so we know the truth.

Needs: ``pip install '.[plot,identify]'``
"""

import tempfile
from pathlib import Path

import numpy as np

import rne

# %%
# What is known
# -------------
# The positions of the joints are right. The masses are not: in the file every body has
# two thirds of its true mass. The file says nothing about friction.

true = rne.load("irb140")
known = rne.Robot(rne.model.with_parameters(true.model, true.parameters / 1.5))
print(known.base_parameters())

# %%
# Torques depend on these 36 combinations of parameters. Each joint adds a viscous and a
# Coulomb coefficient.
#
# A motion that is worth recording
# --------------------------------
# ``rne.excitation`` looks for a periodic motion inside the robot's limits. Its
# regressor should have a small condition number, so that noise has little effect.
# Random motions within the same limits have condition numbers many times larger.

drives = rne.DriveModel(friction="viscous+coulomb")
motion = rne.excitation(
    known, 10.0, harmonics=4, drives=drives, starts=1, iterations=40
)
print(motion)

# %%
# The recording
# -------------
# Instead of a real arm we simulate one: friction on each drive, noise on the torques,
# encoders of 17 bits, 500 samples per second, and a file as a controller may write it.

viscous, coulomb = [8, 6, 2, 1.2, 1.4, 0.6], [6, 8, 6, 2, 2.4, 0.5]
arm = rne.Scene(true, friction=rne.Friction(viscous=viscous, coulomb=coulomb))
rng = np.random.default_rng(0)
step = 2 * np.pi / 2**17


def log(path, t, reference):
    q, qd, qdd = reference(t)
    tau = arm.inverse_dynamics(q, qd, qdd)
    tau = tau + [1.5, 1.5, 0.9, 0.3, 0.3, 0.3] * rng.standard_normal(tau.shape)
    columns = np.column_stack([t, step * np.rint(q / step), tau])
    names = [f"{x}.{joint}" for x in ("q", "tau") for joint in true.joint_names]
    header = ",".join(["t", *names])
    np.savetxt(path, columns, "%.9g", ",", header=header, comments="")


folder = tempfile.TemporaryDirectory()
file = Path(folder.name) / "exciting.csv"
log(file, np.arange(0, 20, 0.002), motion)
record = rne.identification.Record.from_csv(file, known.joint_names)
print(record, *record.findings, sep="\n")

# %%
# The log holds two periods of the motion. Findings are faults of a log: gaps, spikes,
# time stamps of the recording program, torques at their limit. This log has none.
#
# The fit
# -------
# Without ``drives``, rotors and offsets would be fitted too, because real arms have
# them. This simulated one has none.

found = rne.identify(known, record, drives=drives)
print(found.report(details=True))

# %%
# Least squares gives the base parameters and their standard errors. The bodies listed
# below them are physically consistent: for each there is a distribution of mass with
# these parameters. Of all bodies that fit the torques they are the closest to those of
# the wrong file.

values = found.base.matrix[:, :60] @ true.parameters
values[-12:] = [*viscous, *coulomb]
z = (found.estimate.values - values) / found.estimate.errors
print(
    f"errors in standard errors: {np.sqrt(np.mean(z**2)):.2f} rms, {abs(z).max():.1f} at most"
)
assert abs(z).max() < 5

# %%
# Another motion
# --------------
# A good fit alone proves little. Here are measured and predicted torques, and
# residuals, of a motion that was not fitted.

w = 2 * np.pi * np.array([0.2, 0.25, 0.3, 0.35, 0.4, 0.45])  # [rad/s]


def sway(t):
    angle = np.multiply.outer(t, w)
    return 0.6 * np.sin(angle), 0.6 * w * np.cos(angle), -0.6 * w**2 * np.sin(angle)


other = Path(folder.name) / "other.csv"
log(other, np.arange(0, 10, 0.002), sway)
check = found.check(rne.identification.Record.from_csv(other, known.joint_names))
print(check.report())
figure = check.plot()

# %%
# The URDF
# --------
# ``found.to_urdf()`` has the bodies, friction as ``<dynamics>``, and rotors, where they
# were fitted, in Drake's format. Every other program can read the URDF; most ignore the
# rotors. ``found.scene()`` simulates the same arm here, friction included.

urdf = Path(folder.name) / "irb140_identified.urdf"
urdf.write_text(found.to_urdf(), encoding="utf-8")
identified = rne.load(urdf)
for robot, name in ((known, "before"), (identified, "after")):
    q, qd, qdd = rng.uniform(-1, 1, (3, 1000, 6))
    exact = true.inverse_dynamics(q, qd, qdd)
    wrong = robot.inverse_dynamics(q, qd, qdd) - exact
    print(f"{name}: {100 * np.linalg.norm(wrong) / np.linalg.norm(exact):.1f} % wrong")
folder.cleanup()
assert np.linalg.norm(wrong) < 0.01 * np.linalg.norm(exact)
