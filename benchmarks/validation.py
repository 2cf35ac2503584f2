"""Worst differences from Pinocchio over random states: python -m benchmarks.validation [--quick]

For the IRB 140, UR5, Panda and every loadable robot of example-robot-data; Pinocchio reads the same files.
Then, for the first three, every torque and wrench joint by joint: see `benchmarks.every_torque`.
Writes benchmarks/results/validation.json.
"""

from __future__ import annotations

import rne
from benchmarks.every_torque import Difference, arms, differences
from benchmarks.measure import is_quick, write
from benchmarks.pages import table
from rne.commands.agreement import against_pinocchio
from rne.urdf.loading import urdf_files

NAMED = ("ur_description/ur5_robot", "panda_description/panda")
QUANTITIES = ["inverse dynamics", "mass matrix", "gravity", "bias"]
AFTER = "forward after inverse"


def compare(robot: rne.Robot, samples: int, xml: str | None = None) -> dict[str, float]:
    """Worst relative difference by quantity; forward dynamics is left out where M is singular."""
    worst: dict[str, float] = {}
    try:
        for row in against_pinocchio(robot, samples, xml):
            worst[row.quantity] = row.worst
    except rne.SingularMassMatrixError:
        worst["singular"] = 1.0
    return worst


def every_data_robot(samples: int) -> dict[str, dict[str, float]]:
    """Every robot of example-robot-data that loads and has a joint."""
    found = {}
    for name, path in sorted(urdf_files().items()):
        try:
            robot = rne.load(path)
        except rne.UrdfError:
            continue
        if robot.n:
            found[name] = compare(robot, samples, path.read_text())
    return found


def joint_by_joint(found: dict[str, list[Difference]]) -> str:
    """A row for each robot and quantity, a column for each joint; a mimic joint has wrenches but no torque."""
    most = max(len(one.joints) for rows in found.values() for one in rows)
    rows = [
        [name, one.quantity, *(f"{x:.1e}" for x in one.worst), *["-"] * (most - len(one.joints))]
        for name, robot_rows in found.items()
        for one in robot_rows
    ]
    return table(["robot", "quantity", *(f"joint {k + 1}" for k in range(most))], rows)


def by_quantity(found: dict[str, list[Difference]]) -> dict[str, dict[str, list[float]]]:
    """Results in the form kept in JSON."""
    return {name: {one.quantity: one.worst.tolist() for one in rows} for name, rows in found.items()}


def main() -> None:
    quick = is_quick(__doc__)
    samples, files = 3 if quick else 1000, urdf_files()
    results = {"irb140": compare(rne.load("irb140"), samples)}
    results |= {name: compare(rne.load(files[name]), samples, files[name].read_text()) for name in NAMED}
    others = {} if quick else every_data_robot(samples // 50)
    if others:
        worst = {quantity: max(row[quantity] for row in others.values()) for quantity in QUANTITIES}
        results[f"worst of {len(others)} data robots"] = worst
    columns = [*QUANTITIES, AFTER]
    rows = [[name, *(f"{row[k]:.1e}" if k in row else "-" for k in columns)] for name, row in results.items()]
    print(table(["robot", *columns], rows))
    singular = sorted(name for name, row in others.items() if "singular" in row)
    print(f"\nM is singular, and forward dynamics raises SingularMassMatrixError, on: {', '.join(singular) or 'none'}")
    found = {name: differences(arm, samples) for name, arm in arms().items() if name == "irb140" or not quick}
    print("\nJoint by joint, relative to the joint's own terms |M| |qdd| + |C qd| + |g|, or to its wrench:\n")
    print(joint_by_joint(found))
    worst = max((one.worst.max(), name, one.quantity) for name, rows in found.items() for one in rows)
    print("\nworst: {:.1e}, {}, {}".format(*worst))
    if not quick:
        joints = by_quantity(found)
        write("validation.json", {"samples": samples, "worst": results, "robots": others, "joint by joint": joints})


if __name__ == "__main__":
    main()
