"""Functional Mock-up Units: their texts, and, where fmpy and a compiler are, their motions beside rne.simulate."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import itertools
import platform
import re
import shutil
import subprocess
import sys
import threading
import zipfile
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import rne
from rne.__main__ import main
from rne.basics.marks import is_marked
from rne.simulation.fmu_model import SceneUnit
from rne.simulation.named_numbers import NamedNumbers

needs_fmpy = pytest.mark.skipif(importlib.util.find_spec("fmpy") is None, reason="fmpy is not installed")
long = pytest.mark.long
MINUTE = 1e-12  # of a state's size, the tolerance that steps are controlled with
SAME = 1e-9  # between two methods of order 8 at that tolerance, over 2 s of arms that fall
ROBOTS = ("irb140", "ur5", "panda", "so101")
MACHINE = platform.machine().lower().replace("amd64", "x86_64").replace("arm64", "aarch64")
HERE = (f"{MACHINE}-{sys.platform.replace('win32', 'windows')}",)


def arm(name):
    """A robot with its fingers locked: elastic joints have none that follow others, sampled loops none so light."""
    robot = rne.load(name)
    fingers = {joint: 0.01 for joint in robot.joint_names if "finger" in joint or "gripper" in joint}
    return robot.locked(fingers) if fingers else robot


def size_of(robot):
    """Gains of the size of the arm: natural frequencies of some 5 Hz."""
    return np.maximum(np.diagonal(robot.mass_matrix(np.zeros(robot.n))), 1e-3)


def pd(robot):
    I = size_of(robot)
    return rne.control.pd_gravity(robot, 100 * I, 10 * I, np.full(robot.n, 0.2))


def pid(robot):
    I = size_of(robot)
    return rne.control.pid(robot, 100 * I, 60 * I, 10 * I, np.full(robot.n, 0.2))


def spring(robot):
    return [
        rne.Spring(robot.link_names[-1], [0, 0, 0.02], robot.link_names[0], [0.3, 0.2, 0.8], stiffness=5.0, length=0.1)
    ]


KINDS = {
    "torques": lambda r: rne.Scene(r, friction=rne.Friction(viscous=0.5 * size_of(r))),
    "pd_gravity": lambda r: rne.Scene(r, controller=pd(r)),
    "pid": lambda r: rne.Scene(r, controller=pid(r), effort_limit=200 * size_of(r) + 5.0),
    "elastic": lambda r: rne.Scene(
        r, controller=pd(r), elastic=rne.ElasticJoints(4000 * size_of(r), 5 * size_of(r), 0.5 * size_of(r))
    ),
    "springs": lambda r: rne.Scene(r, springs=spring(r), friction=rne.Friction(viscous=size_of(r))),
    "payload": lambda r: rne.Scene(r, controller=pd(r)),
    "sampled": lambda r: rne.Scene(r, controller=pd(r), sample_time=2e-3, delay=1.5e-3),
    "sampled_pid": lambda r: rne.Scene(r, controller=pid(r), sample_time=2e-3, delay=2e-3),
}
BODY = 0.4, [0.01, -0.02, 0.05], [[2e-3, 1e-4, -2e-4], [1e-4, 3e-3, 3e-4], [-2e-4, 3e-4, 1.5e-3]]


def torque(scene):
    return 3 * size_of(scene.robot) * np.cos(np.arange(scene.n)) if scene.controller is None else None


def start(scene):
    return 0.1 * np.cos(np.arange(scene.n)), 0.2 * np.sin(np.arange(scene.n))


@functools.cache
def built(name, kind, fmi="2.0", **how):
    """A scene, and the path of its unit in a folder that lives as long as the tests."""
    import tempfile

    scene = KINDS[kind](arm(name))
    path = f"{tempfile.mkdtemp()}/{kind}.fmu"
    q0, qd0 = start(scene)
    link = scene.robot.link_names[-1] if kind == "payload" else None
    scene.to_fmu(path, fmi=fmi, q0=q0, qd0=qd0, payload=link, platforms=HERE, **how)
    return scene, path


class Opened:
    """A unit that fmpy has loaded, for co-simulation or model exchange, with variables by their names."""

    def __init__(self, path, *, exchange=False):
        import fmpy
        from fmpy.fmi2 import FMU2Model, FMU2Slave
        from fmpy.fmi3 import FMU3Model, FMU3Slave

        self.folder, self.description = fmpy.extract(path), fmpy.read_model_description(path)
        self.is_2 = self.description.fmiVersion == "2.0"
        made = ((FMU2Slave, FMU2Model) if self.is_2 else (FMU3Slave, FMU3Model))[exchange]
        part = self.description.modelExchange if exchange else self.description.coSimulation
        marks = {"guid": self.description.guid, "instanceName": "arm"}
        marks |= {"guid": self.description.instantiationToken} if not self.is_2 else {}
        self.fmu = made(unzipDirectory=self.folder, modelIdentifier=part.modelIdentifier, **marks)
        self.fmu.instantiate()
        self.vr = {v.name: v.valueReference for v in self.description.modelVariables}
        self.t = 0.0

    def set(self, name, values):
        refs = [self.vr[f"{name}[{k + 1}]"] for k in range(len(values))] if np.ndim(values) else [self.vr[name]]
        (self.fmu.setReal if self.is_2 else self.fmu.setFloat64)(refs, np.ravel(values).tolist())

    def get(self, name, count=None):
        refs = [self.vr[name]] if count is None else [self.vr[f"{name}[{k + 1}]"] for k in range(count)]
        return np.array((self.fmu.getReal if self.is_2 else self.fmu.getFloat64)(refs))

    def begin(self, tolerance=MINUTE, **values):
        if self.is_2:
            self.fmu.setupExperiment(tolerance=tolerance, startTime=0.0)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(tolerance=tolerance, startTime=0.0)
        for name, value in values.items():
            self.set(name, value)
        self.fmu.exitInitializationMode()
        return self

    def step(self, h):
        found = self.fmu.doStep(self.t, h)
        self.t += h
        return found

    def state(self):
        state = self.fmu.getFMUstate() if self.is_2 else self.fmu.getFMUState()
        return self.fmu.serializeFMUstate(state) if self.is_2 else self.fmu.serializeFMUState(state)

    def restore(self, kept, t):
        if self.is_2:
            self.fmu.setFMUstate(self.fmu.deSerializeFMUstate(kept))
        else:
            self.fmu.setFMUState(self.fmu.deserializeFMUState(kept))
        self.t = t


def reference_motion(scene, kind, times):
    """What rne.simulate finds, with the payload that was put on after the export."""
    if kind == "payload":
        scene = replace(scene, payload=rne.Payload(*BODY, link=scene.robot.link_names[-1]))
    q0, qd0 = start(scene)
    return scene, rne.simulate(
        scene, q0, qd0, 2.01, torque=torque(scene), rtol=MINUTE, atol=MINUTE, t_eval=times, method="DOP853"
    )


def open_with(scene, kind, path, **how):
    """The unit with its torques, and with the payload that is put on after the export."""
    unit, values = Opened(path, **how), {}
    if scene.controller is None:
        values["torque"] = torque(scene)
    if kind == "payload":
        mass, com, I = BODY
        rows, columns = [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]
        values |= {"payload.mass": mass, "payload.com": np.array(com), "payload.inertia": np.array(I)[rows, columns]}
    return unit, values


@functools.cache
def small():
    """The first three joints of the IRB 140, of which kernels are traced fast."""
    return rne.load("irb140").locked({f"joint_{k}": 0.3 for k in (4, 5, 6)})


def unit_of(scene, **how):
    given = {"q0": None, "qd0": None, "payload": None, "numbers": (), "derivatives": False}
    return SceneUnit(scene, **given | how)


def described(scene, path, fmi="2.0", **how):
    """The variables of the description in order, what depends on what by names, and the text in C."""
    assert scene.to_fmu(path, fmi=fmi, platforms=(), **how) == ()
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        source = archive.read("sources/fmu.c").decode()
    variables = [{**v.attrib, **(v[0].attrib if len(v) else {})} for v in root.find("ModelVariables")]
    names, shift = [v["name"] for v in variables], int(fmi == "2.0")
    depends = {}
    for part in ("Outputs", "Derivatives", "InitialUnknowns") if shift else ():
        for entry in root.find(f"ModelStructure/{part}"):
            by = {names[int(k) - 1] for k in entry.get("dependencies").split()}
            depends[part, names[int(entry.get("index")) - 1]] = by
    return variables, depends, source


def check_description(variables, source):
    """Value references are places in the text's array, and each rate is that of the state in its name."""
    (line,) = re.findall(r"^enum \{ (.*) \};$", source, re.MULTILINE)
    places = {name: int(k) for name, _, k in (part.partition(" = ") for part in line.split(", "))}
    assert [int(v["valueReference"]) for v in variables] == list(range(places["NV"]))
    blocks = {
        "q": places["X"],
        "qd": places["X"] + places["C"],
        "der(q": places["DX"],
        "tau": places["DX"] + places["S"],
    }
    for v in variables:
        title, _, number = v["name"].partition("[")
        if title in blocks:
            assert int(v["valueReference"]) == blocks[title] + int(number.rstrip(")]")) - 1
        if "derivative" in v:
            assert v["name"] == f"der({variables[int(v['derivative']) - 1]['name']})"


