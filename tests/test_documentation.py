"""The documentation: its examples run and print what they say, every public name has a page, docstrings are complete."""

import re
import subprocess
import sys

import pytest

from .helpers import ROOT

DOCS = ROOT / "docs"
GENERATED = ("generated", "tutorials")
PAGES = sorted(p for p in DOCS.rglob("*.md") if p.relative_to(DOCS).parts[0] not in GENERATED)
CODE = re.compile(r"^```python\n(.*?)^```\n(?:\n*^```text\n(.*?)^```$)?", re.DOTALL | re.MULTILINE)


def blocks(page):
    """(code, printed output or None) of a page, in order."""
    return CODE.findall(page.read_text(encoding="utf-8"))


WITH_CODE = [page for page in PAGES if blocks(page)]


END_OF_BLOCK = "\n<end of block>\n"


@pytest.mark.parametrize("page", WITH_CODE, ids=lambda page: str(page.relative_to(DOCS)))
def test_examples_of_a_page_run_and_print_what_it_says(page, tmp_path):
    """One process per page, with warnings as errors: the blocks follow each other as a reader runs them."""
    if any("import pinocchio" in code for code, _ in blocks(page)):
        pytest.importorskip("pinocchio", reason="Pinocchio is not installed, which an example compares with")
    program = "".join(f"{code}\nprint({END_OF_BLOCK!r}, end='')\n" for code, _ in blocks(page))
    (tmp_path / "page.py").write_text(program, encoding="utf-8")
    command = [sys.executable, "-W", "error", "page.py"]
    run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert run.stderr == ""
    assert run.stdout.split(END_OF_BLOCK)[:-1] == [said for _, said in blocks(page)]
