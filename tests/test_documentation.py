"""The documentation: its examples run and print what they say, every public name has a page, docstrings are complete."""

import importlib.util
import inspect
import re
import subprocess
import sys

import pytest
from numpydoc.validate import validate

import rne
from rne.identification.diagnosis.hypotheses import EVENTS, GEARS, MENDED_BY

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


@pytest.mark.long  # test_architecture.py runs the README's example
@pytest.mark.parametrize("page", WITH_CODE, ids=lambda page: str(page.relative_to(DOCS)))
def test_examples_of_a_page_run_and_print_what_it_says(page, tmp_path):
    """One process per page, with warnings as errors: the blocks follow each other as a reader runs them.

    Python warns of the spelling of other packages where it compiles them at their first import, which pip and uv may leave
    it; in the page's own blocks, ruff refuses the same.
    """
    if any("import pinocchio" in code for code, _ in blocks(page)):
        pytest.importorskip("pinocchio", reason="Pinocchio is not installed, which an example compares with")
    if any("import casadi" in code or ".to_casadi(" in code for code, _ in blocks(page)):
        pytest.importorskip("casadi", reason="CasADi is not installed, which an example uses")
    if any("import jax" in code for code, _ in blocks(page)):
        pytest.importorskip("jax", reason="JAX is not installed, in which an example runs")
    program = "".join(f"{code}\nprint({END_OF_BLOCK!r}, end='')\n" for code, _ in blocks(page))
    (tmp_path / "page.py").write_text(program, encoding="utf-8")
    spelling = "-W", "ignore::SyntaxWarning", "-W", "ignore:invalid escape sequence"
    command = [sys.executable, "-W", "error", *spelling, "page.py"]
    run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert run.stderr == ""
    assert run.stdout.split(END_OF_BLOCK)[:-1] == [said for _, said in blocks(page)]


