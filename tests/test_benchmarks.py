"""Each benchmark runs once with few states and writes nothing; the text of the pages agrees with their tables."""

import re
import subprocess
import sys

import pytest

from benchmarks.evaluation import KERNEL, KERNEL_SINGLE, PINOCCHIO_BATCH, PINOCCHIO_SINGLE, row
from benchmarks.evaluation_picture import label
from benchmarks.pages import BLOCK, DOCS, filled, table
from benchmarks.peers import Point

from .helpers import ROOT, kept

BENCHMARKS = ["benchmarks", *(f"benchmarks.{name}" for name in ("validation", "kernels", "lagrange", "simulation"))]
NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e-\d+)?(?![\w]|\.\d)")
NAMES = ["RK45", "DOP853", "gauss-4", "IRB 140", "UR5", "RK4"]  # their digits are no figures


@pytest.mark.parametrize("name", kept(BENCHMARKS, ["benchmarks.kernels"]))
def test_quick_run_prints_a_table_and_changes_no_file(name):
    results = sorted([*(ROOT / "benchmarks" / "results").glob("*.json"), *(ROOT / "docs" / "benchmarks").glob("*")])
    before = [path.read_bytes() for path in results]
    command = [sys.executable, "-m", name, "--quick"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "| irb140 |" in run.stdout
    if name in ("benchmarks", "benchmarks.kernels"):
        assert "not for comparison" in run.stdout
    assert [path.read_bytes() for path in results] == before


def test_batches_are_compared_with_batches_and_single_calls_with_single_calls():
    seconds = {KERNEL: 1.0, KERNEL_SINGLE: 60.0, PINOCCHIO_BATCH: 8.0, PINOCCHIO_SINGLE: 12.0, "recursion, batch": 40.0}
    each = {name: [time * 1e-9] for name, time in seconds.items()}
    rows = {name: row(Point(name, print, 1000, print), [0.0], each) for name in seconds}
    assert {name: (r["against"], r["batch"]) for name, r in rows.items()} == {
        KERNEL: ("batch", 1000),
        KERNEL_SINGLE: ("one state", 1),
        PINOCCHIO_BATCH: ("batch", 1000),
        PINOCCHIO_SINGLE: ("one state", 1),
        "recursion, batch": ("batch", 1000),
    }
    assert rows["recursion, batch"]["times_faster"][0] == pytest.approx(8 / 40)
    assert rows[PINOCCHIO_SINGLE]["kernel_faster"][0] == pytest.approx(12 / 60)
    del each[PINOCCHIO_BATCH]
    assert row(Point(KERNEL, print, 1000, print), [0.0], each)["against"] == "loop"


def test_labels_of_batches_have_their_size():
    assert label("recursion, batch, float32", 20_000) == "recursion, batch of 20 000, float32"
    assert label("kernel, one state", 1) == "kernel"


def test_figures_in_the_text_of_results_stand_in_the_tables():
    """After new runs this names the figures to rewrite by hand."""
    page = (DOCS / "benchmarks" / "index.md").read_text(encoding="utf-8")
    tables = set(NUMBER.findall("\n".join(block[0] for block in BLOCK.finditer(page))))
    results = re.findall(r"^Result: .+?(?=\n\n)", page, re.DOTALL | re.MULTILINE)
    assert len(results) >= 4
    for result in results:
        for name in NAMES:
            result = result.replace(name, "")
        figures = NUMBER.findall(result)
        assert figures
        assert [figure for figure in figures if figure not in tables] == [], result


def test_filling_a_page_replaces_tables_and_keeps_the_text():
    page = "Before.\n\n<!-- table: one -->\n\n| old |\n\n<!-- end of table -->\n\nAfter.\n"
    new = filled(page, {"one": table(["a"], [["1"]])})
    assert new == "Before.\n\n<!-- table: one -->\n\n| a |\n|---|\n| 1 |\n\n<!-- end of table -->\n\nAfter.\n"
    assert filled(new, {"one": table(["a"], [["1"]])}) == new


def test_a_page_without_a_place_for_a_table_is_refused():
    with pytest.raises(ValueError, match=re.escape("the page has the tables ['one'], given are ['two']")):
        filled("<!-- table: one -->\n<!-- end of table -->\n", {"two": ""})
