"""Source text of a program in Python, NumPy, MATLAB (and Octave), C, C++ or Rust, with a comment on robot and units.

Joints are numbers in the program. Names come from a file, and the file may be anybody's: in the comment they are plain
ASCII of a few harmless characters, so that no name can end the comment or continue its line, in any of the languages.
"""

from __future__ import annotations

import builtins
import keyword
import math
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import accumulate, product
from typing import NamedTuple

import numpy as np

from ..basics.piecewise import NO_TABLE
from ..basics.spatial import Array
from ..basics.text import UNITS
from ..dynamics.precision import SINGULAR
from ..graph.program import Operand, Program, without_judged
from ..model.model import Model
from .python_backend import FUNCTIONS, expressions
from .soundness import Conditions, Trace

MAX_NAME = 60  # characters
WIDTH = 100

# Letters of single entries, as in the thesis's appendix C: m23 of M, c3 of C q', g2 of g, tau4.
LETTERS = {
    "mass_matrix": "m",
    "coriolis_torque": "c",
    "gravity_torque": "g",
    "bias_torque": "h",
    "inverse_dynamics": "tau",
    "forward_dynamics": "qdd",
}
PER_JOINT = dict.fromkeys(("inverse_dynamics", "bias_torque", "gravity_torque", "coriolis_torque"), "tau")
PER_JOINT |= dict.fromkeys(("forward_dynamics", "articulated_forward_dynamics"), "qdd")
MASS = ("kg m^2", "kg m", "kg")  # of an entry of M with none, one or two sliding joints
LAWS = "controller", "control_law"
SCALAR = {"kinetic_energy": "J", "potential_energy": "J"}
# Quantities with a column for each inertial parameter.
REGRESSORS = ("regressor", "control_regressor", "kinetic_energy_regressor", "potential_energy_regressor")
TEN = (
    "ten per body: m kg, m cx, m cy, m cz kg m, Ixx, Ixy, Iyy, Ixz, Iyz, Izz kg m^2, about the origin of the body's "
    "joint frame in the URDF, in its axes"
)


