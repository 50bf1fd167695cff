"""Plots and pictures as files: the suffix chooses the format; written beside and renamed."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from raymap.errors import MissingExtra, RayMapError
from raymap.replacing import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["save_figure", "save_picture"]


def save_figure(figure: Figure, path: Path, *, dpi: int = 140) -> None:
    """Write a figure.

    Raises
    ------
    RayMapError
        Matplotlib writes no such files, or the system refuses.
    """
    kind = path.suffix[1:].lower()
    known = figure.canvas.get_supported_filetypes()
    if kind not in known:
        raise RayMapError(f"plots end in .png, .pdf or .svg, not {path.name!r}")
    with replacing(path) as beside:
        figure.savefig(beside, dpi=dpi, format=kind)


def save_picture(rgb: ArrayLike, path: Path, *, enlarge: int = 1) -> None:
    """Write encoded sRGB (rows, columns, 3), 0 .. 1, first row on top.

    Raises
    ------
    MissingExtra
        Pillow is not installed.
    RayMapError
        Pillow writes no such files, or the system refuses.
    """
    try:
        from PIL import Image
    except ImportError:
        raise MissingExtra("pictures need pillow: pip install 'raymap[view]'") from None
    kind = Image.registered_extensions().get(path.suffix.lower())
    if kind is None or kind not in Image.SAVE:
        raise RayMapError(f"pictures end in .png, .tiff or .jpg, not {path.name!r}")
    values = np.clip(np.asarray(rgb, np.float64), 0.0, 1.0)
    picture = Image.fromarray(np.round(values * 255.0).astype(np.uint8))
    if enlarge > 1:
        picture = picture.resize(
            (picture.width * enlarge, picture.height * enlarge), Image.Resampling.NEAREST
        )
    # Pillow says nothing of a disk that is full when it writes a JPEG itself
    data = io.BytesIO()
    picture.save(data, format=kind)
    with replacing(path) as beside:
        beside.write_bytes(data.getvalue())
