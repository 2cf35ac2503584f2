"""Observers as control laws with states: equal to observers along samples, and to batch least squares."""

import ctypes
import re
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import rne
from rne.control import MomentumObserver
from rne.elementwise import less, where

from .compiled_sources import c_library, call
from .helpers import kept, relative
from .random_robots import random_tree, straight_chain

STEP = 1e-3
SAME = 1e-10  # relative: both sum the same few thousand products, in another order
TURNING = random_tree(3, 2, prismatic=0.0, branching=0.0)
SEEN = {
    "alone": {},
    "load": {"friction": rne.Friction(viscous=2.0, coulomb=1.0, load=0.1), "friction_error": 0.2},
    "dry": {"friction": rne.Friction(coulomb=0.2, static=0.3, smoothing=0), "floor": 0.1},
}


@pytest.fixture(scope="module")
def arm():
    """Three joints that turn about different axes."""
    return rne.Robot(TURNING)


@pytest.fixture(scope="module")
def path(arm):
    return rne.trajectories.quintic([0.1, -0.2, 0.3], [1.0, 0.6, -0.9], 0.4)


@pytest.fixture(scope="module")
def hold(arm, path):
    return rne.control.computed_torque(arm, 400, 40, path)


@pytest.fixture(scope="module")
def brake(arm):
    return rne.control.pd_gravity(arm, 0, 5, 0)


def along(law, t, q, qd, given=None):
    """Torques and states z of a law called along samples; torques that act may be given."""
    z, torques, states = np.zeros(law.states), [], []
    for k in range(len(t)):
        u, z = law(t[k], q[k], qd[k], z)
        if given is not None:
            z[law.places["torques"]] = given[k]
        torques.append(u)
        states.append(z)
    return np.array(torques), np.array(states)


@pytest.mark.parametrize("coupled", [False, True])
def test_momenta_and_forces_are_those_of_the_matrices(coupled):
    """M qd and C^T qd - g, of sliding joints, mimics and curves too."""
    robot = rne.Robot(random_tree(5, 3, mimics=2, coupled=coupled))
    q, qd = np.random.default_rng(0).normal(size=(2, 20, robot.n))
    momenta = np.einsum("kij,kj->ki", robot.mass_matrix(q), qd)
    forces = np.einsum("kji,kj->ki", robot.coriolis_matrix(q, qd), qd) - robot.gravity_torque(q)
    found = rne.dynamics.energy.lagrangian_derivatives(robot.model, q, qd)
    assert relative(found, np.concatenate([momenta, forces], axis=-1)) <= 1e-12


@pytest.mark.parametrize("delay", kept([0.0, 2 * STEP, 2.4 * STEP], [0.0, 2.4 * STEP]))
@pytest.mark.parametrize("name", SEEN)
def test_the_law_sees_what_the_observer_sees_along_samples(arm, hold, brake, path, name, delay):
    """Residuals, thresholds, the instant of the contact and the torques after it."""
    cases = [arm.with_parameters(f * arm.parameters) for f in (0.98, 1.01)]
    observer = MomentumObserver(arm, cases=cases, **SEEN[name])
    law, watched = (make(hold, brake, sample_time=STEP, delay=delay) for make in (observer.law, observer.watching))
    t = np.arange(40) * STEP
    q, qd, _ = path(t)
    q, qd = q + 0.02 * (t > 0.02)[:, None] * (t - 0.02)[:, None], np.where(t[:, None] < 0.003, 0.0, qd)  # and at rest
    torques, z = along(law, t, q, qd)
    seen = observer.observe(t, q, qd, z[:, law.places["torques"]], held=True)
    assert np.abs(law.residuals(z) - seen.torque).max() <= SAME * np.abs(seen.torque).max()
    assert np.abs(law.thresholds(z) - seen.threshold).max() <= SAME * seen.threshold.max()
    late, earlier = delay / STEP, np.vstack([np.zeros((3, 3)), torques])  # commands, and none before the first
    share = late - int(late)
    acting = (
        share * earlier[3 - int(late) - 1 : 43 - int(late) - 1] + (1 - share) * earlier[3 - int(late) : 43 - int(late)]
    )
    np.testing.assert_allclose(z[:, law.places["torques"]], acting, rtol=SAME, atol=SAME)
    called = [watched(*state) for state in zip(t, q, qd, strict=True)]
    assert watched.contact == t[np.flatnonzero(law.contact(z))[0]] == seen.first_contact
    np.testing.assert_allclose(torques, called, rtol=SAME, atol=SAME)


