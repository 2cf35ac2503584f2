"""Marks of the files that rne writes, by which its commands know what they may replace.

A table of comma-separated values has no comments that every reader skips: pandas and csv take such a line for data. Its
mark is the heading's `"t"` in quotes, and the next name without, which all readers take as t.
"""

from __future__ import annotations

import zipfile
from pathlib import Path

HEAD = 4096  # bytes that are looked at
HTML = '<meta name="generator" content="rne">'
COMMENT = "written by rne"  # of a GIF
URDF = f"<!-- {COMMENT} -->\n"
PICTURE = {"Software": "rne"}  # of a PNG
TABLE = '"t"'
TEXTS = "texts"  # entry of an archive: what is not an array, as JSON
MARKS = {
    ".html": HTML.encode(),
    ".htm": HTML.encode(),
    ".urdf": URDF.strip().encode(),
    ".gif": COMMENT.encode(),
    ".png": b"Software\0rne",
}


def is_marked(file: Path) -> bool:
    """True if rne wrote the file, by the mark of its suffix."""
    suffix = file.suffix.lower()
    if suffix == ".npz":
        try:
            with zipfile.ZipFile(file) as archive:
                return f"{TEXTS}.npy" in archive.namelist()
        except (zipfile.BadZipFile, ValueError):
            return False
    with file.open("rb") as stream:
        head = stream.read(HEAD)
    if suffix == ".csv":
        mark = TABLE.encode()
        return head.startswith((mark + b",", mark + b"\n")) and not head.startswith(mark + b',"')
    return suffix in MARKS and MARKS[suffix] in head
