"""Plots of motions and ensembles: curves through the samples, jumps as jumps, one unit on each panel."""

import dataclasses
import io
import pickle
import re
import sys
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

import rne
from rne.commands import pages
from rne.plotting.motions import motion_argument
from rne.plotting.plots import small_plots
from rne.plotting.robot_picture import small_picture

from .helpers import EPS, first_joints, kept
from .random_robots import random_tree, straight_chain

DASHED = (0, (4, 2))

SAME = 1e-12  # relative to the largest value of a curve: polynomials through samples round
UNITS = {"q": ("rad", "m"), "qd": ("rad/s", "m/s"), "qdd": ("rad/s²", "m/s²"), "tau": ("N m", "N")}
WORDS = {"q": ("position",) * 2, "qd": ("velocity",) * 2, "qdd": ("acceleration",) * 2, "tau": ("torque", "force")}


@pytest.fixture(scope="module")
def swing(irb140):
    return rne.simulate(irb140, [0] * 6, [0] * 6, 0.4)


@pytest.fixture(scope="module")
def sampled(irb140):
    """A motion whose torques and accelerations jump every 50 ms."""
    M = np.diag(irb140.mass_matrix([0] * 6))
    law = rne.control.pd_gravity(irb140, 60 * M, 10 * M, [0.5] * 6)
    return rne.simulate(rne.Scene(irb140, controller=law, sample_time=0.05), [0] * 6, [0] * 6, 0.4)


@pytest.fixture(scope="module")
def mixed():
    """A gantry: two sliding joints, then a rotating one."""
    model = rne.dh_chain(
        a=[0.0, 0.0, 0.3], alpha=[-np.pi / 2, np.pi / 2, 0.0], d=[0.2, 0.4, 0.0], theta=[0.0, 0.0, 0.0],
        types=["prismatic", "prismatic", "revolute"], masses=[3.0, 2.0, 1.0], centres=np.full((3, 3), 0.1),
        inertias=np.stack([0.01 * np.eye(3)] * 3), name="gantry", joint_names=["along", "up", "turn"],
    )  # fmt: skip
    return rne.Robot(model)


@pytest.fixture(scope="module")
def spread(irb140):
    starts = np.random.default_rng(0).uniform(-0.3, 0.3, (40, 6))
    return rne.ensemble(irb140, starts, 0 * starts, 0.2, step=5e-3, keep=5)


def first(trajectory, count):
    names = ("t", "q", "qd", "qdd", "tau", "kinetic", "potential", "energy", "work")
    return dataclasses.replace(trajectory, **{name: getattr(trajectory, name)[:count] for name in names})


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def at(curve, t, side):
    """The values of a curve at times among its points, the first or the last of those at the same time."""
    x, y = curve.get_data()
    k = np.searchsorted(x, t, side="left") if side == "first" else np.searchsorted(x, t, side="right") - 1
    np.testing.assert_array_equal(x[k], t)
    return y[k]


@pytest.mark.parametrize("motion", ["swing", "sampled"])
@pytest.mark.parametrize("quantity", ["q", "qd", "qdd", "tau"])
def test_curves_pass_through_the_samples(motion, quantity, request):
    motion = request.getfixturevalue(motion)
    (ax,) = rne.plotting.plot(motion, quantities=[quantity]).axes
    values = getattr(motion, quantity)
    for curve, column in zip(ax.lines, values.T, strict=True):
        atol = SAME * np.abs(values).max()
        if quantity == "qdd":  # a second derivative of positions over steps that samples cut short
            atol += 20 * EPS * np.abs(motion.q).max() / np.diff(motion.t).min() ** 2
        np.testing.assert_allclose(at(curve, motion.t, "last"), column, rtol=0, atol=atol)


