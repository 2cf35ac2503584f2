"""What consoles and notebooks show of the package's objects: a few lines, and HTML that is well formed."""

import base64
import dataclasses
import importlib.util
import io
import re

import numpy as np
import pytest
from lxml import etree
from PIL import Image

import rne
from rne.plotting import notebook

from .helpers import kept, loaded
from .random_robots import random_tree, straight_chain

ROBOTS = {
    "two links": lambda: rne.Robot(straight_chain(2)),
    "irb140": lambda: loaded("irb140"),
    "chain of 30": lambda: rne.Robot(straight_chain(30)),
}
HOSTILE = "<b>&\"'</td><script>"


@pytest.fixture(scope="module", params=kept(ROBOTS, list(ROBOTS)[:1]))
def robot(request):
    return ROBOTS[request.param]()


@pytest.fixture(scope="module")
def motion(robot):
    """A motion of 50 ms under a torque that is held."""
    return rne.simulate(robot, np.full(robot.n, 0.1), np.zeros(robot.n), 0.05, torque=np.ones(robot.n))


@pytest.fixture(scope="module")
def motion_html(motion):
    """With pictures of few pixels, as wide on the page as fine ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(notebook, "DPI", 50)
        return motion._repr_html_()


@pytest.fixture(scope="module")
def robot_html(robot):
    return robot._repr_html_()


def objects(robot, motion):
    """Public objects that a user may leave on the last line of a notebook's cell."""
    n = robot.n
    z, ones = np.zeros(n), np.ones(n)
    law, path = rne.control.pd_gravity(robot, 50 * ones, 20 * ones, z), rne.trajectories.quintic(z, ones, 2.0)
    friction = rne.Friction(viscous=np.arange(n) + 1.0, coulomb=2.0)
    payload = rne.Payload(2.0, com=np.zeros(3), inertia=0.1 * np.eye(3))
    with np.errstate(all="ignore"):
        gains = rne.check_gains(robot, 50 * ones, 20 * ones) if n < 10 else None
    return [
        robot,
        robot.model,
        motion,
        rne.ensemble(robot, np.zeros((5, n)), np.zeros((5, n)), 0.01, step=0.005),
        robot.recursion(z, z, z),
        robot.recursion(np.zeros((4, n)), np.zeros((4, n)), np.zeros((4, n))),
        robot.kernel(rne.dynamics.mass_matrix),
        robot.kernel(rne.dynamics.inverse_dynamics, "q", "qd"),
        robot.diagnose(np.zeros((3, n))),
        robot.base_parameters(),
        rne.bearing_peaks(robot, motion),
        law,
        rne.control.pd(robot, np.arange(n) + 1.0, 20 * ones, z),
        rne.control.pid(robot, 50 * ones, ones, ones, z, windup=3.0),
        rne.control.computed_torque(robot, 50 * ones, ones, path),
        rne.control.computed_torque(robot, 50 * ones, ones, lambda t: (z, z, z)),
        path,
        rne.trajectories.trapezoidal(z, ones, 2.0, 0.5),
        friction,
        payload,
        rne.Scene(robot, payload=payload, friction=friction, controller=law, sample_time=0.01, effort_limit=list(ones)),
        *dataclasses.replace(motion, q=100 * motion.q).check_limits()[:1],
        *([gains] if gains else []),
    ]


def test_reprs_are_a_few_lines_that_name_the_class(robot, motion):
    for thing in objects(robot, motion):
        lines = repr(thing).splitlines()
        assert len(lines) <= 6, repr(thing)
        assert max(map(len, lines)) <= 120, repr(thing)
        assert lines[0].startswith(type(thing).__name__)
        assert "array(" not in repr(thing) or isinstance(thing, rne.Payload | rne.Scene)  # three by three at most


def test_reprs_of_findings_and_violations_are_short():
    finding = rne.Finding("warning", "a/" * 200 + "arm.urdf", 12, "link_1", "x" * 500, "y" * 500)
    lines = repr(finding).splitlines()
    assert lines[0].startswith("Finding(severity='warning', file='a/a/")
    assert len(lines) <= 6
    assert max(map(len, lines)) <= 120


def test_names_of_any_length_do_not_lengthen_a_repr():
    model = straight_chain(3)
    model = dataclasses.replace(model, name="r" * 500, link_names=tuple(f"{k}" * 400 for k in range(4)))
    robot = rne.Robot(model)
    z = np.zeros(3)
    for thing in (
        robot,
        model,
        robot.kernel(rne.dynamics.mass_matrix),
        rne.simulate(robot, z, z, 0.01),
        robot.recursion(z, z, z),
    ):
        assert max(map(len, repr(thing).splitlines())) <= 120


