"""Mutants of a source file, and a seeded draw from all folders in proportion to their code.

A mutant changes one operator, constant, comparison, sign or index, swaps two arguments, drops a keyword, a term or a
statement, or negates a condition. Annotations, decorators, docstrings, texts of messages, `__all__`, the `strict` of zip and blocks for
type checking are left alone, since no test of numbers can tell.
"""

import ast
import functools
import itertools
import random
import re
from dataclasses import dataclass

ROOT_FILES = "rne"  # the name of the files that are in no folder
OPERATORS = {"Add": "-", "Sub": "+", "Mult": "/", "Div": "*", "FloorDiv": "*", "Mod": "//", "Pow": "*", "MatMult": "*"}
OPERATORS |= {"BitAnd": "|", "BitOr": "&", "BitXor": "&", "LShift": ">>", "RShift": "<<"}
OPPOSITES = {"Lt": ">=", "LtE": ">", "Gt": "<=", "GtE": "<", "Eq": "!=", "NotEq": "=="}
OPPOSITES |= {"In": "not in", "NotIn": "in", "Is": "is not", "IsNot": "is"}
AT_EQUALITY = {"Lt": "<=", "LtE": "<", "Gt": ">=", "GtE": ">"}
NAMES = {"min": "max", "minimum": "maximum", "argmin": "argmax", "fmin": "fmax", "any": "all"}
NAMES |= {new: old for old, new in NAMES.items()}
ORDINARY = 1e-3, 1e3  # magnitudes that are doubled; tolerances and bounds beyond are moved by 10^4
SHOWN = 60  # characters of code around a replacement
NO_STATEMENT = "pass"


@dataclass(frozen=True)
class Mutant:
    """One replacement: `source` is the line as it stands, which finds the mutant again when line numbers have moved."""

    file: str
    line: int
    source: str
    old: str
    new: str
    start: int  # byte offsets of the text that is replaced
    end: int
    by: str
    change: str  # what kind of change it is

    @property
    def folder(self):
        return self.file.split("/")[1] if self.file.count("/") > 1 else ROOT_FILES

    def key(self):
        return self.source, self.old, self.new

    def __str__(self):
        return f"{self.file}:{self.line}: {self.old} -> {self.new}"

    def broken(self, root):
        """The file's bytes with the replacement made."""
        data = (root / self.file).read_bytes()
        return data[: self.start] + self.by.encode() + data[self.end :]

    def meaning(self, root):
        """What the broken file says; None if it does not compile or says what it said."""
        try:
            meaning = self.file, ast.dump(ast.parse(self.broken(root)))
        except SyntaxError:
            return None
        return None if meaning[1] == meaning_of((root / self.file).read_bytes()) else meaning


