"""Each benchmark runs once with few states and writes nothing; the text of the pages agrees with their tables."""

import re
import subprocess
import sys

import numpy as np
import pytest

from benchmarks import __main__ as charts
from benchmarks import (
    cases,
    engines,
    identification_payload,
    identification_tables,
    import_time,
    motion_derivatives,
    motion_fit_peers,
    regressor,
    weight,
)
from benchmarks.evaluation import (
    KERNEL,
    KERNEL_SINGLE,
    NUMBA,
    NUMBA_SINGLE,
    PINOCCHIO_BATCH,
    PINOCCHIO_SINGLE,
    numba_beside_peers,
    row,
)
from benchmarks.evaluation_picture import label
from benchmarks.pages import BLOCK, DOCS, filled, places, table
from benchmarks.peers import Point

from .helpers import ROOT, kept

FURTHER = ("validation", "kernels", "lagrange", "simulation", "regressor", "engines", "derivatives", "elsewhere")
BENCHMARKS = [
    "benchmarks",
    *(f"benchmarks.{name}" for name in (*FURTHER, "scene_costs", "motion_derivatives", "motion_fit_peers")),
]
WITHOUT_NUMBA = (
    "import runpy, sys; sys.modules['numba'] = None; runpy.run_module({!r}, run_name='__main__', alter_sys=True)"
)
NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e-\d+)?(?![\w]|\.\d)")
RESULT = re.compile(r"^Result: .+?(?=\n\n)", re.DOTALL | re.MULTILINE)
NAMES = ["RK45", "DOP853", "gauss-4", "IRB 140", "UR5", "RK4"]  # their digits are no figures


