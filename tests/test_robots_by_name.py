"""Robots by name: built in, or files of example-robot-data."""

import importlib.metadata

import numpy as np
import pytest

import rne
from rne.urdf.loading import urdf_files

from .helpers import kept, loaded


@pytest.fixture
def without_package(monkeypatch):
    def missing(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "files", missing)
    urdf_files.cache_clear()
    yield
    urdf_files.cache_clear()


def test_every_file_of_the_package_has_one_name():
    names = rne.robots()
    assert names[0] == "irb140"
    installed = importlib.metadata.files("example-robot-data")
    assert len(names) == len(set(names)) == 1 + sum(file.suffix == ".urdf" for file in installed)
    assert {"ur5", "panda", "ur3", "ur3_robot", "tiago", "anymal_c_simple_description/anymal"} <= set(names)


@pytest.mark.parametrize("name", kept(["ur5", "panda"], ["ur5"]))
def test_a_name_is_its_file(name):
    file = {"ur5": "ur_description/ur5_robot", "panda": "panda_description/panda"}[name]
    robot = rne.load(name, gravity=[0, 0, -1.62], engine="numpy")
    assert robot.joint_names == loaded(file).joint_names
    np.testing.assert_array_equal(robot.model.mass, loaded(file).model.mass)
    assert robot.model.gravity.tolist() == [0, 0, -1.62]


def test_a_file_goes_before_a_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "panda").mkdir()
    assert rne.load("panda").model.name == "panda"
    (tmp_path / "ur5").write_text(rne.to_urdf(rne.irb140()))
    assert rne.load("ur5").model.name == "irb140"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("ur55", "'ur55' is neither a file nor one of rne.robots(); did you mean 'ur5'?"),
        ("UR5", "'UR5' is neither a file nor one of rne.robots(); did you mean 'ur5'?"),
        ("gantry.urdf", "'gantry.urdf' is neither a file nor one of rne.robots()"),
    ],
)
def test_an_unknown_name_is_answered_with_near_ones(name, text):
    with pytest.raises(FileNotFoundError) as caught:
        rne.load(name)
    assert str(caught.value).startswith(text)


def test_a_broken_file_of_the_package_is_told_from_one_of_yours():
    with pytest.raises(
        rne.UrdfError, match=r"^the file of example-robot-data has an error: .*there is no <link>.*'ur3_r"
    ):
        rne.load("ur3")


def test_without_the_package_the_built_in_robots_are_there(without_package):
    assert rne.robots() == ("irb140",)
    assert rne.load("irb140").n == 6
    with pytest.raises(FileNotFoundError) as caught:
        rne.load("ur5")
    told = "'ur5' is neither a file nor a built-in robot; about 60 more, such as 'ur5', come with pip install 'rne[robots]'"
    assert str(caught.value) == told


def test_check_takes_the_names_that_load_takes(capsys):
    assert rne.check("irb140") == []
    assert capsys.readouterr().out == "irb140: no findings\n"
    with pytest.raises(FileNotFoundError, match=r"^'irb1400' is neither a file nor one of rne.robots\(\)"):
        rne.check("irb1400")


def test_check_of_a_name_reads_its_file(capsys):
    file = str(urdf_files()["panda_description/panda"])
    assert [str(x) for x in rne.check("panda")] == [str(x) for x in rne.check(file)]
    assert len(set(capsys.readouterr().out.split("loads as written\n")[:2])) == 1