def load_public():
    """The list of public names that the reference is built from."""
    spec = importlib.util.spec_from_file_location("public", DOCS / "_extensions" / "public.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PUBLIC = load_public()


def test_charts_that_are_too_wide_for_a_phone_keep_a_legible_width():
    """8 points are 9 pixels at 81 pixels an inch; a chart with a narrow drawing shows that instead."""
    pytest.importorskip("sphinx")
    spec = importlib.util.spec_from_file_location("charts", DOCS / "_extensions" / "charts.py")
    charts = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(charts)
    assert charts.legible(DOCS / "pictures" / "control_errors.png") == 0  # 5 inches
    assert charts.legible(DOCS / "benchmarks" / "growth.png") == round(9.2 * 81)
    assert (DOCS / "pictures" / "speed_and_accuracy_narrow.png").is_file()


NOT_ASKED = {
    "ES01": "the summary and the sections say it",
    "SA01": "links stand where they are needed",
    "SS05": "takes plural nouns, such as Torques, for verbs",
}
REFERENCE = re.compile(r"those of `rne\.(Robot\.\w+)`(?: without `(\w+)`)?, with the model first")
MADE_BY = re.compile(r"made by `(\w+)`.* attributes are (?:its|their|the) arguments")
RESULT = re.compile(r"\bby `rne\.([\w.]+)`")
IN_THE_REFERENCE = {"PR01", "RT01", "EX01"}  # parameters, result, example


def test_every_public_name_is_in_the_reference_once():
    pages = "".join(page.read_text(encoding="utf-8") for page in (DOCS / "reference").glob("*.md"))
    listed = [line.strip() for line in pages.splitlines() if re.fullmatch(r"   [\w.]+", line)]
    assert sorted(listed) == sorted(PUBLIC.names())


def test_lists_at_the_head_of_a_class_hold_its_public_members_once():
    lists = PUBLIC.member_lists()
    assert {"rne.Robot", "rne.Scene", "rne.Trajectory"} <= lists.keys()
    for name, groups in lists.items():
        listed = [member for _, members in groups for member in members]
        expected = PUBLIC.vars_of(PUBLIC.resolve(name.removeprefix("rne.")))
        assert sorted(listed) == sorted(m for m in expected if f"{name.rpartition('.')[2]}.{m}" not in PUBLIC.INTERNAL)


def test_every_page_of_the_reference_and_every_tutorial_is_in_the_sidebar():
    front = (DOCS / "index.md").read_text(encoding="utf-8")
    assert [p.stem for p in (DOCS / "reference").glob("*.md") if f"\nreference/{p.stem}\n" not in front] == []
    index = (DOCS / "tutorials" / "index.rst").read_text(encoding="utf-8")
    for tutorial in (DOCS / "tutorials").glob("[0-9]*.py"):
        assert f"    tutorials/{tutorial.stem}.py\n" in index
        assert f"    {tutorial.stem}\n" in index


GENERATED_TABLE = re.compile(r"<!-- table: .*?<!-- end of table -->", re.DOTALL)
LONG = {"concordance.md", "errata.md"}  # lists to look things up in
WORDS = 1500  # some five screens of a page 1280 pixels wide, examples included


def test_no_page_is_longer_than_five_screens():
    """Tables that benchmarks write are not counted: those of many rows scroll in a frame."""
    words = {page.name: len(GENERATED_TABLE.sub("", page.read_text(encoding="utf-8")).split()) for page in PAGES}
    assert len(words) > 80
    assert {name: count for name, count in words.items() if count > WORDS and name not in LONG} == {}


def test_every_cause_of_residuals_is_on_the_page_that_says_what_to_do():
    page = (DOCS / "when-it-does-not-fit.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([^|]+) \|", page.partition("## Causes by name")[2].partition("\n## ")[0], re.MULTILINE)
    assert {*EVENTS, *GEARS, *MENDED_BY} - {name for row in rows for name in row.split(", ")} == set()


def complaints(name):
    """What numpydoc finds in a docstring, less what is not asked for, by code."""
    found = validate(f"rne.{name}")
    errors = {code: message for code, message in found["errors"] if code not in NOT_ASKED}
    thing, (owner, _, member) = PUBLIC.resolve(name), name.rpartition(".")
    if PUBLIC.is_property(name) or f".{member}(" in examples(owner) or (inspect.isclass(thing) and examples(name)):
        errors.pop("EX01", None)  # its class has an example, or the function that finds it
    method = REFERENCE.search(" ".join((inspect.getdoc(thing) or "").split()))
    if method and call_of(thing) == call_of(PUBLIC.resolve(method[1]), without=method[2]):
        errors = {code: message for code, message in errors.items() if code not in IN_THE_REFERENCE}
    maker = MADE_BY.search(" ".join((inspect.getdoc(thing) or "").split())) if inspect.isclass(thing) else None
    if maker and not complaints(f"{name.rpartition('.')[0]}.{maker[1]}"):  # the function has parameters and example
        errors = {code: message for code, message in errors.items() if code not in IN_THE_REFERENCE}
    if inspect.isclass(thing) and "PR01" in errors:
        documented = documented_names(thing)
        made_here = issubclass(thing, BaseException) or name in ("kernels.Kernel", "control.Reference")
        if made_here or (
            documented and {name for name in inspect.signature(thing).parameters if name[0] != "_"} <= documented
        ):
            del errors["PR01"]  # fields are attributes; errors and kernels are made by the package, a protocol by none
    return errors


def examples(name):
    """Examples of a class, and of the function whose result it is."""
    if not inspect.isclass(thing := PUBLIC.resolve(name)):
        return ""
    text = inspect.getdoc(thing) or ""
    found = RESULT.search(text.partition("\n\n")[0])
    texts = [text] + ([inspect.getdoc(PUBLIC.resolve(found[1])) or ""] if found else [])
    return "".join(text.partition("\nExamples\n--------\n")[2] for text in texts)


def call_of(function, without=None):
    """Names, kinds and defaults of the arguments behind the model or the robot; `parameters` are a Robot's alone."""
    arguments = list(inspect.signature(function).parameters.values())[1:]
    return [(a.name, a.kind, a.default) for a in arguments if a.name not in ("parameters", without)]


def documented_names(owner):
    """Names under Parameters and Attributes of a class's docstring."""
    text = inspect.getdoc(owner)
    return {name for names in re.findall(r"^([\w, ]+?)(?: : .+)?$", text, re.MULTILINE) for name in names.split(", ")}


def test_docstrings_of_public_names_are_complete():
    found = {name: complaints(name) for name in [*PUBLIC.names(), *PUBLIC.members()]}
    assert {name: said for name, said in found.items() if said} == {}


def test_a_poor_docstring_is_found(monkeypatch):
    monkeypatch.setattr(rne.Robot.mass_matrix, "__doc__", "M(q)")
    assert {"PR01", "RT01", "EX01"} <= complaints("Robot.mass_matrix").keys()


def test_a_class_that_a_function_makes_needs_that_function_documented(monkeypatch):
    assert complaints("control.PID") == {}
    monkeypatch.setattr(rne.control.pid, "__doc__", "PID control.")
    assert {"PR01", "EX01"} <= complaints("control.PID").keys()


def test_a_result_without_an_example_needs_one_of_its_function(monkeypatch):
    assert complaints("Identification") == complaints("Identification.predict") == {}
    monkeypatch.setattr(rne.identify, "__doc__", rne.identify.__doc__.replace(".predict(", ".check("))
    assert complaints("Identification.predict").keys() == {"EX01"}
    monkeypatch.setattr(rne.identify, "__doc__", "Identify.")
    assert complaints("Identification").keys() == {"EX01"}


def test_a_function_that_refers_to_a_method_is_called_like_it(monkeypatch):
    assert complaints("dynamics.mass_matrix") == {}
    text = rne.dynamics.mass_matrix.__doc__.replace("Robot.mass_matrix", "Robot.inverse_dynamics")
    monkeypatch.setattr(rne.dynamics.mass_matrix, "__doc__", text)
    assert complaints("dynamics.mass_matrix").keys() == IN_THE_REFERENCE
