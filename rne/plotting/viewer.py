"""A robot or its motion as one HTML page with a 3-D view that needs no network and no server."""

from __future__ import annotations

import html
import json
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import output_file, positive_number, real_numbers
from ..basics.marks import HTML
from ..basics.spatial import Array
from ..robot import Robot
from ..simulation.springs import JointSpring, Spring, resolved_springs
from ..simulation.trajectory import Trajectory
from .motions import Motion, arrays_argument, check_positions, motion_argument
from .shapes import INSTALL, PosedRobot
from .viewer_scene import GHOST, MASSES, NIGHT, SKY, TONES, add_floor, build, corners

if TYPE_CHECKING:
    from viser import ViserServer

HOLD = 0.5  # pause of the last frame before the page starts again [s]
FPS = 30.0  # frames per second of the page
MAX_POSES = 10_000  # most poses of links in a page; long motions have fewer frames per second
FOV = np.radians(38)  # vertical field of view of the camera [rad]
HEIGHT = 480  # height of the view in a notebook [px]
AMBIENT = 1.2  # intensity of the light that reaches all sides: viser's own lights leave those away from them dark
PAGE = (".html", ".htm")
TITLE, ROOT, LIGHT = "<title>Viser</title>", '<div id="root"></div>', "darkMode:false"  # in viser's page
DARK = "darkMode:matchMedia('(prefers-color-scheme:dark)').matches"
STYLE = (
    "#rne{position:fixed;bottom:3.6em;left:.9em;right:.9em;z-index:1;pointer-events:none;"
    f"font:13px/1.5 system-ui,sans-serif;color:#334;text-shadow:{SKY} 0 0 3px,{SKY} 0 0 3px}}"  # against the grid
    "#rne i{display:inline-block;width:.8em;height:.8em;margin-right:.5em;border:1px solid #667}"
    "#rne label{pointer-events:auto;cursor:pointer}#rne input{margin:0 .5em 0 0;vertical-align:-.15em}"
    ":root{color-scheme:light dark}.mantine-Notifications-root{display:none}"  # about slow graphics, over the scene
    "body,div:has(>.mantine-Progress-root){background:none!important}"  # while it loads a page shows its picture
    "body:not(:has(canvas[data-engine])) #rne{display:none}"  # which the legend would overlap
    ".mantine-Select-wrapper{width:4.4em!important}"  # viser's is too narrow for the speeds
    f"canvas[data-engine]{{background:{SKY};opacity:1!important}}@media(prefers-color-scheme:dark)"  # viser fades it in
    f"{{#rne{{color:#dde;text-shadow:{NIGHT} 0 0 3px,{NIGHT} 0 0 3px}}canvas[data-engine]{{background:{NIGHT}}}}}"
)
# A window that is higher than wide sees less to the sides: the camera goes back. viser takes it from the address.
CAMERA = (
    "<script>try{const a=innerWidth/innerHeight,c=%s;if(a<1)"
    'history.replaceState(null,"","?initialCameraPosition="+c[0].map((x,i)=>x+c[1][i]/a))}catch(e){}</script>'
)
# The switch in the legend queues viser's own messages, again after each round of the recording, which sets all parts.
SWITCH = (
    "<script>{const box=document.getElementById('masses'),parts=%s;let was=false;setInterval(()=>{"
    "const m=window.__viserMutable,tree=window.__viserSceneTree;box.disabled=!m||!tree;"
    "if(box.disabled||!box.checked&&!was)return;was=box.checked;const seen=tree.getState();"
    "for(const[name,first,then]of parts){const visible=was?then:first;"
    "if((seen[name]?.visibility??visible)!==visible)"
    "m.messageQueue.push({type:'SetSceneNodeVisibilityMessage',name,visible})}},100)}</script>"
)


