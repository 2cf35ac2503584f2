"""Single entries in print, as in the thesis's appendix C: each is that entry, with the operations it needs."""

import ctypes
import re
import shutil
import subprocess

import numpy as np
import pytest

import rne
from rne.__main__ import main

from .helpers import kept, states
from .random_robots import straight_chain

LETTERS = {
    "mass_matrix": "m",
    "coriolis_torque": "c",
    "gravity_torque": "g",
    "bias_torque": "h",
    "inverse_dynamics": "tau",
}
LETTERS |= {"forward_dynamics": "qdd"}

SAME = 1e-13  # of the largest entry: another order of a few operations
APPENDIX_C = {
    "mass_matrix": [f"m{i}{j}" for i in range(1, 7) for j in range(1, 7)],
    "coriolis_torque": [f"c{i}" for i in range(1, 7)],
    "gravity_torque": [f"g{i}" for i in range(1, 7)],
    "inverse_dynamics": [f"tau{i}" for i in range(1, 7)],
}


@pytest.fixture(params=kept(APPENDIX_C, ["coriolis_torque", "gravity_torque", "inverse_dynamics"]))
def entries(request, irb140):
    """A kernel, the names of its entries, states, and its results there, one row of entries for each state."""
    kernel = irb140.kernel(getattr(rne.dynamics, request.param))
    arguments = states(6, 3, seed=10)[: len(kernel.names)]
    return kernel, APPENDIX_C[request.param], arguments, kernel(*arguments).reshape(3, -1)


def same(got, expected):
    assert np.shape(got) == expected.shape
    assert np.abs(np.subtract(got, expected)).max() <= SAME * np.abs(expected).max()


def evaluated(text, name, calls):
    """The values of a printed Python function."""
    space = {}
    exec(compile(text, "generated", "exec"), space)
    return [space[name](*call) for call in calls]


def test_printed_python_of_an_entry_is_that_entry(entries):
    kernel, names, arguments, expected = entries
    calls = list(zip(*arguments, strict=True))
    same(np.transpose([evaluated(kernel.source("python", name), name, calls) for name in names]), expected)


def test_printed_numpy_of_an_entry_takes_batches(entries):
    kernel, names, arguments, expected = entries
    got = [evaluated(kernel.source("numpy", name), name, [arguments])[0] for name in names]
    same(np.transpose(got), expected)


