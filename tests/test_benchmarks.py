"""Each benchmark runs once, small, so that it cannot rot; it writes nothing then."""

import subprocess
import sys

import pytest

from .helpers import ROOT

BENCHMARKS = ["benchmarks", *(f"benchmarks.{name}" for name in ("validation", "kernels", "lagrange", "simulation"))]


@pytest.mark.parametrize("name", BENCHMARKS)
def test_quick_run_prints_a_table_and_changes_no_file(name):
    results = sorted([*(ROOT / "benchmarks" / "results").glob("*.json"), *(ROOT / "docs" / "benchmarks").glob("*")])
    before = [path.read_bytes() for path in results]
    command = [sys.executable, "-m", name, "--quick"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "| irb140 |" in run.stdout
    assert [path.read_bytes() for path in results] == before