class Pushed:
    """The torques of an observing law, and from 20 ms on a push that it does not know of."""

    traceable = discrete = True
    push = np.array([0.0, -4.0, 0.0])

    def __init__(self, law):
        self.law, self.states = law, law.states

    def __call__(self, t, q, qd, z):
        u, new = self.law(t, q, qd, z)
        return u + where(less(t, 0.0195), 0.0, self.push), new


@pytest.mark.parametrize("engine", kept(["numpy", "numba"], ["numpy"]))
def test_a_push_in_a_scene_is_seen_at_the_sample_at_which_the_guarded_law_sees_it(path, engine):
    """And the motions are the same; states of a sample are what was known before it."""
    arm = rne.Robot(TURNING, engine)
    hold, brake = rne.control.computed_torque(arm, 400, 40, path), rne.control.pd_gravity(arm, 0, 5, 0)
    observer, t = MomentumObserver(arm, floor=0.5), np.linspace(0, 0.04, 41)
    law, watched = observer.law(hold, brake, sample_time=STEP), observer.watching(hold, brake, STEP)
    laws = {"with states": Pushed(law), "guarded": lambda t, q, qd: watched(t, q, qd) + Pushed.push * (t > 0.0195)}
    scenes = {name: rne.Scene(arm, controller=given, sample_time=STEP) for name, given in laws.items()}
    motion, guarded = (rne.simulate(scene, path(0.0)[0], [0] * 3, 0.04, t_eval=t) for scene in scenes.values())
    assert scenes["with states"].cost()["law"] == {"numpy": "called", "numba": "traced"}[engine]
    np.testing.assert_allclose(motion.q, guarded.q, rtol=0, atol=SAME)
    z = motion.controller_state
    seen = observer.observe(t, motion.q, motion.qd, motion.tau - (t > 0.0195)[:, None] * Pushed.push, held=True)
    assert np.abs(law.residuals(z[1:]) - seen.torque[:-1]).max() <= SAME * np.abs(seen.torque).max()
    assert 0.02 < watched.contact < 0.025
    for found in (t[law.contact(z).argmax() - 1], seen.first_contact):
        assert found == pytest.approx(watched.contact, abs=1e-12)


@pytest.mark.parametrize("name", kept(["contacts", "payload"], ["contacts"]))
def test_intervals_of_a_stepper_have_the_states_of_calls(arm, hold, brake, states, name):
    law = laws(arm, hold, brake)[name]
    scene = rne.Scene(arm, controller=law, sample_time=STEP, delay=1.4 * STEP, effort_limit=30.0)
    stepper, z = rne.Stepper(scene), np.zeros(law.states)
    x = stepper.start(states[1][0], states[2][0])
    for k in range(3):
        _, z = law(k * STEP, x[:3], x[3:6], z)
        x = stepper(x, t=k * STEP)
        assert relative(x[6 : 6 + law.states], z) <= SAME


def test_a_scene_has_the_sample_time_of_its_law(arm, hold):
    law = MomentumObserver(arm).law(hold, sample_time=STEP)
    with pytest.raises(ValueError, match=r"^`sample_time` must be that of the controller, 0.001 s, got 0.002 s$"):
        rne.Scene(arm, controller=law, sample_time=2 * STEP)


def test_a_law_within_has_the_sample_time_too(arm, hold):
    inner = MomentumObserver(arm).law(hold, sample_time=2 * STEP)
    with pytest.raises(ValueError, match=r"^`sample_time` must be that of the law, 0.002 s, got 0.001 s$"):
        rne.control.payload_observer(arm, law=inner, sample_time=STEP)


