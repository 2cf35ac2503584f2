"""Identification from published logs of three real arms and two pendulums: python -m benchmarks.public_logs FOLDER

FOLDER has archives of the numbers of these repositories, which are not part of this one:

tx40.npz  Stäubli TX40, github.com/thanhndv212/figaroh-examples (c0b5c7f, Apache-2.0), and its tx40.urdf: motor_position
          [rad] and motor_torque [N m], shape (T, 6), dt [s], reduction
ur10.npz  UR10, github.com/unisa-acg/inverse-dynamics-solver (41e196d, BSD-3-Clause): t, q, tau
kr300.npz KUKA KR300 R2500, github.com/JonasWeigand/Robot_Identification (9e403c0, MIT): for each of the motions A, B
          and C A_t, A_motor_angle_deg, A_motor_torque_nm, and gear
pendulums.npz  double and simple pendulum, github.com/dfki-ric-underactuated-lab/double_pendulum
          (1e8544e) and torque_limited_simple_pendulum (ed17ea2, both BSD-3-Clause), and their double_pendulum.urdf and
          simple_pendulum.urdf: of the motions dp00, dp12 and sp dp00_t, dp00_q, dp00_qd, dp00_tau

Writes benchmarks/results/public_logs.json and the tables of docs/benchmarks/public-logs.md.
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import rne
from benchmarks.identification_tables import rewrite_page
from benchmarks.measure import write
from rne.identification import Check, Identification, Record

SHAFT = [[0.0, 0.0, 0.0, 0.0, 1.0, 1.0]]  # the TX40's last motor turns with the sum of joints 5 and 6
FOLDS = 20


def tx40(folder: Path, cutoff: float | None, shafts: Any = SHAFT) -> tuple[Identification, Any]:
    """Blocks of 0.45 s, each predicted from the others."""
    log = np.load(folder / "tx40.npz")
    coupling = np.eye(6)
    coupling[5, 4] = 1
    record = Record.from_motors(
        np.arange(len(log["motor_position"])) * float(log["dt"]),
        log["motor_position"],
        log["motor_torque"],
        ratios=log["reduction"],
        coupling=coupling,
        offsets=[0, -np.pi / 2, np.pi / 2, 0, 0, 0],
        name="TX40",
    )
    robot = rne.load(folder / "tx40.urdf")
    drives = rne.DriveModel(rotor=True, friction="viscous+coulomb", offset=True, coupled_motors=shafts)
    found = rne.identify(robot, record, drives=drives, folds=FOLDS, cutoff=cutoff)
    return found, found.held_out


def ur10(folder: Path, cutoff: float | None) -> tuple[Identification, Any]:
    """The first half is fitted, the second predicted."""
    log = np.load(folder / "ur10.npz")
    record = Record(log["t"].astype(float), log["q"], log["tau"], name="UR10")
    half = record.t[len(record.t) // 2]
    found = rne.identify(rne.load("ur10"), record.between(record.t[0], half), cutoff=cutoff)
    return found, found.check(record.between(half, record.t[-1]))


def kr300(folder: Path, cutoff: float | None) -> tuple[Identification, Any]:
    """Motions A and B are fitted, C is predicted; no masses are known."""
    log = np.load(folder / "kr300.npz")
    records = [
        Record(
            log[f"{k}_t"].astype(float),
            log[f"{k}_motor_angle_deg"],
            log[f"{k}_motor_torque_nm"] * log["gear"],
            unit="deg",
            name=k,
        )
        for k in "ABC"
    ]
    turn = np.pi / 2
    model = rne.dh_chain(
        a=[0.35, 1.15, 0.041, 0, 0, 0],
        alpha=[turn, 0, -turn, turn, -turn, 2 * turn],
        d=[-0.675, -0.189, 0.189, -1, 0, -0.24],
        theta=[0, -turn, turn, 0, 0, 0],
        gravity=[0, 0, 9.81],  # the base is turned upside down
    )
    found = rne.identify(rne.Robot(model), records[:2], cutoff=cutoff, consistent=False)
    return found, found.check(records[2])


def pendulum(motion: str, folder: Path, cutoff: float | None) -> tuple[Identification, Any]:
    """Blocks of a tenth of the log, each predicted from the others."""
    log = np.load(folder / "pendulums.npz")
    t, q, qd, tau = (np.asarray(log[f"{motion}_{name}"], float) for name in ("t", "q", "qd", "tau"))
    robot = rne.load(folder / f"{'simple' if motion == 'sp' else 'double'}_pendulum.urdf")
    found = rne.identify(robot, Record(t, q, tau, qd, name=motion), cutoff=cutoff)
    return found, found.held_out


def drive_parameters(found: Identification) -> dict[str, list[float]]:
    """Friction as seen at each joint, that of shafts included."""
    groups, x = found.standard.groups, found.parameters
    shafts = found.standard.motors**2
    seen = {symbol: x[groups[symbol]].copy() for symbol in ("Fv", "Fc")}
    if len(shafts):
        seen["Fv"] += x[groups["Fv of coupled motors"]] @ shafts
    own = {
        f"{s} of coupled motors": x[groups[f"{s} of coupled motors"]].tolist()
        for s in ("Ia", "Fv", "Fc")
        if len(shafts)
    }
    return {symbol: values.tolist() for symbol, values in seen.items()} | own


def main() -> None:
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder, results = Path(sys.argv[1]), []
    cases = (
        ("TX40", tx40, None),
        ("TX40", tx40, 10.0),
        ("TX40 without the shaft", partial(tx40, shafts=None), 10.0),
        ("UR10", ur10, None),
        ("KR300", kr300, None),
        *((f"pendulum {motion}", partial(pendulum, motion), None) for motion in ("dp00", "dp12", "sp")),
    )
    for name, measured, cutoff in cases:
        found, left = measured(folder, cutoff)
        errors = left.relative if isinstance(left, Check) else left
        results.append(
            {
                "robot": name,
                "cutoff": found.records[0].cutoff,
                "chosen": cutoff is None,
                "parameters": found.base.count,
                "condition": found.estimate.condition,
                "error": [100 * float(e) for e in errors],
                **drive_parameters(found),
            }
        )
        print(results[-1], [cause.text for cause in found.causes])
    write("public_logs.json", {"logs": results})
    rewrite_page()


if __name__ == "__main__":
    main()
