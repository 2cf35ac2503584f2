"""What notebooks show of a robot, a motion, a recursion and a kernel: HTML without scripts or style sheets.

Colours are those of the notebook, light or dark; wide tables scroll in their own boxes, so that a page on a phone does
not. All text passes through `html.escape`, since names come from files.
"""

from __future__ import annotations

import base64
import importlib.util
import io
import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from ..basics.text import counted, html, short, six_digits
from ..dynamics.base_inertial_parameters import BaseParameters
from ..dynamics.record import BRANCHED, LEGEND, VECTORS, Recursion
from ..kernels.heading import UNITS
from ..kernels.kernel import Kernel
from ..model.builder import Part, at_links, disassemble
from ..model.model import REVOLUTE_TYPES, Model
from ..robot import Robot
from ..simulation.summary import trajectory_lines
from ..simulation.trajectory import Trajectory
from .figures import COLORS, blank_figure, literal
from .motions import joint_labels, motion_argument
from .plots import QUANTITIES, Panel, draw_panel, panels_of
from .robot_picture import draw

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BOX = "overflow-x:auto;max-width:100%;max-height:32em;margin:.4em 0"
TABLE = "border-collapse:collapse;font-size:.9em;table-layout:auto;margin:0"
CELL = "border:0;border-bottom:1px solid rgba(128,128,128,.4);padding:.15em .6em;text-align:{};white-space:nowrap"
PICTURE = "max-width:100%;height:auto;border-radius:4px"
DPI = 200  # about two pixels for each of the page, for sharp text on dense screens
COLORS_OF_A_PICTURE = 256
SOURCE_LINES = 16  # of a kernel that are shown
NOT_GIVEN = "not given"
LINE = 100  # characters of a line of source
ACROSS, HIGH = 4.4, 2.6  # size of a small plot [inch], as wide as a phone


@html.register
def robot_page(robot: Robot) -> str:
    """A picture of the robot at q = 0, its joints and its bodies; without matplotlib the tables alone."""
    model, parts = robot.model, at_links(disassemble(robot.model))
    pieces = [_text(repr(robot))]
    if has_matplotlib():
        pieces.append(_image(_robot_figure(robot), f"{short(model.name)} at q = 0"))
    joints = [_joint_row(part, parts) for part in parts if part.joint]
    bodies = [_body_row(part) for part in parts if part.kind != "fixed" or not part.joint]
    heads = ("link", "mass [kg]", "centre of mass [m]", "inertia about it: xx, yy, zz, xy, xz, yz [kg m²]")
    return _page(
        *pieces,
        _table(("joint", "type", "parent → child", "range", "speed", "effort"), joints),
        _text("Masses with the links on fixed joints included, in the axes of the link:"),
        _table(heads, bodies),
    )


@html.register
def trajectory_page(motion: Trajectory) -> str:
    """Small plots of positions, rates, torques and energies, and how the run ended."""
    pieces = [_text("\n".join(trajectory_lines(motion)))]
    if has_matplotlib() and len(motion.t):
        shown = motion_argument("motion", motion)
        labels, rotating = joint_labels(shown, None)
        figures = (_small_plot(shown, panel) for panel in panels_of(shown, labels, rotating, None))
        images = "".join(_image(figure, label) for label, figure in figures)
        pieces.append(f'<div style="display:flex;flex-wrap:wrap;gap:.4em">{images}</div>')
    if motion.dissipated:
        lost = ", ".join(
            f"{name} {six_digits(energy[-1])} J" for name, energy in motion.dissipated.items() if len(energy)
        )
        pieces.append(_text(f"Dissipated by friction: {lost}"))
    return _page(*pieces)


@html.register
def recursion_page(record: Recursion) -> str:
    """The table of a recursion, or of the first state of its batch."""
    if 0 in record.batch or not record.joints:
        return _page(_text(repr(record)))
    pieces = [_text(f"Recursion of {counted(len(record.joints), 'joint')}")]
    if record.batch:
        pieces.append(_text(f"The first of the states of leading shape {record.batch}:"))
        record = record.state((0,) * len(record.batch))
    rows = [row for i in range(len(record.joints)) for row in _record_rows(record, i)]
    notes = LEGEND if record.a_e is not None else (*LEGEND, BRANCHED)
    heads = ("joint", "quantity", "equation", "unit", "x", "y", "z")
    return _page(*pieces, _table(heads, rows, numbers=4), _text(" ".join(notes)))


@html.register
def kernel_page(kernel: Kernel) -> str:
    """Inputs, output and operations of a kernel, and the beginning of its source."""
    pieces = [_text(repr(kernel))]
    n = kernel.model.n
    rows = [
        (name, f"(..., {width})", _units(name, kernel.model))
        for name, width in zip(kernel.names, kernel.widths, strict=True)
    ]
    if not kernel.is_unrolled:
        return _page(
            *pieces, _table(("input", "shape", "unit"), rows), _text(f"Too large to be written out: {n} joints.")
        )
    source = kernel.source().splitlines()
    unit = next(line.split(" - ", 1)[1] for line in source if line.startswith("# Unit of the result"))
    rows.append(("result", f"({', '.join(['...', *map(str, kernel.traced.shape)])})", unit))
    operations = kernel.operations
    counts = [tuple(str(count) for count in (*operations.values(), sum(operations.values())))]
    lines = [line if len(line) <= LINE else f"{line[: LINE - 3]}..." for line in source[:SOURCE_LINES]]
    left = len(source) - len(lines)
    end = [f"    ... {left} more lines: kernel.source()"] if left > 0 else []
    return _page(
        *pieces,
        _table(("array", "shape", "unit"), rows),
        _table((*operations, "all operations"), counts, numbers=0),
        f'<div style="{BOX}"><pre style="font-size:.85em;margin:0">{escape(chr(10).join([*lines, *end]))}</pre></div>',
    )


