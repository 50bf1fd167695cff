"""Plots and pictures as files: the suffix chooses the format; written beside and renamed."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from raymap.model.errors import RayMapError
from raymap.model.extras import require
from raymap.model.replacing import check_place, replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["check_figure", "check_picture", "save_figure", "save_picture"]


def check_figure(path: Path) -> None:
    """Refuse, before anything is computed, a plot that cannot be written.

    Raises
    ------
    MissingExtra
        Matplotlib is not installed.
    RayMapError
        Matplotlib writes no such files, or there is no such folder.
    """
    require("matplotlib")
    from matplotlib.backend_bases import FigureCanvasBase

    if path.suffix[1:].lower() not in FigureCanvasBase.get_supported_filetypes():
        raise RayMapError(f"plots end in .png, .pdf or .svg, not {path.name!r}")
    check_place(path)


def check_picture(path: Path) -> None:
    """Refuse, before anything is computed, a picture that cannot be written.

    Raises
    ------
    MissingExtra
        Pillow is not installed.
    RayMapError
        Pillow writes no such files, or there is no such folder.
    """
    require("PIL")
    from PIL import Image

    if Image.registered_extensions().get(path.suffix.lower()) not in Image.SAVE:
        raise RayMapError(f"pictures end in .png, .tiff or .jpg, not {path.name!r}")
    check_place(path)


def save_figure(figure: Figure, path: Path, *, dpi: int = 140) -> None:
    """Write a figure.

    Raises
    ------
    RayMapError
        Matplotlib writes no such files, or the system refuses.
    """
    check_figure(path)
    with replacing(path) as beside:
        figure.savefig(beside, dpi=dpi, format=path.suffix[1:].lower())


def save_picture(rgb: ArrayLike, path: Path, *, enlarge: int = 1) -> None:
    """Write encoded sRGB (rows, columns, 3), 0 .. 1, first row on top.

    Raises
    ------
    MissingExtra
        Pillow is not installed.
    RayMapError
        Pillow writes no such files, or the system refuses.
    """
    check_picture(path)
    from PIL import Image

    values = np.clip(np.asarray(rgb, np.float64), 0.0, 1.0)
    picture = Image.fromarray(np.round(values * 255.0).astype(np.uint8))
    if enlarge > 1:
        picture = picture.resize(
            (picture.width * enlarge, picture.height * enlarge), Image.Resampling.NEAREST
        )
    # Pillow says nothing of a disk that is full when it writes a JPEG itself
    data = io.BytesIO()
    picture.save(data, format=Image.registered_extensions()[path.suffix.lower()])
    with replacing(path) as beside:
        beside.write_bytes(data.getvalue())
