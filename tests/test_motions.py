"""Motions as they are used afterwards: between the samples, at jumps, in files; quantiles of many motions."""

import copy
import csv
import dataclasses
import json
import pickle
import re
import sys
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

import rne

ACROSS = [1.0, 0, -1, 2, 1, -2]
GAINS = [50] * 5 + [60], [20] * 5 + [22]


@pytest.fixture(scope="module")
def swing(irb140):
    return rne.simulate(irb140, [0.1] * 6, [0] * 6, 1.0, rtol=1e-9, atol=1e-12)


@pytest.fixture(scope="module")
def along_ramps(irb140):
    """Computed torque along a trapezoidal reference, whose acceleration jumps three times after the start."""
    reference = rne.trajectories.trapezoidal([0] * 6, ACROSS, 1.0, 0.25)
    law = rne.control.computed_torque(irb140, *GAINS, reference)
    return reference, rne.simulate(rne.Scene(irb140, controller=law), [0] * 6, [0] * 6, 1.2)


@pytest.fixture(scope="module")
def sampled(irb140):
    law = rne.control.pd_gravity(irb140, *GAINS, ACROSS)
    return rne.simulate(rne.Scene(irb140, controller=law, sample_time=1e-4), [0] * 6, [0] * 6, 0.01)


class TestBetweenSamples:
    def test_passes_through_the_samples(self, swing):
        q, qd, qdd = swing(swing.t)
        np.testing.assert_allclose(q, swing.q, rtol=0, atol=1e-14)
        np.testing.assert_allclose(qd, swing.qd, rtol=0, atol=1e-12)
        rounding = 40 * np.finfo(float).eps * abs(swing.q).max() / np.diff(swing.t).min() ** 2
        np.testing.assert_allclose(qdd, swing.qdd, rtol=0, atol=rounding)

    def test_error_falls_with_the_sixth_power_of_the_step(self, irb140):
        exact = np.linspace(0, 0.4, 41)
        truth = rne.simulate(irb140, [0.1] * 6, [0] * 6, 0.4, rtol=1e-12, atol=1e-13, t_eval=exact)

        def error(steps):
            samples = np.linspace(0, 0.4, steps + 1)
            coarse = rne.simulate(irb140, [0.1] * 6, [0] * 6, 0.4, rtol=1e-12, atol=1e-13, t_eval=samples)
            return abs(coarse(exact)[0] - truth.q).max()

        order = np.log2(error(5) / error(10))
        assert 5.0 < order < 7.5

    def test_rates_and_accelerations_are_derivatives(self, swing):
        t, h = np.array([0.123, 0.456, 0.789]), 1e-5
        later, sooner, (_, qd, qdd) = swing(t + h), swing(t - h), swing(t)
        np.testing.assert_allclose((later[0] - sooner[0]) / (2 * h), qd, atol=1e-6)
        np.testing.assert_allclose((later[1] - sooner[1]) / (2 * h), qdd, rtol=1e-4, atol=1e-3)

    @pytest.mark.parametrize(
        ("t", "shape"), [(0.5, (6,)), ([0.1, 0.2], (2, 6)), ([[0.1], [0.2]], (2, 6)), ([0.1], (6,))]
    )
    def test_shapes_are_those_of_reference_motions(self, swing, t, shape):
        reference = rne.trajectories.quintic([0] * 6, ACROSS, 1.0)
        assert [x.shape for x in swing(t)] == [shape] * 3 == [x.shape for x in reference(t)]
        assert swing.torques(t).shape == shape

    def test_torques_between_samples_stay_between_them(self, along_ramps):
        _, motion = along_ramps
        t = np.linspace(0, 1.2, 601)
        tau = motion.torques(t)
        ends = np.vstack([motion.tau, motion.tau_before])
        assert (tau <= ends.max(axis=0) + 1e-12).all()
        assert (tau >= ends.min(axis=0) - 1e-12).all()

    def test_torques_between_jumps_are_monotone_cubics(self, along_ramps):
        _, motion = along_ramps
        jumps = np.searchsorted(motion.t, motion.jumps)
        for first, last in pairwise([0, *jumps, len(motion.t) - 1]):
            before = motion.tau_before[jumps == last] if last in jumps else motion.tau[[last]]
            times = motion.t[first : last + 1]
            cubic = PchipInterpolator(times, np.vstack([motion.tau[first:last], before]))
            inside = np.append(times[:-1] + np.diff(times) / 3, times[-1] - np.diff(times)[-1] / 3)
            np.testing.assert_allclose(motion.torques(inside), cubic(inside), rtol=1e-12, atol=1e-12)  # rounding

    def test_a_motion_is_a_reference(self, irb140, swing):
        law = rne.control.computed_torque(irb140, *GAINS, swing)
        follower = rne.simulate(rne.Scene(irb140, controller=law), swing.q[0], swing.qd[0], 0.15, rtol=1e-8)
        assert abs(follower.q - swing(follower.t)[0]).max() < 1e-6

    def test_single_sample_is_constant(self, irb140):
        motion = rne.simulate(irb140, ACROSS, [0] * 6, 0.0)
        assert motion(0.0)[0].tolist() == ACROSS
        assert motion.torques([0.0, 0.0]).shape == (2, 6)

    @pytest.mark.parametrize("t", [-0.1, 1.1])
    def test_times_outside_are_refused(self, swing, t):
        expected = f"`t` must be within the motion, from 0 to 1 s, got {t}"
        for call in (swing, swing.torques):
            with pytest.raises(ValueError, match=f"^{re.escape(expected)}$"):
                call([0.5, t])

    def test_a_time_that_is_not_finite_is_refused(self, swing):
        with pytest.raises(ValueError, match="`t` must be finite, got nan at index"):
            swing([0.1, np.nan])


