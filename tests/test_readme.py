"""The front door: README's length, links, figures and moving picture. Its example runs in test_architecture.py."""

import re
import runpy
import sys

import numpy as np
import pytest

import rne

from .helpers import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
ENGINES = (ROOT / "docs" / "explanation" / "kernels.md").read_text(encoding="utf-8")


def test_is_short():
    assert README.count("\n") <= 150


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_links_lead_somewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", text)
    assert links or page == "CHANGELOG.md"
    assert [link for link in links if not link.startswith("https://") and not (ROOT / link).exists()] == []


def figures_of(engine):
    """The cells of an engine's row: ranges of what it is beside Pinocchio."""
    row = next(line for line in ENGINES.splitlines() if line.startswith(f"| {engine} |"))
    names = ("one state", "batch of 1000", "batch of 100 000", "swing of 10 s", "ensemble of 1000")
    return dict(zip(names, [cell.strip() for cell in row.split("|")[2:-1]], strict=True))


def rounded(cell):
    """Its numbers as whole ones."""
    return [round(float(number)) for number in re.findall(r"[\d.]+", cell)]


def test_figures_are_those_of_the_last_measurement():
    plain, compiled = figures_of("NumPy"), figures_of("Numba")
    low, high = re.findall(r"[\d.]+", plain["batch of 100 000"])
    assert f"Batches of 100 000 states run {low} to {high} times faster than\n  Pinocchio's" in README
    low, high = rounded(plain["one state"])
    assert plain["one state"].endswith("slower")
    assert f"a single state takes {low} to {high} times longer" in README
    low, high = rounded(compiled["batch of 100 000"])
    (ensemble,) = rounded(compiled["ensemble of 1000"])
    first, last = re.findall(r"[\d.]+", compiled["one state"])
    assert f"batches {low} to {high} times faster than Pinocchio, ensembles of motions {ensemble} times" in README
    assert f"a single state {first} to {last} times" in README


def test_named_robots_and_extras_exist():
    assert {"ur5", "panda"} <= set(rne.robots())
    extras = re.findall(r"extra `(\w+)`|\(`(\w+)`\)", README.split("## Quick start")[0])
    known = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert len(extras) == 6
    for extra in filter(None, sum(extras, ())):
        assert re.search(rf"^{extra} = \[", known, re.MULTILINE)


@pytest.mark.long
def test_moving_picture_is_what_its_script_makes(tmp_path, monkeypatch):
    from PIL import Image

    script = ROOT / "docs" / "pictures" / "closed_loop.py"
    monkeypatch.setattr(sys, "argv", [str(script), str(tmp_path / "made.gif")])
    runpy.run_path(str(script), run_name="__main__")
    with Image.open(tmp_path / "made.gif") as made, Image.open(script.with_suffix(".gif")) as committed:
        assert made.size == committed.size
        assert made.n_frames == committed.n_frames > 40
        for frame in (0, made.n_frames // 2, made.n_frames - 1):
            made.seek(frame)
            committed.seek(frame)
            difference = np.abs(np.asarray(made.convert("RGB"), int) - np.asarray(committed.convert("RGB"), int))
            assert difference.mean() < 2  # of 255: other versions of matplotlib draw text a little differently
