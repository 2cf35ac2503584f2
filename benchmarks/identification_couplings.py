"""Coupled robots from measured motions: python -m benchmarks.identification_couplings [--quick]

A palletiser whose elbow and wrist are moved by four-bars, and a wrist that two motors bend and turn together: 100 runs
each, with other motions and other noise. Errors over their standard errors of all base parameters, of a load's mass and
centre, and of drive gains. Writes benchmarks/results/identification_couplings.json and its table.
"""

from __future__ import annotations

import logging
from functools import cache
from typing import Any

import numpy as np

import rne
from benchmarks.identification_payload import by_quantity
from benchmarks.identification_tables import rewrite_page
from benchmarks.measure import is_quick, write
from rne.identification import Record
from rne.model import coupled, four_bar
from rne.model.builder import Part, assemble, pose
from tests.measurements import Truth, fourier_series

DURATION, RATE = 20.0, 100.0  # [s], [Hz]
NOISE = 0.01  # of a joint's largest torque, standard deviation
ROTOR, VISCOUS, COULOMB = 0.2, 2.0, 1.5  # of each drive [kg m^2, N m s/rad, N m]
REACH = 0.8  # of a joint's range, or of 2.5 rad either way
MOTION = 0.1, 5, 1.5  # lowest frequency [Hz], number of harmonics, speed [rad/s]
INERTIA = np.array([[0.04, 0.006, 0.002], [0.006, 0.06, 0.004], [0.002, 0.004, 0.08]])
LOAD = rne.Payload(3.0, (0.06, 0.04, 0.08), np.diag([0.02, 0.03, 0.025]), "wrist")
Y = (0.0, 1.0, 0.0)


def part(name: str, parent: int, at: Any, axis: Any = Y, drive: float = 0.0, reach: float = 3.0) -> Part:
    """A body of 2 kg that is not symmetric, on a joint of its name."""
    body: dict[str, Any] = {"mass": 2.0, "com": np.array([0.1, 0.03, 0.05]), "inertia": INERTIA}
    placement = pose(np.eye(3), np.array(at))
    limits: dict[str, Any] = {"lower": -reach, "upper": reach, "armature": drive}
    return Part(
        link=name,
        joint=name,
        kind="revolute",
        parent=parent,
        placement=placement,
        axis=np.array(axis),
        **body,
        **limits,
    )


@cache
def palletiser() -> rne.Robot:
    """An elbow that a lever on the upper arm moves by a four-bar, and a wrist that another keeps nearly level."""
    tree = assemble(
        "palletiser",
        [
            Part(link="base"),
            part("turntable", 0, (0, 0, 0.3), (0, 0, 1), ROTOR),
            part("upper", 1, (0, 0, 0.3), drive=ROTOR, reach=0.8),
            part("forearm", 2, (0, 0, 0.6), reach=1.2),
            part("lever", 2, (0, 0.1, 0), drive=ROTOR, reach=0.8),
            part("rod", 4, (-0.25, 0, 0), reach=1.5),
            part("tie", 2, (0.05, 0.2, 0.8), reach=1.5),
            part("wrist", 3, (0.7, 0, 0), reach=2.0),
        ],
    )
    elbow = (("rod", (0.05, 0, 0.65)), ("forearm", (-0.2, 0.1, 0.05)))
    level = (("tie", (0.65, 0, 0.05)), ("wrist", (0, 0.2, 0.25)))
    return rne.Robot(four_bar(four_bar(tree, "forearm", level), "lever", elbow))


@cache
def wrist() -> rne.Robot:
    """Two motors on a forearm that bend a wrist by half their sum and turn it by half their difference."""
    tree = assemble(
        "coupled wrist",
        [
            Part(link="base"),
            part("forearm", 0, (0, 0, 0), drive=ROTOR),
            part("a", 1, (0, 0, 0.1), (1, 0, 0), ROTOR),
            part("b", 1, (0, 0.1, 0.1), (1, 0, 0), ROTOR),
            part("bend", 1, (0.3, 0, 0)),
            part("wrist", 4, (0.1, 0, 0), (1, 0, 0)),
        ],
    )
    both = {"bend": (("a", "b"), lambda a, b: (a + b) / 2), "wrist": (("a", "b"), lambda a, b: (a - b) / 2)}
    return rne.Robot(coupled(tree, both))


ROBOTS = {"palletiser": palletiser, "coupled wrist": wrist}


