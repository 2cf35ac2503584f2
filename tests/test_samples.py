"""Motions through samples: splines, and CSV files with columns by joint name."""

import pickle
import re

import numpy as np
import pytest

import rne
from rne.trajectories import read_csv, spline

EDGES = np.linspace(0.0, 3.0, 301)


def wave(t):
    """q, qd and qdd of three joints, in closed form."""
    t = np.asarray(t)[..., None]
    w = np.array([0.5, 1.0, 1.5])
    return np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)


@pytest.mark.parametrize("samples", [2, 3, 4, 5, 6, 7, 20])
def test_a_polynomial_of_the_splines_degree_is_reproduced(samples):
    rng = np.random.default_rng(samples)
    degree = min(5, samples - 1)
    polynomial = np.polynomial.Polynomial(rng.uniform(-1, 1, degree + 1))
    t = np.sort(rng.uniform(0, 2, samples))
    path = spline(t, polynomial(t)[:, None])
    assert path.degree == degree
    times = np.linspace(t[0], t[-1], 50)
    for k, values in enumerate(path(times)):
        expected = polynomial.deriv(k)(times) if k else polynomial(times)
        np.testing.assert_allclose(values[:, 0], expected, rtol=0, atol=1e-6)


def test_errors_decrease_with_the_orders_that_are_stated():
    orders = []
    for quantity, order in zip(range(3), (6, 5, 4), strict=True):
        errors = []
        for samples in (31, 61):
            t = np.linspace(0, 3, samples)
            errors.append(np.abs(spline(t, wave(t)[0])(EDGES)[quantity] - wave(EDGES)[quantity]).max())
        orders.append(np.log2(errors[0] / errors[1]) - order)
    assert np.abs(orders).max() < 0.6


def test_rates_and_accelerations_are_the_derivatives_of_the_positions():
    t = np.linspace(0, 3, 13)
    path, h = spline(t, wave(t)[0]), 1e-5
    times = np.linspace(0.1, 2.9, 17)
    (qa, qda, _), (qb, qdb, _), (_, qd, qdd) = path(times - h), path(times + h), path(times)
    np.testing.assert_allclose((qb - qa) / (2 * h), qd, rtol=0, atol=1e-8)
    np.testing.assert_allclose((qdb - qda) / (2 * h), qdd, rtol=0, atol=1e-7)


def test_shapes_are_those_of_the_other_references():
    t = np.linspace(0, 3, 8)
    path = spline(t, wave(t)[0])
    assert [x.shape for x in path(1.0)] == [(3,)] * 3
    assert [x.shape for x in path([0.1, 0.2, 0.3])] == [(3, 3)] * 3
    assert [x.shape for x in path(np.full((4, 1), 0.5))] == [(4, 3)] * 3
    np.testing.assert_array_equal(path([0.1, 0.7])[1][1], path(0.7)[1])
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(path))(0.3)[2], path(0.3)[2])


def test_computed_torque_follows_a_spline(irb140):
    """From the start on it the error stays that of the solver; the law is traced."""
    t = np.linspace(0, 1, 41)
    path = spline(t, np.outer(np.sin(t), np.linspace(0.2, 1.0, 6)))
    law = rne.control.computed_torque(irb140, [100] * 6, [20] * 6, path)
    scene = rne.Scene(irb140, controller=law)
    q, qd, _ = path(0.0)
    motion = rne.simulate(scene, q, qd, 1.0)
    assert np.abs(motion.q - path(motion.t)[0]).max() < 1e-7
    assert scene.is_traced


def test_outside_the_samples_nothing_is_invented():
    path = spline([1.0, 2.0, 3.0], np.zeros((3, 1)))
    for t in (0.999, 3.001, [1.5, 3.5]):
        with pytest.raises(ValueError, match=r"^`t` must be within the samples, 1 to 3 s, got (0.999|3.001|3.5)$"):
            path(t)
    path(np.nextafter(3.0, 4.0))  # rounding of a solver's last stage
    with pytest.raises(ValueError, match="must be within the samples"):
        path(3.0 + 1e-9)


