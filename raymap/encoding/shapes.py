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

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.itineraries import PathRuns
from raymap.jit.kernels import inline_kernel, lean_kernel
from raymap.model.directory import Directory
from raymap.model.errors import FormatError
from raymap.model.events import Event
from raymap.model.sceneobjects import NO_QUADRIC

__all__ = [
    "EMISSION",
    "LEFT",
    "LEFT_SCENE",
    "MANY",
    "NO_SHAPE",
    "RayPoints",
    "ShapeTable",
    "ShapedRecords",
    "code_off_faces",
    "compile_shapes",
    "point_shapes",
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
    solve : (n, 10) coefficients in the order in which `raymap.encoding.positions` takes them
    gradient : (n, 10) coefficients as the directory has them
    axis : (n,) coordinate that is rebuilt, -1 none
    face_code : (n_faces,) shape code of points on each face
    first_primitive, primitive_count : (n_faces,)
    face_start : (n_faces,) primitives of all faces before, those of other objects included
    quadric_start : (n_faces,) row of ``primitive_quadric`` of the first primitive of a face of
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
    primitive_count: NDArray[np.int32]
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


@dataclass(frozen=True, slots=True, eq=False)
class ShapedRecords:
    """Records whose shapes and primitives the scene has; `check` alone makes them.

    Attributes
    ----------
    runs : the rays, and their records
    codes : (n_records,) shape code of each record; where its primitive has a quadric of its own,
        that one's row
    triangles : (n_records,) primitives, or (0,) where no code needs them
    shapes : of the directory
    """

    runs: PathRuns
    codes: NDArray[np.int32]
    triangles: NDArray[np.int32]
    shapes: ShapeTable

    @staticmethod
    def check(
        runs: PathRuns,
        point_codes: NDArray[np.int32],
        triangles: NDArray[np.int32],
        shapes: ShapeTable,
        out: NDArray[np.int32] | None = None,
    ) -> ShapedRecords:
        """Records whose positions and normals compiled loops may rebuild.

        Parameters
        ----------
        point_codes : (n_points of the paths,), see `point_shapes`
        out : (n_records,) room for the codes

        Raises
        ------
        FormatError
            There is no such shape or primitive.
        """
        n = int(runs.offsets[-1])
        if len(point_codes) != runs.path_offsets[-1] or len(triangles) not in (0, n):
            raise FormatError("shapes and primitives of other records")
        if len(point_codes):
            low, high = int(point_codes.min()), int(point_codes.max())
            if high >= len(shapes.axis) or MANY - low >= len(shapes.face_code):
                raise FormatError("a point has a shape that the scene does not have")
        codes = np.empty(n, np.int32) if out is None else out
        if not _resolve_codes(
            runs.numbers, runs.path_offsets, runs.offsets, point_codes, triangles, shapes, codes
        ):
            raise FormatError("a primitive is not in its face")
        return ShapedRecords(runs, codes, triangles, shapes)

    def __len__(self) -> int:
        return len(self.codes)


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
        primitive_count=columns.primitive_count,
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


def point_shapes(
    offsets: NDArray[np.int64],
    objects: NDArray[np.int16],
    faces: NDArray[np.int32],
    events: NDArray[np.int32],
    shapes: ShapeTable,
) -> NDArray[np.int32]:
    """Shape code of each point of paths.

    Parameters
    ----------
    offsets : (n_paths + 1,)
    objects, faces, events : (n_points,)

    Returns
    -------
    codes : (n_points,)

    Raises
    ------
    FormatError
        A face is not the scene's, or columns are not as long as the paths.
    """
    n = int(offsets[-1])
    codes = np.empty(n, np.int32)
    if not len(objects) == len(faces) == len(events) == n:
        raise FormatError("columns of paths are not as long as the paths")
    if not _shape_codes(offsets, objects, faces, events, shapes.face_code, codes):
        raise FormatError("a path names a face that the directory does not have")
    return codes


@lean_kernel
def _shape_codes(
    offsets: NDArray[np.int64],
    objects: NDArray[np.int16],
    faces: NDArray[np.int32],
    events: NDArray[np.int32],
    face_code: NDArray[np.int32],
    codes: NDArray[np.int32],
) -> bool:
    """Shape code of each point of paths; false where a face is not in the table."""
    for path in range(offsets.size - 1):
        first = offsets[path]
        for i in range(first, offsets[path + 1]):
            if faces[i] >= face_code.size:
                return False
            if faces[i] >= 0:
                codes[i] = face_code[faces[i]]
            else:
                codes[i] = code_off_faces(i == first, objects[i], events[i])
    return True


@lean_kernel
def _resolve_codes(
    numbers: NDArray[np.uint32],
    path_offsets: NDArray[np.int64],
    record_offsets: NDArray[np.int64],
    point_codes: NDArray[np.int32],
    triangles: NDArray[np.int32],
    shapes: ShapeTable,
    codes: NDArray[np.int32],
) -> bool:
    """Shape code of each record; false where a primitive is not in its face."""
    many = triangles.size > 0
    own = shapes.primitive_quadric.size > 0
    for ray in range(numbers.size):
        row = path_offsets[numbers[ray]] - record_offsets[ray]
        for i in range(record_offsets[ray], record_offsets[ray + 1]):
            code = point_codes[row + i]
            if code <= MANY and many:
                face = MANY - code
                primitive = triangles[i] - shapes.first_primitive[face]
                if not 0 <= primitive < shapes.primitive_count[face]:
                    return False
                start = shapes.quadric_start[face]
                if own and start >= 0:
                    q = shapes.primitive_quadric[start + primitive]
                    if q >= 0:
                        code = q
            codes[i] = code
    return True
