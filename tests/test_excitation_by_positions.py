"""Exciting motions for logs without torques: their score is that of positions' derivatives, what they do not tell is named."""

import dataclasses
import re

import numpy as np
import pytest

import rne

from .random_robots import straight_chain

DIFFERENCES = 1e-5  # central differences of positions that are simulated at rtol 1e-10, of log det
NAMES = ["controller.kp", "friction.viscous"]
PERIOD, HARMONICS = 1.0, 2


def rod(**changes):
    limits = {"lower": [-1.5], "upper": [1.5], "velocity_limit": [4.0], "effort_limit": [np.inf]}
    limits = {name: np.array(limit) for name, limit in (limits | changes).items()}
    return rne.Robot(dataclasses.replace(straight_chain(1), **limits)).with_armature(0.05)


@pytest.fixture(scope="module")
def scene():
    law = rne.control.servo(rod(), 20, 0.2, 0, stall_torque=40, no_load_speed=60)
    return rne.Scene(law.robot, controller=law, friction=rne.Friction(viscous=0.1))


def of(scene, wrt=tuple(NAMES), **options):
    options = {"measured": "positions", "random_motions": 2} | options
    return rne.excitation(scene, PERIOD, HARMONICS, wrt=wrt, **options)


def log_det(scene, motion):
    """Of the second period's positions, by differences of motions."""
    t, dense, q0 = np.arange(40, 80) * (PERIOD / 40), np.linspace(0, 2 * PERIOD, 161), motion(0.0)[0]
    reference = rne.trajectories.spline(dense, motion(dense)[0])

    def positions(changed):
        law = dataclasses.replace(changed.controller, reference=reference)
        how = {"t_eval": [0, *t], "method": "DOP853", "rtol": 1e-10, "atol": 1e-12}
        return rne.simulate(dataclasses.replace(changed, controller=law), q0, 0 * q0, 2 * PERIOD, **how).q[1:, 0]

    columns = []
    for name in NAMES:
        value = scene.numbers[name]
        ends = [positions(scene.with_numbers({name: value + step})) for step in (1e-4, -1e-4)]
        columns.append((ends[0] - ends[1]) / 2e-4)
    J = np.array(columns).T
    return np.linalg.slogdet(J.T @ J)[1]


def test_the_motion_whose_positions_tell_most_is_taken(scene):
    """log det of the information by differences, independent of how the numbers are scaled."""
    first, best = of(scene, random_motions=1), of(scene)
    assert best.criterion == "d-optimal"
    assert best.random.argmax() == 1
    assert best.log_det == best.random[1]
    own = [log_det(scene, motion) for motion in (first, best)]
    assert own[1] > own[0] + 0.1
    np.testing.assert_allclose(np.diff(best.random), np.diff(own), rtol=0, atol=DIFFERENCES)
    assert all((use <= 1).all() for use in best.limit_use.values())
    assert "not converged: the best of 2 random motions, which no optimiser follows" in re.sub(r"\s+", " ", repr(best))
    again = of(scene, criterion="condition", noise=[2e-3], random_motions=1)
    assert again.condition == again.random.min() >= 1


def test_what_positions_cannot_tell_is_left_out_and_named(scene):
    """A velocity gain, viscous friction and, while the motor is not at its limit, the back EMF act alike."""
    seen = []
    names = ["controller.kp", "controller.kd", "friction.viscous"]
    found = of(scene, names, random_motions=1, progress=lambda *s: seen.append(s))
    assert found.notes[0] == "no motion determines 1 combination of controller.kd, friction.viscous; it is left out"
    assert seen == [(1, 1)]
    assert not any("determines" in note for note in of(scene, names[:2], random_motions=1).notes)


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        ({"measured": "currents"}, ValueError, "`measured` must be one of ['torques', 'positions'], got 'currents'"),
        ({"wrt": None}, ValueError, "`wrt` must name the numbers of the scene that are to be found from positions, "),
        ({"wrt": "q0"}, ValueError, "`wrt` must name numbers that are to be found from positions, got 'q0'"),
        ({"wrt": "controller.stall_torque"}, ValueError, "`wrt`: positions along 2 random motions depend on none of "),
        (
            {"locked": [0]},
            ValueError,
            "`locked` is for `measured` 'torques'; for 'positions' both are given by the scene",
        ),
        ({"measured": "torques"}, ValueError, "`wrt` is for `measured` 'positions'; from torques base parameters are "),
        ({"criterion": "a-optimal"}, ValueError, "`criterion` must be one of ['condition', 'd-optimal'], got 'a-opt"),
        ({"wrt": "controller.kq"}, KeyError, '"the scene has the numbers '),
    ],
)
def test_wrong_arguments_are_named(scene, options, error, text):
    with pytest.raises(error, match=rf"^{re.escape(text)}"):
        of(scene.with_numbers({"controller.no_load_speed": np.inf}), **{"wrt": NAMES} | options)


def test_without_a_reference_to_follow_there_is_no_motion(scene):
    with pytest.raises(TypeError, match=r"^`robot` must be an rne.Scene, whose controller follows the motion, for "):
        of(scene.robot)
    for law, kind in ((None, "none"), (rne.traceable(lambda t, q, qd: -q), "function")):
        with pytest.raises(ValueError, match=rf"^`robot` must be a scene whose controller .* got {kind}$"):
            of(rne.Scene(scene.robot, controller=law))
