"""The report of drives: against plain NumPy and Pinocchio, its balance of energy, motions of every kind, and errors."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

import rne
from rne.trajectories import quintic

from .helpers import Oracle
from .random_robots import straight_chain

SUMS = 1e-9  # relative to the largest, of two recursions and sums over thousands of samples
BETWEEN_STEPS = 2e-4  # relative, of torques that a simulation interpolates between its steps
QUADRATURE = 1e-3  # of all energy exchanged, of the trapezoidal rule in sixteenths of steps with interpolated torques
GEAR, ROTOR, EFFICIENCY = np.array([120, 120, 100, 80, 80, 50.0]), 1e-4 * np.array([3, 3, 2, 1, 1, 1]), 0.85
PICK, PLACE, HOME = [1, 0.6, -0.2, 0, 0.5, 1], [-1, 0.6, -0.2, 0, 0.5, -1], [0, 0, 0, 0, 0, 0]


class Cycle:
    """Home, pick, place and home again."""

    legs, leg = [quintic(a, b, 0.8) for a, b in ((HOME, PICK), (PICK, PLACE), (PLACE, HOME))], 0.8
    duration = 2.4

    def __call__(self, t):
        parts = [self.legs[min(int(x / self.leg), 2)](x - self.leg * min(int(x / self.leg), 2)) for x in t]
        return tuple(np.array(x) for x in zip(*parts, strict=True))


def samples(t, n=6, **values):
    """An arm that stands still at these times, but for what is given."""
    at_rest = {name: np.zeros((len(t), 6)) for name in ("q", "qd", "qdd")}
    return SimpleNamespace(t=np.array(t), **at_rest | {name: np.full((len(t), n), x) for name, x in values.items()})


@pytest.fixture(scope="module")
def arm(irb140):
    return irb140.with_limits(effort=[250, 250, 150, 50, 50, 20])


@pytest.fixture(scope="module")
def report(arm):
    scene = rne.Scene(arm, payload=3.0, friction=rne.Friction(viscous=2.0, coulomb=3.0))
    return rne.drives(scene, Cycle(), gear=GEAR, rotor=ROTOR, efficiency=EFFICIENCY)


def test_a_cycle_by_plain_numpy_and_pinocchio(arm, report):
    """Every figure from the definition, with torques by another engine."""
    t = np.linspace(0, 2.4, 2401)
    q, qd, qdd = Cycle()(t)
    loaded = arm.with_payload(3.0)
    oracle = Oracle(loaded.model, rne.to_urdf(loaded.model))
    tau = np.array([oracle.inverse_dynamics(*state) for state in zip(q, qd, qdd, strict=True)])
    tau = tau + 2.0 * qd + 3.0 * np.tanh(qd / 0.01)
    power = tau * qd
    motor = ROTOR * GEAR * qdd + np.where(power < 0, tau * EFFICIENCY, tau / EFFICIENCY) / GEAR

    def integral(x):
        return ((x[1:] + x[:-1]) / 2 * np.diff(t)[:, None]).sum(0)

    motor_power = motor * GEAR * qd
    expected = {
        "peak_torque": np.abs(tau).max(0),
        "rms_torque": np.sqrt(integral(tau**2) / 2.4),
        "peak_speed": np.abs(qd).max(0),
        "mean_speed": integral(np.abs(qd)) / 2.4,
        "peak_power": np.abs(motor_power).max(0),
        "energy_taken": integral(np.maximum(motor_power, 0)),
        "energy_returned": integral(np.maximum(-motor_power, 0)),
        "work": integral(power),
        "torque_share": np.abs(tau + ROTOR * GEAR**2 * qdd).max(0) / arm.effort_limit,
        "speed_share": np.abs(qd).max(0) / arm.velocity_limit,
        "duty": integral((np.abs(qd) > 0.01 * np.abs(qd).max(0)).astype(float)) / 2.4,
        "motor_torque": motor,
    }
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(report, name), value, rtol=0, atol=SUMS * np.abs(value).max(), err_msg=name)
    np.testing.assert_array_equal(report.peak_torque_time, t[np.abs(report.tau).argmax(0)])


def test_energy_taken_less_returned_is_work_and_losses(report):
    spent = report.work + report.gear_losses + report.rotor_energy
    np.testing.assert_allclose(
        report.energy_taken - report.energy_returned, spent, atol=SUMS * report.energy_taken.max()
    )
    assert (report.gear_losses[[0, 1, 2, 4, 5]] > 0).all()  # joint 4 stays where it is


def test_work_is_the_change_of_energy(arm):
    """Without friction from rest to rest: that of height; the trapezoidal rule at 1 ms is good to 1e-6 of the energies."""
    motion = quintic(HOME, PICK, 0.8)
    found = rne.drives(arm, motion)
    lift = arm.potential_energy(PICK) - arm.potential_energy(HOME)
    assert found.work.sum() == pytest.approx(float(lift), abs=1e-6 * found.energy_taken.sum())


def test_planned_simulated_and_measured_motions_agree(arm):
    """A simulated motion that follows the plan, and its samples as a record, need what the plan says."""
    plan = quintic(HOME, PICK, 0.8)
    law = rne.control.computed_torque(arm, 400, 40, plan)
    motion = rne.simulate(arm, HOME, [0] * 6, 0.8, torque=law, rtol=1e-9)
    t = np.linspace(0, 0.8, 801)
    record = rne.identification.Record(t, motion(t)[0], motion.torques(t))
    within = record.prepare().t  # without the ends, on which the filter has not settled
    window = rne.trajectories.Samples(within, *plan(within), arm.inverse_dynamics(*plan(within)))
    reports = [rne.drives(arm, x) for x in (plan, motion, window, record)]
    np.testing.assert_allclose(reports[1].rms_torque, reports[0].rms_torque, rtol=BETWEEN_STEPS)
    np.testing.assert_allclose(reports[3].rms_torque, reports[2].rms_torque, rtol=BETWEEN_STEPS)
    np.testing.assert_allclose(reports[3].peak_speed, reports[2].peak_speed, rtol=0.02, atol=1e-6)  # filtered
    np.testing.assert_allclose(reports[1].bearings.force, reports[0].bearings.force, rtol=1e-4)


def reach(scene_of, **options):
    """A stiff PD loop from rest, whose wrist moves fastest in the first milliseconds."""
    return rne.simulate(scene_of, [0] * 6, [0] * 6, 0.1, **options)


def pulse(t, q, qd):
    """A torque of 200 N m for 0.4 ms, which no joint notices much."""
    return np.where((t >= 0.2003) & (t < 0.2007), [0, 0, 200.0, 0, 0, 0], 0.0) - 5.0 * qd


SOFT = rne.control.computed_torque(rne.load("irb140"), [100] * 6, [20] * 6, quintic(HOME, PICK, 0.4))
GAINS = [50] * 6, [20] * 6, [1, 0.5, -1, 2, 1, -2]
SIMULATED = {
    "at the solver's steps": ({}, {}),
    "explicit": ({}, {"method": "DOP853", "rtol": 1e-5}),
    "dry friction": ({"friction": rne.Friction(viscous=2.0, coulomb=3.0, smoothing=0)}, {}),
    "sampled": ({"sample_time": 2e-3, "controller": SOFT}, {}),
}


@pytest.mark.parametrize("case", SIMULATED)
def test_simulated_motions_are_reported_at_their_own_samples(irb140, case):
    """No peak is below a recorded one, the ledger's work comes out, and the bearings' loads are theirs."""
    parts, options = SIMULATED[case]
    scene = rne.Scene(irb140, **{"controller": rne.control.pd_gravity(irb140, *GAINS)} | parts)
    motion = reach(scene, **options)
    found = rne.drives(irb140, motion)
    assert (found.peak_torque >= np.abs(np.vstack([motion.tau, motion.tau_before])).max(0)).all()
    assert (found.peak_speed >= np.abs(motion.qd).max(0)).all()
    assert (found.peak_power >= np.abs(motion.tau * motion.qd).max(0)).all()
    exchanged = np.trapezoid(np.abs(found.power), found.t, axis=0).sum()
    assert found.work.sum() == pytest.approx(motion.work[-1], abs=QUADRATURE * exchanged)
    assert found.work_error < QUADRATURE * exchanged
    assert "too far apart" not in str(found)
    own = rne.dynamics.bearing_loads(irb140.recursion(motion.q, motion.qd, motion.qdd), irb140.model)
    peaks = rne.bearing_peaks(irb140, motion)
    np.testing.assert_array_equal(peaks.force, found.bearings.force)
    assert (peaks.force >= own[0].max(0)).all()


def test_a_pulse_between_breaks_is_seen_by_every_report():
    still = rne.load("irb140", gravity=(0, 0, 0)).with_limits(effort=[100.0] * 6)
    motion = rne.simulate(rne.Scene(still, controller=pulse), [0] * 6, [0] * 6, 0.4, breaks=(0.2003, 0.2007), rtol=1e-9)
    found = rne.drives(still, motion)
    assert found.peak_torque[2] == np.abs(motion.tau).max() == pytest.approx(200, rel=1e-3)
    assert found.peak_torque_time[2] == 0.2003
    assert found.work.sum() == pytest.approx(motion.work[-1], rel=QUADRATURE)
    (violation,) = motion.check_limits()
    assert (violation.joint, violation.first_time, violation.worst_time) == ("joint_3", 0.2003, 0.2003)


def test_times_of_t_eval_are_reported_alone(irb140):
    """Nothing is interpolated between them; where the work tells that they are too far apart, the print says so."""
    scene = rne.Scene(irb140, controller=rne.control.pd_gravity(irb140, *GAINS))
    grids = np.linspace(0, 0.1, 11), np.append(0, np.geomspace(1e-6, 0.1, 1000))
    coarse, fine = (reach(scene, t_eval=t, rtol=1e-8) for t in grids)
    for motion in (coarse, fine):
        found = rne.drives(irb140, motion)
        for name in ("t", "q", "qd", "qdd", "tau"):
            np.testing.assert_array_equal(getattr(found, name), getattr(motion, name))
        assert [v.worst_time in motion.t for v in motion.check_limits()].count(False) == 0
    found = rne.drives(irb140, coarse)
    doubt = str(found).splitlines()[-len(str(found.bearings).splitlines()) - 1]
    assert doubt == (
        f"The samples are too far apart: the work computed from them differs from the simulation's by a total of "
        f"{found.work_error:.3g} J; simulate without t_eval, with a finer one or smaller tolerances"
    )
    assert "too far apart" not in str(rne.drives(irb140, fine))


def test_planned_motions_are_reported_on_both_sides_of_their_jumps(arm):
    """A ramp of 0.1 ms that a grid of 1 ms would miss, and the corners of a fastest motion."""
    jerk = rne.trajectories.trapezoidal(HOME, PICK, 1.0, 1e-4)
    found = rne.drives(arm, jerk)
    for instant in jerk.breaks:
        sides = np.nextafter(instant, [-1.0, 2.0])
        tau = arm.inverse_dynamics(*jerk(sides[(sides > 0) & (sides < 1), None]))
        assert (found.peak_torque >= np.abs(tau).max(0) * (1 - SUMS)).all()
    motion = rne.trajectories.fastest(arm, [HOME, PICK], smoothing=0)
    report = rne.drives(arm, motion)
    assert (report.torque_share >= motion.shares()["torque"].max(0) * (1 - SUMS)).all()
    assert (report.speed_share >= motion.shares()["velocity"].max(0) * (1 - SUMS)).all()


def test_the_payload_of_a_planned_motion_counts(arm):
    motion = rne.trajectories.fastest(arm, [HOME, PICK], payload=3.0)
    found, light = rne.drives(arm, motion), rne.drives(arm, quintic(HOME, PICK, motion.duration))
    assert found.torque_share.max() == pytest.approx(1.0, abs=0.01)
    assert found.bearings.force[-1] > light.bearings.force[-1]
    np.testing.assert_array_equal(found.bearings.force, rne.drives(motion.scene, motion).bearings.force)


def test_a_scene_that_is_given_counts_for_a_planned_motion(arm):
    """Friction is added to the torques of a motion that was planned without; of a robot alone, the motion's own count."""
    motion = rne.trajectories.fastest(arm, [HOME, PICK])
    plain, rough = rne.drives(arm, motion), rne.drives(rne.Scene(arm, friction=rne.Friction(viscous=40.0)), motion)
    assert np.array_equal(plain.tau, motion.torques(plain.t))
    assert abs(rough.tau - plain.tau - 40.0 * plain.qd).max() < SUMS * abs(rough.tau).max()


