"""Numbers from commands and positions: planted ones are found, their errors are what is said, what is wrong is named."""

import re
from dataclasses import replace

import numpy as np
import pytest

import rne
from rne.basics.inertia import pseudo_inertia
from rne.identification import Record
from rne.identification.motion.certainty import Certainty, autocovariance, certainty
from rne.identification.motion.missing import mistaken_columns
from rne.simulation.commanded import CommandedMotion
from rne.trajectories import sampled

from .random_robots import straight_chain

long = pytest.mark.long
FOUND = 1e-6  # relative, of motions without noise
SAME = 1e-6  # of two engines, in standard errors: of where Gauss-Newton ends, times the noise's change by rounding
STEP = 2 * np.pi / 2**14  # of encoders
KP, KD, VISCOUS, COULOMB = (np.array(x) for x in ([40.0, 20.0], [2.0, 1.0], [0.3, 0.2], [0.4, 0.3]))
WRT = ["controller.kp", "friction.viscous", "friction.coulomb"]


def robot_of(n=1, engine="numba"):
    return rne.Robot(straight_chain(n), engine=engine).with_armature(0.05)


def scene_of(robot, factor=1.0, **other):
    """PD control and friction, all but KD times a factor."""
    n = robot.n
    law = rne.control.pd(robot, factor * KP[:n], KD[:n], np.zeros(n))
    friction = {"viscous": factor * VISCOUS[:n], "coulomb": factor * COULOMB[:n], "smoothing": 0.1} | other
    return rne.Scene(robot, controller=law, friction=rne.Friction(**friction))


def sent(t, n):
    """Commands that are held: steps of 0.2 rad along sines."""
    return np.round(np.column_stack([0.8 * np.sin(3 * t + np.sin(t)), 0.6 * np.cos(4 * t)])[:, :n] / 0.2) * 0.2


def planted(scene, end=4.0, rate=100, *, delay=0.0, step=STEP, name="planted"):
    """A record of a scene's motion, by rne.simulate; step 0 without rounding."""
    t = np.arange(round(end * rate) + 1) / rate
    command = sent(t, scene.n)
    late, held = np.concatenate([[-1.0], t + delay, [end + 9]]), np.vstack([command[:1], command, command[-1:]])
    law = replace(scene.controller, reference=sampled(late, held, "hold"))
    start = np.full(scene.n, 0.1), np.full(scene.n, 0.5)
    options = {"t_eval": t, "rtol": 1e-11, "atol": 1e-13}
    q = rne.simulate(replace(scene, controller=law), *start, end, **options).q
    return Record(t, np.round(q / step) * step if step else q, command=command, name=name)


def stepped(scene, end=1.0, rate=25, step=0.02, *, rounded=True, late=0.0):
    """The same by the steps that a fit takes."""
    t = np.arange(round(end * rate) + 1) / rate
    command = sent(t, scene.n)
    law = replace(scene.controller, reference=sampled(t + late, command, "hold"))
    motion = CommandedMotion.of(replace(scene, controller=law), (), 0.0, t, {}, step)
    none, start = (0.0, np.ones(scene.n), np.zeros(scene.n)), np.full((2, scene.n), 0.2)
    q = motion.positions(motion.vectors({}), none, start)
    return Record(t, np.round(q / STEP) * STEP if rounded else q, command=command, name="stepped")


def truth(scene, wrt=WRT):
    return np.concatenate([np.ravel(scene.numbers[name]) for name in wrt])


@pytest.fixture(scope="module")
def rod():
    """By NumPy, as short tests do not compile."""
    return robot_of(engine="numpy")


def exactly(text, error=ValueError):
    return pytest.raises(error, match=f"^{re.escape(text)}$")


@pytest.fixture(scope="module")
def short_fit(rod):
    """Of a planted motion by the same steps, from 50 % off."""
    record = stepped(scene_of(rod, coulomb=0.0), step=0.04)
    return rne.identify_motion(scene_of(rod, 1.5, coulomb=0.0), record, WRT[:2], starts=1, step=0.04)


