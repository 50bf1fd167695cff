"""A lens of the scene description: two faces, a rim, and what makes it impossible."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from raymap.model.events import Event
from tracer.bodies.body import Body, FacePlan
from tracer.description.fields import Finite, Length, Node, Positive
from tracer.geometry.shapes import Annulus, Conic, Cylinder, Shape, SphereCap, sag_at, sags_at

__all__ = ["LensBody", "LensFace"]

Array = NDArray[np.float64]


class LensFace(Node):
    """One face of a lens; ``radius`` > 0 where the centre lies further along the axis."""

    radius: float = math.inf
    semi_diameter: Positive | None = None
    conic: Length = 0.0
    aspheric: Annotated[tuple[Finite, ...], Field(max_length=6)] = ()  # huge in metres
    cemented: str | None = None
    surface: str | None = None

    def model_post_init(self, context: Any) -> None:
        if self.cemented is None:
            if self.semi_diameter is None:
                raise ValueError("semi_diameter is missing (or give the lens a diameter)")
            if math.isnan(self.radius) or abs(self.radius) < 1e-12:
                raise ValueError("radius must not be 0; a flat face has radius = inf")
            if math.isnan(self.sag(self.semi_diameter)):
                raise ValueError(
                    f"semi_diameter {self.semi_diameter:g} reaches beyond the surface of radius "
                    f"{self.radius:g}; make it smaller"
                )
        elif self.model_fields_set - {"cemented"}:
            raise ValueError("a cemented face takes its shape from the other lens; drop other keys")

    @property
    def curvature(self) -> float:
        return 0.0 if math.isinf(self.radius) else 1.0 / self.radius

    def sag(self, r: float) -> float:
        """Height above the vertex at distance ``r`` from the axis; nan beyond the surface."""
        return sag_at(r, self.curvature, self.conic, self.aspheric)

    def sags(self, r: Array) -> Array:
        """As `sag`, at many distances."""
        return sags_at(r, self.curvature, self.conic, self.aspheric)

    def largest_sag(self) -> float:
        """What no height of the face above or below its vertex exceeds."""
        r = self.semi_diameter or 0.0
        powers = sum(abs(a) * r ** (4 + 2 * k) for k, a in enumerate(self.aspheric))
        return abs(sag_at(r, self.curvature, self.conic)) + powers

    def _conic(self, vertex: Array, axis: Array, side: float, inner: float = 0.0) -> Conic:
        return Conic(
            vertex,
            axis,
            self.curvature,
            self.conic,
            self.semi_diameter or 0.0,
            side,
            self.aspheric,
            inner,
        )

    def shape(self, vertex: Array, axis: Array, outward: float, inner: float = 0.0) -> Shape:
        """The face at a vertex; ``outward`` +1 where the body's outside lies along the axis.

        ``inner`` is the radius of a hole through its middle.
        """
        h = self.semi_diameter or 0.0
        if self.curvature == 0.0 and not any(self.aspheric):
            return Annulus(vertex, outward * axis, inner, h)
        radius = abs(self.radius)
        plain = self.conic == 0.0 and not any(self.aspheric) and inner == 0.0
        if plain and radius < 1e4 * h:
            bend = math.copysign(1.0, self.radius)
            sag = radius - math.sqrt(max(0.0, radius * radius - h * h))
            return SphereCap(vertex, bend * axis, radius, sag, -outward * bend)
        return self._conic(vertex, axis, -outward, inner)


class LensBody(Body):
    """A lens: front at the position, back ``thickness`` further along the axis, and a rim.

    Where the faces differ in diameter, a flat land (part of the rim) joins the smaller one to the
    rim's cylinder. ``diameter`` makes the lens wider than its faces, and is that of faces without a
    ``semi_diameter``. ``hole`` is the diameter of a
    bore along the axis; its wall is part of the rim.
    """

    kind: Literal["lens"]
    medium: str
    thickness: Positive
    front: LensFace
    back: LensFace
    rim: str = "absorber"
    diameter: Positive | None = None
    hole: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _as_wide_as_the_lens(cls, data: Any) -> Any:
        """Faces without a semi_diameter of their own reach to the lens's diameter."""
        if not isinstance(data, dict) or not isinstance(data.get("diameter"), int | float):
            return data
        faces = {
            key: {"semi_diameter": data["diameter"] / 2.0} | data[key]
            for key in ("front", "back")
            if isinstance(data.get(key), dict) and "cemented" not in data[key]
        }
        return data | faces

    @property
    def hole_radius(self) -> float:
        """Radius of the bore; 0 without one."""
        return (self.hole or 0.0) / 2.0

    def outer_radius(self) -> float:
        """Radius of the rim."""
        radii = [face.semi_diameter or 0.0 for face in (self.front, self.back)]
        return max(*radii, (self.diameter or 0.0) / 2.0)

    def edge_heights(self) -> tuple[float, float]:
        """Heights along the axis at which the rim starts and ends."""
        front, back = self.front, self.back
        return (
            front.sag(front.semi_diameter or 0.0),
            self.thickness + back.sag(back.semi_diameter or 0.0),
        )

    def height_of_front(self, r: float) -> float:
        """Height of the front, or of its land, at distance ``r`` from the axis."""
        return self.front.sag(min(r, self.front.semi_diameter or 0.0))

    def height_of_back(self, r: float) -> float:
        """Height of the back, or of its land, at distance ``r`` from the axis."""
        return self.thickness + self.back.sag(min(r, self.back.semi_diameter or 0.0))

    def surely_between(self) -> tuple[float, float]:
        """Heights along the axis between which the lens lies, with the vertices of its faces."""
        faces = ((0.0, self.front), (self.thickness, self.back))
        bulges = [(vertex, face.largest_sag()) for vertex, face in faces]
        return min(h - bulge for h, bulge in bulges), max(h + bulge for h, bulge in bulges)

    def problems(self) -> list[str]:
        given = {
            "front": self.front.surface is not None,
            "back": self.back.surface is not None,
            "rim": "rim" in self.model_fields_set,
        }
        for name in self.faces:
            if given.get(name):
                key = "rim" if name == "rim" else f"{name}.surface"
                return [f"faces.{name}: {key} says what the surface is, too; drop one of them"]
        if self.back.cemented is not None:
            return [
                "back.cemented: lenses are cemented at the front of the one behind; give the back "
                f"its shape, and write front.cemented in {self.back.cemented!r}"
            ]
        h = min(self.front.semi_diameter or 0.0, self.back.semi_diameter or 0.0)
        inner = self.hole_radius
        if inner >= h:
            return [f"hole: its radius {inner:g} must be smaller than that of both faces, {h:g}"]
        if inner and (any(self.front.aspheric) or any(self.back.aspheric)):
            return ["hole: a face with aspheric coefficients cannot have one; drop either"]
        radii: Array = inner + (h - inner) * np.arange(65, dtype=float) / 64.0
        thick = self.thickness + self.back.sags(radii) - self.front.sags(radii)
        for r in radii[thick < -1e-9][:1].tolist():
            return [
                f"thickness: front and back overlap at {r:.4g} from the axis; make the lens "
                "thicker, or the faces flatter or smaller"
            ]
        low, high = self.edge_heights()
        if high < low - 1e-9:
            return [
                f"thickness: the edge would be {high - low:.4g} thick; make the lens thicker or "
                "its faces smaller"
            ]
        return []

    def plan(self) -> list[FacePlan]:
        origin, frame = self.frame()
        axis = frame[:, 2]
        low, high = self.edge_heights()
        outer = self.outer_radius()
        inner = self.hole_radius
        plans = []
        if self.front.cemented is None:
            plans.append(
                FacePlan(
                    name="front",
                    shapes=(self.front.shape(origin, axis, -1.0, inner),),
                    surface=self.front.surface or self.surface,
                )
            )
        back_vertex = origin + self.thickness * axis
        plans.append(
            FacePlan(
                name="back",
                shapes=(self.back.shape(back_vertex, axis, 1.0, inner),),
                surface=self.back.surface or self.surface,
            )
        )
        # The rim: a cylinder, and a land wherever a face is smaller
        rim: list[Shape] = []
        if high > low:
            rim.append(Cylinder(origin, axis, outer, low, high))
        front_radius = self.front.semi_diameter or 0.0
        if front_radius < outer:
            rim.append(Annulus(origin + low * axis, -axis, front_radius, outer))
        back_radius = self.back.semi_diameter or 0.0
        if back_radius < outer:
            rim.append(Annulus(origin + high * axis, axis, back_radius, outer))
        if inner > 0.0:
            start, end = self.front.sag(inner), self.thickness + self.back.sag(inner)
            rim.append(Cylinder(origin, axis, inner, start, end, -1.0))
        if rim:
            plans.append(
                FacePlan(name="rim", shapes=tuple(rim), surface=self.rim, event=int(Event.RIM_HIT))
            )
        return plans


KINDS = (LensBody,)
