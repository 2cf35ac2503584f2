"""Text in C or C++ of several kernels.

`unit({"tau": kernel, "qdd": other}, name="ur10")` prints each kernel as a function `ur10_tau`, `ur10_qdd` in C, or as
`ur10::tau`, `ur10::qdd` in C++. What they share is printed once: lines of their comments at the top, and in C the
helpers, which are static. A function has the arguments of its kernel, whether it reads them or not, so that the
signature does not depend on the robot's numbers. Three rules differ from a kernel's call: arguments without entries are
left out; the function itself finds the `piece` of a motion through samples at its argument t; and where M may be
singular or a time may be outside the samples the function reports failure, in C by returning 1, with NaN in the result,
in C++ by an empty std::optional. Functions have no memory, allocate nothing, and may be called from many threads.

Arguments for numbers of a robot or scene are arguments of the kernels: see `rne.simulation.named_numbers`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from .kernel import Kernel
from .source import (
    Printable,
    c_function,
    c_helpers,
    c_look_up,
    c_signature,
    checked_name,
    cpp_function,
    cpp_header,
    sized,
    written,
)


class Unit(NamedTuple):
    """Text of several kernels; see `unit`."""

    functions: Mapping[str, Printable]  # by their keys, with names as in the text
    header: str
    source: str  # in C; empty in C++, whose header is all


def unit(
    kernels: Mapping[str, Kernel],
    language: str = "c",
    *,
    name: str,
    dtype: str = "float64",
    static: bool = False,
    notes: Sequence[str] = (),
    members: Mapping[str, Sequence[str]] | None = None,
    inside: Sequence[str] = (),
) -> Unit:
    """Kernels of one robot, by the names of their functions, as functions of one text.

    Names of functions begin with `name` in C; in C++ it is the namespace. Functions in C that are `static` need no
    header. `notes` are further lines of plain ASCII for the comment at the top; `members` are arguments that are
    structures in C++, each with its type and the names of its entries; `inside` are lines in C++ before the functions,
    with @ for the type of numbers.

    Raises a ValueError if a name, the language or the dtype is none, or float32 cannot hold a constant, a TypeError if
    a kernel is too large to be written out.
    """
    checked_name("name", name)
    is_c, parts = language == "c", []
    for key, kernel in kernels.items():
        own = checked_name("kernels", f"{name}_{key}" if is_c else key, kernel.names)
        printed = kernel.printed()._replace(name=own, members=members or {}, looks_up=len(kernel.table) > 0)
        parts.append(written(printed._replace(namespace="" if is_c else name), language, dtype))
    found = [part.printable for part in parts]
    common = [line for line in found[0].heading if all(line in p.heading for p in found)] if found else []
    top = [*notes, *common]
    sign, prefix = ("/* {} */", "static " * static) if is_c else ("// {}", "")
    comments = [[sign.format(line) for line in p.heading if line not in common] for p in found]
    functions, finished = dict(zip(kernels, found, strict=True)), parts[0].finished
    if not is_c:
        texts = [[*lines, *cpp_function(*part[:3])] for lines, part in zip(comments, parts, strict=True)]
        return Unit(functions, finished([*cpp_header(name, [inside, *texts] if inside else texts, top), ""]), "")
    above = comments if static else [[] for _ in comments]  # what the header has
    texts = [["", *lines, *_c_definition(*part[:3], prefix)] for lines, part in zip(above, parts, strict=True)]
    included = ["#include <math.h>"] if static else [f'#include "{name}.h"', "", "#include <math.h>"]
    every = [line for part in parts for line in (*part.lines, *part.outputs)]
    head = [*map(sign.format, top), *included, "", *c_helpers(every, [])]
    source = finished([*head[:-1], *(line for text in texts for line in text), ""])
    guard = f"{name.upper()}_H"
    header = [*map(sign.format, top), f"#ifndef {guard}", f"#define {guard}", *OPENED, ""]
    for lines, p in zip(comments, found, strict=True):
        header += [*lines, f"/* {sized(p)} */", f"{c_signature(p)};", ""]
    return Unit(functions, finished([*header, *CLOSED, "#endif", ""]), source)


OPENED = "#ifdef __cplusplus", 'extern "C" {', "#endif"
CLOSED = "#ifdef __cplusplus", "}", "#endif"


def _c_definition(p: Printable, lines: Sequence[str], outputs: Sequence[str], prefix: str) -> list[str]:
    """Function in C, after the look-up of its piece."""
    table = c_look_up(p) if p.looks_up else []
    table = [f"static {line}" if line.startswith("const") else line for line in table]
    comment, signature, *rest = c_function(p, lines, outputs)
    return [*table, comment, prefix + signature, *rest]