@pytest.mark.parametrize("name", kept(BENCHMARKS, ["benchmarks.lagrange"]))
def test_quick_run_prints_a_table_and_changes_no_file(name):
    places = (ROOT / "benchmarks" / "results").glob("*.json"), (ROOT / "docs" / "benchmarks").glob("*")
    results = [engines.README, *sorted(path for place in places for path in place)]
    before = [path.read_bytes() for path in results]
    command = [sys.executable, "-m", name, "--quick"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    first = "| engine |" if name == "benchmarks.motion_fit_peers" else "| irb140 |"  # which is of one robot
    assert first in run.stdout
    if name in ("benchmarks", "benchmarks.kernels", "benchmarks.engines"):
        assert "not for comparison" in run.stdout
    if name in ("benchmarks.kernels", "benchmarks.engines"):
        assert ("| Numba |" in run.stdout) == ("numba" in cases.engines())
    assert [path.read_bytes() for path in results] == before


@pytest.mark.parametrize("name", kept([f"benchmarks.{name}" for name in ("kernels", "simulation")], []))
def test_without_numba_its_rows_are_left_out(name):
    command = [sys.executable, "-c", WITHOUT_NUMBA.format(name), "--quick"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "| NumPy |" in run.stdout
    assert "| Numba |" not in run.stdout
    assert "Numba is left out: not installed." in run.stdout


def test_an_engine_that_is_absent_is_named_with_its_reason(monkeypatch):
    monkeypatch.setattr(cases, "import_failure", {"numpy": None, "numba": "not installed"}.get)
    assert cases.engines() == ("numpy",)
    assert cases.engines_left_out() == {"Numba": "not installed"}
    assert cases.compiled_by_numba(quick=False) == ()
    kernel = {"worst_error": 1e-16, "kernel_faster": (1.0, 1.0, 1.0), "build_s": 0.01}
    assert numba_beside_peers({"irb140, mass matrix": {KERNEL: kernel}}) == "Numba is left out: not installed."


def test_the_panda_without_its_mimic_tag_has_one_more_coordinate():
    assert cases.load(cases.FREE_FINGERS).n == cases.load("panda").n + 1


@pytest.mark.parametrize(
    ("times_faster", "text"),
    [
        ([2.04, 9.96, 5.0], "2.0 to 10.0 times faster"),
        ([1 / 5, 1 / 8], "5.0 to 8.0 times slower"),
        ([3.0], "3.0 times faster"),
        ([0.5, 2.0], "2.0 times slower to 2.0 times faster"),
        ([0.98, 1.5], "1.0 to 1.5 times faster"),
        ([0.5, 1.02], "1.0 to 2.0 times slower"),
        ([0.98, 1.02], "equally fast"),
        ([], "-"),
    ],
)
def test_ratios_say_which_is_faster(times_faster, text):
    assert engines.words(times_faster) == text


def current(found, pages):
    """Whether the tables of pages are those given, all of them."""
    texts = {page: page.read_text(encoding="utf-8") for page in pages}
    assert sorted(name for page in pages for name in places(page)) == sorted(found)
    return all(filled(text, {name: found[name] for name in places(page)}) == text for page, text in texts.items())


def test_tables_of_engines_are_those_of_the_last_runs():
    """After new runs: python -m benchmarks.engines."""
    kernels, simulation = engines.read("kernels.json"), engines.read("simulation.json")
    if "motions" not in simulation or "small" not in kernels:
        pytest.skip("the kept runs of benchmarks.kernels and benchmarks.simulation are older than the engines")
    found = engines.tables(kernels, simulation)
    assert {name for page in engines.PAGES for name in places(page)} == set(found)
    for page in engines.PAGES:
        text = page.read_text(encoding="utf-8")
        assert filled(text, {name: found[name] for name in places(page)}) == text


def test_the_last_run_imports_within_its_bound():
    assert engines.read("import_time.json")["ratios"]["rne"][0] <= import_time.AT_MOST


def test_the_page_of_the_installation_has_the_sizes_of_the_last_run():
    """Of every extra. After a change: python -m benchmarks.weight."""
    sizes, text = engines.read("weight.json")["installed"], weight.PAGE.read_text(encoding="utf-8")
    assert list(sizes) == weight.choices()
    assert weight.filled(text, sizes) == text
    for size in sizes.values():
        assert f" | {size:.0f} |\n" in text


def test_tables_of_the_regressor_are_those_of_the_last_run():
    """After a new run: python -m benchmarks.regressor."""
    found = engines.read("regressor.json")
    text = regressor.PAGE.read_text(encoding="utf-8")
    assert filled(text, regressor.tables(found)) == text
    for robot in found["robots"].values():  # what the page says of all rows
        for engine in ("numpy", "numba"):
            assert robot["variants"][engine]["times_faster"][0] > 1000
            assert robot["regressor"][engine]["batch_times_faster"][0] > 1
        assert robot["regressor"]["numba"]["single_times_slower"][0] < 1
    assert found["variants"] == 5000


def test_tables_of_derivatives_of_motions_are_those_of_the_last_run():
    """After a new run: python -m benchmarks.motion_derivatives."""
    assert current(motion_derivatives.tables(engines.read("motion_derivatives.json")), motion_derivatives.PAGES)


def test_tables_of_fits_beside_rollouts_are_those_of_the_last_run():
    """After a new run: python -m benchmarks.motion_fit_peers."""
    text, found = motion_fit_peers.PAGE.read_text(encoding="utf-8"), engines.read("motion_fit_peers.json")
    assert filled(text, motion_fit_peers.tables(found)) == text
    assert found["beside"]["deviations"]["RK4"] < 1e-3  # standard errors


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
    each |= {NUMBA: [0.5e-9], NUMBA_SINGLE: [3e-9]}
    for name, faster in {PINOCCHIO_BATCH: 16, PINOCCHIO_SINGLE: 4, KERNEL: 2}.items():
        assert row(Point(name, print, 1000, print), [0.0], each)["numba_faster"][0] == pytest.approx(faster)
    del each[PINOCCHIO_BATCH]
    assert row(Point(KERNEL, print, 1000, print), [0.0], each)["against"] == "loop"


def test_labels_of_batches_have_their_size():
    assert label("recursion, batch, float32", 20_000) == "recursion, batch of 20 000, float32"
    assert label("kernel, one state", 1) == "kernel"


def test_figures_in_the_text_of_results_stand_in_the_tables():
    """After new runs this names the figures to rewrite by hand."""
    pages = [path.read_text(encoding="utf-8") for path in charts.PAGES]
    results = [(result, page) for page in pages for result in RESULT.findall(page)]
    assert len(results) >= 4
    for result, page in results:
        assert figures(result)
        assert figures(result) - tables_of(page) == set(), result


def test_figures_of_the_summary_stand_in_the_tables_of_all_benchmarks():
    pages = [path.read_text(encoding="utf-8") for path in (*charts.PAGES, *engines.PAGES)]
    summary = engines.PAGES[-1].read_text(encoding="utf-8").partition("Where rne is slower:")[2].partition("<!--")[0]
    assert len(figures(summary)) > 8
    assert figures(summary) - set.union(*map(tables_of, pages)) == set()


def figures(text):
    """Figures of a text, without the digits of names."""
    for name in NAMES:
        text = text.replace(name, "")
    return set(NUMBER.findall(text))


def tables_of(page):
    """Figures of the tables of a page."""
    return set(NUMBER.findall("\n".join(block[0] for block in BLOCK.finditer(page))))


def test_filling_a_page_replaces_tables_and_keeps_the_text():
    page = "Before.\n\n<!-- table: one -->\n\n| old |\n\n<!-- end of table -->\n\nAfter.\n"
    new = filled(page, {"one": table(["a"], [["1"]])})
    assert new == "Before.\n\n<!-- table: one -->\n\n| a |\n|---|\n| 1 |\n\n<!-- end of table -->\n\nAfter.\n"
    assert filled(new, {"one": table(["a"], [["1"]])}) == new


def test_a_page_without_a_place_for_a_table_is_refused():
    with pytest.raises(ValueError, match=re.escape("the page has the tables ['one'], given are ['two']")):
        filled("<!-- table: one -->\n<!-- end of table -->\n", {"two": ""})


PUBLIC_LOGS = (DOCS / "benchmarks" / "public-logs.md").read_text(encoding="utf-8")


def test_tables_of_identification_are_those_of_the_last_runs():
    """After new runs: python -m benchmarks.identification, or python -m benchmarks.public_logs FOLDER."""
    assert current(identification_tables.tables(), identification_tables.PAGES)


def test_masses_of_the_last_runs_are_within_two_percent_and_three_standard_errors():
    for case in engines.read("identification_payload.json")["loads"]:
        mass, z = (np.abs(case["runs"][key]) for key in ("mass", "mass z"))
        near = mass < (np.inf if case["drives"] == identification_payload.SCALED else 0.02)
        assert np.mean(near & (z < 3)) >= 0.95  # factors of 3 % make masses wrong by more than 2 % at times


def test_what_the_text_says_of_published_logs_stands_in_the_results():
    logs = {(log["robot"], log["chosen"]): log for log in engines.read("public_logs.json")["logs"]}
    six = re.findall(r"(?:\d+\.\d\d ){5}\d\.\d\d", PUBLIC_LOGS.split("published friction")[1])
    viscous, coulomb = (np.array(numbers.split(), float) for numbers in six[:2])
    arm, alone = logs["TX40", False], logs["TX40 without the shaft", False]
    assert (np.abs(np.array(arm["Fv"]) / viscous - 1) < 0.03).all()
    assert (np.abs(np.array(arm["Fc"]) / coulomb - 1) < 0.1).all()
    assert min(alone["error"][4:]) > 30
    assert logs["KR300", True]["condition"] > 2000


@pytest.mark.long
def test_quick_run_of_identification_finds_consistent_bodies():
    command = [sys.executable, "-m", "benchmarks.identification", "--quick"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "| physically consistent | 4 of 4 |" in run.stdout
    assert run.stdout.count("| 1 of 1 |") == 9
