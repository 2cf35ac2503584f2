"""Order of the tutorials: as `tutorials/index.rst` lists them, level by level."""

from __future__ import annotations

import re
from pathlib import Path

INDEX = Path(__file__).parents[1] / "tutorials" / "index.rst"
ORDER = re.findall(r"^    tutorials/(\w+\.py)$", INDEX.read_text(encoding="utf-8"), re.MULTILINE)


def position(path: str) -> int:
    """Place of a tutorial among all."""
    return ORDER.index(Path(path).name)
