"""The thesis's figures as they are drawn here, their print, and what 6.5.3 mentions."""

import functools

import matplotlib.style
import numpy as np
import pytest

import rne
from examples.thesis import closed_loop, figures, formulations, machine
from examples.thesis import numbered_figures as numbered
from examples.thesis.closed_loop import IDEAL, REST, VARIATIONS, loop_scene, outcome, vary
from examples.thesis.loop_plots import fine_grid, inputs, plot_errors
from rne.model.abb_irb140 import CLOSED_LOOPS
from rne.plotting import html_page
from rne.plotting.plots import small_plots
from rne.plotting.robot_picture import small_picture

from .helpers import FIGURES, kept

WIDTH = 4.9  # of a figure [inch]

PHONE = 358  # [px], width of a picture on a screen of 390 px
READABLE = 11  # [px]


@pytest.fixture(scope="module")
def motions():
    return [
        rne.simulate(loop_scene(k), run.start, REST, run.duration, t_eval=fine_grid(run.duration))
        for k, run in enumerate(CLOSED_LOOPS)
    ]


both, same_numbers = functools.cache(formulations.both), functools.cache(formulations.same_numbers)
varied = functools.cache(lambda name, k: vary(k, next(variation for variation in VARIATIONS if variation.name == name)))


@pytest.fixture(autouse=True)
def style():
    with matplotlib.style.context([html_page.STYLE]):
        yield


def texts(figure):
    """Every text that can be seen, drawn."""
    figure.draw_without_rendering()
    found = figure.findobj(matplotlib.text.Text)
    return [text for text in found if text.get_visible() and text.get_text().strip()]


def test_figures_are_titled_by_the_thesis_numbers():
    assert [figure.number for figure in numbered.FIGURES] == FIGURES
    assert numbered.BY_NUMBER["6.12"].title == "Figure 6.12: control inputs of run 6.5-1"
    assert numbered.BY_NUMBER["6.12"].file == "figure_6_12"
    assert numbered.BY_NUMBER["6.9"].title == "Figure 6.9: energies of run 6.4-2"


DRAWN = {  # of the closed loops, a swing and the IRB 140
    "errors": lambda motions, swing, robot: plot_errors("Errors of run 6.5-1", motions[0], CLOSED_LOOPS[0].reference),
    "robot": lambda motions, swing, robot: small_picture(robot, np.zeros(6)),
    "swing": lambda motions, swing, robot: small_plots(swing)[0][1](),
    "V": lambda motions, swing, robot: figures.plot_lyapunov(motions),
    "energies": lambda motions, swing, robot: figures.plot_energies([swing, swing]),
    "6.7": lambda motions, swing, robot: numbered.swing_energies("6.7", swing),
    "6.8": lambda motions, swing, robot: numbered.swing_positions("6.8", swing, swing),
    "6.11": lambda motions, swing, robot: numbered.loop_positions("6.11", motions[0], 0),
    "6.12": lambda motions, swing, robot: numbered.loop_inputs("6.12", motions[0], 0),
}


def check_text(figure):
    assert figure.get_figwidth() == WIDTH
    for text in texts(figure):
        assert text.get_fontsize() / 72 / WIDTH * PHONE >= READABLE, text.get_text()
        assert "^" not in text.get_text()  # exponents are small print


@pytest.mark.parametrize("name", kept(DRAWN, ["6.12"]))
def test_text_is_readable_on_a_phone(motions, irb140, name):
    check_text(DRAWN[name](motions, rne.simulate(irb140, REST, REST, 0.1), irb140))


@pytest.mark.long
def test_text_of_figures_7_2_and_7_4_is_readable_on_a_phone():
    check_text(numbered.formulations("7.2", both("7.1-2")))
    check_text(numbered.same_numbers("7.4", same_numbers(1)))


def test_energies_of_a_swing_are_drawn_from_0_J_and_close_up(irb140):
    swing = rne.simulate(irb140, REST, REST, 0.5)
    above, below = numbered.swing_energies("6.7", swing).axes
    drawn = {curve.get_label(): curve.get_ydata() for curve in above.lines}
    np.testing.assert_array_equal(drawn["kinetic"], swing.kinetic)
    np.testing.assert_array_equal(drawn["potential"], swing.potential)
    np.testing.assert_allclose(drawn["total"], 370.876860, rtol=0, atol=1e-3)  # by the solver
    assert (above.get_title(loc="left"), below.get_title(loc="left")) == ("energy [J]", "total less 370.8769 J [J]")
    assert np.ptp(below.lines[0].get_ydata()) == pytest.approx(np.ptp(swing.energy), abs=1e-12)


