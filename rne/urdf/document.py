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
from functools import cache
from pathlib import Path, PurePath
from typing import Any, NamedTuple

from ..basics.text import cut, plain
from .findings import ECHO, FindingsReport, echo, listed, near_path

Element = Any  # an element of lxml, which has no types
MAX_BYTES = 16 * 2**20  # largest file [bytes]
MAX_TAGS, MAX_ATTRIBUTES = 300_000, 1000  # of a file and of an element; lxml takes quadratic time for attributes
MAX_DEPTH = 256  # largest depth, libxml2's own limit, which `huge_tree` would lift
XACRO = re.compile(r"(?:\{.*xacro\}|xacro:)(.*)", re.DOTALL)  # elements of all its versions, declared or not
DEFINITIONS, BUILT_IN = ("property", "arg", "macro", "include"), ("if", "unless", "insert_block", "element", "call")
SUGGESTED = 1000  # number of findings after which no name is suggested
# Elements and names of other programs, which are no findings; undeclared prefixes have their own finding.
EXTENSIONS = frozenset(["gazebo", "transmission", "ros2_control", "mujoco", "sensor", "contact", "frame"])
FOREIGN = re.compile(r"\{[^}]*(?:drake|xacro|w3\.org/(?!2001/XInclude))|[^{:]+:")
DRAKE, ROTOR, GEAR = (f"{{http://drake.mit.edu}}{name}" for name in ("", "rotor_inertia", "gear_ratio"))
SIMPLE = "SimpleTransmission"  # the type of a gear between one motor and one joint
READ, DRAWN = "read", "drawn"  # uses of an element: for dynamics, for pictures
LARGEST = sys.float_info.max  # number written for a limit that does not exist
NO_LIMIT = -1.0  # number that manufacturers write instead
UNDECLARED = 201  # libxml2's number of the error about a prefix without a namespace
TRUNCATED = (3, 5, 6, 20)  # expat's numbers of errors at the end of a file
KINDS = {"Blank needed here": 32, "error parsing attribute name": 65}  # texts more specific than their numbers
CURES = dict.fromkeys((9, 32, 81), "save the file as UTF-8, without control characters, and declare no other encoding")
CURES |= dict.fromkeys((23, 26, 68), "write & as &amp; and < as &lt;, and begin names with a letter")
CURES |= dict.fromkeys((38, 65, 73), "close the quotes and the tag before it; within quotes, write < as &lt;")
CURES |= dict.fromkeys((39, 41), "give the attribute a value in quotes")
CURES |= dict.fromkeys((42, 203), "keep one of the two") | {
    4: "give a URDF file, which begins with <robot ...> or <?xml ...?>",
    5: "end the file after the first </robot>",
    45: "end the comment by -->, or get the rest of the file",
    64: "put <?xml ...?> at the very start of the file, or remove it",
    76: "close each element by its own tag, the last opened first",
    80: "write no -- within a comment",
}
# One decimal number in ASCII.
NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?", re.ASCII)
LONGEST = 1100  # characters of a number: all digits of the smallest double are 1077
REFUSED = ("recover", "resolve_entities", "load_dtd", "dtd_validation", "huge_tree")
STRICT = dict.fromkeys(("no_network", "remove_comments", "remove_pis"), True) | dict.fromkeys(REFUSED, False)


class _DocumentType(Exception):
    """Raised where the file has a document type declaration."""


class _Prolog:
    """Parser target that stops before anything of a document type declaration is read, or at the root element."""

    def doctype(self, *_: object) -> None:
        raise _DocumentType

    def start(self, *_: object) -> None:
        raise StopIteration

    def close(self) -> None:
        """Required of a parser target, but not reached in a well-formed document."""


def read_bytes(path: str | os.PathLike[str], report: FindingsReport) -> bytes | None:
    """Bytes of the file, or None with a finding if it is not a regular file."""
    file = Path(path)
    if not file.exists():
        raise FileNotFoundError(f"no such file: {str(path)!r}")
    if not file.is_file():
        report.error(None, "file", "is not a regular file", "give the path of a URDF file")
        return None
    with file.open("rb") as stream:
        return stream.read(MAX_BYTES + 1)  # one more than allowed, which `parse` reports


