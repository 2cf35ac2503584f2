"""The short tests in a child process: what covers which line, and whether a broken copy of the tree passes."""

import contextlib
import hashlib
import importlib
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import pytest

# Imported once by the parent, so that a child starts with them; never the package itself, which is broken anew each time.
SCIPY = ("integrate", "interpolate", "linalg", "optimize", "signal", "spatial", "stats")
HEAVY = ("numpy", *(f"scipy.{name}" for name in SCIPY), "lxml.etree", "matplotlib.pyplot", "mpmath", "pandas")
HEAVY += ("pinocchio", "numba", "hypothesis")
WALL = 1800  # s after which a child that waits for something that never comes is ended


class Watch:
    """Pytest plugin: orders the tests, and writes what became of them line by line, so that a crash is seen as well."""

    def __init__(self, log, order=None, coverage=None):
        self.log, self.order, self.coverage = open(log, "a"), order, coverage  # noqa: SIM115

    def note(self, what, test, **more):
        print(json.dumps([what, test, more]), file=self.log, flush=True)

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items):
        if self.order is not None:
            place = {test: k for k, test in enumerate(self.order)}
            items[:] = sorted((i for i in items if i.nodeid in place), key=lambda i: place[i.nodeid])

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        if self.coverage:
            self.coverage.switch_context(item.nodeid)
        self.note("begun", item.nodeid)
        begun = time.process_time()
        outcome = yield
        self.note("ended", item.nodeid, seconds=time.process_time() - begun)
        if self.coverage:
            self.coverage.switch_context("")
        return outcome

    def pytest_sessionstart(self, session):
        self.session = session

    def pytest_runtest_logreport(self, report):
        if report.failed:
            self.note("failed", report.nodeid)
            self.session.shouldfail = self.coverage is None and "a test failed"

    def pytest_collectreport(self, report):
        if report.failed:
            self.note("not imported", report.nodeid)


def files_of(root):
    """What git would commit of a tree."""
    listed = subprocess.run(
        ["git", "ls-files", "-coz", "--exclude-standard"], cwd=root, capture_output=True, check=True
    )
    return sorted(name for name in listed.stdout.decode().split("\0") if name and (root / name).is_file())


def start(tree, log, *, order=None, cpu, coverage=None, files=()):
    """Fork a child that runs pytest in `tree`, all tests, those of some files or those in `order`; its process id."""
    log.unlink(missing_ok=True)
    sys.stdout.flush()
    if child := os.fork():
        return child
    os.setsid()
    os.nice(10)
    output = os.open(log.with_suffix(".out"), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 1)
    os.dup2(output, 2)
    seconds, allowed = int(cpu) + 1, resource.getrlimit(resource.RLIMIT_CPU)[1]
    seconds = seconds if allowed == resource.RLIM_INFINITY else min(seconds, allowed)  # within a run of the same tool
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.alarm(WALL + int(10 * cpu))
    os.chdir(tree)
    home = tempfile.mkdtemp(dir=log.parent)
    os.environ |= {"PYTHONPATH": str(tree), "HYPOTHESIS_STORAGE_DIRECTORY": home, "PYTHONHASHSEED": "0"}
    sys.path[:] = [str(tree), *(p for p in sys.path if p != str(tree))]
    for name in [m for m in sys.modules if m.split(".")[0] in ("rne", "tests", "benchmarks")]:
        del sys.modules[name]
    sys.dont_write_bytecode = coverage is None  # two mutants of one second would share it
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1" if coverage is None else ""
    if coverage:
        coverage.start()
    code = 70
    with contextlib.suppress(BaseException):
        files = sorted({test.split("::")[0] for test in order}) if order else files
        options = ["-p", "no:cacheprovider", "--continue-on-collection-errors", "--basetemp", f"{home}/tests"]
        code = pytest.main([*options, *files], plugins=[Watch(log, order, coverage)])
    if coverage:
        coverage.stop()
        coverage.save()
    shutil.rmtree(home, ignore_errors=True)
    os._exit(int(code))


