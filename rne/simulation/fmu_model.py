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
from ..control.law_numbers import law_breaks
from ..control.sampled_loop import in_periods
from ..control.traced_law import TracedLaw
from ..dynamics.quantity import MethodQuantity
from ..integrators.loops import StateUpdate
from ..integrators.tableaus import tableau
from ..kernels.exports.fmu import TOLERANCE, MockupUnit, Variable
from ..kernels.kernel import Kernel, with_table
from ..kernels.source import harmless, identifier
from ..kernels.units import Unit as Text
from ..kernels.units import unit
from ..model.topology import end_link
from .events import Stop, check_within_stops, stops
from .named_numbers import NamedNumbers, plain_name
from .scene_numbers import UNITS, unbounded

REFERENCE = "controller.reference"
SLACK = 1e-9  # largest lateness of an importer, relative to a sample time
NO_FUNCTION = "no function of time and state"
# Macros of the text that call functions: their arguments and the function.
CALLS = {"RATES": ("t, x, m, result", "rates"), "LAW": ("t, x, m, result", "law")}
CALLS |= {"GRADIENT": ("t, x, m, weights, result", "gradient"), "MOTORS": ("q, m, result", "motors")}
PARAMETER, FIXED = ("parameter", "tunable"), ("parameter", "fixed")
OF_PAYLOAD = {"payload.mass": "kg", "payload.com": "m", "payload.inertia": "kg m^2"}


