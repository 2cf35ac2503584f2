"""Files kept on disk for other processes: object code, which need not be compiled again.

The folder is the platform's cache folder, or that in RNE_CACHE; none if RNE_CACHE is empty. Code that is read is run:
a folder or a file that another user owns or may write to is not used. A file begins with a digest of its name and its
code; damaged files are ignored. The folder and the file are opened once, so that what is checked is what is read, and
symbolic links to files are not followed. Files are written under a temporary name and renamed, so that several
processes may use the folder. When the files together exceed LIMIT, the least recently used are removed.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LOGGER = logging.getLogger("rne")
LIMIT = 64_000_000  # largest size of the cache [bytes]
KEPT = 0.8  # share of the limit that is kept once it is exceeded
ENDING, UNFINISHED = ".rne", "unfinished-"
NAME = re.compile(rf"[0-9a-f]{{64}}\{ENDING}|{UNFINISHED}[0-9a-f]{{32}}")  # of the cache's files: no others are removed
PLAIN = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))  # no symbolic links, no waiting
DIGEST = hashlib.sha256
FOREIGN = "is not used: another user owns it or may write to it"


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
    """Object code kept under a name; None if there is none, or an untrusted one."""
    place = folder()
    if place is None:
        return None
    try:
        with _entered(place) as (prefix, number):
            file = os.open(path := os.path.join(prefix, f"{name}{ENDING}"), os.O_RDONLY | PLAIN, dir_fd=number)
            with os.fdopen(file, "rb") as stream:
                state = os.fstat(file)
                is_code = is_own(place, state) and stat.S_ISREG(state.st_mode) and state.st_size <= LIMIT
                content = stream.read() if is_code else b""
            size = DIGEST().digest_size
            if DIGEST(name.encode() + content[size:]).digest() != content[:size]:
                return None
            os.utime(path, dir_fd=number)  # used now
    except OSError:
        return None
    return content[size:]


@contextmanager
def _entered(place: Path) -> Iterator[tuple[str, int | None]]:
    """Prefix for names and the folder's descriptor they are relative to; an OSError if it is another user's."""
    if not hasattr(os, "getuid"):  # Windows has no such descriptors, and guards the profile's folder
        yield os.fspath(place), None
        return
    number = os.open(place, os.O_RDONLY | os.O_DIRECTORY)
    try:
        if not is_own(place, os.fstat(number)):
            raise PermissionError(FOREIGN)
        yield "", number
    finally:
        os.close(number)


def write(name: str, code: bytes) -> None:
    """Keep object code under a name, if that is possible."""
    place = folder()
    if place is None:
        return
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        with _entered(place) as (prefix, number):
            temporary = os.path.join(prefix, f"{UNFINISHED}{secrets.token_hex(16)}")
            file = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | PLAIN, 0o600, dir_fd=number)
            try:
                with os.fdopen(file, "wb") as stream:
                    stream.write(DIGEST(name.encode() + code).digest() + code)
                path = os.path.join(prefix, f"{name}{ENDING}")
                os.replace(temporary, path, src_dir_fd=number, dst_dir_fd=number)
            except BaseException:
                os.unlink(temporary, dir_fd=number)
                raise
        _remove_least_recently_used(place)
    except OSError as error:
        LOGGER.info("object code is not kept in %s: %s", place, error)


def entries(place: Path) -> Iterator[tuple[Path, os.stat_result]]:
    """Files of the cache, including unfinished ones of others."""
    for path in place.iterdir() if place.is_dir() else ():
        try:
            found = path.lstat()
        except FileNotFoundError:  # another process removed it
            continue
        if NAME.fullmatch(path.name) and stat.S_ISREG(found.st_mode):
            yield path, found


def clear() -> int:
    """Remove all files of the cache and no others, and return how many there were."""
    place, count = folder(), 0
    for path, _ in entries(place) if place is not None else ():
        path.unlink(missing_ok=True)
        count += 1
    return count


def is_own(place: Path, found: os.stat_result | None = None) -> bool:
    """True if only this user may write to a folder, or to a file in it of the state `found`; always on Windows."""
    if not hasattr(os, "getuid"):
        return True  # Windows guards the profile's folder
    state = found or place.stat()
    if state.st_uid == os.getuid() and not state.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return True
    _warn(place)
    return False


@functools.cache
def _warn(path: Path) -> None:
    LOGGER.warning("object code in %s %s", path, FOREIGN)


def _remove_least_recently_used(place: Path) -> None:
    found = sorted(entries(place), key=lambda entry: entry[1].st_mtime, reverse=True)
    if sum(state.st_size for _, state in found) <= LIMIT:
        return
    total = 0
    for path, state in found:
        total += state.st_size
        if total > KEPT * LIMIT:
            path.unlink(missing_ok=True)
