"""Means over squares of blocks about every block of a plane, a face or a camera."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from query.answers.images.local_fits import Fit
from query.answers.images.plane_blocks import Blocks, blocks_of_rays
from query.engine.tally import sums as sums_of
from raymap.optics.cellsizes import CellSizes

__all__ = ["cell_fits", "plane_fits"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_REACHES = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
"""Blocks that a window reaches to either side."""
_BAND = 2**15
"""Blocks of a band: what is kept of all windows of a block takes a kilobyte and more."""
_ROWS = 64
"""Rows of blocks of a band; sums are made over these and all that their windows reach."""
_PART = 4.0 / 3.0
"""What a window departs from the truth, over what it departs from a quarter of it: for a parabola
the first is as the area of the window."""


def plane_fits(
    cell: tuple[Ints, Ints],
    shares: Floats,
    variance: Floats,
    rays: Floats,
    sizes: CellSizes,
) -> Iterator[Iterator[Fit]]:
    """Means over squares of growing size, cut off at the border; of one band after another.

    Parameters
    ----------
    cell : rows and columns of the cells that were met, (n,) each, row by row
    shares : (n_shares, n) flux per cell of shares of the light
    variance, rays : (n,) of the flux of all of it, and the number of its rays
    sizes : area or etendue of the cells; 0: no light comes there

    Yields
    ------
    for each band the fits at its blocks, in windows of growing size
    """
    total = float(shares.sum())
    known = float(variance.sum()) / total if total > 0.0 else 0.0
    light = np.concatenate((shares, variance[None]))
    for blocks in blocks_of_rays(*cell, rays, sizes.shape):
        grid = _Grid(blocks.side, cell, light, sizes)
        for band in _bands(blocks):
            if (sized := grid.sized(band)).row.size:
                yield _band_fits(grid, sized, 1e-12 * total, known)


def cell_fits(
    cell: tuple[Ints, Ints], shares: Floats, variance: Floats, size: Floats
) -> Iterator[Fit]:
    """The cells that were met and the largest dark one, each for itself.

    For faces on which cells that are neighbours in the picture are none. Parameters as above,
    but for ``size``, (n_v, n_u) of all cells.
    """
    flux = shares.sum(axis=0)
    known = float(variance.sum()) / float(flux.sum()) if flux.sum() > 0.0 else 0.0
    dark = size.copy()
    dark[cell] = 0.0
    area = np.append(size[cell], dark.max())
    values = _over(np.concatenate((shares, np.zeros((len(shares), 1))), axis=1), area)
    ray = np.append(np.divide(variance, flux, out=np.full_like(flux, known), where=flux > 0), known)
    sized = area > 0.0
    nothing = np.zeros_like(values)[:, sized]
    yield Fit(
        values=values[:, sized],
        departure=nothing,
        spread=1.0 / area[sized],
        departure_spread=nothing[0],
        ray=ray[sized],
        cost=1.0,
    )


def _bands(blocks: Blocks) -> Iterator[Blocks]:
    """Blocks of some rows each, at most as many as are looked at together."""
    first = 0
    while first < len(blocks.row):
        end = int(np.searchsorted(blocks.row, blocks.row[first] + _ROWS))
        end = min(end, first + _BAND)
        yield Blocks(blocks.side, blocks.row[first:end], blocks.column[first:end])
        first = end


class _Grid:
    """Light and size of a picture in blocks of one size."""

    def __init__(self, side: int, cell: tuple[Ints, Ints], light: Floats, sizes: CellSizes) -> None:
        self.side = side
        self.row, self.column = cell[0] // side, cell[1] // side
        self.light = light
        self.cells = sizes.shape
        self.n_v, self.n_u = (-(-n // side) for n in sizes.shape)
        # Windows of cells that are alike are rectangles
        self.alike = sizes.alike
        self.sizes = sizes.joined(side) if self.alike is None else sizes

    def sized(self, blocks: Blocks) -> Blocks:
        """Of blocks those that have a size."""
        if self.alike is not None:
            return blocks if self.alike > 0.0 else Blocks(self.side, *np.zeros((2, 0), np.int64))
        some = self.sizes.at(blocks.row, blocks.column) > 0.0
        return Blocks(self.side, blocks.row[some], blocks.column[some])

    def table(self, rows: range, columns: range) -> Floats:
        """Sums over all blocks of a part that lie below and left of each corner, an image a column.

        Images are the shares, the variance, and the size where cells are not alike.
        """
        high, wide = len(rows), len(columns)
        some = slice(*np.searchsorted(self.row, (rows.start, rows.stop)))
        row, column, light = self.row[some], self.column[some], self.light[:, some]
        inside = (column >= columns.start) & (column < columns.stop)
        index = ((row - rows.start) * wide + column - columns.start)[inside]
        images = [sums_of(index, image[inside], high * wide) for image in light]
        if self.alike is None:
            images.append(self.sizes.part(rows, columns).ravel())
        table = np.zeros((high + 1, wide + 1, len(images)))
        for k, image in enumerate(images):
            table[1:, 1:, k] = image.reshape(high, wide).cumsum(axis=0).cumsum(axis=1)
        return table


@dataclass(frozen=True, eq=False)
class _Windows:
    """Sums over squares about blocks."""

    grid: _Grid
    blocks: Blocks
    table: Floats
    rows: range
    columns: range

    @classmethod
    def about(cls, grid: _Grid, blocks: Blocks) -> _Windows:
        """Windows that reach as far as any does."""
        reach = _REACHES[-1]
        rows, columns = (
            range(max(int(index.min()) - reach, 0), min(int(index.max()) + reach + 1, n))
            for index, n in ((blocks.row, grid.n_v), (blocks.column, grid.n_u))
        )
        return cls(grid, blocks, grid.table(rows, columns), rows, columns)

    def sums(self, reach: int) -> tuple[Floats, Floats, Floats]:
        """(n_shares, n) light, (n,) variance and (n,) size."""
        ends = []
        for index, n in ((self.blocks.row, self.grid.n_v), (self.blocks.column, self.grid.n_u)):
            ends.append((np.maximum(index - reach, 0), np.minimum(index + reach + 1, n)))
        (low, high), (left, right) = ends
        bottom, top = low - self.rows.start, high - self.rows.start
        first, last = left - self.columns.start, right - self.columns.start
        table = self.table
        sums = (table[top, last] - table[top, first]) - table[bottom, last] + table[bottom, first]
        sums = sums.T
        if self.grid.alike is None:
            return sums[:-2], sums[-2], sums[-1]
        side, (n_v, n_u) = self.grid.side, self.grid.cells
        tall = np.minimum(high * side, n_v) - low * side
        wide = np.minimum(right * side, n_u) - left * side
        return sums[:-1], sums[-1], self.grid.alike * tall * wide


def _band_fits(grid: _Grid, blocks: Blocks, least: float, known: float) -> Iterator[Fit]:
    """The fits at some blocks."""
    windows = _Windows.about(grid, blocks)
    for reach in _REACHES:
        if reach > max(grid.n_v, grid.n_u):
            return
        light, squares, area = windows.sums(reach)
        light_near, _, area_near = windows.sums(reach // 2)
        # Differences of large sums leave a rest where there is nothing
        light, light_near = (np.where(part > least, part, 0.0) for part in (light, light_near))
        values = _over(light, area)
        departure = _PART * (values - _over(light_near, area_near))
        held = light.sum(axis=0)
        spread, near = _over(np.ones_like(area), area), _over(np.ones_like(area), area_near)
        ray = np.where(
            held > least, np.maximum(squares, 0.0) / np.maximum(held, least or 1.0), known
        )
        yield Fit(
            values=values,
            departure=departure,
            spread=spread,
            departure_spread=_PART**2 * (near - spread),
            ray=ray,
            cost=1.0,
        )


def _over(values: Floats, size: Floats) -> Floats:
    result: Floats = np.divide(values, size, out=np.zeros_like(values), where=size > 0.0)
    return result
