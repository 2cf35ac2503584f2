"""Pages of docs/ whose tables are generated and whose text is written by hand.

A page keeps its text. What is generated stands between two comments, and only that is replaced:

    <!-- table: NAME -->
    ...
    <!-- end of table -->
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
BLOCK = re.compile(r"(<!-- table: ([\w-]+) -->\n).*?(<!-- end of table -->)", re.DOTALL)


def filled(page: str, tables: Mapping[str, str]) -> str:
    """The page with every table replaced; ValueError if page and tables do not have the same names."""
    there = [name for _, name, _ in BLOCK.findall(page)]
    if sorted(there) != sorted(tables):
        raise ValueError(f"the page has the tables {sorted(there)}, given are {sorted(tables)}")
    return BLOCK.sub(lambda found: f"{found[1]}\n{tables[found[2]]}\n\n{found[3]}", page)


def places(path: Path) -> list[str]:
    """Names of the tables that a page has a place for."""
    return [name for _, name, _ in BLOCK.findall(path.read_text(encoding="utf-8"))]


def rewrite(tables: Mapping[str, str], *pages: Path) -> None:
    """Replace the tables of pages and keep their text; ValueError if together they do not have the same names."""
    there = sorted({name for page in pages for name in places(page)})
    if there != sorted(tables):
        raise ValueError(f"the pages have the tables {there}, given are {sorted(tables)}")
    for page in pages:
        text = page.read_text(encoding="utf-8")
        page.write_text(filled(text, {name: tables[name] for name in places(page)}), encoding="utf-8")


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def three(spread: Sequence[float]) -> str:
    """A ratio with its smallest and largest."""
    digits = [f"{x:.0f}" if x >= 100 else f"{x:.2g}" if x < 1 else f"{x:.1f}" for x in spread]
    return f"{digits[0]} ({digits[1]} to {digits[2]})"
