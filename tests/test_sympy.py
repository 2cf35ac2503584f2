"""Kernels as expressions of SymPy: the thesis's equations of the planar arm, and every quantity in numbers."""

import numpy as np
import pytest

import rne
from rne.elementwise import less, maximum, minimum, where

from .helpers import EPS, kept, relative, states
from .quantities import QUANTITIES
from .random_robots import random_tree
from .test_closed_forms import planar_arm

sympy = pytest.importorskip("sympy", reason="SymPy is not installed")
L1, G = sympy.Rational("0.7"), sympy.Rational("9.81")
m1, m2, lc1, lc2, I1, I2 = sympy.symbols("m1 m2 lc1 lc2 I1 I2")
q1, q2, w1, w2, a1, a2 = sympy.symbols("q_1 q_2 qd_1 qd_2 qdd_1 qdd_2")
# The thesis's parameters are masses, centres on the x axes, and moments about the centres.
THESIS = {"m_1": m1, "mx_1": m1 * lc1, "my_1": 0, "Izz_1": I1 + m1 * lc1**2}
THESIS |= {"m_2": m2, "mx_2": m2 * lc2, "my_2": 0, "Izz_2": I2 + m2 * lc2**2}


@pytest.fixture(scope="module")
def arm():
    return planar_arm(0.7, 0.3, 2.0, 0.11, 0.25, 1.3, 0.07)


def by_thesis(function, arm):
    """A quantity with the thesis's parameters."""
    return rne.compile(function, arm, parameters=True).to_sympy().subs(THESIS)


def is_zero(expression):
    return sympy.expand(expression.rewrite(sympy.exp)) == 0


def test_torques_of_the_planar_arm_are_those_of_D_17_to_D_20(arm):
    """Exactly, in symbols: (D.17) as printed; (D.18) to (D.20) with the accelerations and forces of (D.11) to (D.16)."""
    tau_1, tau_2 = by_thesis(rne.dynamics.inverse_dynamics, arm)
    assert not (tau_1 + tau_2).atoms(sympy.Float)
    x, i, k = sympy.Matrix.cross, sympy.Matrix([1, 0, 0]), sympy.Matrix([0, 0, 1])
    s1, c1, s2, c2, s12, c12 = (f(q) for q in (q1, q2, q1 + q2) for f in (sympy.sin, sympy.cos))
    printed = I2 * (a1 + a2) + m2 * L1 * lc2 * (s2 * w1**2 + c2 * a1) + m2 * lc2**2 * (a1 + a2) + m2 * lc2 * G * c12
    assert is_zero(tau_2 - printed)  # (D.17)
    R_21 = sympy.Matrix([[c2, -s2, 0], [s2, c2, 0], [0, 0, 1]])
    g1, g2 = -G * sympy.Matrix([s1, c1, 0]), -G * sympy.Matrix([s12, c12, 0])  # (D.11), (D.16)
    at_1 = sympy.Matrix([-lc1 * w1**2, lc1 * a1, 0])
    at_2 = R_21.T * L1 * sympy.Matrix([-(w1**2), a1, 0]) + lc2 * sympy.Matrix([-((w1 + w2) ** 2), a1 + a2, 0])  # (D.15)
    f2 = m2 * at_2 - m2 * g2
    f1 = R_21 * f2 + m1 * at_1 - m1 * g1  # (D.18)
    forces = R_21 * f2
    first = R_21 * (printed * k) - x(f1, lc1 * i) + x(forces, (lc1 - L1) * i) + I1 * a1 * k
    second = printed * k - x(m1 * at_1, lc1 * i) + x(m1 * g1, lc1 * i) - x(forces, L1 * i) + I1 * a1 * k
    assert is_zero(tau_1 - first[2])  # (D.19)
    assert is_zero(tau_1 - second[2])  # (D.20)


def test_equations_of_motion_are_made_of_their_parts(arm):
    M, C, g, tau = (
        by_thesis(getattr(rne.dynamics, name), arm)
        for name in ("mass_matrix", "coriolis_matrix", "gravity_torque", "inverse_dynamics")
    )
    assert [M.shape, C.shape, g.shape, tau.shape] == [(2, 2), (2, 2), (2, 1), (2, 1)]
    assert all(map(is_zero, M * sympy.Matrix([a1, a2]) + C * sympy.Matrix([w1, w2]) + g - tau))
    rate = M.diff(q1) * w1 + M.diff(q2) * w2
    assert all(map(is_zero, rate - C - C.T))  # M' - 2 C is skew-symmetric
    energy = by_thesis(rne.dynamics.potential_energy, arm)
    assert all(is_zero(energy.diff(q) - entry) for q, entry in zip((q1, q2), g, strict=True))


def in_numbers(expression, kernel, arrays):
    """Expressions at some states."""
    by_name = [f"{name}_{k + 1}" for name, width in zip(kernel.names, kernel.widths, strict=True) for k in range(width)]
    function = sympy.lambdify(sympy.symbols(by_name), list(expression), "mpmath", cse=True)
    return np.array([function(*map(float, row)) for row in np.concatenate(arrays, axis=-1)], dtype=float)


