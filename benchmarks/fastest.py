"""Time-optimal motions beside toppra with Pinocchio: python -m benchmarks.fastest [PATHS].

For each robot, random paths, every second one with friction: limits at 10,000 points by this engine and by Pinocchio,
the share of the time at a limit, the duration beside toppra's own with Pinocchio as its inverse dynamics on the same
grid, and the CPU time of both on this grid; the whole call, which also finds the grid, is timed apart. Then motions
without smoothing and with the default followed in simulations.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import rne
from rne.commands.oracle import Oracle
from rne.trajectories.time_optimal import FastestMotion, _Piece, _solve

POINTS = 10_000
ROBOTS = ("ur5", "irb140", "panda")


def robot_named(name: str, engine: str = "numpy") -> rne.Robot:
    """A robot with limits: stated here are those that its file does not give."""
    robot = rne.load(name, engine=engine)
    if name == "ur5":
        return robot.with_limits(acceleration=40.0)
    if name == "irb140":
        return robot.with_limits(effort=[250, 250, 150, 50, 50, 20])
    return robot.locked({joint: 0.02 for joint in robot.joint_names if "finger" in joint})


def random_path(robot: rne.Robot, rng: np.random.Generator) -> rne.trajectories.Path:
    """A path through two to six points, inside the joints' ranges."""
    low, high = np.maximum(robot.lower, -3), np.minimum(robot.upper, 3)
    while True:
        points = rng.uniform(low, high, (rng.integers(2, 7), robot.n))
        path = rne.trajectories.through((low + high) / 2 + 0.6 * (points - (low + high) / 2))
        q = path.pieces[0](np.linspace(0, 1, 400))
        if (q > robot.lower).all() and (q < robot.upper).all():
            return path


def friction_of(robot: rne.Robot) -> rne.Friction:
    """A twentieth of the torque limits as Coulomb friction, as much viscous friction at the largest velocity."""
    coulomb = 0.05 * robot.effort_limit
    return rne.Friction(viscous=coulomb / robot.velocity_limit, coulomb=coulomb, smoothing=0)


def toppra_with_pinocchio(motion: FastestMotion, oracle: Oracle) -> float:
    """Duration of toppra's own solution on the grids of the motion, with the friction at its velocities.

    Where a joint turns, its Coulomb friction jumps, and toppra asks for it once per grid point: there the grid has a
    point on either side.
    """
    import toppra.algorithm as algorithm
    import toppra.constraint as constraint
    from toppra.interpolator import AbstractGeometricPath

    limits, both = motion._limits, constraint.DiscretizationType.Interpolation
    torques = np.stack([-limits.known["effort_limit"], limits.known["effort_limit"]], axis=1)
    names, pin = limits.friction, oracle.pin
    total = 0.0
    for curve, profile in zip(motion.path.pieces, motion._profiles, strict=True):

        class Curve(AbstractGeometricPath):
            dof, path_interval = motion.path.points.shape[1], np.array([0.0, 1.0])

            def __call__(self, s, order=0, curve=curve):
                return curve(s, order)

        def friction(path, s, profile=profile):
            rate = path(s, 1)
            speed = rate * np.sqrt(np.interp(s, profile.grid, profile.x))
            return names.coulomb_torque(rate) + names.viscous_torque(speed)

        def inverse_dynamics(q, qd, qdd):
            return np.array(pin.rnea(oracle.theirs, oracle.data, q, qd, qdd))

        turns = (np.abs(curve(profile.grid, 1)) < 1e-9).any(1)
        sides = [profile.grid[turns] - 1e-9, profile.grid[turns] + 1e-9]
        faces, bounds = np.vstack([np.eye(Curve.dof), -np.eye(Curve.dof)]), np.concatenate([torques[:, 1]] * 2)
        parts = [
            constraint.SecondOrderConstraint(
                inverse_dynamics, lambda q, F=faces: F, lambda q, g=bounds: g, Curve.dof, friction, both
            ),
            constraint.JointVelocityConstraint(limits.known["velocity_limit"]),
        ]
        if np.isfinite(limits.known["acceleration_limit"]).all():
            parts.append(constraint.JointAccelerationConstraint(limits.known["acceleration_limit"], both))
        solver = algorithm.TOPPRA(
            parts,
            Curve(),
            gridpoints=np.sort(np.concatenate([profile.grid[~turns], *sides])),
            solver_wrapper="seidel",
            parametrizer="ParametrizeConstAccel",
        )
        total += solver.compute_trajectory().duration
    return total


