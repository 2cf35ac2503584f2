"""Pictures of robots and motions: what they show, with which units, and what they refuse."""

import dataclasses
import itertools
import re
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image

import rne
from rne.model import Box
from rne.plotting.motions import motion_argument
from rne.plotting.shapes import link_shapes, surface

from .helpers import EPS, ROOT
from .random_robots import random_tree, straight_chain

SAME_POSITION = 16 * EPS  # [m]; kernels and recursions round differently, robots here are of a few metres
BENT = [0.5, 0.6, -0.4, 0.3, 0.8, 0]


@pytest.fixture(scope="module")
def swing(irb140):
    return rne.simulate(irb140, [0] * 6, [0] * 6, 0.4)


@pytest.fixture(scope="module")
def rod():
    return rne.Robot(straight_chain(1))


def first(trajectory, count):
    names = ("t", "q", "qd", "qdd", "tau", "kinetic", "potential", "energy", "work")
    return dataclasses.replace(trajectory, **{name: getattr(trajectory, name)[:count] for name in names})


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def line(ax, label):
    """Points of the one curve of this name."""
    (found,) = [x for x in ax.lines if x.get_label() == label]
    return np.array(found.get_data_3d()).T


def limits(ax):
    return np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])


def test_a_page_for_a_notebook_loads_plotting_and_no_heavy_package():
    code = (
        "import sys, rne; page = rne.load('irb140').bounds(quantities=['gravity_torque'])._repr_html_();"
        "print(page[:4], *{'matplotlib', 'PIL', 'pinocchio', 'scipy'} & set(sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert run.stdout == "<div\n"


@pytest.mark.parametrize("name", rne.plotting.__all__)
def test_public_functions_are_documented(name):
    for section in ("Parameters", "Returns", "Raises", "Examples"):
        assert re.search(rf"{section}\n +---", getattr(rne.plotting, name).__doc__), section


@pytest.mark.parametrize("q", [BENT])
def test_draw_places_joints_and_cylinders(irb140, q):
    (ax,) = rne.plotting.draw(irb140, q).axes
    poses = irb140.link_poses(q)
    np.testing.assert_allclose(line(ax, "revolute joint"), poses[1:7, :3, 3], rtol=0, atol=SAME_POSITION)
    assert [ax.get_xlabel(), ax.get_ylabel(), ax.get_zlabel()] == ["x [m]", "y [m]", "z [m]"]
    np.testing.assert_allclose(line(ax, "link on a fixed joint"), poses[7:, :3, 3], rtol=0, atol=SAME_POSITION)
    markers = ["joint axis", "revolute joint", "link on a fixed joint"]
    assert legend(ax) == [*markers, "base_link", *(f"link_{k}" for k in range(1, 7))]
    drawn = np.asarray(ax.collections[0]._faces)
    for shape in irb140.model.shapes:  # those of a link follow each other, links in order
        count, half = (
            (6, np.array(shape.size) / 2) if isinstance(shape, Box) else (64, [shape.radius, shape.length / 2])
        )
        points, drawn = drawn[:count].reshape(-1, 3), drawn[count:]
        T = poses[irb140.link_names.index(shape.link)]
        centre = T[:3, :3] @ shape.position + T[:3, 3]
        assert np.linalg.norm(points - centre, axis=1).max() == pytest.approx(np.linalg.norm(half), rel=1e-12)
        np.testing.assert_allclose((points.max(0) + points.min(0)) / 2, centre, atol=1e-12)
    assert not len(drawn)


def test_draw_is_to_one_scale_and_holds_everything(irb140):
    (ax,) = rne.plotting.draw(irb140, BENT).axes
    box = limits(ax)
    sides = np.ptp(box, axis=1)
    np.testing.assert_allclose(sides, sides[0])
    np.testing.assert_allclose(ax._box_aspect, ax._box_aspect[0])
    points = np.concatenate([np.array(x.get_data_3d()).T for x in ax.lines] + [ax.collections[0]._faces.reshape(-1, 3)])
    points = points[np.isfinite(points).all(axis=1)]
    assert (points > box[:, 0]).all()
    assert (points < box[:, 1]).all()


def test_draw_of_any_tree(tree):
    robot = rne.Robot(tree)
    q = np.linspace(-1, 1, robot.n)
    (ax,) = rne.plotting.draw(robot, q).axes
    kinds = {"revolute joint": tree.is_revolute, "prismatic joint": ~tree.is_revolute}
    origins = robot.link_poses(q)[:, :3, 3]
    at = np.array([origins[tree.link_joints.index(joint)] for joint in tree.moving_joints])
    for label, chosen in kinds.items():
        assert (label in legend(ax)) == chosen.any()
        if chosen.any():
            np.testing.assert_allclose(line(ax, label), at[chosen], rtol=0, atol=SAME_POSITION)
    arrows = line(ax, "joint axis").reshape(tree.nb, -1, 3)
    along = arrows[:, 1] - arrows[:, 0]
    poses = robot.link_poses(q)
    for i, joint in enumerate(tree.moving_joints):
        axis = poses[tree.link_joints.index(joint), :3, :3] @ tree.axis[i]
        np.testing.assert_allclose(along[i] / np.linalg.norm(along[i]), axis, atol=1e-12)
    assert "centre of mass" in legend(ax)


def test_draw_of_a_rod_shows_its_centre_of_mass(rod):
    (ax,) = rne.plotting.draw(rod, [np.pi / 2]).axes
    np.testing.assert_allclose(line(ax, "centre of mass"), [[-0.15, 0, 0]], atol=1e-15)


def test_centres_of_mass_are_where_gravity_acts(tmp_path):
    """U = -m g.c, in any direction of gravity, also where the loader has slid a far joint origin along its axis."""
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    file = tmp_path / "far.urdf"
    file.write_text(
        '<robot name="far"><link name="base"/><link name="arm"><inertial><origin xyz="0.1 -300 0.2"/><mass value="2"/>'
        f'{inertia}</inertial></link><joint name="j" type="continuous"><parent link="base"/><child link="arm"/>'
        '<origin xyz="0 300 0.5"/><axis xyz="0 1 0"/></joint></robot>'
    )
    (ax,) = rne.plotting.draw(rne.load(file), [0.3]).axes
    assert rne.load(file).model.joint_origin.any()
    expected = [[-rne.load(file, gravity=g).potential_energy([0.3]) / 2 for g in np.eye(3)]]
    np.testing.assert_allclose(line(ax, "centre of mass"), expected, rtol=0, atol=300 * SAME_POSITION)


def test_draw_of_nothing_but_a_base():
    (ax,) = rne.plotting.draw(rne.Robot(random_tree(0, seed=1)), []).axes
    assert [text.get_text() for text in ax.texts] == ["x", "y", "z"]


def test_draw_on_given_axes_adds_and_keeps_room_for_both(irb140):
    figure = Figure()
    ax = figure.add_subplot(projection="3d")
    assert rne.plotting.draw(irb140, [0] * 6, ax) is figure
    before = limits(ax)
    rne.plotting.draw(irb140, BENT, axes=ax)
    assert (limits(ax)[:, 0] <= before[:, 0]).all()
    assert (limits(ax)[:, 1] >= before[:, 1]).all()
    assert len(ax.collections) == 2
    assert legend(ax).count("revolute joint") == 1


@pytest.mark.parametrize("number", [0, 1])  # a box, a cylinder
def test_faces_look_outwards(irb140, number):
    shape = link_shapes(irb140.model)[number]
    faces = surface([shape])
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    assert ((normals * (faces.mean(axis=1) - shape.pose[:3, 3])).sum(axis=1) > 0).all()


def test_light_comes_from_above(irb140, monkeypatch):
    """Of each colour faces that look up are brighter than those that look down."""
    found = {}

    def noted(name):
        own = getattr(Poly3DCollection, name)
        return lambda self, given, *more: (found.update({name: np.array(given)}), own(self, given, *more))

    for name in ("set_verts", "set_facecolor"):
        monkeypatch.setattr(Poly3DCollection, name, noted(name))
    rne.plotting.draw(irb140, [0] * 6)
    faces, colours = found["set_verts"], found["set_facecolor"]
    up = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])[:, 2]
    hues = colours / np.linalg.norm(colours, axis=1, keepdims=True)
    for hue in np.unique(hues.round(6), axis=0):
        own = np.abs(hues - hue).max(1) < 1e-5
        size = 0.9 * np.abs(up[own]).max()
        assert colours[own & (up > size)].sum(1).min() > colours[own & (up < -size)].sum(1).max()