class Printable(NamedTuple):
    """Trace to print: its name, arguments, and lines of its heading."""

    trace: Trace
    name: str
    arguments: tuple[str, ...]
    heading: Sequence[str]
    table: Array = NO_TABLE  # pieces of a motion through samples; `piece` is a row of it
    rows: Sequence[Sequence[str]] = ()  # its numbers as texts
    namespace: str = ""  # of C++
    looks_up: bool = False  # True if the function itself finds the piece, which is no argument then
    members: Mapping[str, Sequence[str]] = {}  # of arguments that are structures in C++: type, then its entries
    checks: Sequence[str] = ()  # conditions in C or C++ under which there is a result

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the result."""
        return self.trace.shape

    @property
    def names(self) -> str:
        """Names of the arguments, separated by commas."""
        return ", ".join(self.arguments)

    @property
    def taken(self) -> dict[str, int]:
        """Arguments of a function in C or C++ with their lengths; without empty ones and a piece that it looks up."""
        pairs = zip(self.arguments, self.trace.widths, strict=True)
        return {name: width for name, width in pairs if width and not (self.looks_up and name == "piece")}

    @property
    def may_fail(self) -> bool:
        """True if a function in C returns int, 0 where there is a result, and one in C++ an optional."""
        return bool(self.checks) or self.looks_up

    @property
    def entries(self) -> list[tuple[int, ...]]:
        """Index of each entry of the result, row by row."""
        return list(product(*(range(size) for size in self.shape)))


class Written(NamedTuple):
    """Function with texts of its operations and results, and the end of a text of its language."""

    printable: Printable  # with its whole heading
    lines: list[str]
    outputs: list[str]
    types: tuple[str, str]  # what @ and $ stand for

    def finished(self, lines: Iterable[str]) -> str:
        """Lines as a text, with the names of types instead of @ and $."""
        return "\n".join(lines).replace("@", self.types[0]).replace("$", self.types[1])


def to_source(printable: Printable, language: str, dtype: str = "float64") -> str:
    """Source text of a function; errors as of `written`."""
    found = written(printable, language, dtype)
    return found.finished([*LANGUAGES[language].text(*found[:3]), ""])


def written(printable: Printable, language: str, dtype: str = "float64") -> Written:
    """Parts of a function's text; a ValueError lists the available languages and types of numbers."""
    if language not in LANGUAGES:
        raise ValueError(f"`language` must be one of {list(LANGUAGES)}, got {language!r}")
    _, functions, types, literal, entry = LANGUAGES[language]
    if dtype not in types:
        raise ValueError(f"`dtype` of language {language!r} must be one of {list(types)}, got {dtype!r}")
    trace, is_c, members = printable.trace, language in ("c", "c++"), printable.members
    program = trace.program if is_c else without_judged(trace.program, trace.entries)
    pairs = [*zip(printable.arguments, trace.widths, strict=True)]
    inputs = [entry(name, k) for name, width in pairs for k in range(width)]
    if language == "c++":
        inputs = [_member(name, k, width, members.get(name, ())) for name, width in pairs for k in range(width)]

    def number(x: float) -> str:
        return literal.format(repr(x) if dtype == "float64" else _single(x))

    costs = [f"Operations - {', '.join(f'{count} {kind}' for kind, count in program.operations.items()) or 'none'}"]
    if is_c or language == "rust":
        choices = ", ".join(kind for kind in CHOICES if kind in program.operations)
        costs += [f"No loop, no allocation, {f'only choices in {choices}' if choices else 'no branch'}"]
        alive, size = most_alive(program), np.dtype(dtype).itemsize
        costs += [f"Stack - {alive} values at once at most in this order, {alive * size} bytes, and saved registers"]
    name = identifier(printable.name, printable.arguments)
    costs += [f"Save as {name}.m"] if language == "matlab" else []
    whole = printable._replace(name=name, heading=[*printable.heading, *_wrapped(costs)])
    lines, outputs = expressions(program, inputs.__getitem__, {**FUNCTIONS, **functions}, number)
    if is_c:
        rows = [["-" * (x < 0) + number(abs(x)) for x in row] for row in printable.table.tolist()]
        results = [f"result[{k}]" for k in range(trace.entries)]
        own = _conditions("" if language == "c" else "std::", number)
        checks = trace.sound_results([*results, *outputs[trace.entries :]], dtype, own, SINGULAR)
        whole = whole._replace(rows=rows, checks=checks if len(outputs) > trace.entries else ())
    return Written(whole, lines, outputs[: trace.entries], types[dtype])


def _conditions(prefix: str, number: Callable[[float], str]) -> Conditions:
    """Conditions of soundness of results as text in C or C++; inputs are not checked there."""
    return Conditions(
        finite=lambda values: " && ".join(f"{prefix}isfinite({x})" for x in values) or "1",
        within=lambda values, bound: "1",
        above=lambda values, factor, others: " && ".join(
            f"{a} > {number(factor)} * {b}" for a, b in zip(values, others, strict=True)
        ),
    )


def identifier(name: str, taken: Sequence[str] = ()) -> str:
    """Function name in ASCII, valid in every language and different from `taken`."""
    name = re.sub(r"\W", lambda match: f"u{ord(match.group()):04x}", name, flags=re.ASCII)[:MAX_NAME]
    name = name if name[:1].isalpha() else f"f{name}"
    known = {*RESERVED.split(), *keyword.kwlist, *keyword.softkwlist, *dir(builtins), *dir(math), *taken}
    is_known = name in known or (name[-1] in "fl" and name[:-1] in known) or re.fullmatch(r"t\d+", name)
    return f"{name}_" if is_known else name


def checked_name(argument: str, name: str, taken: Sequence[str] = ()) -> str:
    """Name given by a user, unchanged; a ValueError if it is invalid in a language."""
    if not isinstance(name, str) or not name or identifier(name, taken) != name:
        raise ValueError(f"`{argument}` must be a name of letters, digits and _ that no language has, got {name!r}")
    return name


def most_alive(program: Program) -> int:
    """Most results that are kept at once, each from its instruction to its last reader."""
    count = len(program.instructions)
    last = {arg: k for k, instruction in enumerate(program.instructions) for arg in instruction.args}
    last |= dict.fromkeys(program.outputs, count)
    ended = Counter(last.get(Operand("result", k), k) for k in range(count))
    return max(accumulate(1 - ended[k] for k in range(count)), default=0)


