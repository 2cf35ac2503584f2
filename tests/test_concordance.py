"""docs/concordance.md: no number of the thesis is missing; every place, test and command exists, the commands run."""

import ast
import contextlib
import functools
import importlib
import io
import re
import shlex

import pytest

import rne
from rne.__main__ import main, parser

from .conftest import COLLECTED
from .helpers import ROOT, kept
from .test_benchmarks import BENCHMARKS

PAGE = (ROOT / "docs" / "concordance.md").read_text(encoding="utf-8")
THESIS = "".join(page.read_text(encoding="utf-8") for page in sorted((ROOT / "docs" / "thesis").glob("*.md")))
ERRATA = (ROOT / "docs" / "errata.md").read_text(encoding="utf-8")
# What the thesis numbers: equations and figures by chapter, tables, and the sections that claim or define something.
EQUATIONS = {"2": 19, "3": 40, "4": 31, "5": 51, "6": 70, "7": 12, "D": 20}
FIGURES = {"1": 1, "2": 2, "3": 1, "4": 4, "6": 16, "7": 5}
TABLES = ["4.1", "7.1"]
SECTIONS = [
    *("1.3", "1.4", "1.6"),
    *("2.1.2", "2.2", "2.3", "2.4", "2.5"),
    *("3.1.1", "3.1.2", "3.2.2", "3.2.3"),
    *("4.1", "4.2", "4.3", "5.1", "5.3"),
    *("6.1", "6.3.1", "6.3.2", "6.4.3", "6.4.5", "6.5.1", "6.5.3"),
    *("7.1", "7.2.1", "7.2.2", "7.2.3", "8.1"),
]
LETTERS = "abcdefg"  # of the claims in section 6.5.3
TASKS, FUTURE_WORK, LABELS = 7, 11, 2  # of the assignment, of section 8.2, of the equations in appendix C
WITHOUT_CODE = 0.15  # largest share of rows
COLUMNS = ["thesis", "says", "code", "command", "test"]
LINK = re.compile(r"\[`([^`]+)`\]\(([^)]+)\)")
TEST = re.compile(r"tests/test_\w+\.py::[\w:]+(\[.+\])?")
# Commands that make pages are parsed only. These tests make the pages, with long runs cut short; that of the report is
# marked long, and each of its simulations has a test of its own in tests/test_thesis.py and test_thesis_figures.py.
LONG = {
    "python -m rne": "tests/test_main.py::test_main_job_writes_page_and_pictures",
    "python -m examples.thesis": "tests/test_report.py::test_page_has_every_experiment",
}


def tables():
    """Every row as a list of cells, with the heading of the table left out."""
    lines = [line[1:-1].split("|") for line in PAGE.splitlines() if line.startswith("|")]
    rows = [[cell.strip() for cell in line] for line in lines]
    assert all(len(row) == len(COLUMNS) for row in rows)
    return [row for row in rows if row != COLUMNS and set(row) != {"---"}]


ROWS = tables()


def quoted(column):
    """The texts in backquotes in a column, each once, without those of links."""
    cells = [LINK.sub("", row[COLUMNS.index(column)]) for row in ROWS]
    return list(dict.fromkeys(text for cell in cells for text in re.findall(r"`([^`]+)`", cell)))


COMMANDS = quoted("command")
FIRST = {re.sub(r"\d", "", command): command for command in reversed(COMMANDS)}  # of those that differ by a number
TESTS = quoted("test")
MOMENT = 0.02  # [s]
SEARCH = re.compile(
    r"check_gains\(|same_numbers\("
)  # of a second; tests/test_gains.py and test_thesis_figures.py call them
PLACES = sorted({link for row in ROWS for link in LINK.findall(row[COLUMNS.index("code")])})


@functools.cache
def defined(file):
    """Tests of a file: functions by their names, methods as Class::name."""
    found = set()
    for node in ast.parse((ROOT / file).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}::{inner.name}" for inner in node.body if isinstance(inner, ast.FunctionDef)}
        elif isinstance(node, ast.FunctionDef):
            found.add(node.name)
    return found