class TestJumps:
    def test_a_smooth_motion_has_none(self, swing):
        assert len(swing.jumps) == 0
        assert swing.breaks == ()

    def test_ramps_of_the_reference(self, along_ramps):
        reference, motion = along_ramps
        assert motion.jumps.tolist() == [0.25, 0.75, 1.0]
        before = np.nextafter(motion.jumps, 0)
        place = np.searchsorted(motion.t, motion.jumps)
        for k, (early, late) in enumerate(zip(before, np.nextafter(motion.jumps, 2), strict=True)):
            # the loop holds the reference: what jumps is the reference's acceleration
            expected = reference(late)[2] - reference(early)[2]
            np.testing.assert_allclose(motion.qdd[place[k]] - motion.qdd_before[k], expected, atol=1e-9)
        np.testing.assert_array_equal(motion.torques(motion.jumps), motion.tau[place])
        np.testing.assert_allclose(motion.torques(before), motion.tau_before, rtol=1e-9, atol=1e-9)

    def test_jump_of_torques_is_that_of_inverse_dynamics(self, irb140, along_ramps):
        _, motion = along_ramps
        q, qd = motion(motion.jumps)[:2]
        np.testing.assert_allclose(irb140.inverse_dynamics(q, qd, motion.qdd_before), motion.tau_before, atol=1e-9)

    def test_held_torques_are_constant_between_samples(self, sampled):
        np.testing.assert_allclose(sampled.jumps, np.arange(1, 100) * 1e-4, rtol=1e-12)
        np.testing.assert_array_equal(sampled.tau_before, sampled.tau[:-2])
        middle = (sampled.t[:-2] + sampled.t[1:-1]) / 2
        np.testing.assert_array_equal(sampled.torques(middle), sampled.tau[:-2])

    def test_accelerations_before_a_sample_follow_from_the_torques_held(self, irb140, sampled):
        q, qd = sampled.q[1:-1], sampled.qd[1:-1]
        held = irb140.forward_dynamics(q, qd, sampled.tau_before)
        np.testing.assert_allclose(sampled.qdd_before, held, rtol=1e-9, atol=1e-9)

    def test_dry_friction_that_begins_to_hold(self):
        slider = rne.Robot(
            rne.model.chain(
                [np.eye(3)], [[0, 0, 0]], [2.0], [[0, 0, 0]], [np.eye(3)], axes=[[1, 0, 0]], types="prismatic"
            )
        )
        scene = rne.Scene(slider, friction=rne.Friction(coulomb=4.0, smoothing=0))
        motion = rne.simulate(scene, [0.0], [1.0], 1.0)
        # 4 N brake 2 kg from 1 m/s: at rest after 0.5 s, then the acceleration of -2 m/s^2 ends
        np.testing.assert_allclose(motion.jumps, [0.5], rtol=1e-6)
        np.testing.assert_allclose(motion.qdd_before, [[-2.0]], rtol=1e-9)
        np.testing.assert_allclose(motion([0.25, 0.75])[2], [[-2.0], [0.0]], atol=1e-6)

    def test_times_to_report_have_none(self, irb140):
        law = rne.control.computed_torque(irb140, *GAINS, rne.trajectories.trapezoidal([0] * 6, ACROSS, 1.0, 0.25))
        motion = rne.simulate(rne.Scene(irb140, controller=law), [0] * 6, [0] * 6, 1.2, t_eval=[0, 0.25, 0.5])
        assert motion.jumps.shape == (0,)


