"""Pictures of the tutorials: figures that a block of code made, without pyplot."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from weakref import WeakSet

from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

PICTURES = (".gif", ".png", ".svg")
_shown: WeakSet[Figure] = WeakSet()
_copied: set[tuple[str, int]] = set()


def scrape(block: tuple[Any, ...], variables: dict[str, Any], conf: dict[str, Any]) -> str:
    """Save the new figures among a block's variables and its last value, and pictures that it wrote to a Path.

    Figures in lists, tuples and dicts count; each is shown once, by the block that made it.
    """
    saved = []
    found = list(variables["example_globals"].values())
    for figure in dict.fromkeys(_figures(found)):
        path = next(variables["image_path_iterator"])
        figure.savefig(path, dpi=110, bbox_inches="tight", facecolor="white")
        _shown.add(figure)
        saved.append(path)
    for source in dict.fromkeys(value for value in found if isinstance(value, Path) and _is_new_picture(value)):
        path = str(Path(next(variables["image_path_iterator"])).with_suffix(source.suffix))
        shutil.copy(source, path)
        saved.append(path)
    return figure_rst(saved, conf["src_dir"])


def _figures(values: Any) -> Iterator[Figure]:
    for value in values:
        if isinstance(value, Figure):
            if value not in _shown:
                yield value
        elif isinstance(value, (list, tuple)):
            yield from _figures(value)
        elif isinstance(value, dict):
            yield from _figures(value.values())


def _is_new_picture(path: Path) -> bool:
    if path.suffix not in PICTURES or not path.is_file():
        return False
    key = (str(path.resolve()), path.stat().st_mtime_ns)
    return not (key in _copied or _copied.add(key))
