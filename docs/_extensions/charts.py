"""Charts on phones: one that has a narrow drawing beside its file shows that, others keep a legible width and scroll.

On wide screens a chart is as wide as it was drawn, so that all have text of one size.

Matplotlib notes its pixels per inch in a file, so that the width at which the smallest text is legible follows. Of
"chart.png" the narrow drawing is "chart_narrow.png".
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

from PIL import Image
from sphinx.application import Sphinx

PIXELS = 9  # height of the smallest text on the screen at least,
WIDE = 12  # and where there is room
POINTS = 8  # that of the smallest text in our charts,
PHONE = 5.7  # but for those that are no wider than this [inch], which are drawn for phones
NARROW = "46em"  # of the window, as in rne.css
IMAGE = re.compile(r'<img\b[^>]*?\bsrc="([^"]*?_images/([^"/]+\.png))"[^>]*>')


def drawn(path: Path) -> float:
    """Width of a chart as it was drawn [inch]; 0 if its file does not say."""
    with Image.open(path) as image:
        dpi = image.info.get("dpi", (0, 0))[0]
        return image.width / dpi if dpi else 0.0


def legible(path: Path) -> int:
    """Width on the screen at which the smallest text of a chart can be read; 0 if a phone's is enough."""
    inches = drawn(path)
    return round(inches * 72 * PIXELS / POINTS) if inches > PHONE else 0


def rewrite(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """Give each chart of a page a box that scrolls, and its narrow drawing."""
    if "body" not in context:
        return
    images = Path(app.outdir) / "_images"
    sources = {name: Path(app.srcdir) / source for source, name in app.builder.images.items()}

    def chart(found: re.Match[str]) -> str:
        tag, address, name = found[0], found[1], found[2]
        path = sources.get(name, images / name)
        if "_thumb" in name or not path.is_file() or not (inches := drawn(path)):
            return tag
        size = f"--drawn: {inches * 72 * WIDE / POINTS:.0f}px"
        if not (width := legible(path)):
            return tag if "style=" in tag else tag.replace("<img", f'<img class="chart" style="{size}"', 1)
        narrow = path.with_stem(f"{path.stem}_narrow")
        if narrow.is_file():
            images.mkdir(exist_ok=True)
            shutil.copy(narrow, images / narrow.name)
            place = address.removesuffix(name) + narrow.name
            return f'<picture><source media="(max-width: {NARROW})" srcset="{place}">{tag}</picture>'
        return f'<span class="chart" style="--legible: {width}px; {size}">{tag}</span>'

    context["body"] = IMAGE.sub(chart, context["body"])


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("html-page-context", rewrite)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
