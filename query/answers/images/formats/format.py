"""What a format of detector pictures is, and those that there are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from query.answers.images.pictures import DetectorImage
from raymap.model.fileformat import FileFormat, suffixes_of
from raymap.model.registry import Registry

__all__ = ["IMAGE_FORMATS", "ImageFormat"]


@dataclass(frozen=True, kw_only=True)
class ImageFormat(FileFormat):
    """A format of pictures of a detector, by the suffixes of its files.

    Attributes
    ----------
    write : writes what a detector measured to a path (a name beside the one that was asked for):
        the image, which kind of picture
        (`query.answers.images.values.KINDS`; None where nothing was asked and there is no
        ``default``), and how many pixels along either side of a cell, where the format has pixels
    default : kind of picture where none is asked for
    holds : kinds of picture that it holds; empty: all
    package : of Python that it needs, beyond those that are always there
    """

    write: Callable[[Path, DetectorImage, str | None, int], None]
    default: str | None = "rgb"
    holds: tuple[str, ...] = ()
    package: str = ""


IMAGE_FORMATS: Registry[ImageFormat] = Registry(
    "raymap.image_formats",
    "query.answers.images.formats",
    words=suffixes_of,
    of=ImageFormat,
    sort="formats of detector pictures",
)
