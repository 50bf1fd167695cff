"""Flat rectangles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from tracer.bodies.body import Body, FacePlan
from tracer.description.fields import Positive
from tracer.geometry.shapes import Rectangle

if TYPE_CHECKING:
    pass

__all__ = ["RectangleBody"]


class RectangleBody(Body):
    """A flat rectangle across the local z axis, ``size`` along local x and y."""

    kind: Literal["rectangle"]
    size: tuple[Positive, Positive]

    def plan(self) -> list[FacePlan]:
        origin, frame = self.frame()
        return [
            FacePlan(name="face", shapes=(Rectangle(origin, frame[:, 0], frame[:, 1], self.size),))
        ]


KINDS = (RectangleBody,)
