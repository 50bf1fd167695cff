"""Flat faces that lie on one another: solids that touch, solids that lie on a sheet.

Where two faces coincide light meets one interface, not two with nothing between them. The pairs
that can coincide are found once; whether they do at a point is decided there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tracer.geometry.kinds import ANNULUS, POLYGON, RECTANGLE
from tracer.geometry.shapes import Shape
from tracer.scene.arrays import Contacts

__all__ = ["find_contacts"]

_FLAT = (ANNULUS, RECTANGLE, POLYGON)
_ROUNDING = 1e-9


def find_contacts(
    shapes: Sequence[Shape], objects: Sequence[int], solids: Sequence[bool], size: float
) -> Contacts | None:
    """Pairs of flat faces in one plane, of different objects and not both sheets; None if none.

    Parameters
    ----------
    shapes, objects, solids : per face its shape, its object, and whether it bounds a solid
    size : radius of the scene; faces within 1e-9 of it are in one plane
    """
    flat = [k for k, shape in enumerate(shapes) if shape.kind in _FLAT]
    partners: list[list[int]] = [[] for _ in shapes]
    if not any(solids):
        return None
    rows = {k: shapes[k].row() for k in flat}
    boxes = {k: shapes[k].bounds() for k in flat}
    reach = _ROUNDING * size
    for place, a in enumerate(flat):
        for b in flat[place + 1 :]:
            if objects[a] == objects[b] or not (solids[a] or solids[b]):
                continue
            if abs(abs(rows[a][3:6] @ rows[b][3:6]) - 1.0) > 1e-12:
                continue
            if abs((rows[b][0:3] - rows[a][0:3]) @ rows[a][3:6]) > reach:
                continue
            if shapes[a].kind == shapes[b].kind == ANNULUS and _apart(rows[a], rows[b], reach):
                continue
            (low_a, high_a), (low_b, high_b) = boxes[a], boxes[b]
            if np.all(low_a <= high_b + reach) and np.all(low_b <= high_a + reach):
                partners[a].append(b)
                partners[b].append(a)
    if not any(partners):
        return None
    counts: NDArray[np.int64] = np.array([len(item) for item in partners], np.int64)
    return Contacts(
        first=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        face=np.array([k for item in partners for k in item], np.int64),
    )


def _apart(a: NDArray[np.float64], b: NDArray[np.float64], reach: float) -> bool:
    """Whether rings about one centre do not overlap: a lens face and the land around the next."""
    if np.linalg.norm(a[0:3] - b[0:3]) > reach:
        return False
    inner = max(a[6], b[6], 0.0) ** 0.5
    return bool(inner >= min(a[7], b[7]) ** 0.5 - reach)
