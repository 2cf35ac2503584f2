"""Adaptive control: what its Lyapunov function says, and what it needs for it."""

import re

import numpy as np
import pytest

import rne
from rne.basics.inertia import pseudo_inertia

from .helpers import first_joints, kept, loaded

W = np.pi  # 0.5 Hz
CENTRE = np.array([0, 0.2, -0.3, 0.2, 0.8, 0.1])  # [rad]
RADIUS = np.array([0.4, 0.3, 0.3, 0.4, 0.4, 0.5])
PHASE = np.array([0, np.pi / 2] * 3)
KD, BANDWIDTH = np.array([40, 60, 20, 4, 2, 1.0]), 20.0  # [N m s/rad], [1/s]


def circle(t):
    """Neighbouring joints run on circles at 0.5 Hz."""
    angle = W * np.asarray(t) + PHASE
    return CENTRE + RADIUS * np.sin(angle), RADIUS * W * np.cos(angle), -RADIUS * W**2 * np.sin(angle)


def short_circle(t):
    return tuple(part[..., :3] for part in circle(t))


@pytest.fixture(scope="module")
def arm():
    """Three joints: the IRB 140 with its wrist locked."""
    return first_joints()


def law_of(arm, **options):
    return rne.control.adaptive(arm, KD[:3], [BANDWIDTH] * 3, short_circle, **options)


def random_state(law, seed=0, size=0.1):
    """A time, a state off the reference, and estimates off the start."""
    rng = np.random.default_rng(seed)
    t = rng.uniform(0, 2)
    q, qd, _ = law.reference(t)
    n = law.robot.n
    return t, q + rng.normal(0, 0.1, n), qd + rng.normal(0, 1, n), rng.normal(0, size, law.states)


def composite_error(law, t, q, qd):
    q_ref, qd_ref, _ = law.reference(t)
    return qd - qd_ref + law.bandwidth * (q - q_ref)


def lyapunov(law, plant, t, q, qd, z):
    s = composite_error(law, t, q, qd)
    return (s @ plant.mass_matrix(q) @ s) / 2 + law.distance(z, plant) / law.gain