def test_numbers_are_found(short_fit, rod, tmp_path):
    """With what is said of them; saved and loaded they are the same."""
    assert short_fit.names == ("controller.kp", "friction.viscous")
    assert np.abs(off(short_fit, scene_of(rod), WRT[:2])).max() < 4
    assert abs(short_fit.rms[0] / (STEP / np.sqrt(12)) - 1) < 4 / np.sqrt(2 * 26)
    assert short_fit.determined.all()
    assert short_fit.alike == ()
    assert short_fit.causes == ()
    np.testing.assert_array_equal(short_fit.scene().numbers["controller.kp"], short_fit.numbers["controller.kp"])
    again = rne.identification.MotionFit.load(short_fit.save(tmp_path / "fit.npz"))
    assert again.report() == short_fit.report()
    for name in ("values", "std", "rms", "resolution", "validation_error"):
        np.testing.assert_array_equal(getattr(again, name), getattr(short_fit, name))
    draws = short_fit.draws(2000)["friction.viscous"]
    spread = np.log(draws).std() / (short_fit.std[1] / short_fit.values[1])
    assert abs(spread - 1) < 4 / np.sqrt(2 * 2000)  # four standard errors of a deviation
    written = re.search('damping="(.*?)"', short_fit.to_urdf())
    assert float(written[1]) == short_fit.values[1]


def test_the_resolution_of_noisy_positions_is_their_noise(rod):
    """Far above the rounding of the encoder; of 21 samples, with a standard error of a fifth."""
    scene, noise = scene_of(rod, coulomb=0.0), 1e-3
    clean = stepped(scene, step=0.04, end=0.8, rounded=False)
    q = clean.q + np.random.default_rng(2).normal(0, noise, clean.q.shape)
    record = Record(clean.t, q, command=clean.command)
    fit = rne.identify_motion(scene, record, WRT[:2], starts=1, step=0.04)
    assert fit.resolution == pytest.approx([noise], rel=0.4)


@long
def test_positions_that_lead_their_commands_give_no_negative_delay(rod):
    scene = scene_of(rod, coulomb=0.0)
    ahead = stepped(scene, step=0.04, end=0.8, late=-0.03)
    fit = rne.identify_motion(scene, ahead, ["command.delay"], starts=1, step=0.04, folds=0)
    assert abs(fit.values[0]) < 1e-6  # at its bound


# Arguments


def test_errors_name_the_argument(rod):
    scene, t = scene_of(rod), np.arange(50) / 50
    q = np.sin(6 * t)[:, None]
    record, without = Record(t, q, command=q), Record(t, q, q)
    fit = rne.identify_motion
    law = "`scene` must have a controller with a `reference`, such as rne.control.pd or servo"
    with exactly("`scene` must be an rne.Scene, got Robot", TypeError):
        fit(rod, record)
    with exactly(law):
        fit(replace(scene, controller=None), record)
    with exactly("`scene` has a PID controller, whose reference is constant: take rne.control.pd or servo"):
        fit(replace(scene, controller=rne.control.pid(rod, 40, 2, 1, 0)), record)
    with exactly("`records` must have one record at least"):
        fit(scene, [])
    with exactly("record: has no commands: give `command`, or use rne.identify with its torques"):
        fit(scene, without)
    with exactly("`folds` must be 0, or 2 and more"):
        fit(scene, record, folds=1)
    with exactly("`wrt`: 'armature' acts as inertias of bodies do: leave it or 'parameters' out"):
        fit(scene, record, ["parameters", "armature"])
    with exactly("`wrt`: 'friction.load' is 0: give it a value above 0 to start from, by `start`"):
        fit(scene, record, "friction.load")
    with exactly("`start` and `priors` must be of what is fitted, which 'armature' is not: name it in `wrt`"):
        fit(scene, record, WRT, start={"armature": 0.1})
    with exactly("`priors['controller.kp']` must be positive, got 0.0"):
        fit(scene, record, WRT, priors={"controller.kp": 0.0})
    with exactly("`start['controller.kp']` must be of shape (1,) without NaN, got (2,)"):
        fit(scene, record, WRT, start={"controller.kp": [1.0, 2.0]})
    with pytest.raises(KeyError, match=r"`wrt` must name some of .*; got 'controller.kq'"):
        fit(scene, record, "controller.kq")
    with exactly("`wrt`: the law is sampled, so that the delay of its commands is 'delay', not 'command.delay'"):
        fit(replace(scene, sample_time=0.02), record, "command.delay")
    with exactly("`wrt` must name one number at least"):
        fit(scene, record, [])
    with exactly("`wrt`: 'controller.reference' is replaced by the commands of records"):
        fit(scene, record, "controller.reference")
    with exactly("`start['controller.kp']` must be positive, got -1"):
        fit(scene, record, WRT, start={"controller.kp": -1.0})
    with exactly("`priors['controller.kp']` must be one number or of shape (1,), got (2,)"):
        fit(scene, record, WRT, priors={"controller.kp": [1.0, 1.0]})


