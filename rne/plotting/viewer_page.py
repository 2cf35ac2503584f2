"""A viewer page: viser's HTML with a title, a legend and a camera for narrow windows; saved, shown or in a notebook."""

from __future__ import annotations

import html
import json
import os
import tempfile
import webbrowser
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..basics.paths import output_file
from ..basics.spatial import Array
from .viewer_camera import Camera
from .viewer_scene import GHOST, TONES, Motion

HEIGHT = 480  # [px] of the view in a notebook
STYLE = (
    "#rne{position:fixed;bottom:3.6em;left:.9em;z-index:1;pointer-events:none;"
    "font:13px/1.5 system-ui,sans-serif;color:#334}"
    "#rne i{display:inline-block;width:.8em;height:.8em;margin-right:.5em;border:1px solid #667}"
)
# A window that is higher than wide sees less to the sides: the camera goes back. viser takes it from the address.
CAMERA = (
    "<script>try{const a=innerWidth/innerHeight,c=%s;if(a<1){const d=Math.max(c.distance,c.width/a+c.depth);"
    'history.replaceState(null,"","?initialCameraPosition="+c.target.map((x,i)=>x+d*c.side[i]))}}catch(e){}</script>'
)


class Page:
    """A viewer page; in a notebook the object shows itself.

    Attributes
    ----------
    html : str
        The page.
    path : pathlib.Path or None
        The file it was written to.
    """

    def __init__(self, text: str, path: Path | None = None) -> None:
        self.html = text
        self.path = path
        if path is not None:
            self.save(path)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the page to a file, and return its path."""
        self.path = output_file(path, *PAGE)
        self.path.write_text(self.html, encoding="utf-8")
        return self.path

    def show(self) -> None:
        """Show the page in the notebook, or elsewhere in the default browser, then from a temporary file if need be."""
        try:
            from IPython import get_ipython
            from IPython.display import HTML, display
        except ModuleNotFoundError:
            pass
        else:
            if get_ipython() is not None:
                display(HTML(f"<div>{self._repr_html_()}</div>"))
                return
        if self.path is None:
            with tempfile.NamedTemporaryFile(suffix=".html", delete=False) as file:
                self.save(file.name)
        webbrowser.open(Path(self.path or "").resolve().as_uri())

    def _repr_html_(self) -> str:
        style = "border:1px solid #ccc;display:block"
        return f'<iframe srcdoc="{html.escape(self.html)}" width="100%" height="{HEIGHT}" style="{style}"></iframe>'

    def __repr__(self) -> str:
        where = "not saved" if self.path is None else repr(str(self.path))
        return f"Page({where}, {len(self.html.encode()) / 1e6:.2f} MB)"


def legend(motion: Motion, labels: Sequence[str], cell: float, times: Array, speed: float) -> str:
    """What is not in the scene itself: names, colours, the grid, and how the slider's time is that of the motion."""
    lines = [f"<b>{html.escape(motion.model.name)}</b>"]
    if len(labels) > 1:
        own = [shape.color[:3] for shape in motion.shapes if shape.color is not None]
        main = "rgb({} {} {})".format(*(round(255 * x) for x in own[0])) if own else "rgb({} {} {})".format(*TONES[0])
        marks = (main, "rgb({} {} {} / 60%)".format(*GHOST))
        lines += [f'<i style="background:{c}"></i>{html.escape(x)}' for c, x in zip(marks, labels, strict=True)]
    lines.append(f"grid: {cell:g} m")
    if len(times) > 1 and (speed != 1 or times[0] != 0):
        start = f"{times[0]:g} + " if times[0] else ""
        factor = f"{speed:g} &times; " if speed != 1 else ""
        lines.append(f"t = {start}{factor}time on the slider")
    return "<br>".join([*lines, "<small>frames and masses: button of the scene tree</small>"])


PAGE = (".html", ".htm")
TITLE, ROOT = "<title>Viser</title>", '<div id="root"></div>'  # in viser's page


def finished(text: str, name: str, key: str, camera: Camera) -> str:
    """viser's page with a title, a legend, and a camera for narrow windows."""
    numbers = {k: x.tolist() if isinstance(x, np.ndarray) else x for k, x in camera._asdict().items()}
    head = f"<title>{html.escape(name)}</title>{CAMERA % json.dumps(numbers)}<style>{STYLE}</style>"
    for mark in (TITLE, ROOT):
        if mark not in text:
            raise RuntimeError(f"this version of viser writes other pages: {mark!r} is missing; pip install 'viser<2'")
    text = text.replace(TITLE, head, 1)
    return text.replace(ROOT, f'{ROOT}<div id="rne">{key}</div>', 1)
