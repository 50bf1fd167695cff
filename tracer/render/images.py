"""Pictures as files: PNG (8 bit, sRGB) and OpenEXR (32-bit float, any channels).

Both formats are a header and zlib streams, written here without a library.

References
----------
PNG, W3C Recommendation (third edition), sections 5, 9, 11.3.6; OpenEXR file layout, Academy
Software Foundation;
A. Fichet, R. Pacanowski, A. Wilkie, "An OpenEXR layout for spectral images", Journal of Computer
Graphics Techniques 10(3), 1 (2021): names of spectral channels.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.colorimetry import encode_srgb

__all__ = ["spectral_channels", "to_bytes", "write_animation", "write_exr", "write_png"]


def to_bytes(linear: ArrayLike) -> NDArray[np.uint8]:
    """Linear values to 8-bit sRGB."""
    return np.round(255.0 * encode_srgb(linear)).astype(np.uint8)


def _replace(path: Path, data: bytes) -> None:
    """Write beside the target and rename, so that no half-written picture stands there."""
    beside = path.with_name(path.name + ".part")
    beside.write_bytes(data)
    os.replace(beside, path)


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


def spectral_channels(wavelengths_nm: ArrayLike, cube: ArrayLike) -> dict[str, NDArray[np.float32]]:
    """Channels of an emissive spectral image, named like ``S0.550,000000nm``."""
    values = np.asarray(cube, np.float32)
    return {
        f"S0.{wavelength:.6f}nm".replace(".", ",").replace("S0,", "S0."): values[..., k]
        for k, wavelength in enumerate(np.asarray(wavelengths_nm, np.float64))
    }


def _attribute(name: str, kind: str, value: bytes) -> bytes:
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value


def write_exr(
    path: str | Path, channels: Mapping[str, ArrayLike], *, text: Mapping[str, str] | None = None
) -> None:
    """Write (h, w) float32 channels as a ZIP-compressed scan-line OpenEXR file.

    Parameters
    ----------
    channels : name -> (h, w); "R", "G", "B" are what viewers show
    text : further string attributes of the header
    """
    names = sorted(channels)
    planes = [np.ascontiguousarray(np.asarray(channels[name], "<f4")) for name in names]
    height, width = planes[0].shape
    listed = b"".join(name.encode() + b"\0" + struct.pack("<iB3xii", 2, 0, 1, 1) for name in names)
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    header = struct.pack("<II", 20000630, 2 | (0x400 if max(map(len, names)) > 31 else 0))
    header += _attribute("channels", "chlist", listed + b"\0")
    header += _attribute("compression", "compression", b"\x03")
    header += _attribute("dataWindow", "box2i", window)
    header += _attribute("displayWindow", "box2i", window)
    header += _attribute("lineOrder", "lineOrder", b"\0")
    header += _attribute("pixelAspectRatio", "float", struct.pack("<f", 1.0))
    header += _attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0.0, 0.0))
    header += _attribute("screenWindowWidth", "float", struct.pack("<f", 1.0))
    for name, value in (text or {}).items():
        header += _attribute(name, "string", value.encode())
    header += b"\0"

    # Compress blocks of 16 lines: channels side by side in each line, bytes split, differences
    blocks = []
    for top in range(0, height, 16):
        lines = [plane[y].tobytes() for y in range(top, min(top + 16, height)) for plane in planes]
        raw = np.frombuffer(b"".join(lines), np.uint8)
        split = np.concatenate([raw[0::2], raw[1::2]]).astype(np.int16)
        difference = split.copy()
        difference[1:] = split[1:] - split[:-1] + 128
        packed = zlib.compress((difference & 0xFF).astype(np.uint8).tobytes(), 6)
        data = packed if len(packed) < len(raw) else raw.tobytes()
        blocks.append(struct.pack("<ii", top, len(data)) + data)
    offset = len(header) + 8 * len(blocks)
    table = b""
    for block in blocks:
        table += struct.pack("<Q", offset)
        offset += len(block)
    _replace(Path(path), header + table + b"".join(blocks))