def test_records_of_other_joints_are_refused(rod):
    scene, t = scene_of(rod), np.arange(50) / 50
    q = np.sin(6 * t)[:, None]
    with exactly("record: joint 'joint0' of the scene is not in the record, which has elbow"):
        rne.identify_motion(scene, Record(t, q, command=q, joint_names=("elbow",)))
    both = np.hstack([q, q])
    with exactly("record: has 2 joints without names, the scene has 1"):
        rne.identify_motion(scene, Record(t, both, command=both))


def test_a_law_that_follows_no_positions_of_joints_is_refused(rod):
    """In task space a reference is a pose."""
    law = rne.control.operational_space(
        rod, "rod0", 1.0, 1.0, lambda t: (np.eye(4), np.zeros(6), np.zeros(6)), rows=[4]
    )
    t = np.arange(50) / 50
    own = "`reference` must give shapes (4, 4), (6,) and (6,), got [(1,), (1,), (1,)]"
    with exactly(f"the controller of `scene` follows no reference that moves: {own}"):
        rne.identify_motion(replace(scene_of(rod), controller=law), Record(t, t[:, None], command=t[:, None]))


def test_only_motions_without_memory_start_in_their_midst(rod):
    scene, t = scene_of(rod), np.arange(50) / 50
    record = Record(t, np.sin(6 * t)[:, None], command=np.sin(6 * t)[:, None])
    friction = {"viscous": 0.1, "coulomb": 0.1}
    learning = rne.control.adaptive(rod, 4.0, 2.0, sampled([0.0, 1.0], np.zeros((2, 1))), **friction)
    for kind, changed in {
        "elastic joints": {"elastic": rne.ElasticJoints(1e3, 1.0)},
        "the states of the controller": {"controller": learning},
        "a sampled controller": {"sample_time": 0.02},
    }.items():
        text = f"with {kind} a motion cannot start in its midst: leave `shot` out, give records without gaps"
        with exactly(text):
            rne.identify_motion(replace(scene, **changed), record, "friction.viscous", shot=0.5)


def test_parts_with_too_few_samples_are_refused(rod):
    scene, t = scene_of(rod), np.arange(250) / 50
    q = np.sin(6 * t)[:, None]
    with exactly("no part of the records has 7 samples in a row", rne.IdentificationError):
        rne.identify_motion(scene, Record(t, q, command=q), WRT, shot=0.1)
    lost = q.copy()
    lost[20:30] = np.nan  # a whole part, across which the record is kept together
    with exactly("joint 1 has 0 measured positions in a part of 0.18 s", rne.IdentificationError):
        rne.identify_motion(scene, Record(t, lost, command=q, bridge=12), WRT, shot=0.2)


def test_numbers_that_no_motion_has_are_refused(rod, short_fit):
    scene, t = scene_of(rod), np.arange(50) / 50
    record = Record(t, np.sin(6 * t)[:, None], command=np.sin(6 * t)[:, None])
    with exactly(
        "the motion cannot be simulated from any start: give `shot`, or other numbers to start from",
        rne.IdentificationError,
    ):
        rne.identify_motion(scene, record, "controller.kp", start={"controller.kp": 1e100}, starts=1, step=0.05)
    endless = replace(short_fit, z=short_fit.z + [200.0, 0.0, 0.0, 0.0])  # the gain's logarithm
    with exactly("the motion cannot be simulated from the start that the positions show", rne.IdentificationError):
        endless.predict(record)


