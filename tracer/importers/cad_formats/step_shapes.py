"""Faces of CAD solids in closed form, where the tracer has one: planes, cylinders, cones, spheres.

A solid all of whose faces are of these forms, whole (a cylinder all round, a spherical cap, a disc,
a ring, a polygon with straight edges), is traced exactly; any other solid as triangles.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracer.geometry.shapes import Annulus, Cylinder, Frustum, Polygon, Shape, SphereCap
from tracer.importers.cad_formats.occt import occt
from tracer.importers.cad_formats.step_read import explore
from tracer.importers.cad_solid import CadFace

__all__ = ["Placement", "shapes_of_face"]

Array = NDArray[np.float64]

_TOLERANCE = 1e-7
_MOST_TRIANGLES = 64


class Placement:
    """From the file's millimetres to the scene: origin, rotation, scale."""

    def __init__(self, origin: Array, frame: Array, scale: float) -> None:
        self.origin, self.frame, self.scale = origin, frame, scale

    def point(self, p: Any) -> Array:
        """A point of the file in the scene."""
        local = self.scale * np.array([p.X(), p.Y(), p.Z()])
        return np.asarray(self.origin + self.frame @ local)

    def direction(self, d: Any) -> Array:
        """A direction of the file in the scene, of length 1."""
        return np.asarray(self.frame @ np.array([d.X(), d.Y(), d.Z()]))


def shapes_of_face(face: CadFace, placed: Placement) -> tuple[Shape, ...] | None:
    """The face in closed form, normals outward; None where the tracer has none for it."""
    build = {"plane": _plane, "cylinder": _cylinder, "cone": _cone, "sphere": _sphere}
    maker = build.get(face.kind)
    return None if maker is None else maker(face, placed)


def _edges(face: CadFace) -> list[Any]:
    """The edges that bound a face: no seams, no poles."""
    tool = occt("BRep").BRep_Tool
    return [
        edge
        for edge in explore(face.shape, "TopAbs_EDGE")
        if not tool.Degenerated_s(edge) and not tool.IsClosed_s(edge, face.shape)
    ]


def _circles(face: CadFace, placed: Placement) -> list[tuple[Array, Array, float]] | None:
    """Centre, axis, radius of each whole circle that bounds a face; None if other edges do."""
    found: list[tuple[Array, Array, float, float]] = []
    for edge in _edges(face):
        curve = occt("BRepAdaptor").BRepAdaptor_Curve(edge)
        if curve.GetType().name != "GeomAbs_Circle":
            return None
        circle = curve.Circle()
        part = abs(curve.LastParameter() - curve.FirstParameter())
        centre, axis = placed.point(circle.Location()), placed.direction(circle.Axis().Direction())
        radius = placed.scale * circle.Radius()
        for k, (other, along, size, share) in enumerate(found):
            if np.linalg.norm(centre - other) + abs(radius - size) < _TOLERANCE * (1.0 + radius):
                found[k] = (other, along, size, share + part)
                break
        else:
            found.append((centre, axis, radius, part))
    if any(abs(share - 2.0 * math.pi) > 1e-6 for *_, share in found):
        return None
    return [(centre, axis, radius) for centre, axis, radius, _ in found]


def _inside(face: CadFace, placed: Placement) -> tuple[Array, Array]:
    """A point in the middle of a face's parameters, and the outward normal there."""
    surface = occt("BRepAdaptor").BRepAdaptor_Surface(face.shape)
    u = 0.5 * (surface.FirstUParameter() + surface.LastUParameter())
    v = 0.5 * (surface.FirstVParameter() + surface.LastVParameter())
    gp = occt("gp")
    point, along_u, along_v = gp.gp_Pnt(), gp.gp_Vec(), gp.gp_Vec()
    surface.D1(u, v, point, along_u, along_v)
    normal = placed.direction(along_u.Crossed(along_v))
    normal /= np.linalg.norm(normal)
    if face.shape.Orientation() == occt("TopAbs").TopAbs_Orientation.TopAbs_REVERSED:
        normal = -normal
    return placed.point(point), normal


def _plane(face: CadFace, placed: Placement) -> tuple[Shape, ...] | None:
    _, normal = _inside(face, placed)
    circles = _circles(face, placed)
    if circles:
        sizes = sorted(circles, key=lambda item: item[2])
        centre, _, outer = sizes[-1]
        if len(sizes) == 1:
            return (Annulus(centre, normal, 0.0, outer),)
        same = np.linalg.norm(sizes[0][0] - centre) < _TOLERANCE * (1.0 + outer)
        return (Annulus(centre, normal, sizes[0][2], outer),) if len(sizes) == 2 and same else None
    for edge in _edges(face):
        if occt("BRepAdaptor").BRepAdaptor_Curve(edge).GetType().name != "GeomAbs_Line":
            return None
    outline = _outline(face, placed)
    if outline is not None:
        edges = np.roll(outline, -1, axis=0) - outline
        turn = np.cross(edges, np.roll(edges, -1, axis=0)) @ normal
        if np.all(turn > 0.0) or np.all(turn < 0.0):
            return (Polygon(outline if turn[0] > 0.0 else outline[::-1]),)
    return _triangles(face, placed, normal)


