"""Pixels as PNG files, without a library of pictures."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["png_bytes", "upright"]


def upright(values: NDArray[Any]) -> NDArray[Any]:
    """Row 0 at the top, as files count rows."""
    return values[::-1]


def png_bytes(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """A PNG of (rows, columns[, 3]) pixels of 8 or 16 bits."""
    height, width = pixels.shape[:2]
    depth = pixels.dtype.itemsize * 8
    color = 2 if pixels.ndim == 3 else 0
    big_endian = pixels.astype(pixels.dtype.newbyteorder(">"))
    rows = big_endian.reshape(height, -1).view(np.uint8).reshape(height, -1)
    filtered = np.concatenate((np.zeros((height, 1), np.uint8), rows), axis=1).tobytes()

    def chunk(tag: bytes, data: bytes) -> bytes:
        checksum = zlib.crc32(tag + data)
        return struct.pack(">I", len(data)) + tag + data + struct.pack(">I", checksum)

    header = struct.pack(">IIBBBBB", width, height, depth, color, 0, 0, 0)
    return b"".join(
        (
            b"\x89PNG\r\n\x1a\n",
            chunk(b"IHDR", header),
            chunk(b"sRGB", b"\0"),
            chunk(b"IDAT", zlib.compress(filtered, 6)),
            chunk(b"IEND", b""),
        )
    )