@pytest.mark.parametrize("name", ["contacts", "payload", "guarded"])
def test_numbers_are_those_of_the_laws_within(arm, name):
    """Neither sample time and delay, which are those of the scene, nor a memory."""
    hold, observer = rne.control.pd_gravity(arm, 40, 4, 0), MomentumObserver(arm)
    guarded, states = observer.watching(hold, hold, STEP, 1.4 * STEP), np.zeros((2, 3))
    guarded(0.0, *states)
    law = laws(arm, hold, hold)[name] if name != "guarded" else guarded
    numbers = rne.Scene(arm, controller=law, sample_time=STEP, delay=1.4 * STEP).numbers
    own = {key.removeprefix("controller.").partition(".")[0] for key in numbers if key.startswith("controller.")}
    assert own - {"law", "reaction"} == {
        "payload": {"effort_limit", "forgetting", "noise"},
        "contacts": {"effort_limit"},
    }.get(name, set())


@pytest.mark.parametrize("name", ["contacts", "payload"])
def test_observers_do_not_act_on_the_stability_of_a_loop(name):
    """Their states, which no torque depends on, may grow: those of all samples, and filters at other sample times."""
    robot = rne.Robot(straight_chain(2), "numpy")
    hold = rne.control.pd_gravity(robot, 40, 4, [0.1, 0.2])
    law = (
        MomentumObserver(robot, floor=1.0).law(hold, hold, sample_time=STEP)
        if name == "contacts"
        else rne.control.payload_observer(robot, law=hold, sample_time=STEP, forgetting=1)
    )
    alone, seen = (rne.Scene(robot, controller=c, sample_time=STEP).check_gains([0.1, 0.2]) for c in (hold, law))
    assert seen.stable
    for key in ("sample_time_limit", "delay_margin"):
        assert getattr(seen, key) == pytest.approx(getattr(alone, key), rel=1e-4)  # called: by differences
    np.testing.assert_allclose(seen.poles, alone.poles, rtol=1e-4)


def test_measured_torques_may_be_written_into_the_states(arm, hold, path):
    t = np.arange(20) * STEP
    q, qd, qdd = path(t)
    measured = arm.inverse_dynamics(q, qd, qdd) + 1.0
    law = MomentumObserver(arm).law(hold, sample_time=STEP)
    torques, z = along(law, t, q, qd, measured)
    seen = MomentumObserver(arm).observe(t, q, qd, measured, held=True)
    np.testing.assert_allclose(law.residuals(z), seen.torque, rtol=0, atol=SAME * np.abs(seen.torque).max())
    np.testing.assert_allclose(torques, [hold(*state) for state in zip(t, q, qd, strict=True)], rtol=SAME)


@pytest.mark.long  # test_the_law_sees_what_the_observer_sees_along_samples has the same law
def test_the_push_of_the_tutorial_is_found_no_later(irb140):
    """Six robots that are 5 % lighter or heavier, friction that is off by 20 %, and 40 N m against joint 2 from 0.6 s."""
    t, rng = np.arange(621) * STEP, np.random.default_rng(1)
    q, qd, qdd = rne.trajectories.quintic([0, 0.3, -0.3, 0, 0.5, 0], [1, -0.2, 0.4, 1, -0.5, 1], 1.0)(t)
    factors, start = 1 + 0.05 * rng.choice([-1, 1], (6, 6)), irb140.parameters
    cases = [irb140.with_parameters(np.repeat(factor, 10) * start) for factor in factors]
    friction, actual = rne.Friction(viscous=5.0, coulomb=4.0), rne.Friction(viscous=5.8, coulomb=3.4)
    observer = MomentumObserver(irb140, friction=friction, cases=cases, friction_error=0.2, floor=0.5)
    real = irb140.with_parameters(np.mean([case.parameters for case in cases], axis=0))
    tau = real.inverse_dynamics(q, qd, qdd) + actual.torque(irb140.model, qd)
    tau[t > 0.6, 1] += 40.0
    seen, law = observer.observe(t, q, qd, tau), observer.law(rne.control.pd(irb140, 1, 1, 0), sample_time=STEP)
    means = np.vstack([(tau[1:] + tau[:-1]) / 2, tau[-1:]])
    _, z = along(law, t, q, qd, means)  # as measured between ticks
    assert 0.6 < t[law.contact(z).argmax()] <= seen.first_contact < 0.61


