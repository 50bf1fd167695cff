"""A source of kind ``diode``: a point whose slopes are normal, unlike in two directions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from raymap.jit.kernels import lean_kernel
from tracer.sources.source import Source, SourceLaw

__all__ = ["Diode"]

F64 = NDArray[np.float64]
Spread = Annotated[float, Field(gt=0, le=45)]


@lean_kernel
def emit(
    own: F64, u1: float, u2: float, u3: float, u4: float, u5: float
) -> tuple[float, float, float, float, float, float]:
    """Slopes by the transform of Box and Muller."""
    radius = math.sqrt(-2.0 * math.log(1.0 - u1))
    a = own[0] * radius * math.cos(2.0 * math.pi * u2)
    b = own[1] * radius * math.sin(2.0 * math.pi * u2)
    scale = 1.0 / math.sqrt(1.0 + a * a + b * b)
    return 0.0, 0.0, 0.0, a * scale, b * scale, scale


@lean_kernel
def towards(own: F64, x: float, y: float, z: float, dx: float, dy: float, dz: float) -> float:
    """The density of slopes, over cos³: d(slopes) = dΩ / cos³."""
    if dz <= 0.0:
        return 0.0
    a, b = dx / dz / own[0], dy / dz / own[1]
    density = math.exp(-0.5 * (a * a + b * b)) / (2.0 * math.pi * own[0] * own[1])
    return float(density / dz**3)


class Diode(Source):
    """Light from one point about the axis, with normal slopes of ``spread_deg`` (x, y) in one
    standard deviation."""

    kind: Literal["diode"] = "diode"
    spread_deg: tuple[Spread, Spread]

    law = SourceLaw(emit=emit, towards=towards)

    def own(self) -> Sequence[float]:
        return [math.tan(math.radians(angle)) for angle in self.spread_deg]
