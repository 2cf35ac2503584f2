r"""
Looking at a motion
===================

A box of 8 kg is mounted on the forearm of an IRB 140, and it is not in the controller's
model. Numbers show how far the arm sags. A view of both motions, the expected and the
actual one, shows where. The page works in any browser, without network.

Needs: ``pip install '.[plot,view]'``
"""

import tempfile
from pathlib import Path

import numpy as np

import rne

robot = rne.load("irb140")
loaded = robot.with_payload(8.0, com=[0, 0, 0.1], link="link_3")

# %%
# Two motions
# -----------
# Computed torque control moves the arm along a quintic path: once without the load, as
# the controller expects, and once with it.

start, end = np.deg2rad([-50, 20, -40, 0, 30, 0]), np.deg2rad([50, 60, -60, 40, 60, 90])
path = rne.trajectories.quintic(start, end, 1.5)
law = rne.control.computed_torque(robot, [60] * 6, [15] * 6, path)
expected, actual = (
    rne.simulate(rne.Scene(arm, controller=law), start, np.zeros(6), 2.5)
    for arm in (robot, loaded)
)

# %%
# Both are drawn in one set of panels, the second one dashed. Joint 2 needs more torque
# to carry the box, and the arm comes to rest where the error of the joint gives the
# missing torque. Joint 5 is light and is pushed aside while the arm accelerates.

figure = rne.plotting.plot(expected, other=actual, quantities=["q", "tau"])

# %%
# You can evaluate a trajectory at any time. So you can compare the two at the same
# times, although their solvers took different steps.

t = np.linspace(0, 2.5, 251)


def flange(motion):
    """Its origin over time, shape (251, 3) [m]."""
    return robot.link_poses(motion(t)[0])[:, robot.link_names.index("tool0"), :3, 3]


off = 1e3 * np.linalg.norm(flange(actual) - flange(expected), axis=1)
print(f"the flange is up to {off.max():.0f} mm off, {off[-1]:.0f} mm at the end")
assert off[-1] > 10

# %%
# A page to look at
# -----------------
# ``rne.view`` writes the motion as one HTML file. The other motion is half transparent,
# in orange, with the same clock. The page has a slider for the time and a choice of
# speeds. A switch shows the inertias of the model instead of the links, and the list of
# parts shows their frames. Drag to turn the view.

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "sag.html"
    page = rne.view(expected, file, other=actual, labels=("expected", "with 8 kg"))
    size = file.stat().st_size
print(f"one file of {size / 1e6:.1f} MB")
assert size < 2e6

# %%
# In a notebook, make ``page`` the last value of a cell, or call ``page.show()``. You
# can compare a measured motion in the same way, as arrays of times and positions.

page
