"""Where the bytes of a map come from: a file of this machine, or one behind an address."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import Protocol

from raymap.bytes.address import Address
from raymap.bytes.positional import read_at
from raymap.model.errors import FormatError, NotARayMap
from raymap.model.givenfile import not_readable

__all__ = ["ByteSource", "LocalBytes", "open_bytes"]


class ByteSource(Protocol):
    """Bytes read at any place by many threads.

    Attributes
    ----------
    bytes_read : fetched so far
    distant : each read costs a request
    """

    bytes_read: int
    distant: bool

    @property
    def size(self) -> int:
        """Bytes there are now."""

    def read(self, offset: int, length: int) -> bytes:
        """``length`` bytes, fewer only at the end.

        Raises
        ------
        FormatError
            They cannot be fetched.
        """

    def prefetch(self, start: int) -> None:
        """Fetch all from ``start`` to the end at once, as it will be read piece by piece."""

    def close(self) -> None:
        """Let go of the file."""


def open_bytes(place: Path | Address) -> ByteSource:
    """Open what stands at a place.

    Raises
    ------
    NotARayMap
        Nothing can be read there.
    """
    if isinstance(place, Address):
        from raymap.bytes.remotebytes import RemoteBytes

        return RemoteBytes(place)
    return LocalBytes(place)


class LocalBytes:
    """A file of this machine; reads do not move a shared position."""

    distant = False

    def __init__(self, path: Path) -> None:
        self.path = path
        # A pipe is waited for when it is opened
        if os.path.exists(path) and not os.path.isfile(path):
            kind = "a folder" if os.path.isdir(path) else "a device or a pipe"
            raise NotARayMap(f"{path} is {kind}, not a ray map; name a file")
        try:
            self._descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
        except (FileNotFoundError, NotADirectoryError):
            raise NotARayMap(f"{path} does not exist; check the path") from None
        except OSError as error:
            raise NotARayMap(not_readable(path, "ray map", error)) from None
        self._lock = threading.Lock()
        self.bytes_read = 0
        self._closed = False

    @property
    def identity(self) -> tuple[int, int]:
        """Device and inode of the open file."""
        status = os.fstat(self._descriptor)
        return status.st_dev, status.st_ino

    @property
    def size(self) -> int:
        return os.fstat(self._descriptor).st_size

    def read(self, offset: int, length: int) -> bytes:
        if self._closed:
            raise FormatError(f"{self.path} is closed")
        try:
            data = read_at(self._descriptor, length, offset)
        except OSError as error:
            raise FormatError(
                f"{self.path} cannot be read at byte {offset}: {error.strerror}"
            ) from None
        with self._lock:
            self.bytes_read += len(data)
        return data

    def prefetch(self, start: int) -> None:
        pass

    def close(self) -> None:
        with self._lock:
            if not self._closed:
                self._closed = True
                os.close(self._descriptor)

    def __del__(self) -> None:
        if hasattr(self, "_closed"):
            self.close()
