"""Detector pictures as files: PNG, TIFF, OpenEXR, CSV, NumPy; written beside and renamed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.answers.images.ies_file import write_ies
from query.answers.images.narrow import narrow
from query.answers.images.pictures import DetectorImage
from query.answers.images.png import png_bytes, upright
from raymap.model.errors import RayMapError
from raymap.model.extras import require
from raymap.model.replacing import check_place, replacing

__all__ = ["KINDS", "check_image", "write_image"]

QUANTITIES = ("irradiance", "illuminance", "intensity", "candela", "radiance", "luminance")
"""Flux per area, solid angle or étendue, in watt and in lumen."""
KINDS = ("rgb", "flux", "flux_se", "rays", "density", "density_se", *QUANTITIES, "spectral")
_SUFFIXES = (".png", ".tif", ".tiff", ".exr", ".csv", ".npy", ".ies")


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
    if kind in QUANTITIES:
        return image.quantity(kind)[2]
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


def check_image(path: str | Path, kind: str | None = None) -> None:
    """Refuse, before anything is computed, a picture that `write_image` cannot write.

    Raises
    ------
    RayMapError
        unknown kind or suffix, a kind that the format does not hold, or no such folder.
    MissingExtra
        a TIFF without the package tifffile.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in _SUFFIXES:
        raise RayMapError(f"pictures end in {', '.join(_SUFFIXES)}, not {target.name!r}")
    check_place(target)
    if kind is not None and kind not in KINDS:
        raise RayMapError(f"pictures are of kind {', '.join(KINDS)}, not {kind!r}")
    if suffix == ".ies" and kind not in (None, "candela"):
        raise RayMapError(
            f"an .ies file holds candela, not {kind}; leave the kind out, or write .csv, .exr, "
            ".tiff or .npy"
        )
    if suffix in (".tif", ".tiff"):
        require("tifffile")


def write_image(
    image: DetectorImage, path: str | Path, kind: str | None = None, *, zoom: int = 1
) -> Path:
    """Write a picture; the suffix chooses the format, ``kind`` what it holds.

    ``.png``: sRGB or 16-bit grey scaled to its largest value. ``.tiff``: float32 in physical units
    (package tifffile). ``.exr``: float32 in physical units, R, G, B or named channels. ``.csv``: a
    row per cell with its place, the values and their errors. ``.npy``: float64 in physical units,
    row 0 at the bottom as cells count. ``.ies``: the candela of a far field as a luminaire.

    Parameters
    ----------
    kind : one of `KINDS`; by default colours, in a ``.csv`` flux, density and channels beside each
        other, in an ``.ies`` candela
    zoom : pixels of a ``.png`` along either side of a cell

    Raises
    ------
    RayMapError
        unknown kind or suffix, or a kind that the format does not hold.
    MissingExtra
        a TIFF without the package tifffile.
    """
    target = Path(path)
    check_image(target, kind)
    suffix = target.suffix.lower()
    if suffix == ".csv":
        with replacing(target) as beside:
            _write_csv(beside, image, kind)
        return target
    kind = kind or "rgb"
    with replacing(target) as beside:
        if suffix == ".png":
            pixels = _pixels(image, kind).repeat(zoom, axis=0).repeat(zoom, axis=1)
            beside.write_bytes(png_bytes(upright(pixels)))
        elif suffix == ".npy":
            with beside.open("wb") as file:
                np.save(file, values_of(image, kind))
        elif suffix == ".exr":
            _write_exr(beside, image, kind)
        elif suffix == ".ies":
            write_ies(image, beside)
        else:
            _write_tiff(beside, image, kind)
    return target


def _write_tiff(path: Path, image: DetectorImage, kind: str) -> None:
    import tifffile

    values = narrow(upright(values_of(image, kind)))
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
    from raymap.tables.exr import spectral_channels, write_exr

    values = narrow(upright(values_of(image, kind)))
    if values.ndim == 2:
        channels = {"Y": values}
    elif kind == "rgb" or image.channel_set.kind == "rgb":
        channels = {name: values[:, :, k] for k, name in enumerate("RGB")}
    else:
        channels = spectral_channels(image.channel_set.wavelengths_nm, values)
    text = {"detector": image.detector.name, "unit": unit_of(image, kind)}
    write_exr(path, channels, text=text)


def _write_csv(path: Path, image: DetectorImage, kind: str | None) -> None:
    """A row per cell, lowest row first: place of its middle, values and errors."""
    table = _places(image) | (_everything(image) if kind is None else _one_kind(image, kind))
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(table) + "\n")
        columns = [_cells_of(np.asarray(values)) for values in table.values()]
        for row in zip(*columns, strict=True):
            file.write(",".join(row) + "\n")


def _cells_of(values: NDArray[Any]) -> list[str]:
    """Numbers as text: those of a column of real numbers with a point or an exponent.

    Readers take the type of a column from its first rows, where much may be 0.
    """
    if values.dtype.kind in "iub":
        return [str(value) for value in values.tolist()]
    texts = [f"{value:.9g}" for value in values.tolist()]
    return [text if set(text) & set(".en") else text + ".0" for text in texts]


def _places(image: DetectorImage) -> dict[str, NDArray[Any]]:
    """Column and row of each cell, and where its middle lies."""
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
    return {"column": columns, "row": rows, **places}


def _everything(image: DetectorImage) -> dict[str, NDArray[Any]]:
    """Flux, rays, density and channels, in the unit of the map."""
    table: dict[str, NDArray[Any]] = {
        f"flux [{image.flux_unit}]": image.flux.ravel(),
        f"flux_se [{image.flux_unit}]": image.flux_se.ravel(),
        "rays": image.rays.ravel(),
    }
    if image.measure is not None:
        table[f"{image.density_name} [{image.density_unit}]"] = image.density().ravel()
        table[f"{image.density_name}_se [{image.density_unit}]"] = image.density_se.ravel()
    return table | _channels(image)


def _channels(image: DetectorImage) -> dict[str, NDArray[Any]]:
    labels = image.channel_set.labels[: image.channels.shape[2]]
    return {
        f"{label} [{image.flux_unit}]": image.channels[:, :, k].ravel()
        for k, label in enumerate(labels)
    }


def _one_kind(image: DetectorImage, kind: str) -> dict[str, NDArray[Any]]:
    """The values asked for, beside them their errors where these are known."""
    if kind == "spectral":
        return _channels(image)
    unit = unit_of(image, kind)
    if kind == "rgb":
        colors = image.linear_rgb
        return {f"{name} [{unit}]": colors[:, :, k].ravel() for k, name in enumerate("RGB")}
    if kind == "rays":
        return {"rays": image.rays.ravel()}
    table = {f"{kind} [{unit}]": values_of(image, kind).ravel()}
    if kind in QUANTITIES:
        table[f"{kind}_se [{unit}]"] = image.quantity(kind)[1].ravel()
    elif kind in ("flux", "density"):
        table[f"{kind}_se [{unit}]"] = values_of(image, f"{kind}_se").ravel()
    return table