def test_by_default_all_numbers_are_fitted_that_are_not_zero_and_act_apart(rod):
    """Only a number that is fitted may be given a start; without starts, no fit is made."""
    t = np.arange(50) / 50

    def are_fitted(scene, names):
        q, found = np.sin(np.outer(t, [6, 7][: scene.n])), []
        record = Record(t, q, command=q)
        for name in names:
            start = {name: scene.numbers.get(name, 0.1)}
            with pytest.raises(ValueError, match=r"^`start(s`|` and `priors` must be of what is fitted)") as told:
                rne.identify_motion(scene, record, start=start, starts=0)
            found += [name] * str(told.value).startswith("`starts`")
        return found

    scene, commands = scene_of(rod, coulomb=0.0), ["command.delay", "command.scale", "command.offset"]
    chosen = ["friction.viscous", "controller.kp", "controller.kd", "parameters", *commands]
    assert set(are_fitted(scene, [*scene.numbers, *commands, "sensor.scale", "sensor.offset"])) == set(chosen)
    sampled_law = replace(scene, sample_time=0.02, delay=0.01)
    assert are_fitted(sampled_law, ["delay", *commands]) == ["delay", *commands[1:]]
    assert are_fitted(scene_of(robot_of(2, "numpy")), ["armature"]) == ["armature"]  # rotors turn apart from bodies


# Of a softly controlled rod, whose motion few steps follow

FEW = {"rate": 20, "step": 0.05}  # samples per second, and as many steps


def soft(robot, factor=1.0, kd=0.6, **friction):
    """PD control at about 1.4 Hz, and friction."""
    law = rne.control.pd(robot, factor * 6.0, kd, np.zeros(1))
    friction = {"viscous": 0.1, "coulomb": 0.0, "smoothing": 0.1} | friction
    return rne.Scene(robot, controller=law, friction=rne.Friction(**friction))


@pytest.fixture(scope="module")
def blind_fit(rod):
    """By a model without the delay and the Coulomb friction that act, to a log that pauses before its last samples."""
    record = stepped(soft(rod, coulomb=0.05), 1.5, **FEW, late=0.02)
    kept = (record.t < 0.99) | (record.t > 1.36)
    paused = Record(record.t[kept], record.q[kept], command=record.command[kept])
    wrt = ["controller.kd", "friction.viscous", "friction.stribeck"]
    return rne.identify_motion(soft(rod, stribeck=[0.1]), paused, wrt, starts=1, step=FEW["step"])


def test_what_a_model_misses_is_named_with_its_size(blind_fit):
    cause = blind_fit.causes[0]
    assert (cause.kind, cause.joints, cause.numbers) == ("command.delay", ("joint0",), 1)
    assert abs(cause.value - 0.02) < 4 * cause.error
    said = rf"a delay of commands is not in the model \(command\.delay {cause.value:.3g} on joint0\): it would explain "
    share = re.fullmatch(said + r"(.*) % of the residual's squares", cause.text)
    assert 50 < float(share[1]) < 100  # most of them; the model has no Coulomb friction either
    assert cause.score == max(cause.score for cause in blind_fit.causes)


def test_what_is_said_of_a_model_that_misses_something(blind_fit):
    rms, times = blind_fit.rms[0], (blind_fit.rms / blind_fit.resolution)[0]
    assert repr(blind_fit) == (
        "MotionFit of 3 numbers to 1 record: the model misses something: residuals of joint0 exceed the resolution "
        f"({rms:.2g} rad rms on joint0, {times:.1f} times its resolution); standard errors account for their correlation "
        "in time, not for a bias; 3 of 3 numbers not determined"
    )
    assert times > 3  # thresholds.FAR_ABOVE_RESOLUTION: no noise leaves as much
    assert blind_fit.message.endswith("; 3 samples in parts of fewer than 7 not used")


