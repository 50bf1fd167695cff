"""Plain pictures as JPEG, through the package Pillow."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raymap.pictures.pixel_formats.format import PixelFormat

__all__ = ["JPEG"]


def _write(path: Path, pixels: NDArray[np.uint8]) -> None:
    from PIL import Image

    # Pillow says nothing of a disk that is full when it writes a JPEG itself
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "JPEG", quality=92, subsampling=0)
    path.write_bytes(data.getvalue())


JPEG = PixelFormat(
    suffixes=(".jpg", ".jpeg"), title="sRGB with losses", place=3.0, write=_write, package="PIL"
)

KINDS = (JPEG,)
