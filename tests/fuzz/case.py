"""A simulation scene as plain numbers, and the script that runs it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

GRID = 20  # intervals of the times at which motions are compared
HEAD = """import numpy as np, rne
from rne.basics.spatial import rotation_from_rpy
from rne.model.builder import Mimic, Part, assemble, pose
def link(k, kind, parent, xyz, rpy, axis, **rest):
    place, unit = pose(rotation_from_rpy(rpy), xyz), np.array(axis) / np.linalg.norm(axis)
    return Part(link=f"l{k}", joint=f"j{k}", kind=kind, parent=parent + 1, placement=place, axis=unit, **rest)"""


@dataclass(frozen=True)
class Joint:
    """A joint and its link; `parent` is another joint or -1, `mimic` (joint, multiplier, offset)."""

    kind: str
    parent: int
    xyz: list[float]
    rpy: list[float]
    axis: list[float]
    mass: float
    com: list[float]
    inertia: list[list[float]]
    lower: float = -np.inf
    upper: float = np.inf
    mimic: tuple[int, float, float] | None = None
    armature: float = 0.0

    def text(self, k):
        """The call that makes this joint's Part."""
        words = [f"link({k}, {self.kind!r}, {self.parent}, {self.xyz}, {self.rpy}, {self.axis}, mass={self.mass}"]
        words += [f"com={self.com}", f"inertia={self.inertia}"]
        words += [f"{name}={getattr(self, name)}" for name in ("lower", "upper") if np.isfinite(getattr(self, name))]
        if self.armature:
            words.append(f"armature={self.armature}")
        if self.mimic is not None:
            words.append(f"mimic=Mimic({self.mimic[0] + 1}, {self.mimic[1]}, {self.mimic[2]})")
        return ", ".join(words) + ")"


@dataclass(frozen=True)
class Case:
    """Everything that rne.simulate and the oracle need. `law` has its `kind` and its numbers; see laws.py."""

    seed: int
    joints: list[Joint]
    gravity: list[float]
    q0: list[float] = field(default_factory=list)
    qd0: list[float] = field(default_factory=list)
    duration: float = 1.0
    method: str = "auto"
    scene_gravity: list[float] | None = None
    mounting: list[float] | None = None
    payload: tuple[Any, ...] | None = None
    locked: dict[int, float] = field(default_factory=dict)
    armature: list[float] | None = None
    friction: dict[str, Any] | None = None
    effort_limit: list[float] | None = None
    torque_rate: list[float] | None = None
    stops: bool = False
    law: dict[str, Any] | None = None
    sample_time: float | None = None

    @property
    def sticks(self):
        """True for dry friction."""
        return self.friction is not None and self.friction.get("smoothing") == 0

    @property
    def grid(self):
        """The times at which motions are compared."""
        return np.linspace(0, self.duration, GRID + 1)

    @property
    def as_torque(self):
        """True if the law is given to `simulate` as `torque=`, not to the scene as its controller."""
        if self.law is None or self.sample_time is not None:
            return False
        return self.law["kind"] == "constant" or (self.law["kind"] in ("sines", "switch", "pd") and self.seed % 2 == 0)

    def script(self, engine="numpy"):
        """A script of its own that runs the case by rne; the motion is `motion`."""
        lines = [HEAD, 'parts = [Part(link="root")]']
        lines += [f"parts += [{joint.text(k)}]" for k, joint in enumerate(self.joints)]
        lines += [f'robot = rne.Robot(assemble("fuzz{self.seed}", parts, gravity={self.gravity}), "{engine}")']
        base = self._base()
        if self.law is not None:
            law = LAWS["array" if self.as_torque and self.law["kind"] == "constant" else self.law["kind"]]
            lines += [f"model = rne.Scene(robot{base}).resolved.robot"] if "(model" in law else []
            lines += [law.format(**_arrays(self.law))]
        lines += [f"scene = rne.Scene(robot{base}{self._parts()})"]
        given = ", torque=law" if self.as_torque else ""
        lines += [
            f"motion = rne.simulate(scene, {self.q0}, {self.qd0}, {self.duration}{given}, method={self.method!r}, rtol=1e-9, "
            f"atol=1e-12, t_eval=np.linspace(0, {self.duration}, {GRID + 1}))"
        ]
        return "\n".join(lines) + "\n"

    def _base(self):
        """The parts of the scene that the controller's model knows."""
        words = ""
        if self.scene_gravity is not None:
            words += f", gravity={self.scene_gravity}"
        if self.mounting is not None:
            words += f", mounting={self.mounting}"
        if self.locked:
            words += f", locked={ {f'j{k}': value for k, value in self.locked.items()} }"
        return words

    def _parts(self):
        words = ""
        if self.payload is not None:
            mass, com, inertia, link = self.payload
            words += f", payload=rne.Payload({mass}, {com}, {inertia}, 'l{link}')"
        if self.friction is not None:
            words += f", friction=rne.Friction({', '.join(f'{k}={v}' for k, v in self.friction.items())})"
        for name in ("armature", "effort_limit", "torque_rate", "sample_time"):
            if getattr(self, name) is not None:
                words += f", {name}={getattr(self, name)}"
        if self.stops:
            words += ", stops=True"
        return words + (", controller=law" if self.law is not None and not self.as_torque else "")


LAWS = {
    "constant": "law = lambda t, q, qd: {u}",
    "array": "law = {u}",
    "sines": "law = lambda t, q, qd: {size} * np.sin({omega} * t + {phase})",
    "pd": "law = lambda t, q, qd: -{kp} * (q - {ref}) - {kd} * qd",
    "saturating": "law = lambda t, q, qd: np.clip(-{kp} * (q - {ref}) - {kd} * qd, -{bound}, {bound})",
    "switch": "law = lambda t, q, qd: {before} if t < {time} else {after}\nlaw.breaks = [{time}]",
    "traced": "law = rne.traceable(lambda t, q, qd: rne.elementwise.clip({size} * np.sin({omega} * t) - {kp} * (q - {ref}), "
    "-{bound}, {bound}) - {kd} * qd)",
    "filter": "law = lambda t, q, qd, z: (-{kp} * (q - {ref}) - z, ({kd} * qd - z) / {lag})\nlaw.states = {states}",
    "control.pd": "law = rne.control.pd(model, {kp}, {kd}, {ref})",
    "control.pd_gravity": "law = rne.control.pd_gravity(model, {kp}, {kd}, {ref})",
    "control.pid": "law = rne.control.pid(model, {kp}, {ki}, {kd}, {ref}, gravity={gravity}, windup={windup})",
    "control.computed_torque": "law = rne.control.computed_torque(model, {kp}, {kd}, rne.trajectories.quintic({start}, {end}, "
    "{time}))",
}


def _arrays(law):
    return {name: f"np.array({value})" if isinstance(value, list) else value for name, value in law.items()}