def _outline(face: CadFace, placed: Placement) -> Array | None:
    """Corners of a face with one wire, in order, straight ones left out; None with holes."""
    wires = list(explore(face.shape, "TopAbs_WIRE"))
    if len(wires) != 1:
        return None
    walker = occt("BRepTools").BRepTools_WireExplorer(wires[0], face.shape)
    points = []
    while walker.More():
        points.append(placed.point(occt("BRep").BRep_Tool.Pnt_s(walker.CurrentVertex())))
        walker.Next()
    corners = np.array(points)
    if len(corners) < 3:
        return None
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    bent = np.linalg.norm(np.cross(before, after), axis=1)
    sizes = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    kept = corners[bent > 1e-9 * sizes]
    return kept if len(kept) >= 3 else None


def _triangles(face: CadFace, placed: Placement, normal: Array) -> tuple[Shape, ...] | None:
    """A plane with straight edges as triangles: exact, whatever its outline."""
    location = occt("TopLoc").TopLoc_Location()
    occt("BRepMesh").BRepMesh_IncrementalMesh(face.shape, 1.0, False, 1.0, False)
    mesh = occt("BRep").BRep_Tool.Triangulation_s(face.shape, location)
    if mesh is None or mesh.NbTriangles() > _MOST_TRIANGLES:
        return None
    move = location.Transformation()
    shapes = []
    for k in range(1, mesh.NbTriangles() + 1):
        corners = np.array(
            [placed.point(mesh.Node(n).Transformed(move)) for n in mesh.Triangle(k).Get()[-3:]]
        )
        area = np.cross(corners[1] - corners[0], corners[2] - corners[0]) @ normal
        if area != 0.0:
            shapes.append(Polygon(corners if area > 0.0 else corners[::-1]))
    return tuple(shapes) or None


def _heights(
    circles: list[tuple[Array, Array, float]] | None, origin: Array, axis: Array, count: int
) -> list[float] | None:
    """Heights of ``count`` bounding circles about an axis; None where they are not such."""
    if circles is None or len(circles) != count:
        return None
    heights = []
    for centre, along, radius in circles:
        height = float((centre - origin) @ axis)
        aside = np.linalg.norm(centre - origin - height * axis)
        if abs(abs(float(along @ axis)) - 1.0) > 1e-9 or aside > _TOLERANCE * (1.0 + radius):
            return None
        heights.append(height)
    return sorted(heights)


def _cylinder(face: CadFace, placed: Placement) -> tuple[Shape, ...] | None:
    surface = occt("BRepAdaptor").BRepAdaptor_Surface(face.shape).Cylinder()
    origin, axis = placed.point(surface.Location()), placed.direction(surface.Axis().Direction())
    heights = _heights(_circles(face, placed), origin, axis, 2)
    if heights is None:
        return None
    point, normal = _inside(face, placed)
    across = point - origin - ((point - origin) @ axis) * axis
    side = 1.0 if across @ normal > 0.0 else -1.0
    return (Cylinder(origin, axis, placed.scale * surface.Radius(), heights[0], heights[-1], side),)


def _cone(face: CadFace, placed: Placement) -> tuple[Shape, ...] | None:
    surface = occt("BRepAdaptor").BRepAdaptor_Surface(face.shape).Cone()
    origin, axis = placed.point(surface.Location()), placed.direction(surface.Axis().Direction())
    radius, slope = placed.scale * surface.RefRadius(), math.tan(surface.SemiAngle())
    circles = _circles(face, placed)
    if circles is not None and len(circles) == 1:
        heights = _heights(circles, origin, axis, 1)
        if heights is None:
            return None
        heights = sorted([heights[0], -radius / slope])  # up to the apex
    else:
        heights = _heights(circles, origin, axis, 2)
        if heights is None:
            return None
    point, normal = _inside(face, placed)
    across = point - origin - ((point - origin) @ axis) * axis
    side = 1.0 if across @ normal > 0.0 else -1.0
    return (Frustum(origin, axis, radius, slope, heights[0], heights[-1], side),)


def _sphere(face: CadFace, placed: Placement) -> tuple[Shape, ...] | None:
    surface = occt("BRepAdaptor").BRepAdaptor_Surface(face.shape).Sphere()
    centre, radius = placed.point(surface.Location()), placed.scale * surface.Radius()
    circles = _circles(face, placed)
    point, normal = _inside(face, placed)
    side = 1.0 if (point - centre) @ normal > 0.0 else -1.0
    if circles == []:
        axis = placed.direction(surface.Position().Direction())
        return (SphereCap(centre - radius * axis, axis, radius, 2.5 * radius, side),)
    if circles is None or len(circles) != 1:
        return None
    middle, axis, _ = circles[0]
    # The cap lies on the side of the circle where its surface is
    height = float((middle - centre) @ axis)
    area = face.area * placed.scale**2
    up = abs(2.0 * math.pi * radius * (radius - height) - area)
    down = abs(2.0 * math.pi * radius * (radius + height) - area)
    if min(up, down) > 1e-4 * area:
        return None
    if up < down:
        return (SphereCap(centre + radius * axis, -axis, radius, radius - height, side),)
    return (SphereCap(centre - radius * axis, axis, radius, radius + height, side),)
