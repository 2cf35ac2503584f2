r"""
Exporting C and MATLAB
======================

A controller that runs every millisecond needs the inverse dynamics of a UR5 as C code
without any library. A colleague needs one entry of the mass matrix in MATLAB. We print
both from the traced program. Then we compile the C code and compare it with Python, bit
by bit.

Needs: ``pip install '.[plot,robots]'``, and a C compiler called ``cc``
"""

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import rne

robot = rne.load("ur5")

# %%
# A kernel and its source
# -----------------------
# ``rne.compile`` traces a function for one robot. The result is a list of additions,
# products, sines and cosines. Zeros are gone, constants are multiplied out, and shared
# terms are computed once.

kernel = rne.compile(rne.dynamics.inverse_dynamics, robot.model)
print(kernel)
source = kernel.source("c")
lines = source.splitlines()
print(*lines[:20], "...", *lines[-8:], sep="\n")

# %%
# The comment at the head names the robot, the order of its joints and the units. The
# function takes pointers to arrays of six numbers, allocates nothing and has no
# branches. It does not check its arguments.
#
# Compiled and compared
# ---------------------
# ``-ffp-contract=off`` keeps the compiler from merging a product and a sum into one
# instruction, which rounds once instead of twice. Without it the last digits may differ
# on some processors. They are then different, but no less accurate.

rng = np.random.default_rng(0)
states = rng.uniform(-1, 1, (1000, 3, 6)) * [[np.pi], [2.0], [10.0]]
by_python = np.array([kernel(*state) for state in states])


def by_c(folder):
    """Torques of all states from the compiled function."""
    code, library = folder / "ur5.c", folder / "ur5.so"
    code.write_text(source)
    flags = ["-O2", "-fPIC", "-shared", "-ffp-contract=off"]
    subprocess.run(["cc", *flags, str(code), "-o", str(library), "-lm"], check=True)
    function = ctypes.CDLL(str(library)).inverse_dynamics
    function.argtypes, function.restype = (
        [np.ctypeslib.ndpointer(float, flags="C")] * 4,
        None,
    )
    tau = np.empty((len(states), 6))
    for state, row in zip(states, tau):
        function(*state, row)
    return tau


if shutil.which("cc"):
    with tempfile.TemporaryDirectory() as folder:
        tau = by_c(Path(folder))
    print("C and Python agree to the last bit:", np.array_equal(tau, by_python))
    assert np.array_equal(tau, by_python)
else:
    print("no C compiler here")

# %%
# One entry for MATLAB
# --------------------
# ``element`` picks one entry, with only the operations that it needs. Joints are
# counted from 1. The source runs in MATLAB and in Octave. (Factors near 5e-12 come from
# this URDF, which writes right angles with twelve digits.)

mass_matrix = rne.compile(rne.dynamics.mass_matrix, robot.model)
print(mass_matrix.source("matlab", element="m23"))

# %%
# The same entries as Python source need nothing but ``math``. Here they are drawn over
# the angle of the elbow. m22 and m33 are the inertias at shoulder and elbow when only
# that joint moves. m23 is the torque at the shoulder per unit acceleration of the
# elbow. With the arm stretched out, the elbow's motion shakes the shoulder most; with
# the forearm folded back it hardly does.

entries = {}
for element in ("m22", "m23", "m33"):
    exec(
        mass_matrix.source("python", element=element), entries
    )  # defines a function of that name
elbow = np.linspace(-np.pi, np.pi, 181)
postures = np.zeros((181, 6))
postures[:, 2] = elbow
curves = {
    name: np.array([entries[name](q) for q in postures])
    for name in ("m22", "m23", "m33")
}
M = robot.mass_matrix(postures)
assert np.allclose(curves["m23"], M[:, 1, 2], rtol=0, atol=1e-14 * abs(M).max())

figure = Figure(figsize=(7, 3.6), layout="constrained")
ax = figure.subplots()
for name, values in curves.items():
    ax.plot(np.rad2deg(elbow), values, label=name)
ax.axhline(0, color="black", linewidth=0.8)
ax.set(
    xlabel="angle of the elbow [deg]",
    ylabel="entry of the mass matrix [kg m²]",
    xticks=range(-180, 181, 60),
)
ax.legend(frameon=False)
figure
