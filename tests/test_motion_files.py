"""rne torques on files that are read without an error and are wrong: noise, units, wrapped angles, missing limits."""

import itertools
import re

import numpy as np
import pytest

import rne
from rne.__main__ import main
from rne.commands.moving import filtered, noise, suggested_cutoff
from rne.trajectories import Samples

from .helpers import kept, loaded

pytestmark = pytest.mark.usefixtures("irb140_once")

NAMES = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}  # of a time, in a second

END = np.array([1.0, -0.8, 0.6, 1.2, 0.5, -1.0])
LINK = '<link name="{}"><inertial><mass value="1"/><origin xyz="1 0 0"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
JOINT = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><axis xyz="{}"/></joint>'
ARM = f"""<robot name="arm"><link name="base"/>{LINK.format("rotor")}{LINK.format("carriage")}
{JOINT.format("turn", "continuous", "base", "rotor", "0 0 1")}{JOINT.format("slide", "prismatic", "rotor", "carriage", "1 0 0")}</robot>"""
SLIDES = '<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'
CAPACITY = 91  # [N m], some more than the largest torque of the motion to END in 1 s


def times(step):
    return np.arange(0, 1 + step / 2, step)


def moved(t):
    return rne.trajectories.quintic([0] * 6, END, 1.0)(t)


def shaken(x, size, seed=0):
    return x + size * np.random.default_rng(seed).normal(size=x.shape)


@pytest.fixture
def torques(tmp_path, capsys):
    """Run `rne torques irb140` on samples; the torques, and the lines beside them."""

    def run(t, *columns, options=(), robot="irb140", code=0):
        joints = rne.load(robot).joint_names
        names = ["t", *(f"{q}.{joint}" for q, _ in zip(("q", "qd", "qdd"), columns, strict=False) for joint in joints)]
        file, out = tmp_path / "motion.csv", tmp_path / "torques.csv"
        np.savetxt(file, np.column_stack([t, *columns]), "%.17g", delimiter=",", header=",".join(names))
        assert main(["torques", robot, str(file), "--out", str(out), *options]) == code
        said = capsys.readouterr()
        tau = np.loadtxt(out, delimiter=",", skiprows=1)[:, 1:] if code == 0 else None
        warnings = [line for line in said.err.splitlines() if not line.startswith("  ")]  # progress on a busy machine
        return tau, said.out.splitlines(), warnings

    return run


