"""The README's length, links, figures and moving picture. Its example runs in test_architecture.py."""

import re
import runpy
import shutil
import sys

import numpy as np
import pytest

import rne
from benchmarks import engines, readme_picture

from .helpers import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
ENGINES = (ROOT / "docs" / "explanation" / "kernels.md").read_text(encoding="utf-8")


def test_is_short():
    assert README.count("\n") <= 100


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_links_lead_somewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", text)
    assert links or page == "CHANGELOG.md"
    assert [link for link in links if not link.startswith("https://") and not (ROOT / link).exists()] == []


def engines_in(page):
    """The table of the engines, as `python -m benchmarks.engines` writes it."""
    return re.search(r"<!-- table: engines -->\n\n(.*?)\n\n<!-- end", page, re.DOTALL)[1]


def test_figures_are_those_of_the_last_measurement():
    assert engines_in(README) == engines_in(ENGINES)
    assert engines_in(README) == engines.beside_each_other(
        engines.read("kernels.json"), engines.read("simulation.json")
    )


@pytest.mark.parametrize("shape", readme_picture.SIZES)
@pytest.mark.parametrize("theme", readme_picture.INK)
def test_chart_shows_the_kept_results(theme, shape):
    """Every point of the committed results is on the chart, and the start page shows it."""
    charts, derivatives = engines.read("charts.json")["charts"], engines.read("derivatives.json")
    torques, hessians, swing = readme_picture.picture(charts, derivatives, theme, shape).axes
    rows = charts["evaluation"]["robots"]["ur5"]["inverse_dynamics"], derivatives["robots"]["ur5 inverse_dynamics"]
    for ax, calls, found in zip(
        (torques, hessians), (readme_picture.CALLS, readme_picture.HESSIANS), rows, strict=True
    ):
        shown = {line.get_label(): line.get_xydata().tolist() for line in ax.lines}
        assert shown == {
            who: [[found[call]["ns_per_state"], found[call]["worst_error"]]] for who, call in calls.items()
        }
        (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
        assert all(left < x < right and low < y < high for ((x, y),) in shown.values())
    assert [len(line.get_xydata()) for line in swing.lines] == [3] * 4
    assert (ROOT / "docs" / "pictures" / f"speed_and_accuracy{theme}{shape}.png").is_file()
    assert f"pictures/speed_and_accuracy{theme}.png" in (ROOT / "docs" / "index.md").read_text(encoding="utf-8")


def test_named_robots_and_extras_exist():
    assert {"ur5", "panda"} <= set(rne.robots())
    extras = re.findall(r"extra `(\w+)`|\(`(\w+)`\)", README)
    known = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert len(extras) == 5
    for extra in filter(None, sum(extras, ())):
        assert re.search(rf"^{extra} = \[", known, re.MULTILINE)


@pytest.mark.long
def test_moving_picture_is_what_its_script_makes(tmp_path, monkeypatch):
    from PIL import Image

    pytest.importorskip("playwright")
    if shutil.which("chromium") is None:
        pytest.skip("Chromium is not installed: apt-get install chromium")
    script = ROOT / "docs" / "pictures" / "closed_loop.py"
    monkeypatch.setattr(sys, "argv", [str(script), str(tmp_path / "made.gif")])
    runpy.run_path(str(script), run_name="__main__")
    with Image.open(tmp_path / "made.gif") as made, Image.open(script.with_suffix(".gif")) as committed:
        assert made.size == committed.size
        assert min(made.n_frames, committed.n_frames) > 40  # frames that are alike are stored as one
        for ends in ((0, 0), (made.n_frames - 1, committed.n_frames - 1)):
            made.seek(ends[0])
            committed.seek(ends[1])
            difference = np.abs(np.asarray(made.convert("RGB"), int) - np.asarray(committed.convert("RGB"), int))
            assert difference.mean() < 2  # of 255: other versions of Chromium draw edges a little differently