def _wrapped(texts: Iterable[str]) -> list[str]:
    return [line for text in texts for line in textwrap.wrap(text, WIDTH, subsequent_indent="  ")]


def _python(p: Printable, lines: list[str], outputs: list[str]) -> list[str]:
    flat = ", ".join(outputs)
    body = [*lines, f"return [{flat}]" if p.shape else f"return {flat}"]
    doc = f'"""Entries of the result, shape {p.shape}, row by row."""'
    rarer = {name for name in ("atan2", "exp", "inf", "nan") if any(re.search(rf"\b{name}\b", line) for line in body)}
    names = ", ".join(sorted({"cos", "sin", "sqrt", "tanh"} | rarer))
    head = [*(f"# {line}" for line in p.heading), f"from math import {names}", "", ""]
    head += _used(body, PYTHON, "", "")
    return [*head, f"def {p.name}({p.names}):", f"    {doc}", *_indented(body)]


def _used(lines: Sequence[str], helpers: Mapping[str, Sequence[str]], *after: str) -> list[str]:
    """Definitions of the helpers that lines call, each with lines after it."""
    found = [text for name, text in helpers.items() if any(f"{name}(" in line for line in lines)]
    return [line for text in found for line in (*text, *after)]


def _numpy(p: Printable, lines: list[str], outputs: list[str]) -> list[str]:
    pairs = zip(p.entries, outputs, strict=True)
    stores = [f"result[{', '.join(['...', *map(str, entry)])}] = {output}" for entry, output in pairs]
    leading = f"np.broadcast_shapes({', '.join(f'{name}.shape[:-1]' for name in p.arguments)})"
    result = f"result = np.zeros({leading} + {p.shape}, dtype=np.result_type({p.names}))"
    head = [*(f"# {line}" for line in p.heading), "import numpy as np", "", ""]
    return [*head, f"def {p.name}({p.names}):", *_indented([*lines, result, *stores, "return result"])]


def _matlab(p: Printable, lines: list[str], outputs: list[str]) -> list[str]:
    pairs = zip(p.entries, outputs, strict=True)
    stores = [f"result({', '.join(str(k + 1) for k in entry) or '1'}) = {output}" for entry, output in pairs]
    size = ", ".join(map(str, p.shape if len(p.shape) > 1 else (*p.shape, 1) if p.shape else (1, 1)))
    head = [f"function result = {p.name}({p.names})", *(f"% {line}" for line in p.heading)]
    body = [*lines, f"result = zeros({size})", *stores]
    return [*head, *(f"  {line};" for line in body), "end", *_used([*body, *_used(body, MATLAB)], MATLAB)]


def _c(p: Printable, lines: list[str], outputs: list[str]) -> list[str]:
    head = [*(f"/* {line} */" for line in p.heading), "#include <math.h>", "", *c_helpers(lines, outputs)]
    return [*head, *c_function(p, lines, outputs), *(["", *c_look_up(p)] if p.rows else [])]


def c_helpers(lines: Sequence[str], outputs: Sequence[str]) -> list[str]:
    """Functions in C that lines call."""
    return _used([*lines, *outputs], C, "")


def c_signature(p: Printable) -> str:
    """Signature of a function in C."""
    arguments = ", ".join([f"const @ *{name}" for name in p.taken] + ["@ *result"])
    return f"{'int' if p.may_fail else 'void'} {p.name}({arguments})"


def c_function(p: Printable, lines: Sequence[str], outputs: Sequence[str]) -> list[str]:
    """Function in C; one that may fail returns 0, or 1 where it does, with NaN in its result."""
    fail = ["{", f"    for (int k = 0; k < {len(outputs)}; k++)", "        result[k] = NAN;", "    return 1;", "}"]
    body = [f"const @ *piece = {p.name}_piece(t[0]);", "if (!piece)", *fail] if p.looks_up else []
    body += [f"const @ {line};" for line in lines]
    body += [f"result[{k}] = {x};" for k, x in enumerate(outputs)]
    body += [f"if (!({_each(p.checks)}))", *fail] if p.checks else []
    body += ["return 0;"] * p.may_fail
    unread = [f"(void){name};" for name in [*p.taken, "result"] if not _reads(name, body)]
    return [f"/* {sized(p)} */", c_signature(p), "{", *_indented([*unread, *body]), "}"]


