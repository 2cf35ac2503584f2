"""The mutation run: the same draw for the same seed, and a mutant that a test notices is told from one that none does."""

import json
import subprocess
import sys

from .helpers import ROOT
from .mutation.draw import draw

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


def test_the_same_seed_draws_the_same_mutants():
    first, second = (draw(ROOT, 16, 7, ("basics", "robot")) for _ in range(2))
    assert first == second != draw(ROOT, 16, 8, ("basics", "robot"))
    assert [m.file.split("/")[1] for m in first] == ["basics"] * 8 + ["robot"] * 8


def test_a_mutant_that_a_test_notices_is_killed_and_one_that_none_runs_survives(tmp_path):
    files = {"rne/__init__.py": "", "rne/basics/__init__.py": "", "rne/basics/rectangle.py": SOURCE}
    files |= {"tests/__init__.py": "", "tests/test_rectangle.py": TEST, "pyproject.toml": ""}
    for name, text in files.items():
        (tmp_path / "tree" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "tree" / name).write_text(text)
    subprocess.run(["git", "init", "-q"], cwd=tmp_path / "tree", check=True)
    places = ["--root", tmp_path / "tree", "--cache", tmp_path / "cache", "--results", tmp_path / "results.json"]
    command = [sys.executable, "-m", "tests.mutation", *places, "--number", "64"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    rows = {(r["old"], r["new"]): r for r in json.loads((tmp_path / "results.json").read_text())}
    product = rows["return width * height", "return width / height"]
    assert (product["kind"], product["test"]) == ("killed", "tests/test_rectangle.py::test_area")
    assert rows["return not True", "return True"]["kind"] == "survived"
    assert {r["line"] for r in rows.values()} == {1, 3, 7}
