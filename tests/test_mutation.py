"""The mutation run: the same draw for the same seed, and a mutant that a test notices is told from one that none does."""

import json
import subprocess
import sys
import tomllib

import pytest

from .helpers import ROOT
from .mutation.__main__ import DECLARED
from .mutation.draw import candidates, draw

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
    files = {"rne/__init__.py": "", "rne/basics/__init__.py": "", "rne/basics/rectangle.py": SOURCE}
    files |= {"tests/__init__.py": "", "tests/test_rectangle.py": TEST, "pyproject.toml": ""}
    for name, text in files.items():
        (tmp_path / "tree" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "tree" / name).write_text(text)
    subprocess.run(["git", "init", "-q"], cwd=tmp_path / "tree", check=True)
    return tmp_path / "tree"


def test_the_same_seed_draws_the_same_mutants():
    first, second, other = (draw(ROOT, 6, seed, ("trajectories", "robot")) for seed in (7, 7, 8))
    assert first == second != other
    assert [m.file.split("/")[1] for m in first] == ["trajectories"] * 3 + ["robot"] * 3


def test_annotations_and_texts_are_left_alone(tree):
    assert {m.line for m in draw(tree, 16, 0, ("basics",))} == {1, 3, 7}  # 1: of the defaults


def test_those_declared_equivalent_are_in_the_tree():
    declared = tomllib.loads(DECLARED.read_text(encoding="utf-8"))["equivalent"]
    found = {f: {m.key() for ms in candidates(ROOT, f).values() for m in ms} for f in {d["file"] for d in declared}}
    assert [d for d in declared if (d["file"], d["source"], d["old"], d["new"]) not in found[d["file"]]] == []


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
