"""Viewer pages: what their recording holds, what they refuse, and that a real browser shows them without network."""

import base64
import dataclasses
import html
import http.client
import io
import os
import pickle
import re
import shutil
import socket
import sys
from collections import defaultdict
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

import rne
from rne.__main__ import main
from rne.model.abb_irb140 import LINKS
from rne.plotting import viewer, viewer_scene
from rne.plotting.motions import motion_argument
from rne.plotting.shapes import link_shapes, surface
from rne.plotting.viewer import aim, frame_times, placed
from rne.plotting.viewer_scene import cylinder_of, ellipsoids, link_lines, simplified

from .helpers import EPS
from .random_robots import random_tree

SINGLE = 1e-6  # of metres and quaternions in pages, which hold float32
INERTIAL = '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
CRANE = f"""<robot name="crane &lt;1&gt;">
  <material name="red"><color rgba="1 0 0 0.5"/></material>
  <link name="base"><visual><origin xyz="0 0 0.5" rpy="0 0 1"/><geometry><box size="0.2 0.4 1"/></geometry></visual></link>
  <link name="jib">{INERTIAL}
    <visual><geometry><sphere radius="0.3"/></geometry><material name="red"/></visual>
    <visual><geometry><cylinder radius="0.1" length="0.7"/></geometry></visual></link>
  <link name="hook">{INERTIAL}<visual><origin xyz="0 0 -0.1"/><geometry>
    <mesh filename="package://crane/meshes/MESH" scale="0.1 0.2 0.3"/></geometry></visual></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="jib"/><origin xyz="0 0 1"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="lift" type="prismatic"><parent link="jib"/><child link="hook"/><origin xyz="0.8 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-0.8" upper="0" effort="100" velocity="1"/></joint>
</robot>"""
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def crane(folder, mesh="tetrahedron.obj", text=CRANE):
    """A robot with every kind of shape, as a package in a folder."""
    for name in ("urdf", "meshes"):
        (folder / "crane" / name).mkdir(parents=True, exist_ok=True)
    (folder / "crane" / "meshes" / "tetrahedron.obj").write_text(OBJ)
    (folder / "crane" / "meshes" / "empty.obj").write_text("")
    file = folder / "crane" / "urdf" / "crane.urdf"
    file.write_text(text.replace("MESH", mesh))
    return rne.load(file)


def decoded(page):
    """What a page records, as viser's client decodes it; arrays are numbers of buffers."""
    import msgspec
    import zstandard

    data = base64.b64decode(re.search(r'__VISER_EMBED_DATA__="([^"]*)"', page.html)[1])
    inner = zstandard.ZstdDecompressor().decompressobj().decompress(data[8:])
    length = int.from_bytes(inner[:8], "little")
    return msgspec.msgpack.decode(inner[8 : 8 + length])


def recording(page):
    """Length [s] and messages (time, message) of a page."""
    content = decoded(page)
    return content["durationSeconds"], content["messages"]


def state(messages, time):
    """Position and orientation of every node at a time."""
    places = defaultdict(lambda: {"position": np.zeros(3), "wxyz": np.array([1.0, 0, 0, 0])})
    for instant, message in messages:
        if instant <= time + 1e-9 and message["type"] in ("SetPositionMessage", "SetOrientationMessage"):
            key = "position" if "position" in message else "wxyz"
            places[message["name"]][key] = np.array(message[key])
    return places


def nodes(messages, kind):
    return [message["name"] for _, message in messages if message["type"] == kind]


def turned(wxyz):
    w, x, y, z = wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@pytest.fixture(scope="module")
def swing(irb140):
    return rne.simulate(irb140, [0] * 6, [0] * 6, 0.4)


@pytest.fixture(scope="module")
def loaded(irb140):
    return rne.simulate(irb140.with_payload(6.0), [0] * 6, [0, 2.0, 0, 0, 0, 0], 0.6)


@pytest.fixture(scope="module")
def both(swing, loaded):
    return rne.view(swing, other=loaded, labels=["plain", "6 kg"])


LOST = {
    "not found": (
        "none.stl",
        CRANE,
        "robot 'crane <1>': visual shapes are not shown: link 'hook': mesh 'package://crane/meshes/none.stl' is not found below the folder of the URDF file or of its package, which has a package.xml",
    ),
    "empty": (
        "empty.obj",
        CRANE,
        "robot 'crane <1>': visual shapes are not shown: link 'hook': mesh 'package://crane/meshes/empty.obj' has no triangles",
    ),
    "size": (
        "tetrahedron.obj",
        CRANE.replace('sphere radius="0.3"', 'sphere radius="-1"'),
        "robot 'crane <1>': visual shapes are not shown: link 'jib': <sphere> has a size or origin that is not positive and finite",
    ),
    "scale": (
        "tetrahedron.obj",
        CRANE.replace('scale="0.1', 'scale="nan'),
        "robot 'crane <1>': visual shapes are not shown: link 'hook': mesh 'package://crane/meshes/tetrahedron.obj' has a size or origin that is not positive and finite",
    ),
}