def _each(checks: Sequence[str]) -> str:
    """Conditions as one expression, in lines."""
    kept = [check.replace(" ", "\0") for check in " && ".join(checks).split(" && ")]
    lines = textwrap.wrap(" &&\0".join(kept), WIDTH, break_long_words=False, break_on_hyphens=False)
    return "\n      ".join(lines).replace("\0", " ")


def _reads(name: str, lines: Sequence[str]) -> bool:
    return any(re.search(rf"\b{name}\b", line) for line in lines)


def c_look_up(p: Printable) -> list[str]:
    """Function in C or C++ that finds `piece` at a time."""
    texts = [f"{{{', '.join(row)}}}," for row in p.rows]
    lines = [line for text in texts for line in textwrap.wrap(text, WIDTH, subsequent_indent="    ")]
    count = len(p.rows)
    return f"""/* The argument `piece` at a time: begin, end and coefficients. 0 outside the samples. */
const @ *{p.name}_piece(@ t)
{{
    static const @ table[{count}][{len(p.rows[0])}] = {{
{textwrap.indent(chr(10).join(lines), "        ")}
    }};
    int lower = 0, upper = {count};
    while (upper - lower > 1) {{
        int middle = (lower + upper) / 2;
        if (table[middle][0] <= t)
            lower = middle;
        else
            upper = middle;
    }}
    return table[0][0] <= t && t <= table[{count - 1}][1] ? table[lower] : 0;
}}""".split("\n")


def _cpp(p: Printable, lines: list[str], outputs: list[str]) -> list[str]:
    return cpp_header(p.namespace, [cpp_function(p, lines, outputs)], p.heading)


def cpp_header(name: str, functions: Sequence[Sequence[str]], top: Sequence[str]) -> list[str]:
    """Header of C++17 with functions in a namespace."""
    head = [*(f"// {line}" for line in top), *CPP_HEAD, "", f"namespace {name} {{", ""]
    return [*head, *[line for function in functions for line in (*function, "")], f"}} // namespace {name}"]


def cpp_function(p: Printable, lines: Sequence[str], outputs: Sequence[str]) -> list[str]:
    """Function in C++; one that may fail returns an optional array, which is empty where it does."""
    found = f"std::array<@, {len(outputs)}>" if p.shape or p.may_fail else "@"
    body = [f"const auto {name} = {text};" for name, text in CPP.items() if _used([*lines, *outputs], {name: [text]})]
    fail = ["    return std::nullopt;", "}"]
    body += [f"const @* const piece = {p.name}_piece(t);", "if (piece == nullptr) {", *fail] if p.looks_up else []
    body += [f"const @ {line};" for line in lines]
    made = ",\n        ".join(outputs)
    made = f"{{\n        {made}}}" if outputs else ""
    body += [f"const {found} result{{{made}}};"] if p.may_fail else []
    body += [f"if (!({_each(p.checks)})) {{", *fail] if p.checks else []
    body += ["return result;" if p.may_fail else f"return {found}{{{made}}};" if p.shape else f"return {outputs[0]};"]
    arguments = list[str]()
    for name, width in p.taken.items():
        kind = p.members[name][0] if name in p.members else f"std::array<@, {width}>"
        kind = "@" if name == "t" else f"const {kind}&"
        arguments.append(f"{kind} {name}" if _reads(name, body) else kind)
    kind = f"std::optional<{found}>" if p.may_fail else found
    head = f"[[nodiscard]] inline {kind} {p.name}({', '.join(arguments)}) noexcept"
    table = c_look_up(p) if p.looks_up else []
    table = [f"inline {x}" if x.startswith("const") else x.replace(": 0;", ": nullptr;") for x in table]
    return [*table, f"// {sized(p)}", head, "{", *_indented(body), "}"]


def _member(name: str, k: int, width: int, members: Sequence[str]) -> str:
    """Text of an argument's entry in C++: of a structure, of the time, which is a number, or of an array."""
    return f"{name}.{members[k + 1]}" if members else name if name == "t" and width == 1 else f"{name}[{k}]"