class TestNoise:
    """Of 1 kHz, where 1e-4 rad of noise become some 500 rad/s^2."""

    t = times(1e-3)

    def test_it_is_named_beside_the_torques_it_makes(self, torques):
        q, *_ = moved(self.t)
        tau, _, (warning,) = torques(self.t, shaken(q, 1e-4))
        assert np.abs(tau).max() > 100 * CAPACITY
        found = re.fullmatch(
            r"warning: q\.joint_\d scatters by about 0.0001 from sample to sample, and derivatives turn such noise into "
            r"about (\S+) N m \(rms\) on (joint_\d), more than 5% of its torque: give --cutoff (\S+), or give "
            r"velocities and accelerations",
            warning,
        )
        k = int(found[2][-1]) - 1
        assert float(found[1]) == pytest.approx(np.sqrt((tau[:, k] ** 2).mean()), rel=0.5)  # nearly all of it is noise

    def test_the_proposed_filter_finds_the_torques_of_the_motion(self, torques):
        q, qd, qdd = moved(self.t)
        exact = loaded("irb140").inverse_dynamics(q, qd, qdd)
        _, _, (warning,) = torques(self.t, shaken(q, 1e-4))
        cutoff = re.search(r"--cutoff (\S+),", warning)[1]
        tau, said, warnings = torques(self.t, shaken(q, 1e-4), options=["--cutoff", cutoff])
        assert warnings == []
        assert np.abs(tau - exact)[:, :5].max(axis=0) == pytest.approx(0, abs=0.15 * CAPACITY)
        assert np.sqrt(((tau - exact) ** 2).mean()) < 0.03 * CAPACITY
        assert re.fullmatch(rf"zero-phase .* filter of {cutoff} Hz; it changes q by at most 0.000\d+ rad or m", said[2])

    def test_a_filter_that_leaves_too_much_is_told_too(self, torques):
        _, _, warnings = torques(self.t, shaken(moved(self.t)[0], 1e-4), options=["--cutoff", "100"])
        assert len(warnings) == 1
        assert "scatters by about 0.0001" in warnings[0]

    def test_of_velocities_it_counts_too(self, torques):
        q, qd, _ = moved(self.t)
        _, _, (warning,) = torques(self.t, q, shaken(qd, 1e-2))
        assert warning.startswith("warning: qd.joint_")

    def test_nothing_is_differentiated_where_all_is_given(self, torques):
        q, qd, qdd = moved(self.t)
        assert torques(self.t, shaken(q, 1e-4), shaken(qd, 1.0), qdd)[2] == []

    @pytest.mark.parametrize("step", [1e-3, 1e-2, 5e-2])
    def test_a_clean_file_gives_no_warning(self, step, torques):
        assert torques(times(step), moved(times(step))[0])[2] == []

    @pytest.mark.parametrize("samples", [30, 101, 1001])
    def test_a_trapezoidal_velocity_gives_no_warning(self, samples, torques):
        """Its accelerations jump, which is no noise."""
        t = np.linspace(0, 1, samples)
        s = np.where(t < 0.25, 2 * t**2, np.where(t < 0.75, t - 0.125, 0.75 - 2 * (1 - t) ** 2))
        assert torques(t, np.outer(s, END))[2] == []

    def test_a_swing_without_torque_gives_no_warning(self, torques, irb140):
        t = np.linspace(0, 1, 201)
        q = rne.simulate(irb140, [0] * 6, [0] * 6, 1.0, rtol=1e-10, t_eval=t).q
        assert torques(t, q)[2] == []
        assert torques(t, q.round(8))[2] == []  # noise that is small beside gravity

    def test_uneven_times_leave_no_filter(self, torques):
        t = self.t + np.random.default_rng(1).uniform(-2e-4, 2e-4, len(self.t))
        _, _, (warning,) = torques(t, shaken(moved(t)[0], 1e-4))
        assert warning.endswith(": give samples at even steps and --cutoff, or give velocities and accelerations")
        _, _, error = torques(t, moved(t)[0], options=["--cutoff", "10"], code=2)
        assert error == ["error: --cutoff: needs times at even steps"]

    @pytest.mark.parametrize("cutoff", ["0", "500", "-1"])
    def test_a_cutoff_is_below_half_the_sampling_rate(self, cutoff, torques):
        _, _, error = torques(self.t, moved(self.t)[0], options=["--cutoff", cutoff], code=2)
        assert error == [f"error: --cutoff: must be between 0 and 500 Hz, half the sampling rate; got {cutoff}"]


@pytest.mark.parametrize("cutoff", [3.0, 30.0])
def test_a_filter_leaves_what_is_slow_also_at_the_ends(cutoff):
    """A ramp is continued beyond its ends as the ramp it is: what is left there decays with the filter."""
    t = times(1e-3)
    ramp = Samples(t, t[:, None], 2 * t[:, None])
    (_, q, qd, qdd, _), said = filtered(ramp, cutoff)
    assert np.abs(q - ramp.q).max() < 2e-3 / cutoff
    np.testing.assert_allclose(qd, 2 * q, rtol=0, atol=1e-12)
    assert qdd is None
    assert said.startswith(f"zero-phase Butterworth filter of {cutoff:g} Hz; it changes q by at most ")


def test_a_filter_halves_the_power_twice_at_its_cutoff_and_delays_nothing():
    """Forwards and backwards: 1/sqrt(2) twice, and opposite phases."""
    t = np.arange(0, 20, 1e-3)
    wave = np.sin(2 * np.pi * 5 * t)
    (_, q, *_), _ = filtered(Samples(t, wave[:, None]), 5.0)
    np.testing.assert_allclose(q[5000:-5000, 0], wave[5000:-5000] / 2, rtol=0, atol=1e-3)