def test_a_contact_is_remembered(arm, hold, path):
    t = np.arange(40) * STEP
    q, qd, qdd = path(t)
    given = arm.inverse_dynamics(q, qd, qdd) + np.where(np.arange(40) == 5, 1e3, 0.0)[:, None]
    law = MomentumObserver(arm, floor=20.0).law(hold, sample_time=STEP)
    _, z = along(law, t, q, qd, given)
    assert (np.abs(law.residuals(z[-1])) < law.thresholds(z[-1])).all()
    assert law.contact(z).tolist() == [False] * 6 + [True] * 34


def test_torques_are_within_the_limits_and_known_to_be(arm, hold, path):
    t = np.arange(10) * STEP
    q, qd, _ = path(t)
    law = MomentumObserver(arm).law(hold, sample_time=STEP, effort_limit=0.5)
    torques, z = along(law, t, q, qd)
    asked = np.array([hold(*state) for state in zip(t, q, qd, strict=True)])
    assert np.abs(asked).max() > 0.6
    assert (torques == np.clip(asked, -0.5, 0.5)).all()
    assert (z[:, law.places["torques"]] == torques).all()


def test_states_of_the_laws_advance_as_those_of_a_sampled_scene(arm, path):
    """By Euler's rule, those of a discrete law as it says, those of the reaction from the contact on."""
    inner = rne.control.pid(arm, 100, 20, 300, [0.2, 0.1, 0.0])

    class Counting:
        states, discrete, traceable = 1, True, True

        def __call__(self, t, q, qd, z):
            return 0.0 * q + z, z + 1.0

    law = MomentumObserver(arm, floor=50.0).law(inner, Counting(), sample_time=STEP)
    t = np.arange(12) * STEP
    q, qd, qdd = path(t)
    given = arm.inverse_dynamics(q, qd, qdd) + np.where(np.arange(12) > 5, 1e4, 0.0)[:, None]
    torques, z = along(law, t, q, qd, given)
    hit = law.contact(z)
    assert hit.tolist() == [False] * 7 + [True] * 5
    assert z[:, law.places["reaction"]][:, 0].tolist() == np.cumsum(hit).tolist()
    assert torques[-1].tolist() == [hit.sum() - 1.0] * 3
    expected = np.zeros(inner.states)
    for k in range(12):
        expected = expected + STEP * inner(t[k], q[k], qd[k], expected)[1]
    np.testing.assert_allclose(z[-1, law.places["law"]], expected, rtol=SAME)


def test_a_law_within_may_return_lists(arm):
    class Listed:
        states = 1

        def __call__(self, t, q, qd, z):
            return [0.0, 0.0, z[0]], [2.0]

    law = MomentumObserver(arm).law(Listed(), sample_time=STEP)
    _, z = law(0.0, np.zeros(3), np.zeros(3), np.zeros(law.states))
    assert law(STEP, np.zeros(3), np.zeros(3), z)[0].tolist() == [0.0, 0.0, 2.0 * STEP]


def laws(arm, hold, brake):
    """A law of each observer, with all that they may have."""
    observer = MomentumObserver(arm, cases=[arm.with_parameters(1.02 * arm.parameters)], **SEEN["load"])
    how = {"sample_time": STEP, "delay": 1.4 * STEP, "effort_limit": 30.0}
    return {
        "contacts": observer.law(hold, brake, **how),
        "payload": rne.control.payload_observer(arm, law=hold, friction=SEEN["load"]["friction"], **how),
    }


@pytest.fixture(scope="module")
def states(path):
    """Times, positions and velocities with noise, which are contacts."""
    t, rng = np.arange(6) * STEP, np.random.default_rng(0)
    q, qd, _ = path(t)
    return t, q + 1e-4 * rng.normal(size=q.shape), qd


