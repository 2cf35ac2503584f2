"""The Robotics Toolbox for Python: its DH robots, whose recursion is in C.

Our robot is given modified Denavit-Hartenberg frames, and its masses and inertias are turned into them. The mass
matrix and the forward dynamics are the toolbox's own: a Python loop over the states around the recursion in C.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import rne
from benchmarks.peers.registry import Case, Point, peer

STATES = 200  # of the calls that loop in Python
PARALLEL = 1e-9  # sine between axes, and distance [m], taken for zero


@peer("roboticstoolbox", requirement="roboticstoolbox-python>=1.5", modules=("roboticstoolbox",))
def points(case: Case) -> list[Point]:
    """The toolbox's call for many states."""
    robot = dh_robot(case.robot.model)
    call = {"inverse_dynamics": robot.rne, "mass_matrix": robot.inertia, "forward_dynamics": robot.accel}[case.quantity]
    count = len(case.states[0]) if case.quantity == "inverse_dynamics" else min(len(case.states[0]), STATES)
    arrays = [a[:count] for a in case.arrays]
    return [Point("roboticstoolbox, batch", lambda: call(*arrays), count, lambda few: np.asarray(call(*arrays))[:few])]


def dh_robot(model: rne.Model) -> Any:
    """The toolbox's robot with our model's dynamics."""
    from roboticstoolbox import DHRobot, RevoluteMDH
    from spatialmath import SE3

    if set(model.joint_types) - {"revolute", "continuous"} or list(model.parent) != list(range(-1, model.n - 1)):
        raise ValueError("only chains of revolute joints are converted to DH parameters here")
    bodies = _poses(model)
    frames = _dh_frames(bodies, model)
    links, before = [], frames[0]
    for i, frame in enumerate(frames):
        alpha, a, theta, d = _parameters(np.linalg.solve(before, frame))
        body = np.linalg.solve(frame, bodies[i])
        R = body[:3, :3]
        numbers = {"m": model.mass[i], "r": R @ model.com[i] + body[:3, 3], "I": R @ model.inertia[i] @ R.T}
        drive = {"Jm": model.armature[i], "G": 1.0}
        links.append(RevoluteMDH(d=d, a=a, alpha=alpha, offset=theta, **numbers, **drive))
        before = frame
    base = SE3(frames[0], check=False)
    return DHRobot(links, base=base, gravity=model.gravity)


def _poses(model: rne.Model) -> list[np.ndarray]:
    """Poses of the bodies at q = 0, from the base."""
    poses, pose = [], np.eye(4)
    for R, p in zip(model.rotation, model.translation, strict=True):
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = R, p
        pose = pose @ step
        poses.append(pose)
    return poses


def _dh_frames(bodies: list[np.ndarray], model: rne.Model) -> list[np.ndarray]:
    """At q = 0, from the base: z along the joint's axis, x along the common normal to the next."""
    z = [T[:3, :3] @ axis for T, axis in zip(bodies, model.axis, strict=True)]
    p = [T[:3, 3] for T in bodies]
    x, origin = np.cross(z[0], np.eye(3)[np.argmin(abs(z[0]))]), p[0]
    frames = []
    for i in range(len(z)):
        origin = p[i] + z[i] * (z[i] @ (origin - p[i]))
        if i + 1 < len(z):
            normal, apart = np.cross(z[i], z[i + 1]), p[i + 1] - origin
            between = apart - z[i] * (z[i] @ apart)
            if np.linalg.norm(normal) > PARALLEL:
                origin = origin + z[i] * np.linalg.det([apart, z[i + 1], normal]) / (normal @ normal)
                x = normal
            elif np.linalg.norm(between) > PARALLEL:
                x = between
        x = x / np.linalg.norm(x)
        frame = np.eye(4)
        frame[:3] = np.column_stack([x, np.cross(z[i], x), z[i], origin])
        frames.append(frame)
    return frames


def _parameters(T: np.ndarray) -> tuple[float, float, float, float]:
    """alpha, a, theta and d of T = Rx(alpha) Tx(a) Rz(theta) Tz(d)."""
    alpha, theta = np.arctan2(-T[1, 2], T[2, 2]), np.arctan2(-T[0, 1], T[0, 0])
    return alpha, T[0, 3], theta, np.cos(alpha) * T[2, 3] - np.sin(alpha) * T[1, 3]
