"""A page of text, tables and pictures, printed while it grows and written as HTML and as Markdown.

It is written out here because no template engine or Markdown converter is among the dependencies.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; display: block; overflow-x: auto; margin: 1rem 0; }
th, td { border-bottom: 1px solid #8886; padding: .25rem .75rem; text-align: left; }
pre { overflow-x: auto; }
picture { display: block; overflow-x: auto; }
img { max-width: 100%; min-width: 34rem; height: auto; border-radius: .25rem; }
@media (prefers-color-scheme: dark) { body { background: #121212; color: #ddd; } }
"""
CONTENTS_FROM = 4  # headings, from which on a page has a table of contents
DARK: dict[str, Any] = {  # added to matplotlib's style of this name
    **{f"{part}.facecolor": "#121212" for part in ("figure", "axes", "savefig")},
    **{f"axes3d.{axis}axis.panecolor": (0.2, 0.2, 0.2, 0.5) for axis in "xyz"},
    "grid.color": "0.6",
}
DARK_COLORS = (
    *("#4fa3e0", "#ff9d47", "#5fcf5f", "#ff6b6b", "#b794e8"),
    *("#c08a7a", "#f09ad8", "#a8a8a8", "#d6d84a", "#42d6e6"),
)


class Block(NamedTuple):
    """A piece of the page, as HTML and as Markdown."""

    html: str
    markdown: str


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
        self.body: list[Block] = []
        self.headings: list[str] = []
        self.files: list[str] = []

    def heading(self, text: str) -> None:
        """Add a section's heading."""
        self.say(f"\n{text}")
        self.headings.append(text)
        self.body.append(Block(f'<h2 id="s{len(self.headings)}">{escape(text)}</h2>', f"## {text}"))

    def text(self, text: str) -> None:
        """Add a paragraph."""
        self.say(text)
        self.body.append(Block(f"<p>{escape(text)}</p>", text))

    def verbatim(self, text: str) -> None:
        """Add lines in a fixed-width font."""
        self.say(text)
        self.body.append(Block(f"<pre>{escape(text)}</pre>", f"```text\n{text}\n```"))

    def table(self, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Add a table of strings."""
        widths = [max(len(row[k]) for row in [header, *rows]) for k in range(len(header))]
        for row in [header, *rows]:
            self.say("  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
        head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
        lines = "".join("<tr>" + "".join(f"<td>{escape(c)}</td>" for c in row) + "</tr>" for row in rows)
        bars = ["|".join(["", *(f" {cell} " for cell in row), ""]) for row in [header, *rows]]
        bars.insert(1, "|---" * len(header) + "|")
        html = f"<table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>"
        self.body.append(Block(html, "\n".join(bars)))

    def figure(self, name: str, draw: Callable[[], Any], caption: str) -> None:
        """Add a picture, drawn once for light pages and once for dark ones."""
        import matplotlib.style
        from cycler import cycler

        draw().savefig(self.folder / f"{name}.png")
        with matplotlib.style.context(["dark_background", DARK | {"axes.prop_cycle": cycler(color=DARK_COLORS)}]):
            draw().savefig(self.folder / f"{name}-dark.png")
        dark = f'<source srcset="{name}-dark.png" media="(prefers-color-scheme: dark)">'
        html = f'<p><picture>{dark}<img src="{name}.png" alt="{escape(caption)}"></picture></p>'
        self.files.append(f"{name}.png")
        self.body.append(Block(html, f"![{caption}](pictures/{name}.png)"))

    def write(self, name: str = "index.html") -> Path:
        """Write the page as HTML into its folder."""
        head = (
            '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self.title)}</title><style>{STYLE}</style>"
        )
        body = f"<h1>{escape(self.title)}</h1>{self._contents()}" + "\n".join(block.html for block in self.body)
        path = self.folder / name
        path.write_text(
            f'<!doctype html><html lang="en"><head>{head}</head><body>{body}</body></html>\n', encoding="utf-8"
        )
        return path

    def _contents(self) -> str:
        if len(self.headings) < CONTENTS_FROM:
            return ""
        links = (f'<li><a href="#s{k}">{escape(text)}</a></li>' for k, text in enumerate(self.headings, 1))
        return f"<nav><ul>{''.join(links)}</ul></nav>"

    def write_markdown(self, path: Path) -> None:
        """Write the page as Markdown, and its pictures into the folder `pictures` beside it."""
        text = "\n\n".join([f"# {self.title}", *(block.markdown for block in self.body)])
        path.write_text(text + "\n", encoding="utf-8")
        if self.files:
            (path.parent / "pictures").mkdir(exist_ok=True)
        for file in self.files:
            shutil.copy(self.folder / file, path.parent / "pictures" / file)