def below(file: Path, *folders: Path) -> Path | None:
    """File, links followed, if it exists below one of the folders."""
    try:
        found = file.resolve()
        return found if found.is_file() and any(map(found.is_relative_to, folders)) else None
    except (OSError, ValueError, RuntimeError):  # names that no file can have, links in a circle
        return None


def parse(data: bytes, report: FindingsReport) -> Element | None:
    """Root element without comments and processing instructions, or None with a finding."""
    if len(data) > MAX_BYTES:
        report.error(None, "file", f"is larger than {MAX_BYTES} bytes", "split the robot or remove what is not URDF")
        return None
    root = _parsed(data, report)
    if root is not None and (tags := data.count(b"<")) > MAX_TAGS:
        report.error(None, "file", f"has {tags} tags, more than {MAX_TAGS}", "split the robot")
        return None
    for element in () if root is None else root.iter():
        if len(element.attrib) > MAX_ATTRIBUTES:
            message = f"has {len(element.attrib)} attributes, more than {MAX_ATTRIBUTES}"
            report.error(element, f"<{cut(element.tag, ECHO)}>", message, "remove those that are not URDF")
            return None
    return None if root is None else _without_controls(root, report)


def _parsed(data: bytes, report: FindingsReport) -> Element | None:
    from lxml import etree

    parser = etree.XMLParser(**STRICT)
    try:  # a document type may declare entities, so it must not be parsed; the second parse finds other errors
        with suppress(StopIteration, etree.XMLSyntaxError):
            etree.fromstring(data, etree.XMLParser(target=_Prolog(), **STRICT))
        return etree.fromstring(data, parser)
    except _DocumentType:
        message = "document type declarations and entities are not allowed"
        # A parser target is not given lines: they are counted, in UTF-16 without the zero bytes.
        before, found, _ = data.replace(b"\0", b"").partition(b"<!DOCTYPE")
        report.error(before.count(b"\n") + 1 if found else None, "file", message, "remove the <!DOCTYPE ...>")
    except etree.XMLSyntaxError:
        other = _error_by_expat(data)
        if other is None and {entry.type for entry in parser.error_log} == {UNDECLARED}:
            return etree.fromstring(data, etree.XMLParser(**(STRICT | {"recover": True})))
        _report_syntax_error(data, parser.error_log, other, report)
    return None


def _without_controls(root: Element, report: FindingsReport) -> Element:
    """Element with escapes for control characters in attributes, and blanks for line ends, as XML has them."""
    told = False
    for element in root.iter():
        for name, text in element.attrib.items():
            if not text.isprintable():
                text = re.sub(r"[\t\n\r]", " ", text)
                element.set(name, plain(text))
                if not told and plain(text) != text:
                    told = True
                    message = f"attribute {echo(name)} has control characters, read as the escapes in {echo(text)}"
                    report.warning(element, f"<{cut(element.tag, ECHO)}>", message, "remove them here and elsewhere")
    return root


def _error_by_expat(data: bytes) -> Any | None:
    """Error found by expat, which ignores namespaces; after an error of these, libxml2 stops at </robot>."""
    from xml.parsers import expat

    try:
        expat.ParserCreate().Parse(data, True)
    except (expat.ExpatError, LookupError, ValueError) as error:  # the others are about encodings
        return error
    return None


def _report_syntax_error(data: bytes, log: Any, other: Any, report: FindingsReport) -> None:
    """Report the first error of the XML, with a remedy; `other` is the error of expat."""
    code = getattr(other, "code", 0)
    by_expat = 42 if code == 8 else 5 if code else 32, getattr(other, "lineno", None), str(other)
    found = [(entry.type, entry.line, entry.message) for entry in log if entry.type != UNDECLARED]
    kind, line, text = (found or [by_expat])[0]
    reason = cut(" ".join(text.split()), ECHO)
    cure = CURES.get(KINDS.get(reason, kind), "fix the XML there")
    if kind != 45 and code in TRUNCATED:
        cure = "the file is truncated, get the whole of it"
    if not data.strip(b" \t\r\n\xef\xbb\xbf\xfe\xff"):
        report.error(None, "file", "is empty", "give a URDF file")
    elif "Excessive depth" in reason:
        report.error(line, "file", f"is nested deeper than {MAX_DEPTH} elements", "a URDF needs about 6")
    else:
        report.error(line, "file", f"is not well-formed XML ({reason})", cure)


