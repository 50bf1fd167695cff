"""How much clients may write: a quota of the served folder, and room that stays free on the disk.

What clients have written is remembered in the folder, in a hidden file that they cannot name: a new
start of the service makes no new room.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Any

from raymap.model.errors import RayMapError
from service.files.confine import OutsideFolder, ServedFolder
from service.limits import Limits

__all__ = ["LEDGER", "Disk"]

LEDGER = ".raymap-written.json"
"""Which files clients have written, and what was there before."""

_LEAST_FILE = 4096
"""What a file or folder counts at least, so that empty ones are not free."""

_MOST_LEDGER = 2**26


class Disk:
    """Counts what clients record and upload, from the first start of a service on.

    Parameters
    ----------
    folder : the served folder
    limits : with ``disk_bytes`` and ``spare_bytes``

    Raises
    ------
    RayMapError
        What an earlier service wrote down cannot be read: nobody knows how much there is.
    """

    def __init__(self, folder: ServedFolder, limits: Limits) -> None:
        self.folder, self.root, self.limits = folder, folder.root, limits
        self._kept: dict[Path, int] = {}
        self._before: dict[Path, int] = {}
        self._written: list[tuple[Path, int]] = []
        self._lock = threading.Lock()
        self._remember()

    def room(self) -> int:
        """Bytes that may still be written; negative where it is too much already."""
        with self._lock:
            used = sum(self._kept.values())
            used += sum(_grown(path, before) for path, before in self._written)
        free = shutil.disk_usage(self.root).free - self.limits.spare_bytes
        return min(self.limits.disk_bytes - used, free)

    def check(self, what: str, more: int = 1, *, folders: int = 0) -> None:
        """Refuse to write more than there is room for.

        Parameters
        ----------
        what : is to be written
        more : bytes
        folders : that are made for it, each of which counts as a file

        Raises
        ------
        RayMapError
        """
        more += folders * _LEAST_FILE
        most = self.limits.written_files - folders
        if self.room() < more or self._files() >= most:
            with self._lock:
                self._forget_removed()
        if self._files() >= most:
            raise RayMapError(
                f"{what}: clients have written {self.limits.written_files} files into this folder; "
                "its owner removes some, or moves them"
            )
        if self.room() < more:
            raise RayMapError(
                f"{what}: there is no room: clients may write {self.limits.disk_bytes >> 20} MiB "
                f"into this folder, and {self.limits.spare_bytes >> 20} MiB of the disk "
                "stay free; its owner raises --disk-bytes or removes what they wrote"
            )

    def _files(self) -> int:
        return len(self._kept) + len(self._written)

    @contextmanager
    def writing(
        self, written: Path, target: Path, *, keeps: bool, folders: Sequence[Path] = ()
    ) -> Iterator[None]:
        """Count a file while it is written, and from then on.

        Parameters
        ----------
        written : the file that grows
        target : what it is called when it is whole
        keeps : what stood there before stays, and counts no more than it did
        folders : that were made for it; they count whatever becomes of the file
        """
        with self._lock:
            self._kept |= dict.fromkeys(folders, _LEAST_FILE)
            earlier = self._kept.pop(target, 0)
            before = self._before.get(target, _size(target)) if keeps else 0
            entry = (written, before)
            self._written.append(entry)
            self._note()
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
                self._note()

    def _remember(self) -> None:
        """Count what clients wrote while earlier services ran."""
        try:
            with os.fdopen(self.folder.open(self.root / LEDGER), "rb") as stream:
                text = stream.read(_MOST_LEDGER + 1)
            rows = _read_rows(text)
        except FileNotFoundError:
            return
        except (OSError, OutsideFolder, ValueError, RecursionError):
            raise RayMapError(
                f"{self.root / LEDGER} says what clients wrote into this folder, and cannot be "
                "read: repair it, or remove it to begin at nothing"
            ) from None
        for name, before in rows.items():
            path = self.root / name
            with suppress(OSError):
                size = path.lstat().st_size
                self._kept[path] = max(_LEAST_FILE, size - before)
                self._before[path] = before

    def _forget_removed(self) -> None:
        """What its owner removed makes room again."""
        for path in [path for path in self._kept if not path.exists()]:
            del self._kept[path]
            self._before.pop(path, None)

    def _note(self) -> None:
        """Write down what counts, so that the next service knows it."""
        self._forget_removed()
        files = {path: self._before.get(path, 0) for path in self._kept}
        files |= dict(self._written)
        rows = {path.relative_to(self.root).as_posix(): size for path, size in files.items()}
        beside = f"{LEDGER}.{secrets.token_hex(4)}"
        try:
            with self.folder.holding(self.root) as held:
                try:
                    with os.fdopen(held.create(beside), "wb") as stream:
                        stream.write(json.dumps({"files": rows}).encode())
                    held.replace(beside, LEDGER)
                finally:
                    held.remove(beside)
        except OSError as error:
            print(
                f"what clients write cannot be noted in {self.root / LEDGER} ({error.strerror}): "
                "the next service will not count it",
                file=sys.stderr, flush=True,
            )  # fmt: skip


def _read_rows(text: bytes) -> dict[str, int]:
    """Sizes that were there before, by name; `ValueError` for what no service has written."""
    if len(text) > _MOST_LEDGER:
        raise ValueError
    found: Any = json.loads(text)
    rows = found.get("files") if isinstance(found, dict) else None
    if not isinstance(rows, dict):
        raise ValueError
    for name, size in rows.items():
        plain = PurePosixPath(name)
        if not isinstance(size, int) or size < 0 or plain.is_absolute() or ".." in plain.parts:
            raise ValueError
    return rows


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _grown(path: Path, before: int) -> int:
    return max(0, _size(path) - before)
