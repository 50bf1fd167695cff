"""A detector of kind ``drum``: what leaves a cylinder through its side, by azimuth and height."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import lean_kernel
from tracer.description.fields import Placed, Positive, Vector
from tracer.detectors.detector import ViewDetector

__all__ = ["Drum"]

Array = NDArray[np.float64]


@lean_kernel
def register(
    own: Array, x: float, y: float, z: float, dx: float, dy: float, dz: float, length: float,
    leaves: bool,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Where a segment crosses the side from inside."""
    radius, height = own[0], own[1]
    a = dx * dx + dy * dy
    b = x * dx + y * dy
    c = x * x + y * y - radius * radius
    inside = b * b - a * c
    if a <= 0.0 or inside <= 0.0:
        return -1.0, 0.0, 0.0, 0.0
    t = (-b + math.sqrt(inside)) / a
    px, py, pz = x + t * dx, y + t * dy, z + t * dz
    u = math.atan2(py, px) / (2.0 * math.pi)
    u = u + 1.0 if u < 0.0 else u
    return t, u, pz / height, (px * dx + py * dy) / radius


class Drum(ViewDetector):
    """The side of a cylinder of ``radius`` from ``position`` along ``axis`` over ``height``.

    Light registers where it goes outwards; cells by azimuth and height.
    """

    kind: Literal["drum"] = "drum"
    position: Vector = (0.0, 0.0, 0.0)
    axis: Vector = (0.0, 0.0, 1.0)
    radius: Positive
    height: Positive

    register = register
    stored = "surface"

    def center(self) -> Vector:
        return self.position

    def axes(self) -> tuple[Array, Array, Array]:
        _, frame = Placed(axis=self.axis).frame()
        return frame[:, 0], frame[:, 1], frame[:, 2]

    def own(self) -> Sequence[float]:
        return [self.radius, self.height]

    def extent(self) -> tuple[float, float]:
        return 360.0, self.height

    def parameters(self) -> dict[str, Any]:
        assert self.cells is not None
        area = 2.0 * math.pi * self.radius * self.height / (self.cells[0] * self.cells[1])
        return {"mapping": "drum", "size_unit": "deg", "cell_area": area}

    def box(self) -> tuple[Array, Array]:
        _, _, axis = self.axes()
        ends = np.array([self.position, np.array(self.position) + self.height * axis])
        reach = self.radius * np.sqrt(np.maximum(0.0, 1.0 - axis * axis))
        return ends.min(axis=0) - reach, ends.max(axis=0) + reach