@pytest.mark.parametrize("consistent", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_lyapunov_function_falls_as_the_proof_says(arm, consistent, seed):
    """V' = -s^T Kd s in any state, by differences of V along the flow; the robot differs in every body."""
    law = law_of(arm, consistent=consistent)
    plant = arm.with_payload(3.0, com=[0.05, 0, 0.1])
    plant = plant.with_parameters(plant.parameters * 1.3)
    t, q, qd, z = random_state(law, seed)
    u, rates = law(t, q, qd, z)
    qdd = plant.forward_dynamics(q, qd, u)
    h = 1e-6

    def beside(k):
        return lyapunov(law, plant, t + k * h, q + k * h * qd, qd + k * h * qdd, z + k * h * rates)

    slope = (8 * (beside(1) - beside(-1)) - (beside(2) - beside(-2))) / (12 * h)
    s = composite_error(law, t, q, qd)
    assert slope == pytest.approx(-(s @ (law.kd * s)), rel=1e-6)


@pytest.mark.parametrize("consistent", kept([False, True], [True]))
def test_lyapunov_function_never_grows_along_a_run(arm, consistent):
    law, plant = law_of(arm, consistent=consistent), arm.with_payload(3.0)
    q, qd, _ = short_circle(0)
    motion = rne.simulate(rne.Scene(plant, controller=law), q + 0.03, qd, 0.3, method="DOP853", rtol=1e-9, atol=1e-12)
    assert law.parameters(motion.controller_state).shape == (len(motion.t), len(arm.parameters))
    V = [
        lyapunov(law, plant, *state)
        for state in zip(motion.t, motion.q, motion.qd, motion.controller_state, strict=True)
    ]
    assert np.diff(V).max() <= 1e-7 * V[0]  # the solver's tolerance
    assert V[-1] < 0.9 * V[0]


def smallest_eigenvalues(law, motion):
    return np.linalg.eigvalsh(pseudo_inertia(law.parameters(motion.controller_state)))[..., 0].min(axis=1)


def test_natural_law_stays_among_possible_bodies(arm):
    """In a run in which the law with a constant metric leaves them."""
    left = {}
    for consistent in (False, True):
        law = law_of(arm, consistent=consistent)
        scene = rne.Scene(arm.with_payload(3.0), controller=law)
        motion = rne.simulate(scene, short_circle(0)[0] + 0.1, [0] * 3, 0.5, method="DOP853")
        left[consistent] = smallest_eigenvalues(law, motion).min()
    assert left[False] < -1e-3
    assert left[True] > 0


def test_with_the_right_parameters_it_is_computed_torque(arm):
    law = law_of(arm)
    q, qd, qdd = short_circle(0.3)
    torques, rates = law(0.3, q, qd, np.zeros(law.states))
    np.testing.assert_allclose(torques, arm.inverse_dynamics(q, qd, qdd), rtol=1e-12)
    assert np.abs(rates).max() <= 1e-9  # s is rounding alone
    motion = rne.simulate(rne.Scene(arm, controller=law), *short_circle(0)[:2], 2.0, method="DOP853")
    assert np.abs(motion.q - short_circle(motion.t[:, None])[0]).max() <= 1e-6
    assert np.abs(motion.controller_state).max() <= 1e-4


def test_rotors_are_compensated(arm):
    rotors = rne.Scene(arm, armature=[1.0, 2.0, 0.5]).resolved.robot
    law = law_of(rotors)
    q, qd, qdd = short_circle(0.3)
    torques, _ = law(0.3, q, qd, np.zeros(law.states))
    np.testing.assert_allclose(torques, rotors.inverse_dynamics(q, qd, qdd), rtol=1e-12)


@pytest.mark.parametrize("consistent", kept([False, True], [True]))
def test_traced_is_called_and_takes_batches(arm, consistent):
    law = law_of(arm, consistent=consistent, viscous=[1, 2, 3], coulomb=[2, 2, 2], bodies=["joint_3"])
    scene = rne.Scene(arm.with_payload(1.0), controller=law)
    assert scene.cost()["law"] == "traced"

    def called(t, q, qd, z):
        return law(t, q, qd, z)

    called.states = law.states
    motions = [
        rne.simulate(rne.Scene(arm.with_payload(1.0), controller=c), *short_circle(0)[:2], 0.05, method="DOP853")
        for c in (law, called)
    ]
    assert np.abs(motions[0](0.05)[0] - motions[1](0.05)[0]).max() <= 1e-7
    states = [random_state(law, seed) for seed in range(4)]
    t, q, qd, z = (np.array(x) for x in zip(*states, strict=True))
    together = law(t[:, None], q, qd, z)
    for k in range(2):
        single = np.array([law(*state)[k] for state in states])
        np.testing.assert_allclose(together[k], single, rtol=1e-12, atol=1e-12 * np.abs(single).max())


def test_only_the_bodies_asked_for_are_adapted(arm):
    law = law_of(arm, bodies=["joint_3"])
    assert law.states == 10
    change = law.parameters(np.full(10, 0.1)) - arm.parameters
    assert not change[:20].any()
    assert change[20:].any()
    assert law.parameters(np.zeros(10)).tolist() == arm.parameters.tolist()


def test_bodies_without_mass_are_left_out_by_default():
    robot = loaded("irb140")
    law = rne.control.adaptive(robot, KD, [20] * 6, circle)
    assert law.bodies == ("joint_1", "joint_2", "joint_4", "joint_6")


@pytest.mark.parametrize("joints", kept([3, 6], [3]))
def test_unknown_payload_is_learnt(arm, irb140, joints):
    """0.5 Hz circle, 3 kg: soon each joint's error is below a tenth of computed torque's; so is the worst."""
    robot, last = {3: (arm, "joint_3"), 6: (irb140, "joint_6")}[joints]
    reference = {3: short_circle, 6: circle}[joints]
    scene_errors = {}
    end = {3: 3.0, 6: 10.0}[joints]
    times = np.linspace(end - 2, end, 201)
    laws = {
        "computed torque": rne.control.computed_torque(robot, BANDWIDTH**2, 2 * BANDWIDTH, reference),
        "adaptive": rne.control.adaptive(
            robot, KD[:joints], BANDWIDTH, reference, bodies=[last], gain=30.0, consistent=True
        ),
    }
    for name, law in laws.items():
        scene = rne.Scene(robot, payload=3.0, controller=law)
        motion = rne.simulate(scene, *reference(0)[:2], end, t_eval=times)
        scene_errors[name] = np.abs(motion.q - reference(times[:, None])[0]).max(axis=0)
    assert scene_errors["adaptive"].max() < scene_errors["computed torque"].max() / 10
    heavy = slice(0, 5)  # the payload is on the axis of joint 6
    assert (scene_errors["adaptive"][heavy] < scene_errors["computed torque"][heavy] / 10).all()
    mass = law.parameters(motion.controller_state)[-1, -10]
    assert mass == pytest.approx(robot.model.mass[-1] + 3.0, rel=0.01)


def test_friction_is_learnt(arm):
    """Viscous and Coulomb coefficients of the scene, from half of them; the same smoothing."""
    viscous, coulomb = np.array([10.0, 10, 5]), np.array([4.0, 4, 2])
    scene = {"friction": rne.Friction(viscous=viscous, coulomb=coulomb, smoothing=0.1)}
    law = law_of(arm, viscous=viscous / 2, coulomb=coulomb / 2, bodies=[], smoothing=0.1, consistent=True, gain=100)
    motion = rne.simulate(rne.Scene(arm, controller=law, **scene), *short_circle(0)[:2], 8.0)
    learnt_viscous, learnt_coulomb = law.friction(motion.controller_state[-1])
    rates = RADIUS[:3] * W / 2  # where the motion does not tell the two apart their sum counts
    np.testing.assert_allclose(learnt_viscous * rates + learnt_coulomb, viscous * rates + coulomb, rtol=0.05)
    np.testing.assert_allclose([learnt_viscous, learnt_coulomb], [viscous, coulomb], rtol=0.25)


def test_adaptation_pauses_at_the_limits(arm):
    """In full below 90 % of every limit, half at 95 %, not at all beyond."""
    state = random_state(law_of(arm))
    torques, rates = law_of(arm)(*state)
    for used, share in ((0.8, 1.0), (0.95, 0.5), (1.3, 0.0)):
        limit = np.full(3, 2 * np.abs(torques).max())
        limit[1] = abs(torques[1]) / used
        same, slowed = law_of(arm, effort_limit=limit)(*state)
        np.testing.assert_array_equal(same, torques)
        np.testing.assert_allclose(slowed, share * rates, rtol=1e-9, atol=1e-12)


def test_adaptation_pauses_where_one_joint_is_beyond_its_limit(arm):
    law = law_of(arm, effort_limit=[1e-3, 1e9, 1e9])
    assert not law(*random_state(law))[1].any()


def test_defaults_are_those_of_the_scene(arm):
    law = law_of(arm)
    assert (law.smoothing, law.gain, law.consistent) == (rne.Friction(coulomb=1.0).smoothing, 1.0, False)


@pytest.mark.long
def test_saturated_drives_let_the_estimates_escape_unless_adaptation_pauses(irb140):
    limit = [30, 150, 50, 5, 3, 1]
    options = {"bodies": ["joint_6"], "gain": 30.0, "consistent": True}
    scene = {"payload": 3.0, "effort_limit": limit}
    law = rne.control.adaptive(irb140, KD, [BANDWIDTH] * 6, circle, **options)
    with pytest.raises(rne.SimulationError), np.errstate(over="ignore"):
        rne.simulate(rne.Scene(irb140, controller=law, **scene), *circle(0)[:2], 1.0)
    pausing = rne.control.adaptive(irb140, KD, [BANDWIDTH] * 6, circle, effort_limit=limit, **options)
    times = np.linspace(8, 10, 201)
    motion = rne.simulate(rne.Scene(irb140, controller=pausing, **scene), *circle(0)[:2], 10.0, t_eval=times)
    assert np.abs(motion.q - circle(times[:, None])[0]).max() < 2e-3
    assert pausing.parameters(motion.controller_state)[-1, -10] == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"effort_limit": [1, 1, 0]}, "`effort_limit` must be positive, got 0.0"),
        (
            {"bodies": ["joint_9"]},
            "`bodies` must name joints of ['joint_1', 'joint_2', 'joint_3'], got 'joint_9'",
        ),
        ({"bodies": "joint_3"}, "`bodies` must be a sequence of names of joints, got the string 'joint_3'"),
        ({"gain": 0.0}, "`gain` must be positive, got 0.0"),
        ({"viscous": [1, 0, 1]}, "`viscous` must be positive, got 0.0"),
        ({"coulomb": [1, 1]}, "`coulomb` must have shape (3,), got (2,)"),
        ({"smoothing": -1.0}, "`smoothing` must be positive, got -1.0"),
    ],
)
def test_wrong_arguments_are_named(arm, options, text):
    with pytest.raises(ValueError, match=rf"^{re.escape(text)}$"):
        law_of(arm, **options)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (([0] * 6, [1] * 6, circle), "`kd` must be positive, got 0.0"),
        (([1] * 6, [-1] * 6, circle), "`bandwidth` must be positive, got -1.0"),
        (([1] * 6, [1] * 6, 3), "`reference` must be a function of time, got int"),
    ],
)
def test_wrong_gains_are_named(irb140, arguments, text):
    with pytest.raises(ValueError, match=rf"^{re.escape(text)}$"):
        rne.control.adaptive(irb140, *arguments)


def test_a_body_without_mass_is_refused(irb140):
    text = "`bodies`: the body of joint 'joint_5' cannot be adapted: its pseudo-inertia is not positive definite"
    with pytest.raises(ValueError, match=rf"^{re.escape(text)}$"):
        rne.control.adaptive(irb140, KD, [20] * 6, circle, bodies=["joint_5"])


def test_a_robot_with_nothing_to_adapt_is_refused_unless_friction_is(arm):
    massless = arm.with_parameters(0 * arm.parameters)
    text = (
        "`robot` has nothing to adapt: the pseudo-inertia of none of its bodies is positive definite, and neither "
        "`viscous` nor `coulomb` is given"
    )
    with pytest.raises(ValueError, match=rf"^{re.escape(text)}$"):
        law_of(massless)
    assert law_of(massless, viscous=[1] * 3).states == 3


def test_distance_is_from_a_robot_with_the_same_joints(arm, irb140):
    law = law_of(arm)
    text = f"`robot` must have the joints {list(arm.joint_names)}, got {list(irb140.joint_names)}"
    with pytest.raises(ValueError, match=rf"^{re.escape(text)}$"):
        law.distance(np.zeros(law.states), irb140)