@html.register
def base_parameters_page(base: BaseParameters) -> str:
    """The combinations of parameters that torques depend on, and their values."""
    rows = [(text, six_digits(value)) for text, value in zip(base.formulas, base.values, strict=True)]
    return _page(_text(repr(base)), _table(("base parameter", "value [SI]"), rows, numbers=1))


def has_matplotlib() -> bool:
    """True if matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def _robot_figure(robot: Robot) -> Figure:
    figure = blank_figure(4.4, 3.9)
    figure.set_layout_engine("none")
    ax: Any = figure.add_axes((0.02, 0.1, 0.86, 0.9), projection="3d")
    draw(robot, np.zeros(robot.n), ax=ax)
    if ax.get_legend() is not None:
        ax.get_legend().remove()
    return figure


def _small_plot(motion: Any, panel: Panel) -> tuple[str, Figure]:
    figure = blank_figure(ACROSS, HIGH)
    ax = figure.add_subplot()
    draw_panel(ax, panel, motion)
    ax.set_xlabel("time [s]")
    if 1 < len(panel.columns) <= COLORS:
        figure.legend(loc="outside lower center", ncols=3, fontsize="small", frameon=False)
    elif len(panel.columns) == 1 and panel.quantity in QUANTITIES:
        ax.set_title(literal(short(panel.names[0])), fontsize="small")
    elif len(panel.columns) > COLORS:
        ax.set_title(literal(f"{short(panel.names[0])} (blue) to {short(panel.names[-1])} (red)"), fontsize="small")
    return panel.label, figure


def _joint_row(part: Part, parts: Sequence[Part]) -> tuple[str, ...]:
    unit = "rad" if part.kind in REVOLUTE_TYPES else "m"
    kind, limits = part.kind, ("", "", "")
    if part.mimic is not None:
        source = short(parts[part.mimic.independent].joint)
        kind = f"{kind}, mimics {source}: {part.mimic.multiplier:.6g} q + {part.mimic.offset:.6g}"
    if part.kind != "fixed":
        bounded = math.isfinite(part.lower) or math.isfinite(part.upper)
        span = f"{part.lower:.4g} to {part.upper:.4g} {unit}" if bounded else NOT_GIVEN
        span = "unlimited" if part.kind == "continuous" else span
        limits = (span, _limit(part.velocity, f"{unit}/s"), _limit(part.effort, "N m" if unit == "rad" else "N"))
    return short(part.joint), kind, f"{short(parts[part.parent].link)} → {short(part.link)}", *limits


def _limit(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}" if math.isfinite(value) else NOT_GIVEN


def _body_row(part: Part) -> tuple[str, ...]:
    I = np.asarray(part.inertia, dtype=float)
    entries = (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    centre = ", ".join(f"{float(x) + 0.0:.4g}" for x in part.com)
    return short(part.link), f"{float(part.mass):.6g}", centre, ", ".join(f"{float(x) + 0.0:.4g}" for x in entries)


def _record_rows(record: Recursion, i: int) -> Iterable[tuple[str, ...]]:
    """The rows of one joint, its name in the first."""
    name = f"{short(record.joints[i])}, {record.joint_types[i]}"
    for quantity, equation, unit in VECTORS:
        vectors = getattr(record, quantity)
        if vectors is None or i >= len(vectors) or (quantity == "a_o" and record.a_e is not None):
            continue
        yield name, quantity, equation, unit, *(_number(x) for x in vectors[i])
        name = ""
    if i in record.independent_joints:
        unit = "N" if record.joint_types[i] == "prismatic" else "N m"
        yield name, "u", "(5.3)", unit, _number(record.u[record.independent_joints.index(i)]), "", ""


def _number(x: Any) -> str:
    text = six_digits(x.real)
    return text if not (np.iscomplexobj(x) or x.imag != 0) else f"{text} + {six_digits(x.imag)} i"


def _units(name: str, model: Model) -> str:
    if name not in UNITS:
        return "N m, N" if name.startswith("external") else "s" if name == "t" else ""
    units = UNITS[name]
    rotating = model.is_revolute[list(model.independent_joints)]
    return " or ".join(dict.fromkeys(units[0] if turns else units[1] for turns in rotating))


def _page(*pieces: str) -> str:
    return f'<div style="max-width:100%">{"".join(pieces)}</div>'


def _text(text: str) -> str:
    lines = "<br/>".join(escape(line.strip()) for line in text.splitlines())
    return f'<p style="margin:.3em 0;overflow-wrap:anywhere">{lines}</p>'


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], numbers: int = 99) -> str:
    """A table that scrolls within its box; columns from `numbers` on are aligned to the right."""
    sides = [CELL.format("right" if k >= numbers else "left") for k in range(len(heads))]

    def line(tag: str, cells: Sequence[str]) -> str:
        inside = "".join(
            f'<{tag} style="{side}">{escape(cell)}</{tag}>' for cell, side in zip(cells, sides, strict=True)
        )
        return f"<tr>{inside}</tr>"

    body = "".join(line("td", row) for row in rows)
    table = f'<table style="{TABLE}"><thead>{line("th", heads)}</thead><tbody>{body}</tbody></table>'
    return f'<div style="{BOX}">{table}</div>'


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
