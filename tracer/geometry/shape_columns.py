"""Shapes of many faces as columns, worked out once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracer.geometry.kinds import ROW
from tracer.geometry.shapes import Rectangle, Shape, padded

__all__ = ["ShapeColumns"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ShapeColumns:
    """Faces of a scene by number.

    Attributes
    ----------
    shapes : of n faces
    kind : (n,) of `tracer.geometry.kinds`
    row : (n, ROW) parameters, of polygons without their place in the pool
    low, high : (n, 3) corners of boxes that surely hold the faces
    axis : (n,) coordinate axis nearest to the axis or normal of a face
    """

    shapes: Sequence[Shape]
    kind: Integers
    row: Array
    low: Array
    high: Array
    axis: Integers

    @classmethod
    def of_shapes(cls, shapes: Sequence[Shape]) -> ShapeColumns:
        """Work out the columns."""
        n = len(shapes)
        row = np.array([shape.row() for shape in shapes]).reshape(n, ROW)
        low, high = _bounds(shapes)
        return cls(
            shapes=shapes,
            kind=np.array([shape.kind for shape in shapes], np.int64),
            row=row,
            low=low,
            high=high,
            axis=np.argmax(np.abs(row[:, 3:6]), axis=1).astype(np.int64),
        )

    def __len__(self) -> int:
        return len(self.shapes)

    def of(self, numbers: Iterable[int]) -> list[Shape]:
        """Shapes of some faces."""
        return [self.shapes[k] for k in numbers]


def _bounds(shapes: Sequence[Shape]) -> tuple[Array, Array]:
    """Bounds of each shape; those of rectangles, of which scenes have very many, at once."""
    n = len(shapes)
    low, high = np.empty((n, 3)), np.empty((n, 3))
    rectangles = {k: shape for k, shape in enumerate(shapes) if isinstance(shape, Rectangle)}
    flat = list(rectangles)
    if flat:
        corners = np.array([shape.corners() for shape in rectangles.values()])
        low[flat], high[flat] = padded(corners.min(axis=1), corners.max(axis=1))
    for k in sorted(set(range(n)).difference(flat)):
        low[k], high[k] = shapes[k].bounds()
    return low, high
