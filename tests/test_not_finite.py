"""No number from nothing: where NumPy's arithmetic gives 0/0, inf - inf or 0 inf, so do traced programs.

Random expressions with zeros, infinities and NaN among their constants, at inputs that are zero, are one program, whose
values by every engine and in every printed language are compared with NumPy's.
"""

import ctypes
import re
import shutil
import subprocess
from math import inf, nan

import numpy as np
import pytest

import rne
from rne.graph.graph import Graph
from rne.graph.program import lower
from rne.graph.scalar import inputs, references
from rne.kernels import numpy_backend
from rne.kernels.python_backend import state_function
from rne.kernels.soundness import NeedsRecursion, Trace
from rne.kernels.source import Printable, to_source

from .compiled_sources import call, rust_library
from .helpers import kept
from .random_robots import straight_chain

ROUNDING = 1e-9  # relative: of a dozen operations, among them differences of numbers that are 1e4 times as large
CONSTANTS = [0.0, 0.0, 1.0, -1.0, 2.0, -3.0, 0.5, inf, -inf, nan]
WIDTH = 3
POINTS = np.array([[0.0, 0.0, 0.0], [0.0, 1.5, -0.5], [2.0, 0.0, 2.0], [0.7, -1.5, 0.0], [-0.5, -0.5, 1.25]])
# Divisors are sizes: a zero has no sign in a program, and of 1 / 0 there are two.
KINDS = {
    "add": lambda f, p, q, r, c: p + q,
    "subtract": lambda f, p, q, r, c: p - q,
    "multiply": lambda f, p, q, r, c: p * q,
    "by a constant": lambda f, p, q, r, c: c * p,
    "and a constant": lambda f, p, q, r, c: p + c,
    "negative": lambda f, p, q, r, c: -p,
    "divide": lambda f, p, q, r, c: p / abs(q),
    "a constant divided": lambda f, p, q, r, c: c / abs(p),
    "divided by a constant": lambda f, p, q, r, c: p / abs(c),
    "sqrt": lambda f, p, q, r, c: f("sqrt", p),
    "sin": lambda f, p, q, r, c: f("sin", p),
    "cos": lambda f, p, q, r, c: f("cos", p),
    "tanh": lambda f, p, q, r, c: f("tanh", p),
    "exp": lambda f, p, q, r, c: f("exp", f("sign", p) * 1e5),  # infinite, 1 or 0
    "sign": lambda f, p, q, r, c: f("sign", p),
    "minimum": lambda f, p, q, r, c: f("minimum", p, q),
    "maximum of a constant": lambda f, p, q, r, c: f("maximum", p, c),
    "where": lambda f, p, q, r, c: f("where", f("less", p, q), r, c),
    "where it is not 0": lambda f, p, q, r, c: f("where", p, q, r),
}


def plans(seed, count=150):
    """Random expressions: of each step the kind, its operands among what is there, and a constant."""
    rng, names = np.random.default_rng(seed), list(KINDS)
    return [
        [
            (names[rng.integers(len(names))], *rng.integers(0, WIDTH + k, 3), CONSTANTS[rng.integers(len(CONSTANTS))])
            for k in range(rng.integers(2, 9))
        ]
        for _ in range(count)
    ]


def value(plan, x, function, number=float):
    """The value of an expression of any kind of number."""
    pool = list(x)
    for kind, *places, constant in plan:
        pool.append(KINDS[kind](function, *(pool[k] for k in places), number(constant)))
    return pool[-1]


def by_numpy(name, *x):
    return np.where(x[0] != 0, *x[1:])[()] if name == "where" else getattr(np, name)(*x) + type(x[0])(0)


def traced(name, first, *others):
    return first < others[0] if name == "less" else getattr(first, name)(*others)


def program_of(expressions):
    """Their program; zeros that were folded without being sound are kept by a second graph."""
    by_pivots = None
    for _ in range(2):
        graph = Graph(by_pivots=by_pivots)
        x = inputs(graph, (WIDTH,), 0)
        outputs = np.empty(len(expressions), dtype=object)
        outputs[:] = [value(plan, x, traced, lambda c, one=x[0]: one.where(c, c)) for plan in expressions]
        by_pivots = graph.divisions_by_pivots(())
    return lower(graph, references(graph, outputs), WIDTH)


