"""``optical_path < 15.25``: recorded optical path from the emission."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from query.engine.context import RayContext
from query.engine.recorded import Floats, Ints, Recorded

__all__ = ["KINDS", "OpticalPath", "optical_path"]


@dataclass(frozen=True, eq=False)
class OpticalPath(Recorded):
    """Recorded optical path from the emission to the point [scene units]."""

    word = "optical_path"
    title = "recorded optical path"
    column = "optical_path"
    dimension = "length"
    place = 270

    @classmethod
    def values(cls, context: RayContext, points: Ints | None) -> Floats:
        column = context.optional("optical_path", 1)
        # The way out of the scene is no part of a path's length
        ends = np.maximum(context.ends - context.left, context.starts)
        rows = ends if points is None else context.records[points]
        return np.full(len(rows), np.nan) if column is None else column[rows].astype(np.float64)


optical_path = OpticalPath()

KINDS = (OpticalPath,)
