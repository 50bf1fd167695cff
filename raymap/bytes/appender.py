"""Append chunks to a file that one process owns; a chunk is there completely or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from raymap.bytes.locking import try_lock
from raymap.bytes.positional import write_at
from raymap.model.errors import MapExists, MapLocked, NotARayMap, RayMapError

__all__ = ["ChunkAppender"]

_VECTORS = 512
_BEHIND = 2**25
"""Bytes that are written before the disk is asked to take them, so that the end waits for few."""


class ChunkAppender:
    """A locked file descriptor at the end of a map.

    Attributes
    ----------
    path : of the file
    end : where the next chunk begins
    """

    def __init__(self, path: Path, descriptor: int, end: int) -> None:
        self.path = path
        self._descriptor = descriptor
        self.end = end
        self._asked = end
        self._syncing: threading.Thread | None = None

    @staticmethod
    def create(path: Path, *, force: bool = False) -> ChunkAppender:
        """A new, empty, locked file.

        Raises
        ------
        MapExists
            The file exists and ``force`` is off.
        MapLocked
            The file exists and another writer is at work on it.
        """
        if force and path.exists():
            _remove(path)
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        try:
            descriptor = os.open(path, flags, 0o666)
        except FileExistsError:
            raise MapExists(
                f"{path} exists: continue it with --append, replace it with --force "
                "(in Python: RayMapWriter.append_to, force=True), or choose another name"
            ) from None
        except OSError as error:
            raise RayMapError(f"{path} cannot be created: {error.strerror}") from None
        try_lock(descriptor)
        return ChunkAppender(path, descriptor, 0)

    @staticmethod
    def open(path: Path) -> ChunkAppender:
        """An existing file, locked; ``end`` is the end of the file.

        Raises
        ------
        NotARayMap
            There is no such file.
        MapLocked
            Another writer is at work on it.
        """
        try:
            descriptor = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
        except FileNotFoundError:
            raise NotARayMap(f"{path} does not exist: record it first") from None
        except OSError as error:
            raise RayMapError(f"{path} cannot be written: {error.strerror}") from None
        if not try_lock(descriptor):
            os.close(descriptor)
            raise MapLocked(_locked(path))
        return ChunkAppender(path, descriptor, os.fstat(descriptor).st_size)

    def append(self, buffers: Sequence[Any]) -> int:
        """Write a chunk; returns its offset.

        Raises
        ------
        RayMapError
            The disk is full or fails; the file ends with the chunk before, as if this one had
            never been begun.
        """
        offset = self.end
        views = [view for view in map(_as_bytes, buffers) if view.nbytes]
        try:
            while views:
                batch = views[:_VECTORS]
                self._write(batch)
                del views[: len(batch)]
        except OSError as error:
            with contextlib.suppress(OSError):
                self.cut(offset)
            raise RayMapError(
                f"{self.path} cannot be continued ({_reason(error)}); the {offset} bytes before "
                "are sound: make room and go on with --append"
            ) from None
        if self.end - self._asked > _BEHIND and not self._busy():
            self._asked = self.end
            self._syncing = threading.Thread(target=self._flush, name="sync", daemon=True)
            self._syncing.start()
        return offset

    def _busy(self) -> bool:
        return self._syncing is not None and self._syncing.is_alive()

    def _flush(self) -> None:
        with contextlib.suppress(OSError):
            getattr(os, "fdatasync", os.fsync)(self._descriptor)

    def cut(self, end: int) -> None:
        """Drop what lies behind ``end``."""
        os.ftruncate(self._descriptor, end)
        self.end = end

    def sync(self) -> None:
        """Wait until the bytes are on the disk."""
        with contextlib.suppress(OSError):
            os.fsync(self._descriptor)

    def close(self) -> None:
        """Close the file, which frees the lock."""
        if self._descriptor >= 0:
            if self._syncing is not None:
                self._syncing.join()
            os.close(self._descriptor)
            self._descriptor = -1

    def _write(self, views: list[memoryview]) -> None:
        pending = list(views)
        while pending:
            done = write_at(self._descriptor, pending, self.end)
            self.end += done
            while pending and done >= pending[0].nbytes:
                done -= pending.pop(0).nbytes
            if done:
                pending[0] = pending[0][done:]


def _as_bytes(buffer: Any) -> memoryview:
    return memoryview(buffer).cast("B")


def _reason(error: OSError) -> str:
    return "the disk is full" if error.errno == errno.ENOSPC else str(error.strerror)


def _locked(path: Path) -> str:
    return (
        f"another program is writing {path}: wait until it ends, or write a map of its own "
        "and open both together"
    )


def _remove(path: Path) -> None:
    """Make way for a new file; readers of the old one keep what they opened."""
    if not path.is_file():
        raise RayMapError(f"{path} is not a regular file and stays: choose another name")
    old = ChunkAppender.open(path)
    try:
        if sys.platform == "win32":
            # A file that is open cannot be removed there
            old.close()
        path.unlink()
    except OSError as error:
        raise RayMapError(
            f"{path} cannot be replaced ({error.strerror}): close what reads it, or choose another "
            "name"
        ) from None
    finally:
        old.close()
