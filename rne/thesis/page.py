"""A page of text, tables and pictures, printed while it grows and written as HTML and as Markdown.

It is written out here because no template engine or Markdown converter is among the dependencies.
"""

from __future__ import annotations

import importlib.util
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from ..validation.agreement import Row

STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 46rem; margin: 1rem auto; padding: 0 1rem;
  overflow-wrap: break-word; }
.scroll { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: .9375rem; }
th, td { border-bottom: 1px solid #8886; padding: .25rem .6rem; text-align: left; vertical-align: top; }
td { white-space: nowrap; }
pre { overflow-x: auto; font-size: .875rem; }
img { display: block; width: 100%; max-width: 35rem; height: auto; border-radius: .25rem; }
th { vertical-align: bottom; }
@media (max-width: 40rem) { table { width: max-content; } th { max-width: 10rem; } }
h3 { margin: 2rem 0 .5rem; }
nav ul { padding-left: 1.25rem; }
@media (prefers-color-scheme: dark) { body { background: #121212; color: #ddd; } a { color: #7ab8f5; } }
"""
DARK: dict[str, Any] = {  # added to matplotlib's style of this name
    **{f"{part}.facecolor": "#121212" for part in ("figure", "axes", "savefig")},
    **{f"axes3d.{axis}axis.panecolor": (0.2, 0.2, 0.2, 0.5) for axis in "xyz"},
    "grid.color": "0.6",
}
DARK_COLORS = (  # matplotlib's ten, of the same hues
    *("#4fa3e0", "#ff9d47", "#5fcf5f", "#ff6b6b", "#b794e8"),
    *("#c08a7a", "#f09ad8", "#a8a8a8", "#d6d84a", "#42d6e6"),
)
SECTION, PART = 2, 3  # levels of headings


def has_matplotlib() -> bool:
    """True if matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


class Block(NamedTuple):
    """A piece of the page, as HTML and as Markdown."""

    html: str
    markdown: str


class Heading(NamedTuple):
    """A heading, its level and its anchor in the HTML page."""

    text: str
    level: int
    anchor: str


class Page:
    """Headings, text, tables and pictures, in order.

    Parameters
    ----------
    title : str
    say : callable
        Called with each line of text as it is added.
    folder : Path
        Where the pictures and the HTML page are written.
    """

    def __init__(self, title: str, say: Callable[[str], None], folder: Path) -> None:
        self.title = title
        self.say = say
        self.folder = folder
        self.intro: list[Block] = []  # before the first heading, and before the contents
        self.body: list[Block] = []
        self.headings: list[Heading] = []
        self.files: list[str] = []

    def heading(self, text: str) -> None:
        """Add a section's heading."""
        self._heading(text, SECTION)

    def subheading(self, text: str) -> None:
        """Add the heading of a part of a section."""
        self._heading(text, PART)

    def _heading(self, text: str, level: int) -> None:
        self.say(f"\n{text}")
        anchor = f"s{len(self.headings) + 1}"
        self.headings.append(Heading(text, level, anchor))
        self._add(f'<h{level} id="{anchor}">{escape(text)}</h{level}>', f"{'#' * level} {text}")

    def text(self, text: str) -> None:
        """Add a paragraph."""
        self.say(text)
        self._add(f"<p>{escape(text)}</p>", text)

    def verbatim(self, text: str) -> None:
        """Add lines in a fixed-width font."""
        self.say(text)
        self._add(f"<pre>{escape(text)}</pre>", f"```text\n{text}\n```")

    def table(self, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Add a table of strings, which scrolls in its own box where it is wider than the page."""
        widths = [max(len(row[k]) for row in [header, *rows]) for k in range(len(header))]
        for row in [header, *rows]:
            self.say("  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
        head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
        lines = "".join("<tr>" + "".join(f"<td>{escape(c)}</td>" for c in row) + "</tr>" for row in rows)
        bars = [
            "|".join(["", *(f" {cell.replace('|', chr(92) + '|')} " for cell in row), ""]) for row in [header, *rows]
        ]
        bars.insert(1, "|---" * len(header) + "|")
        html = f"<table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>"
        self._add(f'<div class="scroll">{html}</div>', "\n".join(bars))

    def comparison(self, rows: Sequence[Row], relative_to: str) -> bool:
        """Add a table of compared quantities; True if all differences are within their bounds."""
        self.table(
            [
                "quantity",
                "symbol",
                f"largest difference, relative to the largest {relative_to}",
                "bound",
                "within bound",
            ],
            [
                [r.quantity, r.symbol, f"{r.worst:.1e}", f"{r.bound:.1e}", "yes" if r.worst <= r.bound else "NO"]
                for r in rows
            ],
        )
        return all(r.worst <= r.bound for r in rows)

    def figure(self, name: str, draw: Callable[[], Any], caption: str) -> None:
        """Add a picture, drawn once for light pages and once for dark ones; without matplotlib none."""
        if not has_matplotlib():
            return
        import matplotlib.style
        from cycler import cycler

        from .canvas import DPI
        from .canvas import STYLE as TEXT

        with matplotlib.style.context([TEXT]):
            draw().savefig(self.folder / f"{name}.png", dpi=DPI)
        dark_style = DARK | {"axes.prop_cycle": cycler(color=DARK_COLORS)} | TEXT
        with matplotlib.style.context(["dark_background", dark_style]):
            draw().savefig(self.folder / f"{name}-dark.png", dpi=DPI)
        dark = f'<source srcset="{name}-dark.png" media="(prefers-color-scheme: dark)">'
        html = f'<picture>{dark}<img src="{name}.png" alt="{escape(caption)}"></picture>'
        self.files.append(f"{name}.png")
        self._add(html, f"![{caption}](pictures/{name}.png)")

    def end(self) -> None:
        """Say why there are no pictures, where there are none."""
        if not has_matplotlib():
            self.text("matplotlib is not installed: no pictures (pip install 'rne[plot]').")

    def _add(self, html: str, markdown: str) -> None:
        (self.body if self.headings else self.intro).append(Block(html, markdown))

    def write(self, name: str = "index.html") -> Path:
        """Write the page as HTML into its folder."""
        head = (
            '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self.title)}</title><style>{STYLE}</style>"
        )
        before, after = ("\n".join(block.html for block in blocks) for blocks in (self.intro, self.body))
        body = f"<h1>{escape(self.title)}</h1>{before}{self._contents()}{after}"
        path = self.folder / name
        path.write_text(
            f'<!doctype html><html lang="en"><head>{head}</head><body>{body}</body></html>\n', encoding="utf-8"
        )
        return path

    def _contents(self) -> str:
        items: list[str] = []
        open_part = False
        for heading in self.headings:
            if heading.level == SECTION and items:
                items.append("</ul></li>" if open_part else "</li>")
                open_part = False
            elif heading.level == PART and not open_part:
                items.append("<ul>")
                open_part = True
            link = f'<li><a href="#{heading.anchor}">{escape(heading.text)}</a>'
            items.append(link if heading.level == SECTION else f"{link}</li>")
        if items:
            items.append("</ul></li>" if open_part else "</li>")
        return f"<nav><ul>{''.join(items)}</ul></nav>" if items else ""

    def _markdown_contents(self) -> Iterator[str]:
        taken: dict[str, int] = {}
        for heading in self.headings:
            slug = re.sub(r"[^\w\- ]", "", heading.text.lower()).replace(" ", "-")  # as GitHub makes them
            taken[slug] = taken.get(slug, -1) + 1
            suffix = f"-{taken[slug]}" if taken[slug] else ""
            yield f"{'  ' * (heading.level - SECTION)}- [{heading.text}](#{slug}{suffix})"

    def write_markdown(self, path: Path) -> None:
        """Write the page as Markdown, and its pictures into the folder `pictures` beside it."""
        before, after = ([block.markdown for block in blocks] for blocks in (self.intro, self.body))
        text = "\n\n".join([f"# {self.title}", *before, "\n".join(self._markdown_contents()), *after])
        path.write_text(text + "\n", encoding="utf-8")
        if self.files:
            (path.parent / "pictures").mkdir(exist_ok=True)
        for file in self.files:
            shutil.copy(self.folder / file, path.parent / "pictures" / file)