def is_defined(test):
    file, name = test.split("[")[0].split("::", 1)
    return (ROOT / file).is_file() and name in defined(file)


def test_tables_have_their_headings():
    """Each section without subsections has one table."""
    heading = f"| {' | '.join(COLUMNS)} |\n|---|---|---|---|---|\n"
    sections = [text for text in re.split(r"^##+ ", PAGE, flags=re.MULTILINE)[1:] if "\n|" in text]
    assert [text.count(heading) for text in sections] == [1] * len(sections)
    assert PAGE.count("|\n|---") == len(sections)
    assert len(ROWS) > 200


def test_every_cell_says_where_or_why_not():
    for row in ROWS:
        assert all(row), row
        for name, cell in zip(COLUMNS[2:], row[2:], strict=True):
            reason = re.fullmatch(r"none: \w+.*", cell)
            what = {"code": LINK, "command": re.compile(r"^`python [^`]+`$"), "test": re.compile(r"^`tests/")}[name]
            assert bool(reason) or what.search(cell), f"{row[0]}: {cell}"


def test_every_row_is_named_once():
    names = [row[0] for row in ROWS]
    sections = [section.split("\n")[0] for section in re.split(r"^##+ ", PAGE, flags=re.MULTILINE)[1:]]
    assert len(set(sections)) == len(sections)
    assert [name for name in names if names.count(name) > 1] == []


def test_every_place_exists():
    """A name is where it is written, not where it is imported."""
    wrong = []
    for text, target in PLACES:
        path, _, name = text.partition("::")
        found = importlib.import_module(module := path.removesuffix(".py").replace("/", ".")) if name else None
        for part in name.split(".") if name else []:
            found = getattr(found, part, None)
        is_there = target == f"../{path}" and (ROOT / path).is_file() and (not name or found is not None)
        wrong += [] if is_there and (not callable(found) or found.__module__ == module) else [text]
    assert wrong == []


def test_every_test_exists():
    assert len(TESTS) > 50
    for test in TESTS:
        assert TEST.fullmatch(test), test
        assert is_defined(test), test


def test_every_parameter_of_a_test_exists(request):
    """Of the files that pytest was asked for: the whole suite looks at all of them."""
    found = request.config.stash[COLLECTED]
    functions = {name.split("[")[0] for name in found}
    named = [test for test in TESTS if "[" in test]
    assert named
    assert [test for test in named if test.split("[")[0] in functions and test not in found] == []


def run(command, monkeypatch):
    """In this process; what takes minutes, and what is a test itself, is run by the test that is asked for here."""
    monkeypatch.chdir(ROOT)
    python, option, what, *arguments = shlex.split(command)
    assert python == "python"
    said = io.StringIO()
    if command in LONG:
        assert what == "examples.thesis" or parser().parse_args(arguments)
        assert is_defined(LONG[command])
    elif option == "-m" and what == "pytest":
        (test,) = arguments
        assert is_defined(test)
    elif option == "-m" and what.startswith("benchmarks"):
        assert what in BENCHMARKS  # each runs in tests/test_benchmarks.py
        assert arguments == ["--quick"]
    elif option == "-m":
        assert what == "rne"
        with contextlib.redirect_stdout(said):
            assert main(arguments) == 0
        assert said.getvalue()
    else:
        assert option == "-c"
        assert not arguments
        with contextlib.redirect_stdout(said):
            exec(compile(what, command, "exec"), {"__name__": "__main__"})
        assert said.getvalue().strip()


@pytest.mark.parametrize("command", kept(COMMANDS, [c for c in FIRST.values() if not SEARCH.search(c)]))
def test_every_command_runs(command, monkeypatch):
    """Simulations for a moment, but for those that ask for times of their own."""
    simulate = rne.simulate

    def brief(scene, q0, qd0, duration, **options):
        return simulate(scene, q0, qd0, duration if "t_eval" in options else min(duration, MOMENT), **options)

    monkeypatch.setattr(rne, "simulate", brief)
    run(command, monkeypatch)


