"""Accuracy of identifications: python -m benchmarks.identification [--quick]

The IRB 140 with friction, measured by sensors of which everything is known: 200 runs with noise on the torques alone,
and runs with coarse encoders and clocks. Writes benchmarks/results/identification.json and the tables of
docs/benchmarks/identification.md.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import rne
from benchmarks.identification_tables import noise_table, rewrite_page, sensor_table
from benchmarks.measure import is_quick, write
from rne.basics.inertia import pseudo_inertia
from rne.identification import Identification
from tests.measurements import Truth, record, truth

VISCOUS, COULOMB = np.array([8, 6, 2, 1.2, 1.4, 0.6]), np.array([6, 8, 6, 2, 2.4, 0.5])  # [N m s/rad], [N m]
NOISE = np.array([1.5, 1.5, 0.9, 0.3, 0.3, 0.3])  # standard deviation of each torque [N m]
CLOCK = 2e-5  # largest error of a stamp [s], 1 % of the period
ENCODERS = (17, 13, 11)  # bits per turn of the joint
FITTED, OTHER = (1, 11), 2  # seeds of the motions


def scene() -> rne.Scene:
    """The IRB 140 with friction that is nearly a step."""
    friction = rne.Friction(viscous=VISCOUS, coulomb=COULOMB, smoothing=1e-4)
    return rne.Scene(rne.load("irb140"), friction=friction)


def true_values(found: Identification) -> Any:
    """The base parameters behind the torques."""
    standard = found.standard.values.copy()
    standard[found.standard.groups["Fv"]], standard[found.standard.groups["Fc"]] = VISCOUS, COULOMB
    return found.base.matrix @ standard


def errors(found: Identification) -> Any:
    """(estimate - truth) / standard error of each base parameter."""
    return (found.estimate.values - true_values(found)) / found.estimate.errors


def is_consistent(found: Identification) -> bool:
    """True if some distribution of mass has each body."""
    bodies = found.parameters[found.standard.groups["bodies"]]
    return bool((np.linalg.eigvalsh(pseudo_inertia(bodies)) > 0).all())


def noise_on_torques(runs: int) -> dict[str, Any]:
    """One motion, measured again and again with other noise on the torques."""
    arm = scene()
    motion = truth(arm, seed=FITTED[0])
    found = [
        rne.identify(
            arm.robot,
            record(motion, seed, torque_noise=NOISE),
            drives=rne.DriveModel(friction="viscous+coulomb"),
            folds=2,
            cutoff=10.0,
        )
        for seed in range(runs)
    ]
    z = np.array([errors(one) for one in found])
    inside = np.abs(z) < 3
    return {
        "runs": runs,
        "parameters": z.shape[1],
        "within three": float(inside.mean()),
        "least of a parameter": float(inside.mean(0).min()),
        "all at once": float(inside.all(1).mean()),
        "error / standard error": float(np.sqrt((z**2).mean())),
        "consistent": sum(is_consistent(one) for one in found),
    }


def sensors(bits: int, cutoff: float, runs: int) -> dict[str, Any]:
    """Two motions with encoders, clocks and noise; torques of a third predicted."""
    arm, kw = scene(), {"torque_noise": NOISE, "encoder_step": 2 * np.pi / 2**bits, "clock": CLOCK}
    motions, other = [truth(arm, seed=seed) for seed in FITTED], truth(arm, seed=OTHER)
    z, ratios, consistent = [], [], 0
    for seed in range(runs):
        records = [record(motion, 1000 * k + seed, **kw) for k, motion in enumerate(motions)]
        found = rne.identify(
            arm.robot, records, drives=rne.DriveModel(friction="viscous+coulomb"), folds=2, cutoff=cutoff
        )
        z.append(errors(found))
        ratios.append(prediction(found, other, 5000 + seed, kw))
        consistent += is_consistent(found)
    bias = np.abs(np.mean(z, 0))
    worst = int(np.argmax(bias))
    return {
        "bits": bits,
        "cutoff": cutoff,
        "runs": runs,
        "error / noise": [float(x) for x in np.max(ratios, axis=0)],
        "bias / standard error": float(np.sqrt((bias**2).mean())),
        "worst bias": float(bias[worst]),
        "of": found.base.names[worst],
        "consistent": consistent,
    }


def prediction(found: Identification, motion: Truth, seed: int, sensors: dict[str, Any]) -> Any:
    """Error of the torques predicted for a motion over the noise of those measured, after the filter, per joint."""
    measured = record(motion, seed, **sensors)
    check, prepared = found.check(measured), measured.prepare(found.records[0].cutoff)
    exact = np.stack([np.interp(prepared.t, motion.t, tau) for tau in motion.tau.T], axis=1)
    return check.rms / (prepared.reduce(prepared.tau) - prepared.reduce(exact)).std(0)


def main() -> None:
    quick = is_quick(__doc__)
    runs, few = (4, 1) if quick else (200, 20)
    coverage = noise_on_torques(runs)
    cases = [sensors(bits, cutoff, few) for bits in ENCODERS for cutoff in (4.0, 10.0, 30.0)]
    print(noise_table(coverage), sensor_table(cases), sep="\n\n")
    if quick:
        return
    write("identification.json", {"noise on torques": coverage, "sensors": cases})
    rewrite_page()


if __name__ == "__main__":
    main()
