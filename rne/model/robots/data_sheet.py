"""A manufacturer's data sheet as a record: each number as printed, with its unit and where it is from."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple


class Datum(NamedTuple):
    """One entry: a number or one number per axis, its unit as printed, and its source."""

    value: float | tuple[float, ...]
    unit: str
    source: str


@dataclass(frozen=True, kw_only=True)
class DataSheet:
    """What a manufacturer states about a robot; `print` shows it as a table. Dynamics do not use it.

    Attributes
    ----------
    ranges, speeds : Datum
        Working range as a total, and largest speed, of each axis.
    fast_speeds : Datum
        The largest speeds of the robot's faster variant.
    payload, upper_arm_load, wrist_load : Datum
        Load at the flange, and further loads on the upper arm or on the wrist, one of the two.
    tcp_speed, tcp_acceleration : Datum
        Largest speed and acceleration of the tool's centre point.
    acceleration_time : Datum
        From rest to 1 m/s.
    repeatability : Datum
        Of a position.
    reach : Datum
        Of axis 5 from axis 1.
    cycle_time, fast_cycle_time : Datum
        Of the pick cycle, and of the faster variant.
    """

    ranges: Datum
    speeds: Datum
    fast_speeds: Datum
    payload: Datum
    upper_arm_load: Datum
    wrist_load: Datum
    tcp_speed: Datum
    tcp_acceleration: Datum
    acceleration_time: Datum
    repeatability: Datum
    reach: Datum
    cycle_time: Datum
    fast_cycle_time: Datum

    def __str__(self) -> str:
        lines = []
        for field in fields(self):
            value, unit, source = getattr(self, field.name)
            numbers = ", ".join(f"{x:g}" for x in (value if isinstance(value, tuple) else (value,)))
            lines.append(f"{field.name:<17} {numbers:<28} {unit:<6} {source}")
        return "\n".join(lines)