def test_a_motion_of_which_no_jumps_are_told_is_a_curve(swing):
    untold = {"jumps", "qdd_before", "tau_before", "run", "at_steps"}
    told = [f.name for f in fields(rne.Trajectory) if f.name not in untold]
    motion = rne.Trajectory(**{name: getattr(swing, name) for name in told})
    np.testing.assert_array_equal(motion(0.51)[1], swing(0.51)[1])
    np.testing.assert_array_equal(motion.torques(0.51), swing.torques(0.51))
    assert motion.at_steps


@pytest.fixture(scope="module")
def entries(along_ramps, tmp_path_factory):
    """A motion's file, and the arrays and texts in it."""
    file = along_ramps[1].save(tmp_path_factory.mktemp("motion") / "motion.npz")
    with np.load(file) as archive:
        arrays = dict(archive)
    return file, arrays, json.loads(str(arrays.pop("texts")))


def fields_of(texts, name=""):
    """The fields of the motion, or of what one of them holds."""
    fields = texts["value"]["fields"]
    return fields[name]["fields"] if name else fields


class TestFiles:
    def test_every_number_is_kept(self, along_ramps, tmp_path):
        _, motion = along_ramps
        back = rne.Trajectory.load(motion.save(tmp_path / "motion.npz"))
        for name in ("t", "q", "qd", "qdd", "tau", "kinetic", "potential", "energy", "work", "jumps", "tau_before"):
            np.testing.assert_array_equal(getattr(back, name), getattr(motion, name))
        assert back.model == motion.model
        for name in ("energy_drift", "evaluations", "method", "status", "message", "energy_start", "scene"):
            assert getattr(back, name) == getattr(motion, name)
        assert back.scene.startswith("Scene(")

    def test_friction_losses_and_states_are_kept(self, irb140, tmp_path):
        law = rne.control.pid(irb140, *GAINS, [1] * 6, ACROSS)
        scene = rne.Scene(irb140, controller=law, friction=rne.Friction(viscous=1, coulomb=1))
        motion = rne.simulate(scene, [0] * 6, [0] * 6, 0.1)
        back = rne.Trajectory.load(motion.save(tmp_path / "motion.npz"))
        assert set(back.dissipated) == {"viscous", "coulomb"}
        np.testing.assert_array_equal(back.balance, motion.balance)
        np.testing.assert_array_equal(back.controller_state, motion.controller_state)
        assert [v.joint for v in back.check_limits()] == [v.joint for v in motion.check_limits()]

    def test_pickling_keeps_the_curve(self, swing):
        swing(0.5)
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(swing))(0.5)[0], swing(0.5)[0])

    def test_table(self, swing, irb140, tmp_path):
        with swing.to_csv(tmp_path / "swing.csv").open(newline="", encoding="utf-8") as file:
            heading, *rows = csv.reader(file)
        assert heading == ["t", *(f"{x}.{joint}" for x in ("q", "qd", "qdd", "tau") for joint in irb140.joint_names)]
        table = np.array(rows, dtype=float)
        np.testing.assert_array_equal(table, np.column_stack([swing.t, swing.q, swing.qd, swing.qdd, swing.tau]))

    def test_table_of_a_motion_without_its_model(self, swing, tmp_path):
        file = replace(swing, model=None).to_csv(tmp_path / "swing.csv")
        heading = file.read_text(encoding="utf-8").splitlines()[0]
        assert heading.split(",")[1:] == [f"{x}.joint_{k}" for x in ("q", "qd", "qdd", "tau") for k in range(1, 7)]

    def test_table_of_pandas(self, swing):
        pandas = pytest.importorskip("pandas", reason="pandas is not installed")
        table = swing.to_dataframe()
        assert isinstance(table, pandas.DataFrame)
        assert table.index.name == "t"
        np.testing.assert_array_equal(table["tau.joint_2"], swing.tau[:, 1])
        np.testing.assert_array_equal(table.index, swing.t)

    def test_tables_of_pandas_need_it(self, swing, monkeypatch):
        monkeypatch.setitem(sys.modules, "pandas", None)
        text = "^`to_dataframe` needs pandas, which is not installed: pip install pandas$"
        with pytest.raises(ImportError, match=text):
            swing.to_dataframe()

    def test_wrong_paths(self, swing, tmp_path):
        with pytest.raises(ValueError, match=r"^`path` must end in \.npz, got 'swing.txt'$"):
            swing.save(tmp_path / "swing.txt")
        for write, name in ((swing.save, "swing.npz"), (swing.to_csv, "swing.csv")):
            with pytest.raises(FileNotFoundError, match=r"^`path` must be in an existing folder, got "):
                write(tmp_path / "nowhere" / name)

    def test_other_files_are_refused(self, tmp_path):
        picture = tmp_path / "picture.png"
        picture.write_bytes(b"\x89PNG")
        empty = tmp_path / "empty.npz"
        empty.write_bytes(b"")
        other = tmp_path / "other.npz"
        np.savez(other, a=np.zeros(3))
        plain = tmp_path / "plain.npy"
        np.save(plain, np.zeros(3))
        for file in (picture, empty, other, plain):
            expected = f"{str(file)!r} is not written by Trajectory.save"
            with pytest.raises(ValueError, match=f"^{re.escape(expected)}$"):
                rne.Trajectory.load(file)
        with pytest.raises(FileNotFoundError):
            rne.Trajectory.load(tmp_path / "none.npz")

    def test_another_version_is_refused(self, tmp_path):
        file = tmp_path / "earlier.npz"
        np.savez(file, texts=np.array(json.dumps({"form": "rne motion 1"})))
        with pytest.raises(ValueError, match=f"^{re.escape(repr(str(file)))}: `version` must be 2, got None$"):
            rne.Trajectory.load(file)

    @pytest.mark.parametrize(
        ("name", "change", "message"),
        [
            ("q", lambda q: q[:, :5], "`qd` must have shape (T, 5), got (T, 6)"),
            ("qd", lambda qd: qd[:-1], "`qd` must have shape (T, 6), got (T-1, 6)"),
            ("tau", lambda tau: tau.ravel(), "`tau` must have shape (T, 6), got (6T,)"),
            ("qdd", lambda qdd: np.zeros((0, 0)), "`qdd` must have shape (T, 6), got (0, 0)"),
            ("q", lambda q: np.where(np.arange(6) == 2, np.nan, q), "`q` must be finite, got nan at index (0, 2)"),
            ("controller_state", lambda z: np.ones(3), "`controller_state` must have shape (T, m), got (3,)"),
            ("energy", lambda e: e / 0.0, "`energy` must be finite, got "),
            ("t", lambda t: t[::-1], "`t` must ascend, got "),
            ("t", lambda t: np.append(t[0], t[:-1]), "`t` must ascend, got 0 s after 0 s"),
            (
                "kinetic",
                lambda e: e.astype(str),
                "`Trajectory.kinetic` must be an array of real numbers, got dtype <U32",
            ),
        ],
    )
    @pytest.mark.filterwarnings("ignore:divide by zero")
    def test_changed_arrays_are_refused(self, swing, tmp_path, name, change, message):
        file = swing.save(tmp_path / "swing.npz")
        with np.load(file) as archive:
            arrays = dict(archive)
        entry = fields_of(json.loads(str(arrays["texts"])))[name]["array"]
        np.savez(file, **(arrays | {entry: change(arrays[entry])}))
        T = len(swing.t)
        for letters, number in (("6T", 6 * T), ("T-1", T - 1), ("(T", f"({T}")):
            message = message.replace(letters, str(number))
        with pytest.raises(ValueError, match=f"^{re.escape(f'{str(file)!r}: {message}')}"):
            rne.Trajectory.load(file)

    def load(self, file, arrays, texts):
        np.savez(file, **arrays, texts=np.array(json.dumps(texts)))
        return rne.Trajectory.load(file)

    @pytest.mark.parametrize(
        ("path", "value", "message"),
        [
            (["status"], "ended", "`Trajectory.status` must be of type int, got 'ended'"),
            (["energy_drift"], float("nan"), "`energy_drift` must be finite, got nan"),
            (["energy_drift"], None, "`Trajectory.energy_drift` must be of type float, got None"),
            (["method"], None, "`Trajectory.method` must be of type str, got None"),
            (["colour"], "red", "`Trajectory.colour` is not known to this version"),
            (["tau"], [1.0], "`Trajectory.tau` must be of type Array, got (1.0,)"),
            (["model", "fields", "colour"], "red", "`Trajectory.model.colour` is not known to this version"),
            (["model", "fields", "coordinate"], [7], "coordinate"),
            (["model", "type"], "Robot", "`Trajectory.model` is of a type that is not known to this version, 'Robot'"),
        ],
    )
    def test_changed_texts_are_refused(self, entries, path, value, message):
        file, arrays, texts = entries
        texts = copy.deepcopy(texts)
        place = fields_of(texts)
        for name in path[:-1]:
            place = place[name]
        place[path[-1]] = value
        with pytest.raises(ValueError, match=f"^{re.escape(repr(str(file)))}: .*{re.escape(message)}"):
            self.load(file, arrays, texts)

    def test_texts_of_another_form_are_refused(self, entries):
        file, arrays, texts = entries
        with pytest.raises(ValueError, match=f"^{re.escape(repr(str(file)))} is not written by Trajectory.save$"):
            self.load(file, arrays, [*texts])

    def test_an_array_that_is_missing_is_named(self, entries):
        file, arrays, texts = entries
        for held, owner in ((fields_of(texts), "Trajectory"), (fields_of(texts, "model"), "Trajectory.model")):
            for name, entry in ((n, x["array"]) for n, x in held.items() if isinstance(x, dict) and "array" in x):
                text = f"{str(file)!r}: `{owner}.{name}` is missing"
                with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
                    self.load(file, {key: value for key, value in arrays.items() if key != entry}, texts)

    def test_no_array_of_another_kind_or_shape_is_taken(self, entries):
        file, arrays, texts = entries
        for k, (name, value) in enumerate(arrays.items()):  # of each kind some
            for wrong in (value.astype(str), value.astype(complex), np.array(None).astype("S"))[k % 3 :: 3]:
                with pytest.raises(ValueError, match=f"must be an array of real numbers, got dtype {wrong.dtype}$"):
                    self.load(file, arrays | {name: wrong}, texts)
        for name in ("q", "work", "jumps"):
            entry = fields_of(texts)[name]["array"]
            for wrong in (np.zeros((2, *arrays[entry].shape)), np.array(1.0), np.full(arrays[entry].shape, np.nan)):
                with pytest.raises(ValueError, match=rf"`{name}d?` must (have shape|be finite)"):
                    self.load(file, arrays | {entry: wrong}, texts)

    def test_columns_are_those_of_the_model(self, swing, two, tmp_path):
        file = replace(swing, model=two.model).save(tmp_path / "swing.npz")
        text = f"{str(file)!r}: `q` must have 2 columns, as its model, got 6"
        with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
            rne.Trajectory.load(file)

    def test_jumps_are_among_the_times(self, entries):
        file, arrays, texts = entries
        entry = fields_of(texts)["jumps"]["array"]
        jumps = arrays[entry]
        assert len(jumps)
        for wrong in (jumps + 1e-3, jumps[::-1], 0 * jumps):
            with pytest.raises(ValueError, match=r"`jumps` must be among the times `t`, and ascend$"):
                self.load(file, arrays | {entry: wrong}, texts)


