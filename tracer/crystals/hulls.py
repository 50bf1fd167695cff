"""Faces of bodies by name, and meshes to draw them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import DisplayMesh
from tracer.crystals.bodies import CrystalBody

__all__ = ["face_names", "face_rings", "hull_mesh"]

_ALONG = {
    (0, 1): "right",
    (0, -1): "left",
    (1, 1): "back",
    (1, -1): "front",
    (2, 1): "top",
    (2, -1): "bottom",
}


def face_names(body: CrystalBody) -> tuple[str, ...]:
    """Names of the faces of a convex body: by axis where they lie so, else numbered."""
    names = []
    for number, plane in enumerate(body.planes):
        axis = int(np.argmax(np.abs(plane[:3])))
        key = (axis, 1 if plane[axis] > 0.0 else -1)
        straight = abs(plane[axis]) > 1.0 - 1e-9 and _ALONG[key] not in names
        names.append(_ALONG[key] if straight else f"side_{number + 1}")
    return tuple(names)


def hull_mesh(body: CrystalBody) -> DisplayMesh:
    """Triangles of a body, each with its face."""
    if not body.convex:
        return DisplayMesh(
            vertices=body.vertices.astype(np.float32),
            triangles=body.triangles.astype(np.int32),
            face=np.zeros(len(body.triangles), np.int32),
        )
    triangles: list[tuple[int, int, int]] = []
    faces: list[int] = []
    for number, ring in enumerate(face_rings(body)):
        # Fan the corners out
        for k in range(1, len(ring) - 1):
            triangles.append((int(ring[0]), int(ring[k]), int(ring[k + 1])))
            faces.append(number)
    return DisplayMesh(
        vertices=body.vertices.astype(np.float32),
        triangles=np.array(triangles, np.int32),
        face=np.array(faces, np.int32),
    )


def face_rings(body: CrystalBody) -> list[NDArray[np.int64]]:
    """Corners of each face of a convex body, in order around its outward normal."""
    scale = float(np.ptp(body.vertices, axis=0).max())
    rings = []
    for plane in body.planes:
        corners = np.flatnonzero(np.abs(body.vertices @ plane[:3] - plane[3]) < 1e-6 * scale)
        points = body.vertices[corners] - body.vertices[corners].mean(axis=0)
        u = points[0] / np.linalg.norm(points[0])
        angle: NDArray[np.float64] = np.arctan2(points @ np.cross(plane[:3], u), points @ u)
        rings.append(corners[np.argsort(angle)])
    return rings
