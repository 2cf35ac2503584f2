"""The picture of docs/getting-started.md, by the lines of the page: python docs/pictures/first_simulation.py"""

from pathlib import Path

import numpy as np

import rne

robot = rne.load("irb140")
law = rne.control.pd_gravity(robot, kp=[50] * 6, kd=[20] * 6, reference=[0.5] * 6)
scene = rne.Scene(robot, controller=law, payload=2.0, friction=rne.Friction(viscous=1.0))
motion = rne.simulate(scene, np.zeros(6), np.zeros(6), duration=10.0)
rne.plotting.plot(motion).savefig(Path(__file__).with_suffix(".png"), dpi=90, facecolor="white")
