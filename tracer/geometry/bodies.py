"""Bodies of the scene description and the faces they are made of."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from raymap.events import Event
from tracer.geometry.shapes import (
    Annulus,
    Conic,
    Cylinder,
    Frustum,
    Polygon,
    Rectangle,
    Shape,
    SphereCap,
    sag_at,
)
from tracer.scene.fields import Finite, Length, Node, Placed, Positive

if TYPE_CHECKING:
    from tracer.geometry.mesh import TriangleMesh

__all__ = [
    "BODIES",
    "Body",
    "BoxBody",
    "ConeBody",
    "CylinderBody",
    "FacePlan",
    "LensBody",
    "LensFace",
    "MeshBody",
    "PrismBody",
    "RectangleBody",
    "RingBody",
    "SphereBody",
]

Array = NDArray[np.float64]
_RIM = int(Event.RIM_HIT)


@dataclass(frozen=True, kw_only=True, eq=False)
class FacePlan:
    """A face before it is numbered: name, primitives, surface by name, and its neighbours.

    ``partner`` names another body that lies beyond the face (a cemented interface), ``aliases``
    further full names.
    """

    name: str
    shapes: tuple[Shape, ...]
    surface: str | None = None
    partner: str | None = None
    aliases: tuple[str, ...] = ()
    event: int = 0


class Body(Placed):
    """What all bodies share.

    A body with a ``medium`` is a solid; without one its faces are sheets that light meets from both
    sides. ``faces`` gives single faces a surface of their own.
    """

    kind: str
    medium: str | None = None
    surface: str | None = None
    priority: int = 0
    faces: dict[str, str] = {}

    def plan(self) -> list[FacePlan]:
        """The faces, with normals that point out of the body."""
        raise TypeError(f"{type(self).__name__} is not a body")

    def problems(self) -> list[str]:
        """What makes the body impossible, as 'key: what; remedy'."""
        return []


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
                raise ValueError("semi_diameter is missing")
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
    rim's cylinder. ``diameter`` makes the lens wider than its faces. ``hole`` is the diameter of a
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

    def problems(self) -> list[str]:
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
        for k in range(65):
            r = inner + (h - inner) * k / 64.0
            if self.thickness + self.back.sag(r) - self.front.sag(r) < -1e-9:
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
            plans.append(FacePlan(name="rim", shapes=tuple(rim), surface=self.rim, event=_RIM))
        return plans


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
        return [FacePlan(name="face", shapes=(shape,), event=_RIM if self.stop else 0)]


class RectangleBody(Body):
    """A flat rectangle across the local z axis, ``size`` along local x and y."""

    kind: Literal["rectangle"]
    size: tuple[Positive, Positive]

    def plan(self) -> list[FacePlan]:
        origin, frame = self.frame()
        return [
            FacePlan(name="face", shapes=(Rectangle(origin, frame[:, 0], frame[:, 1], self.size),))
        ]


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
            plans += _ends(origin, axis, self.radius, self.radius, self.length)
        return plans


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
            plans += _ends(origin, axis, self.radius, self.end_radius, self.length)
        return plans


def _ends(origin: Array, axis: Array, radius: float, end_radius: float, length: float) -> list[FacePlan]:  # fmt: skip # noqa: E501
    plans = []
    if radius > 0.0:
        plans.append(FacePlan(name="start", shapes=(Annulus(origin, -axis, 0.0, radius),)))
    if end_radius > 0.0:
        end = Annulus(origin + length * axis, axis, 0.0, end_radius)
        plans.append(FacePlan(name="end", shapes=(end,)))
    return plans


class SphereBody(Body):
    """A sphere about the position."""

    kind: Literal["sphere"]
    radius: Positive

    def plan(self) -> list[FacePlan]:
        origin, frame = self.frame()
        axis = frame[:, 2]
        cap = SphereCap(origin - self.radius * axis, axis, self.radius, 2.5 * self.radius)
        return [FacePlan(name="surface", shapes=(cap,))]


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


class MeshBody(Body):
    """Triangles from a file (STL, OBJ, PLY, glTF), ``scale`` scene units per unit of the file.

    ``name_by`` says what makes a face: one, group, color, or edges sharper than ``angle_deg``;
    ``smooth_deg`` interpolates normals across flatter edges.
    """

    kind: Literal["mesh"]
    file: str
    scale: Positive
    name_by: Literal["one", "group", "color", "angle"] = "group"
    angle_deg: Annotated[float, Field(gt=0, lt=180)] = 30.0
    smooth_deg: Annotated[float, Field(gt=0, lt=180)] | None = None
    flip: bool = False

    def reading_key(self) -> tuple[object, ...]:
        """What bodies that are placed from one reading of a file have in common."""
        return (
            self.file, self.scale, self.name_by, self.angle_deg, self.smooth_deg, self.flip,
            self.medium is None,
        )  # fmt: skip

    def read(self, folder: Path, name: str) -> TriangleMesh:
        """The triangles in the body's own frame [scene units].

        Raises
        ------
        SceneError
            where the file cannot be read or its triangles cannot be traced
        """
        from tracer.geometry.mesh_files import load_mesh

        return load_mesh(
            folder / self.file,
            name=name,
            scale=self.scale,
            faces=self.name_by,
            angle_deg=self.angle_deg,
            smooth_deg=self.smooth_deg,
            solid=self.medium is not None,
            flip=self.flip,
        )


BODIES: dict[str, type[Body]] = {
    "lens": LensBody,
    "ring": RingBody,
    "disc": RingBody,
    "rectangle": RectangleBody,
    "cylinder": CylinderBody,
    "cone": ConeBody,
    "sphere": SphereBody,
    "box": BoxBody,
    "prism": PrismBody,
    "mesh": MeshBody,
}
"""Kinds of bodies by the word that the scene file uses."""