class TestEnsembles:
    def test_torques_are_those_of_the_law(self, irb140):
        law = rne.control.pd_gravity(irb140, *GAINS, ACROSS)
        starts = np.random.default_rng(1).uniform(-1, 1, (5, 6))
        motions = rne.ensemble(rne.Scene(irb140, controller=law), starts, 0 * starts, 1e-3, step=1e-5, keep=3)
        expected = np.array(
            [[law(0.0, q, qd) for q, qd in zip(*rows, strict=True)] for rows in zip(motions.q, motions.qd, strict=True)]
        )
        np.testing.assert_allclose(motions.tau, expected, rtol=1e-12, atol=1e-12)
        assert motions.model.joint_names == irb140.joint_names

    def test_without_drives_there_are_no_torques(self, irb140):
        motions = rne.ensemble(irb140, np.zeros((3, 6)), np.zeros((3, 6)), 1e-3, step=1e-3)
        assert motions.tau.shape == (2, 3, 6)
        assert not motions.tau.any()

    def test_quantiles_count_motions(self, irb140):
        starts = np.random.default_rng(2).uniform(-1, 1, (40, 6))
        motions = rne.ensemble(irb140, starts, 0 * starts, 0.1, step=1e-3, keep=4)
        levels = [0.1, 0.5, 0.9]
        bands = motions.quantiles(levels)
        below = (motions.q[None] <= bands[:, :, None]).mean(axis=2)
        assert (abs(below - np.reshape(levels, (3, 1, 1))) <= 1 / 40).all()
        np.testing.assert_array_equal(motions.quantiles(0.5, of="qd"), np.median(motions.qd, axis=1))

    def test_wrong_arguments(self, irb140):
        motions = rne.ensemble(irb140, np.zeros((2, 6)), np.zeros((2, 6)), 1e-3, step=1e-3)
        none = rne.ensemble(irb140, np.zeros((0, 6)), np.zeros((0, 6)), 1e-3, step=1e-3)
        with pytest.raises(ValueError, match=r"^`of` must be one of \['q', 'qd', 'tau'\], got 'speed'$"):
            motions.quantiles(of="speed")
        with pytest.raises(ValueError, match=r"^`probabilities` must be between 0 and 1, got \[0.5, 1.5\]$"):
            motions.quantiles([0.5, 1.5])
        with pytest.raises(ValueError, match=r"^there are no motions to take quantiles of$"):
            none.quantiles()