@pytest.mark.long
@pytest.mark.parametrize("command", [c for c in FIRST.values() if "rne.simulate(" in c])
def test_every_simulation_runs_to_its_end(command, monkeypatch):
    run(command, monkeypatch)


def test_every_figure_of_the_page_of_experiments_has_its_row():
    numbers = re.findall(r"^## Figure (\d\.\d+): ", THESIS, re.MULTILINE)
    assert len(numbers) == 20
    rows = [row[0] for row in ROWS]
    assert [number for number in numbers if f"Figure {number}" not in rows] == []


def numbered(pattern):
    """The numbers that match a pattern in the first column, sorted."""
    return sorted(number for row in ROWS if not row[0].startswith("After") for number in re.findall(pattern, row[0]))


def counted(counts):
    """Every number of a chapter, such as "6.70", sorted."""
    return sorted(f"{chapter}.{k}" for chapter, last in counts.items() for k in range(1, last + 1))


def test_every_equation_has_its_row_and_one_only():
    """Each number is written out: "(5.32) to (5.51)" would not be found by a search for (5.40)."""
    assert numbered(r"\((\w\.\d+)\)") == counted(EQUATIONS)
    assert numbered(r"Label \((\d)\)") == [str(k) for k in range(1, LABELS + 1)]


def test_every_figure_and_table_has_its_row_and_one_only():
    assert numbered(r"Figure (\d\.\d+)") == counted(FIGURES)
    assert numbered(r"Table (\d\.\d+)") == TABLES


def test_every_section_task_and_item_of_future_work_has_its_row():
    sections = {number for row in ROWS if row[0].startswith("Section") for number in re.findall(r"\d[\d.]+\d", row[0])}
    assert [number for number in SECTIONS if number not in sections] == []
    assert [x for x in LETTERS if not any(row[0].startswith(f"Section 6.5.3 ({x})") for row in ROWS)] == []
    assert numbered(r"Task (\d)") == [str(k) for k in range(1, TASKS + 1)]
    assert sorted(map(int, numbered(r"Future work (\d+)"))) == list(range(1, FUTURE_WORK + 1))


def test_few_rows_are_without_code_and_none_is_not_known():
    without = [row[0] for row in ROWS if row[COLUMNS.index("code")].startswith("none:")]
    assert len(without) <= WITHOUT_CODE * len(ROWS), without
    assert "not known" not in PAGE.lower()
    equations = [name for name in without if re.match(r"\(|Label|Table", name)]
    assert equations == []


def test_every_erratum_is_named():
    numbers = re.findall(r"^## (\d+)\. ", ERRATA, re.MULTILINE)
    assert numbers
    named = re.findall(r"\[erratum (\d+)\]\(errata\.md\)", PAGE)
    assert set(named) == set(numbers)


def test_a_row_with_an_erratum_names_its_tests():
    """At least one test of the entry, and none but the entry's own from tests/test_errata.py."""
    entries = re.split(r"^## ", ERRATA, flags=re.MULTILINE)[1:]
    tests = {entry.split(".")[0]: set(re.findall(r"`(tests/\w+\.py::\w+)`", entry)) for entry in entries}
    wording = {number for number, named in tests.items() if not named}
    for row in ROWS:
        for number in set(re.findall(r"\[erratum (\d+)\]", row[1])) - wording:
            named = set(re.findall(r"`(tests/\w+\.py::\w+)`", row[4]))
            assert named & tests[number], row[0]
            assert {test for test in named if "test_errata" in test} <= tests[number], row[0]


def test_every_appendix_has_its_place():
    for heading in ("Appendix A", "Appendix B", "Appendix C", "Appendix D", "Appendix E"):
        assert re.search(rf"^## {heading}: ", PAGE, re.MULTILINE)