def largest_shares(motion: FastestMotion, oracle: Oracle, points: int = POINTS) -> tuple[np.ndarray, np.ndarray]:
    """At equal times within the motion, the largest share of any limit: by this engine, and by Pinocchio."""
    t = (np.arange(points) + 0.5) * (motion.duration / points)
    q, qd, qdd = motion(t)
    limits, friction = motion._limits, motion._limits.friction
    pin = np.array([oracle.inverse_dynamics(*state) for state in zip(q, qd, qdd, strict=True)])
    torques = limits.scene.inverse_dynamics(q, qd, qdd), pin + friction.coulomb_torque(qd) + friction.viscous_torque(qd)
    effort, velocity, acceleration = (limits.known[f"{x}_limit"] for x in ("effort", "velocity", "acceleration"))
    others = np.maximum((np.abs(qd) / velocity).max(1), (np.abs(qdd) / acceleration).max(1))
    ours, theirs = (np.maximum((np.abs(tau) / effort).max(1), others) for tau in torques)
    return ours, theirs


def largest_deviation(motion: FastestMotion, step: float = 1e-3) -> float:
    """Largest deviation from the path, under PD control at 1 kHz with the planned torques as feed-forward.

    Each sample holds the mean of the planned torques over it, which gives the arm their impulse even where they jump
    within a sample; gains are for a bandwidth of 60 rad/s of each joint alone.
    """
    robot = motion.scene.resolved.robot
    inverse = np.linalg.inv(robot.mass_matrix(motion(np.linspace(0, motion.duration, 200))[0]))
    inertia = (1 / np.diagonal(inverse, axis1=-2, axis2=-1)).min(0)
    kp, kd = 60.0**2 * inertia, 2 * 60.0 * inertia
    t = np.arange(int(motion.duration / step) + 1) * step
    within = t[:, None] + (np.arange(20) + 0.5) / 20 * step
    planned = motion.torques(within.ravel()).reshape(*within.shape, robot.n).mean(1)
    q_ref, qd_ref, _ = motion(t)

    def law(time, q, qd):
        k = round(time / step)
        return planned[k] - kp * (q - q_ref[k]) - kd * (qd - qd_ref[k])

    scene = rne.Scene(robot, controller=law, sample_time=step)
    run = rne.simulate(scene, motion.path.points[0], np.zeros(robot.n), t[-1], t_eval=t)
    return float(np.abs(run.q - q_ref).max())


def following(name: str, paths: int) -> None:
    """Print how far arms are off their paths, without smoothing and with the default, and its cost in time."""
    robot = robot_named(name, "numba")
    for smoothing in (0, None):
        found = []
        for seed in range(paths):
            path = random_path(robot, np.random.default_rng(seed))
            motion = rne.trajectories.fastest(robot, path, smoothing=smoothing)
            found.append([largest_deviation(motion), motion.duration - motion.unsmoothed_duration])
        off, cost = np.array(found).T
        kind = "by default" if smoothing is None else "without smoothing"
        print(
            f"{name}, {paths} motions {kind}: off their paths by {np.median(off):.2g} rad, at most {off.max():.2g}; "
            f"at most {cost.max():.3g} s longer"
        )


def campaign(name: str, paths: int) -> None:
    """Print the worst and the median figures of a robot."""
    robot = robot_named(name)
    oracle = Oracle(robot.model, rne.to_urdf(robot.model))
    rows = []
    for seed in range(paths):
        rng = np.random.default_rng(seed)
        motion, refused = None, 0
        while motion is None:
            path, friction = random_path(robot, rng), friction_of(robot) if seed % 2 else None
            begin = time.process_time()
            try:
                motion = rne.trajectories.fastest(robot, path, friction=friction, smoothing=0)
            except ValueError:
                refused += 1
        ours = time.process_time() - begin
        begin = time.process_time()
        duration = toppra_with_pinocchio(motion, oracle)
        theirs = time.process_time() - begin
        profile, begin = motion._profiles[0], time.process_time()
        _solve(_Piece(motion._limits, motion.path, 0), profile.grid, profile.x)
        same = time.process_time() - begin
        shares = largest_shares(motion, oracle)
        rows.append(
            [shares[0].max() - 1, shares[1].max() - 1, (np.minimum(*shares) < 0.99).mean(), np.minimum(*shares).min()]
            + [
                abs(motion.duration / duration - 1),
                len(motion._profiles[0].grid),
                ours,
                same,
                theirs,
                theirs / same,
                theirs / ours,
                refused,
            ]
        )
    table = np.array(rows)[1:] if paths > 1 else np.array(rows)  # the first call traces
    heads = (
        "excess here|excess, Pinocchio|below 99 %|lowest share|duration|grid|s, whole call|s, same grid|"
        "s, toppra and Pinocchio|ratio, same grid|ratio, whole call|refused"
    )
    print(f"{name}, {paths} paths")
    for head, column in zip(heads.split("|"), table.T, strict=True):
        print(f"  {head:26s} median {np.median(column):.3g}, {column.min():.3g} to {column.max():.3g}")


if __name__ == "__main__":
    for robot_name in ROBOTS:
        number = int(sys.argv[1]) if len(sys.argv) > 1 else 100
        campaign(robot_name, number)
        following(robot_name, number)
