"""Open maps, shared by all clients; one that changed on the disk is opened anew."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from raymap.file.opening import open as open_map
from raymap.model.errors import NotARayMap
from service.files.confine import OutsideFolder, ServedFolder

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["Library", "check_inside"]

_Stamp = tuple[tuple[int, int, int], ...]


@dataclass(eq=False)
class _Shelved:
    """An open map, and how many requests read it now."""

    map: RayMap
    stamp: _Stamp
    readers: int = 0
    stale: bool = False


class Library:
    """Maps of the served folder.

    Parameters
    ----------
    folder : the served folder
    size : so many maps stay open; the one that was not used for longest goes first
    """

    def __init__(self, folder: ServedFolder, size: int) -> None:
        self.folder, self.size = folder, size
        self._shelf: dict[str, _Shelved] = {}
        self._lock = threading.Lock()

    def __len__(self) -> int:
        """Maps that are open."""
        return len(self._shelf)

    @contextmanager
    def map(self, name: str) -> Iterator[RayMap]:
        """The map of a name, open as long as it is read.

        Raises
        ------
        OutsideFolder, NotARayMap
        """
        paths = self.folder.map_paths(name)
        stamp = _stamp(paths)
        with self._lock:
            shelved = self._shelf.pop(name, None)
            if shelved is not None and shelved.stamp != stamp:
                self._drop(shelved)
                shelved = None
            if shelved is None:
                shelved = _Shelved(self.open(name, paths), stamp)
            self._shelf[name] = shelved
            shelved.readers += 1
            for other in list(self._shelf)[: max(0, len(self._shelf) - self.size)]:
                self._drop(self._shelf.pop(other))
        try:
            yield shelved.map
        finally:
            with self._lock:
                shelved.readers -= 1
                if shelved.stale and not shelved.readers:
                    shelved.map.close()

    def open(self, name: str, paths: list[Path] | None = None) -> RayMap:
        """A map opened for one reader alone, who closes it."""
        chosen = self.folder.map_paths(name) if paths is None else paths
        single = len(chosen) == 1 and not self.folder.path(name).is_dir()
        opened = open_map(chosen[0] if single else chosen, on_damage="skip")
        try:
            check_inside(self.folder, opened, chosen)
        except BaseException:
            opened.close()
            raise
        return opened

    def close(self) -> None:
        """Close all maps."""
        with self._lock:
            for shelved in self._shelf.values():
                self._drop(shelved)
            self._shelf.clear()

    def _drop(self, shelved: _Shelved) -> None:
        shelved.stale = True
        if not shelved.readers:
            shelved.map.close()


def check_inside(folder: ServedFolder, opened: RayMap, paths: list[Path]) -> None:
    """Compare the files that were opened with those that lie inside, link or not.

    Raises
    ------
    OutsideFolder
        A name has become a link between the look at it and the opening.
    """
    for path, identity in zip(paths, opened.identities, strict=True):
        if not folder.same(path, identity):
            raise OutsideFolder(
                f"{folder.shown(path)!r} has become a link that leads outside the served folder"
            )


def _stamp(paths: list[Path]) -> _Stamp:
    """What changes when a file is written on or replaced."""
    marks = []
    for path in paths:
        try:
            found = path.stat()
        except OSError:
            raise NotARayMap(f"{path} does not exist") from None
        marks.append((found.st_ino, found.st_size, found.st_mtime_ns))
    return tuple(marks)
