"""OpenEXR: float32 in physical units, R, G, B or named channels."""

from __future__ import annotations

from pathlib import Path

from query.answers.images.formats.format import ImageFormat
from query.answers.images.narrow import narrow
from query.answers.images.pictures import DetectorImage
from query.answers.images.values import unit_of, values_of
from raymap.pictures.png import upright
from raymap.tables.exr import spectral_channels, write_exr

__all__ = ["EXR"]


def _write(path: Path, image: DetectorImage, kind: str | None, zoom: int) -> None:
    """One channel Y, or R, G, B, or one per channel of the trace; beside it its error."""
    kind = kind or "rgb"
    values = upright(image.lit.spread(narrow(values_of(image, kind))))
    if values.ndim == 2:
        channels = {"Y": values}
    elif kind == "rgb" or image.channel_set.kind == "rgb":
        channels = {name: values[:, :, k] for k, name in enumerate("RGB")}
    else:
        channels = spectral_channels(image.channel_set.wavelengths_nm, values)
    text = {"detector": image.detector.name, "unit": unit_of(image, kind)}
    write_exr(path, channels, text=text)


EXR = ImageFormat(
    suffixes=(".exr",),
    title="float32 in physical units: R, G, B or named channels",
    place=3.0,
    write=_write,
)

KINDS = (EXR,)
