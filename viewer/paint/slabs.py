"""Cut large triangles into slabs of depth, so that translucent ones can be drawn back to front.

A large triangle drawn as a whole lies in front of some others at one end and behind them at the
other. Cut where it crosses the planes between slabs across the line of sight, its parts take their
turn slab by slab. Within a slab bodies are drawn in their order, so that faces that lie on one
another mix in the same way everywhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["DEEP", "SLABS", "cut_into_slabs", "drawing_order"]

Triangles = NDArray[np.float32]

SLABS = 96
"""Slabs between the nearest and the farthest corner."""

DEEP = 6.0
"""Triangles of fewer slabs stay whole: they are as small as those of a round body."""

_MOST = 20_000
"""Pieces that a body may fall into, or it stays whole."""


def cut_into_slabs(
    corners: Triangles,
    normals: Triangles,
    forward: NDArray[np.float64],
    bounds: NDArray[np.float64],
) -> tuple[Triangles, Triangles]:
    """Cut triangles that are deep where they cross from one slab to the next.

    Parameters
    ----------
    corners, normals : (n, 3, 3) float32
    forward : (3,) line of sight, unit length
    bounds : (n_slabs + 1,) depths along it where slabs end, rising

    Returns
    -------
    corners, normals : of the pieces, in any order; those of triangles of less than `DEEP` slabs are
        the triangles
    """
    spans = np.ptp(corners.astype(np.float64) @ forward, axis=1) / (bounds[1] - bounds[0])
    deep = spans > DEEP
    if not 0.0 < float(spans[deep].sum()) <= _MOST:
        return corners, normals
    cut = _strips(corners[deep], normals[deep], forward, bounds)
    joined = [
        np.concatenate(part) for part in zip((corners[~deep], normals[~deep]), cut, strict=True)
    ]
    return joined[0], joined[1]


def _strips(
    corners: Triangles,
    normals: Triangles,
    forward: NDArray[np.float64],
    bounds: NDArray[np.float64],
) -> tuple[Triangles, Triangles]:
    """Triangles cut at all bounds between their corners, and at their middle corner."""
    depth = corners.astype(np.float64) @ forward
    turn = np.argsort(depth, axis=1)
    values = np.concatenate((corners, normals), axis=2).astype(np.float64)
    near, middle, far = (
        np.take_along_axis(values, turn[:, k, None, None], axis=1)[:, 0] for k in range(3)
    )
    d = np.take_along_axis(depth, turn, axis=1)
    # Depths of the cuts of each triangle, its corners among them, from near to far
    first = np.searchsorted(bounds, d[:, 0], "right")
    count = np.maximum(np.searchsorted(bounds, d[:, 2], "left") - first, 0)
    row = np.repeat(np.arange(len(d)), count)
    number = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    rows = np.concatenate((row, np.repeat(np.arange(len(d)), 3)))
    levels = np.concatenate((bounds[np.repeat(first, count) + number], d.ravel()))
    order = np.lexsort((levels, rows))
    rows, levels = rows[order], levels[order]
    # Points of the cuts on the long side, and on the two short ones
    a, b, c = d[rows].T
    long = near[rows] + _share(levels - a, c - a) * (far - near)[rows]
    before = near[rows] + _share(levels - a, b - a) * (middle - near)[rows]
    behind = middle[rows] + _share(levels - b, c - b) * (far - middle)[rows]
    short = np.where(((levels <= b) & (a < b))[:, None], before, behind)
    # Two triangles between a cut and the next; at a corner by itself one of them is a line
    at = np.flatnonzero((rows[1:] == rows[:-1]) & (levels[1:] > levels[:-1]))
    one = np.stack((long[at], long[at + 1], short[at + 1]), axis=1)
    other = np.stack((long[at], short[at + 1], short[at]), axis=1)
    one = one[(levels[at + 1] < c[at]) | (b[at] == c[at])]
    other = other[(levels[at] > a[at]) | (a[at] == b[at])]
    pieces = np.concatenate((one, other)).astype(np.float32)
    return pieces[:, :, :3], pieces[:, :, 3:]


def _share(part: NDArray[np.float64], whole: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0.0)[:, None]


def drawing_order(
    depth: NDArray[np.float64], body: NDArray[np.int64], bounds: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Triangles from back to front: by slab, in a slab by body, of a body by depth.

    Parameters
    ----------
    depth : (n,) of the middle of each triangle
    body : (n,) number of its body
    bounds : as of `cut_into_slabs`
    """
    slab = np.searchsorted(bounds, depth)
    return np.lexsort((-depth, body, -slab))