def test_animation_has_its_frames_and_moves(rod, tmp_path):
    path = tmp_path / "swing.gif"
    motion = rne.simulate(rod, [1.0], [0.0], 0.4)
    assert rne.plotting.animate(rod, motion, str(path), fps=10, speed=2) == path
    with Image.open(path) as film:
        assert film.n_frames == 0.4 / 2 * 10 + 1
        frames, total = [], 0
        for k in range(film.n_frames):
            film.seek(k)
            total += film.info["duration"]
            frames.append(np.asarray(film.convert("RGB")))
    assert total == 300  # [ms], the last frame stands as long as the others
    below_title = [frame[40:] for frame in frames]
    assert all((a != b).any() for a, b in itertools.pairwise(below_title))


@pytest.mark.long
def test_colours_of_resting_parts_do_not_flicker(irb140, swing, tmp_path):
    """Below the axes stands the legend, in colours of small area that a palette per frame would not keep."""
    rne.plotting.animate(irb140, swing, tmp_path / "swing.gif", fps=10)
    with Image.open(tmp_path / "swing.gif") as film:
        frames = []
        for k in range(film.n_frames):
            film.seek(k)
            frames.append(np.asarray(film.convert("RGB")).astype(int)[-60:])
    assert (np.ptp(frames, axis=0) == 0).all()
    assert (frames[0][-1, -1] == 255).all()  # white
    assert len(np.unique(frames[0].reshape(-1, 3), axis=0)) > 20


