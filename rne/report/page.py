"""A short HTML page, said line by line while it grows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; display: block; overflow-x: auto; margin: 1rem 0; }
th, td { border-bottom: 1px solid #8886; padding: .25rem .75rem; text-align: left; }
img { max-width: 100%; height: auto; background: white; border-radius: .25rem; }
"""


class Page:
    """Headings, text, tables and pictures, in order."""

    def __init__(self, title: str, say: Callable[[str], None]) -> None:
        self.title = title
        self.say = say
        self.body: list[str] = []

    def heading(self, text: str) -> None:
        """A section's heading."""
        self.say(f"\n{text}")
        self.body.append(f"<h2>{escape(text)}</h2>")

    def text(self, text: str) -> None:
        """A paragraph."""
        self.say(text)
        self.body.append(f"<p>{escape(text)}</p>")

    def table(self, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """A table of strings."""
        widths = [max(len(row[k]) for row in [header, *rows]) for k in range(len(header))]
        for row in [header, *rows]:
            self.say("  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
        head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
        lines = "".join("<tr>" + "".join(f"<td>{escape(c)}</td>" for c in row) + "</tr>" for row in rows)
        self.body.append(f"<table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>")

    def picture(self, file: str, caption: str) -> None:
        """A picture beside the page."""
        self.body.append(f'<p><img src="{escape(file)}" alt="{escape(caption)}"></p>')

    def write(self, path: Path) -> None:
        """Write the page."""
        head = (
            '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self.title)}</title><style>{STYLE}</style>"
        )
        body = f"<h1>{escape(self.title)}</h1>" + "\n".join(self.body)
        path.write_text(
            f'<!doctype html><html lang="en"><head>{head}</head><body>{body}</body></html>\n',
            encoding="utf-8",
        )