def test_a_robot_with_a_payload_counts_for_a_planned_motion(arm):
    motion = rne.trajectories.fastest(arm, [HOME, PICK])
    loaded = arm.with_payload(3.0)
    found = rne.drives(loaded, motion)
    np.testing.assert_allclose(found.tau, loaded.inverse_dynamics(found.q, found.qd, found.qdd), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("kind", ["planned", "simulated"])
def test_a_motion_of_another_robot_is_refused(arm, kind):
    other = rne.load("ur5")
    motion = rne.trajectories.fastest(arm, [HOME, PICK]) if kind == "planned" else rne.simulate(arm, HOME, HOME, 0.1)
    text = f"`motion` must be of the robot {other.model.name!r} with joints {list(other.joint_names)}, it is of "
    for report in (rne.drives, rne.bearing_peaks):
        with pytest.raises(ValueError, match=f"^{re.escape(text)}"):
            report(other, motion)


def test_a_model_is_no_robot_of_a_planned_motion(arm):
    with pytest.raises(TypeError, match=r"^`robot` must be an rne.Robot, got Model$"):
        rne.drives(arm.model, rne.trajectories.fastest(arm, [HOME, PICK]))


def test_rotors_that_a_motion_was_not_planned_for_are_told(arm):
    """The torque at the gear's output is that of the load and of the reflected rotor, gear^2 rotor qdd."""
    motion = rne.trajectories.fastest(arm, [HOME, PICK])
    found = rne.drives(arm, motion, gear=100, rotor=1e-4)
    needed = abs(found.tau + found.qdd).max(0) / arm.effort_limit
    told = ", ".join(f"{j} {x:.0%}" for j, x in zip(arm.joint_names, needed, strict=True) if x > 1.005)
    assert f"With their rotors included, drives exceed their torque limits: {told}; to take" in str(found)
    counted = rne.trajectories.fastest(arm.with_armature(1.0), [HOME, PICK])
    assert "With their rotors" not in str(rne.drives(rne.Scene(arm), counted, gear=100, rotor=1e-4))
    assert "With their rotors" not in str(rne.drives(arm, motion, gear=100))


def test_tables_name_every_joint_twice(report):
    lines = str(report).splitlines()
    assert lines[0] == "Drives over a cycle of 2.4 s, 2401 samples"
    assert sum(line.startswith("joint_3") for line in lines) == 3  # with the bearings
    assert "J taken" in str(report)


@pytest.mark.parametrize(
    ("motion", "options", "error", "text"),
    [
        (Cycle(), {"efficiency": 1.2}, ValueError, "`efficiency` must be at most 1, got 1.2"),
        (Cycle(), {"gear": 0}, ValueError, "`gear` must be positive, got 0.0"),
        (
            len,
            {},
            TypeError,
            "`motion` must have a `duration`, or arrays t, q and qd; got only a function of time: "
            'rne.trajectories.sampled(t, q, "cubic") makes a motion of its positions',
        ),
        (3, {}, TypeError, "`motion` must be a function of time or have arrays t, q and qd, got int"),
        (
            quintic([0], [1], 1),
            {},
            ValueError,
            "`motion.q` must have shape (1001, 6), got (1001, 1)",
        ),
        (
            samples([0.0]),
            {},
            ValueError,
            "`motion` must last longer than an instant, got 1 sample",
        ),
        (samples([]), {}, ValueError, "`motion` must have at least one sample, got none"),
        (samples([1.0, 1.0]), {}, ValueError, "`motion` must last longer than an instant, got 2 samples"),
        (samples([0.0, 2.0, 1.0]), {}, ValueError, "times of `motion` must ascend, got 1 s after 2 s"),
        (samples([0.0, np.nan]), {}, ValueError, "`motion.t` must be finite, got nan at index (1,)"),
        (samples([0.0, 1.0], qd=np.nan), {}, ValueError, "`motion.qd` must be finite, got nan at index (0, 0)"),
        (samples([0.0, 1.0], tau=0.0, n=1), {}, ValueError, "`motion.tau` must have shape (2, 6), got (2, 1)"),
    ],
)
def test_what_is_refused(arm, motion, options, error, text):
    with pytest.raises(error, match=f"^{re.escape(text)}$"):
        rne.drives(arm, motion, **options)


def test_the_command_plans_and_reports_and_writes_a_page(tmp_path, capsys, monkeypatch):
    from rne.__main__ import main

    monkeypatch.setattr("rne.plotting.html_page.Report.film", lambda *_: None)
    monkeypatch.setattr("rne.plotting.html_page.has_matplotlib", lambda: False)  # pictures have tests of their own
    via = tmp_path / "via.csv"
    names = [f"joint_{k}" for k in range(1, 7)]
    np.savetxt(
        via, np.degrees([HOME, PICK, PLACE]), delimiter=",", header=",".join(f"q.{x}" for x in names), comments=""
    )
    effort = [str(x) for x in (250, 250, 150, 50, 50, 20)]
    call = ["cycle", "irb140", str(via), "--degrees", "--out", str(tmp_path / "page"), "--effort"]
    assert main([*call, *effort, "--gear", "100", "--rotor", "1e-4", "--stops"]) == 0
    said = capsys.readouterr().out
    path = rne.trajectories.through([HOME, PICK, PLACE], stops=True)
    turned = rne.load("irb140").with_limits(effort=[float(x) for x in effort]).with_armature(1.0)
    assert str(rne.trajectories.fastest(turned, path)) in said  # its rotors are in what is limited
    assert "With their rotors" not in said
    assert "Drives over a cycle of" in said
    assert "Peak loads on the bearings" in (tmp_path / "page" / "index.html").read_text()
    assert main(["cycle", "irb140", str(via), "--out", str(tmp_path / "page")]) == 2
    assert "on the command line: --effort or --acceleration" in capsys.readouterr().err
    assert main([*(x for x in call if x != "--degrees"), *effort]) == 2
    assert "if the positions are in degrees, give --degrees" in capsys.readouterr().err
    via.write_text("joint_1,joint_2\n1,2\n")
    assert main([*call, *effort]) == 2
    assert f"the first row must be {','.join(f'q.{x}' for x in names)}" in capsys.readouterr().err


def test_picture_has_the_torques_that_its_limits_count():
    """Those of the rotors are in both; joints of which the first has no limit have one legend."""
    robot = rne.Robot(straight_chain(2)).with_limits(effort=[np.inf, 9.0])
    motion = rne.trajectories.quintic([0.3, 0.2], [1.3, 0.7], 0.5)
    rotor, gear = 2e-4, 100.0
    report = rne.drives(robot, motion, gear=gear, rotor=rotor)
    carried = report.tau + rotor * gear**2 * report.qdd
    figure = rne.plotting.torque_speed(report)
    for k, ax in enumerate(figure.axes):
        drawn = ax.lines[0].get_ydata()
        np.testing.assert_allclose(drawn, carried[:, k], rtol=1e-12)  # rounding
        assert ax.lines[1].get_ydata() == drawn[np.abs(drawn).argmax()]
        (rms,) = {abs(line.get_ydata()[0]) for line in ax.lines if line.get_linestyle() == ":"}
        mean_square = np.trapezoid(carried[:, k] ** 2, report.t) / report.duration
        assert rms == pytest.approx(mean_square**0.5, rel=1e-12)
    assert np.abs(report.drive_torque[:, 1]).max() / 9.0 == pytest.approx(report.torque_share[1])
    (legend,) = figure.legends
    assert {text.get_text() for text in legend.get_texts()} == {"cycle", "peak", "rms", "limits"}


def test_picture_has_the_limits_of_every_joint(report):
    figure = rne.plotting.torque_speed(report)
    assert figure.get_figheight() > 2 * len(figure.axes) / 2  # inches, for rows of two
    for k, ax in enumerate(figure.axes):
        dashed = {
            tuple(np.unique(line.get_xdata() + line.get_ydata())) for line in ax.lines if line.get_linestyle() == "--"
        }
        assert any(report.effort_limit[k] in x for x in dashed)
        assert any(report.velocity_limit[k] in x for x in dashed)
        assert ax.get_title() == report.joints[k]


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("0,0\n1,1\n", ", row 1: the names of the columns are missing; above the numbers is needed, for example, '{heading}'"),
        ("j1,j2\n0,0\n", ", row 1: there is no column {names}, which is needed; there are 'j1', 'j2'; the first row must be {heading}"),
        ("j1;j2\n0;0\n", ", row 1: there is no column {names}, which is needed; there are 'j1;j2'; separate columns by commas; the first row must be {heading}"),
        ("{heading}\n0,0,0,0,0,0\n", ": a path needs two via points at least, there is one row"),
    ],
)  # fmt: skip
def test_files_of_via_points_are_refused_without_asking_for_times(text, error, tmp_path, capsys):
    from rne.__main__ import main

    via, joints = tmp_path / "via.csv", [f"q.joint_{k}" for k in range(1, 7)]
    heading = ",".join(joints)
    via.write_text(text.format(heading=heading))
    assert main(["cycle", "irb140", str(via), "--out", str(tmp_path / "page")]) == 2
    names = ", ".join(map(repr, joints[:4])) + " and 2 more"
    assert capsys.readouterr().err == f"error: {via}{error.format(heading=heading, names=names)}\n"


def test_a_column_of_times_of_via_points_is_ignored(tmp_path):
    from rne.files.samples import read_samples

    (tmp_path / "via.csv").write_text("t,q.a\n0,1\n0,2\n")
    samples = read_samples(tmp_path / "via.csv", ["a"], needed=["q"], timed=False)
    assert samples.q.tolist() == [[1], [2]]
