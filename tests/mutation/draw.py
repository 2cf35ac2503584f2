"""Mutants of a source file, and a seeded draw of equal numbers from each folder.

A mutant replaces one operator, number, comparison, sign, index or truth value. Annotations, decorators, docstrings, texts of
messages, `__all__` and blocks for type checking are left alone, since no test of numbers can tell.
"""

import ast
import itertools
import random
import re
from dataclasses import dataclass

FOLDERS = ("kernels", "dynamics", "control", "model", "urdf", "robot", "basics", "trajectories", "simulation")
FOLDERS += ("identification",)
OPERATORS = {"Add": "-", "Sub": "+", "Mult": "/", "Div": "*", "FloorDiv": "*", "Mod": "//", "Pow": "*", "MatMult": "*"}
OPERATORS |= {"BitAnd": "|", "BitOr": "&", "BitXor": "&", "LShift": ">>", "RShift": "<<"}
OPPOSITES = {"Lt": ">=", "LtE": ">", "Gt": "<=", "GtE": "<", "Eq": "!=", "NotEq": "=="}
OPPOSITES |= {"In": "not in", "NotIn": "in", "Is": "is not", "IsNot": "is"}
AT_EQUALITY = {"Lt": "<=", "LtE": "<", "Gt": ">=", "GtE": ">"}
NAMES = {"min": "max", "minimum": "maximum", "argmin": "argmax", "fmin": "fmax", "any": "all"}
NAMES |= {new: old for old, new in NAMES.items()}
ORDINARY = 1e-3, 1e3  # magnitudes that are doubled; tolerances and bounds beyond are moved by 10^4
SHOWN = 60  # characters of code around a replacement


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

    def key(self):
        return self.file, self.source, self.old, self.new

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
        return None if meaning[1] == ast.dump(ast.parse((root / self.file).read_bytes())) else meaning


