"""Detector pictures as files, by their suffix; written beside and renamed."""

from __future__ import annotations

from pathlib import Path

from query.answers.images.formats.format import IMAGE_FORMATS, ImageFormat
from query.answers.images.pictures import DetectorImage
from query.answers.images.values import KINDS
from raymap.model.errors import RayMapError
from raymap.model.extras import require
from raymap.model.fileformat import by_suffix, known_suffixes
from raymap.model.replacing import check_place, replacing

__all__ = ["check_image", "image_format", "write_image"]


def image_format(path: Path) -> ImageFormat:
    """The format of a picture's suffix.

    Raises
    ------
    RayMapError
        there is none; the message names those that there are
    """
    found = by_suffix(IMAGE_FORMATS, path)
    if found is None:
        known = known_suffixes(IMAGE_FORMATS.kinds())
        raise RayMapError(f"pictures end in {known}, not {path.name!r}")
    return found


def check_image(path: str | Path, kind: str | None = None) -> None:
    """Refuse, before anything is computed, a picture that `write_image` cannot write.

    Raises
    ------
    RayMapError
        unknown kind or suffix, a kind that the format does not hold, or no such folder.
    MissingExtra
        a package that the format needs is not installed.
    """
    target = Path(path)
    chosen = image_format(target)
    check_place(target)
    if kind is not None and kind not in KINDS:
        raise RayMapError(f"pictures are of kind {', '.join(KINDS)}, not {kind!r}")
    if chosen.holds and kind is not None and kind not in chosen.holds:
        others = (each for each in IMAGE_FORMATS.kinds() if not each.holds or kind in each.holds)
        held = ", ".join(chosen.holds)
        raise RayMapError(
            f"{chosen.suffixes[0]} files hold {held}, not {kind}; leave the kind out, or write "
            f"{known_suffixes(others)}"
        )
    if chosen.package:
        require(chosen.package)


def write_image(
    image: DetectorImage, path: str | Path, kind: str | None = None, *, zoom: int = 1
) -> Path:
    """Write a picture; the suffix chooses the format, ``kind`` what it holds.

    ``.png``: sRGB or 16-bit grey scaled to its largest value. ``.tiff``: float32 in physical units
    (package tifffile). ``.exr``: float32 in physical units, R, G, B or named channels. ``.csv``: a
    row per cell with its place, the values and their errors. ``.npy``: float64 in physical units,
    row 0 at the bottom as cells count. ``.ies``: the candela of a far field as a luminaire. Others
    as they are installed (``raymap kinds image_formats``).

    Parameters
    ----------
    kind : one of `query.answers.images.values.KINDS`; by default what the format says: colours, in
        a ``.csv`` flux, density and channels beside each other, in an ``.ies`` candela
    zoom : pixels of a ``.png`` along either side of a cell

    Raises
    ------
    RayMapError
        unknown kind or suffix, or a kind that the format does not hold.
    MissingExtra
        a package that the format needs is not installed.
    """
    target = Path(path)
    check_image(target, kind)
    chosen = image_format(target)
    with replacing(target) as beside:
        chosen.write(beside, image, kind or chosen.default, zoom)
    return target
