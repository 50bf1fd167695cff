"""Where meshes are not: a coarse grid of cells that most rays past a mesh need only to look at.

A plate of printed dots or small lenses fills little of the box around it, and a ray crosses that
box in a cell or two. Asking the search tree costs many times as much as looking at those cells.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["MeshCells", "find_cells"]

F64 = NDArray[np.float64]

_CELLS = 2**15
"""Cells of a grid: they stay in the first-level cache."""


class MeshCells(NamedTuple):
    """Cells that triangles may reach into.

    box : (9,) lowest and highest corner of the grid, cells per length along each axis
    occupied : (n_x, n_y, n_z) 1 where a triangle may reach into the cell
    """

    box: F64
    occupied: NDArray[np.uint8]


def find_cells(low: F64, high: F64, margin: float) -> MeshCells:
    """Cells that boxes around triangles touch.

    Parameters
    ----------
    low, high : (n_triangles, 3) corners of the boxes [scene units]
    margin : by which the boxes are enlarged, above rounding
    """
    low, high = low - margin, high + margin
    start, extent = low.min(axis=0), high.max(axis=0) - low.min(axis=0)
    # Shrink the cells, about cubes, while there are few enough
    counts, edge = np.ones(3, np.int64), float(extent.max())
    while True:
        edge *= 0.97
        finer = np.maximum(1, np.floor(extent / edge)).astype(np.int64)
        if finer.prod() > _CELLS:
            break
        counts = finer
    per_length = counts / extent
    first = np.clip(((low - start) * per_length).astype(np.int64), 0, counts - 1)
    after = np.clip(((high - start) * per_length).astype(np.int64), 0, counts - 1) + 1
    # Count the boxes over each cell: sum up what begins and ends there along each axis
    changes = np.zeros(counts + 1, np.int64)
    for corner in np.ndindex(2, 2, 2):
        place = tuple(np.where(np.array(corner)[:, None], after.T, first.T))
        np.add.at(changes, place, 1 - 2 * (sum(corner) % 2))
    covered = changes.cumsum(0).cumsum(1).cumsum(2)[:-1, :-1, :-1]
    return MeshCells(
        box=np.concatenate((start, start + extent, per_length)),
        occupied=np.ascontiguousarray(covered > 0).astype(np.uint8),
    )
