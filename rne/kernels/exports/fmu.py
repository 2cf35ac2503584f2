"""Functional Mock-up Unit: its model description, its text in C, its binaries, and the archive.

FMI 2.0.4 and 3.0.2, the standards of the Modelica Association, fmi-standard.org.
"""

from __future__ import annotations

import hashlib
import importlib.util
import logging
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from ...basics.marks import COMMENT
from ...basics.spatial import Array
from .fmu_text import text_around

LOGGER = logging.getLogger("rne")
# Names of platforms in FMI 3.0: those in 2.0, the targets of Zig, the ends of files.
PLATFORMS = {
    "x86_64-linux": ("linux64", "x86_64-linux-gnu.2.17", ".so"),
    "aarch64-linux": ("", "aarch64-linux-gnu.2.17", ".so"),
    "x86_64-windows": ("win64", "x86_64-windows-gnu", ".dll"),
    "aarch64-windows": ("", "aarch64-windows-gnu", ".dll"),
    "x86_64-darwin": ("darwin64", "x86_64-macos", ".dylib"),
    "aarch64-darwin": ("", "aarch64-macos", ".dylib"),
}
OPTIONS = "-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-s", "-lm"
HEADERS = "math.h", "stdbool.h", "stdint.h", "stdlib.h", "string.h"
TOLERANCE = 1e-9  # tolerance of co-simulation by default
DATE = (1980, 1, 1, 0, 0, 0)  # date of all files in the archive, the earliest possible
EXPONENTS = {"kg": (1, 0, 0, 0), "m": (0, 1, 0, 0), "s": (0, 0, 1, 0), "rad": (0, 0, 0, 1), "N": (1, 1, -2, 0)}


class Variable(NamedTuple):
    """Variable of a unit; `of` is the index of the state whose rate it is."""

    name: str
    unit: str  # such as N.m.s/rad
    description: str
    causality: str = "local"
    variability: str = "continuous"
    start: float | None = None
    low: float = -np.inf
    high: float = np.inf
    of: int | None = None