class Candidates(ast.NodeVisitor):
    """Collects (node to show, start, end, replacement): byte ranges of one file that can be replaced."""

    def __init__(self, text):
        self.data = text.encode()
        self.offsets = [0, *(m.end() for m in re.finditer(rb"\n", self.data))]
        self.found, self.above = [], []
        self.visit(ast.parse(text))

    def span(self, node):
        end = self.offsets[node.end_lineno - 1] + node.end_col_offset
        return self.offsets[node.lineno - 1] + node.col_offset, end

    def replace(self, node, by, part=None):
        """Show it with the largest expression around it that is still short."""
        part = self.span(node) if part is None else part
        for outer in reversed([n for n in self.above if isinstance(n, ast.expr | ast.Assign | ast.Return)]):
            start, end = self.span(outer)
            if end - start > SHOWN:
                break
            node = outer
        self.found.append((node, *part, by))

    def operator(self, node, left, right, by):
        """Replace the operator between two operands."""
        start, end = self.span(left)[1], self.span(right)[0]
        symbol = re.search(rb"is\s+not|not\s+in|[a-z]+|[^\s()\\]+", self.data[start:end])
        self.replace(node, by, (start + symbol.start(), start + symbol.end()))

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
            self.generic_visit(node)

    def visit_Assign(self, node):
        if getattr(node.targets[0], "id", "") != "__all__":
            self.generic_visit(node)

    def visit_Constant(self, node):
        if isinstance(node.value, bool):
            self.replace(node, str(not node.value))
        elif isinstance(node.value, int):
            few = node.value <= 10
            for changed in (node.value + 1, abs(node.value - 1)) if few else (2 * node.value,):
                self.replace(node, str(changed))
        elif isinstance(node.value, float):
            size = abs(node.value)
            factor = 2 if ORDINARY[0] <= size <= ORDINARY[1] else 1e4 if size < 1 else 1e-4
            self.replace(node, repr(node.value * factor or 1.0))

    def visit_BinOp(self, node):
        if not is_text(node):
            self.operator(node, node.left, node.right, OPERATORS[type(node.op).__name__])
            if isinstance(node.op, ast.Mult | ast.Div | ast.MatMult):
                start, end = self.span(node)
                self.replace(node, f"(-({self.data[start:end].decode()}))")
        self.generic_visit(node)

    def visit_AugAssign(self, node):
        if not is_text(node.value):
            self.operator(node, node.target, node.value, OPERATORS[type(node.op).__name__] + "=")
        self.generic_visit(node)

    def visit_Compare(self, node):
        left = node.left
        for op, right in zip(node.ops, node.comparators, strict=True):
            kind = type(op).__name__
            self.operator(node, left, right, OPPOSITES[kind])
            if kind in AT_EQUALITY and any(is_count(s) for s in (left, right)):
                self.operator(node, left, right, AT_EQUALITY[kind])
            left = right
        self.generic_visit(node)

    def visit_BoolOp(self, node):
        for left, right in itertools.pairwise(node.values):
            self.operator(node, left, right, "or" if isinstance(node.op, ast.And) else "and")
        self.generic_visit(node)

    def visit_UnaryOp(self, node):
        if isinstance(node.op, ast.USub | ast.Not):
            start = self.span(node)[0]
            self.replace(node, "", (start, start + (3 if isinstance(node.op, ast.Not) else 1)))
        self.generic_visit(node)

    def visit_Subscript(self, node):
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        for index in indices:
            if isinstance(index, ast.Slice):
                for bound in filter(None, (index.lower, index.upper)):
                    self.replace(node, "", self.span(bound))
            elif isinstance(index, ast.Name) and len(index.id) == 1:  # an index, where words are keys
                self.replace(node, f"{index.id} - 1", self.span(index))
        self.generic_visit(node)

    def visit_Name(self, node):
        if node.id in NAMES:
            self.replace(node, NAMES[node.id])

    def visit_Attribute(self, node):
        if node.attr in NAMES:
            end = self.span(node)[1]
            self.replace(node, NAMES[node.attr], (end - len(node.attr), end))
        self.generic_visit(node)

    def visit_Call(self, node):
        if getattr(node.func, "id", "") not in ("isinstance", "issubclass", "TypeVar", "cast"):
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


def candidates(root, file):
    """Replacements in a file, by line; some may not compile, or mean the same."""
    text = (root / file).read_text(encoding="utf-8")
    collected, lines, by_line = Candidates(text), text.splitlines(), {}
    data = collected.data
    for node, start, end, by in collected.found:
        line, (low, high) = data.count(b"\n", 0, start) + 1, collected.span(node)
        old, new = data[low:high], data[low:start] + by.encode() + data[end:high]
        old, new = (" ".join(text.decode().split()) for text in (old, new))
        by_line.setdefault((file, line), []).append(
            Mutant(file, line, lines[line - 1].strip(), old, new, start, end, by)
        )
    return by_line


def draw(root, number, seed, folders=FOLDERS):
    """Mutants on lines drawn at random, equal numbers from each folder; the same for the same tree and seed."""
    drawn = []
    for k, folder in enumerate(folders):
        by_line = {}
        for path in sorted((root / "rne" / folder).rglob("*.py")):
            by_line |= candidates(root, str(path.relative_to(root)))
        generator, seen, chosen = random.Random(f"{seed} {folder}"), [], []
        share = number * (k + 1) // len(folders) - number * k // len(folders)
        while by_line and len(chosen) < share:
            for line in generator.sample(sorted(by_line), len(by_line)):
                mutant = by_line[line].pop(generator.randrange(len(by_line[line])))
                if not by_line[line]:
                    del by_line[line]
                if len(chosen) < share and (meaning := mutant.meaning(root)) not in {*seen, None}:
                    seen.append(meaning)
                    chosen.append(mutant)
        drawn += sorted(chosen, key=lambda m: (m.file, m.start, m.by))
    return drawn
