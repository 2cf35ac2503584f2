"""Contacts found and false alarms of the momentum observer: python -m benchmarks.contacts [RUNS [ROBOT ...]].

An arm whose bodies are up to 5 % heavier or lighter than its model's and whose friction differs by up to 20 % follows
random motions by 1 kHz computed torque: left alone, pushed with 2 to 4 times the threshold at one joint, and, in every
fifth run, carrying a payload that the model does not know.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

import rne

STEP, DURATION = 1e-3, 1.0  # [s]
BODIES, FRICTION = 0.05, 0.2  # errors of the model
KP, KD = 400.0, 40.0  # [1/s^2, 1/s]


@dataclass
class Pushed:
    """A law whose arm is pushed from a time on: the drives give the law's torques alone."""

    law: object
    begin: float = np.inf
    push: np.ndarray | float = 0.0

    def __call__(self, t, q, qd):
        return self.law(t, q, qd) + (self.push if t >= self.begin else 0.0)


@dataclass
class Setting:
    """A model with its stated errors, and the robots that bound the real one."""

    robot: rne.Robot
    observer: rne.control.MomentumObserver

    def real(self, rng: np.random.Generator) -> tuple[rne.Robot, rne.Friction]:
        """A robot and a friction within the stated errors."""
        share = rng.dirichlet(np.ones(len(self.observer.cases)))
        parameters = sum(s * case.parameters for s, case in zip(share, self.observer.cases, strict=True))
        known = self.observer.friction
        factor = rng.uniform(1 - FRICTION, 1 + FRICTION, self.robot.n)
        real = rne.Friction(viscous=known.viscous * factor, coulomb=known.coulomb * factor)
        return self.robot.with_parameters(parameters), real


def setting(name: str = "ur5", cases: int = 6) -> Setting:
    """An arm with friction of 2 % of its torque limits, and robots with other masses."""
    robot = rne.load(name, engine="numba")  # friction near rest is stiff: ten times faster than by NumPy
    robot = robot.locked({joint: 0.02 for joint in robot.joint_names if "finger" in joint})
    if not np.isfinite(robot.effort_limit).all():
        robot = robot.with_limits(effort=[250, 250, 150, 50, 50, 20])
    coulomb = 0.02 * robot.effort_limit
    rng = np.random.default_rng(0)
    factors = 1 + BODIES * rng.choice([-1.0, 1.0], (cases, robot.model.nb))
    robots = [robot.with_parameters(np.repeat(factor, 10) * robot.parameters) for factor in factors]
    friction = rne.Friction(viscous=coulomb / 2, coulomb=coulomb)
    floor = 0.005 * robot.effort_limit
    observer = rne.control.MomentumObserver(
        robot, friction=friction, cases=robots, friction_error=FRICTION, floor=floor
    )
    return Setting(robot, observer)


def run(this: Setting, seed: int, begin: float = np.inf, push: np.ndarray | float = 0.0, payload: float = 0.0):
    """Residuals of the observer in a motion of the real robot; a payload is carried from the start."""
    rng = np.random.default_rng(seed)
    middle = (np.maximum(this.robot.lower, -2) + np.minimum(this.robot.upper, 2)) / 2
    start, end = middle + rng.uniform(-1, 1, (2, this.robot.n))
    reference = rne.trajectories.quintic(start, end, DURATION)
    real, friction = this.real(rng)
    real = real.with_payload(payload, link=this.robot.link_names[-1]) if payload else real
    law = Pushed(rne.control.computed_torque(this.robot, KP, KD, reference), begin, push)
    t = np.arange(round(DURATION / STEP) + 1) * STEP
    scene = rne.Scene(real, friction=friction, controller=law, sample_time=STEP)
    motion = rne.simulate(scene, start, np.zeros(this.robot.n), DURATION, t_eval=t)
    drives = motion.tau - np.where(t >= begin, 1.0, 0.0)[:, None] * push
    return this.observer.observe(t, motion.q, motion.qd, drives, held=True)


def pushed_run(this: Setting, seed: int, quiet: rne.control.Residuals):
    """When a push of 2 to 4 thresholds at one joint begins [s], and what the observer sees."""
    rng = np.random.default_rng(10_000 + seed)
    begin = float(rng.integers(300, 700)) * STEP
    k = round(begin / STEP)
    threshold = quiet.threshold[k : k + 20].max(0)
    push = rng.normal(size=this.robot.n) * threshold
    push *= rng.uniform(2, 4) / (np.abs(push) / threshold).max()
    return begin, run(this, seed, begin, push)


def main(runs: int, names: list[str]) -> None:
    for name in names:
        this = setting(name)
        delays, alarms, kinds, called = [], 0, [], []
        for seed in range(runs):
            quiet = run(this, seed)
            alarms += quiet.first_contact is not None
            begin, seen = pushed_run(this, seed, quiet)
            delays.append(np.inf if seen.first_contact is None else seen.first_contact - begin)
            called.append(seen.kind)
            if seed % 5 == 0:
                kinds.append(run(this, seed, payload=4.0).kind)
        found = np.array(delays)
        within = ((found >= 0) & (found <= 0.02)).mean()
        print(
            f"{name}: {runs} pushes, {within:.1%} found within 20 ms, median {1e3 * np.median(found):.1f} ms; "
            f"{alarms} false alarms in {runs} runs; called payloads: {kinds.count('payload')} of {len(kinds)}, "
            f"and {called.count('payload')} of the pushes"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200, sys.argv[2:] or ["ur5", "irb140", "panda"])
