"""Findings as lines of text: those that are alike together, and a summary."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from .findings import Finding, near_path

MAX_NAMES = 10  # in one line

OWNER = re.compile(r"(link|joint) ('.*')", re.DOTALL)


def written(findings: Sequence[Finding], file: str, *, grouped: bool) -> list[str]:
    """The lines that `rne.check` prints."""
    near = near_path(file)
    if not findings:
        return [f"{near}: no findings"]
    groups: dict[object, list[Finding]] = {}
    for k, finding in enumerate(findings):
        owner = OWNER.fullmatch(finding.element)
        kind = (finding.severity, finding.kind, finding.cure, owner.group(1) if owner else finding.element)
        groups.setdefault(kind if grouped else k, []).append(finding)
    return [*(_line(group, near) for group in groups.values()), f"{near}: {_summary(findings)}"]


def _line(group: Sequence[Finding], file: str) -> str:
    first = group[0]
    place = file if first.line is None else f"{file}:{first.line}"
    if len(group) == 1:
        return f"{first.severity}: {place}: {first.element}: {first.message}; {first.cure}"
    return f"{first.severity}: {place}: {_owners(group)}: {first.kind}; {first.cure}"


def _owners(group: Sequence[Finding]) -> str:
    """Such as `joints 'a' (0 90 0), 'b' (90 0 0)`, or `robot (3 times)`."""
    owners = [OWNER.fullmatch(finding.element) for finding in group]
    if not all(owners):
        return f"{group[0].element} ({len(group)} times)"
    names: dict[str, list[str]] = {}
    for owner, finding in zip(owners, group, strict=True):
        names.setdefault(owner.group(2) if owner else "", []).append(finding.detail)
    shown = [f"{name} ({'; '.join(details)})" if any(details) else name for name, details in names.items()]
    tag = owners[0].group(1) if owners[0] else ""
    return f"{tag}{'s' * (len(names) > 1)} {_shortened(shown)}"


def _shortened(names: Sequence[str]) -> str:
    rest = len(names) - MAX_NAMES
    return ", ".join(names) if rest <= 0 else f"{', '.join(names[:MAX_NAMES])} and {rest} more"


def _summary(findings: Iterable[Finding]) -> str:
    """Such as `1 error, 2 warnings: does not load`."""
    severities = [finding.severity for finding in findings]
    errors, warnings = severities.count("error"), severities.count("warning")
    counts = [f"{n} {name}{'s' * (n > 1)}" for n, name in ((errors, "error"), (warnings, "warning")) if n]
    return f"{', '.join(counts)}: {'does not load' if errors else 'loads as written'}"