def test_a_number_on_which_the_motion_does_not_depend_is_named(blind_fit):
    """The velocity of a Stribeck effect of size zero; what others do as well is another thing."""
    assert blind_fit.alike[-1] == "friction.stribeck is not determined: the motion hardly depends on it"
    assert blind_fit.alike[0] == "controller.kd acts as others together do: give it, or some of them"


def test_bodies_of_a_scene_that_was_fitted_are_possible_and_move_as_those_found(rod):
    """From masses that are a fifth too large; a prior of the gain is the standard error that it keeps."""
    heavy = rne.Robot(straight_chain(1)).with_parameters(1.2 * rod.parameters).with_armature(0.05)
    prior, record = 1e-4, stepped(soft(rod), **FEW)
    how = {"priors": {"controller.kp": prior}, "starts": 1, "step": FEW["step"]}
    fit = rne.identify_motion(soft(heavy), record, ["parameters", "controller.kp"], **how)
    assert fit.names == (*(f"parameters: {name}" for name in ("mcx_1", "mcz_1", "Iyy_1")), "controller.kp")
    assert 0.95 * prior < fit.std[3] <= prior
    across = 0.3**2 / 3 + 0.05  # of the rod and the rotor
    assert (np.abs(fit.values - [0, -0.15, across, 6]) < 4 * fit.std).all()
    bodies = fit.scene().numbers["parameters"]
    assert np.linalg.eigvalsh(pseudo_inertia(bodies)).min() > 0
    moments = bodies[[1, 3, 6]] + [0, 0, 0.05]
    assert (np.abs(moments - fit.values[:3]) < 0.5 * fit.std[:3]).all()  # as near as the given bodies draw them


def test_masses_that_are_given_and_count_for_nothing_are_named():
    """Where all torques may be scaled though masses are not fitted, a fit has left them behind."""
    bodies = rne.Robot(straight_chain(1))
    light = bodies.with_parameters(1e-9 * bodies.parameters).with_armature(0.05)
    scene, wrt = soft(light), ["controller.kp", "controller.kd", "friction.viscous", "armature"]
    fit = rne.identify_motion(scene, stepped(scene, **FEW), wrt, starts=1, step=FEW["step"])
    assert fit.alike[0] == (
        "all torques may be scaled together: weight and inertia of the bodies, which are not fitted, are negligible "
        "beside the torques found; check masses, gravity and the directions of the axes, or give a gain or a rotor"
    )


def test_from_a_start_in_another_valley_several_starts_lead_out(rod):
    """From three times the gain, whose oscillation is out of step, one start ends at four times the gain."""
    weak = {"kd": 0.05, "viscous": 0.05}
    record = stepped(soft(rod, **weak), **FEW)
    how = {"starts": 2, "folds": 2, "step": FEW["step"]}
    fit = rne.identify_motion(soft(rod, 3.0, **weak), record, "controller.kp", **how)
    assert abs(fit.values[0] - 6) < 4 * fit.std[0]
    assert (fit.rms < fit.validation_error).all()  # as half of the motion is predicted by the other half
    assert (fit.validation_error < 4 * fit.rms).all()


def test_as_many_folds_are_refused_as_records_have_no_parts_for(rod):
    """Of 27 samples, one part of four has fewer than seven; no fit is made first."""
    scene = soft(rod)
    how = {"starts": 1, "folds": 4, "step": FEW["step"], "progress": lambda *_: pytest.fail("a fit began")}
    with exactly("`folds` must be at most 3, the parts that records can be cut into, got 4"):
        rne.identify_motion(scene, stepped(scene, 1.3, **FEW), "controller.kp", **how)


def test_positions_are_predicted_where_they_were_measured_and_drawn(short_fit):
    """One sample is missing, over which the record is put on a grid."""
    (whole,) = short_fit.problem.records
    kept = np.arange(len(whole.t)) != 9
    record = Record(whole.t[kept], whole.q[kept], command=whole.command[kept], name="other", stamps="sampled")
    q, std = short_fit.predict(record, std=True)
    assert q.shape == record.q.shape
    assert (np.abs(q - record.q) < 4 * std).all()
    figure = short_fit.plot(record)
    assert figure.get_suptitle() == "Positions of other"
    with exactly("record: the record has torques and no commands: rne.identify fits a model from these"):
        short_fit.plot(Record(whole.t, whole.q, whole.q))