def test_inputs_are_those_of_the_thesis_and_with_gravity_those_of_the_drives(motions, irb140):
    """Run 6.5-3 starts joint_2 at 78.5 N m in the thesis, at -80.3 N m with gravity, and ends at 0 and at -23.6."""
    motion = motions[2]
    u = inputs(motion, CLOSED_LOOPS[2].reference)
    np.testing.assert_allclose(u + irb140.gravity_torque(motion.q), motion.tau, rtol=0, atol=1e-11)
    assert (u[0, 1], motion.tau[0, 1]) == (pytest.approx(78.54, abs=0.01), pytest.approx(-80.3, abs=0.1))
    assert u[-1, 1:3] == pytest.approx(0, abs=0.05)
    assert motion.tau[-1, 1:3] == pytest.approx(-23.6, abs=0.4)  # of the reference; 7e-4 rad are left


def test_inputs_have_panels_without_and_with_gravity(motions):
    first, thesis, ours = numbered.loop_inputs("6.16", motions[2], 2).axes
    assert thesis.get_title(loc="left") == "u without gravity's share, (6.58) [N m]"
    assert ours.get_title(loc="left") == "τ = u + g(q), with gravity's share [N m]"
    assert first.get_xlabel() == "time [ms]"
    assert abs(thesis.lines[1].get_ydata()[-1]) < 0.1
    assert ours.lines[1].get_ydata()[-1] == pytest.approx(-23.6, abs=0.4)
    assert np.abs([x.get_ydata().max() for x in thesis.lines]).max() < 160
    assert first.lines[5].get_ydata()[0] == pytest.approx(188.5, abs=0.1)


def test_positions_are_drawn_as_they_are(motions):
    figure = numbered.loop_positions("6.11", motions[0], 0)
    (ax,) = figure.axes
    drawn = {x.get_label(): x for x in ax.lines if x.get_label().startswith("joint_")}
    assert list(drawn) == list(rne.irb140().joint_names)
    for k, curve in enumerate(drawn.values()):
        np.testing.assert_array_equal(curve.get_ydata()[[0, -1]], motions[0].q[[0, -1], k])
    assert figure.get_suptitle() == "Figure 6.11: joint positions of run 6.5-1"


@pytest.mark.parametrize(
    ("sizes", "groups"),
    [
        ([1, 2, 3], [[0, 1, 2]]),
        ([1, 50, 3], [[0, 2], [1]]),
        ([1, 300, 20], [[0], [1], [2]]),
        ([0, 0, 1e-9], [[0, 1], [2]]),
        ([0, 0, 0], [[0, 1, 2]]),
    ],
)
def test_a_joint_that_turns_much_farther_has_its_own_axis(sizes, groups):
    assert numbered.apart(np.array([sizes, np.zeros(3)])) == groups


@pytest.mark.parametrize(
    ("run", "allowed"),
    kept([("7.1-1", 1e-9), ("6.5-1", 1e-6), ("6.5-2", 1e-6), ("6.5-3", 1e-6)], [("7.1-1", 1e-9)]),
)
def test_both_formulations_give_one_motion(run, allowed):
    """Of an arm whose q3 counts the other way, from its own equations; to the tolerances of the two solvers."""
    newton, lagrange = pair = both(run)
    assert np.abs(pair.difference).max() <= allowed
    assert newton.q[0, 2] == -lagrange.q[0, 2]
    assert newton.t[-1] == (10 if run == "7.1-1" else 2.3)


