"""Bodies whose principal moments differ by many decades: the small one must not be lost in the large ones."""

import numpy as np
import pytest

import rne

from .helpers import EPS, Part, assemble

Z = np.array([0, 0, 1.0])


def spinner(along, across, com=0.0):
    """A rod that turns about its own axis."""
    rod = Part(
        link="rod", joint="spin", kind="continuous", parent=0, axis=Z, mass=1.0,
        com=np.array([0, 0, com]), inertia=np.diag([across, across, along]),
    )  # fmt: skip
    return rne.Robot(assemble("spinner", [Part(link="base"), rod]))


@pytest.mark.parametrize(
    ("along", "across", "com"), [(5e-5, 0.0833, 0.5), (5e-9, 8.33, 5.0), (1.0, 1e16, 0.0), (1e-12, 1.0, 1.0)]
)
def test_inertia_about_the_slender_axis_keeps_its_digits(along, across, com):
    robot = spinner(along, across, com)
    for M in (robot.mass_matrix([0.3]), rne.dynamics.mass_matrix(robot.model, [0.3])):
        assert M[0, 0] == pytest.approx(along, rel=4 * EPS)
    for tau in (
        robot.inverse_dynamics([0.3], [2.0], [3.0]),
        rne.dynamics.inverse_dynamics(robot.model, [0.3], [2.0], [3.0]),
    ):
        assert tau[0] == pytest.approx(3 * along, rel=8 * EPS)
    assert robot.forward_dynamics([0.3], [2.0], [3 * along])[0] == pytest.approx(3.0, rel=8 * EPS)


def test_numbers_near_the_largest_are_an_error_not_a_crash():
    rod = Part(link="rod", joint="spin", kind="continuous", parent=0, axis=Z, mass=1.0, com=np.array([1e200, 0, 0]))
    with np.errstate(all="ignore"):
        robot = rne.Robot(assemble("far", [Part(link="base"), rod]))
        with pytest.raises(rne.NotFiniteError, match="mass_matrix overflows float64"):
            robot.mass_matrix([0.3])
        with pytest.raises(rne.NotFiniteError, match="gravity_torque overflows float64"):
            rne.load("irb140", gravity=[0, 0, 1e308]).gravity_torque(np.zeros(6))


def test_imaginary_parts_are_not_dropped(irb140):
    cases = {
        "gravity": lambda: rne.load("irb140", gravity=[0, 0, -9.81j]),
        "rpy": lambda: irb140.mounted([1j, 0, 0]),
        "mass": lambda: irb140.with_payload(1j),
        "q0": lambda: rne.simulate(irb140, np.zeros(6) + 1j, np.zeros(6), 0.1),
        "torque": lambda: rne.simulate(irb140, np.zeros(6), np.zeros(6), 0.1, torque=np.zeros(6) + 1j),
        "duration": lambda: rne.simulate(irb140, np.zeros(6), np.zeros(6), 0.1j),
    }
    for name, call in cases.items():
        with pytest.raises(ValueError, match=f"^`{name}` must be real, got dtype complex128$"):
            call()
    with pytest.raises(ValueError, match=r"^`torque` must return real numbers, got dtype complex128 at t = 0 s$"):
        rne.simulate(irb140, np.zeros(6), np.zeros(6), 0.1, torque=lambda t, q, qd: qd * 1j)


def test_derivatives_share_shape_and_dtype(irb140):
    z = np.zeros(6)
    assert [x.shape for x in irb140.inverse_dynamics_derivatives(z, np.zeros((4, 6)), z)] == [(4, 6, 6)] * 3
    assert {x.dtype for x in irb140.inverse_dynamics_derivatives(z.astype("f4"), z, z)} == {np.dtype("f8")}
