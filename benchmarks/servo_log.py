"""A measured hobby servo with a weight on an arm, fitted without torques: python -m benchmarks.servo_log FOLDER

FOLDER has servo_without_torques.npz, 14 motions of commands [rad] and positions [rad] at 50 Hz, of mauicv/servo-sysid.
Prints the residual of fits from four starts, those of seven folds, and the causes that are named; a fit by hand of ten
numbers left 10.65 mrad. Writes nothing.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import rne
from rne.identification import Record

STARTS = {  # gain [N m/rad], stall torque [N m], no-load speed [rad/s]
    "as typed": (2.0, 2.0, 5.0),
    "stiff": (6.0, 2.0, 3.0),
    "weak": (1.0, 0.7, 5.0),
    "fast": (2.0, 1.0, 20.0),
}
URDF = """<robot name="servo"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.1"/><mass value="0.28"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="servo"
type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="2"
velocity="6"/></joint></robot>"""
PERIOD = 0.02  # [s]


def records(folder: Path) -> list[Record]:
    """The motions."""
    with np.load(folder / "servo_without_torques.npz") as arrays:
        names = sorted({name.rsplit("_", 1)[0] for name in arrays})
        each = [(name, arrays[f"{name}_q"], arrays[f"{name}_command"]) for name in names]
    return [
        Record(PERIOD * np.arange(len(q)), q[:, None].astype(float), command=u[:, None].astype(float), name=name)
        for name, q, u in each
    ]


def scene(kp: float, stall: float, speed: float) -> rne.Scene:
    """The servo with its weight, where a fit starts."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "servo.urdf"
        path.write_text(URDF)
        robot = rne.load(path, engine="numba")
    law = rne.control.servo(robot, kp, 0.05, 0.0, stall_torque=stall, no_load_speed=speed)
    friction = rne.Friction(viscous=0.02, coulomb=0.02, smoothing=0.05)
    return rne.Scene(robot, controller=law, friction=friction, armature=0.005)


def main() -> None:
    logs = records(Path(sys.argv[1]))
    for name, numbers in STARTS.items():
        began = time.process_time()
        found = rne.identify_motion(scene(*numbers), logs)
        spent = time.process_time() - began
        print(f"{name:9s} {1e3 * found.rms[0]:6.2f} mrad rms, {spent:.1f} s of CPU")
    found = rne.identify_motion(scene(*STARTS["as typed"]), logs, folds=7)
    print(f"seven folds {1e3 * found.validation_error[0]:.2f} mrad rms")
    print(found.report())


if __name__ == "__main__":
    main()
