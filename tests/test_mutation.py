"""The mutation run: the same draw for the same seed, and a mutant that a test notices is told from one that none does."""

import json
import subprocess
import sys

import pytest

from .helpers import ROOT
from .mutation.__main__ import table
from .mutation.draw import ROOT_FILES, candidates, draw, folders, shares

SOURCE = """def area(width: int = 2, height: int = 3) -> int:
    \"\"\"Area of 1 rectangle.\"\"\"
    return width * height


def unused() -> bool:
    return not True
"""
TEST = """from rne.basics.rectangle import area


def test_area():
    assert area(5, 7) == 35
"""


MUTANTS = [("return width * height", "return width / height"), ("return not True", "return True")]


@pytest.fixture
def tree(tmp_path):
    files = {"rne/__init__.py": "LIMIT = 1, 2, 3, 4\n", "rne/basics/__init__.py": "", "rne/basics/rectangle.py": SOURCE}
    files |= {"tests/__init__.py": "", "tests/test_rectangle.py": TEST, "pyproject.toml": ""}
    for name, text in files.items():
        (tmp_path / "tree" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "tree" / name).write_text(text)
    subprocess.run(["git", "init", "-q"], cwd=tmp_path / "tree", check=True)
    return tmp_path / "tree"


def test_the_same_seed_draws_the_same_mutants(tree):
    first, second, other = (draw(tree, 6, seed) for seed in (7, 7, 8))
    assert first == second != other


def test_folders_have_mutants_in_proportion_to_their_code_and_at_least_some():
    assert shares({"large": 600, "middle": 300, "small": 100, "tiny": 2}, 100, 5) == {
        "large": 59, "middle": 29, "small": 10, "tiny": 2
    }  # fmt: skip
    assert shares({"large": 600, "small": 30}, 40, 16) == {"large": 24, "small": 16}
    assert shares({"large": 3, "small": 1}, 40, 16) == {"large": 3, "small": 1}


def test_every_folder_is_drawn_from():
    of_package = {path.name for path in (ROOT / "rne").iterdir() if any(path.rglob("*.py"))}
    assert set(folders(ROOT)) == of_package | {ROOT_FILES}


def test_a_draw_of_one_folder_is_its_part_of_all(tree):
    every = draw(tree, 12, 1, least=4)
    assert {m.folder for m in every} == {"basics", ROOT_FILES}
    assert draw(tree, 12, 1, least=4, only="basics") == [m for m in every if m.folder == "basics"]


def test_annotations_and_texts_are_left_alone(tree):
    lines = {m.line for ms in candidates(tree, "rne/basics/rectangle.py").values() for m in ms}
    assert lines == {1, 3, 7}  # 1: of the defaults


CHANGES = {
    "return f(a, b)": {"swapped arguments": {"f(b, a)"}},
    "return f(a, k=b)": {"dropped keyword": {"f(a)"}},
    "return zip(a, b, strict=True)": {"swapped arguments": {"zip(b, a, strict=True)"}},
    "return a + b": {"operator": {"a - b"}, "dropped term": {"a", "(b)"}},
    "return a - b": {"operator": {"a + b"}, "dropped term": {"a", "-(b)"}},
    "return a and b": {"condition": {"a or b"}, "dropped term": {"a"}},
    "return a if b else 0.5": {"negated condition": {"a if (not (b)) else 0.5"}, "constant": {"a if b else 1.0"}},
    "return a[:b]": {"index": {"a[:]"}},
    "return -a": {"sign": {"a"}},
    "return a <= b": {"comparison": {"a > b"}},
    "return a.max()": {"name": {"a.min()"}},
    "a.append(b)": {"removed statement": {"pass"}},
    "a[b] = k": {"removed statement": {"pass"}, "index": {"a[b - 1] = k"}},
    "raise a": {"removed statement": {"pass"}},
}


@pytest.mark.parametrize("line", CHANGES, ids=str)
def test_kinds_of_changes(tmp_path, line):
    (tmp_path / "f.py").write_text(f"def g(a, b, k):\n    {line}\n")
    found = {}
    for mutant in (m for ms in candidates(tmp_path, "f.py").values() for m in ms):
        found.setdefault(mutant.change, set()).add(mutant.new.removeprefix("return "))
    assert found == CHANGES[line]


def test_the_table_counts_a_mutant_that_ends_in_no_time_as_killed():
    common = {"folder": "basics", "file": "rne/basics/f.py", "line": 1, "change": "sign", "old": "-a", "new": "a"}
    kinds = ["killed"] * 5 + ["timeout", "import", "survived"]
    rows = [common | {"kind": kind, "source": "return -a", "test": "a reason"} for kind in kinds]
    lines = table(rows).splitlines()
    assert lines[1].split() == ["basics", "5", "1", "1", "1", "87.5%"]
    assert lines[2].split() == ["all", "5", "1", "1", "1", "87.5%"]


def test_a_test_notices_the_mutant_of_what_it_runs_alone(tree):
    found = {(m.old, m.new): m for ms in candidates(tree, "rne/basics/rectangle.py").values() for m in ms}
    for mutant, is_noticed in zip(MUTANTS, (True, False), strict=True):
        names = {}
        exec(found[mutant].broken(tree), names)
        assert (names["area"](5, 7) != 35) == is_noticed


@pytest.mark.long
@pytest.mark.parametrize("kinds", [("killed",), ("killed", "survived")], ids=len)
def test_a_mutant_that_a_test_notices_is_killed_and_one_that_none_runs_survives(tree, tmp_path, kinds):
    chosen = MUTANTS[: len(kinds)]
    again = [{"file": "rne/basics/rectangle.py", "source": old, "old": old, "new": new} for old, new in chosen]
    (tmp_path / "again.json").write_text(json.dumps([row | {"kind": "survived"} for row in again]))
    places = ["--root", tree, "--cache", tmp_path / "cache", "--results", tmp_path / "results.json"]
    command = [sys.executable, "-m", "tests.mutation", "--mutants", tmp_path / "again.json", *places]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    rows = {(r["old"], r["new"]): r for r in json.loads((tmp_path / "results.json").read_text())}
    assert [rows[mutant]["kind"] for mutant in chosen] == list(kinds)
    assert rows[MUTANTS[0]]["test"] == "tests/test_rectangle.py::test_area"
