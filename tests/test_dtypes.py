"""One text, many number types: float32, float64, long double, complex, mpmath."""

import mpmath
import numpy as np
import pytest

import rne

from .helpers import EPS, kept, loaded, relative, states
from .quantities import QUANTITIES, arguments_of


@pytest.fixture(params=QUANTITIES)
def function(request):
    return QUANTITIES[request.param]


def exact(model, function, arguments):
    """The same function on 50 digits, rounded to long double; the model's doubles are taken as exact."""
    with mpmath.workdps(50):
        numbers = [np.vectorize(mpmath.mpf, otypes=[object])(np.asarray(x, dtype=float)) for x in arguments]
        result = function(model, *numbers)
        return np.vectorize(lambda x: np.longdouble(mpmath.nstr(x, 25)), otypes=[np.longdouble])(result)


@pytest.mark.parametrize("dtype", kept([np.float32, np.float64, np.longdouble], [np.longdouble]))
def test_result_is_in_the_dtype_of_the_arguments_and_exact_to_it(function, dtype):
    model = rne.irb140().astype(dtype).astype(np.float64)  # the same rounded robot for both
    given = arguments_of(function, 6, 3, seed=1, rate=2.0, acceleration=5.0)
    arguments = [np.asarray(x, dtype=dtype) for x in given]
    got = function(rne.irb140(), *arguments)
    assert got.dtype == dtype
    solved = "forward" in function.__name__
    kappa = np.linalg.cond(rne.dynamics.mass_matrix(rne.irb140(), states(6, 3, seed=1)[0])).max() if solved else 1.0
    reference = exact(model, function, arguments)
    if got.ndim == 1:
        got, reference = got[:, None], reference[:, None]
    assert relative(got.astype(np.longdouble), reference) <= 100 * float(np.finfo(dtype).eps) * kappa


def test_integers_are_numbers(irb140):
    assert irb140.gravity_torque([0, 1, 0, 0, 0, 0]).dtype == np.float64


def test_mixed_dtypes_take_the_finer(irb140):
    q, qd, qdd = states(6)
    assert irb140.inverse_dynamics(q.astype(np.float32), qd, qdd).dtype == np.float64


def test_kernels_of_a_model_in_long_double_are_those_in_double(irb140):
    """Tracing it ended in a RecursionError."""
    q = states(6, 3)[0]
    found = rne.compile(rne.dynamics.mass_matrix, irb140.model.astype(np.longdouble))(q)
    assert relative(found, irb140.mass_matrix(q)) <= 100 * EPS


def test_complex_arguments_give_exact_derivatives(irb140):
    q, qd, _ = states(6)
    h = 1e-6
    exact_derivative = irb140.bias_torque(q + 1e-30j * qd, qd).imag / 1e-30
    difference = (irb140.bias_torque(q + h * qd, qd) - irb140.bias_torque(q - h * qd, qd)) / (2 * h)
    assert relative(difference[None], exact_derivative[None]) <= 1e-6


def test_fifty_digits_pass_through_every_layer():
    """mpmath numbers keep their precision: forward dynamics undoes inverse dynamics to 40 digits."""
    model = rne.irb140()
    with mpmath.workdps(50):
        q, qd, qdd = (np.array([mpmath.mpf(float(x)) for x in v], dtype=object) for v in states(6))
        back = rne.dynamics.forward_dynamics(model, q, qd, rne.dynamics.inverse_dynamics(model, q, qd, qdd))
        assert max(abs(a - b) for a, b in zip(back, qdd, strict=True)) < mpmath.mpf(10) ** -40


def test_not_finite_mpmath_number_is_refused():
    q = np.array([mpmath.mpf(0)] * 5 + [mpmath.mpf("nan")], dtype=object)
    with pytest.raises(ValueError, match=r"^`q` must be finite, got nan at index \(5,\)$"):
        rne.dynamics.gravity_torque(rne.irb140(), q)


def test_float64_error_is_a_few_roundings():
    """Against 50 digits, over states up to 10 rad/s."""
    model = rne.irb140()
    arguments = states(6, 20)
    error = relative(
        rne.dynamics.inverse_dynamics(model, *arguments).astype(np.longdouble),
        exact(model, rne.dynamics.inverse_dynamics, arguments),
    )
    assert error <= 40 * EPS


numbers = np.vectorize(mpmath.mpf, otypes=[object])


def orthogonality_defect(model):
    """The largest entry of R R^T - 1 over the stored rotations, in exact arithmetic."""
    products = [R @ R.T - np.eye(3, dtype=int) for R in numbers(model.rotation)]
    return np.abs(products).max()


def disagreements(model, digits):
    """Of two formulations of the torque, and of two of M: relative to the largest entry."""
    with mpmath.workdps(digits):
        q, qd, qdd = (numbers(x) for x in states(model.n))
        torques = (
            rne.dynamics.inverse_dynamics(model, q, qd, qdd),
            rne.dynamics.lagrange_inverse_dynamics(model, q, qd, qdd),
        )
        weight = rne.dynamics.gravity_torque(model, q)
        columns = [rne.dynamics.inverse_dynamics(model, q, 0 * qd, numbers(e)) - weight for e in np.eye(model.n)]
        masses = rne.dynamics.mass_matrix(model, q), np.stack(columns, axis=1)
        return [np.abs(a - b).max() / np.abs(b).max() for a, b in (torques, masses)]


@pytest.mark.parametrize(
    "name", kept(["ur_description/ur5_robot", "panda_description/panda"], ["ur_description/ur5_robot"])
)
def test_digits_beyond_those_of_the_stored_rotations_win_nothing(name):
    """The rotations are doubles, orthogonal to 2.4e-23 (UR5) and 2.0e-17 (Panda): no law holds closer than that.

    Torques by Newton-Euler and Lagrange are 3.0e-26 and 3.5e-19 apart, M and the torques of unit accelerations 7.5e-24
    and 1.2e-18, with 30 digits as with 100.
    """
    model = loaded(name).model
    with mpmath.workdps(100):
        defect = orthogonality_defect(model)
    few, many = disagreements(model, 30), disagreements(model, 100)
    for a, b in zip(few, many, strict=True):
        assert 1e-4 * defect < b < defect
        assert abs(a - b) <= 1e-3 * b


def test_with_exact_rotations_the_laws_hold_to_all_digits():
    model = rne.irb140()
    assert orthogonality_defect(model) == 0
    for digits in (30, 100):
        assert max(disagreements(model, digits)) < mpmath.mpf(10) ** (2 - digits)
