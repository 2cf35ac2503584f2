"""Which parameters the torques of the drives are linear in."""

import re
from dataclasses import replace

import numpy as np
import pytest

import rne
from rne.model.standard_parameters import StandardParameters

from .conftest import TREES
from .helpers import loaded
from .random_robots import straight_chain

SAME = 1e-13  # of the largest torque: another order of operations


def torques(robot, standard, q, qd, qdd, values):
    Y = np.concatenate([robot.regressor(q, qd, qdd), standard.drive_columns(qd, qdd)], axis=-1)
    return Y @ values


@pytest.mark.parametrize("name", ["irb140", "mimics"])
def test_torques_of_a_scene_are_linear_in_them(name):
    """The scene adds friction and rotors itself."""
    robot = rne.Robot(TREES[name]) if name in TREES else rne.load(name)
    rng = np.random.default_rng(0)
    model = rne.Model(
        **{f: getattr(robot.model, f) for f in robot.model.__dataclass_fields__}
        | {"armature": rng.uniform(0.1, 1, robot.model.nb)}
    )
    robot = rne.Robot(model)
    q, qd, qdd = rng.uniform(-2, 2, (3, 20, robot.n))
    viscous, coulomb = rng.uniform(1, 5, (2, robot.n))
    standard = StandardParameters(model, rne.DriveModel(rotor=True, friction="viscous+coulomb", smoothing=0.01))
    values = standard.values.copy()
    values[standard.groups["Fv"]], values[standard.groups["Fc"]] = viscous, coulomb
    scene = rne.Scene(robot, friction=rne.Friction(viscous=viscous, coulomb=coulomb, smoothing=0.01))
    expected = scene.inverse_dynamics(q, qd, qdd)
    got = torques(robot, standard, q, qd, qdd, values)
    assert np.abs(got - expected).max() <= SAME * np.abs(expected).max()


def test_shaft_of_a_coupled_motor():
    """A rotor that turns with the sum of two joints: by the transposed coupling it acts on both."""
    robot = loaded("irb140")
    shaft = np.array([[0, 0, 0, 0, 1.0, 1.0]])
    standard = StandardParameters(
        robot.model, rne.DriveModel(rotor=True, friction="coulomb", offset=True, coupled_motors=shaft)
    )
    qd, qdd = np.random.default_rng(0).normal(size=(2, 6))
    columns = standard.drive_columns(qd, qdd)
    assert standard.names[-2:] == ("Ia_s1", "Fc_s1")
    expected = np.zeros((6, 2))
    expected[4:, 0], expected[4:, 1] = qdd[4] + qdd[5], np.sign(qd[4] + qd[5])
    np.testing.assert_array_equal(columns[:, -2:], expected)
    np.testing.assert_array_equal(columns[:, 12:18], np.eye(6))
    assert columns.shape[-1] + 60 == standard.count == len(standard.names)


def test_without_drives_there_are_the_bodies_alone():
    standard = StandardParameters(rne.irb140())
    assert standard.names[:10] == (
        "m_1",
        "mcx_1",
        "mcy_1",
        "mcz_1",
        "Ixx_1",
        "Ixy_1",
        "Iyy_1",
        "Ixz_1",
        "Iyz_1",
        "Izz_1",
    )
    assert standard.drive_columns(np.ones((3, 6)), np.ones((3, 6))).shape == (3, 6, 0)
    np.testing.assert_array_equal(standard.values, loaded("irb140").parameters)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (
            {"friction": "dry"},
            "`friction` must be of the words 'viscous', 'asymmetric', 'coulomb', 'load', joined by '+', got 'dry'",
        ),
        ({"coupled_motors": [1.0] * 6}, "`coupled_motors` must have shape (s, 6), got (6,)"),
        ({"smoothing": -1.0}, "`smoothing` must not be negative, got -1.0"),
    ],
)
def test_errors(given, text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        StandardParameters(rne.irb140(), rne.DriveModel(**given))


def test_drives_are_a_model_of_drives():
    with pytest.raises(TypeError, match=r"^`drives` must be an rne.DriveModel, got str$"):
        StandardParameters(rne.irb140(), "viscous")


def test_friction_under_load_needs_the_load():
    standard = StandardParameters(straight_chain(2), rne.DriveModel(friction="load"))
    with pytest.raises(
        ValueError, match=r'^`friction` "load" of `drives` depends on the load, which is not known here$'
    ):
        standard.drive_columns(np.ones(2), np.zeros(2))


def test_drives_of_joints_that_mimic_count_with_those_they_follow():
    """By their power: sums over all joints at G qd are sums over the coordinates at qd."""
    rng = np.random.default_rng(3)
    armature, damping, friction = rng.uniform(0.1, 1, (3, TREES["mimics"].nb))
    model = replace(TREES["mimics"], armature=armature, damping=damping, friction=friction)
    assert model.has_mimics
    standard = StandardParameters(model, rne.DriveModel(rotor=True, friction="viscous+coulomb"))
    qd = rng.normal(size=model.n)
    joints = model.coordinate_map @ qd
    for symbol, drives, power in (("Ia", armature, np.square), ("Fv", damping, np.square), ("Fc", friction, np.abs)):
        values = standard.values[standard.groups[symbol]]
        np.testing.assert_allclose(values @ power(qd), drives @ power(joints), rtol=1e-12)