class Candidates(ast.NodeVisitor):
    """Collects (node to show, start, end, replacement, change): byte ranges of one file that can be replaced."""

    def __init__(self, text):
        self.data = text.encode()
        self.offsets = [0, *(m.end() for m in re.finditer(rb"\n", self.data))]
        self.found, self.above = [], []
        self.visit(ast.parse(text))

    def span(self, node):
        end = self.offsets[node.end_lineno - 1] + node.end_col_offset
        return self.offsets[node.lineno - 1] + node.col_offset, end

    def replace(self, node, by, change, part=None):
        """Show it with the largest expression around it that is still short."""
        part = self.span(node) if part is None else part
        for outer in reversed([n for n in self.above if isinstance(n, ast.expr | ast.Assign | ast.Return)]):
            start, end = self.span(outer)
            if end - start > SHOWN:
                break
            node = outer
        self.found.append((node, *part, by, change))

    def source(self, node):
        start, end = self.span(node)
        return self.data[start:end].decode()

    def operator(self, node, left, right, by, change="operator"):
        """Replace the operator between two operands."""
        start, end = self.span(left)[1], self.span(right)[0]
        symbol = re.search(rb"is\s+not|not\s+in|[a-z]+|[^\s()\\]+", self.data[start:end])
        self.replace(node, by, change, (start + symbol.start(), start + symbol.end()))

    def negate(self, condition):
        self.replace(condition, f"(not ({self.source(condition)}))", "negated condition")

    def visit(self, node):
        self.above.append(node)
        super().visit(node)
        self.above.pop()

    def generic_visit(self, node):
        """Visit what the tests of numbers can see."""
        for name, value in ast.iter_fields(node):
            if name not in ("annotation", "returns", "decorator_list", "type_params", "format_spec"):
                for child in value if isinstance(value, list) else [value]:
                    if isinstance(child, ast.AST):
                        self.visit(child)

    def visit_JoinedStr(self, node):
        """Text of a message."""

    def visit_If(self, node):
        if getattr(node.test, "id", "") != "TYPE_CHECKING":
            self.negate(node.test)
            self.generic_visit(node)

    def visit_IfExp(self, node):
        self.negate(node.test)
        self.generic_visit(node)

    visit_While = visit_IfExp

    def visit_comprehension(self, node):
        for condition in node.ifs:
            self.negate(condition)
        self.generic_visit(node)

    def visit_Assign(self, node):
        """Without the new value of an entry or an attribute."""
        if not isinstance(node.targets[0], ast.Name | ast.Tuple):
            self.replace(node, NO_STATEMENT, "removed statement")
        if getattr(node.targets[0], "id", "") != "__all__":
            self.generic_visit(node)

    def visit_Expr(self, node):
        if isinstance(node.value, ast.Call):
            self.replace(node, NO_STATEMENT, "removed statement")
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)

    def visit_Raise(self, node):
        """Its text is left alone, but for the arguments that it is made of."""
        self.replace(node, NO_STATEMENT, "removed statement")
        self.generic_visit(node)

    def visit_Continue(self, node):
        self.replace(node, NO_STATEMENT, "removed statement")

    visit_Break = visit_Continue

    def visit_Constant(self, node):
        if isinstance(node.value, bool):
            self.replace(node, str(not node.value), "constant")
        elif isinstance(node.value, int):
            few = node.value <= 10
            for changed in (node.value + 1, abs(node.value - 1)) if few else (2 * node.value,):
                self.replace(node, str(changed), "constant")
        elif isinstance(node.value, float):
            size = abs(node.value)
            factor = 2 if ORDINARY[0] <= size <= ORDINARY[1] else 1e4 if size < 1 else 1e-4
            self.replace(node, repr(node.value * factor or 1.0), "constant")

    def visit_BinOp(self, node):
        if not is_text(node):
            self.operator(node, node.left, node.right, OPERATORS[type(node.op).__name__])
            if isinstance(node.op, ast.Mult | ast.Div | ast.MatMult):
                self.replace(node, f"(-({self.source(node)}))", "sign")
            if isinstance(node.op, ast.Add | ast.Sub):
                self.replace(node, self.source(node.left), "dropped term")
                self.replace(node, "-" * isinstance(node.op, ast.Sub) + f"({self.source(node.right)})", "dropped term")
        self.generic_visit(node)

    def visit_AugAssign(self, node):
        self.replace(node, NO_STATEMENT, "removed statement")
        if not is_text(node.value):
            self.operator(node, node.target, node.value, OPERATORS[type(node.op).__name__] + "=")
        self.generic_visit(node)

    def visit_Compare(self, node):
        left = node.left
        for op, right in zip(node.ops, node.comparators, strict=True):
            kind = type(op).__name__
            self.operator(node, left, right, OPPOSITES[kind], "comparison")
            if kind in AT_EQUALITY and any(is_count(s) for s in (left, right)):
                self.operator(node, left, right, AT_EQUALITY[kind], "comparison")
            left = right
        self.generic_visit(node)

    def visit_BoolOp(self, node):
        for left, right in itertools.pairwise(node.values):
            self.operator(node, left, right, "or" if isinstance(node.op, ast.And) else "and", "condition")
            self.replace(node, "", "dropped term", (self.span(left)[1], self.span(right)[1]))
        self.generic_visit(node)

    def visit_UnaryOp(self, node):
        if isinstance(node.op, ast.USub | ast.Not):
            start = self.span(node)[0]
            self.replace(node, "", "sign", (start, start + (3 if isinstance(node.op, ast.Not) else 1)))
        self.generic_visit(node)

    def visit_Subscript(self, node):
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        for index in indices:
            if isinstance(index, ast.Slice):
                for bound in filter(None, (index.lower, index.upper)):
                    self.replace(node, "", "index", self.span(bound))
            elif isinstance(index, ast.Name) and len(index.id) == 1:  # an index, where words are keys
                self.replace(node, f"{index.id} - 1", "index", self.span(index))
        self.generic_visit(node)

    def visit_Name(self, node):
        if node.id in NAMES:
            self.replace(node, NAMES[node.id], "name")

    def visit_Attribute(self, node):
        if node.attr in NAMES:
            end = self.span(node)[1]
            self.replace(node, NAMES[node.attr], "name", (end - len(node.attr), end))
        self.generic_visit(node)

    def visit_Call(self, node):
        if getattr(node.func, "id", "") in ("isinstance", "issubclass", "TypeVar", "cast"):
            return
        for left, right in itertools.pairwise(node.args):
            if not any(isinstance(x, ast.Starred | ast.JoinedStr) for x in (left, right)):
                between = self.data[self.span(left)[1] : self.span(right)[0]].decode()
                swapped = self.source(right) + between + self.source(left)
                self.replace(node, swapped, "swapped arguments", (self.span(left)[0], self.span(right)[1]))
        before = [*node.args, *(word.value for word in node.keywords)]
        if getattr(node.func, "id", "") == "zip":
            node.keywords.clear()
        for k, word in enumerate(node.keywords):
            if word.arg is not None and len(before) > 1:
                last = len(node.args) + k
                start = self.span(before[last - 1])[1] if last else self.span(word)[0]
                end = self.span(word)[1] if last else self.span(node.keywords[1])[0]
                self.replace(node, "", "dropped keyword", (start, end))
            elif word.arg is not None:
                self.replace(node, "", "dropped keyword", self.span(word))
        self.generic_visit(node)


