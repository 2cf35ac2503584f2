"""The project's metadata, and the wheel: what it contains and that it works without the repository."""

import email
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import warnings
import zipfile

import pytest

import rne

from .helpers import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NO_NETWORK = ("Temporary failure in name resolution", "No matching distribution found", "Failed to establish a new")


def test_version_is_the_same_everywhere():
    citation = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert PROJECT["version"] == rne.__version__ == citation.group(1)


def test_licence_is_the_same_everywhere():
    assert PROJECT["license"] == "BSD-2-Clause"
    assert (ROOT / "LICENSE").read_text(encoding="utf-8").startswith("BSD 2-Clause License")
    assert "license: BSD-2-Clause\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_changelog_has_a_section_for_what_is_not_released():
    assert re.search(r"^## \[Unreleased\]$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)


def test_sources_hold_what_runs_in_a_clone():
    """The experiments of the thesis, tests and benchmarks are not installed, but go with the sources."""
    build = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]
    assert build["wheel"]["packages"] == ["rne"]
    assert {"rne", "examples", "tests", "benchmarks", "docs"} <= set(build["sdist"]["include"])


def built(kind, folder):
    """The path of a wheel or of the sources ("sdist"), built from the repository."""
    pytest.importorskip("build", reason="the package `build` is not installed")
    command = [sys.executable, "-m", "build", f"--{kind}", "--outdir", str(folder), str(ROOT)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    said = run.stdout + run.stderr
    if run.returncode and any(text in said for text in NO_NETWORK):
        pytest.skip("the build back end cannot be downloaded")
    assert run.returncode == 0, said
    (path,) = folder.glob("*.*")
    return path


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The path of a wheel built from the repository."""
    return built("wheel", tmp_path_factory.mktemp("dist"))


@pytest.mark.long
def test_sources_hold_what_the_repository_tracks(tmp_path):
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if tracked.returncode:
        pytest.skip("not a clone: there is no list of files to compare with")
    root = f"rne-{rne.__version__}/"
    with tarfile.open(built("sdist", tmp_path)) as archive:
        held = {name.removeprefix(root) for name in archive.getnames()}
    assert set(tracked.stdout.splitlines()) - held == set()


@pytest.mark.long
def test_wheel_holds_the_package_and_nothing_else(wheel):
    assert wheel.name == f"rne-{rne.__version__}-py3-none-any.whl"
    files = (path.relative_to(ROOT) for path in (ROOT / "rne").rglob("*") if path.is_file())
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    info = f"rne-{rne.__version__}.dist-info"
    assert {name for name in names if not name.startswith(info)} == {
        path.as_posix() for path in files if "__pycache__" not in path.parts
    }
    assert "rne/py.typed" in names
    assert f"{info}/licenses/LICENSE" in names


@pytest.mark.long
def test_wheel_says_what_it_needs(wheel):
    with zipfile.ZipFile(wheel) as archive:
        info = f"rne-{rne.__version__}.dist-info"
        metadata = email.message_from_bytes(archive.read(f"{info}/METADATA"))
        assert archive.read(f"{info}/entry_points.txt").decode() == "[console_scripts]\nrne = rne.__main__:main\n"
    assert metadata["Name"] == "rne"
    assert metadata["Version"] == rne.__version__
    assert metadata["License-Expression"] == "BSD-2-Clause"
    assert metadata["Requires-Python"] == PROJECT["requires-python"]
    needed = {re.match(r"[\w-]+", line).group() for line in metadata.get_all("Requires-Dist") if "extra ==" not in line}
    assert needed == {"lxml", "numpy", "scipy"}


@pytest.mark.long
def test_wheel_runs_without_the_repository(wheel, tmp_path):
    """From a folder of its own, with the packages it needs from this environment."""
    site = tmp_path / "site"
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "-q",
        "--no-deps",
        "--no-index",
        "--target",
        str(site),
        str(wheel),
    ]
    subprocess.run(command, check=True)

    def run(*words):
        environment = os.environ | {"PYTHONPATH": str(site)}
        done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, env=environment, check=False)
        # All but progress.
        told = [line for line in done.stderr.splitlines() if not re.fullmatch(r"  .*( \.\.\.|: took) \d+ s", line)]
        assert (done.returncode, told) == (0, [])
        return done.stdout

    script = str(site / "bin" / "rne")
    assert run(script, "--version") == f"rne {rne.__version__}\n"
    (tmp_path / "robot.urdf").write_text(run(script, "urdf", "irb140"))
    assert run(script, "check", "robot.urdf") == "robot.urdf: no findings\n"
    assert run(script, "--out", "main").endswith("page: main/index.html\n")
    assert run(script, "report", "robot.urdf", "--out", "robot").endswith("page: robot/index.html\n")
    assert (tmp_path / "main" / "index.html").exists()
    code = (
        "import rne; print(rne.__file__); print(rne.load('irb140').inverse_dynamics([0] * 6, [0] * 6, [0] * 6).shape)"
    )
    assert run(sys.executable, "-c", code) == f"{site / 'rne' / '__init__.py'}\n(6,)\n"


def test_tests_fail_on_warnings_of_this_package_and_not_on_those_of_others():
    """Python warns of wrong escapes only when it compiles: some installers leave that to the first import."""
    escape = 'x = "\\d"'
    compile(escape, "/rne/.venv/lib/python3.13/site-packages/toppra/constraint/joint_torque.py", "exec")
    with pytest.raises(SyntaxError, match="invalid escape sequence"):
        compile(escape, "/home/rne/robot.py", "exec")
    warnings.warn_explicit("old", DeprecationWarning, "x.py", 1, module="trimesh.util")
    for module in ("rne.robot", "tests.test_robot", "benchmarks"):
        with pytest.raises(DeprecationWarning):
            warnings.warn_explicit("old", DeprecationWarning, "x.py", 1, module=module)


def test_the_extra_of_the_documentation_has_all_that_its_tutorials_draw_with():
    """Which `CONTRIBUTING.md` installs alone."""
    extras = PROJECT["optional-dependencies"]
    (own,) = (re.search(r"\[(.*)\]", line)[1].split(",") for line in extras["docs"] if line.startswith("rne["))
    assert {"plot", "view", "numba", "robots", "identify", "fastest", "casadi"} <= set(own) <= set(extras)
    assert "pip install -q '.[docs]'" in (ROOT / "CONTRIBUTING.md").read_text()
