"""Makes closed_loop.gif of README.md: the IRB 140 under PD control with gravity compensation, thesis 6.5-1."""

import sys
from pathlib import Path

import numpy as np

import rne

DURATION = 3.0  # [s]: the joints are within 1 % of their way by then
target = np.array([1.0, 0, -1, 2, 1, -2])  # [rad]
robot = rne.load("irb140")
law = rne.control.pd_gravity(robot, [50] * 5 + [60], [20] * 5 + [22], target)
motion = rne.simulate(rne.Scene(robot, controller=law), np.zeros(6), np.zeros(6), DURATION)
assert abs(motion.q[-1] - target).max() < 0.01 * abs(target).max()
path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".gif")
rne.plotting.animate(robot, motion, path, fps=20)
