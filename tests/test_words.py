"""Words of the field in what users and developers read: docstrings, comments, messages, pages."""

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
INSTEAD = {  # phrases that a fluent reader has to decode: the field's words
    r"\b(un)?told\b": "known, identifiable, significantly different from, named, called with",
    r"(does|do|did) not tell\b": "cannot be identified, is not significant",
    r"\b(cannot|can't) (be )?(told|tell) (apart|from)": "cannot be distinguished, has the same effect",
    r"\bbeside Pinocchio": "relative to Pinocchio, compared with Pinocchio",
    r"(?<!also )\bheld[- ]out\b": "validation error, validation block; the glossary's definition says 'also held-out'",
    r"\bthe end was reached\b": "completed",
    r"\bin no other package\b": "No other package combines",
    r"\bmends?\b": "corrects, repairs",
    r"\bwhat is left(?! out\b| to\b)": "residuals, remainder",
    r"\badds them up\b": "integrates them",
    r"\bunless you decline\b": "unless you disable",
    r"\btaken up by the hand\b": "picked up",
    r"\bjoints that yield\b": "flexible joints",
    r"\bnoise explains \d": ", noise ... %",
    r"\bare essential: with these\b": "suffice, the others change the validation error by",
    r"\bpoles without sampling\b": "continuous-time poles",
}
BAD = re.compile("|".join(f"(?:{pattern})" for pattern in INSTEAD), re.IGNORECASE)
RIDDLE = re.compile(r"(What|Whether|How|As|Of|That|Those|The same)\b")  # a docstring begins with the noun or the verb
# A file is parsed if its text, adjacent literals joined, has such words anywhere.
BETWEEN_LITERALS = re.compile(r"""["']\s*\w?["']""")
OPENED = re.compile(rf'"""\s*{RIDDLE.pattern}')


def sources(*folders):
    return [file for folder in folders for file in sorted((ROOT / folder).rglob("*.py"))]


def pages():
    found = [
        ROOT / "README.md",
        *sorted((ROOT / "docs").rglob("*.md")),
        *sorted((ROOT / "docs/tutorials").glob("*.py")),
    ]
    return [file for file in found if "_build" not in file.parts]


def prose(text, is_python):
    """Numbers of lines and texts: of Python the comments and the strings with a blank, f-strings without their fields."""
    if not is_python:
        return list(enumerate(text.splitlines(), 1))
    comments = tokenize.generate_tokens(io.StringIO(text).readline)
    found = [(token.start[0], token.string) for token in comments if token.type == tokenize.COMMENT]
    strings = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Constant)]
    strings = [(node.lineno, node.value) for node in strings if isinstance(node.value, str) and " " in node.value]
    return found + [(first + k, line) for first, string in strings for k, line in enumerate(string.split("\n"))]


def findings(files):
    texts = ((file, file.read_text(encoding="utf-8")) for file in files)
    suspect = ((file, text) for file, text in texts if BAD.search(BETWEEN_LITERALS.sub("", text)))
    lines = ((file, k, line) for file, text in suspect for k, line in prose(text, file.suffix == ".py"))
    return [f"{file.relative_to(ROOT)}:{k}: {found[0]}" for file, k, line in lines for found in BAD.finditer(line)]


def first_lines(text):
    if not OPENED.search(text):
        return []
    documented = ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef
    nodes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, documented)]
    return [(node.body[0].lineno, ast.get_docstring(node).split("\n")[0]) for node in nodes if ast.get_docstring(node)]


def test_sources_are_written_in_the_words_of_the_field():
    assert findings(sources("rne", "benchmarks", "examples")) == []


def test_pages_are_written_in_the_words_of_the_field():
    assert findings(pages()) == []


def test_docstrings_begin_with_what_is_returned_or_done():
    found = [
        f"{file.relative_to(ROOT)}:{k}: {line}"
        for file in sources("rne", "benchmarks", "examples")
        for k, line in first_lines(file.read_text(encoding="utf-8"))
        if RIDDLE.match(line)
    ]
    assert found == []


@pytest.mark.parametrize(
    "line", ["# none is told from zero", 'x = f"errors held out: {y}"', '"""Numbers beside Pinocchio\'s."""']
)
def test_an_old_phrase_is_found(line):
    assert any(BAD.search(text) for _, text in prose(line, is_python=True))


@pytest.mark.parametrize("line", ["told = held_out(x)", '"""What is left out."""', 'error = f"{told} of {count}"'])
def test_names_and_plain_english_are_not(line):
    assert not any(BAD.search(text) for _, text in prose(line, is_python=True))