def check_expanded(root: Element, report: FindingsReport) -> bool:
    """Report remains of xacro and undeclared prefixes, as errors in what is read; False if xacro is not expanded."""
    names = {element: found.group(1) for element in root.iter() if (found := XACRO.fullmatch(element.tag))}
    moves = any(joint.get("type") != "fixed" for joint in root.findall("joint"))
    known, told = {*RULES, *(x for rule in RULES.values() for x in rule.attributes.split())}, {"xacro"}
    before = len(report.findings)
    for element, owner, use, around in walk(root):
        for written, place in [(element.tag, around), *((x, use) for x in element.attrib)]:
            prefix, colon, local = written.partition(":")
            if not colon or "{" in written:
                continue
            cure = f'add xmlns:{cut(prefix, ECHO)}="..." to <robot>'
            if local in known and place == READ and prefix != "xacro":
                message = f"the prefix of {echo(written)} is not declared"
                report.error(element, owner, message, f"{cure}, or write {local!r} without it")
            elif prefix not in told:
                told.add(prefix)
                message = f"the prefix {echo(prefix)} is not declared, what has it is ignored"
                report.warning(element, owner, message, f"{cure} for other programs")
        name, texts = names.get(element), [*element.attrib.values(), "" if use else element.text or ""]
        values = [x for x in texts if "${" in x or "$(" in x]
        if not (name or values) or any(above in names for above in element.iterancestors()):
            continue
        what, place = (f"<xacro:{cut(name, ECHO)}>", around) if name else (echo(values[0]), use)
        if name in DEFINITIONS and (name != "include" or moves):
            report.warning(element, owner, f"{what} is left over from xacro and not read", "remove it")
        elif place != READ and element.tag not in (ROTOR, GEAR):
            where = f"in <{element.getparent().tag}>" if name else f"of <{element.tag}>"
            report.warning(element, owner, f"{what} {where} is not expanded, and not read", "expand it for others")
        else:
            message, cure = f"is a xacro file, not yet a URDF: there is {what}", f"expand it: {_command(report.file)}"
            if name and name not in BUILT_IN and not {"macro", "include"} & {*names.values()}:
                message = f"is half expanded: {what} is left in {owner}, a macro that the file does not define"
                cure = "write what it stands for, or remove it"
            del report.findings[before:]
            report.error(element, "file", message, cure)
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


words = cache(str.split)  # of the texts below


class Rule(NamedTuple):
    """Attributes of an element, the children it may have once, and those it may have many times."""

    attributes: str = ""
    once: str = ""
    many: str = ""

    @property
    def children(self) -> list[str]:
        """Names of all allowed children."""
        return words(f"{self.once} {self.many}")


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
    "limit": Rule("lower upper effort velocity acceleration deceleration jerk"),
    "dynamics": Rule("damping friction"),
    "mimic": Rule("joint multiplier offset"),
    "visual": Rule("name", once="origin geometry", many="material"),
    "geometry": Rule(once="cylinder box sphere mesh capsule"),
    "cylinder": Rule("radius length"),
    "box": Rule("size"),
}
# Attributes that are numbers: how many, and the default of a missing one; None if the attribute is required.
# Missing efforts, velocities, accelerations and jerks are read as infinite, as no limit is meant.
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
    **{tag: {"value": (1, None)} for tag in (ROTOR, GEAR)},
}
# Known elements that are used neither for dynamics nor for drawing: their content is not checked.
UNREAD = frozenset(["material", "transmission", "gazebo", "collision", "calibration", "safety_controller"])
UNREAD |= {"sphere", "mesh", "capsule"}


def describe(element: Element) -> str:
    """Name of an element in messages: link 'arm', joint 'elbow', or just its tag."""
    name = element.get("name")
    tag = cut(element.tag, ECHO)
    return f"{tag} {echo(name)}" if name is not None else f"<{tag}>"