@pytest.mark.parametrize("name", kept(["contacts", "payload"], ["contacts"]))
def test_the_kernel_gives_what_calls_give(arm, hold, brake, states, name):
    law = laws(arm, hold, brake)[name]
    kernel, z = rne.control.compiled(law), np.zeros(law.states)
    for t, q, qd in zip(*states, strict=True):
        u, new = law(t, q, qd, z)
        assert relative(kernel(np.array([t]), q, qd, z), np.concatenate([u, new])) <= SAME
        z = new
    assert z.any()


@pytest.mark.long  # the kernel's operations are those of test_the_kernel_gives_what_calls_give
@pytest.mark.skipif(shutil.which("g++") is None, reason="there is no g++ here")
@pytest.mark.parametrize("name", ["contacts", "payload"])
@pytest.mark.parametrize("language", ["c", "c++"])
def test_printed_text_gives_what_calls_give(arm, hold, brake, states, name, language, tmp_path):
    law = laws(arm, hold, brake)[name]
    text = rne.control.compiled(law).source(language)
    if language == "c":
        function = c_library([text], tmp_path).control_law
    else:
        (tmp_path / "law.hpp").write_text(text)
        sizes = dict(zip("qvz", (3, 3, law.states), strict=True))
        arrays = ", ".join(f"const double* {k}" for k in "tqvz")
        copies = " ".join(
            f"std::array<double, {n}> a{k}; std::copy_n({k}, {n}, a{k}.begin());" for k, n in sizes.items()
        )
        space = re.search(r"namespace (\w+)", text)[1]
        body = f"{copies} auto y = {space}::control_law(*t, aq, av, az);"
        whole = f'#include <algorithm>\n#include "law.hpp"\nextern "C" void control_law({arrays}, double* out) '
        (tmp_path / "law.cpp").write_text(f"{whole}{{ {body} std::copy(y.begin(), y.end(), out); }}\n")
        command = ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-o", "law.so", "law.cpp"]
        subprocess.run(command, cwd=tmp_path, check=True)
        function = ctypes.CDLL(str(tmp_path / "law.so")).control_law
    z = np.zeros(law.states)
    for t, q, qd in zip(*states, strict=True):
        u, new = law(t, q, qd, z)
        got = call(function, [np.array([[t]]), q[None], qd[None], z[None]], 3 + law.states, "float64")[0]
        assert relative(got, np.concatenate([u, new])) <= SAME
        z = new


@pytest.mark.parametrize("name", ["contacts", "payload"])
def test_many_states_and_threads_at_once(arm, hold, brake, states, name):
    """A law has no memory of its own."""
    law = laws(arm, hold, brake)[name]
    _, z = along(law, *states)
    with ThreadPoolExecutor(4) as pool:
        for _, again in pool.map(lambda _: along(law, *states), range(4)):
            assert relative(again, z) <= SAME  # a robot's first calls are not yet by its kernel
    torques, together = law(0.0, states[1], states[2], z)
    for k in range(len(z)):
        u, new = law(0.0, states[1][k], states[2][k], z[k])
        assert relative(np.concatenate([torques[k], together[k]]), np.concatenate([u, new])) <= SAME


