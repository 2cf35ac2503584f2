"""Generated source text computes what the kernel computes, in every language."""

import ctypes
import functools
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import rne
from rne.__main__ import main
from rne.graph.graph import Graph
from rne.graph.program import lower
from rne.graph.scalar import inputs, references
from rne.kernels.soundness import Trace
from rne.kernels.source import Printable, to_source

from .compiled_sources import ARMS, TREES, c_library, call, check_all, kernels, model_of, rust_library
from .helpers import kept, states
from .random_robots import random_tree, straight_chain

SAME = 1e-13  # of the largest entry: another order of a few operations
LANGUAGES = ("python", "numpy", "matlab", "c", "c++", "rust")
NAMES = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "kinetic_energy")


@pytest.fixture(params=[*NAMES, "inverse_dynamics under wrenches"])
def kernel(request, irb140):
    name, *wrenches = request.param.split(" ", 1)
    return irb140.kernel(getattr(rne.dynamics, name), **({"external": ["tool0", "link_3"]} if wrenches else {}))


def values(kernel, seed=0):
    wrenches = np.random.default_rng(seed).normal(size=(len(kernel.quantity.wrenches), 3, 6))
    return *states(6, 3, seed=seed)[: len(kernel.names) - len(wrenches)], *wrenches


def same(got, kernel, arguments):
    expected = kernel(*arguments)
    got = np.reshape(got, expected.shape)
    assert np.abs(got - expected).max() <= SAME * max(np.abs(expected).max(), 1e-300)


def namespace(source):
    space = {}
    exec(compile(source, "generated", "exec"), space)
    return space


def test_printed_python_is_the_kernel(kernel):
    function = namespace(kernel.source("python"))[kernel.quantity.name]
    arguments = values(kernel)
    same([function(*(a[k] for a in arguments)) for k in range(3)], kernel, arguments)


def test_numpy_source_broadcasts_in_its_dtype():
    kernel = rne.compile(rne.dynamics.inverse_dynamics, rne.irb140())
    function = namespace(kernel.source("numpy"))["inverse_dynamics"]
    q, qd, qdd = states(6, 5)
    assert np.abs(function(q, qd[0], qdd) - kernel(q, qd[0], qdd)).max() <= 1e-13 * 100
    assert function(*(a.astype(np.float32) for a in (q, qd, qdd))).dtype == np.float32


def test_printed_numpy_is_the_kernel(kernel):
    function = namespace(kernel.source("numpy"))[kernel.quantity.name]
    arguments = values(kernel)
    same(function(*arguments), kernel, arguments)


def test_derivatives_are_printed_too(irb140):
    kernel = irb140.kernel(rne.dynamics.gravity_torque, "q")
    function = namespace(kernel.source("python"))["gravity_torque_by_q"]
    same([function(q) for q in values(kernel)[0]], kernel, values(kernel))