def _rust(p: Printable, lines: list[str], outputs: list[str]) -> list[str]:
    arguments = [f"{name}: &[@; {width}]" for name, width in zip(p.arguments, p.trace.widths, strict=True)]
    body = [f"let {line.replace(' =', ': @ =', 1)};" for line in lines]
    body += [f"result[{k}] = {x};" for k, x in enumerate(outputs)]
    called = sorted({name for line in body for name in re.findall(r"unsafe { (\w+)\$", line)})
    libm = [f'extern "C" {{ fn {name}$({"y: @, x" if name == "atan2" else "x"}: @) -> @; }}' for name in called]
    head = [*(f"// {line}" for line in p.heading), "", f"/// {_size(p)}."]
    head += ["#[allow(non_snake_case, unused_parens, unused_unsafe, unused_variables, clippy::all)]"]
    head += [f"pub fn {p.name}({', '.join(arguments)}, result: &mut [@; {len(outputs)}]) {{"]
    return [*head, *_indented([*libm, *_used(body, RUST), *body]), "}"]  # names of libm are known only in the function


def _size(p: Printable) -> str:
    return f"{' x '.join(map(str, p.shape))} entries, row by row" if p.shape else "1 entry"


def sized(p: Printable) -> str:
    """Comment on the results of a function in C or C++, and on its failure."""
    where = ["M is singular to rounding, or a number is not finite"] * bool(p.checks)
    where += ["the time is outside the samples"] * p.looks_up
    how = "Empty where" if p.namespace else "Returns 0, or 1 with NaN in the result where"
    return f"{_size(p)}." + f" {how} {', or '.join(where)}." * bool(where)


def _indented(lines: Sequence[str]) -> list[str]:
    return [f"    {line}" for line in lines]


# Functions that a language lacks, or that differ from NumPy's where an operand is NaN or infinite. In C and Rust @ is
# the type of numbers, $ the end of the names in libm.
PYTHON = {"sign": ["def sign(x):", "    return 1.0 if x > 0 else -1.0 if x < 0 else x"]}
C = {"sign": ["static @ sign(@ x) { return x > 0 ? 1 : x < 0 ? -1 : x; }"]}
RUST = {"sign": ["fn sign(x: @) -> @ { if x > 0.0 { 1.0 } else if x < 0.0 { -1.0 } else { x } }"]}
MATLAB = {"root": ["function y = root(x)", "  y = where(x < 0, NaN, sqrt(abs(x)));", "end"]}
CPP = {"sign": "[](@ u0) noexcept { return u0 > 0 ? @(1) : u0 < 0 ? @(-1) : u0; }"}
CPP_HEAD = [
    "#pragma once",
    "#include <array>",
    "#include <cmath>",
    "#include <cstddef>",
    "#include <limits>",
    "#include <optional>",
]
for _k, _sign in {"minimum": "<=", "maximum": ">="}.items():
    CPP[_k] = f"[](@ u0, @ u1) noexcept {{ return u0 {_sign} u1 || u0 != u0 ? u0 : u1; }}"
    PYTHON[_k] = [f"def {_k}(a, b):", f"    return a if a {_sign} b or a != a else b"]
    C[_k] = [f"static @ {_k}(@ a, @ b) {{ return a {_sign} b || a != a ? a : b; }}"]
    RUST[_k] = [f"fn {_k}(a: @, b: @) -> @ {{ if a {_sign} b || a.is_nan() {{ a }} else {{ b }} }}"]
    MATLAB[_k] = [f"function x = {_k}(a, b)", f"  x = where(a {_sign} b || isnan(a), a, b);", "end"]
MATLAB["where"] = ["function x = where(c, a, b)", "  if c ~= 0, x = a; else, x = b; end", "end"]
LIBM = {name: f"{name}$({{}})" for name in ("sin", "cos", "sqrt", "tanh", "exp")}
LIBM |= {"abs": "fabs$({})", "arctan2": "atan2$({}, {})"}
CHOICES = ("minimum", "maximum", "sign", "less", "less_equal", "where")
# Words of the languages and of their mathematics that are none of Python's, and no names of functions.
RESERVED = """INFINITY NAN abstract arctan2 asm auto become box catch char classdef const crate default do double drem
    dyn elseif end enum exp10 extern false fdim final finite float fma fmax fmin fn function goto ilogb impl
    inline int j0 j1 jn let linux llrint llround logb long loop lrint lround macro main maximum minimum mod
    move mut nearbyint nexttoward np otherwise override parfor persistent priv pub ref register remquo
    restrict result rint root scalb scalbln scalbn self Self short sign signbit signed significand sizeof spmd
    static struct super switch tgamma trait true typedef typeof union unix unsafe unsigned unsized use virtual
    void volatile where y0 y1 yn zeros"""