class TestShapes:
    def test_every_kind_has_its_size_place_and_colour(self, tmp_path):
        shapes = link_shapes(crane(tmp_path).model)
        kinds = [("base", "box"), ("jib", "sphere"), ("jib", "cylinder"), ("hook", "mesh")]
        assert [(s.link, s.kind) for s in shapes] == kinds
        assert (shapes[2].radius, shapes[2].length) == (0.1, 0.7)
        assert shapes[0].size == (0.2, 0.4, 1.0)
        np.testing.assert_allclose(np.linalg.norm(shapes[1].mesh.vertices, axis=1), 0.3, rtol=1e-15)
        c, s = np.cos(1), np.sin(1)
        np.testing.assert_allclose(
            shapes[0].pose, [[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]], atol=EPS
        )
        assert [shape.color for shape in shapes] == [None, (1.0, 0.0, 0.0, 0.5), None, None]
        mesh = shapes[3].mesh
        got = np.unique(mesh.vertices[mesh.faces].reshape(-1, 3), axis=0)
        np.testing.assert_allclose(got, np.unique(CORNERS * [0.1, 0.2, 0.3], axis=0), atol=EPS)

    def test_a_mesh_that_its_reader_cannot_read_is_lost(self, tmp_path):
        """What the reader says differs between its versions."""
        robot = crane(tmp_path, "bad.glb")
        (tmp_path / "crane" / "meshes" / "bad.glb").write_bytes(b"glTF")
        text = (
            r"link 'hook': mesh 'package://crane/meshes/bad.glb' is not readable \(\w+: .+\); links without shapes are "
            "drawn as lines$"
        )
        with pytest.warns(UserWarning, match=text):
            assert [shape.kind for shape in link_shapes(robot.model)] == ["box", "sphere", "cylinder"]

    def test_changed_and_pickled_robots_keep_them(self, tmp_path):
        robot = crane(tmp_path)
        changed = [robot.with_payload(1.0, link="hook"), robot.locked({"turn": 0.3}), robot.mounted([1, 0, 0])]
        for other in (*changed, pickle.loads(pickle.dumps(robot))):
            assert [s.kind for s in link_shapes(other.model)] == ["box", "sphere", "cylinder", "mesh"]

    def test_where_a_robot_was_read_from_is_not_compared(self, tmp_path):
        assert rne.read_urdf("robots/irb140.urdf").source == os.path.abspath("robots/irb140.urdf")
        assert rne.read_urdf("robots/irb140.urdf") == rne.irb140()
        assert rne.irb140().source is None

    def test_the_built_in_robot_needs_no_reader(self, monkeypatch):
        monkeypatch.setitem(sys.modules, "yourdfpy", None)
        assert [s.kind for s in link_shapes(rne.irb140())].count("box") == 7

    def test_meshes_may_be_named_by_the_address_of_a_file(self, tmp_path):
        file = tmp_path / "a mesh.obj"
        file.write_text(OBJ)
        (tmp_path / "package.xml").write_text("<package/>")  # of which all robots below it may read
        mesh = f'<visual><geometry><mesh filename="{file.as_uri()}"/></geometry></visual>'
        robot = crane(tmp_path, text=f'<robot name="r"><link name="l">{mesh}</link></robot>')
        assert [s.kind for s in link_shapes(robot.model)] == ["mesh"]

    @pytest.mark.parametrize("case", LOST)
    def test_what_is_lost_is_named_in_one_warning(self, tmp_path, case):
        mesh, text, expected = LOST[case]
        robot = crane(tmp_path, mesh, text)
        full = f"{expected}; links without shapes are drawn as lines"
        with pytest.warns(UserWarning, match=f"^{re.escape(full)}$") as caught:
            shapes = link_shapes(robot.model)
        assert len(caught) == 1
        assert len(shapes) == 3

    def test_a_page_of_two_motions_warns_once(self, tmp_path):
        robot = crane(tmp_path, "none.stl")
        with pytest.warns(UserWarning, match="visual shapes are not shown") as caught:
            rne.view(robot, other=[0.5, -0.5])
        assert len(caught) == 1

    def test_many_losses_are_counted(self, tmp_path):
        visual = '<visual><geometry><mesh filename="a.stl"/></geometry></visual>'
        robot = crane(tmp_path, text=f'<robot name="r"><link name="l">{6 * visual}</link></robot>')
        with pytest.warns(
            UserWarning, match=r"link 'l': mesh 'a.stl' is not found .* package.xml and 2 more; links without"
        ):
            assert link_shapes(robot.model) == []

    def test_without_yourdfpy_cylinders_are_left_and_the_cure_is_named(self, tmp_path, monkeypatch):
        robot = crane(tmp_path)
        monkeypatch.setitem(sys.modules, "yourdfpy", None)
        text = (
            "robot 'crane <1>': visual shapes are not shown: <mesh>, <sphere> need yourdfpy, which is not "
            "installed: pip install 'rne[view]'; links without shapes are drawn as lines"
        )
        with pytest.warns(UserWarning, match=f"^{re.escape(text)}$"):
            assert [(s.link, s.kind) for s in link_shapes(robot.model)] == [("base", "box"), ("jib", "cylinder")]
        assert len(link_shapes(rne.read_urdf("robots/irb140.urdf"))) == 17  # nothing is lost

    def test_without_its_file_cylinders_and_boxes_are_left(self, tmp_path):
        robot = crane(tmp_path)
        file = tmp_path / "crane" / "urdf" / "crane.urdf"
        file.unlink()
        with pytest.warns(
            UserWarning, match=re.escape(f"all but cylinders and boxes: file {str(file)!r} is not there any more")
        ):
            assert [s.kind for s in link_shapes(robot.model)] == ["box", "cylinder"]

    def test_faces_for_pictures_enclose_the_volume_anticlockwise(self, tmp_path):
        """The divergence theorem: a sum over faces seen from outside is the volume, of a sphere and a prism a little less."""
        shapes = link_shapes(crane(tmp_path).model)
        expected = [0.08, 4 / 3 * np.pi * 0.3**3, np.pi * 0.1**2 * 0.7, 0.006 / 6]
        for shape, volume, share in zip(shapes, expected, (1, 0.9, 0.99, 1), strict=True):
            a, b, c, d = np.moveaxis(surface([shape]), 1, 0)
            triple = (np.cross(a, b) * c).sum() + (np.cross(a, c) * d).sum()
            assert share * volume * (1 - 1e-9) <= triple / 6 <= volume * (1 + 1e-9)

    @pytest.mark.parametrize("faces", ["f 1 2 3", "f 1 2 3\nf 2 3 4"])
    def test_flat_meshes_have_faces_too(self, tmp_path, faces):
        (tmp_path / "crane" / "urdf").mkdir(parents=True)
        (tmp_path / "crane" / "urdf" / "flat.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n{faces}\n")
        mesh = '<visual><geometry><mesh filename="flat.obj"/></geometry></visual>'
        robot = crane(tmp_path, text=f'<robot name="r"><link name="l">{mesh}</link></robot>')
        corners = surface(link_shapes(robot.model)).reshape(-1, 3)
        np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[0, 0, 0], [1, 1, 0]], atol=1e-12)

    def test_draw_shows_them(self, tmp_path):
        (ax,) = rne.plotting.draw(crane(tmp_path), [0.0, 0.0]).axes
        labels = [text.get_text() for text in ax.get_legend().get_texts()]
        assert labels[-3:] == ["base", "jib", "hook"]
        faces = np.array(ax.collections[0]._faces).reshape(-1, 3)
        np.testing.assert_allclose(faces.max(axis=0), [0.9, 0.3, 1.35], rtol=1e-6)  # hook, sphere, cylinder
        assert "centre of mass" not in labels

    def test_simplified_meshes_keep_their_surface(self):
        """Also where triangles share no vertices, as files with normals of their own have it."""
        from trimesh import Trimesh
        from trimesh.creation import icosphere

        corners = icosphere(subdivisions=4).triangles.reshape(-1, 3)
        seamed = Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
        few = simplified(seamed, 0.2)
        assert len(few.faces) < 0.25 * len(seamed.faces)
        assert few.area == pytest.approx(seamed.area, rel=0.03)