@pytest.fixture(scope="module", params=kept([1, 2, 3, 4, 5, 6], [1]))
def many(request):
    """A program of many expressions, and its values by NumPy at the points."""
    expressions = plans(request.param)
    with np.errstate(all="ignore"):
        expected, finer = (
            np.array([[value(plan, x, by_numpy, kind) for plan in expressions] for x in POINTS.astype(kind)])
            for kind in (np.float64, np.longdouble)
        )
        sure = np.isclose(expected, finer, ROUNDING, ROUNDING, equal_nan=True)  # not those that rounding decides
    assert 0.2 < np.isfinite(expected).mean() < 0.8
    assert sure.mean() > 0.98
    return Trace(program_of(expressions), (WIDTH,), (len(expressions),)), np.where(sure, expected, np.pi)


def check(found, expected):
    found = np.where(expected == np.pi, expected, np.reshape(found, expected.shape))
    np.testing.assert_allclose(found, expected, rtol=ROUNDING, atol=ROUNDING)


def printed(trace, language):
    return to_source(Printable(trace, "law", ("x",), ["a law"]), language)


def test_in_registers_of_numpy(many):
    trace, expected = many
    count = len(POINTS)
    workspace = numpy_backend.Workspace(numpy_backend.allocate(trace.program), count, np.dtype("float64"))
    workspace.rows[:WIDTH, :count] = POINTS.T
    with np.errstate(all="ignore"):
        for call, arguments in workspace.calls(count):
            call(*arguments)
    check(workspace.rows[WIDTH : WIDTH + trace.entries, :count].T, expected)


def test_in_machine_code(many):
    pytest.importorskip("llvmlite", reason="Numba is not installed")
    from rne.kernels import llvm_backend

    trace, expected = many
    library = llvm_backend.lanes_library(trace, 1)
    function = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)(library.address["function"])
    found = np.empty(expected.shape)
    for x, row in zip(POINTS, found, strict=True):
        assert function(x.ctypes.data, row.ctypes.data) == 0
    check(found, expected)


def test_on_floats():
    """One by one: Python gives up at some that `where` hides, but never gives a number that NumPy does not."""
    given = 0
    for plan in plans(0, 60):
        function = state_function(Trace(program_of([plan]), (WIDTH,), (1,)))
        for x in POINTS:
            with np.errstate(all="ignore"):
                expected = value(plan, x, by_numpy, np.float64)
            try:
                (found,) = function(x)
            except NeedsRecursion:
                continue
            assert found == pytest.approx(expected, rel=ROUNDING, abs=ROUNDING)
            given += 1
    assert given > 100


def test_printed_numpy(many):
    trace, expected = many
    space = {}
    exec(printed(trace, "numpy"), space)
    with np.errstate(all="ignore"):
        check(space["law"](POINTS), expected)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler `cc`")
def test_printed_c(many, tmp_path):
    trace, expected = many
    source, library = tmp_path / "law.c", tmp_path / "law.so"
    source.write_text(printed(trace, "c"))
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", library, source, "-lm"], check=True)
    found = np.empty(expected.shape)
    for x, row in zip(POINTS, found, strict=True):
        ctypes.CDLL(str(library)).law(ctypes.c_void_p(x.ctypes.data), ctypes.c_void_p(row.ctypes.data))
    check(found, expected)


@pytest.mark.skipif(shutil.which("rustc") is None, reason="there is no Rust compiler here")
def test_printed_rust(many, tmp_path):
    trace, expected = many
    types = [f"&[f64; {WIDTH}]", f"&mut [f64; {trace.entries}]"]
    library = rust_library([printed(trace, "rust")], tmp_path, {"law": types})
    check(call(library.c_law, [POINTS], trace.entries, "float64"), expected)


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="GNU Octave is not here")
def test_printed_matlab(many, tmp_path):
    trace, expected = many
    (tmp_path / "law.m").write_text(printed(trace, "matlab"))
    calls = [f"printf('%.17g ', law({x.tolist()}));" for x in POINTS]
    (tmp_path / "run.m").write_text("\n".join(["1;", *calls]))
    run = ["octave-cli", "--no-gui", "--quiet", "run.m"]
    found = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=True).stdout.split()
    check([float(x) for x in found], expected)


