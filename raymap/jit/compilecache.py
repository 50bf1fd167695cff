"""Where compiled code is kept: in a folder of its own for every state of Raymap's sources, and of
those of the distributions that add kinds to it.

Numba notices an edit of the function that it compiled, not of one in another file that became part
of it. So nothing that an older Raymap compiled may lie where this one looks. Code that cannot be
loaded is compiled again; where nothing can be written, code is compiled for the process only.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import shutil
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from importlib.machinery import PathFinder
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

__all__ = ["cache_folder", "fingerprint", "is_own", "keep_compiled", "remove_old", "user_caches"]

_ROOMS = ("raymap", "tracer", "query", "viewer", "service")
_PREFIX = "compiled-"
_KEPT_FOLDERS = 4
_KEPT_SECONDS = 30 * 86_400
_TOUCHED_AFTER = 86_400
_OF_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_lock = threading.RLock()


def keep_compiled(decorate: Callable[[bool], Any]) -> Any:
    """A function whose machine code is kept in the folder of this state of the sources.

    The folder is set for this function only: others that use Numba in the same process keep
    theirs. Where the user has set ``NUMBA_CACHE_DIR``, that one is used.

    Parameters
    ----------
    decorate : makes Numba's dispatcher, with or without a cache
    """
    with _own_folder():
        if not _may_be_kept():
            return decorate(False)
        try:
            compiled = decorate(True)
        except RuntimeError:
            # Numba finds no folder that it can write
            return decorate(False)
    if hasattr(compiled, "_cache"):
        compiled._cache = _Forgiving(compiled._cache)
    return compiled


@functools.cache
def _may_be_kept() -> bool:
    """Whether the folder that is used is this user's, be it Raymap's or the one that was chosen."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if not chosen:
        caches = None if cache_folder() else user_caches()
        folder = caches and caches / "raymap" / (_PREFIX + fingerprint())
        return not folder or not folder.is_dir() or is_own(folder)
    if not hasattr(os, "getuid"):
        return True
    try:
        status = os.stat(chosen)
    except FileNotFoundError:
        return True
    except OSError:
        return False
    return status.st_uid == os.getuid() and not status.st_mode & stat.S_IWOTH


@contextlib.contextmanager
def _own_folder() -> Iterator[None]:
    from numba.core import config

    folder = cache_folder()
    if folder is None or config.CACHE_DIR:
        yield
        return
    with _lock:
        config.CACHE_DIR = str(folder)
        try:
            yield
        finally:
            config.CACHE_DIR = ""


