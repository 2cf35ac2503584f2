"""Bytes -> XML elements of URDF, strictly: limited size and depth, no recovery, no document type, no network."""

from __future__ import annotations

import difflib
import math
import os
import re
import shlex
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path, PurePath
from typing import Any, NamedTuple

from ..basics.text import cut
from .findings import ECHO, Report, echo, listed, near_path

MAX_BYTES = 16 * 2**20
MAX_DEPTH = 256  # libxml2's own limit, which `huge_tree` would lift
NAMESPACE = "xacro}"  # how that of its elements ends, in all its versions
LARGEST = sys.float_info.max  # written for a limit that does not exist
# One decimal number in ASCII.
NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?", re.ASCII)
REFUSED = ("recover", "resolve_entities", "load_dtd", "dtd_validation", "huge_tree")
STRICT = {"no_network": True} | dict.fromkeys(REFUSED, False)


class _DocumentType(Exception):
    """The file has a document type declaration."""


class _Prolog:
    """Parser target that stops before anything of a document type declaration is read, or at the root element."""

    def doctype(self, *_: object) -> None:
        raise _DocumentType

    def start(self, *_: object) -> None:
        raise StopIteration

    def close(self) -> None:
        """Required of a parser target; a well-formed document never gets here."""


def read_bytes(path: str | os.PathLike[str], report: Report) -> bytes | None:
    """The file's bytes, or None with a finding if it is not a regular file."""
    file = Path(path)
    if not file.exists():
        raise FileNotFoundError(f"no such file: {str(path)!r}")
    if not file.is_file():
        report.error(None, "file", "is not a regular file", "give the path of a URDF file")
        return None
    with file.open("rb") as stream:
        return stream.read(MAX_BYTES + 1)  # one more than allowed: `parse` refuses it


def parse(data: bytes, report: Report) -> Any | None:
    """The root element without comments and processing instructions, or None with a finding."""
    from lxml import etree

    if len(data) > MAX_BYTES:
        report.error(None, "file", f"is larger than {MAX_BYTES} bytes", "split the robot or remove what is not URDF")
        return None
    try:
        with suppress(StopIteration):  # a document type declaration declares entities, so it must not be parsed
            etree.fromstring(data, etree.XMLParser(target=_Prolog(), **STRICT))
        return etree.fromstring(data, etree.XMLParser(remove_comments=True, remove_pis=True, **STRICT))
    except _DocumentType:
        message = "document type declarations and entities are not allowed"
        report.error(_doctype_line(data), "file", message, "remove the <!DOCTYPE ...>")
    except etree.XMLSyntaxError as error:
        _report_syntax_error(error, report)
    return None


def _doctype_line(data: bytes) -> int | None:
    """A parser target is not told lines: count them, in UTF-16 without the zero bytes."""
    before, found, _ = data.replace(b"\0", b"").partition(b"<!DOCTYPE")
    return before.count(b"\n") + 1 if found else None


def _report_syntax_error(error: Any, report: Report) -> None:
    text = " ".join(str(error.msg).split())
    reason = text.rpartition(", line ")[0].rstrip(" ,") or text
    if "Excessive depth" in reason:
        message = f"is nested deeper than {MAX_DEPTH} elements"
        report.error(error.lineno, "file", message, "a URDF needs about 6")
    else:
        message = f"is not well-formed XML ({cut(str(reason), ECHO)})"
        report.error(error.lineno, "file", message, "fix the file, it may be truncated")


def check_expanded(root: Any, report: Report) -> bool:
    """True if nothing of xacro is left in what is read; otherwise an error that says how to expand the file."""
    for element, _ in elements(root):
        macros = [child for child in element if NAMESPACE in child.tag]
        values = [value for value in element.attrib.values() if "${" in value or "$(" in value]
        if macros or values:
            what = echo(values[0]) if values else f"<xacro:{cut(macros[0].tag.rpartition('}')[2], ECHO)}>"
            where = element if values else macros[0]
            message = f"is a xacro file, not yet a URDF: there is {what}"
            report.error(where, "file", message, f"expand it: {_command(report.file)}")
            return False
    return True


def _command(file: str) -> str:
    path = PurePath(near_path(file))
    bare = path.name.removesuffix(".xacro")
    if bare == path.name:  # xacro in a file called .urdf
        bare = f"{path.stem}_expanded.urdf"
    elif not bare.endswith(".urdf"):
        bare += ".urdf"
    return f"xacro {shlex.quote(os.fspath(path))} > {shlex.quote(os.fspath(path.with_name(bare)))}"


class Rule(NamedTuple):
    """The attributes of an element, the children it may have once, and those it may have many times."""

    attributes: str = ""
    once: str = ""
    many: str = ""

    @property
    def children(self) -> list[str]:
        """All children it may have."""
        return [*self.once.split(), *self.many.split()]


