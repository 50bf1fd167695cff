"""Means over squares of cells about every cell of a plane, a face or a camera."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from query.answers.images.local_fits import Fit

__all__ = ["plane_fits"]

Floats = NDArray[np.float64]

_REACHES = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
"""Cells that a window reaches to either side."""
_BAND = 2**15
"""Cells of a band: what is kept of all windows of a cell takes a kilobyte and more."""
_PART = 4.0 / 3.0
"""What a window departs from the truth, over what it departs from a quarter of it: for a parabola
the first is as the area of the window."""


def plane_fits(
    flux: Floats, variance: Floats, size: Floats, *, joins: bool = True
) -> Iterator[Iterator[Fit]]:
    """Means over squares of growing size, cut off at the border; of one band of rows after another.

    Parameters
    ----------
    flux : (n_shares, n_v, n_u) flux per cell of shares of the light
    variance : (n_v, n_u) of the flux of all of it
    size : (n_v, n_u) area or etendue of cells; 0: no light comes there
    joins : False where cells that are neighbours in the picture are none on the face

    Yields
    ------
    for each band the fits at its cells, in windows of growing size
    """
    total = float(flux.sum())
    known = float(variance.sum()) / total if total > 0.0 else 0.0
    tables = [_table(image) for image in (*flux, variance, size)]
    widest = max(size.shape) if joins else 0
    high = max(1, _BAND // size.shape[1])
    for first in range(0, size.shape[0], high):
        rows = range(first, min(first + high, size.shape[0]))
        yield _band_fits(tables, rows, widest, 1e-12 * total, known)


def _band_fits(
    tables: list[Floats], rows: range, widest: int, least: float, known: float
) -> Iterator[Fit]:
    """The fits at the cells of some rows."""
    for reach in _REACHES:
        if reach > widest:
            return
        *parts, squares, area = (_sums(table, reach, rows) for table in tables)
        *parts_near, _, area_near = (_sums(table, reach // 2, rows) for table in tables)
        # Differences of large sums leave a rest where there is nothing
        light, light_near = _without_rest(parts, least), _without_rest(parts_near, least)
        values = _over(light, area)
        departure = _PART * (values - _over(light_near, area_near))
        held = light.sum(axis=0)
        spread, near = _over(np.ones_like(area), area), _over(np.ones_like(area), area_near)
        ray = np.where(
            held > least, np.maximum(squares, 0.0) / np.maximum(held, least or 1.0), known
        )
        yield Fit(
            values=values.reshape(len(values), -1),
            departure=departure.reshape(len(values), -1),
            spread=spread.ravel(),
            departure_spread=(_PART**2 * (near - spread)).ravel(),
            ray=ray.ravel(),
            cost=1.0,
        )


def _table(image: Floats) -> Floats:
    """Sums over all cells below and left of each corner."""
    table = np.zeros((image.shape[0] + 1, image.shape[1] + 1))
    table[1:, 1:] = image.cumsum(axis=0).cumsum(axis=1)
    return table


def _sums(table: Floats, reach: int, rows: range) -> Floats:
    """Sums over the square about every cell of some rows."""
    ends = []
    n_v, n_u = table.shape[0] - 1, table.shape[1] - 1
    for n, cell in ((n_v, np.arange(rows.start, rows.stop)), (n_u, np.arange(n_u))):
        ends.append((np.maximum(cell - reach, 0), np.minimum(cell + reach + 1, n)))
    (bottom, top), (left, right) = ends
    above, below = table[top], table[bottom]
    high = above[:, right] - above[:, left]
    result: Floats = high - below[:, right] + below[:, left]
    return result


def _without_rest(parts: list[Floats], least: float) -> Floats:
    light = np.stack(parts)
    result: Floats = np.where(light > least, light, 0.0)
    return result


def _over(values: Floats, size: Floats) -> Floats:
    result: Floats = np.divide(values, size, out=np.zeros_like(values), where=size > 0.0)
    return result
