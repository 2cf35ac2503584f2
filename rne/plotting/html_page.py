"""Pages: text, tables and pictures that are printed while they grow and written as HTML, also legible on a phone."""

from __future__ import annotations

import html
import importlib.util
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..basics.marks import HTML, PICTURE
from ..basics.spatial import Array
from ..basics.text import plain
from ..robot import Robot
from ..simulation.trajectory import Trajectory
from .plots import has_matplotlib, small_plots
from .robot_picture import animate
from .viewer import view

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CSS = """
:root { color-scheme: light dark; --page: #fff; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 52rem; margin: 1rem auto; padding: 0 1rem;
  background: var(--page); overflow-wrap: break-word; }
.scroll { overflow-x: auto; margin: 1rem 0; /* with a shadow at the side where there is more */
  background: linear-gradient(90deg, var(--page) 50%, transparent) local,
    linear-gradient(-90deg, var(--page) 50%, transparent) right local,
    linear-gradient(90deg, #888a, transparent), linear-gradient(-90deg, #888a, transparent) right;
  background-repeat: no-repeat; background-size: 3rem 100%, 3rem 100%, 1rem 100%, 1rem 100%; }
table { border-collapse: collapse; font-size: .9375rem; width: 100%; }
th, td { border-bottom: 1px solid #8886; padding: .25rem .6rem .25rem 0; text-align: left; vertical-align: top; }
td { white-space: nowrap; }
td.long { white-space: normal; }
pre { white-space: pre-wrap; font-size: .8125rem; }
pre.scroll { white-space: pre; }
figure { margin: 1rem 0; }
figcaption { font-size: .875rem; line-height: 1.4; opacity: .85; margin-top: .25rem; text-align: center; }
img { display: block; width: 100%; max-width: 35rem; height: auto; border-radius: .25rem; margin: auto; }
.pictures { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 22rem), 1fr)); gap: 1rem; }
.pictures figure { margin: 0; }
.pictures figure:last-child:nth-child(odd) { grid-column: 1 / -1; }
@media (min-width: 50rem) { /* as wide as those above it */
  .pictures figure:last-child:nth-child(odd):not(:only-child) img { max-width: calc(50% - .5rem); } }
iframe { display: block; width: 100%; height: min(36rem, 80vh); border: 0; border-radius: .25rem; }
th { vertical-align: bottom; }
@media (max-width: 40rem) { /* each row of a wide table becomes a list */
  .wide thead { display: none; } .wide tr { display: block; padding: .5rem 0; border-bottom: 1px solid #8886; }
  .wide td { display: flex; justify-content: space-between; gap: 1rem; border: 0; padding: .1rem 0; text-align: right; }
  .wide td::before { content: attr(data-label); opacity: .7; text-align: left; }
  .wide td:first-child { font-weight: 600; } }
h3 { margin: 2rem 0 .5rem; }
nav ul { padding-left: 1.25rem; }
nav .h3 { margin-left: 1.25rem; }
@media (prefers-color-scheme: dark) { :root { --page: #121212; } body { color: #ddd; } a { color: #7ab8f5; } }
"""
FONT = 11.0  # smallest text [pt]; 11.2 px where the figure is 358 px wide, on a screen of 390 px
DPI = 150
STYLE: dict[str, Any] = {  # matplotlib's parameters for the figures of pages
    "font.size": FONT,
    "axes.titlesize": FONT,
    "axes.titlelocation": "left",
    "figure.titlesize": FONT + 1,
    "legend.fontsize": FONT,
    "legend.frameon": False,
    "legend.columnspacing": 1.2,
    "legend.handlelength": 1.4,
    "lines.linewidth": 1.3,
    "axes.grid": True,
    "figure.constrained_layout.w_pad": 0.08,  # [inch]
    "grid.alpha": 0.3,
}
DARK: dict[str, Any] = {  # added to matplotlib's style of this name
    **{f"{part}.facecolor": "#121212" for part in ("figure", "axes", "savefig")},
    **{f"axes3d.{axis}axis.panecolor": (0.2, 0.2, 0.2, 0.5) for axis in "xyz"},
    "grid.color": "0.6",
}
DARK_COLORS = (  # matplotlib's ten, of the same hues
    *("#4fa3e0", "#ff9d47", "#5fcf5f", "#ff6b6b", "#b794e8"),
    *("#c08a7a", "#f09ad8", "#a8a8a8", "#d6d84a", "#42d6e6"),
)
NARROW, SHORT, LONGEST = 46, 12, 30  # characters of: a row on a phone; a cell never broken; the longest
SKY = "#e4e9f0"  # behind the robot on light and dark pages, as in the viewer
FILM_FPS = 8.0  # frames per second of the picture instead of a 3-D view
THREE_D = (  # where a browser can draw it, over the picture until it does; the picture stays otherwise
    "<script>if(document.createElement('canvas').getContext('webgl2'))document.currentScript.previousElementSibling"
    '.outerHTML=\'<iframe src="%s.html" title="3-D view" style="background:center/contain no-repeat url(%s.gif)">'
    "</iframe>'</script>"
)