@pytest.mark.skipif(
    shutil.which("octave-cli") is None and shutil.which("octave") is None, reason="GNU Octave is not here"
)
def test_printed_matlab_is_the_kernel_in_octave(kernel, tmp_path):
    octave = shutil.which("octave-cli") or shutil.which("octave")
    name, arguments = kernel.quantity.name, values(kernel)
    (tmp_path / f"{name}.m").write_text(kernel.source("matlab"))
    calls = [f"[{' '.join(repr(float(x)) for x in a[k])}]" for k in range(3) for a in arguments]
    count = len(arguments)
    lines = [
        f"r = {name}({', '.join(calls[k * count : (k + 1) * count])})'; printf('%.17g ', r(:)); printf('\\n');"
        for k in range(3)
    ]
    (tmp_path / "run.m").write_text("\n".join(["1;", *lines]) + "\n")
    run = subprocess.run(
        [octave, "--no-gui", "--quiet", "run.m"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    same([[float(x) for x in line.split()] for line in run.stdout.strip().splitlines()], kernel, arguments)


WITH_CC = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler here")


@WITH_CC
def test_printed_c_is_the_kernel(kernel, tmp_path):
    library = c_library([kernel.source("c")], tmp_path)
    arguments = values(kernel)
    same(call(library[kernel.quantity.name], arguments, kernel.traced.entries, "float64"), kernel, arguments)


@WITH_CC
@pytest.mark.parametrize("name", kept([*TREES, *ARMS], ["pair"]))
def test_every_quantity_and_its_derivatives_in_c(name, tmp_path):
    model = model_of(name)
    made = kernels(model)
    for dtype in ("float64", "float32"):
        (folder := tmp_path / dtype).mkdir()
        library = c_library([kernel.source("c", dtype=dtype) for kernel in made], folder)
        check_all(model, made, library.__getitem__, dtype)


@WITH_CC
def test_gradients_and_hessians_in_c(tmp_path):
    model = random_tree(**TREES["pair"])
    makers = rne.kernels.gradient, rne.kernels.hessian, rne.kernels.hessian_product
    made = [make(rne.dynamics.gravity_torque, model) for make in makers]
    names = [f"{title}_of_gravity_torque_by_q" for title in ("gradient", "Hessian", "Hessian_times_a_vector")]
    library = c_library([kernel.source("c") for kernel in made], tmp_path)
    arrays = np.random.default_rng(5).uniform(-1, 1, (3, 4, model.n))
    for kernel, name in zip(made, names, strict=True):
        given = arrays[: len(kernel.names)]
        same(call(library[name], given, kernel.traced.entries, "float64"), kernel, given)


@pytest.fixture(scope="module")
def every_operation():
    """A program that takes each operation once, its source in a language, and its results by NumPy."""
    graph = Graph()
    x, y = inputs(graph, (2,), 0)
    parts = [x + y, x - y, x * y, x / y, -x, x.sin(), x.cos(), abs(x).sqrt(), x.tanh(), x.exp(), x.arctan2(y), x.sign()]
    parts += [x.minimum(y), x.maximum(y), (x < y).where(x, 2.0), (x <= y).where(1.0, y), x < y, x <= y, 0 * x]
    outputs = np.empty(len(parts), dtype=object)
    outputs[:] = parts
    program = lower(graph, references(graph, outputs), 2)

    def printed(language, dtype="float64"):
        traced = Trace(program, (2,), (len(parts),))
        return to_source(Printable(traced, "every", ("a",), ["all"], namespace="robot"), language, dtype)

    points = np.array([[0.7, -1.5], [-1.5, 0.7], [2.0, 2.0], [-0.3, -0.4]])
    x, y = points.T
    expected = [x + y, x - y, x * y, x / y, -x, np.sin(x), np.cos(x), np.sqrt(abs(x)), np.tanh(x), np.exp(x)]
    expected += [np.arctan2(x, y), np.sign(x), np.minimum(x, y), np.maximum(x, y), np.where(x < y, x, 2.0)]
    expected += [np.where(x <= y, 1.0, y), x < y, x <= y, 0 * x]
    return printed, points, np.stack(np.broadcast_arrays(*expected), axis=1).astype(float)


class TestEveryOperation:
    def test_in_python(self, every_operation):
        printed, points, expected = every_operation
        function = namespace(printed("python"))["every"]
        np.testing.assert_allclose([function(point) for point in points], expected, rtol=SAME)

    def test_in_numpy(self, every_operation):
        printed, points, expected = every_operation
        np.testing.assert_allclose(namespace(printed("numpy"))["every"](points), expected, rtol=SAME)

    @WITH_CC
    @pytest.mark.parametrize("dtype", ["float64", "float32"])
    def test_in_c(self, every_operation, dtype, tmp_path):
        printed, points, expected = every_operation
        library = c_library([printed("c", dtype)], tmp_path)
        got = call(library.every, [points], expected.shape[1], dtype)
        np.testing.assert_allclose(got, expected.astype(dtype), rtol=8 * np.finfo(dtype).eps)

    @pytest.mark.long  # test_in_c has the same operations
    @pytest.mark.skipif(shutil.which("g++") is None, reason="there is no g++ here")
    @pytest.mark.parametrize("dtype", ["float64", "float32"])
    def test_in_cpp(self, every_operation, dtype, tmp_path):
        printed, points, expected = every_operation
        real, count = {"float64": "double", "float32": "float"}[dtype], expected.shape[1]
        body = (
            f"std::array<{real}, {count}> y = robot::every({{{{x[0], x[1]}}}}); std::copy(y.begin(), y.end(), result);"
        )
        (tmp_path / "every.hpp").write_text(printed("c++", dtype))
        text = f'extern "C" void every(const {real}* x, {real}* result) {{ {body} }}'
        (tmp_path / "every.cpp").write_text(f'#include <algorithm>\n#include "every.hpp"\n{text}\n')
        warnings = "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Wdouble-promotion", "-Werror"
        command = ["g++", "-std=c++17", *warnings, "-shared", "-fPIC", "-o", "every.so", "every.cpp"]
        subprocess.run(command, cwd=tmp_path, check=True)
        got = call(ctypes.CDLL(str(tmp_path / "every.so")).every, [points], count, dtype)
        np.testing.assert_allclose(got, expected.astype(dtype), rtol=8 * np.finfo(dtype).eps)

    @pytest.mark.skipif(shutil.which("octave-cli") is None, reason="GNU Octave is not here")
    def test_in_octave(self, every_operation, tmp_path):
        printed, points, expected = every_operation
        (tmp_path / "every.m").write_text(printed("matlab"))
        calls = [f"r = every({point.tolist()}); printf('%d ', size(r)); printf('%.17g ', r);" for point in points]
        (tmp_path / "run.m").write_text("\n".join(["1;", *calls]))
        run = ["octave-cli", "--no-gui", "--quiet", "run.m"]
        numbers = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=True).stdout.split()
        rows = np.array([float(number) for number in numbers]).reshape(len(points), -1)
        assert (rows[:, :2] == [expected.shape[1], 1]).all()  # a column
        np.testing.assert_allclose(rows[:, 2:], expected, rtol=SAME)


def test_names_of_python_are_imported_where_they_are_used():
    kernel = rne.compile(rne.dynamics.gravity_torque, rne.irb140())
    assert "\nfrom math import cos, sin, sqrt, tanh\n" in kernel.source("python")


def test_another_language_is_refused(irb140):
    with pytest.raises(
        ValueError,
        match=r"^`language` must be one of \['python', 'numpy', 'matlab', 'c', 'c\+\+', 'rust'\], got 'fortran'$",
    ):
        irb140.kernel(rne.dynamics.mass_matrix).source("fortran")


def test_languages_without_namespaces_have_none():
    kernel = rne.compile(rne.dynamics.gravity_torque, straight_chain(1))
    with pytest.raises(ValueError, match=r"^`namespace` is for language 'c\+\+', got language 'rust'$"):
        kernel.source("rust", namespace="arm")


COMMENTS = {"python": "#", "numpy": "#", "matlab": "%", "c": "/*", "c++": "//", "rust": "//"}


def code_and_comments(text, language):
    """Lines of code, and lines of comments."""
    code, comments = [], []
    for line in text.splitlines():
        (comments if line.startswith(COMMENTS[language]) else code).append(line)
    return code, comments


@pytest.mark.parametrize("language", LANGUAGES)
def test_names_of_a_file_stand_in_comments_only(irb140, language):
    code, comments = code_and_comments(irb140.kernel(rne.dynamics.inverse_dynamics).source(language), language)
    assert not any("joint" in line or "irb140" in line for line in code)
    assert sum("irb140" in line for line in comments) == 1


HOSTILE = (
    "*/ int main(){} /*", "a\nimport os", 'b"""; x = 1', "%{", "%}", "\\", "...", "coding: utf-16", "??/", "\u2028x", "\rx",
    "ж" * 200,
)  # fmt: skip


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_name_can_leave_its_comment(irb140, language):
    """Robots of a hostile file: the code is that of the robot with plain names, and comments are harmless ASCII."""
    plain, _ = code_and_comments(irb140.kernel(rne.dynamics.gravity_torque).source(language), language)
    for k in range(0, len(HOSTILE), 6):
        names = HOSTILE[k : k + 6]
        rename = dict(zip(irb140.joint_names, names, strict=True))
        renamed = replace(
            irb140.model,
            name=names[0],
            moving_joints=names,
            link_joints=tuple(rename.get(joint, joint) for joint in irb140.model.link_joints),
        )
        code, comments = code_and_comments(rne.compile(rne.dynamics.gravity_torque, renamed).source(language), language)
        assert code == plain
        text = " ".join(line.removeprefix("/* ").removesuffix(" */").lstrip("#%/ ") for line in comments)
        assert re.fullmatch(r"[A-Za-z0-9_.+ ,<>^-]*", text), text


def test_heading_names_robot_joints_and_units(irb140):
    _, comments = code_and_comments(irb140.kernel(rne.dynamics.inverse_dynamics).source("python"), "python")
    assert comments == [
        "# inverse_dynamics of robot irb140",
        "# Joints in order - 1 joint_1, 2 joint_2, 3 joint_3, 4 joint_4, 5 joint_5, 6 joint_6",
        "# Units - q rad, qd rad/s, qdd rad/s^2",
        "# Unit of the result - N m",
        "# Operations - 61 add, 5 cos, 159 multiply, 5 sin, 50 subtract",
    ]


def test_heading_of_c_says_what_a_worst_case_needs(irb140):
    """No loop and no branch: the operations are those of every call. Values of single precision take half the bytes."""
    kernel = irb140.kernel(rne.dynamics.inverse_dynamics)
    stated = [["No loop, no allocation, no branch", f"Stack - 51 values at once at most in this order, {size} bytes, and saved registers"]
              for size in (408, 204)]  # fmt: skip
    for dtype, expected in zip(("float64", "float32"), stated, strict=True):
        for language, around in {"c": "/* {} */", "rust": "// {}"}.items():
            _, comments = code_and_comments(kernel.source(language, dtype=dtype), language)
            assert comments[5:7] == [around.format(text) for text in expected]


def test_values_are_kept_from_their_instruction_to_their_last_reader():
    def most_alive(function):
        text = rne.compile(rne.traceable(lambda q: np.concatenate(function(q))), straight_chain(1)).source("c")
        return int(re.search(r"Stack - (\d+) values", text)[1])

    assert most_alive(lambda q: [np.sin(q) + np.cos(q)]) == 2  # the sum takes a place of its operands
    assert most_alive(lambda q: [np.sin(q), np.sin(q) + np.cos(q)]) == 2
    assert most_alive(lambda q: [np.sin(q), np.cos(q), np.sin(q) + np.cos(q)]) == 3
    assert most_alive(lambda q: [q]) == 0


def test_heading_of_choices_names_them(every_operation):
    printed, _, _ = every_operation
    assert "No loop, no allocation, only choices in minimum, maximum, sign, less, less_equal, where" in printed("c")


def test_operations_that_only_the_check_of_m_needs_are_not_printed():
    kernel = rne.compile(rne.dynamics.articulated_forward_dynamics, random_tree(**TREES["pair"]))
    counted = re.search(r"Operations - (.*)", kernel.source("python"))[1]
    assert sum(map(int, re.findall(r"\d+", counted))) < sum(kernel.operations.values())


def test_constants_are_the_nearest_of_single_precision():
    third = rne.compile(rne.traceable(lambda_times(1 / 3)), rne.irb140())
    assert "result[0] = (0.33333334f * q[0]);" in third.source("c", dtype="float32")
    assert "result[0] = (0.33333334 * q[0]);" in third.source("rust", dtype="float32")
    huge = rne.compile(rne.traceable(lambda_times(1e300)), rne.irb140())
    with pytest.raises(
        ValueError,
        match=r"^`dtype` must be 'float64': the program has the constant 1e\+300, which float32 cannot hold$",
    ):
        huge.source("c", dtype="float32")


def lambda_times(factor):
    def times(q):
        return factor * q

    return times


@pytest.mark.parametrize("language", ["python", "numpy", "matlab"])
def test_single_precision_is_of_c_and_rust(irb140, language):
    with pytest.raises(
        ValueError, match=rf"^`dtype` of language '{language}' must be one of \['float64'\], got 'float32'$"
    ):
        irb140.kernel(rne.dynamics.gravity_torque).source(language, dtype="float32")


def test_heading_says_on_which_links_wrenches_act(irb140):
    _, comments = code_and_comments(
        irb140.kernel(rne.dynamics.bias_torque, external=["tool0", "link_3"]).source("c"), "c"
    )
    assert comments[2:5] == [
        "/* Units - q rad, qd rad/s */",
        "/* external_1 - moment N m, then force N, on link tool0 at its origin, in its axes */",
        "/* external_2 - moment N m, then force N, on link link_3 at its origin, in its axes */",
    ]


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_name_of_a_link_can_leave_its_comment(irb140, language):
    links = irb140.link_names[1:]
    plain, _ = code_and_comments(irb140.kernel(rne.dynamics.bias_torque, external=links).source(language), language)
    for k in range(0, len(HOSTILE), len(links)):
        names = (HOSTILE * 2)[k : k + len(links)]
        renamed = replace(irb140.model, link_names=("base_link", *names))
        text = rne.compile(rne.dynamics.bias_torque, renamed, external=names).source(language)
        code, comments = code_and_comments(text, language)
        assert code == plain
        text = " ".join(line.removeprefix("/* ").removesuffix(" */").lstrip("#%/ ") for line in comments)
        assert re.fullmatch(r"[A-Za-z0-9_.+ ,<>^/-]*", text), text


def test_heading_of_sliding_joints_has_their_units():
    model = rne.dh_chain(
        a=[0.1] * 3, alpha=[1.0] * 3, d=[0.2] * 3, theta=[0.3] * 3, types=["prismatic", "revolute", "prismatic"],
        masses=np.ones(3), centres=np.ones((3, 3)), inertias=np.zeros((3, 3, 3)), name="gantry",
    )  # fmt: skip
    kernel = rne.compile(rne.dynamics.mass_matrix, model)
    _, comments = code_and_comments(kernel.source("matlab"), "matlab")
    assert comments == [
        "% mass_matrix of robot gantry",
        "% Joints in order - 1 joint_1, 2 joint_2, 3 joint_3",
        "% Units of rotating joints 2 - q rad",
        "% Units of sliding joints 1, 3 - q m",
        "% Unit of the result - kg or kg m or kg m^2",
        "% Operations - 26 add, 1 cos, 57 multiply, 1 sin, 19 subtract",
        "% Save as mass_matrix.m",
    ]
    units = [kernel.source("c", element).splitlines()[4] for element in ("m11", "m12", "m22", "m31")]
    assert units == [f"/* Unit of the result - {unit} */" for unit in ("kg", "kg m", "kg m^2", "kg")]
    torque = rne.compile(rne.dynamics.bias_torque, model)
    assert [torque.source("c", f"h{k}").splitlines()[4] for k in (1, 2)] == [
        "/* Unit of the result - N */",
        "/* Unit of the result - N m */",
    ]


def test_heading_of_many_joints_is_wrapped_and_of_none_says_so():
    from .random_robots import straight_chain

    lines = rne.compile(rne.dynamics.gravity_torque, straight_chain(30)).source("python").splitlines()
    assert all(len(line) <= 102 for line in lines if line.startswith("#"))
    assert "30 joint29" in " ".join(lines[1:6])
    nothing = rne.compile(rne.dynamics.gravity_torque, rne.model.chain(np.zeros((0, 3, 3)), np.zeros((0, 3))))
    assert nothing.source("c").splitlines()[1:3] == ["/* Joints in order - none */", "/* Unit of the result - none */"]
    energy = rne.compile(rne.dynamics.kinetic_energy, straight_chain(1)).source("c").splitlines()
    assert energy[3] == "/* Unit of the result - J */"
    poses = rne.compile(rne.dynamics.link_poses, straight_chain(1)).source("c").splitlines()
    assert poses[3] == "/* Unit of the result - SI */"


def test_command_line_prints_source_or_says_why_not(capsys):
    assert main(["source", "irb140", "--quantity", "mass_matrix", "--language", "matlab"]) == 0
    assert capsys.readouterr().out.startswith("function result = mass_matrix(q)\n")
    assert main(["source", "irb140", "--element", "g4", "--language", "rust", "--dtype", "float32"]) == 0
    assert "\npub fn g4(q: &[f32; 6], result: &mut [f32; 1]) {\n" in capsys.readouterr().out
    assert main(["source", "irb140", "--dtype", "float32"]) == 2
    assert capsys.readouterr().err == "error: --dtype of language 'python' must be one of ['float64'], got 'float32'\n"
    assert main(["source", "nobody"]) == 2
    assert capsys.readouterr().err == "error: 'nobody' is neither a file nor one of rne.robots()\n"


def test_printed_python_needs_nothing_of_this_package(irb140, tmp_path):
    (tmp_path / "printed.py").write_text(irb140.kernel(rne.dynamics.gravity_torque).source("python"))
    code = "import sys, printed; print(printed.gravity_torque([0.0] * 6)[1]); assert 'numpy' not in sys.modules"
    run = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert float(run.stdout) == pytest.approx(irb140.gravity_torque(np.zeros(6))[1])


def test_names_are_cut_and_their_other_characters_written_as_numbers(irb140):
    names = {"a" * 61: "a" * 60, "wrist_1.0 + x-y": "wrist_1.0 + x-y"}
    names['*/ "é\n'] = "<U+002A><U+002F> <U+0022><U+00E9><U+000A>"
    for name, printed in names.items():
        text = rne.compile(rne.dynamics.gravity_torque, replace(irb140.model, name=name)).source("python")
        assert text.splitlines()[0] == f"# gravity_torque of robot {printed}"


NAMED = (
    "lambda np q cos pow hypotf fmal sum class größe _cost __x t3 zeros isnan root self linux asm j0 match type print "
    "M_x x" + "y" * 80
)


class OwnFunctions:
    """Functions of every kind."""

    traceable = True

    def __call__(self, q):
        return q + 1

    def method(self, q):
        return q - 1


def of_a_name(name):
    def function(q):
        return q * np.sin(q)

    function.__name__ = name
    return rne.traceable(function)


@pytest.fixture(scope="module")
def own_kernels():
    """A kernel of a function of each name."""
    return [rne.compile(of_a_name(name), random_tree(1, 3)) for name in NAMED.split()]


class TestNamesOfOwnFunctions:
    def test_printed_text_runs_whatever_they_are(self, own_kernels):
        others = [
            rne.traceable(lambda q: q * 2), OwnFunctions(), rne.traceable(OwnFunctions().method),
            rne.traceable(functools.partial(functools.partial(lambda q, k: k * q, k=3.0))),
        ]  # fmt: skip
        for kernel in [*own_kernels, *(rne.compile(other, random_tree(1, 3)) for other in others)]:
            for language in ("python", "numpy"):
                text, space = kernel.source(language), {}
                exec(text, space)
                (name,) = re.findall(r"^def (\w+)\(q\):", text, re.MULTILINE)[-1:]
                assert space[name](np.array([0.3])) == pytest.approx(kernel([0.3]), rel=1e-15)
                matlab = kernel.source("matlab")
                assert re.match(rf"function result = {name}\(q\)\n", matlab)
                assert f"Save as {name}.m" in matlab

    @pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler `cc`")
    def test_in_c(self, own_kernels, tmp_path):
        texts = [kernel.source("c") for kernel in own_kernels]
        library = c_library(texts, tmp_path)
        for kernel, text in zip(own_kernels, texts, strict=True):
            (name,) = re.findall(r"^void (\w+)\(", text, re.MULTILINE)
            assert call(library[name], [np.array([[0.3]])], 1, "float64")[0] == pytest.approx(kernel([0.3]), rel=1e-15)

    @pytest.mark.skipif(shutil.which("rustc") is None, reason="there is no Rust compiler here")
    def test_in_rust(self, own_kernels, tmp_path):
        texts = [kernel.source("rust") for kernel in own_kernels]
        names = [re.findall(r"^pub fn (\w+)\(", text, re.MULTILINE)[0] for text in texts]
        assert len({*names}) == len(names)
        rust_library(texts, tmp_path, {name: ["&[f64; 1]", "&mut [f64; 1]"] for name in names})  # compiles

    def test_what_cannot_be_marked_is_told_how(self):
        text = "^`law` cannot be marked: set `traceable = True` in the class builtin_function_or_method$"
        with pytest.raises(TypeError, match=text):
            rne.traceable(len)


def test_cpp_finds_the_piece_of_a_motion_through_samples_before_it_reads_it():
    robot = rne.Robot(straight_chain(1))
    motion = rne.trajectories.sampled([0.0, 0.7, 1.5], [[0.0], [0.3], [0.1]])
    text = rne.control.compiled(rne.control.computed_torque(robot, 50.0, 20.0, motion)).source("c++")
    body = [line.strip() for line in text.partition(" control_law(")[2].splitlines()[2:6]]
    found = [
        "const double* const piece = control_law_piece(t);",
        "if (piece == nullptr) {",
        "return std::nullopt;",
        "}",
    ]
    assert body == found
    assert "piece[2]" in text.partition(found[0])[2]
