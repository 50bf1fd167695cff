"""Shapes of faces as arrays: what the encoding of positions and normals leans on.

Each point of a path has a *shape code*:

====================  ==========================================================================
>= 0                  row of `ShapeTable.gradient`: a quadric
NO_SHAPE              nothing is known of the point
EMISSION              first record of a ray, on no face
LEFT                  end of a ray that left: on the bounding sphere
MANY - face           the face has several primitives, the record's own one decides
====================  ==========================================================================
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.kernels import inline_kernel, lean_kernel
from raymap.model.directory import Directory
from raymap.model.events import Event
from raymap.model.sceneobjects import NO_QUADRIC

__all__ = [
    "EMISSION",
    "LEFT",
    "LEFT_SCENE",
    "MANY",
    "NO_SHAPE",
    "RayPoints",
    "RayShapes",
    "ShapeTable",
    "code_off_faces",
    "compile_shapes",
    "shape_codes",
]

NO_SHAPE, EMISSION, LEFT, MANY = -1, -2, -3, -10
MAX_REMEMBERED = 2**22
"""Normals of meshes are remembered by primitive if the scene has at most this many."""

LEFT_SCENE = int(Event.LEFT_SCENE)
_SPHERE_AXIS = 2


class ShapeTable(NamedTuple):
    """Quadrics of a directory; the last row is the bounding sphere.

    Attributes
    ----------
    solve : (n, 10) coefficients in the order in which `raymap.encoding.positions.solve_positions`
    takes them gradient : (n, 10) coefficients as the directory has them axis : (n,) coordinate that
    is rebuilt, -1 none face_code : (n_faces,) shape code of points on each face first_primitive :
    (n_faces,) face_start : (n_faces,) primitives of all faces before, those of other objects
    included quadric_start : (n_faces,) row of ``primitive_quadric`` of the first primitive of a
    face of
        several, -1 where none of them has a quadric
    primitive_quadric : (n_shapes,) or (0,), row of the quadric of each primitive, -1 none
    complete : whether every primitive has a quadric
    n_remembered : primitives whose last normal is remembered, 0 in scenes with too many
    """

    solve: NDArray[np.float64]
    gradient: NDArray[np.float64]
    axis: NDArray[np.int8]
    face_code: NDArray[np.int32]
    first_primitive: NDArray[np.int32]
    face_start: NDArray[np.int64]
    quadric_start: NDArray[np.int64]
    primitive_quadric: NDArray[np.int32]
    complete: bool
    n_remembered: int


class RayPoints(NamedTuple):
    """Rays and the points of their paths.

    Attributes
    ----------
    numbers : (n_rays,) path of each ray
    path_offsets : (n_paths + 1,) points of each path
    record_offsets : (n_rays + 1,) records of each ray
    object, face, event : (n_points,)
    triangles : (n_records,) primitives
    sources : (n_rays,)
    """

    numbers: NDArray[np.uint32]
    path_offsets: NDArray[np.int64]
    record_offsets: NDArray[np.int64]
    object: NDArray[np.int16]
    face: NDArray[np.int32]
    event: NDArray[np.int32]
    triangles: NDArray[np.int32]
    sources: NDArray[np.int16]


class RayShapes(NamedTuple):
    """Rays and the shape codes of their points.

    Attributes
    ----------
    numbers : (n_rays,) path of each ray
    path_offsets : (n_paths + 1,) points of each path
    record_offsets : (n_rays + 1,) records of each ray
    codes : (n_points,) shape code of each point of the paths
    triangles : (n_records,) primitives, or (0,) where no code needs them
    """

    numbers: NDArray[np.uint32]
    path_offsets: NDArray[np.int64]
    record_offsets: NDArray[np.int64]
    codes: NDArray[np.int32]
    triangles: NDArray[np.int32]


def compile_shapes(directory: Directory) -> ShapeTable:
    """The shapes of a directory."""
    columns = directory.object_columns
    n_faces = len(columns.primitive_count)
    face_start = np.zeros(n_faces + 1, np.int64)
    np.cumsum(columns.primitive_count, out=face_start[1:])
    n_primitives = int(face_start[-1])
    shapes = np.diff(columns.first_shape)
    several = columns.primitive_count > 1
    several_shapes = several & (shapes > 0)
    face_code = np.where(several, MANY - np.arange(n_faces), NO_SHAPE).astype(np.int32)
    single = np.flatnonzero(~several & (shapes > 0))
    rows = columns.quadric_row[columns.first_shape[single]]
    face_code[single] = np.where(rows >= 0, rows, NO_SHAPE)
    coefficients = np.vstack((columns.coefficients, _sphere(directory)))
    axis = np.append(columns.axis[columns.axis != NO_QUADRIC], _SPHERE_AXIS).astype(np.int8)
    return ShapeTable(
        solve=_in_order(coefficients, axis),
        gradient=coefficients,
        axis=axis,
        face_code=face_code,
        first_primitive=columns.first_primitive,
        face_start=face_start[:-1],
        quadric_start=np.where(several_shapes, columns.first_shape[:-1], -1),
        primitive_quadric=columns.quadric_row.astype(np.int32)
        if several_shapes.any()
        else np.empty(0, np.int32),
        complete=len(coefficients) == n_primitives + 1,
        n_remembered=n_primitives if n_primitives <= MAX_REMEMBERED else 0,
    )


def _sphere(directory: Directory) -> NDArray[np.float64]:
    """The bounding sphere as a quadric, its coefficients in float64 operations of fixed order."""
    x, y, z = directory.bounding_sphere.center
    radius = directory.bounding_sphere.radius
    constant = ((x * x + y * y) + z * z) - radius * radius
    return np.array((1.0, 1.0, 1.0, 0.0, 0.0, 0.0, -2.0 * x, -2.0 * y, -2.0 * z, constant))


def _in_order(c: NDArray[np.float64], axis: NDArray[np.int8]) -> NDArray[np.float64]:
    """Coefficients (aa, ab, ac, a, bb, cc, bc, b, c, 1), a the solved axis and b < c the others."""
    ordered = np.empty_like(c)
    for a, (b, d) in enumerate(((1, 2), (0, 2), (0, 1))):
        rows = np.maximum(axis, 0) == a
        order = (a, 2 + a + b, 2 + a + d, 6 + a, b, d, 2 + b + d, 6 + b, 6 + d, 9)
        ordered[rows] = c[rows][:, order]
    return ordered


@inline_kernel
def code_off_faces(begins: bool, item: int, event: int) -> int:
    """Shape code of a point on no face, the first one of a ray or a later one."""
    if begins:
        return EMISSION
    return LEFT if item < 0 and event & LEFT_SCENE else NO_SHAPE


@lean_kernel
def shape_codes(
    offsets: NDArray[np.int64],
    objects: NDArray[np.int16],
    faces: NDArray[np.int32],
    events: NDArray[np.int32],
    face_code: NDArray[np.int32],
    codes: NDArray[np.int32],
) -> None:
    """Shape code of each point of paths (or of each record)."""
    for path in range(offsets.size - 1):
        first = offsets[path]
        for i in range(first, offsets[path + 1]):
            if faces[i] >= 0:
                codes[i] = face_code[faces[i]]
            else:
                codes[i] = code_off_faces(i == first, objects[i], events[i])
