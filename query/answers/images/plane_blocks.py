"""Square blocks that the cells of a plane, a face or a camera are divided into.

Of a picture every block with enough rays is cut into four, down to single cells. So light
in a few cells is looked at cell by cell, and dark regions are one block: there are as many blocks
as rays ask for, however many cells a detector has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from query.engine.tally import sums as sums_of

__all__ = ["MOST_BLOCKS", "Blocks", "blocks_of_rays"]

Ints = NDArray[np.int64]

MOST_BLOCKS = 2**17
"""Blocks that a picture is divided into at most."""
_CUT = 9.0
"""Rays from which on a block is cut: windows that hold fewer are not tested (`local_fits`)."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of one size.

    Attributes
    ----------
    side : cells along an edge; at the far borders of the picture they may hold fewer
    row, column : (n,) of blocks of that size, row by row
    """

    side: int
    row: Ints
    column: Ints


def blocks_of_rays(
    cell_row: Ints, cell_column: Ints, rays: NDArray[np.float64], shape: tuple[int, int]
) -> list[Blocks]:
    """Divide a picture into blocks; each cell lies in one of them.

    Parameters
    ----------
    cell_row, cell_column : (n,) of cells that were met
    rays : (n,) in each
    shape : rows and columns of the picture

    Returns
    -------
    blocks by size, the smallest first
    """
    levels = max(shape[0] - 1, shape[1] - 1).bit_length()
    occupied = []
    row, column, held = cell_row, cell_column, rays
    for level in range(levels + 1):
        if level:
            width = -(-shape[1] // 2**level)
            number, inverse = np.unique(row // 2 * width + column // 2, return_inverse=True)
            held = sums_of(inverse, held, len(number))
            row, column = number // width, number % width
        occupied.append((row, column, held))
    cut = _CUT
    while _count(occupied, cut, shape) > MOST_BLOCKS:
        cut *= 2.0
    result = []
    for level in range(levels + 1):
        blocks = _whole(occupied, level, cut, shape)
        if len(blocks.row):
            result.append(blocks)
    return result


Occupied = list[tuple[Ints, Ints, NDArray[np.float64]]]
"""Blocks that hold rays, by level: row, column, rays."""


def _count(occupied: Occupied, cut: float, shape: tuple[int, int]) -> int:
    """How many blocks there are: a block that is cut gives way to its pieces."""
    n = 1
    for level, (row, column, held) in enumerate(occupied):
        if level:
            rows, columns = (-(-n // 2 ** (level - 1)) for n in shape)
            large = held >= cut
            tall, wide = 2 * row[large] + 1 < rows, 2 * column[large] + 1 < columns
            n += int(((1 + tall) * (1 + wide) - 1).sum())
    return n


def _whole(occupied: Occupied, level: int, cut: float, shape: tuple[int, int]) -> Blocks:
    """The blocks of a level that are not cut further."""
    rows, columns = (-(-n // 2**level) for n in shape)
    pieces = np.zeros(1, np.int64)
    if level + 1 < len(occupied):
        # What larger blocks are cut into
        row, column, held = occupied[level + 1]
        row = (2 * row[held >= cut, None] + np.array([0, 0, 1, 1])).ravel()
        column = (2 * column[held >= cut, None] + np.array([0, 1, 0, 1])).ravel()
        inside = (row < rows) & (column < columns)
        pieces = row[inside] * columns + column[inside]
    if level:
        row, column, held = occupied[level]
        pieces = np.setdiff1d(pieces, (row * columns + column)[held >= cut], assume_unique=True)
    pieces = np.sort(pieces)
    return Blocks(2**level, pieces // columns, pieces % columns)
