"""What notebooks show of an object, as HTML.

Jupyter asks an object for `_repr_html_`. The pages themselves are made in `rne.plotting.notebook`, above the classes
that they show, which registers a function for each class here.
"""

from __future__ import annotations

from functools import singledispatch
from typing import Any


@singledispatch
def html(thing: Any) -> str | None:
    """The object as a fragment of HTML; None for a class that has none, which notebooks show as text."""
    return None


class InNotebooks:
    """Base of the classes that notebooks show as HTML."""

    def _repr_html_(self) -> str | None:
        return html(self)
