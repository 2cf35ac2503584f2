r"""
The closed loop as an FMU
=========================

Other simulators, of a line, a vehicle or a plant, take models as Functional Mock-up
Units: a file with a description and a library in C that need no Python. This tutorial
exports an arm with its sampled controller, simulates the unit with fmpy and compares it
with ``rne.simulate``, and adds a payload after the export.

Needs: ``pip install '.[plot,fmu]'``; without fmpy, or without a compiler, the unit is
written, but not simulated.
"""

import importlib.util
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import rne

# %%
# The scene
# ---------
# The controller is sampled at 500 Hz, and its torques act 1 ms late. Its reference is
# constant, so it becomes an input of the unit.

robot = rne.load("irb140").with_armature([2, 2, 1, 0.2, 0.2, 0.1])
friction = rne.Friction(viscous=[10, 10, 5, 0.5, 0.5, 0.2])
gains = [400, 400, 200, 40, 40, 20], [60, 60, 30, 6, 6, 3]
law = rne.control.pd_gravity(robot, *gains, 0.0)
scene = rne.Scene(
    robot, controller=law, friction=friction, sample_time=2e-3, delay=1e-3
)

# %%
# The unit
# --------
# ``payload`` is the link to which a body can be attached in the other simulator. Most
# simulators read FMI 2.0; ``fmi="3.0"`` writes the newer standard. Each file serves
# co-simulation, where the unit brings its own integrator, and model exchange, where the
# simulator integrates. Without ``platforms`` the file contains a library for each
# platform that can be built here: all platforms with Zig, which the extra installs,
# otherwise only this machine's. For the first unit on a machine Zig compiles its own
# libraries for each platform, which takes a minute or more; with
# ``platforms=["x86_64-linux"]`` it takes seconds.

folder = tempfile.TemporaryDirectory()
path = Path(folder.name, "arm.fmu")
built = scene.to_fmu(path, payload="tool0")
print("binaries for", ", ".join(built) or "no platform")

# %%
# In another simulator
# --------------------
# Two set-points are given as a table. The first run is without payload, the second with
# 4 kg at the tool, 0.1 m in front of it.

first, second = np.array([0.6, 0.4, -0.3, 0.5, -0.4, 0.8]), np.zeros(6)
t = np.linspace(0, 2, 201)
names = [f"q[{k}]" for k in range(1, 7)]
payloads = {"alone": 0.0, "with 4 kg": 4.0}


def by_fmpy(mass):
    """Positions from the unit."""
    import fmpy

    rows = [(0.0, *first), (1.0, *first), (1.0, *second), (2.0, *second)]
    columns = ["time", *(f"reference[{k}]" for k in range(1, 7))]
    table = np.array(rows, dtype=[(name, float) for name in columns])
    found = fmpy.simulate_fmu(
        str(path),
        fmi_type="CoSimulation",
        stop_time=2.0,
        output_interval=0.01,
        relative_tolerance=1e-10,
        input=table,
        start_values={"payload.mass": mass, "payload.com[3]": 0.1},
        output=names,
    )
    return np.stack([found[name] for name in names], axis=-1)


def by_rne(mass):
    """Positions from the scene itself."""
    steps = rne.trajectories.sampled([0.0, 1.0, 3.0], [first, second, second])
    other = rne.Scene(
        robot,
        controller=rne.control.pd_gravity(robot, *gains, steps),
        friction=friction,
        sample_time=2e-3,
        delay=1e-3,
        payload=rne.Payload(mass, com=[0, 0, 0.1], link="tool0"),
    )
    how = {"rtol": 1e-10, "atol": 1e-12, "t_eval": t}
    return rne.simulate(other, [0] * 6, [0] * 6, 2.0, **how).q


ours = {label: by_rne(mass) for label, mass in payloads.items()}
theirs = {}
if built and importlib.util.find_spec("fmpy"):
    theirs = {label: by_fmpy(mass) for label, mass in payloads.items()}
    worst = max(abs(theirs[label] - ours[label]).max() for label in payloads)
    print(f"fmpy and rne differ by {worst:.0e} rad")
    assert worst < 1e-7

# %%
# With the payload joint 2 sags: the controller compensates only the weight of the arm.

figure = Figure(figsize=(6.4, 3.4), layout="constrained")
ax = figure.subplots()
for k, (label, q) in enumerate(ours.items()):
    ax.plot(t, q[:, 1], f"C{k}", label=f"rne.simulate, {label}")
    if theirs:
        marks = theirs[label][::8, 1]
        ax.plot(t[::8], marks, f"C{k}o", markersize=4, label=f"the unit, {label}")
ax.set(xlabel="time [s]", ylabel="position of joint 2 [rad]")
ax.grid(alpha=0.3)
ax.legend(frameon=False)
folder.cleanup()
figure
