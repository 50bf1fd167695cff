"""PNG: sRGB, or grey from 0 to the largest value in 16 bits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.answers.images import values
from query.answers.images.formats.format import ImageFormat
from query.answers.images.pictures import DetectorImage
from raymap.pictures.png import png_bytes, upright

__all__ = ["PNG"]


def _write(path: Path, image: DetectorImage, kind: str | None, zoom: int) -> None:
    pixels = _pixels(image, kind or "rgb").repeat(zoom, axis=0).repeat(zoom, axis=1)
    path.write_bytes(png_bytes(upright(pixels)))


def _pixels(image: DetectorImage, kind: str) -> NDArray[Any]:
    if kind == "rgb":
        return image.srgb()
    shown = values.values_of(image, kind)
    top = float(shown.max(initial=0.0)) or 1.0
    return image.lit.spread(np.round(np.clip(shown / top, 0, 1) * 65535).astype(np.uint16))


PNG = ImageFormat(
    suffixes=(".png",),
    title="sRGB, or grey in 16 bits scaled to the largest value",
    place=1.0,
    write=_write,
    holds=tuple(kind for kind in values.KINDS if kind != "spectral"),
)

KINDS = (PNG,)
