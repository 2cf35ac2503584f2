"""In every family the error is within a few n eps of what the robot's own numbers allow, or an error says why not."""

import subprocess
import sys

import numpy as np
import pytest

import rne

from ..helpers import EPS, ROOT, kept
from ..random_robots import straight_chain
from .families import FAMILIES, case, straight
from .structured import WRONG, Measured, measure

MANY_JOINTS = 6  # from which 50 digits take long; smaller robots of the same families state the law
FARTHEST = {one.name for family in FAMILIES.values() for *_, one in [family()]}  # of six joints, these do
SINGULAR = {"growing links, n = 20"}  # the tip is 10^30 times as heavy for its joint as the first rod: no digit is left
METHODS = ("forward dynamics by M", "forward dynamics by articulated bodies", "forward dynamics, compiled")


def takes_long(one):
    return one.model.n > MANY_JOINTS or (one.model.n == MANY_JOINTS and one.name not in FARTHEST)


CASES = [
    pytest.param(one, id=one.name, marks=[pytest.mark.long] * (takes_long(one) or k % 2 == 1))
    for family in FAMILIES.values()
    for k, one in enumerate(family())
]


def check(one, perturbations):
    for quantity, measured in measure(one, perturbations=perturbations).items():
        assert measured.error <= WRONG or measured.warned, quantity
        assert measured.refused == (one.name in SINGULAR and quantity in METHODS), quantity
        assert measured.ratio <= 10 * one.model.n, quantity


@pytest.mark.parametrize("states", kept([3, None], [3]))
@pytest.mark.parametrize("one", CASES)
def test_error_is_within_the_structured_condition(one, states):
    """By one perturbation: more could only raise the condition, and so what is allowed."""
    check(one._replace(q=one.q[:states], qd=one.qd[:states], qdd=one.qdd[:states]), perturbations=1)


@pytest.mark.long
def test_a_hundred_links_in_a_straight_line():
    check(case("straight chain, n = 100", straight_chain(100), straight(100), count=1), perturbations=1)


def test_only_what_leaves_no_digit_may_be_refused():
    """Of all other cases a refusal counts as an infinite error."""
    assert Measured(0.0, 1 / EPS, refused=True).ratio == 0
    assert Measured(0.0, 0.1 / EPS, refused=True).ratio == np.inf


def test_a_light_tip_loses_nothing():
    """A condition number of M that is only a matter of scale costs no digit, and diagnose knows it."""
    light = [one for one in FAMILIES["tip masses"]() if "1e-" in one.name]
    assert light
    for one in light:
        assert rne.dynamics.diagnose(one.model, one.q).digits.min() >= 11
        for quantity, measured in measure(one, ("forward dynamics",), perturbations=1).items():
            assert measured.error <= 1e-11, quantity


@pytest.mark.long
def test_quick_table_changes_no_file():
    pages = sorted((ROOT / "docs" / "stability").glob("*.md"))
    before = [page.read_bytes() for page in pages]
    command = [sys.executable, "-m", "benchmarks.stability", "--quick"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "| base far away | inverse dynamics |" in run.stdout
    assert pages
    assert [page.read_bytes() for page in pages] == before