@dataclass(frozen=True)
class MockupUnit:
    """Unit without its version: variables in blocks, functions in C, and the data of the text around these."""

    name: str
    description: str
    blocks: Mapping[str, Sequence[Variable]]
    sizes: Mapping[str, int]
    macros: Mapping[str, Any]
    arrays: Mapping[str, Array]
    functions: str
    depends: Mapping[int, Sequence[int]]  # places of variables that those at a place depend on
    initial: Mapping[int, Sequence[int]]  # the same while the start is computed
    sample_time: float | None
    has_derivatives: bool

    @cached_property
    def variables(self) -> list[Variable]:
        """List of variables; a value reference is an index of it."""
        return [variable for block in self.blocks.values() for variable in block]

    @cached_property
    def stops(self) -> range:
        """Indices of the event indicators."""
        first = self.sizes["STOP"]
        return range(first, first + len(self.blocks["STOP"]))

    def source(self, version: str, token: str) -> str:
        """Text in C."""
        starts = np.array([v.start or 0.0 for v in self.variables])
        lines = [f"/* {self.description}: Functional Mock-up Unit, FMI {version} */"]
        lines += [f"#include <{header}>" for header in HEADERS]
        lines += [f"#define {name} {text}" for name, text in {"TOKEN": f'"{token}"', **self.macros}.items()]
        lines += [f"enum {{ {', '.join(f'{name} = {count}' for name, count in self.sizes.items())} }};"]
        for name, array in {**self.arrays, "starts": starts}.items():
            lines += [f"static const double {name}{''.join(f'[{k}]' for k in array.shape)} = {_literal(array)};"]
        return "\n".join([*lines, self.functions, text_around(version)])

    def model_description(self, version: str, token: str) -> str:
        """Text of modelDescription.xml."""
        is_2, derives = version == "2.0", str(self.has_derivatives).lower()
        can = {"modelIdentifier": self.name, "canGetAndSetFMUState": "true", "canSerializeFMUState": "true"}
        if is_2:
            can = {name.replace("FMUState", "FMUstate"): x for name, x in can.items()}
            can |= {"canNotUseMemoryManagementFunctions": "true", "providesDirectionalDerivative": derives}
        else:
            can |= {"providesDirectionalDerivatives": derives, "providesAdjointDerivatives": derives}
        sources = [_element("SourceFiles", {}, [_element("File", {"name": "fmu.c"})])] if is_2 else []
        units = [_unit(text) for text in dict.fromkeys(v.unit for v in self.variables if v.unit)]
        experiment: dict[str, Any] = {"startTime": 0.0, "stopTime": 1.0, "tolerance": TOLERANCE}
        experiment |= {} if self.sample_time is None else {"stepSize": self.sample_time}
        marks = {"fmiVersion": version, "modelName": self.name, "description": self.description}
        marks |= {"generationTool": "rne", "guid" if is_2 else "instantiationToken": token}
        marks |= {"variableNamingConvention": "structured"}
        marks |= {"numberOfEventIndicators": str(len(self.stops))} if is_2 else {}
        parts = [
            _element("ModelExchange", can, sources),
            _element("CoSimulation", can | {"canHandleVariableCommunicationStepSize": "true"}, sources),
            _element("UnitDefinitions", {}, units),
            _element("DefaultExperiment", experiment),
            _element("ModelVariables", {}, (_variable(k, v, is_2=is_2) for k, v in enumerate(self.variables))),
            _element("ModelStructure", {}, self._structure(is_2=is_2)),
        ]
        return _document(_element("fmiModelDescription", marks, parts))

    def _structure(self, *, is_2: bool) -> list[ElementTree.Element]:
        """Outputs, rates and initial unknowns, each with its dependencies; version 2.0 counts variables from 1."""
        outputs = [k for k, v in enumerate(self.variables) if v.causality == "output"]
        rates = [k for k, v in enumerate(self.variables) if v.of is not None]
        states = [v.of for v in self.variables if v.of is not None]
        named: dict[str, Iterable[int]] = {"Output": outputs}
        named["Derivative" if is_2 else "ContinuousStateDerivative"] = rates
        named["InitialUnknown"] = sorted({*outputs, *rates, *states})
        named |= {} if is_2 else {"EventIndicator": self.stops}
        found, place = [], "index" if is_2 else "valueReference"
        for tag, places in named.items():
            by = self.initial if tag == "InitialUnknown" else self.depends
            each = [{place: k + is_2, "dependencies": " ".join(str(i + is_2) for i in by[k])} for k in places]
            entries = [_element("Unknown" if is_2 else tag, one) for one in each]
            found += [_element(f"{tag}s", {}, entries)] if is_2 and entries else entries
        return found

    def write(self, path: Path, version: str, platforms: Sequence[str] | None) -> tuple[str, ...]:
        """Write the archive; returns the platforms with binaries."""
        is_2, texts = version == "2.0", [self.source(version, ""), self.model_description(version, "")]
        token = f"{{{uuid.UUID(bytes=hashlib.sha256(''.join(texts).encode()).digest()[:16])}}}"
        files = {"sources/fmu.c": self.source(version, token).encode()}
        files["modelDescription.xml"] = self.model_description(version, token).encode()
        if not is_2:
            source = _element("SourceFileSet", {"language": "C99"}, [_element("SourceFile", {"name": "fmu.c"})])
            build = _element("BuildConfiguration", {"modelIdentifier": self.name}, [source])
            whole = _document(_element("fmiBuildDescription", {"fmiVersion": version}, [build]))
            files["sources/buildDescription.xml"] = whole.encode()
        known = [name for name, (folder, *_) in PLATFORMS.items() if folder or not is_2]
        asked = known if platforms is None else [*platforms]
        if unknown := [name for name in asked if name not in known]:
            raise ValueError(f"`platforms` must be some of {known} in FMI {version}, got {unknown[0]!r}")
        built = binaries(files["sources/fmu.c"], self.name, asked, must=platforms is not None)
        for name, content in built.items():
            folder, _, end = PLATFORMS[name]
            files[f"binaries/{folder if is_2 else name}/{self.name}{end}"] = content
        with zipfile.ZipFile(path, "w") as archive:
            archive.comment = COMMENT.encode()
            for name, content in sorted(files.items()):
                archive.writestr(zipfile.ZipInfo(name, DATE), content, zipfile.ZIP_DEFLATED)
        return tuple(built)


