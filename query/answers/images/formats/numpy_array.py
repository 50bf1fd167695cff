"""An array of NumPy: float64 in physical units, row 0 at the bottom as cells count."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from query.answers.images.formats.format import ImageFormat
from query.answers.images.pictures import DetectorImage
from query.answers.images.values import values_of

__all__ = ["NPY"]


def _write(path: Path, image: DetectorImage, kind: str | None, zoom: int) -> None:
    with path.open("wb") as file:
        np.save(file, image.lit.spread(values_of(image, kind or "rgb")))


NPY = ImageFormat(
    suffixes=(".npy",), title="float64 in physical units, row 0 at the bottom", place=5.0,
    write=_write,
)  # fmt: skip

KINDS = (NPY,)
