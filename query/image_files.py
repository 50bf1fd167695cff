"""Detector pictures as files: PNG, TIFF, OpenEXR, CSV, NumPy; written beside and renamed."""

from __future__ import annotations

import base64
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.pictures import DetectorImage
from raymap.errors import MissingExtra, RayMapError
from raymap.replacing import replacing

__all__ = ["KINDS", "png_bytes", "png_html", "write_image"]

KINDS = (
    "rgb", "flux", "flux_se", "rays", "density", "density_se", "irradiance", "illuminance",
    "intensity", "candela", "radiance", "luminance", "spectral",
)  # fmt: skip
_SUFFIXES = (".png", ".tif", ".tiff", ".exr", ".csv", ".npy", ".ies")


def _upright(values: NDArray[Any]) -> NDArray[Any]:
    """Row 0 at the top, as files count rows."""
    return values[::-1]


def png_bytes(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """A PNG of (rows, columns[, 3]) pixels of 8 or 16 bits."""
    height, width = pixels.shape[:2]
    depth = pixels.dtype.itemsize * 8
    color = 2 if pixels.ndim == 3 else 0
    big_endian = pixels.astype(pixels.dtype.newbyteorder(">"))
    rows = big_endian.reshape(height, -1).view(np.uint8).reshape(height, -1)
    filtered = np.concatenate((np.zeros((height, 1), np.uint8), rows), axis=1).tobytes()

    def chunk(tag: bytes, data: bytes) -> bytes:
        checksum = zlib.crc32(tag + data)
        return struct.pack(">I", len(data)) + tag + data + struct.pack(">I", checksum)

    header = struct.pack(">IIBBBBB", width, height, depth, color, 0, 0, 0)
    return b"".join(
        (
            b"\x89PNG\r\n\x1a\n",
            chunk(b"IHDR", header),
            chunk(b"sRGB", b"\0"),
            chunk(b"IDAT", zlib.compress(filtered, 6)),
            chunk(b"IEND", b""),
        )
    )


def png_html(image: DetectorImage) -> str:
    """An HTML image for notebooks."""
    data = base64.b64encode(png_bytes(_upright(image.srgb()))).decode()
    return f'<img src="data:image/png;base64,{data}" alt="{image.detector.name}">'


def values_of(image: DetectorImage, kind: str) -> NDArray[Any]:
    """(cells_v, cells_u[, n]) values of one kind of picture, row 0 at the bottom."""
    if kind == "rgb":
        return image.linear_rgb
    if kind == "spectral":
        return image.channels
    if kind not in KINDS:
        raise RayMapError(f"pictures are of kind {', '.join(KINDS)}, not {kind!r}")
    if kind == "density":
        return image.density()
    result: NDArray[Any] = getattr(image, kind)
    return result


def unit_of(image: DetectorImage, kind: str) -> str:
    """Unit of the values of a kind of picture."""
    if kind == "rays":
        return "rays"
    if kind in ("rgb", "flux", "flux_se", "spectral"):
        return f"{image.flux_unit} per cell"
    luminous = kind in ("illuminance", "candela", "luminance")
    if luminous and image.measure is not None:
        return image.measure.density_unit("lm")
    return image.density_unit or ""


def _pixels(image: DetectorImage, kind: str) -> NDArray[Any]:
    """What a PNG shows: sRGB, or grey from 0 to the largest value in 16 bits."""
    if kind == "rgb":
        return image.srgb()
    values = values_of(image, kind)
    if values.ndim == 3:
        raise RayMapError("a PNG holds no spectra; write .npy or .tiff, or the kind rgb")
    top = float(values.max()) or 1.0
    return np.round(np.clip(values / top, 0, 1) * 65535).astype(np.uint16)


def write_image(
    image: DetectorImage, path: str | Path, kind: str = "rgb", *, zoom: int = 1
) -> Path:
    """Write a picture; the suffix chooses the format.

    ``.png``: sRGB or 16-bit grey scaled to its largest value. ``.tiff``: float32 in physical units
    (package tifffile). ``.exr``: float32 in physical units, R, G, B or named channels. ``.csv``: a
    row per cell with place, flux, errors and channels, whatever the kind. ``.npy``: float64 in
    physical units, row 0 at the bottom as cells count. ``.ies``: the candela of a far field as a
    luminaire, whatever the kind.

    Parameters
    ----------
    zoom : pixels of a ``.png`` along either side of a cell

    Raises
    ------
    RayMapError
        unknown kind or suffix.
    MissingExtra
        a TIFF without the package tifffile.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in _SUFFIXES:
        raise RayMapError(f"pictures end in {', '.join(_SUFFIXES)}, not {target.name!r}")
    if not target.parent.is_dir():
        raise RayMapError(f"there is no folder {target.parent} to write {target.name} into")
    with replacing(target) as beside:
        if suffix == ".png":
            pixels = _pixels(image, kind).repeat(zoom, axis=0).repeat(zoom, axis=1)
            beside.write_bytes(png_bytes(_upright(pixels)))
        elif suffix == ".npy":
            with beside.open("wb") as file:
                np.save(file, values_of(image, kind))
        elif suffix == ".exr":
            _write_exr(beside, image, kind)
        elif suffix == ".ies":
            from query.ies_file import write_ies

            write_ies(image, beside)
        elif suffix == ".csv":
            _write_csv(beside, image)
        else:
            _write_tiff(beside, image, kind)
    return target


def _write_tiff(path: Path, image: DetectorImage, kind: str) -> None:
    try:
        import tifffile
    except ImportError:
        raise MissingExtra(
            "TIFF pictures need the package tifffile (pip install tifffile); .npy and .png need "
            "nothing more"
        ) from None
    values = _upright(values_of(image, kind)).astype(np.float32)
    if values.ndim == 3 and values.shape[2] != 3:
        values = np.moveaxis(values, 2, 0)
    tifffile.imwrite(
        path,
        values,
        photometric="rgb" if values.ndim == 3 and values.shape[-1] == 3 else "minisblack",
        metadata={"unit": unit_of(image, kind), "detector": image.detector.name},
    )


def _write_exr(path: Path, image: DetectorImage, kind: str) -> None:
    """One channel Y, or R, G, B, or one per channel of the trace; beside it its error."""
    from raymap.exr import spectral_channels, write_exr

    values = _upright(values_of(image, kind)).astype(np.float32)
    if values.ndim == 2:
        channels = {"Y": values}
    elif kind == "rgb" or image.channel_set.kind == "rgb":
        channels = {name: values[:, :, k] for k, name in enumerate("RGB")}
    else:
        channels = spectral_channels(image.channel_set.wavelengths_nm, values)
    text = {"detector": image.detector.name, "unit": unit_of(image, kind)}
    write_exr(path, channels, text=text)


def _write_csv(path: Path, image: DetectorImage) -> None:
    """A row per cell, lowest row first: place of its middle, sums and errors."""
    detector = image.detector
    rows, columns = (index.ravel() for index in np.indices(image.flux.shape))
    u = (columns + 0.5) / detector.cells[0]
    v = (rows + 0.5) / detector.cells[1]
    unit = str(detector.parameters.get("size_unit", image.length_unit))
    gamma = detector.parameters.get("gamma_deg") if detector.kind == "far_field" else None
    if gamma is not None:
        places = {"c [deg]": 360.0 * u, "gamma [deg]": gamma[0] + v * (gamma[1] - gamma[0])}
    else:
        places = {
            f"u [{unit}]": (u - 0.5) * detector.size[0],
            f"v [{unit}]": (v - 0.5) * detector.size[1],
        }
    table: dict[str, NDArray[Any]] = {"column": columns, "row": rows, **places}
    table[f"flux [{image.flux_unit}]"] = image.flux.ravel()
    table[f"flux_se [{image.flux_unit}]"] = image.flux_se.ravel()
    table["rays"] = image.rays.ravel()
    if image.measure is not None:
        table[f"{image.density_name} [{image.density_unit}]"] = image.density().ravel()
        table[f"{image.density_name}_se [{image.density_unit}]"] = image.density_se.ravel()
    for k, label in enumerate(image.channel_set.labels[: image.channels.shape[2]]):
        table[f"{label} [{image.flux_unit}]"] = image.channels[:, :, k].ravel()
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(table) + "\n")
        for row in zip(*(column.tolist() for column in table.values()), strict=True):
            file.write(",".join(f"{value:.9g}" for value in row) + "\n")
