"""From a pixel to the ray that is drawn there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import kernel
from viewer.paint.raster import NEAR

__all__ = ["Pick", "pick_segment", "pick_triangle"]


@dataclass(frozen=True, kw_only=True)
class Pick:
    """A segment under a pixel.

    Attributes
    ----------
    segment : its index
    fraction : place on the segment, 0 at its start
    distance_px : from the pixel to the line
    """

    segment: int
    fraction: float
    distance_px: float


@kernel
def _nearest(
    segments: NDArray[np.float32],
    rgba: NDArray[np.uint8],
    matrix: NDArray[np.float64],
    px: float,
    py: float,
    tolerance: float,
) -> tuple[int, float, float]:
    """Nearest visible segment in pixels; of several as near (within half a pixel) the foremost."""
    best, best_distance, best_depth, best_fraction = -1, tolerance + 0.5, np.inf, 0.0
    for i in range(segments.shape[0]):
        if rgba[i, 3] == 0:
            continue

        # Project both ends
        ax, ay, az = segments[i, 0, 0], segments[i, 0, 1], segments[i, 0, 2]
        bx, by, bz = segments[i, 1, 0], segments[i, 1, 1], segments[i, 1, 2]
        wa = matrix[3, 0] * ax + matrix[3, 1] * ay + matrix[3, 2] * az + matrix[3, 3]
        wb = matrix[3, 0] * bx + matrix[3, 1] * by + matrix[3, 2] * bz + matrix[3, 3]
        if not (wa >= NEAR or wb >= NEAR):
            continue
        xa = matrix[0, 0] * ax + matrix[0, 1] * ay + matrix[0, 2] * az + matrix[0, 3]
        xb = matrix[0, 0] * bx + matrix[0, 1] * by + matrix[0, 2] * bz + matrix[0, 3]
        ya = matrix[1, 0] * ax + matrix[1, 1] * ay + matrix[1, 2] * az + matrix[1, 3]
        yb = matrix[1, 0] * bx + matrix[1, 1] * by + matrix[1, 2] * bz + matrix[1, 3]
        s0, s1 = 0.0, 1.0
        if wa < NEAR:
            s0 = (NEAR - wa) / (wb - wa)
        elif wb < NEAR:
            s1 = (NEAR - wa) / (wb - wa)
        w0, w1 = wa + s0 * (wb - wa), wa + s1 * (wb - wa)
        x0, y0 = (xa + s0 * (xb - xa)) / w0, (ya + s0 * (yb - ya)) / w0
        x1, y1 = (xa + s1 * (xb - xa)) / w1, (ya + s1 * (yb - ya)) / w1

        if (
            min(x0, x1) > px + tolerance
            or max(x0, x1) < px - tolerance
            or min(y0, y1) > py + tolerance
            or max(y0, y1) < py - tolerance
        ):
            continue

        # Distance from the pixel to the segment
        dx, dy = x1 - x0, y1 - y0
        length2 = dx * dx + dy * dy
        t = ((px - x0) * dx + (py - y0) * dy) / length2 if length2 > 0.0 else 0.0
        t = min(max(t, 0.0), 1.0)
        distance = math.hypot(x0 + t * dx - px, y0 + t * dy - py)
        if distance > tolerance or distance > best_distance + 0.5:
            continue

        # Place on the segment in space, and depth there
        s = s0 + (s1 - s0) * t * w0 / (t * w0 + (1.0 - t) * w1)
        depth = 0.0
        for axis in range(3):
            place = segments[i, 0, axis] + s * (segments[i, 1, axis] - segments[i, 0, axis])
            depth += matrix[2, axis] * place
        if distance < best_distance - 0.5 or depth < best_depth:
            best, best_distance, best_depth, best_fraction = i, distance, depth, s
    return best, best_fraction, best_distance


def pick_segment(
    segments: NDArray[np.float32],
    rgba: NDArray[np.uint8],
    matrix: NDArray[np.float64],
    x_px: float,
    y_px: float,
    *,
    tolerance: float = 6.0,
) -> Pick | None:
    """Find the drawn segment under a pixel.

    Parameters
    ----------
    segments : (n, 2, 3) float32 [scene units]
    rgba : (n, 4) uint8; segments with alpha 0 are not drawn and not found
    matrix : (4, 4), world to pixels
    tolerance : how far the line may pass by [pixels]
    """
    found, fraction, distance = _nearest(
        segments, rgba, matrix, float(x_px), float(y_px), float(tolerance)
    )
    if found < 0:
        return None
    return Pick(segment=int(found), fraction=float(fraction), distance_px=float(distance))


def pick_triangle(
    vertices: NDArray[np.float32],
    triangles: NDArray[np.int32],
    origin: NDArray[np.float64],
    direction: NDArray[np.float64],
) -> tuple[int, float] | None:
    """First triangle on a line of sight (Möller and Trumbore 1997), and its distance.

    Parameters
    ----------
    vertices : (n, 3) [scene units]
    triangles : (m, 3)
    origin, direction : (3,) [scene units], unit vector
    """
    a, b, c = (vertices[triangles[:, corner]].astype(np.float64) for corner in range(3))
    edge1, edge2 = b - a, c - a
    p = np.cross(direction, edge2)
    determinant = np.einsum("ij,ij->i", edge1, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        to_origin = origin - a
        u = np.einsum("ij,ij->i", to_origin, p) / determinant
        q = np.cross(to_origin, edge1)
        v = (q @ direction) / determinant
        distance = np.einsum("ij,ij->i", edge2, q) / determinant
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    if not hit.any():
        return None
    rows = np.flatnonzero(hit)
    first = rows[np.argmin(distance[rows])]
    return int(first), float(distance[first])