def view(
    robot: Robot | Trajectory,
    path: str | os.PathLike[str] | None = None,
    *,
    q: ArrayLike | None = None,
    t: ArrayLike | None = None,
    other: Trajectory | ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    labels: Sequence[str] = ("motion", "other"),
    speed: float = 1.0,
    frames: bool = False,
    inertia: bool = False,
    springs: Sequence[Spring | JointSpring] = (),
) -> Page:
    """Write a robot or its motion as one HTML page with a 3-D view, for any browser, without network or server.

    Parameters
    ----------
    robot : Robot or Trajectory
        A motion, or a robot whose positions are `q`.
    path : str or path-like, optional
        The file to write, ending in .html, in an existing folder. Without it the page is kept in memory, for notebooks.
    q : array_like, shape (n,) or (T, n), optional
        One position of the robot, zero if not given, or with `t` those of a motion [rad or m].
    t : array_like, shape (T,), optional
        Times of the positions, increasing [s]; between them the positions are interpolated linearly.
    other : Trajectory, array_like of shape (n,), or tuple of t and q, optional
        A second motion or position of the same robot, or a Trajectory of another one, shown half transparent in orange.
    labels : sequence of two str
        Names of the motion and of the other one in the legend.
    speed : float
        Seconds of the motion per second of the page at the speed 1x; the page offers 0.5x to 8x of it.
    frames, inertia : bool
        True if the links' frames, or centres of mass and solids of the bodies' inertias, are to be visible at first,
        with the links half transparent. The list of the scene's parts in the page shows and hides them in any case, and
        a switch shows the masses instead of the links.
    springs : sequence of Spring
        Springs between links of the robot, shown as red lines.

    Returns
    -------
    Page
        With `path`, `html`, `save(path)` and `show()`. As the last value of a notebook's cell it shows itself.

    Raises
    ------
    TypeError
        If `robot`, `path` or `other` is of another type.
    ValueError
        If an array has the wrong shape or is not finite, times do not increase, a trajectory has no samples or no
        model, or `q` or `t` is given with a trajectory.
    FileNotFoundError
        If the folder of `path` does not exist.
    ImportError
        If viser is not installed.

    Warns
    -----
    UserWarning
        For visual shapes of the robot's URDF that cannot be shown, such as a mesh that is not found.

    Notes
    -----
    Shown are the visual shapes of the URDF, meshes simplified to about 12 000 triangles a robot, and lines for links
    that have none; the joint axes; a floor whose grid is named in the legend. Up is against gravity. What the model
    weighs is shown as solid bodies of even density with the masses and inertias of the model: cylinders where two
    principal moments of inertia are alike, ellipsoids otherwise. There are 30 frames per
    second of the page, in long motions fewer. A local server of viser makes the page: it is bound to 127.0.0.1 and is
    stopped before this function returns.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> swing = rne.simulate(robot, [0] * 6, [0] * 6, 2.0)
    >>> page = rne.view(swing, "swing.html", other=rne.simulate(robot.with_payload(6.0), [0] * 6, [0] * 6, 2.0),
    ...                 labels=["unloaded", "6 kg"])  # doctest: +SKIP
    """
    file = None if path is None else output_file(path, *PAGE)
    if isinstance(labels, str) or len(labels) != 2 or not all(isinstance(label, str) for label in labels):
        raise ValueError(f"`labels` must be two str, got {labels!r}")
    rate = positive_number("speed", speed)
    shown = [_first(robot, q, t)]
    if other is not None:
        shown.append(_second(other, shown[0][0]))
    lines = resolved_springs(springs, shown[0][0], shown[0][0])
    times = frame_times(shown, rate)
    with _scene_server() as server:
        main = placed(*shown[0], times)
        ghost = placed(*shown[1], times, main) if other is not None else None
        some = np.unique(np.linspace(0, len(times) - 1, 60).round().astype(int))
        points = np.concatenate([corners(x, some) for x in (main, ghost) if x is not None])
        camera, (target, away) = server.initial_camera, aim(points)
        camera.position, camera.look_at, camera.up, camera.fov = target + away, target, (0.0, 0.0, 1.0), FOV
        server.scene.add_light_ambient("/light", intensity=AMBIENT)
        cell = add_floor(server.scene, points)
        groups = build(server.scene, main, ghost, lines, frames=frames, inertia=inertia)
        recording = server.get_scene_serializer()
        for k, pause in enumerate(np.diff(times) / rate, 1):
            recording.insert_sleep(float(pause))
            for group in groups:
                group.place(k)
        if len(times) > 1:
            recording.insert_sleep(HOLD)
        text = recording.as_html()
    key = _legend(main, labels if ghost else labels[:1], cell, times, rate)
    switched = ("/robot", "/other") if ghost else ("/robot",)
    parts = [[x, True, False] for x in switched] + [[f"/{x}", inertia, True] for x in MASSES]
    return Page(_finished(text, main.model.name, key + SWITCH % json.dumps(parts), (target, away)), file)


