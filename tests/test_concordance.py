"""docs/concordance.md: every place, test and command that it names exists, and the commands run."""

import ast
import contextlib
import functools
import importlib
import io
import re
import shlex

import pytest

from rne.__main__ import main, parser

from .conftest import COLLECTED
from .helpers import ROOT
from .test_benchmarks import BENCHMARKS

PAGE = (ROOT / "docs" / "concordance.md").read_text(encoding="utf-8")
THESIS = (ROOT / "docs" / "thesis.md").read_text(encoding="utf-8")
ERRATA = (ROOT / "docs" / "errata.md").read_text(encoding="utf-8")
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
TESTS = quoted("test")
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
    assert len(ROWS) > 100


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
    assert {name for name in names if names.count(name) > 1} <= {"Payload"}  # left out of chapter 6; in the data sheet


@pytest.mark.parametrize(("text", "target"), PLACES, ids=lambda x: x)
def test_every_place_exists(text, target):
    path, _, name = text.partition("::")
    assert target == f"../{path}"
    assert (ROOT / path).is_file()
    if name:
        module = path.removesuffix(".py").replace("/", ".")
        found = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
        assert not callable(found) or found.__module__ == module  # where it is written, not where it is imported


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


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_runs(command, monkeypatch):
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


def test_every_figure_of_the_page_of_experiments_has_its_row():
    numbers = re.findall(r"^### Figure (\d\.\d+): ", THESIS, re.MULTILINE)
    assert len(numbers) == 20
    rows = [row[0] for row in ROWS]
    assert [number for number in numbers if f"Figure {number}" not in rows] == []


def test_no_number_of_a_figure_is_passed_over():
    """6.1 to 6.16 and 7.1 to 7.5, those of unknown content included."""
    named = [row[0] for row in ROWS if row[0].startswith("Figure")]
    numbers = re.findall(r"\d\.\d+", " ".join(named))
    assert sorted(numbers) == sorted([*(f"6.{k}" for k in range(1, 17)), *(f"7.{k}" for k in range(1, 6))])


def test_every_erratum_is_named():
    numbers = re.findall(r"^## (\d+)\. ", ERRATA, re.MULTILINE)
    assert numbers
    named = re.findall(r"\[erratum (\d+)\]\(errata\.md\)", PAGE)
    assert set(named) == set(numbers)


def test_a_row_with_an_erratum_names_its_tests():
    """At least one test of the entry, and none but the entry's own from tests/test_errata.py."""
    entries = re.split(r"^## ", ERRATA, flags=re.MULTILINE)[1:]
    tests = {entry.split(".")[0]: set(re.findall(r"`(tests/\w+\.py::\w+)`", entry)) for entry in entries}
    for row in ROWS:
        for number in re.findall(r"\[erratum (\d+)\]", row[1]):
            named = set(re.findall(r"`(tests/\w+\.py::\w+)`", row[4]))
            assert named & tests[number], row[0]
            assert {test for test in named if "test_errata" in test} <= tests[number], row[0]


def test_every_appendix_and_table_has_its_place():
    for heading in ("Appendix A", "Appendix B", "Appendix C", "Appendix D"):
        assert re.search(rf"^## {heading}: ", PAGE, re.MULTILINE)
    assert {"Table 4.1", "Table 7.1"} <= {row[0] for row in ROWS}
