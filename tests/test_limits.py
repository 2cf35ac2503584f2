"""Which limits of its robot a motion exceeds, when first and when worst."""

import pickle
from dataclasses import astuple, replace

import numpy as np
import pytest

import rne
from rne.control import pd_gravity
from rne.dynamics.limits import limit_violations
from rne.model.abb_irb140 import CLOSED_LOOPS, DATA_SHEET

from .helpers import KD, KP, Mimic, Part, assemble, loaded

T = np.linspace(0, 10, 1001)


def joint(k, parent, kind="revolute", **options):
    limits = {"lower": -1.0, "upper": 2.0, "velocity": 3.0, "effort": 4.0}
    return Part(link=f"l{k}", joint=f"j{k}", kind=kind, parent=parent, mass=1.0, com=np.ones(3), **limits | options)


ONE = assemble("one", [Part(link="base"), joint(1, 0)])
PAIR = assemble("pair", [Part(link="base"), joint(1, 0), joint(2, 1, "prismatic", mimic=Mimic(1, -2.0, 0.5))])


def violations(model=ONE, **arrays):
    """Of a motion in which all that is not given is zero."""
    given = {name: np.zeros((len(T), model.n)) for name in ("q", "qd", "tau")}
    given |= {name: np.asarray(x, dtype=float).reshape(-1, model.n) for name, x in arrays.items()}
    return limit_violations(model, T, **given)


def test_each_side_of_a_range_has_its_own_first_and_worst_time():
    """q = 3 sin t is above 2 from asin(2/3) = 0.7297 on, below -1 from pi + asin(1/3) = 3.4814 on."""
    below, above = violations(q=3 * np.sin(T))
    assert (above.quantity, above.limit, above.first_time) == ("position", 2.0, pytest.approx(0.73))
    assert (below.quantity, below.limit, below.first_time) == ("position", -1.0, pytest.approx(3.49))
    assert (above.worst_time, above.value) == (pytest.approx(1.57), pytest.approx(3, abs=1e-4))
    assert (below.worst_time, below.value) == (pytest.approx(4.71), pytest.approx(-3, abs=1e-4))


@pytest.mark.parametrize(
    ("name", "quantity", "limit", "unit"), [("qd", "velocity", 3, "rad/s"), ("tau", "torque", 4, "N m")]
)
def test_rates_and_torques_have_one_limit_for_both_directions(name, quantity, limit, unit):
    values = np.where(T < 2, 0.0, np.where(T < 5, limit + 1.0, -limit - 2.0))
    (found,) = violations(**{name: values})
    assert astuple(found) == ("j1", quantity, -limit - 2.0, -limit, unit, T[200], T[500])


def test_a_side_keeps_its_limit_just_after_a_worse_one_on_the_other():
    q = np.zeros_like(T)
    q[500:502] = 12.0, -1.5
    found = violations(q=q)
    assert [(v.value, v.limit, v.worst_time) for v in found] == [(-1.5, -1.0, T[501]), (12.0, 2.0, T[500])]


def test_a_limit_that_is_reached_is_not_exceeded():
    assert violations(q=np.full_like(T, 2.0), qd=np.full_like(T, -3.0), tau=np.full_like(T, 4.0)) == []
    assert violations(q=np.full_like(T, 2.0 * (1 + 4e-16))) == []
    assert len(violations(q=np.full_like(T, 2.0 * (1 + 1e-8)))) == 1


def test_a_range_that_starts_at_zero_has_rounding_too():
    model = assemble("one", [Part(link="base"), joint(1, 0, lower=0.0)])
    assert violations(model, q=np.full_like(T, -1e-16)) == []
    assert len(violations(model, q=np.full_like(T, -1e-8))) == 1


def test_infinite_limits_are_never_exceeded():
    free = assemble("free", [Part(link="base"), Part(link="l", joint="j", kind="continuous", parent=0, mass=1.0)])
    assert violations(free, q=1e9 * T, qd=1e9 + 0 * T, tau=1e9 + 0 * T) == []