class TestNoiseOfSamples:
    @pytest.mark.parametrize("size", [1e-6, 1e-3])
    def test_white_noise_has_its_standard_deviation(self, size):
        t = times(1e-3)
        assert noise(t, shaken(moved(t)[0], size)) == pytest.approx(np.full(6, size), rel=0.2)

    def test_at_uneven_times_as_well(self):
        t = np.sort(np.random.default_rng(2).uniform(0, 1, 1000))
        assert noise(t, shaken(moved(t)[0], 1e-4)) == pytest.approx(np.full(6, 1e-4), rel=0.3)

    def test_a_joint_at_rest_part_of_the_time_shows_that_of_its_motion(self):
        """Rounded to 16 bits of a turn, as an encoder does: q of a joint at rest has no noise at all."""
        t, count = times(1e-3), 2 * np.pi / 2**16
        q = np.where(t < 0.7, 0, (t - 0.7) ** 2)[:, None]
        assert noise(t, np.round(q / count) * count) == pytest.approx(count / np.sqrt(12), rel=0.5)

    @pytest.mark.parametrize("resolution", [0.02, 0.5, 1.0])
    def test_a_sine_has_none(self, resolution):
        """Of up to one radian of phase from sample to sample."""
        t = np.arange(200.0)
        assert noise(t, np.sin(resolution * t)[:, None])[0] <= 1e-13

    def test_in_long_files_it_is_found_by_a_part_of_them(self):
        x = shaken(np.zeros((45_000, 1)), 1e-3)
        assert noise(np.arange(45_000.0), x) == pytest.approx(1e-3, rel=0.05)

    def test_few_samples_show_none(self):
        t = np.linspace(0, 1, 29)
        assert noise(t, shaken(np.zeros((29, 2)), 1.0)).tolist() == [0, 0]

    def test_the_cutoff_falls_as_noise_grows(self):
        """To no less than 2 Hz, below which 99 % of the power of the velocities lies."""
        t = times(1e-3)
        q, _, _ = moved(t)
        for seed in range(3):
            found = []
            for size in (1e-6, 1e-4):
                x = shaken(q, size, seed)
                found.append(suggested_cutoff(t, x, noise(t, x)))
                removed = x - filtered(Samples(t, x), found[-1])[0].q
                assert np.sqrt((removed**2).mean()) < 1.3 * size  # little but the noise
            assert 40 > found[0] > 2 * found[1] > 2 * 2

    def test_a_joint_without_noise_has_no_say_in_the_cutoff(self):
        t = times(1e-3)
        x = shaken(moved(t)[0][:, :1], 1e-4)
        both = np.column_stack([x, np.sin(300 * t)])
        assert suggested_cutoff(t, both, np.array([1e-4, 0.0])) == suggested_cutoff(t, x, np.array([1e-4])) < 15


