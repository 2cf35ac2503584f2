"""The command line."""

import itertools
import os
import re
import shutil
import subprocess
import sys
import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import examples.thesis.__main__ as thesis
import rne
from rne.__main__ import main, parser
from rne.commands import pages
from rne.commands.agreement import against_energies, against_pinocchio, random_states, validate
from rne.commands.pages import Measured, plot_speed, speed_table
from rne.commands.shared import work
from rne.plotting.html_page import Report

from .helpers import ROOT

IRB140 = str(ROOT / "robots" / "irb140.urdf")


@pytest.fixture
def unused(monkeypatch):
    """No page is made: a wrong folder is refused before anything is computed."""
    for run in (
        "rne.commands.pages.write_main_page",
        "rne.commands.pages.write_robot_page",
        "examples.thesis.__main__.run",
    ):
        monkeypatch.setattr(run, lambda *_: pytest.fail("the page was made"))


def test_check_of_a_sound_file(capsys):
    assert main(["check", str(ROOT / "robots" / "irb140.urdf")]) == 0
    assert capsys.readouterr().out.endswith("irb140.urdf: no findings\n")


def test_check_of_a_broken_file(tmp_path, capsys):
    path = tmp_path / "broken.urdf"
    path.write_text("<robot>")
    assert main(["check", str(path)]) == 1
    assert capsys.readouterr().out.startswith(f"error: {path}:1: file: is not well-formed XML")


def test_check_of_no_file(tmp_path, capsys):
    assert main(["check", str(tmp_path / "none.urdf")]) == 2
    message = f"error: {str(tmp_path / 'none.urdf')!r} is neither a file nor one of rne.robots()\n"
    assert capsys.readouterr().err == message


def test_check_of_several_files_looks_at_all_of_them(tmp_path, capsys):
    broken = tmp_path / "broken.urdf"
    broken.write_text("<robot>")
    assert main(["check", str(broken), IRB140]) == 1
    assert capsys.readouterr().out.endswith("irb140.urdf: no findings\n")
    assert main(["check", str(tmp_path / "none.urdf"), str(broken), IRB140]) == 2
    said = capsys.readouterr()
    assert "none.urdf' is neither a file" in said.err
    assert "is not well-formed XML" in said.out
    assert said.out.endswith("irb140.urdf: no findings\n")


def test_urdf_prints_the_file(capsys):
    assert main(["urdf", "irb140"]) == 0
    assert capsys.readouterr().out == (ROOT / "robots" / "irb140.urdf").read_text()


def test_urdf_of_an_unknown_robot(capsys):
    assert main(["urdf", "irb"]) == 2
    assert capsys.readouterr().err == "error: 'irb' is neither a file nor one of rne.robots(); did you mean 'irb140'?\n"


def test_source_prints_a_quantity(capsys):
    assert main(["source", "irb140", "--quantity", "gravity_torque", "--language", "c"]) == 0
    assert "void gravity_torque(const double *q, double *result)" in capsys.readouterr().out


def test_source_of_a_robot_with_a_payload_is_that_of_the_loaded_robot(tmp_path, capsys):
    """As `rne torques` takes it; the comment at the head names it, for whoever reads the file alone."""
    payload = ["--payload", "2", "--payload-com", "0.05", "0", "0.1"]
    options = ["--quantity", "gravity_torque", "--language", "python"]
    assert main(["source", "irb140", *payload, *options]) == 0
    text, names = capsys.readouterr().out, {}
    assert text.splitlines()[1] == "# Payload - 2 kg at 0.05 0 0.1 m of tool0"
    exec(text, names)
    q, robot = [0.1, 0.5, -0.3, 0.2, 0.4, 0.1], rne.load("irb140")
    found, rounding = np.ravel(names["gravity_torque"](q)), 1e-12
    loaded, empty = robot.with_payload(2.0, [0.05, 0.0, 0.1]).gravity_torque(q), robot.gravity_torque(q)
    np.testing.assert_allclose(found, loaded, atol=rounding)
    assert abs(loaded - empty).max() > 1
    named, inertia = tmp_path / "arm.urdf", "0.01 0.02 0.015 0 0 -0.001"
    named.write_text(rne.to_urdf(replace(robot.model, name="a" * 100)))
    for language, end in (("c", " */"), ("matlab", "")):
        options = ["--quantity", "gravity_torque", "--language", language, "--payload-inertia", inertia]
        assert main(["source", str(named), *payload, *options]) == 0
        line = f" Payload - 2 kg at 0.05 0 0.1 m of tool0 with inertia {inertia} kg m^2{end}"
        assert sum(x.endswith(line) for x in capsys.readouterr().out.splitlines()) == 1
    assert main(["source", "ur5", *payload]) == 2
    assert "choose one by --payload-link" in capsys.readouterr().err
    assert main(["source", "irb140", "--payload-com", "0", "0", "0.1"]) == 2
    assert capsys.readouterr().err == "error: --payload-com: needs --payload\n"


