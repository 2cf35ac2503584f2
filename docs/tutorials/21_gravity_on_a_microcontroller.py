r"""
Gravity on a microcontroller
============================

A low-cost arm holds itself up if its controller adds the gravity torques. We print them
as C in single precision for the SO-101, count the operations and the memory of a
microcontroller, compile the text here, and compute the errors.

Needs: ``pip install '.[plot,robots]'``, and a C compiler called ``cc``
"""

import ctypes
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import rne

robot = rne.load("so101")
kernel = robot.kernel(rne.dynamics.gravity_torque)
source = kernel.source("c", dtype="float32")
print(*source.splitlines()[:20], "...", sep="\n")

# %%
# One function, one header
# ------------------------
# The file includes ``math.h`` and nothing else. Constants carry an ``f``, functions are
# ``sinf`` and ``cosf``: nothing falls back to double precision, which a small processor
# would have to emulate. (Factors of 1 and 3.7e-6 come from this URDF, which writes
# right angles with six digits.) The heading lists the operations of a call, which are
# always the same, since there is no loop and no branch, and the number of values that
# are stored at once.
#
# The time
# --------
# Suppose a Cortex-M4 at 100 MHz. Its floating-point unit adds or multiplies in one
# cycle; we add one cycle per operation for loads and stores. For a sine we assume 150
# cycles: measure that of your library.

counted = kernel.operations
transcendental = counted["sin"] + counted["cos"]
arithmetic = sum(counted.values()) - transcendental
cycles = 2 * arithmetic + 150 * transcendental
microseconds = cycles / 100
print(f"{arithmetic} sums and products, {transcendental} sines and cosines")
print(f"{cycles} cycles, {microseconds:.0f} us: {microseconds / 10:.1f} % of 1 kHz")
assert microseconds < 50

# %%
# The sines dominate. There is no branch, so if a sine always takes the same time, so
# does every call.
#
# The memory
# ----------

(numbers, size) = re.search(r"Stack - (\d+) values .*, (\d+) bytes", source).groups()
print(f"{numbers} numbers of single precision, {size} bytes of stack, and no heap")

# %%
# The compiler adds saved registers: about 64 bytes here; its option ``-fstack-usage``
# prints the size for your processor. A library's ``sinf`` needs a few more.


# %%
# The error
# ---------
# The servos of this arm have 4096 steps a turn. We take postures on these steps, and
# compare the compiled function with double precision. For comparison we compute the
# effect of half an encoder step: the largest sum of derivatives times half a step, from
# the exact derivative.


def compiled(folder):
    """The function that was printed."""
    code, library = folder / "gravity.c", folder / "gravity.so"
    code.write_text(source)
    flags = ["-O2", "-fPIC", "-shared", "-Wall", "-Werror", "-Wdouble-promotion"]
    subprocess.run(["cc", *flags, str(code), "-o", str(library), "-lm"], check=True)
    function = ctypes.CDLL(str(library)).gravity_torque
    pointer = np.ctypeslib.ndpointer("float32", flags="C")
    function.argtypes, function.restype = [pointer, pointer], None
    return function


step = 2 * np.pi / 4096
rng = np.random.default_rng(0)
q = step * rng.integers(-1024, 1025, (5000, robot.n))
exact = kernel(q)
if shutil.which("cc"):
    with tempfile.TemporaryDirectory() as folder:
        function = compiled(Path(folder))
        single = np.zeros((len(q), robot.n), np.float32)
        for posture, row in zip(q.astype(np.float32), single):
            function(posture, row)
else:
    print("no C compiler here: NumPy's single precision instead")
    single = kernel(q.astype(np.float32))
error = np.abs(single - exact).max(axis=1)
slopes = robot.kernel(rne.dynamics.gravity_torque, "q")(q)
by_encoder = (np.abs(slopes).sum(axis=-1) * step / 2).max(axis=1)
print(f"largest torque {abs(exact).max():.2f} N m")
print(f"single precision: {error.max():.1e} N m at most")
print(f"half a step of the encoders: {by_encoder.max():.1e} N m at most")
assert error.max() < 1e-6 < 1e-4 < by_encoder.max()

# %%
# Single precision is more than three orders of magnitude finer than the encoders, so that double
# precision would be wasted here. Masses from a CAD file are wrong by far more: the
# :doc:`identification tutorial <15_from_a_log_to_a_urdf>` finds better ones.

figure = Figure(figsize=(7, 3.4), layout="constrained")
ax = figure.subplots()
edges = np.geomspace(1e-9, 1e-2, 71)
ax.hist(error, edges, alpha=0.8, label="single precision")
ax.hist(by_encoder, edges, alpha=0.8, label="half a step of the encoders")
ax.set(
    xscale="log",
    xlabel="error of the largest joint torque [N m]",
    ylabel="postures of 5000",
)
ax.legend(frameon=False)
figure

# %%
# Remaining work on the arm
# -------------------------
# Add the torques to those of your controller, in the servo's own unit: for a servo that
# takes a duty cycle or a current, use its gain from a data sheet or from
# :py:obj:`rne.identify_drive_gains`. The zero of ``q`` and its sign are those of the
# URDF. Begin with half of the torque and a hand on the arm.
#
# A function for one joint has only the operations that this joint needs:

print(kernel.source("c", element="g4", dtype="float32"))

# %%
# ``rne source so101 --quantity gravity_torque --language c --dtype float32`` prints the
# file from the command line, and ``--language rust`` a function that needs only
# ``core``. Inverse dynamics and their derivatives print in the same way:
# :doc:`/in-a-control-loop`.
