"""A scene as a Functional Mock-up Unit: its variables, and its equations and law as functions in C."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..basics.text import UNITS as OF_JOINTS
from ..dynamics.quantity import MethodQuantity
from ..export.fmu import TOLERANCE, Unit, Variable
from ..integrators.tableaus import tableau
from ..kernels.kernel import Kernel
from ..kernels.source import Printable, harmless, identifier, to_source
from ..model.parameters import COLUMNS, ENTRIES, ROWS, body_of_parameters, parameters_of_bodies
from ..model.topology import end_link
from .events import Stop, check_within_stops, stops
from .frozen_motion import FrozenScene
from .scene import Payload, Scene
from .scene_numbers import BODIES, UNITS, unbounded, unknown
from .simulator import law_breaks

REFERENCE = "controller.reference"
NO_FUNCTION = "no function of time and state"
# Macros of the text that call functions: their arguments and the function.
CALLS = {"RATES": ("t, x, piece, m, result", "rates"), "LAW": ("t, x, piece, m, result", "law")}
CALLS |= {"GRADIENT": ("t, x, piece, m, weights, result", "gradient"), "MOTORS": ("q, m, result", "motors")}
PARAMETER, FIXED = ("parameter", "tunable"), ("parameter", "fixed")


@dataclass(frozen=True, eq=False)
class SceneUnit:
    """What of a scene a unit is made of; see `Scene.to_fmu`."""

    given: Scene
    q0: ArrayLike | None
    qd0: ArrayLike | None
    payload: str | None
    numbers: Sequence[str]
    derivatives: bool

    def write(self, path: Any, fmi: str, platforms: Sequence[str] | None) -> tuple[str, ...]:
        """Write the file."""
        if fmi not in ("2.0", "3.0"):
            raise ValueError(f"`fmi` must be '2.0' or '3.0', got {fmi!r}")
        return self.unit.write(Path(path), fmi, platforms)

    @cached_property
    def scene(self) -> Scene:
        """The scene, with a payload where one is a parameter; a ValueError names what a unit cannot have."""
        scene, is_sampled = self.given, self.given.sample_time is not None
        sampled = ("controller", "sample_time", "delay", "torque_rate") if is_sampled else ()
        without: dict[str, Any] = dict.fromkeys(sampled)
        replace(scene, stops=False, **without)._exported()
        if scene.torque_rate is not None:
            raise ValueError(f"{NO_FUNCTION}: `torque_rate` bounds torques by those before: leave it out")
        if is_sampled and scene._traced_law() is None:
            raise ValueError(f"{NO_FUNCTION}: `controller` is called, as {scene._why_called}")
        if not scene.n:
            raise ValueError(f"robot {scene.robot.model.name!r} has no joint that moves")
        if self.payload is None:
            return scene
        scene.robot.model.link_index(self.payload)
        held: Any = Payload(0.0, link=self.payload) if scene.payload is None else scene.payload
        link = held.link or end_link(scene.robot.model)
        if link != self.payload:
            raise ValueError(f"`payload` must be on the link of the scene's, {link!r}, got {self.payload!r}")
        return replace(scene, payload=held)

    @cached_property
    def inputs(self) -> dict[str, Array]:
        """Numbers that are arguments of the equations, by their names; the reference is first."""
        known, names = self.scene.numbers, [*self.numbers]
        if wrong := [name for name in names if name in ("delay", "payload")]:
            raise ValueError(f"`numbers` cannot have {wrong[0]!r}: it is no argument of the equations")
        if wrong := [name for name in names if name not in known]:
            raise ValueError(f"`numbers`: {unknown(wrong[0], known)}")
        is_reference = REFERENCE in known and known[REFERENCE].shape == (self.scene.n,)
        names = [*[REFERENCE] * is_reference, *names, *["payload"] * (self.payload is not None)]
        return {name: np.asarray(known[name]) for name in dict.fromkeys(names)}

    @cached_property
    def frozen(self) -> FrozenScene:
        """The scene whose numbers of these names are arguments."""
        scene = replace(self.scene, stops=False)
        return FrozenScene(scene, tuple(self.inputs), is_driven=scene.controller is None)

    @cached_property
    def stops(self) -> list[Stop]:
        """The stops that end a run."""
        return stops(self.scene.resolved.robot.model) if self.scene.stops else []

    @cached_property
    def starts(self) -> tuple[Array, Array]:
        """Positions and velocities where joints start, or joints and the motors behind them."""
        q0, qd0 = (np.zeros(self.scene.n) if x is None else np.asarray(x, np.float64) for x in (self.q0, self.qd0))
        q, qd = self.frozen.dynamics.start(self.scene.resolved.robot, q0, qd0)
        check_within_stops(self.stops, np.concatenate([q, qd]))
        return q0, qd0

    def vector(self, owner: Any, part: str, p: Array) -> Array:
        """The numbers of the equations, or of a sampled law, of which p are arguments."""
        ends = [0, *accumulate(x.size for x in self.inputs.values())]
        own = {name: p[..., a:b] for name, a, b in zip(self.inputs, ends, ends[1:], strict=False)}
        if "payload" in own:
            mass, com, inertia = (own["payload"][..., k] for k in (0, slice(1, 4), slice(4, 10)))
            own["payload"] = parameters_of_bodies(mass, com, inertia.take(ENTRIES, -1))
        found = [0 * p[..., :0]]
        for name, mask in owner.masks.items():
            number = np.broadcast_to(owner.numbers[name].reshape(-1), (*p.shape[:-1], mask.size))
            if part + name in own and part + name not in BODIES:
                number = own[part + name]
            for body, slopes in {} if part else self.frozen.of_bodies.items():
                if name in slopes:
                    moved = own[body] - self.frozen.numbers[body].reshape(-1)
                    number = number + moved @ slopes[name].reshape(len(slopes[name]), -1)
            found.append(number[..., np.flatnonzero(mask)])
        return np.concatenate(found, axis=-1)

    def kernel(self, of: MethodQuantity, owner: Any, part: str = "", *wrt: str) -> Kernel:
        """A function with p in place of numbers; behind rates come the distances to stops."""
        quantity, size = of.quantity, sum(x.size for x in self.inputs.values())
        ends = [] if part or "x" not in quantity.widths else self.stops

        def core(model: Any, p: Array, **arrays: Array) -> Any:
            found = quantity.core(model, numbers=self.vector(owner, part, p), **arrays)
            if not ends:
                return found
            distances = [-stop(np.zeros(()), arrays["x"])[..., None] for stop in ends]
            return np.concatenate([found[0], *distances], axis=-1), *found[1:]

        widths = {name: width for name, width in quantity.widths.items() if name != "numbers"} | {"p": size}
        own = MethodQuantity(self, replace(quantity, core=core, widths=widths, of_run=None), of.title)
        return Kernel(own, self.scene.resolved.robot.model, {}, wrt, order="gradient")

    @cached_property
    def kernels(self) -> dict[str, Kernel]:
        """The functions of a unit, by their names in its text."""
        dynamics, law = self.frozen.dynamics, self.frozen.law
        rates = dynamics.rates_and_drives if law is None else dynamics.right_hand_side
        found = {"rates": self.kernel(rates, dynamics)}
        if self.derivatives:
            wrt = (name for name in ("x", "u", "p") if name in found["rates"].names)
            found["gradient"] = self.kernel(rates, dynamics, "", *wrt)
        if law is not None:
            found["law"] = self.kernel(law.outputs, law, "controller.")
        if len(self.starts[0]) < dynamics.n:
            found["motors"] = self.kernel(dynamics.start_of_motors, dynamics)
        return found

    @property
    def tables(self) -> dict[str, Array]:
        """Pieces of the motion that the law holds, by the function that takes them, if there are some."""
        owners = {"rates": self.frozen.dynamics, "law": self.frozen.law}
        return {name: owner.table for name, owner in owners.items() if owner is not None and len(owner.table)}

    def printed(self) -> str:
        """The functions in C."""
        found: list[str] = []
        for name, kernel in self.kernels.items():
            table = {"table": self.tables[name]} if name in self.tables else {}
            text = to_source(Printable(kernel.printable, name, kernel.names, [name], **table), "c")
            lines = re.sub(r"^(?=void |const double \*)", "static ", text, flags=re.MULTILINE).splitlines()
            found += [line for line in lines if line not in found or not line.startswith(("#include", "static double"))]
        return "\n".join(found)

    def reached(self, name: str, first: Mapping[str, int]) -> list[set[int]]:
        """Places of the variables that the results of a function depend on."""
        kernel, blocks = self.kernels[name], {"x": first["X"], "u": first["U"], "p": first["P"], "q": first["Q0"]}
        places: list[set[int]] = []
        for key, width in zip(kernel.names, kernel.widths, strict=True):
            known = 0 if key not in blocks else self.frozen.dynamics.size if key == "x" else width
            places += [{blocks[key] + k} if k < known else set() for k in range(width)]
        program, results = kernel.printable.program, list[set[int]]()

        def of(operand: Any) -> set[int]:
            sets = {"input": places, "result": results}.get(operand.kind)
            return sets[int(operand.value)] if sets else set()

        results += (set[int]().union(*map(of, step.args)) for step in program.instructions)
        return [of(output) for output in program.outputs[: kernel.printable.entries]]

    def dependencies(
        self, blocks: Mapping[str, Any], first: Mapping[str, int]
    ) -> tuple[dict[int, Any], dict[int, Any]]:
        """Places of variables that states, results and held torques depend on, and on what at the start."""
        law, size, n = self.frozen.law, self.frozen.dynamics.size, self.frozen.dynamics.n
        found = {first["X"] + k: {first["X"] + k} for k in range(size)}
        found |= {first["DX"] + k: places for k, places in enumerate(self.reached("rates", first))}
        if law is not None:  # torques that are held until they are sampled again
            held: list[set[int]] = [set()] * law.n if any(self.frozen.delay) else self.reached("law", first)[: law.n]
            torques = {first["U"] + k: places for k, places in enumerate(held)}
            found = {k: set().union(*(torques.get(i, {i}) for i in places)) for k, places in found.items()} | torques
        q0, qd0 = (range(first[key], first[key] + len(blocks[key])) for key in ("Q0", "QD0"))
        starts = [{k} for k in q0] + (self.reached("motors", first) if len(q0) < n else [])
        starts += [{qd0[k % len(qd0)]} for k in range(n)] + [set()] * (size - 2 * n)
        of_start = {first["X"] + k: places for k, places in enumerate(starts)}
        flat = [variable for block in blocks.values() for variable in block]
        inputs = {k for k, variable in enumerate(flat) if variable.causality == "input"} | of_start.keys()
        initial = {k: sorted(set().union(*(of_start.get(i, {i}) for i in places))) for k, places in found.items()}
        return {k: sorted(places & inputs) for k, places in found.items()}, initial

    def joints(self, title: str, quantity: str, what: str, *how: str, **numbers: Any) -> list[Variable]:
        """A variable of each joint."""
        robot, found = self.scene.resolved.robot, list[Variable]()
        for k, (i, joint) in enumerate(zip(robot.model.independent_joints, robot.joint_names, strict=True)):
            unit = _name(OF_JOINTS[quantity][not robot.model.is_revolute[i]])
            own = {key: x[k] if np.ndim(x) else x for key, x in numbers.items()}
            own |= dict(zip(("causality", "variability"), how, strict=False))
            found.append(Variable(f"{title}[{k + 1}]", unit, f"{what} of {joint}", **own))
        return found

    def blocks(self) -> dict[str, list[Variable]]:
        """The variables, in the order of the text."""
        scene, robot, law, dynamics = self.scene, self.scene.resolved.robot, self.frozen.law, self.frozen.dynamics
        sides = {"": "", "motor_": "motor "} if dynamics.n > scene.n else {"": ""}
        limits = {"q": (robot.lower, robot.upper), "qd": (-robot.velocity_limit, robot.velocity_limit)}
        most = np.inf if scene.resolved.effort_limit is None else unbounded(scene.resolved.effort_limit)
        X, starts = list[Variable](), {"Q0": list[Variable](), "QD0": list[Variable]()}
        for (key, ends), what, given in zip(limits.items(), ("position", "velocity"), self.starts, strict=True):
            for k, (side, owner) in enumerate(sides.items()):
                bounds = {} if side else dict(zip(("low", "high"), map(unbounded, ends), strict=True))
                X += self.joints(side + key, key, f"{owner}{what}", "output", **bounds)
                if len(own := given[k * scene.n : (k + 1) * scene.n]):
                    starts[f"{key.upper()}0"] += self.joints(
                        f"{side}{key}0", key, f"{owner}{what} at the start", *FIXED, start=own
                    )
        z = [
            Variable(f"z[{k + 1}]", "", "state of the controller")
            for k in range(law.states if law else dynamics.states)
        ]
        X += z if law is None else []
        rates = [v for key in ("qd", "qdd") for _ in sides for v in self.joints("", key, "")] + z
        DX = [
            Variable(f"der({v.name})", r.unit, f"rate of {v.description}", of=1 + k)
            for k, (v, r) in enumerate(zip(X, rates, strict=False))
        ]
        is_driven = scene.controller is None
        U = self.joints("torque", "tau", "torque", "input", start=0.0, low=-most, high=most) if is_driven else []
        how = "local" if is_driven else "output", "continuous" if law is None else "discrete"
        tau = self.joints("tau", "tau", "torque of the drive", *how)
        stop = [
            Variable(f"stop[{k + 1}]", "", f"{s.joint}, distance from {s.bound:g}") for k, s in enumerate(self.stops)
        ]
        found = {
            "T": [Variable("time", "s", "", "independent")],
            "X": X,
            "U": U if law is None else tau,
            "P": self.arguments(),
        }
        found |= {"DX": DX, "TAU": tau if law is None else [], "STOP": stop}
        return found | {"Z": [v._replace(variability="discrete") for v in z] if law else [], **starts}

    def arguments(self) -> list[Variable]:
        """References and numbers that are arguments."""
        rows, found, robot = list[tuple[str, Array, str]](), list[Variable](), self.scene.resolved.robot
        for key, x in self.inputs.items():
            if key == "payload":
                mass, com, inertia = body_of_parameters(x)
                rows += [("payload.mass", mass, "kg"), ("payload.com", com, "m")]
                rows += [("payload.inertia", inertia[ROWS, COLUMNS], "kg m^2")]
            else:
                own = UNITS.get(key, "N m or N" if key.startswith("friction.") else "")
                rows += [(key, x, "rad or m" if key == REFERENCE else own)]
        for key, x, unit in rows:
            is_reference, each, units = key == REFERENCE, x.shape == (robot.n,), unit.split(" or ")
            for place in np.ndindex(x.shape):
                slides = each and not robot.model.is_revolute[robot.model.independent_joints[place[0]]]
                known = units[slides] if len(units) == 2 and each else unit
                name = f"{key}[{','.join(str(k + 1) for k in place)}]" if place else key
                what = f"{key} of {robot.joint_names[place[0]]}" if each else key
                what += f" of the body on {self.payload}, in its axes" if key.startswith("payload.") else ""
                what += ", about its centre of mass: xx, xy, yy, xz, yz, zz" if key == "payload.inertia" else ""
                how = ("input", "continuous") if is_reference else PARAMETER
                name = name.removeprefix("controller.") if is_reference else name
                found.append(Variable(name, _name(known), what, *how, float(x[place])))
        return found

    @cached_property
    def unit(self) -> Unit:
        """The whole."""
        scene, dynamics, law, blocks = self.scene, self.frozen.dynamics, self.frozen.law, self.blocks()
        first = dict(zip([*blocks, "NV"], [0, *accumulate(map(len, blocks.values()))], strict=True))
        model, method, limit = scene.resolved.robot.model, tableau("DOP853"), scene.resolved.effort_limit
        late, rest = self.frozen.delay
        breaks = law_breaks(scene.controller) if law is None else []
        sizes = {**first, "S": dynamics.size, "N": scene.n, "C": dynamics.n, "K": first["DX"] - first["X"]}
        sizes |= {"R": first["Z"] - first["DX"], "M": law.states if law else 0, "SAMPLED": int(law is not None)}
        sizes |= {"INPUTS": first["P" if law else "U"], "LATE": int(late), "QUEUE": int(late) + 2}
        sizes |= {"BREAKS": len(breaks), "STAGES": len(method.B)}
        macros: dict[str, Any] = {"PERIOD": self.frozen.period or 1.0, "REST": rest, "SLACK": 1e-9 * self.frozen.period}
        given = {
            "t": "t",
            "x": "x",
            "u": "(m)->v + U",
            "piece": "piece",
            "p": "(m)->v + P",
            "weights": "weights",
            "q": "q",
        }
        for macro, (arguments, name) in CALLS.items():
            names = [*(given[key] for key in self.kernels[name].names), "result"] if name in self.kernels else []
            macros[f"{macro}({arguments})"] = f"{name}({', '.join(names)})" if names else "(void)0"
        for macro, name in {"PIECE(t)": "rates", "LAW_PIECE(t)": "law"}.items():
            macros[macro] = f"{name}_piece(t)" if name in self.tables else "starts"
        place = next((k for k, v in enumerate(blocks["P"]) if v.name == "effort_limit[1]"), None)
        macros |= {"LIMIT(m)": "limit" if place is None else f"((m)->v + P + {place})", "TOLERANCE": TOLERANCE}
        weights = np.pad(np.vstack([method.A, method.B]), ((0, 0), (0, len(method.B) - method.A.shape[1])))
        arrays = {"a": weights, "c": np.append(method.C, 1.0), "e": method.E, "breaks": np.array([*breaks, np.inf])}
        arrays["limit"] = np.full(scene.n, np.inf) if limit is None else unbounded(limit)
        what = f"{harmless(model.name)}, {'torques in' if scene.controller is None else 'closed loop'}"
        rest_of_unit = self.printed(), *self.dependencies(blocks, first), scene.sample_time, self.derivatives
        return Unit(identifier(model.name), what, blocks, sizes, macros, arrays, *rest_of_unit)


def _name(unit: str) -> str:
    """A unit such as N m s/rad by the name that it has in a description; empty if it is not one."""
    return "" if re.search("[^A-Za-z0-9 ^/]|^1$", unit) or " or " in unit else unit.replace(" ", ".").replace("^", "")
