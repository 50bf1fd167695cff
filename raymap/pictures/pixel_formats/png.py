"""Plain pictures as PNG."""

from __future__ import annotations

from raymap.pictures.pixel_formats.format import PixelFormat
from raymap.pictures.png import png_bytes

__all__ = ["PNG"]

PNG = PixelFormat(
    suffixes=(".png",),
    title="sRGB, 8 bits, as it is",
    place=1.0,
    write=lambda path, pixels: path.write_bytes(png_bytes(pixels)),
)

KINDS = (PNG,)
