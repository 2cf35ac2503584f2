"""Marks of the files that rne writes, by which its commands know what they may replace.

A table of comma-separated values has no comments that every reader skips: pandas and csv take such a line for data. Its
mark is the heading's `"t"` in quotes, and the next name without, which all readers take as t.
"""

import re
import zipfile
from contextlib import suppress
from pathlib import Path

HTML = '<meta name="generator" content="rne">'
COMMENT = "written by rne"  # of a GIF, of source text
URDF = f"<!-- {COMMENT} -->\n"
PICTURE = {"Software": "rne"}  # of a PNG
TABLE = '"t"'
TEXTS = "texts"  # entry of an archive: what is not an array, as JSON
PATTERNS = {".csv": rf'\A{TABLE}(?!,")', ".png": "Software\0rne", ".gif": COMMENT, ".urdf": URDF.strip()}
PATTERNS |= dict.fromkeys((".html", ".htm"), HTML) | dict.fromkeys((".hpp", ".cpp", ".txt", ".md", ".xml"), COMMENT)


def is_marked(file: Path) -> bool:
    """True if rne wrote the file, by the mark of its suffix."""
    suffix = file.suffix.lower()
    if suffix == ".npz":
        with suppress(zipfile.BadZipFile), zipfile.ZipFile(file) as archive:
            return {f"{TEXTS}.npy", "array_0.npy"} <= {*archive.namelist()}
        return False
    if suffix == ".fmu":
        with suppress(zipfile.BadZipFile), zipfile.ZipFile(file) as archive:
            return archive.comment == COMMENT.encode()
        return False
    with file.open("rb") as stream:
        return suffix in PATTERNS and re.search(PATTERNS[suffix].encode(), stream.read(4096)) is not None