def test_curves_follow_the_motion_between_the_samples(swing):
    q, qd, _ = rne.plotting.plot(swing, quantities=["q", "qd", "qdd"]).axes
    t = q.lines[0].get_xdata()
    assert len(t) > 600 > 10 * len(swing.t)
    for ax, values in zip((q, qd), swing(t), strict=False):
        drawn = np.stack([curve.get_ydata() for curve in ax.lines], axis=1)
        np.testing.assert_allclose(drawn, values, rtol=0, atol=SAME * np.abs(values).max())


def test_nothing_is_interpolated_between_times_that_were_asked_for(irb140):
    """Straight lines between them in pictures and films, and no peak that is not among them."""
    law = rne.control.pd_gravity(irb140, [50] * 6, [20] * 6, [1, 0.5, -1, 2, 1, -2])
    motion = rne.simulate(rne.Scene(irb140, controller=law), [0] * 6, [0] * 6, 0.5, t_eval=np.linspace(0, 0.5, 51))
    assert np.abs(motion([0.005])[1]).max() > 2 * np.abs(motion.qd).max()  # an interpolant would swing
    for ax, quantity in zip(
        rne.plotting.plot(motion, quantities=["q", "qd", "qdd", "tau"]).axes, ("q", "qd", "qdd", "tau"), strict=True
    ):
        for curve, column in zip(ax.lines, getattr(motion, quantity).T, strict=True):
            np.testing.assert_array_equal(curve.get_data(), [motion.t, column])
    shown = motion_argument("motion", motion).positions(np.array([0.0, 0.005]))
    np.testing.assert_allclose(shown, [motion.q[0], (motion.q[0] + motion.q[1]) / 2], atol=SAME)


def test_no_acceleration_is_drawn_beyond_those_of_the_steps(irb140):
    """The second derivative of LSODA's interpolants shows its errors over the squares of its shortest steps."""
    law = rne.control.pd_gravity(irb140, [50] * 6, [20] * 6, [1, 0.5, -1, 2, 1, -2])
    motion = rne.simulate(rne.Scene(irb140, controller=law), [0] * 6, [0] * 6, 0.5)
    (ax,) = rne.plotting.plot(motion, quantities=["qdd"]).axes
    for curve, column in zip(ax.lines, motion.qdd.T, strict=True):
        assert curve.get_ydata().min() >= column.min()
        assert curve.get_ydata().max() <= column.max()


def test_jumps_are_vertical_lines(sampled):
    assert len(sampled.jumps) == 7
    for ax, before in zip(
        rne.plotting.plot(sampled, quantities=["qdd", "tau"]).axes,
        (sampled.qdd_before, sampled.tau_before),
        strict=True,
    ):
        for curve, column in zip(ax.lines, before.T, strict=True):
            assert all(np.count_nonzero(curve.get_xdata() == jump) == 2 for jump in sampled.jumps)
            found = at(curve, sampled.jumps, "first")
            np.testing.assert_allclose(found, column, rtol=0, atol=1e-9 * np.abs(before).max())  # one ulp earlier


def test_torques_held_between_samples_are_drawn_as_steps(sampled):
    (ax,) = rne.plotting.plot(sampled, quantities=["tau"]).axes
    edges = [0, *sampled.jumps, 0.4]
    for curve in ax.lines:
        x, y = curve.get_data()
        levels = [np.unique(y[(x > a) & (x < b)]) for a, b in pairwise(edges)]
        assert all(np.ptp(level) <= SAME * np.abs(y).max() for level in levels)


