"""How much clients may write: a quota of the service, and room that stays free on the disk."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from raymap.errors import RayMapError
from service.limits import Limits

__all__ = ["Disk"]

_LEAST_FILE = 4096
"""What a file counts at least, so that empty ones are not free."""


class Disk:
    """Counts what clients record and upload while the service runs.

    Parameters
    ----------
    root : the served folder
    limits : with ``disk_bytes`` and ``spare_bytes``
    """

    def __init__(self, root: Path, limits: Limits) -> None:
        self.root, self.limits = root, limits
        self._kept: dict[Path, int] = {}
        self._before: dict[Path, int] = {}
        self._written: list[tuple[Path, int]] = []
        self._lock = threading.Lock()

    def room(self) -> int:
        """Bytes that may still be written; negative where it is too much already."""
        with self._lock:
            used = sum(self._kept.values())
            used += sum(_grown(place, before) for place, before in self._written)
        free = shutil.disk_usage(self.root).free - self.limits.spare_bytes
        return min(self.limits.disk_bytes - used, free)

    def check(self, what: str, more: int = 1) -> None:
        """Refuse to write more than there is room for.

        Raises
        ------
        RayMapError
        """
        if self.room() < more:
            raise RayMapError(
                f"{what}: there is no room: clients may write {self.limits.disk_bytes >> 20} MiB "
                f"while this service runs, and {self.limits.spare_bytes >> 20} MiB of the disk "
                "stay free; its owner raises --disk-bytes or makes room"
            )

    @contextmanager
    def writing(self, written: Path, target: Path, *, keeps: bool) -> Iterator[None]:
        """Count a file while it is written, and from then on.

        Parameters
        ----------
        written : the file that grows
        target : what it is called when it is whole
        keeps : what stood there before stays, and counts no more than it did
        """
        with self._lock:
            earlier = self._kept.pop(target, 0)
            before = self._before.get(target, _size(target)) if keeps else 0
            entry = (written, before)
            self._written.append(entry)
        try:
            yield
        finally:
            with self._lock:
                self._written.remove(entry)
                there = target if target.exists() else written
                if there.exists():
                    self._kept[target] = max(_LEAST_FILE, _grown(there, before))
                    self._before[target] = before
                elif earlier:
                    self._kept.pop(target, None)


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _grown(path: Path, before: int) -> int:
    return max(0, _size(path) - before)