def check_dependencies(scene, depends):
    """Entries of the Jacobian that are not zero in a random state are dependencies, and few others are."""
    x = np.random.default_rng(0).uniform(-1, 1, 2 * scene.n)
    _, slopes = rates_of(scene, 0.0, x, np.ones(scene.n))
    states = [f"{key}[{k + 1}]" for key in ("q", "qd") for k in range(scene.n)]
    columns = [*states, *(f"torque[{k + 1}]" for k in range(scene.n))]
    for name, row in zip(states, slopes, strict=False):
        by = {column for column, slope in zip(columns, row, strict=True) if slope}
        assert by <= depends["Derivatives", f"der({name})"]
    assert depends["Derivatives", "der(q[1])"] == {"qd[1]"}
    assert depends["Outputs", "q[2]"] == {"q[2]"}
    assert depends["InitialUnknowns", "q[2]"] == {"q0[2]"}


def check_all(scene, variables, depends, source):
    check_description(variables, source)
    check_dependencies(scene, depends)


def check_payload(scene):
    """Rates with a payload that is put on later are those of the scene that has it."""
    mass, com, I = BODY
    own = unit_of(scene, payload="link_2")
    x, u = np.random.default_rng(0).uniform(-1, 1, 2 * scene.n), np.ones(scene.n)
    given = [mass, *com, I[0][0], I[0][1], I[1][1], I[0][2], I[1][2], I[2][2]]
    found = own.kernels["rates"](np.zeros(1), x, u, np.array(given))
    wanted, _ = rates_of(replace(scene, payload=rne.Payload(*BODY, link="link_2")), 0.0, x, u)
    assert np.abs(found - wanted).max() < 1e-12 * np.abs(wanted).max()


