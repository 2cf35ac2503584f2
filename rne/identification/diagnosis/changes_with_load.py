"""What else differs between records without and with a load: the arm, its drives, its base, the place of the load.

Each is a hypothesis on the torques with the load alone, judged beside the load, friction that changed, and what was
found before it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...basics.spatial import Array
from ...model.parameters import PARAMETERS
from .. import thresholds
from .hypotheses import (
    DIRECTION,
    GAIN,
    Cause,
    Hypothesis,
    columns_of,
    joints,
    judge,
    other_gravity,
    text_of,
    units,
    words,
)
from .residuals import FitResiduals, by_joint


def changes_with_load(rest: FitResiduals, known: Array, loaded: Array, body: int) -> list[Cause]:
    """Changes that the residuals of all records show, the likeliest first, each beside those before it.

    Torques of the loads are `known` columns. Rows with the load, shape (rows, 1, 1), have the parameters of `rest`; it
    is on the body of this number.
    """
    speeds = rest.of_each_joint(lambda q, qd, qdd: qd), rest.of_each_joint(lambda q, qd, qdd: np.sign(qd))
    options = [replace(h, columns=columns_of(rest, h) * loaded) for h in hypotheses_with_load(rest, body)]
    changed = np.concatenate(speeds, axis=-1) * loaded
    left, found = rest.beyond_friction.with_known(np.concatenate([known, changed], axis=-1)), []
    while options:
        causes = [judge(left, h) for h in options]
        k = int(np.argmax([cause.score for cause in causes]))
        if causes[k].score <= thresholds.EVIDENT:
            break
        found.append(causes[k])
        left = left.with_known(columns_of(left, options.pop(k)))
    return found


def hypotheses_with_load(rest: FitResiduals, body: int) -> Iterator[Hypothesis]:
    """Gravity, zeros, factors and offsets of torques, and bodies other than that of the load."""
    found = [h for h in (*other_gravity(rest), *joints(rest)) if h.kind in (DIRECTION, GAIN, "joint zero")]
    ones = by_joint(np.ones((*rest.tau.shape, 1)))
    for j, name in enumerate(rest.names):
        text = words("the torque of {} is {:.3g} {} larger", name, units(rest.robot, j)[1])
        found.append(Hypothesis("offset", ones[..., [j]], text, (name,)))
    for h in found:
        yield replace(h, text=lambda c, h=h: f"{text_of(h, c)} with the load, not without it")
    model = rest.robot.model
    for i in (i for i in range(model.nb) if i != body):
        link = model.link_names[list(model.link_body).index(i)]
        text = f"the body of {link} is another one with the load: is a load there, or was the arm changed?"
        yield Hypothesis("body", rest.Y[..., PARAMETERS * i : PARAMETERS * (i + 1)], text, model.moving_joints[i : i + 1])
