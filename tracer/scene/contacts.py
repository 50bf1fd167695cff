"""Faces that lie on one another: solids that touch, sheets on solids, sheets on sheets.

Where two faces coincide light meets one interface, not two with nothing between them. The pairs
that can coincide are found once; whether they do at a point is decided there. Faces coincide where
they are parts of one plane, sphere, cylinder, cone, conic or asphere.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tracer.geometry.kinds import (
    ANNULUS,
    ASPHERE,
    CONE,
    CONIC,
    CYLINDER,
    POLYGON,
    RECTANGLE,
    SPHERE,
)
from tracer.geometry.shapes import Shape
from tracer.scene.arrays import Contacts
from tracer.scene.sheets import sheets_overlap

__all__ = ["find_contacts"]

Row = NDArray[np.float64]

_FLAT = (ANNULUS, RECTANGLE, POLYGON)
_KINDS = (*_FLAT, SPHERE, CYLINDER, CONE, CONIC, ASPHERE)
_ROUNDING = 1e-9
_PARALLEL = 1e-12


def find_contacts(
    shapes: Sequence[Shape], objects: Sequence[int], solids: Sequence[bool], size: float
) -> Contacts | None:
    """Pairs of faces on one surface, of different objects; None if none.

    Parameters
    ----------
    shapes, objects, solids : per face its shape, its object, and whether it bounds a solid
    size : radius of the scene; faces within 1e-9 of it are on one surface
    """
    known = [k for k, shape in enumerate(shapes) if shape.kind in _KINDS]
    partners: list[list[int]] = [[] for _ in shapes]
    rows = {k: shapes[k].row() for k in known}
    reach = _ROUNDING * size
    low = np.full((len(shapes), 3), np.inf)
    high = np.full((len(shapes), 3), -np.inf)
    for k in known:
        low[k], high[k] = shapes[k].bounds()
    owner = np.asarray(objects)
    for a in known:
        meets = (low <= high[a] + reach).all(axis=1) & (high >= low[a] - reach).all(axis=1)
        meets &= owner != owner[a]
        for b in np.flatnonzero(meets).tolist():
            if b < a or not _on_one_surface(
                shapes[a].kind, rows[a], shapes[b].kind, rows[b], reach
            ):
                continue
            if solids[a] or solids[b] or sheets_overlap(shapes[a], shapes[b], reach):
                partners[a].append(b)
                partners[b].append(a)
    if not any(partners):
        return None
    counts: NDArray[np.int64] = np.array([len(item) for item in partners], np.int64)
    return Contacts(
        first=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        face=np.array([k for item in partners for k in item], np.int64),
    )


def _on_one_surface(kind_a: int, a: Row, kind_b: int, b: Row, reach: float) -> bool:
    """Whether two faces whose boxes meet are parts of one surface and may overlap there."""
    if kind_a in _FLAT and kind_b in _FLAT:
        if not _parallel(a, b) or abs((b[0:3] - a[0:3]) @ a[3:6]) > reach:
            return False
        return not (kind_a == kind_b == ANNULUS and _apart(a, b, reach))
    one, other = _ball(kind_a, a), _ball(kind_b, b)
    if one is not None and other is not None:
        return bool(np.abs(one - other).max() <= reach)
    if kind_a != kind_b or kind_a in _FLAT:
        return False
    if not _parallel(a, b):
        return False
    apart = b[0:3] - a[0:3]
    shift = float(apart @ a[3:6])
    if np.linalg.norm(apart - shift * a[3:6]) > reach:
        return False
    sense = 1.0 if a[3:6] @ b[3:6] > 0.0 else -1.0
    if kind_a == CYLINDER:
        ends = sorted((shift + sense * b[7], shift + sense * b[8]))
        return bool(abs(a[6] - b[6]) <= reach and _overlap((a[7], a[8]), ends, reach))
    if kind_a == CONE:
        ends = sorted((shift + sense * b[8], shift + sense * b[9]))
        widths = [abs(a[6] + a[7] * h - b[6] - b[7] * sense * (h - shift)) for h in ends]
        return bool(max(widths) <= reach and _overlap((a[8], a[9]), ends, reach))
    # Conics and aspheres: the same vertex and the same sag
    if abs(shift) > reach or abs(a[7] - b[7]) > _PARALLEL:
        return False
    widest = float(min(a[8], b[8]))
    if not np.isclose(a[6], sense * b[6], rtol=0.0, atol=reach / widest):
        return False
    if kind_a == CONIC:
        return True
    powers = widest ** (2.0 + np.arange(6))
    return bool(np.all(np.abs(a[10:16] - sense * b[10:16]) * powers <= reach))


def _ball(kind: int, row: Row) -> Row | None:
    """Centre and radius of the sphere that a face is part of."""
    if kind == SPHERE:
        return np.append(row[0:3] + row[6] * row[3:6], row[6])
    if kind == CONIC and row[7] == 1.0 and row[6] != 0.0:
        return np.append(row[0:3] + row[3:6] / row[6], abs(1.0 / row[6]))
    return None


def _parallel(a: Row, b: Row) -> bool:
    return bool(abs(abs(a[3:6] @ b[3:6]) - 1.0) <= _PARALLEL)


def _overlap(one: Sequence[float], other: Sequence[float], reach: float) -> bool:
    """Whether two ranges along an axis share more than an edge."""
    return bool(min(one[1], other[1]) - max(one[0], other[0]) > reach)


def _apart(a: Row, b: Row, reach: float) -> bool:
    """Whether rings about one centre do not overlap: a lens face and the land around the next."""
    if np.linalg.norm(a[0:3] - b[0:3]) > reach:
        return False
    inner = max(a[6], b[6], 0.0) ** 0.5
    return bool(inner >= min(a[7], b[7]) ** 0.5 - reach)
