"""Arrays that a thread uses again from portion to portion: fresh pages cost more than the sums."""

from __future__ import annotations

import math
import mmap
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["BufferPool", "lazy_zeros", "scratch"]

_KEPT_BYTES = 2**26
_local = threading.local()


def scratch(name: str, n: int, dtype: Any) -> NDArray[Any]:
    """An array of n elements of any content, the thread's own under this name.

    It is valid until the thread asks for the name again, so nothing that outlives the encoding of
    a portion may refer to it. Very long arrays are fresh ones.
    """
    wanted = np.dtype(dtype)
    size = n * wanted.itemsize
    if size > _KEPT_BYTES:
        return np.empty(n, wanted)
    kept: dict[str, NDArray[np.uint8]] = _local.__dict__.setdefault("arrays", {})
    if name not in kept or kept[name].size < size:
        kept[name] = np.empty(size + size // 4, np.uint8)
    return kept[name][:size].view(wanted)


def lazy_zeros(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Zeros (float64) that cost memory only where they are written.

    NumPy asks for pages of megabytes for its own large arrays; a few scattered values would then
    take all of them.

    Raises
    ------
    MemoryError
        So much cannot even be addressed.
    """
    size = 8 * math.prod(shape)
    if size <= _KEPT_BYTES:
        return np.zeros(shape)
    try:
        pages = mmap.mmap(-1, size)
    except (OSError, OverflowError, ValueError):
        raise MemoryError(f"{size} bytes cannot be had") from None
    return np.frombuffer(pages, np.float64).reshape(shape)


class BufferPool:
    """Buffers that go from one thread to another and back; safe to use from many threads.

    Memory that is freed goes back to the system and is cleared page by page when it is taken again,
    which costs as much as filling it.
    """

    def __init__(self, kept: int = 8) -> None:
        self._kept = kept
        self._free: list[NDArray[np.uint8]] = []

    def take(self, size: int) -> NDArray[np.uint8]:
        """A buffer of at least ``size`` bytes of any content."""
        try:
            buffer = self._free.pop()
        except IndexError:
            buffer = None
        if buffer is None or not size <= buffer.size <= max(4 * size, _KEPT_BYTES):
            return np.empty(size + size // 8, np.uint8)
        return buffer

    def give(self, buffer: NDArray[np.uint8]) -> None:
        """Take a buffer back, which nobody uses any more."""
        if len(self._free) < self._kept:
            self._free.append(buffer)