def truth(robot: rne.Robot, seed: int, load: rne.Payload | None = None, seconds: float = DURATION) -> Truth:
    """A seeded Fourier motion within the ranges and its torques, with rotors and friction."""
    base, harmonics, speed = MOTION
    limits, t = robot.model.coordinate_limits(), np.arange(int(seconds * RATE)) / RATE
    low, high = (np.clip(limits[name], -2.5, 2.5) for name in ("lower", "upper"))
    a, b = np.random.default_rng(seed).normal(size=(2, robot.n, harmonics)) * speed
    q, qd, qdd = fourier_series(t, base, a, b)
    scale = REACH * (high - low) / np.ptp(q, axis=0)
    middle = (low + high) / 2 - scale * (q.max(0) + q.min(0)) / 2
    q, qd, qdd = middle + scale * q, scale * qd, scale * qdd
    arm = robot if load is None else robot.with_payload(*load)
    return Truth(t, q, qd, qdd, arm.inverse_dynamics(q, qd, qdd) + VISCOUS * qd + COULOMB * np.sign(qd))


def log(robot: rne.Robot, motion: Truth, seed: int, gains: Any = 1.0) -> Record:
    """A record of the driven joints, with noise of the torques, which are divided by the drives' gains."""
    noise = NOISE * np.abs(motion.tau).max(0) * np.random.default_rng(seed + 1000).normal(size=motion.tau.shape)
    return Record(motion.t, motion.q, (motion.tau + noise) / gains, joint_names=robot.joint_names)


def planted(base: Any) -> Any:
    """The true base parameters."""
    drives = np.repeat([ROTOR, VISCOUS, COULOMB, 0.0], base.standard.model.n)
    return base.of(np.concatenate([base.standard.values[base.standard.groups["bodies"]], drives]))


def parameters(name: str, runs: int) -> dict[str, Any]:
    """Errors of the base parameters over their standard errors, and of torques of another motion, of some runs."""
    options: dict[str, Any] = {"consistent": False, "causes": False}  # which change no base parameter
    robot, found = ROBOTS[name](), []
    for seed in range(runs):
        estimate = rne.identify(robot, log(robot, truth(robot, 2 * seed), seed), **options)
        other = truth(robot, 2 * seed + 1)
        off = estimate.predict(other.q, other.qd, other.qdd) - other.tau
        z = (estimate.estimate.values - planted(estimate.base)) / estimate.estimate.errors
        found.append({"z": z.tolist(), "error": (off.std(0) / other.tau.std(0)).tolist(), "doubt": len(estimate.doubt)})
    return {"robot": name, "count": len(z), "runs": by_quantity(found)}


def two_logs(robot: rne.Robot, seed: int, gains: Any = 1.0) -> list[Record]:
    """Records without and with the load, of different motions."""
    return [log(robot, truth(robot, 2 * seed + k, x), 2 * seed + k, gains) for k, x in enumerate((None, LOAD))]


def loads(name: str, runs: int) -> dict[str, Any]:
    """Errors of a load's mass and centre, of some runs."""
    robot, found = ROBOTS[name](), []
    for seed in range(runs):
        estimate = rne.identify_payload(robot, *two_logs(robot, seed), link="wrist")
        off = [estimate.mass - LOAD.mass, *(estimate.com - LOAD.com)]
        known = [estimate.mass_error, *estimate.com_error]
        found.append({"off": off, "z": np.divide(off, known).tolist()})
    return {"robot": name, "runs": by_quantity(found)}


def gains(name: str, runs: int) -> dict[str, Any]:
    """Errors of drive gains, of some runs; NaN where not identifiable."""
    robot, found = ROBOTS[name](), []
    for seed in range(runs):
        true = np.random.default_rng(seed).uniform(2, 20, robot.n)
        estimate = rne.identify_drive_gains(robot, *two_logs(robot, seed, true), LOAD)
        found.append(
            {
                "error": (estimate.gains / true - 1).tolist(),
                "z": ((estimate.gains - true) / estimate.errors).tolist(),
            }
        )
    return {"robot": name, "runs": by_quantity(found)}


def within(case: dict[str, Any]) -> tuple[float, int]:
    """Share of all estimates within three standard errors, and their number."""
    z = np.array([[float(x) for x in run.split()] for run in case["runs"]["z"]])
    known = z[np.isfinite(z)]
    return float((np.abs(known) < 3).mean()), len(known)


def main() -> None:
    quick = is_quick(__doc__)
    logging.getLogger("rne").setLevel("ERROR")
    runs, few = (2, 1) if quick else (100, 40)
    found = {
        "parameters": [parameters(name, runs) for name in ROBOTS],
        "loads": [loads(name, few) for name in ROBOTS],
        "gains": [gains(name, few) for name in ROBOTS],
    }
    for what, cases in found.items():
        for case in cases:
            share, count = within(case)
            print(f"{what} of the {case['robot']}: {100 * share:.1f} % of {count} within three standard errors")
    if not quick:
        write("identification_couplings.json", found)
        rewrite_page()


if __name__ == "__main__":
    main()
