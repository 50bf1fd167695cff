"""Plain pictures as TIFF, through the package tifffile."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raymap.pictures.pixel_formats.format import PixelFormat

__all__ = ["TIFF"]


def _write(path: Path, pixels: NDArray[np.uint8]) -> None:
    import tifffile

    tifffile.imwrite(path, pixels, photometric="rgb")


TIFF = PixelFormat(
    suffixes=(".tiff", ".tif"),
    title="sRGB, 8 bits, as it is",
    place=2.0,
    write=_write,
    package="tifffile",
)

KINDS = (TIFF,)
