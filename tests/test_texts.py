"""Short texts of values, names and numbers: where they are cut, and what is written out."""

from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np
import pytest

from rne.basics.arrays import output_file
from rne.basics.text import Row, aligned, brief, brief_array, counted, listed, short, six_digits, summary, wrapped


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "None"),
        (True, "True"),
        (np.False_, "False"),
        (3, "3"),
        (0.1234567, "0.123457"),
        (np.float32(0.5), "0.5"),
        (np.array(2.5), "2.5"),
        ("arm", "'arm'"),
        ([1, 2.5, -3], "[1, 2.5, -3]"),
        (np.arange(7), "[0, 1, 2, 3, 4, 5, 6]"),
        (np.arange(8), "<8 numbers, 0 to 7>"),
        (np.ones((2, 3)), "<2 x 3 numbers, all 1>"),
        (np.zeros((0, 3)), "<0 x 3 numbers>"),
        (["a", "b"], "['a', 'b']"),
        ([[1], [2, 3]], "[[1], [2, 3]]"),
        ({"kp": [50.0], "on": False}, "{'kp': [50], 'on': False}"),
        (Row("head", ["1"]), "Row(head='head', cells=['1'], words=False)"),
        (counted, "counted"),
    ],
)
def test_values_in_a_few_words(value, text):
    assert brief(value) == text


def test_long_values_are_cut_at_120_characters():
    names = [f"{'n' * 18}{k}" for k in range(6)]
    assert brief(names) == "[" + ", ".join(f"'{name}'" for name in names)[: 120 - 6] + " ..."
    exact = type("Exact", (), {"__repr__": lambda self: "z" * 120})()
    assert brief(exact) == "z" * 120


def test_names_are_cut_at_40_characters_and_have_no_line_ends():
    assert short("n" * 40) == "n" * 40
    assert short("n" * 41) == "n" * 37 + "..."
    assert short("a\nb") == "a\\nb"


def test_more_than_six_names_are_counted():
    assert listed("abcdef") == "a, b, c, d, e, f"
    assert listed("abcdefg") == "a, b, c, d, e, ... 2 more"
    assert (counted(0, "joint"), counted(1, "joint"), counted(2, "joint")) == ("0 joints", "1 joint", "2 joints")


def test_lines_end_at_100_characters_and_go_on_indented():
    words = " ".join(["word"] * 40)  # of 199 characters
    first, *rest = wrapped(words).split("\n")
    assert len(first) == 99  # twenty words
    assert all(line.startswith("  word") for line in rest)
    assert wrapped("a\nb") == "a\nb"


@dataclass
class Thing:
    gains: Any
    name: Any = None
    step: float = 1.0
    other: Any = None


def test_a_summary_leaves_out_defaults_and_does_not_break_values():
    assert summary(Thing([1.0, 2.0])) == "Thing(gains=[1, 2])"
    assert summary(Thing([1.0, 2.0], step=2.0), other="x") == "Thing(gains=[1, 2], step=2, other='x')"
    lines = summary(Thing(["a" * 30, "b" * 30], name="c" * 30)).split("\n")
    assert [line.strip() for line in lines] == [f"Thing(gains=['{'a' * 30}', '{'b' * 30}'],", f"name='{'c' * 30}')"]


def test_an_array_of_equal_numbers_says_so():
    assert brief_array(np.full(9, 2.0)) == "<9 numbers, all 2>"
    assert brief_array(np.array([1.0] * 8 + [1.5])) == "<9 numbers, 1 to 1.5>"


def test_titles_end_where_their_columns_do():
    rows = [Row("", ["q", "torque"], words=True), Row("a", ["1.25", "-7"]), Row("joint", ["-10", "0.5"])]
    assert aligned(rows) == ["            q  torque", "a        1.25    -7", "joint  -10        0.5"]


def test_files_are_written_into_folders_that_exist(tmp_path):
    assert output_file(str(tmp_path / "m.HTML"), ".html", ".htm") == tmp_path / "m.HTML"
    assert output_file(tmp_path / "m.any") == tmp_path / "m.any"
    with pytest.raises(TypeError, match=r"^`path` must be a str or path-like, got int$"):
        output_file(3)
    with pytest.raises(ValueError, match=r"^`path` must end in \.html, got 'm\.txt'$"):
        output_file(tmp_path / "m.txt", ".html", ".htm")
    with pytest.raises(FileNotFoundError, match=r"^`path` must be in an existing folder, got "):
        output_file(tmp_path / "none" / "m.html")


@pytest.mark.parametrize(
    ("number", "text"),
    [(2.5e-5, "0.000025"), (2.5e-6, "2.5e-6"), (123456.7, "123457"), (1234567.0, "1.23457e6"), (-0.0, "0")],
)
def test_six_digits_with_an_exponent_from_a_millionth_and_a_million_on(number, text):
    assert six_digits(number) == six_digits(np.float64(number)) == six_digits(mpmath.mpf(number)) == text


def test_values_longer_than_a_line_break_at_words():
    words = [f"word{k}" for k in range(30)]

    class Wordy:
        def __repr__(self):
            return " ".join(words)

    shown = summary(Thing(Wordy()))
    assert max(map(len, shown.split("\n"))) <= 100
    assert {word.rstrip(")") for word in shown.split()} - {"...", "Thing(gains=word0"} <= set(words)
    assert shown.endswith(" ...)")
