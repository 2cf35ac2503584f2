"""Loads and drive gains from measured motions: python -m benchmarks.identification_payload [--quick]

Arms with friction and seeded loads of 1 to 5 kg: 100 runs each, with another load, other motions and other noise.
Writes benchmarks/results/identification_payload.json and the tables of docs/benchmarks/identification-payload.md.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

import rne
from benchmarks.identification_tables import gain_table, load_table, rewrite_page
from benchmarks.measure import is_quick, write
from rne.identification import Record
from tests.measurements import Truth, truth

ROBOTS = ("irb140", "ur5", "panda")
DURATION, RATE = 20.0, 250.0  # [s], [Hz]
NOISE = 0.01  # of a joint's largest torque, standard deviation
FRICTION = 0.05  # of a joint's largest torque: Coulomb friction, and viscous friction at 1 rad/s
PLAIN, HARMONIC, SCALED = "as modelled", "harmonic", "torques off by 3 %"
OF_LOAD = (0.03, 0.12)  # Coulomb friction of harmonic drives, of the torque of the bodies
SATURATION = (0.5, 2.0)  # speeds at which viscous friction of harmonic drives has half its slope [rad/s]
FACTORS = 0.03  # standard deviation of torque factors, of each joint


class Arm(NamedTuple):
    """A robot and the link that its load is on."""

    robot: rne.Robot
    link: str


def arm(name: str) -> Arm:
    """The IRB 140, the UR5, or the Panda's arm, its fingers locked."""
    robot, link = rne.load(name), {"panda": "panda_hand_tcp"}.get(name, "tool0")
    return Arm(robot.locked({"panda_finger_joint1": 0.0}) if name == "panda" else robot, link)


def random_load(link: str, rng: np.random.Generator) -> rne.Payload:
    """A box of 1 to 5 kg up to 0.1 m off the flange's axis."""
    mass, com, sides = rng.uniform(1, 5), rng.uniform([-0.1, -0.1, 0.0], [0.1, 0.1, 0.15]), rng.uniform(0.03, 0.2, 3)
    return rne.Payload(mass, com, mass / 12 * np.diag((sides**2).sum() - sides**2), link)


def logs(
    one: Arm, load: rne.Payload, seed: int, gains: Any = 1.0, encoder: float = 0.0, drives: str = PLAIN
) -> list[Record]:
    """Records without and with the load, of different motions; torques divided by the drives' gains."""
    size = np.abs(truth(one.robot, duration=5.0, rate=50.0).tau).max(0)
    rng, records, n = np.random.default_rng([seed, *one.robot.model.name.encode()]), [], one.robot.n
    of_load, saturation, factors = rng.uniform(*OF_LOAD, n), rng.uniform(*SATURATION, n), rng.normal(1, FACTORS, n)
    for k, arm_alone in enumerate((one.robot, one.robot.with_payload(*load))):
        motion: Truth = truth(arm_alone, DURATION, RATE, seed=2 * seed + k)
        viscous, coulomb = FRICTION * size * motion.qd, FRICTION * size
        if drives == HARMONIC:
            coulomb = coulomb + of_load * np.abs(motion.tau)
            viscous = viscous * 2 / (1 + np.abs(motion.qd) / saturation)
        tau = motion.tau + viscous + coulomb * np.tanh(motion.qd / 1e-4)
        tau = tau * factors if drives == SCALED else tau
        q = encoder * np.rint(motion.q / encoder) if encoder else motion.q
        tau = tau + NOISE * np.abs(tau).max(0) * rng.normal(size=q.shape)
        records.append(Record(motion.t, q, tau / gains))
    return records


def loads(name: str, runs: int, bits: int = 0, drives: str = PLAIN) -> dict[str, Any]:
    """Errors of the masses, centres and inertias found in a number of runs."""
    one, found = arm(name), []
    for seed in range(runs):
        load = random_load(one.link, np.random.default_rng(seed))
        records = logs(one, load, seed, encoder=2 * np.pi / 2**bits if bits else 0.0, drives=drives)
        estimate = rne.identify_payload(one.robot, *records, link=one.link)
        of_inertia = (estimate.inertia - load.inertia) / estimate.inertia_error
        found.append(
            {
                "mass": estimate.mass / load.mass - 1,
                "stated": estimate.mass_error / load.mass,
                "mass z": (estimate.mass - load.mass) / estimate.mass_error,
                "com": float(np.linalg.norm(estimate.com - load.com)),
                "com z": float(np.abs((estimate.com - load.com) / estimate.com_error).max()),
                "inertia z": float(np.abs(of_inertia).max()),
                "replaced": estimate.consistent,
            }
        )
    return {"robot": name, "drives": drives, "bits": bits, "runs": by_quantity(found)}


def gains(name: str, runs: int, drives: str = PLAIN, weighed: bool = False) -> dict[str, Any]:
    """Errors of the drive gains found in a number of runs, of the joints of which they are found.

    Of a load that is only `weighed`, the mass alone is given.
    """
    one, found = arm(name), []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        load, true = random_load(one.link, rng), rng.uniform(2, 20, one.robot.n)
        given = rne.Payload(load.mass, link=one.link) if weighed else load
        estimate = rne.identify_drive_gains(one.robot, *logs(one, load, seed, true, drives=drives), given)
        found.append(
            {
                "error": (estimate.gains / true - 1).tolist(),
                "z": ((estimate.gains - true) / estimate.errors).tolist(),
            }
        )
    given = "its mass" if weighed else "mass, centre, inertia"
    return {"robot": name, "drives": drives, "given": given, "runs": by_quantity(found)}


def by_quantity(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Lists of each quantity over the runs, to four digits."""
    return {key: [four_digits(run[key]) for run in runs] for key in runs[0]}


def four_digits(x: Any) -> Any:
    """A number, or several in one text, so that a run takes one line."""
    if isinstance(x, list):
        return " ".join(f"{value:.4g}" for value in x)
    return float(f"{x:.4g}")


def main() -> None:
    quick = is_quick(__doc__)
    runs, few, half = (2, 1, 1) if quick else (100, 40, 20)
    found = {
        "loads": [
            *(loads(name, runs) for name in ROBOTS),
            loads("irb140", few, bits=17),
            *(loads(name, few, drives=HARMONIC) for name in ROBOTS),
            *(loads(name, half, drives=SCALED) for name in ROBOTS),
        ],
        "gains": [
            *(gains(name, few) for name in ROBOTS),
            *(gains(name, half, weighed=True) for name in ROBOTS),
            *(gains(name, half, HARMONIC) for name in ROBOTS),
        ],
    }
    print(load_table(found["loads"]), gain_table(found["gains"]), sep="\n\n")
    if not quick:
        write("identification_payload.json", found)
        rewrite_page()


if __name__ == "__main__":
    main()