MASSLESS = rne.dh_chain(a=[0.3, 0.2], alpha=[0, 0], d=[0, 0.1], theta=[0, 0])


@pytest.mark.parametrize("engine", ["numpy", "numba"])
@pytest.mark.parametrize("name", ["centre_of_mass", "centre_of_mass_jacobian"])
def test_nothing_has_a_centre_of_mass_without_a_mass(engine, name):
    """At the first call, by the recursion, and by kernels; the first massless robot of a batch is named."""
    call, q = getattr(rne.Robot(MASSLESS, engine), name), np.zeros((2, 3, 2))
    of_parameters = getattr(rne.Robot(straight_chain(2), engine), name)
    mass = np.ones((2, 3, 1))
    mass[1, :2] = 0.0
    parameters = mass * rne.Robot(straight_chain(2)).parameters
    text = f"{name}: nothing that moves has a mass"
    for _ in range(3):
        for given, state in ((q[0, 0], ""), (q[0], " at state (0,)"), (q, " at state (0, 0)")):
            with pytest.raises(rne.NotFiniteError, match=f"^{re.escape(text + state)}$"):
                call(given)
        with pytest.raises(rne.NotFiniteError, match=f"^{re.escape(text)} at state \\(1, 0\\)$") as error:
            of_parameters(q, parameters=parameters)
        assert error.value.state == (1, 0)
        with pytest.raises(rne.NotFiniteError, match=f"^{re.escape(text)}$"):
            of_parameters(q[0, 0], parameters=parameters[1, 1])
    assert np.isfinite(of_parameters(q, parameters=np.abs(parameters) + 1)).all()


def test_an_overflow_is_no_lack_of_mass():
    body = {"masses": [2.0], "centres": [[0, 0, 0]], "inertias": [np.eye(3)]}
    sliding = rne.dh_chain(a=[0], alpha=[0], d=[0], theta=[0], types="prismatic", **body)
    with pytest.raises(rne.NotFiniteError, match=r"^centre_of_mass overflows float64"):
        rne.dynamics.centre_of_mass(sliding, [1.7e308])


LAWS = {
    "0/0 of constants": lambda t, q, qd: (q - q) / (qd - qd),
    "0/0 at the start": lambda t, q, qd: 0 * q / q,
    "0 times what is infinite at the start": lambda t, q, qd: 0 * (1 / q) + qd,
    "0 times a sum with a term that is infinite at the start": lambda t, q, qd: 0 * (1 / q + qd) + qd,
    "a difference of two that are infinite": lambda t, q, qd: 1 / abs(q) - 2 / abs(q) - qd,
}


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning", "ignore:divide by zero:RuntimeWarning")
@pytest.mark.parametrize("law", LAWS)
def test_a_traced_law_fails_where_a_call_of_it_does(law):
    robot, texts = rne.Robot(straight_chain(2)), []
    for controller in (rne.traceable(LAWS[law]), LAWS[law]):
        with pytest.raises(rne.SimulationError) as error:
            rne.simulate(rne.Scene(robot, controller=controller), [0, 0], [0, 0], 0.1)
        texts.append(str(error.value))
    assert texts[0] == texts[1]
    assert "torque of 'joint0' is " in texts[0]


def test_zeros_of_the_model_cost_nothing_beside_a_law_with_roots():
    """Divisions by pivots are told from those of the law, whose zeros must stay."""
    robot = rne.Robot(straight_chain(4))  # many entries of M are 0
    laws = [lambda t, q, qd: -qd, lambda t, q, qd: 0 * np.sqrt(abs(q)) - qd]
    costs = [rne.Scene(robot, controller=rne.traceable(law)).cost()["total"] for law in laws]
    assert 0 < costs[1] - costs[0] <= 4 * robot.n  # a root, a product, a difference and a size for each joint


def test_a_program_with_a_constant_that_is_not_finite_says_so():
    with pytest.raises(TypeError, match=r": not written out, since it has a constant that is not finite$"):
        rne.compile(rne.dynamics.centre_of_mass, MASSLESS).source("c")
