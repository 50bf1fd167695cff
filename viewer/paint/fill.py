"""Fill shaded triangles into a picture: opaque bodies by depth, translucent ones back to front.

The counterpart of `viewer.paint.raster` for bodies. A picture therefore needs neither a graphics
card nor a graphics library, and is the same on every machine.
"""

from __future__ import annotations

import itertools
import math
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import kernel
from viewer.paint.interrupt import Cancel, pieces

__all__ = ["OPAQUE", "fill_triangles"]

TRIANGLES_AT_ONCE = 256
"""Between two looks whether the picture is still wanted."""

OPAQUE = 0.995
"""Above this opacity a triangle hides what is behind it."""


@kernel
def _edge_x(x0: float, y0: float, x1: float, y1: float, y: float) -> float:
    """Where an edge crosses a row; the same for both triangles that share the edge."""
    if y0 > y1 or (y0 == y1 and x0 > x1):
        x0, y0, x1, y1 = x1, y1, x0, y0
    return x0 + (y - y0) * (x1 - x0) / (y1 - y0)


@kernel
def _fill_band(
    order: NDArray[np.int64],
    corners: NDArray[np.float64],
    normals: NDArray[np.float32],
    rgba: NDArray[np.float32],
    opaque: bool,
    depth: NDArray[np.float32],
    image: NDArray[np.float32],
    first_row: int,
    last_row: int,
) -> None:
    """Fill triangles over rows ``first_row:last_row``; normals are in the camera's frame."""
    columns = depth.shape[1]
    for k in range(order.shape[0]):
        i = order[k]
        x0, y0 = corners[i, 0, 0], corners[i, 0, 1]
        x1, y1 = corners[i, 1, 0], corners[i, 1, 1]
        x2, y2 = corners[i, 2, 0], corners[i, 2, 1]
        low, high = min(y0, y1, y2), max(y0, y1, y2)
        if not (high > first_row and low < last_row):
            continue
        if not (max(x0, x1, x2) > 0 and min(x0, x1, x2) < columns):
            continue
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if not abs(area) > 1e-9:
            continue
        row_first = max(first_row, math.ceil(low - 0.5))
        row_last = min(last_row - 1, math.ceil(high - 0.5) - 1)
        for row in range(row_first, row_last + 1):
            # Span of the row between the two edges that it crosses
            y = row + 0.5
            left, right = np.inf, -np.inf
            if (y0 <= y) != (y1 <= y):
                x = _edge_x(x0, y0, x1, y1, y)
                left, right = min(left, x), max(right, x)
            if (y1 <= y) != (y2 <= y):
                x = _edge_x(x1, y1, x2, y2, y)
                left, right = min(left, x), max(right, x)
            if (y2 <= y) != (y0 <= y):
                x = _edge_x(x2, y2, x0, y0, y)
                left, right = min(left, x), max(right, x)
            if not right > left:
                continue
            column_first = max(0, math.ceil(left - 0.5))
            column_last = min(columns - 1, math.ceil(right - 0.5) - 1)
            for column in range(column_first, column_last + 1):
                # Barycentric weights and depth
                x = column + 0.5
                b1 = ((x - x0) * (y2 - y0) - (x2 - x0) * (y - y0)) / area
                b2 = ((x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)) / area
                b0 = 1.0 - b1 - b2
                z = b0 * corners[i, 0, 2] + b1 * corners[i, 1, 2] + b2 * corners[i, 2, 2]
                if z > depth[row, column]:
                    continue

                # Shade by a light beside the camera; grazing glass reflects more
                nx = b0 * normals[i, 0, 0] + b1 * normals[i, 1, 0] + b2 * normals[i, 2, 0]
                ny = b0 * normals[i, 0, 1] + b1 * normals[i, 1, 1] + b2 * normals[i, 2, 1]
                nz = b0 * normals[i, 0, 2] + b1 * normals[i, 1, 2] + b2 * normals[i, 2, 2]
                length = math.sqrt(nx * nx + ny * ny + nz * nz) + 1e-12
                facing = abs(nz) / length
                side = 1.0 if nz < 0 else -1.0
                lit = max(0.0, side * (-0.30 * nx - 0.45 * ny - 0.84 * nz) / length)
                shade = 0.38 + 0.62 * lit
                shine = 0.25 * lit**24
                alpha = rgba[i, 3]
                if not opaque:
                    graze = 1.0 - facing
                    alpha = alpha + (1.0 - alpha) * 0.55 * graze * graze * graze * alpha**0.5
                    shine *= alpha
                keep = 1.0 - alpha
                for c in range(3):
                    tone = min(1.0, rgba[i, c] * shade + shine)
                    image[row, column, c] = alpha * tone + keep * image[row, column, c]
                image[row, column, 3] = alpha + keep * image[row, column, 3]
                if opaque:
                    depth[row, column] = z


def fill_triangles(
    corners: NDArray[np.float64],
    normals: NDArray[np.float32],
    rgba: NDArray[np.float32],
    *,
    depth: NDArray[np.float32],
    image: NDArray[np.float32],
    order: NDArray[np.int64] | None = None,
    threads: int | None = None,
    cancel: Cancel | None = None,
) -> None:
    """Fill triangles: first the opaque ones by depth, then the others from back to front.

    Parameters
    ----------
    corners : (n, 3, 3) float64, pixels x and y, depth
    normals : (n, 3, 3) float32 at the corners, in the frame right, down, forward of the camera
    rgba : (n, 4) float32, 0 … 1
    depth : (height, width) float32, lowered where opaque triangles lie
    image : (height, width, 4) float32, premultiplied, drawn over in place
    order : (n,) triangles from back to front; None goes by the depth of their middles
    threads : bands of rows filled at the same time; None takes the processors
    cancel : gives the picture up

    Raises
    ------
    Interrupted
    """
    rows = depth.shape[0]
    n_bands = max(1, min(threads or os.cpu_count() or 1, rows // 64 or 1))
    bounds = [int(bound) for bound in np.linspace(0, rows, n_bands + 1)]
    solid = rgba[:, 3] > OPAQUE
    if order is None:
        order = np.argsort(-corners[:, :, 2].sum(axis=1), kind="stable")
    clear = order[(~solid & (rgba[:, 3] > 0))[order]]
    for rows_of, opaque in ((np.flatnonzero(solid), True), (clear, False)):
        if len(rows_of) == 0:
            continue
        with ThreadPoolExecutor(n_bands) as pool:
            for part in pieces(len(rows_of), TRIANGLES_AT_ONCE, cancel):
                given = (rows_of[part], corners, normals, rgba, opaque, depth, image)
                for done in [
                    pool.submit(_fill_band, *given, first, last)
                    for first, last in itertools.pairwise(bounds)
                ]:
                    done.result()
