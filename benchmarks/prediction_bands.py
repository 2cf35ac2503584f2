"""Torques of other motions within the 95 % bands of identified robots: python -m benchmarks.prediction_bands

Four arms of tests/faulty_logs.py move along random Fourier series of 20 s with 1 % of noise; each is identified from
one log and predicts another motion. Friction is that of the fit, or that of harmonic drives, which no parameters give:
it rises with the load and saturates with speed. `--logs` is their number, `--quick` means eight and writes no file, and
`--public FOLDER` adds the published logs of benchmarks.public_logs: motions that were not fitted, or validation blocks.
Writes benchmarks/results/prediction_bands.json and the tables of docs/benchmarks/prediction_bands.md.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import rne
from benchmarks.measure import RESULTS, write
from benchmarks.pages import DOCS, rewrite, table
from benchmarks.public_logs import kr300, pendulum, tx40, ur10
from rne.identification import Check, Identification, Record
from tests import faulty_logs

ARMS = "IRB 140", "UR5", "Panda", "SCARA"
PAGE = DOCS / "benchmarks" / "prediction_bands.md"
FRICTION = {True: "of the fit", False: "of harmonic drives"}
RATE = 250.0  # samples per second


def planted(name: str, seed: int, linear: bool, consistent: bool = False) -> tuple[Identification, Check]:
    """An arm identified from a log, and the prediction of another motion with the same noise."""
    case, rng = faulty_logs.case(name, seed, linear), np.random.default_rng([seed, 4])
    given = faulty_logs.given_robot(case.arm.robot, rng)
    found = rne.identify(given, Record(*faulty_logs.clean(case)), consistent=consistent, causes=False)
    states = faulty_logs.motion(case.arm.robot, rng, case.t)
    body = case.arm.robot.inverse_dynamics(*states)
    other = case._replace(states=states, tau=body + faulty_logs.friction(case.arm, *states[1:], body))
    return found, found.check(Record(*faulty_logs.clean(other)))


def row_of(found: Identification, covered: np.ndarray, **names: Any) -> dict[str, Any]:
    """Coverage of the bands of an identification."""
    said = "The model, not the noise" in found.bands.text(found.initial.joint_names, ["N m"] * found.initial.n)
    return names | {"covered": [float(x) for x in covered], "said": said}


def published(folder: Path) -> list[dict[str, Any]]:
    """Coverage of published logs, of motions that were not fitted or of validation blocks."""
    logs = {"TX40": tx40, "UR10": ur10, "KR300": kr300}
    rows = []
    for name in (*logs, "pendulum dp00", "pendulum dp12", "pendulum sp"):
        measured = logs[name](folder, None) if name in logs else pendulum(name.split()[1], folder, None)
        found, left = measured
        kind = "another motion" if isinstance(left, Check) else "validation blocks"
        covered = left.covered if isinstance(left, Check) else found.bands.covered
        rows.append(row_of(found, covered, robot=name, of=kind))
        print(rows[-1], flush=True)
    return rows


def tables(found: dict[str, Any]) -> dict[str, str]:
    """Tables of the page."""
    rows = []
    for friction in FRICTION.values():
        for arm in (*ARMS, "all"):
            own = [r for r in found["planted"] if r["friction"] == friction and arm in (r["arm"], "all")]
            if not own:
                continue
            shares = [100 * np.mean(r["covered"]) for r in own]
            joints = 100 * np.mean([r["covered"] for r in own], axis=0) if arm != "all" else np.zeros(0)
            low = [r for r, share in zip(own, shares, strict=True) if share < 90]
            of_joints = f"{joints.min():.0f} to {joints.max():.0f}" if len(joints) else ""
            cells = [f"{np.mean(shares):.1f}", of_joints, f"{min(shares):.0f}"]
            rows.append([friction, arm, str(len(own)), *cells, f"{sum(r['said'] for r in low)} of {len(low)}"])
            rows[-1].append(str(sum(r["said"] for r in own)))
    head = ["friction", "arm", "logs", "covered [%]", "by joint [%]", "least of a log [%]", "below 90 %, said", "said"]
    logs = [
        [r["robot"], r["of"], " ".join(f"{100 * x:.0f}" for x in r["covered"]), "yes" if r["said"] else "no"]
        for r in found["public"]
    ]
    return {"planted": table(head, rows), "public": table(["robot", "torques of", "covered [%]", "said"], logs)}


def keep(**changed: Sequence[dict[str, Any]]) -> None:
    """Write the results, those that were not measured again as they were, and the page's tables."""
    path = RESULTS / "prediction_bands.json"
    last = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"planted": [], "public": []}
    kept = {name: last[name] for name in ("planted", "public")} | changed
    write(path.name, kept)
    rewrite(tables(kept), PAGE)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=200)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--public", type=Path)
    given = parser.parse_args()
    warnings.simplefilter("ignore", rne.IdentificationWarning)
    if given.public:
        keep(public=published(given.public))
    faulty_logs.RATE = RATE
    rows: list[dict[str, Any]] = []
    for k in range(8 if given.quick else given.logs):
        arm, linear = ARMS[k % 4], k // 4 % 2 == 0
        found, check = planted(arm, k, linear)
        rows.append(row_of(found, check.covered, arm=arm, friction=FRICTION[linear]))
        print(k, rows[-1], flush=True)
        if not given.quick and k % 8 == 7:
            keep(planted=rows)
    if not given.quick and rows:
        keep(planted=rows)


if __name__ == "__main__":
    main()
