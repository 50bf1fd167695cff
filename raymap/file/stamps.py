"""Which files `verify` has passed on this machine: a stamp per file in the user's cache folder.

A stamp holds the file's device, inode, size and time of change, and a digest of how it begins and
ends. It says that whoever runs this machine has had the file verified; nothing in the file itself
could say that, since who writes lies can write digests of them. Nothing leans on it but the word
``verified`` in answers: a file that is exchanged without a trace is read as safely as any other.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from pathlib import Path
from typing import Any

from raymap.jit.compilecache import user_caches

__all__ = ["forget", "is_stamped", "stamp"]

_ENDS = 2**16

_KEPT = 4096
"""Stamps in the folder, of 200 bytes each; beyond that the oldest quarter goes."""


def stamp(path: Path) -> None:
    """Remember that a file was verified; silently not, where no folder can be written."""
    place = _place(path)
    if place is None:
        return
    with contextlib.suppress(OSError):
        place.parent.mkdir(parents=True, mode=0o700, exist_ok=True)
        beside = place.with_suffix(f".{os.getpid()}")
        beside.write_text(json.dumps(_facts(path)), encoding="utf-8")
        beside.replace(place)
        _prune(place.parent)


def _prune(folder: Path) -> None:
    """Take the oldest stamps away where there are more than are kept."""
    stamps = [each for each in os.scandir(folder) if each.is_file(follow_symlinks=False)]
    if len(stamps) <= _KEPT:
        return
    stamps.sort(key=lambda each: each.stat(follow_symlinks=False).st_mtime_ns)
    for each in stamps[: len(stamps) - _KEPT * 3 // 4]:
        with contextlib.suppress(OSError):
            os.unlink(each.path)


def forget(path: Path) -> None:
    """Take the stamp of a file away."""
    place = _place(path)
    if place is not None:
        with contextlib.suppress(OSError):
            place.unlink(missing_ok=True)


def is_stamped(path: Path) -> bool:
    """Whether this very file, unchanged since, was verified."""
    place = _place(path)
    if place is None:
        return False
    try:
        return bool(json.loads(place.read_text(encoding="utf-8")) == _facts(path))
    except (OSError, ValueError, RecursionError):
        return False


def _place(path: Path) -> Path | None:
    caches = user_caches()
    if caches is None:
        return None
    try:
        name = hashlib.blake2b(os.fsencode(path.resolve()), digest_size=16).hexdigest()
    except (OSError, RuntimeError):
        return None
    return caches / "raymap" / "verified" / f"{name}.json"


def _facts(path: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        found = os.fstat(file.fileno())
        digest = hashlib.blake2b(file.read(_ENDS), digest_size=16)
        file.seek(max(0, found.st_size - _ENDS))
        digest.update(file.read(_ENDS))
    return {
        "device": found.st_dev,
        "inode": found.st_ino,
        "size": found.st_size,
        "changed_ns": found.st_mtime_ns,
        "digest": digest.hexdigest(),
    }
