"""Bytes -> XML elements, strictly: limited size and depth, no recovery, no document type, no entities, no network."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from .findings import Report, cut

MAX_BYTES = 16 * 2**20
MAX_DEPTH = 256  # libxml2's own limit, which `huge_tree` would lift
STRICT = {
    "recover": False,
    "resolve_entities": False,
    "load_dtd": False,
    "dtd_validation": False,
    "no_network": True,
    "huge_tree": False,
}


class _DocumentType(Exception):
    """The file has a document type declaration."""


class _RootElement(Exception):
    """The root element starts: no document type declaration can follow."""


class _Prolog:
    """Parser target that stops at the document type declaration, before anything in it is read, or at the root."""

    def doctype(self, *_: object) -> None:
        raise _DocumentType

    def start(self, *_: object) -> None:
        raise _RootElement

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
        _check_prolog(data)
        return etree.fromstring(data, etree.XMLParser(remove_comments=True, remove_pis=True, **STRICT))
    except _DocumentType:
        message = "document type declarations and entities are not allowed"
        report.error(_doctype_line(data), "file", message, "remove the <!DOCTYPE ...>")
    except etree.XMLSyntaxError as error:
        _report_syntax_error(error, report)
    return None


def _check_prolog(data: bytes) -> None:
    """Raise _DocumentType if there is a document type declaration. It declares entities, so it must not be parsed."""
    from lxml import etree

    try:
        etree.fromstring(data, etree.XMLParser(target=_Prolog(), **STRICT))
    except _RootElement:
        return


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
        message = f"is not well-formed XML ({cut(reason)})"
        report.error(error.lineno, "file", message, "fix the file, it may be truncated")