def walk(root: Element) -> Iterator[tuple[Element, str, str, str]]:
    """Every element, the link or joint that it belongs to, and its use and its parent's; without recursion."""
    stack = [(root, "robot", READ, READ)]
    while stack:
        element, owner, use, around = stack.pop()
        if use and element.tag in ("link", "joint"):
            owner = describe(element)
        yield element, owner, use, around
        known = RULES.get(element.tag, Rule()).children if use else []
        for child in reversed(element):
            is_used = child.tag in known and child.tag not in UNREAD
            stack.append((child, owner, (DRAWN if child.tag == "visual" else use) if is_used else "", use))


def check_grammar(root: Element, report: FindingsReport) -> None:
    """Warn of unknown elements and attributes; report duplicated elements where one is allowed as errors."""
    for element, owner, *_ in (step for step in walk(root) if step[2]):
        rule = RULES[element.tag]
        counts: Counter[str] = Counter()
        for child in element:
            counts[child.tag] += 1
            if child.tag not in (*rule.children, *EXTENSIONS) and not _is_foreign(child.tag, rule):
                message = f"unknown element {echo(child.tag)} in <{element.tag}> is ignored"
                local = child.tag.rpartition("}")[2] if len(report.findings) < SUGGESTED else ""
                report.warning(child, owner, message, _cure(local, rule.children))
            elif child.tag in words(rule.once) and counts[child.tag] == 2:
                report.error(child, owner, f"<{child.tag}> is duplicated in <{element.tag}>", "keep one of them")
        unknown = [x for x in element.attrib if x not in words(rule.attributes) and not _is_foreign(x, rule)]
        if unknown:
            what = f"attributes {listed(unknown)}" if unknown[1:] else f"attribute {echo(unknown[0])}"
            message = f"unknown {what} of <{element.tag}> {'are' if unknown[1:] else 'is'} ignored"
            report.warning(element, owner, message, "remove them" if unknown[1:] else "remove it")


def _is_foreign(name: str, rule: Rule) -> bool:
    """True for a name of another program, by its namespace; False if what is read has the same name."""
    space, brace, local = name.rpartition("}")
    is_known = local in (*rule.children, *words(rule.attributes)) or "XInclude" in space
    return bool(FOREIGN.match(name) or (brace and not is_known))


def _cure(tag: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(tag, known, n=1) if len(tag) < ECHO else []
    return f"remove it, or write <{near[0]}> if that is meant" if near else "remove it"


def checked_numbers(parent: Element, tag: str, owner: str, report: FindingsReport) -> dict[str, Any]:
    """Finite numbers of a child by attribute; a finding for each of the others."""
    child = parent.find(tag)
    found: dict[str, Any] = {}
    for attribute, (count, default) in NUMBERS[tag].items():
        text = default if child is None else child.get(attribute, default)
        if text is None and child is None:
            continue
        amount = "one number" if count == 1 else f"{count} numbers"
        what = f"attribute {attribute!r} of <{tag.replace(DRAKE, 'drake:')}>"
        values = attribute_numbers(child, attribute, default or "")
        if text is None:
            report.error(child, owner, f"{what} is missing", f"give {amount}")
        elif len(text.split()) != count:
            report.error(child, owner, f"{what} must be {amount}, got {echo(text)}", "fix the attribute")
        elif len(values) != count or not all(map(math.isfinite, values)):
            message = f"{what} must be {amount}, finite and decimal, got {echo(text)}"
            cure = "fix the attribute"
            if tag == "limit" and text.strip().lower().lstrip("+-").startswith("inf"):
                ends = f"write {'-' * ('-' in text)}{LARGEST} for no end; left out it is 0"
                cure = ends if attribute in ("lower", "upper") else "leave it out for no limit"
            report.error(child, owner, message, cure)
        else:
            found[attribute] = values[0] if count == 1 else values
    return found


def attribute_numbers(element: Element | None, attribute: str, default: str = "") -> list[float]:
    """Numbers of an attribute, or of the default if it or the element is missing; [] if it has other text."""
    tokens = (default if element is None else element.get(attribute, default)).split()
    are_numbers = all(len(token) <= LONGEST and NUMBER.fullmatch(token) for token in tokens)
    return [float(token) for token in tokens] if are_numbers else []