def this_machine() -> str:
    """Platform of this machine."""
    machine, system = platform.machine().lower(), {"win32": "windows"}.get(sys.platform, sys.platform)
    return f"{ {'amd64': 'x86_64', 'arm64': 'aarch64'}.get(machine, machine) }-{system}"


def binaries(source: bytes, name: str, asked: Sequence[str], *, must: bool) -> dict[str, bytes]:
    """Shared libraries of a text by platform, built by Zig's compiler, or by this machine's for itself.

    A platform without a compiler is an error if it `must` be built, otherwise a warning on the logger.
    """
    own = os.environ.get("CC") or next(filter(shutil.which, ("cc", "gcc", "clang")), "")
    has_zig, found = importlib.util.find_spec("ziglang") is not None, dict[str, bytes]()
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "fmu.c").write_bytes(source)
        for place in asked:
            _, target, end = PLATFORMS[place]
            if not has_zig and not (own and place == this_machine()):
                continue
            command = [sys.executable, "-m", "ziglang", "cc", "-target", target] if has_zig else [*own.split()]
            command += ["fmu.c", "-o", f"{name}{end}", *OPTIONS, *([] if end == ".dll" else ["-fPIC"])]
            ran = subprocess.run(command, cwd=folder, capture_output=True, text=True)
            if ran.returncode:
                raise RuntimeError(f"the compiler for {place} failed: {ran.stderr.strip()[-500:]}")
            found[place] = (Path(folder) / f"{name}{end}").read_bytes()
    if missing := [place for place in asked if place not in found]:
        text = f"no binaries for {', '.join(missing)}, which the extra `fmu` builds: pip install 'rne[fmu]'"
        if must:
            raise ImportError(text)
        LOGGER.warning("%s", text)
    return found


def _element(tag: str, marks: Mapping[str, Any], inner: Iterable[ElementTree.Element] = ()) -> ElementTree.Element:
    found = ElementTree.Element(tag, {name: str(value) for name, value in marks.items()})
    found.extend(inner)
    return found


def _document(root: ElementTree.Element) -> str:
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _variable(k: int, v: Variable, *, is_2: bool) -> ElementTree.Element:
    marks: dict[str, Any] = {"name": v.name, "valueReference": k, "description": v.description}
    marks |= {"causality": v.causality, "variability": v.variability}
    marks |= {"initial": "calculated"} if v.causality in ("local", "output") else {}
    numbers: dict[str, Any] = {"unit": v.unit} if v.unit else {}
    numbers |= {name: float(x) for name, x in (("min", v.low), ("max", v.high)) if np.isfinite(x)}
    numbers |= {} if v.start is None else {"start": float(v.start)}
    numbers |= {} if v.of is None else {"derivative": v.of + is_2}
    if is_2:
        return _element("ScalarVariable", marks, [_element("Real", numbers)])
    return _element("Float64", marks | numbers)


def _unit(text: str) -> ElementTree.Element:
    """Unit of products and powers, such as N.m.s/rad, with the exponents of SI units."""
    above, _, below = text.partition("/")
    total = np.zeros(len(EXPONENTS["kg"]), dtype=int)
    for half, sign in ((above, 1), (below, -1)):
        for name, power in re.findall(r"([A-Za-z]+)(\d*)", half):
            total += sign * int(power or 1) * np.array(EXPONENTS[name])
    powers = {name: power for name, power in zip(EXPONENTS, total, strict=False) if power}
    return _element("Unit", {"name": text}, [_element("BaseUnit", powers)])


def _literal(array: Array) -> str:
    if array.ndim:
        return f"{{{', '.join(map(_literal, array))}}}"
    return repr(float(array)).replace("inf", "INFINITY")
