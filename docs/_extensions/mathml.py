"""Formulas as MathML: no script, no font and no network is needed to read them."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

HAT = re.compile(r"<mo(?=[^>]*>(?:\^|&#x0*5E;|&#x0*302;)</mo>)", re.IGNORECASE)


def formula(latex: str, display: str = "inline") -> str:
    """MathML, with a class on hats, which rne.css raises."""
    return HAT.sub('<mo class="hat"', convert(latex, display=display))


def inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(formula(node.astext()))
    raise nodes.SkipNode


def block(writer: Any, node: nodes.math_block) -> None:
    writer.body.append(f'<div class="math">{formula(node.astext(), "block")}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
