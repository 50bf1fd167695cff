"""Sizes of the cells of a detector: as numbers, or from a law where it is asked for them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from raymap.optics.seenfaces import SeenFace, areas_over

__all__ = ["CellSizes", "FaceSizes", "TabledSizes", "bin_cells"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FEW = 256
"""Blocks along a side that a face is cut into at least, for the sizes of larger blocks."""

_TOGETHER = 2**16
"""Blocks whose areas are computed together: what is kept of each takes some hundred bytes."""


class CellSizes(Protocol):
    """Sizes of cells, or of square blocks of them."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        ...

    @property
    def alike(self) -> float | None:
        """The size that all cells have; None where they differ."""
        ...

    def at(self, row: Ints, column: Ints) -> Floats:
        """(n,) sizes of some."""
        ...

    def part(self, rows: range, columns: range) -> Floats:
        """(n_rows, n_columns) sizes of a rectangle."""
        ...

    def joined(self, side: int) -> CellSizes:
        """Of blocks of ``side`` x ``side``; those at the far borders may hold fewer."""
        ...

    def total(self) -> float:
        """Of all."""
        ...


@dataclass(frozen=True, eq=False)
class TabledSizes:
    """Sizes that are known one by one, (rows, columns); of strides 0 where all are alike."""

    values: Floats

    @property
    def shape(self) -> tuple[int, int]:
        return self.values.shape[0], self.values.shape[1]

    @property
    def alike(self) -> float | None:
        return float(self.values[0, 0]) if self.values.strides == (0, 0) else None

    def at(self, row: Ints, column: Ints) -> Floats:
        return np.asarray(self.values[row, column])

    def part(self, rows: range, columns: range) -> Floats:
        return self.values[rows.start : rows.stop, columns.start : columns.stop]

    def joined(self, side: int) -> TabledSizes:
        return TabledSizes(bin_cells(self.values, side))

    def total(self) -> float:
        alike = self.alike
        return float(self.values.sum()) if alike is None else alike * self.values.size


@dataclass(frozen=True, eq=False, kw_only=True)
class FaceSizes:
    """Areas of the cells of a face, computed where they are asked for.

    Attributes
    ----------
    face : on its map
    size : of the map (u, v) [length unit]
    cells : rows and columns of the map
    unit : length unit [m]
    side : cells along the side of a block
    """

    face: SeenFace
    size: tuple[float, float]
    cells: tuple[int, int]
    unit: float
    side: int = 1

    @property
    def shape(self) -> tuple[int, int]:
        return -(-self.cells[0] // self.side), -(-self.cells[1] // self.side)

    @property
    def alike(self) -> None:
        return None

    def at(self, row: Ints, column: Ints) -> Floats:
        x, y = self._sides(column, 0), self._sides(row, 1)
        return areas_over(self.face, x, y) * self.unit**2

    def part(self, rows: range, columns: range) -> Floats:
        values = np.empty((len(rows), len(columns)))
        high = max(1, _TOGETHER // max(1, len(columns)))
        for first in range(0, len(rows), high):
            some = slice(first, first + high)
            row, column = np.meshgrid(rows[some], columns, indexing="ij")
            values[some] = self.at(row.ravel(), column.ravel()).reshape(row.shape)
        return values

    def joined(self, side: int) -> CellSizes:
        if side == 1:
            return self
        whole = side
        # Large blocks are summed over smaller ones, which the edge cuts less often
        while side % 2 == 0 and -(-max(self.cells) // (self.side * side)) < _FEW:
            side //= 2
        finer = FaceSizes(
            face=self.face,
            size=self.size,
            cells=self.cells,
            unit=self.unit,
            side=self.side * side,
        )
        if side == whole:
            return finer
        return TabledSizes(bin_cells(finer.part(*map(range, finer.shape)), whole // side))

    def total(self) -> float:
        side = 2 ** max(0, (max(self.shape) // _FEW).bit_length() - 1)
        blocks = self.joined(side)
        return float(blocks.part(*map(range, blocks.shape)).sum())

    def _sides(self, index: Ints, axis: int) -> Floats:
        """(2, n) where blocks begin and end on the map."""
        n = self.cells[1 - axis]
        ends = np.minimum(np.stack((index, index + 1)) * self.side, n)
        return np.asarray((ends / n - 0.5) * self.size[axis])


def bin_cells(values: NDArray[np.floating], side: int) -> Floats:
    """Sums of blocks of cells; those at the far borders may hold fewer cells."""
    for axis in (0, 1) if side > 1 else ():
        values = np.add.reduceat(values, np.arange(0, values.shape[axis], side), axis)
    return np.asarray(values, np.float64)