def test_animation_of_a_single_sample_is_one_frame(rod, tmp_path):
    still = first(rne.simulate(rod, [1], [0], 0.1), 1)
    with Image.open(rne.plotting.animate(rod, still, tmp_path / "still.gif")) as film:
        assert film.n_frames == 1
        assert film.width == round(90 * 4.9)  # dots per inch, inches


def test_positions_of_frames_follow_the_motion_between_its_samples(rod):
    t = np.linspace(0, 2, 201)
    coarse = rne.simulate(rod, [1], [0], 2.0, rtol=1e-10)
    fine = rne.simulate(rod, [1], [0], 2.0, rtol=1e-10, t_eval=t)
    assert np.abs(motion_argument("motion", coarse).positions(t) - fine.q).max() < 2e-4
    assert np.abs(np.interp(t, coarse.t, coarse.q[:, 0]) - fine.q[:, 0]).max() > 2e-3  # straight lines would not do


def test_arrays_are_animated_along_straight_lines_between_their_samples(rod, tmp_path):
    given = motion_argument("motion", ([0.0, 1.0], [[0.0], [2.0]]))
    np.testing.assert_array_equal(given.positions(np.array([0.0, 0.25, 1.0])), [[0.0], [0.5], [2.0]])
    with Image.open(rne.plotting.animate(rod, ([0.0, 1.0], [[0.0], [2.0]]), tmp_path / "a.gif", fps=1)) as film:
        assert film.n_frames == 2


MISSING = "pictures need matplotlib, which is not installed: pip install 'rne[plot]'"