class TestRecording:
    def test_links_are_where_the_motion_is_at_every_frame(self, irb140, swing, loaded, both):
        length, messages = recording(both)
        assert length == pytest.approx(0.6 + viewer.HOLD)
        for time in (0.0, 0.4, 0.6):
            places = state(messages, time)
            for group, motion in (("robot", swing), ("other", loaded)):
                q, _, _ = motion(min(time, motion.t[-1]))
                poses = irb140.link_poses(q)
                for k, link in enumerate(irb140.link_names):
                    if f"/{group}/{link}" in nodes(messages, "FrameMessage"):
                        place = places[f"/{group}/{link}"]
                        np.testing.assert_allclose(place["position"], poses[k, :3, 3], atol=2e-5)
                        np.testing.assert_allclose(turned(place["wxyz"]), poses[k, :3, :3], atol=5e-5)

    def test_the_scene_has_all_its_parts(self, irb140, both):
        _, messages = recording(both)
        frames = nodes(messages, "FrameMessage")
        assert [name for name in frames if name.count("/") == 1 and name != "/WorldAxes"] == [
            "/robot",
            "/other",
            "/joint axes",
            "/link frames",
            "/centres of mass",
            "/solids of the same inertia",
        ]
        shapes = nodes(messages, "CylinderMessage") + nodes(messages, "BoxMessage")
        for group in ("robot", "other"):
            assert sum(name.startswith(f"/{group}/") for name in shapes) == len(irb140.model.shapes)
        scales = [m["props"]["scale"] for _, m in messages if m["type"] in ("CylinderMessage", "BoxMessage")]
        assert min(scales) == 1 < max(scales) < 1.01  # where both motions agree, the other one is just outside
        assert sorted(nodes(messages, "ArrowMessage")) == [f"/joint axes/link_{i}/joint_{i}" for i in range(1, 7)]
        assert {f"/link frames/{link}/axes" for link in irb140.link_names} <= set(frames)
        assert "/floor" in nodes(messages, "GridMessage")

    def test_the_floor_has_lines_of_bluish_grey_darker_where_sections_meet(self, both):
        _, messages = recording(both)
        (floor,) = [message["props"] for _, message in messages if message["type"] == "GridMessage"]
        cells, sections = np.array([floor["cell_color"], floor["section_color"]])
        assert (sections < cells).all()
        assert all((np.diff(color) > 0).all() and np.ptp(color) < 30 for color in (cells, sections))

    @pytest.mark.parametrize(("most", "shown"), [(1284, 1280), (321, 320)])
    def test_meshes_of_more_faces_than_a_page_holds_are_simplified(self, tmp_path, monkeypatch, most, shown):
        monkeypatch.setattr(viewer_scene, "MAX_FACES", most)
        content = decoded(rne.view(crane(tmp_path)))
        of_meshes = {m["name"]: m["props"]["faces"] for _, m in content["messages"] if m["type"] == "MeshMessage"}
        of_links = {name: content["binaryBufferLengths"][k["__binary_index"]] / 12 for name, k in of_meshes.items()}
        assert of_links == {"/robot/jib/sphere 1": pytest.approx(shown, abs=2), "/robot/hook/mesh 1": 4}

    def test_the_solid_of_a_flat_body_has_a_thickness(self, tmp_path):
        plate = 'ixx="0.1" iyy="0.2" izz="0.3"'  # I_z = I_x + I_y: all the mass is in the plane of x and y
        robot = crane(tmp_path, text=CRANE.replace('ixx="0.1" iyy="0.1" izz="0.1"', plate))
        _, messages = recording(rne.view(robot))
        solids = {m["name"]: m["props"] for _, m in messages if m["type"] == "IcosphereMessage"}
        half = solids["/solids of the same inertia/jib/solid"]["scale"]
        np.testing.assert_allclose(half[:2], np.sqrt([0.5, 0.25]), rtol=1e-12)
        assert 1e-3 < half[2] < 0.01  # [m], of a crane of more than a metre

    def test_frames_and_masses_are_hidden_unless_asked_for(self, irb140):
        hidden = {"/link frames", "/centres of mass", "/solids of the same inertia"}
        for arguments, expected in (
            ({}, hidden),
            ({"frames": True}, hidden - {"/link frames"}),
            ({"inertia": True}, {"/link frames"}),
        ):
            _, messages = recording(rne.view(irb140, **arguments))
            shown = {m["name"]: m["visible"] for _, m in messages if m["type"] == "SetSceneNodeVisibilityMessage"}
            assert {name for name in hidden if not shown.get(name, True)} == expected

    def test_links_without_shapes_are_lines_that_end_at_the_next_joints(self):
        robot = rne.Robot(random_tree(4, seed=2))
        _, messages = recording(rne.view(robot, q=[0.3, -0.2, 0.5, 0.1]))
        still = motion_argument("still", ([0.0], [[0.3, -0.2, 0.5, 0.1]]))
        posed = placed(robot, still, np.zeros(1))
        parents = robot.model.link_parent
        for k, link in enumerate(robot.link_names):
            assert f"/robot/{link}/lines" in nodes(messages, "LineSegmentsMessage")
            ends = [posed.R[0, k] @ line[1] + posed.p[0, k] for line in link_lines(posed, k) if not line[0].any()]
            children = [child for child, parent in enumerate(parents) if parent == k]
            if children:
                np.testing.assert_allclose(ends, posed.p[0, children], atol=1e-12)
            else:
                np.testing.assert_allclose(ends, posed.centres[0, [posed.carried.index(k)]], atol=1e-12)

    def test_a_sliding_joint_has_a_rail_over_its_motion(self, tmp_path):
        text = re.sub(r"<visual>.*?</visual>", "", CRANE, flags=re.DOTALL)
        q = np.stack([np.zeros(5), [0, -0.2, -0.5, -0.3, -0.1]], axis=1)
        robot = crane(tmp_path, text=text)
        moved = placed(robot, motion_argument("moved", (np.arange(5.0), q)), np.arange(5.0))
        line, rail = link_lines(moved, robot.link_names.index("jib"))
        np.testing.assert_allclose(line, [[0, 0, 0], [0.8, 0, 0]], atol=SINGLE)
        np.testing.assert_allclose(np.sort(rail, axis=0), [[0.8, 0, -0.5], [0.8, 0, 0]], atol=SINGLE)

    def test_arrays_are_interpolated_linearly_and_time_runs_at_the_given_speed(self, irb140):
        q = np.array([np.zeros(6), np.full(6, 0.8)])
        length, messages = recording(rne.view(irb140, q=q, t=[2.0, 3.2], speed=2.0))
        assert length == pytest.approx(0.6 + viewer.HOLD)
        place = state(messages, 0.3)["/robot/link_4"]
        np.testing.assert_allclose(place["position"], irb140.link_poses(q[1] / 2)[4, :3, 3], atol=2e-5)

    def test_up_is_against_gravity(self, irb140):
        for rpy, up in (([np.pi, 0, 0], [0, 0, -1]), ([np.pi / 2, 0, 0], None), ([0.3, -0.5, 0], None)):
            robot = irb140.mounted(rpy)
            R = placed(robot, motion_argument("still", ([0.0], np.zeros((1, 6)))), np.zeros(1)).R[0, 0]
            np.testing.assert_allclose(R @ robot.model.gravity, [0, 0, -9.81], atol=1e-14)
            if up is not None:
                np.testing.assert_allclose(R[:, 2], up, atol=1e-15)

    def test_ellipsoids_have_the_mass_and_inertia_of_their_bodies(self, irb140):
        axes, half = ellipsoids(irb140.model)
        for i in range(irb140.n):
            if half[i].min() > 0:
                squares = half[i] ** 2
                moments = irb140.model.mass[i] / 5 * (squares.sum() - squares)
                rebuilt = axes[i] @ np.diag(moments) @ axes[i].T
                np.testing.assert_allclose(rebuilt, irb140.model.inertia[i], atol=1e-12 * moments.max())
                assert np.linalg.det(axes[i]) == pytest.approx(1.0)
        assert (half[irb140.model.mass > 0].max(axis=-1) > 0).all()

    def test_solids_of_the_irb140_are_the_cylinders_of_its_tables(self, irb140):
        heavy = [link for link in LINKS if link.mass]
        for link, inertia in zip(heavy, irb140.model.inertia[irb140.model.mass > 0], strict=True):
            R, radius, length = cylinder_of(link.mass, inertia)
            np.testing.assert_allclose([radius, length], [link.radius, link.height], rtol=1e-12)
            np.testing.assert_allclose(abs(R[:, 2]), np.eye(3)["xyz".index(link.along)], atol=1e-12)
            assert np.linalg.det(R) == pytest.approx(1.0)
        assert cylinder_of(1.0, np.diag([1.0, 2.0, 2.5])) is None
        assert cylinder_of(1.0, np.diag([0.1, 0.1, 0.2])) is None  # a ring: no length is left

    @pytest.mark.parametrize("aspect", [1.0, 1.6, 0.46, 0.3])
    def test_the_camera_sees_all_points(self, aspect):
        points = np.random.default_rng(0).uniform([-1, -2, 0], [0.5, 1, 3], (200, 3))
        target, away = aim(points)
        moved = aim(points + [5, -3, 2])
        np.testing.assert_allclose(moved, (target + [5, -3, 2], away), rtol=1e-12)  # rounding
        position, side = target + away / min(aspect, 1), away / np.linalg.norm(away)
        right = np.cross([0, 0, 1], side)
        right /= np.linalg.norm(right)
        seen = points - position
        depth = -seen @ side
        assert depth.min() > 0
        assert (np.abs(seen @ right) / depth).max() <= 0.9 * aspect * np.tan(np.radians(38) / 2)
        assert (np.abs(seen @ np.cross(side, right)) / depth).max() <= 0.9 * np.tan(np.radians(38) / 2)

    def test_long_motions_have_fewer_frames(self, irb140):
        for duration, frames in ((1.0, 31), (10.0, 301), (1e4, 10_000 // 8 + 1)):
            t = frame_times([(irb140, motion_argument("slow", ([0.0, duration], np.zeros((2, 6)))))], 1.0)
            assert (len(t), t[0], t[-1]) == (frames, 0.0, duration)

    def test_robots_without_joints_or_gravity(self):
        assert "/floor" in nodes(recording(rne.view(rne.Robot(random_tree(0, seed=1))))[1], "GridMessage")
        floating = rne.load("irb140", gravity=[0, 0, 0])
        assert "/floor" in nodes(recording(rne.view(floating))[1], "GridMessage")


class TestPage:
    def test_it_is_one_small_file_without_addresses(self, both, tmp_path):
        assert len(both.html.encode()) < 2e6
        assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//|url\(\s*[\"']?https?:|@import", both.html)
        file = tmp_path / "swing.html"
        assert both.save(str(file)) == file == both.path
        assert file.read_text(encoding="utf-8") == both.html
        assert repr(both) == f"Page({str(file)!r}, {len(both.html.encode()) / 1e6:.2f} MB)"

    @pytest.mark.long
    def test_long_motions_stay_below_two_megabytes(self, irb140):
        t = np.linspace(0, 600, 3000)
        q = np.sin(np.outer(t, np.arange(1, 7) / 3))
        page = rne.view(irb140, q=q, t=t, other=(t, 0.9 * q))
        assert len(page.html.encode()) < 2e6

    def test_the_legend_says_what_is_shown(self, irb140, both, tmp_path):
        assert re.search(
            r'<div id="rne"><b>irb140</b><br><i style="[^"]*"></i>plain<br><i [^>]*></i>6 kg<br>0.6 s of motion, in real '
            r"time, then a pause of 0.5 s<br>purple: joint axes; squares of the floor: 0.2 m<br><label>",
            both.html,
        )
        assert "<title>irb140</title>" in both.html
        page = rne.view(crane(tmp_path), q=[[0, 0], [1, -0.5]], t=[2, 3], speed=0.5)
        assert "<title>crane &lt;1&gt;</title>" in page.html
        assert (
            "<b>crane &lt;1&gt;</b><br>1 s of motion from t = 2 s, at 0.5 times its speed, then a pause of 0.5 s<br>"
            in page.html
        )

    def test_the_server_is_local_silent_and_stopped(self, irb140, monkeypatch, capfd):
        import viser

        servers = []

        class Watched(viser.ViserServer):
            def __init__(self, *args, **kwargs):
                super().__init__(*args, **kwargs)
                servers.append(self)
                connection = http.client.HTTPConnection("127.0.0.1", self.get_port(), timeout=5)
                connection.request("GET", "/")
                assert connection.getresponse().status == 200
                connection.close()
                with pytest.raises(OSError, match=r"refused|assign"):
                    socket.create_connection(("127.0.0.2", self.get_port()), timeout=5)

        monkeypatch.setattr(viser, "ViserServer", Watched)
        rne.view(irb140)

        def fail(*_, **__):
            raise RuntimeError("stopped half way")

        monkeypatch.setattr(viewer, "build", fail)
        with pytest.raises(RuntimeError, match="stopped half way"):
            rne.view(irb140)
        assert len(servers) == 2
        for server in servers:
            assert server.get_host() == "127.0.0.1"
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection(("127.0.0.1", server.get_port()), timeout=5)
        assert capfd.readouterr() == ("", "")

    def test_in_a_notebook_it_is_a_frame_of_its_own(self, both):
        frame = both._repr_html_()
        assert (
            html.unescape(re.fullmatch(r'<iframe srcdoc="([^"]*)" width="100%"[^>]*></iframe>', frame)[1]) == both.html
        )

    def test_shown_from_a_script_it_opens_in_the_browser(self, irb140, tmp_path, monkeypatch):
        opened = []
        monkeypatch.setattr("webbrowser.open", opened.append)
        monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
        page = rne.view(irb140)
        assert page.path is None
        assert repr(page).startswith("Page(not saved, 0.")
        page.show()
        assert opened == [page.path.as_uri()]
        assert page.path.parent == tmp_path

    @pytest.mark.parametrize("module", ["viser", "trimesh", "fast_simplification"])
    def test_without_its_packages_the_cure_is_named(self, irb140, monkeypatch, module):
        monkeypatch.setitem(sys.modules, module, None)
        text = f"the viewer needs {module}, which is not installed: pip install 'rne[view]'"
        with pytest.raises(ImportError, match=f"^{re.escape(text)}$"):
            rne.view(irb140)

    def test_pages_of_another_viser_are_refused(self, monkeypatch):
        monkeypatch.setattr("rne.plotting.viewer.LIGHT", "lightMode:true")
        text = "this version of viser writes other pages: 'lightMode:true' is missing; pip install 'viser<2'"
        with pytest.raises(RuntimeError, match=f"^{re.escape(text)}$"):
            rne.view(rne.Robot(random_tree(1, seed=0)))


WRONG = {
    "model": (lambda r, s: rne.view(r.model), TypeError, "`robot` must be an rne.Robot or rne.Trajectory, got Model"),
    "q of trajectory": (
        lambda r, s: rne.view(s, q=[0] * 6),
        ValueError,
        "`q` is for a robot; a trajectory has its own",
    ),
    "short q": (lambda r, s: rne.view(r, q=[0] * 5), ValueError, "`q` must have shape (6,), got (5,)"),
    "q without t": (
        lambda r, s: rne.view(r, q=np.zeros((3, 6))),
        ValueError,
        "`q` must have shape (6,), got (3, 6); motions need times `t`",
    ),
    "q and t": (
        lambda r, s: rne.view(r, q=np.zeros((3, 6)), t=[0, 1]),
        ValueError,
        "`q` must have shape (2, n), got (3, 6)",
    ),
    "t and no q": (
        lambda r, s: rne.view(r, t=[0, 1]),
        ValueError,
        "`q` must have shape (2, n), got (6,)",
    ),
    "no times": (
        lambda r, s: rne.view(r, q=np.zeros((0, 6)), t=[]),
        ValueError,
        "`q` must have at least one sample, got none",
    ),
    "few joints": (
        lambda r, s: rne.view(r, q=np.zeros((2, 5)), t=[0, 1]),
        ValueError,
        "`q` must have 6 joints as robot 'irb140' has, got 5",
    ),
    "t back": (
        lambda r, s: rne.view(r, q=np.zeros((3, 6)), t=[0, 2, 1]),
        ValueError,
        "`t` must be ascending times, got 1 s after 2 s",
    ),
    "t nan": (
        lambda r, s: rne.view(r, q=np.zeros((2, 6)), t=[0, np.nan]),
        ValueError,
        "`t` must be finite, got nan at index (1,)",
    ),
    "t flat": (
        lambda r, s: rne.view(r, q=np.zeros((2, 6)), t=3.0),
        ValueError,
        "`t` must be times of shape (T,), got ()",
    ),
    "no samples": (
        lambda r, s: rne.view(dataclasses.replace(s, t=s.t[:0])),
        ValueError,
        "`robot` must have at least one sample, got none",
    ),
    "no model": (
        lambda r, s: rne.view(dataclasses.replace(s, model=None)),
        ValueError,
        "this trajectory has no model: give it one by dataclasses.replace(trajectory, model=...)",
    ),
    "other robot": (
        lambda r, s: rne.view(rne.Robot(random_tree(2, seed=1)), other=dataclasses.replace(s, model=None)),
        ValueError,
        "`other` must have 2 joints as robot 'tree2-1' has, got 6",
    ),
    "other type": (
        lambda r, s: rne.view(r, other=r),
        TypeError,
        "`other` must be an rne.Trajectory, positions or a tuple (t, q), got Robot",
    ),
    "other q": (
        lambda r, s: rne.view(r, other=([0, 1], np.zeros((2, 5)))),
        ValueError,
        "`other` must have 6 joints as robot 'irb140' has, got 5",
    ),
    "labels": (lambda r, s: rne.view(s, labels="ab"), ValueError, "`labels` must be two str, got 'ab'"),
    "speed": (lambda r, s: rne.view(s, speed=0), ValueError, "`speed` must be positive, got 0.0"),
    "path type": (lambda r, s: rne.view(s, 3), TypeError, "`path` must be a str or path-like, got int"),
    "path name": (lambda r, s: rne.view(s, "a.gif"), ValueError, "`path` must end in .html, got 'a.gif'"),
    "folder": (
        lambda r, s: rne.view(s, "films/a.html"),
        FileNotFoundError,
        "`path` must be in an existing folder, got 'films/a.html'",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_calls_are_refused_by_name(irb140, swing, case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call, error, text = WRONG[case]
    with pytest.raises(error, match=f"^{re.escape(text)}$"):
        call(irb140, swing)
    assert not list(tmp_path.iterdir())


class TestCommand:
    def test_a_robot_and_its_motions(self, swing, loaded, tmp_path, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        swing.save("plain.npz")
        loaded.save("heavy.npz")
        assert main(["view", "irb140", "--motion", "plain.npz", "--other", "heavy.npz", "--inertia"]) == 0
        assert re.fullmatch(r"irb140\.html: 0\.\d\d MB\n", capsys.readouterr().out)
        text = (tmp_path / "irb140.html").read_text(encoding="utf-8")
        assert "plain<br>" in text
        assert "heavy<br>" in text

    def test_a_motion_in_a_table(self, irb140, loaded, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        loaded.to_csv("measured.csv")
        assert main(["view", "irb140", "--motion", "measured.csv", "--out", "page.html"]) == 0
        data = re.search(r'__VISER_EMBED_DATA__="[^"]*"', (tmp_path / "page.html").read_text(encoding="utf-8"))[0]
        expected = recording(rne.view(irb140, q=loaded.q, t=loaded.t))
        assert recording(SimpleNamespace(html=data)) == expected

    def test_lost_shapes_are_told(self, tmp_path, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        crane(tmp_path, "none.stl")
        assert main(["view", "crane/urdf/crane.urdf"]) == 0
        got = capsys.readouterr()
        assert got.err.startswith("warning: robot 'crane <1>': visual shapes are not shown: link 'hook'")
        assert got.out.startswith("crane.html: 0.")

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (["--speed", "0"], "--speed must be positive, got 0.0"),
            (["--out", "a.gif"], "--out: must end in .html or .htm, got 'a.gif'"),
            (["--motion", "a.txt"], "a.txt: a motion must be a file ending in .npz or .csv"),
            (["--motion", "none.npz"], "none.npz: No such file or directory"),
            (
                ["--motion", "rates.csv"],
                "rates.csv: there are no positions; the first row must be t,q.joint_1,q.joint_2,q.joint_3,q.joint_4,"
                "q.joint_5,q.joint_6, with qd. and qdd. of the joints if they are known",
            ),
            (["--motion", "tree.npz"], "tree.npz: robot 'irb140' has 6 joints, the motion 2"),
            (
                ["--motion", "others.npz"],
                "others.npz: the motion is of joints ['a', 'b', 'c', 'd', 'e', 'f'], the robot has ['joint_1', 'joint_2', "
                "'joint_3', 'joint_4', 'joint_5', 'joint_6']",
            ),
        ],
    )
    def test_wrong_calls_end_in_one_line(self, loaded, tmp_path, monkeypatch, capsys, words, message):
        monkeypatch.chdir(tmp_path)
        if "others.npz" in words:
            names = dict(zip(loaded.model.moving_joints, "abcdef", strict=True))
            links = tuple(names.get(joint, joint) for joint in loaded.model.link_joints)
            model = dataclasses.replace(loaded.model, moving_joints=tuple("abcdef"), link_joints=links)
            dataclasses.replace(loaded, model=model).save("others.npz")
        if "tree.npz" in words:
            rne.simulate(rne.Robot(random_tree(2, seed=1)), [0, 0], [0, 0], 0.1).save("tree.npz")
        (tmp_path / "rates.csv").write_text("t\n0\n1\n")
        assert main(["view", "irb140", *words]) == 2
        assert capsys.readouterr() == ("", f"error: {message}\n")
        assert not list(tmp_path.glob("*.html"))


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
GRAPHICS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
PATIENCE = 120_000  # [ms]; software draws slowly where other programs run


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed: apt-get install chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=GRAPHICS)
        yield opened
        opened.close()


class Tab:
    """A page in the browser, without network; `addresses` are what it asked for."""

    def __init__(self, browser, file, width=400, height=320):
        self.tab = browser.new_page(viewport={"width": width, "height": height})
        self.tab.set_default_timeout(PATIENCE)
        self.addresses, self.errors = [], []
        self.tab.on("request", lambda request: self.addresses.append(request.url))
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        self.tab.goto(file.as_uri())
        self.tab.wait_for_selector("canvas")

    def pause(self):
        self.tab.wait_for_selector(".mantine-Slider-track")
        self.tab.keyboard.press("Space")
        self.tab.wait_for_timeout(500)

    def slide_to(self, share):
        box = self.tab.locator(".mantine-Slider-track").first.bounding_box()
        self.tab.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
        self.tab.mouse.move(5, 5)

    def picture(self):
        """The view without the bar, when it rests: two pictures are the same."""
        before = None
        for _ in range(60):
            data = self.tab.screenshot(timeout=PATIENCE)
            if data == before:
                break
            before = data
            self.tab.wait_for_timeout(300)
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))[: -45 if self.has_bar() else None].astype(int)

    def has_bar(self):
        return self.tab.locator(".mantine-Slider-track").first.is_visible()


def warm(picture):
    """Share of pixels with much more red than blue, as only the other motion has it here."""
    return (picture[..., 0] - picture[..., 2] > 25).mean()


def teal(picture):
    """Share of pixels with much more green than red, as only the masses have it."""
    return (picture[..., 1] - picture[..., 0] > 40).mean()


def saturated(picture):
    """Share of pixels that are clearly coloured, unlike background, floor and shadows."""
    return (np.ptp(picture, axis=-1) > 35).mean()


@pytest.mark.long
def test_a_browser_shows_the_motion_without_network(browser, both, tmp_path):
    both.save(tmp_path / "swing.html")
    tab = Tab(browser, tmp_path / "swing.html")
    tab.pause()
    tab.slide_to(0.25)
    early = tab.picture()
    tab.slide_to(0.7)
    late = tab.picture()
    assert saturated(early) > 0.02
    assert (np.abs(early - late).max(axis=-1) > 40).mean() > 0.02
    assert warm(late) > 0.005
    tab.tab.locator("#masses").check()
    tab.tab.wait_for_timeout(1000)
    weights = tab.picture()
    assert teal(weights) > 0.01 > 0.001 > max(teal(late), warm(weights))
    tab.tab.locator("#masses").uncheck()
    tab.tab.wait_for_timeout(1000)
    assert teal(tab.picture()) < 0.001
    assert tab.addresses
    assert all(address.startswith(("file:", "data:", "blob:")) for address in tab.addresses)
    assert tab.errors == []


@pytest.mark.long
def test_a_narrow_window_shows_all_of_a_robot(browser, irb140, tmp_path):
    page = rne.view(irb140, tmp_path / "still.html", q=[0.3, 0.4, -0.2, 0, 0.5, 0])
    tab = Tab(browser, page.path, 390, 700)
    tab.tab.wait_for_timeout(1500)
    picture = tab.picture()
    assert saturated(picture) > 0.02
    assert warm(picture) < 0.001
    _, columns = np.nonzero(np.ptp(picture, axis=-1) > 35)
    assert columns.min() > 5
    assert columns.max() < 384  # a narrow window sees all of it
    assert tab.errors == []


@pytest.mark.long
def test_the_speed_can_be_read_and_the_page_is_as_dark_as_the_browsers(browser, both, tmp_path):
    page = both.save(tmp_path / "swing.html")
    for scheme in ("light", "dark"):
        tab = browser.new_page(viewport={"width": 390, "height": 500}, color_scheme=scheme)
        tab.goto(page.as_uri())
        tab.wait_for_selector("canvas[data-engine]", timeout=PATIENCE)
        assert (
            tab.evaluate("(x => x.scrollWidth - x.clientWidth)(document.querySelector('.mantine-Select-input'))") <= 0
        )
        assert tab.evaluate("document.documentElement.dataset.mantineColorScheme") == scheme
