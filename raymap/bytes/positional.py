"""Reading and writing at a place of an open file, by many threads at once.

Systems without calls for it (Windows) go to the place first, one thread after the other.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence

__all__ = ["read_at", "write_at"]

_moving = threading.Lock()


def read_at(descriptor: int, length: int, offset: int) -> bytes:
    """Read without a care for the position of the file; fewer bytes only at its end.

    Raises
    ------
    OSError
        The file cannot be read there.
    """
    parts: list[bytes] = []
    got = 0
    while got < length:
        part = _read_some(descriptor, length - got, offset + got)
        if not part:
            break
        parts.append(part)
        got += len(part)
    return parts[0] if len(parts) == 1 else b"".join(parts)


def write_at(descriptor: int, views: Sequence[memoryview], offset: int) -> int:
    """Write some of the bytes, one view after the other; returns how many.

    Raises
    ------
    OSError
        The file cannot be written there.
    """
    return _write_some(descriptor, views, offset)


def _move_and_read(descriptor: int, length: int, offset: int) -> bytes:
    with _moving:
        os.lseek(descriptor, offset, os.SEEK_SET)
        return os.read(descriptor, length)


def _move_and_write(descriptor: int, views: Sequence[memoryview], offset: int) -> int:
    with _moving:
        os.lseek(descriptor, offset, os.SEEK_SET)
        return os.write(descriptor, views[0])


_read_some = os.pread if hasattr(os, "pread") else _move_and_read
_write_some = os.pwritev if hasattr(os, "pwritev") else _move_and_write