RULES = {
    "robot": Rule("name version", many="link joint material transmission gazebo"),
    "link": Rule("name", once="inertial", many="visual collision"),
    "inertial": Rule(once="origin mass inertia"),
    "origin": Rule("xyz rpy"),
    "mass": Rule("value"),
    "inertia": Rule("ixx ixy ixz iyy iyz izz"),
    "joint": Rule("name type", once="origin parent child axis limit dynamics mimic calibration safety_controller"),
    "parent": Rule("link"),
    "child": Rule("link"),
    "axis": Rule("xyz"),
    "limit": Rule("lower upper effort velocity acceleration jerk"),
    "dynamics": Rule("damping friction"),
    "mimic": Rule("joint multiplier offset"),
    "visual": Rule("name", once="origin geometry", many="material"),
    "geometry": Rule(once="cylinder box sphere mesh capsule"),
    "cylinder": Rule("radius length"),
    "box": Rule("size"),
}
# The attributes that hold numbers: how many, and the text that stands for a missing one; None if it must be there.
# Missing efforts, velocities, accelerations and jerks are infinite once read, as no limit is meant.
NUMBERS: dict[str, dict[str, tuple[int, str | None]]] = {
    "origin": {"xyz": (3, "0 0 0"), "rpy": (3, "0 0 0")},
    "mass": {"value": (1, None)},
    "inertia": dict.fromkeys(RULES["inertia"].attributes.split(), (1, None)),
    "axis": {"xyz": (3, None)},
    "limit": dict.fromkeys(RULES["limit"].attributes.split(), (1, "0")),
    "dynamics": dict.fromkeys(RULES["dynamics"].attributes.split(), (1, "0")),
    "mimic": {"multiplier": (1, "1"), "offset": (1, "0")},
    "cylinder": dict.fromkeys(RULES["cylinder"].attributes.split(), (1, None)),
    "box": {"size": (3, None)},
}
# Known, but used neither for dynamics nor for drawing: their content is not checked.
UNREAD = frozenset(["material", "transmission", "gazebo", "collision", "calibration", "safety_controller"])
UNREAD |= {"sphere", "mesh", "capsule"}


def describe(element: Any) -> str:
    """An element as messages name it: link 'arm', joint 'elbow', or just its tag."""
    name = element.get("name")
    return f"{element.tag} {echo(name)}" if name is not None else f"<{element.tag}>"


def elements(root: Any) -> Iterator[tuple[Any, str]]:
    """Every element that is read, with the link or joint it belongs to; not recursive, as depth is up to the file."""
    stack = [(root, "robot")]
    while stack:
        element, owner = stack.pop()
        if element.tag in ("link", "joint"):
            owner = describe(element)
        yield element, owner
        known = RULES.get(element.tag, Rule()).children
        inside = [c for c in element if c.tag in known and c.tag not in UNREAD]
        stack.extend((child, owner) for child in reversed(inside))


def check_grammar(root: Any, report: Report) -> None:
    """Warn of unknown elements and attributes; report duplicated elements where one is allowed as errors."""
    for element, owner in elements(root):
        rule = RULES[element.tag]
        counts: Counter[str] = Counter()
        for child in element:
            counts[child.tag] += 1
            if child.tag not in rule.children:
                message = f"unknown element {echo(child.tag)} in <{element.tag}> is ignored"
                report.warning(child, owner, message, _cure(str(child.tag), rule.children))
            elif child.tag in rule.once.split() and counts[child.tag] == 2:
                report.error(child, owner, f"<{child.tag}> is duplicated in <{element.tag}>", "keep one of them")
        unknown = [attribute for attribute in element.attrib if attribute not in rule.attributes.split()]
        if unknown:
            what = f"attributes {listed(unknown)}" if unknown[1:] else f"attribute {echo(unknown[0])}"
            message = f"unknown {what} of <{element.tag}> {'are' if unknown[1:] else 'is'} ignored"
            report.warning(element, owner, message, "remove them" if unknown[1:] else "remove it")


def _cure(tag: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(tag, known, n=1)
    return f"remove it, or write <{near[0]}> if that is meant" if near else "remove it"


def checked_numbers(parent: Any, tag: str, owner: str, report: Report) -> dict[str, Any]:
    """By attribute the numbers of a child, finite ones alone; a finding for each of the others."""
    child = parent.find(tag)
    found: dict[str, Any] = {}
    for attribute, (count, default) in NUMBERS[tag].items():
        text = default if child is None else child.get(attribute, default)
        if text is None and child is None:
            continue
        what, amount = f"attribute {attribute!r} of <{tag}>", "one number" if count == 1 else f"{count} numbers"
        values = attribute_numbers(child, attribute, default or "")
        if text is None:
            report.error(child, owner, f"{what} is missing", f"give {amount}")
        elif len(text.split()) != count:
            report.error(child, owner, f"{what} must be {amount}, got {echo(text)}", "fix the attribute")
        elif len(values) != count or not all(map(math.isfinite, values)):
            message = f"{what} must be {amount}, finite and decimal, got {echo(text)}"
            report.error(child, owner, message, "fix the attribute")
        else:
            found[attribute] = values[0] if count == 1 else values
    return found


def attribute_numbers(element: Any | None, attribute: str, default: str = "") -> list[float]:
    """The numbers of an attribute, or of the default if it or the element is missing; none if it is something else."""
    tokens = (default if element is None else element.get(attribute, default)).split()
    return [float(token) for token in tokens] if all(NUMBER.fullmatch(token) for token in tokens) else []
