"""Errors and warnings found in a file, and how they are printed."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from ..basics.text import counted, cut, plain, summary
from ..errors import UrdfError

MAX_NAMES = 10  # most names in one line
OWNER = re.compile(r"(link|joint) ('.*')", re.DOTALL)
ECHO = 83  # most characters of a file's text in a message, dots included


@dataclass(frozen=True)
class Finding:
    """Error or warning about a URDF file.

    Attributes
    ----------
    severity : {"error", "warning"}
        A file with errors does not load; warnings change nothing.
    file : str
        The file, as given.
    line : int or None
        The line of the element; None if it has none.
    element : str
        The link, joint or part of it at fault.
    message : str
        The fault.
    cure : str
        The way to fix it.
    detail : str
        The end of the message, after a colon: numbers in which findings of the same kind differ.

    Examples
    --------
    >>> import rne
    >>> finding = rne.Finding("error", "arm.urdf", 3, "link 'a'", "<mass> is missing", "give it")
    >>> print(finding)
    error: arm.urdf:3: link 'a': <mass> is missing; give it
    """

    severity: Literal["error", "warning"]
    file: str
    line: int | None
    element: str
    message: str
    cure: str
    detail: str = ""

    __repr__ = summary

    def __str__(self) -> str:
        return f"{self.severity}: {self.place}: {self.element}: {self.message}; {self.cure}"

    @property
    def place(self) -> str:
        """File and line."""
        return plain(self.file) if self.line is None else f"{plain(self.file)}:{self.line}"

    @property
    def kind(self) -> str:
        """Message without its detail."""
        return self.message.removesuffix(f": {self.detail}") if self.detail else self.message


class FindingsReport:
    """Collector of the findings on one file; without lines if the examined text was made from the file."""

    def __init__(self, file: str) -> None:
        self.file, self.has_lines = file, True
        self.findings: list[Finding] = []
        self.angles: list[tuple[int, int]] = []  # multiples of 15 degrees as far as written, and their decimals

    def error(self, where: Any, element: str, message: str, cure: str) -> None:
        """Add an error; `where` is the XML element, a line, or None."""
        self.findings.append(Finding("error", self.file, self._line(where), element, message, cure))

    def warning(self, where: Any, element: str, message: str, cure: str, *, detail: str = "") -> None:
        """Add a warning; `where` is the XML element, a line, or None."""
        whole = f"{message}: {detail}" if detail else message
        self.findings.append(Finding("warning", self.file, self._line(where), element, whole, cure, detail))

    def _line(self, where: Any) -> int | None:
        line: int | None = where if isinstance(where, int) or where is None else where.sourceline
        return line if self.has_lines else None

    @property
    def errors(self) -> list[Finding]:
        """Errors among the findings."""
        return [finding for finding in self.findings if finding.severity == "error"]

    def raise_first_error(self) -> None:
        """Raise UrdfError for the first error, if there is one, with the number of others."""
        for finding in self.errors:
            others = len(self.errors) - 1
            more = f"; and {counted(others, 'more error')}: `rne check {near_path(self.file)}`" if others else ""
            raise UrdfError(str(finding).removeprefix("error: ") + more, finding)


def near_path(file: str) -> str:
    """Path relative to the current folder if it is below it, others unchanged."""
    try:
        relative = os.path.relpath(file)
    except ValueError:  # on another drive
        return file
    return file if relative.split(os.sep)[0] == os.pardir else relative


def echo(value: object) -> str:
    """Value of the file in quotes, cut to `ECHO` characters."""
    return repr(cut(str(value), ECHO))


def listed(names: Iterable[str]) -> str:
    """First names in quotes, and the number of others."""
    return some(map(echo, names))


def some(texts: Iterable[str]) -> str:
    """First texts, and the number of others."""
    shown = [*texts]
    more = f" and {len(shown) - MAX_NAMES} more" if len(shown) > MAX_NAMES else ""
    return ", ".join(shown[:MAX_NAMES]) + more


def written(findings: Sequence[Finding], file: str, *, grouped: bool, how: str = "as written") -> list[str]:
    """Lines printed by `rne.check` about a file, with the way in which it loads, if it does."""
    near = near_path(file)
    if not findings:
        return [f"{plain(near)}: no findings"]
    groups: dict[object, list[Finding]] = {}
    for k, finding in enumerate(findings):
        owner = OWNER.fullmatch(finding.element)
        kind = (finding.severity, finding.kind, finding.cure, owner.group(1) if owner else finding.element)
        groups.setdefault(kind if grouped else k, []).append(finding)
    firsts = [(replace(group[0], file=near), group) for group in groups.values()]
    lines = [str(x if len(group) == 1 else replace(x, element=_owners(group), message=x.kind)) for x, group in firsts]
    number = Counter(finding.severity for finding in findings)
    counts = ", ".join(counted(number[name], name) for name in sorted(number))
    return [*lines, f"{plain(near)}: {counts}: {'does not load' if number['error'] else f'loads {how}'}"]


def _owners(group: Sequence[Finding]) -> str:
    """Text of the owners of findings, such as `joints 'a' (0 90 0), 'b' (90 0 0)`, or `robot (3 times)`."""
    owners = [OWNER.fullmatch(finding.element) for finding in group]
    if not all(owners):
        return f"{group[0].element} ({len(group)} times)"
    names: dict[str, list[str]] = {}
    for owner, finding in zip(owners, group, strict=True):
        names.setdefault(owner.group(2) if owner else "", []).append(finding.detail)
    shown = [f"{name} ({'; '.join(details)})" if any(details) else name for name, details in names.items()]
    tag = owners[0].group(1) if owners[0] else ""
    return f"{tag}{'s' * (len(names) > 1)} {some(shown)}"
