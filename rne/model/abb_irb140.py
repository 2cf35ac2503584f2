"""ABB IRB 140 with the parameters of Høifødt 2011; the only place that holds its numbers.

H. Høifødt, Dynamic Modeling and Simulation of Robot Manipulators: The Newton-Euler Formulation, MSc thesis,
NTNU, June 2011.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from ..basics.spatial import Array, rotation_about, snap
from .chains import chain
from .model import Model
from .solids import Box, Cylinder, cylinder_inertia


class Datum(NamedTuple):
    """Entry: a number or one number per axis, its unit as printed, and its source."""

    value: float | tuple[float, ...]
    unit: str
    source: str


Vector = tuple[float, float, float]
ORIGIN: Vector = (0.0, 0.0, 0.0)


class Link(NamedTuple):
    """Row of the thesis's tables: Denavit-Hartenberg angles, lengths in frame i, and the cylinder of table 4.1."""

    theta: float  # [rad]
    a: float  # twist about x [rad]
    r_end: Vector  # r_{i-1,i} [m]
    r_com: Vector  # r_{i-1,ci} [m]
    mass: float  # [kg]
    radius: float  # [m]
    height: float  # [m]
    along: Literal["x", "y", "z"]  # the frame axis the cylinder lies along


PI = math.pi
LINKS = (
    Link(0, -PI / 2, (0.070, -0.352, 0), (0.014, -0.264, 0.067), 27, 0.147, 0.264, "y"),
    Link(-PI / 2, 0, (0.360, 0, 0), (0.201, 0, -0.070), 22, 0.108, 0.402, "x"),
    Link(0, -PI / 2, ORIGIN, ORIGIN, 0, 0, 0, "z"),
    Link(0, PI / 2, (0, 0.380, 0), (0, 0.080, 0), 25, 0.094, 0.600, "y"),
    Link(PI, PI / 2, ORIGIN, ORIGIN, 0, 0, 0, "z"),
    Link(0, 0, (0, 0, 0.065), (0, 0, 0.029), 1, 0.054, 0.072, "z"),
)

SHEET = "ABB's data sheet (Høifødt 2011, appendix A)"
FASTER = f"{SHEET}, of the IRB 140T"
CYCLE = "pick cycle of 25 mm up, 300 mm across and 25 mm down with 5 kg"

# As printed there; dynamics do not use them. `irb140` assumes that the ranges are symmetric about zero.
DATA_SHEET = {
    "ranges": Datum((360, 200, 280, 400, 240, 800), "deg", f"{SHEET}, as totals; axes 4 and 6 unlimited, by default"),
    "speeds": Datum((200, 200, 260, 360, 360, 450), "deg/s", SHEET),
    "fast_speeds": Datum((250, 250, 260, 360, 360, 450), "deg/s", f"{FASTER}: axes 1 and 2 are faster"),
    "payload": Datum(6, "kg", f"{SHEET}, at the flange"),
    "upper_arm_load": Datum(1, "kg", f"{SHEET}, instead of the wrist's"),
    "wrist_load": Datum(0.5, "kg", f"{SHEET}, instead of the upper arm's"),
    "tcp_speed": Datum(2.5, "m/s", f"{SHEET}, of the tool's centre point"),
    "tcp_acceleration": Datum(20, "m/s^2", SHEET),
    "acceleration_time": Datum(0.15, "s", f"{SHEET}, from rest to 1 m/s"),
    "repeatability": Datum(0.03, "mm", f"{SHEET}, of a position"),
    "reach": Datum(810, "mm", f"{SHEET}, of axis 5 from axis 1"),
    "cycle_time": Datum(0.85, "s", f"{SHEET}, {CYCLE}"),
    "fast_cycle_time": Datum(0.77, "s", f"{FASTER}, {CYCLE}"),
}

# Its controller (section 6.5): proportional [N m/rad] and derivative [N m s/rad] gains.
KP = (50.0, 50.0, 50.0, 50.0, 50.0, 60.0)
KD = (20.0, 20.0, 20.0, 20.0, 20.0, 22.0)


class ClosedLoop(NamedTuple):
    """Run of section 6.5: PD with gravity compensation, from rest at `start` to `reference` [rad], `duration` [s]."""

    start: tuple[float, ...]
    reference: tuple[float, ...]
    duration: float = 5.0


CLOSED_LOOPS = (
    ClosedLoop((0, 0, 0, 0, 0, 0), (PI / 2, 0, -PI / 2, PI, PI / 2, -PI)),
    ClosedLoop((0, PI, -PI / 2, 0, 0, 0), (PI, 0, 0, PI, -PI / 2, 0)),
    ClosedLoop((0, PI / 2, -PI / 2, 0, 0, 0), (-PI, PI, -PI, -PI, -PI / 2, PI)),
)

NOTES = {
    "robot": (
        "ABB IRB 140 after H. Hoifodt, Dynamic Modeling and Simulation of Robot Manipulators: The Newton-Euler "
        "Formulation, MSc thesis, NTNU, 2011. Link i's frame has the orientation of the thesis's frame i and the "
        "origin of its frame i-1, so that every joint axis passes through its link's origin. The frame tool0 is the "
        "thesis's frame 6, the flange. Shapes are for drawing only: between the joints they have the thesis's lengths, "
        "their widths are ASSUMED; masses and inertias are those of the thesis's cylinders, not of the shapes."
    ),
    "base_link": "The fixed base of 23 kg moves nothing and is left out; the arm's total is 98 kg with it.",
    "limits": (
        "Data sheet: the range as a total; that it lies symmetric about zero is ASSUMED. Speed: data sheet. "
        "Effort: ASSUMED unlimited (the data sheet gives none), written as the largest double."
    ),
    "flange": "The flange, frame 6 of the thesis: r_{5,6} = (0, 0, 0.065) m (4.24).",
    "unlimited": " The data sheet calls this axis unlimited; its default range is taken.",
}


