"""Where a chain ends: the link that a payload sits on by default, and the end of the last body."""

from __future__ import annotations

import numpy as np

from ..basics.spatial import Array
from .model import Model


def end_link(model: Model, *, axes_count: bool = False) -> str:
    """The link at the end of an unbranched chain, a fixed frame behind the last joint included.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    axes_count : bool
        True if the axes of the link matter, not only its origin.

    Returns
    -------
    str
        Of the links that no other is attached to, the one that moves with the last joint. If several do, they must have
        the same origin, and the same axes if these count; then it is the last of them in `link_names`.

    Raises
    ------
    ValueError
        If there is no such link: moving joints branch, one mimics another, or the last body ends at several points
        or in several axes that count.

    Examples
    --------
    >>> import rne
    >>> from rne.model.ends import end_link
    >>> end_link(rne.irb140())
    'tool0'
    """
    ends = _ends(model)
    mimics = [joint for i, joint in enumerate(model.moving_joints) if i not in model.independent_joints]
    if not _is_chain(model):
        reason = "its moving joints branch"
    elif mimics:
        reason = f"its joint {mimics[0]!r} mimics another"
    elif not _at_one_point(model, ends):
        reason = "its last body ends at several points"
    elif axes_count and not _of_one_orientation(model, ends):
        reason = "its last body ends in links with different axes, in which `com` and `inertia` are given"
    else:
        return model.link_names[ends[-1]]
    candidates = [model.link_names[k] for k in _leaves(model) if model.link_body[k] >= 0 or not model.nb]
    raise ValueError(
        f"`link` must be given for robot {model.name!r}: {reason}; its leaf links are {candidates}, others are in "
        "`link_names`"
    )


def tip(model: Model) -> Array | None:
    """End of the last body of an unbranched chain in its frame, the thesis's r_{n-1,n}, shape (3,) [m].

    It is the origin of the frame fixed behind the last joint's link; None if there is none, or several at different
    points, or the chain branches.
    """
    ends = _ends(model)
    if not model.nb or not _is_chain(model) or not _at_one_point(model, ends):
        return None
    if model.link_joints[ends[-1]] == model.moving_joints[-1]:
        return None
    end: Array = model.link_translation[ends[-1]]
    return end


def _is_chain(model: Model) -> bool:
    return all(parent == i - 1 for i, parent in enumerate(model.parent))


def _leaves(model: Model) -> list[int]:
    """Links that no other link is attached to, by their places in `link_names`."""
    carrying = set(model.link_tree)
    return [k for k in range(len(model.link_names)) if k not in carrying]


def _ends(model: Model) -> list[int]:
    """The leaves that belong to the last body."""
    return [k for k in _leaves(model) if model.link_body[k] == model.nb - 1]


def _of_one_orientation(model: Model, links: list[int]) -> bool:
    return bool(np.all(model.link_rotation[links] == model.link_rotation[links[-1]]))


def _at_one_point(model: Model, links: list[int]) -> bool:
    return bool(np.all(model.link_translation[links] == model.link_translation[links[-1]]))