def test_source_of_no_robot(capsys):
    assert main(["source", "irb"]) == 2
    assert capsys.readouterr().err == "error: 'irb' is neither a file nor one of rne.robots(); did you mean 'irb140'?\n"


def test_every_quantity_of_joint_arrays_alone_can_be_printed(capsys):
    with pytest.raises(SystemExit):
        main(["source", "--help"])
    choices = capsys.readouterr().out.rpartition("--quantity QUANTITY")[2].partition("(default")[0]
    listed = set(re.findall(r"\w+", choices))
    assert {"inverse_dynamics", "mass_matrix", "forward_dynamics", "link_poses", "momentum"} <= listed
    assert not {"recursion", "jacobian", "load"} & listed  # a record, needs a link, no quantity


def test_version(capsys):
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["--version"])
    assert capsys.readouterr().out == f"rne {rne.__version__}\n"


@pytest.mark.parametrize("command", [[], ["report", "irb140"]])
def test_out_on_a_file_is_refused_in_one_line(command, unused, tmp_path, capsys):
    file = tmp_path / "file"
    file.touch()
    for folder in (file, file / "below"):
        assert main([*command, "--out", str(folder)]) == 2
        assert capsys.readouterr().err == f"error: --out: cannot write into {str(folder)!r}: Not a directory\n"