def frame_rotation(link: Link, q: float = 0.0) -> Array:
    """R_i^{i-1} = Rot(z, q + theta) Rot(x, a)."""
    x, _, z = np.eye(3)
    return snap(rotation_about(z, np.asarray(q + link.theta)) @ rotation_about(x, np.asarray(link.a)))


ALONG_Y = (-PI / 2, 0.0, 0.0)  # roll, pitch and yaw that turn a cylinder from z to y


def _shapes() -> tuple[Box | Cylinder, ...]:
    """Housings, for drawing only: lengths between the joints are those of the table above, widths are assumed."""
    (out, down, _), (upper, _, _), (_, fore, _), (_, _, flange) = (LINKS[k].r_end for k in (0, 1, 3, 5))
    side = -0.1  # middle of the upper arm along axis 2, next to the forearm
    return (
        Box("base_link", (0.40, 0.34, 0.05), (-0.03, 0.0, 0.025), ORIGIN),
        Cylinder("base_link", 0.125, 0.17, (0.0, 0.0, 0.135), ORIGIN),
        Box("base_link", (0.14, 0.18, 0.10), (-0.14, 0.0, 0.10), ORIGIN),
        Cylinder("link_1", 0.135, 0.04, (0.0, -0.24, 0.0), ALONG_Y),
        Box("link_1", (0.23, 0.16, 0.19), (out / 2, -0.33, 0.035), ORIGIN),
        Cylinder("link_1", 0.10, 0.22, (out, down, 0.045), ORIGIN),
        Cylinder("link_2", 0.095, 0.07, (0.0, 0.0, side), ORIGIN),
        Box("link_2", (upper, 0.14, 0.068), (upper / 2, 0.0, side), ORIGIN),
        Cylinder("link_2", 0.08, 0.07, (upper, 0.0, side), ORIGIN),
        Cylinder("link_3", 0.085, 0.16, (0.0, -0.015, 0.0), ALONG_Y),
        Box("link_3", (0.13, 0.13, 0.15), (0.0, -0.015, -0.10), ORIGIN),
        Cylinder("link_3", 0.07, 0.10, (0.0, 0.0, 0.10), ORIGIN),
        Cylinder("link_4", 0.058, fore - 0.21, (0.0, (fore - 0.06 + 0.15) / 2, 0.0), ALONG_Y),
        *(Box("link_4", (0.075, 0.13, 0.022), (0.0, fore - 0.025, z), ORIGIN) for z in (-0.051, 0.051)),
        Cylinder("link_5", 0.04, 0.078, ORIGIN, ALONG_Y),
        Cylinder("link_6", 0.03, flange - 0.03, (0.0, 0.0, (flange + 0.03) / 2), ORIGIN),
    )


def _notes() -> dict[str, str]:
    notes = {name: NOTES[name] for name in ("robot", "base_link", "flange")}
    for i, link in enumerate(LINKS, 1):
        limits = NOTES["limits"] + (NOTES["unlimited"] if i in (4, 6) else "")
        origin = f"R_i^{{i-1}} and r_{{i-2,i-1}} of the thesis for i = {i}"
        notes[f"joint_{i}"] = f"Origin: {origin}; axis b_{i} (3.30). {limits}"
        notes[f"link_{i}"] = (
            f"Table 4.1: cylinder of {link.mass} kg, radius {link.radius} m, height {link.height} m; "
            f"centre r_{{{i - 1},c{i}}}; "
            "moments m r^2/2 along, m (3 r^2 + h^2)/12 across (4.25)-(4.31)."
            if link.mass
            else "No mass and no length in the thesis."
        )
    return notes


def irb140() -> Model:
    """The ABB IRB 140 of the thesis: six revolute joints, links 3 and 5 massless, g = 9.81 m/s^2.

    Returns
    -------
    Model
        Joints joint_1 ... joint_6, links base_link, link_1 ... link_6 and tool0, the flange, fixed to link_6. Link i
        has the orientation of the thesis's frame i and the origin of its frame i-1; tool0 is its frame 6 (4.24).
        Working ranges about zero are assumed, efforts unlimited.

    Notes
    -----
    Høifødt 2011, chapter 4 with table 4.1, (4.2)-(4.31); ABB's data sheet for ranges and speeds. The cylinders of
    table 4.1 have densities of 1493 to 1516 kg/m^3; the thesis states 1500. The reach of axis 5 from axis 1 is
    0.070 + 0.360 + 0.380 = 0.810 m, as in the data sheet, whose numbers are in
    ``DATA_SHEET`` of ``rne/model/abb_irb140.py``.

    Examples
    --------
    >>> import rne
    >>> rne.irb140().mass.sum().item()
    75.0
    """
    ranges, speeds = (np.radians(DATA_SHEET[name].value) for name in ("ranges", "speeds"))
    model = chain(
        [frame_rotation(link) for link in LINKS],
        [link.r_end for link in LINKS],
        [link.mass for link in LINKS],
        [link.r_com for link in LINKS],
        [cylinder_inertia(link.mass, link.radius, link.height, link.along) for link in LINKS],
        lower=-ranges / 2,
        upper=ranges / 2,
        velocity=speeds,
        name="irb140",
    )
    return replace(model, shapes=_shapes(), notes=_notes())
