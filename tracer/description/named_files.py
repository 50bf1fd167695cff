"""Files that a scene names: the place of each is asked of one door, so that none gets past it.

Whoever reads a scene for somebody else (a service) sets a door; it refuses a file, or answers where
its content may be read. Without one, files lie where the scene says. A map says which files its
scene read: `noting_files` collects them at the same place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

__all__ = ["Door", "is_guarded", "named_file", "noting_files", "reading_through"]

Door = Callable[[Path], Path]
"""Takes the path that a scene means, answers the one to read; raises to refuse."""

_doors: list[Door] = []
_notes: ContextVar[dict[str, Path] | None] = ContextVar("files that scenes named", default=None)


def named_file(folder: str | Path, name: str) -> Path:
    """Where a file that a scene names is read.

    Parameters
    ----------
    folder : of the scene
    name : as the scene gives it, relative to the folder
    """
    path = Path(folder) / name
    path = _doors[-1](path) if _doors else path
    noted = _notes.get()
    if noted is not None:
        noted[name] = path
    return path


def is_guarded() -> bool:
    """Whether a door is set: then nothing may be read that was not asked of it."""
    return bool(_doors)


@contextmanager
def noting_files() -> Iterator[dict[str, Path]]:
    """Collect the files that are asked for meanwhile: where each was read, by name in the scene."""
    noted: dict[str, Path] = {}
    outer = _notes.get()
    token = _notes.set(noted)
    try:
        yield noted
    finally:
        _notes.reset(token)
        if outer is not None:
            outer.update(noted)


@contextmanager
def reading_through(door: Door) -> Iterator[None]:
    """Ask a door for every file that scenes name, in all threads of this process."""
    _doors.append(door)
    try:
        yield
    finally:
        _doors.remove(door)