def test_without_matplotlib_the_cure_is_named(irb140, swing, tmp_path, monkeypatch):
    for module in [m for m in sys.modules if m.split(".")[0] == "matplotlib"]:
        monkeypatch.setitem(sys.modules, module, None)
    calls = (
        lambda: rne.plotting.draw(irb140, [0] * 6),
        lambda: rne.plotting.animate(irb140, swing, tmp_path / "a.gif"),
    )
    for call in calls:
        with pytest.raises(ImportError, match=f"^{re.escape(MISSING)}$"):
            call()


WRONG = {
    "draw model": (
        lambda r, s: rne.plotting.draw(r.model, [0] * 6),
        TypeError,
        "`robot` must be an rne.Robot, got Model",
    ),
    "draw short q": (
        lambda r, s: rne.plotting.draw(r, [0] * 5),
        ValueError,
        "`q` must have shape (..., 6) for robot 'irb140', got (5,)",
    ),
    "draw batch": (
        lambda r, s: rne.plotting.draw(r, np.zeros((2, 6))),
        ValueError,
        "`q` must have shape (6,), one position, got (2, 6)",
    ),
    "draw nan": (
        lambda r, s: rne.plotting.draw(r, [0, 0, np.nan, 0, 0, 0]),
        ValueError,
        "`q` must be finite, got nan at index (2,)",
    ),
    "draw flat": (
        lambda r, s: rne.plotting.draw(r, [0] * 6, Figure().add_subplot()),
        TypeError,
        "`axes` must be matplotlib axes of projection='3d', got Axes",
    ),
    "animation model": (
        lambda r, s: rne.plotting.animate(r.model, s, "a.gif"),
        TypeError,
        "`robot` must be an rne.Robot, got Model",
    ),
    "animation empty": (
        lambda r, s: rne.plotting.animate(r, first(s, 0), "a.gif"),
        ValueError,
        "`motion` must have at least one sample, got none",
    ),
    "animation of rates": (
        lambda r, s: rne.plotting.animate(r, ([0.0], None, np.zeros((1, 6))), "a.gif"),
        ValueError,
        "`motion` must hold positions, got None for them",
    ),
    "animation other": (
        lambda r, s: rne.plotting.animate(rne.Robot(straight_chain(2)), s, "a.gif"),
        ValueError,
        "`motion` must have 2 joints as robot 'chain2' has, got 6",
    ),
    "animation mp4": (
        lambda r, s: rne.plotting.animate(r, s, "a.mp4"),
        ValueError,
        "`path` must end in .gif, got 'a.mp4'",
    ),
    "animation path": (
        lambda r, s: rne.plotting.animate(r, s, None),
        TypeError,
        "`path` must be a str or path-like, got NoneType",
    ),
    "animation folder": (
        lambda r, s: rne.plotting.animate(r, s, "films/a.gif"),
        FileNotFoundError,
        "`path` must be in an existing folder, got 'films/a.gif'",
    ),
    "animation fps": (
        lambda r, s: rne.plotting.animate(r, s, "a.gif", fps=60),
        ValueError,
        "`fps` must be between 0.01 and 50, got 60",
    ),
    "animation few fps": (
        lambda r, s: rne.plotting.animate(r, s, "a.gif", fps=1e-9),
        ValueError,
        "`fps` must be between 0.01 and 50, got 1e-09",
    ),
    "animation no fps": (
        lambda r, s: rne.plotting.animate(r, s, "a.gif", fps=0),
        ValueError,
        "`fps` must be positive, got 0.0",
    ),
    "animation back": (
        lambda r, s: rne.plotting.animate(r, s, "a.gif", speed=-1),
        ValueError,
        "`speed` must be positive, got -1.0",
    ),
    "animation long": (
        lambda r, s: rne.plotting.animate(r, s, "a.gif", speed=1e-3),
        ValueError,
        "the animation would have 8001 frames, at most 2000: raise `speed` or lower `fps`",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_calls_are_refused_by_name(irb140, swing, case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call, error, text = WRONG[case]
    with pytest.raises(error, match=f"^{re.escape(text)}$"):
        call(irb140, swing)
    assert not list(tmp_path.iterdir())