@pytest.mark.parametrize("model", kept([straight_chain(2), TURNING], [straight_chain(2)]), ids=["chain", "tree"])
def test_recursive_least_squares_are_batch_least_squares(model):
    """With the same weights and the same prior, for residuals and columns of observers along samples."""
    arm, t, forgetting = rne.Robot(model).with_payload(5.0, inertia=0.5 * np.eye(3)), np.arange(150) * STEP, 0.98
    noise = np.array([0.5, 1.0, 2.0])[: arm.n]
    q, qd, qdd = rne.trajectories.quintic([0.1, -0.2, 0.3][: arm.n], [1.0, 0.6, -0.9][: arm.n], 0.4)(t)
    tau = arm.with_payload(3.0, [0.05, 0, 0.1], np.diag([0.01, 0.02, 0.02])).inverse_dynamics(q, qd, qdd)
    law = rne.control.payload_observer(arm, sample_time=STEP, forgetting=forgetting, noise=noise, prior=(5.0, 0.2))
    _, z = along(law, t, q, qd, tau)
    observer, count, start = MomentumObserver(arm, gain=50.0), len(law.names), arm.parameters
    r = observer.observe(t, q, qd, tau, held=True).torque
    columns = []
    for unit in law._parameters[law._combinations[0]]:  # residuals are linear in the model's parameters
        heavier = MomentumObserver(arm.with_parameters(start + 1e-2 * unit), gain=50.0)
        columns.append((r - heavier.observe(t, q, qd, tau, held=True).torque) / 1e-2)
    H, scales = np.stack(columns, axis=-1), np.array([5.0, 1.0, 1.0, 1.0, *[0.2] * 6])[law._combinations[0]]
    weights = (50.0 * STEP / 2 * forgetting ** np.arange(len(t) - 1, -1, -1))[:, None] / noise**2
    rows = (np.sqrt(weights)[..., None] * H).reshape(-1, count) * scales
    rows, known = np.vstack([rows, np.eye(count)]), np.append((np.sqrt(weights) * r).ravel(), np.zeros(count))
    expected, deviations = np.linalg.lstsq(rows, known)[0], np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    # columns lose digits where small differences of large parameters are divided: those of the normal equations count
    bound = SAME * np.linalg.cond(rows) ** 2
    assert relative(law.parameters(z[-1]) / scales, expected) <= bound <= 1e-4
    assert relative(law.standard_deviations(z[-1]) / scales, deviations) <= bound


@pytest.fixture(scope="module")
def lifted(irb140):
    """A payload observer after each sample of a motion with 3 kg, the mass and its centre."""
    motion, t = rne.trajectories.quintic([0] * 6, [1, 0.5, -0.5, 1, 1, 1], 0.3), np.arange(300) * STEP
    law, heavy = rne.control.payload_observer(irb140, sample_time=STEP), irb140.with_payload(3.0, [0.05, 0, 0.1])
    q, qd, _ = motion(t)
    return law, along(law, t, q, qd, heavy.inverse_dynamics(*motion(t + STEP / 2)))[1]


def test_a_payload_is_found_with_its_centre(lifted):
    law, z = lifted
    mass, com = law.payload(z[-1])
    assert mass == pytest.approx(3.0, rel=0.01)
    np.testing.assert_allclose(com, [0.05, 0.0, 0.1], atol=1e-3)
    assert law.standard_deviations(z[-1])[0] < 0.1
    light = z[-1].copy()
    light[law.places["estimates"]] /= 10  # a tenth of the mass and of its first moments
    np.testing.assert_allclose(law.payload(light)[0], mass / 10, rtol=SAME)
    np.testing.assert_allclose(law.payload(light)[1], com, rtol=SAME)


def test_before_a_motion_excites_them_estimates_are_known_to_be_unknown(lifted):
    law, z = lifted
    prior = np.repeat([10.0, 3.0, 0.9], [1, 3, 6])
    for start in (np.zeros(law.states), z[0]):
        np.testing.assert_allclose(law.standard_deviations(start), prior, rtol=SAME)
        assert not law.parameters(start).any()
    assert (law.standard_deviations(z[2])[4:] > 0.99 * prior[4:]).all()  # inertias act on accelerations alone
    assert (law.standard_deviations(z[-1]) < 0.1 * prior).all()


def test_without_excitation_deviations_return_to_the_prior(irb140, lifted):
    """At rest for sixty times the memory nothing grows without bound; gravity goes on telling the first moments."""
    law = rne.control.payload_observer(irb140, sample_time=STEP, forgetting=0.5, gain=1000.0)
    z, end = lifted[1][-1], np.array([1, 0.5, -0.5, 1, 1, 1])
    tau = irb140.with_payload(3.0).gravity_torque(end)
    for _ in range(60):
        _, z = law(0.0, end, np.zeros(6), z)
        z[law.places["torques"]] = tau
    prior = np.repeat([10.0, 3.0, 0.9], [1, 3, 6])
    assert (law.standard_deviations(z) <= prior * (1 + SAME)).all()
    np.testing.assert_allclose(law.standard_deviations(z)[4:], prior[4:], rtol=1e-6)


