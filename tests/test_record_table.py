"""The student's view in print: units, equation numbers, digits and columns."""

import re
from dataclasses import replace

import mpmath
import numpy as np
import pytest

import rne

from .helpers import states
from .random_robots import straight_chain

POINT = re.compile(r"-?\d+(\.\d+)?(e-?\d+)?")


def block(text, joint):
    """The lines of one joint, without its name."""
    lines = text.splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith(f"{joint},")) + 1
    rest = [k for k, line in enumerate(lines[start:], start) if not line.startswith(" ")]
    return lines[start : rest[0] if rest else None]


def test_every_row_has_its_equation_number_and_unit(irb140):
    rows = block(str(irb140.recursion(*states(6))), "joint_2")
    assert [row[:24].rstrip() for row in rows] == [
        "  omega   (3.29) rad/s",
        "  alpha   (3.33) rad/s^2",
        "  a_c     (3.37) m/s^2",
        "  a_e     (3.38) m/s^2",
        "  gravity (5.33) m/s^2",
        "  f       (3.24) N",
        "  tau     (3.27) N m",
        "  u       §5.3   N m",
    ]


def test_numbers_are_those_of_the_record(irb140):
    record = irb140.recursion(*states(6))
    text = str(record)
    for i, joint in enumerate(record.joints):
        rows = {row.split()[0]: [float(x) for x in row[24:].split()] for row in block(text, joint)}
        for name in ("omega", "alpha", "a_c", "a_e", "gravity", "f", "tau"):
            np.testing.assert_allclose(rows[name], getattr(record, name)[i], rtol=5e-6, err_msg=f"{name} {joint}")
        np.testing.assert_allclose(rows["u"], [record.u[i]], rtol=5e-6)


def test_holding_torque_is_printed_as_such(irb140):
    text = str(irb140.recursion([0, np.pi / 2, -np.pi / 2, 0, 0, 0], np.zeros(6), np.zeros(6)))
    assert block(text, "joint_2")[-1].split() == ["u", "§5.3", "N", "m", "-158.834"]


def test_decimal_points_stand_below_each_other(irb140):
    lines = str(irb140.recursion(*states(6))).splitlines()
    ends = []
    for line in lines:
        if line.startswith("  ") and line.split()[0] in ("omega", "alpha", "a_c", "f", "tau"):
            numbers = [m for m in POINT.finditer(line) if m.start() >= 24]
            ends.append([m.start() + len(re.match(r"-?\d+", m.group()).group()) for m in numbers])
    assert len(ends) == 30
    assert all(end == ends[0] for end in ends)


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (-1e-300, "-1e-300"),
        (735.75, "735.75"),
        (9.81, "9.81"),
        (-123456.7, "-123457"),
        (999999.7, "1e6"),
        (1234567.0, "1.23457e6"),
        (0.000123456789, "0.000123457"),
        (1.23456e-6, "1.23456e-6"),
        (2.5e-5, "0.000025"),
        (2.5e-6, "2.5e-6"),
        (mpmath.mpf("2.5e-6"), "2.5e-6"),
        (100, "100"),
        (np.float32(0.1), "0.1"),
        (np.longdouble("1.5e-4000"), "1.5e-4000"),
        (mpmath.mpf("-0.0"), "0"),
        (mpmath.mpf("2.5"), "2.5"),
        (mpmath.mpf("-1e-5000"), "-1e-5000"),
    ],
)
def test_numbers_have_six_digits(irb140, number, text):
    kind = object if isinstance(number, mpmath.mpf) else np.asarray(number).dtype
    assert [row.split()[3:] for row in printed(irb140, np.full((6, 3), number, kind))] == [[text] * 3] * 6


def printed(irb140, omega):
    """Rows of omega in the table of a record with these numbers."""
    record = replace(irb140.recursion(*states(6)), omega=omega)
    return [line for line in str(record).splitlines() if line.startswith("  omega")]


def test_columns_align_at_the_point_and_exponents_need_none(irb140):
    omega = np.zeros((6, 3))
    omega[0], omega[1] = [1.5, -10, 0], [-20.25, 1e-7, 0]
    first, second, third, *_ = printed(irb140, omega)
    assert first.index("1.5") == second.index("-20.25") + 2
    assert first.index("-10") + 2 == second.index("1e-7") == third.rindex("0", 0, second.index("1e-7") + 1)


@pytest.mark.parametrize("scale", [1e-300, 1e-9, 1.0, 1e9])
def test_table_is_at_most_100_columns_wide(tree, scale):
    q, qd, qdd = states(tree.n, 4)
    for line in str(rne.dynamics.recursion(tree, q, scale * qd, scale * qdd)).splitlines():
        assert len(line) <= 100


def test_last_link_has_a_row_a_e_only_with_a_tip():
    text = str(rne.dynamics.recursion(straight_chain(2), *states(2)))
    assert "a_e" in " ".join(block(text, "joint0"))
    assert "a_e" not in " ".join(block(text, "joint1"))


def test_branched_robot_shows_its_origins_instead_of_ends():
    from .conftest import TREES

    model = TREES["bushy"]
    text = str(rne.dynamics.recursion(model, *states(model.n)))
    assert "a_o, the origin's acceleration, stands for a_e" in text
    for joint in model.moving_joints:
        names = [row.split()[0] for row in block(text, joint)]
        assert "a_o" in names
        assert "a_e" not in names