@dataclass(frozen=True, eq=False)
class SceneUnit:
    """Parts of a scene that make up a unit; see `Scene.to_fmu`."""

    given: Any  # a Scene, whose method imports this
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
    def scene(self) -> Any:
        """The scene, with a payload if one is a parameter; a ValueError for what a unit cannot have."""
        scene, is_sampled = self.given, self.given.sample_time is not None
        sampled = ("controller", "sample_time", "delay", "torque_rate") if is_sampled else ()
        without: dict[str, Any] = dict.fromkeys(sampled)
        replace(scene, stops=False, **without).exported()
        if scene.torque_rate is not None:
            raise ValueError(f"{NO_FUNCTION}: `torque_rate` bounds torques by those before: leave it out")
        if is_sampled and scene.traced_law() is None:
            raise ValueError(f"{NO_FUNCTION}: `controller` is called, as {scene.why_called}")
        if not scene.n:
            raise ValueError(f"robot {scene.robot.model.name!r} has no joint that moves")
        if self.payload is None:
            return scene
        scene.robot.model.link_index(self.payload)
        held = scene.payload or (0.0, np.zeros(3), None, self.payload)
        link = held[3] or end_link(scene.robot.model)
        if link != self.payload:
            raise ValueError(f"`payload` must be on the link of the scene's, {link!r}, got {self.payload!r}")
        return replace(scene, payload=held)

    @cached_property
    def named(self) -> NamedNumbers:
        """Functions of the scene with some numbers as arguments; the reference is the first."""
        known = self.scene.numbers
        if "delay" in self.numbers:
            raise ValueError("`numbers` cannot have 'delay', on which the text depends")
        is_reference = REFERENCE in known and known[REFERENCE].shape == (self.scene.n,)
        names = [*[REFERENCE] * is_reference, *self.numbers, *["payload"] * (self.payload is not None)]
        if self.scene.sample_time is not None:  # of what rates depend on first, as in their gradient
            names.sort(key=lambda name: name.startswith("controller."))
        return NamedNumbers(replace(self.scene, stops=False), tuple(dict.fromkeys(names)))

    @cached_property
    def law(self) -> TracedLaw | None:
        """Sampled control law."""
        return None if self.scene.sample_time is None else self.named.law

    @cached_property
    def delay(self) -> tuple[float, float]:
        """Delay of commands after their samples: whole periods, and the remainder."""
        return in_periods(float(self.scene.delay or 0.0), float(self.scene.sample_time or 1.0))

    @property
    def update(self) -> StateUpdate:
        """Update rule of a sampled law's states from sample to sample."""
        is_discrete = self.law is not None and self.law.discrete
        return StateUpdate.of(float(self.scene.sample_time or 0.0), discrete=is_discrete)

    @cached_property
    def stops(self) -> list[Stop]:
        """Stops that end a run."""
        return stops(self.scene.resolved.robot.model) if self.scene.stops else []

    @cached_property
    def starts(self) -> tuple[Array, Array]:
        """Initial positions and velocities of joints, or of joints and their motors."""
        q0, qd0 = (np.zeros(self.scene.n) if x is None else np.asarray(x, np.float64) for x in (self.q0, self.qd0))
        q, qd = self.named.equations.start(self.scene.resolved.robot, q0, qd0)
        check_within_stops(self.stops, np.concatenate([q, qd]))
        return q0, qd0

    def rates(self, *wrt: str) -> Kernel:
        """Function dx/dt, with the drives' torques unless held, and distances to stops; or its gradient."""
        name = "rates_and_drives" if self.law is None else "rates"
        function, model = self.named.function(name), self.scene.resolved.robot.model

        def core(model: Any, **arrays: Array) -> Any:
            found, *judged = function.quantity.core(model, **arrays)
            distances = [-stop(np.zeros(()), arrays["x"])[..., None] for stop in self.stops]
            return np.concatenate([found, *distances], axis=-1), *judged

        whole = MethodQuantity(self, replace(function.quantity, core=core), function.title)
        made = Kernel(whole, model, {}, wrt, order="gradient")
        return made if wrt else with_table(made, self.named.table(name))

    @cached_property
    def kernels(self) -> dict[str, Kernel]:
        """Functions of a unit, by their names in its text."""
        found = {"rates": self.rates()}
        if self.derivatives:
            found["gradient"] = self.rates(*(name for name in found["rates"].names if name not in ("t", "piece")))
        if self.law is not None:
            found["law"] = self.named.kernel("law")
        if len(self.starts[0]) < self.named.equations.n:
            found["motors"] = self.named.kernel("start_of_motors")
        return found

    @cached_property
    def text(self) -> Text:
        """The functions in C."""
        return unit(self.kernels, name="arm", static=True)

    def places(self, first: Mapping[str, int]) -> dict[str, int]:
        """Offsets of functions' arguments among the variables."""
        sizes = {plain_name(name): self.named.value(name).size for name in self.named.names}
        numbers = dict(zip(sizes, accumulate(sizes.values(), initial=first["P"]), strict=False))
        return {"x": first["X"], "u": first["U"], "q": first["Q0"]} | numbers

    def reached(self, name: str, first: Mapping[str, int]) -> list[set[int]]:
        """Indices of the variables that the results of a function depend on."""
        kernel, begins, places = self.kernels[name], self.places(first), list[set[int]]()
        for key, width in zip(kernel.names, kernel.widths, strict=True):
            known = 0 if key not in begins else self.named.equations.size if key == "x" else width
            places += [{begins[key] + k} if k < known else set() for k in range(width)]
        program, results = kernel.printable.program, list[set[int]]()

        def of(operand: Any) -> set[int]:
            sets = {"input": places, "result": results}.get(operand.kind)
            return sets[int(operand.value)] if sets else set()

        for step in program.instructions:
            results.append(set[int]().union(*map(of, step.args)))
        return [of(output) for output in program.outputs[: kernel.printable.entries]]

    def dependencies(
        self, blocks: Mapping[str, Any], first: Mapping[str, int]
    ) -> tuple[dict[int, Any], dict[int, Any]]:
        """Indices of the variables that states, results and held torques depend on, and of those at the start."""
        law, size, n = self.law, self.named.equations.size, self.named.equations.n
        found = {first["X"] + k: {first["X"] + k} for k in range(size)}
        found |= {first["DX"] + k: places for k, places in enumerate(self.reached("rates", first))}
        if law is not None:  # torques that are held until they are sampled again
            held: list[set[int]] = [set()] * law.n if any(self.delay) else self.reached("law", first)[: law.n]
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
        """One variable per joint."""
        robot, found = self.scene.resolved.robot, list[Variable]()
        for k, (i, joint) in enumerate(zip(robot.model.independent_joints, robot.joint_names, strict=True)):
            unit = _name(OF_JOINTS[quantity][not robot.model.is_revolute[i]])
            own = {key: x[k] if np.ndim(x) else x for key, x in numbers.items()}
            own |= dict(zip(("causality", "variability"), how, strict=False))
            found.append(Variable(f"{title}[{k + 1}]", unit, f"{what} of {joint}", **own))
        return found

    @cached_property
    def sides(self) -> dict[str, str]:
        """Prefixes of names and descriptions of joints, and of motors of elastic ones."""
        return {"": "", "motor_": "motor "} if self.named.equations.n > self.scene.n else {"": ""}

    def moving(self) -> tuple[list[Variable], dict[str, list[Variable]]]:
        """Positions and velocities, and blocks of their initial values."""
        robot, n = self.scene.resolved.robot, self.scene.n
        states, starts = list[Variable](), dict[str, list[Variable]]()
        limits = {"q": (robot.lower, robot.upper), "qd": (-robot.velocity_limit, robot.velocity_limit)}
        for (key, ends), what, given in zip(limits.items(), ("position", "velocity"), self.starts, strict=True):
            starts[f"{key.upper()}0"] = own = []
            for k, (side, owner) in enumerate(self.sides.items()):
                bounds = {} if side else dict(zip(("low", "high"), map(unbounded, ends), strict=True))
                states += self.joints(side + key, key, f"{owner}{what}", "output", **bounds)
                if len(at_start := given[k * n : (k + 1) * n]):
                    own += self.joints(f"{side}{key}0", key, f"start, {owner}{what}", *FIXED, start=at_start)
        return states, starts

    def blocks(self) -> dict[str, list[Variable]]:
        """Blocks of variables, in the order of the text."""
        law, is_driven, (X, starts) = self.law, self.scene.controller is None, self.moving()
        most = np.inf if self.scene.resolved.effort_limit is None else unbounded(self.scene.resolved.effort_limit)
        states = range(1, 1 + (law.states if law else self.named.equations.states))
        z = [Variable(f"z[{k}]", "", "state of the controller") for k in states]
        rates = [v for key in ("qd", "qdd") for _ in self.sides for v in self.joints("", key, "")] + z
        X += [] if law else z
        DX = [
            Variable(f"der({v.name})", r.unit, f"rate of {v.description}", of=k)
            for k, (v, r) in enumerate(zip(X, rates, strict=False), 1)
        ]
        U = self.joints("torque", "tau", "torque", "input", start=0.0, low=-most, high=most) if is_driven else []
        how = "local" if is_driven else "output", "discrete" if law else "continuous"
        tau = self.joints("tau", "tau", "torque of the drive", *how)
        ends = [f"{stop.joint}, distance from {stop.bound:g}" for stop in self.stops]
        found = {"T": [Variable("time", "s", "", "independent")], "X": X, "U": tau if law else U, "P": self.arguments()}
        found |= {"DX": DX, "TAU": [] if law else tau}
        found["STOP"] = [Variable(f"stop[{k}]", "", end) for k, end in enumerate(ends, 1)]
        return found | {"Z": [v._replace(variability="discrete") for v in z] if law else [], **starts}

    def arguments(self) -> list[Variable]:
        """References and numbers that are arguments."""
        rows, found, robot = list[tuple[str, Array, str]](), list[Variable](), self.scene.resolved.robot
        for key in self.named.names:
            x, own = self.named.known[key], UNITS.get(key, "N m or N" if key.startswith("friction.") else "")
            if key == "payload":
                mass, com, inertia = np.split(self.named.value(key), [1, 4])
                rows += zip(OF_PAYLOAD, (mass[0], com, inertia), OF_PAYLOAD.values(), strict=True)
            else:
                rows += [(key, x, "rad or m" if key == REFERENCE else own)]
        for key, x, text in rows:
            is_reference, each, units = key == REFERENCE, x.shape == (robot.n,), text.split(" or ")
            for place in np.ndindex(x.shape):
                slides = each and not robot.model.is_revolute[robot.model.independent_joints[place[0]]]
                known = units[slides] if len(units) == 2 and each else text
                name = f"{key}[{','.join(str(k + 1) for k in place)}]" if place else key
                what = f"{key} of {robot.joint_names[place[0]]}" if each else key
                what += f" of the body on {self.named.payload_link}, in its axes" if key.startswith("payload.") else ""
                what += ", about its centre of mass: xx, xy, yy, xz, yz, zz" if key == "payload.inertia" else ""
                how = ("input", "continuous") if is_reference else PARAMETER
                name = name.removeprefix("controller.") if is_reference else name
                found.append(Variable(name, _name(known), what, *how, float(x[place])))
        return found

    @cached_property
    def unit(self) -> MockupUnit:
        """Complete unit."""
        scene, dynamics, law, blocks = self.scene, self.named.equations, self.law, self.blocks()
        first = dict(zip([*blocks, "NV"], [0, *accumulate(map(len, blocks.values()))], strict=True))
        model, method, limit = scene.resolved.robot.model, tableau("DOP853"), scene.resolved.effort_limit
        (late, rest), period = self.delay, float(scene.sample_time or 1.0)
        breaks = law_breaks(scene.controller) if law is None else []
        sizes = {**first, "S": dynamics.size, "N": scene.n, "C": dynamics.n, "K": first["DX"] - first["X"]}
        sizes |= {"R": first["Z"] - first["DX"], "M": law.states if law else 0, "SAMPLED": int(law is not None)}
        sizes |= {"INPUTS": first["P" if law else "U"], "LATE": int(late), "QUEUE": int(late) + 2}
        sizes |= {"BREAKS": len(breaks), "STAGES": len(method.B)}
        macros: dict[str, Any] = {"PERIOD": period, "REST": rest, "SLACK": SLACK * period * bool(law)}
        macros |= dict(zip(("KEEP", "GAIN"), self.update, strict=True))
        given = {"t": "t", "x": "x", "weights": "weights", "q": "q", "piece": "arm_rates_piece(*(t))"}
        given |= {key: f"(m)->v + {k}" for key, k in self.places(first).items() if key not in given}
        for macro, (arguments, name) in CALLS.items():
            macros[f"{macro}({arguments})"] = "0"
            if (function := self.text.functions.get(name)) is not None:
                call = f"{function.name}({', '.join([*(given[key] for key in function.taken), 'result'])})"
                macros[f"{macro}({arguments})"] = call if function.may_fail else f"({call}, 0)"
        place = next((k for k, v in enumerate(blocks["P"]) if v.name == "effort_limit[1]"), None)
        macros |= {"LIMIT(m)": "limit" if place is None else f"((m)->v + P + {place})", "TOLERANCE": TOLERANCE}
        weights = np.pad(np.vstack([method.A, method.B]), ((0, 0), (0, len(method.B) - method.A.shape[1])))
        arrays = {"a": weights, "c": np.append(method.C, 1.0), "e": method.E, "breaks": np.array([*breaks, np.inf])}
        arrays["limit"] = np.full(scene.n, np.inf) if limit is None else unbounded(limit)
        what = f"{harmless(model.name)}, {'torques in' if scene.controller is None else 'closed loop'}"
        rest_of_unit = self.text.source, *self.dependencies(blocks, first), scene.sample_time, self.derivatives
        return MockupUnit(identifier(model.name), what, blocks, sizes, macros, arrays, *rest_of_unit)


def _name(unit: str) -> str:
    """Name of a unit such as N m s/rad in a description; empty if it is none."""
    return "" if re.search("[^A-Za-z0-9 ^/]|^1$", unit) or " or " in unit else unit.replace(" ", ".").replace("^", "")
