"""Robust laws from worst-case starts: python -m benchmarks.robust_laws [--quick] [--starts N] [--only LAW ...]

The IRB 140 with the payload and a link's mass at the ends of their ranges, controlled by each robust law. Motions start
at the edge of the set that the law's proof says is never left: the composite error on its ellipsoid, the positions on
the reference or off it by the whole bound. Written: how many motions stay within the stated bound; the bound over the
largest error of motions that begin on the reference; the bound over that of the rule before proofs (1.1 times the
largest of random configurations).
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np

import rne
from benchmarks.measure import RESULTS, command_line, write
from rne.basics.spatial import Array
from rne.control.robust_laws import Robust, RobustLaw, RobustPassive
from rne.control.uncertainty import MARGIN, checked_cases

PAYLOAD, DEPTH = 3.0, (0.0, 0.0, 0.1)  # largest mass, its centre before the flange [kg, m]
LINK, SPREAD = 2, 0.1  # body whose mass is known within 10 %
BANDWIDTH, KD = 20.0, np.array([40, 60, 20, 4, 2, 1.0])  # [1/s, N m s/rad]
CENTRE, RADIUS = np.array([0, 0.2, -0.3, 0.2, 0.8, 0.1]), np.array([0.4, 0.3, 0.3, 0.4, 0.4, 0.5])  # [rad]
SECONDS = 1.0
LAWS = ("robust", "passive", "sliding")
SIDEWAYS = 0.1  # random part of the directions after the first ones
ROUNDING = 1e-6  # relative, of integrations at 1e-8


def circle(t: Any) -> tuple[Array, Array, Array]:
    """Neighbouring joints run on circles at 0.5 Hz."""
    angle = np.pi * np.asarray(t) + np.array([0, np.pi / 2] * 3)
    return (
        CENTRE + RADIUS * np.sin(angle),
        RADIUS * np.pi * np.cos(angle),
        -RADIUS * np.pi**2 * np.sin(angle),
    )


def corners() -> list[rne.Robot]:
    """The arm at the ends of the ranges of its payload and of a link's mass."""
    robot = rne.load("irb140")
    at_link = np.arange(robot.model.nb) == LINK
    robots = []
    for factor in (1 - SPREAD, 1 + SPREAD):
        scale = np.where(at_link, factor, 1.0)
        m = robot.model
        arm = rne.Robot(replace(m, mass=m.mass * scale, inertia=m.inertia * scale[:, None, None]))
        robots += [arm, arm.with_payload(PAYLOAD, com=DEPTH)]
    return robots


def laws(cases: list[rne.Robot]) -> dict[str, RobustLaw]:
    """The three laws with layers in proportion to the inverse roots of the inertias."""
    middle = checked_cases(cases).centre
    layer = 0.1 / np.sqrt(np.diag(middle.mass_matrix(circle(0)[0])))
    rho = rne.control.uncertainty_bound(middle, cases, BANDWIDTH, layer, circle, 2.0)
    return {
        "robust": rne.control.robust(middle, BANDWIDTH, layer, circle, rho),
        "passive": rne.control.robust_passive(cases, KD, BANDWIDTH, circle, boundary=0.3),
        "sliding": rne.control.sliding_mode(cases, BANDWIDTH, layer, circle),
    }


def level(law: Any) -> float:
    """Level of s^T M s at the edge of the proven invariant set; of |z|^2 for the law with rho."""
    if isinstance(law, Robust):
        return 1.0
    if isinstance(law, RobustPassive):
        return law.cases.inertia_bounds(1 / np.sqrt(law.kd))[0] * law.boundary / 4
    return float(law.cases.inertia_bounds(law.boundary)[0])


def largest_error(law: Any, plant: rne.Robot, size: float, force: Array, off: Array) -> Array:
    """Largest error of each joint over its bound in one motion; `off` are signs of the first errors, or zeros.

    Of all s on the ellipsoid it starts with the one that is largest in the direction of `force`. The layer of the law
    with rho is stiff, up to 1e5 / s without payload: an implicit method.
    """
    e = law.error_bound * off
    q_ref, qd_ref, _ = law.reference(0.0)
    M = np.diag(law.boundary**-2.0) if isinstance(law, Robust) else plant.mass_matrix(q_ref + e)
    z = np.linalg.solve(M, force)
    s = z * np.sqrt(size / (z @ M @ z))
    motion = rne.simulate(
        rne.Scene(plant, controller=law), q_ref + e, qd_ref + s - law.bandwidth * e, SECONDS,
        t_eval=np.linspace(0, SECONDS, 501), method="Radau" if isinstance(law, Robust) else "DOP853",
        rtol=1e-8, atol=1e-10,
    )  # fmt: skip
    return np.asarray(np.abs(motion.q - law.reference(motion.t[:, None])[0]).max(axis=0) / law.error_bound)


def sampled_bound(law: Any) -> Array:
    """The error bound by the rule before proofs: MARGIN times the largest of random configurations."""
    if isinstance(law, Robust):
        return np.asarray(law.error_bound)
    scale = 1 / np.sqrt(law.kd) if isinstance(law, RobustPassive) else law.boundary
    model = law.robot.model
    q = np.random.default_rng(0).uniform(model.lower, model.upper, (2000, model.n))
    M = np.concatenate([robot.mass_matrix(q) for robot in law.cases.robots])
    largest = MARGIN * np.linalg.eigvalsh(M * np.outer(scale, scale))[:, -1].max()
    inverse = MARGIN * np.diagonal(np.linalg.inv(M), axis1=1, axis2=2).max(axis=0)
    share = law.boundary / 4 if isinstance(law, RobustPassive) else 1.0
    return np.asarray(np.sqrt(largest * share * inverse) / law.bandwidth)


def campaign(law: RobustLaw, cases: list[rne.Robot], starts: int, seed: int = 0) -> dict[str, Any]:
    """Motions with one joint after the other as fast as the edge allows, on and off the reference."""
    n = law.robot.n
    rng, within, seen, size = np.random.default_rng(seed), 0, np.zeros(n), level(law)
    for k in range(starts):
        force = rng.choice([-1.0, 1.0]) * np.eye(n)[k // 2 % n] + SIDEWAYS * rng.normal(size=n) * (k >= 2 * n)
        off = rng.choice([-1.0, 1.0], n) if k % 2 else np.zeros(n)
        share = largest_error(law, cases[int(rng.integers(len(cases)))], size, force, off)
        within += bool((share <= 1 + ROUNDING).all())
        seen = seen if k % 2 else np.maximum(seen, share)
    before = law.error_bound / sampled_bound(law)
    return {"starts": starts, "within": within, "bound_over_seen": (1 / seen).tolist(), "over_before": before.tolist()}


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--starts", type=int, default=67, help="motions of each law")
    parser.add_argument("--only", nargs="+", default=list(LAWS), choices=LAWS, help="laws to run anew")
    given = parser.parse_args()
    cases, kept = corners(), RESULTS / "robust_laws.json"
    made, results = laws(cases), json.loads(kept.read_text(encoding="utf-8"))["laws"] if kept.exists() else {}
    print("| law | irb140 | bound / largest error, by joint | bound / bound before |\n|---|---|---|---|")
    for name in given.only:
        found = results[name] = campaign(made[name], cases, 2 if given.quick else given.starts)
        ratios = [", ".join(f"{x:.2f}" for x in found[key]) for key in ("bound_over_seen", "over_before")]
        print(f"| {name} | {found['within']} of {found['starts']} within | {' | '.join(ratios)} |", flush=True)
        if not given.quick:
            write("robust_laws.json", {"laws": results})


if __name__ == "__main__":
    main()
