"""Files kept on disk for other processes: object code, which need not be compiled again.

The folder is the platform's for caches, or what RNE_CACHE names; none if that is empty. Code that is read from it is
run: a folder or a file that another user owns or may write to is refused. A file holds a digest of its name and of what
follows; one that is damaged or another's is passed over. Files are written under another name and renamed, so that
several processes may use the folder; the least recently used go when all together exceed LIMIT.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

LOGGER = logging.getLogger("rne")
LIMIT = 64_000_000  # bytes
KEPT = 0.8  # of the limit, once it is exceeded
ENDING, UNFINISHED = ".rne", "unfinished-"
DIGEST = hashlib.sha256


def folder() -> Path | None:
    """Folder of the object code; None if it is not kept."""
    named = os.environ.get("RNE_CACHE")
    if named is not None:
        return Path(named).expanduser() if named else None
    try:
        from platformdirs import user_cache_path
    except ImportError:
        return None
    return user_cache_path("rne", appauthor=False)


def key(*parts: str) -> str:
    """Name of the file for a description in several parts."""
    digest = DIGEST()
    for part in parts:
        digest.update(f"{len(part)} {part}".encode())
    return digest.hexdigest()


def read(name: str) -> bytes | None:
    """Object code kept under a name; None if there is none, or none to be trusted."""
    place = folder()
    if place is None:
        return None
    path = place / f"{name}{ENDING}"
    try:
        if not is_own(place) or not is_own(path):
            return None
        content = path.read_bytes()
        size = DIGEST().digest_size
        if DIGEST(name.encode() + content[size:]).digest() != content[:size]:
            return None
        os.utime(path)  # used now
    except OSError:
        return None
    return content[size:]


def write(name: str, code: bytes) -> None:
    """Keep object code under a name, if that is possible."""
    place = folder()
    if place is None:
        return
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not is_own(place):
            return
        number, temporary = tempfile.mkstemp(prefix=UNFINISHED, dir=place)
        try:
            with os.fdopen(number, "wb") as file:
                file.write(DIGEST(name.encode() + code).digest() + code)
            os.replace(temporary, place / f"{name}{ENDING}")
        except BaseException:
            os.unlink(temporary)
            raise
        _remove_least_recently_used(place)
    except OSError as error:
        LOGGER.info("object code is not kept in %s: %s", place, error)


def entries(place: Path) -> Iterator[tuple[Path, os.stat_result]]:
    """Files of the cache, and what others left unfinished."""
    for path in place.iterdir() if place.is_dir() else ():
        try:
            found = path.lstat()
        except FileNotFoundError:  # another process removed it
            continue
        if path.suffix == ENDING or path.name.startswith(UNFINISHED):
            yield path, found


def clear() -> int:
    """Remove all files, and return how many there were."""
    place, count = folder(), 0
    for path, _ in entries(place) if place is not None else ():
        path.unlink(missing_ok=True)
        count += 1
    return count


def is_own(path: Path) -> bool:
    """True for a folder, or a file that is no link, if only this user may write to it."""
    found = path.lstat() if path.suffix == ENDING else path.stat()
    if not hasattr(os, "getuid"):  # Windows guards the profile's folder
        return True
    foreign = found.st_uid != os.getuid() or found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    if foreign or stat.S_ISLNK(found.st_mode):
        _warn(path)
        return False
    return True


@functools.cache
def _warn(path: Path) -> None:
    LOGGER.warning("object code in %s is not used: another user owns it or may write to it", path)


def _remove_least_recently_used(place: Path) -> None:
    found = sorted(entries(place), key=lambda entry: entry[1].st_mtime, reverse=True)
    if sum(state.st_size for _, state in found) <= LIMIT:
        return
    total = 0
    for path, state in found:
        total += state.st_size
        if total > KEPT * LIMIT:
            path.unlink(missing_ok=True)
