"""Pictures as ``.ppm``: the portable pixmap of Netpbm, binary, 8 bits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from query.answers.images.formats.format import ImageFormat
from query.answers.images.pictures import DetectorImage
from raymap.pictures.pixel_formats.format import PixelFormat
from raymap.pictures.png import upright

__all__ = ["FORMAT", "PIXELS"]


def paint(path: Path, pixels: NDArray[np.uint8]) -> None:
    height, width, _ = pixels.shape
    path.write_bytes(b"P6\n%d %d\n255\n" % (width, height) + np.ascontiguousarray(pixels).tobytes())


def write(path: Path, image: DetectorImage, kind: str | None, zoom: int) -> None:
    paint(path, upright(image.srgb().repeat(zoom, axis=0).repeat(zoom, axis=1)))


FORMAT = ImageFormat(suffixes=(".ppm",), title="pixels of Netpbm", write=write, holds=("rgb",))

PIXELS = PixelFormat(suffixes=(".ppm",), title="pixels of Netpbm", write=paint)
