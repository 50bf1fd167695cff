"""Kinds of bodies of the scene description: sheets, solids, meshes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from raymap.model.events import Event
from tracer.geometry.body import Body, FacePlan
from tracer.geometry.lens_body import LensBody
from tracer.geometry.shapes import (
    Annulus,
    Cylinder,
    Frustum,
    Polygon,
    Rectangle,
    SphereCap,
)
from tracer.named_files import named_file
from tracer.scene.fields import Length, Positive

if TYPE_CHECKING:
    from tracer.geometry.mesh import TriangleMesh

__all__ = [
    "BODIES",
    "BoxBody",
    "ConeBody",
    "CylinderBody",
    "MeshBody",
    "PrismBody",
    "RectangleBody",
    "RingBody",
    "SphereBody",
]

Array = NDArray[np.float64]


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
            named_file(folder, self.file),
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