def check_units(path):
    """Exponents of the units of the SI, by the names of products of theirs."""
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    assert {unit.get("name"): unit[0].attrib for unit in root.find("UnitDefinitions")} == {
        "s": {"s": "1"},
        "rad": {"rad": "1"},
        "rad/s": {"rad": "1", "s": "-1"},
        "rad/s2": {"rad": "1", "s": "-2"},
        "N.m": {"kg": "1", "m": "2", "s": "-2"},
        "N.m.s/rad": {"kg": "1", "m": "2", "s": "-1", "rad": "-1"},
        "kg": {"kg": "1"},
        "m": {"m": "1"},
        "kg.m2": {"kg": "1", "m": "2"},
    }


def test_the_mass_of_a_payload_alone_is_a_parameter(tmp_path):
    mass, com, I = BODY
    light, heavy = (rne.Scene(small(), payload=rne.Payload(m, com, I, "link_2")) for m in (0.1, mass))
    how = {"numbers": ["payload.mass"], "derivatives": False}
    (own,) = [v for v in described(light, tmp_path / "a.fmu", **how)[0] if v["name"].startswith("payload")]
    assert [own[key] for key in ("name", "unit", "start", "variability")] == ["payload.mass", "kg", "0.1", "tunable"]
    x, u = np.random.default_rng(0).uniform(-1, 1, 6), np.ones(3)
    found = unit_of(light, **how).kernels["rates"](np.zeros(1), x, u, np.array([mass]))
    wanted, _ = rates_of(heavy, 0.0, x, u)
    assert np.abs(found - wanted).max() < 1e-12 * np.abs(wanted).max()


def test_the_description_fits_the_text_and_the_equations(tmp_path):
    scene = rne.Scene(small(), friction=rne.Friction(viscous=2.0))
    how = {"payload": "link_2", "numbers": ["friction.viscous"], "derivatives": False}
    variables, depends, source = described(scene, tmp_path / "a.fmu", **how)
    check_all(scene, variables, depends, source)
    check_payload(scene)
    check_units(tmp_path / "a.fmu")
    by = {v["name"]: v for v in variables}
    assert by["friction.viscous[2]"] | {"valueReference": 0} == {
        "name": "friction.viscous[2]", "valueReference": 0, "description": "friction.viscous of joint_2",
        "causality": "parameter", "variability": "tunable", "start": "2.0",
    } | ({"unit": by["friction.viscous[2]"]["unit"]})  # fmt: skip
    assert by["q[1]"]["unit"] == "rad"
    assert float(by["q[1]"]["max"]) == small().upper[0]
    described(scene, tmp_path / "b.fmu", **how)
    assert (tmp_path / "a.fmu").read_bytes() == (tmp_path / "b.fmu").read_bytes()


def test_a_unit_of_fmi_3_has_the_functions_of_all_types_of_the_standard(tmp_path):
    """FMI 3.0.2, section 2.2.7: an importer looks all of them up, whatever types the variables have."""
    *_, source = described(rne.Scene(small()), tmp_path / "a.fmu", fmi="3.0")
    integers = [f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)]
    for kind in ("Float32", "Float64", *integers, "Boolean", "String", "Binary", "Clock"):
        for verb in ("Get", "Set"):
            assert f" F({verb}{kind})(" in source
    of_c = {f"{sign.lower()}int{bits}_t" for sign in ("", "U") for bits in (8, 16, 32, 64)}
    assert set(re.findall(r"\bu?int\d+_t\b", source)) <= of_c


def test_a_unit_without_a_law_or_motors_has_all_macros_that_it_calls(tmp_path):
    *_, source = described(rne.Scene(small()), tmp_path / "a.fmu", derivatives=False)
    defined = set(re.findall(r"^#define (\w+)\(", source, flags=re.MULTILINE))
    called = set(re.findall(r"\b(RATES|LAW|MOTORS|GRADIENT|LIMIT)\(", source))
    assert {"RATES", "LAW", "MOTORS"} <= called <= defined


def swapped(variables):
    for v in variables:
        if v["name"] in ("der(q[1])", "der(q[2])"):
            v["derivative"] = str(5 - int(v["derivative"]))