# Columns that are mistaken


@pytest.fixture(scope="module")
def pair():
    """A scene of two joints that follow their commands a little late, and columns of both."""
    t = np.arange(300) / 100
    command = np.column_stack([np.sin(2 * t), np.cos(3 * t + np.sin(t))])
    return scene_of(robot_of(2, "numpy")), t, command, np.roll(command, 2, axis=0)


def said(scene, t, q, command):
    return [(cause.kind, cause.joints) for cause in mistaken_columns(scene, [Record(t, q, command=command)])]


def test_swapped_joints_signs_and_units_are_named(pair):
    scene, t, command, q = pair
    assert said(scene, t, q, command) == []
    assert said(scene, t, q[:, ::-1], command) == [
        ("swapped joints", ("joint0", "joint1")),
        ("swapped joints", ("joint1", "joint0")),
    ]
    assert said(scene, t, q * [1, -1], command) == [("sign", ("joint1",))]
    assert said(scene, t, q, command * [np.rad2deg(1), 1]) == [("unit", ("joint0",))]


# Standard errors


def covariance_of(r, J, spread=1e6):
    """Of residuals (T,) and derivatives (T, P)."""
    P = J.shape[1]
    return certainty([(r[:, None], J[:, None])], np.full(P, spread), P, np.zeros(P, bool)).covariance


def test_of_white_residuals_it_is_the_usual_covariance():
    """Of residuals whose variance is that of the weights, up to its estimate, and to autocovariances by chance."""
    rng, T = np.random.default_rng(1), 4000
    J = np.column_stack([np.ones(T), np.sin(np.arange(T) / 20)])
    found = covariance_of(rng.normal(size=T), J)
    expected = np.linalg.inv(J.T @ J)
    np.testing.assert_allclose(np.diag(found) / np.diag(expected), 1, atol=6 / np.sqrt(T) + 0.05)


def autoregressive(rho, T, rng):
    r = rng.normal(size=T) * np.sqrt(1 - rho**2)
    r[0] /= np.sqrt(1 - rho**2)
    for k in range(1, T):
        r[k] += rho * r[k - 1]
    return r


@pytest.mark.parametrize("rho", [0.5, 0.9])
def test_of_correlated_residuals_a_mean_is_known_less_by_their_correlation_time(rho):
    """Of an autoregressive series the variance of the mean is (1 + rho) / (1 - rho) that of white residuals."""
    rng, T = np.random.default_rng(2), 40_000
    r = autoregressive(rho, T, rng)
    inflation = (1 + rho) / (1 - rho)
    found = covariance_of(r, np.ones((T, 1)))[0, 0] * T
    assert abs(found / inflation - 1) < 0.15


def test_autocovariances_are_those_of_a_known_series_then_tapered():
    """A moving average of two has 2, 1, 0, ... times its variance; gaps count as no residual."""
    e = np.random.default_rng(3).normal(size=100_001)
    c = autocovariance([e[1:] + e[:-1]])
    np.testing.assert_allclose(c[:2], [2, 1], atol=0.05)
    assert np.abs(c[2:]).max() < 0.05
    assert len(c) < 8
    assert np.array_equal(autocovariance([np.zeros(10)]), np.zeros(1))
    parts = autocovariance(np.split((e[1:] + e[:-1]), 100))
    np.testing.assert_allclose(parts[:2], c[:2], atol=0.05)


def test_a_log_never_says_more_than_white_residuals_would():
    """Alternating residuals would make a mean better known than white ones do."""
    T = 1000
    r, J = (-1.0) ** np.arange(T), np.ones((T, 1))
    assert covariance_of(r, J)[0, 0] >= 1 / T * (1 - 1e-9)


def certain(information, spread=None):
    P = len(information)
    spread = np.ones(P) if spread is None else spread
    return Certainty(
        np.asarray(information, float), np.asarray(information, float), spread, P, np.zeros(len(spread), bool)
    )


