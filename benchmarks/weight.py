"""Size of an installation: python -m benchmarks.weight [--quick]

Builds the wheel, and installs the package into environments of their own: alone, as the README's two commands do, and
with each extra. Files are counted as they are on disk, byte code included, without what a new environment holds. Fills
the last column of the table in docs/installation.md and writes benchmarks/results/weight.json.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from benchmarks.measure import is_quick, write
from benchmarks.pages import DOCS

ROOT = DOCS.parent
PAGE = DOCS / "installation.md"
COMMAND = re.compile(r"pip install -q (?:-e )?'\.\[([\w,]+)\]'")


def choices() -> list[str]:
    """Lists of extras: none, those of the README's two commands, and each."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    commands = COMMAND.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    return list(dict.fromkeys(["", *commands, *project["optional-dependencies"]]))


def megabytes(folder: Path) -> float:
    """Size of the files below a folder [MB]."""
    return sum(path.lstat().st_size for path in folder.rglob("*")) / 1e6


def wheel() -> float:
    """Size of the package's wheel [MB]."""
    with tempfile.TemporaryDirectory() as place:
        subprocess.run([sys.executable, "-m", "build", "--wheel", "--outdir", place, ROOT], check=True)
        return megabytes(Path(place))


def installed(extras: str) -> float:
    """Size of an installation [MB]."""
    with tempfile.TemporaryDirectory() as place:
        subprocess.run([sys.executable, "-m", "venv", place], check=True)
        before = megabytes(Path(place))
        python = Path(place) / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
        what = f"{ROOT}[{extras}]" if extras else ROOT
        subprocess.run([python, "-m", "pip", "install", "-q", what], check=True)
        return megabytes(Path(place)) - before


def filled(page: str, sizes: dict[str, float]) -> str:
    """The page with the sizes in the last cells of their rows."""
    for extras, size in sizes.items():
        row = re.compile(rf"^(\| `{re.escape(extras) or 'pip install .'}` \|.*\|)[^|]*\|$", re.MULTILINE)
        page = row.sub(rf"\1 {size:.0f} |", page)
    return page


def main() -> None:
    quick = is_quick(__doc__)
    sizes = {}
    for extras in choices()[: 1 if quick else None]:
        sizes[extras] = installed(extras)
        print(f"{extras or 'pip install .'}: {sizes[extras]:.0f} MB", flush=True)
    if not quick:
        write("weight.json", {"wheel": wheel(), "installed": sizes})
        PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), sizes), encoding="utf-8")


if __name__ == "__main__":
    main()