@pytest.mark.skipif(
    shutil.which("octave-cli") is None and shutil.which("octave") is None, reason="GNU Octave is not here"
)
def test_printed_matlab_of_an_entry_is_that_entry_in_octave(entries, tmp_path):
    kernel, names, arguments, expected = entries
    lines = ["1;"]
    for name in names:
        (tmp_path / f"{name}.m").write_text(kernel.source("matlab", name))
    for state in zip(*arguments, strict=True):
        call = ", ".join(f"[{' '.join(repr(float(x)) for x in a)}]" for a in state)
        lines += [f"printf('%.17g ', {name}({call}));" for name in names] + ["printf('\\n');"]
    (tmp_path / "run.m").write_text("\n".join(lines) + "\n")
    octave = shutil.which("octave-cli") or shutil.which("octave")
    run = subprocess.run([octave, "--no-gui", "--quiet", "run.m"], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    same([[float(x) for x in line.split()] for line in run.stdout.strip().splitlines()], expected)


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler here")
def test_printed_c_of_an_entry_is_that_entry(entries, tmp_path):
    kernel, names, arguments, expected = entries
    (tmp_path / "all.c").write_text("\n".join(kernel.source("c", name) for name in names))
    library = tmp_path / "all.so"
    subprocess.run(["cc", "-O1", "-Wall", "-shared", "-fPIC", "-o", library, tmp_path / "all.c", "-lm"], check=True)
    functions = ctypes.CDLL(str(library))
    pointer = ctypes.POINTER(ctypes.c_double)
    got = np.zeros(expected.shape)
    for k, state in enumerate(zip(*arguments, strict=True)):
        for j, name in enumerate(names):
            out = np.zeros(1)
            getattr(functions, name)(*(np.ascontiguousarray(x).ctypes.data_as(pointer) for x in (*state, out)))
            got[k, j] = out[0]
    same(got, expected)


def used(text):
    """Sines, cosines, arithmetic signs and changes of sign in printed Python."""
    body = text.split('row by row."""\n')[1]
    return len(re.findall(r"\b(?:sin|cos)\(| [-+*/] |-(?=[a-z(])", body))


def test_only_the_operations_that_an_entry_needs_are_printed(irb140):
    kernel = irb140.kernel(rne.dynamics.mass_matrix)
    whole = used(kernel.source("python"))
    assert whole == sum(kernel.operations.values()) == 155
    counts = {name: used(kernel.source("python", name)) for name in APPENDIX_C["mass_matrix"]}
    assert max(counts.values()) == counts["m11"] < whole
    assert counts["m66"] == 0  # a constant
    for name in ("m11", "m23", "m56"):
        assert counts[name] == sum(kernel.printed(name).trace.program.operations.values())


def test_entries_that_are_zero_or_constant_are_printed_as_such(irb140):
    assert "    return 0.0\n" in irb140.kernel(rne.dynamics.mass_matrix).source("python", "m45")
    inertia = 0.001458  # of link 6 about its axis, the only one that joint 6 moves
    assert evaluated(irb140.kernel(rne.dynamics.mass_matrix).source("python", "m66"), "m66", [[[0] * 6]]) == [
        pytest.approx(inertia)
    ]


def test_gravity_on_joint_4_in_print_is_the_formula_of_erratum_13(irb140):
    """m_6 g r sin q4 sin q5 cos(q2 + q3); cos(q2 + q3) from two products, as q2 and q3 stand in two rotations."""
    text = irb140.kernel(rne.dynamics.gravity_torque).source("python", "g4")
    q, _, _ = states(6, 20)
    expected = 9.81 * 0.029 * np.sin(q[:, 3]) * np.sin(q[:, 4]) * np.cos(q[:, 1] + q[:, 2])
    np.testing.assert_allclose(evaluated(text, "g4", [(x,) for x in q]), expected, atol=1e-15)
    assert used(text) <= 12


def test_forward_dynamics_and_bias_have_entries_too(irb140):
    q, qd, tau = states(6)
    for function, name, arguments in (
        (rne.dynamics.forward_dynamics, "qdd5", (q, qd, tau)),
        (rne.dynamics.bias_torque, "h2", (q, qd)),
    ):
        kernel = irb140.kernel(function)
        (value,) = evaluated(kernel.source("python", name), name, [arguments])
        assert value == pytest.approx(kernel(*arguments)[int(name[-1]) - 1], rel=1e-11)


def test_beyond_nine_joints_numbers_are_apart():
    kernel = rne.compile(rne.dynamics.mass_matrix, straight_chain(12))
    M, q = kernel(np.arange(12.0) / 5), np.arange(12.0) / 5
    for name, entry in (("m2_11", (1, 10)), ("m12_12", (11, 11)), ("m23", (1, 2)), ("m2_3", (1, 2))):
        assert evaluated(kernel.source("python", name), name, [(q,)]) == [pytest.approx(M[entry], rel=1e-13)]
    torque = rne.compile(rne.dynamics.gravity_torque, straight_chain(12))
    assert evaluated(torque.source("python", "g12"), "g12", [(q,)]) == [pytest.approx(torque(q)[11], rel=1e-13)]


@pytest.mark.parametrize(
    ("function", "joints", "element", "text"),
    [
        (rne.dynamics.mass_matrix, 6, "m77", "`element` of mass_matrix must be one of m11 ... m66, got 'm77'"),
        (rne.dynamics.mass_matrix, 6, "m2", "`element` of mass_matrix must be one of m11 ... m66, got 'm2'"),
        (rne.dynamics.mass_matrix, 6, "m10", "`element` of mass_matrix must be one of m11 ... m66, got 'm10'"),
        (rne.dynamics.mass_matrix, 6, "c3", "`element` of mass_matrix must be one of m11 ... m66, got 'c3'"),
        (rne.dynamics.mass_matrix, 6, (1, 2), "`element` of mass_matrix must be one of m11 ... m66, got (1, 2)"),
        (rne.dynamics.mass_matrix, 12, "m1211", "`element` of mass_matrix must be one of m1_1 ... m12_12, got 'm1211'"),
        (rne.dynamics.gravity_torque, 6, "g0", "`element` of gravity_torque must be one of g1 ... g6, got 'g0'"),
        (rne.dynamics.gravity_torque, 6, "g7", "`element` of gravity_torque must be one of g1 ... g6, got 'g7'"),
        (
            rne.dynamics.kinetic_energy,
            2,
            "t1",
            f"`element` is for {', '.join(LETTERS)}; entries of kinetic_energy have no names",
        ),
    ],
)
def test_other_entries_are_refused(function, joints, element, text):
    kernel = rne.compile(function, straight_chain(joints))
    with pytest.raises(ValueError, match="^" + re.escape(text) + "$"):
        kernel.source("python", element)


def test_entries_of_derivatives_have_no_names(irb140):
    with pytest.raises(ValueError, match=r"entries of gravity_torque_by_q have no names$"):
        irb140.kernel(rne.dynamics.gravity_torque, "q").source("c", "g2")


@pytest.mark.parametrize(("element", "quantity"), [("m23", "mass_matrix"), ("c3", "coriolis_torque"), ("qdd1", "forward_dynamics"), ("tau4", "inverse_dynamics")])  # fmt: skip
def test_letters_say_the_quantity(element, quantity, capsys):
    assert main(["source", "irb140", "--element", element, "--language", "c"]) == 0
    printed = capsys.readouterr().out
    assert printed.splitlines()[0].endswith(f" of {quantity} of robot irb140 */")
    assert f"void {element}(" in printed


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--element", "x7"], "--element must start with one of ['m', 'c', 'g', 'h', 'tau', 'qdd'], got 'x7'"),
        (["--element", "m77"], "--element of mass_matrix must be one of m11 ... m66, got 'm77'"),
        (
            ["--element", "m12", "--quantity", "gravity_torque"],
            "--element of gravity_torque must be one of g1 ... g6, got 'm12'",
        ),
    ],
)
def test_command_line_refuses_in_one_line(arguments, text, capsys):
    assert main(["source", "irb140", *arguments]) == 2
    assert capsys.readouterr() == ("", f"error: {text}\n")
