"""The command line."""

import subprocess
import sys

import pytest

from rne.__main__ import main
from rne.analysis.validation import against_energies, validate
from rne.simulation.simulator import simulate
from rne.thesis import main_page as main_job

from .helpers import ROOT


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
    assert "error: no such file" in capsys.readouterr().err


def test_urdf_prints_the_file(capsys):
    assert main(["urdf", "irb140"]) == 0
    assert capsys.readouterr().out == (ROOT / "robots" / "irb140.urdf").read_text()


def test_urdf_of_an_unknown_robot(capsys):
    assert main(["urdf", "irb"]) == 2
    assert capsys.readouterr().err == "error: no robot 'irb'; there are irb140\n"


def test_python_dash_m(tmp_path):
    run = subprocess.run(
        [sys.executable, "-m", "rne", "check", str(ROOT / "robots" / "irb140.urdf")],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert (run.returncode, run.stderr) == (0, "")


def test_validation_keeps_every_bound_against_pinocchio(irb140):
    source, rows = validate(irb140, samples=50)
    assert source.startswith("Pinocchio")
    assert all(row.worst <= row.bound for row in rows)


def test_validation_without_pinocchio_keeps_every_bound(irb140, monkeypatch):
    monkeypatch.setattr("rne.analysis.validation.has_pinocchio", lambda: False)
    source, rows = validate(irb140, samples=50)
    assert source == "energy and Lagrange identities (package pin is not installed)"
    assert [row.quantity for row in rows] == [row.quantity for row in against_energies(irb140, 1)]
    assert all(row.worst <= row.bound for row in rows)


@pytest.fixture
def short(monkeypatch):
    """The main job with a tenth of its free swing; everything else as it is."""
    monkeypatch.setattr(
        main_job, "simulate", lambda r, q, qd, T, **k: simulate(r, q, qd, T / 10 if T == 10 else T, **k)
    )


def test_main_job_writes_page_and_pictures(tmp_path, short, capsys):
    assert main(["--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "against Pinocchio" in said
    page = (tmp_path / "index.html").read_text()
    for picture in ("free_swing.png", "closed_loop.png"):
        assert picture in page
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")


def test_main_job_without_matplotlib_says_so(tmp_path, short, monkeypatch, capsys):
    monkeypatch.setattr(main_job, "has_matplotlib", lambda: False)
    assert main(["--out", str(tmp_path)]) == 0
    assert "matplotlib is not installed: no pictures" in capsys.readouterr().out
    assert [p.name for p in tmp_path.iterdir()] == ["index.html"]