def test_the_repr_of_a_motion_says_what_happened(irb140):
    swing = rne.simulate(irb140, [0] * 6, [0] * 6, 0.1)
    first, second, *_, last = repr(swing).splitlines()
    assert (
        first
        == f"Trajectory of 'irb140': 6 joints, 0 to 0.1 s, {len(swing.t)} samples, DOP853, {swing.evaluations} evaluations"
    )
    assert second.startswith("  status 0: DOP853: not stiff")
    assert last == f"  energy 370.877 to 370.877 J, largest energy error {swing.energy_drift:.2g} J"
    later = str(rne.simulate(irb140, [0] * 6, [0] * 6, 0.5)).splitlines()
    assert later[-1] == "  limits exceeded, see check_limits(): joint_3 (velocity)"


def test_the_repr_of_a_law_shows_few_numbers_and_counts_many():
    robot = rne.Robot(straight_chain(30))
    law = rne.control.pd(robot, np.arange(30) + 1.0, np.full(30, 20.0), np.zeros(30))
    assert " ".join(repr(law).split()) == (
        "PD(robot=Robot 'chain30', kp=<30 numbers, 1 to 30>, kd=<30 numbers, all 20>, reference=<30 numbers, all 0>, "
        "gravity=0)"
    )
    assert repr(rne.trajectories.quintic([0.0], [1.5], 2.0)) == "Quintic(start=[0], end=[1.5], duration=2)"
    assert repr(rne.Friction(viscous=2.0, coulomb=[1.0, 2.0])) == "Friction(viscous=2, coulomb=[1, 2])"


def test_printing_a_recursion_keeps_the_whole_table(irb140):
    record = irb140.recursion([0] * 6, [1] * 6, [0] * 6)
    assert len(repr(record).splitlines()) == 2
    assert len(str(record).splitlines()) > 40


def parsed(html):
    """The fragment as XML: strict, so that nothing is left open and nothing is named twice."""
    return etree.fromstring(html.encode())


def shown(element):
    return " ".join(element.itertext())


def rows(table):
    return [[shown(cell) for cell in row] for row in table.iter("tr")]


def pictures(page):
    prefix = "data:image/png;base64,"
    for image in page.iter("img"):
        assert image.get("src").startswith(prefix)
        yield Image.open(io.BytesIO(base64.b64decode(image.get("src")[len(prefix) :])))


def test_pages_are_well_formed_and_fit_light_dark_and_narrow_notebooks(robot, robot_html, motion_html):
    for text in (robot_html, motion_html):
        page = parsed(text)
        assert not list(page.iter("script", "style", "link"))
        assert not re.search(r"(?:https?:)?//", "".join(x for e in page.iter() for k, x in e.items() if k != "src"))
        for element in page.iter():
            style = element.get("style", "")
            assert not re.search(r"(?<![-\w])(?:color|background)[-\w]*:", style)  # those of the notebook
            assert element.tag != "img" or "max-width:100%" in style
            assert element.tag not in ("table", "pre") or "overflow-x:auto" in element.getparent().get("style")


@pytest.mark.parametrize("robot", ["irb140"], indirect=True)
def test_robot_page_shows_it_with_its_joints_and_bodies(irb140, robot_html):
    page = parsed(robot_html)
    (picture,) = pictures(page)
    assert min(picture.size) > 500
    assert len(picture.getcolors()) > 100
    joints, bodies = page.iter("table")
    assert rows(joints)[:2] == [
        ["joint", "type", "parent → child", "range", "speed", "effort"],
        ["joint_1", "revolute", "base_link → link_1", "-3.142 to 3.142 rad", "3.491 rad/s", "not given"],
    ]
    assert rows(joints)[-1] == ["flange", "fixed, does not move", "link_6 → tool0", "-", "-", "-"]
    assert rows(bodies)[2][:3] == ["link_1", "27", "0.014, -0.264, 0.067"]
    assert sum(float(row[1]) for row in rows(bodies)[2:]) == irb140.model.mass.sum()


def test_robot_page_gives_sliding_and_mimicking_joints_their_units():
    model = random_tree(5, seed=6, mimics=3)
    (joints, _) = parsed(rne.Robot(model)._repr_html_()).iter("table")
    by_name = {row[0]: row for row in rows(joints)[1:]}
    for k, (joint, kind) in enumerate(zip(model.moving_joints, model.joint_types, strict=True)):
        row = by_name[joint]
        assert row[1].split(",")[0] == kind
        assert (", mimics " in row[1]) == (k not in model.independent_joints)
        unit = "m" if kind == "prismatic" else "rad"
        assert row[3].endswith(f" {unit}") or row[3] in ("not given", "unlimited")
    assert {kind for kind in model.joint_types} >= {"prismatic", "revolute"}