SPLINE_ERRORS = {
    "one sample": (([0.0], [[1.0]]), "`t` must have shape (K,) with two times at least, got (1,)"),
    "times in rows": (([[0.0, 1.0]], [[1.0]]), "`t` must have shape (K,) with two times at least, got (1, 2)"),
    "rows missing": (([0.0, 1.0], [[1.0]]), "`q` must have shape (2, n), a row for each time, got (1, 1)"),
    "one joint without axis": (([0.0, 1.0], [1.0, 2.0]), "`q` must have shape (2, n), a row for each time, got (2,)"),
    "backwards": (([0.0, 2.0, 1.0], np.zeros((3, 1))), "`t` must ascend, got 1 after 2 at index 2"),
    "repeated": (([0.0, 1.0, 1.0], np.zeros((3, 1))), "`t` must ascend, got 1 after 1 at index 2"),
    "nan": (([0.0, 1.0], [[0.0], [np.nan]]), "`q` must be finite, got nan at index (1, 0)"),
    "uneven": (
        ([0, 0.3, 0.5, 0.5 + 1e-13, 0.7, 0.8, 0.9], np.arange(7.0)[:, None]),
        "`t` is spaced too unevenly for a spline through the samples: intervals from 1e-13 to 0.3 s; "
        "sample the motion at equal intervals",
    ),
}


@pytest.mark.parametrize("case", SPLINE_ERRORS)
def test_samples_without_a_spline_are_refused(case):
    (t, q), message = SPLINE_ERRORS[case]
    with pytest.raises(ValueError, match="^" + re.escape(message) + "$"):
        spline(t, q)


JOINTS = ("lift", "turn")


@pytest.fixture
def write(tmp_path):
    def write(content):
        path = tmp_path / "motion.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def test_columns_are_found_by_name_in_any_order(write):
    path = write("qd.turn,comment,q.lift,t, q.turn ,qd.lift\n4,x,1,0,2,3\n\n8,,5,0.5,6,7\n")
    samples = read_csv(path, JOINTS)
    assert samples.t.tolist() == [0.0, 0.5]
    assert samples.q.tolist() == [[1, 2], [5, 6]]
    assert samples.qd.tolist() == [[3, 4], [7, 8]]
    assert samples.qdd is None
    assert samples.tau is None


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16-le", "utf-16-be"])
def test_marks_of_windows_do_no_harm(encoding, write):
    path = write('\ufefft,"q.lift",q.turn\r\n0,"1",2\r\n'.encode(encoding))
    assert read_csv(path, JOINTS).q.tolist() == [[1.0, 2.0]]


@pytest.mark.parametrize("comment", ["", "arm of 2026\nsampled at 2 Hz\n"])
def test_a_heading_that_numpy_writes_as_a_comment_is_read(comment, tmp_path):
    table = np.array([[0.0, 1.0, 0.1], [0.5, 1.5, 0.2]])
    np.savetxt(tmp_path / "m.csv", table, delimiter=",", header=f"{comment}t, q.turn, q.lift")
    samples = read_csv(tmp_path / "m.csv", JOINTS)
    np.testing.assert_array_equal(np.column_stack([samples.t, samples.q]), table[:, [0, 2, 1]])


def test_rows_are_counted_from_the_first_comment(tmp_path):
    (tmp_path / "m.csv").write_text("# two\n# t,q.lift\n0,1\n")
    with pytest.raises(ValueError, match=r"m.csv, row 2: no column 'q.turn'"):
        read_csv(tmp_path / "m.csv", JOINTS)


def test_a_motion_is_read_back_to_the_last_bit(irb140, tmp_path):
    motion = rne.simulate(irb140, [0.1] * 6, [0] * 6, 0.2)
    motion.to_csv(tmp_path / "motion.csv")
    samples = read_csv(tmp_path / "motion.csv", irb140.joint_names)
    for name in ("t", "q", "qd", "qdd", "tau"):
        np.testing.assert_array_equal(getattr(samples, name), getattr(motion, name))


