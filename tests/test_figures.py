"""docs/figures.md and the two that continue it: their numbers are those of the kept results, and their own two pictures show them."""

import re
import runpy

import numpy as np
import pytest

import rne
from benchmarks import figures
from benchmarks.engines import read
from benchmarks.pages import BLOCK, filled

from .helpers import ROOT

TEXT = "".join(page.read_text(encoding="utf-8") for page in figures.PAGES)
NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e-?\d+)?(?!\w)")


def test_tables_are_those_of_the_kept_results():
    """After new runs: python -m benchmarks.figures."""
    assert filled(TEXT, figures.tables()) == TEXT


def test_every_picture_names_command_machine_and_date_of_its_results():
    for section in TEXT.split("\n## ")[1:]:
        assert re.search(r"!\[[^]]+\]\(\S+\.png\)|\{figure\} \S+\.png", section), section[:40]
        (place,) = re.findall(r"<!-- table: (\S+-run) -->", section)
        source, command = figures.RUNS[place]
        found = read(source)
        assert f"`{command}` *on* {found['date']}: {found['machine']['cpu']}, " in section
        assert f"kept in `benchmarks/results/{source}`." in section


def test_every_result_has_the_day_of_its_run():
    for path in (ROOT / "benchmarks" / "results").glob("*.json"):
        assert re.fullmatch(r"20\d\d-\d\d-\d\d", read(path.name)["date"]), path.name


def test_numbers_of_the_text_that_are_measured_stand_in_its_tables():
    text, tables = BLOCK.sub("", TEXT), "\n".join(block[0] for block in BLOCK.finditer(TEXT))
    chosen = {"2026", "24", "140", "50", "0", "1", "10", "1e6", "1e-3", "20", "000", "1000"}  # of the experiment
    measured = set(NUMBER.findall(text)) - chosen
    assert measured
    assert measured <= set(NUMBER.findall(tables))


def test_picture_of_the_engines_shows_every_ratio():
    found = read("kernels.json")
    panels = figures.engines_picture(found).axes
    for ax, size in zip(panels, figures.BATCHES, strict=True):
        for line, engine in zip(ax.lines, figures.ENGINES, strict=False):
            assert list(line.get_xdata()) == list(figures.ratios(found, engine, size).values())
            assert len(line.get_xdata()) == 3 * len(found["robots"])


def test_picture_of_the_differences_shows_every_robot():
    found = read("validation.json")
    (ax,) = figures.differences_picture(found).axes
    for line, values in zip(ax.lines, figures.differences(found).values(), strict=False):
        assert list(line.get_xdata()) == values
    assert len(values) < len(found["robots"]) + 1 == len(ax.lines[0].get_xdata())


def test_counts_of_the_page_of_theory_are_those_of_its_pictures():
    """Rules of the graph only save operations, and the last count is that of the kernel."""
    page = (ROOT / "docs" / "explanation" / "theory.md").read_text(encoding="utf-8")
    script = runpy.run_path(str(ROOT / "docs" / "pictures" / "theory.py"))
    for function, model in (
        (rne.dynamics.gravity_torque, script["arm"]()),
        (rne.dynamics.inverse_dynamics, rne.irb140()),
    ):
        counts = [script["operations"](*graph) for graph in script["stages"](function, model).values()]
        assert counts == sorted(counts, reverse=True)
        kinds = rne.compile(function, model).operations
        assert counts[-1] == sum(kinds.values()) - kinds.get("negative", 0)  # signs are kept at the lines
    assert "{} as written, {} folded, {} shared, {} with masses moved".format(*counts) in page
    assert "52 operations as they are written, 10 when simplified" in page
    arm = rne.Robot(script["arm"]())
    q1, q2 = 0.3, 0.4
    g2 = 2 * 0.2 * 9.81 * np.cos(q1 + q2)
    np.testing.assert_allclose(arm.gravity_torque([q1, q2]), [4 * 0.4 * 9.81 * np.cos(q1) + g2, g2], rtol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("name", ["engines", "differences"])
def test_committed_picture_is_what_the_kept_results_give(name, tmp_path):
    from PIL import Image

    source = {"engines": "kernels.json", "differences": "validation.json"}[name]
    getattr(figures, f"{name}_picture")(read(source)).savefig(tmp_path / "made.png", facecolor="white")
    with (
        Image.open(tmp_path / "made.png") as made,
        Image.open(ROOT / "docs" / "pictures" / f"{name}.png") as committed,
    ):
        assert made.size == committed.size
        difference = np.abs(np.asarray(made.convert("RGB"), int) - np.asarray(committed.convert("RGB"), int))
    assert difference.mean() < 2  # of 255: other versions of matplotlib draw text a little differently
