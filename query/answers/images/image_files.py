"""Detector pictures as files: PNG, TIFF, OpenEXR, CSV, NumPy; written beside and renamed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.answers.images.ies_file import write_ies
from query.answers.images.lit import QUANTITIES
from query.answers.images.narrow import narrow
from query.answers.images.pictures import DetectorImage
from query.answers.images.png import png_bytes, upright
from raymap.model.errors import RayMapError
from raymap.model.extras import require
from raymap.model.replacing import check_place, replacing

__all__ = ["KINDS", "check_image", "write_image"]

KINDS = ("rgb", "flux", "flux_se", "rays", "density", "density_se", *QUANTITIES, "spectral")
_SUFFIXES = (".png", ".tif", ".tiff", ".exr", ".csv", ".npy", ".ies")


def values_of(image: DetectorImage, kind: str) -> NDArray[Any]:
    """(n,) or (n, m) values of one kind of picture at the cells that were met; 0 elsewhere."""
    lit = image.lit
    if kind not in KINDS:
        raise RayMapError(f"pictures are of kind {', '.join(KINDS)}, not {kind!r}")
    if kind in QUANTITIES:
        return lit.quantity(kind)[0]
    if kind == "density":
        return lit.per_measure(lit.flux)
    if kind == "density_se":
        return lit.per_measure(np.sqrt(lit.variance))
    if kind == "rgb":
        return lit.linear_rgb
    if kind == "flux_se":
        return np.sqrt(lit.variance)
    return {"spectral": lit.channels, "flux": lit.flux, "rays": lit.rays}[kind]


def unit_of(image: DetectorImage, kind: str) -> str:
    """Unit of the values of a kind of picture."""
    if kind == "rays":
        return "rays"
    if kind in ("rgb", "flux", "flux_se", "spectral"):
        return f"{image.flux_unit} per cell"
    if kind in QUANTITIES:
        return image.lit.quantity(kind)[2]
    return image.density_unit or ""


def _pixels(image: DetectorImage, kind: str) -> NDArray[Any]:
    """What a PNG shows: sRGB, or grey from 0 to the largest value in 16 bits."""
    if kind == "rgb":
        return image.srgb()
    values = values_of(image, kind)
    if values.ndim == 2:
        raise RayMapError("a PNG holds no spectra; write .npy or .tiff, or the kind rgb")
    top = float(values.max(initial=0.0)) or 1.0
    return image.lit.spread(np.round(np.clip(values / top, 0, 1) * 65535).astype(np.uint16))


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
                np.save(file, image.lit.spread(values_of(image, kind)))
        elif suffix == ".exr":
            _write_exr(beside, image, kind)
        elif suffix == ".ies":
            write_ies(image, beside)
        else:
            _write_tiff(beside, image, kind)
    return target


def _write_tiff(path: Path, image: DetectorImage, kind: str) -> None:
    import tifffile

    values = upright(image.lit.spread(narrow(values_of(image, kind))))
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

    values = upright(image.lit.spread(narrow(values_of(image, kind))))
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
    lit = image.lit
    columns = _everything(image) if kind is None else _one_kind(image, kind)
    texts = [_cells_of(values) for values in columns.values()]
    # Dark cells, of which there may be many more, differ in their place alone
    dark = ",".join("0" if values.dtype.kind in "iub" else "0.0" for values in columns.values())
    width, height = lit.detector.cells
    across, along, names = _places(image)
    first = np.searchsorted(lit.cell, np.arange(height + 1) * width).tolist()
    column = lit.column.tolist()
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join((*names, *columns)) + "\n")
        for row in range(height):
            rows = [dark] * width
            for k in range(first[row], first[row + 1]):
                rows[column[k]] = ",".join(text[k] for text in texts)
            file.writelines(
                f"{u},{row},{place},{along[row]},{values}\n"
                for u, (place, values) in enumerate(zip(across, rows, strict=True))
            )


def _cells_of(values: NDArray[Any]) -> list[str]:
    """Numbers as text: those of a column of real numbers with a point or an exponent.

    Readers take the type of a column from its first rows, where much may be 0.
    """
    if values.dtype.kind in "iub":
        return [str(value) for value in values.tolist()]
    texts = [f"{value:.9g}" for value in values.tolist()]
    return [text if set(text) & set(".en") else text + ".0" for text in texts]


def _places(image: DetectorImage) -> tuple[list[str], list[str], tuple[str, ...]]:
    """Where the middles of columns and of rows lie, and the names of what says where a cell is."""
    detector = image.detector
    u, v = ((np.arange(n) + 0.5) / n for n in detector.cells)
    unit = str(detector.parameters.get("size_unit", image.length_unit))
    gamma = detector.parameters.get("gamma_deg") if detector.kind == "far_field" else None
    if gamma is not None:
        names = "c [deg]", "gamma [deg]"
        across, along = 360.0 * u, gamma[0] + v * (gamma[1] - gamma[0])
    else:
        names = f"u [{unit}]", f"v [{unit}]"
        across, along = (u - 0.5) * detector.size[0], (v - 0.5) * detector.size[1]
    return _cells_of(across), _cells_of(along), ("column", "row", *names)


def _everything(image: DetectorImage) -> dict[str, NDArray[Any]]:
    """Flux, rays, density and channels of the lit cells, in the unit of the map."""
    lit = image.lit
    table: dict[str, NDArray[Any]] = {
        f"flux [{image.flux_unit}]": lit.flux,
        f"flux_se [{image.flux_unit}]": np.sqrt(lit.variance),
        "rays": lit.rays,
    }
    if image.measure is not None:
        values, errors, unit = lit.quantity()
        table[f"{image.density_name} [{unit}]"] = values
        table[f"{image.density_name}_se [{unit}]"] = errors
    return table | _channels(image)


def _channels(image: DetectorImage) -> dict[str, NDArray[Any]]:
    channels = image.lit.channels
    labels = image.channel_set.labels[: channels.shape[1]]
    return {f"{label} [{image.flux_unit}]": channels[:, k] for k, label in enumerate(labels)}


def _one_kind(image: DetectorImage, kind: str) -> dict[str, NDArray[Any]]:
    """The values asked for of the lit cells, beside them their errors where these are known."""
    if kind == "spectral":
        return _channels(image)
    unit = unit_of(image, kind)
    values = values_of(image, kind)
    if kind == "rgb":
        return {f"{name} [{unit}]": values[:, k] for k, name in enumerate("RGB")}
    if kind == "rays":
        return {"rays": values}
    table = {f"{kind} [{unit}]": values}
    if kind in QUANTITIES:
        table[f"{kind}_se [{unit}]"] = image.lit.quantity(kind)[1]
    elif kind in ("flux", "density"):
        table[f"{kind}_se [{unit}]"] = values_of(image, f"{kind}_se")
    return table
