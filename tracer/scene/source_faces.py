"""Sources that lie on flat faces, as a chip on its board or a lamp in its ceiling.

Rounding would let half of their light start behind such a face, so they are lifted off it by what
still counts as touching.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tracer.compiled import (
    FROM_BOX,
    FROM_KIND,
    FROM_LIST,
    FROM_POINT,
    L_AREA,
    L_DIRECTIONS,
    UNIFORM_CONE,
)
from tracer.geometry.kinds import MESH, SPHERE
from tracer.geometry.shape_columns import ShapeColumns
from tracer.scene.sources import CompiledSources

__all__ = ["lift_off_faces"]

Array = NDArray[np.float64]

_PARALLEL = 1e-9


def lift_off_faces(sources: CompiledSources, shapes: ShapeColumns, reach: float) -> CompiledSources:
    """Sources that start ``reach`` before the flat faces within ``reach`` of which they lie.

    Parameters
    ----------
    sources : those that shine from an opening, or from a point to one side, are lifted along their
        axis; lists of rays and points that shine to all sides stay where they are
    shapes : all faces
    reach : distance within which faces are one [scene unit]
    """
    planes = shapes.row[(shapes.kind < SPHERE) & (shapes.kind != MESH), :6]
    numbers, boxes = sources.numbers.copy(), list(sources.boxes)
    for k, integers in enumerate(sources.integers):
        if integers[L_AREA] == FROM_LIST or _shines_all_round(integers, numbers[k]):
            continue
        axis = numbers[k, 3:6]
        sense = planes[:, 3:6] @ axis
        before = ((numbers[k, 0:3] - planes[:, 0:3]) * planes[:, 3:6]).sum(axis=1) * np.sign(sense)
        on = (np.abs(sense) > 1.0 - _PARALLEL) & (np.abs(before) <= reach)
        if on.any():
            # A luminous body hangs from the face as a whole
            body = FROM_BOX <= integers[L_AREA] < FROM_KIND
            half = numbers[k, 22] if body else 0.0
            numbers[k, 0:3] += (reach + half - before[on].min()) * axis
            low, high, beam = boxes[k]
            margin = 2.0 * reach + half
            boxes[k] = low - margin, high + margin, beam
    return replace(sources, numbers=numbers, boxes=boxes)


def _shines_all_round(integers: NDArray[np.int64], row: Array) -> bool:
    point = integers[L_AREA] == FROM_POINT and integers[L_DIRECTIONS] == UNIFORM_CONE
    return bool(point and row[14] < -math.ulp(1.0))