@pytest.mark.parametrize("command", [[], ["report", "irb140"]])
def test_out_in_a_place_without_permission_is_refused_in_one_line(command, unused, tmp_path, capsys, monkeypatch):
    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)  # the owner root may write anywhere
    assert main([*command, "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"error: --out: cannot write into {str(tmp_path)!r}: Permission denied\n"


@pytest.mark.parametrize("order", [["--out", "{}", "report", "irb140"], ["report", "irb140", "--out", "{}"]])
def test_out_stands_before_or_after_the_command(order, tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(
        "rne.commands.pages.write_robot_page", lambda robot, text, folder, say: seen.append(folder) or 1
    )
    assert main([word.format(tmp_path / "page") for word in order]) == 0
    assert seen == [tmp_path / "page"]


def test_page_of_the_experiments_makes_no_folders(unused, tmp_path, capsys, monkeypatch):
    def refused(markdown):
        monkeypatch.setattr(
            sys, "argv", ["examples.thesis", "--out", str(tmp_path / "page"), "--markdown", str(markdown)]
        )
        assert thesis.main() == 2
        assert not list(tmp_path.iterdir())
        return capsys.readouterr().err

    target = tmp_path / "docs" / "thesis.md"
    assert refused(target) == f"error: --markdown: there is no folder {str(target.parent)!r}\n"
    assert refused(tmp_path) == f"error: --markdown: {str(tmp_path)!r} is a folder, not a file\n"


def test_an_error_of_the_system_is_one_line(tmp_path, monkeypatch, capsys):
    def fail(*_):
        raise OSError(28, "No space left on device", "page/index.html")

    monkeypatch.setattr("rne.commands.pages.write_main_page", fail)
    assert main(["--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == "error: page/index.html: No space left on device\n"


def test_ctrl_c_leaves_the_motion_so_far(tmp_path, monkeypatch, capsys):
    def interrupt(t, duration):
        if t > 0.05:
            raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(work, "progress", interrupt)
    assert main(["simulate", "irb140", "--duration", "1", "--method", "RK45", "--out", "m.csv"]) == 130
    end = np.loadtxt("m.csv", delimiter=",", skiprows=1)[-1, 0]
    assert 0.05 < end < 1
    assert capsys.readouterr().err == f"interrupted: the motion up to t = {end:.4g} s is in m.csv\n"


def test_what_takes_long_is_said_with_its_time(capsys):
    """After two seconds without output: what is computed, for how long and, if it is known, for how much longer."""
    now = [0.0]
    step = type(work)(lambda: now[0])
    step.begin("fitting 3 models to 12 records")
    for now[0] in (1.9, 4.0, 5.9, 8.0):
        step.tell()
        if now[0] == 5.9:
            step.progress(1.0, 4.0)
    now[0] = 9.0
    step.begin("drawing the page")
    now[0] = 10.9
    step.tell()
    step.end()
    assert capsys.readouterr().err.splitlines() == [
        "  fitting 3 models to 12 records ... 4 s",
        "  fitting 3 models to 12 records, 25% done, about 24 s left ... 8 s",
        "  fitting 3 models to 12 records: took 9 s",
    ]


def test_a_line_that_is_printed_counts_as_output(tmp_path, monkeypatch, capsys):
    """Progress waits two seconds from then on, not from the beginning of the step."""
    clock = itertools.count(0, 1e-6)
    monkeypatch.setattr(work, "clock", lambda: next(clock))
    assert main(["simulate", "irb140", "--duration", "0.01", "--out", str(tmp_path / "m.npz")]) == 0
    assert work.said > work.begun


def test_progress_is_said_while_a_command_runs(monkeypatch):
    """By a thread, under a clock on which every look is ten seconds later; the command waits until it had its turn."""
    said, had_its_turn, clock = [], threading.Event(), itertools.count(0, 10)
    monkeypatch.setattr(work, "pause", 0.01)
    monkeypatch.setattr(work, "clock", lambda: next(clock))

    def note(line):  # the step before may be told too, if the thread is the first
        if "simulating" in line:
            said.append(line)
            had_its_turn.set()

    monkeypatch.setattr("rne.commands.shared.note", note)
    with work.reported():
        work.begin("simulating")
        assert had_its_turn.wait(600)
    assert re.fullmatch(r"  simulating \.\.\. \d+ s", said[0])
    assert re.fullmatch(r"  simulating: took \d+ s", said[-1])
    before = len(said)
    work.end()
    assert len(said) == before


@pytest.mark.parametrize(
    ("words", "steps"),
    [
        (["check", "irb140"], ["checking irb140"]),
        (["source", "irb140"], ["deriving inverse_dynamics of irb140 and writing it in python"]),
        (
            ["simulate", "irb140", "--duration", "0.01", "--out", "m.npz"],
            ["simulating 0.01 s of motion", "computing torques and energies, and writing the file"],
        ),
        (
            ["compare", "irb140", "irb140"],
            ["searching the cause by which torques of irb140 differ from those of irb140"],
        ),
    ],
)
def test_steps_of_commands_say_what_they_compute(words, steps, tmp_path, monkeypatch, capsys):
    found, begin = [], work.begin
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(work, "begin", lambda what: found.append(what) or begin(what))
    assert main(words) == 0
    assert found == ["reading the robot", *steps]


@pytest.mark.parametrize(("argv0", "name"), [("/usr/lib/rne/__main__.py", "python -m rne"), ("/usr/bin/rne", "rne")])
def test_usage_names_the_program_as_it_was_called(argv0, name, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [argv0])
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["--help"])
    assert capsys.readouterr().out.startswith(f"usage: {name} [")


def test_every_argument_of_every_command_is_explained():
    (commands,) = (action for action in parser()._actions if isinstance(action.choices, dict))
    unexplained = [
        (name, action.dest)
        for name, command in commands.choices.items()
        for action in command._actions
        if not action.help
    ]
    assert unexplained == []


def test_pipes_are_utf8_whatever_the_locale_says(tmp_path):
    """On Windows they are not by default, and a URDF file or a source would be written in another encoding."""
    (tmp_path / "arm.urdf").write_text('<robot name="Älskling"><link name="κ"/></robot>', encoding="utf-8")
    command = [sys.executable, "-m", "rne", "urdf", "arm.urdf"]
    environment = os.environ | {"PYTHONIOENCODING": "cp1252"}
    run = subprocess.run(command, capture_output=True, cwd=tmp_path, env=environment, check=False)
    assert (run.returncode, run.stderr) == (0, b"")
    assert '<link name="κ"/>' in run.stdout.decode("utf-8")


def test_output_that_nobody_reads_is_no_error(tmp_path):
    """Such as `rne source irb140 | head`."""
    code = f"{sys.executable} -m rne urdf irb140 | true; exit ${{PIPESTATUS[0]}}"
    run = subprocess.run(["bash", "-c", code], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert (run.returncode, run.stderr) == (1, "")


def test_a_reader_that_is_gone_before_a_short_output_is_noticed(monkeypatch):
    """Which waits in the buffer until it is flushed."""
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as gone:
        monkeypatch.setattr(sys, "stdout", gone)
        assert main(["check", IRB140]) == 1


def test_carried_mass_is_that_of_everything_beyond_the_joint(tree):
    def carried_by(joint):
        beyond = (k for k in range(tree.nb) if tree.parent[k] == joint)
        return tree.mass[joint] + sum(map(carried_by, beyond))

    np.testing.assert_allclose(pages.carried_masses(tree), [carried_by(i) for i in range(tree.nb)], rtol=1e-14)


def test_validation_keeps_every_bound_against_pinocchio(irb140):
    source, rows = validate(irb140, samples=50)
    assert source.startswith("Pinocchio")
    assert "forward dynamics" in {row.quantity for row in rows}
    assert all(row.worst <= row.bound for row in rows)


def test_validation_without_pinocchio_keeps_every_bound(irb140, monkeypatch):
    monkeypatch.setattr("rne.commands.agreement.has_pinocchio", lambda: False)
    source, rows = validate(irb140, samples=50)
    assert source == "energy and Lagrange identities (package pin is not installed)"
    assert [row.quantity for row in rows] == [row.quantity for row in against_energies(irb140, 1)]
    assert all(row.worst <= row.bound for row in rows)


@pytest.mark.parametrize("compare", [against_pinocchio, against_energies])
def test_differences_are_relative_to_the_terms_only_if_asked_for(irb140, compare):
    rows, by_terms = list(compare(irb140, 5)), list(compare(irb140, 5, by_terms=True))
    assert rows == list(compare(irb140, 5, by_terms=False))
    assert by_terms[0].worst < rows[0].worst  # no torque is larger than its terms


@pytest.mark.parametrize("compare", [against_pinocchio, against_energies])
def test_accelerations_have_the_bound_of_the_state_of_worst_condition(irb140, compare):
    conditions = np.linalg.cond(irb140.mass_matrix(random_states(6, 20)[0]))
    bounds = {row.quantity: row.bound for row in compare(irb140, 20)}
    assert bounds["forward after inverse"] == np.finfo(float).eps * conditions.max() > 1e-13


@pytest.mark.parametrize("compare", [against_pinocchio, against_energies])
def test_sizes_of_accelerations_are_those_of_the_torques_that_cancel(irb140, compare):
    """Of one joint |M^-1| (|tau| + |h|), in closed form."""
    arm = irb140.locked({name: 0.0 for name in irb140.joint_names if name != "joint_2"})
    q, qd, qdd = random_states(1, 50)
    tau, M, bias = arm.inverse_dynamics(q, qd, qdd), arm.mass_matrix(q)[:, 0], arm.bias_torque(q, qd)
    differences = np.abs(arm.forward_dynamics(q, qd, tau) - qdd) / ((np.abs(tau) + np.abs(bias)) / M)
    rows = {row.quantity: row.worst for row in compare(arm, 50, by_terms=True)}
    assert rows["forward after inverse"] == pytest.approx(differences.max(), rel=1e-12, abs=0)
    assert rows["forward after inverse"] > 0


@pytest.mark.parametrize("by_terms", [False, True])
@pytest.mark.parametrize("compare", [against_pinocchio, against_energies])
def test_a_robot_without_joints_keeps_every_bound(irb140, compare, by_terms):
    still = irb140.locked(dict.fromkeys(irb140.joint_names, 0.0))
    assert all(row.worst == 0 < row.bound <= 1e-12 for row in compare(still, 3, by_terms=by_terms))


@pytest.fixture
def short(monkeypatch):
    """The main job with a tenth of its free swing, few frames and one turn of timing; everything else as it is."""
    monkeypatch.setattr(pages, "MAIN_SWING", 1.0)
    monkeypatch.setattr(pages, "TURNS", 1)
    monkeypatch.setattr("rne.plotting.html_page.FILM_FPS", 1.0)


@pytest.mark.long
def test_main_job_writes_page_and_pictures(tmp_path, short, capsys):
    assert main(["--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "Largest difference from Pinocchio" in said
    page = (tmp_path / "index.html").read_text()
    assert "<th>mass behind the joint [kg]</th>" in page
    assert "<td>joint_1</td><td>75</td>" in page
    for picture in ("speed.png", "least.png", "differences.png", "motion_1.png", "swing_1.png"):
        assert picture in page
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")
    assert page.index('<img src="motion.gif"') < page.index("<p>An industrial arm") < page.index("<nav>")
    assert (tmp_path / "motion.gif").read_bytes().startswith(b"GIF89a")
    assert "From 3.00 s on every joint stays within 0.01 rad of its target." in page
    assert "No limit of the model is exceeded. The fastest joint reaches 76% of its velocity limit." in page
    for who in ("rne, NumPy", "rne, machine code", "Pinocchio"):
        assert len(re.findall(f"<td[^>]*>{who}</td>", page)) == 2
    assert "The motion with the least torque" in page
    assert page.count("<figcaption>") == page.count("<img ")
    assert not re.search(r"\(\d+\.\d+\)|\b\d\.\d-\d\b|Criterion", page)  # equations and runs that are explained nowhere


def test_main_job_without_matplotlib_and_pinocchio_says_what_is_there(tmp_path, short, monkeypatch, capsys):
    """Energies, which are no other program, with their own bound, and no picture."""
    monkeypatch.setattr("rne.plotting.html_page.has_matplotlib", lambda: False)
    monkeypatch.setattr("rne.plotting.html_page.importlib.util.find_spec", lambda name: None)
    for module in ("rne.commands.agreement", "rne.commands.pages"):
        monkeypatch.setattr(f"{module}.has_pinocchio", lambda: False)
    assert main(["--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "matplotlib is not installed: no pictures" in said
    assert "\nComparison with energy and Lagrange identities\n" in said
    assert "differences are expected within 1e-12, which is 4500 roundings; for accelerations 1e-13" in said
    best = re.search(
        r"at best they are wrong by (\de-\d\d) of the largest derivative, with steps of \de-\d\d rad", said
    )
    assert float(best[1]) < 1e-9  # central ones about eps^(2/3), 4e-11; of one side eps^(1/2), 1e-8
    for untrue in ("Pinocchio", "independent", "Both programs", "picture shows", "drawing"):
        assert untrue not in said
    assert [p.name for p in tmp_path.iterdir()] == ["index.html"]
    assert (
        "<p>Masses with the links on fixed joints included, in the axes of the link:</p>"
        in (tmp_path / "index.html").read_text()
    )


def test_ctrl_c_leaves_the_page_so_far(tmp_path, short, monkeypatch, capsys):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Report, "film", lambda *_: None)
    monkeypatch.setattr(pages, "measured_speed", interrupt)
    assert main(["--out", str(tmp_path)]) == 130
    assert f"interrupted: the page so far is {tmp_path / 'index.html'}\n" in capsys.readouterr().err
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert page.index("How the results are checked") < page.index("Interrupted: what follows is missing.")


@pytest.mark.parametrize("gravity", [[0, 0, -9.81], [0, 0, 0]])
def test_a_report_starts_where_every_joint_moves(gravity):
    robot = rne.load("irb140", gravity=gravity)
    q, torque = pages.moving_start(robot)
    motion = rne.simulate(robot, q, np.zeros(6), 1.0, torque=torque)
    assert (np.ptp(motion.q, axis=0) > 0.1).all()
    assert ((q >= robot.lower) & (q <= robot.upper)).all()


def test_the_largest_torque_is_none_below_the_one_beside_it(two):
    """Stretched out, which no random position is."""
    tables = []
    page = SimpleNamespace(text=lambda _: None, table=lambda heads, rows: tables.append(rows))
    places = np.pi / 2 * np.array([[0, 0], [1, 0]])
    q = places[np.abs(two.gravity_torque(places)).sum(1).argmax()]
    pages._gravity(two, q, "stretched out", page)
    (rows,) = tables
    assert [row[2] for row in rows] == [row[3] for row in rows]
    assert all(float(row[2]) > 0 for row in rows)


def test_speed_is_relative_to_the_faster_of_pinocchios_calls():
    def measured(form, who, seconds):
        return Measured("inverse dynamics", form, who, seconds, 1e-15)

    found = [measured("one state per call", "rne, NumPy", 6e-6), measured("1000 states per call", "rne, NumPy", 1e-6)]
    head, *rows = speed_table(found)
    assert head == ["quantity", "computed by", "one state per call", "1000 states per call", "largest error"]
    assert rows == [["inverse dynamics", "rne, NumPy", "6 µs", "1 µs", "1.0e-15"]]  # nothing to compare with
    found += [measured("one state per call", "Pinocchio", 2e-6), measured("1000 states per call", "Pinocchio", 3e-6)]
    assert speed_table(found)[1:] == [
        ["inverse dynamics", "rne, NumPy", "6 µs (3.0× slower)", "1 µs (2.0× faster)", "1.0e-15"],
        ["inverse dynamics", "Pinocchio", "2 µs", "3 µs", "1.0e-15"],
    ]


def test_errors_over_times_are_drawn_on_logarithmic_axes():
    found = [
        Measured(q, "1000 states per call", "rne, NumPy", 1e-6, 1e-15) for q in ("inverse dynamics", "forward dynamics")
    ]
    panels = plot_speed(found).axes
    assert [ax.get_title() for ax in panels] == [
        f"{q}: largest error, relative" for q in ("inverse dynamics", "forward dynamics")
    ]
    assert {(ax.get_xscale(), ax.get_yscale()) for ax in panels} == {("log", "log")}


@pytest.mark.long
def test_main_page_fits_a_phone_and_moves_in_3d(tmp_path, short):
    """In a browser: nothing is wider than the window, and the animation stands where WebGL is missing."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("Chromium is not installed: apt-get install chromium")
    from playwright.sync_api import sync_playwright

    assert main(["--out", str(tmp_path)]) == 0
    with sync_playwright() as playwright:
        for graphics in (
            ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
            ["--disable-3d-apis"],
        ):
            browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", *graphics])
            tab = browser.new_page(viewport={"width": 390, "height": 844})
            tab.goto((tmp_path / "index.html").as_uri())
            assert tab.locator("iframe").count() == ("--disable-3d-apis" not in graphics)
            assert tab.locator("img[src='motion.gif']").count() == ("--disable-3d-apis" in graphics)
            wider = "[...document.querySelectorAll('*')].filter(x => x.getBoundingClientRect().right > 391).length"
            assert tab.evaluate(wider) == 0
            browser.close()