def test_sliders_drive_is_in_newton_and_a_mimic_has_none():
    from .conftest import TREES

    model = TREES["mimics"]
    text = str(rne.dynamics.recursion(model, *states(model.n)))
    for i, joint in enumerate(model.moving_joints):
        rows = [row for row in block(text, joint) if row.split()[0] == "u"]
        assert len(rows) == (i in model.independent_joints)
        assert f"{joint}, {model.joint_types[i]}{'' if rows else ', mimic'}" in text
        for row in rows:
            assert row[17:24].rstrip() == ("N" if model.joint_types[i] == "prismatic" else "N m")


def test_batch_prints_its_first_state_and_says_how_to_pick_another(irb140):
    q, qd, qdd = states(6, 4)
    batch, first = irb140.recursion(q, qd, qdd), irb140.recursion(q[0], qd[0], qdd[0])
    head, body = str(batch).split("\n", 1)
    assert head == "The first of 4 states, leading shape (4,); record.state(3) is the last."
    assert body == str(first)


def test_batch_of_two_axes_is_picked_by_a_tuple(irb140):
    q = np.zeros((2, 3, 6))
    head = str(irb140.recursion(q, q, q)).splitlines()[0]
    assert head == "The first of 6 states, leading shape (2, 3); record.state((1, 2)) is the last."


def test_empty_batch_and_no_joints_say_so(irb140):
    q = np.zeros((0, 6))
    assert str(irb140.recursion(q, q, q)) == "Recursion of no states: leading shape (0,)"
    none = rne.dynamics.recursion(rne.dh_chain(a=[], alpha=[], d=[], theta=[]), [], [], [])
    assert str(none) == "Recursion of a robot without moving joints"


def test_state_is_the_record_of_that_state(irb140):
    q, qd, qdd = (x.reshape(2, 3, 6) for x in states(6, 6))
    record = irb140.recursion(q, qd, qdd)
    assert record.batch == (2, 3)
    one, alone = record.state((1, -1)), irb140.recursion(q[1, 2], qd[1, 2], qdd[1, 2])
    assert one.batch == ()
    assert one.joints == alone.joints
    for name in ("omega", "alpha", "a_o", "a_c", "a_e", "gravity", "f", "tau", "u"):
        np.testing.assert_allclose(getattr(one, name), getattr(alone, name), atol=1e-12)


@pytest.mark.parametrize(
    ("shape", "index", "error", "text"),
    [
        ((4,), 4, IndexError, "`index` must be one of leading shape (4,), got 4"),
        ((4,), (0, 0), IndexError, "`index` must be one of leading shape (4,), got (0, 0)"),
        ((2, 3), 1, IndexError, "`index` must be one of leading shape (2, 3), got 1"),
        ((), 0, IndexError, "`index` must be (), as this is a single state, got 0"),
        ((4,), slice(2), TypeError, "`index` must be an int or a tuple of int, got slice(None, 2, None)"),
        ((4,), 1.0, TypeError, "`index` must be an int or a tuple of int, got 1.0"),
    ],
)
def test_wrong_index_is_refused(irb140, shape, index, error, text):
    q = np.zeros((*shape, 6))
    with pytest.raises(error) as caught:
        irb140.recursion(q, q, q).state(index)
    assert str(caught.value) == text


@pytest.mark.parametrize("dtype", [np.float32, np.longdouble])
def test_other_precisions_print_alike(irb140, dtype):
    q = np.zeros(6)
    plain = str(irb140.recursion(q, q, q))
    assert str(irb140.recursion(*[q.astype(dtype)] * 3)) == plain


def test_mpmath_numbers_print_as_floats_do(irb140):
    motion = states(6)
    numbers = [np.vectorize(mpmath.mpf, otypes=[object])(x) for x in motion]

    def printed(motion):
        rows = [row[24:].split() for row in block(str(irb140.recursion(*motion)), "joint_1")]
        return [[float(x) for x in row] for row in rows]

    for a, b in zip(printed(numbers), printed(motion), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("number", [complex, mpmath.mpc])
def test_complex_numbers_have_a_line_for_their_imaginary_part(irb140, number):
    q = np.array([number(0, 0), number(0.5, 0.25)] + [number(0, 0)] * 4)
    record = irb140.recursion(q, 0 * q, 0 * q)
    rows = block(str(record), "joint_2")
    at = next(k for k, row in enumerate(rows) if row.split()[0] == "f")
    assert rows[at + 1][:24] == "          imag   N      "
    f = [complex(x) for x in record.f[1]]
    np.testing.assert_allclose([float(x) for x in rows[at][24:].split()], np.real(f), rtol=1e-5)
    np.testing.assert_allclose([float(x) for x in rows[at + 1][24:].split()], np.imag(f), rtol=1e-5)


def test_names_are_cut_and_stay_on_one_line():
    arm = rne.dh_chain(a=[0, 0], alpha=[0, 0], d=[0, 0], theta=[0, 0], joint_names=["a\nb", "x" * 50])
    heads = [line for line in str(rne.dynamics.recursion(arm, *states(2))).splitlines() if ", revolute" in line]
    assert heads == ["a\\nb, revolute", f"{'x' * 37}..., revolute"]
