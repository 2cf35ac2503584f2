"""Each tutorial runs from start to end; what its text claims is asserted in it."""

import re
import runpy
import tempfile
import tomllib

import pytest
from matplotlib import figure, pyplot

from .helpers import ROOT, kept

FOLDER = ROOT / "docs" / "tutorials"
TUTORIALS = sorted(path.stem for path in FOLDER.glob("[0-9]*.py"))
SHORT = {"01_torques_along_a_path", "10_from_a_dh_table_to_a_simulation"}
USES = {  # what in a script shows that it needs an extra
    "plot": r"matplotlib|rne\.plotting|\.plot\(",
    "robots": r'load\("(ur5|panda|so101)"',
    "cluster": "distributed",
    "numba": 'engine="numba"',
    "view": r"rne\.view",
    "identify": r"rne\.identify\(",
    "fastest": r"trajectories\.fastest\(",
    "casadi": "import casadi",
    "jax": "import jax",
    "ros": "from rosbags",
    "lerobot": "import pyarrow",
    "gymnasium": r"rne\.environments",
    "fmu": r"\.to_fmu\(",
}


@pytest.mark.parametrize("name", kept(TUTORIALS, SHORT))
def test_tutorial_runs(name, tmp_path, monkeypatch):
    """Without warnings, which are errors here, and without files left in the working folder."""
    if "import casadi" in (FOLDER / f"{name}.py").read_text(encoding="utf-8"):
        pytest.importorskip("casadi", reason="CasADi is not installed, which the tutorial uses")
    if "import jax" in (FOLDER / f"{name}.py").read_text(encoding="utf-8"):
        pytest.importorskip("jax", reason="JAX is not installed, which the tutorial is about")
    if "from rosbags" in (FOLDER / f"{name}.py").read_text(encoding="utf-8"):
        pytest.importorskip("rosbags", reason="rosbags is not installed, which writes the tutorial's log")
    if "import pyarrow" in (FOLDER / f"{name}.py").read_text(encoding="utf-8"):
        pytest.importorskip("pyarrow", reason="pyarrow is not installed, which writes the tutorial's data set")
    if "rne.environments" in (FOLDER / f"{name}.py").read_text(encoding="utf-8"):
        pytest.importorskip("gymnasium", reason="gymnasium is not installed, whose environments the tutorial uses")
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    before = pyplot.get_fignums()
    variables = runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    assert pyplot.get_fignums() == before
    assert not list(work.iterdir())
    figures = [value for value in variables.values() if isinstance(value, figure.Figure)]
    assert figures
    for picture in figures:
        picture.draw_without_rendering()
        assert any(axes.get_xlabel() for axes in picture.axes)
        assert any(axes.get_ylabel() for axes in picture.axes)


@pytest.mark.parametrize("name", TUTORIALS)
def test_tutorial_names_the_extras_that_it_needs(name):
    text = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
    (named,) = re.findall(r"^Needs: ``pip install '\.\[([a-z,]+)\]'``", text, re.MULTILINE)
    assert set(named.split(",")) == {extra for extra, sign in USES.items() if re.search(sign, text)}
    known = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert set(named.split(",")) <= set(known)