def shifted(variables):
    for v in variables[-3:]:
        v["valueReference"] = str(int(v["valueReference"]) + 1)


@pytest.mark.parametrize("mutant", ["swapped", "shifted", "axes", "missing"])
def test_mutants_are_found(tmp_path, monkeypatch, mutant):
    """Swapped indices of derivatives, value references off by one, a payload in other axes, dependencies left out."""
    scene = rne.Scene(small(), friction=rne.Friction(viscous=2.0))
    if mutant == "axes":
        model = scene.robot.model
        quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
        turned = replace(model, link_rotation=model.link_rotation @ quarter)
        module = sys.modules[NamedNumbers.__module__]
        original = module.parameters_on_body
        monkeypatch.setattr(module, "parameters_on_body", lambda _, link, pi: original(turned, link, pi))
        with pytest.raises(AssertionError):
            check_payload(scene)
        return
    if mutant == "missing":
        reached = SceneUnit.reached
        monkeypatch.setattr(SceneUnit, "reached", lambda *given: [{*list(p)[1:]} for p in reached(*given)])
    variables, depends, source = described(scene, tmp_path / "a.fmu", derivatives=False)
    {"swapped": swapped, "shifted": shifted}.get(mutant, lambda _: None)(variables)
    with pytest.raises(AssertionError):
        check_all(scene, variables, depends, source)


@pytest.mark.parametrize(
    ("parts", "how", "said"),
    [
        ({"friction": rne.Friction(coulomb=1.0, smoothing=0)}, {}, "no function of time and state: dry `friction` sticks and slips"),
        ({"controller": lambda t, q, qd: -qd}, {}, "`controller` is called, as it is not marked by rne.traceable"),
        ({"controller": lambda t, q, qd: -qd, "sample_time": 0.01}, {}, "`controller` is called, as it is not marked"),
        ({"controller": "pd", "sample_time": 0.01, "torque_rate": 9.0}, {}, "state: `torque_rate` bounds torques by those before"),
        ({"controller": "pd", "sample_time": 0.01, "delay": 0.01}, {"numbers": ["delay"]}, "`numbers` cannot have 'delay'"),
        ({"payload": rne.Payload(1.0, link="link_1")}, {"payload": "link_2"}, "`payload` must be on the link of the scene's, 'link_1'"),
        ({}, {"numbers": ["mass"]}, "`numbers`: the scene has the numbers"),
        ({"stops": True}, {"q0": [9.0, 0, 0]}, "`q0` must be within the stops"),
        ({}, {"q0": [0.0, 0]}, "`q0` must have shape"),
        ({}, {"fmi": "1.0"}, "`fmi` must be '2.0' or '3.0', got '1.0'"),
        ({}, {"platforms": ["aarch64-linux"]}, "`platforms` must be some of"),
        ({"locked": {f"joint_{k}": 0.0 for k in (1, 2, 3)}}, {}, "robot 'irb140' has no joint that moves"),
    ],
)  # fmt: skip
def test_what_no_unit_can_have_is_refused(tmp_path, parts, how, said):
    law = parts.get("controller")
    parts = parts | ({"controller": rne.control.pd_gravity(small(), 50, 20, 0)} if law == "pd" else {})
    with pytest.raises(ValueError, match=re.escape(said)):
        rne.Scene(small(), **parts).to_fmu(tmp_path / "a.fmu", **{"platforms": (), "derivatives": False} | how)