def test_what_a_planar_arm_does_not_tell():
    """Rods about parallel axes do not feel where along them a payload is, nor most of its inertia."""
    law = rne.control.payload_observer(rne.Robot(straight_chain(2)), sample_time=STEP)
    assert {"mcy", "Ixx", "Ixy", "Ixz", "Iyz", "Izz"} <= set(law.unknown)
    mass, com = law.payload(np.zeros((4, law.states)))
    assert np.isnan(com[:, 1]).all()
    assert mass.tolist() == [0.0] * 4
    assert len(law.formulas) == len(law.names) == 4


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"law": 3.0}, TypeError, "`law` must be a function of (t, q, qd), got float"),
        ({"reaction": 3.0}, TypeError, "`reaction` must be a function of (t, q, qd), got float"),
        ({"sample_time": 0}, ValueError, "`sample_time` must be positive, got 0.0"),
        ({"delay": -1.0}, ValueError, "`delay` must not be negative, got -1.0"),
        ({"effort_limit": [1, 2]}, ValueError, "`effort_limit` must have shape (3,), got (2,)"),
    ],
)
def test_laws_that_are_refused(arm, hold, change, error, text):
    with pytest.raises(error, match=f"^{re.escape(text)}"):
        MomentumObserver(arm).law(**{"law": hold, "sample_time": STEP} | change)


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"robot": 3}, TypeError, "`robot` must be an rne.Robot"),
        ({"link": "base"}, ValueError, "`link` must be one of"),
        ({"link": "root"}, ValueError, "`link` 'root' does not move"),
        ({"law": 3.0}, TypeError, "`law` must be a function of (t, q, qd), got float"),
        ({"forgetting": 1.01}, ValueError, "`forgetting` must be at most 1, got 1.01"),
        ({"noise": 0.0}, ValueError, "`noise` must be positive"),
        ({"prior": (1.0, 0.0)}, ValueError, "`prior` must be positive"),
    ],
)
def test_payload_observers_that_are_refused(arm, change, error, text):
    with pytest.raises(error, match=f"^{re.escape(text)}"):
        rne.control.payload_observer(**{"robot": arm, "sample_time": STEP} | change)


def test_a_robot_without_joints_has_no_contact():
    robot = rne.Robot(straight_chain(1)).locked({"joint0": 0.0})
    law, none = MomentumObserver(robot).law(lambda t, q, qd: 0 * q, sample_time=STEP), np.zeros(0)
    torques, z = law(0.0, none, none, np.zeros(law.states))
    assert torques.shape == (0,)
    assert not law.contact(z)
    assert MomentumObserver(robot).observe([0.0, 0.1], *np.zeros((3, 2, 0))).first_contact is None


def test_states_of_another_length_are_refused(arm, hold):
    law = MomentumObserver(arm).law(hold, sample_time=STEP)
    with pytest.raises(ValueError, match=rf"^`z` must have shape \(..., {law.states}\), got \(3,\)$"):
        law.residuals(np.zeros(3))


def test_a_law_within_that_has_memory_is_called(arm):
    """After another one of the same formula too."""

    class Tiring:
        traceable, calls = True, 0

        def __call__(self, t, q, qd):
            self.calls += 1
            return -5.0 * qd if self.calls < 4 else -6.0 * qd

    for inner, is_called in ((rne.traceable(lambda t, q, qd: -5.0 * qd), False), (Tiring(), True)):
        law = MomentumObserver(arm).law(inner, sample_time=STEP)
        assert (rne.Scene(arm, controller=law, sample_time=STEP).traced_law() is None) == is_called


def test_a_law_that_is_not_traceable_is_called(arm, path):
    plain = lambda t, q, qd: -5.0 * qd  # noqa: E731
    observer = MomentumObserver(arm)
    assert not observer.law(plain, sample_time=STEP).traceable
    assert not observer.law(rne.traceable(lambda t, q, qd: -5.0 * qd), plain, sample_time=STEP).traceable
    assert observer.law(rne.traceable(lambda t, q, qd: -5.0 * qd), sample_time=STEP).traceable
