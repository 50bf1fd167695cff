"""Flat ends of bodies of revolution."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracer.bodies.body import FacePlan
from tracer.geometry.shapes import Annulus

__all__ = ["end_discs"]

Array = NDArray[np.float64]


def end_discs(
    origin: Array, axis: Array, radius: float, end_radius: float, length: float
) -> list[FacePlan]:
    """Flat ends of a body of revolution, start and end; a radius of 0 has none."""
    plans = []
    if radius > 0.0:
        plans.append(FacePlan(name="start", shapes=(Annulus(origin, -axis, 0.0, radius),)))
    if end_radius > 0.0:
        end = Annulus(origin + length * axis, axis, 0.0, end_radius)
        plans.append(FacePlan(name="end", shapes=(end,)))
    return plans