def test_without_a_compiler_there_are_sources_alone(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr("shutil.which", lambda name: None)
    monkeypatch.delenv("CC", raising=False)
    scene = rne.Scene(small())
    assert scene.to_fmu(tmp_path / "a.fmu", derivatives=False) == ()
    assert "no binaries for x86_64-linux, x86_64-windows, x86_64-darwin, which the extra `fmu` builds" in caplog.text
    with pytest.raises(ImportError, match="no binaries for x86_64-linux"):
        scene.to_fmu(tmp_path / "a.fmu", derivatives=False, platforms=["x86_64-linux"])


def test_the_command_writes_a_unit_and_replaces_its_own_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("rne.kernels.exports.fmu.binaries", lambda source, name, asked, must: {})
    robot, path = tmp_path / "arm.urdf", tmp_path / "arm.fmu"
    robot.write_text(rne.to_urdf(small().model), encoding="utf-8")
    assert main(["export", str(robot), str(path), "--fmi", "3.0", "--payload-at", "link_2"]) == 0
    assert is_marked(path)
    assert "arm.fmu: FMI 3.0, only sources" in capsys.readouterr().out
    with zipfile.ZipFile(path) as archive:
        assert "payload.mass" in archive.read("modelDescription.xml").decode()
    path.write_bytes(b"a file of others")
    assert main(["export", str(robot), str(path)]) != 0
    assert "arm.fmu" in capsys.readouterr().err
    assert path.read_bytes() == b"a file of others"


@needs_fmpy
@long
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize(("name", "kind"), itertools.product(ROBOTS, KINDS))
def test_co_simulation_is_rne_simulate(name, kind, fmi):
    if fmi == "3.0" and name != "ur5":
        pytest.skip("both versions have one text for motions")
    scene, path = built(name, kind, fmi)
    times = np.arange(0, 21) * 0.1
    _, motion = reference_motion(scene, kind, times)
    unit, values = open_with(scene, kind, path)
    unit.begin(**values)
    for k, t in enumerate(times):
        if k:
            unit.step(0.1)
        for key in ("q", "qd", "tau", "motor_q", "motor_qd"):
            if f"{key}[1]" not in unit.vr:
                continue
            found = unit.get(key, scene.n)
            wanted = getattr(motion, key)[k]
            scale = max(1.0, np.abs(wanted).max())
            worst = np.abs(found - wanted).max()
            bound = SAME * scale * (1 if key != "tau" else 1e3)
            assert worst <= bound, (key, t, worst)


def rates_of(scene, t, x, u=None):
    """dx/dt and the torques of the drives."""
    dynamics = replace(scene.dynamics, has_energies=False, inertia=None)
    dynamics = replace(dynamics, inputs="called") if scene.controller is None else dynamics
    kernel = scene.kernels.scene_kernel(dynamics.rates_and_drives)
    given = {"t": np.array([t]), "x": x, "u": u, "numbers": dynamics.vector}
    slopes = scene.kernels.scene_kernel(dynamics.rates_and_drives, *(k for k in ("x", "u") if k in kernel.names))
    arrays = [given[k] for k in kernel.names]
    return kernel(*arrays), slopes(*arrays)


@needs_fmpy
@long
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize(("name", "kind"), itertools.product(ROBOTS, ["torques", "pid", "elastic", "springs"]))
def test_rates_and_their_derivatives(name, kind, fmi):
    """Rates within 1e-14 of their size and directional derivatives within 1e-12, by states and inputs one by one."""
    scene, path = built(name, kind, fmi)
    unit, rng = Opened(path, exchange=True), np.random.default_rng(0)
    unit.begin()
    states = [v for v in unit.description.modelVariables if v.derivative is not None]
    rates = [v.valueReference for v in states]
    x = rng.uniform(-0.5, 0.5, len(rates))
    u = None
    if scene.controller is None:
        u = torque(scene)
        unit.set("torque", u)
    import ctypes

    pointer = ctypes.POINTER(ctypes.c_double)
    unit.fmu.setContinuousStates(x.ctypes.data_as(pointer), len(x))
    found = np.zeros(len(x))
    (unit.fmu.getDerivatives if fmi == "2.0" else unit.fmu.getContinuousStateDerivatives)(
        found.ctypes.data_as(pointer), len(x)
    )
    wanted, slopes = rates_of(scene, 0.0, x, u)
    assert np.abs(found - wanted[: len(x)]).max() <= 1e-14 * np.abs(wanted).max()
    knowns = [unit.vr[v.derivative.name] for v in states]
    knowns += [unit.vr[f"torque[{k + 1}]"] for k in range(scene.n)] if u is not None else []
    for column, known in enumerate(knowns):
        got = np.array(unit.fmu.getDirectionalDerivative(rates, [known], [1.0]))
        assert np.abs(got - slopes[: len(x), column]).max() <= 1e-12 * max(1.0, np.abs(slopes[:, column]).max())
    if fmi == "3.0":
        weights = rng.normal(size=len(rates))
        got = np.array(unit.fmu.getAdjointDerivative(rates, knowns, weights, len(knowns)))
        wanted = weights @ slopes[: len(x)]
        assert np.abs(got - wanted).max() <= 1e-12 * np.abs(slopes).max()


def integrated(unit, scene, end, times, rtol):
    """States at times by model exchange: SciPy's solver between events, as an importer has it."""
    import ctypes

    from scipy.integrate import solve_ivp

    pointer = ctypes.POINTER(ctypes.c_double)
    rates = unit.fmu.getDerivatives if unit.is_2 else unit.fmu.getContinuousStateDerivatives
    update = unit.fmu.newDiscreteStates if unit.is_2 else unit.fmu.updateDiscreteStates
    size = sum(v.derivative is not None for v in unit.description.modelVariables)
    x, dx = np.zeros(size), np.zeros(size)
    unit.fmu.getContinuousStates(x.ctypes.data_as(pointer), size)

    def f(t, y):
        y = np.ascontiguousarray(y)
        unit.fmu.setTime(t)
        unit.fmu.setContinuousStates(y.ctypes.data_as(pointer), size)
        rates(dx.ctypes.data_as(pointer), size)
        return dx.copy()

    t, found = 0.0, [x.copy()]
    for goal in times[1:]:
        while t < goal:
            unit.fmu.setTime(t)
            unit.fmu.setContinuousStates(x.ctypes.data_as(pointer), size)
            unit.fmu.enterEventMode()
            *_, is_timed, instant = update()
            unit.fmu.enterContinuousTimeMode()
            until = min(goal, instant) if is_timed else goal
            solution = solve_ivp(f, (t, until), x, method="DOP853", rtol=rtol, atol=rtol)
            t, x = until, solution.y[:, -1].copy()
        found.append(x.copy())
    return np.array(found)


@needs_fmpy
@long
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize("kind", ["torques", "pid", "elastic", "sampled", "sampled_pid"])
def test_model_exchange_is_rne_simulate(kind, fmi):
    """Events by time sample the laws; a solver of order 8 at 1e-10 then keeps some 1e-8 over 1 s."""
    scene, path = built("ur5", kind, fmi)
    times = np.arange(6) * 0.2
    _, motion = reference_motion(scene, kind, times)
    unit, values = open_with(scene, kind, path, exchange=True)
    unit.begin(**values)
    found = integrated(unit, scene, 1.0, times, 1e-10)
    assert np.abs(found[:, : scene.n] - motion.q).max() < 1e-8


@needs_fmpy
@long
@pytest.mark.parametrize(("fmi", "way"), itertools.product(["2.0", "3.0"], ["CoSimulation", "ModelExchange"]))
@pytest.mark.parametrize("kind", ["torques", "pid", "sampled"])
def test_fmpy_simulates_it(kind, fmi, way):
    """By fmpy's own master and, for model exchange, its CVode, which begins anew at each of 500 samples and commands."""
    import fmpy

    scene, path = built("irb140", kind, fmi)
    _, values = open_with(scene, kind, path)
    starts = {f"torque[{k + 1}]": x for k, x in enumerate(values.get("torque", []))}
    names = [f"q[{k + 1}]" for k in range(scene.n)]
    found = fmpy.simulate_fmu(
        path,
        fmi_type=way,
        stop_time=0.5,
        output_interval=0.05,
        relative_tolerance=1e-8,
        start_values=starts,
        output=names,
    )
    q0, qd0 = start(scene)
    keep = np.searchsorted(found["time"], np.arange(11) * 0.05 - 1e-9)
    times = found["time"][keep]
    motion = rne.simulate(scene, q0, qd0, 0.6, torque=torque(scene), rtol=1e-12, atol=1e-12, t_eval=times)
    q = np.stack([found[name][keep] for name in names], axis=-1)
    assert np.abs(q - motion.q).max() < (2e-5 if kind == "sampled" and way == "ModelExchange" else 1e-6)


@needs_fmpy
@long
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_every_variable_by_its_name(fmi):
    scene, path = built("irb140", "pid", fmi)
    _, motion = reference_motion(scene, "pid", np.array([0, 0.3]))
    unit = Opened(path).begin()
    unit.step(0.3)
    q0, qd0 = start(scene)
    z = motion.controller_state[-1] if hasattr(motion, "controller_state") else unit.get("z", scene.n)
    x = np.concatenate([motion.q[-1], motion.qd[-1], z])
    rates, _ = rates_of(scene, 0.3, x)
    size = len(x)
    wanted = {"q": motion.q[-1], "qd": motion.qd[-1], "z": z, "tau": motion.tau[-1], "q0": q0, "qd0": qd0}
    wanted |= {"reference": np.full(scene.n, 0.2)}
    values = {f"{key}[{k + 1}]": x for key, row in wanted.items() for k, x in enumerate(row)} | {"time": 0.3}
    states = [f"{key}[{k + 1}]" for key in ("q", "qd", "z") for k in range(scene.n)]
    values |= {f"der({name})": rate for name, rate in zip(states, rates[:size], strict=True)}
    assert values.keys() == unit.vr.keys()
    for name, value in values.items():
        assert abs(unit.get(name)[0] - value) < 1e-8 * max(1.0, abs(value)), name


@needs_fmpy
@long
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_the_first_stop_ends_it(tmp_path, fmi):
    """At the time that rne.simulate finds, within 1e-9 s, by co-simulation and by fmpy's solver."""
    import fmpy

    scene = rne.Scene(rne.load("irb140"), stops=True)
    q0 = np.full(6, 0.1)
    motion = rne.simulate(scene, q0, np.zeros(6), 5.0, rtol=MINUTE, atol=MINUTE)
    assert motion.status == 1
    path = str(tmp_path / "falls.fmu")
    scene.to_fmu(path, fmi=fmi, q0=q0, platforms=HERE)
    unit = Opened(path).begin()
    assert unit.get("stop[1]") > 0
    if fmi == "2.0":
        from fmpy.fmi1 import FMICallException
        from fmpy.fmi2 import fmi2LastSuccessfulTime, fmi2Terminated

        while not unit.fmu.getBooleanStatus(fmi2Terminated):
            with contextlib.suppress(FMICallException):  # of the step that the stop ends
                unit.step(0.01)
        assert unit.fmu.getBooleanStatus(fmi2Terminated)
        end = unit.fmu.getRealStatus(fmi2LastSuccessfulTime)
    else:
        has_ended = False
        while not has_ended:
            _, has_ended, _, end = unit.step(0.01)
    assert abs(end - motion.t[-1]) < 1e-9
    found = fmpy.simulate_fmu(
        path, fmi_type="ModelExchange", stop_time=5.0, relative_tolerance=1e-10, output_interval=0.01
    )
    assert abs(found["time"][-1] - motion.t[-1]) < 1e-6


STEPS = np.random.default_rng(0).uniform(1e-4, 5e-3, 60)


def walked(unit, scene, steps):
    rows = []
    for h in steps:
        unit.step(float(h))
        rows.append(np.concatenate([unit.get("q", scene.n), unit.get("qd", scene.n), unit.get("tau", scene.n)]))
    return np.array(rows)


@needs_fmpy
@long
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize("kind", ["pid", "sampled_pid"])
def test_a_state_that_is_taken_back_gives_the_same_bits(kind, fmi):
    scene, path = built("irb140", kind, fmi)
    unit = Opened(path).begin()
    walked(unit, scene, STEPS[:20])
    kept, t = unit.state(), unit.t
    first = walked(unit, scene, STEPS[20:])
    unit.restore(kept, t)
    assert np.array_equal(walked(unit, scene, STEPS[20:]), first)
    other = Opened(path).begin()
    other.restore(kept, t)
    assert np.array_equal(walked(other, scene, STEPS[20:]), first)


@needs_fmpy
@long
def test_eight_threads_give_the_same_bits():
    scene, path = built("irb140", "sampled_pid")
    units, found = [Opened(path).begin() for _ in range(9)], [None] * 9

    def run(k):
        found[k] = walked(units[k], scene, STEPS)

    threads = [threading.Thread(target=run, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    run(8)
    assert all(np.array_equal(rows, found[8]) for rows in found)


@needs_fmpy
@long
@pytest.mark.skipif(shutil.which("cmake") is None, reason="there is no CMake here")
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_fmpy_builds_it_from_its_own_sources(tmp_path, fmi):
    import fmpy
    from fmpy.build import build_platform_binary

    scene, path = built("irb140", "pid", fmi)
    wanted = walked(Opened(path).begin(), scene, STEPS[:10])
    alone = tmp_path / "alone"
    with zipfile.ZipFile(path) as archive:
        archive.extractall(alone, [name for name in archive.namelist() if not name.startswith("binaries")])
    (tmp_path / "build").mkdir()
    build_platform_binary(alone, tmp_path / "build")
    rebuilt = tmp_path / "rebuilt.fmu"
    shutil.make_archive(str(rebuilt), "zip", alone)
    found = walked(Opened(f"{rebuilt}.zip").begin(), scene, STEPS[:10])
    assert np.abs(found - wanted).max() < 1e-11  # by another compiler, with other options
    assert fmpy.supported_platforms(path)


@needs_fmpy
@long
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_fmpy_finds_nothing_wrong(fmi):
    from fmpy.validation import validate_fmu

    for kind in KINDS:
        assert validate_fmu(built("ur5", kind, fmi)[1]) == []


@long
@pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed")
def test_all_platforms_are_small_and_come_out_the_same_twice(tmp_path):
    """By Zig below 150 kB each, with a payload and derivatives; those of Windows and macOS have never been run."""
    robot = rne.load("ur10")
    scene, how = rne.Scene(robot, controller=pid(robot)), {"fmi": "3.0", "payload": "tool0"}
    paths = [tmp_path / "a.fmu", tmp_path / "b.fmu"]
    for path in paths:
        assert len(scene.to_fmu(path, **how)) == 6
    assert paths[0].read_bytes() == paths[1].read_bytes()
    with zipfile.ZipFile(paths[0]) as archive:
        sizes = [x.file_size for x in archive.infolist() if x.filename.startswith("binaries")]
    assert len(sizes) == 6
    assert max(sizes) < 150_000


LOADER = Path("/usr/aarch64-linux-gnu")  # of Debian's libc6-arm64-cross
IMPORTER = """#include <dlfcn.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
typedef void* (*Make)(const char*, const char*, const char*, bool, bool, bool, bool, void*, size_t, void*, void*, void*);
typedef int (*Enter)(void*, bool, double, double, bool, double);
typedef int (*Exit)(void*);
typedef int (*Step)(void*, double, double, bool, bool*, bool*, bool*, double*);
typedef int (*Get)(void*, const uint32_t*, size_t, double*, size_t);

int main(int count, char** words) // FILE TOKEN
{
    bool flags[3];
    double q[3], t;
    const uint32_t places[] = {1, 2, 3};
    void* unit = dlopen(words[1], RTLD_NOW);
    void* arm = unit ? ((Make)dlsym(unit, "fmi3InstantiateCoSimulation"))("", words[2], 0, 0, 0, 0, 0, 0, 0, 0, 0, 0) : 0;
    int failed = !arm || ((Enter)dlsym(unit, "fmi3EnterInitializationMode"))(arm, 1, 1e-12, 0, 0, 0);
    failed = failed || ((Exit)dlsym(unit, "fmi3ExitInitializationMode"))(arm);
    for (int k = 0; k < 64 && !failed; k++)
        failed = ((Step)dlsym(unit, "fmi3DoStep"))(arm, k / 64.0, 1 / 64.0, 0, flags, flags + 1, flags + 2, &t);
    failed = failed || ((Get)dlsym(unit, "fmi3GetFloat64"))(arm, places, 3, q, 3);
    printf("%.17g %.17g %.17g", q[0], q[1], q[2]);
    return failed;
}
"""


@long
@pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed")
@pytest.mark.skipif(shutil.which("qemu-aarch64") is None or not LOADER.exists(), reason="there is no emulated aarch64")
def test_the_binary_for_aarch64_moves_as_simulate_does(tmp_path):
    scene = rne.Scene(small(), controller=pid(small()), friction=rne.Friction(viscous=2.0))
    scene.to_fmu(tmp_path / "a.fmu", fmi="3.0", platforms=["aarch64-linux"], derivatives=False)
    with zipfile.ZipFile(tmp_path / "a.fmu") as archive:
        archive.extractall(tmp_path)
    token = ElementTree.parse(tmp_path / "modelDescription.xml").getroot().get("instantiationToken")
    (tmp_path / "importer.c").write_text(IMPORTER)
    words = sys.executable, "-m", "ziglang", "cc", "-target", "aarch64-linux-gnu.2.17", "importer.c", "-ldl"
    subprocess.run([*words, "-o", "importer"], cwd=tmp_path, check=True)
    (binary,) = (tmp_path / "binaries" / "aarch64-linux").iterdir()
    words = "qemu-aarch64", "-L", str(LOADER), "./importer", str(binary), token
    said = subprocess.run(words, cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    motion = rne.simulate(scene, [0] * 3, [0] * 3, 1.0, rtol=MINUTE, atol=MINUTE, method="DOP853")
    assert np.abs(motion.q[-1]).max() > 0.01
    assert np.abs(np.array(said.split(), float) - motion.q[-1]).max() < SAME


@needs_fmpy
@long
@pytest.mark.parametrize("sampling", [{}, {"sample_time": 2e-3, "delay": 1e-3}], ids=["continuous", "sampled"])
@pytest.mark.parametrize("kind", ["hold", "spline", "quintic"])
def test_references_that_are_motions_are_inside(tmp_path, kind, sampling):
    """Where they jump both ways of simulation have an event, so that no step goes across."""
    robot, rng = arm("irb140"), np.random.default_rng(1)
    I, T = size_of(robot), np.linspace(0, 2.1, 8)
    rows = rng.uniform(-0.3, 0.3, (8, 6))
    references = {"hold": lambda: rne.trajectories.sampled(T, rows), "spline": lambda: rne.trajectories.spline(T, rows)}
    references["quintic"] = lambda: rne.trajectories.quintic(rows[0], rows[1], 1.0)
    law = rne.control.pd_gravity(robot, 100 * I, 10 * I, references[kind]())
    scene, path = rne.Scene(robot, controller=law, **sampling), str(tmp_path / "a.fmu")
    scene.to_fmu(path, platforms=HERE)
    t = np.arange(21) * 0.1
    motion = rne.simulate(scene, [0] * 6, [0] * 6, 2.05, rtol=MINUTE, atol=MINUTE, t_eval=t)
    unit, found = Opened(path).begin(), []
    for instant in t:
        if instant:
            unit.step(instant - unit.t)
        found.append(unit.get("q", 6))
    assert np.abs(np.array(found) - motion.q).max() < SAME
    exchanged = integrated(Opened(path, exchange=True).begin(), scene, 2.0, t, 1e-11)
    assert np.abs(exchanged[:, :6] - motion.q).max() < 1e-8


@needs_fmpy
@long
@pytest.mark.parametrize("kind", ["torques", "pid", "sampled"])
def test_derivatives_by_numbers_are_slopes(tmp_path, kind):
    """Of accelerations by a payload and by friction, and by gains where the law is not sampled, by differences."""
    robot = arm("irb140")
    scene = replace(KINDS[kind](robot), friction=rne.Friction(viscous=2.0))
    path, names = str(tmp_path / "a.fmu"), ["friction.viscous", *(["controller.kp"] if kind != "torques" else [])]
    q0, qd0 = start(scene)
    scene.to_fmu(path, q0=q0, qd0=qd0, payload="tool0", numbers=names, platforms=HERE)
    unit = Opened(path).begin(**{"payload.mass": 2.0, "payload.com": np.array([0.02, 0.01, 0.1])})
    unknowns, h = [unit.vr[f"der(qd[{k}])"] for k in range(1, 7)], 1e-3
    for name in ("payload.mass", "payload.com[3]", "payload.inertia[2]", "friction.viscous[5]", "controller.kp[2]"):
        if name not in unit.vr:
            continue
        found = np.array(unit.fmu.getDirectionalDerivative(unknowns, [unit.vr[name]], [1.0]))
        rows, value = [], unit.get(name)[0]
        for moved in (value - h, value + h):
            unit.set(name, moved)
            rows.append(np.array(unit.fmu.getReal(unknowns)))
        unit.set(name, value)
        wanted = (rows[1] - rows[0]) / (2 * h)
        assert np.abs(found - wanted).max() < 1e-4 * max(1.0, np.abs(wanted).max()), name  # of differences
        assert np.abs(found).max() > 0 or (kind == "sampled" and name == "controller.kp[2]")
