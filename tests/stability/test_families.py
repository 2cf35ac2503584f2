"""In every family the error is within a few n eps of what the robot's own numbers allow, or an error says why not."""

import subprocess
import sys

import pytest

import rne
from rne.model.robots.generators import straight_chain

from ..helpers import ROOT
from .families import FAMILIES, case, straight
from .structured import WRONG, measure

CASES = [pytest.param(one, id=one.name) for family in FAMILIES.values() for one in family()]


@pytest.mark.parametrize("one", CASES)
def test_error_is_within_the_structured_condition(one):
    for quantity, measured in measure(one).items():
        assert measured.error <= WRONG or measured.warned, quantity
        assert measured.ratio <= 10 * one.model.n, quantity


def test_a_hundred_links_in_a_straight_line():
    one = case("straight chain, n = 100", straight_chain(100), straight(100), count=1)
    for quantity, measured in measure(one, perturbations=1).items():
        assert measured.ratio <= 10 * 100, quantity
        assert not measured.refused


def test_a_light_tip_loses_nothing():
    """A condition number of M that is only a matter of scale costs no digit, and diagnose knows it."""
    light = [one for one in FAMILIES["tip masses"]() if "1e-" in one.name]
    assert light
    for one in light:
        assert rne.diagnose(one.model, one.q).digits.min() >= 11
        for quantity, measured in measure(one, ("forward dynamics",), perturbations=1).items():
            assert measured.error <= 1e-11, quantity


def test_quick_table_changes_no_file():
    before = (ROOT / "docs" / "stability.md").read_bytes()
    command = [sys.executable, "-m", "benchmarks.stability", "--quick"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "| base far away | inverse dynamics |" in run.stdout
    assert (ROOT / "docs" / "stability.md").read_bytes() == before


def test_the_page_opens_with_the_limits():
    page, limits = ((ROOT / path).read_text(encoding="utf-8") for path in ("docs/stability.md", "benchmarks/limits.md"))
    assert page.startswith(limits.strip() + "\n\n| family |")
