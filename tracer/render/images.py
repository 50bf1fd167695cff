"""Pictures as files: PNG (8 bit, sRGB), written without a library; OpenEXR is `raymap.tables.exr`.

References
----------
PNG, W3C Recommendation (third edition), sections 5, 9, 11.3.6.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.replacing import replacing
from raymap.optics.colorimetry import encode_srgb
from raymap.tables.exr import spectral_channels, write_exr

__all__ = ["spectral_channels", "to_bytes", "write_animation", "write_exr", "write_png"]


def to_bytes(linear: ArrayLike) -> NDArray[np.uint8]:
    """Linear values to 8-bit sRGB."""
    return np.round(255.0 * encode_srgb(linear)).astype(np.uint8)


def _replace(path: Path, data: bytes) -> None:
    """Write beside the target and rename, so that no half-written picture stands there."""
    with replacing(path) as beside:
        beside.write_bytes(data)


def _chunk(tag: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + tag + body + struct.pack(">I", zlib.crc32(tag + body))


def _scanlines(pixels: ArrayLike) -> tuple[bytes, NDArray[np.uint8]]:
    """Compressed scan lines, each filtered by its upper neighbour, which suits smooth pictures."""
    image = np.ascontiguousarray(np.asarray(pixels, np.uint8))
    rows = image.reshape(image.shape[0], -1).astype(np.int16)
    above = np.concatenate([np.zeros_like(rows[:1]), rows[:-1]])
    filtered = ((rows - above) & 0xFF).astype(np.uint8)
    lines = np.column_stack([np.full(len(rows), 2, np.uint8), filtered])
    return zlib.compress(lines.tobytes(), 9), image


def _header(image: NDArray[np.uint8]) -> bytes:
    height, width = image.shape[:2]
    color = 2 if image.ndim == 3 else 0
    fields = struct.pack(">IIBBBBB", width, height, 8, color, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", fields) + _chunk(b"sRGB", b"\x00")


def write_png(path: str | Path, pixels: ArrayLike) -> None:
    """Write (h, w, 3) or (h, w) uint8 pixels; row 0 is the top."""
    packed, image = _scanlines(pixels)
    _replace(Path(path), _header(image) + _chunk(b"IDAT", packed) + _chunk(b"IEND", b""))


def write_animation(
    path: str | Path, frames: Sequence[ArrayLike], *, seconds_per_frame: float
) -> None:
    """Write pictures of one size as an animated PNG that repeats for ever."""
    packed = [_scanlines(frame) for frame in frames]
    height, width = packed[0][1].shape[:2]
    data = _header(packed[0][1]) + _chunk(b"acTL", struct.pack(">II", len(packed), 0))
    delay = max(1, round(1000.0 * seconds_per_frame))
    sequence = 0
    for number, (scanlines, _) in enumerate(packed):
        control = (sequence, width, height, 0, 0, delay, 1000, 0, 0)
        data += _chunk(b"fcTL", struct.pack(">IIIIIHHBB", *control))
        sequence += 1
        if number == 0:
            data += _chunk(b"IDAT", scanlines)
        else:
            data += _chunk(b"fdAT", struct.pack(">I", sequence) + scanlines)
            sequence += 1
    _replace(Path(path), data + _chunk(b"IEND", b""))
