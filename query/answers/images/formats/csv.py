"""CSV: a row per cell with its place, values and errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.answers.images.formats.format import ImageFormat
from query.answers.images.lit import QUANTITIES
from query.answers.images.pictures import DetectorImage
from query.answers.images.values import unit_of, values_of

__all__ = ["CSV"]


def _write(path: Path, image: DetectorImage, kind: str | None, zoom: int) -> None:
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


CSV = ImageFormat(
    suffixes=(".csv",),
    title="a row per cell: its place, flux, density and channels with their errors",
    place=4.0,
    write=_write,
    default=None,
)

KINDS = (CSV,)