def test_a_joint_that_mimics_another_is_examined_at_its_own_position_and_rate():
    """q2 = -2 q1 + 0.5: at q1 = 1 it is at -1.5 of -1, and with q1' = 2 it moves at -4 of 3."""
    found = violations(PAIR, q=np.ones_like(T), qd=2 * np.ones_like(T), tau=5 * np.ones_like(T))
    assert [(v.joint, v.quantity, v.value, v.unit) for v in found] == [
        ("j1", "torque", 5.0, "N m"),
        ("j2", "position", -1.5, "m"),
        ("j2", "velocity", -4.0, "m/s"),
    ]


def test_a_violation_is_a_line_of_text():
    (rate,) = violations(qd=np.where(T < 1, 0.0, 3.5))
    assert str(rate) == "j1: velocity 3.5 rad/s (200.5 deg/s) above 3 rad/s (171.9 deg/s), worst at 1 s, first at 1 s"
    _, slider, _ = violations(PAIR, q=np.ones_like(T), qd=2 * np.ones_like(T), tau=5 * np.ones_like(T))
    assert str(slider) == "j2: position -1.5 m below -1 m, worst at 0 s, first at 0 s"
    close = replace(slider, quantity="velocity", value=-5.00026, limit=-5.0, unit="m/s")  # not "-5 m/s below -5 m/s"
    assert str(close) == "j2: velocity -5.00026 m/s below -5 m/s, worst at 0 s, first at 0 s"


def test_empty_motions_exceed_nothing():
    empty = np.zeros((0, 1))
    assert limit_violations(ONE, np.zeros(0), empty, empty, empty) == []


# Simulated motions


def closed_loop(irb140, k):
    """Run 6.5-k on a grid fine enough for the wrist's first millisecond."""
    scene = CLOSED_LOOPS[k - 1]
    t = np.r_[np.linspace(0, 0.01, 201), np.linspace(0.011, 5, 4990)]
    law = pd_gravity(irb140, KP, KD, scene.reference)
    return rne.simulate(irb140, scene.start, np.zeros(6), 5.0, torque=law, t_eval=t)


def fastest(motion):
    """Joint to its largest rate beyond the limit, in degrees per second."""
    return {v.joint: np.degrees(abs(v.value)) for v in motion.check_limits() if v.quantity == "velocity"}


def test_run_6_5_1_exceeds_the_speeds_of_joints_4_and_6(irb140):
    motion = closed_loop(irb140, 1)
    rates = fastest(motion)
    assert rates == {"joint_4": pytest.approx(429, abs=1), "joint_6": pytest.approx(495, abs=1)}  # of 360, of 450
    assert {v.quantity for v in motion.check_limits()} == {"velocity"}


def test_run_6_5_2_exceeds_the_speeds_of_joints_1_to_4_and_two_ranges(irb140):
    motion = closed_loop(irb140, 2)
    limits = dict(zip(irb140.joint_names, DATA_SHEET["speeds"].value, strict=True))
    rates = fastest(motion)
    assert {name: limits[name] for name in rates} == {"joint_1": 200, "joint_2": 200, "joint_3": 260, "joint_4": 360}
    np.testing.assert_allclose(list(rates.values()), [282, 281, 272, 457], atol=1)
    ranges = [v for v in motion.check_limits() if v.quantity == "position"]
    assert [(v.joint, v.first_time) for v in ranges] == [("joint_1", pytest.approx(0.903, abs=2e-3)), ("joint_2", 0.0)]


def test_flange_of_run_6_5_3_is_faster_than_the_data_sheet_allows(irb140):
    motion = closed_loop(irb140, 3)
    v = (irb140.jacobian(motion.q, "tool0") @ motion.qd[..., None])[:, 3:, 0]
    assert DATA_SHEET["tcp_speed"].value == 2.5
    assert np.linalg.norm(v, axis=1).max() == pytest.approx(3.66, abs=0.01)


def test_a_run_that_ends_at_a_stop_exceeds_no_range(irb140):
    swing = rne.simulate(rne.Scene(irb140, stops=True), np.zeros(6), np.zeros(6), 5.0)
    assert swing.status == 1
    assert [v for v in swing.check_limits() if v.quantity == "position"] == []
    free = rne.simulate(irb140, np.zeros(6), np.zeros(6), 5.0).check_limits()
    assert [v for v in free if v.quantity == "position"]


