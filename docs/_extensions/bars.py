"""Absolute values in docstrings: in reStructuredText a word between bars would be a substitution."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

BARS = re.compile(r"\|([^|`]+)\|")
AFTER_NUMPYDOC = 900
CODE = (">>>", "...", "..")


def escape(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Escape the bars of lines that are no code."""
    for k, line in enumerate(lines):
        if not line.lstrip().startswith(CODE) and "``" not in line:
            lines[k] = BARS.sub(r"\\|\1\\|", line)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("autodoc-process-docstring", escape, priority=AFTER_NUMPYDOC)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