class Page:
    """Viewer page; in a notebook the object displays itself.

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
        import tempfile
        import webbrowser

        if "IPython" in sys.modules:
            from IPython import display, get_ipython

            if get_ipython() is not None:
                display.display(display.HTML(f"<div>{self._repr_html_()}</div>"))
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


def _first(robot: Robot | Trajectory, q: ArrayLike | None, t: ArrayLike | None) -> tuple[Robot, Motion]:
    """Robot and motion that `view` is given first."""
    if isinstance(robot, Trajectory):
        for name, value in (("q", q), ("t", t)):
            if value is not None:
                raise ValueError(f"`{name}` is for a robot; a trajectory has its own")
        motion = motion_argument("robot", robot)
        if robot.model is None:
            raise ValueError("this trajectory has no model: give it one by dataclasses.replace(trajectory, model=...)")
        return Robot(robot.model), motion
    if not isinstance(robot, Robot):
        raise TypeError(f"`robot` must be an rne.Robot or rne.Trajectory, got {type(robot).__name__}")
    q = np.zeros(robot.n) if q is None else q
    return robot, _still("q", q, robot) if t is None else check_positions("q", arrays_argument("tq", t, [q]), robot)


def _second(other: Any, robot: Robot) -> tuple[Robot, Motion]:
    """Robot and motion that `view` is given as `other`; by default the first robot."""
    if isinstance(other, str | Robot):
        raise TypeError(f"`other` must be an rne.Trajectory, positions or a tuple (t, q), got {type(other).__name__}")
    if isinstance(other, Trajectory) or (isinstance(other, tuple) and len(other) == 2 and np.ndim(other[1]) == 2):
        motion = motion_argument("other", other)
        robot = robot if motion.model is None else Robot(motion.model)
        return robot, check_positions("other", motion, robot)
    return robot, _still("other", other, robot)


def _still(name: str, q: ArrayLike, robot: Robot) -> Motion:
    """Position as a motion."""
    positions = real_numbers(name, q, f"({robot.n},)")
    if positions.shape != (robot.n,):
        cure = "; motions need times `t`" if positions.ndim == 2 else ""
        raise ValueError(f"`{name}` must have shape ({robot.n},), got {positions.shape}{cure}")
    return Motion(np.zeros(1), {"q": positions[None]})


def frame_times(shown: Sequence[tuple[Robot, Motion]], speed: float) -> Array:
    """Times of the frames [s], from the first start to the last end of what moves."""
    ends = np.array([(motion.t[0], motion.t[-1]) for _, motion in shown if motion.t[-1] > motion.t[0]])
    if not len(ends):
        return shown[0][1].t[:1]
    start, end = ends[:, 0].min(), ends[:, 1].max()
    links = sum(len(robot.link_names) for robot, _ in shown)
    frames = min(round((end - start) / speed * FPS), MAX_POSES // links)
    return np.linspace(start, end, max(frames, 1) + 1)


def placed(robot: Robot, motion: Motion, times: Array, first: PosedRobot | None = None) -> PosedRobot:
    """Poses of the links in all frames, with the z axis up; shapes are shared with a first robot of the same file."""
    from scipy.spatial.transform import Rotation

    model = robot.model
    up = np.eye(4)
    if model.gravity.any():
        up[:3, :3] = Rotation.align_vectors([0.0, 0.0, 1.0], -model.gravity.astype(float))[0].as_matrix()
    poses = up @ robot.link_poses(motion.positions(np.clip(times, motion.t[0], motion.t[-1])))
    same = first is not None and model.source is not None and model.source == first.model.source
    return PosedRobot(model, poses, first.shapes if first is not None and same else None)


@contextmanager
def _scene_server() -> Iterator[ViserServer]:
    """Server of viser on 127.0.0.1, which is stopped in the end and prints nothing."""
    try:
        import fast_simplification  # noqa: F401
        import rich
        import trimesh  # noqa: F401
        import viser
    except ModuleNotFoundError as error:
        raise ImportError(f"the viewer needs {error.name}, which is not installed: {INSTALL}") from None
    console = rich.get_console()
    quiet, console.quiet = console.quiet, True
    try:
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            yield server
        finally:
            server.stop()
    finally:
        console.quiet = quiet


def aim(points: Array) -> tuple[Array, Array]:
    """Target of a camera that sees all points, and its position relative to it, in windows not higher than wide [m]."""
    up, side = np.array([0.0, 0.0, 1.0]), np.array([0.72, -0.95, 0.55])
    axes = np.stack([np.cross(up, side), np.cross(side, np.cross(up, side)), side])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    seen = points @ axes.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    from_middle = seen - middle
    tangent = 0.84 * np.tan(FOV / 2)  # leaves a margin
    distance = float((np.abs(from_middle[:, :2]).max(axis=1) / tangent + from_middle[:, 2]).max()) or 1.0
    return middle @ axes, distance * axes[2]


def _legend(robot: PosedRobot, labels: Sequence[str], cell: float, times: Array, speed: float) -> str:
    """Text beside the scene: names, colours, duration and pace, the size of the grid, and a switch for the masses."""
    lines = [f"<b>{html.escape(robot.model.name)}</b>"]
    if len(labels) > 1:
        own = [shape.color[:3] for shape in robot.shapes if shape.color is not None]
        main = "rgb({} {} {})".format(*(round(255 * x) for x in own[0])) if own else "rgb({} {} {})".format(*TONES[0])
        marks = (main, "rgb({} {} {} / 60%)".format(*GHOST))
        lines += [f'<i style="background:{c}"></i>{html.escape(x)}' for c, x in zip(marks, labels, strict=True)]
    if len(times) > 1:
        pace = "in real time" if speed == 1 else f"at {speed:g} times its speed"
        start = f" from t = {times[0]:g} s" if times[0] else ""
        lines.append(f"{times[-1] - times[0]:.4g} s of motion{start}, {pace}, then a pause of {HOLD:g} s")
    lines.append(f"purple: joint axes; squares of the floor: {cell:g} m")
    lines.append('<label><input type="checkbox" id="masses">show what the model weighs</label>')
    return "<br>".join([*lines, "<small>solids of the same mass and inertia; black: centres of mass</small>"])


def _finished(text: str, name: str, key: str, camera: tuple[Array, Array]) -> str:
    """Page of viser with a title, a legend, a camera for narrow windows, and the browser's dark mode."""
    place = json.dumps([x.tolist() for x in camera])
    head = f"{HTML}<title>{html.escape(name)}</title>{CAMERA % place}<style>{STYLE}</style>"
    for mark, ours in ((TITLE, head), (ROOT, f'{ROOT}<div id="rne">{key}</div>'), (LIGHT, DARK)):
        if mark not in text:
            raise RuntimeError(f"this version of viser writes other pages: {mark!r} is missing; pip install 'viser<2'")
        text = text.replace(mark, ours, 1)
    return text