def _single(x: float) -> str:
    """Shortest decimal number that rounds to x in single precision."""
    if float(np.finfo(np.float32).max) < x < float("inf"):
        raise ValueError(f"`dtype` must be 'float64': the program has the constant {x!r}, which float32 cannot hold")
    return str(np.float32(x))


class Language(NamedTuple):
    """Text of the whole function, of functions that differ from Python's, of constants and of an argument's entry."""

    text: Callable[[Printable, list[str], list[str]], list[str]]
    functions: Mapping[str, str] = {}
    types: Mapping[str, tuple[str, str]] = {"float64": ("", "")}  # what @ and $ stand for, by dtype
    literal: str = "{}"
    entry: Callable[[str, int], str] = "{}[{}]".format


def _special(less: str, where: str, infinity: str, nan: str) -> dict[str, str]:
    """Texts of comparisons, choices and constants that are not finite."""
    return {"less": less, "less_equal": less.replace(" < ", " <= "), "where": where, "inf": infinity, "nan": nan}


IN_NUMPY = {name: f"np.{name}({{}})" for name in ("sin", "cos", "sqrt", "tanh", "exp", "sign", "abs")}
IN_NUMPY |= {name: f"np.{name}({{}}, {{}})" for name in ("minimum", "maximum", "arctan2")}
IN_NUMPY |= {name: f"np.{name}({{}}, {{}}).astype(float)" for name in ("less", "less_equal")}
IN_NUMPY |= {"where": "np.where({} != 0, {}, {})", "inf": "np.inf", "nan": "np.nan"}
IN_MATLAB = {
    "less": "double({} < {})",
    "less_equal": "double({} <= {})",
    "where": "where({}, {}, {})",
    "sqrt": "root({})",
}
IN_C = LIBM | _special("(@)({} < {})", "({} != 0 ? {} : {})", "INFINITY", "NAN")
LIMITS = "std::numeric_limits<@>::infinity()", "std::numeric_limits<@>::quiet_NaN()"
IN_CPP = {kind: f"std::{call.replace('$', '')}" for kind, call in LIBM.items()}
IN_CPP |= _special("static_cast<@>({} < {})", "({} != 0 ? {} : {})", *LIMITS)
IN_RUST = {kind: f"unsafe {{{{ {call} }}}}" for kind, call in LIBM.items()} | _special(
    "(if {} < {} {{ 1.0 }} else {{ 0.0 }})", "(if {} != 0.0 {{ {} }} else {{ {} }})", "@::INFINITY", "@::NAN"
)
C_TYPES = {"float64": ("double", ""), "float32": ("float", "f")}
LANGUAGES = {
    "python": Language(_python),
    "numpy": Language(_numpy, IN_NUMPY, entry="{}[..., {}]".format),
    "matlab": Language(_matlab, IN_MATLAB, entry=lambda name, k: f"{name}({k + 1})"),
    "c": Language(_c, IN_C, C_TYPES, "{}$"),
    "c++": Language(_cpp, IN_CPP, C_TYPES, "{}$"),
    "rust": Language(_rust, IN_RUST, {"float64": ("f64", ""), "float32": ("f32", "f")}),
}


def quantity_of_element(element: str) -> str:
    """Quantity of an entry, by the letters of its name; ValueError if there is none."""
    quantities = {letters: quantity for quantity, letters in LETTERS.items()}
    if (letters := re.sub(r"[0-9_]*$", "", element)) not in quantities:
        raise ValueError(f"`element` must start with one of {list(quantities)}, got {element!r}")
    return quantities[letters]


