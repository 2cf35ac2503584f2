"""Roll, pitch and yaw of a rotation give the rotation again, near pitch +-pi/2 too, where roll and yaw are one angle."""

import numpy as np
import pytest

import rne
from rne.basics.spatial import combine_bodies, rotation_about, rotation_from_rpy, rpy_from_rotation

ROUNDING = 8 * np.finfo(float).eps  # sines and cosines of three angles, and two products
X, Y, Z = np.eye(3)


def any_rotation(rng):
    axis = rng.normal(size=3)
    return rotation_about(axis / np.linalg.norm(axis), np.asarray(rng.uniform(-np.pi, np.pi)))


def near_the_pole(away, sign, seed):
    """A rotation whose pitch differs from sign pi/2 by `away`, each of its entries rounded by about one eps of 1."""
    rng = np.random.default_rng(seed)
    first, last = rng.uniform(-np.pi, np.pi, 2)
    upright = np.array([[0, 0, sign], [0, 1, 0], [-sign, 0, 0]])
    other = any_rotation(rng)
    R = rotation_about(Z, first) @ upright @ rotation_about(Y, -sign * away) @ rotation_about(X, last)
    return other @ (other.T @ R)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("away", [1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 0.0])
def test_angles_near_the_pole_give_the_rotation(away, sign):
    for seed in range(8):
        R = near_the_pole(away, sign, seed)
        rpy = rpy_from_rotation(R)
        assert abs(rpy[1] - sign * np.pi / 2) < away + 1e-12
        np.testing.assert_allclose(rotation_from_rpy(rpy), R, rtol=0, atol=ROUNDING)


def test_angles_of_any_rotation_give_it():
    rng = np.random.default_rng(5)
    for R in (any_rotation(rng) for _ in range(40)):
        np.testing.assert_allclose(rotation_from_rpy(rpy_from_rotation(R)), R, rtol=0, atol=ROUNDING)


def test_angles_are_those_of_a_file_within_its_ranges():
    for rpy in ([0.3, -0.4, 2.9], [-3.0, 1.5, -0.2], [0, 0, np.pi / 2], [0, 0, np.pi], [-np.pi / 2, 0, 0]):
        np.testing.assert_allclose(rpy_from_rotation(rotation_from_rpy(np.array(rpy))), rpy, rtol=0, atol=1e-14)


@pytest.mark.parametrize("away", [1e-6, 1e-9, 1e-12])
def test_a_robot_with_links_near_the_pole_is_written_and_read_with_its_poses(tmp_path, away):
    rotations = np.array([near_the_pole(away, sign, seed) for seed, sign in enumerate((1, -1, 1))])
    arm = rne.model.chain(rotations, np.random.default_rng(0).normal(size=(3, 3)))
    file = tmp_path / "arm.urdf"
    file.write_text(rne.to_urdf(arm))
    q = np.array([0.3, -1.1, 2.0])
    poses, again = (rne.dynamics.link_poses(model, q) for model in (arm, rne.read_urdf(file)))
    np.testing.assert_allclose(again, poses, rtol=0, atol=50 * np.finfo(float).eps)  # lengths of about 3 m


def test_entries_within_four_roundings_of_0_and_1_are_these():
    eps = np.finfo(float).eps
    near = np.array([[1 + 2 * eps, 3 * eps, 6 * eps], [-eps, -1 + 3 * eps, 0], [0, 0, -1 + 6 * eps]])
    arm = rne.model.chain([near], [[0, 0, 0]])
    assert arm.rotation[0].tolist() == [[1.0, 0.0, 6 * eps], [0.0, -1.0, 0.0], [0.0, 0.0, -1 + 6 * eps]]


def test_bodies_without_mass_keep_their_inertia_and_are_centred_at_the_origin():
    mass, com, inertia = combine_bodies([(0.0, np.array([0.1, 0.2, 0.3]), np.diag([1.0, 2.0, 3.0]))] * 2)
    assert mass == 0
    assert com.tolist() == [0, 0, 0]
    assert inertia.tolist() == np.diag([2.0, 4.0, 6.0]).tolist()
