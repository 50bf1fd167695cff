"""Triangles of CAD solids: to a chord tolerance, closed, with the normals of the exact surfaces."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from tracer.geometry.mesh import TriangleMesh, check_solid, faces_by_label, weld
from tracer.importers.cad_formats.occt import occt
from tracer.importers.cad_formats.step_error import reflection_error_mrad
from tracer.importers.cad_formats.step_read import explore
from tracer.importers.cad_solid import CadFace, CadSolid
from tracer.importers.prescription import ImportWarning

__all__ = ["mesh_of_solid"]

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

LARGEST_TRIANGLES = 20_000_000
_MOST_MRAD = 1.0
_FINER = 0.02
_LARGE = 0.1
"""Share of the faces that reflect from which on the triangles of one count."""


def mesh_of_solid(
    solid: CadSolid,
    *,
    chord_mm: float,
    angle_deg: float,
    scale: float = 1.0,
    closed: bool = True,
    specular: tuple[str, ...] = (),
    specular_chord_mm: float | None = None,
) -> TriangleMesh:
    """Triangles of a solid that lie within ``chord_mm`` of its surfaces.

    Parameters
    ----------
    chord_mm : largest distance between triangles and surface [mm]
    specular : faces that reflect or refract: a warning says by what angle their triangles turn
        reflected light, where that is more than 1 mrad
    specular_chord_mm : the same distance for these faces, made smaller where it turns light more
    angle_deg : largest turn of the surface across a triangle
    scale : scene units in a millimetre
    closed : the triangles must bound a volume

    Raises
    ------
    SceneError
        where a face cannot be meshed, or the triangles do not close
    """
    chords = {face.name: specular_chord_mm or chord_mm for face in solid.faces
              if face.name in specular and face.kind != "plane"}  # fmt: skip
    _triangulate(solid, chord_mm, angle_deg, chords)
    errors = _errors(solid, specular, chords)
    large = {name: error for name, error in errors.items() if error > _MOST_MRAD}
    if specular_chord_mm and large:
        # Nobody asked for a chord: take the one that makes a small error, which goes with the chord
        for name, error in large.items():
            chords[name] *= max(0.5 * _MOST_MRAD / error, _FINER)
        _triangulate(solid, chord_mm, angle_deg, chords)
        errors = _errors(solid, specular, chords)
    _warn_of_turned_light(solid, errors, chords, scale)
    joints = _Joints(solid)
    points, triangles, normals, labels = [], [], [], []
    first = 0
    for face in solid.faces:
        vertices, rows, corner_normals = _face_triangles(solid, face, joints)
        points.append(vertices)
        triangles.append(rows + first)
        normals.append(corner_normals)
        labels += [face.name] * len(rows)
        first += len(vertices)
    places, rows, kept = weld(np.concatenate(points) * scale, np.concatenate(triangles))
    mesh = faces_by_label(
        TriangleMesh(
            name=solid.name,
            vertices=places,
            triangles=rows.astype(np.int32),
            face=np.zeros(len(rows), np.int32),
            face_names=("surface",),
            closed=closed,
            corner_normals=np.concatenate(normals)[kept],
        ),
        [label for label, keep in zip(labels, kept, strict=True) if keep],
    )
    lost = set(labels) - set(mesh.face_names)
    if lost:
        raise SceneError(
            f"{solid.origin}: {solid.name!r}: its face {sorted(lost)[0]!r} is too small for the "
            f"chord tolerance of {chord_mm:g} mm; give a smaller one"
        )
    if closed:
        try:
            check_solid(mesh)
        except SceneError as error:
            raise SceneError(f"{solid.origin}: {error}") from None
    return mesh


def _triangulate(
    solid: CadSolid, chord_mm: float, angle_deg: float, chords: dict[str, float]
) -> None:
    """Let OpenCASCADE make triangles of a solid, some faces with a chord of their own."""
    # Drop triangles of another call: finer ones than are asked for are kept, and on this rests that
    # faces meshed first keep theirs
    occt("BRepTools").BRepTools.Clean_s(solid.shape)
    mesher = occt("BRepMesh").BRepMesh_IncrementalMesh
    for face in solid.faces:
        if chords.get(face.name, chord_mm) < chord_mm:
            mesher(face.shape, chords[face.name], False, math.radians(angle_deg), False)
    mesher(solid.shape, chord_mm, False, math.radians(angle_deg), False)


def _errors(
    solid: CadSolid, specular: tuple[str, ...], chords: dict[str, float]
) -> dict[str, float]:
    """Turn of reflected light by the curved faces that make up much of what reflects [mrad]."""
    whole = sum(face.area for face in solid.faces if face.name in specular)
    return {
        face.name: reflection_error_mrad(face)
        for face in solid.faces
        if face.name in chords and face.area >= _LARGE * whole
    }


def _warn_of_turned_light(
    solid: CadSolid, errors: dict[str, float], chords: dict[str, float], scale: float
) -> None:
    """Say how far triangles turn reflected light, and what chord would do."""
    worst = max(errors, key=lambda name: errors[name], default="")
    if not worst or errors[worst] <= _MOST_MRAD:
        return
    wanted = scale * chords[worst] * 0.5 * _MOST_MRAD / errors[worst]
    warnings.warn(
        f"{solid.origin}: {solid.name!r}: triangles of its face {worst!r} lie up to "
        f"{scale * chords[worst]:.2g} off and turn the light that it reflects by up to about "
        f"{errors[worst]:.2g} mrad (refracted light by less); chord = {wanted:.1g} would make "
        f"{0.5 * _MOST_MRAD:g} mrad",
        ImportWarning,
        stacklevel=3,
    )


class _Joints:
    """Where faces meet: their meshes share the nodes of an edge, whatever its tolerance."""

    def __init__(self, solid: CadSolid) -> None:
        self.nodes: dict[tuple[int, int], F64] = {}
        self.edges: dict[int, list[tuple[Any, int]]] = {}
        self.count = 0
        self.tool = occt("BRep").BRep_Tool

    def number(self, edge: Any) -> int:
        """Number of an edge, the same from all faces."""
        same = self.edges.setdefault(hash(edge.TShape()), [])
        for other, number in same:
            if edge.IsSame(other):
                return number
        same.append((edge, self.count))
        self.count += 1
        return self.count - 1

    def join(self, face: Any, mesh: Any, location: Any, vertices: F64) -> None:
        """Move the nodes on the edges of a face to where the first face had them."""
        for edge in explore(face, "TopAbs_EDGE"):
            polygon = self.tool.PolygonOnTriangulation_s(edge, mesh, location)
            if polygon is None:
                continue
            number = self.number(edge)
            count = polygon.NbNodes()
            for k in range(1, count + 1):
                row = polygon.Node(k) - 1
                if k in (1, count):
                    continue
                vertices[row] = self.nodes.setdefault((number, k), vertices[row].copy())
            first, last = (
                occt("TopExp").TopExp.FirstVertex_s(edge),
                occt("TopExp").TopExp.LastVertex_s(edge),
            )
            for vertex, k in ((first, 1), (last, count)):
                if not vertex.IsNull():
                    point = self.tool.Pnt_s(vertex)
                    row = polygon.Node(k) - 1
                    vertices[row] = (point.X(), point.Y(), point.Z())


def _face_triangles(solid: CadSolid, face: CadFace, joints: _Joints) -> tuple[F64, I64, F64]:
    """Vertices (n, 3) [mm], outward triangles (m, 3) and normals (m, 3, 3) of one face."""
    location = occt("TopLoc").TopLoc_Location()
    mesh = occt("BRep").BRep_Tool.Triangulation_s(face.shape, location)
    if mesh is None or mesh.NbTriangles() == 0:
        raise SceneError(
            f"{solid.origin}: {solid.name!r}: its face {face.name!r} cannot be meshed; it is "
            "broken: repair the part in the CAD program and export it again"
        )
    if mesh.NbTriangles() > LARGEST_TRIANGLES:
        raise SceneError(
            f"{solid.origin}: {solid.name!r}: its face {face.name!r} would have "
            f"{mesh.NbTriangles():,} triangles; give a larger chord tolerance"
        )
    move = location.Transformation()
    nodes = [mesh.Node(k).Transformed(move) for k in range(1, mesh.NbNodes() + 1)]
    vertices = np.array([(node.X(), node.Y(), node.Z()) for node in nodes])
    rows = np.array([mesh.Triangle(k).Get() for k in range(1, mesh.NbTriangles() + 1)])
    rows = rows.astype(np.int64)[:, -3:] - 1
    if face.shape.Orientation() == occt("TopAbs").TopAbs_Orientation.TopAbs_REVERSED:
        rows = rows[:, [0, 2, 1]]
    flat = _triangle_normals(vertices, rows)
    exact = _node_normals(face, mesh)[rows]
    # Outward as the triangles; where the surface has no normal (a pole), that of the triangle
    turn = np.sign(np.einsum("mkj,mj->m", exact, flat))
    exact *= np.where(turn == 0.0, 1.0, turn)[:, None, None]
    good = np.einsum("mkj,mj->mk", exact, flat) > 0.2
    exact = np.where(good[:, :, None], exact, flat[:, None, :])
    joints.join(face.shape, mesh, location, vertices)
    return vertices, rows, exact


def _triangle_normals(vertices: F64, rows: I64) -> F64:
    a, b, c = (vertices[rows[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(length > 0.0, length, 1.0))


def _node_normals(face: CadFace, mesh: Any) -> F64:
    """(n, 3) unit normals of the exact surface at the nodes; zero where it has none."""
    surface = occt("BRepAdaptor").BRepAdaptor_Surface(face.shape)
    gp = occt("gp")
    normals = np.zeros((mesh.NbNodes(), 3))
    if not mesh.HasUVNodes():
        return normals
    middle_u = 0.5 * (surface.FirstUParameter() + surface.LastUParameter())
    middle_v = 0.5 * (surface.FirstVParameter() + surface.LastVParameter())
    point, along_u, along_v = gp.gp_Pnt(), gp.gp_Vec(), gp.gp_Vec()
    for k in range(mesh.NbNodes()):
        place = mesh.UVNode(k + 1)
        u, v = place.X(), place.Y()
        # At a pole one direction has no length: step aside by a little
        for share in (0.0, 1e-6):
            surface.D1(u + share * (middle_u - u), v + share * (middle_v - v),
                       point, along_u, along_v)  # fmt: skip
            across = along_u.Crossed(along_v)
            size = across.Magnitude()
            if size > 1e-9 * (along_u.SquareMagnitude() + along_v.SquareMagnitude()):
                normals[k] = across.X() / size, across.Y() / size, across.Z() / size
                break
    return normals
