"""Break lines of the package and see whether the README's short tests notice: python -m tests.mutation --help."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import collections
import json
import shutil
import subprocess
import tempfile
from pathlib import Path

from .draw import candidates, draw, folders
from .suite import Suite, ended, notes, start

TOGETHER = 8  # survivors of the tests nearby that pass through the whole suite at once


class Run:
    """Mutants on their way through the tests; `outcome` holds a dictionary for each that is decided."""

    def __init__(self, suite, workers, report):
        self.suite, self.report, self.outcome = suite, report, {}
        place = Path(tempfile.mkdtemp(prefix="rne-mutation-"))
        self.slots = [(shutil.copytree(suite.tree, place / f"copy{k}"), place / f"log{k}") for k in range(workers)]

    def tests(self, jobs):
        """Run jobs (mutants, tests) side by side; yield (mutants, kind, test, seconds), kind "passed" if all held."""
        jobs, running, free = collections.deque(jobs), {}, list(self.slots)
        while jobs or running:
            while jobs and free:
                broken, order = jobs.popleft()
                tree, log = free.pop()
                stamps = {m.file: (tree / m.file).stat() for m in broken}
                for m in broken:
                    (tree / m.file).write_bytes(m.broken(self.suite.tree))
                    os.utime(tree / m.file, (0, 0))  # another second than that of any bytecode
                cpu = 15 + 5 * sum(map(self.suite.cost.get, order))
                running[start(tree, log, order=order, cpu=cpu)] = broken, tree, log, stamps
            child, code, seconds = ended(running)
            broken, tree, log, stamps = running.pop(child)
            for file, stamp in stamps.items():
                (tree / file).write_bytes((self.suite.tree / file).read_bytes())
                os.utime(tree / file, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
            free.append((tree, log))
            said = notes(log)
            failed = [test for what, test, _ in said if what == "failed"]
            last = failed[0] if failed else said[-1][1] if said else "start"
            if code == 0:
                kind = "passed"
            elif failed:
                kind = "killed"
            elif code in (-14, -24, -9):  # SIGALRM, SIGXCPU, SIGKILL
                kind = "timeout"
            else:  # a crash in a test is a failure of it
                kind = "killed" if said and said[-1][0] == "begun" else "import"
            yield broken, kind, last, round(seconds, 1)

    def decide(self, mutant, kind, test, seconds, by):
        self.outcome[mutant] = {"kind": kind, "test": test, "seconds": seconds, "by": by}
        self.report(mutant, self.outcome[mutant])

    def nearby(self, mutants, select, by):
        """Run tests selected for each mutant; the mutants that none of them noticed."""
        left = []
        jobs = [((m,), select(m)) for m in mutants]
        for (mutant,), kind, test, seconds in self.tests([job for job in jobs if job[1]]):
            if kind == "passed":
                left.append(mutant)
            else:
                self.decide(mutant, kind, test, seconds, by)
        return [job[0][0] for job in jobs if not job[1]] + left

    def everywhere(self, mutants):
        """Run the whole suite on several files' mutants at once: what passes together has survived; find what fails."""
        groups = []
        for mutant in mutants:
            fitting = [g for g in groups if len(g) < TOGETHER and mutant.file not in {m.file for m in g}]
            groups += [] if fitting else [[]]
            (fitting or groups)[-1].append(mutant)
        everything = list(self.suite.cost)
        while groups:
            again = []
            for group, kind, test, seconds in list(self.tests([(g, everything) for g in groups])):
                if kind == "passed" or len(group) == 1:
                    for m in group:
                        self.decide(m, "survived" if kind == "passed" else kind, test, seconds, "whole suite")
                    continue
                alone = [test] if kind == "killed" else everything
                left = self.nearby(group, lambda m, alone=alone: alone, "whole suite")
                again += [left] if len(left) < len(group) else [[m] for m in left]
            groups = [g for g in again if g]


def listed(root, file):
    """Survivors listed in a file of results, where they are in the present tree."""
    rows = [r for r in json.loads(file.read_text()) if r["kind"] == "survived"]
    found = mutants_of_lines(root, {r["source"] for r in rows})
    for r in rows:
        if (r["source"], r["old"], r["new"]) not in found:
            print(f"no longer there: {r['file']}: {r['old']} -> {r['new']}")
    keys = dict.fromkeys((r["source"], r["old"], r["new"]) for r in rows)
    return [found[key] for key in keys if key in found]