def test_directions_that_no_residual_shows_are_not_determined():
    """The sum of the first two is known, the third one is, the fourth is not."""
    J = np.array([[1e3, 1e3, 0, 0], [0, 0, 1e3, 0]])
    found = certain(J.T @ J)
    assert found.determined.tolist() == [False, False, True, False]
    assert found.alike() == [([0, 1], 1), ([3], 0)]


def test_of_entries_that_act_alike_as_many_are_to_be_given_as_directions_are_free():
    """Only the sum of three is known: with two of them given it tells the third. Of five only differences are."""
    assert certain(1e6 * np.ones((3, 3))).alike() == [([0, 1, 2], 2)]
    differences = 1e3 * (np.eye(5)[:4] - np.eye(5)[1:])
    assert certain(differences.T @ differences).alike() == [([0, 1, 2, 3, 4], 1)]


def test_a_scale_of_all_torques_is_found_and_taken_out():
    """Two torques, logarithms of which the log shows only the difference; a third number is none."""
    J = np.array([[1e3, -1e3, 0], [0, 0, 1e3]])
    found, is_log = certain(J.T @ J), np.array([True, True, False])
    names = ["controller.kp", "friction.viscous", "command.delay"]
    v = found.scale(np.ones(3), names, is_log)
    np.testing.assert_array_equal(v, [1, 1, 0])
    assert found.given_scale(v).determined.all()
    assert certain(np.eye(3) * 1e6).scale(np.ones(3), names, is_log) is None


# Planted logs, in machine code


@pytest.fixture(scope="module")
def fast():
    return robot_of()


def fitted(scene, records, wrt=WRT, **options):
    return rne.identify_motion(scene, records, wrt, **options)


def off(fit, scene, wrt=WRT):
    """Deviations in standard errors."""
    return (fit.values - truth(scene, wrt)) / fit.std


@long
def test_without_noise_numbers_are_found_to_the_last_digits(fast):
    """Of a motion by the same steps."""
    scene = scene_of(fast)
    record = stepped(scene, 2.0, 50, 0.01, rounded=False)
    for factor in (1.5, 0.5):
        fit = fitted(scene_of(fast, factor), record, step=0.01)
        np.testing.assert_allclose(fit.values, truth(scene), rtol=FOUND)


@long
def test_steps_are_refined_until_they_are_finer_than_the_positions(rod):
    """Steps of the sample time, with which a fit begins, would leave 8 % of the friction."""
    scene, wrt = scene_of(rod, coulomb=0.0), WRT[:2]
    fit = fitted(scene, planted(scene, 0.8, 25, step=1e-4), wrt, folds=0, starts=1)
    np.testing.assert_allclose(fit.values, truth(scene, wrt), rtol=0.02)  # of positions rounded to 1e-4 rad


@long
def test_rounding_by_encoders_is_what_is_left(fast):
    """From half and from 1.5 times the numbers; all within four standard errors; the residual is the rounding's."""
    scene = scene_of(fast)
    record = planted(scene, 8.0)
    for factor in (0.5, 1.5):
        fit = fitted(scene_of(fast, factor), record)
        assert np.abs(off(fit, scene)).max() < 4
        expected = STEP / np.sqrt(12)
        assert abs(fit.rms[0] / expected - 1) < 4 / np.sqrt(2 * len(record.t))
        assert fit.explained.all()
        assert fit.verdict.startswith("the model explains the positions to their resolution")
    assert np.abs(off(fitted(scene_of(fast, 1.5), record, robust=True), scene)).max() < 4


@long
def test_of_heavy_tails_a_robust_fit_is_nearer(fast):
    """Student's t of two degrees of freedom, pooled over eight draws."""
    scene, errors = scene_of(fast), []
    record = planted(scene, 4.0, step=0.0)
    for seed in range(8):
        noise = 3e-4 * np.random.default_rng(seed).standard_t(2, record.q.shape)
        noisy = Record(record.t, record.q + noise, command=record.command)
        fits = (fitted(scene_of(fast, 1.3), noisy, robust=on, starts=1) for on in (True, False))
        errors.append([np.log(fit.values / truth(scene)) for fit in fits])
    robust, plain = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (robust < plain).all()


