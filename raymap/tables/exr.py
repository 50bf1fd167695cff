"""OpenEXR files: 32-bit float, any channels; a header and zlib streams, written without a library.

References
----------
OpenEXR file layout, Academy Software Foundation;
A. Fichet, R. Pacanowski, A. Wilkie, "An OpenEXR layout for spectral images", Journal of Computer
Graphics Techniques 10(3), 1 (2021): names of spectral channels.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.replacing import replacing

__all__ = ["spectral_channels", "write_exr"]


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
    target = Path(path)
    with replacing(target) as beside:
        beside.write_bytes(header + table + b"".join(blocks))
