"""Bytes -> XML elements, hardened: bounded, no recovery, no entities, no document type, no network."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any
from xml.parsers import expat

from .findings import Report

MAX_BYTES = 16 * 2**20
MAX_DEPTH = 256


class _Refused(Exception):
    """Stops the first pass; the finding is already reported."""


def read_bytes(path: str | os.PathLike[str], report: Report) -> bytes | None:
    """The file's bytes, or None with a finding if it is no regular file or too large."""
    file = Path(path)
    if not file.exists():
        raise FileNotFoundError(f"no such file: {str(path)!r}")
    if not file.is_file():
        report.error(None, "file", "is not a regular file", "give the path of a URDF file")
        return None
    with file.open("rb") as stream:
        return stream.read(MAX_BYTES + 1)


def parse(data: bytes, report: Report) -> Any | None:
    """The root element without comments and processing instructions, or None with a finding."""
    from lxml import etree

    if len(data) > MAX_BYTES:
        report.error(None, "file", f"is larger than {MAX_BYTES} bytes", "split the robot or drop what is not URDF")
        return None
    try:
        _first_pass(data, report)
    except _Refused:
        return None
    except (expat.ExpatError, ValueError, LookupError) as error:
        _not_xml(report, error, getattr(error, "lineno", None))
        return None
    parser = etree.XMLParser(
        recover=False,
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        dtd_validation=False,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        return etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        _not_xml(report, error, error.lineno)
        return None


def _not_xml(report: Report, error: Exception, line: int | None) -> None:
    report.error(line, "file", f"is not well-formed XML ({error})", "mend the file, it may be cut off")


def _first_pass(data: bytes, report: Report) -> None:
    """Refuse a document type before anything in it is read, and deep nesting before a tree is built."""
    parser = expat.ParserCreate()
    depth = 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            report.error(
                parser.CurrentLineNumber,
                "file",
                f"is nested deeper than {MAX_DEPTH} elements",
                "a URDF needs about 6",
            )
            raise _Refused

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1

    def doctype(*_: object) -> None:
        message = "document type declarations and entities are not allowed"
        report.error(parser.CurrentLineNumber, "file", message, "remove the <!DOCTYPE ...>")
        raise _Refused

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = doctype
    parser.Parse(data, True)
