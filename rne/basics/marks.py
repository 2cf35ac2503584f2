"""Marks of the files that rne writes, by which its commands know which files they may replace.

CSV has no comments that all readers skip: pandas and csv read them as data. The mark is a heading in which the first
name, `"t"`, is in quotes and the second is not, which all readers read as t.
"""

import re
import zipfile
from contextlib import suppress
from pathlib import Path

HTML = '<meta name="generator" content="rne">'
COMMENT = "written by rne"  # in a GIF or source text
URDF = f"<!-- {COMMENT} -->\n"
PICTURE = {"Software": "rne"}  # in a PNG
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
