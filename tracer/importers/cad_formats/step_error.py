"""How far triangles of a CAD face turn the light that it reflects.

A ray meets a triangle a distance d before or behind the surface, and takes the normal interpolated
between those at the corners. Two errors of the normal follow: what interpolation misses, and what
the surface turns (its curvature k) over the way d tan i by which a ray of incidence i is displaced.
Reflected light turns by twice their sum; the estimate takes i = 45 degrees.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracer.importers.cad_formats.occt import occt
from tracer.importers.cad_solid import CadFace

__all__ = ["reflection_error_mrad"]

F64 = NDArray[np.float64]

_MOST = 400
_SHARE = 95.0
"""Percentile over the triangles, by area."""


def reflection_error_mrad(face: CadFace) -> float:
    """Angle by which reflected light is off, near its largest over the face [mrad]; 0 for planes.

    Parameters
    ----------
    face : with the triangles that OpenCASCADE made of it
    """
    location = occt("TopLoc").TopLoc_Location()
    mesh = occt("BRep").BRep_Tool.Triangulation_s(face.shape, location)
    if face.kind == "plane" or mesh is None or not mesh.HasUVNodes():
        return 0.0
    surface = occt("BRepAdaptor").BRepAdaptor_Surface(face.shape)
    move = location.Transformation()
    step = max(1, mesh.NbTriangles() // _MOST)
    errors, areas = [], []
    for k in range(1, mesh.NbTriangles() + 1, step):
        rows = mesh.Triangle(k).Get()[-3:]
        points = [mesh.Node(row).Transformed(move) for row in rows]
        corners = np.array([(p.X(), p.Y(), p.Z()) for p in points])
        places = np.array([(mesh.UVNode(row).X(), mesh.UVNode(row).Y()) for row in rows])
        found = _error_of_triangle(surface, corners, places)
        if found is not None:
            errors.append(found)
            areas.append(np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])))
    if not errors:
        return 0.0
    order = np.argsort(errors)
    running = np.cumsum(np.array(areas)[order])
    index = int(np.searchsorted(running, _SHARE / 100.0 * running[-1]))
    return 1e3 * float(np.array(errors)[order][min(index, len(order) - 1)])


def _error_of_triangle(surface: Any, corners: F64, places: F64) -> float | None:
    """Turn of light reflected at the middle of a triangle [rad]; None where it has no normal."""
    normals = [_at(surface, *place)[3] for place in places]
    if any(not np.any(normal) for normal in normals):
        return None
    middle = corners.mean(axis=0)
    interpolated = np.mean(normals, axis=0)
    interpolated /= np.linalg.norm(interpolated)
    # Find the foot of the middle on the surface
    u, v = places.mean(axis=0)
    for _ in range(4):
        point, along_u, along_v, _normal = _at(surface, u, v)
        tangents = np.array([along_u, along_v]).T
        du, dv = np.linalg.lstsq(tangents, middle - point, rcond=None)[0]
        u, v = u + du, v + dv
    point, _, _, normal = _at(surface, u, v)
    if not np.any(normal):
        return None
    # Curvature from the turn of the normals along the edges
    edges = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    turns = np.linalg.norm(np.roll(normals, -1, axis=0) - np.array(normals), axis=1)
    curvature = float((turns / np.maximum(edges, 1e-12)).max())
    missed = float(np.linalg.norm(np.cross(interpolated, normal)))
    return 2.0 * (missed + curvature * float(np.linalg.norm(middle - point)))


def _at(surface: Any, u: float, v: float) -> tuple[F64, F64, F64, F64]:
    """Point, derivatives and unit normal (zero at a pole) of a surface."""
    gp = occt("gp")
    point, along_u, along_v = gp.gp_Pnt(), gp.gp_Vec(), gp.gp_Vec()
    surface.D1(float(u), float(v), point, along_u, along_v)
    first, second = (np.array([w.X(), w.Y(), w.Z()]) for w in (along_u, along_v))
    normal = np.cross(first, second)
    size = float(np.linalg.norm(normal))
    small = size <= 1e-9 * float(first @ first + second @ second)
    place = np.array([point.X(), point.Y(), point.Z()])
    return place, first, second, np.zeros(3) if small else normal / size
