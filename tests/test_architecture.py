"""The structure of the package: imports go downwards only, importing is light, names are documented, README runs."""

import ast
import doctest
import graphlib
import importlib
import inspect
import pkgutil
import re
import subprocess
import sys

import pytest

import rne

from .helpers import ROOT

PACKAGE = ROOT / "rne"
# Each entry of rne/ imports only from floors below its own, and within itself.
FLOORS = [
    ["errors", "basics"],
    ["elementwise", "model"],
    ["dynamics", "trajectories"],
    ["kernels"],
    ["robot"],
    ["urdf", "control"],
    ["simulation", "validation"],
    ["plotting"],
    ["identification"],
    ["commands"],
    ["__init__", "__main__"],
]
FLOOR = {entry: k for k, floor in enumerate(FLOORS) for entry in floor}
SOURCES = sorted(PACKAGE.rglob("*.py"))
MAX_ENTRIES = 19  # of rne/: more are not taken in at a glance


def entry(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def module_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path, *, type_checking=False):
    """Modules a file imports, as dotted names from the package's root; those for type checking only if asked."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    skipped = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING" and not type_checking
        for inner in ast.walk(node)
    }
    package = path.relative_to(ROOT).with_suffix("").parts[:-1]
    for node in ast.walk(tree):
        if node in skipped:
            continue
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*base, *([node.module] if node.module else [])])
            yield from ([f"{module}.{alias.name}" for alias in node.names] if module == "rne" else [module])
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_downwards(path):
    for module in imports(path):
        parts = module.split(".")
        if parts[0] != "rne" or len(parts) < 2:
            continue
        own, other = FLOOR[entry(path)], FLOOR[parts[1]]
        assert other < own or parts[1] == entry(path), f"{path.name} imports {module}"


def test_no_module_imports_itself_through_others():
    modules = {module_of(path) for path in SOURCES}
    files = [p for p in SOURCES if p.stem != "__init__"]
    graph = {module_of(p): {m for m in imports(p, type_checking=True) if m in modules} for p in files}
    graph = {module: needed - {module} for module, needed in graph.items()}
    tuple(graphlib.TopologicalSorter(graph).static_order())  # a CycleError names the circle


def test_every_entry_has_a_floor_and_there_are_few():
    assert {entry(path) for path in SOURCES} == set(FLOOR)
    listed = subprocess.run(["git", "ls-files", "rne"], capture_output=True, text=True, cwd=ROOT, check=True).stdout
    assert len({name.split("/")[1] for name in listed.split()}) <= MAX_ENTRIES


def test_yourdfpy_is_used_for_pictures_only():
    """It is the independent second reader; the package reads the dynamics of a URDF with lxml alone."""
    users = {entry(p) for p in SOURCES if any(m.split(".")[0] == "yourdfpy" for m in imports(p))}
    assert users == {"plotting"}


def test_euler_lagrange_shares_the_kinematics_only():
    """It would be no test of the recursions if it stood on them; with them it shares how M is factorised and checked."""
    tree = ast.parse((PACKAGE / "dynamics" / "lagrange.py").read_text(encoding="utf-8"))
    taken = {
        node.module: {alias.name for alias in node.names}
        for node in tree.body
        if isinstance(node, ast.ImportFrom) and node.level == 1
    }
    assert taken.keys() == {"crba", "kinematics", "precision", "quantity"}
    assert taken["crba"] == {"factorise", "solve_factored"}
    assert taken["precision"] == {"check_accelerations"}


def test_import_loads_numpy_and_the_standard_library_only():
    code = "import sys, numpy; before = set(sys.modules); import rne; print(*sorted(set(sys.modules) - before))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    roots = {name.split(".")[0] for name in loaded.split()}
    assert roots <= {"rne", "numpy", *sys.stdlib_module_names}


def test_functions_are_small():
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                body = node.body[1:] if ast.get_docstring(node) else node.body
                length = body[-1].end_lineno - body[0].lineno + 1 if body else 0
                assert length <= 60, f"{path.name}: {node.name} has {length} lines"


def test_exported_names_exist():
    assert sorted(rne.__all__) == rne.__all__
    for name in rne.__all__:
        assert hasattr(rne, name), name


MODULES = [m.name for m in pkgutil.walk_packages([str(PACKAGE)], "rne.") if not m.name.endswith("__main__")]


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name, monkeypatch):
    monkeypatch.chdir(ROOT)
    module = importlib.import_module(name)
    result = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert result.failed == 0


def public_functions():
    for name in rne.__all__:
        thing = getattr(rne, name)
        if inspect.isfunction(thing):
            yield name


@pytest.mark.parametrize("name", list(public_functions()))
def test_public_functions_are_documented(name):
    text = inspect.getdoc(getattr(rne, name))
    for section in ("Parameters", "Returns", "Examples"):
        assert f"{section}\n---" in text or (section == "Parameters" and name in ("irb140", "robots")), (
            f"{name}: {section}"
        )


def test_names_in_the_source_have_no_accents():
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Name):
                assert node.id.isascii()


README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_quick_start_of_the_readme_runs_and_prints_what_it_says(monkeypatch):
    monkeypatch.chdir(ROOT)
    blocks = re.findall(r"```python\n(.*?)```\n+```text\n(.*?)```", README, re.DOTALL)
    assert blocks
    for code, output in blocks:
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
        assert run.stderr == ""
        assert run.stdout == output


def test_python_version_is_the_same_everywhere():
    assert 'requires-python = ">=3.11"' in (ROOT / "pyproject.toml").read_text()
    assert "Python 3.11" in README


def test_no_machine_path_is_committed():
    files = subprocess.run(["git", "ls-files"], capture_output=True, text=True, cwd=ROOT, check=True).stdout.split()
    for name in files:
        path = ROOT / name
        if path.suffix in {".py", ".md", ".toml", ".urdf", ".json"} and path.exists():
            assert "/" + "work/" not in path.read_text(encoding="utf-8"), name
