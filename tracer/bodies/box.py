"""Boxes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from tracer.bodies.body import Body, FacePlan
from tracer.description.fields import Positive
from tracer.geometry.shapes import Rectangle

if TYPE_CHECKING:
    pass

__all__ = ["BoxBody"]


class BoxBody(Body):
    """A box about the position, ``size`` along its local axes."""

    kind: Literal["box"]
    size: tuple[Positive, Positive, Positive]

    def plan(self) -> list[FacePlan]:
        origin, frame = self.frame()
        plans = []
        for k, letter in enumerate("xyz"):
            u, v = frame[:, (k + 1) % 3], frame[:, (k + 2) % 3]
            size = (self.size[(k + 1) % 3], self.size[(k + 2) % 3])
            offset = frame[:, k] * self.size[k] / 2.0
            plans.append(
                FacePlan(name=f"{letter}_max", shapes=(Rectangle(origin + offset, u, v, size),))
            )
            plans.append(
                FacePlan(
                    name=f"{letter}_min",
                    shapes=(Rectangle(origin - offset, v, u, (size[1], size[0])),),
                )
            )
        return plans


KINDS = (BoxBody,)
