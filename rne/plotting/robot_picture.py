"""Drawing of a robot on 3-D axes, at one position or along a motion: shapes, link origins, joints and their axes."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import output_file, positive_number, real_numbers
from ..basics.marks import COMMENT
from ..basics.spatial import Array, cross, rotate
from ..basics.text import cut
from ..model.model import Model
from ..robot import Robot, robot_argument
from ..simulation.trajectory import Trajectory
from .motions import check_positions, motion_argument
from .plots import COLORS, HIDDEN, WIDTH, blank_figure, figure_of, literal
from .shapes import PosedRobot, surface

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.axes3d import Axes3D
    from PIL.Image import Image

LIGHT = np.array([0.3, -0.7, 0.65])  # direction towards the light
ARROW, BASE = 0.16, 0.22  # lengths of a joint axis and of the base frame's axes, relative to the robot's extent
ALPHA = 0.6  # opacity of the surfaces
SMALL = (WIDTH, 5.6), (0.0, 0.24, 0.96, 0.7)  # size of a figure for narrow pages [inch], and place of its axes
MAX_NAME = 24  # characters of a link's name in the legend
ABOVE = 100  # zorder above the surfaces, for which matplotlib uses small numbers
MIN_FPS = 0.01  # [1/s]; GIF stores at most 655 s per frame
MAX_FPS = 50.0  # [1/s]; viewers slow down files that ask for more
MAX_FRAMES = 2000  # all of them are kept in memory until the file is written
DPI = 90  # dots per inch of an animation
NO_FACES = np.zeros((0, 4, 3))


def draw(robot: Robot, q: ArrayLike, axes: Axes3D | None = None) -> Figure:
    """Draw a robot at one position.

    Parameters
    ----------
    robot : Robot
        The robot.
    q : array_like, shape (n,)
        Joint positions [rad or m].
    axes : matplotlib 3-D axes, optional
        Axes to add the robot to; those of a new figure if not given.

    Returns
    -------
    matplotlib.figure.Figure
        `figure.savefig("arm.png")` writes it to a file.

    Raises
    ------
    TypeError
        If `robot` is no Robot, or `axes` no 3-D axes.
    ValueError
        If `q` has the wrong shape or is not finite.
    ImportError
        If matplotlib is not installed.

    Warns
    -----
    UserWarning
        For visual shapes of the URDF that cannot be shown, such as a mesh that is not found.

    Notes
    -----
    The axes are those of the root link [m], all to the same scale. Drawn are the visual shapes of the robot's URDF,
    meshes as the convex hull of each link's, or the cylinders of `model.shapes` where there is no URDF or yourdfpy is
    not installed (`pip install 'rne[view]'`); lines between the origins of successive links; and the centre of mass of
    each body that has no shape. Lines are drawn over the shapes, so that joints inside them can be seen.

    Examples
    --------
    >>> import rne
    >>> rne.plotting.draw(rne.load("irb140"), [0] * 6).axes[0].get_zlabel()
    'z [m]'
    """
    robot_argument(robot)
    poses = robot.link_poses(real_numbers("q", q, f"({robot.n},)"))
    if poses.ndim != 3:
        raise ValueError(f"`q` must have shape ({robot.n},), one position, got {np.shape(q)}")
    if axes is None:
        axes = _blank_axes(robot.model.name)
    elif getattr(axes, "name", None) != "3d":
        raise TypeError(f"`axes` must be matplotlib axes of projection='3d', got {type(axes).__name__}")
    Picture(axes, robot.model, poses[None]).place(0)
    return figure_of([axes])


def animate(
    robot: Robot,
    motion: Trajectory | Sequence[ArrayLike | None],
    path: str | os.PathLike[str],
    fps: float = 20,
    speed: float = 1.0,
) -> Path:
    """Write a motion as an animated GIF.

    Parameters
    ----------
    robot : Robot
        The robot.
    motion : Trajectory or tuple of array_like
        A motion of this robot, or arrays (t, q) of shapes (T,) and (T, n), such as measured ones.
    path : str or path-like
        The file to write, ending in .gif, in an existing folder.
    fps : float
        Frames per second, from 0.01 to 50. GIF stores the time of a frame in hundredths of a second, to which it is
        rounded.
    speed : float
        Seconds of the motion per second of the animation.

    Returns
    -------
    pathlib.Path
        The file written.

    Raises
    ------
    TypeError
        If `robot`, `motion` or `path` is of another type.
    ValueError
        If `motion` has no samples or is not of this robot, an argument is out of range, or there would be more
        than 2000 frames.
    FileNotFoundError
        If the folder of `path` does not exist.
    ImportError
        If matplotlib is not installed.

    Notes
    -----
    The frames are evenly spaced in time, with the first and the last sample among them. A simulated motion is evaluated
    at these times, and is smooth even where the solver took long steps; arrays are interpolated by straight lines.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> swing = rne.simulate(robot, [0] * 6, [0] * 6, 2.0)
    >>> file = rne.plotting.animate(robot, swing, "swing.gif")  # doctest: +SKIP
    """
    robot_argument(robot)
    shown = check_positions("motion", motion_argument("motion", motion), robot)
    file = output_file(path, ".gif")
    if not MIN_FPS <= positive_number("fps", fps) <= MAX_FPS:
        raise ValueError(f"`fps` must be between {MIN_FPS:g} and {MAX_FPS:g}, got {fps:g}")
    delay = round(100 / fps)  # [0.01 s]
    t = _frame_times(shown.t, delay, positive_number("speed", speed))
    images = _images(robot, t, robot.link_poses(shown.positions(t)))
    options: dict[str, Any] = {
        "append_images": images[1:],
        "duration": 10 * delay,
        "loop": 0,
        "disposal": 1,
        "comment": COMMENT,
    }
    images[0].save(file, save_all=True, **options)
    return file


def _frame_times(samples: Array, delay: int, speed: float) -> Array:
    """Times of the frames [s], both ends of the motion among them."""
    first, last = float(samples[0]), float(samples[-1])
    frames = (last - first) / speed / (delay / 100)
    if frames + 1 > MAX_FRAMES:
        too_many = f"would have {frames + 1:.6g} frames, at most {MAX_FRAMES}"
        raise ValueError(f"the animation {too_many}: raise `speed` or lower `fps`")
    return np.linspace(first, last, max(round(frames), 1) + 1 if last > first else 1)


def _images(robot: Robot, t: Array, poses: Array) -> list[Image]:
    """Images of the frames, with a common palette of 256 colours, as parts at rest would flicker otherwise."""
    ax = _blank_axes("", *SMALL)
    picture, figure = Picture(ax, robot.model, poses), figure_of([ax])
    _put_legend_below(ax, title=0.3)
    figure.set_dpi(DPI)

    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas: Any = FigureCanvasAgg(figure)
    decimals = max(2, math.ceil(-math.log10(t[1] - t[0]))) if len(t) > 1 else 2

    def pixels(frame: int) -> Array:
        picture.place(frame)
        ax.set_title(f"{literal(robot.model.name)}, t = {t[frame]:.{decimals}f} s")
        canvas.draw()
        return np.array(canvas.buffer_rgba())[..., :3]

    some = {frame: pixels(frame) for frame in sorted({0, len(t) // 2, len(t) - 1})}
    palette = Image.fromarray(np.concatenate([*some.values()])).quantize(method=Image.Quantize.MAXCOVERAGE, kmeans=1)
    frames = (Image.fromarray(some[frame] if frame in some else pixels(frame)) for frame in range(len(t)))
    return [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]


def _blank_axes(title: str, size: Sequence[float] = (7.4, 5.4), place: Any = (0.0, 0.05, 0.72, 0.88)) -> Axes3D:
    """Empty 3-D axes on a new figure, with room for a legend beside or below them."""
    figure = blank_figure(*size)
    figure.set_layout_engine("none")
    ax: Any = figure.add_axes(place, projection="3d")
    ax.set_title(literal(title))
    return ax


def small_picture(robot: Robot, q: ArrayLike) -> Figure:
    """Picture of the robot at q for narrow pages, with its legend below."""
    ax = _blank_axes("", *SMALL)
    figure = draw(robot, q, axes=ax)
    _put_legend_below(ax)
    return figure


def _put_legend_below(ax: Axes3D, title: float = 0.0) -> None:
    """Put the legend under the axes of a figure for narrow pages, with a title of this height over them [inch]."""
    figure, beside = figure_of([ax]), ax.get_legend()
    if beside is not None:
        beside.remove()
        labels = [text.get_text() for text in beside.get_texts()]
        axes, legend = 4.3, 0.4 + 0.25 * -(-len(labels) // 2)  # heights [inch]
        height = axes + legend + title
        figure.set_size_inches(WIDTH, height)
        ax.set_position((0.0, legend / height, 0.96, axes / height))
        figure.legend(beside.legend_handles, labels, loc="lower center", ncols=2, frameon=False)


class Picture:
    """Lines and surfaces of a robot on 3-D axes, for poses of its links, shape (frames, n_links, 4, 4) [1, m]."""

    def __init__(self, ax: Axes3D, model: Model, poses: Array) -> None:
        from matplotlib.colors import to_rgb
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        before = np.stack([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()], axis=1) if ax.has_data() else None
        robot = PosedRobot(model, poses)
        links = sorted({model.link_index(shape.link) for shape in robot.shapes})
        surfaces = [surface([x for x in robot.shapes if x.link == model.link_names[k]]) for k in links]
        counts = [len(faces) for faces in surfaces]
        owner = np.repeat(np.array(links, dtype=int), counts)
        colors = np.array([to_rgb(f"C{k % COLORS}") for k in range(len(links))]).reshape(-1, 3)
        self.colors = np.repeat(colors, counts, axis=0)
        self.faces = rotate(robot.R[:, owner, None], np.concatenate([NO_FACES, *surfaces])) + robot.p[:, owner, None]
        self.surface = Poly3DCollection([], alpha=ALPHA)
        ax.add_collection3d(self.surface)
        shaped = {model.link_body[k] for k in links}
        bare = [i for i in range(model.nb) if i not in shaped and model.mass[i] > 0]
        solid = [x.reshape(len(poses), -1, 3) for x in (robot.p, self.faces, robot.centres[:, bare])]
        extent = float(np.ptp(np.concatenate(solid, axis=1), axis=1).max()) or 1.0
        arrows = _arrows(robot.p[:, robot.carried], robot.axes, ARROW * extent)
        self.ax, self.lines = ax, list[tuple[Any, Array]]()  # each line with its points in every frame
        self._add_lines(robot, bare, arrows)
        base = BASE * extent * np.eye(3)
        for end, color, name in zip(base, ("#d22", "#0a0", "#66f"), "xyz", strict=True):
            ax.plot(*np.stack([np.zeros(3), end]).T, color=color, linewidth=2.5, alpha=0.7, zorder=ABOVE - 1)
            ax.text(*(1.15 * end), name, color=color, ha="center", va="center", zorder=ABOVE + 3)
        _make_room(ax, np.concatenate([x.reshape(-1, 3) for x in (*solid, arrows, base)]), before)
        _legend(ax, [model.link_names[k] for k in links], colors)

    def _add_lines(self, robot: PosedRobot, bare: list[int], arrows: Array) -> None:
        from matplotlib import rcParams

        line, face = rcParams["axes.edgecolor"], rcParams["axes.facecolor"]  # those of the style in use
        p, carried, turning = robot.p, np.array(robot.carried, dtype=int), robot.model.is_revolute
        parents = np.array(robot.model.link_parent[1:], dtype=int)
        fixed = np.setdiff1d(np.arange(1, p.shape[1]), carried)
        centres = robot.centres[:, bare]
        to_centres = np.stack([p[:, carried[bare]], centres], axis=-2)
        dots = {"linestyle": "", "markeredgecolor": line, "markerfacecolor": face, "zorder": ABOVE + 2}
        self._line(_broken(np.stack([p[:, parents], p[:, 1:]], axis=-2)), color=line, linewidth=2, zorder=ABOVE)
        self._line(_broken(to_centres), color="0.5", linewidth=1, linestyle=":", zorder=ABOVE)
        self._line(_broken(arrows), "joint axis", color="#b030b0", linewidth=1.3, zorder=ABOVE + 1)
        self._line(p[:, carried[turning]], "revolute joint", marker="o", markersize=6, **dots)
        self._line(p[:, carried[~turning]], "prismatic joint", marker="s", markersize=7, **dots)
        self._line(p[:, fixed], "link on a fixed joint", marker=".", **dots | {"markerfacecolor": line})
        self._line(centres, "centre of mass", marker="+", **dots | {"markeredgecolor": "0.5"})

    def _line(self, points: Array, label: str = "", **style: Any) -> None:
        """Add a line through points of shape (frames, P, 3), in the legend if there are any."""
        (line,) = self.ax.plot([], [], [], label=label if label and points.shape[1] else HIDDEN, **style)
        self.lines.append((line, points))

    def place(self, frame: int) -> None:
        """Move all lines and surfaces to their places in one frame."""
        for line, points in self.lines:
            line.set_data_3d(*points[frame].T)
        faces = self.faces[frame]
        if len(faces):
            normals = cross(faces[..., 1, :] - faces[..., 0, :], faces[..., 2, :] - faces[..., 0, :])
            size = np.linalg.norm(normals, axis=-1) * np.linalg.norm(LIGHT)
            lit = normals @ LIGHT / np.where(size > 0, size, 1.0)  # flat cylinders have faces of no area
            self.surface.set_verts(faces)
            self.surface.set_facecolor((0.8 + 0.2 * lit)[..., None] * self.colors)


def _arrows(origins: Array, axes: Array, length: float) -> Array:
    """Arrows along unit vectors, each a path along the shaft and four barbs, shape (..., 9, 3) [m]."""
    across = cross(axes, np.eye(3)[np.abs(axes).argmin(axis=-1)])
    across = across / np.linalg.norm(across, axis=-1, keepdims=True)
    other = cross(axes, across)
    tips = origins + length * axes
    barbs = [tips + length * (0.08 * side - 0.22 * axes) for side in (across, -across, other, -other)]
    return np.stack([origins, *(x for barb in barbs for x in (tips, barb))], axis=-2)


def _broken(paths: Array) -> Array:
    """Paths of shape (frames, k, points, 3) joined, with NaN between them, where matplotlib breaks the line."""
    return np.pad(paths, [(0, 0), (0, 0), (0, 1), (0, 0)], constant_values=np.nan).reshape(len(paths), -1, 3)


def _make_room(ax: Axes3D, points: Array, before: Array | None) -> None:
    """Set limits of equal length that hold the points, and the former contents of the axes."""
    from matplotlib.ticker import MaxNLocator

    low, high = points.min(axis=0), points.max(axis=0)
    if before is not None:
        low, high = np.minimum(low, before[0]), np.maximum(high, before[1])
    half = 0.52 * float((high - low).max())
    for axis, middle in zip("xyz", (low + high) / 2, strict=True):
        ticks = MaxNLocator(6).tick_values(middle - half, middle + half)
        apart = ticks[np.abs(ticks - middle) < 0.88 * half]  # at the corners they would collide
        ax.set(**{f"{axis}lim": (middle - half, middle + half), f"{axis}ticks": apart})
        getattr(ax, f"set_{axis}label")(f"{axis} [m]", labelpad=9)
    ax.tick_params("z", pad=5)
    ax.set_box_aspect((1, 1, 1))


def _legend(ax: Axes3D, links: list[str], colors: Array) -> None:
    from matplotlib.patches import Patch

    handles, labels = ax.get_legend_handles_labels()
    entries = dict(zip(labels, handles, strict=True))
    if len(links) <= COLORS:
        for link, color in zip(links, colors, strict=True):
            entries[literal(cut(link, MAX_NAME))] = Patch(color=color, alpha=ALPHA)
    if entries:
        place = {"loc": "center left", "bbox_to_anchor": (1.08, 0.5)}
        ax.legend(entries.values(), entries, fontsize="small", frameon=False, **place)
