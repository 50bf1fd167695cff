"""Pixels as PNG files, without a library of pictures.

References
----------
PNG, W3C Recommendation (third edition), sections 5, 9, 11.3.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["animation_bytes", "png_bytes", "upright"]

Pixels = NDArray[np.uint8] | NDArray[np.uint16]

_UP = 2
"""The filter by the row above, which suits smooth pictures."""


def upright(values: NDArray[Any]) -> NDArray[Any]:
    """Row 0 at the top, as files count rows."""
    return values[::-1]


def png_bytes(pixels: Pixels) -> bytes:
    """A PNG of (rows, columns[, 3]) pixels of 8 or 16 bits, row 0 at the top."""
    return _header(pixels) + _chunk(b"IDAT", _scanlines(pixels)) + _chunk(b"IEND", b"")


def animation_bytes(frames: Sequence[Pixels], *, seconds_per_frame: float) -> bytes:
    """Pictures of one size as an animated PNG that repeats for ever."""
    height, width = frames[0].shape[:2]
    data = _header(frames[0]) + _chunk(b"acTL", struct.pack(">II", len(frames), 0))
    delay = max(1, round(1000.0 * seconds_per_frame))
    sequence = 0
    for number, frame in enumerate(frames):
        control = (sequence, width, height, 0, 0, delay, 1000, 0, 0)
        data += _chunk(b"fcTL", struct.pack(">IIIIIHHBB", *control))
        sequence += 1
        if number == 0:
            data += _chunk(b"IDAT", _scanlines(frame))
        else:
            data += _chunk(b"fdAT", struct.pack(">I", sequence) + _scanlines(frame))
            sequence += 1
    return data + _chunk(b"IEND", b"")


def _chunk(tag: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + tag + body + struct.pack(">I", zlib.crc32(tag + body))


def _header(pixels: Pixels) -> bytes:
    height, width = pixels.shape[:2]
    color = 2 if pixels.ndim == 3 else 0
    fields = struct.pack(">IIBBBBB", width, height, 8 * pixels.dtype.itemsize, color, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", fields) + _chunk(b"sRGB", b"\0")


def _scanlines(pixels: Pixels) -> bytes:
    """Compressed scan lines, each the difference to the one above, byte by byte."""
    big_endian = np.ascontiguousarray(pixels.astype(pixels.dtype.newbyteorder(">")))
    rows = big_endian.reshape(len(pixels), -1).view(np.uint8).reshape(len(pixels), -1)
    filtered = rows.copy()
    filtered[1:] -= rows[:-1]
    lines = np.concatenate((np.full((len(rows), 1), _UP, np.uint8), filtered), axis=1)
    return zlib.compress(lines.tobytes(), 6)
