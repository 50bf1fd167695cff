"""Flat polygons cut into triangles, concave ones too.

Ears are cut off one by one: corners whose triangle holds no other corner (Meisters, 1975: every
simple polygon of more than three corners has two). After a cut only the two neighbours can have
become ears, so that the work grows with the square of the corners at most.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["crosses_itself", "cut_ears", "is_convex"]

Array = NDArray[np.float64]

_ROUNDING = 1e-10


def is_convex(points: Array) -> bool:
    """Whether a polygon (n, 3) can be cut as a fan about its first corner."""
    flat = _flattened(points)
    edges = np.roll(flat, -1, axis=0) - flat
    after = np.roll(edges, -1, axis=0)
    cross = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]
    if np.any(cross < -_ROUNDING * np.ptp(flat, axis=0).max() ** 2):
        return False
    # A pentagram turns to one side at all corners, but twice around
    turns = np.arctan2(cross, (edges * after).sum(axis=1))
    return bool(abs(turns.sum()) < 3.0 * np.pi)


def crosses_itself(points: Array) -> bool:
    """Whether edges of a polygon (n, 3) run through one another; touching is not crossing."""
    a = _flattened(points)
    b = np.roll(a, -1, axis=0)
    least = _ROUNDING * np.ptp(a, axis=0).max() ** 2
    for k in range(len(a)):
        one, other = _side(a[k], b[k], a), _side(a[k], b[k], b)
        back, on = _side(a, b, a[k]), _side(a, b, b[k])
        apart = (np.minimum(one, other) < -least) & (np.maximum(one, other) > least)
        if np.any(apart & (np.minimum(back, on) < -least) & (np.maximum(back, on) > least)):
            return True
    return False


def cut_ears(points: Array) -> NDArray[np.int64] | None:
    """Triangles (n - 2, 3) of a polygon (n, 3), wound as it is.

    None where no ear is left: the polygon is not simple, or has no area.
    """
    flat = _flattened(points)
    n = len(flat)
    least = _ROUNDING * np.ptp(flat, axis=0).max() ** 2
    after, before = np.roll(np.arange(n), -1), np.roll(np.arange(n), 1)
    left = np.ones(n, bool)
    # Whatever a triangle holds, it holds a corner that is not convex
    blocks = np.flatnonzero(_side(flat[before], flat, flat[after]) <= least)
    triangles: list[tuple[int, int, int]] = []
    waiting = list(range(n))[::-1]
    while len(triangles) < n - 2 and waiting:
        corner = waiting.pop()
        a, c = int(before[corner]), int(after[corner])
        if not left[corner] or not _is_ear(flat, blocks[left[blocks]], (a, corner, c), least):
            continue
        triangles.append((a, corner, c))
        left[corner] = False
        after[a], before[c] = c, a
        waiting += [c, a]
    return np.array(triangles, np.int64) if len(triangles) == n - 2 else None


def _is_ear(
    flat: Array, blocks: NDArray[np.int64], corners: tuple[int, int, int], least: float
) -> bool:
    a, b, c = (flat[k] for k in corners)
    if _side(a, b, c) <= least:
        return False
    p = flat[blocks]
    # Corners of bridges to holes are there twice
    p = p[~((p == a).all(axis=1) | (p == b).all(axis=1) | (p == c).all(axis=1))]
    within = (_side(a, b, p) >= -least) & (_side(b, c, p) >= -least) & (_side(c, a, p) >= -least)
    return not np.any(within)


def _side(a: Array, b: Array, p: Array) -> Array:
    """Twice the area of the triangle a, b, p: positive where p is on the left."""
    e, f = b - a, p - a
    return np.asarray(e[..., 0] * f[..., 1] - e[..., 1] * f[..., 0])


def _flattened(points: Array) -> Array:
    """The corners (n, 2) in the plane of the polygon, counter-clockwise (Newell's normal)."""
    centred = points - points.mean(axis=0)
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    if np.abs(normal).max() <= _ROUNDING * np.ptp(centred, axis=0).max() ** 2:
        # Parts of a bow tie cancel: across its two longest directions instead
        normal = np.linalg.svd(centred, full_matrices=False)[2][-1]
    k = int(np.argmax(np.abs(normal)))
    sign = -1.0 if normal[k] < 0.0 else 1.0
    return np.asarray(centred[:, [(k + 1) % 3, (k + 2) % 3]] * [sign, 1.0])
