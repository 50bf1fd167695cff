"""Faces that lie on one another: solids, and open surfaces on solids or on one another.

Where two faces coincide light meets one interface, not two with nothing between them. The pairs
that can coincide are found once; whether they do at a point is decided there. Faces coincide where
they are parts of one plane, sphere, cylinder, cone, conic or asphere.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from tracer.compiled import CoincidentFaces
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
from tracer.geometry.shape_columns import ShapeColumns
from tracer.scene.arrangement.open_surfaces import open_surfaces_overlap
from tracer.scene.box_pairs import overlapping_boxes

__all__ = ["find_coincident_faces"]

Row = NDArray[np.float64]
Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Numbers = NDArray[np.intp]

_FLAT = (ANNULUS, RECTANGLE, POLYGON)
_KINDS = (*_FLAT, SPHERE, CYLINDER, CONE, CONIC, ASPHERE)
_ROUNDING = 1e-9
_PARALLEL = 1e-12
_TILT = 2e-6
"""More than the sine of an angle whose cosine is 1 within `_PARALLEL`."""


def find_coincident_faces(
    shapes: ShapeColumns, objects: Sequence[int], solids: Sequence[bool], size: float
) -> CoincidentFaces | None:
    """Pairs of faces on one surface, of different objects; None if none.

    Parameters
    ----------
    shapes, objects, solids : per face its shape, its object, and whether it bounds a solid
    size : radius of the scene; faces within 1e-9 of it are on one surface
    """
    reach = _ROUNDING * size
    solid = np.asarray(solids, bool)
    pairs = [(np.empty(0, np.intp), np.empty(0, np.intp))]
    for a, b in _near_pairs(shapes, np.asarray(objects), reach):
        same = _on_one_surface(shapes, a, b, reach)
        a, b = a[same], b[same]
        kept = solid[a] | solid[b]
        thin = np.flatnonzero(~kept)
        kept[thin] = open_surfaces_overlap(shapes.of(a[thin]), shapes.of(b[thin]), reach)
        pairs.append((a[kept], b[kept]))
    one = np.concatenate([pair[0] for pair in pairs])
    other = np.concatenate([pair[1] for pair in pairs])
    if not len(one):
        return None
    face, partner = np.concatenate([one, other]), np.concatenate([other, one])
    order = np.lexsort((partner, face))
    counts = np.bincount(face, minlength=len(shapes))
    return CoincidentFaces(
        first=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        face=partner[order].astype(np.int64),
    )


def _near_pairs(
    shapes: ShapeColumns, owner: NDArray[np.int64], reach: float
) -> Iterator[tuple[Numbers, Numbers]]:
    """Faces of two objects whose boxes meet, and that may be parts of one surface."""
    known = np.flatnonzero(np.isin(shapes.kind, _KINDS))
    mark, width = _marks(shapes, known, reach)
    low = np.column_stack([shapes.low[known] - reach, mark - width])
    high = np.column_stack([shapes.high[known] + reach, mark + width])
    for one, other in overlapping_boxes(low, high):
        a, b = known[one], known[other]
        meets = owner[a] != owner[b]
        meets &= (shapes.low[b] <= shapes.high[a] + reach).all(axis=1)
        meets &= (shapes.high[b] >= shapes.low[a] - reach).all(axis=1)
        yield a[meets], b[meets]


def _marks(shapes: ShapeColumns, known: Numbers, reach: float) -> tuple[Array, Array]:
    """Four numbers per face that faces of one surface share, and how far they may differ.

    Planes: the normal and its distance from the origin. Balls: the centre and the radius. Other
    surfaces of revolution: the axis, whatever their profile.
    """
    rows, kind = shapes.row[known], shapes.kind[known]
    flat = np.isin(kind, _FLAT)
    axis = rows[:, 3:6]
    # Faces of one plane may look to either side
    along = axis @ np.array([0.5773, 0.2113, 0.7886])
    sense = np.where(along < 0.0, -1.0, 1.0)
    mark = np.column_stack([sense[:, None] * axis, np.zeros(len(known))])
    mark[flat, 3] = sense[flat] * (rows[flat, 0:3] * axis[flat]).sum(axis=1)
    far = 1.0 + np.linalg.norm(rows[:, 0:3], axis=1)
    width = np.column_stack([np.full((len(known), 3), _TILT), reach + _TILT * far])
    balls, ball = _balls(kind, rows)
    mark[ball] = balls[ball]
    width[ball] = reach + 1e-12 * np.abs(balls[ball]).max(axis=1, initial=0.0)[:, None]
    # Rounding decides the sense of an axis across that direction: such faces may be like any other
    unsure = ~ball & (np.abs(along) < _TILT)
    mark[unsure], width[unsure] = 0.0, 2.0 * (1.0 + reach + far.max(initial=0.0))
    return mark, width


def _on_one_surface(shapes: ShapeColumns, one: Numbers, other: Numbers, reach: float) -> Flags:
    """Which pairs of faces whose boxes meet are parts of one surface and may overlap there."""
    kind_a, kind_b = shapes.kind[one], shapes.kind[other]
    a, b = shapes.row[one], shapes.row[other]
    apart = b[:, 0:3] - a[:, 0:3]
    shift = (apart * a[:, 3:6]).sum(axis=1)
    parallel = np.abs(np.abs((a[:, 3:6] * b[:, 3:6]).sum(axis=1)) - 1.0) <= _PARALLEL
    # Planes, but for rings about one centre that do not overlap
    same = np.isin(kind_a, _FLAT) & np.isin(kind_b, _FLAT)
    same &= parallel & (np.abs(shift) <= reach)
    rings = (kind_a == ANNULUS) & (kind_b == ANNULUS)
    same &= ~(rings & _apart(a, b, reach))
    # Balls
    (balls_a, ball_a), (balls_b, ball_b) = _balls(kind_a, a), _balls(kind_b, b)
    both = ball_a & ball_b
    same[both] = np.abs(balls_a - balls_b)[both].max(axis=1) <= reach
    # Surfaces of revolution about one axis
    across = np.linalg.norm(apart - shift[:, None] * a[:, 3:6], axis=1)
    turned = (kind_a == kind_b) & ~np.isin(kind_a, _FLAT) & ~both & parallel & (across <= reach)
    for k in np.flatnonzero(turned):
        same[k] = _same_profile(int(kind_a[k]), a[k], b[k], float(shift[k]), reach)
    return same


def _same_profile(kind: int, a: Row, b: Row, shift: float, reach: float) -> bool:
    """Whether surfaces of revolution of one kind about one axis are one surface.

    ``shift`` is the height of the origin of the second above that of the first.
    """
    sense = 1.0 if a[3:6] @ b[3:6] > 0.0 else -1.0
    if kind == CYLINDER:
        ends = sorted((shift + sense * b[7], shift + sense * b[8]))
        return bool(abs(a[6] - b[6]) <= reach and _overlap((a[7], a[8]), ends, reach))
    if kind == CONE:
        ends = sorted((shift + sense * b[8], shift + sense * b[9]))
        widths = [abs(a[6] + a[7] * h - b[6] - b[7] * sense * (h - shift)) for h in ends]
        return bool(max(widths) <= reach and _overlap((a[8], a[9]), ends, reach))
    # Conics and aspheres: the same vertex and the same sag
    if abs(shift) > reach or abs(a[7] - b[7]) > _PARALLEL:
        return False
    widest = float(min(a[8], b[8]))
    if not np.isclose(a[6], sense * b[6], rtol=0.0, atol=reach / widest):
        return False
    if kind == CONIC:
        return True
    powers = widest ** (2.0 + np.arange(6))
    return bool(np.all(np.abs(a[10:16] - sense * b[10:16]) * powers <= reach))


def _balls(kind: NDArray[np.int64], rows: Array) -> tuple[Array, Flags]:
    """Centre and radius of the spheres that faces are part of (n, 4), and which are."""
    curvature, axis = rows[:, 6], rows[:, 3:6]
    conic = (kind == CONIC) & (np.abs(rows[:, 7] - 1.0) <= _PARALLEL) & (curvature != 0.0)
    radius = rows[:, 6].copy()
    radius[conic] = 1.0 / curvature[conic]
    center = rows[:, 0:3] + radius[:, None] * axis
    return np.column_stack([center, np.abs(radius)]), conic | (kind == SPHERE)


def _overlap(one: Sequence[float], other: Sequence[float], reach: float) -> bool:
    """Whether two ranges along an axis share more than an edge."""
    return bool(min(one[1], other[1]) - max(one[0], other[0]) > reach)


def _apart(a: Array, b: Array, reach: float) -> Flags:
    """Which rings about one centre do not overlap: a lens face and the land around the next."""
    near = np.linalg.norm(a[:, 0:3] - b[:, 0:3], axis=1) <= reach
    inner = np.sqrt(np.maximum(np.maximum(a[:, 6], b[:, 6]), 0.0))
    outer = np.sqrt(np.maximum(np.minimum(a[:, 7], b[:, 7]), 0.0))
    return np.asarray(near & (inner >= outer - reach))
