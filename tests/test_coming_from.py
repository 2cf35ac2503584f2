"""docs/coming-from: our calls run, and Pinocchio's return the same numbers."""

import importlib.util
import re

import numpy as np
import pytest

from .helpers import ROOT
from .test_documentation import blocks

PAGES = sorted((ROOT / "docs" / "coming-from").glob("*.md"))
RTOL, ATOL = 1e-9, 1e-10  # inverses and derivatives of the UR5, whose largest entries are some hundred


def tables(text):
    """Rows of each table by the package of its page: (what, their calls, our calls)."""
    found, heading = {}, ""
    for line in text.splitlines():
        if line.startswith("# Coming from "):
            heading = line.removeprefix("# Coming from ")
        elif line.startswith("| ") and not line.startswith("| you want"):
            what, theirs, ours = (cell.strip() for cell in line.strip("| ").split(" | "))
            found.setdefault(heading, []).append((what, calls(theirs), calls(ours)))
    return found


def calls(cell):
    """The code of a cell, without the targets of links."""
    return re.findall(r"`([^`]+)`", re.sub(r"\{\w+(?::\w+)?\}`[^`]+`", "", cell))


TABLES = tables("\n".join(page.read_text(encoding="utf-8") for page in PAGES))
WITH_JAX = importlib.util.find_spec("jax") is not None
THEIR_NAMES = {"jacr", "jacp"}  # of MuJoCo, in our column


@pytest.fixture(scope="module")
def names():
    """The variables of the pages, those that need Pinocchio included where it is installed."""
    variables = {}
    for code, _ in (block for page in PAGES for block in blocks(page)):
        if "pinocchio" in code:
            pytest.importorskip("pinocchio", reason="Pinocchio is not installed, which the page compares with")
        if "casadi" in code and importlib.util.find_spec("casadi") is None:
            continue
        if re.search(r"\bimport jax\b|\bin_jax\b|\bjax\.", code) and not WITH_JAX:
            continue
        exec(code, variables)
    return variables


def value(code, variables):
    """What the last call returns; the others are run before it, in a copy of the variables."""
    scope = dict(variables)
    for line in code[:-1]:
        exec(line, scope)
    return eval(code[-1], scope)


def test_pinocchio_returns_what_our_calls_return(names):
    for what, theirs, ours in TABLES["Pinocchio"]:
        if what == "a motion":
            continue  # no single call
        expected, found = value(theirs, names), value(ours, names)
        if isinstance(found, list):
            assert found == expected, what
        else:
            np.testing.assert_allclose(found, expected, rtol=RTOL, atol=ATOL, err_msg=what)


def test_our_calls_run(names):
    for package, rows in TABLES.items():
        if package == "CasADi and adam" and importlib.util.find_spec("casadi") is None:
            continue
        if package.startswith("JAX") and not WITH_JAX:
            continue
        for what, _, ours in rows:
            for code in set(ours) - THEIR_NAMES:
                assert value([code], names) is not None, (package, what)


def test_no_package_is_without_its_table():
    assert {name: len(rows) > 10 for name, rows in TABLES.items()} == dict.fromkeys(
        ["Pinocchio", "Robotics Toolbox for Python", "MuJoCo", "CasADi and adam", "JAX and frax", "MATLAB"], True
    )
