"""TIFF: float32 in physical units, through the package tifffile."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from query.answers.images.formats.format import ImageFormat
from query.answers.images.narrow import narrow
from query.answers.images.pictures import DetectorImage
from query.answers.images.values import unit_of, values_of
from raymap.pictures.png import upright

__all__ = ["TIFF"]


def _write(path: Path, image: DetectorImage, kind: str | None, zoom: int) -> None:
    import tifffile

    kind = kind or "rgb"
    values = upright(image.lit.spread(narrow(values_of(image, kind))))
    if values.ndim == 3 and values.shape[2] != 3:
        values = np.moveaxis(values, 2, 0)
    tifffile.imwrite(
        path,
        values,
        photometric="rgb" if values.ndim == 3 and values.shape[-1] == 3 else "minisblack",
        metadata={"unit": unit_of(image, kind), "detector": image.detector.name},
    )


TIFF = ImageFormat(
    suffixes=(".tiff", ".tif"),
    title="float32 in physical units",
    place=2.0,
    write=_write,
    package="tifffile",
)

KINDS = (TIFF,)
