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
class _Opened:
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
        self._opened: dict[str, _Opened] = {}
        self._lock = threading.Lock()

    def __len__(self) -> int:
        """Maps that are open."""
        return len(self._opened)

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
            opened = self._opened.pop(name, None)
            if opened is not None and opened.stamp != stamp:
                self._drop(opened)
                opened = None
            if opened is None:
                opened = _Opened(self.open(name, paths), stamp)
            self._opened[name] = opened
            opened.readers += 1
            for other in list(self._opened)[: max(0, len(self._opened) - self.size)]:
                self._drop(self._opened.pop(other))
        try:
            yield opened.map
        finally:
            with self._lock:
                opened.readers -= 1
                if opened.stale and not opened.readers:
                    opened.map.close()

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
            for opened in self._opened.values():
                self._drop(opened)
            self._opened.clear()

    def _drop(self, opened: _Opened) -> None:
        opened.stale = True
        if not opened.readers:
            opened.map.close()


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
