"""Pictures that light is made of: read as linear light, row 0 at the bottom."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import MissingExtra, SceneError
from raymap.model.givenfile import check_given
from raymap.optics.colorimetry import decode_srgb
from tracer.description.named_files import named_file

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["check_pixels", "open_image", "read_picture"]

Array = NDArray[np.float64]
PICTURE_FORMATS = ("PNG", "JPEG", "BMP", "GIF", "TIFF", "WEBP", "PPM", "TGA", "JPEG2000")
"""Formats that are pixels alone; others (EPS, …) start programs that draw them."""


_PIXELS_FLOOR, _PIXELS_PER_BYTE = 2**24, 64
"""Pixels of any picture, and as many times the bytes of its file."""


def read_picture(folder: str | Path, file: str) -> Array:
    """(rows, columns, 3) linear R, G, B >= 0.

    ``.npy`` and float ``.tiff`` hold linear values, (rows, columns) or (rows, columns, 3), row 0 at
    the top; all other files are pictures in sRGB, 8 or 16 bits, and are linearised.

    Raises
    ------
    SceneError
        for a file that is not there or holds no picture
    MissingExtra
        where the package that reads the format is not installed
    """
    path = named_file(folder, file)
    check_given(path, "picture", SceneError)
    pixels = _read(path)
    if pixels.ndim == 2:
        pixels = np.broadcast_to(pixels[:, :, None], (*pixels.shape, 3))
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4) or 0 in pixels.shape:
        raise SceneError(f"{path.name} is not a picture of rows, columns and R, G, B")
    linear = _linear(pixels[::-1, :, :3])
    if not 0.0 <= float(linear.min()) <= float(linear.max()) < math.inf:
        raise SceneError(f"{path.name} holds negative light or values that are not numbers")
    return linear


def _linear(pixels: NDArray[Any]) -> Array:
    """Contiguous linear values; of large pictures nothing else of that size is made."""
    if pixels.dtype.kind == "f":
        return np.ascontiguousarray(pixels, np.float64)
    largest = np.iinfo(pixels.dtype).max
    if pixels.dtype in (np.uint8, np.uint16):
        decoded = np.asarray(decode_srgb(np.arange(largest + 1) / largest), np.float64)
        own: Array = decoded[pixels]
        return own
    return np.ascontiguousarray(decode_srgb(pixels / largest), np.float64)


def _read(path: Path) -> NDArray[Any]:
    suffix = path.suffix.lower()
    try:
        if suffix == ".npy":
            # Mapped, an array cannot be larger than the file that claims to hold it
            return np.array(np.lib.format.open_memmap(path, mode="r"))
        if suffix in (".tif", ".tiff"):
            import tifffile

            # Formats within TIFF whose pictures are spread over files that the first one names
            with tifffile.TiffFile(path, is_ome=False, is_mmstack=False, is_ndtiff=False) as tiff:
                check_pixels(path, math.prod(tiff.series[0].shape))
                return np.asarray(tiff.series[0].asarray())
        with open_image(path) as image:
            if image.mode not in ("L", "RGB", "RGBA", "I;16"):
                return np.asarray(image.convert("RGB"))
            return np.asarray(image)
    except ImportError as error:
        raise MissingExtra(
            f"reading {path.name} needs the package {error.name} (pip install 'raymap[view]'); "
            ".npy files need nothing more"
        ) from None
    except SceneError:
        raise
    except Exception as error:  # readers of foreign files may raise anything
        raise SceneError(f"cannot read the picture {path.name}: {error}") from None


def open_image(path: Path) -> Image:
    """A picture of 8 or 16 bits, not decoded yet; close it.

    Raises
    ------
    SceneError
        It claims more pixels than its file can pay for.
    ImportError, OSError
        Pillow is not installed, or cannot read the file.
    """
    from PIL import Image as images

    with warnings.catch_warnings():
        # How many pixels are too many is said below
        warnings.simplefilter("ignore", images.DecompressionBombWarning)
        image = images.open(path, formats=PICTURE_FORMATS)
    try:
        check_pixels(path, image.width * image.height)
    except SceneError:
        image.close()
        raise
    return image


def check_pixels(path: Path, n: int) -> None:
    """Refuse a picture of more pixels (or values, in TIFF) than its file can pay for.

    Raises
    ------
    SceneError
    """
    size = path.stat().st_size
    limit = max(_PIXELS_FLOOR, _PIXELS_PER_BYTE * size)
    if n > limit:
        raise SceneError(
            f"{path.name} claims {n} pixels in {size} bytes; a file of that size may have {limit}"
        )
