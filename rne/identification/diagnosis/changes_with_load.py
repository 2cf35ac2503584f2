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

    Torques of the loads, and friction of sound gears, are `known` columns. Rows with the load, shape (rows, 1, 1),
    have the parameters of `rest`; it is on the body of this number. Residuals are as independent as all of the changes
    together leave them.
    """
    speeds = rest.of_each_joint(lambda q, qd, qdd: qd), rest.of_each_joint(lambda q, qd, qdd: np.sign(qd))
    options = [replace(h, columns=columns_of(rest, h) * loaded) for h in hypotheses_with_load(rest, body)]
    own = np.concatenate([known, *(speed * loaded for speed in speeds)], axis=-1)
    values, found = np.zeros(rest.tau.shape), []
    every = rest.with_known(np.concatenate([own, *(columns_of(rest, h) for h in options)], axis=-1))
    values[rest.used] = every.left
    time = rest.data.correlation_time(values, rest.used)
    left = FitResiduals(rest.robot, rest.base, rest.data, rest.beta, rest.sigma, time, own)
    while options:
        causes = [judged(left, h) for h in options]
        k = int(np.argmax([cause.score for cause in causes]))
        if causes[k].score <= thresholds.EVIDENT:
            break
        found.append(causes[k])
        left = left.with_known(columns_of(left, options.pop(k)))
    return found


def judged(rest: FitResiduals, h: Hypothesis) -> Cause:
    """The cause with a score by as many numbers as it has independent of what is known: bodies share some."""
    columns, cause = columns_of(rest, h), judge(rest, h)
    return cause._replace(score=cause.score + rest.penalty(columns.shape[-1] - rest.with_columns(columns)[3]))


def hypotheses_with_load(rest: FitResiduals, body: int) -> Iterator[Hypothesis]:
    """Gravity, zeros, factors and offsets of torques, and bodies other than that of the load."""
    found = [h for h in joints(rest) if h.kind in (GAIN, "joint zero")]
    tilts = [h for h in other_gravity(rest) if h.kind == DIRECTION]
    found += [replace(h, columns=columns_of(rest, h)[..., :2]) for h in tilts]  # without other bodies
    ones = by_joint(np.ones((*rest.tau.shape, 1)))
    for j, name in enumerate(rest.names):
        offset = words("the torque of {} is {:.3g} {} larger", name, units(rest.robot, j)[1])
        found.append(Hypothesis("offset", ones[..., [j]], offset, (name,)))
    for h in found:

        def text(c: Array, h: Hypothesis = h) -> str:
            return f"{text_of(h, c)} with the load, not without it"

        yield replace(h, text=text)
    model = rest.robot.model
    for i in (i for i in range(model.nb) if i != body):
        link = model.link_names[list(model.link_body).index(i)]
        other = f"the body of {link} is another one with the load: is a load there, or was the arm changed?"
        columns = rest.Y[..., PARAMETERS * i : PARAMETERS * (i + 1)]
        yield Hypothesis("body", columns, other, model.moving_joints[i : i + 1])
