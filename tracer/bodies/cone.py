"""Cones and frusta."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from tracer.bodies.body import Body, FacePlan
from tracer.bodies.ends import end_discs
from tracer.description.fields import Length, Positive
from tracer.geometry.shapes import Frustum

if TYPE_CHECKING:
    pass

__all__ = ["ConeBody"]


class ConeBody(Body):
    """A cone or frustum from the position along its axis."""

    kind: Literal["cone"]
    radius: Annotated[Length, Field(ge=0)]
    end_radius: Annotated[Length, Field(ge=0)] = 0.0
    length: Positive
    open: bool = False

    def problems(self) -> list[str]:
        if self.radius == 0.0 and self.end_radius == 0.0:
            return ["radius: a cone needs a radius at one end at least"]
        return []

    def plan(self) -> list[FacePlan]:
        origin, frame = self.frame()
        axis = frame[:, 2]
        slope = (self.end_radius - self.radius) / self.length
        side = Frustum(origin, axis, self.radius, slope, 0.0, self.length)
        plans = [FacePlan(name="side", shapes=(side,))]
        if not self.open:
            plans += end_discs(origin, axis, self.radius, self.end_radius, self.length)
        return plans


KINDS = (ConeBody,)