class PageBlock(NamedTuple):
    """Piece of a page: its HTML tag, and its text, the rows of a table, or the name and caption of a picture."""

    tag: str
    content: Any


class Report:
    """Headings, text, tables and pictures, printed at once by `say`, and a page of them; `begin` shows the progress."""

    def __init__(
        self, title: str, say: Callable[[str], None], folder: Path, begin: Callable[[str], None] = lambda what: None
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.title, self.say, self.folder, self.begin = title, say, folder, begin
        self.blocks: list[PageBlock] = []

    def heading(self, text: str, level: int = 2) -> None:
        """Add a section's heading, or with level 3 that of its part."""
        self.say("")
        self.say(text)
        self.blocks.append(PageBlock(f"h{level}", text))

    def text(self, text: str, tag: str = "p") -> None:
        """Add a paragraph, or with the tag `pre` lines in a fixed-width font."""
        for line in text.split("\n"):
            self.say(line)
        self.blocks.append(PageBlock(tag, text))

    def lines(self, text: str) -> None:
        """Add a printed report: its sentences as paragraphs, the rows of its tables in a fixed-width font."""
        for is_table, lines in groupby(text.splitlines(), lambda line: "  " in line):
            for part in ["\n".join(lines)] if is_table else lines:
                self.text(part, "pre" if is_table else "p")

    def table(self, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Add a table of strings; where it is wider than a phone each row becomes a list there."""
        lines = [header, *rows]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        for line in lines:
            self.say("  " + "  ".join(map(str.ljust, line, widths)).rstrip())
        self.blocks.append(PageBlock("table", lines))

    def figure(self, name: str, draw: Callable[[], Figure], caption: str) -> None:
        """Add a picture, drawn once for light pages and once for dark ones; without matplotlib none."""
        if not has_matplotlib():
            return
        import matplotlib.style
        from cycler import cycler

        self.begin(f"drawing {name}.png")

        with matplotlib.style.context([STYLE]):
            draw().savefig(self.folder / f"{name}.png", dpi=DPI, metadata=PICTURE)
        dark = DARK | {"axes.prop_cycle": cycler(color=DARK_COLORS)} | STYLE
        with matplotlib.style.context(["dark_background", dark]):
            draw().savefig(self.folder / f"{name}-dark.png", dpi=DPI, metadata=PICTURE)
        self.blocks.append(PageBlock("picture", (name, caption)))

    def motion(self, name: str, motion: Trajectory, caption: str) -> None:
        """Add small plots of a motion: positions, velocities, torques, energies."""
        for k, (label, draw) in enumerate(small_plots(motion) if has_matplotlib() else [], 1):
            self.figure(f"{name}_{k}", draw, f"{caption}: {label} over time")

    def film(
        self, name: str, motion: Trajectory | tuple[Array, Array], caption: str, robot: Robot | None = None
    ) -> None:
        """Add a Trajectory, or (t, q) of a robot: in 3-D, or as a plain animation where viewer or WebGL is missing."""
        in_3d = importlib.util.find_spec("viser") is not None
        ways = ["in 3-D"] * in_3d + ["as an animation"] * has_matplotlib()
        if not ways:
            return
        self.say(f"drawing the motion {' and '.join(ways)}")
        self.begin("drawing the motion")
        if isinstance(motion, Trajectory):
            assert motion.model is not None
            robot = Robot(motion.model)
        assert robot is not None
        if in_3d:
            path = self.folder / f"{name}.html"
            _ = view(motion, path) if isinstance(motion, Trajectory) else view(robot, path, t=motion[0], q=motion[1])
        if has_matplotlib():
            import matplotlib.style

            with matplotlib.style.context([{f"{part}.facecolor": SKY for part in ("figure", "axes")}]):
                animate(robot, motion, self.folder / f"{name}.gif", fps=FILM_FPS)
        self.blocks.append(PageBlock("film", (name, caption, in_3d)))

    @contextmanager
    def kept_if_interrupted(self) -> Iterator[None]:
        """Write the incomplete page when Ctrl-C ends the block, and say so."""
        try:
            yield
        except KeyboardInterrupt:
            self.text("Interrupted: what follows is missing.")
            raise KeyboardInterrupt(f"the page so far is {self.write()}") from None

    def write(self) -> Path:
        """Write the page as HTML into its folder, with a table of contents before the first heading."""
        if not has_matplotlib():
            self.text("matplotlib is not installed: no pictures (pip install 'rne[plot]').")
        listed = [(k, block) for k, block in enumerate(self.blocks) if is_heading(block)]
        links = [f'<li class="{tag}"><a href="#s{k}">{escape(text)}</a></li>' for k, (tag, text) in listed]
        pieces = [_html(block, k) for k, block in enumerate(self.blocks)]
        if listed:
            pieces.insert(listed[0][0], f"<nav><ul>{''.join(links)}</ul></nav>")
        head = (
            f'<meta charset="utf-8">{HTML}<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self.title)}</title><style>{CSS}</style>"
        )
        body = "\n".join([f"<h1>{escape(self.title)}</h1>", *pieces, ""])
        body = re.sub(r"(<figure><picture>.*\n){2,}", r'<div class="pictures">\n\g<0></div>\n', body)  # side by side
        path, text = self.folder / "index.html", f"<head>{head}</head><body>{body}</body>"
        path.write_text(f'<!doctype html><html lang="en">{text}</html>\n', encoding="utf-8")
        return path


def escape(text: str) -> str:
    """HTML of a text, with escapes for control characters."""
    return html.escape("\n".join(map(plain, text.split("\n"))))


def is_heading(block: PageBlock) -> bool:
    """True if the table of contents lists the block."""
    return block.tag in ("h2", "h3")


def _html(block: PageBlock, number: int) -> str:
    tag, content = block
    if tag == "picture":
        name, caption = content
        dark = f'<source srcset="{name}-dark.png" media="(prefers-color-scheme: dark)">'
        picture = f'<picture>{dark}<img src="{name}.png" alt="{escape(caption)}"></picture>'
        return f"<figure>{picture}<figcaption>{escape(caption)}</figcaption></figure>"
    if tag == "film":
        name, caption, in_3d = content
        film = f'<img src="{name}.gif" alt="{escape(caption)}">' + (THREE_D % (name, name) if in_3d else "")
        return f"<figure>{film}<figcaption>{escape(caption)}</figcaption></figure>"
    if tag == "table":
        header, *rows = [[escape(cell) for cell in line] for line in content]
        is_wide = _is_wide(content)
        labels = [f' data-label="{cell}"' if is_wide else "" for cell in header]
        head = "".join(f"<th>{cell}</th>" for cell in header)
        body = ""
        for row in rows:
            cells = (f"<td{_long(cell)}{x}>{cell}</td>" for x, cell in zip(labels, row, strict=True))
            body += f"<tr>{''.join(cells)}</tr>"
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        return f'<div class="scroll{" wide" * is_wide}">{table}</div>'
    attribute = f' id="s{number}"' if is_heading(block) else ' class="scroll"' * (tag == "pre" and "\n" in content)
    text = re.sub(r"(\de)-(\d)", "\\1\N{NON-BREAKING HYPHEN}\\2", escape(content))  # 1e-13 in one line
    return f"<{tag}{attribute}>{text}</{tag}>"


def _long(cell: str) -> str:
    return ' class="long"' if len(cell) > SHORT else ""


def _is_wide(lines: Sequence[Sequence[str]]) -> bool:
    """True if the rows of a table are too long for a phone; titles and long cells may break between words."""
    header, *rows = lines
    words = [title.split() for title in header]
    for row in rows:
        for k, cell in enumerate(row):
            words[k] += [cell] if len(cell) <= SHORT else cell.split()
    longest = max((len(cell) for row in rows for cell in row), default=0)
    return longest > LONGEST or sum(2 + max(map(len, column), default=0) for column in words) > NARROW


def log_axis(ax: Axes) -> None:
    """A log axis whose labels have no exponents in small print."""
    from matplotlib.ticker import LogFormatter, NullFormatter

    ax.set_yscale("log")
    ax.yaxis.set_major_formatter(LogFormatter())
    ax.yaxis.set_minor_formatter(NullFormatter())
