"""The structure of the package: imports go downwards only, importing is light, names are documented, README runs."""

import ast
import contextlib
import doctest
import functools
import graphlib
import importlib.util
import inspect
import io
import itertools
import os
import pkgutil
import re
import subprocess
import symtable
import sys
from collections import Counter

import numpy as np
import pytest

import rne

from .counts import branches, code_lines, counts, docstring_lines, private_accesses, public_values
from .helpers import ROOT, kept

PACKAGE = ROOT / "rne"
# Each entry of rne/ imports only from floors below its own, and within itself.
FLOORS = [
    ["errors", "basics"],
    ["elementwise"],
    ["graph"],
    ["model"],
    ["dynamics", "files"],
    ["kernels"],
    ["integrators"],
    ["bounds"],
    ["robot"],
    ["urdf", "control"],
    ["simulation"],
    ["environments"],
    ["plotting", "trajectories"],
    ["identification"],
    ["export"],
    ["commands"],
    ["__init__", "__main__"],
]
FLOOR = {entry: k for k, floor in enumerate(FLOORS) for entry in floor}
SOURCES = sorted(PACKAGE.rglob("*.py"))
ON_IMPORT = {"basics", "errors", "elementwise", "model", "dynamics", "robot"}  # the rest is imported on first use
# Largest values that `python -m tests.counts` may print: whoever lowers a count lowers its ceiling.
CEILINGS = {
    "lines": 59_298,
    "entries at the top": 23,  # more are not taken in at a glance
    "public names": 54,
    "internal names imported by tests": 227,
    "type: ignore": 16,
    "private accesses": 4,
    "functions over 40 lines": 28,
    "functions over 15 branches": 79,
}
MAX_NAMES = 25  # of a function: a reader holds no more
NAMELESS = {"lambda", "listcomp", "setcomp", "dictcomp", "genexpr"}  # functions, as `symtable` calls them
MAX_CHANGES = 14  # of folder, from simulate to the first step


def entry(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def module_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMES = {module_of(path) for path in SOURCES}
NODES = {path: list(ast.walk(ast.parse(path.read_text(encoding="utf-8")))) for path in SOURCES}


def called(node):
    """The last name of what a call calls."""
    return getattr(node.func, "attr", getattr(node.func, "id", ""))


def imported(path, nodes):
    """Modules that a file imports in some nodes, as dotted names from the package's root."""
    package = path.relative_to(ROOT).with_suffix("").parts[:-1]
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*base, *([node.module] if node.module else [])])
            for alias in node.names:  # `from . import x` is x, if that is a module, and not the folder
                name = f"{module}.{alias.name}"
                yield name if name in NAMES or module == "rne" else module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Call) and called(node) in ("import_module", "__import__"):
            (name, *_) = node.args  # by a text: relative to the folder, or made when it runs, which names no file
            if isinstance(name, ast.Constant):
                yield importlib.util.resolve_name(name.value, ".".join(package))


def for_type_checking(path):
    """Nodes of a file that run for a type checker only."""
    blocks = [n for n in NODES[path] if isinstance(n, ast.If) and getattr(n.test, "id", "") == "TYPE_CHECKING"]
    return {inner for block in blocks for inner in ast.walk(block)}


EVERY_IMPORT = {path: set(imported(path, NODES[path])) for path in SOURCES}
IMPORTS = {path: set(imported(path, set(NODES[path]) - for_type_checking(path))) for path in SOURCES}


def test_imports_go_downwards():
    upwards = []
    for path, modules in IMPORTS.items():
        own = FLOOR[entry(path)]
        others = [m for m in modules if m.startswith("rne.") and m.split(".")[1] != entry(path)]
        upwards += [f"{path.relative_to(ROOT)} imports {m}" for m in others if FLOOR[m.split(".")[1]] >= own]
    assert upwards == []


def test_no_module_imports_itself_through_others():
    files = [path for path in SOURCES if path.stem != "__init__"]
    graph = {module_of(p): EVERY_IMPORT[p] & NAMES - {module_of(p)} for p in files}
    tuple(graphlib.TopologicalSorter(graph).static_order())  # a CycleError names the circle


