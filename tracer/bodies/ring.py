"""Flat rings and discs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from raymap.model.events import Event
from tracer.bodies.body import Body, FacePlan
from tracer.description.fields import Length, Positive
from tracer.geometry.shapes import Annulus

if TYPE_CHECKING:
    pass

__all__ = ["RingBody"]


class RingBody(Body):
    """A flat ring, or a disc without ``inner``: stops, baffles, seats. Its normal is the axis."""

    kind: Literal["ring", "disc"]
    inner: Annotated[Length, Field(ge=0)] = 0.0
    outer: Positive
    stop: bool = False

    def problems(self) -> list[str]:
        if self.inner >= self.outer:
            return ["inner: must be smaller than outer"]
        return []

    def plan(self) -> list[FacePlan]:
        origin, frame = self.frame()
        shape = Annulus(origin, frame[:, 2], self.inner, self.outer)
        return [
            FacePlan(name="face", shapes=(shape,), event=int(Event.RIM_HIT) if self.stop else 0)
        ]


KINDS = (RingBody,)
