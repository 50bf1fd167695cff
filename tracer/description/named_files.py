"""Files that a scene names: the place of each is asked of one door, so that none gets past it.

Whoever reads a scene for somebody else (a service) sets a door; it refuses a file, or answers where
its content may be read. Without one, files lie where the scene says.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["Door", "is_guarded", "named_file", "reading_through"]

Door = Callable[[Path], Path]
"""Takes the path that a scene means, answers the one to read; raises to refuse."""

_doors: list[Door] = []


def named_file(folder: str | Path, name: str) -> Path:
    """Where a file that a scene names is read.

    Parameters
    ----------
    folder : of the scene
    name : as the scene gives it, relative to the folder
    """
    path = Path(folder) / name
    return _doors[-1](path) if _doors else path


def is_guarded() -> bool:
    """Whether a door is set: then nothing may be read that was not asked of it."""
    return bool(_doors)


@contextmanager
def reading_through(door: Door) -> Iterator[None]:
    """Ask a door for every file that scenes name, in all threads of this process."""
    _doors.append(door)
    try:
        yield
    finally:
        _doors.remove(door)
