"""Charts and plain pictures as files: the suffix chooses the format; written beside and renamed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import RayMapError
from raymap.model.extras import require
from raymap.model.fileformat import by_suffix, known_suffixes
from raymap.model.replacing import check_place, replacing
from raymap.pictures.chart_formats.format import CHART_FORMATS, ChartFormat
from raymap.pictures.pixel_formats.format import PIXEL_FORMATS, PixelFormat

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["check_chart", "check_pixels", "write_chart", "write_pixels"]


def check_chart(path: str | Path) -> ChartFormat:
    """The format of a chart; refuses, before anything is computed, one that cannot be written.

    Raises
    ------
    RayMapError
        there is no such format, or no such folder.
    MissingExtra
        Matplotlib is not installed.
    """
    target = Path(path)
    found = by_suffix(CHART_FORMATS, target)
    if found is None:
        known = known_suffixes(CHART_FORMATS.kinds())
        raise RayMapError(f"charts end in {known}, not {target.name!r}")
    check_place(target)
    require("matplotlib")
    return found


def write_chart(figure: Figure, path: str | Path) -> None:
    """Write a figure of Matplotlib.

    Raises
    ------
    RayMapError
        there is no such format, or the system refuses.
    """
    chosen = check_chart(path)
    with replacing(Path(path)) as beside:
        chosen.write(beside, figure)


def check_pixels(path: str | Path) -> PixelFormat:
    """The format of a plain picture; refuses, before anything is computed, what cannot be written.

    Raises
    ------
    RayMapError
        there is no such format, or no such folder.
    MissingExtra
        a package that the format needs is not installed.
    """
    target = Path(path)
    found = by_suffix(PIXEL_FORMATS, target)
    if found is None:
        known = known_suffixes(PIXEL_FORMATS.kinds())
        raise RayMapError(f"pictures end in {known}, not {target.name!r}")
    check_place(target)
    if found.package:
        require(found.package)
    return found


def write_pixels(path: str | Path, pixels: NDArray[np.uint8] | NDArray[np.float64]) -> None:
    """Write a picture in sRGB.

    Parameters
    ----------
    pixels : (rows, columns, 3) uint8, or encoded values of 0 .. 1; row 0 at the top

    Raises
    ------
    RayMapError
        there is no such format, or the system refuses.
    """
    chosen = check_pixels(path)
    values = np.asarray(pixels)
    if values.dtype != np.uint8:
        values = np.round(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)
    with replacing(Path(path)) as beside:
        chosen.write(beside, np.ascontiguousarray(values))
