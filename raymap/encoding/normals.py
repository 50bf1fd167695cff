"""Normals against the shape of the face and the records before: what they imply is not stored.

All arithmetic is float64 with + - x / and square root in the order written here, so that any
reader gets the same integers. (Compilers must not fuse multiplications and additions.)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.shapes import (
    EMISSION,
    LEFT,
    MANY,
    RayPoints,
    ShapedRecords,
    ShapeTable,
    code_off_faces,
)
from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.model.errors import FormatError
from raymap.model.schema import NORMAL_SCALE

__all__ = [
    "end_residuals",
    "imply_normals",
    "normal_residuals",
    "other_residuals",
    "rebuild_normals",
    "rebuild_some_normals",
]

Integer = int | np.integer
Folded = tuple[NDArray[np.uint16], NDArray[np.uint16], NDArray[np.uint16]]
_SCALE = float(NORMAL_SCALE)


def rebuild_normals(
    records: ShapedRecords,
    sources: NDArray[np.int16],
    n_sources: int,
    position: NDArray[np.float32],
    folded: Folded,
) -> NDArray[np.int16]:
    """Normals from what is stored of them: how far they are off what is implied.

    Parameters
    ----------
    sources : (n_rays,)
    position : (n_records, 3)
    folded : x, y, z, each (n_records,)

    Returns
    -------
    normal : (n_records, 3) int16

    Raises
    ------
    FormatError
        The columns do not fit the records.
    """
    n, shapes = len(records), records.shapes
    if [len(column) for column in folded] != [n, n, n] or position.shape != (n, 3):
        raise FormatError(f"normals and positions of other than {n} records")
    if len(sources) != len(records.runs.numbers):
        raise FormatError(f"{len(sources)} sources of {len(records.runs.numbers)} rays")
    if len(sources) and not 0 <= int(sources.min()) <= int(sources.max()) < n_sources:
        raise FormatError("a ray has a source that the directory does not have")
    if n and not len(records.triangles) and int(records.codes.min()) <= MANY:
        raise FormatError("primitives are missing that tell normals apart")
    normal = np.empty((n, 3), np.int16)
    _decode_normals(
        records.runs.offsets,
        records.codes,
        records.triangles,
        sources,
        shapes.gradient,
        shapes.first_primitive,
        shapes.face_start,
        np.zeros((n_sources, 3), np.int16),
        np.zeros((shapes.n_remembered, 3), np.int16),
        position,
        folded,
        normal,
    )
    return normal


def rebuild_some_normals(
    shapes: ShapeTable,
    records: NDArray[np.integer],
    faces: NDArray[np.integer],
    position: NDArray[np.float32],
    folded: Folded,
) -> NDArray[np.int16]:
    """As `rebuild_normals`, of some records, all of them on faces of one quadric.

    Parameters
    ----------
    records : (n,) places in the portion; faces : (n,) theirs

    Returns
    -------
    normal : (n, 3) int16

    Raises
    ------
    FormatError
        There is no such record or face, or the face is no quadric.
    """
    n = len(position)
    if [len(column) for column in folded] != [n, n, n] or position.shape != (n, 3):
        raise FormatError(f"normals and positions of other than {n} records")
    if len(records) and not 0 <= int(records.min()) <= int(records.max()) < n:
        raise FormatError("a record is not in its portion")
    if len(faces) and not 0 <= int(faces.min()) <= int(faces.max()) < len(shapes.face_code):
        raise FormatError("a path names a face that the directory does not have")
    codes = shapes.face_code[faces]
    if len(faces) != len(records) or (len(codes) and int(codes.min()) < 0):
        raise FormatError("the normal of a record is not implied by its face")
    normal = np.empty((len(records), 3), np.int16)
    _normals_of_records(
        np.asarray(records, np.int64),
        np.asarray(codes, np.int32),
        shapes.gradient,
        position,
        *folded,
        normal,
    )
    return normal


@inner_kernel
def _scaled(x: float, y: float, z: float) -> tuple[int, int, int]:
    """Direction x 32767, rounded half up; zero where there is none."""
    square = (x * x + y * y) + z * z
    if not (0.0 < square < 1e300):
        return 0, 0, 0
    scale = _SCALE / math.sqrt(square)
    return (
        math.floor(x * scale + 0.5),
        math.floor(y * scale + 0.5),
        math.floor(z * scale + 0.5),
    )


@inner_kernel
def _gradient(
    g: NDArray[np.float64], q: int, position: NDArray[np.float32], i: Integer
) -> tuple[int, int, int]:
    """Normal of quadric q at the stored position."""
    x = np.float64(position[i, 0])
    y = np.float64(position[i, 1])
    z = np.float64(position[i, 2])
    return _scaled(
        ((2.0 * g[q, 0]) * x + g[q, 3] * y) + (g[q, 4] * z + g[q, 6]),
        ((2.0 * g[q, 1]) * y + g[q, 3] * x) + (g[q, 5] * z + g[q, 7]),
        ((2.0 * g[q, 2]) * z + g[q, 4] * x) + (g[q, 5] * y + g[q, 8]),
    )


@inner_kernel
def _from_before(
    i: Integer,
    code: Integer,
    primitive: Integer,
    source: Integer,
    position: NDArray[np.float32],
    emission: NDArray[np.int16],
    remembered: NDArray[np.int16],
) -> tuple[int, int, int]:
    """Normal of a record without a quadric, as far as records before say it."""
    if code == LEFT:
        # Take the direction of the last segment
        return _scaled(
            np.float64(position[i, 0]) - np.float64(position[i - 1, 0]),
            np.float64(position[i, 1]) - np.float64(position[i - 1, 1]),
            np.float64(position[i, 2]) - np.float64(position[i - 1, 2]),
        )
    if code == EMISSION:
        return int(emission[source, 0]), int(emission[source, 1]), int(emission[source, 2])
    if primitive >= 0:
        return (
            int(remembered[primitive, 0]),
            int(remembered[primitive, 1]),
            int(remembered[primitive, 2]),
        )
    return 0, 0, 0


@inner_kernel
def _primitive_of(
    code: int,
    triangles: NDArray[np.int32],
    i: int,
    first_primitive: NDArray[np.int32],
    face_start: NDArray[np.int64],
    remembered: NDArray[np.int16],
) -> int:
    """Number of the primitive in the scene, -1 where its normals are not remembered."""
    if code > MANY or remembered.shape[0] == 0:
        return -1
    face = MANY - code
    return int(face_start[face] + triangles[i] - first_primitive[face])


@inner_kernel
def _remember(
    i: Integer,
    code: Integer,
    primitive: Integer,
    source: Integer,
    normal: NDArray[np.int16],
    emission: NDArray[np.int16],
    remembered: NDArray[np.int16],
) -> None:
    for k in range(3):
        if code == EMISSION:
            emission[source, k] = normal[i, k]
        elif primitive >= 0:
            remembered[primitive, k] = normal[i, k]


@inner_kernel
def _fold(value: np.int16, predicted: int) -> np.uint16:
    """Zigzag of the difference modulo 2^16."""
    r = np.int16(value - predicted)
    return np.uint16((r << 1) ^ (r >> 15))


@inner_kernel
def _unfold(folded: np.uint16, predicted: int) -> np.int16:
    """The inverse of `_fold`."""
    r = np.int64(folded)
    return np.int16(predicted + ((r >> 1) ^ -(r & 1)))


@lean_kernel
def normal_residuals(
    record_offsets: NDArray[np.int64],
    codes: NDArray[np.int32],
    triangles: NDArray[np.int32],
    sources: NDArray[np.int16],
    gradient: NDArray[np.float64],
    first_primitive: NDArray[np.int32],
    face_start: NDArray[np.int64],
    emission: NDArray[np.int16],
    remembered: NDArray[np.int16],
    position: NDArray[np.float32],
    normal: NDArray[np.int16],
    folded: NDArray[np.uint16],
) -> tuple[int, int]:
    """Zigzag of (stored - predicted) modulo 2^16.

    Parameters
    ----------
    codes : (n_records,) resolved
    emission : (n_sources, 3) zeros; remembered : (n_remembered, 3) zeros
    folded : (3, n_records) out

    Returns
    -------
    missed, plain : components that the prediction misses, components that are not zero
    """
    missed = 0
    plain = 0
    for ray in range(sources.size):
        for i in range(record_offsets[ray], record_offsets[ray + 1]):
            code = codes[i]
            if code >= 0:
                px, py, pz = _gradient(gradient, code, position, i)
            else:
                primitive = _primitive_of(
                    code, triangles, i, first_primitive, face_start, remembered
                )
                px, py, pz = _from_before(
                    i, code, primitive, sources[ray], position, emission, remembered
                )
                _remember(i, code, primitive, sources[ray], normal, emission, remembered)
            x = _fold(normal[i, 0], px)
            y = _fold(normal[i, 1], py)
            z = _fold(normal[i, 2], pz)
            folded[0, i] = x
            folded[1, i] = y
            folded[2, i] = z
            missed += (x != 0) + (y != 0) + (z != 0)
            plain += (normal[i, 0] != 0) + (normal[i, 1] != 0) + (normal[i, 2] != 0)
    return missed, plain


@lean_kernel
def imply_normals(
    codes: NDArray[np.int32],
    gradient: NDArray[np.float64],
    position: NDArray[np.float32],
    normal: NDArray[np.int16],
) -> None:
    """Set the normals of points on quadrics to those that their stored positions have."""
    for i in range(codes.size):
        if codes[i] >= 0:
            x, y, z = _gradient(gradient, codes[i], position, i)
            normal[i, 0] = x
            normal[i, 1] = y
            normal[i, 2] = z


@lean_kernel
def end_residuals(
    record_offsets: NDArray[np.int64],
    numbers: NDArray[np.uint32],
    emitted: NDArray[np.bool_],
    left: NDArray[np.bool_],
    sources: NDArray[np.int16],
    emission: NDArray[np.int16],
    position: NDArray[np.float32],
    normal: NDArray[np.int16],
    places: NDArray[np.int32],
    folded: NDArray[np.uint16],
) -> int:
    """As `normal_residuals` where all points on faces have the normal that is predicted.

    Only emission and the ends of rays that left have residuals.

    Parameters
    ----------
    numbers : (n_rays,) path of each ray
    emitted, left : (n_paths,) whether its first point is on no face, whether its last one has left
    places : (2 n_rays,) out, records with a residual; folded : (3, 2 n_rays) out, their residuals

    Returns
    -------
    n : how many there are
    """
    n = np.uint64(0)
    one = np.uint64(1)
    for ray in range(sources.size):
        path = numbers[ray]
        if emitted[path]:
            first = np.uint64(record_offsets[ray])
            source = np.uint16(sources[ray])
            x = _fold(normal[first, 0], int(emission[source, 0]))
            y = _fold(normal[first, 1], int(emission[source, 1]))
            z = _fold(normal[first, 2], int(emission[source, 2]))
            if x | y | z:
                places[n] = first
                folded[0, n], folded[1, n], folded[2, n] = x, y, z
                n += one
                for k in range(3):
                    emission[source, k] = normal[first, k]
        if left[path]:
            last = np.uint64(record_offsets[ray + 1] - 1)
            px, py, pz = _scaled(
                np.float64(position[last, 0]) - np.float64(position[last - one, 0]),
                np.float64(position[last, 1]) - np.float64(position[last - one, 1]),
                np.float64(position[last, 2]) - np.float64(position[last - one, 2]),
            )
            x = _fold(normal[last, 0], px)
            y = _fold(normal[last, 1], py)
            z = _fold(normal[last, 2], pz)
            if x | y | z:
                places[n] = last
                folded[0, n], folded[1, n], folded[2, n] = x, y, z
                n += one
    return np.int64(n)  # type: ignore[return-value]


@lean_kernel
def other_residuals(
    points: RayPoints,
    shapes: ShapeTable,
    emission: NDArray[np.int16],
    remembered: NDArray[np.int16],
    position: NDArray[np.float32],
    normal: NDArray[np.int16],
    places: NDArray[np.int32],
    folded: NDArray[np.uint16],
) -> int:
    """As `normal_residuals` where all points on quadrics have the normal that is predicted.

    Parameters
    ----------
    emission : (n_sources, 3) zeros; remembered : (n_remembered, 3) zeros
    places : (n_records,) out, records with a residual; folded : (3, n_records) out, theirs

    Returns
    -------
    n : how many there are
    """
    face_code, triangles = shapes.face_code, points.triangles
    faces, objects, events = points.face, points.object, points.event
    several = shapes.primitive_quadric.size > 0
    n = np.uint64(0)
    for ray in range(points.sources.size):
        begin, end = points.record_offsets[ray], points.record_offsets[ray + 1]
        row = points.path_offsets[points.numbers[ray]]
        for k in range(end - begin):
            point, i = np.uint64(row + k), np.uint64(begin + k)
            face = faces[point]
            code = np.int64(0)
            primitive = np.int64(-1)
            if face >= 0:
                code = np.int64(face_code[np.uint32(face)])
                if code >= 0:
                    continue
                if code <= MANY:
                    index = np.int64(triangles[i] - shapes.first_primitive[np.uint32(face)])
                    start = shapes.quadric_start[np.uint32(face)]
                    if (
                        several
                        and start >= 0
                        and shapes.primitive_quadric[np.uint64(start + index)] >= 0
                    ):
                        continue
                    own = shapes.face_start[np.uint32(face)] + index
                    primitive = own if remembered.shape[0] > 0 else np.int64(-1)
            else:
                code = np.int64(code_off_faces(k == 0, objects[point], events[point]))
            source = points.sources[ray]
            px, py, pz = _from_before(i, code, primitive, source, position, emission, remembered)
            x, y, z = _fold(normal[i, 0], px), _fold(normal[i, 1], py), _fold(normal[i, 2], pz)
            if x | y | z:
                places[n] = i
                folded[0, n], folded[1, n], folded[2, n] = x, y, z
                n += np.uint64(1)
                _remember(i, code, primitive, source, normal, emission, remembered)
    return np.int64(n)  # type: ignore[return-value]


@lean_kernel
def _decode_normals(
    record_offsets: NDArray[np.int64],
    codes: NDArray[np.int32],
    triangles: NDArray[np.int32],
    sources: NDArray[np.int16],
    gradient: NDArray[np.float64],
    first_primitive: NDArray[np.int32],
    face_start: NDArray[np.int64],
    emission: NDArray[np.int16],
    remembered: NDArray[np.int16],
    position: NDArray[np.float32],
    folded: Folded,
    normal: NDArray[np.int16],
) -> None:
    """The inverse of `normal_residuals`; triangles may be (0,) where no code needs them."""
    x, y, z = folded
    for ray in range(sources.size):
        for i in range(record_offsets[ray], record_offsets[ray + 1]):
            code = codes[i]
            primitive = -1
            if code >= 0:
                px, py, pz = _gradient(gradient, code, position, i)
            else:
                primitive = _primitive_of(
                    code, triangles, i, first_primitive, face_start, remembered
                )
                px, py, pz = _from_before(
                    i, code, primitive, sources[ray], position, emission, remembered
                )
            normal[i, 0] = _unfold(x[i], px)
            normal[i, 1] = _unfold(y[i], py)
            normal[i, 2] = _unfold(z[i], pz)
            if code < 0:
                _remember(i, code, primitive, sources[ray], normal, emission, remembered)


@lean_kernel
def _normals_of_records(
    records: NDArray[np.int64],
    codes: NDArray[np.int32],
    gradient: NDArray[np.float64],
    position: NDArray[np.float32],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    z: NDArray[np.uint16],
    normal: NDArray[np.int16],
) -> None:
    """As `_decode_normals`, of some records on quadrics; ``codes`` and ``normal`` are theirs."""
    for k in range(records.size):
        i = np.uint64(records[k])
        px, py, pz = _gradient(gradient, codes[k], position, i)
        normal[k, 0] = _unfold(x[i], px)
        normal[k, 1] = _unfold(y[i], py)
        normal[k, 2] = _unfold(z[i], pz)
