"""IES LM-63: the candela of a far field as a luminaire."""

from __future__ import annotations

from pathlib import Path

from query.answers.images.formats.format import ImageFormat
from query.answers.images.ies_file import write_ies
from query.answers.images.pictures import DetectorImage

__all__ = ["IES"]


def _write(path: Path, image: DetectorImage, kind: str | None, zoom: int) -> None:
    write_ies(image, path)


IES = ImageFormat(
    suffixes=(".ies",),
    title="the candela of a far field as a luminaire of IES LM-63",
    place=6.0,
    write=_write,
    default="candela",
    holds=("candela",),
)

KINDS = (IES,)