@long
def test_what_acts_alike_is_said_and_resolved_by_a_prior(fast):
    """The scale of all torques, and the damping of the law beside that of the joint."""
    scene, record = scene_of(fast), planted(scene_of(fast), 8.0)
    every = [*WRT, "controller.kd", "parameters"]
    scale = "all torques may be scaled together: give a mass or a gain, by leaving it out of `wrt` or by `priors`"
    assert fitted(scene, record, every).alike[0] == scale
    twins = [*WRT, "controller.kd"]
    fit = fitted(scene, record, twins)
    assert fit.alike == ("friction.viscous, controller.kd act alike: give one of them",)
    assert not fit.determined[[1, 3]].any()
    known = fitted(scene, record, twins, priors={"controller.kd": 0.01})
    assert known.alike == ()
    assert known.determined.all()
    assert np.abs(off(known, scene, twins)).max() < 4


@long
@pytest.mark.parametrize(
    ("missing", "wrt"),
    [
        ("friction.coulomb", ["controller.kp", "friction.viscous"]),
        ("command.delay", WRT),
        ("friction.viscous", WRT[::2]),
    ],
)
def test_what_the_model_misses_is_named_first(fast, missing, wrt):
    left_out = {missing.removeprefix("friction."): 0.0} if "friction" in missing else {}
    record = planted(scene_of(fast), 6.0, delay=0.004 if missing == "command.delay" else 0.0)
    fit = fitted(scene_of(fast, **left_out), record, wrt)
    assert fit.causes[0].kind == missing
    assert fit.verdict.startswith("the model misses something: residuals of joint0 exceed the resolution")


@long
def test_records_add_up_and_shots_start_anew(fast):
    scene = scene_of(fast)
    records = [planted(scene, 4.0, name="a"), planted(scene, 3.0, delay=0.0, name="b")]
    both, one = fitted(scene_of(fast, 1.4), records, folds=2), fitted(scene_of(fast, 1.4), records[0])
    assert (both.std < one.std).all()
    assert np.abs(off(both, scene)).max() < 4
    assert len(both.problem.shots) == 2
    assert (both.validation_error < 1.5 * both.resolution).all()
    cut = fitted(scene_of(fast, 1.4), records[0], shot=1.0)
    assert len(cut.problem.shots) == 4
    assert np.abs(off(cut, scene)).max() < 4


@long
def test_bands_cover_what_is_measured(fast):
    """95 % of other samples within 1.96 deviations, which rounding fills in more than 93 %, its range being finite."""
    scene = scene_of(fast)
    fit = fitted(scene_of(fast, 1.4), planted(scene, 8.0))
    other = planted(scene, 6.0, 80)
    q, std = fit.predict(other, std=True)
    assert q.shape == other.q.shape
    share = float((np.abs(q - other.q) < 1.96 * std).mean())
    assert share > 0.95 - 4 * np.sqrt(0.95 * 0.05 / other.q.size)  # binomial, four deviations
    assert fit.plot().axes
    np.testing.assert_array_equal(fit.predict(other), q)


@long
def test_joints_are_taken_by_name():
    robot = robot_of(2)
    scene = scene_of(robot)
    record = planted(scene, 4.0)
    named = Record(record.t, record.q[:, ::-1], command=record.command[:, ::-1], joint_names=("joint1", "joint0"))
    a, b = (fitted(scene_of(robot, 1.2), x) for x in (record, named))
    np.testing.assert_allclose(a.values, b.values, rtol=1e-12)
    assert np.abs(off(a, scene)).max() < 4


@long
def test_numpy_and_machine_code_find_the_same(fast, rod):
    record = planted(scene_of(fast), 2.0, 50)
    a, b = (fitted(scene_of(robot, 1.3), record, starts=1) for robot in (fast, rod))
    assert np.abs((a.values - b.values) / a.std).max() < SAME
    np.testing.assert_allclose(a.std, b.std, rtol=SAME)
