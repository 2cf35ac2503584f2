"""A robot drawn on 3-D axes: its shapes, lines between link origins, joints and their axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_array
from ..basics.spatial import Array, cross, rotate
from ..model.builder import disassemble
from ..model.model import Model
from ..robot import Robot
from .plots import COLORS, blank_figure, literal
from .shapes import link_shapes
from .surfaces import surface

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LIGHT = np.array([0.3, -0.7, 0.65])  # direction towards the light
ARROW, BASE = 0.16, 0.22  # lengths of a joint axis and of the base frame's axes, relative to the robot's extent
ALPHA = 0.6  # opacity of the surfaces
MAX_NAME = 24  # characters of a link's name in the legend
ABOVE = 100  # zorder above the surfaces, for which matplotlib uses small numbers


def draw(robot: Robot, q: ArrayLike, axes: Any = None) -> Figure:
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
    check_robot(robot)
    poses = robot.link_poses(real_array("q", q, f"({robot.n},)"))
    if poses.ndim != 3:
        raise ValueError(f"`q` must have shape ({robot.n},), one position, got {np.shape(q)}")
    if axes is None:
        axes = blank_axes(robot.model.name)
    elif getattr(axes, "name", None) != "3d":
        raise TypeError(f"`axes` must be matplotlib axes of projection='3d', got {type(axes).__name__}")
    Picture(axes, robot.model, poses[None]).place(0)
    figure: Figure = axes.figure
    return figure


def check_robot(robot: Robot) -> None:
    """Raise TypeError for anything but a Robot."""
    if not isinstance(robot, Robot):
        raise TypeError(f"`robot` must be an rne.Robot, got {type(robot).__name__}")


def blank_axes(title: str) -> Any:
    """3-D axes on a new figure, with room for a legend beside them."""
    figure = blank_figure(7.4, 5.4)
    figure.set_layout_engine("none")
    ax = figure.add_axes((0.0, 0.05, 0.72, 0.88), projection="3d")
    ax.set_title(literal(title))
    return ax


class Picture:
    """The lines and surfaces of a robot on 3-D axes, whose limits hold every frame of a motion.

    Parameters
    ----------
    axes : matplotlib 3-D axes
    model : Model
        The robot's parameters.
    poses : ndarray, shape (frames, n_links, 4, 4)
        Pose of every link in every frame [1, m].
    """

    def __init__(self, ax: Any, model: Model, poses: Array) -> None:
        R, p = poses[..., :3, :3].astype(np.float64), poses[..., :3, 3].astype(np.float64)
        before = np.stack([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()], axis=1) if ax.has_data() else None
        self.ax, self.origins = ax, p
        self.parent = [part.parent for part in disassemble(model)]
        shapes = link_shapes(model)
        links = [k for k, link in enumerate(model.link_names) if any(shape.link == link for shape in shapes)]
        surfaces = [surface([shape for shape in shapes if shape.link == model.link_names[k]]) for k in links]
        owner = np.repeat(np.array(links, dtype=int), [len(faces) for faces in surfaces])
        faces = np.concatenate([np.zeros((0, 4, 3)), *surfaces])
        self.faces = rotate(R[:, owner, None], faces) + p[:, owner, None]
        colors = np.array([_color(k) for k in range(len(links))]).reshape(-1, 3)
        self.colors = np.repeat(colors, [len(faces) for faces in surfaces], axis=0)
        carriers = [model.link_joints.index(joint) for joint in model.moving_joints]
        shaped = {model.link_body[k] for k in links}
        self.bare = [i for i in range(model.nb) if i not in shaped and model.mass[i] > 0]
        self.hosts = [carriers[i] for i in self.bare]
        self.centres = rotate(R[:, self.hosts], model.com[self.bare].astype(np.float64)) + p[:, self.hosts]
        points = np.concatenate([x.reshape(len(p), -1, 3) for x in (p, self.faces, self.centres)], axis=1)
        extent = float(np.ptp(points, axis=1).max()) or 1.0
        self.joints, self.is_revolute = carriers, model.is_revolute
        self.arrows = _arrows(p[:, carriers], rotate(R[:, carriers], model.axis.astype(np.float64)), ARROW * extent)
        self._make_artists()
        self._base(BASE * extent)
        room = [points.reshape(-1, 3), self.arrows.reshape(-1, 3), BASE * extent * np.eye(3)]
        _make_room(ax, np.concatenate(room), before)
        _legend(ax, [model.link_names[k] for k in links], colors)

    def _make_artists(self) -> None:
        from matplotlib import rcParams
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        line, face = rcParams["axes.edgecolor"], rcParams["axes.facecolor"]  # those of the style in use

        self.surface = Poly3DCollection([], alpha=ALPHA)
        self.ax.add_collection3d(self.surface)
        fixed = [k for k in range(1, len(self.parent)) if k not in self.joints]
        joints = np.array(self.joints, dtype=int)
        revolute, prismatic = joints[self.is_revolute], joints[~self.is_revolute]
        self.fixed, self.revolute, self.prismatic = fixed, revolute, prismatic
        self.lines = self._line(self.parent, color=line, linewidth=2, zorder=ABOVE)
        self.to_centres = self._line(self.bare, color="0.5", linewidth=1, linestyle=":", zorder=ABOVE)
        self.axes = self._line(self.joints, "joint axis", color="#b030b0", linewidth=1.3, zorder=ABOVE + 1)
        dots = {"linestyle": "", "markeredgecolor": line, "markerfacecolor": face, "zorder": ABOVE + 2}
        self.at_revolute = self._line(revolute, "revolute joint", marker="o", markersize=6, **dots)
        self.at_prismatic = self._line(prismatic, "prismatic joint", marker="s", markersize=7, **dots)
        self.at_fixed = self._line(fixed, "link on a fixed joint", marker=".", **dots | {"markerfacecolor": line})
        self.at_centres = self._line(self.bare, "centre of mass", marker="+", **dots | {"markeredgecolor": "0.5"})

    def _line(self, shown: Any, label: str = "", **style: Any) -> Any:
        """A line without points, which `place` sets; in the legend if anything is shown by it."""
        return self.ax.plot([], [], [], label=label if label and len(shown) else "_nolegend_", **style)[0]

    def _base(self, length: float) -> None:
        for end, color, name in zip(length * np.eye(3), ("#d22", "#0a0", "#66f"), "xyz", strict=True):
            self.ax.plot(*np.stack([np.zeros(3), end]).T, color=color, linewidth=2.5, alpha=0.7, zorder=ABOVE - 1)
            self.ax.text(*(1.15 * end), name, color=color, ha="center", va="center", zorder=ABOVE + 3)

    def place(self, frame: int) -> None:
        """Move all lines and surfaces to their places in one frame."""
        p, centres = self.origins[frame], self.centres[frame]
        children = range(1, len(self.parent))
        _set(self.lines, _segments(p[[self.parent[k] for k in children]], p[1:]))
        _set(self.to_centres, _segments(p[self.hosts], centres))
        _set(self.axes, _broken(self.arrows[frame]))
        _set(self.at_revolute, p[self.revolute])
        _set(self.at_prismatic, p[self.prismatic])
        _set(self.at_fixed, p[self.fixed])
        _set(self.at_centres, centres)
        faces = self.faces[frame]
        if len(faces):
            normals = cross(faces[..., 1, :] - faces[..., 0, :], faces[..., 2, :] - faces[..., 0, :])
            size = np.linalg.norm(normals, axis=-1) * np.linalg.norm(LIGHT)
            lit = normals @ LIGHT / np.where(size > 0, size, 1.0)  # flat cylinders have faces of no area
            shades = (0.8 + 0.2 * lit)[..., None] * self.colors
            self.surface.set_verts(faces.reshape(-1, 4, 3))
            self.surface.set_facecolor(shades.reshape(-1, 3))


def _color(k: int) -> tuple[float, ...]:
    from matplotlib.colors import to_rgb

    return to_rgb(f"C{k % COLORS}")


def _arrows(origins: Array, axes: Array, length: float) -> Array:
    """Arrows along unit vectors, each a path along the shaft and four barbs, shape (..., 9, 3) [m]."""
    across = cross(axes, np.eye(3)[np.abs(axes).argmin(axis=-1)])
    across = across / np.linalg.norm(across, axis=-1, keepdims=True)
    other = cross(axes, across)
    tips = origins + length * axes
    path = [origins, tips]
    for side in (across, -across, other, -other):
        path += [tips + length * (0.08 * side - 0.22 * axes), tips]
    return np.stack(path[:-1], axis=-2)


def _segments(starts: Array, ends: Array) -> Array:
    return _broken(np.stack([starts, ends], axis=-2))


def _broken(paths: Array) -> Array:
    """Paths of shape (k, points, 3) joined into one, with NaN between them, where matplotlib breaks the line."""
    return np.concatenate([paths, np.full((len(paths), 1, 3), np.nan)], axis=1).reshape(-1, 3)


def _set(line: Any, points: Array) -> None:
    line.set_data_3d(*points.T)


def _make_room(ax: Any, points: Array, before: Array | None) -> None:
    """Set limits of equal length that hold the points, and what the axes showed before."""
    from matplotlib.ticker import MaxNLocator

    low, high = points.min(axis=0), points.max(axis=0)
    if before is not None:
        low, high = np.minimum(low, before[0]), np.maximum(high, before[1])
    half = 0.52 * float((high - low).max())
    for axis, middle in zip("xyz", (low + high) / 2, strict=True):
        getattr(ax, f"set_{axis}lim")(middle - half, middle + half)
        getattr(ax, f"set_{axis}label")(f"{axis} [m]", labelpad=9)
        ticks = MaxNLocator(6).tick_values(middle - half, middle + half)
        getattr(ax, f"set_{axis}ticks")(
            ticks[np.abs(ticks - middle) < 0.88 * half]
        )  # at the corners they would collide
    ax.tick_params("z", pad=5)
    ax.set_box_aspect((1, 1, 1))


def _legend(ax: Any, links: list[str], colors: Array) -> None:
    from matplotlib.patches import Patch

    handles, labels = ax.get_legend_handles_labels()
    entries = dict(zip(labels, handles, strict=True))
    if len(links) <= COLORS:
        for link, color in zip(links, colors, strict=True):
            name = link if len(link) <= MAX_NAME else link[: MAX_NAME - 3] + "..."
            entries[literal(name)] = Patch(color=color, alpha=ALPHA)
    if entries:
        ax.legend(
            entries.values(),
            entries,
            loc="center left",
            bbox_to_anchor=(1.08, 0.5),
            fontsize="small",
            frameon=False,
        )