def test_damaged_archives_are_refused_or_whole(swing, tmp_path):
    """A byte of the file changed anywhere: an error that names the file, or the same numbers."""
    file = swing.save(tmp_path / "swing.npz")
    whole = file.read_bytes()
    rng = np.random.default_rng(0)
    for place in rng.integers(0, len(whole), 60):
        file.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        try:
            back = rne.Trajectory.load(file)
        except (ValueError, rne.ModelError) as error:
            assert str(error)
        else:
            np.testing.assert_array_equal(back.q, swing.q)


def test_a_motion_without_samples_has_no_curve(two):
    motion = rne.simulate(two, [0.1] * 2, [0.0] * 2, 0.01, t_eval=[])
    for curve in (motion, motion.torques):
        with pytest.raises(ValueError, match=r"^this motion has no samples$"):
            curve(0.0)


def test_a_motion_of_given_samples_needs_them_all(swing):
    with pytest.raises(TypeError, match=r"^Trajectory needs `qdd`$"):
        rne.Trajectory(swing.t, swing.q, swing.qd, evaluations=0, method="measured", status=0)


def test_no_times_give_no_rows(swing):
    assert [x.shape for x in swing(np.zeros(0))] == [(0, 6)] * 3
    assert swing.torques(np.zeros(0)).shape == (0, 6)