@pytest.mark.parametrize(
    ("k", "settled", "distance", "joint", "left"),
    kept(
        [(0, 2.284, 0.181, 2, 0.0096), (1, 2.392, 0.755, 3, 0.0130), (2, 2.762, 0.520, 3, 0.0445)],
        [(1, 2.392, 0.755, 3, 0.0130)],
    ),
)
def test_the_same_numbers_are_another_motion_where_q3_counts_the_other_way(k, settled, distance, joint, left):
    """Figures 7.3 to 7.5: settling, distance from figures 6.11, 6.13 and 6.15, and what is left after 2.3 s."""
    run = same_numbers(k)
    assert run.lagrange.q[0] == pytest.approx(CLOSED_LOOPS[k].start)
    assert run.lagrange.q[-1] == pytest.approx(np.array(CLOSED_LOOPS[k].reference), abs=1e-3)
    assert run.settled == pytest.approx(settled, abs=2e-3)
    assert np.abs(run.distance).max() == pytest.approx(distance, abs=1e-3)
    assert 1 + np.abs(run.distance).max(axis=0).argmax() == joint
    assert run.left == pytest.approx(left, abs=1e-4)


def test_figure_7_4_is_drawn_in_the_coordinates_of_the_euler_lagrange_model_until_2_3_s():
    run = same_numbers(1)
    above, below = numbered.same_numbers("7.4", run).axes
    joint_3 = above.lines[2]
    assert (joint_3.get_label(), joint_3.get_xdata()[-1]) == ("joint_3", pytest.approx(2.3))
    assert joint_3.get_ydata()[0] == pytest.approx(-np.pi / 2)
    assert joint_3.get_ydata().max() > 0.2  # it overshoots; joint 3 of figure 6.13 does not
    assert run.newton.q[:, 2].max() < 0.01
    assert np.abs(below.lines[2].get_ydata()).max() == pytest.approx(0.755, abs=1e-3)


@pytest.mark.long
def test_both_formulations_leave_an_unstable_equilibrium():
    """When they do is due to rounding; tests/test_thesis.py has the rate at which they do."""
    for motion in both("7.1-2"):
        before = motion.t < 3
        assert np.abs(motion.q[before] - motion.q[0]).max() < 1e-2
        assert np.abs(motion.q - motion.q[0]).max() > 1


def test_ratios_of_table_7_1():
    assert formulations.closed_by_open() == 280
    ratios = [formulations.slower(run) for run in formulations.TABLE]
    assert ratios == pytest.approx([70, 83.9, 73.4, 87.0], abs=0.05)


SETTLING = {
    "none": (2.814, 2.362, 3.002),
    "viscous friction 5 N m s": (2.847, 2.867, 3.004),
    "viscous friction 20 N m s": (4.582, 4.589, 4.583),
    "Coulomb friction 5 N m": (np.inf,) * 3,
    "torque limit 100 N m": (2.814, 3.049, 3.062),
    "torque limit 60 N m": (2.819, np.inf, 3.044),
}


@pytest.mark.long  # tests/test_thesis.py has the loops without these
@pytest.mark.parametrize("name", SETTLING)
def test_settling_with_what_6_5_3_mentions(name):
    found = [varied(name, k).settling for k in range(3)]
    assert found == pytest.approx(SETTLING[name], abs=5e-3)


def test_saturation_is_counted_per_joint(motions, irb140):
    ideal = outcome(motions[1], 1, loop_scene(1, **IDEAL.parts))
    weak = varied("torque limit 60 N m", 1)
    assert (ideal.saturated, ideal.increase) == (0, 0)
    assert (weak.saturated, weak.joint) == (pytest.approx(5, abs=0.01), 2)
    assert weak.increase == pytest.approx(147.7, abs=0.5)
    assert closed_loop.gravity_on_the_way(motions[1])[1] == pytest.approx(147.8, abs=0.1)


def test_flange_speeds_of_the_runs(motions):
    speeds = [machine.flange_speed(motion)[0] for motion in motions]
    assert speeds == pytest.approx([1.91, 3.52, 3.66], abs=0.01)


def test_densities_and_reach():
    assert machine.densities() == pytest.approx([1506.5, 1493.5, 1501.0, 1516.1], abs=0.05)
    assert machine.reach() == pytest.approx(0.810, abs=1e-12)


def test_limits_that_a_run_exceeds_are_in_degrees(motions):
    rows = [machine.violation_row(v) for v in motions[0].check_limits()]
    assert [row[:2] for row in rows] == [["joint_4", "speed"], ["joint_6", "speed"]]
    assert rows[0][2:4] == ["428.6 deg/s", "360.0 deg/s"]
    assert rows[1][3] == "-450.0 deg/s"
