"""A body of kind ``pyramid``: a square base, four sides, a tip."""

from __future__ import annotations

from typing import Literal

import numpy as np

from tracer.bodies.body import Body, FacePlan
from tracer.description.fields import Positive
from tracer.geometry.shapes import Polygon

__all__ = ["Pyramid"]


class Pyramid(Body):
    """A pyramid on a square ``base`` about the position, its tip ``height`` along the axis."""

    kind: Literal["pyramid"]
    base: Positive
    height: Positive

    def plan(self) -> list[FacePlan]:
        origin, frame = self.frame()
        half = self.base / 2.0
        flat = np.array([[half, half, 0], [-half, half, 0], [-half, -half, 0], [half, -half, 0]])
        corners = origin + flat @ frame.T
        tip = origin + self.height * frame[:, 2]
        plans = [FacePlan(name="base", shapes=(Polygon(corners[::-1]),))]
        for k in range(4):
            side = Polygon(np.array([corners[k], corners[(k + 1) % 4], tip]))
            plans.append(FacePlan(name=f"side_{k + 1}", shapes=(side,)))
        return plans
