"""The detector panel: pictures of what a detector registered, cross sections, drawn regions."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.cells import CellMeasure
from viewer.falsecolor import apply_colormap
from viewer.plots import profile
from viewer.rendering import encode_png

__all__ = [
    "bin_cells",
    "calm_binning",
    "cross_sections",
    "density_facts",
    "image_url",
    "scale_fields",
]

_BINNINGS = (1, 2, 4, 8, 16)
_CALM, _MANY = 0.8, 8.0


def bin_cells(values: NDArray[np.floating], binning: int) -> NDArray[np.float64]:
    """Sums of blocks of cells; those at the far borders may hold fewer cells."""
    rows, columns = (np.arange(0, side, binning) for side in values.shape)
    return np.asarray(np.add.reduceat(np.add.reduceat(values, rows, 0), columns, 1), np.float64)


def calm_binning(values: NDArray[np.floating]) -> int:
    """The finest binning (1 to 16) that shows more than single rays here and there.

    Either most light lies in blocks with many times that of the faintest cells, as in a focus, or
    the blocks beside those that are lit are lit, too.
    """
    if not values.any():
        return 1
    faint = float(np.quantile(values[values > 0.0], 0.1))
    for binning in _BINNINGS:
        blocks = bin_cells(values, binning)
        if float((blocks**2).sum() / blocks.sum()) >= _MANY * faint:
            return binning
        lit = blocks > 0.0
        beside = 4.0 - 2.0 / lit.shape[0] - 2.0 / lit.shape[1]
        pairs = (lit[1:] & lit[:-1]).sum() + (lit[:, 1:] & lit[:, :-1]).sum()
        if 2.0 * pairs >= _CALM * beside * lit.sum():
            return binning
    return _BINNINGS[-1]


def image_url(
    values: NDArray[np.floating],
    *,
    log: bool,
    colormap: str,
    highest: float,
    cells: tuple[int, int],
    binning: int = 1,
) -> str:
    """A detector's cells as a picture for the page, row 0 at the bottom.

    Parameters
    ----------
    values : (rows, columns) flux per block of ``binning`` cells each way
    highest : value of the brightest colour
    cells : of the detector (u, v); the picture has one pixel for each
    """
    pixels = apply_colormap(_scaled(values, log=log, highest=highest), colormap)
    for axis in (0, 1):
        pixels = np.repeat(pixels, binning, axis=axis)
    pixels = pixels[: cells[1], : cells[0]]
    png = encode_png(np.ascontiguousarray(pixels[::-1]))
    return "data:image/png;base64," + base64.b64encode(png).decode()


def density_facts(
    measure: CellMeasure | None,
    selected: NDArray[np.floating],
    whole: NDArray[np.floating],
    place: tuple[int, int],
    binning: int,
    flux_unit: str,
) -> list[list[str]]:
    """What the detector measures at a cell, and at its brightest one: [name, words] each.

    Parameters
    ----------
    measure : size of the detector's cells; None: nothing is said
    selected, whole : (rows, columns) flux per block of ``binning`` cells each way, of the selected
        and of all rays
    place : row and column of the block
    """
    if measure is None:
        return []
    size, unit = bin_cells(measure.values, binning), measure.density_unit(flux_unit)
    dense = [
        np.divide(values, size, out=np.zeros_like(size), where=size > 0)
        for values in (selected, whole)
    ]
    rows = [("Here", [values[place] for values in dense]), ("Peak", [v.max() for v in dense])]
    return [
        [name, f"{mine:.4g} {unit} selected, {all_:.4g} {unit} in all"]
        for name, (mine, all_) in rows
    ]


def lowest_shown(values: NDArray[np.floating], highest: float) -> float:
    """Lower end of a logarithmic scale: the smallest value, but at most seven decades down."""
    positive = values[values > 0]
    low = float(positive.min()) if len(positive) else highest
    return max(low * 0.7, highest * 1e-7)


def _scaled(values: NDArray[np.floating], *, log: bool, highest: float) -> NDArray[np.float64]:
    """Values as places on the scale, 0 … 1."""
    if not highest > 0:
        return np.zeros(values.shape)
    if not log:
        return np.asarray(values / highest, np.float64)
    low = lowest_shown(values, highest)
    span = np.log(highest / low) or 1.0
    return np.asarray(np.clip(np.log(np.maximum(values, low * 1e-3) / low) / span, 0, 1))


def scale_fields(
    values: NDArray[np.floating],
    highest: float,
    *,
    log: bool,
    colormap: str,
    unit: str,
    binning: int,
) -> dict[str, str]:
    """Ends and colours of the scale below the pictures."""
    steps = apply_colormap(np.linspace(0, 1, 12), colormap)
    stops = ", ".join("#" + "".join(f"{int(part):02x}" for part in step) for step in steps)
    low = lowest_shown(values, highest) if log and highest > 0 else 0.0
    cells = "cell" if binning == 1 else f"{binning} × {binning} cells"
    return {
        "image_gradient": f"linear-gradient(to right, {stops})",
        "image_low": f"{low:.3g}" if highest > 0 else "",
        "image_high": f"{highest:.3g} {unit} per {cells}",
    }


def cross_sections(
    selected: NDArray[np.floating],
    full: NDArray[np.floating] | None,
    place: tuple[int, int],
    *,
    log: bool,
) -> str:
    """Flux along the row and the column of a cell, as SVG."""
    column, row = place
    parts = []
    across: Any = (row, slice(None))
    along: Any = (slice(None), column)
    for caption, cut in ((f"row {row}, across u", across), (f"column {column}, across v", along)):
        curves: list[tuple[str, Any, str]] = []
        if full is not None:
            curves.append(("all", full[cut], "#7d8ca1"))
        curves.append(("selected", selected[cut], "#56b4e9"))
        parts.append(profile(curves, log=log, caption=caption))
    return "".join(parts)