def test_energies_are_smooth_and_their_error_is_at_the_samples(irb140, swing):
    upper, lower = rne.plotting.plot(swing, quantities=["energy", "energy error"]).axes
    assert legend(upper) == ["kinetic", "potential", "total"]
    for curve, values in zip(upper.lines, (swing.kinetic, swing.potential, swing.energy), strict=True):
        np.testing.assert_allclose(at(curve, swing.t, "last"), values, rtol=0, atol=SAME * np.abs(swing.energy).max())
    t = upper.lines[0].get_xdata()
    q, qd, _ = swing(t)
    np.testing.assert_allclose(upper.lines[0].get_ydata(), irb140.kinetic_energy(q, qd), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(lower.lines[0].get_xdata(), swing.t)
    np.testing.assert_array_equal(lower.lines[0].get_ydata(), swing.balance)
    assert lower.get_legend() is None


def test_each_panel_has_one_unit(mixed):
    motion = rne.simulate(mixed, [0.1, 0.2, 0.3], [0] * 3, 0.2, torque=[1.0, 2.0, 3.0])
    figure = rne.plotting.plot(motion, quantities=["q", "qd", "qdd", "tau"])
    expected = [
        (f"{WORDS[k][i]} [{UNITS[k][i]}]", ["turn"] if i == 0 else ["along", "up"]) for k in UNITS for i in (0, 1)
    ]
    assert [(ax.get_ylabel(), legend(ax)) for ax in figure.axes] == expected
    by_joint = {}
    for ax in figure.axes:
        for curve in ax.lines:
            by_joint.setdefault(curve.get_label(), set()).add(curve.get_color())
    assert all(len(colors) == 1 for colors in by_joint.values())  # a joint keeps its colour on every panel
    assert len(set.union(*by_joint.values())) == 3
    force = figure.axes[-1].lines[1]
    assert (force.get_ydata() == 2.0).all()


def test_units_are_those_of_the_coordinates_where_joints_mimic_others():
    model = random_tree(5, seed=6, mimics=3)
    robot = rne.Robot(model)
    sliding = [
        name for name, i in zip(robot.joint_names, model.independent_joints, strict=True) if not model.is_revolute[i]
    ]
    panels = rne.plotting.plot(([0, 1], np.zeros((2, robot.n))), robot).axes
    by_unit = {ax.get_ylabel(): legend(ax) for ax in panels}
    assert by_unit["position [m]"] == sliding
    assert sorted(by_unit["position [rad]"] + sliding) == sorted(robot.joint_names)


def test_without_types_of_joints_the_label_names_both_units():
    (ax,) = rne.plotting.plot(([0, 1], [[0, 1], [2, 3]])).axes
    assert ax.get_ylabel() == "position [rad or m]"
    assert legend(ax) == ["joint_1", "joint_2"]


def test_names_come_from_the_model_or_the_robot_or_the_caller(irb140, swing, mixed):
    arrays = (swing.t, swing.q)
    (ax,) = rne.plotting.plot(swing, quantities=["q"]).axes
    assert legend(ax) == list(irb140.joint_names)
    (ax,) = rne.plotting.plot(arrays, irb140).axes
    assert (legend(ax), ax.get_ylabel()) == (list(irb140.joint_names), "position [rad]")
    (ax,) = rne.plotting.plot(swing, list("abcdef"), quantities=["q"]).axes
    assert (legend(ax), ax.get_ylabel()) == (list("abcdef"), "position [rad]")
    assert len(rne.plotting.plot(([0, 1], np.zeros((2, 3))), mixed).axes) == 2


def test_arrays_are_drawn_as_they_are(swing):
    figure = rne.plotting.plot((swing.t, swing.q, None, swing.qdd))
    assert [ax.get_ylabel() for ax in figure.axes] == ["position [rad or m]"]  # accelerations only if asked for
    (ax,) = rne.plotting.plot((swing.t, swing.q, None, swing.qdd), quantities=["qdd"]).axes
    for curve, column in zip(ax.lines, swing.qdd.T, strict=True):
        np.testing.assert_array_equal(curve.get_data(), (swing.t, column))
    (ax,) = rne.plotting.plot((swing.t, None, swing.qd)).axes
    assert ax.get_ylabel() == "velocity [rad/s or m/s]"


def test_default_panels(swing, sampled):
    labels = ["position [rad]", "velocity [rad/s]", "torque [N m]", "energy [J]", "energy error [J]"]
    figure = rne.plotting.plot(sampled)
    assert isinstance(figure, Figure)
    assert [ax.get_ylabel() for ax in figure.axes] == labels
    assert [ax.get_ylabel() for ax in rne.plotting.plot(swing).axes] == [x for x in labels if "torque" not in x]
    assert [ax.get_xlabel() for ax in figure.axes] == [""] * 4 + ["time [s]"]


def test_a_second_motion_is_drawn_dashed_in_the_same_colours(swing, sampled):
    alone = rne.plotting.plot(sampled)
    both = rne.plotting.plot(sampled, other=swing)
    for one, two in zip(alone.axes, both.axes, strict=True):
        assert len(two.lines) == 2 * len(one.lines)
        solid, dashed = two.lines[: len(one.lines)], two.lines[len(one.lines) :]
        assert [x.get_color() for x in solid] == [x.get_color() for x in dashed]
        assert {x.get_linestyle() for x in solid} == {"-"}
        assert {x._unscaled_dash_pattern for x in dashed} == {DASHED}
        assert (two.get_legend() is None) == (one.get_legend() is None)
        if one.get_legend() is not None:
            assert legend(two) == legend(one)
    assert both.get_suptitle() == "Solid: motion, by Tsit5; dashed: other, by DOP853"


def test_a_measurement_is_compared_where_it_has_the_quantity(swing):
    positions, rates, *_ = rne.plotting.plot(swing, other=(swing.t, swing.q)).axes
    assert (len(positions.lines), len(rates.lines)) == (12, 6)


def test_plots_on_given_axes(swing):
    figure = Figure()
    axes = figure.subplots(1, 2)
    assert rne.plotting.plot(swing, quantities=["q", "qd"], axes=axes) is figure
    assert [len(ax.lines) for ax in axes] == [6, 6]
    part = figure.subfigures(1, 2)[0].subplots()
    assert rne.plotting.plot(swing, quantities=["qd"], axes=part) is figure
    assert part.get_ylabel() == "velocity [rad/s]"


@pytest.mark.parametrize("n", kept([1, 6, 30], [6]))
def test_legends_stand_beside_the_panels_and_within_the_page(n):
    motion = rne.simulate(rne.Robot(straight_chain(n)), np.full(n, 0.1), np.zeros(n), 0.02, torque=np.ones(n))
    figure = rne.plotting.plot(motion)
    figure.draw_without_rendering()
    assert len({str(x.get_color()) for x in figure.axes[0].lines}) == n
    for ax in figure.axes[:-1]:
        box, page = ax.get_legend().get_window_extent(), figure.bbox
        assert box.x0 >= ax.bbox.x1
        assert box.x1 <= page.x1
        assert box.height <= page.height / 5
        assert ax.bbox.width > page.width / 3


def test_failures_are_named_in_the_title(swing):
    assert rne.plotting.plot(swing).get_suptitle() == "Motion by DOP853"
    assert rne.plotting.plot(dataclasses.replace(swing, status=-1)).get_suptitle() == "Motion by DOP853, failed"


def test_plot_of_one_sample_shows_points(swing):
    assert all(x.get_marker() == "." for ax in rne.plotting.plot(first(swing, 1)).axes for x in ax.lines)


def test_plot_without_joints():
    robot = rne.Robot(random_tree(0, seed=1))
    assert not rne.plotting.plot(rne.simulate(robot, [], [], 1.0)).axes[0].lines


@pytest.mark.long
def test_notebooks_show_figures_without_pyplot(irb140, swing, spread):
    figures = (rne.plotting.plot(swing), rne.plotting.quantile_plot(spread), rne.plotting.draw(irb140, [0] * 6))
    for figure in figures:
        with Image.open(io.BytesIO(figure._repr_png_())) as picture:
            assert picture.size == tuple(np.rint(figure.get_size_inches() * figure.dpi))
            assert len(np.unique(np.asarray(picture.convert("L")))) > 50
        assert len(pickle.loads(pickle.dumps(figure)).axes) == len(figure.axes)


def test_bands_of_a_fan_are_the_quantiles(spread):
    levels = [0.1, 0.2, 0.5, 0.8, 0.9]
    for k, ax in enumerate(rne.plotting.quantile_plot(spread, probabilities=levels, of="qd").axes):
        low, lower, middle, upper, high = np.quantile(spread.qd[..., k], levels, axis=1)
        np.testing.assert_array_equal(ax.lines[0].get_data(), (spread.t, middle))
        for band, (a, b) in zip(ax.collections, ((low, high), (lower, upper)), strict=True):
            corners = band.get_paths()[0].vertices
            for x, y in (*zip(spread.t, a, strict=True), *zip(spread.t, b, strict=True)):
                assert (corners == (x, y)).all(axis=1).any()
    labels = [text.get_text() for text in rne.plotting.quantile_plot(spread).legends[0].get_texts()]
    assert labels == ["5 to 95 %", "25 to 75 %", "50 %"]


def test_a_fan_has_a_panel_for_each_joint_with_its_unit(mixed, spread):
    starts = np.random.default_rng(1).uniform(-0.1, 0.1, (10, 3))
    slid = rne.ensemble(mixed, starts, 0 * starts, 0.1, step=0.01, keep=3)
    figure = rne.plotting.quantile_plot(slid, of="tau")
    assert [(ax.get_title(), ax.get_ylabel()) for ax in figure.axes] == [
        ("along", "force [N]"), ("up", "force [N]"), ("turn", "torque [N m]"),
    ]  # fmt: skip
    assert len(rne.plotting.quantile_plot(spread, ["joint_4", "joint_2"]).axes) == 2
    ax = Figure().subplots()
    assert rne.plotting.quantile_plot(spread, ["joint_4"], axes=ax) is ax.figure
    assert ax.get_title() == "joint_4"
    assert len(ax.collections) == 2


def test_derivatives_are_drawn_entry_by_entry():
    """One panel for each joint, one curve for each entry of the number, by default the first."""
    chain = rne.Robot(straight_chain(2))
    found = rne.sensitivities(chain, [0.3, 0.1], [0, 0], 0.04, wrt=["q0", "gravity"], step=0.02)
    figure = found.plot("gravity", "qd")
    assert [ax.get_title() for ax in figure.axes] == ["joint0", "joint1"]
    assert {ax.get_ylabel() for ax in figure.axes} == {"velocity [rad/s]\nby gravity"}
    for k, ax in enumerate(figure.axes):
        drawn = np.array([line.get_ydata() for line in ax.lines]).T
        np.testing.assert_array_equal(drawn, found.dqd["gravity"][:, k])
    assert [line.get_label() for line in figure.axes[0].lines] == ["gravity[0]", "gravity[1]", "gravity[2]"]
    (ax,) = found.plot(joints=["joint1"]).axes
    assert ax.get_ylabel() == "position [rad]\nby q0"
    assert rne.plotting.sensitivity_plot(found, joints=["joint1"], axes=ax) is ax.figure
    for wrong, message in (
        ({"name": "qd0"}, r"`name` must be from \['q0', 'gravity'\], got 'qd0'"),
        ({"of": "qdd"}, r"`of` must be from \['q', 'qd', 'tau'\], got 'qdd'"),
        ({"joints": ["elbow"]}, r"`joints` must be from \['joint0', 'joint1'\], got 'elbow'"),
    ):
        with pytest.raises(ValueError, match=message):
            found.plot(**wrong)
    with pytest.raises(TypeError, match=r"`found` must be rne\.Sensitivities, got dict"):
        rne.plotting.sensitivity_plot({})


def test_a_fan_of_an_even_number_of_quantiles_has_no_line(spread):
    ax = rne.plotting.quantile_plot(spread, ["joint_1"], [0.25, 0.75]).axes[0]
    assert (len(ax.collections), len(ax.lines)) == (1, 0)


MISSING = "pictures need matplotlib, which is not installed: pip install 'rne[plot]'"


def test_without_matplotlib_the_cure_is_named(swing, spread, monkeypatch):
    for module in [m for m in sys.modules if m.split(".")[0] == "matplotlib"]:
        monkeypatch.setitem(sys.modules, module, None)
    for call in (lambda: rne.plotting.plot(swing), lambda: rne.plotting.quantile_plot(spread)):
        with pytest.raises(ImportError, match=f"^{re.escape(MISSING)}$"):
            call()


def test_what_matplotlib_itself_misses_is_not_blamed_on_matplotlib(monkeypatch):
    monkeypatch.delitem(sys.modules, "matplotlib.figure")
    monkeypatch.setitem(sys.modules, "numpy", None)
    with pytest.raises(ModuleNotFoundError, match="numpy"):
        rne.plotting.plots.blank_figure(1, 1)


PAIR = ([0.0, 1.0], [[0.0, 1.0], [2.0, 3.0]])
WRONG = {
    "dict": (
        lambda s, e: rne.plotting.plot({}),
        TypeError,
        "`motion` must be an rne.Trajectory or a tuple of arrays (t, q), got dict",
    ),
    "one array": (
        lambda s, e: rne.plotting.plot([s.t]),
        TypeError,
        "`motion` must be an rne.Trajectory or a tuple of arrays (t, q), got list",
    ),
    "empty": (
        lambda s, e: rne.plotting.plot(first(s, 0)),
        ValueError,
        "`motion` must have at least one sample, got none",
    ),
    "no times": (
        lambda s, e: rne.plotting.plot(([], np.zeros((0, 2)))),
        ValueError,
        "`motion` must have at least one sample, got none",
    ),
    "falling times": (
        lambda s, e: rne.plotting.plot(([0, 2, 1], np.zeros((3, 2)))),
        ValueError,
        "`motion[0]` must be ascending times, got 1 s after 2 s",
    ),
    "table of times": (
        lambda s, e: rne.plotting.plot((np.zeros((2, 2)), np.zeros((2, 2)))),
        ValueError,
        "`motion[0]` must be times of shape (T,), got (2, 2)",
    ),
    "transposed": (
        lambda s, e: rne.plotting.plot((s.t, s.q.T)),
        ValueError,
        "`motion[1]`, q, must have shape (12, n), got (6, 12): transpose it",
    ),
    "rates of another robot": (
        lambda s, e: rne.plotting.plot((*PAIR, np.zeros((2, 3)))),
        ValueError,
        "`motion[2]`, qd, must have shape (2, 2), got (2, 3)",
    ),
    "nothing": (
        lambda s, e: rne.plotting.plot(([0.0, 1.0], None)),
        ValueError,
        "`motion` must hold at least one array in addition to t, got none",
    ),
    "nan": (
        lambda s, e: rne.plotting.plot(([0, np.nan], PAIR[1])),
        ValueError,
        "`motion[0]` must be finite, got nan at index (1,)",
    ),
    "few names": (
        lambda s, e: rne.plotting.plot(s, ["a", "b"]),
        ValueError,
        "`joint_names` must have 6 names, one per joint of `motion`, got 2",
    ),
    "number": (
        lambda s, e: rne.plotting.plot(s, 6),
        TypeError,
        "`joint_names` must be an rne.Robot or a sequence of str, got int",
    ),
    "numbers": (
        lambda s, e: rne.plotting.plot(s, range(6)),
        TypeError,
        "`joint_names` must be a sequence of str, got one with int",
    ),
    "one name": (
        lambda s, e: rne.plotting.plot(s, "abcdef"),
        TypeError,
        "`joint_names` must be an rne.Robot or a sequence of str, got str",
    ),
    "other robot": (
        lambda s, e: rne.plotting.plot(s, other=PAIR),
        ValueError,
        "`other` must have 6 joints as `motion` has, got 2",
    ),
    "other none": (
        lambda s, e: rne.plotting.plot(PAIR, other=first(s, 0)),
        ValueError,
        "`other` must have at least one sample, got none",
    ),
    "lacking": (
        lambda s, e: rne.plotting.plot(PAIR, quantities=["q", "tau"]),
        ValueError,
        "`quantities` must be from ['q'], got 'tau'",
    ),
    "unknown": (
        lambda s, e: rne.plotting.plot(s, quantities=["x"]),
        ValueError,
        "`quantities` must be from ['q', 'qd', 'qdd', 'tau', 'energy', 'energy error'], got 'x'",
    ),
    "one quantity": (
        lambda s, e: rne.plotting.plot(s, quantities="q"),
        TypeError,
        "`quantities` must be a sequence of str, got str",
    ),
    "no quantity": (
        lambda s, e: rne.plotting.plot(s, quantities=[]),
        ValueError,
        "`quantities` must name at least one quantity, got none",
    ),
    "few axes": (
        lambda s, e: rne.plotting.plot(s, quantities=["q", "qd"], axes=Figure().subplots()),
        ValueError,
        "`axes` must have 2 axes, for position [rad], velocity [rad/s]; got 1",
    ),
    "no axes": (
        lambda s, e: rne.plotting.plot(s, quantities=["q"], axes=[3]),
        TypeError,
        "`axes` must be matplotlib axes, got int",
    ),
    "quantiles trajectory": (
        lambda s, e: rne.plotting.quantile_plot(s),
        TypeError,
        "`ensemble` must be an rne.Ensemble, got Trajectory",
    ),
    "quantiles joint": (
        lambda s, e: rne.plotting.quantile_plot(e, ["elbow"]),
        ValueError,
        "`joints` must be from ['joint_1', 'joint_2', 'joint_3', 'joint_4', 'joint_5', 'joint_6'], got 'elbow'",
    ),
    "quantiles one name": (
        lambda s, e: rne.plotting.quantile_plot(e, "joint_1"),
        TypeError,
        "`joints` must be a sequence of str, got str",
    ),
    "quantiles no joint": (
        lambda s, e: rne.plotting.quantile_plot(e, []),
        ValueError,
        "`joints` must name at least one joint, got none",
    ),
    "quantiles falling": (
        lambda s, e: rne.plotting.quantile_plot(e, probabilities=[0.9, 0.1]),
        ValueError,
        "`probabilities` must be rising numbers from 0 to 1, got [0.9, 0.1]",
    ),
    "quantiles percent": (
        lambda s, e: rne.plotting.quantile_plot(e, probabilities=[5, 95]),
        ValueError,
        "`probabilities` must be between 0 and 1, got [5.0, 95.0]",
    ),
    "quantiles of": (
        lambda s, e: rne.plotting.quantile_plot(e, of="z"),
        ValueError,
        "`of` must be one of ['q', 'qd', 'tau'], got 'z'",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_calls_are_refused_by_name(swing, spread, case):
    call, error, text = WRONG[case]
    with pytest.raises(error, match=f"^{re.escape(text)}$"):
        call(swing, spread)


def test_names_are_shown_as_they_are(swing):
    """Neither formulas nor names that begin with a line, which matplotlib would hide."""
    names = ["_a", r"$\frac{$", "c$", "d", "e", "f"]
    figure = rne.plotting.plot(swing, joint_names=names)
    figure.draw_without_rendering()
    (legend,) = {tuple(text.get_text() for text in ax.get_legend().get_texts()) for ax in figure.axes[:1]}
    assert [name.replace("\u200b", "").replace(r"\$", "$") for name in legend] == names


@pytest.mark.parametrize("n", [1, 3])
def test_torques_over_speeds_have_a_panel_for_each_joint_and_one_legend(n):
    robot = first_joints(n).with_limits(effort=[250.0, 250, 150][:n])
    figure = rne.plotting.torque_speed(rne.drives(robot, rne.trajectories.quintic([0.0] * n, [1.0] * n, 1.0)))
    assert len(figure.axes) == n
    (legend,) = figure.legends
    assert {text.get_text() for text in legend.get_texts()} == {"cycle", "peak", "rms", "limits"}


def test_pictures_for_narrow_pages_are_of_one_size(swing, spread):
    for _, draw in small_plots(swing):
        assert draw().get_size_inches().tolist() == [4.9, 2.9]
    heights = [rne.plotting.quantile_plot(spread, joints=spread.model.joint_names[:n]).get_figheight() for n in (1, 2)]
    assert heights[0] > heights[1]


def test_a_small_picture_names_its_curves_in_a_legend_or_those_of_many_in_its_title():
    t = np.linspace(0, 1, 3)
    for n in (2, 12):
        (_, draw), *_ = small_plots((t, np.outer(t, np.arange(n))))
        figure = draw()
        named = [text.get_text() for text in figure.legends[0].get_texts()] if figure.legends else []
        assert named == (["joint_1", "joint_2"] if n == 2 else [])
        assert figure.axes[0].get_title() == ("" if n == 2 else "joint_1 (blue) to joint_12 (red)")


def test_the_legend_of_a_small_picture_is_below_the_robot(irb140):
    figure = small_picture(irb140, np.zeros(6))
    (legend,) = figure.legends or [ax.get_legend() for ax in figure.axes]
    figure.draw_without_rendering()
    assert legend.get_window_extent().y1 <= figure.bbox.height / 2
    assert figure.axes[0].get_position().height * figure.get_figheight() == pytest.approx(4.3)  # whatever the legend's


def test_steps_of_differences_are_written_as_numbers():
    ticks = pages._plot_errors(np.geomspace(1e-8, 1, 17), np.geomspace(1e-3, 1e-9, 17)).axes[0].xaxis
    assert [float(tick.get_text().replace("\N{MINUS SIGN}", "-")) for tick in ticks.get_ticklabels()] == [1e-8, 1e-4, 1]


def test_no_line_of_a_prediction_is_drawn_over_two_steps():
    t, tau = np.array([0, 1, 2, 4.0, 5]), np.arange(5.0)[:, None]
    line = rne.plotting.prediction_plot(t, tau, tau, tau).axes[0].lines[0]
    assert np.flatnonzero(np.isnan(line.get_ydata())).tolist() == [3]
    assert line.get_xdata().tolist() == [0, 1, 2, 2, 4, 5]


def test_the_band_of_a_prediction_is_seen_where_it_is_wider_than_the_residuals():
    """1.96 standard deviations, in both panels: around the prediction, and over the velocity."""
    t, tau, width = np.arange(4.0), np.ones((4, 1)), 1.96 * 0.5
    over_time, over_velocity = rne.plotting.prediction_plot(t, tau + 1e-3, tau, tau, std=0.5).axes
    (band,) = over_time.collections
    assert band.get_paths()[0].vertices[:, 1].min() == pytest.approx(1 - width, rel=SAME)
    assert band.get_paths()[0].vertices[:, 1].max() == pytest.approx(1 + width, rel=SAME)
    low, high = over_velocity.get_ylim()
    assert low < -width < width < high


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (([0, 1], [1.0, 2.0], [1.0, 2.0], [1.0, 2.0]), "`measured` must have shape (2, n), got (2,)"),
        (([0, 1], [[1.0]], [[1.0]], [[1.0]]), "`measured` must have shape (2, n), got (1, 1)"),
        (([0, 1], [[1.0], [2.0]], [[1.0]], [[1.0]]), "`predicted` must have shape (2, 1), got (1, 1)"),
    ],
)
def test_errors_of_a_prediction(arguments, text):
    with pytest.raises(ValueError, match=re.escape(text)):
        rne.plotting.prediction_plot(*arguments)


def test_a_prediction_has_a_unit_for_each_joint():
    tau = np.zeros((2, 3))
    with pytest.raises(ValueError, match=r"^`units` must have 3 entries, got 1$"):
        rne.plotting.prediction_plot([0.0, 1.0], tau, tau, tau, units=["N m"])
