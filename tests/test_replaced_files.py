"""What commands replace: files that carry the mark of rne; with --force others too; an input of the same call never."""

import csv
import os
import shutil
from pathlib import Path

import numpy as np
import pandas
import pytest

import rne
from rne.__main__ import main
from rne.basics.marks import is_marked
from rne.commands import pages

LEVER = """<robot name="lever"><link name="post"/><link name="beam"><inertial><origin xyz="0.4 0 0"/><mass value="3"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link><joint name="hinge" type="revolute">
<parent link="post"/><child link="beam"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="80" velocity="5"/></joint>
</robot>"""
MOTION = "t,q.hinge\n0,0\n0.1,0.1\n0.2,0.25\n0.3,0.2\n0.4,0.1\n0.5,0\n"
WAYS = {  # to call a file by another name
    "relative": lambda file: f"./../{file.parent.name}/{file.name}",
    "link": lambda file: _made(file, os.symlink),
    "second name": lambda file: _made(file, os.link),
}


def _made(file, link):
    link(file, other := file.with_name(f"other{file.suffix}"))
    return str(other)


@pytest.fixture(autouse=True)
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lever.urdf").write_text(LEVER)
    (tmp_path / "motion.csv").write_text(MOTION)
    (tmp_path / "via.csv").write_text("q.hinge\n0\n1\n")
    return tmp_path


def refused(words, capsys):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rne.commands.shared.robot_of", None)  # nothing is computed
        assert main(words) == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("way", "words", "read", "what"),
    [
        ("link", ["torques", "lever.urdf", "motion.csv"], "motion.csv", "motion"),
        ("second name", ["torques", "lever.urdf", "motion.csv"], "lever.urdf", "robot"),
        ("relative", ["identify", "lever.urdf", "motion.csv"], "motion.csv", "log"),
        ("link", ["identify", "lever.urdf", "via.csv", "--check", "motion.csv"], "motion.csv", "log"),
        ("second name", ["identify", "lever.urdf", "motion.csv"], "lever.urdf", "robot"),
        ("relative", ["view", "lever.urdf", "--motion", "motion.csv"], "motion.csv", "motion"),
        ("second name", ["simulate", "lever.urdf", "--duration", "1"], "lever.urdf", "robot"),
    ],
)
def test_an_input_is_not_replaced_even_by_force(way, words, read, what, files, capsys):
    out, before = WAYS[way](files / read), (files / read).read_bytes()
    said = refused([*words, "--force", "--out", out], capsys)
    assert said == f"error: --out: {str(Path(out))!r} is the {what} that is read; name another file\n"
    assert (files / read).read_bytes() == before


@pytest.mark.parametrize(
    ("words", "own"),
    [
        (["torques", "lever.urdf", "motion.csv"], "notes.csv"),
        (["identify", "lever.urdf", "motion.csv"], "another.urdf"),
        (["view", "lever.urdf"], "diary.html"),
        (["simulate", "lever.urdf", "--duration", "1"], "log.npz"),
        (["simulate", "lever.urdf", "--duration", "1"], "log.csv"),
    ],
)
def test_a_file_without_the_mark_is_kept(words, own, files, capsys):
    np.savez(files / "log.npz", t=[0.0, 1.0], texts=["of", "another program"])
    for name in {"notes.csv", "another.urdf", "diary.html", "log.csv"}:
        (files / name).write_text('"t","q.hinge"\n0,0\n')  # as R writes it
    kept = (files / own).read_bytes()
    said = refused([*words, "--out", own], capsys)
    assert said == f"error: --out: '{own}' was not written by rne; name another file, or give --force to replace it\n"
    assert (files / own).read_bytes() == kept


def test_what_is_no_regular_file_is_not_replaced(files, capsys):
    (files / "tau.csv").symlink_to("nowhere")
    said = refused(["torques", "lever.urdf", "motion.csv", "--force", "--out", "tau.csv"], capsys)
    assert said == "error: --out: 'tau.csv' is no regular file; name another file\n"


def test_a_file_that_may_not_be_written_is_kept(files, capsys, monkeypatch):
    opened = Path.open

    def open_as_another_user(path, mode="r", **how):  # the owner root may write anywhere
        if path.name == "tau.csv":
            raise PermissionError(13, "Permission denied")
        return opened(path, mode, **how)

    (files / "tau.csv").write_text("t,tau.hinge\n0,0\n")
    monkeypatch.setattr(Path, "open", open_as_another_user)
    said = refused(["torques", "lever.urdf", "motion.csv", "--force", "--out", "tau.csv"], capsys)
    assert said == "error: --out: cannot write 'tau.csv': Permission denied\n"


@pytest.mark.parametrize(("command", "suffix"), [("torques", ".csv"), ("identify", ".urdf")])
def test_a_suffix_of_another_kind_is_refused(command, suffix, capsys):
    said = refused([command, "lever.urdf", "motion.csv", "--out", "result.txt"], capsys)
    assert said == f"error: --out: must end in {suffix}, got 'result.txt'\n"


@pytest.mark.parametrize("option", [["report", "irb140"], [], ["cycle", "irb140", "via.csv"]])
def test_a_page_replaces_no_foreign_picture(option, files, capsys, monkeypatch):
    monkeypatch.setattr(pages, "write_main_page", None)
    (files / "page").mkdir()
    (files / "page" / "swing.png").write_bytes(b"\x89PNG of mine")
    assert main([*option, "--out", "page"]) == 2
    said = "'page/swing.png' was not written by rne; name another folder, or give --force to replace it"
    assert capsys.readouterr().err == f"error: --out: {said}\n"


def test_an_archive_of_rne_is_replaced_and_another_is_not(files, capsys):
    simulate = ["simulate", "lever.urdf", "--duration", "0.1", "--every", "0.05", "--out", "fall.npz"]
    assert main(simulate) == main(simulate) == 0
    capsys.readouterr()
    np.savez("fall.npz", texts=[1.0])
    assert refused(simulate, capsys) == (
        "error: --out: 'fall.npz' was not written by rne; name another file, or give --force to replace it\n"
    )


def test_what_rne_wrote_is_replaced_and_every_reader_takes_it(files):
    simulate = ["simulate", "lever.urdf", "--q0", "0.3", "--duration", "0.2", "--every", "0.05", "--out"]
    (files / "tau.csv").write_bytes(b"")  # nothing is lost of an empty file
    assert main([*simulate, "fall.csv"]) == main([*simulate, "fall.npz"]) == 0
    for out in ("tau.csv", "tau.csv", "fall.csv"):  # the second time in place of the first
        shutil.copy("fall.csv", "read.csv")
        assert main(["torques", "lever.urdf", "read.csv", "--out", out]) == 0
    shutil.copy("read.csv", "fall.csv")
    times = [0, 0.05, 0.1, 0.15, 0.2]
    for read in (
        pandas.read_csv("fall.csv")["t"],
        np.loadtxt("fall.csv", delimiter=",", skiprows=1)[:, 0],
        np.genfromtxt("fall.csv", delimiter=",", names=True)["t"],
        [float(row["t"]) for row in csv.DictReader(Path("fall.csv").read_text().splitlines())],
        rne.trajectories.read_csv("fall.csv", ["hinge"]).t,
        rne.Trajectory.load("fall.npz").t,
    ):
        np.testing.assert_allclose(read, times, rtol=1e-15)
    shutil.copy("motion.csv", "tau.csv")
    assert main(["torques", "lever.urdf", "fall.csv", "--out", "tau.csv", "--force"]) == 0
    assert is_marked(files / "tau.csv")
