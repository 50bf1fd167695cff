"""Spheres."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from tracer.bodies.body import Body, FacePlan
from tracer.description.fields import Positive
from tracer.geometry.shapes import SphereCap

if TYPE_CHECKING:
    pass

__all__ = ["SphereBody"]


class SphereBody(Body):
    """A sphere about the position."""

    kind: Literal["sphere"]
    radius: Positive

    def plan(self) -> list[FacePlan]:
        origin, frame = self.frame()
        axis = frame[:, 2]
        cap = SphereCap(origin - self.radius * axis, axis, self.radius, 2.5 * self.radius)
        return [FacePlan(name="surface", shapes=(cap,))]


KINDS = (SphereBody,)
