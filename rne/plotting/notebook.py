"""HTML of robots and motions for notebooks, by `_repr_html_`: in the notebook's colours, with all text escaped."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterable, Sequence
from functools import singledispatch
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from ..basics.text import UNITS, short, six_digits
from ..model.builder import Part, at_links, disassemble
from ..model.model import REVOLUTE_TYPES, Model
from ..robot import Robot
from ..simulation.trajectory import Trajectory, trajectory_lines
from .plots import has_matplotlib, small_plots
from .robot_picture import small_picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BOX = "overflow-x:auto;max-width:100%;max-height:32em;margin:.4em 0"
TABLE = "border-collapse:collapse;font-size:.9em;table-layout:auto;margin:0"
CELL = "border:0;border-bottom:1px solid rgba(128,128,128,.4);padding:.15em .6em;text-align:left;white-space:nowrap"
PICTURE = "max-width:100%;height:auto;border-radius:4px"
DPI = 200  # pixels per inch, about two for each of the page, for sharp text on dense screens
COLORS_OF_A_PICTURE = 256
NOT_GIVEN = "not given"
BODIES = "Masses with the links on fixed joints included, in the axes of the link:"


@singledispatch
def html(thing: Any) -> str:
    """HTML fragment of an object of one of the classes below; of others the printed text."""
    return _page(f'<div style="{BOX}"><pre style="font-size:.85em;margin:0">{escape(str(thing))}</pre></div>')


@html.register
def _(robot: Robot) -> str:
    """A picture of the robot at q = 0, its joints and its bodies; without matplotlib only the tables."""
    model = robot.model
    pieces = [_text(repr(robot))]
    if has_matplotlib():
        pieces.append(_image(small_picture(robot, np.zeros(robot.n)), f"{short(model.name)} at q = 0"))
    (joint_heads, *joints), (heads, *bodies) = joint_table(model), body_table(model)
    return _page(*pieces, _table(joint_heads, joints), _table(heads, bodies, title=BODIES))


@html.register
def _(motion: Trajectory) -> str:
    """Small plots of positions, velocities, torques and energies, and how the run ended."""
    pieces = [_text("\n".join(trajectory_lines(motion)))]
    if has_matplotlib() and len(motion.t):
        images = [_image(draw(), label) for label, draw in small_plots(motion)]
        pieces.append(f'<div style="display:flex;flex-wrap:wrap;gap:.4em">{"".join(images)}</div>')
    lost = [f"{name} {six_digits(energy[-1])} J" for name, energy in (motion.dissipated or {}).items() if len(energy)]
    return _page(*pieces, *([_text(f"Dissipated: {', '.join(lost)}")] if lost else []))


def joint_table(model: Model) -> list[tuple[str, ...]]:
    """The joints of a robot, the titles of the columns first."""
    parts = disassemble(model)
    followed = {c.joint: f", follows {', '.join(map(short, c.drivers))}" for c in model.couplings}
    rows = [_joint_row(part, parts, followed.get(part.joint, "")) for part in parts if part.joint]
    return [("joint", "type", "parent → child", "range", "speed", "effort"), *rows]


def body_table(model: Model) -> list[tuple[str, ...]]:
    """The bodies of a robot, the titles of the columns first."""
    rows = [_body_row(part) for part in at_links(disassemble(model)) if part.kind != "fixed" or not part.joint]
    return [("link", "mass [kg]", "centre of mass [m]", "inertia about it: xx, yy, zz, xy, xz, yz [kg m²]"), *rows]


def _joint_row(part: Part, parts: Sequence[Part], follows: str) -> tuple[str, ...]:
    unit, speed, effort = (UNITS[name][part.kind not in REVOLUTE_TYPES] for name in ("q", "qd", "tau"))
    kind, limits = part.kind + follows, ("-", "-", "-")
    if part.mimic is not None:
        source = short(parts[part.mimic.independent].joint)
        kind = f"{kind}, mimics {source}: {part.mimic.multiplier:.6g} q + {part.mimic.offset:.6g}"
    if part.kind == "fixed":
        kind = "fixed, does not move"
    else:
        bounded = math.isfinite(part.lower) or math.isfinite(part.upper)
        span = f"{part.lower:.4g} to {part.upper:.4g} {unit}" if bounded else NOT_GIVEN
        span = "unlimited" if part.kind == "continuous" else span
        limits = (span, _limit(part.velocity, speed), _limit(part.effort, effort))
    return short(part.joint), kind, f"{short(parts[part.parent].link)} → {short(part.link)}", *limits


def _limit(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}" if math.isfinite(value) else NOT_GIVEN


def _body_row(part: Part) -> tuple[str, ...]:
    entries = np.asarray(part.inertia, dtype=float)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    centre, inertia = (", ".join(f"{float(x) + 0.0:.4g}" for x in numbers) for numbers in (part.com, entries))
    return short(part.link), f"{float(part.mass):.6g}", centre, inertia


def _page(*pieces: str) -> str:
    return f'<div style="max-width:100%">{"".join(pieces)}</div>'


def _text(text: str) -> str:
    lines = "<br/>".join(escape(line.strip()) for line in text.splitlines())
    return f'<p style="margin:.3em 0;overflow-wrap:anywhere">{lines}</p>'


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], *, title: str = "") -> str:
    """A titled table that scrolls within its box."""

    def line(tag: str, cells: Sequence[str]) -> str:
        inside = (f'<{tag} style="{CELL}">{escape(cell)}</{tag}>' for cell in cells)
        return f"<tr>{''.join(inside)}</tr>"

    body = "".join(line("td", row) for row in rows)
    table = f'<table style="{TABLE}"><thead>{line("th", heads)}</thead><tbody>{body}</tbody></table>'
    return f'{_text(title) if title else ""}<div style="{BOX}">{table}</div>'


def _image(figure: Figure, title: str) -> str:
    """A figure as a picture within the page, readable on light and dark pages by its own background."""
    from PIL import Image

    drawn, file = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=DPI)
    few = Image.open(drawn).convert("RGB").quantize(COLORS_OF_A_PICTURE, dither=Image.Dither.NONE)
    few.save(file, format="png")  # a third of the size, which the notebook's file carries
    data = base64.b64encode(file.getvalue()).decode("ascii")
    width = round(100 * figure.get_figwidth())
    return f'<img src="data:image/png;base64,{data}" alt="{escape(title)}" width="{width}" style="{PICTURE}"/>'
