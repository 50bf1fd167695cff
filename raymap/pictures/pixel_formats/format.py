"""What a format of plain pixels is, and those that there are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.fileformat import FileFormat, suffixes_of
from raymap.model.registry import Registry

__all__ = ["PIXEL_FORMATS", "PixelFormat"]


@dataclass(frozen=True, kw_only=True)
class PixelFormat(FileFormat):
    """A format of pictures of colours, by the suffixes of its files.

    Attributes
    ----------
    write : writes (rows, columns, 3) uint8 in sRGB with row 0 at the top to a path, which is a name
        beside the one that was asked for and need not end as that does
    package : of Python that it needs, beyond those that are always there
    """

    write: Callable[[Path, NDArray[np.uint8]], Any]
    package: str = ""


PIXEL_FORMATS: Registry[PixelFormat] = Registry(
    "raymap.pixel_formats",
    "raymap.pictures.pixel_formats",
    words=suffixes_of,
    of=PixelFormat,
    sort="formats of plain pictures",
)
