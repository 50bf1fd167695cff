"""Prisms: convex polygons that are drawn out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from tracer.bodies.body import Body, FacePlan
from tracer.description.fields import Length, Positive
from tracer.geometry.shapes import Polygon

if TYPE_CHECKING:
    pass

__all__ = ["PrismBody"]


class PrismBody(Body):
    """A convex polygon in the local xy plane, drawn out by ``length`` along local z (centred).

    Faces: side_1, side_2 … from one vertex to the next, and the ends z_min and z_max.
    """

    kind: Literal["prism"]
    outline: Annotated[tuple[tuple[Length, Length], ...], Field(min_length=3)]
    length: Positive

    def problems(self) -> list[str]:
        points = np.array(self.outline)
        edges = np.roll(points, -1, axis=0) - points
        turn = edges[:, 0] * np.roll(edges, -1, axis=0)[:, 1]
        turn -= edges[:, 1] * np.roll(edges, -1, axis=0)[:, 0]
        if not (np.all(turn > 0.0) or np.all(turn < 0.0)):
            return ["outline: the polygon must be convex, without straight corners"]
        return []

    def plan(self) -> list[FacePlan]:
        origin, frame = self.frame()
        points = np.array(self.outline)
        nxt = np.roll(points, -1, axis=0)
        if np.sum(points[:, 0] * nxt[:, 1] - points[:, 1] * nxt[:, 0]) < 0.0:
            points = points[::-1]
        half = self.length / 2.0
        flat = np.column_stack([points, np.zeros(len(points))])
        low = origin + flat @ frame.T - half * frame[:, 2]
        high = origin + flat @ frame.T + half * frame[:, 2]
        plans = []
        for k in range(len(points)):
            j = (k + 1) % len(points)
            side = Polygon(np.array([low[k], low[j], high[j], high[k]]))
            plans.append(FacePlan(name=f"side_{k + 1}", shapes=(side,)))
        plans.append(FacePlan(name="z_min", shapes=(Polygon(low[::-1]),)))
        plans.append(FacePlan(name="z_max", shapes=(Polygon(high),)))
        return plans


KINDS = (PrismBody,)