def ended(children):
    """Wait for one of the children; its id, how it ended (negative: by a signal) and CPU seconds of it and its own."""
    while True:
        child, status, usage = os.wait4(-1, 0)
        if child in children:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)
            return child, os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime


def notes(log):
    """Lines that a child wrote."""
    return [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []


class Suite:
    """What the unbroken tree's short tests cover and cost; kept on disk for a tree of the same content."""

    def __init__(self, root, cache, files=()):
        import coverage

        content, texts = hashlib.sha256(repr(sorted(files)).encode()), ""
        for name in files_of(root):
            content.update(f"{name}\0".encode() + (root / name).read_bytes())
            texts += (root / name).read_text() if name.endswith(".py") else ""
        for name in HEAVY:
            if f"import {name.split('.')[0]}" in texts:
                with contextlib.suppress(ImportError):
                    importlib.import_module(name)
        kept = cache / content.hexdigest()[:20]
        self.tree, data, log = kept / "tree", kept / "coverage", kept / "tests"
        if not (kept / "done").exists():
            shutil.rmtree(kept, ignore_errors=True)
            for name in files_of(root):
                (self.tree / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(root / name, self.tree / name)
            subprocess.run("git init -q && git add -A", shell=True, cwd=self.tree, check=True)  # for tests that ask git
            measured = coverage.Coverage(data_file=str(data), source=[str(self.tree / "rne")], config_file=False)
            ended({start(self.tree, log, cpu=7200, coverage=measured, files=files)})
            (kept / "done").touch()
        log = notes(log)
        self.failing = {test for what, test, _ in log if what in ("failed", "not imported")}
        left_out = self.failing | {
            t for _, t, _ in log if "test_those_declared" in t
        }  # it knows lines, not what they do
        self.cost = {t: m["seconds"] for what, t, m in log if what == "ended" and t not in left_out}
        if not self.cost:
            raise SystemExit(f"no test ran: {(kept / 'tests.out').read_text()[-2000:]}")
        self.lines = coverage.CoverageData(str(data))
        self.lines.read()
        self.texts = {p: p.read_text() for p in sorted((self.tree / "tests").rglob("test_*.py"))}

    def covering(self, mutant):
        """Tests that ran the line, or else the nearest line that any test ran, cheapest first."""
        by_line = self.lines.contexts_by_lineno(str(self.tree / mutant.file))
        lines = {line: tests for line, found in by_line.items() if (tests := set(found) & set(self.cost))}
        nearest = min(lines, key=lambda line: abs(line - mutant.line), default=0)
        return sorted(lines.get(nearest, ()), key=lambda t: (self.cost[t], t))

    def few(self, mutant, cases=3, seconds=12.0):
        """At most some cases of each covering test, file by file; a tree's kernels are traced only once, so not enough."""
        seen, chosen = {}, []
        for test in self.covering(mutant):
            name = re.sub(r"\[.*", "", test)
            seen[name] = seen.get(name, 0) + 1
            if seen[name] <= cases and (seconds := seconds - self.cost[test]) > 0:
                chosen.append(test)
        first = {}
        for k, test in enumerate(chosen):
            first.setdefault(test.split("::")[0], k)
        return sorted(chosen, key=lambda t: (first[t.split("::")[0]], self.cost[t]))

    def files(self, mutant, seconds=30.0):
        """All tests of files that name the module or hold covering tests, cheapest files first."""
        module = mutant.file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        named = {str(p.relative_to(self.tree)) for p, text in self.texts.items() if re.search(rf"\b{module}\b", text)}
        cover = {t.split("::")[0] for t in self.covering(mutant)}
        whole = {}
        for test in self.cost:
            if (file := test.split("::")[0]) in named | cover:
                whole.setdefault(file, []).append(test)
        chosen = []
        for tests in sorted(
            whole.values(), key=lambda ts: (ts[0].split("::")[0] not in named, sum(map(self.cost.get, ts)))
        ):
            if (seconds := seconds - sum(map(self.cost.get, tests))) > 0:
                chosen += tests
        return chosen
