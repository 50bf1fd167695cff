"""Cylinders and tubes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from tracer.bodies.body import Body, FacePlan
from tracer.bodies.ends import end_discs
from tracer.description.fields import Positive
from tracer.geometry.shapes import Cylinder

if TYPE_CHECKING:
    pass

__all__ = ["CylinderBody"]


class CylinderBody(Body):
    """A cylinder from the position along its axis; ``open`` leaves out both ends (a tube)."""

    kind: Literal["cylinder"]
    radius: Positive
    length: Positive
    open: bool = False

    def plan(self) -> list[FacePlan]:
        origin, frame = self.frame()
        axis = frame[:, 2]
        plans = [
            FacePlan(name="side", shapes=(Cylinder(origin, axis, self.radius, 0.0, self.length),))
        ]
        if not self.open:
            plans += end_discs(origin, axis, self.radius, self.radius, self.length)
        return plans


KINDS = (CylinderBody,)
