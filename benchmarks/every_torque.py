"""Every torque and wrench against Pinocchio, joint by joint.

What Pinocchio computes, it computes on its own reading of the URDF, to which it adds payload, armature and mounting by
its own functions. Friction is not in its model: the formula is added to its torques.

A small joint's error is not hidden behind a large joint's torque: each difference is relative to that joint's own size,
the largest value of its terms |M| |qdd| + |C qd| + |g| over the states. A joint whose terms vanish in every state, as
gravity's at a vertical axis, has the size of the moment or force that it carries. The size of a force is its largest
length over the states; of a moment, that of |n| + |v| |m v|: Pinocchio adds v x m v, which is zero but for rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

import rne
from rne.commands.agreement import random_states
from rne.commands.oracle import Oracle, each
from rne.model.abb_irb140 import CLOSED_LOOPS, KD, KP
from rne.urdf.loading import urdf_files

MASS, COM, INERTIA = 3.0, np.array([0.05, -0.1, 0.2]), np.diag([0.02, 0.03, 0.04])  # the payload, on a tool's frame
RPY = np.array([0.3, -0.7, 1.1])  # the mounting, on no axis
VISCOUS, COULOMB, SMOOTHING = 1.5, 2.5, 0.3
WRENCH = np.array([1.0, -2.0, 3.0, 40.0, -50.0, 60.0])  # [moment; force] on the same link [N m, N]
STIFF, DAMPED = 100.0, 20.0  # gains of the controllers
VANISHES = 1e-12  # of the moment that a joint carries: only rounding is left of its torque


class Arm(NamedTuple):
    """A robot, the URDF that Pinocchio reads, and the link that carries the payload."""

    robot: rne.Robot
    xml: str
    link: str


class Difference(NamedTuple):
    """The largest difference of each joint, over the states, relative to the joint's own size."""

    quantity: str
    joints: tuple[str, ...]
    worst: np.ndarray


class Wrenches(NamedTuple):
    """Force and moment of each joint on its body at the joint in the body's axes, (N, nb, 3), and their sizes."""

    f: np.ndarray
    n: np.ndarray
    f_sizes: np.ndarray
    n_sizes: np.ndarray