def test_saturated_drives_exceed_no_effort(irb140):
    weak = rne.Robot(replace(irb140.model, effort_limit=np.full(6, 60.0)))
    law = pd_gravity(weak, KP, KD, CLOSED_LOOPS[0].reference)
    torques = [
        [v.joint for v in rne.simulate(scene, np.zeros(6), np.zeros(6), 0.3).check_limits() if v.quantity == "torque"]
        for scene in (rne.Scene(weak, controller=law), rne.Scene(weak, controller=law, effort_limit="urdf"))
    ]
    assert torques[1] == []
    assert "joint_1" in torques[0]


def test_limits_are_those_of_the_scenes_robot(irb140):
    scene = rne.Scene(irb140, locked={"joint_1": 0.0}, payload=3.0)
    motion = rne.simulate(scene, np.zeros(5), np.zeros(5), 1.0)
    assert motion.model is scene.resolved.robot.model
    assert "joint_1" not in {v.joint for v in motion.check_limits()}


def test_a_pickled_trajectory_knows_its_robot(irb140):
    motion = rne.simulate(irb140, np.zeros(6), np.zeros(6), 1.0)
    again = pickle.loads(pickle.dumps(motion))
    assert again.check_limits() == motion.check_limits() != []


def test_a_trajectory_without_a_model_says_so(irb140):
    motion = replace(rne.simulate(irb140, np.zeros(6), np.zeros(6), 0.1), model=None)
    text = r"^this trajectory has no model: give it one by dataclasses\.replace\(trajectory, model=\.\.\.\)$"
    with pytest.raises(ValueError, match=text):
        motion.check_limits()


def test_data_sheet_shows_each_number_with_unit_and_source():
    assert len(DATA_SHEET) == 13
    assert all(datum.unit and "data sheet (Høifødt 2011, appendix A)" in datum.source for datum in DATA_SHEET.values())
    assert DATA_SHEET["tcp_speed"][:2] == (2.5, "m/s")
    assert DATA_SHEET["tcp_acceleration"].value == 20


def test_limits_of_the_model_are_those_of_the_data_sheet(irb140):
    np.testing.assert_allclose(
        np.degrees(irb140.model.upper - irb140.model.lower), DATA_SHEET["ranges"].value, rtol=1e-15
    )
    np.testing.assert_allclose(np.degrees(irb140.model.velocity_limit), DATA_SHEET["speeds"].value, rtol=1e-15)
    assert 1000 * sum((0.070, 0.360, 0.380)) == pytest.approx(DATA_SHEET["reach"].value)


def test_peaks_between_samples_are_seen():
    """A stone on rails, thrown up at 3 m/s: highest at v^2 / 2 g after v / g, between the solver's long steps."""
    lift = rne.Robot(
        rne.model.chain([np.eye(3)], [[0, 0, 0]], [1.0], [[0, 0, 0]], [0 * np.eye(3)], types="prismatic", upper=[0.45])
    )
    motion = rne.simulate(lift, [0.0], [3.0], 0.5)
    assert motion.q.max() < 0.45
    assert rne.simulate(lift, [0.0], [3.0], 0.5, t_eval=[0, 0.2, 0.5]).check_limits() == []  # these times alone
    (violation,) = motion.check_limits()
    assert violation.quantity == "position"
    assert violation.value == pytest.approx(9 / (2 * 9.81), rel=1e-3)
    assert violation.worst_time == pytest.approx(3 / 9.81, abs=0.2 / 16)
    above = 3 / 9.81 - np.sqrt(2 * (9 / (2 * 9.81) - 0.45) / 9.81)
    assert above <= violation.first_time <= above + 0.2 / 16


def test_limits_per_coordinate_leave_joints_that_mimic_out():
    panda = loaded("panda")
    assert panda.effort_limit.tolist() == [87, 87, 87, 87, 12, 12, 12, 100]
    assert panda.velocity_limit.shape == panda.lower.shape == panda.upper.shape == (panda.n,)
    assert (panda.lower < panda.upper).all()