class TestUnits:
    t = times(1e-2)

    def test_degrees_are_named(self, torques):
        _, _, (warning,) = torques(self.t, np.degrees(moved(self.t)[0]))
        assert warning == (
            "warning: q.joint_4 is up to 68.75 rad, more than a turn beyond the joint's range; if q is in degrees, give "
            "--degrees"
        )

    def test_degrees_are_radians_with_the_option(self, torques):
        radians = moved(self.t)
        tau, _, warnings = torques(self.t, *map(np.degrees, radians), options=["--degrees"])
        assert warnings == []
        np.testing.assert_allclose(tau, torques(self.t, *radians)[0], rtol=0, atol=1e-12 * CAPACITY)

    def test_view_reads_degrees_too(self, tmp_path, monkeypatch):
        shown = []
        monkeypatch.setattr("rne.view", lambda robot, out, **given: shown.append(given["q"]) or 1 / 0)
        (tmp_path / "arm.urdf").write_text(ARM)
        (tmp_path / "m.csv").write_text("t,q.turn,q.slide\n0,180,1\n")
        words = ["view", str(tmp_path / "arm.urdf"), "--motion", str(tmp_path / "m.csv"), "--degrees"]
        with pytest.raises(ZeroDivisionError):
            main([*words, "--out", str(tmp_path / "x.html")])
        assert shown[0].tolist() == [[np.pi, 1]]

    def test_sliding_joints_stay_in_metres(self, tmp_path, capsys):
        (tmp_path / "arm.urdf").write_text(ARM)
        (tmp_path / "m.csv").write_text("t,q.turn,q.slide,qd.turn,qd.slide,qdd.turn,qdd.slide\n0,0,1,0,0,180,2\n")
        assert main(["torques", str(tmp_path / "arm.urdf"), str(tmp_path / "m.csv"), "--degrees"]) == 0
        row = capsys.readouterr().out.splitlines()[-1]
        expected = rne.load(tmp_path / "arm.urdf").inverse_dynamics([0, 1], [0, 0], [np.pi, 2])
        assert [float(x) for x in row.split(",")[1:]] == pytest.approx(expected.tolist())

    def test_a_joint_beyond_its_range_is_no_degrees(self, torques):
        """By less than a turn: it is a limit that is exceeded."""
        _, said, warnings = torques(self.t, 7 * moved(self.t)[0])
        assert warnings == []
        assert any(line.startswith("limits exceeded: ") and "none" not in line for line in said)

    def test_what_is_beyond_the_ranges_in_degrees_too_is_none(self, torques):
        """A thousand degrees are three turns."""
        assert torques(self.t, 1000 * moved(self.t)[0])[2] == []

    def test_many_turns_of_an_unlimited_joint_are_no_degrees(self, torques, tmp_path):
        path = tmp_path / "arm.urdf"
        path.write_text(ARM)
        assert torques(self.t, np.outer(self.t**3, [300, 1]), robot=str(path))[2] == []

    @pytest.mark.parametrize(
        ("unit", "start", "rows"),
        kept(
            list(itertools.product(["ms", "us", "ns"], [0.0, 1.7e9], [2, 5, 20, 101])),
            [("ms", 0.0, 2), ("ms", 1.7e9, 101), ("us", 0.0, 20), ("us", 1.7e9, 5), ("ns", 1.7e9, 2), ("ns", 0.0, 101)],
        ),
    )
    def test_times_in_other_units_are_refused_and_read_if_the_unit_is_given(self, torques, unit, start, rows):
        """Of 100 samples per second; stamps since 1970 have 2.4e-7 s left in double precision, and q some 1e-6 rad."""
        begin = 40 if rows < 50 else 0
        t, q = self.t[begin : begin + rows], moved(self.t)[0][begin : begin + rows]
        stamps = np.round((t + start) * UNITS[unit])
        _, _, (error,) = torques(stamps, q, code=2)
        assert f"column 't' looks like {NAMES[unit]}, not seconds: " in error
        assert error.endswith(f"give --time-unit {unit}, or s if they are seconds")
        tau, expected = torques(stamps, q, options=["--time-unit", unit])[0], torques(t, q)[0]
        np.testing.assert_allclose(tau, expected, atol=1e-9 if start == 0 else 0.5)
        at_rest = torques(stamps, q, options=["--time-unit", "s"])[0]
        assert np.abs(at_rest - rne.load("irb140").gravity_torque(q)).max() < 1e-3

    def test_it_is_said_why_times_are_no_seconds(self, torques, tmp_path):
        q, qd, _ = moved(self.t)
        errors = [
            torques(1000 * self.t + start, q, *also, code=2)[2][0]
            for start, also in ((0, ()), (0, (qd,)), (1.7e12, ()))
        ]
        reasons = (
            "its steps are 10, and no joint would be faster than 0.0022 rad/s or m/s",
            "qd is 1e+03 times the differences of q over those of t",
            "up to 1.7e+12, in steps of 10",
        )
        file = tmp_path / "motion.csv"
        assert errors == [
            f"error: {file}: column 't' looks like milliseconds, not seconds: {reason}; give --time-unit ms, or s if "
            "they are seconds"
            for reason in reasons
        ]

    @pytest.mark.parametrize("unit", ["ms", "us", "ns"])
    def test_dates_are_named_by_their_unit_however_fast_the_joints(self, torques, unit):
        stamps = np.round((self.t + 1.7e9) * UNITS[unit])
        assert f"looks like {NAMES[unit]}, not seconds: " in torques(stamps, 20 * moved(self.t)[0], code=2)[2][0]

    def test_spikes_do_not_hide_milliseconds(self, torques):
        q = moved(self.t)[0]
        q[50, 2] += 3.0
        assert "milliseconds" in torques(1000 * self.t, q, code=2)[2][0]

    def test_samples_of_6_kilohertz_may_be_in_milliseconds(self, torques):
        _, _, (error,) = torques(15 * self.t, 0.01 * moved(self.t)[0], code=2)  # steps of 0.15
        assert "column 't' looks like milliseconds, not seconds: its steps are 0.15," in error

    @pytest.mark.parametrize("step", [1.0, 10.0])
    def test_motions_by_hand_are_in_seconds(self, torques, step):
        t, q = step * np.arange(3.0), np.outer([0, 1, 3], [0.1, 0, 0, 0.05, 0, 0])
        assert torques(t, q)[2] == []

    def test_a_slow_motion_is_no_milliseconds(self, torques):
        """A hundredth of the fastest that the joints can do, in steps of a second; and with its velocities any."""
        q, qd, _ = moved(self.t)
        assert torques(50 * self.t, q)[2] == []
        assert torques(1000 * self.t, q, qd / 1000)[2] == []
        assert torques(self.t, 1e-4 * q)[2] == []

    def test_velocities_of_another_factor_are_no_milliseconds(self, torques):
        q, qd, _ = moved(self.t)
        for factor, said in ((1e5, "1e+05"), (100, "100"), (-1, "-1")):
            warning = f"warning: qd is {said} times the differences of q over those of t; check their units and signs"
            assert torques(self.t, q, factor * qd)[2] == [warning]
            assert torques(self.t[:9], q[:9], factor * qd[:9])[2] == []  # so few agree by chance

    def test_a_drive_without_velocity_is_no_milliseconds(self, torques, tmp_path):
        path = tmp_path / "arm.urdf"
        path.write_text(ARM.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><limit effort="1" velocity="0"/>'))
        assert torques(self.t, np.outer(self.t**3, [1, 1]), robot=str(path))[2] == []

    def test_a_robot_at_rest_is_no_milliseconds(self, torques):
        assert torques(1000 * self.t, np.zeros((len(self.t), 6)))[2] == []
        assert torques(1000 * self.t, shaken(np.zeros((len(self.t), 6)), 1e-5))[2] == []


class TestWrappedAngles:
    t = times(1e-2)

    def wrapped(self):
        q = moved(self.t)[0] * [1, 1, 1, 5, 1, 1]
        return np.where(q > np.pi, q - 2 * np.pi, q)

    def test_joint_and_time_are_named(self, torques, tmp_path):
        _, _, (error,) = torques(self.t, self.wrapped(), code=2)
        k = int(np.abs(np.diff(self.wrapped()[:, 3])).argmax())
        step = np.diff(self.wrapped()[:, 3])[k]
        assert error == (
            f"error: {tmp_path / 'motion.csv'}: q.joint_4 jumps by {step:.4g} rad between t = {self.t[k]:.6g} s and "
            f"{self.t[k + 1]:.6g} s, as wrapped angles do; unwrap them, for example by numpy.unwrap"
        )

    def test_unwrapped_they_pass(self, torques):
        torques(self.t, np.unwrap(self.wrapped(), axis=0))

    def test_they_do_no_harm_where_velocities_are_given(self, torques):
        _, qd, qdd = moved(self.t)
        torques(self.t, self.wrapped(), qd, qdd)

    def test_a_fast_turn_in_coarse_samples_is_none(self, torques):
        """Steps of nearly a turn beside steps of nearly a turn."""
        torques(np.arange(8.0), np.outer(np.arange(8.0), [6, 0, 0, 0, 0, 0]))
        torques(np.arange(2.0), np.outer(np.arange(2.0), [6, 0, 0, 0, 0, 0]))


class TestLimits:
    t = times(1e-2)

    def limits(self, said):
        return next(line for line in said if line.startswith("limits exceeded"))

    def test_none_is_exceeded_only_where_all_are_known(self, torques):
        q, *_ = moved(self.t)
        said = torques(self.t, q)[1]
        assert self.limits(said) == "limits exceeded: none; the model has no effort limits"
        said = torques(self.t, q, options=["--effort", str(CAPACITY)])[1]
        assert self.limits(said) == "limits exceeded: none"

    def test_times_of_stamps_since_1970_count_from_the_first_row(self, torques):
        """Ten digits of a date would hide the time; what it is told from is told once."""
        q, start, options = moved(self.t)[0], 1681917731.0, ["--effort", f"100,10 {CAPACITY} 100 100 100"]
        near, far = (torques(t, q, options=options)[1] for t in (self.t, start + self.t))
        assert "times of limits count from the first row, t = 1681917731 s" in far
        joint = [
            [re.sub(r"[\d.]+ N m", "", line) for line in said if line.startswith("  joint_2")] for said in (near, far)
        ]
        assert joint[0] == joint[1] != []

    def test_efforts_can_be_given(self, torques):
        q, *_ = moved(self.t)
        said = torques(self.t, q, options=["--effort", f"100,10 {CAPACITY} 100 100 100"])[1]
        assert self.limits(said) == "limits exceeded: 1"
        assert any(
            re.match(r"  joint_2: torque \S+ N m below -10 N m|  joint_2: torque \S+ N m above 10 N m", line)
            for line in said
        )
        _, _, error = torques(self.t, q, options=["--effort", "1 2"], code=2)
        assert error == ["error: --effort must have shape (6,), got (2,)"]

    def test_some_joints_without_limits_are_named(self, torques, tmp_path):
        text = rne.to_urdf(rne.load("irb140", effort=[1000] * 4 + [np.inf] * 2).model)
        (tmp_path / "arm.urdf").write_text(text)
        said = torques(self.t, moved(self.t)[0], robot=str(tmp_path / "arm.urdf"))[1]
        assert self.limits(said).startswith(
            "limits exceeded: none; the model has no effort limits for joint_5, joint_6"
        )

    def test_a_joint_without_ends_needs_no_positions(self, torques, tmp_path):
        (tmp_path / "arm.urdf").write_text(ARM.replace('<axis xyz="1 0 0"/>', SLIDES))
        said = torques(self.t, np.zeros((len(self.t), 2)), robot=str(tmp_path / "arm.urdf"))[1]
        assert self.limits(said) == (
            "limits exceeded: none; the model has no velocity limits for turn; the model has no effort limits for turn"
        )
        (tmp_path / "arm.urdf").write_text(ARM)
        said = torques(self.t, np.zeros((len(self.t), 2)), robot=str(tmp_path / "arm.urdf"))[1]
        assert self.limits(said) == (
            "limits exceeded: none; the model has no position limits; the model has no velocity limits; the model has "
            "no effort limits"
        )

    def test_a_joint_that_mimics_another_needs_no_effort(self, torques, tmp_path):
        driven = ARM.replace('<axis xyz="1 0 0"/>', f'{SLIDES}<mimic joint="turn"/>').replace('effort="1"', "")
        driven = driven.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><limit effort="1" velocity="1"/>')
        (tmp_path / "arm.urdf").write_text(driven)
        said = torques(self.t, np.zeros((len(self.t), 1)), robot=str(tmp_path / "arm.urdf"))[1]
        assert self.limits(said) == "limits exceeded: none"

    def test_simulate_says_it_too(self, tmp_path, capsys):
        assert main(["simulate", "irb140", "--duration", "0.01", "--out", str(tmp_path / "m.csv")]) == 0
        assert "limits exceeded: none; the model has no effort limits\n" in capsys.readouterr().out