def test_times_asked_for_are_marked(irb140, tmp_path):
    motion = rne.simulate(irb140, [0] * 6, [0] * 6, 0.2, t_eval=[0, 0.1, 0.2])
    assert not motion.at_steps
    assert not rne.Trajectory.load(motion.save(tmp_path / "m.npz")).at_steps
    assert rne.simulate(irb140, [0] * 6, [0] * 6, 0.2).at_steps


@pytest.mark.parametrize("name", ["energy_start", "tau", "dissipated", "jumps", "scene"])
def test_torques_and_energies_are_computed_when_one_of_them_is_asked_for(two, name):
    """Whichever comes first, as those of a motion that has them all; a called law's are there at once."""
    scene = rne.Scene(two, friction=rne.Friction(viscous=1.0))
    motion, whole = (rne.simulate(scene, [0.1] * 2, [0] * 2, 0.2) for _ in range(2))
    assert "_derived" not in vars(motion)
    expected, found = (getattr(m, name) for m in (dataclasses.replace(whole), motion))
    assert str(found) == str(expected)
    assert getattr(motion, name) is found  # kept
    calls: list[float] = []
    called = rne.simulate(two, [0.1] * 2, [0] * 2, 0.01, torque=lambda t, q, qd: calls.append(t) or 0 * q)
    count = len(calls)
    assert called.tau.shape == called.q.shape
    assert len(calls) == count  # not again, when the torques are asked for
    with pytest.raises(AttributeError, match="no attribute 'torque'"):
        _ = motion.torque
