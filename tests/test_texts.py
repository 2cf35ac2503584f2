"""Short texts of values, names and numbers: where they are cut, and what is written out."""

from types import SimpleNamespace

import numpy as np
import pytest

import rne


def finding(value, message="", detail=""):
    """Text of an object with these values."""
    return repr(rne.Finding("", "", None, value, message, "", detail))


def shown(value):
    """Text of a value in that of an object."""
    text = " ".join(finding(value).split("\n  "))
    return text.removeprefix("Finding(severity='', file='', element=").removesuffix(", message='', cure='')")


def arm(*joints):
    """Text of a robot of joints with these names."""
    table = {column: [0] * len(joints) for column in ("a", "alpha", "d", "theta")}
    return repr(rne.dh_chain(**table, joint_names=joints)) if joints else repr(rne.dh_chain(**table))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ([None, "a"], "[None, 'a']"),
        (True, "True"),
        (np.False_, "False"),
        (3, "3"),
        (0.1234567, "0.123457"),
        (np.float32(0.5), "0.5"),
        (np.array(2.5), "2.5"),
        ("arm", "'arm'"),
        ([1, 2.5, -3], "[1, 2.5, -3]"),
        (tuple("abcdefgh"), "['a', 'b', 'c', 'd', 'e', ... 3 more]"),
        (np.zeros((3, 0)), "<3 x 0 numbers>"),
        (np.arange(7), "[0, 1, 2, 3, 4, 5, 6]"),
        (np.arange(8), "<8 numbers, 0 to 7>"),
        (np.ones((2, 3)), "<2 x 3 numbers, all 1>"),
        (np.zeros((0, 3)), "<0 x 3 numbers>"),
        (["a", "b"], "['a', 'b']"),
        ([[1], [2, 3]], "[[1], [2, 3]]"),
        ({"kp": [50.0], "on": False}, "{'kp': [50], 'on': False}"),
        (SimpleNamespace(head=[1]), "namespace(head=[1])"),
        (rne.load, "load"),
        (np.array([1.0] * 8 + [1.5]), "<9 numbers, 1 to 1.5>"),
    ],
)
def test_values_in_a_few_words(value, text):
    assert shown(value) == text


def test_long_values_are_cut_at_120_characters():
    names = [f"{'n' * 18}{k}" for k in range(6)]
    assert shown(names) == "[" + ", ".join(f"'{name}'" for name in names)[: 120 - 6] + " ..."
    for text, cut in (("z" * 120, "z" * 120), ("z" * 121, "z" * 117 + "...")):
        assert shown(type("Exact", (), {"__repr__": lambda self, text=text: text})()) == cut


def test_names_are_cut_at_40_characters_and_have_no_line_ends():
    text = " ".join(arm("n" * 40, "m" * 41, "a\nb").split())
    assert text.endswith(f"3 revolute: {'n' * 40}, {'m' * 37}..., a\\nb")


def test_more_than_six_names_are_counted():
    assert arm(*"abcdef").endswith("6 revolute: a, b, c, d, e, f")
    assert arm(*"abcdefg").endswith("7 revolute: a, b, c, d, e, ... 2 more")
    assert [arm(*"abc"[:n]).split("'chain': ")[1].split(", ")[0] for n in range(3)] == [
        "0 joints",
        "1 joint",
        "2 joints",
    ]


def test_lines_end_at_100_characters_and_go_on_indented():
    names = [f"{'n' * 31}{k}" for k in range(6)]
    _, first, *rest = arm(*names).split("\n")
    assert first == f"  moving joints: 6 revolute: {names[0]}, {names[1]},"  # a third name would end beyond 100
    assert rest == [f"  {names[2]}, {names[3]},", f"  {names[4]}, {names[5]}"]


def test_a_summary_leaves_out_defaults_and_does_not_break_values():
    assert finding([1.0, 2.0]) == "Finding(severity='', file='', element=[1, 2], message='', cure='')"
    assert finding(2.0, detail="x") == "Finding(severity='', file='', element=2, message='', cure='', detail='x')"
    lines = finding(["a" * 25, "b" * 25], "c" * 30).split("\n  ")
    assert lines[0] == f"Finding(severity='', file='', element=['{'a' * 25}', '{'b' * 25}'],"
    assert lines[1] == f"message='{'c' * 30}', cure='')"


def test_files_are_written_into_folders_that_exist(tmp_path, irb140):
    motion = rne.simulate(irb140, np.zeros(6), np.zeros(6), 0.01)
    assert motion.save(tmp_path / "m.NPZ") == tmp_path / "m.NPZ"
    with pytest.raises(TypeError, match=r"^`path` must be a str or path-like, got int$"):
        motion.save(3)
    with pytest.raises(ValueError, match=r"^`path` must end in \.npz, got 'm\.txt'$"):
        motion.save(tmp_path / "m.txt")
    with pytest.raises(FileNotFoundError, match=r"^`path` must be in an existing folder, got "):
        motion.save(tmp_path / "none" / "m.npz")


def test_values_longer_than_a_line_break_at_words():
    words = [f"word{k}" for k in range(30)]

    class Wordy:
        def __repr__(self):
            return " ".join(words)

    text = finding(Wordy())
    assert max(map(len, text.split("\n"))) <= 100
    assert {*shown(Wordy()).split()} - {"..."} <= {*words}
    assert shown(Wordy()).endswith(" ...")