class Twin(Oracle):
    """Twin of a robot in Pinocchio, where payload, mounting and armature can be added to it."""

    def __init__(self, arm: Arm, *, payload: bool = False, mounted: bool = False, armature: Any = None) -> None:
        super().__init__(arm.robot.model, arm.xml)
        if payload:
            frame = self.theirs.frames[self.theirs.getFrameId(arm.link, pin.FrameType.BODY)]
            self.theirs.appendBodyToJoint(frame.parentJoint, pin.Inertia(MASS, COM, INERTIA), frame.placement)
        if mounted:
            turned = pin.SE3(pin.rpy.rpyToMatrix(RPY), np.zeros(3))
            for k in range(1, self.theirs.njoints):
                if self.theirs.parents[k] == 0:
                    self.theirs.jointPlacements[k] = turned * self.theirs.jointPlacements[k]
        if armature is not None:
            theirs = np.zeros(self.theirs.nv)
            theirs[self.v] = armature
            self.theirs.armature = theirs
        self.data = self.theirs.createData()

    def torques(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """`rnea`, shape (N, n)."""
        return each(self.inverse_dynamics, q, qd, qdd)

    def inverse_dynamics_under(self, wrench: np.ndarray, link: str, *state: np.ndarray) -> np.ndarray:
        """Torques of one state while a wrench [moment; force] acts on a link at its origin, in its axes."""
        frame = self.theirs.frames[self.theirs.getFrameId(link, pin.FrameType.BODY)]
        forces = pin.StdVec_Force([pin.Force.Zero() for _ in range(self.theirs.njoints)])
        forces[frame.parentJoint] = frame.placement.act(pin.Force(wrench[3:], wrench[:3]))
        return self.inverse_dynamics(*state, forces)

    def wrenches(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> Wrenches:
        """`data.f` of every moving joint after `rnea`."""
        found = []
        for state in zip(q, qd, qdd, strict=True):
            self.inverse_dynamics(*state)
            parts = [(self.data.f[k], self.data.v[k].linear, self.data.h[k].linear) for k in self.joint_ids]
            sizes = ([np.linalg.norm(v) * np.linalg.norm(h)] for _, v, h in parts)
            found.append([[*f.linear, *f.angular, *size] for (f, _, _), size in zip(parts, sizes, strict=True)])
        all_parts = np.array(found)
        f, n = all_parts[..., :3], all_parts[..., 3:6]
        return Wrenches(f, n, lengths(f), lengths(n) + all_parts[..., 6])

    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Angular and linear part of each moving joint's motion after `rnea`, shape (nb, 3) each; one of them is 0."""
        S = np.array([self.data.joints[k].S.ravel() for k in self.joint_ids])
        return S[:, 3:], S[:, :3]

    def sizes(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """The size of each joint over all states: see the module's text. Shape (n,)."""
        M, g = each(self.mass_matrix, q), each(self.gravity_torque, q)
        terms = (np.abs(M) @ np.abs(qdd)[..., None])[..., 0] + np.abs(each(self.bias_torque, q, qd) - g) + np.abs(g)
        wrenches = self.wrenches(q, qd, qdd)
        slides = lengths(self.axes()[1]) > 0
        along = np.where(slides, lengths(wrenches.f), lengths(wrenches.n))
        carried = (along @ np.abs(self.model.coordinate_map)).max(axis=0)
        largest = terms.max(axis=0)
        return np.where(largest > VANISHES * carried, largest, carried)


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Length of each vector, along the last axis."""
    length: np.ndarray = np.linalg.norm(vectors, axis=-1)
    return length


def across(vectors: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Length of the rest without the components along the axes; of all for a zero axis."""
    return lengths(vectors - (vectors * axes).sum(-1, keepdims=True) * axes)


def of_torques(arm: Arm, quantity: str, ours: Any, theirs: np.ndarray, sizes: np.ndarray) -> Difference:
    """One row for torques, shape (N, n)."""
    return Difference(quantity, arm.robot.joint_names, quotients(np.abs(ours - theirs).max(axis=0), sizes))


def of_vectors(arm: Arm, quantity: str, ours: np.ndarray, theirs: np.ndarray, sizes: np.ndarray) -> Difference:
    """One row for wrenches, shape (N, nb, 3), or loads, shape (N, nb), relative to the largest of `sizes`, (N, nb)."""
    apart = np.abs(ours - theirs) if ours.ndim == 2 else lengths(ours - theirs)
    apart = np.where(np.isnan(apart), 0.0, apart)  # forces between fingers that mimic each other are not known
    return Difference(quantity, arm.robot.model.moving_joints, quotients(apart.max(axis=0), sizes.max(axis=0)))


def quotients(differences: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Differences relative to sizes; 0 where there is none, infinite where only the size is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(differences == 0, 0.0, differences / sizes)


def of_states(arm: Arm, states: tuple[np.ndarray, ...]) -> Iterator[Difference]:
    """Torques, wrenches and bearing loads of the robot alone."""
    robot, twin = arm.robot, Twin(arm)
    q, qd, _ = states
    still, tau = np.zeros_like(q), robot.inverse_dynamics(*states)
    yield of_torques(arm, "inverse dynamics", tau, twin.torques(*states), twin.sizes(*states))
    gravity, sizes = each(twin.gravity_torque, q), twin.sizes(q, still, still)
    yield of_torques(arm, "gravity", robot.gravity_torque(q), gravity, sizes)
    bias, sizes = each(twin.bias_torque, q, qd), twin.sizes(q, qd, still)
    yield of_torques(arm, "bias", robot.bias_torque(q, qd), bias, sizes)
    record, (f, n, f_sizes, n_sizes) = robot.recursion(*states), twin.wrenches(*states)
    yield of_vectors(arm, "joint force f", record.f, f, f_sizes)
    yield of_vectors(arm, "joint moment tau", record.tau, n, n_sizes)
    force, torque = rne.dynamics.bearing_loads(record, robot.model)
    s, t = twin.axes()
    yield of_vectors(arm, "bearing force", force, across(f, t), f_sizes)
    yield of_vectors(arm, "bearing torque", torque, across(n, s), n_sizes)


def of_edits(arm: Arm, states: tuple[np.ndarray, ...]) -> Iterator[Difference]:
    """Torques of the robot with payload, mounting, armature, friction or a wrench on the link that carries."""
    robot, model = arm.robot, arm.robot.model
    inertias = np.linspace(0.1, 0.5, model.nb)
    geared = rne.Robot(replace(model, armature=inertias))
    loaded = robot.with_payload(MASS, COM, INERTIA, arm.link)
    for quantity, edited, edits in (
        ("payload", loaded, {"payload": True}),
        ("mounting", robot.mounted(RPY), {"mounted": True}),
        ("armature", geared, {"armature": inertias}),
    ):
        twin = Twin(arm, **edits)
        yield of_torques(arm, quantity, edited.inverse_dynamics(*states), twin.torques(*states), twin.sizes(*states))
    twin = Twin(arm)
    scene = rne.Scene(robot, friction=rne.Friction(VISCOUS, COULOMB, smoothing=SMOOTHING))
    rubbing = friction(states[1])
    sizes = twin.sizes(*states) + np.abs(rubbing).max(axis=0)
    yield of_torques(arm, "friction", scene.inverse_dynamics(*states), twin.torques(*states) + rubbing, sizes)
    ours = robot.inverse_dynamics(*states, external={arm.link: WRENCH})
    pushed = each(partial(twin.inverse_dynamics_under, WRENCH, arm.link), *states)
    sizes = twin.sizes(*states) + np.abs(pushed - twin.torques(*states)).max(axis=0)
    yield of_torques(arm, "wrench on a link", ours, pushed, sizes)


def friction(qd: np.ndarray) -> np.ndarray:
    """Viscous and smoothed Coulomb friction."""
    return VISCOUS * qd + COULOMB * np.tanh(qd / SMOOTHING)


def of_controllers(arm: Arm, states: tuple[np.ndarray, ...]) -> Iterator[Difference]:
    """Torques of PD with gravity compensation and of computed torque towards a moving reference."""
    robot, twin = arm.robot, Twin(arm)
    q, qd, _ = states
    n, still = robot.n, np.zeros_like(q)
    goal, sizes = np.linspace(-1, 1, n), twin.sizes(q, still, still)
    kp, kd = 0.2 * sizes, 0.1 * sizes  # feedback about as large as gravity's torque, at every joint
    feedback = -kp * (q - goal) - kd * qd
    ours = rne.control.pd_gravity(robot, kp, kd, goal)(0.0, q, qd)
    sizes += np.abs(feedback).max(axis=0)
    yield of_torques(arm, "pd_gravity", ours, each(twin.gravity_torque, q) + feedback, sizes)
    kp, kd = np.full(n, STIFF), np.full(n, DAMPED)
    path = rne.trajectories.quintic(np.zeros(n), goal, 2.0)
    position, rate, acceleration = path(0.7)
    commanded = acceleration - kd * (qd - rate) - kp * (q - position)
    ours = rne.control.computed_torque(robot, kp, kd, path)(0.7, q, qd)
    yield of_torques(arm, "computed_torque", ours, twin.torques(q, qd, commanded), twin.sizes(q, qd, commanded))


def of_runs(arm: Arm) -> Iterator[Difference]:
    """Torques of simulated runs at every sample: a free swing, the closed loops of the IRB 140, and a driven run."""
    robot, n = arm.robot, arm.robot.n
    start, rest = np.linspace(0.3, -0.3, n), np.zeros(n)
    yield of_run(arm, "free swing", Twin(arm), rne.simulate(robot, start, rest, 0.5, method="DOP853"))
    if robot.model.name == "irb140":
        yield from of_closed_loops(arm)
    path = rne.trajectories.quintic(start, rest, 0.5)
    inertias = np.linspace(0.1, 0.5, robot.model.nb)
    geared = rne.Robot(replace(robot.model, armature=inertias))
    scene = rne.Scene(
        geared,
        mounting=RPY,
        payload=rne.Payload(MASS, COM, INERTIA, arm.link),
        friction=rne.Friction(VISCOUS, COULOMB, smoothing=SMOOTHING),
        controller=rne.control.computed_torque(robot, np.full(n, STIFF), np.full(n, DAMPED), path),
    )
    twin = Twin(arm, payload=True, mounted=True, armature=inertias)
    motion = rne.simulate(scene, start, rest, 0.5, method="DOP853")
    yield of_run(arm, "driven run", twin, motion, friction(motion.qd))


def of_closed_loops(arm: Arm) -> Iterator[Difference]:
    """Torques of the thesis's closed loops: those of the motion, and those of the control law."""
    twin = Twin(arm)
    for k, run in enumerate(CLOSED_LOOPS):
        law = rne.control.pd_gravity(arm.robot, KP, KD, run.reference)
        motion = rne.simulate(rne.Scene(arm.robot, controller=law), run.start, np.zeros(6), run.duration)
        yield of_run(arm, f"closed loop 6.5-{k + 1}", twin, motion)
        feedback = -np.array(KP) * (motion.q - run.reference) - np.array(KD) * motion.qd
        asked = each(twin.gravity_torque, motion.q) + feedback
        sizes = twin.sizes(motion.q, motion.qd, motion.qdd)
        yield of_torques(arm, f"law of 6.5-{k + 1}", motion.tau, asked, sizes)


def of_run(arm: Arm, name: str, twin: Twin, motion: rne.Trajectory, losses: Any = 0.0) -> Difference:
    """Torques that a run reports at every sample against `rnea` of its states and accelerations, plus the friction."""
    states = motion.q, motion.qd, motion.qdd
    sizes = twin.sizes(*states) + np.abs(losses + np.zeros_like(motion.q)).max(axis=0)
    return of_torques(arm, name, motion.tau, twin.torques(*states) + losses, sizes)


def arms() -> dict[str, Arm]:
    """The IRB 140; the UR5; and the Panda, whose two sliding fingers branch off, the second as a mimic of the first."""
    files = urdf_files()
    found = {"irb140": Arm(rne.load("irb140"), rne.to_urdf(rne.irb140()), "tool0")}
    for name, path, link in (
        ("ur5", "ur_description/ur5_robot", "tool0"),
        ("panda", "panda_description/panda", "panda_hand"),
    ):
        found[name] = Arm(rne.load(files[path]), files[path].read_text(), link)
    return found


def differences(arm: Arm, samples: int, seed: int = 0) -> list[Difference]:
    """Everything, over random states and over runs."""
    states = random_states(arm.robot.n, samples, seed)
    return [*of_states(arm, states), *of_edits(arm, states), *of_controllers(arm, states), *of_runs(arm)]