def imports_of_folder(folder):
    """Modules of benchmarks that each file of a folder imports."""
    found = {}
    texts = {path: path.read_text(encoding="utf-8") for path in (ROOT / folder).rglob("*.py")}
    for path, text in texts.items():
        tree = ast.parse(text if "from benchmarks" in text else "")
        nodes = [n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
        names = [f"{n.module}.{alias.name}" for n in nodes if not n.level for alias in n.names]
        files = [name for name in names if name.startswith("benchmarks.")]
        of_module = (
            n if (ROOT / n.replace(".", "/")).with_suffix(".py").exists() else n.rpartition(".")[0] for n in files
        )
        found[module_of(path)] = set(of_module)
    return found


def test_no_benchmark_imports_itself_through_others():
    tuple(graphlib.TopologicalSorter(imports_of_folder("benchmarks")).static_order())


def test_what_several_tests_need_is_not_of_a_benchmark():
    """Robots, logs and faults that tests are made of live in tests, and benchmarks import them from there."""
    users = {}
    for file, modules in imports_of_folder("tests").items():
        for module in modules - {"benchmarks.engines", "benchmarks.pages", "benchmarks.peers"}:  # of benchmarks' tests
            users.setdefault(module, []).append(file)
    assert {module: files for module, files in users.items() if len(files) > 2} == {}


def test_every_entry_has_a_floor():
    assert {entry(path) for path in SOURCES} == set(FLOOR)


@pytest.mark.long
def test_counts_do_not_rise():
    found = counts()
    assert {name: (found[name], most) for name, most in CEILINGS.items() if found[name] > most} == {}


def test_what_is_counted_in_a_file():
    text = '''
class A:
    """Two lines
    of text."""

    def f(self, other, pair):
        """One line."""
        own = [self._a, other._a, pair._replace(x=1), other._kept, A._f()]  # _a is set here
        self._a = other._elsewhere if other and pair or own else None
        return [x for x in own if x]

    def _f(self):
        def g():
            return 1 if self else 2
        return g
'''
    tree = ast.parse(text)
    assert len(docstring_lines(tree)) == 3
    found = [access.rpartition(" ")[2] for access in private_accesses(PACKAGE / "a.py", tree)]
    assert found == ["other._kept", "other._elsewhere"]
    f, hidden = (n for n in tree.body[0].body if isinstance(n, ast.FunctionDef))
    assert (code_lines(f), branches(f), branches(hidden)) == (4, 5, 1)


def test_class_names_occur_once():
    """A name that is read in an error or found by a search means one thing."""
    names = Counter(node.name for nodes in NODES.values() for node in nodes if isinstance(node, ast.ClassDef))
    assert {name for name, count in names.items() if count > 1} == set()


def test_nothing_is_imported_that_is_not_installed():
    """The wheel holds rne/ alone."""
    for path in SOURCES:
        assert not {m.split(".")[0] for m in IMPORTS[path]} & {"examples", "tests", "benchmarks", "docs"}, path


def test_yourdfpy_is_used_for_pictures_only():
    """It is the independent second reader; the package reads the dynamics of a URDF with lxml alone."""
    users = {entry(p) for p in SOURCES if any(m.split(".")[0] == "yourdfpy" for m in IMPORTS[p])}
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
    assert taken["crba"] == {"solve_with_pivots"}
    assert taken["precision"] == {"check_accelerations"}


def test_import_loads_numpy_and_the_standard_library_only():
    code = "import sys, numpy; before = set(sys.modules); import rne; print(*sorted(set(sys.modules) - before))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    roots = {name.split(".")[0] for name in loaded.split()}
    assert roots <= {"rne", "numpy", *sys.stdlib_module_names}
    assert {name.split(".")[1] for name in loaded.split() if name.startswith("rne.")} <= ON_IMPORT


def test_identification_loads_neither_pictures_nor_simulation():
    """Until they are used: the first touch of a Record takes no longer than it must."""
    code = "import sys, rne.identification; print(*(name for name in sys.modules if name.startswith('rne.')))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    rooms = {name.split(".")[1] for name in loaded.split()}
    assert not rooms & {"plotting", "simulation", "integrators", "control", "urdf", "commands"}


# What identification and bounds take of the package beside `rne.basics`, `rne.errors` and what users call: if these names
# became public, both could be distributions of their own.
APART = ("identification", "bounds")
TAKEN = {
    "rne.dynamics.kinematics.joint_transforms": "poses of joints against each other, over boxes of positions",
    "rne.dynamics.regressors.gravity_torques": "torques are linear in gravity: its direction as a cause of residuals",
    "rne.files.log_columns.measured": "a log in any format: what Record.from_log reads",
    "rne.files.log_columns.names_by_number": "joints that two sides number alike",
    "rne.files.logs.LogOptions": "options of Record.from_log, on their way to the readers",
    "rne.files.motion_files.write_columns": "the table of a motion, marked as one that may be replaced",
    "rne.files.time_units.guessed_unit": "times that look like milliseconds are a finding of a Record",
    "rne.kernels.cache.KernelCache": "kernels of a robot with other masses, where a Robot is not known yet",
    "rne.model.coupling.IN_FILES": "types that an archive of a fit holds",
    "rne.model.coupling.with_ratio": "the ratio of a joint that follows others, as a cause of residuals",
    "rne.model.modify.limit_array": "limits for all joints, each, or some by name, as with_limits takes them",
    "rne.model.topology.end_link": "the link of a load that is not named",
    "rne.robot.robot_argument": "the error for an argument that is no Robot",
    "rne.simulation.commanded.CommandedMotion": "motions under recorded commands, which are fitted",
    "rne.simulation.scene.payload_argument": "a load by its mass, as a Payload or as found, as Scene takes it",
    "rne.simulation.springs.JointSpring": "what Spring.at_joint returns, whose stiffness is fitted",
    "rne.simulation.springs.Springs": "the springs of a Scene, in which torques are linear",
    "rne.simulation.springs.resolved_springs": "the argument `springs`, as Scene takes it",
    "rne.simulation.trajectory.motors_at": "positions behind elastic joints, which encoders of motors measure",
}
MOST_TAKEN = 20


def taken_by(folder):
    """Names that are not public, by the module that has them: those that files of a folder import, for types too."""
    public, found = public_values(), set()
    for path in (p for p in SOURCES if entry(p) == folder):
        package = path.relative_to(ROOT).with_suffix("").parts[:-1]
        for node in (n for n in NODES[path] if isinstance(n, ast.ImportFrom) and n.level):
            module = ".".join([*package[: len(package) - node.level + 1], *filter(None, [node.module])])
            if module.split(".")[1:2] in ([folder], ["basics"], ["errors"]):
                continue
            for name in (alias.name for alias in node.names):
                if id(getattr(importlib.import_module(module), name)) not in public:
                    found.add(f"{module}.{name}")
    return found


def test_identification_and_bounds_take_public_names_and_few_others():
    taken = set().union(*map(taken_by, APART))
    assert sorted(taken - TAKEN.keys()) == []
    assert sorted(TAKEN.keys() - taken) == []
    assert len(TAKEN) <= MOST_TAKEN
    for path in (p for p in SOURCES if entry(p) in APART):  # by `from ... import ...` alone, which the test reads
        assert not any(
            name.startswith("rne")
            for n in NODES[path]
            if isinstance(n, ast.Import)
            for name in [a.name for a in n.names]
        )


def functions(table):
    """The tables of symbols of all functions with a name, methods and nested ones among them."""
    for child in table.get_children():
        if child.get_type() == "function" and child.get_name() not in NAMELESS:
            yield child
        yield from functions(child)


def bound(function):
    """Names that a function's own body binds: by assignments, `for`, `with`, `except`, `match` and walruses.

    Arguments, imports, functions and classes that are defined in it, what comprehensions and nested functions bind for
    themselves, names that are `nonlocal` or `global`, and `_`, which is read nowhere, do not count.
    """
    own = (s for s in function.get_symbols() if s.is_local() and s.is_assigned())
    return {s.get_name() for s in own if not (s.is_parameter() or s.is_namespace())} - {"_"}


def test_functions_bind_few_names():
    found = {}
    for path in SOURCES:
        for function in functions(symtable.symtable(path.read_text(encoding="utf-8"), path.name, "exec")):
            if (count := len(bound(function))) > MAX_NAMES:
                found[f"{path.relative_to(ROOT)}: {function.get_name()}"] = count
    assert found == {}


def test_what_counts_as_a_name_that_a_function_binds():
    text = """
def f(a, *b, k=1, **c):
    import os
    x: int = 0
    x += 1
    (y, _), *z = a
    with open(os) as w, open(w) as _:
        v = [u for u in z if (t := u)]
    for s in b:
        try:
            def g():
                nonlocal r
                r, q = 0, 1
        except ValueError as e:
            pass
    class G:
        p = 1
    a = r = {o: 1 for o in c}
    return lambda m: (n := m)
"""
    (f, g) = functions(symtable.symtable(text, "f", "exec"))
    assert bound(f) == {"x", "y", "z", "w", "v", "t", "s", "e", "r"}
    assert bound(g) == {"q"}


def test_exported_names_exist():
    assert sorted(rne.__all__) == rne.__all__
    for name in rne.__all__:
        assert hasattr(rne, name), name


MODULES = [m.name for m in pkgutil.walk_packages([str(PACKAGE)], "rne.") if not m.name.endswith("__main__")]


LONG_EXAMPLES = (
    "rne.identification.",
    "rne.control.gains",
    "rne.control.momentum_observer",
    "rne.control.robust_laws",
    "rne.control.uncertainty",
    "rne.plotting.plots",
    "rne.plotting.robot_picture",
)


@pytest.mark.parametrize("are_long", kept([False, True], [False]))
def test_examples_run(are_long, irb140_once, monkeypatch):
    monkeypatch.chdir(ROOT)
    said, runner = [], doctest.DocTestRunner(verbose=False, optionflags=doctest.NORMALIZE_WHITESPACE)
    for name in MODULES:
        if name.startswith(LONG_EXAMPLES) == are_long:
            for docstring in doctest.DocTestFinder().find(importlib.import_module(name)):
                if docstring.examples:
                    runner.run(docstring, out=said.append)
    assert runner.tries > 150
    assert not runner.failures, "".join(said)


def test_public_functions_are_documented():
    missing = []
    for name in rne.__all__:
        if inspect.isfunction(function := getattr(rne, name)):
            text = inspect.getdoc(function)
            sections = (
                ("Returns", "Examples") if name in ("irb140", "robots") else ("Parameters", "Returns", "Examples")
            )
            missing += [f"{name}: {section}" for section in sections if f"{section}\n---" not in text]
    assert missing == []


def test_names_in_the_source_have_no_accents():
    for nodes in NODES.values():
        assert all(node.id.isascii() for node in nodes if isinstance(node, ast.Name))


README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_quick_start_of_the_readme_runs_and_prints_what_it_says(monkeypatch):
    monkeypatch.chdir(ROOT)
    blocks = re.findall(r"```python\n(.*?)```\n+```text\n(.*?)```", README, re.DOTALL)
    assert blocks
    for code, output in blocks:
        with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.redirect_stderr(said):
            exec(compile(code, "README.md", "exec"), {"__name__": "__main__"})
        assert said.getvalue() == output


def test_python_version_is_the_same_everywhere():
    assert 'requires-python = ">=3.11"' in (ROOT / "pyproject.toml").read_text()
    assert "Python 3.11" in README


def test_no_machine_path_is_committed():
    files = subprocess.run(["git", "ls-files"], capture_output=True, text=True, cwd=ROOT, check=True).stdout.split()
    for name in files:
        path = ROOT / name
        if path.suffix in {".py", ".md", ".toml", ".urdf", ".json"} and path.exists():
            assert "/" + "work/" not in path.read_text(encoding="utf-8"), name


def test_dir_of_a_package_that_loads_names_on_first_use_lists_all_public_ones():
    """Whether they were used before or not."""
    packages = [importlib.import_module(module_of(path)) for path in SOURCES if path.name == "__init__.py"]
    lazy = [package for package in packages if "__getattr__" in vars(package)]
    assert {package.__name__ for package in lazy} >= {"rne", "rne.model", "rne.dynamics", "rne.trajectories"}
    assert {package.__name__: set(dir(package)) - {"__version__"} for package in lazy} == {
        package.__name__: set(package.__all__) for package in lazy
    }


def is_read(frame):
    """True for what a reader of a call does not look up: properties, comparisons, hashes, functions without a name."""
    *owner, name = frame.f_code.co_qualname.split(".")
    if "<" in frame.f_code.co_qualname or name in ("__eq__", "__hash__", "__getattr__", "__post_init__"):
        return True
    member = vars(frame.f_globals.get(owner[0])).get(name) if len(owner) == 1 else None
    return isinstance(member, property | functools.cached_property)


@pytest.mark.parametrize("engine", ["numpy", pytest.param("numba", marks=pytest.mark.long)])
def test_few_changes_of_folder_lead_from_simulate_to_the_first_step_of_a_scene_built_again(engine):
    """Whoever follows the run of an equal scene from `simulate` to where its solver begins the first step.

    The way has each function and method of the package once, where it is first called, in the order of calls. It leaves
    out what is read rather than followed (`is_read`), and `rne.basics`, which all folders use as they use NumPy. What
    properties compute counts: the calls in them are part of the way. A change is a function of another folder of rne/
    than that of the function before; robot.py is a folder of its own.
    """
    robot, friction, codes = rne.load("irb140", engine=engine), rne.Friction(viscous=1.0), {}

    def built_again():
        law = rne.control.pd_gravity(robot, [100.0] * 6, [20.0] * 6, np.zeros(6))
        return rne.Scene(robot, controller=law, friction=friction)

    def note(frame, event, _):
        path = frame.f_code.co_filename.removeprefix(f"{PACKAGE}{os.sep}")
        if event != "call" or path == frame.f_code.co_filename or "steps" in codes:
            return
        folder = path.split(os.sep)[0]
        if folder != "basics" and not is_read(frame):
            is_step = (folder, frame.f_code.co_name) == ("integrators", "steps")
            codes.setdefault("steps" if is_step else frame.f_code, folder)

    rne.simulate(built_again(), [0.1] * 6, [0] * 6, 0.1)
    scene = built_again()
    sys.setprofile(note)
    try:
        rne.simulate(scene, [0.1] * 6, [0] * 6, 0.1)
    finally:
        sys.setprofile(None)
    way = [*codes.values()]
    assert (way[0], way[-1], [*codes][-1]) == ("simulation", "integrators", "steps")
    assert sum(one != other for one, other in itertools.pairwise(way)) <= MAX_CHANGES


NO_THRESHOLDS = {0.0, 0.5, 1.0, 2.0}  # halves, units and pairs


def test_identification_compares_with_the_table_of_thresholds():
    """No number with a point stands in a comparison outside of it, and none of its names is there twice."""
    folder = PACKAGE / "identification"
    table = folder / "thresholds.py"
    bare = []
    for path in (path for path in SOURCES if path.is_relative_to(folder) and path != table):
        compared = {part for node in NODES[path] if isinstance(node, ast.Compare) for part in ast.walk(node)}
        numbers = [x for x in compared if isinstance(x, ast.Constant) and isinstance(x.value, float)]
        bare += [f"{path.relative_to(ROOT)}:{x.lineno}: {x.value}" for x in numbers if x.value not in NO_THRESHOLDS]
    assert bare == []
    stored = [x.id for x in NODES[table] if isinstance(x, ast.Name) and isinstance(x.ctx, ast.Store)]
    assert sorted(stored) == sorted(set(stored))
