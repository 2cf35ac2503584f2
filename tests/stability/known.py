"""Where a method does not hold the bound: measured, and what to use instead."""

from __future__ import annotations

from typing import NamedTuple


class Known(NamedTuple):
    """Why, with the measured error in units of eps times the condition."""

    reason: str
    instead: str


BODIES = "forward dynamics by articulated bodies"
SLIDES = (
    "the inertia of a body far out along a slide is moved to the base of the slide and back, and loses the square of "
    "the distance: error {} eps times the structured condition"
)
KNOWN = {
    ("random tree, slides 1e+03 times its size", BODIES): Known(SLIDES.format("180"), "`rne.forward_dynamics`"),
    ("random tree, slides 1e+06 times its size", BODIES): Known(SLIDES.format("1.8e5"), "`rne.forward_dynamics`"),
}
