"""A few words about a model, for consoles."""

from __future__ import annotations

from typing import Any

from ..basics.short_text import brief_array, counted, listed, wrapped
from ..basics.text_table import short


def model_summary(model: Any) -> str:
    """Name, joints, links, mass and gravity of a model, in at most three lines or so."""
    kinds = dict.fromkeys(model.joint_types)
    types = ", ".join(f"{model.joint_types.count(kind)} {kind}" for kind in kinds)
    joints = f"{types}: {listed(model.moving_joints)}" if types else "none"
    return wrapped(
        f"Model '{short(model.name)}': {counted(model.n, 'joint')}, {counted(len(model.link_names), 'link')}, "
        f"{model.mass.sum():.6g} kg moving, gravity {brief_array(model.gravity)} m/s^2\n"
        f"  moving joints: {joints}"
    )