@pytest.mark.parametrize("name", kept(list(QUANTITIES), list(QUANTITIES)[::4]))
def test_every_quantity_and_its_derivatives(name, arm):
    function = QUANTITIES[name]
    q, qd, qdd = states(2, 3, seed=4)
    arrays = {"q": q, "qd": qd, "qdd": qdd, "tau": qdd, "qdr": qd[..., ::-1], "qddr": qdd}
    kernel = rne.compile(function, arm)
    given = [arrays[name] for name in kernel.names]
    growth = np.linalg.cond(rne.dynamics.mass_matrix(arm, q)).max() if "forward" in name else 1.0
    bound = 8 * 2 * EPS * growth
    values = kernel.to_sympy()
    assert getattr(values, "shape", ()) == (*kernel.traced.shape, *[1] * (len(kernel.traced.shape) == 1))
    slopes = rne.kernels.derivative(function, arm, "q")
    by_sympy = [entry.diff(q) for entry in sympy.flatten([values]) for q in (q1, q2)]
    for expression, made in ((values, kernel), (by_sympy, slopes), (slopes.to_sympy(), slopes)):
        expected = made(*given).reshape(3, -1)  # entries may cancel: of the largest in any state
        error = np.abs(in_numbers(sympy.flatten([expression]), made, given) - expected).max()
        assert error <= bound * np.abs(expected).max()


def test_wrenches_weights_and_parameters_have_names(arm):
    kernel = rne.compile(rne.dynamics.inverse_dynamics, arm, external=["lower"], parameters=True)
    names = {symbol.name for symbol in kernel.to_sympy().free_symbols}
    assert {"nz_1", "fx_1", "fy_1", "m_2", "mx_1", "my_2", "Izz_1", "qdd_2"} <= names
    work = rne.kernels.gradient(rne.dynamics.gravity_torque, arm).to_sympy()
    assert {"weights_1", "weights_2", "q_1", "q_2"} == {symbol.name for symbol in work.free_symbols}


def test_parameters_stand_where_their_names_say():
    kernel = rne.compile(rne.dynamics.inverse_dynamics, random_tree(2, 3), parameters=True)
    ten = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")  # as `Robot.parameters` has them
    names = [
        *(f"{name}_{k}" for name in ("q", "qd", "qdd") for k in (1, 2)),
        *(f"{x}_{k}" for k in (1, 2) for x in ten),
    ]
    arrays = [*states(2, 1, seed=6), rne.Robot(kernel.model).parameters[None]]
    found = sympy.lambdify(sympy.symbols(names), list(kernel.to_sympy()), cse=True)(*np.concatenate(arrays, axis=-1)[0])
    assert relative(np.array(found), kernel(*arrays)[0]) <= 8 * 2 * EPS


def test_a_wrench_is_the_moment_then_the_force_on_its_link(arm):
    kernel = rne.compile(rne.dynamics.inverse_dynamics, arm, external=["lower"])
    _, tau_2 = kernel.to_sympy()
    assert [tau_2.diff(name) for name in sympy.symbols("nz_1 fx_1 fy_1 nx_1")] == [-1, 0, 0, 0]


OPERATIONS = {
    "sqrt": lambda x, y: (x * x + y * y) ** 0.5,
    "abs": lambda x, y: abs(x) * y,
    "divide": lambda x, y: x / (2.0 + y),
    "minimum": lambda x, y: minimum(x, 3 * y)[()],
    "maximum": lambda x, y: maximum(x, 3 * y)[()],
    "where": lambda x, y: where(less(x, y), x * y, -y)[()],
    "tanh": lambda x, y: rne.elementwise.tanh(x)[()] * rne.elementwise.exp(y)[()],
    "sign": lambda x, y: rne.elementwise.sign(x)[()] * y,
    "arctan2": lambda x, y: rne.elementwise.arctan2(y, x)[()],
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_every_operation(name):
    @rne.traceable
    def function(q):
        return np.array([OPERATIONS[name](q[0], q[1]), 1 / 3 * q[0], 0.1 * 0.3 * q[1], 0.123456789012 * q[0]])

    kernel = rne.compile(function, planar_arm(0.7, 0.3, 2.0, 0.11, 0.25, 1.3, 0.07))
    points = np.array([[0.7, -1.5], [-1.2, 0.4], [0.5, 0.5], [-0.3, -0.4]])
    found = kernel.to_sympy()
    assert relative(in_numbers(found, kernel, [points]), kernel(points)) <= 8 * EPS
    assert found[1].coeff(q1) == sympy.Float(1 / 3)
    assert found[2].coeff(q2) == sympy.Rational(3, 100)  # 0.1 * 0.3 is 0.03 up to rounding
    assert found[3].coeff(q1) == sympy.Rational("0.123456789012")


def test_what_is_missing_is_said(arm, monkeypatch):
    import sys

    kernel = rne.compile(rne.dynamics.gravity_torque, arm)
    monkeypatch.setitem(sys.modules, "sympy", None)
    with pytest.raises(
        ImportError, match=r"^`to_sympy` needs SymPy, which is not installed: pip install 'rne\[sympy\]'$"
    ):
        kernel.to_sympy()