CSV_ERRORS = {
    "empty": ("", ": the file is empty"),
    "blank": ("\n \n", ": the file is empty"),
    "picture": (b"\x89PNG\r\n\x1a\n\x00\xff", ": is not a text file in UTF-8; a CSV file is needed"),
    "archive": (b"PK\x03\x04\x14\x00", ": is not a text file in UTF-8; a CSV file is needed"),
    "heading alone": ("t,q.lift,q.turn\n", ": there are no rows below the names of the columns"),
    "no time": ("q.lift,q.turn\n1,2\n", ", row 1: there is no column 't'; there are 'q.lift', 'q.turn'"),
    "semicolons": ("t;q.lift;q.turn\n1;2;3\n", ", row 1: there is no column 't'; there are 't;q.lift;q.turn'; separate columns by commas; rne.identification.Record.from_log reads others too, of logs that have torques or commands"),
    "other joints": (
        "t,q.1,q.2,x\n0,1,2,3\n",
        ", row 1: there are 'q.1', 'q.2', but no column of a joint here, such as 'q.lift'",
    ),
    "joint missing": ("t,q.lift\n0,1\n", ", row 1: no column 'q.turn'; the q of all joints or of none are needed"),
    "rate missing": (
        "t,q.lift,q.turn,qd.turn\n0,1,2,3\n",
        ", row 1: no column 'qd.lift'; the qd of all joints or of none are needed",
    ),
    "column twice": ("t,q.lift,q.lift,q.turn\n0,1,2,3\n", ", row 1: column 'q.lift' is there twice"),
    "other column twice, short row": ("t,x,x,q.lift,q.turn\n0,1,2,3,4\n1,2,3,4\n", ", row 3: must have 5 entries as the heading has, got 4"),
    "short row": ("t,q.lift,q.turn\n0,1,2\n1,2\n", ", row 3: must have 3 entries as the heading has, got 2"),
    "no heading": (
        "0.000e+00,0.000e+00,1.0\n0.5,0.1,1.5\n",
        ", row 1: the names of the columns are missing; above the numbers is needed, for example, 't,q.lift,q.turn'",
    ),
    "no number": ("t,q.lift,q.turn\n0,1,2\n1,up,2\n", ", row 3, column 'q.lift': must be a finite number, got 'up'"),
    "nothing": ("t,q.lift,q.turn\n0,1,\n", ", row 2, column 'q.turn': must be a finite number, got ''"),
    "nan": ("t,q.lift,q.turn\n0,1,nan\n", ", row 2, column 'q.turn': must be a finite number, got 'nan'"),
    "infinite": ("t,q.lift,q.turn\n0,1,1e999\n", ", row 2, column 'q.turn': must be a finite number, got '1e999'"),
    "other digits": ("t,q.lift,q.turn\n0,1,1_0\n", ", row 2, column 'q.turn': must be a finite number, got '1_0'"),
    "repeated time": ("t,q.lift,q.turn\n0,1,2\n\n0,1,2\n", ", row 4, column 't': times must ascend, got 0 after 0"),
    "descending time": ("t,q.lift,q.turn\n0,1,2\n-1,1,2\n", ", row 3, column 't': times must ascend, got -1 after 0"),
    "open quote": ('t,q.lift,q.turn\n0,"1,2\n', ", row 2: is not CSV (unexpected end of data)"),
}  # fmt: skip


@pytest.mark.parametrize("case", CSV_ERRORS)
def test_a_wrong_file_is_an_error_that_names_row_and_column(case, write):
    content, message = CSV_ERRORS[case]
    path = write(content)
    with pytest.raises(ValueError, match="^" + re.escape(f"{path}{message}") + "$"):
        read_csv(path, JOINTS)


def test_long_names_and_values_are_cut_and_many_counted(write):
    name = "n" * 38  # q.nnn... has 40 characters
    with pytest.raises(ValueError, match=rf"no column 'q.{name}'; the q"):
        read_csv(write("t,q.a\n0,1\n"), ["a", name])
    with pytest.raises(ValueError, match=rf"no column 'q.{name[:35]}\.\.\.'; the q"):
        read_csv(write("t,q.a\n0,1\n"), ["a", name + "n"])
    with pytest.raises(ValueError, match=r"there are 'a', 'b', 'c', 'd'$"):
        read_csv(write("a,b,c,d\n0,1,2,3\n"), [])
    with pytest.raises(ValueError, match=r"there are 'a', 'b', 'c', 'd' and 2 more$"):
        read_csv(write("a,b,c,d,e,f\n0,1,2,3,4,5\n"), [])
    for value, shown in (("x" * 40, repr("x" * 40)), ("x" * 41, repr("x" * 37 + "..."))):
        with pytest.raises(ValueError, match=rf"must be a finite number, got {re.escape(shown)}$"):
            read_csv(write(f"t,q.a\n0,{value}\n"), ["a"])


def test_a_file_that_is_not_there_is_an_error_of_the_system(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_csv(tmp_path / "none.csv", JOINTS)
    with pytest.raises(IsADirectoryError):
        read_csv(tmp_path, JOINTS)


def test_joints_with_control_characters_are_found_by_their_escapes(tmp_path):
    """As robots read from files call them."""
    (tmp_path / "m.csv").write_text("t,q.a\x9b\n0,1\n1,2\n", encoding="utf-8")
    for name in ("a\x9b", r"a\x9b"):
        assert rne.trajectories.read_csv(tmp_path / "m.csv", [name]).q.tolist() == [[1], [2]]
