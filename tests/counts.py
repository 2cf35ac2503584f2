"""Counts of the package that are to stay small, printed by `python -m tests.counts`; ceilings in test_architecture.py.

A name is public if users have its value by name: a function or class of `rne` or of one of its public modules.
"""

import ast
import collections
import functools
import importlib
import inspect
import subprocess
import tokenize
import tomllib

import rne

from .helpers import ROOT

PACKAGE = ROOT / "rne"
LONG, BRANCHED = 40, 15  # lines of a function besides its docstring; branches of one that is read in one go
BRANCHES = (
    ast.If | ast.IfExp | ast.For | ast.While | ast.ExceptHandler | ast.Assert | ast.comprehension | ast.match_case
)
FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef
TUPLES = {"_replace", "_make", "_fields", "_asdict"}  # what every named tuple has, public by Python's documentation


def trees(folder):
    """Syntax trees of the Python files below a folder, by path."""
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.py"))}


@functools.cache
def nodes(tree):
    """All nodes of a syntax tree."""
    return list(ast.walk(tree))


def docstring_lines(tree):
    """Line numbers of all docstrings of a file."""
    found = set()
    for node in nodes(tree):
        if isinstance(node, ast.Module | ast.ClassDef | FUNCTIONS) and ast.get_docstring(node, clean=False) is not None:
            found.update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return found


def lines_by_kind(path, tree):
    """Numbers of a file's lines by kind: docstrings, imports, blank, comments of their own, code."""
    documented = docstring_lines(tree)
    imports = {
        k for n in nodes(tree) if isinstance(n, ast.Import | ast.ImportFrom) for k in range(n.lineno, n.end_lineno + 1)
    }
    kinds = collections.Counter()
    for k, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        blank, comment = not text.strip(), text.lstrip().startswith("#")
        kind = "comments" if comment else "code"
        kinds["docstrings" if k in documented else "imports" if k in imports else "blank" if blank else kind] += 1
    return kinds


def public_values():
    """Identities of what users have by name: the command, functions and classes of `rne` and of its public modules."""
    commands = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"].values()
    modules = [thing for name in rne.__all__ if inspect.ismodule(thing := getattr(rne, name))]
    listed = [(module, name) for module in (rne, *modules) for name in getattr(module, "__all__", dir(module))]
    listed += [(importlib.import_module(module), name) for module, _, name in (x.partition(":") for x in commands)]
    things = (getattr(module, name) for module, name in listed)
    return {id(thing) for thing in things if hasattr(thing, "__name__")}  # equal numbers may be one object


def internal_names(folder):
    """Names that files of a folder import from modules of rne and that are not public, with the files that do."""
    public, users = public_values(), collections.defaultdict(set)
    for path, tree in trees(folder).items():
        for node in nodes(tree):
            if isinstance(node, ast.ImportFrom) and not node.level and node.module.split(".")[0] == "rne":
                module = importlib.import_module(node.module)
                for alias in node.names:
                    whole = f"{node.module}.{alias.name}"
                    thing = (
                        getattr(module, alias.name) if hasattr(module, alias.name) else importlib.import_module(whole)
                    )
                    if id(thing) not in public and getattr(rne, alias.name, None) is not thing:
                        users[whole].add(path)
    return users


def private_accesses(path, tree):
    """Accesses `x._name` to what is neither self's, cls's, a named tuple's, nor a member that the same file defines."""
    own = {n.name for n in nodes(tree) if isinstance(n, ast.ClassDef | FUNCTIONS)} | TUPLES
    own |= {n.attr for n in nodes(tree) if isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Store)}
    own |= {n.target.id for n in nodes(tree) if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)}
    for node in nodes(tree):
        if isinstance(node, ast.Attribute) and node.attr.startswith("_") and not node.attr.startswith("__"):
            of = node.value.id if isinstance(node.value, ast.Name) else ""
            if of not in ("self", "cls") and node.attr not in own:
                yield f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}"


def ignored(path):
    """Comments that switch the type checker off, in a file."""
    with path.open("rb") as file:
        tokens = list(tokenize.tokenize(file.readline))
    return [t for t in tokens if t.type == tokenize.COMMENT and "type: ignore" in t.string]


def inside(function):
    """Nodes of a function without those of functions and classes in it."""
    for child in ast.iter_child_nodes(function):
        if not isinstance(child, FUNCTIONS | ast.ClassDef):
            yield child
            yield from inside(child)


def code_lines(function):
    """Number of a function's lines besides its docstring and decorators."""
    documented = ast.get_docstring(function, clean=False) is not None
    first = function.body[0]
    return function.end_lineno - function.lineno + 1 - (first.end_lineno - first.lineno + 1 if documented else 0)


def branches(function):
    """Number of ways that a function can take at once: its conditions, loops and cases, and one."""
    return 1 + sum(
        isinstance(n, BRANCHES) or (isinstance(n, ast.BoolOp) and len(n.values) - 1) for n in inside(function)
    )


def counts():
    """Number of each kind, by its name."""
    sources = trees(PACKAGE)
    functions = [n for tree in sources.values() for n in nodes(tree) if isinstance(n, FUNCTIONS)]
    listed = subprocess.run(["git", "ls-files", "rne"], capture_output=True, text=True, cwd=ROOT, check=True).stdout
    lines = sum((lines_by_kind(path, tree) for path, tree in sources.items()), collections.Counter())
    return {
        "lines": lines.total(),
        **{f"lines: {kind}": number for kind, number in lines.most_common()},
        "files": len(sources),
        "entries at the top": len({name.split("/")[1] for name in listed.split()}),
        "public names": len([name for name in rne.__all__ if not inspect.ismodule(getattr(rne, name))]),
        "internal names imported by tests": len(internal_names(ROOT / "tests")),
        "type: ignore": sum(len(ignored(path)) for path in sources),
        "private accesses": sum(len([*private_accesses(path, tree)]) for path, tree in sources.items()),
        f"functions over {LONG} lines": sum(code_lines(f) > LONG for f in functions),
        f"functions over {BRANCHED} branches": sum(branches(f) > BRANCHED for f in functions),
    }


if __name__ == "__main__":
    found = counts()
    print(*(f"{name:{max(map(len, found))}}  {number:6,}" for name, number in found.items()), sep="\n")