def entry_of_element(element: str, quantity: str, shape: Sequence[int]) -> tuple[int, ...]:
    """Index of an entry such as "m23", "c3" or, beyond nine joints, "m2_13": (1, 2), (2,), (1, 12)."""
    if quantity not in LETTERS:
        raise ValueError(f"`element` is for {', '.join(LETTERS)}; entries of {quantity} have no names")
    letters = LETTERS[quantity]
    one, two = r"([1-9][0-9]*)", r"([1-9])([1-9])|([1-9][0-9]*)_([1-9][0-9]*)"
    match = re.fullmatch(f"{letters}(?:{one if len(shape) == 1 else two})", str(element))
    entry = tuple(int(number) - 1 for number in match.groups() if number) if match else ()
    if not entry or any(k >= size for k, size in zip(entry, shape, strict=True)):
        between = "_" if max(shape) > 9 else ""
        first, last = (letters + between.join(str(number(size)) for size in shape) for number in (lambda _: 1, int))
        raise ValueError(f"`element` of {quantity} must be one of {first} ... {last}, got {element!r}")
    return entry


def heading(
    model: Model, quantity: str, arguments: Sequence[str], entry: tuple[int, ...] | None, wrenches: Mapping[str, str]
) -> list[str]:
    """Lines of the comment, without comment signs; `wrenches` has the link of each argument that is a wrench."""
    sliding = [not model.is_revolute[i] for i in model.independent_joints]
    what = f"{harmless(quantity)} of robot {harmless(model.name)}"
    if entry is not None:
        what = f"Entry {', '.join(str(k + 1) for k in entry)} of {what}"
    names = ", ".join(f"{k} {harmless(name)}" for k, name in enumerate(model.joint_names, 1))
    texts = [f"Joints in order - {names or 'none'}"]
    for title, kind in (("rotating", 0), ("sliding", 1)):
        joints = [k for k, slides in enumerate(sliding) if slides == bool(kind)]
        units = [f"{name} {UNITS[name][kind]}" for name in arguments if name in UNITS]
        if joints and units:
            which = "" if len(joints) == len(sliding) else f" of {title} joints {', '.join(str(k + 1) for k in joints)}"
            texts.append(f"Units{which} - {', '.join(units)}")
    for name, link in wrenches.items():
        where = f"on link {harmless(link)} at its origin, in its axes"
        texts.append(f"{name} - moment N m, then force N, {where}")
    if quantity in LAWS:
        rest = "; then rates of the states z, or z of a discrete law at the next sample" if "z" in arguments else ""
        texts.append(f"Result - torques without the limits and delays of a scene, so clip them{rest}")
    if "piece" in arguments:
        powers = "coefficients of all joints by ascending powers of (t - begin) / (end - begin)"
        texts.append(f"piece - of the motion through samples that holds at t, begin s, end s, {powers}")
    ordered = {"parameters": "parameters" in arguments, "Columns of the result": quantity in REGRESSORS}
    texts += [f"{of_what} - {TEN}" for of_what, there in ordered.items() if there]
    if any(ordered.values()):
        bodies = ", ".join(f"{k} {harmless(name)}" for k, name in enumerate(model.moving_joints, 1))
        texts.append(f"Bodies by their joints - {bodies or 'none'}")
    return [what, *_wrapped(texts), f"Unit of the result - {_unit(quantity, sliding, entry)}"]


def harmless(name: str) -> str:
    """Name in which all but ASCII letters, digits, spaces and _.+- is escaped."""
    return re.sub(r"[^A-Za-z0-9_.+ -]", lambda match: f"<U+{ord(match.group()):04X}>", name[:MAX_NAME])


def _unit(quantity: str, sliding: Sequence[bool], entry: tuple[int, ...] | None) -> str:
    places: Iterable[int] = range(len(sliding))
    if quantity in SCALAR:
        return SCALAR[quantity]
    if quantity in PER_JOINT:
        units = UNITS[PER_JOINT[quantity]]
        found = [units[sliding[k]] for k in (places if entry is None else entry)]
    elif quantity == "mass_matrix":
        pairs = [(i, j) for i in places for j in places] if entry is None else [(entry[0], entry[1])]
        found = [MASS[sliding[i] + sliding[j]] for i, j in pairs]
    else:
        return "SI"
    return " or ".join(dict.fromkeys(found)) or "none"