@pytest.mark.parametrize("robot", ["two links"], indirect=True)
def test_motion_page_has_a_picture_for_each_quantity_and_the_solver_message(motion, motion_html):
    page = parsed(motion_html)
    labels = [image.get("alt") for image in page.iter("img")]
    assert labels == ["position [rad]", "velocity [rad/s]", "torque [N m]", "energy [J]", "energy error [J]"]
    assert motion.message in shown(page)
    assert all(len(picture.getcolors()) > 20 for picture in pictures(page))
    assert {picture.width for picture in pictures(page)} == {245}  # of 50 pixels for each of 4.9 inches
    assert {image.get("width") for image in page.iter("img")} == {"490"}


def test_motion_page_of_a_failed_run_without_samples(irb140):
    motion = rne.simulate(irb140, [0] * 6, [0] * 6, 0.01)
    arrays = {f.name: getattr(motion, f.name) for f in dataclasses.fields(motion)}
    empty = dataclasses.replace(
        motion, **{k: v[:0] for k, v in arrays.items() if isinstance(v, np.ndarray)}, status=-1, message=HOSTILE
    )
    page = parsed(empty._repr_html_())
    assert not list(page.iter("img"))
    assert HOSTILE in shown(page)


def test_names_that_are_html_are_shown_as_text(monkeypatch):
    monkeypatch.setattr(notebook, "DPI", 20)
    every_plot = notebook.small_plots
    monkeypatch.setattr(notebook, "small_plots", lambda motion: list(every_plot(motion))[:1])
    model = straight_chain(2)
    model = dataclasses.replace(
        model, name=HOSTILE, moving_joints=(f"{HOSTILE}0", "joint1"), link_joints=("", f"{HOSTILE}0", "joint1")
    )
    robot = rne.Robot(model)
    z = [0.0] * 2
    for thing in (robot, rne.simulate(robot, z, z, 0.01)):
        page = parsed(thing._repr_html_())
        assert not list(page.iter("b", "script"))
        assert HOSTILE[:10] in shown(page).replace("\\", "")


def test_without_matplotlib_the_tables_remain(irb140, motion, monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "matplotlib" else found(name, *a))
    page = parsed(irb140._repr_html_())
    assert (len(list(page.iter("img"))), len(list(page.iter("table")))) == (0, 2)
    page = parsed(motion._repr_html_())
    assert not list(page.iter("img"))
    assert "status 0" in shown(page)


def test_jupyter_finds_the_pages_by_their_method(irb140):
    """IPython asks the class for `_repr_html_`; objects without a page answer None and are shown as text."""
    loads = rne.identification.PayloadEstimate, rne.identification.DriveGains
    for cls in (rne.Robot, rne.Trajectory, rne.Identification, rne.Excitation, *loads):
        assert callable(cls._repr_html_)
    for thing in (rne.Scene(irb140), irb140.recursion(*np.zeros((3, 6))), irb140.kernel(rne.dynamics.mass_matrix)):
        assert not hasattr(thing, "_repr_html_")  # shown by their repr, and printed in full by `print`


def test_results_show_in_notebooks_what_print_shows(two, irb140):
    arm = two.with_limits(effort=[50, 20])
    motion = rne.trajectories.fastest(arm, [[0, 0], [1, 0.5]])
    compared = rne.compare_models(two, two.with_payload(0.5))
    gains = rne.check_gains(two, 50, 20)
    for thing in (gains, compared, motion, rne.drives(arm, motion), irb140.diagnose([0] * 6)):
        (text,) = parsed(thing._repr_html_()).iter("pre")
        assert text.text == str(thing)
    assert str(gains).startswith("fastest mode M^-1 Kd ")
    assert str(motion).startswith("Fastest motion along the path: ")
    assert str(compared) == compared.report()
    assert str(irb140) == repr(irb140)


def test_ensembles_and_excitations_show_their_repr(irb140):
    pair = np.stack([irb140.parameters, irb140.parameters])
    pair[1, -10] = -0.1  # a mass
    motions = rne.ensemble(irb140, np.zeros((2, 6)), np.zeros((2, 6)), 0.01, step=0.01, parameters=pair)
    said = shown(parsed(motions._repr_html_()))
    assert "no energies recorded" in said
    assert "robots with a negative mass: 1" in said