def mutants_of_lines(root, sources):
    """Mutants on lines of some text, wherever they are, by their keys."""
    texts = {str(path.relative_to(root)): path.read_text(encoding="utf-8") for path in (root / "rne").rglob("*.py")}
    files = [file for file, text in texts.items() if any(source in text for source in sources)]
    every = (m for file in files for ms in candidates(root, file).values() for m in ms)
    return {m.key(): m for m in every if m.source in sources}


KILLED = ("killed", "timeout", "import")


def table(rows):
    """Counts by folder, the share killed of all, and the mutants but those that tests killed.

    A mutant that ends in no time, or with which the tests cannot be imported, is killed too. Some of those that
    survive change no result, such as another size of a cache: no draw is killed as a whole.
    """
    kinds = (*KILLED, "survived")
    lines = [f"{'folder':16}" + "".join(f"{kind:>12}" for kind in kinds) + f"{'killed':>12}"]
    for folder in [*dict.fromkeys(r["folder"] for r in rows), "all"]:
        own = [r["kind"] for r in rows if folder in ("all", r["folder"])]
        share = sum(own.count(kind) for kind in KILLED) / max(len(own), 1)
        lines.append(f"{folder:16}" + "".join(f"{own.count(kind):12d}" for kind in kinds) + f"{share:12.1%}")
    for kind in ("survived", "timeout", "import"):
        lines += ["", f"{kind}:"]
        for r in (r for r in rows if r["kind"] == kind):
            lines += [f"{r['file']}:{r['line']}: {r['change']}: {r['old']} -> {r['new']}", f"    {r['source']}"]
            lines += [f"    {r['test']}"] if kind != "survived" else []
    return "\n".join(lines)


def seed_of_commit(root):
    """The last commit's hash as a number: another draw for each commit."""
    said = subprocess.run(["git", "rev-parse", "HEAD"], cwd=root, capture_output=True, text=True, check=True).stdout
    return int(said[:8], 16)


def main(arguments=None):
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--count", type=int, default=400, help="mutants of all folders together")
    parser.add_argument("--minimum-per-folder", type=int, default=16, metavar="N")
    parser.add_argument("--seed", type=int, help="by default from the hash of the last commit")
    parser.add_argument("--folder", nargs="*", default=[None], metavar="NAME", help="run the mutants of these alone")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--tests", nargs="*", default=[], metavar="FILE", help="files of tests; by default all")
    parser.add_argument("--mutants", type=Path, metavar="FILE", help="run the survivors in this file of results again")
    parser.add_argument("--list", action="store_true", help="print the draw, run nothing")
    parser.add_argument("--results", type=Path, default=Path("build/mutation.json"), help="file to write")
    parser.add_argument("--root", type=Path, default=Path(__file__).parents[2], help="the tree to break")
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "rne-mutation")
    options = parser.parse_args(arguments)
    root = options.root.resolve()
    seed = options.seed if options.seed is not None or options.mutants else seed_of_commit(root)
    if unknown := set(options.folder) - {None, *folders(root)}:
        parser.error(f"no folders of rne: {sorted(unknown)}; they are {list(folders(root))}")
    mutants = listed(root, options.mutants) if options.mutants else []
    for folder in [] if options.mutants else options.folder:
        mutants += draw(root, options.count, seed, options.minimum_per_folder, folder)
    if options.list:
        print(*mutants, sep="\n")
        return
    rows = []
    options.results.parent.mkdir(parents=True, exist_ok=True)

    def report(mutant, outcome):
        rows.append(vars(mutant) | {"folder": mutant.folder} | outcome)
        options.results.write_text(json.dumps(rows, indent=1))
        print(
            f"{len(rows):4d}/{len(mutants)} {outcome['kind']:9} {mutant}  [{outcome['seconds']} s, {outcome['test']}]",
            flush=True,
        )

    suite = Suite(root, options.cache, options.tests)
    print(f"{options.mutants or f'seed {seed}'}: {len(mutants)} mutants")
    print(
        f"{len(suite.cost)} short tests, {sum(suite.cost.values()):.0f} s with coverage; failing without a mutant: {suite.failing or 0}",
        flush=True,
    )
    run = Run(suite, options.workers, report)
    left = run.nearby(mutants, suite.few, "tests that cover the line")
    left = run.nearby(left, suite.files, "files nearby")
    run.everywhere(left)
    text = table(sorted(rows, key=lambda r: (r["folder"], r["file"], r["line"])))
    options.results.with_suffix(".txt").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
