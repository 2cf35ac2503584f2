"""Verdicts of the thesis's page: on either side of each criterion they say something else."""

import numpy as np
import pytest

from examples.thesis import verdicts as v

NEVER = np.inf
BOTH_SIDES = [  # a verdict, figures with which it holds, figures with which it does not
    (v.not_held, [([0.24, 0.29],), ([1.0],)], [([0.24, 1.01],), ([NEVER],)]),
    (v.held, [(1e-12, 10), (1e-6, 10)], [(1.1e-6, 10), (np.nan, 10)]),
    (v.collapses, [(4.242, 5.418), (3.0, 5.0)], [(2.9, 4), (5.1, 5.5), (4, 6.1), (NEVER, NEVER)]),
    (v.energy_is_constant, [(2e-4, 370), (1e-4, -1)], [(0.04, 370), (1, 0.1)]),
    (v.swings_part, [(5.7, 10)], [(NEVER, 10), (10.1, 10)]),
    (v.settles, [([2.814, 2.362, 3.002],)], [([2.2, 3],), ([3, 3.8],), ([3, NEVER],)]),
    (v.lyapunov_falls, [(0, 1e-15), (8e-16, 1e-9)], [(1e-15, 0), (0, 2e-9), (0, np.nan)]),
    (v.sampling, [([0.4, 9], [1e4, 2e6], 1.3e-4)], [([0.4, 11], [1e6], 1.3e-4), ([0.4], [1e6, 9e3], 1.3e-4)]),
    (v.grows, [(12.3, 12.318)], [(11.549, 12.318), (12.5, 12.318), (-1.0, -1.0)]),
    (
        v.no_difference,
        [([[2.8, 2.7], [2.4, 2.3]], [2.8, 2.4])],
        [([[2.8], [2.7]], [2.8, 2.4]), ([[2.0], [2.4]], [2.8, 2.4]), ([[2.8], [NEVER]], [2.8, 2.4]), ([[NEVER]], [3])],
    ),
    (v.other_motions, [([0.18, 0.7], [4e-8])], [([0.18, 0.04], [4e-8]), ([0.18, 0.7], [4e-8, 0.002])]),
    (v.same_coefficients, [(2e-16, 54), (1e-9, 54)], [(2e-9, 54), (np.nan, 54)]),
    (v.density, [([1493.5, 1516.1], 1500)], [([1500, 1531], 1500), ([1469], 1500)]),
    (v.reach, [(0.810, 0.810), (0.8109, 0.810)], [(0.8111, 0.810), (0.45, 0.810)]),
]


@pytest.mark.parametrize(("verdict", "good", "bad"), BOTH_SIDES, ids=lambda x: getattr(x, "__name__", ""))
def test_a_verdict_depends_on_its_figures(verdict, good, bad):
    for figures in good:
        assert verdict(*figures).holds
        assert str(verdict(*figures)).startswith("Confirmed. Criterion: ")
    for figures in bad:
        assert not verdict(*figures).holds
        assert str(verdict(*figures)).startswith("Not confirmed. Criterion: ")


def test_a_verdict_says_what_was_found():
    assert str(v.settles([2.814, 2.362, NEVER])) == (
        "Not confirmed. Criterion: every joint within 0.01 rad for good after 2.25 to 3.75 s. "
        "Found: after 2.814 s, 2.362 s, never."
    )
    assert str(v.held(1e-12, 10)) == (
        "Confirmed. Criterion: within 1e-06 rad for 10 s. Found: 1.0e-12 rad at the farthest."
    )


SENTENCES = [  # a sentence, with figures on either side of its criterion, and what only one side says
    (v.height_of_wrist, (0.78, 2.1e-4), (1e-3, 2.1e-4), "An inference"),
    (v.stiffness, ([160000], [2000], 2200, 280), ([160000], [2000], 1000, 280), "stays unexplained"),
    (v.alike, (5e-11,), (0.5,), "Here the two motions are the same, other than in the thesis."),
    (v.formulations, (5.2, 70, 1e-15), (40, 70, 1e-15), "the size is not"),
    (v.formulations, (0.9, 70, 1e-15), (5.2, 70, 1e-15), "Not confirmed"),
    (v.formulations, (5.2, 70, 1e-12), (5.2, 70, 1e-14), "DIFFERENT torques"),
    (v.long_run, ("x", 1e-2, 4.9e-3, 370), ("x", 1e-2, 5.1e-3, 370), "comes and goes"),
    (v.long_run, ("x", 1e-2, 4.9e-3, 370), ("x", 0.04, 0.0, 370), "x: Confirmed. Criterion: spread at most"),
    (v.viscous, (4.59, 4.60, 3.0), (3.0, 2.87, 3.0), "the wrist decides"),
    (v.coulomb, (0.078, 0.1), (0.005, 0.1), "does not settle"),
    (v.coulomb, (0.2, 0.1), (0.078, 0.1), "friction alone does not explain it"),
    (v.saturation, (3.05, 1.0, 2, 148, 100), (NEVER, 5, 2, 148, 60), "its speed carries it over"),
    (v.saturation, (2.8, 0.1, 4, 42, 100), (NEVER, 5, 2, 148, 60), "gravity asks for no more than that"),
    (v.overshoot, (132, 122, 8.6), (200, 122, 8.6), "which explains it"),
    (v.lagging, ([531, 3900], [1, 1], 0.05), ([20, 3900], [1, 1], 0.05), "the loop feeds it"),
    (v.lagging, ([20], [1], 0.05), ([531], [1], 0.05), "not all runs"),
]


@pytest.mark.parametrize(("sentence", "one", "other", "words"), SENTENCES)
def test_a_sentence_depends_on_its_figures(sentence, one, other, words):
    assert words in sentence(*one)
    assert words not in sentence(*other)


def test_ratios_are_those_of_the_figures():
    assert "varies 3700 times as much" in v.height_of_wrist(0.777, 2.1e-4)
    stiff = v.stiffness([160000, 100000], [2000, 1000], 2000, 280)
    assert "RK45 takes 80 to 100 times the evaluations of LSODA, and 50 to 80 times" in stiff
    assert stiff.endswith("per simulated second: 100 to 160 of 560.")
    assert "at most 21% later; 1 of 3 runs do not settle" in str(v.no_difference([[2.9, 2.8, NEVER]], [2.4]))
    assert "wanders through 7.0e-04 J, 9% of its band" in v.long_run("x", 7.6e-3, 7e-4, 370)
    assert "takes 5.2 times as long" in v.formulations(5.23, 70, 0)