def is_text(node):
    """Whether + and * join texts or lists."""
    if isinstance(node, ast.BinOp):
        return is_text(node.left) or is_text(node.right)
    if isinstance(node, ast.Constant):
        return node.value is None or isinstance(node.value, str)  # X | None is a type
    name = getattr(node.func, "id", "") if isinstance(node, ast.Call) else ""
    return isinstance(node, ast.JoinedStr | ast.List | ast.Tuple | ast.ListComp) or name in ("str", "list", "tuple")


def is_count(node):
    """Whether equality decides, as among whole numbers, and seldom among measured ones."""
    return isinstance(getattr(node, "value", None), int) or getattr(getattr(node, "func", None), "id", "") == "len"


@functools.cache
def meaning_of(text):
    return ast.dump(ast.parse(text))


def candidates(root, file):
    """Replacements in a file, by line; some may not compile, or mean the same."""
    text = (root / file).read_text(encoding="utf-8")
    collected, lines, by_line = Candidates(text), text.splitlines(), {}
    data = collected.data
    for node, start, end, by, change in collected.found:
        line, (low, high) = data.count(b"\n", 0, start) + 1, collected.span(node)
        old, new = data[low:high], data[low:start] + by.encode() + data[end:high]
        old, new = (" ".join(text.decode().split()) for text in (old, new))
        by_line.setdefault((file, line), []).append(
            Mutant(file, line, lines[line - 1].strip(), old, new, start, end, by, change)
        )
    return by_line


def folders(root):
    """Files of each folder of the package, the largest folder first; files in no folder are one of their own."""
    found = {}
    for path in sorted((root / "rne").rglob("*.py")):
        file = str(path.relative_to(root))
        found.setdefault(file.split("/")[1] if file.count("/") > 1 else ROOT_FILES, []).append(file)
    return found


def shares(sizes, count, least):
    """How many mutants each folder gets: in proportion to its size, but at least some, as far as it has so many."""
    share = {folder: min(least, size) for folder, size in sizes.items()}
    while (left := count - sum(share.values())) > 0 and any(share[f] < sizes[f] for f in sizes):
        folder = max((f for f in sizes if share[f] < sizes[f]), key=lambda f: (sizes[f] / (share[f] + 1), f))
        share[folder] += 1 if left else 0
    return share


def draw(root, count, seed, least=0, only=None):
    """Mutants drawn at random: a line, a kind of change, one of it; the same for the same tree, seed and numbers.

    A folder's share is in proportion to its lines that can be changed. The mutants of `only` one folder are those that a
    draw from all has of it.
    """
    by_folder = {}
    for folder, files in folders(root).items():
        by_folder[folder] = {}
        for file in files:
            by_folder[folder] |= candidates(root, file)
    drawn, share = [], shares({folder: len(lines) for folder, lines in by_folder.items()}, count, least)
    for folder, by_line in by_folder.items():
        if only in (None, folder):
            drawn += of_folder(root, by_line, share[folder], random.Random(f"{seed} {folder}"))
    return drawn


def of_folder(root, by_line, share, generator):
    """Mutants of a folder's lines, at most one of a line until all lines have one."""
    seen, chosen = set(), []
    while by_line and len(chosen) < share:
        for line in generator.sample(sorted(by_line), len(by_line)):
            change = generator.choice(sorted({m.change for m in by_line[line]}))
            mutant = generator.choice([m for m in by_line[line] if m.change == change])
            by_line[line].remove(mutant)
            if not by_line[line]:
                del by_line[line]
            if len(chosen) < share and (meaning := mutant.meaning(root)) not in {*seen, None}:
                seen.add(meaning)
                chosen.append(mutant)
    return sorted(chosen, key=lambda m: (m.file, m.start, m.by))