class _Forgiving:
    """Numba's cache of a function, of which a damaged file or a full disk is no failure."""

    def __init__(self, cache: Any) -> None:
        self._kept = cache

    def __getattr__(self, name: str) -> Any:
        return getattr(self._kept, name)

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The machine code, None where it has to be compiled."""
        from numba.core.runtime import rtsys

        try:
            # Numba's own way in first imports all that its compiler knows, which takes longer than
            # a short trace. Machine code of numbers and arrays only calls the runtime by name.
            rtsys.initialize(target)
            return self._kept._load_overload(signature, target)
        except OSError:
            return None
        except Exception:
            with contextlib.suppress(Exception):
                self._kept.flush()
            return None

    def save_overload(self, signature: Any, code: Any) -> None:
        """Keep machine code, if there is room."""
        with contextlib.suppress(OSError):
            self._kept.save_overload(signature, code)


@functools.cache
def cache_folder() -> Path | None:
    """The folder, made if need be; None where the user chose one or none can be written."""
    if os.environ.get("NUMBA_CACHE_DIR"):
        return None
    try:
        caches = user_caches()
        if caches is None:
            return None
        folder = caches / "raymap" / (_PREFIX + fingerprint())
        if not folder.is_dir():
            folder.parent.mkdir(parents=True, mode=0o700, exist_ok=True)
            folder.mkdir(mode=0o700, exist_ok=True)
            remove_old(folder)
        elif time.time() - folder.stat().st_mtime > _TOUCHED_AFTER:
            os.utime(folder)
        if not is_own(folder):
            # Somebody else could have put code there
            return None
        return folder if os.access(folder, os.W_OK | os.X_OK) else None
    except OSError:
        return None


def is_own(folder: Path) -> bool:
    """Whether nobody else can put files into a folder of compiled code, which is run as it is.

    The folder and the one above it, by which it could be exchanged, must be of this user; others
    lose the right to write to them. The files in it must be of this user, too.
    """
    if not hasattr(os, "getuid"):
        return True
    try:
        for path in (folder.parent, folder):
            status = path.lstat()
            if status.st_uid != os.getuid() or stat.S_ISLNK(status.st_mode):
                return False
            if status.st_mode & _OF_OTHERS:
                path.chmod(stat.S_IMODE(status.st_mode) & ~_OF_OTHERS)
        return all(_is_own_file(entry) for entry in (*folder.iterdir(), *folder.glob("*/*")))
    except OSError:
        return False


def _is_own_file(path: Path) -> bool:
    try:
        status = path.lstat()
    except FileNotFoundError:
        # Another process has removed what it no longer uses
        return True
    return status.st_uid == os.getuid() and not stat.S_ISLNK(status.st_mode)


def fingerprint(root: str | os.PathLike[str] | None = None) -> str:
    """Name of a state of the sources: changes with every edit and with every version.

    Parameters
    ----------
    root : folder of the packages, by default where this one lies
    """
    if root is None:
        root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    lines = [f"{sys.implementation.cache_tag} {os.fspath(root)}"]
    with contextlib.suppress(OSError):
        # The installed version, which reproducible builds change without changing times
        lines += sorted(name for name in os.listdir(root) if name.startswith("raymap-"))
    for room in _ROOMS:
        lines += sorted(_sources(os.path.join(root, room)))
    for folder in _plug_ins():
        lines += sorted(_sources(folder))
    return hashlib.blake2b("\n".join(lines).encode(), digest_size=8).hexdigest()


def _plug_ins() -> list[str]:
    """Folders of the packages of other distributions that register kinds of ours.

    Their compiled functions hold parts of ours, and parts of other files of theirs.
    """
    tops: dict[str, None] = {}
    for point in (point for found in distributions() for point in found.entry_points):
        if point.group.partition(".")[0] in _ROOMS:
            top = point.value.partition(":")[0].partition(".")[0].strip()
            if top not in _ROOMS:
                tops[top] = None
    folders = []
    for top in sorted(tops):
        # Finds the package without importing it
        with contextlib.suppress(ImportError, ValueError, AttributeError):
            spec = PathFinder.find_spec(top)
            if spec is not None and spec.origin is not None:
                folders.append(os.path.dirname(spec.origin))
    return folders


def _sources(folder: str) -> Iterator[str]:
    """Place, size and time (seconds are what archives keep) of each source file."""
    try:
        entries = list(os.scandir(folder))
    except OSError:
        return
    for entry in entries:
        if entry.name.endswith(".py"):
            status = entry.stat()
            yield f"{entry.path} {status.st_size} {int(status.st_mtime)}"
        elif "." not in entry.name and entry.name != "__pycache__" and entry.is_dir():
            yield from _sources(entry.path)


def remove_old(folder: Path) -> None:
    """Remove folders beside this one that other states of the sources no longer use."""
    ages = []
    for other in folder.parent.glob(_PREFIX + "*"):
        if other != folder:
            with contextlib.suppress(OSError):
                ages.append((time.time() - other.stat().st_mtime, other))
    for index, (age, other) in enumerate(sorted(ages)):
        if index >= _KEPT_FOLDERS - 1 or age > _KEPT_SECONDS:
            shutil.rmtree(other, ignore_errors=True)


def user_caches() -> Path | None:
    """The user's folder for caches; None where there is no home."""
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA")
        return Path(local) if local else None
    named = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(named):
        return Path(named)
    home = os.path.expanduser("~")
    if not os.path.isabs(home):
        return None
    return Path(home, "Library", "Caches") if sys.platform == "darwin" else Path(home, ".cache")
